//! Bodies that stand on each other or against a border of a medium, and part as they move: what opens between them is seen on one side of the motion
//! only, so that there is no derivative.

use super::Motion;
use crate::math::DVec3;
use crate::params::{ParamSet, Slot};
use crate::scene::Scene;
use crate::scene::nearest::{Kind, Near};
use crate::shape::Geometry;

/// Edges that are looked at, at most.
const EDGES: usize = 20_000;
/// Where on an edge; two of them have to touch.
const PLACES: [f64; 3] = [0.23, 0.5, 0.77];
/// Distances that count as contact, in scene radii, and speeds that count as parting, of the larger one.
const TOUCHES: f64 = 1e-7;
const PARTS: f64 = 1e-6;

/// Two shapes (the second a border, perhaps) of which one has an edge in a face of the other, where a parameter moves that edge off the face or into it.
pub fn find(scene: &Scene, motion: &Motion, params: &ParamSet) -> Option<(u32, u32)> {
    let reach = TOUCHES * scene.bounds.radius();
    let edges = motion.edges(scene);
    let step = edges.len().div_ceil(EDGES).max(1);
    (0..edges.len()).step_by(step).find_map(|i| {
        let e = edges.get(scene, i);
        let own = e.faces[0].0;
        let face = e.faces[0].1.first().copied().unwrap_or(0);
        let mut parting = None;
        for p in PLACES.map(|t| e.edge.a.lerp(e.edge.b, t)) {
            let other = |s: u32| e.faces.iter().all(|f| f.0 != s);
            let alike = |s: u32| motion.class(s) == motion.class(own);
            let body = scene.nearest_point(Kind::Opaque, p, reach, &|s, _| other(s) && !alike(s));
            let border = || scene.nearest_point(Kind::Null, p, reach, &|s, _| scene.shapes[s as usize].boundary);
            let near: Option<Near> = body.or_else(border);
            let Some(near) = near else { continue };
            let n = scene.shapes[near.shape as usize].shape.normal(near.face, near.p);
            if parts(scene, params, [own, face], [near.shape, near.face], p, n) {
                if parting == Some(near.shape) {
                    return Some((own, near.shape));
                }
                parting = Some(near.shape);
            }
        }
        None
    })
}

/// Whether two faces have different velocities along n at p, for any parameter.
fn parts(scene: &Scene, params: &ParamSet, a: [u32; 2], b: [u32; 2], p: DVec3, n: DVec3) -> bool {
    let velocity = |[shape, face]: [u32; 2], k: usize| {
        let along = |axis: DVec3| {
            let mut sum = 0.0;
            scene.matter(shape, face).forms(p, axis, |f| {
                sum += (0..f.len).map(|j| f.v[j as usize] * params.tangents(f.slot + j as Slot)[k]).sum::<f64>();
            });
            sum
        };
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    };
    (0..params.len()).any(|k| {
        let (a, b) = (velocity(a, k), velocity(b, k));
        (a - b).dot(n).abs() > PARTS * a.length().max(b.length())
    })
}
