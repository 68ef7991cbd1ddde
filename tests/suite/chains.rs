//! Light without extent by way of several flat faces in turn: against small lamps that paths find by themselves, against far lights, and derivatives against differences.

use crate::common::*;
use tyndall::error::WarningKind;
use tyndall::render::driver::Mode;
use tyndall::scene::chains::Chains;

/// A floor under a slanted block of glass and milk, and beside a mirror. What the camera sees is the floor.
fn block(depth: u32, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="milk" value="0.3"/><default name="white" value="0.9"/><default name="x" value="0.3"/><default name="n" value="1.5"/>
  <integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>
  <sensor type="perspective"><float name="fov" value="30"/><transform name="to_world"><lookat origin="-3, 0.1, 0.5" target="0, -1, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="milk"><rgb name="sigma_t" value="0.8,1,1.2"/><float name="scale" value="$milk"/><float name="albedo" value="$white"/><phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <shape type="cube" id="block"><transform name="to_world"><scale x="1.2" y="0.3" z="0.8"/><rotate z="1" angle="12"/><translate y="0.8"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf><ref name="interior" id="milk"/></shape>
  <shape type="rectangle" id="floor"><transform name="to_world"><scale value="5"/><rotate x="1" angle="-90"/><translate y="-1"/></transform><bsdf type="diffuse"><float name="reflectance" value="0.6"/></bsdf></shape>
  <shape type="rectangle" id="mirror"><transform name="to_world"><scale x="0.8" y="0.8"/><rotate y="1" angle="-90"/><translate x="1.6" y="0.6"/></transform>
    <bsdf type="conductor"><rgb name="eta" value="0.2,0.9,1.2"/><float name="k" value="2.5"/></bsdf></shape>{light}</scene>"#
    )
}

/// The floor's light is that of a small lamp: what the block lets through, what goes round in it, what the mirror sends back, and what the milk scatters.
#[test]
fn a_point_light_is_a_small_lamp() {
    let point = forward(&block(6, POINT), &[], 1 << 11)[0];
    let lamp = by_chance(&block(6, &lamp(0.2)), 1 << 17);
    for c in 0..3 {
        let se = point.error[c].hypot(lamp.error[c]);
        assert!((point.value[c] - lamp.value[c]).abs() < 4.5 * se, "{c}: {point:?} {lamp:?}");
        assert!(se < 0.02 * lamp.value[c], "{c}: {point:?} {lamp:?}");
    }
    // Several faces in turn bring more than all errors.
    let (_, mut scene) = scene(&block(6, POINT));
    scene.chains = Chains::default();
    let without = estimate(&run(&scene, 1 << 11, 3, Mode::Picture), 0);
    assert!(point.value[1] > 1.15 * without.value[1], "{point:?} {without:?}");
}

const BEAM: &str = r#"<emitter type="collimated"><transform name="to_world"><lookat origin="1, 3, 0" target="0.3, 0.8, 0.1" up="0, 0, 1"/></transform>
  <float name="radius" value="0.5"/><string name="profile" value="$profile"/><float name="irradiance" value="10"/></emitter>"#;

/// A block is the same block as a mesh: by point lights, by suns, by hard and by Gaussian beams, seen from outside and through the milk inside.
#[test]
#[ignore = "make stress"]
fn a_mesh_is_a_block() {
    let dir = tempfile::tempdir().unwrap();
    let sun = r#"<emitter type="directional"><vector name="direction" value="-1, -3, 0"/><float name="irradiance" value="2"/></emitter>"#;
    let beams = ["hard", "gaussian"].map(|p| BEAM.replace("$profile", p));
    for light in [POINT, sun, &beams[0], &beams[1]] {
        let text = block(5, light);
        let facets = block_of_facets(dir.path(), &text);
        let (a, b) = (forward(&text, &[], 1 << 12)[0], forward(&facets, &[], 1 << 12)[0]);
        for c in 0..3 {
            let se = a.error[c].hypot(b.error[c]);
            assert!((a.value[c] - b.value[c]).abs() < 4.5 * se, "{light} {c}: {a:?} {b:?}");
            assert!(se < 0.02 * a.value[c], "{light} {c}: {a:?} {b:?}");
        }
        // What comes by way of facets is more than all errors.
        let (_, mut scene) = scene(&facets);
        assert!(!scene.warnings.iter().any(|w| w.kind == WarningKind::LightBehindGlass), "{:?}", scene.warnings);
        scene.chains = Chains::default();
        let without = estimate(&run(&scene, 1 << 10, 3, Mode::Picture), 0);
        assert!(b.value[1] > 1.1 * without.value[1], "{light} {b:?} {without:?}");
    }
}

/// Media's derivatives are in the record.
#[test]
#[ignore = "make stress"]
fn derivatives_by_media_behind_facets() {
    let dir = tempfile::tempdir().unwrap();
    let text = block_of_facets(dir.path(), &block(5, POINT));
    against_differences(&text, &[("milk", 0.05), ("white", 0.02)], &["all"], 1 << 10, 0.02);
}

/// What is in a block is not before the surfaces that the shadows of its edges end on, smooth or rough: the edges' own faces tell nothing there, as rounding has either of them met.
#[test]
fn shadows_of_facets_are_those_of_the_block() {
    let dir = tempfile::tempdir().unwrap();
    let rough = |text: &str| {
        text.replace(r#"<bsdf type="dielectric">"#, r#"<bsdf type="roughdielectric"><float name="alpha" value="0.3"/>"#)
    };
    let compare = |text: &str, spp: u64, precision: f64| {
        let of = |text: &str| derivatives(text, &["x"], &["light_shadow"], spp)[0];
        let (a, b) = (of(text), of(&block_of_facets(dir.path(), text)));
        println!("{a:?} {b:?}");
        for c in 0..3 {
            let se = a.error[c].hypot(b.error[c]);
            assert!((a.value[c] - b.value[c]).abs() < 4.5 * se, "{c}: {a:?} {b:?}");
            assert!(se < precision * a.value[c].abs(), "{c}: {a:?} {b:?}");
        }
    };
    let (straight, twice) = (block(2, POINT), block(3, POINT));
    compare(&straight, 1 << 12, 0.02);
    compare(&rough(&straight), 1 << 12, 0.02);
    compare(&twice, 1 << 12, 0.05);
}

/// Light from far away is parallel.
#[test]
fn far_lights_are_parallel() {
    let far = r#"<emitter type="point"><point name="position" value="1000, 3000, 0"/><float name="intensity" value="2e7"/></emitter>"#;
    let sun = r#"<emitter type="directional"><vector name="direction" value="-1, -3, 0"/><float name="irradiance" value="2"/></emitter>"#;
    let of = |light: &str| forward(&block(5, light), &[], 1 << 11)[0];
    let (a, b) = (of(far), of(sun));
    let se = b.error[1].hypot(a.error[1]);
    assert!((b.value[1] - a.value[1]).abs() < 4.5 * se && se < 0.03 * b.value[1], "{a:?} {b:?}");
}

/// What the milk does to such light is in the record; where it ends is a term of its own.
#[test]
fn derivatives_by_media() {
    let text = block(5, POINT);
    against_differences(&text, &[("milk", 0.05), ("white", 0.02)], &["all"], 1 << 10, 0.02);
    against_differences(&text, &[("n", 0.05), ("x", 0.1)], &["all"], 1 << 10, 0.02);
}

/// Deeper pictures leave something out, and say so.
#[test]
fn longer_chains_are_warned_of() {
    let warns =
        |depth: u32| scene(&block(depth, POINT)).1.warnings.iter().any(|w| w.kind == WarningKind::LightBehindGlass);
    assert!(!warns(6) && warns(7));
}

/// Faces that lie in one another have no way between them: a warning. A gap mends it.
#[test]
fn faces_that_touch_are_warned_of() {
    let pane = |z: f64| {
        format!(
            r#"{POINT}<shape type="cube"><transform name="to_world"><scale x="0.2" y="0.1" z="0.2"/><translate y="{z}"/></transform><bsdf type="dielectric"/></shape>
  <shape type="cube"><transform name="to_world"><scale x="0.3" y="0.1" z="0.3"/><translate y="4"/></transform><bsdf type="dielectric"/></shape>"#
        )
    };
    let touching = |z: f64| scene(&block(6, &pane(z))).1.chains.touching;
    assert!(touching(4.2) && !touching(4.21));
}

/// A block whose front is its inside is met from outside all the same.
#[test]
fn blocks_turned_inside_out_have_the_same_chains() {
    let of = |text: &str| {
        let chains = scene(text).1.chains;
        (chains.list.len(), chains.list.iter().map(|c| c.asked).sum::<f64>())
    };
    let text = block(5, POINT);
    let turned = text
        .replace(
            r#"<float name="int_ior" value="$n"/><float name="ext_ior" value="1"/>"#,
            r#"<float name="int_ior" value="1"/><float name="ext_ior" value="$n"/>"#,
        )
        .replace(
            r#"<ref name="interior" id="milk"/></shape>"#,
            r#"<ref name="exterior" id="milk"/><boolean name="flip_normals" value="true"/></shape>"#,
        );
    assert!(turned != text && of(&text).0 > 10);
    assert_eq!(of(&text), of(&turned));
}
