//! Moving shadows of zero-measure lights against [T] section 11 and against finite differences.

use crate::common::{against_differences, check, derivatives};

const BLACK: &str = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf>"#;

/// Camera at 0 looking along +z, black wall at z = 6, fog, a point light of intensity 10 at $x, $y, $z.
fn airlight(at: [f64; 3], occluder: &str) -> String {
    let [x, y, z] = at;
    format!(
        r#"<scene version="3.0.0">
    <default name="x" value="{x}"/><default name="y" value="{y}"/><default name="z" value="{z}"/>
    <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.35"/><float name="albedo" value="0.7142857142857143"/>
      <phase type="hg"><float name="g" value="0.4"/></phase></medium>
    <sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/></transform><ref id="fog"/>
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
    <shape type="rectangle"><transform name="to_world"><scale value="3000"/><rotate y="1" angle="180"/><translate z="6"/></transform>{BLACK}</shape>
    <emitter type="point"><point name="position" value="$x, $y, $z"/><rgb name="intensity" value="10"/><ref id="fog"/></emitter>
    {occluder}</scene>"#
    )
}

const XYZ: [&str; 3] = ["x", "y", "z"];

#[test]
fn al1_half_plane() {
    let plane = format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale value="1000"/><rotate x="1" angle="90"/><translate x="0" y="0.8" z="1003"/></transform>{BLACK}</shape>"#
    );
    let text = airlight([1.2, 1.5, 2.5], &plane);
    let r = derivatives(&text, &XYZ, &["light_shadow"], 64);
    assert!(r[0].value[0].abs() < 1e-12);
    check("boundary dL/dy", &r[1], -0.0019392708873, 0.005);
    check("boundary dL/dz", &r[2], -0.0027149792422, 0.005);
    let r = derivatives(&text, &XYZ, &["all"], 1 << 18);
    check("dL/dx", &r[0], -0.030870108191, 0.005);
    check("dL/dy", &r[1], -0.040526906126, 0.005);
    check("dL/dz", &r[2], -0.0040795933213, 0.01);
}

#[test]
fn al2_sphere() {
    let sphere = format!(
        r#"<shape type="sphere"><point name="center" x="0.55" y="0.95" z="2.55"/><float name="radius" value="0.3"/>{BLACK}</shape>"#
    );
    let text = airlight([1.2, 1.8, 2.2], &sphere);
    let r = derivatives(&text, &XYZ, &["light_shadow"], 64);
    check("boundary dL/dx", &r[0], 0.0021104386636, 0.005);
    check("boundary dL/dy", &r[1], -0.0002345732269, 0.005);
    check("boundary dL/dz", &r[2], -0.0036450531188, 0.005);
    let r = derivatives(&text, &XYZ, &["all"], 1 << 18);
    check("dL/dx", &r[0], -0.015189404261, 0.005);
    check("dL/dy", &r[1], -0.026184337614, 0.005);
    check("dL/dz", &r[2], -0.0038092116332, 0.01);
}

/// [T] RC: the film covers the footprint [-1, 1.5] x [-0.8, 0.9] of a floor, so the mean pixel is the integral over its area.
#[test]
fn rc_receiver_shadow() {
    let text = format!(
        r#"<scene version="3.0.0">
    <default name="x" value="0.2"/><default name="y" value="2"/>
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="orthographic"><transform name="to_world"><scale x="1.25" y="1.25"/><lookat origin="0.25, 1, 0.05" target="0.25, 0, 0.05" up="0, 0, 1"/></transform>
      <film type="hdrfilm"><integer name="width" value="25"/><integer name="height" value="17"/><rfilter type="box"/></film></sensor>
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="10"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>
    <emitter type="point"><point name="position" value="$x, $y, 0"/><rgb name="intensity" value="10"/></emitter>
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="1000"/><translate x="-999.75" y="1.2"/></transform>{BLACK}</shape>
    </scene>"#
    );
    let area = 2.5 * 1.7;
    let r = derivatives(&text, &["x", "y"], &["light_shadow"], 2048);
    check("boundary dp_x", &r[0], 1.29918396872 / area, 0.005);
    check("boundary dp_y", &r[1], 0.081198998045 / area, 0.005);
    let r = derivatives(&text, &["x", "y"], &["all"], 2048);
    check("dp_x", &r[0], 1.6398028962 / area, 0.005);
    check("dp_y", &r[1], -0.57135191559 / area, 0.005);
}

/// A foggy box with a reflecting floor, a mesh, a ball and a disk before the light; all orders up to four scatterings.
fn foggy_room(light: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <default name="x" value="0.1"/><default name="y" value="1.3"/><default name="z" value="0.2"/><default name="turn" value="20"/><default name="cut" value="35"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="30"/>
    <transform name="to_world"><lookat origin="0, 0.2, 5" target="0, -0.1, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="4"/><rfilter type="tent"/></film></sensor>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.5, 0.9, 0.3"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale x="1.6" y="1.5" z="1.6"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/><translate y="-1.2"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.8, 0.5, 0.3"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.25"/><rotate x="1" y="1" angle="35"/><translate x="-0.5" y="0.3"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" x="0.6" y="0.2" z="-0.2"/><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>
  <shape type="disk"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="-70"/><translate x="0.1" y="0.5" z="0.5"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  {light}</scene>"#
    )
}

#[test]
fn shadows_of_a_point_light_in_a_foggy_room() {
    let light = r#"<emitter type="point"><point name="position" value="$x, $y, $z"/><rgb name="intensity" value="4"/></emitter>"#;
    against_differences(&foggy_room(light), &[("x", 0.02), ("y", 0.02)], &["all"], 1 << 12, 0.02);
}

#[test]
fn shadows_of_a_sun_in_a_foggy_room() {
    let light = r#"<emitter type="directional"><transform name="to_world"><rotate x="1" angle="100"/><rotate z="1" angle="$turn"/></transform><rgb name="irradiance" value="3"/></emitter>"#;
    against_differences(&foggy_room(light), &[("turn", 1.0)], &["all"], 1 << 14, 0.02);
}

#[test]
fn shadows_and_hard_edge_of_a_spot_in_a_foggy_room() {
    let light = r#"<emitter type="spot"><transform name="to_world"><rotate x="1" angle="90"/><rotate z="1" angle="$turn"/><translate x="$x" y="2.3" z="0.2"/></transform>
      <float name="cutoff_angle" value="$cut"/><float name="beam_width" value="$cut"/><rgb name="intensity" value="14"/></emitter>"#;
    against_differences(&foggy_room(light), &[("turn", 1.0), ("cut", 1.0), ("x", 0.02)], &["all"], 1 << 14, 0.02);
}

/// A box of six rectangles casts the shadow of a cube: their edges are one each. The two scenes are one, so are their derivatives.
#[test]
fn rectangles_that_share_edges_cast_one_shadow() {
    let light = r#"<emitter type="point"><point name="position" value="$x, $y, $z"/><rgb name="intensity" value="4"/></emitter>"#;
    let cube = r#"<shape type="cube"><transform name="to_world"><scale value="0.25"/><rotate x="1" y="1" angle="35"/><translate x="-0.5" y="0.3"/></transform><bsdf type="diffuse"/></shape>"#;
    let side = |turn: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><translate z="1"/>{turn}<scale value="0.25"/><rotate x="1" y="1" angle="35"/><translate x="-0.5" y="0.3"/></transform><bsdf type="diffuse"/></shape>"#
        )
    };
    let turns = [
        "",
        r#"<rotate x="1" angle="90"/>"#,
        r#"<rotate x="1" angle="180"/>"#,
        r#"<rotate x="1" angle="270"/>"#,
        r#"<rotate y="1" angle="90"/>"#,
        r#"<rotate y="1" angle="270"/>"#,
    ];
    let six: String = turns.iter().map(|t| side(t)).collect();
    let text = foggy_room(light);
    assert!(text.contains(cube));
    let a = derivatives(&text, &["x", "y"], &["light_shadow"], 2048);
    let b = derivatives(&text.replace(cube, &six), &["x", "y"], &["light_shadow"], 2048);
    for (k, (a, b)) in a.iter().zip(&b).enumerate() {
        for c in 0..3 {
            let z = (a.value[c] - b.value[c]) / a.error[c].hypot(b.error[c]);
            println!("{k} {c}: {} {} z {z:.2}", a.value[c], b.value[c]);
            assert!(z.abs() < 4.5, "{k} {c}: {} {}", a.value[c], b.value[c]);
        }
    }
}

/// Fog that stands in fog, a camera in a bubble of its own, and no `<ref>` in the light: what surrounds what is told by interfaces.
#[test]
fn shadows_through_nested_interfaces() {
    let light = r#"<emitter type="point"><point name="position" value="$x, $y, $z"/><rgb name="intensity" value="4"/></emitter>
      <medium type="homogeneous" id="thick"><float name="sigma_t" value="1.2"/><float name="albedo" value="0.9"/></medium>
      <shape type="sphere"><point name="center" x="0.1" y="1.2" z="0.1"/><float name="radius" value="0.28"/><bsdf type="null"/><ref name="interior" id="thick"/><ref name="exterior" id="fog"/></shape>
      <shape type="sphere"><point name="center" x="0" y="0.2" z="5"/><float name="radius" value="0.5"/><bsdf type="null"/><ref name="interior" id="thick"/></shape>"#;
    let text =
        foggy_room(light).replace(r#"<sensor type="perspective">"#, r#"<sensor type="perspective"><ref id="thick"/>"#);
    against_differences(&text, &[("x", 0.02), ("y", 0.02)], &["all"], 1 << 12, 0.02);
}
