//! How shots by way of interfaces are looked for ([`crate::transport::shot`], [`crate::transport::chance`]): from the camera, by chains that are known ([`super::known_chains`]) or by chance; from a vertex of a camera path by chance alone.

use super::Context;
use super::known_chains::KnownChains;
use super::seen_path::Vertex;
use crate::math::discrete::Discrete;
use crate::math::rng::Rng;
use crate::math::{DVec3, warp};
use crate::scene::Scene;
use crate::sensor::{Projection, Sensor};
use crate::shape::Geometry;
use crate::transport::chance::{self, Drawn};
use crate::transport::shot::{Eye, Place, Shot, Start, Step, Target};
use std::cell::Cell;

/// A shot, and the probability of the way that it was looked for.
pub enum Aimed {
    /// By a chosen chain: of that choice, too.
    Known(Shot, f64),
    Drawn(Drawn, f64),
}

impl Aimed {
    pub fn shot(&self) -> &Shot {
        match self {
            Aimed::Known(shot, _) => shot,
            Aimed::Drawn(d, _) => &d.shot,
        }
    }

    /// One over the probability of the shot, on average. `None` after far too many trials.
    pub fn trials(&self, scene: &Scene, from: &From, target: &Target, rng: &mut Rng) -> Option<f64> {
        match self {
            Aimed::Known(_, p) => Some(1.0 / p),
            Aimed::Drawn(d, p) => {
                let random = |rng: &mut Rng| from.random(scene, rng);
                d.trials(scene, &from.eye, &from.place, target, rng, random).map(|k| k / p)
            }
        }
    }
}

/// Where shots begin, and their random rays.
pub struct From<'a> {
    pub eye: Eye,
    pub place: Place,
    rays: Rays<'a>,
}

enum Rays<'a> {
    /// The film, and how far around it.
    Film(&'a Sensor, f64),
    Vertex(DVec3, &'a Interfaces),
}

impl<'a> From<'a> {
    pub fn camera(sensor: &'a Sensor, margin: f64) -> From<'a> {
        let (o, w) = sensor.ray(0.5 * sensor.width as f64, 0.5 * sensor.height as f64);
        let eye = match sensor.projection {
            Projection::Perspective { .. } => Eye::Point(o),
            Projection::Orthographic => Eye::Parallel(w),
        };
        From { eye, place: Place::within(sensor.medium), rays: Rays::Film(sensor, margin) }
    }

    pub fn vertex(scene: &Scene, v: &Vertex, interfaces: &'a Interfaces) -> From<'a> {
        From { eye: Eye::Point(v.p()), place: v.place(scene), rays: Rays::Vertex(v.p(), interfaces) }
    }

    /// A random ray.
    pub fn random(&self, scene: &Scene, rng: &mut Rng) -> Option<Start> {
        match &self.rays {
            Rays::Film(sensor, margin) => {
                let at = |u: f64, size: usize| u * (size as f64 + 2.0 * margin) - margin;
                let (o, w) = sensor.ray(at(rng.uniform(), sensor.width), at(rng.uniform(), sensor.height));
                Some(Start { o, w })
            }
            // Small interfaces are found by their points, large ones by directions: of a plane without end nearly all points are seen at grazing.
            Rays::Vertex(p, _) if rng.uniform() < 0.5 => {
                Some(Start { o: *p, w: warp::sphere(rng.uniform(), rng.uniform()) })
            }
            Rays::Vertex(p, interfaces) => {
                let (k, _, u) = interfaces.by_area.sample(rng.uniform());
                let at = scene.shapes[interfaces.list[k] as usize].shape.sample(u, rng.uniform()).p;
                Some(Start { o: *p, w: (at - *p).try_normalize()? })
            }
        }
    }

    /// One by chance, by a chain that is not known.
    pub fn draw(
        &self,
        scene: &Scene,
        target: &Target,
        rng: &mut Rng,
        is_known: impl Fn(&[Step]) -> bool,
    ) -> Option<Drawn> {
        chance::draw(scene, &self.eye, &self.place, target, rng, |rng| self.random(scene, rng), is_known)
    }

    /// One from the camera to a point. `chain`: the known one that was chosen, and the probability of that.
    pub fn to_point(
        &self,
        cx: &mut Context,
        known: &KnownChains,
        (e, chain): (DVec3, Option<(usize, f64)>),
        rng: &mut Rng,
    ) -> Option<Aimed> {
        let scene = cx.scene;
        let Some((k, p)) = chain else {
            let drawn = self.draw(scene, &Target::Point(e), rng, |c| known.holds(c))?;
            return Some(Aimed::Drawn(drawn, 1.0 - known.share));
        };
        let lost = Cell::new(0);
        let shot = known.shoot(scene, &self.eye, &self.place, e, k, &lost);
        cx.tally.missed_boundary += lost.get();
        shot.map(|shot| Aimed::Known(shot, known.share * p))
    }

    /// Chains by which it sees.
    pub fn known_chains(&self, scene: &Scene) -> KnownChains {
        KnownChains::find(scene, &self.eye, &self.place, |rng: &mut Rng| self.random(scene, rng))
    }
}

/// Smooth shapes, and a choice of them by area.
pub struct Interfaces {
    pub list: Vec<u32>,
    by_area: Discrete,
}

impl Interfaces {
    pub fn new(scene: &Scene) -> Interfaces {
        let smooth = |i: &u32| scene.surface_of(*i).is_smooth();
        let list: Vec<u32> = (0..scene.shapes.len() as u32).filter(smooth).collect();
        let by_area = Discrete::new(list.iter().map(|&i| scene.shapes[i as usize].shape.area()));
        Interfaces { list, by_area }
    }
}
