//! Where sheets of light by way of flat faces, or of a ball of metal ([`super::cast_sheet`]) meet surfaces: curves across which what the surface sends jumps (term R of [T] section 3, by way of interfaces).
//!
//! On a surface f = <x_k - e, m> is a function of its points ([`super::cast`]), and so is a = <x_k, t>, t along the border: what the curve adds to `∫ g L dA` is
//!
//! ```text
//! ∫ g (L⁺ - L⁻) <m, ẋ_k - ė> da / |n·(∇f × ∇a)|
//! ```
//!
//! ([T] (35) for a curve on a surface: dl/|∇f| along f = 0; n: the surface's normal), g being what a unit of light there brings to the picture. A point of it is drawn by its place on the border. Whoever sees it tells how it moves: the camera, straight or by way of interfaces
//! (a shot, [`super::aim`]), onto whose film it slides, and vertices of camera paths ([`super::seen_path`]), likewise, each in its own way.

use super::aim::{From, Interfaces};
use super::cast::{Ended, is_opaque};
use super::cast_sheet::{Met, Sheet};
use super::ends::{self, Point, Watch};
use super::grazing_line::seen_on;
use super::known_chains::KnownChains;
use super::light_walk::Vertex;
use super::seen_path::{self, Path};
use super::sheet::Partials;
use super::{Context, Sample};
use crate::math::discrete::Discrete;
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::scene::{Around, Hit, On, Scene};
use crate::sensor::Sensor;
use crate::transport::Tally;
use crate::transport::first::{FilmLine, Nth, Seen};
use crate::transport::ray::MovingRay;
use crate::transport::shot::{self, Place, Target};
use crate::transport::velocity::Velocity;
use crate::transport::way_motion::Slide;
use rayon::prelude::*;
use std::cell::OnceCell;

/// Share of samples that are spread over all curves, whatever light was found there.
const ANYWHERE: f64 = 0.1;

/// How far from a curve light is asked for at most, in scene radii.
const FARTHEST: f64 = 1e-3;
/// How often curves are looked at that move only as others see them.
const STILL: f64 = 0.2;

pub struct Traces {
    parts: Vec<Part>,
    table: Discrete,
    /// Chains that the camera sees by.
    known: KnownChains,
    interfaces: Interfaces,
}

/// A stretch of a border, and between which points its rays end, where they end on one shape.
struct Part {
    sheet: usize,
    s: [f64; 2],
    ends: Option<[DVec3; 2]>,
}

/// A point of a curve.
struct Spot<'a> {
    sheet: &'a Sheet,
    /// Whether that moves by itself.
    moves: bool,
    /// Share of the border, and the density of that.
    s: f64,
    density: f64,
    hit: Hit,
    /// Direction of the light.
    w: DVec3,
    medium: Option<u32>,
    jump: OnceCell<Option<Jump>>,
}

/// What jumps at a point of a curve.
struct Jump {
    met: Met,
    /// By the light's position or direction, of f.
    by_light: DVec3,
    /// Irradiance across the light's direction where f is above 0, less that where it is below, times da |n·w| / |n·(∇f × ∇a)|, over the density of the place.
    light: Rgb,
}

impl Spot<'_> {
    fn new<'a>(
        scene: &Scene,
        around: &Around,
        (ended, k): (&'a Ended, usize),
        s: f64,
        density: f64,
        unsettled: &mut u64,
    ) -> Option<Spot<'a>> {
        let (sheet, moves) = (&ended.sheets()[k], ended.moves(k));
        let (hit, w, grazed) = sheet.lands(scene, s, unsettled)?;
        let before = || {
            // Beside the sheet: on it the border's own faces would be met from either side, as rounding has it.
            let across = sheet.across(scene, s, hit.t, w).unwrap_or_default();
            ends::medium_beside(scene, ends::before(scene, &hit, w), -w, across, &grazed, around)
        };
        let medium = if scene.media.is_empty() { None } else { before() };
        Some(Spot { sheet, moves, s, density, hit, w, medium, jump: OnceCell::new() })
    }

    fn vertex(&self) -> Vertex {
        Vertex { p: self.hit.p, w: self.w, medium: self.medium, hit: Some(self.hit) }
    }

    fn slide<'s>(&self, scene: &'s Scene, met: &'s Met) -> Option<Slide<'s>> {
        met.slide(scene, self.sheet.at, self.hit.p)
    }

    fn jump(&self, scene: &Scene, tally: &mut Tally) -> Option<&Jump> {
        self.jump.get_or_init(|| self.found_jump(scene, tally)).as_ref()
    }

    /// `None` where nothing jumps; what is no number, or does not settle, is counted.
    fn found_jump(&self, scene: &Scene, tally: &mut Tally) -> Option<Jump> {
        let (sheet, n) = (self.sheet, self.hit.n);
        let met = sheet.met(scene, self.s, &mut tally.unsettled)?;
        let Some(slide) = self.slide(scene, &met) else {
            tally.unsettled += 1;
            return None;
        };
        let ([by_end, by_light], [by_along, _]) = (slide.by_ends(met.m), slide.by_ends(met.place.along));
        let slope = by_end - n * n.dot(by_end);
        let off =
            slope.normalize_or_zero() * (sheet.aside(scene) / slope.length()).min(FARTHEST * scene.bounds.radius());
        let [more, less] = [off, -off].map(|off| {
            let h = scene.hit_at(self.hit.p + off, self.hit.shape, self.hit.face);
            sheet.arrives(scene, met.first, (h.p, On::at(&h), self.medium), &mut tally.unsettled)
        });
        // Both gradients are across w.
        let measure =
            sheet.length_across(scene, self.s, &met.place)? / (by_end.cross(by_along).length() * self.density);
        let light = (more - less) * measure;
        tally.nonfinite += u64::from(!light.is_finite());
        (light.is_finite() && !light.is_zero()).then_some(Jump { met, by_light, light })
    }

    /// `<m, ẋ_k - ė>`, the point moving so.
    fn partials(&self, cx: &mut Context, ended: &Ended, jump: &Jump, velocity: &Velocity) -> Option<Partials> {
        let start = cx.moving.any().then_some(velocity);
        let of_slide = |slide: Slide| ended.partials(cx, (self.sheet, &jump.met), (&slide, jump.by_light), start);
        let found = self.slide(cx.scene, &jump.met).and_then(of_slide);
        cx.tally.unsettled += u64::from(found.is_none());
        found
    }
}

impl Traces {
    /// `None` where there are no sheets, or nothing opaque.
    pub fn prepare(scene: &Scene, sensor: &Sensor, margin: f64, ended: &Ended) -> Option<Traces> {
        if !scene.shapes.iter().any(|s| is_opaque(scene, s)) {
            return None;
        }
        let around = scene.around(Some(sensor));
        let of_sheet = |(k, sheet): (usize, &Sheet)| {
            let mut parts = Vec::new();
            for [a, b] in sheet.stretches() {
                let ends = match [a, b].map(|s| sheet.lands(scene, s, &mut 0)) {
                    [Some((h, ..)), Some((g, ..))] if h.shape == g.shape => Some([h.p, g.p]),
                    _ => None,
                };
                let spot = Spot::new(scene, &around, (ended, k), 0.5 * (a + b), 1.0 / (b - a), &mut 0);
                let scatters = |s: &Spot| !s.vertex().scatter(scene, -s.w).is_zero();
                let light = |s: Spot| s.jump(scene, &mut Tally::default()).map_or(0.0, |j| j.light.abs().max());
                let light = spot.filter(scatters).map_or(0.0, light) * if ended.moves(k) { 1.0 } else { STILL };
                parts.push((Part { sheet: k, s: [a, b], ends }, light, sheet.asked * (b - a) * sheet.border.length()));
            }
            parts
        };
        let found: Vec<(Part, f64, f64)> = ended.sheets().par_iter().enumerate().flat_map_iter(of_sheet).collect();
        let [lit, all] = found.iter().fold([0.0, 0.0], |[a, b], p| [a + p.1, b + p.2]);
        let share = if lit > 0.0 { ANYWHERE } else { 1.0 };
        let weight = |p: &(Part, f64, f64)| share * p.2 / all + if lit > 0.0 { (1.0 - share) * p.1 / lit } else { 0.0 };
        let table = Discrete::new(found.iter().map(weight));
        let parts: Vec<Part> = found.into_iter().map(|p| p.0).collect();
        (table.total > 0.0).then(|| {
            let known = From::camera(sensor, margin).known_chains(scene);
            Traces { parts, table, known, interfaces: Interfaces::new(scene) }
        })
    }

    /// A point, as v sees it: evenly by angle along its stretch.
    fn spot<'a>(&self, cx: &mut Context, ended: &'a Ended, v: Option<DVec3>, u: f64) -> Option<Spot<'a>> {
        let (k, probability, u) = self.table.sample(u);
        let part = &self.parts[k];
        let [a, b] = part.s;
        let seen = v.zip(part.ends).and_then(|(v, [p, q])| {
            let (x, per_length) = seen_on(p, q, v, u)?;
            let length = (q - p).length();
            Some(((x - p).length() / length, per_length * length))
        });
        let (t, density) = seen.unwrap_or((u, 1.0));
        let density = probability * density / (b - a);
        let unsettled = &mut cx.tally.unsettled;
        Spot::new(cx.scene, &cx.around, (ended, part.sheet), a + t * (b - a), density, unsettled)
    }

    /// What the point sends toward d, moving so, and how that depends on slots.
    fn sent(
        &self,
        cx: &mut Context,
        ended: &Ended,
        spot: &Spot,
        d: DVec3,
        velocity: &Velocity,
    ) -> Option<(Rgb, Partials)> {
        let scattered = spot.vertex().scatter(cx.scene, d);
        if scattered.is_zero() || !spot.moves && velocity.is_zero() {
            return None;
        }
        let jump = spot.jump(cx.scene, &mut cx.tally)?;
        let partials = spot.partials(cx, ended, jump, velocity).filter(|p| !p.as_slice().is_empty())?;
        Some((jump.light * scattered, partials))
    }

    /// As vertices of a camera path see it.
    pub fn along(&self, cx: &mut Context, ended: &Ended, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        // The path takes the even numbers.
        let mut stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        let path = Path::new(cx, film, *rng);
        let mut emit = |flux: Rgb, partials: &Partials| {
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        };
        for v in &path.vertices {
            let straight = self.look_straight(cx, ended, &path, v, &mut stream);
            let through = self.look_through(cx, ended, &path, v, &mut stream);
            for (flux, partials) in straight.into_iter().chain(through) {
                emit(flux, &partials);
            }
        }
    }

    fn look_straight(
        &self,
        cx: &mut Context,
        ended: &Ended,
        path: &Path,
        v: &seen_path::Vertex,
        rng: &mut Rng,
    ) -> Option<(Rgb, Partials)> {
        let scene = cx.scene;
        let spot = self.spot(cx, ended, Some(v.p()), rng.uniform())?;
        if !is_shown(cx, spot.sheet, v.depth + 1) {
            return None;
        }
        let scatter = v.scatter(scene, (spot.hit.p - v.p()).normalize());
        if scatter.is_zero() {
            return None;
        }
        let shot = shot::straight(scene, v.p(), &v.place(scene), spot.hit.p, None)?;
        let velocity = path.watch(cx, v).beyond(cx, &v.point).velocity(cx, &Point::Surface(spot.hit));
        let (flux, partials) = self.sent(cx, ended, &spot, -shot.w, &velocity)?;
        Some((flux * v.weight * scatter * shot.weight * (1.0 / shot.spread), partials))
    }

    fn look_through(
        &self,
        cx: &mut Context,
        ended: &Ended,
        path: &Path,
        v: &seen_path::Vertex,
        rng: &mut Rng,
    ) -> Option<(Rgb, Partials)> {
        let scene = cx.scene;
        let spot = self.spot(cx, ended, None, rng.uniform())?;
        let (from, target) = (From::vertex(scene, v, &self.interfaces), Target::Point(spot.hit.p));
        let drawn = from.draw(scene, &target, rng, |_| false)?;
        let shot = &drawn.shot;
        let scatter = v.scatter(scene, shot.start.w);
        if scatter.is_zero() || !is_shown(cx, spot.sheet, v.depth + 1 + shot.chain.len() as u32) {
            return None;
        }
        let velocity = seen_by(cx, MovingRay::leaving(v.p(), shot.start.w, path.velocity(cx, v)), shot, &spot.hit);
        let (flux, partials) = self.sent(cx, ended, &spot, -shot.w, &velocity)?;
        let random = |rng: &mut Rng| from.random(scene, rng);
        let Some(trials) = drawn.trials(scene, &from.eye, &from.place, &target, rng, random) else {
            cx.tally.missed_boundary += 1;
            return None;
        };
        Some((flux * v.weight * scatter * shot.weight * (trials / shot.spread), partials))
    }

    /// As the camera sees it, straight and by way of interfaces. `lead`: place on the borders, and the known chain.
    pub fn outward(
        &self,
        cx: &mut Context,
        ended: &Ended,
        lead: &Numbers,
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let (scene, sensor) = (cx.scene, cx.sensor);
        let Some(spot) = self.spot(cx, ended, None, lead[0]) else { return };
        let mut emit = |film: [f64; 2], flux: Rgb, partials: &Partials| {
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 0.0, outward: 1.0 });
        };
        let straight = sensor.project(spot.hit.p).filter(|q| cx.on_film(q.film) && is_shown(cx, spot.sheet, 0));
        if let Some(q) = straight {
            if let Some(shot) = shot::straight(scene, q.o, &Place::within(sensor.medium), spot.hit.p, None) {
                let point = Point::Surface(spot.hit);
                let velocity = Watch::itself(cx, &q, &point).velocity(cx, &point);
                if let Some((flux, partials)) = self.sent(cx, ended, &spot, -q.w, &velocity) {
                    emit(q.film, flux * shot.weight * q.pixels_per_area, &partials);
                }
            }
        }

        let (from, share) = (From::camera(sensor, cx.margin), self.known.share);
        let chain = (lead[1] < share).then(|| self.known.choose(lead[1] / share));
        let Some(aimed) = from.to_point(cx, &self.known, (spot.hit.p, chain), rng) else { return };
        let shot = aimed.shot();
        if !is_shown(cx, spot.sheet, shot.chain.len() as u32) {
            return;
        }
        let Some(q) = sensor.project(shot.start.o + shot.start.w).filter(|q| cx.on_film(q.film)) else { return };
        let velocity = seen_by(cx, cx.moving.film_ray().clone(), shot, &spot.hit);
        let Some((flux, partials)) = self.sent(cx, ended, &spot, -shot.w, &velocity) else { return };
        match aimed.trials(scene, &from, &Target::Point(spot.hit.p), rng) {
            Some(trials) => emit(q.film, flux * shot.weight * (q.pixels_per_area * trials / shot.spread), &partials),
            None => cx.tally.missed_boundary += 1,
        }
    }
}

/// Whether the picture shows light of a sheet that is scattered on its surface and has `more` scatterings after that.
fn is_shown(cx: &Context, sheet: &Sheet, more: u32) -> bool {
    let order = sheet.route.len() as u32 + 1 + more;
    order >= cx.set.min_order && order < cx.set.max_depth
}

/// How a point of a surface moves that a ray, leaving so, meets by way of a shot's interfaces.
fn seen_by(cx: &Context, mut ray: MovingRay, shot: &shot::Shot, hit: &Hit) -> Velocity {
    let (scene, moving) = (cx.scene, cx.moving);
    for met in &shot.chain {
        ray = FilmLine { scene, moving, ray: &ray }.behind(met);
    }
    let first = FilmLine { scene, moving, ray: &ray }.first(&Seen::Surface { hit: *hit, w: shot.w });
    Watch::of(first, Nth::First).velocity(cx, &Point::Surface(*hit))
}
