//! Flat smooth faces by which lights without extent are connected to ([`crate::transport::pane`]).

use super::Scene;
use super::beams::is_flat;
use crate::math::{DVec2, DVec3};
use crate::shape::Geometry;

/// Sine between normals that count as parallel.
pub const PARALLEL: f64 = 1e-9;

/// A face of a rectangle, disk or cube of glass or metal.
#[derive(Clone, Copy, Debug)]
pub struct Pane {
    pub shape: u32,
    pub face: u32,
    /// On the face, and its unit normal on the front side.
    pub p: DVec3,
    pub n: DVec3,
}

impl Scene {
    /// List them where there is any light to connect to; call when shapes, surfaces and lights are known.
    pub fn prepare_panes(&mut self) {
        let smooth = |s: &super::Instance| self.surfaces[s.surface as usize].is_smooth() && is_flat(&s.shape);
        let lit = self.lights.iter().any(|l| l.is_delta());
        let mut panes = Vec::new();
        for (id, s) in self.shapes.iter().enumerate().filter(|(_, s)| lit && smooth(s)) {
            for face in 0..s.shape.face_count() {
                let p = s.shape.position(face, DVec2::new(0.5, 0.5));
                panes.push(Pane { shape: id as u32, face, p, n: s.shape.normal(face, p) });
            }
        }
        self.panes = panes;
    }

    /// Whether all that is smooth is flat faces by themselves: rectangles and disks.
    pub fn has_only_panes(&self) -> bool {
        let mut smooth = self.shapes.iter().filter(|s| self.surfaces[s.surface as usize].is_smooth());
        !self.panes.is_empty() && smooth.all(|s| is_flat(&s.shape) && s.shape.face_count() == 1)
    }

    /// Whether these are parallel to one another, too.
    pub fn has_parallel_panes(&self) -> bool {
        let parallel = |p: &Pane| self.panes[0].n.cross(p.n).length() <= PARALLEL;
        self.has_only_panes() && self.panes.iter().all(parallel)
    }
}
