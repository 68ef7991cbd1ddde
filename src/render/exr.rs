//! EXR files: stub.
use crate::error::{Error, Result};
use crate::render::image_io::RgbImage;
use std::path::Path;

#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    Text(String),
    Real(f64),
    Integer(i64),
}

#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExrImage {
    pub width: usize,
    pub height: usize,
    /// Position of the data in the full picture (crop), and the full picture's size.
    pub origin: [i32; 2],
    pub full_size: [usize; 2],
    pub channels: Vec<(String, Vec<f32>)>,
    pub attributes: Vec<(String, Attribute)>,
}

pub fn write(_path: &Path, _image: &ExrImage) -> Result<()> {
    Err(Error::Runtime("not yet".into()))
}
pub fn read(_path: &Path) -> Result<ExrImage> {
    Err(Error::Runtime("not yet".into()))
}
pub fn read_rgb(_path: &Path) -> Result<RgbImage> {
    Err(Error::Runtime("not yet".into()))
}
