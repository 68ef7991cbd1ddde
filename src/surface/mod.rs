//! Surface scattering. Directions point away from the surface; `cos` factors are part of `eval`.

use crate::math::{DVec3, Rgb, warp};
use crate::params::Slot;
use std::f64::consts::PI;

#[derive(Clone, Debug)]
pub enum Surface {
    /// Lambertian reflectance `rho`; reflects on the front only unless `two_sided`.
    Diffuse { reflectance: Rgb, two_sided: bool, slot: Slot },
    /// Index-matched: light passes unchanged; separates media.
    Null,
}

impl Surface {
    pub fn is_null(&self) -> bool {
        matches!(self, Surface::Null)
    }

    /// `f_s(wi, wo) |cos wo| / rho`: the value with the reflectance taken out; per unit solid angle of `wo`.
    /// `n` is the geometric normal (front side).
    pub fn eval_unit(&self, n: DVec3, wi: DVec3, wo: DVec3) -> f64 {
        match self {
            Surface::Diffuse { two_sided, .. } => {
                let (ci, co) = (n.dot(wi), n.dot(wo));
                if ci * co > 0.0 && (*two_sided || ci > 0.0) { co.abs() / PI } else { 0.0 }
            }
            Surface::Null => 0.0,
        }
    }

    /// Whether light that arrives from `wi` is reflected at all (with some reflectance).
    pub fn reflects(&self, n: DVec3, wi: DVec3) -> bool {
        match self {
            Surface::Diffuse { two_sided, .. } => *two_sided || n.dot(wi) > 0.0,
            Surface::Null => false,
        }
    }

    /// A direction on the side of `wi`: by the cosine (density `eval_unit`), a share `uniform` of them uniform.
    pub fn sample(&self, n: DVec3, wi: DVec3, uniform: f64, u: f64, v: f64) -> DVec3 {
        let side = if n.dot(wi) >= 0.0 { n } else { -n };
        if u < uniform {
            let d = warp::sphere(u / uniform, v);
            return if d.dot(side) < 0.0 { -d } else { d };
        }
        warp::to_world(side, warp::cosine_hemisphere((u - uniform) / (1.0 - uniform), v)).normalize()
    }

    /// Density per solid angle of [`Surface::sample`], for a direction whose [`Surface::eval_unit`] is `eval`.
    pub fn pdf(eval: f64, uniform: f64) -> f64 {
        if eval > 0.0 { (1.0 - uniform) * eval + uniform / (2.0 * PI) } else { 0.0 }
    }
}
