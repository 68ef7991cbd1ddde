//! Long paths are swept in chunks that are walked again: the same bits as one long record, in bounded memory.

use crate::common::{params, scene};
use std::sync::Arc;
use tyndall::math::rng::Rng;
use tyndall::params::Forward;
use tyndall::transport::{PathRecord, State, Sweep, SweepFacts, Tally};

/// A thick, nearly lossless slab with a lamp, a point light inside and a surface: every kind of event.
const THICK: &str = r#"<scene version="3.0.0">
  <default name="sigma_t" value="12"/><default name="albedo" value="0.999"/><default name="g" value="0.3"/><default name="i" value="2"/>
  <integrator type="volpath"/>
  <medium type="homogeneous" id="m"><rgb name="sigma_t" value="$sigma_t, 10, 14"/><float name="albedo" value="$albedo"/>
    <phase type="hg"><float name="g" value="$g"/></phase><float name="emission" value="0.1"/></medium>
  <sensor type="perspective"><transform name="to_world"><translate z="-4"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="m"/></shape>
  <shape type="sphere"><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>
  <emitter type="point"><point name="position" x="0.5" y="0.5" z="0.2"/><rgb name="intensity" value="$i"/></emitter>
  <emitter type="constant"/></scene>"#;

#[test]
fn chunked_sweep_gives_the_same_bits() {
    let (desc, scene) = scene(THICK);
    let p = params(&desc, &scene, &["sigma_t", "albedo", "g", "i"]);
    let facts = Arc::new(SweepFacts::of(&scene, &scene.sensors[0], &p).unwrap());
    let sweep = Sweep { scene: &scene, set: &scene.settings, params: &p, facts, sensor: &scene.sensors[0] };
    let mut longest = 0;
    for sample in 0..200 {
        let run = |chunk: usize| {
            let mut rec = PathRecord::new();
            rec.chunk = chunk;
            let rng = Rng::keyed(1, 1, 5, sample);
            let (o, w) = scene.sensors[0].ray(2.0, 2.1);
            let state = State::new(rng, o, w, None);
            let mut sink = Forward::new(&p);
            let mut tally = Tally::default();
            let value = sweep.sample(&state, Rng::keyed(1, 2, 5, sample), &mut rec, &mut sink, &mut tally);
            (value, sink.image, rec.chunk_starts.len())
        };
        let (v, d, none) = run(usize::MAX);
        assert_eq!(none, 0);
        for chunk in [16, 100] {
            let (vc, dc, chunks) = run(chunk);
            longest = longest.max(chunks);
            assert_eq!(v, vc);
            assert_eq!(d, dc, "sample {sample}, chunk {chunk}");
        }
    }
    assert!(longest > 20, "paths are too short to test anything: {longest} chunks");
}
