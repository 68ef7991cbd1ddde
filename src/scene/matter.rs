//! How the matter of shapes moves: all of a shape by one affine field ([`Mover`]), and of a mesh whose vertices are parameters every face with its
//! corners besides ([`Corners`]). Both are linear in slots, so they add up. Whoever asks names the face that the point lies on.

use super::{Instance, Scene};
use crate::math::{DVec3, Rgb};
use crate::params::{Corners, Covector, Mover, ParamSet, Partial, Sink, Slot};
use crate::shape::Shape;

/// The matter of one face.
#[derive(Clone, Copy, Debug)]
pub struct Matter<'a> {
    mover: &'a Mover,
    corners: Option<Corners>,
}

impl Matter<'_> {
    /// Hands `<c, v(p)>` out as forms.
    pub fn forms(&self, p: DVec3, c: DVec3, mut out: impl FnMut(Partial)) {
        self.mover.forms(p, c).into_iter().for_each(&mut out);
        self.corners.iter().flat_map(|t| t.forms(p, c)).for_each(out);
    }

    /// The same per channel.
    pub fn point(&self, p: DVec3, c: &Covector, sink: &mut impl Sink) {
        self.mover.point(p, c, sink);
        self.corners.iter().for_each(|t| t.point(p, c, sink));
    }

    /// `<c, ṅ>` for the unit normal of the face.
    pub fn normal(&self, n: DVec3, c: &Covector, sink: &mut impl Sink) {
        self.mover.normal(n, c, sink);
        self.corners.iter().for_each(|t| t.normal(n, c, sink));
    }

    /// `value` times the rate at which the face's area grows at a point of unit normal n.
    pub fn area(&self, n: DVec3, value: Rgb, sink: &mut impl Sink) {
        self.mover.area(n, value, sink);
        self.corners.iter().for_each(|t| t.area(value, sink));
    }
}

impl Instance {
    /// Whether any parameter moves it.
    pub fn moves(&self, params: &ParamSet) -> bool {
        params.block_active(self.mover.first, Mover::SLOTS) || self.bends(params)
    }

    /// Whether its vertices are parameters, so that it moves like nothing else.
    pub fn bends(&self, params: &ParamSet) -> bool {
        self.vertices.is_some_and(|first| params.is_active(first))
    }

    pub fn matter(&self, face: u32) -> Matter<'_> {
        let corners = match (&self.shape, self.vertices) {
            (Shape::Mesh(m), Some(first)) => {
                let slots = m.faces[face as usize].map(|v| first + 3 * v as Slot);
                Some(Corners::new(slots, m.corners(face)))
            }
            _ => None,
        };
        Matter { mover: &self.mover, corners }
    }
}

impl Scene {
    pub fn matter(&self, shape: u32, face: u32) -> Matter<'_> {
        self.shapes[shape as usize].matter(face)
    }
}
