use super::*;
use crate::math::Dual;
use crate::math::ball_ways::Ball;

type D = Dual<8>;

/// The centre of a ball of radius 0.4.
const BALL: DVec3 = DVec3::new(0.1, 0.0, -0.2);

const GLASS: Matter<f64> = Matter::Dielectric([1.0, 1.5]);

/// A way, near one that may be off by much.
fn settled(mut faces: Faces<f64>) -> SmoothWay<f64> {
    for _ in 0..60 {
        let way = faces.way().unwrap();
        (faces.before, faces.first) = (way.w[0].value(), way.at[0].value());
    }
    faces.way().unwrap()
}

/// [T] D4, with its derivatives by the index, the light and the point.
#[test]
fn the_reference_geometry_factor_in_motion() {
    let (p, x) = (DVec3::new(0.3, 0.2, 1.2), DVec3::new(-0.2, 0.1, -0.8));
    let form = Form::Plane { p: V3::constant(DVec3::ZERO), n: V3::constant(DVec3::Z) };
    let plane = |matter| Face { form, through: true, matter };
    let faces = Faces {
        from: Origin::Position(V3::constant(p)),
        before: -DVec3::Z,
        first: DVec3::ZERO,
        list: SmallVec::from_slice(&[plane(Matter::Dielectric([1.0, 1.33]))]),
        x: V3::constant(x),
    };
    let at = settled(faces).at[0].value();
    assert!((at - DVec3::new(-0.03497444, 0.13300511, 0.0)).length() < 1e-8, "{at:?}");
    let (z, index) = (DVec3::Z, Matter::Dielectric([D::constant(1.0), D::variable(1.33, 6)]));
    let form = Form::Plane { p: V3::constant(DVec3::ZERO), n: V3::constant(z) };
    let face = Face { form, through: true, matter: index };
    let faces = Faces {
        from: Origin::Position(V3::variable(p, 3)),
        before: (at - p).normalize(),
        first: at,
        list: SmallVec::from_slice(&[face]),
        x: V3::variable(x, 0),
    };
    let way = faces.way().unwrap();
    let c = -way.w[0].dot(V3::constant(z));
    let f = Interface::new(c, D::constant(1.0), D::variable(1.33, 6)).reflectance();
    let g = way.gain[0] / (-f + 1.0);
    assert!((g.v - 0.286593902199).abs() < 1e-12, "{g:?}");
    for (k, truth) in [(6, 0.1329363489), (3, -0.07792992153), (5, -0.2991988621), (2, 0.2170320133)] {
        assert!((g.d[k] - truth).abs() < 1e-9, "{k} {g:?}");
    }
}

/// [T] D4, the sphere: dG/dn.
#[test]
fn the_reference_geometry_factor_of_a_ball_in_motion() {
    let (p, x) = (DVec3::new(0.5, 0.8, 2.0), DVec3::new(0.2, -0.1, 0.3));
    let first = DVec3::new(0.34199455, 0.17381811, 0.92348633);
    let ball = Form::Ball { center: V3::constant(DVec3::ZERO), rim: V3::constant(DVec3::Z), within: false };
    let n = D::variable(1.5, 6);
    let faces = Faces {
        from: Origin::Position(V3::constant(p)),
        before: (first - p).normalize(),
        first,
        list: SmallVec::from_slice(&[Face { form: ball, through: true, matter: Matter::Dielectric([D::one(), n]) }]),
        x: V3::constant(x),
    };
    let way = faces.way().unwrap();
    assert!((way.at[0].value() - first).length() < 1e-8, "{way:?}");
    let share = -Interface::new(-way.w[0].dot(way.at[0]), D::one(), n).reflectance() + 1.0;
    let g = way.gain[0] / share;
    assert!((g.v - 0.501025758131).abs() < 1e-8, "{g:?}");
    assert!((g.d[6] - 0.4838993851).abs() < 1e-7, "{g:?}");
}

/// Where light meets the ball first on its way by it to x.
fn by_ball(list: &[Face<f64>], from: Origin<f64>, x: DVec3) -> DVec3 {
    let is_metal = matches!(list[0].matter, Matter::Conductor { .. });
    let ball = Ball { radius: 0.4, index: [1.0, 1.5], is_metal };
    let (source, far) = match from {
        Origin::Position(q) => (q.value() - BALL, false),
        Origin::Infinity(w) => (-w.value(), true),
    };
    let mut found = None;
    ball.ways(source, far, x - BALL, list.len() as u32, None, |way| {
        if way.through.iter().eq(list.iter().map(|f| &f.through)) {
            found = Some(BALL + way.points[0]);
        }
    });
    found.unwrap()
}

/// Everything that a way carries, by all its numbers, against differences: one face and more, refracting and mirroring, also right below a light, from a position and from infinity.
#[test]
fn ways_in_motion() {
    let metal = Matter::Conductor { eta: Rgb([0.2, 0.9, 1.2]), k: Rgb::splat(2.5) };
    let face = |z: f64, tilt: f64, through: bool, matter: Matter<f64>| {
        let n = V3::constant(DVec3::new(tilt, -0.1, 1.0).normalize());
        Face { form: Form::Plane { p: V3::constant(DVec3::new(0.1, 0.0, z)), n }, through, matter }
    };
    let ball = |within: bool, through: bool, matter: Matter<f64>| {
        let [center, rim] = [BALL, BALL + DVec3::new(0.0, 0.0, 0.4)].map(V3::constant);
        Face { form: Form::Ball { center, rim, within }, through, matter }
    };
    let out = Matter::Dielectric([1.5, 1.1]);
    let inward = Matter::Dielectric([1.5, 1.0]);
    let flat: [(Vec<Face<f64>>, f64); 5] = [
        (vec![face(0.2, 0.2, true, GLASS)], -0.9),
        (vec![face(0.2, 0.2, false, metal)], 0.9),
        (vec![face(0.2, 0.1, true, GLASS), face(-0.3, 0.0, true, out)], -0.9),
        (vec![face(0.2, 0.0, true, GLASS), face(-0.3, 0.1, false, out), face(0.2, 0.0, true, out)], 0.8),
        (
            vec![
                face(0.2, 0.0, true, GLASS),
                face(-0.3, 0.1, false, out),
                face(0.2, 0.0, false, Matter::Dielectric([1.5, 1.0])),
                face(-0.3, 0.1, true, out),
            ],
            -0.9,
        ),
    ];
    let at = |x, y, z| DVec3::new(x, y, z);
    let flat = flat.map(|(list, z)| (list, [at(-0.5, 0.8, z), at(0.4, -0.3, z)]));
    let round = [
        (vec![ball(false, false, metal)], [at(-0.5, 0.8, 0.9), at(1.4, -0.3, 0.2)]),
        (vec![ball(false, true, GLASS)], [at(0.15, 0.05, -0.3), at(0.0, 0.1, -0.1)]),
        (vec![ball(false, true, GLASS), ball(true, true, inward)], [at(0.1, 0.1, -0.7), at(0.05, 0.12, -0.75)]),
        (
            vec![ball(false, true, GLASS), ball(true, false, inward), ball(true, true, inward)],
            [at(0.2, -0.2, 1.0), at(0.3, 0.0, 0.8)],
        ),
    ];
    let chains: Vec<_> = flat.into_iter().chain(round).collect();
    let light = DVec3::new(0.4, -0.3, 1.4);
    let far = DVec3::new(0.3, 0.4, -1.0).normalize();
    let mut compared = 0;
    for ((list, ends), from) in chains
        .iter()
        .flat_map(|c| [Origin::Position(V3::constant(light)), Origin::Infinity(V3::constant(far))].map(|f| (c, f)))
    {
        for &x in ends {
            let first = match list[0].form {
                Form::Plane { .. } => DVec3::new(0.1, 0.0, 0.2),
                Form::Ball { .. } => by_ball(list, from, x),
            };
            let before = if matches!(from, Origin::Infinity(_)) { far } else { (first - light).normalize() };
            let faces = Faces { from, before, first, list: SmallVec::from_slice(list), x: V3::constant(x) };
            let found = settled(faces.clone());
            let (before, first) = (found.w[0].value(), found.at[0].value());
            let numbers = |w: &SmoothWay<f64>| {
                let vectors = w.at.iter().chain(&w.w).flat_map(|v| v.value().to_array());
                let lengths = w.lengths.iter().copied().filter(|l| l.is_finite());
                vectors.chain(w.gain).chain(lengths).collect::<Vec<f64>>()
            };
            let slopes = |w: &SmoothWay<D>, k: usize| {
                let vectors = w.at.iter().chain(&w.w).flat_map(|v| [v.x.d[k], v.y.d[k], v.z.d[k]]);
                let lengths = w.lengths.iter().filter(|l| l.v.is_finite()).map(|l| l.d[k]);
                vectors.chain(w.gain.map(|g| g.d[k])).chain(lengths).collect::<Vec<f64>>()
            };
            // Numbers of the ends, and of each face.
            for group in 0..=list.len() {
                let moved = |k: usize, h: f64| {
                    let mut to = Faces { before, first, ..faces.clone() };
                    let shift = |v: &mut V3<f64>, k: usize| *v = *v + V3::constant(DVec3::AXES[k] * h);
                    match (group.checked_sub(1), k) {
                        (None, 0..3) => shift(&mut to.x, k),
                        (None, 3..6) => match &mut to.from {
                            Origin::Position(q) => shift(q, k - 3),
                            Origin::Infinity(w) => shift(w, k - 3),
                        },
                        (Some(i), 0..6) => match &mut to.list[i].form {
                            Form::Plane { p, n } => shift(if k < 3 { p } else { n }, k % 3),
                            Form::Ball { center, rim, .. } => shift(if k < 3 { center } else { rim }, k % 3),
                        },
                        (Some(i), k) => match &mut to.list[i].matter {
                            Matter::Dielectric(index) => index[k - 6] += h,
                            Matter::Conductor { .. } => return None,
                        },
                        _ => return None,
                    }
                    Some(numbers(&settled(to)))
                };
                let own = |i: usize| group == i + 1;
                let lift = |v: V3<f64>, on: bool, first: usize| {
                    if on { V3::variable(v.value(), first) } else { V3::constant(v.value()) }
                };
                let form = |(i, f): (usize, Form<f64>)| match f {
                    Form::Plane { p, n } => Form::Plane { p: lift(p, own(i), 0), n: lift(n, own(i), 3) },
                    Form::Ball { center, rim, within } => {
                        Form::Ball { center: lift(center, own(i), 0), rim: lift(rim, own(i), 3), within }
                    }
                };
                let lifted = |(i, f): (usize, &Face<f64>)| Face {
                    form: form((i, f.form)),
                    through: f.through,
                    matter: match f.matter {
                        Matter::Dielectric([a, b]) if own(i) => {
                            Matter::Dielectric([D::variable(a, 6), D::variable(b, 7)])
                        }
                        Matter::Dielectric(index) => Matter::Dielectric(index.map(D::constant)),
                        Matter::Conductor { eta, k } => Matter::Conductor { eta, k },
                    },
                };
                let way = Faces {
                    from: match from {
                        Origin::Position(q) => Origin::Position(lift(q, group == 0, 3)),
                        Origin::Infinity(w) => Origin::Infinity(lift(w, group == 0, 3)),
                    },
                    before,
                    first,
                    list: list.iter().enumerate().map(lifted).collect(),
                    x: lift(faces.x, group == 0, 0),
                };
                let way = way.way().unwrap();
                // Directions and normals stay unit vectors: along tangents only.
                for tangent in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                    for block in [0, 3, 6] {
                        let unit = block == 3 && (group > 0 || matches!(from, Origin::Infinity(_)));
                        let axis = match (unit, group) {
                            (false, _) => DVec3::ZERO,
                            (true, 0) => far,
                            (true, g) => match list[g - 1].form {
                                Form::Plane { n, .. } => n.value(),
                                Form::Ball { .. } => DVec3::ZERO,
                            },
                        };
                        let t = DVec3::from_array(tangent);
                        let t = t - axis * axis.dot(t);
                        let h = 1e-5;
                        let side = |s: f64| {
                            (0..3).filter(|k| block + k < 8).try_fold(None, |sum: Option<Vec<f64>>, k| {
                                let there = moved(block + k, s * h * t[k])?;
                                let here = numbers(&found);
                                let off: Vec<f64> = there.iter().zip(&here).map(|(a, b)| a - b).collect();
                                Some(Some(
                                    sum.map_or(off.clone(), |s| s.iter().zip(&off).map(|(a, b)| a + b).collect()),
                                ))
                            })?
                        };
                        let (Some(a), Some(b)) = (side(1.0), side(-1.0)) else { continue };
                        for (j, (a, b)) in a.iter().zip(&b).enumerate() {
                            let own: f64 =
                                (0..3).filter(|k| block + k < 8).map(|k| slopes(&way, block + k)[j] * t[k]).sum();
                            let fd = (a - b) / (2.0 * h);
                            assert!(
                                (own - fd).abs() < 2e-6 * (1.0 + fd.abs()),
                                "{list:?} {from:?} {x} {group} {block} {tangent:?} {j}: {own} {fd}"
                            );
                            compared += 1;
                        }
                    }
                }
            }
        }
    }
    assert!(compared > 2000, "{compared}");
}

/// The area that pencils spread over is that between rays beside each other.
#[test]
fn pencils_spread_as_their_rays_do() {
    let slab = |z: f64, index: [f64; 2]| Face {
        form: Form::Plane { p: V3::constant(DVec3::new(0.0, 0.0, z)), n: V3::constant(DVec3::Z) },
        through: true,
        matter: Matter::Dielectric(index),
    };
    let list = SmallVec::from_slice(&[slab(0.0, [1.0, 1.5]), slab(-0.4, [1.5, 1.0])]);
    let (q, x) = (DVec3::new(0.0, 0.0, 1.0), DVec3::new(0.9, 0.2, -1.1));
    let first = DVec3::new(0.3, 0.1, 0.0);
    let from = Origin::Position(V3::constant(q));
    let way = settled(Faces { from, before: (first - q).normalize(), first, list, x: V3::constant(x) });
    // By the radial coordinate: dΩ/dA of a slab, r = (h0 + h2) tan θ + h1 tan θ', dA across the ray = r dφ dr cos θ.
    let r_of = |theta: f64| {
        let inner = (theta.sin() / 1.5).asin();
        2.1 * theta.tan() - 0.4 * theta.tan() + 0.4 * inner.tan()
    };
    let theta = (-way.w[0].z).acos();
    let r = (x.x * x.x + x.y * x.y).sqrt();
    assert!((r_of(theta) - r).abs() < 1e-12);
    let slope = (r_of(theta + 1e-6) - r_of(theta - 1e-6)) / 2e-6;
    let g = theta.sin() / (r * slope * theta.cos());
    let f = Interface::new(theta.cos(), 1.0, 1.5).reflectance();
    assert!((way.gain[0] / (g * (1.0 - f).powi(2)) - 1.0).abs() < 1e-9, "{:?}", way.gain);
}
