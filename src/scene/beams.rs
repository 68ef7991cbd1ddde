//! The ways of collimated beams: straight on, and by flat mirrors and interfaces.
//!
//! Parallel rays stay parallel at a plane, so that behind any sequence of planes a beam has one direction, and one share of the irradiance is left, with `(1 - F) cos θ_i / cos θ_t` at
//! each passage and F at each reflection ([T] 6.2). Whether a point is reached by a way is asked backward: from the point against the direction through the way's planes to the beam's own plane.
//! Ways whose planes no ray of the beam meets in that order are left out by clipping: a face seen along the beam is a polygon on the beam's plane.

use super::{Instance, Scene};
use crate::light::LightKind;
use crate::math::fresnel::{self, Interface, conductor};
use crate::math::{DMat2, DVec2, DVec3, Rgb, V3, warp};
use crate::shape::triangles::{around, around_disk};
use crate::shape::{Disk, Geometry, Shape};
use crate::surface::Surface;

/// A flat mirror or interface on a way.
#[derive(Clone, Copy, Debug)]
pub struct Step {
    pub shape: u32,
    pub face: u32,
    /// On the face, and its unit normal on the front side.
    pub p: DVec3,
    pub n: DVec3,
    /// Directions of the light before it and behind it.
    pub before: DVec3,
    pub behind: DVec3,
    pub through: bool,
}

/// A way that light of a beam takes.
#[derive(Clone, Debug)]
pub struct Way {
    pub light: u32,
    pub steps: Vec<Step>,
    /// Direction of the light at its end.
    pub w: DVec3,
    /// Irradiance across w over that across the beam.
    pub gain: Rgb,
    /// The point of a lamp that it begins at.
    pub source: Option<DVec3>,
}

/// Planes on a way at most, ways of a beam at most, and the least share of light: below a single-precision picture's last digit.
const STEPS: usize = 12;
const WAYS: usize = 1024;
const GAIN: f64 = 1e-8;
/// A Gaussian beam ends at so many radii: e^-72.
pub(super) const GAUSSIAN: f64 = 6.0;
/// Beyond so many radii the edges of shadows in one, and of its start, are left out: e^-18, below a single-precision picture's last digit.
pub const FAINT: f64 = 3.0;
/// Deviations (half a radius each) to either side within which points are drawn in it.
const TAILS: f64 = 3.0;
/// Ways that bring a smaller share of the beam's irradiance are asked for more rarely.
const WEAK: f64 = 0.1;

impl Way {
    /// How often it is asked for where that is left to chance.
    pub fn asked(&self) -> f64 {
        (self.gain.max() / WEAK).min(1.0)
    }

    /// A point on the line through the beam's own plane that leads to `x`, as if nothing of the line could lie behind a plane.
    pub fn origin(&self, x: DVec3) -> DVec3 {
        let (mut p, mut w) = (x, self.w);
        for s in self.steps.iter().rev() {
            p -= w * ((p - s.p).dot(s.n) / w.dot(s.n));
            w = s.before;
        }
        p
    }

    /// The point of the `k`th plane on the same line.
    pub fn on_plane(&self, k: usize, x: DVec3) -> DVec3 {
        let (mut p, mut w) = (x, self.w);
        for s in self.steps[k..].iter().rev() {
            p -= w * ((p - s.p).dot(s.n) / w.dot(s.n));
            w = s.before;
        }
        p
    }

    /// Where the line that reaches `x` comes from: points on the planes, from the last one to the first, and then on the beam's own.
    pub fn trace(&self, scene: &Scene, x: DVec3, points: &mut Vec<DVec3>) -> Option<DVec3> {
        points.clear();
        let (mut p, mut w) = (x, self.w);
        for s in self.steps.iter().rev() {
            let t = (p - s.p).dot(s.n) / w.dot(s.n);
            if t.is_nan() || t < 0.0 {
                return None;
            }
            p -= w * t;
            points.push(p);
            w = s.before;
        }
        let LightKind::Beam { position, direction, .. } = scene.lights[self.light as usize].kind else { return None };
        let t = (p - position).dot(direction);
        (t >= 0.0).then(|| p - direction * t)
    }
}

/// Where a line runs in a beam: abscissae from the first to the last, within which points are drawn evenly.
#[derive(Clone, Copy, Debug)]
pub struct Tube {
    pub from: f64,
    pub to: f64,
    /// Probability with which anything is drawn there at all.
    pub asked: f64,
}

impl Tube {
    /// Per length.
    pub fn density(&self, t: f64) -> f64 {
        if self.from <= t && t <= self.to { self.asked / (self.to - self.from) } else { 0.0 }
    }

    pub fn sample(&self, u: f64) -> f64 {
        self.from + u * (self.to - self.from)
    }
}

impl Way {
    /// Where on `o + t w`, t in [t0, t1], light of the beam arrives by this way, if nothing stands in it. Everything on the way is affine in t ([T] 6.2 for planes), so a plane that must
    /// be ahead bounds t from one side, and the distance from the beam's axis is the root of a quadratic. A Gaussian's tube ends at three deviations along the line.
    pub fn tube(&self, scene: &Scene, o: DVec3, w: DVec3, t0: f64, t1: f64) -> Option<Tube> {
        let LightKind::Beam { position, direction, radius, gaussian } = scene.lights[self.light as usize].kind else {
            return None;
        };
        let (mut from, mut to) = (t0, t1);
        // `a + b t >= 0`.
        let mut ahead = |a: f64, b: f64| {
            if b > 0.0 {
                from = from.max(-a / b);
            } else if b < 0.0 {
                to = to.min(-a / b);
            } else if a < 0.0 {
                to = f64::NEG_INFINITY;
            }
        };
        let (mut p, mut v, mut light) = (o, w, self.w);
        for s in self.steps.iter().rev() {
            let c = light.dot(s.n);
            let (a, b) = ((p - s.p).dot(s.n) / c, v.dot(s.n) / c);
            ahead(a, b);
            (p, v, light) = (p - light * a, v - light * b, s.before);
        }
        ahead((p - position).dot(direction), v.dot(direction));
        let across = |x: DVec3| x - direction * x.dot(direction);
        let (m, v) = (across(p - position), across(v));
        let speed = v.length();
        let closest = -m.dot(v) / (speed * speed);
        let reach = radius * if gaussian { GAUSSIAN } else { 1.0 };
        // Along the beam, but for rounding, nothing but where it begins and ends bounds it.
        let crosses = speed > 1e-12;
        let least = if crosses { m + v * closest } else { m }.length();
        if least >= reach {
            return None;
        }
        if crosses {
            let half = if gaussian { TAILS * 0.5 * radius } else { (reach * reach - least * least).sqrt() } / speed;
            (from, to) = (from.max(closest - half), to.min(closest + half));
        }
        let asked = self.asked();
        (to - from > 0.0 && to < f64::INFINITY).then_some(Tube { from, to, asked })
    }
}

/// Shapes at whose faces beams are followed.
pub fn is_flat(s: &Shape) -> bool {
    matches!(s, Shape::Rectangle(_) | Shape::Disk(_) | Shape::Cube(_))
}

/// Corners of a flat face, in order; empty where it is no polygon.
pub fn corners(s: &Shape, face: u32) -> Vec<DVec3> {
    let unit = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)];
    match s {
        Shape::Rectangle(_) | Shape::Cube(_) => unit.iter().map(|&(u, v)| s.position(face, DVec2::new(u, v))).collect(),
        _ => Vec::new(),
    }
}

/// Twice the area of a polygon, with the sign of its sense.
fn turn(p: &[DVec2]) -> f64 {
    (1..p.len().saturating_sub(1)).map(|i| (p[i] - p[0]).perp_dot(p[i + 1] - p[0])).sum()
}

fn area(p: &[DVec2]) -> f64 {
    0.5 * turn(p).abs()
}

/// A convex polygon within another.
fn clip(polygon: &[DVec2], by: &[DVec2]) -> Vec<DVec2> {
    let side = turn(by).signum();
    let mut left = polygon.to_vec();
    for i in 0..by.len() {
        let (a, b) = (by[i], by[(i + 1) % by.len()]);
        let inside = |p: DVec2| side * (b - a).perp_dot(p - a);
        let mut next = Vec::new();
        for k in 0..left.len() {
            let (p, q) = (left[k], left[(k + 1) % left.len()]);
            let (x, y) = (inside(p), inside(q));
            if x >= 0.0 {
                next.push(p);
            }
            if (x > 0.0 && y < 0.0) || (x < 0.0 && y > 0.0) {
                next.push(p + (q - p) * (x / (x - y)));
            }
        }
        left = next;
    }
    if turn(&left) == 0.0 { Vec::new() } else { left }
}

struct Search<'a> {
    scene: &'a Scene,
    position: DVec3,
    frame: (DVec3, DVec3),
    depth: usize,
    found: Vec<Way>,
    /// Ways are too many, or too long.
    crowded: bool,
    long: bool,
    /// The shape of which the border of an open face, or a block's from outside, stands in the beam.
    parted: Option<u32>,
}

impl Search<'_> {
    /// `polygon`: where the beam crosses its own plane on this way; `inside`: closed shapes that it is in.
    fn grow(&mut self, way: Way, polygon: &[DVec2], inside: &[u32]) {
        if self.found.len() >= WAYS {
            self.crowded = true;
            return;
        }
        for (id, s) in self.scene.shapes.iter().enumerate() {
            let surface = &self.scene.surfaces[s.surface as usize];
            if surface.is_smooth() && is_flat(&s.shape) {
                (0..s.shape.face_count()).for_each(|f| self.at(&way, id as u32, f, surface, polygon, inside));
            }
        }
        self.long |= way.steps.len() == STEPS;
        self.found.push(way);
    }

    /// The beam meets a face.
    fn at(&mut self, way: &Way, shape: u32, face: u32, surface: &Surface, polygon: &[DVec2], inside: &[u32]) {
        let instance: &Instance = &self.scene.shapes[shape as usize];
        if way.steps.last().is_some_and(|l| l.shape == shape && l.face == face) {
            return;
        }
        let disk = match &instance.shape {
            Shape::Disk(d) => Some(d),
            _ => None,
        };
        let corners = disk.map_or_else(|| corners(&instance.shape, face), |d| around_disk(d).to_vec());
        let p = disk.map_or(corners[0], |d| d.placement.point(DVec3::ZERO));
        let n = instance.shape.normal(face, p);
        let came = n.dot(way.w);
        let closed = instance.shape.is_closed();
        if came == 0.0 || closed && inside.contains(&shape) != (came > 0.0) {
            return;
        }
        let ahead = |way: &Way, p: DVec3| way.steps.last().map(|s| (p - s.p).dot(s.n) * s.n.dot(way.w) > 0.0);
        if corners.iter().all(|&c| ahead(way, c) == Some(false)) {
            return;
        }
        let on_plane = |c: DVec3| {
            let m = way.origin(c) - self.position;
            DVec2::new(m.dot(self.frame.0), m.dot(self.frame.1))
        };
        let seen: Vec<DVec2> = corners.iter().map(|&c| on_plane(c)).collect();
        let left = clip(polygon, &seen);
        if left.is_empty() {
            return;
        }
        let within = |d: &Disk| {
            let [c, x, y] = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|q| on_plane(d.placement.point(q)));
            let local = DMat2::from_cols(x - c, y - c).inverse();
            polygon.iter().all(|&p| (local * (p - c)).length() < 1.0)
        };
        // What parts at the edges of a block that it leaves goes on by ways of their own (`term::hard_beam`); what passes beside a block that the
        // rest enters has its shadow.
        let cut = !disk.is_none_or(within) || area(&left) < area(polygon) * (1.0 - 1e-9);
        if cut && (!closed || came < 0.0) {
            self.parted = self.parted.or(Some(shape));
        }
        // Where it goes on from there does not count any more, but what it leaves in shadow does.
        if way.steps.len() >= self.depth {
            return;
        }
        for (ray, gain) in outgoing(surface, n, way.w) {
            let gain = way.gain * gain;
            if gain.max() < GAIN {
                continue;
            }
            let step = Step { shape, face, p, n, before: way.w, behind: ray.w, through: ray.through };
            let mut steps = way.steps.clone();
            steps.push(step);
            let mut inside = inside.to_vec();
            if ray.through && closed {
                if came < 0.0 { inside.push(shape) } else { inside.retain(|&s| s != shape) }
            }
            self.grow(Way { light: way.light, steps, w: ray.w, gain, source: None }, &left, &inside);
        }
    }
}

/// Directions behind a surface of normal n, and the irradiance across them over that of the beam that travels along w.
fn outgoing(surface: &Surface, n: DVec3, w: DVec3) -> Vec<(crate::surface::Ray, Rgb)> {
    let front = n.dot(w) < 0.0;
    let c = n.dot(w).abs();
    let mut list = Vec::new();
    let mut add = |w: DVec3, through: bool, gain: Rgb| {
        if !gain.is_zero() {
            list.push((crate::surface::Ray { w, weight: gain, through }, gain));
        }
    };
    match surface {
        Surface::Dielectric { interior, exterior, .. } => {
            let (n1, n2) = if front { (*exterior, *interior) } else { (*interior, *exterior) };
            let i = Interface::new(c, n1, n2);
            let f = i.reflectance();
            add(fresnel::reflect(w, n), false, Rgb::splat(f));
            let side = if front { n } else { -n };
            if let (Some(t), Some(q)) = (i.refract(V3::constant(w), V3::constant(side)), i.cos_refracted()) {
                add(t.value().normalize(), true, Rgb::splat((1.0 - f) * c / q));
            }
        }
        Surface::Conductor { eta, k, two_sided, .. } if front || *two_sided => {
            add(fresnel::reflect(w, n), false, Rgb::from_fn(|i| conductor(c, eta[i], k[i])));
        }
        _ => {}
    }
    list
}

/// The ways of all beams.
#[derive(Clone, Debug, Default)]
pub struct Beams {
    pub ways: Vec<Way>,
    /// Beams some of whose ways are left out, because they are too long or too many.
    pub cut: Vec<u32>,
    /// Beams that a border of an open mirror or interface parts, or that pass beside a block that a part of them enters; and the shape.
    pub parted: Vec<(u32, u32)>,
}

impl Scene {
    /// List the ways of all beams; call when shapes, surfaces and lights are known.
    pub fn prepare_beams(&mut self) {
        let mut beams = Beams::default();
        for (id, l) in self.lights.iter().enumerate() {
            let LightKind::Beam { position, direction, radius, gaussian } = l.kind else { continue };
            let size = radius * if gaussian { GAUSSIAN } else { 1.0 };
            let around = around(DVec3::ZERO, DVec3::X * size, DVec3::Y * size).map(DVec3::truncate);
            let depth = (self.settings.max_depth.saturating_sub(2) as usize).min(STEPS);
            let frame = warp::frame(direction);
            let found = Vec::new();
            let mut search =
                Search { scene: self, position, frame, depth, found, crowded: false, long: false, parted: None };
            let within = |s: &Instance| matches!(&s.shape, Shape::Cube(c) if c.placement.local_point(position).abs().max_element() < 1.0);
            let inside: Vec<u32> =
                (0..self.shapes.len() as u32).filter(|&i| within(&self.shapes[i as usize])).collect();
            search.grow(
                Way { light: id as u32, steps: Vec::new(), w: direction, gain: Rgb::ONE, source: None },
                &around,
                &inside,
            );
            if search.crowded || search.long && self.settings.max_depth as usize > STEPS + 2 {
                beams.cut.push(id as u32);
            }
            if let Some(shape) = search.parted {
                beams.parted.push((id as u32, shape));
            }
            beams.ways.extend(search.found);
        }
        self.beams = beams;
    }
}
