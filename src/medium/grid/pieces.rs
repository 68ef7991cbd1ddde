//! Where along a way the derivative of its optical depth is taken: cell by cell, or at drawn points.
//!
//! `∫ ∂f ds` ([T] (11), (52b)) is exact over bricks with less than [`CELLS`] cells a point that would be drawn. Elsewhere points are drawn with the density `λ = rate f_max + floor`
//! of the node of the pyramid at hand (`f_max` its largest value), evenly: one offset for all of them, numbers `(j + u) / n` of what λ adds up to, n the next whole number above
//! that. Each counts for `1 / λ`. So the cost follows the depth, and not the size of the voxels, of which a fine grid has far more along a way than collisions: those score `∂f / f`
//! with the density f, and points of a multiple of it have but that part of their variance. Where λ is the same all along, weights add up to the length exactly.

use super::traverse::{Ray, Span};
use super::{Grid, SpanIter};
use crate::math::DVec3;

/// Cells a point up to which they are summed up instead.
const CELLS: f64 = 2.0;
/// Points that may lie in a node of several bricks.
const POINTS: f64 = 2.0;

/// A part of the way.
#[derive(Clone, Copy, Debug)]
pub enum Piece {
    /// To be taken exactly: within one brick, or the outside.
    Whole(Span),
    Point {
        t: f64,
        weight: f64,
    },
}

/// Density of points along a way: `by_value f_max + floor`, per length.
#[derive(Clone, Copy, Debug)]
pub struct Rate {
    pub by_value: f64,
    pub floor: f64,
}

impl Rate {
    fn of(&self, max: f64) -> f64 {
        self.by_value * max + self.floor
    }
}

impl Grid {
    /// The pieces of `o + t w`, t in [t0, t1], in order, w of length 1. `drawn`: the density of points, and a number uniform in [0, 1); without it all is exact.
    pub fn pieces(&self, o: DVec3, w: DVec3, t0: f64, t1: f64, drawn: Option<(Rate, f64)>, mut f: impl FnMut(Piece)) {
        let Some((rate, u)) = drawn else {
            return self.single_spans(o, w, t0, t1).for_each(|span| f(Piece::Whole(span)));
        };
        let ray = Ray::new(self, o, w);
        let cells = ray.d.iter().map(|d| d.abs()).sum::<f64>();
        let whole = |level: usize, [_, max]: [f32; 2]| rate.of(f64::from(max)) * Grid::side(level) <= POINTS * cells;
        let spans = || SpanIter::new(self, ray, t0, t1, false, whole);
        // Of nodes in which points are drawn; 0 of others.
        let density = |s: &Span| {
            let rate = rate.of(s.max);
            let drawn = s.large || rate * CELLS <= cells;
            if drawn && s.brick.index().is_some() { rate } else { 0.0 }
        };
        let total: f64 = spans().map(|s| density(&s) * (s.t1 - s.t0)).sum();
        let step = total / total.ceil();
        let (mut next, mut before) = (u * step, 0.0);
        for span in spans() {
            let density = density(&span);
            if density == 0.0 {
                f(Piece::Whole(span));
                continue;
            }
            let after = before + density * (span.t1 - span.t0);
            while next < after {
                let t = (span.t0 + (next - before) / density).min(span.t1);
                f(Piece::Point { t, weight: step / density });
                next += step;
            }
            before = after;
        }
    }
}
