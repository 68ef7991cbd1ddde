//! Transforms over any `Real`: a moving parameter inside `rotate`, `lookat`, ... carries its derivative through.

use super::desc::Env;
use super::value::Num;
use crate::math::{DAffine3, DMat3, DMat4, DVec3, Dual, Real, V3};
use glam::DVec4;
use std::ops::Mul;

/// What is wrong, and what to do about it; the caller knows the place.
pub type Flaw = (String, String);

/// An affine map, row-major: `m[row][column]`, points are columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mat4<R> {
    pub m: [[R; 4]; 4],
}

impl<R: Real> Mat4<R> {
    pub fn identity() -> Self {
        Self::from_fn(|i, j| R::from(if i == j { 1.0 } else { 0.0 }))
    }

    pub fn from_fn(f: impl Fn(usize, usize) -> R) -> Self {
        Mat4 { m: std::array::from_fn(|i| std::array::from_fn(|j| f(i, j))) }
    }

    /// From the images of the axes and of the origin.
    pub fn from_columns(x: V3<R>, y: V3<R>, z: V3<R>, origin: V3<R>) -> Self {
        let row = |a: R, b: R, c: R, d: R| [a, b, c, d];
        Mat4 {
            m: [
                row(x.x, y.x, z.x, origin.x),
                row(x.y, y.y, z.y, origin.y),
                row(x.z, y.z, z.z, origin.z),
                row(R::zero(), R::zero(), R::zero(), R::one()),
            ],
        }
    }

    /// The image of a point.
    pub fn point(&self, p: V3<R>) -> V3<R> {
        self.vector(p) + V3::new(self.m[0][3], self.m[1][3], self.m[2][3])
    }

    /// The image of a direction or difference: no translation.
    pub fn vector(&self, v: V3<R>) -> V3<R> {
        let row = |i: usize| self.m[i][0] * v.x + self.m[i][1] * v.y + self.m[i][2] * v.z;
        V3::new(row(0), row(1), row(2))
    }

    /// Column `j`: the image of axis `j`, or of the origin for `j = 3`.
    pub fn column(&self, j: usize) -> V3<R> {
        V3::new(self.m[0][j], self.m[1][j], self.m[2][j])
    }

    /// The inverse; not finite where the map is singular ([`Mat4::check`] says so).
    pub fn inverse(&self) -> Self {
        let (x, y, z) = (self.column(0), self.column(1), self.column(2));
        // The rows of the inverse are the cross products of the columns over the determinant.
        let (a, b, c) = (y.cross(z), z.cross(x), x.cross(y));
        let s = x.dot(a).recip();
        let (a, b, c, t) = (a * s, b * s, c * s, self.column(3));
        Mat4 {
            m: [
                [a.x, a.y, a.z, -a.dot(t)],
                [b.x, b.y, b.z, -b.dot(t)],
                [c.x, c.y, c.z, -c.dot(t)],
                [R::zero(), R::zero(), R::zero(), R::one()],
            ],
        }
    }

    /// The primal matrix.
    pub fn value(&self) -> DMat4 {
        DMat4::from_cols_array_2d(&std::array::from_fn(|j| std::array::from_fn(|i| self.m[i][j].value())))
    }

    /// The primal map.
    pub fn affine(&self) -> DAffine3 {
        DAffine3::from_mat4(self.value())
    }

    /// Finite, affine and invertible, or what is wrong.
    ///
    /// Singular: the determinant is within rounding of zero, relative to the lengths of the rows or columns
    /// (so that a flat but honest scale such as `1, 1, 1e-20` passes).
    pub fn check(&self) -> Result<(), Flaw> {
        let v = self.value();
        if !v.is_finite() {
            return Err(("is not finite".into(), "look for an overflow in its operations".into()));
        }
        if v.row(3) != DVec4::W {
            return Err(("is not affine".into(), "the last row must be 0 0 0 1".into()));
        }
        // Scale each row and column to unit length first: neither overflow nor underflow.
        let mut a = DMat3::from_mat4(v);
        for _ in 0..2 {
            let unit = |c: DVec3| if c.abs().max_element() > 0.0 { (c / c.abs().max_element()).normalize() } else { c };
            a = DMat3::from_cols(unit(a.x_axis), unit(a.y_axis), unit(a.z_axis)).transpose();
        }
        let inverse = v.inverse();
        if a.determinant().abs() <= 8.0 * f64::EPSILON || !inverse.is_finite() {
            let remedy = "a scale by 0 or parallel axes flatten space: give every axis an extent, however small";
            return Err(("is singular: it has no inverse".into(), remedy.into()));
        }
        Ok(())
    }
}

impl Mat4<Dual<1>> {
    /// The derivative of every entry.
    pub fn tangent(&self) -> DMat4 {
        DMat4::from_cols_array_2d(&std::array::from_fn(|j| std::array::from_fn(|i| self.m[i][j].d[0])))
    }
}

impl<R: Real> Mul for Mat4<R> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let entry = |i: usize, j: usize| (1..4).fold(self.m[i][0] * o.m[0][j], |sum, k| sum + self.m[i][k] * o.m[k][j]);
        Self::from_fn(entry)
    }
}

/// One operation of a `<transform>`.
#[derive(Clone, Debug)]
pub enum Op {
    Translate([Num; 3]),
    /// Angle in degrees, about an axis of any length.
    Rotate {
        axis: [Num; 3],
        angle: Num,
    },
    Scale([Num; 3]),
    /// Without `up`, one is chosen.
    LookAt {
        origin: [Num; 3],
        target: [Num; 3],
        up: Option<[Num; 3]>,
    },
    /// Row-major, the last row 0 0 0 1.
    Matrix(Box<[Num; 16]>),
}

impl Op {
    pub fn eval<R: Real>(&self, env: &Env<R>) -> Result<Mat4<R>, Flaw> {
        let triple = |t: &[Num; 3]| V3::new(t[0].eval(env), t[1].eval(env), t[2].eval(env));
        match self {
            Op::Translate(t) => Ok(translate(triple(t))),
            Op::Rotate { axis, angle } => rotate(triple(axis), angle.eval(env)),
            Op::Scale(s) => Ok(scale(triple(s))),
            Op::LookAt { origin, target, up } => look_at(triple(origin), triple(target), up.as_ref().map(triple)),
            Op::Matrix(m) => Ok(Mat4::from_fn(|i, j| m[4 * i + j].eval(env))),
        }
    }
}

pub fn translate<R: Real>(t: V3<R>) -> Mat4<R> {
    let mut m = Mat4::identity();
    (m.m[0][3], m.m[1][3], m.m[2][3]) = (t.x, t.y, t.z);
    m
}

pub fn scale<R: Real>(s: V3<R>) -> Mat4<R> {
    let mut m = Mat4::identity();
    (m.m[0][0], m.m[1][1], m.m[2][2]) = (s.x, s.y, s.z);
    m
}

/// Rotation about an axis through the origin (Rodrigues), degrees.
pub fn rotate<R: Real>(axis: V3<R>, degrees: R) -> Result<Mat4<R>, Flaw> {
    if axis.value() == DVec3::ZERO {
        return Err((
            "<rotate> has no axis".into(),
            "give the axis: x=\"1\", y=\"1\", z=\"1\" or value=\"x, y, z\"".into(),
        ));
    }
    let a = unit(axis);
    let angle = degrees.to_radians();
    let (s, c) = (angle.sin(), angle.cos());
    let column = |e: DVec3| {
        let e = V3::constant(e);
        e * c + a.cross(e) * s + a * (a.dot(e) * (R::one() - c))
    };
    Ok(Mat4::from_columns(column(DVec3::X), column(DVec3::Y), column(DVec3::Z), V3::constant(DVec3::ZERO)))
}

/// Camera to world: +z looks from `origin` to `target`, +x is to the left, +y is up.
pub fn look_at<R: Real>(origin: V3<R>, target: V3<R>, up: Option<V3<R>>) -> Result<Mat4<R>, Flaw> {
    let along = target - origin;
    if along.value() == DVec3::ZERO {
        return Err((
            "<lookat> has no direction: target equals origin".into(),
            "move the target off the origin".into(),
        ));
    }
    let dir = unit(along);
    // A missing up is any direction across the view.
    let side = match up {
        Some(up) => up.cross(dir),
        None => V3::constant(dir.value().any_orthonormal_pair().0).cross(dir),
    };
    let sine = side.value().length() / up.map_or(1.0, |u| u.value().length());
    if sine.is_nan() || sine <= 8.0 * f64::EPSILON {
        let remedy = "choose an `up` that is not zero and not parallel to target - origin";
        return Err(("<lookat> is degenerate: `up` is parallel to the view".into(), remedy.into()));
    }
    let left = unit(side);
    Ok(Mat4::from_columns(left, dir.cross(left), dir, origin))
}

/// Unit length, without overflow or underflow on the way.
fn unit<R: Real>(v: V3<R>) -> V3<R> {
    let size = v.value().abs().max_element();
    if size > 0.0 && size.is_finite() { (v * R::from(size.recip())).normalize() } else { v.normalize() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64, z: f64) -> V3<f64> {
        V3::new(x, y, z)
    }

    fn close(a: DMat4, b: DMat4) {
        assert!(a.abs_diff_eq(b, 1e-14), "{a}\n{b}");
    }

    #[test]
    fn operations_agree_with_glam() {
        let axis = DVec3::new(1.0, -2.0, 0.5);
        let r = rotate(V3::constant(axis), 37.0).unwrap();
        close(r.value(), DMat4::from_axis_angle(axis.normalize(), 37f64.to_radians()));
        let (t, s) = (translate(v(1.0, 2.0, 3.0)), scale(v(2.0, 3.0, 0.5)));
        let m = t * r * s;
        let expected = DMat4::from_translation(DVec3::new(1.0, 2.0, 3.0))
            * DMat4::from_axis_angle(axis.normalize(), 37f64.to_radians())
            * DMat4::from_scale(DVec3::new(2.0, 3.0, 0.5));
        close(m.value(), expected);
        close(m.inverse().value(), expected.inverse());
        close((m * m.inverse()).value(), DMat4::IDENTITY);
        let p = DVec3::new(0.3, 0.7, -1.1);
        assert!((m.point(V3::constant(p)).value() - expected.transform_point3(p)).length() < 1e-14);
        assert!((m.vector(V3::constant(p)).value() - m.affine().transform_vector3(p)).length() < 1e-14);
        m.check().unwrap();
    }

    #[test]
    fn look_at_looks_along_z_with_x_to_the_left() {
        let m = look_at(v(0.0, 0.0, 5.0), v(0.0, 0.0, 0.0), Some(v(0.0, 3.0, 0.0))).unwrap();
        assert_eq!(m.column(0).value(), DVec3::NEG_X);
        assert_eq!(m.column(1).value(), DVec3::Y);
        assert_eq!(m.column(2).value(), DVec3::NEG_Z);
        assert_eq!(m.column(3).value(), DVec3::new(0.0, 0.0, 5.0));
        // Without `up`: still a rotation.
        let free = look_at(v(1.0, 2.0, 3.0), v(-1.0, 0.5, 7.0), None).unwrap();
        let (x, y, z) = (free.column(0), free.column(1), free.column(2));
        assert!((x.cross(y) - z).length() < 1e-14 && x.dot(y).abs() < 1e-14);
    }

    #[test]
    fn derivatives_agree_with_central_differences() {
        fn m<R: Real>(t: R) -> Mat4<R> {
            let c = |x: f64| R::from(x);
            let a = rotate(V3::new(c(1.0), t, c(2.0)), t * 30.0).unwrap();
            let l = look_at(V3::new(t, c(0.5), c(3.0)), V3::constant(DVec3::ZERO), Some(V3::new(c(0.1), c(1.0), t)))
                .unwrap();
            let product = l * translate(V3::new(t, t * t, c(1.0))) * a * scale(V3::new(t + 1.0, c(1.0), c(2.0)));
            product * product.inverse() * product.inverse()
        }
        let (t, h) = (0.7, 1e-6);
        let d = m(Dual::<1>::variable(t, 0)).tangent();
        let fd = (m(t + h).value() - m(t - h).value()) * (0.5 / h);
        assert!(d.abs_diff_eq(fd, 1e-8), "{d}\n{fd}");
    }

    #[test]
    fn singular_is_relative_to_size() {
        for s in [v(1.0, 1.0, 1e-20), v(1e-20, 1e-20, 1e-20), v(1e30, 1.0, 1e-30), v(-1.0, 1.0, 1.0)] {
            (rotate(v(1.0, 2.0, 3.0), 40.0).unwrap() * scale(s)).check().unwrap();
            (scale(s) * rotate(v(1.0, 2.0, 3.0), 40.0).unwrap()).check().unwrap();
        }
        // Rank 2, hidden by rotations: rounding leaves a tiny determinant.
        let r = |d: f64| rotate(v(1.0, 2.0, 3.0), d).unwrap();
        assert!((r(20.0) * scale(v(1.0, 0.0, 1.0)) * r(50.0)).check().is_err());
        assert!(scale(v(f64::INFINITY, 1.0, 1.0)).check().is_err());
        // Rotations near the precision of a double are not degenerate by size.
        rotate(v(1e-200, 0.0, 1e-200), 10.0).unwrap().check().unwrap();
    }
}
