//! What shots go past ([`super::virtual_edge`]): edges, rims, balls and walls, and what lies on either side as a ray sees them.

use super::edge_set::SharedEdge;
use super::outline::Faces;
use super::rims::Rim;
use crate::math::DVec3;
use crate::math::rng::Rng;
use crate::scene::Scene;
use crate::shape::edges::Edge;
use crate::shape::edges::FLAT;
use crate::shape::{Cylinder, Geometry, Sphere};
use crate::transport::shot::{Shot, Target};
use smallvec::SmallVec;
use std::borrow::Cow;
use std::f64::consts::TAU;

/// As a ray sees it.
pub struct Facing {
    /// Across the ray, toward the lit side.
    pub n: DVec3,
    /// Faces (shape, face) on either side; none on the lit one of a silhouette.
    pub faces: Faces,
}

/// Shape and face of every side of an edge.
type Names = SmallVec<[(u32, u32); 2]>;

impl Facing {
    /// n: outward, of a ball or wall.
    pub fn of_round(shape: u32, n: DVec3) -> Facing {
        Facing { n, faces: Faces { own: vec![(shape, 0)], lit: Vec::new() } }
    }

    /// Of an edge, with the sine of the angle between the ray w and that.
    pub fn of_edge(scene: &Scene, e: &SharedEdge, w: DVec3) -> Option<(Facing, f64)> {
        let names: Names = e.sides().map(|s| (s.0, s.1)).collect();
        Facing::of_sides(scene, &e.edge, &names, w)
    }

    /// The same of the edge of a rim at a place of it.
    pub fn of_rim(scene: &Scene, rim: &Rim, edge: &Edge, w: DVec3) -> Option<(Facing, f64)> {
        let names: Names = rim.shapes().map(|s| (s, 0)).collect();
        Facing::of_sides(scene, edge, &names, w)
    }

    fn of_sides(scene: &Scene, edge: &Edge, names: &[(u32, u32)], w: DVec3) -> Option<(Facing, f64)> {
        let normal = (edge.b - edge.a).normalize().cross(w);
        let sin = normal.length();
        if sin.is_nan() || sin <= 0.0 {
            return None;
        }
        let on = |keep: &dyn Fn(f64) -> bool| {
            let sides = names.iter().zip(&edge.sides).filter(|(_, s)| keep(normal.dot(s.corner - edge.a)));
            sides.map(|(name, _)| *name).collect::<Vec<_>>()
        };
        let side = edge.covered_side(normal);
        if side != 0.0 {
            let faces = Faces { own: on(&|_| true), lit: Vec::new() };
            return Some((Facing { n: normal * (-side / sin), faces }, sin));
        }
        let (own, lit) = (on(&|d| d < 0.0), on(&|d| d > 0.0));
        let parts = !own.is_empty() && !lit.is_empty() && parts(scene, edge, names);
        parts.then_some((Facing { n: normal / sin, faces: Faces { own, lit } }, sin))
    }
}

/// What shots go past.
pub enum Outline<'a> {
    Edge(SharedEdge),
    /// At a place of it.
    Rim(&'a Rim, Edge),
    /// An opaque one.
    Ball(u32, &'a Sphere),
    /// From outside.
    Wall(u32, &'a Cylinder),
}

impl Outline<'_> {
    /// A random point of an edge, by the number t, great circle of a ball, or height of a wall.
    pub fn target(&self, t: f64, rng: &mut Rng) -> Target {
        match self {
            Outline::Edge(e) => Target::Point(e.edge.a.lerp(e.edge.b, t)),
            Outline::Rim(_, edge) => Target::Point(edge.a),
            Outline::Ball(ball, s) => Target::ball(*ball, s, t, rng.uniform()),
            Outline::Wall(wall, q) => Target::wall(*wall, q, t),
        }
    }

    pub fn grazed(&self) -> Cow<'_, [(u32, Vec<u32>)]> {
        match self {
            Outline::Edge(e) => Cow::Borrowed(&e.faces),
            Outline::Rim(rim, _) => Cow::Borrowed(&rim.grazed),
            Outline::Ball(shape, _) | Outline::Wall(shape, _) => Cow::Owned(vec![(*shape, Vec::new())]),
        }
    }

    /// As a shot sees it, and what goes with the [`Shot::spread`]: the length across the ray of an edge or of a whole rim, a wall's height, 1 of a ball.
    pub fn facing(&self, scene: &Scene, shot: &Shot) -> Option<(Facing, f64)> {
        match self {
            Outline::Edge(e) => {
                let (facing, sin) = Facing::of_edge(scene, e, shot.w)?;
                Some((facing, sin * (e.edge.b - e.edge.a).length()))
            }
            Outline::Rim(rim, edge) => {
                let (facing, sin) = Facing::of_rim(scene, rim, edge, shot.w)?;
                Some((facing, sin * TAU * (edge.b - edge.a).length()))
            }
            Outline::Ball(ball, s) => Some((Facing::of_round(*ball, (shot.e - s.center).normalize()), 1.0)),
            Outline::Wall(wall, q) => Some((Facing::of_round(*wall, q.from_axis(shot.e).normalize()), q.length)),
        }
    }
}

/// Whether what leaves the faces of an edge may differ: they have another slope or another surface.
fn parts(scene: &Scene, edge: &Edge, names: &[(u32, u32)]) -> bool {
    let mut sides = names.iter().map(|&(id, face)| {
        let s = &scene.shapes[id as usize];
        (s.shape.normal(face, edge.a), s.surface, s.light)
    });
    let Some((n, surface, light)) = sides.next() else { return false };
    sides.any(|(m, s, l)| (s, l) != (surface, light) || n.cross(m).length() > FLAT || n.dot(m) < 0.0)
}
