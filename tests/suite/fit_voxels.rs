//! `fit` in reverse mode: voxels from several views, coarse to fine; states; what is refused.

use crate::fog::Folder;
use serde_json::Value;
use std::fs;
use tyndall::math::{DAffine3, DVec3};
use tyndall::native::vdb::{self, Leaf, Select, WriteGrid};

/// Thin smoke before a bright sky, seen from two sides.
const SCENE: &str = r#"<scene version="3.0.0">
  <default name="turn" value="0"/><default name="scale" value="1"/>
  <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
  <medium type="heterogeneous" id="smoke">
    <volume type="openvdb" name="sigma_t"><string name="filename" value="s.vdb"/>
      <transform name="to_world"><translate x="-0.7" y="-0.7" z="-0.7"/></transform></volume>
    <float name="albedo" value="0.1"/><float name="scale" value="$scale"/></medium>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  SENSORS
  <emitter type="constant"><float name="radiance" value="1"/></emitter>
</scene>"#;

fn scene() -> String {
    let sensor = |name: &str, angle: f64| {
        format!(
            r#"<sensor type="perspective" id="{name}"><float name="fov" value="26"/>
  <transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/><rotate y="1" angle="{angle}"/><rotate y="1" angle="$turn"/></transform>
  <film type="hdrfilm"><integer name="width" value="10"/><integer name="height" value="10"/><rfilter type="box"/></film></sensor>"#
        )
    };
    let all = [sensor("front", 0.0), sensor("side", 90.0), sensor("between", 45.0)];
    SCENE.replace("SENSORS", &all.concat())
}

/// 8^3 voxels: dense on one side, empty on the other; all active.
fn truth(i: usize) -> f32 {
    let (x, y) = (i >> 6, i >> 3 & 7);
    if x < 4 { 0.5 + 0.1 * y as f32 } else { 0.0 }
}

const FIT: &str = r#"scene = "s.xml"
wrt = ["smoke.sigma_t.grid"]
sensors = ["front", "side"]
refine = [15, 30]
iterations = 200
half_life = 12
spp = 4
rate = { "smoke.sigma_t.grid" = 0.06 }
bounds = { "smoke.sigma_t.grid" = [0, 3] }
start = [{ "smoke.sigma_t.grid" = 0.3 }]
stop = { window = 10, tolerance = 0.02 }
[target]
values = {}
spp = 64
seed = 9
"#;

fn folder() -> Folder {
    let f = Folder::new();
    let grid = WriteGrid {
        name: "density".into(),
        channels: 1,
        world_from_index: DAffine3::from_scale(DVec3::splat(0.2)),
        background: 0.0,
        leaves: vec![Leaf { origin: [0; 3], active: [u64::MAX; 8], values: (0..512).map(truth).collect() }],
        tiles: vec![],
        class: "fog volume".into(),
        half: false,
    };
    vdb::write(&f.path("s.vdb"), &[grid]).unwrap();
    fs::write(f.path("s.xml"), scene()).unwrap();
    fs::write(f.path("fit.toml"), FIT).unwrap();
    f
}

fn json(f: &Folder, name: &str) -> Value {
    serde_json::from_str(&fs::read_to_string(f.path(name)).unwrap()).unwrap()
}

#[test]
fn smoke_is_found_from_two_views_and_a_fit_that_was_stopped_makes_the_same_bits() {
    let f = folder();
    let turn = "\n[turntable]\nparameter = \"turn\"\nsensor = \"between\"\nrange = [0, 360]\nframes = 2\nspp = 2\n";
    fs::write(f.path("turn.toml"), FIT.to_string() + turn).unwrap();
    f.run(0, "fit turn.toml -o out");
    let v = json(&f, "out/fit.json");
    let run = &v["runs"][0];
    let field = &run["fields"]["smoke.sigma_t.grid"];
    let [error, size] = ["rms_error_to_truth", "rms_truth"].map(|k| field[k].as_f64().unwrap());
    // The start's own error is 0.52 of the size.
    assert!(error < 0.35 * size, "{error} of {size}");
    for view in run["views"].as_array().unwrap() {
        assert!(view["psnr"].as_f64().unwrap() > 30.0, "{view}");
        assert_eq!(view["fitted"], view["sensor"] != "between");
    }
    let history = fs::read_to_string(f.path("out/history.csv")).unwrap();
    let spacings: Vec<&str> = history.lines().skip(1).map(|l| l.split(',').nth(7).unwrap()).collect();
    assert_eq!([spacings[0], spacings[14], spacings[15], spacings[30]], ["4", "4", "2", "1"]);
    for name in ["loss.svg", "views.png", "turntable.png", "target_front.exr", "target_side.exr", "state.bin"] {
        assert!(f.path("out").join(name).exists(), "{name}");
    }

    // The field stands in for its file.
    let [a, b] =
        ["s.vdb", "out/smoke.sigma_t.vdb"].map(|n| vdb::load(&f.path(n), &Select::Name("density".into())).unwrap());
    assert_eq!((a.info.world_from_index, a.info.active_voxels), (b.info.world_from_index, b.info.active_voxels));
    assert_eq!(
        (a.leaves[0].origin, a.leaves[0].active, &a.info.class),
        (b.leaves[0].origin, b.leaves[0].active, &b.info.class)
    );
    assert!(b.leaves[0].values.iter().all(|&x| (0.0..=3.0).contains(&x)));

    // In two parts, the first of which ends in the middle of a lattice: other settings are refused, the bits are the same.
    f.run(3, "fit fit.toml -o two --iterations 20");
    f.run(4, "fit fit.toml -o two --resume --spp 8");
    f.run(0, "fit fit.toml -o two --resume");
    let values = |folder: &str| vdb::load(&f.path(folder).join("smoke.sigma_t.vdb"), &Select::Index(0)).unwrap().leaves;
    assert_eq!(values("out"), values("two"));
    assert_eq!(fs::read_to_string(f.path("two/history.csv")).unwrap().lines().count(), spacings.len() + 1);
    fs::write(f.path("two/state.bin"), "TYNDALLFIT 1\n").unwrap();
    let (_, err) = f.run(4, "fit fit.toml -o two --resume");
    assert!(err.contains("damaged"), "{err}");
}

#[test]
fn a_scalar_beside_voxels_subsets_of_views_and_total_variation() {
    let f = folder();
    let text = FIT
        .replace("wrt = [", "wrt = [\"scale\", ")
        .replace("bounds = {", "views = 1\ntotal_variation = 10.0\nbounds = { scale = [0.1, 2],")
        .replace("iterations = 200", "iterations = 31");
    fs::write(f.path("fit.toml"), text).unwrap();
    let (_, err) = f.run(3, "fit fit.toml -o out --frames 0");
    assert!(err.contains("run 1 (the iterations are over)"), "{err}");
    let v = json(&f, "out/fit.json");
    assert!(v["runs"][0]["values"]["scale"].as_f64().unwrap() != 1.0);
    // So strong a penalty leaves next to no differences; without it they are there (the test above).
    let leaf = &vdb::load(&f.path("out/smoke.sigma_t.vdb"), &Select::Index(0)).unwrap().leaves[0];
    let mean = leaf.values.iter().sum::<f32>() / 512.0;
    let spread = (leaf.values.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / 512.0).sqrt();
    assert!(spread < 0.15, "{spread} around {mean}");
}

#[test]
fn targets_are_files_a_sensor_and_bad_input_is_named() {
    let f = folder();
    for name in ["front", "side"] {
        f.run(0, &format!("render s.xml -s {name} --spp 16 --seed 3 -o {name}.exr"));
    }
    let head = &FIT[..FIT.find("[target]").unwrap()];
    let one = head.replace("iterations = 200", "iterations = 1").replace("sensors = [\"front\", \"side\"]\n", "");
    fs::write(f.path("fit.toml"), format!("{one}targets = {{ front = \"front.exr\", side = \"side.exr\" }}")).unwrap();
    f.run(3, "fit fit.toml -o files");
    assert_eq!(json(&f, "files/fit.json")["sensors"], serde_json::json!(["front", "side"]));
    assert!(json(&f, "files/fit.json")["runs"][0]["fields"]["smoke.sigma_t.grid"]["rms_truth"].is_null());

    let base = "scene = \"s.xml\"\nwrt = [\"smoke.sigma_t.grid\"]\n";
    for (text, part) in [
        (format!("{base}target = \"front.exr\""), "`smoke.sigma_t.grid` has no bounds"),
        (
            format!("{base}target = \"front.exr\"\n[bounds]\n\"smoke.sigma_t.grid\" = [-1, 2]"),
            "fit.toml:5:24: bounds of `smoke.sigma_t.grid`: voxels cannot be -1",
        ),
        (
            format!("{base}target = \"front.exr\"\n[bounds]\n\"smoke.sigma_t.grid\" = [0, 0.2]"),
            "outside its bounds 0 to 0.2",
        ),
        (format!("{base}target = \"front.exr\"\nsensors = [\"front\", \"side\"]"), "one picture"),
        (
            format!("{base}sensors = [\"front\", \"side\"]\ntargets = {{ side = \"side.exr\" }}"),
            "no picture for the sensor `front`",
        ),
        (format!("{base}sensors = [\"front\", \"0\"]\ntarget = {{ values = {{}} }}"), "`front` is named twice"),
        (format!("{base}target = \"front.exr\"\nrefine = [4, 2]"), "fit.toml:4:10: `refine`"),
        (
            "scene = \"s.xml\"\nwrt = [\"scale\"]\ntarget = \"front.exr\"\nviews = 1\nbounds = { scale = [0.5, 2] }"
                .into(),
            "`views` is for fits of voxels",
        ),
        (format!("{base}sensors = [\"nobody\"]\ntarget = \"front.exr\""), "no sensor `nobody`"),
    ] {
        fs::write(f.path("fit.toml"), &text).unwrap();
        let (_, err) = f.run(2, "fit fit.toml -o bad");
        assert!(err.contains(part) && err.contains("help: "), "{text}\n{err}");
    }
}

#[test]
fn all_cameras_in_one_call_are_the_sum_and_the_mean_of_one_by_one() {
    let f = folder();
    let names = ["front", "side", "between"];
    for name in names {
        f.run(0, &format!("render s.xml -s {name} --spp 2 --seed 3 -D scale=0.5 -o {name}.exr"));
    }
    let gradient = |line: &str| -> (f64, Value) {
        let (out, _) = f.run(0, &format!("grad s.xml --wrt scale --seed 4 --spp 16 --json {line}"));
        let v: Value = serde_json::from_str(&out).unwrap();
        (v["gradient"]["scale"].as_f64().unwrap(), v)
    };
    let (sum, v) = gradient("-s all --adjoint front.exr,side.exr,between.exr");
    let each: Vec<f64> = names.iter().map(|n| gradient(&format!("-s {n} --adjoint {n}.exr")).0).collect();
    assert!(each.iter().all(|g| *g != 0.0) && (sum / each.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{sum} {each:?}");
    assert_eq!(v["cameras"][2]["sensor"], "between");

    let (mean, v) = gradient("-s all --loss l1 --target front.exr,side.exr,between.exr");
    let each: Vec<(f64, Value)> =
        names.iter().map(|n| gradient(&format!("-s {n} --loss l1 --target {n}.exr"))).collect();
    assert!((3.0 * mean / each.iter().map(|g| g.0).sum::<f64>() - 1.0).abs() < 1e-12);
    let losses: f64 = each.iter().map(|g| g.1["loss"]["value"].as_f64().unwrap()).sum();
    assert!((3.0 * v["loss"]["value"].as_f64().unwrap() / losses - 1.0).abs() < 1e-12);
    assert_eq!(v["cameras"][1]["loss"], each[1].1["loss"]["value"]);
    assert!(v["loss"]["bias"].as_str().unwrap().starts_with("biased"));

    let (_, err) = f.run(2, "grad s.xml --wrt scale -s all --loss l2 --target front.exr");
    assert!(err.contains("1 image for 3 sensors") && err.contains("--target one .exr for each"), "{err}");
    let (_, err) = f.run(2, "render s.xml -s all");
    assert!(err.contains("`--sensor all` is for gradients"), "{err}");
}

/// A few voxels of one grid of a medium, inside of a box of fog whose density is known, seen from three sides: `values` is what they are, the same `start` in each where the fit begins.
fn few_voxels(name: &str, medium: &str, light: &str, values: [f32; 8], start: f32, rate: f64) {
    const LOW: usize = 3;
    let f = Folder::new();
    let mut leaf = Leaf { origin: [0; 3], active: [0; 8], values: vec![0.0; 512] };
    for (k, v) in values.into_iter().enumerate() {
        let [x, y, z] = [k >> 2, k >> 1 & 1, k & 1].map(|i| i + LOW);
        leaf.active[x] |= 1 << (8 * y + z);
        leaf.values[64 * x + 8 * y + z] = v;
    }
    let grid = WriteGrid {
        name: name.into(),
        channels: 1,
        world_from_index: DAffine3::from_scale(DVec3::ONE) * DAffine3::from_translation(DVec3::splat(-3.5)),
        background: 0.0,
        leaves: vec![leaf],
        tiles: vec![],
        class: "fog volume".into(),
        half: false,
    };
    vdb::write(&f.path("v.vdb"), &[grid]).unwrap();
    let sensor = |id: &str, axis: &str, angle: f64| {
        format!(
            r#"<sensor type="perspective" id="{id}"><float name="fov" value="26"/>
  <transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/><rotate {axis} angle="{angle}"/></transform>
  <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>"#
        )
    };
    let text = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
  <medium type="heterogeneous" id="smoke"><float name="sigma_t" value="1"/>{medium}
    <volume type="openvdb" name="{name}"><string name="filename" value="v.vdb"/><string name="grid_name" value="{name}"/></volume></medium>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="smoke"/></shape>{}{}{}{light}</scene>"#,
        sensor("front", r#"x="1" y="1""#, 10.0),
        sensor("side", r#"x="1" y="1""#, 100.0),
        sensor("top", r#"x="1""#, -80.0)
    );
    fs::write(f.path("s.xml"), text).unwrap();
    let name = format!("smoke.{name}.grid");
    fs::write(
        f.path("fit.toml"),
        format!(
            r#"scene = "s.xml"
wrt = ["{name}"]
sensors = ["front", "side", "top"]
iterations = 240
half_life = 30
stop = {{ tolerance = 1e-9 }}
spp = 8
rate = {{ "{name}" = {rate} }}
bounds = {{ "{name}" = [0, {}] }}
start = [{{ "{name}" = {start} }}]
[target]
values = {{}}
spp = 1024
seed = 9
"#,
            if name.contains("albedo") { 1 } else { 4 }
        ),
    )
    .unwrap();
    f.run(3, "fit fit.toml -o out --frames 0");
    let v = json(&f, "out/fit.json");
    let error = v["runs"][0]["fields"][&name]["rms_error_to_truth"].as_f64().unwrap();
    let before = (values.iter().map(|v| f64::from(v - start).powi(2)).sum::<f64>() / 8.0).sqrt();
    println!("{name}: {before} before, {error} after");
    assert!(error < 0.2 * before, "{name}: {error}, {before} before");
}

/// Eight values around their middle, no two alike.
fn uneven(middle: f32, spread: f32) -> [f32; 8] {
    [3, 6, 0, 5, 7, 2, 4, 1].map(|k| middle + spread * (k as f32 - 3.5) / 3.5)
}

/// Voxels of albedo are found again from the light that they scatter: from random numbers at fixed seeds, errors a fifth of the start's at most.
#[test]
fn voxels_of_albedo_are_found() {
    let suns = ["1, -1, 0.3", "-1, 0.5, -0.6"].map(|way| {
        format!(r#"<emitter type="directional"><vector name="direction" value="{way}"/><float name="irradiance" value="3"/></emitter>"#)
    });
    few_voxels("albedo", "", &suns.concat(), uneven(0.6, 0.3), 0.4, 0.05);
}

/// The same for emission, by its own light.
#[test]
fn voxels_of_emission_are_found() {
    few_voxels("emission", r#"<float name="albedo" value="0.2"/>"#, "", uneven(1.0, 0.8), 0.5, 0.05);
}

/// The same for temperature.
#[test]
fn voxels_of_temperature_are_found() {
    let medium = r#"<float name="albedo" value="0.2"/><float name="emission_scale" value="0.00002"/><float name="temperature_scale" value="3000"/>"#;
    few_voxels("temperature", medium, "", uneven(1.2, 0.2), 1.1, 0.01);
}
