//! Long paths are swept in chunks that are walked again: the same bits as one long record, in bounded memory.

use crate::common::same_in_chunks;

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
    same_in_chunks(THICK, &["sigma_t", "albedo", "g", "i"], 21);
}
