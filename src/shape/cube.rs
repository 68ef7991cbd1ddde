//! The cube `[-1,1]^3` placed by an affine map: any parallelepiped. Crossings by slabs in object space.
//!
//! Faces are numbered `2 axis + (1 if positive)`: -x, +x, -y, +y, -z, +z.

use super::{Bounds, Geometry, Placement, ShapeHit, Start, SurfaceSample};
use crate::math::discrete::Discrete;
use crate::math::nearest::on_parallelogram;
use crate::math::{DAffine3, DVec2, DVec3};

#[derive(Clone, Debug)]
pub struct Cube {
    pub placement: Placement,
    faces: Discrete,
}

/// Surface coordinates of a face, as Mitsuba lays them out: (axis, sign) of u and of v.
const UV: [[(usize, f64); 2]; 6] = [
    [(1, 1.0), (2, 1.0)],
    [(1, 1.0), (2, -1.0)],
    [(2, 1.0), (0, 1.0)],
    [(0, -1.0), (2, -1.0)],
    [(1, -1.0), (0, 1.0)],
    [(1, 1.0), (0, 1.0)],
];

const AXES: [DVec3; 3] = [DVec3::X, DVec3::Y, DVec3::Z];

fn axis_side(face: u32) -> (usize, f64) {
    (face as usize / 2, if face % 2 == 1 { 1.0 } else { -1.0 })
}

fn face_of(axis: usize, side: f64) -> u32 {
    2 * axis as u32 + u32::from(side > 0.0)
}

fn local_uv(face: u32, p: DVec3) -> DVec2 {
    let [(a, sa), (b, sb)] = UV[face as usize];
    DVec2::new(0.5 * (1.0 + sa * p[a]), 0.5 * (1.0 + sb * p[b])).clamp(DVec2::ZERO, DVec2::ONE)
}

impl Cube {
    pub fn new(to_world: DAffine3, flip_normals: bool) -> Result<Self, String> {
        let placement = Placement::new(to_world, flip_normals)?;
        let areas = (0..6).map(|f| 4.0 * placement.area(AXES[(f / 2 + 1) % 3], AXES[(f / 2 + 2) % 3]));
        Ok(Cube { placement, faces: Discrete::new(areas) })
    }

    /// Entry and exit of the line, `(t, face)` each.
    fn slabs(o: DVec3, w: DVec3) -> Option<[(f64, u32); 2]> {
        let (mut near, mut far) = ((f64::NEG_INFINITY, 0), (f64::INFINITY, 0));
        for a in 0..3 {
            if w[a] == 0.0 {
                if o[a].abs() > 1.0 {
                    return None;
                }
                continue;
            }
            let side = 1f64.copysign(w[a]);
            let (enter, exit) = ((-side - o[a]) / w[a], (side - o[a]) / w[a]);
            if enter > near.0 {
                near = (enter, face_of(a, -side));
            }
            if exit < far.0 {
                far = (exit, face_of(a, side));
            }
        }
        (near.0 < far.0).then_some([near, far])
    }

    /// Exit of a ray that starts on `face`; `None` if it points outward.
    fn exit_from(face: u32, o: DVec3, w: DVec3) -> Option<(f64, u32)> {
        let (axis, side) = axis_side(face);
        if side * w[axis] >= 0.0 {
            return None;
        }
        // Put the origin on the face and inside the other slabs, where bookkeeping says that it is.
        let mut o = o.clamp(DVec3::NEG_ONE, DVec3::ONE);
        o[axis] = side;
        let mut far = (f64::INFINITY, 0);
        for a in 0..3 {
            let side = 1f64.copysign(w[a]);
            let exit = (side - o[a]) / w[a];
            if exit < far.0 {
                far = (exit, face_of(a, side));
            }
        }
        // Through an edge it leaves at once, but it does leave.
        Some((far.0.max(f64::MIN_POSITIVE), far.1))
    }

    fn hit(&self, o: DVec3, w: DVec3, (t, face): (f64, u32)) -> ShapeHit {
        let (o, w) = self.placement.local_ray(o, w);
        ShapeHit { t, uv: local_uv(face, o + t * w), face }
    }
}

impl Geometry for Cube {
    fn bounds(&self) -> Bounds {
        let r: DVec3 = AXES.iter().map(|&a| self.placement.vector(a).abs()).sum();
        let c = self.placement.to_world.translation;
        Bounds::new(c - r, c + r)
    }

    fn area(&self) -> f64 {
        self.faces.total
    }

    fn is_closed(&self) -> bool {
        true
    }

    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit> {
        self.cross(o, w, t_min, t_max, start).map(|x| self.hit(o, w, x))
    }

    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)> {
        let inside = |x: &(f64, u32)| x.0 > t_min && x.0 <= t_max;
        let (o, w) = self.placement.local_ray(o, w);
        match start {
            Some(s) => Self::exit_from(s.face, o, w).filter(inside),
            None => Self::slabs(o, w)?.into_iter().find(inside),
        }
    }

    fn crossings(&self, o: DVec3, w: DVec3) -> Option<[ShapeHit; 2]> {
        let (local_o, local_w) = self.placement.local_ray(o, w);
        Some(Self::slabs(local_o, local_w)?.map(|x| self.hit(o, w, x)))
    }

    fn normal(&self, face: u32, _p: DVec3) -> DVec3 {
        let (axis, side) = axis_side(face);
        side * self.placement.normal(axis)
    }

    fn position(&self, face: u32, uv: DVec2) -> DVec3 {
        let (axis, side) = axis_side(face);
        let [(a, sa), (b, sb)] = UV[face as usize];
        let mut p = DVec3::ZERO;
        p[axis] = side;
        p[a] = sa * (2.0 * uv.x - 1.0);
        p[b] = sb * (2.0 * uv.y - 1.0);
        self.placement.point(p)
    }

    fn uv(&self, face: u32, p: DVec3) -> DVec2 {
        local_uv(face, self.placement.local_point(p))
    }

    fn face_count(&self) -> u32 {
        6
    }

    fn nearest_on_face(&self, face: u32, p: DVec3) -> DVec3 {
        let (axis, side) = axis_side(face);
        let [x, y, z] = [axis, (axis + 1) % 3, (axis + 2) % 3].map(|a| self.placement.vector(AXES[a]));
        on_parallelogram(p, self.placement.to_world.translation + side * x - (y + z), 2.0 * y, 2.0 * z)
    }

    fn sample(&self, u: f64, v: f64) -> SurfaceSample {
        let (face, _, u) = self.faces.sample(u);
        let (face, uv) = (face as u32, DVec2::new(u, v));
        let p = self.position(face, uv);
        SurfaceSample { p, n: self.normal(face, p), uv, face, pdf_area: self.area().recip() }
    }
}
