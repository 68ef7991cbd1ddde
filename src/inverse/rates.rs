//! First steps of a fit, as shares of the bounds' extents: one for all parameters, or one a parameter.

use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserialize, Deserializer, MapAccess, Visitor};
use std::collections::BTreeMap;
use std::fmt;
use toml::Spanned;

#[derive(Clone, Debug)]
pub enum Rates {
    All(f64),
    Each(BTreeMap<String, Spanned<f64>>),
}

impl Rates {
    pub fn of(&self, name: &str) -> Option<f64> {
        match self {
            Rates::All(rate) => Some(*rate),
            Rates::Each(rates) => rates.get(name).map(|r| *r.get_ref()),
        }
    }

    /// Those of single parameters.
    pub fn each(&self) -> impl Iterator<Item = (&String, &Spanned<f64>)> {
        let rates = match self {
            Rates::All(_) => None,
            Rates::Each(rates) => Some(rates),
        };
        rates.into_iter().flatten()
    }
}

// By hand: a derived untagged enum loses the places of errors and what was expected.
impl<'de> Deserialize<'de> for Rates {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = Rates;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("a number or a table")
            }

            fn visit_f64<E>(self, rate: f64) -> Result<Rates, E> {
                Ok(Rates::All(rate))
            }

            fn visit_i64<E>(self, rate: i64) -> Result<Rates, E> {
                Ok(Rates::All(rate as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<Rates, A::Error> {
                BTreeMap::deserialize(MapAccessDeserializer::new(map)).map(Rates::Each)
            }
        }
        d.deserialize_any(Either)
    }
}
