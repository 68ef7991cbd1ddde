//! Shapes, lamps and cameras that move inside media, all scatterings up to four, against central differences of the pictures.

use crate::common::{difference, forward_of};
use tyndall::scene::compile::Orders;

/// Derivatives against central differences: 4.5 s.e. beside the 3 % that such steps leave (measured by halving them), both together known to a fifth of the largest channel.
fn agree(text: &str, wrt: &[(&str, f64)], spp: u64) {
    agree_of(text, Orders::default(), wrt, spp);
}

/// The same for chosen numbers of scatterings.
fn agree_of(text: &str, orders: Orders, wrt: &[(&str, f64)], spp: u64) {
    let mut wrong: Vec<String> = Vec::new();
    let names: Vec<&str> = wrt.iter().map(|w| w.0).collect();
    let ours = forward_of(text, orders, &names, &["all"], spp);
    for ((name, h), d) in wrt.iter().zip(&ours[1..]) {
        let fd = difference(text, orders, name, *h, spp);
        println!("{name}: {:?} +- {:?}, differences {:?} +- {:?}", d.value, d.error, fd.value, fd.error);
        let size = fd.value.abs().max();
        for c in 0..3 {
            let (off, se) = ((d.value[c] - fd.value[c]).abs(), fd.error[c].hypot(d.error[c]));
            if off > 4.5 * se + 0.03 * size {
                wrong.push(format!("{name} channel {c}: {} vs {} +- {se}", d.value[c], fd.value[c]));
            }
            if se > 0.2 * size {
                wrong.push(format!("{name} channel {c}: standard error {se} of {size}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Fog around a floor, a ball, a turned block, a mesh, a panel, and a disk that stands still between them and the light.
fn room(medium: &str, light: &str, sensor: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <default name="x" value="0.5"/><default name="y" value="0.6"/><default name="z" value="0.2"/><default name="r" value="0.35"/>
  <default name="bx" value="-0.6"/><default name="turn" value="20"/><default name="size" value="0.25"/><default name="mesh" value="0.1"/><default name="grow" value="0.3"/>
  <default name="px" value="-0.1"/><default name="tilt" value="40"/><default name="floor" value="0"/>
  <default name="lx" value="0.3"/><default name="ly" value="2"/><default name="lz" value="0.1"/><default name="lamp" value="0.35"/><default name="swing" value="35"/>
  <default name="cx" value="0.2"/><default name="cz" value="4"/><default name="aim" value="0"/><default name="fov" value="9"/><default name="zoom" value="0.3"/>
  <integrator type="volpath"><integer name="max_depth" value="5"/></integrator>
  {medium}
  <shape type="cube"><transform name="to_world"><scale x="1.7" y="1.25" z="1.7"/><translate y="1.2"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2.5"/><translate y="$floor"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.5, 0.4"/></bsdf></shape>
  <shape type="sphere"><point name="center" value="$x, $y, $z"/><float name="radius" value="$r"/><bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.6, 0.7"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale value="$size"/><rotate y="1" angle="$turn"/><translate x="$bx" y="0.5" z="0.1"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.7, 0.3, 0.3"/></bsdf></shape>
  <shape type="obj"><string name="filename" value="tests/common/ball.obj"/><transform name="to_world"><scale x="$grow" y="0.3" z="0.25"/><rotate x="1" y="0.4" angle="25"/><translate x="$mesh" y="1.2" z="-0.4"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.25"/><rotate x="1" y="0.3" angle="$tilt"/><translate x="$px" y="0.5" z="0.8"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <shape type="disk"><transform name="to_world"><scale value="0.2"/><rotate x="1" angle="80"/><translate x="-0.25" y="1.4" z="0.3"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  {light}{sensor}</scene>"#
    )
}

const ISOTROPIC: &str = r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.4, 0.6, 0.2"/><float name="albedo" value="0.8"/></medium>"#;
const HG: &str = r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.4, 0.6, 0.2"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.5"/></phase></medium>"#;
/// The dust of scenes/spot_dust, which fades out before its box ends, over the whole room.
const DUST: &str = r#"<medium type="heterogeneous" id="fog"><volume name="sigma_t" type="gridvolume"><string name="filename" value="scenes/spot_dust/dust.vol"/>
    <transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale x="3.4" y="2.5" z="3.4"/><translate y="1.2"/></transform></volume>
    <float name="albedo" value="0.9"/><float name="scale" value="0.8"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>"#;

const LAMP: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="$lamp"/><rotate x="1" angle="90"/><rotate z="1" angle="$swing"/><translate x="$lx" y="$ly" z="$lz"/></transform>
    <emitter type="area"><rgb name="radiance" value="9, 8, 7"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf></shape>"#;
const POINT: &str = r#"<emitter type="point"><point name="position" value="$lx, $ly, $lz"/><rgb name="intensity" value="6, 5, 4"/></emitter>"#;
/// A hard edge, inside the fog and above the picture.
const SPOT: &str = r#"<emitter type="spot"><transform name="to_world"><rotate x="1" angle="90"/><rotate z="1" angle="$swing"/><translate x="$lx" y="$ly" z="$lz"/><translate y="0.7"/></transform>
    <float name="cutoff_angle" value="24"/><float name="beam_width" value="24"/><rgb name="intensity" value="24, 20, 16"/></emitter>"#;
const SKY: &str = r#"<emitter type="constant"><rgb name="radiance" value="1, 0.8, 0.7"/></emitter>"#;

/// One box pixel of half a unit around a point at the depth of the things: what moves crosses its border, so that the mean does not even it out.
fn at(x: f64, y: f64) -> String {
    format!(
        r#"<sensor type="perspective"><float name="fov" value="$fov"/>
    <transform name="to_world"><lookat origin="$cx, 1.3, $cz" target="{x}, {y}, 0.1" up="0, 1, 0"/><translate x="$aim"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>"#
    )
}

/// Four pixels of a Gaussian, without a vanishing point.
const ORTHOGRAPHIC: &str = r#"<sensor type="orthographic"><transform name="to_world"><scale x="$zoom" y="$zoom"/><lookat origin="$cx, 1.3, $cz" target="0.8, 0.5, 0" up="0, 1, 0"/><translate x="$aim"/></transform>
    <film type="hdrfilm"><integer name="width" value="2"/><integer name="height" value="2"/><rfilter type="gaussian"/></film></sensor>"#;
/// Inside the fog, close to its border.
const WITHIN: &str = r#"<sensor type="perspective"><float name="fov" value="20"/>
    <transform name="to_world"><lookat origin="$cx, 1.1, 1.6" target="0.85, 0.5, 0" up="0, 1, 0"/><translate x="$aim"/></transform><ref id="fog"/>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>"#;

const SPP: u64 = 1 << 16;

#[test]
fn a_ball_under_a_lamp() {
    agree(&room(HG, LAMP, &at(0.85, 0.4)), &[("x", 0.04), ("r", 0.03)], SPP);
}

#[test]
fn a_ball_under_a_point_light() {
    let what = [("x", 0.04), ("y", 0.04), ("z", 0.04)];
    agree(&room(ISOTROPIC, POINT, &at(0.85, 0.4)), &what, SPP);
}

/// Points of the fog follow it: its edge and what it lights, with the shadows of everything in the room.
#[test]
#[ignore = "make stress"]
fn a_hard_spot_inside_the_fog() {
    let wide = |medium| {
        room(medium, SPOT, &at(0.85, 0.4)).replace(r#"<scale x="1.7" y="1.25" z="1.7"/>"#, r#"<scale value="3.6"/>"#)
    };
    agree(&wide(HG), &[("lx", 0.05), ("swing", 3.0)], SPP);
    // What scatters once hides the rest.
    agree_of(&wide(ISOTROPIC), Orders { first: 2, last: 3 }, &[("lx", 0.05), ("ly", 0.05)], 2 * SPP);
}

/// Only its shadow, in the fog and on the floor.
#[test]
fn the_shadow_of_a_ball() {
    let what = [("x", 0.04), ("r", 0.03)];
    agree(&room(HG, LAMP, &at(0.95, 0.1)), &what, SPP);
    agree(&room(HG, POINT, &at(0.95, 0.1)), &what, SPP);
}

/// What scatters once hides the rest under a point light.
#[test]
fn light_that_scatters_twice_and_more() {
    let (orders, what) = (Orders { first: 2, last: 4 }, [("x", 0.04), ("r", 0.03)]);
    agree_of(&room(HG, POINT, &at(0.95, 0.1)), orders, &what, SPP);
    agree_of(&room(ISOTROPIC, LAMP, &at(0.85, 0.4)), orders, &[("r", 0.03)], SPP);
}

/// Past a low ball the camera sees the floor and the fog beside it, nearer than its radius: points of the ball keep to their direction from there, and the
/// glowing fog behind them goes along (else a few samples of 1/distance decide, without a variance).
#[test]
fn glowing_fog_between_a_floor_and_a_low_ball() {
    let text = r#"<scene version="3.0.0"><default name="x" value="0"/><default name="r" value="1"/><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.3"/><float name="albedo" value="ALBEDO"/><rgb name="emission" value="1"/></medium>
  <shape type="cube"><transform name="to_world"><scale value="6"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
  <shape type="sphere"><point name="center" value="$x, 1.1, 0"/><float name="radius" value="$r"/><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
  <sensor type="orthographic"><transform name="to_world"><scale value="0.2"/><lookat origin="0.5, 3, 4" target="0.5, 0, 0.9" up="0, 1, 0"/></transform><ref id="fog"/>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor></scene>"#;
    let twice = Orders { first: 2, last: 2 };
    agree_of(&text.replace("ALBEDO", "0"), twice, &[("x", 0.05), ("r", 0.02)], 8 * SPP);
    agree_of(&text.replace("ALBEDO", "0.8"), Orders { first: 2, last: 3 }, &[("x", 0.05), ("r", 0.02)], 4 * SPP);
}

#[test]
#[ignore = "make stress"]
fn a_block_under_a_lamp() {
    let text = room(ISOTROPIC, LAMP, &at(-0.25, 0.55));
    agree(&text, &[("bx", 0.04), ("turn", 2.0)], SPP);
    // The rest has rare large scores.
    agree_of(&text, Orders { first: 1, last: 2 }, &[("size", 0.015)], 2 * SPP);
}

#[test]
#[ignore = "make stress"]
fn a_mesh_under_a_point_light() {
    let text = room(HG, POINT, &at(0.35, 1.2));
    agree(&text, &[("mesh", 0.04), ("grow", 0.03)], SPP);
    // Its creases, and nothing of what scatters more and is noisy.
    agree_of(&text, Orders { first: 1, last: 1 }, &[("mesh", 0.04)], SPP);
}

#[test]
fn a_panel_and_a_floor_under_a_lamp() {
    let what = [("px", 0.04), ("tilt", 4.0), ("floor", 0.04)];
    agree(&room(HG, LAMP, &at(0.05, 0.3)), &what, SPP);
}

#[test]
fn shapes_under_the_sky() {
    let what = [("x", 0.04), ("r", 0.03), ("floor", 0.04)];
    agree(&room(HG, SKY, ORTHOGRAPHIC), &what, SPP / 4);
}

#[test]
#[ignore = "make stress"]
fn lamps_that_move_and_grow() {
    let what = [("lx", 0.04), ("ly", 0.04), ("lamp", 0.03), ("swing", 4.0)];
    agree(&room(HG, LAMP, &at(0.85, 0.4)), &what, 2 * SPP);
    // The lamp itself is seen.
    agree(&room(HG, LAMP, &at(0.6, 1.95)), &[("lx", 0.04)], SPP);
}

#[test]
#[ignore = "make stress"]
fn cameras_outside() {
    let what = [("cx", 0.04), ("aim", 0.04), ("fov", 0.2)];
    // The lamp's end is at the pixel's border: larger steps of fov are 20 % off.
    agree(&room(HG, LAMP, &at(0.35, 1.25)), &what, 5 * SPP);
    let what = [("aim", 0.04), ("zoom", 0.01)];
    agree(&room(ISOTROPIC, POINT, ORTHOGRAPHIC), &what, SPP / 4);
}

#[test]
fn cameras_inside() {
    let what = [("cx", 0.04), ("aim", 0.04), ("x", 0.04)];
    agree(&room(HG, POINT, WITHIN), &what, SPP);
}

#[test]
#[ignore = "make stress"]
fn everything_in_a_grid() {
    let what = [("x", 0.04), ("r", 0.03), ("lx", 0.04)];
    agree(&room(DUST, LAMP, &at(0.95, 0.2)), &what, SPP);
    // The rest has rare large scores.
    let what = [("mesh", 0.04), ("aim", 0.04)];
    agree_of(&room(DUST, POINT, &at(0.35, 1.25)), Orders { first: 1, last: 1 }, &what, SPP);
}

/// A block in a tank of dense water whose floor and walls are opaque and bound no medium, lit from within: lines past its edges end on walls, and only the front has an interface that tells their medium.
#[test]
fn a_tank_with_opaque_walls() {
    let wall = |turn: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world">{turn}</transform><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></bsdf></shape>"#
        )
    };
    let walls = [
        r#"<translate z="-1"/>"#,
        r#"<rotate y="1" angle="90"/><translate x="-1"/>"#,
        r#"<rotate y="1" angle="-90"/><translate x="1"/>"#,
        r#"<rotate x="1" angle="-90"/><translate y="-1"/>"#,
        r#"<rotate x="1" angle="90"/><translate y="1"/>"#,
    ]
    .map(wall)
    .concat();
    let lamp = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.2"/><rotate y="1" angle="90"/><translate x="-0.8"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf>
      <emitter type="area"><rgb name="radiance" value="20"/></emitter></shape>"#;
    let point = r#"<emitter type="point"><point name="position" value="-0.8, 0, 0"/><rgb name="intensity" value="3"/><ref id="water"/></emitter>"#;
    for light in [lamp, point] {
        let text = format!(
            r#"<scene version="3.0.0"><default name="size" value="0.3"/><integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
  <medium type="homogeneous" id="water"><rgb name="sigma_t" value="1.2,0.9,0.6"/><float name="albedo" value="0.2"/></medium>{walls}{light}
  <shape type="rectangle"><transform name="to_world"><translate z="1"/></transform><bsdf type="null"/><ref name="interior" id="water"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="$size"/><rotate y="1" angle="30"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 0, 3.5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor></scene>"#
        );
        agree(&text, &[("size", 0.03)], 1 << 11);
    }
}
