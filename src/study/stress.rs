//! The stability suite: runs the cases of `stability/stress_cases.csv` and judges each number by the rules of
//! STABILITY section 2.
//!
//! Time: CPU seconds a path over those of the benign slab with the same side and the same derivatives, alternating in one
//! run. Values are timed as pictures, derivatives in forward mode.

use super::measure::{self, Estimate, Measured, Subject};
use super::reference::{CaseInfo, Known, cases};
use super::stress_cases;
use crate::error::{Error, Result};
use rayon::ThreadPool;
use serde::{Serialize, Serializer};
use std::fmt;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Suite {
    #[default]
    Core,
    All,
}

#[derive(Clone, Debug)]
pub struct StressOptions {
    /// One case by name, of either suite.
    pub case: Option<String>,
    pub suite: Suite,
    /// 0 = one a core.
    pub threads: usize,
    /// Factor on the number of paths; below 1 nothing is timed.
    pub effort: f64,
}

impl Default for StressOptions {
    fn default() -> Self {
        StressOptions { case: None, suite: Suite::Core, threads: 0, effort: 1.0 }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Verdict {
    Ok,
    Bias,
    Noise,
    Slow,
    Nan,
    Capped,
    NotYet,
}

impl Verdict {
    pub fn name(self) -> &'static str {
        match self {
            Verdict::Ok => "ok",
            Verdict::Bias => "bias",
            Verdict::Noise => "noise",
            Verdict::Slow => "slow",
            Verdict::Nan => "nan",
            Verdict::Capped => "capped",
            Verdict::NotYet => "not-yet",
        }
    }
}

impl Serialize for Verdict {
    fn serialize<S: Serializer>(&self, s: S) -> std::result::Result<S::Ok, S::Error> {
        s.serialize_str(self.name())
    }
}

/// One number of one case. NaN (null in JSON) where there is no number.
#[derive(Clone, Debug, Serialize)]
pub struct StressRow {
    pub case: String,
    pub quantity: String,
    pub reference: f64,
    pub value: f64,
    pub stderr: f64,
    /// `(value - reference) / stderr`.
    pub z: f64,
    /// Variance of one path's contribution over the squared mean.
    pub relvar: f64,
    pub relvar_bound: Option<f64>,
    pub time_ratio: Option<f64>,
    pub time_bound: Option<f64>,
    pub rejected: u64,
    pub verdict: Verdict,
    pub note: String,
}

impl StressRow {
    pub const HEADER: &str = "case                         quantity          reference        value            stderr    z       relvar   bound    time   bound  rejected verdict";
}

impl fmt::Display for StressRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let long = |x: f64| if x.is_nan() { "-".into() } else { format!("{x:.8e}") };
        let short = |x: f64| if x.is_nan() { "-".into() } else { format!("{x:.2e}") };
        let some =
            |x: Option<f64>| x.map_or("-".into(), |x| if x < 1000.0 { format!("{x:.2}") } else { format!("{x:.0}") });
        let z = if self.z.is_nan() { "-".into() } else { format!("{:.2}", self.z) };
        write!(
            f,
            "{:<28} {:<17} {:<16} {:<16} {:<9} {z:<7} {:<8} {:<8} {:<6} {:<6} {:<8} {}",
            self.case,
            self.quantity,
            long(self.reference),
            long(self.value),
            short(self.stderr),
            short(self.relvar),
            short(self.relvar_bound.unwrap_or(f64::NAN)),
            some(self.time_ratio),
            some(self.time_bound),
            self.rejected,
            self.verdict.name(),
        )?;
        if self.note.is_empty() { Ok(()) } else { write!(f, "  ({})", self.note) }
    }
}

/// How many rows had which verdict.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Summary {
    pub rows: usize,
    pub ok: usize,
    pub not_yet: usize,
    pub failed: usize,
}

impl Summary {
    fn add(&mut self, v: Verdict) {
        self.rows += 1;
        match v {
            Verdict::Ok => self.ok += 1,
            Verdict::NotYet => self.not_yet += 1,
            _ => self.failed += 1,
        }
    }

    /// An error (exit code 3) unless every row is ok or not yet due.
    pub fn check(&self) -> Result<()> {
        if self.failed == 0 {
            return Ok(());
        }
        Err(Error::Check {
            what: format!("{} of {} stress rows are not ok", self.failed, self.rows),
            remedy: "`tyndall stress --case NAME` repeats one case".into(),
        })
    }
}

/// Run the suite, or one case. `out` sees every row as soon as it is known.
pub fn run(options: &StressOptions, out: &mut dyn FnMut(&StressRow)) -> Result<Summary> {
    let wanted: Vec<&CaseInfo> = match &options.case {
        Some(name) => cases().iter().filter(|c| c.name == *name).collect(),
        None => cases().iter().filter(|c| c.core || options.suite == Suite::All).collect(),
    };
    if let (Some(name), true) = (&options.case, wanted.is_empty()) {
        let names = cases().iter().map(|c| c.name.as_str());
        return Err(Error::usage(format!("no stress case `{name}`"), crate::scene::desc::suggest(name, names)));
    }
    let pool = measure::pool(options.threads)?;
    let mut summary = Summary::default();
    for case in wanted {
        let mut b = Bench { effort: options.effort, pool: &pool, case, out: &mut *out, summary: &mut summary };
        match stress_cases::runner(&case.name) {
            None => b.not_yet("", "no scene of this suite yet"),
            Some(runner) => {
                if let Err(e) = runner(&mut b) {
                    b.policy("run", Err(format!("could not run: {e}")));
                }
            }
        }
    }
    Ok(summary)
}

/// What a number is compared with, and what it may cost.
#[derive(Clone, Copy, Debug)]
pub struct Check {
    pub known: Known,
    /// Absolute, beside 4 standard errors.
    pub tolerance: f64,
    pub relvar: Option<f64>,
    /// Ratio and bound.
    pub time: Option<(f64, f64)>,
}

impl Check {
    /// Tolerance `relative` of the reference.
    pub fn new(known: Known, relative: f64) -> Self {
        Check { known, tolerance: relative * known.value.abs(), relvar: None, time: None }
    }
}

/// What a case works with: how much effort, where rows go.
pub struct Bench<'a> {
    pub effort: f64,
    pub pool: &'a ThreadPool,
    pub case: &'a CaseInfo,
    out: &'a mut dyn FnMut(&StressRow),
    summary: &'a mut Summary,
}

impl Bench<'_> {
    /// `full` paths, less if less effort is asked for; at least 32 batches of `floor` paths.
    pub fn paths(&self, full: usize) -> usize {
        ((full as f64 * self.effort) as usize).clamp(full.min(256), 1 << 26)
    }

    pub fn measure(&self, s: &Subject, combinations: &[Vec<f64>], full: usize) -> Result<Measured> {
        measure::measure(self.pool, s, combinations, self.paths(full))
    }

    /// The time ratio of two subjects, unless little effort is asked for.
    pub fn time(&self, a: &Subject, b: &Subject, bound: Option<f64>) -> Result<Option<(f64, f64)>> {
        match bound {
            Some(bound) if self.effort >= 1.0 => Ok(Some((measure::time_ratio(self.pool, a, b)?, bound))),
            _ => Ok(None),
        }
    }

    fn emit(&mut self, row: StressRow) {
        self.summary.add(row.verdict);
        (self.out)(&row);
    }

    fn blank(&self, quantity: &str) -> StressRow {
        StressRow {
            case: self.case.name.clone(),
            quantity: quantity.into(),
            reference: f64::NAN,
            value: f64::NAN,
            stderr: f64::NAN,
            z: f64::NAN,
            relvar: f64::NAN,
            relvar_bound: None,
            time_ratio: None,
            time_bound: None,
            rejected: 0,
            verdict: Verdict::Ok,
            note: String::new(),
        }
    }

    pub fn not_yet(&mut self, quantity: &str, note: &str) {
        let row = StressRow { verdict: Verdict::NotYet, note: note.into(), ..self.blank(quantity) };
        self.emit(row);
    }

    /// A row without statistics: what was seen, or what is wrong with it.
    pub fn policy(&mut self, quantity: &str, seen: std::result::Result<String, String>) {
        let verdict = if seen.is_ok() { Verdict::Ok } else { Verdict::Bias };
        let note = seen.unwrap_or_else(|e| e);
        let row = StressRow { verdict, note, ..self.blank(quantity) };
        self.emit(row);
    }

    /// A number without statistics, right to `tolerance`.
    pub fn exact(&mut self, quantity: &str, value: f64, reference: f64, tolerance: f64, note: &str) {
        let good = (value - reference).abs() <= tolerance;
        let verdict = if !value.is_finite() {
            Verdict::Nan
        } else if good {
            Verdict::Ok
        } else {
            Verdict::Bias
        };
        let row = StressRow { reference, value, stderr: 0.0, verdict, note: note.into(), ..self.blank(quantity) };
        self.emit(row);
    }

    /// Judge estimate `k` of a run.
    pub fn judge(&mut self, quantity: &str, m: &Measured, k: usize, check: Check) {
        let e = m.estimates[k];
        let (verdict, note) = verdict(&e, m, &check);
        let difference = e.value - check.known.value;
        let row = StressRow {
            reference: check.known.value,
            value: e.value,
            stderr: e.stderr,
            z: if difference == 0.0 {
                0.0
            } else if e.stderr > 0.0 {
                difference / e.stderr
            } else {
                f64::NAN
            },
            relvar: e.relvar,
            relvar_bound: check.relvar,
            time_ratio: check.time.map(|t| t.0),
            time_bound: check.time.map(|t| t.1),
            rejected: m.rejected,
            verdict,
            note,
            ..self.blank(quantity)
        };
        self.emit(row);
    }
}

/// STABILITY section 2, rules 1 to 6, the gravest first.
fn verdict(e: &Estimate, m: &Measured, c: &Check) -> (Verdict, String) {
    if !e.value.is_finite() || !e.stderr.is_finite() || m.rejected > 0 {
        return (Verdict::Nan, format!("{} of {} paths rejected", m.rejected, m.paths));
    }
    if m.truncated > 0 {
        return (Verdict::Capped, format!("{} of {} paths cut", m.truncated, m.paths));
    }
    if m.missed > 0 {
        return (Verdict::Bias, format!("{} missed boundaries", m.missed));
    }
    let allowed = 4.0 * e.stderr + c.known.error + c.tolerance;
    if (e.value - c.known.value).abs() > allowed {
        return (Verdict::Bias, format!("off by {:.2e}, allowed {allowed:.2e}", e.value - c.known.value));
    }
    // The relative variance is an estimate as well; but where none is allowed, any that is seen is too much.
    let seen = |bound: f64| if bound < 1e-6 { e.relvar } else { e.relvar - 3.0 * e.relvar_error };
    if let Some(bound) = c.relvar.filter(|&b| seen(b) > b) {
        return (Verdict::Noise, format!("relative variance {:.3e} > {bound:.3e}", e.relvar));
    }
    let skew = (e.median - e.value).abs();
    if skew > 6.0 * e.stderr + 1e-12 * e.value.abs() {
        return (Verdict::Noise, format!("median of batches {:.3e} away from the mean", skew));
    }
    // A difference that vanishes has no sum to compare with; the sum of absolute values stands for it.
    if e.largest > 0.2 {
        return (Verdict::Noise, format!("one path is {:.0} % of the sum", 100.0 * e.largest));
    }
    if let Some((ratio, bound)) = c.time.filter(|t| t.0 > t.1) {
        return (Verdict::Slow, format!("{ratio:.2} > {bound:.2}"));
    }
    (Verdict::Ok, String::new())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every rule fails when it should: the suite's own negative control.
    #[test]
    fn verdicts_follow_the_rules() {
        let e = Estimate { value: 1.0, stderr: 0.01, relvar: 2.0, relvar_error: 0.1, median: 1.0, largest: 0.01 };
        let m = |estimate: Estimate| Measured {
            estimates: vec![estimate],
            paths: 1000,
            rejected: 0,
            truncated: 0,
            missed: 0,
            light_on_ray: 0,
        };
        let c = |reference: f64| Check { relvar: Some(2.0), ..Check::new(Known::exact(reference), 1e-4) };
        let judge = |e: Estimate, c: Check| verdict(&e, &m(e), &c).0;
        assert_eq!(judge(e, c(1.039)), Verdict::Ok);
        assert_eq!(judge(e, c(1.041)), Verdict::Bias);
        assert_eq!(judge(Estimate { relvar: 2.4, ..e }, c(1.0)), Verdict::Noise);
        assert_eq!(judge(Estimate { median: 0.9, ..e }, c(1.0)), Verdict::Noise);
        assert_eq!(judge(Estimate { largest: 0.3, ..e }, c(1.0)), Verdict::Noise);
        assert_eq!(judge(Estimate { value: f64::NAN, ..e }, c(1.0)), Verdict::Nan);
        assert_eq!(judge(e, Check { time: Some((2.0, 1.5)), ..c(1.0) }), Verdict::Slow);
        assert_eq!(verdict(&e, &Measured { rejected: 1, ..m(e) }, &c(1.0)).0, Verdict::Nan);
        assert_eq!(verdict(&e, &Measured { truncated: 1, ..m(e) }, &c(1.0)).0, Verdict::Capped);
        assert_eq!(verdict(&e, &Measured { missed: 1, ..m(e) }, &c(1.0)).0, Verdict::Bias);
    }
}
