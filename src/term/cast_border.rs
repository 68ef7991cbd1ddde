//! What casts shadows of lights without extent by way of flat faces, or of a ball of metal ([`super::cast`]): edges of what is smooth or opaque, rims of what is opaque and of round mirrors, of what is opaque the outlines of balls and walls (cylinders), too, and the outline of a ball of metal. Of a hard-edged beam its own edge, a circle, is such a border, too.
//!
//! An outline is where light touches the surface, `<w(z), N(z)> = 0` with w the light's direction at z: one place on each meridian of a ball, counted from where light meets it first, and two at each height of a wall. Its sheet has
//! the surface's normal there, so that f = <x_k - e, N> tells it as it tells that of an edge (an edge's own plane is across the edge, an outline's across the light), and e moves with the surface's matter.

use super::cast::is_opaque;
use super::cast_route::lone_mirror;
use super::cast_sheet::Grazed;
use super::ends;
use super::rims::Rim;
use crate::math::root::root;
use crate::math::{DMat3, DVec3, warp};
use crate::scene::chains::Face;
use crate::scene::{Instance, Scene};
use crate::shape::edges::{border, sides, with_corners};
use crate::shape::{Cylinder, Geometry, Shape};
use smallvec::SmallVec;
use std::f64::consts::{PI, TAU};

/// How far from opposite the directions into two faces of one plane may be.
const FLAT: f64 = 1e-12;
/// Pieces of half a turn between whose ends light is looked for that touches a surface.
const HALF_TURN: usize = 6;
/// How far from the border on either side light is asked for, in scene radii: Embree's f32 rays must tell which face is met. Of thin round things at most the share `THIN` of their radius.
const ASIDE: f64 = 1e-5;
const THIN: f64 = 0.1;
/// Share of a border between two places that tell how it runs.
pub const BESIDE: f64 = 1e-5;

/// A line from which light goes on on one side.
#[derive(Clone, Debug)]
pub struct Border {
    pub line: Line,
    /// Shape and face, of a cylinder the rim: its matter goes with the first. None of a beam.
    pub faces: SmallVec<[(u32, u32); 2]>,
    /// Directions into its faces, of an edge.
    pub into: SmallVec<[DVec3; 2]>,
}

/// Where a border is. The outline of a ball has axes once it is known how light comes: toward where that meets it first, and across.
#[derive(Clone, Copy, Debug)]
pub enum Line {
    Edge([DVec3; 2]),
    /// The ellipse `c + x cos + y sin`.
    Rim {
        c: DVec3,
        x: DVec3,
        y: DVec3,
    },
    Ball {
        c: DVec3,
        r: f64,
        axes: Option<[DVec3; 3]>,
    },
    /// From outside, on one side of the light.
    Wall {
        q: Cylinder,
        left: bool,
    },
}

/// A place of a border.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub z: DVec3,
    /// The light's direction there.
    pub comes: DVec3,
    /// Unit, in the sheet and not along the light.
    pub along: DVec3,
}

impl Border {
    fn edge(ends: [DVec3; 2], face: (u32, u32), into: SmallVec<[DVec3; 2]>) -> Border {
        Border { line: Line::Edge(ends), faces: SmallVec::from_iter([face]), into }
    }

    fn round(line: Line, faces: impl IntoIterator<Item = (u32, u32)>) -> Border {
        Border { line, faces: faces.into_iter().collect(), into: SmallVec::new() }
    }

    /// The edge of a beam: a circle around its axis, which belongs to nothing.
    pub fn of_beam(position: DVec3, direction: DVec3, radius: f64) -> Border {
        let (x, y) = warp::frame(direction);
        Border::round(Line::Rim { c: position, x: x * radius, y: y * radius }, [])
    }

    /// Whether it is the edge of a beam.
    pub fn is_of_beam(&self) -> bool {
        self.faces.is_empty()
    }

    /// The face whose matter it goes with, if it is not a beam's.
    pub fn matter(&self) -> Option<(u32, u32)> {
        self.faces.first().copied()
    }

    /// The face whose matter it goes with: not of a beam's.
    pub fn own(&self) -> (u32, u32) {
        self.faces[0]
    }

    /// What lines that graze it leave out.
    pub fn grazed(&self) -> Grazed {
        let mut grazed = Grazed::new();
        for &(shape, face) in &self.faces {
            // No line meets a wall that it touches.
            let named = if let Line::Wall { .. } = self.line { vec![] } else { vec![face] };
            match grazed.iter_mut().find(|g| g.0 == shape) {
                Some(known) => known.1.extend(named),
                None => grazed.push((shape, named)),
            }
        }
        grazed
    }

    /// Whether it is the edge between two points.
    fn is_at(&self, scene: &Scene, ends: &[DVec3; 2]) -> bool {
        self.ends().is_some_and(|own| is_same(scene, own, ends))
    }

    /// The ends of an edge.
    pub fn ends(&self) -> Option<&[DVec3; 2]> {
        match &self.line {
            Line::Edge(ends) => Some(ends),
            _ => None,
        }
    }

    /// How far from it on either side light is asked for.
    pub fn aside(&self, scene: &Scene) -> f64 {
        let own = match self.line {
            Line::Edge(_) => f64::INFINITY,
            Line::Rim { x, y, .. } => x.length().min(y.length()),
            Line::Ball { r, .. } => r,
            Line::Wall { q, .. } => q.radius,
        };
        (ASIDE * scene.bounds.radius()).min(THIN * own)
    }

    /// Whether it goes all around something.
    pub fn is_closed(&self) -> bool {
        matches!(self.line, Line::Rim { .. } | Line::Ball { .. })
    }

    /// About its length.
    pub fn length(&self) -> f64 {
        match self.line {
            Line::Edge([a, b]) => (b - a).length(),
            Line::Rim { x, y, .. } => PI * (x.length() + y.length()),
            Line::Ball { r, .. } => TAU * r,
            Line::Wall { q, .. } => q.length,
        }
    }

    /// Whether both see each other's jump, as they run along each other, nearer than `slack`, in part.
    fn runs_along(&self, other: &Border, slack: f64) -> bool {
        match (&self.line, &other.line) {
            (Line::Edge(a), Line::Edge(b)) => edges_run_along(*a, *b, slack),
            (Line::Ball { c, r, .. }, Line::Ball { c: d, r: q, .. }) => (*c - *d).length() + (r - q).abs() <= slack,
            (Line::Wall { q: a, left }, Line::Wall { q: b, left: other }) => {
                let [low, high] = [b.base, b.base + b.axis * b.length].map(|p| (a.height(p), a.from_axis(p).length()));
                let meet = low.0.max(high.0) > 0.0 && low.0.min(high.0) < a.length;
                left == other && meet && low.1.max(high.1) + (a.radius - b.radius).abs() <= slack
            }
            (Line::Rim { c, x, y }, Line::Rim { c: d, x: p, y: q }) => {
                // Ellipses are alike where x xᵀ + y yᵀ is.
                let form =
                    |x: DVec3, y: DVec3| DMat3::from_cols(x * x.x + y * y.x, x * x.y + y * y.y, x * x.z + y * y.z);
                let apart = form(*x, *y) - form(*p, *q);
                let most = apart.to_cols_array().into_iter().fold(0.0f64, |m, v| m.max(v.abs()));
                (*c - *d).length() + most / x.length().max(y.length()) <= slack
            }
            _ => false,
        }
    }

    /// In light that comes so: to be told before places are asked for.
    #[must_use]
    pub fn lit(mut self, comes: impl Fn(DVec3) -> Option<DVec3>) -> Border {
        if let Line::Ball { c, r, axes } = &mut self.line {
            // Light may not come to all of it.
            let around = DVec3::AXES.into_iter().flat_map(|w| [w, -w]).map(|w| *c + w * *r);
            let pole = comes(*c).or_else(|| around.filter_map(&comes).sum::<DVec3>().try_normalize());
            *axes = pole.map(|w| {
                let (x, y) = warp::frame(-w);
                [-w, x, y]
            });
        }
        self
    }

    /// The place at s in 0..=1, where light comes as `comes` says; `None` where none does.
    pub fn place(&self, s: f64, comes: impl Fn(DVec3) -> Option<DVec3>) -> Option<Place> {
        match self.line {
            Line::Edge([a, b]) => {
                let z = a.lerp(b, s);
                Some(Place { z, comes: comes(z)?, along: (b - a).normalize() })
            }
            Line::Rim { c, x, y } => {
                let (sin, cos) = turn(s);
                let z = c + x * cos + y * sin;
                Some(Place { z, comes: comes(z)?, along: (y * cos - x * sin).normalize() })
            }
            Line::Ball { c, r, axes } => {
                let [pole, x, y] = axes?;
                let (sin, cos) = turn(s);
                touch([pole, x * cos + y * sin], |n| c + n * r, comes)
            }
            Line::Wall { q, left } => {
                let c = q.base + q.axis * (q.length * s);
                let w = comes(c)?;
                let pole = (q.axis * q.axis.dot(w) - w).try_normalize()?;
                let side = if left { q.axis.cross(pole) } else { pole.cross(q.axis) };
                touch([pole, side], |n| c + n * q.radius, comes)
            }
        }
    }

    /// Length across the light of a share of it; `beside`: the places at [`BESIDE`] of it before and behind.
    pub fn length_across(&self, s: f64, at: &Place, beside: impl Fn(f64) -> Option<Place>) -> Option<f64> {
        match self.line {
            Line::Edge(_) => Some(self.length()),
            Line::Rim { x, y, .. } => {
                let (sin, cos) = turn(s);
                Some(TAU * (y * cos - x * sin).length())
            }
            Line::Ball { .. } | Line::Wall { .. } => {
                let (a, b, step) = match [s - BESIDE, s + BESIDE].map(beside) {
                    [Some(a), Some(b)] => (a.z, b.z, 2.0 * BESIDE),
                    [Some(a), None] => (a.z, at.z, BESIDE),
                    [None, Some(b)] => (at.z, b.z, BESIDE),
                    [None, None] => return None,
                };
                Some((b - a).dot(at.along).abs() / step)
            }
        }
    }
}

/// Sine and cosine at a share of a turn: the very same at both of its ends.
fn turn(s: f64) -> (f64, f64) {
    (TAU * (s - s.floor())).sin_cos()
}

/// Where light leaves a round surface, on half a turn of its normals from the first axis by the second to the opposite of the first.
fn touch(
    [pole, side]: [DVec3; 2],
    point: impl Fn(DVec3) -> DVec3,
    comes: impl Fn(DVec3) -> Option<DVec3>,
) -> Option<Place> {
    let outward = |t: f64| pole * t.cos() + side * t.sin();
    let met = |t: f64| {
        let n = outward(t);
        let w = comes(point(n))?;
        Some((w.dot(n), (t, w)))
    };
    let mut last = None;
    let found = (0..=HALF_TURN).map(|k| PI * k as f64 / HALF_TURN as f64).find_map(|t| {
        let here = met(t).map(|m| (t, m.0));
        std::mem::replace(&mut last, here).zip(here).filter(|(a, b)| a.1 < 0.0 && b.1 >= 0.0)
    });
    let (a, b) = found?;
    let (t, comes) = root(a, b, &met)?.1;
    let n = outward(t);
    Some(Place { z: point(n), comes, along: n.cross(comes).normalize() })
}

pub fn edges(face: &Face) -> impl Iterator<Item = [DVec3; 2]> + '_ {
    border(face.corners())
}

/// All borders of what is smooth or opaque, each once (edges that opaque shapes share, too), but those within a plane; `rims`: of all that moves apart.
pub fn borders(scene: &Scene, rims: &[Rim]) -> Vec<Border> {
    let mut found: Vec<Border> = Vec::new();
    let mut first = 0;
    let mut add = |shape: u32, face: u32, corners: &[DVec3]| {
        // Faces come shape by shape, opaque ones last.
        let is_new = |b: &Border| b.own().0 != shape && scene.surface_of(b.own().0).is_smooth();
        if found.last().is_some_and(is_new) {
            first = found.len();
        }
        for (ends, (_, into)) in border(corners).zip(sides(corners)) {
            match found[first..].iter_mut().find(|b| b.is_at(scene, &ends)) {
                Some(known) => {
                    known.faces.push((shape, face));
                    known.into.push(into);
                }
                None => found.push(Border::edge(ends, (shape, face), SmallVec::from_iter([into]))),
            }
        }
    };
    for f in scene.chains.faces.iter().filter(|f| !f.is_round()) {
        add(f.shape, f.face, f.corners());
    }
    let opaque = || (0..).zip(&scene.shapes).filter(|(_, s)| is_opaque(scene, s));
    for (id, s) in opaque() {
        for face in 0..s.shape.face_count() {
            with_corners(&s.shape, face, |corners| add(id, face, corners));
        }
    }
    // Within a plane there is none.
    found.retain(|b| !matches!(b.into[..], [a, c] if a.dot(c) < FLAT - 1.0));
    let mirror = lone_mirror(scene).map(|b| b.shape);
    let blocks = |id: u32, s: &Instance| is_opaque(scene, s) || mirror == Some(id);
    for (id, s) in (0..).zip(&scene.shapes).filter(|(id, s)| blocks(*id, s)) {
        match s.shape {
            Shape::Sphere(q) => {
                found.push(Border::round(Line::Ball { c: q.center, r: q.radius, axes: None }, [(id, 0)]));
            }
            Shape::Cylinder(q) => {
                let side = |left| Border::round(Line::Wall { q, left }, [(id, 0)]);
                found.extend([false, true].map(side));
            }
            _ => {}
        }
    }
    let is_told = |s: u32| !scene.surface_of(s).is_smooth() || scene.is_round_mirror(&scene.shapes[s as usize]);
    found.extend(rims.iter().filter(|r| r.shapes().all(is_told)).map(|r| {
        let faces = r.grazed.iter().flat_map(|(shape, names)| names.iter().map(|&n| (*shape, n)));
        Border::round(Line::Rim { c: r.c, x: r.x, y: r.y }, faces)
    }));
    found
}

/// The borders of a face, itself first of their faces. Of two facets in one plane either takes over what the other leaves.
pub fn borders_of(scene: &Scene, borders: &[Border], face: &Face) -> Vec<Border> {
    let own = (face.shape, face.face);
    // Its own matter first.
    let by_own = |b: &Border| -> SmallVec<[(u32, u32); 2]> {
        std::iter::once(own).chain(b.faces.iter().copied().filter(|f| *f != own)).collect()
    };
    if face.is_round() {
        let rims = borders.iter().filter(|b| matches!(b.line, Line::Rim { .. }) && b.faces.contains(&own));
        return rims.map(|b| Border { faces: by_own(b), ..b.clone() }).collect();
    }
    let known = |ends: [DVec3; 2]| {
        let found = borders.iter().find(|b| b.own().0 == face.shape && b.is_at(scene, &ends))?;
        Some(Border { faces: by_own(found), ..Border::edge(ends, own, SmallVec::new()) })
    };
    edges(face).filter_map(known).collect()
}

/// Two shapes with borders that lie on each other in part only, or nearly, or all along though they are `apart`: shapes that move differently.
pub fn overlapping(scene: &Scene, rims: &[Rim], apart: impl Fn(u32, u32) -> bool) -> Option<(u32, u32)> {
    let borders = borders(scene, rims);
    // Light is asked for beside a border as far as that.
    let slack = 2.0 * ASIDE * scene.bounds.radius();
    let shared = |b: &Border| b.faces.iter().map(|f| f.0).find(|&k| apart(b.own().0, k)).map(|k| (b.own().0, k));
    // Rims that are one stay together.
    if let Some(pair) = borders.iter().filter(|b| b.ends().is_some()).find_map(shared) {
        return Some(pair);
    }
    borders.iter().enumerate().find_map(|(k, a)| {
        let of_others = borders[k + 1..].iter().filter(|b| b.own().0 != a.own().0);
        of_others.into_iter().find(|b| a.runs_along(b, slack)).map(|b| (a.own().0, b.own().0))
    })
}

fn edges_run_along([a, b]: [DVec3; 2], [p, q]: [DVec3; 2], slack: f64) -> bool {
    let length = (b - a).length();
    let w = (b - a) / length;
    let along = |x: DVec3| (x - a).dot(w);
    let is_off = |x: DVec3| (x - a - w * along(x)).length() > slack;
    let (lo, hi) = (along(p).min(along(q)), along(p).max(along(q)));
    !is_off(p) && !is_off(q) && hi.min(length) - lo.max(0.0) > slack
}

pub fn is_same(scene: &Scene, [a, b]: &[DVec3; 2], [c, d]: &[DVec3; 2]) -> bool {
    let near = |x: &DVec3, y: &DVec3| (*x - *y).length() <= ends::contact(scene);
    near(a, c) && near(b, d) || near(a, d) && near(b, c)
}
