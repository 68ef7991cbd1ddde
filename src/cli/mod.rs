//! The command line: one subcommand a file. The only place that prints.
//!
//! stdout carries the result (with `--json` nothing but JSON), stderr the log and the progress display. Exit codes are those
//! of [`tyndall::error::ExitCode`], and 128 + n after signal n.

mod check;
mod completions;
mod converge;
mod files;
mod fit;
mod fit_problem;
mod fit_reverse;
mod format;
mod frames;
mod grad;
mod info;
mod log;
mod loss;
mod man;
mod options;
mod plan;
mod preview;
mod progress;
mod render;
mod run;
mod signal;
mod stress;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use log::Log;
use std::process::ExitCode;
use std::sync::OnceLock;
use tyndall::error::Result;

const AFTER_HELP: &str = "\
Exit codes: 0 done; 1 failure at run time; 2 usage or scene error; 3 a check failed or the health limit was passed;
4 the output exists or parts do not belong together; 130/143 stopped by SIGINT/SIGTERM: render, grad and fit write what they have, check and converge nothing.";

/// Differentiable volumetric renderer: pictures of fog, smoke and fire, and their derivatives.
#[derive(Parser)]
#[command(name = "tyndall", version = version(), after_help = AFTER_HELP, max_term_width = 110)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    Render(render::RenderArgs),
    Grad(grad::GradArgs),
    Check(check::CheckArgs),
    Fit(Box<fit::FitArgs>),
    Converge(converge::ConvergeArgs),
    Info(info::InfoArgs),
    Plan(plan::PlanArgs),
    Stress(stress::StressArgs),
    #[command(hide = true)]
    Completions(completions::CompletionsArgs),
    #[command(hide = true)]
    Man(man::ManArgs),
}

impl Command {
    fn run(&self, log: &Log) -> Result<u8> {
        match self {
            Command::Render(a) => a.run(log),
            Command::Grad(a) => a.run(log),
            Command::Check(a) => a.run(log),
            Command::Fit(a) => a.run(log),
            Command::Converge(a) => a.run(log),
            Command::Info(a) => a.run(log),
            Command::Plan(a) => a.run(log),
            Command::Stress(a) => a.run(log),
            Command::Completions(a) => a.run(log),
            Command::Man(a) => a.run(log),
        }
    }

    fn log_options(&self) -> options::LogOptions {
        match self {
            Command::Render(a) => a.log.clone(),
            Command::Grad(a) => a.log.clone(),
            Command::Check(a) => a.log.clone(),
            Command::Fit(a) => a.log.clone(),
            Command::Converge(a) => a.log.clone(),
            Command::Info(a) => a.log.clone(),
            Command::Plan(a) => a.log.clone(),
            Command::Stress(a) => a.log.clone(),
            Command::Completions(_) | Command::Man(_) => options::LogOptions::default(),
        }
    }
}

/// What `--version` prints: this program and the native libraries as they report themselves.
fn version() -> &'static str {
    static VERSION: OnceLock<String> = OnceLock::new();
    VERSION.get_or_init(|| {
        let (embree, openvdb) = (tyndall::native::embree::version(), tyndall::native::vdb::version());
        format!("{}\nEmbree {embree}\nOpenVDB {openvdb}", env!("TYNDALL_VERSION"))
    })
}

/// The whole command tree, for man pages and completions.
fn command() -> clap::Command {
    // `--seed -1` is a bad number, not an unknown option.
    Cli::command().mut_subcommands(|s| s.allow_negative_numbers(true))
}

pub fn main() -> ExitCode {
    let parsed = command().try_get_matches().and_then(|m| Cli::from_arg_matches(&m));
    let command = match parsed {
        Ok(cli) => cli.command,
        Err(e) => {
            // Nothing is left to tell it to if the terminal is gone.
            let _ = e.print();
            return ExitCode::from(e.exit_code() as u8);
        }
    };
    let log = match Log::new(&command.log_options()) {
        Ok(log) => log,
        Err(e) => {
            eprintln!("error: {e}");
            return ExitCode::from(e.exit_code() as u8);
        }
    };
    match command.run(&log) {
        Ok(code) => ExitCode::from(code),
        Err(e @ tyndall::error::Error::Interrupted) => {
            log.error(&e);
            ExitCode::from(signal::last_exit_code())
        }
        Err(e) => {
            log.error(&e);
            ExitCode::from(e.exit_code() as u8)
        }
    }
}
