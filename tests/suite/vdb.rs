//! VDB files through the whole loader: values, places and tiles against OpenVDB's own sampler.

use std::path::{Path, PathBuf};
use tyndall::error::Span;
use tyndall::math::rng::Rng;
use tyndall::math::{DAffine3, DMat3, DVec3};
use tyndall::medium::grid::{Allowed, Grid};
use tyndall::native::vdb::{self, Leaf, Select, Tile, WriteGrid};
use tyndall::render::family::Family;
use tyndall::scene::compile::LoadOptions;
use tyndall::scene::volumes::{Loading, VdbFile, load_vdb};

/// The loader as media use it.
fn try_load(
    path: &Path,
    select: Select,
    to_world: DAffine3,
    allowed: Allowed,
    (fog, repair_voxels): (bool, bool),
) -> Result<(Grid, Vec<String>), String> {
    let (span, options) = (Span::default(), LoadOptions { repair_voxels, ..LoadOptions::default() });
    let how = Loading { to_world, allowed, span: &span, options: &options };
    let (file, mut warnings) = (VdbFile { path: path.to_owned(), select, fog }, Vec::new());
    let grid = load_vdb(&file, how, &mut warnings).map_err(|e| e.to_string())?;
    Ok((grid, warnings.into_iter().map(|w| w.what).collect()))
}

/// The loader as media of densities use it.
fn load(path: &Path, select: Select, to_world: DAffine3) -> Grid {
    let loaded = try_load(path, select, to_world, Allowed::NON_NEGATIVE, (false, false));
    loaded.unwrap_or_else(|e| panic!("{e}")).0
}

/// Grids of all types, written by OpenVDB itself (`types.cpp` beside it).
fn types() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/files/types.vdb")
}

/// Random world points in and around a grid's box: our trilinear value against OpenVDB's BoxSampler, to its float rounding.
fn agrees(path: &Path, name: &str) {
    let grid = load(path, Select::Name(name.into()), DAffine3::IDENTITY);
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
    let [own, moved] = [DAffine3::IDENTITY, move_].map(|m| load(&path, Select::Name("density".into()), m));
    let mut rng = Rng::keyed(3, 0, 0, 0);
    for _ in 0..1000 {
        let p = DVec3::new(rng.uniform() * 2.0, rng.uniform() * 2.0, rng.uniform() * 4.0);
        assert!((own.lookup(p) - moved.lookup(move_.transform_point3(p))).abs() < 1e-9);
    }
}

/// Every type of value at every node, by `grid_index`; halves and doubles lose nothing here.
#[test]
fn grids_of_every_type() {
    let name = |n: &str| Select::Name(n.into());
    let ramp = |n: i32| f64::from(n) / 64.0;
    let scalars: [(Select, &dyn Fn(i32) -> f64); 9] = [
        (name("density"), &ramp),
        (Select::Index(0), &ramp),
        (Select::Index(1), &|n| 2.0 * ramp(n)),
        (Select::NameIndex("density".into(), 1), &|n| 2.0 * ramp(n)),
        (name("half"), &ramp),
        (name("double"), &ramp),
        (name("int32"), &|n| f64::from(n)),
        (name("int64"), &|n| f64::from(n)),
        (name("bool"), &|n| f64::from(u8::from(n % 3 == 0))),
    ];
    for (select, value) in scalars {
        let grid = load(&types(), select.clone(), DAffine3::IDENTITY);
        for i in 0..1000 {
            let p = [i / 100, i / 10 % 10, i % 10];
            let (at, n) = (DVec3::from(p.map(f64::from)), p[0] + 2 * p[1] + 4 * p[2]);
            assert_eq!(grid.lookup(at), value(n), "{select:?} at {p:?}");
        }
        assert_eq!(grid.lookup(DVec3::splat(-1.0)), 0.0);
    }
    let mask = load(&types(), name("mask"), DAffine3::IDENTITY);
    assert_eq!((mask.lookup(DVec3::splat(4.5)), mask.lookup(DVec3::splat(20.0))), (1.0, 0.0));
    for colors in ["color", "color_double"] {
        let grid = load(&types(), name(colors), DAffine3::IDENTITY);
        assert_eq!(grid.channels(), 3);
        for (p, n) in [([0, 0, 0], 0), ([9, 3, 1], 19), ([2, 9, 9], 56)] {
            let at = DVec3::from(p.map(f64::from));
            assert_eq!(
                grid.lookup3(at),
                [f64::from(n), f64::from(64 - n / 2), 1.0].map(|x| x / 64.0),
                "{colors} {p:?}"
            );
        }
    }
    let tiles = load(&types(), name("tiles"), DAffine3::IDENTITY);
    assert_eq!((tiles.lookup(DVec3::new(10.0, 12.0, 3.0)), tiles.lookup(DVec3::splat(-40.0))), (0.75, 0.25));
    let e =
        try_load(&types(), Select::Index(99), DAffine3::IDENTITY, Allowed::NON_NEGATIVE, (false, false)).unwrap_err();
    assert!(e.contains("grid number 99") && e.contains("0: density, 1: density"), "{e}");
}

/// A ball's level set as fog: 0 outside, -distance / band within the band (0.2), 1 deeper; without being told so an error.
#[test]
fn level_sets_are_fog_where_the_scene_says_so() {
    let surface = || Select::Name("surface".into());
    let how = |fog| try_load(&types(), surface(), DAffine3::IDENTITY, Allowed::NON_NEGATIVE, (fog, false));
    let e = how(false).unwrap_err();
    assert!(e.contains("types.vdb") && e.contains("`surface` is a level set") && e.contains("level_set"), "{e}");
    let fog = how(true).unwrap().0;
    // At voxels, where nothing is interpolated.
    let mut seen = [0; 3];
    for i in 0..23 * 23 * 23 {
        let p = DVec3::new(f64::from(i % 23) - 6.0, f64::from(i / 23 % 23) - 11.0, f64::from(i / 529) - 11.0) * 0.1;
        let depth = (0.8 - (p - DVec3::new(0.5, 0.0, 0.0)).length()) / 0.2;
        seen[usize::from(depth > 0.0) + usize::from(depth > 1.0)] += 1;
        assert!((fog.lookup(p) - depth.clamp(0.0, 1.0)).abs() < 1e-4, "{p}: {} {depth}", fog.lookup(p));
    }
    assert!(seen.iter().all(|&n| n > 500), "{seen:?}");
    let e = try_load(&types(), Select::Index(0), DAffine3::IDENTITY, Allowed::NON_NEGATIVE, (true, false));
    // Grids of no class may be level sets that lost it; this one has no band.
    assert!(e.unwrap_err().contains("narrow band"));
}

/// Broken voxels, tiles and backgrounds are refused by file, grid and index, or repaired and counted by kind.
#[test]
fn broken_voxels_are_named_or_repaired() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("broken.vdb");
    let mut values = vec![0.5; 512];
    (values[0o123], values[0o300], values[0o301], values[0o777]) = (f32::NAN, f32::INFINITY, -3.0, 1.5);
    let leaf = Leaf { origin: [8, -16, 0], active: [u64::MAX; 8], values };
    let grid = WriteGrid {
        name: "density".into(),
        channels: 1,
        world_from_index: DAffine3::IDENTITY,
        background: 0.0,
        leaves: vec![leaf],
        tiles: vec![Tile { origin: [16, -16, 0], size: 8, value: [-1.0; 3], active: true }],
        class: "fog volume".into(),
        half: false,
    };
    let outside = WriteGrid { name: "outside".into(), background: -0.5, ..grid.clone() };
    vdb::write(&path, &[grid, outside]).unwrap();
    let load = |name: &str, allowed, repair| {
        try_load(&path, Select::Name(name.into()), DAffine3::IDENTITY, allowed, (false, repair))
    };
    let e = load("density", Allowed::NON_NEGATIVE, false).unwrap_err();
    for part in ["broken.vdb", "grid `density`", "voxel [16, -16, 0] is -1", "3 more", "--repair-voxels"] {
        assert!(e.contains(part), "{part}: {e}");
    }
    let at = |g: &Grid, p: [i32; 3]| g.lookup(DVec3::from(p.map(f64::from)));
    let (g, told) = load("density", Allowed::NON_NEGATIVE, true).unwrap();
    assert!(told[0].contains("4 voxels") && told[0].ends_with("1 NaN, 1 infinite, 2 negative"), "{told:?}");
    let places = [[9, -14, 3], [11, -16, 0], [11, -16, 1], [15, -9, 7], [17, -15, 1], [8, -16, 0]];
    assert_eq!(places.map(|p| at(&g, p)), [0.0, 0.0, 0.0, 1.5, 0.0, 0.5]);
    // As an albedo 1.5 is too large.
    let (g, told) = load("density", Allowed::SHARE, true).unwrap();
    assert!(told[0].ends_with("1 NaN, 1 infinite, 2 negative, 1 too large"), "{told:?}");
    assert_eq!(at(&g, [15, -9, 7]), 1.0);
    let e = load("outside", Allowed::NON_NEGATIVE, false).unwrap_err();
    assert!(e.contains("`outside`: its background is [-0.5]") && e.contains("--repair-voxels"), "{e}");
    let (g, told) = load("outside", Allowed::NON_NEGATIVE, true).unwrap();
    assert!(told[0].contains("5 voxels") && at(&g, [900, 0, 0]) == 0.0, "{told:?}");
}

/// Colours out of a file as albedo and emission, a level set as density: what a scene says, and what it shows.
#[test]
fn colour_grids_and_level_sets_in_a_scene() {
    let volume = |name: &str, grid: &str| {
        let file = types().display().to_string();
        format!(r#"<volume name="{name}" type="openvdb"><string name="filename" value="{file}"/>{grid}</volume>"#)
    };
    let text = |albedo: &str| {
        format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>
    <medium type="heterogeneous" id="m">{}{albedo}{}</medium>
    <shape type="cube"><bsdf type="null"/><ref name="interior" id="m"/></shape></scene>"#,
            volume("sigma_t", r#"<string name="grid_name" value="surface"/><string name="level_set" value="fog"/>"#),
            volume("emission", r#"<integer name="grid_index" value="8"/>"#)
        )
    };
    let color = volume("albedo", r#"<string name="grid_name" value="color_double"/>"#);
    let (_, s) = crate::common::scene(&text(&color));
    let p = DVec3::new(0.5, 0.1, 0.2);
    let m = &s.media[0];
    let n = 0.5 + 0.2 + 0.8;
    assert!((m.albedo_at(p)[0] - n / 64.0).abs() < 1e-6 && m.albedo_at(p)[2] == 1.0 / 64.0, "{:?}", m.albedo_at(p));
    let (sigma_a, radiance) = m.glow(p).unwrap();
    assert!((radiance[0] - n / 64.0).abs() < 1e-6 && sigma_a[0] > 0.9, "{radiance:?} {sigma_a:?}");
    // The albedo's own limit is that of its voxels.
    let e = tyndall::scene::SceneDesc::parse(
        &text(&volume("albedo", r#"<integer name="grid_index" value="1"/>"#)),
        Path::new("s.xml"),
        &[],
    )
    .and_then(|d| tyndall::scene::Scene::compile(&d, &LoadOptions::default()).map(|_| ()))
    .unwrap_err()
    .to_string();
    assert!(e.contains("grid `density`: voxel") && e.contains("larger ones to 1"), "{e}");
}

/// Members of a family read a file once, also where the grid is moved: they do not see what becomes of it, and have the bits of a scene that read it anew.
#[test]
fn a_family_reads_a_file_once() {
    let dir = tempfile::tempdir().unwrap();
    let what = crate::common::small_vdb(&dir.path().join("a.vdb"), |p| 1.0 + 0.1 * (p.x + p.y * p.z).abs(), "density");
    let path = dir.path().join("s.xml");
    let scene = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"/><default name="x" value="0.1"/><default name="s" value="2"/><medium type="heterogeneous" id="m"><volume name="sigma_t" type="openvdb">{what}
             <transform name="to_world"><rotate y="1" angle="20"/><translate x="$x"/></transform></volume><float name="scale" value="$s"/><float name="albedo" value="0.5"/></medium>
           <sensor type="perspective"/><shape type="sphere"><float name="radius" value="2"/><bsdf type="null"/><ref name="interior" id="m"/></shape></scene>"#
    );
    std::fs::write(&path, scene).unwrap();
    let moved: [&[(&str, f64)]; 3] = [&[], &[("s", 3.0)], &[("x", 0.37)]];
    let fresh = moved.map(|values| Family::file(&path, &[], LoadOptions::default()).at(values).unwrap());
    let family = Family::file(&path, &[], LoadOptions::default());
    family.at(&[]).unwrap();
    std::fs::write(dir.path().join("a.vdb"), "no grid").unwrap();
    for (values, fresh) in moved.into_iter().zip(fresh) {
        let kept = family.at(values).unwrap_or_else(|e| panic!("{e}"));
        let mut rng = Rng::keyed(3, 0, 0, 0);
        for _ in 0..1000 {
            let p = DVec3::new(rng.uniform(), rng.uniform(), 0.9 + rng.uniform());
            let [a, b] = [&kept, &fresh].map(|m| m.scene.media[0].coefficients(p).0);
            assert!(a == b && a[0] > 0.0, "{values:?} at {p}: {a:?}, {b:?}");
        }
    }
}
