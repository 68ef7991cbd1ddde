use super::*;
use crate::math::Rgb;
use crate::params::Forward;
use crate::scene::compile::LoadOptions;
use crate::scene::desc::SceneDesc;
use crate::transport::record::Event;
use crate::transport::{Beginning, PathRecord, Sweep, SweepFacts, Tally};
use std::path::Path;
use std::sync::Arc;

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
    test(&Limbs::new(&scene, 0, &motion, &params).unwrap());
}

/// Of film points, per pixel².
fn density(limbs: &Limbs, film: [f64; 2]) -> f64 {
    (1.0 / limbs.poles(film, None).weight() - 1.0) / limbs.count as f64
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
                (0..3).for_each(|k| flat[k] += tests[k](f) * density(limbs, f) * (side / f64::from(steps)).powi(2));
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
            // By all strips, not those that the grid finds.
            let strips = limbs.strips.list.iter().map(|s| s.share * s.density(limbs.strips.half_width, f));
            let balls = limbs.balls.iter().map(|b| b.share * b.density(limbs.sensor, f));
            let q: f64 = strips.chain(balls).sum();
            for (pixel, weight) in limbs.weights(f, &limbs.poles(f, None)) {
                let w: f64 = (0..2).map(|k| filter::density(limbs.filter, f[k] - (pixel[k] as f64 + 0.5))).product();
                assert!((weight / w * (1.0 + limbs.count as f64 * q) - 1.0).abs() < 1e-9);
            }
        }
    });
}

/// A block that moves in front of `rest`; a parameter of the fog there besides. How many collisions were shared.
fn beside_a_block(s: f64, rest: &str, precision: f64) -> usize {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="s" value="{s}"/><integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="16"/><integer name="height" value="16"/><rfilter type="box"/></film></sensor>
  <shape type="cube"><transform name="to_world"><scale value="0.5"/><translate x="$x"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.8"/></bsdf></shape>
  {rest}
  <emitter type="constant"/><emitter type="point"><point name="position" value="2, 2.5, 3.2"/><rgb name="intensity" value="20"/></emitter></scene>"#
    );
    let desc = SceneDesc::parse(&text, Path::new("block.xml"), &[]).unwrap();
    let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
    let params = scene.param_set(&desc, &["x".to_string(), "s".to_string()]).unwrap();
    let sensor = &scene.sensors[0];
    let motion = Motion::new(&scene, sensor, &params).unwrap();
    let limbs = Limbs::new(&scene, 0, &motion, &params).unwrap();
    let facts = Arc::new(SweepFacts::of(&scene, sensor, &params).unwrap());
    let sweep = Sweep { scene: &scene, set: &scene.settings, params: &params, facts, sensor };
    let (mut rec, mut tally) = (PathRecord::new(), Tally::default());
    rec.chunk = 24;
    // A pixel away from the block.
    let film = [4.3, 8.6];
    let poles = limbs.poles(film, None);
    assert!(!poles.list.is_empty());
    let (o, w) = sensor.ray(film[0], film[1]);
    let n = 40_000;
    let (mut key, mut shares) = (0, 0);
    // Means and variances of the means, of both derivatives in all channels.
    let mut run = |poles: Option<Poles>| -> [[f64; 6]; 2] {
        let poles = poles.map(Arc::new);
        let (mut sum, mut square) = ([0.0; 6], [0.0; 6]);
        key += 1;
        for k in 0..n {
            let mut begin = Beginning::new(Rng::keyed(4, 1, key, k), o, w, sensor.medium);
            begin.poles = poles.clone();
            let (mut sink, mut d) = (Forward::new(&params), vec![Rgb::ZERO; 2]);
            sweep.sample(&begin, Rng::keyed(4, 2, key, k), &mut rec, &mut sink, &mut tally);
            sink.take(&mut d);
            shares += rec.events.iter().filter(|e| matches!(e, Event::Share(_))).count();
            for i in 0..6 {
                let x = d[i / 3].0[i % 3];
                (sum[i], square[i]) = (sum[i] + x, square[i] + x * x);
            }
        }
        let mean = sum.map(|s| s / n as f64);
        [mean, std::array::from_fn(|i| (square[i] / n as f64 - mean[i] * mean[i]) / n as f64)]
    };
    let plain = run(None);
    let mut parts = vec![(poles.rest, run(Some(poles.clone())))];
    for k in 0..poles.list.len() {
        parts.push((poles.list[k].weight, run(Some(Poles { drawn: Some(k), ..poles.clone() }))));
    }
    for i in 0..6 {
        let weight = poles.weight();
        let shared: f64 = parts.iter().map(|(q, p)| q * p[0][i] * weight).sum();
        let variance: f64 = parts.iter().map(|(q, p)| (q * weight).powi(2) * p[1][i]).sum();
        let error = (variance + plain[1][i]).sqrt();
        println!("{i}: {shared} {} +- {error}", plain[0][i]);
        // False alarms: 1 in 10^5 a comparison.
        assert!((shared - plain[0][i]).abs() <= 4.4 * error, "{i}: {shared} {} +- {error}", plain[0][i]);
        assert!(i != 3 || error < precision * plain[0][i].abs(), "{i}: {} +- {error}", plain[0][i]);
    }
    shares
}

/// A box of fog around x, y and this z.
fn fog(id: &str, sigma_t: &str, z: f64) -> String {
    format!(
        r#"<medium type="homogeneous" id="{id}"><rgb name="sigma_t" value="{sigma_t}"/><float name="albedo" value="0.8"/></medium>
  <shape type="cube"><transform name="to_world"><scale x="3" y="3"/><translate z="{z}"/></transform><bsdf type="null"/><ref name="interior" id="{id}"/></shape>"#
    )
}

/// What paths beside an outline collect by their pixels and from here adds up to what its pixel's paths alone collect.
#[test]
fn gray_fog_beside_an_outline_is_shared_out() {
    assert!(beside_a_block(0.7, &fog("a", "$s", 0.0), 0.05) > 0);
}

/// A channel that one of two media has nothing to collide with in, and a gap between them.
#[test]
fn chromatic_fog_beside_an_outline_is_shared_out() {
    assert!(beside_a_block(0.7, &(fog("a", "$s, 0.9, 0", 0.0) + &fog("b", "0.5, 0.3, 0.4", -2.5)), 0.05) > 0);
}

/// The first line has no medium, and that behind the mirror no poles.
#[test]
fn fog_in_a_mirror_beside_an_outline_is_shared_out() {
    let mirror = r#"<shape type="rectangle"><transform name="to_world"><scale value="5"/><rotate y="1" angle="35"/><translate z="-2"/></transform><bsdf type="conductor"><string name="material" value="none"/></bsdf></shape>"#;
    // The mirror sends the ray past the block's other side into it.
    let fog = fog("a", "$s, 0.9, 0.4", 0.5)
        .replace(r#"<scale x="3" y="3"/>"#, r#"<scale x="0.9" y="2"/><translate x="2.4"/>"#);
    assert_eq!(beside_a_block(0.05, &(fog + mirror), 0.05), 0);
}
