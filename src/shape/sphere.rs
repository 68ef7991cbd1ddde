//! Spheres: crossings, area sampling, and sampling of the cone that a sphere fills seen from outside.

use super::disk::turn;
use super::{Bounds, Geometry, ShapeHit, Start, SurfaceSample, sphere_other_root, sphere_roots};
use crate::math::{DAffine3, DMat3, DVec2, DVec3, V3, warp};
use std::f64::consts::{PI, TAU};

/// `to_world` may differ from a similarity by this much, relatively: matrices in scene files carry six digits.
const SIMILARITY_TOLERANCE: f64 = 1e-5;

#[derive(Clone, Copy, Debug)]
pub struct Sphere {
    /// World space.
    pub center: DVec3,
    pub radius: f64,
    pub flip_normals: bool,
    /// Rotation (perhaps with a mirror) of world directions into the frame of `uv`.
    to_local: DMat3,
    from_local: DMat3,
}

/// A direction toward a surface, drawn from a reference point, and the surface point it meets first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionSample {
    /// Unit, from the reference point.
    pub w: DVec3,
    pub distance: f64,
    pub p: DVec3,
    pub n: DVec3,
    /// Density per unit solid angle at the reference point, no cosine.
    pub pdf_solid_angle: f64,
}

impl Sphere {
    /// Centre and radius in object space. A scale that is not uniform is an error.
    pub fn new(center: DVec3, radius: f64, to_world: DAffine3, flip_normals: bool) -> Result<Self, String> {
        if !(radius > 0.0 && radius.is_finite() && center.is_finite()) {
            return Err(format!("a sphere needs a finite centre and a positive radius, not {radius}"));
        }
        let m = to_world.matrix3;
        let scale = m.determinant().abs().cbrt();
        if !(scale > 0.0 && scale.is_finite() && to_world.is_finite()) {
            return Err("to_world cannot be inverted".into());
        }
        // A similarity: columns of length `scale`, mutually orthogonal.
        let unit = m * scale.recip();
        let gram = unit.transpose() * unit;
        if !gram.abs_diff_eq(DMat3::IDENTITY, SIMILARITY_TOLERANCE) {
            return Err("a sphere's to_world may rotate, move and scale uniformly, but not stretch or shear".into());
        }
        Ok(Sphere {
            center: to_world.transform_point3(center),
            radius: radius * scale,
            flip_normals,
            to_local: unit.inverse(),
            from_local: unit,
        })
    }

    fn local_uv(&self, outward: DVec3) -> DVec2 {
        let d = self.to_local * outward;
        // Polar angle from both components: exact at the poles too.
        DVec2::new(turn(d.y, d.x), d.truncate().length().atan2(d.z) / PI)
    }

    fn hit(&self, o: DVec3, w: DVec3, t: f64) -> ShapeHit {
        ShapeHit { t, uv: self.local_uv((o - self.center) + t * w), face: 0 }
    }

    /// The point of the sphere nearest to `p` (not the centre): puts a computed hit back on the surface.
    pub fn snap(&self, p: DVec3) -> DVec3 {
        self.center + self.radius * (p - self.center).normalize()
    }

    /// 1 - cos of the half angle that the sphere fills from `x`; `None` from inside and from the surface itself.
    fn one_minus_cos_max(&self, x: DVec3) -> Option<f64> {
        let d = (self.center - x).length();
        if d <= self.radius {
            return None;
        }
        let s = self.radius / d;
        Some(s * s / (1.0 + ((1.0 - s) * (1.0 + s)).sqrt()))
    }

    /// Density of [`Sphere::sample_direction`] for the direction from `x` to the point `p` of the sphere, per unit
    /// solid angle.
    pub fn pdf_direction(&self, x: DVec3, p: DVec3) -> f64 {
        match self.one_minus_cos_max(x) {
            Some(m) => (TAU * m).recip(),
            None => self.pdf_direction_area(x, p),
        }
    }

    /// Area density seen as solid angle: `distance^2 / (|cos| A)`.
    fn pdf_direction_area(&self, x: DVec3, p: DVec3) -> f64 {
        let d = p - x;
        let cos_d = self.normal(0, p).dot(d).abs();
        d.length_squared() * d.length() / (cos_d * self.area())
    }

    /// A direction from `x` toward the sphere: uniform in the cone from outside, uniform in area from inside.
    /// Detached. `None` if the drawn point coincides with `x` or is seen edge on.
    pub fn sample_direction(&self, x: DVec3, u: f64, v: f64) -> Option<DirectionSample> {
        let Some(m) = self.one_minus_cos_max(x) else {
            let s = self.sample(u, v);
            let d = s.p - x;
            let pdf_solid_angle = self.pdf_direction_area(x, s.p);
            let sample = DirectionSample { w: d.normalize(), distance: d.length(), p: s.p, n: s.n, pdf_solid_angle };
            return (pdf_solid_angle.is_finite() && sample.distance > 0.0).then_some(sample);
        };
        let to_center = self.center - x;
        let d = to_center.length();
        let axis = to_center / d;
        let (s, t) = warp::frame(axis);
        let (sin_phi, cos_phi) = (TAU * v).sin_cos();
        let side = s * cos_phi + t * sin_phi;
        // 1 - cos theta = u m, and nothing is subtracted from 1 that is small.
        let one_minus_cos = u * m;
        let (cos, sin) = (1.0 - one_minus_cos, (one_minus_cos * (2.0 - one_minus_cos)).sqrt());
        // Half chord: r sqrt(1 - sin^2 / sin_max^2), factored.
        let half = self.radius * ((1.0 - u) * (2.0 - m * (1.0 + u)) / (2.0 - m)).max(0.0).sqrt();
        let across = (self.radius * (u * (2.0 - one_minus_cos) / (2.0 - m)).sqrt()).min(self.radius);
        // The ray passes the centre at `across`, and enters half a chord before.
        let (w, e) = (axis * cos + side * sin, side * cos - axis * sin);
        let outward = ((across * e - half * w) / self.radius).normalize();
        // Near root by the product of the roots.
        let distance = (d - self.radius) * (d + self.radius) / (d * cos + half);
        Some(DirectionSample {
            w,
            distance,
            p: self.center + self.radius * outward,
            n: if self.flip_normals { -outward } else { outward },
            pdf_solid_angle: (TAU * m).recip(),
        })
    }
}

impl Geometry for Sphere {
    fn bounds(&self) -> Bounds {
        Bounds::new(self.center - self.radius, self.center + self.radius)
    }

    fn area(&self) -> f64 {
        4.0 * PI * self.radius * self.radius
    }

    fn is_closed(&self) -> bool {
        true
    }

    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit> {
        self.cross(o, w, t_min, t_max, start).map(|(t, _)| self.hit(o, w, t))
    }

    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)> {
        let (c, o, w) = (V3::constant(self.center), V3::constant(o), V3::constant(w));
        let inside = |t: &f64| *t > t_min && *t <= t_max;
        let t = match start {
            Some(_) => Some(sphere_other_root(c, self.radius, o, w)).filter(inside),
            None => sphere_roots(c, self.radius, o, w)?.into_iter().find(inside),
        };
        t.map(|t| (t, 0))
    }

    fn crossings(&self, o: DVec3, w: DVec3) -> Option<[ShapeHit; 2]> {
        let roots = sphere_roots(V3::constant(self.center), self.radius, V3::constant(o), V3::constant(w))?;
        Some(roots.map(|t| self.hit(o, w, t)))
    }

    fn normal(&self, _face: u32, p: DVec3) -> DVec3 {
        let n = (p - self.center).normalize();
        if self.flip_normals { -n } else { n }
    }

    fn position(&self, _face: u32, uv: DVec2) -> DVec3 {
        let ((sp, cp), (st, ct)) = ((TAU * uv.x).sin_cos(), (PI * uv.y).sin_cos());
        self.center + self.radius * (self.from_local * DVec3::new(st * cp, st * sp, ct)).normalize()
    }

    fn uv(&self, _face: u32, p: DVec3) -> DVec2 {
        self.local_uv(p - self.center)
    }

    fn face_count(&self) -> u32 {
        1
    }

    fn nearest_on_face(&self, _face: u32, p: DVec3) -> DVec3 {
        // Every point is as near to the centre as any other.
        self.center + self.radius * (p - self.center).try_normalize().unwrap_or(DVec3::X)
    }

    fn sample(&self, u: f64, v: f64) -> SurfaceSample {
        let outward = warp::sphere(u, v);
        let p = self.center + self.radius * outward;
        let n = if self.flip_normals { -outward } else { outward };
        SurfaceSample { p, n, uv: self.local_uv(outward), face: 0, pdf_area: self.area().recip() }
    }
}
