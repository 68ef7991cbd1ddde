//! Moving borders of media: term N of [T] section 3, at every end of a straight piece that lies on such a border.
//!
//! All vertices stay where they are. A border of normal n that moves with v cuts a fixed ray of direction ω at a place that moves by
//! `ṫ = <n,v>/<n,ω>` ([T] (13)), so that a piece from t0 to t1 gains `ṫ1 T Q(t1) - ṫ0 T Q(t0)` of its medium's own source and its optical depth
//! `ṫ1 σ_t(t1) - ṫ0 σ_t(t0)`: both sides together are [T] (16), with no need to know which medium lies beyond.
//!
//! The optical depth is scored wherever a piece is; the source needs light scattered right at the border, and is one more candidate of
//! the path's derivative vertex ([T] (65)), weighed `σ_s/|<n,ω>|`.

use super::record::{Face, MediumSpan};
use crate::math::{DVec3, Rgb};
use crate::params::{Covector, ParamSet, Sink};
use crate::scene::Scene;
use crate::shape::{Geometry, Shape};

/// As in `--terms`, EXR layers and reports.
pub const NAME: &str = "null_interface";

/// Which shapes are borders that move.
#[derive(Clone, Debug, Default)]
pub struct Borders {
    moving: Vec<bool>,
    any: bool,
}

/// An end of a piece on a border that moves.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub medium: u32,
    /// Start of the ray.
    pub o: DVec3,
    pub p: DVec3,
    pub w: DVec3,
    pub on: Face,
    /// On v: what gives ṫ, with the sign of the end.
    pub form: DVec3,
}

impl Borders {
    pub fn new(scene: &Scene, params: &ParamSet) -> Borders {
        let moving: Vec<bool> = scene.shapes.iter().map(|s| scene.is_border(s) && s.moves(params)).collect();
        Borders { any: moving.iter().any(|&m| m), moving }
    }

    pub fn any(&self) -> bool {
        self.any
    }

    /// The start of a piece, and its end, where they move.
    pub fn ends(&self, scene: &Scene, span: &MediumSpan) -> [Option<Place>; 2] {
        if !self.any {
            return [None; 2];
        }
        let place = |face: Face, t: f64, sign: f64| {
            if !self.moving.get(face.shape as usize).copied().unwrap_or(false) || !t.is_finite() {
                return None;
            }
            let p = span.o + span.w * t;
            let n = scene.shapes[face.shape as usize].shape.normal(face.face, p);
            let cos = n.dot(span.w);
            let form = n * (sign / cos);
            form.is_finite().then_some(Place { medium: span.medium, o: span.o, p, w: span.w, on: face, form })
        };
        [place(span.from, span.t0, -1.0), place(span.to, span.t1, 1.0)]
    }
}

impl Place {
    /// `value ṫ` (with its sign) to `sink`.
    pub fn score(&self, scene: &Scene, value: Rgb, sink: &mut impl Sink) {
        let mut c = Covector::default();
        c.add(self.form, value);
        scene.matter(self.on.shape, self.on.face).point(self.p, &c, sink);
    }

    /// A point of the medium right at the border. Rounding puts `p` on either side of it, and a path that starts in the medium on the wrong side
    /// does not find the way out where it grazes the border.
    pub fn inside(&self, scene: &Scene) -> DVec3 {
        let mut rounding = scene.tolerance(self.o).max(scene.tolerance(self.p));
        // A face's plane is as exact as its corners are, however far away.
        if let Shape::Mesh(m) = &scene.shapes[self.on.shape as usize].shape {
            rounding = m.corners(self.on.face).into_iter().map(|c| scene.tolerance(c)).fold(rounding, f64::max);
        }
        self.p - self.form.normalize() * rounding
    }

    /// How much the place is worth as a candidate, for a weight of 1.
    pub fn strength(&self, scene: &Scene) -> f64 {
        let m = &scene.media[self.medium as usize];
        m.coefficients(self.p).1.max() * self.form.length() / m.kappa
    }
}
