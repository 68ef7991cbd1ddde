//! The report: what ran, why, how well, as JSON beside the EXR.

use std::path::Path;

use serde::Serialize;

use crate::error::{Error, Result, Warning, WarningKind};
use crate::image::output;
use crate::render::health::Health;

/// Everything a reader needs to judge and repeat a run. Missing facts are null, never invented.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Report {
    pub tool: String,
    pub version: String,
    /// Versions as the native libraries themselves report them.
    pub embree: String,
    pub openvdb: String,
    pub command: Vec<String>,
    pub scene: String,
    pub scene_hash: String,
    pub parameters: Vec<Parameter>,
    pub seed: u64,
    pub spp: u64,
    /// First sample and one past the last.
    pub sample_range: [u64; 2],
    pub batches: usize,
    pub threads: usize,
    pub render_time_seconds: f64,
    pub complete: bool,
    /// With `--target-error` or `--max-time`: whether the error was reached.
    pub target_reached: Option<bool>,
    pub terms: Vec<TermReport>,
    pub plan: Vec<PlanLine>,
    pub health: Health,
    /// Samples that the health limit refers to, and the limit.
    pub health_samples: u64,
    pub health_limit: f64,
    pub health_limit_exceeded: bool,
    pub warnings: Vec<WarningReport>,
    pub peak_memory_bytes: Option<u64>,
    pub outputs: Vec<String>,
}

/// A scene parameter, and whether the run differentiates by it.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Parameter {
    pub name: String,
    pub value: f64,
    pub differentiated: bool,
}

/// One estimator: the interior or a boundary term.
#[derive(Clone, Debug, Default, Serialize)]
pub struct TermReport {
    pub name: String,
    pub samples: u64,
    pub cpu_seconds: f64,
    /// Mean over pixels and channels of the variance of the mean; null below two batches.
    pub variance: Option<f64>,
    /// Mean over pixels and channels of |d|. Variance and this one: null where terms have no layers of their own (`--split-terms`).
    pub mean_abs: Option<f64>,
}

/// A line of the plan: a term run or left out, and why.
#[derive(Clone, Debug, Default, Serialize)]
pub struct PlanLine {
    pub term: String,
    #[serde(rename = "use")]
    pub used: bool,
    pub reason: String,
}

#[derive(Clone, Debug, Serialize)]
pub struct WarningReport {
    pub kind: WarningKind,
    pub place: String,
    pub what: String,
    pub hint: String,
}

impl From<&Warning> for WarningReport {
    fn from(w: &Warning) -> Self {
        WarningReport { kind: w.kind, place: w.span.to_string(), what: w.what.clone(), hint: w.hint.clone() }
    }
}

impl Report {
    /// A report of this program, with the version of the package.
    pub fn new() -> Self {
        Report { tool: env!("CARGO_PKG_NAME").into(), version: env!("CARGO_PKG_VERSION").into(), ..Report::default() }
    }

    /// Take over the counters and the decision about them.
    pub fn set_health(&mut self, health: &Health, samples: u64, limit: f64) {
        self.health = health.clone();
        self.health_samples = samples;
        self.health_limit = limit;
        self.health_limit_exceeded = health.exceeds(samples, limit);
    }

    pub fn to_json(&self) -> Result<String> {
        serde_json::to_string_pretty(self).map_err(|e| Error::Runtime(format!("cannot write the report: {e}")))
    }

    /// Write atomically, replacing an earlier report.
    pub fn write(&self, path: &Path) -> Result<()> {
        output::write_bytes(path, (self.to_json()? + "\n").as_bytes())
    }
}

/// Largest resident memory of this process so far (`VmHWM`); `None` where the system does not tell.
pub fn peak_memory_bytes() -> Option<u64> {
    parse_peak(&std::fs::read_to_string("/proc/self/status").ok()?)
}

fn parse_peak(status: &str) -> Option<u64> {
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Span;
    use crate::render::health::Mishap;

    #[test]
    fn report_is_json_with_the_promised_keys() {
        let mut r = Report::new();
        r.set_health(&Health::new(), 10, 1e-6);
        assert!(!r.health_limit_exceeded);
        let h = Health::new();
        h.count(Mishap::RejectedNonfinite);
        r.set_health(&h, 1000, 1e-6);
        r.terms.push(TermReport { name: "interior".into(), samples: 4, mean_abs: Some(0.5), ..Default::default() });
        r.plan.push(PlanLine { term: "pixel_edge".into(), used: false, reason: "no edge moves".into() });
        let warning = Warning {
            kind: WarningKind::LightOnRay,
            span: Span { file: "s.xml".into(), line: 3, column: 5 },
            what: "a".into(),
            hint: "b".into(),
        };
        r.warnings.push((&warning).into());
        r.peak_memory_bytes = peak_memory_bytes();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("out.json");
        r.write(&path).unwrap();
        let v: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(&path).unwrap()).unwrap();
        assert_eq!(v["tool"], "tyndall");
        assert_eq!(v["health"]["rejected_nonfinite"], 1);
        assert_eq!(v["health_limit_exceeded"], true);
        assert_eq!(v["plan"][0]["use"], false);
        assert_eq!(v["warnings"][0]["kind"], "light_on_ray");
        assert_eq!(v["warnings"][0]["place"], "s.xml:3:5");
        assert!(v["terms"][0]["variance"].is_null());
        assert!(v["target_reached"].is_null());
    }

    #[test]
    fn peak_memory_is_read() {
        assert_eq!(parse_peak("Name:\tx\nVmHWM:\t    2048 kB\nVmRSS: 1 kB\n"), Some(2048 * 1024));
        assert_eq!(parse_peak("Name: x\n"), None);
        #[cfg(target_os = "linux")]
        assert!(peak_memory_bytes().unwrap() > 100_000);
    }
}
