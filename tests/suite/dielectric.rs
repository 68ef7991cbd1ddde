//! Smooth interfaces: pictures and material derivatives of slabs of index n against adding-doubling (`stability/slab_values.csv`), furnaces, and what must hold whatever the numbers are.
//! |z| <= 4.5 everywhere (false alarm 7e-6 a comparison).

use crate::common::{against_differences, check, forward, forward_of};
use tyndall::scene::compile::Orders;
use tyndall::study::reference::slab;
use tyndall::study::slab::{Slab, View};

/// Of the film of [`Slab::text`].
const PIXELS: u64 = 256 * 128;

/// Value and derivatives of one view of a slab.
fn slab_case(case: &str, s: Slab, view: View, quantity: &str, paths: usize, precision: f64) {
    let wrt = [("sigma_t", "d_tau"), ("albedo", "d_albedo"), ("g", "d_g")];
    let found = forward(&s.text(view), &wrt.map(|w| w.0), paths as u64 / PIXELS);
    let known = |q: &str| slab(case, q).unwrap_or_else(|| panic!("{case} {q}")).value;
    check(&format!("{case} {quantity}"), &found[0], known(quantity), precision);
    for (k, (_, d)) in wrt.iter().enumerate() {
        let name = format!("{quantity}:{d}");
        check(&format!("{case} {name}"), &found[k + 1], known(&name), f64::INFINITY);
    }
}

#[test]
fn slabs_against_adding_doubling() {
    for (name, s) in [
        ("t1_a0.9_g0_n1.0001", Slab { n: 1.0001, ..Slab::new(1.0, 0.9, 0.0) }),
        ("t1_a0.9_g0_n1.5", Slab { n: 1.5, ..Slab::new(1.0, 0.9, 0.0) }),
        ("t1_a0_g0_n1.33", Slab { n: 1.33, ..Slab::new(1.0, 0.0, 0.0) }),
    ] {
        let case = format!("slab_{name}");
        for (view, quantity) in [(View::R(1.0), "R_1"), (View::T(1.0), "T_1")] {
            slab_case(&case, s, view, quantity, 1 << 16, 0.01);
        }
    }
    let s = Slab { n: 1.5, ..Slab::new(1.0, 0.9, 0.0) };
    for (view, quantity) in [(View::Rdiff, "R_diff"), (View::Tdiff, "T_diff"), (View::R(0.5), "R_0.5")] {
        slab_case("slab_t1_a0.9_g0_n1.5", s, view, quantity, 1 << 16, 0.02);
    }
}

#[test]
fn thick_slabs_against_adding_doubling() {
    for (name, s) in [
        ("t10_a0.999_g0.9_n1.33", Slab { n: 1.33, ..Slab::new(10.0, 0.999, 0.9) }),
        ("t10_a1_g0_n2.4", Slab { n: 2.4, ..Slab::new(10.0, 1.0, 0.0) }),
    ] {
        let case = format!("slab_{name}");
        for (view, quantity) in [(View::R(1.0), "R_1"), (View::T(1.0), "T_1")] {
            slab_case(&case, s, view, quantity, 1 << 16, 0.03);
        }
    }
}

/// Light from everywhere and no absorption: 1 wherever one looks, whatever is refracted and scattered.
#[test]
fn furnaces_of_glass() {
    for n in [1.0001, 1.33, 1.5, 2.4, 0.7] {
        let s = Slab { n, ..Slab::new(1.0, 1.0, 0.0) };
        let found = &forward(&s.text(View::Furnace), &[], (1 << 16) / PIXELS)[0];
        check(&format!("slab n = {n}"), found, 1.0, 0.01);
    }
    let ball = |shape: &str, n: f64| {
        format!(
            r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
            <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.5, 1, 2"/><float name="albedo" value="1"/></medium>
            {shape}<bsdf type="dielectric"><float name="int_ior" value="{n}"/><float name="ext_ior" value="1"/></bsdf><ref name="interior" id="fog"/></shape>
            <emitter type="constant"/>
            <sensor type="perspective"><float name="fov" value="40"/><transform name="to_world"><lookat origin="0.5, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor></scene>"#
        )
    };
    for shape in [r#"<shape type="sphere">"#, r#"<shape type="cube">"#] {
        for n in [1.5, 0.8] {
            let found = &forward(&ball(shape, n), &[], 1 << 9)[0];
            for c in 0..3 {
                let z = found.z(c, 1.0);
                assert!(
                    z.abs() <= 4.5 && found.error[c] < 0.01,
                    "{shape} {n} channel {c}: {} +- {}",
                    found.value[c],
                    found.error[c]
                );
            }
        }
    }
}

/// A block that stands on a table exactly, and a hair above it: the same picture.
#[test]
fn a_block_on_a_table() {
    let scene = |gap: f64| {
        format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="10"/></integrator>
            <shape type="cube"><transform name="to_world"><scale value="0.4"/><translate y="{}"/></transform>
              <bsdf type="dielectric"><float name="int_ior" value="1.4"/><float name="ext_ior" value="1"/></bsdf></shape>
            <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform>
              <bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>
            <emitter type="constant"/>
            <sensor type="perspective"><float name="fov" value="20"/><transform name="to_world"><lookat origin="0.5, 2, 3" target="0, 0.4, 0" up="0, 1, 0"/></transform>
            <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor></scene>"#,
            0.4 + gap
        )
    };
    let above = &forward(&scene(1e-5), &[], 1 << 12)[0];
    let on = &forward(&scene(0.0), &[], 1 << 12)[0];
    let z = (above.value[0] - on.value[0]) / above.error[0].hypot(on.error[0]);
    assert!(z.abs() <= 4.5 && on.error[0] < 0.003 * on.value[0], "{above:?} {on:?} z {z}");
}

/// Without a medium and with clear glass nothing is random but the film: mirrors and panes by Fresnel's formulas.
#[test]
fn panes_and_mirrors() {
    let scene = |bsdf: &str| {
        format!(
            r#"<scene version="3.0.0"><integrator type="path"><integer name="max_depth" value="-1"/></integrator>
            <shape type="cube"><transform name="to_world"><scale x="1000" y="1000" z="0.1"/></transform>{bsdf}</shape>
            <shape type="rectangle"><transform name="to_world"><scale value="100000"/><rotate y="1" angle="180"/><translate z="5"/></transform>
              <emitter type="area"><rgb name="radiance" value="2"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
            <sensor type="orthographic"><transform name="to_world"><scale value="1e-9"/><rotate y="1" angle="60"/><translate x="-3" z="-2"/></transform>
            <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/></film></sensor></scene>"#
        )
    };
    // At 60 degrees, n = 1.5, both faces: T = (1-F)/(1+F).
    let f = tyndall::math::fresnel::Interface::new(0.5, 1.0, 1.5).reflectance();
    let glass =
        r#"<bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf>"#;
    check("pane", &forward(&scene(glass), &[], 1 << 14)[0], 2.0 * (1.0 - f) / (1.0 + f), 0.01);
    let same =
        r#"<bsdf type="dielectric"><float name="int_ior" value="1.2"/><float name="ext_ior" value="1.2"/></bsdf>"#;
    check("nothing", &forward(&scene(same), &[], 32)[0], 2.0, 1e-12);
    // A mirror turned by 45 degrees shows what stands beside.
    let mirror = |bsdf: &str| {
        format!(
            r#"<scene version="3.0.0"><integrator type="path"/>
            <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate y="1" angle="135"/></transform>{bsdf}</shape>
            <shape type="rectangle"><transform name="to_world"><scale value="9"/><rotate y="1" angle="90"/><translate x="-20"/></transform>
              <emitter type="area"><rgb name="radiance" value="2"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
            <sensor type="orthographic"><transform name="to_world"><scale value="1e-9"/><translate z="-5"/></transform>
            <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/></film></sensor></scene>"#
        )
    };
    let seen = |bsdf: &str| {
        let turned = |angle: &str| forward(&mirror(bsdf).replace("135", angle), &[], 32)[0].value[0];
        turned("135").max(turned("225"))
    };
    let mirror = r#"<bsdf type="twosided"><bsdf type="conductor"/></bsdf>"#;
    assert!((seen(mirror) - 2.0).abs() < 1e-12, "{}", seen(mirror));
    let metal = r#"<bsdf type="twosided"><bsdf type="conductor"><rgb name="eta" value="0.2"/><rgb name="k" value="3.9"/></bsdf></bsdf>"#;
    let f: f64 = tyndall::math::fresnel::conductor(0.5f64.sqrt(), 0.2, 3.9);
    assert!((seen(metal) - 2.0 * f).abs() < 1e-9, "{} {f}", seen(metal));
}

/// Fog before and behind a pane and a mirror, coloured, with a small lamp and a floor: everything that a record behind an interface begins with.
#[test]
#[ignore = "make stress"]
fn fog_before_and_behind_interfaces_against_differences() {
    let text = r#"<scene version="3.0.0">
        <default name="sigma" value="0.4"/><default name="albedo" value="0.8"/><default name="g" value="0.3"/>
        <default name="rho" value="0.6"/><default name="glow" value="0.2"/>
        <integrator type="volpath"><integer name="max_depth" value="5"/></integrator>
        <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="$sigma, 0.2, 0.6"/><float name="albedo" value="$albedo"/>
          <phase type="hg"><float name="g" value="$g"/></phase><float name="emission" value="$glow"/></medium>
        <shape type="cube"><transform name="to_world"><scale value="3"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
        <shape type="cube"><transform name="to_world"><scale x="1" y="1" z="0.1"/><rotate y="1" angle="20"/><translate x="-0.7" z="0.8"/></transform>
          <bsdf type="dielectric"><float name="int_ior" value="1.5"/><float name="ext_ior" value="1"/></bsdf><ref name="exterior" id="fog"/></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="1.5"/><rotate y="1" angle="-30"/><translate x="0.8" z="-1"/></transform>
          <bsdf type="conductor"><rgb name="eta" value="0.2, 0.9, 1.4"/><rgb name="k" value="3.9, 2.5, 1.9"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2.5"/><translate y="-1"/></transform>
          <bsdf type="diffuse"><rgb name="reflectance" value="$rho"/></bsdf></shape>
        <shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/><translate y="2"/></transform>
          <emitter type="area"><rgb name="radiance" value="20"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
        <sensor type="perspective"><float name="fov" value="40"/>
          <transform name="to_world"><lookat origin="0.3, 0.4, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="8"/></film></sensor></scene>"#;
    let wrt = [("sigma", 0.04), ("albedo", 0.05), ("g", 0.15), ("rho", 0.05), ("glow", 0.05)];
    against_differences(text, &wrt, &["all"], 1 << 11, 0.01);
}

/// A cube of fog whose top lies in the surface of the water: light that the surface throws back goes on through the fog, as it does with a gap between them.
#[test]
fn fog_flush_with_the_water_over_it() {
    let third = |z: f64| {
        let text = format!(
            r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="28"/><transform name="to_world"><lookat origin="0.3,-3,2.5" target="0,0,0" up="0,0,1"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="2"/><float name="albedo" value="1"/><phase type="hg"><float name="g" value="0.4"/></phase></medium>
  <shape type="rectangle"><transform name="to_world"><scale value="9"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.33"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.6"/><translate z="{z}"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <emitter type="constant"/></scene>"#
        );
        forward_of(&text, Orders { first: 3, last: 3 }, &[], &["all"], 1 << 16)[0]
    };
    let (flush, apart) = (third(-0.6), third(-0.6001));
    let se = flush.error[0].hypot(apart.error[0]);
    assert!((flush.value[0] - apart.value[0]).abs() <= 4.5 * se, "{flush:?} {apart:?}");
    // Where such light left the fog it was 2.7 % more.
    assert!(se < 0.005 * apart.value[0], "{se}");
}

/// The same beside the origin, where coordinates tell points apart by less than the rounding that rays bring: nothing of the fog is seen but through the water, by light that comes through it.
#[test]
fn fog_flush_with_the_water_at_the_origin() {
    let text = r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="2"/><transform name="to_world"><lookat origin="0.3,-3,2.5" target="0,0,0" up="0,0,1"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="2"/><float name="albedo" value="1"/></medium>
  <shape type="rectangle"><transform name="to_world"><scale value="9"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.33"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.6"/><translate z="-0.6"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <emitter type="point"><point name="position" value="0.3, 0.2, 1.2"/><float name="intensity" value="10"/></emitter></scene>"#;
    let of = |order| forward_of(text, Orders { first: order, last: order }, &[], &["all"], 1 << 13)[0];
    assert!(of(3).value[0] > 0.0);
    assert_eq!(of(2).value[0], 0.0);
}
