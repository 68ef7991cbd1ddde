//! A scene file as a function of its parameters, and the jobs that studies and fits run on its members.
//!
//! A member is the file with some parameters set as `-D name=value` would: finite differences, fits and pictures of the
//! command line share one definition of what a parameter means.

use super::driver::{Job, Mode, Outcome};
use super::plan::Terms;
use crate::error::{Error, Result};
use crate::math::Rgb;
use crate::params::ParamSet;
use crate::scene::compile::LoadOptions;
use crate::scene::volume_cache::VolumeCache;
use crate::scene::{Scene, SceneDesc};
use crate::term::EdgeForm;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

/// A scene file or text whose parameters are still open.
#[derive(Clone, Debug)]
pub struct Family {
    path: PathBuf,
    text: Option<String>,
    defines: Vec<(String, String)>,
    options: LoadOptions,
}

/// The scene at one set of values.
pub struct Member {
    pub desc: SceneDesc,
    pub scene: Scene,
}

impl Family {
    /// The members read each VDB file once.
    pub fn file(path: &Path, defines: &[(String, String)], options: LoadOptions) -> Self {
        let options = LoadOptions { volumes: Some(VolumeCache::default()), ..options };
        Family { path: path.into(), text: None, defines: defines.to_vec(), options }
    }

    /// From a text; `path` is where relative names start.
    pub fn text(text: &str, path: &Path) -> Self {
        Family { path: path.into(), text: Some(text.into()), defines: Vec::new(), options: LoadOptions::default() }
    }

    /// The description with these values in place of the file's.
    pub fn describe(&self, values: &[(&str, f64)]) -> Result<SceneDesc> {
        let mut defines = self.defines.clone();
        for &(name, value) in values {
            defines.retain(|(n, _)| n != name);
            // The shortest text that reads back as the same number.
            defines.push((name.into(), format!("{value:?}")));
        }
        match &self.text {
            Some(text) => SceneDesc::parse(text, &self.path, &defines),
            None => SceneDesc::load(&self.path, &defines),
        }
    }

    /// The scene with these values, ready to render. Values that the scene refuses are an error.
    pub fn at(&self, values: &[(&str, f64)]) -> Result<Member> {
        let desc = self.describe(values)?;
        let scene = Scene::compile(&desc, &self.options)?;
        Ok(Member { desc, scene })
    }
}

/// Which part of which picture, and which terms of its derivative.
#[derive(Clone, Copy)]
pub struct View<'a> {
    pub sensor: usize,
    /// x0, y0, x1, y1.
    pub crop: [usize; 4],
    /// `all`, or names of terms.
    pub terms: &'a [String],
    /// Raised from outside: runs end with [`Error::Interrupted`].
    pub stop: Option<&'a AtomicBool>,
}

impl<'a> View<'a> {
    pub fn pixels(&self) -> usize {
        (self.crop[2] - self.crop[0]) * (self.crop[3] - self.crop[1])
    }

    pub fn width(&self) -> usize {
        self.crop[2] - self.crop[0]
    }

    pub fn height(&self) -> usize {
        self.crop[3] - self.crop[1]
    }

    fn job<'b>(&self, scene: &'b Scene, mode: Mode<'b>, spp: u64, seed: u64) -> Job<'b>
    where
        'a: 'b,
    {
        Job {
            scene,
            sensor: self.sensor,
            crop: self.crop,
            spp,
            seed,
            mode,
            noise: &[],
            terms: Terms::ALL,
            edges: EdgeForm::Outward,
            split: false,
            max_time: None,
            target_error: None,
            stop: self.stop,
        }
    }

    /// The picture.
    pub fn picture(&self, scene: &Scene, spp: u64, seed: u64) -> Result<Outcome> {
        finished(self.job(scene, Mode::Picture, spp, seed).run(&|_| {})?)
    }

    /// The picture and one derivative image a parameter, of the terms of this view.
    pub fn derivative(&self, scene: &Scene, params: &ParamSet, spp: u64, seed: u64) -> Result<Outcome> {
        self.derivatives(scene, params, spp, seed, false)
    }

    /// What such a derivative would refuse, without a sample.
    pub fn refuse(&self, scene: &Scene, params: &ParamSet) -> Result<()> {
        let terms = Terms::parse(self.terms)?;
        Job { terms, ..self.job(scene, Mode::Forward(params), 1, 0) }.refuse()
    }

    /// The same, and a layer `d_<param>.<term>` of every term by itself.
    pub fn split(&self, scene: &Scene, params: &ParamSet, spp: u64, seed: u64) -> Result<Outcome> {
        self.derivatives(scene, params, spp, seed, true)
    }

    /// The picture, and the gradient over slots of `sum over pixels of <adjoint, I>` (`adjoint` is row-major over the crop), of the terms of this view.
    pub fn gradient(&self, scene: &Scene, params: &ParamSet, adjoint: &[Rgb], spp: u64, seed: u64) -> Result<Outcome> {
        let terms = Terms::parse(self.terms)?;
        finished(Job { terms, ..self.job(scene, Mode::Reverse(params, adjoint), spp, seed) }.run(&|_| {})?)
    }

    /// Where studies and fits make a job of derivative images.
    fn derivatives(&self, scene: &Scene, params: &ParamSet, spp: u64, seed: u64, split: bool) -> Result<Outcome> {
        let terms = Terms::parse(self.terms)?;
        finished(Job { terms, split, ..self.job(scene, Mode::Forward(params), spp, seed) }.run(&|_| {})?)
    }
}

fn finished(o: Outcome) -> Result<Outcome> {
    if o.complete { Ok(o) } else { Err(Error::Interrupted) }
}

/// A layer of an outcome as numbers: pixel by pixel, three channels each.
pub fn numbers(o: &Outcome, layer: usize) -> Vec<f64> {
    (0..o.film.spec().pixels()).flat_map(|p| o.film.mean(layer, p).0).collect()
}

/// The seed of the `round`th run of a stream: streams of one base seed never share numbers.
pub fn stream(seed: u64, stream: u8, round: u64) -> u64 {
    seed ^ u64::from(stream) << 56 ^ (round + 1) << 32
}
