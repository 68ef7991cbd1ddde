//! What moves by way of smooth interfaces: indices, interfaces, cameras and beams, against [T] section 11 (D1, D2) and finite differences.

use crate::common::{
    against_differences, check, derivatives, difference, forward, forward_of, job, params, same_in_chunks, scene,
};
use std::sync::Arc;
use tyndall::error::WarningKind;
use tyndall::math::Rgb;
use tyndall::math::rng::Rng;
use tyndall::params::Forward;
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Plan;
use tyndall::scene::compile::Orders;
use tyndall::scene::critical::Critical;
use tyndall::scene::{Scene, SceneDesc, advice};
use tyndall::transport::{Beginning, PathRecord, Sweep, SweepFacts, Tally};

/// [T] D1 and D2: a beam and a camera ray through a plane interface, light that scatters once.
fn beam(profile: &str, width: f64) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="n" value="1.5"/><default name="bx" value="1.4"/><default name="cx" value="-0.4"/><default name="h" value="0"/>
  <default name="w" value="{width}"/><default name="g" value="0.3"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><scale value="1e-9"/><lookat origin="0, 0.15, 2" target="0.35, 0.05, 1" up="0, 1, 0"/><translate x="$cx"/></transform>
    <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.6"/><float name="albedo" value="0.8333333333333333"/><phase type="hg"><float name="g" value="$g"/></phase></medium>
  <shape type="rectangle"><transform name="to_world"><scale value="1000"/><translate z="$h"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf><ref name="interior" id="fog"/></shape>
  <emitter type="collimated"><transform name="to_world"><lookat origin="0, -0.05, 1.5" target="-0.45, 0, 0.5" up="0, 1, 0"/><translate x="$bx"/></transform>
    <float name="radius" value="$w"/><string name="profile" value="{profile}"/><float name="irradiance" value="5"/></emitter></scene>"#
    )
}

#[test]
fn d1_gaussian_beam_through_a_plane() {
    let names = ["n", "bx", "cx", "w", "h", "g"];
    let truths =
        [-0.00735093818301, -0.0180619940373, 0.0180619940373, 0.0454462080755, -0.00835238371546, -0.0126750893882];
    let e = forward(&beam("gaussian", 0.25), &names, 1 << 19);
    check("L", &e[0], 0.004461070059817, 0.005);
    for ((e, name), truth) in e[1..].iter().zip(names).zip(truths) {
        check(&format!("dL/d{name}"), e, truth, 0.005);
    }
}

#[test]
fn d2_hard_beam_through_a_plane() {
    let text = beam("hard", 0.35);
    let names = ["n", "bx", "cx", "h", "w"];
    let truths = [-0.0314604028392, -0.0539499370253, 0.0539499370253, -0.0390818340275, 0.0861131441772];
    let e = forward(&text, &names, 1 << 16);
    check("L", &e[0], 0.02005692160479, 0.005);
    for ((e, name), truth) in e[1..].iter().zip(names).zip(truths) {
        // One exact crossing a ray; a room's rays are a whole number near rate x samples, so that one of some 2^18 may be missing.
        if e.error[0] > 1e-6 {
            check(&format!("dL/d{name}"), e, truth, 0.005);
        } else {
            assert!((e.value[0] / truth - 1.0).abs() < 1e-5, "{name}: {} {truth}", e.value[0]);
        }
    }
    // The edge has a room of its own, and nothing is right without it.
    check("interior of dL/dn", &derivatives(&text, &["n"], &["interior"], 1 << 16)[0], -0.0349546684221, 0.005);
    let edge = &derivatives(&text, &["n"], &["hard_profile"], 64)[0];
    assert!((edge.value[0] / 0.00349426558293 - 1.0).abs() < 1e-6, "{}", edge.value[0]);
    assert_eq!(derivatives(&text, &["bx"], &["interior"], 256)[0].value[0], 0.0);
}

/// [T] D3, as D1 with a point light: by connections through the plane, in motion too.
#[test]
fn d3_point_light_through_a_plane() {
    let text = beam("gaussian", 0.25).replace(r#""n" value="1.5""#, r#""n" value="1.33""#);
    let (head, tail) = text.split_once(r#"<emitter type="collimated">"#).unwrap();
    let lit = |light: &str| format!("{head}{light}{}", tail.split_once("</emitter>").unwrap().1);
    let point = lit(r#"<default name="px" value="0.3"/><default name="pz" value="1.2"/>
  <emitter type="point"><point name="position" value="$px, 0.2, $pz"/><float name="intensity" value="10"/></emitter>"#);
    let (desc, sc) = scene(&point);
    let glass = |w: &&tyndall::error::Warning| w.kind == tyndall::error::WarningKind::LightBehindGlass;
    assert!(!sc.warnings.iter().any(|w| glass(&w)), "{:?}", sc.warnings);
    let names = ["g".to_string()];
    Plan::new(&desc, &names).and_then(|p| p.refuse()).unwrap();
    let e = forward(&point, &["g"], 1 << 16);
    check("L", &e[0], 0.02792170348, 0.005);
    // All light comes through the plane, so all of these are its motion's.
    let e = forward(&point, &["px", "pz"], 1 << 18);
    check("dL/dpx", &e[1], 0.0038298153, 0.005);
    check("dL/dpz", &e[2], -0.035712836, 0.005);
    // The phase function's share of a connection through the plane.
    against_differences(&point, &[("g", 0.01)], &["all"], 1 << 13, 0.01);
    // And what moves the vertices, the plane and its index does.
    let names = ["n", "h", "cx"];
    let truths = [-0.041014522, 0.037785103, -0.0038298153];
    let e = forward(&point, &names, 3 << 15);
    for ((e, name), truth) in e[1..].iter().zip(names).zip(truths) {
        check(&format!("dL/d{name}"), e, truth, 0.005);
    }
    // A light at infinity is what a far point is.
    let far = lit(
        r#"<emitter type="point"><point name="position" value="3000, 1000, 8000"/><float name="intensity" value="74000000"/></emitter>"#,
    );
    let sun = lit(
        r#"<emitter type="directional"><vector name="direction" value="-3,-1,-8"/><float name="irradiance" value="1"/></emitter>"#,
    );
    let (a, b) = (forward(&far, &[], 1 << 14)[0], forward(&sun, &[], 1 << 14)[0]);
    let se = a.error[0].hypot(b.error[0]);
    assert!((a.value[0] - b.value[0]).abs() < 4.5 * se && se < 0.015 * b.value[0], "{a:?} {b:?}");
}

/// Fog in a cube, under water over a floor, seen from the air.
fn pond(light: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="x" value="0.4"/><default name="z" value="1.1"/><default name="dx" value="0.3"/><default name="cut" value="35"/><default name="beam" value="10"/>
  <default name="n" value="1.33"/><default name="cam" value="-3"/><default name="h" value="0"/><default name="tilt" value="0"/>
  <integrator type="volpath"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective"><float name="fov" value="28"/><transform name="to_world"><lookat origin="0.3, $cam, 2.5" target="0, 0, -0.9" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="tent"/></film></sensor>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.9,1.4,0.5"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.5"/></phase></medium>
  <shape type="rectangle" id="water"><transform name="to_world"><scale value="9"/><rotate x="1" y="0.3" angle="$tilt"/><translate z="$h"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.6"/><rotate x="1" angle="20"/><translate z="-0.95"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle" id="floor"><transform name="to_world"><scale value="2"/><translate z="-1.9"/></transform><bsdf type="diffuse"/></shape>{light}</scene>"#
    )
}

const LAMP: &str = r#"<emitter type="point" id="lamp"><point name="position" value="$x, 0.3, $z"/><float name="intensity" value="10"/></emitter>"#;
const SPOT: &str = r#"<emitter type="spot" id="spot"><transform name="to_world"><lookat origin="$x, 0.3, $z" target="$dx, -0.1, -1" up="0, 1, 0"/></transform>
  <float name="intensity" value="10"/><float name="cutoff_angle" value="$cut"/><float name="beam_width" value="$beam"/></emitter>"#;
const SUN: &str = r#"<emitter type="directional" id="sun"><vector name="direction" value="$dx, 0.2, -1"/><float name="irradiance" value="3"/></emitter>"#;

/// Its index, its surface and the camera by light that comes through it, or is mirrored, with the floor's edges seen through it.
#[test]
fn a_pond_in_motion_against_differences() {
    let moves = [("n", 0.02), ("h", 0.02), ("tilt", 1.0), ("cam", 0.02)];
    for (light, moves) in [(LAMP, &moves[..]), (SPOT, &moves[..1]), (SUN, &moves[..3])] {
        against_differences(&pond(light), moves, &["all"], 1 << 12, 0.02);
    }
    // A mirror in place of the water, all below it.
    let glass = r#"<bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf>"#;
    let metal = r#"<bsdf type="twosided"><bsdf type="conductor"><float name="eta" value="0.4"/><float name="k" value="$n"/></bsdf></bsdf>"#;
    let mirror = pond(LAMP)
        .replace(r#"name="z" value="1.1""#, r#"name="z" value="-0.15""#)
        .replace(glass, metal)
        .replace("$cam, 2.5", "$cam, -0.4");
    against_differences(&mirror, &moves, &["all"], 1 << 12, 0.02);
}

/// The same under a pane of glass in the air, without the water: light that passes both of its faces, and what goes to and fro between them.
fn window(light: &str) -> String {
    let water = pond(light);
    let (a, b) =
        (water.find(r#"<shape type="rectangle" id="water">"#).unwrap(), water.find(r#"<shape type="cube">"#).unwrap());
    let face = |id: &str, at: &str| {
        format!(
            r#"<shape type="rectangle" id="{id}"><transform name="to_world"><scale value="9"/>{at}</transform>
    <bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf></shape>"#
        )
    };
    let upper = face("upper", r#"<translate z="$h"/>"#);
    let lower =
        face("lower", r#"<rotate x="1" angle="180"/><rotate x="1" y="0.3" angle="$tilt"/><translate z="-0.2"/>"#);
    format!("{}{upper}{lower}{}", &water[..a], &water[b..])
        .replace(r#"name="n" value="1.33""#, r#"name="n" value="1.5""#)
        .replace(r#"name="max_depth" value="6""#, r#"name="max_depth" value="9""#)
}

/// Its index, either face, the camera and the light, by chains of two faces and more.
#[test]
#[ignore = "make stress"]
fn a_window_in_motion_against_differences() {
    let moves = [("n", 0.02), ("h", 0.02), ("tilt", 1.0), ("cam", 0.02)];
    let own = [("x", 0.02), ("z", 0.02)];
    let turned = ("dx", 0.02);
    // What a spot and the sun do not do as the lamp does.
    for (light, moves, own) in
        [(LAMP, &moves[..], &own[..]), (SPOT, &moves[..1], &[turned]), (SUN, &moves[..2], &[turned])]
    {
        let all: Vec<_> = moves.iter().chain(own).copied().collect();
        against_differences(&window(light), &all, &["all"], 1 << 12, 0.02);
    }
}

/// Light that two mirrors throw to and fro has parallel lines; a dark cube stands on one of them, and what lies on which is told by place.
#[test]
fn lines_between_mirrors_are_told_apart() {
    let mirror = |id: &str, at: &str| {
        format!(
            r#"<shape type="rectangle" id="{id}"><transform name="to_world"><scale value="60"/>{at}</transform><bsdf type="conductor"><float name="eta" value="0.2"/><float name="k" value="3.9"/></bsdf></shape>"#
        )
    };
    let upper = mirror("upper", r#"<rotate x="1" angle="180"/><rotate y="1" angle="$a"/><translate z="1"/>"#);
    let lower = mirror("lower", r#"<rotate y="1" angle="$b"/><translate z="-1"/>"#);
    let text = format!(
        r#"<scene version="3.0.0"><default name="a" value="0"/><default name="b" value="0"/>
  <integrator type="volpath"><integer name="max_depth" value="5"/></integrator>
  <sensor type="perspective"><float name="fov" value="3"/><transform name="to_world"><lookat origin="0, -0.8, 0.5" target="0, 0, 0.5" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="2"/><integer name="height" value="2"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="thin"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.2"/></medium>
  <medium type="homogeneous" id="dark"><float name="sigma_t" value="6"/><float name="albedo" value="0"/></medium>{upper}{lower}
  <shape type="cube"><transform name="to_world"><scale value="0.03"/><translate z="0.5"/></transform><bsdf type="null"/><ref name="interior" id="thin"/></shape>
  <shape type="cube"><transform name="to_world"><scale x="0.02" y="0.05" z="0.35"/><translate x="0.32" z="-0.25"/></transform><bsdf type="null"/><ref name="interior" id="dark"/></shape>
  <emitter type="point"><point name="position" value="0.4, 0, 0.5"/><float name="intensity" value="10"/></emitter></scene>"#
    );
    let twice = Orders { first: 3, last: 3 };
    let e = forward_of(&text, twice, &["a", "b"], &["all"], 1 << 12);
    for (e, name) in e[1..].iter().zip(["a", "b"]) {
        let fd = difference(&text, twice, name, 0.2, 1 << 12);
        let se = e.error[0].hypot(fd.error[0]);
        println!("{name}: {} +- {} fd {} +- {}", e.value[0], e.error[0], fd.value[0], fd.error[0]);
        // Taken for one another they are off by 2e-5.
        assert!((e.value[0] - fd.value[0]).abs() <= 5.0 * se + 2e-7 && se < 2e-6, "{name}: {e:?} {fd:?}");
    }
}

#[test]
fn lights_over_a_pond_against_differences() {
    let place = [("x", 0.02), ("z", 0.02)];
    against_differences(&pond(LAMP), &place, &["all"], 1 << 13, 0.02);
    let all = [place[0], place[1], ("dx", 0.02), ("cut", 0.5), ("beam", 0.5)];
    against_differences(&pond(SPOT), &all, &["all"], 1 << 12, 0.02);
    against_differences(&pond(SUN), &[("dx", 0.02)], &["all"], 1 << 13, 0.02);
}

#[test]
#[ignore = "make stress"]
fn lights_over_and_under_a_pond_against_differences() {
    let place = [("x", 0.02), ("z", 0.02)];
    // Through fog on both sides of the water, whose border it passes before and behind it.
    let across = pond(LAMP)
        .replace(r#"<scale value="0.6"/><rotate x="1" angle="20"/><translate z="-0.95"/>"#, r#"<scale value="0.35"/>"#);
    assert_ne!(across, pond(LAMP));
    against_differences(&across, &[("x", 0.02), ("z", 0.02), ("n", 0.02)], &["all"], 1 << 13, 0.02);
    // From below, at the floor and the fog by way of the mirrored light as well.
    let below = pond(LAMP).replace(r#"name="z" value="1.1""#, r#"name="z" value="-0.15""#);
    against_differences(&below, &place, &["all"], 1 << 12, 0.02);
    let glass = r#"<bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf>"#;
    let metal = r#"<bsdf type="twosided"><bsdf type="conductor"/></bsdf>"#;
    let mirror = below
        .replace(glass, metal)
        .replace(r#"<default name="n" value="1.33"/>"#, "")
        .replace("$cam, 2.5", "$cam, -0.4");
    against_differences(&mirror, &place, &["all"], 1 << 12, 0.02);
}

/// Where indices are nearly alike the water is hardly there: the derivative is that of the light without it, which takes other ways through the program.
#[test]
fn water_of_the_index_of_air_moves_light_as_air() {
    let names = ["x", "z"];
    let wet = pond(LAMP).replace(r#"name="n" value="1.33""#, r#"name="n" value="1.0000001""#);
    let (a, b) =
        (wet.find(r#"<shape type="rectangle" id="water">"#).unwrap(), wet.find(r#"<shape type="cube">"#).unwrap());
    let dry =
        format!("{}{}", &wet[..a], &wet[b..]).replace(r#"name="max_depth" value="6""#, r#"name="max_depth" value="4""#);
    let real = forward(&pond(LAMP), &names, 1 << 13);
    let (wet, dry) = (forward(&wet, &names, 1 << 13), forward(&dry, &names, 1 << 13));
    for k in 0..3 {
        for c in 0..3 {
            let se = wet[k].error[c].hypot(dry[k].error[c]);
            let (w, d, r) = (wet[k].value[c], dry[k].value[c], real[k].value[c]);
            println!("{k} {c}: {w} {d} +- {se}, of water {r}");
            assert!((w - d).abs() <= 5.0 * se + 1e-5 * d.abs(), "{k} {c}: {w} {d} +- {se}");
            // The comparison can tell them apart.
            let told = k == 0 || (k, c) == (2, 0);
            assert!(!told || (r - d).abs() > 8.0 * se, "{k} {c}: {r} {d} +- {se}");
        }
    }
}

/// What may cast a shadow by way of the water is refused, with its name.
#[test]
fn shadows_by_way_of_a_pane_are_refused() {
    let of = |text: &str, names: &[&str]| {
        let (desc, sc) = scene(text);
        let names: Vec<String> = names.iter().map(|n| n.to_string()).collect();
        let p = sc.param_set(&desc, &names).unwrap();
        job(&sc, 2, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let rejected = |text: &str, what: &str| {
        let error = of(text, &["x"]);
        assert!(error.contains(what), "{what}: {error}");
    };
    assert_eq!(of(&pond(LAMP), &["x"]), "");
    let with = |more: &str| pond(LAMP).replace("</scene>", &format!("{more}</scene>"));
    rejected(
        &with(
            r#"<shape type="sphere" id="ball"><point name="center" value="0, 1, -0.5"/><float name="radius" value="0.1"/></shape>"#,
        ),
        "ball",
    );
    rejected(
        &with(
            r#"<shape type="rectangle" id="leaf"><transform name="to_world"><scale value="0.1"/><translate z="-0.5"/></transform></shape>"#,
        ),
        "leaf",
    );
    rejected(&pond(LAMP).replace(r#"<scale value="9"/>"#, r#"<scale value="0.5"/>"#), "the border of `water`");
    rejected(&pond(LAMP).replace(r#"name="x" value="0.4""#, r#"name="x" value="12""#), "the border of `water`");
    let low = pond(SUN).replace(r#"name="dx" value="0.3""#, r#"name="dx" value="30""#);
    assert!(of(&low, &["dx"]).contains("the border of `water`"));
    rejected(&pond(LAMP).replace(r#"name="z" value="1.1""#, r#"name="z" value="-0.9""#), "is inside a medium");
    rejected(&pond(SPOT).replace(r#"name="beam" value="10""#, r#"name="beam" value="35""#), "hard edge");
    let flipped = r#"<shape type="cube"><boolean name="flip_normals" value="true"/>"#;
    rejected(&pond(LAMP).replace(r#"<shape type="cube">"#, flipped), "has no end outside");
    let endless = pond(LAMP).replace(r#"</bsdf></shape>"#, r#"</bsdf><ref name="interior" id="fog"/></shape>"#);
    rejected(&endless, "something else is there");
    rejected(
        &with(
            r#"<shape type="disk" id="glass"><transform name="to_world"><translate z="2"/></transform><bsdf type="dielectric"/></shape>"#,
        ),
        "cannot be differentiated yet",
    );
    // Together with what turns the rays, too.
    assert_eq!(of(&pond(LAMP), &["x", "cam", "n", "h"]), "");
    // A medium up to the water's own plane: what opens between them is seen on one side of the motion only.
    let flush = pond(LAMP).replace(r#"<rotate x="1" angle="20"/><translate z="-0.95"/>"#, r#"<translate z="-0.6"/>"#);
    assert_ne!(flush, pond(LAMP));
    assert_eq!(of(&flush, &["x", "n", "cam"]), "");
    assert!(["h", "tilt"].iter().all(|name| of(&flush, &[name]).contains("water")), "{}", of(&flush, &["h"]));
    // Several faces.
    for (light, name) in [(LAMP, "x"), (SPOT, "x"), (SUN, "dx")] {
        assert_eq!(of(&window(light), &[name, "n", "h", "cam"]), "", "{name}");
        let lower = r#"<scale value="9"/><rotate x="1" angle="180"/>"#;
        let narrow = window(light).replace(lower, r#"<scale value="1.5"/><rotate x="1" angle="180"/>"#);
        assert!(of(&narrow, &["n"]).contains("the border of `lower`"), "{name}");
        // Large faces aslant to the axes, in boxes that meet.
        let turned = window(light).replace(r#"<scale value="9"/>"#, r#"<scale value="9"/><rotate z="1" angle="5"/>"#);
        let turned = turned.replace(r#"<translate z="$h"/>"#, r#"<translate z="$h"/><rotate x="1" angle="2"/>"#);
        let turned = turned.replace(r#"<translate z="-0.2"/>"#, r#"<translate z="-0.2"/><rotate x="1" angle="2"/>"#);
        assert_eq!(of(&turned, &[name, "n", "h", "cam"]), "", "{name}");
        let aslant = window(light).replace(r#"name="tilt" value="0""#, r#"name="tilt" value="3""#);
        assert!(of(&aslant, &[name]).contains("are not parallel"), "{name}: {}", of(&aslant, &[name]));
        assert!(of(&aslant, &["n"]).contains("are not parallel"), "{name}");
    }
    let narrow = pond(LAMP).replace(r#"<scale value="9"/>"#, r#"<scale value="0.5"/>"#);
    assert!(["n", "h", "cam"].iter().all(|name| of(&narrow, &[name]).contains("the border of `water`")));
    let lifted = pond(LAMP).replace(r#"<translate z="-1.9"/>"#, r#"<translate z="-1.9"/><translate x="$x"/>"#);
    assert!(of(&lifted, &["x"]).contains("cannot be differentiated yet"));
    let (desc, _) = scene(&pond(LAMP));
    let plan = |names: &[&str]| Plan::new(&desc, &names.iter().map(|n| n.to_string()).collect::<Vec<_>>()).unwrap();
    assert!([&["x"][..], &["x", "cam"], &["n"]].iter().all(|names| plan(names).refuse().is_ok()));
}

/// A point light over a mirror of glass lights a wall by way of it as its image does.
#[test]
fn a_pane_mirrors_a_point_light() {
    let text = |light: &str, pane: &str| {
        format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="3"/></integrator>{pane}
  <shape type="rectangle"><transform name="to_world"><translate z="-1"/></transform><bsdf type="diffuse"/></shape>{light}
  <sensor type="perspective"><float name="fov" value="20"/><transform name="to_world"><lookat origin="0, 0.2, 3" target="0, 0.2, -1" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film></sensor></scene>"#
        )
    };
    let point = |y: f64, i: f64| {
        format!(
            r#"<emitter type="point"><point name="position" value="0.1,{y},1"/><float name="intensity" value="{i}"/></emitter>"#
        )
    };
    let pane = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="9"/><translate y="-1.5"/></transform>
      <bsdf type="conductor"/></shape>"#;
    let both = forward(&text(&point(0.5, 1.0), pane), &[], 1 << 10)[0];
    let images = forward(&text(&format!("{}{}", point(0.5, 1.0), point(-3.5, 1.0)), ""), &[], 1 << 10)[0];
    assert!((both.value[0] / images.value[0] - 1.0).abs() < 5e-3, "{both:?} {images:?}");
}

/// A ball of glass and fog before an environment.
const BALL: &str = r#"<scene version="3.0.0"><default name="ior" value="1.4"/><default name="x" value="0.1"/><default name="r" value="0.8"/><default name="cam" value="0.3"/><default name="yaw" value="0"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="32"/><transform name="to_world"><lookat origin="$cam, 0.4, 4" target="0, 0, 0" up="0, 1, 0"/><rotate y="1" angle="$yaw"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="6"/><rfilter type="tent"/></film></sensor>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1.5,2,1"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <shape type="sphere"><point name="center" value="$x, 0, 0"/><float name="radius" value="$r"/>
    <bsdf type="dielectric"><float name="int_ior" value="$ior"/><float name="ext_ior" value="1"/></bsdf><ref name="interior" id="fog"/></shape>
  <emitter type="envmap"><string name="filename" value="FOLDER/scenes/fire/forest_sky.exr"/><float name="scale" value="0.3"/></emitter></scene>"#;

fn ball() -> String {
    BALL.replace("FOLDER", env!("CARGO_MANIFEST_DIR"))
}

#[test]
fn a_ball_of_glass_and_fog_against_differences() {
    let what = [("ior", 0.02), ("r", 0.02), ("cam", 0.02), ("yaw", 0.5)];
    against_differences(&ball(), &what, &["all"], 1 << 13, 0.02);
}

/// Derivatives look beside the critical angle: without that single paths rule. Fixed numbers; the values agree with differences above.
#[test]
fn scores_beside_the_critical_angle_have_a_second_moment() {
    // Under an even sky: a sun that few paths find would rule, too.
    let (head, tail) = (ball(), r#"<emitter type="constant"/></scene>"#);
    let text = format!("{}{tail}", head.split_once("<emitter").unwrap().0);
    let (desc, mut sc) = scene(&text);
    let p = params(&desc, &sc, &["ior"]);
    // Of the interior, and the largest of all squares over their sum.
    let moments = |sc: &Scene| -> [f64; 2] {
        let facts = Arc::new(SweepFacts::of(sc, &sc.sensors[0], &p).unwrap());
        let sweep = Sweep { scene: sc, set: &sc.settings, params: &p, facts, sensor: &sc.sensors[0] };
        let (mut rec, sensor) = (PathRecord::new(), &sc.sensors[0]);
        let (n, streams) = (1 << 17, 8);
        let (mut sum, mut largest) = (0.0, 0.0f64);
        for (stream, i) in (0..streams).flat_map(|stream| (0..n).map(move |i| (5 + stream, i))) {
            let mut rng = Rng::keyed(7, 1, stream + 100, i);
            let (o, w) = sensor.ray(2.0 + 2.0 * rng.uniform(), 2.0 + 2.0 * rng.uniform());
            let mut sink = Forward::new(&p);
            let rng = [Rng::keyed(7, 1, stream, i), Rng::keyed(7, 2, stream, i)];
            sweep.sample(&Beginning::new(rng[0], o, w, None), rng[1], &mut rec, &mut sink, &mut Tally::default());
            let square = sink.image[0].mean().powi(2);
            (sum, largest) = (sum + square, largest.max(square));
        }
        [sum / (n * streams) as f64, largest / sum]
    };
    let with = moments(&sc);
    sc.critical = Critical::default();
    let without = moments(&sc);
    println!("second moment and share of the largest {with:?}, without {without:?}");
    // What the largest is without is itself a matter of luck: 0.25 to 0.5.
    assert!(with[1] < 0.1 && without[1] > 5.0 * with[1] && without[0] > 5.0 * with[0], "{with:?} {without:?}");
}

/// Where indices agree the interface is not there, yet the index has a derivative.
#[test]
fn an_index_of_one_has_a_derivative() {
    let text = ball().replace(r#"name="ior" value="1.4""#, r#"name="ior" value="1""#);
    against_differences(&text, &[("ior", 0.01)], &["all"], 1 << 14, 0.02);
}

/// A beam by way of a mirror, in fog of several scatterings and colours.
const MIRROR: &str = r#"<scene version="3.0.0"><default name="angle" value="40"/><default name="up" value="0"/><default name="bx" value="0.1"/><default name="k" value="2"/><default name="r" value="0.2"/>
  <integrator type="volpath"><integer name="max_depth" value="5"/></integrator>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.4,0.6,0.3"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>
  <sensor type="perspective"><float name="fov" value="30"/><ref id="fog"/><transform name="to_world"><lookat origin="0.3, 0.5, 4" target="0.3, 0.5, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="tent"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="40"/><rotate z="1" angle="$angle"/><translate y="$up"/></transform>
    <bsdf type="conductor"><rgb name="eta" value="0.3,0.2,0.5"/><float name="k" value="$k"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="400"/><translate y="2.6"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <emitter type="collimated"><transform name="to_world"><rotate x="1" angle="90"/><translate x="$bx" y="3"/></transform>
    <float name="radius" value="$r"/><string name="profile" value="gaussian"/><float name="irradiance" value="5"/></emitter></scene>"#;

#[test]
#[ignore = "make stress"]
fn a_beam_by_way_of_a_mirror_against_differences() {
    let what = [("angle", 1.0), ("up", 0.02), ("bx", 0.02), ("k", 0.05), ("r", 0.01)];
    against_differences(MIRROR, &what, &["all"], 1 << 13, 0.02);
}

#[test]
fn forward_dot_v_equals_reverse() {
    for (text, names) in [
        (ball(), vec!["ior", "x", "r", "cam", "yaw"]),
        (MIRROR.into(), vec!["angle", "up", "bx", "k", "r"]),
        (beam("hard", 0.35), vec!["n", "bx", "h", "w"]),
        (pond(SPOT), vec!["x", "z", "dx", "cut", "beam"]),
        (pond(SUN), vec!["dx"]),
    ] {
        let (desc, sc) = scene(&text);
        let p = params(&desc, &sc, &names);
        let f = job(&sc, 32, 3, Mode::Forward(&p)).run(&|_| {}).unwrap();
        let pixels = f.film.spec().pixels();
        let v: Vec<Rgb> = (0..pixels).map(|i| Rgb::splat(0.1 + (i % 3) as f64)).collect();
        let r = Job { split: false, ..job(&sc, 32, 3, Mode::Reverse(&p, &v)) }.run(&|_| {}).unwrap();
        let gradient = p.pull_back(&r.gradient.unwrap().0);
        for (k, name) in names.iter().enumerate() {
            let dot: f64 = (0..pixels).map(|i| f.film.mean(k + 1, i).dot(v[i])).sum();
            let scale: f64 = (0..pixels).map(|i| (f.film.mean(k + 1, i) * v[i]).abs().sum()).sum();
            assert!(scale > 0.0 && (dot - gradient[k]).abs() <= 1e-9 * scale, "{name}: {dot} {}", gradient[k]);
        }
    }
}

/// Rays behind many interfaces are told again for every chunk of a long path.
#[test]
fn chunks_give_the_same_bits() {
    let many = |text: String, depth: &str| {
        text.replace(&format!(r#"name="max_depth" value="{depth}""#), r#"name="max_depth" value="40""#)
    };
    same_in_chunks(&many(ball(), "4"), &["ior", "x", "cam"], 6);
    // Where nothing but a light moves a record keeps little else.
    same_in_chunks(&many(pond(LAMP), "6"), &["x", "z"], 2);
    let albedo = |text: String| {
        text.replacen("<default", r#"<default name="albedo" value="0.8"/><default"#, 1)
            .replace(r#"name="albedo" value="0.8"/><phase"#, r#"name="albedo" value="$albedo"/><phase"#)
    };
    same_in_chunks(&many(albedo(pond(LAMP)), "6"), &["x", "z", "albedo"], 4);
}

/// What jumps behind an interface is refused, with its name.
#[test]
fn outlines_by_way_of_glass_are_refused() {
    let refused = |text: &str, name: &str, what: &str| {
        let (desc, sc) = scene(text);
        let plan = Plan::new(&desc, &[name.to_string()]).unwrap();
        assert!(plan.refuse().is_err(), "plan lets `{name}` pass: {what}");
        let p = sc.param_set(&desc, &[name.to_string()]).unwrap();
        let error = job(&sc, 4, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(what), "{name}: {error}");
    };
    // What only the scene itself can tell, no plan.
    let rejected = |text: &str, name: &str, what: &str| {
        let (desc, sc) = scene(text);
        let p = sc.param_set(&desc, &[name.to_string()]).unwrap();
        let error = job(&sc, 4, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(error.contains(what), "{name}: {error}");
    };
    let hidden = ball().replace(
        "<integrator type=\"volpath\">",
        "<integrator type=\"volpath\"><boolean name=\"hide_emitters\" value=\"true\"/>",
    );
    rejected(&hidden, "x", "at the outline of");
    rejected(&MIRROR.replace(r#"<translate y="2.6"/>"#, r#"<translate y="4"/>"#), "bx", "begins inside a medium");
    let with = |more: &str| ball().replace("</scene>", &format!("{more}</scene>"));
    let plate = r#"<shape type="disk" id="plate"><transform name="to_world"><translate z="-2"/></transform><bsdf type="diffuse"/></shape>"#;
    // One scattering more at the outline, of a finite number.
    rejected(&with(plate), "cam", "at the outline of");
    let point = r#"<emitter type="point" id="lamp"><point name="position" value="0, 3, 0"/></emitter>"#;
    refused(&with(point), "ior", "lamp");
    let block = r#"<shape type="cube" id="block"><transform name="to_world"><translate x="3"/></transform><bsdf type="dielectric"/></shape>"#;
    rejected(&with(block), "ior", "at the outline of");
    // Fog that it does not stand in.
    let fog = r#"<medium type="homogeneous" id="far"/><shape type="sphere"><point name="center" value="5, 0, 0"/><bsdf type="null"/><ref name="interior" id="far"/></shape>"#;
    rejected(&with(fog), "cam", "at the outline of");
    let block = block.replace("dielectric", "diffuse").replace("block", "box");
    let slab = r#"<shape type="cube" id="slab"><transform name="to_world"><scale value="2"/><translate x="3" y="-3"/></transform><bsdf type="dielectric"/></shape>"#;
    rejected(&with(&format!("{block}{slab}")), "ior", "touches");
    let mirror = r#"<shape type="disk" id="mirror"><transform name="to_world"><translate z="-2"/></transform><bsdf type="conductor"/></shape>"#;
    rejected(&with(mirror), "ior", "at the outline of");
    let can = r#"<shape type="cylinder" id="can"><point name="p0" value="2, 0, 0"/><point name="p1" value="3, 0, 0"/><bsdf type="dielectric"/></shape>"#;
    rejected(&with(can), "ior", "at the outline of");
    refused(&with(&can.replace("dielectric", "conductor")), "ior", "can");
    // By way of what is round, beside something opaque.
    refused(&beam("hard", 0.3).replace("</scene>", &format!("{plate}{can}</scene>")), "bx", "can");
    // Over the border of a half-space of glass, which may be anywhere.
    let window = r#"<shape type="rectangle" id="window"><transform name="to_world"><translate z="-4"/></transform><bsdf type="dielectric"/></shape>"#;
    refused(&beam("hard", 0.3).replace("</scene>", &format!("{plate}{window}</scene>")), "bx", "window");
}

/// Where both sides have one index the picture has a kink: whoever differentiates by one of them is told, whoever changes both alike, or anything else, is not.
#[test]
fn equal_indices_are_a_kink_that_is_told() {
    let told = |int: &str, ext: &str, name: &str, ior: f64| {
        let text = format!(
            r#"<scene version="3.0.0"><default name="ior" value="{ior}"/><default name="x" value="0"/><integrator type="volpath"/><emitter type="constant"/>
  <shape type="sphere" id="ball"><point name="center" value="$x, 0, 0"/><bsdf type="dielectric"><float name="int_ior" value="{int}"/><float name="ext_ior" value="{ext}"/></bsdf></shape>
  <sensor type="perspective"/></scene>"#
        );
        let desc = SceneDesc::parse(&text, std::path::Path::new("kink.xml"), &[]).unwrap();
        advice::of_parameters(&desc, &[name.to_string()]).unwrap()
    };
    let found = told("$ior", "1.33", "ior", 1.33);
    assert_eq!(found.iter().map(|w| w.kind).collect::<Vec<_>>(), [WarningKind::Kink]);
    let text = found[0].to_string();
    assert!(text.starts_with("kink.xml:2") && text.contains("`ball`") && text.contains("1.331 or 1.329,"), "{text}");
    assert!(told("1.33", "$ior", "ior", 1.33).len() == 1);
    for (int, ext, name, ior) in
        [("$ior", "1.33", "ior", 1.331), ("$ior", "$ior", "ior", 1.33), ("$ior", "1.33", "x", 1.33)]
    {
        assert!(told(int, ext, name, ior).is_empty(), "{int} {ext} {name} {ior}");
    }
}
