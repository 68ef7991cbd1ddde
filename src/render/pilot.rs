//! Pilots: keyed runs before the run, from which come the quanta of the film, the work of rooms, and where they look.

use super::driver::Job;
use super::film::FilmSpec;
use super::rooms::{self, Rooms};
use crate::math::Rgb;
use crate::math::guide::{Guide, Told};
use crate::math::rng::{Purpose, Rng};
use crate::params::{Gauge, ParamSet};
use crate::scene::effort;
use crate::transport::{self, PathRecord, Sweep, Tally};
use rayon::prelude::*;

/// Paths of the pilot that sets the film's quanta and the work of rooms, at least (but for tiny films) and at most; between them one of so many of the run's,
/// whose size is the full film's: a crop has the same bits.
const PILOT: [u64; 2] = [512, 1024];
const OF_THE_PILOT: u64 = 64;
/// Marks the pilot's keys in streams that it shares with the run.
const PILOT_KEY: u64 = 1 << 63;
/// Marks the keys of samples that guides learn from.
const GUIDE_KEY: u64 = 1 << 62;
/// Samples that a guide learns from, round by round, at most.
const ROUNDS: [u64; 2] = [1 << 13, 1 << 15];
/// All of them over those of the run, at most.
const OF_THE_RUN: f64 = 1.0 / 24.0;

/// What one sample of the pilot tells.
struct PilotSample {
    /// Of each layer.
    brightest: Vec<f64>,
    interior: rooms::Told,
    passes: Vec<[rooms::Told; 2]>,
}

impl Job<'_> {
    /// Learn where the samples of rooms are large: uniform ones first, then guided ones. Nothing depends on threads, crops or modes.
    pub(super) fn guide(&self, rooms: &mut Rooms, params: &ParamSet) {
        let sensor = &self.scene.sensors[self.sensor];
        let run = (sensor.width * sensor.height) as f64 * self.spp as f64;
        let scale = (run * OF_THE_RUN / ROUNDS.iter().sum::<u64>() as f64).min(1.0);
        for room in (0..rooms.list.len()).filter(|&r| rooms.list[r].guided_numbers() > 0).collect::<Vec<_>>() {
            let (mut told, mut next) = (Vec::new(), 0);
            for n in ROUNDS.map(|n| (n as f64 * scale) as u64) {
                let one = |i: u64| {
                    let mut sink = Gauge::new(params);
                    let mut image = vec![Rgb::ZERO; params.len()];
                    let mut sum = 0.0;
                    let (at, density) = rooms.outward(room, GUIDE_KEY | i, &mut Tally::default(), &mut |c| {
                        for (_, w) in c.pixels {
                            c.emit(*w, &mut sink);
                            sink.forward.take(&mut image);
                            sum += square(&image) + finite(sink.take_squares());
                        }
                    });
                    Told { at, square: sum, density }
                };
                told.par_extend((next..next + n).into_par_iter().map(one));
                next += n;
                rooms.set_guide(room, Guide::learn(rooms.list[room].guided_numbers(), told.clone()));
            }
        }
    }

    /// One sample of the pilot: a path with its derivative, and each pass of the rooms.
    fn pilot(&self, sweep: Option<&Sweep>, rooms: Option<&Rooms>, rec: &mut PathRecord, i: u64) -> PilotSample {
        let sensor = &self.scene.sensors[self.sensor];
        let mut told = PilotSample {
            brightest: vec![0.0; self.layers().len()],
            interior: rooms::Told::default(),
            passes: vec![Default::default(); rooms.map_or(0, |r| r.list.len())],
        };
        let mut rng = Rng::keyed(self.seed, Purpose::Pilot as u64, u64::MAX, i);
        let x = (rng.uniform() * sensor.width as f64) as usize;
        let y = (rng.uniform() * sensor.height as f64) as usize;
        let (begin, _) = self.beginning(Purpose::Pilot, x, y, i);
        let mut tally = Tally::default();
        let brightest = |told: &mut [f64], image: &[Rgb]| {
            told.iter_mut().zip(image).for_each(|(s, d)| *s = s.max(finite(d.abs().max())));
        };
        let params = self.mode.params();
        let ((value, work), squared) = match (sweep, params) {
            (Some(sweep), Some(p)) => {
                let mut sink = Gauge::new(p);
                let d = Rng::keyed(self.seed, Purpose::Pilot as u64, u64::MAX - 1, i);
                let found = effort::of(|| sweep.sample(&begin, d, rec, &mut sink, &mut tally));
                brightest(&mut told.brightest[1..], &sink.forward.image);
                (found, square(&sink.forward.image) + finite(sink.take_squares()))
            }
            _ => (effort::of(|| transport::sample(self.scene, &self.scene.settings, &begin, &mut tally)), 0.0),
        };
        told.interior = rooms::Told::one(squared, work);
        brightest(&mut told.brightest[..1], &[value]);
        let (Some(rooms), Some(p)) = (rooms, params) else { return told };
        let mut sink = Gauge::new(p);
        let mut image = vec![Rgb::ZERO; p.len()];
        let key = PILOT_KEY | i;
        for (room, passes) in told.passes.iter_mut().enumerate() {
            for (pass, is_outward) in passes.iter_mut().zip([false, true]) {
                let mut sum = 0.0;
                let mut add = |c: rooms::Contribution| {
                    for (_, w) in c.pixels {
                        c.emit(*w, &mut sink);
                        sink.forward.take(&mut image);
                        sum += square(&image) + finite(sink.take_squares());
                        brightest(&mut told.brightest[1..], &image);
                    }
                };
                let ((), work) = effort::of(|| match is_outward {
                    false => rooms.along(room, [x, y], key, 0, &mut tally, &mut add),
                    true => _ = rooms.outward(room, key, &mut tally, &mut add),
                });
                *pass = rooms::Told::one(sum, work);
            }
        }
        told
    }

    /// Quanta of the layers from the brightest of a keyed pilot (`wide`: of the scene's emission): independent of threads,
    /// crops and modes. One value may be 2.7e8 times that; the resolution is 1.4e-17 of it.
    pub(super) fn quanta(
        &self,
        sweep: Option<&Sweep>,
        rooms: &mut Option<Rooms>,
        borders: bool,
        wide: bool,
    ) -> Vec<i32> {
        let sensor = &self.scene.sensors[self.sensor];
        // Over the whole film, so that a crop has the same quanta and the same bits.
        let pixels = (sensor.width * sensor.height) as u64;
        let n = (pixels.saturating_mul(self.spp) / OF_THE_PILOT).clamp(PILOT[0], PILOT[1]).min(8 * pixels);
        let told: Vec<PilotSample> = {
            let rooms = rooms.as_ref();
            (0..n).into_par_iter().map_init(PathRecord::new, |rec, i| self.pilot(sweep, rooms, rec, i)).collect()
        };
        let mut sums = vec![0.0f64; self.layers().len()];
        let mut interior = rooms::Told::default();
        let mut passes = vec![[interior; 2]; rooms.as_ref().map_or(0, |r| r.list.len())];
        // In order, so that nothing depends on threads.
        for t in &told {
            sums.iter_mut().zip(&t.brightest).for_each(|(s, b)| *s = s.max(*b));
            interior.add(&t.interior);
            for (sum, pass) in passes.iter_mut().flatten().zip(t.passes.iter().flatten()) {
                sum.add(pass);
            }
        }
        if let Some(rooms) = rooms {
            rooms.set_budget(interior, &passes);
        }
        // Each term may need the whole range.
        let terms = if self.split { 1 + passes.len() + usize::from(borders) } else { 0 };
        for _ in 0..terms {
            sums.extend_from_within(1..self.layers().len());
        }
        // What the pilot did not meet is taken to be of the size of the brightest emission.
        let brightest = self.scene.brightest();
        sums.iter()
            .map(|&s| FilmSpec::quantum_for(if s > 0.0 && !wide { s } else { brightest.max(s) } / 1024.0))
            .collect()
    }
}

fn square(image: &[Rgb]) -> f64 {
    image.iter().map(|d| finite(d.dot(*d))).sum()
}

fn finite(x: f64) -> f64 {
    if x.is_finite() { x } else { 0.0 }
}
