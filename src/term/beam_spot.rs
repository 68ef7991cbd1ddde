//! The border of the spot that a hard-edged collimated beam makes on what it meets: of term H of [T] section 3, the part on surfaces. In media it is [`super::hard_beam`]'s, and beside glass and mirrors [`super::cast`]'s.
//!
//! A beam's edge is a sheet of parallel rays: x = p + ρ d + R m, m across the axis d, with n = -m toward the axis and `v_n = <n, ṗ + ρ ḋ> - Ṙ`, less the receiver's own motion.

use super::ends::{self, Point, Watch};
use super::sheet::{Partials, Ray};
use super::{Context, Motion};
use crate::light::{Light, LightKind};
use crate::math::{DVec3, warp};
use crate::params::Partial;
use crate::scene::Scene;
use std::f64::consts::TAU;

/// The edge of a beam.
pub struct BeamSpot {
    light: u32,
    position: DVec3,
    direction: DVec3,
    radius: f64,
}

impl BeamSpot {
    /// Of all hard-edged beams, where something receives them and nothing mirrors or refracts.
    pub fn all(scene: &Scene, motion: &Motion) -> Vec<BeamSpot> {
        if !motion.surfaces() || scene.has_smooth() || scene.shapes.iter().all(|s| scene.is_null(s)) {
            return Vec::new();
        }
        let spot = |(light, l): (u32, &Light)| match l.kind {
            LightKind::Beam { position, direction, radius, gaussian: false } => {
                Some(BeamSpot { light, position, direction, radius })
            }
            _ => None,
        };
        (0..).zip(&scene.lights).filter_map(spot).collect()
    }

    pub fn light(&self) -> u32 {
        self.light
    }

    /// The ray of the edge at the fraction u of a turn.
    pub fn ray(&self, u: f64) -> Ray {
        let (x, y) = warp::frame(self.direction);
        let (s, c) = (TAU * u).sin_cos();
        let m = x * c + y * s;
        Ray {
            light: self.light,
            origin: self.position + m * self.radius,
            w: self.direction,
            near: 0.0,
            n: -m,
            across: 1.0 / (TAU * self.radius),
            distant: true,
            crossed: false,
            profile: true,
            in_media: false,
        }
    }

    /// `-v_n`, less what the receiver itself does.
    pub fn motion(&self, cx: &Context, ray: &Ray, rho: f64, point: &Point, watch: &Watch) -> Partials {
        let mut p = Partials::default();
        let light = &cx.scene.lights[self.light as usize];
        light.edge_forms(ray.origin, -ray.n, |q| p.push(q));
        p.push(Partial { slot: light.place.direction, v: ray.n * -rho, len: 3 });
        ends::motion(cx, point, watch, ray.n, &mut p);
        p
    }
}
