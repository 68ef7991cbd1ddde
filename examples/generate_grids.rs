//! Makes the grids of scenes/tomography and scenes/cloud, from formulas alone.
//!
//!     cargo run --example generate_grids

use tyndall::math::{DAffine3, DVec3};
use tyndall::native::vdb::{self, Leaf, WriteGrid};

/// A grid of half floats over a box of voxels, its first one at the origin, edges of `voxel`. `whole`: all voxels of the box are active, empty ones too.
fn grid(size: [i32; 3], voxel: f64, whole: bool, density: impl Fn(DVec3) -> f64) -> WriteGrid {
    let blocks = size.map(|n| (n + 7) / 8);
    let mut leaves = Vec::new();
    for b in 0..blocks[0] * blocks[1] * blocks[2] {
        let origin = [b / (blocks[1] * blocks[2]) * 8, b / blocks[2] % blocks[1] * 8, b % blocks[2] * 8];
        let (mut active, mut values) = ([0u64; 8], vec![0.0f32; 512]);
        for i in 0..512 {
            let p = [origin[0] + (i >> 6), origin[1] + (i >> 3 & 7), origin[2] + (i & 7)];
            // Position in the box, -1..1.
            let at = DVec3::from([0, 1, 2].map(|a| 2.0 * f64::from(p[a]) / f64::from(size[a] - 1) - 1.0));
            let d = density(at);
            if (0..3).all(|a| p[a] < size[a]) && (whole || d > 0.0) {
                active[i as usize >> 6] |= 1 << (i & 63);
                values[i as usize] = d as f32;
            }
        }
        if active != [0; 8] {
            leaves.push(Leaf { origin, active, values });
        }
    }
    WriteGrid {
        name: "density".into(),
        channels: 1,
        world_from_index: DAffine3::from_scale(DVec3::splat(voxel)),
        background: 0.0,
        leaves,
        tiles: vec![],
        class: "fog volume".into(),
        half: true,
    }
}

/// 1 in the middle, 0 from 1 on, smooth.
fn bump(r: f64) -> f64 {
    let x = (1.0 - r * r).max(0.0);
    x * x
}

/// Puffs along a rising spiral, the higher the wider and thinner, with folds.
fn smoke(p: DVec3) -> f64 {
    let puffs = (0..13).map(|k| {
        let t = f64::from(k) / 12.0;
        let (angle, out) = (5.5 * t + 0.4, 0.08 + 0.3 * t);
        let centre = DVec3::new(out * angle.cos(), -0.82 + 1.55 * t, out * angle.sin());
        (1.0 - 0.55 * t) * bump((p - centre).length() / (0.2 + 0.26 * t))
    });
    let folds = (9.0 * p.x + 2.0 * p.y).sin() * (8.0 * p.z - 3.0 * p.y).sin() * (7.0 * p.y + 4.0 * p.x).cos();
    (7.0 * puffs.sum::<f64>() * (1.0 + 0.6 * folds)).max(0.0)
}

/// A heap of round tops over a flat base.
fn cloud(p: DVec3) -> f64 {
    const TOPS: [([f64; 3], f64); 7] = [
        ([0.0, -0.1, 0.0], 0.62),
        ([-0.45, -0.3, 0.1], 0.42),
        ([0.48, -0.3, -0.1], 0.4),
        ([0.1, 0.3, 0.15], 0.4),
        ([-0.2, 0.15, -0.3], 0.38),
        ([0.25, -0.3, 0.45], 0.36),
        ([-0.15, -0.35, 0.5], 0.32),
    ];
    let waves = |f: f64| (f * p.x + 1.3).sin() * (f * p.y * 0.9 + 0.4).sin() * (f * p.z * 1.1 + 2.0).sin();
    let rough = 0.5 * waves(9.0) + 0.3 * waves(19.0);
    let depth = TOPS.iter().map(|(c, r)| 1.0 - (p - DVec3::from(*c)).length() / r).fold(f64::NEG_INFINITY, f64::max);
    let base = ((p.y + 0.6) / 0.15).clamp(0.0, 1.0);
    (2.5 * (depth + 0.35 * rough)).clamp(0.0, 1.0) * base
}

fn main() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let write = |name: &str, grid: WriteGrid| {
        let path = folder.join(name);
        vdb::write(&path, &[grid]).unwrap_or_else(|e| panic!("{e}"));
        println!("{}: {} bytes", path.display(), std::fs::metadata(&path).map_or(0, |m| m.len()));
    };
    // What the fit is to find must not be told by the topology: the whole box is active.
    write("tomography/smoke.vdb", grid([40, 48, 40], 0.05, true, smoke));
    write("cloud/cloud.vdb", grid([64, 48, 64], 0.03125, false, cloud));
}
