//! Shadows that the borders of glass and mirrors cast, of lights without extent that shine by way of them (`term::cast`), against differences.

use crate::common::*;
use tyndall::render::driver::Mode;

const LAMP: &str = r#"<emitter type="point"><point name="position" value="$x, -0.4, 2.2"/><rgb name="intensity" value="10, 9, 8"/></emitter>"#;
const SPOT: &str = r#"<emitter type="spot"><transform name="to_world"><lookat origin="0, -0.4, 2.2" target="0.2, 0, 0" up="0, 1, 0"/><translate x="$x"/></transform>
  <rgb name="intensity" value="10, 9, 8"/><float name="cutoff_angle" value="40"/><float name="beam_width" value="5"/></emitter>"#;
const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="$x, 0.25, -1"/><rgb name="irradiance" value="3, 2.5, 2"/></emitter>"#;
const GLASS: &str =
    r#"<bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf>"#;

/// One pixel that sees all of it: fog in glass in thinner fog, or what stands in its place.
fn scene_of(depth: u32, bodies: &str, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="n" value="1.5"/><default name="h" value="0"/><default name="tilt" value="0"/><default name="x" value="0.45"/><default name="cam" value="0.3"/>
  <integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>
  <sensor type="perspective"><float name="fov" value="9"/><transform name="to_world"><lookat origin="1.2, -5, 1.4" target="0.35, -0.2, -0.1" up="0, 0, 1"/><translate x="$cam"/></transform>
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

/// Derivatives against differences; some of each is light that ends at borders.
fn compare(text: &str, wrt: &[(&str, f64)], spp: u64) {
    let names: Vec<_> = wrt.iter().map(|w| w.0).collect();
    for (part, name) in derivatives(text, &names, &["light_shadow"], spp).iter().zip(names) {
        assert!(part.value[0].abs() > 5.0 * part.error[0], "{name}: {part:?}");
    }
    against_differences(text, wrt, &["all"], spp, 0.01);
}

#[test]
#[ignore = "make stress"]
fn light_in_a_block_against_differences() {
    let place = [("n", 0.05), ("x", 0.1), ("h", 0.05), ("tilt", 3.0), ("cam", 0.012)];
    compare(&scene_of(5, &block(FOGGY), LAMP), &place, 1 << 14);
    compare(&scene_of(5, &block(FOGGY), SPOT), &place[..2], 1 << 14);
    compare(&scene_of(5, &block(FOGGY), SUN), &place[..3], 1 << 14);
}

/// The light that a block lets through into the haze behind it, what it takes out of it, and what its sides mirror.
#[test]
fn light_behind_a_block_against_differences() {
    let clear = format!("{HAZE}{}", block(r#"<ref name="interior" id="haze"/><ref name="exterior" id="haze"/>"#));
    let high = LAMP.replace("2.2", "2.6");
    compare(&scene_of(5, &clear, &high), &[("n", 0.05), ("x", 0.1), ("h", 0.05)], 1 << 14);
    compare(&scene_of(5, &clear, SUN), &[("n", 0.05), ("x", 0.1), ("h", 0.05)], 1 << 14);
}

/// A prism as a mesh, whose facets lie in one plane in part.
fn prism(dir: &std::path::Path, media: &str) -> String {
    let corners = "v -0.7 -0.6 -0.5\nv 0.7 -0.6 -0.5\nv 0 -0.6 0.7\nv -0.7 0.6 -0.5\nv 0.7 0.6 -0.5\nv 0 0.6 0.7\n";
    let faces = "f 1 2 3\nf 4 6 5\nf 1 4 5\nf 1 5 2\nf 2 5 6\nf 2 6 3\nf 3 6 4\nf 3 4 1\n";
    let path = dir.join("prism.obj");
    std::fs::write(&path, format!("{corners}{faces}")).unwrap();
    let turned = r#"<transform name="to_world"><rotate z="1" angle="20"/><rotate y="1" angle="$tilt"/><translate z="$h"/></transform>"#;
    format!(
        r#"<shape type="obj"><string name="filename" value="{}"/><boolean name="face_normals" value="true"/>{turned}{GLASS}{media}</shape>"#,
        path.display()
    )
}

/// Embree's f32 rays tell facets apart there that a connection meets just beside their border.
#[test]
#[ignore = "make stress"]
fn light_beside_a_mesh_against_differences() {
    let dir = tempfile::tempdir().unwrap();
    let high = LAMP.replace("2.2", "2.6").replace("$x, -0.4", "0.9, $x").replace("0.45", "-0.4");
    let clear = format!("{HAZE}{}", prism(dir.path(), r#"<ref name="exterior" id="haze"/>"#));
    let text = scene_of(4, &clear, &high).replace(r#"name="x" value="0.45""#, r#"name="x" value="-0.4""#);
    // The shadow behind it.
    let text = text.replace(r#"target="0.35, -0.2, -0.1""#, r#"target="-0.9, 0, -0.6""#);
    compare(&text, &[("tilt", 1.0), ("x", 0.05)], 1 << 15);
}

/// Faces that meet would count the light between them twice.
#[test]
fn bodies_that_meet_are_refused() {
    let two = |x: f64| {
        let wall = |turn: &str| {
            format!(
                r#"<shape type="rectangle"><transform name="to_world"><scale value="0.3"/>{turn}</transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>"#
            )
        };
        let other = wall(&format!(r#"<translate x="0.3"/><rotate y="1" angle="90"/><translate x="{x}"/>"#));
        let text =
            scene_of(4, &format!("{HAZE}{}{other}", wall(r#"<translate x="0.3"/>"#)), &LAMP.replace("2.2", "2.6"));
        let unused = ["n", "h", "tilt"].iter().fold(text, |t, name| {
            let at = t.find(&format!(r#"<default name="{name}""#)).unwrap();
            let end = at + t[at..].find("/>").unwrap() + 2;
            format!("{}{}", &t[..at], &t[end..])
        });
        let (desc, sc) = scene(&unused);
        let p = sc.param_set(&desc, &["x".to_string()]).unwrap();
        job(&sc, 2, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default()
    };
    assert!(two(0.0).contains("touch"), "{}", two(0.0));
    assert!(two(0.3).contains("touch"), "{}", two(0.3));
    // The boxes around them meet.
    assert_eq!(two(0.62), "");
    assert_eq!(two(-0.01), "");
}

/// Balls in fog in a block, and above it; a tube and a plate.
#[test]
#[ignore = "make stress"]
fn light_past_round_things_against_differences() {
    let ball = |at: &str, radius: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" value="{at}"/><float name="radius" value="{radius}"/><bsdf type="diffuse"/></shape>"#
        )
    };
    let balls = format!("{}{}", ball("$ball, -0.2, 0.15", "$r"), ball("0.5, 0, 1.2", "0.2"));
    let own = r#"<default name="ball" value="0.2"/><default name="r" value="0.2"/>"#;
    let wrt = [("n", 0.02), ("x", 0.1), ("ball", 0.05), ("r", 0.04)];
    compare(&scene_of(4, &format!("{own}{}{balls}", block(FOGGY)), LAMP), &wrt, 1 << 14);
    compare(&scene_of(4, &format!("{own}{}{balls}", block(FOGGY)), SUN), &wrt[..2], 1 << 14);
    let round = r#"<shape type="cylinder"><point name="p0" value="$ball, -0.4, 0.1"/><point name="p1" value="$ball, 0, 0.3"/><float name="radius" value="$r"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
      <shape type="disk"><transform name="to_world"><scale value="0.25"/><rotate x="1" angle="15"/><translate x="0.5" z="1.2"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#;
    // Steps by the lamp's place would bring folds of shadows over the pixel's border.
    compare(&scene_of(4, &format!("{own}{}{round}", block(FOGGY)), LAMP), &[("n", 0.02), ("ball", 0.03)], 1 << 14);
}

/// Borders that see each other's jump, and those that nobody knows.
#[test]
fn round_things_that_meet_are_refused() {
    let told = |bodies: &str| {
        let text = scene_of(4, &format!("{}{bodies}", block(FOGGY)), LAMP);
        let (desc, sc) = scene(&text);
        let p = sc.param_set(&desc, &["n".to_string()]).unwrap();
        job(&sc, 2, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let disk = |z: f64, turn: f64| {
        format!(
            r#"<shape type="disk"><transform name="to_world"><rotate z="1" angle="{turn}"/><scale value="0.2"/><translate z="{z}"/></transform></shape>"#
        )
    };
    let two = |gap: f64| told(&format!("{}{}", disk(0.1, 0.0), disk(0.1 + gap, 20.0)));
    assert!(two(1e-6).contains("lie on each other"), "{}", two(1e-6));
    assert_eq!(two(1e-3), "");
    let (sin, cos) = 20f64.to_radians().sin_cos();
    let ball = |y: f64| {
        let at = format!("{}, {}, 0", -sin * y, cos * y);
        told(&format!(
            r#"<shape type="sphere"><point name="center" value="{at}"/><float name="radius" value="0.2"/></shape>"#
        ))
    };
    // Its centre in a face.
    assert!(ball(0.7).contains("pass through each other"), "{}", ball(0.7));
    assert_eq!(ball(0.1), "");
}

#[test]
fn light_of_a_mirror_against_differences() {
    let mirror = r#"<shape type="rectangle" id="mirror"><transform name="to_world"><scale value="0.5"/><rotate y="1" angle="20"/><rotate y="1" angle="$tilt"/><translate z="$h"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>"#;
    let text = scene_of(4, &format!("{HAZE}{mirror}"), &LAMP.replace("2.2", "2.6"));
    let text = text
        .replace(r#"<default name="n" value="1.5"/>"#, "")
        .replace(r#"target="0.35, -0.2, -0.1""#, r#"target="0.6, 0, 0.6""#);
    compare(&text, &[("tilt", 3.0), ("x", 0.1), ("h", 0.05), ("cam", 0.1)], 1 << 14);
}

/// One block in the light of the other.
#[test]
fn light_between_blocks_against_differences() {
    let second = r#"<shape type="cube"><transform name="to_world"><scale x="0.35" y="0.5" z="0.12"/><rotate x="1" angle="15"/><translate x="0.3" y="-0.3" z="1.2"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.3"/><float name="ext_ior" value="1"/></bsdf></shape>"#;
    compare(&scene_of(6, &format!("{}{second}", block(FOGGY)), LAMP), &[("n", 0.05), ("x", 0.1), ("h", 0.05)], 1 << 13);
}

/// Fog in a block that lies aslant in another one: light comes to it by two faces at least, of which the inner ones move with neither the outer nor the light.
#[test]
fn light_in_a_block_within_a_block_against_differences() {
    let inner = r#"<default name="inner" value="0"/><shape type="cube"><transform name="to_world"><scale x="0.4" y="0.3" z="0.3"/><rotate x="1" angle="15"/><translate x="0.15" y="-0.05" z="0.05"/><translate z="$inner"/></transform>
      <bsdf type="dielectric"><float name="int_ior" value="1.2"/><float name="ext_ior" value="$n"/></bsdf><ref name="interior" id="fog"/></shape>"#;
    let text = scene_of(6, &format!("{}{inner}", block("")), LAMP);
    compare(&text, &[("n", 0.03), ("h", 0.05), ("inner", 0.05), ("x", 0.1)], 1 << 15);
}
