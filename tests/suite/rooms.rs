//! What holds for every boundary room, whatever it computes: forward and reverse are transposes, threads change no bit, the picture is
//! none of its business, terms add up, and without it the derivative is wrong.

use crate::common::{estimate, job, params, run, scene};
use tyndall::math::Rgb;
use tyndall::math::rng::Rng;
use tyndall::render::driver::{Job, Mode, Outcome};
use tyndall::render::plan::Terms;
use tyndall::scene::Scene;
use tyndall::scene::desc::SceneDesc;
use tyndall::term::{EdgeForm, Motion, ROOMS, rooms};

/// Fog over a floor, a ball, a knot of two triangles; a point light that moves, and a spot with a hard edge that turns.
const ROOM: &str = r#"<scene version="3.0.0">
  <default name="x" value="-0.3"/><default name="y" value="1.35"/><default name="turn" value="15"/><default name="cone" value="20"/><default name="sigma" value="0.6"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="26"/>
    <transform name="to_world"><lookat origin="0, 0.3, 5" target="0, -0.2, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="gaussian"/></film></sensor>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="$sigma, 0.9, 0.3"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale value="1.5"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="4"/><translate y="-1.2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" x="-0.5" y="0.3" z="0"/><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="0.3"/><rotate x="1" angle="-80"/><translate x="0.5" y="0.4" z="0.1"/></transform><bsdf type="twosided"><bsdf type="diffuse"/></bsdf></shape>
  <emitter type="point"><point name="position" value="$x, $y, 0.3"/><rgb name="intensity" value="3"/></emitter>
  <emitter type="spot"><transform name="to_world"><rotate x="1" angle="90"/><rotate z="1" angle="$turn"/><translate x="0.4" y="2.5"/></transform>
    <float name="cutoff_angle" value="$cone"/><float name="beam_width" value="$cone"/><rgb name="intensity" value="8"/></emitter>
</scene>"#;

const MOVING: [&str; 4] = ["x", "y", "turn", "cone"];

/// A floor, a ball, a block and a lamp in a vacuum, a point light; ball, block, lamp and camera move.
const VACUUM: &str = r#"<scene version="3.0.0">
  <default name="ball" value="0.2"/><default name="turn" value="20"/><default name="lamp" value="0.4"/><default name="camera" value="0.1"/><default name="radiance" value="6"/>
  <integrator type="path"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="$camera, 1.2, 4" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="gaussian"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" value="$ball, 0.7, 0.2"/><float name="radius" value="0.35"/><bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.25"/><rotate y="1" angle="$turn"/><translate x="-0.6" y="0.5" z="0.3"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="$lamp"/><rotate x="1" angle="90"/><translate y="2.2"/></transform>
    <emitter type="area"><rgb name="radiance" value="$radiance"/></emitter></shape>
  <emitter type="point"><point name="position" value="0.4, 1.9, 0.6"/><rgb name="intensity" value="3"/></emitter>
</scene>"#;

/// A floor, a ball, a block, a lamp, a point light and a hard spot in fog; ball, block, lamp and camera move.
const FOG: &str = r#"<scene version="3.0.0">
  <default name="ball" value="0.2"/><default name="turn" value="20"/><default name="lamp" value="0.4"/><default name="camera" value="0.1"/><default name="radiance" value="6"/>
  <default name="spot" value="0.3"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.3, 0.5, 0.2"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>
  <sensor type="perspective"><float name="fov" value="40"/><ref id="fog"/>
    <transform name="to_world"><lookat origin="$camera, 1.2, 4" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="gaussian"/></film><sampler type="ldsampler"/></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere"><point name="center" value="$ball, 0.7, 0.2"/><float name="radius" value="0.35"/><bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.25"/><rotate y="1" angle="$turn"/><translate x="-0.6" y="0.5" z="0.3"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="$lamp"/><rotate x="1" angle="90"/><translate y="2.2"/></transform>
    <emitter type="area"><rgb name="radiance" value="$radiance"/></emitter></shape>
  <emitter type="point"><point name="position" value="0.4, 1.9, 0.6"/><rgb name="intensity" value="3"/></emitter>
  <emitter type="spot"><transform name="to_world"><rotate x="1" angle="80"/><translate x="$spot" y="2.6" z="-0.9"/></transform>
    <float name="cutoff_angle" value="20"/><float name="beam_width" value="20"/><rgb name="intensity" value="8"/></emitter>
</scene>"#;

/// A floor, a block, a lamp and a block of glass in a vacuum; index, opaque block, lamp and camera move.
const GLASS: &str = r#"<scene version="3.0.0">
  <default name="ior" value="1.4"/><default name="turn" value="20"/><default name="lamp" value="0.4"/><default name="camera" value="0.1"/>
  <integrator type="volpath"><integer name="max_depth" value="4"/></integrator>
  <sensor type="perspective"><float name="fov" value="36"/>
    <transform name="to_world"><lookat origin="$camera, 1.6, 4" target="0, 0.5, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="gaussian"/></film><sampler type="ldsampler"/></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.3"/><rotate y="1" angle="$turn"/><translate x="-0.6" y="0.6" z="0.3"/></transform><bsdf type="diffuse"/></shape>
  <shape type="cube"><transform name="to_world"><scale value="0.5"/><rotate y="1" angle="15"/><translate x="0.6" y="0.7" z="0.4"/></transform>
    <bsdf type="dielectric"><float name="int_ior" value="$ior"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="$lamp"/><translate x="0.5" y="0.7" z="-0.8"/></transform>
    <emitter type="area"><rgb name="radiance" value="6"/></emitter></shape>
</scene>"#;

/// Scene, what moves in it, and the rooms that this needs.
type Case = (&'static str, [&'static str; 4], &'static [&'static str]);

const CASES: [Case; 4] = [
    (ROOM, MOVING, &["light_shadow", "hard_profile"]),
    (VACUUM, ["ball", "turn", "lamp", "camera"], &["light_shadow", "pixel_edge", "surface_edge"]),
    (
        FOG,
        ["ball", "turn", "lamp", "camera"],
        &["light_shadow", "hard_profile", "pixel_edge", "surface_edge", "medium_edge"],
    ),
    (GLASS, ["ior", "turn", "lamp", "camera"], &["pixel_edge", "virtual_edge", "surface_edge"]),
];

fn terms(names: &[&str]) -> Terms {
    Terms::parse(&names.iter().map(|n| n.to_string()).collect::<Vec<_>>()).unwrap()
}

#[test]
fn forward_dot_v_equals_reverse() {
    CASES.iter().for_each(transposes);
    let (text, _, rooms) = CASES[2];
    transposes(&(text, ["spot", "ball", "lamp", "camera"], rooms));
}

fn transposes(&(text, moving, rooms): &Case) {
    let (desc, sc) = scene(text);
    let p = params(&desc, &sc, &moving);
    for chosen in ["all", "interior"].iter().chain(rooms) {
        let job = |mode| Job { terms: terms(&[*chosen]), ..job(&sc, 64, 3, mode) };
        let f = job(Mode::Forward(&p)).run(&|_| {}).unwrap();
        let pixels = f.film.spec().pixels();
        let mut rng = Rng::keyed(9, 0, 0, 0);
        let v: Vec<Rgb> = (0..pixels).map(|_| Rgb::from_fn(|_| rng.uniform() - 0.3)).collect();
        let r = job(Mode::Reverse(&p, &v)).run(&|_| {}).unwrap();
        let gradient = p.pull_back(&r.gradient.unwrap().0);
        let mut any = false;
        for (k, name) in moving.iter().enumerate() {
            let dot: f64 = (0..pixels).map(|i| f.film.mean(k + 1, i).dot(v[i])).sum();
            let scale: f64 = (0..pixels).map(|i| (f.film.mean(k + 1, i) * v[i]).abs().sum()).sum();
            any |= scale > 0.0;
            assert!((dot - gradient[k]).abs() <= 1e-10 * scale, "{chosen} {name}: {dot} {} of {scale}", gradient[k]);
        }
        assert!(any, "{chosen}: nothing to compare");
    }
}

fn same(a: &Outcome, b: &Outcome, layers: std::ops::Range<usize>) {
    for layer in layers {
        for i in 0..a.film.spec().pixels() {
            assert_eq!(a.film.mean(layer, i), b.film.mean(layer, i), "layer {layer}, pixel {i}");
            assert_eq!(a.film.variance_of_mean(layer, i), b.film.variance_of_mean(layer, i));
        }
    }
}

#[test]
fn threads_crops_and_rooms_change_no_bit() {
    CASES.iter().for_each(same_bits);
}

fn same_bits(&(text, moving, _): &Case) {
    let (desc, sc) = scene(text);
    let p = params(&desc, &sc, &moving);
    let v = vec![Rgb::ONE; 48];
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (run(&sc, 32, 5, Mode::Forward(&p)), run(&sc, 32, 5, Mode::Reverse(&p, &v))))
    };
    let (a, ra) = with(1);
    for threads in [2, 8] {
        let (b, rb) = with(threads);
        same(&a, &b, 0..1 + MOVING.len());
        assert_eq!(ra.gradient, rb.gradient);
    }
    // The picture knows nothing of derivatives.
    same(&a, &run(&sc, 32, 5, Mode::Picture), 0..1);
    // A crop is a part of the whole.
    let crop = Job { crop: [2, 1, 6, 5], ..job(&sc, 32, 5, Mode::Forward(&p)) }.run(&|_| {}).unwrap();
    for layer in 0..1 + MOVING.len() {
        for y in 0..4 {
            for x in 0..4 {
                assert_eq!(crop.film.mean(layer, 4 * y + x), a.film.mean(layer, 8 * (y + 1) + x + 2));
            }
        }
    }
}

#[test]
fn split_terms_add_up() {
    CASES.iter().for_each(adds_up);
}

fn adds_up(&(text, moving, rooms): &Case) {
    let (desc, sc) = scene(text);
    let p = params(&desc, &sc, &moving);
    let o = Job { split: true, ..job(&sc, 64, 2, Mode::Forward(&p)) }.run(&|_| {}).unwrap();
    let (k, spec) = (moving.len(), o.film.spec());
    assert_eq!(spec.layers.len(), 1 + k * (2 + rooms.len()));
    assert_eq!(spec.layers[1 + k * 2], format!("d_{}.{}", moving[0], rooms[0]));
    for j in 0..k {
        for i in 0..spec.pixels() {
            let parts: Vec<Rgb> = (1..2 + rooms.len()).map(|t| o.film.mean(1 + t * k + j, i)).collect();
            let (sum, size) = parts.iter().fold((Rgb::ZERO, 0.0f64), |(s, m), x| (s + *x, m.max(x.abs().max())));
            assert!((sum - o.film.mean(1 + j, i)).abs().max() <= 1e-9 * size, "{} pixel {i}", moving[j]);
        }
    }
}

/// Negative control: each room adds what is far from nothing, so that without it the derivative is wrong; `light_shadow.rs` and `moving_surfaces.rs` show that
/// all of them together agree with finite differences. 10 s.e.
#[test]
fn no_room_can_be_left_out() {
    CASES.iter().for_each(is_far_from_nothing);
    assert!(ROOMS.iter().all(|r| CASES.iter().any(|c| c.2.contains(r))), "a room without a scene");
}

fn is_far_from_nothing(&(text, moving, rooms): &Case) {
    let (desc, sc) = scene(text);
    let p = params(&desc, &sc, &moving);
    for room in rooms {
        let o = Job { terms: terms(&[*room]), ..job(&sc, 2048, 2, Mode::Forward(&p)) }.run(&|_| {}).unwrap();
        let z = |k: usize| {
            let e = estimate(&o, k + 1);
            (0..3).map(|c| if e.error[c] > 0.0 { (e.value[c] / e.error[c]).abs() } else { 0.0 }).fold(0.0, f64::max)
        };
        let most = (0..moving.len()).map(z).fold(0.0, f64::max);
        assert!(most > 10.0, "{room}: {most} standard errors");
    }
}

#[test]
fn what_stands_still_prepares_nothing() {
    let names = |text: &str, wrt: &[&str]| -> Vec<&'static str> {
        let (desc, sc) = scene(text);
        let motion = Motion::new(&sc, &sc.sensors[0], &params(&desc, &sc, wrt)).unwrap();
        rooms(&sc, &sc.sensors[0], 0.5, &motion, EdgeForm::Outward, |_| true).iter().map(|r| r.name()).collect()
    };
    assert!(names(ROOM, &["sigma"]).is_empty());
    assert_eq!(names(ROOM, &["x"]), ["light_shadow"]);
    // A spot that turns about its place moves its cone; its shadows stay.
    assert_eq!(names(ROOM, &["turn"]), ["hard_profile"]);
    assert_eq!(names(ROOM, &["x", "cone"]), ["light_shadow", "hard_profile"]);
    assert!(names(VACUUM, &["radiance"]).is_empty());
    assert_eq!(names(VACUUM, &["ball"]), ["light_shadow", "pixel_edge", "surface_edge"]);
    assert!(names(FOG, &["radiance"]).is_empty());
    // The fog follows a hard spot that stands in it.
    assert_eq!(names(FOG, &["spot"]), ["light_shadow", "hard_profile", "surface_edge", "medium_edge"]);
    assert_eq!(names(FOG, &["ball"]), ["light_shadow", "hard_profile", "pixel_edge", "surface_edge", "medium_edge"]);
}

/// Scores grow like one over the room that a followed light has.
#[test]
fn a_hard_spot_that_moves_on_a_surface_is_refused() {
    let text = FOG.replace(r#"y="2.6" z="-0.9""#, r#"y="2.2" z="-0.2""#);
    assert_ne!(text, FOG);
    let refused = |text: &str, wrt: &str| {
        let (desc, sc) = scene(text);
        refusal(&desc, &sc, wrt)
    };
    assert!(refused(&text, "spot").is_some_and(|e| e.contains("hard edge") && e.contains("on a surface")));
    assert_eq!(refused(&text, "ball"), None);
    assert_eq!(refused(FOG, "spot"), None);
}

fn refusal(desc: &SceneDesc, sc: &Scene, wrt: &str) -> Option<String> {
    let p = params(desc, sc, &[wrt]);
    let motion = Motion::new(sc, &sc.sensors[0], &p).unwrap();
    motion.check(sc, &sc.sensors[0], &p, [0, 0, 1, 1], 0.0).err().map(|e| e.to_string())
}

/// What stands on something may slide on it and turn about its normal, with it or without it, but not leave it.
#[test]
fn bodies_that_part_are_refused() {
    let text = r#"<scene version="3.0.0"><default name="x" value="0"/><default name="up" value="0"/><default name="turn" value="0"/><default name="lean" value="0"/>
  <default name="floor" value="0"/><default name="wall" value="0"/><default name="ball" value="0.3"/><default name="lid" value="0"/><default name="all" value="0"/>
  <default name="flap" value="7"/><default name="can" value="0"/><default name="plank" value="0"/>
  <integrator type="volpath"/>
  <medium type="homogeneous" id="fog"><float name="sigma_t" value="1"/></medium>
  <sensor type="perspective"><transform name="to_world"><lookat origin="0, 1, 9" target="0, 0, 0" up="0, 1, 0"/></transform></sensor>
  <shape type="rectangle" id="floor"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="5"/><translate y="$floor"/><translate y="$all"/></transform><bsdf type="diffuse"/></shape>
  <shape type="cube" id="block"><transform name="to_world"><scale value="0.3"/><translate y="0.3"/><rotate y="1" angle="$turn"/><translate x="$x" y="$up"/><translate y="$all"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle" id="wall"><transform name="to_world"><translate y="1" z="-2"/><rotate x="1" angle="$lean"/><translate y="$wall"/></transform><bsdf type="diffuse"/></shape>
  <shape type="rectangle" id="flap"><transform name="to_world"><translate y="1"/><rotate x="1" angle="$flap"/><translate z="-4"/></transform><bsdf type="diffuse"/></shape>
  <shape type="cylinder" id="can"><point name="p0" x="3" y="$can" z="0"/><point name="p1" x="3" y="0.5" z="0"/><float name="radius" value="0.2"/><bsdf type="diffuse"/></shape>
  <shape type="cube" id="support"><transform name="to_world"><scale x="0.05" y="0.2" z="0.6"/><translate x="4" y="0.2" z="2"/></transform><bsdf type="diffuse"/></shape>
  <shape type="cube" id="plank"><transform name="to_world"><scale x="0.9" y="0.1" z="0.05"/><translate x="4" y="0.5" z="2"/><translate y="$plank"/></transform><bsdf type="diffuse"/></shape>
  <shape type="sphere" id="ball"><point name="center" value="2, $ball, 0"/><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>
  <shape type="cube" id="box"><transform name="to_world"><scale value="0.5"/><translate x="-3" y="1"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle" id="lid"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="0.4"/><translate x="-3" y="1.5"/><translate y="$lid"/></transform><bsdf type="diffuse"/></shape>
  <emitter type="constant"/></scene>"#;
    let refused = |wrt: &str| {
        let (desc, sc) = scene(text);
        refusal(&desc, &sc, wrt)
    };
    for (wrt, who) in [
        ("up", "`block` stands on `floor`"),
        ("floor", "stands on `"),
        ("wall", "`wall` stands on `floor`"),
        ("lean", "`wall` stands on `floor`"),
        ("lid", "`lid` stands on `box`"),
        ("can", "`can` stands on `floor`"),
        ("plank", "stands on `"),
    ] {
        assert!(refused(wrt).is_some_and(|e| e.contains(who)), "{wrt}: {:?}", refused(wrt));
    }
    // A flap that turns about its edge on the floor stays there.
    for wrt in ["x", "turn", "ball", "flap"] {
        assert_eq!(refused(wrt), None, "{wrt}");
    }
    // The floor and the block alone; all else is lifted off.
    let lifted = [
        (
            r#"<translate y="1" z="-2"/><rotate x="1" angle="$lean"/><translate y="$wall"/>"#,
            r#"<translate y="9" z="-2"/>"#,
        ),
        (r#"<translate z="-4"/>"#, r#"<translate y="5" z="-4"/>"#),
        (r#"<point name="p0" x="3" y="$can" z="0"/>"#, r#"<point name="p0" x="3" y="0.2" z="0"/>"#),
        (r#"<translate x="4" y="0.2" z="2"/>"#, r#"<translate x="4" y="0.25" z="2"/>"#),
    ];
    let one = lifted.iter().fold(text.to_string(), |t, (a, b)| t.replace(a, b));
    let (desc, sc) = scene(&one);
    assert_eq!(refusal(&desc, &sc, "all"), None);
}
