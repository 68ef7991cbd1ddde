//! Straight lines that graze edges, drawn from the edge outward ([T] 2.2), and the light that comes along them: what the rooms of [T] (24) share.
//!
//! A line grazes an edge at B and ends at S, toward the camera, and at D. It carries the light that leaves D, of any number of
//! scatterings, to S and on into the picture: `∫dl ∫dω sin α ∫∫ ds_S ds_D (-v) P(S) T(S,D) R(D)` with `v = <n, ẋ_B - (d_D ẋ_S + d_S ẋ_D)/(d_S + d_D)>` (25), n toward
//! the unblocked side; either end is the first surface or (with its ds) a medium point on the way. One pair of walks a sample: its cost is linear in path length. A
//! smooth surface has the grazing lines `dA dθ |κ(θ)|` (B on it, θ the line's turn in the tangent plane, κ(θ) the normal curvature along the line) in place of
//! `dl dω sin α`: what the edges of finer and finer polyhedra tend to. That is `1/R` of a sphere. Of a cylinder it is `cos²θ/R`, θ counted from the circle: an edge of the
//! prism that replaces it has `dl sin²α dα dφ` (α the angle with the edge), where φ takes up the angle ds/R between neighbouring faces, and `sin α = |cos θ|`.
//!
//! Directions come from the edge alone, or toward a point of a lamp; light emitted on a surface D is shared by both ([T] (61)), all
//! other light belongs to the first.

use super::edge_set::{EdgeSet, Ends, SharedEdge};
use super::ends::{self, ByOrder, Point, Watch};
use super::light_walk::{LightWalk, Vertex, seen};
use super::rims::{Rim, rims};
use super::sheet::{Grazed, Partials, Reach};
use super::{Context, Motion, Sample};
use crate::light::LightKind;
use crate::math::discrete::Discrete;
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::math::{DVec2, DVec3, Rgb, warp};
use crate::scene::{Hit, On, Scene};
use crate::shape::edges::Edge;
use crate::shape::{Cylinder, Geometry, Shape};
use crate::transport::line::Line as Way;
use crate::transport::walk::Stage;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Share of directions toward lamps, where there are any.
const TO_LAMPS: f64 = 0.6;
/// Weight of edges that stand still against such that move.
const STILL: f64 = 0.25;
/// The least that distance leaves of it: first vertices carry their motion farther than fields do.
const FAR: f64 = 0.02;

/// What a line may graze.
#[derive(Clone, Debug)]
struct Element {
    curve: Curve,
    /// Its shapes, of meshes with their faces there.
    grazed: Vec<(u32, Vec<u32>)>,
}

#[derive(Clone, Debug)]
enum Curve {
    Edge(Edge),
    Sphere {
        c: DVec3,
        r: f64,
    },
    /// The wall, from outside.
    Cylinder(Cylinder),
    Rim(Rim),
}

/// How much an edge may bring, by what moves: a line that grazes an edge that stands still brings something only if one of its ends moves, and
/// ends move near shapes that do, or where the camera looks past them.
struct Aim {
    /// Middles and radii of what moves; `None` where the camera moves everything it sees.
    around: Option<Vec<(DVec3, f64)>>,
}

impl Aim {
    fn new(scene: &Scene, motion: &Motion) -> Aim {
        let shape = |i: u32| {
            let b = scene.shapes[i as usize].shape.bounds();
            (b.center(), b.radius())
        };
        let moving = (0..scene.shapes.len() as u32).filter(|&i| motion.moves(i));
        let around = || moving.map(shape).chain(motion.moving.field.regions()).collect();
        Aim { around: (!motion.moving.camera).then(around) }
    }

    fn weight(&self, motion: &Motion, shape: u32, p: DVec3) -> f64 {
        match &self.around {
            _ if motion.moves(shape) => 1.0,
            None => STILL,
            Some(around) => {
                let seen = around.iter().map(|(c, r)| r * r / (*c - p).length_squared());
                STILL * seen.fold(FAR, f64::max).min(1.0)
            }
        }
    }
}

/// Everything that lines may graze.
pub struct Edges {
    set: Arc<EdgeSet>,
    curved: Vec<Element>,
    /// Over the edges of the set, then what is curved.
    table: Discrete,
    /// Lamps with an extent, by power.
    lamps: Discrete,
}

/// A line that grazes an element.
pub struct Line {
    b: DVec3,
    /// Unit, from S to D.
    w: DVec3,
    /// Toward the unblocked side.
    n: DVec3,
    /// `sin α`, or `|κ|`.
    measure: f64,
    /// Density of B along the edge; 0 of a smooth surface.
    per_length: f64,
    /// Densities of both techniques, per `dl dω` (or `dA dθ`): from the edge, and toward the lamp that is met.
    own: f64,
    lamp: f64,
    /// Drawn toward this lamp, at this distance.
    target: Option<(u32, f64)>,
}

impl Edges {
    /// `None` where nothing moves, or nothing has an edge.
    pub fn new(scene: &Scene, motion: &Motion) -> Option<Edges> {
        if !motion.surfaces() {
            return None;
        }
        let set = motion.edges(scene);
        let aim = Aim::new(scene, motion);
        let flat = |i: usize| {
            let Ends { a, b, pair } = set.ends(scene, i);
            let width = pair.map_or(PI, |corners| between(a, b, corners).1);
            (b - a).length() * width * PI * aim.weight(motion, set.shape(i), (a + b) * 0.5)
        };
        let mut weights: Vec<f64> = (0..set.len()).into_par_iter().map(flat).collect();
        let mut curved = Vec::new();
        for (i, s) in scene.shapes.iter().enumerate() {
            let id = i as u32;
            if scene.surfaces[s.surface as usize].is_null() {
                continue;
            }
            let (curve, grazed, size, middle) = match &s.shape {
                Shape::Sphere(q) => {
                    let curve = Curve::Sphere { c: q.center, r: q.radius };
                    (curve, vec![(id, Vec::new())], 4.0 * PI * TAU * q.radius, q.center)
                }
                Shape::Cylinder(q) => {
                    let middle = s.shape.bounds().center();
                    (Curve::Cylinder(*q), vec![(id, Vec::new())], TAU * PI * q.length, middle)
                }
                _ => continue,
            };
            curved.push(Element { curve, grazed });
            weights.push(size * aim.weight(motion, id, middle));
        }
        for r in rims(scene, motion) {
            let Some(shape) = r.shapes().next() else { continue };
            let size = PI * (r.x.length() + r.y.length()) * TAU * wedge(&r.edge(0.0)).1;
            weights.push(size * aim.weight(motion, shape, r.c));
            curved.push(Element { grazed: r.grazed.clone(), curve: Curve::Rim(r) });
        }
        // Edges without length have no direction; no line grazes them.
        weights.iter_mut().filter(|w| !w.is_finite()).for_each(|w| *w = 0.0);
        let power = |l: &crate::light::Light| match l.kind {
            LightKind::Area { shape } => l.value.max() * scene.shapes[shape as usize].shape.area(),
            LightKind::Envmap(_) => l.value.max() * scene.bounds.radius().powi(2),
            _ => 0.0,
        };
        let lamps = Discrete::new(scene.lights.iter().map(power));
        let table = Discrete::new(weights);
        (table.total > 0.0).then_some(Edges { set, curved, table, lamps })
    }

    fn element(&self, scene: &Scene, i: usize) -> Element {
        if i < self.set.len() {
            let SharedEdge { edge, faces } = self.set.get(scene, i);
            return Element { curve: Curve::Edge(edge), grazed: faces };
        }
        self.curved[i - self.set.len()].clone()
    }

    /// Probability that a direction is drawn toward the lamp.
    fn lamp_share(&self, light: u32) -> f64 {
        if self.lamps.total > 0.0 { TO_LAMPS * self.lamps.probability(light as usize) } else { 0.0 }
    }

    fn own_share(&self) -> f64 {
        if self.lamps.total > 0.0 { 1.0 - TO_LAMPS } else { 1.0 }
    }

    /// Draw a line by its place t on the element, the choice of a lamp, and a direction; the densities do not hold the element's probability.
    fn draw(&self, scene: &Scene, curve: &Curve, t: f64, [way, u, v]: [f64; 3]) -> Option<Line> {
        let lamp = if self.lamps.total > 0.0 && way < TO_LAMPS {
            Some(self.lamps.sample(way / TO_LAMPS).0 as u32)
        } else {
            None
        };
        match curve {
            Curve::Edge(e) => {
                let length = (e.b - e.a).length();
                let b = e.a + (e.b - e.a) * t;
                self.line(scene, e, b, length.recip(), lamp, u, v)
            }
            Curve::Rim(rim) => {
                let edge = rim.edge(t);
                let per_length = 1.0 / (TAU * (edge.b - edge.a).length());
                self.line(scene, &edge, edge.a, per_length, lamp, u, v)
            }
            Curve::Cylinder(q) => match lamp {
                None => self.along_wall(q, t, u, v),
                Some(light) => self.past_wall(scene, q, light, t, u, v),
            },
            Curve::Sphere { c, r } => {
                let uniform = 1.0 / (4.0 * PI * r * r * TAU);
                Some(match lamp {
                    None => {
                        let n = warp::sphere(u, v);
                        let (x, y) = warp::frame(n);
                        let (s, q) = (TAU * t).sin_cos();
                        Line {
                            b: *c + n * *r,
                            w: x * q + y * s,
                            n,
                            measure: 1.0 / r,
                            per_length: 0.0,
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
                            per_length: 0.0,
                            own: uniform,
                            lamp: density,
                            target: Some((light, distance)),
                        }
                    }
                })
            }
        }
    }

    /// Lines toward a lamp's points: `dA dθ/R = dA_z cos_z sin β dψ/d` (β: half the angle that the sphere fills from z, ψ around it).
    fn sphere_density(&self, r: f64, sin: f64, distance: f64, cos: f64, per_area: f64) -> Option<f64> {
        (cos > 0.0).then(|| per_area / TAU * distance / (r * cos * sin))
    }

    /// A line that touches a wall: its point by area, uniform in the cosine with the axis, both ways, as edges have it.
    fn along_wall(&self, q: &Cylinder, t: f64, u: f64, v: f64) -> Option<Line> {
        let b = q.position(0, DVec2::new(u, v));
        let n = q.from_axis(b).normalize();
        let (z, back) = if t < 0.5 { (4.0 * t - 1.0, 1.0) } else { (4.0 * t - 3.0, -1.0) };
        let sin = (1.0 - z * z).max(0.0).sqrt();
        let w = q.axis.cross(n) * (back * sin) + q.axis * z;
        let (measure, own) = (sin * sin / q.radius, wall_density(q, sin));
        (sin > 0.0).then_some(Line { b, w, n, measure, per_length: 0.0, own, lamp: 0.0, target: None })
    }

    /// One toward a point of a lamp.
    fn past_wall(&self, scene: &Scene, q: &Cylinder, light: u32, t: f64, u: f64, v: f64) -> Option<Line> {
        let LightKind::Area { shape } = scene.lights[light as usize].kind else { return None };
        let z = scene.shapes[shape as usize].shape.sample(u, v);
        let normals = q.contacts_from(z.p)?;
        let (n, t) = if t < 0.5 { (normals[0], 2.0 * t) } else { (normals[1], 2.0 * t - 1.0) };
        let [from, to] = q.line(n);
        let b = from + (to - from) * t;
        let distance = (z.p - b).length();
        let w = (z.p - b) / distance;
        let sin = w.cross(q.axis).length();
        let lamp = wall_to_lamp(q, sin, distance, -z.n.dot(w), z.pdf_area)?;
        let (measure, own) = (sin * sin / q.radius, wall_density(q, sin));
        Some(Line { b, w, n, measure, per_length: 0.0, own, lamp, target: Some((light, distance)) })
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
            per_length,
            own,
            lamp: toward,
            target,
        })
    }

    /// Density with which the point of a lamp that a line met would have been drawn.
    fn toward(&self, scene: &Scene, curve: &Curve, line: &Line, hit: Option<&Hit>) -> (u32, f64) {
        let Some(h) = hit else {
            let Some(id) = scene.environment else { return (0, 0.0) };
            let pdf = scene.lights[id as usize].escape(line.w).map_or(0.0, |e| e.1);
            return (id, pdf * line.per_length);
        };
        let shape = &scene.shapes[h.shape as usize];
        let Some(light) = shape.light else { return (0, 0.0) };
        let density = match curve {
            Curve::Sphere { c, r } => {
                let (d, distance) = ((*c - h.p).length(), (line.b - h.p).length());
                self.sphere_density(*r, r / d, distance, -h.n.dot(line.w), 1.0 / shape.shape.area()).unwrap_or(0.0)
            }
            Curve::Cylinder(q) => {
                let (distance, cos) = ((line.b - h.p).length(), -h.n.dot(line.w));
                let sin = line.w.cross(q.axis).length();
                wall_to_lamp(q, sin, distance, cos, 1.0 / shape.shape.area()).unwrap_or(0.0)
            }
            _ => scene.area_pdf(light, line.b, line.w, h) * line.per_length,
        };
        (light, density)
    }
}

/// Density `dA dθ` of lines that are uniform in area and in the cosine with the axis.
fn wall_density(q: &Cylinder, sin: f64) -> f64 {
    sin / (4.0 * q.area())
}

/// Of lines toward a lamp's points that touch the wall uniformly along one of its two lines of contact: `dA dθ sin²α/R = dA_z cos_z dl sin α/d²`.
fn wall_to_lamp(q: &Cylinder, sin: f64, distance: f64, cos: f64, per_area: f64) -> Option<f64> {
    (cos > 0.0).then(|| 0.5 * per_area / q.length * sin * distance * distance / (q.radius * cos))
}

/// The frame across an edge in which [`wedge`] counts angles: x toward the first face.
fn frame_of(edge: &Edge, t: DVec3) -> (DVec3, DVec3) {
    edge.sides.first().map_or_else(|| warp::frame(t), |s| across(t, s.corner - edge.a))
}

/// A frame across t, x toward v.
fn across(t: DVec3, v: DVec3) -> (DVec3, DVec3) {
    let x = (v - t * v.dot(t)).normalize();
    (x, t.cross(x))
}

/// Angles around an edge of lines that graze it: the first, and how many, in (0, π); the same again opposite.
fn wedge(edge: &Edge) -> (f64, f64) {
    let [first, second] = &edge.sides[..] else { return (0.0, PI) };
    between(edge.a, edge.b, [first.corner, second.corner])
}

/// The same for two faces with these corners.
fn between(a: DVec3, b: DVec3, [first, second]: [DVec3; 2]) -> (f64, f64) {
    let t = (b - a).normalize();
    let (x, y) = across(t, first - a);
    let f = second - a;
    let angle = f.dot(y).atan2(f.dot(x));
    // Lines that part the two faces lie between them.
    if angle >= 0.0 { (angle, PI - angle) } else { (0.0, PI + angle) }
}

/// What ends a line on its way w from the point b of an edge, if anything; `None` where it is blocked at once. What the edge stands on is left behind: it
/// hides nothing from what it touches.
fn near_end(scene: &Scene, b: DVec3, w: DVec3, grazed: Grazed) -> Option<Option<Hit>> {
    let contact = ends::contact(scene);
    let Some(first) = scene.opaque_past(b, w, f64::INFINITY, grazed) else { return Some(None) };
    if first.t > contact {
        return Some(Some(first));
    }
    // Away from it is where the shape itself is.
    let owner = scene.shapes[grazed.first()?.0 as usize].shape.bounds().center() - b;
    let leaves = first.n.dot(owner) * first.n.dot(w) > 0.0;
    let second = || scene.opaque_past(b + w * (2.0 * contact), w, f64::INFINITY, grazed);
    leaves.then(|| second().map(|h| Hit { t: h.t + 2.0 * contact, ..h }))
}

/// A line with what is on it.
pub struct Graze {
    line: Line,
    element: Element,
    /// Its measure over the probability of the element.
    pub scale: f64,
    /// The surfaces at its ends, and the media up to there.
    pub near: Option<Hit>,
    far: Option<Hit>,
    pub near_way: Way,
    far_way: Way,
}

/// The end D of a line, and the light that leaves it toward B, over the density of drawing line and end.
pub struct Far {
    pub light: ByOrder,
    pub at: Point,
    pub distance: f64,
}

impl Graze {
    pub fn grazed(&self) -> Grazed<'_> {
        &self.element.grazed
    }

    pub fn b(&self) -> DVec3 {
        self.line.b
    }

    /// Unit, from S to D.
    pub fn w(&self) -> DVec3 {
        self.line.w
    }

    pub fn near_distance(&self) -> f64 {
        self.near.as_ref().map_or(f64::INFINITY, |h| h.t)
    }

    /// What the light of `far` brings to the picture by way of S, the vertex z at this distance: straight to the camera, and through further
    /// scatterings. `scale`: everything between the two ends, over the density of drawing S.
    pub fn send(
        &self,
        cx: &mut Context,
        reach: &Reach,
        z: Vertex,
        distance: f64,
        far: &Far,
        scale: Rgb,
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let near = z.hit.map_or(Point::Medium(z.p), Point::Surface);
        let motion = |cx: &Context, watch: &Watch| self.motion(cx, &near, distance, far, watch);
        let flux = far.light.shown(cx.set, 1) * scale;
        if let Some(q) = cx.sensor.project(z.p).filter(|q| !flux.is_zero() && cx.on_film(q.film)) {
            if let Some(f) = seen(cx, &z, &q, rng) {
                let partials = motion(cx, &Watch::itself(cx, &q, &near));
                let partials = partials.as_slice();
                emit(&Sample { film: q.film, flux: flux * f, partials, film_per_sheet: 0.0, outward: 1.0 });
            }
        }
        if cx.set.max_depth > 2 {
            let walk = LightWalk { reach, motion: &motion, source: &far.light };
            walk.run(cx, z, scale, rng, emit);
        }
    }

    /// `-v_⊥` (25), for S at this distance, as the camera's path through S has it.
    pub fn motion(&self, cx: &Context, near: &Point, distance: f64, far: &Far, watch: &Watch) -> Partials {
        let Line { b, n, .. } = self.line;
        let (ds, dd) = (distance, far.distance);
        let (share_s, share_d) = if dd == f64::INFINITY { (1.0, 0.0) } else { (dd / (ds + dd), ds / (ds + dd)) };
        let mut p = Partials::default();
        ends::material(cx.scene, self.grazed(), b, -n, &mut p);
        ends::motion(cx, &far.at, &watch.beyond(cx, near), n * share_d, &mut p);
        ends::motion(cx, near, watch, n * share_s, &mut p);
        p
    }
}

impl Edges {
    /// Draw a line that nothing blocks at its edge, by the first four of the numbers.
    pub fn sample(&self, cx: &mut Context, &[place, way, u, v, _]: &Numbers) -> Option<Graze> {
        let scene = cx.scene;
        let (k, probability, t) = self.table.sample(place);
        let element = self.element(scene, k);
        let line = self.draw(scene, &element.curve, t, [way, u, v])?;
        let (b, w, grazed) = (line.b, line.w, &element.grazed[..]);
        let near = near_end(scene, b, -w, grazed)?;
        let far = scene.opaque_past(b, w, f64::INFINITY, grazed);
        // The edge may stand on D.
        let far = far.map(|d| if d.t <= ends::contact(scene) { ends::beside(scene, &d, line.n) } else { d });
        let way = |w: DVec3, end: &Option<Hit>| {
            if scene.media.is_empty() {
                return Some(Way::default());
            }
            let medium = scene.medium_toward(b, w, &On::default(), cx.outer);
            Way::clear(scene, b, w, end.as_ref().map_or(f64::INFINITY, |h| h.t), medium)
        };
        let (Some(near_way), Some(far_way)) = (way(-w, &near), way(w, &far)) else {
            cx.tally.missed_boundary += 1;
            return None;
        };
        let scale = line.measure / probability;
        Some(Graze { line, element, scale, near, far, near_way, far_way })
    }

    /// Draw the end D of a line: a point of its media, or the surface behind them.
    pub fn far(&self, cx: &mut Context, g: &Graze, rng: &mut Rng) -> Option<Far> {
        let (scene, line) = (cx.scene, &g.line);
        let inside = ends::medium_share(scene, &g.far_way, g.far.is_some());
        let own = self.own_share() * line.own;
        let distance = g.far.as_ref().map_or(f64::INFINITY, |h| h.t);
        let at = g.far.map_or(Point::Infinity, Point::Surface);
        let transmittance = g.far_way.transmittance();
        let met = |light: ByOrder| Some(Far { light, at, distance });
        if let Some((light, target)) = line.target {
            let hits = match &g.far {
                Some(h) => scene.shapes[h.shape as usize].light == Some(light) && (h.t - target).abs() <= 1e-6 * target,
                None => target == f64::INFINITY,
            };
            let front = g.far.as_ref().is_none_or(|h| h.n.dot(line.w) < 0.0);
            if !hits || !front {
                return None;
            }
            let density = own * (1.0 - inside) + self.lamp_share(light) * line.lamp;
            let l = &scene.lights[light as usize];
            let emission = match &g.far {
                Some(_) => l.emission(Rgb::ONE),
                None => l.escape(line.w).map_or_else(|| l.emission(Rgb::ZERO), |e| e.0),
            };
            return met(ByOrder(vec![emission.color() * transmittance * (1.0 / density)]));
        }
        if rng.uniform() < inside {
            let (at, distance, mut light) = ends::medium_end(cx, &g.far_way, line.b, line.w, rng)?;
            light.scale(Rgb::splat(1.0 / (own * inside)));
            return Some(Far { light, at, distance });
        }
        let (light, toward) = self.toward(scene, &g.element.curve, line, g.far.as_ref());
        let own = own * (1.0 - inside);
        let both = own + self.lamp_share(light) * toward;
        let stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        let stage = g.far.map_or(Stage::Escape, Stage::Surface);
        let mut found = ends::radiance(cx, line.b, line.w, stage, g.far_way.last, false, stream);
        for (k, x) in found.0.iter_mut().enumerate() {
            *x *= transmittance * (1.0 / if k == 0 { both } else { own });
        }
        met(found)
    }
}
