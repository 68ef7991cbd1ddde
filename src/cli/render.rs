//! `tyndall render`: the picture.

use super::files::{self, Outputs};
use super::frames::FrameOptions;
use super::log::Log;
use super::options::{LogOptions, RenderOptions, SceneOptions};
use super::preview;
use super::run::{self, Setup};
use clap::Args;
use std::path::PathBuf;
use tyndall::error::Result;
use tyndall::image::{exr, output};
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Terms;
use tyndall::term::EdgeForm;

/// Render a picture, with the variance of every pixel
#[derive(Args)]
pub struct RenderArgs {
    #[command(flatten)]
    scene: SceneOptions,
    /// Picture, an .exr; its report is written beside it as .json [default: SCENE's name in the current folder, of frames with _####]
    #[arg(short, long, value_name = "OUT.exr")]
    output: Option<PathBuf>,
    #[command(flatten)]
    frames: FrameOptions,
    #[command(flatten)]
    render: RenderOptions,
    #[command(flatten)]
    pub log: LogOptions,
}

impl RenderArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        self.frames.each(
            log,
            |frame| {
                let outputs = self.render.image_outputs(frame, &self.output, &self.scene.scene, ".exr")?;
                Ok((self.scene.of_frame(frame, &[])?, outputs))
            },
            |(scene, outputs)| {
                let setup = Setup::new(&scene, &self.render, &[], log)?;
                let way = (Terms::ALL, EdgeForm::Outward, false);
                picture(&setup, Mode::Picture, &[], way, &self.render, &outputs, log)
            },
        )
    }
}

/// Render in a mode that makes images, and write them.
pub fn picture(
    setup: &Setup,
    mode: Mode,
    wrt: &[String],
    (terms, edges, split): (Terms, EdgeForm, bool),
    options: &RenderOptions,
    outputs: &Outputs,
    log: &Log,
) -> Result<u8> {
    // Stopped while loading: there is nothing to write.
    setup.stop.check()?;
    if let Some(w) = run::left_out(setup, &terms) {
        log.warn(w);
    }
    let job = Job { terms, edges, split, ..setup.job(mode, options) };
    let done = run::run(&job, options, &setup.stop, log)?;
    let report = run::report(setup, &done, options, &outputs.all(), wrt, &job.terms);
    let (mut image, beyond) = files::image(&done.outcome, setup.crop, setup.full_size());
    image.attributes = run::attributes(&report);
    if beyond > 0 {
        log.warn(format!("{beyond} values are too large or too small for the EXR's single precision"));
    }
    if let Some(w) = run::light_on_ray(setup, &done.outcome) {
        log.warn(w);
    }
    exr::write(&outputs.main, &image)?;
    if let Some(path) = &outputs.preview {
        preview::write(path, &done.outcome.film)?;
    }
    let json = run::to_json(&report)?;
    output::write_bytes(&outputs.report, format!("{json}\n").as_bytes())?;
    if log.json {
        log.result(json)?;
    } else {
        log.summary(run::summary(&report, outputs))?;
    }
    run::finish(setup, &report, &done.outcome)
}
