//! Where random rays of lights without extent, and of beams, are sent to find ways by smooth surfaces that nothing lists ([`crate::transport::manifold`]): at smooth shapes, where some are curved.

use super::Scene;
use super::beams::is_flat;
use super::chains::{MOST, has_flat_faces};
use crate::light::{Light, LightKind};
use crate::math::fermat::{Eye, Start};
use crate::math::rng::Rng;
use crate::math::{DVec3, warp};
use crate::shape::{Geometry, Shape};
use std::f64::consts::PI;

/// A Gaussian beam's rays begin within so many radii.
const GAUSSIAN: f64 = 3.0;

impl Scene {
    /// Balls around what rays are sent at; none where all ways are listed. Call when shapes, surfaces and lights are known.
    pub fn prepare_seeds(&mut self) {
        let smooth = || self.shapes.iter().filter(|s| self.surfaces[s.surface as usize].is_smooth());
        let curved = |s: &&super::Instance| matches!(s.shape, Shape::Sphere(_) | Shape::Cylinder(_));
        let lit = self.lights.iter().any(|l| l.origin().is_some());
        let alone = smooth().count() == 1 && smooth().all(|s| matches!(s.shape, Shape::Sphere(_)));
        let wanted = lit && !alone && smooth().any(|s| curved(&s));
        let ball = |s: &super::Instance| (s.shape.bounds().center(), s.shape.bounds().radius());
        self.seeds = smooth().filter(|_| wanted).map(ball).collect();
    }

    /// A random ray of a light, at a smooth shape.
    pub fn seed(&self, light: &Light, eye: &Eye, rng: &mut Rng) -> Option<Start> {
        let k = ((rng.uniform() * self.seeds.len() as f64) as usize).min(self.seeds.len().checked_sub(1)?);
        let (center, radius) = self.seeds[k];
        let (u, v) = (rng.uniform(), rng.uniform());
        match *eye {
            Eye::Point(q) => {
                let to = center - q;
                let sin = radius / to.length();
                // All directions, from inside.
                let least = if sin < 1.0 { (1.0 - sin * sin).sqrt() } else { -1.0 };
                let axis = to.try_normalize().unwrap_or(DVec3::Z);
                let (x, y) = warp::frame(axis);
                let cos = 1.0 - u * (1.0 - least);
                let (sin, phi) = ((1.0 - cos * cos).max(0.0).sqrt(), 2.0 * PI * v);
                Some(Start { o: q, w: axis * cos + (x * phi.cos() + y * phi.sin()) * sin })
            }
            Eye::Parallel(w) => {
                let (x, y) = warp::frame(w);
                let disc = |middle: DVec3, r: f64| {
                    let (r, phi) = (r * u.sqrt(), 2.0 * PI * v);
                    middle + (x * phi.cos() + y * phi.sin()) * r
                };
                let o = match light.kind {
                    LightKind::Beam { position, radius: r, gaussian, .. } => {
                        let reach = r * if gaussian { GAUSSIAN } else { 1.0 };
                        let foot = center - w * (center - position).dot(w);
                        if reach < radius { disc(position, reach) } else { disc(foot, radius) }
                    }
                    _ => disc(center - w * (2.0 * self.bounds.radius() + radius), radius),
                };
                Some(Start { o, w })
            }
        }
    }

    /// Whether connections find all ways by these shapes in turn (with the face of a mesh or block each) without being sent to look for them, or cannot find any.
    pub fn is_listed(&self, light: &Light, shapes: impl Iterator<Item = u32> + Clone) -> bool {
        let each = || shapes.clone().map(|id| &self.shapes[id as usize]);
        // Shaded by vertex normals: not followed.
        if each().any(|s| matches!(s.shape, Shape::Mesh(_)) && !has_flat_faces(s)) {
            return true;
        }
        let first = shapes.clone().next();
        let of_one_ball =
            each().all(|s| matches!(s.shape, Shape::Sphere(_))) && shapes.clone().all(|s| Some(s) == first);
        let beam = matches!(light.kind, LightKind::Beam { .. });
        let flat = each().all(has_flat_faces);
        of_one_ball || flat && (shapes.clone().count() <= MOST || beam && each().all(|s| is_flat(&s.shape)))
    }
}
