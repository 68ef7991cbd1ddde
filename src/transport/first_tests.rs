use super::super::line::Line;
use super::super::piece::Piece;
use super::*;
use crate::math::Rgb;
use crate::math::rng::Rng;
use crate::medium::grid::vol::Vol;
use crate::params::{Covector, Forward};
use crate::scene::On;
use crate::scene::compile::LoadOptions;
use crate::scene::desc::SceneDesc;
use std::path::Path;

/// A box of voxels without any order, a slanted wall in it, and a camera; both move, toward each other too.
fn scene(voxels: &Path, x: f64) -> (SceneDesc, Scene) {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="{x}"/><integrator type="volpath"/>
  <medium type="heterogeneous" id="smoke"><volume name="sigma_t" type="gridvolume"><string name="filename" value="{}"/>
    <transform name="to_world"><translate x="-0.5" y="-0.5" z="-0.5"/><scale value="2"/></transform></volume></medium>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0.3, 0.2, 4" target="0, 0, 0" up="0, 1, 0"/>
    <translate x="$x"/><translate z="$x"/><translate z="$x"/></transform><film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate y="1" angle="35"/><translate z="-0.5"/><translate z="$x"/><translate z="$x"/></transform><bsdf type="diffuse"/></shape></scene>"#,
        voxels.display()
    );
    let desc = SceneDesc::parse(&text, Path::new("smoke.xml"), &[]).unwrap();
    let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
    (desc, scene)
}

/// The span of the camera line through a film point, and points of it that stand for equal lengths.
fn points(scene: &Scene) -> (MediumSpan, Vec<(f64, DVec3)>, f64) {
    let sensor = &scene.sensors[0];
    let (o, w) = sensor.ray(4.3, 3.6);
    let (line, hit) = Line::to_surface(scene, o, w, &On::default(), sensor.medium, true).unwrap();
    assert!(hit.is_some() && line.parts.len() == 1);
    let span = line.parts[0].span;
    let step = (span.t1 - span.t0) / 40_000.0;
    let at = |k: i32| span.t0 + (f64::from(k) + 0.5) * step;
    (span, (0..40_000).map(|k| (at(k), span.o + span.w * at(k))).collect(), step)
}

/// What is scattered at a point, over σ.
fn light(p: DVec3) -> (f64, DVec3) {
    let f = (0.7 * p.x - 0.4 * p.y + 0.5 * p.z).exp();
    (f, DVec3::new(0.7, -0.4, 0.5) * f)
}

/// σ and T at an abscissa.
fn here(scene: &Scene, span: &MediumSpan, t: f64, p: DVec3) -> (f64, f64) {
    let m = &scene.media[0];
    (m.coefficients(p).0[0], (-m.density_integral(span.o, span.w, span.t0, t)[0] * m.scale).exp())
}

/// `∫ T σ f dt` on the line through a film point: its derivative is that of differences however points slide along the line, and where they come to rest in a rough field they score less.
#[test]
fn points_that_come_to_rest_give_the_same_with_less_noise() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("smoke.vol");
    let mut rng = Rng::keyed(2, 7, 1, 8);
    let values = (0..16 * 16 * 16).map(|_| 0.1 + rng.uniform() as f32).collect();
    Vol { res: [16; 3], channels: 1, bbox: [[0.0; 3], [1.0; 3]], values }.write(&path).unwrap();
    let whole = |x: f64| {
        let (_, scene) = scene(&path, x);
        let (span, points, step) = points(&scene);
        let each = |&(t, p): &(f64, DVec3)| {
            let (sigma, transmittance) = here(&scene, &span, t, p);
            sigma * transmittance * light(p).0
        };
        points.iter().map(each).sum::<f64>() * step
    };
    let h = 5e-4;
    let truth = (whole(h) - whole(-h)) / (2.0 * h);
    let (desc, scene) = scene(&path, 0.0);
    let params = scene.param_set(&desc, &["x".to_string()]).unwrap();
    let sensor = &scene.sensors[0];
    let settled = Moving::new(&scene, sensor, &params).unwrap();
    let (span, points, step) = points(&scene);
    assert!(settled.settling(0) < 0.5 * (span.t1 - span.t0), "{}", settled.settling(0));
    let [(rest, noise), (slide, more)] = [settled.clone(), settled.sliding()].map(|moving| {
        let line = moving.film_line(&scene);
        let (mut sum, mut squares) = (0.0, 0.0);
        for &(t, p) in &points {
            let (sigma, transmittance) = here(&scene, &span, t, p);
            let (f, df) = light(p);
            let first = line.medium(p, &span, Later::Nothing);
            let mut sink = Forward::new(&params);
            let mut at = Covector::default();
            at.add(
                scene.media[0].sigma_s_gradient(p)[0] * (f / scene.media[0].albedo_at(p)[0]) + df * sigma,
                Rgb::splat(transmittance),
            );
            let value = sigma * transmittance * f;
            first.velocity.apply(&scene, sensor, &at, &mut sink);
            first.stretch.apply(&scene, sensor, Rgb::splat(value), &mut sink);
            let piece = Piece::of(&scene, &span.until(t)).unwrap();
            let ends = [line.ends(&piece)[0].clone(), first.velocity.clone()];
            for (v, form) in ends.iter().zip(piece.depth_forms(&scene)) {
                v.apply(&scene, sensor, &form.weighed(Rgb::splat(-value)), &mut sink);
            }
            let d = sink.image[0][0];
            sum += d * step;
            squares += d * d / value * step;
        }
        (sum, squares)
    });
    assert!((rest - truth).abs() < 2e-3 * truth.abs(), "{rest} {truth}");
    assert!((slide - truth).abs() < 2e-3 * truth.abs(), "{slide} {truth}");
    // The second moment of scores, points drawn by what they send.
    assert!(noise < 0.7 * more, "{noise} {more}");
}

/// A camera that turns in a smoke which ends nowhere: the further away, the faster its points move across it.
#[test]
fn rays_without_an_end_turn_with_the_camera() {
    let at = |pan: f64| {
        let text = format!(
            r#"<scene version="3.0.0"><default name="pan" value="{pan}"/><integrator type="volpath"/>
  <medium type="heterogeneous" id="smoke"><volume name="sigma_t" type="openvdb"><string name="filename" value="scenes/fire/blender_fire_0032.vdb"/>
    <string name="grid_name" value="density"/></volume></medium>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><rotate y="1" angle="$pan"/>
    <lookat origin="5.2, -4.6, 1.7" target="1.0, 1.0, 2.0" up="0, 0, 1"/></transform><ref name="medium" id="smoke"/>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor><emitter type="constant"/></scene>"#
        );
        let desc = SceneDesc::parse(&text, Path::new("smoke.xml"), &[]).unwrap();
        let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
        let (o, w) = scene.sensors[0].ray(4.6, 3.4);
        let (line, hit) = Line::to_surface(&scene, o, w, &On::default(), scene.sensors[0].medium, true).unwrap();
        assert!(hit.is_none() && line.parts[0].span.t1 == f64::INFINITY);
        (desc, scene, line)
    };
    let h = 1e-3;
    let truth = (at(h).2.total[0] - at(-h).2.total[0]) / (2.0 * h);
    let (desc, scene, line) = at(0.0);
    let params = scene.param_set(&desc, &["pan".to_string()]).unwrap();
    let sensor = &scene.sensors[0];
    let moving = Moving::new(&scene, sensor, &params).unwrap();
    let piece = Piece::of(&scene, &line.parts[0].span).unwrap();
    let mut sink = Forward::new(&params);
    for (v, form) in moving.film_line(&scene).ends(&piece).iter().zip(piece.depth_forms(&scene)) {
        v.apply(&scene, sensor, &form, &mut sink);
    }
    let d = sink.image[0][0];
    assert!(truth.abs() > 1e-3 && (d - truth).abs() < 1e-3 * truth.abs(), "{d} {truth}");
}
