//! Corners: triangles whose corners are parameters themselves, three slots a corner.
//!
//! A point of the triangle goes with the affine mix of its corners, `v(p) = Σ b_i(p) v_i` with the barycentric weights b, whose gradients in its plane are
//! `∇b_i = N × e_i / |N|²` (e_i: the opposite side, N the cross product of two sides). So its surface gradient is `Σ v_i ∇b_iᵀ`, and from `N = Σ p_i × p_{i+1}`
//!
//! * area grows at the rate `<n, Ṅ>/|N| = Σ <v_i, ∇b_i>`: the Jacobian of a surface point [T] section 2;
//! * the normal turns with `ṅ = (1 - n nᵀ) Ṅ/|N| = -Σ ∇b_i <n, v_i>`.

use super::mover::{Covector, Partial};
use super::{Sink, Slot};
use crate::math::{DVec3, Rgb};

/// Slots and places of a triangle's corners.
#[derive(Clone, Copy, Debug)]
pub struct Corners {
    slots: [Slot; 3],
    /// The first corner.
    origin: DVec3,
    /// ∇b, 1/length.
    slopes: [DVec3; 3],
}

impl Corners {
    /// `slots`: the first of three a corner.
    pub fn new(slots: [Slot; 3], [a, b, c]: [DVec3; 3]) -> Self {
        let n = (b - a).cross(c - a);
        let scale = n.length_squared().recip();
        let (by_b, by_c) = (n.cross(a - c) * scale, n.cross(b - a) * scale);
        Corners { slots, origin: a, slopes: [-(by_b + by_c), by_b, by_c] }
    }

    /// Barycentric weights of a point of the triangle: they sum to 1.
    fn weights(&self, p: DVec3) -> [f64; 3] {
        let off = p - self.origin;
        let (b, c) = (self.slopes[1].dot(off), self.slopes[2].dot(off));
        [1.0 - b - c, b, c]
    }

    /// `<c, v(p)>`.
    pub fn forms(&self, p: DVec3, c: DVec3) -> [Partial; 3] {
        let b = self.weights(p);
        std::array::from_fn(|i| Partial { slot: self.slots[i], v: c * b[i], len: 3 })
    }

    /// Hands `Σ_k form(i)_k v_i,k` out.
    fn add(&self, form: impl Fn(usize) -> Covector, sink: &mut impl Sink) {
        for (i, &slot) in self.slots.iter().enumerate() {
            let form = form(i);
            (0..3).for_each(|k| sink.add(slot + k as Slot, form.0[k]));
        }
    }

    /// `<c, v(p)>` per channel.
    pub fn point(&self, p: DVec3, c: &Covector, sink: &mut impl Sink) {
        let b = self.weights(p);
        self.add(|i| c.scaled(b[i]), sink);
    }

    /// `<c, ṅ>`, n one of the triangle's two unit normals.
    pub fn normal(&self, n: DVec3, c: &Covector, sink: &mut impl Sink) {
        let form = |i: usize| {
            let mut form = Covector::default();
            form.add(n, -c.dot(self.slopes[i]));
            form
        };
        self.add(form, sink);
    }

    /// `value` times the rate at which area grows.
    pub fn area(&self, value: Rgb, sink: &mut impl Sink) {
        let form = |i: usize| {
            let mut form = Covector::default();
            form.add(self.slopes[i], value);
            form
        };
        self.add(form, sink);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Dual, Real, V3};

    /// Collects `<form, slots>` for given slot values.
    struct Contract([f64; 9], f64);

    impl Sink for Contract {
        fn add(&mut self, slot: Slot, partial: Rgb) {
            self.1 += self.0[slot as usize] * partial[0];
        }
    }

    #[test]
    fn forms_are_the_derivatives_of_points_normals_and_areas() {
        let corners = [DVec3::new(0.3, -0.2, 0.7), DVec3::new(1.1, 0.5, -0.4), DVec3::new(0.9, -1.6, 0.2)];
        let slots = [0.4, -1.1, 0.6, 0.2, 0.7, -0.3, -0.5, 0.1, 0.8];
        let triangle = Corners::new([0, 3, 6], corners);
        let c = DVec3::new(0.7, -0.2, 1.3);
        let mut covector = Covector::default();
        covector.add(c, Rgb::ONE);
        let moved: [V3<Dual<1>>; 3] = std::array::from_fn(|i| {
            let x = |k: usize| Dual::<1> { v: corners[i][k], d: [slots[3 * i + k]] };
            V3::new(x(0), x(1), x(2))
        });
        let [p, q, r] = moved;

        let b = [0.2, 0.5, 0.3];
        let point = p * Dual::from(b[0]) + q * Dual::from(b[1]) + r * Dual::from(b[2]);
        let mut s = Contract(slots, 0.0);
        triangle.point(point.value(), &covector, &mut s);
        assert!((s.1 - c.dot(point.tangent())).abs() < 1e-14);
        let forms = triangle.forms(point.value(), c);
        let by_forms: f64 = forms.iter().flat_map(|f| (0..3).map(|k| f.v[k] * slots[f.slot as usize + k])).sum();
        assert!((by_forms - s.1).abs() < 1e-14);

        let area = (q - p).cross(r - p);
        for sign in [1.0, -1.0] {
            let n = area.normalize() * Dual::from(sign);
            let mut s = Contract(slots, 0.0);
            triangle.normal(n.value(), &covector, &mut s);
            assert!((s.1 - c.dot(n.tangent())).abs() < 1e-13);
        }
        let mut s = Contract(slots, 0.0);
        triangle.area(Rgb::ONE, &mut s);
        let size = area.length();
        assert!((s.1 - size.d[0] / size.value()).abs() < 1e-13);
    }
}
