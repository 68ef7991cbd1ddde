//! Movers: things whose points move by an affine field of velocities, v(p) = b + A (p - pivot): twelve slots, b and then A row by row.
//!
//! Rigid motion, scaling and shear of any shape are such fields; so are a sphere's centre and radius (A = Ṙ/R) and a camera's place. What a
//! derivative asks of a moving point is a linear form on its velocity, handed out here as partials.

use super::{Sink, Slot};
use crate::math::{DVec3, Rgb};
use std::ops::AddAssign;

/// A linear form on up to three consecutive slots.
#[derive(Clone, Copy, Debug)]
pub struct Partial {
    pub slot: Slot,
    pub v: DVec3,
    pub len: u32,
}

/// A linear form on a vector, per colour channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Covector(pub [Rgb; 3]);

impl Covector {
    pub fn add(&mut self, v: DVec3, weight: Rgb) {
        for (x, v) in self.0.iter_mut().zip(v.to_array()) {
            *x += weight * v;
        }
    }

    pub fn dot(&self, v: DVec3) -> Rgb {
        self.0[0] * v.x + self.0[1] * v.y + self.0[2] * v.z
    }

    /// The part across a unit vector.
    #[must_use]
    pub fn across(&self, n: DVec3) -> Covector {
        let mut c = *self;
        c.add(n, -self.dot(n));
        c
    }

    #[must_use]
    pub fn scaled(&self, s: f64) -> Covector {
        Covector(self.0.map(|x| x * s))
    }

    /// Each channel with a weight of its own.
    #[must_use]
    pub fn weighed(&self, w: Rgb) -> Covector {
        Covector(self.0.map(|x| x * w))
    }
}

impl AddAssign for Covector {
    fn add_assign(&mut self, o: Covector) {
        self.0.iter_mut().zip(o.0).for_each(|(x, y)| *x += y);
    }
}

/// Slots of an affine motion.
#[derive(Clone, Copy, Debug)]
pub struct Mover {
    pub first: Slot,
    pub pivot: DVec3,
}

impl Mover {
    pub const SLOTS: u32 = 12;

    /// `<c, v(p)>`.
    pub fn forms(&self, p: DVec3, c: DVec3) -> [Partial; 4] {
        let off = p - self.pivot;
        let row = |i: usize| Partial { slot: self.first + 3 + 3 * i as Slot, v: off * c[i], len: 3 };
        [Partial { slot: self.first, v: c, len: 3 }, row(0), row(1), row(2)]
    }

    /// The same per channel.
    pub fn point(&self, p: DVec3, c: &Covector, sink: &mut impl Sink) {
        let off = p - self.pivot;
        for i in 0..3 {
            sink.add(self.first + i as Slot, c.0[i]);
            for j in 0..3 {
                sink.add(self.first + 3 + (3 * i + j) as Slot, c.0[i] * off[j]);
            }
        }
    }

    /// How a field with these gradients (per channel) that is carried along changes at a fixed point, `-<∇f, v>` ([T] section 3), times `weight`.
    pub fn field(&self, p: DVec3, gradients: &[DVec3; 3], weight: Rgb, sink: &mut impl Sink) {
        let c = std::array::from_fn(|k| Rgb::from_fn(|c| -weight[c] * gradients[c][k]));
        self.point(p, &Covector(c), sink);
    }

    /// `<c, ṅ>` for a unit normal that goes with the matter: `ṅ = -Aᵀn + n <n,An>`.
    pub fn normal(&self, n: DVec3, c: &Covector, sink: &mut impl Sink) {
        let across = c.across(n);
        for i in 0..3 {
            for j in 0..3 {
                sink.add(self.first + 3 + (3 * i + j) as Slot, across.0[j] * -n[i]);
            }
        }
    }

    /// `value` times the rate at which volume grows, `tr A`.
    pub fn volume(&self, value: Rgb, sink: &mut impl Sink) {
        (0..3).for_each(|i| sink.add(self.first + 3 + 4 * i, value));
    }

    /// `value` times the rate at which area of unit normal n grows, `tr A - <n,An>`: the Jacobian of a surface point [T] section 2.
    pub fn area(&self, n: DVec3, value: Rgb, sink: &mut impl Sink) {
        for i in 0..3 {
            for j in 0..3 {
                let d = f64::from(u8::from(i == j)) - n[i] * n[j];
                sink.add(self.first + 3 + (3 * i + j) as Slot, value * d);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{DMat3, Dual, Real, V3};

    /// Collects `<form, slots>` for given slot values.
    struct Contract([f64; 12], f64);

    impl Sink for Contract {
        fn add(&mut self, slot: Slot, partial: Rgb) {
            self.1 += self.0[slot as usize] * partial[0];
        }
    }

    #[test]
    fn forms_are_the_derivatives_of_points_normals_and_areas() {
        let a = DMat3::from_cols_array(&[0.3, -0.2, 0.7, 0.1, 0.5, -0.4, 0.9, -0.6, 0.2]);
        let b = DVec3::new(0.4, -1.1, 0.6);
        let mover = Mover { first: 0, pivot: DVec3::new(1.0, 2.0, -1.0) };
        let mut slots = [0.0; 12];
        for i in 0..3 {
            slots[i] = b[i];
            for j in 0..3 {
                slots[3 + 3 * i + j] = a.row(i)[j];
            }
        }
        let p = DVec3::new(0.2, -0.7, 1.9);
        let (t1, t2) = (DVec3::new(1.0, 0.4, -0.2), DVec3::new(-0.3, 0.8, 0.5));
        let c = DVec3::new(0.7, -0.2, 1.3);
        let mut covector = Covector::default();
        covector.add(c, Rgb::ONE);

        let mut s = Contract(slots, 0.0);
        mover.point(p, &covector, &mut s);
        let v = b + a * (p - mover.pivot);
        assert!((s.1 - c.dot(v)).abs() < 1e-14);
        let by_forms: f64 =
            mover.forms(p, c).iter().flat_map(|f| (0..3).map(move |k| f.v[k] * slots[f.slot as usize + k])).sum();
        assert!((by_forms - c.dot(v)).abs() < 1e-14);

        // The cross product of moved tangents, differentiated.
        let moved = |t: DVec3| {
            let d = a * t;
            V3::new(Dual::<1> { v: t.x, d: [d.x] }, Dual { v: t.y, d: [d.y] }, Dual { v: t.z, d: [d.z] })
        };
        let area = moved(t1).cross(moved(t2));
        let n = area.normalize();
        let mut s = Contract(slots, 0.0);
        mover.normal(n.value(), &covector, &mut s);
        assert!((s.1 - c.dot(n.tangent())).abs() < 1e-13);
        let mut s = Contract(slots, 0.0);
        mover.area(n.value(), Rgb::ONE, &mut s);
        let size = area.length();
        assert!((s.1 - size.d[0] / size.value()).abs() < 1e-13);
    }
}
