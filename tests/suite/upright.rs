//! Refracted light of GGX glass ends with a jump where facets stand upright: derivatives with how that moves, against finite differences, and what they would be without.

use crate::common::{against_differences, derivatives, forward_of, same_in_chunks};
use tyndall::error::WarningKind;
use tyndall::scene::compile::Orders;
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

/// A pane that light without extent shines through aslant, the edge of what it sends on in the middle of the picture; `beyond`: what else there is.
fn pane_of(light: &str, size: &str, beyond: &str) -> String {
    let eye = if beyond.is_empty() {
        r#"<float name="fov" value="15"/><transform name="to_world"><lookat origin="-1.8, 0.2, 2" target="-1.06, 0.2, 1" up="0, 1, 0"/>"#
    } else {
        r#"<float name="fov" value="5"/><transform name="to_world"><lookat origin="0, 1, 5" target="-0.8, -0.9, 2.2" up="0, 1, 0"/>"#
    };
    format!(
        r#"<scene version="3.0.0"><default name="ior" value="1.45"/><default name="lamp" value="0"/><default name="tilt" value="0"/><default name="h" value="1"/><default name="eye" value="0"/>
  <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
  <shape type="rectangle"><transform name="to_world">{size}<rotate x="1" angle="$tilt"/><translate z="$h"/></transform>
    <bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha" value="0.6"/><float name="int_ior" value="$ior"/><float name="ext_ior" value="1.1"/></bsdf></shape>{beyond}{light}
  <sensor type="perspective">{eye}<translate x="$eye"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor></scene>"#
    )
}

const LARGE: &str = r#"<scale value="4"/>"#;
const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="-0.6, 0.15, 0.5"/><rgb name="irradiance" value="3, 2.5, 2"/></emitter>"#;

/// Against differences, what jumps along the curve on the glass being more than five errors of all.
fn moves_along_a_curve(text: &str, what: &[(&str, f64)], spp: u64) {
    against_differences(text, what, &["all"], spp, 0.0);
    let names: Vec<_> = what.iter().map(|w| w.0).collect();
    let [all, part] = ["all", "light_shadow"].map(|terms| derivatives(text, &names, &[terms], spp));
    for ((all, part), name) in all.iter().zip(&part).zip(names) {
        println!("{name}: {} +- {} of {} +- {}", part.value[0], part.error[0], all.value[0], all.error[0]);
        assert!(part.value[0].abs() > 5.0 * all.error[0].hypot(part.error[0]), "{name}: {part:?} of {all:?}");
    }
}

#[test]
fn a_lamp_through_a_pane_against_differences() {
    let lamp = r#"<emitter type="point"><transform name="to_world"><translate x="0.6" y="0.5" z="-0.3"/><translate x="$lamp"/></transform><rgb name="intensity" value="4, 5, 6"/></emitter>"#;
    let text = pane_of(lamp, LARGE, "");
    moves_along_a_curve(&text, &[("ior", 0.01), ("lamp", 0.02), ("tilt", 0.5), ("h", 0.01), ("eye", 0.02)], 1 << 14);
}

#[test]
fn the_sun_and_a_beam_through_a_pane_against_differences() {
    let text = pane_of(&SUN.replace("-0.6,", "$sun,"), LARGE, "");
    let text = text.replacen(r#"<default name="lamp""#, r#"<default name="sun" value="-0.6"/><default name="lamp""#, 1);
    moves_along_a_curve(&text, &[("ior", 0.01), ("sun", 0.02), ("tilt", 0.5)], 1 << 13);
    let beam = r#"<emitter type="collimated"><transform name="to_world"><lookat origin="0.5, -0.19, -0.3" target="-1.06, 0.2, 1" up="0,1,0"/></transform><float name="radius" value="0.4"/><string name="profile" value="hard"/><float name="irradiance" value="10"/></emitter>"#;
    moves_along_a_curve(&pane_of(beam, LARGE, ""), &[("ior", 0.01)], 1 << 13);
}

/// The floor before a small pane sees the edge from each of its points.
#[test]
fn a_floor_before_a_pane_against_differences() {
    let floor = r#"<shape type="rectangle"><transform name="to_world"><scale value="1.5"/><rotate x="1" angle="-90"/><translate y="-0.9" z="2.6"/></transform><bsdf type="diffuse"><float name="reflectance" value="0.7"/></bsdf></shape>"#;
    let small = r#"<scale value="0.2"/><translate x="-0.05" y="-0.58"/>"#;
    let sun = SUN.replace("0.15", "-0.25");
    moves_along_a_curve(&pane_of(&sun, small, floor), &[("ior", 0.02)], 1 << 16);
}

/// A plane sees no edge on itself, in whatever direction rounding puts a point of it.
#[test]
fn a_plane_does_not_see_itself() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("pane.obj");
    std::fs::write(&path, "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n").unwrap();
    let lamp = r#"<emitter type="point"><transform name="to_world"><translate x="0.6" y="0.5" z="-0.3"/><translate x="$lamp"/></transform></emitter>"#;
    let pane = pane_of(lamp, LARGE, "").replace(r#"name="tilt" value="0""#, r#"name="tilt" value="31""#);
    let file = format!(
        r#"<shape type="obj"><string name="filename" value="{}"/><boolean name="face_normals" value="true"/>"#,
        path.display()
    );
    let facets = pane.replacen(r#"<shape type="rectangle">"#, &file, 1);
    assert_ne!(pane, facets);
    for text in [pane, facets] {
        let of = |order: u32| {
            let orders = Orders { first: order, last: order };
            forward_of(&text, orders, &["ior", "lamp", "tilt"], &["light_shadow"], 1 << 14).split_off(1)
        };
        // The camera does.
        let [seen, none] = [1, 2].map(of);
        assert!(seen.iter().all(|e| e.value[0].abs() > 5.0 * e.error[0]), "{seen:?}");
        assert!(none.iter().all(|e| e.value.is_zero()), "{none:?}");
    }
}

/// Where camera and lamp are as high over the glass, by indices, the circle is a straight line.
#[test]
fn a_straight_edge() {
    let of = |z: f64| {
        let lamp = format!(
            r#"<emitter type="point"><transform name="to_world"><translate x="2.5" y="0.5" z="{z}"/><translate x="$lamp"/></transform></emitter>"#
        );
        let text = pane_of(&lamp, LARGE, "")
            .replace(r#"name="h" value="1""#, r#"name="h" value="0""#)
            .replace(r#"name="ior" value="1.45""#, r#"name="ior" value="1.5""#)
            .replace(r#"name="ext_ior" value="1.1""#, r#"name="ext_ior" value="1""#)
            .replace(r#"value="15"/>"#, r#"value="50"/>"#)
            .replace(r#"origin="-1.8, 0.2, 2" target="-1.06, 0.2, 1""#, r#"origin="-3, 0.2, 3" target="-1, 0.2, 0""#);
        derivatives(&text, &["ior"], &["light_shadow"], 1 << 12)[0]
    };
    // The same random numbers.
    let beside = of(-2.0001);
    for near in [-2.0, -2.00000000000001, -2.0000001].map(of) {
        assert!((near.value[0] - beside.value[0]).abs() < 0.002 * beside.value[0].abs(), "{near:?} {beside:?}");
    }
    assert!(beside.value[0].abs() > 10.0 * beside.error[0], "{beside:?}");
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

/// What jumps along a curve on glass that is round, or by way of other glass, is not computed: of light without extent whoever turns directions or changes an index is told, whoever changes its roughness is not, nor is Beckmann's.
#[test]
fn light_without_extent_is_told() {
    let of = |shape: &str, distribution: &str, alpha: f64, light: &str, name: &str| {
        let text = format!(
            r#"<scene version="3.0.0"><default name="ior" value="1.5"/><default name="x" value="0"/><default name="a" value="{alpha}"/><integrator type="volpath"/>{light}
  <shape type="{shape}" id="ball"><bsdf type="roughdielectric"><string name="distribution" value="{distribution}"/><float name="alpha" value="$a"/><float name="int_ior" value="$ior"/><float name="ext_ior" value="1"/></bsdf></shape>
  <sensor type="perspective"><transform name="to_world"><translate x="$x" z="-4"/></transform></sensor></scene>"#
        );
        let desc = SceneDesc::parse(&text, std::path::Path::new("facets.xml"), &[]).unwrap();
        let found = advice::of_parameters(&desc, &[name.to_string()]).unwrap();
        found.iter().filter(|w| w.kind == WarningKind::EdgeOnFacets).count()
    };
    let told = |distribution: &str, alpha: f64, light: &str, name: &str| of("sphere", distribution, alpha, light, name);
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
    let mirror = format!(r#"{sun}<shape type="rectangle"><bsdf type="conductor"/></shape>"#);
    assert_eq!([sun, &mirror].map(|light| of("cube", "ggx", 0.2, light, "ior")), [0, 1]);
}
