//! Sparse grids from and to `.vdb` files.
//!
//! OpenVDB works only here, at load and write-back; rendering reads what Rust owns. Index space has voxel *centres* at
//! integers: world = `world_from_index` * (i, j, k).
//!
//! OpenVDB trusts the counts in a file: it allocates what they say before it reads, and reads a raw block of any stated
//! length into its buffer before it compares the two. So `vdb_frame` walks a file before OpenVDB sees it.

use crate::error::{Error, Result};
use crate::math::{DAffine3, DMat4, DVec3};
use crate::native::vdb_frame::Frame;
use openvdb_sys as sys;
use std::cell::RefCell;
use std::ffi::{CStr, CString, c_char};
use std::path::{Path, PathBuf};

/// Edge of a leaf, in voxels.
pub const LEAF: i32 = 8;
/// Voxels of a leaf.
pub const LEAF_VOXELS: usize = 512;
/// Origins beyond this are damage: half of what 32-bit index arithmetic can carry.
const FAR: i32 = 1 << 30;

/// What a file says of one grid, and what its topology shows.
#[derive(Clone, Debug)]
pub struct GridInfo {
    pub name: String,
    /// Place in the file, from 0.
    pub index: usize,
    /// "float", "double", "int32", "int64", "bool", "mask", "vec3s", "vec3d", "vec3i"; the tree's type where OpenVDB does
    /// not know it. Half floats are "float" with `stored_half`.
    pub value_type: String,
    /// "fog volume", "level set", "staggered", "unknown".
    pub class: String,
    pub creator: String,
    /// OpenVDB's name of the map, such as "UniformScaleTranslateMap".
    pub transform: String,
    /// NaN if the map is not affine (frustum); such a grid cannot be loaded.
    pub world_from_index: DAffine3,
    /// Inverse of `world_from_index`.
    pub index_from_world: DAffine3,
    /// Scalars are in the first place.
    pub background: [f64; 3],
    /// Active voxels, those in tiles included.
    pub active_voxels: u64,
    pub leaf_count: u64,
    /// Box of the active voxels, both corners within.
    pub bbox: Option<([i32; 3], [i32; 3])>,
    pub stored_half: bool,
    /// Bytes in OpenVDB's own memory when loaded.
    pub memory: u64,
}

/// A block of 8^3 voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct Leaf {
    /// Lowest voxel; a multiple of 8.
    pub origin: [i32; 3],
    /// Bit `i % 64` of word `i / 64`: voxel `i` is active.
    pub active: [u64; 8],
    /// Voxel (x, y, z) of the leaf is `i = x << 6 | y << 3 | z`, channels interleaved.
    pub values: Vec<f32>,
}

impl Leaf {
    pub fn is_active(&self, voxel: usize) -> bool {
        self.active[voxel >> 6] >> (voxel & 63) & 1 != 0
    }
}

/// A cube of one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tile {
    /// Lowest voxel; a multiple of `size`.
    pub origin: [i32; 3],
    /// Edge in voxels: 8, 128 or 4096.
    pub size: i32,
    /// Scalars are in the first place.
    pub value: [f32; 3],
    pub active: bool,
}

/// A grid in memory. Where there is neither leaf nor tile, it has the background's value.
#[derive(Clone, Debug)]
pub struct VdbGrid {
    pub info: GridInfo,
    /// 1 or 3.
    pub channels: usize,
    pub leaves: Vec<Leaf>,
    /// Active tiles, and inactive ones whose value is not the background's.
    pub tiles: Vec<Tile>,
}

/// Which grid of a file. A file may have several of one name.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Select {
    /// The first of that name.
    Name(String),
    /// Place in the file, from 0.
    Index(usize),
    /// The n-th of that name, from 0.
    NameIndex(String, usize),
}

/// A grid of floats, or of vectors of three, to be written.
#[derive(Clone, Debug)]
pub struct WriteGrid {
    pub name: String,
    /// 1 or 3.
    pub channels: usize,
    pub world_from_index: DAffine3,
    /// In all channels.
    pub background: f32,
    /// 512 values each, channels interleaved. OpenVDB keeps the values of inactive voxels only if there are at most two different ones.
    pub leaves: Vec<Leaf>,
    pub tiles: Vec<Tile>,
    /// "fog volume", "level set", "unknown".
    pub class: String,
    /// Store half floats.
    pub half: bool,
}

/// How a file is packed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compression {
    /// Blosc and active voxels only, where the library has it.
    #[default]
    Default,
    None,
    Zip,
}

/// Version of the OpenVDB library, such as "10.0.1".
pub fn version() -> String {
    // SAFETY: a static string.
    unsafe { text(sys::tvdb_version()) }
}

/// All grids of a file, in its order: metadata and topology. No leaf values are read.
pub fn list(path: &Path) -> Result<Vec<GridInfo>> {
    let file = Open::new(path)?;
    (0..file.count()).map(|i| file.stats(i)).collect()
}

/// What [`list`] says of one grid.
pub fn info(path: &Path, select: &Select) -> Result<GridInfo> {
    let file = Open::new(path)?;
    file.stats(file.find(select)?)
}

/// Load one grid. Values become f32; other types than float, half, double, int32, int64, bool, mask and vec3 are errors.
pub fn load(path: &Path, select: &Select) -> Result<VdbGrid> {
    let grid = open(path, select)?;
    let mut leaves = Vec::with_capacity(grid.leaf_count());
    let mut leaf = grid.room();
    for i in 0..grid.leaf_count() {
        grid.leaf(i, &mut leaf)?;
        leaves.push(leaf.clone());
    }
    Ok(VdbGrid { channels: grid.channels, leaves, tiles: grid.tiles()?, info: grid.info.clone() })
}

/// One grid in OpenVDB's memory, as [`load`] reads it: whoever needs each leaf only once takes them from there.
pub fn open(path: &Path, select: &Select) -> Result<Loaded> {
    let file = Open::new(path)?;
    file.load(file.find(select)?)
}

/// OpenVDB's own trilinear sampler at world points; vectors interleaved. For tests.
pub fn sample_box(path: &Path, select: &Select, points: &[DVec3]) -> Result<Vec<f64>> {
    let file = Open::new(path)?;
    let grid = file.load(file.find(select)?)?;
    let mut out = vec![0.0; points.len() * grid.channels];
    let xyz: Vec<f64> = points.iter().flat_map(|p| p.to_array()).collect();
    // SAFETY: `xyz` has 3 n numbers and `out` n * channels.
    call(path, &grid.info.name, |e, n| unsafe {
        sys::tvdb_sample(grid.handle, xyz.as_ptr(), points.len(), out.as_mut_ptr(), e, n)
    })?;
    Ok(out)
}

/// Write a file of float grids. It appears whole or not at all.
pub fn write(path: &Path, grids: &[WriteGrid]) -> Result<()> {
    write_packed(path, grids, Compression::Default)
}

/// As [`write()`], with a choice of the packing.
pub fn write_packed(path: &Path, grids: &[WriteGrid], compression: Compression) -> Result<()> {
    let mut temporary = path.as_os_str().to_owned();
    temporary.push(format!(".{}.part", std::process::id()));
    let temporary = Path::new(&temporary);
    let written = write_file(temporary, path, grids, compression).and_then(|()| {
        std::fs::rename(temporary, path).map_err(|source| Error::Io { what: path.display().to_string(), source })
    });
    if written.is_err() {
        // Nothing to tell beyond the error that led here.
        let _ = std::fs::remove_file(temporary);
    }
    written
}

fn write_file(temporary: &Path, path: &Path, grids: &[WriteGrid], compression: Compression) -> Result<()> {
    let mut writer = Writer(std::ptr::null_mut());
    // SAFETY: the handle goes into `writer`, which frees it.
    call(path, "", |e, n| unsafe { sys::tvdb_writer_new(&mut writer.0, e, n) })?;
    for g in grids {
        let name = c_string(path, &g.name)?;
        let class = c_string(path, &g.class)?;
        let m = DMat4::from(g.world_from_index).to_cols_array();
        if !g.world_from_index.is_finite() || g.world_from_index.matrix3.determinant() == 0.0 {
            return Err(damage(path, &g.name, "its transform cannot be inverted"));
        }
        if ![1, 3].contains(&g.channels) {
            return Err(damage(path, &g.name, &format!("{} channels; 1 or 3 can be written", g.channels)));
        }
        // SAFETY: C strings and 16 numbers, alive through the call.
        call(path, &g.name, |e, n| unsafe {
            sys::tvdb_writer_grid(
                writer.0,
                name.as_ptr(),
                class.as_ptr(),
                m.as_ptr(),
                g.channels as i32,
                g.background,
                i32::from(g.half),
                e,
                n,
            )
        })?;

        // Tiles first: a leaf within one takes its place.
        for t in &g.tiles {
            if ![8, 128, 4096].contains(&t.size) || !aligned(t.origin, t.size) {
                return Err(damage(
                    path,
                    &g.name,
                    &format!("no tile of edge {} at {:?} is possible", t.size, t.origin),
                ));
            }
            // SAFETY: three numbers, twice.
            call(path, &g.name, |e, n| unsafe {
                let (origin, value) = (t.origin.as_ptr(), t.value.as_ptr());
                sys::tvdb_writer_tile(writer.0, origin, t.size, value, i32::from(t.active), e, n)
            })?;
        }
        for l in &g.leaves {
            let needed = LEAF_VOXELS * g.channels;
            if l.values.len() != needed || !aligned(l.origin, LEAF) {
                let given = l.values.len();
                let what = format!("leaf at {:?} with {given} values: {needed} at multiples of 8 are needed", l.origin);
                return Err(damage(path, &g.name, &what));
            }
            // SAFETY: 3, 8 and 512 * channels numbers.
            call(path, &g.name, |e, n| unsafe {
                sys::tvdb_writer_leaf(writer.0, l.origin.as_ptr(), l.active.as_ptr(), l.values.as_ptr(), e, n)
            })?;
        }
    }
    let out = c_path(temporary)?;
    let compression = match compression {
        Compression::Default => 0,
        Compression::None => 1,
        Compression::Zip => 2,
    };
    // SAFETY: a C string.
    call(path, "", |e, n| unsafe { sys::tvdb_writer_finish(writer.0, out.as_ptr(), compression, e, n) })
}

/// A file whose frame was checked, open in OpenVDB.
struct Open<'a> {
    path: &'a Path,
    frame: RefCell<Frame>,
    handle: *mut sys::tvdb_file,
}

impl Drop for Open<'_> {
    fn drop(&mut self) {
        // SAFETY: our own handle, closed once; null is allowed.
        unsafe { sys::tvdb_close(self.handle) };
    }
}

impl<'a> Open<'a> {
    fn new(path: &'a Path) -> Result<Self> {
        // SAFETY: a constant of the library.
        let newest = unsafe { sys::tvdb_file_version() };
        let frame = RefCell::new(Frame::open(path, newest)?);
        let mut file = Open { path, frame, handle: std::ptr::null_mut() };
        let c = c_path(path)?;
        // SAFETY: a C string; the handle goes into `file`, which closes it.
        call(path, "", |e, n| unsafe { sys::tvdb_open(c.as_ptr(), &mut file.handle, e, n) })?;
        Ok(file)
    }

    fn count(&self) -> usize {
        // SAFETY: an open handle.
        unsafe { sys::tvdb_count(self.handle) }
    }

    fn name(&self, i: usize) -> String {
        // SAFETY: an open handle; the string lives as long as it.
        unsafe { text(sys::tvdb_name(self.handle, i)) }
    }

    fn find(&self, select: &Select) -> Result<usize> {
        let names: Vec<String> = (0..self.count()).map(|i| self.name(i)).collect();
        let (found, wanted) = match select {
            Select::Index(i) => (Some(*i).filter(|&i| i < names.len()), format!("grid number {i}")),
            Select::Name(n) => (names.iter().position(|m| m == n), format!("grid `{n}`")),
            Select::NameIndex(n, k) => {
                let nth = names.iter().enumerate().filter(|(_, m)| *m == n).nth(*k).map(|(i, _)| i);
                (nth, format!("grid `{n}` number {k}"))
            }
        };
        found.ok_or_else(|| {
            let there = names.iter().enumerate().map(|(i, n)| format!("{i}: {n}")).collect::<Vec<_>>().join(", ");
            let there = if there.is_empty() { "no grid".to_string() } else { there };
            Error::Runtime(format!("{}: it has no {wanted}; it has {there}", self.path.display()))
        })
    }

    fn check_tree(&self, i: usize, with_values: bool) -> Result<()> {
        self.frame.borrow_mut().check_tree(i, with_values).map_err(|what| damage(self.path, &self.name(i), &what))
    }

    fn stats(&self, i: usize) -> Result<GridInfo> {
        self.check_tree(i, false)?;
        let mut raw = std::mem::MaybeUninit::<sys::tvdb_info>::zeroed();
        // SAFETY: an open handle and room for one description.
        call(self.path, &self.name(i), |e, n| unsafe { sys::tvdb_stats(self.handle, i, raw.as_mut_ptr(), e, n) })?;
        // SAFETY: filled by the shim; its strings live as long as the handle.
        Ok(unsafe { grid_info(i, &raw.assume_init()) })
    }

    fn load(&self, i: usize) -> Result<Loaded> {
        self.check_tree(i, true)?;
        let mut raw = std::mem::MaybeUninit::<sys::tvdb_info>::zeroed();
        let name = self.name(i);
        let mut handle = std::ptr::null_mut();
        // SAFETY: an open handle, room for one description and one handle.
        call(self.path, &name, |e, n| unsafe { sys::tvdb_load(self.handle, i, &mut handle, raw.as_mut_ptr(), e, n) })?;
        // SAFETY: filled by the shim; its strings live as long as the file's handle.
        let (info, channels) = unsafe {
            let raw = raw.assume_init();
            (grid_info(i, &raw), raw.channels as usize)
        };
        let (mut leaves, mut tiles) = (0, 0);
        // SAFETY: a handle just filled.
        unsafe { sys::tvdb_node_counts(handle, &mut leaves, &mut tiles) };
        let loaded = Loaded { path: self.path.to_owned(), handle, leaves, tiles, info, channels };
        if !loaded.info.world_from_index.is_finite() {
            let what = format!("its transform is a {}: only affine ones can be rendered", loaded.info.transform);
            return Err(damage(self.path, &name, &what));
        }
        if !loaded.info.index_from_world.is_finite() {
            return Err(damage(self.path, &name, "its transform cannot be inverted"));
        }
        Ok(loaded)
    }
}

/// A grid in OpenVDB's memory.
pub struct Loaded {
    pub(super) path: PathBuf,
    pub(super) handle: *mut sys::tvdb_grid,
    leaves: usize,
    tiles: usize,
    pub info: GridInfo,
    /// 1 or 3.
    pub channels: usize,
}

impl Drop for Loaded {
    fn drop(&mut self) {
        // SAFETY: our own handle, released once.
        unsafe { sys::tvdb_release(self.handle) };
    }
}

impl Loaded {
    pub fn leaf_count(&self) -> usize {
        self.leaves
    }

    /// A leaf to be read into.
    pub fn room(&self) -> Leaf {
        Leaf { origin: [0; 3], active: [0; 8], values: vec![0.0; LEAF_VOXELS * self.channels] }
    }

    /// Copy the i-th leaf out.
    pub fn leaf(&self, i: usize, leaf: &mut Leaf) -> Result<()> {
        let name = &self.info.name;
        leaf.values.resize(LEAF_VOXELS * self.channels, 0.0);
        // SAFETY: an open handle; room for 3, 8 and 512 * channels numbers; an index out of range is an error.
        call(&self.path, name, |e, n| unsafe {
            let (origin, active) = (leaf.origin.as_mut_ptr(), leaf.active.as_mut_ptr());
            sys::tvdb_leaf(self.handle, i, origin, active, leaf.values.as_mut_ptr(), e, n)
        })?;
        if !aligned(leaf.origin, LEAF) {
            return Err(damage(&self.path, name, &format!("a leaf lies at {:?} (damaged file)", leaf.origin)));
        }
        Ok(())
    }

    /// Active tiles, and inactive ones whose value is not the background's.
    pub fn tiles(&self) -> Result<Vec<Tile>> {
        let name = &self.info.name;
        let mut tiles = Vec::with_capacity(self.tiles);
        for i in 0..self.tiles {
            let mut tile = Tile { origin: [0; 3], size: 0, value: [0.0; 3], active: false };
            let mut active = 0;
            // SAFETY: an open handle; room for 3, 1, 3 and 1 numbers.
            call(&self.path, name, |e, n| unsafe {
                let (origin, value) = (tile.origin.as_mut_ptr(), tile.value.as_mut_ptr());
                sys::tvdb_tile(self.handle, i, origin, &mut tile.size, value, &mut active, e, n)
            })?;
            tile.active = active != 0;
            if !aligned(tile.origin, tile.size) {
                return Err(damage(&self.path, name, &format!("a tile lies at {:?} (damaged file)", tile.origin)));
            }
            tiles.push(tile);
        }
        Ok(tiles)
    }
}

struct Writer(*mut sys::tvdb_writer);

impl Drop for Writer {
    fn drop(&mut self) {
        // SAFETY: our own handle, freed once; null is allowed.
        unsafe { sys::tvdb_writer_free(self.0) };
    }
}

fn aligned(origin: [i32; 3], size: i32) -> bool {
    size > 0 && origin.iter().all(|&x| x.rem_euclid(size) == 0 && (-FAR..FAR).contains(&x))
}

pub(super) fn damage(path: &Path, grid: &str, what: &str) -> Error {
    if grid.is_empty() {
        Error::Runtime(format!("{}: {what}", path.display()))
    } else {
        Error::Runtime(format!("{}: grid `{grid}`: {what}", path.display()))
    }
}

/// Call a function of the shim with room for its message; its message becomes the error.
pub(super) fn call(path: &Path, grid: &str, f: impl FnOnce(*mut c_char, usize) -> i32) -> Result<()> {
    let mut message = [0 as c_char; 1024];
    if f(message.as_mut_ptr(), message.len()) == 0 {
        return Ok(());
    }
    // SAFETY: the shim ends the message with a zero within the room it was told; without one it is empty.
    let what = unsafe { text(message.as_ptr()) };
    let what = if what.is_empty() { "OpenVDB fails without a message" } else { &what };
    Err(damage(path, grid, what))
}

/// # Safety
/// Null, or a C string.
unsafe fn text(s: *const c_char) -> String {
    if s.is_null() {
        return String::new();
    }
    // SAFETY: the caller's promise.
    unsafe { CStr::from_ptr(s) }.to_string_lossy().into_owned()
}

fn c_string(path: &Path, s: &str) -> Result<CString> {
    CString::new(s).map_err(|_| damage(path, "", &format!("the name {s:?} has a zero in it")))
}

fn c_path(path: &Path) -> Result<CString> {
    use std::os::unix::ffi::OsStrExt;
    CString::new(path.as_os_str().as_bytes()).map_err(|_| damage(path, "", "the file name has a zero in it"))
}

/// # Safety
/// The strings of `raw` are alive.
unsafe fn grid_info(index: usize, raw: &sys::tvdb_info) -> GridInfo {
    let world_from_index = DAffine3::from_mat4(DMat4::from_cols_array(&raw.world_from_index));
    // SAFETY: the caller's promise.
    let t = |s| unsafe { text(s) };
    GridInfo {
        name: t(raw.name),
        index,
        value_type: t(raw.value_type),
        class: t(raw.grid_class),
        creator: t(raw.creator),
        transform: t(raw.transform),
        world_from_index,
        index_from_world: world_from_index.inverse(),
        background: raw.background,
        active_voxels: raw.active_voxels,
        leaf_count: raw.leaves,
        bbox: (raw.active_voxels > 0).then_some((raw.lo, raw.hi)),
        stored_half: raw.stored_half != 0,
        memory: raw.memory,
    }
}
