//! A fit: minimise loss(I(x), T) over parameters x in a box.
//!
//! Gradient by [T] 1.5: dL/dx = sum over pixels of l'(I_A) * dI_B/dx, I_A and dI_B/dx from independent streams: unbiased for
//! quadratic losses whatever the number of samples.

use super::adam::{Adam, Seen, StopRule};
use super::loss::Loss;
use crate::error::{Error, Result};
use crate::math::Rgb;
use crate::render::family::{Family, View, stream};
use crate::render::health::Health;
use serde::Serialize;
use std::time::{Duration, Instant};

/// A parameter that is searched for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Unknown {
    pub name: String,
    pub min: f64,
    pub max: f64,
    /// First step, as a share of the extent.
    pub rate: f64,
}

impl Unknown {
    pub fn extent(&self) -> f64 {
        self.max - self.min
    }
}

/// What all runs of a fit share.
pub struct Problem<'a> {
    pub family: &'a Family,
    pub view: View<'a>,
    pub unknowns: &'a [Unknown],
    pub target: Vec<Rgb>,
    pub loss: Loss,
    /// Samples a pixel and an iteration: of the picture, and again of the derivative.
    pub spp: u64,
    pub iterations: usize,
    pub max_time: Duration,
    /// Iterations in which the step size falls to a half.
    pub half_life: f64,
    pub rule: StopRule,
}

/// One iteration.
#[derive(Clone, Debug, Serialize)]
pub struct Step {
    pub iteration: usize,
    pub seconds: f64,
    pub loss: f64,
    /// Standard error of the loss.
    pub error: f64,
    pub values: Vec<f64>,
    pub gradient: Vec<f64>,
}

/// The end of one run.
#[derive(Clone, Debug, Serialize)]
pub struct Recovered {
    pub seed: u64,
    pub start: Vec<f64>,
    /// Mean over the last window of iterations.
    pub values: Vec<f64>,
    pub converged: bool,
    /// Why it ended.
    pub reason: &'static str,
    pub iterations: usize,
    pub seconds: f64,
    /// Mean over the last window.
    pub loss: f64,
    #[serde(skip)]
    pub history: Vec<Step>,
}

/// Run one fit; `tell` hears every iteration. A signal ends it as time does.
pub fn fit(p: &Problem, start: &[f64], seed: u64, health: &Health, tell: &mut dyn FnMut(&Step)) -> Result<Recovered> {
    let began = Instant::now();
    let share = |k: usize, x: f64| (x - p.unknowns[k].min) / p.unknowns[k].extent();
    let u = start.iter().enumerate().map(|(k, &x)| share(k, x)).collect();
    let mut adam = Adam::new(u, p.unknowns.iter().map(|x| x.rate).collect(), p.half_life, &p.rule);
    let (mut history, mut seen): (Vec<Step>, Vec<Seen>) = (Vec::new(), Vec::new());
    let mut reason = "the iterations are over";
    for iteration in 0..p.iterations {
        let values: Vec<f64> = p.unknowns.iter().zip(&adam.u).map(|(x, u)| x.min + u * x.extent()).collect();
        let (loss, error, gradient) = match gradient(p, &values, seed, iteration as u64, health) {
            Err(Error::Interrupted) => {
                reason = "stopped by a signal";
                break;
            }
            g => g?,
        };
        if !loss.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            let what = format!("iteration {iteration}: the loss or its gradient is not a number");
            return Err(Error::Runtime(format!("{what}; raise --spp to 2 or more")));
        }
        let step = Step { iteration, seconds: began.elapsed().as_secs_f64(), loss, error, values, gradient };
        tell(&step);
        let scaled: Vec<f64> = step.gradient.iter().zip(p.unknowns).map(|(g, x)| g * x.extent()).collect();
        let (u, rate) = (adam.u.clone(), adam.rates());
        adam.step(&scaled);
        seen.push(Seen { u, gradient: scaled, rate, loss });
        history.push(step);
        if p.rule.converged(&seen) {
            reason = "converged";
            break;
        }
        if began.elapsed() >= p.max_time {
            reason = "the time is over";
            break;
        }
    }
    let last = &history[history.len().saturating_sub(p.rule.window)..];
    let mean = |f: &dyn Fn(&Step) -> f64| last.iter().map(f).sum::<f64>() / last.len() as f64;
    let values = (0..p.unknowns.len()).map(|k| mean(&|s| s.values[k])).collect();
    Ok(Recovered {
        seed,
        start: start.to_vec(),
        values,
        converged: reason == "converged",
        reason,
        iterations: history.len(),
        seconds: began.elapsed().as_secs_f64(),
        loss: mean(&|s| s.loss),
        history,
    })
}

/// Loss, its error and its gradient at some values.
fn gradient(p: &Problem, x: &[f64], seed: u64, iteration: u64, health: &Health) -> Result<(f64, f64, Vec<f64>)> {
    let names: Vec<String> = p.unknowns.iter().map(|u| u.name.clone()).collect();
    let values: Vec<(&str, f64)> = names.iter().map(String::as_str).zip(x.iter().copied()).collect();
    let member = p.family.at(&values)?;
    let params = member.scene.param_set(&member.desc, &names)?;
    let a = p.view.picture(&member.scene, p.spp, stream(seed, 1, iteration))?;
    let b = p.view.derivative(&member.scene, &params, p.spp, stream(seed, 2, iteration))?;
    health.merge(&a.film.health);
    health.merge(&b.film.health);
    let loss = p.loss.evaluate(&a.film, &p.target)?;
    let product = |k: usize| loss.adjoint.iter().enumerate().map(|(i, w)| w.dot(b.film.mean(k + 1, i))).sum();
    Ok((loss.value, loss.error, (0..names.len()).map(product).collect()))
}
