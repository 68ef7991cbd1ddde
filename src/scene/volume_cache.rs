//! OpenVDB grids that were read already: the many members of a study or a fit share them.
//!
//! Each use of a file (what it selects, which values it allows) stays as long as the family does: a fit of voxels holds the file's own grid beside those it makes.

use super::volumes::{Loading, VdbFile, read_vdb, unplaced};
use crate::error::{Result, Warning};
use crate::math::DAffine3;
use crate::medium::grid::{Allowed, Grid};
use std::sync::{Arc, Mutex, PoisonError};

/// Grids by file; a file that changes meanwhile is not read again.
#[derive(Clone, Debug, Default)]
pub struct VolumeCache(Arc<Mutex<Vec<Kept>>>);

/// A grid as one use of it was read.
#[derive(Clone, Debug)]
struct Kept {
    file: VdbFile,
    allowed: Allowed,
    repair_voxels: bool,
    to_world: DAffine3,
    /// The file's own transform.
    world_from_index: DAffine3,
    grid: Arc<Grid>,
    /// What was told of it.
    warnings: Vec<Warning>,
}

impl VolumeCache {
    /// The grid at its place, read if it is not known: the same one at the place where it was read, a copy at any other.
    pub(super) fn vdb(&self, file: &VdbFile, how: Loading, warnings: &mut Vec<Warning>) -> Result<Arc<Grid>> {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let repair_voxels = how.options.repair_voxels;
        let is_this = |k: &&Kept| k.file == *file && k.allowed == how.allowed && k.repair_voxels == repair_voxels;
        if let Some(kept) = all.iter().find(is_this) {
            // The file may be named at several places of a scene.
            warnings.extend(kept.warnings.iter().map(|w| Warning { span: how.span.clone(), ..w.clone() }));
            if kept.to_world == how.to_world {
                return Ok(kept.grid.clone());
            }
            let moved = kept.grid.placed(how.to_world * kept.world_from_index);
            return moved.map(Arc::new).map_err(|e| unplaced(how.span, &file.path.display().to_string(), &e));
        }
        let mut told = Vec::new();
        let (grid, world_from_index) = read_vdb(file, how, &mut told)?;
        let grid = Arc::new(grid);
        warnings.extend_from_slice(&told);
        let (file, allowed, to_world) = (file.clone(), how.allowed, how.to_world);
        all.push(Kept { file, allowed, repair_voxels, to_world, world_from_index, grid: grid.clone(), warnings: told });
        Ok(grid)
    }
}
