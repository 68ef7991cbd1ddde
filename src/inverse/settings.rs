//! `fit.toml`: everything a fit needs beside its scene. Names are relative to the file.

use super::duration::Time;
use super::loss::Loss;
use super::rates::Rates;
use crate::error::{Error, Result, Span};
use crate::scene::desc::suggest;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use toml::Spanned;

/// Every key, and how it is written.
const KEYS: [(&str, &str); 22] = [
    ("scene", "scene = \"scene.xml\", relative to this file"),
    ("wrt", "wrt = [\"a\", \"smoke.sigma_t.grid\"]: names of parameters, and of arrays of voxels"),
    (
        "target",
        "target = \"photo.exr\", or target = { values = { a = 1.1 }, spp = 1024, seed = 9 } with spp of 1 or more",
    ),
    ("bounds", "bounds = { a = [min, max] } with min < max"),
    ("start", "start = [{ a = 0.4 }, { a = 1.8 }]: one table of finite values a start"),
    ("seeds", "seeds = [1, 2]: one whole number or more, not negative"),
    ("rate", "rate = 0.03, or rate = { a = 0.03 }: a first step is a share of the bounds' extent, between 0 and 1"),
    ("half_life", "half_life = 40: a number of iterations greater than 0"),
    ("iterations", "iterations = 300: a whole number, 1 or more"),
    ("spp", "spp = 16: a whole number of samples, 2 or more"),
    ("loss", "loss = \"l2\", \"l1\" or \"relative-l2\""),
    ("sensor", "sensor = \"0\": number or id of a sensor, in quotes"),
    ("terms", "terms = [\"all\"], or names of terms: `tyndall plan` shows them"),
    ("max_time", "max_time = \"90s\" or \"5m\", or a number of seconds greater than 0"),
    ("stop", "stop = { window = 30, tolerance = 0.005 }: a whole number, 4 or more, and a share greater than 0"),
    ("sensors", "sensors = [\"0\", \"north\"]: one number or id of a sensor or more, in quotes, each once"),
    ("targets", "targets = { north = \"north.exr\", east = \"east.exr\" }: a picture for each sensor"),
    ("views", "views = 4: how many of the sensors an iteration looks at, 1 or more"),
    ("refine", "refine = [30, 60, 100]: rising numbers of iterations of 1 or more, at most 8 of them"),
    ("total_variation", "total_variation = 0.001: a finite number that is not negative"),
    (
        "turntable",
        "turntable = { parameter = \"turn\", sensor = \"0\", range = [0, 360], frames = 36, spp = 64 } with 1 or more frames and spp",
    ),
    ("define", "define = { name = 1.5 }: numbers, as -D sets them"),
];

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
    pub seeds: Option<Spanned<Vec<u64>>>,
    pub rate: Option<Spanned<Rates>>,
    pub half_life: Option<Spanned<f64>>,
    pub iterations: Option<Spanned<usize>>,
    pub spp: Option<Spanned<u64>>,
    pub loss: Option<Loss>,
    pub sensor: Option<String>,
    /// Sensors that are fitted together.
    pub sensors: Option<Spanned<Vec<String>>>,
    /// Sensor = picture.
    #[serde(default)]
    pub targets: BTreeMap<String, String>,
    pub views: Option<Spanned<usize>>,
    pub refine: Option<Spanned<Vec<usize>>>,
    pub total_variation: Option<Spanned<f64>>,
    pub turntable: Option<Spanned<Turntable>>,
    pub terms: Option<Vec<String>>,
    /// Of a run.
    pub max_time: Option<Time>,
    #[serde(default)]
    pub stop: Stop,
    /// Other parameters of the scene, as `-D` sets them.
    #[serde(default)]
    pub define: BTreeMap<String, f64>,
    /// Where the bounds stand, for errors that only the scene brings.
    #[serde(skip)]
    pub places: BTreeMap<String, Span>,
}

/// A picture, or the values from which it is rendered first.
#[derive(Clone, Debug)]
pub enum Target {
    File(String),
    Values(Rendered),
}

// By hand: a derived untagged enum loses the places of errors and what was expected.
impl<'de> Deserialize<'de> for Target {
    fn deserialize<D: Deserializer<'de>>(d: D) -> std::result::Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Target;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a file name or a table")
            }

            fn visit_str<E>(self, name: &str) -> std::result::Result<Target, E> {
                Ok(Target::File(name.into()))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> std::result::Result<Target, A::Error> {
                Rendered::deserialize(MapAccessDeserializer::new(map)).map(Target::Values)
            }
        }
        d.deserialize_any(Either)
    }
}

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rendered {
    pub values: BTreeMap<String, f64>,
    pub spp: Option<Spanned<u64>>,
    pub seed: Option<u64>,
}

/// What `turntable::Way` asks for.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Turntable {
    pub parameter: String,
    pub sensor: Option<String>,
    /// From, and to (not reached).
    pub range: [f64; 2],
    pub frames: Option<usize>,
    pub spp: Option<u64>,
}

/// The stop rule (`adam::StopRule`).
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Stop {
    pub window: Option<Spanned<usize>>,
    pub tolerance: Option<Spanned<f64>>,
}

/// A value without its place.
pub fn bare<T: Copy>(x: &Option<Spanned<T>>) -> Option<T> {
    x.as_ref().map(|x| *x.get_ref())
}

impl Settings {
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| {
            Error::usage(format!("cannot read {}: {e}", path.display()), "give a scene.xml or a fit.toml")
        })?;
        Self::parse(&text, path)
    }

    /// Errors carry line and column, the key, and how it is written.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let mut settings: Settings = toml::from_str(text).map_err(|e| {
            let at = e.span().map_or(0, |s| s.start);
            refuse(text, path, at, &plain(e.message()))
        })?;
        settings.check(text, path)?;
        let places = settings.bounds.iter().map(|(n, b)| (n.clone(), span_at(text, path, b.span().start)));
        settings.places = places.collect();
        Ok(settings)
    }

    fn check(&self, text: &str, path: &Path) -> Result<()> {
        let need = |good: bool, at: usize, what: String| {
            if good { Ok(()) } else { Err(refuse(text, path, at, &what)) }
        };
        for (name, bounds) in &self.bounds {
            let [min, max] = *bounds.get_ref();
            let good = min < max && min.is_finite() && max.is_finite();
            need(good, bounds.span().start, format!("bounds of `{name}`: {min} is not below {max}"))?;
        }
        for (name, rate) in self.rate.iter().flat_map(|r| r.get_ref().each()) {
            let x = *rate.get_ref();
            need(x > 0.0 && x <= 1.0, rate.span().start, format!("rate of `{name}`: {x}"))?;
        }
        if let Some((at, Rates::All(x))) = self.rate.as_ref().map(|r| (r.span().start, r.get_ref())) {
            need(*x > 0.0 && *x <= 1.0, at, format!("rate: {x}"))?;
        }
        for (name, x) in self.start.iter().flatten() {
            need(x.get_ref().is_finite(), x.span().start, format!("start of `{name}`: {} is not finite", x.get_ref()))?;
        }
        if let Some(seeds) = &self.seeds {
            need(!seeds.get_ref().is_empty(), seeds.span().start, "the list is empty".into())?;
        }
        if let Some(list) = &self.sensors {
            let l = list.get_ref();
            let twice = l.iter().enumerate().any(|(i, n)| l[..i].contains(n));
            need(!l.is_empty() && !twice, list.span().start, "the list is empty, or names one twice".into())?;
        }
        if let Some(list) = &self.refine {
            let l = list.get_ref();
            let rising = l.windows(2).all(|w| w[0] < w[1]) && l.first().is_none_or(|&r| r > 0) && l.len() <= 8;
            need(rising, list.span().start, format!("{l:?} does not rise from 1, or is too long"))?;
        }
        if let Some(x) = &self.total_variation {
            let good = x.get_ref().is_finite() && *x.get_ref() >= 0.0;
            need(good, x.span().start, format!("{} is out of range", x.get_ref()))?;
        }
        if let Some(t) = &self.turntable {
            let good = t.get_ref().range.iter().all(|x| x.is_finite());
            let good = good && t.get_ref().frames != Some(0) && t.get_ref().spp != Some(0);
            need(good, t.span().start, "a number is out of range".into())?;
        }
        let target_spp = if let Some(Target::Values(r)) = &self.target { &r.spp } else { &None };
        // Value, place, and the least that is allowed; 0: anything greater than 0.
        fn of<T: Copy>(x: &Option<Spanned<T>>, number: fn(T) -> f64, least: f64) -> Option<(f64, usize, f64)> {
            x.as_ref().map(|x| (number(*x.get_ref()), x.span().start, least))
        }
        let numbers = [
            of(&self.half_life, |x| x, 0.0),
            of(&self.iterations, |x| x as f64, 1.0),
            of(&self.spp, |x| x as f64, 2.0),
            of(target_spp, |x| x as f64, 1.0),
            of(&self.views, |x| x as f64, 1.0),
            of(&self.stop.window, |x| x as f64, 4.0),
            of(&self.stop.tolerance, |x| x, 0.0),
        ];
        for (x, at, least) in numbers.into_iter().flatten() {
            need(x > 0.0 && x >= least && x <= MOST, at, format!("{x} is out of range"))?;
        }
        if let Some(wrt) = &self.wrt {
            let named = self.bounds.iter().map(|(n, s)| ("bounds", n, s.span().start));
            let rates = self.rate.iter().flat_map(|r| r.get_ref().each());
            let named = named.chain(rates.map(|(n, s)| ("rate", n, s.span().start)));
            let starts = self.start.iter().flatten().map(|(n, s)| ("start", n, s.span().start));
            for (table, name, at) in named.chain(starts) {
                if !wrt.contains(name) {
                    let remedy = suggest(name, wrt.iter().map(String::as_str));
                    let what = format!("[{table}]: `{name}` is not among `wrt`");
                    return Err(Error::scene(&span_at(text, path, at), what, remedy));
                }
            }
        }
        Ok(())
    }
}

/// The largest number of anything, as the options have it.
const MOST: f64 = (1u64 << 40) as f64;

/// An error at a byte, with the key that it belongs to and how that is written.
fn refuse(text: &str, path: &Path, at: usize, what: &str) -> Error {
    let span = span_at(text, path, at);
    // The last key that begins at or before the place; none where the file cannot be read at all.
    let keys: BTreeMap<Spanned<String>, toml::Value> = toml::from_str(text).unwrap_or_default();
    let key = keys.keys().filter(|k| k.span().start <= at).max_by_key(|k| k.span().start);
    match KEYS.iter().find(|(name, _)| key.is_some_and(|k| k.get_ref() == name)) {
        Some((name, form)) => Error::scene(&span, format!("`{name}`: {what}"), format!("write {form}")),
        None => {
            let list: Vec<&str> = KEYS.iter().map(|k| k.0).collect();
            Error::scene(&span, what, format!("keys: {}", list.join(" ")))
        }
    }
}

/// Names of types as people say them.
fn plain(message: &str) -> String {
    let types = [
        ("expected f64", "expected a number"),
        ("expected u64", "expected a whole number that is not negative"),
        ("expected usize", "expected a whole number that is not negative"),
        ("expected a sequence", "expected a list"),
        ("expected a map", "expected a table"),
        ("expected struct Stop", "expected a table"),
        ("expected struct Turntable", "expected a table"),
        ("an array of length 2", "two numbers [min, max]"),
        ("expected a string", "expected a string in quotes"),
    ];
    types.iter().fold(message.to_string(), |m, (from, to)| m.replace(from, to))
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
        let Some(Target::Values(t)) = &s.target else { panic!("{:?}", s.target) };
        assert_eq!((bare(&t.spp), t.values["a"]), (Some(64), 0.5));
        assert_eq!((s.loss, bare(&s.stop.tolerance)), (Some(Loss::RelativeL2), Some(0.01)));
        assert_eq!((s.places["a"].line, s.places["a"].column), (9, 5));
    }

    #[test]
    fn times_have_units_or_are_seconds() {
        for (text, seconds) in [("20", 20.0), ("1.5", 1.5), ("\"20s\"", 20.0), ("\"5m\"", 300.0)] {
            let s = parse(&format!("max_time = {text}")).unwrap();
            assert_eq!(s.max_time.map(|t| t.0.as_secs_f64()), Some(seconds), "{text}");
        }
    }

    #[test]
    fn values_are_checked() {
        for (line, column, part) in [
            ("max_time = -3", 12, "expected a time"),
            ("max_time = nan", 12, "expected a time"),
            ("max_time = 0", 12, "expected a time"),
            ("max_time = \"3\"", 12, "expected a time"),
            ("max_time = [1]", 12, "expected a time"),
            ("half_life = -1", 13, "-1 is out of range"),
            ("half_life = nan", 13, "NaN is out of range"),
            ("half_life = \"x\"", 13, "expected a number"),
            ("iterations = 0", 14, "0 is out of range"),
            ("iterations = -4", 14, "expected a whole number"),
            ("stop = { window = 0 }", 19, "0 is out of range"),
            ("stop = { tolerance = -1 }", 22, "-1 is out of range"),
            ("stop = 3", 8, "expected a table"),
            ("spp = 1", 7, "1 is out of range"),
            ("spp = 2.5", 7, "expected a whole number"),
            ("seeds = []", 9, "empty"),
            ("seeds = 3", 9, "expected a list"),
            ("target = 3", 10, "expected a file name or a table"),
            ("target = { values = { a = 1 }, spp = 0 }", 38, "0 is out of range"),
            ("bounds = { a = 3 }", 16, "two numbers"),
            ("start = [{ a = inf }]", 16, "not finite"),
            ("loss = \"l3\"", 8, "l3"),
            ("views = 0", 9, "0 is out of range"),
            ("refine = [3, 3]", 10, "does not rise"),
            ("refine = [0]", 10, "does not rise"),
            ("sensors = []", 11, "empty"),
            ("sensors = [\"a\", \"a\"]", 11, "twice"),
            ("total_variation = -1", 19, "-1 is out of range"),
            ("turntable = 3", 13, "expected a table"),
            ("turntable = { parameter = \"t\", range = [0, 1], frames = 0 }", 13, "out of range"),
        ] {
            let e = parse(&format!("scene = \"s.xml\"\n{line}")).unwrap_err().to_string();
            let key = line.split(' ').next().unwrap();
            let right = e.starts_with(&format!("a/fit.toml:2:{column}: `{key}`: ")) && e.contains(part);
            assert!(right && e.contains(&format!("help: write {key} = ")), "{line}: {e}");
        }
    }

    #[test]
    fn errors_name_their_line() {
        for (text, place, part) in [
            ("scene = 1", "a/fit.toml:1:9", "`scene`: invalid type: integer `1`, expected a string"),
            ("wrt = [\"a\"]\nlos = \"l2\"", "a/fit.toml:2:1", "unknown field `los`"),
            ("[bounds]\na = [1, 0]", "a/fit.toml:2:5", "not below"),
            ("wrt = [\"a\"]\n[bounds]\nb = [0, 1]", "a/fit.toml:3:5", "`b` is not among `wrt`"),
            ("wrt = [\"a\"]\n[rate]\na = 2.0", "a/fit.toml:3:5", "rate of `a`"),
            ("wrt = [\"a\"]\nrate = 2.0", "a/fit.toml:2:8", "rate: 2"),
            ("wrt = [\"a\"]\nrate = \"fast\"", "a/fit.toml:2:8", "rate = 0.03"),
            ("scene = ", "a/fit.toml:1:", ""),
        ] {
            let e = parse(text).unwrap_err().to_string();
            assert!(e.starts_with(place) && e.contains(part) && e.contains("help: "), "{e}");
        }
    }
}
