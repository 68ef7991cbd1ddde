//! `fit`: finds what made a picture, and tells when it did not.

use crate::fog::Folder;
use serde_json::Value;
use std::fs;

/// The target has another seed than the fit, and many more samples.
const FIT: &str = r#"
scene = "fog.xml"
wrt = ["sigma_t", "albedo"]
seeds = [3]
spp = 8
[target]
values = { sigma_t = 1.1, albedo = 0.6 }
spp = 2048
seed = 9
[bounds]
sigma_t = [0.05, 2]
albedo = [0.1, 0.99]
[[start]]
sigma_t = 0.4
albedo = 0.9
[[start]]
sigma_t = 1.8
"#;

fn json(f: &Folder, name: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(f.path(name)).unwrap()).unwrap()
}

#[test]
fn a_fog_is_recovered_from_two_starts() {
    let f = Folder::new();
    fs::create_dir(f.path("sub")).unwrap();
    fs::write(f.path("sub/fit.toml"), FIT.replace("fog.xml", "../fog.xml")).unwrap();
    f.run(0, "fit sub/fit.toml -o out --frames 3");
    let v = json(&f, "out/fit.json");
    assert_eq!(v["converged"], true);
    for run in v["runs"].as_array().unwrap() {
        // 3 % of the extents, some four standard deviations of such a fit.
        for (name, extent) in [("sigma_t", 1.95), ("albedo", 0.89)] {
            let error = run["error_to_truth"][name].as_f64().unwrap();
            assert!(error.abs() < 0.03 * extent, "{name}: {run}");
        }
    }
    assert_eq!(v["runs"][1]["start"]["albedo"], 0.8);
    let files =
        "history.csv loss.svg loss.png sigma_t.svg albedo.png target.exr animation_1.png animation_2.png stills_2.png";
    for name in files.split(' ') {
        assert!(f.path("out").join(name).exists(), "{name}");
    }
    let history = fs::read_to_string(f.path("out/history.csv")).unwrap();
    let head = "run,seed,iteration,seconds,loss,loss_error,sigma_t,albedo,gradient_sigma_t,gradient_albedo";
    assert_eq!(history.lines().next(), Some(head));
    let iterations: u64 = v["runs"].as_array().unwrap().iter().map(|r| r["iterations"].as_u64().unwrap()).sum();
    assert_eq!(history.lines().count() as u64, iterations + 1);
    // A folder with something in it is not touched without being told to.
    f.run(4, "fit sub/fit.toml -o out");

    // The target as a file, options instead of settings, one parameter.
    let line =
        "fit fog.xml --wrt albedo --bounds albedo=0.1,0.99 --target out/target.exr -D sigma_t=1.1 -o two --frames 0";
    let (out, _) = f.run(0, line);
    assert!(out.contains("converged"), "{out}");
    let found = json(&f, "two/fit.json")["runs"][0]["values"]["albedo"].as_f64().unwrap();
    assert!((found - 0.6).abs() < 0.02, "{found}");

    // Too short a run says so.
    let (_, err) = f.run(3, "fit sub/fit.toml -o short --iterations 5 --frames 0");
    assert!(err.contains("run 1 (the iterations are over)") && err.contains("help: "), "{err}");
    assert_eq!(json(&f, "short/fit.json")["converged"], false);
}

#[test]
fn bad_input_is_named() {
    let f = Folder::new();
    fs::write(f.path("a.exr"), "no picture").unwrap();
    for (line, part) in [
        ("fit fog.xml --wrt albedo --bounds albedo=0,1", "there is no picture to match"),
        ("fit fog.xml --target a.exr", "nothing to find"),
        ("fit fog.xml --wrt albedo --target a.exr", "`albedo` has no bounds"),
        ("fit fog.xml --wrt albedo --bounds albedo=0,1 --target a.exr", "a.exr"),
        ("fit fog.xml --wrt albedo --bounds albedo=0,1 --target none.exr", "none.exr"),
        ("fit fog.xml --wrt glow --target a.exr", "no parameter `glow`"),
        ("fit fog.xml --wrt albedo --bounds albedo=0,0.5 --target a.exr", "outside its bounds"),
        ("fit fog.xml --wrt albedo --bounds albedo=0,1 --start x=1 --target a.exr", "start: `x`"),
        ("fit fog.xml --wrt albedo --bounds albedo=0,1 --bounds sigma_t=0,1 --target a.exr", "--bounds: `sigma_t`"),
        ("fit fog.xml --wrt albedo --bounds albedo=0.1,5 --target a.exr", "--bounds: `albedo` cannot be 5: "),
        ("fit none.toml", "none.toml"),
    ] {
        let (_, err) = f.run(2, line);
        assert!(err.contains(part) && err.contains("help: "), "`{line}`: {err}");
    }
    for (text, part) in [
        ("wrt = [\"albedo\"]", "names no scene"),
        ("scene = \"fog.xml\"\nwrt = [\"albedo\"]\ntarget = 3", "fit.toml:3:10"),
        ("scene = \"fog.xml\"\n\nwrong = 1", "fit.toml:3:1"),
        ("scene = \"fog.xml\"\nmax_time = -3", "fit.toml:2:12: `max_time`"),
        ("scene = \"fog.xml\"\nstop = { window = 0, tolerance = -1 }", "fit.toml:2:19: `stop`"),
        ("scene = \"fog.xml\"\nwrt = [\"albedo\"]\n[bounds]\nalbdeo = [0, 1]", "fit.toml:4:10"),
        (
            "scene = \"fog.xml\"\nwrt = [\"albedo\"]\ntarget = \"a.exr\"\nbounds = { albedo = [-1, 1] }",
            "fit.toml:4:21: [bounds]: `albedo` cannot be -1: ",
        ),
        (
            "scene = \"fog.xml\"\nwrt = [\"albedo\"]\ntarget = { values = { glow = 1 } }\nbounds = { albedo = [0, 1] }",
            "no parameter `glow`",
        ),
    ] {
        fs::write(f.path("fit.toml"), text).unwrap();
        let (_, err) = f.run(2, "fit fit.toml");
        assert!(err.contains(part) && err.contains("help: "), "{text}\n{err}");
    }
    assert!(!f.path("fit.fit").exists() && !f.path("fog.fit").exists());
}
