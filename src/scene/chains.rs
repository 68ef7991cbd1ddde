//! Sequences of flat smooth faces by which lights without extent are connected to ([`crate::transport::chain`]): through a pane of glass, by way of two mirrors, out of a block.
//!
//! Listed once for each light, by half-spaces: a face follows another where some corner of it lies on the side that light leaves to, and some corner of the other on the side that it is met from; closed blocks are met
//! from outside unless light is inside. One face alone is [`super::panes`]'s.

use super::{Instance, Scene, beams};
use crate::light::Light;
use crate::math::fold::{Fold, MOST};
use crate::math::fresnel;
use crate::math::{DVec2, DVec3, V3};
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use smallvec::SmallVec;
use std::f64::consts::FRAC_PI_2;

/// Chains of a scene at most: every vertex asks for all of them.
const CHAINS: usize = 2048;
/// Reflections at glass are asked for so often each: where they are not total they bring a few per cent.
const INSIDE: f64 = 0.25;
/// Of angles, and of lengths over the scene's radius, for rounding.
const SLACK: f64 = 1e-9;

/// A face of a chain.
#[derive(Clone, Debug)]
pub struct Link {
    pub shape: u32,
    pub face: u32,
    pub fold: Fold,
    /// Light meets its front.
    pub front: bool,
    /// Points of its border, and the directions across it there, into the face; empty where it is none of lines.
    border: SmallVec<[(DVec3, DVec3); 4]>,
}

impl Link {
    /// Whether a point of its plane lies on it, but for rounding.
    pub fn holds(&self, p: DVec3) -> bool {
        let slack = |c: DVec3| 1e-9 * (p - c).length();
        self.border.iter().all(|&(c, m)| (p - c).dot(m) >= -slack(c))
    }
}

/// A sequence of faces.
#[derive(Clone, Debug)]
pub struct Chain {
    pub light: u32,
    pub links: Vec<Link>,
    /// How often it is asked for.
    pub asked: f64,
}

/// All of them.
#[derive(Clone, Debug, Default)]
pub struct Chains {
    pub list: Vec<Chain>,
    /// Some were left out: there are too many.
    pub cut: bool,
}

struct Search<'a> {
    scene: &'a Scene,
    faces: Vec<Link>,
    corners: Vec<Vec<DVec3>>,
    longest: usize,
    found: Chains,
}

/// What has become of the light so far.
#[derive(Clone)]
struct Way {
    links: Vec<usize>,
    chain: Vec<Link>,
    /// Closed shapes that it is in.
    inside: Vec<u32>,
    asked: f64,
    /// What its directions are within: an axis and an angle about it.
    cone: Option<(DVec3, f64)>,
}

impl Way {
    /// Whether any of its directions is within an angle of this one.
    fn turns_to(&self, w: DVec3, within: f64) -> bool {
        self.cone.is_none_or(|(axis, angle)| axis.dot(w).clamp(-1.0, 1.0).acos() <= angle + within + SLACK)
    }
}

/// Where light stands, or the direction that it comes from.
#[derive(Clone, Copy)]
enum From {
    Point(DVec3),
    Toward(DVec3),
}

impl From {
    fn of(light: &Light) -> Option<From> {
        let far = || light.single_direction().map(From::Toward);
        light.is_delta().then(|| light.center().map(From::Point).or_else(far))?
    }

    /// Directions toward a face.
    fn cone(self, corners: &[DVec3]) -> Option<(DVec3, f64)> {
        let From::Point(q) = self else { return self.toward().map(|w| (w, 0.0)) };
        let to = |c: &DVec3| (*c - q).normalize();
        let axis = corners.iter().map(to).sum::<DVec3>().try_normalize()?;
        // A cone of less than a right angle is convex: it holds the face if it holds its corners.
        let least = corners.iter().map(|c| to(c).dot(axis)).fold(1.0, f64::min);
        (least > SLACK && corners.len() == 4).then(|| (axis, least.acos()))
    }

    fn toward(self) -> Option<DVec3> {
        match self {
            From::Toward(w) => Some(-w),
            From::Point(_) => None,
        }
    }

    fn height(self, p: DVec3, n: DVec3) -> f64 {
        match self {
            From::Point(q) => (q - p).dot(n),
            From::Toward(w) => w.dot(n),
        }
    }
}

impl Search<'_> {
    /// Sides (front or not) from which light on the way may meet a face.
    fn sides(&self, way: &Way, from: From, k: usize) -> SmallVec<[bool; 2]> {
        let f = &self.faces[k];
        let (p, n) = (f.fold.p, f.fold.n);
        let shape = &self.scene.shapes[f.shape as usize].shape;
        let reaches = |front: bool| {
            let sign = if front { 1.0 } else { -1.0 };
            if shape.is_closed() && way.inside.contains(&f.shape) == front {
                return false;
            }
            let Some((&last, link)) = way.links.last().zip(way.chain.last()) else {
                return sign * from.height(p, n) > 0.0;
            };
            // The side that light leaves to.
            let out = if link.front == link.fold.through { -1.0 } else { 1.0 };
            let slack = SLACK * self.scene.bounds.radius();
            let ahead = |c: &DVec3| out * (*c - link.fold.p).dot(link.fold.n) > slack;
            let before = |c: &DVec3| sign * (*c - p).dot(n) > slack;
            last != k && self.corners[k].iter().any(ahead) && self.corners[last].iter().any(before)
        };
        [true, false].into_iter().filter(|&front| reaches(front)).collect()
    }

    fn grow(&mut self, light: u32, from: From, way: &Way) {
        if way.links.len() == self.longest {
            return;
        }
        for k in 0..self.faces.len() {
            for front in self.sides(way, from, k) {
                for through in [true, false] {
                    self.step(light, from, way, k, front, through);
                }
            }
        }
    }

    fn step(&mut self, light: u32, from: From, way: &Way, k: usize, front: bool, through: bool) {
        let face = &self.faces[k];
        let shape = &self.scene.shapes[face.shape as usize];
        let mut index = [1.0; 2];
        match &self.scene.surfaces[shape.surface as usize] {
            Surface::Dielectric { interior, exterior, .. } => {
                index = if front { [*exterior, *interior] } else { [*interior, *exterior] };
                if !through {
                    index[1] = index[0];
                }
            }
            Surface::Conductor { two_sided, .. } if !through && (front || *two_sided) => {}
            _ => return,
        }
        // Which way light crosses the face.
        let across = if front { -face.fold.n } else { face.fold.n };
        if !way.turns_to(across, FRAC_PI_2) {
            return;
        }
        let mut next = way.clone();
        if way.links.is_empty() {
            next.cone = from.cone(&self.corners[k]);
        }
        let [n0, n1] = index;
        if !through {
            let turn = |(axis, angle)| (fresnel::reflect(axis, face.fold.n), angle);
            next.cone = next.cone.map(turn);
        } else if n1 < n0 {
            // Out of glass, but for total reflection.
            if !way.turns_to(across, (n1 / n0).asin()) {
                return;
            }
            next.cone = None;
        } else if n1 > n0 {
            // Refraction brings directions nearer to the normal, and to each other.
            let all = (across, (n0 / n1).asin());
            let bent = next.cone.filter(|c| c.1 < all.1 && c.0.dot(across) > 0.0).and_then(|(axis, angle)| {
                let i = fresnel::Interface::new(axis.dot(across), n0, n1);
                Some((i.refract(V3::constant(axis), V3::constant(-across))?.value().normalize(), angle))
            });
            next.cone = Some(bent.unwrap_or(all));
        }
        let fold = Fold { through, index, ..face.fold };
        next.chain.push(Link { fold, front, ..face.clone() });
        next.links.push(k);
        if shape.shape.is_closed() && through {
            if front { next.inside.push(face.shape) } else { next.inside.retain(|&s| s != face.shape) }
        }
        let metal = matches!(self.scene.surfaces[shape.surface as usize], Surface::Conductor { .. });
        if !through && !metal {
            next.asked *= INSIDE;
        }
        if self.found.list.len() >= CHAINS {
            self.found.cut = true;
            return;
        }
        if next.links.len() > 1 {
            self.found.list.push(Chain { light, links: next.chain.clone(), asked: next.asked });
        }
        self.grow(light, from, &next);
    }
}

/// Its border's points and inward directions.
fn border(s: &Shape, face: u32) -> SmallVec<[(DVec3, DVec3); 4]> {
    let corners = beams::corners(s, face);
    if corners.is_empty() {
        return SmallVec::new();
    }
    let middle = corners.iter().copied().sum::<DVec3>() / corners.len() as f64;
    let n = s.normal(face, middle);
    let side = |k: usize| {
        let (a, b) = (corners[k], corners[(k + 1) % corners.len()]);
        let m = n.cross(b - a).normalize();
        (a, if m.dot(middle - a) < 0.0 { -m } else { m })
    };
    (0..corners.len()).map(side).collect()
}

impl Scene {
    /// List them; call when shapes, surfaces and lights are known.
    pub fn prepare_chains(&mut self) {
        let smooth = |s: &Instance| self.surfaces[s.surface as usize].is_smooth() && beams::is_flat(&s.shape);
        let (mut faces, mut corners) = (Vec::new(), Vec::new());
        for (id, s) in self.shapes.iter().enumerate().filter(|(_, s)| smooth(s)) {
            for face in 0..s.shape.face_count() {
                let p = s.shape.position(face, DVec2::splat(0.5));
                let fold = Fold { p, n: s.shape.normal(face, p), through: true, index: [1.0; 2] };
                faces.push(Link { shape: id as u32, face, fold, front: true, border: border(&s.shape, face) });
                let c = beams::corners(&s.shape, face);
                // Of a disk, points of its rim.
                let rim = || (0..8).map(|k| s.shape.position(face, DVec2::new(1.0 - 1e-9, k as f64 / 8.0))).collect();
                corners.push(if c.is_empty() { rim() } else { c });
            }
        }
        let longest = (self.settings.max_depth.saturating_sub(2) as usize).min(MOST);
        let mut search = Search { scene: self, faces, corners, longest, found: Chains::default() };
        for (id, light) in self.lights.iter().enumerate() {
            let Some(from) = From::of(light) else { continue };
            let within = |s: &Instance| match (&s.shape, from) {
                (Shape::Cube(c), From::Point(q)) => c.placement.local_point(q).abs().max_element() < 1.0,
                _ => false,
            };
            let inside = (0..self.shapes.len() as u32).filter(|&i| within(&self.shapes[i as usize])).collect();
            search.grow(id as u32, from, &Way { links: Vec::new(), chain: Vec::new(), inside, asked: 1.0, cone: None });
        }
        self.chains = search.found;
    }

    /// Whether nothing is smooth but flat faces.
    pub fn is_smooth_at_faces_only(&self) -> bool {
        let smooth = |s: &&Instance| self.surfaces[s.surface as usize].is_smooth();
        self.shapes.iter().filter(smooth).all(|s| beams::is_flat(&s.shape))
    }

    /// Whether some chains of flat faces that light can take are longer than those that are followed, or left out because there are too many.
    pub fn cuts_chains(&self) -> bool {
        let one = self.shows_all_delta_light();
        !one && (self.chains.cut || self.settings.max_depth as usize > MOST + 2)
    }
}
