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
    /// Told of a primitive's nearest point; the new radius where that shrinks.
    told: &'a mut dyn FnMut(Nearest) -> Option<f64>,
    /// Distance of the scene's centre, and the f32 query's rounding, in scene radii.
    far: f64,
    slack: f64,
    panic: Option<Box<dyn Any + Send>>,
}

impl Bvh {
    /// The point nearest to `p` (finite) of all primitives `(geom, prim)` that `accept` wants, if it is nearer than `radius` (world
    /// units, may be infinite). Faces without area count, as the segments or points that they are. Equal distances: the lower
    /// geometry, then the lower primitive. `accept` is asked of what is nearer than all before, perhaps more than once, in no
    /// order; a panic in it reaches the caller.
    pub fn nearest(&self, p: DVec3, radius: f64, accept: &dyn Fn(u32, u32) -> bool) -> Option<Nearest> {
        let mut best: Option<Nearest> = None;
        self.near_query(p, radius, &mut |n| {
            let nearer = match best {
                Some(b) => (n.distance, n.geom, n.prim) < (b.distance, b.geom, b.prim),
                None => n.distance < radius,
            };
            (nearer && accept(n.geom, n.prim)).then(|| {
                best = Some(n);
                n.distance
            })
        });
        best
    }

    /// The nearest points of all primitives that are nearer than `radius`, ordered by geometry and primitive.
    pub fn within(&self, p: DVec3, radius: f64) -> Vec<Nearest> {
        let mut found = Vec::new();
        self.near_query(p, radius, &mut |n| {
            if n.distance < radius {
                found.push(n);
            }
            None
        });
        found.sort_unstable_by_key(|n| (n.geom, n.prim));
        found
    }

    /// Tells of all primitives that may be nearer than the radius, which what is told may shrink.
    fn near_query(&self, p: DVec3, radius: f64, told: &mut dyn FnMut(Nearest) -> Option<f64>) {
        debug_assert!(p.is_finite() && !radius.is_nan(), "invalid query {p} {radius}");
        if self.is_empty() {
            return;
        }
        let local = (p - self.frame.centre) * self.frame.scale;
        let far = local.length();
        let slack = (1.0 + far) * GROWTH;
        let mut q = Query { bvh: self, p, told, far, slack, panic: None };
        let o = local.as_vec3();
        let mut query = sys::RTCPointQuery { x: o.x, y: o.y, z: o.z, time: 0.0, radius: q.widened(radius) };
        let mut context = sys::point_query_context();
        // SAFETY: the scene is committed; query and context live through the call and have the alignment that Embree asks for;
        // the user pointer is made from the whole of `q`, which nothing else touches meanwhile.
        unsafe { sys::rtcPointQuery(self.scene, &mut query, &mut context, Some(visit), (&raw mut q).cast()) };
        if let Some(p) = q.panic {
            resume_unwind(p);
        }
    }
}

impl Query<'_> {
    /// The f32 query's radius for a distance in world units: finite, because the scene is.
    fn widened(&self, distance: f64) -> f32 {
        ((distance * self.bvh.frame.scale).min(1.0 + self.far) + self.slack) as f32
    }

    /// Tells of the primitive's nearest point.
    fn judge(&mut self, geom: u32, prim: u32) -> Option<f64> {
        let p = match self.bvh.geometries.get(geom as usize)? {
            Geometry::Mesh(m) => on_triangle(self.p, m.faces.get(prim as usize)?.map(|v| m.vertices[v as usize])),
            Geometry::User(u) => u.prims.nearest(prim, self.p),
        };
        let distance = p.distance(self.p);
        (self.told)(Nearest { distance, p, geom, prim })
    }

    /// Look at a primitive; the f32 query's new radius if it shrinks. A panic is kept for the caller, beyond Embree's
    /// frames, and ends the search.
    fn offer(&mut self, geom: u32, prim: u32) -> Option<f32> {
        if self.panic.is_some() {
            return None;
        }
        match catch_unwind(AssertUnwindSafe(|| self.judge(geom, prim))) {
            Ok(radius) => radius.map(|r| self.widened(r)),
            Err(p) => {
                self.panic = Some(p);
                Some(0.0)
            }
        }
    }
}

/// Whether the query's radius changed.
unsafe extern "C" fn visit(args: *mut sys::RTCPointQueryFunctionArguments) -> bool {
    // SAFETY: Embree's arguments; the user pointer is the `Query` that `near_query` made, and only this thread has it.
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
