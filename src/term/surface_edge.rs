//! Silhouettes between surfaces: term E3 of [T] section 3, [T] (24), (25), sampled from the edge outward ([T] 2.2).
//!
//! A straight line grazes an edge at B and ends at the surface points S and D. It carries the light that leaves D, of any number of
//! scatterings, to S and on into the picture: `∫dl ∫dω sin α (-v) P(S) L(D)` with `v = <n, ẋ_B - (d_D ẋ_S + d_S ẋ_D)/(d_S + d_D)>`, n toward the unblocked side.
//! One pair of walks a sample: its cost is linear in path length. A sphere has the grazing lines `dA dθ/R` (B on it, θ the line's turn in the tangent plane)
//! in place of `dl dω sin α`: what the edges of finer and finer polyhedra tend to.
//!
//! Directions come from the edge alone, or toward a point of a lamp; light emitted at D is shared by both ([T] (61)), light
//! scattered there belongs to the first.

use super::edge_set::{EdgeSet, SharedEdge};
use super::ends::{self, ByOrder};
use super::light_walk::{LightWalk, Vertex, seen};
use super::sheet::{Grazed, Partials, Reach};
use super::{Context, Motion, Room, Sample};
use crate::light::LightKind;
use crate::math::discrete::Discrete;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb, warp};
use crate::scene::{Hit, Scene};
use crate::sensor::Sensor;
use crate::shape::edges::{Edge, Side};
use crate::shape::{Geometry, Shape};
use std::f64::consts::{PI, TAU};

pub const NAME: &str = "surface_edge";

/// Share of directions toward lamps, where there are any.
const TO_LAMPS: f64 = 0.6;
/// Weight of edges that stand still against such that move.
const STILL: f64 = 0.25;

enum Element {
    Edge(SharedEdge),
    Sphere {
        c: DVec3,
        r: f64,
        grazed: Vec<(u32, Vec<u32>)>,
    },
    /// The rim of a disk, `c + x cos + y sin`.
    Rim {
        c: DVec3,
        x: DVec3,
        y: DVec3,
        grazed: Vec<(u32, Vec<u32>)>,
    },
}

pub struct SurfaceEdge {
    list: Vec<Element>,
    table: Discrete,
    /// Lamps with an extent, by power.
    lamps: Discrete,
    reach: Reach,
}

/// A line that grazes an element.
struct Line {
    b: DVec3,
    /// Unit, from S to D.
    w: DVec3,
    /// Toward the unblocked side.
    n: DVec3,
    /// `sin α`, or `1/R`.
    measure: f64,
    /// Densities of both techniques, per `dl dω` (or `dA dθ`): from the edge, and toward the lamp that is met.
    own: f64,
    lamp: f64,
    /// Drawn toward this lamp, at this distance.
    target: Option<(u32, f64)>,
}

impl SurfaceEdge {
    pub fn prepare(scene: &Scene, sensor: &Sensor, motion: &Motion) -> Option<SurfaceEdge> {
        let reflecting = |s: &crate::scene::Instance| matches!(&scene.surfaces[s.surface as usize], crate::surface::Surface::Diffuse { reflectance, .. } if !reflectance.is_zero());
        if !motion.surfaces() || !scene.shapes.iter().any(reflecting) {
            return None;
        }
        let mut list = Vec::new();
        let mut weights = Vec::new();
        let mut add = |e: Element, shape: u32, size: f64| {
            if size > 0.0 && size.is_finite() {
                list.push(e);
                weights.push(size * if motion.moves(shape) { 1.0 } else { STILL });
            }
        };
        for e in EdgeSet::new(scene, motion).list {
            let size = (e.edge.b - e.edge.a).length() * wedge(&e.edge).1 * PI;
            let shape = e.faces[0].0;
            add(Element::Edge(e), shape, size);
        }
        for (i, s) in scene.shapes.iter().enumerate() {
            let id = i as u32;
            if scene.surfaces[s.surface as usize].is_null() {
                continue;
            }
            match &s.shape {
                Shape::Sphere(q) => {
                    let e = Element::Sphere { c: q.center, r: q.radius, grazed: vec![(id, Vec::new())] };
                    add(e, id, 4.0 * PI * TAU * q.radius);
                }
                Shape::Disk(d) => {
                    let (x, y) = (d.placement.vector(DVec3::X), d.placement.vector(DVec3::Y));
                    let c = d.placement.point(DVec3::ZERO);
                    let size = TAU * 0.5 * (x.length() + y.length()) * TAU * PI;
                    add(Element::Rim { c, x, y, grazed: vec![(id, vec![0])] }, id, size);
                }
                _ => {}
            }
        }
        let power = |l: &crate::light::Light| match l.kind {
            LightKind::Area { shape } => l.value.max() * scene.shapes[shape as usize].shape.area(),
            LightKind::Envmap(_) => l.value.max() * scene.bounds.radius().powi(2),
            _ => 0.0,
        };
        let lamps = Discrete::new(scene.lights.iter().map(power));
        let table = Discrete::new(weights);
        (!list.is_empty()).then(|| SurfaceEdge { list, table, lamps, reach: Reach::new(scene, sensor) })
    }

    /// Probability that a direction is drawn toward the lamp.
    fn lamp_share(&self, light: u32) -> f64 {
        if self.lamps.total > 0.0 { TO_LAMPS * self.lamps.probability(light as usize) } else { 0.0 }
    }

    fn own_share(&self) -> f64 {
        if self.lamps.total > 0.0 { 1.0 - TO_LAMPS } else { 1.0 }
    }

    /// Draw a line; the densities do not hold the element's probability.
    fn draw<'a>(&'a self, scene: &Scene, element: &'a Element, rng: &mut Rng) -> Option<(Line, Grazed<'a>)> {
        let lamp = if self.lamps.total > 0.0 && rng.uniform() < TO_LAMPS {
            Some(self.lamps.sample(rng.uniform()).0 as u32)
        } else {
            None
        };
        let (t, u, v) = (rng.uniform(), rng.uniform(), rng.uniform());
        match element {
            Element::Edge(e) => {
                let length = (e.edge.b - e.edge.a).length();
                let b = e.edge.a + (e.edge.b - e.edge.a) * t;
                let line = self.line(scene, &e.edge, b, length.recip(), lamp, u, v)?;
                Some((line, &e.faces))
            }
            Element::Rim { c, x, y, grazed } => {
                let (s, q) = (TAU * t).sin_cos();
                let (b, along) = (*c + *x * q + *y * s, *y * q - *x * s);
                let side = Side { face: 0, corner: *c };
                let edge = Edge { a: b, b: b + along, sides: vec![side] };
                let line = self.line(scene, &edge, b, 1.0 / (TAU * along.length()), lamp, u, v)?;
                Some((line, grazed))
            }
            Element::Sphere { c, r, grazed } => {
                let uniform = 1.0 / (4.0 * PI * r * r * TAU);
                let line = match lamp {
                    None => {
                        let n = warp::sphere(u, v);
                        let (x, y) = warp::frame(n);
                        let (s, q) = (TAU * t).sin_cos();
                        Line {
                            b: *c + n * *r,
                            w: x * q + y * s,
                            n,
                            measure: 1.0 / r,
                            own: uniform,
                            lamp: 0.0,
                            target: None,
                        }
                    }
                    Some(light) => {
                        let LightKind::Area { shape } = scene.lights[light as usize].kind else { return None };
                        let z = scene.shapes[shape as usize].shape.sample(u, v);
                        let axis = *c - z.p;
                        let d = axis.length();
                        if d <= *r {
                            return None;
                        }
                        let (sin, cos) = (r / d, ((d - r) * (d + r)).sqrt() / d);
                        let (x, y) = warp::frame(axis / d);
                        let (s, q) = (TAU * t).sin_cos();
                        let m = x * q + y * s;
                        let (to_b, n) = (axis / d * cos + m * sin, m * cos - axis / d * sin);
                        let distance = d * cos;
                        let density = self.sphere_density(*r, sin, distance, z.n.dot(to_b), z.pdf_area)?;
                        Line {
                            b: *c + n * *r,
                            w: -to_b,
                            n,
                            measure: 1.0 / r,
                            own: uniform,
                            lamp: density,
                            target: Some((light, distance)),
                        }
                    }
                };
                Some((line, grazed))
            }
        }
    }

    /// Lines toward a lamp's points: `dA dθ/R = dA_z cos_z sin β dψ/d` (β: half the angle that the sphere fills from z, ψ around it).
    fn sphere_density(&self, r: f64, sin: f64, distance: f64, cos: f64, per_area: f64) -> Option<f64> {
        (cos > 0.0).then(|| per_area / TAU * distance / (r * cos * sin))
    }

    /// A line through the point b of an edge, drawn with `per_length`.
    fn line(
        &self,
        scene: &Scene,
        edge: &Edge,
        b: DVec3,
        per_length: f64,
        lamp: Option<u32>,
        u: f64,
        v: f64,
    ) -> Option<Line> {
        let t = (edge.b - edge.a).normalize();
        let (first, width) = wedge(edge);
        let own = per_length / (4.0 * width);
        let (w, toward, target) = match lamp {
            Some(light) => {
                let a = scene.arrival(light, b, u, v)?;
                (a.w, a.pdf * per_length, Some((light, a.distance)))
            }
            None => {
                // Uniform in the angles around the edge that graze it, both ways, and in the cosine with it.
                let z = 2.0 * u - 1.0;
                let (half, v) = if v < 0.5 { (0.0, 2.0 * v) } else { (PI, 2.0 * v - 1.0) };
                let (x, y) = frame_of(edge, t);
                let (s, c) = (first + width * v + half).sin_cos();
                ((x * c + y * s) * (1.0 - z * z).max(0.0).sqrt() + t * z, 0.0, None)
            }
        };
        let normal = t.cross(w);
        let sin = normal.length();
        let side = edge.covered_side(normal);
        (side != 0.0 && sin > 0.0).then(|| Line {
            b,
            w,
            n: normal * (-side / sin),
            measure: sin,
            own,
            lamp: toward,
            target,
        })
    }

    /// Density with which the point of a lamp that a line met would have been drawn.
    fn toward(&self, scene: &Scene, element: &Element, line: &Line, per_length: f64, hit: Option<&Hit>) -> (u32, f64) {
        let Some(h) = hit else {
            let Some(id) = scene.environment else { return (0, 0.0) };
            let pdf = scene.lights[id as usize].escape(line.w).map_or(0.0, |e| e.1);
            return match element {
                Element::Sphere { .. } => (id, 0.0),
                _ => (id, pdf * per_length),
            };
        };
        let shape = &scene.shapes[h.shape as usize];
        let Some(light) = shape.light else { return (0, 0.0) };
        let density = match element {
            Element::Sphere { c, r, .. } => {
                let (d, distance) = ((*c - h.p).length(), (line.b - h.p).length());
                self.sphere_density(*r, r / d, distance, -h.n.dot(line.w), 1.0 / shape.shape.area()).unwrap_or(0.0)
            }
            _ => scene.area_pdf(light, line.b, line.w, h) * per_length,
        };
        (light, density)
    }
}

/// The frame across an edge in which [`wedge`] counts angles: x toward the first face.
fn frame_of(edge: &Edge, t: DVec3) -> (DVec3, DVec3) {
    let across = |v: DVec3| v - t * v.dot(t);
    let x = edge.sides.first().map_or_else(|| warp::frame(t).0, |s| across(s.corner - edge.a).normalize());
    (x, t.cross(x))
}

/// Angles around an edge of lines that graze it: the first, and how many, in (0, π); the same again opposite.
fn wedge(edge: &Edge) -> (f64, f64) {
    let t = (edge.b - edge.a).normalize();
    let [_, second] = &edge.sides[..] else { return (0.0, PI) };
    let (x, y) = frame_of(edge, t);
    let f = second.corner - edge.a;
    let angle = f.dot(y).atan2(f.dot(x));
    // Lines that part the two faces lie between them.
    if angle >= 0.0 { (angle, PI - angle) } else { (0.0, PI + angle) }
}

/// The surface S that a line meets on its way w from the point b of an edge. What the edge stands on is left behind, and no S: it hides nothing from
/// what it touches.
fn near_end(scene: &Scene, b: DVec3, w: DVec3, grazed: Grazed) -> Option<Hit> {
    let contact = ends::contact(scene);
    let first = scene.opaque_past(b, w, f64::INFINITY, grazed)?;
    if first.t > contact {
        return Some(first);
    }
    // Away from it is where the shape itself is.
    let owner = scene.shapes[grazed.first()?.0 as usize].shape.bounds().center() - b;
    let leaves = first.n.dot(owner) * first.n.dot(w) > 0.0;
    let second = scene.opaque_past(b + w * (2.0 * contact), w, f64::INFINITY, grazed).filter(|_| leaves)?;
    Some(Hit { t: second.t + 2.0 * contact, ..second })
}

impl Room for SurfaceEdge {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, _: &mut Context, _: [f64; 2], _: &mut Rng, _: &mut dyn FnMut(&Sample)) {}

    fn outward(&self, cx: &mut Context, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        let scene = cx.scene;
        if cx.set.max_depth <= 1 || self.table.total <= 0.0 {
            return;
        }
        let (k, probability, _) = self.table.sample(rng.uniform());
        let element = &self.list[k];
        let Some((line, grazed)) = self.draw(scene, element, rng) else { return };
        let (b, w, n) = (line.b, line.w, line.n);

        let Some(s) = near_end(scene, b, -w, grazed) else { return };
        let z = Vertex { p: s.p, w: -w, medium: None, hit: Some(s) };
        let facing = |h: &Hit| {
            let shape = &scene.shapes[h.shape as usize];
            scene.surfaces[shape.surface as usize].reflects(h.ns, w)
        };
        if s.t <= 0.0 || !scene.reflects(&s) || !facing(&s) {
            return;
        }
        let d = scene.opaque_past(b, w, f64::INFINITY, grazed);
        // The edge may stand on D.
        let d = d.map(|d| if d.t <= ends::contact(scene) { ends::beside(scene, &d, n) } else { d });
        // Light that leaves D toward S, over the density of the line.
        let per_length = match element {
            Element::Edge(e) => (e.edge.b - e.edge.a).length().recip(),
            _ => line.own * 4.0 * PI,
        };
        let own = self.own_share() * line.own;
        let light = match line.target {
            Some((light, distance)) => {
                let met = match &d {
                    Some(h) => {
                        scene.shapes[h.shape as usize].light == Some(light) && (h.t - distance).abs() <= 1e-6 * distance
                    }
                    None => distance == f64::INFINITY,
                };
                let front = d.as_ref().is_none_or(|h| h.n.dot(w) < 0.0);
                if !met || !front {
                    return;
                }
                let density = own + self.lamp_share(light) * line.lamp;
                let l = &scene.lights[light as usize];
                let emission = match &d {
                    Some(_) => l.emission(Rgb::ONE),
                    None => l.escape(w).map_or_else(|| l.emission(Rgb::ZERO), |e| e.0),
                };
                ByOrder(vec![emission.color() * (1.0 / density)])
            }
            None => {
                let (light, toward) = self.toward(scene, element, &line, per_length, d.as_ref());
                let density = own + self.lamp_share(light) * toward;
                let stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
                let mut found = ends::radiance(cx, b, w, d, false, stream);
                for (k, x) in found.0.iter_mut().enumerate() {
                    *x *= 1.0 / if k == 0 { density } else { own };
                }
                found
            }
        };
        if light.is_zero() {
            return;
        }
        let scale = line.measure / probability;

        // -v as a form on B, S and D: their shares of the grazing point.
        let (ds, dd) = (s.t, d.as_ref().map_or(f64::INFINITY, |d| d.t));
        let (share_s, share_d) = if dd == f64::INFINITY { (1.0, 0.0) } else { (dd / (ds + dd), ds / (ds + dd)) };
        let mut rest = Partials::default();
        if let Some((shape, _)) = grazed.first() {
            rest.extend(ends::material(scene, *shape, b, -n));
        }
        if let Some(d) = &d {
            rest.extend(ends::material(scene, d.shape, d.p, n * share_d));
        }
        let flux = light.shown(cx.set, 1) * scale;
        if let Some(q) = cx.sensor.project(s.p).filter(|q| !flux.is_zero() && cx.on_film(q.film)) {
            if let Some(f) = seen(cx, &z, &q, rng) {
                let mut partials = rest;
                ends::film_fixed(scene, cx.sensor, &s, q.w, n * share_s, &mut partials);
                let partials = partials.as_slice();
                emit(&Sample { film: q.film, flux: flux * f, partials, film_per_sheet: 0.0, outward: 1.0 });
            }
        }
        if cx.set.max_depth > 2 {
            let mut partials = rest;
            partials.extend(ends::material(scene, s.shape, s.p, n * share_s));
            let walk = LightWalk { reach: &self.reach, partials: partials.as_slice(), source: &light };
            walk.run(cx, z, Rgb::splat(scale), rng, emit);
        }
    }
}
