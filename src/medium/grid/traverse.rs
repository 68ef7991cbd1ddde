//! Bricks along a ray, by a digital differential analyser in table space.
//!
//! The ray parameter stays the caller's: `o + t w` in world space, `w` of any length. Every crossing is computed from its
//! plane's integer coordinate, never accumulated, by one formula; since that formula is monotone in the plane even after
//! rounding, spans follow each other without gap or overlap, and the cells of a brick end where its span does.

use super::Grid;
use super::bricks::BRICK;
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

/// A piece of a ray in one brick, or in several.
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
    /// Of a node of several bricks (or the outside), `brick` is the first of them.
    pub large: bool,
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

/// Which nodes of the pyramid are one piece: asked of a level (1 or more) and the least and greatest value there, from coarse to fine.
pub trait Whole: Fn(usize, [f32; 2]) -> bool {}
impl<F: Fn(usize, [f32; 2]) -> bool> Whole for F {}

/// The walk over bricks, or over larger nodes of the pyramid, between `t` and `end`.
#[derive(Clone, Debug)]
struct Walk {
    t: f64,
    end: f64,
    /// Of the node at hand the brick that the ray came in by.
    brick: [i64; 3],
    /// The same in table order.
    index: i64,
    level: usize,
    /// Where the ray leaves the node, per axis.
    exit: [f64; 3],
}

impl Walk {
    fn new(grid: &Grid, ray: &Ray, t: f64, end: f64, whole: &impl Whole) -> Walk {
        let frame = &grid.frame;
        let inside = |a: usize| Walk::near(ray, a, t).clamp(0, frame.dims[a] as i64 - 1);
        let brick = [inside(0), inside(1), inside(2)];
        let mut walk = Walk { t, end, brick, index: 0, level: 0, exit: [f64::INFINITY; 3] };
        walk.enter(grid, ray, grid.bricks.levels.top(), whole);
        walk
    }

    /// The brick along an axis at t, to rounding.
    #[inline(always)]
    fn near(ray: &Ray, a: usize, t: f64) -> i64 {
        let q = if ray.moves(a) { ray.o[a] + t * ray.d[a] } else { ray.o[a] };
        (q * (1.0 / BRICK as f64)) as i64
    }

    /// Where the ray meets the near (0) or far (1) side of a node that is `n` of its level along an axis.
    #[inline(always)]
    fn side(ray: &Ray, a: usize, n: i64, level: usize, side: i64) -> f64 {
        ray.at_plane(a, (((n + side) << level) * BRICK as i64) as f64)
    }

    #[inline(always)]
    fn exit_of(&self, ray: &Ray, a: usize) -> f64 {
        let far = i64::from(ray.d[a] > 0.0);
        let n = self.brick[a] >> self.level;
        if ray.moves(a) { Walk::side(ray, a, n, self.level, far) } else { f64::INFINITY }
    }

    /// Be in the coarsest node, from level `top` down, that is one piece.
    #[inline]
    fn enter(&mut self, grid: &Grid, ray: &Ray, top: usize, whole: &impl Whole) {
        let levels = &grid.bricks.levels;
        self.level = (1..=top).rev().find(|&k| whole(k, levels.range(k, self.brick))).unwrap_or(0);
        let dims = &grid.frame.dims;
        self.index = (self.brick[0] * dims[1] as i64 + self.brick[1]) * dims[2] as i64 + self.brick[2];
        for a in 0..3 {
            self.exit[a] = self.exit_of(ray, a);
        }
    }

    #[inline(always)]
    fn more(&self) -> bool {
        self.t < self.end
    }

    /// Whether the node at hand is of one constant, the one of this code.
    #[inline(always)]
    fn is_all(&self, grid: &Grid, code: u32) -> bool {
        let one = self.level == 0 || {
            let [min, max] = grid.bricks.levels.range(self.level, self.brick);
            min == max
        };
        one && grid.bricks.code(self.index as usize) == code
    }

    /// Leave the current node; returns where.
    #[inline(always)]
    fn advance(&mut self, grid: &Grid, ray: &Ray, whole: &impl Whole) -> f64 {
        let [x, y, z] = self.exit;
        let xy = if x < y { x } else { y };
        let leave = if xy < z { xy } else { z };
        if leave >= self.end {
            self.t = self.end;
            return self.end;
        }
        self.t = if leave > self.t { leave } else { self.t };
        if self.level > 0 {
            self.leave_node(grid, ray, leave, whole);
            return self.t;
        }
        let (ny, nz) = (grid.frame.dims[1] as i64, grid.frame.dims[2] as i64);
        let stride = [ny * nz, nz, 1];
        let mut crossed = 0;
        for a in 0..3 {
            if self.exit[a] == leave {
                let step = if ray.d[a] > 0.0 { 1 } else { -1 };
                crossed |= self.brick[a] ^ (self.brick[a] + step);
                self.brick[a] += step;
                self.index += step * stride[a];
                self.exit[a] = self.exit_of(ray, a);
            }
        }
        if crossed >> 1 != 0 {
            self.enter(grid, ray, coarsest(grid, crossed), whole);
        }
        self.t
    }

    fn leave_node(&mut self, grid: &Grid, ray: &Ray, leave: f64, whole: &impl Whole) {
        let mut crossed = 0;
        for a in 0..3 {
            let n = self.brick[a] >> self.level;
            let (first, last) = (n << self.level, ((n + 1) << self.level) - 1);
            let up = ray.d[a] > 0.0;
            if self.exit[a] == leave {
                let next = if up { last + 1 } else { first - 1 };
                crossed |= next ^ (next + if up { -1 } else { 1 });
                self.brick[a] = next;
            } else if ray.moves(a) {
                let last = last.min(grid.frame.dims[a] as i64 - 1);
                let mut b = Walk::near(ray, a, self.t).clamp(first, last);
                // Rounding: what decides is the side that the walk over bricks would have met.
                let passed = |b: i64| Walk::side(ray, a, b, 0, i64::from(up)) <= self.t;
                let step = if up { 1 } else { -1 };
                while (first..=last).contains(&(b + step)) && passed(b) {
                    b += step;
                }
                while (first..=last).contains(&(b - step)) && !passed(b - step) {
                    b -= step;
                }
                self.brick[a] = b;
            }
        }
        self.enter(grid, ray, coarsest(grid, crossed), whole);
    }
}

/// The coarsest level whose border is crossed with these bits of the brick's number.
#[inline]
fn coarsest(grid: &Grid, crossed: i64) -> usize {
    let bits = (i64::BITS - crossed.leading_zeros()) as usize;
    (bits - 1).min(grid.bricks.levels.top())
}

/// Iterator over the spans of a ray, in order. Zero-length spans are left out; so is the outside if the field is 0 there.
#[derive(Clone, Debug)]
pub struct SpanIter<'a, W> {
    pub(super) grid: &'a Grid,
    pub(super) ray: Ray,
    /// What remains of the outside before and after the table.
    before: (f64, f64),
    after: (f64, f64),
    walk: Walk,
    merge: bool,
    whole: W,
    /// Ray or range are not numbers.
    broken: bool,
}

impl<'a, W: Whole> SpanIter<'a, W> {
    pub(super) fn new(grid: &'a Grid, ray: Ray, t0: f64, t1: f64, merge: bool, whole: W) -> Self {
        let broken = ray.is_nan() || t0.is_nan() || t1.is_nan();
        let (ta, tb) = ray.clip(grid.lo, grid.hi, t0, t1);
        let mut iter = SpanIter {
            grid,
            ray,
            before: (t0, ta),
            after: (tb, t1),
            walk: Walk { t: 0.0, end: 0.0, brick: [0; 3], index: 0, level: 0, exit: [0.0; 3] },
            merge,
            whole,
            broken,
        };
        const NOTHING: (f64, f64) = (0.0, 0.0);
        if broken {
            // One span of a field that is not a number: integrals over it are not, either.
            (iter.before, iter.after) = ((0.0, 1.0), NOTHING);
            return iter;
        }
        if ta < tb && !grid.bricks.is_empty() {
            iter.walk = Walk::new(grid, &iter.ray, ta, tb, &iter.whole);
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
        let (min, max) = (fold(f64::min), fold(f64::max));
        Span { t0, t1, brick: BrickRef::OUTSIDE, min, max, constant: true, large: true }
    }
}

impl<W: Whole> Iterator for SpanIter<'_, W> {
    type Item = Span;

    #[inline]
    fn next(&mut self) -> Option<Span> {
        if self.before.0 < self.before.1 {
            return Some(Self::outside(self.grid, self.broken, &mut self.before));
        }
        let (grid, bricks) = (self.grid, &self.grid.bricks);
        while self.walk.more() {
            let (t0, brick, level) = (self.walk.t, self.walk.index as usize, self.walk.level);
            let code = bricks.code(brick);
            let range = if level == 0 { bricks.range(brick) } else { bricks.levels.range(level, self.walk.brick) };
            let constant = if level == 0 { code & 1 == 0 } else { range[0] == range[1] };
            let mut t1 = self.walk.advance(grid, &self.ray, &self.whole);
            if constant && self.merge {
                while self.walk.more() && self.walk.is_all(grid, code) {
                    t1 = self.walk.advance(grid, &self.ray, &self.whole);
                }
            }
            if t0 < t1 {
                let [min, max] = bounds(range, constant);
                return Some(Span { t0, t1, brick: BrickRef(brick as u32), min, max, constant, large: level > 0 });
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
    /// Cells along the side of a node of a level.
    #[inline(always)]
    pub(super) fn side(level: usize) -> f64 {
        (BRICK << level) as f64
    }

    /// Bricks along `o + t w`, `t` in [t0, t1], in order: every t inside the grid's box is in exactly one span. With a
    /// background other than 0 the outside is covered too. Consecutive bricks of one constant are one span. t0 > t1: none.
    pub fn spans(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> SpanIter<'_, impl Whole> {
        SpanIter::new(self, Ray::new(self, o, w), t0, t1, true, |_, [min, max]: [f32; 2]| min == max)
    }

    /// The same, larger pieces ([`Span::large`]) also where the integral of channels over one is at most `thin` along a way as long as its side.
    pub fn thin_spans(&self, o: DVec3, w: DVec3, t0: f64, t1: f64, thin: f64) -> SpanIter<'_, impl Whole> {
        let ray = Ray::new(self, o, w);
        let bound = thin * DVec3::from(ray.d).length();
        let whole = move |level, [min, max]: [f32; 2]| min == max || f64::from(max) * Grid::side(level) <= bound;
        SpanIter::new(self, ray, t0, t1, true, whole)
    }

    /// The part of [t0, t1] in which the field may differ from 0; empty if the first is not below the second.
    pub fn clip_ray(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> (f64, f64) {
        if self.outside != [0.0; 3] { (t0, t1) } else { Ray::new(self, o, w).clip(self.lo, self.hi, t0, t1) }
    }

    /// The same, brick by brick.
    pub(super) fn single_spans(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> SpanIter<'_, impl Whole> {
        SpanIter::new(self, Ray::new(self, o, w), t0, t1, false, |_, _| false)
    }
}
