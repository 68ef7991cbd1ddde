//! Active voxels: those of a grid's stored values that are its content, numbered without gaps, so that arrays over them take no more room than they do.
//!
//! A voxel of a leaf or of a dense array counts by itself, a tile as one: its value holds for all of its nodes. All voxels of a dense array are active.

use super::builder::{GridBuilder, GridSource};
use super::nodes::{LEAF, Layout, NodeId, Stored};
use super::{BRICK, Filter, Grid};
use crate::math::DVec3;
use crate::native::vdb;
use std::collections::{BTreeMap, HashSet};

/// A bit for each node of a leaf, `x << 6 | y << 3 | z`.
pub type Mask = [u64; 8];

/// The nodes of a leaf in an inclusive box.
fn mask_of(origin: [i32; 3], low: [i32; 3], high: [i32; 3]) -> Mask {
    let mut mask = [0; 8];
    for i in 0..LEAF as i32 {
        let p = [origin[0] + (i >> 6), origin[1] + (i >> 3 & 7), origin[2] + (i & 7)];
        if (0..3).all(|a| low[a] <= p[a] && p[a] <= high[a]) {
            mask[i as usize >> 6] |= 1 << (i & 63);
        }
    }
    mask
}

/// A leaf's nodes, each with the two beside it along an axis; and those that lie in the leaves before and behind.
fn widened(m: &Mask, axis: usize) -> [Mask; 3] {
    if axis == 0 {
        let at = |x: i32| if (0..8).contains(&x) { m[x as usize] } else { 0 };
        let own = std::array::from_fn(|x| m[x] | at(x as i32 - 1) | at(x as i32 + 1));
        let (mut before, mut behind) = ([0; 8], [0; 8]);
        (before[7], behind[0]) = (m[0], m[7]);
        return [before, own, behind];
    }
    // Words are planes of x: bits 8 y + z.
    let (step, first) = if axis == 1 { (8, 0xff) } else { (1, 0x0101_0101_0101_0101) };
    let last: u64 = first << (7 * step);
    [
        m.map(|w| (w & first) << (7 * step)),
        m.map(|w| w | (w & !last) << step | (w & !first) >> step),
        m.map(|w| (w & last) >> (7 * step)),
    ]
}

impl Grid {
    /// Voxels along each axis of a dense array; 0 for leaves and tiles.
    pub fn resolution(&self) -> [usize; 3] {
        match &*self.layout {
            Layout::Dense { res } => *res,
            Layout::Sparse { .. } => [0; 3],
        }
    }

    /// Number of active voxels.
    pub fn active_count(&self) -> usize {
        match &*self.layout {
            Layout::Dense { res } => res.iter().product(),
            Layout::Sparse { stored, .. } => stored.last().map_or(0, |s| (s.rank + s.count()) as usize),
        }
    }

    /// Which of the active voxels a stored value is, if it is one.
    pub fn active_index(&self, id: NodeId) -> Option<u32> {
        match &*self.layout {
            Layout::Dense { .. } => Some(id.0),
            Layout::Sparse { stored, .. } => {
                let s = &stored[stored.partition_point(|s| s.base <= id.0) - 1];
                s.index((id.0 - s.base) as usize)
            }
        }
    }

    /// Numbers by active voxel (channels interleaved) in the grid's own leaves and tiles, 0 where no voxel is active.
    pub fn in_leaves(&self, numbers: &[f64]) -> (Vec<vdb::Leaf>, Vec<vdb::Tile>) {
        let channels = self.channels();
        let number = |k: u32, c: usize| numbers[k as usize * channels + c] as f32;
        let leaf = |origin: [i32; 3], active: Mask, index: &dyn Fn(usize) -> Option<u32>| {
            let value = |i: usize| index(i / channels).map_or(0.0, |k| number(k, i % channels));
            vdb::Leaf { origin, active, values: (0..LEAF * channels).map(value).collect() }
        };
        let (mut leaves, mut tiles) = (Vec::new(), Vec::new());
        match &*self.layout {
            Layout::Dense { res } => {
                let high = res.map(|n| n as i32 - 1);
                let blocks = res.map(|n| n.div_ceil(BRICK) as i32);
                for b in 0..blocks.iter().product::<i32>() {
                    let origin = [b / (blocks[1] * blocks[2]), b / blocks[2] % blocks[1], b % blocks[2]].map(|x| 8 * x);
                    let node = |i: usize| [0, 1, 2].map(|a| origin[a] + (i as i32 >> (6 - 3 * a) & 7));
                    let index = |i: usize| self.node_at(node(i)).map(|id| id.0);
                    leaves.push(leaf(origin, mask_of(origin, [0; 3], high), &index));
                }
            }
            Layout::Sparse { stored, .. } => {
                for s in stored {
                    if s.leaf {
                        leaves.push(leaf(s.origin, s.active, &|i| s.index(i)));
                    } else if s.count() > 0 {
                        let value = std::array::from_fn(|c| if c < channels { number(s.rank, c) } else { 0.0 });
                        tiles.push(vdb::Tile { origin: s.origin, size: s.size, value, active: true });
                    }
                }
            }
        }
        (leaves, tiles)
    }

    /// The same field with more active voxels: all that share a cell with an active one. A dense array has none to add: its field ends
    /// at its box. Errors as [`GridBuilder::build`].
    pub fn dilated(&self) -> Result<Grid, String> {
        let Layout::Sparse { stored, range, .. } = &*self.layout else { return Ok(self.clone()) };
        let mut leaves: BTreeMap<[i32; 3], Mask> = BTreeMap::new();
        for s in stored.iter().filter(|s| s.leaf) {
            leaves.insert(s.origin, s.active);
        }
        for axis in 0..3 {
            for (origin, mask) in leaves.clone() {
                for (shift, mask) in [-8, 0, 8].into_iter().zip(widened(&mask, axis)) {
                    let mut at = origin;
                    at[axis] += shift;
                    if mask != [0; 8] {
                        let m = leaves.entry(at).or_default();
                        (0..8).for_each(|k| m[k] |= mask[k]);
                    }
                }
            }
        }
        let tiles = || stored.iter().filter(|s| !s.leaf);
        for t in tiles().filter(|t| t.count() > 0) {
            let (low, high) = (t.origin.map(|x| x - 1), t.origin.map(|x| x + t.size));
            let steps = |a: usize| (t.origin[a] - 8..=t.origin[a] + t.size).step_by(8);
            for at in steps(0).flat_map(|x| steps(1).flat_map(move |y| steps(2).map(move |z| [x, y, z]))) {
                if !t.holds(at) {
                    let m = leaves.entry(at).or_default();
                    let wider = mask_of(at, low, high);
                    (0..8).for_each(|k| m[k] |= wider[k]);
                }
            }
        }
        // Inside of active tiles everything is active already; leaves of our own stay.
        let own: HashSet<[i32; 3]> = stored.iter().filter(|s| s.leaf).map(|s| s.origin).collect();
        leaves.retain(|at, _| own.contains(at) || !tiles().any(|t| t.count() > 0 && t.holds(*at)));

        let grow =
            |(low, high): ([i32; 3], [i32; 3])| (low.map(|x| x.saturating_sub(1)), high.map(|x| x.saturating_add(1)));
        let source = GridSource {
            channels: self.channels(),
            world_from_index: self.frame.world_from_index,
            background: self.frame.background,
            bbox: Some(grow(*range)),
            clip: self.frame.clip,
        };
        let (mut builder, channels) = (GridBuilder::new(source), self.channels());
        for t in tiles() {
            builder.tile(t.origin, t.size, self.node_value(t.origin));
            builder.activate(t.active);
        }
        for (origin, mask) in leaves {
            let node = |i: usize| [0, 1, 2].map(|a| origin[a] + (i as i32 >> (6 - 3 * a) & 7));
            let values: Vec<f32> =
                (0..LEAF).flat_map(|i| self.node_value(node(i)).into_iter().take(channels)).collect();
            builder.leaf(origin, &values);
            builder.activate(mask);
        }
        builder.build()
    }

    /// The field at a node, however it comes about.
    pub(super) fn node_value(&self, node: [i32; 3]) -> [f32; 3] {
        let q = DVec3::from(node.map(f64::from)) - DVec3::from(self.frame.origin.map(f64::from));
        debug_assert!(self.frame.filter == Filter::Trilinear);
        self.triple_at(q).map(|v| v as f32)
    }
}

impl Stored {
    /// Active voxels in it.
    pub(super) fn count(&self) -> u32 {
        if self.leaf { self.active.iter().map(|w| w.count_ones()).sum() } else { u32::from(self.active != [0; 8]) }
    }

    /// The index of its `local`th value.
    #[inline]
    pub(super) fn index(&self, local: usize) -> Option<u32> {
        if !self.leaf {
            return (self.active != [0; 8]).then_some(self.rank);
        }
        let (word, bit) = (local >> 6, 1u64 << (local & 63));
        let own = self.active[word];
        let before = match own {
            u64::MAX => local as u32 & 63,
            _ => (own & (bit - 1)).count_ones(),
        };
        (own & bit != 0).then(|| self.rank + u32::from(self.before[word]) + before)
    }

    fn holds(&self, p: [i32; 3]) -> bool {
        (0..3).all(|a| self.origin[a] <= p[a] && p[a] < self.origin[a] + self.size)
    }
}
