//! Grids of density and albedo that move by themselves or together, by any affine map, against differences.

use crate::common::{against_differences, small_vdb};

/// A block in which both grids, mirrored along x, shear by `s`, and the albedo moves by `x` alone; a sun and a sky, twice scattered.
#[test]
fn grids_shear_and_their_albedo_moves() {
    let dir = tempfile::tempdir().unwrap();
    let density =
        small_vdb(&dir.path().join("d.vdb"), |p| 0.7 + 0.04 * p.x + 0.03 * p.y * (0.2 * p.z).sin(), "density");
    let albedo = small_vdb(&dir.path().join("a.vdb"), |p| 0.5 + 0.05 * p.x - 0.001 * p.y * p.z, "albedo");
    let place = |shift: &str| {
        format!(
            r#"<transform name="to_world"><matrix value="-1 0 $s 0  0 1 0 0  0 0 1 0  0 0 0 1"/><translate x="{shift}"/></transform>"#
        )
    };
    let text = format!(
        r#"<scene version="3.0.0"><default name="s" value="0.3"/><default name="x" value="0.1"/>
    <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>
    <medium type="heterogeneous" id="m"><float name="scale" value="0.8"/>
      <volume name="sigma_t" type="openvdb">{density}{}</volume><volume name="albedo" type="openvdb">{albedo}{}</volume></medium>
    <sensor type="orthographic"><transform name="to_world"><scale x="0.3" y="0.3"/><translate x="0.01" y="0.02" z="-1"/></transform>
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
    <shape type="cube"><transform name="to_world"><scale x="0.7" y="0.7" z="0.6"/><translate z="0.9"/></transform><bsdf type="null"/><ref name="interior" id="m"/></shape>
    <emitter type="directional"><vector name="direction" value="0.5, 0.2, 1"/><rgb name="irradiance" value="3"/></emitter>
    <emitter type="constant"><rgb name="radiance" value="0.1"/></emitter></scene>"#,
        place("0"),
        place("$x"),
    );
    against_differences(&text, &[("x", 0.05), ("s", 0.05)], &["all"], 1 << 16, 0.003);
}
