//! Bodies that stand on each other or against a border of a medium, and part as they move: what opens between them is seen on one side of the motion
//! only, so that there is no derivative. So it is with a medium whose border lies in a face that leaves it.

use super::Motion;
use super::rims::Rim;
use crate::math::DVec3;
use crate::params::{ParamSet, Slot};
use crate::scene::nearest::{Kind, Near};
use crate::scene::{Instance, Scene};
use crate::shape::Geometry;
use crate::shape::edges::with_corners;
use rayon::prelude::*;

/// Edges of a shape that are looked at, about.
const EDGES: usize = 20_000;
/// Shapes above which their boxes are not compared in pairs.
const MANY: usize = 2000;
/// Places on an edge, of which two neighbours have to touch.
const PLACES: u32 = 24;
/// Distances that count as contact, in scene radii, and speeds that count as parting, of the largest of both bodies.
const TOUCHES: f64 = 1e-7;
const PARTS: f64 = 1e-6;

/// What stands on something may be this far off or in it.
pub fn reach(scene: &Scene) -> f64 {
    TOUCHES * scene.bounds.radius()
}

/// Two shapes (the second a border, perhaps) of which one has an edge in a face of the other, where a parameter moves that edge off the face or into it.
pub fn find(scene: &Scene, motion: &Motion, params: &ParamSet) -> Option<(u32, u32)> {
    let reach = reach(scene);
    let edges = motion.edges(scene);
    // Shapes with something near.
    let shapes = &scene.shapes;
    let beside = |i: usize| {
        let own = shapes[i].shape.bounds();
        let counts = |k: usize| k != i && (!scene.is_null(&shapes[k]) || shapes[k].boundary);
        shapes.len() > MANY || (0..shapes.len()).any(|k| counts(k) && shapes[k].shape.bounds().gap(&own) <= reach)
    };
    let near: Vec<bool> = (0..shapes.len()).map(beside).collect();
    let listed = |&i: &usize| !edges.is_cut(i) && near[edges.shape(i) as usize];
    let chosen = edges.spread(shapes.len(), EDGES).into_par_iter().filter(listed);
    let of_edge = |i: usize| {
        let e = edges.get(scene, i);
        let shapes: Vec<u32> = e.faces.iter().map(|f| f.0).collect();
        let face = e.faces[0].1.first().copied().unwrap_or(0);
        stands(scene, motion, params, reach, &shapes, face, |t| e.edge.a.lerp(e.edge.b, t))
    };
    let of_rim = |r: &Rim| {
        let shapes: Vec<u32> = r.shapes().collect();
        stands(scene, motion, params, reach, &shapes, 0, |t| r.edge(t).a)
    };
    let found = chosen.find_map_first(of_edge).or_else(|| motion.rims.iter().find_map(of_rim));
    found.or_else(|| borders(scene, motion, params, reach))
}

/// The same for a border of a medium that lies in a face of a body.
fn borders(scene: &Scene, motion: &Motion, params: &ParamSet, reach: f64) -> Option<(u32, u32)> {
    let beside = |id: u32, s: &Instance| {
        let parts = |(k, other): (u32, &Instance)| {
            let body = !scene.is_null(other) && motion.class(k) != motion.class(id);
            body && other.shape.bounds().gap(&s.shape.bounds()) <= reach
        };
        (0..).zip(&scene.shapes).any(parts)
    };
    let of_null = (0..).zip(&scene.shapes).filter(|(id, s)| s.boundary && scene.is_null(s) && beside(*id, s));
    let faces = of_null.flat_map(|(id, s)| (0..s.shape.face_count()).map(move |face| (id, s, face)));
    faces.take(EDGES).find_map(|(id, s, face)| {
        let corners: Vec<DVec3> = with_corners(&s.shape, face, <[DVec3]>::to_vec)?;
        let next = |i: usize| corners[(i + 1) % corners.len()];
        (0..corners.len())
            .find_map(|i| stands(scene, motion, params, reach, &[id], face, |t| corners[i].lerp(next(i), t)))
    })
}

/// What a curve of a shape (of several that share it) lies in and parts from.
fn stands(
    scene: &Scene,
    motion: &Motion,
    params: &ParamSet,
    reach: f64,
    shapes: &[u32],
    face: u32,
    at: impl Fn(f64) -> DVec3,
) -> Option<(u32, u32)> {
    let own = *shapes.first()?;
    let mut before = None;
    for k in 0..PLACES {
        let p = at((f64::from(k) + 0.5) / f64::from(PLACES));
        let other = |s: u32| !shapes.contains(&s) && motion.class(s) != motion.class(own);
        let body = scene.nearest_point(Kind::Opaque, p, reach, &|s, _| other(s));
        let border = || scene.nearest_point(Kind::Null, p, reach, &|s, _| scene.shapes[s as usize].boundary);
        let near: Option<Near> = body.or_else(border);
        let parting = near.filter(|near| {
            let n = scene.shapes[near.shape as usize].shape.normal(near.face, near.p);
            parts(scene, params, [own, face], [near.shape, near.face], p, n)
        });
        let shape = parting.map(|n| n.shape);
        if shape.is_some() && shape == before {
            return Some((own, shape?));
        }
        before = shape;
    }
    None
}

/// Whether two faces have different velocities along n at p, for any parameter: beside the speeds within the smaller one of their shapes.
pub fn parts(scene: &Scene, params: &ParamSet, a: [u32; 2], b: [u32; 2], p: DVec3, n: DVec3) -> bool {
    let velocity = |[shape, face]: [u32; 2], p: DVec3, k: usize| {
        let along = |axis: DVec3| {
            let mut sum = 0.0;
            scene.matter(shape, face).forms(p, axis, |f| {
                sum += (0..f.len).map(|j| f.v[j as usize] * params.tangents(f.slot + j as Slot)[k]).sum::<f64>();
            });
            sum
        };
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    };
    let [first, second] = [a, b].map(|f| scene.shapes[f[0] as usize].shape.bounds());
    let around = if first.radius() < second.radius() { first } else { second };
    (0..params.len()).any(|k| {
        // A hinge stands still but for rounding.
        let speeds = around.probes().into_iter().flat_map(|q| [velocity(a, q, k), velocity(b, q, k)]);
        let fastest = speeds.fold(0.0, |m, v| v.length().max(m));
        (velocity(a, p, k) - velocity(b, p, k)).dot(n).abs() > PARTS * fastest
    })
}
