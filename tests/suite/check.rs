//! `check`: passes where the derivative is right, fails where it is not, and says so by its exit code.
//!
//! A comparison raises a false alarm with probability 1e-4 a look (`study::agreement`); seeds are fixed.

use crate::fog::{Folder, SCENE};
use std::path::Path;
use std::time::Duration;
use tyndall::error::Error;
use tyndall::render::family::{Family, Member, View};
use tyndall::study::check::{self, CheckOptions, CheckReport, Place, Verdict};

/// Check with our derivative times a factor, to 4 % (the command's own test below: 2 %).
fn run(wrt: &[&str], factor: f64) -> CheckReport {
    let family = Family::text(SCENE, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let names: Vec<String> = wrt.iter().map(|s| s.to_string()).collect();
    let options = CheckOptions {
        seed: 5,
        max_time: Duration::from_secs(60),
        spp: Some(128),
        tolerance: 0.04,
        ..CheckOptions::default()
    };
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

/// A difference over a wide interval is the mean of the derivative there, and not the derivative in its middle: the first passes, the second does not.
#[test]
fn differences_are_means_over_their_interval() {
    let family = Family::text(SCENE, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let wrt = ["sigma_t".to_string()];
    let options = |place| CheckOptions {
        seed: 7,
        max_time: Duration::from_secs(60),
        tolerance: 0.04,
        step: Some(0.58),
        place,
        ..CheckOptions::default()
    };
    let ours = check::ours(view);
    let run = |options: &CheckOptions, estimator: &check::Estimator| {
        let found = check::check(&family, view, &wrt, options, estimator, &mut |s| println!("{s}"));
        found.unwrap_or_else(|e| panic!("{e}")).parameters.swap_remove(0)
    };
    let p = run(&options(Place::Interval), &ours);
    assert_eq!(p.verdict, Verdict::Pass, "{:?}", p.blocks);
    let [a, b] = p.interval.unwrap();
    assert!((a - 0.02).abs() < 1e-12 && (b - 1.18).abs() < 1e-12 && p.step_bias == 0.0);
    let middle = family.at(&[]).unwrap();
    let still = |_: &_, params: &_, spp, seed, health: &_| ours(&middle, params, spp, seed, health);
    assert_eq!(run(&options(Place::Interval), &still).verdict, Verdict::Fail);
    // At the value itself the step's bias is known as such.
    let p = run(&options(Place::Value), &ours);
    assert!(p.interval.is_none() && p.step_bias > 0.0 && p.verdict != Verdict::Fail, "{:?}", p.blocks);
}

/// What glows evenly has no variance: sides that differ by the last bit of a sum agree, sides that differ by a part in a million do not.
#[test]
fn rounding_is_no_difference() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/emissive_slab/scene.xml");
    let family = Family::text(&std::fs::read_to_string(&path).unwrap(), &path);
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let ours = check::ours(view);
    let names = ["le", "sigma_t", "albedo", "half"].map(String::from);
    let run = |names: &[String], factor: f64| {
        let scaled = |member: &_, params: &_, spp, seed, health: &_| {
            let mut layers: Vec<Vec<f64>> = ours(member, params, spp, seed, health)?;
            layers[1..].iter_mut().flatten().for_each(|x| *x *= factor);
            Ok(layers)
        };
        let options = CheckOptions { seed: 5, max_time: Duration::from_secs(60), ..CheckOptions::default() };
        check::check(&family, view, names, &options, &scaled, &mut |s| println!("{s}"))
            .unwrap_or_else(|e| panic!("{e}"))
    };
    for p in run(&names, 1.0).parameters {
        assert_eq!((p.verdict, p.pixels.fail), (Verdict::Pass, 0), "{}: {:?}", p.name, p.blocks);
    }
    assert_eq!(run(&names[..1], 1.0 + 1e-6).parameters[0].verdict, Verdict::Fail);
    // The picture of an albedo of 1 is 0, its derivative is not.
    let white =
        std::fs::read_to_string(&path).unwrap().replace(r#"name="albedo" value="0.625""#, r#"name="albedo" value="1""#);
    let family = Family::text(&white, &path);
    let options = CheckOptions { max_spp: 64, ..CheckOptions::default() };
    let found = check::check(&family, view, &names[2..3], &options, &ours, &mut |s| println!("{s}"));
    let p = &found.unwrap_or_else(|e| panic!("{e}")).parameters[0];
    assert_eq!((p.verdict, p.pixels.fail), (Verdict::Pass, 0), "{:?}", p.blocks);
    assert!(p.spp_ours <= 64.0 && p.spp_differences <= 64.0, "{} {}", p.spp_ours, p.spp_differences);
}

/// What glows at 1200 kelvin is 5e6 times as bright between 720 and 1680: over that interval places of the derivative would be noise. A narrower one is taken.
#[test]
fn intervals_end_where_the_derivative_gets_steep() {
    let text = r#"<scene version="3.0.0"><default name="t" value="1200"/><integrator type="volpath"><integer name="max_depth" value="1"/></integrator>
  <sensor type="orthographic"><film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="glow"><float name="sigma_t" value="1"/><float name="albedo" value="0"/><float name="temperature" value="$t"/></medium>
  <shape type="cube"><transform name="to_world"><translate z="2"/></transform><bsdf type="null"/><ref name="interior" id="glow"/></shape></scene>"#;
    let family = Family::text(text, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let options = CheckOptions { seed: 5, max_time: Duration::from_secs(60), ..CheckOptions::default() };
    let found = check::check(&family, view, &["t".to_string()], &options, &check::ours(view), &mut |s| println!("{s}"));
    let p = &found.unwrap_or_else(|e| panic!("{e}")).parameters[0];
    let [a, b] = p.interval.unwrap();
    assert!(1200.0 - a <= 125.0 && b - 1200.0 <= 125.0, "{a} {b}");
    assert_eq!(p.verdict, Verdict::Pass, "{:?}", p.blocks);
}

/// Places of neighbouring strata mirror each other: a derivative that grows evenly over the interval has no noise from where it is taken.
#[test]
fn places_mirror_each_other() {
    let family = Family::text(SCENE, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let options = CheckOptions { spp: Some(64), max_spp: 64, step: Some(0.3), ..CheckOptions::default() };
    let grows = |power: i32| {
        let estimator = move |member: &Member, _: &_, _, _, _: &_| {
            let value = member.desc.params[member.desc.wrt("sigma_t")?].value;
            Ok(vec![vec![0.0; 3 * 256], vec![value.powi(power); 3 * 256]])
        };
        let names = ["sigma_t".to_string()];
        let found = check::check(&family, view, &names, &options, &estimator, &mut |s| println!("{s}"));
        found.unwrap_or_else(|e| panic!("{e}")).parameters[0].error_ours
    };
    assert!(grows(1) < 1e-12 && grows(2) > 1e-4, "{} {}", grows(1), grows(2));
}

/// A ball over a floor: within the widest interval it would pass through it, which the derivative refuses. A narrower one is taken.
#[test]
fn intervals_end_before_what_is_refused() {
    let text = r#"<scene version="3.0.0"><default name="y" value="0.4"/><integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 1, 4" target="0, 0.3, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" value="0, $y, 0"/><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>
  <emitter type="point"><point name="position" value="1, 3, 2"/><rgb name="intensity" value="10"/></emitter></scene>"#;
    let family = Family::text(text, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let options = CheckOptions { spp: Some(64), max_spp: 64, ..CheckOptions::default() };
    let found = check::check(&family, view, &["y".to_string()], &options, &check::ours(view), &mut |s| println!("{s}"));
    let p = &found.unwrap_or_else(|e| panic!("{e}")).parameters[0];
    let [a, b] = p.interval.unwrap();
    assert!(a > 0.3 && b < 0.5 && p.verdict != Verdict::Fail && p.spp_ours <= 64.0, "{a} {b} {:?}", p.blocks);
}

/// A place that only the derivative refuses, in the middle of an interval whose ends it takes: narrower ones are tried, unless a step was asked for.
#[test]
fn intervals_get_narrower_where_a_place_within_is_refused() {
    let family = Family::text(SCENE, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let ours = check::ours(view);
    let options = |step| CheckOptions { spp: Some(64), max_spp: 64, step, ..CheckOptions::default() };
    let run = |step: Option<f64>| {
        let refuses = |member: &Member, params: &_, spp, seed, health: &_| {
            let value = member.desc.params[member.desc.wrt("sigma_t")?].value;
            if (0.65..0.75).contains(&value) {
                return Err(Error::usage("no", "remedy"));
            }
            ours(member, params, spp, seed, health)
        };
        check::check(&family, view, &["sigma_t".to_string()], &options(step), &refuses, &mut |s| println!("{s}"))
    };
    let found = run(None).unwrap_or_else(|e| panic!("{e}"));
    let p = &found.parameters[0];
    let [a, b] = p.interval.unwrap();
    assert!(a < p.value && b < 0.75 && p.verdict != Verdict::Fail, "{a} {b} {:?}", p.blocks);
    let error = run(Some(0.58)).err().unwrap().to_string();
    assert!(error.contains("--at value"), "{error}");
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
    // There is no interval around it.
    assert!(r.parameters[0].interval.is_none());
}

#[test]
fn the_command_tells_by_its_exit_code() {
    let f = Folder::new();
    let run = |code, line: &str| f.run(code, line);
    let (out, _) = run(0, "check fog.xml --wrt albedo --sheet s.png -o r.json --json");
    let v: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(v["verdict"], "pass");
    assert!(v["parameters"][0]["blocks"]["relative_error"].as_f64().unwrap() <= 0.02);
    assert!(f.path("s.png").exists() && f.path("r.json").exists());
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

/// A derivative too slow for its time is taken from shorter rounds, not at 64 samples a pixel whatever they take; two sides of 0 are no pass then.
#[test]
fn rounds_fit_the_time() {
    let idle = r#"<default name="idle" value="1"/><medium type="homogeneous" id="nowhere"><float name="sigma_t" value="$idle"/></medium><default"#;
    let text = SCENE.replacen("<default", idle, 1);
    let family = Family::text(&text, &Path::new(env!("CARGO_MANIFEST_DIR")).join("check.xml"));
    let terms = vec!["all".to_string()];
    let view = View { sensor: 0, crop: [0, 0, 16, 16], terms: &terms, stop: None };
    let ours = check::ours(view);
    let slow = |member: &_, params: &_, spp, seed, health: &_| {
        std::thread::sleep(Duration::from_millis(10 * spp));
        ours(member, params, spp, seed, health)
    };
    let mut said = String::new();
    let mut run = |name: &str, seconds: u64, estimator: &check::Estimator| {
        let max_time = Duration::from_secs(seconds);
        let options = CheckOptions { seed: 5, max_time, step: Some(0.1), ..CheckOptions::default() };
        let found = check::check(&family, view, &[name.to_string()], &options, estimator, &mut |s| said += &s);
        found.unwrap_or_else(|e| panic!("{e}")).parameters.swap_remove(0)
    };
    assert_eq!(run("idle", 60, &ours).verdict, Verdict::Pass);
    assert_eq!(run("idle", 2, &slow).verdict, Verdict::Undecided);
    let p = run("albedo", 2, &slow);
    // First rounds, and one more look.
    assert!(p.spp_ours < 300.0 && p.error_ours > 0.0 && p.error_differences > 0.0, "{} {}", p.spp_ours, p.error_ours);
    assert!(p.verdict != Verdict::Fail && said.contains("shorter rounds"), "{said}");
}
