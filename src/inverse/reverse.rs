//! A fit in reverse mode: fields of voxels and scalars, from one view or several.
//!
//! Minimises `1/V Σ_v loss(I_v, T_v) + τ Σ_fields TV` over the box of the bounds. Gradient by [T] 1.5 and 8.3: the adjoint image of each view comes from a picture of its own, the gradient
//! pass draws from another stream; so for quadratic losses it is unbiased whatever the samples. An iteration may look at a few views (`subset`), which leaves the mean as it is.
//! Fields begin on a coarse lattice (`lattice`) that is refined at given iterations. While no scalar is searched for, nothing is compiled but bricks: voxels are set in place.
//!
//! Converged: at the finest lattice, every scalar by the rule of `adam::StopRule`, every field as a whole by that of `halves`, and the loss fell no further over the window.

use super::adam::{Adam, Seen, StopRule};
use super::fit::Unknown;
use super::halves::Halves;
use super::lattice::Lattice;
use super::loss::Loss;
use super::variation::total_variation;
use super::{state, subset};
use crate::error::{Error, Result};
use crate::math::Rgb;
use crate::params::ParamSet;
use crate::render::family::{Family, Member, View, stream};
use crate::render::health::Health;
use crate::scene::voxels::Voxels;
use std::ops::Range;
use std::time::{Duration, Instant};

/// What all runs of a fit share.
pub struct Problem<'a> {
    pub family: &'a Family,
    /// Each with what it should see, row by row over its crop.
    pub views: &'a [(View<'a>, Vec<Rgb>)],
    /// Views of an iteration.
    pub subset: usize,
    pub scalars: &'a [Unknown],
    /// Arrays of voxels; bounds and start in the grid's own values.
    pub fields: &'a [Unknown],
    pub loss: Loss,
    /// Samples a pixel, view and iteration: of the picture, and again of the gradient.
    pub spp: u64,
    pub iterations: usize,
    pub max_time: Duration,
    /// Iterations in which the step size falls to a half.
    pub half_life: f64,
    pub rule: StopRule,
    /// Iterations at which the lattice's spacing halves, rising; it begins at 2 to the power of their number.
    pub refine: &'a [usize],
    /// Factor of the total variation, in units of the loss.
    pub total_variation: f64,
    /// What else makes a run what it is, for its state's fingerprint.
    pub identity: String,
}

/// One iteration.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    pub seconds: f64,
    /// Mean over the views looked at, and its standard error.
    pub loss: f64,
    pub error: f64,
    /// Of all fields, before its factor.
    pub variation: f64,
    pub spacing: i32,
    pub scalars: Vec<f64>,
    /// In shares of extents: of the scalars, then the norm of each field's.
    pub gradient: Vec<f64>,
    pub rates: Vec<f64>,
}

/// Where a run stands: with the problem all that its next iteration depends on.
pub struct State {
    pub adam: Adam,
    pub halves: Halves,
    pub history: Vec<Step>,
    pub converged: bool,
}

/// The end of one run.
pub struct Recovered {
    pub scalars: Vec<f64>,
    /// With the values found, in the order of the problem's.
    pub fields: Vec<Voxels>,
    pub converged: bool,
    pub reason: &'static str,
    /// Of the whole run, earlier parts included.
    pub seconds: f64,
    /// Mean over the last window.
    pub loss: f64,
    pub state: State,
}

/// A field and its parameters' place among all.
struct Part {
    voxels: Voxels,
    positions: Vec<[i32; 3]>,
    tiles: Vec<bool>,
    lattice: Lattice,
    next: Vec<[u32; 3]>,
    range: Range<usize>,
}

/// Scene, parameters and lattices of a run.
struct Run<'a> {
    p: &'a Problem<'a>,
    seed: u64,
    names: Vec<String>,
    member: Member,
    params: ParamSet,
    parts: Vec<Part>,
    level: usize,
}

/// Run one fit. `start`: scalars, then a constant for each field or `None` for its file's values. `saved`: go on from there. `tell` hears every iteration, and whatever
/// it returns as `true` for ends the run's turn with its state handed to `keep`.
pub fn fit(
    p: &Problem,
    start: &[Option<f64>],
    seed: u64,
    saved: Option<&[u8]>,
    health: &Health,
    tell: &mut dyn FnMut(usize, &Step) -> bool,
    keep: &mut dyn FnMut(Vec<u8>) -> Result<()>,
) -> Result<Recovered> {
    let began = Instant::now();
    let mut run = Run::new(p, start, seed)?;
    let fingerprint = state::fingerprint(&format!("{} {start:?} {seed} {:?}", p.identity, run.sizes()));
    let mut s = run.begin(start)?;
    if let Some(bytes) = saved {
        let iteration = state::iterations(bytes, fingerprint)?;
        run.set_level(p.refine.iter().filter(|&&r| r < iteration).count());
        s = State { adam: run.adam(vec![0.0; run.count()]), halves: Halves::new(p.rule.window, run.count()), ..s };
        state::read(bytes, p.scalars.len(), p.fields.len(), &mut s)?;
    }
    let before = s.history.last().map_or(0.0, |h| h.seconds);
    let elapsed = || before + began.elapsed().as_secs_f64();
    // The state as it was before a refinement that no step has followed yet: what is read again has the lattice of its last step.
    let mut unrefined = None;
    let mut reason = if s.converged { "converged" } else { "the iterations are over" };
    while s.history.len() < p.iterations && !s.converged {
        let iteration = s.history.len();
        if p.refine.contains(&iteration) {
            unrefined = Some(state::write(&s, fingerprint)?);
            run.refine(&mut s);
        }
        let (mut step, gradient) = match run.evaluate(&s.adam.u, iteration, health) {
            Err(Error::Interrupted) => {
                reason = "stopped by a signal";
                break;
            }
            g => g?,
        };
        if !step.loss.is_finite() || gradient.iter().any(|g| !g.is_finite()) {
            let what = format!("iteration {iteration}: the loss or its gradient is not a number");
            return Err(Error::Runtime(format!("{what}; raise spp to 2 or more")));
        }
        let rates = s.adam.rates();
        step.rates = run.firsts().map(|k| rates[k]).collect();
        step.seconds = elapsed();
        s.adam.step(&gradient);
        let full = s.halves.push(&s.adam.u);
        s.history.push(step);
        unrefined = None;
        s.converged = full && run.converged(&s);
        if s.converged {
            reason = "converged";
        }
        if tell(iteration, &s.history[iteration]) {
            keep(state::write(&s, fingerprint)?)?;
        }
        if began.elapsed() >= p.max_time && !s.converged {
            reason = "the time is over";
            break;
        }
    }
    keep(match unrefined {
        Some(bytes) => bytes,
        None => state::write(&s, fingerprint)?,
    })?;
    let mean = if s.halves.counts == [0; 2] { s.adam.u.clone() } else { s.halves.mean() };
    run.place(&mean)?;
    let last = &s.history[s.history.len().saturating_sub(p.rule.window)..];
    Ok(Recovered {
        scalars: run.scalars(&mean),
        fields: run.parts.into_iter().map(|part| part.voxels).collect(),
        converged: s.converged,
        reason,
        seconds: elapsed(),
        loss: last.iter().map(|h| h.loss).sum::<f64>() / last.len().max(1) as f64,
        state: s,
    })
}

impl<'a> Run<'a> {
    fn new(p: &'a Problem<'a>, start: &[Option<f64>], seed: u64) -> Result<Self> {
        let names: Vec<String> = p.scalars.iter().chain(p.fields).map(|u| u.name.clone()).collect();
        let values: Vec<(&str, f64)> =
            p.scalars.iter().zip(start).filter_map(|(u, x)| Some((u.name.as_str(), (*x)?))).collect();
        let (member, params) = member(p, &names, &values)?;
        let mut run = Run { p, seed, names, member, params, parts: Vec::new(), level: 0 };
        for f in p.fields {
            let voxels = run.member.scene.voxels(&run.member.desc, &f.name)?;
            let voxels = voxels.ok_or_else(|| Error::Runtime(format!("`{}` is no array of voxels", f.name)))?;
            let (positions, tiles) = run.member.scene.active_positions(&voxels).into_iter().unzip();
            let lattice = Lattice::new(&[], 1);
            run.parts.push(Part { voxels, positions, tiles, lattice, next: Vec::new(), range: 0..0 });
        }
        run.set_level(0);
        Ok(run)
    }

    fn sizes(&self) -> Vec<usize> {
        self.parts.iter().map(|q| q.positions.len()).collect()
    }

    /// Make the lattices of a level: as many refinements are behind.
    fn set_level(&mut self, level: usize) {
        self.level = level;
        let spacing = 1 << (self.p.refine.len() - level);
        let mut first = self.p.scalars.len();
        for q in &mut self.parts {
            q.lattice = Lattice::new(&q.positions, spacing);
            q.next = if self.p.total_variation > 0.0 {
                q.lattice.neighbours(&q.positions, |n| q.tiles[n])
            } else {
                Vec::new()
            };
            q.range = first..first + q.lattice.len() * q.voxels.field.channels();
            first = q.range.end;
        }
    }

    /// Number of parameters.
    fn count(&self) -> usize {
        self.parts.last().map_or(self.p.scalars.len(), |q| q.range.end)
    }

    /// The first parameter of every unknown.
    fn firsts(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.p.scalars.len()).chain(self.parts.iter().map(|q| q.range.start))
    }

    /// First step sizes. Those of fields halve with every refinement: a node then gathers the gradients of an eighth of the voxels, and what steps are made of
    /// is noise to a larger share.
    fn rates(&self) -> Vec<f64> {
        let mut v: Vec<f64> = self.p.scalars.iter().map(|u| u.rate).collect();
        for (q, f) in self.parts.iter().zip(self.p.fields) {
            v.resize(v.len() + q.range.len(), f.rate * 0.5f64.powi(self.level as i32));
        }
        v
    }

    fn adam(&self, u: Vec<f64>) -> Adam {
        Adam::new(u, self.rates(), self.p.half_life, &self.p.rule).for_fields()
    }

    fn begin(&self, start: &[Option<f64>]) -> Result<State> {
        let mut u: Vec<f64> = Vec::with_capacity(self.count());
        for (x, s) in start.iter().zip(self.p.scalars) {
            u.push((x.unwrap_or(f64::NAN) - s.min) / s.extent());
        }
        for (f, (q, x)) in self.p.fields.iter().zip(self.parts.iter().zip(&start[self.p.scalars.len()..])) {
            let share = |v: f64| (v - f.min) / f.extent();
            match x {
                Some(x) => u.resize(q.range.end, share(*x)),
                None => {
                    let own: Vec<f64> = q.voxels.field.active().map(share).collect();
                    if let Some(i) = own.iter().position(|u| !(-1e-6..=1.0 + 1e-6).contains(u)) {
                        let v = f.min + own[i] * f.extent();
                        let what =
                            format!("start: a voxel of `{}` is {v}, outside its bounds {} to {}", f.name, f.min, f.max);
                        return Err(Error::usage(
                            what,
                            "give wider bounds, or a constant start = [{ \"ID.sigma_t.grid\" = 1.0 }]",
                        ));
                    }
                    let own: Vec<f64> = own.into_iter().map(|u| u.clamp(0.0, 1.0)).collect();
                    u.extend(q.lattice.means(&q.positions, q.voxels.field.channels(), &own, 0.5));
                }
            }
        }
        let halves = Halves::new(self.p.rule.window, u.len());
        Ok(State { adam: self.adam(u), halves, history: Vec::new(), converged: false })
    }

    /// The next finer lattice; the fields stay as they are.
    fn refine(&mut self, s: &mut State) {
        let before: Vec<(Lattice, Range<usize>)> =
            self.parts.iter().map(|q| (q.lattice.clone(), q.range.clone())).collect();
        self.set_level(self.level + 1);
        let mut u = s.adam.u[..self.p.scalars.len()].to_vec();
        for (q, (coarse, range)) in self.parts.iter().zip(before) {
            let channels = q.voxels.field.channels();
            u.extend(coarse.refined(&q.positions, channels, &s.adam.u[range], &q.lattice));
        }
        s.halves = Halves::new(self.p.rule.window, u.len());
        s.adam.replace(u, self.rates());
    }

    fn scalars(&self, u: &[f64]) -> Vec<f64> {
        self.p.scalars.iter().zip(u).map(|(s, u)| s.min + u * s.extent()).collect()
    }

    /// The scene at some parameters.
    fn place(&mut self, u: &[f64]) -> Result<()> {
        if !self.p.scalars.is_empty() {
            let values = self.scalars(u);
            let named: Vec<(&str, f64)> = self.p.scalars.iter().map(|s| s.name.as_str()).zip(values).collect();
            (self.member, self.params) = member(self.p, &self.names, &named)?;
        }
        for (q, f) in self.parts.iter_mut().zip(self.p.fields) {
            let mut x = q.lattice.spread(&q.positions, q.voxels.field.channels(), &u[q.range.clone()]);
            x.iter_mut().for_each(|x| *x = f.min + *x * f.extent());
            q.voxels.field.set(&x);
            self.member.scene.set_voxels(&q.voxels)?;
        }
        Ok(())
    }

    /// Loss at some parameters, and its derivative by them, all in shares of extents.
    fn evaluate(&mut self, u: &[f64], iteration: usize, health: &Health) -> Result<(Step, Vec<f64>)> {
        self.place(u)?;
        let (p, scene) = (self.p, &self.member.scene);
        let chosen = subset::views(p.views.len(), p.subset, stream(self.seed, 10, 0), iteration);
        let (mut loss, mut variance, mut slots) = (0.0, 0.0, vec![0.0; scene.slots.count]);
        let share = 1.0 / chosen.len() as f64;
        for (turn, &v) in chosen.iter().enumerate() {
            let (view, target) = &p.views[v];
            // A view that comes twice in one iteration has samples of its own each time.
            let round = (iteration * chosen.len() + turn) as u64;
            let a = view.picture(scene, p.spp, stream(self.seed, 1, round))?;
            let mut e = p.loss.evaluate(&a.film, target)?;
            e.adjoint.iter_mut().for_each(|x| *x *= share);
            let b = view.gradient(scene, &self.params, &e.adjoint, p.spp, stream(self.seed, 2, round))?;
            health.merge(&a.film.health);
            health.merge(&b.film.health);
            (loss, variance) = (loss + share * e.value, variance + (share * e.error).powi(2));
            let g = b.gradient.map_or_else(Vec::new, |g| g.0);
            slots.iter_mut().zip(g).for_each(|(s, g)| *s += g);
        }
        let pulled = self.params.pull_back(&slots[..scene.slots.scalars]);
        let mut gradient: Vec<f64> = pulled.iter().zip(p.scalars).map(|(g, s)| g * s.extent()).collect();
        let (mut sizes, mut variation) = (gradient.clone(), 0.0);
        for ((q, f), array) in self.parts.iter().zip(p.fields).zip(&self.params.arrays) {
            let channels = q.voxels.field.channels();
            let own: Vec<f64> = slots[array.range()].iter().map(|g| g * f.extent()).collect();
            let mut own = q.lattice.collect(&q.positions, channels, &own);
            if p.total_variation > 0.0 {
                let (value, g) = total_variation(&q.next, q.lattice.spacing(), channels, &u[q.range.clone()]);
                own.iter_mut().zip(g).for_each(|(a, b)| *a += p.total_variation * b);
                variation += value;
            }
            sizes.push(own.iter().map(|g| g * g).sum::<f64>().sqrt());
            gradient.extend(own);
        }
        let spacing = self.parts.first().map_or(1, |q| q.lattice.spacing());
        let scalars = self.scalars(u);
        let (error, seconds, rates) = (variance.sqrt(), 0.0, Vec::new());
        Ok((Step { seconds, loss, error, variation, spacing, scalars, gradient: sizes, rates }, gradient))
    }

    fn converged(&self, s: &State) -> bool {
        let (rule, scalars) = (&self.p.rule, self.p.scalars);
        let since = self.p.refine.last().copied().unwrap_or(0);
        if self.level < self.p.refine.len() || s.history.len() < since + rule.window {
            return false;
        }
        let last = &s.history[s.history.len() - rule.window..];
        let seen = |h: &Step| Seen {
            u: h.scalars.iter().zip(scalars).map(|(x, s)| (x - s.min) / s.extent()).collect(),
            gradient: h.gradient[..scalars.len()].to_vec(),
            rate: h.rates[..scalars.len()].to_vec(),
            loss: h.loss + self.p.total_variation * h.variation,
        };
        let settled = |(k, q): (usize, &Part)| {
            let k = scalars.len() + k;
            let reach: f64 = last.iter().map(|h| h.rates[k]).sum();
            let blind = last.iter().all(|h| h.gradient[k] == 0.0);
            s.halves.moved(q.range.clone()) <= rule.tolerance && reach >= 2.0 * rule.tolerance && !blind
        };
        self.parts.iter().enumerate().all(settled) && rule.converged(&last.iter().map(seen).collect::<Vec<_>>())
    }
}

fn member(p: &Problem, names: &[String], values: &[(&str, f64)]) -> Result<(Member, ParamSet)> {
    let mut member = p.family.at(values)?;
    member.scene.open(&member.desc, names)?;
    let params = member.scene.param_set(&member.desc, names)?;
    Ok((member, params))
}
