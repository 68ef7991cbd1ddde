//! Object space to world space, for analytic shapes.
//!
//! Mitsuba's conventions, but for one: a transform that mirrors keeps the outside of every shape outside (normals go by
//! the inverse transpose, meshes reverse their winding).

use crate::math::{DAffine3, DMat3, DVec2, DVec3};

/// An invertible affine map of a shape and the side that its normal points to.
#[derive(Clone, Copy, Debug)]
pub struct Placement {
    /// Rows of the inverse of the linear part: one local coordinate costs one product. Points are taken relative to the
    /// translation first, which keeps the digits of small shapes far from the origin.
    rows: [DVec3; 3],
    /// The same inverse, for whole vectors.
    linear_inverse: DMat3,
    pub to_world: DAffine3,
    /// Unit world normals of the local axes, flipped on request.
    normals: [DVec3; 3],
    flip_normals: bool,
}

impl Placement {
    pub fn new(to_world: DAffine3, flip_normals: bool) -> Result<Self, String> {
        let linear_inverse = to_world.matrix3.inverse();
        if !to_world.is_finite() || !linear_inverse.is_finite() {
            return Err("to_world cannot be inverted".into());
        }
        // Normals go by the inverse transpose, whose columns are the rows of the inverse.
        let DMat3 { x_axis, y_axis, z_axis } = linear_inverse.transpose();
        let rows = [x_axis, y_axis, z_axis];
        let normals = rows.map(|n| {
            // Scale first: rows of the inverse of a map by 1e-200 would overflow when squared.
            let n = (n / n.abs().max_element()).normalize();
            if flip_normals { -n } else { n }
        });
        Ok(Placement { rows, linear_inverse, to_world, normals, flip_normals })
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
        self.linear_inverse * self.offset(p)
    }

    /// A point relative to the translation, still in world axes.
    pub fn offset(&self, p: DVec3) -> DVec3 {
        p - self.to_world.translation
    }

    /// One local coordinate of a direction, or of a point's [`Placement::offset`].
    pub fn coordinate(&self, axis: usize, v: DVec3) -> f64 {
        self.rows[axis].dot(v)
    }

    /// Where a ray crosses local z = 0, `t` in `(t_min, t_max]`, before anything else of the local ray is known.
    pub fn cross_z0(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64) -> Option<(f64, DVec2)> {
        let o = self.offset(o);
        let t = -self.coordinate(2, o) / self.coordinate(2, w);
        // A ray in the plane gives NaN or infinity: no crossing.
        let met = t > t_min && t <= t_max && t.is_finite();
        let local = |axis| self.coordinate(axis, o) + t * self.coordinate(axis, w);
        met.then(|| (t, DVec2::new(local(0), local(1))))
    }

    /// `t` is the same in both spaces: the direction is not normalised.
    pub fn local_ray(&self, o: DVec3, w: DVec3) -> (DVec3, DVec3) {
        (self.local_point(o), self.linear_inverse * w)
    }

    /// Unit world normal of a local axis, flipped on request.
    pub fn normal(&self, axis: usize) -> DVec3 {
        self.normals[axis]
    }

    /// World area of the parallelogram of two local vectors.
    pub fn area(&self, a: DVec3, b: DVec3) -> f64 {
        self.vector(a).cross(self.vector(b)).length()
    }
}
