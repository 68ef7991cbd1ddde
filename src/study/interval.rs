//! The mean of a derivative over an interval, which a finite difference is exactly:
//!
//! `[I(b) - I(a)] / (b - a) = 1/(b-a) ∫_a^b İ(q) dq`
//!
//! A difference of any step so has no bias if the derivative is taken at random places of its interval, not in its middle, and if the picture has no jump there
//! (a light that comes through a wall). Wide intervals have little noise (paths that take another turn at the other end count like 1/h), and the derivative is tried at many values instead of one.
//!
//! Places are stratified, S a round. What İ itself varies by over the interval adds to a round's variance like 1/S² where İ jumps in one stratum, faster where it does not; so S grows like the root of
//! a round's samples, as fast as their own variance falls. Places of neighbouring strata mirror each other, so that only curvature is left where İ is smooth. From round to round the places of a stratum go on evenly from a random one, so that what happens in a small part of the interval only (an outline
//! that passes one pixel) is met as often as it should be; variances count rounds as independent, which even places spread less than unless İ repeats itself as they do.

use super::check::Estimator;
use super::differences::{At, Difference, Side};
use super::rounds::{Blocks, Rounds, mean};
use super::sweep::{self, Rung};
use crate::error::{Error, Result};
use crate::math::rng::Rng;
use crate::params::ParamSet;
use crate::render::family::{Member, View, stream};
use crate::render::health::Health;

/// Strata of a first round.
pub const STRATA: u64 = 4;
/// Strata of a shorter round: a pair that mirrors each other.
const PAIR: f64 = 2.0;
/// Samples of a stratum there, in first rounds of a difference: each is a run with a pilot of its own.
pub const LONGER: u64 = 2;
/// The golden ratio less 1: its multiples lie evenly in [0, 1), however many.
const GOLDEN: f64 = 0.618_033_988_749_894_9;
/// Rounds that a step is judged by.
const ROUNDS: u64 = 8;
/// Steps that are tried: a factor of 128 from the first to the last.
const STEPS: i32 = 8;
/// The step taken is the smallest whose relative noise is at most this times the least.
const NEAR: f64 = 1.25;

/// By how much the derivative's mean over the outer halves of an interval may differ from that over the inner ones, as a share of its mean: places would be noise (the light of a
/// body of 450 to 1050 kelvin is that of the hottest few).
const UNEVEN: f64 = 0.5;

/// Standard errors, of four pairs of rounds, that make sure of it: 1 in 100.
const CERTAIN: f64 = 4.5;

/// The parameter of one comparison, and half of its interval's length.
#[derive(Clone, Copy)]
pub struct Interval<'a> {
    pub at: At<'a>,
    pub step: f64,
    /// Samples a pixel of a first round.
    pub first: u64,
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
        let strata = (STRATA as f64 * (spp as f64 / self.first as f64).sqrt()).max(PAIR).round() as u64;
        let strata = strata.min(spp).max(1);
        let mut shifts = Rng::keyed(stream(seed, 4, 0), 0, 0, 0);
        let mut sums: Vec<Vec<f64>> = Vec::new();
        let mut within = 0.0;
        for s in 0..strata {
            // Neighbours mirror each other: what İ varies by evenly cancels.
            within = if s % 2 == 1 { 1.0 - within } else { (shifts.uniform() + round as f64 * GOLDEN).fract() };
            let share = (s as f64 + within) / strata as f64;
            // What does not divide goes to the first ones.
            let spp = spp / strata + u64::from(s < spp % strata);
            let layers = self.at_place((2.0 * share - 1.0) * self.step, |member, params| {
                estimator(member, params, spp, stream(seed, 1, round << 8 | s), health)
            })?;
            if sums.is_empty() {
                sums = layers.iter().map(|l| vec![0.0; l.len()]).collect();
            }
            for (sum, layer) in sums.iter_mut().zip(&layers) {
                sum.iter_mut().zip(layer).for_each(|(a, x)| *a += x / strata as f64);
            }
        }
        Ok(sums)
    }

    /// Something about the derivative at an offset from the value.
    fn at_place<T>(&self, offset: f64, f: impl FnOnce(&Member, &ParamSet) -> Result<T>) -> Result<T> {
        let found = || {
            let member = self.at.member(offset)?;
            let params = member.scene.param_set(&member.desc, &[self.at.name.to_string()])?;
            f(&member, &params)
        };
        found().map_err(|e| match e {
            Error::Scene { .. } | Error::Usage { .. } => Error::usage(
                // Without its own remedy.
                format!(
                    "`{}` = {}: {}",
                    self.at.name,
                    self.at.value + offset,
                    e.to_string().lines().next().unwrap_or_default()
                ),
                "compare at the value (--at value), or give a smaller --step",
            ),
            e => e,
        })
    }

    /// Whether the scene, and the derivative, take the ends and places between.
    pub fn fits(&self, view: &View) -> Result<bool> {
        for share in [-1.0, 1.0, -0.5, 0.5] {
            match self.at_place(share * self.step, |member, params| view.refuse(&member.scene, params)) {
                Ok(()) => {}
                Err(Error::Usage { .. }) => return Ok(false),
                Err(e) => return Err(e),
            }
        }
        Ok(true)
    }
}

/// The smallest step whose difference has about as little noise for its size as any, of those over whose interval the derivative does not vary too much; `None` where scene or derivative take no interval around the value.
pub fn widest(
    at: &At,
    view: &View,
    blocks: &Blocks,
    spp: u64,
    seed: u64,
    h: &Health,
) -> Result<Option<(f64, Vec<Rung>)>> {
    let (side, mut first) = sweep::start(at, at.largest_step()?)?;
    let fits = |step: f64| Interval { at: *at, step, first: spp }.fits(view);
    let mut smaller = 0;
    while side == Side::Central && smaller < STEPS && !fits(first)? {
        (first, smaller) = (0.5 * first, smaller + 1);
    }
    if side != Side::Central || smaller == STEPS {
        return Ok(None);
    }
    let mut rungs: Vec<Rung> = Vec::new();
    let mut relative = Vec::new();
    let mut noise = 0.0f64;
    let (mut wider, mut first_even) = (None::<Vec<Vec<f64>>>, 0);
    for k in 0..STEPS {
        let d = Difference::plain(at, side, first * 0.5f64.powi(k))?;
        let mut halves = [Rounds::default(), Rounds::default()];
        let mut rounds = Vec::new();
        for r in 0..ROUNDS {
            let means = blocks.means(&d.round(view, spp, stream(seed, 3, r), h)?[0]);
            halves[(r % 2) as usize].push(&means, spp as f64);
            rounds.push(means);
        }
        let own = (0.25 * halves.iter().map(Rounds::mean_variance).sum::<f64>()).sqrt();
        if wider.is_some_and(|wider| uneven(&wider, &rounds)) {
            relative.fill(f64::INFINITY);
            (first_even, noise) = (k as usize, 0.0);
        }
        // Noise does not fall with the step: where it seems to, its rare part was not met.
        noise = noise.max(own);
        rungs.push(Rung { step: d.step, noise, bias: 0.0, visible_bias: 0.0, chosen: false });
        let square = surely(halves[0].mean.iter().zip(&halves[1].mean).map(|(a, b)| a * b));
        relative.push(if square > 0.0 { noise / square.sqrt() } else { f64::INFINITY });
        wider = Some(rounds);
    }
    let least = relative.iter().copied().fold(f64::INFINITY, f64::min);
    // Where there is no noise at all the widest is as good.
    let near = |r: &f64| least.is_finite() && least > 0.0 && *r <= NEAR * least;
    let chosen = relative.iter().rposition(near).unwrap_or(first_even);
    rungs[chosen].chosen = true;
    Ok(Some((rungs[chosen].step, rungs)))
}

/// Whether the derivative surely varies too much over an interval, from the rounds of D over all of it and over its inner half (with the same random numbers).
fn uneven(whole: &[Vec<f64>], inner: &[Vec<f64>]) -> bool {
    let mut excess = Rounds::default();
    for (w, d) in whole.chunks(2).zip(inner.chunks(2)) {
        // D over the whole is the mean of D over the inner half and of what is outside: 2 (w - d) is their difference. Products of independent rounds have no bias.
        let beyond = |r: usize, e: usize| 2.0 * (w[r][e] - d[r][e]);
        let places = 0..w[0].len();
        let one = |e: usize| beyond(0, e) * beyond(1, e) - UNEVEN * UNEVEN * w[0][e] * w[1][e];
        excess.push(&[mean(places.map(one))], 1.0);
    }
    excess.mean[0] > CERTAIN * excess.variance(0).sqrt()
}

/// A mean over pixels less two of its standard errors: products of two independent estimates have no bias, but steps so small that noise is all they have would do well by chance.
fn surely(products: impl Iterator<Item = f64> + Clone) -> f64 {
    let n = products.clone().count() as f64;
    let m = mean(products.clone());
    // The three channels of a pixel are hardly independent.
    let variance = mean(products.map(|x| (x - m) * (x - m))) / (n / 3.0 - 1.0).max(1.0);
    m - 2.0 * variance.sqrt()
}
