//! A point light that moves in dense fog, paths without end: walks around it stay few, so that a record stays small.

use crate::common::{params, scene};
use std::sync::Arc;
use tyndall::math::rng::Rng;
use tyndall::params::Forward;
use tyndall::transport::{Beginning, PathRecord, Sweep, SweepFacts, Tally};

const DENSE: &str = r#"<scene version="3.0.0">
  <default name="x" value="0"/>
  <integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="8"/><float name="albedo" value="0.9"/></medium>
  <sensor type="perspective"><float name="fov" value="18"/>
    <transform name="to_world"><lookat origin="0, -0.2, 4" target="0.03, -0.35, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <emitter type="point"><point name="position" value="$x, 0.8, 0.2"/><rgb name="intensity" value="1"/><ref id="fog"/></emitter></scene>"#;

#[test]
fn walks_around_a_light_stay_few() {
    let (desc, scene) = scene(DENSE);
    let p = params(&desc, &scene, &["x"]);
    let facts = Arc::new(SweepFacts::of(&scene, &scene.sensors[0], &p).unwrap());
    let sensor = &scene.sensors[0];
    let sweep = Sweep { scene: &scene, set: &scene.settings, params: &p, facts, sensor };
    let (mut rec, mut sink, mut tally) = (PathRecord::new(), Forward::new(&p), Tally::default());
    let mut largest = 0;
    for k in 0..400 {
        let mut rng = Rng::keyed(1, 1, 0, k);
        let (o, w) = sensor.ray(4.0 * rng.uniform(), 4.0 * rng.uniform());
        let begin = Beginning::new(rng, o, w, sensor.medium);
        sweep.sample(&begin, Rng::keyed(1, 2, 0, k), &mut rec, &mut sink, &mut tally);
        largest = largest.max(rec.events.capacity());
        // Chunks bound what a path records, not what one of its vertices does.
        assert!(largest < 1 << 20, "path {k}: room for {largest} events");
    }
    println!("room for {largest} events");
    assert!(sink.image[0].is_finite());
}
