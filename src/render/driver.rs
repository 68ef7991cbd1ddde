//! The driver: pixels x samples -> film layers or a gradient. Work is cut into fixed batches (for the variance) and tiles (for
//! threads); random numbers depend on neither, sums on no order.

use super::film::{Film, FilmSpec, batch_ranges, graded_ranges};
use super::filter;
use super::gradient::{Batches, Gradient, Size};
use super::health::Mishap;
use super::limb::Limbs;
use super::passes::Work;
use super::plan::Terms;
use super::rooms::Rooms;
use super::swept::Swept;
use crate::error::{Error, Result};
use crate::math::Rgb;
use crate::math::rng::{Purpose, Rng};
use crate::params::ParamSet;
use crate::scene::Scene;
use crate::term::{EdgeForm, Motion};
use crate::transport::motion::Moving;
use crate::transport::{Beginning, Sweep, SweepFacts, border};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// Pixels of one work item.
const TILE: usize = 64;

/// What is computed besides the picture.
pub enum Mode<'a> {
    Picture,
    /// One image a parameter.
    Forward(&'a ParamSet),
    /// Gradient of `sum over pixels of <adjoint, I>`; `adjoint` is row-major over the crop.
    Reverse(&'a ParamSet, &'a [Rgb]),
}

impl Mode<'_> {
    pub(super) fn params(&self) -> Option<&ParamSet> {
        match self {
            Mode::Picture => None,
            Mode::Forward(p) | Mode::Reverse(p, _) => Some(p),
        }
    }
}

pub struct Job<'a> {
    pub scene: &'a Scene,
    pub sensor: usize,
    /// x0, y0, x1, y1.
    pub crop: [usize; 4],
    pub spp: u64,
    pub seed: u64,
    pub mode: Mode<'a>,
    /// Standard deviations of the adjoint's own noise, of all channels of a pixel alike, over the crop: errors of a gradient hold it then, those of arrays do not. Empty where the adjoint is exact.
    pub noise: &'a [Rgb],
    /// Which terms of a derivative are computed.
    pub terms: Terms,
    /// How the terms of edges are estimated.
    pub edges: EdgeForm,
    /// A layer for each term of each derivative too.
    pub split: bool,
    /// Stop when this time is over, but not before one batch is done. Batches grow from one sample then.
    pub max_time: Option<Duration>,
    /// Stop after the batch in which the relative error of the picture's mean pixel falls below this.
    pub target_error: Option<f64>,
    /// Raised from outside (a signal): stop after some samples of a pixel, without the open batch.
    pub stop: Option<&'a AtomicBool>,
}

/// How far a run is, for progress displays; called between tiles.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    pub done: f64,
    pub elapsed: Duration,
    pub samples: u64,
    /// Relative standard error of the picture so far (root mean square over the mean); NaN before two batches.
    pub error: f64,
}

pub struct Outcome {
    pub film: Film,
    /// Reverse mode: one number a slot, and the standard error from the batches.
    pub gradient: Option<(Vec<f64>, Vec<f64>)>,
    pub seconds: f64,
    /// Samples a pixel actually taken.
    pub spp: u64,
    pub target_reached: Option<bool>,
    pub complete: bool,
    pub light_on_ray: Option<[usize; 2]>,
    /// Seconds over all threads of each boundary room that ran.
    pub room_seconds: Vec<(&'static str, f64)>,
}

impl Job<'_> {
    pub fn width(&self) -> usize {
        self.crop[2] - self.crop[0]
    }

    pub fn height(&self) -> usize {
        self.crop[3] - self.crop[1]
    }

    pub(super) fn layers(&self) -> Vec<String> {
        let mut v = vec!["".to_string()];
        if let Mode::Forward(p) = &self.mode {
            v.extend(p.names.iter().map(|n| format!("d_{n}")));
        }
        v
    }

    /// Layers of the derivative by itself for one term, where they are split: they follow the sums.
    fn term_layers(&self, term: &str) -> Vec<String> {
        match &self.mode {
            Mode::Forward(p) if self.split => p.names.iter().map(|n| format!("d_{n}.{term}")).collect(),
            _ => Vec::new(),
        }
    }

    /// How a sample of a pixel begins, and its film point. The key holds the pixel of the whole film, so a crop has the same bits.
    pub(super) fn beginning(&self, purpose: Purpose, x: usize, y: usize, sample: u64) -> (Beginning, [f64; 2]) {
        let sensor = &self.scene.sensors[self.sensor];
        let pixel = self.pixel_key(x, y);
        let film = self.scene.films[self.sensor];
        let mut rng = Rng::of(film.even, self.seed, purpose as u64, pixel, sample);
        let f = film.part.filter;
        let (dx, dy) = (filter::sample(f, &mut rng), filter::sample(f, &mut rng));
        let point = [x as f64 + 0.5 + dx, y as f64 + 0.5 + dy];
        let (o, w) = sensor.ray(point[0], point[1]);
        (Beginning::new(rng, o, w, sensor.medium), point)
    }

    pub(super) fn pixel_key(&self, x: usize, y: usize) -> u64 {
        (y * self.scene.sensors[self.sensor].width + x) as u64 | (self.sensor as u64) << 48
    }

    /// Render. `progress` is called from worker threads, at most a few times a second worth of tiles.
    pub fn run(&self, progress: &(dyn Fn(Progress) + Sync)) -> Result<Outcome> {
        let outcome = self.run_with(progress, false)?;
        // The pilot missed something brighter than the film could hold: once more, with a film made for it.
        if outcome.film.health.get(Mishap::Overflow) > 0 { self.run_with(progress, true) } else { Ok(outcome) }
    }

    /// What moves, and the rooms that this asks for.
    fn prepare(&self, params: Option<&ParamSet>) -> Result<(Option<Arc<Motion>>, Option<Rooms<'_>>)> {
        let sensor = &self.scene.sensors[self.sensor];
        let motion = params.map(|p| Motion::new(self.scene, sensor, p)).transpose()?.map(Arc::new);
        let wanted = |n: &str| self.terms.wants(n);
        let new = |(m, p)| Rooms::new(self.scene, self.sensor, self.crop, self.seed, p, m, self.edges, wanted);
        let rooms = motion.as_ref().zip(params).map(new).transpose()?;
        Ok((motion, rooms.filter(|r| !r.is_empty())))
    }

    /// What a run of this job would refuse, without a sample.
    pub fn refuse(&self) -> Result<()> {
        let Some(params) = self.mode.params().filter(|p| !p.is_empty()) else { return Ok(()) };
        self.prepare(Some(params)).map(|_| ())
    }

    fn run_with(&self, progress: &(dyn Fn(Progress) + Sync), wide: bool) -> Result<Outcome> {
        let start = Instant::now();
        let params = self.mode.params().filter(|p| !p.is_empty());
        let (motion, mut rooms) = self.prepare(params)?;
        if let (Some(rooms), Some(params)) = (&mut rooms, params) {
            self.guide(rooms, params);
        }
        // The sweep computes two terms, told apart by their slots.
        let swept = params.map(|p| {
            let (interior, borders) = (self.terms.wants("interior"), self.terms.wants(border::NAME));
            p.only(|s| if self.scene.moves_a_border(s) { borders } else { interior })
        });
        let swept = swept.as_ref().filter(|p| self.terms.wants("interior") || p.any_active());
        let borders = swept.map(|p| p.only(|s| self.scene.moves_a_border(s))).filter(ParamSet::any_active);
        let borders = borders.as_ref().filter(|_| self.split);
        let (scene, sensor) = (self.scene, &self.scene.sensors[self.sensor]);
        let (images, room_count) = (self.layers().len() - 1, rooms.as_ref().map_or(0, |r| r.list.len()));
        let split_layers = self.split.then_some([1 + images, 1 + (2 + room_count) * images]);
        let swept = swept.zip(motion.as_ref()).map(|(params, m)| {
            // Without the interior only borders move, which are no opaque shapes.
            let moving = match self.terms.wants("interior") {
                true => m.moving.clone(),
                false => Moving::new(scene, sensor, params)?.with_inner(m.moving.inner().clone()),
            };
            let facts = Arc::new(SweepFacts::new(scene, params, moving));
            let sweep = Sweep { scene, set: &scene.settings, params, facts, sensor };
            Ok(Swept { sweep, borders, images, layers: split_layers })
        });
        let swept = swept.transpose()?;
        let limbs = motion.zip(swept.as_ref()).and_then(|(m, s)| Limbs::new(scene, self.sensor, &m, s.sweep.params));
        let mut layers = self.layers();
        layers.extend(self.term_layers("interior"));
        rooms.iter().flat_map(|r| &r.list).for_each(|r| layers.extend(self.term_layers(r.name())));
        borders.iter().for_each(|_| layers.extend(self.term_layers(border::NAME)));
        let spec = FilmSpec {
            width: self.width(),
            height: self.height(),
            layers,
            quantum: self.quanta(swept.as_ref().map(|s| &s.sweep), &mut rooms, borders.is_some(), wide),
        };
        let mut work = Work { swept, limbs, rooms, film: Film::new(spec) };
        let pixels = self.width() * self.height();
        let tiles = pixels.div_ceil(TILE);
        let batches = if self.max_time.is_some() { graded_ranges(self.spp) } else { batch_ranges(self.spp) };
        let reverse = matches!(self.mode, Mode::Reverse(..));
        let slots = &self.scene.slots;
        let size = match reverse {
            true => Size { scalars: slots.scalars, arrays: slots.count - slots.scalars, noisy: !self.noise.is_empty() },
            false => Size { scalars: 0, arrays: 0, noisy: false },
        };
        let (mut gradient, mut gradients) = (Gradient::new(size), Batches::new(size));
        let (mut taken, mut error) = (0, f64::NAN);
        let mut target_reached = self.target_error.map(|_| false);
        let light_on_ray = Mutex::new(None);
        for (index, &(first, n)) in batches.iter().enumerate() {
            let done = std::sync::atomic::AtomicUsize::new(0);
            let dropped = AtomicBool::new(false);
            gradient.gather(tiles, reverse, |tile, sink| {
                // A signal, or the time limit once a batch is done, ends the run; the open batch is dropped.
                let over = || {
                    let late = index > 0 && self.max_time.is_some_and(|t| start.elapsed() >= t);
                    late || self.stop.is_some_and(|s| s.load(Ordering::Relaxed))
                };
                let range = tile * TILE..((tile + 1) * TILE).min(pixels);
                if over() || !self.tile(range, first..first + n, &work, &light_on_ray, sink, over) {
                    dropped.store(true, Ordering::Relaxed);
                    return;
                }
                let k = done.fetch_add(1, Ordering::Relaxed) + 1;
                progress(Progress {
                    done: (taken as f64 + n as f64 * k as f64 / tiles as f64) / self.spp as f64,
                    elapsed: start.elapsed(),
                    samples: taken * pixels as u64 + n * (k * pixels / tiles) as u64,
                    error,
                });
            });
            if let Some(r) = &work.rooms {
                self.outward(r, first..first + n, &work.film, &dropped, &mut gradient);
            }
            if let (Some(limbs), Some(swept)) = (&work.limbs, &work.swept) {
                self.limbs(limbs, swept, first..first + n, &work.film, &dropped, &mut gradient);
            }
            if dropped.into_inner() {
                work.film.discard_batch();
                break;
            }
            work.film.end_batch(index as u64, n)?;
            taken += n;
            gradients.push(&mut gradient, n);
            error = relative_error(&work.film);
            if self.target_error.is_some_and(|t| index >= 7 && 4 * taken >= self.spp && error <= t) {
                target_reached = Some(true);
                break;
            }
            let late = self.max_time.is_some_and(|t| start.elapsed() >= t);
            if late || self.stop.is_some_and(|s| s.load(Ordering::Relaxed)) {
                break;
            }
        }
        if taken == 0 {
            return Err(Error::Interrupted);
        }
        drop(gradient);
        let gradient = reverse.then(|| gradients.finish());
        let light_on_ray = light_on_ray.into_inner().unwrap_or(None);
        let Work { rooms, film, .. } = work;
        Ok(Outcome {
            film,
            gradient,
            seconds: start.elapsed().as_secs_f64(),
            complete: taken == self.spp,
            spp: taken,
            target_reached,
            light_on_ray,
            room_seconds: rooms
                .iter()
                .flat_map(|r| r.list.iter().enumerate().map(|(i, room)| (room.name(), r.seconds(i))))
                .collect(),
        })
    }
}

/// Root mean square of the standard errors over the mean of the picture.
fn relative_error(film: &Film) -> f64 {
    let n = film.spec().pixels();
    let (mut variance, mut mean) = (0.0, 0.0);
    for p in 0..n {
        match film.variance_of_mean(0, p) {
            Some(v) => variance += v.mean(),
            None => return f64::NAN,
        }
        mean += film.mean(0, p).mean().abs();
    }
    (variance / n as f64).sqrt() / (mean / n as f64)
}
