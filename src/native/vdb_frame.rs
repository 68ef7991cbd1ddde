//! The bytes of a `.vdb` file, walked before OpenVDB sees them: every count, length and offset is held against the file.
//!
//! Formats 222 to 224 (OpenVDB 1.1 to today). A file is a header, metadata, and one descriptor a grid with its place; a grid
//! is metadata, a transform, the topology (masks and tile values, depth first) and then the leaves' values in the same order.
//! Values lie in blocks: one byte says how inactive values are left out, then, if packed, a length that is negative for raw
//! data. All of it must add up; only what is within a packed block is left to zlib and blosc, which check their own input.

use crate::error::{Error, Result};
use std::collections::HashSet;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

const ZIP: u32 = 1;
const ACTIVE_MASK: u32 = 2;
const BLOSC: u32 = 4;

/// Origins beyond this are damage: half of what 32-bit index arithmetic can carry.
const FAR: i32 = 1 << 30;

/// A reader that knows where it is and where the file ends.
pub(super) struct Frame {
    r: BufReader<File>,
    length: u64,
    at: u64,
    grids: Vec<Grid>,
}

struct Grid {
    /// With the suffix that tells grids of one name apart.
    name: String,
    kind: String,
    /// Name of the grid whose tree this one shares; else empty.
    parent: String,
    packing: u32,
    half: bool,
    /// Where its transform begins, and where the grid ends.
    transform: u64,
    end: u64,
}

/// How the values of a tree lie in the file.
#[derive(Clone, Copy)]
struct Layout {
    packing: u32,
    /// Bytes of a value, as such and within a block.
    value: u64,
    packed: u64,
    leaf: LeafKind,
}

#[derive(Clone, Copy, PartialEq)]
enum LeafKind {
    Values,
    Bool,
    Mask,
}

type Checked<T> = std::result::Result<T, String>;

/// Bits of a node's masks, by level: leaf, 16^3 leaves, 32^3 of those.
const BITS: [u64; 3] = [512, 4096, 32768];

impl Frame {
    /// Check header, metadata and descriptors.
    pub fn open(path: &Path, newest_format: u32) -> Result<Self> {
        let io = |source| Error::Io { what: path.display().to_string(), source };
        let file = File::open(path).map_err(io)?;
        let about = file.metadata().map_err(io)?;
        let fail = |what: String| Error::Runtime(format!("{}: {what}", path.display()));
        if !about.is_file() {
            return Err(fail("it is not a file".into()));
        }
        let mut frame =
            Frame { r: BufReader::with_capacity(1 << 16, file), length: about.len(), at: 0, grids: Vec::new() };
        frame.head(newest_format).map_err(fail)?;
        Ok(frame)
    }

    fn head(&mut self, newest_format: u32) -> Checked<()> {
        let magic = self.bytes::<8>().unwrap_or_default();
        if magic != [0x20, b'B', b'D', b'V', 0, 0, 0, 0] {
            return Err("it is not a VDB file".into());
        }
        let format = self.u32()?;
        if format < 222 {
            return Err(format!("its format {format} is older than OpenVDB 1.1; write it again with a newer program"));
        }
        if format > newest_format {
            return Err(format!(
                "its format {format} is newer than {newest_format}, the newest that can be read (damaged file?)"
            ));
        }
        let _library_version = self.bytes::<8>()?;
        let [offsets] = self.bytes::<1>()?;
        let _uuid = self.bytes::<36>()?;
        self.metadata()?;
        let count = self.u32()?;
        if offsets != 1 {
            return Err(match offsets {
                0 => "it was written as a stream, without grid offsets; write it again as a file".into(),
                _ => "its header is damaged".to_string(),
            });
        }
        for i in 0..count {
            let (name, kind, parent) = (self.string()?, self.string()?, self.string()?);
            let (start, blocks, end) = (self.i64()?, self.i64()?, self.i64()?);
            let here = self.at;
            if end >= 0 && end as u64 > self.length {
                let length = self.length;
                return Err(format!(
                    "it is cut: grid {i} (`{name}`) ends at byte {end}, but the file has {length} bytes"
                ));
            }
            if start < here as i64 || blocks < start || end < blocks {
                return Err(format!(
                    "the offsets of grid {i} (`{name}`) are damaged: {start}, {blocks}, {end} at byte {here}"
                ));
            }
            self.seek(start as u64)?;
            let packing = self.u32()?;
            if packing & !(ZIP | ACTIVE_MASK | BLOSC) != 0 {
                return Err(format!("grid {i} (`{name}`) is packed in the unknown way {packing}"));
            }
            let half = self.metadata()?;
            let transform = self.at;
            self.string()?;
            let end = end as u64;
            if self.at > end {
                return Err(format!("grid {i} (`{name}`) runs over its end"));
            }
            self.grids.push(Grid { name, kind, parent, packing, half, transform, end });
            self.seek(end)?;
        }
        Ok(())
    }

    /// Metadata of the file or of a grid; whether it says that the floats are stored as halves.
    fn metadata(&mut self) -> Checked<bool> {
        let mut half = false;
        for _ in 0..self.u32()? {
            let name = self.string()?;
            let kind = self.string()?;
            let size = u64::from(self.u32()?);
            let end = self.room(size)?;
            let fixed = match kind.as_str() {
                "bool" => Some(1),
                "int32" | "float" => Some(4),
                "int64" | "double" | "vec2i" | "vec2s" => Some(8),
                "vec3i" | "vec3s" => Some(12),
                "vec2d" | "vec4i" | "vec4s" | "quats" => Some(16),
                "vec3d" => Some(24),
                "vec4d" | "quatd" => Some(32),
                "mat3s" => Some(36),
                "mat4s" => Some(64),
                "mat3d" => Some(72),
                "mat4d" => Some(128),
                _ => None,
            };
            if fixed.is_some_and(|f| f != size) {
                return Err(format!("metadata `{name}` of type {kind} has {size} bytes (damaged file)"));
            }
            if name == "is_saved_as_half_float" {
                if kind != "bool" {
                    return Err(format!("metadata `{name}` is of type {kind} (damaged file)"));
                }
                half = self.bytes::<1>()? != [0];
            }
            // Its count makes OpenVDB allocate: it is a number of leaves, each of which has its mask in the file.
            if kind == "__delayedload" && size >= 4 {
                let leaves = u64::from(self.u32()?);
                if leaves * 64 > self.length {
                    return Err(format!("metadata `{name}` counts {leaves} leaves (damaged file)"));
                }
            }
            self.seek(end)?;
        }
        Ok(half)
    }

    /// Check a grid's transform and topology and, `with_values`, its leaves. Types that are never loaded pass.
    pub fn check_tree(&mut self, index: usize, with_values: bool) -> Checked<()> {
        let Some(grid) = self.grids.get(index) else { return Ok(()) };
        let tree = if grid.parent.is_empty() {
            index
        } else {
            let parent = self.grids.iter().position(|g| g.name == grid.parent && g.parent.is_empty());
            parent.ok_or("it shares the tree of a grid that is not in the file")?
        };
        let grid = &self.grids[tree];
        let (value, packed, leaf) = match grid.kind.strip_suffix("_HalfFloat").unwrap_or(&grid.kind) {
            "Tree_float_5_4_3" => (4, if grid.half { 2 } else { 4 }, LeafKind::Values),
            "Tree_double_5_4_3" => (8, if grid.half { 2 } else { 8 }, LeafKind::Values),
            "Tree_int32_5_4_3" => (4, 4, LeafKind::Values),
            "Tree_int64_5_4_3" => (8, 8, LeafKind::Values),
            "Tree_vec3s_5_4_3" => (12, if grid.half { 6 } else { 12 }, LeafKind::Values),
            "Tree_vec3d_5_4_3" => (24, if grid.half { 6 } else { 24 }, LeafKind::Values),
            "Tree_vec3i_5_4_3" => (12, 12, LeafKind::Values),
            "Tree_bool_5_4_3" => (1, 1, LeafKind::Bool),
            "Tree_mask_5_4_3" => (1, 1, LeafKind::Mask),
            _ => return Ok(()),
        };
        let layout = Layout { packing: grid.packing, value, packed, leaf };
        let (transform, end) = (grid.transform, grid.end);
        self.back_to(transform)?;
        self.transform()?;
        self.tree(layout, with_values)?;
        if self.at > end {
            return Err(format!("it runs over its end, byte {end}, to {} (damaged file)", self.at));
        }
        Ok(())
    }

    fn transform(&mut self) -> Checked<()> {
        let kind = self.string()?;
        // Three numbers a vector, each map as its own writer has it.
        let size = match kind.as_str() {
            "TranslationMap" => 3 * 8,
            "ScaleMap" | "UniformScaleMap" => 5 * 3 * 8,
            "ScaleTranslateMap" | "UniformScaleTranslateMap" => 6 * 3 * 8,
            "AffineMap" | "UnitaryMap" => 16 * 8,
            "NonlinearFrustumMap" => {
                self.skip(8 * 8)?;
                return self.transform();
            }
            _ => return Err(format!("its transform is of the unknown type {kind} (damaged file?)")),
        };
        let end = self.room(size)?;
        self.seek(end)
    }

    fn tree(&mut self, layout: Layout, with_values: bool) -> Checked<()> {
        let buffers = self.u32()?;
        if buffers != 1 {
            return Err(format!("its tree has {buffers} buffers (damaged file)"));
        }
        self.skip(layout.value)?;
        let (tiles, children) = (self.u32()?, self.u32()?);
        let mut origins = HashSet::new();
        let mut active = Vec::new();
        for i in 0..u64::from(tiles) + u64::from(children) {
            let origin = [self.i32()?, self.i32()?, self.i32()?];
            if origin.iter().any(|x| x % 4096 != 0 || !(-FAR..FAR).contains(x)) || !origins.insert(origin) {
                return Err(format!("a node of its tree lies at {origin:?} (damaged file)"));
            }
            if i < u64::from(tiles) {
                self.skip(layout.value + 1)?;
            } else {
                self.node(layout, 2, &mut active)?;
            }
        }

        // The leaves' values follow, in the order of the leaves. Each begins with its mask again.
        if with_values {
            for count in active {
                match layout.leaf {
                    LeafKind::Values => {
                        self.skip(64)?;
                        self.block(layout, 512, u64::from(count))?;
                    }
                    LeafKind::Bool => self.skip(64 + 12 + 64)?,
                    LeafKind::Mask => self.skip(64 + 12)?,
                }
            }
        }
        Ok(())
    }

    /// Topology of one node and all below it; `active` gets each leaf's number of active voxels.
    fn node(&mut self, layout: Layout, level: usize, active: &mut Vec<u16>) -> Checked<()> {
        if level == 0 {
            active.push(self.mask(512)? as u16);
            return Ok(());
        }
        let bits = BITS[level];
        let children = self.mask(bits)?;
        let on = self.mask(bits)?;
        self.block(layout, bits, on)?;
        for _ in 0..children {
            self.node(layout, level - 1, active)?;
        }
        Ok(())
    }

    /// Read a mask and count its bits.
    fn mask(&mut self, bits: u64) -> Checked<u64> {
        let mut on = 0;
        for _ in 0..bits / 512 {
            on += self.bytes::<64>()?.iter().map(|b| u64::from(b.count_ones())).sum::<u64>();
        }
        Ok(on)
    }

    /// Pass over the values of a node of `bits` values, `on` of which are active.
    fn block(&mut self, layout: Layout, bits: u64, on: u64) -> Checked<()> {
        let [left_out] = self.bytes::<1>()?;
        let (values, mask) = match left_out {
            0 | 1 | 6 => (0, false),
            2 => (1, false),
            3 => (0, true),
            4 => (1, true),
            5 => (2, true),
            _ => {
                return Err(format!("a block of values begins with {left_out} at byte {} (damaged file)", self.at - 1));
            }
        };
        self.skip(values * layout.value + if mask { bits / 8 } else { 0 })?;
        let all = left_out == 6 || layout.packing & ACTIVE_MASK == 0;
        let count = if all { bits } else { on };
        let bytes = count * layout.packed;

        // Halves of no value at all are not written, not even their length.
        if count == 0 && layout.packed < layout.value {
            return Ok(());
        }
        if layout.packing & (ZIP | BLOSC) == 0 {
            return self.skip(bytes);
        }
        let at = self.at;
        let size = self.i64()?;
        let damaged = || format!("a block of {bytes} bytes says {size} at byte {at} (damaged file)");
        if size <= 0 {
            if size.unsigned_abs() != bytes {
                return Err(damaged());
            }
            return self.skip(bytes);
        }
        let size = size as u64;
        let end = self.room(size).map_err(|_| damaged())?;
        if layout.packing & BLOSC != 0 {
            // Blosc believes the lengths in its own header.
            if size < 16 {
                return Err(damaged());
            }
            let _versions = self.u32()?;
            let (unpacked, block, packed) = (u64::from(self.u32()?), u64::from(self.u32()?), u64::from(self.u32()?));
            if unpacked != bytes || packed != size || (bytes > 0 && !(1..=bytes).contains(&block)) {
                return Err(damaged());
            }
        }
        self.seek(end)
    }

    /// The position `n` bytes on, if the file goes so far.
    fn room(&self, n: u64) -> Checked<u64> {
        let end = self.at.checked_add(n).filter(|&e| e <= self.length);
        end.ok_or_else(|| format!("it is cut or damaged: {n} bytes are wanted at byte {} of {}", self.at, self.length))
    }

    fn skip(&mut self, n: u64) -> Checked<()> {
        let end = self.room(n)?;
        self.seek(end)
    }

    fn seek(&mut self, to: u64) -> Checked<()> {
        self.r.seek_relative(to as i64 - self.at as i64).map_err(|e| e.to_string())?;
        self.at = to;
        Ok(())
    }

    /// As `seek`; after an error, too, when the place is not known.
    fn back_to(&mut self, to: u64) -> Checked<()> {
        use std::io::{Seek, SeekFrom};
        self.r.seek(SeekFrom::Start(to)).map_err(|e| e.to_string())?;
        self.at = to;
        Ok(())
    }

    fn bytes<const N: usize>(&mut self) -> Checked<[u8; N]> {
        let end = self.room(N as u64)?;
        let mut b = [0; N];
        self.r.read_exact(&mut b).map_err(|e| e.to_string())?;
        self.at = end;
        Ok(b)
    }

    fn u32(&mut self) -> Checked<u32> {
        self.bytes().map(u32::from_le_bytes)
    }

    fn i32(&mut self) -> Checked<i32> {
        self.bytes().map(i32::from_le_bytes)
    }

    fn i64(&mut self) -> Checked<i64> {
        self.bytes().map(i64::from_le_bytes)
    }

    /// A string's first 256 bytes, which is enough for names and types.
    fn string(&mut self) -> Checked<String> {
        let n = u64::from(self.u32()?);
        let end = self.room(n)?;
        let mut b = vec![0; n.min(256) as usize];
        self.r.read_exact(&mut b).map_err(|e| e.to_string())?;
        self.at += b.len() as u64;
        self.seek(end)?;
        Ok(String::from_utf8_lossy(&b).into_owned())
    }
}
