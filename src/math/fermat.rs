//! Light by a chain of planes, by Fermat's principle ([T] 6.2).
//!
//! The optical length `Σ n_i |P_{i+1} - P_i|` of a way through given planes is a convex function of its points P_1 ... P_k on them, each distance being convex; light takes the ways at which it is
//! stationary. So there is at most one way by a chain of planes (but for straight lines that all lie in one of them), and Newton's method with a line search finds it from
//! anywhere; mirrors need no other treatment, the shortest way to a point on the same side of a plane being the mirrored one. For parallel rays along w the first distance is
//! `<w, P_1>`, convex as well. Whether faces have borders, and whether the light is on the right sides of them, is for rays to say.
//!
//! Most points are reached by no light: the least way then goes through a line or a point where planes of the chain meet, and misses the segments between them. The length has a kink
//! there, before which Newton's method sticks. That it is the least is certified by a subgradient that vanishes: with the shortest segments taken out, the points of their planes
//! held together (which has a smooth least way), there must be a "direction" of length below 1 for each missing segment so that no point moves. What is not certified is left to softened distances.

use super::fold::Fold;
use super::{DVec3, warp};
use smallvec::SmallVec;

/// Planes of a chain at most.
pub const PLANES: usize = 8;
const UNKNOWNS: usize = 2 * PLANES;
/// Softness of distances in falling order, over the size of the chain.
const SOFT: [f64; 10] = [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
/// Segments as short as this, with distances as soft as the last, vanish.
const KINK: f64 = 1e-3;
/// Normals of planes that count as parallel have a cross product as long as this.
const PARALLEL: f64 = 1e-6;
/// Distance from a plane, over the size of the chain, that is none.
const IN_PLANE: f64 = 1e-9;
/// What the length falls by, over itself, that no sum of it can tell.
const ROUNDING: f64 = 1e-15;
/// Steps after which it is asked whether the least way is far from where it has to be.
const EARLY: usize = 3;
/// The share of a step that is left where it is cut short, and how often that may be.
const SHORT: f64 = 0.125;
const PATIENCE: usize = 2;
/// Segments of this length over the size of the chain have a direction.
const LONG: f64 = 1e-6;
/// How far below 1 the length of a subgradient has to be.
const STRICT: f64 = 1e-9;

/// What holds for all rays of an eye, or of a light without extent: light takes the same way to and fro.
#[derive(Clone, Copy, Debug)]
pub enum Eye {
    /// They start here.
    Point(DVec3),
    /// They run along this unit direction.
    Parallel(DVec3),
}

/// A ray of an eye.
#[derive(Clone, Copy, Debug)]
pub struct Start {
    pub o: DVec3,
    pub w: DVec3,
}

/// A plane through p, or, where axes are zero, a line or a point.
#[derive(Clone, Copy, Debug)]
struct Plane {
    p: DVec3,
    x: DVec3,
    y: DVec3,
    /// Light is mirrored there, and does not go through.
    mirrors: bool,
}

impl Plane {
    fn normal(&self) -> DVec3 {
        self.x.cross(self.y)
    }

    /// The same, with p moved to near this point.
    fn through(&self, p: DVec3) -> Plane {
        Plane { p: p - self.normal() * self.normal().dot(p - self.p), ..*self }
    }

    /// What this line shares with a plane, in a chain of this size: a point, or all of it.
    fn meet_plane(&self, other: &Plane, size: f64) -> Option<Plane> {
        let n = other.normal();
        let (slope, off) = (n.dot(self.x), n.dot(other.p - self.p));
        if slope.abs() <= PARALLEL {
            return (off.abs() <= IN_PLANE * size).then_some(*self);
        }
        Some(Plane { p: self.p + self.x * (off / slope), x: DVec3::ZERO, y: DVec3::ZERO, mirrors: false })
    }

    /// Where two of them meet, near p.
    fn meet(&self, other: &Plane, p: DVec3) -> Option<Plane> {
        let (a, b) = (self.normal(), other.normal());
        let along = a.cross(b);
        let square = along.length_squared();
        if square <= PARALLEL * PARALLEL {
            return None;
        }
        let off = (b.cross(along) * a.dot(self.p - p) + along.cross(a) * b.dot(other.p - p)) / square;
        Some(Plane { p: p + off, x: along / square.sqrt(), y: DVec3::ZERO, mirrors: false })
    }
}

/// What there is by a chain to a point.
#[derive(Clone, Copy, Debug)]
pub enum Way<T> {
    Found(T),
    None,
    /// The iteration ended nowhere.
    Lost,
}

impl<T> Way<T> {
    fn and_then<U>(self, f: impl FnOnce(T) -> Option<U>) -> Way<U> {
        match self {
            Way::Found(t) => f(t).map_or(Way::None, Way::Found),
            Way::None => Way::None,
            Way::Lost => Way::Lost,
        }
    }
}

/// A chain of flat faces, without their borders.
#[derive(Clone, Debug)]
pub struct Planes {
    planes: SmallVec<[Plane; 4]>,
    /// Index of refraction before each plane, and behind the last, relative to the first.
    index: SmallVec<[f64; 5]>,
    onward: Onward,
}

/// To where light goes on from the last plane of a chain.
#[derive(Clone, Copy, Debug)]
pub enum Onward {
    /// To both sides: a mirror may be met from either, by the same steps.
    Both,
    /// To where this normal points. The index behind an interface says from which side it is met.
    Side(DVec3),
}

/// What Newton's method comes to.
enum End {
    Least,
    /// Of the hulls within which points have to be.
    Outside,
    Stuck,
}

impl Planes {
    /// Of some planes, [`PLANES`] at most; those points of them that a way is looked for from.
    pub fn new(folds: impl IntoIterator<Item = Fold>, onward: Onward) -> Planes {
        let (mut planes, mut index) = (SmallVec::new(), SmallVec::new());
        // Only ratios matter.
        let mut now = 1.0;
        for f in folds {
            let (x, y) = warp::frame(f.n);
            planes.push(Plane { p: f.p, x, y, mirrors: !f.through });
            index.push(now);
            if f.through {
                now *= f.index[1] / f.index[0];
            }
        }
        index.push(now);
        Planes { planes, index, onward }
    }

    /// The eye's ray to e; `o`: where one of its rays starts.
    pub fn ray(&self, eye: &Eye, o: DVec3, e: DVec3) -> Way<Start> {
        match self.planes.len() {
            0..=2 => self.least::<4>(eye, o, e, &[]).and_then(|q| self.start(eye, o, &q)),
            3..=4 => self.least::<8>(eye, o, e, &[]).and_then(|q| self.start(eye, o, &q)),
            _ => self.least::<UNKNOWNS>(eye, o, e, &[]).and_then(|q| self.start(eye, o, &q)),
        }
    }

    /// The direction in which that ray arrives, if it crosses each plane within the convex hull of some points; others may be told as well.
    pub fn arrival(&self, eye: &Eye, o: DVec3, e: DVec3, hulls: &[&[DVec3]]) -> Way<DVec3> {
        match self.planes.len() {
            0 => (e - o).try_normalize().map_or(Way::None, Way::Found),
            1..=2 => self.least::<4>(eye, o, e, hulls).and_then(|q| self.arrived(eye, o, e, &q)),
            3..=4 => self.least::<8>(eye, o, e, hulls).and_then(|q| self.arrived(eye, o, e, &q)),
            _ => self.least::<UNKNOWNS>(eye, o, e, hulls).and_then(|q| self.arrived(eye, o, e, &q)),
        }
    }

    /// Its last direction. The least way may touch an interface and turn back where both its neighbours lie on one side, or pass a mirror: light does not.
    fn arrived<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, q: &Vector<N>) -> Option<DVec3> {
        let k = self.planes.len();
        let way = |i: usize| {
            let (a, b) = self.segment(eye, o, e, q, i);
            b - a
        };
        let crosses = |i: usize| {
            let n = self.planes[i].normal();
            (way(i).dot(n) * way(i + 1).dot(n) > 0.0) != self.planes[i].mirrors
        };
        (0..k).all(crosses).then(|| way(k).try_normalize())?
    }

    /// Where it crosses the planes.
    fn least<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, hulls: &[&[DVec3]]) -> Way<Vector<N>> {
        let size = self.size(o, e);
        if !self.goes_on_to(e, size) {
            return Way::None;
        }
        // From the ray that the chain was met by, which misses no segment.
        let mut q: Vector<N> = [0.0; N];
        match self.newton(eye, o, e, &mut q, 0.0, size, PATIENCE, hulls) {
            End::Least => return Way::Found(q),
            End::Outside => return Way::None,
            End::Stuck => {}
        }
        if self.kink(eye, o, e, &q, size).is_some() {
            return Way::None;
        }
        self.softly(eye, o, e, size)
    }

    /// Whether no point of the hulls is the least: the length is convex, so that where it is less its gradient points away.
    fn is_outside<const N: usize>(&self, q: &Vector<N>, gradient: &Vector<N>, hulls: &[&[DVec3]], slack: f64) -> bool {
        let toward = |i: usize| {
            let (p, at) = (&self.planes[i], self.point(i, q));
            let slope = p.x * gradient[2 * i] + p.y * gradient[2 * i + 1];
            hulls[i].iter().map(|c| slope.dot(*c - at)).fold(f64::INFINITY, f64::min)
        };
        !hulls.is_empty() && (0..self.planes.len()).map(toward).sum::<f64>() > slack
    }

    /// Where the eye's ray to e crosses the planes; `None` where it is not found at once.
    pub fn crossings(&self, eye: &Eye, o: DVec3, e: DVec3) -> Option<Vec<DVec3>> {
        let size = self.size(o, e);
        let mut q: Vector<UNKNOWNS> = [0.0; UNKNOWNS];
        let found = self.goes_on_to(e, size) && self.dive(eye, o, e, &mut q, size);
        found.then(|| (0..self.planes.len()).map(|i| self.point(i, &q)).collect())
    }

    /// Of a chain to e.
    fn size(&self, o: DVec3, e: DVec3) -> f64 {
        (e - o).length() + self.planes.iter().map(|p| (p.p - o).length()).sum::<f64>()
    }

    /// Nothing goes on to what lies in the last plane, as the edges of its own face do, or before it.
    fn goes_on_to(&self, e: DVec3, size: f64) -> bool {
        let Some(last) = self.planes.last() else { return false };
        let off = e - last.p;
        match self.onward {
            Onward::Both => last.normal().dot(off).abs() > IN_PLANE * size,
            Onward::Side(n) => n.dot(off) > IN_PLANE * size,
        }
    }

    /// [`Self::least`] where no kink is certified. Where planes meet, distances may vanish and their sum has a kink that holds the iteration up. Softened ones, `√(d² + ε²)`, are convex and have none: then ε falls.
    /// Where the least way has a segment of no length light takes no way at all.
    // Out of line: rare, and its arrays would lie on the stack of every call of `least`.
    #[inline(never)]
    fn softly<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, size: f64) -> Way<Vector<N>> {
        let k = self.planes.len();
        let mut q: Vector<N> = [0.0; N];
        for (i, p) in self.planes.iter().enumerate() {
            let off = o.lerp(e, (i as f64 + 1.0) / (k as f64 + 1.0)) - p.p;
            (q[2 * i], q[2 * i + 1]) = (off.dot(p.x), off.dot(p.y));
        }
        for soft in SOFT {
            self.descend(eye, o, e, &mut q, soft * size, size);
        }
        let soft = q;
        if self.descend(eye, o, e, &mut q, 0.0, size) {
            return Way::Found(q);
        }
        let length = |i: usize| {
            let (a, b) = self.segment(eye, o, e, &soft, i);
            (b - a).length()
        };
        if (1..=k).any(|i| length(i) <= KINK * size) { Way::None } else { Way::Lost }
    }

    /// The ray by these points.
    fn start<const N: usize>(&self, eye: &Eye, o: DVec3, q: &Vector<N>) -> Option<Start> {
        let first = self.point(0, q);
        match eye {
            Eye::Point(_) => (first - o).try_normalize().map(|w| Start { o, w }),
            Eye::Parallel(w) => Some(Start { o: first - *w * (first - o).dot(*w), w: *w }),
        }
    }

    /// Points of the least way on each plane, where it misses segments. It is found from where the iteration stuck: the shortest segments are taken out, their planes' points held together, until
    /// the rest has a least way. The length is convex, so that this is the least of all if 0 is a subgradient there. `None`: not certified.
    #[inline(never)]
    fn kink<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, stuck: &Vector<N>, size: f64) -> Option<Vec<DVec3>> {
        let k = self.planes.len();
        let mut at: Vec<DVec3> = (0..k).map(|i| self.point(i, stuck)).collect();
        let mut groups: Vec<[usize; 2]> = (0..k).map(|i| [i, i]).collect();
        while groups.len() > 1 {
            let between = |j: &usize| (at[groups[j + 1][0]] - at[groups[*j][0]]).length();
            let mut shortest: Vec<usize> = (0..groups.len() - 1).collect();
            shortest.sort_by(|i, j| between(i).total_cmp(&between(j)));
            // Two that meet nowhere stay apart.
            let merged = |j: usize| {
                let mut fewer = groups.clone();
                fewer[j][1] = fewer.remove(j + 1)[1];
                self.held_together(&fewer, &at, size).map(|less| (fewer, less))
            };
            let (fewer, less) = shortest.into_iter().find_map(merged)?;
            groups = fewer;
            let mut q: Vector<N> = [0.0; N];
            let least = less.dive(eye, o, e, &mut q, size);
            for (j, g) in groups.iter().enumerate() {
                at[g[0]..=g[1]].fill(less.point(j, &q));
            }
            let ways = (0..=groups.len()).map(|j| match (j, eye) {
                (0, Eye::Parallel(w)) => Some(*w),
                _ => {
                    let (a, b) = less.segment(eye, o, e, &q, j);
                    ((b - a).length() > LONG * size).then(|| (b - a).normalize())
                }
            });
            // Short ones have no direction: they may be missed as well.
            let Some(ways) = ways.collect::<Option<Vec<_>>>().filter(|_| least) else { continue };
            let held = groups.iter().enumerate().all(|(j, g)| self.is_held(*g, ways[j], ways[j + 1]));
            return held.then_some(at);
        }
        None
    }

    /// The chain where the points of each group of planes (first, last) are one, on what the planes share; begins near `at`.
    fn held_together(&self, groups: &[[usize; 2]], at: &[DVec3], size: f64) -> Option<Planes> {
        let shared = |&[a, b]: &[usize; 2]| match b - a {
            0 => Some(self.planes[a].through(at[a])),
            1 => self.planes[a].meet(&self.planes[b], at[a].midpoint(at[b])),
            2 => self.planes[a].meet(&self.planes[a + 1], at[a])?.meet_plane(&self.planes[b], size),
            _ => None,
        };
        let planes = groups.iter().map(shared).collect::<Option<_>>()?;
        let index = groups.iter().map(|g| self.index[g[0]]).chain(self.index.last().copied()).collect();
        Some(Planes { planes, index, onward: Onward::Both })
    }

    /// Whether the points of a group do not part, pulled at from both sides along `from` and `to`: each vanished segment can have a "direction" v, `|v| < 1`, so that no end of it moves.
    fn is_held(&self, [a, b]: [usize; 2], from: DVec3, to: DVec3) -> bool {
        let (first, last) = (self.planes[a].normal(), self.planes[b].normal());
        let (into, out) = (self.index[a + 1], self.index[b]);
        // What v is along the first and the last plane.
        let flat = |v: DVec3, n: DVec3| v - n * n.dot(v);
        let g = flat(from, first) * (self.index[a] / into);
        let h = flat(to, last) * (self.index[b + 1] / out);
        match b - a {
            0 => true,
            // One v: what it is across the first plane follows from the second.
            1 => {
                let line = first.cross(last).normalize();
                let n = line.cross(last);
                (g + first * ((h - g).dot(n) / first.dot(n))).length() < 1.0 - STRICT
            }
            // Two, `v = g + s first` and `h + t last`, |s| and |t| within what keeps them short, which pull alike along the plane between: `s u - t v = off` there.
            2 => {
                let mid = self.planes[a + 1].normal();
                let (u, v) = (flat(first, mid) * into, flat(last, mid) * out);
                let off = flat(h * out - g * into, mid);
                let free = |v: DVec3| (1.0 - STRICT) * (1.0 - v.length_squared()).sqrt();
                let cross = |a: DVec3, b: DVec3| mid.dot(a.cross(b));
                let det = cross(u, v);
                // All three have a line in common, and across it one equation is left.
                if det.abs() <= PARALLEL * into * out {
                    let longer = if u.length_squared() > v.length_squared() { u } else { v };
                    let Some(across) = longer.try_normalize() else { return false };
                    let rest = (off - across * off.dot(across)).length();
                    let most = u.dot(across).abs() * free(g) + v.dot(across).abs() * free(h);
                    return rest <= PARALLEL * (into + out) && off.dot(across).abs() < most;
                }
                (cross(off, v) / det).abs() < free(g) && (cross(off, u) / det).abs() < free(h)
            }
            _ => false,
        }
    }

    /// [`Self::descend`] without softness and without patience: given up where steps have to be cut short again and again, as they do before a kink.
    fn dive<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, q: &mut Vector<N>, size: f64) -> bool {
        matches!(self.newton(eye, o, e, q, 0.0, size, PATIENCE, &[]), End::Least)
    }

    /// Newton's method from `q`, to the end; whether there is one.
    fn descend<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, q: &mut Vector<N>, soft: f64, size: f64) -> bool {
        matches!(self.newton(eye, o, e, q, soft, size, usize::MAX, &[]), End::Least)
    }

    #[allow(clippy::too_many_arguments)]
    fn newton<const N: usize>(
        &self,
        eye: &Eye,
        o: DVec3,
        e: DVec3,
        q: &mut Vector<N>,
        soft: f64,
        size: f64,
        mut patience: usize,
        hulls: &[&[DVec3]],
    ) -> End {
        let n = 2 * self.planes.len();
        let mut length = self.length(eye, o, e, q, soft);
        for k in 0..200 {
            let Some((gradient, mut hessian)) = self.slopes(eye, o, e, q, soft) else { return End::Stuck };
            let Some(by) = solve(&mut hessian, gradient, n) else { return End::Stuck };
            let step = by[..n].iter().map(|b| b * b).sum::<f64>().sqrt();
            let falls: f64 = (0..n).map(|i| gradient[i] * by[i]).sum();
            let from = *q;
            // Of soft lengths no more is asked than where to begin.
            let close = if soft > 0.0 { 0.1 * soft } else { 1e-13 * size };
            let moved = |t: f64| -> Vector<N> { std::array::from_fn(|i| from[i] - t * by[i]) };
            // Where the least is far outside of the hulls, the slope halfway to it says so.
            if k < EARLY && !hulls.is_empty() {
                let halfway = moved(0.5);
                let slope = self.gradient(eye, o, e, &halfway);
                if slope.is_some_and(|g| self.is_outside(&halfway, &g, hulls, IN_PLANE * length)) {
                    return End::Outside;
                }
            }
            // As little as rounding can tell: a short step is still good.
            if falls <= ROUNDING * length && step <= 1e-4 * size {
                *q = moved(1.0);
                return End::Least;
            }
            let better = std::iter::successors(Some(1.0), |t| Some(0.5 * t)).take(40).find_map(|t| {
                let next = moved(t);
                let l = self.length(eye, o, e, &next, soft);
                (l < length - 1e-4 * t * falls).then_some((next, l, t))
            });
            match better {
                Some((_, _, t)) if t <= SHORT && patience == 0 => return End::Stuck,
                Some((next, l, t)) => {
                    (*q, length) = (next, l);
                    patience -= usize::from(t <= SHORT);
                }
                None if step <= 1e-4 * size => {
                    *q = moved(1.0);
                    return End::Least;
                }
                None => return End::Stuck,
            }
            if step <= close {
                return End::Least;
            }
        }
        End::Stuck
    }

    fn point<const N: usize>(&self, i: usize, q: &Vector<N>) -> DVec3 {
        let p = &self.planes[i];
        p.p + p.x * q[2 * i] + p.y * q[2 * i + 1]
    }

    /// Both ends of the i-th segment; the first of parallel rays starts beside where it ends.
    fn segment<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, q: &Vector<N>, i: usize) -> (DVec3, DVec3) {
        let to = if i == self.planes.len() { e } else { self.point(i, q) };
        match (i, eye) {
            (0, Eye::Point(_)) => (o, to),
            (0, Eye::Parallel(w)) => (to - *w * (to - o).dot(*w), to),
            _ => (self.point(i - 1, q), to),
        }
    }

    fn length<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, q: &Vector<N>, soft: f64) -> f64 {
        let segment = |i: usize| {
            let (a, b) = self.segment(eye, o, e, q, i);
            let long = match (i, eye) {
                (0, Eye::Parallel(w)) => (b - o).dot(*w),
                _ => ((b - a).length_squared() + soft * soft).sqrt(),
            };
            self.index[i] * long
        };
        (0..self.index.len()).map(segment).sum()
    }

    /// Gradient of the optical length.
    fn gradient<const N: usize>(&self, eye: &Eye, o: DVec3, e: DVec3, q: &Vector<N>) -> Option<Vector<N>> {
        let k = self.planes.len();
        let mut g = [0.0; N];
        for (i, &n) in self.index.iter().enumerate() {
            let (a, b) = self.segment(eye, o, e, q, i);
            let u = match (i, eye) {
                (0, Eye::Parallel(w)) => *w,
                _ => (b - a).try_normalize()?,
            };
            let ends = [i.checked_sub(1).map(|j| (j, -n)), (i < k).then_some((i, n))];
            for (j, n) in ends.into_iter().flatten() {
                g[2 * j] += n * u.dot(self.planes[j].x);
                g[2 * j + 1] += n * u.dot(self.planes[j].y);
            }
        }
        Some(g)
    }

    /// Gradient and Hessian of the optical length.
    fn slopes<const N: usize>(
        &self,
        eye: &Eye,
        o: DVec3,
        e: DVec3,
        q: &Vector<N>,
        soft: f64,
    ) -> Option<(Vector<N>, Matrix<N>)> {
        let k = self.planes.len();
        let (mut g, mut h) = ([0.0; N], [[0.0; N]; N]);
        for (i, &n) in self.index.iter().enumerate() {
            let (a, b) = self.segment(eye, o, e, q, i);
            let straight = i == 0 && matches!(eye, Eye::Parallel(_));
            let (u, bend) = match (straight, eye) {
                (true, Eye::Parallel(w)) => (*w, 0.0),
                _ => {
                    let d = ((b - a).length_squared() + soft * soft).sqrt();
                    if d == 0.0 {
                        return None;
                    }
                    ((b - a) / d, n / d)
                }
            };
            // The planes at its ends, with the sign of what the distance does.
            let ends = [i.checked_sub(1).map(|j| (j, -1.0)), (i < k).then_some((i, 1.0))];
            for (j, sign) in ends.into_iter().flatten() {
                let axes = [self.planes[j].x, self.planes[j].y];
                for (c, x) in axes.iter().enumerate() {
                    g[2 * j + c] += n * sign * u.dot(*x);
                    for (m, other) in ends.into_iter().flatten() {
                        let theirs = [self.planes[m].x, self.planes[m].y];
                        for (d, y) in theirs.iter().enumerate() {
                            h[2 * j + c][2 * m + d] += bend * sign * other * (x.dot(*y) - u.dot(*x) * u.dot(*y));
                        }
                    }
                }
            }
        }
        // Lines have one unknown, points none.
        for (j, p) in self.planes.iter().enumerate() {
            for (c, _) in [p.x, p.y].iter().enumerate().filter(|(_, x)| **x == DVec3::ZERO) {
                h[2 * j + c][2 * j + c] = 1.0;
            }
        }
        Some((g, h))
    }
}

/// Two unknowns a plane; N is at least as many, and small chains have small matrices.
type Vector<const N: usize> = [f64; N];
type Matrix<const N: usize> = [[f64; N]; N];

/// `h⁻¹ g` for a positive h of n rows, by Cholesky's method; `None` if it is singular.
fn solve<const N: usize>(h: &mut Matrix<N>, g: Vector<N>, n: usize) -> Option<Vector<N>> {
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = h[i][j] - (0..j).map(|k| h[i][k] * h[j][k]).sum::<f64>();
            if i == j && sum <= 0.0 {
                return None;
            }
            h[i][j] = if i == j { sum.sqrt() } else { sum / h[j][j] };
        }
    }
    let mut x = g;
    for i in 0..n {
        x[i] = (x[i] - (0..i).map(|k| h[i][k] * x[k]).sum::<f64>()) / h[i][i];
    }
    for i in (0..n).rev() {
        x[i] = (x[i] - (i + 1..n).map(|k| h[k][i] * x[k]).sum::<f64>()) / h[i][i];
    }
    x.iter().all(|v| v.is_finite()).then_some(x)
}

#[cfg(test)]
#[path = "fermat_tests.rs"]
mod tests;
