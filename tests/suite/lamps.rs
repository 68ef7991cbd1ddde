//! Connections to lamps by way of smooth surfaces: what they find together with chance is what chance finds alone, with far smaller errors; derivatives and pictures beside moving glass are what they were.

use crate::common::*;
use tyndall::render::driver::{Job, Mode, Outcome};
use tyndall::render::plan::Terms;
use tyndall::scene::Scene;
use tyndall::scene::compile::Orders;
use tyndall::scene::lamps::Lamps;

/// A floor under glass and a lamp of half-width s, seen from above.
fn room(glass: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="s" value="0.15"/><default name="n" value="1.5"/><default name="x" value="0"/><default name="milk" value="1"/>
  <integrator type="volpath"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective"><float name="fov" value="26"/><transform name="to_world"><lookat origin="0.3, 1.6, 4.2" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="milk"><rgb name="sigma_t" value="0.8,1,1.2"/><float name="scale" value="$milk"/><float name="albedo" value="0.8"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>
  <shape type="rectangle"><transform name="to_world"><scale value="2"/><rotate x="1" angle="-90"/><translate y="-0.8"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.5,0.4"/></bsdf></shape>
  <shape type="rectangle" id="lamp"><transform name="to_world"><scale value="$s"/><rotate x="1" angle="90"/><translate x="0.4" y="2.1" z="0.6"/></transform>
    <bsdf type="diffuse"><float name="reflectance" value="0"/></bsdf><emitter type="area"><rgb name="radiance" value="40,30,20"/></emitter></shape>{glass}</scene>"#
    )
}

const GLASS: &str =
    r#"<bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf>"#;
const MILK: &str = r#"<ref name="interior" id="milk"/>"#;

fn block() -> String {
    format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="0.6" y="0.4" z="0.45"/><rotate y="1" angle="25"/><translate x="$x"/></transform>{GLASS}{MILK}</shape>"#
    )
}

/// Two planes of glass over all of it.
fn window() -> String {
    let pane = |y: f64, indices: [&str; 2]| {
        format!(
            r#"<shape type="rectangle"><transform name="to_world"><scale value="9"/><rotate x="1" angle="-90"/><translate y="{y}"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="{}"/><float name="ext_ior" value="{}"/></bsdf></shape>"#,
            indices[0], indices[1]
        )
    };
    pane(1.7, ["$n", "1"]) + &pane(1.8, ["1", "$n"])
}

fn ball() -> String {
    format!(
        r#"<shape type="sphere"><point name="center" value="$x, -0.1, 0"/><float name="radius" value="0.5"/>{GLASS}{MILK}</shape>"#
    )
}

const MIRROR: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.8"/><rotate y="1" angle="20"/><translate x="$x" y="0.1" z="-0.9"/></transform>
  <bsdf type="twosided"><bsdf type="conductor"><rgb name="eta" value="0.2,0.9,1.2"/><float name="k" value="2.5"/></bsdf></bsdf></shape>"#;

/// Milk in a block, and in a ball, floors beside and under them, windows and mirrors: the light is that of chance; errors are far less.
#[test]
fn connections_find_what_chance_finds() {
    let cases =
        [(block(), 1 << 14, 4.0), (window(), 1 << 14, 20.0), (ball(), 1 << 14, 2.0), (block() + MIRROR, 1 << 14, 2.0)];
    for (glass, spp, gain) in cases {
        let (with, chance) = (forward(&room(&glass), &[], spp)[0], by_chance(&room(&glass), 2 * spp));
        for c in 0..3 {
            let se = with.error[c].hypot(chance.error[c]);
            assert!((with.value[c] - chance.value[c]).abs() < 4.5 * se, "{glass} {c}: {with:?} {chance:?}");
            // Of half as many samples.
            assert!(with.error[c] * gain < chance.error[c], "{glass} {c}: {with:?} {chance:?}");
        }
    }
}

/// Derivatives by media and lamps follow connections, too.
#[test]
fn values_follow_connections() {
    let text =
        room(&block()).replace("40,30,20", "$s,30,20").replace(r#"<scale value="$s"/>"#, r#"<scale value="0.15"/>"#);
    let text = text.replace(r#"name="s" value="0.15""#, r#"name="s" value="40""#);
    let (desc, mut sc) = scene(&text);
    let p = params(&desc, &sc, &["milk", "s"]);
    let of = |sc: &Scene, spp| {
        let o = run(sc, spp, 5, Mode::Forward(&p));
        [1, 2].map(|k| estimate(&o, k))
    };
    let with = of(&sc, 1 << 13);
    sc.lamps = Lamps::default();
    let chance = of(&sc, 1 << 15);
    for (k, (a, b)) in with.iter().zip(&chance).enumerate() {
        let se = a.error[0].hypot(b.error[0]);
        assert!((a.value[0] - b.value[0]).abs() < 4.5 * se && 3.0 * a.error[0] < b.error[0], "{k}: {a:?} {b:?}");
    }
}

/// Beside glass and mirrors that move, pictures keep their bits, and derivatives, those by values too, are those of paths that find lamps by chance. Of what has scattered twice, so that none of it comes straight.
#[test]
fn motion_is_left_to_chance() {
    for glass in [MIRROR.to_owned(), block()] {
        let text = room(&glass).replace(r#"name="s" value="0.15""#, r#"name="s" value="0.4""#);
        let text = text.replace("0.6,0.5,0.4", "$white,0.5,0.4");
        let text = text.replacen("<default", r#"<default name="white" value="0.6"/><default"#, 1);
        let (desc, mut sc) = scene_of_orders(&text, &[], Orders { first: 2, last: u32::MAX });
        let p = params(&desc, &sc, &["x", "white"]);
        let interior = |sc: &Scene| -> Outcome {
            let terms = Terms::parse(&["interior".into()]).unwrap();
            Job { terms, ..job(sc, 1 << 14, 5, Mode::Forward(&p)) }.run(&|_| {}).unwrap()
        };
        let (picture, with) = (run(&sc, 1 << 14, 5, Mode::Picture), interior(&sc));
        assert_eq!(estimate(&picture, 0).value, estimate(&with, 0).value, "{glass}");
        sc.lamps = Lamps::default();
        let chance = interior(&sc);
        for k in [1, 2] {
            let [a, b] = [&with, &chance].map(|o| estimate(o, k));
            let se = a.error[0].hypot(b.error[0]);
            assert!((a.value[0] - b.value[0]).abs() <= 4.5 * se, "{glass} {k}: {a:?} {b:?}");
            assert!((a.error[0] / b.error[0] - 1.0).abs() < 0.3 || b.error[0] == 0.0, "{glass} {k}: {a:?} {b:?}");
        }
        // A fifth of it would be seen; connections are half of it.
        let white = estimate(&chance, 2);
        assert!(white.error[0] < 0.03 * white.value[0], "{white:?}");
    }
}

/// A lamp level with the top of a block and with a mirror: nothing goes along their planes, and no search is lost there (`forward` asks for that).
#[test]
fn lamps_level_with_glass_and_mirrors() {
    let level = format!(
        r#"<shape type="cube"><transform name="to_world"><scale value="0.4"/><translate x="-0.8" y="1.7" z="0.6"/></transform>{GLASS}</shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="-90"/><translate x="1.2" y="2.1" z="0.6"/></transform>
    <bsdf type="twosided"><bsdf type="conductor"><rgb name="eta" value="0.2,0.9,1.2"/><float name="k" value="2.5"/></bsdf></bsdf></shape>"#
    );
    let text = room(&level);
    let (with, chance) = (forward(&text, &[], 1 << 12)[0], by_chance(&text, 1 << 13));
    for c in 0..3 {
        let se = with.error[c].hypot(chance.error[c]);
        assert!((with.value[c] - chance.value[c]).abs() < 4.5 * se, "{c}: {with:?} {chance:?}");
    }
    // Turned up, it lights nothing that the camera sees.
    let up = text
        .replace(r#"<rotate x="1" angle="90"/><translate x="0.4""#, r#"<rotate x="1" angle="-90"/><translate x="0.4""#);
    assert_ne!(up, text);
    assert_eq!(forward(&up, &[], 1 << 10)[0].value, by_chance(&up, 1 << 10).value);
}
