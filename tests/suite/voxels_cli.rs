//! `grad --wrt ID.sigma_t.grid`: its .vdb and .json, and what is refused.

use crate::fog::Folder;
use serde_json::Value;
use std::fs;
use tyndall::math::{DAffine3, DMat3, DVec3};
use tyndall::medium::grid::vol::Vol;
use tyndall::native::vdb::{self, Leaf, Select, Tile, WriteGrid};

const SCENE: &str = r#"<scene version="3.0.0">
  <default name="g" value="0.3"/><default name="light" value="3"/>
  <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
  <medium type="heterogeneous" id="smoke">
    <volume type="openvdb" name="sigma_t"><string name="filename" value="s.vdb"/><string name="grid_name" value="density"/>
      <transform name="to_world"><scale value="0.5"/><rotate y="1" angle="20"/></transform></volume>
    <volume type="openvdb" name="albedo"><string name="filename" value="s.vdb"/><string name="grid_name" value="tint"/>
      <transform name="to_world"><scale value="0.5"/></transform></volume>
    <phase type="hg"><float name="g" value="$g"/></phase></medium>
  <medium type="homogeneous" id="fog"/>
  <shape type="cube" id="box"><transform name="to_world"><scale value="3"/></transform><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0.2, 0, 6" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="5"/></film></sensor>
  <emitter type="directional"><vector name="direction" value="0, -1, 0"/><float name="irradiance" value="$light"/></emitter>
</scene>"#;

/// Two leaves, one of them half active, and a tile; an anisotropic, shifted transform.
fn grid(name: &str, channels: usize) -> WriteGrid {
    let leaf = |origin, active: [u64; 8]| Leaf { origin, active, values: vec![0.5; 512 * channels] };
    WriteGrid {
        name: name.into(),
        channels,
        world_from_index: DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.15)),
            translation: DVec3::new(-0.8, -0.7, -0.6),
        },
        background: 0.0,
        leaves: vec![leaf([0, 0, 0], [u64::MAX; 8]), leaf([8, 0, 0], [0x0f0f_0f0f_0f0f_0f0f; 8])],
        tiles: vec![Tile { origin: [0, 8, 0], size: 8, value: [0.25; 3], active: true }],
        class: "fog volume".into(),
        half: false,
    }
}

fn folder() -> Folder {
    let f = Folder::new();
    vdb::write(&f.path("s.vdb"), &[grid("density", 1), grid("tint", 3)]).unwrap();
    fs::write(f.path("s.xml"), SCENE).unwrap();
    f.run(0, "render s.xml --spp 4 --seed 5 -o ref.exr");
    f
}

#[test]
fn a_gradient_is_a_grid_like_the_grid() {
    let f = folder();
    let wrt = "smoke.sigma_t.grid,smoke.albedo.grid,g,light";
    let (out, _) = f.run(0, &format!("grad s.xml --wrt {wrt} --loss l2 --target ref.exr --spp 256 --json -o grad.vdb"));
    let v: Value = serde_json::from_str(&out).unwrap();
    assert_eq!(v, serde_json::from_str::<Value>(&fs::read_to_string(f.path("grad.json")).unwrap()).unwrap());
    let count = 512 + 256 + 1;
    for (name, channels) in [("smoke.sigma_t.grid", 1), ("smoke.albedo.grid", 3)] {
        for map in ["gradient", "standard_error"] {
            assert_eq!(v[map][name]["shape"], serde_json::json!([count, channels]));
            assert!(v[map][name]["norm"].as_f64().unwrap() > 0.0, "{map} {name}");
        }
        assert_eq!(v["gradient"][name]["grid"], name);
    }
    assert!(v["gradient"]["g"].as_f64().unwrap() != 0.0 && v["standard_error"]["light"].as_f64().unwrap() > 0.0);

    // Transform and topology are the source's, as `info` shows them.
    let info = |file: &str| -> Value { serde_json::from_str(&f.run(0, &format!("info {file} --json")).0).unwrap() };
    let (source, ours) = (info("s.vdb"), info("grad.vdb"));
    assert_eq!(ours["grids"][0]["name"], "smoke.sigma_t.grid");
    assert_eq!(ours["grids"][1]["name"], "smoke.albedo.grid");
    for k in 0..2 {
        let same = ["world_from_index", "transform", "active_voxels", "leaf_count", "bbox", "value_type"];
        for key in same.iter().filter(|key| source["grids"][k].get(**key).is_some()) {
            assert_eq!(source["grids"][k][key], ours["grids"][k][key], "{key}");
        }
        let [a, b] = ["s.vdb", "grad.vdb"].map(|n| vdb::load(&f.path(n), &Select::Index(k)).unwrap());
        assert_eq!((a.info.world_from_index, a.channels), (b.info.world_from_index, b.channels));
        let masks = |g: &vdb::VdbGrid| g.leaves.iter().map(|l| (l.origin, l.active)).collect::<Vec<_>>();
        assert_eq!(masks(&a), masks(&b));
        assert_eq!((a.tiles[0].origin, a.tiles[0].size), (b.tiles[0].origin, b.tiles[0].size));
        assert!(b.tiles[0].value[..b.channels].iter().all(|x| *x != 0.0));
        let norm: f64 = b
            .leaves
            .iter()
            .flat_map(|l| &l.values)
            .chain(&b.tiles[0].value[..b.channels])
            .map(|&x| f64::from(x).powi(2))
            .sum();
        let name = ["smoke.sigma_t.grid", "smoke.albedo.grid"][k];
        assert!((norm.sqrt() / v["gradient"][name]["norm"].as_f64().unwrap() - 1.0).abs() < 1e-5);
    }

    // Threads, the default name, the table, dilation.
    f.run(0, "render s.xml --spp 1 -o a.exr");
    for t in 1..3 {
        f.run(0, &format!("grad s.xml --wrt smoke.sigma_t.grid --adjoint a.exr --spp 32 -t {t} -o g{t}.vdb"));
    }
    let leaves = |name: &str| vdb::load(&f.path(name), &Select::Index(0)).unwrap().leaves;
    assert_eq!(leaves("g1.vdb"), leaves("g2.vdb"));
    let (out, _) = f.run(0, "grad s.xml --wrt smoke.sigma_t.grid --adjoint a.exr --spp 32 --dilate");
    assert!(out.contains("|smoke.sigma_t.grid|") && out.contains("s.grad.vdb"), "{out}");
    let wide = vdb::list(&f.path("s.grad.vdb")).unwrap();
    // A box of 12 x 16 x 8 nodes less 4 x 8 x 8, and 4 x 8 x 4 of the half leaf.
    assert!(wide[0].active_voxels > ours["grids"][0]["active_voxels"].as_u64().unwrap());
    assert_eq!(wide[0].world_from_index, vdb::list(&f.path("s.vdb")).unwrap()[0].world_from_index);
    let (out, _) = f.run(0, "plan s.xml --wrt smoke.sigma_t.grid");
    assert!(out.contains("material or light values change (smoke.sigma_t.grid)"), "{out}");
}

#[test]
fn a_dense_array_becomes_a_grid_in_the_unit_cube() {
    let f = folder();
    let vol = Vol { res: [5, 9, 4], channels: 1, bbox: [[0.0; 3], [1.0; 3]], values: vec![0.3; 180] };
    vol.write(&f.path("d.vol")).unwrap();
    let volume = r#"<volume type="gridvolume" name="sigma_t"><string name="filename" value="d.vol"/><transform name="to_world"><scale value="2"/></transform></volume>"#;
    let (a, b) = (SCENE.find("<volume").unwrap(), SCENE.find("<phase").unwrap());
    fs::write(f.path("d.xml"), format!("{}{volume}{}", &SCENE[..a], &SCENE[b..])).unwrap();
    f.run(0, "render d.xml --spp 1 -o a.exr");
    f.run(0, "grad d.xml --wrt smoke.sigma_t.grid --adjoint a.exr --spp 64 -o d.vdb");
    let info = &vdb::list(&f.path("d.vdb")).unwrap()[0];
    assert_eq!((info.active_voxels, info.bbox), (180, Some(([0; 3], [4, 8, 3]))));
    // The first voxel's centre, in the cube that `to_world` scales.
    assert!((info.world_from_index.translation - DVec3::new(0.1, 0.5 / 9.0, 0.125)).length() < 1e-15);
}

#[test]
fn what_has_no_such_gradient_is_refused_by_name() {
    let f = folder();
    let reverse = "--loss l2 --target ref.exr";
    for (line, parts) in [
        ("grad s.xml --wrt smoke.sigma_t.grid".to_string(), ["no derivative images", "--adjoint A.exr"]),
        (format!("grad s.xml --wrt smok.sigma_t.grid {reverse}"), ["no medium `smok`", "did you mean `smoke`"]),
        (format!("grad s.xml --wrt fog.sigma_t.grid {reverse}"), ["sigma_t of `fog` is constant", "$parameter"]),
        (
            format!("grad s.xml --wrt smoke.emission.grid {reverse}"),
            ["`smoke` has no emission", "no medium of the scene"],
        ),
        (format!("grad s.xml --wrt box.sigma_t.grid {reverse}"), ["`box` is a shape", "`smoke`"]),
        (format!("grad s.xml --wrt smoke.density.grid {reverse}"), ["`density.grid` of `smoke`", "ID.sigma_t.grid"]),
        (format!("grad s.xml --wrt smoke.sigma_t.grid {reverse} -o g.json"), ["g.json` does not end in .vdb", "g.vdb"]),
        (format!("grad s.xml --wrt g {reverse} -o g.vdb"), ["g.vdb` does not end in .json", "g.json"]),
        (format!("grad s.xml --wrt g {reverse} --dilate"), ["`--dilate`", "ID.sigma_t.grid"]),
        ("check s.xml --wrt smoke.sigma_t.grid".into(), ["`check` takes `$parameters` only", "tyndall grad"]),
    ] {
        let (out, err) = f.run(2, &line);
        assert!(out.is_empty() && err.starts_with("error: "), "`{line}`: {err}");
        assert!(parts.iter().all(|p| err.contains(p)), "`{line}`: {err}");
    }
    fs::write(f.path("old.vdb"), "").unwrap();
    f.run(4, &format!("grad s.xml --wrt smoke.sigma_t.grid {reverse} -o old.vdb"));
    let mut empty = grid("density", 1);
    (empty.leaves, empty.tiles) = (Vec::new(), Vec::new());
    vdb::write(&f.path("e.vdb"), &[empty, grid("tint", 3)]).unwrap();
    fs::write(f.path("e.xml"), SCENE.replace("s.vdb", "e.vdb")).unwrap();
    let (_, err) = f.run(2, &format!("grad e.xml --wrt smoke.sigma_t.grid {reverse} -o e.grad.vdb"));
    assert!(err.contains("no active voxel"), "{err}");
}
