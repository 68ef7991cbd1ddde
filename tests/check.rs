//! `check`: passes where the derivative is right, fails where it is not, and says so by its exit code.
//!
//! A comparison raises a false alarm with probability 1e-4 a look (`study::agreement`); seeds are fixed.

use std::path::Path;
use std::process::Command;
use std::time::Duration;
use tyndall::render::family::{Family, View};
use tyndall::study::check::{self, CheckOptions, CheckReport, Verdict};

/// A ball in a fog cube under a lamp, coarse: 16 x 16 pixels. `tint` is that of a ball that no light reaches.
const SCENE: &str = r#"<scene version="3.0.0">
  <default name="sigma_t" value="0.6"/><default name="albedo" value="0.8"/><default name="full" value="1"/>
  <default name="tint" value="0.5"/><?diff param="sigma_t" min="0" max="3"?>
  <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/></medium>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="sphere"><float name="radius" value="0.5"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.5, $full"/></bsdf></shape>
  <shape type="sphere"><float name="radius" value="0.3"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="$tint"/></bsdf></shape>
  <sensor type="perspective"><float name="fov" value="30"/>
    <transform name="to_world"><lookat origin="0, 0, -4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>
  <emitter type="point"><point name="position" value="1.5, 2, -1.2"/><rgb name="intensity" value="10, 8, 6"/></emitter>
</scene>"#;

/// Check with our derivative times a factor, to 4 % (the command's own test below: 2 %).
fn run(wrt: &[&str], factor: f64) -> CheckReport {
    let family = Family::text(SCENE, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let names: Vec<String> = wrt.iter().map(|s| s.to_string()).collect();
    let options =
        CheckOptions { seed: 5, max_time: Duration::from_secs(60), tolerance: 0.04, ..CheckOptions::default() };
    let ours = check::ours(view);
    let scaled = |member: &_, params: &_, spp, seed, health: &_| {
        let mut layers: Vec<Vec<f64>> = ours(member, params, spp, seed, health)?;
        layers[1..].iter_mut().flatten().for_each(|x| *x *= factor);
        Ok(layers)
    };
    check::check(&family, view, &names, &options, &scaled, &mut |s| println!("{s}")).unwrap_or_else(|e| panic!("{e}"))
}

#[test]
fn a_right_derivative_passes() {
    let r = run(&["sigma_t", "albedo"], 1.0);
    for p in &r.parameters {
        assert_eq!(p.verdict, Verdict::Pass, "{}: {:?}", p.name, p.blocks);
        assert!(p.blocks.relative_error <= 0.04 && p.blocks.error > 0.0);
        assert_eq!(p.blocks.places, 4);
        assert_eq!(p.pixels.fail, 0);
    }
    assert_eq!(r.verdict, Verdict::Pass);
    assert_eq!(r.health.biasing(), 0);
}

#[test]
fn a_wrong_derivative_fails() {
    let r = run(&["albedo"], 1.1);
    assert_eq!(r.verdict, Verdict::Fail, "{:?}", r.parameters[0].blocks);
    assert_eq!(run(&["albedo"], 0.0).verdict, Verdict::Fail);
}

/// Both sides are exactly 0.
#[test]
fn no_derivative_passes() {
    let r = run(&["tint"], 1.0);
    assert_eq!((r.verdict, r.parameters[0].blocks.mean_abs), (Verdict::Pass, 0.0));
    assert_eq!(r.parameters[0].blocks.relative_error, 0.0);
}

/// A reflectance of 1 has values on one side only, and paths that end by it take another turn rarely.
#[test]
fn the_border_of_a_domain_has_one_side() {
    let r = run(&["full"], 1.0);
    assert_eq!(r.verdict, Verdict::Pass, "{:?}", r.parameters[0].blocks);
    assert_eq!(r.parameters[0].side, tyndall::study::differences::Side::Backward);
}

#[test]
fn the_command_tells_by_its_exit_code() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("fog.xml"), SCENE).unwrap();
    let run = |code: i32, line: &str| {
        let o = Command::new(env!("CARGO_BIN_EXE_tyndall")).args(line.split(' ')).current_dir(dir.path()).output();
        let o = o.unwrap();
        let text = |b: &[u8]| String::from_utf8_lossy(b).into_owned();
        assert_eq!(o.status.code(), Some(code), "`{line}`\n{}\n{}", text(&o.stdout), text(&o.stderr));
        (text(&o.stdout), text(&o.stderr))
    };
    let (out, _) = run(0, "check fog.xml --wrt albedo --sheet s.png -o r.json --json");
    let v: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(v["verdict"], "pass");
    assert!(v["parameters"][0]["blocks"]["relative_error"].as_f64().unwrap() <= 0.02);
    assert!(dir.path().join("s.png").exists() && dir.path().join("r.json").exists());
    run(4, "check fog.xml --wrt albedo -o r.json");
    // Too few samples: undecided.
    let (out, err) = run(3, "check fog.xml --wrt sigma_t --spp 1 --max-spp 40");
    assert!(out.contains("undecided") && err.contains("--max-time"), "{out}{err}");
    let (_, err) = run(2, "check fog.xml --wrt sigma");
    assert!(err.contains("`sigma_t`"), "{err}");
    let (_, err) = run(2, "check fog.xml --wrt albedo --step 3");
    assert!(err.contains("smaller step"), "{err}");
    run(2, "check fog.xml --wrt albedo --step fine");
    run(2, "check fog.xml --wrt albedo --sheet s.jpg");
    run(2, "check fog.xml --wrt albedo --terms everything");
}
