//! Many paths of one scene, each by itself: every pixel of an orthographic film of no extent is one path of the same
//! integral, so mean, batches, variance of a path and the largest path are all at hand ([`Estimate`]).

use crate::error::{Error, Result};
use crate::math::Rgb;
use crate::math::stats::{Moments, median};
use crate::params::ParamSet;
use crate::render::driver::{Job, Mode};
use crate::render::family::View;
use crate::render::health::Mishap;
use crate::render::plan::Terms;
use crate::scene::compile::LoadOptions;
use crate::scene::{Scene, SceneDesc};
use crate::term::EdgeForm;
use rayon::ThreadPool;
use std::path::Path;
use std::time::Instant;

/// Width of the film that scenes declare; one job renders up to `WIDTH * HEIGHT` paths.
pub const WIDTH: usize = 256;
pub const HEIGHT: usize = 128;
/// Paths of the driver's pilot: they cost as much as others and count in times.
const PILOT: usize = 512;
/// Batches for standard errors (STABILITY section 2).
const BATCHES: usize = 32;

/// The film and the box filter of every case.
pub fn film() -> String {
    format!(
        r#"<film type="hdrfilm"><integer name="width" value="{WIDTH}"/><integer name="height" value="{HEIGHT}"/><rfilter type="box"/></film>"#
    )
}

/// A scene with the parameters that a case differentiates.
pub struct Subject {
    pub desc: SceneDesc,
    pub scene: Scene,
    pub params: Option<ParamSet>,
    /// Its film is a picture: batches are whole films.
    pub whole: bool,
}

impl Subject {
    pub fn new(text: &str, wrt: &[&str]) -> Result<Self> {
        let desc = SceneDesc::parse(text, Path::new("stress/scene.xml"), &[])?;
        let scene = Scene::compile(&desc, &LoadOptions::default())?;
        let mut s = Subject { desc, scene, params: None, whole: false };
        if !wrt.is_empty() {
            s.params = Some(s.param_set(wrt)?);
        }
        Ok(s)
    }

    fn param_set(&self, wrt: &[&str]) -> Result<ParamSet> {
        let names: Vec<String> = wrt.iter().map(|s| s.to_string()).collect();
        self.scene.param_set(&self.desc, &names)
    }

    /// The gradient of the mean over a row of the film by the voxels of a grid, in slots.
    pub fn voxels(mut self, grid: &str) -> Result<(Vec<f64>, ParamSet)> {
        let names = [grid.to_string()];
        self.scene.open(&self.desc, &names)?;
        let params = self.scene.param_set(&self.desc, &names)?;
        let terms = ["all".to_string()];
        let view = View { sensor: 0, crop: [0, 0, WIDTH, 1], terms: &terms, stop: None };
        let adjoint = vec![Rgb::splat(1.0 / (3 * WIDTH) as f64); WIDTH];
        let outcome = view.gradient(&self.scene, &params, &adjoint, 64, 1)?;
        Ok((outcome.gradient.map(|g| g.0).unwrap_or_default(), params))
    }

    pub fn layers(&self) -> usize {
        1 + self.params.as_ref().map_or(0, ParamSet::len)
    }

    pub fn mode(&self) -> Mode<'_> {
        self.params.as_ref().map_or(Mode::Picture, Mode::Forward)
    }

    /// A job of `paths <= WIDTH * HEIGHT` pixels, one sample each.
    pub fn job<'a>(&'a self, paths: usize, seed: u64, mode: Mode<'a>) -> Job<'a> {
        let (w, h) = (paths.min(WIDTH), paths.div_ceil(WIDTH).max(1));
        let crop = [0, 0, w, h];
        Job {
            scene: &self.scene,
            sensor: 0,
            crop,
            spp: 1,
            seed,
            mode,
            noise: &[],
            terms: Terms::ALL,
            edges: EdgeForm::Outward,
            split: false,
            max_time: None,
            target_error: None,
            stop: None,
        }
    }
}

/// What many paths say about one number.
#[derive(Clone, Copy, Debug)]
pub struct Estimate {
    pub value: f64,
    /// Standard error of the mean, from batches.
    pub stderr: f64,
    /// Variance of one path over the squared mean.
    pub relvar: f64,
    /// Standard error of that, from the batches' variances and the mean's own error.
    pub relvar_error: f64,
    /// Median of the batch means.
    pub median: f64,
    /// Largest |path| over the sum of |path|.
    pub largest: f64,
}

/// Estimates of one run and what else it met.
#[derive(Clone, Debug)]
pub struct Measured {
    pub estimates: Vec<Estimate>,
    pub paths: usize,
    /// Samples left out (not finite, or out of the film's range).
    pub rejected: u64,
    /// Paths cut by the renderer's own cap.
    pub truncated: u64,
    pub missed: u64,
    pub light_on_ray: u64,
}

/// `combinations[k]` = coefficients over the layers (value, then one derivative a parameter), formed path by path.
pub fn measure(pool: &ThreadPool, s: &Subject, combinations: &[Vec<f64>], paths: usize) -> Result<Measured> {
    let per_job = WIDTH * HEIGHT;
    let paths = if s.whole {
        BATCHES * per_job
    } else if paths > WIDTH {
        paths.div_ceil(WIDTH) * WIDTH
    } else {
        paths
    };
    let k = combinations.len();
    let mut all = vec![Moments::default(); k];
    let mut batches = vec![[Moments::default(); BATCHES]; k];
    let (mut largest, mut total) = (vec![0f64; k], vec![0f64; k]);
    let mut m = Measured { estimates: Vec::new(), paths, rejected: 0, truncated: 0, missed: 0, light_on_ray: 0 };
    let (mut done, mut seed) = (0, 1);
    while done < paths {
        let n = per_job.min(paths - done);
        let outcome = pool.install(|| s.job(n, seed, s.mode()).run(&|_| {}))?;
        let film = &outcome.film;
        for pixel in 0..n {
            let layers: Vec<f64> = (0..s.layers()).map(|l| film.mean(l, pixel)[0]).collect();
            let batch = (done + pixel) * BATCHES / paths;
            for (j, c) in combinations.iter().enumerate() {
                let x: f64 = c.iter().zip(&layers).map(|(a, b)| a * b).sum();
                all[j].push(x);
                batches[j][batch].push(x);
                total[j] += x.abs();
                largest[j] = largest[j].max(x.abs());
            }
        }
        let h = &film.health;
        m.rejected += h.get(Mishap::RejectedNonfinite) + h.get(Mishap::Overflow) + h.get(Mishap::SumOverflow);
        m.truncated += h.get(Mishap::TruncatedEnergy);
        m.missed += h.get(Mishap::MissedBoundaries);
        m.light_on_ray += h.get(Mishap::LightOnRay);
        done += n;
        seed += 1;
    }
    for j in 0..k {
        let means: Vec<f64> = batches[j].iter().filter(|b| b.n > 0.0).map(|b| b.mean).collect();
        let value = all[j].mean;
        // A sum of zeros has no spread and no largest path.
        let over = |a: f64, b: f64| if a == 0.0 { 0.0 } else { a / b };
        let stderr = means.iter().copied().collect::<Moments>().standard_error();
        let spreads: Moments = batches[j].iter().filter(|b| b.n > 1.0).map(Moments::variance).collect();
        let relative = |x: f64| over(x, value * value);
        if s.whole {
            // Pixels differ by what they show: the noise is what films differ by.
            let variance = means.iter().copied().collect::<Moments>().variance() * per_job as f64;
            let (relvar, relvar_error) = (relative(variance), relative(variance) * (2.0 / (BATCHES - 1) as f64).sqrt());
            let (median, largest) = (median(means), over(largest[j], total[j]));
            m.estimates.push(Estimate { value, stderr, relvar_error, relvar, median, largest });
            continue;
        }
        m.estimates.push(Estimate {
            value,
            stderr,
            relvar_error: relative(spreads.standard_error())
                + 2.0 * relative(all[j].variance()) * over(stderr, value.abs()),
            relvar: over(all[j].variance(), value * value),
            median: median(means),
            largest: over(largest[j], total[j]),
        });
    }
    Ok(m)
}

/// CPU seconds of a pool's threads so far; wall time where the system does not tell.
fn cpu_seconds(pool: &ThreadPool, start: Instant) -> f64 {
    let of_thread = || {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        text.split_whitespace().next()?.parse::<f64>().ok()
    };
    let ns: Option<Vec<f64>> = pool.broadcast(|_| of_thread()).into_iter().collect();
    ns.map_or(start.elapsed().as_secs_f64(), |v| v.iter().sum::<f64>() * 1e-9)
}

/// CPU seconds of about `paths` paths, and how many they were.
fn seconds(pool: &ThreadPool, s: &Subject, paths: usize, seed: u64) -> Result<(f64, f64)> {
    let clock = Instant::now();
    let start = cpu_seconds(pool, clock);
    let (mut done, mut walked, mut k) = (0, 0, 0);
    while done < paths {
        let n = (WIDTH * HEIGHT).min(paths - done);
        let job = s.job(n, seed + k, s.mode());
        let pixels = job.width() * job.height();
        pool.install(|| job.run(&|_| {}))?;
        walked += pixels + PILOT;
        (done, k) = (done + n, k + 1);
    }
    Ok((cpu_seconds(pool, clock) - start, walked as f64))
}

/// Time per path of `a` over that of `b`, both in their own modes, alternating: the ratio of the sums over several rounds.
pub fn time_ratio(pool: &ThreadPool, a: &Subject, b: &Subject) -> Result<f64> {
    const ROUNDS: u64 = 5;
    /// CPU seconds a round and side should take.
    const WANTED: f64 = 0.1;
    let size = |s: &Subject| -> Result<usize> {
        let mut n = 64;
        loop {
            let (t, walked) = seconds(pool, s, n, 900)?;
            if t > 0.25 * WANTED || n >= 1 << 20 {
                // Long paths differ much in length: a fair mean needs a number of them.
                return Ok(((walked * WANTED / t.max(1e-9)) as usize).clamp(512, 1 << 20));
            }
            n *= 4;
        }
    };
    let (na, nb) = (size(a)?, size(b)?);
    let (mut ta, mut tb) = ((0.0, 0.0), (0.0, 0.0));
    for k in 0..ROUNDS {
        for (s, n, sum) in [(b, nb, &mut tb), (a, na, &mut ta)] {
            let (t, walked) = seconds(pool, s, n, 1000 + k * 100)?;
            *sum = (sum.0 + t, sum.1 + walked);
        }
    }
    Ok(ta.0 / ta.1 / (tb.0 / tb.1))
}

/// A pool of `threads` threads; 0 = as many as there are cores.
pub fn pool(threads: usize) -> Result<ThreadPool> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| Error::Runtime(format!("cannot start {threads} threads: {e}")))
}
