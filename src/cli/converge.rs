//! `tyndall converge`: error against run time.

use super::files;
use super::format;
use super::log::Log;
use super::options::{LogOptions, SceneOptions, StudyOptions, duration, parameters};
use super::progress::Study;
use super::run::{Setup, left_out, to_json};
use clap::Args;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tyndall::error::{Error, Result};
use tyndall::image::exr::{self, ExrImage};
use tyndall::image::{RgbImage, output};
use tyndall::inverse::loss::crop_of;
use tyndall::render::family::{Family, View};
use tyndall::render::health::Health;
use tyndall::render::plan::Terms;
use tyndall::render::plot::{Plot, Series};
use tyndall::study::converge::{self, ConvergeOptions, Curve, Kind, Reference, Speedup};

/// Error against run time: picture, derivatives in total and by term, and finite differences beside them
///
/// Root mean square error over pixels and channels for doubling numbers of samples, against a reference: --reference, or a long
/// run with other seeds whose own variance is taken off. Finite differences (central, common random numbers, several steps)
/// are measured against the derivative's reference, so that their bias counts; most of the time is theirs, and goes to the step that
/// promises the least error. The speedup is the ratio of times at the smallest error that both reach.
#[derive(Args)]
pub struct ConvergeArgs {
    #[command(flatten)]
    scene: SceneOptions,
    /// Parameters whose derivatives are measured too
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    wrt: Vec<String>,
    /// Reference: an EXR of `render` or `grad` (R G B, d_NAME.*, d_NAME.TERM.*, and their variances where it has them); layers
    /// that it lacks are rendered
    #[arg(long, value_name = "REF.exr")]
    reference: Option<PathBuf>,
    /// Time for all curves together, and again for the references, e.g. 90s, 5m, 1h
    #[arg(long, value_name = "TIME", default_value = "60s", value_parser = duration)]
    time: Duration,
    /// Table, a .csv; beside it the report as .json and the plots as .svg [default: SCENE's name + .converge.csv in the current folder]
    #[arg(short, long, value_name = "OUT.csv")]
    output: Option<PathBuf>,
    /// Leave out one term at a time and measure what is left against the reference of all
    #[arg(long)]
    ablate: bool,
    #[command(flatten)]
    study: StudyOptions,
    #[command(flatten)]
    pub log: LogOptions,
}

/// The machine-readable report.
#[derive(Serialize)]
struct Report<'a> {
    tool: &'a str,
    version: &'a str,
    command: Vec<String>,
    scene: String,
    scene_hash: String,
    seed: u64,
    crop: [usize; 4],
    threads: usize,
    terms: &'a [String],
    time_seconds: f64,
    curves: &'a [Curve],
    /// Ratio of times at equal error, a parameter; null where no step reached an error.
    speedup_over_finite_differences: serde_json::Map<String, serde_json::Value>,
    speedups: &'a [Speedup],
    health: &'a Health,
}

impl ConvergeArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let terms = Terms::parse(&self.study.terms)?;
        let wrt = parameters(&self.wrt, "converge")?;
        let csv = self.output.clone().unwrap_or_else(|| files::default_name(&self.scene.scene, ".converge.csv"));
        files::need_extension("--output", &csv, "csv")?;
        let mut plots = vec![(csv.with_extension("svg"), None)];
        plots.extend(wrt.iter().map(|n| (csv.with_extension(format!("d_{n}.svg")), Some(n.clone()))));
        let json_path = csv.with_extension("json");
        let files: Vec<&Path> =
            [&csv, &json_path].into_iter().chain(plots.iter().map(|p| &p.0)).map(|p| &**p).collect();
        for path in &files {
            files::check_place(path, self.study.overwrite)?;
        }
        let setup = Setup::new(&self.scene, &self.study.render(None), &wrt, log)?;
        if let Some(w) = left_out(&setup, &terms) {
            log.warn(w);
        }
        let reference = self.reference.as_deref().map(|p| open(p, &setup)).transpose()?;
        let given = |layer: &str| reference.as_ref().and_then(|r| layer_of(r, layer, &setup));
        let load = self.scene.load(self.study.repair_voxels);
        let family = Family::file(&self.scene.scene, &self.scene.define, load);
        let stop = Some(setup.stop.flag());
        let view = View { sensor: setup.sensor, crop: setup.crop, terms: &self.study.terms, stop };
        let options = ConvergeOptions { seed: setup.seed, time: self.time, ablate: self.ablate };
        let mut display = Study::new(log, self.study.progress);
        // Once for the references, once for the curves.
        let most = 2.0 * self.time.as_secs_f64();
        let mut tell = |text: String| {
            let done = display.elapsed().as_secs_f64() / most;
            display.say(done, text);
        };
        let study = converge::converge(&family, view, &wrt, &options, &given, &mut tell);
        drop(display);
        setup.stop.check()?;
        let study = study?;
        output::write_bytes(&csv, table_csv(&study.curves).as_bytes())?;
        for (path, parameter) in &plots {
            plot(parameter.as_deref(), &study.curves).write(path)?;
        }
        let speedup = |s: &Speedup| (s.parameter.clone(), serde_json::json!(s.speedup));
        let report = Report {
            tool: "tyndall converge",
            version: env!("TYNDALL_VERSION"),
            command: std::env::args().collect(),
            scene: setup.desc.path.display().to_string(),
            scene_hash: format!("{:016x}", setup.desc.hash),
            seed: setup.seed,
            crop: setup.crop,
            threads: rayon::current_num_threads(),
            terms: &self.study.terms,
            time_seconds: self.time.as_secs_f64(),
            curves: &study.curves,
            speedup_over_finite_differences: study.speedups.iter().map(speedup).collect(),
            speedups: &study.speedups,
            health: &study.health,
        };
        let json = to_json(&report)?;
        output::write_bytes(&json_path, format!("{json}\n").as_bytes())?;
        if log.json {
            log.result(json)?;
        } else {
            let names: Vec<String> = files.iter().map(|f| f.display().to_string()).collect();
            log.summary(format!("{}\nwrote {}", table(&study.curves, &study.speedups), names.join(", ")))?;
        }
        study.health.check(study.samples as u64, self.study.health_limit)?;
        Ok(0)
    }
}

fn open(path: &Path, setup: &Setup) -> Result<ExrImage> {
    let remedy = "give an .exr of `tyndall render` or `grad`, of the picture's size";
    let image = exr::read(path).map_err(|e| Error::usage(e.to_string(), remedy))?;
    if image.rgb("").is_none() {
        return Err(Error::usage(format!("{} has no channels R, G and B", path.display()), remedy));
    }
    // Size and numbers are checked once, on the picture.
    layer_pixels(&image, "", setup)?;
    Ok(image)
}

fn layer_pixels(image: &ExrImage, layer: &str, setup: &Setup) -> Result<Option<Vec<f64>>> {
    let Some(pixels) = image.rgb(layer) else { return Ok(None) };
    let picture = RgbImage { width: image.width, height: image.height, pixels };
    let cut = crop_of(&picture, "--reference", setup.crop, setup.full_size())?;
    Ok(Some(cut.iter().flat_map(|p| p.0).collect()))
}

/// A layer of the reference and its variance: `d_x` and `var_x`, the picture and `var`.
fn layer_of(image: &ExrImage, layer: &str, setup: &Setup) -> Option<Reference> {
    let values = layer_pixels(image, layer, setup).ok().flatten()?;
    let variance = match layer.strip_prefix("d_") {
        Some(name) => format!("var_{name}"),
        None => "var".into(),
    };
    let variance = layer_pixels(image, &variance, setup).ok().flatten();
    let variance = variance.map_or(0.0, |v| v.iter().sum::<f64>() / v.len() as f64);
    let spp = image.attribute("spp").and_then(|a| a.as_integer()).map_or(f64::NAN, |n| n as f64);
    Some(Reference { image: values, variance, spp })
}

fn table_csv(curves: &[Curve]) -> String {
    let mut text = String::from("curve,kind,parameter,step,spp,seconds,rmse,relative_rmse,runs\n");
    for c in curves {
        let kind = match c.kind {
            Kind::Picture => "picture",
            Kind::Derivative => "derivative",
            Kind::Term => "term",
            Kind::Without => "without_term",
            Kind::FiniteDifference => "finite_difference",
        };
        let parameter = c.parameter.as_deref().unwrap_or("");
        let step = c.step.map_or(String::new(), |h| format!("{h:e}"));
        for p in &c.points {
            let relative = p.rmse / c.mean_abs;
            text += &format!(
                "{},{kind},{parameter},{step},{},{:.6},{:e},{relative:e},{}\n",
                c.name, p.spp, p.seconds, p.rmse, p.runs
            );
        }
    }
    text
}

/// The picture's curve, or those of one parameter.
fn plot(parameter: Option<&str>, curves: &[Curve]) -> Plot {
    let own = curves.iter().filter(|c| c.parameter.as_deref() == parameter);
    let series =
        |c: &Curve| Series { name: c.name.clone(), points: c.points.iter().map(|p| (p.seconds, p.rmse)).collect() };
    let title = parameter.map_or("picture".into(), |p| format!("derivative by {p}"));
    Plot::error_over_time(title, "root mean square error", own.map(series).collect())
}

fn table(curves: &[Curve], speedups: &[Speedup]) -> String {
    let mut rows =
        vec![["curve", "points", "spp", "time", "rmse / mean", "reference", "rmse^2 x s"].map(String::from).to_vec()];
    for c in curves {
        let last = c.points.last();
        rows.push(vec![
            c.name.clone(),
            c.points.len().to_string(),
            last.map_or("-".into(), |p| p.spp.to_string()),
            last.map_or("-".into(), |p| format::time(p.seconds)),
            last.map_or("-".into(), |p| format::percent(p.rmse / c.mean_abs)),
            format::percent(c.reference_rmse / c.mean_abs),
            c.cost.map_or("-".into(), |x| format!("{x:.3e}")),
        ]);
    }
    let mut text = format::table(&rows);
    for s in speedups {
        text += &levels(s, curves);
    }
    text
}

/// Who needs how long for an error, and how close ours comes in a thirtieth of the differences' time.
fn levels(s: &Speedup, curves: &[Curve]) -> String {
    let own = |c: &&Curve| c.kind == Kind::Derivative && c.parameter.as_ref() == Some(&s.parameter);
    let size = curves.iter().find(own).map_or(f64::NAN, |c| c.mean_abs);
    let percent = |rmse: f64| format::percent(rmse / size);
    let mut rows =
        vec![["rmse / mean", "step", "differences", "ours", "ratio", "ours in 1/30"].map(String::from).to_vec()];
    for l in &s.levels {
        rows.push(vec![
            percent(l.rmse),
            format::number(l.step),
            format::time(l.seconds_differences),
            l.seconds_ours.map_or("-".into(), format::time),
            l.ratio.map_or("-".into(), format::number),
            l.rmse_in_a_thirtieth.map_or("-".into(), percent),
        ]);
    }
    let summary = match (s.speedup, s.rmse) {
        (Some(ratio), Some(rmse)) => format!(
            "{} times as fast as finite differences at the smallest error that both reach ({})",
            format::number(ratio),
            percent(rmse)
        ),
        _ => "no error that both reach".into(),
    };
    format!("\n\n{}\nd_{}: {summary}", format::table(&rows), s.parameter)
}
