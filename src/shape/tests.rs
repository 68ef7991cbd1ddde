//! Analytic shapes against independent truth. Statistical tests have fixed seeds; their false-alarm rate is stated.

use super::*;
use crate::math::rng::Rng;
use crate::math::stats::Moments;
use crate::math::{DAffine3, DMat3, warp};
use std::f64::consts::{PI, TAU};

pub(super) fn rng(test: u64) -> Rng {
    Rng::keyed(20, 1, test, 0)
}

pub(super) fn point(r: &mut Rng, size: f64) -> DVec3 {
    DVec3::from_array(std::array::from_fn(|_| size * (2.0 * r.uniform() - 1.0)))
}

pub(super) fn direction(r: &mut Rng) -> DVec3 {
    warp::sphere(r.uniform(), r.uniform())
}

/// A rotation, a uniform scale, a position.
pub(super) fn similarity(r: &mut Rng, scale: f64, offset: f64) -> DAffine3 {
    let (z, a) = (direction(r), direction(r));
    let x = a.cross(z).normalize();
    DAffine3::from_mat3_translation(DMat3::from_cols(x, z.cross(x), z) * scale, DVec3::new(offset, -offset, offset))
}

/// A shear and a stretch too, mirrored half of the time.
pub(super) fn affine(r: &mut Rng) -> DAffine3 {
    let mut m = DMat3::from_cols(point(r, 1.0), point(r, 1.0), point(r, 1.0));
    while m.determinant().abs() < 0.1 {
        m = DMat3::from_cols(point(r, 1.0), point(r, 1.0), point(r, 1.0));
    }
    DAffine3::from_mat3_translation(m, point(r, 3.0))
}

pub(super) fn all_shapes(m: DAffine3, similar: DAffine3) -> Vec<Shape> {
    vec![
        Shape::Rectangle(Rectangle::new(m, false).unwrap()),
        Shape::Disk(Disk::new(m, false).unwrap()),
        Shape::Cube(Cube::new(m, false).unwrap()),
        Shape::Sphere(Sphere::new(DVec3::new(0.1, 0.2, -0.3), 0.7, similar, false).unwrap()),
        Shape::Mesh(cube_mesh(m)),
        Shape::Cylinder(tube(similar)),
    ]
}

/// Longer than wide.
fn tube(similar: DAffine3) -> Cylinder {
    let place = DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::new(0.4, 0.4, 1.1)), DVec3::Y * 0.3);
    Cylinder::new(similar * place, false).unwrap()
}

/// The cube as twelve triangles.
fn cube_mesh(m: DAffine3) -> TriangleMesh {
    let cube = Cube::new(DAffine3::IDENTITY, false).unwrap();
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for face in 0..6 {
        let corner = |u, v| cube.position(face, DVec2::new(u, v));
        let q = [corner(0.0, 0.0), corner(1.0, 0.0), corner(1.0, 1.0), corner(0.0, 1.0)];
        let k = vertices.len() as u32;
        let outward = (q[1] - q[0]).cross(q[2] - q[0]).dot(cube.normal(face, q[0])) > 0.0;
        vertices.extend(q);
        let triangles = [[k, k + 1, k + 2], [k, k + 2, k + 3]];
        faces.extend(triangles.map(|[a, b, c]| if outward { [a, b, c] } else { [a, c, b] }));
    }
    TriangleMesh::new(vertices, faces, None, None).unwrap().transformed(&m).unwrap()
}

/// Chi-square statistic above which equal or given cells are rejected with probability 1e-6 (Wilson-Hilferty).
fn chi2_fails(counts: &[f64], expected: &[f64]) -> bool {
    let chi2: f64 = counts.iter().zip(expected).map(|(n, e)| (n - e) * (n - e) / e).sum();
    let k = counts.len() as f64 - 1.0;
    chi2 > k * (1.0 - 2.0 / (9.0 * k) + 4.7534 * (2.0 / (9.0 * k)).sqrt()).powi(3)
}

/// Cell of equal share of its face, found from the point alone.
fn cell(s: &Shape, face: u32, p: DVec3) -> usize {
    let uv = s.uv(face, p);
    let grid = |a: f64, b: f64| ((a * 4.0) as usize).min(3) * 4 + ((b * 4.0) as usize).min(3);
    match s {
        Shape::Rectangle(_) | Shape::Cube(_) => 16 * face as usize + grid(uv.x, uv.y),
        Shape::Disk(_) => grid(uv.x * uv.x, uv.y),
        Shape::Cylinder(_) => grid(uv.x, uv.y),
        Shape::Sphere(_) => grid(0.5 - 0.5 * (PI * uv.y).cos(), uv.x),
        // Four triangles by the midpoints of the sides.
        Shape::Mesh(_) => {
            let b = [1.0 - uv.x - uv.y, uv.x, uv.y];
            4 * face as usize + b.iter().position(|&b| b > 0.5).map_or(3, |i| i)
        }
    }
}

fn area_counts(s: &Shape, n: usize, mut draw: impl FnMut() -> (u32, DVec3)) -> bool {
    let face_areas = match s {
        Shape::Mesh(m) => (0..12).map(|f| m.face_area(f)).collect(),
        Shape::Cube(c) => (0..6).map(|f| face_area(c, f)).collect::<Vec<f64>>(),
        _ => vec![s.area()],
    };
    let cells = if matches!(s, Shape::Mesh(_)) { 4 } else { 16 };
    let expected: Vec<f64> =
        face_areas.iter().flat_map(|a| std::iter::repeat_n(n as f64 * a / s.area() / cells as f64, cells)).collect();
    let mut counts = vec![0.0; expected.len()];
    for _ in 0..n {
        let (face, p) = draw();
        counts[cell(s, face, p)] += 1.0;
    }
    !chi2_fails(&counts, &expected)
}

fn face_area(c: &Cube, f: u32) -> f64 {
    let p = |u, v| c.position(f, DVec2::new(u, v));
    (p(1.0, 0.0) - p(0.0, 0.0)).cross(p(0.0, 1.0) - p(0.0, 0.0)).length()
}

/// False alarms: 1e-6 a shape. The negative control draws the disk's radius uniformly and must fail.
#[test]
fn samples_are_uniform_in_area() {
    let mut r = rng(1);
    let (m, similar) = (affine(&mut r), similarity(&mut r, 2.0, 3.0));
    for s in all_shapes(m, similar) {
        let uniform = area_counts(&s, 100_000, || {
            let x = s.sample(r.uniform(), r.uniform());
            assert!((x.pdf_area * s.area() - 1.0).abs() < 1e-12);
            (x.face, x.p)
        });
        assert!(uniform, "{s:?}");
    }
    let disk = Shape::Disk(Disk::new(m, false).unwrap());
    assert!(!area_counts(&disk, 100_000, || (0, disk.position(0, DVec2::new(r.uniform(), r.uniform())))));
}

#[test]
fn coordinates_go_there_and_back_and_bounds_are_tight() {
    let mut r = rng(2);
    for _ in 0..20 {
        let (m, similar) = (affine(&mut r), similarity(&mut r, 0.5, 2.0));
        for s in all_shapes(m, similar) {
            let b = s.bounds();
            let slack = DVec3::splat(1e-12 * (1.0 + b.magnitude()));
            let mut seen = Bounds::EMPTY;
            for _ in 0..2000 {
                let x = s.sample(r.uniform(), r.uniform());
                assert!((s.position(x.face, x.uv) - x.p).length() < 1e-12, "{s:?}");
                assert!((s.uv(x.face, x.p) - x.uv).length() < 1e-9, "{s:?}");
                assert!((x.n.length() - 1.0).abs() < 1e-12 && (s.normal(x.face, x.p) - x.n).length() < 1e-12);
                seen = seen.with_point(x.p);
            }
            assert!(Bounds::new(b.min - slack, b.max + slack).contains(seen.min));
            assert!(Bounds::new(b.min - slack, b.max + slack).contains(seen.max));
            assert!((seen.size() - b.size()).abs().max_element() < 0.25 * b.radius(), "{s:?} {seen:?} {b:?}");
        }
    }
}

#[test]
fn normals_are_across_the_surface_outward_and_flip() {
    let mut r = rng(3);
    for _ in 0..50 {
        let m = affine(&mut r);
        for s in all_shapes(m, similarity(&mut r, 0.5, 2.0)) {
            let (u, v) = (0.2 + 0.5 * r.uniform(), 0.2 + 0.5 * r.uniform());
            let face = s.sample(u, v).face;
            let at = |du, dv| s.position(face, DVec2::new(u * 0.5 + du, v * 0.5 + dv));
            let (p, n) = (at(0.0, 0.0), s.normal(face, at(0.0, 0.0)));
            // Tangents by differences, central so that curvature drops out.
            for d in [at(1e-5, 0.0) - at(-1e-5, 0.0), at(0.0, 1e-5) - at(0.0, -1e-5)] {
                assert!(n.dot(d.normalize()).abs() < 1e-7, "{s:?}");
            }
            // Mirrors too leave the outside outside.
            if s.is_closed() {
                assert!(n.dot(p - s.bounds().center()) > 0.0, "{s:?}");
            }
        }
        let flipped = Rectangle::new(m, true).unwrap().normal(0, DVec3::ZERO);
        assert_eq!(flipped, -Rectangle::new(m, false).unwrap().normal(0, DVec3::ZERO));
        assert!(Cube::new(m, true).unwrap().normal(3, m.translation).dot(m.matrix3.y_axis) < 0.0);
    }
    assert_eq!(Rectangle::new(DAffine3::IDENTITY, false).unwrap().normal(0, DVec3::ZERO), DVec3::Z);
    assert!(Rectangle::new(DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)), false).is_err());
}

#[test]
fn hits_agree_with_triangles_and_with_each_other() {
    let mut r = rng(4);
    let (mut hits, mut near) = (0, 0);
    for _ in 0..20_000 {
        let m = affine(&mut r);
        let (cube, mesh) = (Cube::new(m, false).unwrap(), cube_mesh(m));
        let o = m.transform_point3(point(&mut r, 2.0));
        let w = (m.transform_point3(point(&mut r, 1.5)) - o) * r.uniform();
        let (t_min, t_max) = (0.0, if r.uniform() < 0.5 { 1.0 } else { f64::INFINITY });
        let (a, b) = (cube.intersect(o, w, t_min, t_max, None), mesh.intersect(o, w, t_min, t_max, None));
        match (a, b) {
            (Some(a), Some(b)) => {
                assert!((a.t - b.t).abs() < 1e-9 * (1.0 + a.t), "{a:?} {b:?}");
                assert_eq!(a.face, b.face / 2);
                assert!((cube.position(a.face, a.uv) - (o + a.t * w)).length() < 1e-9 * (1.0 + a.t));
                hits += 1;
            }
            (None, None) => {}
            // Edges, and the diagonals of the triangles, may differ by rounding.
            _ => near += 1,
        }
        // The line's crossings contain every hit, and one face of the cube as a rectangle agrees.
        let rectangle = Rectangle::new(m * DAffine3::from_translation(DVec3::Z), false).unwrap();
        if let (Some(hit), Some([enter, exit])) = (a, cube.crossings(o, w)) {
            assert!(enter.t < exit.t && (hit == enter || hit == exit));
            if hit.face == 5 {
                let t = rectangle.intersect(o, w, t_min, t_max, None).unwrap().t;
                assert!((t - hit.t).abs() < 1e-9 * (1.0 + t));
            }
        }
    }
    assert!(hits > 5000 && near <= 2, "{hits} {near}");
}

#[test]
fn a_disk_is_the_rectangle_within_its_circle() {
    let mut r = rng(5);
    for _ in 0..20_000 {
        let m = affine(&mut r);
        let (o, w) = (point(&mut r, 3.0), direction(&mut r));
        let disk = Disk::new(m, false).unwrap().intersect(o, w, 0.0, 5.0, None);
        let square = Rectangle::new(m, false).unwrap().intersect(o, w, 0.0, 5.0, None);
        let within = square.filter(|h| (2.0 * h.uv - 1.0).length() <= 1.0);
        assert_eq!(disk.map(|h| h.t), within.map(|h| h.t));
    }
}

#[test]
fn sphere_hits_are_the_first_sign_change() {
    let mut r = rng(6);
    for _ in 0..3000 {
        let s = Sphere::new(point(&mut r, 1.0), 0.1 + r.uniform(), DAffine3::IDENTITY, false).unwrap();
        let (o, w) = (point(&mut r, 2.0), direction(&mut r));
        let f = |t: f64| (o + t * w - s.center).length() - s.radius;
        let scan = (0..4000).map(|i| i as f64 * 1e-3).find(|&t| f(t) * f(t + 1e-3) <= 0.0);
        let hit = s.intersect(o, w, 0.0, 4.0, None);
        match (hit, scan) {
            (Some(h), Some(t)) => {
                assert!(f(h.t).abs() < 1e-12);
                assert!(h.t > t - 1e-9 && h.t < t + 1e-3 + 1e-9 || f(h.t - 1e-3) * f(h.t + 1e-3) > 0.0);
            }
            // A chord shorter than the scan's step.
            (Some(h), None) => assert!((o - s.center).cross(w).length() > s.radius * 0.999 || h.t > 3.99),
            (None, scan) => assert!(scan.is_none_or(|t| t > 3.99)),
        }
    }
}

const SCALES: [f64; 3] = [1e-6, 1.0, 1e6];
const OFFSETS: [f64; 2] = [0.0, 1e5];

/// Leaving a sphere inward one meets the far side at 2 r cos; leaving it outward, nothing. At every scale and place.
#[test]
fn rays_that_start_on_a_sphere() {
    let mut r = rng(7);
    for scale in SCALES {
        for offset in OFFSETS {
            let s = Sphere::new(DVec3::ZERO, 1.0, similarity(&mut r, scale, offset), false).unwrap();
            for k in 0..20_000 {
                let p = s.sample(r.uniform(), r.uniform()).p;
                let n = s.normal(0, p);
                let mut w = direction(&mut r);
                // Half of the rays graze.
                if k % 2 == 0 {
                    w = (w - n * w.dot(n) * (1.0 - 10f64.powf(-12.0 * r.uniform()))).normalize();
                }
                let cos = -n.dot(w);
                let hit = s.intersect(p, w, 0.0, f64::INFINITY, Some(Start { face: 0 }));
                if cos.abs() < 1e-15 {
                    continue;
                }
                assert_eq!(hit.is_some(), cos > 0.0, "{scale} {offset} {cos}");
                let Some(hit) = hit else { continue };
                let expected = 2.0 * s.radius * cos;
                // The cosine itself carries a rounding of 1e-16.
                let tolerance = 1e-9 * expected + 4e-16 * s.radius;
                assert!((hit.t - expected).abs() <= tolerance, "{scale} {offset}: {} {expected}", hit.t);
                // On the surface, but for the rounding of the coordinates; `snap` takes that away.
                let q = p + hit.t * w;
                let ulp = 8.0 * f64::EPSILON * (offset + scale);
                assert!(((q - s.center).length() - s.radius).abs() <= 2.0 * ulp);
                assert!((s.snap(q) - q).length() <= 2.0 * ulp);
            }
        }
    }
}

#[test]
fn rays_that_start_on_a_cube_or_a_plane() {
    let mut r = rng(8);
    for scale in SCALES {
        for offset in OFFSETS {
            let m = similarity(&mut r, scale, offset);
            let cube = Cube::new(m, false).unwrap();
            let b = cube.bounds();
            for _ in 0..20_000 {
                let x = cube.sample(r.uniform(), r.uniform());
                let w = direction(&mut r);
                let hit = cube.intersect(x.p, w, 0.0, f64::INFINITY, Some(Start { face: x.face }));
                assert_eq!(hit.is_some(), w.dot(x.n) < 0.0);
                let Some(hit) = hit else { continue };
                assert!(hit.t > 0.0 && hit.face != x.face);
                // Exit by exact bookkeeping in object coordinates.
                let local = |p: DVec3| m.matrix3.transpose() * (p - m.translation) / (scale * scale);
                let (o, d) = (local(x.p), m.matrix3.transpose() * w / (scale * scale));
                let exact = (0..3)
                    .filter(|&a| a != x.face as usize / 2 || o[a] * d[a] < 0.0)
                    .map(|a| (d[a].signum() - o[a]) / d[a])
                    .fold(f64::INFINITY, f64::min);
                let ulp = 1e-15 * (offset + scale);
                assert!((hit.t - exact).abs() <= 1e-9 * exact + 40.0 * ulp / d.abs().max_element() / scale);
                let slack = DVec3::splat(8.0 * ulp);
                assert!(Bounds::new(b.min - slack, b.max + slack).contains(x.p + hit.t * w));
            }
            let rectangle = Rectangle::new(m, false).unwrap();
            let x = rectangle.sample(0.3, 0.6);
            assert!(rectangle.intersect(x.p, direction(&mut r), 0.0, 1e9, Some(Start { face: 0 })).is_none());
        }
    }
}

#[test]
fn zero_components_and_edges_of_slabs() {
    let c = Cube::new(DAffine3::IDENTITY, false).unwrap();
    let hit = |o: [f64; 3], w: [f64; 3]| c.intersect(o.into(), w.into(), 0.0, f64::INFINITY, None);
    assert_eq!(hit([0.0, 0.0, -3.0], [0.0, -0.0, 1.0]).map(|h| (h.t, h.face)), Some((2.0, 4)));
    assert_eq!(hit([1.5, 0.0, -3.0], [0.0, 0.0, 1.0]), None);
    // Along a face.
    assert_eq!(hit([1.0, 0.0, -3.0], [0.0, 0.0, 1.0]).map(|h| h.t), Some(2.0));
    assert_eq!(hit([0.0, 0.0, 0.0], [0.0, -1.0, 0.0]).map(|h| (h.t, h.face)), Some((1.0, 2)));
    // t_max belongs to the interval, t_min does not.
    let from = |t_min, t_max| c.intersect(DVec3::new(0.0, 0.0, -3.0), DVec3::Z, t_min, t_max, None).map(|h| h.t);
    assert_eq!((from(0.0, 2.0), from(0.0, 1.9), from(2.0, 9.0)), (Some(2.0), None, Some(4.0)));
    // From a corner, and from a point that rounding put outside: inward rays leave, at once or not.
    let start = |p: [f64; 3], w: [f64; 3], face| {
        c.intersect(p.into(), w.into(), 0.0, f64::INFINITY, Some(Start { face })).map(|h| h.t)
    };
    assert!(start([1.0, 1.0, 0.0], [-1.0, 1.0, 0.0], 1).is_some_and(|t| t > 0.0 && t < 1e-300));
    assert_eq!(start([1.0 + 1e-15, 1.0 + 1e-15, 0.0], [-1.0, 0.0, 0.0], 1), Some(2.0));
    assert_eq!(start([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 1), None);
}

#[test]
fn a_sphere_takes_similarities_only() {
    let s = |m| Sphere::new(DVec3::X, 2.0, m, false);
    assert!(s(DAffine3::from_scale(DVec3::new(1.0, 1.0, 1.001))).is_err());
    assert!(s(DAffine3::from_scale(DVec3::ZERO)).is_err());
    assert!(Sphere::new(DVec3::X, 0.0, DAffine3::IDENTITY, false).is_err());
    let moved = s(DAffine3::from_translation(DVec3::Y) * DAffine3::from_scale(DVec3::splat(-3.0))).unwrap();
    assert!((moved.center - DVec3::new(-3.0, 1.0, 0.0)).length() < 1e-14 && (moved.radius - 6.0).abs() < 1e-14);
    // Six digits, as files have them.
    let (c, s6) = (0.866025, 0.5);
    assert!(s(DAffine3::from_mat3(DMat3::from_cols_array(&[c, s6, 0.0, -s6, c, 0.0, 0.0, 0.0, 1.0]))).is_ok());
    let pole = moved.position(0, DVec2::new(0.0, 1.0));
    assert!((moved.uv(0, pole).y - 1.0).abs() < 1e-15);
}

/// Irradiance from a sphere above the horizon is pi (r/d)^2 cos. False alarms: 6e-7 a distance (5 standard errors).
#[test]
fn cone_sampling_gives_the_irradiance_and_lands_on_the_sphere() {
    let mut r = rng(9);
    for ratio in [1.0 + 1e-9, 1.2, 3.0, 1e3, 1e8] {
        let radius = 0.5;
        let d = ratio * radius;
        let axis = DVec3::new(0.48, 0.6, 0.64);
        let s = Sphere::new(axis * d, radius, DAffine3::IDENTITY, false).unwrap();
        // Horizon clear of the sphere: normal along the axis, tilted where there is room.
        let n = if ratio >= 3.0 { (axis + DVec3::new(0.2, -0.1, 0.1)).normalize() } else { axis };
        let mut m = Moments::default();
        for i in 0..50_000 {
            let u = if i == 0 { 0.0 } else { r.uniform() };
            let x = s.sample_direction(DVec3::ZERO, u, r.uniform()).unwrap();
            let rounding = 1e-14 * d;
            assert!(
                (x.w.length() - 1.0).abs() < 1e-14 && (x.w * x.distance - x.p).length() < 1e-7 * radius + rounding,
                "{ratio} {x:?} {}",
                (x.w * x.distance - x.p).length()
            );
            assert!(((x.p - s.center).length() - radius).abs() < rounding && x.n.dot(x.w) <= 1e-7);
            assert_eq!(x.pdf_solid_angle, s.pdf_direction(DVec3::ZERO, x.p));
            m.push(n.dot(x.w) / x.pdf_solid_angle);
        }
        let exact = PI / (ratio * ratio) * n.dot(axis);
        assert!((m.mean - exact).abs() < 5.0 * m.standard_error() + 1e-9 * exact, "{ratio}: {} {exact}", m.mean);
        // The solid angle of a far sphere keeps its digits: 2 pi (1 - sqrt(1 - s^2)) by its series.
        let pdf = s.pdf_direction(DVec3::ZERO, s.center);
        if ratio >= 1e3 {
            let series = PI / (ratio * ratio) * (1.0 + 0.25 / (ratio * ratio));
            assert!((pdf * series - 1.0).abs() < 1e-11);
        }
    }
}

/// The pdf integrates to one over directions seen from inside. False alarms: 6e-7.
#[test]
fn sampling_from_inside_covers_all_directions() {
    let mut r = rng(10);
    let s = Sphere::new(DVec3::new(1.0, 2.0, 3.0), 2.0, DAffine3::IDENTITY, true).unwrap();
    let x = s.center + DVec3::new(0.5, -1.0, 0.8);
    let mut m = Moments::default();
    for _ in 0..100_000 {
        let d = s.sample_direction(x, r.uniform(), r.uniform()).unwrap();
        assert!((x + d.w * d.distance - d.p).length() < 1e-12 && d.n.dot(d.p - s.center) < 0.0);
        m.push(1.0 / d.pdf_solid_angle);
    }
    assert!((m.mean - 2.0 * TAU).abs() < 5.0 * m.standard_error());
}

/// The wall of a tube as a prism: inside of it everywhere, by 1 - cos(pi/n) of the radius at most.
#[test]
fn cylinder_hits_agree_with_a_prism_of_many_faces() {
    let n = 720;
    let prism = |m: DAffine3| {
        let at = |k: usize, z: f64| {
            let (s, c) = (TAU * k as f64 / n as f64).sin_cos();
            m.transform_point3(DVec3::new(c, s, z))
        };
        let vertices = (0..n).flat_map(|k| [at(k, 0.0), at(k, 1.0)]).collect();
        let face = |k: usize| {
            let [a, b, c, d] = [2 * k, 2 * k + 1, 2 * ((k + 1) % n), 2 * ((k + 1) % n) + 1].map(|v| v as u32);
            [[a, c, d], [a, d, b]]
        };
        TriangleMesh::new(vertices, (0..n).flat_map(face).collect(), None, None).unwrap()
    };
    let mut r = rng(11);
    let (mut hits, mut near) = (0, 0);
    for _ in 0..4 {
        let m = similarity(&mut r, 0.7, 2.0) * DAffine3::from_scale(DVec3::new(1.0, 1.0, 1.5));
        let (tube, prism) = (Cylinder::new(m, false).unwrap(), prism(m));
        let b = tube.bounds();
        for _ in 0..1500 {
            let o = b.center() + point(&mut r, 2.0);
            let w = (b.center() + point(&mut r, 1.0) - o).normalize();
            let (a, p) = (tube.intersect(o, w, 0.0, 9.0, None), prism.intersect(o, w, 0.0, 9.0, None));
            match (a, p) {
                (Some(a), Some(p)) if (a.t - p.t).abs() < 1e-2 => {
                    let (q, cos) = (o + a.t * w, tube.normal(0, o + a.t * w).dot(w).abs());
                    assert!((a.t - p.t).abs() * cos < 2e-5, "{a:?} {p:?}");
                    assert!((tube.position(0, a.uv) - q).length() < 1e-12 && (tube.snap(q) - q).length() < 1e-13);
                    assert!((tube.normal(0, q) - prism.normal(p.face, q)).length() < 1e-2);
                    hits += 1;
                }
                (None, None) => {}
                // Past an outline on one side of it.
                _ => near += 1,
            }
        }
    }
    assert!(hits > 1500 && near < 15, "{hits} {near}");
}

/// Leaving the wall inward one meets the other side of it at 2 r cos / sin^2, if that is between the rims. At every scale and place.
#[test]
fn rays_that_start_on_a_cylinder() {
    let mut r = rng(12);
    for scale in SCALES {
        for offset in OFFSETS {
            let place = similarity(&mut r, scale, offset) * DAffine3::from_scale(DVec3::new(1.0, 1.0, 3.0));
            let s = Cylinder::new(place, false).unwrap();
            let mut met = [0, 0];
            for k in 0..20_000 {
                let p = s.sample(r.uniform(), r.uniform()).p;
                let n = s.normal(0, p);
                let mut w = direction(&mut r);
                // Half of the rays graze.
                if k % 2 == 0 {
                    w = (w - n * w.dot(n) * (1.0 - 10f64.powf(-12.0 * r.uniform()))).normalize();
                }
                let (cos, sin2) = (-n.dot(w), s.axis.cross(w).length_squared());
                let hit = s.intersect(p, w, 0.0, f64::INFINITY, Some(Start { face: 0 }));
                let expected = 2.0 * s.radius * cos / sin2;
                let top = s.height(p) + expected * s.axis.dot(w);
                let rim = top.abs().min((top - s.length).abs());
                if cos.abs() < 1e-15 || sin2 < 1e-6 || rim < 1e-6 * scale + 1e-14 * offset {
                    continue;
                }
                let between = cos > 0.0 && (0.0..=s.length).contains(&top);
                assert_eq!(hit.is_some(), between, "{scale} {offset} {cos} {top}");
                met[usize::from(between)] += 1;
                let Some(hit) = hit else { continue };
                // The cosine itself carries a rounding of 1e-16 a product, here and there.
                let tolerance = 1e-9 * expected + 16e-16 * s.radius / sin2;
                assert!((hit.t - expected).abs() <= tolerance, "{scale} {offset}: {} {expected}", hit.t);
                let q = p + hit.t * w;
                let ulp = 16.0 * f64::EPSILON * (offset + 4.0 * scale);
                assert!((s.from_axis(q).length() - s.radius).abs() <= ulp && (s.snap(q) - q).length() <= 2.0 * ulp);
                // From the middle of the chord, if that is inside after rounding, the same point is met.
                let o = p + w * (0.5 * hit.t);
                if s.radius * cos * cos < 100.0 * ulp {
                    continue;
                }
                let again = s.intersect(o, w, 0.0, f64::INFINITY, None).unwrap().t;
                assert!((again - 0.5 * hit.t).abs() <= 1e-9 * hit.t + ulp / cos, "{scale} {offset}");
            }
            assert!(met.iter().all(|&m| m > 3000), "{met:?}");
        }
    }
}

#[test]
fn a_far_thin_cylinder_keeps_its_digits() {
    // Radius 1e-3 at 1e5, across the axis and along most of it.
    let place = |x| DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::new(1e-3, 1e-3, 2.0)), x);
    let s = Cylinder::new(place(DVec3::new(1e5, 5e-4, -1.0)), false).unwrap();
    let half = 1e-3 * 0.75f64.sqrt();
    let near = s.intersect(DVec3::ZERO, DVec3::X, 0.0, f64::INFINITY, None).unwrap().t;
    assert!((near - (1e5 - half)).abs() < 2e-11, "{near}");
    let far = s.intersect(DVec3::ZERO, DVec3::X, near + 1e-6, f64::INFINITY, None).unwrap().t;
    assert!((far - (1e5 + half)).abs() < 2e-11, "{far}");
    assert!(s.intersect(DVec3::Y * 1.6e-3, DVec3::X, 0.0, f64::INFINITY, None).is_none());
    // Along the axis, within and without: nothing.
    let o = DVec3::new(1e5 + 2e-4, 5e-4, -9.0);
    assert!(s.intersect(o, DVec3::Z, 0.0, f64::INFINITY, None).is_none());
    assert!(s.intersect(o + DVec3::X, DVec3::Z, 0.0, f64::INFINITY, None).is_none());
}

#[test]
fn a_cylinder_stays_round() {
    let s = |m: DAffine3| Cylinder::new(m, false);
    assert!(s(DAffine3::from_scale(DVec3::new(2.0, 2.0, 7.0))).is_ok());
    assert!(s(DAffine3::from_scale(DVec3::new(2.0, 2.001, 7.0))).is_err_and(|e| e.contains("elliptic")));
    let oblique = DMat3::from_cols(DVec3::X, DVec3::Y, DVec3::new(0.1, 0.0, 1.0));
    assert!(s(DAffine3::from_mat3(oblique)).is_err());
    assert!(s(DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0))).is_err());
    // Mirrored or flipped, the outside is where it is said to be.
    let m = s(DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0))).unwrap();
    assert_eq!(m.normal(0, DVec3::new(-1.0, 0.0, 0.5)), DVec3::NEG_X);
    let f = Cylinder::new(DAffine3::IDENTITY, true).unwrap();
    assert_eq!(f.normal(0, DVec3::new(1.0, 0.0, 0.5)), DVec3::NEG_X);
}

/// Planes through a point or along a direction touch the wall where its normal is across them; nearer or inside there are none.
#[test]
fn lines_of_contact() {
    let mut r = rng(13);
    let (mut within, mut without) = (0, 0);
    for _ in 0..2000 {
        let s = tube(similarity(&mut r, 0.5, 2.0));
        let (p, w) = (s.bounds().center() + point(&mut r, 1.0), direction(&mut r));
        let touches = |n: DVec3, along: DVec3| {
            let [a, b] = s.line(n);
            let scale = 1e-13 * (1.0 + along.length());
            assert!((s.normal(0, a.midpoint(b)) - n).length() < 1e-12 && n.dot(along).abs() < scale);
            assert!(s.to_rims(a) < 1e-13 && s.to_rims(b) < 1e-13);
        };
        match s.contacts_from(p) {
            Some(normals) => normals.map(|n| touches(n, p - s.line(n)[0])).len(),
            None => {
                assert!(s.from_axis(p).length() <= s.radius);
                within += 1;
                0
            }
        };
        without += s.contacts_along(w).unwrap().map(|n| touches(n, w)).len();
    }
    assert!(within > 50 && without == 4000, "{within}");
    assert!(Cylinder::new(DAffine3::IDENTITY, false).unwrap().contacts_along(DVec3::Z).is_none());
}

/// A line through a point of a rim meets the wall once more at most, and never there.
#[test]
fn past_a_rim() {
    let mut r = rng(14);
    let mut met = 0;
    for scale in SCALES {
        for _ in 0..3000 {
            let s = tube(similarity(&mut r, scale, 2.0 * scale));
            let k = u32::from(r.uniform() < 0.5);
            let (x, y) = s.rim_axes();
            let (sin, cos) = (TAU * r.uniform()).sin_cos();
            let b = s.rim(k).0 + x * cos + y * sin;
            let o = b + point(&mut r, 3.0 * scale);
            let w = (b - o).normalize();
            let all = [-1e9 * scale, 1e9 * scale];
            let t = s.cross_past_rims(o, w, all, &[k], 1e-14 * scale);
            let other = 2.0 * s.radius * -s.normal(0, b).dot(w) / s.axis.cross(w).length_squared();
            let top = s.height(b) + other * s.axis.dot(w);
            if top.abs().min((top - s.length).abs()) < 1e-6 * scale {
                continue;
            }
            assert_eq!(t.is_some(), (0.0..=s.length).contains(&top));
            if let Some(t) = t {
                assert!((o + w * t - (b + w * other)).length() < 1e-9 * (scale + other.abs()));
                met += 1;
            }
        }
    }
    assert!(met > 1000, "{met}");
}
