//! A ray on its way through interfaces: where it is, what it starts on, which medium it is in.

use super::{Hit, On, Scene};
use crate::math::DVec3;

#[derive(Clone, Copy, Debug)]
pub struct March {
    pub o: DVec3,
    /// Unit.
    pub w: DVec3,
    /// Faces at `o`.
    pub on: On,
    pub medium: Option<u32>,
    /// Length of the way to `o`.
    pub before: f64,
}

impl March {
    pub fn new(o: DVec3, w: DVec3, on: On, medium: Option<u32>) -> Self {
        March { o, w, on, medium, before: 0.0 }
    }

    /// The nearest surface of any kind, at most `t_max` from `o`.
    pub fn meets(&self, scene: &Scene, t_max: f64) -> Option<Hit> {
        scene.intersect(self.o, self.w, t_max, &self.on, self.medium)
    }

    /// The nearest null interface, at most `t_max` from `o`.
    pub fn boundary(&self, scene: &Scene, t_max: f64) -> Option<Hit> {
        scene.boundary(self.o, self.w, t_max, &self.on, self.medium)
    }

    /// What is left of a way of this length; 0 where rounding would leave less.
    pub fn left(&self, whole: f64) -> f64 {
        (whole - self.before).max(0.0)
    }

    /// Go on behind an interface, straight.
    pub fn pass(&mut self, scene: &Scene, hit: &Hit) {
        self.medium = scene.shapes[hit.shape as usize].medium_behind(self.w, hit.n, self.medium);
        self.on = self.on.crossed(hit, self.w, scene.tolerance(hit.p));
        self.o = hit.p;
        self.before += hit.t;
    }
}
