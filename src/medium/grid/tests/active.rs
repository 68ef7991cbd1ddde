use super::*;
use std::collections::{BTreeMap, HashSet};

/// A third of the voxels of two leaves, one tile that is active and one that is not; what is not active has values too.
fn patchy() -> (Grid, HashSet<[i32; 3]>, [[i32; 3]; 2]) {
    let mut rng = Rng::keyed(40, 0, 0, 0);
    let source =
        GridSource { channels: 1, world_from_index: transform(), background: [0.25; 3], bbox: None, clip: None };
    let (mut b, mut active) = (GridBuilder::new(source), HashSet::new());
    b.tile([16, 0, 0], 8, [2.0; 3]);
    b.tile([-8, -8, -8], 8, [3.0; 3]);
    b.activate([0; 8]);
    for origin in [[0, 0, 0], [8, 8, 0]] {
        let mask: Mask = std::array::from_fn(|_| rng.next_u64() & rng.next_u64());
        let values: Vec<f32> = (0..512).map(|_| rng.uniform() as f32).collect();
        b.leaf(origin, &values);
        b.activate(mask);
        let on = (0..512).filter(|i| mask[i >> 6] >> (i & 63) & 1 != 0).map(|i| i as i32);
        active.extend(on.map(|i| [origin[0] + (i >> 6), origin[1] + (i >> 3 & 7), origin[2] + (i & 7)]));
    }
    (b.build().unwrap(), active, [[16, 0, 0], [24, 8, 8]])
}

fn within(p: [i32; 3], [low, high]: [[i32; 3]; 2]) -> bool {
    (0..3).all(|a| low[a] <= p[a] && p[a] < high[a])
}

fn all(grid: &Grid) -> impl Iterator<Item = NodeId> + use<> {
    (0..grid.node_count() as u32).map(NodeId)
}

#[test]
fn active_voxels_are_numbered_without_gaps() {
    let (grid, active, tile) = patchy();
    assert_eq!(grid.active_count(), active.len() + 1);
    let mut seen = Vec::new();
    for id in all(&grid) {
        let p = grid.node_position(id);
        let index = grid.active_index(id);
        assert_eq!(index.is_some(), active.contains(&p) || within(p, tile), "{p:?}");
        seen.extend(index);
    }
    assert_eq!(seen, (0..grid.active_count() as u32).collect::<Vec<_>>());

    // What is written has these numbers at these places.
    let numbers: Vec<f64> = (0..grid.active_count()).map(|k| k as f64 + 1.0).collect();
    let (leaves, tiles) = grid.in_leaves(&numbers);
    assert_eq!((leaves.len(), tiles.len()), (2, 1));
    assert_eq!((tiles[0].origin, tiles[0].size, tiles[0].value[0], tiles[0].active), (tile[0], 8, 1.0, true));
    for l in &leaves {
        for i in 0..512 {
            let x = i as i32;
            let p = [l.origin[0] + (x >> 6), l.origin[1] + (x >> 3 & 7), l.origin[2] + (x & 7)];
            let k = grid.node_at(p).and_then(|id| grid.active_index(id));
            assert_eq!((l.is_active(i), l.values[i]), (k.is_some(), k.map_or(0.0, |k| k as f32 + 1.0)));
        }
    }
}

/// By active voxel and by stored value: the same weights at points and along rays.
#[test]
fn weights_of_active_voxels_are_those_of_their_nodes() {
    let dense: Vec<f32> = (0..9 * 7 * 11).map(|k| k as f32).collect();
    let place = transform() * DAffine3::from_scale(DVec3::splat(24.0));
    let smooth = Grid::from_dense(1, [9, 7, 11], &dense, place, Filter::Trilinear).unwrap();
    let nearest = Grid::from_dense(1, [9, 7, 11], &dense, place, Filter::Nearest).unwrap();
    for grid in [patchy().0, sparse(16, 3, 0.0, transform()).0, smooth, nearest] {
        let mut rng = Rng::keyed(42, 0, 0, 0);
        let mut seen = 0;
        for k in 0..400 {
            let o = transform().transform_point3(point(&mut rng, -10.0, 30.0));
            // Some along axes, where rays run in faces and corners of cells.
            let w =
                if k % 4 == 0 { DVec3::AXES[k % 3] * if k % 8 == 0 { 1.0 } else { -1.0 } } else { direction(&mut rng) };
            let (w, o) = (transform().transform_vector3(w), if k % 12 == 0 { transform().translation } else { o });
            let [mut a, mut b] = [vec![0.0; grid.active_count()], vec![0.0; grid.active_count()]];
            let mut node = |id, weight| {
                if let Some(k) = grid.active_index(id) {
                    a[k as usize] += weight;
                }
            };
            if k % 2 == 0 {
                grid.integrate_nodes(o, w, -40.0, 50.0, &mut node);
                for span in grid.single_spans(o, w, -40.0, 50.0) {
                    grid.integrate_active(&span, o, w, &mut |k, weight| b[k as usize] += weight);
                }
            } else {
                grid.nodes(o).into_iter().for_each(|(id, w)| id.into_iter().for_each(|id| node(id, w)));
                grid.active_nodes(o, |k, weight| b[k as usize] += weight);
            }
            let miss = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(miss <= 1e-12, "{k}: {miss}");
            seen += usize::from(a.iter().any(|x| *x != 0.0));
        }
        assert!(seen > 50, "{seen}");
    }
}

#[test]
fn dense_arrays_are_written_as_leaves() {
    let res = [9, 3, 17];
    let count = res.iter().product::<usize>();
    for channels in [1, 3] {
        let values: Vec<f32> = (0..count * channels).map(|k| k as f32 + 1.0).collect();
        let grid = Grid::from_dense(channels, res, &values, DAffine3::IDENTITY, Filter::Trilinear).unwrap();
        assert_eq!((grid.active_count(), grid.resolution()), (count, res));
        let (leaves, tiles) = grid.in_leaves(&values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>());
        assert_eq!((leaves.len(), tiles.len()), (2 * 3, 0));
        let mut written = BTreeMap::new();
        for l in &leaves {
            for i in (0..512).filter(|&i| l.is_active(i)) {
                let x = i as i32;
                let p = [l.origin[0] + (x >> 6), l.origin[1] + (x >> 3 & 7), l.origin[2] + (x & 7)].map(|x| x as usize);
                let at = (p[2] * res[1] + p[1]) * res[0] + p[0];
                assert_eq!(l.values[i * channels..][..channels], values[at * channels..][..channels]);
                written.insert(p, ());
            }
        }
        assert_eq!(written.len(), count);
    }
}

#[test]
fn dilation_adds_neighbours_and_changes_no_value() {
    let (grid, active, tile) = patchy();
    let wide = grid.dilated().unwrap();
    let beside = |p: [i32; 3], f: &dyn Fn([i32; 3]) -> bool| {
        (0..27).any(|k| f([p[0] + k / 9 - 1, p[1] + k / 3 % 3 - 1, p[2] + k % 3 - 1]))
    };
    let mut count = 0;
    for x in -12..40 {
        for y in -12..28 {
            for z in -12..20 {
                let p = [x, y, z];
                let is = wide.node_at(p).and_then(|id| wide.active_index(id)).is_some();
                assert_eq!(is, beside(p, &|q| active.contains(&q) || within(q, tile)), "{p:?}");
                count += usize::from(is && !within(p, tile));
                assert_eq!(wide.node_value(p), grid.node_value(p), "{p:?}");
            }
        }
    }
    assert_eq!(wide.active_count(), count + 1);
    let mut rng = Rng::keyed(41, 0, 0, 0);
    for _ in 0..2000 {
        let p = transform().transform_point3(point(&mut rng, -16.0, 40.0));
        assert!((wide.lookup(p) - grid.lookup(p)).abs() < 1e-14);
    }
    // All is background or active then: weights of active voxels and of the background rebuild the field.
    let dense = Grid::from_dense(1, [2; 3], &[1.0; 8], DAffine3::IDENTITY, Filter::Trilinear).unwrap();
    assert_eq!(dense.dilated().unwrap().active_count(), 8);
}
