//! Where a medium glows: the power that it emits, block by block, as a density for drawing points.
//!
//! A lattice over the box of one of its grids; a block's weight is the mean of `σ_a L_e` ([T] (2)) over some points of it. It need be no bound: what
//! connections miss, or find rarely, walks find (`transport::glow`), so that blocks of weight 0 are no error either.

use super::{Medium, Volume};
use crate::math::discrete::Discrete;
use crate::math::{DAffine3, DVec3};
use rayon::prelude::*;

/// Blocks of a lattice at most.
const BLOCKS: usize = 1 << 18;

/// Points a block along each axis; two where it is one cell, whose middle may be a node of the grid.
const POINTS: usize = 3;

/// The blocks of one medium.
#[derive(Clone, Debug)]
pub struct Blocks {
    /// The lattice's box as the image of the unit cube.
    place: DAffine3,
    inverse: DAffine3,
    count: [usize; 3],
    table: Discrete,
    /// Of the whole box, length³.
    volume: f64,
    /// `Σ w` and `Σ w²` over blocks, each times its volume.
    sums: [f64; 2],
    center: DVec3,
}

impl Blocks {
    /// `None` where no grid says where it glows, or nothing does.
    pub fn new(m: &Medium) -> Option<Blocks> {
        let e = m.emission.as_ref()?;
        let grid = [&e.volume, &m.density, &m.albedo].into_iter().find_map(|v| match v {
            Volume::Grid(g) => Some(g),
            Volume::Constant(_) => None,
        })?;
        let (place, cells) = grid.unit_box()?;
        let mut size = 1;
        let blocks = |size: usize| cells.map(|n| n.div_ceil(size));
        while blocks(size).iter().product::<usize>() > BLOCKS {
            size += 1;
        }
        let (count, points) = (blocks(size), (size + 1).min(POINTS));
        let volume = place.matrix3.determinant().abs();
        let extent = DVec3::from(count.map(|n| n as f64));
        let value = |block: [usize; 3]| -> f64 {
            let mut sum = 0.0;
            for k in 0..points.pow(3) {
                let at = [k / (points * points), k / points % points, k % points];
                let q: [f64; 3] = std::array::from_fn(|a| block[a] as f64 + (at[a] as f64 + 0.5) / points as f64);
                let p = place.transform_point3(DVec3::from(q) / extent);
                let (sigma_t, sigma_s) = m.coefficients(p);
                let sigma_a = sigma_t - sigma_s;
                // What it would emit is asked for where there is something.
                sum += if sigma_a.is_zero() { 0.0 } else { (sigma_a * e.at(p)).mean() };
            }
            sum / points.pow(3) as f64
        };
        let [_, ny, nz] = count;
        let n: usize = count.iter().product();
        let weights: Vec<f64> = (0..n).into_par_iter().map(|i| value([i / (ny * nz), i / nz % ny, i % nz])).collect();
        let share = volume / n as f64;
        let sums = [1, 2].map(|k| weights.iter().map(|w| w.powi(k)).sum::<f64>() * share);
        let shines = volume > 0.0 && sums.iter().all(|s| *s > 0.0 && s.is_finite());
        let middle = |i: usize| DVec3::new((i / (ny * nz)) as f64, (i / nz % ny) as f64, (i % nz) as f64) + 0.5;
        let mean = weights.iter().enumerate().fold(DVec3::ZERO, |c, (i, &w)| c + middle(i) * w) * (share / sums[0]);
        let center = place.transform_point3(mean / extent);
        shines.then(|| Blocks {
            place,
            inverse: place.inverse(),
            count,
            table: Discrete::new(weights),
            volume,
            sums,
            center,
        })
    }

    /// What leaves it, all around: power in the units of radiance x area.
    pub fn power(&self) -> f64 {
        4.0 * std::f64::consts::PI * self.sums[0]
    }

    /// The volume that would shine as much, and as unevenly, if it were all that shines: `(∫w)² / ∫w²`.
    pub fn volume(&self) -> f64 {
        self.sums[0] * self.sums[0] / self.sums[1]
    }

    /// The mean of where it glows.
    pub fn center(&self) -> DVec3 {
        self.center
    }

    /// A point with the density [`Blocks::density`].
    pub fn sample(&self, u: f64, rest: [f64; 3]) -> DVec3 {
        let (i, _, _) = self.table.sample(u);
        let [_, ny, nz] = self.count;
        let block = [i / (ny * nz), i / nz % ny, i % nz];
        let q: [f64; 3] = std::array::from_fn(|a| (block[a] as f64 + rest[a]) / self.count[a] as f64);
        self.place.transform_point3(DVec3::from(q))
    }

    /// Per volume.
    pub fn density(&self, p: DVec3) -> f64 {
        let q = self.inverse.transform_point3(p) * DVec3::from(self.count.map(|n| n as f64));
        let inside = q.cmpge(DVec3::ZERO).all() && q.cmplt(DVec3::from(self.count.map(|n| n as f64))).all();
        if !inside {
            return 0.0;
        }
        let [_, ny, nz] = self.count;
        let i = (q.x as usize * ny + q.y as usize) * nz + q.z as usize;
        self.table.probability(i) * self.table.len() as f64 / self.volume
    }
}
