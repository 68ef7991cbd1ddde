//! The velocities of medium points ([T] (57), (58), (60)): on what moves, on what stands still, their divergence against differences, and the optical depth
//! between moving ends.

use crate::common::{params, scene};
use tyndall::math::rng::Rng;
use tyndall::math::stats::Moments;
use tyndall::math::{DVec2, DVec3, Rgb};
use tyndall::params::{Covector, Forward, ParamSet, Sink, Slot};
use tyndall::scene::{On, Scene};
use tyndall::shape::{Geometry, Shape};
use tyndall::transport::first::{First, Met, Seen};
use tyndall::transport::motion::Moving;
use tyndall::transport::record::MediumSpan;
use tyndall::transport::velocity::{Rate, Source, Velocity};

/// A ball and a block (turned and grown) over a floor, in a box of fog, a light in it.
const TEXT: &str = r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="r" value="0.3"/><default name="turn" value="20"/><default name="cx" value="0"/><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.7"/><float name="albedo" value="0.8"/></medium>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="$cx, 1, 5" target="0, 0.6, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="cube"><transform name="to_world"><scale value="2"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="1.5"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" value="$x, 0.7, 0.2"/><float name="radius" value="$r"/><bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.2"/><rotate y="1" angle="$turn"/><translate x="-0.8" y="0.5"/></transform><bsdf type="diffuse"/></shape>
  <emitter type="point"><point name="position" value="0.6, 1.4, 0.1"/></emitter></scene>"#;

const NAMES: [&str; 4] = ["x", "r", "turn", "cx"];

struct Case {
    scene: Scene,
    params: ParamSet,
    moving: Moving,
}

fn case() -> Case {
    let (desc, scene) = scene(TEXT);
    let params = params(&desc, &scene, &NAMES);
    let moving = Moving::new(&scene, &scene.sensors[0], &params).unwrap();
    Case { scene, params, moving }
}

impl Case {
    /// The vector of one parameter.
    fn vector(&self, v: &Velocity, k: usize) -> DVec3 {
        let along = |axis: DVec3| {
            let mut c = Covector::default();
            c.add(axis, Rgb::ONE);
            let mut sink = Forward::new(&self.params);
            v.apply(&self.scene, &self.scene.sensors[0], &c, &mut sink);
            sink.image[k][0]
        };
        DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z))
    }

    fn number(&self, r: &Rate, k: usize) -> f64 {
        let mut sink = Forward::new(&self.params);
        r.apply(&self.scene, &self.scene.sensors[0], Rgb::ONE, &mut sink);
        sink.image[k][0]
    }

    fn at(&self, first: &First, p: DVec3) -> (Velocity, Rate) {
        self.moving.in_medium(&self.scene, first, p, true)
    }

    /// |V| is Lipschitz and its divergence is right, around `p`.
    fn is_smooth(&self, first: &First, p: DVec3) {
        let h = 1e-5;
        let (_, rate) = self.at(first, p);
        for k in 0..NAMES.len() {
            let v = |p: DVec3| self.vector(&self.at(first, p).0, k);
            let axis = |a: DVec3| (v(p + a * h) - v(p - a * h)).dot(a) / (2.0 * h);
            let divergence = axis(DVec3::X) + axis(DVec3::Y) + axis(DVec3::Z);
            let own = self.number(&rate, k);
            assert!((divergence - own).abs() < 1e-4 * (1.0 + own.abs()), "{} at {p}: {own}, {divergence}", NAMES[k]);
        }
    }
}

#[test]
fn the_field_is_what_moves_and_nothing_elsewhere() {
    let c = case();
    let still = First::default();
    let on_ball = DVec3::new(0.1, 0.7, 0.2) + DVec3::new(0.6, 0.48, 0.64) * 0.3;
    let (v, _) = c.at(&still, on_ball);
    assert!((c.vector(&v, 0) - DVec3::X).length() < 1e-9);
    assert!((c.vector(&v, 1) - DVec3::new(0.6, 0.48, 0.64)).length() < 1e-9);
    assert!(c.vector(&v, 2).length() < 1e-9);
    // Floor, border, light, far away.
    for p in
        [DVec3::new(0.2, 0.0, 0.1), DVec3::new(0.3, 2.0, 0.2), DVec3::new(0.6, 1.4, 0.1), DVec3::new(1.6, 1.2, -1.5)]
    {
        let (v, _) = c.at(&still, p);
        (0..4).for_each(|k| assert!(c.vector(&v, k).length() < 1e-9, "{p}"));
    }
}

/// Of a mesh that lies partly within reach of what moves only faces there are looked at, and of one far away none: V is 0 on all of them all the same.
#[test]
fn the_field_ends_on_meshes_that_are_partly_within_reach() {
    let folder = tempfile::tempdir().unwrap();
    let sheet = |name: &str, z: f64| {
        let mut obj = String::new();
        let n = 41;
        for i in 0..n * n {
            let (x, y) = (f64::from(i % n) / 10.0 - 2.0, f64::from(i / n) / 10.0 - 2.0);
            obj += &format!("v {x} {y} {}\n", z + 0.1 * (3.0 * x).sin());
        }
        for i in (0..n * (n - 1)).filter(|i| i % n < n - 1) {
            obj += &format!("f {} {} {}\nf {} {} {}\n", i + 1, i + 2, i + n + 2, i + 1, i + n + 2, i + n + 1);
        }
        std::fs::write(folder.path().join(name), obj).unwrap();
        format!(
            r#"<shape type="obj"><string name="filename" value="{name}"/><boolean name="face_normals" value="true"/><bsdf type="diffuse"/></shape>"#
        )
    };
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.7"/><float name="albedo" value="0.8"/></medium>
  <sensor type="perspective"><ref id="fog"/><transform name="to_world"><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="sphere"><point name="center" value="$x, 0.3, 0"/><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>{}{}
  <emitter type="constant"/></scene>"#,
        sheet("near.obj", -0.45),
        sheet("far.obj", -1.9)
    );
    let path = folder.path().join("sheets.xml");
    let desc = tyndall::scene::SceneDesc::parse(&text, &path, &[]).unwrap();
    let scene = Scene::compile(&desc, &Default::default()).unwrap();
    let params = params(&desc, &scene, &["x"]);
    let moving = Moving::new(&scene, &scene.sensors[0], &params).unwrap();
    let c = Case { scene, params, moving };
    let (mut moves, mut rng) = (0, Rng::keyed(5, 0, 0, 0));
    for shape in [1, 2] {
        let Shape::Mesh(m) = &c.scene.shapes[shape].shape else { panic!("no mesh") };
        for face in 0..m.faces.len() as u32 {
            let [o, a, b] = m.corners(face);
            let u = rng.uniform();
            let p = o + (a - o) * (1.0 - u) * rng.uniform() + (b - o) * u;
            let v = |p: DVec3| c.vector(&c.at(&First::default(), p).0, 0).length();
            assert!(v(p) < 1e-9, "{p}");
            moves += usize::from(v(p + DVec3::Z * 0.05) > 0.0);
        }
    }
    assert!(moves > 50, "{moves}");
}

#[test]
fn divergences_are_those_of_the_field() {
    let c = case();
    let mut rng = Rng::keyed(3, 0, 0, 0);
    let mut near = 0;
    for _ in 0..200 {
        let p = DVec3::new(0.1, 0.7, 0.2) + (DVec3::new(rng.uniform(), rng.uniform(), rng.uniform()) - 0.5) * 1.3;
        let (v, _) = c.at(&First::default(), p);
        near += usize::from(!v.is_zero());
        c.is_smooth(&First::default(), p);
    }
    assert!(near > 50);
}

/// First vertices in the medium before a ball, a floor and a block, and on a ball: what they carry along.
#[test]
fn first_vertices_carry_their_motion() {
    let c = case();
    let line = c.moving.film_line(&c.scene);
    let sensor = &c.scene.sensors[0];
    let mut rng = Rng::keyed(4, 0, 0, 0);
    let mut carried = 0;
    for target in
        [DVec3::new(0.15, 0.75, 0.4), DVec3::new(0.5, 0.0, 0.3), DVec3::new(-0.8, 0.5, 0.1), DVec3::new(0.3, 0.6, 0.0)]
    {
        let q = sensor.project(target).unwrap();
        let enter = c.scene.intersect(q.o, q.w, f64::INFINITY, &On::default(), None).unwrap();
        let on = On::at(&enter);
        let hit = c.scene.intersect(enter.p, q.w, f64::INFINITY, &on, Some(0)).unwrap();
        let span = MediumSpan::new(0, enter.p, q.w, hit.t, &on, Some(&hit));
        for t in [0.3, 0.8, 0.97, 0.999].map(|f| f * hit.t) {
            let p = enter.p + q.w * t;
            let first = line.first(&Seen::Medium { p, span });
            // At the vertex itself: its own velocity.
            let (v, _) = c.at(&first, p + DVec3::new(1e-9, 0.0, 0.0));
            for k in 0..4 {
                let (own, around) = (c.vector(&first.velocity, k), c.vector(&v, k));
                assert!((own - around).length() < 1e-5 * (1.0 + own.length()), "{} at {p}: {own} {around}", NAMES[k]);
            }
            // The stretch along the ray, by differences.
            let h = 1e-6;
            let at = |t: f64| line.first(&Seen::Medium { p: enter.p + q.w * t, span }).velocity;
            for k in 0..4 {
                let slope = (c.vector(&at(t + h), k) - c.vector(&at(t - h), k)).dot(q.w) / (2.0 * h);
                let own = c.number(&first.stretch, k);
                assert!((slope - own).abs() < 1e-5 * (1.0 + own.abs()), "{}: {own} {slope}", NAMES[k]);
            }
            for _ in 0..20 {
                let y = p + (DVec3::new(rng.uniform(), rng.uniform(), rng.uniform()) - 0.5) * 0.2;
                let inside = (y - DVec3::new(0.1, 0.7, 0.2)).length() < 0.3
                    || y.y < 0.0
                    || (y - DVec3::new(-0.8, 0.5, 0.0)).abs().max_element() < 0.3;
                if !inside {
                    carried += usize::from(first.carries());
                    c.is_smooth(&first, y);
                }
            }
            // On the surfaces around nothing leaves them: <n, ẋ> is the face's own.
            if hit.n.dot(q.w) != 0.0 {
                let (v, _) = c.at(&first, hit.p);
                let slide = line.first(&Seen::Surface { hit, w: q.w }).velocity;
                for k in 0..4 {
                    let gap = (c.vector(&v, k) - c.vector(&slide, k)).dot(hit.n);
                    assert!(gap.abs() < 1e-9, "{} on the face: {gap}", NAMES[k]);
                }
            }
        }
    }
    assert!(carried > 100);
}

/// A second vertex on a ball keeps to its direction from the first; medium points near it, and the ball beside it, go along.
#[test]
fn second_vertices_that_keep_to_their_direction_take_what_is_near_along() {
    let c = case();
    let (line, sensor) = (c.moving.film_line(&c.scene), &c.scene.sensors[0]);
    let Shape::Sphere(ball) = c.scene.shapes[2].shape else { panic!("no ball") };
    let mut rng = Rng::keyed(6, 0, 0, 0);
    let (mut held, mut moved) = (0, 0);
    for _ in 0..400 {
        // Past the ball, nearer than its radius.
        let p = ball.center + unit(&mut rng) * (ball.radius * (1.0 + 0.8 * rng.uniform()));
        let q = sensor.project(p).unwrap();
        let enter = c.scene.intersect(q.o, q.w, f64::INFINITY, &On::default(), None).unwrap();
        let on = On::at(&enter);
        let hit = c.scene.intersect(enter.p, q.w, f64::INFINITY, &on, Some(0)).unwrap();
        if hit.t + enter.t < q.distance {
            continue;
        }
        let span = MediumSpan::new(0, enter.p, q.w, hit.t, &on, Some(&hit));
        let first = line.first(&Seen::Medium { p, span });
        let Some(z) =
            c.scene.intersect(p, unit(&mut rng), f64::INFINITY, &On::default(), Some(0)).filter(|z| z.shape == 2)
        else {
            continue;
        };
        let Some(attached) = line.held(&first, [z.shape, z.face], z.p, z.n) else { continue };
        held += 1;
        let slide = first.ahead_of(&c.moving.field, &z).mapped(attached.map);
        let first = line.then(first, &Met::Surface(z));
        // Off the ball at z: its matter, what the first vertex makes it do, and the slide.
        let own =
            Velocity::of(Source::at(&z), z.p).plus(1.0, &Moving::on_surface(&first, z.p, false).0).plus(1.0, &slide);
        let (v, _) = c.moving.in_medium(&c.scene, &first, z.p + z.n * 1e-9, true);
        for k in 0..NAMES.len() {
            let (own, v) = (c.vector(&own, k), c.vector(&v, k));
            assert!((own - v).length() < 1e-5 * (1.0 + own.length()), "{} at {}: {own} {v}", NAMES[k], z.p);
            moved += usize::from(c.vector(&slide, k).length() > 0.1);
        }
        for _ in 0..10 {
            let y = z.p + z.n * (0.1 * rng.uniform()) + unit(&mut rng) * (0.1 * rng.uniform());
            if (y - ball.center).length() > ball.radius {
                c.is_smooth(&first, y);
            }
            // Along the ball it stays on it.
            let on = ball.center + (y - ball.center).normalize() * ball.radius;
            let over = Moving::on_surface(&first, on, true).0.plus(-1.0, &Moving::on_surface(&first, on, false).0);
            let n = (on - ball.center).normalize();
            (0..NAMES.len())
                .for_each(|k| assert!(c.vector(&over, k).dot(n).abs() < 1e-9 * (1.0 + c.vector(&over, k).length())));
        }
        // On the floor nothing of it is left.
        let far = DVec3::new(z.p.x, 0.0, z.p.z);
        let [a, b] = [true, false].map(|after| Moving::on_surface(&first, far, after).0);
        (0..NAMES.len()).for_each(|k| assert_eq!(c.vector(&a, k), c.vector(&b, k)));
    }
    assert!(held > 40 && moved > 50, "{held} {moved}");
}

/// Whatever a first vertex carries along a face that ends somewhere, nothing flows over its edge: no room counts that.
#[test]
fn nothing_is_carried_over_the_edge_of_a_face() {
    let text = TEXT
        .replace(
            r#"<emitter type="point">"#,
            r#"<shape type="rectangle"><transform name="to_world"><scale x="0.3" y="0.2"/><rotate y="1" angle="25"/><translate x="$x"/><translate y="1.4" z="0.6"/></transform><bsdf type="diffuse"/></shape>
  <shape type="disk"><transform name="to_world"><scale value="0.25"/><rotate x="1" angle="-30"/><translate x="$x"/><translate x="0.8" y="0.6" z="0.6"/></transform><bsdf type="diffuse"/></shape>
  <emitter type="point">"#,
        );
    let (desc, scene) = scene(&text);
    let params = params(&desc, &scene, &NAMES);
    let moving = Moving::new(&scene, &scene.sensors[0], &params).unwrap();
    let c = Case { scene, params, moving };
    let (line, sensor) = (c.moving.film_line(&c.scene), &c.scene.sensors[0]);
    let mut rng = Rng::keyed(5, 0, 0, 0);
    let mut carried = 0;
    for shape in [4u32, 5] {
        let s = &c.scene.shapes[shape as usize].shape;
        for _ in 0..60 {
            let target = s.sample(rng.uniform(), rng.uniform()).p;
            let q = sensor.project(target).unwrap();
            let enter = c.scene.intersect(q.o, q.w, f64::INFINITY, &On::default(), None).unwrap();
            let on = On::at(&enter);
            let hit = c.scene.intersect(enter.p, q.w, f64::INFINITY, &on, Some(0)).unwrap();
            assert_eq!(hit.shape, shape);
            let span = MediumSpan::new(0, enter.p, q.w, hit.t, &on, Some(&hit));
            let before = Seen::Medium { p: hit.p - q.w * (0.1 * rng.uniform()), span };
            for first in [line.first(&before), line.first(&Seen::Surface { hit, w: q.w })] {
                carried += usize::from(!Moving::on_surface(&first, hit.p, true).0.is_zero());
                for _ in 0..50 {
                    let (u, v) = (rng.uniform(), f64::from(u8::from(rng.uniform() < 0.5)));
                    let edge = match (shape, rng.uniform() < 0.5) {
                        (4, true) => DVec2::new(u, v),
                        (4, false) => DVec2::new(v, u),
                        // A disk's first coordinate is its radius.
                        _ => DVec2::new(1.0, u),
                    };
                    let p = s.position(0, edge);
                    let over = Moving::on_surface(&first, p, true).0;
                    (0..4).for_each(|k| assert!(c.vector(&over, k).length() < 1e-12, "{shape}: {p}"));
                }
            }
        }
    }
    assert!(carried > 100);
}

/// A dish of eight faces, hollow above, that moves as a whole and vertex by vertex between a floor, a ball, a light and the border of the fog.
struct Dish {
    case: Case,
    vertices: Vec<DVec3>,
    faces: Vec<[u32; 3]>,
    /// Of the vertices, beside the whole's.
    velocities: Vec<DVec3>,
}

/// Contracts with the velocities of a dish.
struct Contract<'a>(&'a Dish, f64);

impl Sink for Contract<'_> {
    fn add(&mut self, slot: Slot, partial: Rgb) {
        let array = self.0.case.params.arrays[0].range();
        self.1 += partial[0]
            * match (slot as usize).checked_sub(array.start).filter(|k| *k < array.len()) {
                Some(k) => self.0.velocities[k / 3][k % 3],
                None => self.0.case.params.tangents(slot)[0],
            };
    }
}

impl Dish {
    fn new() -> Dish {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.obj");
        let points = "v 0.6 0.05 0\nv 0.05 -0.1 0.1\nv 0.1 0 0.6\nv -0.5 0.1 0.1\nv 0 -0.5 0.05\nv 0 0.1 -0.5\n";
        // The last is a line, as files have them.
        let faces = "f 1 2 3\nf 2 4 3\nf 4 5 3\nf 5 1 3\nf 2 1 6\nf 4 2 6\nf 5 4 6\nf 1 5 6\nf 1 5 5\n";
        std::fs::write(&path, points.to_string() + faces).unwrap();
        let mesh = format!(
            r#"<shape type="obj" id="dish"><string name="filename" value="{}"/><transform name="to_world"><scale value="0.7"/><translate x="$x" y="0.7" z="0.2"/></transform><bsdf type="diffuse"/></shape>"#,
            path.display()
        );
        let text = TEXT
            .replace(r#"value="$x, 0.7, 0.2""#, r#"value="-0.3, 1.3, 0.3""#)
            .replace("</scene>", &(mesh + "</scene>"));
        let (desc, mut scene) = scene(&text);
        let names = ["x", "dish.vertices"].map(String::from);
        scene.open(&desc, &names).unwrap();
        let params = scene.param_set(&desc, &names).unwrap();
        let moving = Moving::new(&scene, &scene.sensors[0], &params).unwrap();
        let Shape::Mesh(m) = &scene.shapes[4].shape else { panic!("no mesh") };
        let (vertices, faces) = (m.vertices.to_vec(), m.faces.iter().copied().filter(|f| f[1] != f[2]).collect());
        let mut rng = Rng::keyed(6, 0, 0, 0);
        let velocities = vertices.iter().map(|_| unit(&mut rng)).collect();
        Dish { case: Case { scene, params, moving }, vertices, faces, velocities }
    }

    fn at(&self, p: DVec3) -> (DVec3, f64) {
        let (v, rate) = self.case.at(&First::default(), p);
        let (scene, sensor) = (&self.case.scene, &self.case.scene.sensors[0]);
        let along = |axis: DVec3| {
            let mut c = Covector::default();
            c.add(axis, Rgb::ONE);
            let mut sink = Contract(self, 0.0);
            v.apply(scene, sensor, &c, &mut sink);
            sink.1
        };
        let mut sink = Contract(self, 0.0);
        rate.apply(scene, sensor, Rgb::ONE, &mut sink);
        (DVec3::new(along(DVec3::X), along(DVec3::Y), along(DVec3::Z)), sink.1)
    }

    fn divergence(&self, p: DVec3, h: f64) -> f64 {
        let slope = |a: DVec3| (self.at(p + a * h).0 - self.at(p - a * h).0).dot(a) / (2.0 * h);
        slope(DVec3::X) + slope(DVec3::Y) + slope(DVec3::Z)
    }
}

fn unit(rng: &mut Rng) -> DVec3 {
    let z = 2.0 * rng.uniform() - 1.0;
    let (s, c) = (std::f64::consts::TAU * rng.uniform()).sin_cos();
    let r = (1.0 - z * z).sqrt();
    DVec3::new(r * c, r * s, z)
}

/// Barycentric weights inside a face, on a side, or of a corner.
fn weights(kind: usize, rng: &mut Rng) -> [f64; 3] {
    let (a, b) = (rng.uniform(), rng.uniform());
    match kind {
        0 => [1.0 - a.sqrt(), a.sqrt() * (1.0 - b), a.sqrt() * b],
        1 => [a, 1.0 - a, 0.0],
        _ => [0.0, 1.0, 0.0],
    }
}

#[test]
fn around_a_mesh_that_bends_the_field_is_the_matter_of_its_faces() {
    let dish = Dish::new();
    let mut rng = Rng::keyed(7, 0, 0, 0);
    for f in &dish.faces {
        let mix = |v: &[DVec3], b: [f64; 3]| (0..3).map(|i| v[f[i] as usize] * b[i]).sum::<DVec3>();
        for (kind, off) in [(0, 1e-9), (0, -1e-9), (0, 0.0), (1, 1e-9), (2, 1e-9)].repeat(10) {
            let b = weights(kind, &mut rng);
            let (v, _) = dish.at(mix(&dish.vertices, b) + unit(&mut rng) * off);
            let own = mix(&dish.velocities, b) + DVec3::X;
            assert!((v - own).length() < 1e-6, "{f:?} {b:?}: {v} {own}");
        }
    }
    for p in [
        DVec3::new(0.2, 0.0, 0.1),
        DVec3::new(0.3, 2.0, 0.2),
        DVec3::new(0.6, 1.4, 0.1),
        DVec3::new(-0.3, 1.0, 0.3),
        DVec3::new(1.6, 1.2, -1.5),
    ] {
        let (v, rate) = dish.at(p);
        assert!(v.length() < 1e-9 && rate.abs() < 1e-6, "{p}: {v} {rate}");
    }
}

#[test]
fn around_a_mesh_that_bends_divergences_are_those_of_the_field() {
    let dish = Dish::new();
    let mut rng = Rng::keyed(8, 0, 0, 0);
    for (kind, name) in ["face", "edge", "corner"].into_iter().enumerate() {
        let (mut moved, mut largest) = (0, 0.0f64);
        for k in 0..300 {
            let f = dish.faces[k % dish.faces.len()];
            let b = weights(kind, &mut rng);
            let p: DVec3 = (0..3).map(|i| dish.vertices[f[(i + k) % 3] as usize] * b[i]).sum();
            // Down to a thousandth of what its derivative could grow by.
            let r = 0.4 * 1e-3f64.powf(rng.uniform());
            let y = p + unit(&mut rng) * r;
            let ((v, own), d) = (dish.at(y), dish.divergence(y, 1e-4 * r));
            assert!((own - d).abs() < 1e-4 * (1.0 + own.abs()), "{name} at {y}, {r}: {own} {d}");
            moved += usize::from(v.length() > 0.1);
            largest = largest.max(own.abs());
        }
        println!("{name}: {moved} move, divergence up to {largest}");
        assert!(moved > 100 && largest < 150.0, "{name}: {moved} {largest}");
    }
}

/// [T] T8: a black ball in glowing fog, without scattering; what it takes up, by points of the fog that follow it (58).
#[test]
fn t8_moving_ball_in_glowing_fog() {
    let text = r#"<scene version="3.0.0"><default name="s" value="0"/><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0"/></medium>
  <sensor type="perspective"><transform name="to_world"><lookat origin="0, 0, 9" target="0, 0, 0" up="0, 1, 0"/></transform><ref id="fog"/></sensor>
  <shape type="cube"><transform name="to_world"><scale value="20"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="sphere"><transform name="to_world"><scale value="0.5"/><translate x="$s"/><rotate y="1" angle="-53.13010235415598"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape></scene>"#;
    let (desc, scene) = scene(text);
    let params = params(&desc, &scene, &["s"]);
    let moving = Moving::new(&scene, &scene.sensors[0], &params).unwrap();
    let c = Case { scene, params, moving };
    let (b, width, r, sigma) = (DVec3::new(0.9, 0.2, 0.6), 0.45, 0.5, 0.5);
    let ball = Velocity::of(Source::Shape { shape: 1, face: 0 }, DVec3::ZERO);
    assert!((c.vector(&ball, 0) - DVec3::new(0.6, 0.0, 0.8)).length() < 1e-12);
    let mut rng = Rng::keyed(8, 0, 0, 0);
    let mut normal = || (2.0 * rng.exponential()).sqrt() * (std::f64::consts::TAU * rng.uniform()).cos();
    let (mut power, mut slope) = (Moments::default(), Moments::default());
    let mut other = Rng::keyed(9, 0, 0, 0);
    for _ in 0..400_000 {
        let y = b + DVec3::new(normal(), normal(), normal()) * width;
        let middle = y.length();
        if middle <= r {
            power.push(0.0);
            slope.push(0.0);
            continue;
        }
        // A ray to the ball.
        let least = ((1.0 - r / middle) * (1.0 + r / middle)).sqrt();
        let cos = 1.0 - other.uniform() * (1.0 - least);
        let around = std::f64::consts::TAU * other.uniform();
        let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
        let w = tyndall::math::warp::to_world(-y / middle, DVec3::new(sin * around.cos(), sin * around.sin(), cos));
        let along = -y.dot(w);
        let d = along - (r * r - (y + w * along).length_squared()).max(0.0).sqrt();
        let (z, v) = (y + w * d, DVec3::new(0.6, 0.0, 0.8));
        let n = z / r;
        let cone = std::f64::consts::TAU * (1.0 - least);
        let (f, rate) = c.at(&First::default(), y);
        let apart = v - c.vector(&f, 0);
        // -2ḋ/d - τ̇, ċ/c by how the segment turns, <V, ∇q>/q, div V; the ball's matter does not stretch.
        let longer = w.dot(apart);
        let turned = (apart - w * longer) / d;
        let score = -2.0 * longer / d - sigma * longer + turned.dot(n) / w.dot(n) + c.number(&rate, 0);
        let glow = c.vector(&f, 0).dot(b - y) / (width * width);
        let value = (-sigma * d).exp() * cone * (std::f64::consts::TAU).powf(1.5) * width.powi(3);
        power.push(value);
        slope.push(value * (score + glow));
    }
    for (name, m, truth) in [("P", &power, 0.73597358481), ("dP", &slope, 1.0931056570)] {
        let z = (m.mean - truth) / m.standard_error();
        println!("{name}: {} +- {}, truth {truth}, z {z:.2}", m.mean, m.standard_error());
        assert!(z.abs() <= 4.5 && m.standard_error() <= 0.005 * truth, "{name}");
    }
}
