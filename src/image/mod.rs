//! Images in files: EXR with named channels, environment maps, and writing that leaves no half file. Imports nothing above.

pub mod environment;
pub mod exr;
pub mod output;

pub use environment::RgbImage;
