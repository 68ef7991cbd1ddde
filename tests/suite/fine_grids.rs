//! Grids far finer than a mean free path: shadow rays by residual tracking, depths differentiated at drawn points.

use crate::common::{check, estimate, params, run, scene, scene_with};
use std::f64::consts::PI;
use tyndall::error::WarningKind;
use tyndall::math::{DAffine3, DVec3, Rgb};
use tyndall::native::vdb;
use tyndall::render::driver::Mode;

/// A column of density 1 + 0.9 sin(2 pi z), z from 0 to 1.
fn column(dir: &std::path::Path) -> String {
    let n = 128;
    let at = |k: usize| (1.0 + 0.9 * (2.0 * PI * (k as f64 + 0.5) / n as f64).sin()) as f32;
    let values = (0..n).map(at).collect();
    let vol = tyndall::medium::grid::vol::Vol { res: [1, 1, n], channels: 1, bbox: [[0.0; 3], [1.0; 3]], values };
    let path = dir.join("column.vol");
    vol.write(&path).unwrap();
    path.display().to_string()
}

/// Two such clouds, one over the other, between the sun and a white floor that a camera below them looks at.
fn clouds(dir: &std::path::Path) -> String {
    let file = column(dir);
    let medium = |id: &str, z: f64| {
        format!(
            r#"<medium type="heterogeneous" id="{id}"><float name="scale" value="$scale"/><rgb name="albedo" value="0"/>
            <volume name="sigma_t" type="gridvolume"><string name="filename" value="{file}"/>
            <transform name="to_world"><translate x="-0.5" y="-0.5"/><scale x="10" y="10" z="1"/><translate z="{z}"/></transform></volume></medium>
            <shape type="cube"><transform name="to_world"><translate z="1"/><scale x="5" y="5" z="0.5"/><translate z="{z}"/></transform>
            <bsdf type="null"/><ref name="interior" id="{id}"/></shape>"#
        )
    };
    format!(
        r#"<scene version="3.0.0"><default name="scale" value="2"/><integrator type="volpath"/>{}{}
        <sensor type="orthographic"><transform name="to_world"><scale x="1e-3" y="1e-3"/><lookat origin="0, 0, 0.5" target="0, 0, 0" up="0, 1, 0"/></transform>
          <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
        <shape type="rectangle"><transform name="to_world"><scale value="20"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
        <emitter type="directional"><vector name="direction" value="0.3, 0, -1"/><rgb name="irradiance" value="1"/></emitter></scene>"#,
        medium("low", 1.0),
        medium("high", 3.0)
    )
}

/// Transmittances of both clouds on one shadow ray are independent: their product is that of their means.
#[test]
fn two_clouds_on_one_shadow_ray() {
    let dir = tempfile::tempdir().unwrap();
    let (desc, sc) = scene(&clouds(dir.path()));
    let toward = -DVec3::new(0.3, 0.0, -1.0).normalize();
    let depth: f64 = sc.media.iter().map(|m| m.density_integral(DVec3::ZERO, toward, 0.0, 9.0)[0]).sum();
    let o = run(&sc, 1 << 13, 1, Mode::Forward(&params(&desc, &sc, &["scale"])));
    let t = (-2.0 * depth).exp();
    let l = 0.8 / PI * toward.z * t;
    let value = estimate(&o, 0);
    assert!(value.error[0] > 1e-5 * l, "no estimate: {}", value.error[0]);
    check("L", &value, l, 0.003);
    check("dL/dscale", &estimate(&o, 1), -depth * l, 0.003);
}

/// By all voxels of a fine grid together, and by its scale: the same samples, so the same to rounding ([T] section 11, free identities).
#[test]
fn voxels_add_up_to_the_scale() {
    let dir = tempfile::tempdir().unwrap();
    let text = clouds(dir.path()).replace(r#"<rgb name="albedo" value="0"/>"#, r#"<rgb name="albedo" value="0.7"/>"#);
    let (desc, mut sc) = scene(&text);
    let p = params(&desc, &sc, &["scale"]);
    let o = run(&sc, 64, 3, Mode::Forward(&p));
    let forward = 2.0 * estimate(&o, 1).value[0];
    let names = ["low.sigma_t.grid".to_string(), "high.sigma_t.grid".to_string()];
    sc.open(&desc, &names).unwrap();
    let p = sc.param_set(&desc, &names).unwrap();
    let adjoint = vec![Rgb([1.0 / 16.0, 0.0, 0.0]); 16];
    let g = run(&sc, 64, 3, Mode::Reverse(&p, &adjoint)).gradient.unwrap().0;
    let sum: f64 = p
        .arrays
        .iter()
        .flat_map(|a| g[a.range()].iter().enumerate())
        .map(|(k, g)| g * f64::from((1.0 + 0.9 * (2.0 * PI * (k as f64 + 0.5) / 128.0).sin()) as f32))
        .sum();
    assert!((sum / forward - 1.0).abs() < 1e-9, "{sum} {forward}");
}

/// Voxels, a light that moves and the grid's own place in one gradient: scalars are those of forward mode, voxels add up to the scale, to rounding.
#[test]
fn voxels_beside_things_that_move() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s.vdb");
    let density = |i: usize| (0.2 + 0.8 * ((i as f64).sin().abs())) as f32;
    let leaf = |k: i32| vdb::Leaf {
        origin: [8 * (k & 1), 8 * (k >> 1 & 1), 8 * (k >> 2 & 1)],
        active: [u64::MAX; 8],
        values: (0..512).map(|i| density(i + 37 * k as usize)).collect(),
    };
    let grid = vdb::WriteGrid {
        name: "density".into(),
        channels: 1,
        world_from_index: DAffine3::from_scale(DVec3::splat(1.0 / 16.0)),
        background: 0.0,
        leaves: (0..8).map(leaf).collect(),
        tiles: vec![],
        class: "fog volume".into(),
        half: false,
    };
    vdb::write(&path, &[grid]).unwrap();
    let text = format!(
        r#"<scene version="3.0.0"><default name="scale" value="3"/><default name="x" value="0.1"/><default name="light" value="1.8"/><integrator type="volpath"/>
        <medium type="heterogeneous" id="m"><float name="scale" value="$scale"/><rgb name="albedo" value="0.7"/>
        <volume name="sigma_t" type="openvdb"><string name="filename" value="{}"/>
        <transform name="to_world"><translate x="$x"/></transform></volume></medium>
        <shape type="cube"><transform name="to_world"><scale value="0.8"/><translate x="0.5" y="0.5" z="0.5"/></transform><bsdf type="null"/><ref name="interior" id="m"/></shape>
        <sensor type="perspective"><float name="fov" value="30"/><transform name="to_world"><lookat origin="0.5, 0.4, -3" target="0.5, 0.5, 0.5" up="0, 1, 0"/></transform>
          <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/><rfilter type="box"/></film></sensor>
        <emitter type="point"><point name="position" x="0.3" y="$light" z="0.4"/><rgb name="intensity" value="5"/></emitter></scene>"#,
        path.display()
    );
    let (desc, mut sc) = scene(&text);
    let names = ["scale", "x", "light"];
    let p = params(&desc, &sc, &names);
    let o = run(&sc, 16, 3, Mode::Forward(&p));
    let forward = [1, 2, 3].map(|k| estimate(&o, k).value[0]);
    let all: Vec<String> = names.iter().copied().chain(["m.sigma_t.grid"]).map(String::from).collect();
    sc.open(&desc, &all).unwrap();
    let p = sc.param_set(&desc, &all).unwrap();
    let adjoint = vec![Rgb([1.0 / 64.0, 0.0, 0.0]); 64];
    let g = run(&sc, 16, 3, Mode::Reverse(&p, &adjoint)).gradient.unwrap().0;
    for (k, (own, forward)) in p.pull_back(&g).iter().zip(forward).enumerate() {
        assert!((own / forward - 1.0).abs() < 1e-9 && forward != 0.0, "{k}: {own} {forward}");
    }
    let media = &sc.media[0];
    let values: Vec<f64> = media.density_grid().unwrap().field().active().collect();
    let sum: f64 = g[p.arrays[0].range()].iter().zip(&values).map(|(g, v)| g * v).sum();
    assert_eq!(values.len(), 4096);
    assert!((sum / (3.0 * forward[0]) - 1.0).abs() < 1e-9, "{sum} {}", 3.0 * forward[0]);
}

/// A cloud of density 1 + z under a sky and a sun, given by 16 or 2048 voxels along z: the same interpolant within the box that holds it. Camera lines cross the first exactly and fly through the second.
fn ramp(dir: &std::path::Path, n: usize, albedo: &str, sun: &str) -> String {
    let values = (0..n).map(|k| (1.0 + (k as f64 + 0.5) / n as f64) as f32).collect();
    let path = dir.join(format!("ramp{n}.vol"));
    let vol = tyndall::medium::grid::vol::Vol { res: [1, 1, n], channels: 1, bbox: [[0.0; 3], [1.0; 3]], values };
    vol.write(&path).unwrap();
    format!(
        r#"<scene version="3.0.0"><default name="scale" value="1.2"/><default name="albedo" value="{albedo}"/><default name="z" value="0.5"/>
        <integrator type="volpath"><integer name="max_depth" value="1000"/><integer name="rr_depth" value="1000"/></integrator>
        <medium type="heterogeneous" id="m"><float name="scale" value="$scale"/><rgb name="albedo" value="$albedo"/>
        <volume name="sigma_t" type="gridvolume"><string name="filename" value="{}"/>
        <transform name="to_world"><translate x="-0.5" y="-0.5"/><scale x="10" y="10" z="1"/></transform></volume></medium>
        <shape type="cube"><transform name="to_world"><scale x="2" y="2" z="0.4"/><translate z="$z"/></transform><bsdf type="null"/><ref name="interior" id="m"/></shape>
        <sensor type="orthographic"><transform name="to_world"><scale x="0.1" y="0.1"/><lookat origin="0.3, 0.1, -1" target="0, 0, 0.5" up="0, 1, 0"/></transform>
          <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
        <emitter type="constant"><rgb name="radiance" value="1"/></emitter>{sun}</scene>"#,
        path.display()
    )
}

/// Camera lines that fly give the picture and derivatives of those that cross every cell: by extinction, albedo, and a border that moves.
#[test]
fn camera_lines_fly_through_fine_grids() {
    fly_or_cross("", 0.03);
}

/// The same before a wall that reflects, where one of the two parts of a line is followed.
#[test]
fn camera_lines_fly_before_a_wall() {
    let wall = r#"<shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate y="1" angle="180"/><translate z="1.2"/></transform>
        <bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>"#;
    fly_or_cross(wall, 0.05);
}

/// `precision`: how well derivatives have to be known.
fn fly_or_cross(wall: &str, precision: f64) {
    let dir = tempfile::tempdir().unwrap();
    let sun = r#"<emitter type="directional"><vector name="direction" value="0.3, 0, 1"/><rgb name="irradiance" value="2"/></emitter>"#;
    let names = ["scale", "albedo", "z"];
    let [exact, flown] = [16, 2048].map(|n| {
        let (desc, sc) = scene(&ramp(dir.path(), n, "0.4", &[sun, wall].concat()));
        let o = run(&sc, 1 << 12, 5, Mode::Forward(&params(&desc, &sc, &names)));
        [0, 1, 2, 3].map(|k| estimate(&o, k))
    });
    for (k, (a, b)) in exact.iter().zip(&flown).enumerate() {
        let error = a.error[0].hypot(b.error[0]);
        // 4 s.e. each (false alarm 3e-4).
        assert!((a.value[0] - b.value[0]).abs() <= 4.0 * error, "{k}: {} {} {error}", a.value[0], b.value[0]);
        assert!(error < precision * a.value[0].abs(), "{k}: {} +- {error}", a.value[0]);
    }
    // What passes is left to chance: it is flown, and not crossed.
    assert!(flown[0].value[0] != exact[0].value[0]);
}

/// In a furnace every sample of such lines is 1.
#[test]
fn camera_lines_that_fly_keep_a_furnace() {
    let dir = tempfile::tempdir().unwrap();
    let (_, sc) = scene(&ramp(dir.path(), 2048, "1", ""));
    let o = run(&sc, 64, 3, Mode::Picture);
    let e = estimate(&o, 0);
    assert!((e.value[0] - 1.0).abs() < 1e-9 && e.error[0] < 1e-9, "{} +- {}", e.value[0], e.error[0]);
}

/// Free paths shorter than positions resolve are told.
#[test]
fn media_too_dense_for_positions_are_told() {
    let dir = tempfile::tempdir().unwrap();
    let text = clouds(dir.path());
    let dense = |scale: &str| {
        let (_, sc) = scene_with(&text, &[("scale", scale)]);
        let own = sc.warnings.iter().filter(|w| w.kind == WarningKind::UnlikelyValue);
        own.map(|w| w.what.clone()).collect::<Vec<_>>()
    };
    assert!(dense("2").is_empty() && dense("1e12").is_empty());
    let found = dense("1e16");
    assert!(
        found.len() == 2 && found[0].contains("`low`") && found[0].contains("free paths are 5.3e-17 long"),
        "{found:?}"
    );
}
