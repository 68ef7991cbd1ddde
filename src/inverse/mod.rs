//! Inverse rendering: the parameters of a scene from a picture of it.

pub mod adam;
pub mod album;
pub mod duration;
pub mod fit;
pub mod history;
pub mod loss;
pub mod settings;

pub use fit::{Problem, Recovered, Step, fit};
pub use loss::Loss;
pub use settings::Settings;
