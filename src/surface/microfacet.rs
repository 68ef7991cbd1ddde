//! Distributions of microfacets: how many are turned which way, how many of those are seen from a direction, and how to draw one that is (Walter et al. 2007; visible normals after Heitz 2014).
//!
//! With c the cosine of a microfacet's normal with the surface's, s its sine, α the roughness and t = (s / (α c))²:
//!
//! ```text
//! Beckmann  D = e^-t / (π α² c⁴),          Λ(a) = e^(-a²) / (2 a √π) - erfc(a)/2
//! GGX       D = 1 / (π α² c⁴ (1 + t)²),    Λ(a) = (√(1 + a^-2) - 1) / 2        a = cot θ / α
//! ```
//!
//! and `G1 = 1 / (1 + Λ)` of a direction at the angle θ. Sines are given besides cosines: at small α nearly all facets have c = 1 but for rounding.

use crate::math::erf::{erf, erfc};
use crate::math::{DVec3, Real};
use std::f64::consts::PI;

/// The shape of a distribution; its width is the roughness α.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Distribution {
    Beckmann,
    Ggx,
}

impl Distribution {
    /// D: area of microfacets per unit solid angle of their normals and per unit area of the surface; `∫ D c dω = 1`. `s2 = 1 - c²`.
    pub fn density<R: Real>(self, alpha: R, c: R, s2: R) -> R {
        if c.value() <= 0.0 {
            return R::zero();
        }
        let (a2, c2) = (alpha * alpha, c * c);
        match self {
            Distribution::Beckmann => (-(s2 / (a2 * c2))).exp() / (a2 * c2 * c2 * PI),
            Distribution::Ggx => a2 / ((a2 * c2 + s2).sqr() * PI),
        }
    }

    /// D of facets that stand upright, the limit for c -> 0.
    pub fn upright(self, alpha: f64) -> f64 {
        match self {
            Distribution::Beckmann => 0.0,
            Distribution::Ggx => alpha * alpha / PI,
        }
    }

    /// Smith's masking G1 of a direction at the cosine c (either sign) with the normal: the part of the microfacets turned to it that it sees.
    pub fn visible<R: Real>(self, alpha: R, c: R, s2: R) -> R {
        let slope2 = s2 * alpha * alpha / (c * c);
        let one = R::one();
        if slope2.value() <= 0.0 {
            return one;
        }
        match self {
            Distribution::Beckmann => one / (one + lambda_beckmann(one / slope2.sqrt())),
            Distribution::Ggx => one * 2.0 / (one + (slope2 + 1.0).sqrt()),
        }
    }

    /// The normal of a microfacet that is seen from v (unit, local, v.z > 0): density `G1 D max(0, <v,m>) / v.z` per unit solid angle.
    pub fn sample_visible(self, alpha: f64, v: DVec3, u: f64, w: f64) -> DVec3 {
        // As seen from a surface stretched to α = 1.
        let s = DVec3::new(alpha * v.x, alpha * v.y, v.z).normalize();
        let m = match self {
            Distribution::Ggx => {
                // Facets of the hemisphere: s plus a direction of the cap that is turned to it.
                let z = (1.0 - u) * (1.0 + s.z) - s.z;
                let r = ((1.0 - z) * (1.0 + z)).max(0.0).sqrt();
                let (y, x) = (2.0 * PI * w).sin_cos();
                s + DVec3::new(r * x, r * y, z)
            }
            Distribution::Beckmann => {
                // Slopes along the view and across it are independent.
                let sin = s.x.hypot(s.y);
                let (cos_phi, sin_phi) = if sin > 0.0 { (s.x / sin, s.y / sin) } else { (1.0, 0.0) };
                let (along, across) = (slope(s.z, sin, u), slope(1.0, 0.0, w));
                let (x, y) = (along * cos_phi - across * sin_phi, along * sin_phi + across * cos_phi);
                DVec3::new(-x, -y, 1.0)
            }
        };
        DVec3::new(alpha * m.x, alpha * m.y, m.z.max(0.0)).normalize()
    }
}

/// Λ of Beckmann's distribution and its slope `-e^(-a²) / (2 a² √π)`.
fn lambda_beckmann<R: Real>(a: R) -> R {
    let x = a.value();
    let gauss = (-x * x).exp() / (2.0 * x * PI.sqrt());
    // Linear in a: what a dual number asks of a function.
    R::from(gauss - 0.5 * erfc(x)) + (a - x) * (-gauss / x)
}

/// The quantile at u of the slopes x of facets of α = 1 seen at an angle: density `~ (cos - x sin) e^(-x²)` below cos/sin.
fn slope(cos: f64, sin: f64, u: f64) -> f64 {
    // Beyond 6 there is less than rounding.
    const END: f64 = 6.0;
    let root = PI.sqrt();
    let below = |x: f64| 0.5 * (1.0 + erf(x)) * cos + 0.5 * sin / root * (-x * x).exp();
    let (mut lo, mut hi) = (-END, if cos < END * sin { cos / sin } else { END });
    let wanted = u * below(hi);
    let mut x = 0.5 * (lo + hi);
    for _ in 0..64 {
        let off = below(x) - wanted;
        if off > 0.0 {
            hi = x
        } else {
            lo = x
        }
        // Newton's step, halving where that leaves the bracket.
        let next = x - off * root / ((cos - x * sin) * (-x * x).exp());
        let next = if next > lo && next < hi { next } else { 0.5 * (lo + hi) };
        if (next - x).abs() < 1e-13 || hi - lo < 1e-13 {
            return next;
        }
        x = next;
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Dual;

    const KINDS: [Distribution; 2] = [Distribution::Beckmann, Distribution::Ggx];

    /// Midpoints of `∫ f(c, s²) dω` over normals, in s²/(α² c²) = tan²/α².
    fn over_normals(alpha: f64, f: impl Fn(f64, f64) -> f64) -> f64 {
        let n = 20000;
        // t = x/(1-x), dω = 2π s ds / c ... = π c⁴ α² dt / c.
        (0..n)
            .map(|i| {
                let x = (f64::from(i) + 0.5) / f64::from(n);
                let t = x / (1.0 - x);
                let c2 = 1.0 / (1.0 + t * alpha * alpha);
                f(c2.sqrt(), t * alpha * alpha * c2) * PI * alpha * alpha * c2 * c2.sqrt() / ((1.0 - x) * (1.0 - x))
            })
            .sum::<f64>()
            / f64::from(n)
    }

    #[test]
    fn facets_cover_the_surface() {
        for d in KINDS {
            for alpha in [1e-3, 0.05, 0.5, 1.5] {
                let area = over_normals(alpha, |c, s2| d.density(alpha, c, s2) * c);
                assert!((area - 1.0).abs() < 1e-6, "{d:?} {alpha}: {area}");
            }
        }
    }

    /// What is drawn has the density that it is said to have: means of functions of the normal, by quantiles against a grid over the hemisphere.
    #[test]
    fn seen_facets_are_drawn_by_how_much_they_are_seen() {
        for d in KINDS {
            for alpha in [0.001, 0.1, 0.6] {
                for cos in [0.999, 0.5, 0.15f64] {
                    let v = DVec3::new((1.0 - cos * cos).sqrt() * 0.6, -(1.0 - cos * cos).sqrt() * 0.8, cos);
                    let k = 240;
                    let at = |i: usize| (i as f64 + 0.5) / k as f64;
                    // Tilts along and across the view, in units of α.
                    let f = |m: DVec3| {
                        [(m.x / m.z / alpha).atan(), (m.y / m.z / alpha).atan(), 1.0 / (1.0 + (m.x / alpha).powi(2))]
                    };
                    let mut drawn = [0.0; 3];
                    let mut grid = [0.0; 4];
                    for i in 0..k {
                        for j in 0..k {
                            let m = d.sample_visible(alpha, v, at(i), at(j));
                            assert!((m.length() - 1.0).abs() < 1e-12 && m.z >= 0.0 && m.is_finite());
                            f(m).iter().zip(&mut drawn).for_each(|(x, sum)| *sum += x);
                            let (x, phi) = (at(i), 2.0 * PI * at(j));
                            // t = (x/(1-x))²: GGX has a long tail.
                            let root = x / (1.0 - x);
                            let t2 = (root * alpha).powi(2);
                            let c = 1.0 / (1.0 + t2).sqrt();
                            let m = DVec3::new(t2.sqrt() * c * phi.cos(), t2.sqrt() * c * phi.sin(), c);
                            let s2 = t2 * c * c;
                            let density =
                                d.visible(alpha, cos, 1.0 - cos * cos) * d.density(alpha, c, s2) * v.dot(m).max(0.0)
                                    / cos;
                            let weight =
                                density * PI * alpha * alpha * c * c * c * 2.0 * root / ((1.0 - x) * (1.0 - x));
                            f(m).iter().chain(&[1.0]).zip(&mut grid).for_each(|(x, sum)| *sum += x * weight);
                        }
                    }
                    let n = (k * k) as f64;
                    assert!((grid[3] / n - 1.0).abs() < 2e-3, "{d:?} {alpha} {cos}: {}", grid[3] / n);
                    for (a, b) in drawn.iter().zip(&grid) {
                        assert!(((a - b) / n).abs() < 5e-3, "{d:?} {alpha} {cos}: {} {}", a / n, b / n);
                    }
                }
            }
        }
    }

    #[test]
    fn slopes_in_alpha() {
        for d in KINDS {
            for (alpha, c) in [(1e-3, 0.9999999), (0.2, 0.9), (0.7, 0.2f64)] {
                let s2 = (1.0 - c) * (1.0 + c);
                let h = 1e-5 * alpha;
                let a = Dual::<1>::variable(alpha, 0);
                let (dc, ds) = (Dual::constant(c), Dual::constant(s2));
                for (name, f, g) in [
                    ("D", d.density(a, dc, ds), d.density(alpha + h, c, s2) - d.density(alpha - h, c, s2)),
                    ("G1", d.visible(a, dc, ds), d.visible(alpha + h, c, s2) - d.visible(alpha - h, c, s2)),
                ] {
                    let numeric = g / (2.0 * h);
                    assert!(
                        (f.d[0] - numeric).abs() < 1e-6 * (f.v / alpha + f.d[0].abs()),
                        "{d:?} {name} {alpha} {c}: {} {numeric}",
                        f.d[0]
                    );
                }
            }
        }
    }
}
