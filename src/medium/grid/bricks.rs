//! Storage: 9^3 nodes per brick, one shared window per distinct constant, least and greatest node of every brick.
//!
//! A cell's eight corners lie within [`WINDOW`] consecutive nodes, from the lowest corner to the highest. A constant brick
//! is a single such window filled with its value, shared by all bricks of that value, and read with stride 0; a lookup
//! therefore has no branch on the kind of brick. Nodes are counted in units of one window: 1 a constant, 8 a brick.

use super::Frame;
use super::levels::Levels;
use super::nodes::Layout;
use super::values::Values;
use std::collections::HashMap;

/// Cells per axis of a brick.
pub(super) const BRICK: usize = 8;
/// Node strides in a brick: z is contiguous, as in OpenVDB's leaves.
pub(super) const ROW: usize = BRICK + 1;
pub(super) const SLAB: usize = ROW * ROW;
/// Nodes of a brick.
const NODES: usize = ROW * SLAB;
/// Nodes from the lowest corner of a cell to its highest.
pub(super) const WINDOW: usize = SLAB + ROW + 2;
/// Windows that a brick takes.
const UNITS: usize = NODES.div_ceil(WINDOW);

/// All bricks of a grid, in table order (z fastest).
#[derive(Clone, Debug, Default)]
pub(super) struct Bricks {
    /// Per brick: first unit << 1, plus 1 if the brick has nodes of its own.
    code: Vec<u32>,
    /// Per brick: least and greatest node over all channels.
    range: Vec<[f32; 2]>,
    /// The same over cubes of bricks.
    pub(super) levels: Levels,
    /// Nodes, channels interleaved.
    nodes: Vec<f32>,
    /// Least and greatest node of all bricks, per channel.
    pub(super) low: [f32; 3],
    pub(super) high: [f32; 3],
}

impl Bricks {
    /// Copy every brick's nodes from the slots, or find that they are all equal.
    pub(super) fn gather(frame: &Frame, layout: &Layout, mut values: impl Values) -> Bricks {
        let channels = frame.channels;
        let count = frame.dims.iter().product();
        let mut bricks = Bricks {
            code: Vec::with_capacity(count),
            range: Vec::with_capacity(count),
            levels: Levels::default(),
            nodes: Vec::new(),
            low: [f32::INFINITY; 3],
            high: [f32::NEG_INFINITY; 3],
        };
        let mut constants = HashMap::new();
        let mut scratch = vec![0.0; UNITS * WINDOW * channels];
        for bx in 0..frame.dims[0] {
            for by in 0..frame.dims[1] {
                for bz in 0..frame.dims[2] {
                    let uniform = fill(frame, layout, &values, [bx, by, bz], &mut scratch);
                    bricks.push(channels, uniform, &scratch, &mut constants);
                }
            }
            values.done(bx);
        }
        bricks.nodes.shrink_to_fit();
        bricks.levels = Levels::new(frame.dims, &bricks.range);
        bricks
    }

    /// Append one brick: its nodes, or the window of its constant.
    fn push(&mut self, channels: usize, uniform: bool, nodes: &[f32], constants: &mut HashMap<[u32; 3], u32>) {
        // Without nodes of its own only the first node of `nodes` was filled.
        let seen = if uniform { channels } else { NODES * channels };
        let mut range = [[f32::INFINITY, f32::NEG_INFINITY]; 3];
        for node in nodes[..seen].chunks_exact(channels) {
            for (r, &v) in range.iter_mut().zip(node) {
                *r = [r[0].min(v), r[1].max(v)];
            }
        }
        for c in 0..channels {
            self.low[c] = self.low[c].min(range[c][0]);
            self.high[c] = self.high[c].max(range[c][1]);
        }
        let all = &range[..channels];
        self.range.push(all.iter().fold(all[0], |a, r| [a[0].min(r[0]), a[1].max(r[1])]));
        let unit = (self.nodes.len() / (WINDOW * channels)) as u32;
        if !uniform {
            self.nodes.extend_from_slice(nodes);
            self.code.push(unit << 1 | 1);
            return;
        }
        // Adding 0 makes -0 and 0 one constant.
        let value: [f32; 3] = std::array::from_fn(|c| nodes[c.min(channels - 1)] + 0.0);
        let shared = *constants.entry(value.map(f32::to_bits)).or_insert_with(|| {
            self.nodes.extend((0..WINDOW).flat_map(|_| &value[..channels]));
            unit
        });
        self.code.push(shared << 1);
    }

    pub(super) fn is_empty(&self) -> bool {
        self.code.is_empty()
    }

    pub(super) fn bytes(&self) -> usize {
        let own = size_of_val(&self.code[..]) + size_of_val(&self.range[..]) + size_of_val(&self.nodes[..]);
        own + self.levels.bytes()
    }

    /// The nodes from the lowest corner of a cell on.
    #[inline(always)]
    pub(super) fn window(&self, brick: usize, local: usize, channels: usize) -> &[f32] {
        let code = self.code[brick] as usize;
        let start = ((code >> 1) * WINDOW + local * (code & 1)) * channels;
        &self.nodes[start..start + WINDOW * channels]
    }

    /// All nodes of a brick that is not constant.
    #[inline(always)]
    pub(super) fn nodes(&self, brick: usize, channels: usize) -> &[f32] {
        let start = (self.code[brick] as usize >> 1) * WINDOW * channels;
        &self.nodes[start..start + UNITS * WINDOW * channels]
    }

    #[cfg(test)]
    pub(super) fn nodes_for_test(&self) -> &[f32] {
        &self.nodes
    }

    /// Equal codes without own nodes have equal values.
    #[inline(always)]
    pub(super) fn code(&self, brick: usize) -> u32 {
        self.code[brick]
    }

    #[inline(always)]
    pub(super) fn range(&self, brick: usize) -> [f32; 2] {
        self.range[brick]
    }
}

/// Write the nodes of one brick; `true` if all are equal, in which case only the first is sure to be written.
fn fill(frame: &Frame, layout: &Layout, values: &impl Values, brick: [usize; 3], out: &mut [f32]) -> bool {
    let channels = frame.channels;
    let ids = layout.brick(frame, brick);
    let value = |id: Option<u32>| match id {
        Some(id) => values.of(id, channels),
        None => &frame.background[..channels],
    };
    if let Some(id) = ids.uniform() {
        out[..channels].copy_from_slice(value(id));
        return true;
    }
    let mut node = out.chunks_exact_mut(channels);
    for x in 0..ROW {
        for y in 0..ROW {
            for z in 0..ROW {
                if let Some(node) = node.next() {
                    node.copy_from_slice(value(ids.get([x, y, z])));
                }
            }
        }
    }
    let (first, rest) = out[..NODES * channels].split_at(channels);
    rest.chunks_exact(channels).all(|n| n == first)
}
