//! Russian roulette over spans whose optical depth is differentiated, [T] (52b).
//!
//! The depth of a span through a grid depends on every voxel along it, and most connections from inside a dense medium carry next to nothing: scenes/cloud spent
//! 72 % of that work on spans with less than 1e-4 of the sum of squares. A span is kept with probability `q = min(1, |a| / (SHARE A))` and counts 1/q,
//! `a` what the path collected behind it, `A` what it collected in all that has scattered: the second moment `a² d²` of a depth's derivative d grows by no more than `SHARE |a| A d²`.
//! It also tells which spans have their depth differentiated at drawn points, and at how many: those of light that has scattered, and of light that comes straight through a medium that scatters.

use crate::math::Rgb;
use crate::math::rng::{Purpose, Rng};
use crate::medium::Points;

/// Part of a path's value below which its spans are drawn.
const SHARE: f64 = 0.125;

/// How many times as many points light has that comes straight as light that has scattered, whose own variance is large. Measured (benches/RESULTS.md): 2 to 4 are best by mean.
const STRAIGHT: f64 = 4.0;

/// Draws of one path: the same in forward and reverse mode, whatever is differentiated, and however its record is cut into chunks.
pub(super) struct Lottery {
    key: u64,
    /// Begun when the first number is asked for.
    rng: Option<Rng>,
    all: f64,
    scattered: bool,
}

impl Lottery {
    /// `scattered`: what the path collected, but for light that comes straight, which has none of their variance.
    pub fn new(key: u64, scattered: Rgb) -> Self {
        Lottery { key, rng: None, all: SHARE * scattered.abs().max(), scattered: false }
    }

    fn uniform(&mut self) -> f64 {
        let key = self.key;
        self.rng.get_or_insert_with(|| Rng::keyed(key, Purpose::Derivative as u64, 0, 0)).uniform()
    }

    /// `after`, weighted, or `None` where the span is left out. What is not finite stays.
    pub fn draw(&mut self, after: Rgb) -> Option<Rgb> {
        let q = after.abs().max() / self.all;
        if q >= 1.0 || q.is_nan() || !after.is_finite() {
            return Some(after);
        }
        (self.uniform() < q).then(|| after / q)
    }

    /// Going backward: light has been connected or scattered behind here, or before.
    pub fn scatter(&mut self) {
        self.scattered = true;
    }

    /// Another chain.
    pub fn begin(&mut self) {
        self.scattered = false;
    }

    /// Where the depth of a span may be differentiated at drawn points ([`crate::medium::grid::Grid::pieces`]); nowhere on light that comes straight where nothing
    /// scatters, which has no other variance.
    pub fn points(&mut self, scatters: bool) -> Option<Points> {
        (self.scattered || scatters).then(|| {
            let denser = if self.scattered { 1.0 } else { STRAIGHT };
            Points { u: self.uniform(), denser }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_counts_for_what_is_not() {
        let mut lottery = Lottery::new(1, Rgb([0.1, -0.8, 0.2]));
        for (k, a) in [0.2, 0.1, 0.05, 0.02, 0.005].into_iter().enumerate() {
            let after = Rgb([-a, 0.5 * a, 0.0]);
            let (mut sum, mut square, mut kept) = (0.0, 0.0, 0);
            let n = 100_000;
            for _ in 0..n {
                let drawn = lottery.draw(after);
                kept += usize::from(drawn.is_some());
                let x = drawn.map_or(0.0, |d| d[0]);
                (sum, square) = (sum + x, square + x * x);
            }
            let (mean, q) = (sum / n as f64, (a / 0.1f64).min(1.0));
            let error = (square / n as f64 - mean * mean).max(0.0).sqrt() / (n as f64).sqrt();
            assert!((mean + a).abs() <= 4.5 * error + 1e-12, "{k}: {mean} +- {error}");
            assert!((kept as f64 / n as f64 - q).abs() < 4.5 * (q * (1.0 - q) / n as f64).sqrt() + 1e-12);
        }
        assert!(lottery.draw(Rgb([f64::NAN, 1e-9, 1e-9])).is_some());
        assert!(Lottery::new(1, Rgb::ZERO).draw(Rgb::splat(1e-9)).is_some());
    }
}
