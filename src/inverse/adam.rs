//! Adam (Kingma and Ba 2015) in a box, and the rule that ends it.
//!
//! Parameters are counted in shares of their bounds' extents, u in 0..1; after a step they are projected into the box. The step size
//! decays geometrically to a floor that keeps the rule below meaningful.

/// What ends a fit.
///
/// Converged: over the last `window` iterations every parameter stayed within `tolerance` of its extent, although the step sizes would
/// have carried it at least twice as far had its gradient kept a direction; its gradient was not zero all the while; and the mean
/// loss of the second half of the window is not significantly (two standard errors) below that of the first half.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StopRule {
    pub window: usize,
    /// Share of the bounds' extent.
    pub tolerance: f64,
}

impl Default for StopRule {
    fn default() -> Self {
        StopRule { window: 30, tolerance: 0.005 }
    }
}

/// One iteration as the rule sees it, in shares of extents.
pub struct Seen {
    pub u: Vec<f64>,
    pub gradient: Vec<f64>,
    /// Step size of every parameter.
    pub rate: Vec<f64>,
    pub loss: f64,
}

impl StopRule {
    /// The step size below which decay stops: a window of them covers three tolerances.
    pub fn least_rate(&self) -> f64 {
        3.0 * self.tolerance / self.window as f64
    }

    pub fn converged(&self, history: &[Seen]) -> bool {
        let Some(first) = history.len().checked_sub(self.window) else { return false };
        let last = &history[first..];
        let settled = |k: usize| {
            let u = || last.iter().map(|s| s.u[k]);
            let spread = u().fold(f64::NEG_INFINITY, f64::max) - u().fold(f64::INFINITY, f64::min);
            let reach: f64 = last.iter().map(|s| s.rate[k]).sum();
            let blind = last.iter().all(|s| s.gradient[k] == 0.0);
            spread <= self.tolerance && reach >= 2.0 * self.tolerance && !blind
        };
        (0..last[0].u.len()).all(settled) && !improves(last)
    }
}

/// Whether the mean loss of the second half lies two standard errors below that of the first.
fn improves(last: &[Seen]) -> bool {
    let (a, b) = last.split_at(last.len() / 2);
    let moments = |s: &[Seen]| s.iter().map(|s| s.loss).collect::<crate::math::stats::Moments>();
    let (a, b) = (moments(a), moments(b));
    a.mean - b.mean > 2.0 * a.standard_error().hypot(b.standard_error())
}

/// The state of one run.
pub struct Adam {
    pub u: Vec<f64>,
    pub first: Vec<f64>,
    pub second: Vec<f64>,
    /// Steps so far: they decide how far the step size has fallen.
    pub step: i32,
    /// Steps since the memory began.
    pub age: i32,
    /// Of every parameter, at the start.
    rate: Vec<f64>,
    least: f64,
    /// Iterations in which the step size falls to a half.
    half_life: f64,
    /// Memory of the gradient's mean and of its square.
    memory: [f64; 2],
}

/// Memory of the gradient's mean and of its square; the latter is short, because gradients change by orders of magnitude.
const BETA: [f64; 2] = [0.85, 0.95];
/// The same for fields.
const FIELD_BETA: [f64; 2] = [0.9, 0.99];

impl Adam {
    pub fn new(u: Vec<f64>, rate: Vec<f64>, half_life: f64, rule: &StopRule) -> Self {
        let zero = vec![0.0; u.len()];
        let (least, memory) = (rule.least_rate(), BETA);
        Adam { u, first: zero.clone(), second: zero, step: 0, age: 0, rate, least, half_life, memory }
    }

    /// With the memory that fields want: gradients of voxels are noise in the main, and of changing views.
    #[must_use]
    pub fn for_fields(self) -> Self {
        Adam { memory: FIELD_BETA, ..self }
    }

    /// Other parameters in place of these, each with its first step size; the step size goes on falling, the memory begins anew.
    pub fn replace(&mut self, u: Vec<f64>, rate: Vec<f64>) {
        (self.first, self.second) = (vec![0.0; u.len()], vec![0.0; u.len()]);
        (self.u, self.rate, self.age) = (u, rate, 0);
    }

    /// The step sizes of the next step.
    pub fn rates(&self) -> Vec<f64> {
        let decay = 0.5f64.powf(f64::from(self.step) / self.half_life);
        self.rate.iter().map(|r| (r * decay).max(self.least.min(*r))).collect()
    }

    pub fn step(&mut self, gradient: &[f64]) {
        let rates = self.rates();
        self.step += 1;
        self.age += 1;
        let memory = self.memory;
        let corrections = memory.map(|b| 1.0 - b.powi(self.age));
        for (k, &g) in gradient.iter().enumerate() {
            self.first[k] = memory[0] * self.first[k] + (1.0 - memory[0]) * g;
            self.second[k] = memory[1] * self.second[k] + (1.0 - memory[1]) * g * g;
            let (m, v) = (self.first[k] / corrections[0], self.second[k] / corrections[1]);
            if v > 0.0 {
                self.u[k] = (self.u[k] - rates[k] * m / v.sqrt()).clamp(0.0, 1.0);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    /// Minimise a (u - 0.3)^2 with noisy gradients; returns where and when it converged.
    fn run(start: f64, noise: f64, pull: f64) -> (f64, Option<usize>) {
        let rule = StopRule::default();
        let mut adam = Adam::new(vec![start], vec![0.05], 30.0, &rule);
        let mut rng = Rng::keyed(1, 0, 0, 0);
        let mut seen = Vec::new();
        for i in 0..400 {
            let (u, rate) = (adam.u.clone(), adam.rates());
            let gradient = vec![2.0 * pull * (u[0] - 0.3) + noise * (rng.uniform() - 0.5)];
            adam.step(&gradient);
            seen.push(Seen { loss: pull * (u[0] - 0.3).powi(2), u, gradient, rate });
            if rule.converged(&seen) {
                return (adam.u[0], Some(i));
            }
        }
        (adam.u[0], None)
    }

    #[test]
    fn the_minimum_is_found_through_noise() {
        for noise in [0.0, 0.1, 1.0] {
            let (u, when) = run(0.9, noise, 1.0);
            assert!((u - 0.3).abs() < 0.02 && when.is_some(), "noise {noise}: {u} {when:?}");
        }
    }

    #[test]
    fn bounds_hold_and_a_blind_parameter_never_converges() {
        // The minimum of -u lies at the upper bound.
        let (u, when) = run(0.5, 0.0, -1.0);
        assert_eq!((u, when.is_some()), (1.0, true));
        assert_eq!(run(0.5, 0.0, 0.0), (0.5, None));
    }
}
