//! `surface_edge` and `medium_edge` from the edge outward and from the vertices of camera paths: two samplings of one integral that share neither measure nor
//! directions nor importance. |z| <= 4.5 a comparison (false alarm 7e-6), seeds fixed, each form's standard error at most a few percent of a term that is far from 0.

use crate::common::{Estimate, estimate, job, params, scene_of_orders};
use tyndall::math::Rgb;
use tyndall::math::rng::Rng;
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Terms;
use tyndall::scene::compile::Orders;
use tyndall::term::EdgeForm;

/// A floor, a shape over it, a lamp or a sky, up to three scatterings. The camera looks down at the floor beside the shape; in fog, along the floor past it.
fn text(shape: &str, light: &str, fog: bool) -> String {
    let medium = r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.4, 0.5, 0.4"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale x="1.2" y="0.75" z="1.2"/><translate y="0.7"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#;
    let (medium, view) = if fog {
        (medium, r#"origin="0.9, 0.35, 2" target="0.55, 0.3, 0""#)
    } else {
        ("", r#"origin="1.4, 1.6, 2.4" target="0.75, 0.1, 0""#)
    };
    format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="y" value="0.6"/><default name="size" value="0.35"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>{medium}
  <sensor type="perspective"><float name="fov" value="24"/><transform name="to_world"><lookat {view} up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="tent"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="1.5"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.5,0.4"/></bsdf></shape>
  {shape}{light}</scene>"#
    )
}

const BLOCK: &str = r#"<shape type="cube"><transform name="to_world"><scale x="$size" y="0.2" z="0.3"/><rotate y="1" angle="20"/><translate x="$x" y="$y"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.3"/></bsdf></shape>"#;
const BALL: &str = r#"<shape type="sphere"><point name="center" value="$x, $y, 0"/><float name="radius" value="$size"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.3"/></bsdf></shape>"#;
/// Open, of two sides: its rims are edges.
const TUBE: &str = r#"<shape type="cylinder"><point name="p0" value="-0.4, -0.1, 0"/><point name="p1" value="0.4, 0.1, 0"/><float name="radius" value="$size"/>
    <transform name="to_world"><scale value="0.7"/><rotate y="1" angle="20"/><translate x="$x" y="$y"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.6,0.3"/></bsdf></bsdf></shape>"#;
const LAMP: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.9"/><rotate x="1" angle="90"/><translate x="0.2" y="1.6"/></transform>
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

/// Samples from the edge outward, and from vertices; a quarter of them for each order by itself.
const SPP: [u64; 2] = [1 << 14, 1 << 14];

/// Both forms, of all orders together and of each by itself. Standard errors are at most a share `precision` of the whole (of one order: four times that), in the green channel.
fn agree(text: &str, wrt: &[&str], room: &str, precision: f64) {
    let only = |k| Orders { first: k, last: k };
    let mut whole = Vec::new();
    for (name, orders) in [("all", Orders::default()), ("1", only(1)), ("2", only(2)), ("3", only(3))] {
        let (precision, fewer) = if name == "all" { (precision, 1) } else { (4.0 * precision, 4) };
        let of = |form, spp| term(text, orders, wrt, room, form, spp / fewer);
        let (a, b) = (of(EdgeForm::Outward, SPP[0]), of(EdgeForm::PerVertex, SPP[1]));
        for (k, w) in wrt.iter().enumerate() {
            let (a, b) = (&a[k], &b[k]);
            let z = |c: usize| (a.value[c] - b.value[c]) / a.error[c].hypot(b.error[c]);
            if name == "all" {
                whole.push(a.value[1].abs());
            }
            let relative = [a, b].map(|e| e.error[1] / whole[k]);
            println!("{room} {w}, orders {name}: {} {} z {:.1} errors {relative:.3?}", a.value[1], b.value[1], z(1));
            assert!(relative.iter().all(|e| *e <= precision), "{room} {w}, orders {name}: {relative:?}");
            assert!((0..3).all(|c| z(c).abs() <= 4.5), "{room} {w}, orders {name}: {a:?} {b:?}");
        }
    }
    // Negative control: it is no comparison of two zeros.
    assert!(whole.iter().all(|w| *w > 1e-2), "{room}: {whole:?}");
}

#[test]
fn a_block_under_a_lamp() {
    agree(&text(BLOCK, LAMP, false), &["x", "size"], "surface_edge", 0.03);
}

#[test]
fn a_block_in_fog() {
    agree(&text(BLOCK, LAMP, true), &["x", "size"], "medium_edge", 0.05);
}

#[test]
fn a_ball() {
    agree(&text(BALL, LAMP, false), &["x", "size"], "surface_edge", 0.03);
    agree(&text(BALL, LAMP, true), &["x", "size"], "medium_edge", 0.05);
}

#[test]
fn a_tube_and_its_rims() {
    agree(&text(TUBE, LAMP, false), &["x", "size"], "surface_edge", 0.03);
    agree(&text(TUBE, LAMP, true), &["x", "size"], "medium_edge", 0.05);
}

#[test]
fn under_the_sky() {
    agree(&text(BLOCK, SKY, false), &["y", "size"], "surface_edge", 0.04);
    agree(&text(BALL, SKY, true), &["x", "size"], "medium_edge", 0.05);
}

/// The validation mode is a room like others: forward·v = reverse.
#[test]
fn forward_dot_v_equals_reverse() {
    let (desc, sc) = scene_of_orders(&text(BLOCK, LAMP, true), &[], Orders::default());
    let p = params(&desc, &sc, &["x", "size"]);
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
