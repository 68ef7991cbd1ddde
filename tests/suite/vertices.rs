//! Gradients with respect to every vertex of a mesh: against the derivatives of transforms (the same samples), against finite differences of
//! pictures with a vertex moved in the file, and with terms left out.

use crate::common::{job, run, scene};
use tempfile::TempDir;
use tyndall::math::{DVec3, Rgb, rng::Rng, stats::Moments};
use tyndall::params::ParamSet;
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::{Plan, Terms};
use tyndall::scene::{Scene, SceneDesc};
use tyndall::shape::Shape;

type Mesh = (Vec<DVec3>, Vec<[usize; 3]>);

/// An octahedron out of shape: closed, no two faces of one plane.
fn gem() -> Mesh {
    let v =
        [[0.6, 0.05, 0.0], [-0.5, 0.1, 0.1], [0.05, 0.55, 0.1], [0.0, -0.5, 0.05], [0.1, 0.0, 0.6], [0.0, 0.1, -0.5]];
    let f = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    (v.map(DVec3::from_array).to_vec(), f.to_vec())
}

/// A shield of eight faces around a raised middle, facing +z: vertex 4 is inside, the others are its border.
fn shield() -> Mesh {
    let z = [0.0, 0.08, -0.05, 0.05, 0.35, 0.02, -0.03, 0.06, 0.0];
    let v = (0..9).map(|k| DVec3::new((k % 3) as f64 * 0.6 - 0.6, (k / 3) as f64 * 0.6 - 0.6, z[k])).collect();
    let ring = [0, 1, 2, 5, 8, 7, 6, 3];
    (v, (0..8).map(|k| [ring[k], ring[(k + 1) % 8], 4]).collect())
}

/// A bent lamp of two triangles, lighting what is below and before it.
fn lamp() -> Mesh {
    let v = [[-0.4, -0.2, -0.4], [0.5, -0.1, -0.3], [0.4, 0.3, 0.4], [-0.3, 0.45, 0.4]];
    (v.map(DVec3::from_array).to_vec(), vec![[0, 1, 2], [0, 2, 3]])
}

/// As a Wavefront file; the soup repeats every corner.
fn obj((v, f): &Mesh, soup: bool) -> String {
    let point = |p: DVec3| format!("v {:?} {:?} {:?}\n", p.x, p.y, p.z);
    let (mut points, mut faces) = (String::new(), String::new());
    if !soup {
        v.iter().for_each(|&p| points += &point(p));
    }
    for (k, t) in f.iter().enumerate() {
        if soup {
            t.iter().for_each(|&i| points += &point(v[i]));
            faces += &format!("f {} {} {}\n", 3 * k + 1, 3 * k + 2, 3 * k + 3);
        } else {
            faces += &format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
        }
    }
    points + &faces
}

/// A floor, a ball and the mesh `m.obj` under `light`; the mesh glows where `glow` says so.
fn room(place: &str, glow: &str, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <default name="s" value="0.8"/><default name="a" value="20"/><default name="x" value="0.1"/><default name="ball" value="0.35"/>
  <integrator type="path"><integer name="max_depth" value="3"/></integrator>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0.2, 1.2, 4" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="5"/><rfilter type="tent"/></film></sensor>
  <shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.5,0.4"/></bsdf></shape>
  <shape type="sphere" id="ball"><point name="center" value="-0.9, 0.4, 0.3"/><float name="radius" value="$ball"/><bsdf type="diffuse"/></shape>
  <shape type="obj" id="mesh"><string name="filename" value="m.obj"/>
    <transform name="to_world"><scale value="$s"/><rotate y="1" angle="$a"/><translate x="$x"/>{place}</transform>
    {glow}<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.6, 0.4, 0.5"/></bsdf></bsdf></shape>
  {light}
</scene>"#
    )
}

const POINT: &str = r#"<emitter type="point"><point name="position" value="0.7, 2.3, 0.6"/><rgb name="intensity" value="9,8,7"/></emitter>"#;
const LAMP: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/><translate x="0.3" y="2.2" z="0.6"/></transform>
    <emitter type="area"><rgb name="radiance" value="9,8,7"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf></shape>"#;
const GLOW: &str = r#"<emitter type="area"><rgb name="radiance" value="6,7,8"/></emitter>"#;

/// A scene with this mesh in its file, which lives as long as the folder.
fn scene_of(text: &str, mesh: &str) -> (SceneDesc, Scene, TempDir) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("m.obj");
    std::fs::write(&path, mesh).unwrap();
    let (desc, sc) = scene(&text.replace("m.obj", path.to_str().unwrap()));
    (desc, sc, dir)
}

/// Ready for a gradient; what `grad` would refuse is refused here too.
fn open(text: &str, mesh: &str, wrt: &[&str]) -> (Scene, ParamSet) {
    let (desc, mut sc, _dir) = scene_of(text, mesh);
    let names: Vec<String> = wrt.iter().map(|s| s.to_string()).collect();
    Plan::new(&desc, &names).and_then(|p| p.refuse()).unwrap_or_else(|e| panic!("{e}"));
    sc.open(&desc, &names).unwrap_or_else(|e| panic!("{e}"));
    let params = sc.param_set(&desc, &names).unwrap();
    (sc, params)
}

fn vertices(sc: &Scene) -> Vec<DVec3> {
    let Shape::Mesh(m) = &sc.shapes[2].shape else { panic!("no mesh") };
    m.vertices.to_vec()
}

/// Weights of the pixels: a loss is the sum of them times the picture.
fn adjoint(pixels: usize) -> Vec<Rgb> {
    let mut rng = Rng::keyed(9, 0, 0, 0);
    (0..pixels).map(|_| Rgb::from_fn(|_| (rng.uniform() - 0.2) / 30.0)).collect()
}

fn terms(names: &[&str]) -> Terms {
    Terms::parse(&names.iter().map(|n| n.to_string()).collect::<Vec<_>>()).unwrap()
}

const ROOMS: [&str; 4] = ["interior", "pixel_edge", "surface_edge", "light_shadow"];

/// A vector a vertex, and its standard errors.
struct Gradient {
    named: Vec<f64>,
    vertices: Vec<[DVec3; 2]>,
    slots: (Vec<f64>, Vec<f64>),
}

fn gradient(sc: &Scene, params: &ParamSet, names: &[&str], spp: u64) -> Gradient {
    let v = adjoint(sc.sensors[0].width * sc.sensors[0].height);
    let o = Job { terms: terms(names), ..job(sc, spp, 3, Mode::Reverse(params, &v)) }.run(&|_| {}).unwrap();
    assert_eq!(o.film.health.biasing(), 0, "{:?}", o.film.health.entries().collect::<Vec<_>>());
    let slots = o.gradient.unwrap();
    let range = params.arrays[0].range();
    let vectors = slots.0[range.clone()].chunks_exact(3).zip(slots.1[range].chunks_exact(3));
    let vertices = vectors.map(|(g, e)| [DVec3::from_slice(g), DVec3::from_slice(e)]).collect();
    Gradient { named: params.pull_back(&slots.0), vertices, slots }
}

/// Transforms move all vertices: contracted with their velocities, the vertices' gradient is the transform's derivative, whatever the term, from the same samples;
/// and forward mode agrees.
#[test]
fn transforms_are_sums_over_vertices() {
    let place = r#"<translate y="0.8" z="0.1"/>"#;
    for light in [POINT, LAMP] {
        let text = room(place, "", light);
        let names = ["mesh.vertices", "x", "a", "s"];
        let (sc, params) = open(&text, &obj(&gem(), false), &names);
        let t = DVec3::new(0.1, 0.8, 0.1);
        let velocities =
            [&(|_| DVec3::X) as &dyn Fn(DVec3) -> DVec3, &|p| DVec3::Y.cross(p - t) * 1f64.to_radians(), &|p| {
                (p - t) / 0.8
            }];
        let (desc, still, _dir) = scene_of(&text, &obj(&gem(), false));
        let own = crate::common::params(&desc, &still, &names[1..]);
        for chosen in ROOMS.iter().chain(["all"].iter()) {
            // Few grazing lines end on something at both ends.
            let spp = if *chosen == "surface_edge" { 1024 } else { 64 };
            let g = gradient(&sc, &params, &[*chosen], spp);
            let forward =
                Job { terms: terms(&[*chosen]), ..job(&still, spp, 3, Mode::Forward(&own)) }.run(&|_| {}).unwrap();
            for (k, v) in velocities.iter().enumerate() {
                let parts = vertices(&sc).into_iter().zip(&g.vertices).map(|(p, g)| v(p).dot(g[0]));
                let (sum, size) = parts.fold((0.0, 0.0), |(s, a): (f64, f64), x| (s + x, a + x.abs()));
                let name = names[k + 1];
                assert!((sum - g.named[k]).abs() <= 1e-10 * size, "{chosen} {name}: {sum} {} of {size}", g.named[k]);
                assert!(size > 0.0 || (*chosen == "light_shadow" && light == LAMP), "{chosen} {name}: nothing");
                // Rooms share out their samples by what is asked for; the interior's are the same.
                if *chosen == "interior" {
                    let v = adjoint(30);
                    let dot: f64 = (0..30).map(|i| forward.film.mean(k + 1, i).dot(v[i])).sum();
                    assert!((dot - sum).abs() <= 1e-9 * size, "{name}: {dot} {sum}");
                }
            }
        }
    }
}

/// Copies of a vertex in a triangle soup share its gradient: from the same samples, they add up to that of the welded mesh.
#[test]
fn copies_add_up_to_the_welded_vertex() {
    let text = room(r#"<translate y="0.8" z="0.1"/>"#, "", POINT);
    let mesh = gem();
    let of = |soup: bool| {
        let (sc, params) = open(&text, &obj(&mesh, soup), &["mesh.vertices"]);
        gradient(&sc, &params, &["all"], 64)
    };
    let (welded, soup) = (of(false), of(true));
    assert_eq!((welded.vertices.len(), soup.vertices.len()), (6, 24));
    let corners: Vec<usize> = mesh.1.iter().flatten().copied().collect();
    // The reader numbers vertices as faces name them.
    let mut order: Vec<usize> = Vec::new();
    corners.iter().for_each(|i| {
        if !order.contains(i) {
            order.push(*i)
        }
    });
    for (k, v) in order.iter().enumerate() {
        let copies = soup.vertices.iter().zip(&corners).filter(|(_, c)| *c == v);
        let (sum, size) = copies.fold((DVec3::ZERO, 0.0), |(s, a), (g, _)| (s + g[0], a + g[0].length()));
        assert!((sum - welded.vertices[k][0]).length() <= 1e-9 * size, "{v}: {sum} {}", welded.vertices[k][0]);
    }
}

#[test]
fn threads_change_no_bit() {
    let text = room(r#"<translate y="0.8" z="0.1"/>"#, "", POINT);
    // Several tiles.
    let text = text
        .replace(r#"name="width" value="6""#, r#"name="width" value="30""#)
        .replace(r#"name="height" value="5""#, r#"name="height" value="25""#);
    let (sc, params) = open(&text, &obj(&gem(), false), &["mesh.vertices", "x"]);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| gradient(&sc, &params, &["all"], 32).slots)
    };
    assert_eq!(with(1), with(2));
}

#[test]
fn a_mesh_that_passes_through_itself_is_refused() {
    let mut mesh = gem();
    mesh.0[0] = DVec3::new(-0.45, 0.75, 0.1);
    let (sc, params) =
        open(&room(r#"<translate y="1.2" z="0.1"/>"#, "", POINT), &obj(&mesh, false), &["mesh.vertices"]);
    let adjoint = adjoint(30);
    let job = job(&sc, 32, 1, Mode::Reverse(&params, &adjoint));
    let e = job.run(&|_| {}).err().expect("refused").to_string();
    // The same before anything is rendered.
    assert_eq!(job.refuse().unwrap_err().to_string(), e);
    assert!(e.contains("the mesh `mesh` passes through itself"), "{e}");
}

/// A vertex of the file in a direction of the world, and the step.
type Move = (usize, DVec3, f64);

/// Derivatives of the loss by central differences of pictures with the vertex moved, with common random numbers; from eight seeds.
fn differences(text: &str, mesh: &Mesh, moves: &[Move], spp: u64) -> Vec<Moments> {
    let v = adjoint(30);
    let side = |&(k, d, h): &Move, seed: u64| {
        let mut mesh = mesh.clone();
        mesh.0[k] += d * h;
        let (_, sc, _dir) = scene_of(text, &obj(&mesh, false));
        let o = run(&sc, spp / 8, 100 + seed, Mode::Picture);
        (0..30).map(|i| o.film.mean(0, i).dot(v[i])).sum::<f64>()
    };
    let slope = |m: &Move, seed| (side(m, seed) - side(&(m.0, m.1, -m.2), seed)) / (2.0 * m.2);
    moves.iter().map(|m| (0..8).map(|seed| slope(m, seed)).collect()).collect()
}

/// The mesh's own directions are the world's here.
fn straight(text: &str) -> String {
    text.replace(r#"name="s" value="0.8""#, r#"name="s" value="1""#)
        .replace(r#"name="a" value="20""#, r#"name="a" value="0""#)
}

/// Single vertices against differences: 5 standard errors, and `slack` for what the step leaves; with each of `needed` left out they must differ by more.
fn against_differences(text: &str, mesh: &Mesh, moves: &[Move], needed: &[&str], spp: u64, slack: f64) {
    let text = straight(text);
    let found = differences(&text, mesh, moves, spp);
    let (sc, params) = open(&text, &obj(mesh, false), &["mesh.vertices"]);
    let order = sc.file_order(&params.arrays[0]).map(<[u32]>::to_vec);
    let at = |k: usize| order.as_ref().map_or(k, |o| o.iter().position(|&i| i as usize == k).unwrap());
    // In units of what is allowed, the largest.
    let distance = |names: &[&str], say: bool| {
        let g = gradient(&sc, &params, names, spp);
        let each = moves.iter().zip(&found).map(|(&(k, d, _), fd)| {
            let [value, error] = g.vertices[at(k)];
            let (x, e) = (value.dot(d), (error * d).length());
            let allowed = 5.0 * e.hypot(fd.standard_error()) + slack * fd.mean.abs();
            if say {
                println!("vertex {k} along {d}: {x:.6} +- {e:.6}, fd {:.6} +- {:.6}", fd.mean, fd.standard_error());
            }
            (x - fd.mean).abs() / allowed
        });
        each.fold(0.0f64, |m, x| if x.is_nan() { f64::INFINITY } else { m.max(x) })
    };
    let d = distance(&["all"], true);
    assert!(d <= 1.0, "{d}");
    for out in needed {
        let rest: Vec<&str> = ROOMS.into_iter().chain(["hard_profile", "medium_edge"]).filter(|n| n != out).collect();
        let d = distance(&rest, false);
        println!("without {out}: {d:.2}");
        assert!(d > 1.0, "without {out}: {d}");
    }
}

/// Vertices on the gem's outline, on top of it, toward the camera; their shadow on the floor.
#[test]
fn a_gem_under_a_point_light() {
    let text = room(r#"<translate y="0.8" z="0.1"/>"#, "", POINT);
    let moves = [(0, DVec3::X, 0.02), (2, DVec3::Y, 0.02), (1, DVec3::Z, 0.02), (4, DVec3::new(0.6, 0.0, 0.8), 0.02)];
    against_differences(&text, &gem(), &moves, &["interior", "pixel_edge", "light_shadow"], 1 << 13, 0.04);
}

/// The vertex inside an open, curved sheet, and one of its border.
#[test]
fn a_shield_under_a_lamp() {
    let text = room(r#"<translate y="0.9" z="0.1"/>"#, "", LAMP);
    let moves = [(4, DVec3::Z, 0.03), (5, DVec3::X, 0.03), (7, DVec3::Y, 0.03)];
    against_differences(&text, &shield(), &moves, &["interior", "pixel_edge", "surface_edge"], 1 << 13, 0.04);
}

/// The edge of a spot's cone over a curved sheet.
#[test]
fn a_shield_under_a_hard_spot() {
    let spot = r#"<emitter type="spot"><transform name="to_world"><lookat origin="0.6, 2.2, 2.5" target="0.2, 0.9, 0.1" up="0, 1, 0"/></transform>
      <float name="cutoff_angle" value="7"/><float name="beam_width" value="7"/><rgb name="intensity" value="40"/></emitter>"#;
    let text = room(r#"<translate y="0.9" z="0.1"/>"#, "", spot);
    let moves = [(7, DVec3::Z, 0.03), (1, DVec3::Z, 0.03)];
    against_differences(&text, &shield(), &moves, &["hard_profile"], 1 << 13, 0.04);
}

/// A lamp that is a mesh: in the picture, and above it.
#[test]
fn a_bent_lamp() {
    let place = |y: f64| room(&format!(r#"<translate y="{y}" z="-0.2"/>"#), GLOW, "");
    let moves = [(1, DVec3::Y, 0.03), (2, DVec3::X, 0.03), (3, DVec3::Z, 0.03)];
    against_differences(&place(1.5), &lamp(), &moves, &["interior", "pixel_edge"], 1 << 13, 0.04);
    against_differences(&place(2.4), &lamp(), &moves, &["interior"], 1 << 13, 0.04);
}

/// The same room in a fog that ends within the floor.
fn foggy(text: &str, sigma_t: f64) -> String {
    let fog = format!(
        r#"<medium type="homogeneous" id="fog"><float name="sigma_t" value="{sigma_t}"/><rgb name="albedo" value="0.8, 0.7, 0.6"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale x="1.7" y="1.3" z="1.7"/><translate y="1.15"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
</scene>"#
    );
    text.replace(r#"type="path""#, r#"type="volpath""#).replace("</scene>", &fog)
}

/// Numbers that the slots' gradient makes.
type Read<'a> = &'a dyn Fn(&Scene, &ParamSet, &[f64]) -> Vec<f64>;

/// What `of` makes of the gradient of a gem in this room, a list a seed.
fn by_seed(text: &str, wrt: &[&str], seeds: u64, spp: u64, of: Read) -> Vec<Vec<f64>> {
    let (sc, params) = open(text, &obj(&gem(), false), wrt);
    let v = adjoint(30);
    let run = |seed| {
        let o = job(&sc, spp, 50 + seed, Mode::Reverse(&params, &v)).run(&|_| {}).unwrap();
        assert_eq!(o.film.health.biasing(), 0);
        of(&sc, &params, &o.gradient.unwrap().0)
    };
    (0..seeds).map(run).collect()
}

/// Around a mesh that moves as a whole the medium follows otherwise than around one whose vertices all do: the derivatives are the same.
#[test]
#[ignore = "make stress"]
fn transforms_in_fog_are_sums_over_vertices() {
    let t = DVec3::new(0.1, 0.8, 0.1);
    let velocities: [&dyn Fn(DVec3) -> DVec3; 3] =
        [&|_| DVec3::X, &|p| DVec3::Y.cross(p - t) * 1f64.to_radians(), &|p| (p - t) / 0.8];
    let names = ["x", "a", "s"];
    let text = foggy(&room(r#"<translate y="0.8" z="0.1"/>"#, "", POINT), 0.5);
    let sums = |sc: &Scene, params: &ParamSet, slots: &[f64]| -> Vec<f64> {
        let first = params.arrays[0].range().start;
        let each = || vertices(sc).into_iter().zip(slots[first..].chunks_exact(3).map(DVec3::from_slice));
        velocities.iter().map(|v| each().map(|(p, g)| v(p).dot(g)).sum()).collect()
    };
    // Both at once: the same samples.
    let all = ["mesh.vertices", "x", "a", "s"];
    let both =
        |sc: &Scene, params: &ParamSet, slots: &[f64]| [sums(sc, params, slots), params.pull_back(slots)].concat();
    // But for second vertices that keep to their direction (`First::beside`): what their face's matter would do at the first vertex, off the face, a transform says otherwise than
    // three corners do, unless it only shifts. Either way the mean is the same.
    let runs = by_seed(&text, &all, 48, 64, &both);
    for k in 0..3 {
        let own: Moments = runs.iter().map(|r| r[k]).collect();
        let d: Moments = runs.iter().map(|r| r[k] - r[k + 3]).collect();
        if k == 0 {
            assert!(d.mean.abs() <= 1e-9 * own.mean.abs(), "{d:?} {own:?}");
        } else {
            let (error, least) = (d.standard_error(), 0.01 * own.mean.abs());
            assert!(d.mean.abs() <= 4.5 * error && error < least, "{}: {d:?} {own:?}", names[k]);
        }
    }
    // One by one: the same paths where nothing but velocities differs, so that pairs are compared.
    let ours = by_seed(&text, &["mesh.vertices"], 32, 1 << 10, &sums);
    let whole = by_seed(&text, &names, 32, 1 << 10, &|_, params, slots| params.pull_back(slots));
    for k in 0..3 {
        let mean = whole.iter().map(|b| b[k]).sum::<f64>() / whole.len() as f64;
        let off: Moments = ours.iter().zip(&whole).map(|(a, b)| a[k] - b[k]).collect();
        let se = off.standard_error();
        println!("{}: {mean}, apart by {} +- {se}", names[k], off.mean);
        assert!(off.mean.abs() <= 4.5 * se && se <= 0.1 * mean.abs(), "{}: {mean}, {} +- {se}", names[k], off.mean);
        assert!(se > 0.0, "the fields are one");
    }
}

/// A gem in fog, single vertices: its outline, its shadow through the fog, its faces.
#[test]
#[ignore = "make stress"]
fn a_gem_in_fog() {
    let text = foggy(&room(r#"<translate y="0.8" z="0.1"/>"#, "", POINT), 0.5);
    let moves = [(0, DVec3::X, 0.03), (2, DVec3::Y, 0.03), (4, DVec3::new(0.6, 0.0, 0.8), 0.03)];
    against_differences(&text, &gem(), &moves, &["interior", "pixel_edge", "light_shadow"], 1 << 13, 0.04);
}

/// The shadow of a large lamp in thick fog.
#[test]
#[ignore = "make stress"]
fn a_gem_under_a_lamp_in_fog() {
    let text = foggy(&room(r#"<translate y="1.2" z="0.2"/>"#, "", LAMP), 1.5);
    let moves = [(0, DVec3::X, 0.03), (1, DVec3::X, 0.03), (4, DVec3::Z, 0.03)];
    against_differences(&text, &gem(), &moves, &["medium_edge"], 1 << 14, 0.04);
}

/// A bent lamp in fog.
#[test]
fn a_bent_lamp_in_fog() {
    let text = foggy(&room(r#"<translate y="1.5" z="-0.2"/>"#, GLOW, ""), 0.5);
    let moves = [(1, DVec3::Y, 0.03), (2, DVec3::X, 0.03), (3, DVec3::Z, 0.03)];
    against_differences(&text, &lamp(), &moves, &["interior"], 1 << 12, 0.04);
}

/// [T] T9: surfaces emit 1 - ρ and reflect ρ, fog and sky emit 1. No vertex changes a picture that is 1.
#[test]
fn vertices_of_an_isothermal_enclosure_change_nothing() {
    let surface = |rho: f64| {
        format!(
            r#"<emitter type="area"><rgb name="radiance" value="{}"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf>"#,
            1.0 - rho
        )
    };
    let text = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.4"/><rgb name="emission" value="1"/></medium>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0.2, 1.2, 4" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="5"/><rfilter type="tent"/></film></sensor>
  <shape type="sphere"><point name="center" value="-0.9, 0.4, 0.3"/><float name="radius" value="0.35"/>{}</shape>
  <shape type="cube"><transform name="to_world"><scale x="1.7" y="1.3" z="1.7"/><translate y="1.15"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="obj" id="mesh"><string name="filename" value="m.obj"/><transform name="to_world"><translate y="0.8" z="0.1"/></transform>{}</shape>
  <emitter type="constant"/></scene>"#,
        surface(0.5),
        surface(0.6)
    );
    let (sc, params) = open(&text, &obj(&gem(), false), &["mesh.vertices"]);
    let worst = |names: &[&str]| {
        let g = gradient(&sc, &params, names, 1 << 11);
        let scores = g.vertices.iter().flat_map(|[x, e]| (0..3).map(move |k| (x[k] / e[k]).abs()));
        println!("{names:?}: {:?}", g.vertices);
        scores.fold(0.0f64, |m, z| if z.is_nan() { f64::INFINITY } else { m.max(z) })
    };
    let z = worst(&["all"]);
    assert!(z < 4.0, "{z}");
    let z = worst(&["interior", "pixel_edge", "surface_edge", "light_shadow"]);
    assert!(z > 6.0, "without medium_edge: {z}");
}
