//! Which light to connect to, and how: selection, and area lights, which need their shape.

use super::{Hit, Scene};
use crate::light::{Arrival, LightKind};
use crate::math::discrete::Discrete;
use crate::math::{DVec2, DVec3, Rgb};
use crate::shape::{Geometry, Shape};

/// Share of the selection that ignores power: a light that is off can still be differentiated.
const UNIFORM_SHARE: f64 = 0.25;

/// Up to so many lights at infinity are weighed at every vertex.
const DISTANT: usize = 4;

/// `UNIFORM_SHARE` of that choice.
const UNIFORM_SHARE_DISTANT: f64 = 0.2;

/// Size of a lamp over that of its scene up to which it counts as one with a position.
const SMALL_LAMP: f64 = 0.5;

/// Weight there of an environment's mean radiance against the irradiance of a light without extent times what is scattered toward it: an
/// environment is found by drawn directions, too, and needs the connection less.
const ENVIRONMENT: f64 = 0.5;

impl Scene {
    /// Fill the selection tables; call when lights and bounds are known.
    pub fn prepare_lights(&mut self, named: &[Option<usize>]) {
        let power = self.light_power();
        let table = |wanted: &dyn Fn(usize) -> bool| {
            let n = (0..self.lights.len()).filter(|&i| wanted(i)).count() as f64;
            let total: f64 = (0..self.lights.len()).filter(|&i| wanted(i)).map(|i| power[i]).sum();
            Discrete::new((0..self.lights.len()).map(|i| match (wanted(i), total > 0.0) {
                (false, _) => 0.0,
                (true, true) => UNIFORM_SHARE / n + (1.0 - UNIFORM_SHARE) * power[i] / total,
                (true, false) => 1.0 / n,
            }))
        };
        let selection = table(&|i| self.lights[i].wants_connection());
        let local = table(&|i| self.pole(i as u32).is_some());
        let around = self.around(self.sensors.first());
        let any = !self.media.is_empty();
        let within = |p: DVec3| any && self.medium_past(p, DVec3::new(0.36, 0.48, 0.8), &[], &around).is_some();
        let embedded = table(&|i| self.lights[i].center().is_some_and(|p| named[i].is_some() || within(p)));
        let connected: Vec<u32> =
            (0..self.lights.len()).filter(|&i| self.lights[i].wants_connection()).map(|i| i as u32).collect();
        let few = (2..=DISTANT).contains(&connected.len());
        let distant = few && connected.iter().all(|&i| self.lights[i as usize].distant_strength().is_some());
        self.distant = if distant { connected } else { Vec::new() };
        self.selection = selection;
        self.embedded = embedded;
        self.local = local;
    }

    /// Tell the media that lie in closed shapes of glass, as milk in a bottle: every way out of them turns, so that no connection to a light at infinity can succeed. Not those
    /// that a camera stands in: its medium may be outside as well.
    pub(super) fn prepare_shelters(&mut self) {
        // With its front outside, so that its interior is within.
        let outward = |s: &Shape| match s {
            Shape::Sphere(_) | Shape::Cube(_) => (0..s.face_count()).all(|f| {
                let p = s.position(f, DVec2::new(0.3, 0.6));
                (p - s.bounds().center()).dot(s.normal(f, p)) > 0.0
            }),
            Shape::Mesh(m) => m.topology().is_consistently_oriented() && !m.topology().is_inside_out(),
            _ => false,
        };
        let closed = |s: &super::Instance| s.shape.is_closed() && outward(&s.shape) && !self.is_null(s);
        let sheltered = |m: u32| {
            let mut walls =
                self.shapes.iter().filter(|s| s.boundary && [s.interior, s.exterior].contains(&Some(m))).peekable();
            let seen_from = self.sensors.iter().any(|s| s.medium == Some(m));
            !seen_from
                && walls.peek().is_some()
                && walls.all(|s| s.interior == Some(m) && s.exterior != Some(m) && closed(s))
        };
        self.sheltered = (0..self.media.len() as u32).map(sheltered).collect();
        let shines = |l: &crate::light::Light| matches!(l.kind, LightKind::Area { .. });
        self.shines_within = self.lights.iter().any(shines) || self.media.iter().any(|m| m.emission.is_some());
    }

    /// Whether a ray in this medium is known to see no light before it is turned once more.
    pub fn is_dark(&self, medium: Option<u32>) -> bool {
        !self.shines_within && medium.is_some_and(|m| self.sheltered[m as usize])
    }

    /// Whether a connection from a point of the medium to the light is known to fail.
    pub fn shelters_from(&self, medium: u32, light: u32) -> bool {
        self.sheltered[medium as usize] && self.lights[light as usize].is_at_infinity()
    }

    /// Whether that is so of all lights.
    pub fn shelters_from_all(&self, medium: u32) -> bool {
        self.sheltered[medium as usize] && self.lights.iter().all(|l| l.is_at_infinity() || !l.wants_connection())
    }

    /// What every light gives, roughly: power in the units of radiance x area.
    pub(super) fn light_power(&self) -> Vec<f64> {
        let radius = self.bounds.radius();
        let area = |l: &crate::light::Light| match l.kind {
            LightKind::Area { shape } => self.shapes[shape as usize].shape.area(),
            _ => 0.0,
        };
        self.lights.iter().map(|l| l.rough_power(area(l), radius)).collect()
    }

    /// The largest radiance that anything emits; what lights without a surface give at the scene's size.
    pub fn brightest(&self) -> f64 {
        let radius = self.bounds.radius().max(f64::MIN_POSITIVE);
        let light = |l: &crate::light::Light| match &l.kind {
            LightKind::Area { .. } | LightKind::Constant => l.value.max(),
            LightKind::Envmap(e) => l.value.max() * e.brightest(),
            LightKind::Directional { .. } | LightKind::Beam { .. } => l.value.max(),
            LightKind::Point { .. } | LightKind::Spot { .. } => l.value.max() / (radius * radius),
        };
        let media = self.media.iter().filter_map(|m| m.emission.as_ref()).map(|e| e.brightest());
        let b = self.lights.iter().map(light).chain(media).fold(0.0, f64::max);
        if b.is_finite() { b } else { 0.0 }
    }

    /// A light for a connection, its probability, and that of the environment. `toward` is what a vertex scatters toward a direction, per solid
    /// angle, integral about 1. Where all lights are at infinity they are drawn by what they give without the transmittance.
    pub fn select_light(&self, u: f64, toward: impl Fn(DVec3) -> f64) -> Option<(u32, f64, f64)> {
        let environment = self.environment.unwrap_or(u32::MAX);
        if self.distant.is_empty() {
            let (id, p) = select(&self.selection, u)?;
            return Some((id, p, self.environment.map_or(0.0, |e| self.selection(e))));
        }
        let n = self.distant.len();
        let mut weight = [0.0; DISTANT];
        for (w, &id) in weight.iter_mut().zip(&self.distant) {
            let light = &self.lights[id as usize];
            let seen = light.single_direction().map_or(ENVIRONMENT, &toward);
            *w = light.distant_strength().unwrap_or(0.0) * seen;
        }
        let total: f64 = weight.iter().sum();
        let share = if total > 0.0 { UNIFORM_SHARE_DISTANT } else { 1.0 };
        let p = |k: usize| share / n as f64 + if total > 0.0 { (1.0 - share) * weight[k] / total } else { 0.0 };
        let (mut chosen, mut below) = (n - 1, 0.0);
        for k in 0..n {
            below += p(k);
            if u < below {
                chosen = k;
                break;
            }
        }
        let at = self.distant.iter().position(|&id| id == environment);
        Some((self.distant[chosen], p(chosen), at.map_or(0.0, p)))
    }

    /// Probability that a connection goes to light `id`.
    pub fn selection(&self, id: u32) -> f64 {
        if self.selection.total > 0.0 { self.selection.probability(id as usize) } else { 0.0 }
    }

    /// What distances are drawn around by their angle: a light's position, or, where media are, the middle of a lamp that is small in its scene.
    pub fn pole(&self, id: u32) -> Option<DVec3> {
        let light = &self.lights[id as usize];
        let LightKind::Area { shape } = light.kind else { return light.center() };
        let bounds = self.shapes[shape as usize].shape.bounds();
        let small = bounds.radius() <= SMALL_LAMP * self.bounds.radius();
        (small && !self.media.is_empty()).then(|| bounds.center())
    }

    /// A light with a position, for the equi-angular connection.
    pub fn select_local_light(&self, u: f64) -> Option<(u32, f64)> {
        select(&self.local, u)
    }

    pub fn local_selection(&self, id: u32) -> f64 {
        if self.local.total > 0.0 { self.local.probability(id as usize) } else { 0.0 }
    }

    /// A light that stands in a medium, for the light-centred connection.
    pub fn select_embedded_light(&self, u: f64) -> Option<(u32, f64)> {
        select(&self.embedded, u)
    }

    pub fn embedded_selection(&self, id: u32) -> f64 {
        if self.embedded.total > 0.0 { self.embedded.probability(id as usize) } else { 0.0 }
    }

    /// Whether the light is a spot with a hard edge that stands in a medium and lights more than what cameras see at once: the medium follows it.
    pub fn has_hard_edge_inside(&self, id: u32) -> bool {
        let hard = matches!(self.lights[id as usize].kind, LightKind::Spot { beam, cutoff, .. } if beam >= cutoff);
        hard && self.embedded_selection(id) > 0.0 && self.settings.max_depth > 2
    }

    pub fn has_embedded_lights(&self) -> bool {
        self.embedded.total > 0.0
    }

    pub fn has_local_lights(&self) -> bool {
        self.local.total > 0.0
    }

    /// Whether anything competes with the free flight, whose density must then be known.
    pub fn weighs_flights(&self) -> bool {
        self.has_local_lights() || self.has_embedded_lights() || self.has_beams()
    }

    /// Whether connections draw points of their own on every span of a medium.
    pub fn draws_on_spans(&self) -> bool {
        self.has_local_lights() || self.has_beams()
    }

    /// Whether the cells of fine grids need not be crossed by camera lines: nothing competes with their collisions, and nothing glows on them.
    pub fn flies_lines(&self) -> bool {
        !self.weighs_flights() && self.media.iter().all(|m| m.emission.is_none())
    }

    pub fn has_beams(&self) -> bool {
        !self.beams.ways.is_empty()
    }

    /// Light from `id` at `p`; area lights are sampled here.
    pub fn arrival(&self, id: u32, p: DVec3, u: f64, v: f64) -> Option<Arrival> {
        let light = &self.lights[id as usize];
        let LightKind::Area { shape } = light.kind else { return light.sample(p, u, v) };
        let instance = &self.shapes[shape as usize].shape;
        if let Shape::Sphere(s) = instance {
            // A cone toward the sphere from outside; from inside, by area.
            if let Some(d) = s.sample_direction(p, u, v) {
                return Some(Arrival {
                    w: d.w,
                    distance: d.distance,
                    factor: 1.0 / d.pdf_solid_angle,
                    emission: light.emission(Rgb::ONE),
                    pdf: d.pdf_solid_angle,
                    target: Some((shape, 0)),
                    n: d.n,
                });
            }
        }
        let q = instance.sample(u, v);
        let d = q.p - p;
        let r2 = d.length_squared();
        let r = r2.sqrt();
        let w = d / r;
        let cos = -q.n.dot(w);
        if cos <= 0.0 || r2 == 0.0 {
            return None;
        }
        let pdf = q.pdf_area * r2 / cos;
        let emission = light.emission(Rgb::ONE);
        Some(Arrival { w, distance: r, factor: 1.0 / pdf, emission, pdf, target: Some((shape, q.face)), n: q.n })
    }

    /// Density per solid angle at `from` of drawing the direction `w` that met `hit` on the area light `id`.
    pub fn area_pdf(&self, id: u32, from: DVec3, w: DVec3, hit: &Hit) -> f64 {
        let LightKind::Area { shape } = self.lights[id as usize].kind else { return 0.0 };
        let instance = &self.shapes[shape as usize].shape;
        if let Shape::Sphere(s) = instance {
            return s.pdf_direction(from, hit.p);
        }
        let cos = -hit.n.dot(w);
        if cos <= 0.0 { 0.0 } else { (hit.p - from).length_squared() / (cos * instance.area()) }
    }

    /// Whether the path goes on at this surface.
    pub fn reflects(&self, hit: &Hit) -> bool {
        match self.surface_of(hit.shape) {
            crate::surface::Surface::Diffuse { reflectance, .. } => !reflectance.is_zero(),
            _ => true,
        }
    }
}

fn select(table: &Discrete, u: f64) -> Option<(u32, f64)> {
    if table.total <= 0.0 {
        return None;
    }
    let (i, p, _) = table.sample(u);
    Some((i as u32, p))
}
