//! The mean of a derivative over an interval, which a finite difference is exactly:
//!
//! `[I(b) - I(a)] / (b - a) = 1/(b-a) ∫_a^b İ(q) dq`
//!
//! A difference of any step so has no bias if the derivative is taken at random places of its interval, not in its middle. Wide intervals have little noise (paths that take
//! another turn at the other end count like 1/h), and the derivative is tried at many values instead of one.
//! Places are stratified, so that what İ itself varies by over the interval counts little: with S strata a round and R rounds its part of the standard error is about its range `/ (S √(12 S R))`.

use super::check::Estimator;
use super::differences::{At, Difference, Side};
use super::rounds::{Blocks, Rounds, mean};
use super::sweep::{self, Rung};
use crate::error::Result;
use crate::math::rng::Rng;
use crate::render::family::{View, stream};
use crate::render::health::Health;

/// Strata of a round.
pub const STRATA: u64 = 4;
/// Rounds that a step is judged by.
const ROUNDS: u64 = 8;
/// Steps that are tried: a factor of 128 from the first to the last.
const STEPS: i32 = 8;
/// The step taken is the smallest whose relative noise is at most this times the least.
const NEAR: f64 = 1.25;

/// The parameter of one comparison, and half of its interval's length.
#[derive(Clone, Copy)]
pub struct Interval<'a> {
    pub at: At<'a>,
    pub step: f64,
}

impl Interval<'_> {
    pub fn ends(&self) -> [f64; 2] {
        [self.at.value - self.step, self.at.value + self.step]
    }

    /// Layers of the picture and of the derivative, averaged over a round's places. `spp`: over all of them.
    pub fn round(
        &self,
        estimator: &Estimator,
        spp: u64,
        seed: u64,
        round: u64,
        health: &Health,
    ) -> Result<Vec<Vec<f64>>> {
        let mut places = Rng::keyed(stream(seed, 4, round), 0, 0, 0);
        let mut sums: Vec<Vec<f64>> = Vec::new();
        let wrt = [self.at.name.to_string()];
        for s in 0..STRATA {
            let share = (s as f64 + places.uniform()) / STRATA as f64;
            let member = self.at.member((2.0 * share - 1.0) * self.step)?;
            let params = member.scene.param_set(&member.desc, &wrt)?;
            let layers =
                estimator(&member, &params, (spp / STRATA).max(1), stream(seed, 1, round * STRATA + s), health)?;
            if sums.is_empty() {
                sums = layers.iter().map(|l| vec![0.0; l.len()]).collect();
            }
            for (sum, layer) in sums.iter_mut().zip(&layers) {
                sum.iter_mut().zip(layer).for_each(|(a, x)| *a += x / STRATA as f64);
            }
        }
        Ok(sums)
    }
}

/// The smallest step whose difference has about as little noise for its size as any; `None` where the scene takes values on one side only.
pub fn widest(
    at: &At,
    view: &View,
    blocks: &Blocks,
    spp: u64,
    seed: u64,
    h: &Health,
) -> Result<Option<(f64, Vec<Rung>)>> {
    let (side, first) = sweep::start(at, at.largest_step()?)?;
    if side != Side::Central {
        return Ok(None);
    }
    let mut rungs: Vec<Rung> = Vec::new();
    let mut relative = Vec::new();
    let mut noise = 0.0f64;
    for k in 0..STEPS {
        let d = Difference::plain(at, side, first * 0.5f64.powi(k))?;
        let mut rounds = Rounds::default();
        for r in 0..ROUNDS {
            rounds.push(&blocks.means(&d.round(view, spp, stream(seed, 3, r), h)?[0]), spp as f64);
        }
        // Noise does not fall with the step: where it seems to, its rare part was not met.
        noise = noise.max(rounds.mean_variance().sqrt());
        let square = mean(rounds.mean.iter().map(|x| x * x)) - rounds.mean_variance();
        rungs.push(Rung { step: d.step, noise, bias: 0.0, visible_bias: 0.0, chosen: false });
        relative.push(if square > 0.0 { noise / square.sqrt() } else { f64::INFINITY });
    }
    let least = relative.iter().copied().fold(f64::INFINITY, f64::min);
    let chosen = relative.iter().rposition(|r| *r <= NEAR * least).filter(|_| least.is_finite()).unwrap_or(0);
    rungs[chosen].chosen = true;
    Ok(Some((rungs[chosen].step, rungs)))
}
