//! Points of spheres and cylinders beside the first vertex of a path.
//!
//! The film holds the first vertex x, so where a camera ray passes close to a sphere that moves, x stays behind: the score of a segment from x to a
//! point z of the sphere grows like 1/d, and camera rays come close to spheres so often (at distance δ with density δ^1/2) that its second moment has no bound. So z,
//! if it comes right after x, keeps to its direction from x instead of to its matter where it is near ([T] 2.3 (i)):
//!
//! `ż = ż_B + χ Q (ẋ - ż_B)`, `Q = 1 - w nᵀ/<n,w>`, `χ = κ(d/min(R, ℓ))`
//!
//! (ż_B: as it would move otherwise; ℓ: the distance from x to the horizon that it sees, over which such points would flow: <n,w> is 0 there).
//! A direction's measure dω = dA c_z/d² does not change, so that segment and Jacobian together score
//! `(1-χ)` times what they would, and `<∇χ, Q(ẋ - ż_B)>`. Flat faces end at edges, over which such points would flow, and camera rays that graze them are rare; on
//! a cylinder's wall χ has the factor `κ(|2h/l - 1|)` besides (h the height of z, l the length), which is 0 at the rims.

use super::field::decay;
use super::piece::{onto, outer};
use crate::math::{DMat3, DVec3};
use crate::shape::Shape;

/// How a point of a curved shape is held to its direction from the first vertex.
#[derive(Clone, Copy, Debug)]
pub struct Attached {
    /// χ.
    pub share: f64,
    /// `χ Q`, on `ẋ - ż_B`.
    pub map: DMat3,
    /// The form on `ẋ - ż_B` that χ's own change gives.
    pub form: DVec3,
}

impl Attached {
    /// For a point z with the normal n; `None` on other shapes and out of reach.
    pub fn new(shape: &Shape, x: DVec3, z: DVec3, n: DVec3) -> Option<Attached> {
        // Radius, and the squared distance to the horizon that x sees; from inside there is none.
        let (radius, horizon) = match shape {
            Shape::Sphere(s) => (s.radius, (x - s.center).length_squared() - s.radius * s.radius),
            Shape::Cylinder(s) => (s.radius, s.from_axis(x).length_squared() - s.radius * s.radius),
            _ => return None,
        };
        let radius = if horizon > 0.0 { radius.min(horizon.sqrt()) } else { radius };
        let d = (z - x).length();
        let (mut share, slope) = decay(d / radius);
        if share <= 0.0 || d <= 0.0 {
            return None;
        }
        let w = (z - x) / d;
        let q = onto(n, w);
        // ∇χ.
        let mut gradient = w * (slope / radius);
        if let Shape::Cylinder(s) = shape {
            let off = 2.0 * s.height(z) / s.length - 1.0;
            let (fade, slope) = decay(off.abs());
            gradient = gradient * fade + s.axis * (share * slope * off.signum() * 2.0 / s.length);
            share *= fade;
        }
        let form = q.transpose() * gradient;
        let map = q * share;
        (map + outer(form, form)).is_finite().then_some(Attached { share, map, form })
    }
}
