//! Shots past balls and walls, by chance and straight, against outlines that formulas give.

use super::*;
use crate::math::DVec3;
use crate::math::fresnel::Interface;
use crate::math::stats::Moments;
use crate::scene::SceneDesc;
use crate::scene::compile::LoadOptions;
use crate::shape::{Shape, Sphere};
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

fn compile(text: &str) -> Scene {
    let desc = SceneDesc::parse(text, std::path::Path::new("shots.xml"), &[]).unwrap();
    Scene::compile(&desc, &LoadOptions::default()).unwrap()
}

fn ball(scene: &Scene, shape: u32) -> &Sphere {
    match &scene.shapes[shape as usize].shape {
        Shape::Sphere(s) => s,
        _ => panic!("no ball"),
    }
}

/// A ball in a mirror: of its image, at the distance D, an eye's directions cross `∫ dl / |∇ distance| = 2π tan β / D` (sin β = R/D), rays along one direction `2π R`.
#[test]
fn great_circles_measure_outlines() {
    let text = r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
      <shape type="rectangle"><transform name="to_world"><scale value="50"/></transform><bsdf type="conductor"/></shape>
      <shape type="sphere"><point name="center" value="0.4, 0.2, 2"/><float name="radius" value="0.7"/><bsdf type="diffuse"/></shape>
      <emitter type="constant"/></scene>"#;
    let scene = compile(text);
    let o = DVec3::new(-1.5, 0.3, 3.0);
    let (r, d) = (0.7, (DVec3::new(0.4, 0.2, -2.0) - o).length());
    let along = DVec3::new(0.5, 0.0, -1.0).normalize();
    for (eye, truth) in [(Eye::Point(o), TAU * r / (d * d - r * r).sqrt() / d), (Eye::Parallel(along), TAU * r)] {
        let target = |rng: &mut Rng| Target::ball(1, ball(&scene, 1), rng.uniform(), rng.uniform());
        measures((&scene, &eye), (20_000, 0.02), truth, target, |s| {
            assert!(((s.e - ball(&scene, 1).center).length() - r).abs() < 1e-9);
            1.0 / s.spread
        });
    }
}

/// A tube in a mirror: of its image, whose two lines of contact have the distance ρ, an eye's directions cross `∫ dl sin α / d² = 2 [h / (ρ √(ρ² + h²))]` (h: heights over the eye's), rays along one direction `2 L sin α`.
#[test]
fn heights_measure_walls() {
    let text = r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
      <shape type="rectangle"><transform name="to_world"><scale value="50"/></transform><bsdf type="conductor"/></shape>
      <shape type="cylinder"><point name="p0" value="0.4, -0.3, 1.6"/><point name="p1" value="0.1, 0.9, 2.4"/><float name="radius" value="0.4"/><bsdf type="diffuse"/></shape>
      <emitter type="constant"/></scene>"#;
    let scene = compile(text);
    let Shape::Cylinder(q) = &scene.shapes[1].shape else { panic!("no tube") };
    let o = DVec3::new(-1.5, 0.3, 3.0);
    let over = |v: DVec3| DVec3::new(v.x, v.y, -v.z);
    let (base, axis) = (over(q.base), over(q.axis));
    let (low, across) = ((base - o).dot(axis), (base - o).cross(axis).length_squared());
    let rho = (across - q.radius * q.radius).sqrt();
    let seen = |h: f64| h / (rho * rho.hypot(h));
    let along = DVec3::new(0.5, 0.0, -1.0).normalize();
    let truths = [2.0 * (seen(low + q.length) - seen(low)), 2.0 * q.length * along.cross(axis).length()];
    for (eye, truth) in [Eye::Point(o), Eye::Parallel(along)].into_iter().zip(truths) {
        measures(
            (&scene, &eye),
            (20_000, 0.02),
            truth,
            |rng| Target::wall(1, q, rng.uniform()),
            |s| {
                assert!((q.from_axis(s.e).length() - q.radius).abs() < 1e-9);
                q.length / s.spread
            },
        );
    }
}

/// Glass of nearly its surroundings' index mirrors a ten-thousandth of what chains go that way: they are kept as rarely, and count as much oftener. Each point is seen in it once.
#[test]
fn weak_chains_count_as_often_as_they_are_kept() {
    let text = r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
      <shape type="rectangle"><transform name="to_world"><scale value="50"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.05"/><float name="ext_ior" value="1"/></bsdf></shape>
      <emitter type="constant"/></scene>"#;
    let scene = compile(text);
    let eye = Eye::Point(DVec3::new(-1.5, 0.3, 3.0));
    let target = |_: &mut Rng| Target::Point(DVec3::new(0.5, 0.2, 2.0));
    measures((&scene, &eye), (400_000, 0.05), 1.0, target, |s| {
        assert!(kept(&scene, &eye, &target(&mut Rng::keyed(0, 0, 0, 0)), s) < 0.2);
        1.0
    });
}

/// So many draws from an eye, each shot counting for itself as `value` says, against a truth; `precision`: the standard error asked.
fn measures(
    (scene, eye): (&Scene, &Eye),
    (draws, precision): (u32, f64),
    truth: f64,
    target: impl Fn(&mut Rng) -> Target,
    value: impl Fn(&Shot) -> f64,
) {
    let place = Place::within(None);
    let random = |rng: &mut Rng| {
        let [a, b] = [6.0 * rng.uniform() - 3.0, 6.0 * rng.uniform() - 3.0];
        Some(match *eye {
            Eye::Point(o) => Start { o, w: (DVec3::new(a, b, 0.0) - o).normalize() },
            // On a plane across them.
            Eye::Parallel(w) => {
                let (x, y) = warp::frame(w);
                Start { o: x * a + y * b - w * 6.0, w }
            }
        })
    };
    let (mut rng, mut sum) = (Rng::keyed(11, 0, 0, 0), Moments::default());
    for _ in 0..draws {
        let target = target(&mut rng);
        let drawn = draw(scene, eye, &place, &target, &mut rng, random, |_| false);
        let weight = |d: &Drawn, rng: &mut Rng| d.trials(scene, eye, &place, &target, rng, random).unwrap();
        sum.push(drawn.map_or(0.0, |d| weight(&d, &mut rng) * value(&d.shot)));
    }
    let (mean, error) = (sum.mean, sum.standard_error());
    println!("{mean} +- {error}, {truth}");
    assert!(error < precision * truth && (mean - truth).abs() < 4.0 * error, "{mean} +- {error}, {truth}");
}

/// From near by, and far from the origin, where rounding lets lines touch the ball before the point that they go to.
#[test]
fn lines_that_graze_a_ball_arrive() {
    let text = r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
      <shape type="sphere"><point name="center" value="100, 80, -90"/><float name="radius" value="0.1"/><bsdf type="diffuse"/></shape>
      <emitter type="constant"/></scene>"#;
    let scene = compile(text);
    let s = ball(&scene, 0);
    let mut rng = Rng::keyed(12, 0, 0, 0);
    for _ in 0..2000 {
        let height = 10f64.powf(-4.0 * rng.uniform());
        let up = warp::sphere(rng.uniform(), rng.uniform());
        let p = s.center + up * (s.radius * (1.0 + height));
        // A point of the circle in which lines from p touch the ball.
        let (x, y) = warp::frame(up);
        let (phi, sin) = (TAU * rng.uniform(), (height * (2.0 + height)).sqrt());
        let b = s.center + (up + (x * phi.cos() + y * phi.sin()) * sin) * (s.radius / (1.0 + height));
        let shot = shot::straight(&scene, p, &Place::within(None), b, Some(0));
        assert!(shot.is_some(), "from {height} above");
    }
}

/// A rod or ball of index 1 in 1.3, of radius r, seen along -z: a ray at the offset `r sin θ` (1.3 sin θ = sin θ') leaves it after m chords at the angle `α = θ + m (π - 2θ')` around it, along `α + θ`. Points behind it are seen
/// by every m, the nearer to the critical angle the greater it is; the light of all these ways is theirs.
#[test]
fn ways_round_a_bubble_are_found() {
    let (r, n, e) = (2.0, 1.3, DVec3::new(-16.0, 0.0, -12.0));
    let way = |sine: f64, m: u32| {
        let (outside, inside) = (sine.asin(), (n * sine).asin());
        let alpha = outside + f64::from(m) * (PI - 2.0 * inside);
        let w = alpha + outside;
        let t = (e.z - r * alpha.cos()) / w.cos();
        let f = Interface::new(outside.cos(), n, 1.0).reflectance();
        (t > 0.0).then(|| (r * alpha.sin() + t * w.sin() - e.x, (1.0 - f).powi(2) * f.powi(m as i32 - 1)))
    };
    let steps = 200_000;
    let light = |chords: RangeInclusive<u32>| {
        let mut light = 0.0;
        for m in chords {
            // In steps of the square root of what is left to the critical angle.
            let at = |k: i32, side: f64| way(side / n * (1.0 - (f64::from(k) / f64::from(steps)).powi(2)), m);
            for (k, side) in (1..steps).flat_map(|k| [(k, 1.0), (k, -1.0)]) {
                if let (Some(a), Some(b)) = (at(k, side), at(k + 1, side)) {
                    // No pole between.
                    if a.0 * b.0 < 0.0 && (a.0 - b.0).abs() < 1.0 {
                        light += a.1;
                    }
                }
            }
        }
        light
    };
    let eye = Eye::Parallel(-DVec3::Z);
    let rod = r#"<shape type="cylinder"><point name="p0" value="0, -9, 0"/><point name="p1" value="0, 9, 0"/>"#;
    for (shape, chords, asked) in [(rod, 4..=12, (150_000, 0.08)), (r#"<shape type="sphere">"#, 3..=4, (600_000, 0.08))]
    {
        let scene = compile(&format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
      {shape}<float name="radius" value="{r}"/><bsdf type="dielectric"><float name="int_ior" value="1"/><float name="ext_ior" value="{n}"/></bsdf></shape>
      <emitter type="constant"/></scene>"#
        ));
        measures(
            (&scene, &eye),
            asked,
            light(chords.clone()),
            |_| Target::Point(e),
            |s| {
                if chords.contains(&(s.chain.len() as u32 - 1)) { s.weight.mean() } else { 0.0 }
            },
        );
    }
}
