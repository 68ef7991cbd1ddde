//! Forward and reverse are transposes of each other, and neither changes the picture.

use crate::common::{against_differences, job, params, run, scene};
use tyndall::inverse::loss::Loss;
use tyndall::math::Rgb;
use tyndall::math::rng::Rng;
use tyndall::render::driver::{Job, Mode};

/// Chromatic fog over a floor and a ball, four kinds of light.
const ROOM: &str = r#"<scene version="3.0.0">
  <default name="sr" value="0.5"/><default name="sg" value="0.9"/><default name="albedo" value="0.8"/>
  <default name="g" value="0.5"/><default name="scale" value="1.1"/><default name="rho" value="0.6"/>
  <default name="i" value="3"/><default name="le" value="2"/><default name="e" value="0.4"/><default name="sky" value="0.2"/>
  <default name="spot" value="5"/>
  <integrator type="volpath"><integer name="max_depth" value="8"/></integrator>
  <sensor type="perspective"><float name="fov" value="50"/>
    <transform name="to_world"><lookat origin="0, 1, 5" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="8"/><integer name="height" value="6"/><rfilter type="tent"/></film></sensor>
  <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="$sr, $sg, 0.3"/><float name="albedo" value="$albedo"/>
    <float name="scale" value="$scale"/><phase type="hg"><float name="g" value="$g"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale value="2"/><translate y="1.5"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="6"/><translate y="-0.5"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="$rho, 0.5, 0.2"/></bsdf></shape>
  <shape type="sphere"><float name="radius" value="0.4"/><point name="center" x="0.5" y="0.5" z="0"/>
    <bsdf type="diffuse"><rgb name="reflectance" value="0, $rho, 0.7"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.5"/><translate x="-1" y="3" z="0.3"/></transform>
    <emitter type="area"><rgb name="radiance" value="$le"/></emitter></shape>
  <emitter type="point"><point name="position" x="-0.8" y="1.4" z="0.5"/><rgb name="intensity" value="$i"/></emitter>
  <emitter type="spot"><transform name="to_world"><lookat origin="1, 3, 1" target="0.3, 0.5, 0" up="0, 0, 1"/></transform>
    <rgb name="intensity" value="$spot"/></emitter>
  <emitter type="directional"><vector name="direction" x="0.3" y="-1" z="0.1"/><rgb name="irradiance" value="$e"/></emitter>
  <emitter type="constant"><rgb name="radiance" value="$sky"/></emitter>
</scene>"#;

const ALL: [&str; 11] = ["sr", "sg", "albedo", "g", "scale", "rho", "i", "le", "e", "sky", "spot"];

#[test]
fn forward_dot_v_equals_reverse() {
    let (desc, scene) = scene(ROOM);
    let p = params(&desc, &scene, &ALL);
    let spp = 64;
    let f = run(&scene, spp, 3, Mode::Forward(&p));
    let pixels = f.film.spec().pixels();
    let mut rng = Rng::keyed(9, 0, 0, 0);
    let v: Vec<Rgb> = (0..pixels).map(|_| Rgb::from_fn(|_| rng.uniform() - 0.3)).collect();
    let r = run(&scene, spp, 3, Mode::Reverse(&p, &v));
    let gradient = p.pull_back(&r.gradient.unwrap().0);
    for (k, name) in ALL.iter().enumerate() {
        let dot: f64 = (0..pixels).map(|i| f.film.mean(k + 1, i).dot(v[i])).sum();
        let scale: f64 = (0..pixels).map(|i| (f.film.mean(k + 1, i) * v[i]).abs().sum()).sum();
        assert!(scale > 0.0, "{name}: nothing to compare");
        assert!((dot - gradient[k]).abs() <= 1e-10 * scale, "{name}: {dot} {} of {scale}", gradient[k]);
    }
}

#[test]
fn derivatives_do_not_change_the_picture() {
    let (desc, scene) = scene(ROOM);
    let p = params(&desc, &scene, &ALL);
    let (a, b) = (run(&scene, 32, 5, Mode::Picture), run(&scene, 32, 5, Mode::Forward(&p)));
    for i in 0..a.film.spec().pixels() {
        assert_eq!(a.film.mean(0, i), b.film.mean(0, i));
        assert_eq!(a.film.variance_of_mean(0, i), b.film.variance_of_mean(0, i));
    }
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let (desc, scene) = scene(ROOM);
    let p = params(&desc, &scene, &ALL);
    let v = vec![Rgb::ONE; 48];
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| (run(&scene, 32, 5, Mode::Forward(&p)), run(&scene, 32, 5, Mode::Reverse(&p, &v))))
    };
    let (a, ra) = with(1);
    for threads in [2, 8] {
        let (b, rb) = with(threads);
        for layer in 0..=ALL.len() {
            for i in 0..48 {
                assert_eq!(a.film.mean(layer, i), b.film.mean(layer, i));
            }
        }
        assert_eq!(ra.gradient, rb.gradient);
    }
}

/// Every derivative against central differences, steps of a tenth of the value.
#[test]
fn derivatives_agree_with_finite_differences() {
    let (desc, _) = scene(ROOM);
    let value = |name: &str| desc.params.iter().find(|q| q.name == name).unwrap().value;
    let wrt = ALL.map(|name| (name, 0.1 * value(name)));
    against_differences(ROOM, &wrt, &["all"], 512, 0.01);
}

/// Objects without ids, all on one line: their slots must not be mixed up.
#[test]
fn anonymous_objects_have_slots_of_their_own() {
    let ball = |x: &str, rho: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" value="{x}, 0, 0"/><bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf></shape>"#
        )
    };
    let (desc, sc) = scene(&format!(
        r#"<scene version="3.0.0"><default name="a" value="0.3"/><default name="b" value="0.6"/><integrator type="volpath"/><sensor type="perspective"/>{}{}</scene>"#,
        ball("-2", "$a"),
        ball("2", "$b")
    ));
    let slots: Vec<u32> = sc
        .surfaces
        .iter()
        .filter_map(|s| match s {
            tyndall::surface::Surface::Diffuse { slot, .. } => Some(*slot),
            _ => None,
        })
        .collect();
    assert_ne!(slots[0], slots[1]);
    let p = params(&desc, &sc, &["a", "b"]);
    assert_eq!((p.tangents(slots[0]), p.tangents(slots[1])), (&[1.0, 0.0][..], &[0.0, 1.0][..]));
}

/// Errors of a loss's gradient hold the noise of the picture that the loss is of: the spread over seeds, where that noise is all there is (the target is what is rendered), and where it is a part.
#[test]
fn errors_of_a_losss_gradient() {
    let (desc, sc) = scene(ROOM);
    let p = params(&desc, &sc, &["g", "scale"]);
    let slot =
        |k: usize| (0..sc.slots.scalars).find(|&s| p.tangents(s as u32).get(k).is_some_and(|t| *t != 0.0)).unwrap();
    let truth = run(&sc, 1 << 12, 77, Mode::Picture).film;
    let pixels = truth.spec().pixels();
    for (share, loss) in [(1.0, Loss::L2), (0.5, Loss::L2), (1.0, Loss::L1)] {
        let target: Vec<Rgb> = (0..pixels).map(|i| truth.mean(0, i) * share).collect();
        let seeds = 60;
        let (mut values, mut squares, mut bare) = ([(); 2].map(|()| Vec::new()), [0.0; 2], [0.0; 2]);
        for seed in 0..seeds {
            let e = loss.evaluate(&run(&sc, 32, 2 * seed, Mode::Picture).film, &target).unwrap();
            let job = || job(&sc, 32, 2 * seed + 1, Mode::Reverse(&p, &e.adjoint));
            let [own, without] =
                [&e.noise[..], &[]].map(|noise| Job { noise, ..job() }.run(&|_| {}).unwrap().gradient.unwrap());
            assert_eq!(own.0, without.0);
            for k in 0..2 {
                values[k].push(own.0[slot(k)]);
                squares[k] += own.1[slot(k)].powi(2) / seeds as f64;
                bare[k] += without.1[slot(k)].powi(2) / seeds as f64;
            }
        }
        for k in 0..2 {
            let mean = values[k].iter().sum::<f64>() / seeds as f64;
            let spread = values[k].iter().map(|x| (x - mean).powi(2)).sum::<f64>() / (seeds - 1) as f64;
            let [all, part] = [squares[k], bare[k]].map(|x| x / spread);
            println!("{share} {loss:?} {k}: {all} {part}");
            // Five standard errors of a variance of 60 values.
            assert!((all - 1.0).abs() < 5.0 * (2.0 / 59.0f64).sqrt(), "{share} {loss:?} {k}: {all}");
            // Without the picture's noise it would be this part.
            let least = if loss == Loss::L1 { 1.2 } else { 2.0 };
            assert!(share < 1.0 || all > least * part, "{share} {loss:?} {k}: {all} {part}");
        }
    }
}
