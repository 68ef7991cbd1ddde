//! `tyndall info FILE`: what a file holds, and what this program makes of it.

mod exr;
mod mesh;
mod scene;
mod vdb;
mod vol;

use super::log::Log;
use super::options::LogOptions;
use super::run::to_json;
use clap::Args;
use serde::Serialize;
use std::path::PathBuf;
use tyndall::error::{Error, Result};

/// What a file holds and whether it can be used: .vdb, .vol, .exr, .ply, .obj, or a scene (.xml)
#[derive(Args)]
pub struct InfoArgs {
    file: PathBuf,
    /// Set a `$parameter` of a scene (repeatable)
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = super::options::definition)]
    define: Vec<(String, String)>,
    #[command(flatten)]
    pub log: LogOptions,
}

/// What there is to know of a file, for people and (through serde) for programs.
trait Info: Serialize {
    fn text(&self) -> String;
}

impl InfoArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let path = self.file.as_path();
        if !path.is_file() {
            return Err(Error::usage(format!("there is no file {}", path.display()), "check the name"));
        }
        let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
        if extension != "xml" && !self.define.is_empty() {
            return Err(Error::usage("`-D` is for scenes", "leave it out"));
        }
        let text = match extension.as_str() {
            "vdb" => told(&readable(vdb::VdbInfo::read(path))?, log),
            "vol" => told(&readable(vol::VolInfo::read(path))?, log),
            "exr" => told(&readable(exr::ExrInfo::read(path))?, log),
            "ply" | "obj" => told(&readable(mesh::MeshInfo::read(path, &extension))?, log),
            "xml" => told(&scene::SceneInfo::read(path, &self.define)?, log),
            _ => {
                let what = format!("{}: nothing is known about files of this name", path.display());
                Err(Error::usage(what, "give a .vdb, .vol, .exr, .ply, .obj or a scene .xml"))
            }
        };
        log.result(text?)?;
        Ok(0)
    }
}

/// What is wrong with the file itself is bad input.
fn readable<T>(read: Result<T>) -> Result<T> {
    let remedy = "look whether it was written to its end, and is of the kind that its name says";
    read.map_err(|e| match e {
        Error::Runtime(what) => Error::usage(what, remedy),
        other => other,
    })
}

fn told(info: &impl Info, log: &Log) -> Result<String> {
    if log.json { to_json(info) } else { Ok(info.text()) }
}

/// Numbers with enough digits to tell places apart.
fn numbers(x: &[f64]) -> String {
    x.iter().map(|x| number(*x)).collect::<Vec<_>>().join(", ")
}

/// Six significant digits at most.
fn number(x: f64) -> String {
    let rounded: f64 = format!("{x:.5e}").parse().unwrap_or(x);
    if rounded != 0.0 && !(1e-4..1e9).contains(&rounded.abs()) { format!("{rounded:e}") } else { format!("{rounded}") }
}

/// Least, largest and mean of the finite values, and how many are not finite.
#[derive(Clone, Copy, Debug, Serialize)]
struct Range {
    /// Null where there is no finite value.
    min: f64,
    max: f64,
    mean: f64,
    nonfinite: usize,
}

impl Range {
    fn of(values: impl IntoIterator<Item = f32>) -> Self {
        let (mut r, mut n) = (Range { min: f64::INFINITY, max: f64::NEG_INFINITY, mean: 0.0, nonfinite: 0 }, 0u64);
        for x in values.into_iter().map(f64::from) {
            if x.is_finite() {
                (r.min, r.max) = (r.min.min(x), r.max.max(x));
                r.mean += x;
                n += 1;
            } else {
                r.nonfinite += 1;
            }
        }
        if n == 0 {
            (r.min, r.max) = (f64::NAN, f64::NAN);
        }
        r.mean /= n as f64;
        r
    }

    fn text(&self) -> String {
        let bad = if self.nonfinite > 0 { format!(", {} not finite", self.nonfinite) } else { String::new() };
        if self.min.is_nan() {
            return format!("no values{bad}");
        }
        format!("{} .. {}, mean {}{bad}", number(self.min), number(self.max), number(self.mean))
    }
}
