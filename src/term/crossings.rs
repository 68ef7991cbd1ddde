//! Shapes that pass through each other, or through themselves: the curve where they meet is seen as an edge, but no file lists it. Where it is made of straight lines that move as
//! both do, [`super::cuts`] finds them; how any other moves no room knows.

use super::Motion;
use super::edge_set::Ends;
use crate::math::{DVec3, warp};
use crate::scene::{Hit, Scene};
use crate::shape::edges::is_flat;
use crate::shape::{Bounds, Geometry, Shape};
use rayon::prelude::*;
use std::f64::consts::TAU;

/// Edges that are looked at, about; of every shape as many, but no fewer than the second.
const EDGES: usize = 200_000;
const OF_A_SHAPE: usize = 200;
/// Straight pieces of a circle.
const PIECES: usize = 64;
/// By how much of a piece circles are turned.
const OFF_AXES: f64 = 0.37;
/// Shapes that one line may meet.
const MOST: usize = 256;
/// Ends of a line count as touching up to this share of it, and lines that are parallel to a surface up to this cosine.
const TOUCHES: f64 = 1e-4;
/// How far aside lines are moved that may only touch: in scene radii, and in their own lengths at most.
const ASIDE: f64 = 1e-4;
const OF_A_LINE: f64 = 1e-2;

/// What a line meets between its ends, in order; faces of `past` do not count.
pub fn met_along(scene: &Scene, [a, b]: [DVec3; 2], past: &[(u32, Vec<u32>)]) -> Vec<Hit> {
    let length = (b - a).length();
    let w = (b - a) / length;
    let (mut met, mut t) = (Vec::new(), 0.0);
    while met.len() < MOST && t < length {
        let from = a + w * t;
        let Some(hit) = scene.opaque_past(from, w, length - t, past) else { break };
        t += hit.t.max(0.0) + 4.0 * scene.tolerance(from);
        met.push(hit);
    }
    met
}

/// Pairs of opaque shapes (or twice the same) of which one runs through the other, but for those of flat ones of which one is `compared` ([`super::cuts`]). What it looks at are
/// lines on the shapes.
pub fn all(scene: &Scene, motion: &Motion, compared: &[bool]) -> Vec<(u32, u32)> {
    let flat = |k: u32| is_flat(&scene.shapes[k as usize].shape);
    let told = |a: u32, b: u32| flat(a) && flat(b) && (compared[a as usize] || compared[b as usize]);
    if (0..scene.shapes.len() as u32).all(|k| told(k, k) || scene.is_null(&scene.shapes[k as usize])) {
        return Vec::new();
    }
    let through = |faces: &[(u32, Vec<u32>)], a: DVec3, b: DVec3| {
        let (from, to) = (a.lerp(b, TOUCHES), b.lerp(a, TOUCHES));
        let w = (b - a).normalize();
        let met = met_along(scene, [from, to], faces);
        if met.is_empty() {
            return Vec::new();
        }
        // A line that only touches misses it when it is moved aside, one way or another.
        let aside = (ASIDE * scene.bounds.radius()).min(OF_A_LINE * (b - a).length());
        let (u, v) = warp::frame(w);
        let beside = [u, -u, v, -v].map(|off| met_along(scene, [from + off * aside, to + off * aside], faces));
        let crosses = |h: &&Hit| {
            h.n.dot(w).abs() > TOUCHES && beside.iter().all(|met| met.iter().any(|other| other.shape == h.shape))
        };
        let owners = || faces.iter().map(|f| f.0);
        let pairs = met.iter().filter(crosses).flat_map(|h| owners().map(|o| (o, h.shape)));
        pairs.filter(|&(a, b)| !told(a, b)).collect::<Vec<_>>()
    };
    let edges = motion.edges(scene);
    // Of the others, an edge of flat shapes that are compared can only meet round ones.
    let opaque = |k: &u32| !scene.is_null(&scene.shapes[*k as usize]);
    let round = (0..scene.shapes.len() as u32).filter(opaque).filter(|&k| !flat(k));
    let round: Vec<Bounds> = round.map(|k| scene.shapes[k as usize].shape.bounds()).collect();
    let concerned = |&i: &usize| {
        let Ends { a, b, .. } = edges.ends(scene, i);
        let own: Bounds = [a, b].into_iter().collect();
        edges.any(i, |s| !compared[s as usize]) || round.iter().any(|r| r.gap(&own) == 0.0)
    };
    let through_edge = |i: usize| {
        let e = edges.get(scene, i);
        through(&e.faces, e.edge.a, e.edge.b)
    };
    let shapes = scene.shapes.len();
    let chosen = edges.spread(shapes, (EDGES / shapes.max(1)).max(OF_A_SHAPE));
    let mut pairs: Vec<(u32, u32)> = chosen.into_par_iter().filter(concerned).flat_map_iter(through_edge).collect();
    for (i, s) in scene.shapes.iter().enumerate().filter(|(_, s)| !scene.is_null(s)) {
        let faces = [(i as u32, Vec::new())];
        let circle = |c: DVec3, x: DVec3, y: DVec3| {
            let at = |k: usize| {
                // Corners may lie in faces that go through the middle: not along axes.
                let (s, q) = (TAU * (k as f64 + OFF_AXES) / PIECES as f64).sin_cos();
                c + x * q + y * s
            };
            (0..PIECES).flat_map(|k| through(&faces, at(k), at(k + 1))).collect::<Vec<_>>()
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
                    through(&faces, a, b)
                };
                pairs.extend((0..PIECES).flat_map(line));
            }
            _ => {}
        }
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}
