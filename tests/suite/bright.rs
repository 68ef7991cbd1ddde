//! Connections to where media glow: quadrature, the technique switched off, motion, voxels, threads.

use crate::common::{Estimate, against_differences, check, estimate, params, run, scene};
use std::path::Path;
use tyndall::math::{DAffine3, DVec3, Rgb};
use tyndall::native::vdb::{self, Leaf, WriteGrid};
use tyndall::phase::{Phase, one_minus_cos};
use tyndall::render::driver::{Mode, Outcome};
use tyndall::scene::Scene;
use tyndall::scene::bright::Bright;

/// Edge of a voxel, and where the ember is.
const H: f64 = 0.05;
const EMBER: DVec3 = DVec3::new(0.5, 0.15, 0.2);

/// One bright voxel: the radiance falls off linearly along each axis, to 0 at its neighbours.
fn ember(dir: &Path) -> String {
    let path = dir.join("ember.vdb");
    let mut values = vec![0.0; 512];
    values[4 << 6 | 4 << 3 | 4] = 1.0;
    let world_from_index =
        DAffine3::from_translation(EMBER - DVec3::splat(4.0 * H)) * DAffine3::from_scale(DVec3::splat(H));
    let leaves = vec![Leaf { origin: [0; 3], active: [u64::MAX; 8], values }];
    let (name, class) = ("glow".to_string(), "fog volume".to_string());
    vdb::write(
        &path,
        &[WriteGrid {
            name,
            channels: 1,
            world_from_index,
            background: 0.0,
            leaves,
            tiles: vec![],
            class,
            half: false,
        }],
    )
    .unwrap();
    path.display().to_string()
}

/// Fog around the ember, one orthographic pixel along +z at x = y = 0. `more`: shapes.
fn fog(file: &str, albedo: f64, more: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="sigma_t" value="0.4"/><default name="albedo" value="{albedo}"/><default name="g" value="0.4"/><default name="e" value="500"/>
    <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/>
      <float name="emission_scale" value="$e"/><phase type="hg"><float name="g" value="$g"/></phase>
      <volume name="emission" type="openvdb"><string name="filename" value="{file}"/><string name="grid_name" value="glow"/></volume></medium>
    <sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/><translate z="-3"/></transform>
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
    <shape type="cube"><transform name="to_world"><scale value="2"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
    {more}</scene>"#
    )
}

/// `∫ f(y) L_e(y) dy` over the ember of a radiance of 1: three-point Gauss rules on either side along each axis.
fn over_ember(mut f: impl FnMut(DVec3) -> f64) -> f64 {
    let (x, w) = ([-0.6_f64.sqrt(), 0.0, 0.6_f64.sqrt()], [5.0 / 9.0, 8.0 / 9.0, 5.0 / 9.0]);
    let rule: Vec<(f64, f64)> = [-1.0, 1.0]
        .iter()
        .flat_map(|side| (0..3).map(move |i| (side * (0.5 + 0.5 * x[i]), 0.5 * w[i])))
        .map(|(t, w)| (t * H, w * H * (1.0 - t.abs())))
        .collect();
    let mut sum = 0.0;
    for (a, wa) in &rule {
        for (b, wb) in &rule {
            for (c, wc) in &rule {
                sum += wa * wb * wc * f(EMBER + DVec3::new(*a, *b, *c));
            }
        }
    }
    sum
}

/// A radiance, by these parameters.
type Truth = fn([f64; 4]) -> f64;

/// Light that scatters once in the fog, [sigma_t, albedo, g, e].
fn in_fog([sigma, albedo, g, e]: [f64; 4]) -> f64 {
    let phase = Phase::Hg { g };
    let at = |z: f64| {
        let x = DVec3::new(0.0, 0.0, z);
        let light = over_ember(|y| {
            let r = (y - x).length();
            phase.eval(one_minus_cos(DVec3::Z, (y - x) / r)) * (-sigma * r).exp() / (r * r)
        });
        (-sigma * (z + 2.0)).exp() * light
    };
    // Simpson.
    let n = 400;
    let h = 4.0 / f64::from(n);
    let sum: f64 = (0..=n)
        .map(|i| {
            at(-2.0 + f64::from(i) * h)
                * if i == 0 || i == n {
                    1.0
                } else if i % 2 == 1 {
                    4.0
                } else {
                    2.0
                }
        })
        .sum();
    sigma * albedo * sigma * (1.0 - albedo) * e * sum * h / 3.0
}

/// Light of the ember from a floor at z = 1.5 (reflectance 0.7) through fog that absorbs only.
fn from_floor([sigma, _, _, e]: [f64; 4]) -> f64 {
    let x = DVec3::new(0.0, 0.0, 1.5);
    let light = over_ember(|y| {
        let d = y - x;
        let r = d.length();
        -d.z / r * (-sigma * r).exp() / (r * r)
    });
    (-sigma * 3.5).exp() * 0.7 / std::f64::consts::PI * sigma * e * light
}

const FLOOR: &str = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="180"/><scale value="1.9"/><translate z="1.5"/></transform>
  <bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>"#;

fn off(scene: &mut Scene) {
    assert!(scene.bright.any());
    scene.bright = Bright::default();
}

fn layers(o: &Outcome, n: usize) -> Vec<Estimate> {
    (0..n).map(|l| estimate(o, l)).collect()
}

/// Value and derivatives against quadrature with the technique and without it, which has many times the variance (4.5 s.e.).
#[test]
fn an_ember_lights_fog_and_floor() {
    let dir = tempfile::tempdir().unwrap();
    let file = ember(dir.path());
    let cases: [(&str, f64, &str, Truth, &[&str]); 2] = [
        ("fog", 0.8, "", in_fog, &["sigma_t", "albedo", "g", "e"]),
        ("floor", 0.0, FLOOR, from_floor, &["sigma_t", "e"]),
    ];
    for (name, albedo, more, truth, wrt) in cases {
        let text = fog(&file, albedo, more);
        let at = [0.4, albedo, 0.4, 500.0];
        let slope = |k: usize| {
            let side = |s: f64| truth(std::array::from_fn(|i| if i == k { at[i] * (1.0 + s * 1e-4) } else { at[i] }));
            (side(1.0) - side(-1.0)) / (2e-4 * at[k])
        };
        let mut truths = vec![truth(at)];
        truths.extend(wrt.iter().map(|p| slope(["sigma_t", "albedo", "g", "e"].iter().position(|q| q == p).unwrap())));
        let (desc, mut sc) = scene(&text);
        let p = params(&desc, &sc, wrt);
        let with = layers(&run(&sc, 1 << 14, 1, Mode::Forward(&p)), truths.len());
        for (k, t) in truths.iter().enumerate() {
            check(&format!("{name} {k}"), &with[k], *t, 0.05);
        }
        off(&mut sc);
        let without = layers(&run(&sc, 1 << 18, 2, Mode::Forward(&p)), truths.len());
        for (k, t) in truths.iter().enumerate() {
            let z = without[k].z(0, *t);
            // Variance of as many samples.
            let ratio = 16.0 * (without[k].error[0] / with[k].error[0]).powi(2);
            println!(
                "{name} {k}: without {} +- {} z {z:.2}, variance ratio {ratio:.1}",
                without[k].value[0], without[k].error[0]
            );
            assert!(z.abs() <= 4.5, "{name} {k}: z {z}");
            assert!(ratio > 20.0, "{name} {k}: variance ratio {ratio}");
        }
    }
}

/// What moves, with the light of an ember on it: a dark ball, the border of the fog, the ember, against differences.
#[test]
fn things_move_beside_an_ember() {
    let dir = tempfile::tempdir().unwrap();
    let more = r#"<shape type="sphere"><float name="radius" value="0.3"/><transform name="to_world"><translate x="$x" y="0.2" z="0.6"/></transform><bsdf type="diffuse"/></shape>"#;
    let text = fog(&ember(dir.path()), 0.8, more)
        .replace(r#"<default name="g" "#, r#"<default name="x" value="-0.5"/><default name="b" value="2"/><default name="y" value="0"/><default name="g" "#)
        .replace(r#"<scale value="2"/>"#, r#"<scale x="2" y="2" z="$b"/>"#)
        .replace("</volume></medium>", r#"<transform name="to_world"><translate y="$y"/></transform></volume></medium>"#)
        .replace(r#"name="max_depth" value="2""#, r#"name="max_depth" value="3""#);
    assert!(scene(&text).1.bright.any());
    against_differences(&text, &[("x", 0.02), ("b", 0.02), ("y", 0.02), ("e", 5.0)], &["all"], 1 << 16, 0.0);
}

/// The gradient by voxels adds up to that by `e`, forward is reverse, and no bit depends on the number of threads.
#[test]
fn voxels_modes_and_threads() {
    let dir = tempfile::tempdir().unwrap();
    let text =
        fog(&ember(dir.path()), 0.8, FLOOR).replace(r#"name="max_depth" value="2""#, r#"name="max_depth" value="5""#);
    let (desc, mut sc) = scene(&text);
    let names = ["sigma_t", "albedo", "g", "e"];
    let p = params(&desc, &sc, &names);
    assert!(sc.bright.any());
    let v = [Rgb([0.3, -0.7, 1.1])];
    let runs = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let f = run(&sc, 512, 3, Mode::Forward(&p));
            let g = p.pull_back(&run(&sc, 512, 3, Mode::Reverse(&p, &v)).gradient.unwrap().0);
            ((0..=4).map(|k| f.film.mean(k, 0)).collect::<Vec<_>>(), g)
        })
    });
    assert_eq!(runs[0], runs[1]);
    let (means, gradient) = &runs[0];
    for (k, name) in names.iter().enumerate() {
        let d = means[k + 1];
        assert!((d.dot(v[0]) - gradient[k]).abs() <= 1e-10 * (d * v[0]).abs().sum(), "{name}: {d:?} {}", gradient[k]);
    }

    let wrt = ["fog.emission.grid", "e"].map(String::from);
    sc.open(&desc, &wrt).unwrap();
    let p = sc.param_set(&desc, &wrt).unwrap();
    let g = run(&sc, 512, 3, Mode::Reverse(&p, &v)).gradient.unwrap().0;
    // All but one voxel are 0.
    let of_voxels = &g[p.arrays[0].range()];
    let bright = of_voxels[4 << 6 | 4 << 3 | 4];
    let by_scale = 500.0 * p.pull_back(&g)[0];
    assert!((bright - by_scale).abs() <= 1e-9 * by_scale.abs(), "{bright} {by_scale}");
    assert!(of_voxels.iter().filter(|x| **x != 0.0).count() > 100);
}

/// Where all light of what glows is met again right there, nothing is connected: the fire in its own dense smoke.
#[test]
fn a_fire_in_dense_smoke_is_left_to_walks() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/fire/scene.xml");
    let text = std::fs::read_to_string(&path).unwrap();
    for (scale, any) in [("16", false), ("1", true)] {
        let o =
            [("density_scale".to_string(), scale.to_string()), ("sun".into(), "0".into()), ("sky".into(), "0".into())];
        let desc = tyndall::scene::SceneDesc::parse(&text, &path, &o).unwrap();
        let sc = Scene::compile(&desc, &tyndall::scene::compile::LoadOptions::default()).unwrap();
        assert_eq!(sc.bright.any(), any, "density_scale {scale}");
    }
}
