//! `fit.toml`: everything a fit needs beside its scene. Names are relative to the file.

use super::loss::Loss;
use crate::error::{Error, Result, Span};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;
use toml::Spanned;

/// The file as it stands; what is absent is left to options and defaults.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Scene file.
    pub scene: Option<String>,
    pub wrt: Option<Vec<String>>,
    pub target: Option<Target>,
    /// Name = [min, max].
    #[serde(default)]
    pub bounds: BTreeMap<String, Spanned<[f64; 2]>>,
    /// One table of values a start.
    #[serde(default)]
    pub start: Vec<BTreeMap<String, Spanned<f64>>>,
    pub seeds: Option<Vec<u64>>,
    /// Name = first step as a share of the bounds' extent.
    #[serde(default)]
    pub rate: BTreeMap<String, Spanned<f64>>,
    pub half_life: Option<f64>,
    pub iterations: Option<usize>,
    pub spp: Option<u64>,
    pub loss: Option<Loss>,
    pub sensor: Option<String>,
    pub terms: Option<Vec<String>>,
    /// Seconds a run.
    pub max_time: Option<f64>,
    #[serde(default)]
    pub stop: Stop,
    /// Other parameters of the scene, as `-D` sets them.
    #[serde(default)]
    pub define: BTreeMap<String, f64>,
}

/// A picture, or the values from which it is rendered first.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum Target {
    File(String),
    Values(Rendered),
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rendered {
    pub values: BTreeMap<String, f64>,
    pub spp: Option<u64>,
    pub seed: Option<u64>,
}

/// The stop rule (`adam::StopRule`).
#[derive(Clone, Copy, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    pub window: Option<usize>,
    pub tolerance: Option<f64>,
}

impl Settings {
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| {
            Error::usage(format!("cannot read {}: {e}", path.display()), "give a scene.xml or a fit.toml")
        })?;
        Self::parse(&text, path)
    }

    /// Errors carry line and column.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let settings: Settings = toml::from_str(text).map_err(|e| {
            let span = span_at(text, path, e.span().map_or(0, |s| s.start));
            let remedy = "keys: scene wrt target bounds start seeds rate half_life iterations spp loss sensor terms max_time stop define";
            Error::scene(&span, e.message().to_string(), remedy)
        })?;
        settings.check(text, path)?;
        Ok(settings)
    }

    fn check(&self, text: &str, path: &Path) -> Result<()> {
        let fail = |at: usize, what: String, remedy: &str| Err(Error::scene(&span_at(text, path, at), what, remedy));
        for (name, bounds) in &self.bounds {
            let [min, max] = *bounds.get_ref();
            if !(min < max && min.is_finite() && max.is_finite()) {
                let remedy = "write name = [min, max] with min < max";
                return fail(bounds.span().start, format!("bounds of `{name}`: {min} is not below {max}"), remedy);
            }
        }
        for (name, rate) in &self.rate {
            if !(*rate.get_ref() > 0.0 && *rate.get_ref() <= 1.0) {
                let remedy = "a first step is a share of the bounds' extent: between 0 and 1";
                return fail(rate.span().start, format!("rate of `{name}`: {}", rate.get_ref()), remedy);
            }
        }
        if let Some(wrt) = &self.wrt {
            let named = self.bounds.iter().map(|(n, s)| ("bounds", n, s.span().start));
            let named = named.chain(self.rate.iter().map(|(n, s)| ("rate", n, s.span().start)));
            let starts = self.start.iter().flatten().map(|(n, s)| ("start", n, s.span().start));
            for (table, name, at) in named.chain(starts) {
                if !wrt.contains(name) {
                    let remedy = crate::scene::desc::suggest(name, wrt.iter().map(String::as_str));
                    return fail(at, format!("[{table}]: `{name}` is not among `wrt`"), &remedy);
                }
            }
        }
        Ok(())
    }
}

/// Line and column of a byte.
fn span_at(text: &str, path: &Path, byte: usize) -> Span {
    let end = (0..=byte.min(text.len())).rev().find(|&i| text.is_char_boundary(i)).unwrap_or(0);
    let before = &text[..end];
    let line = before.matches('\n').count() as u32 + 1;
    let column = before.rsplit('\n').next().map_or(0, |l| l.chars().count()) as u32 + 1;
    Span { file: path.into(), line, column }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Settings> {
        Settings::parse(text, Path::new("a/fit.toml"))
    }

    #[test]
    fn a_whole_file_is_read() {
        let s = parse(
            "scene = \"s.xml\"\nwrt = [\"a\"]\nseeds = [1, 2]\nloss = \"relative-l2\"\n[target]\nvalues = { a = 0.5 }\nspp = 64\n\
             [bounds]\na = [0, 1]\n[[start]]\na = 0.1\n[[start]]\na = 0.9\n[stop]\ntolerance = 0.01\n",
        )
        .unwrap();
        assert_eq!(s.start.len(), 2);
        assert_eq!(s.bounds["a"].get_ref(), &[0.0, 1.0]);
        assert!(matches!(s.target, Some(Target::Values(Rendered { spp: Some(64), .. }))));
        assert_eq!((s.loss, s.stop.tolerance), (Some(Loss::RelativeL2), Some(0.01)));
    }

    #[test]
    fn errors_name_their_line() {
        for (text, place, part) in [
            ("scene = 1", "a/fit.toml:1:9", "expected a string"),
            ("wrt = [\"a\"]\nlos = \"l2\"", "a/fit.toml:2:1", "unknown field `los`"),
            ("[bounds]\na = [1, 0]", "a/fit.toml:2:5", "not below"),
            ("wrt = [\"a\"]\n[bounds]\nb = [0, 1]", "a/fit.toml:3:5", "`b` is not among `wrt`"),
            ("wrt = [\"a\"]\n[rate]\na = 2.0", "a/fit.toml:3:5", "rate of `a`"),
            ("scene = ", "a/fit.toml:1:", ""),
        ] {
            let e = parse(text).unwrap_err().to_string();
            assert!(e.starts_with(place) && e.contains(part) && e.contains("help: "), "{e}");
        }
    }
}
