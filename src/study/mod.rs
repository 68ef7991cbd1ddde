//! Studies of the renderer by itself: stiff and extreme cases with known truth, derivatives against finite differences.

pub mod agreement;
mod airlight;
pub mod check;
mod closed;
pub mod converge;
pub mod differences;
mod grids;
pub mod interval;
mod measure;
mod policy;
pub mod reference;
pub mod rounds;
pub mod slab;
pub mod stress;
mod stress_cases;
pub mod sweep;
mod units;

pub use stress::{StressOptions, StressRow, Suite, Summary, Verdict, run};
