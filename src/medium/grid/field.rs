//! The values of a grid's active voxels, read and set in place: what an optimiser holds.
//!
//! Numbers are those of [`Grid::active_index`], channels interleaved: the order of a gradient over voxels. What is not active keeps its value.

use super::nodes::{LEAF, Layout, NodeId};
use super::{Grid, Mask};
use crate::native::vdb;

/// A grid's stored values with the places of the active ones among them. Memory: 4 bytes a stored value and channel, and 4 bytes an active voxel.
#[derive(Clone, Debug)]
pub struct Field {
    /// By slot, channels interleaved.
    values: Vec<f32>,
    /// Slot of every active voxel.
    slots: Vec<u32>,
    channels: usize,
}

impl Grid {
    /// What the grid holds.
    pub fn field(&self) -> Field {
        let slots = match &*self.layout {
            Layout::Dense { .. } => (0..self.node_count() as u32).collect(),
            Layout::Sparse { stored, .. } => {
                let of = |s: &super::nodes::Stored| {
                    let (s, n) = (*s, if s.leaf { LEAF } else { 1 });
                    (0..n).filter(move |&i| s.index(i).is_some()).map(move |i| s.base + i as u32)
                };
                stored.iter().flat_map(of).collect()
            }
        };
        Field { values: self.values(), slots, channels: self.channels() }
    }

    /// The same grid with a field's values.
    pub fn with_field(&self, field: &Field) -> Result<Grid, String> {
        self.with_values(&field.values)
    }

    /// Index position of every active voxel; of a tile, its middle (rounded down), and whether it is one.
    pub fn active_positions(&self) -> Vec<([i32; 3], bool)> {
        match &*self.layout {
            Layout::Dense { .. } => {
                (0..self.node_count() as u32).map(|i| (self.node_position(NodeId(i)), false)).collect()
            }
            Layout::Sparse { stored, .. } => {
                let mut out = Vec::with_capacity(self.active_count());
                for s in stored {
                    if s.leaf {
                        let at = |i: i32| [0, 1, 2].map(|a| s.origin[a] + (i >> (6 - 3 * a) & 7));
                        let own = (0..LEAF).filter(|&i| s.index(i).is_some());
                        out.extend(own.map(|i| (at(i as i32), false)));
                    } else if s.count() > 0 {
                        out.push((s.origin.map(|x| x + s.size / 2), true));
                    }
                }
                out
            }
        }
    }

    /// A field in the grid's own leaves and tiles, with all that is stored.
    pub fn stored_leaves(&self, field: &Field) -> (Vec<vdb::Leaf>, Vec<vdb::Tile>) {
        let channels = self.channels();
        let numbers: Vec<f64> = field.active().collect();
        let (mut leaves, mut tiles) = self.in_leaves(&numbers);
        let Layout::Sparse { stored, .. } = &*self.layout else { return (leaves, tiles) };
        let (mut leaf, idle) = (leaves.iter_mut(), |m: &Mask, i: usize| m[i >> 6] >> (i & 63) & 1 == 0);
        for s in stored {
            let own = &field.values[s.base as usize * channels..];
            if s.leaf {
                let Some(l) = leaf.next() else { break };
                for i in (0..LEAF).filter(|&i| idle(&s.active, i)) {
                    l.values[i * channels..][..channels].copy_from_slice(&own[i * channels..][..channels]);
                }
            } else if s.count() == 0 {
                let value = std::array::from_fn(|c| if c < channels { own[c] } else { 0.0 });
                tiles.push(vdb::Tile { origin: s.origin, size: s.size, value, active: false });
            }
        }
        (leaves, tiles)
    }
}

impl Field {
    /// Number of active voxels.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// 1 or 3.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// The numbers, `len * channels` of them.
    pub fn active(&self) -> impl Iterator<Item = f64> {
        let of = |s: &u32| &self.values[*s as usize * self.channels..][..self.channels];
        self.slots.iter().flat_map(of).map(|v| f64::from(*v))
    }

    /// Set the numbers, `len * channels` of them.
    pub fn set(&mut self, numbers: &[f64]) {
        debug_assert_eq!(numbers.len(), self.len() * self.channels);
        for (s, new) in self.slots.iter().zip(numbers.chunks_exact(self.channels)) {
            let old = &mut self.values[*s as usize * self.channels..][..self.channels];
            old.iter_mut().zip(new).for_each(|(v, x)| *v = *x as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{GridBuilder, GridSource};
    use super::*;
    use crate::math::{DAffine3, DVec3};

    /// A leaf that is half active, an active tile, an idle tile.
    fn grid() -> Grid {
        let source = GridSource {
            channels: 1,
            world_from_index: DAffine3::IDENTITY,
            background: [0.25; 3],
            bbox: None,
            clip: None,
        };
        let mut b = GridBuilder::new(source);
        b.tile([8, 0, 0], 8, [2.0; 3]);
        b.tile([16, 0, 0], 8, [3.0; 3]);
        b.activate([0; 8]);
        b.leaf([0, 0, 0], &(0..512).map(|i| i as f32).collect::<Vec<_>>());
        b.activate([u64::MAX, 0, 0, 0, 0, 0, 0, 1]);
        b.build().unwrap()
    }

    #[test]
    fn what_is_set_is_what_is_looked_up_and_nothing_else_changes() {
        let g = grid();
        let mut f = g.field();
        assert_eq!((f.len(), g.active_count()), (66, 66));
        assert_eq!(f.active().collect::<Vec<_>>()[0..3], [2.0, 0.0, 1.0]);
        f.set(&(0..66).map(|i| 100.0 + f64::from(i)).collect::<Vec<_>>());
        let new = g.with_field(&f).unwrap();
        for (k, (p, tile)) in g.active_positions().into_iter().enumerate() {
            let at = DVec3::from(p.map(f64::from));
            assert_eq!(new.lookup_index(at), 100.0 + k as f64, "{p:?}");
            assert_eq!(g.active_index(g.node_at(p).unwrap()), Some(k as u32));
            assert_eq!(tile, k == 0);
        }
        // Idle ones.
        assert_eq!(new.lookup_index(DVec3::new(1.0, 0.0, 0.0)), 64.0);
        assert_eq!(new.lookup_index(DVec3::new(20.0, 4.0, 4.0)), 3.0);
        assert_eq!(new.lookup_index(DVec3::new(-9.0, 4.0, 4.0)), 0.25);
        let (leaves, tiles) = new.stored_leaves(&f);
        assert_eq!((leaves.len(), tiles.len()), (1, 2));
        assert_eq!((leaves[0].values[0], leaves[0].values[64]), (101.0, 64.0));
        assert!(tiles.iter().any(|t| t.value[0] == 3.0 && !t.active));
        assert!(tiles.iter().any(|t| t.value[0] == 100.0 && t.active));
    }
}
