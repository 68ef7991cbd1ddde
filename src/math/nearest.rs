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
