//! Sensors: film coordinates to camera rays. Film coordinates are pixels, x to the right, y down.

use crate::math::{DAffine3, DVec3};
use crate::params::{Covector, Mover, ParamSet, Partial, Sink, Slot};

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
    pub mover: Mover,
    /// Slots of field of view and principal point, for a pinhole; `NO_SLOT` otherwise.
    pub lens: Slot,
}

/// A world point as the film sees it.
#[derive(Clone, Copy, Debug)]
pub struct Projected {
    /// Film point in pixels.
    pub film: [f64; 2],
    /// The ray that meets the point: origin, unit direction, distance.
    pub o: DVec3,
    pub w: DVec3,
    pub distance: f64,
    /// Film area (pixels^2) of a unit area across the ray at the point: `1/(A cos^3 d^2)` of [T] (37) for a pinhole.
    pub pixels_per_area: f64,
}

impl Sensor {
    /// The inverse of [`Sensor::ray`]; `None` behind the camera. The film point may lie outside of the film.
    pub fn project(&self, p: DVec3) -> Option<Projected> {
        let (w, h) = (self.width as f64, self.height as f64);
        let m = self.to_world.matrix3;
        let local = m.inverse() * (p - self.to_world.translation);
        let det = m.determinant().abs();
        // Screen coordinates, their step a pixel, and the ray.
        let (sx, sy, o, pixels_per_area) = match self.projection {
            Projection::Perspective { tan_half, offset } => {
                if local.z.is_nan() || local.z <= 0.0 {
                    return None;
                }
                let (x, y) = (local.x / local.z, local.y / local.z);
                let o = self.to_world.translation;
                let d3 = (m * DVec3::new(x, y, 1.0)).length().powi(3);
                let step = 2.0 * tan_half / w;
                let per_angle = d3 / (det * step * step);
                let (sx, sy) = (x / tan_half - 2.0 * offset[0], y / tan_half - 2.0 * offset[1] * h / w);
                (sx, sy, o, per_angle / (p - o).length_squared())
            }
            Projection::Orthographic => {
                let o = self.to_world.transform_point3(DVec3::new(local.x, local.y, 0.0));
                if local.z.is_nan() || local.z <= 0.0 {
                    return None;
                }
                let step = 2.0 / w;
                (local.x, local.y, o, (m * DVec3::Z).length() / (det * step * step))
            }
        };
        let film = [0.5 * (1.0 - sx) * w, 0.5 * (1.0 - sy * w / h) * h];
        let d = p - o;
        let distance = d.length();
        (distance > 0.0).then(|| Projected { film, o, w: d / distance, distance, pixels_per_area })
    }

    /// Whether a film point lies on the film, or within a margin around it.
    pub fn shows(&self, film: [f64; 2], margin: f64) -> bool {
        let size = [self.width as f64, self.height as f64];
        (0..2).all(|k| film[k] > -margin && film[k] < size[k] + margin)
    }

    /// Whether any parameter moves it.
    pub fn moves(&self, params: &ParamSet) -> bool {
        let active = |first: Slot, n| first != Slot::MAX && params.block_active(first, n);
        active(self.mover.first, Mover::SLOTS) || active(self.lens, 3)
    }

    /// How `p`, at a fixed distance on a fixed film point's ray, moves with the lens: its velocity for each of the three slots.
    fn by_lens(&self, p: DVec3) -> [DVec3; 3] {
        let Projection::Perspective { tan_half, .. } = self.projection else { return [DVec3::ZERO; 3] };
        let m = self.to_world.matrix3;
        let local = m.inverse() * (p - self.to_world.translation);
        let aspect = self.height as f64 / self.width as f64;
        let step = 2.0 * tan_half * local.z;
        [DVec3::new(local.x, local.y, 0.0) / tan_half, DVec3::X * step, DVec3::Y * (step * aspect)].map(|v| m * v)
    }

    /// `<c, v>`, v the velocity of the point p as part of its film point's ray [T] (9): with the camera, and as the lens turns the ray.
    pub fn forms(&self, p: DVec3, c: DVec3) -> [Partial; 5] {
        let [a, b, d, e] = self.mover.forms(p, c);
        let v = self.by_lens(p).map(|v| c.dot(v));
        // Parallel rays have no lens.
        let (slot, len) = if self.lens == Slot::MAX { (0, 0) } else { (self.lens, 3) };
        [a, b, d, e, Partial { slot, v: DVec3::from_array(v), len }]
    }

    /// The same per channel.
    pub fn point(&self, p: DVec3, c: &Covector, sink: &mut impl Sink) {
        self.mover.point(p, c, sink);
        if self.lens != Slot::MAX {
            for (k, v) in self.by_lens(p).into_iter().enumerate() {
                sink.add(self.lens + k as Slot, c.dot(v));
            }
        }
    }

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projecting_inverts_the_ray_and_its_area() {
        let place = DAffine3::from_translation(DVec3::new(1.0, 2.0, 3.0))
            * DAffine3::from_rotation_y(0.7)
            * DAffine3::from_scale(DVec3::new(1.5, 0.8, 2.0));
        for projection in [Projection::Perspective { tan_half: 0.6, offset: [0.1, -0.2] }, Projection::Orthographic] {
            let mover = Mover { first: 0, pivot: place.translation };
            let s = Sensor { projection, to_world: place, width: 40, height: 30, medium: None, mover, lens: Slot::MAX };
            let at = |x: f64, y: f64| {
                let (o, w) = s.ray(x, y);
                o + w * 2.5
            };
            let (x, y, h) = (11.3, 22.1, 1e-4);
            let q = s.project(at(x, y)).unwrap();
            assert!(
                (q.film[0] - x).abs() < 1e-9 && (q.film[1] - y).abs() < 1e-9 && (q.distance - 2.5).abs() < 1e-9,
                "{q:?}"
            );
            // The area across the ray that a square of side 2h pixels fills at that distance.
            let (dx, dy) = (at(x + h, y) - at(x - h, y), at(x, y + h) - at(x, y - h));
            let area = dx.cross(dy).dot(q.w).abs() / (4.0 * h * h);
            assert!((area * q.pixels_per_area - 1.0).abs() < 1e-6, "{}", area * q.pixels_per_area);
        }
    }
}
