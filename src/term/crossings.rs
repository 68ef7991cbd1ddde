//! Shapes that pass through each other, and meshes that bend through themselves: the curve where they meet is seen as an edge, but is none of either, and no room knows how it moves.

use super::Motion;
use crate::math::{DVec3, warp};
use crate::scene::Scene;
use crate::shape::Shape;
use std::f64::consts::TAU;

/// Edges that are looked at, at most.
const EDGES: usize = 20_000;
/// Straight pieces of a circle.
const PIECES: usize = 64;
/// Ends of a line count as touching up to this share of it, and lines that are parallel to a surface up to this cosine.
const TOUCHES: f64 = 1e-4;

/// Two opaque shapes (or twice the same) of which one runs through the other, where either moves or the camera does; what it looks at are lines on the shapes.
pub fn find(scene: &Scene, motion: &Motion) -> Option<(u32, u32)> {
    let through = |owner: u32, faces: &[(u32, Vec<u32>)], a: DVec3, b: DVec3| {
        let length = (b - a).length();
        let w = (b - a) / length;
        let hit = scene.opaque_past(a + w * (TOUCHES * length), w, length * (1.0 - 2.0 * TOUCHES), faces)?;
        let concerned = motion.moving.camera || motion.moves(owner) || motion.moves(hit.shape);
        let other = faces.iter().all(|f| f.0 != hit.shape) || motion.moving.bends(hit.shape);
        (other && concerned && hit.n.dot(w).abs() > TOUCHES).then_some((owner, hit.shape))
    };
    let edges = motion.edges(scene);
    let step = edges.len().div_ceil(EDGES).max(1);
    let through_edge = |i: usize| {
        let e = edges.get(scene, i);
        through(e.faces[0].0, &e.faces, e.edge.a, e.edge.b)
    };
    let crossed = (0..edges.len()).step_by(step).find_map(through_edge);
    crossed.or_else(|| {
        scene.shapes.iter().enumerate().filter(|(_, s)| !scene.is_null(s)).find_map(|(i, s)| {
            let faces = [(i as u32, Vec::new())];
            let circle = |c: DVec3, x: DVec3, y: DVec3| {
                let at = |k: usize| {
                    let (s, q) = (TAU * k as f64 / PIECES as f64).sin_cos();
                    c + x * q + y * s
                };
                (0..PIECES).find_map(|k| through(i as u32, &faces, at(k), at(k + 1)))
            };
            match &s.shape {
                Shape::Sphere(q) => {
                    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ONE.normalize()];
                    axes.into_iter().find_map(|n| {
                        let (x, y) = warp::frame(n);
                        circle(q.center, x * q.radius, y * q.radius)
                    })
                }
                Shape::Disk(d) => {
                    circle(d.placement.point(DVec3::ZERO), d.placement.vector(DVec3::X), d.placement.vector(DVec3::Y))
                }
                Shape::Cylinder(c) => {
                    let (x, y) = c.rim_axes();
                    let line = |k: usize| {
                        let (s, q) = (TAU * k as f64 / PIECES as f64).sin_cos();
                        let [a, b] = c.line((x * q + y * s) / c.radius);
                        through(i as u32, &faces, a, b)
                    };
                    let rims = (0..2).find_map(|k| circle(c.rim(k).0, x, y));
                    rims.or_else(|| (0..PIECES).find_map(line))
                }
                _ => None,
            }
        })
    })
}
