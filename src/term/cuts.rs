//! Lines along which flat faces that move alike pass through each other: a crease of the picture that no file lists.
//!
//! Two faces meet in a line of both planes, clipped by both polygons. Which faces meet is told by the edges of their shapes: each of the line's ends is where
//! an edge of one face passes through the other, so rays along edges find most pairs twice. Not found are lines that end on borders of both faces, and those that
//! lie on a border of one (a wall through a floor right over a seam of it).

use super::edge_set::{EdgeSet, SharedEdge};
use super::{Motion, crossings, ends};
use crate::math::DVec3;
use crate::math::nearest::to_segment;
use crate::scene::Scene;
use crate::shape::edges::{Edge, Side, border, is_flat, with_corners};
use crate::shape::{Bounds, Geometry};
use rayon::prelude::*;

/// A face: shape and number.
type Face = (u32, u32);

/// Of [`ends::contact`]: what a line must be longer than, and further away from the borders of both faces, or it is that of a face that stands on the other.
const CONTACTS: f64 = 2.0;
/// Sine of the angle between two faces up to which they lie in one plane.
const FLAT: f64 = 1e-9;

/// A straight line in two faces.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    pub ends: [DVec3; 2],
    pub faces: [Face; 2],
}

/// Whether the curve in which two shapes meet is made of such lines.
pub fn are_straight(scene: &Scene, motion: &Motion, [a, b]: [u32; 2]) -> bool {
    let flat = |k: u32| is_flat(&scene.shapes[k as usize].shape) && !motion.moving.bends(k);
    flat(a) && flat(b) && motion.class(a) == motion.class(b)
}

/// All lines in which these pairs of shapes (or one with itself) meet.
pub fn all(scene: &Scene, pairs: &[(u32, u32)], edges: &EdgeSet) -> Vec<Cut> {
    let bounds: Vec<Bounds> = scene.shapes.iter().map(|s| s.shape.bounds()).collect();
    let met = |i: usize| faces_met(scene, pairs, &bounds, &edges.get(scene, i));
    let concerned = |&i: &usize| pairs.iter().any(|&(a, b)| edges.any(i, |s| s == a || s == b));
    let mut faces: Vec<[Face; 2]> = (0..edges.len()).into_par_iter().filter(concerned).flat_map_iter(met).collect();
    faces.par_sort_unstable();
    faces.dedup();
    faces.into_par_iter().filter_map(|f| line(scene, f)).collect()
}

/// Pairs of faces, the lower first, of which an edge shows that they may meet.
fn faces_met(scene: &Scene, pairs: &[(u32, u32)], bounds: &[Bounds], e: &SharedEdge) -> Vec<[Face; 2]> {
    let (a, b) = (e.edge.a, e.edge.b);
    let own: Bounds = [a, b].into_iter().collect();
    let partner = |s: u32, t: u32| pairs.contains(&(s, t)) || pairs.contains(&(t, s));
    let near = |s: u32, t: u32| s == t || bounds[t as usize].gap(&own) == 0.0;
    let mut partners: Vec<u32> = Vec::new();
    for &(s, t) in pairs {
        for (s, t) in [(s, t), (t, s)] {
            if e.faces.iter().any(|f| f.0 == s) && near(s, t) {
                partners.push(t);
            }
        }
    }
    if partners.is_empty() {
        return Vec::new();
    }
    let with = |other: Face| {
        let sides = e.sides().map(|s| (s.0, s.1)).filter(move |s| partner(s.0, other.0));
        sides.map(move |own| [own.min(other), own.max(other)])
    };
    let met = crossings::met_along(scene, [a, b], &e.faces).into_iter().map(|h| (h.shape, h.face));
    met.filter(|other| partners.contains(&other.0)).flat_map(with).collect()
}

/// What two faces have in common.
fn line(scene: &Scene, faces: [Face; 2]) -> Option<Cut> {
    let least = CONTACTS * ends::contact(scene);
    let corners = |(s, f): Face| with_corners(&scene.shapes[s as usize].shape, f, <[DVec3]>::to_vec);
    let polygons = [corners(faces[0])?, corners(faces[1])?];
    let normals = [0, 1].map(|k| (polygons[k][1] - polygons[k][0]).cross(polygons[k][2] - polygons[k][0]).normalize());
    let d = normals[0].cross(normals[1]);
    let sin = d.length();
    if sin.is_nan() || sin <= FLAT {
        return None;
    }
    let d = d / sin;
    // The point of both planes next to a corner of the first face.
    let (p, q) = (polygons[0][0], polygons[1][0]);
    let o = p + normals[0].cross(d) * (normals[1].dot(q - p) / normals[1].dot(normals[0].cross(d)));
    let (mut t0, mut t1) = (f64::NEG_INFINITY, f64::INFINITY);
    for (polygon, n) in polygons.iter().zip(normals) {
        let [s0, s1] = clip(polygon, n, o, d)?;
        (t0, t1) = (t0.max(s0), t1.min(s1));
    }
    let ends = [o + d * t0, o + d * t1];
    let inside =
        |polygon: &Vec<DVec3>| border(polygon).all(|[a, b]| to_segment(0.5 * (ends[0] + ends[1]), a, b) > least);
    (t1 - t0 > least && polygons.iter().all(inside)).then_some(Cut { ends, faces })
}

/// The part of the line o + t d in the plane of a convex polygon that lies in it.
fn clip(polygon: &[DVec3], n: DVec3, o: DVec3, d: DVec3) -> Option<[f64; 2]> {
    let (mut t0, mut t1) = (f64::NEG_INFINITY, f64::INFINITY);
    for [a, b] in border(polygon) {
        let inward = n.cross(b - a);
        let (height, slope) = (inward.dot(o - a), inward.dot(d));
        match slope {
            s if s > 0.0 => t0 = t0.max(-height / s),
            s if s < 0.0 => t1 = t1.min(-height / s),
            _ if height < 0.0 => return None,
            _ => {}
        }
    }
    (t0 < t1).then_some([t0, t1])
}

impl Cut {
    /// As an edge of four sides: either face goes on beyond the other.
    pub fn edge(&self, scene: &Scene) -> SharedEdge {
        let [a, b] = self.ends;
        let (along, middle) = (b - a, 0.5 * (a + b));
        let mut sides = Vec::new();
        let mut faces: Vec<(u32, Vec<u32>)> = Vec::new();
        for (shape, face) in self.faces {
            let off = scene.shapes[shape as usize].shape.normal(face, middle).cross(along);
            sides.extend([off, -off].map(|off| Side { face, corner: middle + off }));
            match faces.last_mut().filter(|f| f.0 == shape) {
                Some(f) => f.1.extend([face; 2]),
                None => faces.push((shape, vec![face; 2])),
            }
        }
        SharedEdge { edge: Edge { a, b, sides }, faces }
    }
}
