//! `tyndall stress`: stiff and extreme cases against independent numerical truth, one row a number.

use super::format;
use super::log::Log;
use super::options::LogOptions;
use super::run::to_json;
use clap::{Args, ValueEnum};
use serde::Serialize;
use tyndall::error::Result;
use tyndall::study::{self, StressOptions, StressRow, Summary};

/// Stiff and extreme cases against known numbers: one row a number, with a verdict
#[derive(Args)]
pub struct StressArgs {
    /// One case, of either suite
    #[arg(long, value_name = "NAME", conflicts_with = "suite")]
    case: Option<String>,
    /// Cases to run
    #[arg(long, value_enum, default_value_t = Suite::Core)]
    suite: Suite,
    /// Threads [default: one a core]
    #[arg(short, long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    threads: Option<u16>,
    #[command(flatten)]
    pub log: LogOptions,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Suite {
    Core,
    All,
}

/// The machine-readable copy.
#[derive(Serialize)]
struct Copy<'a> {
    rows: &'a [StressRow],
    summary: Summary,
}

impl StressArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let options = StressOptions {
            case: self.case.clone(),
            suite: match self.suite {
                Suite::Core => study::Suite::Core,
                Suite::All => study::Suite::All,
            },
            threads: self.threads.map_or(0, usize::from),
            ..StressOptions::default()
        };
        let mut rows = Vec::new();
        let mut written = if log.json { Ok(()) } else { log.result(StressRow::HEADER) };
        let summary = study::run(&options, &mut |row| {
            if !log.json && written.is_ok() {
                written = log.result(row);
            }
            rows.push(row.clone());
        })?;
        written?;
        if log.json {
            log.result(to_json(&Copy { rows: &rows, summary })?)?;
        } else {
            log.result(text(&summary))?;
        }
        summary.check()?;
        Ok(0)
    }
}

fn text(s: &Summary) -> String {
    format!("{}: {} ok, {} not yet, {} failed", format::plural(s.rows, "row"), s.ok, s.not_yet, s.failed)
}
