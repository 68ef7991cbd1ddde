//! Options that commands share, and how their values are read.

use super::files::Outputs;
use super::frames::Frame;
use clap::{Args, ValueEnum};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tyndall::error::{Error, Result};
pub use tyndall::inverse::duration::duration;
use tyndall::render::plan::Plan;
use tyndall::scene::compile::{LoadOptions, Orders};
use tyndall::scene::{SceneDesc, arrays};
use tyndall::term::EdgeForm;

/// Log and result format.
#[derive(Args, Clone, Debug, Default)]
pub struct LogOptions {
    /// Errors only: no progress display, no warnings, no summary
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,
    /// Say what is done
    #[arg(short, long)]
    pub verbose: bool,
    /// Result as JSON on standard output, and nothing else there
    #[arg(long)]
    pub json: bool,
    /// Write the whole log to a file too
    #[arg(long, value_name = "FILE")]
    pub log_file: Option<PathBuf>,
}

#[derive(Args, Clone, Debug)]
pub struct SceneOptions {
    /// Scene file (Mitsuba 3 XML)
    pub scene: PathBuf,
    /// Set a `$parameter` of the scene (repeatable)
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = definition)]
    pub define: Vec<(String, String)>,
    /// Only light that scattered this often, at surfaces or in media: N, A..B or A.. [default: all]
    #[arg(long, value_name = "ORDERS", value_parser = orders)]
    pub orders: Option<Orders>,
    /// The frame, of a sequence.
    #[arg(skip)]
    pub frame: Option<u32>,
}

impl SceneOptions {
    pub fn desc(&self) -> Result<SceneDesc> {
        SceneDesc::load_frame(&self.scene, &self.define, self.frame)
    }

    /// The scene in a frame, and the errors that its description has: all that is known before files are read.
    pub fn of_frame(&self, frame: Frame, wrt: &[String]) -> Result<Self> {
        let scene = frame.input("SCENE", &self.scene)?;
        let own = SceneOptions { scene, frame: frame.number, ..self.clone() };
        Plan::new(&own.desc()?, wrt)?.refuse()?;
        Ok(own)
    }

    pub fn load(&self, repair_voxels: bool) -> LoadOptions {
        LoadOptions { repair_voxels, orders: self.orders.unwrap_or_default(), volumes: None }
    }
}

/// What every command that renders takes.
#[derive(Args, Clone, Debug)]
pub struct RenderOptions {
    /// Sensor, by number from 0 or by id [default: 0]
    #[arg(short, long, value_name = "SENSOR")]
    pub sensor: Option<String>,
    /// Samples a pixel, at most [default: the scene's sample_count]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=1 << 40))]
    pub spp: Option<u64>,
    /// Seed of the random numbers: same seed, same bits, on any number of threads [default: the scene's]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Threads [default: one a core]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Part of the picture, in pixels from its upper left corner: the same pixels as in the full picture
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = crop)]
    pub crop: Option<[usize; 4]>,
    /// Set voxels that are NaN, infinite or negative to 0 (albedos above 1 to 1) instead of refusing the file, and count them
    #[arg(long)]
    pub repair_voxels: bool,
    /// Stop when this time is over, e.g. 90s, 5m, 1h: with the batches that are done by then, but not before one is. The first ones
    /// are of one sample, later ones of 1/32 of all at most. Error bars need two
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub max_time: Option<Duration>,
    /// Stop after the batch in which the picture's relative error (root mean square error over mean) falls below this,
    /// e.g. 0.01, but not before a quarter of the samples and 8 batches: fewer do not tell the error well
    #[arg(long, value_name = "ERROR", value_parser = positive)]
    pub target_error: Option<f64>,
    /// Share of samples that may be biased (left out, cut) before the exit code is 3
    #[arg(long, value_name = "SHARE", default_value_t = tyndall::render::health::DEFAULT_LIMIT, value_parser = share)]
    pub health_limit: f64,
    /// Replace output files that exist
    #[arg(long)]
    pub overwrite: bool,
    /// Draw a PNG too
    #[arg(long, value_name = "OUT.png")]
    pub preview: Option<PathBuf>,
    /// Progress display on standard error
    #[arg(long, value_enum, default_value_t = ProgressKind::Auto)]
    pub progress: ProgressKind,
}

/// What commands take that render many times.
#[derive(Args, Clone, Debug)]
pub struct StudyOptions {
    /// Sensor, by number from 0 or by id [default: 0]
    #[arg(short, long, value_name = "SENSOR")]
    pub sensor: Option<String>,
    /// Seed of the random numbers [default: the scene's]
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Threads [default: one a core]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    pub threads: Option<u16>,
    /// Part of the picture, in pixels from its upper left corner
    #[arg(long, value_name = "X0,Y0,X1,Y1", value_parser = crop)]
    pub crop: Option<[usize; 4]>,
    /// Terms of the derivative: all, or a list; `tyndall plan` shows them
    #[arg(long, value_name = "TERMS", value_delimiter = ',', default_value = "all")]
    pub terms: Vec<String>,
    /// Set voxels that are NaN, infinite or negative to 0 (albedos above 1 to 1) instead of refusing the file, and count them
    #[arg(long)]
    pub repair_voxels: bool,
    /// Share of samples that may be biased (left out, cut) before the exit code is 3
    #[arg(long, value_name = "SHARE", default_value_t = tyndall::render::health::DEFAULT_LIMIT, value_parser = share)]
    pub health_limit: f64,
    /// Replace output files that exist
    #[arg(long)]
    pub overwrite: bool,
    /// Progress display on standard error: the share used up of what the study may take at most, and its last finding
    #[arg(long, value_enum, default_value_t = ProgressKind::Auto)]
    pub progress: ProgressKind,
}

impl RenderOptions {
    /// Where the images of a frame go; `ending`: of the default name.
    pub fn image_outputs(&self, frame: Frame, output: &Option<PathBuf>, scene: &Path, ending: &str) -> Result<Outputs> {
        let name = output.clone().unwrap_or_else(|| frame.default_name(scene, ending));
        let preview = self.preview.as_ref().map(|p| frame.output("--preview", p)).transpose()?;
        Outputs::new(frame.output("--output", &name)?, "exr", preview, self.overwrite)
    }
}

impl StudyOptions {
    /// The same for a single run.
    pub fn render(&self, spp: Option<u64>) -> RenderOptions {
        RenderOptions {
            sensor: self.sensor.clone(),
            spp,
            seed: self.seed,
            threads: self.threads,
            crop: self.crop,
            repair_voxels: self.repair_voxels,
            max_time: None,
            target_error: None,
            health_limit: self.health_limit,
            overwrite: self.overwrite,
            preview: None,
            progress: ProgressKind::None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Edges {
    /// From the edge
    Outward,
    /// From each vertex of camera paths
    PerVertex,
}

impl From<Edges> for EdgeForm {
    fn from(e: Edges) -> Self {
        match e {
            Edges::Outward => EdgeForm::Outward,
            Edges::PerVertex => EdgeForm::PerVertex,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ProgressKind {
    /// A bar on a terminal, else plain lines
    Auto,
    /// A bar
    Bar,
    /// A line each 10 s
    Plain,
    /// A line of JSON each second
    Json,
    None,
}

/// `name=value`.
pub fn definition(text: &str) -> std::result::Result<(String, String), String> {
    match text.split_once('=') {
        Some((name, value)) if !name.is_empty() => Ok((name.into(), value.into())),
        _ => Err("write name=value, for example -D light_x=0.5".into()),
    }
}

fn crop(text: &str) -> std::result::Result<[usize; 4], String> {
    let form = "write four whole numbers x0,y0,x1,y1 (x1 and y1 are one past the last pixel), for example 0,0,64,32";
    let numbers = text.split(',').map(|s| s.trim().parse()).collect::<std::result::Result<Vec<usize>, _>>();
    let [x0, y0, x1, y1] = numbers.map_err(|_| form)?[..] else { return Err(form.into()) };
    if x0 >= x1 || y0 >= y1 {
        return Err(format!("the crop is empty: {form}"));
    }
    Ok([x0, y0, x1, y1])
}

/// `2`, `1..3` (both included) or `2..`.
fn orders(text: &str) -> std::result::Result<Orders, String> {
    let form = "write numbers of scatterings: 2, or 1..3 (both included), or 2..";
    let number = |s: &str| s.trim().parse::<u32>().map_err(|_| form.to_string());
    let (first, last) = match text.split_once("..") {
        None => (number(text)?, number(text)?),
        Some((a, "")) => (number(a)?, u32::MAX),
        Some((a, b)) => (number(a)?, number(b)?),
    };
    if first > last {
        return Err(format!("{first} comes after {last}: {form}"));
    }
    Ok(Orders { first, last })
}

pub fn positive(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("write a number greater than 0".into()),
    }
}

fn share(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (0.0..=1.0).contains(&x) => Ok(x),
        _ => Err("write a number between 0 and 1".into()),
    }
}

/// The parameters of `--wrt`: without `$`, each once, none that is an array. `command`: who asks.
pub fn parameters(wrt: &[String], command: &str) -> Result<Vec<String>> {
    let names = parameters_and_arrays(wrt)?;
    match names.iter().find(|n| arrays::split(n).is_some()) {
        None => Ok(names),
        Some(name) => Err(Error::usage(
            format!("`--wrt {name}`: `{command}` takes `$parameters` only, no arrays"),
            "an array has a gradient (and `fit` finds voxels): `tyndall grad SCENE --wrt ID.vertices --loss l2 --target REF.exr`, or --adjoint A.exr; here \
             give a `$parameter` of the scene: `tyndall info SCENE` lists them",
        )),
    }
}

/// The parameters of `--wrt`, arrays (`ID.vertices`) among them: without `$`, each once.
pub fn parameters_and_arrays(wrt: &[String]) -> Result<Vec<String>> {
    let mut names: Vec<String> = Vec::with_capacity(wrt.len());
    for text in wrt {
        let name = text.trim().trim_start_matches('$');
        if name.is_empty() {
            return Err(Error::usage("`--wrt` has an empty name", "write --wrt a,b"));
        }
        arrays::known(name)?;
        if names.iter().any(|n| n == name) {
            return Err(Error::usage(format!("`--wrt` names `{name}` twice"), "give each name once"));
        }
        names.push(name.into());
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn crops_are_boxes() {
        assert_eq!(crop("1,2, 3,4"), Ok([1, 2, 3, 4]));
        for bad in ["", "1,2,3", "1,2,3,4,5", "3,2,3,4", "-1,0,2,2", "0,0,1.5,2"] {
            assert!(crop(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn orders_are_ranges() {
        assert_eq!(orders("2"), Ok(Orders { first: 2, last: 2 }));
        assert_eq!(orders("1..3"), Ok(Orders { first: 1, last: 3 }));
        assert_eq!(orders("2.."), Ok(Orders { first: 2, last: u32::MAX }));
        for bad in ["", "..", "..2", "3..1", "a", "-1", "1..=2"] {
            assert!(orders(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn parameters_are_distinct_names() {
        let names = |v: &[&str]| parameters(&v.iter().map(|s| s.to_string()).collect::<Vec<_>>(), "check");
        assert_eq!(names(&["$a", "b"]).unwrap(), ["a", "b"]);
        for bad in [&["a", "$a"][..], &[""], &["smoke.sigma_t.grid"]] {
            assert!(names(bad).is_err(), "{bad:?}");
        }
    }
}
