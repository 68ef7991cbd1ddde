//! Light's way from a point through planes: refracted at some, mirrored at others ([T] 6.2, (44) for any number of planes).
//!
//! What lies before a mirror is folded over it, so that light goes straight on. What is left, planes that refract, has one solution: by Fermat light takes the shortest optical path
//! `F = Σ n_i |P_{i+1} - P_i|` over points P_i of the planes, and F is strictly convex in them together (a sum of norms of affine functions), so that Newton's method with steps that descend finds the
//! only stationary point there is. Where the least path passes through the line in which two planes meet, a piece of no length, F has a kink there, and no light goes that way.

use super::fresnel::{Interface, reflect};
use super::warp::frame;
use super::{DVec3, V3};
use smallvec::SmallVec;

/// How steep the path may be, over what it is made of, where Newton's steps need no check.
const NEAR: f64 = 1e-7;
/// Least lengths of pieces, over the size of the way, one after the other.
const SMOOTHING: [f64; 10] = [0.3, 0.1, 0.03, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8];
/// A piece this short at the last of them is none: a kink. Shares of a step below the least do not leave one.
const KINK: f64 = 1e-7;
const LEAST_STEP: f64 = 1e-12;
const STEPS: usize = 300;
/// Planes at most.
pub const MOST: usize = 4;
const N: usize = 2 * MOST;

/// A plane on the way.
#[derive(Clone, Copy, Debug)]
pub struct Fold {
    pub p: DVec3,
    pub n: DVec3,
    pub through: bool,
    /// Indices of refraction before and behind it; those of a mirror do not matter.
    pub index: [f64; 2],
}

impl Fold {
    /// The direction of light behind the plane that travels along w before it; `None` in total reflection.
    pub fn behind(&self, w: DVec3) -> Option<DVec3> {
        if !self.through {
            return Some(reflect(w, self.n));
        }
        let side = if w.dot(self.n) < 0.0 { self.n } else { -self.n };
        let i = Interface::new(-w.dot(side), self.index[0], self.index[1]);
        Some(i.refract(V3::constant(w), V3::constant(side))?.value().normalize())
    }
}

fn mirrored(x: DVec3, p: DVec3, n: DVec3) -> DVec3 {
    x - n * (2.0 * (x - p).dot(n))
}

/// Solve `H s = -g` for a symmetric positive definite H (Cholesky); `None` where it is not.
fn solve(h: &[[f64; N]; N], g: &[f64; N], n: usize) -> Option<[f64; N]> {
    let mut l = [[0.0; N]; N];
    for i in 0..n {
        for j in 0..=i {
            let rest = h[i][j] - (0..j).map(|k| l[i][k] * l[j][k]).sum::<f64>();
            l[i][j] = if i == j { (rest > 0.0).then(|| rest.sqrt())? } else { rest / l[j][j] };
        }
    }
    let mut s = [0.0; N];
    for i in 0..n {
        s[i] = (-g[i] - (0..i).map(|k| l[i][k] * s[k]).sum::<f64>()) / l[i][i];
    }
    for i in (0..n).rev() {
        s[i] = (s[i] - (i + 1..n).map(|k| l[k][i] * s[k]).sum::<f64>()) / l[i][i];
    }
    Some(s)
}

/// What a search came to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Arrival {
    /// The direction of the light at its end.
    Along(DVec3),
    /// No light goes that way.
    Never,
    /// The search did not settle: to be counted.
    Unsettled,
}

/// Direction in which light from `q` that meets these planes in turn arrives at `x`; whether it meets them from the right sides, and within faces, is for others to say.
pub fn arrival(q: DVec3, planes: &[Fold], x: DVec3) -> Arrival {
    let mut q = q;
    let mut list: SmallVec<[(DVec3, DVec3); MOST]> = SmallVec::new();
    let mut index: SmallVec<[f64; MOST]> = SmallVec::new();
    // Snell's law knows ratios only.
    let mut last = 1.0;
    index.push(last);
    for s in planes {
        if s.through {
            list.push((s.p, s.n));
            last *= s.index[1] / s.index[0];
            index.push(last);
            continue;
        }
        q = mirrored(q, s.p, s.n);
        for (p, n) in &mut list {
            (*p, *n) = (mirrored(*p, s.p, s.n), mirrored(*n, DVec3::ZERO, s.n));
        }
    }
    let m = list.len();
    if m == 0 {
        return if x == q { Arrival::Never } else { Arrival::Along((x - q).normalize()) };
    }
    let start: Points = (0..m)
        .map(|k| {
            let at = q + (x - q) * ((k + 1) as f64 / (m + 1) as f64);
            at - list[k].1 * (at - list[k].0).dot(list[k].1)
        })
        .collect();
    let frames = list.iter().map(|l| frame(l.1).into()).collect();
    let path = Path { ends: [q, x], index, frames };
    // At a kink steps may get stuck: then they come to it from smoother paths.
    let size = (x - q).length() + start.iter().map(|p| (*p - q).length()).fold(0.0, f64::max);
    let gently = || SMOOTHING.iter().try_fold(start.clone(), |p, s| path.descend(p, s * size));
    let short = |points: &Points| (0..=m).any(|k| path.piece(points, k, 0.0).1 <= KINK * size);
    let end = |points: Points| if short(&points) { Ok(points) } else { path.descend(points, 0.0) };
    let found = path.descend(start.clone(), 0.0).or_else(|_| gently().and_then(end));
    let (points, settled) = match &found {
        Ok(points) => (points, true),
        Err(points) => (points, false),
    };
    // Snell's law is about what is along a plane: light also has to pass to its other side.
    let passes = |k: usize| {
        let [a, b] = [k, k + 1].map(|piece| path.piece(points, piece, 0.0).0.dot(list[k].1));
        a * b > 0.0
    };
    if short(points) || settled && !(0..m).all(passes) {
        return Arrival::Never;
    }
    let d = (x - points[m - 1]).normalize();
    if settled && d.is_finite() { Arrival::Along(d) } else { Arrival::Unsettled }
}

type Points = SmallVec<[DVec3; MOST]>;

/// Planes that refract.
struct Path {
    ends: [DVec3; 2],
    index: SmallVec<[f64; MOST]>,
    frames: SmallVec<[[DVec3; 2]; MOST]>,
}

impl Path {
    /// The `k`th piece, and its length as if it were at least `smooth`.
    fn piece(&self, points: &[DVec3], k: usize, smooth: f64) -> (DVec3, f64) {
        let a = if k == 0 { self.ends[0] } else { points[k - 1] };
        let b = if k == points.len() { self.ends[1] } else { points[k] };
        (b - a, ((b - a).length_squared() + smooth * smooth).sqrt())
    }

    fn whole(&self, points: &[DVec3], smooth: f64) -> f64 {
        (0..=points.len()).map(|k| self.index[k] * self.piece(points, k, smooth).1).sum()
    }

    /// The lowest points; those that it came to where it got stuck.
    fn descend(&self, mut points: Points, smooth: f64) -> Result<Points, Points> {
        let m = points.len();
        let weight = self.index.iter().sum::<f64>();
        let mut before = f64::INFINITY;
        for _ in 0..STEPS {
            let (mut g, mut h) = ([0.0; N], [[0.0; N]; N]);
            for k in 0..=m {
                let (d, length) = self.piece(&points, k, smooth);
                if length == 0.0 {
                    return Err(points);
                }
                let (e, n) = (d / length, self.index[k]);
                // Of the plane at its start, and at its end: number, and sign.
                let sides = [(k.checked_sub(1), -1.0), ((k < m).then_some(k), 1.0)];
                for (i, si) in sides.iter().filter_map(|&(i, s)| i.map(|i| (i, s))) {
                    for (u, t) in self.frames[i].iter().enumerate() {
                        g[2 * i + u] += si * n * e.dot(*t);
                        for (j, sj) in sides.iter().filter_map(|&(j, s)| j.map(|j| (j, s))) {
                            for (v, r) in self.frames[j].iter().enumerate() {
                                let across = t.dot(*r) - e.dot(*t) * e.dot(*r);
                                h[2 * i + u][2 * j + v] += si * sj * n / length * across;
                            }
                        }
                    }
                }
            }
            let n = 2 * m;
            let steep = g[..n].iter().fold(0.0f64, |a, b| a.max(b.abs()));
            // Near the end whole steps double the digits; where they bring no more rounding is all that is left.
            let near = steep <= NEAR * weight;
            if steep <= 4.0 * f64::EPSILON * weight || near && steep >= before {
                return Ok(points);
            }
            before = steep;
            let Some(s) = solve(&h, &g, n) else { return Err(points) };
            let moved = |t: f64| -> Points {
                (0..m)
                    .map(|k| points[k] + (self.frames[k][0] * s[2 * k] + self.frames[k][1] * s[2 * k + 1]) * t)
                    .collect()
            };
            if near {
                points = moved(1.0);
                continue;
            }
            let slope: f64 = (0..n).map(|i| g[i] * s[i]).sum();
            let now = self.whole(&points, smooth);
            let mut t = 1.0;
            points = loop {
                let next = moved(t);
                // Armijo's rule, but for rounding.
                if self.whole(&next, smooth) <= now + 1e-4 * t * slope + 4.0 * f64::EPSILON * now {
                    break next;
                }
                t *= 0.5;
                if t < LEAST_STEP {
                    return Err(points);
                }
            };
        }
        if before <= NEAR * weight { Ok(points) } else { Err(points) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    /// Rays are traced through random planes; from where they end the way back is found.
    #[test]
    fn finds_the_rays_it_is_given() {
        let mut rng = Rng::keyed(3, Purpose::Motion as u64, 0, 0);
        let (mut found, mut mirrors) = (0, 0);
        for _ in 0..4000 {
            let unit = |rng: &mut Rng| crate::math::warp::sphere(rng.uniform(), rng.uniform());
            let q = unit(&mut rng) * 2.0;
            let (mut p, mut w) = (q, unit(&mut rng));
            let mut planes: Vec<Fold> = Vec::new();
            let mut index = 1.0 + rng.uniform();
            for _ in 0..1 + (rng.uniform() * 4.0) as usize {
                p += w * (0.2 + rng.uniform());
                let n = unit(&mut rng);
                let through = rng.uniform() < 0.7;
                let behind = if through { 1.0 + rng.uniform() } else { index };
                let side = if n.dot(w) < 0.0 { n } else { -n };
                let c = -side.dot(w);
                if c < 0.1 {
                    continue;
                }
                let next = if through {
                    Interface::new(c, index, behind).refract(V3::constant(w), V3::constant(side)).map(|v| v.value())
                } else {
                    Some(reflect(w, n))
                };
                let Some(next) = next.filter(|v: &DVec3| v.dot(n).abs() > 0.1) else { continue };
                // The plane is named by another point of it.
                let (a, _) = frame(n);
                planes.push(Fold {
                    p: p + a * rng.uniform(),
                    n,
                    through,
                    index: if through { [index, behind] } else { [1.0; 2] },
                });
                mirrors += usize::from(!through);
                (w, index) = (next.normalize(), behind);
            }
            let x = p + w * (0.2 + rng.uniform());
            let Arrival::Along(d) = arrival(q, &planes, x) else { panic!("{planes:?}") };
            assert!((d - w).length() < 1e-7, "{planes:?}: {d} {w}");
            found += usize::from(planes.len() > 1);
        }
        assert!(found > 1500 && mirrors > 500, "{found} {mirrors}");
    }
}
