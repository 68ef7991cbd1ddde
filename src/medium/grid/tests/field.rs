//! Values, gradients, slots, construction.

use super::*;

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
    let (low, high) = (DVec3::new(1.5, 1.0, 1.25), DVec3::new(5.5, 6.0, 6.75));
    let clip = Some((low, high));
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

/// Values are given back while bricks are made, and none too early: leaves across segments, apron and tiles included.
#[test]
fn segments_of_values_make_the_same_bricks() {
    for channels in [1, 3] {
        let (whole, _, builder) = sparse(3, channels, 0.125, transform());
        for shift in [9, 10, 12] {
            let parts = builder.clone().in_segments(shift).build().unwrap();
            assert_eq!(parts.values(), whole.values(), "{channels} channels, 2^{shift} slots");
            assert_eq!(parts.bricks.nodes_for_test(), whole.bricks.nodes_for_test());
        }
    }
    let builder = sparse(3, 1, 0.125, transform()).2.in_segments(9);
    assert_eq!(builder.validate(Allowed { low: 0.0, high: 0.5 }), {
        let whole = sparse(3, 1, 0.125, transform()).2;
        whole.validate(Allowed { low: 0.0, high: 0.5 })
    });
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
    let bad = builder.validate(Allowed::NON_NEGATIVE).unwrap_err();
    assert_eq!(bad, BadVoxel { index: [10, 11, 12], channel: 1, value: -2.0, count: 2 });
    let bad = builder.validate(Allowed::FINITE).unwrap_err();
    assert!(bad.value.is_nan() && bad.count == 1 && bad.index == [15, 14, 12]);
}

/// A wave of k radians a voxel: the mean of `|∇f|` over that of f is known, whichever way the grid is turned and however large it is.
#[test]
fn roughness_is_the_mean_slope() {
    let n = 48;
    let (a, k) = (0.8, 0.6);
    let values: Vec<f32> = (0..n * n * n).map(|i| (1.0 + a * (k * f64::from(i % n)).sin()) as f32).collect();
    let turn = DAffine3::from_axis_angle(DVec3::new(0.3, 0.8, 0.5).normalize(), 0.7);
    for size in [1.0, 0.01] {
        let place = turn * DAffine3::from_scale(DVec3::splat(size));
        let grid = Grid::from_dense(1, [n as usize; 3], &values, place, Filter::Trilinear).unwrap();
        // The mean of |a k cos| is 2 a k / π, that of the wave 1, per voxel.
        let truth = 2.0 * a * k / std::f64::consts::PI * f64::from(n) / size;
        let found = grid.roughness();
        // Interpolation flattens slopes by 1 - k²/24; lines are few.
        assert!((found / truth - 1.0).abs() < 0.08, "{found} {truth}");
    }
    assert_eq!(Grid::empty(1).roughness(), 0.0);
}
