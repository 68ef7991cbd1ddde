//! The square `[-1,1]^2` in z = 0 with normal +z, placed by an affine map: any parallelogram.

use super::{Bounds, Geometry, Placement, ShapeHit, Start, SurfaceSample};
use crate::math::nearest::on_parallelogram;
use crate::math::{DAffine3, DVec2, DVec3};

#[derive(Clone, Copy, Debug)]
pub struct Rectangle {
    pub placement: Placement,
    area: f64,
}

impl Rectangle {
    pub fn new(to_world: DAffine3, flip_normals: bool) -> Result<Self, String> {
        let placement = Placement::new(to_world, flip_normals)?;
        Ok(Rectangle { placement, area: 4.0 * placement.area(DVec3::X, DVec3::Y) })
    }

    /// `t` and the local point.
    fn met(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, DVec2)> {
        if start.is_some() {
            return None;
        }
        self.placement.cross_z0(o, w, t_min, t_max).filter(|(_, p)| p.abs().max_element() <= 1.0)
    }
}

impl Geometry for Rectangle {
    fn bounds(&self) -> Bounds {
        let (x, y) = (self.placement.vector(DVec3::X).abs(), self.placement.vector(DVec3::Y).abs());
        let c = self.placement.to_world.translation;
        Bounds::new(c - (x + y), c + (x + y))
    }

    fn area(&self) -> f64 {
        self.area
    }

    fn is_closed(&self) -> bool {
        false
    }

    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit> {
        self.met(o, w, t_min, t_max, start).map(|(t, p)| ShapeHit { t, uv: 0.5 * (p + 1.0), face: 0 })
    }

    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)> {
        self.met(o, w, t_min, t_max, start).map(|(t, _)| (t, 0))
    }

    fn normal(&self, _face: u32, _p: DVec3) -> DVec3 {
        self.placement.normal(2)
    }

    fn position(&self, _face: u32, uv: DVec2) -> DVec3 {
        self.placement.point((2.0 * uv - 1.0).extend(0.0))
    }

    fn uv(&self, _face: u32, p: DVec3) -> DVec2 {
        0.5 * (self.placement.local_point(p).truncate() + 1.0)
    }

    fn face_count(&self) -> u32 {
        1
    }

    fn nearest_on_face(&self, _face: u32, p: DVec3) -> DVec3 {
        let (x, y) = (self.placement.vector(DVec3::X), self.placement.vector(DVec3::Y));
        on_parallelogram(p, self.placement.to_world.translation - (x + y), 2.0 * x, 2.0 * y)
    }

    fn sample(&self, u: f64, v: f64) -> SurfaceSample {
        let uv = DVec2::new(u, v);
        let p = self.position(0, uv);
        SurfaceSample { p, n: self.normal(0, p), uv, face: 0, pdf_area: self.area().recip() }
    }
}
