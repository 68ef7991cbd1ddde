//! Open cylinders: the wall of a tube without caps, `uv = (angle / 2 pi, height)`.
//!
//! Across its axis a cylinder is a circle, so that crossings are a sphere's of the line's trace there, with all their digits.

use super::disk::turn;
use super::{Bounds, Geometry, ShapeHit, Start, SurfaceSample, sphere_other_root, sphere_roots};
use crate::math::{DAffine3, DVec2, DVec3, V3};
use std::f64::consts::TAU;

/// The map may differ from one that leaves a cylinder a cylinder by this much, relatively: matrices in scene files carry six digits.
const ROUND_TOLERANCE: f64 = 1e-5;

/// Heights this near to a rim, as a share of length and radius, are the rim's for a line that passes through it.
const RIM: f64 = 1e-9;

#[derive(Clone, Copy, Debug)]
pub struct Cylinder {
    /// Middle of the first rim, world space.
    pub base: DVec3,
    /// Unit, toward the second rim.
    pub axis: DVec3,
    pub length: f64,
    pub radius: f64,
    /// Unit, across the axis: where angles begin, and a quarter of a turn on.
    x: DVec3,
    y: DVec3,
    flip_normals: bool,
}

impl Cylinder {
    /// `place` takes the tube `x^2 + y^2 = 1`, `0 <= z <= 1` to the world. It may make it longer and wider, not elliptic or oblique.
    pub fn new(place: DAffine3, flip_normals: bool) -> Result<Self, String> {
        let m = place.matrix3;
        let lengths = [m.x_axis, m.y_axis, m.z_axis].map(DVec3::length);
        if !place.is_finite() || !lengths.iter().all(|&l| l > 0.0 && l.is_finite()) {
            return Err("a cylinder needs two finite points apart from each other and a positive radius".into());
        }
        let [x, y, axis] = [m.x_axis / lengths[0], m.y_axis / lengths[1], m.z_axis / lengths[2]];
        let slant = x.dot(y).abs().max(x.dot(axis).abs()).max(y.dot(axis).abs());
        if slant > ROUND_TOLERANCE || (lengths[0] / lengths[1] - 1.0).abs() > ROUND_TOLERANCE {
            return Err("to_world makes the cylinder elliptic or oblique".into());
        }
        let x = (x - axis * axis.dot(x)).normalize();
        let y = (y - axis * axis.dot(y) - x * x.dot(y)).normalize();
        let radius = lengths[0].sqrt() * lengths[1].sqrt();
        Ok(Cylinder { base: place.translation, axis, length: lengths[2], radius, x, y, flip_normals })
    }

    /// The trace across the axis of a direction, or of a point's offset from the base.
    fn across(&self, v: DVec3) -> DVec2 {
        DVec2::new(self.x.dot(v), self.y.dot(v))
    }

    fn spread(&self, q: DVec2) -> DVec3 {
        self.x * q.x + self.y * q.y
    }

    /// Distance from the base's plane.
    pub fn height(&self, p: DVec3) -> f64 {
        self.axis.dot(p - self.base)
    }

    /// The part across the axis of the way from the axis to `p`.
    pub fn from_axis(&self, p: DVec3) -> DVec3 {
        self.spread(self.across(p - self.base))
    }

    fn outward(&self, p: DVec3) -> DVec3 {
        self.spread(self.across(p - self.base).normalize())
    }

    /// Abscissae in `(t_min, t_max]` at which a line meets the wall.
    fn met(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> [Option<f64>; 2] {
        let l = o - self.base;
        let flat = |v: DVec3| V3::constant(self.across(v).extend(0.0));
        let (center, l2, w2) = (V3::constant(DVec3::ZERO), flat(l), flat(w));
        let (height, rise) = (self.axis.dot(l), self.axis.dot(w));
        let inside = |t: &f64| *t > t_min && *t <= t_max && (0.0..=self.length).contains(&(height + rise * t));
        match start {
            Some(_) => [Some(sphere_other_root(center, self.radius, l2, w2)).filter(inside), None],
            None => sphere_roots(center, self.radius, l2, w2).map_or([None; 2], |r| r.map(|t| Some(t).filter(inside))),
        }
    }

    /// Where a ray that passes through a point of the named rims meets the wall elsewhere. `slack`: rounding of heights.
    pub fn cross_past_rims(&self, o: DVec3, w: DVec3, range: [f64; 2], rims: &[u32], slack: f64) -> Option<f64> {
        let near = RIM * self.length.max(self.radius) + slack;
        let at_rim = |t: f64| rims.iter().any(|&k| (self.height(o + w * t) - self.rim_height(k)).abs() <= near);
        self.met(o, w, range[0], range[1], None).into_iter().flatten().find(|&t| !at_rim(t))
    }

    fn rim_height(&self, rim: u32) -> f64 {
        if rim == 0 { 0.0 } else { self.length }
    }

    /// Middle of a rim (0 or 1), and the direction in which the wall leaves it.
    pub fn rim(&self, rim: u32) -> (DVec3, DVec3) {
        (self.base + self.axis * self.rim_height(rim), if rim == 0 { self.axis } else { -self.axis })
    }

    /// Axes of the rims, as long as the radius.
    pub fn rim_axes(&self) -> (DVec3, DVec3) {
        (self.x * self.radius, self.y * self.radius)
    }

    /// Outward normals of the two lines along which planes through `p` touch the wall; `None` from within.
    pub fn contacts_from(&self, p: DVec3) -> Option<[DVec3; 2]> {
        let l = self.across(p - self.base);
        let d = l.length();
        let (cos, sin) = (self.radius / d, ((d - self.radius) * (d + self.radius)).sqrt() / d);
        let u = l / d;
        (d > self.radius).then(|| [sin, -sin].map(|s| self.spread(u * cos + u.perp() * s)))
    }

    /// The same for planes along a direction; `None` for the axis's own.
    pub fn contacts_along(&self, w: DVec3) -> Option<[DVec3; 2]> {
        let u = self.across(w);
        let n = u.perp() / u.length();
        n.is_finite().then(|| [n, -n].map(|n| self.spread(n)))
    }

    /// Ends of the wall's straight line of this outward normal.
    pub fn line(&self, n: DVec3) -> [DVec3; 2] {
        let a = self.base + n * self.radius;
        [a, a + self.axis * self.length]
    }

    /// Distance to the nearer rim.
    pub fn to_rims(&self, p: DVec3) -> f64 {
        let (across, height) = (self.across(p - self.base).length() - self.radius, self.height(p));
        across.hypot(height).min(across.hypot(height - self.length))
    }

    /// A point of the wall, kept this far from the rims.
    pub fn off_the_rims(&self, p: DVec3, by: f64) -> DVec3 {
        let (by, height) = (by.min(0.5 * self.length), self.height(p));
        p + self.axis * (height.clamp(by, self.length - by) - height)
    }

    /// The point of the wall nearest to `p` among those of its height: puts a computed hit back on the surface.
    pub fn snap(&self, p: DVec3) -> DVec3 {
        let q = self.across(p - self.base);
        let d = q.length();
        p + self.spread(q) * ((self.radius - d) / d)
    }
}

impl Geometry for Cylinder {
    fn bounds(&self) -> Bounds {
        // A circle reaches sqrt(1 - k_i^2) along axis i.
        let k = self.axis;
        let r = DVec3::new(k.y.hypot(k.z), k.z.hypot(k.x), k.x.hypot(k.y)) * self.radius;
        let top = self.base + k * self.length;
        Bounds::new(self.base.min(top) - r, self.base.max(top) + r)
    }

    fn area(&self) -> f64 {
        TAU * self.radius * self.length
    }

    fn is_closed(&self) -> bool {
        false
    }

    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit> {
        self.cross(o, w, t_min, t_max, start).map(|(t, _)| ShapeHit { t, uv: self.uv(0, o + w * t), face: 0 })
    }

    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)> {
        self.met(o, w, t_min, t_max, start).into_iter().flatten().next().map(|t| (t, 0))
    }

    fn normal(&self, _face: u32, p: DVec3) -> DVec3 {
        let n = self.outward(p);
        if self.flip_normals { -n } else { n }
    }

    fn position(&self, _face: u32, uv: DVec2) -> DVec3 {
        let (s, c) = (TAU * uv.x).sin_cos();
        self.base + self.axis * (uv.y * self.length) + self.spread(DVec2::new(c, s)) * self.radius
    }

    fn uv(&self, _face: u32, p: DVec3) -> DVec2 {
        let q = self.across(p - self.base);
        DVec2::new(turn(q.y, q.x), (self.height(p) / self.length).clamp(0.0, 1.0))
    }

    fn face_count(&self) -> u32 {
        1
    }

    fn nearest_on_face(&self, _face: u32, p: DVec3) -> DVec3 {
        // Every line of the wall is as near to the axis as any other.
        let outward = self.across(p - self.base).try_normalize().unwrap_or(DVec2::X);
        let height = self.height(p).clamp(0.0, self.length);
        self.base + self.axis * height + self.spread(outward) * self.radius
    }

    fn sample(&self, u: f64, v: f64) -> SurfaceSample {
        let uv = DVec2::new(u, v);
        let p = self.position(0, uv);
        SurfaceSample { p, n: self.normal(0, p), uv, face: 0, pdf_area: self.area().recip() }
    }
}
