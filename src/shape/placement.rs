//! Object space to world space, for analytic shapes.
//!
//! Mitsuba's conventions, but for one: a transform that mirrors keeps the outside of every shape outside (normals go by
//! the inverse transpose, meshes reverse their winding).

use crate::math::{DAffine3, DMat3, DVec3};

/// An invertible affine map of a shape and the side that its normal points to.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    pub to_world: DAffine3,
    /// Inverse of the linear part. Points are taken relative to the translation first, which keeps the digits of
    /// small shapes far from the origin.
    linear_inverse: DMat3,
    flip_normals: bool,
}

impl Placement {
    pub fn new(to_world: DAffine3, flip_normals: bool) -> Result<Self, String> {
        let linear_inverse = to_world.matrix3.inverse();
        if !to_world.is_finite() || !linear_inverse.is_finite() {
            return Err("to_world cannot be inverted".into());
        }
        Ok(Placement { to_world, linear_inverse, flip_normals })
    }

    pub fn flip_normals(&self) -> bool {
        self.flip_normals
    }

    pub fn point(&self, local: DVec3) -> DVec3 {
        self.to_world.transform_point3(local)
    }

    pub fn vector(&self, local: DVec3) -> DVec3 {
        self.to_world.matrix3 * local
    }

    pub fn local_point(&self, p: DVec3) -> DVec3 {
        self.linear_inverse * (p - self.to_world.translation)
    }

    /// `t` is the same in both spaces: the direction is not normalised.
    pub fn local_ray(&self, o: DVec3, w: DVec3) -> (DVec3, DVec3) {
        (self.local_point(o), self.linear_inverse * w)
    }

    /// Unit normal in world space, flipped on request.
    pub fn normal(&self, local: DVec3) -> DVec3 {
        // Scale first: columns of the inverse of a map by 1e-200 would overflow when squared.
        let n = self.linear_inverse.transpose() * local;
        let n = (n / n.abs().max_element()).normalize();
        if self.flip_normals { -n } else { n }
    }

    /// World area of the parallelogram of two local vectors.
    pub fn area(&self, a: DVec3, b: DVec3) -> f64 {
        self.vector(a).cross(self.vector(b)).length()
    }
}
