//! The surface on which a grid has a given value, meshed by OpenVDB, every cell that it passes by one point.

use super::vdb::{Loaded, call, damage};
use crate::error::Result;
use openvdb_sys as sys;

/// Points in index space, and flat or bent quadrilaterals of four of them, all with the same side in front.
#[derive(Clone, Debug)]
pub struct Surface {
    pub points: Vec<[f32; 3]>,
    pub quads: Vec<[u32; 4]>,
}

struct Handle(*mut sys::tvdb_mesh);

impl Drop for Handle {
    fn drop(&mut self) {
        // SAFETY: our own handle, freed once; null is allowed.
        unsafe { sys::tvdb_mesh_free(self.0) };
    }
}

impl Loaded {
    /// Where the grid is `isovalue`; grids of floats and doubles only.
    pub fn surface(&self, isovalue: f64) -> Result<Surface> {
        let mut mesh = Handle(std::ptr::null_mut());
        let (mut points, mut quads) = (0, 0);
        // SAFETY: an open handle; room for one handle and two numbers. The handle goes into `mesh`, which frees it.
        call(&self.path, &self.info.name, |e, n| unsafe {
            sys::tvdb_mesh_new(self.handle, isovalue, &mut mesh.0, &mut points, &mut quads, e, n)
        })?;
        let mut surface = Surface { points: vec![[0.0; 3]; points], quads: vec![[0; 4]; quads] };
        // SAFETY: room for as many numbers as were told.
        unsafe {
            sys::tvdb_mesh_read(mesh.0, surface.points.as_mut_ptr().cast(), surface.quads.as_mut_ptr().cast());
        }
        if surface.quads.iter().flatten().any(|&k| k as usize >= points) {
            return Err(damage(&self.path, &self.info.name, "its surface names points that are not there"));
        }
        Ok(surface)
    }
}
