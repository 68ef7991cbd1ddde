//! Where a collimated beam begins inside a medium: the disk across its axis before which nothing is lit. Of term H of [T] section 3, the part that a beam of any profile has.
//!
//! With `g = <q - p, d>` there is light where g > 0, and at a point q that moves with q̇ `ġ = <d, q̇ - ṗ> + <q - p, ḋ>`. The disk adds ġ times the irradiance there times what its points scatter.

use super::ends::{self, Point, Watch};
use super::light_walk::Vertex;
use super::sheet::{Partials, Reach};
use super::sheet_samples;
use super::{Context, Motion, Sample};
use crate::error::{Error, Result};
use crate::light::{Light, LightKind, Place, beam_profile};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb, warp};
use crate::params::Partial;
use crate::phase::one_minus_cos;
use crate::scene::Scene;
use crate::transport::transmit;
use std::f64::consts::{PI, TAU};

/// A Gaussian beam's disk ends at so many radii: e^-18.
const GAUSSIAN: f64 = 3.0;
/// Lines in the disk along which something opaque is looked for.
const LINES: u32 = 64;

/// The disk at which a beam begins.
pub struct BeamStart {
    light: u32,
    p: DVec3,
    d: DVec3,
    radius: f64,
    gaussian: bool,
    place: Place,
}

impl BeamStart {
    fn new(light: u32, l: &Light) -> Option<BeamStart> {
        let LightKind::Beam { position: p, direction: d, radius, gaussian } = l.kind else { return None };
        Some(BeamStart { light, p, d, radius, gaussian, place: l.place })
    }

    pub fn light(&self) -> u32 {
        self.light
    }

    /// Of all beams that begin inside a medium, where nothing mirrors or refracts ([`super::interfaces`]).
    pub fn all(scene: &Scene, motion: &Motion) -> Vec<BeamStart> {
        let smooth = scene.shapes.iter().any(|s| scene.surfaces[s.surface as usize].is_smooth());
        if smooth || !motion.surfaces() {
            return Vec::new();
        }
        let around = scene.around(scene.sensors.first());
        let inside = |b: &BeamStart| scene.medium_past(b.p, b.d, &[], &around).is_some();
        (0..).zip(&scene.lights).filter_map(|(id, l)| BeamStart::new(id, l)).filter(inside).collect()
    }

    /// An error where something that scatters crosses the disk: light on it would begin there, too.
    pub fn check(&self, scene: &Scene) -> Result<()> {
        let reach = self.radius * if self.gaussian { GAUSSIAN } else { 1.0 };
        let (x, y) = warp::frame(self.d);
        let met = |k: u32| {
            let (s, c) = (TAU * f64::from(k) / f64::from(LINES)).sin_cos();
            scene.opaque_past(self.p, x * c + y * s, reach, &[])
        };
        let Some(hit) = (0..LINES).filter_map(met).find(|h| scene.reflects(h)) else { return Ok(()) };
        let (light, shape) = (&scene.lights[self.light as usize].name, &scene.shapes[hit.shape as usize]);
        let what = format!(
            "the beam `{light}` begins inside a medium, and `{}` stands in the disk where it begins: how its light begins there cannot be told yet",
            shape.name
        );
        Err(Error::scene(&shape.span, what, "let the beam begin a little further on, or make it narrower"))
    }

    /// Irradiance at a point of its plane.
    fn irradiance(&self, scene: &Scene, q: DVec3) -> Rgb {
        let light = &scene.lights[self.light as usize];
        light.emission(Rgb::splat(beam_profile((q - self.p).length(), self.radius, self.gaussian))).color()
    }

    /// Per area, of [`BeamStart::sample`].
    fn density(&self, q: DVec3) -> f64 {
        let area = PI * self.radius * self.radius;
        let profile = beam_profile((q - self.p).length(), self.radius, self.gaussian);
        if self.gaussian { 2.0 * profile / area } else { profile / area }
    }

    /// A point of the disk, by the irradiance.
    fn sample(&self, u: f64, v: f64) -> DVec3 {
        let r = if self.gaussian { (-0.5 * (-u).ln_1p()).sqrt() } else { u.sqrt() };
        let (x, y) = warp::frame(self.d);
        let (s, c) = (TAU * v).sin_cos();
        self.p + (x * c + y * s) * (r * self.radius)
    }

    /// `ġ`.
    fn motion(&self, cx: &Context, q: DVec3, point: &Point, watch: &Watch) -> Partials {
        let mut p = Partials::default();
        p.push(Partial { slot: self.place.position, v: -self.d, len: 3 });
        p.push(Partial { slot: self.place.direction, v: q - self.p, len: 3 });
        ends::motion(cx, point, watch, self.d, &mut p);
        p
    }

    /// Where a camera line crosses the disk; it is drawn outward with this probability.
    pub fn along(&self, cx: &mut Context, film: [f64; 2], probability: f64, emit: &mut dyn FnMut(&Sample)) {
        sheet_samples::along(cx, film, |cx, spans, span| {
            let Some((_, before)) = spans.split_last().filter(|_| cx.set.min_order <= 1) else { return };
            let slope = span.w.dot(self.d);
            let t = (self.p - span.o).dot(self.d) / slope;
            if !(t > span.t0 && t < span.t1) {
                return;
            }
            let scene = cx.scene;
            let q = span.o + span.w * t;
            let m = &scene.media[span.medium as usize];
            let light = self.irradiance(scene, q) * m.coefficients(q).1;
            let Some(seen) = cx.sensor.project(q).filter(|_| !light.is_zero()) else { return };
            let part = span.until(t);
            let transmittance = before.iter().chain([&part]).fold(Rgb::ONE, |t, s| t * transmit::one_span(scene, s));
            let f = m.phase.eval(one_minus_cos(span.w, -self.d));
            let (point, watch) = sheet_samples::crossed(cx, span, t);
            emit(&Sample {
                film: seen.film,
                flux: transmittance * light * (f * seen.pixels_per_area),
                partials: self.motion(cx, q, &point, &watch).as_slice(),
                film_per_sheet: seen.pixels_per_area * slope.abs(),
                outward: probability * self.density(q),
            });
        });
    }

    /// From a point of the disk, chosen with this probability.
    pub fn outward(
        &self,
        cx: &mut Context,
        (reach, probability): (&Reach, f64),
        (u, lead): (f64, &[f64]),
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let scene = cx.scene;
        let q = self.sample(lead[0], u);
        let Some(id) = scene.medium_past(q, self.d, &[], &cx.around) else { return };
        let flux = self.irradiance(scene, q) * scene.media[id as usize].coefficients(q).1;
        let density = probability * self.density(q);
        if flux.is_zero() || density == 0.0 {
            return;
        }
        let z = Vertex { p: q, w: self.d, medium: Some(id), hit: None };
        let own = |cx: &Context, point: &Point, watch: &Watch| self.motion(cx, q, point, watch);
        sheet_samples::straight(cx, &z, flux, (Some(self.d), density), &own, emit);
        if cx.set.max_depth > 2 {
            sheet_samples::further(cx, reach, z, flux / density, &own, &lead[1..], rng, emit);
        }
    }
}
