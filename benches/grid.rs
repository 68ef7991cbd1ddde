//! Rates of voxel fields: lookups, traversal, line integrals. `cargo bench --bench grid`

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use std::sync::LazyLock;
use tyndall::math::rng::Rng;
use tyndall::math::{DAffine3, DVec3};
use tyndall::medium::grid::{Grid, GridBuilder, GridSource};

fn main() {
    divan::main();
}

const SIZE: i32 = 256;

/// A thick shell: about a fifth of the 32^3 blocks have nodes.
fn shell(channels: usize) -> Grid {
    let turn = DAffine3::from_axis_angle(DVec3::new(0.6, 0.8, 0.0), 0.3) * DAffine3::from_scale(DVec3::splat(0.01));
    let source = GridSource { channels, world_from_index: turn, background: [0.0; 3], bbox: None, clip: None };
    let (mut builder, mut rng) = (GridBuilder::new(source), Rng::keyed(1, 0, 0, 0));
    for k in 0..(SIZE / 8).pow(3) {
        let origin = [k / 1024, k / 32 % 32, k % 32].map(|b| 8 * b);
        let r = (DVec3::from(origin.map(f64::from)) + 4.0 - 128.0).length();
        if (90.0..120.0).contains(&r) {
            let values: Vec<f32> = (0..512 * channels).map(|_| rng.uniform() as f32).collect();
            builder.leaf(origin, &values);
        }
    }
    builder.build().expect("a valid grid")
}

static SCALAR: LazyLock<Grid> = LazyLock::new(|| shell(1));
static COLOUR: LazyLock<Grid> = LazyLock::new(|| shell(3));

const N: usize = 1 << 17;

fn position(grid: &Grid, rng: &mut Rng) -> DVec3 {
    let u = DVec3::new(rng.uniform(), rng.uniform(), rng.uniform());
    grid.world_from_index().transform_point3(u * f64::from(SIZE))
}

fn points(grid: &Grid) -> Vec<DVec3> {
    let mut rng = Rng::keyed(2, 0, 0, 0);
    (0..N).map(|_| position(grid, &mut rng)).collect()
}

/// Rays between random points of the box, t in [0, 1].
fn rays(grid: &Grid) -> Vec<(DVec3, DVec3)> {
    let mut rng = Rng::keyed(3, 0, 0, 0);
    let mut ray = || {
        let (o, p) = (position(grid, &mut rng), position(grid, &mut rng));
        (o, p - o)
    };
    (0..N / 128).map(|_| ray()).collect()
}

/// A pencil of rays, as from a camera: what the cache holds.
fn pencil(grid: &Grid) -> Vec<(DVec3, DVec3)> {
    let ray = |k: usize| {
        let (o, p) = (DVec3::new(-20.0, 128.0, 128.0), DVec3::new(276.0, 100.0, 60.0));
        let p = p + 0.3 * DVec3::new(0.0, (k % 32) as f64, (k / 32) as f64);
        (grid.world_from_index().transform_point3(o), grid.world_from_index().transform_vector3(p - o))
    };
    (0..N / 128).map(ray).collect()
}

/// Cells that the rays cross in bricks that are not constant.
fn cells(grid: &Grid, rays: &[(DVec3, DVec3)]) -> usize {
    let linear = grid.index_from_world().matrix3;
    let length = |w: DVec3| (linear * w).abs().element_sum();
    let spans = rays
        .iter()
        .flat_map(|&(o, w)| grid.spans(o, w, 0.0, 1.0).filter(|s| !s.constant).map(move |s| length(w) * (s.t1 - s.t0)));
    spans.sum::<f64>() as usize
}

#[divan::bench]
fn lookup(bencher: Bencher) {
    let points = points(&SCALAR);
    bencher
        .counter(ItemsCount::new(N))
        .bench_local(|| points.iter().map(|p| SCALAR.lookup(black_box(*p))).sum::<f64>());
}

#[divan::bench]
fn lookup_colour(bencher: Bencher) {
    let points = points(&COLOUR);
    let sum = |a: [f64; 3], b: [f64; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    bencher
        .counter(ItemsCount::new(N))
        .bench_local(|| points.iter().map(|p| COLOUR.lookup3(black_box(*p))).fold([0.0; 3], sum));
}

#[divan::bench]
fn gradient(bencher: Bencher) {
    let points = points(&SCALAR);
    bencher
        .counter(ItemsCount::new(N))
        .bench_local(|| points.iter().map(|p| SCALAR.gradient(black_box(*p))).sum::<DVec3>());
}

/// Items: spans.
#[divan::bench]
fn spans(bencher: Bencher) {
    let rays = rays(&SCALAR);
    let count: usize = rays.iter().map(|&(o, w)| SCALAR.spans(o, w, 0.0, 1.0).count()).sum();
    bencher.counter(ItemsCount::new(count)).bench_local(|| {
        rays.iter().map(|&(o, w)| SCALAR.spans(o, w, 0.0, 1.0).map(|s| s.max * (s.t1 - s.t0)).sum::<f64>()).sum::<f64>()
    });
}

/// Items: cells.
#[divan::bench]
fn integrate(bencher: Bencher) {
    let rays = rays(&SCALAR);
    bencher
        .counter(ItemsCount::new(cells(&SCALAR, &rays)))
        .bench_local(|| rays.iter().map(|&(o, w)| SCALAR.integrate(o, w, 0.0, 1.0)).sum::<f64>());
}

/// Items: cells.
#[divan::bench]
fn integrate_pencil(bencher: Bencher) {
    let rays = pencil(&SCALAR);
    bencher
        .counter(ItemsCount::new(cells(&SCALAR, &rays)))
        .bench_local(|| rays.iter().map(|&(o, w)| SCALAR.integrate(o, w, 0.0, 1.0)).sum::<f64>());
}

/// Items: cells.
#[divan::bench]
fn integrate_colour(bencher: Bencher) {
    let rays = rays(&COLOUR);
    bencher
        .counter(ItemsCount::new(cells(&COLOUR, &rays)))
        .bench_local(|| rays.iter().map(|&(o, w)| COLOUR.integrate3(o, w, 0.0, 1.0)[1]).sum::<f64>());
}

/// Items: cells.
#[divan::bench]
fn integrate_nodes(bencher: Bencher) {
    let rays = rays(&SCALAR);
    let mut slots = vec![0.0; SCALAR.node_count()];
    bencher.counter(ItemsCount::new(cells(&SCALAR, &rays))).bench_local(|| {
        for &(o, w) in &rays {
            SCALAR.integrate_nodes(o, w, 0.0, 1.0, &mut |id, x| slots[id.0 as usize] += x);
        }
    });
}

/// Items: rays, each stopped half way.
#[divan::bench]
fn invert(bencher: Bencher) {
    let rays: Vec<_> = rays(&SCALAR).into_iter().map(|(o, w)| (o, w, SCALAR.integrate(o, w, 0.0, 1.0))).collect();
    bencher.counter(ItemsCount::new(rays.len())).bench_local(|| {
        rays.iter().map(|&(o, w, i)| SCALAR.invert(o, w, 0.0, 1.0, 0.5 * i).unwrap_or(0.0)).sum::<f64>()
    });
}

/// Gathering all bricks from slots, as every step of an optimiser does. Items: slots.
#[divan::bench(sample_count = 5)]
fn with_values(bencher: Bencher) {
    let values = SCALAR.values();
    bencher.counter(ItemsCount::new(values.len())).bench_local(|| SCALAR.with_values(&values));
}
