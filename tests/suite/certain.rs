//! Light that no choice is left to: every sample has the same value, the one of the formula.

use crate::common::forward;

const CAMERA: &str = r#"<sensor type="orthographic"><transform name="to_world"><scale value="1e-9"/><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
  <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor><emitter type="constant"/>"#;

fn is_certain(text: &str, truth: f64) {
    let e = forward(text, &[], 256)[0];
    for c in 0..3 {
        assert!((e.value[c] - truth).abs() < 1e-6 * truth && e.error[c] < 1e-7 * truth, "{c}: {e:?} {truth}");
    }
}

/// A ball of glass and milk along its axis, at most two faces on the way. Straight on, `F + (1-F)² e^{-2 σ R}`: the milk's light has no face left to leave by, nor has what the second face mirrors, and what
/// passes straight is not chosen.
#[test]
fn straight_through_a_ball_of_milk() {
    let (n, sigma) = (1.5f64, 0.4f64);
    let ball = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="3"/></integrator>{CAMERA}
  <medium type="homogeneous" id="milk"><float name="sigma_t" value="{sigma}"/><float name="albedo" value="0.9"/></medium>
  <shape type="sphere"><bsdf type="dielectric"><float name="int_ior" value="{n}"/><float name="ext_ior" value="1"/></bsdf><ref name="interior" id="milk"/></shape></scene>"#
    );
    let f = ((n - 1.0) / (n + 1.0)).powi(2);
    is_certain(&ball, f + (1.0 - f).powi(2) * (-2.0 * sigma).exp());
}

/// A small grey wall in the middle of a ball of smoke: the flight to the sky that nothing more can come of is weighed, `ρ e^{-σ R}`, after as much on the way there.
#[test]
fn the_last_flight_through_smoke() {
    let wall = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="2"/></integrator>{CAMERA}
  <medium type="homogeneous" id="smoke"><float name="sigma_t" value="0.7"/><float name="albedo" value="0"/></medium>
  <shape type="sphere"><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="1e-7"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape></scene>"#
    );
    is_certain(&wall, 0.5 * (-1.4f64).exp());
}
