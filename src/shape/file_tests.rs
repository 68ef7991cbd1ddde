//! Meshes, their topology and their files. Random tests have fixed seeds.

use super::*;
use crate::math::DAffine3;
use crate::math::rng::Rng;

/// A unit cube from 0 to 1 with shared vertices, outward, twelve triangles.
fn shared_cube() -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let vertices = (0..8).map(|i| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64)).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    (vertices, quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect())
}

fn mesh(vertices: Vec<DVec3>, faces: Vec<[u32; 3]>) -> TriangleMesh {
    TriangleMesh::new(vertices, faces, None, None).unwrap()
}

/// Every face with vertices of its own, coordinates moved by `jitter`.
fn soup(mut jitter: impl FnMut(DVec3) -> DVec3) -> TriangleMesh {
    let (v, f) = shared_cube();
    let vertices: Vec<_> = f.iter().flatten().map(|&i| jitter(v[i as usize])).collect();
    mesh(vertices, (0..f.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

#[test]
fn a_shared_cube_is_closed_outward_and_of_volume_one() {
    let (v, f) = shared_cube();
    let m = mesh(v, f);
    let t = m.topology();
    assert_eq!((t.boundary_edges_stored, t.boundary_edges, t.non_manifold_edges, t.degenerate_faces), (0, 0, 0, 0));
    assert!(t.is_closed() && t.is_consistently_oriented() && t.leaks().is_none() && t.defects().is_none());
    assert!((t.signed_volume - 1.0).abs() < 1e-14 && (m.area() - 6.0).abs() < 1e-14);
    assert!(m.flip_normals().topology().leaks().unwrap().contains("inward"));
    // A mirror keeps the outside outside; far away and tiny, the volume keeps its digits.
    let to_world = DAffine3::from_translation(DVec3::splat(1e5)) * DAffine3::from_scale(DVec3::new(-2.0, 1.0, 1.0));
    assert!((m.transformed(&to_world).unwrap().topology().signed_volume - 2.0).abs() < 1e-9);
    assert!(m.transformed(&DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0))).is_err());
}

#[test]
fn soup_is_closed_by_welding() {
    let t = soup(|p| p).topology().clone();
    assert_eq!((t.boundary_edges_stored, t.boundary_edges, t.welded_vertices), (36, 0, 8));
    assert!(!t.welded_by_tolerance && t.leaks().is_none());
    // -0 is 0.
    assert!(soup(|p| DVec3::new(if p.x == 0.0 { -0.0 } else { p.x }, p.y, p.z)).is_closed());

    // Single precision apart: only the tolerance closes it, wherever the mesh is put afterwards.
    let mut r = Rng::keyed(21, 1, 0, 0);
    let mut apart = |p: DVec3| p + f64::from(f32::EPSILON) * DVec3::new(r.uniform(), r.uniform(), r.uniform());
    let m = soup(&mut apart).rounded_to_f32();
    let t = m.topology();
    assert!(t.is_closed() && t.welded_by_tolerance && t.welded_vertices == 8 && t.leaks().is_some());
    for (scale, offset) in [(1e-6, 1e5), (1e6, 0.0)] {
        let to_world = DAffine3::from_translation(DVec3::splat(offset)) * DAffine3::from_scale(DVec3::splat(scale));
        let moved = m.transformed(&to_world).unwrap();
        assert_eq!(moved.topology().welded_vertices, 8, "{scale} {offset}");
    }
    // A gap beyond rounding stays a gap; coordinates of double precision are not welded by f32's.
    assert!(!soup(|p| p + 1e-5 * r.uniform()).rounded_to_f32().is_closed());
    assert!(!soup(|p| p + 1e-7 * r.uniform()).is_closed());
}

#[test]
fn holes_flips_fins_and_slivers_are_counted() {
    let (v, f) = shared_cube();
    let open = mesh(v.clone(), f[1..].to_vec());
    assert_eq!(open.topology().boundary_edges, 3);
    assert!(!open.is_closed() && open.topology().leaks().unwrap().contains("3 open edges"));

    let mut flipped = f.clone();
    flipped[4].swap(1, 2);
    let t = mesh(v.clone(), flipped).topology().clone();
    assert!(t.is_closed() && t.inconsistent_edges == 3 && t.leaks().is_some());

    let (mut fin, mut fv) = (f.clone(), v.clone());
    fv.push(DVec3::splat(2.0));
    fin.push([0, 1, 8]);
    let t = mesh(fv, fin).topology().clone();
    assert_eq!((t.non_manifold_edges, t.boundary_edges), (1, 2));

    // A face on three points of a line, two on two points, one on one.
    let (mut flat, mut fv) = (f, v);
    fv.push(DVec3::new(0.5, 0.0, 0.0));
    fv.push(DVec3::ZERO);
    flat.extend([[0, 8, 1], [0, 0, 1], [0, 9, 1], [0, 0, 9]]);
    let m = mesh(fv, flat);
    assert_eq!(m.topology().degenerate_faces, 4);
    // They are neither hit nor drawn.
    assert!(m.resolve(12, DVec3::new(0.5, 0.0, -1.0), DVec3::Z).is_none());
    let mut r = Rng::keyed(21, 2, 0, 0);
    assert!((0..1000).all(|_| m.sample(r.uniform(), r.uniform()).face < 12));
}

#[test]
fn hits_are_solved_to_rounding() {
    let mut r = Rng::keyed(21, 3, 0, 0);
    for (scale, offset) in [(1.0, 0.0), (1e-6, 1e5), (1e6, 1e5)] {
        let to_world = DAffine3::from_translation(DVec3::splat(offset)) * DAffine3::from_scale(DVec3::splat(scale));
        let (v, f) = shared_cube();
        let m = mesh(v, f).transformed(&to_world).unwrap();
        for _ in 0..2000 {
            let x = m.sample(r.uniform(), r.uniform());
            let y = m.sample(r.uniform(), r.uniform());
            let w = y.p - x.p;
            if w.dot(y.n).abs() < 1e-3 * scale {
                continue;
            }
            let (t, b) = m.resolve(y.face, x.p, w).unwrap();
            let rounding = 1e-12 + 1e3 * f64::EPSILON * offset / scale;
            assert!((t - 1.0).abs() < rounding && (b - y.uv).length() < 10.0 * rounding);
            let hit = m.intersect(x.p, w, 0.0, f64::INFINITY, Some(Start { face: x.face }));
            assert!(w.dot(x.n) >= 0.0 || hit.is_some_and(|h| (h.t - 1.0).abs() < rounding), "{hit:?}");
        }
    }
}

#[test]
fn winding_follows_the_normals_on_request() {
    let (v, mut f) = shared_cube();
    let outward = v.iter().map(|&p| p - 0.5).collect();
    f.iter_mut().for_each(|f| f.swap(0, 1));
    let m = TriangleMesh::new(v, f, Some(outward), None).unwrap();
    assert_eq!(m.topology().faces_against_normals, 12);
    assert!(m.topology().leaks().is_some_and(|l| l.contains("12 faces wound against")));
    let m = m.wound_by_normals();
    assert!(m.topology().leaks().is_none() && m.topology().signed_volume > 0.0);
}

fn ply_header(format: &str, vertices: usize, faces: usize) -> Vec<u8> {
    format!(
        "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex {vertices}\nproperty float x\n\
         property uchar red\nproperty double y\nproperty float z\nproperty float nx\nproperty float ny\n\
         property float nz\nproperty float s\nproperty float t\nelement face {faces}\nproperty short flags\n\
         property list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes()
}

/// Two faces, a triangle and a pentagon, with everything that a reader has to skip or keep.
fn ply(format: &str) -> Vec<u8> {
    let mut out = ply_header(format, 6, 2);
    let big = format.contains("big");
    macro_rules! put {
        ($x:expr) => {
            if format == "ascii" {
                out.extend(format!("{} ", $x).bytes())
            } else if big {
                out.extend($x.to_be_bytes())
            } else {
                out.extend($x.to_le_bytes())
            }
        };
    }
    for i in 0..6 {
        let a = i as f64;
        put!(a.cos() as f32);
        put!(200u8);
        put!(a.sin());
        for x in [0.25 * a as f32, 0.0, 0.0, 1.0, 0.1 * a as f32, 0.5] {
            put!(x);
        }
    }
    for face in [&[0i32, 1, 2][..], &[1, 2, 3, 4, 5]] {
        put!(-7i16);
        put!(face.len() as u8);
        for &i in face {
            put!(i);
        }
    }
    out
}

const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

#[test]
fn ply_is_read_in_all_encodings() {
    for format in FORMATS {
        let m = ply::read(&ply(format)).unwrap();
        assert_eq!(&*m.faces, [[0, 1, 2], [1, 2, 3], [1, 3, 4], [1, 4, 5]]);
        assert_eq!(m.vertices.len(), 6);
        for (i, p) in m.vertices.iter().enumerate() {
            let a = i as f64;
            assert!((*p - DVec3::new(a.cos(), a.sin(), 0.25 * a)).length() < 1e-7);
        }
        assert_eq!(m.normals.as_ref().unwrap()[3], DVec3::Z);
        assert!((m.uvs.as_ref().unwrap()[3] - DVec2::new(0.3, 0.5)).length() < 1e-7);
        assert_eq!(m.shading_normal(0, DVec2::splat(0.3)), Some(DVec3::Z));
    }
}

#[test]
fn bad_ply_files_say_what_and_where() {
    let fails = |text: &str, with: &str| {
        let e = ply::read(text.as_bytes()).unwrap_err();
        assert!(e.contains(with), "{e:?} lacks {with:?}");
    };
    let file = |vertices: &str, faces: &str, nv: usize, nf: usize| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex {nv}\nproperty float x\nproperty float y\nproperty float z\n\
             element face {nf}\nproperty list uchar int vertex_index\nend_header\n{vertices}{faces}"
        )
    };
    let v = "0 0 0\n1 0 0\n0 1 0\n";
    assert!(ply::read(file(v, "3 0 1 2\n", 3, 1).as_bytes()).is_ok());
    fails("", "header");
    fails("solid cube\n", "not a PLY");
    fails(&file(v, "3 0 1 3\n", 3, 1), "exceeds the 3 vertices");
    fails(&file(v, "3 0 1 -1\n", 3, 1), "face 0");
    fails(&file(v, "2 0 1\n", 3, 1), "2 corners");
    fails(&file(v, "", 3, 1), "cut");
    fails(&file(v, "3 0 1", 3, 1), "cut");
    fails(&file(v, "", 3, 0), "empty");
    fails(&file("0 0 nan\n1 0 0\n0 1 0\n", "3 0 1 2\n", 3, 1), "line 0 after the header");
    fails(&file("0 0 x\n1 0 0\n0 1 0\n", "3 0 1 2\n", 3, 1), "\"x\" is not a number");
    fails(&file(v, "3 0 1 2\n", 3, 1).replace("vertex 3", "vertex 99999999999999999"), "promises");
    fails(&file(v, "3 0 1 2\n", 3, 1).replace("vertex 3", "vertex 99999999999999999999"), "out of range");
    fails(&file(v, "3 0 1 2\n", 3, 1).replace("float y", "float x"), "same name");
    fails(&file(v, "3 0 1 2\n", 3, 1).replace("end_header\n", ""), "no end");
    let whole = ply("binary_little_endian");
    let e = ply::read(&whole[..whole.len() - 1]).unwrap_err();
    assert!(e.contains("face 1") && e.contains("cut"), "{e}");
}

const OBJ: &str = "# comment\nmtllib none.mtl\no first\nv 0 0 0\nv 1 0 0 # right\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 1\nvn 0 0 1\n\
    usemtl a\nf 1/1/1 2/2/1 3/1/1 4/2/1\ng second\nv 0 0 1\nv 1 0 1\nv 0 1 1\nf -3/1/-1 -2/2/-1 -1/1/-1\n\
    l 1 2 3\ns off\nf 1/1/1 \\\n 2/2/1 5/1/1\n";

#[test]
fn obj_groups_are_merged_and_corners_kept() {
    let m = obj::read(OBJ.as_bytes()).unwrap();
    assert_eq!(m.faces.len(), 4);
    assert_eq!(m.vertices.len(), 7);
    assert_eq!(m.corners(1), [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::Y]);
    assert_eq!(m.corners(2), [DVec3::Z, DVec3::new(1.0, 0.0, 1.0), DVec3::new(0.0, 1.0, 1.0)]);
    assert_eq!(m.texture_uv(0, DVec2::new(1.0, 0.0)), DVec2::ONE);

    // One corner without a normal takes its face's, alone.
    let mixed =
        obj::read("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvn 1 0 0\nf 1//1 2//1 3//1\nf 1 4 2\n".as_bytes()).unwrap();
    assert_eq!(mixed.shading_normal(0, DVec2::splat(0.3)), Some(DVec3::X));
    assert!((mixed.shading_normal(1, DVec2::splat(0.3)).unwrap() - DVec3::Y).length() < 1e-15);
}

/// The parser of another hand agrees where it can read.
#[test]
fn obj_agrees_with_tobj() {
    let text = OBJ.replace("\\\n", "").replace("l 1 2 3\n", "").replace(" # right", "");
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ..Default::default() };
    let (models, _) = tobj::load_obj_buf(&mut text.as_bytes(), &options, |_| Ok(Default::default())).unwrap();
    let theirs: Vec<DVec3> = models
        .iter()
        .flat_map(|m| m.mesh.indices.iter().map(|&i| 3 * i as usize).map(|i| &m.mesh.positions[i..i + 3]))
        .map(|p| DVec3::new(p[0].into(), p[1].into(), p[2].into()))
        .collect();
    let m = obj::read(text.as_bytes()).unwrap();
    let ours: Vec<DVec3> = m.faces.iter().flatten().map(|&i| m.vertices[i as usize]).collect();
    assert_eq!(ours, theirs);
}

#[test]
fn bad_obj_files_say_what_and_where() {
    let v = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    for (text, with) in [
        (format!("{v}f 1 2 4\n"), "line 4: there is no position 4"),
        (format!("{v}f 1 2 0\n"), "line 4"),
        (format!("{v}f 1 2 -4\n"), "line 4"),
        (format!("{v}f 1/1 2/1 3/1\n"), "texture coordinate 1"),
        (format!("{v}f 1 2 9223372036854775807\n"), "line 4"),
        (format!("{v}f 1 2 -9223372036854775808\n"), "line 4"),
        (format!("{v}f 1 2\n"), "2 corners"),
        (format!("{v}f 1/1/1/1 2 3\n"), "line 4"),
        ("v 0 0\n".into(), "line 1: 2 numbers"),
        ("v 0 0 inf\n".into(), "line 1"),
        ("v 0 0 a\n".into(), "\"a\" is not a number"),
        (v.into(), "empty"),
        (format!("{v}f 1 2 \\"), "cut"),
    ] {
        let e = obj::read(text.as_bytes()).unwrap_err();
        assert!(e.contains(with), "{e:?} lacks {with:?}");
    }
}

/// Cut and garbled files are read or refused, and never panic; what is read is a valid mesh.
#[test]
fn garbled_files_never_panic() {
    let mut r = Rng::keyed(21, 4, 0, 0);
    let mut read = 0;
    let mut files: Vec<Vec<u8>> = FORMATS.iter().map(|f| ply(f)).collect();
    files.push(OBJ.into());
    for i in 0..40_000 {
        let is_obj = i % 4 == 3;
        let mut bytes = files[i % 4].clone();
        let mut below = |n: usize| (r.uniform() * n as f64) as usize;
        for _ in 0..1 + below(4) {
            let at = below(bytes.len());
            match below(6) {
                0 => bytes.truncate(at + 1),
                1 => bytes[at] ^= 1 << below(8),
                2 => bytes[at] = b"0123456789-.e \n/\xff"[below(17)],
                3 => drop(bytes.remove(at)),
                4 => bytes.insert(at, bytes[below(bytes.len())]),
                _ => {
                    let digits = (0..20).map(|_| b'9');
                    let _ = bytes.splice(at..at, digits);
                }
            }
            if bytes.is_empty() {
                bytes.push(b'p');
            }
        }
        if let Ok(m) = if is_obj { obj::read(&bytes) } else { ply::read(&bytes) } {
            read += 1;
            assert!(m.vertices.iter().all(|p| p.is_finite()) && m.area().is_finite() || m.rounding > 1e100);
            let _ = m.topology().leaks();
        }
    }
    assert!(read > 4000, "{read}");
}
