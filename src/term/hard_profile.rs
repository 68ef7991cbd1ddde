//! Where the profile of a light ends moves: term H of [T] section 3 ([T] 5.3, (62c)). The hard edge of a spot's cone; those of beams are [`super::hard_beam`]'s in media, [`super::beam_spot`]'s on
//! surfaces ([`super::cast`]'s beside glass and mirrors), and where beams begin [`super::beam_start`]'s.
//!
//! The cone `<u,d> = cos θ |u|`, u = y - p, is a sheet like a shadow's, with nothing standing on its rays: n = (d - cos θ u/ρ) / sin θ
//! toward the axis and `v_n = <n,ṗ> - <u,ḋ>/sin θ - ρ θ̇`, less the point's own motion: in a medium that scatters more than once points near the apex
//! go with it ([`crate::transport::field`]), so that v_n vanishes there.

use super::beam_spot::BeamSpot;
use super::beam_start::BeamStart;
use super::ends::{self, Point, Watch};
use super::hard_beam::HardBeams;
use super::sheet::{Partials, Ray, Reach};
use super::sheet_samples::{self, Found};
use super::{Context, LightMotion, Motion, Room, Sample};
use crate::light::{LightKind, Place};
use crate::math::discrete::Discrete;
use crate::math::guide::{DIMENSIONS, Numbers};
use crate::math::rng::Rng;
use crate::math::{DVec3, warp};
use crate::params::Partial;
use crate::scene::Scene;
use crate::sensor::Sensor;
use std::f64::consts::TAU;

pub const NAME: &str = "hard_profile";

pub struct HardProfile {
    cones: Vec<Cone>,
    spots: Vec<BeamSpot>,
    starts: Vec<BeamStart>,
    /// Of cones, then spots, then starts.
    table: Discrete,
    reach: Reach,
    beams: Option<HardBeams>,
}

struct Cone {
    light: u32,
    apex: DVec3,
    axis: DVec3,
    /// Half angle.
    sin: f64,
    cos: f64,
    place: Place,
    motion: LightMotion,
}

impl HardProfile {
    /// Every spot light with a hard edge that moves in any way, and all hard beams; `None` if there is none.
    pub fn prepare(scene: &Scene, sensor: &Sensor, motion: &Motion) -> Option<HardProfile> {
        let cone = |(i, (l, m)): (usize, (&crate::light::Light, &LightMotion))| match l.kind {
            LightKind::Spot { position, axis, beam, cutoff }
                if beam >= cutoff && (m.position || m.direction || m.angles || motion.surfaces()) =>
            {
                let (sin, cos) = cutoff.sin_cos();
                Some(Cone { light: i as u32, apex: position, axis, sin, cos, place: l.place, motion: *m })
            }
            _ => None,
        };
        let cones: Vec<Cone> = scene.lights.iter().zip(&motion.lights).enumerate().filter_map(cone).collect();
        let spots = BeamSpot::all(scene, motion);
        let starts = BeamStart::all(scene, motion);
        let lights = cones.iter().map(|c| c.light).chain(spots.iter().map(BeamSpot::light));
        let lights = lights.chain(starts.iter().map(BeamStart::light));
        let power = |id: u32| scene.lights[id as usize].value.max().max(f64::MIN_POSITIVE);
        let table = Discrete::new(lights.map(power));
        let beams = HardBeams::prepare(scene, motion);
        let any = beams.is_some() || !table.is_empty();
        any.then(|| HardProfile { cones, spots, starts, table, reach: Reach::new(scene, sensor), beams })
    }
}

impl Cone {
    fn ray(&self, w: DVec3) -> Ray {
        // The normal lies in the plane of axis and ray: rebuilt from what is across the axis, it is exact at any distance.
        let m = (w - self.axis * w.dot(self.axis)).normalize();
        let w = self.axis * self.cos + m * self.sin;
        Ray {
            light: self.light,
            origin: self.apex,
            w,
            near: 0.0,
            n: self.axis * self.sin - m * self.cos,
            across: 1.0 / (TAU * self.sin),
            distant: false,
            crossed: true,
            profile: true,
            in_media: true,
        }
    }

    /// `-v_n`, less what the vertex itself does. With beam width = cutoff, each of the two angles moves the edge by half.
    fn motion(&self, cx: &Context, ray: &Ray, rho: f64, point: &Point, watch: &Watch) -> Partials {
        let mut p = Partials::default();
        if self.motion.position {
            p.push(Partial { slot: self.place.position, v: -ray.n, len: 3 });
        }
        if self.motion.direction {
            p.push(Partial { slot: self.place.direction, v: ray.w * (rho / self.sin), len: 3 });
        }
        if self.motion.angles {
            p.push(Partial { slot: self.place.angles, v: DVec3::new(0.5 * rho, 0.5 * rho, 0.0), len: 2 });
        }
        ends::motion(cx, point, watch, ray.n, &mut p);
        p
    }

    /// Abscissae of a line on the cone, its mirrored nappe left out.
    fn crossings(&self, o: DVec3, w: DVec3) -> Vec<(f64, DVec3)> {
        // A half angle of 90 degrees makes the cone a plane.
        if self.cos.abs() < 1e-8 {
            let t = -(o - self.apex).dot(self.axis) / w.dot(self.axis);
            return if t.is_finite() { vec![(t, o - self.apex + w * t)] } else { Vec::new() };
        }
        let (u, axis, c2) = (o - self.apex, self.axis, self.cos * self.cos);
        let (ud, wd) = (u.dot(axis), w.dot(axis));
        let q = [wd * wd - c2, 2.0 * (ud * wd - c2 * u.dot(w)), ud * ud - c2 * u.length_squared()];
        let front = self.cos >= 0.0;
        super::arcs::quadratic(q).map(|t| (t, u + w * t)).filter(|(_, y)| (y.dot(axis) > 0.0) == front).collect()
    }
}

impl Room for HardProfile {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        if let Some(beams) = &self.beams {
            beams.along(cx, film, *rng, emit);
        }
        if self.cones.is_empty() && self.starts.is_empty() {
            return;
        }
        sheet_samples::along(cx, film, |cx, spans, span| {
            for (i, start) in self.starts.iter().enumerate() {
                let probability = self.table.probability(self.cones.len() + self.spots.len() + i);
                start.cross(cx, spans, probability, emit);
            }
            for (i, cone) in self.cones.iter().enumerate() {
                for (t, u) in cone.crossings(span.o, span.w) {
                    let rho = u.length();
                    if t > 0.0 && t < span.t1 && rho > 0.0 {
                        let ray = cone.ray(u / rho);
                        let ray = Ray { across: ray.across * self.table.probability(i), ..ray };
                        let found = Found { spans, t, ray, rho, grazed: &[] };
                        let (point, watch) = sheet_samples::crossed(cx, span, t);
                        let partials = cone.motion(cx, &ray, rho, &point, &watch);
                        sheet_samples::crossing(cx, &self.reach, &found, &partials, emit);
                    }
                }
            }
        });
    }

    fn has_outward(&self) -> bool {
        !self.table.is_empty()
    }

    fn guided_numbers(&self) -> usize {
        if self.table.is_empty() { 0 } else { DIMENSIONS }
    }

    fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        if self.table.is_empty() {
            return;
        }
        let (k, probability, u) = self.table.sample(lead[0]);
        let (of_spot, of_start) = (k.checked_sub(self.cones.len()), k.checked_sub(self.cones.len() + self.spots.len()));
        if let Some(i) = of_start {
            let own = (&self.reach, probability);
            return self.starts[i].outward(cx, own, (u, &lead[1..]), rng, emit);
        }
        if let Some(i) = of_spot {
            let spot = &self.spots[i];
            let ray = spot.ray(u);
            let ray = Ray { across: ray.across * probability, ..ray };
            let motion =
                |cx: &Context, rho: f64, point: &Point, watch: &Watch| spot.motion(cx, &ray, rho, point, watch);
            return sheet_samples::outward(cx, &self.reach, &ray, &[], &motion, &lead[1..], rng, emit);
        }
        let cone = &self.cones[k];
        let (x, y) = warp::frame(cone.axis);
        let (s, c) = (TAU * u).sin_cos();
        let ray = cone.ray(cone.axis * cone.cos + (x * c + y * s) * cone.sin);
        let ray = Ray { across: ray.across * probability, ..ray };
        let motion = |cx: &Context, rho: f64, point: &Point, watch: &Watch| cone.motion(cx, &ray, rho, point, watch);
        sheet_samples::outward(cx, &self.reach, &ray, &[], &motion, &lead[1..], rng, emit);
    }
}
