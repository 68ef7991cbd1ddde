//! Where light of lights without extent that comes by way of flat glass and mirrors ends on surfaces (`term::cast_trace`), against differences.

use crate::common::*;

const LAMP: &str = r#"<emitter type="point"><point name="position" value="$x, -0.4, 2.2"/><rgb name="intensity" value="10, 9, 8"/></emitter>"#;
const SPOT: &str = r#"<emitter type="spot"><transform name="to_world"><lookat origin="0, -0.4, 2.2" target="0.2, 0, 0" up="0, 1, 0"/><translate x="$x"/></transform>
  <rgb name="intensity" value="10, 9, 8"/><float name="cutoff_angle" value="40"/><float name="beam_width" value="5"/></emitter>"#;
const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="$x, 0.25, -1"/><rgb name="irradiance" value="3, 2.5, 2"/></emitter>"#;
const FLOOR: &str = r#"<shape type="rectangle" id="floor"><transform name="to_world"><scale value="2"/><rotate y="1" angle="$slope"/><translate z="$floor"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf></shape>"#;
const NAMES: [(&str, f64); 9] = [
    ("n", 1.5),
    ("h", 0.0),
    ("tilt", 4.0),
    ("x", 0.45),
    ("cam", 0.3),
    ("floor", -1.0),
    ("slope", 3.0),
    ("bar", -0.3),
    ("r", 0.25),
];

/// The floor beside the block, and through it.
const ALL: [&str; 2] = [r#"origin="1.2, -5, 2.4" target="0.1, -0.1, -0.6" up="0, 0, 1""#, "22"];
const NEAR: [&str; 2] = [r#"origin="0.6, -1.8, 4" target="-0.118, -0.809, 0.159" up="0, 1, 0""#, "5"];

/// One pixel.
fn scene_of([eye, fov]: [&str; 2], depth: u32, bodies: &str, light: &str) -> String {
    let text = format!("{bodies}{light}$cam");
    let used = NAMES.iter().filter(|n| text.contains(&format!("${}", n.0)));
    let defaults: String = used.map(|(n, v)| format!(r#"<default name="{n}" value="{v}"/>"#)).collect();
    format!(
        r#"<scene version="3.0.0">{defaults}<integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>
  <sensor type="perspective"><float name="fov" value="{fov}"/><transform name="to_world"><lookat {eye}/><translate x="$cam"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.2"/></phase></medium>
  <medium type="homogeneous" id="haze"><float name="sigma_t" value="0.25"/><float name="albedo" value="0.9"/></medium>
  {bodies}{light}</scene>"#
    )
}

/// A block that moves; its inside and outside.
fn block(media: &str) -> String {
    format!(
        r#"<shape type="cube" id="block"><transform name="to_world"><scale x="0.6" y="0.5" z="0.4"/><rotate z="1" angle="20"/><rotate y="1" angle="$tilt"/><translate z="$h"/></transform><bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf>{media}</shape>"#
    )
}

/// Derivatives against differences; of `jumps` some is light that ends on surfaces.
fn compare(text: &str, wrt: &[(&str, f64)], jumps: &[&str], spp: u64) {
    for (part, name) in derivatives(text, jumps, &["light_shadow"], spp).iter().zip(jumps) {
        println!("{name}: {} +- {}", part.value[0], part.error[0]);
        assert!(part.value[0].abs() > 4.0 * part.error[0], "{name}: {part:?}");
    }
    against_differences(text, wrt, &["all"], spp, 0.01);
}

#[test]
fn floor_under_a_block_against_differences() {
    let bodies = format!("{}{FLOOR}", block(""));
    let place = [("n", 0.01), ("x", 0.1), ("h", 0.02), ("tilt", 1.0), ("floor", 0.05), ("slope", 1.0), ("cam", 0.03)];
    compare(&scene_of(ALL, 4, &bodies, LAMP), &place, &["n", "x", "h", "tilt"], 1 << 14);
    compare(&scene_of(ALL, 4, &bodies, SUN), &place[..1], &["n"], 1 << 14);
}

#[test]
#[ignore = "make stress"]
fn floor_under_a_block_in_other_light_against_differences() {
    let bodies = format!("{}{FLOOR}", block(""));
    compare(&scene_of(ALL, 4, &bodies, SPOT), &[("n", 0.01), ("x", 0.1)], &["n", "x"], 1 << 14);
    compare(&scene_of(ALL, 4, &bodies, SUN), &[("x", 0.1)], &["x"], 1 << 14);
    // Twice through the block.
    compare(&scene_of(NEAR, 6, &bodies, LAMP), &[("n", 0.01), ("x", 0.02), ("h", 0.005)], &["n"], 1 << 15);
}

/// A bar, whose shadow falls through the block, and moves with it.
#[test]
fn bar_over_a_block_against_differences() {
    let bar = r#"<shape type="cube"><transform name="to_world"><scale x="0.12" y="0.8" z="0.06"/><rotate z="1" angle="-30"/><translate x="$bar" z="1"/></transform><bsdf type="diffuse"/></shape>"#;
    let text = scene_of(ALL, 4, &format!("{}{FLOOR}{bar}", block("")), LAMP);
    compare(&text, &[("n", 0.01), ("x", 0.1), ("bar", 0.05), ("floor", 0.05)], &["x", "bar"], 1 << 15);
}

/// A ball's shadow beside the block and through it, and that of a ball in the block, on the floor and on the balls.
#[test]
fn balls_above_and_in_a_block_against_differences() {
    let ball = |at: &str, radius: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" value="{at}"/><float name="radius" value="{radius}"/><bsdf type="diffuse"/></shape>"#
        )
    };
    let bodies = format!("{}{FLOOR}{}{}", block(""), ball("$bar, 0.1, 1", "$r"), ball("0.15, -0.05, 0", "0.2"));
    let place = [("n", 0.01), ("x", 0.1), ("h", 0.02), ("bar", 0.05), ("r", 0.02), ("floor", 0.05)];
    compare(&scene_of(ALL, 6, &bodies, LAMP), &place, &["n", "x", "bar", "r"], 1 << 14);
    compare(&scene_of(ALL, 6, &bodies, SUN), &[("n", 0.01), ("x", 0.1), ("r", 0.02)], &["n", "x", "r"], 1 << 14);
}

/// The same of a tube above with one lid, whose radius is also the tube's, and a plate in the block.
#[test]
fn round_things_above_and_in_a_block_against_differences() {
    let tube = r#"<shape type="cylinder"><point name="p0" value="$bar, 0, 0.7"/><point name="p1" value="$bar, 0.3, 1.2"/><float name="radius" value="$r"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#;
    let plate = r#"<shape type="disk"><transform name="to_world"><scale value="0.2"/><rotate x="1" angle="20"/><translate x="0.15" y="-0.05"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#;
    let lid = r#"<shape type="disk"><transform name="to_world"><scale value="$r"/><lookat origin="$bar, 0.3, 1.2" target="$bar, 0.6, 1.7" up="1, 0, 0"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#;
    let bodies = format!("{}{FLOOR}{tube}{lid}{plate}", block(""));
    let place = [("n", 0.01), ("x", 0.1), ("bar", 0.05), ("r", 0.02)];
    compare(&scene_of(ALL, 6, &bodies, LAMP), &place, &["n", "x", "bar", "r"], 1 << 14);
}

#[test]
fn fog_around_a_block_over_a_floor_against_differences() {
    let haze = r#"<shape type="cube"><transform name="to_world"><scale value="1.5"/><translate z="0.49"/></transform><bsdf type="null"/><ref name="interior" id="haze"/></shape>"#;
    let glass = block(r#"<ref name="interior" id="fog"/><ref name="exterior" id="haze"/>"#);
    let bodies = format!("{haze}{glass}{}", FLOOR.replace("$slope", "0"));
    let text = scene_of(ALL, 5, &bodies, &LAMP.replace("2.2", "2.6"));
    compare(&text, &[("n", 0.02), ("x", 0.1)], &["n", "x"], 1 << 14);
}

/// Light of the floor on a wall, and of the wall on the floor.
#[test]
#[ignore = "make stress"]
fn corner_beside_a_block_against_differences() {
    let wall = r#"<shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate x="1" angle="90"/><translate y="0.8"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>"#;
    let text = scene_of(ALL, 6, &format!("{}{FLOOR}{wall}", block("")), LAMP);
    compare(&text, &[("n", 0.02), ("x", 0.1), ("h", 0.05)], &["x"], 1 << 15);
}

#[test]
fn what_stands_in_a_block_against_differences() {
    let core = r#"<shape type="cube"><transform name="to_world"><scale x="0.2" y="0.15" z="0.1"/><rotate z="1" angle="-30"/><translate x="$bar"/></transform><bsdf type="diffuse"/></shape>"#;
    let text = scene_of(ALL, 6, &format!("{}{core}", block("")), LAMP);
    let jumps = ["n", "x", "h", "bar", "cam"];
    compare(&text, &[("n", 0.05), ("x", 0.1), ("h", 0.05), ("bar", 0.05), ("cam", 0.03)], &jumps, 1 << 14);
}

#[test]
fn mirror_over_a_floor_against_differences() {
    let mirror = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.7"/><rotate y="1" angle="60"/><rotate y="1" angle="$tilt"/><translate x="-1" z="$h"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>"#;
    let text = scene_of(ALL, 4, &format!("{mirror}{FLOOR}"), LAMP);
    let jumps = ["x", "h", "tilt", "cam"];
    compare(&text, &[("x", 0.05), ("h", 0.02), ("tilt", 0.5), ("cam", 0.03)], &jumps, 1 << 14);
    // The floor alone.
    compare(&text, &[("floor", 0.05)], &["floor"], 1 << 14);
    // A ball between both, in light that comes and in light that is mirrored.
    let ball = r#"<shape type="sphere"><point name="center" value="-0.35, -0.1, 0.1"/><float name="radius" value="$r"/></shape>"#;
    let text = scene_of(ALL, 4, &format!("{mirror}{FLOOR}{ball}"), LAMP);
    compare(&text, &[("h", 0.02), ("tilt", 0.5), ("r", 0.02)], &["h", "tilt", "r"], 1 << 14);
}
