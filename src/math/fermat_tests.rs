//! Ways through planes, and why there is none.

use super::*;
use crate::math::rng::{Purpose, Rng};
use crate::math::{V3, fresnel};
use smallvec::smallvec;

fn plane(p: DVec3, n: DVec3) -> Plane {
    let (x, y) = warp::frame(n.normalize());
    Plane { p, x, y, mirrors: false }
}

/// Snell's law at every plane, from skew beginnings: a prism, a mirror behind glass, parallel rays.
#[test]
fn ways_obey_snells_law() {
    let prism = Planes {
        planes: smallvec![
            plane(DVec3::X, DVec3::new(1.0, 0.3, 0.1)),
            plane(DVec3::X * 2.0, DVec3::new(1.0, -0.4, 0.2))
        ],
        index: smallvec![1.0, 1.6, 1.0],
        onward: Onward::Both,
    };
    let mirror = Planes {
        planes: smallvec![
            plane(DVec3::X, DVec3::X),
            plane(DVec3::X * 2.0, DVec3::new(1.0, 0.1, 0.0)),
            plane(DVec3::X, DVec3::X),
        ],
        index: smallvec![1.0, 1.5, 1.5, 1.0],
        onward: Onward::Both,
    };
    // In at one side of a block, mirrored at another that meets it, out at the far side.
    let side = DVec3::new(0.0, 0.2, 0.0);
    let block = Planes {
        planes: smallvec![plane(DVec3::X, DVec3::X), plane(side, DVec3::Y), plane(DVec3::X * 1.3, DVec3::X)],
        index: smallvec![1.0, 1.5, 1.5, 1.0],
        onward: Onward::Both,
    };
    let o = DVec3::new(-1.0, 0.2, 0.1);
    let eyes = [Eye::Point(o), Eye::Parallel(DVec3::new(1.0, 0.1, 0.05).normalize())];
    let below = DVec3::new(-1.0, -0.2, 0.1);
    let chains = [
        (&prism, o, DVec3::new(4.0, 0.6, -0.3), &eyes[..]),
        (&mirror, o, DVec3::new(-2.0, 0.9, 0.4), &eyes),
        (&block, below, DVec3::new(4.0, -0.33, -0.1), &[Eye::Point(below)]),
    ];
    // The least way goes by the line where two of its planes meet: light does not.
    let nowhere = DVec3::new(4.0, -0.9, -0.3);
    assert!(matches!(block.ray(&Eye::Point(below), below, nowhere), Way::None));
    for (chain, o, e, eyes) in chains {
        for eye in eyes {
            let Way::Found(start) = chain.ray(eye, o, e) else { panic!() };
            // Walk it.
            let (mut at, mut w) = (start.o, start.w);
            for (i, p) in chain.planes.iter().enumerate() {
                let n = p.x.cross(p.y);
                let t = n.dot(p.p - at) / n.dot(w);
                assert!(t > 0.0);
                at += w * t;
                let (n1, n2) = (chain.index[i], chain.index[i + 1]);
                let tangent = (w - n * n.dot(w)) * (n1 / n2);
                let cos = (1.0 - tangent.length_squared()).sqrt() * n.dot(w).signum();
                w = tangent + n * if n1 == n2 { -cos } else { cos };
            }
            let miss = (e - at) - w * (e - at).dot(w);
            assert!(miss.length() < 1e-9, "{miss}");
        }
    }
}

const SIZE: f64 = 10.0;

type Random<'a> = &'a mut dyn FnMut(f64) -> DVec3;

/// Vectors in a cube of side n.
fn random_vectors(key: u64) -> impl FnMut(f64) -> DVec3 {
    let mut rng = Rng::keyed(key, 0, 0, 0);
    move |n| DVec3::new(rng.uniform() - 0.5, rng.uniform() - 0.5, rng.uniform() - 0.5) * n
}

/// Counts of chains: with a way, with a kink, with neither told.
#[derive(Debug, Default)]
struct Told {
    ways: usize,
    kinked: usize,
    left: usize,
}

impl Told {
    /// One chain, to one point. No length near a certified kink is less, and soft lengths find no way either.
    fn tell(&mut self, planes: &Planes, eye: &Eye, o: DVec3, e: DVec3, random: Random) {
        let mut q: Vector<UNKNOWNS> = [0.0; UNKNOWNS];
        if planes.dive(eye, o, e, &mut q, SIZE) {
            self.ways += 1;
            assert!(planes.kink(eye, o, e, &q, SIZE).is_none(), "{planes:?} {eye:?} {o} {e}");
            return;
        }
        let Some(points) = planes.kink(eye, o, e, &q, SIZE) else {
            self.left += 1;
            return;
        };
        self.kinked += 1;
        assert!(!matches!(planes.softly::<UNKNOWNS>(eye, o, e, SIZE), Way::Found(_)), "{planes:?} {eye:?} {o} {e}");
        for (i, (p, at)) in planes.planes.iter().zip(&points).enumerate() {
            assert!(p.normal().dot(*at - p.p).abs() < 1e-9, "{at} is not in plane {i}");
            (q[2 * i], q[2 * i + 1]) = ((*at - p.p).dot(p.x), (*at - p.p).dot(p.y));
        }
        let least = planes.length(eye, o, e, &q, 0.0);
        for k in 0..200 {
            let by = 10f64.powi(-(k % 6));
            let moved: Vector<UNKNOWNS> =
                std::array::from_fn(|i| if i < 2 * points.len() { q[i] + random(by).x } else { 0.0 });
            let other = planes.length(eye, o, e, &moved, 0.0);
            assert!(other >= least - 1e-12 * SIZE, "{} shorter by {by}: {planes:?} {eye:?} {o} {e}", least - other);
        }
    }
}

/// Chains through the faces of a block, straight and skew, to points all around: what a subgradient tells is what soft lengths tell, and it is told often, by two planes and by three.
#[test]
fn kinks_are_told_by_subgradients() {
    for skew in [0.0, 0.8] {
        let mut random = random_vectors(5);
        let straight = [-1.0, 1.0].map(|s| [DVec3::X * s, DVec3::Y * s * 0.6, DVec3::Z * s * 0.8]).concat();
        let faces: Vec<DVec3> = straight.iter().map(|f| *f + random(skew) * f.length()).collect();
        let mut told = Told::default();
        for i in 0..3000 {
            let k = 2 + i % 3;
            let mut chain: Vec<usize> = Vec::new();
            while chain.len() < k {
                let next = ((random(1.0).x + 0.5) * 6.0) as usize;
                if chain.last().is_none_or(|l| l % 3 != next % 3) {
                    chain.push(next);
                }
            }
            let planes = chain.iter().map(|&f| plane(faces[f] + flat(random(1.0), faces[f]), faces[f])).collect();
            let through = i % 2 == 0;
            let index = (0..=k).map(|j| if j == 0 || (j == k && through) { 1.0 } else { 1.5 }).collect();
            let planes = Planes { planes, index, onward: Onward::Both };
            let (o, e) = (DVec3::new(0.4, 3.0, 2.0) + random(1.0), random(6.0));
            let eye = if i % 5 == 0 { Eye::Parallel(random(1.0).normalize()) } else { Eye::Point(o) };
            told.tell(&planes, &eye, o, e, &mut random);
        }
        assert!(told.kinked > 1500 && told.ways > 75 && told.left < told.kinked / 2, "skew {skew}: {told:?}");
    }
}

/// Three planes through one line, which is nowhere special: the point on it is held though nothing alone determines what pulls at it.
#[test]
fn planes_through_one_line() {
    let mut random = random_vectors(6);
    let mut told = Told::default();
    for i in 0..1000 {
        let (c, axis) = (random(2.0), random(1.0).normalize());
        let (x, y) = warp::frame(axis);
        let mut planes: SmallVec<[Plane; 4]> = SmallVec::new();
        while planes.len() < 3 {
            let n = x * random(1.0).x + y * random(1.0).y;
            // Of one plane twice in a row nothing is told.
            if planes.last().is_none_or(|p: &Plane| p.normal().cross(n.normalize()).length() > 0.1) {
                planes.push(plane(c + flat(random(2.0), n), n));
            }
        }
        let index = [[1.0, 1.5, 1.5, 1.0], [1.0, 1.5, 1.2, 1.7]][i % 2].into_iter().collect();
        let planes = Planes { planes, index, onward: Onward::Both };
        let (o, e) = (random(8.0), random(8.0));
        let q: Vector<UNKNOWNS> = std::array::from_fn(|j| {
            let p = &planes.planes[(j / 2).min(2)];
            (c - p.p).dot(if j % 2 == 0 { p.x } else { p.y })
        });
        // From the line itself, where all three planes are held together.
        if let Some(points) = planes.kink(&Eye::Point(o), o, e, &q, SIZE) {
            assert!(points.iter().all(|p| p.is_finite()));
        }
        told.tell(&planes, &Eye::Point(o), o, e, &mut random);
    }
    assert!(told.kinked > 300, "{told:?}");
}

/// The two faces of a thin pane meet nowhere, so that the next shortest segment has to be what is missing.
#[test]
fn kinks_behind_thin_panes() {
    let pane = |x: f64| plane(DVec3::X * x, DVec3::X);
    let planes = Planes {
        planes: smallvec![pane(0.0), pane(1e-5), plane(DVec3::ZERO, DVec3::Y)],
        index: smallvec![1.0, 1.5, 1.0, 1.0],
        onward: Onward::Both,
    };
    let (o, e) = (DVec3::new(-1.0, 0.2, 0.1), DVec3::new(-1.0, -0.3, 0.0));
    let mut random = random_vectors(7);
    let mut told = Told::default();
    told.tell(&planes, &Eye::Point(o), o, e, &mut random);
    assert_eq!(told.kinked, 1, "{told:?}");
}

/// Rays are traced through random planes; from where they end the way back is found.
#[test]
fn finds_the_rays_it_is_given() {
    let mut rng = Rng::keyed(3, Purpose::Motion as u64, 0, 0);
    let (mut found, mut mirrors, mut missed, mut tried) = (0, 0, 0, 0);
    for _ in 0..4000 {
        let unit = |rng: &mut Rng| crate::math::warp::sphere(rng.uniform(), rng.uniform());
        let q = unit(&mut rng) * 2.0;
        let (mut p, mut w) = (q, unit(&mut rng));
        let mut crossings = Vec::new();
        let mut planes: Vec<Fold> = Vec::new();
        let mut index = 1.0 + rng.uniform();
        for _ in 0..1 + (rng.uniform() * 4.0) as usize {
            p += w * (0.2 + rng.uniform());
            let n = unit(&mut rng);
            let through = rng.uniform() < 0.7;
            let behind = if through { 1.0 + rng.uniform() } else { index };
            let side = if n.dot(w) < 0.0 { n } else { -n };
            let c = -side.dot(w);
            if c < 0.1 {
                continue;
            }
            let next = if through {
                fresnel::Interface::new(c, index, behind)
                    .refract(V3::constant(w), V3::constant(side))
                    .map(|v| v.value())
            } else {
                Some(fresnel::reflect(w, n))
            };
            let Some(next) = next.filter(|v: &DVec3| v.dot(n).abs() > 0.1) else { continue };
            // The plane is named by another point of it.
            let (a, _) = warp::frame(n);
            crossings.push(p);
            planes.push(Fold {
                p: p + a * rng.uniform(),
                n,
                through,
                index: if through { [index, behind] } else { [1.0; 2] },
            });
            mirrors += usize::from(!through);
            (w, index) = (next.normalize(), behind);
        }
        if planes.is_empty() {
            continue;
        }
        let x = p + w * (0.2 + rng.uniform());
        let chain = Planes::new(planes.iter().copied(), Onward::Both);
        let around = |c: DVec3, n: DVec3| {
            let (a, b) = warp::frame(n);
            [c + a * 0.1, c - a * 0.1 + b * 0.1, c - a * 0.1 - b * 0.1]
        };
        let hulls: Vec<_> = crossings.iter().zip(&planes).map(|(c, f)| around(*c, f.n)).collect();
        let hulls: Vec<&[DVec3]> = hulls.iter().map(|h| &h[..]).collect();
        // Elsewhere there is nothing, which is seen at once two times in three; at other times the way found is for others to refuse.
        let (a, _) = warp::frame(planes[0].n);
        let elsewhere = around(crossings[0] + a, planes[0].n);
        let others: Vec<&[DVec3]> =
            hulls.iter().enumerate().map(|(i, h)| if i == 0 { &elsewhere[..] } else { h }).collect();
        missed += usize::from(matches!(chain.arrival(&Eye::Point(q), q, x, &others), Way::None));
        tried += 1;
        let Way::Found(d) = chain.arrival(&Eye::Point(q), q, x, &hulls) else { panic!("{planes:?}") };
        assert!((d - w).length() < 1e-7, "{planes:?}: {d} {w}");
        found += usize::from(planes.len() > 1);
    }
    assert!(found > 1500 && mirrors > 500 && 5 * missed > 3 * tried, "{found} {mirrors} {missed} of {tried}");
}

fn flat(p: DVec3, n: DVec3) -> DVec3 {
    p - n * (n.dot(p) / n.length_squared())
}

/// The least way to a point on the light's own side of an interface touches it and turns back; light goes through, or not at all.
#[test]
fn light_does_not_turn_back_at_an_interface() {
    let fold = Fold { p: DVec3::ZERO, n: DVec3::X, through: true, index: [1.0, 1.5] };
    let planes = Planes::new([fold], Onward::Both);
    let q = DVec3::new(1.0, 2.0, 0.3);
    let to = |x: f64| planes.arrival(&Eye::Point(q), q, DVec3::new(x, -1.0, 0.0), &[]);
    assert!(matches!(to(2.0), Way::None));
    assert!(matches!(to(-2.0), Way::Found(w) if w.x < 0.0));
}
