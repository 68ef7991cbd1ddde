//! Sequences of flat smooth faces by which lights without extent are connected to ([`crate::transport::chain`]): through a pane of glass, by way of two mirrors, out of a block.
//!
//! Listed once for each light, those with few reflections at glass and few faces first. A face follows another where some corner of it lies on the side that light leaves to, and some corner of the other on the side that
//! it is met from; closed blocks are met from outside unless light is inside. Directions are followed as a cone: light from a point to a face is within one, mirrors turn it, refraction into the denser medium
//! brings directions nearer to each other, by the ratio of the indices at least, and none leaves glass beyond the critical angle. One face alone is [`super::panes`]'s.

use super::{Instance, Scene, beams};
use crate::light::Light;
use crate::math::fold::{Fold, MOST};
use crate::math::{DVec2, DVec3};
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use smallvec::SmallVec;
use std::collections::{BTreeMap, VecDeque};
use std::f64::consts::FRAC_PI_2;

/// Chains of a scene at most, and so many that a vertex asks for on average.
const CHAINS: f64 = 4096.0;
const ASKED: f64 = 100.0;
/// Ways that wait to be followed further at most: hundreds of megabytes.
const WAITING: usize = 1 << 18;
/// Reflections at glass are asked for so often each: they bring a few per cent, total ones all, but few of very many reach a vertex.
const REFLECTED: f64 = 0.25;
const TOTAL: f64 = 0.5;
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
        let slack = |c: DVec3| SLACK * (p - c).length();
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
    /// Light may meet more faces in turn than any of them has.
    pub long: bool,
    /// Faces that touch: light passes from one to the other without a way between.
    pub touching: bool,
}

struct Search<'a> {
    scene: &'a Scene,
    faces: Vec<Link>,
    /// Of a disk, those of the square around it.
    corners: Vec<[DVec3; 4]>,
    /// The front of a closed shape's face is its inside.
    flipped: Vec<bool>,
    found: Chains,
}

/// What has become of the light so far.
#[derive(Clone)]
struct Way {
    chain: Vec<Link>,
    /// The last one's place in the list.
    last: usize,
    /// Closed shapes that it is in.
    inside: Vec<u32>,
    /// Reflections at glass that are not total, and those that are.
    weak: u32,
    total: u32,
    /// What its directions are within: an axis and an angle about it.
    cone: Option<(DVec3, f64)>,
}

impl Way {
    fn angle_to(&self, w: DVec3) -> Option<(f64, f64)> {
        self.cone.map(|(axis, angle)| (axis.dot(w).clamp(-1.0, 1.0).acos(), angle))
    }

    /// Whether any of its directions is within an angle of this one.
    fn turns_to(&self, w: DVec3, within: f64) -> bool {
        self.angle_to(w).is_none_or(|(off, angle)| off <= angle + within + SLACK)
    }

    /// Whether none of them is.
    fn turns_from(&self, w: DVec3, within: f64) -> bool {
        self.angle_to(w).is_some_and(|(off, angle)| off - angle > within + SLACK)
    }
}

/// Where light stands, or the direction from which it comes.
#[derive(Clone, Copy)]
enum Source {
    Point(DVec3),
    Toward(DVec3),
}

impl Source {
    fn of(light: &Light) -> Option<Source> {
        let far = || light.single_direction().map(Source::Toward);
        light.is_delta().then(|| light.center().map(Source::Point).or_else(far))?
    }

    /// Directions to a face.
    fn cone(self, corners: &[DVec3; 4]) -> Option<(DVec3, f64)> {
        let q = match self {
            Source::Point(q) => q,
            Source::Toward(w) => return Some((-w, 0.0)),
        };
        let to = |c: &DVec3| (*c - q).normalize();
        let axis = corners.iter().map(to).sum::<DVec3>().try_normalize()?;
        // A cone of less than a right angle is convex: it holds the face if it holds its corners.
        let least = corners.iter().map(|c| to(c).dot(axis)).fold(1.0, f64::min);
        (least > SLACK).then(|| (axis, least.acos()))
    }

    fn height(self, p: DVec3, n: DVec3) -> f64 {
        match self {
            Source::Point(q) => (q - p).dot(n),
            Source::Toward(w) => w.dot(n),
        }
    }
}

impl Search<'_> {
    /// Whether light on the way may meet a face from its front, or from its back.
    fn meets(&self, way: &Way, from: Source, k: usize, front: bool) -> bool {
        let f = &self.faces[k];
        let (p, n) = (f.fold.p, f.fold.n);
        let sign = if front { 1.0 } else { -1.0 };
        let closed = self.scene.shapes[f.shape as usize].shape.is_closed();
        if closed && way.inside.contains(&f.shape) != (front == self.flipped[k]) {
            return false;
        }
        let Some(link) = way.chain.last() else { return sign * from.height(p, n) > 0.0 };
        // The side that light leaves to.
        let out = if link.front == link.fold.through { -1.0 } else { 1.0 };
        let slack = SLACK * self.scene.bounds.radius();
        let ahead = |c: &DVec3| out * (*c - link.fold.p).dot(link.fold.n) > slack;
        let before = |c: &DVec3| sign * (*c - p).dot(n) > slack;
        way.last != k && self.corners[k].iter().any(ahead) && self.corners[way.last].iter().any(before)
    }

    /// The way behind a face; `None` where no light goes there.
    fn step(&self, from: Source, way: &Way, k: usize, front: bool, through: bool) -> Option<Way> {
        let face = &self.faces[k];
        let shape = &self.scene.shapes[face.shape as usize];
        let (index, glass) = match &self.scene.surfaces[shape.surface as usize] {
            Surface::Dielectric { interior, exterior, .. } => {
                (if front { [*exterior, *interior] } else { [*interior, *exterior] }, true)
            }
            Surface::Conductor { two_sided, .. } if !through && (front || *two_sided) => ([1.0; 2], false),
            _ => return None,
        };
        let fold = Fold { through, index, ..face.fold };
        let mut next = way.clone();
        if way.chain.is_empty() {
            next.cone = from.cone(&self.corners[k]);
        }
        // Which way light crosses the face.
        let across = if front { -fold.n } else { fold.n };
        if !next.turns_to(across, FRAC_PI_2) {
            return None;
        }
        let eta = index[1] / index[0];
        let critical = if eta < 1.0 { eta.asin() } else { FRAC_PI_2 };
        if !through {
            let total = next.turns_from(across, critical);
            next.weak += u32::from(glass && !total);
            next.total += u32::from(glass && total);
        } else if !next.turns_to(across, critical) {
            return None;
        }
        // Where the axis itself goes on; refraction into a thinner medium spreads all others.
        let bent = next.cone.filter(|c| c.0.dot(across) > 0.0).and_then(|c| Some((fold.behind(c.0)?, c.1)));
        next.cone = match bent {
            _ if !through => next.cone.and_then(|c| Some((fold.behind(c.0)?, c.1))),
            Some((axis, angle)) if eta >= 1.0 => Some((axis, angle / eta)),
            Some((axis, 0.0)) => Some((axis, 0.0)),
            _ => None,
        };
        if through && eta > 1.0 && next.cone.is_none_or(|c| c.1 > (1.0 / eta).asin()) {
            next.cone = Some((across, (1.0 / eta).asin()));
        }
        if shape.shape.is_closed() && through {
            let enters = front != self.flipped[k];
            if enters { next.inside.push(face.shape) } else { next.inside.retain(|&s| s != face.shape) }
        }
        next.chain.push(Link { fold, front, ..face.clone() });
        next.last = k;
        Some(next)
    }

    /// All chains of a light, or what is its `share` of those that there may be.
    fn all(&mut self, light: u32, from: Source, inside: Vec<u32>, longest: usize, share: f64) {
        let begin = Way { chain: Vec::new(), last: usize::MAX, inside, weak: 0, total: 0, cone: None };
        // By reflections at glass, then by faces.
        let mut open: BTreeMap<(u32, usize), VecDeque<Way>> = BTreeMap::from([((0, 0), VecDeque::from([begin]))]);
        let (mut listed, mut sum, mut waiting) = (0.0, 0.0, 1);
        while let Some(mut first) = open.first_entry() {
            let Some(way) = first.get_mut().pop_front() else {
                first.remove();
                continue;
            };
            waiting -= 1;
            if way.chain.len() > 1 {
                let asked = REFLECTED.powi(way.weak as i32) * TOTAL.powi(way.total as i32);
                (listed, sum) = (listed + 1.0, sum + asked);
                if listed > CHAINS * share || sum > ASKED * share {
                    self.found.cut = true;
                    return;
                }
                self.found.list.push(Chain { light, links: way.chain.clone(), asked });
            }
            for (k, front) in (0..self.faces.len()).flat_map(|k| [(k, true), (k, false)]) {
                if !self.meets(&way, from, k, front) {
                    continue;
                }
                for next in [true, false].map(|through| self.step(from, &way, k, front, through)).into_iter().flatten()
                {
                    if waiting >= WAITING {
                        self.found.cut = true;
                    } else if next.chain.len() <= longest {
                        waiting += 1;
                        open.entry((next.weak + next.total, next.chain.len())).or_default().push_back(next);
                    } else {
                        self.found.long = true;
                    }
                }
            }
        }
    }

    /// Whether two faces of different shapes lie in one another.
    fn touch(&self) -> bool {
        let slack = SLACK * self.scene.bounds.radius();
        let n = self.faces.len();
        (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))).any(|(a, b)| {
            let (f, g) = (&self.faces[a], &self.faces[b]);
            let flat = |p: DVec3| (p - f.fold.p).dot(f.fold.n).abs() <= slack;
            let meets = || {
                let inner = |from: usize, link: &Link| {
                    let c = self.corners[from];
                    let middle = (c[0] + c[1] + c[2] + c[3]) / 4.0;
                    c.iter().map(|p| *p + (middle - *p) * 1e-6).chain([middle]).any(|p| link.holds(p))
                };
                inner(a, g) || inner(b, f)
            };
            f.shape != g.shape && self.corners[b].iter().all(|&p| flat(p)) && meets()
        })
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
        let sources: Vec<(u32, Source)> =
            self.lights.iter().zip(0..).filter_map(|(l, id)| Some((id, Source::of(l)?))).collect();
        if sources.is_empty() {
            return;
        }
        let smooth = |s: &Instance| self.surfaces[s.surface as usize].is_smooth() && beams::is_flat(&s.shape);
        let mut search =
            Search { scene: self, faces: vec![], corners: vec![], flipped: vec![], found: Chains::default() };
        for (id, s) in self.shapes.iter().enumerate().filter(|(_, s)| smooth(s)) {
            for face in 0..s.shape.face_count() {
                let at = |u: f64, v: f64| s.shape.position(face, DVec2::new(u, v));
                let p = at(0.25, 0.25);
                let fold = Fold { p, n: s.shape.normal(face, p), through: true, index: [1.0; 2] };
                search.faces.push(Link { shape: id as u32, face, fold, front: true, border: border(&s.shape, face) });
                let corners = <[DVec3; 4]>::try_from(beams::corners(&s.shape, face));
                search.corners.push(corners.unwrap_or_else(|_| {
                    let c = at(0.0, 0.0);
                    let (a, b) = (at(1.0, 0.0) - c, at(1.0, 0.25) - c);
                    [c + a + b, c + a - b, c - a - b, c - a + b]
                }));
                search.flipped.push(fold.n.dot(p - s.shape.bounds().center()) < 0.0);
            }
        }
        search.found.touching = search.touch();
        let longest = (self.settings.max_depth.saturating_sub(2) as usize).min(MOST);
        for &(id, from) in &sources {
            let within = |s: &Instance| match (&s.shape, from) {
                (Shape::Cube(c), Source::Point(q)) => c.placement.local_point(q).abs().max_element() < 1.0,
                _ => false,
            };
            let inside = (0..self.shapes.len() as u32).filter(|&i| within(&self.shapes[i as usize])).collect();
            search.all(id, from, inside, longest, 1.0 / sources.len() as f64);
        }
        search.found.long &= self.settings.max_depth as usize > MOST + 2;
        self.chains = search.found;
    }

    /// Whether nothing is smooth but flat faces.
    pub fn is_smooth_at_faces_only(&self) -> bool {
        let smooth = |s: &&Instance| self.surfaces[s.surface as usize].is_smooth();
        self.shapes.iter().filter(smooth).all(|s| beams::is_flat(&s.shape))
    }
}
