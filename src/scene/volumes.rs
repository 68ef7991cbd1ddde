//! Volume files to brick grids: .vol and .vdb, with the check of every voxel.

use super::compile::LoadOptions;
use crate::error::{Error, Result, Span, Warning, WarningKind};
use crate::math::DAffine3;
use crate::medium::grid::{Allowed, Filter, Grid, GridBuilder, GridSource, Repaired, vol::Vol};
use crate::native::vdb::{self, Select};
use std::path::{Path, PathBuf};

/// What a scene says of an OpenVDB volume, but for its place.
#[derive(Clone, Debug, PartialEq)]
pub struct VdbFile {
    pub path: PathBuf,
    pub select: Select,
    /// A level set is read as fog.
    pub fog: bool,
}

/// How a file is loaded: where it is placed, which values its use allows, what the command line says.
#[derive(Clone, Copy)]
pub struct Loading<'a> {
    pub to_world: DAffine3,
    pub allowed: Allowed,
    /// Of the file's name in the scene.
    pub span: &'a Span,
    pub options: &'a LoadOptions,
}

impl Loading<'_> {
    /// An error for a voxel that cannot be used, which tells the way to repair it.
    fn refusal(&self, what: String) -> Error {
        let large = if self.allowed.high < f32::MAX {
            format!(", larger ones to {}", self.allowed.high)
        } else {
            String::new()
        };
        let remedy = format!(
            "correct the file, or use --repair-voxels to set NaN, infinite and negative voxels to 0{large} and count them"
        );
        Error::scene(self.span, what, remedy)
    }

    fn repaired(&self, file: &str, n: Repaired) -> Warning {
        let large = if n.large > 0 { format!(" (too large: {})", self.allowed.high) } else { String::new() };
        Warning {
            kind: WarningKind::RepairedVoxels,
            span: self.span.clone(),
            what: format!("{file}: {} voxels were repaired and are 0 now{large}: {n}", n.total()),
            hint: "correct the file to be sure of the picture".into(),
        }
    }
}

pub fn load_vol(path: &Path, smooth: bool, how: Loading, warnings: &mut Vec<Warning>) -> Result<Grid> {
    let remedy = "give a Mitsuba .vol file (version 3, float32, 1 or 3 channels)";
    let fail = |what: String| Error::scene(how.span, what, remedy);
    let mut vol = Vol::read(path).map_err(|e| fail(e.to_string()))?;
    if let Err(bad) = vol.validate(how.allowed) {
        if !how.options.repair_voxels {
            return Err(how.refusal(format!("{}: {bad}", path.display())));
        }
        let n = how.allowed.repair(&mut vol.values);
        warnings.push(how.repaired(&path.display().to_string(), n));
    }
    vol.grid(how.to_world, if smooth { Filter::Trilinear } else { Filter::Nearest }).map_err(fail)
}

/// Leaf by leaf: OpenVDB's copy is gone before bricks are made.
pub fn load_vdb(file: &VdbFile, how: Loading, warnings: &mut Vec<Warning>) -> Result<Grid> {
    read_vdb(file, how, warnings).map(|read| read.0)
}

/// The grid, and the file's own transform of it: world from index space is `how.to_world` times that.
pub(super) fn read_vdb(file: &VdbFile, how: Loading, warnings: &mut Vec<Warning>) -> Result<(Grid, DAffine3)> {
    let path = &file.path;
    let list = "`tyndall info FILE.vdb` lists what a file holds";
    let fail = |e: Error| Error::scene(how.span, e.to_string(), list);
    let grid = vdb::open(path, &file.select).map_err(fail)?;
    let (info, channels) = (grid.info.clone(), grid.channels);
    let title = format!("{}: grid `{}`", path.display(), info.name);
    let fog = level_set(file, &info, channels, &title, how.span)?;

    // The background stands for all voxels that are not stored.
    let mut background = info.background.map(|b| b as f32);
    fog.apply(&mut background);
    let mut repaired = how.allowed.repair(&mut background[..channels]);
    if repaired.total() > 0 && !how.options.repair_voxels {
        return Err(how.refusal(format!("{title}: its background is {:?}", &info.background[..channels])));
    }
    let world_from_index = how.to_world * info.world_from_index;
    let mut builder =
        GridBuilder::new(GridSource { channels, world_from_index, background, bbox: info.bbox, clip: None });
    let tiles = grid.tiles().map_err(fail)?;
    for mut t in tiles {
        fog.apply(&mut t.value);
        builder.tile(t.origin, t.size, t.value);
        builder.activate([if t.active { u64::MAX } else { 0 }; 8]);
    }
    let mut leaf = grid.room();
    for i in 0..grid.leaf_count() {
        grid.leaf(i, &mut leaf).map_err(fail)?;
        fog.apply(&mut leaf.values);
        builder.leaf(leaf.origin, &leaf.values);
        builder.activate(leaf.active);
    }
    drop(grid);

    if let Err(bad) = builder.validate(how.allowed) {
        if !how.options.repair_voxels {
            return Err(how.refusal(format!("{title}: {bad}")));
        }
        repaired += builder.repair(how.allowed);
    }
    if repaired.total() > 0 {
        warnings.push(how.repaired(&title, repaired));
    }
    let grid = builder.build().map_err(|e| unplaced(how.span, &title, &e))?;
    Ok((grid, info.world_from_index))
}

/// The error of a grid that cannot be where a scene has it.
pub(super) fn unplaced(span: &Span, title: &str, what: &str) -> Error {
    Error::scene(span, format!("{title}: {what}"), "check its transform and size")
}

/// Distances become fog as OpenVDB's `sdfToFogVolume` has it: 0 outside of the surface and on it, rising with depth to 1 at the width
/// of the narrow band (which is the background) and deeper.
#[derive(Clone, Copy)]
struct Fog {
    /// Half the width of the narrow band; `None`: values stay as they are.
    band: Option<f32>,
}

impl Fog {
    fn apply(self, values: &mut [f32]) {
        if let Some(band) = self.band {
            // NaN stays NaN.
            values.iter_mut().for_each(|v| *v = (-*v / band).clamp(0.0, 1.0));
        }
    }
}

fn level_set(file: &VdbFile, info: &vdb::GridInfo, channels: usize, title: &str, span: &Span) -> Result<Fog> {
    let fail = |what: &str, remedy: &str| Err(Error::scene(span, format!("{title} {what}"), remedy));
    if !file.fog {
        return match info.class.as_str() {
            "level set" => fail(
                "is a level set: it holds distances, not densities",
                "add <string name=\"level_set\" value=\"fog\"/> to read it as fog: 0 on the surface, 1 deeper than its narrow band",
            ),
            _ => Ok(Fog { band: None }),
        };
    }
    let band = info.background[0] as f32;
    match (info.class.as_str(), channels) {
        ("level set" | "unknown", 1) if band > 0.0 && band.is_finite() => Ok(Fog { band: Some(band) }),
        ("level set" | "unknown", 1) => fail(
            &format!("has the background {band}, which should be the width of its narrow band"),
            "write it again as a level set with a positive background",
        ),
        _ => fail("is no level set", "leave out the level_set property"),
    }
}
