//! The program itself: exit codes, files, JSON, bits.

use std::fs;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;
use tyndall::image::exr::{self, ExrImage};

/// A small fog with a wall and a lamp.
const SCENE: &str = r#"<scene version="3.0.0">
  <default name="sigma_t" value="0.35"/><default name="albedo" value="0.7"/><default name="intensity" value="10"/>
  <default name="light_x" value="1.2"/><default name="depth" value="4"/><default name="size" value="12"/><default name="wall_z" value="6"/>
  <?diff param="sigma_t" min="0" max="1"?>
  <integrator type="volpath"><integer name="max_depth" value="$depth"/></integrator>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/></medium>
  <sensor type="perspective" id="front"><ref id="fog"/>
    <film type="hdrfilm"><integer name="width" value="$size"/><integer name="height" value="8"/></film>
    <sampler type="independent"><integer name="sample_count" value="32"/></sampler></sensor>
  <sensor type="orthographic" id="side"><ref id="fog"/>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film></sensor>
  <shape type="rectangle" id="wall"><transform name="to_world"><scale value="5"/><rotate y="1" angle="180"/><translate z="$wall_z"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.5, 0.4, 0.3"/></bsdf></shape>
  <emitter type="point" id="lamp"><point name="position" value="$light_x, 1.5, 2.5"/><rgb name="intensity" value="$intensity"/>
    <ref id="fog"/></emitter>
</scene>"#;

/// A folder with the scene in it, where commands run.
struct Bench(TempDir);

impl Bench {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        fs::write(dir.path().join("fog.xml"), SCENE).unwrap();
        Bench(dir)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, line: &str) -> Command {
        let mut c = Command::new(env!("CARGO_BIN_EXE_tyndall"));
        c.args(line.split_whitespace()).current_dir(self.0.path());
        c
    }

    fn run(&self, line: &str) -> Ran {
        Ran::new(line, self.command(line).output().unwrap())
    }

    /// Run and expect an exit code.
    #[track_caller]
    fn expect(&self, code: i32, line: &str) -> Ran {
        let r = self.run(line);
        assert_eq!(r.code, Some(code), "`{line}`\n{}\n{}", r.stdout, r.stderr);
        r
    }

    fn exr(&self, name: &str) -> ExrImage {
        exr::read(&self.path(name)).unwrap()
    }

    fn files(&self) -> Vec<String> {
        let name = |e: std::io::Result<fs::DirEntry>| e.unwrap().file_name().into_string().unwrap();
        let mut v: Vec<String> = fs::read_dir(self.0.path()).unwrap().map(name).collect();
        v.sort();
        v
    }
}

struct Ran {
    code: Option<i32>,
    stdout: String,
    stderr: String,
}

impl Ran {
    fn new(line: &str, o: Output) -> Self {
        let text = |b| String::from_utf8(b).unwrap_or_else(|_| panic!("`{line}`: not UTF-8"));
        Ran { code: o.status.code(), stdout: text(o.stdout), stderr: text(o.stderr) }
    }

    /// stdout is one JSON value and nothing else.
    #[track_caller]
    fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|e| panic!("{e}: {}", self.stdout))
    }
}

#[track_caller]
fn same_bits(a: &ExrImage, b: &ExrImage, channels: &[&str]) {
    for c in channels {
        let bits = |i: &ExrImage| i.channel(c).unwrap().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(a), bits(b), "channel {c}");
    }
}

fn names(i: &ExrImage) -> Vec<&str> {
    i.channels.iter().map(|c| c.0.as_str()).collect()
}

#[test]
fn render_writes_picture_and_report() {
    let b = Bench::new();
    let r = b.expect(0, "render fog.xml");
    assert!(r.stdout.contains("12 x 8 pixels, 32 samples a pixel") && r.stdout.contains("0 warnings"), "{}", r.stdout);
    assert_eq!(b.files(), ["fog.exr", "fog.json", "fog.xml"]);
    let i = b.exr("fog.exr");
    assert_eq!((i.width, i.height), (12, 8));
    assert_eq!(names(&i), ["B", "G", "R", "var.B", "var.G", "var.R"]);
    assert!(i.channel("R").unwrap().iter().all(|&x| x > 0.0));
    let text = |name: &str| i.attribute(name).unwrap_or_else(|| panic!("{name}")).as_text().unwrap().to_string();
    assert!(text("software").starts_with("tyndall "));
    assert_eq!(text("sampleRange"), "0-32");
    assert!(text("parameters").contains("\"sigma_t\":0.35"));
    assert_eq!(i.attribute("complete").unwrap().as_integer(), Some(1));
    assert_eq!(i.attribute("spp").unwrap().as_integer(), Some(32));
    assert!(i.attribute("renderTimeSeconds").unwrap().as_real().unwrap() > 0.0);
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(b.path("fog.json")).unwrap()).unwrap();
    assert_eq!(report["scene_hash"], text("sceneHash"));
    assert_eq!(report["complete"], true);
    assert_eq!(report["samples"], 32 * 12 * 8);
    assert!(report["relative_error"].as_f64().unwrap() > 0.0);
    assert!(report["embree"].as_str().unwrap().contains('.'));
}

#[test]
fn json_is_all_there_is_on_stdout() {
    let b = Bench::new();
    b.expect(0, "render fog.xml -q -o ref.exr");
    let r = b.expect(0, "render fog.xml --json -v --progress json -o a.exr");
    assert_eq!(r.json()["spp"], 32);
    let report = fs::read_to_string(b.path("a.json")).unwrap();
    assert_eq!(r.stdout, report);
    // Progress is JSON too, line by line, on stderr.
    let line = r.stderr.lines().find(|l| l.starts_with('{')).unwrap();
    let line: serde_json::Value = serde_json::from_str(line).unwrap();
    assert!(line["done"].as_f64().unwrap() > 0.0 && line["samples_per_second"].as_f64().is_some());
    for line in [
        "grad fog.xml --wrt sigma_t --json -o g.exr",
        "grad fog.xml --wrt sigma_t --json --adjoint ref.exr",
        "plan fog.xml --json",
        "plan fog.xml --wrt sigma_t,light_x --json",
        "info fog.xml --json",
        "info ref.exr --json",
    ] {
        assert!(b.expect(0, line).json().is_object(), "{line}");
    }
    let r = b.expect(2, "render missing.xml --json");
    assert!(r.stdout.is_empty() && r.stderr.starts_with("error: "), "{}", r.stderr);
}

#[test]
fn existing_output_is_kept() {
    let b = Bench::new();
    b.expect(0, "render fog.xml --spp 2");
    let before = fs::read(b.path("fog.exr")).unwrap();
    let r = b.expect(4, "render fog.xml --spp 3");
    assert!(r.stderr.contains("fog.exr exists") && r.stderr.contains("--overwrite"), "{}", r.stderr);
    assert_eq!(fs::read(b.path("fog.exr")).unwrap(), before);
    // The report counts too.
    fs::remove_file(b.path("fog.exr")).unwrap();
    b.expect(4, "render fog.xml");
    b.expect(0, "render fog.xml --spp 3 --overwrite");
    assert_eq!(b.exr("fog.exr").attribute("spp").unwrap().as_integer(), Some(3));
}

#[test]
fn nothing_is_written_on_usage_and_scene_errors() {
    let b = Bench::new();
    fs::write(b.path("bad.xml"), SCENE.replace("homogeneous", "homogenous")).unwrap();
    for (line, message) in [
        ("render", "SCENE"),
        ("render bad.xml", "did you mean `homogeneous`"),
        ("render bad.xml", "bad.xml:6:"),
        ("render missing.xml", "missing.xml"),
        ("render fog.xml --overwrit", "--overwrite"),
        ("rendr fog.xml", "render"),
        ("render fog.xml -D sigmat=1", "did you mean `sigma_t`"),
        ("render fog.xml -D sigma_t", "name=value"),
        ("render fog.xml -D sigma_t=-1", "`$sigma_t` = -1"),
        ("render fog.xml -o out.png", "out.exr"),
        ("render fog.xml -o no/out.exr", "no folder no"),
        ("render fog.xml --preview p.jpg", "p.png"),
        ("render fog.xml --crop 0,0,99,1", "12 x 8"),
        ("render fog.xml --crop 3,0,3,1", "empty"),
        ("render fog.xml --max-time 10", "90s"),
        ("render fog.xml --target-error 0", "greater than 0"),
        ("render fog.xml --spp 0", "--spp"),
        ("render fog.xml --seed -1", "invalid value '-1' for '--seed"),
        ("render fog.xml --log-file no/x.log", "no folder no"),
        ("render fog.xml -t 0", "--threads"),
        ("render fog.xml -s 7", "2 sensors"),
        ("render fog.xml -s fron", "did you mean `front`"),
        ("render fog.xml -s all", "is for gradients"),
        ("grad fog.xml", "--wrt"),
        ("grad fog.xml --wrt sigmat", "did you mean `sigma_t`"),
        ("grad fog.xml --wrt sigma_t,sigma_t", "twice"),
        ("grad fog.xml --wrt depth", "an integer"),
        ("grad fog.xml --wrt fog.sigma_t.grid", "an array has a gradient"),
        ("grad fog.xml --wrt sigma_t --terms face_sweep", "not available yet"),
        ("grad fog.xml --wrt sigma_t --terms interio", "did you mean `interior`"),
        ("grad fog.xml --wrt sigma_t --loss l2", "--target"),
        ("grad fog.xml --wrt sigma_t --adjoint fog.xml", "fog.xml"),
        ("grad fog.xml --wrt sigma_t --adjoint missing.exr", "missing.exr"),
        ("plan fog.xml --wrt nothing", "no parameter `nothing`"),
        ("info missing.vdb", "missing.vdb"),
        ("info fog.xml -D nothing=1", "nothing"),
    ] {
        let r = b.expect(2, line);
        assert!(r.stderr.contains(message), "`{line}`: {}", r.stderr);
        assert!(r.stderr.starts_with("error: ") && r.stdout.is_empty(), "`{line}`: {}", r.stderr);
        assert_eq!(b.files(), ["bad.xml", "fog.xml"], "`{line}`");
    }
}

#[test]
fn a_broken_mesh_is_named() {
    let b = Bench::new();
    let scene = |file: &str| {
        let shape =
            format!("<shape type=\"{}\"><string name=\"filename\" value=\"{file}\"/></shape>", &file[file.len() - 3..]);
        fs::write(b.path("mesh.xml"), SCENE.replace("</scene>", &format!("{shape}</scene>"))).unwrap();
    };
    fs::write(b.path("far.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n").unwrap();
    // Cut in the middle of its vertices.
    let head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
        element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0";
    fs::write(b.path("cut.ply"), head).unwrap();
    for file in ["far.obj", "cut.ply"] {
        scene(file);
        let r = b.expect(2, "render mesh.xml");
        assert!(r.stderr.contains(file) && r.stderr.contains("mesh.xml:"), "{}", r.stderr);
    }
}

#[test]
fn definitions_and_sensors_act() {
    let b = Bench::new();
    b.expect(0, "render fog.xml --spp 4 -o a.exr");
    b.expect(0, "render fog.xml --spp 4 -D intensity=20 -D size=6 -o b.exr");
    assert_eq!((b.exr("a.exr").width, b.exr("b.exr").width), (12, 6));
    b.expect(0, "render fog.xml --spp 4 -D intensity=20 -o c.exr");
    let (a, c) = (b.exr("a.exr"), b.exr("c.exr"));
    // Twice the light, path by path; the film's quantum rounds.
    for (x, y) in a.channel("R").unwrap().iter().zip(c.channel("R").unwrap()) {
        assert!((2.0 * x - y).abs() <= 1e-6 * y, "{x} {y}");
    }
    b.expect(0, "render fog.xml -s side -o d.exr");
    b.expect(0, "render fog.xml -s 1 -o e.exr");
    assert_eq!(b.exr("d.exr").width, 4);
    same_bits(&b.exr("d.exr"), &b.exr("e.exr"), &["R", "G", "B"]);
}

#[test]
fn render_and_grad_give_the_same_picture_on_any_number_of_threads() {
    let b = Bench::new();
    b.expect(0, "render fog.xml -o a.exr");
    let wrt = "--wrt sigma_t,albedo,intensity --split-terms";
    for t in [1, 2, 8] {
        b.expect(0, &format!("grad fog.xml {wrt} -t {t} -o g{t}.exr"));
    }
    let (a, g) = (b.exr("a.exr"), b.exr("g1.exr"));
    same_bits(&a, &g, &["R", "G", "B", "var.R", "var.G", "var.B"]);
    let all = names(&g);
    for c in ["d_sigma_t.R", "var_sigma_t.G", "d_albedo.interior.B", "var_intensity.interior.R"] {
        assert!(all.contains(&c), "{c} in {all:?}");
    }
    assert_eq!(all.len(), 6 + 3 * 12);
    same_bits(&g, &b.exr("g2.exr"), &all);
    same_bits(&g, &b.exr("g8.exr"), &all);
    // The picture is linear in the light, path by path.
    for (x, d) in g.channel("G").unwrap().iter().zip(g.channel("d_intensity.G").unwrap()) {
        assert!((x / 10.0 - d).abs() <= 1e-5 * x, "{x} {d}");
    }
    b.expect(0, "render fog.xml --seed 7 -o s.exr");
    assert_ne!(a.channel("R"), b.exr("s.exr").channel("R"));
}

#[test]
fn a_crop_has_the_pixels_of_the_full_picture() {
    let b = Bench::new();
    b.expect(0, "render fog.xml -o a.exr");
    b.expect(0, "render fog.xml --crop 3,2,9,7 -o b.exr");
    let (a, c) = (b.exr("a.exr"), b.exr("b.exr"));
    assert_eq!((c.width, c.height, c.origin, c.full_size), (6, 5, [3, 2], [12, 8]));
    for name in ["R", "G", "B"] {
        for y in 0..5 {
            for x in 0..6 {
                let (p, q) = (a.channel(name).unwrap()[(y + 2) * 12 + x + 3], c.channel(name).unwrap()[y * 6 + x]);
                // The quantum of the fixed-point sums comes from the pixels rendered: equal but for the last digits of a double.
                assert!((p - q).abs() <= f32::EPSILON * p, "{name} {x} {y}: {p} {q}");
            }
        }
    }
}

#[test]
fn previews_are_pngs() {
    let b = Bench::new();
    b.expect(0, "render fog.xml --spp 4 --preview a.png");
    b.expect(0, "grad fog.xml --wrt sigma_t,albedo --spp 4 --preview b.png");
    assert_eq!(b.files(), ["a.png", "b.png", "fog.exr", "fog.grad.exr", "fog.grad.json", "fog.json", "fog.xml"]);
    for name in ["a.png", "b.png"] {
        assert!(fs::read(b.path(name)).unwrap().starts_with(b"\x89PNG"));
    }
}

#[test]
fn goals_end_a_run() {
    let b = Bench::new();
    // An error that is reached at once: at least eight batches are run.
    let r = b.expect(0, "render fog.xml --spp 320 --target-error 10 --json -o a.exr").json();
    assert_eq!((&r["target_reached"], &r["complete"], &r["spp"]), (&true.into(), &true.into(), &80.into()));
    // Time runs out first, however many samples are asked for: batches begin with one.
    let r =
        b.expect(0, "render fog.xml --spp 4000000000 --target-error 1e-9 --max-time 0.001ms --json -o b.exr").json();
    assert_eq!((&r["target_reached"], &r["complete"], &r["spp"]), (&false.into(), &false.into(), &1.into()));
    // One batch has no error bars, and says so.
    let r = b.expect(0, "render fog.xml --spp 3200 --max-time 0.001ms -o d.exr");
    assert!(r.stderr.contains("error bars need two") && b.exr("d.exr").channel("var.R").is_none(), "{}", r.stderr);
    assert_eq!(b.exr("b.exr").attribute("complete").unwrap().as_integer(), Some(0));
    // Samples run out first.
    let r = b.expect(0, "render fog.xml --spp 8 --target-error 1e-9 --json -o c.exr").json();
    assert_eq!((&r["target_reached"], &r["complete"]), (&false.into(), &true.into()));
}

#[test]
fn the_health_limit_is_an_exit_code() {
    let b = Bench::new();
    // Every sample is out of the film's range and left out.
    let r = b.expect(3, "render fog.xml -D intensity=1e300");
    assert!(r.stderr.contains("health limit") && r.stderr.contains("3072 overflow"), "{}", r.stderr);
    assert_eq!(b.files(), ["fog.exr", "fog.json", "fog.xml"]);
    let r = b.expect(0, "render fog.xml -D intensity=1e300 --health-limit 1 --json --overwrite").json();
    assert_eq!((&r["health_limit_exceeded"], &r["health"]["overflow"]), (&false.into(), &3072.into()));
}

#[test]
fn reverse_mode_is_the_adjoint_of_forward_mode() {
    let b = Bench::new();
    b.expect(0, "render fog.xml --seed 5 -o adj.exr");
    b.expect(0, "grad fog.xml --wrt sigma_t,intensity -o g.exr");
    let r = b.expect(0, "grad fog.xml --wrt sigma_t,intensity --adjoint adj.exr").json();
    let (adjoint, g) = (b.exr("adj.exr"), b.exr("g.exr"));
    for name in ["sigma_t", "intensity"] {
        let dot: f64 = ["R", "G", "B"]
            .iter()
            .flat_map(|c| {
                let d = g.channel(&format!("d_{name}.{c}")).unwrap();
                adjoint.channel(c).unwrap().iter().zip(d).map(|(a, d)| f64::from(*a) * f64::from(*d))
            })
            .sum();
        let reverse = r["gradient"][name].as_f64().unwrap();
        assert!((dot - reverse).abs() <= 1e-5 * dot.abs(), "{name}: {dot} {reverse}");
        assert!(r["standard_error"][name].as_f64().unwrap() > 0.0);
    }
    assert!(!b.files().iter().any(|f| f.ends_with(".grad.json")));
}

#[test]
fn losses_have_gradients() {
    let b = Bench::new();
    b.expect(0, "render fog.xml --spp 256 --seed 5 -D sigma_t=0.5 -o ref.exr");
    for loss in ["l1", "l2", "relative-l2"] {
        let line = format!("grad fog.xml --wrt intensity --loss {loss} --target ref.exr --spp 256 -o {loss}.json");
        b.expect(0, &line);
        let r: serde_json::Value =
            serde_json::from_str(&fs::read_to_string(b.path(&format!("{loss}.json"))).unwrap()).unwrap();
        assert!(r["loss"]["value"].as_f64().unwrap().is_finite());
        assert_eq!((&r["loss"]["kind"], &r["loss"]["spp"], &r["spp"]), (&loss.into(), &128.into(), &128.into()));
        assert!(r["gradient"]["intensity"].as_f64().unwrap() != 0.0);
    }
    b.expect(2, "grad fog.xml --wrt intensity --loss l2 --target ref.exr -D size=13");
}

/// Against a target of the gradient's own random numbers the expectation is not 0 at the true values: 2 cov(I, dI) remains.
#[test]
fn a_gradient_shares_no_samples_with_a_target_of_the_same_seed() {
    let b = Bench::new();
    let target = b.expect(0, "render fog.xml --seed 3 --spp 4 --json -o ref.exr").json();
    let mean = |r: &serde_json::Value| r["layers"][0]["mean"].clone();
    let grad = |end: &str| b.expect(0, &format!("grad fog.xml --wrt intensity --seed 3 {end}")).json();
    // The gradient pass reports the picture that its samples make: with an adjoint, that of the seed itself.
    assert_eq!(mean(&grad("--spp 4 --adjoint ref.exr")), mean(&target));
    let r = grad("--spp 8 --loss l2 --target ref.exr");
    assert_eq!(r["spp"], 4);
    assert_ne!(mean(&r), mean(&target));
    // The same bits again; and a picture of the loss by itself.
    assert_eq!(mean(&grad("--spp 8 --loss l2 --target ref.exr")), mean(&r));
    let seeds = [&r["loss"]["seed"], &r["loss"]["gradient_seed"]].map(|s| s.as_u64().unwrap());
    assert!(seeds[0] != seeds[1] && !seeds.contains(&3), "{seeds:?}");
}

#[test]
fn terms_that_do_not_suffice_are_told() {
    let b = Bench::new();
    for end in ["-o g.exr", "--adjoint g.exr"] {
        let r = b.expect(0, &format!("grad fog.xml --wrt sigma_t --terms light_shadow --spp 2 --json {end}"));
        assert!(r.stderr.contains("(biased): interior"), "{}", r.stderr);
        let v = r.json();
        assert_eq!((&v["plan"][0]["term"], &v["plan"][0]["use"]), (&"interior".into(), &false.into()));
        assert!(v["plan"][0]["reason"].as_str().unwrap().ends_with("left out by --terms"));
        assert_eq!(v["warnings"][0]["kind"], "terms_left_out");
    }
    assert_eq!(b.exr("g.exr").attribute("termsRun").unwrap().as_text(), Some(""));
    let r = b.expect(0, "grad fog.xml --wrt sigma_t --terms interior --spp 2 -o h.exr");
    assert!(!r.stderr.contains("warning"), "{}", r.stderr);
}

#[test]
fn a_stopped_run_leaves_a_whole_file() {
    for (signal, code) in [("INT", 130), ("TERM", 143)] {
        let b = Bench::new();
        // Long as a whole, short in each of its 32 batches.
        let line = "render fog.xml --spp 40000 --progress json";
        let mut child = b.command(line).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        // Progress says that one batch is done.
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let done = |line: &str| serde_json::from_str::<serde_json::Value>(line).unwrap()["done"].as_f64().unwrap();
        let mut line = String::new();
        while line.is_empty() || done(&line) < 1.0 / 32.0 {
            line.clear();
            assert!(stderr.read_line(&mut line).unwrap() > 0);
        }
        for name in ["USR1", signal] {
            let kill = format!("kill -{name} {}", child.id());
            assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
        }
        assert_eq!(child.wait().unwrap().code(), Some(code));
        let i = b.exr("fog.exr");
        assert_eq!(i.attribute("complete").unwrap().as_integer(), Some(0));
        let spp = i.attribute("spp").unwrap().as_integer().unwrap();
        assert!((1250..40000).contains(&spp), "{spp}");
        assert_eq!(b.files(), ["fog.exr", "fog.json", "fog.xml"]);
    }
}

#[test]
fn a_stopped_study_says_that_nothing_is_written() {
    let b = Bench::new();
    b.expect(0, "render fog.xml --spp 2 -q");
    let before = b.files();
    for line in [
        "grad fog.xml --wrt sigma_t --loss l2 --target fog.exr --spp 100000000 -o g.json",
        "check fog.xml --wrt sigma_t --max-time 60s -o c.json",
        "converge fog.xml --time 60s",
    ] {
        let mut child = b.command(line).arg("-v").stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        // The line about the loaded scene: signals are heard by then.
        let mut text = String::new();
        stderr.read_line(&mut text).unwrap();
        let kill = format!("kill -INT {}", child.id());
        assert!(Command::new("sh").args(["-c", &kill]).status().unwrap().success());
        stderr.read_to_string(&mut text).unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(130), "{line}\n{text}");
        assert!(text.contains("nothing is written"), "{line}\n{text}");
        assert_eq!(b.files(), before, "{line}");
    }
}

#[test]
fn version_help_completions_and_man() {
    let b = Bench::new();
    let v = b.expect(0, "--version").stdout;
    assert!(v.starts_with("tyndall ") && v.contains("\nEmbree ") && v.contains("\nOpenVDB "), "{v}");
    for c in ["render", "grad", "info", "plan", "stress"] {
        assert!(b.expect(0, "--help").stdout.contains(c));
        assert!(b.expect(0, &format!("{c} --help")).stdout.contains("Usage:"));
        assert!(b.expect(0, &format!("man {c}")).stdout.contains(&format!("tyndall\\-{c}")));
    }
    for shell in ["bash", "zsh", "fish"] {
        assert!(b.expect(0, &format!("completions {shell}")).stdout.contains("health-limit"));
    }
    let version = v.lines().next().unwrap();
    for page in ["man", "man grad"] {
        let text = b.expect(0, page).stdout;
        let title = text.lines().find(|l| l.starts_with(".TH ")).unwrap();
        assert!(title.trim_end().ends_with(&format!("\"{version}\"")), "{page}: {title}");
        assert!(!text.contains("\nEmbree "), "{page}");
    }
    b.expect(2, "man rendr");
}

#[test]
fn plan_names_what_is_used() {
    let b = Bench::new();
    let plan = b.expect(0, "plan fog.xml --wrt wall_z,sigma_t --json").json();
    let lines = plan["lines"].as_array().unwrap();
    let decision = |letters: &str| lines.iter().find(|l| l["letters"] == letters).unwrap()["decision"].clone();
    assert_eq!((decision("P"), decision("E1"), decision("VE")), ("use".into(), "use".into(), "skip".into()));
    let sure = b.expect(0, "plan fog.xml --wrt light_x");
    assert!(sure.stdout.contains("light_shadow") && !sure.stderr.contains("biased"), "{}", sure.stderr);
    assert_eq!(b.files(), ["fog.xml"]);
    // What `grad` warns of, before it takes any time.
    let ball = r#"<shape type="sphere" id="ball"><bsdf type="roughdielectric"><string name="distribution" value="ggx"/><float name="alpha" value="0.3"/></bsdf></shape></scene>"#;
    fs::write(b.path("ball.xml"), SCENE.replace("</scene>", ball)).unwrap();
    assert!(b.expect(0, "plan ball.xml --wrt light_x").stderr.contains("biased"));
    assert!(b.expect(0, "plan fog.xml --wrt wall_z --json").json()["refused"].is_null());
    // What it refuses by where things are.
    let boxes = r#"<default name="x" value="0"/><shape type="cube" id="a"><transform name="to_world"><translate x="$x"/></transform><bsdf type="conductor"/></shape><shape type="cube" id="b"><transform name="to_world"><translate x="1.5"/></transform><bsdf type="conductor"/></shape></scene>"#;
    fs::write(b.path("boxes.xml"), SCENE.replace("</scene>", boxes)).unwrap();
    let told = b.expect(0, "plan boxes.xml --wrt x --json").json()["refused"].to_string();
    assert!(told.contains("boxes.xml:") && told.contains("`b`"), "{told}");
    assert!(b.expect(0, "plan boxes.xml --wrt x").stdout.contains("`grad` refuses this: "));
    b.expect(2, "plan boxes.xml --wrt x -s nowhere");
}

#[test]
fn info_knows_every_kind_of_file() {
    let b = Bench::new();
    let scene = b.expect(0, "info fog.xml --json").json();
    let p = &scene["parameters"][0];
    assert_eq!((&p["name"], &p["max"], &p["refused"]), (&"sigma_t".into(), &1.0.into(), &serde_json::Value::Null));
    assert_eq!(p["acts_on"][0], "fog.sigma_t");
    assert_eq!(scene["parameters"][3]["acts_on"][0], "lamp.position");
    assert!(scene["parameters"][3]["refused"].is_null());
    assert!(scene["parameters"][6]["refused"].is_null());
    assert!(scene["parameters"][4]["acts_on"][0].as_str().unwrap().starts_with("an integer (`max_depth`)"));

    assert_eq!(scene["arrays"], serde_json::json!([]));

    let vdb = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/fire/blender_fire_0032.vdb");
    let grids = b.expect(0, &format!("info {} --json", vdb.display())).json();
    let density = grids["grids"].as_array().unwrap().iter().find(|g| g["name"] == "density").unwrap();
    assert_eq!(density["usable_as_density"], true, "{density}");
    assert!(density["values"]["max"].as_f64().unwrap() > 0.0 && density["active_voxels"].as_u64().unwrap() > 0);

    fs::write(b.path("tri.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let mesh = b.expect(0, "info tri.obj --json").json();
    assert_eq!((&mesh["faces"], &mesh["boundary_edges"], &mesh["closed"]), (&1.into(), &3.into(), &false.into()));
    assert!(b.expect(0, "info tri.obj").stdout.contains("can bound a medium"));

    b.expect(0, "render fog.xml --spp 2");
    let picture = b.expect(0, "info fog.exr --json").json();
    assert_eq!((&picture["width"], &picture["channels"][0]["nonfinite"]), (&12.into(), &0.into()));
    fs::write(b.path("bad.vdb"), "no vdb").unwrap();
    assert!(b.expect(2, "info bad.vdb").stderr.contains("bad.vdb: it is not a VDB file\n  help: "));
    b.expect(2, "info tri.obj -D a=1");
    fs::write(b.path("what.txt"), "").unwrap();
    b.expect(2, "info what.txt");
}

#[test]
fn stress_prints_rows_and_judges_them() {
    let b = Bench::new();
    let r = b.expect(0, "stress --case rng-endpoints --json").json();
    assert!(!r["rows"].as_array().unwrap().is_empty());
    assert_eq!(r["summary"]["failed"], 0);
    let r = b.expect(0, "stress --case rng-endpoints");
    assert!(r.stdout.starts_with("case ") && r.stdout.contains("\nrng-endpoints"), "{}", r.stdout);
    assert!(b.expect(2, "stress --case rng-endpoint").stderr.contains("did you mean `rng-endpoints`"));
}

#[test]
fn logs_go_where_they_should() {
    let b = Bench::new();
    let r = b.expect(0, "render fog.xml -q --spp 2 --log-file log.txt");
    assert!(r.stdout.is_empty() && r.stderr.is_empty(), "{}{}", r.stdout, r.stderr);
    assert!(fs::read_to_string(b.path("log.txt")).unwrap().contains("loaded fog.xml"));
    let r = b.expect(0, "render fog.xml -v --spp 2 --overwrite");
    assert!(r.stderr.contains("loaded fog.xml"));
}

/// Broken voxels: refused with the remedy, or repaired, told of on stderr and counted in the report.
#[test]
fn broken_voxels_are_refused_or_repaired() {
    let b = Bench::new();
    let vol = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/bad_plugins/files/nan.vol");
    let medium = r#"<medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/>"#;
    let grid = format!(
        r#"<medium type="heterogeneous" id="fog"><float name="scale" value="$sigma_t"/>
    <volume name="sigma_t" type="gridvolume"><string name="filename" value="{}"/></volume>"#,
        vol.display()
    );
    assert!(SCENE.contains(medium));
    fs::write(b.path("broken.xml"), SCENE.replace(medium, &grid)).unwrap();
    let r = b.expect(2, "render broken.xml -o a.exr");
    assert!(
        r.stderr.contains("nan.vol: voxel [1, 0, 0] is NaN") && r.stderr.contains("--repair-voxels"),
        "{}",
        r.stderr
    );
    assert!(!b.path("a.exr").exists());
    let r = b.expect(0, "render broken.xml --repair-voxels --spp 4 -o a.exr");
    assert!(r.stderr.contains("1 voxels were repaired and are 0 now: 1 NaN"), "{}", r.stderr);
    let report: serde_json::Value = serde_json::from_slice(&fs::read(b.path("a.json")).unwrap()).unwrap();
    let told = report["warnings"].as_array().unwrap();
    let repaired = told.iter().find(|w| w["kind"] == "repaired_voxels").unwrap();
    assert!(repaired["what"].as_str().unwrap().contains("1 NaN"), "{report}");
}

/// A scene with a mesh for each frame, and those of the frames 3 and 4.
fn sequence() -> Bench {
    let b = Bench::new();
    let mesh = |x: f64| format!("v {x} -1 4\nv {x} 1 4\nv 2 0 4\nf 1 2 3\n");
    for (frame, x) in [(3, -1.0), (4, 0.0)] {
        fs::write(b.path(&format!("flag_{frame:03}.obj")), mesh(x)).unwrap();
    }
    let flag = r#"<shape type="obj" id="flag"><string name="filename" value="flag_###.obj"/></shape></scene>"#;
    fs::write(b.path("flag.xml"), SCENE.replace("</scene>", flag)).unwrap();
    b
}

#[test]
fn a_sequence_is_a_run_a_frame() {
    let b = sequence();
    b.expect(0, "render flag.xml --frames 3-4 --spp 4 -t 1 -o a_####.exr --preview {frame:02}.png");
    for file in ["a_0003.exr", "a_0004.exr", "a_0003.json", "a_0004.json", "03.png", "04.png"] {
        assert!(b.path(file).is_file(), "{file}");
    }
    let (three, four) = (b.exr("a_0003.exr"), b.exr("a_0004.exr"));
    assert_ne!(three.channel("R"), four.channel("R"));
    assert_eq!(four.attribute("frame").unwrap().as_integer(), Some(4));
    let report: serde_json::Value = serde_json::from_str(&fs::read_to_string(b.path("a_0004.json")).unwrap()).unwrap();
    assert_eq!(report["frame"], 4);
    // The same as the frame by itself.
    fs::write(b.path("four.xml"), fs::read_to_string(b.path("flag.xml")).unwrap().replace("###", "004")).unwrap();
    b.expect(0, "render four.xml --spp 4 -o four.exr");
    same_bits(&four, &b.exr("four.exr"), &["R", "G", "B"]);
    assert!(b.exr("four.exr").attribute("frame").is_none());
    // Derivatives, in another order; default names have the number.
    b.expect(0, "grad flag.xml --wrt albedo --frames 4,3 --spp 4");
    assert!(b.path("flag_0003.grad.exr").is_file() && b.path("flag_0004.grad.exr").is_file());
    let r =
        b.expect(0, "grad flag.xml --wrt albedo --loss l2 --target a_####.exr --frames 3-4 --spp 4 -o g_{frame}.json");
    assert!(b.path("g_3.json").is_file() && b.path("g_4.json").is_file(), "{}", r.stdout);
}

#[test]
fn sequences_are_refused_as_a_whole() {
    let b = sequence();
    let refused = |code: i32, line: &str, parts: &[&str]| {
        let before = b.files();
        let r = b.expect(code, line);
        assert!(parts.iter().chain(&["help:"]).all(|p| r.stderr.contains(p)), "`{line}`: {}", r.stderr);
        assert_eq!(b.files(), before, "`{line}`");
    };
    refused(
        2,
        "render flag.xml --frames 3-4 -o a.exr",
        &["`--output a.exr` is one file for several frames", "a.####.exr"],
    );
    refused(2, "render flag.xml --frames 3-4 -o a_#.exr --preview a.png", &["--preview"]);
    refused(2, "render fog.xml -o a_####.exr", &["no frame", "--frames"]);
    refused(2, "grad fog.xml --wrt albedo --loss l2 --target a_#.exr", &["--target a_#.exr", "--frames"]);
    refused(2, "render flag.xml -o a.exr", &["flag.xml:", "`flag_###.obj`", "--frames"]);
    refused(2, "check flag.xml --wrt albedo", &["flag.xml:", "`flag_###.obj`", "write the number"]);
    // A file of the last frame is missing: nothing is rendered.
    refused(2, "render flag.xml --frames 3-5 -o a_#.exr", &["frame 5", "`flag_005.obj` not found"]);
    fs::write(b.path("a_4.exr"), "kept").unwrap();
    refused(4, "render flag.xml --frames 3-4 -o a_#.exr", &["frame 4", "a_4.exr exists", "--overwrite"]);
    for bad in ["4-3", "1-3,2", "a", "1-5x0"] {
        let r = b.expect(2, &format!("render flag.xml --frames {bad} -o a_#.exr"));
        assert!(r.stderr.contains("frame") && r.stderr.contains(bad), "{}", r.stderr);
    }
    assert_eq!(b.run("plan flag.xml --frames 3").code, Some(2));
}

#[test]
fn of_frames_that_fail_the_others_go_on() {
    let b = sequence();
    fs::write(b.path("flag_002.obj"), "v 0 0 0\nf 1 1 9\n").unwrap();
    let r = b.expect(2, "render flag.xml --frames 2-3 --spp 4 -o a_#.exr");
    assert!(r.stderr.contains("frame 2") && r.stderr.contains("flag_002.obj"), "{}", r.stderr);
    assert!(b.path("a_3.exr").is_file() && !b.path("a_2.exr").exists());
}

#[test]
fn info_lists_arrays_with_their_sizes() {
    let b = sequence();
    let vdb = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/fire/blender_fire_0032.vdb");
    let smoke = format!(
        r#"<shape type="cube"><bsdf type="null"/><medium type="heterogeneous" id="smoke" name="interior"><volume type="openvdb" name="sigma_t"><string name="filename" value="{}"/></volume></medium></shape></scene>"#,
        vdb.display()
    );
    let text = fs::read_to_string(b.path("flag.xml")).unwrap().replace("###", "003").replace("</scene>", &smoke);
    fs::write(b.path("smoke.xml"), text).unwrap();
    let scene = b.expect(0, "info smoke.xml --json").json();
    let active = b.expect(0, &format!("info {} --json", vdb.display())).json();
    let density = active["grids"].as_array().unwrap().iter().find(|g| g["name"] == "density").unwrap();
    let arrays = scene["arrays"].as_array().unwrap();
    let names: Vec<&str> = arrays.iter().map(|a| a["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["flag.vertices", "smoke.sigma_t.grid"]);
    assert_eq!(arrays[0]["shape"], serde_json::json!([3, 3]));
    assert_eq!(arrays[1]["shape"][1], 1);
    // Not more than voxels: an active tile is one number.
    let rows = arrays[1]["shape"][0].as_u64().unwrap();
    assert!(rows > 0 && rows <= density["active_voxels"].as_u64().unwrap(), "{rows} {density}");
    assert!(arrays.iter().all(|a| a["refused"].is_null()), "{arrays:?}");
    let text = b.expect(0, "info smoke.xml").stdout;
    assert!(
        text.contains("flag.vertices") && text.contains("3 x 3 vertices") && text.contains("active voxels"),
        "{text}"
    );
}

#[test]
fn misspelt_arrays_are_told_what_they_may_mean() {
    let b = Bench::new();
    for (name, meant) in [
        ("smoke.sigma_t.gird", "`smoke.sigma_t.grid`"),
        ("smoke.sigmat.grid", "`smoke.sigma_t.grid`"),
        ("smoke.albdo.grid", "`smoke.albedo.grid`"),
        ("a.b.vertexes", "`a.b.vertices`"),
    ] {
        let r = b.expect(2, &format!("grad fog.xml --wrt {name} --loss l2 --target none.exr"));
        assert!(r.stderr.contains(&format!("did you mean {meant}?")), "{}", r.stderr);
    }
    let r = b.expect(2, "grad fog.xml --wrt fog.colour --loss l2 --target none.exr");
    assert!(!r.stderr.contains("did you mean") && r.stderr.contains("ID.vertices"), "{}", r.stderr);
}
