//! Bricks against a direct evaluation that knows nothing of bricks.

use super::*;
use crate::math::rng::Rng;
use crate::math::{DMat3, DVec3};
use proptest::prelude::*;
use std::collections::HashMap;

/// Nodes by position, and the plain trilinear formula.
struct Direct {
    channels: usize,
    background: [f32; 3],
    nodes: HashMap<[i32; 3], [f32; 3]>,
}

impl Direct {
    fn node(&self, p: [i32; 3]) -> [f64; 3] {
        self.nodes.get(&p).unwrap_or(&self.background).map(f64::from)
    }

    fn at(&self, p: DVec3) -> [f64; 3] {
        let i = p.floor();
        let f = p - i;
        let mut sum = [0.0; 3];
        for k in 0..8 {
            let bit = |a: usize| (k >> (2 - a) & 1) as f64;
            let w: f64 = (0..3).map(|a| if bit(a) == 1.0 { f[a] } else { 1.0 - f[a] }).product();
            let v = self.node([0, 1, 2].map(|a| (i[a] + bit(a)) as i32));
            for c in 0..3 {
                sum[c] += w * v[c];
            }
        }
        sum
    }
}

fn random(rng: &mut Rng, a: f64, b: f64) -> f64 {
    a + (b - a) * rng.uniform()
}

fn point(rng: &mut Rng, a: f64, b: f64) -> DVec3 {
    DVec3::new(random(rng, a, b), random(rng, a, b), random(rng, a, b))
}

fn direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = point(rng, -1.0, 1.0);
        if v.length() > 0.1 && v.length() < 1.0 {
            return v;
        }
    }
}

fn transform() -> DAffine3 {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 0.7);
    let stretch = DMat3::from_diagonal(DVec3::new(0.3, 1.7, -0.9));
    DAffine3 { matrix3: turn * stretch, translation: DVec3::new(3.0, -20.0, 11.0) }
}

/// Random leaves and tiles around the origin, negative positions included.
fn sparse(seed: u64, channels: usize, background: f32, world_from_index: DAffine3) -> (Grid, Direct, GridBuilder) {
    let mut rng = Rng::keyed(seed, 7, 0, 0);
    let background = [background, if channels == 1 { background } else { 2.0 * background }, background];
    let source = GridSource { channels, world_from_index, background, bbox: None, clip: None };
    let (mut builder, mut nodes) = (GridBuilder::new(source), HashMap::new());
    for x in -2..3 {
        for y in -2..2 {
            for z in -3..1 {
                let (origin, u) = ([8 * x, 8 * y, 8 * z], rng.uniform());
                let value: Vec<f32> = (0..512 * channels).map(|_| rng.uniform() as f32).collect();
                let at = |l: i32| [origin[0] + (l >> 6), origin[1] + (l >> 3 & 7), origin[2] + (l & 7)];
                let triple = |l: usize| [0, 1, 2].map(|c| value[l * channels + c.min(channels - 1)]);
                if u < 0.4 {
                    builder.leaf(origin, &value);
                    nodes.extend((0..512).map(|l| (at(l as i32), triple(l))));
                } else if u < 0.7 {
                    builder.tile(origin, 8, triple(0));
                    nodes.extend((0..512).map(|l| (at(l), triple(0))));
                }
            }
        }
    }
    // A large tile beside them, in which whole bricks are constant, with a leaf cut into it.
    builder.tile([24, -16, -16], 32, [0.25; 3]);
    let all = 0..32;
    for p in all.clone().flat_map(|x| all.clone().flat_map(move |y| (0..32).map(move |z| [24 + x, y - 16, z - 16]))) {
        nodes.insert(p, [0.25; 3]);
    }
    builder.leaf([32, -8, -8], &vec![0.75; 512 * channels]);
    for l in 0..512 {
        nodes.insert([32 + (l >> 6), -8 + (l >> 3 & 7), -8 + (l & 7)], [0.75; 3]);
    }
    (builder.clone().build().unwrap(), Direct { channels, background, nodes }, builder)
}

#[test]
fn lookups_agree_with_a_direct_evaluation() {
    for (seed, channels, background) in [(1, 1, 0.0), (2, 1, 0.4), (3, 3, 0.0), (4, 3, 0.3)] {
        let (grid, direct, _) = sparse(seed, channels, background, DAffine3::IDENTITY);
        let (turned, ..) = sparse(seed, channels, background, transform());
        let mut rng = Rng::keyed(seed, 8, 0, 0);
        for _ in 0..20_000 {
            let mut p = point(&mut rng, -30.0, 62.0);
            if rng.uniform() < 0.2 {
                p.x = p.x.round();
            }
            let expected = direct.at(p);
            let (plain, world) = (grid.lookup3(p), turned.lookup3(transform().transform_point3(p)));
            for c in 0..direct.channels {
                assert!((plain[c] - expected[c]).abs() <= 4e-15, "{p} {plain:?} {expected:?}");
                assert!((world[c] - expected[c]).abs() <= 4e-13, "{p} {world:?} {expected:?}");
            }
            assert_eq!(grid.lookup(p), plain[0]);
            assert!((grid.lookup_index(p) - expected[0]).abs() <= 4e-15);
        }
        // At nodes the stored values come back exactly.
        for (p, v) in &direct.nodes {
            let q = DVec3::from(p.map(f64::from));
            assert_eq!(grid.lookup3(q)[..channels], v.map(f64::from)[..channels]);
        }
    }
}

#[test]
fn a_crop_leaves_background() {
    let source = GridSource {
        channels: 1,
        world_from_index: DAffine3::IDENTITY,
        background: [0.5; 3],
        bbox: Some(([2, 0, 0], [5, 7, 30])),
        clip: None,
    };
    let mut builder = GridBuilder::new(source);
    builder.leaf([0; 3], &[2.0; 512]);
    builder.tile([0, 0, 8], 8, [3.0; 3]);
    let grid = builder.build().unwrap();
    assert_eq!(grid.lookup(DVec3::new(1.0, 3.0, 3.0)), 0.5);
    assert_eq!(grid.lookup(DVec3::new(2.0, 3.0, 3.0)), 2.0);
    assert_eq!(grid.lookup(DVec3::new(1.5, 3.0, 3.0)), 1.25);
    assert_eq!(grid.lookup(DVec3::new(5.0, 3.0, 12.5)), 3.0);
    assert_eq!(grid.lookup(DVec3::new(6.0, 3.0, 12.5)), 0.5);
    assert_eq!(grid.node_at([1, 3, 3]), None);
    assert_eq!(grid.values()[0], 0.5);
    assert_eq!((grid.min(), grid.max()), (0.5, 3.0));
}

#[test]
fn gradients_agree_with_differences() {
    let (grid, ..) = sparse(5, 3, 0.2, transform());
    let mut rng = Rng::keyed(5, 8, 0, 0);
    let h = 1e-6;
    for _ in 0..2000 {
        let p = transform().transform_point3(point(&mut rng, -16.0, 40.0));
        let gradient = grid.gradient3(p);
        for a in 0..3 {
            let e = DVec3::AXES[a] * h;
            let (up, down, mid) = (grid.lookup3(p + e), grid.lookup3(p - e), grid.lookup3(p));
            for c in 0..3 {
                let (right, left) = ((up[c] - mid[c]) / h, (mid[c] - down[c]) / h);
                // Beside a face only one side need agree.
                let miss = (gradient[c][a] - right).abs().min((gradient[c][a] - left).abs());
                assert!(miss < 1e-4, "{} {right} {left}", gradient[c][a]);
            }
        }
    }
}

#[test]
fn node_weights_rebuild_the_field() {
    for (channels, background) in [(1, 0.3), (3, 0.2)] {
        let (grid, direct, _) = sparse(6, channels, background, transform());
        let values = grid.values();
        let mut rng = Rng::keyed(6, 8, 0, 0);
        for _ in 0..5000 {
            let p = transform().transform_point3(point(&mut rng, -26.0, 60.0));
            let nodes = grid.nodes(p);
            assert!((nodes.iter().map(|n| n.1).sum::<f64>() - 1.0).abs() < 1e-14);
            let value = |id: Option<NodeId>| match id {
                Some(id) => f64::from(values[id.0 as usize * channels]),
                None => f64::from(background),
            };
            let sum: f64 = nodes.iter().map(|&(id, w)| w * value(id)).sum();
            assert!((sum - grid.lookup(p)).abs() < 1e-12);
        }
        // A node has one slot, a slot of a leaf one node.
        let mut seen = HashMap::new();
        for p in direct.nodes.keys() {
            let id = grid.node_at(*p).unwrap();
            let back = grid.node_position(id);
            assert_eq!(grid.node_at(back), Some(id));
            *seen.entry(id).or_insert(0) += 1;
        }
        assert_eq!(seen.values().filter(|n| **n != 1).count(), seen.keys().filter(|id| seen[id] >= 512).count());
        let again = grid.with_values(&values).unwrap();
        assert_eq!(again.bricks.nodes_for_test(), grid.bricks.nodes_for_test());
    }
}

#[test]
fn spans_partition_awkward_rays() {
    let (grid, ..) = sparse(9, 1, 0.0, DAffine3::IDENTITY);
    let (low, high) = grid.world_bounds().unwrap();
    assert_eq!((low, high), (DVec3::new(-24.0, -24.0, -32.0), DVec3::new(56.0, 16.0, 16.0)));
    let cases = [
        (DVec3::new(-100.0, 0.5, 0.5), DVec3::X),
        (DVec3::new(-100.0, 8.0, 8.0), DVec3::X),
        (DVec3::new(100.0, 8.0, -8.0), -DVec3::X),
        (DVec3::new(8.0, 8.0, 8.0), DVec3::ONE),
        (DVec3::new(8.0, 8.0, 8.0), -DVec3::ONE),
        (DVec3::new(-24.0, -24.0, -32.0), DVec3::new(1.0, 1.0, 0.0)),
        (DVec3::new(0.0, 0.0, 0.0), DVec3::new(1e-300, 1.0, -1e-320)),
        (DVec3::new(3.0, 4.0, 5.0), DVec3::ZERO),
        (DVec3::new(0.0, 16.0, 0.0), DVec3::X),
        (DVec3::new(0.0, -24.0, 0.0), DVec3::X),
    ];
    for (o, w) in cases {
        check_partition(&grid, o, w, -50.0, 220.0);
        check_partition(&grid, o, w, 0.0, 3.5);
        check_partition(&grid, o, w, 1.0, 1.0);
        let sum = grid.integrate(o, w, -50.0, 220.0);
        assert!(sum.is_finite());
    }
    // The upper faces are outside, the lower ones inside.
    assert_eq!(grid.spans(DVec3::new(0.0, 16.0, 0.0), DVec3::X, 0.0, 9.0).count(), 0);
    assert_ne!(grid.spans(DVec3::new(0.0, -24.0, 0.0), DVec3::X, 0.0, 9.0).count(), 0);
    // Not a number in, not a number out.
    assert!(grid.integrate(DVec3::NAN, DVec3::X, 0.0, 1.0).is_nan());
    assert!(grid.lookup(DVec3::new(0.0, f64::NAN, 0.0)).is_nan());
}

/// Spans follow each other, cover the box, and bound the field.
fn check_partition(grid: &Grid, o: DVec3, w: DVec3, t0: f64, t1: f64) {
    for spans in [grid.spans(o, w, t0, t1), grid.single_spans(o, w, t0, t1)] {
        let spans: Vec<Span> = spans.collect();
        for pair in spans.windows(2) {
            assert_eq!(pair[0].t1, pair[1].t0);
        }
        for s in &spans {
            assert!(s.t0 < s.t1 && t0 <= s.t0 && s.t1 <= t1);
            for k in 1..10 {
                let t = s.t0 + (s.t1 - s.t0) * f64::from(k) / 10.0;
                let v = grid.lookup(o + t * w);
                let slack = 1e-11 * grid.max();
                assert!(s.min - slack <= v && v <= s.max + slack, "{v} {s:?}");
            }
        }
        // Whatever lies clearly inside is covered, whatever lies clearly outside is not.
        let (low, high) = grid.world_bounds().unwrap();
        for k in 0..=200 {
            let t = t0 + (t1 - t0) * f64::from(k) / 200.0;
            let p = o + t * w;
            let inside = (p - low).min_element().min((high - p).min_element());
            let covered = spans.iter().filter(|s| s.t0 <= t && t < s.t1).count();
            if inside > 1e-9 && t < t1 {
                assert_eq!(covered, 1, "{t}");
            } else if inside < -1e-9 {
                assert_eq!(covered, 0, "{t}");
            }
        }
    }
}

/// Integral by Gauss quadrature on pieces far shorter than a cell, cut at every cell face.
fn quadrature(direct: &Direct, o: DVec3, w: DVec3, t0: f64, t1: f64) -> [f64; 3] {
    let mut cuts = vec![t0, t1];
    for a in 0..3 {
        for k in -80..120 {
            let t = (f64::from(k) - o[a]) / w[a];
            if t0 < t && t < t1 {
                cuts.push(t);
            }
        }
    }
    cuts.sort_by(f64::total_cmp);
    let mut sum = [0.0; 3];
    let rule = [(-0.6f64.sqrt(), 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.6f64.sqrt(), 5.0 / 9.0)];
    for pair in cuts.windows(2) {
        let half = 0.5 * (pair[1] - pair[0]);
        for (x, weight) in rule {
            let v = direct.at(o + w * (0.5 * (pair[0] + pair[1]) + x * half));
            for c in 0..3 {
                sum[c] += half * weight * v[c];
            }
        }
    }
    sum
}

#[test]
fn integrals_agree_with_quadrature() {
    for (seed, channels, background) in [(11, 1, 0.0), (12, 1, 0.4), (13, 3, 0.3)] {
        let (grid, direct, _) = sparse(seed, channels, background, transform());
        let mut rng = Rng::keyed(seed, 8, 0, 0);
        for _ in 0..300 {
            let (o, w) = (point(&mut rng, -60.0, 60.0), direction(&mut rng));
            let target = point(&mut rng, -20.0, 40.0);
            let (t0, t1) = (random(&mut rng, -1.0, 0.2), random(&mut rng, 0.2, 2.0));
            let (o, w) = if rng.uniform() < 0.5 { (o, target - o) } else { (target, w * 30.0) };
            let expected = quadrature(&direct, o, w, t0, t1);
            let (wo, ww) = (transform().transform_point3(o), transform().transform_vector3(w));
            let got = grid.integrate3(wo, ww, t0, t1);
            for c in 0..channels {
                assert!((got[c] - expected[c]).abs() <= 1e-11 * (t1 - t0), "{got:?} {expected:?}");
            }
            assert_eq!(grid.integrate(wo, ww, t0, t1), got[0]);
            let spans: f64 = grid.spans(wo, ww, t0, t1).map(|s| grid.integrate_span(&s, wo, ww)).sum();
            assert!((spans - got[0]).abs() <= 1e-13 * got[0].abs());
            // Along an axis, on a face, there and back.
            let back = grid.integrate3(wo + ww, -ww, 1.0 - t1, 1.0 - t0);
            assert!((back[0] - got[0]).abs() <= 1e-11);
        }
    }
}

#[test]
fn node_integrals_sum_to_the_integral() {
    for channels in [1, 3] {
        let (grid, ..) = sparse(15, channels, 0.0, transform());
        let values = grid.values();
        let mut rng = Rng::keyed(15, 8, 0, 0);
        for _ in 0..200 {
            let (o, w) = (point(&mut rng, -30.0, 30.0), direction(&mut rng));
            let (o, w) = (transform().transform_point3(o), transform().transform_vector3(w));
            let mut sum = 0.0;
            grid.integrate_nodes(o, w, -70.0, 60.0, &mut |id, weight| {
                sum += weight * f64::from(values[id.0 as usize * channels]);
            });
            let whole = grid.integrate(o, w, -70.0, 60.0);
            assert!((sum - whole).abs() <= 1e-12 * whole.abs().max(1.0), "{sum} {whole}");
        }
    }
}

#[test]
fn inversion_undoes_integration() {
    for (channels, background) in [(1, 0.0), (1, 0.4), (3, 0.0)] {
        let (grid, ..) = sparse(17, channels, background, transform());
        let mut rng = Rng::keyed(17, 8, 0, 0);
        for _ in 0..500 {
            let (o, w) = (point(&mut rng, -30.0, 30.0), direction(&mut rng));
            let (o, w) = (transform().transform_point3(o), transform().transform_vector3(w));
            let (t0, t1) = (random(&mut rng, -50.0, 0.0), random(&mut rng, 0.0, 50.0));
            let whole = grid.integrate(o, w, t0, t1);
            let target = whole * rng.uniform();
            let t = grid.invert(o, w, t0, t1, target).unwrap();
            let again = grid.integrate(o, w, t0, t);
            assert!((again - target).abs() <= 1e-13 * whole, "{again} {target}");
            assert_eq!(grid.invert(o, w, t0, t1, whole * 1.001 + 1.0), Err(whole));
            if whole > 0.0 {
                let end = grid.invert(o, w, t0, t1, whole).unwrap();
                assert!(end <= t1 && (grid.integrate(o, w, t0, end) - whole).abs() <= 1e-13 * whole);
            }
            if channels == 3 {
                let all = grid.integrate3(o, w, t0, t1);
                let t = grid.invert_channel(2, o, w, t0, t1, 0.5 * all[2]).unwrap();
                assert!((grid.integrate3(o, w, t0, t)[2] - 0.5 * all[2]).abs() <= 1e-13 * all[2]);
            }
        }
    }
}

#[test]
fn a_linear_ramp_has_the_known_integral_and_inverse() {
    // sigma(x) = a + b x between voxel centres: the integral is a t + b t^2 / 2.
    let (a, b, n) = (0.5, 0.25, 20);
    let values: Vec<f32> = (0..n * 2 * 2).map(|i| (a + b * (i % n) as f64) as f32).collect();
    let placed = DAffine3::from_scale(DVec3::new(n as f64, 1.0, 1.0));
    let grid = Grid::from_dense(1, [n, 2, 2], &values, placed, Filter::Trilinear).unwrap();
    let o = DVec3::new(0.5, 0.4, 0.6);
    for t in [1e-6, 0.3, 1.0, 7.7, 19.0] {
        let expected = a * t + 0.5 * b * t * t;
        assert!((grid.integrate(o, DVec3::X, 0.0, t) - expected).abs() < 1e-13 * expected);
        let back = grid.invert(o, DVec3::X, 0.0, 19.0, expected).unwrap();
        assert!((back - t).abs() <= 1e-13 * t, "{back} {t}");
    }
    assert!((grid.gradient(o + 3.3 * DVec3::X) - b * DVec3::X).length() < 1e-13);
}

fn one_voxel(value: f32, rest: f32) -> Grid {
    let n = 24;
    let mut values = vec![rest; n * n * n];
    values[(12 * n + 12) * n + 12] = value;
    Grid::from_dense(1, [n; 3], &values, DAffine3::from_scale(DVec3::splat(n as f64)), Filter::Trilinear).unwrap()
}

#[test]
fn contrast_of_1e12_stays_in_its_cells() {
    let grid = one_voxel(1e6, 1e-6);
    let centre = DVec3::splat(12.5);
    let faint = f64::from(1e-6f32);
    let mut rng = Rng::keyed(21, 0, 0, 0);
    let mut near = 0;
    for k in 0..4000 {
        // Through the neighbourhood of the voxel, but beside its eight cells; along axes and faces as well.
        let mut w = direction(&mut rng).normalize();
        let mut offset = w.cross(direction(&mut rng)).normalize() * random(&mut rng, 1.75, 3.0);
        if k % 4 == 0 {
            w = DVec3::AXES[k / 4 % 3];
            offset = DVec3::AXES[(k / 4 + 1) % 3] * [1.0, -1.0, 1.01, 2.0][k / 16 % 4];
        }
        let o = centre + offset - 5.0 * w;
        let sum = grid.integrate(o, w, 0.0, 10.0);
        assert!((sum - 10.0 * faint).abs() <= 1e-12 * 10.0 * faint, "{o} {w} {sum}");
        let t = grid.invert(o, w, 0.0, 10.0, 4.0 * faint).unwrap();
        assert!((t - 4.0).abs() < 1e-11);
        near += usize::from(grid.spans(o, w, 0.0, 10.0).any(|s| s.max > 1e5));
    }
    assert!(near > 1000, "the rays pass the bricks of the voxel");
    let through = grid.integrate(centre - 5.0 * DVec3::X, DVec3::X, 0.0, 10.0);
    assert!((through - (1e6 + 9.0 * faint)).abs() < 1e-6);
}

#[test]
fn grids_of_nothing() {
    let source =
        GridSource { channels: 1, world_from_index: transform(), background: [0.0; 3], bbox: None, clip: None };
    let none = GridBuilder::new(source.clone()).build().unwrap();
    let zero = one_voxel(0.0, 0.0);
    for grid in [none, zero, Grid::empty(1), Grid::empty(3)] {
        let (o, w) = (DVec3::new(-4.0, 3.0, 2.0), DVec3::new(1.0, 0.2, 0.1));
        assert_eq!(grid.lookup(o + 9.0 * w), 0.0);
        assert_eq!(grid.integrate3(o, w, 0.0, 1e3), [0.0; 3]);
        assert_eq!(grid.invert(o, w, 0.0, 1e3, 1e-300), Err(0.0));
        assert_eq!((grid.min(), grid.max(), grid.max3()), (0.0, 0.0, [0.0; 3]));
        assert!(grid.spans(o, w, 0.0, 1e3).all(|s| s.constant && s.max == 0.0));
        assert!(grid.spans(o, w, 0.0, 1e3).count() <= 1);
        let lit = |id: NodeId| assert!((id.0 as usize) < grid.node_count());
        grid.integrate_nodes(o, w, 0.0, 1e3, &mut |id, _| lit(id));
    }
    let fog = Grid::constant(3, [1.0, 2.0, 3.0]);
    assert_eq!(fog.integrate3(DVec3::ZERO, DVec3::X, 1.0, 3.0), [2.0, 4.0, 6.0]);
    assert_eq!(fog.invert_channel(1, DVec3::ZERO, DVec3::X, 1.0, f64::INFINITY, 4.0), Ok(3.0));
    assert_eq!((fog.min(), fog.max(), fog.max3()), (1.0, 3.0, [1.0, 2.0, 3.0]));
    assert_eq!(fog.nodes(DVec3::ZERO)[0], (None, 1.0));
    assert!(fog.world_bounds().is_none());
}

#[test]
fn a_single_voxel_from_file_and_from_leaf() {
    let unit = Grid::from_dense(1, [1; 3], &[2.0], DAffine3::IDENTITY, Filter::Trilinear).unwrap();
    assert_eq!(unit.lookup(DVec3::new(0.01, 0.99, 0.5)), 2.0);
    assert_eq!(unit.lookup(DVec3::new(0.01, 1.01, 0.5)), 0.0);
    let w = DVec3::new(1.0, 1.0, 1.0);
    assert!((unit.integrate(-w, w, 0.0, 9.0) - 2.0).abs() < 1e-14);
    assert_eq!(unit.node_count(), 1);
    let mut total = 0.0;
    unit.integrate_nodes(-w, w, 0.0, 9.0, &mut |id, x| total += x * f64::from(id.0 + 1));
    assert!((total - 1.0).abs() < 1e-14);

    // A tent: the integral through the node along an axis is its value, (1-|x|)^3 along the diagonal gives a half.
    let source =
        GridSource { channels: 1, world_from_index: DAffine3::IDENTITY, background: [0.0; 3], bbox: None, clip: None };
    let mut builder = GridBuilder::new(source);
    let mut leaf = [0.0; 512];
    leaf[0] = 3.0;
    builder.leaf([-8, 0, 8], &leaf);
    let grid = builder.build().unwrap();
    let node = DVec3::new(-8.0, 0.0, 8.0);
    assert!((grid.integrate(node - 4.0 * DVec3::Y, DVec3::Y, 0.0, 8.0) - 3.0).abs() < 1e-14);
    assert!((grid.integrate(node - 4.0 * w, w, 0.0, 8.0) - 1.5).abs() < 1e-14);
    assert_eq!(grid.lookup(node + DVec3::new(-0.5, 0.5, -0.5)), 0.375);
}

#[test]
fn a_clip_box_cuts_sharply() {
    let clip = Some((DVec3::new(1.5, 1.0, 1.25), DVec3::new(5.5, 6.0, 6.75)));
    for background in [0.0, 0.5] {
        let source = GridSource {
            channels: 1,
            world_from_index: DAffine3::IDENTITY,
            background: [background; 3],
            bbox: None,
            clip,
        };
        let mut builder = GridBuilder::new(source);
        builder.leaf([0; 3], &[2.0; 512]);
        let grid = builder.build().unwrap();
        let (low, high) = clip.unwrap();
        assert_eq!(grid.world_bounds(), clip);
        assert_eq!((grid.lookup(low), grid.lookup(high)), (2.0, 0.0));
        assert_eq!(grid.nodes(high), [(None, 0.0); 8]);
        assert!((grid.integrate(DVec3::new(-9.0, 3.0, 3.0), DVec3::X, 0.0, 99.0) - 8.0).abs() < 1e-13);
        // In a face: the lower ones belong to the box, the upper ones do not.
        assert_eq!(grid.integrate(DVec3::new(-9.0, 1.0, 3.0), DVec3::X, 0.0, 99.0), 8.0);
        assert_eq!(grid.integrate(DVec3::new(-9.0, 6.0, 3.0), DVec3::X, 0.0, 99.0), 0.0);
        // Through an edge and past it.
        let w = DVec3::new(1.0, -1.0, 0.0);
        assert!(grid.integrate(DVec3::new(1.5, 6.0, 3.0) - w, -w, -9.0, 9.0).abs() > 1.0);
        let grazing = DVec3::new(1.0, 1.0, 0.0);
        assert!(grid.integrate(DVec3::new(1.5, 6.0, 3.0), grazing, -9.0, 9.0).abs() < 1e-14);
        assert!(grid.integrate(DVec3::new(1.5, 5.999, 3.0), grazing, -9.0, 9.0) > 0.0);
    }
    // Where there are no nodes but a background, the box is full of it.
    let source =
        GridSource { channels: 1, world_from_index: DAffine3::IDENTITY, background: [0.5; 3], bbox: None, clip };
    let grid = GridBuilder::new(source).build().unwrap();
    assert_eq!(grid.integrate(DVec3::new(-9.0, 3.0, 3.0), DVec3::X, 0.0, 99.0), 2.0);
}

#[test]
fn dense_arrays_are_read_as_mitsuba_reads_them() {
    let res = [3, 4, 5];
    let mut rng = Rng::keyed(31, 0, 0, 0);
    let values: Vec<f32> = (0..180).map(|_| rng.uniform() as f32).collect();
    let placed = transform();
    let smooth = Grid::from_dense(3, res, &values, placed, Filter::Trilinear).unwrap();
    let nearest = Grid::from_dense(3, res, &values, placed, Filter::Nearest).unwrap();
    let at = |i: [i64; 3], c: usize| {
        let [x, y, z] = [0, 1, 2].map(|a| i[a].clamp(0, res[a] as i64 - 1) as usize);
        f64::from(values[((z * res[1] + y) * res[0] + x) * 3 + c])
    };
    for _ in 0..5000 {
        let u = point(&mut rng, 0.0, 1.0);
        let p = placed.transform_point3(u);
        let q = u * DVec3::from(res.map(|n| n as f64));
        let cell = q.floor();
        let (low, f) = ((q - 0.5).floor(), (q - 0.5) - (q - 0.5).floor());
        for c in 0..3 {
            assert_eq!(nearest.lookup3(p)[c], at([0, 1, 2].map(|a| cell[a] as i64), c));
            let mut sum = 0.0;
            for k in 0..8 {
                let bit = [0, 1, 2].map(|a| k >> a & 1);
                let w: f64 = (0..3).map(|a| if bit[a] == 1 { f[a] } else { 1.0 - f[a] }).product();
                sum += w * at([0, 1, 2].map(|a| low[a] as i64 + bit[a]), c);
            }
            assert!((smooth.lookup3(p)[c] - sum).abs() < 1e-13);
        }
        // The nearest filter integrates exactly, too: midpoints of fine steps almost do.
        assert_eq!(nearest.gradient(p), DVec3::ZERO);
        let w: f64 = smooth.nodes(p).iter().map(|n| n.1).sum();
        assert!((w - 1.0).abs() < 1e-14);
    }
    let (o, w) = (placed.transform_point3(DVec3::new(-0.1, 0.2, 0.3)), placed.transform_vector3(DVec3::ONE));
    let steps = 200_000;
    let sum: f64 = (0..steps).map(|k| nearest.lookup(o + w * ((k as f64 + 0.5) / steps as f64))).sum();
    assert!((nearest.integrate(o, w, 0.0, 1.0) - sum / steps as f64).abs() < 1e-4);
    assert_eq!(smooth.values(), values);
    assert_eq!(nearest.values(), values);
    assert_eq!(smooth.node_at([1, 2, 3]), Some(NodeId((3 * 4 + 2) * 3 + 1)));
    assert!(Grid::from_dense(1, res, &values, placed, Filter::Trilinear).is_err());
}

#[test]
fn faults_are_reported() {
    let source = |channels| GridSource {
        channels,
        world_from_index: DAffine3::IDENTITY,
        background: [0.0; 3],
        bbox: None,
        clip: None,
    };
    let fault = |channels, f: &dyn Fn(&mut GridBuilder)| {
        let mut builder = GridBuilder::new(source(channels));
        f(&mut builder);
        builder.build().unwrap_err()
    };
    assert!(fault(2, &|_| ()).contains("channels"));
    assert!(fault(1, &|b| b.leaf([0; 3], &[0.0; 511])).contains("511"));
    assert!(fault(1, &|b| b.leaf([4, 0, 0], &[0.0; 512])).contains("multiple"));
    assert!(fault(1, &|b| b.tile([0; 3], 12, [0.0; 3])).contains("12"));
    assert!(fault(1, &|b| (0..2).for_each(|_| b.leaf([0; 3], &[0.0; 512]))).contains("two leaves"));
    assert!(
        fault(1, &|b| [-1, 1].iter().for_each(|s| b.leaf([s * 1_000_000_000; 3], &[0.0; 512]))).contains("too many")
    );
    let mut flat = source(1);
    flat.world_from_index = DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0));
    assert!(GridBuilder::new(flat).build().unwrap_err().contains("inverted"));

    let mut builder = GridBuilder::new(source(3));
    builder.tile([-8; 3], 8, [1.0; 3]);
    let mut leaf = [0.5; 1536];
    (leaf[(2 << 6 | 3 << 3 | 4) * 3 + 1], leaf[1500]) = (-2.0, f32::NAN);
    builder.leaf([8; 3], &leaf);
    let bad = builder.validate(true).unwrap_err();
    assert_eq!(bad, BadVoxel { index: [10, 11, 12], channel: 1, value: -2.0, count: 2 });
    let bad = builder.validate(false).unwrap_err();
    assert!(bad.value.is_nan() && bad.count == 1 && bad.index == [15, 14, 12]);
}

proptest! {
    #[test]
    fn spans_partition(seed in 0u64..8, o in prop::array::uniform3(-70.0..70.0f64),
                       w in prop::array::uniform3(prop_oneof![Just(0.0), -1.0..1.0f64, Just(1e-12)]),
                       snap in any::<bool>(), t0 in -80.0..80.0f64, length in 0.0..160.0f64) {
        let (grid, ..) = sparse(seed, 1, 0.0, DAffine3::IDENTITY);
        let o = DVec3::from(o);
        let o = if snap { (o / 4.0).round() * 4.0 } else { o };
        check_partition(&grid, o, DVec3::from(w), t0, t0 + length);
    }

    #[test]
    fn inversion_round_trip(seed in 0u64..8, o in prop::array::uniform3(-30.0..60.0f64),
                            w in prop::array::uniform3(prop_oneof![Just(0.0), -1.0..1.0f64]),
                            t0 in -60.0..0.0f64, t1 in 0.0..60.0f64, u in 0.0..1.0f64) {
        let (grid, ..) = sparse(seed, 1, 0.0, DAffine3::IDENTITY);
        let (o, w) = (DVec3::from(o), DVec3::from(w));
        let whole = grid.integrate(o, w, t0, t1);
        let t = grid.invert(o, w, t0, t1, u * whole);
        prop_assert!(t.is_ok());
        let again = grid.integrate(o, w, t0, t.unwrap());
        prop_assert!((again - u * whole).abs() <= 1e-13 * whole);
    }
}
