//! Images as inputs: stub.
use crate::error::{Error, Result};
use std::path::Path;

/// A linear RGB image, rows from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RgbImage {
    pub width: usize,
    pub height: usize,
    pub pixels: Vec<[f32; 3]>,
}

pub fn load_environment(_path: &Path) -> Result<RgbImage> {
    Err(Error::Runtime("not yet".into()))
}
