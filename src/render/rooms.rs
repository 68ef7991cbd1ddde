//! Boundary rooms at work: their samples, weighed and filtered, become contributions to pixels.
//!
//! Two passes a room: along the camera rays of every pixel, and outward from its sheets onto the whole film. Both are keyed like
//! everything else, so threads, crops and batches change no bit. A contribution is worth a batch's share of one sample a pixel: the
//! film divides by the samples taken.

use super::filter;
use crate::math::Rgb;
use crate::math::rng::{Purpose, Rng};
use crate::params::{ParamSet, Sink, Slot};
use crate::scene::Scene;
use crate::scene::parts::Filter;
use crate::sensor::Sensor;
use crate::term::{Context, Motion, Room, Sample, rooms};
use crate::transport::Tally;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Outward samples a pixel and sample of the picture.
const OUTWARD: f64 = 1.0;
/// Outward samples of one work item.
pub const BLOCK: u64 = 2048;

/// The rooms of a run.
pub struct Rooms<'a> {
    scene: &'a Scene,
    sensor: &'a Sensor,
    filter: Filter,
    seed: u64,
    pub list: Vec<Box<dyn Room>>,
    /// Outward samples for one sample a pixel, over the whole film.
    pub outward: u64,
    nanoseconds: Vec<AtomicU64>,
}

/// A contribution to one pixel, to be multiplied by each of the partials.
pub struct Contribution<'a> {
    pub pixel: [usize; 2],
    pub weight: Rgb,
    pub sample: &'a Sample<'a>,
}

impl Contribution<'_> {
    pub fn emit(&self, sink: &mut impl Sink) {
        for p in self.sample.partials {
            for k in 0..p.len {
                sink.add(p.slot + k as Slot, self.weight * p.v[k as usize]);
            }
        }
    }
}

impl<'a> Rooms<'a> {
    pub fn new(
        scene: &'a Scene,
        sensor: usize,
        seed: u64,
        params: &ParamSet,
        wanted: impl Fn(&str) -> bool,
    ) -> Rooms<'a> {
        let motion = Motion::new(scene, params);
        let filter = scene.films[sensor].part.filter;
        let sensor = &scene.sensors[sensor];
        let list = rooms(scene, sensor, &motion, wanted);
        let outward = (OUTWARD * (sensor.width * sensor.height) as f64).ceil() as u64;
        let nanoseconds = list.iter().map(|_| AtomicU64::new(0)).collect();
        Rooms { scene, sensor, filter, seed, list, outward, nanoseconds }
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Seconds spent in a room, over all threads.
    pub fn seconds(&self, room: usize) -> f64 {
        self.nanoseconds[room].load(Ordering::Relaxed) as f64 * 1e-9
    }

    fn context(&self) -> Context<'a> {
        Context {
            scene: self.scene,
            set: &self.scene.settings,
            sensor: self.sensor,
            margin: filter::radius(self.filter),
            tally: Tally::default(),
        }
    }

    fn purpose(room: usize, outward: bool) -> u64 {
        Purpose::Room as u64 + 2 * room as u64 + u64::from(outward)
    }

    /// One camera ray of a pixel.
    pub fn along(
        &self,
        room: usize,
        [x, y]: [usize; 2],
        key: u64,
        sample: u64,
        tally: &mut Tally,
        f: &mut dyn FnMut(Contribution),
    ) {
        let start = Instant::now();
        let mut cx = self.context();
        let mut rng = Rng::keyed(self.seed, Self::purpose(room, false), key, sample);
        let offset = [filter::sample(self.filter, &mut rng), filter::sample(self.filter, &mut rng)];
        let film = [x as f64 + 0.5 + offset[0], y as f64 + 0.5 + offset[1]];
        let w = filter::density(self.filter, offset[0]) * filter::density(self.filter, offset[1]);
        self.list[room].along(&mut cx, film, &mut rng, &mut |s| {
            let weight = s.flux * s.weigh(w, 1.0, self.outward as f64);
            f(Contribution { pixel: [x, y], weight, sample: s });
        });
        *tally = tally.plus(&cx.tally);
        self.nanoseconds[room].fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }

    /// One outward sample, onto all pixels that its film points concern.
    pub fn outward(&self, room: usize, sample: u64, tally: &mut Tally, f: &mut dyn FnMut(Contribution)) {
        let mut cx = self.context();
        let mut rng = Rng::keyed(self.seed, Self::purpose(room, true), 0, sample);
        let (radius, size) = (cx.margin, [self.sensor.width, self.sensor.height]);
        self.list[room].outward(&mut cx, &mut rng, &mut |s| {
            // Pixels x with |film - (x + 1/2)| <= radius.
            let range = |k: usize| {
                let lo = (s.film[k] - 0.5 - radius).ceil().max(0.0) as usize;
                let hi = (s.film[k] - 0.5 + radius).floor();
                lo..(if hi < 0.0 { 0 } else { hi as usize + 1 }).min(size[k])
            };
            for y in range(1) {
                let wy = filter::density(self.filter, s.film[1] - (y as f64 + 0.5));
                for x in range(0) {
                    let w = wy * filter::density(self.filter, s.film[0] - (x as f64 + 0.5));
                    if w > 0.0 {
                        let weight = s.flux * s.weigh(w, 1.0, self.outward as f64);
                        f(Contribution { pixel: [x, y], weight, sample: s });
                    }
                }
            }
        });
        *tally = tally.plus(&cx.tally);
    }

    /// Time spent elsewhere for a room.
    pub fn add_time(&self, room: usize, start: Instant) {
        self.nanoseconds[room].fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }
}
