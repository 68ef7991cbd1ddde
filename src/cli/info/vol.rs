//! Mitsuba's .vol grids.

use super::{Info, Range, numbers};
use crate::cli::format;
use serde::Serialize;
use std::path::Path;
use tyndall::error::Result;
use tyndall::medium::grid::{Allowed, vol::Vol};

#[derive(Serialize)]
pub struct VolInfo {
    file: String,
    resolution: [usize; 3],
    channels: usize,
    /// Lowest and highest corner as the file says; used with `use_grid_bbox` only.
    bbox: [[f32; 3]; 2],
    #[serde(flatten)]
    range: Range,
    usable_as_density: bool,
    /// Why not.
    reason: Option<String>,
}

impl VolInfo {
    pub fn read(path: &Path) -> Result<Self> {
        let vol = Vol::read(path)?;
        let bad = vol.validate(Allowed::NON_NEGATIVE).err();
        Ok(VolInfo {
            file: path.display().to_string(),
            resolution: vol.res,
            channels: vol.channels,
            bbox: vol.bbox,
            range: Range::of(vol.values.iter().copied()),
            usable_as_density: bad.is_none(),
            reason: bad.map(|b| format!("{b}; --repair-voxels sets such voxels to 0")),
        })
    }
}

impl Info for VolInfo {
    fn text(&self) -> String {
        let [x, y, z] = self.resolution;
        let corner = |c: [f32; 3]| numbers(&c.map(f64::from));
        let rows = vec![
            vec!["resolution".into(), format!("{x} x {y} x {z}")],
            vec!["channels".into(), self.channels.to_string()],
            vec!["bounding box".into(), format!("({}) .. ({})", corner(self.bbox[0]), corner(self.bbox[1]))],
            vec!["values".into(), self.range.text()],
            vec!["usable as density".into(), self.reason.as_ref().map_or("yes".into(), |r| format!("no: {r}"))],
        ];
        format!("{}\n{}", self.file, format::table(&rows))
    }
}
