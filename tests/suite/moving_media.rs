//! Shapes, lamps and cameras that move inside media, against known values: [T] section 11, quadratures that are no part of this project
//! (nested Gauss rules, their derivatives by fourth-order differences; every one gives the value of [T] beside it where the set-up is the
//! same), and identities. Each case looks at its picture first, then at its derivatives.

use crate::common::{Estimate, check, estimate, forward_of, job, params, run, scene, scene_of_orders};
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Terms;
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

/// Derivatives that are 0: |z| <= 4.5 in every channel, each known to its precision of the picture for a step of one.
fn nothing(text: &str, wrt: &[(&str, f64)], spp: u64) {
    let l = picture(text, ALL, spp / 4).value;
    assert!(l[0] > 0.0, "a black picture");
    let names: Vec<&str> = wrt.iter().map(|w| w.0).collect();
    let r = forward_of(text, ALL, &names, &["all"], spp);
    let mut wrong = Vec::new();
    for ((name, precision), e) in wrt.iter().zip(&r[1..]) {
        println!("{name}: {:?} +- {:?} of {:?}", e.value, e.error, l);
        for c in 0..3 {
            if e.value[c] != 0.0 && e.z(c, 0.0).abs() > 4.5 {
                wrong.push(format!("{name}: {} +- {}", e.value[c], e.error[c]));
            }
            if e.error[c] > precision * l[c] {
                wrong.push(format!("{name}: standard error {} of {}", e.error[c], l[c]));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

const TERMS: [&str; 7] =
    ["interior", "null_interface", "light_shadow", "hard_profile", "pixel_edge", "surface_edge", "medium_edge"];

/// Negative control: without one of the terms the derivative is wrong, by 8 standard errors and a tenth of `size`.
fn needs(term: &str, text: &str, orders: Orders, (name, truth): (&str, f64), size: f64, spp: u64) {
    assert!(TERMS.contains(&term));
    let others: Vec<&str> = TERMS.into_iter().filter(|t| *t != term).collect();
    let e = &forward_of(text, orders, &[name], &others, spp)[1];
    println!("dL/d{name} without {term}: {} +- {} truth {truth}", e.value[0], e.error[0]);
    let off = (e.value[0] - truth).abs();
    assert!(off > 8.0 * e.error[0] && off > 0.1 * size.abs(), "{name} without {term}: {e:?}, truth {truth}");
}

/// One orthographic pixel without extent, placed by `place`.
fn ray(place: &str, medium: &str) -> String {
    window(1e-9, place, medium)
}

/// One orthographic pixel of twice this width: what samples from an edge outward needs one that can be hit.
fn window(half: f64, place: &str, medium: &str) -> String {
    format!(
        r#"<sensor type="orthographic"><transform name="to_world"><scale x="{half}" y="{half}"/>{place}</transform>{medium}
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
    rows(&text, ALL, 0.0739004432474, &[("d", 0.0139235806364)], 1 << 14);
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
    <shape type="rectangle"><transform name="to_world"><scale x="1.3" y="2.2"/><translate x="-1.3" z="1"/><translate x="$x"/></transform>{BLACK}</shape>
    <shape type="rectangle"><transform name="to_world"><scale value="40"/><translate z="1.7"/></transform>{BLACK}</shape></scene>"#,
        depth(1),
    );
    let x = ("x", -0.1331412716574396);
    rows(&text, ALL, 0.57847184474149, &[x], 1 << 16);
    needs("pixel_edge", &text, ALL, x, x.1, 1 << 14);
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
    rows(&text, only(1), 0.1827576929165, &[("h", 0.05482684603)], 1 << 19);
    rows(&text, only(2), 0.09532600495, &[("h", 0.0229643143)], 5 << 18);
    needs("interior", &text, only(1), ("h", 0.05482684603), 0.05482684603, 1 << 12);
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
    rows(&text, only(1), 0.0377803671728, &[("h", 0.0364012578)], 1 << 16);
    rows(&text, only(2), 0.0122827635, &[("h", 0.0070945896)], 1 << 18);
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
    let truth =
        [("cx", 0.030870108191), ("cy", 0.036890773212), ("edge_y", 0.0036361329137), ("edge_z", 0.0050905860791)];
    let text = airlight("1.2, 1.5, 2.5", &plane);
    rows(&text, ALL, 0.0389226379655, &truth, 1 << 16);
    rows(&text, ALL, 0.0389226379655, &[("cz", -0.0010109927578)], 5 << 17);
    needs("light_shadow", &text, ALL, ("cy", 0.036890773212), 0.0017, 1 << 17);
}

/// [T] AL2, rows of the sphere.
#[test]
fn al2_moving_sphere() {
    let sphere = format!(
        r#"<shape type="sphere"><point name="center" value="$x, $y, $z"/><float name="radius" value="$r"/>{BLACK}</shape>"#
    );
    let truth = [("x", -0.003900330026), ("y", 0.00068175262204), ("z", 0.0078499815079), ("r", -0.015677394386)];
    let text = airlight("1.2, 1.8, 2.2", &sphere);
    rows(&text, ALL, 0.02581933069, &truth, 1 << 16);
    needs("light_shadow", &text, ALL, truth[3], truth[3].1, 1 << 14);
}

/// [T] AL3 in fog that is thin, not infinitely so: σ = 0.05, albedo 1, a ball of radius 5 around (0, 0, 1), which the camera's ray leaves at z = 6. Over σ the quadrature's
/// limit is [T]'s: 5.949646 and 0.0296688, 0.0512461, -0.00120828, -0.339856. Scattered once; the ray's own 0.74 of the sky is left out. The truths are means over a pixel 0.8 wide.
#[test]
fn al3_sphere_under_a_uniform_sky() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.55"/><default name="y" value="0.95"/><default name="z" value="2.55"/><default name="r" value="0.3"/>{}{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.05"/><float name="albedo" value="1"/></medium>
    <shape type="sphere"><point name="center" value="0, 0, 1"/><float name="radius" value="5"/><bsdf type="null"/><ref name="interior" id="fog"/></shape>
    <shape type="sphere"><point name="center" value="$x, $y, $z"/><float name="radius" value="$r"/>{BLACK}</shape>
    <emitter type="constant"/></scene>"#,
        depth(2),
        window(0.4, "", IN_FOG),
    );
    let r = ("r", -0.01181675424);
    check("L", &picture(&text, only(1), 1 << 16), 0.20576385133, 0.005);
    // 9, 16 and 0.01 % of dL/dr, left over where all around the sphere cancels: to be known as well as that.
    let rest = [("x", 0.00107793862), ("y", 0.00191000896), ("z", -1.13418e-6)];
    let e = forward_of(&text, only(1), &["r", "x", "y", "z"], &["all"], 1 << 20);
    check("dL/dr", &e[1], r.1, 0.01);
    for ((name, d), e) in rest.iter().zip(&e[2..]) {
        println!("dL/d{name}: {} +- {} truth {d} z {:.2}", e.value[0], e.error[0], e.z(0, *d));
        assert!(e.z(0, *d).abs() <= 4.5 && e.error[0] <= 1e-4, "{name}: {e:?}");
    }
    needs("medium_edge", &text, only(1), r, r.1, 1 << 14);
}

/// [T] AR in fog, σ_t = 0.5, σ_s = 0.4: the camera at the origin looks down to a floor at z = -1, so its picture is the integral of AR's in-scattering over points below
/// the origin, and the light that the floor reflects. At the origin the quadrature's integrand is AR's: 0.0110750927, and -0.0411795212 by x_e. The half-plane is a rectangle that
/// hides all of the lamp beyond its edge; floor and rectangle are no larger than they have to be. The truths are means over a pixel 0.6 wide.
#[test]
fn ar_area_light_and_half_plane_in_fog() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="edge" value="0.1"/><default name="cx" value="0"/><default name="cz" value="0"/>{}{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.8"/></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="0.35"/><translate z="-1"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></shape>
    <shape type="rectangle"><transform name="to_world"><scale x="0.65" y="0.5"/><rotate y="1" angle="180"/><translate x="0.15" y="-0.1" z="2"/></transform>
      <emitter type="area"><rgb name="radiance" value="3"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
    <shape type="rectangle"><transform name="to_world"><scale x="0.35" y="0.6"/><translate x="-0.35" y="-0.05" z="1"/><translate x="$edge"/></transform>{BLACK}</shape></scene>"#,
        depth(2),
        window(0.3, r#"<rotate x="1" angle="180"/><translate x="$cx" z="$cz"/>"#, IN_FOG),
    );
    let truth = [("edge", -0.01242121546), ("cx", 0.00600689014), ("cz", 0.00208766200)];
    rows(&text, ALL, 0.004626625876, &truth, 1 << 20);
    needs("medium_edge", &text, ALL, truth[0], truth[0].1, 1 << 16);
    needs("surface_edge", &text, ALL, truth[0], truth[0].1, 1 << 16);
    needs("interior", &text, ALL, truth[2], truth[2].1, 1 << 16);
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

/// Beside the ball: where it fills much of the film, its limb's slides (1/cos) leave no variance to speak of (beyond one scattering, 64 times the samples leave two thirds of the error).
const ORTHOGRAPHIC: &str = r#"<sensor type="orthographic"><transform name="to_world"><scale x="$zoom" y="$zoom"/><lookat origin="$cx, 1.1, 3.5" target="$aim, 0.6, 0" up="0, 1, 0"/><translate x="-0.9"/></transform>
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
    enclosure_of(0.7, 0.6, sensor)
}

fn enclosure_of(sigma_t: f64, albedo: f64, sensor: &str) -> String {
    let surface = |rho: f64| match rho {
        1.0 => r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></bsdf>"#.into(),
        _ => format!(
            r#"<emitter type="area"><rgb name="radiance" value="{}"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf>"#,
            1.0 - rho
        ),
    };
    let medium = format!(
        r#"<float name="sigma_t" value="{sigma_t}"/><float name="albedo" value="{albedo}"/><rgb name="emission" value="1"/>"#
    );
    format!(
        r#"<scene version="3.0.0"><integrator type="volpath"/>{}{}{sensor}<emitter type="constant"/></scene>"#,
        things(surface),
        fog(&medium)
    )
}

/// The picture of an enclosure is 1 and stays 1.
fn isothermal(text: &str, wrt: &[(&str, f64)], spp: u64) {
    check("L", &picture(text, ALL, spp / 4), 1.0, 0.005);
    nothing(text, wrt, spp);
}

/// Degrees move a ball of radius 0.3 by 0.005.
#[test]
fn t9_isothermal_enclosure_shapes() {
    let text = enclosure(&camera(3.5, ""));
    let moves = [("floor", 0.02), ("x", 0.02), ("y", 0.02), ("mesh", 0.02), ("panel", 0.02)];
    let grows = [("r", 0.04), ("size", 0.04), ("turn", 4e-4), ("tilt", 4e-4)];
    isothermal(&text, &[&moves[..], &grows[..]].concat(), 1 << 12);
    // Edges hide what is behind them, whatever shines there: the interior alone is no identity.
    let thin = enclosure_of(0.35, 0.3, &camera(3.5, ""));
    for e in &forward_of(&thin, ALL, &["floor", "r", "size"], &["interior"], 1 << 13)[1..] {
        println!("interior alone: {} +- {}", e.value[0], e.error[0]);
        assert!(e.z(0, 0.0) > 6.0, "{e:?}");
    }
}

#[test]
fn t9_isothermal_enclosure_cameras() {
    let what = [("cx", 0.02), ("aim", 0.02), ("fov", 4e-4)];
    // Thin: paths are shorter, and slides spread less.
    let thin = |sensor: &str| enclosure_of(0.35, 0.3, sensor);
    isothermal(&thin(&camera(3.5, "")), &what, 1 << 11);
    isothermal(&thin(&camera(1.65, IN_FOG)), &what, 1 << 11);
    isothermal(&thin(ORTHOGRAPHIC), &[("cx", 0.02), ("aim", 0.02), ("zoom", 0.02)], 1 << 13);
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
    isothermal(&text, &["floor", "x", "y", "mesh", "panel", "cx"].map(|n| (n, 0.04)), 1 << 13);
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
  <emitter type="point"><transform name="to_world"><translate x="$lx" y="2.2" z="1.5"/><rotate y="1" angle="$spin"/><translate x="$sx"/></transform><rgb name="intensity" value="3"/></emitter></scene>"#,
        depth(4),
        things(surface),
        fog(r#"<float name="sigma_t" value="0.7"/><float name="albedo" value="0.8"/>"#),
        camera(3.5, "")
    );
    nothing(&text, &[("sx", 0.02), ("spin", 4e-4)], 1 << 13);
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
    nothing(&text, &[("x", 0.02), ("turn", 4e-4)], 1 << 14);
}

/// A diffuse plane moves in fog that shines by itself, and nothing changes; no sample is more than a hundredth of the sum of what 250 000 of them give (10^6 are asked for), each a pixel of its own.
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
    nothing(&text(4), &[("h", 0.02)], 1 << 12);
    let (desc, sc) = scene_of_orders(&text(500), &[], ALL);
    let p = params(&desc, &sc, &["h"]);
    let o = run(&sc, 1, 1, Mode::Forward(&p));
    let samples = (0..o.film.spec().pixels()).map(|i| o.film.mean(1, i)[0].abs());
    let (largest, sum) = samples.fold((0.0, 0.0), |(most, sum), d| (f64::max(most, d), sum + d));
    println!("{largest} of {sum}");
    assert!(largest < 0.01 * sum, "{largest} of {sum}");
}

/// Paths of their own beside the outline of the ball (`render::limb`): those of the pixels alone meet it at grazing so rarely that a few of them decide (0.008 to 0.14).
#[test]
fn outlines_have_paths_of_their_own() {
    // As far away as the figures above were taken.
    let text = std::fs::read_to_string("scenes/sphere/scene.xml").unwrap();
    let text = text
        .replace(r#"name="max_depth" value="3""#, r#"name="max_depth" value="4""#)
        .replace(r#"value="32"/><integer name="height" value="32""#, r#"value="40"/><integer name="height" value="40""#)
        .replace(r#"name="fov" value="30""#, r#"name="fov" value="42""#)
        .replace(r#"target="0.15, 0, -0.1""#, r#"target="0, -0.2, 0""#);
    assert!(
        text.contains(r#"fov" value="42""#)
            && text.contains(r#"width" value="40""#)
            && text.contains(r#"max_depth" value="4""#)
    );
    assert!(text.contains(r#"target="0, -0.2, 0""#));
    let errors = [1, 2, 3, 4].map(|seed| {
        let (desc, sc) = scene(&text);
        let p = params(&desc, &sc, &["sphere_x"]);
        let terms = Terms::parse(&["interior".to_string()]).unwrap();
        let o = Job { terms, ..job(&sc, 64, seed, Mode::Forward(&p)) }.run(&|_| {}).unwrap();
        let variance: f64 = (0..o.film.spec().pixels()).map(|i| o.film.variance_of_mean(1, i).unwrap().mean()).sum();
        (variance / o.film.spec().pixels() as f64).sqrt()
    });
    println!("{errors:?}");
    assert!(errors.iter().all(|e| *e < 0.007), "{errors:?}");
}
