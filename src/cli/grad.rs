//! `tyndall grad`: derivative images (forward mode), or the gradient of a loss (reverse mode).

use super::files::Outputs;
use super::format;
use super::frames::{Frame, FrameOptions};
use super::log::Log;
use super::loss::{self, Camera, Loss, LossReport};
use super::options::{Edges, LogOptions, RenderOptions, SceneOptions, parameters_and_arrays};
use super::render::picture;
use super::run::{self, RunReport, Setup};
use clap::Args;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tyndall::error::{Error, Result};
use tyndall::image::{exr, output};
use tyndall::inverse::loss::Evaluated;
use tyndall::math::Rgb;
use tyndall::native::vdb;
use tyndall::params::{Array, ParamSet};
use tyndall::render::driver::{Job, Mode};
use tyndall::render::family::stream;
use tyndall::render::plan::Terms;
use tyndall::scene::parts::Parts;
use tyndall::scene::{Scene, arrays};

/// Derivatives with respect to `$parameters` of the scene, gradients with respect to vertices of its meshes and voxels of its grids
///
/// Without --loss or --adjoint: one image a parameter (forward mode), layers d_NAME.R/G/B and var_NAME.R/G/B beside the picture.
/// With one of them: one number a parameter (reverse mode) as JSON, on standard output or in -o FILE.json. There `--wrt` takes ID.vertices too, ID being
/// the id of an obj or ply shape: three numbers a vertex, in world space, in the order of the mesh's vertices; and ID.sigma_t.grid,
/// ID.albedo.grid, ID.emission.grid, ID.temperature.grid, ID being the id of a medium with such a grid: one number a voxel and channel, by the grid's own values (sigma_t
/// before `scale`, emission before `emission_scale`, temperatures before `temperature_offset` and `temperature_scale`). Those
/// are written to -o FILE.vdb, one grid an array (its name: the array's), with the transform and the active voxels of the grid they belong to (an active tile is
/// one value and has one number; voxels of the background have none), and everything else as JSON beside it.
/// Standard errors of an array are those of the gradient pass, at most: the noise of the picture behind --loss is not in them; in those of parameters it is.
#[derive(Args, Clone)]
pub struct GradArgs {
    #[command(flatten)]
    scene: SceneOptions,
    /// Parameters to differentiate by; with --loss or --adjoint also ID.vertices, the vertices of a mesh, and ID.sigma_t.grid, ID.albedo.grid, ID.emission.grid,
    /// ID.temperature.grid, the voxels of a medium
    #[arg(long, value_name = "A,B,...", value_delimiter = ',', required = true)]
    wrt: Vec<String>,
    /// Images: an .exr, its report beside it as .json [default: SCENE's name + .grad.exr in the current folder];
    /// gradient: a .json [default: standard output]; with voxels a .vdb, the rest beside it as .json [default: SCENE's name + .grad.vdb]
    #[arg(short, long, value_name = "OUT")]
    output: Option<PathBuf>,
    /// Differentiate by the neighbours of active voxels too: all that share a cell with one
    #[arg(long)]
    dilate: bool,
    /// Gradient of this loss against --target. Of the samples, half make the picture that the loss is taken from, half the
    /// gradient; --max-time is shared alike. Both have random numbers of their own, which no `render --seed` of a target shares,
    /// so that the gradient is unbiased
    #[arg(long, value_enum, requires = "target", conflicts_with_all = ["adjoint", "preview", "split_terms"])]
    loss: Option<Loss>,
    /// Reference picture of --loss; with `--sensor all` one for each sensor, in the scene's order: the loss is then the mean over the sensors
    #[arg(long, value_name = "REF.exr,...", value_delimiter = ',', requires = "loss")]
    target: Vec<PathBuf>,
    /// Gradient of sum over pixels and channels of A * I, A = this image. Make A with another --seed than this run's:
    /// an image of the same random numbers biases the gradient. With `--sensor all` one for each sensor; gradients add up
    #[arg(long, value_name = "A.exr,...", value_delimiter = ',', conflicts_with_all = ["preview", "split_terms"])]
    adjoint: Vec<PathBuf>,
    /// Terms of the derivative: all, or a list; `tyndall plan` shows them
    #[arg(long, value_name = "TERMS", value_delimiter = ',', default_value = "all")]
    terms: Vec<String>,
    /// How `surface_edge` and `medium_edge` are estimated: from the edge outward, or, to validate that, from each vertex of camera paths (the
    /// same mean, far more noise)
    #[arg(long, value_enum, value_name = "FORM", default_value_t = Edges::Outward)]
    edges: Edges,
    /// Write the layers of each term too: d_NAME.TERM
    #[arg(long)]
    split_terms: bool,
    #[command(flatten)]
    frames: FrameOptions,
    #[command(flatten)]
    render: RenderOptions,
    #[command(flatten)]
    pub log: LogOptions,
}

impl GradArgs {
    pub fn run(&self, log: &Log) -> Result<u8> {
        self.frames.each(log, |frame| self.of_frame(frame), |(args, outputs)| args.one(outputs, log))
    }

    /// The same command in a frame, and what it writes; all that is known to be wrong before files are read.
    fn of_frame(&self, frame: Frame) -> Result<(Self, Option<Outputs>)> {
        let (_, wrt) = self.asked()?;
        let voxels = wrt.iter().any(|n| arrays::is_voxels(n));
        let outputs = if !self.is_reverse() {
            Some(self.render.image_outputs(frame, &self.output, &self.scene.scene, ".grad.exr")?)
        } else {
            let name = || frame.default_name(&self.scene.scene, ".grad.vdb");
            let extension = if voxels { "vdb" } else { "json" };
            let path = self.output.clone().or_else(|| voxels.then(name));
            let path = path.map(|p| frame.output("--output", &p)).transpose()?;
            path.map(|p| Outputs::new(p, extension, None, self.render.overwrite)).transpose()?
        };
        let inputs = |option: &str, paths: &[PathBuf]| -> Result<Vec<PathBuf>> {
            paths.iter().map(|p| frame.input(option, p)).collect()
        };
        let (target, adjoint) = (inputs("--target", &self.target)?, inputs("--adjoint", &self.adjoint)?);
        let scene = self.scene.of_frame(frame, &wrt)?;
        Ok((GradArgs { scene, target, adjoint, ..self.clone() }, outputs))
    }

    fn is_reverse(&self) -> bool {
        self.loss.is_some() || !self.adjoint.is_empty()
    }

    /// Terms and parameters, of options that go together.
    fn asked(&self) -> Result<(Terms, Vec<String>)> {
        let terms = Terms::parse(&self.terms)?;
        let wrt = parameters_and_arrays(&self.wrt)?;
        if self.dilate && !wrt.iter().any(|n| arrays::is_voxels(n)) {
            let remedy = "name an array of voxels, such as --wrt ID.sigma_t.grid, or leave it out";
            return Err(Error::usage("`--dilate` is for arrays of voxels, and `--wrt` has none", remedy));
        }
        if let Some(name) = wrt.iter().find(|n| !self.is_reverse() && arrays::split(n).is_some()) {
            return Err(Error::usage(
                format!("`--wrt {name}`: an array has a gradient, but no derivative images"),
                "give --loss l2 --target REF.exr, or --adjoint A.exr",
            ));
        }
        Ok((terms, wrt))
    }

    fn one(&self, outputs: Option<Outputs>, log: &Log) -> Result<u8> {
        let (terms, wrt) = self.asked()?;
        let outputs = match outputs {
            Some(o) if !self.is_reverse() => o,
            outputs => return self.reverse(&wrt, terms, outputs, log),
        };
        let setup = Setup::new(&self.scene, &self.render, &wrt, log)?;
        let params = setup.scene.param_set(&setup.desc, &wrt)?;
        tell_idle(&params, &wrt, log);
        picture(
            &setup,
            Mode::Forward(&params),
            &wrt,
            (terms, self.edges.into(), self.split_terms),
            &self.render,
            &outputs,
            log,
        )
    }

    fn reverse(&self, wrt: &[String], terms: Terms, outputs: Option<Outputs>, log: &Log) -> Result<u8> {
        let voxels = wrt.iter().any(|n| arrays::is_voxels(n));
        let all = self.render.sensor.as_deref() == Some("all");
        let mut options = self.render.clone();
        options.sensor = options.sensor.filter(|_| !all);
        if all && options.crop.is_some() {
            return Err(Error::usage("`--crop` is for one sensor", "give the films crops of their own"));
        }
        let mut setup = Setup::new(&self.scene, &options, wrt, log)?;
        if self.dilate {
            setup.scene.dilate(&setup.desc, wrt)?;
        }
        setup.scene.open(&setup.desc, wrt)?;
        let params = setup.scene.param_set(&setup.desc, wrt)?;
        tell_idle(&params, wrt, log);
        if let Some(w) = run::left_out(&setup, &terms) {
            log.warn(w);
        }
        let sensors: Vec<usize> = if all { (0..setup.scene.sensors.len()).collect() } else { vec![setup.sensor] };
        let images = if self.loss.is_some() { &self.target } else { &self.adjoint };
        if images.len() != sensors.len() {
            let what =
                format!("{} for {}", format::plural(images.len(), "image"), format::plural(sensors.len(), "sensor"));
            let option = if self.loss.is_some() { "--target" } else { "--adjoint" };
            let remedy =
                format!("give {option} one .exr for each, A.exr,B.exr,... in the scene's order (-s all: every sensor)");
            return Err(Error::usage(what, remedy));
        }
        let names: Vec<String> = {
            let parts = Parts::read(&setup.desc, &setup.desc.values::<f64>())?;
            parts.sensors.iter().map(|s| s.name.clone()).collect()
        };
        // One camera after the other; gradients add up, those of a mean loss by their share.
        let (mut total, mut sum): (Option<run::Done>, Sum) = (None, Sum::default());
        let (mut cameras, mut losses, spp) = (Vec::new(), Vec::new(), setup.spp);
        let files = outputs.as_ref().map_or(Vec::new(), Outputs::all);
        let mut report = None;
        for (&sensor, path) in sensors.iter().zip(images) {
            if all {
                (setup.sensor, setup.crop, setup.spp) = (sensor, setup.scene.films[sensor].part.crop, spp);
            }
            let (adjoint, noise, loss) = match self.loss {
                None => (self.image(path, &setup)?, Vec::new(), None),
                Some(kind) => {
                    self.gradient_job(&setup, &params, &[], &terms).refuse()?;
                    let (e, report) = self.adjoint_of_loss(kind, path, &mut setup, sensors.len(), log)?;
                    let [adjoint, noise] =
                        [e.adjoint, e.noise].map(|v| v.into_iter().map(|a| a * (1.0 / sensors.len() as f64)).collect());
                    (adjoint, noise, Some(report))
                }
            };
            setup.stop.check()?;
            let mut job = self.gradient_job(&setup, &params, &adjoint, &terms);
            job.noise = &noise;
            job.max_time = self.part_of_time(if loss.is_some() { 2 * sensors.len() } else { sensors.len() });
            if let Some(l) = &loss {
                job.seed = l.gradient_seed;
            }
            let mut done = run::run(&job, &self.render, &setup.stop, log)?;
            let own = run::report(&setup, &done, &self.render, &files, wrt, &job.terms);
            cameras.push(Camera {
                sensor: names[sensor].clone(),
                crop: setup.crop,
                image: path.display().to_string(),
                loss: loss.as_ref().map(|l| l.value),
            });
            losses.extend(loss);
            sum.add(done.outcome.gradient.take());
            match &mut total {
                None => (total, report) = (Some(done), Some(own)),
                Some(t) => {
                    t.outcome.film.health.merge(&done.outcome.film.health);
                    t.complete &= done.complete;
                    t.outcome.seconds += done.outcome.seconds;
                    let r = report.get_or_insert(own);
                    r.samples += done.outcome.spp
                        * (setup.crop[2] - setup.crop[0]) as u64
                        * (setup.crop[3] - setup.crop[1]) as u64;
                }
            }
        }
        let (Some(mut done), Some(mut report)) = (total, report) else {
            return Err(Error::Runtime("the scene has no sensor".into()));
        };
        done.outcome.gradient = sum.finish();
        if all {
            report.report.render_time_seconds = done.outcome.seconds;
            report.report.complete = done.complete;
            report.report.set_health(&done.outcome.film.health, report.samples, self.render.health_limit);
            report.cameras = cameras;
        }
        let n = losses.len() as f64;
        let mean = losses.iter().map(|l| l.value).sum::<f64>() / n;
        let targets = losses.iter().map(|l| l.target.clone()).collect::<Vec<_>>().join(",");
        report.loss = losses.into_iter().next().map(|l| LossReport { value: mean, target: targets, ..l });
        gradient(&mut report, &params, &setup.scene, &done.outcome.gradient);
        let json = run::to_json(&report)?;
        if let Some(o) = &outputs {
            if let (true, Some((g, _))) = (voxels, &done.outcome.gradient) {
                write_voxels(&o.main, &params, &setup, g, log)?;
            }
            output::write_bytes(&o.report, format!("{json}\n").as_bytes())?;
        }
        if log.json || outputs.is_none() {
            log.result(json)?;
        } else {
            log.summary(summary(&report, &outputs))?;
        }
        run::finish(&setup, &report, &done.outcome)
    }

    fn image(&self, path: &Path, setup: &Setup) -> Result<Vec<Rgb>> {
        let image = exr::read_rgb(path)
            .map_err(|e| Error::usage(e.to_string(), "give an .exr with the channels R, G and B"))?;
        loss::fit(&image, &path.display().to_string(), setup.crop, setup.full_size())
    }

    /// The gradient of a picture by its adjoint, or what refuses it.
    fn gradient_job<'a>(&self, setup: &'a Setup, params: &'a ParamSet, adjoint: &'a [Rgb], terms: &Terms) -> Job<'a> {
        let job = setup.job(Mode::Reverse(params, adjoint), &self.render);
        Job { terms: terms.clone(), edges: self.edges.into(), ..job }
    }

    /// Cameras, and the picture and the gradient of each, share the time alike.
    fn part_of_time(&self, parts: usize) -> Option<Duration> {
        self.render.max_time.map(|t| t / parts as u32)
    }

    /// Render the picture with half of the samples; leaves the other half to the gradient. Picture, gradient and target must be
    /// independent ([T] 1.5): the target may be a `render` of the same seed, so neither uses the seed itself.
    fn adjoint_of_loss(
        &self,
        kind: Loss,
        target: &Path,
        setup: &mut Setup,
        cameras: usize,
        log: &Log,
    ) -> Result<(Evaluated, LossReport)> {
        let reference = self.image(target, setup)?;
        let total = setup.spp;
        let spp = total.div_ceil(2);
        let (seed, gradient_seed) = (stream(setup.seed, 7, 0), stream(setup.seed, 8, 0));
        let mut job = setup.job(Mode::Picture, &self.render);
        (job.spp, job.seed, job.max_time) = (spp, seed, self.part_of_time(2 * cameras));
        log.detail(format!("rendering the picture of the loss: {spp} samples a pixel, seed {seed}"));
        let done = run::run(&job, &self.render, &setup.stop, log)?;
        let evaluated = kind.evaluate(&done.outcome.film, &reference)?;
        setup.spp = (total - spp).max(1);
        let target = target.display().to_string();
        let (bias, value, spp) = (kind.bias(), evaluated.value, done.outcome.spp);
        Ok((evaluated, LossReport { kind, bias, value, target, spp, seed, gradient_seed }))
    }
}

/// Gradients of several cameras, whose errors are independent.
#[derive(Default)]
struct Sum(Option<(Vec<f64>, Vec<f64>)>);

impl Sum {
    fn add(&mut self, own: Option<(Vec<f64>, Vec<f64>)>) {
        let Some((g, e)) = own else { return };
        match &mut self.0 {
            None => self.0 = Some((g, e)),
            Some((sum, error)) => {
                sum.iter_mut().zip(g).for_each(|(s, g)| *s += g);
                error.iter_mut().zip(e).for_each(|(s, e)| *s = s.hypot(e));
            }
        }
    }

    fn finish(self) -> Option<(Vec<f64>, Vec<f64>)> {
        self.0
    }
}

/// The arrays of voxels, a grid each.
fn write_voxels(path: &Path, params: &ParamSet, setup: &Setup, slots: &[f64], log: &Log) -> Result<()> {
    let mut grids = Vec::new();
    for a in &params.arrays {
        grids.extend(setup.scene.in_grid(&setup.desc, a, &slots[a.range()])?);
    }
    let voxels = || params.arrays.iter().filter(|a| arrays::is_voxels(&a.name)).flat_map(|a| &slots[a.range()]);
    let (count, largest) = (voxels().count(), voxels().fold(0.0f64, |m, x| m.max(x.abs())));
    let infinite = voxels().filter(|x| x.is_finite() && !(**x as f32).is_finite()).count();
    // Beside the largest ones rounding leaves nothing of those that vanish.
    let zero = voxels().filter(|x| x.abs() > 1e-7 * largest && **x as f32 == 0.0).count();
    for (n, what, value) in [(infinite, "large", "infinite"), (zero, "small", "0")] {
        if n > 0 {
            log.warn(format!(
                "{}: of {count} gradients, {n} too {what} for single precision, written as {value}; scale the loss or the adjoint picture",
                path.display()
            ));
        }
    }
    let vanish = voxels().filter(|x| **x != 0.0 && **x as f32 == 0.0).count();
    if vanish > zero {
        log.detail(format!(
            "{}: {} gradients below 1e-7 of the largest are written as 0",
            path.display(),
            vanish - zero
        ));
    }
    vdb::write(path, &grids)
}

/// Say when a derivative is zero because nothing depends on the parameter.
pub fn tell_idle(params: &ParamSet, wrt: &[String], log: &Log) {
    if !params.any_active() {
        log.warn(format!("nothing in the picture changes with {}: the derivative is 0", wrt.join(", ")));
    }
}

/// Gradient over parameters from that over slots: a number a name, `{shape, values}` an array; of voxels, which are written elsewhere, `{shape, grid, norm}`.
///
/// Errors of the slots add up as if they were fully correlated, which is exact where a parameter sets one slot, or all
/// channels of one quantity that are.
fn gradient(report: &mut RunReport, params: &ParamSet, scene: &Scene, slots: &Option<(Vec<f64>, Vec<f64>)>) {
    let Some((g, e)) = slots else { return };
    let values = params.pull_back(g);
    let size = |s: usize, k: usize| params.tangents(s as u32).get(k).map_or(0.0, |t| t.abs());
    let scalars = &e[..scene.slots.scalars];
    let of = |k: usize| scalars.iter().enumerate().map(|(s, e)| e * size(s, k)).sum();
    let errors: Vec<f64> = (0..params.len()).map(of).collect();
    let map = |v: Vec<f64>, slots: &[f64], order: bool| -> Map<String, Value> {
        let named = params.names.iter().cloned().zip(v.into_iter().map(|x| json!(x)));
        let array = |a: &Array| {
            if arrays::is_voxels(&a.name) {
                let norm = slots[a.range()].iter().map(|x| x * x).sum::<f64>().sqrt();
                return (a.name.clone(), json!({ "shape": a.shape, "grid": a.name, "norm": norm }));
            }
            let mut value = json!({ "shape": a.shape, "values": &slots[a.range()] });
            if let Some(order) = scene.file_order(a).filter(|_| order) {
                value["file_order"] = json!(order);
            }
            (a.name.clone(), value)
        };
        named.chain(params.arrays.iter().map(array)).collect()
    };
    report.gradient = Some(map(values, g, true));
    report.standard_error = Some(map(errors, e, false));
}

fn summary(r: &RunReport, outputs: &Option<Outputs>) -> String {
    let mut rows = vec![["parameter", "gradient", "standard error"].map(String::from).to_vec()];
    // Of an array the length of the vector.
    let number = |m: &Option<Map<String, Value>>, name: &str| {
        let value = m.as_ref().and_then(|m| m.get(name));
        let x = value.and_then(|v| match &v["values"] {
            Value::Array(v) => v.iter().map(|x| x.as_f64().map(|x| x * x)).sum::<Option<f64>>().map(f64::sqrt),
            _ => v.as_f64().or_else(|| v["norm"].as_f64()),
        });
        x.map_or("unknown".into(), |x| format!("{x:.6e}"))
    };
    for name in r.gradient.iter().flatten().map(|(name, _)| name) {
        let shown = if arrays::split(name).is_some() { format!("|{name}|") } else { name.clone() };
        rows.push(vec![shown, number(&r.gradient, name), number(&r.standard_error, name)]);
    }
    let mut text = format::table(&rows);
    if let Some(l) = &r.loss {
        let value = if l.value.is_finite() { format!("{:.6e}", l.value) } else { "unknown (one batch only)".into() };
        text = format!("loss {value}\n{text}");
    }
    if let Some(o) = outputs {
        text += &format!("\nwrote {}", o.main.display());
    }
    text
}
