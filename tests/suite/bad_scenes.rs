//! Scenes that are wrong: each must be refused with the right message, at the right place, with a remedy.
//!
//! The first line of each file says what is expected: `<!-- expect: part of the message | line:column -->`, with `-` for
//! an error that has no place in the file, and ` | wrt x` where the error is about a parameter.

use proptest::prelude::*;
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
    read_desc(&desc)
}

fn read_desc(desc: &SceneDesc) -> Result<()> {
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

/// Uses every kind of element; must be accepted as it stands.
const GOOD: &str = r##"<?xml version="1.0" encoding="utf-8"?>
<scene version="2.1.0">
  <default name="light_x" value="0.5"/> <default name="n" value="8"/>
  <default name="kind" value="volpath"/> <default name="c" value="0.1, 0.2, 0.3"/>
  <?diff param="light_x" min="-1.5" max="1.5" step="0.01"?>
  <integrator type="$kind"><integer name="maxDepth" value="$n"/></integrator>
  <bsdf type="diffuse" id="wall"><rgb name="reflectance" value="#ff8000"/></bsdf>
  <alias id="wall" as="floor"/>
  <emitter type="point">
    <point name="position" value="$light_x, 4 -2e-1"/><rgb name="intensity" value="$c"/>
  </emitter>
  <shape type="sphere">
    <float name="radius" value="1.25"/> <point name="center" x="$light_x" z="2"/>
    <boolean name="flipNormals" value="true"/> <ref id="floor"/>
    <medium name="interior" type="homogeneous"/>
    <transform name="toWorld">
      <translate x="1" y="$light_x"/> <rotate value="1, 2, 3" angle="$light_x"/> <scale value="2"/>
      <lookat origin="0, 0, 5" target="$light_x, 0, 0" up="0, 1, 0"/> <matrix value="1 0 0  0 2 0  0 1 3"/>
    </transform>
  </shape>
  <shape type="sphere"><ref id="wall"/><spectrum name="unused" value="0.5"/></shape>
</scene>
"##;

fn read_text(text: &str) -> Result<SceneDesc> {
    let desc = SceneDesc::parse(text, Path::new("good.xml"), &[])?;
    read_desc(&desc)?;
    for p in &desc.params {
        if let Ok(i) = desc.wrt(&p.name) {
            let env = desc.dual(i);
            for shape in desc.root.children("shape") {
                shape.transform(&env, "to_world")?;
            }
        }
    }
    Ok(desc)
}

#[test]
fn a_good_scene_is_accepted() {
    let good = GOOD.replace(r#"<spectrum name="unused" value="0.5"/>"#, "");
    let desc = read_text(&good).unwrap();
    assert!(desc.warnings.is_empty(), "{:?}", desc.warnings);
    assert_eq!(desc.wrt("light_x").unwrap(), 0);
    assert_eq!(desc.params[0].real_uses, 5);
    assert!(read_text(GOOD).unwrap_err().to_string().contains("`unused`"));
}

#[test]
fn deep_nesting_is_an_error_not_an_overflow() {
    let text = |n: usize| {
        let open = "<bsdf type=\"twosided\">".repeat(n);
        format!("<scene version=\"3.0.0\">{open}{}</scene>", "</bsdf>".repeat(n))
    };
    SceneDesc::parse(&text(20), Path::new("deep.xml"), &[]).unwrap();
    for n in [100, 200_000] {
        let e = SceneDesc::parse(&text(n), Path::new("deep.xml"), &[]).unwrap_err();
        assert!(e.to_string().contains("nested deeper"), "{e}");
    }
    let chain: String =
        (0..500).map(|i| format!("<bsdf type=\"t\" id=\"b{i}\"><ref id=\"b{}\"/></bsdf>", (i + 1).min(500))).collect();
    let text = format!("<scene version=\"3.0.0\">{chain}<bsdf type=\"t\" id=\"b500\"/></scene>");
    let e = SceneDesc::parse(&text, Path::new("deep.xml"), &[]).unwrap_err();
    assert!(e.to_string().contains("nested deeper"), "{e}");
}

/// One random change of a text.
#[derive(Clone, Debug)]
enum Mutation {
    Delete(usize, usize),
    Insert(usize, String),
    /// Copy a stretch to elsewhere.
    Copy(usize, usize, usize),
    Cut(usize),
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let at = 0..GOOD.len();
    let pieces = proptest::sample::select(vec![
        "$",
        "$light_x",
        "-$n",
        "\"",
        "<",
        ">",
        "/>",
        "<!--",
        "]]>",
        "&",
        "&#0;",
        "nan",
        "1e999",
        "-",
        ",",
        ",,",
        "0",
        "<ref id=\"wall\"/>",
        "<include filename=\"/\"/>",
        "<path value=\".\"/>",
        "<?diff param=\"n\"?>",
        "id=\"wall\"",
        "ü",
        "\u{feff}",
        "\u{0}",
        "<default name=\"n\" value=\"\"/>",
        " xmlns=\"a\" ",
        "</scene>",
    ]);
    prop_oneof![
        (at.clone(), 1..40usize).prop_map(|(i, n)| Mutation::Delete(i, n)),
        (at.clone(), pieces).prop_map(|(i, s)| Mutation::Insert(i, s.to_owned())),
        (at.clone(), "\\PC{0,6}").prop_map(|(i, s)| Mutation::Insert(i, s)),
        (at.clone(), 1..80usize, at.clone()).prop_map(|(i, n, j)| Mutation::Copy(i, n, j)),
        at.prop_map(Mutation::Cut),
    ]
}

fn mutate(text: &str, m: &Mutation) -> String {
    let chars: Vec<char> = text.chars().collect();
    let clip = |i: usize| i.min(chars.len());
    let take = |a: usize, b: usize| chars[clip(a)..clip(b)].iter().collect::<String>();
    let end = chars.len();
    match m {
        Mutation::Delete(i, n) => take(0, *i) + &take(i + n, end),
        Mutation::Insert(i, s) => take(0, *i) + s + &take(*i, end),
        Mutation::Copy(i, n, j) => take(0, *j) + &take(*i, i + n) + &take(*j, end),
        Mutation::Cut(i) => take(0, *i),
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2000, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the text, reading it ends in a scene or in an error with a place and a remedy.
    #[test]
    fn mutated_scenes_never_panic(mutations in proptest::collection::vec(mutation(), 1..5)) {
        let text = mutations.iter().fold(GOOD.to_owned(), |t, m| mutate(&t, m));
        if let Err(e) = read_text(&text) {
            match &e {
                Error::Scene { span, remedy, .. } => prop_assert!(span.line > 0 && !remedy.is_empty(), "{}", e),
                other => prop_assert!(false, "{}", other),
            }
        }
    }
}

/// Plugins, files and ranges: the whole way to a scene that could be rendered, or to the plan that refuses a parameter.
#[test]
fn plugins_refuse_with_place_and_remedy() {
    use tyndall::render::plan::Plan;
    use tyndall::scene::Scene;
    use tyndall::scene::compile::LoadOptions;
    let n = check_folder("tests/bad_plugins", |path| {
        let desc = SceneDesc::load(path, &[])?;
        if let Some(wrt) = expectation(path).get(2).and_then(|f| f.strip_prefix("wrt ")) {
            return Plan::new(&desc, &[wrt.to_owned()])?.refuse();
        }
        Scene::compile(&desc, &LoadOptions::default()).map(|_| ())
    });
    assert!(n >= 60, "{n} scenes");
}

#[test]
fn repair_voxels_counts_what_it_did() {
    use tyndall::error::WarningKind;
    use tyndall::scene::Scene;
    use tyndall::scene::compile::LoadOptions;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad_plugins/vol_nan.xml");
    let desc = SceneDesc::load(&path, &[]).unwrap();
    let scene = Scene::compile(&desc, &LoadOptions { repair_voxels: true, ..LoadOptions::default() }).unwrap();
    let warning = scene.warnings.iter().find(|w| w.kind == WarningKind::RepairedVoxels).unwrap();
    assert!(warning.what.contains("1 voxels"), "{warning}");
}
