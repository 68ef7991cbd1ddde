//! Smooth interfaces: the directions that leave them ([T] (39), (40)) and the share of light that is reflected ([T] (42)), for one index of refraction on either side.
//!
//! Everything is written in `ε = η - 1 = (n₁ - n₂)/n₂` and `k = 1 - η² = -ε (2 + ε)` ([T] section 9), so that nothing cancels where both sides are nearly alike: with c, q the
//! cosines of the angles with the normal, `q² = 1 - η² (1-c²)`, `r_s = -k / (ηc + q)²`, `r_p = k (c² (1 + η²) - η²) / (c + ηq)²`.

use super::{DVec3, Real, V3};

/// What an interface does to light that arrives at the cosine c > 0 from the side of index n₁.
#[derive(Clone, Copy, Debug)]
pub struct Interface<R> {
    /// `n₁/n₂`.
    pub eta: R,
    epsilon: R,
    c: R,
    /// Cosine of refraction; `None` where all is reflected.
    q: Option<R>,
}

impl<R: Real> Interface<R> {
    /// `c`: cosine of incidence in (0, 1]; `n1`: index on the side that light arrives at, `n2`: beyond.
    pub fn new(c: R, n1: R, n2: R) -> Self {
        let epsilon = (n1 - n2) / n2;
        let eta = n1 / n2;
        let q2 = eta * eta * c * c - epsilon * (epsilon + 2.0);
        let q = (q2.value() > 0.0).then(|| q2.sqrt());
        Interface { eta, epsilon, c, q }
    }

    /// Unpolarised reflectance F [T] (42); 1 in total reflection.
    pub fn reflectance(&self) -> R {
        let Some(q) = self.q else { return R::one() };
        let (eta, c) = (self.eta, self.c);
        let k = -(self.epsilon * (self.epsilon + 2.0));
        let s = k / (eta * c + q).sqr();
        let p = k * (c * c * (eta * eta + 1.0) - eta * eta) / (c + eta * q).sqr();
        (s * s + p * p) * 0.5
    }

    /// Cosine of refraction.
    pub fn cos_refracted(&self) -> Option<R> {
        self.q
    }

    /// a of the refracted direction `η d + a n` of one that travels along d against the normal n, [T] (40); `None` in total reflection.
    pub fn bend(&self) -> Option<R> {
        Some(self.epsilon * (self.epsilon + 2.0) / (self.eta * self.c + self.q?))
    }

    /// That direction.
    pub fn refract(&self, d: V3<R>, n: V3<R>) -> Option<V3<R>> {
        Some(d + d * self.epsilon + n * self.bend()?)
    }
}

/// A function of the cosine c and of η, with its slopes by both.
#[derive(Clone, Copy, Debug)]
pub struct Sloped {
    pub v: f64,
    pub by_c: f64,
    pub by_eta: f64,
}

impl Interface<f64> {
    /// F [T] (42) with its slopes: with `D = ηc + q` and `E = c + ηq`, `q_c = η² c/q`, `q_η = -η (1-c²)/q`; 0 in total reflection.
    pub fn sloped_reflectance(&self) -> Sloped {
        let Some(q) = self.q else { return Sloped { v: 1.0, by_c: 0.0, by_eta: 0.0 } };
        let (eta, c) = (self.eta, self.c);
        let k = -(self.epsilon * (self.epsilon + 2.0));
        let (sum, s2) = (eta * eta + 1.0, 1.0 - c * c);
        let (d, e) = (eta * c + q, c + eta * q);
        let m = c * c * sum - eta * eta;
        let s = k / (d * d);
        let p = k * m / (e * e);
        // ln D by c is η/q.
        let s_c = -2.0 * s * eta / q;
        let s_eta = -2.0 * (eta / (d * d) + s * (c - eta * s2 / q) / d);
        let p_c = 2.0 * (k * c * sum / (e * e) - p * (1.0 + eta * eta * eta * c / q) / e);
        let p_eta = -2.0 * (eta * (m + k * s2) / (e * e) + p * (q - eta * eta * s2 / q) / e);
        Sloped { v: 0.5 * (s * s + p * p), by_c: s * s_c + p * p_c, by_eta: s * s_eta + p * p_eta }
    }

    /// [`Interface::bend`] [T] (40) with its slopes; `None` in total reflection.
    pub fn sloped_bend(&self) -> Option<Sloped> {
        let (q, a) = (self.q?, self.bend()?);
        Some(Sloped { v: a, by_c: -a * self.eta / q, by_eta: self.c + self.eta * (1.0 - self.c * self.c) / q })
    }
}

/// The mirrored direction [T] (39) of one that travels along d; either side of n.
pub fn reflect(d: DVec3, n: DVec3) -> DVec3 {
    (d - n * (2.0 * n.dot(d))).normalize()
}

/// Unpolarised reflectance of a conductor of index `eta - i k` at the cosine c, seen from a vacuum.
pub fn conductor<R: Real>(c: R, eta: R, k: R) -> R {
    // Born and Wolf, section 14.2: a and b are the real and imaginary part of the refracted wave's normal component; ab = eta k.
    let (c2, s2) = (c * c, R::one() - c * c);
    let t = eta * eta - k * k - s2;
    let both = (t * t + eta * eta * k * k * 4.0).sqrt();
    let a = if t.value() > 0.0 {
        ((both + t) * 0.5).sqrt()
    } else if both.value() > 0.0 {
        eta * k / ((both - t) * 0.5).sqrt()
    } else {
        R::zero()
    };
    let rs = (both + c2 - a * c * 2.0) / (both + c2 + a * c * 2.0);
    let rp = (c2 * both + s2 * s2 - a * c * s2 * 2.0) / (c2 * both + s2 * s2 + a * c * s2 * 2.0);
    rs * (rp + 1.0) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Dual;

    fn reflectance(c: f64, n1: f64, n2: f64) -> f64 {
        Interface::new(c, n1, n2).reflectance()
    }

    #[test]
    fn normal_incidence_and_limits() {
        assert!((reflectance(1.0, 1.0, 1.5) - 0.04).abs() < 1e-15);
        assert!((reflectance(1.0, 1.5, 1.0) - 0.04).abs() < 1e-15);
        assert_eq!(reflectance(0.3, 1.4, 1.4), 0.0);
        // Beyond the critical angle all of it; at grazing almost all.
        assert_eq!(reflectance(0.5, 1.5, 1.0), 1.0);
        assert!((reflectance(1e-9, 1.0, 1.5) - 1.0).abs() < 1e-8);
        // Brewster's angle: only one polarisation is left.
        let c = 1.0 / (1.0f64 + 1.5 * 1.5).sqrt();
        let s = (1.0f64 - 1.5 * 1.5) / (1.0 + 1.5 * 1.5);
        assert!((reflectance(c, 1.0, 1.5) - 0.5 * s * s).abs() < 1e-14);
        // The same both ways.
        let q = Interface::new(0.7, 1.0, 1.5).cos_refracted().unwrap();
        assert!((reflectance(0.7, 1.0, 1.5) - reflectance(q, 1.5, 1.0)).abs() < 1e-15);
    }

    #[test]
    fn nearly_equal_indices_keep_their_digits() {
        // STABILITY dielectric-*: a clear slab, R = 2F/(1+F).
        let slab = |c: f64, n: f64| {
            let f = Interface::new(Dual::constant(c), Dual::<1>::constant(1.0), Dual::variable(n, 0)).reflectance();
            f * 2.0 / (f + 1.0)
        };
        let near = |a: f64, b: f64, digits: f64| assert!((a / b - 1.0).abs() < digits, "{a} {b}");
        let r = slab(1.0, 1.0000001);
        near(r.v, 4.9999995e-15, 1e-7);
        near(r.d[0], 9.9999985e-08, 1e-7);
        let r = slab(1e-3, 1.0001);
        near(r.v, 0.8596187977, 1e-9);
        near(r.d[0], 691.39368, 1e-7);
    }

    #[test]
    fn slopes_are_those_of_dual_numbers() {
        for (c, n1, n2) in [
            (0.9, 1.0, 1.5),
            (0.03, 1.0, 1.33),
            (0.8, 1.5, 1.0),
            (0.746, 1.5, 1.0),
            (0.5, 1.0, 1.0000001),
            (1.0, 2.4, 1.3),
        ] {
            let eta = Dual::<2>::variable(n1 / n2, 1);
            let dual = Interface::new(Dual::variable(c, 0), eta, Dual::constant(1.0));
            let own = Interface::new(c, n1, n2);
            let (f, a) = (own.sloped_reflectance(), own.sloped_bend().unwrap());
            for (x, y) in [(f, dual.reflectance()), (a, dual.bend().unwrap())] {
                for (x, y) in [(x.v, y.v), (x.by_c, y.d[0]), (x.by_eta, y.d[1])] {
                    // η - 1 is exact from both indices only.
                    let digits = if (n1 / n2 - 1.0).abs() < 1e-3 { 1e-8 } else { 1e-12 };
                    assert!((x - y).abs() <= digits * y.abs() + 1e-15, "{c} {n1} {n2}: {x} {y}");
                }
            }
        }
        let total = Interface::new(0.5, 1.5, 1.0);
        assert!(total.sloped_bend().is_none() && total.sloped_reflectance().v == 1.0);
    }

    #[test]
    fn directions_are_unit_and_obey_snell() {
        let n = DVec3::new(0.2, -0.4, 0.9).normalize();
        for (d, n1, n2) in [(DVec3::new(0.5, 0.3, -0.7), 1.0, 1.5), (DVec3::new(-0.1, 0.4, -0.9), 2.4, 1.3)] {
            let d = d.normalize();
            let c = -n.dot(d);
            let t = Interface::new(c, n1, n2).refract(V3::constant(d), V3::constant(n)).unwrap().value();
            assert!((t.length() - 1.0).abs() < 1e-14);
            assert!((n.cross(d) * n1 - n.cross(t) * n2).length() < 1e-14);
            assert!((reflect(d, n).dot(n) - c).abs() < 1e-14);
        }
    }

    #[test]
    fn conductors() {
        // A dielectric is a conductor without absorption; one that absorbs without end is a mirror.
        for c in [0.1, 0.5, 1.0] {
            assert!((conductor(c, 1.5, 0.0) - reflectance(c, 1.0, 1.5)).abs() < 1e-12);
            assert!(conductor(c, 1.0, 1e9) > 1.0 - 1e-7);
        }
        // ((n-1)² + k²) / ((n+1)² + k²).
        let f: f64 = conductor(1.0, 0.2, 3.9);
        assert!((f - (0.64 + 15.21) / (1.44 + 15.21)).abs() < 1e-14);
    }
}
