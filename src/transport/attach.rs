//! Points beside the first vertex of a path.
//!
//! The film holds the first vertex x, so it moves otherwise than matter near by, by as much as it likes: the score of a segment from x to a
//! point z close to it grows like 1/d. Camera rays come close to spheres so often (at distance δ with density δ^1/2) that its second moment has no bound; neither has
//! it where x lies on a face beside a hollow crease, or on a floor beside what stands on it: z is then seen at any distance. So z,
//! if it comes right after x, keeps to its direction from x instead of to its matter where it is near ([T] 2.3 (i)):
//!
//! `ż = ż_B + χ Q Δ`, `Δ = ẋ - v(x) - C(z)`, `Q = 1 - w nᵀ/<n,w>`, `χ = κ(d/ρ)`
//!
//! (ż_B: as it would move otherwise, with its matter, v, and with what x carries it by, C; Δ: what x does on top of v, there, less C; if x lies on the same shape v is the
//! matter of its own face). A direction's measure dω = dA c_z/d² does not change where x moves by Δ and z by QΔ, so that segment and Jacobian
//! together score what they would with v alone (nothing, if that is rigid), `1-χ` of what Δ and C score, and `<∇χ, QΔ>`.
//!
//! ρ is the distance from x to the nearest place over which such points would flow: to the horizon that x sees on a sphere (<n,w> is 0 there), and to the border of a
//! flat face (where another flat face that moves alike passes through it, to that line as well; of shapes that others cut otherwise, nowhere: where they do is no border that anyone knows); on a sphere at most the radius R. A border that lies in the plane of x's own face is none: light goes there at a cosine of 0 (whatever a surface that is not diffuse reflects at grazing must vanish with it, too). On
//! a cylinder's wall χ has a factor besides that is 0 at those rims that do not lie so: `κ(|2h/l - 1|)` where none does, `κ(h'/l)` where one does, h and h'
//! the heights of z over the base and over that rim, l the length.

use super::field::decay;
use super::piece::{onto, outer};
use crate::math::{DMat3, DVec3};
use crate::shape::edges::{to_border_off, to_lines_off};
use crate::shape::{Cylinder, Shape};
use std::collections::HashMap;

/// Where faces end besides their own borders: where others pass through them.
#[derive(Clone, Debug, Default)]
pub struct InnerBorders {
    /// Shapes that others pass through along curves that nobody knows.
    unknown: Vec<bool>,
    /// Lines across faces (shape, face).
    lines: HashMap<(u32, u32), Vec<[DVec3; 2]>>,
}

impl InnerBorders {
    pub fn new(shapes: usize, unknown: impl Iterator<Item = u32>) -> InnerBorders {
        let mut all = InnerBorders { unknown: vec![false; shapes], lines: HashMap::new() };
        unknown.for_each(|i| all.unknown[i as usize] = true);
        all
    }

    pub fn add(&mut self, face: (u32, u32), line: [DVec3; 2]) {
        self.lines.entry(face).or_default().push(line);
    }

    /// From x to the nearest of a face that does not lie in the plane through x with this normal; `None` where they are not known.
    pub fn distance(&self, [shape, face]: [u32; 2], x: DVec3, plane: Option<DVec3>) -> Option<f64> {
        if self.unknown.get(shape as usize).copied().unwrap_or(false) {
            return None;
        }
        // Of nearly all scenes.
        if self.lines.is_empty() {
            return Some(f64::INFINITY);
        }
        let lines = self.lines.get(&(shape, face)).into_iter().flatten().copied();
        Some(to_lines_off(lines, x, plane))
    }
}

/// How a point is held to its direction from the first vertex.
#[derive(Clone, Copy, Debug)]
pub struct Attached {
    /// χ.
    pub share: f64,
    /// `χ Q`, on Δ.
    pub map: DMat3,
    /// The form on Δ that χ's own change gives.
    pub form: DVec3,
}

impl Attached {
    /// For a point z of a face, n its normal; `inner`: from x to the nearest of [`InnerBorders`]; `plane`: the normal at x where x lies on a surface. `None` out of reach.
    pub fn new(
        shape: &Shape,
        face: u32,
        inner: f64,
        x: DVec3,
        plane: Option<DVec3>,
        z: DVec3,
        n: DVec3,
    ) -> Option<Attached> {
        // From inside there is no horizon.
        let curved = |r: f64, from_middle: f64| {
            let horizon = from_middle - r * r;
            // A point of the shape itself sees none, whatever its rounding.
            if horizon > 1e-9 * r * r { r.min(horizon.sqrt()) } else { r }
        };
        let reach = match shape {
            Shape::Sphere(s) => curved(s.radius, (x - s.center).length_squared()),
            Shape::Cylinder(s) => curved(s.radius, s.from_axis(x).length_squared()),
            flat => to_border_off(flat, face, x, plane),
        }
        .min(inner);
        let d = (z - x).length();
        let (mut share, slope) = decay(d / reach);
        if share <= 0.0 || d <= 0.0 {
            return None;
        }
        let w = (z - x) / d;
        let q = onto(n, w);
        // ∇χ.
        let mut gradient = w * (slope / reach);
        if let Shape::Cylinder(s) = shape {
            let (fade, slope) = rims(s, x, plane, z);
            gradient = gradient * fade + s.axis * (share * slope);
            share *= fade;
        }
        let form = q.transpose() * gradient;
        let map = q * share;
        (map + outer(form, form)).is_finite().then_some(Attached { share, map, form })
    }
}

/// The factor that keeps points of a wall off its rims, and its slope along the axis.
fn rims(s: &Cylinder, x: DVec3, plane: Option<DVec3>, z: DVec3) -> (f64, f64) {
    let (h, l) = (s.height(z), s.length);
    // Whether the floor that x lies on is that of a rim.
    let stands = |height: f64| {
        plane.is_some_and(|n| n.cross(s.axis).length() <= 1e-9 && (s.height(x) - height).abs() <= 1e-9 * l)
    };
    let (t, dt) = match (stands(0.0), stands(l)) {
        (true, false) => (h / l, 1.0 / l),
        (false, true) => (1.0 - h / l, -1.0 / l),
        _ => ((2.0 * h / l - 1.0).abs(), (2.0 * h / l - 1.0).signum() * 2.0 / l),
    };
    let (fade, slope) = decay(t.max(0.0));
    (fade, slope * dt)
}
