//! Shapes, lamps and cameras that move inside media, against known values: [T] section 11, quadratures that are no part of this project
//! (nested Gauss rules, their derivatives by fourth-order differences; every one gives the value of [T] beside it where the set-up is the
//! same), and identities. Each case looks at its picture first, then at its derivatives.

mod common;
use common::{Estimate, check, estimate, forward_of, params, run, scene_of_orders};
use tyndall::render::driver::Mode;
use tyndall::scene::compile::Orders;

const BLACK: &str = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf>"#;
const ALL: Orders = Orders { first: 0, last: u32::MAX };

const fn only(order: u32) -> Orders {
    Orders { first: order, last: order }
}

/// The picture alone.
fn picture(text: &str, orders: Orders, spp: u64) -> Estimate {
    let (_, sc) = scene_of_orders(text, &[], orders);
    estimate(&run(&sc, spp, 1, Mode::Picture), 0)
}

/// The picture and rows of (parameter, derivative), each to one percent of its own.
fn rows(text: &str, orders: Orders, value: f64, truth: &[(&str, f64)], spp: u64) {
    check("L", &picture(text, orders, spp), value, 0.005);
    let names: Vec<&str> = truth.iter().map(|t| t.0).collect();
    let r = forward_of(text, orders, &names, &["all"], spp);
    for (k, (name, d)) in truth.iter().enumerate() {
        check(&format!("dL/d{name}"), &r[k + 1], *d, 0.01);
    }
}

/// Derivatives that are 0: |z| <= 4.5 in every channel, known to `precision` of the picture for a step of one.
fn nothing(text: &str, wrt: &[&str], spp: u64, precision: f64) {
    let l = picture(text, ALL, spp / 4).value;
    assert!(l[0] > 0.0, "a black picture");
    let r = forward_of(text, ALL, wrt, &["all"], spp);
    for (name, e) in wrt.iter().zip(&r[1..]) {
        println!("{name}: {:?} +- {:?} of {:?}", e.value, e.error, l);
        for c in 0..3 {
            assert!(e.value[c] == 0.0 || e.z(c, 0.0).abs() <= 4.5, "{name}: {} +- {}", e.value[c], e.error[c]);
            assert!(e.error[c] <= precision * l[c], "{name}: standard error {} of {}", e.error[c], l[c]);
        }
    }
}

/// One orthographic pixel without extent, placed by `place`.
fn ray(place: &str, medium: &str) -> String {
    format!(
        r#"<sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/>{place}</transform>{medium}
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>"#
    )
}

/// `volpath` with at most `depth` - 1 scatterings.
fn depth(depth: i32) -> String {
    format!(r#"<integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>"#)
}

const IN_FOG: &str = r#"<ref id="fog"/>"#;

/// [T] T4. Light that is the same all along the camera's ray: a sun that slants down from a border parallel to the ray, on a way of 1/0.6 through the
/// fog to any of its points; its irradiance 2 exp(0.35/0.6) is 2 there. The black wall faces sun and camera, and ends before it reaches the border.
#[test]
fn t4_moving_wall() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="d" value="3"/>{}{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.35"/><float name="albedo" value="0.7142857142857143"/></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="1e4"/><rotate y="1" angle="90"/><translate x="1"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="0.5"/><translate z="$d"/></transform>{BLACK}</shape>
    <emitter type="directional"><vector name="direction" value="-0.6, 0, 0.8"/><rgb name="irradiance" value="3.584003651311511"/></emitter></scene>"#,
        depth(2),
        ray("", IN_FOG),
    );
    rows(&text, ALL, 0.0739004432474, &[("d", 0.0139235806364)], 1 << 16);
}

/// [T] T6: a black half-plane before a black wall in an emissive medium, its edge at u = 0.2. The filter is that of `render::filter`, a Gaussian of
/// deviation 0.5 cut at four of them and lowered by exp(-8), so the table's L = 0.578418 and -0.133399 become L_1 P + L_2 (1 - P), P = ∫_{u<0.2} W, and (L_1 - L_2) W(0.2).
#[test]
fn t6_pixel_edge_in_an_emissive_medium() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.2"/>{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.8"/><float name="albedo" value="0.625"/><rgb name="emission" value="2.5"/></medium>
    <sensor type="orthographic"><transform name="to_world"><scale x="0.5" y="0.5"/></transform>{IN_FOG}
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="gaussian"/></film></sensor>
    <shape type="rectangle"><transform name="to_world"><scale value="20"/><translate x="-20" z="1"/><translate x="$x"/></transform>{BLACK}</shape>
    <shape type="rectangle"><transform name="to_world"><scale value="40"/><translate z="1.7"/></transform>{BLACK}</shape></scene>"#,
        depth(1),
    );
    rows(&text, ALL, 0.57847184474149, &[("x", -0.1331412716574396)], 1 << 16);
}

/// [T] T7: a slab of fog over a diffuse plane that moves, under a static border, in uniform light; one and two scatterings. Plane and border are
/// squares so large that their rims are hidden by the fog.
#[test]
fn t7_fog_slab_over_a_moving_plane() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="h" value="0"/>{}{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.8"/></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="1e4"/><translate z="2"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="1e4"/><translate z="$h"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
    <emitter type="constant"/></scene>"#,
        depth(3),
        ray(r#"<lookat origin="-1.8, 0, 2.4" target="0, 0, 0" up="0, 1, 0"/>"#, ""),
    );
    rows(&text, only(1), 0.1827576929165, &[("h", 0.05482684603)], 1 << 18);
    rows(&text, only(2), 0.09532600495, &[("h", 0.0229643143)], 1 << 19);
}

/// [T] T10: a plane under a camera and a square lamp, extinction 0.5 everywhere, scattering 0.4 (1 - (z/2.5)²)² below z = 2.5 as a grid of the albedo.
/// [T] has dI/dh = 0.043500 +- 2e-6 for both orders, by Monte Carlo. The quadrature gives its five path types one by one, values and derivatives: surface 0.0208847 and 0.0397021,
/// medium 0.0168957 and -0.0033008; surface-medium 0.0042829 and 0.0052634, medium-surface 0.0035078 and 0.0039064, medium-medium 0.0044921 and -0.0020752; together 0.0434958.
#[test]
fn t10_moving_plane_under_a_square_lamp() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("albedo.vol");
    // Nodes from -2.5 to 2.5, half a voxel inside of the box.
    let n = 1001;
    let albedo = |k: usize| 0.8 * (1.0 - (2.0 * k as f64 / (n - 1) as f64 - 1.0).powi(2)).powi(2);
    let values = (0..n).map(|k| albedo(k) as f32).collect();
    let vol = tyndall::medium::grid::vol::Vol { res: [1, 1, n], channels: 1, bbox: [[0.0; 3], [1.0; 3]], values };
    vol.write(&path).unwrap();
    let height = 5.0 * n as f64 / (n - 1) as f64;
    let text = format!(
        r#"<scene version="3.0.0"><default name="h" value="0"/>{}{}
    <medium type="heterogeneous" id="fog"><float name="sigma_t" value="0.5"/>
      <volume name="albedo" type="gridvolume"><string name="filename" value="{}"/>
        <transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale x="400" y="400" z="{height}"/></transform></volume></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="150"/><translate z="$h"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="0.15"/><rotate x="1" angle="180"/><translate x="0.8" y="0.3" z="3"/></transform>
      <emitter type="area"><rgb name="radiance" value="100"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape></scene>"#,
        depth(3),
        ray(r#"<lookat origin="0, 0, 1.5" target="0.6, 0, 0.7" up="0, 1, 0"/>"#, IN_FOG),
        path.display(),
    );
    rows(&text, only(1), 0.0377803671728, &[("h", 0.0364012578)], 1 << 18);
    rows(&text, only(2), 0.0122827635, &[("h", 0.0070945896)], 1 << 19);
}

/// [T] AL1 and AL2: a point light of intensity 10, single scattering, a black wall at z = 6; the camera at $cx, $cy, $cz looks along +z.
fn airlight(light: &str, occluder: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="cx" value="0"/><default name="cy" value="0"/><default name="cz" value="0"/>
    <default name="x" value="0.55"/><default name="y" value="0.95"/><default name="z" value="2.55"/><default name="r" value="0.3"/>
    <default name="edge_y" value="0.8"/><default name="edge_z" value="3"/>{}{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.35"/><float name="albedo" value="0.7142857142857143"/>
      <phase type="hg"><float name="g" value="0.4"/></phase></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="3000"/><rotate y="1" angle="180"/><translate z="6"/></transform>{BLACK}</shape>
    <emitter type="point"><point name="position" value="{light}"/><rgb name="intensity" value="10"/>{IN_FOG}</emitter>{occluder}</scene>"#,
        depth(2),
        ray(r#"<translate x="$cx" y="$cy" z="$cz"/>"#, IN_FOG),
    )
}

/// [T] AL1, rows of the camera and of the edge. The half-plane ends at z = 5.8, before it meets the wall; that edge's shadow would reach the ray at z = 9.6.
#[test]
fn al1_moving_camera_and_half_plane() {
    let plane = format!(
        r#"<shape type="rectangle"><transform name="to_world"><scale x="1000" y="1.4"/><rotate x="1" angle="90"/><translate y="$edge_y" z="1.4"/><translate z="$edge_z"/></transform>{BLACK}</shape>"#
    );
    let truth = [
        ("cx", 0.030870108191),
        ("cy", 0.036890773212),
        ("cz", -0.0010109927578),
        ("edge_y", 0.0036361329137),
        ("edge_z", 0.0050905860791),
    ];
    rows(&airlight("1.2, 1.5, 2.5", &plane), ALL, 0.0389226379655, &truth, 1 << 18);
}

/// [T] AL2, rows of the sphere.
#[test]
fn al2_moving_sphere() {
    let sphere = format!(
        r#"<shape type="sphere"><point name="center" value="$x, $y, $z"/><float name="radius" value="$r"/>{BLACK}</shape>"#
    );
    let truth = [("x", -0.003900330026), ("y", 0.00068175262204), ("z", 0.0078499815079), ("r", -0.015677394386)];
    rows(&airlight("1.2, 1.8, 2.2", &sphere), ALL, 0.02581933069, &truth, 1 << 18);
}

/// [T] AL3 in fog that is thin, not infinitely so: σ = 0.05, albedo 1, a ball of radius 5 around (0, 0, 1), which the camera's ray leaves at z = 6. Over σ the quadrature's
/// limit is [T]'s: 5.949646 and 0.0296688, 0.0512461, -0.00120828, -0.339856. Scattered once; the ray's own 0.74 of the sky is left out.
#[test]
fn al3_sphere_under_a_uniform_sky() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.55"/><default name="y" value="0.95"/><default name="z" value="2.55"/><default name="r" value="0.3"/>{}{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.05"/><float name="albedo" value="1"/></medium>
    <shape type="sphere"><point name="center" value="0, 0, 1"/><float name="radius" value="5"/><bsdf type="null"/><ref name="interior" id="fog"/></shape>
    <shape type="sphere"><point name="center" value="$x, $y, $z"/><float name="radius" value="$r"/>{BLACK}</shape>
    <emitter type="constant"/></scene>"#,
        depth(2),
        ray("", IN_FOG),
    );
    let truth = [("x", 0.0009974656037), ("y", 0.0017228951344), ("r", -0.0113432489258)];
    rows(&text, only(1), 0.2060802695, &truth, 1 << 18);
    // 0.04 % of dL/dr: to be known as well as that.
    let z = &forward_of(&text, only(1), &["z"], &["all"], 1 << 18)[1];
    assert!(z.z(0, -4.750317e-6).abs() <= 4.5 && z.error[0] <= 1e-4, "{z:?}");
}

/// [T] AR in fog, σ_t = 0.5, σ_s = 0.4: the camera at the origin looks down to a black wall at z = -1, so its picture is the integral of AR's in-scattering over points below
/// the origin. At the origin the quadrature's integrand is AR's: 0.0110750927, and -0.0411795212 by x_e. The half-plane is a rectangle that hides all of the lamp beyond its edge.
#[test]
fn ar_area_light_and_half_plane_in_fog() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="edge" value="0.1"/><default name="cx" value="0"/><default name="cz" value="0"/>{}{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.8"/></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="9"/><translate z="-1"/></transform>{BLACK}</shape>
    <shape type="rectangle"><transform name="to_world"><scale x="0.65" y="0.5"/><rotate y="1" angle="180"/><translate x="0.15" y="-0.1" z="2"/></transform>
      <emitter type="area"><rgb name="radiance" value="3"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="2"/><translate x="-2" z="1"/><translate x="$edge"/></transform>{BLACK}</shape></scene>"#,
        depth(2),
        ray(r#"<rotate x="1" angle="180"/><translate x="$cx" z="$cz"/>"#, IN_FOG),
    );
    let truth = [("edge", -0.00664656331394), ("cx", 0.00362030429934), ("cz", 0.0033514863729)];
    rows(&text, ALL, 0.00215710145252, &truth, 1 << 18);
}

/// A floor, a ball, a turned block, a mesh and a panel, apart from each other, in fog; `surface(ρ)` is what they are made of.
fn things(surface: impl Fn(f64) -> String) -> String {
    let (floor, ball, block, mesh, panel) = (surface(0.6), surface(0.3), surface(0.8), surface(0.5), surface(1.0));
    format!(
        r#"<default name="floor" value="0"/><default name="x" value="0.55"/><default name="r" value="0.35"/><default name="y" value="0.7"/><default name="size" value="0.3"/>
  <default name="mesh" value="0.1"/><default name="turn" value="20"/><default name="panel" value="-0.1"/><default name="tilt" value="40"/>
  <default name="cx" value="0.2"/><default name="aim" value="0.1"/><default name="fov" value="45"/><default name="zoom" value="0.45"/><default name="sx" value="0"/><default name="spin" value="0"/>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="3"/><translate y="$floor"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform>{floor}</shape>
  <shape type="sphere"><float name="radius" value="$r"/><transform name="to_world"><translate x="$x" y="0.6" z="0.2"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform>{ball}</shape>
  <shape type="cube"><transform name="to_world"><scale value="$size"/><rotate y="1" angle="30"/><translate x="-0.6" y="$y" z="0.1"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform>{block}</shape>
  <shape type="obj"><string name="filename" value="tests/common/ball.obj"/><transform name="to_world"><scale x="0.25" y="0.3" z="0.25"/><rotate x="1" y="0.4" angle="$turn"/><translate x="$mesh" y="1.5"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform>{mesh}</shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" y="0.3" angle="$tilt"/><translate x="$panel" y="0.5" z="0.7"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform>{panel}</shape>"#
    )
}

/// Around $cx; inside the fog it says so.
fn camera(z: f64, medium: &str) -> String {
    format!(
        r#"<sensor type="perspective"><float name="fov" value="$fov"/><transform name="to_world"><lookat origin="$cx, 1.1, {z}" target="$aim, 0.6, 0" up="0, 1, 0"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform>{medium}
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="tent"/></film></sensor>"#
    )
}

const ORTHOGRAPHIC: &str = r#"<sensor type="orthographic"><transform name="to_world"><scale x="$zoom" y="$zoom"/><lookat origin="$cx, 1.1, 3.5" target="$aim, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="gaussian"/></film></sensor>"#;

/// A cube of `medium` around the things.
fn fog(medium: &str) -> String {
    format!(
        r#"<medium type="homogeneous" id="fog">{medium}<phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale x="1.7" y="1.5" z="1.7"/><translate y="1"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#
    )
}

/// [T] T9: surfaces emit 1 - ρ and reflect ρ, fog and sky emit 1. What has two sides is white, since lamps have one.
fn enclosure(sensor: &str) -> String {
    let surface = |rho: f64| match rho {
        1.0 => r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf>"#.into(),
        _ => format!(
            r#"<emitter type="area"><rgb name="radiance" value="{}"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf>"#,
            1.0 - rho
        ),
    };
    let medium =
        r#"<float name="sigma_t" value="0.7"/><float name="albedo" value="0.6"/><rgb name="emission" value="1"/>"#;
    format!(
        r#"<scene version="3.0.0"><integrator type="volpath"/>{}{}{sensor}<emitter type="constant"/></scene>"#,
        things(surface),
        fog(medium)
    )
}

/// The picture of an enclosure is 1 and stays 1.
fn isothermal(text: &str, wrt: &[&str], precision: f64) {
    check("L", &picture(text, ALL, 1 << 12), 1.0, 0.005);
    nothing(text, wrt, 1 << 14, precision);
}

#[test]
fn t9_isothermal_enclosure_shapes_move() {
    let text = enclosure(&camera(3.5, ""));
    isothermal(&text, &["floor", "x", "y", "mesh", "panel"], 0.02);
    // Without the rooms it is not 0: 10 s.e.
    let names = ["x", "y", "mesh", "panel"];
    let interior = forward_of(&text, ALL, &names, &["interior"], 1 << 14);
    let most = interior[1..].iter().map(|e| (e.value[0] / e.error[0]).abs()).fold(0.0, f64::max);
    assert!(most > 10.0, "{interior:?}");
}

/// Degrees move a ball of radius 0.3 by 0.005.
#[test]
fn t9_isothermal_enclosure_shapes_turn_and_grow() {
    let text = enclosure(&camera(3.5, ""));
    isothermal(&text, &["r", "size"], 0.04);
    isothermal(&text, &["turn", "tilt"], 4e-4);
}

#[test]
fn t9_isothermal_enclosure_cameras() {
    let outside = enclosure(&camera(3.5, ""));
    isothermal(&outside, &["cx", "aim"], 0.02);
    isothermal(&outside, &["fov"], 4e-4);
    let inside = enclosure(&camera(1.65, IN_FOG));
    isothermal(&inside, &["cx", "aim"], 0.02);
    isothermal(&inside, &["fov"], 4e-4);
    isothermal(&enclosure(ORTHOGRAPHIC), &["cx", "aim", "zoom"], 0.02);
}

/// Nothing absorbs, nothing but the sky shines: scattering alone carries its 1 everywhere.
#[test]
fn white_furnace() {
    let surface = |_| {
        r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf>"#.to_string()
    };
    let medium = r#"<float name="sigma_t" value="0.7"/><float name="albedo" value="1"/>"#;
    let text = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"/>{}{}{}<emitter type="constant"/></scene>"#,
        things(surface),
        fog(medium),
        camera(3.5, "")
    );
    isothermal(&text, &["floor", "x", "y", "mesh", "panel", "cx"], 0.04);
}

/// Everything is carried along: camera, things, fog, lamp and point light.
#[test]
fn rigid_motion_of_everything_changes_nothing() {
    let surface = |rho: f64| {
        format!(r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf></bsdf>"#)
    };
    let text = format!(
        r#"<scene version="3.0.0"><default name="lx" value="0.3"/>{}{}{}{}
  <shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="90"/><translate x="-0.6" y="2.1"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform>
    <emitter type="area"><rgb name="radiance" value="6"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf></shape>
  <emitter type="point"><transform name="to_world"><translate x="$lx" y="2.2" z="0.5"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform><rgb name="intensity" value="3"/></emitter></scene>"#,
        depth(4),
        things(surface),
        fog(r#"<float name="sigma_t" value="0.7"/><float name="albedo" value="0.8"/>"#),
        camera(3.5, "")
    );
    nothing(&text, &["sx"], 1 << 14, 0.02);
    nothing(&text, &["spin"], 1 << 14, 4e-4);
}

/// A plane without features slides and turns in itself, in fog, under a lamp and a ball that hides part of it.
#[test]
fn a_plane_that_slides_in_itself_changes_nothing() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="turn" value="10"/>{}
    <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 1.2, 3" target="0, 0.3, 0" up="0, 1, 0"/></transform>{IN_FOG}
      <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="tent"/></film></sensor>
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.8"/></medium>
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="200"/><rotate y="1" angle="$turn"/><translate x="$x"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>
    <shape type="sphere"><point name="center" value="0.2, 0.9, 0.1"/><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="90"/><translate y="1.8"/></transform>
      <emitter type="area"><rgb name="radiance" value="9"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape></scene>"#,
        depth(4),
    );
    nothing(&text, &["x"], 1 << 14, 0.02);
    nothing(&text, &["turn"], 1 << 14, 4e-4);
}

/// A diffuse plane moves in fog that shines by itself, and nothing changes; no sample is more than a hundredth of the sum of what 10^6 of them give, each a pixel of its own.
#[test]
fn a_plane_in_uniformly_lit_fog_changes_nothing() {
    let text = |side: u32| {
        format!(
            r#"<scene version="3.0.0"><default name="h" value="0"/><integrator type="volpath"/>
    <sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/><lookat origin="-0.6, 0, 0.8" target="0, 0, 0" up="0, 1, 0"/></transform>{IN_FOG}
      <film type="hdrfilm"><integer name="width" value="{side}"/><integer name="height" value="{side}"/><rfilter type="box"/></film></sensor>
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.7"/><float name="albedo" value="0.6"/><rgb name="emission" value="1"/></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="1000"/><translate z="$h"/></transform>
      <emitter type="area"><rgb name="radiance" value="0.3"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape></scene>"#
        )
    };
    check("L", &picture(&text(4), ALL, 1 << 12), 1.0, 0.005);
    nothing(&text(4), &["h"], 1 << 14, 0.02);
    let (desc, sc) = scene_of_orders(&text(500), &[], ALL);
    let p = params(&desc, &sc, &["h"]);
    let (mut largest, mut sum) = (0.0, 0.0);
    for seed in 1..=4 {
        let o = run(&sc, 1, seed, Mode::Forward(&p));
        for d in (0..o.film.spec().pixels()).map(|i| o.film.mean(1, i)[0].abs()) {
            largest = f64::max(largest, d);
            sum += d;
        }
    }
    assert!(largest < 0.01 * sum, "{largest} of {sum}");
}
