//! A ball of metal in light without extent: its shadow, what it mirrors, and the shadows in that (`term::cast_route`).

use crate::common::*;
use tyndall::math::fresnel::conductor;
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Terms;
use tyndall::scene::Scene;
use tyndall::scene::critical::Critical;

const ETA: f64 = 0.4;
const K: f64 = 3.0;

/// A sun straight down on a ball over a wide floor, of which a square is seen from below the ball; dark, so that what comes back to the ball does not count.
fn under_a_ball() -> String {
    format!(
        r#"<scene version="3.0.0"><default name="x" value="0"/><default name="r" value="0.5"/><integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><scale x="0.4" y="0.4"/><lookat origin="0.6, 0, 0.4" target="0.6, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="2"/><integer name="height" value="2"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="50"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.001"/></bsdf></shape>
  <shape type="sphere" id="ball"><point name="center" value="$x, 0, {HEIGHT}"/><float name="radius" value="$r"/><bsdf type="conductor"><rgb name="eta" value="{ETA}"/><rgb name="k" value="{K}"/></bsdf></shape>
  <emitter type="directional"><vector name="direction" value="0, 0, -1"/><rgb name="irradiance" value="1000"/></emitter></scene>"#
    )
}

const HEIGHT: f64 = 1.6;

/// Where light that meets the ball at the angle `a` from its top meets the floor.
fn lands(r: f64, a: f64) -> f64 {
    r * a.sin() - (HEIGHT + r * a.cos()) * (2.0 * a).tan()
}

/// Mirrored irradiance at a distance from the ball's foot, over the sun's: flux `r² sin a cos a da` through a ring of `p dp`.
fn mirrored(r: f64, p: f64) -> f64 {
    // From straight on at a = 90 degrees to the horizon at 45.
    let (mut lo, mut hi) = (std::f64::consts::FRAC_PI_4 + 1e-12, std::f64::consts::FRAC_PI_2);
    if p <= lands(r, hi) {
        return 0.0;
    }
    for _ in 0..60 {
        let a = 0.5 * (lo + hi);
        if lands(r, a) > p { lo = a } else { hi = a }
    }
    let (a, h) = (0.5 * (lo + hi), 1e-6);
    let slope = (lands(r, a + h) - lands(r, a - h)).abs() / (2.0 * h);
    conductor(a.cos(), ETA, K) * r * r * a.sin() * a.cos() / (p * slope)
}

/// Of the square, all that is mirrored into it.
fn into_square(x: f64, r: f64) -> f64 {
    const N: usize = 400;
    let at = |k: usize| -0.4 + 0.8 * (k as f64 + 0.5) / N as f64;
    let points = (0..N).flat_map(|i| (0..N).map(move |j| (at(i) + 0.6 - x, at(j))));
    points.map(|(p, q)| mirrored(r, p.hypot(q))).sum::<f64>() / (N * N) as f64
}

/// The film's mean is `ρ E/π` of what is lit of the square, and of what is mirrored into it. The shadow, a disk, covers one side of the square whole (0.8), and is met by the square on an arc whose sine is 0.8.
#[test]
fn a_sun_on_a_ball() {
    let text = under_a_ball();
    let unit = 0.001 * 1000.0 / std::f64::consts::PI;
    let h = 1e-4;
    let by_x = (into_square(h, 0.5) - into_square(-h, 0.5)) / (2.0 * h);
    let by_r = (into_square(0.0, 0.5 + h) - into_square(0.0, 0.5 - h)) / (2.0 * h);
    let shadow = [-0.8 / 0.64, -2.0 * 0.5 * 0.8f64.asin() / 0.64];
    let all = derivatives(&text, &["x", "r"], &["all"], 1 << 15);
    check("its place", &all[0], unit * (shadow[0] + by_x), 0.005);
    check("its radius", &all[1], unit * (shadow[1] + by_r), 0.005);
    let still = derivatives(&text, &["x", "r"], &["interior"], 1 << 15);
    check("what it mirrors, by its place", &still[0], unit * by_x, 0.01);
    check("what it mirrors, by its radius", &still[1], unit * by_r, 0.1);
}

/// Angle from the top at which light leaves the ball to what `of` says is more than `least`: `of` falls toward the rim.
fn angle(of: impl Fn(f64) -> f64, least: f64) -> f64 {
    let (mut lo, mut hi) = (std::f64::consts::FRAC_PI_4 + 1e-12, std::f64::consts::FRAC_PI_2 - 1e-12);
    for _ in 0..60 {
        let a = 0.5 * (lo + hi);
        if of(a) > least { lo = a } else { hi = a }
    }
    0.5 * (lo + hi)
}

/// What the ball mirrors into the square around x = 1.6 under an edge along y, at x = 0.9 and the height b.
fn under_an_edge(x: f64, r: f64, b: f64) -> f64 {
    const N: usize = 2000;
    let widest = (0.4f64 / (1.2 - x)).atan();
    let strip = |k: usize| {
        let (sin, cos) = (widest * ((k as f64 + 0.5) / N as f64 * 2.0 - 1.0)).sin_cos();
        let near = (1.2 - x) / cos;
        let far = ((2.0 - x) / cos).min(0.4 / sin.abs());
        let height = |a: f64| HEIGHT + r * a.cos() + ((0.9 - x) / cos - r * a.sin()) / (2.0 * a).tan();
        let from = angle(|a| lands(r, a), far).max(angle(height, b));
        let to = angle(|a| lands(r, a), near).max(from);
        let step = (to - from) / 64.0;
        let at = |j: i32| from + step * (f64::from(j) + 0.5);
        (0..64).map(at).map(|a| conductor(a.cos(), ETA, K) * r * r * a.sin() * a.cos() * step).sum::<f64>()
    };
    (0..N).map(strip).sum::<f64>() * 2.0 * widest / N as f64
}

/// A plate that stands in the light that the ball mirrors, its lower edge across that.
#[test]
fn a_shadow_in_mirrored_light() {
    let plate = r#"<shape type="rectangle"><transform name="to_world"><scale x="0.4" y="0.45"/><translate x="0.4"/><rotate y="1" angle="-70"/><translate x="0.9" z="$b"/></transform>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape><emitter"#;
    let text = under_a_ball().replace("0.6, 0, 0", "1.6, 0, 0").replacen("<emitter", plate, 1);
    let text = text.replacen("<default", r#"<default name="b" value="1"/><default"#, 1);
    let unit = 0.001 * 1000.0 / std::f64::consts::PI / 0.64;
    let h = 1e-4;
    let slope = |f: &dyn Fn(f64) -> f64| (f(h) - f(-h)) / (2.0 * h);
    let truths = [
        slope(&|h| under_an_edge(h, 0.5, 1.0)),
        slope(&|h| under_an_edge(0.0, 0.5 + h, 1.0)),
        slope(&|h| under_an_edge(0.0, 0.5, 1.0 + h)),
    ];
    let all = derivatives(&text, &["x", "r", "b"], &["all"], 1 << 17);
    for (name, (d, truth)) in ["the ball's place", "its radius", "the edge"].iter().zip(all.iter().zip(truths)) {
        check(name, d, unit * truth, 0.02);
    }
    let none = &derivatives(&text, &["b"], &["interior"], 1 << 10)[0];
    assert!(none.value[0] == 0.0, "without shadows: {none:?}");
}

const FLOOR: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="20"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.3, 0.25, 0.2"/></bsdf></shape>"#;
const SPOT: &str = r#"<emitter type="spot"><transform name="to_world"><lookat origin="-1.2, -0.8, 2.2" target="0.2, 0.1, 0.4" up="0, 1, 0"/><translate x="$x"/></transform>
  <rgb name="intensity" value="12, 11, 10"/><float name="cutoff_angle" value="35"/><float name="beam_width" value="10"/></emitter>"#;

/// One pixel of the floor beside the ball, and some of that.
fn beside_a_ball(more: &str) -> String {
    let used = [("x", "0"), ("b", "0.1"), ("r", "0.5"), ("k", "3"), ("cam", "0"), ("o", "0.9")];
    let names = used.iter().filter(|n| format!("{more}$x$b$r$k$cam").contains(&format!("${}", n.0)));
    let defaults: String = names.map(|(n, v)| format!(r#"<default name="{n}" value="{v}"/>"#)).collect();
    format!(
        r#"<scene version="3.0.0">{defaults}<integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
  <sensor type="perspective"><float name="fov" value="26"/><transform name="to_world"><lookat origin="0.4, -4.2, 2.4" target="0.5, 0.2, 0.3" up="0, 0, 1"/><translate x="$cam"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="haze"><float name="sigma_t" value="0.2"/><float name="albedo" value="0.8"/></medium>
  {FLOOR}<shape type="sphere" id="ball"><point name="center" value="$b, 0, 0.7"/><float name="radius" value="$r"/><bsdf type="conductor"><rgb name="eta" value="0.2, 0.9, 1.1"/><rgb name="k" value="$k, 2.5, 2.2"/></bsdf></shape>
  {more}</scene>"#
    )
}

/// A bar in the light that the ball mirrors.
const BAR: &str = r#"<shape type="cube"><transform name="to_world"><scale x="0.08" y="0.3" z="0.2"/><rotate z="1" angle="25"/><translate x="$o" y="0.1" z="0.5"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>"#;

#[test]
fn a_spot_on_a_ball_beside_a_bar_against_differences() {
    let text = beside_a_ball(&format!("{SPOT}{BAR}"));
    let place = [("x", 0.02), ("b", 0.02), ("r", 0.01), ("k", 0.1), ("cam", 0.02), ("o", 0.02)];
    against_differences(&text, &place, &["all"], 1 << 15, 0.01);
}

/// By what light that comes by the ball's outline scores, cones around that have a second moment ([`tyndall::scene::critical`]).
#[test]
fn outlines_are_looked_beside() {
    let text = beside_a_ball(SPOT).replace(r#"value="0.3, 0.25, 0.2""#, r#"value="0.8""#);
    let (desc, mut sc) = scene(&text);
    let p = params(&desc, &sc, &["cam"]);
    let terms = Terms::parse(&["interior".to_string()]).unwrap();
    let error = |sc: &Scene| {
        let job = Job { terms: terms.clone(), ..job(sc, 1 << 16, 3, Mode::Forward(&p)) };
        estimate(&job.run(&|_| {}).unwrap(), 1).error[0]
    };
    let with = error(&sc);
    sc.critical = Critical::default();
    let without = error(&sc);
    println!("{with} {without}");
    assert!(without > 1.5 * with, "{with} {without}");
}

#[test]
fn a_sun_on_a_ball_against_differences() {
    let sun = r#"<emitter type="directional"><vector name="direction" value="$x, 0.3, -1"/><rgb name="irradiance" value="3, 2.5, 2"/></emitter>"#;
    let text = beside_a_ball(sun).replace(r#"value="0.3, 0.25, 0.2""#, r#"value="0.03""#);
    against_differences(&text, &[("x", 0.06), ("b", 0.02), ("r", 0.01), ("cam", 0.02)], &["all"], 1 << 15, 0.01);
}

#[test]
fn a_spot_on_a_ball_in_haze_against_differences() {
    let haze = r#"<shape type="cube"><transform name="to_world"><scale x="2" y="2" z="0.85"/><translate z="0.9"/></transform><bsdf type="null"/><ref name="interior" id="haze"/></shape>"#;
    let text = beside_a_ball(&format!("{SPOT}{haze}")).replace(r#"value="0.3, 0.25, 0.2""#, r#"value="0.03""#);
    against_differences(&text, &[("x", 0.02), ("b", 0.02), ("r", 0.01), ("cam", 0.02)], &["all"], 1 << 14, 0.01);
}

/// Light by two of them, by one and a mirror, or within one, is not told.
#[test]
fn others_are_refused() {
    let refused = |more: &str, change: &dyn Fn(String) -> String| {
        let text = change(beside_a_ball(&format!("{SPOT}{more}")));
        let (desc, sc) = scene(&text);
        let names = ["b".to_string()];
        let planned = tyndall::render::plan::Plan::new(&desc, &names).and_then(|p| p.refuse());
        let p = sc.param_set(&desc, &names).unwrap();
        let ran = job(&sc, 4, 1, Mode::Forward(&p)).run(&|_| {});
        let told = planned.err().or(ran.err()).map(|e| e.to_string()).unwrap_or_default();
        assert!(told.contains("ball"), "{told}");
    };
    let same = |t: String| t;
    refused(r#"<shape type="sphere"><point name="center" value="3, 0, 1"/><bsdf type="conductor"/></shape>"#, &same);
    refused(
        r#"<shape type="rectangle"><transform name="to_world"><translate x="3" z="2"/></transform><bsdf type="conductor"/></shape>"#,
        &same,
    );
    refused("", &|t| t.replace(r#"origin="-1.2, -0.8, 2.2""#, r#"origin="0.1, 0, 0.8""#));
    refused("", &|t| t.replace(r#"id="ball">"#, r#"id="ball"><boolean name="flip_normals" value="true"/>"#));
}
