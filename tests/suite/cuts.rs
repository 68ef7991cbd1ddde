//! Flat faces that pass through each other (`term::cuts`): the lines in which they meet, which are edges of the picture, and borders of faces.

use crate::common::{against_differences, difference, forward_of, job, params, scene};
use tyndall::math::DVec3;
use tyndall::render::driver::Mode;
use tyndall::scene::compile::Orders;
use tyndall::shape::edges::Edge;
use tyndall::term::Motion;

const VIEW: &str = r#"<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="$cam, 0.9, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="6"/><rfilter type="tent"/></film></sensor>"#;

/// Two sheets that move alike and pass through each other in a line through the middles of both; a third that neither meets.
fn sheets() -> String {
    with(
        &[
            sheet(r#"<rotate y="1" angle="15"/>"#, "0.8,0.6,0.2"),
            sheet(r#"<scale x="0.7" y="0.6"/><rotate y="1" angle="-80"/><rotate z="1" angle="20"/>"#, "0.2,0.6,0.9"),
            sheet(r#"<rotate x="1" angle="-90"/><scale value="2"/><translate y="-1.2"/>"#, "0.5"),
        ]
        .concat(),
    )
}

const POINT: &str = r#"<emitter type="point"><point name="position" value="-1.6, 1.9, 2.4"/><rgb name="intensity" value="9,8,7"/></emitter>"#;

/// The lines that `--wrt` these finds, which nothing refuses.
fn lines(text: &str, wrt: &[&str]) -> Vec<[DVec3; 2]> {
    edges(text, wrt).into_iter().map(|e| [e.a, e.b]).collect()
}

fn edges(text: &str, wrt: &[&str]) -> Vec<Edge> {
    let (desc, sc) = scene(text);
    let p = params(&desc, &sc, wrt);
    job(&sc, 32, 1, Mode::Forward(&p)).refuse().unwrap_or_else(|e| panic!("{e}"));
    let motion = Motion::new(&sc, &sc.sensors[0], &p).unwrap();
    let edges = motion.edges(&sc);
    (0..edges.len()).filter(|&i| edges.is_cut(i)).map(|i| edges.get(&sc, i).edge).collect()
}

fn sheet(place: &str, c: &str) -> String {
    format!(
        r#"<shape type="rectangle"><transform name="to_world">{place}<translate x="$x" y="$y"/></transform><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{c}"/></bsdf></bsdf></shape>"#
    )
}

fn with(shapes: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="y" value="0"/><default name="cam" value="0.4"/>
  <integrator type="path"><integer name="max_depth" value="3"/></integrator>{VIEW}{shapes}{POINT}</scene>"#
    )
}

#[test]
fn faces_meet_in_lines() {
    let block = |y: f64| {
        format!(
            r#"<scene version="3.0.0"><default name="cam" value="0.2"/><integrator type="path"/>{VIEW}
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.5"/><translate x="0.3" y="{y}"/></transform><bsdf type="diffuse"/></shape>{POINT}</scene>"#
        )
    };
    // What stands on a floor has its own edges there.
    assert!(lines(&block(0.5), &["cam"]).is_empty());
    let sunk = lines(&block(0.4), &["cam"]);
    assert_eq!(sunk.len(), 4, "{sunk:?}");
    for [a, b] in &sunk {
        assert!(a.y.abs() < 1e-12 && b.y.abs() < 1e-12 && ((*b - *a).length() - 1.0).abs() < 1e-12, "{a} {b}");
        let corner = |p: &DVec3| ((p.x - 0.3).abs() - 0.5).abs() < 1e-12 && (p.z.abs() - 0.5).abs() < 1e-12;
        assert!(corner(a) && corner(b), "{a} {b}");
    }
    let text = sheets();
    assert_eq!(lines(&text, &["x"]).len(), 1);
    assert_eq!(lines(&text, &["x"]), lines(&text, &["cam"]));
}

/// Sheets that move, and a camera before them.
#[test]
fn sheets_through_each_other() {
    let text = sheets();
    against_differences(&text, &[("x", 0.03), ("cam", 0.03)], &["all"], 1 << 13, 0.02);
    // Light from the floor: on either side of the line each sheet hides another part of it.
    let orders = Orders { first: 2, last: 2 };
    let ours = &forward_of(&text, orders, &["x"], &["all"], 1 << 13)[1];
    let fd = difference(&text, orders, "x", 0.03, 1 << 16);
    let se = ours.error[0].hypot(fd.error[0]);
    println!("order 2: {} +- {}, differences {} +- {}", ours.value[0], ours.error[0], fd.value[0], fd.error[0]);
    // Radiances of the wrong side are about 1e-3 off.
    assert!(
        (ours.value[0] - fd.value[0]).abs() <= 4.5 * se && se <= 2.2e-4,
        "{} {} +- {se}",
        ours.value[0],
        fd.value[0]
    );
}

/// Three sheets of two heights through one axis.
fn star() -> String {
    let blade = |angle: i32, height: f64, c: &str| {
        sheet(&format!(r#"<scale x="0.8" y="{height}"/><rotate y="1" angle="{angle}"/>"#), c)
    };
    with(&[blade(50, 1.0, "0.8,0.6,0.2"), blade(110, 1.0, "0.2,0.6,0.9"), blade(170, 0.6, "0.3,0.9,0.2")].concat())
}

/// A wall of two sheets, one on the other, through a floor right where they meet; the floor ends within the wall.
fn wall() -> String {
    let part =
        |y: f64, c: &str| sheet(&format!(r#"<scale y="0.4"/><translate y="{y}"/><rotate y="1" angle="25"/>"#), c);
    let floor = sheet(r#"<scale x="0.6"/><rotate x="1" angle="-90"/><rotate y="1" angle="25"/>"#, "0.5,0.3,0.8");
    with(&[part(0.4, "0.8,0.6,0.2"), part(-0.4, "0.2,0.6,0.9"), floor].concat())
}

#[test]
fn lines_in_one_another() {
    let axis = |text: &str| {
        let mut e = edges(text, &["x"]);
        e.sort_by(|a, b| (a.a + a.b).y.total_cmp(&(b.a + b.b).y));
        e.iter().map(|e| ((e.b - e.a).length(), e.sides.len())).collect::<Vec<_>>()
    };
    let near = |found: &[(f64, usize)], expected: &[(f64, usize)]| {
        let alike = |(a, b): (&(f64, usize), &(f64, usize))| (a.0 - b.0).abs() < 1e-12 && a.1 == b.1;
        found.len() == expected.len() && found.iter().zip(expected).all(alike)
    };
    let found = axis(&star());
    assert!(near(&found, &[(0.4, 4), (1.2, 6), (0.4, 4)]), "{found:?}");
    // The seam of the wall, of which the floor's line is a part; the rest of it goes on being an edge.
    let found = axis(&wall());
    assert!(near(&found, &[(1.2, 4)]), "{found:?}");
    // As long as the floor is not there, the wall has a seam and no line.
    let two = wall().replacen(r#"<scale x="0.6"/>"#, r#"<scale x="0.6"/><translate y="30"/>"#, 1);
    assert!(axis(&two).is_empty());
}

#[test]
fn sheets_through_one_axis() {
    against_differences(&star(), &[("x", 0.02)], &["all"], 1 << 12, 0.02);
}

#[test]
fn a_wall_through_a_floor_over_a_seam() {
    against_differences(&wall(), &[("y", 0.02)], &["all"], 1 << 12, 0.02);
}

/// To points beside a corner of the floor the line where both walls pass through each other is a border: light from the hidden parts behind it does not come along.
#[test]
fn light_beside_a_line() {
    let wall = |angle: i32, c: &str| sheet(&format!(r#"<rotate y="1" angle="{angle}"/>"#), c);
    let floor = sheet(r#"<rotate x="1" angle="-90"/><scale value="3"/><translate y="-1"/>"#, "0.5");
    let text = with(&[wall(-60, "0.8,0.6,0.2"), wall(30, "0.2,0.6,0.9"), floor].concat())
        .replace(r#"value="34""#, r#"value="8""#)
        .replace(r#"origin="$cam, 0.9, 4" target="0, 0, 0""#, r#"origin="$cam, 1.2, 4" target="0.04, -1, 0.25""#);
    let orders = Orders { first: 2, last: 2 };
    let ours = &forward_of(&text, orders, &["x"], &["all"], 1 << 15)[1];
    let fd = difference(&text, orders, "x", 0.02, 1 << 16);
    let se = ours.error[0].hypot(fd.error[0]);
    println!("{} +- {}, differences {} +- {}", ours.value[0], ours.error[0], fd.value[0], fd.error[0]);
    // Without the border it is 0.003 off.
    assert!(
        (ours.value[0] - fd.value[0]).abs() <= 4.5 * se && se <= 3.5e-4,
        "{} {} +- {se}",
        ours.value[0],
        fd.value[0]
    );
}

/// A sheet that ends in the line of two others, faces with common corners, and what only stands on something.
#[test]
fn all_faces_are_told() {
    let count = |shapes: &[String]| {
        let mut n: Vec<usize> = edges(&with(&shapes.concat()), &["x"]).iter().map(|e| e.sides.len()).collect();
        n.sort_unstable();
        n
    };
    let blade = |angle: i32| sheet(&format!(r#"<rotate y="1" angle="{angle}"/>"#), "0.5");
    let half = sheet(r#"<translate x="1"/><scale x="0.5" y="0.5"/><rotate y="1" angle="130"/>"#, "0.5");
    assert_eq!(count(&[blade(10), blade(70)]), [4]);
    assert_eq!(count(&[blade(10), blade(70), half.clone()]), [4, 4, 5]);
    assert_eq!(count(&[blade(10), half]), [0; 0]);
    let leaf = |angle: i32| sheet(&format!(r#"<rotate x="1" y="1" angle="{angle}"/>"#), "0.5");
    assert_eq!(count(&[leaf(0), leaf(70)]), [4]);

    let refused = |text: &str, wrt: &str| {
        let (desc, sc) = scene(text);
        let p = params(&desc, &sc, &[wrt]);
        job(&sc, 32, 1, Mode::Forward(&p)).refuse().err().map(|e| e.to_string())
    };
    // What stands on a floor but for rounding may slide over it, not so what is sunk into it.
    let block = |depth: f64| {
        let block = format!(
            r#"<shape type="cube"><transform name="to_world"><scale value="0.4"/><translate x="$x" y="{}"/></transform><bsdf type="diffuse"/></shape>"#,
            0.4 - depth
        );
        with(
            &(block
                + r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>"#),
        )
    };
    assert_eq!(refused(&block(2e-8), "x"), None);
    assert!(refused(&block(1e-5), "x").is_some_and(|e| e.contains("pass through each other")));
}

/// Meshes: one that passes through itself, and one whose faces have corners that are equal but for rounding.
#[test]
fn faces_of_one_mesh() {
    let dir = tempfile::tempdir().unwrap();
    let lines_of = |obj: &str| {
        let path = dir.path().join("m.obj");
        std::fs::write(&path, obj).unwrap();
        let mesh = format!(
            r#"<shape type="obj"><string name="filename" value="{}"/><transform name="to_world"><translate x="$x"/></transform><bsdf type="diffuse"/></shape>"#,
            path.display()
        );
        lines(&with(&mesh), &["x"])
    };
    let crossed = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nv 0.2 -1 -1\nv 0.2 -1 1\nv 0.2 1 1\nv 0.2 1 -1\nf 1 2 3\nf 1 3 4\nf 5 6 7\nf 5 7 8\n";
    let found = lines_of(crossed);
    let length: f64 = found.iter().map(|[a, b]| (*b - *a).length()).sum();
    assert!((length - 2.0).abs() < 1e-12, "{found:?}");
    // A roof of two slopes: the second has the ridge 1e-7 lower, or higher.
    for off in ["0.9999999", "1.0000001"] {
        let roof = format!(
            "v -1 0 1\nv 1 0 1\nv 1 1 0\nv -1 1 0\nv 1 0 -1\nv -1 0 -1\nv -1 {off} 0\nv 1 {off} 0\nf 1 2 3\nf 1 3 4\nf 5 6 7\nf 5 7 8\n"
        );
        assert!(lines_of(&roof).is_empty());
    }
}

/// What stands on the far side of a sheet is not seen, edge on or not.
#[test]
fn behind_a_sheet() {
    let front = sheet("", "0.8,0.6,0.2");
    let shelf = r#"<rotate x="1" angle="-90"/><translate z="-1"/><scale x="0.7"/>"#;
    let ridge = r#"<scale x="0.5" y="0.5"/><translate y="0.5"/>"#;
    let slope = |angle: i32| sheet(&format!(r#"{ridge}<rotate x="1" angle="{angle}"/>"#), "0.2,0.6,0.9");
    let orders = Orders { first: 1, last: 1 };
    let of = |shapes: &str| forward_of(&with(shapes), orders, &["y", "cam"], &["all"], 1 << 10).split_off(1);
    let alone = of(&front);
    for (name, behind) in [("shelf", sheet(shelf, "0.2,0.6,0.9")), ("ridge", slope(-60) + &slope(-130))] {
        for (k, (a, b)) in alone.iter().zip(of(&format!("{front}{behind}"))).enumerate() {
            let se = a.error[0].hypot(b.error[0]);
            println!("{name} {k}: {} {} +- {se}", a.value[0], b.value[0]);
            assert!((a.value[0] - b.value[0]).abs() <= 4.5 * se && se <= 0.02 * a.value[0].abs(), "{name} {k}");
        }
    }
}
