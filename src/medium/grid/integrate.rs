//! Line integrals of the interpolant, exact: along a ray it is a cubic in t inside a cell ([T] 8.2a, 8.3).
//!
//! A cell's integral is the two-point Gauss rule, exact for cubics like Simpson's, but its points lie inside the cell: no
//! value is carried from cell to cell, so that cells overlap in the processor and the nearest filter needs no other code.
//! Constant bricks take one product. Integrals are over t: with |w| = 1 they are lengths.

use super::bricks::{BRICK, ROW, SLAB, WINDOW};
use super::nodes::{BrickIds, NodeId, weights};
use super::traverse::{Ray, Whole};
use super::{Grid, Span, SpanIter, corners, mix, mix_gradient};
use crate::math::DVec3;

/// Half the distance of the two Gauss points in units of the interval: 1 / (2 sqrt 3).
const GAUSS: f64 = 0.288_675_134_594_812_9;

/// A cell of a brick and the part of the ray in it.
#[derive(Clone, Copy)]
struct Cell {
    /// Lowest node, in nodes of the brick.
    local: usize,
    /// The same in table space.
    corner: [f64; 3],
    t0: f64,
    t1: f64,
}

impl Cell {
    /// Position in the cell, `smooth` as in [`Grid`].
    #[inline(always)]
    fn at(&self, ray: &Ray, smooth: f64, t: f64) -> [f64; 3] {
        let q = |a: usize| (ray.o[a] - self.corner[a] + t * ray.d[a]) * smooth;
        [q(0), q(1), q(2)]
    }

    #[inline(always)]
    fn gauss(&self) -> [f64; 2] {
        let (middle, half) = (0.5 * (self.t0 + self.t1), GAUSS * (self.t1 - self.t0));
        [middle - half, middle + half]
    }

    /// Integral of channel `c`.
    #[inline(always)]
    fn integral<const C: usize>(&self, ray: &Ray, smooth: f64, nodes: &[f32], c: usize) -> f64 {
        let v = corners::<C>(&nodes[self.local * C..], c);
        let [p, q] = self.gauss();
        let (p, q) = (self.at(ray, smooth, p), self.at(ray, smooth, q));
        let sum = mix(&v, p[0], p[1], p[2]) + mix(&v, q[0], q[1], q[2]);
        0.5 * (self.t1 - self.t0) * sum
    }

    /// Integrals of the interpolation weights, in the order of the cell's corners.
    #[inline(always)]
    fn weight_integrals(&self, ray: &Ray, smooth: f64) -> [f64; 8] {
        let [p, q] = self.gauss();
        let (p, q) = (self.at(ray, smooth, p), self.at(ray, smooth, q));
        let (p, q) = (weights(p[0], p[1], p[2]), weights(q[0], q[1], q[2]));
        let half = 0.5 * (self.t1 - self.t0);
        std::array::from_fn(|k| half * (p[k] + q[k]))
    }

    /// Integrals of all channels: weights are computed once.
    #[inline(always)]
    fn integrals<const C: usize>(&self, ray: &Ray, smooth: f64, nodes: &[f32], sum: &mut [f64; C]) {
        let w = self.weight_integrals(ray, smooth);
        let nodes = &nodes[self.local * C..][..WINDOW * C];
        for (k, corner) in [0, 1, ROW, ROW + 1, SLAB, SLAB + 1, SLAB + ROW, SLAB + ROW + 1].into_iter().enumerate() {
            for c in 0..C {
                sum[c] += w[k] * f64::from(nodes[corner * C + c]);
            }
        }
    }

    /// Integrals of channel `c`, of its gradient in cell coordinates, and of that times t - `start`.
    #[inline(always)]
    fn slope<const C: usize>(&self, ray: &Ray, smooth: f64, nodes: &[f32], c: usize, start: f64, sum: &mut Slope) {
        let v = corners::<C>(&nodes[self.local * C..], c);
        let half = 0.5 * (self.t1 - self.t0);
        for t in self.gauss() {
            let [x, y, z] = self.at(ray, smooth, t);
            let gradient = mix_gradient(&v, x, y, z) * half;
            sum.value += half * mix(&v, x, y, z);
            sum.gradient += gradient;
            sum.moment += gradient * (t - start);
        }
    }

    /// The t at which the integral from `t0` is `rest`, for a field that is not negative.
    fn invert<const C: usize>(&self, ray: &Ray, smooth: f64, nodes: &[f32], c: usize, rest: f64) -> f64 {
        let v = corners::<C>(&nodes[self.local * C..], c);
        let [a, b] = [self.t0, self.t1].map(|t| self.at(ray, smooth, t));
        // Polar form of the cubic: Bernstein coefficients are none negative if no node is.
        let bernstein = [
            mix(&v, a[0], a[1], a[2]),
            (mix(&v, b[0], a[1], a[2]) + mix(&v, a[0], b[1], a[2]) + mix(&v, a[0], a[1], b[2])) / 3.0,
            (mix(&v, a[0], b[1], b[2]) + mix(&v, b[0], a[1], b[2]) + mix(&v, b[0], b[1], a[2])) / 3.0,
            mix(&v, b[0], b[1], b[2]),
        ];
        let length = self.t1 - self.t0;
        let s = invert_quartic(bernstein, rest / length);
        if s < 1.0 { self.t0 + s * length } else { self.t1 }
    }
}

/// Integrals over t in [t0, t1] of what a field is along a ray, of its world-space gradient, and of that times `t - t0`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Slope {
    pub value: f64,
    pub gradient: DVec3,
    pub moment: DVec3,
}

/// Iterator over the cells of a brick.
struct Cells<'a> {
    ray: &'a Ray,
    local: usize,
    corner: [f64; 3],
    t: f64,
    end: f64,
    /// Where the ray leaves the cell, and where it would leave the next: known ahead, so that no cell waits for it.
    exit: [f64; 3],
    next: [f64; 3],
    step: [f64; 3],
    /// From a cell's corner to the far plane of the next one.
    ahead: [f64; 3],
    stride: [usize; 3],
    more: bool,
}

impl Iterator for Cells<'_> {
    type Item = Cell;

    // Inlined by force: what a loop over cells costs is arithmetic, not calls.
    #[inline(always)]
    fn next(&mut self) -> Option<Cell> {
        if !self.more {
            return None;
        }
        let [x, y, z] = self.exit;
        let xy = if x < y { x } else { y };
        let leave = if xy < z { xy } else { z };
        let t1 = if leave < self.end { leave } else { self.end };
        let t1 = if t1 > self.t { t1 } else { self.t };
        let cell = Cell { local: self.local, corner: self.corner, t0: self.t, t1 };
        self.more = leave < self.end;
        self.t = t1;
        // Cross all faces that are met at once; without branches, since which comes next is not predictable.
        for a in 0..3 {
            let crossed = self.exit[a] == leave;
            self.local = self.local.wrapping_add(if crossed { self.stride[a] } else { 0 });
            self.corner[a] += if crossed { self.step[a] } else { 0.0 };
            self.exit[a] = if crossed { self.next[a] } else { self.exit[a] };
            self.next[a] = self.ray.at_plane(a, self.corner[a] + self.ahead[a]);
        }
        Some(cell)
    }
}

/// de Casteljau's algorithm.
fn bezier<const N: usize>(mut b: [f64; N], s: f64) -> f64 {
    for n in (1..N).rev() {
        for i in 0..n {
            b[i] = b[i] * (1.0 - s) + b[i + 1] * s;
        }
    }
    b[0]
}

/// s in [0, 1] where the integral from 0 of a cubic in Bernstein form is `target`: Newton's method, kept in a bracket.
fn invert_quartic(cubic: [f64; 4], target: f64) -> f64 {
    let mut quartic = [0.0; 5];
    for i in 0..4 {
        quartic[i + 1] = quartic[i] + 0.25 * cubic[i];
    }
    if target >= quartic[4] {
        return 1.0;
    }
    let (mut lo, mut hi) = (0.0, 1.0);
    let mut s = target / quartic[4];
    for _ in 0..128 {
        let miss = bezier(quartic, s) - target;
        if miss.abs() <= 2.0 * f64::EPSILON * target.abs() {
            break;
        }
        if miss < 0.0 {
            lo = s
        } else {
            hi = s
        }
        let newton = s - miss / bezier(cubic, s);
        let next = if lo < newton && newton < hi { newton } else { 0.5 * (lo + hi) };
        if (next - s).abs() <= f64::EPSILON * s {
            return next;
        }
        s = next;
    }
    s
}

impl Grid {
    /// The cells of a brick along [t0, t1], in order. `t1` is not past the brick's end.
    #[inline(always)]
    fn cells<'a>(&self, ray: &'a Ray, brick: usize, t0: f64, t1: f64) -> Cells<'a> {
        let [_, ny, nz] = self.frame.dims;
        let brick = [brick / (ny * nz), brick / nz % ny, brick % nz];
        let mut cells = Cells {
            ray,
            local: 0,
            corner: [0.0; 3],
            t: t0,
            end: t1,
            exit: [f64::INFINITY; 3],
            next: [f64::INFINITY; 3],
            step: [0.0; 3],
            ahead: [0.0; 3],
            stride: [SLAB, ROW, 1],
            more: true,
        };
        for a in 0..3 {
            // Enter in the cell of the start point; rounding may put that point a hair outside of the brick.
            let base = (brick[a] * BRICK) as f64;
            let q = if ray.moves(a) { ray.o[a] + t0 * ray.d[a] } else { ray.o[a] };
            let i = ((q - base) as i32).clamp(0, BRICK as i32 - 1);
            cells.local += i as usize * cells.stride[a];
            cells.corner[a] = base + f64::from(i);
            let up = ray.d[a] > 0.0;
            cells.step[a] = if up { 1.0 } else { -1.0 };
            let far = if up { 1.0 } else { 0.0 };
            cells.ahead[a] = far + cells.step[a];
            if !up {
                cells.stride[a] = cells.stride[a].wrapping_neg();
            }
            if ray.moves(a) {
                cells.exit[a] = ray.at_plane(a, cells.corner[a] + far);
                cells.next[a] = ray.at_plane(a, cells.corner[a] + cells.ahead[a]);
            }
        }
        cells
    }

    /// Value of channel `c` in a constant span.
    #[inline(always)]
    fn constant_of(&self, span: &Span, c: usize) -> f64 {
        match span.brick.index() {
            Some(brick) => f64::from(self.bricks.window(brick, 0, self.frame.channels)[c]),
            // A ray that is not a number has such a span, too.
            None if span.min.is_nan() => f64::NAN,
            None => self.outside[c],
        }
    }

    /// Add a span's integral to `sum`: of channel 0, or of all three.
    #[inline(always)]
    pub(super) fn add_span<const C: usize, const N: usize>(&self, ray: &Ray, span: &Span, sum: &mut [f64; N]) {
        match span.brick.index() {
            Some(brick) if !span.constant => {
                let nodes = self.bricks.nodes(brick, C);
                for cell in self.cells(ray, brick, span.t0, span.t1) {
                    if N == 1 {
                        sum[0] += cell.integral::<C>(ray, self.smooth, nodes, 0);
                    } else {
                        cell.integrals(ray, self.smooth, nodes, sum);
                    }
                }
            }
            _ => {
                for c in 0..N {
                    sum[c] += constant_integral(self.constant_of(span, c), span);
                }
            }
        }
    }

    /// Integral of channel 0 along `o + t w` over t in [t0, t1].
    pub fn integrate(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> f64 {
        let mut sum = [0.0];
        let mut spans = self.spans(o, w, t0, t1);
        let ray = spans.ray;
        if self.frame.channels == 1 {
            spans.for_each(|s| self.add_span::<1, 1>(&ray, &s, &mut sum));
        } else {
            spans.by_ref().for_each(|s| self.add_span::<3, 1>(&ray, &s, &mut sum));
        }
        sum[0]
    }

    /// Integrals of all channels (`integrate` to rounding); a scalar grid repeats its own.
    pub fn integrate3(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> [f64; 3] {
        if self.frame.channels == 1 {
            return [self.integrate(o, w, t0, t1); 3];
        }
        let mut sum = [0.0; 3];
        let spans = self.spans(o, w, t0, t1);
        let ray = spans.ray;
        spans.for_each(|s| self.add_span::<3, 3>(&ray, &s, &mut sum));
        sum
    }

    /// Integrals of all channels over one span of the same ray, or over a part of it; a scalar grid repeats its own.
    pub fn integrate_span(&self, span: &Span, o: DVec3, w: DVec3) -> [f64; 3] {
        let ray = Ray::new(self, o, w);
        if self.frame.channels == 1 {
            let mut sum = [0.0];
            self.add_span::<1, 1>(&ray, span, &mut sum);
            return [sum[0]; 3];
        }
        let mut sum = [0.0; 3];
        self.add_span::<3, 3>(&ray, span, &mut sum);
        sum
    }

    /// `Ok(t)` where the integral of channel 0 from `t0` reaches `target`, or `Err` of the whole integral if that is less.
    /// For fields that are not negative. The sums are those of `integrate`, in the same order.
    pub fn invert(&self, o: DVec3, w: DVec3, t0: f64, t1: f64, target: f64) -> Result<f64, f64> {
        self.invert_channel(0, o, w, t0, t1, target)
    }

    /// [`Grid::invert`] for channel `c`.
    pub fn invert_channel(&self, c: usize, o: DVec3, w: DVec3, t0: f64, t1: f64, target: f64) -> Result<f64, f64> {
        if self.frame.channels == 1 {
            self.invert_in::<1>(0, o, w, t0, t1, target)
        } else {
            self.invert_in::<3>(c, o, w, t0, t1, target)
        }
    }

    fn invert_in<const C: usize>(
        &self,
        c: usize,
        o: DVec3,
        w: DVec3,
        t0: f64,
        t1: f64,
        target: f64,
    ) -> Result<f64, f64> {
        if target <= 0.0 {
            return Ok(t0);
        }
        let mut sum = 0.0;
        let spans = self.spans(o, w, t0, t1);
        let ray = spans.ray;
        for span in spans {
            match self.invert_span::<C>(&ray, &span, c, sum, target) {
                Ok(t) => return Ok(t),
                Err(next) => sum = next,
            }
        }
        Err(sum)
    }

    /// Go on over one span with the integral `sum` in front of it.
    #[inline(always)]
    pub(super) fn invert_span<const C: usize>(
        &self,
        ray: &Ray,
        span: &Span,
        c: usize,
        mut sum: f64,
        target: f64,
    ) -> Result<f64, f64> {
        match span.brick.index() {
            Some(brick) if !span.constant => {
                let nodes = self.bricks.nodes(brick, C);
                for cell in self.cells(ray, brick, span.t0, span.t1) {
                    let next = sum + cell.integral::<C>(ray, self.smooth, nodes, c);
                    if next >= target {
                        return Ok(cell.invert::<C>(ray, self.smooth, nodes, c, target - sum));
                    }
                    sum = next;
                }
                Err(sum)
            }
            _ => {
                let value = self.constant_of(span, c);
                let next = sum + constant_integral(value, span);
                if next >= target { Ok((span.t0 + (target - sum) / value).min(span.t1)) } else { Err(next) }
            }
        }
    }

    /// How the integral over t in [t0, t1] changes as both ends of the way move, per channel (a scalar grid in each): exact, by the same rule as [`Grid::integrate`].
    pub fn integrate_slope(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> [Slope; 3] {
        if self.frame.channels == 1 { [self.slopes::<1>(o, w, t0, t1)[0]; 3] } else { self.slopes::<3>(o, w, t0, t1) }
    }

    fn slopes<const C: usize>(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> [Slope; C] {
        let mut sums = [Slope::default(); C];
        let spans = self.single_spans(o, w, t0, t1);
        let ray = spans.ray;
        for span in spans {
            match span.brick.index().filter(|_| !span.constant) {
                Some(brick) => {
                    let nodes = self.bricks.nodes(brick, C);
                    for cell in self.cells(&ray, brick, span.t0, span.t1) {
                        for (c, sum) in sums.iter_mut().enumerate() {
                            cell.slope::<C>(&ray, self.smooth, nodes, c, t0, sum);
                        }
                    }
                }
                None => {
                    for (c, sum) in sums.iter_mut().enumerate() {
                        sum.value += constant_integral(self.constant_of(&span, c), &span);
                    }
                }
            }
        }
        let covariant = self.table_from_world.matrix3.transpose() * self.smooth;
        sums.map(|s| Slope { value: s.value, gradient: covariant * s.gradient, moment: covariant * s.moment })
    }

    /// Points of a quadrature over a span that is exact for the field's gradient times anything linear: `f(weight, point)`.
    pub fn quadrature(&self, span: &Span, o: DVec3, w: DVec3, f: &mut impl FnMut(f64, DVec3)) {
        let Some(brick) = span.brick.index().filter(|_| !span.constant) else { return };
        let ray = Ray::new(self, o, w);
        for cell in self.cells(&ray, brick, span.t0, span.t1).filter(|cell| cell.t0 < cell.t1) {
            cell.gauss().into_iter().for_each(|t| f(0.5 * (cell.t1 - cell.t0), o + w * t));
        }
    }

    /// Integrals of the interpolation weights over t in [t0, t1]: `f(slot, weight)`, a slot several times, background
    /// nodes not at all. Exact by the same rule; sum of weight * value is `integrate` of a field with background 0.
    pub fn integrate_nodes(&self, o: DVec3, w: DVec3, t0: f64, t1: f64, f: &mut impl FnMut(NodeId, f64)) {
        let spans = self.single_spans(o, w, t0, t1);
        let ray = spans.ray;
        let [_, ny, nz] = self.frame.dims;
        for span in spans {
            let Some(brick) = span.brick.index() else { continue };
            let ids = self.layout.brick(&self.frame, [brick / (ny * nz), brick / nz % ny, brick % nz]);
            // A brick of one slot (or none) needs no cells.
            if let Some(slot) = ids.uniform() {
                if let Some(slot) = slot {
                    f(NodeId(slot), span.t1 - span.t0);
                }
                continue;
            }
            for cell in self.cells(&ray, brick, span.t0, span.t1).filter(|cell| cell.t0 < cell.t1) {
                let w = cell.weight_integrals(&ray, self.smooth);
                for (id, w) in ids.cell(cell.local).into_iter().zip(w) {
                    if let Some(id) = id {
                        f(id, w);
                    }
                }
            }
        }
    }
}

/// Corners of a cell in nodes of the brick, z fastest.
const CORNERS: [usize; 8] = [0, 1, ROW, ROW + 1, SLAB, SLAB + 1, SLAB + ROW, SLAB + ROW + 1];

/// Weights that a ray gives to the corners of its cells: those that the next cell shares are added up before they are handed on.
struct Trail<'a> {
    ids: BrickIds<'a>,
    /// Lowest node of the cell at hand.
    local: usize,
    weights: [f64; 8],
}

impl Trail<'_> {
    /// Hand on the corners of which `bits & mask` is `side`.
    #[inline]
    fn leave(&mut self, mask: usize, side: usize, f: &mut impl FnMut(u32, f64)) {
        for k in (0..8).filter(|k| k & mask == side) {
            let (node, w) = (self.local + CORNERS[k], std::mem::take(&mut self.weights[k]));
            if w != 0.0 {
                if let Some(index) = self.ids.active(node) {
                    f(index, w);
                }
            }
        }
    }

    /// Go on to a cell.
    #[inline]
    fn go(&mut self, local: usize, f: &mut impl FnMut(u32, f64)) {
        let step = local.wrapping_sub(self.local) as isize;
        const STRIDES: [isize; 3] = [1, ROW as isize, SLAB as isize];
        match STRIDES.iter().position(|&s| s == step.abs()) {
            _ if step == 0 => {}
            Some(axis) => {
                let bit = 1 << axis;
                let (left, kept) = if step > 0 { (0, bit) } else { (bit, 0) };
                self.leave(bit, left, f);
                for k in (0..8).filter(|k| k & bit == 0) {
                    self.weights.swap(k | kept, k | left);
                }
            }
            None => self.leave(0, 0, f),
        }
        self.local = local;
    }
}

impl Grid {
    /// Integrals of the interpolation weights of active voxels over a span: `f(index, weight)`, a voxel several times. As
    /// [`Grid::integrate_nodes`] otherwise.
    pub fn integrate_active(&self, span: &Span, o: DVec3, w: DVec3, f: &mut impl FnMut(u32, f64)) {
        let Some(brick) = span.brick.index() else { return };
        let [_, ny, nz] = self.frame.dims;
        let ids = self.layout.brick(&self.frame, [brick / (ny * nz), brick / nz % ny, brick % nz]);
        // A brick of one value (or none) needs no cells.
        if ids.uniform().is_some() {
            if let Some(index) = ids.active(0) {
                f(index, span.t1 - span.t0);
            }
            return;
        }
        let ray = Ray::new(self, o, w);
        let mut trail = Trail { ids, local: 0, weights: [0.0; 8] };
        for cell in self.cells(&ray, brick, span.t0, span.t1).filter(|cell| cell.t0 < cell.t1) {
            trail.go(cell.local, f);
            let own = cell.weight_integrals(&ray, self.smooth);
            trail.weights.iter_mut().zip(own).for_each(|(a, b)| *a += b);
        }
        trail.leave(0, 0, f);
    }
}

impl<W: Whole> SpanIter<'_, W> {
    /// [`Grid::invert`] in one span of this ray; `target` > 0.
    #[inline]
    pub fn invert(&self, span: &Span, target: f64) -> Result<f64, f64> {
        if self.grid.frame.channels == 1 {
            self.grid.invert_span::<1>(&self.ray, span, 0, 0.0, target)
        } else {
            self.grid.invert_span::<3>(&self.ray, span, 0, 0.0, target)
        }
    }
}

/// Value times length, 0 for the field 0 however long the span.
#[inline(always)]
fn constant_integral(value: f64, span: &Span) -> f64 {
    if value == 0.0 { 0.0 } else { value * (span.t1 - span.t0) }
}
