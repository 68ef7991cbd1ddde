//! What scatters from a point of a sheet reaches the picture: straight to the camera, through a vertex on a camera ray, and
//! through further scatterings of a walk away from the light.
//!
//! Estimates the incident importances `P^p`, `P^s` of [T] (36). From each vertex z two techniques make the path z, y, camera with y in a medium:
//! (a) the walk scatters at y and connects it to the camera, with a pole at the camera; (b) y is drawn on a random camera ray by the angle
//! that it subtends at z, with a pole at z; directions of (a) are drawn toward where the camera sees z by rough glass, too ([`super::frosted`]). The balance heuristic of both bounds both [T] (63).

use super::ends::{ByOrder, Point, Watch};
use super::frosted::{self, Frosted};
use super::sheet::{Partials, Reach};
use super::{Context, Sample};
use crate::light::{Arrival, Emission};
use crate::math::equiangular::EquiAngular;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb, warp};
use crate::phase::one_minus_cos;
use crate::scene::critical::Critical;
use crate::scene::{Hit, March, On, Scene};
use crate::sensor::Projected;
use crate::surface::Surface;
use crate::transport::first::Seen;
use crate::transport::record::{MediumSpan, NoRecord};
use crate::transport::state::State;
use crate::transport::tracking;
use crate::transport::transmit;
use crate::transport::walk::Walker;
use smallvec::SmallVec;
use std::f64::consts::PI;

/// Where something arrives along `w` and scatters.
#[derive(Clone, Copy, Debug)]
pub struct Vertex {
    pub p: DVec3,
    /// Direction of travel on arrival, away from the light.
    pub w: DVec3,
    pub medium: Option<u32>,
    /// On a surface, or in the medium.
    pub hit: Option<Hit>,
}

impl Vertex {
    /// Faces that a ray along `d` begins on, and the medium there: a rough interface sends light through, too.
    fn start(&self, scene: &Scene, d: DVec3) -> (On, Option<u32>) {
        let Some(h) = &self.hit else { return (On::default(), self.medium) };
        let through = h.n.dot(d) * h.n.dot(self.w) > 0.0;
        let behind = || scene.shapes[h.shape as usize].medium_behind(self.w, h.n, self.medium);
        (On::at(h), if through { behind() } else { self.medium })
    }

    /// Scattering toward `d` per solid angle of d, cosines of both sides included (importance: the light's side counts by the shading
    /// normal, as on a path from the camera, everything else by the geometric one). Without the medium's σ_s.
    pub fn scatter(&self, scene: &Scene, d: DVec3) -> Rgb {
        match &self.hit {
            None => {
                let Some(id) = self.medium else { return Rgb::ZERO };
                Rgb::splat(scene.media[id as usize].phase.eval(one_minus_cos(self.w, d)))
            }
            Some(h) => {
                let (surface, l) = (scene.surface_of(h.shape), -self.w);
                let (cl, cd) = (h.n.dot(l), h.n.dot(d));
                match surface {
                    Surface::Diffuse { reflectance, .. } if cl * cd > 0.0 => {
                        *reflectance * (surface.eval_unit(h.ns, d, l) * (cd / cl))
                    }
                    Surface::Rough(rough) if cl != 0.0 => {
                        let lobe = rough.eval(h.normals(), d, l);
                        lobe.tint * (lobe.f * (cd / cl).abs())
                    }
                    _ => Rgb::ZERO,
                }
            }
        }
    }

    /// The way from here to the camera by rough glass, if light may leave along it.
    fn frosted(&self, cx: &Context) -> Option<Frosted> {
        if cx.frosted.is_empty() {
            return None;
        }
        let leaves = |f: &Frosted| match &self.hit {
            Some(h) => {
                h.n.dot(self.w) * h.n.dot(f.w) < 0.0 && !matches!(cx.scene.surface_of(h.shape), Surface::Rough(_))
            }
            None => true,
        };
        let past: SmallVec<[_; 1]> = self.hit.iter().map(|h| (h.shape, vec![h.face])).collect();
        Frosted::of(cx, self.p, &past).filter(leaves)
    }

    /// A direction to go on in, with `scatter / density`, and the density per solid angle; a share of them beside the way by rough glass, if there is one.
    fn sample(&self, scene: &Scene, frosted: Option<&Frosted>, rng: &mut Rng) -> Option<(DVec3, Rgb, f64)> {
        let aims = frosted.filter(|_| rng.uniform() < frosted::SHARE);
        let (u, v) = (rng.uniform(), rng.uniform());
        let d = match (aims, &self.hit) {
            (Some(f), _) => f.sample(u, v),
            (None, None) => {
                let (d, m) = scene.media[self.medium? as usize].phase.sample(self.w, u, v);
                if frosted.is_none() {
                    return Some((d, Rgb::ONE, scene.media[self.medium? as usize].phase.eval(m)));
                }
                d
            }
            (None, Some(h)) => match scene.surface_of(h.shape) {
                Surface::Rough(rough) => rough.sample(h.normals(), -self.w, u, v, rng.uniform())?,
                _ => {
                    let side = if h.n.dot(self.w) < 0.0 { h.n } else { -h.n };
                    warp::to_world(side, warp::cosine_hemisphere(u, v)).normalize()
                }
            },
        };
        let density = self.density(scene, frosted, d);
        (density > 0.0).then(|| (d, self.scatter(scene, d) / density, density))
    }

    /// Density per solid angle with which [`Vertex::sample`] draws a direction.
    fn density(&self, scene: &Scene, frosted: Option<&Frosted>, d: DVec3) -> f64 {
        let own = self.own_density(scene, d);
        frosted.map_or(own, |f| own + frosted::SHARE * (f.density(d) - own))
    }

    fn own_density(&self, scene: &Scene, d: DVec3) -> f64 {
        match &self.hit {
            None => self.medium.map_or(0.0, |id| scene.media[id as usize].phase.eval(one_minus_cos(self.w, d))),
            Some(h) => match scene.surface_of(h.shape) {
                Surface::Rough(rough) => rough.eval(h.normals(), -self.w, d).pdf,
                _ => {
                    let side = if h.n.dot(self.w) < 0.0 { h.n } else { -h.n };
                    side.dot(d).max(0.0) / PI
                }
            },
        }
    }
}

/// Transmittance of the clear way from `p` along `w`; `None` where something stands in it.
pub fn clear(cx: &mut Context, p: DVec3, w: DVec3, distance: f64, medium: Option<u32>, on: &On) -> Option<Rgb> {
    let emission = Emission { first: crate::medium::NO_SLOT, per_channel: true, unit: Rgb::ONE, value: Rgb::ONE };
    let a = Arrival { w, distance, factor: 1.0, emission, pdf: 0.0, target: None, n: DVec3::ZERO };
    let mut rec = NoRecord;
    let mut walker = Walker::new(cx.scene, cx.set, &mut rec);
    let t = transmit::shadow(&mut walker, medium, p, on, &a, None);
    cx.tally.missed_boundary += walker.tally.missed_boundary;
    t.map(|t| t.transmittance)
}

/// `scatter x film area x transmittance` of a vertex seen by the camera.
pub fn seen(cx: &mut Context, z: &Vertex, q: &Projected) -> Option<Rgb> {
    let f = z.scatter(cx.scene, -q.w) * q.pixels_per_area;
    if f.is_zero() {
        return None;
    }
    let (on, medium) = z.start(cx.scene, -q.w);
    Some(f * clear(cx, z.p, -q.w, q.distance, medium, &on)?)
}

/// The walk and its connections.
pub struct LightWalk<'a> {
    pub reach: &'a Reach,
    /// How a sample depends on slots, given the camera's first vertex.
    pub motion: &'a dyn Fn(&Context, &Watch) -> Partials,
    /// What starts the walk with weight 1, by the scatterings that it has behind it.
    pub source: &'a ByOrder,
}

impl LightWalk<'_> {
    /// Everything that `weight` at the vertex brings to the picture, its own direct way to the camera excepted. Scatterings so far: 1.
    /// `lead`: film point and distance of the start's camera ray, as far as they are given.
    pub fn run(
        &self,
        cx: &mut Context,
        z: Vertex,
        weight: Rgb,
        lead: &[f64],
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let (scene, set) = (cx.scene, cx.set);
        let mut z = z;
        let mut s = State::new(*rng, z.p, z.w, z.medium);
        s.beta = weight;
        s.start = weight.abs().max();
        s.depth = 1;
        if s.start == 0.0 || !s.start.is_finite() {
            cx.tally.nonfinite += u64::from(!s.start.is_finite());
            return;
        }
        while s.depth + 1 < set.max_depth {
            s.steps += 1;
            if s.steps > set.cap {
                cx.tally.capped += 1;
                break;
            }
            let shown = self.source.shown(set, s.depth + 1);
            let frosted = z.frosted(cx);
            let departure = (&z, frosted.as_ref());
            if !shown.is_zero() {
                let start = s.depth == 1;
                let lead = if start { lead } else { &[] };
                self.through_a_camera_ray(cx, departure, start, s.beta / s.r.mean() * shown, lead, &mut s.rng, emit);
            }
            let Some((w, f, density)) = z.sample(scene, frosted.as_ref(), &mut s.rng) else { break };
            s.beta *= f;
            // Roulette must not take away the directions that were wanted.
            if frosted.is_some() {
                s.start *= Critical::hidden(z.own_density(scene, w), density);
            }
            if self.roulette(&mut s, set.rr_depth) {
                break;
            }
            (s.o, s.w) = (z.p, w);
            (s.on, s.medium) = z.start(scene, w);
            let from = z.p;
            let Some((next, flight)) = fly(cx, &mut s) else { break };
            s.depth += 1;
            // Straight to the camera.
            let shown = self.source.shown(set, s.depth);
            if let Some(q) = cx.sensor.project(next.p).filter(|q| !shown.is_zero() && cx.on_film(q.film)) {
                let share = match flight {
                    Some(flight) => {
                        let a = density * flight / (next.p - from).length_squared();
                        let b = self.camera_ray_density(cx, from, &q);
                        if a + b > 0.0 { a / (a + b) } else { 1.0 }
                    }
                    None => 1.0,
                };
                if let Some(f) = seen(cx, &next, &q) {
                    let point = next.hit.map_or(Point::Medium(next.p), Point::Surface);
                    let watch = Watch::by_way(cx, &q, &point, second(&z, s.depth == 2).as_ref());
                    self.emit(cx, q.film, s.beta / s.r.mean() * shown * f * share, &watch, emit);
                }
            }
            z = next;
        }
        *rng = s.rng;
    }

    fn emit(&self, cx: &Context, film: [f64; 2], flux: Rgb, watch: &Watch, emit: &mut dyn FnMut(&Sample)) {
        let partials = (self.motion)(cx, watch);
        emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 0.0, outward: 1.0 });
    }

    /// True where the walk ends. As on camera paths: from a fifth of the start weight on.
    fn roulette(&self, s: &mut State, rr_depth: u32) -> bool {
        const BEGIN: f64 = 0.2;
        let weight = (s.beta / s.r.mean()).abs().max();
        if weight == 0.0 {
            return true;
        }
        let q = weight / (BEGIN * s.start);
        if s.depth < rr_depth || q >= 1.0 {
            return false;
        }
        s.beta *= 1.0 / q;
        s.rng.uniform() >= q
    }

    /// Density per volume of technique (b) at the point that `q` projects, for a walk vertex at `z`.
    fn camera_ray_density(&self, cx: &Context, z: DVec3, q: &Projected) -> f64 {
        let Some((lo, hi)) = self.reach.clip(q.o, q.w, 0.0, f64::INFINITY) else { return 0.0 };
        let t = EquiAngular::new(z, q.o, q.w, lo, hi);
        if !t.usable() || q.distance < lo || q.distance > hi {
            return 0.0;
        }
        let size = cx.film_size();
        q.pixels_per_area / (size[0] * size[1]) * t.density(q.distance)
    }

    /// Technique (b). `start`: the walk's own start is connected.
    fn through_a_camera_ray(
        &self,
        cx: &mut Context,
        (z, frosted): (&Vertex, Option<&Frosted>),
        start: bool,
        weight: Rgb,
        lead: &[f64],
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let scene = cx.scene;
        if scene.media.is_empty() {
            return;
        }
        let size = cx.film_size();
        let mut lead = lead.iter();
        let [x, y, u] = std::array::from_fn(|_| lead.next().copied().unwrap_or_else(|| rng.uniform()));
        let film = [x * size[0] - cx.margin, y * size[1] - cx.margin];
        let (o, w) = cx.sensor.ray(film[0], film[1]);
        let Some((lo, hi)) = self.reach.clip(o, w, 0.0, f64::INFINITY) else { return };
        let distances = EquiAngular::new(z.p, o, w, lo, hi);
        if !distances.usable() {
            return;
        }
        let t = distances.sample(u);
        let y = o + w * t;
        let Some(q) = cx.sensor.project(y) else { return };
        let to_z = z.p - y;
        let d = to_z.length();
        if d.is_nan() || d <= 0.0 {
            return;
        }
        let dz = to_z / d;
        let f = z.scatter(scene, -dz);
        if f.is_zero() {
            return;
        }
        let Some((span, transmittance)) = camera_span(cx, o, w, t) else { return };
        let m = &scene.media[span.medium as usize];
        let sigma_s = m.coefficients(y).1;
        if sigma_s.is_zero() {
            return;
        }
        let per_volume = q.pixels_per_area / (size[0] * size[1]) * distances.density(t);
        let Some(way) = clear(cx, y, dz, d, Some(span.medium), &On::default()) else { return };
        let a = self.walk_density(cx, (z, frosted), -dz, d);
        // Film area cancels against the density of the film point.
        let phase = m.phase.eval(one_minus_cos(w, dz));
        let flux =
            weight * f * sigma_s * transmittance * way * (phase * q.pixels_per_area / (d * d) / (per_volume + a));
        let watch = Watch::new(cx, Some(Seen::Medium { p: y, span }), second(z, start).as_ref());
        self.emit(cx, film, flux, &watch, emit);
    }

    /// Density per volume of technique (a) at the distance `d` along `w` from a vertex.
    fn walk_density(&self, cx: &Context, (z, frosted): (&Vertex, Option<&Frosted>), w: DVec3, d: f64) -> f64 {
        let medium = z.start(cx.scene, w).1;
        z.density(cx.scene, frosted, w) * flight_density(cx, z.p, medium, w, d) / (d * d)
    }
}

/// A walk's vertex as the second one of the camera's path; its start is where motion is asked for.
fn second(z: &Vertex, start: bool) -> Option<Point> {
    (!start).then(|| z.hit.map_or(Point::Medium(z.p), Point::Surface))
}

/// The medium span of a camera ray that holds the abscissa `t`, and the transmittance up to there.
fn camera_span(cx: &mut Context, o: DVec3, w: DVec3, t: f64) -> Option<(MediumSpan, Rgb)> {
    let scene = cx.scene;
    let mut ray = March::new(o, w, On::default(), cx.sensor.medium);
    let mut transmittance = Rgb::ONE;
    for _ in 0..scene.max_interfaces {
        let hit = ray.meets(scene, f64::INFINITY);
        let t1 = hit.as_ref().map_or(f64::INFINITY, |h| h.t);
        let left = ray.left(t);
        let holds = t1 >= left;
        if !holds && hit.is_none_or(|h| !scene.passes(&h)) {
            return None;
        }
        let whole = MediumSpan::ahead(&ray, f64::INFINITY, hit.as_ref());
        if let Some(span) = &whole {
            transmittance *= transmit::one_span(scene, &span.until(if holds { left } else { t1 }));
        }
        if holds {
            return whole.map(|whole| (whole, transmittance));
        }
        ray.pass(scene, &hit?);
    }
    cx.tally.missed_boundary += 1;
    None
}

/// A stand-in for the density per length of a collision at the distance `d`: that of the vertex's own medium, for weights only.
/// It has to be the same function whichever technique asks, so it looks at nothing but vertex, medium, direction and distance.
fn flight_density(cx: &Context, z: DVec3, medium: Option<u32>, w: DVec3, d: f64) -> f64 {
    let scene = cx.scene;
    let medium = medium.or_else(|| (0..scene.media.len() as u32).next());
    let Some(id) = medium else { return 0.0 };
    let span = MediumSpan::new(id, z, w, f64::INFINITY, &On::default(), None);
    let m = &scene.media[id as usize];
    match m.density_grid() {
        Some(g) => {
            let (lo, hi) = g.clip_ray(span.o, span.w, 0.0, f64::INFINITY);
            if hi > lo && hi < f64::INFINITY { 1.0 / (hi - lo) } else { 1.0 / (1.0 + d) }
        }
        None => tracking::flight_density(m, &span, d),
    }
}

/// To the next collision or reflecting surface, with the stand-in density of a collision; weights in `s`.
fn fly(cx: &mut Context, s: &mut State) -> Option<(Vertex, Option<f64>)> {
    let scene = cx.scene;
    let (z, medium) = (s.o, s.medium);
    let mut before = 0.0;
    for _ in 0..scene.max_interfaces {
        let hit = scene.intersect(s.o, s.w, f64::INFINITY, &s.on, s.medium);
        if let Some(id) = s.medium {
            let t1 = hit.as_ref().map_or(f64::INFINITY, |h| h.t);
            let span = MediumSpan::new(id, s.o, s.w, t1, &s.on, hit.as_ref());
            if let Some(t) = tracking::fly(&scene.media[id as usize], &span, s) {
                let p = s.o + s.w * t;
                let density = flight_density(cx, z, medium, s.w, before + t);
                return Some((Vertex { p, w: s.w, medium: Some(id), hit: None }, Some(density)));
            }
        }
        let h = hit?;
        if !scene.passes(&h) {
            let surface = scene.surface_of(h.shape);
            let vertex = Vertex { p: h.p, w: s.w, medium: s.medium, hit: Some(h) };
            // Beyond smooth surfaces is `virtual_edge`'s.
            return (surface.reflects(h.ns, -s.w) && !surface.is_smooth()).then_some((vertex, None));
        }
        s.pass(scene, &h);
        before += h.t;
    }
    cx.tally.missed_boundary += 1;
    None
}
