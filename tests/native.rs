//! The native wrappers against geometry and files whose answers are known.
//!
//! Random directions and damage come from fixed seeds; nothing here is a statistical test.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use tyndall::math::nearest::on_triangle;
use tyndall::math::rng::Rng;
use tyndall::math::{DAffine3, DMat3, DVec3};
use tyndall::native::embree::{self, Bvh, Ray, SceneBuilder, UserPrimitives};
use tyndall::native::nearest::Nearest;
use tyndall::native::vdb::{self, Compression, Leaf, Select, Tile, WriteGrid};

// ---- Embree ----

/// A cube [-1, 1]^3 under `x -> x * scale + offset`, two triangles a side, shared vertices, normals outward.
fn cube(scale: f64, offset: DVec3) -> (Arc<[DVec3]>, Arc<[[u32; 3]]>) {
    let v = (0..8).map(|i| {
        let c = |b: i32| f64::from((i >> b & 1) * 2 - 1);
        DVec3::new(c(0), c(1), c(2)) * scale + offset
    });
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let f = quads.iter().flat_map(|q: &[u32; 4]| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]);
    (v.collect(), f.collect())
}

fn mesh(v: Arc<[DVec3]>, f: Arc<[[u32; 3]]>) -> Bvh {
    let mut b = SceneBuilder::new().unwrap();
    assert_eq!(b.add_triangles(v, f).unwrap(), 0);
    b.commit().unwrap()
}

fn direction(r: &mut Rng) -> DVec3 {
    let z = 2.0 * r.uniform() - 1.0;
    let (s, c) = (std::f64::consts::TAU * r.uniform()).sin_cos();
    let q = (1.0 - z * z).max(0.0).sqrt();
    DVec3::new(q * c, q * s, z).normalize()
}

/// Exit distance of a ray from within the cube.
fn exit(o: DVec3, d: DVec3) -> f64 {
    (0..3).map(|k| (d[k].signum() - o[k]) / d[k]).filter(|t| t.is_finite()).fold(f64::INFINITY, f64::min)
}

#[test]
fn version_is_of_the_header_built_for() {
    let major = env!("TYNDALL_EMBREE_HEADER").split('.').next().unwrap();
    assert_eq!(embree::version().split('.').next().unwrap(), major);
    assert_eq!(vdb::version(), env!("TYNDALL_OPENVDB_HEADER"));
}

#[test]
fn cube_is_hit_from_within_from_its_surface_and_from_far_at_all_scales() {
    for (scale, offset) in [
        (1.0, DVec3::ZERO),
        (1e-6, DVec3::ZERO),
        (1e6, DVec3::ZERO),
        (1.0, DVec3::new(1e5, -2e5, 3e5)),
        (1e-3, DVec3::splat(1e5)),
    ] {
        let (v, f) = cube(scale, offset);
        let bvh = mesh(v.clone(), f.clone());
        // Rounding of the coordinates themselves, relative to the cube.
        let coordinate = 1.0 + offset.abs().max_element() / scale;
        let mut r = Rng::keyed(1, 2, 3, 4);
        for i in 0..4000 {
            // From within: the exit is known; from there a ray inward, from the surface, reaches another face.
            let x = DVec3::new(r.uniform(), r.uniform(), r.uniform()) * 1.8 - 0.9;
            let d = direction(&mut r);
            let ray = Ray::new(x * scale + offset, d);
            let hit = bvh.intersect(&ray).expect("a ray from within leaves");
            let t = exit(x, d) * scale;
            assert!(
                (hit.t - t).abs() <= 1e-13 * coordinate * scale / d.abs().min_element().max(0.01),
                "{i}: {} {t}",
                hit.t
            );
            assert!(bvh.occluded(&ray));
            assert!(!bvh.occluded(&Ray { t_max: hit.t * (1.0 - 1e-9), ..ray }), "nothing before the hit");

            // Barycentrics and distance name the same point.
            let face = f[hit.prim as usize].map(|k| v[k as usize]);
            let p = face[0] + (face[1] - face[0]) * hit.uv[0] + (face[2] - face[0]) * hit.uv[1];
            assert!((p - (ray.o + d * hit.t)).length() <= 1e-13 * coordinate * scale, "{i}");

            let n = (face[1] - face[0]).cross(face[2] - face[0]).normalize();
            let mut d2 = direction(&mut r);
            if d2.dot(n) > 0.0 {
                d2 = -d2;
            }
            let inward = Ray { o: p, d: d2, t_max: f64::INFINITY, exclude: Some((0, hit.prim)) };
            let second = bvh.intersect(&inward).expect("a ray inward from the surface leaves");
            let other = f[second.prim as usize].map(|k| v[k as usize]);
            let m = (other[1] - other[0]).cross(other[2] - other[0]).normalize();
            assert!(m.dot(n) < 0.5, "never the own side again, not its other triangle either");

            // Outward from the surface: nothing. Also when nothing is excluded and the side is told by its plane alone.
            let outward = Ray { d: -d2, ..inward };
            assert_eq!(bvh.intersect(&outward), None, "{i}: {scale} {offset}");
            assert!(!bvh.occluded(&outward));
        }

        // From 1e5 radii away, at a point within a face.
        for _ in 0..1000 {
            let target = DVec3::new(r.uniform() * 1.8 - 0.9, r.uniform() * 1.8 - 0.9, 1.0);
            let mut d = direction(&mut r);
            d = if d.z > 0.0 { -d } else { d };
            if d.z > -0.1 {
                continue;
            }
            let o = (target - d * 1e5) * scale + offset;
            let hit = bvh.intersect(&Ray::new(o, d)).expect("a ray aimed at a face hits it");
            assert!((hit.t / scale - 1e5).abs() < 1e-9 * coordinate, "{}", hit.t / scale - 1e5);
            assert!(bvh.intersect(&Ray::new(o, -d)).is_none());
        }
    }
}

#[test]
fn rays_in_the_plane_of_coplanar_triangles_see_nothing() {
    // A tilted square of 32^2 cells; origins on it, with rounding, directions within the plane and outward.
    let (a, b) = (DVec3::new(0.3, 0.8, 0.1), DVec3::new(-0.7, 0.2, 0.5));
    let n = 32_u32;
    let v: Vec<DVec3> = (0..=n)
        .flat_map(|j| {
            (0..=n)
                .map(move |i| a * (f64::from(i) / f64::from(n)) + b * (f64::from(j) / f64::from(n)) + DVec3::splat(7.0))
        })
        .collect();
    let at = |i: u32, j: u32| j * (n + 1) + i;
    let f: Vec<[u32; 3]> = (0..n * n)
        .flat_map(|k| {
            let (i, j) = (k % n, k / n);
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        })
        .collect();
    let bvh = mesh(v.clone().into(), f.clone().into());
    let normal = a.cross(b).normalize();
    let mut r = Rng::keyed(5, 6, 7, 8);
    for k in 0..20_000 {
        let prim = (r.uniform() * f.len() as f64) as usize;
        let (b1, b2) = (r.uniform(), r.uniform());
        let (b1, b2) = if b1 + b2 > 1.0 { (1.0 - b1, 1.0 - b2) } else { (b1, b2) };
        let [p, q, s] = f[prim].map(|i| v[i as usize]);
        let o = p + (q - p) * b1 + (s - p) * b2;
        // From well outward down to rays that leave the plane by rounding only.
        let lift = [1.0, 1e-3, 1e-8, 1e-15, 0.0][k % 5];
        let d = ((a * (r.uniform() - 0.5) + b * (r.uniform() - 0.5)) + normal * lift).normalize();
        let ray = Ray { o, d, t_max: f64::INFINITY, exclude: Some((0, prim as u32)) };
        assert_eq!(bvh.intersect(&ray), None, "lift {lift}");
        assert!(!bvh.occluded(&ray));
    }
}

#[test]
fn soup_and_zero_area_faces_do_no_harm() {
    let (v, f) = cube(1.0, DVec3::ZERO);
    let mut soup: Vec<DVec3> = f.iter().flatten().map(|&i| v[i as usize]).collect();
    let mut faces: Vec<[u32; 3]> = (0..f.len() as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
    // A point, a doubled vertex, three points on a line.
    soup.extend([DVec3::ZERO, DVec3::ZERO, DVec3::X * 0.5, DVec3::X]);
    let k = soup.len() as u32 - 4;
    faces.extend([[k, k, k], [k, k + 1, k + 2], [k, k + 2, k + 3]]);
    let bvh = mesh(soup.into(), faces.into());
    let mut r = Rng::keyed(9, 9, 9, 9);
    for _ in 0..20_000 {
        let d = direction(&mut r);
        let hit = bvh.intersect(&Ray::new(DVec3::ZERO, d)).expect("closed");
        assert!((hit.t - exit(DVec3::ZERO, d)).abs() < 1e-14 * 10.0);
        assert!(hit.prim < 12);
    }
    // Towards edges and vertices, where f32 and f64 may differ: some face of the edge answers.
    for x in v.iter() {
        let hit = bvh.intersect(&Ray::new(DVec3::ZERO, x.normalize()));
        assert!(hit.is_none_or(|h| (h.t - 3.0_f64.sqrt()).abs() < 1e-6));
    }
}

#[test]
fn empty_scenes_and_bad_meshes() {
    let b = SceneBuilder::new().unwrap().commit().unwrap();
    assert!(b.is_empty() && b.intersect(&Ray::new(DVec3::ZERO, DVec3::X)).is_none());
    let mut s = SceneBuilder::new().unwrap();
    assert!(
        s.add_triangles(vec![DVec3::ZERO].into(), vec![[0, 0, 1]].into()).unwrap_err().to_string().contains("only 1")
    );
    assert!(s.add_triangles(vec![DVec3::splat(f64::NAN)].into(), vec![].into()).is_err());
    assert!(s.add_user(vec![(DVec3::ONE, DVec3::ZERO)], Arc::new(Spheres(vec![]))).is_err());
    // Empty geometries take an id all the same, and a scene of one point is no error.
    assert_eq!(s.add_triangles(vec![].into(), vec![].into()).unwrap(), 0);
    assert_eq!(s.add_triangles(vec![DVec3::ONE].into(), vec![[0, 0, 0]].into()).unwrap(), 1);
    let b = s.commit().unwrap();
    assert!(b.intersect(&Ray::new(DVec3::ZERO, DVec3::ONE.normalize())).is_none());
    assert_eq!(b.bounds(), (DVec3::ONE, DVec3::ONE));
}

/// Centre and radius.
struct Spheres(Vec<(DVec3, f64)>);

impl UserPrimitives for Spheres {
    fn intersect(&self, prim: u32, ray: &Ray, t_min: f64, t_max: f64) -> Option<(f64, [f64; 2])> {
        let (c, r) = self.0[prim as usize];
        let b = ray.d.dot(ray.o - c);
        let near = ray.o - c - ray.d * b;
        let q = (r * r - near.length_squared()).max(-1.0);
        if q <= 0.0 {
            return None;
        }
        // On the sphere: the root at the start is the one nearer to zero.
        let roots = if ray.exclude.is_some() { [-2.0 * b, f64::NAN] } else { [-b - q.sqrt(), -b + q.sqrt()] };
        roots.into_iter().find(|&t| t > t_min && t < t_max).map(|t| (t, [0.0; 2]))
    }

    fn nearest(&self, prim: u32, p: DVec3) -> DVec3 {
        let (c, r) = self.0[prim as usize];
        c + (p - c).normalize() * r
    }
}

#[test]
fn analytic_spheres_beside_a_mesh() {
    for scale in [1e-6, 1.0, 1e6] {
        let spheres = vec![
            (DVec3::new(0.3, 0.0, 0.0) * scale, 0.25 * scale),
            (DVec3::new(-0.5, 0.1, 0.2) * scale, 0.125 * scale),
        ];
        let bounds = spheres.iter().map(|(c, r)| (*c - DVec3::splat(*r), *c + DVec3::splat(*r))).collect();
        let mut b = SceneBuilder::new().unwrap();
        let (v, f) = cube(scale, DVec3::ZERO);
        assert_eq!(b.add_triangles(v, f).unwrap(), 0);
        assert_eq!(b.add_user(bounds, Arc::new(Spheres(spheres.clone()))).unwrap(), 1);
        let bvh = b.commit().unwrap();
        assert!(bvh.memory_bytes() > 0);
        let mut r = Rng::keyed(11, 12, 13, 14);
        let mut seen = [0; 2];
        for _ in 0..10_000 {
            let x = DVec3::new(r.uniform(), r.uniform(), r.uniform()) * 1.8 - 0.9;
            let d = direction(&mut r);
            let ray = Ray::new(x * scale, d);
            // The truth by trying everything.
            let all = Spheres(spheres.clone());
            let nearest = (0..2)
                .filter_map(|k| Some((all.intersect(k, &ray, 0.0, f64::INFINITY)?.0, (1, k))))
                .fold((exit(x, d) * scale, (0, 0)), |a, b| if b.0 < a.0 { b } else { a });
            let hit = bvh.intersect(&ray).unwrap();
            assert!((hit.t - nearest.0).abs() <= 1e-11 * scale, "{} {}", hit.t, nearest.0);
            assert_eq!(hit.geom, nearest.1.0);
            if hit.geom == 1 {
                seen[hit.prim as usize] += 1;
                assert_eq!(hit.prim, nearest.1.1);
                // From the sphere outward it is not hit again, inward its other side is.
                let o = ray.o + d * hit.t;
                let n = (o - spheres[hit.prim as usize].0).normalize();
                let out = if d.dot(n) < 0.0 { d - n * (2.0 * d.dot(n)) } else { d };
                let exclude = Some((1, hit.prim));
                let next = bvh.intersect(&Ray { o, d: out, t_max: f64::INFINITY, exclude }).unwrap();
                assert!((next.geom, next.prim) != (1, hit.prim), "{next:?}");
                let next = bvh.intersect(&Ray { o, d: -n, t_max: f64::INFINITY, exclude }).unwrap();
                assert!(next.t <= 2.0 * spheres[hit.prim as usize].1 * (1.0 + 1e-9), "{next:?}");
                assert!(bvh.occluded(&Ray { o, d: -n, t_max: 10.0 * scale, exclude }));
            }
        }
        assert!(seen[0] > 100 && seen[1] > 50);
    }
}

struct Panics;

impl UserPrimitives for Panics {
    fn intersect(&self, _: u32, _: &Ray, _: f64, _: f64) -> Option<(f64, [f64; 2])> {
        panic!("no such root")
    }

    fn nearest(&self, _: u32, _: DVec3) -> DVec3 {
        panic!("no such point")
    }
}

#[test]
fn a_panic_in_a_primitive_reaches_the_caller() {
    let mut b = SceneBuilder::new().unwrap();
    b.add_user(vec![(DVec3::ZERO, DVec3::ONE)], Arc::new(Panics)).unwrap();
    let bvh = b.commit().unwrap();
    let ray = Ray::new(DVec3::new(0.5, 0.5, -1.0), DVec3::Z);
    for f in [|b: &Bvh, r: &Ray| b.intersect(r).is_some(), |b: &Bvh, r: &Ray| b.occluded(r)] {
        let e = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| f(&bvh, &ray))).unwrap_err();
        assert_eq!(e.downcast_ref::<&str>(), Some(&"no such root"));
    }
}

#[test]
fn near_surfaces_come_in_their_exact_order() {
    // Two squares 1e-10 apart, which f32 cannot tell: the nearer one in f64 is the hit, from either side.
    let gap = 1e-10;
    let square = |z: f64| -> Arc<[DVec3]> {
        [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]].iter().map(|p| DVec3::new(p[0], p[1], z)).collect()
    };
    let faces: Arc<[[u32; 3]]> = vec![[0, 1, 2], [0, 2, 3]].into();
    let mut b = SceneBuilder::new().unwrap();
    b.add_triangles(square(0.25), faces.clone()).unwrap();
    b.add_triangles(square(0.25 + gap), faces).unwrap();
    let bvh = b.commit().unwrap();
    let mut r = Rng::keyed(1, 1, 2, 2);
    for _ in 0..2000 {
        let x = DVec3::new(r.uniform() * 1.8 - 0.9, r.uniform() * 1.8 - 0.9, 0.0);
        let up = bvh.intersect(&Ray::new(x, DVec3::Z)).unwrap();
        let down = bvh.intersect(&Ray::new(x + DVec3::Z, -DVec3::Z)).unwrap();
        assert_eq!((up.geom, down.geom), (0, 1));
        // From the lower one to the upper.
        let o = x + DVec3::Z * 0.25;
        let next = bvh.intersect(&Ray { o, d: DVec3::Z, t_max: 1.0, exclude: Some((0, up.prim)) }).unwrap();
        assert!(next.geom == 1 && (next.t - gap).abs() < 1e-15);
    }
}

/// Triangles of all sizes around the origin under `x -> x * scale + offset`, one in eight without area.
fn soup(r: &mut Rng, n: u32, scale: f64, offset: DVec3) -> (Arc<[DVec3]>, Arc<[[u32; 3]]>) {
    let v: Vec<DVec3> = (0..n)
        .flat_map(|_| {
            let size = 0.1_f64.powf(4.0 * r.uniform());
            let c = direction(r) * r.uniform();
            [0; 3].map(|_| (c + direction(r) * size) * scale + offset)
        })
        .collect();
    let f = (0..n).map(|k| match k % 16 {
        0 => [3 * k, 3 * k + 1, 3 * k],
        1 => [3 * k; 3],
        // Neighbours, for ties.
        2.. if k % 4 == 3 => [3 * k, 3 * k + 1, 3 * k - 1],
        _ => [3 * k, 3 * k + 1, 3 * k + 2],
    });
    (v.into(), f.collect())
}

/// The nearer one, ties as documented.
fn nearer(a: Option<Nearest>, b: Nearest) -> Option<Nearest> {
    let key = |n: &Nearest| (n.distance, n.geom, n.prim);
    Some(a.filter(|a| key(a) < key(&b)).unwrap_or(b))
}

/// In and around the unit ball, or far from it.
fn query_point(r: &mut Rng, k: usize) -> DVec3 {
    direction(r) * (r.uniform() * [1.0, 1.0, 3.0, 1e3, 1e9, 1e30][k % 6])
}

#[test]
fn nearest_points_are_those_of_a_search_through_all() {
    let mut r = Rng::keyed(7, 1, 7, 1);
    for (scale, offset) in [
        (1.0, DVec3::ZERO),
        (1e-3, DVec3::splat(1e5)),
        (1e-6, DVec3::ZERO),
        (1e6, DVec3::ZERO),
        (1.0, DVec3::new(1e5, -2e5, 3e5)),
    ] {
        let meshes = [soup(&mut r, 400, scale, offset), soup(&mut r, 100, scale, offset)];
        let spheres: Vec<(DVec3, f64)> =
            (0..20).map(|_| (direction(&mut r) * scale + offset, 0.3 * scale * r.uniform())).collect();
        let mut b = SceneBuilder::new().unwrap();
        for (v, f) in &meshes {
            b.add_triangles(v.clone(), f.clone()).unwrap();
        }
        let bounds = spheres.iter().map(|(c, r)| (*c - DVec3::splat(*r), *c + DVec3::splat(*r))).collect();
        assert_eq!(b.add_user(bounds, Arc::new(Spheres(spheres.clone()))).unwrap(), 2);
        let bvh = b.commit().unwrap();
        let all = Spheres(spheres);
        let mut found = [0; 4];
        for k in 0..6000 {
            let p = query_point(&mut r, k) * scale + offset;
            let radius = if k % 2 == 0 { f64::INFINITY } else { scale * 0.1_f64.powf(3.0 * r.uniform()) };
            // All, a half, one in sixty-four.
            let (salt, one_in) = (r.next_u64(), [1, 2, 64][k % 3]);
            let accept = |geom: u32, prim: u32| {
                (salt ^ u64::from(geom * 1000 + prim)).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 32 << 32
                    < u64::MAX / one_in
            };
            let (mut truth, mut within) = (None, Vec::new());
            let mut offer = |geom, prim, q: DVec3| {
                let distance = q.distance(p);
                if distance < radius {
                    within.push(Nearest { distance, p: q, geom, prim });
                }
                if distance < radius && accept(geom, prim) {
                    truth = nearer(truth, Nearest { distance, p: q, geom, prim });
                }
            };
            for (geom, (v, f)) in meshes.iter().enumerate() {
                for (prim, f) in f.iter().enumerate() {
                    offer(geom as u32, prim as u32, on_triangle(p, f.map(|i| v[i as usize])));
                }
            }
            for prim in 0..all.0.len() as u32 {
                offer(2, prim, all.nearest(prim, p));
            }
            let near = bvh.nearest(p, radius, &accept);
            assert_eq!(near, truth, "{k}: {p} {radius}");
            assert_eq!(bvh.within(p, radius), within, "{k}: {p} {radius}");
            found[near.map_or(3, |n| n.geom as usize)] += 1;
        }
        assert!(found.iter().all(|&n| n > 100), "{found:?}");
    }
}

#[test]
fn nearest_points_of_nothing_and_panics_on_the_way() {
    let all = |_: u32, _: u32| true;
    let empty = SceneBuilder::new().unwrap().commit().unwrap();
    assert_eq!(empty.nearest(DVec3::ZERO, f64::INFINITY, &all), None);
    let (v, f) = cube(1.0, DVec3::ZERO);
    let bvh = mesh(v, f);
    assert_eq!(bvh.nearest(DVec3::ZERO, f64::INFINITY, &|_, _| false), None);
    // The radius itself is outside.
    assert_eq!(bvh.nearest(DVec3::ZERO, 1.0, &all), None);
    assert_eq!(bvh.nearest(DVec3::X, 0.0, &all), None);
    assert_eq!(bvh.nearest(DVec3::X * 3.0, 2.0 + 1e-15, &all).map(|n| (n.distance, n.p)), Some((2.0, DVec3::X)));

    let unwound = |b: &Bvh, accept: &dyn Fn(u32, u32) -> bool| {
        let query = || b.nearest(DVec3::splat(0.5), f64::INFINITY, accept);
        std::panic::catch_unwind(std::panic::AssertUnwindSafe(query)).unwrap_err()
    };
    let e = unwound(&bvh, &|_, _| panic!("no such taste"));
    assert_eq!(e.downcast_ref::<&str>(), Some(&"no such taste"));
    let mut b = SceneBuilder::new().unwrap();
    b.add_user(vec![(DVec3::ZERO, DVec3::ONE); 9], Arc::new(Panics)).unwrap();
    assert_eq!(unwound(&b.commit().unwrap(), &all).downcast_ref::<&str>(), Some(&"no such point"));
}

// ---- OpenVDB ----

fn fire() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/fire/blender_fire_0032.vdb")
}

/// A grid with leaves, tiles of every size and a skewed transform.
fn sample_grid(r: &mut Rng, name: &str) -> WriteGrid {
    let leaf = |origin, full: bool, r: &mut Rng| {
        let active = std::array::from_fn(|_| if full { u64::MAX } else { r.next_u64() });
        let values = (0..512)
            .map(|i| {
                let u = r.uniform() as f32;
                let on: [u64; 8] = active;
                if on[i >> 6] >> (i & 63) & 1 != 0 { u } else { 0.5 }
            })
            .collect();
        Leaf { origin, active, values }
    };
    WriteGrid {
        name: name.into(),
        channels: 1,
        world_from_index: DAffine3::from_mat3_translation(
            DMat3::from_rotation_x(0.3) * DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.15)),
            DVec3::new(5.0, -3.0, 2.0),
        ),
        background: 0.5,
        leaves: vec![leaf([0, 0, 0], true, r), leaf([8, 0, 0], false, r), leaf([-16, 8, -8], false, r)],
        tiles: vec![
            Tile { origin: [16, 0, 0], size: 8, value: [2.0, 0.0, 0.0], active: true },
            Tile { origin: [128, 0, 0], size: 128, value: [3.0, 0.0, 0.0], active: false },
            Tile { origin: [4096, 0, -4096], size: 4096, value: [4.0, 0.0, 0.0], active: true },
        ],
        class: "fog volume".into(),
        half: false,
    }
}

#[test]
fn vdb_round_trip_and_sampler() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("a.vdb");
    let mut r = Rng::keyed(21, 22, 23, 24);
    let grids = [sample_grid(&mut r, "density"), sample_grid(&mut r, "heat"), sample_grid(&mut r, "density")];
    for packing in [Compression::Default, Compression::None, Compression::Zip] {
        vdb::write_packed(&path, &grids, packing).unwrap();
        let infos = vdb::list(&path).unwrap();
        assert_eq!(infos.iter().map(|i| i.name.as_str()).collect::<Vec<_>>(), ["density", "heat", "density"]);
        for (i, want) in grids.iter().enumerate() {
            let got = vdb::load(&path, &Select::Index(i)).unwrap();
            let info = &infos[i];
            assert_eq!((info.value_type.as_str(), info.class.as_str(), got.channels), ("float", "fog volume", 1));
            assert_eq!((info.background[0], info.leaf_count, info.index), (0.5, 3, i));
            assert!(info.world_from_index.abs_diff_eq(want.world_from_index, 1e-15));
            let on: u64 = want.leaves.iter().flat_map(|l| l.active).map(|w| u64::from(w.count_ones())).sum();
            assert_eq!(info.active_voxels, on + 512 + 4096_u64.pow(3));
            assert_eq!(info.bbox.unwrap().1, [8191, 4095, 7].map(|x: i32| x));
            assert_eq!((got.info.active_voxels, got.info.memory > 0), (info.active_voxels, true));
            let mut leaves = got.leaves.clone();
            leaves.sort_by_key(|l| want.leaves.iter().position(|m| m.origin == l.origin));
            assert_eq!(leaves, want.leaves);
            let mut tiles = got.tiles.clone();
            tiles.sort_by_key(|t| t.size);
            assert_eq!(tiles, want.tiles);
        }
        assert_eq!(vdb::load(&path, &Select::Name("density".into())).unwrap().info.index, 0);
        assert_eq!(vdb::load(&path, &Select::NameIndex("density".into(), 1)).unwrap().info.index, 2);
        let e = vdb::load(&path, &Select::Name("smoke".into())).unwrap_err().to_string();
        assert!(e.contains("a.vdb") && e.contains("0: density, 1: heat, 2: density"), "{e}");

        // Trilinear by hand from what was loaded, against OpenVDB's own sampler.
        let g = vdb::load(&path, &Select::Index(0)).unwrap();
        let value = |p: [i32; 3]| -> f64 {
            let origin = p.map(|x| x.div_euclid(8) * 8);
            if let Some(l) = g.leaves.iter().find(|l| l.origin == origin) {
                let [x, y, z] = [0, 1, 2].map(|k| (p[k] - origin[k]) as usize);
                return f64::from(l.values[x << 6 | y << 3 | z]);
            }
            let within = |t: &&Tile| (0..3).all(|k| p[k] >= t.origin[k] && p[k] < t.origin[k] + t.size);
            g.tiles.iter().filter(within).min_by_key(|t| t.size).map_or(0.5, |t| f64::from(t.value[0]))
        };
        let points: Vec<DVec3> = (0..2000)
            .map(|_| {
                let x = DVec3::new(r.uniform() * 48.0 - 20.0, r.uniform() * 40.0 - 16.0, r.uniform() * 40.0 - 16.0);
                g.info.world_from_index.transform_point3(x)
            })
            .collect();
        let theirs = vdb::sample_box(&path, &Select::Index(0), &points).unwrap();
        for (p, t) in points.iter().zip(&theirs) {
            let x = g.info.index_from_world.transform_point3(*p);
            let (b, w) = (x.floor(), x - x.floor());
            let ours: f64 = (0..8)
                .map(|c| {
                    let c = [c & 1, c >> 1 & 1, c >> 2];
                    let weight: f64 = (0..3).map(|k| if c[k] == 1 { w[k] } else { 1.0 - w[k] }).product();
                    weight * value([0, 1, 2].map(|k| b[k] as i32 + c[k]))
                })
                .sum();
            // OpenVDB interpolates in f32.
            assert!((ours - t).abs() < 2e-5, "{ours} {t}");
        }
    }
}

#[test]
fn half_floats_and_writing_errors() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("h.vdb");
    let mut r = Rng::keyed(31, 32, 33, 34);
    let grid = WriteGrid { half: true, ..sample_grid(&mut r, "h") };
    vdb::write(&path, std::slice::from_ref(&grid)).unwrap();
    let got = vdb::load(&path, &Select::Index(0)).unwrap();
    assert!(got.info.stored_half && got.info.value_type == "float");
    let worst = got.leaves[0].values.iter().flat_map(|a| grid.leaves.iter().map(move |l| (a, l)));
    assert!(worst.count() > 0);
    let full = got.leaves.iter().find(|l| l.origin == [0; 3]).unwrap();
    for (a, b) in full.values.iter().zip(&grid.leaves[0].values) {
        assert!((a - b).abs() < 1e-3);
    }
    // Nothing is left behind by a write that fails.
    assert!(vdb::write(&dir.path().join("none/x.vdb"), std::slice::from_ref(&grid)).is_err());
    let crooked =
        WriteGrid { tiles: vec![Tile { origin: [1, 0, 0], size: 8, value: [0.0; 3], active: true }], ..grid.clone() };
    assert!(vdb::write(&dir.path().join("y.vdb"), &[crooked]).is_err());
    let flat = WriteGrid { world_from_index: DAffine3::from_scale(DVec3::new(1.0, 1.0, 0.0)), ..grid };
    assert!(vdb::write(&dir.path().join("z.vdb"), &[flat]).is_err());
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
}

#[test]
fn fire_is_read_whole() {
    let infos = vdb::list(&fire()).unwrap();
    let names: Vec<&str> = infos.iter().map(|i| i.name.as_str()).collect();
    assert_eq!(names.len(), 5, "{names:?}");
    let velocity = vdb::load(&fire(), &Select::Name("velocity".into())).unwrap();
    assert_eq!((velocity.channels, velocity.info.value_type.as_str(), velocity.info.stored_half), (3, "vec3s", true));
    assert!(velocity.leaves.iter().all(|l| l.values.len() == 3 * 512));
    for info in &infos {
        let g = vdb::load(&fire(), &Select::Index(info.index)).unwrap();
        let in_leaves: u64 = g.leaves.iter().flat_map(|l| l.active).map(|w| u64::from(w.count_ones())).sum();
        let in_tiles: u64 = g.tiles.iter().filter(|t| t.active).map(|t| (t.size as u64).pow(3)).sum();
        assert_eq!(in_leaves + in_tiles, info.active_voxels, "{}", info.name);
        assert_eq!(g.leaves.len() as u64, info.leaf_count);
    }
}

/// Load and list everything of a damaged file: an error or a result, never a crash.
fn try_all(path: &Path) -> (usize, usize) {
    let (mut good, mut bad) = (0, 0);
    match vdb::list(path) {
        Ok(infos) => {
            for i in 0..infos.len() {
                match vdb::load(path, &Select::Index(i)) {
                    Ok(_) => good += 1,
                    Err(e) => {
                        assert!(e.to_string().len() < 4096);
                        bad += 1;
                    }
                }
            }
        }
        Err(_) => {
            bad += 1;
            // A grid may be whole where another is not.
            for i in 0..4 {
                let _ = vdb::load(path, &Select::Index(i));
            }
        }
    }
    (good, bad)
}

#[test]
fn garbage_is_an_error() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("g.vdb");
    let mut r = Rng::keyed(41, 42, 43, 44);
    for n in [0, 1, 7, 8, 100, 10_000] {
        let mut bytes: Vec<u8> = (0..n).map(|_| r.next_u64() as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        assert!(vdb::list(&path).unwrap_err().to_string().contains("not a VDB file"));
        // The right magic number and format, then garbage.
        if n > 12 {
            bytes[..12].copy_from_slice(b" BDV\0\0\0\0\xe0\0\0\0");
            bytes[20] = 1;
            std::fs::write(&path, &bytes).unwrap();
            assert!(vdb::list(&path).is_err());
        }
    }
    assert!(vdb::list(dir.path()).unwrap_err().to_string().contains("not a file"));
    assert!(matches!(vdb::list(&dir.path().join("none.vdb")), Err(tyndall::error::Error::Io { .. })));
}

#[test]
fn cut_files_are_errors() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.vdb");
    let cut = dir.path().join("cut.vdb");
    let mut r = Rng::keyed(51, 52, 53, 54);
    for packing in [Compression::None, Compression::Default, Compression::Zip] {
        vdb::write_packed(&whole, &[sample_grid(&mut r, "a"), sample_grid(&mut r, "b")], packing).unwrap();
        let bytes = std::fs::read(&whole).unwrap();
        for k in 0..100 {
            let n = if k < 40 { k * 20 } else { bytes.len() * (k - 40) / 60 };
            std::fs::write(&cut, &bytes[..n]).unwrap();
            assert!(vdb::list(&cut).is_err(), "{n} of {} bytes", bytes.len());
            assert!(vdb::load(&cut, &Select::Index(0)).is_err());
        }
        std::fs::write(&cut, &bytes[..bytes.len() - 1]).unwrap();
        assert!(vdb::list(&cut).unwrap_err().to_string().contains("cut"));
    }
}

#[test]
fn flipped_bits_never_crash() {
    let dir = tempfile::tempdir().unwrap();
    let whole = dir.path().join("whole.vdb");
    let path = dir.path().join("flipped.vdb");
    let mut r = Rng::keyed(61, 62, 63, 64);
    let (mut good, mut bad) = (0, 0);
    for packing in [Compression::None, Compression::Default, Compression::Zip] {
        vdb::write_packed(&whole, &[sample_grid(&mut r, "a"), sample_grid(&mut r, "b")], packing).unwrap();
        let bytes = std::fs::read(&whole).unwrap();
        // Every byte of the frame (once: it does not depend on the packing), then places all over.
        let frame = if packing == Compression::None { 600 } else { 0 };
        for k in 0..frame + 200 {
            let mut b = bytes.clone();
            let at = if k < frame { k } else { (r.uniform() * b.len() as f64) as usize };
            b[at] ^= 1 << (r.next_u64() % 8);
            if k % 3 == 0 {
                b[at] = 0xff;
            }
            std::fs::write(&path, &b).unwrap();
            let (g, e) = try_all(&path);
            good += g;
            bad += e;
        }
    }
    assert!(good > 0 && bad > 0, "{good} loaded, {bad} errors");

    // A real file too: blosc, half floats, vectors, metadata of delayed loading.
    let bytes = std::fs::read(fire()).unwrap();
    for k in 0..40 {
        let mut b = bytes.clone();
        let at = if k < 20 { k * 97 } else { (r.uniform() * b.len() as f64) as usize };
        b[at] ^= 1 << (r.next_u64() % 8);
        std::fs::write(&path, &b).unwrap();
        try_all(&path);
    }
}

/// Files from elsewhere: `TYNDALL_VDB_DIR=... cargo test --test native -- --ignored --nocapture elsewhere`.
#[test]
#[ignore = "needs a directory of files"]
fn files_from_elsewhere_are_read() {
    let dir = std::env::var("TYNDALL_VDB_DIR").expect("TYNDALL_VDB_DIR");
    for entry in std::fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|e| e != "vdb") {
            continue;
        }
        println!("{}", path.display());
        for info in vdb::list(&path).unwrap() {
            let g = vdb::load(&path, &Select::Index(info.index)).unwrap();
            assert_eq!((g.info.active_voxels, g.info.bbox), (info.active_voxels, info.bbox));
            let in_leaves: u64 = g.leaves.iter().flat_map(|l| l.active).map(|w| u64::from(w.count_ones())).sum();
            let in_tiles: u64 = g.tiles.iter().filter(|t| t.active).map(|t| (t.size as u64).pow(3)).sum();
            assert_eq!(in_leaves + in_tiles, info.active_voxels);
            let (mut lo, mut hi) = (f32::INFINITY, f32::NEG_INFINITY);
            for l in &g.leaves {
                for i in (0..512).filter(|&i| l.is_active(i)) {
                    lo = lo.min(l.values[i * g.channels]);
                    hi = hi.max(l.values[i * g.channels]);
                }
            }
            println!(
                "  {} {} {} active {} (tiles {in_tiles}) leaf {} tiles {} bg {} bbox {:?} half {} {} memory {}\n    min/max in leaves {lo} {hi}\n    {:?}",
                info.name,
                info.value_type,
                info.class,
                info.active_voxels,
                info.leaf_count,
                g.tiles.len(),
                info.background[0],
                info.bbox,
                info.stored_half,
                info.transform,
                info.memory,
                info.world_from_index
            );
        }
    }
}

/// Rate of single-thread queries: `cargo test --release --test native -- --ignored --nocapture rate`.
/// A bumpy sphere of n x n quads.
fn bumpy(n: u32) -> (Arc<[DVec3]>, Arc<[[u32; 3]]>) {
    let v: Vec<DVec3> = (0..=n)
        .flat_map(|j| {
            (0..n).map(move |i| {
                let (a, b) = (
                    f64::from(i) / f64::from(n) * std::f64::consts::TAU,
                    f64::from(j) / f64::from(n) * std::f64::consts::PI,
                );
                let r = 1.0 + 0.05 * (20.0 * a).sin() * (20.0 * b).sin();
                DVec3::new(a.cos() * b.sin(), a.sin() * b.sin(), b.cos()) * r
            })
        })
        .collect();
    let at = |i: u32, j: u32| j * n + i % n;
    let f: Vec<[u32; 3]> = (0..n * n)
        .flat_map(|k| {
            let (i, j) = (k % n, k / n);
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        })
        .collect();
    (v.into(), f.into())
}

/// Seconds of this thread on the processor, which others' load does not change much.
fn cpu() -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap();
    stat.split(' ').next().unwrap().parse::<f64>().unwrap() * 1e-9
}

#[test]
#[ignore = "a measurement"]
fn query_rate_of_nearest_points() {
    let (v, f) = bumpy(224);
    let (faces, bvh) = (f.len(), mesh(v, f));
    let mut r = Rng::keyed(75, 76, 77, 78);
    for (height, radius) in [(1e-4, f64::INFINITY), (1e-2, f64::INFINITY), (0.3, f64::INFINITY), (0.3, 0.1)] {
        let points: Vec<DVec3> = (0..100_000)
            .map(|_| {
                let d = direction(&mut r);
                let hit = bvh.intersect(&Ray::new(DVec3::ZERO, d)).unwrap();
                d * (hit.t + height * (r.uniform() - 0.5))
            })
            .collect();
        let clock = cpu();
        let near = points.iter().filter(|p| bvh.nearest(**p, radius, &|_, _| true).is_some()).count();
        println!(
            "{faces} triangles, within {height}, radius {radius}: {:.0} ns, {near} near",
            (cpu() - clock) * 1e9 / 1e5
        );
    }
}

#[test]
#[ignore = "a measurement"]
fn query_rate_on_a_million_triangles() {
    let (v, f) = bumpy(708);
    let faces = f.len();
    let clock = std::time::Instant::now();
    let bvh = mesh(v, f);
    let build = clock.elapsed();
    let mut r = Rng::keyed(71, 72, 73, 74);
    let count = 1_000_000;
    let rays: Vec<Ray> =
        (0..count).map(|_| Ray::new(direction(&mut r) * 0.8 * r.uniform(), direction(&mut r))).collect();
    let clock = cpu();
    let hits = rays.iter().filter(|x| bvh.intersect(x).is_some()).count();
    let nearest = cpu() - clock;
    let clock = cpu();
    let shadows = rays.iter().filter(|x| bvh.occluded(x)).count();
    let any = cpu() - clock;
    println!(
        "{faces} triangles built in {build:?}, {} MB; incoherent rays from within: {:.2} M/s nearest, {:.2} M/s any; lost {} and {}",
        bvh.memory_bytes() >> 20,
        count as f64 * 1e-6 / nearest,
        count as f64 * 1e-6 / any,
        count - hits,
        count - shadows
    );
    assert!(count - hits <= 2 && count - shadows <= 2, "a closed mesh leaks");

    let clock = std::time::Instant::now();
    let small: Vec<Bvh> = (0..100)
        .map(|_| {
            let (v, f) = cube(1.0, DVec3::ZERO);
            mesh(v, f)
        })
        .collect();
    println!("a scene of 12 triangles, with its device: {:?}", clock.elapsed() / small.len() as u32);
}
