//! `tyndall fit`: the parameters of a scene from a picture of it.

use super::files;
use super::fit_problem::{Given, Prepared};
use super::format;
use super::log::Log;
use super::loss::Loss;
use super::options::{LogOptions, StudyOptions, definition, duration, positive};
use super::progress::Study;
use super::run::to_json;
use clap::Args;
use serde::Serialize;
use serde_json::{Map, Value, json};
use std::path::PathBuf;
use std::time::Duration;
use tyndall::error::{Error, Result};
use tyndall::image::output;
use tyndall::inverse::fit::{Recovered, Unknown, fit};
use tyndall::inverse::{album, history};
use tyndall::render::health::Health;

/// Find parameters of a scene from a picture: inverse rendering
///
/// INPUT is a scene, or a fit.toml that names one. The gradient of an l2 loss is unbiased (picture and derivative
/// from independent samples); that of relative-l2, too; l1 takes the sign of noisy pixels and is biased where the noise is larger than the error. Adam in the box of the bounds, with a step size that halves every --half-life iterations down to a floor.
///
/// A run has converged when over the last --window iterations every parameter stayed within --tolerance of its bounds'
/// extent, although the steps could have carried it twice as far and its gradient was not 0 all the while, and the
/// loss fell no further (its second half's mean is not two standard errors below the first's). The values are means over that window.
///
/// Beside `$parameters`, `--wrt` takes arrays of voxels (ID.sigma_t.grid, ID.albedo.grid, ID.emission.grid, ID.temperature.grid): reverse mode, from one sensor or from several
/// (`sensors`, `targets` in the fit.toml), on grids that are refined as the fit goes on (`refine`). A field has converged when, at full resolution,
/// its mean over half a --window differs from that over the half before by --tolerance in the root mean square over its voxels, and the loss fell no further. It is written as
/// ID.sigma_t.vdb, which can stand in for the file that it came from.
///
/// Runs that end otherwise (iterations, time) are reported all the same; the exit code is 3.
#[derive(Args)]
pub struct FitArgs {
    /// Scene (.xml), or a fit.toml
    #[arg(value_name = "SCENE|FIT.toml")]
    pub input: PathBuf,
    /// Settings for a scene named by itself; options win over them
    #[arg(value_name = "FIT.toml")]
    pub settings: Option<PathBuf>,
    /// Set a `$parameter` of the scene (repeatable)
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = definition)]
    pub define: Vec<(String, String)>,
    /// Parameters to find
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    pub wrt: Vec<String>,
    /// Picture to match
    #[arg(long, value_name = "REF.exr")]
    pub target: Option<PathBuf>,
    /// Folder for history.csv, fit.json, plots and the animated picture [default: the input's name + .fit]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Bounds of a parameter (repeatable) [default: min and max of its <?diff?> hint]
    #[arg(long, value_name = "NAME=MIN,MAX", value_parser = bounds)]
    pub bounds: Vec<(String, [f64; 2])>,
    /// Where to start, one run each (repeatable) [default: the scene's values]
    #[arg(long, value_name = "A=1,B=2,...", value_parser = values)]
    pub start: Vec<Vec<(String, f64)>>,
    /// Seeds: one run each from every start; overrides --seed
    #[arg(long, value_name = "N,M,...", value_delimiter = ',')]
    pub seeds: Vec<u64>,
    /// First step of every parameter, as a share of its bounds' extent [default: 0.03]
    #[arg(long, value_name = "SHARE", value_parser = positive)]
    pub rate: Option<f64>,
    /// Iterations in which the step size falls to a half [default: 40]
    #[arg(long, value_name = "N", value_parser = positive)]
    pub half_life: Option<f64>,
    /// Iterations of a run, at most [default: 300]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub iterations: Option<u32>,
    /// Time of a run, at most, e.g. 90s, 5m [default: 10m]
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub max_time: Option<Duration>,
    /// Samples a pixel and an iteration of the picture, and of its derivative, at least 2 [default: 16]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(2..=1 << 40))]
    pub spp: Option<u64>,
    /// What is minimised [default: l2]
    #[arg(long, value_enum)]
    pub loss: Option<Loss>,
    /// Iterations that the stop rule looks at [default: 30]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    pub window: Option<u32>,
    /// Spread of a parameter in that window, as a share of its bounds' extent [default: 0.005]
    #[arg(long, value_name = "SHARE", value_parser = positive)]
    pub tolerance: Option<f64>,
    /// Frames of the animated picture of every run (start, middle and end are on a sheet, stills.png); 0: none of either
    #[arg(long, value_name = "N", default_value_t = 32)]
    pub frames: usize,
    /// Go on with the runs whose states are in the folder (fits of voxels, or from several sensors). Only --iterations and
    /// --max-time may differ from before
    #[arg(long)]
    pub resume: bool,
    /// How often such a fit saves its state; it does so at its end, too, and when a signal comes
    #[arg(long, value_name = "TIME", value_parser = duration, default_value = "300s")]
    pub checkpoint_every: Duration,
    #[command(flatten)]
    pub study: StudyOptions,
    #[command(flatten)]
    pub log: LogOptions,
}

fn bounds(text: &str) -> std::result::Result<(String, [f64; 2]), String> {
    let form = "write name=min,max with min < max, for example --bounds light_x=-1,1";
    let (name, range) = text.split_once('=').ok_or(form)?;
    let (min, max) = range.split_once(',').ok_or(form)?;
    let number = |s: &str| s.trim().parse::<f64>().ok().filter(|x| x.is_finite()).ok_or(form);
    let (min, max) = (number(min)?, number(max)?);
    if min < max { Ok((name.trim().into(), [min, max])) } else { Err(form.into()) }
}

fn values(text: &str) -> std::result::Result<Vec<(String, f64)>, String> {
    let form = "write name=value,name=value, for example --start light_x=1,light_y=0.5";
    let pair = |s: &str| {
        let (name, value) = s.split_once('=')?;
        Some((name.trim().to_string(), value.trim().parse::<f64>().ok().filter(|x| x.is_finite())?))
    };
    text.split(',').map(|s| pair(s).ok_or(form.to_string())).collect()
}

/// The machine-readable report, `fit.json`.
#[derive(Serialize)]
struct Report<'a> {
    tool: &'a str,
    version: &'a str,
    command: Vec<String>,
    scene: String,
    scene_hash: String,
    target: &'a str,
    loss: tyndall::inverse::Loss,
    spp: u64,
    max_iterations: usize,
    terms: &'a [String],
    window: usize,
    tolerance: f64,
    unknowns: &'a [Unknown],
    converged: bool,
    runs: Vec<Value>,
    health: &'a Health,
}

impl FitArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let given = Given::new(self)?;
        let folder = self.output.clone().unwrap_or_else(|| files::default_name(&self.input, ".fit"));
        files::check_folder(&folder, self.study.overwrite || self.resume)?;
        let prepared = Prepared::new(&given, self, log)?;
        if !prepared.is_reverse() {
            self.forward_only(&given.settings)?;
        }
        let health = Health::new();
        let targets = prepared.targets(&health)?;
        files::make_folder(&folder)?;
        prepared.write_target(&folder, &targets)?;
        if prepared.is_reverse() {
            return super::fit_reverse::run(self, &prepared, &given.settings, &targets, &folder, &health, log);
        }
        let problem = prepared.problem(&targets)?;
        let mut study = Study::new(log, self.study.progress);
        let all = prepared.starts.len() * prepared.seeds.len();
        let mut runs: Vec<Recovered> = Vec::new();
        for start in &prepared.starts {
            for &seed in &prepared.seeds {
                let number = runs.len() + 1;
                let run = fit(&problem, start, seed, &health, &mut |s| {
                    let values: Vec<String> = s.values.iter().map(|&x| format::number(x)).collect();
                    let (loss, error) = (format::number(s.loss), format::number(s.error));
                    let part = s.iteration as f64 / prepared.iterations as f64;
                    let text = format!(
                        "run {number} iteration {}: loss {loss} +- {error} at {}",
                        s.iteration,
                        values.join(" ")
                    );
                    study.say((number as f64 - 1.0 + part) / all as f64, text);
                })?;
                runs.push(run);
                // What is done is kept, whatever comes.
                history::write_csv(&folder.join("history.csv"), &prepared.unknowns, &runs)?;
                if prepared.setup.stop.exit_code().is_some() {
                    break;
                }
            }
        }
        drop(study);
        history::write_plots(&folder, &prepared.unknowns, &runs, &prepared.truth)?;
        let report = self.report(&prepared, &runs, &health);
        let json = to_json(&report)?;
        output::write_bytes(&folder.join("fit.json"), format!("{json}\n").as_bytes())?;
        if let Some(code) = prepared.setup.stop.exit_code() {
            log.warn(format!("stopped by a signal: the runs so far are in {}", folder.display()));
            return Ok(code);
        }
        if self.frames > 0 {
            for (i, run) in runs.iter().enumerate() {
                let number = if runs.len() == 1 { String::new() } else { format!("_{}", i + 1) };
                let [path, still] = ["animation", "stills"].map(|name| folder.join(format!("{name}{number}.png")));
                let spp = problem.spp.max(16);
                let (family, view) = (&prepared.family, problem.view);
                album::write(&path, &still, family, problem.unknowns, run, view, &targets, self.frames, spp)?;
            }
        }
        if log.json {
            log.result(json)?;
        } else {
            log.summary(format!("{}\nwrote {}", table(&prepared, &runs), folder.display()))?;
        }
        let pixels = problem.view.pixels() as u64;
        let samples = runs.iter().map(|r| r.iterations as u64).sum::<u64>() * 2 * problem.spp * pixels;
        health.check(samples, self.study.health_limit)?;
        if report.converged { Ok(0) } else { Err(failure(&runs)) }
    }

    /// What a fit of scalars from one view does not know.
    fn forward_only(&self, s: &tyndall::inverse::Settings) -> Result<()> {
        let keys = [
            ("`--resume`", self.resume),
            ("`views`", s.views.is_some()),
            ("`refine`", s.refine.is_some()),
            ("`total_variation`", s.total_variation.is_some()),
            ("`turntable`", s.turntable.is_some()),
        ];
        match keys.iter().find(|k| k.1) {
            None => Ok(()),
            Some((key, _)) => Err(Error::usage(
                format!("{key} is for fits of voxels, or from several sensors"),
                "leave it out, or name an array of voxels in `wrt`, or several `sensors`",
            )),
        }
    }

    fn report<'a>(&'a self, p: &'a Prepared, runs: &[Recovered], health: &'a Health) -> Report<'a> {
        Report {
            tool: "tyndall fit",
            version: env!("TYNDALL_VERSION"),
            command: std::env::args().collect(),
            scene: p.setup.desc.path.display().to_string(),
            scene_hash: format!("{:016x}", p.setup.desc.hash),
            target: &p.target_name,
            loss: p.loss,
            spp: p.spp,
            max_iterations: p.iterations,
            terms: &p.terms,
            window: p.rule.window,
            tolerance: p.rule.tolerance,
            unknowns: &p.unknowns,
            converged: runs.iter().all(|r| r.converged),
            runs: runs.iter().map(|r| run_json(p, r)).collect(),
            health,
        }
    }
}

fn run_json(p: &Prepared, r: &Recovered) -> Value {
    let named = |v: &[f64]| -> Map<String, Value> {
        p.unknowns.iter().map(|u| u.name.clone()).zip(v.iter().map(|x| json!(x))).collect()
    };
    let errors: Map<String, Value> = (0..p.unknowns.len())
        .filter_map(|k| Some((p.unknowns[k].name.clone(), json!(r.values[k] - p.truth[k]?))))
        .collect();
    json!({
        "seed": r.seed, "start": named(&r.start), "values": named(&r.values), "error_to_truth": errors,
        "converged": r.converged, "reason": r.reason, "iterations": r.iterations, "seconds": r.seconds, "loss": r.loss,
    })
}

/// One row a run.
fn table(p: &Prepared, runs: &[Recovered]) -> String {
    let mut head =
        vec!["run".to_string(), "seed".into(), "end".into(), "iterations".into(), "time".into(), "loss".into()];
    head.extend(p.unknowns.iter().map(|u| u.name.clone()));
    let mut rows = vec![head];
    for (i, r) in runs.iter().enumerate() {
        let mut row = vec![
            (i + 1).to_string(),
            r.seed.to_string(),
            r.reason.into(),
            r.iterations.to_string(),
            format::time(r.seconds),
            format::number(r.loss),
        ];
        row.extend(r.values.iter().map(|x| format!("{x:.5}")));
        rows.push(row);
    }
    if p.truth.iter().any(Option::is_some) {
        let mut row =
            vec!["truth".to_string(), String::new(), String::new(), String::new(), String::new(), String::new()];
        row.extend(p.truth.iter().map(|t| t.map_or("?".into(), |t| format!("{t:.5}"))));
        rows.push(row);
    }
    format::table(&rows)
}

fn failure(runs: &[Recovered]) -> Error {
    let open = runs.iter().enumerate().filter(|(_, r)| !r.converged);
    let list: Vec<String> = open.map(|(i, r)| format!("run {} ({})", i + 1, r.reason)).collect();
    Error::Check {
        what: format!("not converged: {}", list.join(", ")),
        remedy:
            "look at history.csv and the plots; give more --iterations or --max-time, more --spp, or another --rate"
                .into(),
    }
}
