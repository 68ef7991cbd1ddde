//! Light without extent, and beams, by way of a ball of glass or metal: against small lamps that paths find by themselves, against far lights, and derivatives against differences.

use crate::common::*;
use tyndall::error::WarningKind;
use tyndall::render::driver::Mode;
use tyndall::render::plan::Plan;

/// A floor in the light that a ball has bent, and the ball's shadow on it; the ball holds milk. What the camera sees is the floor.
fn caustic(bsdf: &str, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="milk" value="0.6"/><default name="white" value="0.8"/><default name="x" value="4"/><default name="w" value="0.25"/><default name="n" value="1.5"/>
  <integrator type="volpath"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective"><float name="fov" value="42"/><transform name="to_world"><lookat origin="-3, 4, 0" target="-1.7, -1, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="milk"><rgb name="sigma_t" value="0.8,1,1.2"/><float name="scale" value="$milk"/><float name="albedo" value="$white"/><phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <shape type="sphere" id="ball"><point name="center" value="0, 0.2, 0"/><float name="radius" value="0.8"/>{bsdf}</shape>
  <shape type="rectangle" id="floor"><transform name="to_world"><scale value="5"/><rotate x="1" angle="-90"/><translate y="-1"/></transform><bsdf type="diffuse"><float name="reflectance" value="0.6"/></bsdf></shape>{light}</scene>"#
    )
}

const GLASS: &str = r#"<bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf><ref name="interior" id="milk"/>"#;
const METAL: &str =
    r#"<bsdf type="conductor"><rgb name="eta" value="0.2,0.9,1.2"/><float name="k" value="2.5"/></bsdf>"#;
const BEAM: &str = r#"<emitter type="collimated"><transform name="to_world"><lookat origin="4, 3, 0" target="0, 0.2, 0.1" up="0, 1, 0"/></transform>
  <float name="radius" value="$w"/><string name="profile" value="hard"/><float name="irradiance" value="10"/></emitter>"#;

/// Shadow, caustics and what the milk scatters are those of a small lamp, whose light paths find by chance. The lamp's size blurs what falls on the floor by a twentieth of what is seen.
#[test]
fn a_point_light_is_a_small_lamp() {
    for (bsdf, spp) in [(GLASS, 3 << 16), (METAL, 1 << 17)] {
        let point = forward(&caustic(bsdf, POINT), &[], 1 << 13)[0];
        let lamp = by_chance(&caustic(bsdf, &lamp(0.25)), spp);
        for c in 0..3 {
            let se = point.error[c].hypot(lamp.error[c]);
            assert!((point.value[c] - lamp.value[c]).abs() < 4.5 * se, "{c}: {point:?} {lamp:?}");
            assert!(se < 0.015 * lamp.value[c], "{c}: {point:?} {lamp:?}");
        }
    }
    // The ball's part of it is more than all errors: without connections by way of it the shadow is empty.
    let (_, mut scene) = scene(&caustic(GLASS, POINT));
    assert!(!scene.warnings.iter().any(|w| w.kind == WarningKind::LightBehindGlass), "{:?}", scene.warnings);
    let whole = estimate(&run(&scene, 1 << 12, 3, Mode::Picture), 0);
    scene.balls.clear();
    let without = estimate(&run(&scene, 1 << 12, 3, Mode::Picture), 0);
    assert!(whole.value[1] > 1.2 * without.value[1], "{whole:?} {without:?}");
}

/// Light from far away is parallel; a wide beam is such light, too.
#[test]
fn far_lights_are_parallel() {
    let far = r#"<emitter type="point"><point name="position" value="4000, 2800.2, 0"/><float name="intensity" value="47680000"/></emitter>"#;
    let sun = r#"<emitter type="directional"><vector name="direction" value="-4, -2.8, 0"/><float name="irradiance" value="2"/></emitter>"#;
    let beam = r#"<emitter type="collimated"><transform name="to_world"><lookat origin="20, 14.2, 0" target="0, 0.2, 0" up="0, 0, 1"/></transform>
      <float name="radius" value="9"/><string name="profile" value="hard"/><float name="irradiance" value="2"/></emitter>"#;
    let of = |light: &str| forward(&caustic(GLASS, light), &[], 1 << 13)[0];
    let (a, b, c) = (of(far), of(sun), of(beam));
    for other in [a, c] {
        let se = b.error[1].hypot(other.error[1]);
        assert!((b.value[1] - other.value[1]).abs() < 4.5 * se && se < 0.01 * b.value[1], "{b:?} {other:?}");
    }
}

/// What the milk does to such light is in the record; what moves is refused by name.
#[test]
fn derivatives_by_media() {
    let text = caustic(GLASS, POINT);
    against_differences(&text, &[("milk", 0.05), ("white", 0.02)], &["all"], 1 << 12, 0.02);
    for (text, names) in [(&text, ["x", "n"]), (&caustic(GLASS, BEAM), ["w", "n"])] {
        let (desc, _) = scene(text);
        for name in names {
            let refused = Plan::new(&desc, &[name.to_string()]).and_then(|p| p.refuse());
            assert!(refused.is_err(), "{name}");
        }
    }
}

fn warns(text: &str) -> bool {
    scene(text).1.warnings.iter().any(|w| w.kind == WarningKind::LightBehindGlass)
}

/// A light at the ball's centre is no special one.
#[test]
fn a_light_at_the_centre() {
    let at = |x: &str| {
        let light = format!(
            r#"<emitter type="point"><point name="position" value="{x}, 0.2, 0"/><float name="intensity" value="5"/></emitter>"#
        );
        forward(&caustic(GLASS, &light), &[], 1 << 11)[0]
    };
    let (a, b) = (at("0"), at("1e-4"));
    assert!((a.value[1] / b.value[1] - 1.0).abs() < 0.01 && a.value[1] > 0.01, "{a:?} {b:?}");
}

/// What is not all there is said to be so: beams that begin inside, hollow mirrors, balls beside other glass.
#[test]
fn what_is_left_out_is_warned_of() {
    let inside = BEAM.replace(r#"origin="4, 3, 0" target="0, 0.2, 0.1""#, r#"origin="0, 0.2, 0" target="-1, -1, 0""#);
    assert!(!warns(&caustic(GLASS, BEAM)) && !warns(&caustic(METAL, POINT)) && !warns(&caustic(GLASS, POINT)));
    assert!(warns(&caustic(GLASS, &inside)));
    assert!(warns(&caustic(&format!(r#"<boolean name="flip_normals" value="true"/>{METAL}"#), POINT)));
    let pane = r#"<shape type="rectangle"><bsdf type="dielectric"/></shape>"#;
    assert!(!warns(&caustic(GLASS, &format!("{POINT}{pane}"))));
    let deep = |depth: u32| caustic(GLASS, POINT).replace(r#"value="6""#, &format!(r#"value="{depth}""#));
    assert!(!warns(&deep(14)) && warns(&deep(15)));
}

/// Milk in a ball of glass is sheltered from the sun; fog around a hollow whose front is its inside is not, nor what a border of nothing lets light into.
#[test]
fn shelters_are_closed_and_hold_their_medium() {
    let sheltered = |bsdf: &str| scene(&caustic(bsdf, POINT)).1.sheltered;
    assert_eq!(sheltered(GLASS), [true]);
    assert_eq!(sheltered(&format!(r#"<boolean name="flip_normals" value="true"/>{GLASS}"#)), [false]);
    assert_eq!(sheltered(&GLASS.replace("interior\" id", "exterior\" id")), [false]);
    assert_eq!(sheltered(r#"<bsdf type="null"/><ref name="interior" id="milk"/>"#), [false]);
}
