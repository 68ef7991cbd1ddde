//! Henyey–Greenstein, without cancellation for any g and without a branch at g = 0 ([T] (56), section 9).

use crate::math::Real;
use std::f64::consts::PI;

/// `(1-g^2) / (4 pi s^3)`, `s^2 = (1-g)^2 + 2 g (1-mu)` [T] (56). Per unit solid angle.
pub fn eval<R: Real>(g: R, one_minus_mu: R) -> R {
    let a = -g + 1.0;
    let s2 = a * a + g * one_minus_mu * 2.0;
    a * (g + 1.0) / (s2 * s2.sqrt()) * (0.25 / PI)
}

/// `(1 - mu, sin)` at the quantile `u` in [0,1): the pair of [T] section 9, exact to rounding for every |g| < 1.
pub fn sample(g: f64, u: f64) -> (f64, f64) {
    // The formula holds for g >= 0; a negative g is the mirrored positive one.
    let k = g.abs();
    let a = (1.0 - k) + 2.0 * k * u;
    let (lo, hi) = (1.0 - k, 1.0 + k);
    let minus = 2.0 * lo * lo * (1.0 - u) * (1.0 + k * u) / (a * a);
    let plus = 2.0 * hi * hi * u * (lo + k * u) / (a * a);
    let sin = (minus * plus).max(0.0).sqrt();
    // Rounding may pass 2 by an ulp.
    (if g < 0.0 { plus } else { minus }.min(2.0), sin)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GS: [f64; 9] = [-0.9999, -0.9, -0.3, -1e-8, 0.0, 1e-8, 0.4, 0.99, 0.9999];

    #[test]
    fn sampling_inverts_the_cumulative() {
        // P(mu' <= mu) in closed form; the sampled 1-mu must map back to u.
        for g in GS {
            for u in [0.0, 1e-12, 0.1, 0.5, 0.77, 1.0 - 1e-12, 1.0 - f64::EPSILON / 2.0] {
                let (m, sin) = sample(g, u);
                assert!((0.0..=2.0).contains(&m) && (0.0..=1.0 + 1e-15).contains(&sin), "{g} {u} {m} {sin}");
                assert!((sin * sin - m * (2.0 - m)).abs() < 1e-12);
                // Quadrature of the density from -1 to mu equals u (or 1-u for g < 0).
                if g.abs() <= 0.4 {
                    let n = 4000;
                    let mu = 1.0 - m;
                    let h = (mu + 1.0) / n as f64;
                    let f = |i: usize| 2.0 * PI * eval(g, 1.0 - (-1.0 + (i as f64 + 0.5) * h));
                    let p: f64 = (0..n).map(f).sum::<f64>() * h;
                    let expect = if g < 0.0 { 1.0 - u } else { u };
                    assert!((p - expect).abs() < 1e-6, "{g} {u} {p}");
                }
            }
        }
    }

    #[test]
    fn mean_cosine_is_g() {
        for g in GS {
            let n = 1_000_000;
            let mean = (0..n).map(|i| 1.0 - sample(g, (i as f64 + 0.5) / n as f64).0).sum::<f64>() / n as f64;
            assert!((mean - g).abs() < 1e-6, "{g} {mean}");
        }
    }

    #[test]
    fn derivatives_match_the_closed_form() {
        use crate::math::gradient;
        for (g, mu) in [(0.4, 0.3), (-0.7, 0.9), (0.0, -0.5), (0.99, 0.999)] {
            let (f, [dg, dm]) = gradient([g, 1.0 - mu], |[g, m]| eval(g, m));
            let s2 = 1.0 + g * g - 2.0 * g * mu;
            // [T] (56)
            assert!((dg / f - (-2.0 * g / (1.0 - g * g) + 3.0 * (mu - g) / s2)).abs() < 1e-9 * (1.0 + (dg / f).abs()));
            assert!((-dm / f - 3.0 * g / s2).abs() < 1e-9 * (1.0 + (dm / f).abs()));
        }
    }
}
