//! Volume files to brick grids: .vol and .vdb, with the check of every voxel.

use super::compile::LoadOptions;
use crate::error::{Error, Result, Span, Warning, WarningKind};
use crate::math::DAffine3;
use crate::medium::grid::{Filter, Grid, GridBuilder, GridSource, vol::Vol};
use crate::native::vdb;
use std::path::Path;

const VOXEL_REMEDY: &str = "correct the file, or pass --repair-voxels to set such voxels to 0 and count them";

pub fn load_vol(
    path: &Path,
    to_world: DAffine3,
    smooth: bool,
    span: &Span,
    options: &LoadOptions,
    warnings: &mut Vec<Warning>,
) -> Result<Grid> {
    let fail =
        |what: String| Error::scene(span, what, "give a Mitsuba .vol file (version 3, float32, 1 or 3 channels)");
    let mut vol = Vol::read(path).map_err(|e| fail(e.to_string()))?;
    if let Err(bad) = vol.validate(true) {
        if !options.repair_voxels {
            return Err(Error::scene(span, format!("{}: {bad}", path.display()), VOXEL_REMEDY));
        }
        let n = repair(&mut vol.values);
        warnings.push(repaired(span, path, n));
    }
    vol.grid(to_world, if smooth { Filter::Trilinear } else { Filter::Nearest }).map_err(fail)
}

pub fn load_vdb(
    path: &Path,
    name: &str,
    to_world: DAffine3,
    span: &Span,
    options: &LoadOptions,
    warnings: &mut Vec<Warning>,
) -> Result<Grid> {
    let select = vdb::Select::Name(name.to_owned());
    let mut grid = vdb::load(path, &select)
        .map_err(|e| Error::scene(span, e.to_string(), "`tyndall info FILE.vdb` lists what a file holds"))?;
    let info = &grid.info;
    let source = GridSource {
        channels: grid.channels,
        world_from_index: to_world * info.world_from_index,
        background: info.background.map(|b| b as f32),
        bbox: info.bbox,
        clip: None,
    };
    let build = |grid: &vdb::VdbGrid| {
        let mut b = GridBuilder::new(source.clone());
        for t in &grid.tiles {
            b.tile(t.origin, t.size, t.value);
            b.activate([if t.active { u64::MAX } else { 0 }; 8]);
        }
        for l in &grid.leaves {
            b.leaf(l.origin, &l.values);
            b.activate(l.active);
        }
        b
    };
    let mut builder = build(&grid);
    if let Err(bad) = builder.validate(true) {
        if !options.repair_voxels {
            let what = format!("{}: grid `{name}`: {bad}", path.display());
            return Err(Error::scene(span, what, VOXEL_REMEDY));
        }
        let mut n: usize = grid.leaves.iter_mut().map(|l| repair(&mut l.values)).sum();
        n += grid.tiles.iter_mut().map(|t| repair(&mut t.value)).sum::<usize>();
        warnings.push(repaired(span, path, n));
        builder = build(&grid);
    }
    builder.build().map_err(|e| Error::scene(span, format!("grid `{name}`: {e}"), "check its transform and size"))
}

fn repair(values: &mut [f32]) -> usize {
    let bad = |v: &f32| !(v.is_finite() && *v >= 0.0);
    let n = values.iter().filter(|v| bad(v)).count();
    values.iter_mut().filter(|v| bad(v)).for_each(|v| *v = 0.0);
    n
}

fn repaired(span: &Span, path: &Path, n: usize) -> Warning {
    Warning {
        kind: WarningKind::RepairedVoxels,
        span: span.clone(),
        what: format!("{}: {n} voxels were NaN, infinite or negative and are 0 now", path.display()),
        hint: "correct the file to be sure of the picture".into(),
    }
}
