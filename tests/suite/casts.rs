//! Shadows that the borders of glass and mirrors cast, of lights without extent that shine by way of them (`term::cast`), against differences.

use crate::common::*;

const LAMP: &str = r#"<emitter type="point"><point name="position" value="$x, -0.4, 2.2"/><rgb name="intensity" value="10, 9, 8"/></emitter>"#;
const SPOT: &str = r#"<emitter type="spot"><transform name="to_world"><lookat origin="0, -0.4, 2.2" target="0.2, 0, 0" up="0, 1, 0"/><translate x="$x"/></transform>
  <rgb name="intensity" value="10, 9, 8"/><float name="cutoff_angle" value="25"/><float name="beam_width" value="5"/></emitter>"#;
const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="$x, 0.25, -1"/><rgb name="irradiance" value="3, 2.5, 2"/></emitter>"#;
const GLASS: &str = r#"<bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf>"#;

/// One pixel that sees all of it: fog in glass in thinner fog, or what stands in its place.
fn scene_of(depth: u32, bodies: &str, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="n" value="1.5"/><default name="h" value="0"/><default name="tilt" value="0"/><default name="x" value="0.45"/><default name="cam" value="0.3"/>
  <integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>
  <sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="1.2, -5, 1.4" target="0, 0, 0" up="0, 0, 1"/><translate x="$cam"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.2"/></phase></medium>
  <medium type="homogeneous" id="haze"><float name="sigma_t" value="0.25"/><float name="albedo" value="0.9"/></medium>
  {bodies}{light}</scene>"#
    )
}

/// A block that moves; its inside and outside.
fn block(media: &str) -> String {
    format!(
        r#"<shape type="cube" id="block"><transform name="to_world"><scale x="0.9" y="0.7" z="0.6"/><rotate z="1" angle="20"/><rotate y="1" angle="$tilt"/><translate z="$h"/></transform>{GLASS}{media}</shape>"#
    )
}

/// Haze with an end, in the light.
const HAZE: &str = r#"<shape type="cube"><transform name="to_world"><scale value="1.5"/></transform><bsdf type="null"/><ref name="interior" id="haze"/></shape>"#;
const FOGGY: &str = r#"<ref name="interior" id="fog"/>"#;

#[test]
fn light_in_a_block_against_differences() {
    let place = [("n", 0.02), ("x", 0.05), ("h", 0.02), ("tilt", 1.0), ("cam", 0.05)];
    against_differences(&scene_of(5, &block(FOGGY), LAMP), &place, &["all"], 1 << 13, 0.01);
    against_differences(&scene_of(4, &block(FOGGY), SPOT), &place[..2], &["all"], 1 << 13, 0.01);
    against_differences(&scene_of(4, &block(FOGGY), SUN), &place[..3], &["all"], 1 << 13, 0.01);
}
