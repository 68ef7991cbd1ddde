//! Edges of all flat shapes of a scene: those whose ends coincide are one, whichever shapes they belong to (a box of rectangles), as long as
//! they move alike.
//!
//! An edge of two faces of one mesh, which is nearly all of them, takes 12 bytes here: what it is made of is looked up in the mesh.

use super::Motion;
use crate::math::DVec3;
use crate::scene::Scene;
use crate::shape::edges::{Edge, Side, halves, is_flat, polygons};
use crate::shape::halves::Half;
use crate::shape::{Bounds, Geometry, Shape, TriangleMesh};
use rayon::prelude::*;
use std::collections::HashMap;

/// Ends of edges of different shapes within this share of the scene's radius are one.
const WELD: f64 = 1e-9;

/// An edge with the faces of all shapes that share it: of every shape its faces, in the order of the edge's sides.
#[derive(Clone, Debug)]
pub struct SharedEdge {
    pub edge: Edge,
    pub faces: Vec<(u32, Vec<u32>)>,
}

impl SharedEdge {
    fn of(shape: u32, edge: Edge) -> SharedEdge {
        let faces = edge.sides.iter().map(|s| s.face).collect();
        SharedEdge { edge, faces: vec![(shape, faces)] }
    }

    /// Shape and face of every side.
    pub fn sides(&self) -> impl Iterator<Item = (u32, u32, DVec3)> + '_ {
        let names = self.faces.iter().flat_map(|(shape, faces)| faces.iter().map(move |&f| (*shape, f)));
        names.zip(&self.edge.sides).map(|((shape, face), side)| (shape, face, side.corner))
    }
}

/// One or two faces of a mesh.
#[derive(Clone, Copy, Debug)]
struct Pair {
    shape: u32,
    halves: [Half; 2],
}

/// Both ends of an edge.
pub struct Ends {
    pub a: DVec3,
    pub b: DVec3,
    /// A corner of each of its faces, off the edge, if there are two.
    pub pair: Option<[DVec3; 2]>,
}

#[derive(Clone, Debug, Default)]
pub struct EdgeSet {
    pairs: Vec<Pair>,
    /// All others, at the end those of [`super::cuts`].
    shared: Vec<SharedEdge>,
    cuts: usize,
}

/// What two edges have in common that are one.
type Place = ([[i64; 3]; 2], u32);

/// Edges that may meet edges of other shapes, by where they are.
struct Weld {
    cell: f64,
    by_place: HashMap<Place, usize>,
}

impl Weld {
    fn place(&self, a: DVec3, b: DVec3, class: u32) -> Place {
        let key = |p: DVec3| (p / self.cell).round().to_array().map(|x| x as i64);
        let (a, b) = (key(a), key(b));
        (if a < b { [a, b] } else { [b, a] }, class)
    }
}

impl EdgeSet {
    /// Of everything opaque.
    pub fn new(scene: &Scene, motion: &Motion) -> EdgeSet {
        let mut set = EdgeSet::default();
        let cell = scene.bounds.radius().max(f64::MIN_POSITIVE) * WELD;
        let mut weld = Weld { cell, by_place: HashMap::new() };
        let members: Vec<(u32, u32, Bounds)> = (0..scene.shapes.len() as u32)
            .filter(|&i| !scene.is_null(&scene.shapes[i as usize]) && is_flat(&scene.shapes[i as usize].shape))
            .map(|i| (i, motion.class(i), scene.shapes[i as usize].shape.bounds().grown(cell)))
            .collect();
        for &(i, class, own) in &members {
            let alike = members.iter().filter(|m| m.0 != i && m.1 == class);
            let near: Vec<Bounds> = alike.map(|m| m.2).filter(|b| b.gap(&own) == 0.0).collect();
            let meets = |a: DVec3, b: DVec3| near.iter().any(|n| n.contains(a) && n.contains(b));
            match &scene.shapes[i as usize].shape {
                Shape::Mesh(m) => halves(m, |group| {
                    let (a, b) = m.half_edge(group[0]);
                    match *group {
                        [h] if !meets(a, b) => set.pairs.push(Pair { shape: i, halves: [h, Half::NONE] }),
                        [h, k] if !meets(a, b) => set.pairs.push(Pair { shape: i, halves: [h, k] }),
                        _ => set.add(&mut weld, SharedEdge::of(i, mesh_edge(m, group)), class),
                    }
                }),
                flat => polygons(flat).into_iter().for_each(|e| set.add(&mut weld, SharedEdge::of(i, e), class)),
            }
        }
        set
    }

    fn add(&mut self, weld: &mut Weld, e: SharedEdge, class: u32) {
        let place = weld.place(e.edge.a, e.edge.b, class);
        let at = *weld.by_place.entry(place).or_insert(self.shared.len());
        match self.shared.get_mut(at) {
            Some(shared) => {
                shared.edge.sides.extend(e.edge.sides);
                shared.faces.extend(e.faces);
            }
            None => self.shared.push(e),
        }
    }

    /// Without some edges, in order, and with others: `cuts` have faces all around, so that they are no silhouette from anywhere.
    #[must_use]
    pub fn with_cuts(mut self, without: &[usize], [plain, cuts]: [Vec<SharedEdge>; 2]) -> EdgeSet {
        let mut number = 0..;
        let mut kept = || number.next().is_some_and(|i: usize| without.binary_search(&i).is_err());
        self.pairs.retain(|_| kept());
        self.shared.retain(|_| kept());
        self.cuts += cuts.len();
        self.shared.extend(plain);
        self.shared.extend(cuts);
        self
    }

    /// Edges spread over every shape, about `most` of each.
    pub fn spread(&self, shapes: usize, most: usize) -> Vec<usize> {
        let mut counts = vec![0usize; shapes];
        (0..self.len()).for_each(|i| counts[self.shape(i) as usize] += 1);
        let mut seen = vec![0usize; shapes];
        let mut chosen = |i: &usize| {
            let s = self.shape(*i) as usize;
            seen[s] += 1;
            (seen[s] - 1) % counts[s].div_ceil(most) == 0
        };
        (0..self.len()).filter(|i| chosen(i)).collect()
    }

    pub fn is_cut(&self, i: usize) -> bool {
        i + self.cuts >= self.len()
    }

    pub fn len(&self) -> usize {
        self.pairs.len() + self.shared.len()
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The shape of an edge; of a shared one the first.
    pub fn shape(&self, i: usize) -> u32 {
        self.pairs.get(i).map_or_else(|| self.shared[i - self.pairs.len()].faces[0].0, |p| p.shape)
    }

    /// Whether any of the shapes of an edge is one of these.
    pub fn any(&self, i: usize, of: impl Fn(u32) -> bool) -> bool {
        match self.pairs.get(i) {
            Some(p) => of(p.shape),
            None => self.shared[i - self.pairs.len()].faces.iter().any(|f| of(f.0)),
        }
    }

    /// Whether any of the faces (shape, face) of an edge is one of these.
    pub fn any_face(&self, i: usize, of: impl Fn((u32, u32)) -> bool) -> bool {
        match self.pairs.get(i) {
            Some(p) => p.halves.iter().filter(|&&h| h != Half::NONE).any(|h| of((p.shape, h.face()))),
            None => self.shared[i - self.pairs.len()].sides().any(|(shape, face, _)| of((shape, face))),
        }
    }

    /// Where an edge is, and the corners of its faces where it has two, at no cost.
    pub fn ends(&self, scene: &Scene, i: usize) -> Ends {
        let Some(pair) = self.pairs.get(i) else {
            let e = &self.shared[i - self.pairs.len()].edge;
            let pair = if let [s, t] = &e.sides[..] { Some([s.corner, t.corner]) } else { None };
            return Ends { a: e.a, b: e.b, pair };
        };
        let m = mesh(scene, pair.shape);
        let (a, b) = m.half_edge(pair.halves[0]);
        Ends { a, b, pair: (pair.halves[1] != Half::NONE).then(|| pair.halves.map(|h| m.opposite(h))) }
    }

    pub fn get(&self, scene: &Scene, i: usize) -> SharedEdge {
        let Some(pair) = self.pairs.get(i) else { return self.shared[i - self.pairs.len()].clone() };
        let m = mesh(scene, pair.shape);
        let halves = if pair.halves[1] == Half::NONE { &pair.halves[..1] } else { &pair.halves[..] };
        SharedEdge::of(pair.shape, mesh_edge(m, halves))
    }

    /// Edges all of whose faces lie on one side of a plane through them, whose normal depends on the ends, and of which `keep` takes the shape.
    pub fn silhouettes(
        &self,
        scene: &Scene,
        keep: impl Fn(u32) -> bool + Sync,
        normal: impl Fn(DVec3, DVec3) -> DVec3 + Sync,
    ) -> Vec<usize> {
        let of_pair = |p: &Pair| {
            let m = mesh(scene, p.shape);
            let (a, b) = m.half_edge(p.halves[0]);
            let n = normal(a, b);
            let side = |h: Half| n.dot(m.opposite(h) - a);
            let [h, k] = p.halves;
            let first = side(h);
            first != 0.0 && (k == Half::NONE || side(k) * first > 0.0)
        };
        let chosen = |&i: &usize| {
            keep(self.shape(i))
                && match self.pairs.get(i) {
                    Some(p) => of_pair(p),
                    None => {
                        let e = &self.shared[i - self.pairs.len()].edge;
                        e.covered_side(normal(e.a, e.b)) != 0.0
                    }
                }
        };
        (0..self.len()).into_par_iter().filter(chosen).collect()
    }
}

/// The mesh of a pair.
fn mesh(scene: &Scene, shape: u32) -> &TriangleMesh {
    match &scene.shapes[shape as usize].shape {
        Shape::Mesh(m) => m,
        _ => unreachable!("pairs are edges of meshes"),
    }
}

fn mesh_edge(m: &TriangleMesh, halves: &[Half]) -> Edge {
    let (a, b) = m.half_edge(halves[0]);
    Edge { a, b, sides: halves.iter().map(|h| Side { face: h.face(), corner: m.opposite(*h) }).collect() }
}
