//! Gradients over slots, added up in an order that no thread changes.
//!
//! Over scalar slots every work item (a tile, a block of outward samples) has sums of its own, added in the items' order. Arrays may have millions of slots: there
//! items share a bounded number of sums ([`ArraySum`]), whose number depends on the arrays' size alone. Item k adds to sum k mod n, one item after the other.
//! Sums are begun one after the other too and added up in that order: those alive are the threads' own, and those that wait for a slower one before them.
//! What no sample of a batch has touched costs nothing (`Total`).

use crate::params::sink::DRAWS;
use crate::params::{ArraySum, Reverse};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// What the shared sums of arrays may hold, in bytes, within these numbers of sums.
const SHARED: usize = 1 << 28;
const SUMS: (usize, usize) = (8, 256);
/// Slots that are touched together: a cache line.
const CHUNK: usize = 8;

/// Numbers of slots.
#[derive(Clone, Copy, Debug)]
pub struct Size {
    pub scalars: usize,
    pub arrays: usize,
    /// Sums over scalars by draws of the adjoint's own noise, too: the mean of their squares is the variance that it brings.
    pub noisy: bool,
}

/// A gradient.
#[derive(Clone, Debug, Default)]
pub struct Gradient {
    /// How many slots are scalars.
    scalar: usize,
    noisy: bool,
    /// Over scalars; behind them by each draw of the adjoint's noise.
    scalars: Vec<f64>,
    arrays: Total,
    /// Sums over arrays that are done with, all 0: fresh memory costs more than the samples of a small batch.
    spare: Vec<ArraySum>,
}

/// A number for every slot of the arrays, and which of them may not be 0.
#[derive(Clone, Debug, Default)]
struct Total {
    numbers: Vec<f64>,
    /// A bit a chunk.
    touched: Vec<u64>,
}

impl Total {
    fn new(slots: usize) -> Self {
        Total { numbers: vec![0.0; slots], touched: vec![0; slots.div_ceil(CHUNK).div_ceil(64)] }
    }

    fn add(&mut self, slot: usize, value: f64) {
        let chunk = slot / CHUNK;
        self.touched[chunk / 64] |= 1 << (chunk % 64);
        self.numbers[slot] += value;
    }

    /// Hand over the slots of all chunks that were touched; 0 afterward.
    fn take(&mut self, mut f: impl FnMut(usize, f64)) {
        for (word, bits) in self.touched.iter_mut().enumerate() {
            let mut bits = std::mem::take(bits);
            while bits != 0 {
                let first = (64 * word + bits.trailing_zeros() as usize) * CHUNK;
                let end = (first + CHUNK).min(self.numbers.len());
                (first..end).for_each(|slot| f(slot, std::mem::take(&mut self.numbers[slot])));
                bits &= bits - 1;
            }
        }
    }
}

impl Size {
    /// Sums that so many items share.
    fn sums(&self, items: usize) -> usize {
        match self.arrays {
            0 => items,
            n => (SHARED / (n * size_of::<f64>())).clamp(SUMS.0, SUMS.1).min(items),
        }
    }
}

impl Gradient {
    pub fn new(size: Size) -> Self {
        Gradient {
            scalar: size.scalars,
            noisy: size.noisy,
            scalars: vec![0.0; size.scalars * if size.noisy { 1 + DRAWS } else { 1 }],
            arrays: Total::new(size.arrays),
            spare: Vec::new(),
        }
    }

    /// Work on items `0..items`, each with a sink for it; `None` where no gradient is wanted.
    pub fn gather(&mut self, items: usize, reverse: bool, work: impl Fn(usize, &mut Option<Reverse>) + Sync) {
        let arrays = if reverse { self.arrays.numbers.len() } else { 0 };
        let (scalar, noisy) = (self.scalar, self.noisy);
        let size = Size { scalars: scalar, arrays, noisy };
        let sums = size.sums(items);
        let done = Mutex::new(Done {
            total: &mut self.arrays,
            next: 0,
            waiting: BTreeMap::new(),
            spare: if reverse { std::mem::take(&mut self.spare) } else { Vec::new() },
            scalars: vec![Vec::new(); sums],
        });
        let lock = || done.lock().unwrap_or_else(PoisonError::into_inner);
        let share = |first: usize| {
            let spare = lock().spare.pop();
            let mut arrays = spare.unwrap_or_else(|| ArraySum::new(size.arrays));
            let own = (first..items).step_by(sums).map(|item| {
                let mut sink = reverse.then(|| Reverse::new(scalar, noisy, std::mem::take(&mut arrays)));
                work(item, &mut sink);
                sink.map_or_else(Vec::new, |r| {
                    arrays = r.arrays;
                    r.scalars
                })
            });
            let own = own.collect::<Vec<_>>();
            lock().finish(first, own, arrays);
        };
        let begun = AtomicUsize::new(0);
        let threads = rayon::current_num_threads().min(sums);
        rayon::scope(|s| {
            for _ in 0..threads {
                s.spawn(|_| {
                    while let Some(k) = Some(begun.fetch_add(1, Ordering::Relaxed)).filter(|&k| k < sums) {
                        share(k);
                    }
                });
            }
        });
        let Done { scalars, spare, .. } = done.into_inner().unwrap_or_else(PoisonError::into_inner);
        if reverse {
            self.spare = spare;
        }
        for item in 0..items {
            add(&mut self.scalars, &scalars[item % sums][item / sums]);
        }
    }
}

/// Sums that are complete: of arrays those up to `next` in the total, others waiting; of scalars one an item.
struct Done<'a> {
    total: &'a mut Total,
    next: usize,
    waiting: BTreeMap<usize, ArraySum>,
    spare: Vec<ArraySum>,
    scalars: Vec<Vec<Vec<f64>>>,
}

impl Done<'_> {
    fn finish(&mut self, k: usize, scalars: Vec<Vec<f64>>, arrays: ArraySum) {
        self.scalars[k] = scalars;
        self.waiting.insert(k, arrays);
        while let Some(mut sum) = self.waiting.remove(&self.next) {
            sum.take(|slot, x| self.total.add(slot, x));
            self.next += 1;
            self.spare.push(sum);
        }
    }
}

fn add(sum: &mut [f64], x: &[f64]) {
    sum.iter_mut().zip(x).for_each(|(a, b)| *a += b);
}

/// Of a sum of squares: standard errors below 1e-7 of the mean are told as 0.
const ROUNDING: f64 = 1e-14;

/// Gradients of batches: their mean per sample, and its standard error.
#[derive(Debug)]
pub struct Batches {
    size: Size,
    scalars: Vec<(Vec<f64>, u64)>,
    /// Of arrays the sum, and that of the batches' squares over their samples: what no batch has touched needs no care. Places for scalars come before.
    sum: Vec<f64>,
    squares: Vec<f64>,
    samples: u64,
}

impl Batches {
    pub fn new(size: Size) -> Self {
        let all = size.scalars + size.arrays;
        Batches { size, scalars: Vec::new(), sum: vec![0.0; all], squares: vec![0.0; all], samples: 0 }
    }

    /// The gradient of a batch of so many samples a pixel, which is 0 afterward.
    pub fn push(&mut self, g: &mut Gradient, samples: u64) {
        let (scalars, zeros) = (self.size.scalars, vec![0.0; g.scalars.len()]);
        self.scalars.push((std::mem::replace(&mut g.scalars, zeros), samples));
        self.samples += samples;
        g.arrays.take(|slot, x| {
            self.sum[scalars + slot] += x;
            self.squares[scalars + slot] += x * x / samples as f64;
        });
    }

    /// Mean and standard error, one number a slot: scalars, then arrays.
    pub fn finish(self) -> (Vec<f64>, Vec<f64>) {
        let (b, samples) = (self.scalars.len() as f64, self.samples as f64);
        let (mut mean, mut error) = (self.sum, self.squares);
        let error_of = |squares: f64| (squares / (b - 1.0) / samples).sqrt();
        let slots = self.size.scalars;
        let of_sum = |k: usize| {
            let mean = self.scalars.iter().map(|b| b.0[k]).sum::<f64>() / samples;
            let about = |(g, n): &(Vec<f64>, u64)| (g[k] / *n as f64 - mean).powi(2) * *n as f64;
            (mean, error_of(self.scalars.iter().map(about).sum()))
        };
        for s in 0..slots {
            (mean[s], error[s]) = of_sum(s);
            if self.size.noisy {
                // Squares of means without what their own errors make of them.
                let drawn = (1..=DRAWS).map(|k| of_sum(k * slots + s));
                let variance = drawn.map(|(m, e)| m * m - e * e).sum::<f64>() / DRAWS as f64;
                // Where the noise is not known, neither is the error.
                error[s] = if variance.is_nan() { f64::NAN } else { error[s].hypot(variance.max(0.0).sqrt()) };
            }
        }
        for (sum, square) in mean.iter_mut().zip(&mut error).skip(slots) {
            // About the mean; what rounding leaves of equal batches is nothing.
            let rest = *square - *sum * *sum / samples;
            *square = error_of(if rest <= ROUNDING * *square { 0.0 } else { rest });
            *sum /= samples;
        }
        (mean, error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Rgb;
    use crate::params::Sink;

    #[test]
    fn sums_are_bounded_and_know_no_threads() {
        let size = Size { scalars: 2, arrays: 1 << 22, noisy: false };
        assert_eq!(size.sums(1000), 8);
        assert_eq!(Size { arrays: 0, ..size }.sums(1000), 1000);
        assert_eq!(Size { arrays: 3, ..size }.sums(1000), 256);
        assert_eq!(Size { arrays: 3, ..size }.sums(7), 7);
        let small = Size { scalars: 2, arrays: 3, noisy: false };
        let sum = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut g = Gradient::new(small);
            pool.install(|| {
                g.gather(1001, true, |k, sink| {
                    let r = sink.as_mut().unwrap();
                    r.adjoint = Rgb::splat(1.0 / (k as f64 + 1.0));
                    r.add((k % 5) as u32, Rgb::splat(0.1 + k as f64));
                });
            });
            g
        };
        let (a, b) = (sum(1), sum(3));
        assert_eq!((&a.scalars, &a.arrays.numbers), (&b.scalars, &b.arrays.numbers));
        let one: f64 = (0..1001).filter(|k| k % 5 == 4).map(|k| 3.0 * (0.1 + k as f64) / (k as f64 + 1.0)).sum();
        assert!((a.arrays.numbers[2] - one).abs() < 1e-9 * one);
        let mut none = Gradient::new(small);
        none.gather(10, false, |_, sink| assert!(sink.is_none()));
        assert_eq!(none.arrays.numbers, [0.0; 3]);
    }

    /// Both ways to the error of a mean agree.
    #[test]
    fn errors_of_arrays_are_those_of_scalars() {
        let size = Size { scalars: 1, arrays: 1, noisy: false };
        let mut batches = Batches::new(size);
        for (k, n) in [5, 5, 4, 4, 4].into_iter().enumerate() {
            let x = (k as f64).sin() * n as f64;
            let mut g = Gradient::new(size);
            g.scalars[0] = x;
            g.arrays.add(0, x);
            batches.push(&mut g, n);
        }
        let (mean, error) = batches.finish();
        assert!((mean[0] - mean[1]).abs() < 1e-15 && (error[0] - error[1]).abs() < 1e-15 && error[0] > 0.1);
    }
}
