//! Collimated beams among what is opaque: their spots and shadows on surfaces and in fog, and where they begin inside a medium.

use crate::common::{against_differences, check, derivatives, difference, forward_of, job, params, scene};
use std::f64::consts::PI;
use tyndall::render::driver::Mode;
use tyndall::scene::compile::Orders;

/// A beam onto a plane that an orthographic camera sees whole, from above; `more` stands in it.
fn spot(more: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="r" value="0.5"/><default name="s" value="0.2"/><default name="bx" value="0"/>
  <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
  <sensor type="orthographic"><transform name="to_world"><scale x="1.5" y="1.5"/><lookat origin="0, 6, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="3"/><integer name="height" value="3"/><rfilter type="box"/></film></sensor>
  <shape type="rectangle" id="plane"><transform name="to_world"><scale value="4"/><rotate x="1" angle="-90"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>
  {more}
  <emitter type="collimated"><transform name="to_world"><lookat origin="3, 4, 0" target="0, 0, 0" up="0, 0, 1"/><translate x="$bx"/></transform>
    <float name="radius" value="$r"/><string name="profile" value="hard"/><float name="irradiance" value="10"/></emitter></scene>"#
    )
}

/// Of the plane's light the film's mean is `ρ E A / (π a)`: A the lit area across the beam, a the film's.
#[test]
fn a_spot_grows() {
    let text = spot("").replace(r#"<default name="s" value="0.2"/>"#, "");
    let unit = 0.6 * 10.0 / (PI * 9.0);
    let [d] = &derivatives(&text, &["r"], &["all"], 1 << 14)[..] else { panic!() };
    check("the spot's radius", d, unit * 2.0 * PI * 0.5, 0.01);
    let [none] = &derivatives(&text, &["r"], &["interior", "light_shadow"], 1 << 8)[..] else { panic!() };
    assert!(none.value[0] == 0.0, "without its border: {none:?}");
    let [still] = &derivatives(&text, &["bx"], &["all"], 1 << 14)[..] else { panic!() };
    assert!(still.value[0].abs() <= 4.5 * still.error[0] && still.error[0] < 0.01, "it moves as a whole: {still:?}");
}

/// A half-plane in the beam, whose border is a chord at s from the axis.
#[test]
fn a_shadow_in_a_spot() {
    let plate = r#"<shape type="rectangle"><transform name="to_world"><scale value="1.2"/><translate y="-1.2"/><rotate x="1" angle="90"/><translate z="$s"/><rotate z="1" angle="-36.86989764584402"/><translate x="2.25" y="3"/></transform>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>"#;
    let text = spot(plate);
    let unit = 0.6 * 10.0 / (PI * 9.0);
    let chord = 2.0 * (0.25f64 - 0.04).sqrt();
    let [s, r] = &derivatives(&text, &["s", "r"], &["all"], 1 << 15)[..] else { panic!() };
    check("the plate's place", s, -unit * chord, 0.02);
    // Of the circle's arc the lit part.
    let arc = 2.0 * (0.2f64 / 0.5).acos() * 0.5;
    check("the spot's radius", r, unit * arc, 0.02);
    let [none] = &derivatives(&text, &["s"], &["interior", "hard_profile", "surface_edge"], 1 << 10)[..] else {
        panic!()
    };
    assert!(none.value[0].abs() < 0.1 * unit * chord, "without its shadow: {none:?}");
}

/// Light of one scattering in a box of fog, in which the beam begins at the height y: `K (1 - e^(-σ l))/σ`, l down to the box's bottom. Its start brings K, the way through the fog `-K (1 - e^(-σ l))`.
#[test]
fn a_beam_begins_in_fog() {
    for (profile, across) in [("hard", 1.0), ("gaussian", 0.5)] {
        let text = format!(
            r#"<scene version="3.0.0"><default name="y" value="0.3"/><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.8"/><float name="albedo" value="0.5"/></medium>
  <sensor type="orthographic"><transform name="to_world"><scale x="1.5" y="1.5"/><lookat origin="0, 0, 6" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="3"/><integer name="height" value="3"/><rfilter type="box"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <emitter type="collimated"><transform name="to_world"><rotate x="1" angle="90"/><translate y="$y"/></transform>
    <float name="radius" value="0.2"/><string name="profile" value="{profile}"/><float name="irradiance" value="10"/></emitter></scene>"#
        );
        let once = Orders { first: 1, last: 1 };
        let (sigma, r): (f64, f64) = (0.8, 0.2);
        // Over the beam's section, what is left on the way to the camera: `∫ f e^(-σ (1 - z))`; of even moments the second, r²/4 for both profiles, is enough.
        let section = across * PI * r * r * (-sigma).exp() * (1.0 + 0.5 * sigma * sigma * r * r / 4.0);
        let k = 0.4 * 10.0 / (4.0 * PI) * section / 9.0;
        let left = (-sigma * 1.3f64).exp();
        for (terms, truth) in [("all", k * left), ("hard_profile", k), ("interior", -k * (1.0 - left))] {
            let d = forward_of(&text, once, &["y"], &[terms], 1 << 15)[1];
            check(&format!("{profile}, {terms}"), &d, truth, 0.02);
        }
    }
}

/// A ball and a block in a beam over a floor, in fog or none.
fn room(fog: bool, profile: &str, begin: &str) -> String {
    let (medium, around) = match fog {
        true => (
            r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.5,0.7,0.35"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>"#,
            r#"<shape type="cube"><transform name="to_world"><scale value="2.2"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#,
        ),
        false => ("", ""),
    };
    format!(
        r#"<scene version="3.0.0"><default name="bx" value="0"/><default name="turn" value="0"/><default name="r" value="0.5"/><default name="cam" value="0.5"/><default name="x" value="0.1"/>
  <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>{medium}
  <sensor type="perspective"><float name="fov" value="38"/><transform name="to_world"><lookat origin="$cam, 2, 4.6" target="0, -0.5, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="6"/><rfilter type="tent"/></film></sensor>
  {around}<shape type="rectangle"><transform name="to_world"><scale value="1.8"/><rotate x="1" angle="-90"/><translate y="-1"/></transform><bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.4,0.2"/></bsdf></bsdf></shape>
  <shape type="sphere"><point name="center" value="$x, -0.1, 0.1"/><float name="radius" value="0.35"/><bsdf type="diffuse"><rgb name="reflectance" value="0.6"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.25"/><rotate y="1" angle="25"/><rotate z="1" angle="20"/><translate x="-0.35" y="0.4" z="0.1"/></transform><bsdf type="diffuse"/></shape>
  <emitter type="collimated"><transform name="to_world"><lookat origin="{begin}" target="0.1, -1, 0" up="0, 0, 1"/><rotate z="1" angle="$turn"/><translate x="$bx"/></transform>
    <float name="radius" value="$r"/><string name="profile" value="{profile}"/><float name="irradiance" value="10"/></emitter></scene>"#
    )
}

/// Without one of its terms a derivative is off by more than 5 standard errors.
fn needs(text: &str, orders: Orders, (name, h): (&str, f64), left_out: &str, spp: u64) {
    let all = ["interior", "pixel_edge", "surface_edge", "medium_edge", "light_shadow", "hard_profile"];
    let rest: Vec<&str> = all.into_iter().filter(|t| *t != left_out).collect();
    let fd = difference(text, orders, name, h, spp);
    let z = |terms: &[&str]| {
        let d = forward_of(text, orders, &[name], terms, spp)[1];
        println!("{name} without {left_out}: {d:?} {fd:?}");
        (d.value[1] - fd.value[1]) / d.error[1].hypot(fd.error[1])
    };
    assert!(z(&["all"]).abs() < 5.0);
    assert!(z(&rest).abs() > 5.0);
}

#[test]
fn among_shapes_against_differences() {
    let text = room(false, "hard", "0.3, 3, 0.2");
    let what = [("bx", 0.03), ("turn", 1.0), ("r", 0.03), ("cam", 0.03), ("x", 0.03)];
    against_differences(&text, &what, &["all"], 1 << 13, 0.02);
    // Light that scatters at least twice.
    let twice = Orders { first: 2, ..Orders::default() };
    needs(&text, twice, ("r", 0.03), "hard_profile", 1 << 13);
    let gaussian = room(false, "gaussian", "0.3, 3, 0.2");
    against_differences(&gaussian, &[("bx", 0.03), ("r", 0.03), ("x", 0.03)], &["all"], 1 << 12, 0.02);
    needs(&gaussian, twice, ("x", 0.05), "light_shadow", 1 << 14);
}

/// The rim of a large plate in a narrow beam: what is shaded grows by the chord that the two circles share.
#[test]
fn a_rim_in_a_narrow_beam() {
    let plate = r#"<shape type="disk"><transform name="to_world"><scale value="0.7"/><lookat origin="2.25, 3, $s" target="1.65, 2.2, $s" up="0, 0, 1"/></transform>
      <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>"#;
    let (a, r, s) = (0.7f64, 0.05, 0.72);
    let text = spot(plate).replace(r#"name="r" value="0.5""#, r#"name="r" value="0.05""#);
    let text = text.replace(r#"name="s" value="0.2""#, r#"name="s" value="0.72""#);
    let chord = ((r + a - s) * (s + r - a) * (s - r + a) * (s + r + a)).sqrt() / s;
    let [d] = &derivatives(&text, &["s"], &["all"], 1 << 15)[..] else { panic!() };
    check("the plate's place", d, 0.6 * 10.0 / (PI * 9.0) * chord, 0.01);
    let [none] = &derivatives(&text, &["s"], &["interior", "hard_profile"], 1 << 8)[..] else { panic!() };
    assert!(none.value[0] == 0.0, "without its shadow: {none:?}");
}

#[test]
fn in_fog_against_differences() {
    let text = room(true, "hard", "0.3, 3, 0.2");
    against_differences(&text, &[("bx", 0.05), ("r", 0.03), ("x", 0.05)], &["all"], 1 << 11, 0.02);
    needs(&text, Orders::default(), ("r", 0.03), "hard_profile", 1 << 10);
    let begins = room(true, "gaussian", "0.3, 1.2, 0.2");
    against_differences(&begins, &[("bx", 0.05), ("turn", 3.0), ("cam", 0.05), ("x", 0.05)], &["all"], 1 << 11, 0.02);
}

/// A half-plane high above fog, its border at s from the axis: one scattering of what it shades, over the fog's depth and the chord `2 √(r² - s²)`.
#[test]
fn a_shadow_in_fog() {
    let text = r#"<scene version="3.0.0"><default name="s" value="0.1"/><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.8"/><float name="albedo" value="0.5"/></medium>
  <sensor type="orthographic"><transform name="to_world"><scale x="1.5" y="1.5"/><lookat origin="0, 0, 6" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="3"/><integer name="height" value="3"/><rfilter type="box"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.8"/><rotate x="1" angle="90"/><translate x="-0.8"/><translate x="$s" y="2"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>
  <emitter type="collimated"><transform name="to_world"><rotate x="1" angle="90"/><translate y="3"/></transform>
    <float name="radius" value="0.3"/><string name="profile" value="hard"/><float name="irradiance" value="10"/></emitter></scene>"#;
    let (sigma, half): (f64, f64) = (0.8, (0.09f64 - 0.01).sqrt());
    // Down through the fog, and from the chord's places to the camera.
    let ways = (1.0 - (-2.0 * sigma).exp()) / sigma * (-sigma).exp() * 2.0 * (sigma * half).sinh() / sigma;
    let truth = -0.4 * 10.0 / (4.0 * PI) / 9.0 * ways;
    let once = Orders { first: 1, last: 1 };
    let d = forward_of(text, once, &["s"], &["all"], 1 << 14)[1];
    check("the plate's place", &d, truth, 0.01);
    let none = forward_of(text, once, &["s"], &["interior", "hard_profile", "medium_edge"], 1 << 8)[1];
    assert!(none.value[0] == 0.0, "without its shadow: {none:?}");
}

/// A beam begins half in fog, half above it: its start brings K over the part that is in the fog.
#[test]
fn half_of_a_beam_begins_in_fog() {
    let text = r#"<scene version="3.0.0"><default name="x" value="-0.4"/><integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.8"/><float name="albedo" value="0.5"/></medium>
  <sensor type="orthographic"><transform name="to_world"><scale x="1.5" y="1.5"/><lookat origin="0, 0, 6" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="3"/><integer name="height" value="3"/><rfilter type="box"/></film></sensor>
  <shape type="cube"><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <emitter type="collimated"><transform name="to_world"><rotate y="1" angle="90"/><translate x="$x" y="1.00000001"/></transform>
    <float name="radius" value="0.2"/><string name="profile" value="hard"/><float name="irradiance" value="10"/></emitter></scene>"#;
    let section = 0.5 * PI * 0.04 * (-0.8f64).exp() * (1.0 + 0.5 * 0.64 * 0.01);
    let k = 0.4 * 10.0 / (4.0 * PI) * section / 9.0;
    let once = Orders { first: 1, last: 1 };
    let d = forward_of(text, once, &["x"], &["hard_profile"], 1 << 14)[1];
    check("half of the disk", &d, -k, 0.01);
}

/// What stands in the disk where a beam begins is told, in a vacuum too: half a floor is lit, a ball's shadow is no circle of contact.
#[test]
fn what_crosses_a_start_is_refused() {
    let told = |text: &str, wrt: &str| {
        let (desc, sc) = scene(text);
        let p = params(&desc, &sc, &[wrt]);
        job(&sc, 2, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let text = spot("").replace(r#"<default name="s" value="0.2"/>"#, "");
    assert_eq!(told(&text, "r"), "");
    let from = |begin: &str| told(&text.replace("3, 4, 0", begin), "r");
    assert!(from("0.15, 0.2, 0").contains("`plane` stands in the disk where the beam"));
    assert_eq!(from("0.45, 0.6, 0"), "");
    // A dark ball across the disk, beside it, and before it.
    let ball = |at: &str| {
        spot(&format!(
            r#"<shape type="sphere" id="ball"><point name="center" value="{at}"/><float name="radius" value="$s"/><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>"#
        ))
    };
    assert!(told(&ball("3.06, 4.08, 0.4"), "s").contains("`ball` stands in the disk"));
    assert_eq!(told(&ball("3.06, 4.08, 0.8"), "s"), "");
    assert_eq!(told(&ball("2.7, 3.6, 0.4"), "s"), "");
    // The border of a rod's end, and one around the whole beam.
    let rod = |radius: f64| {
        let text = spot(&format!(
            r#"<shape type="cylinder" id="rod"><point name="p0" value="2.4, 3.2, 0"/><point name="p1" value="3.6, 4.8, 0"/><float name="radius" value="{radius}"/><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>"#
        ));
        told(&text.replace(r#"<default name="s" value="0.2"/>"#, ""), "r")
    };
    assert!(rod(0.3).contains("`rod` stands in the disk"));
    assert_eq!(rod(0.6), "");
}

/// The same in fog.
#[test]
fn a_floor_in_the_start_is_refused() {
    let text =
        room(true, "hard", "0.3, -0.8, 0.2").replace("0.1, -1, 0\" up=\"0, 0, 1\"", "2, -0.9, 0.2\" up=\"0, 0, 1\"");
    let (desc, sc) = scene(&text);
    let p = params(&desc, &sc, &["x"]);
    let told = job(&sc, 2, 1, Mode::Forward(&p)).run(&|_| {}).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(told.contains("stands in the disk where the beam"), "{told}");
}
