//! Slots: one number for every value that a grid was made from, so that derivatives have a place to go.
//!
//! A voxel of a leaf or of a dense array has a slot of its own, a tile has one for all of its nodes, the background has
//! none. Nodes repeated in several bricks, or by clamping at the border of a dense array, share their slot.

use super::bricks::{BRICK, ROW, SLAB};
use super::{Frame, Grid, Mask};
use crate::math::DVec3;

/// Nodes of a leaf.
pub(super) const LEAF: usize = BRICK * BRICK * BRICK;

/// The slot of a stored value, `0..node_count()`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(pub u32);

/// No leaf or tile.
pub(super) const BACKGROUND: u32 = u32::MAX;

/// A leaf or a tile as it was given.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stored {
    /// First slot.
    pub base: u32,
    /// Lowest node, edge in nodes.
    pub origin: [i32; 3],
    pub size: i32,
    pub leaf: bool,
    /// Active voxels; a tile is or is not.
    pub active: Mask,
    /// Active voxels before it, and in it before each word of the mask.
    pub rank: u32,
    pub before: [u16; 8],
}

/// Of every node of a brick, which of the eight blocks that it touches holds it, and as which of the block's nodes: `block << 9 | local`.
static PLACES: [u16; SLAB * ROW] = {
    let mut places = [0; SLAB * ROW];
    let mut node = 0;
    while node < places.len() {
        let [x, y, z] = [node / SLAB, node / ROW % ROW, node % ROW];
        let block = (x / BRICK * 2 + y / BRICK) * 2 + z / BRICK;
        places[node] = (block << 9 | (x % BRICK) << 6 | (y % BRICK) << 3 | z % BRICK) as u16;
        node += 1;
    }
    places
};

/// The relation of nodes to slots.
#[derive(Clone, Debug)]
pub(super) enum Layout {
    /// A full array, x fastest, repeated at its border.
    Dense { res: [usize; 3] },
    Sparse {
        /// Of every brick of the table, which leaf or tile holds its lowest node.
        blocks: Vec<u32>,
        /// Every leaf and tile, by slot.
        stored: Vec<Stored>,
        /// Nodes outside of this inclusive range are background.
        range: ([i32; 3], [i32; 3]),
        count: usize,
    },
}

impl Default for Layout {
    fn default() -> Self {
        Layout::Sparse { blocks: Vec::new(), stored: Vec::new(), range: ([0; 3], [-1; 3]), count: 0 }
    }
}

/// The slots of one brick's nodes.
pub(super) enum BrickIds<'a> {
    Dense {
        origin: [i64; 3],
        res: &'a [usize; 3],
    },
    Sparse {
        blocks: [Option<&'a Stored>; 8],
        /// Range of nodes that are not background, in nodes of the brick.
        range: ([i64; 3], [i64; 3]),
        /// All nodes of the brick are within.
        whole: bool,
    },
}

impl Layout {
    pub(super) fn count(&self) -> usize {
        match self {
            Layout::Dense { res } => res.iter().product(),
            Layout::Sparse { count, .. } => *count,
        }
    }

    pub(super) fn bytes(&self) -> usize {
        match self {
            Layout::Dense { .. } => 0,
            Layout::Sparse { blocks, stored, .. } => size_of_val(&blocks[..]) + size_of_val(&stored[..]),
        }
    }

    pub(super) fn brick(&self, frame: &Frame, brick: [usize; 3]) -> BrickIds<'_> {
        let origin: [i64; 3] = std::array::from_fn(|a| i64::from(frame.origin[a]) + (brick[a] * BRICK) as i64);
        match self {
            Layout::Dense { res } => BrickIds::Dense { origin, res },
            Layout::Sparse { blocks, stored, range, .. } => {
                let [nx, ny, nz] = frame.dims;
                let at = |k: usize| {
                    let [x, y, z] = [brick[0] + (k >> 2), brick[1] + (k >> 1 & 1), brick[2] + (k & 1)];
                    let inside = x < nx && y < ny && z < nz;
                    let block = if inside { blocks[(x * ny + y) * nz + z] } else { BACKGROUND };
                    stored.get(block as usize)
                };
                let shift = |p: &[i32; 3]| std::array::from_fn(|a| i64::from(p[a]) - origin[a]);
                let range = (shift(&range.0), shift(&range.1));
                let whole = (0..3).all(|a| range.0[a] <= 0 && range.1[a] >= BRICK as i64);
                BrickIds::Sparse { blocks: std::array::from_fn(at), range, whole }
            }
        }
    }
}

impl BrickIds<'_> {
    /// The slot of a node, coordinates `0..=8`; `None` for the background.
    #[inline]
    pub(super) fn get(&self, node: [usize; 3]) -> Option<u32> {
        match self {
            BrickIds::Dense { origin, res } => {
                let at = |a: usize| (origin[a] + node[a] as i64).clamp(0, res[a] as i64 - 1) as usize;
                Some(((at(2) * res[1] + at(1)) * res[0] + at(0)) as u32)
            }
            BrickIds::Sparse { .. } => {
                let (block, local) = self.stored(node)?;
                Some(if block.leaf { block.base + local as u32 } else { block.base })
            }
        }
    }

    /// Which of the grid's active voxels a node is, counted in nodes of the brick; `None` for all that are not.
    #[inline]
    pub(super) fn active(&self, node: usize) -> Option<u32> {
        let coordinates = || [node / SLAB, node / ROW % ROW, node % ROW];
        match self {
            BrickIds::Dense { .. } => self.get(coordinates()),
            BrickIds::Sparse { blocks, whole: true, .. } => {
                let place = PLACES[node] as usize;
                blocks[place >> 9].and_then(|b| b.index(place & (LEAF - 1)))
            }
            BrickIds::Sparse { .. } => self.stored(coordinates()).and_then(|(block, local)| block.index(local)),
        }
    }

    /// Who holds a node, and as which of its 8^3 nodes.
    #[inline]
    fn stored(&self, node: [usize; 3]) -> Option<(&Stored, usize)> {
        let BrickIds::Sparse { blocks, range, .. } = self else { return None };
        let [x, y, z] = node;
        let block = blocks[(x / BRICK * 2 + y / BRICK) * 2 + z / BRICK]?;
        let mut inside = true;
        for a in 0..3 {
            inside &= range.0[a] <= node[a] as i64 && node[a] as i64 <= range.1[a];
        }
        inside.then(|| (block, (x % BRICK * BRICK + y % BRICK) * BRICK + z % BRICK))
    }

    /// The one slot of all nodes, if that is plain to see.
    pub(super) fn uniform(&self) -> Option<Option<u32>> {
        let BrickIds::Sparse { blocks, whole, .. } = self else { return None };
        let base = |b: &Option<&Stored>| b.map(|b| b.base);
        let same = blocks.iter().all(|b| base(b) == base(&blocks[0]));
        match blocks[0] {
            None if same => Some(None),
            Some(tile) if same && *whole && !tile.leaf => Some(Some(tile.base)),
            _ => None,
        }
    }

    /// Slots of the corners of a cell, z fastest.
    #[inline]
    pub(super) fn cell(&self, local: usize) -> [Option<NodeId>; 8] {
        let (x, y, z) = (local / (ROW * ROW), local / ROW % ROW, local % ROW);
        let at = |x, y, z| self.get([x, y, z]).map(NodeId);
        [
            at(x, y, z),
            at(x, y, z + 1),
            at(x, y + 1, z),
            at(x, y + 1, z + 1),
            at(x + 1, y, z),
            at(x + 1, y, z + 1),
            at(x + 1, y + 1, z),
            at(x + 1, y + 1, z + 1),
        ]
    }
}

/// Weights of the corners at a position in the cell, z fastest. They sum to 1.
#[inline(always)]
pub(super) fn weights(x: f64, y: f64, z: f64) -> [f64; 8] {
    let (nx, ny, nz) = (1.0 - x, 1.0 - y, 1.0 - z);
    let (nn, nf, fn_, ff) = (nx * ny, nx * y, x * ny, x * y);
    [nn * nz, nn * z, nf * nz, nf * z, fn_ * nz, fn_ * z, ff * nz, ff * z]
}

impl Grid {
    /// Number of slots.
    pub fn node_count(&self) -> usize {
        self.layout.count()
    }

    /// Slots and weights of the interpolant at a world position: field = sum of weight * value (background: `None`).
    /// Cut away by the clip box, every weight is 0; else they sum to 1. A slot may appear more than once.
    pub fn nodes(&self, p_world: DVec3) -> [(Option<NodeId>, f64); 8] {
        let q = self.table_from_world.transform_point3(p_world);
        if self.locate(q).is_none() {
            let mut out = [(None, 0.0); 8];
            out[0].1 = if self.frame.clip.is_some() { 0.0 } else { 1.0 };
            return out;
        }
        let cell: [usize; 3] = [q.x as usize, q.y as usize, q.z as usize];
        let f = DVec3::from(std::array::from_fn(|a| q[a] - cell[a] as f64)) * self.smooth;
        let ids = self.layout.brick(&self.frame, cell.map(|i| i / BRICK));
        let [x, y, z] = cell.map(|i| i % BRICK);
        let ids = ids.cell((x * ROW + y) * ROW + z);
        let w = weights(f.x, f.y, f.z);
        std::array::from_fn(|k| (ids[k], w[k]))
    }

    /// The same for active voxels, by their indices ([`Grid::active_index`]): all others are left out.
    pub fn active_nodes(&self, p_world: DVec3, mut f: impl FnMut(u32, f64)) {
        let q = self.table_from_world.transform_point3(p_world);
        if self.locate(q).is_none() {
            return;
        }
        let cell: [usize; 3] = [q.x as usize, q.y as usize, q.z as usize];
        let [x, y, z] = std::array::from_fn(|a| (q[a] - cell[a] as f64) * self.smooth);
        let ids = self.layout.brick(&self.frame, cell.map(|i| i / BRICK));
        for (k, w) in weights(x, y, z).into_iter().enumerate() {
            let at = |a: usize| cell[a] % BRICK + (k >> (2 - a) & 1);
            let node = (at(0) * ROW + at(1)) * ROW + at(2);
            if let Some(index) = ids.active(node).filter(|_| w != 0.0) {
                f(index, w);
            }
        }
    }

    /// The slot of the node at an index position.
    pub fn node_at(&self, node: [i32; 3]) -> Option<NodeId> {
        match &*self.layout {
            Layout::Dense { res } => {
                let inside = (0..3).all(|a| node[a] >= 0 && (node[a] as usize) < res[a]);
                let [x, y, z] = node.map(|i| i as usize);
                inside.then(|| NodeId(((z * res[1] + y) * res[0] + x) as u32))
            }
            Layout::Sparse { .. } => {
                let q: [i64; 3] = std::array::from_fn(|a| i64::from(node[a]) - i64::from(self.frame.origin[a]));
                let inside = (0..3).all(|a| 0 <= q[a] && q[a] < (self.frame.dims[a] * BRICK) as i64);
                let q = q.map(|i| i as usize);
                let ids = inside.then(|| self.layout.brick(&self.frame, q.map(|i| i / BRICK)))?;
                ids.get(q.map(|i| i % BRICK)).map(NodeId)
            }
        }
    }

    /// Index position of a slot's node; of a tile, its lowest one.
    pub fn node_position(&self, id: NodeId) -> [i32; 3] {
        let i = id.0 as usize;
        match &*self.layout {
            Layout::Dense { res } => [i % res[0], i / res[0] % res[1], i / res[0] / res[1]].map(|x| x as i32),
            Layout::Sparse { stored, .. } => {
                let Stored { base, origin, .. } = stored[stored.partition_point(|s| s.base <= id.0) - 1];
                let local = (id.0 - base) as i32;
                [origin[0] + (local >> 6), origin[1] + (local >> 3 & 7), origin[2] + (local & 7)]
            }
        }
    }

    /// Values by slot, channels interleaved: what `with_values` takes. A slot outside of `bbox` reads as background.
    pub fn values(&self) -> Vec<f32> {
        let (channels, [_, ny, nz]) = (self.channels(), self.frame.dims);
        let mut out: Vec<f32> = self.background()[..channels].repeat(self.node_count());
        for id in 0..self.node_count() {
            let node = self.node_position(NodeId(id as u32));
            let q: [usize; 3] =
                std::array::from_fn(|a| (i64::from(node[a]) - i64::from(self.frame.origin[a])) as usize);
            if self.node_at(node).is_none() {
                continue;
            }
            let brick = ((q[0] / BRICK) * ny + q[1] / BRICK) * nz + q[2] / BRICK;
            let [x, y, z] = q.map(|i| i % BRICK);
            let window = self.bricks.window(brick, (x * ROW + y) * ROW + z, channels);
            out[id * channels..][..channels].copy_from_slice(&window[..channels]);
        }
        out
    }
}
