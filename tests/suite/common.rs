//! What every statistical test shares: render a scene text, compare with a truth in standard errors.
//!
//! |z| <= 4.5 has a false-alarm rate of 7e-6 a comparison; seeds are fixed, so a test that passes keeps passing.

#![allow(dead_code)]

use std::path::Path;
use std::sync::Arc;
use tyndall::math::rng::Rng;
use tyndall::math::{DAffine3, DVec3, Rgb};
use tyndall::native::vdb::{self, Leaf, WriteGrid};
use tyndall::params::{Forward, ParamSet};
use tyndall::render::driver::{Job, Mode, Outcome};
use tyndall::render::plan::{Plan, Terms};
use tyndall::scene::Scene;
use tyndall::scene::SceneDesc;
use tyndall::scene::compile::{LoadOptions, Orders};
use tyndall::scene::lamps::Lamps;
use tyndall::term::EdgeForm;
use tyndall::transport::{Beginning, PathRecord, Sweep, SweepFacts, Tally};

/// A scene from text, relative to the project's folder.
pub fn scene(text: &str) -> (SceneDesc, Scene) {
    scene_with(text, &[])
}

pub fn scene_with(text: &str, overrides: &[(&str, &str)]) -> (SceneDesc, Scene) {
    scene_of_orders(text, overrides, Orders::default())
}

/// Light of chosen numbers of scatterings only.
pub fn scene_of_orders(text: &str, overrides: &[(&str, &str)], orders: Orders) -> (SceneDesc, Scene) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("test-scene.xml");
    let o: Vec<(String, String)> = overrides.iter().map(|(a, b)| (a.to_string(), b.to_string())).collect();
    let desc = SceneDesc::parse(text, &path, &o).unwrap_or_else(|e| panic!("{e}"));
    let options = LoadOptions { orders, ..LoadOptions::default() };
    let scene = Scene::compile(&desc, &options).unwrap_or_else(|e| panic!("{e}"));
    (desc, scene)
}

/// Mean over the image of one layer: value and standard error, per channel.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub value: Rgb,
    pub error: Rgb,
}

impl Estimate {
    pub fn z(&self, channel: usize, truth: f64) -> f64 {
        // The references have 12 digits or so; some estimators here have no variance at all.
        let d = self.value[channel] - truth;
        if d.abs() <= 1e-10 * truth.abs() { 0.0 } else { d / self.error[channel] }
    }
}

pub fn estimate(o: &Outcome, layer: usize) -> Estimate {
    let n = o.film.spec().pixels();
    let (mut value, mut variance) = (Rgb::ZERO, Rgb::ZERO);
    for p in 0..n {
        value += o.film.mean(layer, p);
        variance += o.film.variance_of_mean(layer, p).unwrap_or(Rgb::splat(f64::NAN));
    }
    let n = n as f64;
    Estimate { value: value / n, error: variance.map(|v| v.sqrt() / n) }
}

pub fn job<'a>(scene: &'a Scene, spp: u64, seed: u64, mode: Mode<'a>) -> Job<'a> {
    let crop = scene.films[0].part.crop;
    Job {
        scene,
        sensor: 0,
        crop,
        spp,
        seed,
        mode,
        noise: &[],
        terms: Terms::ALL,
        edges: EdgeForm::Outward,
        split: false,
        max_time: None,
        target_error: None,
        stop: None,
    }
}

pub fn run(scene: &Scene, spp: u64, seed: u64, mode: Mode) -> Outcome {
    job(scene, spp, seed, mode).run(&|_| {}).unwrap_or_else(|e| panic!("{e}"))
}

/// Value and derivatives of a scene's mean pixel.
pub fn forward(text: &str, wrt: &[&str], spp: u64) -> Vec<Estimate> {
    forward_of(text, Orders::default(), wrt, &["all"], spp)
}

/// Derivatives of the mean pixel, of chosen terms.
pub fn derivatives(text: &str, wrt: &[&str], terms: &[&str], spp: u64) -> Vec<Estimate> {
    forward_of(text, Orders::default(), wrt, terms, spp).split_off(1)
}

/// Value and derivatives of the mean pixel, of chosen numbers of scatterings and chosen terms.
pub fn forward_of(text: &str, orders: Orders, wrt: &[&str], terms: &[&str], spp: u64) -> Vec<Estimate> {
    let (desc, sc) = scene_of_orders(text, &[], orders);
    let p = params(&desc, &sc, wrt);
    let terms = Terms::parse(&terms.iter().map(|t| t.to_string()).collect::<Vec<_>>()).unwrap();
    let o = Job { terms, ..job(&sc, spp, 1, Mode::Forward(&p)) }.run(&|_| {}).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(o.film.health.biasing(), 0, "{:?}", o.film.health.entries().collect::<Vec<_>>());
    (0..=wrt.len()).map(|k| estimate(&o, k)).collect()
}

/// What to differentiate by; what `grad` would refuse is refused here too.
pub fn params(desc: &SceneDesc, scene: &Scene, wrt: &[&str]) -> ParamSet {
    let names: Vec<String> = wrt.iter().map(|s| s.to_string()).collect();
    Plan::new(desc, &names).and_then(|p| p.refuse()).unwrap_or_else(|e| panic!("{e}"));
    scene.param_set(desc, &names).unwrap_or_else(|e| panic!("{e}"))
}

/// |z| <= 4.5 and a standard error of at most `precision` of the truth.
pub fn check(name: &str, e: &Estimate, truth: f64, precision: f64) {
    let z = e.z(0, truth);
    println!("{name}: {} +- {} truth {truth} z {z:.2}", e.value[0], e.error[0]);
    assert!(z.abs() <= 4.5, "{name}: {} +- {}, truth {truth}, z {z}", e.value[0], e.error[0]);
    let relative = e.error[0] / truth.abs().max(1e-300);
    assert!(truth == 0.0 || relative <= precision, "{name}: standard error {relative} of the value, asked {precision}");
}

/// Central difference of the mean pixel with common random numbers; its error from eight independent seeds.
pub fn difference(text: &str, orders: Orders, name: &str, h: f64, spp: u64) -> Estimate {
    let (desc, _) = scene(text);
    let x = desc.params.iter().find(|q| q.name == name).unwrap().value;
    let sides = [1.0, -1.0].map(|s| scene_of_orders(text, &[(name, &format!("{}", x + s * h))], orders).1);
    let runs: Vec<Rgb> = (0..8)
        .map(|seed| {
            let [up, down] = [0, 1].map(|i| estimate(&run(&sides[i], spp / 8, 100 + seed, Mode::Picture), 0).value);
            (up - down) / (2.0 * h)
        })
        .collect();
    let of = |c: usize| -> tyndall::math::stats::Moments { runs.iter().map(|r| r[c]).collect() };
    Estimate { value: Rgb::from_fn(|c| of(c).mean), error: Rgb::from_fn(|c| of(c).standard_error()) }
}

/// Derivatives of the mean pixel against central differences, whose error eight seeds tell: 5 s.e., false alarm between 6e-7 (ours the larger error) and
/// 2e-3 (theirs, by Student's distribution) a comparison.
pub fn against_differences(text: &str, wrt: &[(&str, f64)], terms: &[&str], spp: u64, slack: f64) {
    let (desc, sc) = scene(text);
    let names: Vec<&str> = wrt.iter().map(|w| w.0).collect();
    let p = params(&desc, &sc, &names);
    let terms: Vec<String> = terms.iter().map(|s| s.to_string()).collect();
    let terms = Terms::parse(&terms).unwrap();
    let f = Job { terms, ..job(&sc, spp, 3, Mode::Forward(&p)) }.run(&|_| {}).unwrap();
    for (k, (name, h)) in wrt.iter().enumerate() {
        let (d, fd) = (estimate(&f, k + 1), difference(text, Orders::default(), name, *h, spp));
        for c in 0..3 {
            let se = fd.error[c].hypot(d.error[c]);
            println!(
                "{name} {c}: {:.6} +- {:.6} fd {:.6} +- {:.6} z {:.2}",
                d.value[c],
                d.error[c],
                fd.value[c],
                fd.error[c],
                (d.value[c] - fd.value[c]) / se
            );
            assert!(
                (d.value[c] - fd.value[c]).abs() <= 5.0 * se + slack * fd.value[c].abs(),
                "{name} channel {c}: {} vs {} +- {se}",
                d.value[c],
                fd.value[c]
            );
        }
    }
}

/// The scene of a block (`<shape type="cube" id="block">`) as a mesh of twelve facets, in a file.
pub fn block_of_facets(dir: &std::path::Path, text: &str) -> String {
    let corner = |k: usize| [0, 1, 2].map(|i| if k >> i & 1 == 0 { -1 } else { 1 });
    let mut file = String::new();
    for [x, y, z] in (0..8).map(corner) {
        file += &format!("v {x} {y} {z}\n");
    }
    for [a, b, c, d] in [[1, 3, 4, 2], [5, 6, 8, 7], [1, 2, 6, 5], [3, 7, 8, 4], [1, 5, 7, 3], [2, 4, 8, 6]] {
        file += &format!("f {a} {b} {c}\nf {a} {c} {d}\n");
    }
    let path = dir.join("block.obj");
    std::fs::write(&path, file).unwrap();
    let of = |path: &std::path::Path| {
        format!(r#"<shape type="obj" id="block"><string name="filename" value="{}"/>"#, path.display())
    };
    let facets = text.replace(r#"<shape type="cube" id="block">"#, &of(&path));
    assert_ne!(facets, text);
    facets
}

/// A light without extent, and what it is the limit of.
pub const POINT: &str =
    r#"<emitter type="point"><point name="position" value="$x, 3, 0"/><float name="intensity" value="10"/></emitter>"#;

/// A lamp as bright as the point light, of this radius.
pub fn lamp(radius: f64) -> String {
    let radiance = 10.0 / (std::f64::consts::PI * radius * radius);
    format!(
        r#"<shape type="sphere"><point name="center" value="$x, 3, 0"/><float name="radius" value="{radius}"/><emitter type="area"><float name="radiance" value="{radiance}"/></emitter></shape>"#
    )
}

/// A picture to which paths find all light of lamps behind glass by chance.
pub fn by_chance(text: &str, spp: u64) -> Estimate {
    let (_, mut scene) = scene(text);
    scene.lamps = Lamps::default();
    estimate(&run(&scene, spp, 3, Mode::Picture), 0)
}

/// A field given at the nodes of 2^3 leaves around the origin, in a .vdb; what a volume says to read it. A world unit is 6.25 nodes, the origin lies at (0.05, 0, 0.9).
pub fn small_vdb(path: &Path, value: impl Fn(DVec3) -> f64, name: &str) -> String {
    let mut leaves = Vec::new();
    for k in 0..8 {
        let origin = [0, 1, 2].map(|a| if k >> a & 1 == 0 { -8 } else { 0 });
        let values = (0..512).map(|i| {
            let p = [i >> 6, i >> 3 & 7, i & 7];
            value(DVec3::from([0, 1, 2].map(|a| f64::from(origin[a] + p[a])))) as f32
        });
        leaves.push(Leaf { origin, active: [u64::MAX; 8], values: values.collect() });
    }
    let world_from_index =
        DAffine3::from_translation(DVec3::new(0.05, 0.0, 0.9)) * DAffine3::from_scale(DVec3::splat(0.16));
    let (class, tiles) = ("fog volume".to_string(), vec![]);
    vdb::write(
        path,
        &[WriteGrid {
            name: name.into(),
            channels: 1,
            world_from_index,
            background: 0.0,
            leaves,
            tiles,
            class,
            half: false,
        }],
    )
    .unwrap();
    format!(r#"<string name="filename" value="{}"/><string name="grid_name" value="{name}"/>"#, path.display())
}

/// Paths through the film's middle walked in chunks give the bits of one long record, and the picture's value. `least`: chunks of the longest path at least.
pub fn same_in_chunks(text: &str, names: &[&str], least: usize) {
    let (desc, scene) = scene(text);
    let (w, h) = (scene.sensors[0].width, scene.sensors[0].height);
    let p = params(&desc, &scene, names);
    let facts = Arc::new(SweepFacts::of(&scene, &scene.sensors[0], &p).unwrap());
    let sweep = Sweep { scene: &scene, set: &scene.settings, params: &p, facts, sensor: &scene.sensors[0] };
    let mut longest = 0;
    for sample in 0..200 {
        let run = |chunk: usize| {
            let mut rec = PathRecord::new();
            rec.chunk = chunk;
            let (o, w) = scene.sensors[0].ray(0.5 * w as f64, 0.5 * h as f64 + 0.1);
            let begin = Beginning::new(Rng::keyed(1, 1, 5, sample), o, w, None);
            let mut sink = Forward::new(&p);
            let mut tally = Tally::default();
            let value = sweep.sample(&begin, Rng::keyed(1, 2, 5, sample), &mut rec, &mut sink, &mut tally);
            // The picture's own path, where the recorded one goes other ways.
            assert_eq!(value, tyndall::transport::sample(&scene, &scene.settings, &begin, &mut tally));
            (value, sink.image, rec.chunk_starts.len())
        };
        let (v, d, _) = run(usize::MAX);
        for chunk in [1, 5, 30] {
            let (vc, dc, chunks) = run(chunk);
            longest = longest.max(chunks);
            assert_eq!(v, vc);
            assert_eq!(d, dc, "sample {sample}, chunk {chunk}");
        }
    }
    assert!(longest >= least, "paths are too short to test anything: {longest} chunks");
}
