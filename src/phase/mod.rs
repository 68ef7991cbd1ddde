//! Phase functions: the angular density of scattering in a medium.
//!
//! `mu` is the cosine between the two propagation directions ([T] section 0); functions take `1 - mu`, which keeps its
//! digits in the forward peak. Densities are per unit solid angle and integrate to 1, so `eval` is also the density of
//! `sample` and the sample weight is 1.

pub mod hg;

use crate::math::{DVec3, Real, gradient, warp};
use std::f64::consts::PI;

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Phase {
    Isotropic,
    /// Henyey–Greenstein with mean cosine `g`, |g| < 1.
    Hg {
        g: f64,
    },
}

/// `1 - cos` of the angle between two unit vectors, exact near 0 ([T] section 9).
pub fn one_minus_cos(a: DVec3, b: DVec3) -> f64 {
    0.5 * (a - b).length_squared()
}

impl Phase {
    /// Density per unit solid angle.
    pub fn eval(&self, one_minus_mu: f64) -> f64 {
        match *self {
            Phase::Isotropic => 0.25 / PI,
            Phase::Hg { g } => hg::eval(g, one_minus_mu),
        }
    }

    /// `(f, df/dg)` at fixed directions [T] (56); 0 where there is no g.
    pub fn eval_with_dg(&self, one_minus_mu: f64) -> (f64, f64) {
        match *self {
            Phase::Isotropic => (0.25 / PI, 0.0),
            Phase::Hg { g } => {
                let (f, [dg]) = gradient([g], |[g]| hg::eval(g, one_minus_mu.into()));
                (f, dg)
            }
        }
    }

    /// `(f, df/d(1-mu))` [T] (56).
    pub fn eval_with_slope(&self, one_minus_mu: f64) -> (f64, f64) {
        match *self {
            Phase::Isotropic => (0.25 / PI, 0.0),
            Phase::Hg { g } => {
                let (f, [d]) = gradient([one_minus_mu], |[m]| hg::eval(g.into(), m));
                (f, d)
            }
        }
    }

    /// New propagation direction for the old one `w`; drawn with density `eval`. Second value: `1 - mu`.
    pub fn sample(&self, w: DVec3, u: f64, v: f64) -> (DVec3, f64) {
        match *self {
            Phase::Isotropic => {
                let d = warp::sphere(u, v);
                (d, one_minus_cos(w, d))
            }
            Phase::Hg { g } => {
                let (m, sin) = hg::sample(g, u);
                let (s, c) = (2.0 * PI * v).sin_cos();
                // Renormalise: the frame's error must not grow over thousands of scatterings.
                let d = warp::to_world(w, DVec3::new(sin * c, sin * s, 1.0 - m)).normalize();
                (d, m)
            }
        }
    }
}

/// Generic form, for derivatives in direction and g together.
pub fn eval_generic<R: Real>(g: Option<R>, one_minus_mu: R) -> R {
    match g {
        None => R::from(0.25 / PI),
        Some(g) => hg::eval(g, one_minus_mu),
    }
}
