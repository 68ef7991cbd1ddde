//! Light by a chain of planes, by Fermat's principle ([T] 6.2).
//!
//! The optical length `Σ n_i |P_{i+1} - P_i|` of a way through given planes is a convex function of its points P_1 ... P_k on them, each distance being convex; light takes the ways at which it is
//! stationary. So there is at most one way by a chain of planes (but for straight lines that all lie in one of them), and Newton's method with a line search finds it from
//! anywhere; mirrors need no other treatment, the shortest way to a point on the same side of a plane being the mirrored one. For parallel rays along w the first distance is
//! `<w, P_1>`, convex as well. Whether faces have borders, and whether the light is on the right sides of them, is for rays to say.

use super::shot::{Eye, Start};
use crate::math::{DVec3, warp};
use crate::scene::Scene;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use crate::transport::ray::Specular;

/// Planes of a chain at most.
pub const PLANES: usize = 8;
const UNKNOWNS: usize = 2 * PLANES;
/// Softness of distances in falling order, over the size of the chain.
const SOFT: [f64; 10] = [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7];
/// Segments as short as this, with distances as soft as the last, vanish.
const KINK: f64 = 1e-3;

#[derive(Clone, Copy, Debug)]
struct Plane {
    p: DVec3,
    x: DVec3,
    y: DVec3,
}

/// What there is by a chain to a point.
#[derive(Clone, Copy, Debug)]
pub enum Way {
    Ray(Start),
    None,
    /// The iteration ended nowhere.
    Lost,
}

/// A chain of flat faces, without their borders.
#[derive(Clone, Debug)]
pub struct Planes {
    planes: Vec<Plane>,
    /// Index of refraction before each plane, and behind the last, relative to the first.
    index: Vec<f64>,
}

impl Planes {
    /// `None` if a face is not flat, or there are too many.
    pub fn of(scene: &Scene, chain: &[Specular]) -> Option<Planes> {
        if chain.is_empty() || chain.len() > PLANES {
            return None;
        }
        let (mut planes, mut index) = (Vec::new(), Vec::new());
        // Only ratios matter.
        let mut now = 1.0;
        for s in chain {
            let shape = &scene.shapes[s.hit.shape as usize];
            if matches!(shape.shape, Shape::Sphere(_) | Shape::Cylinder(_)) {
                return None;
            }
            let n = shape.shape.normal(s.hit.face, s.hit.p);
            let (x, y) = warp::frame(n);
            planes.push(Plane { p: s.hit.p, x, y });
            index.push(now);
            if let (true, Surface::Dielectric { interior, exterior, .. }) =
                (s.through, &scene.surfaces[shape.surface as usize])
            {
                now *= if s.w.dot(n) < 0.0 { interior / exterior } else { exterior / interior };
            }
        }
        index.push(now);
        Some(Planes { planes, index })
    }

    /// The eye's ray to e; `o`: where one of its rays starts.
    pub fn ray(&self, eye: &Eye, o: DVec3, e: DVec3) -> Way {
        let k = self.planes.len();
        let size = (e - o).length() + self.planes.iter().map(|p| (p.p - o).length()).sum::<f64>();
        let mut q = [0.0; UNKNOWNS];
        for (i, p) in self.planes.iter().enumerate() {
            let off = o.lerp(e, (i as f64 + 1.0) / (k as f64 + 1.0)) - p.p;
            (q[2 * i], q[2 * i + 1]) = (off.dot(p.x), off.dot(p.y));
        }
        // Where planes meet, distances may vanish and their sum has a kink that holds the iteration up. Softened ones, `√(d² + ε²)`, are convex and have none: then ε falls.
        // Where the least way has a segment of no length light takes no way at all.
        let begin = q;
        let mut found = self.descend(eye, o, e, &mut q, 0.0, size);
        if !found {
            q = begin;
            for soft in SOFT {
                self.descend(eye, o, e, &mut q, soft * size, size);
            }
            let soft = q;
            found = self.descend(eye, o, e, &mut q, 0.0, size);
            let length = |i: usize| {
                let (a, b) = self.segment(eye, o, e, &soft, i);
                (b - a).length()
            };
            if !found {
                return if (1..=k).any(|i| length(i) <= KINK * size) { Way::None } else { Way::Lost };
            }
        }
        let first = self.point(0, &q);
        match eye {
            Eye::Point(_) => (first - o).try_normalize().map_or(Way::None, |w| Way::Ray(Start { o, w })),
            Eye::Parallel(w) => Way::Ray(Start { o: first - *w * (first - o).dot(*w), w: *w }),
        }
    }

    /// Newton's method from `q`; whether it ends anywhere.
    fn descend(&self, eye: &Eye, o: DVec3, e: DVec3, q: &mut Vector, soft: f64, size: f64) -> bool {
        let n = 2 * self.planes.len();
        let mut length = self.length(eye, o, e, q, soft);
        for _ in 0..200 {
            let Some((gradient, mut hessian)) = self.slopes(eye, o, e, q, soft) else { return false };
            let Some(by) = solve(&mut hessian, gradient, n) else { return false };
            let step = by[..n].iter().map(|b| b * b).sum::<f64>().sqrt();
            let falls: f64 = (0..n).map(|i| gradient[i] * by[i]).sum();
            let from = *q;
            let moved = |t: f64| -> Vector { std::array::from_fn(|i| from[i] - t * by[i]) };
            let better = (0..40).map(|h| 0.5f64.powi(h)).find_map(|t| {
                let next = moved(t);
                let l = self.length(eye, o, e, &next, soft);
                (l < length - 1e-4 * t * falls).then_some((next, l))
            });
            match better {
                Some(next) => (*q, length) = next,
                // As short as rounding can tell: the step itself is still good where it is short.
                None if step <= 1e-4 * size => {
                    *q = moved(1.0);
                    return true;
                }
                None => return false,
            }
            if step <= 1e-13 * size {
                return true;
            }
        }
        false
    }

    fn point(&self, i: usize, q: &Vector) -> DVec3 {
        let p = &self.planes[i];
        p.p + p.x * q[2 * i] + p.y * q[2 * i + 1]
    }

    /// Both ends of the i-th segment; the first of parallel rays starts beside where it ends.
    fn segment(&self, eye: &Eye, o: DVec3, e: DVec3, q: &Vector, i: usize) -> (DVec3, DVec3) {
        let to = if i == self.planes.len() { e } else { self.point(i, q) };
        match (i, eye) {
            (0, Eye::Point(_)) => (o, to),
            (0, Eye::Parallel(w)) => (to - *w * (to - o).dot(*w), to),
            _ => (self.point(i - 1, q), to),
        }
    }

    fn length(&self, eye: &Eye, o: DVec3, e: DVec3, q: &Vector, soft: f64) -> f64 {
        let segment = |i: usize| {
            let (a, b) = self.segment(eye, o, e, q, i);
            let long = match (i, eye) {
                (0, Eye::Parallel(w)) => (b - o).dot(*w),
                _ => (b - a).length().hypot(soft),
            };
            self.index[i] * long
        };
        (0..self.index.len()).map(segment).sum()
    }

    /// Gradient and Hessian of the optical length.
    fn slopes(&self, eye: &Eye, o: DVec3, e: DVec3, q: &Vector, soft: f64) -> Option<(Vector, Matrix)> {
        let k = self.planes.len();
        let (mut g, mut h) = ([0.0; UNKNOWNS], [[0.0; UNKNOWNS]; UNKNOWNS]);
        for (i, &n) in self.index.iter().enumerate() {
            let (a, b) = self.segment(eye, o, e, q, i);
            let straight = i == 0 && matches!(eye, Eye::Parallel(_));
            let (u, bend) = match (straight, eye) {
                (true, Eye::Parallel(w)) => (*w, 0.0),
                _ => {
                    let d = (b - a).length().hypot(soft);
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
        Some((g, h))
    }
}

type Vector = [f64; UNKNOWNS];
type Matrix = [Vector; UNKNOWNS];

/// `h⁻¹ g` for a positive h of n rows, by Cholesky's method; `None` if it is singular.
fn solve(h: &mut Matrix, g: Vector, n: usize) -> Option<Vector> {
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
mod tests {
    use super::*;

    fn plane(p: DVec3, n: DVec3) -> Plane {
        let (x, y) = warp::frame(n.normalize());
        Plane { p, x, y }
    }

    /// Snell's law at every plane, from skew beginnings: a prism, a mirror behind glass, parallel rays.
    #[test]
    fn ways_obey_snells_law() {
        let prism = Planes {
            planes: vec![plane(DVec3::X, DVec3::new(1.0, 0.3, 0.1)), plane(DVec3::X * 2.0, DVec3::new(1.0, -0.4, 0.2))],
            index: vec![1.0, 1.6, 1.0],
        };
        let mirror = Planes {
            planes: vec![
                plane(DVec3::X, DVec3::X),
                plane(DVec3::X * 2.0, DVec3::new(1.0, 0.1, 0.0)),
                plane(DVec3::X, DVec3::X),
            ],
            index: vec![1.0, 1.5, 1.5, 1.0],
        };
        // In at one side of a block, mirrored at another that meets it, out at the far side.
        let side = DVec3::new(0.0, 0.2, 0.0);
        let block = Planes {
            planes: vec![plane(DVec3::X, DVec3::X), plane(side, DVec3::Y), plane(DVec3::X * 1.3, DVec3::X)],
            index: vec![1.0, 1.5, 1.5, 1.0],
        };
        let o = DVec3::new(-1.0, 0.2, 0.1);
        let eyes = [Eye::Point(o), Eye::Parallel(DVec3::new(1.0, 0.1, 0.05).normalize())];
        let below = DVec3::new(-1.0, -0.2, 0.1);
        let chains = [
            (&prism, o, DVec3::new(4.0, 0.6, -0.3), &eyes[..]),
            (&mirror, o, DVec3::new(-2.0, 0.9, 0.4), &eyes),
            (&block, below, DVec3::new(4.0, -0.33, -0.1), &[Eye::Point(below)]),
        ];
        // The least way goes by the line where two of its planes meet: light does not.
        assert!(matches!(block.ray(&Eye::Point(below), below, DVec3::new(4.0, -0.9, -0.3)), Way::None));
        for (chain, o, e, eyes) in chains {
            for eye in eyes {
                let Way::Ray(start) = chain.ray(eye, o, e) else { panic!() };
                // Walk it.
                let (mut at, mut w) = (start.o, start.w);
                for (i, p) in chain.planes.iter().enumerate() {
                    let n = p.x.cross(p.y);
                    let t = n.dot(p.p - at) / n.dot(w);
                    assert!(t > 0.0);
                    at += w * t;
                    let (n1, n2) = (chain.index[i], chain.index[i + 1]);
                    let tangent = (w - n * n.dot(w)) * (n1 / n2);
                    let cos = (1.0 - tangent.length_squared()).sqrt() * n.dot(w).signum();
                    w = tangent + n * if n1 == n2 { -cos } else { cos };
                }
                let miss = (e - at) - w * (e - at).dot(w);
                assert!(miss.length() < 1e-9, "{miss}");
            }
        }
    }
}
