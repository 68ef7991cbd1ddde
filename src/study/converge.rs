//! Error against run time: root mean square error of the pixels of picture and derivative, for doubling numbers of samples.
//!
//! MSE(n) = mean over pixels and channels of (x_n - r)^2 - var(r), with a reference r from other seeds (a long run of the same
//! estimator, unbiased) whose own variance is taken off. Finite differences are measured against the same derivative
//! reference, so that the bias of their step counts; each of several steps is a curve, their lower envelope is what the best
//! step gives. Time goes to the step that promises the least error by the end: `c / t + b^2`, noise and bias fitted to its curve
//! so far, so coarse steps stop where their bias dominates. Differences have six times our own time.

use super::differences::{At, Difference};
use super::rounds::{Rounds, mean};
use super::sweep;
use crate::error::Result;
use crate::math::stats::median;
use crate::params::ParamSet;
use crate::render::driver::Outcome;
use crate::render::family::{Family, Member, View, numbers, stream};
use crate::render::health::Health;
use serde::Serialize;
use std::cell::Cell;
use std::time::{Duration, Instant};

/// Steps of the finite differences: each half of the one before.
const STEPS: i32 = 9;
/// Time of the picture over that of a derivative, where there is one.
const PICTURE: f64 = 0.25;
/// Shares of a derivative's time: its own curve, everything that terms ask for, and what each step of a difference gets to show what it is good for.
/// The rest is for the step that promises most.
const OURS: f64 = 0.125;
const TERMS: f64 = 0.125;
const TRIAL: f64 = 0.01;
/// How much quicker than differences the derivative is asked to be: levels say what it reaches in that share of their time.
const ASKED: f64 = 30.0;
/// Runs of one number of samples whose errors are averaged, while they are short.
const RUNS: u64 = 4;
/// A point counts while its mean square error is at least this many times the variance of the reference.
const CLEAR: f64 = 3.0;

#[derive(Clone, Debug)]
pub struct ConvergeOptions {
    pub seed: u64,
    /// For the references, and again for all curves together.
    pub time: Duration,
    /// Measure the derivative without each of its terms too.
    pub ablate: bool,
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
    /// The derivative without one term, against the reference of all.
    Without,
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
    /// The reference is no better than the next point would be.
    #[serde(skip)]
    over: bool,
}

/// Times at which both reach one error. Ours are read off its curve (straight lines between points, both axes logarithmic).
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Level {
    pub rmse: f64,
    pub step: f64,
    pub seconds_differences: f64,
    /// None where our curve ends above that error.
    pub seconds_ours: Option<f64>,
    pub ratio: Option<f64>,
    /// Our error in a thirtieth of their time; None outside of our curve.
    pub rmse_in_a_thirtieth: Option<f64>,
}

#[derive(Clone, Debug, Serialize)]
pub struct Speedup {
    pub parameter: String,
    /// At the smallest error that both reached.
    pub speedup: Option<f64>,
    pub rmse: Option<f64>,
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
        share: options.time.as_secs_f64() / (if wrt.is_empty() { 1.0 } else { PICTURE + wrt.len() as f64 }),
        ablate: options.ablate,
        study: Study { curves: Vec::new(), speedups: Vec::new(), health: Health::new(), samples: 0.0 },
    };
    bench.picture(if wrt.is_empty() { 1.0 } else { PICTURE }, given, say)?;
    for name in wrt {
        bench.derivative(family, name, given, say)?;
    }
    Ok(bench.study)
}

struct Bench<'a> {
    member: Member,
    view: View<'a>,
    seed: u64,
    /// Seconds for the references of one layer, and for its curves.
    share: f64,
    ablate: bool,
    study: Study,
}

impl Bench<'_> {
    /// In the given part of a derivative's time.
    fn picture(&mut self, share: f64, given: &Given, say: &mut dyn FnMut(String)) -> Result<()> {
        self.share *= share;
        let reference = match given("") {
            Some(r) => r,
            None => {
                let run = |spp, seed| self.view.picture(&self.member.scene, spp, seed);
                let (references, spp) = self.references(&run, self.share)?;
                self.study.samples += spp;
                Reference::of(&references[0].1)
            }
        };
        say(format!("reference of the picture: {} samples a pixel", reference.spp));
        let run = |spp, seed| Ok(numbers(&self.view.picture(&self.member.scene, spp, seed)?, 0));
        let curve = Curve::new(Kind::Picture, "picture", &reference).grown(&reference, self.share, self.seed, &run)?;
        self.share /= share;
        self.study.curves.push(curve);
        Ok(())
    }

    fn derivative(&mut self, family: &Family, name: &str, given: &Given, say: &mut dyn FnMut(String)) -> Result<()> {
        let params = self.member.scene.param_set(&self.member.desc, &[name.to_string()])?;
        let run = |spp, seed| self.view.split(&self.member.scene, &params, spp, seed);
        let layer = format!("d_{name}");
        // A glance tells which layers there are; what the file has of them is not rendered.
        let (mut references, mut spp) = self.references(&run, 0.0)?;
        if references.iter().any(|(n, _)| n.starts_with(&layer) && given(n).is_none()) {
            say(format!("{layer}: rendering references"));
            let (found, more) = self.references(&run, self.share)?;
            (references, spp) = (found, spp + more);
        }
        self.study.samples += spp;
        let find = |wanted: &str| {
            given(wanted).or_else(|| references.iter().find(|(n, _)| n == wanted).map(|(_, r)| Reference::of(r)))
        };
        let Some(total) = find(&layer) else { return Ok(()) };
        say(format!("reference of {layer}: {} samples a pixel", total.spp));
        let mut found = vec![self.ours(&params, self.view, OURS * self.share, &layer, Kind::Derivative, &total)?];
        let terms: Vec<String> =
            references.iter().filter_map(|(n, _)| n.strip_prefix(&format!("{layer}."))).map(String::from).collect();
        // One term is the derivative itself.
        if terms.len() > 1 {
            let time = TERMS * self.share / (terms.len() * if self.ablate { 2 } else { 1 }) as f64;
            for term in &terms {
                let one = [term.clone()];
                let name = format!("{layer}.{term}");
                if let Some(reference) = find(&name) {
                    let view = View { terms: &one, ..self.view };
                    found.push(self.ours(&params, view, time, &name, Kind::Term, &reference)?);
                }
                if self.ablate {
                    let rest: Vec<String> = terms.iter().filter(|t| *t != term).cloned().collect();
                    let view = View { terms: &rest, ..self.view };
                    let name = format!("{layer} without {term}");
                    found.push(self.ours(&params, view, time, &name, Kind::Without, &total)?);
                }
            }
        }
        say(format!("{layer}: finite differences"));
        let (differences, spp) = self.differences(family, name, &total, say)?;
        self.study.samples += spp;
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
        time: f64,
        name: &str,
        kind: Kind,
        reference: &Reference,
    ) -> Result<Curve> {
        let run = |spp, seed| Ok(numbers(&view.derivative(&self.member.scene, params, spp, seed)?, 1));
        Curve::new(kind, name, reference).grown(reference, time, self.seed, &run)
    }

    /// A trial of every step; then all time to the one that promises the least error by the end. Also their samples.
    fn differences(
        &self,
        family: &Family,
        name: &str,
        reference: &Reference,
        say: &mut dyn FnMut(String),
    ) -> Result<(Vec<Curve>, f64)> {
        let value = self.member.desc.params[self.member.desc.wrt(name)?].value;
        let at = At { family, name, value };
        let (side, first) = sweep::start(&at, at.largest_step()?)?;
        let samples = Cell::new(0.0);
        let run = |d: &Difference, spp, seed| {
            samples.set(samples.get() + (d.pictures() * self.view.pixels()) as f64 * spp as f64);
            Ok(d.round(&self.view, spp, seed, &self.study.health)?.swap_remove(0))
        };
        let start = Instant::now();
        let mut curves = Vec::new();
        for k in 0..STEPS {
            let step = first * 0.5f64.powi(k);
            let d = Difference::plain(&at, side, step)?;
            let mut c = Curve::new(Kind::FiniteDifference, &format!("difference {step:.1e}"), reference);
            c.step = Some(step);
            c = c.grown(reference, TRIAL * self.share, self.seed, &|spp, seed| run(&d, spp, seed))?;
            curves.push((d, c));
        }
        let end = (1.0 - OURS - TERMS) * self.share;
        loop {
            let left = end - start.elapsed().as_secs_f64();
            let fits = curves.iter_mut().filter(|(_, c)| !c.over && c.next_seconds() <= left);
            let Some((d, c)) = fits.min_by(|a, b| a.1.promise(left).total_cmp(&b.1.promise(left))) else { break };
            c.extend(reference, 0.0, self.seed, &|spp, seed| run(d, spp, seed))?;
            if let Some(p) = c.points.last() {
                say(format!("{}: {} samples a pixel, error {:.2} %", c.name, p.spp, 100.0 * p.rmse / c.mean_abs));
            }
        }
        Ok((curves.into_iter().map(|(_, c)| c).collect(), samples.get()))
    }

    /// All layers of a long run, by name; also its samples. Rounds double until the time is over.
    fn references(&self, run: &dyn Fn(u64, u64) -> Result<Outcome>, time: f64) -> Result<(Vec<(String, Rounds)>, f64)> {
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
            let (last, left) = (began.elapsed().as_secs_f64(), time - start.elapsed().as_secs_f64());
            if round >= 15 && left < last {
                break;
            }
            if left > 32.0 * last && spp < 1 << 30 {
                spp *= 2;
            }
        }
        Ok((layers, samples))
    }
}

impl Curve {
    fn new(kind: Kind, name: &str, reference: &Reference) -> Self {
        Curve {
            kind,
            name: name.into(),
            parameter: None,
            step: None,
            points: Vec::new(),
            reference_rmse: reference.variance.sqrt(),
            reference_spp: reference.spp,
            mean_abs: reference.mean_abs(),
            cost: None,
            over: false,
        }
    }

    /// Points until `time` is over.
    fn grown(mut self, reference: &Reference, time: f64, seed: u64, run: &Estimate) -> Result<Curve> {
        let start = Instant::now();
        while !self.over && start.elapsed().as_secs_f64() + self.next_seconds() <= time {
            self.extend(reference, 0.05 * time, seed, run)?;
        }
        Ok(self)
    }

    /// The next point, of twice the samples: several runs while they take no more than `brief` seconds together.
    fn extend(&mut self, reference: &Reference, brief: f64, seed: u64, run: &Estimate) -> Result<()> {
        let k = self.points.len() as u64;
        let spp = 1 << k;
        let (mut mse, mut seconds, mut runs) = (0.0, 0.0, 0);
        while runs < RUNS && (runs == 0 || seconds < brief) {
            let began = Instant::now();
            let x = run(spp, stream(seed, 6, k * RUNS + runs))?;
            seconds += began.elapsed().as_secs_f64();
            mse += reference.mse(&x);
            runs += 1;
        }
        let (mse, seconds) = (mse / runs as f64, seconds / runs as f64);
        // Where the reference is no better there is nothing to measure.
        self.over = mse < CLEAR * reference.variance || k >= 40;
        if !self.over {
            self.points.push(Point { spp, seconds, rmse: mse.sqrt(), runs });
            self.cost = Some(median(self.costs(self.points.len())));
        }
        Ok(())
    }

    fn costs(&self, first: usize) -> Vec<f64> {
        self.points[..first].iter().map(|p| p.rmse * p.rmse * p.seconds).collect()
    }

    /// Seconds of the next point; 0 for the first.
    fn next_seconds(&self) -> f64 {
        self.points.last().map_or(0.0, |p| 2.0 * p.seconds)
    }

    /// MSE after one run of `seconds`: noise as in the first half of the points, where bias is least; bias as in the last.
    fn promise(&self, seconds: f64) -> f64 {
        let Some(last) = self.points.last() else { return 0.0 };
        let noise = median(self.costs(self.points.len().div_ceil(2)));
        // The fit's own error is no bias.
        noise / seconds + (last.rmse * last.rmse - 1.25 * noise / last.seconds).max(0.0)
    }

    /// Time to this error, from the points where it fell; None below the last of them.
    fn seconds_to(&self, rmse: f64) -> Option<f64> {
        let falling: Vec<(f64, f64)> = envelope(self.points.iter().map(|p| (p.seconds, p.rmse)));
        let i = falling.iter().position(|p| p.1 <= rmse)?;
        let (t, e) = falling[i];
        // Less than one sample takes as long as one.
        let Some(&(t0, e0)) = i.checked_sub(1).and_then(|j| falling.get(j)) else { return Some(t) };
        Some(t0 * (t / t0).powf((rmse / e0).ln() / (e / e0).ln()))
    }

    /// Error in this time; None outside of the points.
    fn rmse_in(&self, seconds: f64) -> Option<f64> {
        let falling: Vec<(f64, f64)> = envelope(self.points.iter().map(|p| (p.seconds, p.rmse)));
        let i = falling.iter().position(|p| p.0 >= seconds)?;
        let ((t, e), (t0, e0)) = (falling[i], *falling.get(i.checked_sub(1)?)?);
        Some(e0 * (e / e0).powf((seconds / t0).ln() / (t / t0).ln()))
    }
}

/// Of (seconds, error) in order of time: those whose error no quicker one reaches.
fn envelope(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    let mut kept: Vec<(f64, f64)> = Vec::new();
    for p in points {
        if kept.last().is_none_or(|l| p.1 < l.1 && p.0 > l.0) {
            kept.push(p);
        }
    }
    kept
}

/// Ours against the lower envelope of all steps.
fn speedup(parameter: &str, ours: &Curve, differences: &[Curve]) -> Speedup {
    let mut all: Vec<(f64, Point)> =
        differences.iter().flat_map(|c| c.points.iter().map(move |p| (c.step.unwrap_or(0.0), *p))).collect();
    all.sort_by(|a, b| a.1.seconds.total_cmp(&b.1.seconds));
    let mut levels: Vec<Level> = Vec::new();
    for (step, p) in all {
        if levels.last().is_some_and(|l| p.rmse >= l.rmse) {
            continue;
        }
        let seconds_ours = ours.seconds_to(p.rmse);
        levels.push(Level {
            rmse: p.rmse,
            step,
            seconds_differences: p.seconds,
            seconds_ours,
            ratio: seconds_ours.map(|t| p.seconds / t),
            rmse_in_a_thirtieth: ours.rmse_in(p.seconds / ASKED),
        });
    }
    let lowest = levels.iter().rev().find(|l| l.ratio.is_some());
    let (speedup, rmse) = (lowest.and_then(|l| l.ratio), lowest.map(|l| l.rmse));
    Speedup { parameter: parameter.into(), speedup, rmse, levels }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_envelope_keeps_what_nothing_quicker_reaches() {
        let ours = curve(None, &[(1.0, 2.0), (4.0, 1.0)]);
        let coarse = curve(Some(1.0), &[(1.0, 3.0), (4.0, 1.5), (16.0, 1.5)]);
        let fine = curve(Some(0.1), &[(1.1, 8.0), (4.4, 4.0), (17.0, 1.0), (60.0, 0.5)]);
        let s = speedup("a", &ours, &[coarse, fine]);
        let errors: Vec<f64> = s.levels.iter().map(|l| l.rmse).collect();
        assert_eq!(errors, [3.0, 1.5, 1.0, 0.5]);
        // Before our first point, between two, on one, beyond.
        assert_eq!(s.levels[0].ratio, Some(1.0));
        let between = 4f64.powf((0.75f64).ln() / (0.5f64).ln());
        assert!((s.levels[1].ratio.unwrap() - 4.0 / between).abs() < 1e-12);
        assert!((s.levels[2].ratio.unwrap() - 17.0 / 4.0).abs() < 1e-12);
        assert_eq!(s.levels[3].ratio, None);
        assert_eq!((s.speedup, s.rmse), (s.levels[2].ratio, Some(1.0)));
        // In 2 of 60 seconds.
        let half_way = s.levels[3].rmse_in_a_thirtieth.unwrap();
        assert!((half_way - 2f64.sqrt()).abs() < 1e-12);
        assert_eq!(s.levels[2].rmse_in_a_thirtieth, None);
    }

    #[test]
    fn bias_breaks_promises() {
        let noisy: Vec<(f64, f64)> = (0..8).map(|k| (2f64.powi(k), 4.0 * 2f64.powi(-k).sqrt())).collect();
        let biased: Vec<(f64, f64)> = (0..8).map(|k| (2f64.powi(k), (2f64.powi(-k) + 0.25).sqrt())).collect();
        let (noisy, biased) = (curve(Some(0.1), &noisy), curve(Some(1.0), &biased));
        assert!(biased.promise(10.0) < noisy.promise(10.0));
        assert!(biased.promise(1000.0) > noisy.promise(1000.0));
        assert!((noisy.promise(1000.0) - 0.016).abs() < 1e-12);
    }

    fn curve(step: Option<f64>, points: &[(f64, f64)]) -> Curve {
        let reference = Reference { image: vec![1.0], variance: 0.0, spp: 1.0 };
        let points = points.iter().map(|&(seconds, rmse)| Point { spp: 1, seconds, rmse, runs: 1 }).collect();
        Curve { step, points, ..Curve::new(Kind::Derivative, "", &reference) }
    }
}
