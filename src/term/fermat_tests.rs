//! Ways through planes, and why there is none.

use super::super::shot::{self, Place};
use super::*;
use crate::math::rng::Rng;
use crate::scene::SceneDesc;
use crate::scene::compile::LoadOptions;

fn plane(p: DVec3, n: DVec3) -> Plane {
    let (x, y) = warp::frame(n.normalize());
    Plane { p, x, y }
}

/// Snell's law at every plane, from skew beginnings: a prism, a mirror behind glass, parallel rays.
#[test]
fn ways_obey_snells_law() {
    let prism = Planes {
        planes: vec![plane(DVec3::X, DVec3::new(1.0, 0.3, 0.1)), plane(DVec3::X * 2.0, DVec3::new(1.0, -0.4, 0.2))],
        index: vec![1.0, 1.6, 1.0],
        onward: Onward::Both,
    };
    let mirror = Planes {
        planes: vec![
            plane(DVec3::X, DVec3::X),
            plane(DVec3::X * 2.0, DVec3::new(1.0, 0.1, 0.0)),
            plane(DVec3::X, DVec3::X),
        ],
        index: vec![1.0, 1.5, 1.5, 1.0],
        onward: Onward::Both,
    };
    // In at one side of a block, mirrored at another that meets it, out at the far side.
    let side = DVec3::new(0.0, 0.2, 0.0);
    let block = Planes {
        planes: vec![plane(DVec3::X, DVec3::X), plane(side, DVec3::Y), plane(DVec3::X * 1.3, DVec3::X)],
        index: vec![1.0, 1.5, 1.5, 1.0],
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
            let Way::Ray(start) = chain.ray(eye, o, e) else { panic!() };
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
        let mut q = [0.0; UNKNOWNS];
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
        assert!(!matches!(planes.softly(eye, o, e, SIZE), Way::Ray(_)), "{planes:?} {eye:?} {o} {e}");
        for (i, (p, at)) in planes.planes.iter().zip(&points).enumerate() {
            assert!(p.normal().dot(*at - p.p).abs() < 1e-9, "{at} is not in plane {i}");
            (q[2 * i], q[2 * i + 1]) = ((*at - p.p).dot(p.x), (*at - p.p).dot(p.y));
        }
        let least = planes.length(eye, o, e, &q, 0.0);
        for k in 0..200 {
            let by = 10f64.powi(-(k % 6));
            let moved = std::array::from_fn(|i| if i < 2 * points.len() { q[i] + random(by).x } else { 0.0 });
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
        let mut planes = Vec::new();
        while planes.len() < 3 {
            let n = x * random(1.0).x + y * random(1.0).y;
            // Of one plane twice in a row nothing is told.
            if planes.last().is_none_or(|p: &Plane| p.normal().cross(n.normalize()).length() > 0.1) {
                planes.push(plane(c + flat(random(2.0), n), n));
            }
        }
        let index = [[1.0, 1.5, 1.5, 1.0], [1.0, 1.5, 1.2, 1.7]][i % 2].to_vec();
        let planes = Planes { planes, index, onward: Onward::Both };
        let (o, e) = (random(8.0), random(8.0));
        let q: Vector = std::array::from_fn(|j| {
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
        planes: vec![pane(0.0), pane(1e-5), plane(DVec3::ZERO, DVec3::Y)],
        index: vec![1.0, 1.5, 1.0, 1.0],
        onward: Onward::Both,
    };
    let (o, e) = (DVec3::new(-1.0, 0.2, 0.1), DVec3::new(-1.0, -0.3, 0.0));
    let mut random = random_vectors(7);
    let mut told = Told::default();
    told.tell(&planes, &Eye::Point(o), o, e, &mut random);
    assert_eq!(told.kinked, 1, "{told:?}");
}

/// Light goes on from a pane to the side that it left by; a mirror behind it may be met, by the same steps, from either side.
#[test]
fn where_light_goes_on_to() {
    let text = r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
      <shape type="rectangle"><transform name="to_world"><translate z="2"/></transform>
        <bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="4"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
      <emitter type="constant"/></scene>"#;
    let desc = SceneDesc::parse(text, std::path::Path::new("ways.xml"), &[]).unwrap();
    let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
    // Through the pane, then against one side of the mirror or the other.
    for side in [1.0, -1.0] {
        let (o, place) = (DVec3::new(0.0, 0.4 * side, 3.0), Place::within(None));
        let start = Start { o, w: (DVec3::new(0.0, 0.0, 0.2) - o).normalize() };
        let mut rng = Rng::keyed(8, 0, 0, 0);
        let mut chains =
            std::iter::repeat_with(|| shot::random_chain(&scene, start, &place, &mut rng)).take(1000).flatten();
        let chain: Vec<Specular> = chains.find(|c| c.len() == 2 && c[0].through).unwrap();
        let mirror = Planes::of(&scene, &chain).unwrap();
        let pane = Planes::of(&scene, &chain[..1]).unwrap();
        let at = |y: f64, z: f64| DVec3::new(0.1, y, z);
        assert!(mirror.goes_on_to(at(0.3, 0.5), SIZE) && mirror.goes_on_to(at(-0.3, 0.5), SIZE));
        assert!(!mirror.goes_on_to(at(0.0, 0.5), SIZE));
        assert!(pane.goes_on_to(at(0.3, 1.0), SIZE) && !pane.goes_on_to(at(0.3, 2.5), SIZE));
        assert!(!pane.goes_on_to(at(0.3, 2.0), SIZE));
        let e = at(0.5 * side, -1.0);
        assert!(matches!(mirror.ray(&Eye::Point(o), o, e), Way::Ray(_)));
        // From the other side of the same mirror, by way of the same steps.
        let other = DVec3::new(o.x, -o.y, o.z);
        assert!(matches!(mirror.ray(&Eye::Point(other), other, at(-0.5 * side, -1.0)), Way::Ray(_)));
    }
}

fn flat(p: DVec3, n: DVec3) -> DVec3 {
    p - n * (n.dot(p) / n.length_squared())
}
