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

/// The filter itself at offset `x`, in 1/pixels; its integral is 1. Where it jumps, the mean of both sides: an edge of the picture that lies on the
/// border of two pixels belongs to each by half.
pub fn density(filter: Filter, x: f64) -> f64 {
    let x = x.abs();
    match filter {
        Filter::Box { radius } if x == radius => 0.25 / radius,
        Filter::Box { radius } => {
            if x < radius {
                0.5 / radius
            } else {
                0.0
            }
        }
        Filter::Tent { radius } => (1.0 - x / radius).max(0.0) / radius,
        Filter::Gaussian { stddev } => {
            let x = x / stddev;
            if x >= RADIUS {
                0.0
            } else {
                -(-0.5 * x * x).exp() * (0.5 * (x * x - RADIUS * RADIUS)).exp_m1() / (stddev * GAUSSIAN_AREA)
            }
        }
    }
}

/// Pixels of a film of this size (width, height) whose filter may reach a film point.
pub fn pixels(filter: Filter, film: [f64; 2], size: [usize; 2]) -> impl Iterator<Item = [usize; 2]> {
    // Pixels x with |film - (x + 1/2)| <= radius.
    let range = |k: usize| {
        let lo = (film[k] - 0.5 - radius(filter)).ceil().max(0.0) as usize;
        let hi = (film[k] - 0.5 + radius(filter)).floor();
        lo..(if hi < 0.0 { 0 } else { hi as usize + 1 }).min(size[k])
    };
    let columns = range(0);
    range(1).flat_map(move |y| columns.clone().map(move |x| [x, y]))
}

/// Beyond this offset in pixels the filter is 0.
pub fn radius(filter: Filter) -> f64 {
    match filter {
        Filter::Box { radius } | Filter::Tent { radius } => radius,
        Filter::Gaussian { stddev } => RADIUS * stddev,
    }
}

/// Cut of the Gaussian, in standard deviations.
const RADIUS: f64 = 4.0;
/// `√(2π) erf(4/√2) - 8 e^-8`: the integral of the cut and lowered Gaussian of unit deviation.
const GAUSSIAN_AREA: f64 = 2.503_785_797_547_237;

/// `exp(-x^2/2s^2) - exp(-r^2/2s^2)` on |x| < r = 4s, as Mitsuba has it: a Gaussian with a slightly rejected tail.
fn gaussian(stddev: f64, rng: &mut Rng) -> f64 {
    loop {
        // Box–Muller; u is never 0.
        let r = (2.0 * rng.exponential()).sqrt();
        let x = r * (2.0 * std::f64::consts::PI * rng.uniform()).cos();
        let keep = -(0.5 * (x * x - RADIUS * RADIUS)).exp_m1();
        if x.abs() < RADIUS && rng.uniform() < keep {
            return x * stddev;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn densities_integrate_to_one() {
        for f in [Filter::Box { radius: 0.5 }, Filter::Tent { radius: 1.3 }, Filter::Gaussian { stddev: 0.7 }] {
            let (n, r) = (200_000, radius(f));
            let h = 2.0 * r / n as f64;
            let sum: f64 = (0..n).map(|i| density(f, -r + (i as f64 + 0.5) * h) * h).sum();
            assert!((sum - 1.0).abs() < 1e-8, "{f:?} {sum}");
        }
    }

    #[test]
    fn a_border_belongs_to_both_pixels_by_half() {
        let f = Filter::Box { radius: 0.5 };
        assert_eq!(density(f, 0.5) + density(f, -0.5), density(f, 0.0));
    }

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
