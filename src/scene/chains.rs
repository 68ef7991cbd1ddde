//! Sequences of flat smooth faces by which lights without extent, and lamps, are connected to ([`crate::transport::chain`], [`crate::transport::lamp`]): through a pane of glass, by way of two mirrors, out of a block, by the facets of a mesh.
//!
//! [`super::chain_search`] lists them. What a chain sends on is a pencil ([`crate::math::pencil`]): [`super::reach`] tells a vertex which may reach it, so that its time goes with these, not with the number of facets.

use super::reach::Reach;
use super::{Instance, Scene, beams};
use crate::light::Origin;
use crate::math::fold::Fold;
use crate::math::pencil::Cone;
use crate::math::{DVec2, DVec3};
use crate::shape::edges::{sides, with_corners};
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use smallvec::SmallVec;
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

/// Faces of a chain at most.
pub const MOST: usize = 4;
/// Of angles, and of lengths over the scene's radius, for rounding.
pub(super) const SLACK: f64 = 1e-9;

/// A flat smooth face.
#[derive(Clone, Debug)]
pub struct Face {
    pub shape: u32,
    pub face: u32,
    /// On it, and its unit normal on the front side.
    pub p: DVec3,
    pub n: DVec3,
    /// Of its border, in order; of a disk, those of a square around it.
    pub(super) corners: SmallVec<[DVec3; 4]>,
    /// Of a polygon its sides, each with the direction into it; none of a disk.
    pub(super) sides: SmallVec<[(DVec3, DVec3); 4]>,
    pub(super) is_facet: bool,
    /// A ball that holds it.
    pub(super) center: DVec3,
    pub(super) radius: f64,
}

impl Face {
    /// The least distance into it from its sides; below 0 outside. Infinite for a disk: rays have to say.
    fn depth(&self, p: DVec3) -> f64 {
        self.sides.iter().map(|&(a, m)| (p - a).dot(m)).fold(f64::INFINITY, f64::min)
    }

    /// Distances into it from its sides; below 0 outside.
    pub fn depths(&self, p: DVec3) -> impl Iterator<Item = f64> + '_ {
        self.sides.iter().map(move |&(a, m)| (p - a).dot(m))
    }

    /// Of a mesh.
    pub fn is_facet(&self) -> bool {
        self.is_facet
    }

    /// A disk.
    pub fn is_round(&self) -> bool {
        self.sides.is_empty()
    }

    /// Whether light of this origin comes from before it.
    pub fn is_before(&self, from: Origin<f64>) -> bool {
        height(from, self.p, self.n) > 0.0
    }

    /// Points that it lies between.
    pub fn corners(&self) -> &[DVec3] {
        &self.corners
    }

    /// Whether a point of its plane lies on it, but for rounding.
    pub fn holds(&self, p: DVec3) -> bool {
        self.depth(p) >= -SLACK * ((p - self.center).length() + self.radius)
    }

    /// Whether no line along a direction of the cone passes through it and the ball. A point at the height h, carried to the plane along the cone's axis, at θ to its normal, is off by
    /// `h (tan(θ + α) - tan θ)` at most along another direction, and points of the ball by its radius over cos(θ + α) more.
    pub(super) fn is_missed(&self, cone: &Cone, center: DVec3, radius: f64) -> bool {
        let c = cone.axis.dot(self.n);
        let tilt = c.abs().min(1.0).acos() + cone.angle;
        if tilt > FRAC_PI_2 - SLACK {
            return false;
        }
        let h = (center - self.p).dot(self.n);
        let slack = (h.abs() * cone.angle.sin() / c.abs() + radius) / tilt.cos();
        self.depth(center - cone.axis * (h / c)) < -slack - SLACK * (h.abs() + self.radius)
    }
}

/// A face of a chain: one of [`Chains::faces`], and what light does there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link {
    pub face: u32,
    /// Light meets its front.
    pub front: bool,
    pub through: bool,
}

/// A sequence of faces.
#[derive(Clone, Debug)]
pub struct Chain {
    pub light: u32,
    pub links: SmallVec<[Link; MOST]>,
    /// How often it is asked for.
    pub asked: f64,
}

/// All of them.
#[derive(Debug, Default)]
pub struct Chains {
    pub faces: Arc<Vec<Face>>,
    pub list: Vec<Chain>,
    /// What they send on.
    pub(super) reach: Reach,
    /// Some were left out: there are too many.
    pub cut: bool,
    /// Light may meet more faces in turn than any of them has.
    pub long: bool,
    /// Faces that touch: light passes from one to the other without a way between.
    pub touching: bool,
}

impl Chains {
    /// Numbers of chains whose light may reach a point, each with the probability with which it is asked for, and of some others.
    pub fn draw(&self, x: DVec3, uniform: impl FnMut() -> f64, mut found: impl FnMut(u32)) {
        self.reach.draw(x, uniform, |id, pencil| {
            let last = self.list[id as usize].links.last();
            let misses = |l: &Link| self.faces[l.face as usize].is_missed(&pencil.cone, x, 0.0);
            if !last.is_some_and(misses) {
                found(id)
            }
        });
    }

    /// The last face of a chain sends light to one side only: whether x is there.
    pub fn may_reach(&self, chain: &Chain, x: DVec3) -> bool {
        let sends = |last: &Link| {
            let face = &self.faces[last.face as usize];
            let side = (x - face.p).dot(face.n);
            side != 0.0 && (side > 0.0) == (last.front != last.through)
        };
        chain.links.last().is_some_and(sends)
    }

    /// The plane of a link, with indices.
    pub fn fold(&self, scene: &Scene, link: &Link) -> Fold {
        let face = &self.faces[link.face as usize];
        let index = match scene.surface_of(face.shape) {
            Surface::Dielectric { interior, exterior, .. } if link.front => [*exterior, *interior],
            Surface::Dielectric { interior, exterior, .. } => [*interior, *exterior],
            _ => [1.0; 2],
        };
        Fold { p: face.p, n: face.n, through: link.through, index }
    }
}

/// Whether all its faces are flat, and shaded as such.
pub fn has_flat_faces(s: &Instance) -> bool {
    match &s.shape {
        Shape::Mesh(m) => s.face_normals || m.normals.is_none(),
        other => beams::is_flat(other),
    }
}
/// > 0 where light comes from the front of a plane.
pub(super) fn height(from: Origin<f64>, p: DVec3, n: DVec3) -> f64 {
    match from {
        Origin::Position(q) => (q.value() - p).dot(n),
        Origin::Infinity(w) => -w.value().dot(n),
    }
}

/// A face; `None` where it has no area.
pub(super) fn face(id: u32, s: &Shape, face: u32) -> Option<Face> {
    let at = |u: f64, v: f64| s.position(face, DVec2::new(u, v));
    let corners: SmallVec<[DVec3; 4]> = match s {
        Shape::Mesh(m) if m.is_degenerate(face) => return None,
        Shape::Disk(_) => {
            let c = at(0.0, 0.0);
            let (a, b) = (at(1.0, 0.0) - c, at(1.0, 0.25) - c);
            [c + a + b, c + a - b, c - a - b, c - a + b].into_iter().collect()
        }
        polygons => with_corners(polygons, face, SmallVec::from_slice)?,
    };
    let center = corners.iter().copied().sum::<DVec3>() / corners.len() as f64;
    let radius = corners.iter().map(|c| (*c - center).length()).fold(0.0, f64::max);
    let (p, n) = (center, s.normal(face, center));
    let is_round = matches!(s, Shape::Disk(_));
    let sides = sides(&corners).filter(|_| !is_round).collect();
    let is_facet = matches!(s, Shape::Mesh(_));
    Some(Face { shape: id, face, p, n, corners, sides, is_facet, center, radius })
}
