//! Edges of a mesh: holes, orientation, faces without area. Files store triangles as soup, so vertices are welded by
//! position first: equal coordinates, then (if holes remain) at holes coordinates that agree to a few ulps of the file's precision.

use super::TriangleMesh;
use super::halves::by_edge;
use crate::math::DVec3;
use rustc_hash::FxHashMap;

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
    /// Vertex normals of length 0.
    pub zero_normals: usize,
    /// Enclosed volume (closed meshes): positive if the normals point outward.
    pub signed_volume: f64,
}

#[derive(Default)]
struct EdgeCounts {
    boundary: usize,
    non_manifold: usize,
    inconsistent: usize,
    /// Stored vertices at edges of one face, each once by its name.
    open: Vec<u32>,
}

/// Which vertices are one.
struct Weld {
    /// Of each stored vertex.
    name: Vec<u32>,
    names: usize,
}

impl Topology {
    pub(super) fn new(mesh: &TriangleMesh) -> Self {
        let mut weld = weld_equal(&mesh.vertices);
        let mut edges = EdgeCounts::new(&mesh.faces, &weld);
        // Names that are as many as vertices are the vertices' own numbers.
        let stored = (weld.names < mesh.vertices.len())
            .then(|| EdgeCounts::new(&mesh.faces, &Weld::none(mesh.vertices.len())).boundary);
        let boundary_edges_stored = stored.unwrap_or(edges.boundary);
        let mut welded_by_tolerance = false;
        // Use the tolerance only where it helps: at holes, and there only if it closes some. It may also close what is meant to be open by a hair.
        if edges.boundary > 0 {
            let near = weld.near(&mesh.vertices, &edges.open, WELD_ROUNDINGS * mesh.rounding);
            if near.names < weld.names {
                let near_edges = EdgeCounts::new(&mesh.faces, &near);
                if near_edges.boundary < edges.boundary {
                    (weld, edges, welded_by_tolerance) = (near, near_edges, true);
                }
            }
        }
        Topology {
            welded_vertices: weld.names,
            weld: weld.name,
            welded_by_tolerance,
            boundary_edges_stored,
            boundary_edges: edges.boundary,
            non_manifold_edges: edges.non_manifold,
            inconsistent_edges: edges.inconsistent,
            degenerate_faces: (0..mesh.faces.len() as u32).filter(|&f| mesh.is_degenerate(f)).count(),
            faces_against_normals: (0..mesh.faces.len() as u32).filter(|&f| mesh.is_against_normals(f)).count(),
            zero_normals: mesh.normals.as_ref().map_or(0, |n| n.iter().filter(|n| **n == DVec3::ZERO).count()),
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

    /// How many parts the faces make that share no welded vertex.
    pub fn pieces(&self, faces: &[[u32; 3]]) -> usize {
        let mut parent: Vec<u32> = (0..self.welded_vertices as u32).collect();
        fn root(parent: &mut [u32], mut v: u32) -> u32 {
            while parent[v as usize] != v {
                parent[v as usize] = parent[parent[v as usize] as usize];
                v = parent[v as usize];
            }
            v
        }
        for f in faces {
            let [a, b, c] = f.map(|v| root(&mut parent, self.weld[v as usize]));
            parent[b as usize] = a;
            let c = root(&mut parent, c);
            parent[c as usize] = a;
        }
        let mut found: Vec<u32> = faces.iter().map(|f| root(&mut parent, self.weld[f[0] as usize])).collect();
        found.sort_unstable();
        found.dedup();
        found.len()
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

    /// Faces, edges and normals that no clean mesh has; `None` if there are none.
    pub fn defects(&self) -> Option<String> {
        let mut parts = Vec::new();
        if self.degenerate_faces > 0 {
            parts.push(format!("{} faces without area", self.degenerate_faces));
        }
        if self.non_manifold_edges > 0 {
            parts.push(format!("{} edges with more than two faces", self.non_manifold_edges));
        }
        if self.zero_normals > 0 {
            parts.push(format!("{} vertex normals of length 0", self.zero_normals));
        }
        (!parts.is_empty()).then(|| parts.join(", "))
    }
}

impl EdgeCounts {
    /// Faces that collapse by the weld have no edges.
    fn new(faces: &[[u32; 3]], weld: &Weld) -> EdgeCounts {
        let name = |v: u32| weld.name[v as usize];
        let (mut counts, mut is_open) = (EdgeCounts::default(), vec![false; weld.names]);
        by_edge(
            faces,
            weld.names,
            name,
            |_| true,
            |edge| {
                let forward = edge.iter().filter(|h| name(h.corner(faces, 0)) < name(h.corner(faces, 1))).count();
                counts.boundary += usize::from(edge.len() == 1);
                counts.non_manifold += usize::from(edge.len() > 2);
                counts.inconsistent += usize::from(edge.len() > 1 && 2 * forward != edge.len());
                if let [h] = edge {
                    let ends = [0, 1].map(|k| h.corner(faces, k));
                    counts
                        .open
                        .extend(ends.into_iter().filter(|&v| !std::mem::replace(&mut is_open[name(v) as usize], true)));
                }
            },
        );
        counts
    }
}

impl Weld {
    fn none(vertices: usize) -> Weld {
        Weld { name: (0..vertices as u32).collect(), names: vertices }
    }

    /// The same with some names for one, numbered in the order of appearance.
    fn merged(&self, merge: impl Fn(u32) -> u32) -> Weld {
        let mut seen: FxHashMap<u32, u32> = FxHashMap::default();
        let mut number = |name: u32| {
            let next = seen.len() as u32;
            *seen.entry(name).or_insert(next)
        };
        let name = self.name.iter().map(|&n| number(merge(n))).collect();
        Weld { name, names: seen.len() }
    }

    /// And with those of these vertices for one that are nearer than `tolerance`, chains included: a grid of that pitch, then union-find among neighbours.
    fn near(&self, vertices: &[DVec3], which: &[u32], tolerance: f64) -> Weld {
        let cell = |p: DVec3| (p / tolerance).floor().to_array().map(|x| x as i64);
        let mut grid: FxHashMap<[i64; 3], Vec<u32>> = FxHashMap::default();
        let mut parent: Vec<u32> = (0..self.names as u32).collect();
        fn root(parent: &mut [u32], mut i: u32) -> u32 {
            while parent[i as usize] != i {
                parent[i as usize] = parent[parent[i as usize] as usize];
                i = parent[i as usize];
            }
            i
        }
        for &i in which {
            let p = vertices[i as usize];
            let [x, y, z] = cell(p);
            for k in 0..27 {
                let neighbour =
                    [x.saturating_add(k % 3 - 1), y.saturating_add(k / 3 % 3 - 1), z.saturating_add(k / 9 - 1)];
                for &j in grid.get(&neighbour).into_iter().flatten() {
                    if p.distance_squared(vertices[j as usize]) <= tolerance * tolerance {
                        let [a, b] = [i, j].map(|v| root(&mut parent, self.name[v as usize]));
                        parent[a.max(b) as usize] = a.min(b);
                    }
                }
            }
            grid.entry([x, y, z]).or_default().push(i);
        }
        let merged: Vec<u32> = (0..self.names as u32).map(|i| root(&mut parent, i)).collect();
        self.merged(|n| merged[n as usize])
    }
}

fn weld_equal(vertices: &[DVec3]) -> Weld {
    let mut seen: FxHashMap<[u64; 3], u32> = FxHashMap::with_capacity_and_hasher(vertices.len(), Default::default());
    let mut number = |p: &DVec3| {
        let next = seen.len() as u32;
        // Adding 0 makes -0 and 0 one key.
        *seen.entry(p.to_array().map(|x| (x + 0.0).to_bits())).or_insert(next)
    };
    let name = vertices.iter().map(&mut number).collect();
    Weld { name, names: seen.len() }
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
