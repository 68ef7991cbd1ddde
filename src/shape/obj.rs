//! Wavefront OBJ files: all objects and groups merged, polygons cut into triangles.

use super::{Geometry, TriangleMesh};
use crate::math::{DVec2, DVec3};
use std::collections::HashMap;
use std::io::{BufRead, Read};
use std::path::Path;

/// Read a mesh from the file. The error says what is wrong and where in the file; the caller knows the file.
pub fn load(path: &Path) -> Result<TriangleMesh, String> {
    read(&std::fs::read(path).map_err(|e| format!("cannot be read: {e}"))?)
}

/// Read a mesh from the bytes of a file. A corner is one vertex per (position, uv, normal). Where only some corners
/// have a normal, the others get their face's; where only some have texture coordinates, the others get (0, 0).
pub fn read(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let text = String::from_utf8_lossy(bytes);
    check_indices(&text)?;
    let mut lines = CountedLines { rest: text.as_bytes(), line: 0 };
    let options = tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    let parsed = tobj::load_obj_buf(&mut lines, &options, |_| Ok(Default::default()));
    let (models, _) = parsed.map_err(|e| format!("line {}: {e}", lines.line))?;
    merge(models.into_iter().map(|m| m.mesh))
}

/// Lines handed out so far, for the place of an error.
struct CountedLines<'a> {
    rest: &'a [u8],
    line: usize,
}

impl Read for CountedLines<'_> {
    fn read(&mut self, buf: &mut [u8]) -> std::io::Result<usize> {
        self.rest.read(buf)
    }
}

impl BufRead for CountedLines<'_> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        // One line at a time, so that consumption tells the line.
        let n = self.rest.iter().position(|&b| b == b'\n').map_or(self.rest.len(), |i| i + 1);
        Ok(&self.rest[..n])
    }
    fn consume(&mut self, n: usize) {
        self.line += usize::from(n > 0);
        self.rest = &self.rest[n..];
    }
}

/// Every index of every face must name something: the parser tells no line for one that does not.
fn check_indices(text: &str) -> Result<(), String> {
    const NAMES: [&str; 3] = ["position", "texture coordinate", "normal"];
    let mut counts = [0i64; 3];
    // Largest index of each kind and its line: the file may name what only comes later.
    let mut largest = [(0i64, 0usize); 3];
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => counts[0] += 1,
            Some("vt") => counts[1] += 1,
            Some("vn") => counts[2] += 1,
            Some("f") => {
                for (k, part) in words.flat_map(|w| w.split('/').enumerate()).filter(|(_, part)| !part.is_empty()) {
                    let bad = || format!("line {}: \"{part}\" is not an index of a {}", i + 1, NAMES[k.min(2)]);
                    let n: i64 = part.parse().map_err(|_| bad())?;
                    if k > 2 || n == 0 || n < -counts[k] {
                        return Err(bad());
                    }
                    if n > largest[k].0 {
                        largest[k] = (n, i + 1);
                    }
                }
            }
            _ => {}
        }
    }
    for k in 0..3 {
        let (n, line) = largest[k];
        if n > counts[k] {
            return Err(format!("line {line}: there is no {} {n}: the file has {}", NAMES[k], counts[k]));
        }
    }
    Ok(())
}

fn vec3<T: Copy + Into<f64>>(a: &[T], i: u32) -> Option<DVec3> {
    let a = a.get(3 * i as usize..3 * i as usize + 3)?;
    Some(DVec3::new(a[0].into(), a[1].into(), a[2].into()))
}

fn vec2<T: Copy + Into<f64>>(a: &[T], i: u32) -> Option<DVec2> {
    let a = a.get(2 * i as usize..2 * i as usize + 2)?;
    Some(DVec2::new(a[0].into(), a[1].into()))
}

/// One mesh of all.
fn merge(meshes: impl Iterator<Item = tobj::Mesh>) -> Result<TriangleMesh, String> {
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    let (mut uvs, mut normals): (Vec<Option<DVec2>>, Vec<Option<DVec3>>) = Default::default();
    for m in meshes {
        let mut known: HashMap<[u32; 3], u32> = HashMap::new();
        for (f, corners) in m.indices.chunks_exact(3).enumerate() {
            let mut face = [0u32; 3];
            for (c, &position) in corners.iter().enumerate() {
                let i = 3 * f + c;
                let uv = m.texcoord_indices.get(i).copied().unwrap_or(u32::MAX);
                let normal = m.normal_indices.get(i).copied().unwrap_or(u32::MAX);
                face[c] = match known.get(&[position, uv, normal]) {
                    Some(&v) => v,
                    None => {
                        let p = vec3(&m.positions, position).ok_or("a face names a position that is not there")?;
                        let v = u32::try_from(vertices.len()).map_err(|_| "more vertices than 32 bits can number")?;
                        vertices.push(p);
                        uvs.push(vec2(&m.texcoords, uv));
                        normals.push(vec3(&m.normals, normal));
                        known.insert([position, uv, normal], v);
                        v
                    }
                };
            }
            faces.push(face);
        }
    }
    let uvs = uvs.iter().any(Option::is_some).then(|| uvs.iter().map(|uv| uv.unwrap_or_default()).collect());
    complete_normals(vertices, faces, normals, uvs)
}

/// Give corners without a normal their face's, if others have one: a vertex of its own for each.
fn complete_normals(
    mut vertices: Vec<DVec3>,
    mut faces: Vec<[u32; 3]>,
    mut normals: Vec<Option<DVec3>>,
    mut uvs: Option<Vec<DVec2>>,
) -> Result<TriangleMesh, String> {
    if normals.iter().all(Option::is_none) {
        return Ok(TriangleMesh::new(vertices, faces, None, uvs)?.rounded_to_f32());
    }
    let flat = TriangleMesh::new(vertices.clone(), faces.clone(), None, None)?;
    for f in 0..faces.len() {
        for c in 0..3 {
            let v = faces[f][c] as usize;
            // Original vertices only: what was added below has its normal.
            if normals[v].is_none() {
                faces[f][c] = vertices.len() as u32;
                vertices.push(vertices[v]);
                normals.push(Some(flat.normal(f as u32, vertices[v])).filter(|n| n.is_finite()).or(Some(DVec3::ZERO)));
                if let Some(uvs) = &mut uvs {
                    uvs.push(uvs[v]);
                }
            }
        }
    }
    let normals = normals.into_iter().map(Option::unwrap_or_default).collect();
    Ok(TriangleMesh::new(vertices, faces, Some(normals), uvs)?.rounded_to_f32())
}
