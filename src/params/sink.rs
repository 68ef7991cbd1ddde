//! Sinks decide what a partial derivative means: nothing, K derivative images, or a gradient.

use super::array_sum::ArraySum;
use super::slot::{ParamSet, Slot};
use crate::math::Rgb;

/// Receives `d pixel / d slot`, per channel of the pixel, from the sweep and the rooms.
pub trait Sink {
    fn add(&mut self, slot: Slot, partial: Rgb);
}

/// The picture only.
pub struct Null;

impl Sink for Null {
    #[inline]
    fn add(&mut self, _: Slot, _: Rgb) {}
}

/// Forward mode: contract with the tangents of K parameters; `image[k]` is the pixel's derivative.
pub struct Forward<'a> {
    pub params: &'a ParamSet,
    pub image: Vec<Rgb>,
}

impl<'a> Forward<'a> {
    pub fn new(params: &'a ParamSet) -> Self {
        Forward { params, image: vec![Rgb::ZERO; params.len()] }
    }

    /// The sums so far; starts anew.
    pub fn take(&mut self, out: &mut [Rgb]) {
        for (o, i) in out.iter_mut().zip(&mut self.image) {
            *o = std::mem::take(i);
        }
    }
}

impl Sink for Forward<'_> {
    #[inline]
    fn add(&mut self, slot: Slot, partial: Rgb) {
        for (i, &t) in self.image.iter_mut().zip(self.params.tangents(slot)) {
            if t != 0.0 {
                *i += partial * t;
            }
        }
    }
}

/// How large a derivative is: K sums as [`Forward`] has them, and those over the slots of arrays.
pub struct Gauge<'a> {
    pub forward: Forward<'a>,
    entries: Vec<(Slot, Rgb)>,
}

impl<'a> Gauge<'a> {
    pub fn new(params: &'a ParamSet) -> Self {
        Gauge { forward: Forward::new(params), entries: Vec::new() }
    }

    /// Sum of squares over slots of arrays; starts anew.
    pub fn take_squares(&mut self) -> f64 {
        self.entries.sort_by_key(|e| e.0);
        let sums = self.entries.chunk_by(|a, b| a.0 == b.0).map(|e| e.iter().fold(Rgb::ZERO, |s, x| s + x.1));
        let squares = sums.map(|s| s.dot(s)).sum();
        self.entries.clear();
        squares
    }
}

impl Sink for Gauge<'_> {
    fn add(&mut self, slot: Slot, partial: Rgb) {
        self.forward.add(slot, partial);
        if self.forward.params.arrays.iter().any(|a| a.range().contains(&(slot as usize))) {
            self.entries.push((slot, partial));
        }
    }
}

/// To two sinks at once.
pub struct Both<'a, A, B>(pub &'a mut A, pub &'a mut B);

impl<A: Sink, B: Sink> Sink for Both<'_, A, B> {
    #[inline]
    fn add(&mut self, slot: Slot, partial: Rgb) {
        self.0.add(slot, partial);
        self.1.add(slot, partial);
    }
}

/// Draws of the noise of an adjoint image.
pub const DRAWS: usize = 8;

/// Reverse mode: scatter into the gradient over slots, weighted by the adjoint of the pixel at hand.
pub struct Reverse {
    pub adjoint: Rgb,
    /// Draws of the adjoint's own noise.
    pub noise: [Rgb; DRAWS],
    /// How many slots are scalars.
    scalar: usize,
    /// Over scalar slots; behind them by each draw of the noise, where it is asked for.
    pub scalars: Vec<f64>,
    /// Over the slots of arrays, which come after them.
    pub arrays: ArraySum,
    /// Whether something was no number, and left out, since this was last asked.
    nonfinite: bool,
}

impl Reverse {
    /// `noisy`: sums by draws of the adjoint's noise are asked for.
    pub fn new(scalar: usize, noisy: bool, arrays: ArraySum) -> Self {
        let (adjoint, noise) = (Rgb::ZERO, [Rgb::ZERO; DRAWS]);
        let scalars = vec![0.0; scalar * if noisy { 1 + DRAWS } else { 1 }];
        Reverse { adjoint, noise, scalar, scalars, arrays, nonfinite: false }
    }

    fn is_noisy(&self) -> bool {
        self.scalars.len() > self.scalar
    }

    /// Whether something was no number since this was last asked.
    pub fn take_nonfinite(&mut self) -> bool {
        std::mem::take(&mut self.nonfinite)
    }

    /// To one slot, weighted already by the adjoint; `noise`: by a draw of its noise. What is no number is left out.
    #[inline]
    pub fn scatter(&mut self, slot: Slot, value: f64, noise: impl Fn(usize) -> f64) {
        if !value.is_finite() {
            self.nonfinite = true;
            return;
        }
        let slot = slot as usize;
        if slot >= self.scalar {
            return self.arrays.add(slot - self.scalar, value);
        }
        self.scalars[slot] += value;
        if self.is_noisy() {
            (0..DRAWS).for_each(|k| self.scalars[(1 + k) * self.scalar + slot] += noise(k));
        }
    }
}

impl Sink for Reverse {
    #[inline]
    fn add(&mut self, slot: Slot, partial: Rgb) {
        let noise = self.noise;
        self.scatter(slot, self.adjoint.dot(partial), |k| noise[k].dot(partial));
    }
}
