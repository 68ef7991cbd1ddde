//! Edges of a mesh: holes, orientation, faces without area. Files store triangles as soup, so vertices are welded by
//! position first: equal coordinates, then (if holes remain) coordinates that agree to a few ulps of the file's precision.

use super::TriangleMesh;
use crate::math::DVec3;
use std::collections::HashMap;

/// Vertices nearer than this many roundings of the file's coordinates are one vertex, if that closes holes.
const WELD_ROUNDINGS: f64 = 4.0;

#[derive(Clone, Debug, PartialEq)]
pub struct Topology {
    /// Welded vertex of each stored vertex, numbered from 0.
    pub weld: Vec<u32>,
    pub welded_vertices: usize,
    /// Did welding need a tolerance, or were equal coordinates enough?
    pub welded_by_tolerance: bool,
    /// Edges of one face only, by stored vertex index.
    pub boundary_edges_stored: usize,
    /// Edges of one face only, after welding: holes.
    pub boundary_edges: usize,
    /// Edges of three or more faces, after welding.
    pub non_manifold_edges: usize,
    /// Edges that their faces do not run through equally often in both senses, holes not counted.
    pub inconsistent_edges: usize,
    /// Faces without area.
    pub degenerate_faces: usize,
    /// Faces whose winding opposes their vertex normals.
    pub faces_against_normals: usize,
    /// Enclosed volume (closed meshes): positive if the normals point outward.
    pub signed_volume: f64,
}

#[derive(Default)]
struct EdgeCounts {
    boundary: usize,
    non_manifold: usize,
    inconsistent: usize,
}

impl Topology {
    pub(super) fn new(mesh: &TriangleMesh) -> Self {
        let stored = count_edges(&mesh.faces, |v| v);
        let mut weld = weld_equal(&mesh.vertices);
        let mut edges = count_edges(&mesh.faces, |v| weld[v as usize]);
        let mut welded_by_tolerance = false;
        // Use the tolerance only where it helps: it may also close what is meant to be open by a hair.
        if edges.boundary > 0 {
            let near = weld_near(&mesh.vertices, WELD_ROUNDINGS * mesh.rounding);
            let near_edges = count_edges(&mesh.faces, |v| near[v as usize]);
            if near_edges.boundary < edges.boundary {
                (weld, edges, welded_by_tolerance) = (near, near_edges, true);
            }
        }
        Topology {
            welded_vertices: weld.iter().max().map_or(0, |&m| m as usize + 1),
            weld,
            welded_by_tolerance,
            boundary_edges_stored: stored.boundary,
            boundary_edges: edges.boundary,
            non_manifold_edges: edges.non_manifold,
            inconsistent_edges: edges.inconsistent,
            degenerate_faces: (0..mesh.faces.len() as u32).filter(|&f| mesh.is_degenerate(f)).count(),
            faces_against_normals: (0..mesh.faces.len() as u32).filter(|&f| mesh.is_against_normals(f)).count(),
            signed_volume: signed_volume(mesh),
        }
    }

    /// No holes after welding: the surface bounds a volume.
    pub fn is_closed(&self) -> bool {
        self.boundary_edges == 0
    }

    /// Neighbouring faces agree on which side is outside.
    pub fn is_consistently_oriented(&self) -> bool {
        self.inconsistent_edges == 0
    }

    /// Closed, and all of its faces are turned inward.
    pub fn is_inside_out(&self) -> bool {
        self.is_closed() && self.is_consistently_oriented() && self.signed_volume < 0.0
    }

    /// Why this mesh should not bound a medium as it stands; `None` if all is well. Stored soup that welds shut is well.
    pub fn leaks(&self) -> Option<String> {
        let mut parts = Vec::new();
        if self.boundary_edges > 0 {
            parts.push(format!("{} open edges after welding", self.boundary_edges));
        }
        if self.welded_by_tolerance {
            parts.push("vertices that should coincide differ by rounding".into());
        }
        if self.inconsistent_edges > 0 {
            parts.push(format!("{} edges whose faces disagree on the outside", self.inconsistent_edges));
        }
        if self.faces_against_normals > 0 {
            parts.push(format!("{} faces wound against their vertex normals", self.faces_against_normals));
        }
        if self.is_inside_out() {
            parts.push("normals that point inward".into());
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }

    /// Faces and edges that no clean mesh has; `None` if there are none.
    pub fn defects(&self) -> Option<String> {
        let mut parts = Vec::new();
        if self.degenerate_faces > 0 {
            parts.push(format!("{} faces without area", self.degenerate_faces));
        }
        if self.non_manifold_edges > 0 {
            parts.push(format!("{} edges with more than two faces", self.non_manifold_edges));
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

/// Count edges of faces whose vertices go through `name`. Faces that collapse by it have no edges.
fn count_edges(faces: &[[u32; 3]], name: impl Fn(u32) -> u32) -> EdgeCounts {
    let mut edges: Vec<(u32, u32, bool)> = Vec::with_capacity(3 * faces.len());
    for f in faces {
        let [a, b, c] = f.map(&name);
        if a != b && b != c && c != a {
            edges.extend([(a, b), (b, c), (c, a)].map(|(p, q)| (p.min(q), p.max(q), p < q)));
        }
    }
    edges.sort_unstable();
    let mut counts = EdgeCounts::default();
    for e in edges.chunk_by(|x, y| (x.0, x.1) == (y.0, y.1)) {
        let forward = e.iter().filter(|x| x.2).count();
        counts.boundary += usize::from(e.len() == 1);
        counts.non_manifold += usize::from(e.len() > 2);
        counts.inconsistent += usize::from(e.len() > 1 && 2 * forward != e.len());
    }
    counts
}

fn weld_equal(vertices: &[DVec3]) -> Vec<u32> {
    let mut seen = HashMap::with_capacity(vertices.len());
    vertices
        .iter()
        .map(|p| {
            let next = seen.len() as u32;
            // Adding 0 makes -0 and 0 one key.
            *seen.entry(p.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next)
        })
        .collect()
}

/// Weld vertices nearer than `tolerance`, chains included: a grid of that pitch, then union-find among neighbours.
fn weld_near(vertices: &[DVec3], tolerance: f64) -> Vec<u32> {
    let cell = |p: DVec3| (p / tolerance).floor().to_array().map(|x| x as i64);
    let mut grid: HashMap<[i64; 3], Vec<u32>> = HashMap::with_capacity(vertices.len());
    let mut parent: Vec<u32> = (0..vertices.len() as u32).collect();
    fn root(parent: &mut [u32], mut i: u32) -> u32 {
        while parent[i as usize] != i {
            parent[i as usize] = parent[parent[i as usize] as usize];
            i = parent[i as usize];
        }
        i
    }
    for (i, &p) in vertices.iter().enumerate() {
        let [x, y, z] = cell(p);
        for k in 0..27 {
            let neighbour = [x.saturating_add(k % 3 - 1), y.saturating_add(k / 3 % 3 - 1), z.saturating_add(k / 9 - 1)];
            for &j in grid.get(&neighbour).into_iter().flatten() {
                if p.distance_squared(vertices[j as usize]) <= tolerance * tolerance {
                    let (a, b) = (root(&mut parent, i as u32), root(&mut parent, j));
                    parent[a.max(b) as usize] = a.min(b);
                }
            }
        }
        // Equal points need one entry only: piles of them would make this quadratic.
        let pile = grid.entry([x, y, z]).or_default();
        match pile.iter().find(|&&j| vertices[j as usize] == p) {
            Some(&j) => {
                let (a, b) = (root(&mut parent, i as u32), root(&mut parent, j));
                parent[a.max(b) as usize] = a.min(b);
            }
            None => pile.push(i as u32),
        }
    }
    // Number the roots in order of appearance.
    let mut names = HashMap::new();
    (0..vertices.len() as u32)
        .map(|i| {
            let next = names.len() as u32;
            *names.entry(root(&mut parent, i)).or_insert(next)
        })
        .collect()
}

/// Sum of signed tetrahedra about a vertex of the mesh itself, which keeps the digits far from the origin.
fn signed_volume(mesh: &TriangleMesh) -> f64 {
    let o = mesh.vertices[mesh.faces[0][0] as usize];
    let six_volumes = (0..mesh.faces.len() as u32).map(|f| {
        let [a, b, c] = mesh.corners(f).map(|p| p - o);
        a.dot(b.cross(c))
    });
    six_volumes.sum::<f64>() / 6.0
}
