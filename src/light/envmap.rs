//! Environment maps: equirectangular radiance, importance-sampled by texel.
//!
//! Convention as Mitsuba's: the map's local frame has +y up; the column runs with the azimuth `atan2(x, -z)`.
//! Radiance is bilinear: column centres at (i + 1/2)/width and wrapping, rows at j/(height-1), the first and last row on the
//! poles, as Mitsuba has it. Sampling is constant per texel-sized cell with the mean of the 3x3 texels around it, so the
//! density is positive wherever the radiance is.

use crate::math::discrete::Discrete;
use crate::math::{DMat3, DVec3, Rgb};
use std::f64::consts::PI;

#[derive(Clone, Debug)]
pub struct Envmap {
    width: usize,
    height: usize,
    texels: Vec<[f32; 3]>,
    rows: Discrete,
    columns: Vec<Discrete>,
    /// World direction -> map's frame.
    local: DMat3,
    mean: f64,
}

/// Four texels, the upper ones first, and where between them.
struct Cell {
    texels: [[f32; 3]; 4],
    fx: f64,
    fy: f64,
}

impl Envmap {
    /// `texels` row-major, first row = zenith. `to_world` must be a rotation (scale and translation have no meaning).
    pub fn new(width: usize, height: usize, texels: Vec<[f32; 3]>, to_world: DMat3) -> Self {
        // A texel's cell touches the interpolant of its neighbours: weight by the 3x3 mean so no lit cell has density 0.
        let lum = |x: usize, y: usize| {
            let t = texels[y * width + x];
            Rgb(t.map(f64::from)).mean()
        };
        let mut columns = Vec::with_capacity(height);
        let mut row_weight = Vec::with_capacity(height);
        let (mut total, mut area) = (0.0, 0.0);
        for y in 0..height {
            let sin = (PI * (y as f64 + 0.5) / height as f64).sin();
            let weights: Vec<f64> = (0..width)
                .map(|x| {
                    let mut s = 0.0;
                    for dy in [y.saturating_sub(1), y, (y + 1).min(height - 1)] {
                        for dx in [(x + width - 1) % width, x, (x + 1) % width] {
                            s += lum(dx, dy);
                        }
                    }
                    s / 9.0 * sin
                })
                .collect();
            total += (0..width).map(|x| lum(x, y) * sin).sum::<f64>();
            area += sin * width as f64;
            let d = Discrete::new(weights);
            row_weight.push(d.total);
            columns.push(d);
        }
        Envmap {
            width,
            height,
            texels,
            rows: Discrete::new(row_weight),
            columns,
            local: to_world.inverse(),
            mean: total / area,
        }
    }

    /// The largest texel.
    pub fn brightest(&self) -> f64 {
        self.texels.iter().flatten().fold(0.0f64, |m, &x| m.max(f64::from(x)))
    }

    pub fn mean_luminance(&self) -> f64 {
        self.mean
    }

    /// Map coordinates in [0,1)^2 of a world direction toward the environment.
    fn uv(&self, w: DVec3) -> (f64, f64) {
        let d = self.local * w;
        let u = d.x.atan2(-d.z) / (2.0 * PI);
        let theta = (d.x * d.x + d.z * d.z).sqrt().atan2(d.y);
        (u - u.floor(), theta / PI)
    }

    /// World direction of map coordinates, and the sine of its angle to the map's axis.
    fn direction(&self, u: f64, v: f64) -> (DVec3, f64) {
        let (sp, cp) = (2.0 * PI * u).sin_cos();
        let (st, ct) = (PI * v).sin_cos();
        ((self.local.transpose() * DVec3::new(st * sp, ct, -st * cp)).normalize(), st)
    }

    /// Radiance from direction `w` (pointing toward the environment), before the scale, and where it `weighs` the density of `sample` there, else 0.
    pub fn look(&self, w: DVec3, weighs: bool) -> (Rgb, f64) {
        let (u, v) = self.uv(w);
        if !weighs {
            return (self.radiance(u, v), 0.0);
        }
        let y = ((v * self.height as f64) as usize).min(self.height - 1);
        let x = ((u * self.width as f64) as usize).min(self.width - 1);
        let p = self.rows.probability(y) * self.columns[y].probability(x);
        (self.radiance(u, v), self.per_solid_angle(p, (PI * v).sin()))
    }

    /// Density of a direction in a texel of probability `p`.
    fn per_solid_angle(&self, p: f64, sin: f64) -> f64 {
        if sin > 0.0 { p * (self.width * self.height) as f64 / (2.0 * PI * PI * sin) } else { 0.0 }
    }

    /// Radiance at map coordinates.
    fn radiance(&self, u: f64, v: f64) -> Rgb {
        let Cell { texels: [a, b, p, q], fx, fy } = self.cell(u, v);
        Rgb::from_fn(|c| {
            let [a, b, p, q] = [a[c], b[c], p[c], q[c]].map(f64::from);
            (1.0 - fy) * ((1.0 - fx) * a + fx * b) + fy * ((1.0 - fx) * p + fx * q)
        })
    }

    fn cell(&self, u: f64, v: f64) -> Cell {
        let (x, y) = (u * self.width as f64 - 0.5, v * (self.height as f64 - 1.0));
        // x >= -1/2 and y >= 0: integer parts without `floor`. Columns wrap.
        let (right, ya) = ((x + 1.0) as usize, y as usize);
        let (fx, fy) = (x + 1.0 - right as f64, y - ya as f64);
        let (xa, xb) = (if right == 0 { self.width } else { right } - 1, if right < self.width { right } else { 0 });
        let yb = (ya + 1).min(self.height - 1);
        let t = |x: usize, y: usize| self.texels[y * self.width + x];
        Cell { texels: [t(xa, ya), t(xb, ya), t(xa, yb), t(xb, yb)], fx, fy }
    }

    /// Gradient of the radiance by the components of w, per channel; 0 at the poles, where columns meet.
    pub fn slope(&self, w: DVec3) -> [DVec3; 3] {
        let d = self.local * w;
        let s2 = d.x * d.x + d.z * d.z;
        let s = s2.sqrt();
        if s == 0.0 {
            return [DVec3::ZERO; 3];
        }
        let by_u = DVec3::new(-d.z, 0.0, d.x) / (2.0 * PI * s2);
        let by_v = (DVec3::new(d.x, 0.0, d.z) * (d.y / s) - DVec3::Y * s) / (PI * (s2 + d.y * d.y));
        let (u, v) = self.uv(w);
        let cell = self.cell(u, v);
        let slope = |c: usize| {
            let [a, b, p, q] = cell.texels.map(|t| f64::from(t[c]));
            let along_u = (1.0 - cell.fy) * (b - a) + cell.fy * (q - p);
            let along_v = (1.0 - cell.fx) * (p - a) + cell.fx * (q - b);
            let local = by_u * (along_u * self.width as f64) + by_v * (along_v * (self.height as f64 - 1.0));
            self.local.transpose() * local
        };
        std::array::from_fn(slope)
    }

    /// Direction toward the environment, its density per solid angle, and the radiance from there.
    pub fn sample(&self, u: f64, v: f64) -> (DVec3, f64, Rgb) {
        let (y, py, fv) = self.rows.sample(v);
        let (x, px, fu) = self.columns[y].sample(u);
        let (u, v) = ((x as f64 + fu) / self.width as f64, (y as f64 + fv) / self.height as f64);
        let (w, sin) = self.direction(u, v);
        (w, self.per_solid_angle(py * px, sin), self.radiance(u, v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    #[test]
    fn sampling_matches_the_density_and_integrates_the_map() {
        let (w, h) = (16, 8);
        let texels: Vec<[f32; 3]> =
            (0..w * h).map(|i| [((i * 7919) % 13) as f32 + if i == 37 { 200.0 } else { 0.0 }; 3]).collect();
        let e = Envmap::new(w, h, texels, DMat3::from_rotation_x(0.7));
        let mut rng = Rng::keyed(1, 0, 0, 0);
        // E[L/p] over the sampler equals the integral by uniform directions (6 s.e.; false alarm 2e-9).
        let n = 200_000;
        let a: crate::math::stats::Moments = (0..n)
            .map(|_| {
                let (d, p, radiance) = e.sample(rng.uniform(), rng.uniform());
                assert!(p > 0.0);
                let (r, q) = e.look(d, true);
                assert!((r - radiance).max().abs() < 1e-9 && (p - q).abs() < 1e-9 * p);
                radiance[0] / p
            })
            .collect();
        let b: crate::math::stats::Moments = (0..n)
            .map(|_| e.look(crate::math::warp::sphere(rng.uniform(), rng.uniform()), false).0[0] * 4.0 * PI)
            .collect();
        assert!((a.mean - b.mean).abs() < 6.0 * a.standard_error().hypot(b.standard_error()), "{a:?} {b:?}");
        assert!(a.standard_error() < b.standard_error());
    }

    #[test]
    fn direction_and_uv_are_inverse() {
        let e = Envmap::new(4, 2, vec![[1.0; 3]; 8], DMat3::IDENTITY);
        for (u, v) in [(0.1, 0.2), (0.6, 0.9), (0.99, 0.5)] {
            let (a, b) = e.uv(e.direction(u, v).0);
            assert!((a - u).abs() < 1e-12 && (b - v).abs() < 1e-12);
        }
    }
}
