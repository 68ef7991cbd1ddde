//! Outlines of what stands before a light: the curves whose shadows bound what it lights, and the rays that graze them.
//!
//! The light stands still during a run, so its silhouettes are found once, in one pass over the edges. Crossings of a straight
//! line with the shadow sheets are looked for in a hierarchy ([`super::arcs`]). What a camera sees is bounded by outlines too: its own
//! silhouettes, and creases between two faces that it sees both.

use super::Motion;
use super::arcs::{Node, quadratic};
use super::edge_set::SharedEdge;
use super::rims::Rim;
use super::sheet::{Grazed, Ray};
use crate::light::LightKind;
use crate::math::discrete::Discrete;
use crate::math::{DVec3, warp};
use crate::scene::Scene;
use crate::scene::beams::FAINT;
use crate::sensor::{Projection, Sensor};
use crate::shape::edges::FLAT;
use crate::shape::{Cylinder, Geometry, Shape};
use rayon::prelude::*;
use std::borrow::Cow;
use std::f64::consts::{PI, TAU};

/// Relative size of a cross product below which an edge points at the light [T] section 9.
const DEGENERATE: f64 = 1e-14;
/// Share of the selection that ignores what the light's rays to the outline meet.
const BLIND: f64 = 0.1;
/// Cosine between the normals of a sharp crease's faces, at most.
const SHARP: f64 = 0.7;
/// Parts of a rim of which those beside a beam are left out.
const CELLS: usize = 64;
/// All of a circle.
const WHOLE: [f64; 2] = [0.0, 1.0];
/// Sides of the polygon that stands for a rim.
const SIDES: u32 = 48;

#[derive(Clone, Copy, Debug)]
pub(super) enum Curve {
    /// From a to b, a straight edge or a cylinder's line of contact; unit normal of its sheet toward the lit side.
    Edge { a: DVec3, b: DVec3, n: DVec3 },
    /// A sphere's circle of contact.
    Sphere { c: DVec3, r: f64 },
    /// Of the source's rims.
    Rim(u32),
}

#[derive(Clone, Debug)]
pub(super) struct Outline {
    pub curve: Curve,
    /// Shapes whose outline it is, of meshes with their faces there, of rims with those; a smooth shape's line of contact names nothing.
    pub grazed: Vec<(u32, Vec<u32>)>,
    pub faces: Faces,
    /// Of a rim, and of a sphere's circle seen from afar, where it begins and how far it goes, in turns.
    pub part: [f64; 2],
}

/// Faces (shape, face) at an outline.
#[derive(Clone, Debug, Default)]
pub struct Faces {
    /// On the side of the normal: a crease's other face, nothing for a silhouette.
    pub lit: Vec<(u32, u32)>,
    /// On the other side.
    pub own: Vec<(u32, u32)>,
}

/// All outlines as one light or camera sees them.
pub struct Outlines {
    /// The light, for rays.
    light: u32,
    pub(super) source: Source,
    pub(super) list: Vec<Outline>,
    rims: Vec<Rim>,
    /// Edges between two faces that are both seen count, too.
    creases: Creases,
    pub(super) table: Discrete,
    pub(super) nodes: Vec<Node>,
    /// Outlines in the order of the hierarchy's leaves; those that it does not hold at the end.
    pub(super) order: Vec<u32>,
    /// How many of `order` the hierarchy holds.
    pub(super) held: usize,
}

/// Which edges between two faces that are both seen count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Creases {
    None,
    /// Between faces that are turned from each other by [`SHARP`] or more.
    Sharp,
    All,
}

/// Where outlines are seen from: a point, or all along one direction (of travel, for a light; of view, for a camera).
#[derive(Clone, Copy, Debug)]
pub(super) enum Source {
    Point(DVec3),
    Distant(DVec3),
}

impl Outlines {
    /// Silhouettes from the light `id`; `None` if nothing is there to cast a shadow.
    pub fn of_light(scene: &Scene, motion: &Motion, id: u32) -> Option<Outlines> {
        let source = match scene.lights[id as usize].kind {
            LightKind::Point { position } | LightKind::Spot { position, .. } => Source::Point(position),
            LightKind::Directional { direction } | LightKind::Beam { direction, .. } => Source::Distant(direction),
            _ => return None,
        };
        let mut o = Outlines::new(scene, motion, source, |_| true, Creases::None);
        o.light = id;
        if let LightKind::Beam { position, direction, radius, gaussian } = scene.lights[id as usize].kind {
            let reach = radius * if gaussian { FAINT } else { 1.0 };
            o.keep_within(position, direction, reach);
        }
        let seen = |e: DVec3, ray: &Ray, grazed: Grazed| {
            let light = scene.lights[id as usize].straight(e).map_or(0.0, |a| a.emission.unit.max());
            if light > 0.0 && super::sheet_samples::is_lit(scene, ray, ray.near, grazed) { light } else { 0.0 }
        };
        o.weigh(seen);
        (!o.list.is_empty()).then(|| {
            o.build();
            o
        })
    }

    /// Silhouettes and creases as a camera sees them, on its film and `margin` pixels around it.
    pub fn of_camera(
        scene: &Scene,
        motion: &Motion,
        sensor: &Sensor,
        margin: f64,
        keep: impl Fn(u32) -> bool + Sync,
    ) -> Option<Outlines> {
        let mut o = Outlines::new(scene, motion, Source::of(sensor), keep, Creases::All);
        let seen = |e: DVec3, _: &Ray, grazed: Grazed| {
            let Some(q) = sensor.project(e) else { return 0.0 };
            let seen = sensor.shows(q.film, margin) && !scene.blocked_past(q.o, q.w, q.distance, grazed);
            f64::from(u8::from(seen))
        };
        o.weigh(seen);
        (!o.list.is_empty()).then_some(o)
    }

    /// Silhouettes and sharp creases, all of them, whether seen or not, and without weights.
    pub fn sharp_of_camera(
        scene: &Scene,
        motion: &Motion,
        sensor: &Sensor,
        keep: impl Fn(u32) -> bool + Sync,
    ) -> Option<Outlines> {
        let o = Outlines::new(scene, motion, Source::of(sensor), keep, Creases::Sharp);
        (!o.list.is_empty()).then_some(o)
    }

    /// Their straight pieces, with what lines that graze them leave out: rims as polygons, spheres not at all.
    pub fn straight(&self) -> impl Iterator<Item = ([DVec3; 2], Grazed<'_>)> {
        self.list.iter().flat_map(|o| {
            let pieces = match o.curve {
                Curve::Edge { a, b, .. } => vec![[a, b]],
                Curve::Sphere { .. } => Vec::new(),
                Curve::Rim(rim) => {
                    let corner = |i: u32| self.rims[rim as usize].edge(f64::from(i) / f64::from(SIDES)).a;
                    (0..SIDES).map(|i| [corner(i), corner(i + 1)]).collect()
                }
            };
            pieces.into_iter().map(|p| (p, &o.grazed[..]))
        })
    }

    fn new(
        scene: &Scene,
        motion: &Motion,
        source: Source,
        keep: impl Fn(u32) -> bool + Sync,
        creases: Creases,
    ) -> Outlines {
        let mut list = Vec::new();
        for (i, s) in scene.shapes.iter().enumerate() {
            let id = i as u32;
            // At the lines of contact of a smooth wall light does not jump, but points slide fast.
            let slides = creases == Creases::Sharp && matches!(s.shape, Shape::Cylinder(_)) && !scene.is_null(s);
            if !(scene.has_outline(s) || slides) || !keep(id) {
                continue;
            }
            let faces = Faces { lit: Vec::new(), own: vec![(id, 0)] };
            match &s.shape {
                Shape::Sphere(sphere) => source.sphere(sphere.center, sphere.radius, id, faces, &mut list),
                Shape::Cylinder(cylinder) => source.cylinder(cylinder, id, &faces, &mut list),
                _ => {}
            }
        }
        let rims: Vec<Rim> = motion.rims.iter().filter(|r| r.shapes().any(&keep)).cloned().collect();
        for (k, r) in rims.iter().enumerate() {
            let faces = Faces { lit: Vec::new(), own: r.shapes().map(|id| (id, 0)).collect() };
            list.push(Outline { curve: Curve::Rim(k as u32), grazed: r.grazed.clone(), faces, part: WHOLE });
        }
        let edges = motion.edges(scene);
        let chosen = match creases {
            Creases::All => (0..edges.len()).filter(|&i| keep(edges.shape(i))).collect(),
            Creases::Sharp => {
                let chosen = |&i: &usize| keep(edges.shape(i)) && source.counts(scene, &edges.get(scene, i));
                (0..edges.len()).into_par_iter().filter(chosen).collect::<Vec<_>>()
            }
            Creases::None => edges.silhouettes(scene, &keep, |a, b| source.across(a, b).0),
        };
        for i in chosen {
            source.edge(scene, &edges.get(scene, i), creases, &mut list);
        }
        Outlines {
            light: u32::MAX,
            source,
            list,
            rims,
            creases,
            table: Discrete::default(),
            nodes: Vec::new(),
            order: Vec::new(),
            held: 0,
        }
    }

    /// What of the outlines a beam meets: straight ones are cut to size.
    fn keep_within(&mut self, position: DVec3, direction: DVec3, radius: f64) {
        let across = |p: DVec3| {
            let m = p - position;
            m - direction * m.dot(direction)
        };
        let rims = &self.rims;
        let keeps = |o: &mut Outline| match &mut o.curve {
            Curve::Edge { a, b, .. } => {
                let (m, v) = (across(*a), across(*b - *a + position));
                let q = [v.length_squared(), 2.0 * m.dot(v), m.length_squared() - radius * radius];
                let mut roots: Vec<f64> = quadratic(q).collect();
                roots.sort_by(f64::total_cmp);
                let [t0, t1] = roots[..] else { return false };
                let (t0, t1) = (t0.max(0.0), t1.min(1.0));
                (*a, *b) = (a.lerp(*b, t0), a.lerp(*b, t1));
                t0 < t1
            }
            Curve::Sphere { c, r } => {
                // The angle from the way to the axis at which the circle leaves the beam.
                let m = across(*c);
                let far = m.length();
                let cos = (far * far + *r * *r - radius * radius) / (2.0 * far * *r);
                let (x, y) = warp::frame(direction);
                if cos > -1.0 && cos < 1.0 {
                    let (half, middle) = (cos.acos() / TAU, (-m.dot(y)).atan2(-m.dot(x)) / TAU);
                    o.part = [middle - half, 2.0 * half];
                }
                cos < 1.0
            }
            Curve::Rim(k) => {
                let rim = &rims[*k as usize];
                let half = PI / CELLS as f64 * rim.x.length().max(rim.y.length());
                let middle = |k: usize| rim.edge((k as f64 + 0.5) / CELLS as f64).a;
                let near = |k: usize| across(middle(k)).length() <= radius + half;
                let near: [bool; CELLS] = std::array::from_fn(near);
                // All but the longest way round that is beside the beam.
                let beside = |from: usize| (0..CELLS).take_while(|k| !near[(from + k) % CELLS]).count();
                let (first, longest) = (0..CELLS).map(|k| (k, beside(k))).max_by_key(|g| g.1).unwrap_or_default();
                let cells = |k: usize| k as f64 / CELLS as f64;
                o.part = [cells(first + longest), cells(CELLS - longest)];
                longest < CELLS
            }
        };
        self.list.retain_mut(keeps);
    }

    /// The angle (or length) of each as its source sees it, times how much of it is seen (0 to 1).
    fn weigh(&mut self, seen: impl Fn(DVec3, &Ray, Grazed) -> f64) {
        const PROBES: usize = 4;
        let weight = |i: usize| {
            let (mut size, mut share) = (0.0, 0.0);
            for k in 0..PROBES {
                let Some(ray) = self.ray(i, (k as f64 + 0.5) / PROBES as f64) else { continue };
                size = 1.0 / ray.across;
                share += seen(ray.at(ray.near), &ray, self.grazed(i)) / PROBES as f64;
            }
            size * (BLIND + (1.0 - BLIND) * share)
        };
        let table = Discrete::new((0..self.list.len()).map(weight).collect::<Vec<_>>());
        self.table = table;
    }

    pub fn light(&self) -> u32 {
        self.light
    }

    pub fn len(&self) -> usize {
        self.list.len()
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    pub(super) fn grazed(&self, i: usize) -> Grazed<'_> {
        &self.list[i].grazed
    }

    /// A ray that grazes a random point of a random outline.
    pub fn sample(&self, u: f64) -> Option<(Ray, Grazed<'_>, Cow<'_, Faces>)> {
        if self.table.total <= 0.0 {
            return None;
        }
        let (i, probability, v) = self.table.sample(u);
        let mut ray = self.ray(i, v)?;
        ray.across *= probability;
        Some((ray, self.grazed(i), self.faces(i, &ray)))
    }

    /// Faces where a ray grazes an outline: which of a shared rim's are on its lit side depends on the place.
    fn faces(&self, i: usize, ray: &Ray) -> Cow<'_, Faces> {
        if let Curve::Rim(k) = self.list[i].curve {
            let rim = &self.rims[k as usize];
            if self.creases != Creases::None && rim.is_shared() {
                let [lit, own] = rim.parted(ray.at(ray.near), ray.n);
                return Cow::Owned(Faces { lit, own });
            }
        }
        Cow::Borrowed(&self.list[i].faces)
    }

    /// The ray at the fraction `u` of an outline; `across` given the outline.
    pub(super) fn ray(&self, i: usize, u: f64) -> Option<Ray> {
        let light = self.light;
        match (self.list[i].curve, self.source) {
            (Curve::Edge { a, b, n }, Source::Point(p)) => {
                let (a, b) = (a - p, b - p);
                let (ua, ub) = (a.normalize(), b.normalize());
                let angle = ua.cross(ub).length().atan2(ua.dot(ub));
                let t = n.cross(ua);
                // Toward b.
                let t = if t.dot(b) < 0.0 { -t } else { t };
                let (s, c) = (u * angle).sin_cos();
                let w = ua * c + t * s;
                // Where it meets the edge's line, in the plane of (ua, t).
                let e = b - a;
                let (ex, ey) = (e.dot(ua), e.dot(t));
                let near = a.length() * ey / (c * ey - s * ex);
                (near > 0.0 && near.is_finite() && angle > 0.0).then_some(Ray {
                    light,
                    origin: p,
                    w,
                    near,
                    n,
                    across: 1.0 / angle,
                    distant: false,
                    crossed: true,
                    profile: false,
                    in_media: true,
                })
            }
            (Curve::Edge { a, b, n }, Source::Distant(d)) => {
                let length = d.cross(b - a).length();
                let origin = a + (b - a) * u;
                (length > 0.0).then_some(Ray {
                    light,
                    origin,
                    w: d,
                    near: 0.0,
                    n,
                    across: 1.0 / length,
                    distant: true,
                    crossed: true,
                    profile: false,
                    in_media: true,
                })
            }
            (Curve::Sphere { c, r }, Source::Point(p)) => {
                let axis = c - p;
                let d = axis.length();
                let k = d * d - r * r;
                let (sin, cos) = (r / d, k.sqrt() / d);
                let (x, y) = warp::frame(axis / d);
                let (s, q) = (TAU * u).sin_cos();
                let m = x * q + y * s;
                let w = axis / d * cos + m * sin;
                let n = m * cos - axis / d * sin;
                Some(Ray {
                    light,
                    origin: p,
                    w,
                    near: k.sqrt(),
                    n,
                    across: 1.0 / (TAU * sin),
                    distant: false,
                    crossed: true,
                    profile: false,
                    in_media: true,
                })
            }
            (Curve::Sphere { c, r }, Source::Distant(d)) => {
                let (x, y) = warp::frame(d);
                let [from, turns] = self.list[i].part;
                let (s, q) = (TAU * (from + u * turns)).sin_cos();
                let n = x * q + y * s;
                Some(Ray {
                    light,
                    origin: c + n * r,
                    w: d,
                    near: 0.0,
                    n,
                    across: 1.0 / (TAU * r * turns),
                    distant: true,
                    crossed: true,
                    profile: false,
                    in_media: true,
                })
            }
            (Curve::Rim(k), source) => {
                let [from, turns] = self.list[i].part;
                let edge = self.rims[k as usize].edge(from + u * turns);
                let (e, tangent) = (edge.a, (edge.b - edge.a) * (TAU * turns));
                let (origin, w, near, distant) = match source {
                    Source::Point(p) => (p, (e - p).normalize(), (e - p).length(), false),
                    Source::Distant(d) => (e, d, 0.0, true),
                };
                let m = w.cross(tangent);
                let swept = if distant { m.length() } else { m.length() / near };
                let n = m.normalize();
                let side = edge.covered_side(n);
                let n = if side != 0.0 { n * -side } else { n };
                (swept > 0.0 && (side != 0.0 || self.creases != Creases::None)).then_some(Ray {
                    light,
                    origin,
                    w,
                    near,
                    n,
                    across: 1.0 / swept,
                    distant,
                    crossed: false,
                    profile: false,
                    in_media: true,
                })
            }
        }
    }
}

impl Source {
    fn of(sensor: &Sensor) -> Source {
        match sensor.projection {
            Projection::Perspective { .. } => Source::Point(sensor.to_world.translation),
            Projection::Orthographic => Source::Distant(sensor.ray(0.0, 0.0).1),
        }
    }

    fn sphere(&self, c: DVec3, r: f64, shape: u32, faces: Faces, list: &mut Vec<Outline>) {
        // From inside there is no silhouette.
        if !matches!(self, Source::Point(p) if (c - *p).length() <= r) {
            list.push(Outline { curve: Curve::Sphere { c, r }, grazed: vec![(shape, Vec::new())], faces, part: WHOLE });
        }
    }

    /// Two straight lines of contact; from within the wall, extended beyond its rims, none.
    fn cylinder(&self, q: &Cylinder, shape: u32, faces: &Faces, list: &mut Vec<Outline>) {
        let normals = match self {
            Source::Point(p) => q.contacts_from(*p),
            Source::Distant(d) => q.contacts_along(*d),
        };
        for n in normals.into_iter().flatten() {
            let [a, b] = q.line(n);
            list.push(Outline {
                curve: Curve::Edge { a, b, n },
                grazed: vec![(shape, Vec::new())],
                faces: faces.clone(),
                part: WHOLE,
            });
        }
    }

    /// Across the plane of a straight piece and the rays to it, not unit, and the length that this is relative to.
    fn across(&self, a: DVec3, b: DVec3) -> (DVec3, f64) {
        match self {
            Source::Point(p) => {
                let (a, b) = (a - *p, b - *p);
                (a.cross(b), a.length() * b.length())
            }
            Source::Distant(d) => (d.cross(b - a), (b - a).length()),
        }
    }

    /// Whether an edge is a silhouette or a sharp crease.
    fn counts(&self, scene: &Scene, e: &SharedEdge) -> bool {
        let (normal, _) = self.across(e.edge.a, e.edge.b);
        e.edge.covered_side(normal) != 0.0 || self.is_crease(scene, e, Creases::Sharp)
    }

    fn edge(&self, scene: &Scene, e: &SharedEdge, creases: Creases, list: &mut Vec<Outline>) {
        let (normal, scale) = self.across(e.edge.a, e.edge.b);
        let length = normal.length();
        if length.is_nan() || length <= DEGENERATE * scale {
            return;
        }
        let side = e.edge.covered_side(normal);
        let n = normal / length;
        let (a, b) = (e.edge.a, e.edge.b);
        if side != 0.0 {
            let faces = if creases == Creases::All {
                Faces { lit: Vec::new(), own: e.sides().map(|s| (s.0, s.1)).collect() }
            } else {
                Faces::default()
            };
            list.push(Outline {
                curve: Curve::Edge { a, b, n: n * -side },
                grazed: e.faces.clone(),
                faces,
                part: WHOLE,
            });
        } else if self.is_crease(scene, e, creases) {
            let on = |lit: bool| e.sides().filter(|s| (n.dot(s.2 - a) > 0.0) == lit).map(|s| (s.0, s.1)).collect();
            let faces = Faces { lit: on(true), own: on(false) };
            list.push(Outline { curve: Curve::Edge { a, b, n }, grazed: e.faces.clone(), faces, part: WHOLE });
        }
    }

    /// Whether what leaves the two sides of an edge that is no silhouette may differ: faces of another slope, or of another surface.
    fn is_crease(&self, scene: &Scene, e: &SharedEdge, creases: Creases) -> bool {
        if creases == Creases::None {
            return false;
        }
        let middle = 0.5 * (e.edge.a + e.edge.b);
        let view = match self {
            Source::Point(p) => middle - *p,
            Source::Distant(d) => *d,
        };
        let of = |id: u32| &scene.shapes[id as usize];
        let smooth = |id: u32| matches!(&of(id).shape, Shape::Mesh(m) if m.normals.is_some() && !of(id).face_normals);
        // A cube's rays leave out the whole of it: what it hides itself is told here.
        let hidden = |id: u32, n: DVec3| match &of(id).shape {
            Shape::Cube(c) => {
                let outward = n * n.dot(middle - c.placement.to_world.translation).signum();
                let within = |p: DVec3| c.placement.local_point(p).abs().max_element() < 1.0;
                let inside = matches!(self, Source::Point(p) if within(*p));
                (outward.dot(view) < 0.0) == inside
            }
            _ => false,
        };
        let seen: Vec<(u32, DVec3)> = e
            .sides()
            .map(|(id, face, _)| (id, of(id).shape.normal(face, middle)))
            .filter(|&(id, n)| !hidden(id, n))
            .collect();
        seen.iter().enumerate().any(|(k, &(i, n))| {
            seen[..k].iter().any(|&(j, m)| {
                if creases == Creases::Sharp {
                    return n.dot(m) < SHARP && n.cross(m).length() > FLAT;
                }
                let other = of(i).surface != of(j).surface || of(i).light != of(j).light;
                other || (!(i == j && smooth(i)) && (n.cross(m).length() > FLAT || n.dot(m) < 0.0))
            })
        })
    }
}
