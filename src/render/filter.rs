//! Reconstruction filters by sampling: a film point is drawn from the pixel's filter, so every sample has weight 1 in one pixel.
//! Unbiased for `I = integral of W L` with `integral of W = 1` [T] (22); nothing is normalised by a random sum.

use crate::math::rng::Rng;
use crate::math::warp;
use crate::scene::parts::Filter;

/// Offset from the pixel's centre along one axis, in pixels; density = the filter, normalised.
pub fn sample(filter: Filter, rng: &mut Rng) -> f64 {
    match filter {
        Filter::Box { radius } => (2.0 * rng.uniform() - 1.0) * radius,
        Filter::Tent { radius } => warp::tent(rng.uniform()) * radius,
        Filter::Gaussian { stddev } => gaussian(stddev, rng),
    }
}

/// `exp(-x^2/2s^2) - exp(-r^2/2s^2)` on |x| < r = 4s, as Mitsuba has it: a Gaussian with a slightly rejected tail.
fn gaussian(stddev: f64, rng: &mut Rng) -> f64 {
    let radius: f64 = 4.0;
    loop {
        // Box–Muller; u is never 0.
        let r = (2.0 * rng.exponential()).sqrt();
        let x = r * (2.0 * std::f64::consts::PI * rng.uniform()).cos();
        let keep = -(0.5 * (x * x - radius * radius)).exp_m1();
        if x.abs() < radius && rng.uniform() < keep {
            return x * stddev;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_match_the_filters() {
        let mut rng = Rng::keyed(5, 0, 0, 0);
        // Second moments: box r^2/3, tent r^2/6, the truncated Gaussian by quadrature. 6 s.e.: false alarm 2e-9 each.
        let n = 400_000;
        let quadrature = |s: f64| {
            let (mut m, mut w) = (0.0, 0.0);
            for i in 0..200_000 {
                let x = (i as f64 + 0.5) / 200_000.0 * 4.0;
                let f = (-0.5 * x * x).exp() - (-8.0f64).exp();
                m += f * x * x;
                w += f;
            }
            m / w * s * s
        };
        for (filter, expect) in [
            (Filter::Box { radius: 0.5 }, 1.0 / 12.0),
            (Filter::Tent { radius: 1.0 }, 1.0 / 6.0),
            (Filter::Gaussian { stddev: 0.5 }, quadrature(0.5)),
        ] {
            let m: crate::math::stats::Moments = (0..n).map(|_| sample(filter, &mut rng).powi(2)).collect();
            assert!((m.mean - expect).abs() < 6.0 * m.standard_error(), "{filter:?} {} {expect}", m.mean);
        }
    }
}
