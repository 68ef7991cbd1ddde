//! Analytic reference values of [T] section 11, for the features that exist.

mod common;
use common::{check, forward};

/// AL0: airlight from a point light, single scattering. Camera at 0 looking along +z, black wall at z = 6.
fn al0() -> String {
    r#"<scene version="3.0.0">
    <default name="sigma_t" value="0.35"/><default name="albedo" value="0.7142857142857143"/>
    <default name="g" value="0.4"/><default name="intensity" value="10"/>
    <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/>
      <phase type="hg"><float name="g" value="$g"/></phase></medium>
    <sensor type="orthographic"><transform name="to_world"><scale x="1e-9" y="1e-9"/></transform>
      <ref id="fog"/>
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>
    <shape type="rectangle"><transform name="to_world"><scale value="100"/><rotate y="1" angle="180"/><translate z="6"/></transform>
      <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
    <emitter type="point"><point name="position" value="1.2, 1.5, 2.5"/><rgb name="intensity" value="$intensity"/><ref id="fog"/></emitter>
    </scene>"#
        .into()
}

#[test]
fn al0_airlight() {
    let r = forward(&al0(), &["sigma_t", "albedo", "g", "intensity"], 1 << 18);
    let l = 0.0407428845194;
    check("L", &r[0], l, 0.005);
    // d/dsigma_t at fixed sigma_s, from the derivatives at fixed albedo and with respect to albedo.
    let (s, a) = (0.35, 0.25 / 0.35);
    let fixed_s = r[1].value[0] - r[2].value[0] * a / s;
    println!("dsigma_t|albedo {} dalbedo {} fixed sigma_s {}", r[1].value[0], r[2].value[0], fixed_s);
    check("dL/dalbedo", &r[2], l / a, 0.005);
    check("dL/dsigma_t", &r[1], -0.14551477082 * 0.0 + (l / s - 0.0) * 0.0 + dsigma_at_fixed_albedo(), 0.005);
    check("dL/dg", &r[3], -0.018533227975, 0.005);
    check("dL/dI", &r[4], l / 10.0, 0.005);
}

/// dL/dsigma_t at fixed sigma_s plus L/sigma_t (the source is proportional to sigma_s = albedo sigma_t).
fn dsigma_at_fixed_albedo() -> f64 {
    0.0407428845194 / 0.35 - 0.14551477082
}
