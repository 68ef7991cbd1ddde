//! Level sets as shapes: a ball's surface against the ball, what is refused, a scene with it against the same mesh as a file.

use crate::common::{difference, estimate, forward_of, params, run, scene};
use std::path::{Path, PathBuf};
use tyndall::math::{DAffine3, DVec3};
use tyndall::native::vdb::{self, Leaf, Select, WriteGrid};
use tyndall::render::driver::Mode;
use tyndall::scene::compile::Orders;
use tyndall::shape::{Geometry, TriangleMesh, level_set};

const RADIUS: f64 = 0.8;

/// Distances to a ball around the origin, in voxels of edge `h`.
fn ball(dir: &Path, h: f64, mirror: bool, class: &str) -> PathBuf {
    let path = dir.join(format!("ball_{h}_{mirror}_{class}.vdb"));
    let m = (1.0 / h / 8.0).ceil() as i32;
    let scale = DVec3::new(if mirror { -h } else { h }, h, h);
    let mut leaves = Vec::new();
    for k in 0..(2 * m).pow(3) {
        let origin = [k / (4 * m * m), k / (2 * m) % (2 * m), k % (2 * m)].map(|i| 8 * (i - m));
        let values: Vec<f32> = (0..512)
            .map(|i| {
                let p = [i >> 6, i >> 3 & 7, i & 7];
                let p = DVec3::from([0, 1, 2].map(|a| f64::from(origin[a] + p[a])));
                // A third of a voxel off the lattice.
                (((p - 1.0 / 3.0) * scale).length() - RADIUS).clamp(-3.0 * h, 3.0 * h) as f32
            })
            .collect();
        leaves.push(Leaf { origin, active: [u64::MAX; 8], values });
    }
    let grid = WriteGrid {
        name: "ball".into(),
        channels: 1,
        world_from_index: DAffine3::from_scale(scale) * DAffine3::from_translation(DVec3::splat(-1.0 / 3.0)),
        background: (3.0 * h) as f32,
        leaves,
        tiles: vec![],
        class: class.into(),
        half: false,
    };
    vdb::write(&path, &[grid]).unwrap();
    path
}

fn load(path: &Path, isovalue: Option<f64>) -> Result<TriangleMesh, String> {
    level_set::load(path, &Select::Name("ball".into()), isovalue)
}

/// Area and volume of what it encloses.
fn size(m: &TriangleMesh) -> [f64; 2] {
    let volume = |f: &[u32; 3]| {
        let [a, b, c] = f.map(|k| m.vertices[k as usize]);
        a.dot(b.cross(c)) / 6.0
    };
    [m.area(), m.faces.iter().map(volume).sum()]
}

/// Largest relative error of area and volume over (h/R)²: points are means of where cells' edges are crossed, so they lie a little inside.
const ORDER: f64 = 1.5;

/// Closed, one side in front, that is the outside; area and volume off by O(h²).
#[test]
fn a_ball_is_meshed() {
    let dir = tempfile::tempdir().unwrap();
    let truth = [4.0 * std::f64::consts::PI * RADIUS.powi(2), 4.0 / 3.0 * std::f64::consts::PI * RADIUS.powi(3)];
    for mirror in [false, true] {
        let errors = [0.1, 0.05].map(|h| {
            let m = load(&ball(dir.path(), h, mirror, "level set"), None).unwrap();
            let t = m.topology();
            assert!(t.is_closed() && t.is_consistently_oriented() && t.leaks().is_none(), "{:?}", t.leaks());
            for f in m.faces.iter() {
                let [a, b, c] = f.map(|k| m.vertices[k as usize]);
                assert!((b - a).cross(c - a).dot(a + b + c) > 0.0, "a face looks inward");
            }
            let far = m.vertices.iter().map(|p| (p.length() - RADIUS).abs()).fold(0.0, f64::max);
            println!("h {h}: {} faces, farthest vertex {far:.2e}", m.faces.len());
            assert!(far < h * h, "{far}");
            let s = size(&m);
            [0, 1].map(|k| s[k] / truth[k] - 1.0)
        });
        println!("mirrored {mirror}: relative errors of area and volume {errors:?}");
        for k in 0..2 {
            assert!(
                errors[0][k].abs() < ORDER * (0.1 / RADIUS).powi(2) && errors[1][k].abs() < 0.3 * errors[0][k].abs(),
                "{errors:?}"
            );
        }
    }
}

#[test]
fn other_classes_need_an_isovalue() {
    let dir = tempfile::tempdir().unwrap();
    let fog = ball(dir.path(), 0.1, false, "fog volume");
    let e = load(&fog, None).unwrap_err();
    assert!(e.contains("`ball` is no level set") && e.contains("isovalue"), "{e}");
    // Whatever class: the front is the outside of what is enclosed.
    let [_, volume] = size(&load(&fog, Some(-0.1)).unwrap());
    assert!(
        (volume / (4.0 / 3.0 * std::f64::consts::PI * 0.7_f64.powi(3)) - 1.0).abs() < ORDER * (0.1_f64 / 0.7).powi(2),
        "{volume}"
    );
    assert!(load(&fog, Some(7.0)).unwrap_err().contains("no surface"));
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0"/><integrator type="path"/><sensor type="perspective"/><shape type="openvdb"><string name="filename" value="{}"/><float name="isovalue" value="$x"/></shape></scene>"#,
        fog.display()
    );
    let desc = tyndall::scene::SceneDesc::parse(&text, Path::new("s.xml"), &[]).unwrap();
    let e = tyndall::scene::Scene::compile(&desc, &Default::default()).err().unwrap().to_string();
    assert!(e.contains("`isovalue` cannot be a parameter"), "{e}");
}

/// In a scene it is what the same mesh is as an obj file: the same picture, and the same derivative as it moves (4.5 s.e.).
#[test]
fn a_level_set_moves_like_a_mesh() {
    let dir = tempfile::tempdir().unwrap();
    let file = ball(dir.path(), 0.2, false, "level set");
    let m = load(&file, None).unwrap();
    let lines = m.vertices.iter().map(|p| format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z));
    let lines = lines.chain(m.faces.iter().map(|f| format!("f {} {} {}\n", f[0] + 1, f[1] + 1, f[2] + 1)));
    let obj = dir.path().join("ball.obj");
    std::fs::write(&obj, lines.collect::<String>()).unwrap();
    let both = [("openvdb", &file), ("obj", &obj)].map(|(kind, path)| {
        let text = format!(
            r#"<scene version="3.0.0"><default name="x" value="0.1"/><integrator type="path"><integer name="max_depth" value="3"/></integrator>
    <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 1, -4" target="0, 0, 0" up="0, 1, 0"/></transform>
      <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
    <shape type="{kind}"><string name="filename" value="{}"/><transform name="to_world"><translate x="$x"/></transform><bsdf type="diffuse"/></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/><translate y="3" x="1"/></transform>
      <emitter type="area"><rgb name="radiance" value="10"/></emitter></shape></scene>"#,
            path.display()
        );
        let (desc, sc) = scene(&text);
        let p = params(&desc, &sc, &["x"]);
        let o = run(&sc, 1 << 15, 5, Mode::Forward(&p));
        [estimate(&o, 0), estimate(&o, 1)]
    });
    let [[a, da], [b, db]] = both;
    println!("{a:?} {b:?}\n{da:?} {db:?}");
    assert!(a.value[0] > 0.005 && (a.value[0] - b.value[0]).abs() <= 1e-9 * a.value[0]);
    let se = da.error[0].hypot(db.error[0]);
    assert!((da.value[0] - db.value[0]).abs() <= 4.5 * se && se < 0.1 * da.value[0].abs(), "{da:?} {db:?}");
}

/// As the border of a medium that moves, at the edge of the picture: the border's terms are the whole derivative, and agree with differences (4.5 s.e. and 3 %, false
/// alarm 2e-3 a channel at most).
#[test]
fn a_level_set_moves_the_medium_within() {
    let dir = tempfile::tempdir().unwrap();
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.3"/><integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
    <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="1.5, 2.5, 0.8"/><float name="albedo" value="0.8"/></medium>
    <sensor type="perspective"><float name="fov" value="16"/><transform name="to_world"><lookat origin="0, 1, -4" target="0, 0, 0" up="0, 1, 0"/></transform>
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
    <shape type="openvdb"><string name="filename" value="{}"/><transform name="to_world"><scale x="0.6"/><translate x="$x"/></transform><bsdf type="null"/>
      <ref name="interior" id="fog"/></shape>
    <shape type="rectangle"><transform name="to_world"><scale value="0.5"/><rotate x="1" angle="90"/><translate y="3" x="1"/></transform>
      <emitter type="area"><rgb name="radiance" value="10"/></emitter></shape></scene>"#,
        ball(dir.path(), 0.2, false, "level set").display()
    );
    let of = |terms: &str, spp| forward_of(&text, Orders::default(), &["x"], &[terms], spp)[1];
    assert_eq!(of("interior", 64).value.abs().max(), 0.0);
    let (ours, fd) = (of("all", 1 << 15), difference(&text, Orders::default(), "x", 0.02, 1 << 17));
    println!("{ours:?}, differences {fd:?}");
    for c in 0..3 {
        let (se, size) = (fd.error[c].hypot(ours.error[c]), fd.value[c].abs());
        assert!((ours.value[c] - fd.value[c]).abs() <= 4.5 * se + 0.03 * size, "{ours:?} {fd:?}");
        assert!(se < 0.1 * size, "{ours:?} {fd:?}");
    }
}
