//! Times as people write them: `90s` in options and fit.toml, plain seconds in fit.toml too.

use serde::de::{Deserialize, Deserializer, Error, Visitor};
use std::fmt;
use std::time::Duration;

pub const FORM: &str = "write a number and its unit: 500ms, 90s, 5m or 1h";

/// `500ms`, `90s`, `5m`, `1h`: finite and greater than 0.
pub fn duration(text: &str) -> Result<Duration, String> {
    let digits = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match &text[digits.len()..] {
        "ms" => 1e-3,
        "s" => 1.0,
        "m" | "min" => 60.0,
        "h" => 3600.0,
        _ => return Err(FORM.into()),
    };
    digits.parse().ok().and_then(|x: f64| seconds(x * unit)).ok_or_else(|| FORM.into())
}

fn seconds(x: f64) -> Option<Duration> {
    Duration::try_from_secs_f64(x).ok().filter(|d| !d.is_zero())
}

/// A time of a fit.toml.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Time(pub Duration);

impl<'de> Deserialize<'de> for Time {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(Reader)
    }
}

struct Reader;

impl Visitor<'_> for Reader {
    type Value = Time;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a time such as \"90s\" or \"5m\", or a number of seconds greater than 0")
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Time, E> {
        duration(text).map(Time).map_err(|_| E::invalid_value(serde::de::Unexpected::Str(text), &self))
    }

    fn visit_f64<E: Error>(self, x: f64) -> Result<Time, E> {
        seconds(x).map(Time).ok_or_else(|| E::invalid_value(serde::de::Unexpected::Float(x), &self))
    }

    fn visit_i64<E: Error>(self, x: i64) -> Result<Time, E> {
        seconds(x as f64).map(Time).ok_or_else(|| E::invalid_value(serde::de::Unexpected::Signed(x), &self))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_have_units() {
        assert_eq!(duration("90s"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("500ms"), Ok(Duration::from_millis(500)));
        assert_eq!(duration("1h"), Ok(Duration::from_secs(3600)));
        for bad in ["", "60", "s", "-1s", "0s", "1d", "infs", "nans", "1e300h"] {
            assert!(duration(bad).is_err(), "{bad}");
        }
    }
}
