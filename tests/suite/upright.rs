//! Refracted light of GGX glass ends with a jump where facets stand upright: derivatives with how that moves, against finite differences, and what they would be without.

use crate::common::{against_differences, derivatives, same_in_chunks};
use tyndall::error::WarningKind;
use tyndall::scene::{SceneDesc, advice};

/// A pane seen aslant, a lamp and a sky behind it.
fn pane() -> String {
    r#"<scene version="3.0.0"><default name="ior" value="1.45"/><default name="out" value="1.1"/><default name="lamp" value="0.6"/><default name="tilt" value="0"/><default name="eye" value="-1.8"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <shape type="rectangle"><transform name="to_world"><scale value="20"/><rotate x="1" angle="$tilt"/><translate z="1"/></transform>
    <bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha" value="0.6"/><float name="int_ior" value="$ior"/><float name="ext_ior" value="$out"/></bsdf>INSIDE</shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.6"/><rotate x="1" angle="80"/><translate x="$lamp" y="1.1" z="0.3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.4"/></bsdf><emitter type="area"><rgb name="radiance" value="4, 5, 6"/></emitter></shape>
  <emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>
  <sensor type="perspective"><float name="fov" value="35"/><transform name="to_world"><lookat origin="$eye, 0.2, 2" target="0, 0, 0.2" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="3"/><integer name="height" value="3"/></film></sensor></scene>"#
    .to_string()
}

/// Fog behind the pane.
fn foggy() -> String {
    let fog = r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.3,0.6,0.9"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>"#;
    pane().replacen("<shape", &format!("{fog}<shape"), 1).replace("INSIDE", r#"<ref name="interior" id="fog"/>"#)
}

/// With and without what jumps: the last number is of red, of a build that left it out (16 times the samples).
fn moves(text: &str, what: &[(&str, f64, f64)], spp: u64) {
    let differences: Vec<_> = what.iter().map(|w| (w.0, w.1)).collect();
    against_differences(text, &differences, &["all"], spp, 0.0);
    let names: Vec<_> = what.iter().map(|w| w.0).collect();
    for (d, (name, _, without)) in derivatives(text, &names, &["all"], spp).iter().zip(what) {
        assert!(d.z(0, *without).abs() > 5.0, "{name}: {d:?}, without {without}");
    }
}

#[test]
fn a_pane_against_differences() {
    let what = [
        ("ior", 0.02, -0.2367),
        ("out", 0.02, 0.3120),
        ("lamp", 0.05, 0.0030),
        ("tilt", 1.0, 0.000666),
        ("eye", 0.05, -0.0071),
    ];
    moves(&pane().replace("INSIDE", ""), &what, 1 << 14);
}

#[test]
fn fog_behind_a_pane_against_differences() {
    let what = [
        ("ior", 0.02, -0.1184),
        ("out", 0.02, 0.1561),
        ("lamp", 0.05, -0.0187),
        ("tilt", 1.0, 0.000411),
        ("eye", 0.05, -0.0090),
    ];
    moves(&foggy(), &what, 1 << 14);
}

/// The pane before a wall that the lamp shines on, and a smooth ball, whose critical angle derivatives by whatever moves look beside.
fn beside_a_ball() -> String {
    let ball = r#"<shape type="sphere"><point name="center" value="50, 0, 0"/><bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="8"/><translate z="-1"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>"#;
    let lamp =
        [r#"angle="80"/><translate x="$lamp" y="1.1" z="0.3""#, r#"angle="180"/><translate x="$lamp" y="1.1" z="0.8""#];
    let sky = r#"<emitter type="constant"><rgb name="radiance" value="0.2"/></emitter>"#;
    let text = pane().replace("INSIDE", "").replace(lamp[0], lamp[1]).replace(sky, "");
    text.replacen("<shape", &format!("{ball}<shape"), 1)
}

/// What else is asked for, and so which paths are walked, changes no derivative.
#[test]
fn beside_critical_angles() {
    let by = |names: &[&str]| derivatives(&beside_a_ball(), names, &["all"], 1 << 15)[0];
    let (alone, moving) = (by(&["ior"]), by(&["ior", "tilt"]));
    let se = alone.error[0].hypot(moving.error[0]);
    let off = alone.value[0] - moving.value[0];
    assert!(off.abs() < 4.5 * se && se < 0.01 * alone.value[0].abs(), "{alone:?} {moving:?}");
}

/// Chunks that are walked again ask for the same light.
#[test]
fn chunks_give_the_same_bits() {
    let text = foggy().replace(r#"name="max_depth" value="4""#, r#"name="max_depth" value="-1""#);
    let ball = r#"<shape type="sphere"><point name="center" value="50, 0, 0"/><bsdf type="dielectric"/></shape>"#;
    for text in [text.clone(), text.replacen("<shape", &format!("{ball}<shape"), 1)] {
        same_in_chunks(&text, &["ior", "tilt"], 4);
    }
}

/// What jumps along a curve on the glass is not computed: of light without extent whoever turns directions or changes an index is told, whoever changes its roughness is not, nor is Beckmann's.
#[test]
fn light_without_extent_is_told() {
    let told = |distribution: &str, alpha: f64, light: &str, name: &str| {
        let text = format!(
            r#"<scene version="3.0.0"><default name="ior" value="1.5"/><default name="x" value="0"/><default name="a" value="{alpha}"/><integrator type="volpath"/>{light}
  <shape type="sphere" id="ball"><bsdf type="roughdielectric"><string name="distribution" value="{distribution}"/><float name="alpha" value="$a"/><float name="int_ior" value="$ior"/><float name="ext_ior" value="1"/></bsdf></shape>
  <sensor type="perspective"><transform name="to_world"><translate x="$x" z="-4"/></transform></sensor></scene>"#
        );
        let desc = SceneDesc::parse(&text, std::path::Path::new("facets.xml"), &[]).unwrap();
        let found = advice::of_parameters(&desc, &[name.to_string()]).unwrap();
        found.iter().filter(|w| w.kind == WarningKind::EdgeOnFacets).count()
    };
    let (sun, sky) = (r#"<emitter type="directional" id="sun"/>"#, r#"<emitter type="constant"/>"#);
    for (distribution, alpha, light, name, expected) in [
        ("ggx", 0.2, sun, "ior", 1),
        ("ggx", 0.2, sun, "x", 1),
        ("ggx", 0.2, sky, "x", 0),
        ("ggx", 0.2, sun, "a", 0),
        ("ggx", 0.009, sun, "x", 0),
        ("beckmann", 0.2, sun, "ior", 0),
    ] {
        assert_eq!(told(distribution, alpha, light, name), expected, "{distribution} {alpha} {light} {name}");
    }
}
