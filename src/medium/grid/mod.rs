//! Voxel fields of one or three channels in bricks: what every medium and emission volume reads.
//!
//! Nodes at integer index positions carry `f32` values; between them the field is trilinear, exactly as OpenVDB's
//! `BoxSampler` has it; where no node was given the `background` holds. Cells are the unit cubes between nodes. 8^3 cells
//! form a *brick* with 9^3 nodes (its own apron), so that a lookup touches one brick. A dense table over the bricks of the
//! index box, padded so that the ramp down to the background lies inside, names for every brick its nodes, or one
//! constant, and its least and greatest node, which bound the interpolant. An optional clip box cuts the field to 0.
//!
//! Arithmetic is `f64` on `f32` nodes: no coordinate is ever rounded to single precision ([T] section 9, scale), and the
//! conversion costs less than the memory access. Internally, positions are in *table space*: index space with the table's
//! corner at 0, so that inside tests and integer parts come from the same rounded number.

mod active;
mod bricks;
mod builder;
mod field;
mod integrate;
mod levels;
mod nodes;
mod pieces;
mod profile;
mod residual;
mod roughness;
#[cfg(test)]
mod tests;
mod traverse;
mod values;
pub mod vol;

use crate::math::{DAffine3, DVec3, Rgb};
use std::sync::Arc;

pub use active::Mask;
pub use builder::{Allowed, BadVoxel, GridBuilder, GridSource, Repaired};
pub use field::Field;
pub use integrate::Slope;
pub use nodes::NodeId;
pub use pieces::{Piece, Rate};
pub use profile::{Place, Profile};
pub use traverse::{BrickRef, Span, SpanIter};

use bricks::{BRICK, Bricks, ROW, SLAB, WINDOW};
use nodes::Layout;
use values::Values;

/// How values are filled in between nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Filter {
    #[default]
    Trilinear,
    /// Piecewise constant: a cell has the value of its lowest node.
    Nearest,
}

/// Where the bricks lie and what holds around them.
#[derive(Clone, Copy, Debug)]
struct Frame {
    channels: usize,
    background: [f32; 3],
    filter: Filter,
    world_from_index: DAffine3,
    index_from_world: DAffine3,
    /// Index position of the table's corner.
    origin: [i32; 3],
    /// Bricks per axis.
    dims: [usize; 3],
    /// Index space; the field is 0 outside of it.
    clip: Option<(DVec3, DVec3)>,
}

/// A voxel field.
#[derive(Clone, Debug)]
pub struct Grid {
    frame: Frame,
    layout: Arc<Layout>,
    bricks: Bricks,
    table_from_world: DAffine3,
    /// Half-open box in table space in which bricks answer: the table, cut by the clip box.
    lo: DVec3,
    hi: DVec3,
    /// The field outside of that box.
    outside: [f64; 3],
    /// 1 trilinear, 0 nearest: multiplies the fractional position.
    smooth: f64,
}

impl Grid {
    /// A field that is `value` everywhere.
    pub fn constant(channels: usize, value: [f32; 3]) -> Grid {
        let frame = Frame {
            channels: if channels == 1 { 1 } else { 3 },
            background: if channels == 1 { [value[0]; 3] } else { value },
            filter: Filter::Trilinear,
            world_from_index: DAffine3::IDENTITY,
            index_from_world: DAffine3::IDENTITY,
            origin: [0; 3],
            dims: [0; 3],
            clip: None,
        };
        Grid::assemble(frame, Arc::new(Layout::default()), &[][..])
    }

    /// A field that is 0 everywhere.
    pub fn empty(channels: usize) -> Grid {
        Grid::constant(channels, [0.0; 3])
    }

    /// Gather bricks from the values of all node slots, channels interleaved.
    fn assemble(frame: Frame, layout: Arc<Layout>, values: impl Values) -> Grid {
        let origin = DVec3::from(frame.origin.map(f64::from));
        let table_from_world = table_from_world(&frame);
        let mut lo = DVec3::ZERO;
        let mut hi = DVec3::from(frame.dims.map(|n| (n * BRICK) as f64));
        if let Some((a, b)) = frame.clip {
            lo = lo.max(a - origin);
            hi = hi.min(b - origin);
        }
        let outside = if frame.clip.is_some() { [0.0; 3] } else { frame.background.map(f64::from) };
        let smooth = if frame.filter == Filter::Trilinear { 1.0 } else { 0.0 };
        let bricks = Bricks::gather(&frame, &layout, values);
        Grid { frame, layout, bricks, table_from_world, lo, hi, outside, smooth }
    }

    /// The same grid with other values, one per slot and channel (channels interleaved), as an optimiser sets them.
    pub fn with_values(&self, values: &[f32]) -> Result<Grid, String> {
        let expected = self.node_count() * self.channels();
        if values.len() != expected {
            return Err(format!("{} values given for a grid of {expected}", values.len()));
        }
        Ok(Grid::assemble(self.frame, self.layout.clone(), values))
    }

    /// The same field at another place. Errors if the transform cannot be inverted.
    pub fn placed(&self, world_from_index: DAffine3) -> Result<Grid, String> {
        let mut grid = self.clone();
        grid.frame.world_from_index = world_from_index;
        grid.frame.index_from_world = builder::inverse(world_from_index)?;
        grid.table_from_world = table_from_world(&grid.frame);
        Ok(grid)
    }

    pub fn channels(&self) -> usize {
        self.frame.channels
    }

    pub fn filter(&self) -> Filter {
        self.frame.filter
    }

    pub fn background(&self) -> [f32; 3] {
        self.frame.background
    }

    pub fn index_from_world(&self) -> DAffine3 {
        self.frame.index_from_world
    }

    pub fn world_from_index(&self) -> DAffine3 {
        self.frame.world_from_index
    }

    /// Least value of the field over all channels; a clipped grid's outside is left out.
    pub fn min(&self) -> f64 {
        self.fold_range(self.bricks.low, f64::min)
    }

    /// Greatest value of the field over all channels.
    pub fn max(&self) -> f64 {
        self.fold_range(self.bricks.high, f64::max)
    }

    fn fold_range(&self, all: [f32; 3], f: impl Fn(f64, f64) -> f64) -> f64 {
        self.with_outside(all, &f)[..self.channels()].iter().copied().reduce(f).unwrap_or(0.0)
    }

    /// Greatest value of the field per channel; a scalar grid repeats it.
    pub fn max3(&self) -> [f64; 3] {
        let m = self.with_outside(self.bricks.high, &f64::max);
        if self.channels() == 1 { [m[0]; 3] } else { m }
    }

    fn with_outside(&self, all: [f32; 3], f: &impl Fn(f64, f64) -> f64) -> [f64; 3] {
        if self.bricks.is_empty() {
            return self.outside;
        }
        let all = all.map(f64::from);
        if self.frame.clip.is_some() { all } else { std::array::from_fn(|c| f(all[c], self.outside[c])) }
    }

    /// Bytes that nodes and table take.
    pub fn active_bytes(&self) -> usize {
        self.bricks.bytes() + self.layout.bytes()
    }

    /// World box outside of which the field is its background (or cut to 0); `None` if that is everywhere.
    pub fn world_bounds(&self) -> Option<(DVec3, DVec3)> {
        if !self.lo.cmplt(self.hi).all() {
            return None;
        }
        let origin = DVec3::from(self.frame.origin.map(f64::from));
        let corner = |k: usize| {
            let pick = |a: usize| if k >> a & 1 == 0 { self.lo[a] } else { self.hi[a] };
            self.frame.world_from_index.transform_point3(origin + DVec3::new(pick(0), pick(1), pick(2)))
        };
        let first = corner(0);
        Some((1..8).map(corner).fold((first, first), |(a, b), p| (a.min(p), b.max(p))))
    }

    /// The box at which a clipped field ends, as the image of `[-1,1]^3`; `None` where the field goes on as its background.
    pub fn clip_box(&self) -> Option<DAffine3> {
        self.frame.clip.filter(|_| self.lo.cmplt(self.hi).all())?;
        let origin = DVec3::from(self.frame.origin.map(f64::from));
        let half = (self.hi - self.lo) * 0.5;
        let place = DAffine3::from_translation(origin + self.lo + half) * DAffine3::from_scale(half);
        Some(self.frame.world_from_index * place)
    }

    /// The box in which bricks answer as the image of the unit cube, and the cells along its edges; `None` where there are none.
    pub fn unit_box(&self) -> Option<(DAffine3, [usize; 3])> {
        if !self.lo.cmplt(self.hi).all() {
            return None;
        }
        let (origin, size) = (DVec3::from(self.frame.origin.map(f64::from)), self.hi - self.lo);
        let place = DAffine3::from_translation(origin + self.lo) * DAffine3::from_scale(size);
        Some((self.frame.world_from_index * place, size.ceil().to_array().map(|n| n as usize)))
    }

    /// Node window and fractional position of a point in table space; `None` outside of the box.
    #[inline(always)]
    fn locate(&self, q: DVec3) -> Option<(&[f32], DVec3)> {
        let inside = (q.x >= self.lo.x)
            & (q.y >= self.lo.y)
            & (q.z >= self.lo.z)
            & (q.x < self.hi.x)
            & (q.y < self.hi.y)
            & (q.z < self.hi.z);
        if !inside {
            return None;
        }
        let (i, j, k) = (q.x as i32, q.y as i32, q.z as i32);
        let f = DVec3::new(q.x - f64::from(i), q.y - f64::from(j), q.z - f64::from(k)) * self.smooth;
        let (i, j, k) = (i as usize, j as usize, k as usize);
        let [_, ny, nz] = self.frame.dims;
        let brick = ((i / BRICK) * ny + j / BRICK) * nz + k / BRICK;
        let local = (i % BRICK) * SLAB + (j % BRICK) * ROW + k % BRICK;
        Some((self.bricks.window(brick, local, self.frame.channels), f))
    }

    /// The field where no brick answers. A position that is not a number gives a value that is not one.
    #[cold]
    fn beyond(&self, q: DVec3) -> [f64; 3] {
        if q.is_nan() { [f64::NAN; 3] } else { self.outside }
    }

    /// Scalar field (channel 0) at a world position.
    #[inline]
    pub fn lookup(&self, p_world: DVec3) -> f64 {
        self.scalar_at(self.table_from_world.transform_point3(p_world))
    }

    /// All three channels at a world position; a scalar grid repeats its value.
    #[inline]
    pub fn lookup3(&self, p_world: DVec3) -> [f64; 3] {
        self.triple_at(self.table_from_world.transform_point3(p_world))
    }

    /// All channels, a scalar grid in each.
    #[inline]
    pub fn lookup_rgb(&self, p_world: DVec3) -> Rgb {
        if self.frame.channels == 1 { Rgb::splat(self.lookup(p_world)) } else { Rgb(self.lookup3(p_world)) }
    }

    /// Scalar field (channel 0) at an index position.
    pub fn lookup_index(&self, p_index: DVec3) -> f64 {
        self.scalar_at(p_index - DVec3::from(self.frame.origin.map(f64::from)))
    }

    #[inline(always)]
    fn scalar_at(&self, q: DVec3) -> f64 {
        match self.locate(q) {
            None => self.beyond(q)[0],
            Some((window, f)) if self.frame.channels == 1 => trilinear::<1>(window, 0, f),
            Some((window, f)) => trilinear::<3>(window, 0, f),
        }
    }

    #[inline(always)]
    fn triple_at(&self, q: DVec3) -> [f64; 3] {
        match self.locate(q) {
            None => self.beyond(q),
            Some((window, f)) if self.frame.channels == 1 => [trilinear::<1>(window, 0, f); 3],
            Some((window, f)) => std::array::from_fn(|c| trilinear::<3>(window, c, f)),
        }
    }

    /// World-space normal (any length) of the face of the grid's box nearest to a point.
    pub fn border_normal(&self, p_world: DVec3) -> DVec3 {
        let q = self.table_from_world.transform_point3(p_world);
        let far = (q - self.lo).abs().min((q - self.hi).abs()) / (self.hi - self.lo);
        let axis = (0..3).fold(0, |a, b| if far[b] < far[a] { b } else { a });
        self.table_from_world.matrix3.row(axis)
    }

    /// World-space gradient of the same interpolant (channel 0): one-sided at cell faces, 0 with `Filter::Nearest`.
    pub fn gradient(&self, p_world: DVec3) -> DVec3 {
        self.gradient3(p_world)[0]
    }

    /// World-space gradients of all channels; a scalar grid repeats its own.
    pub fn gradient3(&self, p_world: DVec3) -> [DVec3; 3] {
        let Some((window, f)) = self.locate(self.table_from_world.transform_point3(p_world)) else {
            return [DVec3::ZERO; 3];
        };
        let covariant = self.table_from_world.matrix3.transpose() * self.smooth;
        if self.frame.channels == 1 {
            [covariant * mix_gradient(&corners::<1>(window, 0), f.x, f.y, f.z); 3]
        } else {
            std::array::from_fn(|c| covariant * mix_gradient(&corners::<3>(window, c), f.x, f.y, f.z))
        }
    }
}

fn table_from_world(frame: &Frame) -> DAffine3 {
    let mut place = frame.index_from_world;
    place.translation -= DVec3::from(frame.origin.map(f64::from));
    place
}

/// The eight corner values of channel `c` of the cell whose window this is, z fastest.
#[inline(always)]
fn corners<const C: usize>(window: &[f32], c: usize) -> [f64; 8] {
    let w = &window[..WINDOW * C];
    // Spelled out: `array::map` is not inlined here.
    let v = |k: usize| f64::from(w[k * C + c]);
    [v(0), v(1), v(ROW), v(ROW + 1), v(SLAB), v(SLAB + 1), v(SLAB + ROW), v(SLAB + ROW + 1)]
}

/// `a` at f = 0, `b` at f = 1, and `a` exactly wherever both are equal.
#[inline(always)]
fn lerp(a: f64, b: f64, f: f64) -> f64 {
    a + f * (b - a)
}

/// Multilinear form of eight corner values.
#[inline(always)]
fn mix(v: &[f64; 8], x: f64, y: f64, z: f64) -> f64 {
    let near = lerp(lerp(v[0], v[1], z), lerp(v[2], v[3], z), y);
    let far = lerp(lerp(v[4], v[5], z), lerp(v[6], v[7], z), y);
    lerp(near, far, x)
}

#[inline(always)]
fn trilinear<const C: usize>(window: &[f32], c: usize, f: DVec3) -> f64 {
    mix(&corners::<C>(window, c), f.x, f.y, f.z)
}

/// Its partial derivatives, in cell coordinates.
#[inline(always)]
fn mix_gradient(v: &[f64; 8], x: f64, y: f64, z: f64) -> DVec3 {
    let face = |a: usize, b: usize, s: f64| lerp(v[a], v[b], s);
    let dx = lerp(face(4, 5, z), face(6, 7, z), y) - lerp(face(0, 1, z), face(2, 3, z), y);
    let dy = lerp(face(2, 3, z), face(6, 7, z), x) - lerp(face(0, 1, z), face(4, 5, z), x);
    let dz = lerp(face(1, 3, y), face(5, 7, y), x) - lerp(face(0, 2, y), face(4, 6, y), x);
    DVec3::new(dx, dy, dz)
}
