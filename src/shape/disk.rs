//! The unit disk in z = 0 with normal +z, placed by an affine map: any ellipse. `uv = (radius, angle / 2 pi)`.

use super::{Bounds, Geometry, Placement, ShapeHit, Start, SurfaceSample};
use crate::math::{DAffine3, DVec2, DVec3, warp};
use std::f64::consts::{PI, TAU};

/// Steps of Newton's method toward the nearest point of an ellipse. Three or four are enough for a circle or a fair ellipse.
const STEPS: usize = 32;

#[derive(Clone, Copy, Debug)]
pub struct Disk {
    pub placement: Placement,
    area: f64,
}

impl Disk {
    pub fn new(to_world: DAffine3, flip_normals: bool) -> Result<Self, String> {
        let placement = Placement::new(to_world, flip_normals)?;
        Ok(Disk { placement, area: PI * placement.area(DVec3::X, DVec3::Y) })
    }

    /// `t` and the local point.
    fn met(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, DVec2)> {
        if start.is_some() {
            return None;
        }
        self.placement.cross_z0(o, w, t_min, t_max).filter(|(_, p)| p.length_squared() <= 1.0)
    }

    /// Distance from `p` to the rim; of an ellipse no more than that.
    pub fn to_rim(&self, p: DVec3) -> f64 {
        let (x, y, n) = (self.placement.vector(DVec3::X), self.placement.vector(DVec3::Y), self.placement.normal(2));
        // The shorter half axis: the smaller singular value of (x, y).
        let (sum, area) = (x.length_squared() + y.length_squared(), x.cross(y).length());
        let least = area * (2.0 / (sum + ((sum - 2.0 * area) * (sum + 2.0 * area)).max(0.0).sqrt())).sqrt();
        let across = least * (self.placement.local_point(p).truncate().length() - 1.0);
        across.hypot(n.dot(self.placement.offset(p)))
    }

    /// The local point whose place is nearest to `p`: of all |q| <= 1 the least |M q - p|, with M the columns of x and y.
    ///
    /// Outside, (G + k) q = G f with G = M^T M, f the foot of `p` on the plane, and the k > 0 that makes |q| = 1. As a function of k
    /// 1/|q| is nearly straight (straight for a circle), so Newton's steps from 0 never pass the root and few are needed.
    fn nearest_local(&self, p: DVec3) -> DVec2 {
        let (x, y, n) = (self.placement.vector(DVec3::X), self.placement.vector(DVec3::Y), self.placement.normal(2));
        let o = self.placement.offset(p);
        let foot = o - n * n.dot(o);
        let f = DVec2::new(self.placement.coordinate(0, foot), self.placement.coordinate(1, foot));
        if f.length_squared() <= 1.0 {
            return f;
        }
        // In units of the longer axis: no overflow, and steps are relative.
        let unit = x.length_squared().max(y.length_squared());
        let (a, b, c) = (x.length_squared() / unit, x.dot(y) / unit, y.length_squared() / unit);
        let g = DVec2::new(a * f.x + b * f.y, b * f.x + c * f.y);
        let solve = |k: f64, v: DVec2| {
            DVec2::new((c + k) * v.x - b * v.y, (a + k) * v.y - b * v.x) / ((a + k) * (c + k) - b * b)
        };
        let (mut k, mut q) = (0.0, f);
        for _ in 0..STEPS {
            let length = q.length();
            if length <= 1.0 + f64::EPSILON {
                break;
            }
            k += (length - 1.0) * length * length / q.dot(solve(k, q));
            q = solve(k, g);
        }
        q.normalize()
    }
}

fn polar(p: DVec2) -> DVec2 {
    DVec2::new(p.length(), turn(p.y, p.x))
}

/// Angle of (x, y) as a fraction of a turn in [0,1].
pub(super) fn turn(y: f64, x: f64) -> f64 {
    let phi = y.atan2(x) / TAU;
    if phi < 0.0 { phi + 1.0 } else { phi }
}

impl Geometry for Disk {
    fn bounds(&self) -> Bounds {
        // An ellipse reaches sqrt(x_i^2 + y_i^2) along axis i.
        let (x, y) = (self.placement.vector(DVec3::X), self.placement.vector(DVec3::Y));
        let r = DVec3::new(x.x.hypot(y.x), x.y.hypot(y.y), x.z.hypot(y.z));
        let c = self.placement.to_world.translation;
        Bounds::new(c - r, c + r)
    }

    fn area(&self) -> f64 {
        self.area
    }

    fn is_closed(&self) -> bool {
        false
    }

    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit> {
        self.met(o, w, t_min, t_max, start).map(|(t, p)| ShapeHit { t, uv: polar(p), face: 0 })
    }

    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)> {
        self.met(o, w, t_min, t_max, start).map(|(t, _)| (t, 0))
    }

    fn normal(&self, _face: u32, _p: DVec3) -> DVec3 {
        self.placement.normal(2)
    }

    fn position(&self, _face: u32, uv: DVec2) -> DVec3 {
        let (s, c) = (TAU * uv.y).sin_cos();
        self.placement.point(DVec3::new(uv.x * c, uv.x * s, 0.0))
    }

    fn uv(&self, _face: u32, p: DVec3) -> DVec2 {
        polar(self.placement.local_point(p).truncate())
    }

    fn face_count(&self) -> u32 {
        1
    }

    fn nearest_on_face(&self, _face: u32, p: DVec3) -> DVec3 {
        self.placement.point(self.nearest_local(p).extend(0.0))
    }

    fn sample(&self, u: f64, v: f64) -> SurfaceSample {
        let q = warp::disc(u, v);
        let p = self.placement.point(q.extend(0.0));
        SurfaceSample { p, n: self.normal(0, p), uv: polar(q), face: 0, pdf_area: self.area().recip() }
    }
}
