//! Bricks along a ray, by a digital differential analyser in table space.
//!
//! The ray parameter stays the caller's: `o + t w` in world space, `w` of any length. Every crossing is computed from its
//! plane's integer coordinate, never accumulated, by one formula; since that formula is monotone in the plane even after
//! rounding, spans follow each other without gap or overlap, and the cells of a brick end where its span does.

use super::bricks::BRICK;
use super::{Frame, Grid};
use crate::math::DVec3;

/// A brick of the table, or the outside of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickRef(u32);

impl BrickRef {
    pub const OUTSIDE: BrickRef = BrickRef(u32::MAX);

    /// Position in the table; `None` outside.
    #[inline]
    pub(super) fn index(self) -> Option<usize> {
        (self != Self::OUTSIDE).then_some(self.0 as usize)
    }
}

/// A piece of a ray in one brick, or in several of one constant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Span {
    pub t0: f64,
    pub t1: f64,
    pub brick: BrickRef,
    /// Bounds of the interpolant over the brick and all channels, its rounding included.
    pub min: f64,
    pub max: f64,
    /// The field does not vary along the span.
    pub constant: bool,
}

/// A ray in table space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub o: [f64; 3],
    pub d: [f64; 3],
    /// 1/d; infinite: the ray does not move along this axis.
    pub inv: [f64; 3],
}

impl Ray {
    pub(super) fn new(grid: &Grid, o: DVec3, w: DVec3) -> Ray {
        let o = grid.table_from_world.transform_point3(o);
        let d = grid.table_from_world.transform_vector3(w);
        Ray { o: o.into(), d: d.into(), inv: d.recip().into() }
    }

    #[inline(always)]
    pub(super) fn moves(&self, a: usize) -> bool {
        self.inv[a].is_finite()
    }

    /// Where the ray meets a plane across axis `a`.
    #[inline(always)]
    pub(super) fn at_plane(&self, a: usize, plane: f64) -> f64 {
        (plane - self.o[a]) * self.inv[a]
    }

    /// The part of [t0, t1] in the half-open box; empty if the first is not below the second.
    pub(super) fn clip(&self, lo: DVec3, hi: DVec3, t0: f64, t1: f64) -> (f64, f64) {
        let (mut ta, mut tb) = (t0, t1);
        for a in 0..3 {
            if self.moves(a) {
                let (u, v) = (self.at_plane(a, lo[a]), self.at_plane(a, hi[a]));
                ta = ta.max(u.min(v));
                tb = tb.min(u.max(v));
            } else if !(lo[a] <= self.o[a] && self.o[a] < hi[a]) {
                tb = ta;
            }
        }
        (ta, tb)
    }

    fn is_nan(&self) -> bool {
        self.o.iter().chain(&self.d).any(|x| x.is_nan())
    }
}

/// The walk over single bricks between `t` and `end`.
#[derive(Clone, Debug)]
struct Walk {
    t: f64,
    end: f64,
    brick: [i64; 3],
    /// Brick in table order.
    index: i64,
    /// Where the ray leaves the brick, per axis.
    exit: [f64; 3],
}

impl Walk {
    fn new(frame: &Frame, ray: &Ray, t: f64, end: f64) -> Walk {
        let inside = |a: usize| {
            let q = if ray.moves(a) { ray.o[a] + t * ray.d[a] } else { ray.o[a] };
            ((q * (1.0 / BRICK as f64)) as i64).clamp(0, frame.dims[a] as i64 - 1)
        };
        let brick = [inside(0), inside(1), inside(2)];
        let mut walk = Walk { t, end, brick, index: 0, exit: [f64::INFINITY; 3] };
        walk.index = (brick[0] * frame.dims[1] as i64 + brick[1]) * frame.dims[2] as i64 + brick[2];
        for a in 0..3 {
            walk.exit[a] = walk.exit_of(ray, a);
        }
        walk
    }

    #[inline(always)]
    fn exit_of(&self, ray: &Ray, a: usize) -> f64 {
        let far = self.brick[a] + i64::from(ray.d[a] > 0.0);
        if ray.moves(a) { ray.at_plane(a, (far * BRICK as i64) as f64) } else { f64::INFINITY }
    }

    #[inline(always)]
    fn more(&self) -> bool {
        self.t < self.end
    }

    /// Leave the current brick; returns where.
    #[inline(always)]
    fn advance(&mut self, frame: &Frame, ray: &Ray) -> f64 {
        let [x, y, z] = self.exit;
        let xy = if x < y { x } else { y };
        let leave = if xy < z { xy } else { z };
        if leave >= self.end {
            self.t = self.end;
            return self.end;
        }
        self.t = if leave > self.t { leave } else { self.t };
        let (ny, nz) = (frame.dims[1] as i64, frame.dims[2] as i64);
        let stride = [ny * nz, nz, 1];
        for a in 0..3 {
            if self.exit[a] == leave {
                let step = if ray.d[a] > 0.0 { 1 } else { -1 };
                self.brick[a] += step;
                self.index += step * stride[a];
                self.exit[a] = self.exit_of(ray, a);
            }
        }
        self.t
    }
}

/// Iterator over the spans of a ray, in order. Zero-length spans are left out; so is the outside if the field is 0 there.
#[derive(Clone, Debug)]
pub struct SpanIter<'a> {
    pub(super) grid: &'a Grid,
    pub(super) ray: Ray,
    /// What remains of the outside before and after the table.
    before: (f64, f64),
    after: (f64, f64),
    walk: Walk,
    merge: bool,
    /// Ray or range are not numbers.
    broken: bool,
}

impl<'a> SpanIter<'a> {
    fn new(grid: &'a Grid, o: DVec3, w: DVec3, t0: f64, t1: f64, merge: bool) -> Self {
        let ray = Ray::new(grid, o, w);
        let broken = ray.is_nan() || t0.is_nan() || t1.is_nan();
        let (ta, tb) = ray.clip(grid.lo, grid.hi, t0, t1);
        let mut iter = SpanIter {
            grid,
            ray,
            before: (t0, ta),
            after: (tb, t1),
            walk: Walk { t: 0.0, end: 0.0, brick: [0; 3], index: 0, exit: [0.0; 3] },
            merge,
            broken,
        };
        const NOTHING: (f64, f64) = (0.0, 0.0);
        if broken {
            // One span of a field that is not a number: integrals over it are not, either.
            (iter.before, iter.after) = ((0.0, 1.0), NOTHING);
            return iter;
        }
        if ta < tb && !grid.bricks.is_empty() {
            iter.walk = Walk::new(&grid.frame, &iter.ray, ta, tb);
        } else {
            // A ray that misses the table is outside all along.
            (iter.before, iter.after) = ((t0, t1), NOTHING);
        }
        if grid.outside == [0.0; 3] {
            (iter.before, iter.after) = (NOTHING, NOTHING);
        }
        iter
    }

    /// The outside from `range.0` to `range.1`, once.
    #[cold]
    fn outside(grid: &Grid, broken: bool, range: &mut (f64, f64)) -> Span {
        let (t0, t1) = std::mem::replace(range, (0.0, 0.0));
        let values = if broken { &[f64::NAN; 3] } else { &grid.outside };
        let values = &values[..grid.channels()];
        let fold = |f: fn(f64, f64) -> f64| values.iter().copied().fold(values[0], f);
        Span { t0, t1, brick: BrickRef::OUTSIDE, min: fold(f64::min), max: fold(f64::max), constant: true }
    }
}

impl Iterator for SpanIter<'_> {
    type Item = Span;

    #[inline]
    fn next(&mut self) -> Option<Span> {
        if self.before.0 < self.before.1 {
            return Some(Self::outside(self.grid, self.broken, &mut self.before));
        }
        let (frame, bricks) = (&self.grid.frame, &self.grid.bricks);
        while self.walk.more() {
            let (t0, brick) = (self.walk.t, self.walk.index as usize);
            let code = bricks.code(brick);
            let mut t1 = self.walk.advance(frame, &self.ray);
            let constant = code & 1 == 0;
            if constant && self.merge {
                while self.walk.more() && bricks.code(self.walk.index as usize) == code {
                    t1 = self.walk.advance(frame, &self.ray);
                }
            }
            if t0 < t1 {
                let [min, max] = bounds(bricks.range(brick), constant);
                return Some(Span { t0, t1, brick: BrickRef(brick as u32), min, max, constant });
            }
        }
        (self.after.0 < self.after.1).then(|| Self::outside(self.grid, self.broken, &mut self.after))
    }
}

/// Bounds of the interpolant as computed: three linear interpolations may pass a node by nine roundings.
#[inline(always)]
fn bounds([min, max]: [f32; 2], constant: bool) -> [f64; 2] {
    let (min, max) = (f64::from(min), f64::from(max));
    if constant {
        return [min, max];
    }
    let slack = 2e-15 * if -min > max { -min } else { max };
    // An interpolant of nodes that are not negative is never negative.
    [if min >= 0.0 { min * (1.0 - 2e-15) } else { min - slack }, max + slack]
}

impl Grid {
    /// Bricks along `o + t w`, `t` in [t0, t1], in order: every t inside the grid's box is in exactly one span. With a
    /// background other than 0 the outside is covered too. Consecutive bricks of one constant are one span. t0 > t1: none.
    pub fn spans(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> SpanIter<'_> {
        SpanIter::new(self, o, w, t0, t1, true)
    }

    /// The part of [t0, t1] in which the field may differ from 0; empty if the first is not below the second.
    pub fn clip_ray(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> (f64, f64) {
        if self.outside != [0.0; 3] { (t0, t1) } else { Ray::new(self, o, w).clip(self.lo, self.hi, t0, t1) }
    }

    /// The same, brick by brick.
    pub(super) fn single_spans(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> SpanIter<'_> {
        SpanIter::new(self, o, w, t0, t1, false)
    }
}
