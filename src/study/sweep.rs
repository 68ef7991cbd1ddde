//! The step of a finite difference: a ladder of steps, each half of the one before, from large to small. Large steps are biased,
//! small ones noisy (paths that take another turn at the other point count 1/h).
//!
//! The step taken is the largest whose noise^2 + bias^2 is near the least, at the number of samples at which the least noisy
//! one reaches half of the tolerance: more samples will be taken, and they take off noise only. Only a bias that is visible
//! counts here; one that more samples bring to light makes the step smaller later. Large steps are preferred because a small one
//! may have noise that few samples do not show: turns of a path that happen once in 1/h samples and weigh 1/h.

use super::differences::{At, Bias, Difference, Side};
use super::rounds::{Blocks, Rounds};
use crate::error::{Error, Result};
use crate::render::family::{View, stream};
use crate::render::health::Health;
use serde::Serialize;

const ROUNDS: u64 = 8;
/// Steps of the ladder: a factor of 2000 from the first to the last.
const STEPS: usize = 12;
/// A step needs its half and its quarter.
const AHEAD: usize = 2;

/// A step with the errors of its extrapolated difference ([`Difference::extrapolated`]), root mean squares over blocks.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Rung {
    pub step: f64,
    pub noise: f64,
    /// Its bias, with what the noise may hide of it, and what of it is certain.
    pub bias: f64,
    pub visible_bias: f64,
    pub chosen: bool,
}

pub struct Sweep {
    pub side: Side,
    pub step: f64,
    pub rungs: Vec<Rung>,
}

/// The side with room for a ladder, and its first step.
pub fn start(at: &At, largest: f64) -> Result<(Side, f64)> {
    for side in [Side::Central, Side::Forward, Side::Backward] {
        let mut h = largest;
        for _ in 0..STEPS - AHEAD {
            if at.fits(side, h)? && at.keeps_sides(side, h)? {
                return Ok((side, h));
            }
            h *= 0.5;
        }
    }
    Err(Error::usage(
        format!("`{}` = {}: the scene takes no value near it, on neither side", at.name, at.value),
        "a finite difference needs other values of the parameter: move it, or give --step",
    ))
}

/// Try steps until two in a row show no bias.
pub fn sweep(at: &At, view: &View, blocks: &Blocks, spp: u64, seed: u64, tolerance: f64, h: &Health) -> Result<Sweep> {
    let (side, first) = start(at, at.largest_step()?)?;
    let mut rungs: Vec<Rung> = Vec::new();
    // D of every step, round by round, as blocks.
    let mut plain: Vec<Vec<Vec<f64>>> = Vec::new();
    let mut size = 0.0f64;
    for k in 0..STEPS {
        let difference = Difference::plain(at, side, first * 0.5f64.powi(k as i32))?;
        let round = |r| Ok(blocks.means(&difference.round(view, spp, stream(seed, 3, r), h)?[0]));
        plain.push((0..ROUNDS).map(round).collect::<Result<_>>()?);
        if k < AHEAD {
            continue;
        }
        let i = k - AHEAD;
        let (mut extrapolated, mut rest) = (Rounds::default(), Rounds::default());
        for r in 0..ROUNDS as usize {
            let richardson = |j: usize, e: usize| (4.0 * plain[j + 1][r][e] - plain[j][r][e]) / 3.0;
            let n = plain[i][r].len();
            extrapolated.push(&(0..n).map(|e| richardson(i + 1, e)).collect::<Vec<_>>(), spp as f64);
            let third = |e| (richardson(i, e) - richardson(i + 1, e)) / 3.0;
            rest.push(&(0..n).map(third).collect::<Vec<_>>(), spp as f64);
        }
        size = size.max(extrapolated.mean_abs());
        let bias = Bias::new(&rest);
        let rung = Rung {
            step: difference.step * 4.0,
            noise: extrapolated.mean_variance().sqrt(),
            bias: bias.bound(),
            visible_bias: bias.visible(),
            chosen: false,
        };
        rungs.push(rung);
        // Noise only grows from here on: without a bias to lose, no smaller step is better.
        if rungs.len() >= 2 && rungs.iter().rev().take(2).all(|r| r.visible_bias == 0.0) {
            break;
        }
    }
    let chosen = choose(&rungs, 0.5 * tolerance * size);
    rungs[chosen].chosen = true;
    Ok(Sweep { side, step: rungs[chosen].step, rungs })
}

/// The first rung whose error is within a quarter of the least, when the least noisy one has this noise.
fn choose(rungs: &[Rung], wanted: f64) -> usize {
    let least = rungs.iter().map(|r| r.noise).fold(f64::INFINITY, f64::min);
    let share = if least > wanted { wanted / least } else { 1.0 };
    // Noise does not fall with the step: where it seems to, its rare part was not met.
    let mut noise = 0.0f64;
    let errors: Vec<f64> = rungs
        .iter()
        .map(|r| {
            noise = noise.max(r.noise);
            (noise * share).hypot(r.visible_bias)
        })
        .collect();
    let best = errors.iter().copied().fold(f64::INFINITY, f64::min);
    errors.iter().position(|&e| e <= 1.25 * best).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_to_come_favour_small_bias() {
        let rung = |step: f64, noise, bias| Rung { step, noise, bias, visible_bias: bias, chosen: false };
        let rungs = [rung(1.0, 1.0, 0.3), rung(0.5, 1.2, 0.02), rung(0.25, 1.5, 0.001)];
        assert_eq!(choose(&rungs, 0.03), 1);
        assert_eq!(choose(&rungs, 0.0001), 2);
        assert_eq!(choose(&rungs, 1.0), 0);
        // Noise that seems to vanish is not believed.
        assert_eq!(choose(&[rung(1.0, 1.0, 0.0), rung(0.5, 0.9, 0.0), rung(0.25, 0.0, 0.0)], 1.0), 0);
    }
}
