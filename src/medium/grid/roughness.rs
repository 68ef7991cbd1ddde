//! How rough a field is: what a point that moves through it has to expect.

use super::Grid;
use super::traverse::Ray;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, warp};

/// Lines on which it is measured.
const LINES: u64 = 512;

impl Grid {
    /// `∫ |∇f| / ∫ f` (channel 0, not negative, world space, 1/length): the mean size of `∇f / f` where f weighs; 0 where there is nothing.
    /// Estimated from the same lines every time, through points of its box: points of theirs are drawn by f, lines weigh what they hold (so points count by f and by the mean length of lines through them).
    pub fn roughness(&self) -> f64 {
        let Some((place, _)) = self.unit_box() else { return 0.0 };
        let (mut slopes, mut whole) = (0.0, 0.0);
        for k in 0..LINES {
            let mut rng = Rng::keyed(0, Purpose::Pilot as u64, k, 0);
            let mut u = || rng.uniform();
            let (o, w) = (place.transform_point3(DVec3::new(u(), u(), u())), warp::sphere(u(), u()));
            let (lo, hi) = Ray::new(self, o, w).clip(self.lo, self.hi, f64::NEG_INFINITY, f64::INFINITY);
            if lo >= hi {
                continue;
            }
            let held = self.integrate(o, w, lo, hi);
            if held > 0.0 && held.is_finite() {
                let t = self.invert(o, w, lo, hi, u() * held).unwrap_or(hi);
                let p = o + w * t;
                let f = self.lookup(p);
                if f > 0.0 {
                    slopes += held * self.gradient(p).length() / f;
                }
                whole += held;
            }
        }
        if whole > 0.0 { slopes / whole } else { 0.0 }
    }
}
