//! More paths of a derivative through film points near the limbs of spheres.
//!
//! A first vertex slides along its film point's ray ([T] (60)), which takes it over a sphere by `1/cos θ` of the angle θ at which it is met: scores squared grow
//! like 1/cos², whose integral over the film has no bound at the limb (cos θ = 0) but for a logarithm. So paths of their own start at film points
//! drawn with density `~ 1/cos θ`, weighed against those of the pixels by the balance heuristic. They score derivatives only: the picture is that of the pixels' paths.

use super::filter;
use crate::math::discrete::Discrete;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, warp};
use crate::params::ParamSet;
use crate::scene::Scene;
use crate::scene::parts::Filter;
use crate::sensor::{Projection, Sensor};
use crate::shape::Shape;
use std::f64::consts::PI;

/// Paths for one of each pixel's, per pixel that shows a sphere.
const RATE: f64 = 0.5;
/// Rays that measure how much of a sphere is seen.
const PROBES: u64 = 256;

#[derive(Clone, Copy, Debug)]
struct Ball {
    c: DVec3,
    r: f64,
    /// Probability of being chosen.
    share: f64,
}

/// The spheres that a camera sees in motion.
pub struct Limbs<'a> {
    sensor: &'a Sensor,
    filter: Filter,
    balls: Vec<Ball>,
    table: Discrete,
    /// Paths over the whole film for one of each pixel's.
    count: u64,
    even: bool,
}

impl<'a> Limbs<'a> {
    /// `None` where there are none.
    pub fn new(scene: &'a Scene, sensor: usize, params: &ParamSet) -> Option<Limbs<'a>> {
        let (film, sensor) = (&scene.films[sensor], &scene.sensors[sensor]);
        let (filter, even) = (film.part.filter, film.even);
        let looks = sensor.moves(params);
        let mut balls = Vec::new();
        let mut areas = Vec::new();
        for (i, s) in scene.shapes.iter().enumerate() {
            let Shape::Sphere(sphere) = &s.shape else { continue };
            if scene.is_null(s) || !(looks || s.moves(params)) {
                continue;
            }
            let ball = Ball { c: sphere.center, r: sphere.radius, share: 1.0 };
            let area = ball.seen(scene, sensor, i as u32, filter::radius(filter));
            if area > 0.0 {
                balls.push(ball);
                areas.push(area);
            }
        }
        let total: f64 = areas.iter().sum();
        balls.iter_mut().zip(&areas).for_each(|(b, a)| b.share = a / total);
        let count = (RATE * total).ceil() as u64;
        (count > 0).then(|| Limbs { sensor, filter, balls, table: Discrete::new(areas), count, even })
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    /// Whether their random numbers lie evenly.
    pub fn even(&self) -> bool {
        self.even
    }

    /// A film point; `None` behind the camera.
    pub fn sample(&self, rng: &mut Rng) -> Option<[f64; 2]> {
        let (k, _, _) = self.table.sample(rng.uniform());
        self.balls[k].sample(self.sensor, rng)
    }

    /// What a path through the film point counts in the pixel, drawn from its filter or from here: `w / (w + count q)`, w the filter and q the density here.
    pub fn weight(&self, film: [f64; 2], pixel: [usize; 2]) -> f64 {
        let w = filter::density(self.filter, film[0] - (pixel[0] as f64 + 0.5))
            * filter::density(self.filter, film[1] - (pixel[1] as f64 + 0.5));
        let q: f64 = self.balls.iter().map(|b| b.share * b.density(self.sensor, film)).sum();
        if w > 0.0 { w / (w + self.count as f64 * q) } else { 0.0 }
    }

    /// Pixels that a film point concerns, with its weights there.
    pub fn weights(&self, film: [f64; 2]) -> impl Iterator<Item = ([usize; 2], f64)> {
        let size = [self.sensor.width, self.sensor.height];
        filter::pixels(self.filter, film, size).map(move |p| (p, self.weight(film, p))).filter(|w| w.1 > 0.0)
    }
}

/// Marks the keys of these paths in streams that they share with the pixels'.
pub const LIMB_KEY: u64 = 1 << 62;

impl Ball {
    /// cos θ is uniform, and so is the angle around the sphere's centre.
    fn sample(&self, sensor: &Sensor, rng: &mut Rng) -> Option<[f64; 2]> {
        let (cos, v) = (1.0 - rng.uniform(), rng.uniform());
        let b = self.r * ((1.0 - cos) * (1.0 + cos)).sqrt();
        let (sin_phi, cos_phi) = (2.0 * PI * v).sin_cos();
        let o = sensor.to_world.translation;
        let p = match sensor.projection {
            Projection::Perspective { .. } => {
                let to = self.c - o;
                let (sin, axis) = (b / to.length(), to.normalize());
                if sin >= 1.0 {
                    return None;
                }
                let local = DVec3::new(sin * cos_phi, sin * sin_phi, ((1.0 - sin) * (1.0 + sin)).sqrt());
                o + warp::to_world(axis, local) * to.length()
            }
            Projection::Orthographic => {
                let (_, w) = sensor.ray(0.0, 0.0);
                self.c + warp::to_world(w, DVec3::new(b * cos_phi, b * sin_phi, 0.0))
            }
        };
        Some(sensor.project(p)?.film)
    }

    /// Per pixel².
    fn density(&self, sensor: &Sensor, film: [f64; 2]) -> f64 {
        let (o, w) = sensor.ray(film[0], film[1]);
        let to = self.c - o;
        let along = to.dot(w);
        let b = (to - w * along).length();
        if along <= 0.0 || b >= self.r || to.length() <= self.r {
            return 0.0;
        }
        let cos = ((1.0 - b / self.r) * (1.0 + b / self.r)).sqrt();
        let Some(q) = sensor.project(o + w * along) else { return 0.0 };
        // Per area across the ray at the distance `along`.
        let per_area = match sensor.projection {
            Projection::Perspective { .. } => to.length() / along,
            Projection::Orthographic => 1.0,
        } / (2.0 * PI * self.r * self.r * cos);
        per_area / q.pixels_per_area
    }

    /// Pixels of the film, and of the margin around it, that show the sphere.
    fn seen(&self, scene: &Scene, sensor: &Sensor, shape: u32, margin: f64) -> f64 {
        let size = [sensor.width as f64, sensor.height as f64];
        let area = |i: u64| {
            let film =
                self.sample(sensor, &mut Rng::keyed(0, Purpose::Pilot as u64, LIMB_KEY | u64::from(shape), i))?;
            let inside = (0..2).all(|k| film[k] > -margin && film[k] < size[k] + margin);
            let (o, w) = sensor.ray(film[0], film[1]);
            let first = scene.opaque_past(o, w, f64::INFINITY, &[]).filter(|_| inside)?;
            (first.shape == shape).then(|| 1.0 / self.density(sensor, film))
        };
        (0..PROBES).filter_map(area).filter(|a| a.is_finite()).sum::<f64>() / PROBES as f64
    }
}

#[cfg(test)]
#[path = "limb_tests.rs"]
mod tests;
