//! Gradients with respect to every voxel of a medium's grids: against the derivatives of scalars (the same samples), against finite differences of pictures with a
//! voxel changed in the file, and against closed forms where the medium is empty.

use crate::common::{job, params as scalars, run, scene};
use tempfile::TempDir;
use tyndall::math::{DAffine3, DMat3, DVec3, Rgb, rng::Rng, stats::Moments};
use tyndall::native::vdb::{self, Leaf, Tile, WriteGrid};
use tyndall::params::{Array, ParamSet};
use tyndall::render::driver::Mode;
use tyndall::render::plan::Plan;
use tyndall::scene::{Scene, SceneDesc};

/// Voxels along an edge of the box, which is two units wide; the first lies here, so that leaves meet within.
const N: i32 = 5;
const LOW: i32 = 6;
const H: f64 = 2.0 / N as f64;

/// Values by voxel, channels interleaved; those outside of the box are not active.
type Values<'a> = &'a dyn Fn([i32; 3]) -> [f32; 3];

fn place(origin: [i32; 3], i: usize) -> [i32; 3] {
    let i = i as i32;
    [origin[0] + (i >> 6), origin[1] + (i >> 3 & 7), origin[2] + (i & 7)]
}

/// N^3 voxels in eight leaves, in the box [-1, 1]^3 (centres of voxels half an edge inside).
fn grid(name: &str, channels: usize, values: Values) -> WriteGrid {
    let corners = [0, 8];
    let origins = corners.iter().flat_map(|&x| corners.iter().flat_map(move |&y| corners.map(|z| [x, y, z])));
    let leaf = |origin: [i32; 3]| {
        let inside = |i: usize| place(origin, i).iter().all(|&x| (LOW..LOW + N).contains(&x));
        let mut active = [0; 8];
        (0..512).filter(|&i| inside(i)).for_each(|i| active[i >> 6] |= 1u64 << (i & 63));
        let value = |i: usize| if inside(i) { values(place(origin, i)) } else { [0.0; 3] };
        Leaf { origin, active, values: (0..512).flat_map(|i| value(i).into_iter().take(channels)).collect() }
    };
    WriteGrid {
        name: name.into(),
        channels,
        world_from_index: DAffine3 {
            matrix3: DMat3::from_diagonal(DVec3::splat(H)),
            translation: DVec3::splat(-1.0 + (0.5 - f64::from(LOW)) * H),
        },
        background: 0.0,
        leaves: origins.map(leaf).collect(),
        tiles: Vec::new(),
        class: "fog volume".into(),
        half: false,
    }
}

fn noise(p: [i32; 3], seed: u64) -> f32 {
    Rng::keyed(seed, p[0] as u64, p[1] as u64, p[2] as u64).uniform() as f32
}

/// A cloud with holes: a third of its voxels are 0.
fn cloud(p: [i32; 3]) -> [f32; 3] {
    let v = noise(p, 1);
    [if v < 0.33 { 0.0 } else { 2.0 * v }; 3]
}

fn colors(p: [i32; 3]) -> [f32; 3] {
    [noise(p, 2), noise(p, 3), 0.5 * noise(p, 4)]
}

const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="0.3, -1, -0.4"/><rgb name="irradiance" value="3, 2.5, 2"/></emitter>"#;
const SKY: &str = r#"<emitter type="constant"><rgb name="radiance" value="0.3, 0.4, 0.6"/></emitter>"#;

/// The box with what `volumes` says, over a floor, seen from the front.
fn room(volumes: &str, depth: i32, lights: &str) -> String {
    format!(
        r#"<scene version="3.0.0">
  <default name="scale" value="1.5"/><default name="g" value="0.4"/><default name="tint" value="0.5"/>
  <integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>
  <medium type="heterogeneous" id="smoke">{volumes}<float name="scale" value="$scale"/>
    <phase type="hg"><float name="g" value="$g"/></phase></medium>
  <shape type="cube"><transform name="to_world"><scale value="1.3"/></transform><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  <shape type="rectangle"><transform name="to_world"><scale value="3"/><rotate x="1" angle="-90"/><translate y="-1.5"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="$tint"/></bsdf></shape>
  <sensor type="perspective"><float name="fov" value="40"/>
    <transform name="to_world"><lookat origin="0.4, 0.7, 5" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="5"/><rfilter type="box"/></film></sensor>
  {lights}
</scene>"#
    )
}

const DENSITY: &str = r#"<volume type="openvdb" name="sigma_t"><string name="filename" value="v.vdb"/><string name="grid_name" value="density"/></volume>"#;
const ALBEDO: &str = r#"<volume type="openvdb" name="albedo"><string name="filename" value="v.vdb"/><string name="grid_name" value="albedo"/></volume>"#;
const GLOW: &str = r#"<volume type="openvdb" name="emission"><string name="filename" value="v.vdb"/><string name="grid_name" value="glow"/></volume>"#;

const ALL: [&str; 3] = ["smoke.sigma_t.grid", "smoke.albedo.grid", "smoke.emission.grid"];

/// A scene with these grids in its file, which lives as long as the folder.
fn scene_of(text: &str, grids: &[WriteGrid]) -> (SceneDesc, Scene, TempDir) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("v.vdb");
    vdb::write(&path, grids).unwrap();
    let (desc, sc) = scene(&text.replace("v.vdb", path.to_str().unwrap()));
    (desc, sc, dir)
}

/// Ready for a gradient; what `grad` would refuse is refused here too.
fn open(desc: &SceneDesc, sc: &mut Scene, wrt: &[&str]) -> ParamSet {
    let names: Vec<String> = wrt.iter().map(|s| s.to_string()).collect();
    Plan::new(desc, &names).and_then(|p| p.refuse()).unwrap_or_else(|e| panic!("{e}"));
    sc.open(desc, &names).unwrap_or_else(|e| panic!("{e}"));
    sc.param_set(desc, &names).unwrap()
}

/// Weights of the pixels: a loss is the sum of them times the picture.
fn adjoint(pixels: usize) -> Vec<Rgb> {
    let mut rng = Rng::keyed(9, 0, 0, 0);
    (0..pixels).map(|_| Rgb::from_fn(|_| (rng.uniform() - 0.2) / 30.0)).collect()
}

/// Over slots, and its standard errors.
fn gradient(sc: &Scene, params: &ParamSet, v: &[Rgb], spp: u64, seed: u64) -> (Vec<f64>, Vec<f64>) {
    let o = job(sc, spp, seed, Mode::Reverse(params, v)).run(&|_| {}).unwrap();
    assert_eq!(o.film.health.biasing(), 0, "{:?}", o.film.health.entries().collect::<Vec<_>>());
    o.gradient.unwrap()
}

/// Values of an array's voxels in its own order, read off a grid that is written with their numbers.
fn by_place(desc: &SceneDesc, sc: &Scene, array: &Array, numbers: &[f64]) -> Vec<([i32; 3], Vec<f64>)> {
    let g = sc.in_grid(desc, array, numbers).unwrap().unwrap();
    let channels = g.channels;
    let of = |l: &Leaf| -> Vec<([i32; 3], Vec<f64>)> {
        let on = (0..512).filter(|&i| l.is_active(i));
        on.map(|i| (place(l.origin, i), l.values[i * channels..][..channels].iter().map(|&x| f64::from(x)).collect()))
            .collect()
    };
    g.leaves.iter().flat_map(of).collect()
}

/// The same, by slot: `values[k]` for the k-th slot of an array.
fn raw(desc: &SceneDesc, sc: &Scene, array: &Array, values: Values) -> Vec<f64> {
    let count = array.range().len();
    let indices: Vec<f64> = (0..count).map(|k| k as f64).collect();
    let mut out = vec![0.0; count];
    for (p, k) in by_place(desc, sc, array, &indices) {
        k.iter().zip(values(p)).for_each(|(&k, v)| out[k as usize] = f64::from(v));
    }
    out
}

fn grids(channels: usize) -> Vec<WriteGrid> {
    vec![grid("density", channels, &cloud_in(channels)), grid("albedo", 3, &colors), grid("glow", 3, &colors)]
}

/// Of three channels: not the same.
fn cloud_in(channels: usize) -> impl Fn([i32; 3]) -> [f32; 3] {
    move |p| if channels == 1 { cloud(p) } else { [cloud(p)[0], 0.5 * cloud(p)[1], 1.5 * noise(p, 6)] }
}

/// Σ over voxels of gradient x density is the derivative by the logarithm of the density's scale, from the same samples; and forward mode has it too.
#[test]
fn scale_is_the_sum_over_voxels() {
    for (channels, depth) in [(1, 2), (1, -1), (3, 4)] {
        let text = room(&[DENSITY, ALBEDO, GLOW].concat(), depth, &[SUN, SKY].concat());
        let (desc, mut sc, _dir) = scene_of(&text, &grids(channels));
        let (still_desc, still, _other) = scene_of(&text, &grids(channels));
        let params = open(&desc, &mut sc, &["smoke.sigma_t.grid", "scale", "g", "tint"]);
        assert_eq!(params.arrays[0].shape, [(N * N * N) as usize, channels]);
        let v = adjoint(30);
        let (g, _) = gradient(&sc, &params, &v, 64, 3);
        let range = params.arrays[0].range();
        let values = raw(&desc, &sc, &params.arrays[0], &cloud_in(channels));
        let products = g[range].iter().zip(&values).map(|(g, v)| g * v);
        let (sum, size) = products.fold((0.0, 0.0), |(s, a): (f64, f64), x| (s + x, a + x.abs()));
        let named = params.pull_back(&g);
        assert!((sum - 1.5 * named[0]).abs() <= 1e-9 * size, "{channels} {depth}: {sum} {}", 1.5 * named[0]);
        assert!(sum.abs() > 1e-3 * size && named.iter().all(|x| *x != 0.0), "{named:?}");

        let own = scalars(&still_desc, &still, &["scale", "g", "tint"]);
        let o = run(&still, 64, 3, Mode::Forward(&own));
        let dot: f64 = (0..30).map(|i| o.film.mean(1, i).dot(v[i])).sum();
        assert!((sum - 1.5 * dot).abs() <= 1e-9 * size, "{channels} {depth}: {sum}, forward {}", 1.5 * dot);
    }
}

const NAMES: [&str; 3] = ["density", "albedo", "glow"];

/// The loss of the scene with other values in its file; with the same random numbers for the same seed.
fn loss(text: &str, values: &dyn Fn(usize, [i32; 3]) -> [f32; 3], spp: u64, seed: u64) -> f64 {
    let file: Vec<WriteGrid> = (0..3).map(|k| grid(NAMES[k], if k == 0 { 1 } else { 3 }, &|p| values(k, p))).collect();
    let (_, sc, _dir) = scene_of(text, &file);
    let o = run(&sc, spp, 100 + seed, Mode::Picture);
    (0..30).map(|i| o.film.mean(0, i).dot(adjoint(30)[i])).sum()
}

fn value(k: usize, p: [i32; 3]) -> [f32; 3] {
    if k == 0 { cloud(p) } else { colors(p) }
}

/// 20 random voxels of all three grids, holes among them, against differences of pictures in which one number of the file changes: 4.5 standard errors. Once
/// scattered: there pictures of the same random numbers are smooth in the voxels, and differences know something.
#[test]
fn voxels_agree_with_differences() {
    let text = room(&[DENSITY, ALBEDO, GLOW].concat(), 2, &[SUN, SKY].concat());
    let (a, b) = (text.find(r#"<shape type="rectangle""#).unwrap(), text.find("<sensor").unwrap());
    let text = format!("{}{}", &text[..a], &text[b..]).replace(r#"<default name="tint" value="0.5"/>"#, "");
    let (desc, mut sc, _dir) = scene_of(&text, &grids(1));
    let params = open(&desc, &mut sc, &ALL);
    let (g, e) = gradient(&sc, &params, &adjoint(30), 1 << 14, 3);
    let mut rng = Rng::keyed(77, 0, 0, 0);
    let (mut holes, mut sharp) = (0, 0);
    for k in 0..20 {
        let which = k % 3;
        let mut draw = || [0; 3].map(|_| LOW + (rng.uniform() * f64::from(N)) as i32);
        let mut voxel = draw();
        while k % 6 == 0 && cloud(voxel)[0] > 0.0 {
            voxel = draw();
        }
        let channel = if which == 0 { 0 } else { (rng.uniform() * 3.0) as usize };
        let now = value(which, voxel)[channel];
        // Values stay in their range; of an empty voxel there is one side only, and second order comes from half the step.
        let step: f32 = if which == 1 { 0.5 * now.min(1.0 - now) } else { 0.4 };
        holes += usize::from(now == 0.0);
        let at = |h: f32, seed: u64| {
            let changed = |k: usize, p: [i32; 3]| {
                let mut x = value(k, p);
                if (k, p) == (which, voxel) {
                    x[channel] += h;
                }
                x
            };
            loss(&text, &changed, 256, seed)
        };
        let fd: Moments = (0..8)
            .map(|seed| {
                let (up, h) = (at(step, seed), f64::from(step));
                if now >= step {
                    (up - at(-step, seed)) / (2.0 * h)
                } else {
                    (4.0 * at(0.5 * step, seed) - up - 3.0 * at(0.0, seed)) / h
                }
            })
            .collect();
        let a = &params.arrays[which];
        let numbers: Vec<f64> = (0..a.range().len()).map(|k| k as f64).collect();
        let found = by_place(&desc, &sc, a, &numbers).into_iter().find(|x| x.0 == voxel).unwrap().1;
        let slot = a.range().start + found[channel] as usize;
        let error = e[slot].hypot(fd.standard_error());
        println!(
            "{} {voxel:?} {channel}: {:.3e} +- {:.1e}, fd {:.3e} +- {:.1e}",
            NAMES[which],
            g[slot],
            e[slot],
            fd.mean,
            fd.standard_error()
        );
        assert!((g[slot] - fd.mean).abs() <= 4.5 * error, "{} {voxel:?} {channel}", NAMES[which]);
        sharp += usize::from(fd.mean.abs() > 4.0 * error);
    }
    assert!(holes >= 4 && sharp >= 8, "{holes} {sharp}");
}

/// All voxels of one grid changed at once, each by a number of its own, in light that scatters often.
#[test]
fn directions_agree_with_differences() {
    let text = room(&[DENSITY, ALBEDO, GLOW].concat(), 6, &[SUN, SKY].concat());
    let (desc, mut sc, _dir) = scene_of(&text, &grids(1));
    let params = open(&desc, &mut sc, &ALL);
    // Up or down by as much as values allow, along rows: what cancels from voxel to voxel says little.
    let direction = |k: usize, p: [i32; 3], c: usize| {
        let x = value(k, p)[c];
        let sign = if noise([p[0], 0, 0], 50 + c as u64) < 0.5 { -1.0 } else { 1.0 };
        let room = if k == 1 { x.min(1.0 - x) } else { x };
        sign * room
    };
    for (which, step) in [(0, 0.3f32), (1, 0.5), (2, 0.5)] {
        let at = |h: f32, seed: u64| {
            let changed = |k: usize, p: [i32; 3]| {
                let x = value(k, p);
                if k == which { [0, 1, 2].map(|c| x[c] + h * direction(k, p, if k == 0 { 0 } else { c })) } else { x }
            };
            loss(&text, &changed, 1 << 10, seed)
        };
        let fd: Moments = (0..8).map(|seed| (at(step, seed) - at(-step, seed)) / f64::from(2.0 * step)).collect();
        let a = &params.arrays[which];
        let along = raw(&desc, &sc, a, &|p| [0, 1, 2].map(|c| direction(which, p, c)));
        let own: Moments = (0..8)
            .map(|seed| {
                let (g, _) = gradient(&sc, &params, &adjoint(30), 1 << 9, 200 + seed);
                g[a.range()].iter().zip(&along).map(|(g, d)| g * d).sum::<f64>()
            })
            .collect();
        let error = own.standard_error().hypot(fd.standard_error());
        println!(
            "{}: {:.4e} +- {:.1e}, fd {:.4e} +- {:.1e}",
            NAMES[which],
            own.mean,
            own.standard_error(),
            fd.mean,
            fd.standard_error()
        );
        // Eight values each: Student's tails are those of 6 s.e.
        assert!((own.mean - fd.mean).abs() <= 6.0 * error + 0.02 * fd.mean.abs(), "{}", NAMES[which]);
        assert!(error < 0.1 * fd.mean.abs(), "{}: {error} of {}", NAMES[which], fd.mean);
    }
}

/// An orthographic camera that sees all of the box along z, under a sky of 1.
fn scanner(volumes: &str, albedo: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><integrator type="volpath"/><default name="scale" value="1.5"/>
  <medium type="heterogeneous" id="smoke">{volumes}{albedo}<float name="scale" value="$scale"/></medium>
  <shape type="cube"><transform name="to_world"><scale value="1.3"/></transform><bsdf type="null"/><ref name="interior" id="smoke"/></shape>
  <sensor type="orthographic"><transform name="to_world"><scale x="1.5" y="1.5"/><lookat origin="0, 0, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="6"/><rfilter type="box"/></film></sensor>
  <emitter type="constant"><rgb name="radiance" value="1, 1, 1"/></emitter></scene>"#
    )
}

/// An empty grid under a uniform sky E = 1: `dL/dσ = ∫ w (α E + (1-α) L_e - E) ds` for a voxel of weight w, whose volume all rays together see. Chromatic.
#[test]
fn empty_voxels_know_the_answer() {
    let albedo = [0.9, 0.5, 0.0];
    let glow = [0.0f32, 0.7, 3.0];
    let volumes = [DENSITY, GLOW].concat();
    let constant = format!(r#"<rgb name="albedo" value="{}, {}, {}"/>"#, albedo[0], albedo[1], albedo[2]);
    let file = [grid("density", 1, &|_| [0.0; 3]), grid("glow", 3, &|_| glow)];
    let (desc, mut sc, _dir) = scene_of(&scanner(&volumes, &constant), &file);
    let params = open(&desc, &mut sc, &["smoke.sigma_t.grid", "smoke.emission.grid"]);
    for c in 0..3 {
        let v = vec![Rgb::channel(c, 1.0); 36];
        let (g, e) = gradient(&sc, &params, &v, 1 << 13, 3);
        // Scale x volume of the voxel over the area of a pixel; Around the box's outermost voxels L_e falls off to the background.
        let weight = 1.5 * H.powi(3) / 0.25;
        let mut worst = 0.0f64;
        let own = params.arrays[0].range();
        let mut mean = Moments::default();
        let numbers: Vec<f64> = own.clone().map(|s| (s - own.start) as f64).collect();
        for (p, at) in by_place(&desc, &sc, &params.arrays[0], &numbers) {
            let slot = own.start + at[0] as usize;
            if p.iter().any(|&x| x == LOW || x == LOW + N - 1) {
                continue;
            }
            let truth = weight * (albedo[c] + (1.0 - albedo[c]) * f64::from(glow[c]) - 1.0);
            assert!(truth == 0.0 || e[slot] < 0.8 * truth.abs(), "{c}: {truth} +- {}", e[slot]);
            worst = worst.max((g[slot] - truth).abs() / e[slot].max(1e-12));
            mean.push(g[slot] - truth);
        }
        println!(
            "channel {c}: worst z {worst:.2}, mean miss {:.2e} +- {:.1e} of {weight}",
            mean.mean,
            mean.standard_error()
        );
        assert!(worst < 5.0, "channel {c}: {worst}");
        assert!(mean.mean.abs() <= 4.5 * mean.standard_error() + 1e-12, "channel {c}");
        // What absorbs nothing emits nothing.
        assert!(params.arrays[1].range().all(|s| g[s] == 0.0));
    }
}

/// Medium and sky emit 1: every picture is 1, and no voxel changes it, whatever density and albedo: 0 and 1 among them.
#[test]
fn nothing_changes_an_isothermal_enclosure() {
    let extremes = |p: [i32; 3]| [0, 1, 2].map(|c| ((p[0] + p[1] + p[2] + c) % 2) as f32);
    for (channels, albedo) in
        [(1, &(|_: [i32; 3]| [0.0f32; 3]) as Values), (1, &|_: [i32; 3]| [1.0f32; 3]), (1, &extremes), (3, &extremes)]
    {
        let file = [grid("density", channels, &cloud_in(channels)), grid("albedo", 3, albedo)];
        let volumes = [DENSITY, ALBEDO, r#"<rgb name="emission" value="1"/>"#].concat();
        // Thin enough that light comes from its far side.
        let text = scanner(&volumes, "").replace(r#"name="scale" value="1.5""#, r#"name="scale" value="0.5""#);
        let (desc, mut sc, _dir) = scene_of(&text, &file);
        let params = open(&desc, &mut sc, &[ALL[0], ALL[1], "scale"]);
        let (g, e) = gradient(&sc, &params, &vec![Rgb::splat(1.0); 36], 1 << 11, 3);
        for a in &params.arrays {
            assert!(a.range().all(|s| g[s].is_finite() && e[s].is_finite()));
            let seen = a.range().filter(|&s| e[s] > 0.0).count();
            assert!(seen > a.range().len() * 9 / 10, "{}: {seen} of {}", a.name, a.range().len());
            let z = a.range().map(|s| g[s].abs() / e[s].max(1e-12)).fold(0.0f64, f64::max);
            println!("{channels} {}: largest z {z:.2} of {}", a.name, a.range().len());
            // Of 3000 numbers, some of which few paths make.
            assert!(z < 6.0, "{}: {z}", a.name);
        }
        let scale = params.pull_back(&g)[0] / params.pull_back(&e)[0];
        assert!(scale.abs() < 4.5, "{scale}");
    }
}

/// The room with a grid of emission or temperature, whose numbers are parameters.
fn glowing(quantity: &str, depth: i32, lights: &str) -> String {
    let numbers = ["emission_scale", "temperature_scale", "temperature_offset"].map(|n| {
        let own = n == "emission_scale" || quantity == "temperature";
        if own { format!(r#"<float name="{n}" value="${n}"/>"#) } else { String::new() }
    });
    let volumes = [DENSITY, ALBEDO, &GLOW.replace(r#"name="emission""#, &format!(r#"name="{quantity}""#))].concat();
    let defaults = if quantity == "temperature" {
        r#"<default name="emission_scale" value="0.002"/><default name="temperature_scale" value="1500"/><default name="temperature_offset" value="0.2"/><default name="g" "#
    } else {
        r#"<default name="emission_scale" value="0.7"/><default name="g" "#
    };
    room(&[volumes, numbers.concat()].concat(), depth, lights).replace(r#"<default name="g" "#, defaults)
}

/// `Σ L_k dL/dL_k = e dL/de` of emission grids, e being `emission_scale`, from the same samples.
#[test]
fn emission_scale_is_the_sum_over_voxels() {
    for channels in [1, 3] {
        let text = glowing("emission", 4, &[SUN, SKY].concat());
        let mut file = grids(1);
        file[2] = grid("glow", channels, &colors);
        let (desc, mut sc, _dir) = scene_of(&text, &file);
        let params = open(&desc, &mut sc, &[ALL[2], "emission_scale"]);
        assert_eq!(params.arrays[0].shape, [(N * N * N) as usize, channels]);
        let (g, _) = gradient(&sc, &params, &adjoint(30), 64, 3);
        let values = raw(&desc, &sc, &params.arrays[0], &colors);
        let products = g[params.arrays[0].range()].iter().zip(&values).map(|(g, v)| g * v);
        let (sum, size) = products.fold((0.0, 0.0), |(s, a): (f64, f64), x| (s + x, a + x.abs()));
        let by_scale = 0.7 * params.pull_back(&g)[0];
        assert!(sum.abs() > 1e-3 * size && (sum - by_scale).abs() <= 1e-9 * size, "{channels}: {sum} {by_scale}");
    }
}

fn temperatures(p: [i32; 3]) -> [f32; 3] {
    [1.0 + 0.6 * noise(p, 8); 3]
}

/// Temperatures by voxel: `Σ T_k dL/dT_k = f dL/df - o dL/do` (scale f, offset o) from the same samples; and differences of pictures of the same random numbers.
#[test]
fn voxels_of_temperature() {
    let name = "smoke.temperature.grid";
    let file = |changed: Values| vec![grid("density", 1, &cloud), grid("albedo", 3, &colors), grid("glow", 1, changed)];
    let text = glowing("temperature", 3, "");
    let (desc, mut sc, _dir) = scene_of(&text, &file(&temperatures));
    // Connections go where it is bright: without them temperatures change no path.
    sc.bright = Default::default();
    let params = open(&desc, &mut sc, &[name, "temperature_scale", "temperature_offset"]);
    let v = adjoint(30);
    let (g, _) = gradient(&sc, &params, &v, 128, 3);
    let array = &params.arrays[0];
    let values = raw(&desc, &sc, array, &temperatures);
    let products = g[array.range()].iter().zip(&values).map(|(g, v)| g * v);
    let (sum, size) = products.fold((0.0, 0.0), |(s, a): (f64, f64), x| (s + x, a + x.abs()));
    let named = params.pull_back(&g);
    let other = 1500.0 * named[0] - 0.2 * named[1];
    assert!(sum.abs() > 1e-3 * size && (sum - other).abs() <= 1e-9 * size, "{sum} {other}");

    // Differences from the same samples are as exact as their step is small.
    let at = |voxel: [i32; 3], h: f32| {
        let changed = |p: [i32; 3]| if p == voxel { temperatures(p).map(|t| t + h) } else { temperatures(p) };
        let (desc, mut sc, _dir) = scene_of(&text, &file(&changed));
        sc.bright = Default::default();
        let params = open(&desc, &mut sc, &[name]);
        let o = job(&sc, 128, 3, Mode::Reverse(&params, &v)).run(&|_| {}).unwrap();
        (0..30).map(|i| o.film.mean(0, i).dot(v[i])).sum::<f64>()
    };
    let numbers: Vec<f64> = (0..array.range().len()).map(|k| k as f64).collect();
    let places = by_place(&desc, &sc, array, &numbers);
    let mut seen = 0;
    for k in [3, 31, 62, 80, 117] {
        let (voxel, slot) = &places[k];
        let own = g[array.range().start + slot[0] as usize];
        let (h, fd) = (0.01f32, at(*voxel, 0.01) - at(*voxel, -0.01));
        let fd = fd / f64::from(2.0 * h);
        println!("{voxel:?}: {own:.5e}, fd {fd:.5e}");
        assert!((own - fd).abs() <= 2e-3 * own.abs() + 1e-9 * size, "{voxel:?}: {own} {fd}");
        seen += usize::from(own.abs() > 1e-4 * size);
    }
    assert!(seen >= 3, "{seen}");

    // The other name is refused, with the right one.
    let e = sc.open(&desc, &[ALL[2].to_string()]).unwrap_err().to_string();
    assert!(e.contains("`smoke` has no emission, but a grid of temperature"), "{e}");
}

/// Albedo 0 and 1 by voxel, everywhere: from the same samples, the sum over voxels is the derivative by a constant albedo.
#[test]
fn albedo_at_its_ends() {
    let constant = r#"<rgb name="albedo" value="$a"/>"#;
    let text = room(&[DENSITY, constant].concat(), 4, &[SUN, SKY].concat());
    let v = adjoint(30);
    for end in [0.0, 1.0] {
        let text =
            text.replace(r#"<default name="g" "#, &format!(r#"<default name="a" value="{end}"/><default name="g" "#));
        let (still_desc, still, _a) = scene_of(&text, &grids(1));
        let own = scalars(&still_desc, &still, &["a"]);
        let o = run(&still, 256, 3, Mode::Forward(&own));
        let forward: f64 = (0..30).map(|i| o.film.mean(1, i).dot(v[i])).sum();

        let mut albedo = grid("albedo", 3, &colors);
        for l in &mut albedo.leaves {
            (l.active, l.values) = ([u64::MAX; 8], vec![end as f32; 3 * 512]);
        }
        let text = text.replace(constant, ALBEDO).replace(&format!(r#"<default name="a" value="{end}"/>"#), "");
        let (desc, mut sc, _b) = scene_of(&text, &[grid("density", 1, &cloud), albedo]);
        let params = open(&desc, &mut sc, &["smoke.albedo.grid"]);
        let (g, e) = gradient(&sc, &params, &v, 256, 3);
        assert!(g.iter().chain(&e).all(|x| x.is_finite()));
        let own = || params.arrays[0].range().map(|s| g[s]);
        let (sum, size) = (own().sum::<f64>(), own().map(f64::abs).sum::<f64>());
        assert!((sum - forward).abs() <= 1e-9 * size && sum.abs() > 0.01 * size, "albedo {end}: {sum} {forward}");
    }
}

/// The numbers are of active voxels: those in holes and tiles among them, none of others; a tile is one number.
#[test]
fn a_tile_is_one_number() {
    let file = |tile: bool| {
        let mut g = grid("density", 1, &cloud);
        g.leaves.retain(|l| l.origin != [0; 3]);
        if tile {
            g.tiles.push(Tile { origin: [0; 3], size: 8, value: [0.7, 0.0, 0.0], active: true });
        } else {
            g.leaves.push(Leaf { origin: [0; 3], active: [u64::MAX; 8], values: vec![0.7; 512] });
        }
        vec![g]
    };
    let text = room(&[DENSITY, r#"<rgb name="albedo" value="0.8, 0.6, 0.4"/>"#].concat(), 3, &[SUN, SKY].concat());
    let v = adjoint(30);
    let of = |tile: bool| {
        let (desc, mut sc, _dir) = scene_of(&text, &file(tile));
        let params = open(&desc, &mut sc, &["smoke.sigma_t.grid", "scale"]);
        let (g, _) = gradient(&sc, &params, &v, 256, 3);
        let own = g[params.arrays[0].range()].to_vec();
        let written = sc.in_grid(&desc, &params.arrays[0], &own).unwrap().unwrap();
        (own, written, params.pull_back(&g)[0])
    };
    let (tile, leaf) = (of(true), of(false));
    assert_eq!((tile.0.len(), leaf.0.len()), (117 + 1, 117 + 512));
    // The same field, the same samples: the tile's number is the sum over its voxels.
    assert!((tile.2 - leaf.2).abs() < 1e-9 * leaf.2.abs());
    let block = leaf.1.leaves.iter().find(|l| l.origin == [0; 3]).unwrap();
    let (sum, size) = block.values.iter().fold((0.0, 0.0), |(s, a), &x| (s + f64::from(x), a + f64::from(x).abs()));
    let one = f64::from(tile.1.tiles[0].value[0]);
    assert!((one - sum).abs() < 1e-5 * size && size > 0.0, "{one} {sum}");
}

#[test]
fn threads_change_no_bit() {
    let text = room(&[DENSITY, ALBEDO, GLOW].concat(), 6, &[SUN, SKY].concat());
    // Several tiles of the picture.
    let text = text
        .replace(r#"name="width" value="6""#, r#"name="width" value="30""#)
        .replace(r#"name="height" value="5""#, r#"name="height" value="25""#);
    let (desc, mut sc, _dir) = scene_of(&text, &grids(1));
    let params = open(&desc, &mut sc, &[ALL[0], ALL[1], ALL[2], "g"]);
    let v = adjoint(750);
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| gradient(&sc, &params, &v, 32, 3))
    };
    let (one, two) = (with(1), with(2));
    assert!(params.arrays.iter().all(|a| a.range().any(|s| one.0[s] != 0.0)));
    assert_eq!(one, two);
}

/// Without voxels of its own an empty neighbour has no number; dilated it has one, and the others stay as they are.
#[test]
fn dilated_voxels_are_more_voxels() {
    let text = room(&[DENSITY, r#"<rgb name="albedo" value="0.8"/>"#].concat(), 2, SUN);
    let v = adjoint(30);
    let of = |wide: bool| {
        let (desc, mut sc, _dir) = scene_of(&text, &[grid("density", 1, &cloud)]);
        if wide {
            sc.dilate(&desc, &["smoke.sigma_t.grid".to_string()]).unwrap();
        }
        let params = open(&desc, &mut sc, &["smoke.sigma_t.grid"]);
        let (g, e) = gradient(&sc, &params, &v, 1 << 11, 3);
        let at = |n: &[f64]| -> std::collections::BTreeMap<[i32; 3], f64> {
            let own = &n[params.arrays[0].range()];
            by_place(&desc, &sc, &params.arrays[0], own).into_iter().map(|(p, x)| (p, x[0])).collect()
        };
        (at(&g), at(&e))
    };
    let ((narrow, e), (wide, f)) = (of(false), of(true));
    assert_eq!((narrow.len(), wide.len()), (125, 343));
    let z = narrow.keys().map(|p| (narrow[p] - wide[p]).abs() / e[p].hypot(f[p]).max(1e-12)).fold(0.0f64, f64::max);
    assert!(z < 5.0, "{z}");
    assert!(wide.iter().filter(|(p, x)| !narrow.contains_key(*p) && **x != 0.0).count() > 150);
}
