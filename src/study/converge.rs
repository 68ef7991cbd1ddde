//! Error against run time: root mean square error of the pixels of picture and derivative, for doubling numbers of samples.
//!
//! MSE(n) = mean over pixels and channels of (x_n - r)^2 - var(r), with a reference r from other seeds (a long run of the same
//! estimator, unbiased) whose own variance is taken off. Finite differences are measured against the same derivative
//! reference, so that the bias of their step counts; each of several steps is a curve, their lower envelope is what the best
//! step would give.

use super::differences::{At, Difference};
use super::rounds::{Rounds, mean};
use super::sweep;
use crate::error::Result;
use crate::params::ParamSet;
use crate::render::driver::Outcome;
use crate::render::family::{Family, Member, View, numbers, stream};
use crate::render::health::Health;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Steps of the finite differences: each a quarter of the one before.
const STEPS: i32 = 5;
/// Runs of one number of samples whose errors are averaged, while they are short.
const RUNS: u64 = 4;
/// A point counts while its mean square error is at least this many times the variance of the reference.
const CLEAR: f64 = 3.0;

#[derive(Clone, Debug)]
pub struct ConvergeOptions {
    pub seed: u64,
    /// For the references, and again for all curves together.
    pub time: Duration,
}

/// What a curve is measured against.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Three channels a pixel.
    pub image: Vec<f64>,
    /// Mean variance of its pixels; 0 where it is not known.
    pub variance: f64,
    pub spp: f64,
}

impl Reference {
    fn of(r: &Rounds) -> Self {
        Reference { image: r.mean.clone(), variance: r.mean_variance(), spp: r.samples }
    }

    fn mse(&self, x: &[f64]) -> f64 {
        mean(x.iter().zip(&self.image).map(|(a, b)| (a - b) * (a - b))) - self.variance
    }

    fn mean_abs(&self) -> f64 {
        mean(self.image.iter().map(|x| x.abs()))
    }
}

#[derive(Clone, Copy, Debug, Serialize)]
pub struct Point {
    pub spp: u64,
    /// Of one run.
    pub seconds: f64,
    pub rmse: f64,
    pub runs: u64,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    Picture,
    Derivative,
    Term,
    FiniteDifference,
}

#[derive(Clone, Debug, Serialize)]
pub struct Curve {
    pub kind: Kind,
    pub name: String,
    /// Parameter of a derivative.
    pub parameter: Option<String>,
    /// Of a finite difference.
    pub step: Option<f64>,
    pub points: Vec<Point>,
    pub reference_rmse: f64,
    pub reference_spp: f64,
    /// Mean |reference|.
    pub mean_abs: f64,
    /// rmse^2 * seconds, its median over the points: what an unbiased estimator keeps. None without points.
    pub cost: Option<f64>,
}

/// Times at which both reach one error.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Level {
    pub rmse: f64,
    pub step: f64,
    pub seconds_differences: f64,
    pub seconds_ours: f64,
    pub ratio: f64,
}

#[derive(Clone, Debug, Serialize)]
pub struct Speedup {
    pub parameter: String,
    /// At the smallest error that any step reached.
    pub speedup: Option<f64>,
    /// On the lower envelope of the steps.
    pub levels: Vec<Level>,
}

/// One estimator: samples a pixel and seed to an image.
type Estimate<'a> = dyn Fn(u64, u64) -> Result<Vec<f64>> + 'a;

/// References given by the user: by layer (empty: the picture).
pub type Given<'a> = dyn Fn(&str) -> Option<Reference> + 'a;

pub struct Study {
    pub curves: Vec<Curve>,
    pub speedups: Vec<Speedup>,
    pub health: Health,
    pub samples: f64,
}

/// Measure picture and derivatives.
pub fn converge(
    family: &Family,
    view: View,
    wrt: &[String],
    options: &ConvergeOptions,
    given: &Given,
    say: &mut dyn FnMut(String),
) -> Result<Study> {
    let member = family.at(&[])?;
    let mut bench = Bench {
        member,
        view,
        seed: options.seed,
        share: options.time / (1 + wrt.len()) as u32,
        study: Study { curves: Vec::new(), speedups: Vec::new(), health: Health::new(), samples: 0.0 },
    };
    bench.picture(given, say)?;
    for name in wrt {
        bench.derivative(family, name, given, say)?;
    }
    Ok(bench.study)
}

struct Bench<'a> {
    member: Member,
    view: View<'a>,
    seed: u64,
    /// Time for the references of one layer, and for its curves.
    share: Duration,
    study: Study,
}

impl Bench<'_> {
    fn picture(&mut self, given: &Given, say: &mut dyn FnMut(String)) -> Result<()> {
        let reference = match given("") {
            Some(r) => r,
            None => {
                let run = |spp, seed| self.view.picture(&self.member.scene, spp, seed);
                let (references, spp) = self.references(&run)?;
                self.study.samples += spp;
                Reference::of(&references[0].1)
            }
        };
        say(format!("reference of the picture: {} samples a pixel", reference.spp));
        let run = |spp, seed| Ok(numbers(&self.view.picture(&self.member.scene, spp, seed)?, 0));
        let curve = curve(Kind::Picture, "picture", &reference, self.share, self.seed, &run)?;
        self.study.curves.push(curve);
        Ok(())
    }

    fn derivative(&mut self, family: &Family, name: &str, given: &Given, say: &mut dyn FnMut(String)) -> Result<()> {
        let params = self.member.scene.param_set(&self.member.desc, &[name.to_string()])?;
        let run = |spp, seed| self.view.split(&self.member.scene, &params, spp, seed);
        let (references, spp) = self.references(&run)?;
        self.study.samples += spp;
        let layer = format!("d_{name}");
        let find = |wanted: &str| {
            given(wanted).or_else(|| references.iter().find(|(n, _)| n == wanted).map(|(_, r)| Reference::of(r)))
        };
        let Some(total) = find(&layer) else { return Ok(()) };
        say(format!("reference of {layer}: {} samples a pixel", total.spp));
        // Half of the time for ours, half for the differences.
        let terms: Vec<String> =
            references.iter().filter_map(|(n, _)| n.strip_prefix(&format!("{layer}."))).map(String::from).collect();
        let share = self.share / 2 / (1 + terms.len()) as u32;
        let ours = self.ours(&params, self.view, share, &layer, Kind::Derivative, &total)?;
        let mut found = vec![ours];
        for term in terms.iter().filter(|_| terms.len() > 1) {
            let one = [term.clone()];
            let layer = format!("{layer}.{term}");
            if let Some(reference) = find(&layer) {
                let view = View { terms: &one, ..self.view };
                found.push(self.ours(&params, view, share, &layer, Kind::Term, &reference)?);
            }
        }
        say(format!("{layer}: finite differences"));
        let differences = self.differences(family, name, &total)?;
        self.study.speedups.push(speedup(name, &found[0], &differences));
        found.extend(differences);
        found.iter_mut().for_each(|c| c.parameter = Some(name.into()));
        self.study.curves.extend(found);
        Ok(())
    }

    fn ours(
        &self,
        params: &ParamSet,
        view: View,
        time: Duration,
        name: &str,
        kind: Kind,
        reference: &Reference,
    ) -> Result<Curve> {
        let run = |spp, seed| Ok(numbers(&view.derivative(&self.member.scene, params, spp, seed)?, 1));
        curve(kind, name, reference, time, self.seed, &run)
    }

    fn differences(&self, family: &Family, name: &str, reference: &Reference) -> Result<Vec<Curve>> {
        let value = self.member.desc.params[self.member.desc.wrt(name)?].value;
        let at = At { family, name, value };
        let (side, first) = sweep::start(&at, at.largest_step()?)?;
        let time = self.share / 2 / STEPS as u32;
        let one = |k| {
            let step = first * 0.25f64.powi(k);
            let difference = Difference::plain(&at, side, step)?;
            let run = |spp, seed| Ok(difference.round(&self.view, spp, seed, &self.study.health)?.swap_remove(0));
            let name = format!("difference {step:.1e}");
            let mut c = curve(Kind::FiniteDifference, &name, reference, time, self.seed, &run)?;
            c.step = Some(step);
            Ok(c)
        };
        (0..STEPS).map(one).collect()
    }

    /// All layers of a long run, by name; also its samples. Rounds double until the time is over.
    fn references(&self, run: &dyn Fn(u64, u64) -> Result<Outcome>) -> Result<(Vec<(String, Rounds)>, f64)> {
        let start = Instant::now();
        let mut layers: Vec<(String, Rounds)> = Vec::new();
        let (mut spp, mut samples) = (1, 0.0);
        for round in 0.. {
            let began = Instant::now();
            let o = run(spp, stream(self.seed, 5, round))?;
            self.study.health.merge(&o.film.health);
            samples += (spp * self.view.pixels() as u64) as f64;
            if layers.is_empty() {
                layers = o.film.spec().layers.iter().map(|n| (n.clone(), Rounds::default())).collect();
            }
            for (l, (_, r)) in layers.iter_mut().enumerate() {
                r.push(&numbers(&o, l), spp as f64);
            }
            // 16 rounds at least, for the variance; then the time counts.
            let (last, left) = (began.elapsed(), self.share.saturating_sub(start.elapsed()));
            if round >= 15 && left < last {
                break;
            }
            if left > 32 * last && spp < 1 << 30 {
                spp *= 2;
            }
        }
        Ok((layers, samples))
    }
}

/// Runs of doubling samples until the time is over.
fn curve(kind: Kind, name: &str, reference: &Reference, time: Duration, seed: u64, run: &Estimate) -> Result<Curve> {
    let start = Instant::now();
    let mut points = Vec::new();
    for k in 0..40u32 {
        let spp = 1 << k;
        let (mut mse, mut seconds, mut runs) = (0.0, 0.0, 0);
        for r in 0..RUNS {
            let began = Instant::now();
            let x = run(spp, stream(seed, 6, u64::from(k) * RUNS + r))?;
            seconds += began.elapsed().as_secs_f64();
            mse += reference.mse(&x);
            runs += 1;
            // One run is enough where a fifth of the time is gone for it.
            if seconds > 0.05 * time.as_secs_f64() {
                break;
            }
        }
        let (mse, seconds) = (mse / runs as f64, seconds / runs as f64);
        if mse < CLEAR * reference.variance {
            break;
        }
        points.push(Point { spp, seconds, rmse: mse.sqrt(), runs });
        if start.elapsed().as_secs_f64() + 2.0 * seconds > time.as_secs_f64() {
            break;
        }
    }
    let costs = points.iter().map(|p| p.rmse * p.rmse * p.seconds).collect();
    Ok(Curve {
        kind,
        name: name.into(),
        parameter: None,
        step: None,
        cost: (!points.is_empty()).then(|| crate::math::stats::median(costs)),
        points,
        reference_rmse: reference.variance.sqrt(),
        reference_spp: reference.spp,
        mean_abs: reference.mean_abs(),
    })
}

/// The lower envelope of all steps: points whose error no quicker one reaches; the time of ours from its cost.
fn speedup(parameter: &str, ours: &Curve, differences: &[Curve]) -> Speedup {
    let mut all: Vec<(f64, Point)> =
        differences.iter().flat_map(|c| c.points.iter().map(move |p| (c.step.unwrap_or(0.0), *p))).collect();
    all.sort_by(|a, b| a.1.seconds.total_cmp(&b.1.seconds));
    let mut levels: Vec<Level> = Vec::new();
    for (step, p) in all {
        if let Some(cost) = ours.cost.filter(|_| levels.last().is_none_or(|l| p.rmse < l.rmse)) {
            let seconds_ours = cost / (p.rmse * p.rmse);
            let ratio = p.seconds / seconds_ours;
            levels.push(Level { rmse: p.rmse, step, seconds_differences: p.seconds, seconds_ours, ratio });
        }
    }
    Speedup { parameter: parameter.into(), speedup: levels.last().map(|l| l.ratio), levels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_envelope_keeps_what_nothing_quicker_reaches() {
        let curve = |kind, step, points: &[(f64, f64)]| Curve {
            kind,
            name: String::new(),
            parameter: None,
            step,
            points: points.iter().map(|&(seconds, rmse)| Point { spp: 1, seconds, rmse, runs: 1 }).collect(),
            reference_rmse: 0.0,
            reference_spp: 1.0,
            mean_abs: 1.0,
            cost: Some(1.0),
        };
        let ours = curve(Kind::Derivative, None, &[(1.0, 1.0)]);
        let coarse = curve(Kind::FiniteDifference, Some(1.0), &[(1.0, 2.0), (4.0, 1.5), (16.0, 1.5)]);
        let fine = curve(Kind::FiniteDifference, Some(0.1), &[(1.1, 8.0), (4.4, 4.0), (17.0, 1.0)]);
        let s = speedup("a", &ours, &[coarse, fine]);
        let levels: Vec<(f64, f64)> = s.levels.iter().map(|l| (l.rmse, l.ratio)).collect();
        assert_eq!(levels, [(2.0, 4.0), (1.5, 9.0), (1.0, 17.0)]);
        assert_eq!(s.speedup, Some(17.0));
    }
}
