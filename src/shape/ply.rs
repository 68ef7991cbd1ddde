//! PLY files, ASCII and binary of both byte orders.
//!
//! The header is the crate's to parse. The elements are read here, because the crate allocates what a corrupt header
//! promises: every count is checked against the bytes that are left, so a cut or garbled file is an error and never a
//! panic or a huge allocation.

use super::TriangleMesh;
use crate::math::{DVec2, DVec3};
use ply_rs_bw::parser::Parser;
use ply_rs_bw::ply::{DefaultElement, ElementDef, Encoding, Header, PropertyType, ScalarType};
use std::path::Path;

/// Read a mesh from the file. The error says what is wrong and where in the file; the caller knows the file.
pub fn load(path: &Path) -> Result<TriangleMesh, String> {
    read(&std::fs::read(path).map_err(|e| format!("cannot be read: {e}"))?)
}

/// Read a mesh from the bytes of a file: `vertex` with x y z [nx ny nz] [u v | s t], `face` with `vertex_indices` or
/// `vertex_index`, polygons cut as fans. Other elements and properties are skipped.
pub fn read(bytes: &[u8]) -> Result<TriangleMesh, String> {
    let (header, body) = header(bytes)?;
    let mut data = Data { bytes: &bytes[body..], at: 0, start: body, encoding: header.encoding };
    let (mut vertices, mut faces) = (None, None);
    for element in header.elements.values() {
        data.check_count(element)?;
        match element.name.as_str() {
            "vertex" => vertices = Some(read_vertices(&mut data, element)?),
            "face" => faces = Some(read_faces(&mut data, element)?),
            _ if vertices.is_some() && faces.is_some() => break,
            name => {
                for i in 0..element.count {
                    data.element(element, i, |_, _| ()).map_err(|e| format!("{name} {i}: {e}"))?;
                }
            }
        }
    }
    let vertices = vertices.ok_or("there is no element \"vertex\"")?;
    let faces = faces.ok_or("there is no element \"face\": a point cloud is not a surface")?;
    Ok(TriangleMesh::new(vertices.positions, faces, vertices.normals, vertices.uvs)?.rounded_to_f32())
}

/// Parse the header; the body starts at the returned offset.
fn header(bytes: &[u8]) -> Result<(Header, usize), String> {
    // Find the header's end first: the parser shall see text only.
    let mut body = 0;
    let mut elements = 0;
    let mut properties = 0;
    for (i, line) in bytes.split_inclusive(|&b| b == b'\n').enumerate() {
        body += line.len();
        let line = line.trim_ascii_end();
        if i == 0 && line != b"ply" {
            return Err("line 1: not a PLY file: the first line is not \"ply\"".into());
        }
        if line == b"end_header" {
            return parse_header(&bytes[..body], elements, properties).map(|h| (h, body));
        }
        // The parser panics on a number beyond u64, and merges elements or properties of one name.
        let words: Vec<_> = line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty()).collect();
        match words.first() {
            Some(&b"element") => elements += 1,
            Some(&b"property") => properties += 1,
            _ => {}
        }
        if words.first().is_some_and(|w| *w == b"element" || *w == b"format")
            && words.iter().any(|w| w.split(|b| !b.is_ascii_digit()).any(|digits| digits.len() > 18))
        {
            return Err(format!("line {}: a number in the header is out of range", i + 1));
        }
        if line.len() > 100_000 {
            return Err(format!("line {}: the header line is too long", i + 1));
        }
    }
    Err("the header has no end (\"end_header\"): the file is cut or is not a PLY file".into())
}

fn parse_header(text: &[u8], elements: usize, properties: usize) -> Result<Header, String> {
    let text = String::from_utf8_lossy(text);
    let header = Parser::<DefaultElement>::new()
        .read_header(&mut text.as_bytes())
        .map_err(|e| format!("header: {}", e.to_string().replace("\n\t", " ").replace('\n', " ")))?;
    if header.elements.len() != elements
        || header.elements.values().map(|e| e.properties.len()).sum::<usize>() != properties
    {
        return Err("header: two elements, or two properties of one element, have the same name".into());
    }
    Ok(header)
}

struct Vertices {
    positions: Vec<DVec3>,
    normals: Option<Vec<DVec3>>,
    uvs: Option<Vec<DVec2>>,
}

fn read_vertices(data: &mut Data, element: &ElementDef) -> Result<Vertices, String> {
    let find = |name: &str| element.properties.keys().position(|k| k == name);
    let all = |names: &[&str]| names.iter().map(|n| find(n)).collect::<Option<Vec<_>>>();
    let xyz = all(&["x", "y", "z"]).ok_or("header: the element \"vertex\" lacks x, y or z")?;
    let nxyz = all(&["nx", "ny", "nz"]);
    let uv = all(&["u", "v"]).or_else(|| all(&["s", "t"])).or_else(|| all(&["texture_u", "texture_v"]));
    let mut v = Vertices {
        positions: Vec::with_capacity(element.count),
        normals: nxyz.is_some().then(|| Vec::with_capacity(element.count)),
        uvs: uv.is_some().then(|| Vec::with_capacity(element.count)),
    };
    let mut values = vec![f64::NAN; element.properties.len()];
    for i in 0..element.count {
        data.element(element, i, |k, x| values[k] = x)?;
        let vec3 = |k: &[usize]| DVec3::new(values[k[0]], values[k[1]], values[k[2]]);
        let p = vec3(&xyz);
        if !p.is_finite() {
            return Err(format!("vertex {i}, {}: the position {p} is not finite", data.place()));
        }
        v.positions.push(p);
        if let (Some(n), Some(k)) = (&mut v.normals, &nxyz) {
            n.push(vec3(k));
        }
        if let (Some(uvs), Some(k)) = (&mut v.uvs, &uv) {
            uvs.push(DVec2::new(values[k[0]], values[k[1]]));
        }
    }
    Ok(v)
}

fn read_faces(data: &mut Data, element: &ElementDef) -> Result<Vec<[u32; 3]>, String> {
    let list = element
        .properties
        .keys()
        .position(|k| k == "vertex_indices" || k == "vertex_index")
        .filter(|&k| matches!(element.properties.values().nth(k).map(|p| &p.data_type), Some(PropertyType::List(..))))
        .ok_or("header: the element \"face\" lacks the list vertex_indices (or vertex_index)")?;
    let mut faces = Vec::with_capacity(element.count);
    let mut corners: Vec<f64> = Vec::new();
    for i in 0..element.count {
        corners.clear();
        data.element(element, i, |k, x| {
            if k == list {
                corners.push(x);
            }
        })?;
        if corners.len() < 3 {
            return Err(format!("face {i}, {}: {} corners do not make a face", data.place(), corners.len()));
        }
        if let Some(x) = corners.iter().find(|&&x| !(x >= 0.0 && x < f64::from(u32::MAX) && x.fract() == 0.0)) {
            return Err(format!("face {i}, {}: {x} is not a vertex index", data.place()));
        }
        faces.extend((2..corners.len()).map(|k| [corners[0], corners[k - 1], corners[k]].map(|x| x as u32)));
    }
    if faces.len() > u32::MAX as usize {
        return Err(format!("{} triangles are more than 32 bits can number", faces.len()));
    }
    Ok(faces)
}

/// The body of the file and where reading stands.
struct Data<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Offset of the body in the file.
    start: usize,
    encoding: Encoding,
}

fn size(t: &ScalarType) -> usize {
    match t {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    }
}

impl<'a> Data<'a> {
    /// Where an error was met, for the reader of a message.
    fn place(&self) -> String {
        match self.encoding {
            Encoding::Ascii => {
                let line = self.bytes[..self.at].iter().filter(|&&b| b == b'\n').count();
                format!("line {line} after the header")
            }
            _ => format!("byte {}", self.start + self.at),
        }
    }

    /// Can the bytes that are left hold so many elements?
    fn check_count(&self, element: &ElementDef) -> Result<(), String> {
        let least: usize = element
            .properties
            .values()
            .map(|p| match (&self.encoding, &p.data_type) {
                (Encoding::Ascii, _) => 1,
                (_, PropertyType::Scalar(t) | PropertyType::List(t, _)) => size(t),
            })
            .sum();
        let left = self.bytes.len() - self.at;
        if element.count > left / least.max(1) {
            return Err(format!(
                "the header promises {} elements \"{}\", but only {left} bytes are left: the file is cut or corrupt",
                element.count, element.name
            ));
        }
        Ok(())
    }

    /// Read one element: `visit(property index, value)` for every scalar and every member of a list.
    fn element(&mut self, def: &ElementDef, index: usize, mut visit: impl FnMut(usize, f64)) -> Result<(), String> {
        for (k, property) in def.properties.values().enumerate() {
            let read = |this: &mut Self, t: &ScalarType| {
                this.scalar(t).map_err(|e| format!("{} {index}, {}: {}: {e}", def.name, this.place(), property.name))
            };
            match &property.data_type {
                PropertyType::Scalar(t) => visit(k, read(self, t)?),
                PropertyType::List(length, t) => {
                    let n = read(self, length)?;
                    if !(n >= 0.0 && n.fract() == 0.0 && n <= (self.bytes.len() - self.at) as f64) {
                        let place = self.place();
                        return Err(format!("{} {index}, {place}: {n} is not a length of a list", def.name));
                    }
                    for _ in 0..n as usize {
                        visit(k, read(self, t)?);
                    }
                }
            }
        }
        Ok(())
    }

    fn scalar(&mut self, t: &ScalarType) -> Result<f64, String> {
        if self.encoding == Encoding::Ascii {
            return self.token();
        }
        let big = self.encoding == Encoding::BinaryBigEndian;
        macro_rules! number {
            ($t:ty) => {{
                let raw = *self.bytes[self.at..].first_chunk().ok_or("the file ends here: it is cut")?;
                self.at += raw.len();
                f64::from(if big { <$t>::from_be_bytes(raw) } else { <$t>::from_le_bytes(raw) })
            }};
        }
        Ok(match t {
            ScalarType::Char => number!(i8),
            ScalarType::UChar => number!(u8),
            ScalarType::Short => number!(i16),
            ScalarType::UShort => number!(u16),
            ScalarType::Int => number!(i32),
            ScalarType::UInt => number!(u32),
            ScalarType::Float => number!(f32),
            ScalarType::Double => number!(f64),
        })
    }

    fn token(&mut self) -> Result<f64, String> {
        let rest = &self.bytes[self.at..];
        let blank = rest.iter().take_while(|b| b.is_ascii_whitespace()).count();
        let word = &rest[blank..];
        let word = &word[..word.iter().take_while(|b| !b.is_ascii_whitespace()).count()];
        self.at += blank + word.len();
        if word.is_empty() {
            return Err("the file ends here: it is cut".into());
        }
        let text = String::from_utf8_lossy(&word[..word.len().min(40)]);
        text.parse().map_err(|_| format!("\"{text}\" is not a number"))
    }
}
