//! Sensors: film coordinates to camera rays. Film coordinates are pixels, x to the right, y down.

use crate::math::{DAffine3, DVec3};

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Projection {
    /// Pinhole at the origin of `to_world`, looking along +z; `tan_half` = tangent of half the horizontal field of view.
    Perspective { tan_half: f64, offset: [f64; 2] },
    /// Parallel rays along +z; the film spans [-1,1] horizontally.
    Orthographic,
}

#[derive(Clone, Debug)]
pub struct Sensor {
    pub projection: Projection,
    pub to_world: DAffine3,
    pub width: usize,
    pub height: usize,
    pub medium: Option<u32>,
}

impl Sensor {
    /// Origin and unit direction of the ray through the film point (`x`, `y`) in pixels.
    pub fn ray(&self, x: f64, y: f64) -> (DVec3, DVec3) {
        let (w, h) = (self.width as f64, self.height as f64);
        // Camera space: x to the left (Mitsuba), y up, z forward.
        let sx = 1.0 - 2.0 * x / w;
        let sy = (1.0 - 2.0 * y / h) * (h / w);
        match self.projection {
            Projection::Perspective { tan_half, offset } => {
                let d = DVec3::new((sx + 2.0 * offset[0]) * tan_half, (sy + 2.0 * offset[1] * h / w) * tan_half, 1.0);
                (self.to_world.translation, self.to_world.transform_vector3(d).normalize())
            }
            Projection::Orthographic => (
                self.to_world.transform_point3(DVec3::new(sx, sy, 0.0)),
                self.to_world.transform_vector3(DVec3::Z).normalize(),
            ),
        }
    }
}
