//! Ray parameters of crossings, generic over `Real`: the formulas that say *where*, and their derivatives.
//!
//! `w` need not be a unit vector: `t` counts in lengths of `w`. No formula here has an absolute tolerance.

use crate::math::{Real, V3};

/// Where the line `o + t w` meets the plane of a triangle: `t = <N, v0 - o> / <N, w>`, `N = (v1-v0) x (v2-v0)`.
/// Infinite or NaN for a line parallel to the plane.
pub fn plane_t<R: Real>(v0: V3<R>, v1: V3<R>, v2: V3<R>, o: V3<R>, w: V3<R>) -> R {
    let n = (v1 - v0).cross(v2 - v0);
    n.dot(v0 - o) / n.dot(w)
}

/// Weights `(b1, b2)` of `v1` and `v2` at `v0 + q`, `q` in the triangle's plane; the weight of `v0` is `1 - b1 - b2`.
pub fn barycentric<R: Real>(v0: V3<R>, v1: V3<R>, v2: V3<R>, q: V3<R>) -> (R, R) {
    let (e1, e2) = (v1 - v0, v2 - v0);
    let n = e1.cross(e2);
    let scale = n.length_squared().recip();
    (q.cross(e2).dot(n) * scale, e1.cross(q).dot(n) * scale)
}

/// Both crossings `t_near <= t_far` of the line `o + t w` with a sphere; `None` if it misses or touches.
///
/// The discriminant is formed from the offset of the line across `w`, so that a far sphere loses no digits, and the
/// root that would cancel comes from the product of the roots.
pub fn sphere_roots<R: Real>(center: V3<R>, radius: R, o: V3<R>, w: V3<R>) -> Option<[R; 2]> {
    let l = o - center;
    let a = w.length_squared().recip();
    let b = l.dot(w) * a;
    let across = l - w * b;
    let disc = (radius.sqr() - across.length_squared()) * a;
    if disc.value() <= 0.0 || disc.value().is_nan() {
        return None;
    }
    let product = (l.length_squared() - radius.sqr()) * a;
    let root = disc.sqrt();
    if b.value() > 0.0 {
        let q = -(b + root);
        Some([q, product / q])
    } else {
        let q = root - b;
        Some([product / q, q])
    }
}

/// The other crossing of a line whose origin lies ON the sphere (up to rounding): `t = -2 <l, w> / <w, w>` with `l` put
/// back on the sphere. Positive exactly if `w` points inward, however small the sphere and however far its centre.
pub fn sphere_other_root<R: Real>(center: V3<R>, radius: R, o: V3<R>, w: V3<R>) -> R {
    let l = o - center;
    l.dot(w) * (radius / l.length()) * (-2.0) / w.length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::real::gradient;
    use crate::math::{DVec3, Dual};

    fn v(x: f64, y: f64, z: f64) -> V3<f64> {
        V3::constant(DVec3::new(x, y, z))
    }

    #[test]
    fn a_far_sphere_keeps_its_digits() {
        // Radius 1e-3 seen from 1e5: b^2 - c would lose everything (1e10 against 1e-6).
        let [near, far] = sphere_roots(v(0.0, 0.0, 1e5), 1e-3, v(5e-4, 0.0, 0.0), v(0.0, 0.0, 1.0)).unwrap();
        let half = 1e-3 * 0.75f64.sqrt();
        assert!((near - (1e5 - half)).abs() < 2e-11 && (far - (1e5 + half)).abs() < 2e-11);
        assert!(sphere_roots(v(0.0, 0.0, 1e5), 1e-3, v(1.0001e-3, 0.0, 0.0), v(0.0, 0.0, 1.0)).is_none());
    }

    #[test]
    fn from_the_centre_and_with_a_long_direction() {
        assert_eq!(sphere_roots(v(1.0, 2.0, 3.0), 2.0, v(1.0, 2.0, 3.0), v(0.0, 4.0, 0.0)), Some([-0.5, 0.5]));
    }

    #[test]
    fn derivatives_agree_with_central_differences() {
        // Inputs: centre (0..3), radius (3), origin (4..7), direction (7..10).
        let x = [0.2, -0.1, 3.0, 0.8, 0.1, 0.2, -0.3, 0.05, -0.02, 1.1];
        fn split<R: Real>(x: [R; 10]) -> (V3<R>, R, V3<R>, V3<R>) {
            (V3::new(x[0], x[1], x[2]), x[3], V3::new(x[4], x[5], x[6]), V3::new(x[7], x[8], x[9]))
        }
        fn all<R: Real>(x: [R; 10]) -> [R; 3] {
            let (c, r, o, w) = split(x);
            let [near, far] = sphere_roots(c, r, o, w).unwrap();
            let (a, b) = (V3::constant(DVec3::new(1.0, 0.3, 0.1)), V3::constant(DVec3::new(-0.2, 1.0, 0.3)));
            [near, far, plane_t(c, c + w + a, c + b * r, o, w)]
        }
        for k in 0..3 {
            let (_, d) = gradient(x, |x: [Dual<10>; 10]| all(x)[k]);
            for i in 0..10 {
                let h = 1e-5;
                let (mut a, mut b) = (x, x);
                a[i] += h;
                b[i] -= h;
                let fd = (all(a)[k] - all(b)[k]) / (2.0 * h);
                assert!((fd - d[i]).abs() < 1e-7 * (1.0 + fd.abs()), "{k} {i}: {fd} {}", d[i]);
            }
        }
    }
}
