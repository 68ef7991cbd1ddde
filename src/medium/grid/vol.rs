//! Mitsuba's `.vol` files, version 3, single precision.
//!
//! Little endian: 'V' 'O' 'L', version byte 3, i32 encoding (1 = f32), i32 x, y, z resolution, i32 channels, six f32 of a
//! bounding box, then the values: x fastest, then y, then z, channels interleaved.

use super::builder::find_bad;
use super::{Allowed, BadVoxel, Filter, Grid};
use crate::error::{Error, Result};
use crate::math::{DAffine3, DMat3, DVec3};
use std::path::Path;

/// Bytes before the values.
const HEADER: usize = 48;

/// The content of a `.vol` file.
#[derive(Clone, Debug, PartialEq)]
pub struct Vol {
    /// x, y, z.
    pub res: [usize; 3],
    /// 1 or 3.
    pub channels: usize,
    /// Lowest and highest corner as the file says; Mitsuba uses it on request only.
    pub bbox: [[f32; 3]; 2],
    /// x fastest, then y, then z, channels interleaved.
    pub values: Vec<f32>,
}

impl Vol {
    /// Read a whole file's bytes; the message says what is wrong with them.
    pub fn parse(bytes: &[u8]) -> std::result::Result<Vol, String> {
        if !bytes.starts_with(b"VOL") {
            return Err("not a .vol file: it does not begin with \"VOL\"".into());
        }
        let Some((header, data)) = bytes.split_at_checked(HEADER) else {
            return Err(format!("the header is cut: {} of {HEADER} bytes", bytes.len()));
        };
        if header[3] != 3 {
            return Err(format!("version {} of the .vol format; only 3 is known", header[3]));
        }
        let word = |i: usize| [0, 1, 2, 3].map(|k| header[4 * i + k]);
        let int = |i: usize| i32::from_le_bytes(word(i));
        if int(1) != 1 {
            return Err(format!("encoding {}; only 1 (f32) is known", int(1)));
        }
        let channels = int(5);
        if channels != 1 && channels != 3 {
            return Err(format!("{channels} channels; only 1 and 3 are known"));
        }
        let res = [int(2), int(3), int(4)];
        if res.iter().any(|&n| n <= 0) {
            return Err(format!("a resolution of {} x {} x {}", res[0], res[1], res[2]));
        }

        // Compare with the file's length before taking any memory.
        let bytes_needed = res.iter().fold(4 * channels as u128, |n, &r| n * r as u128);
        if bytes_needed != data.len() as u128 {
            let [x, y, z] = res;
            let what = if bytes_needed > data.len() as u128 { "is cut" } else { "is too long" };
            return Err(format!(
                "the file {what}: {x} x {y} x {z} voxels of {channels} channels take {bytes_needed} bytes, {} are there",
                data.len()
            ));
        }
        let float = |i: usize| f32::from_le_bytes(word(i));
        Ok(Vol {
            res: res.map(|n| n as usize),
            channels: channels as usize,
            bbox: [[6, 7, 8].map(float), [9, 10, 11].map(float)],
            values: data.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect(),
        })
    }

    pub fn read(path: &Path) -> Result<Vol> {
        let bytes =
            std::fs::read(path).map_err(|source| Error::Io { what: format!("reading {}", path.display()), source })?;
        Vol::parse(&bytes).map_err(|what| Error::Runtime(format!("{}: {what}", path.display())))
    }

    /// The placement of the unit cube that a file's bounding box asks for; reads the header only.
    pub fn read_bbox(path: &Path) -> Result<DAffine3> {
        let io = |source| Error::Io { what: format!("reading {}", path.display()), source };
        let mut header = [0u8; HEADER];
        std::io::Read::read_exact(&mut std::fs::File::open(path).map_err(io)?, &mut header).map_err(io)?;
        let float = |i: usize| f64::from(f32::from_le_bytes([0, 1, 2, 3].map(|k| header[4 * i + k])));
        let (low, high) = (DVec3::new(float(6), float(7), float(8)), DVec3::new(float(9), float(10), float(11)));
        Ok(DAffine3 { matrix3: DMat3::from_diagonal(high - low), translation: low })
    }

    /// The bytes of a file. Errors if the values do not fit the resolution.
    pub fn to_bytes(&self) -> std::result::Result<Vec<u8>, String> {
        let count = self.res.iter().try_fold(self.channels, |n, &r| n.checked_mul(r));
        let small = |n: usize| i32::try_from(n).map_err(|_| format!("a resolution of {n}"));
        if count != Some(self.values.len()) {
            return Err(format!("{:?} x {} values expected, {} given", self.res, self.channels, self.values.len()));
        }
        let mut out = Vec::with_capacity(HEADER + 4 * self.values.len());
        out.extend(b"VOL\x03");
        out.extend(1i32.to_le_bytes());
        for n in self.res.into_iter().chain([self.channels]) {
            out.extend(small(n)?.to_le_bytes());
        }
        out.extend(self.bbox.iter().flatten().chain(&self.values).flat_map(|v| v.to_le_bytes()));
        Ok(out)
    }

    pub fn write(&self, path: &Path) -> Result<()> {
        let bytes = self.to_bytes().map_err(|what| Error::Runtime(format!("{}: {what}", path.display())))?;
        std::fs::write(path, bytes).map_err(|source| Error::Io { what: format!("writing {}", path.display()), source })
    }

    /// Maps the unit cube to the file's bounding box (Mitsuba's `use_grid_bbox`).
    pub fn bbox_from_unit(&self) -> DAffine3 {
        let [low, high] = self.bbox.map(|p| DVec3::from(p.map(f64::from)));
        DAffine3 { matrix3: DMat3::from_diagonal(high - low), translation: low }
    }

    /// Report values that are not allowed.
    pub fn validate(&self, allowed: Allowed) -> std::result::Result<(), BadVoxel> {
        let [nx, ny, _] = self.res;
        let index = |i: usize| [i % nx, i / nx % ny, i / nx / ny].map(|x| x as i32);
        find_bad(std::iter::once(&self.values[..]), self.channels, allowed, index)
    }

    /// The field: values at voxel centres of the unit cube, placed by `world_from_unit`, 0 outside.
    pub fn grid(&self, world_from_unit: DAffine3, filter: Filter) -> std::result::Result<Grid, String> {
        Grid::from_dense(self.channels, self.res, &self.values, world_from_unit, filter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Vol {
        let values = (0..2 * 3 * 4 * 3).map(|i| i as f32).collect();
        Vol { res: [2, 3, 4], channels: 3, bbox: [[-1.0, 0.0, 2.0], [1.0, 4.0, 3.0]], values }
    }

    #[test]
    fn a_written_file_reads_back() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("smoke.vol");
        sample().write(&path).unwrap();
        let read = Vol::read(&path).unwrap();
        assert_eq!(read, sample());
        assert_eq!(read.bbox_from_unit().transform_point3(DVec3::ONE), DVec3::new(1.0, 4.0, 3.0));
        let grid = read.grid(DAffine3::IDENTITY, Filter::Trilinear).unwrap();
        let centre = DVec3::new(0.75, 0.5, 0.125);
        assert_eq!(grid.lookup3(centre), [9.0, 10.0, 11.0]);
    }

    #[test]
    fn broken_files_are_refused() {
        let good = sample().to_bytes().unwrap();
        let broken = |at: usize, bytes: &[u8]| {
            let mut b = good.clone();
            b[at..at + bytes.len()].copy_from_slice(bytes);
            Vol::parse(&b).unwrap_err()
        };
        assert!(broken(0, b"vol").contains("begin"));
        assert!(broken(3, &[4]).contains("version 4"));
        assert!(broken(4, &[2]).contains("encoding 2"));
        assert!(broken(8, &(-2i32).to_le_bytes()).contains("-2"));
        assert!(broken(20, &[2]).contains("2 channels"));
        let huge: Vec<u8> = (0..3).flat_map(|_| i32::MAX.to_le_bytes()).collect();
        assert!(broken(8, &huge).contains("cut"));
        for n in 0..good.len() {
            assert!(Vol::parse(&good[..n]).is_err());
        }
        assert!(Vol::parse(&[&good[..], &[0]].concat()).unwrap_err().contains("too long"));
        assert!(Vol::read(Path::new("/nonexistent.vol")).is_err());
        assert!(Vol { res: [1, 1, 1], ..sample() }.to_bytes().is_err());
    }

    #[test]
    fn bad_voxels_are_counted() {
        let mut vol = sample();
        (vol.values[3 * 3 + 2], vol.values[20]) = (f32::INFINITY, -1.0);
        let bad = vol.validate(Allowed::NON_NEGATIVE).unwrap_err();
        assert_eq!(bad, BadVoxel { index: [1, 1, 0], channel: 2, value: f32::INFINITY, count: 2 });
        assert_eq!(vol.validate(Allowed::FINITE).unwrap_err().count, 1);
    }
}
