//! Nearest points of shapes against what makes a point the nearest: no sample is nearer, and of a convex face no point lies beyond
//! the plane through the nearest one across the line to it.

use super::tests::{affine, all_shapes, direction, point, rng, similarity};
use super::*;
use crate::math::rng::Rng;
use crate::math::{DAffine3, DMat3};

/// Shapes under a map each, with the size of what is around them.
fn placed(r: &mut Rng) -> Vec<(Shape, f64)> {
    let mut out = Vec::new();
    for _ in 0..10 {
        let (m, similar) = (affine(r), similarity(r, 0.5, 2.0));
        out.extend(all_shapes(m, similar).into_iter().map(|s| (s, 1.0)));
    }
    for (scale, offset) in [(1e-3, 1e5), (1e-6, 0.0), (1e6, 0.0)] {
        let m = similarity(r, scale, offset);
        out.extend(all_shapes(m, m).into_iter().map(|s| (s, scale)));
    }
    out
}

/// Rounding of coordinates around a shape.
fn rounding(s: &Shape, size: f64) -> f64 {
    64.0 * f64::EPSILON * (s.bounds().magnitude() + size)
}

/// Somewhere around a shape or on it, within it where it has an inside.
fn around(r: &mut Rng, s: &Shape, size: f64) -> DVec3 {
    match (4.0 * r.uniform()) as u32 {
        0 => s.sample(r.uniform(), r.uniform()).p,
        1 => s.sample(r.uniform(), r.uniform()).p + direction(r) * (size * 1e-6 * r.uniform()),
        2 => s.bounds().center() + point(r, size),
        _ => s.bounds().center() + point(r, 20.0 * size),
    }
}

/// A point of the face, from the inverse of the surface coordinates clamped to their range.
fn put_on(s: &Shape, face: u32, q: DVec3) -> DVec3 {
    let mut uv = s.uv(face, q).clamp(DVec2::ZERO, DVec2::ONE);
    if matches!(s, Shape::Mesh(_)) {
        uv /= (uv.x + uv.y).max(1.0);
    }
    s.position(face, uv)
}

#[test]
fn the_nearest_point_is_on_the_shape_and_no_sample_is_nearer() {
    let mut r = rng(30);
    for (s, size) in placed(&mut r) {
        let rounding = rounding(&s, size);
        let samples: Vec<DVec3> = (0..2000).map(|_| s.sample(r.uniform(), r.uniform()).p).collect();
        for _ in 0..100 {
            let p = around(&mut r, &s, size);
            let (q, face) = s.nearest(p);
            assert!(face < s.face_count() && (put_on(&s, face, q) - q).length() <= rounding, "{s:?} {p} {q}");
            let least = samples.iter().map(|x| x.distance(p)).fold(f64::INFINITY, f64::min);
            assert!(q.distance(p) <= least + rounding, "{s:?} {p} {q} {least}");
        }
    }
}

#[test]
fn nothing_of_a_convex_face_lies_beyond_its_nearest_point() {
    let mut r = rng(31);
    for (s, size) in placed(&mut r).into_iter().filter(|(s, _)| !matches!(s, Shape::Sphere(_) | Shape::Cylinder(_))) {
        let rounding = rounding(&s, size);
        for _ in 0..50 {
            let p = around(&mut r, &s, size);
            for face in 0..s.face_count() {
                let q = s.nearest_on_face(face, p);
                // Rounding of q turns the line, the more the nearer p is; a q that rounding cannot tell from the nearest turns it too.
                let slack = 8.0 * rounding * (1.0 + size / p.distance(q)) + 3e-8 * size;
                let across = (p - q).normalize_or_zero();
                for k in 0..40 {
                    // Corners first.
                    let uv = if k < 4 {
                        DVec2::new(f64::from(k % 2), f64::from(k / 2))
                    } else {
                        DVec2::new(r.uniform(), r.uniform())
                    };
                    let uv = if matches!(s, Shape::Mesh(_)) { uv / (uv.x + uv.y).max(1.0) } else { uv };
                    let beyond = across.dot(s.position(face, uv) - q);
                    assert!(beyond <= slack, "{s:?} {face} {p} {q} {beyond} {slack}");
                }
            }
        }
    }
}

#[test]
fn distances_grow_no_faster_than_one_and_along_the_line_from_the_nearest_point() {
    let mut r = rng(32);
    let mut slopes = 0;
    for (s, size) in placed(&mut r) {
        let rounding = rounding(&s, size);
        let distance = |p: DVec3| s.nearest(p).0.distance(p);
        for _ in 0..200 {
            let (a, b) = (around(&mut r, &s, size), around(&mut r, &s, size));
            assert!((distance(a) - distance(b)).abs() <= a.distance(b) + 2.0 * rounding, "{s:?} {a} {b}");
            let (q, w) = (s.nearest(a).0, direction(&mut r));
            let step = 1e-4 * size;
            let (before, after) = (s.nearest(a - w * step).0, s.nearest(a + w * step).0);
            // Not at the surface itself, nor where the nearest point leaps.
            if q.distance(a) > 0.1 * size && before.distance(after) < 10.0 * step {
                let slope = (distance(a + w * step) - distance(a - w * step)) / (2.0 * step);
                assert!((slope - w.dot((a - q).normalize())).abs() <= 1e-3 + rounding / step, "{s:?} {a} {slope}");
                slopes += 1;
            }
        }
    }
    assert!(slopes > 3000, "{slopes}");
}

#[test]
fn spheres_from_inside_outside_and_their_centre() {
    let s = Sphere::new(DVec3::new(1.0, 2.0, 3.0), 2.0, DAffine3::IDENTITY, true).unwrap();
    let near = |x: f64| s.nearest(s.center + DVec3::Y * x).0 - s.center;
    assert_eq!([near(5.0), near(0.5), near(-0.5_f64.powi(30))], [DVec3::Y * 2.0, DVec3::Y * 2.0, DVec3::Y * -2.0]);
    assert_eq!(near(0.0).length(), 2.0);
}

#[test]
fn cylinders_from_inside_outside_beyond_a_rim_and_their_axis() {
    let s = Cylinder::new(DAffine3::from_scale(DVec3::new(2.0, 2.0, 3.0)), true).unwrap();
    let near = |x: f64, z: f64| s.nearest(DVec3::new(0.0, x, z)).0;
    let is = |p: DVec3, y: f64, z: f64| p.distance(DVec3::new(0.0, y, z)) < 1e-14;
    assert!(is(near(5.0, 1.0), 2.0, 1.0) && is(near(-0.5, 1.0), -2.0, 1.0));
    assert!(is(near(0.5, 7.0), 2.0, 3.0) && is(near(4.0, -1.0), 2.0, 0.0));
    assert!((near(0.0, 1.0).truncate().length() - 2.0).abs() < 1e-14);
}

#[test]
fn a_sheared_box_from_inside_has_its_nearest_face() {
    // x' = x + 3 y: the slanted faces are nearer to the middle than the upright distance to them says.
    let m = DAffine3::from_mat3(DMat3::from_cols(DVec3::X, DVec3::new(3.0, 1.0, 0.0), DVec3::Z * 5.0));
    let c = Cube::new(m, false).unwrap();
    let (q, face) = c.nearest(DVec3::ZERO);
    assert!((q.length() - 0.1_f64.sqrt()).abs() < 1e-15 && face < 2, "{q} {face}");
    let (q, face) = c.nearest(DVec3::new(2.4, 0.9, 0.0));
    assert!((q - DVec3::new(2.4, 1.0, 0.0)).length() < 1e-15 && face == 3, "{q} {face}");
}

/// At the rim of an ellipse the line to the nearest point is across the rim, however long the ellipse.
#[test]
fn long_ellipses_are_met_at_right_angles() {
    let mut r = rng(33);
    for ratio in [1.0, 0.5, 1e-2, 1e-4] {
        for _ in 0..1000 {
            let shear = DMat3::from_cols(DVec3::X, DVec3::new(r.uniform(), ratio, 0.0), DVec3::new(0.3, 0.2, 1.0));
            let turn = similarity(&mut r, 1.0, 0.0).matrix3;
            let d = Disk::new(DAffine3::from_mat3(turn * shear), false).unwrap();
            let size = [1.0, 3.0, 1e3][(3.0 * r.uniform()) as usize];
            let p = point(&mut r, size);
            let q = d.nearest(p).0;
            let uv = d.uv(0, q);
            assert!(uv.x <= 1.0 + 1e-12 / ratio, "{uv}");
            if uv.x > 1.0 - 1e-9 {
                let (s, c) = (std::f64::consts::TAU * uv.y).sin_cos();
                let along = d.placement.vector(DVec3::new(-s, c, 0.0)).normalize();
                assert!(along.dot((p - q).normalize()).abs() < 1e-9 / ratio, "{ratio} {p} {q}");
            }
        }
    }
}

#[test]
fn faces_without_area_are_what_is_left_of_them() {
    let (a, b) = (DVec3::new(1.0, 1.0, 0.0), DVec3::new(3.0, 1.0, 0.0));
    let middle = (a + b) * 0.5;
    let vertices = vec![a, b, middle];
    let faces = vec![[0, 0, 0], [1, 1, 0], [2, 0, 1], [0, 1, 2], [1, 2, 2]];
    let m = TriangleMesh::new(vertices, faces, None, None).unwrap();
    let p = DVec3::new(1.5, 4.0, 2.0);
    let near: Vec<f64> = (0..5).map(|f| m.nearest_on_face(f, p).x).collect();
    assert_eq!(near, [1.0, 1.5, 1.5, 1.5, 2.0]);
    assert_eq!(m.nearest(p), (DVec3::new(1.5, 1.0, 0.0), 1));
    // Needles of any width: a point of the triangle, nearest by its corners.
    let mut r = rng(34);
    for k in 0..20_000 {
        let (o, size) = [(0.0, 1.0), (1e5, 1e-3)][k % 2];
        let corner = DVec3::splat(o) + point(&mut r, size);
        let (e, w) = (direction(&mut r) * size, direction(&mut r));
        let corners = [corner, corner + e, corner + e * r.uniform() + w * (size * 0.1_f64.powi(k as i32 / 2 % 20))];
        let m = TriangleMesh::new(corners.to_vec(), vec![[0, 1, 2]], None, None).unwrap();
        let p = corner + point(&mut r, 3.0 * size);
        let q = m.nearest(p).0;
        let beyond = corners.map(|c| (p - q).normalize_or_zero().dot(c - q));
        assert!(beyond.iter().all(|&b| b <= 1e-7 * size), "{corners:?} {p} {q} {beyond:?}");
    }
}
