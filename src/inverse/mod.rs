//! Inverse rendering: the parameters of a scene from a picture of it.

pub mod adam;
pub mod album;
pub mod duration;
pub mod fit;
pub mod halves;
pub mod history;
pub mod lattice;
pub mod loss;
pub mod rates;
pub mod reverse;
pub mod settings;
pub mod state;
pub mod subset;
pub mod turntable;
pub mod variation;
pub mod views;

pub use fit::{Problem, Recovered, Step, fit};
pub use loss::Loss;
pub use settings::Settings;
