//! Light that no choice is left to: every sample has the same value, the one of the formula.

use crate::common::{check, forward};

const CAMERA: &str = r#"<sensor type="orthographic"><transform name="to_world"><scale value="1e-9"/><lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
  <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor><emitter type="constant"/>"#;

/// The picture, and its derivatives.
fn is_certain(text: &str, truth: f64, slopes: &[(&str, f64)]) {
    let names: Vec<&str> = slopes.iter().map(|s| s.0).collect();
    let truths = std::iter::once(truth).chain(slopes.iter().map(|s| s.1));
    for (e, truth) in forward(text, &names, 256).iter().zip(truths) {
        for c in 0..3 {
            let close = (e.value[c] - truth).abs() < 1e-6 * truth.abs() && e.error[c] < 1e-7 * truth.abs();
            assert!(close, "{names:?} {c}: {e:?} {truth}");
        }
    }
}

/// A ball of glass and milk along its axis, at most two faces on the way. Straight on, `F + (1-F)² e^{-2 σ R}`: the milk's light has no face left to leave by, nor has what the second face mirrors, and what
/// passes straight is not chosen.
#[test]
fn straight_through_a_ball_of_milk() {
    let (n, sigma) = (1.5f64, 0.4f64);
    let ball = format!(
        r#"<scene version="3.0.0"><default name="s" value="{sigma}"/><integrator type="volpath"><integer name="max_depth" value="3"/></integrator>{CAMERA}
  <medium type="homogeneous" id="milk"><float name="sigma_t" value="$s"/><float name="albedo" value="0.9"/></medium>
  <shape type="sphere"><bsdf type="dielectric"><float name="int_ior" value="{n}"/><float name="ext_ior" value="1"/></bsdf><ref name="interior" id="milk"/></shape></scene>"#
    );
    let f = ((n - 1.0) / (n + 1.0)).powi(2);
    let straight = (1.0 - f).powi(2) * (-2.0 * sigma).exp();
    is_certain(&ball, f + straight, &[("s", -2.0 * straight)]);
}

/// A small grey wall in the middle of a ball of smoke: the flight to the sky that nothing more can come of is weighed, `ρ e^{-σ R}`, after as much on the way there.
#[test]
fn the_last_flight_through_smoke() {
    let wall = format!(
        r#"<scene version="3.0.0"><default name="s" value="0.7"/><integrator type="volpath"><integer name="max_depth" value="2"/></integrator>{CAMERA}
  <medium type="homogeneous" id="smoke"><float name="sigma_t" value="$s"/><float name="albedo" value="0"/></medium>
  <shape type="sphere"><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="1e-7"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape></scene>"#
    );
    let truth = 0.5 * (-1.4f64).exp();
    is_certain(&wall, truth, &[("s", -2.0 * truth)]);
    // Its border moves: directions are drawn otherwise then, not by the cosine alone.
    let bordered = wall
        .replace("<integrator", r#"<default name="r" value="1"/><integrator"#)
        .replace(r#"<shape type="sphere">"#, r#"<shape type="sphere"><float name="radius" value="$r"/>"#);
    check("dL/dr", &forward(&bordered, &["r"], 1 << 14)[1], -1.4 * truth, 0.005);
    // As each of its colours does.
    let coloured =
        wall.replace(r#"<float name="sigma_t" value="$s"/>"#, r#"<rgb name="sigma_t" value="$s, 0.2, 1.1"/>"#);
    let e = forward(&coloured, &["s"], 256);
    for (c, sigma) in [0.7f64, 0.2, 1.1].into_iter().enumerate() {
        let truth = 0.5 * (-2.0 * sigma).exp();
        let slope = if c == 0 { -2.0 * truth } else { 0.0 };
        assert!((e[0].value[c] - truth).abs() < 1e-6 && e[0].error[c] < 1e-7, "{c}: {e:?}");
        assert!((e[1].value[c] - slope).abs() < 1e-6 && e[1].error[c] < 1e-7, "{c}: {e:?}");
    }
}

/// A camera in a medium that a closed glass far aside holds as well: its last flights leave for the sky all the same.
#[test]
fn a_camera_outside_of_the_glass_sees_the_sky() {
    let aside = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="2"/></integrator>{}
  <medium type="homogeneous" id="air"><float name="sigma_t" value="0"/><float name="albedo" value="0"/></medium>
  <shape type="sphere"><point name="center" value="500, 0, 0"/><bsdf type="dielectric"/><ref name="interior" id="air"/></shape>
  <shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="0.5"/></bsdf></shape></scene>"#,
        CAMERA.replacen("<film", r#"<ref id="air"/><film"#, 1)
    );
    is_certain(&aside, 0.5, &[]);
}
