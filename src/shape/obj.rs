//! Wavefront OBJ files: all objects and groups merged, polygons cut into triangles.
//!
//! Read here and not by `tobj`, which on real files makes up normals and texture coordinates where a corner has none (it
//! repeats the last), takes a polyline of three points for a triangle, rounds to f32, tells no line for an error, and
//! panics on some indices that are out of range. The tests hold it against `tobj` where both can read.

use super::TriangleMesh;
use crate::math::{DVec2, DVec3};
use std::collections::HashMap;
use std::path::Path;
use std::str::SplitWhitespace;

/// Read a mesh from the file. The error says what is wrong and in which line; the caller knows the file.
pub fn load(path: &Path) -> Result<TriangleMesh, String> {
    read(&std::fs::read(path).map_err(|e| format!("cannot be read: {e}"))?)
}

/// Read a mesh from the bytes of a file. A corner is one vertex per (position, uv, normal). Where only some corners
/// have a normal, the others get their face's; where only some have texture coordinates, the others get (0, 0).
/// Points, lines, curves and materials are skipped.
pub fn read(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let text = String::from_utf8_lossy(bytes);
    let mut obj = Obj::default();
    let mut joined = String::new();
    for (i, line) in text.lines().enumerate() {
        // A backslash continues the line.
        if let Some(part) = line.trim_end().strip_suffix('\\') {
            joined.push_str(part);
            joined.push(' ');
            continue;
        }
        joined.push_str(line);
        obj.line(i + 1, &joined).map_err(|e| format!("line {}: {e}", i + 1))?;
        joined.clear();
    }
    if !joined.is_empty() {
        return Err("the last line is continued, but the file ends: it is cut".into());
    }
    obj.finish()
}

const KINDS: [&str; 3] = ["position", "texture coordinate", "normal"];

/// A corner: positions, texture coordinates, normals by number.
type Corner = [Option<u32>; 3];

#[derive(Default)]
struct Obj {
    positions: Vec<DVec3>,
    uvs: Vec<DVec2>,
    normals: Vec<DVec3>,
    triangles: Vec<[Corner; 3]>,
    /// Largest number named of each kind, and its line: a face may name what comes later.
    largest: [(u32, usize); 3],
}

impl Obj {
    fn line(&mut self, number: usize, line: &str) -> Result<(), String> {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                let x = floats(words, 3)?;
                // Four numbers are homogeneous, six or more carry a colour.
                let w = if x.len() == 4 { x[3] } else { 1.0 };
                let p = DVec3::new(x[0], x[1], x[2]) / w;
                if !p.is_finite() {
                    return Err(format!("the position {p} is not finite"));
                }
                self.positions.push(p);
            }
            Some("vt") => {
                let x = floats(words, 1)?;
                self.uvs.push(DVec2::new(x[0], x.get(1).copied().unwrap_or(0.0)));
            }
            Some("vn") => {
                let x = floats(words, 3)?;
                self.normals.push(DVec3::new(x[0], x[1], x[2]));
            }
            Some("f") => {
                let words = words.take_while(|w| !w.starts_with('#'));
                let corners = words.map(|w| self.corner(number, w)).collect::<Result<Vec<_>, _>>()?;
                if corners.len() < 3 {
                    return Err(format!("{} corners do not make a face", corners.len()));
                }
                self.triangles.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]]));
            }
            _ => {}
        }
        Ok(())
    }

    /// `v`, `v/vt`, `v//vn` or `v/vt/vn`; numbers count from 1, or back from the last one read.
    fn corner(&mut self, line: usize, word: &str) -> Result<Corner, String> {
        let mut corner = [None; 3];
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for (k, part) in word.split('/').enumerate() {
            if k > 2 {
                return Err(format!("\"{word}\" is not a corner of a face"));
            }
            if part.is_empty() && k > 0 {
                continue;
            }
            let bad = || format!("\"{word}\": \"{part}\" is not the number of a {}", KINDS[k]);
            let n: i64 = part.parse().map_err(|_| bad())?;
            let index = if n > 0 { n.checked_sub(1) } else { n.checked_add(counts[k] as i64).filter(|_| n < 0) };
            let index = index.and_then(|i| u32::try_from(i).ok()).filter(|&i| i < u32::MAX).ok_or_else(bad)?;
            if index >= self.largest[k].0 {
                self.largest[k] = (index, line);
            }
            corner[k] = Some(index);
        }
        Ok(corner)
    }

    /// One vertex per distinct corner.
    fn finish(self) -> Result<TriangleMesh, String> {
        let counts = [self.positions.len(), self.uvs.len(), self.normals.len()];
        for ((index, line), (count, kind)) in self.largest.into_iter().zip(counts.into_iter().zip(KINDS)) {
            if line > 0 && index as usize >= count {
                return Err(format!("line {line}: there is no {kind} {}: the file has {count}", index + 1));
            }
        }
        let any = |k: usize| self.triangles.iter().flatten().any(|c| c[k].is_some());
        let (any_uv, any_normal) = (any(1), any(2));
        let (mut vertices, mut uvs, mut normals, mut order) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        let mut known: HashMap<(Corner, usize), u32> = HashMap::new();
        let mut faces = Vec::with_capacity(self.triangles.len());
        for (f, corners) in self.triangles.iter().enumerate() {
            let position = |c: Corner| self.positions[c[0].unwrap_or(0) as usize];
            let [a, b, c] = corners.map(position);
            let flat = (b - a).cross(c - a).normalize_or_zero();
            faces.push(corners.map(|corner| {
                // A corner that takes its face's normal belongs to that face alone.
                let owner = if any_normal && corner[2].is_none() { f } else { usize::MAX };
                *known.entry((corner, owner)).or_insert_with(|| {
                    vertices.push(position(corner));
                    order.push(corner[0].unwrap_or(0));
                    uvs.push(corner[1].map_or(DVec2::ZERO, |i| self.uvs[i as usize]));
                    normals.push(corner[2].map_or(flat, |i| self.normals[i as usize]));
                    vertices.len() as u32 - 1
                })
            }));
        }
        if u32::try_from(vertices.len()).is_err() || u32::try_from(faces.len()).is_err() {
            return Err("more vertices or triangles than 32 bits can number".into());
        }
        let (normals, uvs) = (any_normal.then_some(normals), any_uv.then_some(uvs));
        let same = order.len() == self.positions.len() && order.iter().enumerate().all(|(k, &i)| i as usize == k);
        let mut mesh = TriangleMesh::new(vertices, faces, normals, uvs)?.rounded_to_f32();
        mesh.file_order = (!same).then(|| order.into());
        Ok(mesh)
    }
}

/// All numbers of a line, at least `least`. What follows a `#` is a comment.
fn floats(words: SplitWhitespace, least: usize) -> Result<Vec<f64>, String> {
    let parse = |w: &str| w.parse::<f64>().map_err(|_| format!("\"{w}\" is not a number"));
    let x = words.take_while(|w| !w.starts_with('#')).map(parse).collect::<Result<Vec<_>, _>>()?;
    if x.len() < least { Err(format!("{} numbers where {least} are needed", x.len())) } else { Ok(x) }
}
