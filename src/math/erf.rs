//! The error function, to rounding: a series without cancellation near 0, a continued fraction beyond.

use std::f64::consts::PI;

/// `2/√π ∫_0^x e^(-t²) dt`.
pub fn erf(x: f64) -> f64 {
    let y = x.abs();
    let e = if y < TURN { series(y) } else { 1.0 - tail(y) };
    e.copysign(x)
}

/// `1 - erf x`, with all its digits where it is small.
pub fn erfc(x: f64) -> f64 {
    if x < TURN { 1.0 - erf(x) } else { tail(x) }
}

const TURN: f64 = 2.5;

/// `erf x = 2/√π e^(-x²) Σ 2^n x^(2n+1) / (2n+1)!!`: every term is positive.
fn series(x: f64) -> f64 {
    let (mut term, mut sum, mut odd) = (x, x, 1.0);
    while term > 1e-17 * sum {
        odd += 2.0;
        term *= 2.0 * x * x / odd;
        sum += term;
    }
    2.0 / PI.sqrt() * (-x * x).exp() * sum
}

/// `erfc x = e^(-x²)/√π / (x + (1/2)/(x + 1/(x + (3/2)/(x + ...))))`, far enough for x >= 2.5.
fn tail(x: f64) -> f64 {
    let f = (1..=60).rev().fold(x, |f, k| x + 0.5 * f64::from(k) / f);
    (-x * x).exp() / PI.sqrt() / f
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_values() {
        for (x, y) in [
            (0.1, 0.112_462_916_018_284_9),
            (0.5, 0.520_499_877_813_046_5),
            (1.0, 0.842_700_792_949_714_9),
            (2.0, 0.995_322_265_018_952_7),
            (3.0, 0.999_977_909_503_001_4),
        ] {
            assert!((erf(x) - y).abs() < 4e-16 && erf(-x) == -erf(x), "{x} {}", erf(x));
        }
        assert!((erfc(3.0) / 2.209_049_699_858_544e-5 - 1.0).abs() < 1e-13);
        assert!((erfc(6.0) / 2.151_973_671_249_891e-17 - 1.0).abs() < 1e-13);
        // Both forms where they meet.
        assert!((series(TURN) + tail(TURN) - 1.0).abs() < 2e-15);
    }
}
