//! The film: sums per pixel, layer and channel that do not depend on the order of their terms.
//!
//! Values are rounded once, to integers of a power-of-two quantum per layer, and added as integers. Integer sums commute, so
//! any thread count, any order and any distribution of whole batches among shards give the same bits.
//!
//! With S_b the sum and n_b the samples per pixel of batch b, B batches, N = sum n_b:
//!
//! - mean: m = (sum S_b) / N;
//! - variance of the mean: s^2 / N with s^2 = (sum S_b^2 / n_b - N m^2) / (B - 1). It is unbiased when batches are independent
//!   and S_b has mean n_b mu and variance n_b s^2; for equal n_b it is the textbook variance of batch means over B.
//!
//! Every S_b^2 / n_b is rounded to an integer of quantum^2 by itself, so its sum is order-free as well.
//! Memory: 12 bytes (current) + 12 (total) + 24 (squares) = 48 per pixel, layer and channel.

use std::sync::atomic::{AtomicI32, AtomicU32, AtomicU64, Ordering};

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::math::Rgb;
use crate::render::health::{Health, Mishap};

/// A single value must be below 2^84 quanta; a sum below 2^94.
const VALUE_LIMIT: f64 = (1u128 << 84) as f64;
/// |high word| of a sum where the range is nearly used up. One value changes it by at most 2^20: the wrap at 2^31 is never reached unseen.
const HIGH_LIMIT: u32 = 1 << 30;
/// Quantum exponents lie in +-400, so that their squares are ordinary f64.
const EXPONENTS: std::ops::RangeInclusive<i32> = -400..=400;
/// A layer's typical value is 2^46 quanta: resolution 1.4e-14 of it, values up to 2.7e11 times it.
const TYPICAL_BITS: i32 = 46;

/// What two films must share to be merged.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FilmSpec {
    pub width: usize,
    pub height: usize,
    /// Layer 0 is the picture; then `d_<param>`, then `d_<param>.<term>`.
    pub layers: Vec<String>,
    /// Per layer: value = integer * 2^quantum.
    pub quantum: Vec<i32>,
}

impl FilmSpec {
    /// The quantum for a layer whose values are typically of this size (from a keyed pilot, so that shards agree).
    /// Zero or non-finite: as for 1.
    pub fn quantum_for(typical: f64) -> i32 {
        let exponent = if typical.is_finite() && typical != 0.0 { typical.abs().log2().floor() as i32 } else { 0 };
        (exponent - TYPICAL_BITS).clamp(*EXPONENTS.start(), *EXPONENTS.end())
    }

    pub fn pixels(&self) -> usize {
        self.width * self.height
    }
}

/// A finished batch: its place in the run and its samples per pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct Batch {
    pub index: u64,
    pub samples: u64,
}

/// How a run's samples are cut into batches: 32 nearly equal ones, or one a sample below 32. `(first sample, samples)` of each.
pub fn batch_ranges(spp: u64) -> Vec<(u64, u64)> {
    let n = spp.min(32);
    (0..n).map(|b| (b * spp / n, (b + 1) * spp / n - b * spp / n)).collect()
}

/// The same for a run whose time is limited: a batch takes a quarter of the samples before it at most, so that the one which time runs out on, and which is dropped, is no great loss.
pub fn graded_ranges(spp: u64) -> Vec<(u64, u64)> {
    let (most, mut first, mut list) = ((spp / 32).max(1), 0, Vec::new());
    while first < spp {
        let n = (first / 4).clamp(1, most).min(spp - first);
        list.push((first, n));
        first += n;
    }
    list
}

#[derive(Debug)]
pub struct Film {
    spec: FilmSpec,
    /// 2^-quantum per layer.
    scale: Vec<f64>,
    /// 96-bit sums of the batch in progress; cell = (layer * pixels + pixel) * 3 + channel.
    current_low: Vec<AtomicU64>,
    current_high: Vec<AtomicI32>,
    /// 96-bit sums of the finished batches.
    pub(super) total_low: Vec<u64>,
    pub(super) total_high: Vec<i32>,
    /// 192-bit sums of S_b^2 / n_b.
    pub(super) squares: Vec<[u64; 3]>,
    /// Values rejected and sums out of range, per pixel.
    pub(super) rejected: Vec<AtomicU32>,
    /// Finished batches, sorted by index.
    pub(super) batches: Vec<Batch>,
    /// Counters of the whole run: the film adds its own rejections.
    pub health: Health,
}

impl Film {
    /// Panics where [`Film::try_new`] fails: a mistake of the caller.
    pub fn new(spec: FilmSpec) -> Self {
        Self::try_new(spec).unwrap_or_else(|e| panic!("{e}"))
    }

    /// An empty film; an error where the spec contradicts itself.
    pub fn try_new(spec: FilmSpec) -> Result<Self> {
        if spec.layers.len() != spec.quantum.len() || spec.quantum.iter().any(|q| !EXPONENTS.contains(q)) {
            return Err(Error::Runtime("a film needs one quantum a layer, of exponent -400 to 400".into()));
        }
        let cells = spec.layers.len() * spec.pixels() * 3;
        Ok(Film {
            scale: spec.quantum.iter().map(|&q| power_of_two(-q)).collect(),
            current_low: (0..cells).map(|_| AtomicU64::new(0)).collect(),
            current_high: (0..cells).map(|_| AtomicI32::new(0)).collect(),
            total_low: vec![0; cells],
            total_high: vec![0; cells],
            squares: vec![[0; 3]; cells],
            rejected: (0..spec.pixels()).map(|_| AtomicU32::new(0)).collect(),
            batches: Vec::new(),
            health: Health::new(),
            spec,
        })
    }

    pub fn spec(&self) -> &FilmSpec {
        &self.spec
    }

    /// Index of a layer by name.
    pub fn layer(&self, name: &str) -> Option<usize> {
        self.spec.layers.iter().position(|l| l == name)
    }

    /// Add to the batch in progress: a sample, or a sum of samples of this batch. From any thread, at any pixel.
    /// Rounded to the nearest quantum. A non-finite or too large value is left out whole (all channels) and counted; returns whether it was taken.
    pub fn add(&self, pixel: usize, layer: usize, value: Rgb) -> bool {
        if !value.is_finite() {
            return self.reject(pixel, Mishap::RejectedNonfinite);
        }
        let scaled = value * self.scale[layer];
        if scaled.abs().max() >= VALUE_LIMIT {
            return self.reject(pixel, Mishap::Overflow);
        }
        let cell = (layer * self.spec.pixels() + pixel) * 3;
        for c in 0..3 {
            let integer = to_integer(scaled[c]);
            if integer == 0 && scaled[c] != 0.0 {
                self.health.count(Mishap::BelowQuantum);
            }
            self.add_integer(cell + c, integer, pixel);
        }
        true
    }

    /// Add in two words: low with carry, then high. Each word's sum is exact modulo its size, and so is the number of carries, in any order.
    fn add_integer(&self, cell: usize, value: i128, pixel: usize) {
        if value == 0 {
            return;
        }
        let (low, mut high) = (value as u64, (value >> 64) as i32);
        let old = self.current_low[cell].fetch_add(low, Ordering::Relaxed);
        high += old.checked_add(low).is_none() as i32;
        if high != 0 {
            let old = self.current_high[cell].fetch_add(high, Ordering::Relaxed);
            if old.wrapping_add(high).unsigned_abs() >= HIGH_LIMIT {
                self.reject(pixel, Mishap::SumOverflow);
            }
        }
    }

    /// Count a sample that the caller leaves out because it is not a number.
    pub fn reject_sample(&self, pixel: usize) {
        self.reject(pixel, Mishap::RejectedNonfinite);
    }

    fn reject(&self, pixel: usize, kind: Mishap) -> bool {
        self.health.count(kind);
        self.rejected[pixel].fetch_add(1, Ordering::Relaxed);
        false
    }

    /// Forget the batch in progress: what was added since the last `end_batch`. Counters of health stay.
    pub fn discard_batch(&mut self) {
        self.current_low.iter_mut().for_each(|x| *x.get_mut() = 0);
        self.current_high.iter_mut().for_each(|x| *x.get_mut() = 0);
    }

    /// Close the batch in progress under its index in the run. All `add` calls of the batch must have returned.
    pub fn end_batch(&mut self, index: u64, samples_per_pixel: u64) -> Result<()> {
        if samples_per_pixel == 0 {
            return Err(Error::Runtime(format!("batch {index} has no samples")));
        }
        self.insert_batch(Batch { index, samples: samples_per_pixel })?;
        let pixels = self.spec.pixels();
        let (health, rejected) = (&self.health, &self.rejected);
        let totals = self.total_low.par_iter_mut().zip(&mut self.total_high);
        let currents = self.current_low.par_iter_mut().zip(&mut self.current_high);
        let cells = currents.zip(totals).zip(&mut self.squares).enumerate();
        cells.with_min_len(4096).for_each(|(cell, (((low, high), (total_low, total_high)), squares))| {
            let sum = join(*low.get_mut(), *high.get_mut());
            if sum == 0 {
                return;
            }
            (*low.get_mut(), *high.get_mut()) = (0, 0);
            let square = square_over(sum.unsigned_abs(), samples_per_pixel);
            if !accumulate((total_low, total_high, squares), sum, square) {
                health.count(Mishap::SumOverflow);
                rejected[cell / 3 % pixels].fetch_add(1, Ordering::Relaxed);
            }
        });
        Ok(())
    }

    fn insert_batch(&mut self, batch: Batch) -> Result<()> {
        match self.batches.binary_search_by_key(&batch.index, |b| b.index) {
            Ok(_) => Err(Error::Mismatch {
                what: format!("batch {} is present already", batch.index),
                remedy: "give every part once; shards must have different numbers".into(),
            }),
            Err(place) => {
                self.batches.insert(place, batch);
                Ok(())
            }
        }
    }

    /// Add the batches of another film, finished and in progress: disjoint batches of one run. On error nothing is changed.
    pub fn merge(&mut self, other: &Film) -> Result<()> {
        if self.spec != other.spec {
            return Err(Error::Mismatch {
                what: "the films differ in size, layers or quanta".into(),
                remedy: "merge parts of one run only: same scene, parameters, terms and seed".into(),
            });
        }
        let before = self.batches.clone();
        for &batch in &other.batches {
            if let Err(e) = self.insert_batch(batch) {
                self.batches = before;
                return Err(e);
            }
        }
        self.health.merge(&other.health);
        for (mine, theirs) in self.rejected.iter_mut().zip(&other.rejected) {
            *mine.get_mut() = mine.get_mut().saturating_add(theirs.load(Ordering::Relaxed));
        }
        for cell in 0..self.squares.len() {
            let pixel = cell / 3 % self.spec.pixels();
            let sum = join(other.total_low[cell], other.total_high[cell]);
            let mine = (&mut self.total_low[cell], &mut self.total_high[cell], &mut self.squares[cell]);
            if !accumulate(mine, sum, other.squares[cell]) {
                self.reject(pixel, Mishap::SumOverflow);
            }
            self.add_integer(cell, other.current(cell), pixel);
        }
        Ok(())
    }

    /// Finished batches, sorted by index.
    pub fn batches(&self) -> &[Batch] {
        &self.batches
    }

    /// Samples per pixel over the finished batches.
    pub fn samples(&self) -> u64 {
        self.batches.iter().map(|b| b.samples).sum()
    }

    /// Values left out and sums out of range at a pixel, over all layers.
    pub fn rejected(&self, pixel: usize) -> u32 {
        self.rejected[pixel].load(Ordering::Relaxed)
    }

    /// Mean over the samples of the finished batches; NaN when there is none.
    pub fn mean(&self, layer: usize, pixel: usize) -> Rgb {
        let (n, quantum) = (self.samples() as f64, power_of_two(self.spec.quantum[layer]));
        Rgb::from_fn(|c| self.total(layer, pixel, c) as f64 / n * quantum)
    }

    /// Unbiased variance of the mean (formula above); `None` below two batches. Never negative: rounding is cut at zero,
    /// which is at most (B + 1) / 2 quanta squared in the sum of squares.
    pub fn variance_of_mean(&self, layer: usize, pixel: usize) -> Option<Rgb> {
        let (batches, n) = (self.batches.len(), self.samples());
        if batches < 2 {
            return None;
        }
        let factor = power_of_two(2 * self.spec.quantum[layer]) / ((batches - 1) as f64 * n as f64);
        Some(Rgb::from_fn(|c| {
            let squares = self.squares[self.cell(layer, pixel) + c];
            let of_mean = square_over(self.total(layer, pixel, c).unsigned_abs(), n);
            wide_to_f64(wide_saturating_sub(squares, of_mean)) * factor
        }))
    }

    /// Means of a layer, row by row, as written to files.
    pub fn mean_image(&self, layer: usize) -> Vec<[f32; 3]> {
        (0..self.spec.pixels()).map(|p| self.mean(layer, p).0.map(|x| x as f32)).collect()
    }

    /// Variances of the mean of a layer; `None` below two batches.
    pub fn variance_image(&self, layer: usize) -> Option<Vec<[f32; 3]>> {
        (0..self.spec.pixels()).map(|p| self.variance_of_mean(layer, p).map(|v| v.0.map(|x| x as f32))).collect()
    }

    fn cell(&self, layer: usize, pixel: usize) -> usize {
        (layer * self.spec.pixels() + pixel) * 3
    }

    fn total(&self, layer: usize, pixel: usize, channel: usize) -> i128 {
        let cell = self.cell(layer, pixel) + channel;
        join(self.total_low[cell], self.total_high[cell])
    }

    fn current(&self, cell: usize) -> i128 {
        join(self.current_low[cell].load(Ordering::Relaxed), self.current_high[cell].load(Ordering::Relaxed))
    }

    /// Whether something was added since the last `end_batch`.
    pub fn batch_in_progress(&self) -> bool {
        (0..self.squares.len()).any(|cell| self.current(cell) != 0)
    }
}

/// Add a sum and its square to a cell; false where a range is left (the square then stays at its largest value).
fn accumulate((low, high, squares): (&mut u64, &mut i32, &mut [u64; 3]), sum: i128, square: [u64; 3]) -> bool {
    let total = join(*low, *high) + sum;
    (*low, *high) = (total as u64, (total >> 64) as i32);
    let added = wide_add(*squares, square);
    *squares = added.unwrap_or([u64::MAX; 3]);
    join(*low, *high) == total && added.is_some()
}

fn join(low: u64, high: i32) -> i128 {
    ((high as i128) << 64) | low as i128
}

/// Round to nearest, ties to even. Most values fit 64 bits, where the conversion is cheap.
fn to_integer(x: f64) -> i128 {
    // Where a unit is the last place, adding this rounds just so, without a call.
    const UNITS: f64 = 6755399441055744.0; // 1.5 * 2^52
    if x.abs() < 2.0f64.powi(51) {
        return ((x + UNITS) - UNITS) as i64 as i128;
    }
    let x = x.round_ties_even();
    if x.abs() < 9.2e18 { x as i64 as i128 } else { x as i128 }
}

/// 2^e exactly, for e of an ordinary f64.
pub(super) fn power_of_two(e: i32) -> f64 {
    f64::from_bits(((1023 + e) as u64) << 52)
}

/// m^2 / n rounded to nearest, for m < 2^96, as three words, lowest first.
fn square_over(m: u128, n: u64) -> [u64; 3] {
    // Square by halves: m = h 2^64 + l.
    let (h, l) = (m >> 64, m as u64 as u128);
    let (ll, hl) = (l * l, 2 * h * l);
    let middle = (ll >> 64) + (hl as u64 as u128);
    let square = [ll as u64, middle as u64, ((middle >> 64) + (hl >> 64) + h * h) as u64];
    // Divide by long division, highest word first.
    let (mut quotient, mut rest) = ([0; 3], 0u128);
    for i in (0..3).rev() {
        let part = (rest << 64) | square[i] as u128;
        if part != 0 {
            quotient[i] = (part / n as u128) as u64;
            rest = part % n as u128;
        }
    }
    let up = (2 * rest >= n as u128) as u64;
    wide_add(quotient, [up, 0, 0]).unwrap_or([u64::MAX; 3])
}

fn wide_add(a: [u64; 3], b: [u64; 3]) -> Option<[u64; 3]> {
    let (mut sum, mut carry) = ([0; 3], 0);
    for i in 0..3 {
        let s = a[i] as u128 + b[i] as u128 + carry;
        (sum[i], carry) = (s as u64, s >> 64);
    }
    (carry == 0).then_some(sum)
}

fn wide_saturating_sub(a: [u64; 3], b: [u64; 3]) -> [u64; 3] {
    let (mut difference, mut borrow) = ([0; 3], 0);
    for i in 0..3 {
        let d = a[i] as i128 - b[i] as i128 - borrow;
        (difference[i], borrow) = (d as u64, (d < 0) as i128);
    }
    if borrow == 0 { difference } else { [0; 3] }
}

fn wide_to_f64(a: [u64; 3]) -> f64 {
    a[2] as f64 * power_of_two(128) + a[1] as f64 * power_of_two(64) + a[0] as f64
}

#[cfg(test)]
#[path = "film_tests.rs"]
mod tests;
