//! Transmittance by residual ratio tracking ([T] 8.1) where the field is smooth, by its exact integral where it is not.
//!
//! Over a piece of the ray where the field f lies within `c ± r`, the mean of `Π (1 - (f(t_i) - c) / r)` over Poisson points t_i of rate `scale r` is
//! `exp(-scale ∫ (f - c))`. Their number is about the part of the optical depth that varies within the piece, whatever the size of the voxels; they
//! add a third of it to the relative variance of the transmittance. So a piece is a node of the pyramid, as large as it may be for [`RESIDUAL`].

use super::traverse::Ray;
use super::{Grid, SpanIter};
use crate::math::DVec3;
use crate::math::rng::Apart;

/// Residual optical depth `scale r` a cell for which a brick's cells are not summed up one by one. What that takes (5 ns a cell) is weighed against
/// the variance of what a connection carries (relative, a third of the depth) for what one takes (1 µs); measured in benches/RESULTS.md.
const RESIDUAL: f64 = 0.004;

impl Grid {
    /// Estimate of `exp(-scale ∫ f)` over t in [t0, t1] along `o + t w`, per channel (a scalar grid in each). Unbiased and not negative;
    /// exact with three channels. `random` is begun only where it is needed.
    pub fn transmittance(&self, o: DVec3, w: DVec3, t0: f64, t1: f64, scale: f64, random: &mut Apart) -> [f64; 3] {
        if self.channels() == 3 {
            return self.integrate3(o, w, t0, t1).map(|x| (-scale * x).exp());
        }
        let ray = Ray::new(self, o, w);
        let limit = RESIDUAL / scale * ray.d.iter().map(|d| d.abs()).sum::<f64>();
        // Below a node are half as many steps as below the nodes that it has, and less to be saved.
        let whole = |level: usize, [min, max]: [f32; 2]| f64::from(max - min) * ((1u64 << level) as f64) <= 2.0 * limit;
        let (mut sum, mut factor) = ([0.0], 1.0);
        // Residual depth up to the next point.
        let mut left = None;
        for span in SpanIter::new(self, ray, t0, t1, true, whole) {
            let r = 0.5 * (span.max - span.min);
            if span.constant || !span.large && r > limit {
                self.add_span::<1, 1>(&ray, &span, &mut sum);
                continue;
            }
            let (c, rate) = (0.5 * (span.max + span.min), scale * r);
            sum[0] += c * (span.t1 - span.t0);
            let left = left.get_or_insert_with(|| random.rng().exponential());
            let mut t = span.t0;
            while *left < rate * (span.t1 - t) {
                t += *left / rate;
                // Rounding may look it up beyond the node.
                factor *= 1.0 - (self.lookup(o + w * t).clamp(span.min, span.max) - c) / r;
                *left = random.rng().exponential();
            }
            *left -= rate * (span.t1 - t);
        }
        [(-scale * sum[0]).exp() * factor; 3]
    }
}
