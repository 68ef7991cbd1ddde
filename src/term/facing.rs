//! What shots go past ([`super::virtual_edge`]): edges and balls, and what lies on either side as a ray sees them.

use super::edge_set::SharedEdge;
use super::outline::Faces;
use crate::math::DVec3;
use crate::math::rng::Rng;
use crate::scene::Scene;
use crate::shape::edges::FLAT;
use crate::shape::{Geometry, Sphere};
use crate::transport::shot::{Shot, Target};
use std::borrow::Cow;

/// As a ray sees it.
pub struct Facing {
    /// Across the ray, toward the lit side.
    pub n: DVec3,
    /// Faces (shape, face) on either side; none on the lit one of a silhouette.
    pub faces: Faces,
}

impl Facing {
    /// n: away from the ball's centre.
    pub fn of_ball(ball: u32, n: DVec3) -> Facing {
        Facing { n, faces: Faces { own: vec![(ball, 0)], lit: Vec::new() } }
    }

    /// Of an edge, with the sine of the angle between the ray w and that.
    pub fn of_edge(scene: &Scene, e: &SharedEdge, w: DVec3) -> Option<(Facing, f64)> {
        let normal = (e.edge.b - e.edge.a).normalize().cross(w);
        let sin = normal.length();
        if sin.is_nan() || sin <= 0.0 {
            return None;
        }
        let on = |keep: &dyn Fn(f64) -> bool| {
            let sides = e.sides().filter(|s| keep(normal.dot(s.2 - e.edge.a)));
            sides.map(|s| (s.0, s.1)).collect::<Vec<_>>()
        };
        let side = e.edge.covered_side(normal);
        if side != 0.0 {
            let faces = Faces { own: on(&|_| true), lit: Vec::new() };
            return Some((Facing { n: normal * (-side / sin), faces }, sin));
        }
        let (own, lit) = (on(&|d| d < 0.0), on(&|d| d > 0.0));
        let parts = !own.is_empty() && !lit.is_empty() && parts(scene, e);
        parts.then_some((Facing { n: normal / sin, faces: Faces { own, lit } }, sin))
    }
}

/// What shots go past.
pub enum Outline<'a> {
    Edge(SharedEdge),
    /// An opaque one.
    Ball(u32, &'a Sphere),
}

impl Outline<'_> {
    /// A random point of an edge, by the number t, or great circle of a ball.
    pub fn target(&self, t: f64, rng: &mut Rng) -> Target {
        match self {
            Outline::Edge(e) => Target::Point(e.edge.a.lerp(e.edge.b, t)),
            Outline::Ball(ball, s) => Target::ball(*ball, s, t, rng.uniform()),
        }
    }

    pub fn grazed(&self) -> Cow<'_, [(u32, Vec<u32>)]> {
        match self {
            Outline::Edge(e) => Cow::Borrowed(&e.faces),
            Outline::Ball(ball, _) => Cow::Owned(vec![(*ball, Vec::new())]),
        }
    }

    /// As a shot sees it, and what goes with the [`Shot::spread`]: an edge's length across the ray, 1 of a ball.
    pub fn facing(&self, scene: &Scene, shot: &Shot) -> Option<(Facing, f64)> {
        match self {
            Outline::Edge(e) => {
                let (facing, sin) = Facing::of_edge(scene, e, shot.w)?;
                Some((facing, sin * (e.edge.b - e.edge.a).length()))
            }
            Outline::Ball(ball, s) => Some((Facing::of_ball(*ball, (shot.e - s.center).normalize()), 1.0)),
        }
    }
}

/// Whether what leaves the faces of an edge may differ: they have another slope or another surface.
fn parts(scene: &Scene, e: &SharedEdge) -> bool {
    let middle = 0.5 * (e.edge.a + e.edge.b);
    let mut sides = e.sides().map(|(id, face, _)| {
        let s = &scene.shapes[id as usize];
        (s.shape.normal(face, middle), s.surface, s.light)
    });
    let Some((n, surface, light)) = sides.next() else { return false };
    sides.any(|(m, s, l)| (s, l) != (surface, light) || n.cross(m).length() > FLAT || n.dot(m) < 0.0)
}
