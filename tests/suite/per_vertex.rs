//! `surface_edge` and `medium_edge` from the edge outward and from the vertices of camera paths: two samplings of one integral that share neither measure nor
//! directions nor importance. |z| <= 4.5 a comparison (false alarm 7e-6), seeds fixed, each form's standard error at most a few percent of a term that is far from 0.

use crate::common::{Estimate, estimate, job, params, scene_of_orders};
use tyndall::math::Rgb;
use tyndall::math::rng::Rng;
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Terms;
use tyndall::scene::compile::Orders;
use tyndall::term::EdgeForm;

/// A floor, `shapes` over it, a lamp or a sky. The camera looks down at the floor; up to three scatterings.
fn text(shapes: &str, light: &str, fog: bool) -> String {
    let medium = r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.3, 0.5, 0.4"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>"#;
    let (medium, inside) = if fog { (medium, r#"<ref id="fog"/>"#) } else { ("", "") };
    format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="turn" value="20"/><default name="r" value="0.35"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>{medium}
  <sensor type="perspective"><float name="fov" value="34"/>
    <transform name="to_world"><lookat origin="0.3, 2.2, 3.4" target="0, 0.3, 0" up="0, 1, 0"/></transform>{inside}
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="tent"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="1.5"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.5,0.4"/></bsdf></shape>
  {shapes}{light}</scene>"#
    )
}

const BLOCK: &str = r#"<shape type="cube"><transform name="to_world"><scale x="0.35" y="0.2" z="0.3"/><rotate y="1" angle="$turn"/><translate x="$x" y="0.6"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.3"/></bsdf></shape>"#;
const BALL: &str = r#"<shape type="sphere"><point name="center" value="$x, 0.65, 0"/><float name="radius" value="$r"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.3"/></bsdf></shape>"#;
const TUBE: &str = r#"<shape type="cylinder"><point name="p0" value="-0.4, -0.1, 0"/><point name="p1" value="0.4, 0.1, 0"/><float name="radius" value="$r"/>
    <transform name="to_world"><scale value="0.7"/><rotate y="1" angle="$turn"/><translate x="$x" y="0.65"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.3"/></bsdf></bsdf></shape>"#;
const LAMP: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.9"/><rotate x="1" angle="90"/><translate x="0.2" y="2.3"/></transform>
    <emitter type="area"><rgb name="radiance" value="3,2.5,2"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf></shape>"#;
const SKY: &str = r#"<emitter type="constant"><rgb name="radiance" value="1,0.8,0.7"/></emitter>"#;

/// Derivatives of the mean pixel of one room.
fn term(text: &str, orders: Orders, wrt: &[&str], room: &str, edges: EdgeForm, spp: u64) -> Vec<Estimate> {
    let (desc, sc) = scene_of_orders(text, &[], orders);
    let p = params(&desc, &sc, wrt);
    let terms = Terms::parse(&[room.to_string()]).unwrap();
    let o = Job { terms, edges, ..job(&sc, spp, 7, Mode::Forward(&p)) }.run(&|_| {}).unwrap();
    assert_eq!(o.film.health.biasing(), 0, "{:?}", o.film.health.entries().collect::<Vec<_>>());
    (1..=wrt.len()).map(|k| estimate(&o, k)).collect()
}

/// Both forms, of all orders together and of each by itself. `spp`: from the edge outward, from vertices. `precision`: of all orders, in the green channel; that of one order is
/// four times of it in units of the sum.
fn agree(text: &str, wrt: &[&str], room: &str, spp: [u64; 2], precision: f64) {
    let all = Orders::default();
    let only = |k| Orders { first: k, last: k };
    let mut of_all = Vec::new();
    for (name, orders) in [("all", all), ("1", only(1)), ("2", only(2)), ("3", only(3))] {
        let of = |form, spp| term(text, orders, wrt, room, form, spp);
        let (a, b) = (of(EdgeForm::Outward, spp[0]), of(EdgeForm::PerVertex, spp[1]));
        for (k, w) in wrt.iter().enumerate() {
            let (a, b) = (&a[k], &b[k]);
            println!("{room} {w}, orders {name}: {:?} +- {:?}, {:?} +- {:?}", a.value, a.error, b.value, b.error);
            if name == "all" {
                of_all.push(a.value[1].abs());
            }
            let precision = if name == "all" { precision } else { 4.0 * precision };
            assert!(of_all[k] > 1e-3, "{room} {w}: next to nothing");
            for e in [a, b] {
                assert!(e.error[1] <= precision * of_all[k], "{room} {w}, orders {name}: +- {:?}", e.error);
            }
            for c in 0..3 {
                let z = (a.value[c] - b.value[c]) / a.error[c].hypot(b.error[c]);
                assert!(z.abs() <= 4.5, "{room} {w}, orders {name}, channel {c}: {a:?} {b:?}, z {z}");
            }
        }
    }
}

#[test]
fn a_block_under_a_lamp() {
    agree(&text(BLOCK, LAMP, false), &["x", "turn"], "surface_edge", [1 << 13, 1 << 14], 0.03);
}

#[test]
fn a_block_in_fog() {
    agree(&text(BLOCK, LAMP, true), &["x", "turn"], "medium_edge", [1 << 13, 1 << 14], 0.03);
}

#[test]
fn a_ball() {
    agree(&text(BALL, LAMP, false), &["x", "r"], "surface_edge", [1 << 13, 1 << 14], 0.03);
    agree(&text(BALL, LAMP, true), &["x", "r"], "medium_edge", [1 << 13, 1 << 14], 0.03);
}

#[test]
fn a_tube_and_its_rims() {
    agree(&text(TUBE, LAMP, false), &["x", "r"], "surface_edge", [1 << 13, 1 << 14], 0.03);
    agree(&text(TUBE, LAMP, true), &["x", "r"], "medium_edge", [1 << 13, 1 << 14], 0.03);
}

#[test]
fn under_the_sky() {
    agree(&text(BLOCK, SKY, false), &["x", "turn"], "surface_edge", [1 << 13, 1 << 14], 0.03);
    agree(&text(BLOCK, SKY, true), &["x", "turn"], "medium_edge", [1 << 13, 1 << 14], 0.03);
}

/// The validation mode is a room like others: forward·v = reverse.
#[test]
fn forward_dot_v_equals_reverse() {
    let (desc, sc) = scene_of_orders(&text(BLOCK, LAMP, true), &[], Orders::default());
    let p = params(&desc, &sc, &["x", "turn"]);
    for room in ["surface_edge", "medium_edge"] {
        let terms = || Terms::parse(&[room.to_string()]).unwrap();
        let job = |mode| Job { terms: terms(), edges: EdgeForm::PerVertex, ..job(&sc, 64, 3, mode) };
        let f = job(Mode::Forward(&p)).run(&|_| {}).unwrap();
        let pixels = f.film.spec().pixels();
        let mut rng = Rng::keyed(9, 0, 0, 0);
        let v: Vec<Rgb> = (0..pixels).map(|_| Rgb::from_fn(|_| rng.uniform() - 0.3)).collect();
        let r = job(Mode::Reverse(&p, &v)).run(&|_| {}).unwrap();
        let gradient = p.pull_back(&r.gradient.unwrap().0);
        for (k, g) in gradient.iter().enumerate() {
            let dot: f64 = (0..pixels).map(|i| f.film.mean(k + 1, i).dot(v[i])).sum();
            let scale: f64 = (0..pixels).map(|i| (f.film.mean(k + 1, i) * v[i]).abs().sum()).sum();
            assert!(scale > 0.0 && (dot - g).abs() <= 1e-10 * scale, "{room}: {dot} {g} of {scale}");
        }
    }
}
