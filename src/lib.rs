pub mod error;
pub mod math;
pub mod render;
