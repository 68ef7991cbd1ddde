use super::*;
use crate::scene::compile::LoadOptions;
use crate::scene::desc::SceneDesc;
use std::path::Path;

const PINHOLE: &str = r#"<sensor type="perspective"><float name="fov" value="70"/><transform name="to_world"><lookat origin="0.5, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
  <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="30"/><rfilter type="gaussian"/></film></sensor>"#;
const ORTHOGRAPHIC: &str = r#"<sensor type="orthographic"><transform name="to_world"><scale x="2.5" y="2"/><lookat origin="0.5, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
  <film type="hdrfilm"><integer name="width" value="40"/><integer name="height" value="40"/><rfilter type="box"/></film></sensor>"#;

/// Two balls, a block that a ball hides a part of, and a disk, which all move, before a ball that stands still.
fn with(sensor: &str, test: impl Fn(&Limbs)) {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.6"/><integrator type="volpath"/>{sensor}
  <shape type="sphere"><point name="center" value="$x, 0.4, 0.2"/><float name="radius" value="0.5"/><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" value="-0.8, -0.2, 0.5"/><float name="radius" value="$x"/><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" value="0, 0, -3"/><float name="radius" value="1.5"/><bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.4"/><rotate x="1" y="0.3" angle="30"/><translate x="$x"/><translate x="0.5" y="0.3" z="-0.6"/></transform><bsdf type="diffuse"/></shape>
  <shape type="disk"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="20"/><translate y="$x"/><translate x="-2.2" z="0.5"/></transform><bsdf type="diffuse"/></shape>
  <emitter type="constant"/></scene>"#
    );
    let desc = SceneDesc::parse(&text, Path::new("limbs.xml"), &[]).unwrap();
    let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
    let params = scene.param_set(&desc, &["x".to_string()]).unwrap();
    let motion = Motion::new(&scene, &scene.sensors[0], &params).unwrap();
    test(&Limbs::new(&scene, 0, &motion).unwrap());
}

/// The density is that of the samples: means of test functions over the film agree with their integrals times the density.
#[test]
fn film_points_have_their_density() {
    for sensor in [PINHOLE, ORTHOGRAPHIC] {
        with(sensor, |limbs| {
            assert_eq!(limbs.balls.len(), 2);
            // The disk's polygon and what is seen of the block.
            assert!(limbs.strips.list.len() > 30, "{}", limbs.strips.list.len());
            let tests: [fn([f64; 2]) -> f64; 3] =
                [|_| 1.0, |f| (0.2 * f[0]).sin(), |f| (0.17 * f[1] + 0.1 * f[0]).cos()];
            let (n, mut rng) = (200_000, Rng::keyed(1, 2, 3, 4));
            let (mut drawn, mut flat) = ([0.0; 3], [0.0; 3]);
            for _ in 0..n {
                let (f, _) = limbs.sample(&mut rng).unwrap();
                (0..3).for_each(|k| drawn[k] += tests[k](f) / f64::from(n));
            }
            // Strata of the film and around it.
            let (steps, side) = (2000, 60.0);
            for i in 0..steps * steps {
                let at = |k: i32, u: f64| (f64::from(k) + u) / f64::from(steps) * side - 10.0;
                let f = [at(i % steps, rng.uniform()), at(i / steps, rng.uniform())];
                (0..3).for_each(|k| flat[k] += tests[k](f) * limbs.density(f) * (side / f64::from(steps)).powi(2));
            }
            for k in 0..3 {
                assert!((drawn[k] - flat[k]).abs() < 0.01, "{k}: {} {}", drawn[k], flat[k]);
            }
        });
    }
}

/// Both ways to draw a film point share it out: per pixel, weights from the pixel and from here add up.
#[test]
fn weights_share_film_points_out() {
    with(PINHOLE, |limbs| {
        let mut rng = Rng::keyed(5, 2, 3, 4);
        for _ in 0..1000 {
            let (f, _) = limbs.sample(&mut rng).unwrap();
            let q = limbs.density(f);
            for (pixel, weight) in limbs.weights(f) {
                let w: f64 = (0..2).map(|k| filter::density(limbs.filter, f[k] - (pixel[k] as f64 + 0.5))).product();
                assert!((weight / w * (1.0 + limbs.count as f64 * q) - 1.0).abs() < 1e-9);
            }
        }
    });
}
