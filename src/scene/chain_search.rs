//! Finds the sequences of faces ([`super::chains`]) by which light goes, once for each light: those with few reflections at glass and few faces first.
//!
//! Light is followed as a pencil ([`crate::math::pencil`]): from a face's ball, along a cone that mirrors turn and that refraction
//! narrows or widens; that of a lamp begins at the ball around it. A face follows another where the pencil reaches it, some corner of it lies on the side that light leaves to, and some corner of the other on the side that
//! it is met from; closed shapes are met from outside unless light is inside. None of this leaves out anything that light can take. One face alone is [`super::panes`]'s, unless it is a mesh's or the light a lamp.
//!
//! Beams are followed here where a chain has a mesh's facet; other chains are [`super::beams`]'s.

use super::chains::{Chain, Chains, Face, Link, MOST, SLACK, face, has_flat_faces, height};
use super::reach::Reach;
use super::{Instance, Scene, beams, bodies};
use crate::light::{Light, LightKind, Origin};
use crate::math::ball_tree::{Ball, BallTree};
use crate::math::pencil::{Cone, Pencil};
use crate::math::{DVec2, DVec3};
use crate::shape::edges::sides;
use crate::shape::triangles::around_disk;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use rayon::prelude::*;
use smallvec::SmallVec;
use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

/// Chains of a scene at most, and so many that a point of it asks for on average.
const CHAINS: f64 = 262_144.0;
const ASKED: f64 = 1000.0;
/// Chains of all lamps at most, and facets: all else is left to chance.
const CHAINS_OF_LAMPS: f64 = 16_384.0;
const FACETS_BESIDE_LAMPS: u64 = 16_384;
/// Ways that wait to be followed further at most: hundreds of megabytes. Facets at most.
const WAITING: usize = 1 << 20;
const FACES: usize = 1 << 20;
/// Reflections at glass are asked for so often each: they bring a few per cent, total ones all, but few of very many reach a vertex.
const REFLECTED: f64 = 0.1;
const TOTAL: f64 = 0.5;

/// What light may do at a shape's faces.
#[derive(Clone, Copy)]
struct Sense {
    /// It has an inside; the front of its faces is that.
    is_closed: bool,
    is_turned: bool,
}

struct Search<'a> {
    scene: &'a Scene,
    /// Of every shape.
    senses: Vec<Sense>,
    /// Balls of faces.
    near: BallTree,
    /// Pencils behind the chains found.
    pencils: Vec<Pencil>,
    found: Chains,
}

/// What has become of the light so far.
#[derive(Clone)]
struct Way {
    links: SmallVec<[Link; MOST]>,
    /// Closed shapes that it is in.
    inside: SmallVec<[u32; 2]>,
    /// The same as bodies; `None` where that is not told.
    within: Option<bodies::Set>,
    /// Reflections at glass that are not total, and those that are.
    weak: u32,
    total: u32,
    /// Behind the last face.
    pencil: Option<Pencil>,
    by_facets: bool,
}

/// Where light comes from.
#[derive(Clone, Copy)]
enum Source {
    Origin(Origin<f64>),
    /// A lamp within a ball.
    Lamp(Ball),
}

impl Source {
    /// Whether any of it comes from before a plane, > 0, or from behind, < 0.
    fn is_on(&self, sign: f64, p: DVec3, n: DVec3) -> bool {
        match self {
            Source::Origin(from) => sign * height(*from, p, n) > 0.0,
            Source::Lamp(b) => sign * (b.center - p).dot(n) > -b.radius,
        }
    }
}

/// How many chains are listed at most, and so many of them that a point of the scene asks for on average.
#[derive(Clone, Copy)]
struct Limits {
    listed: f64,
    asked: f64,
}

/// Directions of light to a face.
fn cone(from: Source, corners: &[DVec3]) -> Cone {
    match from {
        Source::Origin(Origin::Position(q)) => Cone::around(corners.iter().map(|&c| (c - q.value()).normalize())),
        Source::Origin(Origin::Infinity(w)) => Cone { axis: w.value(), angle: 0.0 },
        Source::Lamp(_) => Cone::ALL,
    }
}

impl Search<'_> {
    /// Whether light on the way may meet a face from its front, or from its back.
    fn meets(&self, way: &Way, from: Source, k: u32, front: bool) -> bool {
        let f = &self.found.faces[k as usize];
        let sign = if front { 1.0 } else { -1.0 };
        let sense = self.senses[f.shape as usize];
        if sense.is_closed && way.inside.contains(&f.shape) != (front == sense.is_turned)
            || !self.scene.bodies.may_meet(f.shape, way.within)
        {
            return false;
        }
        let Some(link) = way.links.last() else { return from.is_on(sign, f.p, f.n) };
        let last = &self.found.faces[link.face as usize];
        // The side that light leaves to.
        let out = if link.front == link.through { -1.0 } else { 1.0 };
        let slack = SLACK * self.scene.bounds.radius();
        let ahead = |c: &DVec3| out * (*c - last.p).dot(last.n) > slack;
        let before = |c: &DVec3| sign * (*c - f.p).dot(f.n) > slack;
        link.face != k && f.corners.iter().any(ahead) && last.corners.iter().any(before)
    }

    /// The way behind a face; `None` where no light goes there.
    fn step(&self, from: Source, way: &Way, k: u32, front: bool, through: bool) -> Option<Way> {
        let face = &self.found.faces[k as usize];
        let shape = &self.scene.shapes[face.shape as usize];
        let glass = match &self.scene.surfaces[shape.surface as usize] {
            Surface::Dielectric { .. } => true,
            Surface::Conductor { two_sided, .. } if !through && (front || *two_sided) => false,
            _ => return None,
        };
        let link = Link { face: k, front, through };
        let [n0, n1] = self.found.fold(self.scene, &link).index;
        let arrives = way.pencil.map_or_else(|| cone(from, &face.corners), |p| p.toward(face.center, face.radius));
        let last = way.links.last().map(|l| &self.found.faces[l.face as usize]);
        let misses =
            |l: &Face| l.is_missed(&arrives, face.center, face.radius) || face.is_missed(&arrives, l.center, l.radius);
        if last.is_some_and(misses) {
            return None;
        }
        // Which way light crosses the face.
        let across = if front { -face.n } else { face.n };
        if !arrives.turns_to(across, FRAC_PI_2) {
            return None;
        }
        let behind = if through { arrives.refracted(across, n0 / n1)? } else { arrives.mirrored(face.n) };
        let mut next = way.clone();
        if glass && !through {
            let total = n1 < n0 && arrives.turns_from(across, (n1 / n0).asin());
            (next.weak, next.total) = (next.weak + u32::from(!total), next.total + u32::from(total));
        }
        let sense = self.senses[face.shape as usize];
        if sense.is_closed && through {
            let enters = front != sense.is_turned;
            if enters {
                next.inside.push(face.shape)
            } else {
                next.inside.retain(|s| *s != face.shape)
            }
            next.within = next.within.map(|set| set ^ self.scene.bodies.of(face.shape));
        }
        next.links.push(link);
        next.pencil = Some(Pencil::new(face.center, face.radius, behind));
        next.by_facets |= face.is_facet;
        Some(next)
    }

    /// Faces that light may meet next.
    fn candidates(&self, light: &Light, way: &Way) -> Vec<u32> {
        let mut found = Vec::new();
        match (&way.pencil, &light.kind) {
            (Some(p), _) => self.near.find(|b| p.reaches(b.center, b.radius), &mut |k| found.push(k)),
            (None, LightKind::Beam { position, direction, radius, gaussian }) => {
                let reach = radius * if *gaussian { beams::GAUSSIAN } else { 1.0 };
                let is_lit = |f: &Face| {
                    let m = f.center - *position;
                    let along = m.dot(*direction);
                    along > -f.radius && (m - *direction * along).length() < reach + f.radius
                };
                found.extend((0..).zip(self.found.faces.iter()).filter(|(_, f)| is_lit(f)).map(|(k, _)| k));
            }
            (None, _) => found.extend(0..self.found.faces.len() as u32),
        }
        found
    }

    /// All chains of a light, as far as the limits go.
    fn all(&mut self, id: u32, from: Source, longest: usize, limits: Limits) {
        let light = &self.scene.lights[id as usize];
        let slack = SLACK * self.scene.bounds.radius();
        let (stands, pencil) = match from {
            Source::Origin(_) => (light.stands(), None),
            Source::Lamp(b) => (Some(b.center), Some(Pencil::new(b.center, b.radius, Cone::ALL))),
        };
        let inside = self.holders(stands);
        let within = stands.map_or(Some(0), |q| self.scene.bodies.around_lamp(q, slack));
        let begin = Way { links: SmallVec::new(), inside, within, weak: 0, total: 0, pencil, by_facets: false };
        let is_beam = matches!(light.kind, LightKind::Beam { .. });
        // Others list single faces of what is no mesh.
        let least = if matches!(from, Source::Lamp(_)) { 1 } else { 2 };
        // By reflections at glass, then by faces.
        let mut open: BTreeMap<(u32, usize), VecDeque<Way>> = BTreeMap::from([((0, 0), VecDeque::from([begin]))]);
        let (mut listed, mut sum, mut waiting) = (0.0, 0.0, 1);
        while let Some(mut first) = open.first_entry() {
            let Some(way) = first.get_mut().pop_front() else {
                first.remove();
                continue;
            };
            waiting -= 1;
            let counts = way.by_facets || !is_beam && way.links.len() >= least;
            if let Some(pencil) = way.pencil.filter(|_| counts) {
                let asked = REFLECTED.powi(way.weak as i32) * TOTAL.powi(way.total as i32);
                listed += 1.0;
                sum += asked * pencil.share(self.scene.bounds.radius());
                if listed > limits.listed || sum > limits.asked {
                    self.found.cut = true;
                    return;
                }
                self.found.list.push(Chain { light: id, links: way.links.clone(), asked });
                self.pencils.push(pencil);
            }
            for (k, front) in self.candidates(light, &way).into_iter().flat_map(|k| [(k, true), (k, false)]) {
                if !self.meets(&way, from, k, front) {
                    continue;
                }
                for next in [true, false].map(|through| self.step(from, &way, k, front, through)).into_iter().flatten()
                {
                    if next.links.len() > longest {
                        self.found.long |= next.by_facets || !is_beam;
                        continue;
                    }
                    open.entry((next.weak + next.total, next.links.len())).or_default().push_back(next);
                    waiting += 1;
                    // The least simple one goes.
                    while waiting > WAITING {
                        self.found.cut = true;
                        let Some(mut last) = open.last_entry() else { break };
                        if last.get_mut().pop_back().is_some() { waiting -= 1 } else { _ = last.remove() }
                    }
                }
            }
        }
    }

    /// Closed shapes that a light stands in.
    fn holders(&self, stands: Option<DVec3>) -> SmallVec<[u32; 2]> {
        let within = |s: &Instance, q: DVec3| match &s.shape {
            Shape::Cube(c) => c.placement.local_point(q).abs().max_element() < 1.0,
            Shape::Mesh(m) => winding((0..s.shape.face_count()).map(|f| m.corners(f)), q).abs() > 0.5,
            _ => false,
        };
        let smooth = |i: &u32| self.scene.surface_of(*i).is_smooth();
        let all = (0..self.scene.shapes.len() as u32).filter(smooth);
        stands.map_or_else(SmallVec::new, |q| all.filter(|&i| within(&self.scene.shapes[i as usize], q)).collect())
    }

    /// Whether two faces of different shapes lie in one another.
    fn touch(&self) -> bool {
        let (faces, slack) = (&self.found.faces, SLACK * self.scene.bounds.radius());
        let lie = |a: usize, b: usize| {
            let (f, g) = (&faces[a], &faces[b]);
            let flat = |p: DVec3| (p - f.p).dot(f.n).abs() <= slack;
            if f.shape == g.shape || !g.corners.iter().all(|&p| flat(p)) {
                return false;
            }
            let [f, g] = [f, g].map(|f| match &self.scene.shapes[f.shape as usize].shape {
                Shape::Disk(d) => around_disk(d).to_vec(),
                _ => f.corners.to_vec(),
            });
            // Convex polygons are apart if a side of one has all of the other before it.
            let apart = |f: &[DVec3], g: &[DVec3]| sides(f).any(|(a, m)| g.iter().all(|p| (*p - a).dot(m) <= slack));
            !apart(&f, &g) && !apart(&g, &f)
        };
        (0..faces.len()).into_par_iter().any(|a| {
            let (mut near, f) = (Vec::new(), &faces[a]);
            let meets = |b: &Ball| (b.center - f.center).length() <= b.radius + f.radius + slack;
            self.near.find(meets, &mut |b| near.push(b as usize));
            near.into_iter().any(|b| b > a && lie(a, b))
        })
    }
}

/// How often a closed mesh goes round a point: the solid angles of its triangles over 4π (van Oosterom and Strackee, 1983).
fn winding(triangles: impl Iterator<Item = [DVec3; 3]>, q: DVec3) -> f64 {
    let angle = |t: [DVec3; 3]| {
        let [a, b, c] = t.map(|p| p - q);
        let [x, y, z] = [a, b, c].map(DVec3::length);
        2.0 * a.dot(b.cross(c)).atan2(x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y)
    };
    triangles.map(angle).sum::<f64>() / (4.0 * PI)
}

impl Scene {
    /// Whether chains may lead by a shape.
    fn has_links(&self, s: &Instance) -> bool {
        self.surfaces[s.surface as usize].is_smooth() && has_flat_faces(s)
    }

    /// A search among all faces that chains may lead by.
    fn search(&self) -> Search<'_> {
        let (mut faces, mut cut) = (Vec::new(), false);
        for (id, s) in (0..).zip(&self.shapes).filter(|(_, s)| self.has_links(s)) {
            let n = s.shape.face_count();
            if faces.len() + n as usize > FACES {
                cut = true;
                continue;
            }
            faces.extend((0..n).filter_map(|f| face(id, &s.shape, f)));
        }
        let sense = |s: &Instance| match &s.shape {
            Shape::Mesh(m) => {
                let t = m.topology();
                // Of several parts one may be in another, or turned against it.
                let is_body = t.is_closed() && t.is_consistently_oriented() && t.pieces(&m.faces) == 1;
                Sense { is_closed: is_body, is_turned: t.is_inside_out() }
            }
            flat => {
                let p = flat.position(0, DVec2::splat(0.25));
                let is_turned = flat.normal(0, p).dot(p - flat.bounds().center()) < 0.0;
                Sense { is_closed: flat.is_closed(), is_turned }
            }
        };
        let ball = |f: &Face| Ball { center: f.center, radius: f.radius };
        let near = BallTree::new(faces.iter().map(ball).collect());
        let found = Chains { faces: Arc::new(faces), cut, ..Chains::default() };
        Search { scene: self, senses: self.shapes.iter().map(sense).collect(), near, pencils: Vec::new(), found }
    }

    /// Faces of a chain at most, as far as the picture counts scatterings.
    fn longest_chain(&self) -> usize {
        (self.settings.max_depth.saturating_sub(2) as usize).min(MOST)
    }

    /// List them; call when shapes, surfaces and lights are known.
    pub fn prepare_chains(&mut self) {
        let mut sources: Vec<(u32, Origin<f64>)> =
            (0..).zip(&self.lights).filter_map(|(id, l)| Some((id, l.origin()?))).collect();
        if sources.is_empty() {
            return;
        }
        let mut search = self.search();
        search.found.touching = search.touch();
        if !self.shapes.iter().any(|s| self.has_links(s) && matches!(s.shape, Shape::Mesh(_))) {
            sources.retain(|s| self.lights[s.0 as usize].is_delta());
        }
        let share = 1.0 / sources.len() as f64;
        for &(id, from) in &sources {
            let limits = Limits { listed: CHAINS * share, asked: ASKED * share };
            search.all(id, Source::Origin(from), self.longest_chain(), limits);
        }
        let Search { mut found, pencils, .. } = search;
        found.reach = Reach::of(pencils, &found.list);
        found.long &= self.settings.max_depth as usize > MOST + 2;
        self.chains = found;
    }

    /// By which faces light of each lamp (light and shape) goes, and about how many of these chains a vertex would ask for; they are asked for less often where that is more than `asked`. None where lamps touch glass, or there are too many faces.
    pub(super) fn chains_of_lamps(&self, lamps: &[(u32, u32)], asked: f64) -> Vec<(Chains, f64)> {
        let faces: u64 =
            self.shapes.iter().filter(|s| self.has_links(s)).map(|s| u64::from(s.shape.face_count())).sum();
        if !(1..=FACETS_BESIDE_LAMPS).contains(&faces) {
            return lamps.iter().map(|_| Default::default()).collect();
        }
        let mut search = self.search();
        let limits = Limits { listed: CHAINS_OF_LAMPS / lamps.len() as f64, asked: ASKED };
        let size = self.bounds.radius();
        let of_lamp = |&(light, shape): &(u32, u32)| {
            let lamp = &self.shapes[shape as usize];
            if !self.is_clear_of_glass(lamp) {
                return Default::default();
            }
            let bounds = lamp.shape.bounds();
            let ball = Ball { center: bounds.center(), radius: bounds.radius() };
            search.all(light, Source::Lamp(ball), self.longest_chain(), limits);
            let (mut list, pencils) = (std::mem::take(&mut search.found.list), std::mem::take(&mut search.pencils));
            let all: f64 = list.iter().zip(&pencils).map(|(c, p)| c.asked * p.share(size)).sum();
            list.iter_mut().for_each(|c| c.asked *= (asked / all).min(1.0));
            let reach = Reach::of(pencils, &list);
            (Chains { faces: search.found.faces.clone(), list, reach, ..Chains::default() }, all)
        };
        lamps.iter().map(of_lamp).collect()
    }
}
