//! What went wrong, counted: nothing is dropped, clamped or zeroed without leaving a number here.

use std::sync::atomic::{AtomicU64, Ordering};

use serde::ser::{Serialize, SerializeMap, Serializer};

use crate::error::{Error, Result};

/// Declares the kinds, their report names and whether they bias the numbers (and so count towards the limit).
macro_rules! kinds {
    ($($(#[$doc:meta])* $kind:ident = $name:literal, biases: $biases:literal;)*) => {
        /// A kind of mishap.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
        #[repr(usize)]
        pub enum Mishap { $($(#[$doc])* $kind),* }

        impl Mishap {
            pub const ALL: &[Mishap] = &[$(Mishap::$kind),*];
            pub const COUNT: usize = Self::ALL.len();

            /// The key in the report.
            pub fn name(self) -> &'static str {
                match self { $(Mishap::$kind => $name),* }
            }

            /// Whether the result is no longer an unbiased estimate of what was asked for.
            pub fn biases(self) -> bool {
                match self { $(Mishap::$kind => $biases),* }
            }
        }
    };
}

kinds! {
    /// A sample that was NaN or infinite; left out.
    RejectedNonfinite = "rejected_nonfinite", biases: true;
    /// A sample too large for the film's fixed point; left out.
    Overflow = "overflow", biases: true;
    /// A sum or a sum of squares that left the film's range: the mean or the variance of that pixel is wrong.
    SumOverflow = "sum_overflow", biases: true;
    /// A path that reached the scene's own `max_depth`: part of what was asked for.
    CappedPaths = "capped_paths", biases: false;
    /// A path that the renderer cut for its own safety with throughput left.
    TruncatedEnergy = "truncated_energy", biases: true;
    /// A medium boundary that the ray kernel missed: the path was in another medium than it believed.
    MissedBoundaries = "missed_boundaries", biases: true;
    /// A root search (shadow edge, specular chain) that did not settle.
    UnsettledRoots = "unsettled_roots", biases: true;
    /// A derivative asked of a medium without extinction and without end: part of it is missing.
    UnboundedVacuum = "unbounded_vacuum", biases: true;
    /// A value that is not 0 but below the film's resolution, some 1e-17 of the brightest: it became 0.
    BelowQuantum = "below_quantum", biases: false;
    /// A zero-measure light on a camera ray: the picture diverges there.
    LightOnRay = "light_on_ray", biases: false;
}

/// Default limit: the share of samples that may be biased (stability rule 11).
pub const DEFAULT_LIMIT: f64 = 1e-6;

/// One counter a kind; counts from any thread. Sums commute, so the numbers do not depend on the order.
#[derive(Debug, Default)]
pub struct Health {
    counts: [AtomicU64; Mishap::COUNT],
}

impl Health {
    pub fn new() -> Self {
        Health::default()
    }

    pub fn count(&self, kind: Mishap) {
        self.add(kind, 1);
    }

    pub fn add(&self, kind: Mishap, n: u64) {
        if n > 0 {
            self.counts[kind as usize].fetch_add(n, Ordering::Relaxed);
        }
    }

    pub fn get(&self, kind: Mishap) -> u64 {
        self.counts[kind as usize].load(Ordering::Relaxed)
    }

    pub fn merge(&self, other: &Health) {
        for &kind in Mishap::ALL {
            self.add(kind, other.get(kind));
        }
    }

    /// Name and count of every kind, in a fixed order.
    pub fn entries(&self) -> impl Iterator<Item = (&'static str, u64)> + '_ {
        Mishap::ALL.iter().map(|&kind| (kind.name(), self.get(kind)))
    }

    /// Mishaps that bias the numbers.
    pub fn biasing(&self) -> u64 {
        Mishap::ALL.iter().filter(|kind| kind.biases()).map(|&kind| self.get(kind)).sum()
    }

    /// Whether more than `limit` of `samples` are biased. One mishap with no sample at all exceeds any limit.
    pub fn exceeds(&self, samples: u64, limit: f64) -> bool {
        self.biasing() as f64 > limit * samples as f64
    }

    /// The decision at the end of a run: an error with exit code 3 past the limit.
    pub fn check(&self, samples: u64, limit: f64) -> Result<()> {
        if !self.exceeds(samples, limit) {
            return Ok(());
        }
        let counts: Vec<String> = Mishap::ALL
            .iter()
            .filter(|&&kind| kind.biases() && self.get(kind) > 0)
            .map(|&kind| format!("{} {}", self.get(kind), kind.name()))
            .collect();
        Err(Error::Check {
            what: format!("the health limit was passed: {} in {samples} samples (limit {limit:e})", counts.join(", ")),
            remedy: "the numbers are biased; look at the report's `health` and at the warnings for the cause".into(),
        })
    }
}

impl Clone for Health {
    fn clone(&self) -> Self {
        let copy = Health::new();
        copy.merge(self);
        copy
    }
}

impl Serialize for Health {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(Mishap::COUNT))?;
        for (name, n) in self.entries() {
            map.serialize_entry(name, &n)?;
        }
        map.end()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::ExitCode;

    #[test]
    fn limit_counts_only_what_biases() {
        let h = Health::new();
        h.add(Mishap::CappedPaths, 1000);
        h.count(Mishap::LightOnRay);
        assert!(h.check(10, DEFAULT_LIMIT).is_ok());
        h.add(Mishap::RejectedNonfinite, 2);
        assert!(h.check(2_000_000, DEFAULT_LIMIT).is_ok());
        let e = h.check(1_999_999, DEFAULT_LIMIT).unwrap_err();
        assert_eq!(e.exit_code(), ExitCode::Check);
        assert!(e.to_string().contains("2 rejected_nonfinite"), "{e}");
        assert!(h.exceeds(0, 0.5));
    }

    #[test]
    fn counts_merge_and_serialise_in_order() {
        let (a, b) = (Health::new(), Health::new());
        a.count(Mishap::Overflow);
        b.add(Mishap::Overflow, 4);
        a.merge(&b);
        assert_eq!(a.clone().get(Mishap::Overflow), 5);
        let json = serde_json::to_string(&a).unwrap();
        assert!(json.starts_with(r#"{"rejected_nonfinite":0,"overflow":5,"#), "{json}");
    }
}
