//! Studies of the renderer by itself: stiff and extreme cases with known truth.

mod airlight;
mod grids;
mod measure;
mod policy;
mod reference;
mod slab;
pub mod stress;
mod stress_cases;
mod units;

pub use stress::{StressOptions, StressRow, Suite, Summary, Verdict, run};
