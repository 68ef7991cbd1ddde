//! Nearest points of segments, triangles and parallelograms, those without length or area included.
//!
//! Every answer is a point of the figure to rounding, never the foot on a plane that the figure does not reach. Its distance is the
//! least to rounding too; where two candidates are equally near but for rounding, either is the answer.

use super::DVec3;

/// Squared sine of the angle between edges from which on coordinates in them are good to a thousand roundings.
const SURE: f64 = 1e-6;

/// The nearest of candidate offsets from the query point.
struct Offset {
    offset: DVec3,
    squared: f64,
}

impl Offset {
    fn new(offset: DVec3) -> Self {
        Offset { offset, squared: offset.length_squared() }
    }

    fn offer(&mut self, offset: DVec3) {
        let candidate = Offset::new(offset);
        if candidate.squared < self.squared {
            *self = candidate;
        }
    }
}

/// Of the segment from `a` to `a + e`, nearest to the origin. The first end where the segment is a point.
#[inline]
fn segment(a: DVec3, e: DVec3) -> DVec3 {
    let squared = e.length_squared();
    if squared > 0.0 { a + e * (-a.dot(e) / squared).clamp(0.0, 1.0) } else { a }
}

/// Distance from `p` to the segment from `a` to `b`.
pub fn to_segment(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    segment(a - p, b - a).length()
}

/// Distance between two segments.
fn between_segments([a, b]: [DVec3; 2], [c, d]: [DVec3; 2]) -> f64 {
    let n = (b - a).cross(d - c);
    let area2 = n.length_squared();
    // Where both are nearest to each other between their ends.
    let [s, t] = [d - c, b - a].map(|e| (c - a).cross(e).dot(n) / area2);
    let inner = (0.0..=1.0).contains(&s) && (0.0..=1.0).contains(&t);
    let between = if inner { (a + (b - a) * s - (c + (d - c) * t)).length() } else { f64::INFINITY };
    let ends = [to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)];
    ends.into_iter().fold(between, f64::min)
}

/// Distance between two triangles; 0, but for rounding, where they pass through each other.
pub fn between_triangles(p: [DVec3; 3], q: [DVec3; 3]) -> f64 {
    let edges = |t: [DVec3; 3]| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]];
    let to = |x: DVec3, t: [DVec3; 3]| x.distance(on_triangle(x, t));
    // From the corners of one, and from where its edges meet the plane of the other.
    let from = |p: [DVec3; 3], q: [DVec3; 3]| {
        let n = (q[1] - q[0]).cross(q[2] - q[0]);
        let pierces = edges(p).into_iter().filter_map(move |[a, b]| {
            let [h, k] = [a, b].map(|x| n.dot(x - q[0]));
            ((h < 0.0) != (k < 0.0)).then(|| to(a + (b - a) * (h / (h - k)), q))
        });
        p.into_iter().map(move |x| to(x, q)).chain(pierces).fold(f64::INFINITY, f64::min)
    };
    let mut least = from(p, q).min(from(q, p));
    for e in edges(p) {
        for g in edges(q) {
            least = least.min(between_segments(e, g));
        }
    }
    least
}

/// The foot of the origin on a plane figure of corner `a` and edges `e1`, `e2`, as an offset.
enum Foot {
    Outside,
    /// On the figure: no other point of it is as near.
    Sure(DVec3),
    /// On the figure, where ill-conditioned edges put it: a candidate.
    Rough(DVec3),
}

/// `inside`: whether coordinates in (e1, e2), which are NaN or infinite where the edges span no plane, are of the figure.
#[inline]
fn foot(a: DVec3, e1: DVec3, e2: DVec3, inside: impl Fn(f64, f64) -> bool) -> Foot {
    let n = e1.cross(e2);
    let area2 = n.length_squared();
    let (s, t) = (e2.cross(a).dot(n) / area2, a.cross(e1).dot(n) / area2);
    if !inside(s, t) {
        Foot::Outside
    } else if area2 > SURE * e1.length_squared() * e2.length_squared() {
        Foot::Sure(a + e1 * s + e2 * t)
    } else {
        Foot::Rough(a + e1 * s + e2 * t)
    }
}

/// The nearest of a figure's sides, or its foot.
#[inline]
fn nearest(foot: Foot, sides: &[(DVec3, DVec3)]) -> DVec3 {
    let mut best = match foot {
        Foot::Sure(offset) => return offset,
        Foot::Rough(offset) => Offset::new(offset),
        Foot::Outside => Offset { offset: sides[0].0, squared: f64::INFINITY },
    };
    sides.iter().for_each(|&(a, e)| best.offer(segment(a, e)));
    best.offset
}

/// The point of a triangle nearest to `p`.
#[inline]
pub fn on_triangle(p: DVec3, [v0, v1, v2]: [DVec3; 3]) -> DVec3 {
    let (a, e1, e2) = (v0 - p, v1 - v0, v2 - v0);
    let foot = foot(a, e1, e2, |s, t| s >= 0.0 && t >= 0.0 && s + t <= 1.0);
    p + nearest(foot, &[(a, e1), (a, e2), (v1 - p, v2 - v1)])
}

/// Unit vectors `t` of which `Σ t tᵀ` is the derivative of [`on_triangle`] by `p`: two in its plane where the nearest point is inside, one along
/// the side that it is on, none at a corner (zeros).
pub fn along_triangle(p: DVec3, [v0, v1, v2]: [DVec3; 3]) -> [DVec3; 2] {
    let (a, e1, e2) = (v0 - p, v1 - v0, v2 - v0);
    let inside = || {
        let t = e1.normalize();
        [t, e1.cross(e2).cross(e1).normalize()]
    };
    let mut best = match foot(a, e1, e2, |s, t| s >= 0.0 && t >= 0.0 && s + t <= 1.0) {
        Foot::Sure(_) => return inside(),
        Foot::Rough(offset) => (offset.length_squared(), inside()),
        Foot::Outside => (f64::INFINITY, [DVec3::ZERO; 2]),
    };
    for (a, e) in [(a, e1), (a, e2), (v1 - p, v2 - v1)] {
        let squared = segment(a, e).length_squared();
        if squared < best.0 {
            let t = -a.dot(e);
            let on = t > 0.0 && t < e.length_squared();
            best = (squared, [if on { e.normalize() } else { DVec3::ZERO }, DVec3::ZERO]);
        }
    }
    best.1
}

/// Squared cosine of the angle between edges that are orthogonal but for rounding.
const SQUARE: f64 = 1e-30;

/// The point of the parallelogram of corner `v` and edges `e1`, `e2` nearest to `p`.
#[inline]
pub fn on_parallelogram(p: DVec3, v: DVec3, e1: DVec3, e2: DVec3) -> DVec3 {
    let a = v - p;
    let (l1, l2) = (e1.length_squared(), e2.length_squared());
    if l1 > 0.0 && l2 > 0.0 && e1.dot(e2).powi(2) <= SQUARE * l1 * l2 {
        // A rectangle: its coordinates are apart.
        let [s, t] = [-a.dot(e1) / l1, -a.dot(e2) / l2].map(|s| s.clamp(0.0, 1.0));
        return p + (a + e1 * s + e2 * t);
    }
    let foot = foot(a, e1, e2, |s, t| s.min(t) >= 0.0 && s.max(t) <= 1.0);
    p + nearest(foot, &[(a, e1), (a, e2), (a + e2, e1), (a + e1, e2)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    /// Against the least distance between points of both, of which there are many.
    #[test]
    fn triangles_are_as_far_apart_as_their_points() {
        let mut rng = Rng::keyed(3, 0, 0, 0);
        let mut point = || DVec3::from_array([0; 3].map(|_| rng.uniform()));
        for k in 0..200 {
            let p: [DVec3; 3] = std::array::from_fn(|_| point());
            let off = if k % 2 == 0 { DVec3::ZERO } else { DVec3::X * 0.7 };
            let q: [DVec3; 3] = std::array::from_fn(|_| point() + off);
            let exact = between_triangles(p, q);
            let n = 40;
            let mut least = f64::INFINITY;
            for i in 0..=n {
                for j in 0..=n - i {
                    let [u, v] = [i, j].map(|x| f64::from(x) / f64::from(n));
                    let x = p[0] + (p[1] - p[0]) * u + (p[2] - p[0]) * v;
                    least = least.min(x.distance(on_triangle(x, q)));
                }
            }
            assert!(least >= exact - 1e-12 && least < exact + 0.05, "{k}: {least} {exact}");
            assert_eq!(exact, between_triangles(q, p));
        }
    }

    #[test]
    fn triangles_that_pass_through_each_other_have_no_distance() {
        let flat = [DVec3::ZERO, DVec3::X * 4.0, DVec3::Y * 4.0];
        let upright = [DVec3::new(1.0, 1.0, -1.0), DVec3::new(1.0, 1.0, 1.0), DVec3::new(1.2, 1.0, 0.0)];
        assert!(between_triangles(flat, upright) < 1e-15);
        // One lies on the other, their edges apart.
        let on = [DVec3::new(1.0, 1.0, 0.0), DVec3::new(1.1, 1.0, 0.0), DVec3::new(1.0, 1.1, 0.0)];
        assert_eq!(between_triangles(flat, on), 0.0);
        assert_eq!(between_triangles(flat, on.map(|x| x + DVec3::Z * 0.5)), 0.5);
    }
}
