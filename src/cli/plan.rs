//! `tyndall plan`: which terms the derivative of a scene needs, and why, and what of it `grad` refuses. Renders nothing.

use super::format;
use super::log::Log;
use super::options::{LogOptions, SceneOptions, parameters_and_arrays};
use super::run;
use clap::Args;
use serde::Serialize;
use tyndall::error::{Error, Result};
use tyndall::render::family::View;
use tyndall::render::plan::Plan;
use tyndall::scene::parts::Parts;
use tyndall::scene::{Scene, SceneDesc, advice};

/// What a scene's derivatives need, what is left out and why; renders nothing
#[derive(Args)]
pub struct PlanArgs {
    #[command(flatten)]
    scene: SceneOptions,
    /// Parameters to differentiate by; ID.vertices: the vertices of a mesh
    #[arg(long, value_name = "A,B,...", value_delimiter = ',')]
    wrt: Vec<String>,
    /// Sensor, by number from 0 or by id: what moves in its sight may matter [default: 0]
    #[arg(short, long, value_name = "SENSOR")]
    sensor: Option<String>,
    #[command(flatten)]
    pub log: LogOptions,
}

impl PlanArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        let wrt = parameters_and_arrays(&self.wrt)?;
        let desc = self.scene.desc()?;
        let plan = Plan::new(&desc, &wrt)?;
        log.warnings(&advice::of_parameters(&desc, &wrt)?);
        let refused = self.refused(&desc, &plan, &wrt, log)?.map(|e| e.to_string());
        if log.json {
            log.result(json(&Sheet { plan: &plan, refused })?)?;
        } else {
            let refused = refused.map_or(String::new(), |e| format!("\n`grad` refuses this: {e}\n"));
            log.result(text(&plan) + &refused)?;
        }
        Ok(0)
    }

    /// What `grad` would refuse: by what the file says, or by where things are, which takes the scene itself.
    fn refused(&self, desc: &SceneDesc, plan: &Plan, wrt: &[String], log: &Log) -> Result<Option<Error>> {
        let sensor = run::find_sensor(self.sensor.as_deref(), &Parts::read(desc, &desc.values::<f64>())?)?;
        if wrt.is_empty() {
            log.warnings(&desc.warnings);
            return Ok(None);
        }
        if let Err(e) = plan.refuse() {
            log.warnings(&desc.warnings);
            return Ok(Some(e));
        }
        // Of voxels that have to be repaired `grad` tells.
        let mut scene = match Scene::compile(desc, &self.scene.load(true)) {
            Ok(scene) => scene,
            Err(e) => return Ok(Some(e)),
        };
        log.warnings(&scene.warnings);
        let found = scene.open(desc, wrt).and_then(|()| {
            let params = scene.param_set(desc, wrt)?;
            let crop = scene.films[sensor].part.crop;
            View { sensor, crop, terms: &["all".into()], stop: None }.refuse(&scene, &params)
        });
        Ok(found.err())
    }
}

/// The plan, and what stands in its way.
#[derive(Serialize)]
struct Sheet<'a> {
    #[serde(flatten)]
    plan: &'a Plan,
    refused: Option<String>,
}

fn json(sheet: &Sheet) -> Result<String> {
    serde_json::to_string_pretty(sheet).map_err(|e| Error::Runtime(format!("cannot write the plan: {e}")))
}

fn text(plan: &Plan) -> String {
    let head = ["term", "letter", "decision", "reason"].map(String::from).to_vec();
    let row = |l: &tyndall::render::plan::PlanLine| {
        vec![l.term.clone(), l.letters.clone(), l.decision.clone(), l.reason.clone()]
    };
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(plan.lines.iter().map(row)).collect();
    format::table(&rows)
}
