//! tyndall: a differentiable volumetric renderer. See ARCHITECTURE.md for the floors and the data that walks through them.

pub mod error;
pub mod image;
pub mod inverse;
pub mod light;
pub mod math;
pub mod medium;
pub mod native;
pub mod params;
pub mod phase;
pub mod render;
pub mod scene;
pub mod sensor;
pub mod shape;
pub mod study;
pub mod surface;
pub mod term;
pub mod transport;
