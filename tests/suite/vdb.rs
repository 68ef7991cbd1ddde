//! VDB files through the whole loader: values, places and tiles against OpenVDB's own sampler.

use std::path::{Path, PathBuf};
use tyndall::error::Span;
use tyndall::math::rng::Rng;
use tyndall::math::{DAffine3, DMat3, DVec3};
use tyndall::native::vdb::{self, Leaf, Select, Tile, WriteGrid};
use tyndall::scene::compile::LoadOptions;
use tyndall::scene::volumes::load_vdb;

/// Random world points in and around a grid's box: our trilinear value against OpenVDB's BoxSampler, to its float rounding.
fn agrees(path: &Path, name: &str) {
    let grid = load_vdb(path, name, DAffine3::IDENTITY, &Span::default(), &LoadOptions::default(), &mut Vec::new())
        .unwrap_or_else(|e| panic!("{e}"));
    let (lo, hi) = grid.world_bounds().unwrap();
    let margin = 0.1 * (hi - lo);
    let mut rng = Rng::keyed(1, 0, 0, 0);
    let points: Vec<DVec3> = (0..20_000)
        .map(|_| lo - margin + (hi - lo + 2.0 * margin) * DVec3::new(rng.uniform(), rng.uniform(), rng.uniform()))
        .collect();
    let theirs = vdb::sample_box(path, &Select::Name(name.into()), &points).unwrap();
    let mut positive = 0;
    for (p, t) in points.iter().zip(&theirs) {
        let ours = grid.lookup(*p);
        positive += usize::from(*t > 0.0);
        assert!((ours - t).abs() <= 1e-6 * grid.max(), "{name} at {p}: {ours} {t}");
    }
    assert!(positive > 200, "{name}: only {positive} points inside");
}

#[test]
fn the_fire_is_where_openvdb_says() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/fire/blender_fire_0032.vdb");
    for name in ["density", "flame", "temperature"] {
        agrees(&path, name);
    }
}

#[test]
fn rotated_anisotropic_grids_with_tiles() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("turned.vdb");
    let matrix3 =
        DMat3::from_rotation_y(0.6) * DMat3::from_rotation_x(-0.3) * DMat3::from_diagonal(DVec3::new(0.1, 0.23, 0.07));
    let mut rng = Rng::keyed(2, 0, 0, 0);
    let leaves: Vec<Leaf> = [[-8, 0, 16], [0, 0, 16], [-16, 8, 24]]
        .into_iter()
        .map(|origin| Leaf { origin, active: [u64::MAX; 8], values: (0..512).map(|_| rng.uniform() as f32).collect() })
        .collect();
    let tiles = vec![Tile { origin: [8, 8, 16], size: 8, value: [0.7; 3], active: true }];
    let grid = WriteGrid {
        name: "density".into(),
        channels: 1,
        world_from_index: DAffine3 { matrix3, translation: DVec3::new(3.0, -2.0, 1.0) },
        background: 0.0,
        leaves,
        tiles,
        class: "fog volume".into(),
        half: false,
    };
    vdb::write(&path, &[grid]).unwrap();
    agrees(&path, "density");
}

#[test]
fn to_world_comes_after_the_file_s_own_transform() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes/fire/blender_fire_0032.vdb");
    let move_ = DAffine3 { matrix3: DMat3::from_rotation_z(1.0) * 2.0, translation: DVec3::new(5.0, 6.0, 7.0) };
    let load = |m| load_vdb(&path, "density", m, &Span::default(), &LoadOptions::default(), &mut Vec::new()).unwrap();
    let (own, moved) = (load(DAffine3::IDENTITY), load(move_));
    let mut rng = Rng::keyed(3, 0, 0, 0);
    for _ in 0..1000 {
        let p = DVec3::new(rng.uniform() * 2.0, rng.uniform() * 2.0, rng.uniform() * 4.0);
        assert!((own.lookup(p) - moved.lookup(move_.transform_point3(p))).abs() < 1e-9);
    }
}
