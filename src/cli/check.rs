//! `tyndall check`: the derivative against finite differences, with a verdict a parameter.

use super::files;
use super::format;
use super::grad::tell_idle;
use super::log::Log;
use super::options::{LogOptions, SceneOptions, StudyOptions, duration, parameters};
use super::progress::Study;
use super::run::{Setup, left_out, to_json};
use clap::{Args, ValueEnum};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Duration;
use tyndall::error::{Error, Result};
use tyndall::image::{RgbImage, output};
use tyndall::render::family::{Family, View};
use tyndall::render::health::Health;
use tyndall::render::plan::Terms;
use tyndall::render::png::{self, Content, Exposure, Panel, Sheet};
use tyndall::study::check::{self, CheckOptions, CheckReport, ParameterCheck, Place, Verdict};

/// Derivatives against finite differences of the renderer's own pictures, both with error bars
///
/// Finite differences use common random numbers at both sides and a step from a sweep. A difference is exactly the mean of the
/// derivative over the interval of its step, and is compared with that: the derivative is taken at random places of the interval, with other seeds.
/// With --at value (and where scene or derivative take no interval around it) it is taken at the value itself, and the difference is
/// extrapolated (Richardson); what bias its step leaves is estimated and counted as error. Verdict of a parameter, over blocks of
/// pixels: fail where they differ significantly (false alarms: 1 in 10000 looks, two looks in a row); pass where they do not
/// and the combined standard error is at most 2 % of mean |d|, or where both are exactly 0; else undecided.
/// Samples grow, twofold at most, until that is settled. All but pass exit 3.
#[derive(Args)]
pub struct CheckArgs {
    #[command(flatten)]
    scene: SceneOptions,
    /// Parameters to check
    #[arg(long, value_name = "A,B,...", value_delimiter = ',', required = true)]
    wrt: Vec<String>,
    /// Step of the finite differences: auto, or a number
    #[arg(long, value_name = "auto|H", default_value = "auto", value_parser = step)]
    step: Step,
    /// Compare means over the step's interval (no bias), or the derivative at the value
    #[arg(long, value_name = "PLACE", value_enum, default_value_t = Where::Interval)]
    at: Where,
    /// Draw picture, derivative, finite difference and z scores of every parameter
    #[arg(long, value_name = "SHEET.png")]
    sheet: Option<PathBuf>,
    /// Report with all figures [default: standard output with --json]
    #[arg(short, long, value_name = "OUT.json")]
    output: Option<PathBuf>,
    /// Samples a pixel to begin with [default: few]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    spp: Option<u64>,
    /// Samples a pixel of derivative and difference, at most; 32 rounds of one are done in any case
    #[arg(long, value_name = "N", default_value_t = 1 << 20, value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    max_spp: u64,
    /// Time for all parameters, e.g. 90s, 5m, 1h; the search for a step, and 8 short rounds of either side, are done in any case
    #[arg(long, value_name = "TIME", default_value = "30m", value_parser = duration)]
    max_time: Duration,
    /// Side of a block in pixels
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u16).range(1..))]
    block: u16,
    #[command(flatten)]
    study: StudyOptions,
    #[command(flatten)]
    pub log: LogOptions,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Where {
    Interval,
    Value,
}

#[derive(Clone, Copy, Debug)]
struct Step(Option<f64>);

fn step(text: &str) -> std::result::Result<Step, String> {
    if text == "auto" {
        return Ok(Step(None));
    }
    super::options::positive(text).map(|h| Step(Some(h))).map_err(|_| "write auto, or a number greater than 0".into())
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
    block: u16,
    tolerance: f64,
    terms: &'a [String],
    verdict: Verdict,
    parameters: &'a [ParameterCheck],
    health: &'a Health,
    samples: u64,
    seconds: f64,
}

impl CheckArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let terms = Terms::parse(&self.study.terms)?;
        let wrt = parameters(&self.wrt, "check")?;
        self.check_places()?;
        let setup = Setup::new(&self.scene, &self.study.render(self.spp), &wrt, log)?;
        if let Some(w) = left_out(&setup, &terms) {
            log.warn(w);
        }
        tell_idle(&setup.scene.param_set(&setup.desc, &wrt)?, &wrt, log);
        let load = self.scene.load(self.study.repair_voxels);
        let family = Family::file(&self.scene.scene, &self.scene.define, load);
        let stop = Some(setup.stop.flag());
        let view = View { sensor: setup.sensor, crop: setup.crop, terms: &self.study.terms, stop };
        let options = CheckOptions {
            seed: setup.seed,
            spp: self.spp,
            max_spp: self.max_spp,
            max_time: self.max_time,
            block: self.block.into(),
            step: self.step.0,
            place: match self.at {
                Where::Interval => Place::Interval,
                Where::Value => Place::Value,
            },
            ..CheckOptions::default()
        };
        let mut study = Study::new(log, self.study.progress);
        let mut tell = |text: String| {
            let done = study.elapsed().as_secs_f64() / self.max_time.as_secs_f64();
            study.say(done, text);
        };
        let found = check::check(&family, view, &wrt, &options, &check::ours(view), &mut tell);
        drop(study);
        setup.stop.check()?;
        let found = found?;
        if let Some(path) = &self.sheet {
            sheet(path, &found, &view)?;
        }
        self.report(&found, &setup, log)?;
        if found.seconds > 1.1 * self.max_time.as_secs_f64() {
            log.warn(format!(
                "this took {}, longer than --max-time: the search for a step, a round of full length and 8 shorter ones of either side are done in any case; fewer parameters, --step or --crop make them shorter",
                format::time(found.seconds)
            ));
        }
        found.health.check(found.samples, self.study.health_limit)?;
        match found.verdict {
            Verdict::Pass => Ok(0),
            verdict => Err(failure(verdict, &found)),
        }
    }

    fn check_places(&self) -> Result<()> {
        if let Some(path) = &self.output {
            files::need_extension("--output", path, "json")?;
        }
        if let Some(path) = &self.sheet {
            files::need_extension("--sheet", path, "png")?;
        }
        for path in self.output.iter().chain(&self.sheet) {
            files::check_place(path, self.study.overwrite)?;
        }
        Ok(())
    }

    fn report(&self, found: &CheckReport, setup: &Setup, log: &Log) -> Result<()> {
        let report = Report {
            tool: "tyndall check",
            version: env!("TYNDALL_VERSION"),
            command: std::env::args().collect(),
            scene: setup.desc.path.display().to_string(),
            scene_hash: format!("{:016x}", setup.desc.hash),
            seed: setup.seed,
            crop: setup.crop,
            block: self.block,
            tolerance: CheckOptions::default().tolerance,
            terms: &self.study.terms,
            verdict: found.verdict,
            parameters: &found.parameters,
            health: &found.health,
            samples: found.samples,
            seconds: found.seconds,
        };
        let json = to_json(&report)?;
        if let Some(path) = &self.output {
            output::write_bytes(path, format!("{json}\n").as_bytes())?;
        }
        if log.json { log.result(json) } else { log.summary(table(found)) }
    }
}

/// One row a parameter.
fn table(found: &CheckReport) -> String {
    let heads: [&[&str]; 2] = [
        &["parameter", "verdict", "error", "max |z|", "limit", "chi2/n", "limit"],
        &["at", "spp", "spp of fd", "pixels", "time"],
    ];
    let mut rows = vec![heads.concat().into_iter().map(String::from).collect()];
    for p in &found.parameters {
        let chi = p.blocks.chi_square.iter().fold(0.0f64, |a, &b| a.max(b)) / p.blocks.degrees_of_freedom;
        rows.push(vec![
            p.name.clone(),
            p.verdict.name().into(),
            format::percent(p.blocks.relative_error),
            format!("{:.2}", p.blocks.max_z),
            format!("{:.2}", p.blocks.max_z_threshold),
            format!("{chi:.2}"),
            format!("{:.2}", p.blocks.chi_square_threshold / p.blocks.degrees_of_freedom),
            // Over an interval, or at the value, by this step.
            format!(
                "{} {} {}",
                format::number(p.value),
                if p.interval.is_some() { "+-" } else { "step" },
                format::number(p.step)
            ),
            format!("{}", p.spp_ours),
            format!("{}", p.spp_differences),
            format!("{} fail of {}", p.pixels.fail, p.pixels.places),
            format::time(p.seconds),
        ]);
    }
    format!("{}\n{}, {}", format::table(&rows), found.verdict.name(), format::time(found.seconds))
}

fn failure(verdict: Verdict, found: &CheckReport) -> Error {
    let of = |v: Verdict| -> String {
        let names = found.parameters.iter().filter(|p| p.verdict == v).map(|p| p.name.as_str());
        names.collect::<Vec<_>>().join(", ")
    };
    let (what, remedy) = match verdict {
        Verdict::Fail => (
            format!("derivative and finite difference differ: {}", of(verdict)),
            "--sheet draws where; `tyndall plan` shows which terms run; a smaller --step, or --at value, if the picture jumps within the interval; a larger --spp if few samples meet any light",
        ),
        _ => (
            format!("the comparison is not sharp enough: {}", of(verdict)),
            "give more time (--max-time), more samples (--max-spp), larger blocks (--block), or a part of the picture (--crop)",
        ),
    };
    Error::Check { what, remedy: remedy.into() }
}

/// One row a parameter: the picture, ours, finite difference, z.
fn sheet(path: &std::path::Path, found: &CheckReport, view: &View) -> Result<()> {
    let image = |x: &[f64]| RgbImage {
        width: view.width(),
        height: view.height(),
        pixels: x.chunks_exact(3).map(|p| [p[0] as f32, p[1] as f32, p[2] as f32]).collect(),
    };
    let picture = image(&found.picture);
    let row = |p: &ParameterCheck| {
        // The channels' z scores go together; their mean keeps the scale.
        let z = p.images.z.chunks_exact(3).map(|z| (z.iter().sum::<f64>() / 3.0) as f32).collect();
        let (width, height) = (view.width(), view.height());
        let panels = vec![
            Panel::picture(if p.interval.is_some() { "picture, mean" } else { "picture" }, &picture, Exposure::Auto),
            Panel::derivative(format!("d_{} ours", p.name), &image(&p.images.ours)),
            Panel::derivative(format!("finite diff. {}", p.verdict.name()), &image(&p.images.differences)),
            Panel { title: "z".into(), width, height, content: Content::Score(z, p.pixels.max_z_threshold) },
        ];
        Sheet { panels, columns: 4, unit: "radiance / unit".into(), ..Sheet::default() }
    };
    png::write_sheets(path, &found.parameters.iter().map(row).collect::<Vec<_>>(), 1)
}
