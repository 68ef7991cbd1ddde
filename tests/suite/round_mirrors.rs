//! Round mirrors (disks of metal) in light without extent and in beams: their rims end the light that they send on, and what passes them (`term::cast_border`).

use crate::common::{against_differences, check, derivatives, forward_of, job, scene};
use std::f64::consts::PI;
use tyndall::render::driver::Mode;
use tyndall::scene::compile::Orders;

/// A light from the right, slanting down to a mirror that stands upright, which sends it on to a wide floor: a square of that is seen around (x, y).
fn upright([x, y]: [f64; 2], light: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="r" value="0.4"/><default name="y" value="0"/><default name="turn" value="0"/>
  <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><lookat origin="{x}, {y}, 4" target="{x}, {y}, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="2"/><integer name="height" value="2"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><scale value="50"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape>
  <shape type="disk" id="mirror"><transform name="to_world"><scale value="$r"/><rotate y="1" angle="90"/><rotate y="1" angle="$turn"/><translate x="-3" y="$y" z="2"/></transform>
    <bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>
  {light}</scene>"#
    )
}

/// Irradiance of the light, and cosine and sine of its angle to the horizontal.
const E: f64 = 4.0;
const COS: f64 = 0.8;
const SIN: f64 = 0.6;
const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="-0.8, 0, -0.6"/><rgb name="irradiance" value="4"/></emitter>"#;
/// Wider than the mirror; what passes it falls on the floor out of sight.
const BEAM: &str = r#"<emitter type="collimated"><transform name="to_world"><lookat origin="1, 0, 5" target="-3, 0, 2" up="0, 1, 0"/></transform>
    <float name="radius" value="0.7"/><string name="profile" value="hard"/><float name="irradiance" value="4"/></emitter>"#;

/// The film's mean grows by `ρ/π` of the flux into the square, over its area. The mirror sends on `E cos π r²`, all of it into the square; its shadow is elsewhere.
#[test]
fn what_a_round_mirror_sends_on() {
    // From (-3, 2) down to the floor: by 0.75 of the way along x.
    let middle = [-3.0 + 2.0 * COS / SIN, 0.0];
    let truth = 0.5 / PI * E * COS * 2.0 * PI * 0.4 / 4.0;
    for (name, light) in [("a sun", SUN), ("a beam", BEAM)] {
        let text = upright(middle, light);
        let [all] = &derivatives(&text, &["r"], &["all"], 1 << 14)[..] else { panic!() };
        check(&format!("the radius in {name}"), all, truth, 0.01);
        let none = &derivatives(&text, &["r"], &["interior"], 1 << 8)[0];
        assert!(none.value[0].abs() < 1e-12, "without the rim: {none:?}");
    }
}

/// The square's edge halves the spot, which is lit by `E sin`. As the mirror's place moves the spot across the edge, light changes by the spot's chord; its turn moves the spot along x, by twice its angle.
#[test]
fn where_it_sends_it() {
    let x = -3.0 + 2.0 * COS / SIN;
    let unit = 0.5 / PI * E / 4.0;
    let chord = 2.0 * 0.4 * COS / SIN;
    let across = upright([x, 1.0], SUN);
    check("its place", &derivatives(&across, &["y"], &["all"], 1 << 14)[0], unit * SIN * chord, 0.01);
    // The flux into the square over E, by the turn.
    let along = upright([x + 1.0, 0.0], SUN);
    let lit = |turn: f64| {
        let (sin, cos) = (turn.to_radians().sin(), turn.to_radians().cos());
        let n = [cos, -sin];
        let c = COS * n[0] + SIN * n[1];
        // The sun's direction mirrored: d + 2 c n with d = (-cos, -sin).
        let d = [-COS + 2.0 * c * n[0], -SIN + 2.0 * c * n[1]];
        // Where light from the mirror's height v (along t, in the plane of x and z) lands.
        let t = [sin, cos];
        let lands = |v: f64| -3.0 + t[0] * v - (2.0 + t[1] * v) * d[0] / d[1];
        // The height whose light lands on the square's edge, by halving; what is above lands beyond.
        let (mut a, mut b) = (-0.4, 0.4);
        for _ in 0..60 {
            let m = 0.5 * (a + b);
            if lands(m) > x { b = m } else { a = m }
        }
        // What of the disk is above that.
        c * (0.16 * (PI / 2.0 - (a / 0.4).asin()) - a * (0.16 - a * a).sqrt())
    };
    let h = 1e-3;
    let truth = unit * (lit(h) - lit(-h)) / (2.0 * h);
    check("its turn", &derivatives(&along, &["turn"], &["all"], 1 << 15)[0], truth, 0.01);
}

/// In haze, beside a bar, by what moves.
#[test]
fn a_spot_on_a_round_mirror_against_differences() {
    let text = r#"<scene version="3.0.0"><default name="x" value="0"/><default name="r" value="0.5"/><default name="turn" value="50"/><default name="o" value="0.2"/><default name="cam" value="0"/>
  <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
  <sensor type="perspective"><float name="fov" value="30"/><transform name="to_world"><lookat origin="0.5, -5, 2.5" target="0.3, 0.2, 0.4" up="0, 0, 1"/><translate x="$cam"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="haze"><float name="sigma_t" value="0.2"/><float name="albedo" value="0.8"/></medium>
  <shape type="rectangle"><transform name="to_world"><scale value="20"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf></shape>
  <shape type="disk" id="mirror"><transform name="to_world"><scale x="$r" y="0.4"/><rotate y="1" angle="$turn"/><translate x="-1" z="1"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale x="0.08" y="0.3" z="0.1"/><rotate z="1" angle="25"/><translate x="$o" z="0.6"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale x="2.2" y="2" z="0.85"/><translate z="0.9"/></transform><bsdf type="null"/><ref name="interior" id="haze"/></shape>
  <emitter type="spot"><transform name="to_world"><lookat origin="0.6, -0.3, 2.4" target="-1, 0, 1" up="0, 1, 0"/><translate x="$x"/></transform>
    <rgb name="intensity" value="12"/><float name="cutoff_angle" value="30"/><float name="beam_width" value="10"/></emitter></scene>"#;
    let moves = [("x", 0.02), ("r", 0.02), ("turn", 1.0), ("o", 0.02), ("cam", 0.02)];
    against_differences(text, &moves, &["all"], 1 << 14, 0.01);
}

/// A beam that holds all of a block of fog, sent straight back by a mirror in it: light that scatters on a line across has gone `1 + x - 2m` through the fog (x: the line, m: the mirror). All of it aslant to the axes, so that rounding has its say.
#[test]
fn a_beam_sent_through_fog() {
    let aslant = r#"<rotate y="1" angle="37"/><rotate z="1" angle="20"/><translate x="0.3" y="0.7" z="-0.2"/>"#;
    let text = format!(
        r#"<scene version="3.0.0"><default name="m" value="-0.5"/><integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><scale value="0.01"/><lookat origin="0.5, -5, 0" target="0.5, 0, 0" up="0, 0, 1"/>{aslant}</transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.4"/><float name="albedo" value="0.001"/></medium>
  <shape type="cube"><transform name="to_world">{aslant}</transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="disk"><transform name="to_world"><scale value="1.6"/><rotate y="1" angle="90"/><translate x="$m"/>{aslant}</transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
  <emitter type="collimated"><transform name="to_world"><lookat origin="4, 0, 0" target="0, 0, 0" up="0, 1, 0"/>{aslant}</transform>
    <float name="radius" value="3"/><string name="profile" value="hard"/><float name="irradiance" value="4000"/></emitter></scene>"#
    );
    let [light, d] = forward_of(&text, Orders { first: 2, last: 2 }, &["m"], &["all"], 1 << 12)[..] else { panic!() };
    // Light that scatters twice is of that order, too: a thousandth.
    check("the mirror's place", &d, 2.0 * 0.4 * light.value[0], 0.01);
}

/// An opaque tube behind it that ends in its rim, whichever of the two comes first: the rim is one border.
#[test]
fn a_mirror_that_closes_a_tube() {
    let tube = r#"<shape type="cylinder" id="tube"><point name="p0" value="-3.5, 0, 2"/><point name="p1" value="-3, 0, 2"/><float name="radius" value="$r"/><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>"#;
    let text = upright([-3.0 + 2.0 * COS / SIN, 0.0], SUN);
    let truth = 0.5 / PI * E * COS * 2.0 * PI * 0.4 / 4.0;
    for (name, text) in [
        ("the tube behind the mirror in the file", text.replacen("<emitter", &format!("{tube}<emitter"), 1)),
        ("the tube before it", text.replacen(r#"<shape type="disk""#, &format!(r#"{tube}<shape type="disk""#), 1)),
    ] {
        check(name, &derivatives(&text, &["r"], &["all"], 1 << 12)[0], truth, 0.01);
    }
}

fn refusal(text: &str, name: &str) -> String {
    let (desc, sc) = scene(text);
    let names = [name.to_string()];
    let planned = tyndall::render::plan::Plan::new(&desc, &names).and_then(|p| p.refuse());
    let p = sc.param_set(&desc, &names).unwrap();
    let ran = job(&sc, 4, 1, Mode::Forward(&p)).run(&|_| {});
    planned.err().or(ran.err()).map(|e| e.to_string()).unwrap_or_default()
}

/// Two in one plane, apart; a beam that falls within the border of one of glass, but not the square around it within that.
#[test]
fn what_is_apart_or_within_is_taken() {
    let second = r#"<shape type="disk"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="90"/><translate x="-3" y="1" z="2"/></transform><bsdf type="conductor"/></shape>"#;
    assert_eq!(refusal(&upright([0.0, 0.0], &format!("{second}{SUN}")), "r"), "");
    let window = r#"<shape type="disk" id="window"><transform name="to_world"><scale value="0.8"/><rotate y="1" angle="53.13"/><translate x="-1" z="3.5"/></transform><bsdf type="dielectric"/></shape>"#;
    let within = |radius: &str| {
        let (_, sc) = scene(
            &upright([0.0, 0.0], &format!("{window}{}", BEAM.replace("0.7", radius)))
                .replace(r#"value="0.4""#, r#"value="3""#),
        );
        sc.beams.parted.iter().any(|p| sc.shapes[p.1 as usize].name == "window")
    };
    assert!(!within("0.78") && within("0.82"));
}

/// Rods beside it are not told, and are what is named.
#[test]
fn it_is_not_what_is_refused() {
    let rod = r#"<shape type="cylinder" id="rod"><point name="p0" value="2, 3, 0.5"/><point name="p1" value="3, 3, 0.5"/><float name="radius" value="0.2"/><bsdf type="conductor"/></shape>"#;
    let text = upright([0.0, 0.0], &format!("{rod}{SUN}"));
    let told = refusal(&text, "r");
    assert!(told.contains("rod"), "{told}");
    // A plate just behind it: their shadows have edges that nearly lie on each other.
    let plate = r#"<shape type="disk" id="plate"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="90"/><translate x="-3.0002" y="$y" z="2"/></transform></shape>"#;
    let told = refusal(&upright([0.0, 0.0], &format!("{plate}{SUN}")), "y");
    assert!(told.contains("`mirror` and `plate` lie on each other"), "{told}");
}
