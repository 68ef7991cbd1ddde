//! Where random rays of lights without extent, and of beams, are sent to find ways by smooth surfaces that nothing lists ([`crate::transport::manifold`]): at smooth shapes, where some are curved.

use super::Scene;
use super::beams::is_flat;
use super::chains::{MOST, has_flat_faces};
use crate::light::{Light, LightKind};
use crate::math::fermat::{Eye, Start};
use crate::math::rng::Rng;
use crate::math::warp;
use crate::shape::{Geometry, Shape};
use std::f64::consts::PI;

/// A Gaussian beam's rays begin within so many radii: of the rest e^-18 is left.
const MOST_OF_A_GAUSSIAN: f64 = 3.0;

impl Scene {
    /// Shapes that rays are sent at; none where all ways are listed. Call when shapes, surfaces and lights are known.
    pub fn prepare_seeds(&mut self) {
        let smooth = || (0..).zip(&self.shapes).filter(|(_, s)| self.surfaces[s.surface as usize].is_smooth());
        let lit = self.lights.iter().any(|l| l.origin().is_some());
        let alone = smooth().count() == 1 && smooth().all(|(_, s)| matches!(s.shape, Shape::Sphere(_)));
        let wanted = lit && !alone && smooth().any(|(_, s)| !has_flat_faces(s));
        self.seeds = smooth().filter(|_| wanted).map(|(id, _)| id).collect();
    }

    /// A random ray of a light, at a point of a smooth shape; of a beam narrower than that, any of its rays.
    pub fn seed(&self, light: &Light, eye: &Eye, rng: &mut Rng) -> Option<Start> {
        let k = ((rng.uniform() * self.seeds.len() as f64) as usize).min(self.seeds.len().checked_sub(1)?);
        let shape = &self.shapes[self.seeds[k] as usize].shape;
        let (u, v) = (rng.uniform(), rng.uniform());
        let at = || shape.sample(u, v).p;
        match (eye, &light.kind) {
            (Eye::Point(q), _) => Some(Start { o: *q, w: (at() - *q).try_normalize()? }),
            (Eye::Parallel(w), LightKind::Beam { position, radius, gaussian, .. }) => {
                let reach = radius * if *gaussian { MOST_OF_A_GAUSSIAN } else { 1.0 };
                if reach >= shape.bounds().radius() {
                    let p = at();
                    return Some(Start { o: p - *w * (p - *position).dot(*w), w: *w });
                }
                let ((x, y), r, phi) = (warp::frame(*w), reach * u.sqrt(), 2.0 * PI * v);
                Some(Start { o: *position + (x * phi.cos() + y * phi.sin()) * r, w: *w })
            }
            (Eye::Parallel(w), _) => {
                // All begin on one plane before the scene, so that equal rays are told by where they begin.
                let (p, far) = (at(), self.bounds.center() - *w * (2.0 * self.bounds.radius()));
                Some(Start { o: p - *w * (p - far).dot(*w), w: *w })
            }
        }
    }

    /// Whether other connections find all ways by these shapes in turn (one face of each).
    pub fn is_left_to_others(&self, light: &Light, shapes: impl Iterator<Item = u32> + Clone) -> bool {
        let each = || shapes.clone().map(|id| &self.shapes[id as usize]);
        let first = shapes.clone().next();
        let of_one_ball =
            each().all(|s| matches!(s.shape, Shape::Sphere(_))) && shapes.clone().all(|s| Some(s) == first);
        let beam = matches!(light.kind, LightKind::Beam { .. });
        let flat = each().all(has_flat_faces);
        of_one_ball || flat && (shapes.clone().count() <= MOST || beam && each().all(|s| is_flat(&s.shape)))
    }
}
