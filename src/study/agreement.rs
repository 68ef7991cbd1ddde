//! Whether two estimates with error bars agree: z scores of many places, the largest of them, and their sum of squares.
//!
//! z = (a - b) / sqrt(var_a + var_b + bias^2). Where differences are 0 without any variance though the derivative is not, their samples may have met nothing yet: light beside an outline in
//! the tail of a pixel's filter. They count as uncertain by what that many samples can miss ([`leeway`]), so that only more of them tell. The variances come from few rounds, so z follows Student's distribution; it is
//! turned into a normal score of the same tail, of which the largest of n exceeds its threshold with probability
//! [`ALPHA`] (Sidak), and the sum of squares of each channel its own (chi square), if the two agree.

use super::rounds::{Rounds, mean};
use serde::Serialize;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal, StudentsT};

/// False alarms a comparison: half for the largest |z|, half for the three sums of squares.
pub const ALPHA: f64 = 1e-4;

/// One comparison over places x channels.
#[derive(Clone, Debug, Serialize)]
pub struct Agreement {
    /// Places, three channels each.
    pub places: usize,
    /// Largest |z|, as a normal score, and the threshold that it exceeds by chance with probability `false_alarm_rate` / 2.
    pub max_z: f64,
    pub max_z_threshold: f64,
    /// Sum of z^2 over places, a channel.
    pub chi_square: [f64; 3],
    pub chi_square_threshold: f64,
    pub degrees_of_freedom: f64,
    pub false_alarm_rate: f64,
    /// Whether max |z| or a sum of squares exceeds its threshold.
    pub significant: bool,
    /// Mean |a| over places and channels.
    pub mean_abs: f64,
    /// Mean over places and channels of the combined standard error, bias included: as `mean_abs` is a mean, a few noisy places do not decide alone.
    pub error: f64,
    /// `error` / `mean_abs`; 0 where everything is exactly 0.
    pub relative_error: f64,
    /// Root mean square of a - b.
    pub difference: f64,
    /// Places by themselves: |z| beyond the threshold; within it with an error of at most the tolerance; neither.
    pub fail: usize,
    pub pass: usize,
    pub undecided: usize,
}

/// Of an event that one in n samples meets, samples have met none with the probability exp(-their number / n): three of them are one standard error, and a threshold of 5.4 is 1e-7.
const MISSED: f64 = 3.0;

/// Rounding of sums, over the largest of what is added up: all that two sides without variance (what glows evenly) can differ by.
const ROUNDING: f64 = 1e-12;

/// What each place of differences b is uncertain by beside its variance and `bias`: by what it may have missed, where it is exactly 0 and a is not, and by rounding. `event`: what one sample can be, over the difference's step; `samples` of each place.
pub fn leeway(a: &Rounds, b: &Rounds, bias: &[f64], event: f64, samples: impl Fn(usize) -> f64) -> Vec<f64> {
    // Pictures change by the derivative, also where they are 0 at the value itself.
    let largest = a.mean.iter().fold(event, |m, x| m.max(x.abs()));
    let more = |i: usize| match (a.mean[i] == 0.0, b.mean[i] == 0.0) {
        (true, true) => 0.0,
        (false, true) if b.variance(i) == 0.0 => MISSED * event / samples(i / 3),
        _ => ROUNDING * largest,
    };
    bias.iter().enumerate().map(|(i, b)| b.hypot(more(i))).collect()
}

/// Normal scores of a - b; 0 where both are exactly equal and without variance.
pub fn scores(a: &Rounds, b: &Rounds, bias: &[f64]) -> Vec<f64> {
    let normal = Normal::standard();
    (0..a.mean.len())
        .map(|i| {
            let (va, vb) = (a.variance(i), b.variance(i));
            let (difference, variance) = (a.mean[i] - b.mean[i], va + vb + bias[i] * bias[i]);
            if difference == 0.0 {
                return 0.0;
            }
            let t = difference / variance.sqrt();
            // Welch and Satterthwaite; the bias counts as known.
            let (na, nb) = (a.freedom(), b.freedom());
            let freedom = variance * variance / (va * va / na + vb * vb / nb);
            normal_score(t, freedom, &normal)
        })
        .collect()
}

/// The normal score with the tail of Student's t.
fn normal_score(t: f64, freedom: f64, normal: &Normal) -> f64 {
    if !t.is_finite() {
        return if t.is_nan() { 0.0 } else { t };
    }
    let Ok(student) = StudentsT::new(0.0, 1.0, freedom.clamp(1.0, 1e6)) else { return t };
    let tail = student.sf(t.abs());
    // Beyond this tail the inverse is not worth its digits; t itself is larger and as clear.
    let z = if tail > 1e-15 { -normal.inverse_cdf(tail) } else { t.abs().min(8.0 + t.abs().ln()) };
    z.copysign(t)
}

/// |z| that the largest of n normal scores exceeds with probability `alpha`.
pub fn largest_score(n: usize, alpha: f64) -> f64 {
    // 1 - (1 - alpha)^(1/n), for both signs.
    let one = -((-alpha).ln_1p() / n.max(1) as f64).exp_m1();
    -Normal::standard().inverse_cdf(one / 2.0)
}

/// Sum of squares of n normal scores that is exceeded with probability `alpha`.
fn largest_chi_square(n: usize, alpha: f64) -> f64 {
    ChiSquared::new(n.max(1) as f64).map_or(f64::NAN, |d| d.inverse_cdf(1.0 - alpha))
}

impl Agreement {
    /// Compare a with b, whose bias is estimated to be `bias`, one a place and channel. `tolerance`: the error that a place may have,
    /// as a share of mean |a|.
    pub fn new(a: &Rounds, b: &Rounds, bias: &[f64], tolerance: f64) -> Self {
        let z = scores(a, b, bias);
        let places = z.len() / 3;
        let max_z = z.iter().fold(0.0f64, |m, z| m.max(z.abs()));
        let threshold = largest_score(z.len(), ALPHA / 2.0);
        let chi_square = [0, 1, 2].map(|c| z.iter().skip(c).step_by(3).map(|z| z * z).sum::<f64>());
        let chi_square_threshold = largest_chi_square(places, ALPHA / 6.0);
        let variance = |i: usize| a.variance(i) + b.variance(i) + bias[i] * bias[i];
        let mean_abs = a.mean_abs();
        let error = mean((0..z.len()).map(|i| variance(i).sqrt()));
        let zero = a.is_zero() && b.is_zero() && bias.iter().all(|&x| x == 0.0);
        let (mut fail, mut pass) = (0, 0);
        for p in 0..places {
            let all = 3 * p..3 * p + 3;
            if all.clone().any(|i| z[i].abs() > threshold) {
                fail += 1;
            } else if all.clone().all(|i| variance(i).sqrt() <= tolerance * mean_abs) {
                pass += 1;
            }
        }
        Agreement {
            places,
            max_z,
            max_z_threshold: threshold,
            chi_square,
            chi_square_threshold,
            degrees_of_freedom: places as f64,
            false_alarm_rate: ALPHA,
            significant: max_z > threshold || chi_square.iter().any(|&c| c > chi_square_threshold),
            mean_abs,
            error,
            relative_error: if zero { 0.0 } else { error / mean_abs },
            difference: mean(a.mean.iter().zip(&b.mean).map(|(a, b)| (a - b) * (a - b))).sqrt(),
            fail,
            pass,
            undecided: places - fail - pass,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    /// Rounds of n places around `mean`, each round with variance 1.
    fn noise(n: usize, rounds: usize, mean: f64, key: u64) -> Rounds {
        let mut rng = Rng::keyed(key, 0, 0, 0);
        let mut r = Rounds::default();
        for _ in 0..rounds {
            let x: Vec<f64> = (0..3 * n).map(|_| mean + (0..12).map(|_| rng.uniform()).sum::<f64>() - 6.0).collect();
            r.push(&x, 1.0);
        }
        r
    }

    /// Differences that are 0 because their few samples have met nothing do not fail; the same with samples enough does.
    #[test]
    fn what_differences_have_not_met() {
        let mut none = Rounds::default();
        (0..32).for_each(|_| none.push(&[0.0; 12], 1.0));
        let a = noise(4, 32, 1.2, 3);
        let with = |samples: f64| Agreement::new(&a, &none, &leeway(&a, &none, &[0.0; 12], 1.0, |_| samples), 0.02);
        assert!(Agreement::new(&a, &none, &[0.0; 12], 0.02).significant);
        assert!(!with(4.0).significant && with(4.0).fail == 0, "{:?}", with(4.0));
        assert!(with(1e4).significant);
        assert_eq!(leeway(&none, &none, &[0.0; 12], 1.0, |_| 1.0), [0.0; 12]);
    }

    /// Sides without variance agree but for rounding.
    #[test]
    fn last_bits_are_no_difference() {
        let even = |x: f64| {
            let mut r = Rounds::default();
            (0..32).for_each(|_| r.push(&[x; 12], 1.0));
            r
        };
        let is_significant = |a: &Rounds, b: &Rounds, more: &[f64]| Agreement::new(a, b, more, 0.02).significant;
        let one = even(1.0);
        for (other, expected) in [(even(1.0 + 1e-15), false), (even(1.0 + 1e-6), true)] {
            assert!(is_significant(&one, &other, &[0.0; 12]));
            let more = leeway(&one, &other, &[0.0; 12], 1.0, |_| 64.0);
            assert_eq!(is_significant(&one, &other, &more), expected);
        }
    }

    #[test]
    fn thresholds_are_those_of_tables() {
        assert!((largest_score(1, 0.05) - 1.959_964).abs() < 1e-5);
        assert!((largest_chi_square(10, 0.05) - 18.307).abs() < 1e-3);
        // t = 2.571 at 5 degrees of freedom is the 97.5 % point.
        assert!((normal_score(2.570_582, 5.0, &Normal::standard()) - 1.959_964).abs() < 1e-4);
    }

    #[test]
    fn equal_means_agree_and_others_do_not() {
        let significant = |shift: f64, keys: std::ops::Range<u64>| {
            keys.filter(|&k| {
                let (a, b) = (noise(40, 16, 1.0, 2 * k), noise(40, 16, 1.0 + shift, 2 * k + 1));
                Agreement::new(&a, &b, &[0.0; 120], 0.02).significant
            })
            .count()
        };
        // One is expected; more than 6 come with probability 8e-5.
        assert!(significant(0.0, 0..10_000) <= 6);
        assert_eq!(significant(0.5, 0..20), 20);
        // A bias as large as the difference explains it.
        let (a, b) = (noise(40, 16, 1.0, 1), noise(40, 16, 1.5, 2));
        assert!(!Agreement::new(&a, &b, &[0.5; 120], 0.02).significant);
    }

    #[test]
    fn zero_equals_zero() {
        let mut zero = Rounds::default();
        zero.push(&[0.0; 12], 1.0);
        zero.push(&[0.0; 12], 1.0);
        let a = Agreement::new(&zero, &zero, &[0.0; 12], 0.02);
        assert!(!a.significant && a.relative_error == 0.0 && a.pass == 4);
        let b = Agreement::new(&zero, &noise(4, 8, 3.0, 1), &[0.0; 12], 0.02);
        assert!(b.significant && b.relative_error.is_infinite());
    }
}
