//! OpenEXR files: channels, attributes, ranges.

use super::{Info, Range};
use crate::cli::format;
use serde::Serialize;
use std::path::Path;
use tyndall::error::Result;
use tyndall::image::exr::{self, Attribute};

#[derive(Serialize)]
pub struct ExrInfo {
    file: String,
    width: usize,
    height: usize,
    /// Of the data in the full picture.
    origin: [i32; 2],
    full_size: [usize; 2],
    channels: Vec<Channel>,
    attributes: serde_json::Map<String, serde_json::Value>,
}

#[derive(Serialize)]
struct Channel {
    name: String,
    #[serde(flatten)]
    range: Range,
}

impl ExrInfo {
    pub fn read(path: &Path) -> Result<Self> {
        let image = exr::read(path)?;
        let value = |a: &Attribute| match a {
            Attribute::Text(t) => serde_json::json!(t),
            Attribute::Real(x) => serde_json::json!(x),
            Attribute::Integer(i) => serde_json::json!(i),
        };
        let channel =
            |(name, data): &(String, Vec<f32>)| Channel { name: name.clone(), range: Range::of(data.iter().copied()) };
        Ok(ExrInfo {
            file: path.display().to_string(),
            width: image.width,
            height: image.height,
            origin: image.origin,
            full_size: image.full_size,
            channels: image.channels.iter().map(channel).collect(),
            attributes: image.attributes.iter().map(|(n, a)| (n.clone(), value(a))).collect(),
        })
    }
}

impl Info for ExrInfo {
    fn text(&self) -> String {
        let mut text = format!("{}: {} x {} pixels", self.file, self.width, self.height);
        if self.full_size != [self.width, self.height] {
            let ([x, y], [w, h]) = (self.origin, self.full_size);
            text += &format!(" at ({x}, {y}) of {w} x {h}");
        }
        let rows: Vec<Vec<String>> =
            self.channels.iter().map(|c| vec![format!("  {}", c.name), c.range.text()]).collect();
        text += &format!("\n{}\n{}", format::plural(rows.len(), "channel"), format::table(&rows));
        if !self.attributes.is_empty() {
            let rows: Vec<Vec<String>> =
                self.attributes.iter().map(|(n, v)| vec![format!("  {n}"), v.to_string()]).collect();
            text += &format!("\nattributes\n{}", format::table(&rows));
        }
        text
    }
}
