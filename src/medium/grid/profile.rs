//! The integral along a way, kept where bricks end: what is asked of it after that crosses one brick instead of all.
//!
//! A line from the camera asks for its depth, for a place where a share of it is passed (often several), and for the depth up to places that others have drawn.
//!
//! *Bounds* ([`Grid::bounds`]) stand in for the field where it is fine and smooth: the largest value of a node of the pyramid, as large as it may be. The first tentative collision of
//! delta tracking ([T] 8.1) against them can be forced like a collision, and the flight goes on from there, so that crossing a fine grid takes steps by its depth, not by its cells.
//! A depth G in place of τ leaves `e^-τ - e^-G` of what passes to chance, which adds up to `(1 - e^(τ-G)) / (e^τ - 1)` to the relative variance of what is scattered.

use super::traverse::{Ray, Span};
use super::{Grid, SpanIter};
use crate::math::DVec3;

/// Relative variance that is given away for a cell that need not be crossed: what it takes of the time of a path. Measured (benches/RESULTS.md).
const CELL: f64 = 0.001;
/// The same for the steps that a node saves over those of its halves, of which each level has half as many a length.
const NODE: f64 = 0.4;
/// How many times its least value a node may be thought to hold.
const UNEVEN: f64 = 3.0;
/// Cells on a way up to which it is not looked at twice.
const FEW: f64 = 128.0;

/// Integral of a grid of one channel along `o + t w` over t in [t0, t1], brick by brick; of bounds of it, where it is said.
#[derive(Clone, Debug)]
pub struct Profile {
    ray: Ray,
    steps: Vec<Step>,
    total: f64,
}

#[derive(Clone, Copy, Debug)]
struct Step {
    span: Span,
    /// The largest value stands in for the field.
    bound: bool,
    /// Integral in front of it.
    before: f64,
}

/// A place at which the integral of a profile has a given value.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub t: f64,
    /// What stands in for the field there, if anything.
    pub bound: Option<f64>,
}

impl Profile {
    fn new(grid: &Grid, spans: impl Iterator<Item = Span>, ray: Ray, bound: impl Fn(&Span) -> bool) -> Profile {
        let (mut steps, mut total) = (Vec::with_capacity(64), 0.0);
        for span in spans {
            let step = Step { bound: bound(&span), span, before: total };
            total = step.until(grid, &ray, span.t1);
            steps.push(step);
        }
        Profile { ray, steps, total }
    }

    /// All of it; without bounds [`Grid::integrate`] to the bit.
    pub fn total(&self) -> f64 {
        self.total
    }

    /// Steps that it took, cells of bricks counted one by one; for tests.
    #[cfg(test)]
    pub(super) fn effort(&self) -> f64 {
        let cells = |s: &Step| (s.span.t1 - s.span.t0) * self.ray.d.iter().map(|d| d.abs()).sum::<f64>();
        self.steps.iter().map(|s| if s.bound || s.span.constant { 1.0 } else { 1.0 + cells(s) }).sum()
    }

    /// Whether bounds stand in anywhere.
    pub fn is_bound(&self) -> bool {
        self.steps.iter().any(|step| step.bound)
    }

    /// The integral from t0 up to `t`. `grid`: the one that it is of.
    pub fn until(&self, grid: &Grid, t: f64) -> f64 {
        let n = self.steps.partition_point(|step| step.span.t0 < t);
        match self.steps[..n].last() {
            None => 0.0,
            Some(step) if step.span.t1 <= t => self.steps.get(n).map_or(self.total, |next| next.before),
            Some(step) => step.until(grid, &self.ray, t),
        }
    }

    /// Where the integral reaches `target` > 0, or none where all of it is less; without bounds [`Grid::invert`] to the bit.
    pub fn invert(&self, grid: &Grid, target: f64) -> Option<Place> {
        if target <= 0.0 {
            return self.steps.first().map(|step| Place { t: step.span.t0, bound: None });
        }
        // The field is not negative, so that sums do not fall.
        let n = self.steps.partition_point(|step| step.before < target);
        let step = self.steps[..n].last()?;
        if step.bound {
            let t = step.span.t0 + (target - step.before) / step.span.max;
            return (target <= self.total).then(|| Place { t: t.min(step.span.t1), bound: Some(step.span.max) });
        }
        let t = grid.invert_span::<1>(&self.ray, &step.span, 0, step.before, target).ok()?;
        Some(Place { t, bound: None })
    }
}

impl Step {
    /// Integral up to `t` of its span.
    #[inline(always)]
    fn until(&self, grid: &Grid, ray: &Ray, t: f64) -> f64 {
        if self.bound {
            return self.before + self.span.max * (t - self.span.t0);
        }
        let mut sum = [self.before];
        grid.add_span::<1, 1>(ray, &Span { t1: t, ..self.span }, &mut sum);
        sum[0]
    }
}

impl Grid {
    /// The profile of a way. Of a grid with three channels there is none.
    pub fn profile(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> Option<Profile> {
        if self.channels() != 1 {
            return None;
        }
        let ray = Ray::new(self, o, w);
        let spans = SpanIter::new(self, ray, t0, t1, true, |_, [min, max]: [f32; 2]| min == max);
        Some(Profile::new(self, spans, ray, |_| false))
    }

    /// The same with bounds where they are worth it: for extinctions of `scale` times the field, which is not negative.
    pub fn bounds(&self, o: DVec3, w: DVec3, t0: f64, t1: f64, scale: f64) -> Option<Profile> {
        let ray = Ray::new(self, o, w);
        let (ta, tb) = ray.clip(self.lo, self.hi, t0, t1);
        // Cells a length.
        let cells = ray.d.iter().map(|d| d.abs()).sum::<f64>();
        if self.channels() != 1 || self.bricks.levels.top() == 0 || (tb - ta) * cells <= FEW {
            return self.profile(o, w, t0, t1);
        }
        // The depth, about, and rather too little: of two bricks' size, or of nodes without much of a range.
        let near = |level, [min, max]: [f32; 2]| level == 1 || max <= 2.0 * min;
        let middle = |s: Span| (s.min * s.max).sqrt().min(UNEVEN * s.min) * (s.t1 - s.t0);
        let middles: f64 = SpanIter::new(self, ray, ta, tb, true, near).map(middle).sum();
        let limit = CELL * (scale * middles).exp_m1() * cells / scale;
        let whole =
            |level: usize, [min, max]: [f32; 2]| f64::from(max - min) * ((1u64 << level) as f64) <= NODE * limit;
        let spans = SpanIter::new(self, ray, t0, t1, true, whole);
        let bound = |s: &Span| !s.constant && (s.large || s.max - s.min <= limit);
        Some(Profile::new(self, spans, ray, bound))
    }
}
