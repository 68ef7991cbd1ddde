//! Lights of zero measure that move: the interior part, without anything that casts a shadow, and with the light
//! standing still for shadows.

use crate::common::{against_differences, check, derivatives};

/// [T] AL1 with the light at $x, $y, $z: camera at 0 looking along +z, black wall at z = 6, half-plane y = 0.8, z >= 3.
const AL1: &str = r#"<scene version="3.0.0">
    <default name="x" value="1.2"/><default name="y" value="1.5"/><default name="z" value="2.5"/>
    <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.35"/><float name="albedo" value="0.7142857142857143"/>
      <phase type="hg"><float name="g" value="0.4"/></phase></medium>
    <sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/></transform>
      <ref id="fog"/>
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
    <shape type="rectangle"><transform name="to_world"><scale value="3000"/><rotate y="1" angle="180"/><translate z="6"/></transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
    <emitter type="point"><point name="position" value="$x, $y, $z"/><rgb name="intensity" value="10"/><ref id="fog"/></emitter>
    <shape type="rectangle"><transform name="to_world"><scale value="1000"/><rotate x="1" angle="90"/>
        <translate x="0" y="0.8" z="1003"/></transform><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>
    </scene>"#;

#[test]
fn al1_interior_rows() {
    let r = derivatives(AL1, &["x", "y", "z"], &["interior"], 1 << 18);

    check("interior dL/dx", &r[0], -0.030870108191, 0.005);
    check("interior dL/dy", &r[1], -0.038587635238, 0.005);
    check("interior dL/dz", &r[2], -0.0013646140791, 0.02);
}

/// Two to four scatterings in chromatic fog with a boundary near the light; the light is not in the picture.
fn fog(light: &str, phase: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <default name="x" value="0.3"/><default name="y" value="0.6"/><default name="z" value="0.2"/><default name="turn" value="20"/><default name="cut" value="50"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="20"/>
    <transform name="to_world"><lookat origin="0, -0.3, 4" target="0, -0.3, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="2"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.8, 1.5, 0.4"/><float name="albedo" value="0.9"/>{phase}</medium>
  <shape type="cube"><transform name="to_world"><scale x="1.2" y="0.9" z="1.1"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  {light}</scene>"#
    )
}

const HG: &str = r#"<phase type="hg"><float name="g" value="0.6"/></phase>"#;

#[test]
fn a_point_light_moves_in_fog() {
    let light = r#"<emitter type="point"><point name="position" value="$x, $y, $z"/><rgb name="intensity" value="4"/></emitter>"#;
    against_differences(&fog(light, HG), &[("x", 0.01), ("y", 0.01), ("z", 0.01)], &["all"], 1 << 14, 0.01);
}

#[test]
fn a_spot_moves_and_turns_in_fog() {
    let light = r#"<emitter type="spot"><transform name="to_world"><rotate x="1" angle="$turn"/><translate x="$x" y="$y" z="$z"/></transform>
      <float name="cutoff_angle" value="$cut"/><float name="beam_width" value="25"/><rgb name="intensity" value="6"/></emitter>"#;
    against_differences(
        &fog(light, HG),
        &[("x", 0.01), ("y", 0.01), ("z", 0.01), ("turn", 1.0), ("cut", 1.0)],
        &["all"],
        1 << 14,
        0.01,
    );
}

#[test]
fn a_sun_turns_over_fog_with_a_floor() {
    let light = r#"<emitter type="directional"><transform name="to_world"><rotate x="1" angle="100"/><rotate z="1" angle="$turn"/></transform>
      <rgb name="irradiance" value="3"/></emitter>
      <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="30"/><translate y="-1.5"/></transform><bsdf type="diffuse"/></shape>"#;
    against_differences(&fog(light, HG), &[("turn", 0.5)], &["all"], 1 << 15, 0.01);
}

/// Everything that the camera sees lies in the plane x = 0 with the light, in fog alike on all sides: light that scatters twice is symmetric about
/// the axis from its first vertex to the light, so that twins cancel without a rest. Alone they would have an error of about the picture's.
#[test]
fn twins_about_the_axis_to_the_light_cancel() {
    let text = r#"<scene version="3.0.0">
      <default name="x" value="0"/><default name="y" value="0.7"/>
      <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
      <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.9"/></medium>
      <sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/></transform><ref id="fog"/>
        <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
      <emitter type="point"><point name="position" value="$x, $y, 2"/><rgb name="intensity" value="10"/><ref id="fog"/></emitter></scene>"#;
    let (desc, scene) = crate::common::scene(text);
    let error = |name: &str| {
        let p = crate::common::params(&desc, &scene, &[name]);
        let o = crate::common::run(&scene, 256, 3, tyndall::render::driver::Mode::Forward(&p));
        let (picture, d) = (crate::common::estimate(&o, 0), crate::common::estimate(&o, 1));
        println!("{name}: {d:?} {picture:?}");
        assert!(picture.value[0] > 0.0);
        (d.value[0].abs() + d.error[0]) / picture.value[0]
    };
    assert!(error("x") < 1e-7, "{}", error("x"));
    assert!(error("y") > 0.1);
}
