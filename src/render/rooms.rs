//! Boundary rooms at work: their samples, weighed and filtered, become contributions to pixels.
//!
//! Two passes a room: along the camera rays of every pixel, and outward from its sheets onto the whole film. Both are keyed like
//! everything else, so threads, crops and batches change no bit. A contribution is worth a batch's share of one sample a pixel: the
//! film divides by the samples taken.

use super::filter;
use crate::error::Result;
use crate::math::Rgb;
use crate::math::guide::{Guide, Numbers};
use crate::math::rng::{Purpose, Rng};
use crate::params::{ParamSet, Sink, Slot};
use crate::scene::parts::Filter;
use crate::scene::{Around, Scene};
use crate::sensor::Sensor;
use crate::term::{Context, EdgeForm, Motion, ROOMS, Room, Sample, frosted, rooms};
use crate::transport::Tally;
use smallvec::SmallVec;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Samples of a room's pass for one sample of the picture: the least, where they cost [`USUAL`] (as `√cost`, like the best), and the most.
const RATE: (f64, f64) = (1.0 / 8.0, 4.0);
/// What a sample costs over one of the interior: often, and at least (what asks nothing of the scene takes its time as well).
const USUAL: f64 = 0.5;
const LEAST: f64 = 0.02;
/// The interior takes longer than what is counted for it says.
const ASKED: f64 = 0.85;
/// What all rooms together may cost at most, in paths, and any that has too much of the variance.
const TOTAL: f64 = 1.7;
/// What a room may have of the variance, over all else: not quite half of the whole.
const SHARE: f64 = 0.95;
/// Outward samples of one work item.
pub const BLOCK: u64 = 2048;

/// What a pilot told of one kind of samples: sums of their squares (of a pixel's derivative), of the squares of these, and of their work.
#[derive(Clone, Copy, Debug, Default)]
pub struct Told {
    square: f64,
    fourth: f64,
    work: u64,
}

impl Told {
    /// One sample.
    pub fn one(square: f64, work: u64) -> Told {
        Told { square, fourth: square * square, work }
    }

    pub fn add(&mut self, other: &Told) {
        self.square += other.square;
        self.fourth += other.fourth;
        self.work += other.work;
    }

    /// The sum of squares and its standard error: where they have a heavy tail, most pilots see too little of it.
    fn cautious(&self) -> f64 {
        self.square + self.fourth.sqrt()
    }
}

/// A number for each of a room's passes: along camera rays, outward.
pub type Pass = [f64; 2];

/// The rooms of a run.
pub struct Rooms<'a> {
    scene: &'a Scene,
    sensor: &'a Sensor,
    /// Its number, which keys the outward streams.
    index: usize,
    around: Around,
    filter: Filter,
    even: bool,
    frosted: Vec<u32>,
    seed: u64,
    pub list: Vec<Box<dyn Room>>,
    /// Camera rays a pixel for one sample of the picture (on average), and outward samples over the whole film, of each room.
    along: Vec<f64>,
    outward: Vec<u64>,
    /// Densities of the numbers that outward samples begin with.
    guides: Vec<Option<Guide>>,
    nanoseconds: Vec<AtomicU64>,
    motion: Arc<Motion>,
}

/// What a sample adds to pixels: to each its weight, times every partial of the sample.
pub struct Contribution<'a> {
    pub sample: &'a Sample<'a>,
    pub pixels: &'a [([usize; 2], Rgb)],
}

impl Contribution<'_> {
    /// Each slot that the sample depends on, with its partial.
    pub fn partials(&self) -> impl Iterator<Item = (Slot, f64)> + '_ {
        self.sample.partials.iter().flat_map(|p| (0..p.len).map(|k| (p.slot + k as Slot, p.v[k as usize])))
    }

    /// One pixel's share.
    pub fn emit(&self, weight: Rgb, sink: &mut impl Sink) {
        self.partials().for_each(|(slot, v)| sink.add(slot, weight * v));
    }

    /// Partials by parameter, onto zeros of their number.
    pub fn contract(&self, params: &ParamSet, out: &mut [f64]) {
        for (slot, v) in self.partials() {
            out.iter_mut().zip(params.tangents(slot)).for_each(|(o, t)| *o += v * t);
        }
    }
}

/// Samples of each pass for one of the picture. With rate r a pass has the variance `v / r` and costs `c r`, beside 1 for the interior, so that the least variance x cost is at
/// `r = √(v / (interior c))`; less where all together would cost too much, and never so little that a pilot which missed something could ruin the run. At the least
/// variance x cost a pass has the share of the variance that it has of the cost; a room that would have too much of it ([`SHARE`]) gets more, within [`TOTAL`] for itself.
fn rates(interior: &Told, variances: &[Pass], costs: &[Pass]) -> Vec<Pass> {
    let (interior, seen) = (interior.cautious(), interior.square);
    // Nothing to weigh them against: rooms alone are asked for.
    if interior == 0.0 {
        return vec![[1.0; 2]; costs.len()];
    }
    let best = |v: f64, cost: f64| {
        let r = (v / (interior * cost)).sqrt();
        if r.is_finite() { r } else { 1.0 }
    };
    let pass = |(v, c): (&Pass, &Pass)| [best(v[0], c[0]), best(v[1], c[1])];
    let rates: Vec<Pass> = variances.iter().zip(costs).map(pass).collect();
    let cost: f64 = rates.iter().zip(costs).map(|(r, c)| r[0] * c[0] + r[1] * c[1]).sum();
    let scale = (TOTAL / cost).min(1.0);
    let within = |r: f64, cost: f64| (r * scale).clamp(RATE.0 * (USUAL / cost).sqrt(), RATE.1);
    let pass = |(r, c): (&Pass, &Pass)| [within(r[0], c[0]), within(r[1], c[1])];
    let mut rates: Vec<Pass> = rates.iter().zip(costs).map(pass).collect();
    let share = |(v, r): (&Pass, &Pass)| v[0] / r[0] + v[1] / r[1];
    let shares: Vec<f64> = variances.iter().zip(&rates).map(share).collect();
    let total = seen + shares.iter().sum::<f64>();
    for ((r, c), share) in rates.iter_mut().zip(costs).zip(shares) {
        let more = (share / (SHARE * (total - share))).min(TOTAL / (r[0] * c[0] + r[1] * c[1]));
        if more > 1.0 {
            *r = r.map(|r| (r * more).min(RATE.1));
        }
    }
    rates
}

impl<'a> Rooms<'a> {
    pub fn new(
        scene: &'a Scene,
        sensor: usize,
        crop: [usize; 4],
        seed: u64,
        params: &ParamSet,
        motion: &Arc<Motion>,
        form: EdgeForm,
        wanted: impl Fn(&str) -> bool,
    ) -> Result<Rooms<'a>> {
        let (index, sensor) = (sensor, &scene.sensors[sensor]);
        let filter = scene.films[index].part.filter;
        motion.check(scene, sensor, params, crop, filter::radius(filter))?;
        let around = scene.around(Some(sensor));
        let list = rooms(scene, sensor, filter::radius(filter), motion, form, wanted);
        let nanoseconds = list.iter().map(|_| AtomicU64::new(0)).collect();
        let guides = list.iter().map(|_| None).collect();
        let along = vec![1.0; list.len()];
        let pixels = (sensor.width * sensor.height) as u64;
        let outward = list.iter().map(|r| if r.has_outward() { pixels } else { 0 }).collect();
        Ok(Rooms {
            scene,
            sensor,
            index,
            around,
            filter,
            even: scene.films[index].even,
            frosted: frosted::list(scene),
            seed,
            list,
            along,
            outward,
            guides,
            nanoseconds,
            motion: motion.clone(),
        })
    }

    /// Share out the work, by variances and costs. `interior`, `passes`: of samples of a keyed pilot.
    pub fn set_budget(&mut self, interior: Told, passes: &[[Told; 2]]) {
        let pixels = (self.sensor.width * self.sensor.height) as f64;
        let cost = |p: &Told| (ASKED * p.work as f64 / interior.work.max(1) as f64).max(LEAST);
        let squares: Vec<Pass> = passes.iter().map(|p| p.each_ref().map(|p| p.square)).collect();
        let costs: Vec<Pass> = passes.iter().map(|p| p.each_ref().map(cost)).collect();
        for (k, [along, outward]) in rates(&interior, &squares, &costs).into_iter().enumerate() {
            self.along[k] = along;
            self.outward[k] = if self.list[k].has_outward() { (outward * pixels).ceil() as u64 } else { 0 };
        }
    }

    pub fn set_guide(&mut self, room: usize, guide: Guide) {
        self.guides[room] = Some(guide);
    }

    /// Outward samples of a room for one sample of the picture.
    pub fn outward_samples(&self, room: usize) -> u64 {
        self.outward[room]
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// Seconds spent in a room, over all threads.
    pub fn seconds(&self, room: usize) -> f64 {
        self.nanoseconds[room].load(Ordering::Relaxed) as f64 * 1e-9
    }

    fn context(&self) -> Context<'_> {
        Context {
            scene: self.scene,
            set: &self.scene.settings,
            sensor: self.sensor,
            around: self.around,
            margin: filter::radius(self.filter),
            moving: &self.motion.moving,
            frosted: &self.frosted,
            tally: Tally::default(),
        }
    }

    /// By the room itself, whichever others run.
    fn purpose(&self, room: usize, outward: bool) -> u64 {
        let name = self.list[room].name();
        let number = ROOMS.iter().position(|n| *n == name).unwrap_or(ROOMS.len()) as u64;
        Purpose::Room as u64 + 2 * number + u64::from(outward)
    }

    /// The camera rays of a pixel for one sample of the picture.
    pub fn along(
        &self,
        room: usize,
        pixel: [usize; 2],
        key: u64,
        sample: u64,
        tally: &mut Tally,
        f: &mut dyn FnMut(Contribution),
    ) {
        let start = Instant::now();
        // Fractions add up over the samples from a random start: right on average, and even.
        let start_at = Rng::keyed(self.seed, self.purpose(room, false), key, u64::MAX).uniform();
        let until = |s: u64| (s as f64 * self.along[room] + start_at).floor();
        // Rays are numbered without gaps.
        for ray in until(sample) as u64..until(sample + 1) as u64 {
            let mut rng = Rng::of(self.even, self.seed, self.purpose(room, false), key, ray);
            self.camera_ray(room, pixel, &mut rng, tally, f);
        }
        self.nanoseconds[room].fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }

    fn camera_ray(
        &self,
        room: usize,
        [x, y]: [usize; 2],
        rng: &mut Rng,
        tally: &mut Tally,
        f: &mut dyn FnMut(Contribution),
    ) {
        let mut cx = self.context();
        let offset = [filter::sample(self.filter, rng), filter::sample(self.filter, rng)];
        let film = [x as f64 + 0.5 + offset[0], y as f64 + 0.5 + offset[1]];
        let w = filter::density(self.filter, offset[0]) * filter::density(self.filter, offset[1]);
        self.list[room].along(&mut cx, film, rng, &mut |s| {
            let weight = s.flux * s.weigh(w, self.along[room], self.outward[room] as f64);
            f(Contribution { sample: s, pixels: &[([x, y], weight)] });
        });
        *tally = tally.plus(&cx.tally);
    }

    /// One outward sample, onto all pixels that its film points concern. Returns the numbers that it began with, and their density.
    pub fn outward(
        &self,
        room: usize,
        sample: u64,
        tally: &mut Tally,
        f: &mut dyn FnMut(Contribution),
    ) -> (Numbers, f64) {
        let mut cx = self.context();
        let mut rng = Rng::of(self.even, self.seed, self.purpose(room, true), self.index as u64, sample);
        let size = [self.sensor.width, self.sensor.height];
        let u = std::array::from_fn(|_| rng.uniform());
        let (lead, density) = self.guides[room].as_ref().map_or((u, 1.0), |g| g.warp(u));
        let mut pixels: SmallVec<[_; 16]> = SmallVec::new();
        self.list[room].outward(&mut cx, &lead, &mut rng, &mut |s| {
            pixels.clear();
            for pixel in filter::pixels(self.filter, s.film, size) {
                let offset = |k: usize| s.film[k] - (pixel[k] as f64 + 0.5);
                let w = filter::density(self.filter, offset(0)) * filter::density(self.filter, offset(1));
                if w > 0.0 {
                    let weight = s.flux * (s.weigh(w, self.along[room], self.outward[room] as f64) / density);
                    pixels.push((pixel, weight));
                }
            }
            if !pixels.is_empty() {
                f(Contribution { sample: s, pixels: &pixels });
            }
        });
        *tally = tally.plus(&cx.tally);
        (lead, density)
    }

    /// Time spent elsewhere for a room.
    pub fn add_time(&self, room: usize, start: Instant) {
        self.nanoseconds[room].fetch_add(start.elapsed().as_nanos() as u64, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-12 * b
    }

    /// Dear passes get less, by the root of what they cost; so do their least rates; all together stay within their budget.
    #[test]
    fn rates_follow_variance_and_cost() {
        // A pilot without a tail.
        let rates = |interior: f64, v: &[Pass], c: &[Pass]| rates(&Told { square: interior, ..Told::default() }, v, c);
        let (cheap, dear) = ([0.3, USUAL], [1.2, USUAL]);
        let r = rates(1.0, &[[0.04, 0.09], [0.04, 0.09]], &[cheap, dear]);
        assert!(close(r[0][0], 0.2 / 0.3f64.sqrt()) && close(r[0][1], 0.3 / USUAL.sqrt()), "{r:?}");
        assert!(close(r[1][0], r[0][0] / 2.0) && r[1][1] == r[0][1], "{r:?}");
        let none = rates(1.0, &[[0.0; 2]; 2], &[[USUAL; 2], [4.0 * USUAL, USUAL]]);
        assert!(none[0] == [RATE.0; 2] && close(none[1][0], RATE.0 / 2.0) && none[1][1] == RATE.0, "{none:?}");
        let much = rates(1.0, &[[50.0, 1.0]; 3], &[cheap; 3]);
        let cost: f64 = much.iter().map(|r| r[0] * cheap[0] + r[1] * cheap[1]).sum();
        assert!(close(cost, TOTAL) && much[0][0] > 5.0 * much[0][1], "{much:?}");
        // Of the least variance x cost it would have 1.6 times the interior's variance.
        let [one] = rates(1.0, &[[2.56, 0.0]], &[[1.0, 0.1]])[..] else { panic!() };
        assert!(close(one[0] + 0.1 * one[1], TOTAL), "{one:?}");
        let [one] = rates(1.0, &[[0.4, 0.4]], &[[0.5, 1.2]])[..] else { panic!() };
        assert!(close(0.4 / one[0] + 0.4 / one[1], SHARE), "{one:?}");
        // A room is all there is to see.
        let [one] = rates(1e-30, &[[1.0, 0.0]], &[[2.0, 1.0]])[..] else { panic!() };
        assert!(2.0 * one[0] + one[1] <= TOTAL * 1.2, "{one:?}");
        assert_eq!(rates(0.0, &[[1.0, 0.0]; 2], &[[50.0; 2]; 2]), [[1.0; 2]; 2]);
    }
}
