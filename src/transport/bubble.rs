//! Bubbles: balls, rods and meshes shaded by vertex normals, of less index than what is around them. A ray from outside that meets the wall near the critical angle goes round along it in short chords.

use super::shot::{self, D2, Eye, Place, Start, Step};
use crate::math::{DVec2, DVec3, Real, warp};
use crate::scene::Scene;
use crate::scene::chains::has_flat_faces;
use crate::scene::effort;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;

/// Steps of Newton's method toward a sine of incidence, which is nearly linear in rays that meet a ball.
const INCLINED: u32 = 3;

/// Of a bubble's wall, of less index inside of its curve than outside: the sine of incidence from which on it mirrors all that comes from outside.
pub fn critical(scene: &Scene, shape: u32) -> Option<f64> {
    let Surface::Dielectric { interior, exterior, .. } = scene.surface_of(shape) else { return None };
    let instance = &scene.shapes[shape as usize];
    let out = match &instance.shape {
        Shape::Sphere(s) => s.normal(0, s.center + DVec3::X * s.radius).x,
        Shape::Cylinder(q) => {
            let (x, _) = warp::frame(q.axis);
            q.normal(0, q.base + x * q.radius).dot(x)
        }
        Shape::Mesh(_) if !has_flat_faces(instance) => 1.0,
        _ => return None,
    };
    let inside_out = if out > 0.0 { interior / exterior } else { exterior / interior };
    (inside_out < 1.0).then_some(inside_out)
}

/// Whether rays of a bubble's critical angle are a line, straight across it, and no circle.
pub fn is_wall(scene: &Scene, shape: u32) -> bool {
    matches!(scene.shapes[shape as usize].shape, Shape::Cylinder(_))
}

/// The sine of incidence at a chain's last face.
fn incidence(scene: &Scene, eye: &Eye, at: Start, place: &Place, chain: &[Step]) -> Option<D2> {
    effort::note(1);
    let mut ray = eye.ray(at);
    let known = shot::faces(scene, at, place, chain)?;
    let (last, before) = known.split_last()?;
    for step in before {
        ray = shot::carry(scene, ray, step)?.ray;
    }
    let sine = shot::meet(scene, ray, last)?.1.cross(ray.1);
    Some(sine.dot(sine).sqrt())
}

/// A ray of the eye at which that is `sine`, or nearly, from one near it.
pub fn inclined(scene: &Scene, eye: &Eye, near: Start, place: &Place, chain: &[Step], sine: f64) -> Option<Start> {
    let mut at = near;
    for _ in 0..INCLINED {
        let is = incidence(scene, eye, at, place, chain)?;
        let slope = DVec2::new(is.d[0], is.d[1]);
        at = eye.step(at, slope * ((sine - is.v) / slope.length_squared()));
    }
    (at.o.is_finite() && at.w.is_finite()).then_some(at)
}

/// A chain that is mirrored inside of a bubble that is no rod. Newton's method for its rays goes by the sine of incidence where they come in: the critical rays are a circle, which straight steps leave.
pub struct Round<'a> {
    scene: &'a Scene,
    eye: &'a Eye,
    place: &'a Place,
    /// The chain as far as into the bubble.
    comes_in: &'a [Step],
}

impl<'a> Round<'a> {
    pub fn of(scene: &'a Scene, eye: &'a Eye, place: &'a Place, chain: &'a [Step]) -> Option<Round<'a>> {
        let goes_round = |s: &[Step]| {
            let round = s[0].through && !s[0].inside && s[1].shape == s[0].shape && !s[1].through;
            round && !is_wall(scene, s[0].shape) && critical(scene, s[0].shape).is_some()
        };
        let k = chain.windows(2).position(goes_round)?;
        Some(Round { scene, eye, place, comes_in: &chain[..=k] })
    }

    /// The sine there, along the coordinates of the eye's rays beside this.
    pub fn course(&self, at: Start) -> Option<D2> {
        incidence(self.scene, self.eye, at, self.place, self.comes_in)
    }

    /// The ray that a step leads to, at the sine that is asked of it.
    pub fn step(&self, at: Start, sine: &D2, by: DVec2) -> Option<Start> {
        let wanted = sine.v + by.dot(DVec2::new(sine.d[0], sine.d[1]));
        inclined(self.scene, self.eye, self.eye.step(at, by), self.place, self.comes_in, wanted)
    }
}
