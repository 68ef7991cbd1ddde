//! Axis-aligned boxes in world space.

use crate::math::DVec3;

/// `min <= max` in every component, or empty (`min = +inf`, `max = -inf`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    pub min: DVec3,
    pub max: DVec3,
}

impl Bounds {
    pub const EMPTY: Bounds = Bounds { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    pub fn new(min: DVec3, max: DVec3) -> Self {
        Bounds { min, max }
    }

    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    #[must_use]
    pub fn union(&self, o: &Bounds) -> Bounds {
        Bounds { min: self.min.min(o.min), max: self.max.max(o.max) }
    }

    #[must_use]
    pub fn with_point(&self, p: DVec3) -> Bounds {
        Bounds { min: self.min.min(p), max: self.max.max(p) }
    }

    pub fn contains(&self, p: DVec3) -> bool {
        self.min.cmple(p).all() && p.cmple(self.max).all()
    }

    /// Distance between two boxes; 0 where they overlap.
    pub fn gap(&self, o: &Bounds) -> f64 {
        (self.min - o.max).max(o.min - self.max).max(DVec3::ZERO).length()
    }

    /// Distance to a point; 0 inside.
    pub fn distance(&self, p: DVec3) -> f64 {
        (self.min - p).max(p - self.max).max(DVec3::ZERO).length()
    }

    pub fn center(&self) -> DVec3 {
        self.min + (self.max - self.min) * 0.5
    }

    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|k| {
            let pick = |axis: usize| if k >> axis & 1 == 0 { self.min[axis] } else { self.max[axis] };
            DVec3::new(pick(0), pick(1), pick(2))
        })
    }

    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// Four points in general position on a box's scale.
    pub fn probes(&self) -> [DVec3; 4] {
        let (c, r) =
            if self.is_empty() { (DVec3::ZERO, 1.0) } else { (self.center(), self.radius().max(f64::MIN_POSITIVE)) };
        [c, c + DVec3::X * r, c + DVec3::Y * r, c + DVec3::Z * r]
    }

    /// Larger by `by` on every side.
    #[must_use]
    pub fn grown(&self, by: f64) -> Bounds {
        Bounds { min: self.min - by, max: self.max + by }
    }

    /// Half the diagonal.
    pub fn radius(&self) -> f64 {
        if self.is_empty() { 0.0 } else { 0.5 * self.size().length() }
    }

    /// The largest coordinate in absolute value: what rounding errors are relative to.
    pub fn magnitude(&self) -> f64 {
        if self.is_empty() { 0.0 } else { self.min.abs().max(self.max.abs()).max_element() }
    }
}

impl FromIterator<DVec3> for Bounds {
    fn from_iter<I: IntoIterator<Item = DVec3>>(points: I) -> Self {
        points.into_iter().fold(Bounds::EMPTY, |b, p| b.with_point(p))
    }
}
