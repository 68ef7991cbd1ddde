//! From options to a job of the driver, and from its outcome to report and header.

use super::files::{self, Outputs};
use super::format;
use super::log::Log;
use super::options::{RenderOptions, SceneOptions};
use super::progress::{Display, Goal};
use super::signal::Stop;
use serde::Serialize;
use std::path::Path;
use std::sync::OnceLock;
use tyndall::error::{Error, Result, Span, Warning, WarningKind};
use tyndall::image::exr::Attribute;
use tyndall::native;
use tyndall::render::driver::{Job, Mode, Outcome};
use tyndall::render::plan::{self, Plan, Terms};
use tyndall::render::report::{self, Parameter, PlanLine, Report, TermReport};
use tyndall::scene::desc::suggest;
use tyndall::scene::parts::Parts;
use tyndall::scene::{Scene, SceneDesc, advice};
use tyndall::term::EdgeForm;

/// A scene that is loaded, and what of it is rendered.
pub struct Setup {
    pub desc: SceneDesc,
    pub scene: Scene,
    pub plan: Plan,
    pub sensor: usize,
    pub crop: [usize; 4],
    pub spp: u64,
    pub seed: u64,
    /// Of a sequence.
    pub frame: Option<u32>,
    pub stop: Stop,
}

impl Setup {
    /// All errors of the scene come here, before anything is rendered.
    pub fn new(scene: &SceneOptions, o: &RenderOptions, wrt: &[String], log: &Log) -> Result<Self> {
        let stop = Stop::install()?;
        start_threads(o.threads)?;
        let start = std::time::Instant::now();
        let frame = scene.frame;
        let desc = scene.desc()?;
        let parts = Parts::read(&desc, &desc.values::<f64>())?;
        let sensor = find_sensor(o.sensor.as_deref(), &parts)?;
        let plan = Plan::new(&desc, wrt)?;
        plan.refuse()?;
        let film = parts.sensors[sensor].film;
        let crop = match o.crop {
            Some(c) if c[2] > film.width || c[3] > film.height => {
                let what = format!(
                    "`--crop` reaches {},{}, the picture has {} x {} pixels",
                    c[2], c[3], film.width, film.height
                );
                return Err(Error::usage(what, "x1 is at most the width, y1 at most the height"));
            }
            Some(c) => c,
            None => film.crop,
        };
        let mut scene = Scene::compile(&desc, &scene.load(o.repair_voxels))?;
        scene.warnings.extend(advice::of_parameters(&desc, wrt)?);
        log.warnings(&scene.warnings);
        let spp = o.spp.unwrap_or(parts.sensors[sensor].spp);
        let seed = o.seed.unwrap_or(parts.sensors[sensor].seed);
        log.detail(format!(
            "loaded {} in {}: {}, {}, {}; sensor `{}`, {} x {} pixels, {spp} samples a pixel, seed {seed}, {}",
            desc.path.display(),
            format::duration(start.elapsed()),
            format::plural(scene.shapes.len(), "shape"),
            if scene.media.len() == 1 { "1 medium".into() } else { format!("{} media", scene.media.len()) },
            format::plural(scene.lights.len(), "light"),
            parts.sensors[sensor].name,
            crop[2] - crop[0],
            crop[3] - crop[1],
            format::plural(rayon::current_num_threads(), "thread"),
        ));
        Ok(Setup { desc, scene, plan, sensor, crop, spp, seed, frame, stop })
    }

    pub fn job<'a>(&'a self, mode: Mode<'a>, o: &RenderOptions) -> Job<'a> {
        Job {
            scene: &self.scene,
            sensor: self.sensor,
            crop: self.crop,
            spp: self.spp,
            seed: self.seed,
            mode,
            noise: &[],
            terms: Terms::ALL,
            edges: EdgeForm::Outward,
            split: false,
            max_time: o.max_time,
            target_error: o.target_error,
            stop: Some(self.stop.flag()),
        }
    }

    pub fn full_size(&self) -> [usize; 2] {
        let s = &self.scene.sensors[self.sensor];
        [s.width, s.height]
    }

    fn pixels(&self) -> usize {
        (self.crop[2] - self.crop[0]) * (self.crop[3] - self.crop[1])
    }
}

/// So many threads, once: those of the first frame are everyone's.
fn start_threads(wanted: Option<u16>) -> Result<()> {
    static STARTED: OnceLock<()> = OnceLock::new();
    let Some(n) = wanted.filter(|_| STARTED.set(()).is_ok()) else { return Ok(()) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n.into()).build_global();
    pool.map_err(|e| Error::Runtime(format!("cannot start {n} threads: {e}")))
}

pub fn find_sensor(wanted: Option<&str>, parts: &Parts<f64>) -> Result<usize> {
    let n = parts.sensors.len();
    match wanted {
        None => Ok(0),
        Some("all") => {
            let what = "`--sensor all` is for gradients (`grad --loss`, `grad --adjoint`) and `fit`";
            Err(Error::usage(what, "render one sensor after the other: --sensor 0, --sensor 1, ..."))
        }
        Some(text) => {
            if let Some(i) = parts.sensors.iter().position(|s| s.name == text) {
                return Ok(i);
            }
            if let Ok(i) = text.parse::<usize>() {
                if i < n {
                    return Ok(i);
                }
                let what = format!("there is no sensor {i}: the scene has {}", format::plural(n, "sensor"));
                return Err(Error::usage(what, "sensors count from 0"));
            }
            let remedy = suggest(text, parts.sensors.iter().map(|s| s.name.as_str()));
            Err(Error::usage(format!("the scene has no sensor `{text}`"), remedy))
        }
    }
}

/// A finished job.
pub struct Done {
    pub outcome: Outcome,
    pub cpu_seconds: Option<f64>,
    pub complete: bool,
}

/// Run a job with progress display.
pub fn run(job: &Job, o: &RenderOptions, stop: &Stop, log: &Log) -> Result<Done> {
    let goal = Goal { max_time: job.max_time, target_error: job.target_error };
    let before = cpu_seconds();
    let display = Display::new(log, o.progress, goal);
    let outcome = job.run(&|p| display.update(p));
    drop(display);
    if outcome.is_err() {
        stop.exit_code();
    }
    let outcome = outcome?;
    if outcome.film.batches().len() < 2 {
        log.warn("only one batch was done: error bars need two, so there are no var.* layers and no standard errors");
    }
    let cpu_seconds = cpu_seconds().zip(before).map(|(b, a)| b - a);
    // A run that stopped because it reached its error has done what it was asked for.
    let complete = outcome.complete || outcome.target_reached == Some(true);
    Ok(Done { outcome, cpu_seconds, complete })
}

/// CPU time of this process over all threads, as the system counts it (10 ms steps).
fn cpu_seconds() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    // The program's name stands in brackets and may hold blanks; user and system time are fields 14 and 15.
    let fields: Vec<&str> = stat.rsplit_once(')')?.1.split_whitespace().collect();
    let ticks: f64 = fields.get(11)?.parse::<f64>().ok()? + fields.get(12)?.parse::<f64>().ok()?;
    Some(ticks / 100.0)
}

/// The report with what this program adds to it.
#[derive(Serialize)]
pub struct RunReport {
    #[serde(flatten)]
    pub report: Report,
    /// Of a sequence.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<u32>,
    /// Width and height of the picture, and the part of it that was rendered: x0, y0, x1, y1.
    pub size: [usize; 2],
    pub crop: [usize; 4],
    pub samples: u64,
    pub samples_per_second: f64,
    /// Root mean square error of the pixels over the mean; null below two batches.
    pub relative_error: Option<f64>,
    pub layers: Vec<Layer>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub loss: Option<super::loss::LossReport>,
    /// Of a gradient by several cameras; everything above but the health counters, samples and time is then of the first.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cameras: Vec<super::loss::Camera>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gradient: Option<serde_json::Map<String, serde_json::Value>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub standard_error: Option<serde_json::Map<String, serde_json::Value>>,
}

/// A layer in numbers.
#[derive(Serialize)]
pub struct Layer {
    pub name: String,
    pub mean: [f64; 3],
    pub mean_abs: f64,
    /// Mean over pixels and channels of the variance of the mean.
    pub variance: Option<f64>,
    /// Root mean square error of the pixels over the mean absolute value.
    pub relative_error: Option<f64>,
}

fn layers(o: &Outcome) -> Vec<Layer> {
    let n = o.film.spec().pixels();
    let layer = |(layer, name): (usize, &String)| {
        let (mut mean, mut abs, mut variance) = ([0.0; 3], 0.0, Some(0.0));
        for p in 0..n {
            let m = o.film.mean(layer, p);
            mean.iter_mut().zip(m.0).for_each(|(a, b)| *a += b / n as f64);
            abs += m.abs().mean() / n as f64;
            variance = variance.zip(o.film.variance_of_mean(layer, p)).map(|(s, v)| s + v.mean() / n as f64);
        }
        let relative_error = variance.map(|v: f64| v.sqrt() / abs).filter(|e| e.is_finite());
        let name = if name.is_empty() { "picture".into() } else { name.clone() };
        Layer { name, mean, mean_abs: abs, variance, relative_error }
    };
    o.film.spec().layers.iter().enumerate().map(layer).collect()
}

/// Chosen terms that do not suffice make a biased derivative, which must be wanted.
pub fn left_out(s: &Setup, terms: &Terms) -> Option<Warning> {
    let needed = s.plan.lines.iter().filter(|l| l.decision == "use" && !terms.wants(&l.term));
    let mut names: Vec<&str> = needed.map(|l| l.term.as_str()).collect();
    names.dedup();
    (!names.is_empty()).then(|| Warning {
        kind: WarningKind::TermsLeftOut,
        span: Span { file: s.desc.path.clone(), line: 0, column: 0 },
        what: format!(
            "--terms leaves out what the derivative needs, so it is a part only (biased): {}",
            names.join(", ")
        ),
        hint: "leave --terms out for the whole derivative".into(),
    })
}

/// The report of a run: what ran, why, how well.
pub fn report(
    s: &Setup,
    done: &Done,
    o: &RenderOptions,
    outputs: &[&Path],
    wrt: &[String],
    chosen: &Terms,
) -> RunReport {
    let outcome = &done.outcome;
    let samples = outcome.spp * s.pixels() as u64;
    let mut r = Report::new();
    r.version = env!("TYNDALL_VERSION").into();
    r.embree = native::embree::version();
    r.openvdb = native::vdb::version();
    r.command = std::env::args().collect();
    r.scene = s.desc.path.display().to_string();
    r.scene_hash = format!("{:016x}", s.desc.hash);
    r.parameters = s
        .desc
        .params
        .iter()
        .map(|p| Parameter { name: p.name.clone(), value: p.value, differentiated: wrt.contains(&p.name) })
        .collect();
    r.seed = s.seed;
    r.spp = outcome.spp;
    r.sample_range = [0, outcome.spp];
    r.batches = outcome.film.batches().len();
    r.threads = rayon::current_num_threads();
    r.render_time_seconds = outcome.seconds;
    r.complete = done.complete;
    r.target_reached = outcome.target_reached;
    let line = |l: &plan::PlanLine| {
        let (needed, used) = (l.decision == "use", chosen.wants(&l.term));
        let reason = if needed && !used { format!("{}: left out by --terms", l.reason) } else { l.reason.clone() };
        PlanLine { term: l.term.clone(), used: needed && used, reason }
    };
    r.plan = s.plan.lines.iter().map(line).collect();
    r.set_health(&outcome.film.health, samples, o.health_limit);
    r.warnings = s.scene.warnings.iter().map(Into::into).collect();
    r.warnings.extend(light_on_ray(s, outcome).iter().chain(&left_out(s, chosen)).map(Into::into));
    r.peak_memory_bytes = report::peak_memory_bytes();
    r.outputs = outputs.iter().map(|p| p.display().to_string()).collect();
    let layers = layers(outcome);
    if !wrt.is_empty() {
        r.terms = terms(&layers[1..], wrt.len(), samples, done);
    }
    RunReport {
        report: r,
        frame: s.frame,
        size: s.full_size(),
        crop: s.crop,
        samples,
        samples_per_second: samples as f64 / outcome.seconds,
        relative_error: layers.first().and_then(|l| l.relative_error),
        layers,
        loss: None,
        cameras: Vec::new(),
        gradient: None,
        standard_error: None,
    }
}

/// What each term cost, and with layers of their own how large and how sure it is. The interior's time includes that of the
/// picture's paths, which it is read from.
fn terms(derivatives: &[Layer], parameters: usize, samples: u64, done: &Done) -> Vec<TermReport> {
    let rooms = &done.outcome.room_seconds;
    let elsewhere: f64 = rooms.iter().map(|r| r.1).sum();
    let interior = ("interior", done.cpu_seconds.map_or(f64::NAN, |t| (t - elsewhere).max(0.0)));
    let report = |(k, &(name, seconds)): (usize, &(&str, f64))| {
        // The sums come first, then the terms in their order; a single term is the sum.
        let own = match derivatives.len() / parameters.max(1) {
            0 => &[],
            1 if rooms.is_empty() => &derivatives[..parameters],
            1 => &[],
            _ => &derivatives[(k + 1) * parameters..(k + 2) * parameters],
        };
        let n = own.len() as f64;
        TermReport {
            name: name.into(),
            samples,
            cpu_seconds: seconds,
            variance: (!own.is_empty())
                .then(|| own.iter().map(|l| l.variance).sum::<Option<f64>>().map(|v| v / n))
                .flatten(),
            mean_abs: (!own.is_empty()).then(|| own.iter().map(|l| l.mean_abs).sum::<f64>() / n),
        }
    };
    std::iter::once(&interior).chain(rooms).enumerate().map(report).collect()
}

/// The picture diverges where a zero-measure light lies on a camera ray.
pub fn light_on_ray(s: &Setup, o: &Outcome) -> Option<Warning> {
    o.light_on_ray.map(|[x, y]| Warning {
        kind: WarningKind::LightOnRay,
        span: Span { file: s.desc.path.clone(), line: 0, column: 0 },
        what: format!("a light of zero measure lies on a camera ray of pixel ({x}, {y}): the picture diverges there"),
        hint: "move the light or the camera by a hair".into(),
    })
}

/// Header attributes [DESIGN 4].
pub fn attributes(r: &RunReport) -> Vec<(String, Attribute)> {
    let text = |s: &str| Attribute::Text(s.into());
    let p = &r.report;
    let values: serde_json::Map<_, _> =
        p.parameters.iter().map(|p| (p.name.clone(), serde_json::json!(p.value))).collect();
    let list = |used: bool| {
        let mut names: Vec<&str> = p.plan.iter().filter(|l| l.used == used).map(|l| l.term.as_str()).collect();
        names.dedup();
        names
    };
    let run = list(true);
    let left_out: Vec<&str> = list(false).into_iter().filter(|t| !run.contains(t)).collect();
    let wrt: Vec<&str> = p.parameters.iter().filter(|p| p.differentiated).map(|p| p.name.as_str()).collect();
    let mut v = vec![
        ("software", text(&format!("tyndall {}", p.version))),
        ("sceneHash", text(&p.scene_hash)),
        ("parameters", Attribute::Text(serde_json::Value::Object(values).to_string())),
        ("termsRun", text(&run.join(","))),
        ("termsLeftOut", text(&left_out.join(","))),
        ("seed", files::integer(p.seed)),
        ("sampleRange", text(&format!("{}-{}", p.sample_range[0], p.sample_range[1]))),
        ("spp", files::integer(p.spp)),
        ("renderTimeSeconds", Attribute::Real(p.render_time_seconds)),
        ("complete", Attribute::Integer(p.complete.into())),
    ];
    if !wrt.is_empty() {
        v.push(("wrt", text(&wrt.join(","))));
    }
    v.extend(r.frame.map(|n| ("frame", files::integer(n.into()))));
    v.into_iter().map(|(name, a)| (name.to_string(), a)).collect()
}

pub fn to_json(r: &impl Serialize) -> Result<String> {
    serde_json::to_string_pretty(r).map_err(|e| Error::Runtime(format!("cannot write the report: {e}")))
}

/// The lines that people see at the end.
pub fn summary(r: &RunReport, outputs: &Outputs) -> String {
    let p = &r.report;
    let [x0, y0, x1, y1] = r.crop;
    let files: Vec<String> = outputs.all().iter().map(|f| f.display().to_string()).collect();
    let mut text = format!(
        "{} x {} pixels, {} a pixel, {}, {}samples/s\nrelative error {}, {}",
        x1 - x0,
        y1 - y0,
        format::plural(p.spp as usize, "sample"),
        format::time(p.render_time_seconds),
        format::count(r.samples_per_second),
        r.relative_error.map_or("unknown".into(), format::percent),
        format::plural(p.warnings.len(), "warning"),
    );
    for l in r.layers.iter().skip(1) {
        let error = l.relative_error.map_or("unknown".into(), format::percent);
        text += &format!("\n{}: mean |d| {}, relative error {error}", l.name, format::number(l.mean_abs));
    }
    if p.target_reached == Some(false) {
        text += "\nthe target error was not reached";
    }
    if !p.complete {
        text += "\nincomplete: stopped before all samples were taken";
    }
    text + "\nwrote " + &files.join(", ")
}

/// The end of a run whose outputs are written: the exit code.
pub fn finish(s: &Setup, r: &RunReport, outcome: &Outcome) -> Result<u8> {
    if let Some(code) = s.stop.exit_code() {
        return Ok(code);
    }
    outcome.film.health.check(r.samples, r.report.health_limit)?;
    Ok(0)
}
