//! Media bookkeeping and geometry: coincident interfaces, many analytic shapes, meshes against their analytic twins.

use crate::common::{estimate, run, scene};
use std::fmt::Write;
use tyndall::error::WarningKind;
use tyndall::math::DVec3;
use tyndall::math::rng::Rng;
use tyndall::render::driver::Mode;
use tyndall::scene::nearest::Kind;
use tyndall::shape::Geometry;

const FRAME: &str = r#"<integrator type="volpath"><integer name="max_depth" value="12"/></integrator>
  <sensor type="perspective"><float name="fov" value="45"/><transform name="to_world"><lookat origin="1, 2, 6" target="0, 0.5, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="6"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.7"/><float name="albedo" value="0.9"/></medium>
  <medium type="homogeneous" id="smoke"><float name="sigma_t" value="1.5"/><float name="albedo" value="0.5"/></medium>
  <emitter type="point"><point name="position" x="0" y="4" z="3"/><rgb name="intensity" value="30"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="0.3"/></emitter>"#;

/// Pictures agree pixel by pixel: |z| <= 5 (false alarm 6e-7 each).
fn agree(name: &str, a: &str, b: &str, spp: u64) {
    let (_, a) = scene(&format!(r#"<scene version="3.0.0">{FRAME}{a}</scene>"#));
    let (_, b) = scene(&format!(r#"<scene version="3.0.0">{FRAME}{b}</scene>"#));
    let (a, b) = (run(&a, spp, 1, Mode::Picture), run(&b, spp, 2, Mode::Picture));
    assert_eq!(a.film.health.biasing() + b.film.health.biasing(), 0);
    for p in 0..a.film.spec().pixels() {
        let d = a.film.mean(0, p) - b.film.mean(0, p);
        let v = a.film.variance_of_mean(0, p).unwrap() + b.film.variance_of_mean(0, p).unwrap();
        let z = d[0] / v[0].sqrt();
        assert!(
            d[0] == 0.0 || z.abs() <= 5.0,
            "{name}: pixel {p}: {:?} {:?} z {z}",
            a.film.mean(0, p),
            b.film.mean(0, p)
        );
    }
    let (ea, eb) = (estimate(&a, 0), estimate(&b, 0));
    let z = (ea.value[0] - eb.value[0]) / ea.error[0].hypot(eb.error[0]);
    assert!(z.abs() <= 4.5, "{name}: {ea:?} {eb:?} z {z}");
}

fn cube(x: [f64; 3], s: [f64; 3], medium: &str) -> String {
    format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="{}" y="{}" z="{}"/><translate x="{}" y="{}" z="{}"/></transform>
        <bsdf type="null"/><ref name="interior" id="{medium}"/></shape>"#,
        s[0], s[1], s[2], x[0], x[1], x[2]
    )
}

const FLOOR: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="9"/></transform><bsdf type="diffuse"/></shape>"#;

#[test]
fn a_box_cut_in_two_is_the_same_box() {
    // The halves share a face; both stand on the floor, so interfaces coincide with a surface too.
    let whole = cube([0.0, 1.0, 0.0], [1.0; 3], "fog");
    let halves = cube([-0.5, 1.0, 0.0], [0.5, 1.0, 1.0], "fog") + &cube([0.5, 1.0, 0.0], [0.5, 1.0, 1.0], "fog");
    agree("halves", &(whole + FLOOR), &(halves + FLOOR), 2048);
}

#[test]
fn boxes_of_two_media_side_by_side() {
    let gap = 1e-9;
    let touching = cube([-0.5, 1.0, 0.0], [0.5, 1.0, 1.0], "fog") + &cube([0.5, 1.0, 0.0], [0.5, 1.0, 1.0], "smoke");
    let apart =
        cube([-0.5 - gap, 1.0, 0.0], [0.5, 1.0, 1.0], "fog") + &cube([0.5, 1.0 + gap, 0.0], [0.5, 1.0, 1.0], "smoke");
    agree("two media", &(touching + FLOOR), &(apart + FLOOR), 2048);
}

#[test]
fn a_mesh_box_is_an_analytic_box() {
    let dir = tempfile::tempdir().unwrap();
    let mut obj = String::new();
    for z in [-1, 1] {
        for y in [-1, 1] {
            for x in [-1, 1] {
                writeln!(obj, "v {x} {y} {z}").unwrap();
            }
        }
    }
    for f in ["1 3 4 2", "5 6 8 7", "1 2 6 5", "3 7 8 4", "1 5 7 3", "2 4 8 6"] {
        writeln!(obj, "f {f}").unwrap();
    }
    let path = dir.path().join("box.obj");
    std::fs::write(&path, obj).unwrap();
    let mesh = |bsdf: &str, medium: &str| {
        format!(
            r#"<shape type="obj"><string name="filename" value="{}"/><transform name="to_world"><translate y="1"/></transform>{bsdf}{medium}</shape>"#,
            path.display()
        )
    };
    let fog = r#"<ref name="interior" id="fog"/>"#;
    agree(
        "null box",
        &(cube([0.0, 1.0, 0.0], [1.0; 3], "fog") + FLOOR),
        &(mesh(r#"<bsdf type="null"/>"#, fog) + FLOOR),
        2048,
    );
    let solid =
        r#"<shape type="cube"><transform name="to_world"><translate y="1"/></transform><bsdf type="diffuse"/></shape>"#;
    agree("solid box", &format!("{solid}{FLOOR}"), &(mesh(r#"<bsdf type="diffuse"/>"#, "") + FLOOR), 2048);
}

#[test]
fn many_analytic_shapes_go_into_embree_and_stay_the_same() {
    let ball = |x: f64, z: f64, r: f64| {
        format!(
            r#"<shape type="sphere"><point name="center" x="{x}" y="{r}" z="{z}"/><float name="radius" value="{r}"/><bsdf type="diffuse"/></shape>"#
        )
    };
    let block = |x: f64, z: f64| {
        format!(
            r#"<shape type="cube"><transform name="to_world"><scale value="0.2"/><translate x="{x}" y="0.2" z="{z}"/></transform><bsdf type="diffuse"/></shape>"#
        )
    };
    let few = FLOOR.to_string() + &ball(-0.6, 0.0, 0.5) + &ball(0.7, 0.3, 0.4) + &block(0.0, 1.0);
    // Ten more balls far below the floor: unseen, but the list is long enough for Embree.
    let many = (0..10).fold(few.clone(), |s, i| s + &ball(i as f64, -500.0, 0.1));
    agree("many shapes", &few, &many, 4096);
}

#[test]
fn a_camera_that_names_its_medium_needs_no_warning_and_one_that_does_not_gets_it() {
    let text = |inside: &str| {
        format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><medium type="homogeneous" id="fog"/>
            <sensor type="perspective">{inside}</sensor><shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape><emitter type="constant"/></scene>"#
        )
    };
    let (_, named) = scene(&text(r#"<ref id="fog"/>"#));
    assert!(named.warnings.is_empty(), "{:?}", named.warnings);
    let (_, unnamed) = scene(&text(""));
    assert_eq!(unnamed.warnings.len(), 1);
    assert!(unnamed.warnings[0].to_string().contains("add <ref id=\"fog\"/>"));
}

#[test]
fn boundaries_that_let_no_light_in_or_leak_are_warned_of() {
    let kind = |bsdf: &str| {
        let (_, s) = scene(&format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><medium type="homogeneous" id="fog"/><sensor type="perspective">
            <transform name="to_world"><translate z="-5"/></transform></sensor><shape type="cube">{bsdf}<ref name="interior" id="fog"/></shape><emitter type="constant"/></scene>"#
        ));
        s.warnings.iter().map(|w| w.kind).collect::<Vec<_>>()
    };
    assert!(kind(r#"<bsdf type="null"/>"#).is_empty());
    assert_eq!(kind(""), [WarningKind::MediumBehindOpaqueBoundary]);
    // An opaque ball in fog that names it.
    let ball = r#"<bsdf type="null"/><ref name="interior" id="fog"/></shape><shape type="sphere"><float name="radius" value="0.5"/><ref name="exterior" id="fog"/></shape><shape type="sphere"><point name="center" value="3, 0, 0"/><bsdf type="null"/>"#;
    assert!(kind(ball).is_empty(), "{:?}", kind(ball));
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("open.obj");
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\n").unwrap();
    let (_, s) = scene(&format!(
        r#"<scene version="3.0.0"><integrator type="volpath"/><medium type="homogeneous" id="fog"/><sensor type="perspective">
        <transform name="to_world"><translate z="-5"/></transform></sensor><shape type="obj"><string name="filename" value="{}"/>
        <bsdf type="null"/><ref name="interior" id="fog"/></shape></scene>"#,
        path.display()
    ));
    assert!(s.warnings.iter().any(|w| w.kind == WarningKind::LeakyBoundary), "{:?}", s.warnings);
}

/// A tube of glass and fog, and the disk that closes it: exactly, too large, turned round, without the fog, by another index.
#[test]
fn lids_that_do_not_close_a_tube_are_warned_of() {
    let told = |radius: f64, turn: f64, index: f64, media: &str| {
        let glass = |n: f64| format!(r#"<bsdf type="dielectric"><float name="int_ior" value="{n}"/></bsdf>"#);
        let fog = r#"<ref name="interior" id="fog"/>"#;
        let (_, s) = scene(&format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><medium type="homogeneous" id="fog"/><sensor type="perspective">
            <transform name="to_world"><translate z="-5"/></transform></sensor>
            <shape type="cylinder" id="tube"><point name="p0" value="0, 0, 0"/><point name="p1" value="0, 1, 0"/><float name="radius" value="0.4"/>{}{fog}</shape>
            <shape type="disk" id="bottom"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/></transform>{}{fog}</shape>
            <shape type="disk" id="top"><transform name="to_world"><scale value="{radius}"/><rotate x="1" angle="{turn}"/><translate y="1"/></transform>{}{media}</shape>
            <emitter type="constant"/></scene>"#,
            glass(1.5),
            glass(1.5),
            glass(index)
        ));
        s.warnings.iter().map(|w| w.to_string()).collect::<Vec<_>>().join("; ")
    };
    let fog = r#"<ref name="interior" id="fog"/>"#;
    assert_eq!(told(0.4, -90.0, 1.5, fog), "");
    // Meant for something else: the tube is open there.
    assert!(told(0.5, -90.0, 1.5, fog).contains("`bottom` closes one end of the cylinder `tube`, the other is open"));
    for (what, found) in [
        ("beside its rim", told(0.402, -90.0, 1.5, fog)),
        ("beside its rim", told(0.46, -90.0, 1.5, fog)),
        ("beside its rim", told(0.4, -84.0, 1.5, fog)),
        ("the index of refraction is 1.5 by the cylinder and 1.000277 by the disk", told(0.4, 90.0, 1.5, fog)),
        ("the index of refraction is 1.5 by the cylinder and 1.4 by the disk", told(0.4, -90.0, 1.4, fog)),
        ("inside of it is medium `fog` by the cylinder and no medium by the disk", told(0.4, -90.0, 1.5, "")),
    ] {
        assert!(found.contains("the disk `top` closes the cylinder `tube`") && found.contains(what), "{what}: {found}");
    }
}

/// Two rods on each other, each with its own lids; a column of fog whose upper lid knows no fog.
#[test]
fn lids_of_rods_on_each_other_and_of_columns() {
    let tube = |y: f64, bsdf: &str, media: [&str; 2]| {
        let lid = |id: &str, turn: i32, y: f64, media: &str| {
            format!(
                r#"<shape type="disk" id="{id}"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="{turn}"/><translate y="{y}"/></transform>{bsdf}{media}</shape>"#
            )
        };
        let wall = format!(
            r#"<shape type="cylinder"><point name="p0" value="0, {y}, 0"/><point name="p1" value="0, {}, 0"/><float name="radius" value="0.4"/>{bsdf}{}</shape>"#,
            y + 1.0,
            media[0]
        );
        wall + &lid(&format!("low{y}"), 90, y, media[0]) + &lid(&format!("high{y}"), -90, y + 1.0, media[1])
    };
    let told = |shapes: &str| {
        let (_, s) = scene(&format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><medium type="homogeneous" id="fog"/><sensor type="perspective">
            <transform name="to_world"><translate z="-5"/></transform></sensor>{shapes}<emitter type="constant"/></scene>"#
        ));
        s.warnings.iter().map(|w| w.to_string()).collect::<Vec<_>>().join("; ")
    };
    let glass = r#"<bsdf type="dielectric"/>"#;
    let rods = told(&(tube(0.0, glass, [""; 2]) + &tube(1.0, glass, [""; 2])));
    assert!(!rods.contains("closes"), "{rods}");
    let (null, fog) = (r#"<bsdf type="null"/>"#, r#"<ref name="interior" id="fog"/>"#);
    assert_eq!(told(&tube(0.0, null, [fog; 2])), "");
    let open = told(&tube(0.0, null, [fog, ""]));
    assert!(open.contains("the disk `high0`") && open.contains("medium `fog` by the cylinder and no medium"), "{open}");
}

#[test]
fn open_glass_and_absurd_roughness_are_warned_of() {
    let dir = tempfile::tempdir().unwrap();
    let warnings = |faces: &str, bsdf: &str| {
        let path = dir.path().join("glass.obj");
        std::fs::write(&path, format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n{faces}")).unwrap();
        let (_, s) = scene(&format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"><transform name="to_world"><translate z="-5"/></transform></sensor>
            <shape type="obj" id="gem"><string name="filename" value="{}"/>{bsdf}</shape><emitter type="constant"/></scene>"#,
            path.display()
        ));
        s.warnings.iter().map(|w| (w.kind, w.to_string())).collect::<Vec<_>>()
    };
    let (open, closed) = ("f 1 3 2\nf 1 2 4\nf 1 4 3\n", "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n");
    let (glass, frosted) = (r#"<bsdf type="dielectric"/>"#, r#"<bsdf type="roughdielectric"/>"#);
    for bsdf in [glass, frosted] {
        assert!(warnings(closed, bsdf).is_empty());
        let found = warnings(open, bsdf);
        assert_eq!((found.len(), found[0].0), (1, WarningKind::OpenInterface), "{found:?}");
        assert!(
            found[0].1.contains("test-scene.xml:2:") && found[0].1.contains("`gem`: it refracts, but has 3 open edges")
        );
        assert!(found[0].1.contains("hint: close the mesh"), "{found:?}");
    }
    assert!(warnings(open, r#"<bsdf type="diffuse"/>"#).is_empty());
    // Vertex normals: outward, against the winding, of length 0.
    let normals = |n: [&str; 4], faces: &str| {
        let own = n.map(|n| format!("vn {n}\n")).concat();
        let shaded = faces.replace("1", "1//1").replace(" 2", " 2//2").replace(" 3", " 3//3").replace(" 4", " 4//4");
        warnings(&(own + &shaded), glass)
    };
    let outward = ["-1 -1 -1", "1 -0.3 -0.3", "-0.3 1 -0.3", "-0.3 -0.3 1"];
    let inward = ["1 1 1", "-1 0.3 0.3", "0.3 -1 0.3", "0.3 0.3 -1"];
    assert!(normals(outward, closed).is_empty());
    let found = normals(inward, closed);
    assert!(
        found.len() == 1 && found[0].1.contains("4 of its faces are wound against their vertex normals"),
        "{found:?}"
    );
    let found = normals(["0 0 0", outward[1], outward[2], outward[3]], closed);
    assert!(found.len() == 1 && found[0].1.contains("1 vertex normals of length 0"), "{found:?}");
    let metal = |alpha: f64| {
        warnings(closed, &format!(r#"<bsdf type="roughconductor"><float name="alpha" value="{alpha}"/></bsdf>"#))
    };
    assert!(metal(1.0).is_empty());
    let found = metal(1.5);
    assert_eq!((found.len(), found[0].0), (1, WarningKind::UnlikelyValue), "{found:?}");
    assert!(found[0].1.contains("`gem`") && found[0].1.contains("alpha of 1.5"), "{found:?}");
}

/// A mesh, analytic shapes of every form beside it (`copies` of each), and as many null boxes.
fn crowd(copies: u32, dir: &std::path::Path) -> String {
    let obj = dir.join("fan.obj");
    std::fs::write(&obj, "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 1 2 2\n").unwrap();
    let mut r = Rng::keyed(3, 3, copies.into(), 0);
    let mut place = || {
        let mut u = || 4.0 * r.uniform() - 2.0;
        format!(
            r#"<transform name="to_world"><scale value="0.3"/><rotate x="{}" y="{}" z="{}" angle="50"/><translate x="{}" y="{}" z="{}"/></transform>"#,
            u(),
            u(),
            u(),
            u(),
            u(),
            u()
        )
    };
    let mut text = format!(
        r#"<shape type="obj"><string name="filename" value="{}"/>{}<bsdf type="diffuse"/></shape>"#,
        obj.display(),
        place()
    );
    for _ in 0..copies {
        for form in ["sphere", "rectangle", "disk", "cube"] {
            write!(text, r#"<shape type="{form}">{}<bsdf type="diffuse"/></shape>"#, place()).unwrap();
        }
        let fog = r#"<bsdf type="null"/><ref name="interior" id="fog"/>"#;
        write!(text, r#"<shape type="cube">{}{fog}</shape>"#, place()).unwrap();
    }
    text
}

#[test]
fn nearest_points_of_a_scene_are_those_of_its_shapes() {
    let dir = tempfile::tempdir().unwrap();
    // Few shapes are in a list, many in Embree.
    for copies in [1, 2, 9] {
        let (_, s) = scene(&format!(r#"<scene version="3.0.0">{FRAME}{}</scene>"#, crowd(copies, dir.path())));
        let mut r = Rng::keyed(4, 4, 4, 4);
        let mut found = 0;
        for k in 0..3000 {
            let p = DVec3::from_array(std::array::from_fn(|_| 6.0 * r.uniform() - 3.0));
            let radius = if k % 3 == 0 { f64::INFINITY } else { 2.0 * r.uniform() };
            let kind = if k % 2 == 0 { Kind::Opaque } else { Kind::Null };
            let (bits, one_in) = (r.next_u64(), [1, 2, 5][k % 3]);
            let accept = |shape: u32, face: u32| (bits >> (shape % 50 + face)) % one_in == 0;
            let mut least = f64::INFINITY;
            for (i, x) in s.shapes.iter().enumerate().filter(|(_, x)| s.is_null(x) == (kind == Kind::Null)) {
                for face in (0..x.shape.face_count()).filter(|&f| accept(i as u32, f)) {
                    least = least.min(x.shape.nearest_on_face(face, p).distance(p));
                }
            }
            let near = s.nearest_point(kind, p, radius, &accept);
            assert_eq!(near.map(|n| n.distance), Some(least).filter(|&d| d < radius), "{copies} {k}: {p}");
            let Some(n) = near else { continue };
            found += 1;
            assert!(accept(n.shape, n.face) && n.p.distance(p) == n.distance);
            let shape = &s.shapes[n.shape as usize].shape;
            assert!((shape.nearest_on_face(n.face, n.p) - n.p).length() < 1e-14, "on its face: {n:?}");
        }
        assert!(found > 1000);
    }
}

#[test]
fn a_scene_in_which_nothing_shines_is_warned_of() {
    let warnings = |light: &str| {
        let (_, s) = scene(&format!(
            r#"<scene version="3.0.0"><integrator type="path"/><sensor type="perspective"/><shape type="sphere"><point name="center" x="0" y="0" z="5"/></shape>{light}</scene>"#
        ));
        s.warnings.iter().map(|w| w.to_string()).collect::<Vec<_>>()
    };
    assert!(warnings("")[0].contains("nothing in the scene shines"));
    assert!(warnings(r#"<emitter type="constant"/>"#).is_empty());
}

/// A point light on a ceiling, whose own rounding must not decide whether it blocks; by itself (an analytic shape) and through Embree (a mesh).
#[test]
fn what_a_light_stands_on_does_not_block_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("square.obj");
    std::fs::write(&path, "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nf 1 2 3\nf 1 3 4\n").unwrap();
    let mesh = format!(r#"type="obj"><string name="filename" value="{}"/>"#, path.display());
    for ceiling in [r#"type="rectangle">"#, &mesh] {
        let lit = |y: &str| {
            let (_, s) = scene(&format!(
                r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="2"/></integrator>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/></transform><bsdf type="diffuse"/></shape>
  <shape {ceiling}<transform name="to_world"><rotate x="1" angle="90"/><rotate y="1" angle="37"/><scale value="0.9"/><translate y="2.2"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <emitter type="point"><point name="position" x="0.31" y="{y}" z="0.17"/><rgb name="intensity" value="9"/></emitter></scene>"#
            ));
            estimate(&run(&s, 64, 1, Mode::Picture), 0).value[0]
        };
        let (on, below) = (lit("2.2"), lit("2.199999"));
        assert!((on - below).abs() < 1e-4 * below, "{ceiling}: {on} {below}");
    }
}
