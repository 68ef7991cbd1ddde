//! Shapes that pass through each other, and meshes that bend through themselves: the curve where they meet is seen as an edge, but is none of either, and no room knows how it moves.

use super::Motion;
use crate::math::{DVec3, warp};
use crate::scene::Scene;
use crate::shape::Shape;
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Edges that are looked at, at most.
const EDGES: usize = 20_000;
/// Straight pieces of a circle.
const PIECES: usize = 64;
/// Ends of a line count as touching up to this share of it, and lines that are parallel to a surface up to this cosine.
const TOUCHES: f64 = 1e-4;

/// Pairs of opaque shapes (or twice the same) of which one runs through the other; what it looks at are lines on the shapes.
pub fn all(scene: &Scene, motion: &Motion) -> Vec<(u32, u32)> {
    let through = |owner: u32, faces: &[(u32, Vec<u32>)], a: DVec3, b: DVec3| {
        let length = (b - a).length();
        let w = (b - a) / length;
        let hit = scene.opaque_past(a + w * (TOUCHES * length), w, length * (1.0 - 2.0 * TOUCHES), faces)?;
        let met = hit.shape;
        // A line that only touches misses it when it is moved aside, one way or another.
        let aside = TOUCHES * scene.bounds.radius();
        let (u, v) = warp::frame(w);
        let runs_in = |off: DVec3| {
            let a = a + w * (TOUCHES * length) + off * aside;
            let hit = scene.opaque_past(a, w, length * (1.0 - 2.0 * TOUCHES), faces);
            hit.is_some_and(|h| h.shape == met)
        };
        let crosses = hit.n.dot(w).abs() > TOUCHES && [u, -u, v, -v].into_iter().all(runs_in);
        crosses.then_some((owner, met))
    };
    let edges = motion.edges(scene);
    let step = edges.len().div_ceil(EDGES).max(1);
    let through_edge = |i: usize| {
        let e = edges.get(scene, i);
        through(e.faces[0].0, &e.faces, e.edge.a, e.edge.b)
    };
    let mut pairs: Vec<(u32, u32)> = (0..edges.len()).into_par_iter().step_by(step).filter_map(through_edge).collect();
    for (i, s) in scene.shapes.iter().enumerate().filter(|(_, s)| !scene.is_null(s)) {
        let faces = [(i as u32, Vec::new())];
        let circle = |c: DVec3, x: DVec3, y: DVec3| {
            let at = |k: usize| {
                let (s, q) = (TAU * k as f64 / PIECES as f64).sin_cos();
                c + x * q + y * s
            };
            (0..PIECES).filter_map(|k| through(i as u32, &faces, at(k), at(k + 1))).collect::<Vec<_>>()
        };
        match &s.shape {
            Shape::Sphere(q) => {
                for n in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::ONE.normalize()] {
                    let (x, y) = warp::frame(n);
                    pairs.extend(circle(q.center, x * q.radius, y * q.radius));
                }
            }
            Shape::Disk(d) => {
                let [x, y] = [DVec3::X, DVec3::Y].map(|v| d.placement.vector(v));
                pairs.extend(circle(d.placement.point(DVec3::ZERO), x, y));
            }
            Shape::Cylinder(c) => {
                let (x, y) = c.rim_axes();
                (0..2).for_each(|k| pairs.extend(circle(c.rim(k).0, x, y)));
                let line = |k: usize| {
                    let (s, q) = (TAU * k as f64 / PIECES as f64).sin_cos();
                    let [a, b] = c.line((x * q + y * s) / c.radius);
                    through(i as u32, &faces, a, b)
                };
                pairs.extend((0..PIECES).filter_map(line));
            }
            _ => {}
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
