//! Pilots: keyed runs before the run, from which come the quanta of the film, the work of rooms, and where they look.

use super::driver::Job;
use super::film::FilmSpec;
use super::rooms::{self, Rooms};
use crate::math::Rgb;
use crate::math::guide::{Guide, Told};
use crate::math::rng::{Purpose, Rng};
use crate::params::{Gauge, ParamSet};
use crate::transport::{self, PathRecord, Sweep, Tally};
use rayon::prelude::*;

/// Paths of the pilot that sets the film's quanta.
const PILOT: u64 = 512;
/// Marks the pilot's keys in streams that it shares with the run.
const PILOT_KEY: u64 = 1 << 63;
/// Marks the keys of samples that guides learn from.
const GUIDE_KEY: u64 = 1 << 62;
/// Samples that a guide learns from, round by round, at most.
const ROUNDS: [u64; 2] = [1 << 13, 1 << 15];
/// All of them over those of the run, at most.
const OF_THE_RUN: f64 = 1.0 / 16.0;

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

    /// Quanta of the layers from the brightest of a keyed pilot (`wide`: of the scene's emission): independent of threads,
    /// crops and modes. One value may be 2.7e8 times that; the resolution is 1.4e-17 of it.
    pub(super) fn quanta(
        &self,
        sweep: Option<&Sweep>,
        rooms: &mut Option<Rooms>,
        borders: bool,
        wide: bool,
    ) -> Vec<i32> {
        let k = self.layers().len();
        let mut sums = vec![0.0f64; k];
        // Over the whole film, so that a crop has the same quanta and the same bits.
        let sensor = &self.scene.sensors[self.sensor];
        let n = PILOT.min((sensor.width * sensor.height) as u64 * 8);
        let mut rec = PathRecord::new();
        let mut rng = Rng::keyed(self.seed, Purpose::Pilot as u64, u64::MAX, 0);
        let (mut interior, mut squares) = (0.0, vec![[0.0; 2]; rooms.as_ref().map_or(0, |r| r.list.len())]);
        let params = self.mode.params();
        for i in 0..n {
            let x = (rng.uniform() * sensor.width as f64) as usize;
            let y = (rng.uniform() * sensor.height as f64) as usize;
            let (state, _) = self.state(Purpose::Pilot, x, y, i);
            let mut tally = Tally::default();
            let value = match (sweep, params) {
                (Some(sweep), Some(p)) => {
                    let mut sink = Gauge::new(p);
                    let d = Rng::keyed(self.seed, Purpose::Pilot as u64, u64::MAX - 1, i);
                    let v = sweep.sample(state, d, &mut rec, &mut sink, &mut tally);
                    interior += square(&sink.forward.image) + finite(sink.take_squares());
                    for (s, d) in sums[1..].iter_mut().zip(&sink.forward.image) {
                        *s = f64::max(*s, finite(d.abs().max()));
                    }
                    v
                }
                _ => transport::sample(self.scene, &self.scene.settings, state, &mut tally),
            };
            sums[0] = sums[0].max(finite(value.abs().max()));
            if let (Some(rooms), Some(p)) = (rooms.as_ref(), params) {
                let mut sink = Gauge::new(p);
                let mut image = vec![Rgb::ZERO; p.len()];
                for room in 0..rooms.list.len() {
                    let mut most = |c: rooms::Contribution, square_sum: &mut f64| {
                        for (_, w) in c.pixels {
                            c.emit(*w, &mut sink);
                            sink.forward.take(&mut image);
                            *square_sum += square(&image) + finite(sink.take_squares());
                            for (s, d) in sums[1..].iter_mut().zip(&image) {
                                *s = f64::max(*s, finite(d.abs().max()));
                            }
                        }
                    };
                    let [along, outward] = &mut squares[room];
                    rooms.along(room, [x, y], PILOT_KEY | i, 0, &mut tally, &mut |c| most(c, along));
                    rooms.outward(room, PILOT_KEY | i, &mut tally, &mut |c| most(c, outward));
                }
            }
        }
        if let Some(rooms) = rooms {
            rooms.set_budget(interior, &squares);
        }
        // Each term may need the whole range.
        let terms = if self.split { 1 + squares.len() + usize::from(borders) } else { 0 };
        for _ in 0..terms {
            sums.extend_from_within(1..k);
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
