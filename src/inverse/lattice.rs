//! Parameters of a field, coarse to fine: numbers on a lattice of every n-th voxel, and between them the trilinear interpolant.
//!
//! The field at voxel p is `u(p) = Σ_k w_k(p) x_k` over the eight corners of the lattice's cell around p, x the parameters, w the weights of
//! trilinear interpolation; so `∂L/∂x_k = Σ_p w_k(p) ∂L/∂u(p)`. A lattice has the corners of those cells alone that hold an active voxel. At spacing 1
//! parameters are the voxels themselves. A finer lattice begins with the values of the coarser one at its places: the field stays as it is.
//! Memory: 24 bytes a node, 4 a voxel and 32 a cell, all of them fewer than the active voxels times a constant.

use std::collections::HashMap;

/// No neighbour.
const NONE: u32 = u32::MAX;

/// A lattice over voxels at index positions (any order, each once).
#[derive(Clone, Debug)]
pub struct Lattice {
    spacing: i32,
    /// In units of the spacing; left out at spacing 1.
    places: Vec<[i32; 3]>,
    /// Of every node a voxel that needs it.
    witness: Vec<u32>,
    /// Corners of cells, z fastest.
    cells: Vec<[u32; 8]>,
    /// Cell of every voxel.
    cell_of: Vec<u32>,
}

impl Lattice {
    pub fn new(voxels: &[[i32; 3]], spacing: i32) -> Lattice {
        let mut l =
            Lattice { spacing, places: Vec::new(), witness: Vec::new(), cells: Vec::new(), cell_of: Vec::new() };
        if spacing == 1 {
            l.witness = (0..voxels.len() as u32).collect();
            return l;
        }
        let (mut nodes, mut cells): (HashMap<[i32; 3], u32>, HashMap<[i32; 3], u32>) = Default::default();
        for (v, p) in voxels.iter().enumerate() {
            let low = p.map(|x| x.div_euclid(spacing));
            let cell = *cells.entry(low).or_insert_with(|| {
                l.cells.push(std::array::from_fn(|k| {
                    let place = corner(low, k);
                    *nodes.entry(place).or_insert_with(|| {
                        l.places.push(place);
                        l.witness.push(v as u32);
                        l.places.len() as u32 - 1
                    })
                }));
                l.cells.len() as u32 - 1
            });
            l.cell_of.push(cell);
        }
        l
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.witness.len()
    }

    pub fn is_empty(&self) -> bool {
        self.witness.is_empty()
    }

    pub fn spacing(&self) -> i32 {
        self.spacing
    }

    /// Position of a node, in units of the spacing.
    fn place(&self, voxels: &[[i32; 3]], node: usize) -> [i32; 3] {
        if self.spacing == 1 { voxels[node] } else { self.places[node] }
    }

    /// Corners and weights around a position (in voxels) of the cell of a voxel.
    fn corners(&self, voxel: usize, p: [f64; 3]) -> impl Iterator<Item = (usize, f64)> + '_ {
        let cell = &self.cells[self.cell_of[voxel] as usize];
        let low = self.places[cell[0] as usize];
        let f: [f64; 3] = std::array::from_fn(|a| p[a] / f64::from(self.spacing) - f64::from(low[a]));
        (0..8).map(move |k| {
            let w = |a: usize| if k >> (2 - a) & 1 == 1 { f[a] } else { 1.0 - f[a] };
            (cell[k] as usize, w(0) * w(1) * w(2))
        })
    }

    /// The field at the voxels from the numbers of the nodes, both with channels interleaved.
    pub fn spread(&self, voxels: &[[i32; 3]], channels: usize, nodes: &[f64]) -> Vec<f64> {
        if self.spacing == 1 {
            return nodes.to_vec();
        }
        let mut out = vec![0.0; voxels.len() * channels];
        for (v, (p, out)) in voxels.iter().zip(out.chunks_exact_mut(channels)).enumerate() {
            for (k, w) in self.corners(v, p.map(f64::from)) {
                (0..channels).for_each(|c| out[c] += w * nodes[k * channels + c]);
            }
        }
        out
    }

    /// The transpose: derivatives by the nodes from those by the voxels.
    pub fn collect(&self, voxels: &[[i32; 3]], channels: usize, gradient: &[f64]) -> Vec<f64> {
        if self.spacing == 1 {
            return gradient.to_vec();
        }
        let mut out = vec![0.0; self.len() * channels];
        for (v, (p, g)) in voxels.iter().zip(gradient.chunks_exact(channels)).enumerate() {
            for (k, w) in self.corners(v, p.map(f64::from)) {
                (0..channels).for_each(|c| out[k * channels + c] += w * g[c]);
            }
        }
        out
    }

    /// Nodes from voxels, where a field is given: each the mean of the voxels that it touches, by their weights; `otherwise` where there is none.
    pub fn means(&self, voxels: &[[i32; 3]], channels: usize, field: &[f64], otherwise: f64) -> Vec<f64> {
        let sums = self.collect(voxels, channels, field);
        let weights = self.collect(voxels, channels, &vec![1.0; field.len()]);
        sums.iter().zip(weights).map(|(s, w)| if w > 0.0 { s / w } else { otherwise }).collect()
    }

    /// The numbers of a finer lattice over the same voxels, of half the spacing or any that divides it: the field here at its nodes.
    pub fn refined(&self, voxels: &[[i32; 3]], channels: usize, nodes: &[f64], finer: &Lattice) -> Vec<f64> {
        debug_assert!(self.spacing > finer.spacing && self.spacing % finer.spacing == 0);
        let mut out = vec![0.0; finer.len() * channels];
        for (n, out) in out.chunks_exact_mut(channels).enumerate() {
            let p = finer.place(voxels, n).map(|x| f64::from(x * finer.spacing));
            for (k, w) in self.corners(finer.witness[n] as usize, p) {
                (0..channels).for_each(|c| out[c] += w * nodes[k * channels + c]);
            }
        }
        out
    }

    /// Of every node the next one along each axis, `u32::MAX` where there is none. Voxels that `lone` tells of (tiles) have none.
    pub fn neighbours(&self, voxels: &[[i32; 3]], lone: impl Fn(usize) -> bool) -> Vec<[u32; 3]> {
        let fine = self.spacing == 1;
        let own = (0..self.len()).filter(|&n| !(fine && lone(n)));
        let places: HashMap<[i32; 3], u32> = own.map(|n| (self.place(voxels, n), n as u32)).collect();
        let next = |n: usize| {
            let p = self.place(voxels, n);
            std::array::from_fn(|a| {
                let mut q = p;
                q[a] += 1;
                places.get(&q).copied().filter(|_| places.get(&p) == Some(&(n as u32))).unwrap_or(NONE)
            })
        };
        (0..self.len()).map(next).collect()
    }
}

fn corner(low: [i32; 3], k: usize) -> [i32; 3] {
    std::array::from_fn(|a| low[a] + (k >> (2 - a) & 1) as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Part of a box with negative positions.
    fn voxels() -> Vec<[i32; 3]> {
        let all = (0..9 * 7 * 5).map(|i: i32| [i / 35 - 4, i / 5 % 7 - 3, i % 5]);
        all.filter(|p| (p[0] * 3 + p[1] + p[2]).rem_euclid(4) != 0).collect()
    }

    #[test]
    fn linear_fields_are_kept_by_every_lattice_and_its_refinements() {
        let v = voxels();
        let linear = |p: [f64; 3]| 0.5 + 0.25 * p[0] - 0.125 * p[1] + 2.0 * p[2];
        for spacing in [2, 4] {
            let l = Lattice::new(&v, spacing);
            let at = |l: &Lattice, n: usize| linear(l.place(&v, n).map(|x| f64::from(x * l.spacing)));
            let nodes: Vec<f64> = (0..l.len()).map(|n| at(&l, n)).collect();
            for (p, x) in v.iter().zip(l.spread(&v, 1, &nodes)) {
                assert!((x - linear(p.map(f64::from))).abs() < 1e-12, "{p:?}");
            }
            let finer = Lattice::new(&v, spacing / 2);
            for (n, x) in l.refined(&v, 1, &nodes, &finer).into_iter().enumerate() {
                assert!((x - at(&finer, n)).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_refined_field_is_the_same_and_collecting_is_the_transpose_of_spreading() {
        let v = voxels();
        let number = |i: usize| (i as f64 * 12.9898).sin();
        let l = Lattice::new(&v, 4);
        let nodes: Vec<f64> = (0..3 * l.len()).map(number).collect();
        let field = l.spread(&v, 3, &nodes);
        for spacing in [1, 2] {
            let finer = Lattice::new(&v, spacing);
            let same = finer.spread(&v, 3, &l.refined(&v, 3, &nodes, &finer));
            assert!(field.iter().zip(&same).all(|(a, b)| (a - b).abs() < 1e-12), "{spacing}");
        }
        let g: Vec<f64> = (0..field.len()).map(|i| number(i + 7)).collect();
        let one: f64 = field.iter().zip(&g).map(|(a, b)| a * b).sum();
        let other: f64 = nodes.iter().zip(l.collect(&v, 3, &g)).map(|(a, b)| a * b).sum();
        assert!((one - other).abs() < 1e-10);
        // Constants are kept.
        assert!(l.means(&v, 1, &vec![0.3; v.len()], 0.3).iter().all(|x| (x - 0.3).abs() < 1e-12));
    }

    #[test]
    fn neighbours_stand_side_by_side() {
        let v = voxels();
        for spacing in [1, 2] {
            let l = Lattice::new(&v, spacing);
            let next = l.neighbours(&v, |n| n == 3);
            let mut count = 0;
            for (n, m) in
                next.iter().enumerate().flat_map(|(n, m)| m.iter().enumerate().map(move |(a, m)| ((n, a), *m)))
            {
                if m != NONE {
                    let (p, q) = (l.place(&v, n.0), l.place(&v, m as usize));
                    assert_eq!(q[n.1], p[n.1] + 1);
                    count += 1;
                    assert!(spacing == 2 || n.0 != 3 && m != 3);
                }
            }
            assert!(count > l.len() / 2);
        }
    }
}
