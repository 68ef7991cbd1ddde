//! Edges of shapes and the faces that meet in them: where silhouettes can be.
//!
//! Vertices are welded ([`super::Topology`]) first: files store triangles as soup. Faces without area have no edges.

use super::halves::{Half, by_edge};
use super::{Cube, Rectangle, Shape, TriangleMesh};
use crate::math::DVec3;
use crate::math::nearest::to_segment;

/// Sine of the angle between two faces up to which they lie in one plane.
pub const FLAT: f64 = 1e-9;

/// An edge: two ends and its faces, each with a point of the face off the edge.
#[derive(Clone, Debug)]
pub struct Edge {
    pub a: DVec3,
    pub b: DVec3,
    pub sides: Vec<Side>,
}

/// A face at an edge.
#[derive(Clone, Copy, Debug)]
pub struct Side {
    pub face: u32,
    /// A corner of the face that is not on the edge.
    pub corner: DVec3,
}

impl Edge {
    /// Which side of the plane through the edge that contains `normal`'s complement its faces lie on: the sign of
    /// `<normal, corner - a>` common to all of them, and 0 where they disagree, so that the edge is no silhouette.
    ///
    /// One rule for closed and open meshes, whatever their orientation, and for edges of any number of faces ([T] 2.1, rules 1 and 2).
    pub fn covered_side(&self, normal: DVec3) -> f64 {
        let mut common = 0.0;
        for s in &self.sides {
            let d = normal.dot(s.corner - self.a);
            if d == 0.0 || d * common < 0.0 {
                return 0.0;
            }
            common = d.signum();
        }
        common
    }
}

impl TriangleMesh {
    /// Both ends, that of the lower welded number first.
    pub fn half_edge(&self, h: Half) -> (DVec3, DVec3) {
        let (i, j) = (h.corner(&self.faces, 0), h.corner(&self.faces, 1));
        let weld = &self.topology().weld;
        let (i, j) = if weld[i as usize] < weld[j as usize] { (i, j) } else { (j, i) };
        (self.vertices[i as usize], self.vertices[j as usize])
    }

    /// The corner of the face that is not on the edge.
    pub fn opposite(&self, h: Half) -> DVec3 {
        self.vertices[h.corner(&self.faces, 2) as usize]
    }
}

/// Every edge of a mesh, as the halves that its faces have of it. Vertices are welded; faces without area have none.
pub fn halves(m: &TriangleMesh, f: impl FnMut(&[Half])) {
    let t = m.topology();
    by_edge(&m.faces, t.welded_vertices, |v| t.weld[v as usize], |face| !m.is_degenerate(face), f);
}

/// Edges of a rectangle or cube; none for other shapes.
pub fn polygons(shape: &Shape) -> Vec<Edge> {
    match shape {
        Shape::Rectangle(r) => of_polygons(&[rectangle(r)]),
        Shape::Cube(c) => of_polygons(&std::array::from_fn::<_, 6, _>(|face| cube(c, face))),
        Shape::Mesh(_) | Shape::Sphere(_) | Shape::Disk(_) | Shape::Cylinder(_) => Vec::new(),
    }
}

/// Distance from `p` to where a face ends, or less: to its edges or rims; infinite for a sphere.
pub fn to_border(shape: &Shape, face: u32, p: DVec3) -> f64 {
    to_border_off(shape, face, p, None)
}

/// How far corners may be off a plane that they lie in, relative to their distances.
const IN_PLANE: f64 = 1e-9;

/// The same without edges that lie in the plane through `p` with this normal.
pub fn to_border_off(shape: &Shape, face: u32, p: DVec3, plane: Option<DVec3>) -> f64 {
    let counts = |e: &[DVec3; 2]| plane.is_none_or(|n| !e.iter().all(|y| lies_in_plane(*y, p, n)));
    let polygon = |corners: &[DVec3]| {
        let lines = border(corners).filter(counts);
        lines.map(|[a, b]| to_segment(p, a, b)).fold(f64::INFINITY, f64::min)
    };
    match shape {
        Shape::Disk(d) => d.to_rim(p),
        Shape::Cylinder(c) => c.to_rims(p),
        flat => with_corners(flat, face, polygon).unwrap_or(f64::INFINITY),
    }
}

/// Whether `y` lies in the plane through `p` with this normal.
pub fn lies_in_plane(y: DVec3, p: DVec3, normal: DVec3) -> bool {
    normal.dot(y - p).abs() <= IN_PLANE * (y - p).length()
}

/// Whether two planes, each through a point and across a normal, are one.
pub fn is_same_plane([p, n]: [DVec3; 2], [q, m]: [DVec3; 2]) -> bool {
    n.cross(m).length() <= FLAT && lies_in_plane(p, q, m)
}

/// The edges of a polygon.
pub fn border(corners: &[DVec3]) -> impl Iterator<Item = [DVec3; 2]> + '_ {
    (0..corners.len()).map(|k| [corners[k], corners[(k + 1) % corners.len()]])
}

/// The sides of a convex polygon: a point of each, and the unit vector in the polygon's plane that points into it. Those of no length, or through its middle, bound nothing.
pub fn sides(corners: &[DVec3]) -> impl Iterator<Item = (DVec3, DVec3)> + '_ {
    let center = corners.iter().sum::<DVec3>() / corners.len() as f64;
    border(corners).filter_map(move |[a, b]| {
        let along = (b - a).try_normalize()?;
        let off = center - a;
        Some((a, (off - along * off.dot(along)).try_normalize()?))
    })
}

/// Whether all faces are polygons.
pub fn is_flat(shape: &Shape) -> bool {
    matches!(shape, Shape::Mesh(_) | Shape::Rectangle(_) | Shape::Cube(_))
}

/// What `f` makes of the corners of a flat face, a convex polygon, in order around it; `None` of what is round.
pub fn with_corners<R>(shape: &Shape, face: u32, f: impl FnOnce(&[DVec3]) -> R) -> Option<R> {
    match shape {
        Shape::Mesh(m) => Some(f(&m.corners(face))),
        Shape::Rectangle(r) => Some(f(&rectangle(r))),
        Shape::Cube(c) => Some(f(&cube(c, face as usize))),
        Shape::Disk(_) | Shape::Cylinder(_) | Shape::Sphere(_) => None,
    }
}

fn rectangle(r: &Rectangle) -> [DVec3; 4] {
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| r.placement.point(DVec3::new(x, y, 0.0)))
}

/// Corners of a face, in order around it.
fn cube(c: &Cube, face: usize) -> [DVec3; 4] {
    let (axis, side) = (face / 2, if face % 2 == 1 { 1.0 } else { -1.0 });
    [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| {
        let mut p = DVec3::ZERO;
        (p[axis], p[(axis + 1) % 3], p[(axis + 2) % 3]) = (side, x, y);
        c.placement.point(p)
    })
}

/// Edges of polygons that share corners exactly.
fn of_polygons(faces: &[[DVec3; 4]]) -> Vec<Edge> {
    let mut out: Vec<Edge> = Vec::new();
    for (face, corners) in faces.iter().enumerate() {
        for k in 0..4 {
            let (a, b) = (corners[k], corners[(k + 1) % 4]);
            let side = Side { face: face as u32, corner: corners[(k + 2) % 4] };
            match out.iter_mut().find(|e| (e.a, e.b) == (a, b) || (e.a, e.b) == (b, a)) {
                Some(e) => e.sides.push(side),
                None => out.push(Edge { a, b, sides: vec![side] }),
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{DAffine3, DVec2};
    use crate::shape::{Disk, Geometry};

    #[test]
    fn a_cube_has_twelve_edges_and_six_silhouettes_from_a_corner() {
        let c = Shape::Cube(Cube::new(DAffine3::IDENTITY, false).unwrap());
        let e = polygons(&c);
        assert_eq!(e.len(), 12);
        assert!(e.iter().all(|e| e.sides.len() == 2));
        let p = DVec3::new(5.0, 6.0, 7.0);
        let silhouettes = e.iter().filter(|e| e.covered_side((e.a - p).cross(e.b - p)) != 0.0).count();
        assert_eq!(silhouettes, 6);
        // In front of one face: its own four edges.
        let p = DVec3::new(0.1, 0.2, 3.0);
        assert_eq!(e.iter().filter(|e| e.covered_side((e.a - p).cross(e.b - p)) != 0.0).count(), 4);
    }

    #[test]
    fn borders_of_faces() {
        let at = |s: &Shape, face, p: [f64; 3]| to_border(s, face, p.into());
        let r = Shape::Rectangle(Rectangle::new(DAffine3::from_scale(DVec3::new(3.0, 2.0, 1.0)), false).unwrap());
        assert_eq!(
            [at(&r, 0, [0.0, 0.5, 0.0]), at(&r, 0, [2.75, 0.0, 0.0]), at(&r, 0, [0.0, 5.0, 4.0])],
            [1.5, 0.25, 5.0]
        );
        let c = Shape::Cube(Cube::new(DAffine3::IDENTITY, false).unwrap());
        assert_eq!([at(&c, 1, [1.0, 0.5, 0.0]), at(&c, 0, [-1.0, 0.0, 0.0])], [0.5, 1.0]);
        // Of an ellipse no more than there is.
        let d = Disk::new(DAffine3::from_scale(DVec3::new(3.0, 2.0, 1.0)), false).unwrap();
        let circle = Shape::Disk(Disk::new(DAffine3::from_scale(DVec3::splat(2.0)), false).unwrap());
        assert_eq!([at(&circle, 0, [1.5, 0.0, 0.0]), at(&circle, 0, [0.0, 5.0, 4.0])], [0.5, 5.0]);
        for k in 0..100 {
            let p = DVec3::new(0.07 * f64::from(k) - 3.5, 0.4, 0.03 * f64::from(k % 7));
            let rim = |j: u32| d.position(0, DVec2::new(1.0, f64::from(j) / 5000.0)).distance(p);
            let least = (0..5000).map(rim).fold(f64::INFINITY, f64::min);
            let told = d.to_rim(p);
            assert!(told <= least + 1e-12 && told >= 0.3 * least, "{p}: {told} {least}");
        }
    }

    #[test]
    fn soup_is_welded_and_flat_edges_are_none() {
        // A square of two triangles as soup: the diagonal is an edge of both and never a silhouette.
        let (a, b, c, d) = (DVec3::ZERO, DVec3::X, DVec3::new(1.0, 1.0, 0.0), DVec3::Y);
        let m = TriangleMesh::new(vec![a, b, c, a, c, d], vec![[0, 1, 2], [3, 4, 5]], None, None).unwrap();
        let p = DVec3::new(0.3, 0.4, 2.0);
        let (mut edges, mut silhouettes) = (0, 0);
        halves(&m, |h| {
            let (a, b) = m.half_edge(h[0]);
            let sides = h.iter().map(|&h| Side { face: h.face(), corner: m.opposite(h) }).collect();
            edges += 1;
            silhouettes += usize::from(Edge { a, b, sides }.covered_side((a - p).cross(b - p)) != 0.0);
        });
        assert_eq!((edges, silhouettes), (5, 4));
    }
}
