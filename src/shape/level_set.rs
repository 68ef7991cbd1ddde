//! Level sets as shapes: the surface on which an OpenVDB grid has one value, as a mesh of flat faces.
//!
//! One vertex a cell that the surface passes, two triangles where four such cells share an edge that it crosses: closed where the surface does not leave the stored
//! voxels, off by O(h²) in place, area and volume (h: the voxel's edge), by O(h) in its normals. The front is the outside of what it encloses.

use super::{Geometry, TriangleMesh};
use crate::math::DVec3;
use crate::native::vdb::{self, Select};
use std::path::Path;

/// OpenVDB's quads turn their front to smaller values of a level set, to larger ones of other grids.
const OPENVDB_FACES_IN: bool = true;

/// Without an isovalue the grid has to be a level set, and its surface is where it is 0.
pub fn load(path: &Path, select: &Select, isovalue: Option<f64>) -> Result<TriangleMesh, String> {
    let grid = vdb::open(path, select).map_err(|e| e.to_string())?;
    let info = &grid.info;
    if isovalue.is_none() && info.class != "level set" {
        return Err(format!(
            "grid `{}` is no level set (class: {}); its surface needs an `isovalue`",
            info.name, info.class
        ));
    }
    let isovalue = isovalue.unwrap_or(0.0);
    let surface = grid.surface(isovalue).map_err(|e| e.to_string())?;
    if surface.quads.is_empty() {
        return Err(format!("grid `{}` is nowhere {isovalue}: there is no surface", info.name));
    }
    let points: Vec<DVec3> = surface.points.iter().map(|p| DVec3::from(p.map(f64::from))).collect();
    let mut faces = Vec::with_capacity(2 * surface.quads.len());
    for &[a, b, c, d] in &surface.quads {
        // Along the shorter diagonal.
        let length = |i: u32, k: u32| (points[i as usize] - points[k as usize]).length_squared();
        let halves = if length(a, c) <= length(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] };
        faces.extend(halves);
    }
    // Six times the volume that it encloses.
    let middle = points.iter().fold(DVec3::ZERO, |s, &p| s + p) / points.len() as f64;
    let volume: f64 = faces
        .iter()
        .map(|f: &[u32; 3]| {
            let [a, b, c] = f.map(|k| points[k as usize] - middle);
            a.dot(b.cross(c))
        })
        .sum();
    let mesh = TriangleMesh::new(points, faces, None, None)?.rounded_to_f32();
    // Distances may be told either way round; of a sheet, which encloses nothing, OpenVDB's own rule holds.
    let flips = if mesh.is_closed() { volume < 0.0 } else { OPENVDB_FACES_IN };
    let mesh = if flips { mesh.flip_normals() } else { mesh };
    mesh.transformed(&info.world_from_index)
}
