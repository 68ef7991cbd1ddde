//! The point of the scene's surfaces nearest to a point of space.

use super::geometry::Group;
use super::{Instance, Scene, effort};
use crate::math::DVec3;
use crate::shape::{Bounds, Geometry};
use smallvec::SmallVec;

/// Which surfaces are asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// All that stops light.
    Opaque,
    /// Interfaces that light passes unchanged.
    Null,
}

/// The nearest point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Near {
    /// World units.
    pub distance: f64,
    pub p: DVec3,
    pub shape: u32,
    pub face: u32,
}

impl Group {
    /// See [`Scene::nearest_point`]; `shapes` as the group was built from.
    pub fn nearest_point(
        &self,
        shapes: &[Instance],
        p: DVec3,
        radius: f64,
        accept: &dyn Fn(u32, u32) -> bool,
    ) -> Option<Near> {
        effort::note(effort::NEAREST_LISTED);
        let listed = self.nearest_listed(shapes, p, radius, accept);
        let limit = listed.map_or(radius, |n| n.distance);
        let met = self.bvh.as_ref().and_then(|bvh| {
            effort::note(effort::NEAREST);
            let accept = |geom, prim| {
                let (shape, face) = self.face_of(geom, prim);
                accept(shape, face)
            };
            bvh.nearest(p, limit, &accept)
        });
        let near = met.map(|n| {
            let (shape, face) = self.face_of(n.geom, n.prim);
            Near { distance: n.distance, p: n.p, shape, face }
        });
        near.or(listed)
    }

    /// The nearest points of all faces that are nearer than `radius`, in the same order on every call.
    pub fn faces_within(&self, shapes: &[Instance], p: DVec3, radius: f64) -> Vec<Near> {
        effort::note(effort::NEAREST);
        let met = self.bvh.iter().flat_map(|bvh| bvh.within(p, radius)).map(|n| {
            let (shape, face) = self.face_of(n.geom, n.prim);
            Near { distance: n.distance, p: n.p, shape, face }
        });
        let listed = self.simple_faces.iter().map(|&(shape, face, _)| {
            let q = shapes[shape as usize].shape.nearest_on_face(face, p);
            Near { distance: q.distance(p), p: q, shape, face }
        });
        met.chain(listed.filter(|n| n.distance < radius)).collect()
    }

    /// Of the analytic shapes that are not in Embree.
    fn nearest_listed(
        &self,
        shapes: &[Instance],
        p: DVec3,
        radius: f64,
        accept: &dyn Fn(u32, u32) -> bool,
    ) -> Option<Near> {
        // Corners of boxes are rounded.
        let least = |bounds: &Bounds| bounds.distance(p) * (1.0 - 1e-9);
        let mut gaps = SmallVec::<[f64; 64]>::new();
        gaps.extend(self.simple_faces.iter().map(|(_, _, bounds)| least(bounds)));
        let gap = |k: &usize| gaps[*k];
        // The face whose box is nearest first: most others are then further away.
        let first = (0..gaps.len()).min_by(|a, b| gap(a).total_cmp(&gap(b)))?;
        let mut best: Option<(usize, Near)> = None;
        for k in std::iter::once(first).chain((0..gaps.len()).filter(|k| *k != first)) {
            let limit = best.map_or(radius, |(_, b)| b.distance);
            if gaps[k] > limit {
                continue;
            }
            let (shape, face, _) = self.simple_faces[k];
            let q = shapes[shape as usize].shape.nearest_on_face(face, p);
            let distance = q.distance(p);
            // Of equally near faces the first in the list.
            let nearer =
                best.map_or(distance < radius, |(j, b)| distance < b.distance || distance == b.distance && k < j);
            if nearer && accept(shape, face) {
                best = Some((k, Near { distance, p: q, shape, face }));
            }
        }
        best.map(|(_, near)| near)
    }
}

impl Scene {
    /// The point nearest to `p` (finite) of all faces `(shape, face)` of a kind that `accept` wants, if it is nearer than `radius` (world units,
    /// may be infinite). Of equally near faces one and the same on every call. `accept` is asked in no order; it should be cheap.
    ///
    /// Over `p` the distance is 1-Lipschitz, whatever is accepted, and its gradient where it has one is `(p - near.p) / distance`.
    pub fn nearest_point(&self, of: Kind, p: DVec3, radius: f64, accept: &dyn Fn(u32, u32) -> bool) -> Option<Near> {
        let group = match of {
            Kind::Opaque => &self.opaque,
            Kind::Null => &self.null,
        };
        group.nearest_point(&self.shapes, p, radius, accept)
    }
}
