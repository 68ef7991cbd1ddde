//! Mirrored paths: half of the noise behind first vertices that slide, the same mean, and not a bit of the picture.

use crate::common::{params, scene};
use std::sync::Arc;
use tyndall::math::rng::Rng;
use tyndall::params::Forward;
use tyndall::transport::{Beginning, PathRecord, Sweep, SweepFacts, Tally};

/// A small cube that moves in fog whose mean free path is a hundred times as long, beside a larger one.
const GRAIN: &str = r#"<scene version="3.0.0">
  <default name="x" value="0"/><default name="camera" value="0"/>
  <integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.9"/>
    <phase type="hg"><float name="g" value="0.2"/></phase></medium>
  <sensor type="perspective"><float name="fov" value="3"/>
    <transform name="to_world"><lookat origin="$camera, 0.4, 1" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film><ref id="fog"/></sensor>
  <shape type="cube"><transform name="to_world"><scale value="0.01"/><rotate x="1" y="1" z="0.3" angle="40"/><translate x="$x"/></transform>
    <bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.3"/><translate y="-0.35"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><translate y="1" z="0.3"/></transform>
    <emitter type="area"><rgb name="radiance" value="2"/></emitter></shape></scene>"#;

#[test]
fn pairs_cancel_noise_and_nothing_else() {
    let (desc, scene) = scene(GRAIN);
    // Where the camera moves, most of the noise is elsewhere.
    for (moves, share) in [("x", 0.5), ("camera", 1.0)] {
        let p = params(&desc, &scene, &[moves]);
        let facts = SweepFacts::of(&scene, &scene.sensors[0], &p).unwrap();
        let sensor = &scene.sensors[0];
        let both = [facts.clone().unpaired(), facts].map(Arc::new);
        let (mut sums, mut squares, mut difference) = ([0.0; 2], [0.0; 2], [0.0; 2]);
        let n = 40_000;
        for k in 0..n {
            let mut rng = Rng::keyed(1, 1, 0, k);
            let (o, w) = sensor.ray(4.0 * rng.uniform(), 4.0 * rng.uniform());
            let found = both.clone().map(|facts| {
                let sweep = Sweep { scene: &scene, set: &scene.settings, params: &p, facts, sensor };
                let (mut rec, mut sink, mut tally) = (PathRecord::new(), Forward::new(&p), Tally::default());
                let begin = Beginning::new(rng, o, w, sensor.medium);
                let value = sweep.sample(&begin, Rng::keyed(1, 2, 0, k), &mut rec, &mut sink, &mut tally);
                (value, sink.image[0][1])
            });
            assert_eq!(found[0].0, found[1].0);
            for i in 0..2 {
                sums[i] += found[i].1;
                squares[i] += found[i].1 * found[i].1;
            }
            let d = found[1].1 - found[0].1;
            difference[0] += d;
            difference[1] += d * d;
        }
        let z = difference[0] / difference[1].sqrt();
        assert!(z.abs() < 4.5, "{moves}: pairs shift the mean by {z} standard errors");
        let [alone, paired] = [0, 1].map(|i| squares[i] - sums[i] * sums[i] / n as f64);
        println!("{moves}: {}", paired / alone);
        assert!(paired < share * alone, "{moves}: variance {paired} of {alone}");
    }
}
