//! `plan` against the table of [T] section 3, row by row.

use std::collections::BTreeSet;
use std::path::Path;
use tyndall::render::plan::{Facts, Motion, Plan, Term, needed};
use tyndall::scene::SceneDesc;

fn letters(f: Facts, m: Motion) -> String {
    needed(&f, &m).keys().map(|t| t.letters()).collect::<Vec<_>>().join(" ")
}

fn expect(row: &str, f: Facts, m: Motion, terms: &str) {
    let want: BTreeSet<&str> = terms.split(' ').collect();
    let got = letters(f, m);
    let got: BTreeSet<&str> = got.split(' ').collect();
    assert_eq!(got, want, "{row}");
}

const NO: Facts = Facts {
    medium: false,
    surfaces: false,
    reflecting: false,
    receivers: false,
    occluders: false,
    zero_measure_light: false,
    local_light: false,
    hard_profile: false,
    beam: false,
    area_light: false,
    border_jump: false,
    dielectric: false,
    only_panes: false,
    opaque_rectangles: false,
    known_borders: false,
    flat_smooth: false,
    polygonal_dielectric: false,
    rims: false,
    dark_behind: false,
    beyond_interface: false,
    light_across_interface: false,
    facets: false,
};

#[test]
fn every_row_of_the_table() {
    let still = Motion::default();
    let fog = Facts { medium: true, ..NO };
    let black_room = Facts { surfaces: true, occluders: true, ..NO };
    let room = Facts { reflecting: true, ..black_room };
    let foggy_room = Facts { medium: true, ..room };
    let foggy_black_room = Facts { medium: true, ..black_room };
    let lamp = |f: Facts| Facts { zero_measure_light: true, local_light: true, ..f };
    let sun = |f: Facts| Facts { zero_measure_light: true, ..f };

    expect("only values", foggy_room, Motion { values: true, ..still }, "P");
    expect("medium moved, border vanishes", fog, Motion { volume: true, ..still }, "P");
    expect(
        "medium moved, density jump",
        Facts { border_jump: true, ..fog },
        Motion { volume: true, border: true, ..still },
        "P N",
    );
    // And E1: the table leaves out that the camera may see it.
    expect("area light moves, no occluder", fog, Motion { area_light: true, ..still }, "M E1");
    expect("environment turns", foggy_room, Motion { environment: Some(0), ..still }, "P");
    expect("area light moves, occluders, fog", foggy_room, Motion { area_light: true, ..still }, "M E1 E2 E3");
    expect("area light moves, occluders, no fog", room, Motion { area_light: true, ..still }, "M E1 E3");
    let moved = Motion { zero_measure_light: true, local_light: true, ..still };
    let turned = Motion { zero_measure_light: true, ..still };
    expect("point light moves, no occluder", lamp(fog), moved, "M");
    expect("hard light moves, no occluder", Facts { hard_profile: true, ..lamp(fog) }, moved, "M H");
    // The table has E2 here too, for vertices that a warp moves past static silhouettes. No vertex moves in this program
    // (`transport::beside`), so nothing enters that term.
    expect("point light moves, black occluders, medium", lamp(foggy_black_room), moved, "M G");
    expect("point light moves, occluders, medium, lit surfaces", lamp(foggy_room), moved, "M G R");
    expect("sun turns, occluders, medium", sun(foggy_black_room), turned, "M G");
    expect("hard light moves, occluders", Facts { hard_profile: true, ..sun(foggy_black_room) }, turned, "M G H");
    let shape = Motion { opaque: true, ..still };
    expect("opaque moves, no medium", room, shape, "M E1 E3");
    expect("opaque moves, no medium, point light", lamp(room), shape, "M E1 E3 R");
    expect("opaque moves in a medium", foggy_black_room, shape, "M E1 E2");
    expect("opaque moves in a medium, surfaces scatter", foggy_room, shape, "M E1 E2 E3");
    expect("opaque moves in a medium, point light", lamp(foggy_room), shape, "M E1 E2 E3 G R");
    let camera = Motion { camera: true, ..still };
    expect("camera moves, no surfaces", lamp(fog), camera, "M");
    expect("camera moves, surfaces", room, camera, "M E1 E3");
    // The table has D and N here too. Points of a camera ray slide with its end and its borders here (`transport::first`): nothing is swept.
    expect("camera moves, surfaces, fog, point light", lamp(foggy_room), camera, "M E1 E2 E3 G R");
    let glass = Facts { medium: true, dielectric: true, surfaces: true, ..NO };
    // The table has D and N here too. Points of a medium go with what their rays meet, moving or not ([T] (58), (60)): nothing is swept.
    let ior = Motion { ior: true, ..still };
    expect("ior, medium inside, no occluder", glass, ior, "S");
    let outside = Facts { light_across_interface: true, zero_measure_light: true, local_light: true, ..glass };
    expect("ior, zero-measure light outside", outside, ior, "S C");
    expect("ior, hard beam outside", Facts { hard_profile: true, ..outside }, ior, "S C H");
    let filled = Facts { beyond_interface: true, occluders: true, border_jump: true, reflecting: true, ..glass };
    expect("ior, outlines behind the interface", filled, ior, "S VE");
    let cast = Facts { light_across_interface: true, zero_measure_light: true, ..filled };
    expect("ior, outlines and a light across", cast, ior, "S C VE G R");
    let rough = Facts { facets: true, ..sun(Facts { surfaces: true, reflecting: true, ..NO }) };
    let facet_ior = Motion { facet_ior: true, values: true, ..still };
    expect("index of rough glass in light without extent", rough, facet_ior, "P R");
    expect("index of rough glass under the sky", Facts { facets: false, ..rough }, facet_ior, "P");
    expect("ior, facets", Facts { polygonal_dielectric: true, ..glass }, ior, "S VE");
    let interface = Motion { interface: true, ..still };
    expect("interface moves", glass, interface, "S M");
    expect("interface moves, light across", outside, interface, "S M C");
    expect("interface moves, edges seen through it", Facts { beyond_interface: true, ..glass }, interface, "S M E2 VE");
    expect("polygonal interface moves", Facts { polygonal_dielectric: true, ..glass }, interface, "S M E1 VE");
    let behind = Facts { dielectric: true, beyond_interface: true, ..foggy_black_room };
    expect("occluder behind glass moves", behind, shape, "M E1 E2 VE");
    expect("camera moves, ball of glass in fog", Facts { rims: true, ..glass }, camera, "M S E1 E2 VE");
    expect("nothing changes", foggy_room, still, "");
}

/// Scenes, so that facts and motion are tested too.
fn plan(body: &str, wrt: &str) -> Plan {
    let text =
        format!(r#"<scene version="3.0.0"><default name="x" value="0.2"/><integrator type="volpath"/>{body}</scene>"#);
    let desc = SceneDesc::parse(&text, Path::new("plan.xml"), &[]).unwrap();
    Plan::new(&desc, &[wrt.to_string()]).unwrap()
}

fn used(p: &Plan, decision: &str) -> String {
    p.lines.iter().filter(|l| l.decision == decision).map(|l| l.letters.clone()).collect::<Vec<_>>().join(" ")
}

const CAMERA: &str = r#"<sensor type="perspective"><float name="fov" value="40"/></sensor>"#;
const FOG: &str = r#"<medium type="homogeneous" id="fog"><float name="sigma_t" value="1"/></medium>"#;
const WALL: &str = r#"<shape type="rectangle"><bsdf type="diffuse"/></shape>"#;

#[test]
fn scenes_give_their_rows() {
    let cases = [
        (format!(r#"{CAMERA}<medium type="homogeneous" id="f"><float name="sigma_t" value="$x"/></medium>"#), "P", ""),
        (
            format!(r#"{CAMERA}{FOG}{WALL}<emitter type="point"><point name="position" value="$x, 0, 0"/></emitter>"#),
            "M G R",
            "",
        ),
        (format!(r#"{CAMERA}{FOG}<emitter type="point"><point name="position" value="$x, 0, 0"/></emitter>"#), "M", ""),
        (
            format!(
                r#"{CAMERA}{WALL}<emitter type="directional"><vector name="direction" x="$x" y="0" z="1"/></emitter>"#
            ),
            "M R",
            "",
        ),
        (
            format!(r#"{CAMERA}{FOG}{WALL}<emitter type="spot"><float name="cutoff_angle" value="$x"/></emitter>"#),
            "P",
            "",
        ),
        (
            format!(
                r#"{CAMERA}{FOG}{WALL}<emitter type="spot"><float name="cutoff_angle" value="$x"/><float name="beam_width" value="$x"/></emitter>"#
            ),
            "H",
            "",
        ),
        (format!(r#"<sensor type="perspective"><float name="fov" value="$x"/></sensor>{FOG}"#), "M", ""),
        (
            format!(
                r#"<sensor type="perspective"><transform name="to_world"><translate x="$x"/></transform></sensor>{WALL}"#
            ),
            "M E1 E3",
            "",
        ),
        (
            format!(
                r#"{CAMERA}{FOG}<shape type="sphere"><float name="radius" value="$x"/><bsdf type="diffuse"/></shape>"#
            ),
            "M E1 E2 E3",
            "",
        ),
        (
            format!(
                r#"{CAMERA}{FOG}<shape type="cube"><transform name="to_world"><translate x="$x"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#
            ),
            "P N",
            "",
        ),
        (
            format!(
                r#"{CAMERA}<shape type="rectangle"><transform name="to_world"><translate x="$x"/></transform><emitter type="area"/></shape>"#
            ),
            "M E1",
            "",
        ),
        (format!(r#"{CAMERA}<emitter type="point"><rgb name="intensity" value="$x"/></emitter>"#), "P", ""),
        // A beam that moves casts its shadows where they were, one that turns does not.
        (
            format!(
                r#"{CAMERA}{FOG}{WALL}<emitter type="collimated"><transform name="to_world"><translate x="$x"/></transform></emitter>"#
            ),
            "M H",
            "",
        ),
        (
            format!(
                r#"{CAMERA}{FOG}{WALL}<emitter type="collimated"><transform name="to_world"><rotate x="1" angle="$x"/></transform></emitter>"#
            ),
            "M G R H",
            "",
        ),
        (
            format!(
                r#"{CAMERA}{WALL}<shape type="cube"><bsdf type="dielectric"/></shape><emitter type="collimated"><float name="radius" value="$x"/></emitter>"#
            ),
            "M R H",
            "",
        ),
        (
            format!(
                r#"{CAMERA}{WALL}<shape type="sphere"><bsdf type="dielectric"/></shape><emitter type="collimated"><float name="radius" value="$x"/></emitter>"#
            ),
            "M H C",
            "C",
        ),
    ];
    for (body, use_, missing) in cases {
        let p = plan(&body, "x");
        let sorted = |s: &str| s.split(' ').map(str::to_string).collect::<BTreeSet<_>>();
        assert_eq!(sorted(&used(&p, "missing")), sorted(missing), "{body}");
        if missing.is_empty() {
            assert_eq!(used(&p, "use"), use_, "{body}");
            p.refuse().unwrap();
        } else {
            let e = p.refuse().unwrap_err().to_string();
            assert!(e.contains("d/dx needs") && e.contains("not available yet") && e.contains("help:"), "{e}");
        }
    }
}

/// The table names what the refusal names, its place and what to do.
#[test]
fn missing_terms_name_their_cause() {
    let glass = r#"<shape type="sphere" id="ball"><bsdf type="dielectric"/></shape>"#;
    let light = r#"<emitter type="point" id="bulb"><point name="position" x="$x" y="3" z="0"/></emitter>"#;
    let p = plan(&format!("{CAMERA}{glass}{light}"), "x");
    assert!(p.refuse().unwrap_err().to_string().contains("`ball`"));
    let told = |l: &tyndall::render::plan::PlanLine| {
        l.decision == "missing"
            && l.reason.contains("because of `ball` (plan.xml:")
            && l.reason.contains("use an area light")
    };
    assert!(p.lines.iter().any(told), "{:?}", p.lines);
    // Flat faces cast shadows by their borders, where nothing else does.
    let block = format!("{CAMERA}{}{light}", glass.replace("sphere", "cube"));
    assert!(used(&plan(&block, "x"), "use").split(' ').any(|t| t == "G"));
    let floor = r#"<shape type="rectangle"/>"#;
    assert!(used(&plan(&format!("{block}{floor}"), "x"), "use").split(' ').any(|t| t == "R"));
    let round = r#"<shape type="cylinder" id="plate"><bsdf type="dielectric"/></shape>"#;
    let error = plan(&format!("{block}{round}"), "x").refuse().unwrap_err().to_string();
    assert!(error.contains("`plate`"), "{error}");
    // Where flat faces are not enough it is the light.
    let panes = r#"<shape type="rectangle"><bsdf type="dielectric"/></shape><shape type="cube"><bsdf type="dielectric"/></shape>"#;
    let error = plan(&format!("{CAMERA}{panes}{light}"), "x").refuse().unwrap_err().to_string();
    assert!(error.contains("`bulb`"), "{error}");
}

/// A term that two parameters lack is named once.
#[test]
fn missing_terms_are_named_once() {
    let glass = r#"<shape type="sphere"><bsdf type="dielectric"/></shape>"#;
    let light =
        r#"<default name="y" value="3"/><emitter type="point"><point name="position" x="$x" y="$y" z="0"/></emitter>"#;
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.2"/><integrator type="volpath"/>{CAMERA}{glass}{light}</scene>"#
    );
    let desc = SceneDesc::parse(&text, Path::new("plan.xml"), &[]).unwrap();
    let p = Plan::new(&desc, &["x".to_string(), "y".to_string()]).unwrap();
    let told = p.refuse().unwrap_err().to_string();
    let list = told.split("missing: ").nth(1).and_then(|t| t.split(". ").next()).unwrap();
    let names: Vec<&str> = list.split(", ").collect();
    assert_eq!(names.iter().collect::<BTreeSet<_>>().len(), names.len(), "{told}");
}

#[test]
fn terms_name_their_rooms() {
    assert_eq!(Term::G.room(), "light_shadow");
    assert_eq!(Term::ALL.len(), 13);
}
