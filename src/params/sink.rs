//! Sinks decide what a partial derivative means: nothing, K derivative images, or a gradient.

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

/// To two sinks at once.
pub struct Both<'a, A, B>(pub &'a mut A, pub &'a mut B);

impl<A: Sink, B: Sink> Sink for Both<'_, A, B> {
    #[inline]
    fn add(&mut self, slot: Slot, partial: Rgb) {
        self.0.add(slot, partial);
        self.1.add(slot, partial);
    }
}

/// Reverse mode: scatter into the gradient over slots, weighted by the adjoint of the pixel at hand.
pub struct Reverse {
    pub adjoint: Rgb,
    pub gradient: Vec<f64>,
}

impl Reverse {
    pub fn new(slots: usize) -> Self {
        Reverse { adjoint: Rgb::ZERO, gradient: vec![0.0; slots] }
    }
}

impl Sink for Reverse {
    #[inline]
    fn add(&mut self, slot: Slot, partial: Rgb) {
        self.gradient[slot as usize] += self.adjoint.dot(partial);
    }
}
