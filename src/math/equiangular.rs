//! Distances along a ray by the angle that they subtend at a point beside it: density `h / (angle (h^2 + (t - t_c)^2))` [T] 5.5.

use super::DVec3;
use std::f64::consts::FRAC_PI_2;

/// The distribution over abscissae in [t0, t1] of a ray; t1 may be infinite.
#[derive(Clone, Copy, Debug)]
pub struct EquiAngular {
    /// Abscissa of the closest approach, distance there.
    t_closest: f64,
    h: f64,
    /// Angle subtended by the interval.
    range: f64,
    t0: f64,
    t1: f64,
}

impl EquiAngular {
    /// `w` unit, t0 <= t1.
    pub fn new(point: DVec3, o: DVec3, w: DVec3, t0: f64, t1: f64) -> Self {
        let d = point - o;
        let t_closest = d.dot(w);
        let h = (d - w * t_closest).length();
        let a = t0 - t_closest;
        let range = if t1 == f64::INFINITY {
            FRAC_PI_2 - a.atan2(h)
        } else {
            // Difference of the two angles without cancelling.
            let b = t1 - t_closest;
            ((t1 - t0) * h).atan2(h * h + a * b)
        };
        EquiAngular { t_closest, h, range, t0, t1 }
    }

    /// Distance of the point from the line.
    pub fn h(&self) -> f64 {
        self.h
    }

    /// Per length; for t in [t0, t1].
    pub fn density(&self, t: f64) -> f64 {
        let d = t - self.t_closest;
        self.h / (self.range * (self.h * self.h + d * d))
    }

    /// The quantile at `u` in [0,1).
    pub fn sample(&self, u: f64) -> f64 {
        let start = (self.t0 - self.t_closest).atan2(self.h);
        (self.t_closest + self.h * (start + u * self.range).tan()).clamp(self.t0, self.t1)
    }

    /// Not on the line, and not empty.
    pub fn usable(&self) -> bool {
        self.h > 0.0 && self.range > 0.0
    }
}
