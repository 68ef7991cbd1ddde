//! Edges of all flat shapes of a scene: those whose ends coincide are one, whichever shapes they belong to (a box of rectangles), as long as
//! they move alike.

use super::Motion;
use crate::math::DVec3;
use crate::scene::Scene;
use crate::shape::Shape;
use crate::shape::edges::{Edge, edges};
use std::collections::HashMap;

/// Ends of edges of different shapes within this share of the scene's radius are one.
const WELD: f64 = 1e-9;

/// An edge with the faces of all shapes that share it: of every shape its faces, in the order of the edge's sides.
pub struct SharedEdge {
    pub edge: Edge,
    pub faces: Vec<(u32, Vec<u32>)>,
}

impl SharedEdge {
    /// Shape and face of every side.
    pub fn sides(&self) -> impl Iterator<Item = (u32, u32, DVec3)> + '_ {
        let names = self.faces.iter().flat_map(|(shape, faces)| faces.iter().map(move |&f| (*shape, f)));
        names.zip(&self.edge.sides).map(|((shape, face), side)| (shape, face, side.corner))
    }
}

#[derive(Default)]
pub struct EdgeSet {
    pub list: Vec<SharedEdge>,
    by_ends: HashMap<([[i64; 3]; 2], u32), usize>,
}

impl EdgeSet {
    /// Of everything opaque.
    pub fn new(scene: &Scene, motion: &Motion) -> EdgeSet {
        let mut set = EdgeSet::default();
        for (i, s) in scene.shapes.iter().enumerate() {
            if !scene.surfaces[s.surface as usize].is_null() {
                set.add(&s.shape, i as u32, motion.class(i as u32), scene.bounds.radius());
            }
        }
        set
    }

    fn add(&mut self, shape: &Shape, id: u32, class: u32, size: f64) {
        let cell = size.max(f64::MIN_POSITIVE) * WELD;
        let key = |p: DVec3| (p / cell).round().to_array().map(|x| x as i64);
        for e in edges(shape) {
            let (a, b) = (key(e.a), key(e.b));
            let ends = (if a < b { [a, b] } else { [b, a] }, class);
            let at = *self.by_ends.entry(ends).or_insert(self.list.len());
            let faces = e.sides.iter().map(|s| s.face).collect();
            match self.list.get_mut(at) {
                Some(shared) => {
                    shared.edge.sides.extend(e.sides);
                    shared.faces.push((id, faces));
                }
                None => self.list.push(SharedEdge { edge: e, faces: vec![(id, faces)] }),
            }
        }
    }
}
