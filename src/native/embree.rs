//! Ray queries: Embree says *which* primitive (f32), this module says *where* (f64).
//!
//! Embree gets the scene moved to its centre and scaled to unit radius, so a scene of any size and place has the same
//! relative precision. Every candidate of the traversal comes back through a filter with the exact f64 ray, is solved again
//! from its plane equation, and is judged there. No absolute epsilon exists: what the ray starts on is named (`Ray::exclude`),
//! and what contains the origin to rounding is told from the numbers themselves.
//!
//! The f32 hull is looser than the f64 truth by about 2^-23 of the scene's radius: a ray that passes within that distance of
//! a silhouette edge, or starts within it of a concave corner, may get either answer.

use crate::error::{Error, Result};
use crate::math::DVec3;
use embree4_sys as sys;
use std::any::Any;
use std::ffi::{CStr, c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

/// Slack of the f32 query at both ends, in scene radii: candidates within it are judged by their f64 distance.
const SLACK: f64 = 1.0 / 16384.0;
/// Growth of boxes, in scene radii: a few times the f32 rounding of a ray inside the unit ball.
const GROWTH: f64 = 1.0 / (1 << 20) as f64;
/// A hit point this far outside its triangle (in barycentrics) is taken onto it: f32 and f64 disagree about the edge.
const OUTSIDE: f64 = 1.0 / 1024.0;
/// Rounding errors of the products below, with room to spare.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

/// A ray, or a segment of one: points `o + t d` with 0 < t < `t_max`.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub o: DVec3,
    /// Unit direction.
    pub d: DVec3,
    pub t_max: f64,
    /// `(geometry, primitive)` that the ray starts on. A triangle is not hit again, nor any triangle of its plane.
    /// An analytic primitive is asked, with `exclude` kept, and leaves the root at the start out.
    pub exclude: Option<(u32, u32)>,
}

impl Ray {
    /// An unbounded ray that starts on nothing.
    pub fn new(o: DVec3, d: DVec3) -> Self {
        Ray { o, d, t_max: f64::INFINITY, exclude: None }
    }
}

/// Where a ray meets a primitive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    pub geom: u32,
    pub prim: u32,
    /// Distance, from the plane equation in f64.
    pub t: f64,
    /// Triangles: barycentrics of vertices 1 and 2, may leave [0, 1] by rounding of the f32 query. Analytic: as given.
    pub uv: [f64; 2],
}

/// Analytic primitives, solved exactly.
pub trait UserPrimitives: Send + Sync {
    /// The nearest intersection of the ray with primitive `prim` at a distance in (`t_min`, `t_max`), and its surface
    /// coordinates. `ray.exclude` is `Some` exactly if the ray starts on this very primitive: then the root at the start,
    /// which rounding may have put a little before or after it, is none.
    fn intersect(&self, prim: u32, ray: &Ray, t_min: f64, t_max: f64) -> Option<(f64, [f64; 2])>;

    /// The point of primitive `prim` nearest to `p`, inside the primitive's box.
    fn nearest(&self, prim: u32, p: DVec3) -> DVec3;
}

pub(super) struct Mesh {
    id: u32,
    pub(super) vertices: Arc<[DVec3]>,
    pub(super) faces: Arc<[[u32; 3]]>,
}

pub(super) struct User {
    id: u32,
    bounds: Vec<(DVec3, DVec3)>,
    frame: Frame,
    pub(super) prims: Arc<dyn UserPrimitives>,
}

pub(super) enum Geometry {
    Mesh(Mesh),
    User(User),
}

/// World to the unit ball: `(x - centre) * scale`.
#[derive(Clone, Copy)]
pub(super) struct Frame {
    pub(super) centre: DVec3,
    pub(super) scale: f64,
}

/// Collects geometry for a [`Bvh`].
pub struct SceneBuilder {
    geometries: Vec<Geometry>,
    lo: DVec3,
    hi: DVec3,
}

impl SceneBuilder {
    /// An empty scene. Fails if the installed library is not the one this program was built for.
    pub fn new() -> Result<Self> {
        library()?;
        Ok(SceneBuilder {
            geometries: Vec::new(),
            lo: DVec3::splat(f64::INFINITY),
            hi: DVec3::splat(f64::NEG_INFINITY),
        })
    }

    /// Add a triangle mesh and return its geometry id (0, 1, ...). Zero-area faces are kept and never hit.
    pub fn add_triangles(&mut self, vertices: Arc<[DVec3]>, faces: Arc<[[u32; 3]]>) -> Result<u32> {
        let id = self.next_id(faces.len())?;
        if let Some(i) = vertices.iter().position(|v| !v.is_finite()) {
            return Err(Error::Runtime(format!("mesh vertex {i} is not finite: {}", vertices[i])));
        }
        if let Some(i) = faces.iter().position(|f| f.iter().any(|&v| v as usize >= vertices.len())) {
            return Err(Error::Runtime(format!(
                "mesh face {i} names vertices {:?}, but there are only {}",
                faces[i],
                vertices.len()
            )));
        }
        // Vertices that no face uses do not count towards the bounds.
        for &v in faces.iter().flatten() {
            self.lo = self.lo.min(vertices[v as usize]);
            self.hi = self.hi.max(vertices[v as usize]);
        }
        self.geometries.push(Geometry::Mesh(Mesh { id, vertices, faces }));
        Ok(id)
    }

    /// Add analytic primitives and return their geometry id. `bounds`: world box (lo, hi) of each primitive.
    pub fn add_user(&mut self, bounds: Vec<(DVec3, DVec3)>, prims: Arc<dyn UserPrimitives>) -> Result<u32> {
        let id = self.next_id(bounds.len())?;
        if let Some(i) = bounds.iter().position(|(a, b)| !a.is_finite() || !b.is_finite() || a.cmpgt(*b).any()) {
            return Err(Error::Runtime(format!(
                "box of primitive {i} is not finite or is empty: {} to {}",
                bounds[i].0, bounds[i].1
            )));
        }
        for (a, b) in &bounds {
            self.lo = self.lo.min(*a);
            self.hi = self.hi.max(*b);
        }
        let frame = Frame { centre: DVec3::ZERO, scale: 1.0 };
        self.geometries.push(Geometry::User(User { id, bounds, frame, prims }));
        Ok(id)
    }

    fn next_id(&self, primitives: usize) -> Result<u32> {
        if primitives >= u32::MAX as usize || self.geometries.len() >= u32::MAX as usize {
            return Err(Error::Runtime(format!("{primitives} primitives in one geometry: Embree counts to 2^32 - 2")));
        }
        Ok(self.geometries.len() as u32)
    }

    /// Build the hierarchy.
    pub fn commit(mut self) -> Result<Bvh> {
        let empty = self.geometries.iter().all(|g| g.len() == 0);
        if empty {
            (self.lo, self.hi) = (DVec3::ZERO, DVec3::ZERO);
        }

        // Halve before subtracting: no overflow for any finite coordinates.
        let half = self.hi * 0.5 - self.lo * 0.5;
        let centre = self.lo * 0.5 + self.hi * 0.5;
        let radius = half.max_element() * 3.0_f64.sqrt();
        // A scene of one point has no size of its own; its coordinates' rounding stands in.
        let radius = if radius > 0.0 { radius } else { (centre.abs().max_element() * ROUNDING).max(1e-300) };
        let frame = Frame { centre, scale: radius.recip() };
        if !frame.scale.is_finite() || frame.scale < f64::MIN_POSITIVE {
            return Err(Error::Runtime(format!("the scene's size {radius:e} is out of range")));
        }
        for g in &mut self.geometries {
            if let Geometry::User(u) = g {
                u.frame = frame;
            }
        }

        let device = Device::new()?;
        // SAFETY: the device is alive; a null scene is caught by `check`.
        let scene = unsafe { sys::rtcNewScene(device.handle) };
        device.check("new scene")?;
        let bvh = Bvh {
            scene,
            geometries: self.geometries.into_boxed_slice(),
            frame,
            lo: self.lo,
            hi: self.hi,
            grown: (self.lo - DVec3::splat(radius * GROWTH), self.hi + DVec3::splat(radius * GROWTH)),
            empty,
            device,
        };
        // SAFETY: the scene was made above and lives in `bvh`.
        unsafe {
            sys::rtcSetSceneFlags(scene, sys::RTCSceneFlags::RTC_SCENE_FLAG_ROBUST);
            sys::rtcSetSceneBuildQuality(scene, sys::RTCBuildQuality::RTC_BUILD_QUALITY_MEDIUM);
        }
        for g in bvh.geometries.iter().filter(|g| g.len() > 0) {
            bvh.attach(g)?;
        }
        // SAFETY: every attached geometry is committed, and what their pointers name lives in `bvh`.
        unsafe { sys::rtcCommitScene(scene) };
        bvh.device.check("building the hierarchy")?;
        Ok(bvh)
    }
}

impl Geometry {
    fn len(&self) -> usize {
        match self {
            Geometry::Mesh(m) => m.faces.len(),
            Geometry::User(u) => u.bounds.len(),
        }
    }
}

/// A committed scene. Queries may run from any number of threads.
pub struct Bvh {
    pub(super) scene: sys::RTCScene,
    /// Never moved or changed: Embree keeps their addresses.
    pub(super) geometries: Box<[Geometry]>,
    pub(super) frame: Frame,
    lo: DVec3,
    hi: DVec3,
    /// Bounds with room for the f32 query's rounding.
    grown: (DVec3, DVec3),
    empty: bool,
    device: Device,
}

// SAFETY: a committed Embree scene is read-only and its queries are thread-safe; the geometries are never changed after
// `commit` and `UserPrimitives` is Send + Sync; the device's counters are atomic or locked.
unsafe impl Send for Bvh {}
// SAFETY: as above.
unsafe impl Sync for Bvh {}

impl Drop for Bvh {
    fn drop(&mut self) {
        // SAFETY: the scene is ours and no query runs, for `self` is borrowed mutably. The device goes after it.
        unsafe { sys::rtcReleaseScene(self.scene) };
    }
}

/// What a callback needs to know of the query it serves. Embree hands on the address of `base`.
#[repr(C)]
struct Query<'a> {
    base: sys::QueryContext,
    ray: &'a Ray,
    /// Primitives that the ray grazes; the others are then judged without slack.
    past: &'a [(u32, u32)],
    /// The triangle the ray starts on: vertex and two edges.
    start: Option<Triangle>,
    /// World distance at which the f32 ray starts.
    t_start: f64,
    scale: f64,
    /// Current end of the f32 ray.
    tfar: f32,
    best: Option<Hit>,
    panic: Option<Box<dyn Any + Send>>,
}

impl Bvh {
    /// World box (lo, hi) of all primitives; zeros if there are none.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.lo, self.hi)
    }

    pub fn is_empty(&self) -> bool {
        self.empty
    }

    /// Bytes that Embree holds for this scene, and those of the f64 vertices and faces kept beside it.
    pub fn memory_bytes(&self) -> usize {
        let own: usize = self
            .geometries
            .iter()
            .map(|g| match g {
                Geometry::Mesh(m) => size_of_val(&*m.vertices) + size_of_val(&*m.faces),
                Geometry::User(u) => size_of_val(&*u.bounds),
            })
            .sum();
        own + self.device.monitor.bytes.load(Ordering::Relaxed).max(0) as usize
    }

    /// The nearest hit with 0 < t < `t_max`. Equal distances: the lower geometry, then the lower primitive.
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.intersect_past(ray, &[])
    }

    /// The same for a ray that grazes the primitives `past`, which it does not meet.
    pub fn intersect_past(&self, ray: &Ray, past: &[(u32, u32)]) -> Option<Hit> {
        let mut q = self.query(ray, past)?;
        let mut rh = q.ray_hit(self.frame);
        // SAFETY: the scene is committed; context and ray live through the call; `Query` starts with the context, and the
        // pointer is made from the whole of it, so callbacks may reach all of it. Nothing else touches `q` meanwhile.
        unsafe { sys::intersect1(self.scene, (&raw mut q).cast(), &mut rh) };
        if let Some(p) = q.panic {
            resume_unwind(p);
        }
        q.best
    }

    /// Is there any hit with 0 < t < `t_max`?
    pub fn occluded(&self, ray: &Ray) -> bool {
        self.occluded_past(ray, &[])
    }

    /// The same for a ray that grazes the primitives `past`, which it does not meet.
    pub fn occluded_past(&self, ray: &Ray, past: &[(u32, u32)]) -> bool {
        let Some(mut q) = self.query(ray, past) else { return false };
        let mut rh = q.ray_hit(self.frame);
        // SAFETY: as in `intersect`.
        unsafe { sys::occluded1(self.scene, (&raw mut q).cast(), &mut rh.ray) };
        if let Some(p) = q.panic {
            resume_unwind(p);
        }
        q.best.is_some()
    }

    /// Clip the exact ray to the scene's box; `None` if it misses.
    #[inline]
    fn query<'a>(&self, ray: &'a Ray, past: &'a [(u32, u32)]) -> Option<Query<'a>> {
        debug_assert!(ray.o.is_finite() && ray.d.is_finite() && !ray.t_max.is_nan(), "invalid ray {ray:?}");
        debug_assert!((ray.d.length_squared() - 1.0).abs() < 1e-6, "direction not of unit length: {ray:?}");
        if self.empty {
            return None;
        }
        let (lo, hi) = self.grown;
        let (mut t0, mut t1) = (0.0_f64, ray.t_max);
        for k in 0..3 {
            let inv = ray.d[k].recip();
            if inv.is_finite() {
                let (a, b) = ((lo[k] - ray.o[k]) * inv, (hi[k] - ray.o[k]) * inv);
                t0 = t0.max(a.min(b));
                t1 = t1.min(a.max(b));
            } else if ray.o[k] < lo[k] || ray.o[k] > hi[k] {
                return None;
            }
        }
        if t0 > t1 {
            return None;
        }
        let slack = SLACK / self.frame.scale;
        let t_start = t0 - slack;
        let tfar = ((t1 - t_start) * self.frame.scale + SLACK) as f32;
        let start = ray.exclude.and_then(|(g, p)| match self.geometries.get(g as usize)? {
            Geometry::Mesh(m) => m.triangle(p).filter(|t| t.n != DVec3::ZERO),
            Geometry::User(_) => None,
        });
        let base = sys::query_context();
        Some(Query { base, ray, past, start, t_start, scale: self.frame.scale, tfar, best: None, panic: None })
    }

    fn attach(&self, g: &Geometry) -> Result<()> {
        let to_f32 = |x: DVec3| ((x - self.frame.centre) * self.frame.scale).as_vec3();
        let user_ptr = (g as *const Geometry).cast_mut().cast::<c_void>();
        match g {
            Geometry::Mesh(m) => {
                // SAFETY: buffers of exactly the sizes written are asked for and tested for null; `user_ptr` names a
                // geometry that outlives the scene; the callbacks are for triangles.
                unsafe {
                    let geom =
                        sys::rtcNewGeometry(self.device.handle, sys::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE);
                    let guard = GeometryGuard(geom);
                    self.device.check("new geometry")?;
                    let v = sys::rtcSetNewGeometryBuffer(
                        geom,
                        sys::RTCBufferType::RTC_BUFFER_TYPE_VERTEX,
                        0,
                        sys::RTCFormat::RTC_FORMAT_FLOAT3,
                        size_of::<[f32; 3]>(),
                        m.vertices.len(),
                    )
                    .cast::<[f32; 3]>();
                    let f = sys::rtcSetNewGeometryBuffer(
                        geom,
                        sys::RTCBufferType::RTC_BUFFER_TYPE_INDEX,
                        0,
                        sys::RTCFormat::RTC_FORMAT_UINT3,
                        size_of::<[u32; 3]>(),
                        m.faces.len(),
                    )
                    .cast::<[u32; 3]>();
                    self.device.check("mesh buffers")?;
                    if v.is_null() || f.is_null() {
                        return Err(Error::Runtime("Embree: out of memory for a mesh".into()));
                    }
                    for (i, x) in m.vertices.iter().enumerate() {
                        v.add(i).write(to_f32(*x).to_array());
                    }
                    f.copy_from_nonoverlapping(m.faces.as_ptr(), m.faces.len());
                    sys::rtcSetGeometryUserData(geom, user_ptr);
                    sys::rtcSetGeometryIntersectFilterFunction(geom, Some(filter_intersect));
                    sys::rtcSetGeometryOccludedFilterFunction(geom, Some(filter_occluded));
                    sys::rtcCommitGeometry(geom);
                    sys::rtcAttachGeometryByID(self.scene, guard.0, m.id);
                }
            }
            Geometry::User(u) => {
                // SAFETY: as above; the callbacks are for user geometry.
                unsafe {
                    let geom = sys::rtcNewGeometry(self.device.handle, sys::RTCGeometryType::RTC_GEOMETRY_TYPE_USER);
                    let guard = GeometryGuard(geom);
                    self.device.check("new geometry")?;
                    sys::rtcSetGeometryUserPrimitiveCount(geom, u.bounds.len() as u32);
                    sys::rtcSetGeometryUserData(geom, user_ptr);
                    sys::rtcSetGeometryBoundsFunction(geom, Some(user_bounds), std::ptr::null_mut());
                    sys::rtcSetGeometryIntersectFunction(geom, Some(user_intersect));
                    sys::rtcSetGeometryOccludedFunction(geom, Some(user_occluded));
                    sys::rtcCommitGeometry(geom);
                    sys::rtcAttachGeometryByID(self.scene, guard.0, u.id);
                }
            }
        }
        self.device.check("attaching a geometry")
    }
}

/// Releases our own reference; an attached geometry lives on in its scene.
struct GeometryGuard(sys::RTCGeometry);

impl Drop for GeometryGuard {
    fn drop(&mut self) {
        if !self.0.is_null() {
            // SAFETY: the reference taken by rtcNewGeometry, given back once.
            unsafe { sys::rtcReleaseGeometry(self.0) };
        }
    }
}

/// One vertex, the two edges from it, and their cross product.
#[derive(Clone, Copy)]
struct Triangle {
    v: DVec3,
    e1: DVec3,
    e2: DVec3,
    n: DVec3,
}

impl Mesh {
    #[inline]
    fn triangle(&self, prim: u32) -> Option<Triangle> {
        let f = self.faces.get(prim as usize)?;
        let v = *self.vertices.get(f[0] as usize)?;
        let e1 = *self.vertices.get(f[1] as usize)? - v;
        let e2 = *self.vertices.get(f[2] as usize)? - v;
        Some(Triangle { v, e1, e2, n: e1.cross(e2) })
    }
}

impl Triangle {
    /// n . (v - x), and the rounding error that it may have.
    #[inline]
    fn offset(&self, x: DVec3) -> (f64, f64) {
        let w = self.v - x;
        let size = self.n.abs().dot(self.v.abs() + x.abs()) + self.e1.length() * self.e2.length() * w.length();
        (self.n.dot(w), ROUNDING * size)
    }

    /// Is the other triangle in this one's plane, to rounding?
    fn is_coplanar(&self, other: &Triangle) -> bool {
        [other.v, other.v + other.e1, other.v + other.e2].into_iter().all(|x| {
            let (offset, error) = self.offset(x);
            offset.abs() <= error
        })
    }

    /// Distance and barycentrics of a ray that the f32 query says to hit; `None` if there is no such hit beyond rounding.
    #[inline]
    fn solve(&self, o: DVec3, d: DVec3) -> Option<(f64, [f64; 2])> {
        let (offset, error) = self.offset(o);
        let along = self.n.dot(d);
        if offset.abs() <= error || along == 0.0 {
            return None;
        }
        let t = offset / along;
        let w = (o - self.v) + d * t;
        let area2 = self.n.length_squared();
        let b1 = w.cross(self.e2).dot(self.n) / area2;
        let b2 = self.e1.cross(w).dot(self.n) / area2;
        if b1.min(b2).min(1.0 - b1 - b2) >= -OUTSIDE {
            return Some((t, [b1, b2]));
        }

        // The f64 ray passes this (small or edge-on) triangle by, within the f32 query's rounding. Rejecting it would open
        // a crack, for the neighbour was not hit either: take the nearest point of the triangle's parameters.
        let (b1, b2) = (b1.max(0.0), b2.max(0.0));
        let sum = (b1 + b2).max(1.0);
        let (b1, b2) = (b1 / sum, b2 / sum);
        let t = ((self.v - o) + self.e1 * b1 + self.e2 * b2).dot(d);
        (b1.is_finite() && b2.is_finite()).then_some((t, [b1, b2]))
    }
}

impl Query<'_> {
    /// The f32 ray, from `SLACK` before its entry into the scene's box.
    #[inline]
    fn ray_hit(&self, frame: Frame) -> sys::RTCRayHit {
        let o = ((self.ray.o - frame.centre) * frame.scale + self.ray.d * (self.t_start * frame.scale)).as_vec3();
        let d = self.ray.d.as_vec3();
        // SAFETY: plain numbers, for which all-ones is a value. It makes every id invalid, those of instances too.
        let mut rh: sys::RTCRayHit = unsafe {
            let mut m = std::mem::MaybeUninit::<sys::RTCRayHit>::uninit();
            m.as_mut_ptr().write_bytes(0xff, 1);
            m.assume_init()
        };
        rh.ray.org_x = o.x;
        rh.ray.org_y = o.y;
        rh.ray.org_z = o.z;
        rh.ray.dir_x = d.x;
        rh.ray.dir_y = d.y;
        rh.ray.dir_z = d.z;
        rh.ray.tnear = 0.0;
        rh.ray.tfar = self.tfar;
        rh.ray.time = 0.0;
        rh.ray.id = 0;
        rh.ray.flags = 0;
        rh
    }

    /// The exact hit of a triangle that Embree proposes, if it is admissible.
    #[inline]
    fn judge(&self, mesh: &Mesh, prim: u32) -> Option<Hit> {
        if self.ray.exclude == Some((mesh.id, prim)) || self.past.contains(&(mesh.id, prim)) {
            return None;
        }
        let triangle = mesh.triangle(prim)?;
        if self.start.is_some_and(|s| s.is_coplanar(&triangle)) {
            return None;
        }
        let (t, uv) = triangle.solve(self.ray.o, self.ray.d)?;
        // Beside a silhouette the slack that closes cracks would block what is clear.
        if !self.past.is_empty() && (uv[0].min(uv[1]) <= 0.0 || uv[0] + uv[1] >= 1.0) {
            return None;
        }
        (t > 0.0 && t < self.ray.t_max).then_some(Hit { geom: mesh.id, prim, t, uv })
    }

    /// Keep a hit if it comes before the best; the new end of the f32 ray if so.
    #[inline]
    fn offer(&mut self, hit: Hit) -> Option<f32> {
        if let Some(b) = self.best {
            if (hit.t, hit.geom, hit.prim) >= (b.t, b.geom, b.prim) {
                return None;
            }
        }
        self.best = Some(hit);
        // Leave room behind it: f32 may order two near hits the wrong way round.
        self.tfar = self.tfar.min(((hit.t - self.t_start) * self.scale + SLACK) as f32);
        Some(self.tfar)
    }

    /// Ask an analytic primitive. A panic in it is kept for the caller, beyond Embree's frames.
    fn ask(&mut self, user: &User, prim: u32) -> Option<Hit> {
        if self.panic.is_some() || self.past.contains(&(user.id, prim)) {
            return None;
        }
        let t_max = self.best.map_or(self.ray.t_max, |b| b.t);
        let here = Some((user.id, prim));
        let ray = Ray { exclude: self.ray.exclude.filter(|_| self.ray.exclude == here), ..*self.ray };
        match catch_unwind(AssertUnwindSafe(|| user.prims.intersect(prim, &ray, 0.0, t_max))) {
            Ok(found) => {
                let (t, uv) = found?;
                (t > 0.0 && t < t_max).then_some(Hit { geom: user.id, prim, t, uv })
            }
            Err(p) => {
                self.panic = Some(p);
                None
            }
        }
    }
}

// Callbacks. They get N == 1 always, for only single rays are traced; then the SOA types have the layout of the plain ones.

unsafe extern "C" fn filter_intersect(args: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: Embree's arguments; the context is the first field of a `Query` that `intersect` made, the user pointer a
    // `Geometry` of the scene.
    unsafe {
        let a = &*args;
        let q = &mut *a.context.cast::<Query>();
        let Geometry::Mesh(mesh) = &*a.geometryUserPtr.cast::<Geometry>() else { return };
        let prim = (*a.hit.cast::<sys::RTCHit>()).primID;
        match q.judge(mesh, prim).and_then(|h| q.offer(h)) {
            Some(tfar) => (*a.ray.cast::<sys::RTCRay>()).tfar = tfar,
            None => *a.valid = 0,
        }
    }
}

unsafe extern "C" fn filter_occluded(args: *const sys::RTCFilterFunctionNArguments) {
    // SAFETY: as in `filter_intersect`.
    unsafe {
        let a = &*args;
        let q = &mut *a.context.cast::<Query>();
        let Geometry::Mesh(mesh) = &*a.geometryUserPtr.cast::<Geometry>() else { return };
        let prim = (*a.hit.cast::<sys::RTCHit>()).primID;
        match q.judge(mesh, prim) {
            Some(h) => q.best = Some(h),
            None => *a.valid = 0,
        }
    }
}

unsafe extern "C" fn user_bounds(args: *const sys::RTCBoundsFunctionArguments) {
    // SAFETY: Embree's arguments; the user pointer is a `Geometry` of the scene, whose frame is set before the build.
    unsafe {
        let a = &*args;
        let Geometry::User(u) = &*a.geometryUserPtr.cast::<Geometry>() else { return };
        let Some((lo, hi)) = u.bounds.get(a.primID as usize) else { return };
        let lo = ((*lo - u.frame.centre) * u.frame.scale - DVec3::splat(GROWTH)).as_vec3();
        let hi = ((*hi - u.frame.centre) * u.frame.scale + DVec3::splat(GROWTH)).as_vec3();
        let b = &mut *a.bounds_o;
        (b.lower_x, b.lower_y, b.lower_z) = (lo.x, lo.y, lo.z);
        (b.upper_x, b.upper_y, b.upper_z) = (hi.x, hi.y, hi.z);
    }
}

unsafe extern "C" fn user_intersect(args: *const sys::RTCIntersectFunctionNArguments) {
    // SAFETY: as in `filter_intersect`; with N == 1 the ray and hit are one `RTCRayHit`.
    unsafe {
        let a = &*args;
        if *a.valid == 0 {
            return;
        }
        let q = &mut *a.context.cast::<Query>();
        let Geometry::User(user) = &*a.geometryUserPtr.cast::<Geometry>() else { return };
        if let Some(tfar) = q.ask(user, a.primID).and_then(|h| q.offer(h)) {
            let rh = &mut *a.rayhit.cast::<sys::RTCRayHit>();
            rh.ray.tfar = tfar;
            rh.hit.geomID = a.geomID;
            rh.hit.primID = a.primID;
        }
    }
}

unsafe extern "C" fn user_occluded(args: *const sys::RTCOccludedFunctionNArguments) {
    // SAFETY: as in `filter_intersect`.
    unsafe {
        let a = &*args;
        if *a.valid == 0 {
            return;
        }
        let q = &mut *a.context.cast::<Query>();
        let Geometry::User(user) = &*a.geometryUserPtr.cast::<Geometry>() else { return };
        if let Some(h) = q.ask(user, a.primID) {
            q.best = Some(h);
            (*a.ray.cast::<sys::RTCRay>()).tfar = f32::NEG_INFINITY;
        }
    }
}

/// What Embree tells a device's callbacks.
#[derive(Default)]
struct Monitor {
    bytes: AtomicI64,
    error: Mutex<Option<String>>,
}

struct Device {
    handle: sys::RTCDevice,
    /// Boxed: Embree keeps its address.
    monitor: Box<Monitor>,
}

impl Device {
    fn new() -> Result<Self> {
        // SAFETY: no configuration; a null device is tested below.
        let handle = unsafe { sys::rtcNewDevice(std::ptr::null()) };
        if handle.is_null() {
            return Err(Error::Runtime("Embree: no device (out of memory, or a processor without SSE2?)".into()));
        }
        let monitor = Box::<Monitor>::default();
        let address = (&raw const *monitor).cast_mut().cast::<c_void>();
        // SAFETY: the monitor outlives the device: `drop` releases the device first.
        unsafe {
            sys::rtcSetDeviceErrorFunction(handle, Some(on_error), address);
            sys::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), address);
        }
        Ok(Device { handle, monitor })
    }

    /// The error that the callback kept since the last call, if any.
    fn check(&self, doing: &str) -> Result<()> {
        let mut error = self.monitor.error.lock().unwrap_or_else(|e| e.into_inner());
        match error.take() {
            Some(e) => Err(Error::Runtime(format!("Embree, {doing}: {e}"))),
            None => Ok(()),
        }
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: our own reference, given back once.
        unsafe { sys::rtcReleaseDevice(self.handle) };
    }
}

unsafe extern "C" fn on_error(user: *mut c_void, code: sys::RTCError, text: *const c_char) {
    // SAFETY: `user` is the device's monitor; `text` is null or a C string.
    let (monitor, text) = unsafe {
        let text = if text.is_null() { String::new() } else { CStr::from_ptr(text).to_string_lossy().into_owned() };
        (&*user.cast::<Monitor>(), text)
    };
    let text = if text.is_empty() { format!("error code {}", code.0) } else { text };
    let mut error = monitor.error.lock().unwrap_or_else(|e| e.into_inner());
    error.get_or_insert(text);
}

unsafe extern "C" fn on_memory(user: *mut c_void, bytes: isize, _post: bool) -> bool {
    // SAFETY: `user` is the device's monitor.
    let monitor = unsafe { &*user.cast::<Monitor>() };
    monitor.bytes.fetch_add(bytes as i64, Ordering::Relaxed);
    true
}

/// Version of the library that is loaded, such as "3.13.5"; of the header if the two do not fit.
pub fn version() -> String {
    library().unwrap_or_else(|_| dotted(sys::HEADER_VERSION))
}

fn dotted((major, minor, patch): (u32, u32, u32)) -> String {
    format!("{major}.{minor}.{patch}")
}

/// The library's version, after it was found to fit the header (once a process).
fn library() -> Result<String> {
    static CHECKED: OnceLock<std::result::Result<String, String>> = OnceLock::new();
    CHECKED.get_or_init(|| examine().map_err(|e| e.to_string())).clone().map_err(Error::Runtime)
}

/// Compare library and header, by version and by what a query really writes.
fn examine() -> Result<String> {
    let device = Device::new()?;
    // SAFETY: the device is alive.
    let v = unsafe { sys::rtcGetDeviceProperty(device.handle, sys::RTCDeviceProperty::RTC_DEVICE_PROPERTY_VERSION) };
    let v = (v as u32 / 10000, v as u32 / 100 % 100, v as u32 % 100);
    let misfit = |why: &str| {
        Error::Runtime(format!(
            "Embree {} is loaded, but the program was built for {}: {why}\n  help: build again (cargo clean -p embree4-sys; cargo build), or install libembree-dev {}",
            dotted(v),
            dotted(sys::HEADER_VERSION),
            sys::HEADER_VERSION.0
        ))
    };
    if v.0 != sys::HEADER_VERSION.0 || v.1 < sys::HEADER_VERSION.1 {
        return Err(misfit("another interface"));
    }

    // Trace one ray at one triangle in a buffer with a mark behind it: a library with longer structs overwrites the mark.
    #[repr(C, align(64))]
    struct Probe {
        rayhit: sys::RTCRayHit,
        mark: [u32; 64],
    }
    #[repr(C, align(64))]
    struct Context {
        base: sys::QueryContext,
        room: [u32; 64],
    }
    const MARK: u32 = 0x7a11_da11;
    // SAFETY: one triangle in buffers of its own; the context is followed by room for a longer one; all live through.
    unsafe {
        let scene = sys::rtcNewScene(device.handle);
        let geom = sys::rtcNewGeometry(device.handle, sys::RTCGeometryType::RTC_GEOMETRY_TYPE_TRIANGLE);
        let _guard = GeometryGuard(geom);
        let buffer = |kind, format, n| sys::rtcSetNewGeometryBuffer(geom, kind, 0, format, 12, n);
        let p =
            buffer(sys::RTCBufferType::RTC_BUFFER_TYPE_VERTEX, sys::RTCFormat::RTC_FORMAT_FLOAT3, 3).cast::<[f32; 3]>();
        let f =
            buffer(sys::RTCBufferType::RTC_BUFFER_TYPE_INDEX, sys::RTCFormat::RTC_FORMAT_UINT3, 1).cast::<[u32; 3]>();
        device.check("probe")?;
        if p.is_null() || f.is_null() {
            sys::rtcReleaseScene(scene);
            return Err(Error::Runtime("Embree: out of memory for one triangle".into()));
        }
        for (i, x) in [[-1.0, -1.0, 1.0], [3.0, -1.0, 1.0], [-1.0, 3.0, 1.0]].into_iter().enumerate() {
            p.add(i).write(x);
        }
        f.write([0, 1, 2]);
        sys::rtcCommitGeometry(geom);
        sys::rtcAttachGeometryByID(scene, geom, 5);
        sys::rtcCommitScene(scene);

        let mut probe: Probe = std::mem::zeroed();
        (&raw mut probe.rayhit).write_bytes(0xff, 1);
        probe.mark = [MARK; 64];
        let ray = &mut probe.rayhit.ray;
        (ray.org_x, ray.org_y, ray.org_z, ray.tnear) = (0.0, 0.0, 0.0, 0.0);
        (ray.dir_x, ray.dir_y, ray.dir_z, ray.time) = (0.0, 0.0, 1.0, 0.0);
        (ray.tfar, ray.id, ray.flags) = (10.0, 0, 0);
        let mut context = Context { base: sys::query_context(), room: [sys::INVALID_ID; 64] };
        sys::intersect1(scene, (&raw mut context).cast(), (&raw mut probe).cast());
        sys::rtcReleaseScene(scene);
        device.check("probe")?;
        // Embree multiplies by reciprocals that some processors round otherwise: 1 to a few units of the last place.
        let met = probe.rayhit.hit.geomID == 5 && (probe.rayhit.ray.tfar - 1.0).abs() < 1e-5;
        if probe.mark != [MARK; 64] || !met {
            return Err(misfit("its structures have another layout"));
        }
    }
    Ok(dotted(v))
}
