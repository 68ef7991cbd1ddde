//! Flat faces that pass through each other (`term::cuts`): the lines in which they meet, which are edges of the picture, and borders of faces.

use crate::common::{against_differences, difference, forward_of, job, params, scene};
use tyndall::math::DVec3;
use tyndall::render::driver::Mode;
use tyndall::scene::compile::Orders;
use tyndall::term::Motion;

const VIEW: &str = r#"<sensor type="perspective"><float name="fov" value="34"/><transform name="to_world"><lookat origin="$cam, 0.9, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="6"/><rfilter type="tent"/></film></sensor>"#;

/// Two sheets that move alike and pass through each other in a line through the middles of both; a third that neither meets.
fn sheets(light: &str) -> String {
    let sheet = |place: &str, c: &str| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world">{place}<translate x="$x"/></transform><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="{c}"/></bsdf></bsdf></shape>"#
        )
    };
    format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="cam" value="0.4"/>
  <integrator type="path"><integer name="max_depth" value="3"/></integrator>{VIEW}{}{}{}{light}</scene>"#,
        sheet(r#"<rotate y="1" angle="15"/>"#, "0.8,0.6,0.2"),
        sheet(r#"<scale x="0.7" y="0.6"/><rotate y="1" angle="-80"/><rotate z="1" angle="20"/>"#, "0.2,0.6,0.9"),
        sheet(r#"<rotate x="1" angle="-90"/><scale value="2"/><translate y="-1.2"/>"#, "0.5"),
    )
}

const POINT: &str = r#"<emitter type="point"><point name="position" value="-1.6, 1.9, 2.4"/><rgb name="intensity" value="9,8,7"/></emitter>"#;

/// The lines that `--wrt` these finds, which nothing refuses.
fn lines(text: &str, wrt: &[&str]) -> Vec<[DVec3; 2]> {
    let (desc, sc) = scene(text);
    let p = params(&desc, &sc, wrt);
    job(&sc, 32, 1, Mode::Forward(&p)).refuse().unwrap_or_else(|e| panic!("{e}"));
    let motion = Motion::new(&sc, &sc.sensors[0], &p).unwrap();
    let edges = motion.edges(&sc);
    let cuts = (0..edges.len()).filter(|&i| edges.is_cut(i)).map(|i| edges.get(&sc, i).edge);
    cuts.map(|e| [e.a, e.b]).collect()
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
    let text = sheets(POINT);
    assert_eq!(lines(&text, &["x"]).len(), 1);
    assert_eq!(lines(&text, &["x"]), lines(&text, &["cam"]));
}

/// Sheets that move, and a camera before them.
#[test]
fn sheets_through_each_other() {
    let text = sheets(POINT);
    against_differences(&text, &[("x", 0.03), ("cam", 0.03)], &["all"], 1 << 13, 0.02);
    // Light from the floor: on either side of the line each sheet hides another part of it.
    let orders = Orders { first: 2, last: 2 };
    let ours = &forward_of(&text, orders, &["x"], &["all"], 1 << 14)[1];
    let fd = difference(&text, orders, "x", 0.03, 1 << 17);
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
