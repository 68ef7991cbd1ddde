//! The derivative against finite differences of the renderer's own pictures, with error bars on both sides.
//!
//! A difference is the mean of the derivative over the interval of its step: that is what it is compared with ([`super::interval`]), without any bias. Where the scene takes values on
//! one side only (an albedo of 1), or where it is asked for, an extrapolated difference is compared with the derivative at the value itself, and what bias the step leaves is
//! estimated and counted as error.
//!
//! Rounds of both estimators, with seeds of their own, are compared over blocks (the verdict) and over pixels (counts).
//! Samples are doubled where that takes off most for what it costs (or grow by what is still needed, or by what the time allows) until the comparison is sharp enough or disagreement is certain:
//!
//! - fail: significant over blocks ([`Agreement`]), at two numbers of samples in a row or at the last (if that is as many as first rounds have where there is time);
//! - pass: not significant, and the combined standard error of blocks, step bias included, is on average at most the tolerance times
//!   mean |d| over blocks; also where both are exactly 0 (from as many samples);
//! - undecided: time or samples were over before.

use super::agreement::{Agreement, leeway, scores};
use super::differences::{At, Bias, Difference, Side};
use super::interval::{Interval, LONGER, STRATA, widest};
use super::rounds::{Blocks, Rounds, mean};
use super::sweep::{self, Rung};
use crate::error::{Error, Result};
use crate::params::ParamSet;
use crate::render::family::{Family, Member, View, numbers, stream};
use crate::render::health::Health;
use serde::Serialize;
use std::time::{Duration, Instant};

/// Rounds a stage.
const ROUNDS: u64 = 32;
/// Rounds that a first stage has at least, whatever the time: a variance needs them.
const FEWEST: u64 = 8;
/// A step whose bias is too large, and the next: the noise of differences grows faster than needed with anything smaller.
const SMALLER: f64 = 0.7;
/// Error over tolerance that samples are asked for; a little less than needed, since errors are estimates.
const AIM: f64 = 0.97;
/// What a sample of the derivative is taken to cost, in pictures: counted, so that a check is the same in every run.
const COST: f64 = 3.0;
/// Share of its samples by which a side grows at least: every look is one more chance of a false alarm.
const LEAST_SHARE: f64 = 0.125;
/// So often an interval is halved at most, because a place of it is refused.
const NARROWER: u64 = 8;
/// Without a word for longer than this nobody knows whether anything goes on.
const QUIET: Duration = Duration::from_secs(15);
/// Samples that a round has at least, over its pixels: its pilot should not be what costs.
const LEAST: usize = 2048;

#[derive(Clone, Debug)]
pub struct CheckOptions {
    pub seed: u64,
    /// Samples a pixel to begin with.
    pub spp: Option<u64>,
    /// Samples a pixel of either side, at most.
    pub max_spp: u64,
    pub max_time: Duration,
    /// Side of a block in pixels.
    pub block: usize,
    /// Comparison error that a pass may have, as a share of mean |d| over blocks.
    pub tolerance: f64,
    /// A fixed step instead of a sweep.
    pub step: Option<f64>,
    /// Where derivative and difference are compared.
    pub place: Place,
}

/// Of a comparison.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Place {
    /// Over the interval of the step, as means; at the value where that is the end of what the scene takes.
    #[default]
    Interval,
    /// At the value, by extrapolated differences.
    Value,
}

impl CheckOptions {
    /// Samples a pixel of a first round, at most.
    fn most(&self) -> u64 {
        (self.max_spp / ROUNDS).max(1)
    }
}

impl Default for CheckOptions {
    fn default() -> Self {
        CheckOptions {
            seed: 0,
            spp: None,
            max_spp: 1 << 20,
            max_time: Duration::from_secs(1800),
            block: 8,
            tolerance: 0.02,
            step: None,
            place: Place::default(),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    Pass,
    Fail,
    Undecided,
}

impl Verdict {
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Pass => "pass",
            Verdict::Fail => "fail",
            Verdict::Undecided => "undecided",
        }
    }
}

/// Images of one parameter, for the sheet: three channels a pixel.
#[derive(Clone, Debug, Default)]
pub struct Images {
    pub ours: Vec<f64>,
    pub differences: Vec<f64>,
    pub z: Vec<f64>,
}

#[derive(Clone, Debug, Serialize)]
pub struct ParameterCheck {
    pub name: String,
    pub value: f64,
    pub verdict: Verdict,
    pub side: Side,
    /// Half of the interval, where there is one.
    pub step: f64,
    /// What derivative and difference are means over; none where they are taken at the value.
    pub interval: Option<[f64; 2]>,
    /// Root mean square over blocks of the extrapolated difference's own bias, at most.
    pub step_bias: f64,
    /// Root mean square standard errors of blocks.
    pub error_ours: f64,
    pub error_differences: f64,
    pub spp_ours: f64,
    /// Of one of the `pictures` of the difference.
    pub spp_differences: f64,
    pub pictures: usize,
    pub seconds: f64,
    pub blocks: Agreement,
    pub pixels: Agreement,
    pub sweep: Vec<Rung>,
    #[serde(skip)]
    pub images: Images,
}

pub struct CheckReport {
    pub verdict: Verdict,
    pub parameters: Vec<ParameterCheck>,
    pub picture: Vec<f64>,
    pub health: Health,
    /// What the health counters refer to.
    pub samples: u64,
    pub seconds: f64,
}

/// What is checked: from member, parameters, samples a pixel and seed to the picture and one image a parameter.
pub type Estimator<'a> = dyn Fn(&Member, &ParamSet, u64, u64, &Health) -> Result<Vec<Vec<f64>>> + 'a;

/// The renderer's own derivative.
pub fn ours<'a>(view: View<'a>) -> impl Fn(&Member, &ParamSet, u64, u64, &Health) -> Result<Vec<Vec<f64>>> + 'a {
    move |member, params, spp, seed, health| {
        let o = view.derivative(&member.scene, params, spp, seed)?;
        health.merge(&o.film.health);
        Ok((0..=params.len()).map(|l| numbers(&o, l)).collect())
    }
}

/// The time that rounds have, and who hears how they go on.
struct Watch<'a> {
    until: Instant,
    /// Samples a pixel that a round has at least, however short the time.
    least: u64,
    took: &'a mut dyn FnMut(Pace),
}

/// What the first of some rounds tells.
enum Pace {
    /// How long it was, and whether it is the very first.
    Rounds(Duration, bool),
    /// It was too long: there will be shorter ones.
    Cut,
}

impl Watch<'_> {
    /// Samples a pixel of rounds all of which fit, where not even the fewest of `spp` did. `one`: how long such a round was, which is over and lost.
    fn fitting(&self, spp: u64, one: Duration) -> Option<u64> {
        let share = self.until.saturating_duration_since(Instant::now()).as_secs_f64() / one.as_secs_f64();
        let fewer = ((spp as f64 * share / ROUNDS as f64) as u64).max(self.least);
        (share < (FEWEST - 1) as f64 && fewer < spp).then_some(fewer)
    }
}

/// An estimator's rounds so far, by pixel and by block, a layer each.
struct Stock {
    pixels: Vec<Rounds>,
    blocks: Vec<Rounds>,
    next: u64,
    seconds: f64,
}

impl Stock {
    fn new(layers: usize) -> Self {
        let rounds = vec![Rounds::default(); layers];
        Stock { pixels: rounds.clone(), blocks: rounds, next: 0, seconds: 0.0 }
    }

    /// 32 more rounds, or as many as there is time for: `first` samples a pixel each, then this share of the samples so far. First rounds are at least 8, shorter ones
    /// where as many of `first` do not fit.
    fn grow(
        &mut self,
        blocks: &Blocks,
        first: u64,
        share: f64,
        mut run: impl FnMut(u64, u64) -> Result<Vec<Vec<f64>>>,
        watch: &mut Watch,
    ) -> Result<()> {
        let (begins, mut is_cut) = (self.next == 0, false);
        let mut spp = if begins { first } else { (self.spp() * share / ROUNDS as f64).round().max(1.0) as u64 };
        let least = if begins { FEWEST } else { 1 };
        let (mut start, mut done) = (Instant::now(), 0);
        while done < least || done < ROUNDS && Instant::now() < watch.until {
            let before = Instant::now();
            let images = run(spp, self.next)?;
            if done == 0 {
                let one = before.elapsed();
                let fitting = watch.fitting(spp, one).filter(|_| begins && !is_cut);
                (watch.took)(if fitting.is_some() { Pace::Cut } else { Pace::Rounds(one, begins) });
                if let Some(fewer) = fitting {
                    // What was lost says nothing of what more samples take.
                    (spp, is_cut, start) = (fewer, true, Instant::now());
                    continue;
                }
            }
            (self.next, done) = (self.next + 1, done + 1);
            for ((image, p), b) in images.iter().zip(&mut self.pixels).zip(&mut self.blocks) {
                p.push(image, spp as f64);
                b.push(&blocks.means(image), spp as f64);
            }
        }
        self.seconds += start.elapsed().as_secs_f64();
        Ok(())
    }

    fn spp(&self) -> f64 {
        self.pixels[0].samples
    }

    /// Of differences: what bias the step leaves at each place.
    fn biases(&self, rounds: impl Fn(&Stock) -> &[Rounds]) -> Vec<f64> {
        match rounds(self) {
            [own] => vec![0.0; own.mean.len()],
            [_, rest, ..] => Bias::places(rest),
            [] => Vec::new(),
        }
    }
}

/// A parameter's comparison so far.
struct Trial<'a> {
    k: usize,
    at: At<'a>,
    /// Means over an interval: the derivative's own rounds.
    over: Option<(Interval<'a>, Stock)>,
    side: Side,
    rungs: Vec<Rung>,
    difference: Difference,
    /// The difference, and its estimated bias.
    theirs: Stock,
    /// A smaller step starts anew, with other seeds.
    generation: u64,
    suspicious: bool,
    seconds: f64,
}

/// Everything that one check shares.
struct Bench<'a> {
    family: &'a Family,
    view: View<'a>,
    options: &'a CheckOptions,
    blocks: Blocks,
    member: Member,
    params: ParamSet,
    estimator: &'a Estimator<'a>,
    health: Health,
    /// Samples a pixel in a first round.
    first: u64,
}

/// Check every parameter; `say` hears how it goes on.
pub fn check(
    family: &Family,
    view: View,
    wrt: &[String],
    options: &CheckOptions,
    estimator: &Estimator,
    say: &mut dyn FnMut(String),
) -> Result<CheckReport> {
    let start = Instant::now();
    let member = family.at(&[])?;
    let params = member.scene.param_set(&member.desc, wrt)?;
    let least = LEAST.div_ceil(view.pixels()) as u64;
    let first = options.spp.map_or(least, |n| n.div_ceil(ROUNDS)).clamp(1, options.most());
    let blocks = Blocks::new(view.width(), view.height(), options.block);
    let bench = Bench { family, view, options, blocks, member, params, estimator, health: Health::new(), first };
    let mut ours = Stock::new(1 + wrt.len());
    let mut trials = Vec::new();
    let mut parameters = Vec::new();
    let left = || options.max_time.saturating_sub(start.elapsed());
    for (k, name) in wrt.iter().enumerate() {
        // Time is shared alike among the parameters that are left.
        let mut trial = bench.begin(k, name, say)?;
        parameters.push(bench.parameter(&mut trial, &mut ours, left() / (wrt.len() - k) as u32, say)?);
        trials.push(trial);
    }
    // What others did not need goes to those that are not sharp enough.
    let undecided = |p: &ParameterCheck| p.verdict == Verdict::Undecided;
    let mut rest = if wrt.len() > 1 { parameters.iter().filter(|p| undecided(p)).count() as u32 } else { 0 };
    for k in 0..wrt.len() {
        if rest > 0 && undecided(&parameters[k]) {
            parameters[k] = bench.parameter(&mut trials[k], &mut ours, left() / rest, say)?;
            rest -= 1;
        }
    }
    let own =
        std::iter::once(&ours).chain(trials.iter().filter_map(|t| Some(&t.over.as_ref()?.1))).filter(|s| s.next > 0);
    let picture = own.clone().next().map(|s| s.pixels[0].mean.clone()).unwrap_or_default();
    let own: f64 = own.map(Stock::spp).sum();
    let taken: f64 = parameters.iter().map(|p| p.spp_differences * p.pictures as f64).sum();
    let verdict = [Verdict::Fail, Verdict::Undecided].into_iter().find(|v| parameters.iter().any(|p| p.verdict == *v));
    Ok(CheckReport {
        verdict: verdict.unwrap_or(Verdict::Pass),
        parameters,
        picture,
        health: bench.health,
        samples: ((taken + own) * view.pixels() as f64) as u64,
        seconds: start.elapsed().as_secs_f64(),
    })
}

/// Tells how long the next rounds take, if that is long, and what --max-time takes off.
fn say_rounds(name: &str, pace: Pace, until: Instant, say: &mut dyn FnMut(String)) {
    match pace {
        Pace::Cut => say(format!("{name}: shorter rounds of one side, --max-time has no room for more")),
        Pace::Rounds(one, begins) => {
            let left =
                until.saturating_duration_since(Instant::now()).max(one * if begins { FEWEST as u32 - 1 } else { 0 });
            let rest = (one * (ROUNDS as u32 - 1)).min(left);
            if rest >= QUIET {
                say(format!("{name}: more rounds of one side, about {:.0} s", rest.as_secs_f64()));
            }
        }
    }
}

impl Bench<'_> {
    fn more_of_ours(&self, over: Option<Interval>, side: &mut Stock, share: f64, watch: &mut Watch) -> Result<()> {
        let seed = self.options.seed;
        let first = over.as_ref().map_or(self.first, |i| i.first);
        let run = |spp, round| match over {
            Some(interval) => interval.round(self.estimator, spp, seed, round, &self.health),
            None => (self.estimator)(&self.member, &self.params, spp, stream(seed, 1, round), &self.health),
        };
        side.grow(&self.blocks, first, share, run, watch)
    }

    fn begin<'b>(&'b self, k: usize, name: &'b str, say: &mut dyn FnMut(String)) -> Result<Trial<'b>> {
        let start = Instant::now();
        let value = self.member.desc.params[self.member.desc.wrt(name)?].value;
        let at = At { family: self.family, name, value };
        let (side, step, rungs, means) = self.step(&at, say)?;
        let difference =
            if means { Difference::plain(&at, side, step)? } else { Difference::extrapolated(&at, side, step)? };
        // Asked for by the user, or enough for a run a stratum.
        let samples = if self.options.spp.is_some() { self.first } else { self.first * STRATA * LONGER };
        let samples = samples.min(self.options.most());
        let over = means.then(|| (Interval { at, step, first: samples }, Stock::new(2)));
        let seconds = start.elapsed().as_secs_f64();
        let theirs = Stock::new(difference.functionals());
        Ok(Trial { k, at, over, side, rungs, difference, theirs, generation: 0, suspicious: false, seconds })
    }

    /// Go on with a parameter until it is decided or the time is over.
    fn parameter(
        &self,
        trial: &mut Trial,
        ours: &mut Stock,
        time: Duration,
        say: &mut dyn FnMut(String),
    ) -> Result<ParameterCheck> {
        let (start, o) = (Instant::now(), self.options);
        let deadline = start + time;
        let Trial { k, at, over, side, rungs, difference, theirs, generation, suspicious, seconds } = trial;
        let (side, name) = (*side, at.name);
        let least = (LEAST as u64 / FEWEST).div_ceil(self.view.pixels() as u64);
        // The derivative's rounds, and its layer there.
        let (mut interval, ours, layer) = match over {
            Some((interval, own)) => (Some(interval), own, 1),
            None => (None, ours, *k + 1),
        };
        // By what share of its samples either side grows.
        let [mut more_ours, mut more_theirs] = [&*ours, &*theirs].map(|s| f64::from(u8::from(s.next == 0)));
        loop {
            if more_ours > 0.0 {
                // Differences need some of the time, too.
                let left = deadline.saturating_duration_since(Instant::now());
                let until = if theirs.next == 0 { deadline - left / 2 } else { deadline };
                let watch = &mut Watch { until, least, took: &mut |pace| say_rounds(name, pace, until, say) };
                match (self.more_of_ours(interval.as_deref().copied(), ours, more_ours, watch), &mut interval) {
                    // Something is refused in the middle, where nobody had looked.
                    (Err(Error::Usage { .. }), Some(interval)) if o.step.is_none() && *generation < NARROWER => {
                        interval.step *= 0.5;
                        say(format!("{name}: an interval half as wide, some of it is refused"));
                        *difference = Difference::plain(at, side, interval.step)?;
                        (*ours, *theirs) = (Stock::new(2), Stock::new(difference.functionals()));
                        (*generation, *suspicious, more_theirs) = (*generation + 1, false, 1.0);
                        continue;
                    }
                    (done, _) => done?,
                }
            }
            if more_theirs > 0.0 {
                let took = &mut |pace| say_rounds(name, pace, deadline, say);
                let watch = &mut Watch { until: deadline, least, took };
                self.more_of_theirs(difference, theirs, *generation, more_theirs, watch)?;
            }
            // What one sample of a difference can be, by the brightest pixel.
            let event = ours.pixels[0].mean.iter().copied().fold(0.0, f64::max) / (2.0 * difference.step);
            let biases = theirs.biases(|s| &s.blocks);
            let bias = mean(biases.iter().map(|b| b.abs()));
            let (a, b, spp) = (&ours.blocks[layer], &theirs.blocks[0], theirs.spp());
            let sizes = self.blocks.sizes();
            let doubts = leeway(a, b, &biases, event, |k| spp * sizes[k]);
            let blocks = Agreement::new(a, b, &doubts, o.tolerance);
            let errors = [ours.blocks[layer].mean_error(), theirs.blocks[0].mean_error()];
            say(format!(
                "{name}: error {:.2} % of mean |d| (ours {:.2}, differences {:.2}, step bias {:.2}), max |z| {:.2}",
                100.0 * blocks.relative_error,
                100.0 * errors[0] / blocks.mean_abs,
                100.0 * errors[1] / blocks.mean_abs,
                100.0 * bias / blocks.mean_abs,
                blocks.max_z
            ));
            // Less than first rounds have where there is time: what is rare may not have been met.
            let firsts = [interval.as_deref().map_or(self.first, |i| i.first), self.first];
            let is_short = [&*ours, &*theirs].iter().zip(firsts).any(|(s, first)| s.spp() < (ROUNDS * first) as f64);
            let sharp = blocks.relative_error <= o.tolerance && !(is_short && blocks.relative_error == 0.0);
            let certain = blocks.significant && *suspicious;
            // An unexpected difference wants a second look at twice the samples.
            let goal = if blocks.significant { 0.0 } else { AIM * o.tolerance * blocks.mean_abs / blocks.error };
            let costs = [COST * ours.spp(), difference.pictures() as f64 * spp];
            let next = self.next(errors, costs, goal, [&*ours, &*theirs], deadline);
            let verdict = match (certain, sharp && !blocks.significant, next) {
                (true, ..) => Some(Verdict::Fail),
                (_, true, _) => Some(Verdict::Pass),
                (_, _, None) if blocks.significant && !is_short => Some(Verdict::Fail),
                (_, _, None) => Some(Verdict::Undecided),
                _ => None,
            };
            if let Some(verdict) = verdict {
                let (a, b) = (&ours.pixels[layer], &theirs.pixels[0]);
                let doubts = leeway(a, b, &theirs.biases(|s| &s.pixels), event, |_| spp);
                *seconds += start.elapsed().as_secs_f64();
                return Ok(ParameterCheck {
                    name: name.into(),
                    value: at.value,
                    verdict,
                    side,
                    step: difference.step,
                    interval: interval.as_ref().map(|i| i.ends()),
                    step_bias: bias,
                    error_ours: errors[0],
                    error_differences: errors[1],
                    spp_ours: ours.spp(),
                    spp_differences: theirs.spp(),
                    pictures: difference.pictures(),
                    seconds: *seconds,
                    blocks,
                    pixels: Agreement::new(a, b, &doubts, o.tolerance),
                    sweep: rungs.clone(),
                    images: Images { ours: a.mean.clone(), differences: b.mean.clone(), z: scores(a, b, &doubts) },
                });
            }
            *suspicious = blocks.significant;
            // A bias that no sample takes off: a smaller step.
            let biased = bias > 0.7 * o.tolerance * blocks.mean_abs && bias > errors[0].hypot(errors[1]);
            if biased && o.step.is_none() {
                *difference = Difference::extrapolated(at, side, SMALLER * difference.step)?;
                *theirs = Stock::new(difference.functionals());
                *generation += 1;
                [more_ours, more_theirs] = [0.0, 1.0];
                continue;
            }
            [more_ours, more_theirs] = next.unwrap_or_default();
        }
    }

    /// Side and step of the difference, how the step was found, and whether means over its interval are compared.
    fn step(&self, at: &At, say: &mut dyn FnMut(String)) -> Result<(Side, f64, Vec<Rung>, bool)> {
        let o = self.options;
        let means = o.place == Place::Interval;
        if let Some(h) = o.step {
            for side in [Side::Central, Side::Forward, Side::Backward] {
                if at.fits(side, h)? {
                    let around = Interval { at: *at, step: h, first: self.first };
                    let means = means && side == Side::Central && around.fits(&self.view)?;
                    return Ok((side, h, Vec::new(), means));
                }
            }
            let what = format!("--step {h}: the scene refuses `{}` = {} +- {h}", at.name, at.value);
            return Err(Error::usage(what, "give a smaller step, or --step auto"));
        }
        say(format!("{}: looking for a step", at.name));
        let wide = if means { widest(at, &self.view, &self.blocks, self.first, o.seed, &self.health)? } else { None };
        if let Some((step, rungs)) = wide {
            say(format!("{}: step {step:.3e} out of {}", at.name, rungs.len()));
            return Ok((Side::Central, step, rungs, true));
        }
        let s = sweep::sweep(at, &self.view, &self.blocks, self.first, o.seed, o.tolerance, &self.health)?;
        say(format!("{}: step {:.3e} out of {}", at.name, s.step, s.rungs.len()));
        Ok((s.side, s.step, s.rungs, false))
    }

    fn more_of_theirs(
        &self,
        d: &Difference,
        side: &mut Stock,
        generation: u64,
        share: f64,
        watch: &mut Watch,
    ) -> Result<()> {
        let run = |spp, round| {
            let seed = stream(self.options.seed, 2, round + (generation << 16));
            d.round(&self.view, spp, seed, &self.health)
        };
        side.grow(&self.blocks, self.first, share, run, watch)
    }

    /// By what share of its samples each side is to grow: the one whose next sample takes off more variance for what it costs, both where they are alike,
    /// to twice as many, or to what brings the error to `goal` of what it is; `None` where time or samples do not suffice.
    fn next(
        &self,
        errors: [f64; 2],
        costs: [f64; 2],
        goal: f64,
        sides: [&Stock; 2],
        deadline: Instant,
    ) -> Option<[f64; 2]> {
        // A variance v that took the cost c falls by v/c with the next unit.
        let [a, b] = [0, 1].map(|i| errors[i] * errors[i] / costs[i]);
        let room = sides.map(|s| self.options.max_spp as f64 / s.spp() - 1.0 >= LEAST_SHARE);
        // A second look is at both.
        let worth = |x: f64, other: usize, y: f64| goal == 0.0 || x >= 0.5 * y || !room[other];
        let grow = [room[0] && worth(a, 1, b), room[1] && worth(b, 0, a)].map(|g| f64::from(u8::from(g)));
        let (mut noise, mut rest, mut seconds, mut most) = (0.0, 0.0, 0.0, 1.0f64);
        for ((grows, error), side) in grow.iter().zip(errors).zip(sides) {
            if *grows > 0.0 {
                most = most.min(self.options.max_spp as f64 / side.spp() - 1.0);
                seconds += side.seconds;
                noise += error * error;
            } else {
                rest += error * error;
            }
        }
        // What grows by the share s has 1 / (1 + s) of its variance.
        let left = goal * goal * (noise + rest) - rest;
        let wanted = if left > 0.0 { (noise / left - 1.0).max(LEAST_SHARE) } else { 1.0 };
        most = most.min(deadline.saturating_duration_since(Instant::now()).as_secs_f64() / seconds);
        (seconds > 0.0 && most >= LEAST_SHARE).then(|| grow.map(|g| g * wanted.min(most)))
    }
}
