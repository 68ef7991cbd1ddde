//! `tyndall plan`: which terms the derivative of a scene needs, and why. Renders nothing, loads no grid.

use super::format;
use super::log::Log;
use super::options::{LogOptions, SceneOptions, parameters_and_arrays};
use clap::Args;
use tyndall::error::{Error, Result};
use tyndall::render::plan::Plan;
use tyndall::scene::advice;

/// What a scene's derivatives need, what is left out and why; renders nothing
#[derive(Args)]
pub struct PlanArgs {
    #[command(flatten)]
    scene: SceneOptions,
    /// Parameters to differentiate by; ID.vertices: the vertices of a mesh
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    wrt: Vec<String>,
    #[command(flatten)]
    pub log: LogOptions,
}

impl PlanArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let wrt = parameters_and_arrays(&self.wrt)?;
        let desc = self.scene.desc()?;
        let plan = Plan::new(&desc, &wrt)?;
        log.warnings(&desc.warnings);
        log.warnings(&advice::of_parameters(&desc, &wrt)?);
        if log.json {
            log.result(json(&plan)?)?;
        } else {
            log.result(text(&plan))?;
        }
        Ok(0)
    }
}

fn json(plan: &Plan) -> Result<String> {
    serde_json::to_string_pretty(plan).map_err(|e| Error::Runtime(format!("cannot write the plan: {e}")))
}

fn text(plan: &Plan) -> String {
    let head = ["term", "letter", "decision", "reason"].map(String::from).to_vec();
    let row = |l: &tyndall::render::plan::PlanLine| {
        vec![l.term.clone(), l.letters.clone(), l.decision.clone(), l.reason.clone()]
    };
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(plan.lines.iter().map(row)).collect();
    format::table(&rows)
}
