//! Media that shine as black bodies: closed forms, grids against constants, differences, what is refused.

use crate::common::{against_differences, check, forward, params, run, scene, small_vdb};
use tyndall::math::{DVec3, Rgb, blackbody};
use tyndall::render::driver::Mode;

/// One orthographic pixel along +z through the medium `m` between z = 0 and z = 1.7; `t`, `f`, `o` and `e` are parameters.
fn slab(medium: &str, max_depth: i32) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="sigma_t" value="0.8"/><default name="albedo" value="0.625"/>
    {}<default name="f" value="1500"/><default name="o" value="0.2"/><default name="e" value="0.002"/>
    <integrator type="volpath"><integer name="max_depth" value="{max_depth}"/></integrator>
    <medium type="heterogeneous" id="m"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/>
      <float name="emission_scale" value="$e"/><float name="temperature_scale" value="$f"/><float name="temperature_offset" value="$o"/>
      {medium}</medium>
    <sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/><translate x="0.01" y="0.02" z="-1"/></transform>
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
    <shape type="cube"><transform name="to_world"><translate z="1"/><scale x="5" y="5" z="0.85"/></transform><bsdf type="null"/><ref name="interior" id="m"/></shape>
    </scene>"#,
        if medium.contains("$t") { r#"<default name="t" value="1.4"/>"# } else { "" }
    )
}

/// [T] T2 with the radiance of a black body of (1.4 - 0.2) 1500 K = 1800 K.
#[test]
fn a_slab_of_one_temperature() {
    let text = slab(r#"<float name="temperature" value="$t"/>"#, 1);
    let wrt = ["t", "f", "o", "e", "sigma_t", "albedo"];
    let r = forward(&text, &wrt, 1 << 12);
    let (radiance, slope) = blackbody::radiance(1800.0);
    let (kept, e) = (1.0 - f64::exp(-0.8 * 1.7), 0.002);
    let share = 0.375 * kept;
    // In red; the colours are compared below.
    let (l, by_kelvin) = (e * radiance[0], e * slope[0]);
    check("L", &r[0], share * l, 0.001);
    check("dL/dt", &r[1], share * by_kelvin * 1500.0, 0.001);
    check("dL/df", &r[2], share * by_kelvin * 1.2, 0.001);
    check("dL/do", &r[3], -share * by_kelvin * 1500.0, 0.001);
    check("dL/de", &r[4], share * radiance[0], 0.001);
    check("dL/dsigma_t", &r[5], 0.375 * 1.7 * (1.0 - kept) * l, 0.02);
    check("dL/dalbedo", &r[6], -kept * l, 0.02);
    // Blue lies outside of Rec. 709 and ends at 0.
    assert_eq!(radiance[2], 0.0);
    for c in 1..3 {
        assert!((r[0].value[c] - share * e * radiance[c]).abs() < 1e-9, "{:?}", r[0]);
        assert!((r[1].value[c] - share * e * slope[c] * 1500.0).abs() < 1e-9, "{:?}", r[1]);
    }
}

/// A grid of one temperature is that temperature; .vol and .vdb.
#[test]
fn grids_of_one_temperature() {
    let dir = tempfile::tempdir().unwrap();
    let wrt = ["f", "o", "e", "albedo"];
    let all = |medium: &str| forward(&slab(medium, -1), &wrt, 1 << 15);
    let vol = tyndall::medium::grid::vol::Vol {
        res: [2, 2, 2],
        channels: 1,
        bbox: [[0.0; 3], [1.0; 3]],
        values: vec![1.5; 8],
    };
    let path = dir.path().join("one.vol");
    vol.write(&path).unwrap();
    let vol = format!(
        r#"<volume name="temperature" type="gridvolume"><string name="filename" value="{}"/><transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.2"/><scale value="20"/></transform></volume>"#,
        path.display()
    );
    let file = small_vdb(&dir.path().join("one.vdb"), |_| 1.5, "heat");
    let vdb = format!(
        r#"<volume name="temperature" type="openvdb">{file}<transform name="to_world"><scale value="20"/></transform></volume>"#
    );
    let constant = r#"<volume name="temperature" type="constvolume"><float name="value" value="1.5"/></volume>"#;
    let truth = all(constant);
    for medium in [vol, vdb] {
        for (ours, truth) in all(&medium).iter().zip(&truth) {
            for c in 0..3 {
                let se = ours.error[c].hypot(truth.error[c]);
                let d = ours.value[c] - truth.value[c];
                assert!(d.abs() <= 4.5 * se + 1e-9 * truth.value[c].abs(), "{ours:?} {truth:?}");
            }
        }
    }
}

fn hot_middle(p: DVec3) -> f64 {
    1.0 + 0.5 * (-p.length_squared() / 20.0).exp() + 0.02 * p.x
}

/// Temperatures, density and what scatters from a grid each: every parameter against differences.
#[test]
fn parameters_of_a_hot_cloud() {
    let dir = tempfile::tempdir().unwrap();
    let heat = small_vdb(&dir.path().join("heat.vdb"), hot_middle, "heat");
    let fog = small_vdb(&dir.path().join("fog.vdb"), |p| 0.6 + 0.02 * (p.y + p.z), "density");
    let medium = format!(
        r#"<volume name="temperature" type="openvdb">{heat}</volume><volume name="sigma_t" type="openvdb">{fog}</volume><float name="scale" value="$s"/>"#
    );
    let text = slab(&medium, 4)
        .replace(r#"<float name="sigma_t" value="$sigma_t"/>"#, "")
        .replace(r#"<default name="sigma_t" value="0.8"/>"#, r#"<default name="s" value="1.5"/>"#);
    let wrt = [("f", 4.0), ("o", 0.003), ("e", 0.0005), ("s", 0.1), ("albedo", 0.05)];
    against_differences(&text, &wrt, &["all"], 1 << 16, 0.0);

    // Forward and reverse mode are transposes of each other.
    let (desc, sc) = scene(&text);
    let names = wrt.map(|w| w.0);
    let p = params(&desc, &sc, &names);
    let f = run(&sc, 256, 3, Mode::Forward(&p));
    let v = [Rgb([0.3, -0.7, 1.1])];
    let gradient = p.pull_back(&run(&sc, 256, 3, Mode::Reverse(&p, &v)).gradient.unwrap().0);
    for (k, name) in names.iter().enumerate() {
        let d = f.film.mean(k + 1, 0);
        assert!((d.dot(v[0]) - gradient[k]).abs() <= 1e-10 * (d * v[0]).abs().sum(), "{name}: {d:?} {}", gradient[k]);
    }
}

/// A dark ball, and the ball that bounds the medium, move where temperature changes from place to place.
#[test]
fn things_that_move_in_a_hot_cloud() {
    let dir = tempfile::tempdir().unwrap();
    let heat = small_vdb(&dir.path().join("heat.vdb"), hot_middle, "heat");
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="b" value="0"/>
    <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
    <medium type="homogeneous" id="m"><float name="sigma_t" value="0.7"/><float name="albedo" value="0.4"/>
      <float name="emission_scale" value="0.01"/><float name="temperature_scale" value="1300"/><volume name="temperature" type="openvdb">{heat}</volume></medium>
    <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 0, -4" target="0, 0, 1" up="0, 1, 0"/></transform>
      <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
    <shape type="sphere"><transform name="to_world"><scale value="1.1"/><translate x="$b" z="0.9"/></transform><bsdf type="null"/><ref name="interior" id="m"/></shape>
    <shape type="sphere"><transform name="to_world"><scale value="0.3"/><translate x="$x" y="0.2" z="0.7"/></transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="0.3"/></bsdf></shape></scene>"#
    );
    against_differences(&text, &[("x", 0.04), ("b", 0.04)], &["all"], 1 << 16, 0.01);
}

/// The hot cloud as a whole, and its temperatures alone, move, turn and grow past fog that stays or goes along.
#[test]
fn temperatures_that_move() {
    let dir = tempfile::tempdir().unwrap();
    let heat = small_vdb(&dir.path().join("heat.vdb"), hot_middle, "heat");
    let fog = small_vdb(&dir.path().join("fog.vdb"), |p| 0.6 + 0.02 * (p.y + p.z), "density");
    let place = |x: &str| {
        format!(r#"<transform name="to_world"><rotate z="1" angle="$a"/><translate x="{x}" y="0.1"/></transform>"#)
    };
    let medium = format!(
        r#"<volume name="temperature" type="openvdb">{heat}{}</volume><volume name="sigma_t" type="openvdb">{fog}{}</volume>"#,
        place("$x"),
        place("0")
    );
    let text = slab(&medium, 3).replace(r#"<float name="sigma_t" value="$sigma_t"/>"#, "").replace(
        r#"<default name="sigma_t" value="0.8"/>"#,
        r#"<default name="x" value="0.3"/><default name="a" value="20"/>"#,
    );
    against_differences(&text, &[("x", 0.01), ("a", 0.5)], &["all"], 1 << 17, 0.002);
}

/// Shown in `info`, and warned of where nothing glows.
#[test]
fn cold_grids_are_told_of() {
    let dir = tempfile::tempdir().unwrap();
    let heat = small_vdb(&dir.path().join("heat.vdb"), hot_middle, "heat");
    let text = slab(&format!(r#"<volume name="temperature" type="openvdb">{heat}</volume>"#), 1)
        .replace(r#"value="$f""#, r#"value="100""#)
        .replace(r#"<default name="f" value="1500"/>"#, "");
    let (_, s) = scene(&text);
    assert!(s.warnings.iter().any(|w| w.what.contains("temperature reaches")), "{:?}", s.warnings);
}
