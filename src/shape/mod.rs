//! Shapes: which points of space are surface, and where a ray crosses them, exact in f64.
//!
//! Embree says *which* primitive is hit; here the hit is solved again in f64. A ray that leaves a surface names the face
//! it starts on ([`Start`]): that root is left out by bookkeeping, never by a distance. Nothing here has an absolute
//! tolerance, so shapes of radius 1e-6 and 1e6, at coordinate 1e5, behave alike (STABILITY section 3, rule 7).

pub mod bounds;
pub mod cube;
pub mod cylinder;
pub mod disk;
pub mod edges;
pub mod halves;
pub mod level_set;
pub mod mesh;
pub mod obj;
pub mod placement;
pub mod ply;
pub mod rectangle;
pub mod roots;
pub mod sphere;
pub mod topology;
pub mod triangles;

pub use bounds::Bounds;
pub use cube::Cube;
pub use cylinder::Cylinder;
pub use disk::Disk;
pub use mesh::TriangleMesh;
pub use placement::Placement;
pub use rectangle::Rectangle;
pub use roots::{barycentric, plane_t, sphere_other_root, sphere_roots};
pub use sphere::{DirectionSample, Sphere};
pub use topology::Topology;

use crate::math::{DMat3, DVec2, DVec3};

/// A crossing of a ray with a shape, at `o + t w`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeHit {
    /// In lengths of the ray's direction.
    pub t: f64,
    /// Surface coordinates in [0,1]^2; for a mesh the weights of the face's second and third vertex.
    pub uv: DVec2,
    /// Mesh: triangle; cube: `2 axis + (1 if on the positive side)`; else 0.
    pub face: u32,
}

/// The ray's origin was computed as a point ON this face of the shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Start {
    pub face: u32,
}

/// A point drawn on a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    pub p: DVec3,
    /// Unit geometric normal, flipped as the shape says.
    pub n: DVec3,
    pub uv: DVec2,
    pub face: u32,
    /// Density per unit area of the surface, no cosine.
    pub pdf_area: f64,
}

/// What every shape can tell. World space throughout.
pub trait Geometry {
    fn bounds(&self) -> Bounds;

    fn area(&self) -> f64;

    /// Does the surface bound a volume? Rectangles, disks and cylinders do not.
    fn is_closed(&self) -> bool;

    /// Nearest crossing with `t` in `(t_min, t_max]`. With `start`, the root at the origin is left out: the whole face of
    /// a plane shape, the root at 0 of a sphere or cylinder. A ray that starts on a convex shape and points inward always finds its
    /// exit, at `t > 0`.
    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit>;

    /// `t` and the face of what [`Geometry::intersect`] finds: all that a ray asks for, without surface coordinates.
    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)>;

    /// Where the infinite line enters and leaves a convex closed shape; `None` for a miss and for all other shapes.
    fn crossings(&self, _o: DVec3, _w: DVec3) -> Option<[ShapeHit; 2]> {
        None
    }

    /// Unit geometric normal at a point `p` of `face`.
    fn normal(&self, face: u32, p: DVec3) -> DVec3;

    fn position(&self, face: u32, uv: DVec2) -> DVec3;

    /// Surface coordinates of a point `p` of `face`: the inverse of `position`.
    fn uv(&self, face: u32, p: DVec3) -> DVec2;

    /// Number of faces; they are named 0, 1, ...
    fn face_count(&self) -> u32;

    /// The point of `face` nearest to `p`, which may lie anywhere. Of equally near ones any.
    fn nearest_on_face(&self, face: u32, p: DVec3) -> DVec3;

    /// The point of the surface nearest to `p`, and its face; of equally near faces the first. Linear in the faces: for meshes a reference.
    fn nearest(&self, p: DVec3) -> (DVec3, u32) {
        let mut best = (self.nearest_on_face(0, p), 0);
        let mut least = best.0.distance_squared(p);
        for face in 1..self.face_count() {
            let q = self.nearest_on_face(face, p);
            let squared = q.distance_squared(p);
            if squared < least {
                (best, least) = ((q, face), squared);
            }
        }
        best
    }

    /// A point uniform in area from `u`, `v` in [0,1). Its density is `1 / area`.
    fn sample(&self, u: f64, v: f64) -> SurfaceSample;
}

#[derive(Clone, Debug)]
pub enum Shape {
    /// Triangles; which face is hit is Embree's business (`intersect` here is linear in the faces: a reference).
    Mesh(TriangleMesh),
    /// Centre and radius; `to_world` may rotate, move and scale uniformly.
    Sphere(Sphere),
    /// `[-1,1]^2` in z = 0, normal +z.
    Rectangle(Rectangle),
    /// Unit disk in z = 0, normal +z.
    Disk(Disk),
    /// `[-1,1]^3`, normals outward.
    Cube(Cube),
    /// The wall between two rims, without caps; `to_world` may stretch it along its axis, but not make it elliptic.
    Cylinder(Cylinder),
}

/// The same call on whatever the shape is: a jump, and inlined where it is hot, not a call through a table.
macro_rules! each {
    ($shape:expr, $s:ident => $call:expr) => {
        match $shape {
            Shape::Mesh($s) => $call,
            Shape::Sphere($s) => $call,
            Shape::Rectangle($s) => $call,
            Shape::Disk($s) => $call,
            Shape::Cube($s) => $call,
            Shape::Cylinder($s) => $call,
        }
    };
}

impl Shape {
    /// Whether it is curved: a sphere, or a cylinder.
    pub fn is_round(&self) -> bool {
        matches!(self, Shape::Sphere(_) | Shape::Cylinder(_))
    }

    /// A computed point of a face, put back on it, with the normal there: rays bring the rounding of where they began, and faces in one plane are told apart from others by less than that
    /// where coordinates are small. Not from so far that the normal's own rounding brings more.
    pub fn snap(&self, face: u32, p: DVec3) -> (DVec3, DVec3) {
        let on = match self {
            Shape::Sphere(s) => {
                let p = s.snap(p);
                return (p, s.normal(face, p));
            }
            Shape::Cylinder(s) => {
                let p = s.snap(p);
                return (p, s.normal(face, p));
            }
            Shape::Mesh(m) => m.corners(face)[0],
            Shape::Disk(_) => self.position(face, DVec2::ZERO),
            Shape::Rectangle(_) | Shape::Cube(_) => self.position(face, DVec2::splat(0.5)),
        };
        let (n, off) = (self.normal(face, p), p - on);
        let is_near = off.abs().max_element() <= 8.0 * p.abs().max_element();
        (if is_near { p - n * n.dot(off) } else { p }, n)
    }

    /// How the unit normal n turns as its point p moves over the surface, as a map on velocities, 1/length.
    pub fn curvature(&self, p: DVec3, n: DVec3) -> DMat3 {
        let outer = |a: DVec3| DMat3::from_cols(a * a.x, a * a.y, a * a.z);
        match self {
            Shape::Sphere(s) => (DMat3::IDENTITY - outer(n)) * (n.dot(p - s.center).signum() / s.radius),
            // Around the axis only.
            Shape::Cylinder(s) => outer(s.axis.cross(n)) * (n.dot(s.from_axis(p)).signum() / s.radius),
            _ => DMat3::ZERO,
        }
    }
}

impl Geometry for Shape {
    fn bounds(&self) -> Bounds {
        each!(self, s => s.bounds())
    }
    fn area(&self) -> f64 {
        each!(self, s => s.area())
    }
    fn is_closed(&self) -> bool {
        each!(self, s => s.is_closed())
    }
    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit> {
        each!(self, s => s.intersect(o, w, t_min, t_max, start))
    }
    #[inline]
    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)> {
        each!(self, s => s.cross(o, w, t_min, t_max, start))
    }
    fn crossings(&self, o: DVec3, w: DVec3) -> Option<[ShapeHit; 2]> {
        each!(self, s => s.crossings(o, w))
    }
    fn normal(&self, face: u32, p: DVec3) -> DVec3 {
        each!(self, s => s.normal(face, p))
    }
    fn position(&self, face: u32, uv: DVec2) -> DVec3 {
        each!(self, s => s.position(face, uv))
    }
    fn uv(&self, face: u32, p: DVec3) -> DVec2 {
        each!(self, s => s.uv(face, p))
    }
    fn face_count(&self) -> u32 {
        each!(self, s => s.face_count())
    }
    fn nearest_on_face(&self, face: u32, p: DVec3) -> DVec3 {
        each!(self, s => s.nearest_on_face(face, p))
    }
    fn nearest(&self, p: DVec3) -> (DVec3, u32) {
        each!(self, s => s.nearest(p))
    }
    fn sample(&self, u: f64, v: f64) -> SurfaceSample {
        each!(self, s => s.sample(u, v))
    }
}

#[cfg(test)]
mod file_tests;
#[cfg(test)]
mod nearest_tests;
#[cfg(test)]
mod tests;
