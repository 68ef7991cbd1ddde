//! The large grid that loading is measured with: a box of 900 x 490 x 700 voxels, some 24 million of them active, densities 0.002 to 1.6.
//!
//!     cargo run --release --example big_grid -- write big.vdb     (once)
//!     /usr/bin/time -v target/release/examples/big_grid load big.vdb
//!
//! `load` prints the seconds that reading took, the bytes of the bricks, and the process's peak of memory before and after.

use std::path::Path;
use std::time::Instant;
use tyndall::error::Span;
use tyndall::math::{DAffine3, DVec3};
use tyndall::medium::grid::Allowed;
use tyndall::native::vdb::{self, Leaf, Select, WriteGrid};
use tyndall::render::report::peak_memory_bytes;
use tyndall::scene::compile::LoadOptions;
use tyndall::scene::volumes::{Loading, VdbFile, load_vdb};

const BOX: [i32; 3] = [900, 490, 700];

/// A twisted plume, puffed up: thin at its border, dense in its folds.
fn density(p: [i32; 3]) -> f64 {
    let x = DVec3::from([0, 1, 2].map(|a| (f64::from(p[a]) + 0.5) / f64::from(BOX[a])));
    let turn = 9.0 * x.x + 1.5 * (5.0 * x.x).sin();
    let axis = DVec3::new(x.x, 0.5 + 0.22 * turn.sin(), 0.5 + 0.26 * turn.cos());
    let folds = (31.0 * x.x).sin() * (17.0 * x.y + 2.0 * x.z).sin() * (23.0 * x.z).sin();
    let radius = (0.055 + 0.1835 * x.x) * (1.0 + 0.3 * folds);
    let depth = 1.0 - x.distance(axis) / radius;
    if depth <= 0.0 { 0.0 } else { 1.6 * (depth * (1.2 + 0.8 * folds)).min(1.0) }
}

fn write(path: &Path) {
    let mut leaves = Vec::new();
    let mut active_voxels = 0u64;
    let blocks = BOX.map(|n| (n + 7) / 8);
    for b in 0..blocks[0] * blocks[1] * blocks[2] {
        let origin = [b / (blocks[1] * blocks[2]) * 8, b / blocks[2] % blocks[1] * 8, b % blocks[2] * 8];
        let (mut active, mut values) = ([0u64; 8], vec![0.0f32; 512]);
        for i in 0..512 {
            let p = [origin[0] + (i >> 6), origin[1] + (i >> 3 & 7), origin[2] + (i & 7)];
            let d = density(p);
            if (0..3).all(|a| p[a] < BOX[a]) && d >= 0.002 {
                active[i as usize >> 6] |= 1 << (i & 63);
                values[i as usize] = d as f32;
            }
        }
        let count: u32 = active.iter().map(|w| w.count_ones()).sum();
        active_voxels += u64::from(count);
        if count > 0 {
            leaves.push(Leaf { origin, active, values });
        }
    }
    println!("{active_voxels} active voxels in {} leaves", leaves.len());
    let grid = WriteGrid {
        name: "density".into(),
        channels: 1,
        world_from_index: DAffine3::from_scale(DVec3::splat(0.01)),
        background: 0.0,
        leaves,
        tiles: vec![],
        class: "fog volume".into(),
        half: false,
    };
    vdb::write(path, &[grid]).unwrap_or_else(|e| panic!("{e}"));
}

fn load(path: &Path) {
    let before = peak_memory_bytes().unwrap_or(0);
    let (span, options) = (Span::default(), LoadOptions::default());
    let how = Loading { to_world: DAffine3::IDENTITY, allowed: Allowed::NON_NEGATIVE, span: &span, options: &options };
    let file = VdbFile { path: path.to_owned(), select: Select::Name("density".into()), fog: false };
    let start = Instant::now();
    let grid = load_vdb(&file, how, &mut Vec::new()).unwrap_or_else(|e| panic!("{e}"));
    let seconds = start.elapsed().as_secs_f64();
    let (bricks, peak) = (grid.active_bytes() as u64, peak_memory_bytes().unwrap_or(0));
    println!(
        "{seconds:.2} s, bricks {:.1} MB, peak {:.1} MB = {:.2} x bricks (before loading {:.1} MB), densities to {}",
        bricks as f64 / 1e6,
        peak as f64 / 1e6,
        peak as f64 / bricks as f64,
        before as f64 / 1e6,
        grid.max()
    );
}

fn main() {
    let a: Vec<String> = std::env::args().skip(1).collect();
    match [a.first().map(String::as_str), a.get(1).map(String::as_str)] {
        [Some("write"), Some(path)] => write(Path::new(path)),
        [Some("load"), Some(path)] => load(Path::new(path)),
        _ => eprintln!("usage: big_grid write|load FILE.vdb"),
    }
}
