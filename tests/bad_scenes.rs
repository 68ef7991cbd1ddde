//! Scenes that are wrong: each must be refused with the right message, at the right place, with a remedy.
//!
//! The first line of each file says what is expected: `<!-- expect: part of the message | line:column -->`, with `-` for
//! an error that has no place in the file, and ` | wrt x` where the error is about a parameter.

use std::path::{Path, PathBuf};
use tyndall::error::{Error, ExitCode, Result};
use tyndall::math::DVec3;
use tyndall::scene::{Env, Node, SceneDesc};

/// The fields of the first line.
fn expectation(path: &Path) -> Vec<String> {
    let bytes = std::fs::read(path).unwrap();
    let text = String::from_utf8_lossy(&bytes);
    let line = text.lines().next().unwrap_or_default();
    let inner = line.strip_prefix("<!-- expect: ").and_then(|l| l.strip_suffix(" -->"));
    let inner = inner.unwrap_or_else(|| panic!("{}: no `<!-- expect: ... -->`", path.display()));
    inner.split(" | ").map(str::to_owned).collect()
}

/// What differs from the expectation, if anything.
fn complaint(path: &Path, outcome: Result<()>) -> Option<String> {
    let expected = expectation(path);
    let Err(error) = outcome else { return Some("accepted".into()) };
    let (place, what, remedy) = match &error {
        Error::Scene { span, what, remedy } => (format!("{}:{}", span.line, span.column), what, remedy),
        Error::Usage { what, remedy } => ("-".into(), what, remedy),
        _ => return Some(format!("neither a scene nor a usage error: {error}")),
    };
    let right = what.contains(&expected[0]) && place == expected[1];
    let told =
        !remedy.trim().is_empty() && error.to_string().contains("help: ") && error.exit_code() == ExitCode::Scene;
    (!right || !told).then(|| format!("at {place}: {error}"))
}

/// Run every scene of a folder; returns how many there were.
fn check_folder(folder: &str, run: impl Fn(&Path) -> Result<()>) -> usize {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let entries = std::fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == "xml")).collect();
    files.sort();
    let name = |p: &Path| p.file_stem().unwrap().to_string_lossy().into_owned();
    let wrong: Vec<String> =
        files.iter().filter_map(|p| complaint(p, run(p)).map(|c| format!("{}: {c}", name(p)))).collect();
    assert!(wrong.is_empty(), "{} of {}:\n{}", wrong.len(), files.len(), wrong.join("\n"));
    files.len()
}

/// A small stand-in for the compiler: reads a few plugins, then asks for what is left unread.
fn read_scene(path: &Path) -> Result<()> {
    let desc = SceneDesc::load(path, &[])?;
    if let Some(wrt) = expectation(path).get(2).and_then(|f| f.strip_prefix("wrt ")) {
        return desc.wrt(wrt).map(|_| ());
    }
    let env: Env<f64> = desc.values();
    for integrator in desc.root.children("integrator") {
        integrator.int("max_depth", -1)?;
    }
    for emitter in desc.root.children("emitter") {
        emitter.rgb(&env, "intensity", 1.0)?;
        emitter.point(&env, "position", DVec3::ZERO)?;
    }
    desc.root.children("shape").try_for_each(|s| read_shape(&env, s))?;
    desc.finish()
}

fn read_shape(env: &Env<f64>, shape: &Node) -> Result<()> {
    match shape.plugin.as_str() {
        "sphere" => {
            shape.float(env, "radius", 1.0)?;
            shape.point(env, "center", DVec3::ZERO)?;
        }
        "obj" => {
            shape.path("filename")?;
        }
        _ => return Err(shape.unknown_plugin(&["sphere", "obj"])),
    }
    shape.transform(env, "to_world")?;
    shape.bool("flip_normals", false)?;
    shape.named("interior")?;
    if let Some(bsdf) = shape.child("bsdf")? {
        bsdf.rgb(env, "reflectance", 0.5)?;
    }
    Ok(())
}

#[test]
fn malformed_scenes_are_refused_with_place_and_remedy() {
    assert!(check_folder("tests/bad", read_scene) >= 45);
}

#[test]
fn the_harness_notices_a_wrong_outcome() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad/float_nan.xml");
    assert!(complaint(&path, Ok(())).is_some());
    assert!(complaint(&path, Err(Error::usage("`nan` is not a finite number", "help"))).is_some());
}
