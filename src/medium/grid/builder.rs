//! Grids from OpenVDB's leaves and tiles, and from dense arrays.

use super::bricks::BRICK;
use super::nodes::{BACKGROUND, LEAF, Layout, Stored};
use super::values::Segments;
use super::{Filter, Frame, Grid, Mask};
use crate::math::{DAffine3, DMat3, DVec3};
use std::sync::Arc;

/// Bricks that a table may have: about a gigabyte of table.
const TABLE_LIMIT: i64 = 1 << 26;

/// What a grid's source says about it as a whole.
#[derive(Clone, Debug)]
pub struct GridSource {
    /// 1 or 3.
    pub channels: usize,
    pub world_from_index: DAffine3,
    /// Value wherever no leaf or tile is; a scalar grid uses the first component.
    pub background: [f32; 3],
    /// Inclusive node range: nodes outside of it are background, whatever leaves and tiles say.
    pub bbox: Option<([i32; 3], [i32; 3])>,
    /// Half-open box in index space; outside of it the field is 0.
    pub clip: Option<(DVec3, DVec3)>,
}

/// Which values a use of voxels allows, ends included. NaN and infinite ones no use allows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allowed {
    pub low: f32,
    pub high: f32,
}

impl Allowed {
    pub const FINITE: Allowed = Allowed { low: f32::MIN, high: f32::MAX };
    /// Densities, light, temperatures.
    pub const NON_NEGATIVE: Allowed = Allowed { low: 0.0, high: f32::MAX };
    /// Albedos.
    pub const SHARE: Allowed = Allowed { low: 0.0, high: 1.0 };

    fn refuses(self, v: f32) -> bool {
        !(self.low <= v && v <= self.high)
    }

    /// What is too large becomes the largest value allowed, all else that is not allowed 0 (infinite ones too).
    pub fn repair(self, values: &mut [f32]) -> Repaired {
        let mut n = Repaired::default();
        for v in values.iter_mut().filter(|v| self.refuses(**v)) {
            let (kind, new) = match *v {
                x if x.is_nan() => (&mut n.nan, 0.0),
                x if x.is_infinite() => (&mut n.infinite, 0.0),
                x if x < self.low => (&mut n.negative, 0.0),
                _ => (&mut n.large, self.high),
            };
            *kind += 1;
            *v = new;
        }
        n
    }
}

/// How many values of which kind were repaired.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repaired {
    pub nan: usize,
    pub infinite: usize,
    pub negative: usize,
    /// Set to the largest value allowed.
    pub large: usize,
}

impl Repaired {
    pub fn total(self) -> usize {
        self.nan + self.infinite + self.negative + self.large
    }
}

impl std::ops::AddAssign for Repaired {
    fn add_assign(&mut self, o: Repaired) {
        self.nan += o.nan;
        self.infinite += o.infinite;
        self.negative += o.negative;
        self.large += o.large;
    }
}

impl std::fmt::Display for Repaired {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kinds =
            [(self.nan, "NaN"), (self.infinite, "infinite"), (self.negative, "negative"), (self.large, "too large")];
        let kinds = kinds.iter().filter(|k| k.0 > 0).map(|(n, what)| format!("{n} {what}")).collect::<Vec<_>>();
        write!(f, "{}", kinds.join(", "))
    }
}

/// The first value that is not fit for use, and how many there are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BadVoxel {
    /// Index position; of a tile, its lowest node.
    pub index: [i32; 3],
    pub channel: usize,
    pub value: f32,
    pub count: usize,
}

impl std::fmt::Display for BadVoxel {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y, z] = self.index;
        write!(f, "voxel [{x}, {y}, {z}] is {}", self.value)?;
        if self.count > 1 { write!(f, ", and {} more cannot be used", self.count - 1) } else { Ok(()) }
    }
}

/// The first value, in slot order, that is not allowed. `index` maps a slot to its node.
pub(super) fn find_bad<'a>(
    values: impl Iterator<Item = &'a [f32]>,
    channels: usize,
    allowed: Allowed,
    index: impl Fn(usize) -> [i32; 3],
) -> Result<(), BadVoxel> {
    let (mut first, mut count, mut before) = (None, 0, 0);
    for slice in values {
        let bad = slice.iter().filter(|v| allowed.refuses(**v)).count();
        if bad > 0 && first.is_none() {
            first = slice.iter().position(|&v| allowed.refuses(v)).map(|i| (before + i, slice[i]));
        }
        (count, before) = (count + bad, before + slice.len());
    }
    let Some((first, value)) = first else { return Ok(()) };
    Err(BadVoxel { index: index(first / channels), channel: first % channels, value, count })
}

/// Collects leaves and tiles. Slots are given in the order of the calls: 512 per leaf, 1 per tile.
#[derive(Clone, Debug)]
pub struct GridBuilder {
    source: GridSource,
    blocks: Vec<Stored>,
    values: Segments,
    /// The first thing that went wrong.
    fault: Option<String>,
}

impl GridBuilder {
    pub fn new(source: GridSource) -> Self {
        let fault = match source.channels {
            1 | 3 => None,
            n => Some(format!("a grid has 1 or 3 channels, not {n}")),
        };
        GridBuilder { source, blocks: Vec::new(), values: Segments::default(), fault }
    }

    /// 8^3 nodes, `values[((x << 6) | (y << 3) | z) * channels + c]`, the lowest at `origin` (multiples of 8).
    pub fn leaf(&mut self, origin: [i32; 3], values: &[f32]) {
        if values.len() != LEAF * self.source.channels {
            self.fail(format!("a leaf at {origin:?} has {} values", values.len()));
        }
        self.add(origin, BRICK as i32, true, values);
    }

    /// A cube of nodes of one value, `size` nodes wide (a multiple of 8, as is `origin`). A leaf inside takes precedence.
    pub fn tile(&mut self, origin: [i32; 3], size: i32, value: [f32; 3]) {
        if size <= 0 || size % BRICK as i32 != 0 {
            self.fail(format!("a tile at {origin:?} is {size} nodes wide"));
        }
        let channels = self.source.channels.min(3);
        self.add(origin, size, false, &value[..channels]);
    }

    /// Which voxels of the leaf or tile given last are active: all, unless this is called. A tile is if any bit is set.
    pub fn activate(&mut self, active: Mask) {
        if let Some(last) = self.blocks.last_mut() {
            last.active = active;
        }
    }

    fn add(&mut self, origin: [i32; 3], size: i32, leaf: bool, values: &[f32]) {
        if origin.iter().any(|o| o.rem_euclid(BRICK as i32) != 0) {
            self.fail(format!("a block's origin {origin:?} is not a multiple of {BRICK}"));
        }
        let base = self.values.len() / self.source.channels.max(1);
        if base + LEAF >= u32::MAX as usize {
            self.fail("a grid has more than 2^32 voxels".into());
        }
        if self.fault.is_none() {
            self.blocks.push(Stored {
                base: base as u32,
                origin,
                size,
                leaf,
                active: [u64::MAX; 8],
                rank: 0,
                before: [0; 8],
            });
            self.values.push(values, self.source.channels);
        }
    }

    fn fail(&mut self, what: String) {
        self.fault.get_or_insert(what);
    }

    /// Report values that are not allowed.
    pub fn validate(&self, allowed: Allowed) -> Result<(), BadVoxel> {
        find_bad(self.values.slices(), self.source.channels, allowed, |slot| {
            let Stored { base, origin, .. } = self.blocks[self.blocks.partition_point(|b| b.base as usize <= slot) - 1];
            let local = (slot - base as usize) as i32;
            [origin[0] + (local >> 6), origin[1] + (local >> 3 & 7), origin[2] + (local & 7)]
        })
    }

    /// The same with its values in segments of `2^shift` slots.
    #[cfg(test)]
    pub(super) fn in_segments(mut self, shift: u32) -> Self {
        let mut values = Segments::of(shift);
        self.values.slices().for_each(|s| values.push(s, self.source.channels));
        self.values = values;
        self
    }

    /// Make all values allowed ones.
    pub fn repair(&mut self, allowed: Allowed) -> Repaired {
        let mut n = Repaired::default();
        self.values.slices_mut().for_each(|s| n += allowed.repair(s));
        n
    }

    pub fn build(self) -> Result<Grid, String> {
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        let GridSource { channels, world_from_index, background, bbox, clip } = self.source;
        let index_from_world = inverse(world_from_index)?;
        let background = if channels == 1 { [background[0]; 3] } else { background };

        // Find the nodes that may differ from the background.
        let whole = (0..3).map(|a| {
            let low = self.blocks.iter().map(|b| i64::from(b.origin[a])).min().unwrap_or(0);
            let high = self.blocks.iter().map(|b| i64::from(b.origin[a]) + i64::from(b.size) - 1).max().unwrap_or(-1);
            bbox.map_or((low, high), |(l, h)| (low.max(i64::from(l[a])), high.min(i64::from(h[a]))))
        });
        let whole: Vec<(i64, i64)> = whole.collect();
        let empty = whole.iter().any(|(l, h)| l > h);

        // Lay the table over the cells that touch them, and over the clip box where the background shows in it.
        let mut table = (!empty).then(|| [0, 1, 2].map(|a| (whole[a].0 - 1, whole[a].1)));
        if let (Some((l, h)), true) = (clip, background != [0.0; 3]) {
            let cells = [0, 1, 2].map(|a| (l[a].floor() as i64, h[a].ceil() as i64 - 1));
            let joined = |t: [(i64, i64); 3]| [0, 1, 2].map(|a| (t[a].0.min(cells[a].0), t[a].1.max(cells[a].1)));
            table = Some(table.map_or(cells, joined));
        }
        let bricks = table.map_or([(0, -1); 3], |t| t.map(|(l, h)| (floor_div(l), floor_div(h))));
        let dims = bricks.map(|(l, h)| (h - l + 1).clamp(0, TABLE_LIMIT + 1));
        if dims[0] * dims[1] > TABLE_LIMIT || dims[0] * dims[1] * dims[2] > TABLE_LIMIT {
            return Err(format!("the grid spans {dims:?} blocks of 8^3 voxels, too many for a table: crop it"));
        }
        let origin = bricks.map(|(l, _)| l * BRICK as i64);
        let small = |x: i64| i32::try_from(x).map_err(|_| format!("voxel index {x} is out of range"));
        let origin = [small(origin[0])?, small(origin[1])?, small(origin[2])?];
        let dims = dims.map(|n| n as usize);

        // Enter tiles, then leaves on top.
        let mut blocks = vec![BACKGROUND; dims.iter().product()];
        for leaves in [false, true] {
            for (k, Stored { origin: low, size, .. }) in self.blocks.iter().enumerate().filter(|b| b.1.leaf == leaves) {
                let cover = |a: usize| {
                    let from = (i64::from(low[a]) - i64::from(origin[a])) / BRICK as i64;
                    from.max(0) as usize..(from + i64::from(size / BRICK as i32)).clamp(0, dims[a] as i64) as usize
                };
                for x in cover(0) {
                    for y in cover(1) {
                        for z in cover(2) {
                            let at = &mut blocks[(x * dims[1] + y) * dims[2] + z];
                            if leaves && self.blocks.get(*at as usize).is_some_and(|b| b.leaf) {
                                return Err(format!("two leaves at {low:?}"));
                            }
                            *at = k as u32;
                        }
                    }
                }
            }
        }
        let range = if empty {
            ([0; 3], [-1; 3])
        } else {
            ([0, 1, 2].map(|a| whole[a].0 as i32), [0, 1, 2].map(|a| whole[a].1.min(i64::from(i32::MAX)) as i32))
        };
        let (mut stored, mut values) = (self.blocks, self.values);
        stored.shrink_to_fit();
        let mut rank = 0;
        for s in &mut stored {
            (s.rank, rank) = (rank, rank + s.count());
            let mut before = 0;
            for (b, word) in s.before.iter_mut().zip(s.active) {
                (*b, before) = (before, before + word.count_ones() as u16);
            }
            // Bricks have an apron: nodes of a plane are read by the one before it, too, and by none behind.
            let last = (i64::from(s.origin[0]) + i64::from(s.size) - 1 - i64::from(origin[0])) / BRICK as i64;
            values.needed(s.base, if s.leaf { LEAF } else { 1 }, last.max(0) as usize);
        }
        let layout = Layout::Sparse { blocks, stored, range, count: values.len() / channels };
        let filter = Filter::Trilinear;
        let frame = Frame { channels, background, filter, world_from_index, index_from_world, origin, dims, clip };
        Ok(Grid::assemble(frame, Arc::new(layout), values))
    }
}

fn floor_div(x: i64) -> i64 {
    x.div_euclid(BRICK as i64)
}

pub(super) fn inverse(m: DAffine3) -> Result<DAffine3, String> {
    let inverse = m.inverse();
    if m.is_finite() && inverse.is_finite() {
        Ok(inverse)
    } else {
        Err(format!("the grid's transform {m:?} cannot be inverted"))
    }
}

impl Grid {
    /// A full array as Mitsuba's `gridvolume` has it: `values[((z * ny + y) * nx + x) * channels + c]` at the centres of the
    /// cells that divide the unit cube, repeated towards its faces, 0 outside. `world_from_unit` places the cube.
    /// Slots are voxels in the order of `values`. Index positions: voxel centres (trilinear) or lower corners (nearest).
    pub fn from_dense(
        channels: usize,
        res: [usize; 3],
        values: &[f32],
        world_from_unit: DAffine3,
        filter: Filter,
    ) -> Result<Grid, String> {
        let count = res.iter().try_fold(channels, |n, &r| n.checked_mul(r)).unwrap_or(usize::MAX);
        if channels != 1 && channels != 3 {
            return Err(format!("a grid has 1 or 3 channels, not {channels}"));
        }
        if count == 0 || count / channels >= u32::MAX as usize || values.len() != count {
            return Err(format!("{res:?} voxels of {channels} channels, but {} values", values.len()));
        }
        let size = DVec3::from(res.map(|n| n as f64));
        // The first node stands in the middle of the first voxel, or fills it.
        let shift = if filter == Filter::Trilinear { 0.5 } else { 0.0 };
        let unit_from_index = DAffine3 { matrix3: DMat3::from_diagonal(size.recip()), translation: shift / size };
        let world_from_index = world_from_unit * unit_from_index;
        // Multiply by the resolution rather than divide by its rounded inverse.
        let mut index_from_world = inverse(world_from_unit)?;
        index_from_world.matrix3 = DMat3::from_diagonal(size) * index_from_world.matrix3;
        index_from_world.translation = size * index_from_world.translation - shift;
        let first = if filter == Filter::Trilinear { -1 } else { 0 };
        let cells = |n: usize| (n as i64 - i64::from(first)) as usize;
        let frame = Frame {
            channels,
            background: [0.0; 3],
            filter,
            world_from_index,
            index_from_world,
            origin: [first; 3],
            dims: res.map(|n| cells(n).div_ceil(BRICK)),
            clip: Some((DVec3::splat(-shift), size - shift)),
        };
        Ok(Grid::assemble(frame, Arc::new(Layout::Dense { res }), values))
    }
}
