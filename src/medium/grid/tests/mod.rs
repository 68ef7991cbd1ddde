//! Bricks against a direct evaluation that knows nothing of bricks.

use super::*;
use crate::math::rng::Rng;
use crate::math::{DMat3, DVec3};
use std::collections::HashMap;

mod active;
mod field;
mod fine;
mod line;

/// Nodes by position, and the plain trilinear formula.
struct Direct {
    channels: usize,
    background: [f32; 3],
    nodes: HashMap<[i32; 3], [f32; 3]>,
}

impl Direct {
    fn node(&self, p: [i32; 3]) -> [f64; 3] {
        self.nodes.get(&p).unwrap_or(&self.background).map(f64::from)
    }

    fn at(&self, p: DVec3) -> [f64; 3] {
        let i = p.floor();
        let f = p - i;
        let mut sum = [0.0; 3];
        for k in 0..8 {
            let bit = |a: usize| (k >> (2 - a) & 1) as f64;
            let w: f64 = (0..3).map(|a| if bit(a) == 1.0 { f[a] } else { 1.0 - f[a] }).product();
            let v = self.node([0, 1, 2].map(|a| (i[a] + bit(a)) as i32));
            for c in 0..3 {
                sum[c] += w * v[c];
            }
        }
        sum
    }
}

fn random(rng: &mut Rng, a: f64, b: f64) -> f64 {
    a + (b - a) * rng.uniform()
}

fn point(rng: &mut Rng, a: f64, b: f64) -> DVec3 {
    DVec3::new(random(rng, a, b), random(rng, a, b), random(rng, a, b))
}

fn direction(rng: &mut Rng) -> DVec3 {
    loop {
        let v = point(rng, -1.0, 1.0);
        if v.length() > 0.1 && v.length() < 1.0 {
            return v;
        }
    }
}

fn transform() -> DAffine3 {
    let turn = DMat3::from_axis_angle(DVec3::new(1.0, -2.0, 0.5).normalize(), 0.7);
    let stretch = DMat3::from_diagonal(DVec3::new(0.3, 1.7, -0.9));
    DAffine3 { matrix3: turn * stretch, translation: DVec3::new(3.0, -20.0, 11.0) }
}

/// Random leaves and tiles around the origin, negative positions included.
fn sparse(seed: u64, channels: usize, background: f32, world_from_index: DAffine3) -> (Grid, Direct, GridBuilder) {
    let mut rng = Rng::keyed(seed, 7, 0, 0);
    let background = [background, if channels == 1 { background } else { 2.0 * background }, background];
    let source = GridSource { channels, world_from_index, background, bbox: None, clip: None };
    let (mut builder, mut nodes) = (GridBuilder::new(source), HashMap::new());
    for x in -2..3 {
        for y in -2..2 {
            for z in -3..1 {
                let (origin, u) = ([8 * x, 8 * y, 8 * z], rng.uniform());
                let value: Vec<f32> = (0..512 * channels).map(|_| rng.uniform() as f32).collect();
                let at = |l: i32| [origin[0] + (l >> 6), origin[1] + (l >> 3 & 7), origin[2] + (l & 7)];
                let triple = |l: usize| [0, 1, 2].map(|c| value[l * channels + c.min(channels - 1)]);
                if u < 0.4 {
                    builder.leaf(origin, &value);
                    nodes.extend((0..512).map(|l| (at(l as i32), triple(l))));
                } else if u < 0.7 {
                    builder.tile(origin, 8, triple(0));
                    nodes.extend((0..512).map(|l| (at(l), triple(0))));
                }
            }
        }
    }
    // A large tile beside them, in which whole bricks are constant, with a leaf cut into it.
    builder.tile([24, -16, -16], 32, [0.25; 3]);
    let all = 0..32;
    for p in all.clone().flat_map(|x| all.clone().flat_map(move |y| (0..32).map(move |z| [24 + x, y - 16, z - 16]))) {
        nodes.insert(p, [0.25; 3]);
    }
    builder.leaf([32, -8, -8], &vec![0.75; 512 * channels]);
    for l in 0..512 {
        nodes.insert([32 + (l >> 6), -8 + (l >> 3 & 7), -8 + (l & 7)], [0.75; 3]);
    }
    (builder.clone().build().unwrap(), Direct { channels, background, nodes }, builder)
}

fn one_voxel(value: f32, rest: f32) -> Grid {
    let n = 24;
    let mut values = vec![rest; n * n * n];
    values[(12 * n + 12) * n + 12] = value;
    Grid::from_dense(1, [n; 3], &values, DAffine3::from_scale(DVec3::splat(n as f64)), Filter::Trilinear).unwrap()
}
