//! Collimated beams by way of glass and mirrors, where something opaque stands in them or a border parts them: what they light in media and on surfaces (`term::cast` for beams).

use crate::common::{Estimate, against_differences, check, forward_of, job, params, scene};
use std::f64::consts::PI;
use tyndall::math::fresnel::Interface;
use tyndall::render::driver::Mode;
use tyndall::scene::compile::Orders;

/// A beam through a block onto a plane that an orthographic camera sees whole, from above and beside the block; `more` stands in it.
fn through_a_block(more: &str) -> String {
    let used = [("n", "1.5"), ("r", "0.2"), ("s", "0.05")]
        .into_iter()
        .filter(|u| (more.to_string() + "$n$r").contains(&format!("${}", u.0)));
    let defaults: String = used.map(|(k, v)| format!(r#"<default name="{k}" value="{v}"/>"#)).collect();
    format!(
        r#"<scene version="3.0.0">{defaults}<integrator type="volpath"><integer name="max_depth" value="8"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><scale x="1" y="1"/><lookat origin="0.2, 9, 0" target="0.2, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="3"/><integer name="height" value="3"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="6"/><rotate x="1" angle="-90"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale x="0.8" y="0.4" z="0.5"/><translate x="2.6" y="3.4"/></transform><bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf></shape>
  {more}
  <emitter type="collimated"><transform name="to_world"><lookat origin="4.5, 6, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <float name="radius" value="$r"/><string name="profile" value="hard"/><float name="irradiance" value="10"/></emitter></scene>"#
    )
}

/// A black half-plane across the beam, its edge at `s` from the axis, or turned: what is more than -s along (0.8, -0.6), toward which the block displaces the beam.
fn half_plane(x: f64, y: f64, turned: bool) -> String {
    let turn = if turned { 90 } else { 0 };
    format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="0.3"/><translate y="-0.3"/><translate y="$s"/><rotate z="1" angle="{turn}"/><rotate x="1" angle="90"/><rotate z="1" angle="-36.86989764584402"/><translate x="{x}" y="{y}"/></transform>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>"#
    )
}

/// What passes both faces, and by how much they displace the beam across its axis, by the index: the angle of incidence has a sine of 0.6, the block a thickness of 0.8.
fn block(n: f64) -> [f64; 2] {
    let t = 1.0 - Interface::new(0.8, 1.0, n).reflectance();
    let tan = 0.6 / (n * n - 0.36).sqrt();
    [t * t, 0.8 * (0.75 - tan) * 0.8]
}

fn slope(f: impl Fn(f64) -> f64, x: f64) -> f64 {
    let h = 1e-5;
    (f(x + h) - f(x - h)) / (2.0 * h)
}

fn red(text: &str, name: &str, terms: &str, spp: u64) -> Estimate {
    // Both faces, and the plane.
    forward_of(text, Orders { first: 3, last: 3 }, &[name], &[terms], spp)[1]
}

/// Of the plane's light the film's mean is `ρ E T A / (π a)`: A the lit area across the beam, a the film's.
#[test]
fn a_spot_behind_a_block() {
    let unit = 0.6 * 10.0 / (PI * 4.0);
    let text = through_a_block("");
    let [t, _] = block(1.5);
    check("the spot's radius", &red(&text, "r", "all", 1 << 13), unit * t * 2.0 * PI * 0.2, 0.01);
    let none = red(&text, "r", "interior", 1 << 8);
    assert!(none.value[0] == 0.0, "without its border: {none:?}");
    // It moves as a whole: its borders cancel.
    let by_index = slope(|n| block(n)[0], 1.5) * unit * PI * 0.04;
    check("the index", &red(&text, "n", "all", 1 << 14), by_index, 0.02);
}

/// The lit part of a disk of radius r on one side of a chord at s from its middle.
fn segment(r: f64, s: f64) -> f64 {
    r * r * (s / r).acos() - s * (r * r - s * s).sqrt()
}

#[test]
fn a_shadow_through_a_block() {
    let unit = 0.6 * 10.0 / (PI * 4.0);
    let chord = 2.0 * (0.04f64 - 0.0025).sqrt();
    let [t, _] = block(1.5);
    // Before the block and behind it.
    for (x, y) in [(3.6, 4.8), (1.5 + 0.25, 2.0)] {
        let text = through_a_block(&half_plane(x, y, false));
        check("a half-plane's place", &red(&text, "s", "all", 1 << 13), -unit * t * chord, 0.02);
        let none = red(&text, "s", "interior", 1 << 8);
        assert!(none.value[0] == 0.0, "without its shadow: {none:?}");
    }
    // Turned, the edge stands across the displacement.
    let s = -0.15;
    let turned = half_plane(1.5, 2.0, true).replace("$s", &s.to_string());
    let lit = |n: f64| {
        let [t, by] = block(n);
        t * segment(0.2, s + by)
    };
    let text = through_a_block(&turned);
    check("the index", &red(&text, "n", "all", 1 << 13), unit * slope(lit, 1.5), 0.02);
}

/// Past an edge at s from its axis a Gaussian beam, narrow in its scene, loses `∫ e^(-2 (s² + t²)/r²) dt = r √(π/2) e^(-2 s²/r²)`.
#[test]
fn a_shadow_in_a_narrow_gaussian_beam() {
    let (r, s) = (0.002f64, 0.001f64);
    let text = through_a_block(&half_plane(3.6, 4.8, false)).replace(r#"value="hard""#, r#"value="gaussian""#);
    let text = text.replace(r#"name="r" value="0.2""#, &format!(r#"name="r" value="{r}""#));
    let text = text.replace(r#"name="s" value="0.05""#, &format!(r#"name="s" value="{s}""#));
    let unit = 0.6 * 10.0 / (PI * 4.0);
    let left = r * (0.5 * PI).sqrt() * (-2.0 * s * s / (r * r)).exp();
    check("a half-plane's place", &red(&text, "s", "all", 1 << 13), -unit * block(1.5)[0] * left, 0.01);
}

/// A beam straight down into fog, `more` above that; one scattering, over the fog's depth and the chord at z = 0.1, which is 0.9 from where the camera looks in, by that place.
fn into_fog(depth: i32, more: &str) -> (String, f64) {
    let text = format!(
        r#"<scene version="3.0.0"><default name="s" value="0.1"/><integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.8"/><float name="albedo" value="0.5"/></medium>
  <sensor type="orthographic"><transform name="to_world"><scale x="1.5" y="1.5"/><lookat origin="0, 0, 6" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="3"/><integer name="height" value="3"/><rfilter type="box"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>{more}
  <emitter type="collimated"><transform name="to_world"><rotate x="1" angle="90"/><translate y="3"/></transform>
    <float name="radius" value="0.3"/><string name="profile" value="hard"/><float name="irradiance" value="10"/></emitter></scene>"#
    );
    let (sigma, half): (f64, f64) = (0.8, (0.09f64 - 0.01).sqrt());
    let ways = (1.0 - (-2.0 * sigma).exp()) / sigma * (-0.9 * sigma).exp() * 2.0 * half;
    (text, -0.4 * 10.0 / (4.0 * PI) / 9.0 * ways)
}

#[test]
fn a_shadow_in_fog_behind_a_block() {
    let plate = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.8"/><rotate x="1" angle="90"/><translate z="-0.8"/><translate y="2.2" z="$s"/></transform>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>
      <shape type="cube"><transform name="to_world"><scale x="0.9" y="0.2" z="0.9"/><translate y="1.8"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>"#;
    let (text, shade) = into_fog(-1, plate);
    let through = Orders { first: 3, last: 3 };
    let d = forward_of(&text, through, &["s"], &["all"], 1 << 14)[1];
    check("the plate's place", &d, shade * 0.96 * 0.96, 0.01);
    let none = forward_of(&text, through, &["s"], &["interior", "hard_profile", "medium_edge"], 1 << 8)[1];
    assert!(none.value[0] == 0.0, "without its shadow: {none:?}");
}

/// What a block lets through has scattered too often to count, but its shadow does.
#[test]
fn a_block_parts_a_beam_that_scatters_once() {
    let block = r#"<shape type="cube"><transform name="to_world"><scale x="0.9" y="0.2" z="0.8"/><translate z="-0.8"/><translate y="1.8" z="$s"/></transform><bsdf type="dielectric"/></shape>"#;
    let (text, shade) = into_fog(2, block);
    let once = Orders { first: 1, last: 1 };
    check("the block's place", &forward_of(&text, once, &["s"], &["all"], 1 << 14)[1], shade, 0.01);
}

/// Beside glass the disk at which a beam begins may not lie in a medium, not even a part of it.
#[test]
fn half_of_a_disk_in_fog_is_refused() {
    let block = r#"<shape type="cube"><transform name="to_world"><scale value="0.2"/><translate x="$s" y="-2"/></transform><bsdf type="dielectric"/></shape>"#;
    let text = into_fog(4, block).0.replace(
        r#"<rotate x="1" angle="90"/><translate y="3"/>"#,
        r#"<rotate x="1" angle="90"/><translate x="1.1" y="0.5"/>"#,
    );
    let (desc, sc) = scene(&text);
    let p = params(&desc, &sc, &["s"]);
    let error = job(&sc, 4, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(error.contains("begins inside a medium"), "{error}");
}

/// A mirror that is smaller than the beam, a block, and a ball before both, over a floor, in fog or none.
fn room(fog: bool, profile: &str) -> String {
    let (medium, around) = match fog {
        true => (
            r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.5,0.7,0.35"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>"#,
            r#"<shape type="cube"><transform name="to_world"><scale value="2.4"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#,
        ),
        false => ("", ""),
    };
    let names = [
        ("n", 1.5),
        ("h", 0.0),
        ("tilt", 0.0),
        ("x", 0.05),
        ("bx", 0.0),
        ("turn", 0.0),
        ("r", 0.2),
        ("cam", 0.5),
        ("size", 0.15),
    ];
    let defaults: String = names.map(|(k, v)| format!(r#"<default name="{k}" value="{v}"/>"#)).concat();
    format!(
        r#"<scene version="3.0.0">{defaults}<integrator type="volpath"><integer name="max_depth" value="5"/></integrator>{medium}
  <sensor type="perspective"><float name="fov" value="36"/><transform name="to_world"><lookat origin="$cam, 2, 4.6" target="0, -0.5, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
  {around}<shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-1"/></transform><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.4,0.2"/></bsdf></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><scale x="$size" y="0.22"/><rotate y="1" angle="90"/><rotate z="1" angle="-20"/><rotate z="1" angle="$tilt"/><translate x="-0.6" y="0.1"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale x="0.4" y="0.15" z="0.45"/><rotate y="1" angle="25"/><translate x="-0.25" y="-0.6"/><translate y="$h"/></transform><bsdf type="dielectric"><float name="int_ior" value="$n"/></bsdf></shape>
  <shape type="sphere"><point name="center" value="$x, 0.45, 0.1"/><float name="radius" value="0.12"/><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>
  <emitter type="collimated"><transform name="to_world"><lookat origin="4.2, 2.7, 0.1" target="-0.6, 0.1, 0" up="0, 1, 0"/><rotate z="1" angle="$turn"/><translate x="$bx"/></transform>
    <float name="radius" value="$r"/><string name="profile" value="{profile}"/><float name="irradiance" value="10"/></emitter></scene>"#
    )
}

#[test]
fn a_mirror_and_a_block_against_differences() {
    let what =
        [("n", 0.02), ("h", 0.02), ("tilt", 1.0), ("x", 0.03), ("bx", 0.03), ("turn", 1.0), ("r", 0.02), ("cam", 0.05)];
    against_differences(&room(false, "hard"), &what, &["all"], 1 << 14, 0.02);
    // Few samples meet what the mirror's border leaves.
    against_differences(&room(false, "hard"), &[("size", 0.02)], &["all"], 1 << 17, 0.02);
    // Differences by the height meet what moves past the pixel's border too seldom.
    let smooth = [("n", 0.05), ("tilt", 1.0), ("x", 0.03), ("bx", 0.03), ("r", 0.02)];
    against_differences(&room(false, "gaussian"), &smooth, &["all"], 1 << 13, 0.02);
}

#[test]
fn in_fog_against_differences() {
    let what = [("n", 0.03), ("tilt", 2.0), ("x", 0.05), ("r", 0.03)];
    against_differences(&room(true, "hard"), &what, &["all"], 1 << 12, 0.02);
}
