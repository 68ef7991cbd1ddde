//! Nearest points of a [`Bvh`]: Embree says which primitives may be near (f32), this module says how near they are (f64).
//!
//! The f32 query is wider than the f64 one by more than its rounding, so no primitive is missed: the answer is that of a search
//! through all primitives, ties included.

use super::embree::{Bvh, Geometry};
use crate::math::DVec3;
use crate::math::nearest::on_triangle;
use embree4_sys as sys;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};

/// Growth of the f32 query's radius, of the distances that it rounds. Vertices, point, differences, squares and the radius itself
/// come to less than half of it.
const GROWTH: f64 = 1.0 / (1 << 20) as f64;

/// The point nearest to another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// World units.
    pub distance: f64,
    pub p: DVec3,
    pub geom: u32,
    pub prim: u32,
}

/// What the callback needs to know of the query it serves. Embree hands on its address.
struct Query<'a> {
    bvh: &'a Bvh,
    p: DVec3,
    radius: f64,
    accept: &'a dyn Fn(u32, u32) -> bool,
    /// Distance of the scene's centre, and the f32 query's rounding, in scene radii.
    far: f64,
    slack: f64,
    best: Option<Nearest>,
    panic: Option<Box<dyn Any + Send>>,
}

impl Bvh {
    /// The point nearest to `p` (finite) of all primitives `(geom, prim)` that `accept` wants, if it is nearer than `radius` (world
    /// units, may be infinite). Faces without area count, as the segments or points that they are. Equal distances: the lower
    /// geometry, then the lower primitive. `accept` is asked of what is nearer than all before, perhaps more than once, in no
    /// order; a panic in it reaches the caller.
    pub fn nearest(&self, p: DVec3, radius: f64, accept: &dyn Fn(u32, u32) -> bool) -> Option<Nearest> {
        debug_assert!(p.is_finite() && !radius.is_nan(), "invalid query {p} {radius}");
        if self.is_empty() {
            return None;
        }
        let local = (p - self.frame.centre) * self.frame.scale;
        let far = local.length();
        let slack = (1.0 + far) * GROWTH;
        let mut q = Query { bvh: self, p, radius, accept, far, slack, best: None, panic: None };
        let o = local.as_vec3();
        let mut query = sys::RTCPointQuery { x: o.x, y: o.y, z: o.z, time: 0.0, radius: q.widened(radius) };
        let mut context = sys::point_query_context();
        // SAFETY: the scene is committed; query and context live through the call and have the alignment that Embree asks for;
        // the user pointer is made from the whole of `q`, which nothing else touches meanwhile.
        unsafe { sys::rtcPointQuery(self.scene, &mut query, &mut context, Some(visit), (&raw mut q).cast()) };
        if let Some(p) = q.panic {
            resume_unwind(p);
        }
        q.best
    }
}

impl Query<'_> {
    /// The f32 query's radius for a distance in world units: finite, because the scene is.
    fn widened(&self, distance: f64) -> f32 {
        ((distance * self.bvh.frame.scale).min(1.0 + self.far) + self.slack) as f32
    }

    /// The primitive's nearest point, if it comes before the best and is wanted.
    fn judge(&self, geom: u32, prim: u32) -> Option<Nearest> {
        let p = match self.bvh.geometries.get(geom as usize)? {
            Geometry::Mesh(m) => on_triangle(self.p, m.faces.get(prim as usize)?.map(|v| m.vertices[v as usize])),
            Geometry::User(u) => u.prims.nearest(prim, self.p),
        };
        let distance = p.distance(self.p);
        let nearer = match self.best {
            Some(b) => (distance, geom, prim) < (b.distance, b.geom, b.prim),
            None => distance < self.radius,
        };
        (nearer && (self.accept)(geom, prim)).then_some(Nearest { distance, p, geom, prim })
    }

    /// Look at a primitive; the f32 query's new radius if it is the best so far. A panic is kept for the caller, beyond Embree's
    /// frames, and ends the search.
    fn offer(&mut self, geom: u32, prim: u32) -> Option<f32> {
        if self.panic.is_some() {
            return None;
        }
        match catch_unwind(AssertUnwindSafe(|| self.judge(geom, prim))) {
            Ok(found) => {
                self.best = Some(found?);
                found.map(|b| self.widened(b.distance))
            }
            Err(p) => {
                self.panic = Some(p);
                Some(0.0)
            }
        }
    }
}

/// Whether the query's radius changed.
unsafe extern "C" fn visit(args: *mut sys::RTCPointQueryFunctionArguments) -> bool {
    // SAFETY: Embree's arguments; the user pointer is the `Query` that `nearest` made, and only this thread has it.
    unsafe {
        let a = &*args;
        let q = &mut *a.userPtr.cast::<Query>();
        let Some(radius) = q.offer(a.geomID, a.primID) else { return false };
        // Embree forbids growth.
        let query = &mut *a.query;
        query.radius = query.radius.min(radius);
        true
    }
}
