//! `converge`: table, report and plots; errors fall with the square root of time.

use crate::fog::Folder;
use serde_json::Value;
use std::fs;

#[test]
fn errors_are_measured_against_a_reference() {
    let f = Folder::new();
    let (out, err) = f.run(0, "converge fog.xml --wrt albedo --time 4s -o c.csv --json --progress json");
    let progress: Vec<Value> = err.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let done: Vec<f64> = progress.iter().map(|l| l["done"].as_f64().unwrap()).collect();
    assert!(!done.is_empty() && done.is_sorted() && done.iter().all(|d| (0.0..=1.0).contains(d)), "{err}");
    assert!(progress[0]["elapsed_seconds"].as_f64().unwrap() >= 1.0 && progress[0]["message"].is_string(), "{err}");
    let v: Value = serde_json::from_str(&out).unwrap();
    let curves = v["curves"].as_array().unwrap();
    let kinds: Vec<&str> = curves.iter().map(|c| c["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds[..2], ["picture", "derivative"]);
    assert_eq!(kinds.iter().filter(|k| **k == "finite_difference").count(), 9);
    for c in &curves[..2] {
        let points = c["points"].as_array().unwrap();
        assert!(points.len() >= 3, "{c}");
        // Independent samples: 16 times as many have a quarter of the error, here within a factor of two.
        let (a, b) = (&points[0], &points[points.len() - 1]);
        let samples = b["spp"].as_f64().unwrap() / a["spp"].as_f64().unwrap();
        let errors = a["rmse"].as_f64().unwrap() / b["rmse"].as_f64().unwrap();
        assert!((0.5..2.0).contains(&(errors / samples.sqrt())), "{c}");
    }
    assert!(v["speedup_over_finite_differences"]["albedo"].as_f64().unwrap() > 0.0);
    let csv = fs::read_to_string(f.path("c.csv")).unwrap();
    assert!(
        csv.starts_with("curve,kind,parameter,step,spp,seconds,rmse,relative_rmse,runs\npicture,picture,,,1,"),
        "{csv}"
    );
    for name in ["c.json", "c.svg", "c.d_albedo.svg"] {
        assert!(f.path(name).exists(), "{name}");
    }
    f.run(4, "converge fog.xml -o c.csv");
    let (_, err) = f.run(0, "converge fog.xml --wrt albedo --time 200ms -o g.csv -v");
    assert!(err.contains("d_albedo: rendering references"), "{err}");
    // The ratio is that of the lowest level that ours reached too; errors fall from level to level.
    let s = &v["speedups"][0];
    let levels = s["levels"].as_array().unwrap();
    let reached: Vec<&Value> = levels.iter().filter(|l| !l["ratio"].is_null()).collect();
    assert_eq!(reached.last().unwrap()["ratio"], s["speedup"]);
    // Curves of different steps may tie: albedo is nearly linear.
    assert!(levels.windows(2).all(|w| w[0]["rmse"].as_f64() >= w[1]["rmse"].as_f64()), "{s}");

    // A reference from a file.
    f.run(0, "render fog.xml --spp 512 --seed 8 -o ref.exr -q");
    let (out, _) = f.run(0, "converge fog.xml --reference ref.exr --time 500ms -o d.csv --json");
    let v: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(v["curves"][0]["reference_spp"], 512.0);
    // One that has all layers of a derivative saves the time of rendering them.
    f.run(0, "grad fog.xml --wrt albedo --split-terms --spp 512 --seed 8 -o ref_d.exr -q");
    let line = "converge fog.xml --wrt albedo --reference ref_d.exr --time 1s -t 1 -o f.csv -v --json";
    let (out, err) = f.run(0, line);
    assert!(!err.contains("rendering references"), "{err}");
    let v: Value = serde_json::from_str(&out).unwrap();
    assert!(v["curves"].as_array().unwrap().iter().all(|c| c["reference_spp"] == 512.0), "{v}");
    let (_, err) = f.run(2, "converge fog.xml --reference none.exr -o e.csv");
    assert!(err.contains("none.exr") && err.contains("help: "), "{err}");
    let (_, err) = f.run(2, "converge fog.xml --crop 0,0,8,8 --reference ref.exr --wrt albdo -o e.csv");
    assert!(err.contains("did you mean `albedo`"), "{err}");
}

/// A point light's shadow in fog: without its room the derivative keeps an error that no sample takes off, the same as that of `--terms interior`.
#[test]
fn without_a_term_an_error_stays() {
    let f = Folder::new();
    let scene = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/point_light/scene.xml");
    let (out, _) = f.run(0, &format!("converge {scene} --wrt light_x --time 8s --ablate -o c.csv --json"));
    let v: Value = serde_json::from_str(&out).unwrap();
    let curve = |name: &str| v["curves"].as_array().unwrap().iter().find(|c| c["name"] == name).unwrap();
    let last = |name: &str| curve(name)["points"].as_array().unwrap().last().unwrap()["rmse"].as_f64().unwrap();
    assert_eq!(curve("d_light_x without light_shadow")["kind"], "without");
    // What the room adds has a root mean square above half of the derivative's mean size.
    let size = curve("d_light_x")["mean_abs"].as_f64().unwrap();
    assert!(last("d_light_x without light_shadow") > 0.5 * size);
    assert!(last("d_light_x") < 0.8 * last("d_light_x without light_shadow"));
}
