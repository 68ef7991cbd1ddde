//! Where a collimated beam begins inside a medium: the disk across its axis before which nothing is lit. Of term H of [T] section 3, the part that a beam of any profile has.
//!
//! With `g = <q - p, d>` there is light where g > 0, and at a point q that moves with q̇ `ġ = <d, q̇ - ṗ> + <q - p, ḋ>`. The disk adds ġ times the irradiance there times what its points scatter.

use super::ends::{self, Point, Watch};
use super::light_walk::Vertex;
use super::sheet::{Partials, Reach, media_box};
use super::sheet_samples;
use super::{Context, Motion, Sample};
use crate::error::{Error, Result};
use crate::light::{Light, LightKind, Place, beam_profile};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb, warp};
use crate::params::Partial;
use crate::phase::one_minus_cos;
use crate::scene::beams::FAINT;
use crate::scene::{Around, Instance, Scene};
use crate::shape::Shape;
use crate::shape::triangles::triangles;
use crate::transport::record::MediumSpan;
use crate::transport::transmit;
use std::f64::consts::{PI, TAU};

/// Before the disk, in scene radii: where the medium has to be the same. One that ends there has its own jump, of which the light's is a part (term N).
const BEFORE: f64 = 1e-6;

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
    pub fn new(light: u32, l: &Light) -> Option<BeamStart> {
        let LightKind::Beam { position: p, direction: d, radius, gaussian } = l.kind else { return None };
        Some(BeamStart { light, p, d, radius, gaussian, place: l.place })
    }

    pub fn light(&self) -> u32 {
        self.light
    }

    /// Of all beams that may begin inside a medium, where nothing mirrors or refracts ([`super::interfaces`]).
    pub fn all(scene: &Scene, motion: &Motion) -> Vec<BeamStart> {
        if scene.media.is_empty() || scene.has_smooth() || !motion.surfaces() {
            return Vec::new();
        }
        let media = media_box(scene);
        let inside = |b: &BeamStart| media.is_none_or(|m| m.distance(b.p) <= b.reach());
        (0..).zip(&scene.lights).filter_map(|(id, l)| BeamStart::new(id, l)).filter(inside).collect()
    }

    /// The disk's radius.
    fn reach(&self) -> f64 {
        self.radius * if self.gaussian { FAINT } else { 1.0 }
    }

    /// An error where something opaque crosses the disk: light on it would begin there, or its shadow.
    pub fn check(&self, scene: &Scene) -> Result<()> {
        let slack = ends::contact(scene);
        let Some(shape) = scene.shapes.iter().find(|s| !scene.is_null(s) && self.is_crossed(&s.shape, slack)) else {
            return Ok(());
        };
        let (light, name) = (&scene.lights[self.light as usize].name, &shape.name);
        let what = format!(
            "`{name}` stands in the disk where the beam `{light}` begins: how light and shadow begin there cannot be told yet"
        );
        Err(Error::scene(&shape.span, what, "let the beam begin a little further on, or make it narrower"))
    }

    /// Whether any of the disk may lie in a medium: its middle does, or a border of one crosses it.
    pub fn is_in_medium(&self, scene: &Scene, around: &Around) -> bool {
        let slack = ends::contact(scene);
        let crosses = |s: &Instance| s.boundary && scene.is_null(s) && self.is_crossed(&s.shape, slack);
        scene.medium_past(self.p, self.d, &[], around).is_some() || scene.shapes.iter().any(crosses)
    }

    /// Whether a shape comes through the disk. One that lies in its plane, or touches that, does not.
    fn is_crossed(&self, shape: &Shape, slack: f64) -> bool {
        let height = |x: DVec3| (x - self.p).dot(self.d);
        if let Shape::Sphere(s) = shape {
            let h = height(s.center);
            let circle = (s.radius - h.abs()) * (s.radius + h.abs());
            let far = (s.center - self.d * h - self.p).length();
            return s.radius - h.abs() > slack && (far - circle.max(0.0).sqrt()).abs() <= self.reach();
        }
        let crosses = |t: &[DVec3; 3]| {
            let heights = t.map(height);
            if !(heights.iter().any(|&h| h > slack) && heights.iter().any(|&h| h < -slack)) {
                return false;
            }
            // The ends of what the plane cuts out of the triangle.
            let ends: Vec<DVec3> = (0..3)
                .filter_map(|k| {
                    let (i, j) = (k, (k + 1) % 3);
                    let (a, b) = (heights[i], heights[j]);
                    ((a > 0.0) != (b > 0.0)).then(|| t[i].lerp(t[j], a / (a - b)) - self.p)
                })
                .collect();
            let [a, b] = ends[..] else { return false };
            let along = b - a;
            let nearest = if along == DVec3::ZERO { 0.0 } else { -a.dot(along) / along.length_squared() };
            (a + along * nearest.clamp(0.0, 1.0)).length() <= self.reach()
        };
        triangles(shape).iter().any(|(_, t)| crosses(t))
    }

    /// The medium at a point of the disk, where it is before it, too.
    fn medium(&self, cx: &Context, q: DVec3) -> Option<u32> {
        let at = |q: DVec3| cx.scene.medium_past(q, self.d, &[], &cx.around);
        at(q).filter(|&m| at(q - self.d * (BEFORE * cx.scene.bounds.radius())) == Some(m))
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

    /// Where the last of a camera line's `spans` crosses the disk, which is drawn from with this probability.
    pub fn cross(&self, cx: &mut Context, spans: &[MediumSpan], probability: f64, emit: &mut dyn FnMut(&Sample)) {
        let Some((span, before)) = spans.split_last().filter(|_| cx.set.min_order <= 1) else { return };
        let slope = span.w.dot(self.d);
        let t = (self.p - span.o).dot(self.d) / slope;
        if !(t > span.t0 && t < span.t1) {
            return;
        }
        let scene = cx.scene;
        let q = span.o + span.w * t;
        let m = &scene.media[span.medium as usize];
        let light = self.irradiance(scene, q) * m.coefficients(q).1;
        if light.is_zero() || self.medium(cx, q) != Some(span.medium) {
            return;
        }
        let Some(seen) = cx.sensor.project(q) else { return };
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
        let Some(id) = self.medium(cx, q) else { return };
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
