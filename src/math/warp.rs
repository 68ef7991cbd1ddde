//! Warps from the unit square: discs, hemispheres, spheres, frames.

use super::{DVec2, DVec3};
use std::f64::consts::{FRAC_PI_4, PI};

/// Uniform on the unit disc (Shirley–Chiu concentric map). Density 1/pi per unit area.
pub fn disc(u: f64, v: f64) -> DVec2 {
    let (a, b) = (2.0 * u - 1.0, 2.0 * v - 1.0);
    if a == 0.0 && b == 0.0 {
        return DVec2::ZERO;
    }
    let (r, phi) =
        if a.abs() > b.abs() { (a, FRAC_PI_4 * (b / a)) } else { (b, 2.0 * FRAC_PI_4 - FRAC_PI_4 * (a / b)) };
    DVec2::new(r * phi.cos(), r * phi.sin())
}

/// Uniform on the unit sphere. Density 1/(4 pi) per unit solid angle.
pub fn sphere(u: f64, v: f64) -> DVec3 {
    let z = 1.0 - 2.0 * u;
    let r = 2.0 * (u * (1.0 - u)).max(0.0).sqrt();
    let (s, c) = (2.0 * PI * v).sin_cos();
    DVec3::new(r * c, r * s, z)
}

/// Cosine-weighted on the hemisphere about +z. Density cos/pi per unit solid angle.
pub fn cosine_hemisphere(u: f64, v: f64) -> DVec3 {
    let d = disc(u, v);
    DVec3::new(d.x, d.y, (1.0 - d.length_squared()).max(0.0).sqrt())
}

/// Uniform on the hemisphere about +z. Density 1/(2 pi) per unit solid angle.
pub fn uniform_hemisphere(u: f64, v: f64) -> DVec3 {
    let (s, c) = (2.0 * PI * v).sin_cos();
    let r = (u * (2.0 - u)).max(0.0).sqrt();
    DVec3::new(r * c, r * s, 1.0 - u)
}

/// Two unit vectors that complete `n` (unit) to a right-handed frame (Duff et al. 2017).
pub fn frame(n: DVec3) -> (DVec3, DVec3) {
    let sign = 1f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    (DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), DVec3::new(b, sign + n.y * n.y * a, -n.y))
}

/// Local coordinates about the axis `n` to world.
pub fn to_world(n: DVec3, local: DVec3) -> DVec3 {
    let (s, t) = frame(n);
    s * local.x + t * local.y + n * local.z
}

/// The tent of half width 1 on [-1,1]: its quantile at `u`.
pub fn tent(u: f64) -> f64 {
    if u < 0.5 { (2.0 * u).sqrt() - 1.0 } else { 1.0 - (2.0 - 2.0 * u).max(0.0).sqrt() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ENDS: [f64; 4] = [0.0, 0.25, 0.5, 1.0 - f64::EPSILON / 2.0];

    #[test]
    fn endpoints_give_unit_vectors() {
        for u in ENDS {
            for v in ENDS {
                for w in [sphere(u, v), cosine_hemisphere(u, v), uniform_hemisphere(u, v)] {
                    assert!((w.length() - 1.0).abs() <= 4.0 * f64::EPSILON, "{u} {v} {w}");
                }
            }
        }
    }

    #[test]
    fn frames_are_orthonormal() {
        for u in ENDS {
            for v in ENDS {
                let n = sphere(u, v);
                let (s, t) = frame(n);
                assert!((s.cross(t) - n).length() < 1e-14);
            }
        }
    }
}
