//! Surface scattering. Directions point away from the surface; `cos` factors are part of `eval`.

pub mod microfacet;
pub mod rough;
pub mod upright;

use crate::math::fresnel::{self, Interface};
use crate::math::{DVec3, Rgb, V3, warp};
use crate::params::{ParamSet, Slot};
use rough::Rough;
use std::f64::consts::PI;

/// The normals at a point of a surface, both unit and on the front side.
#[derive(Clone, Copy, Debug)]
pub struct Normals {
    pub face: DVec3,
    pub shading: DVec3,
}

impl Normals {
    /// The one to shade by for light toward `wi`: the face's own where the other would have it come from the wrong side.
    fn of(&self, wi: DVec3) -> DVec3 {
        if self.face.dot(wi) * self.shading.dot(wi) > 0.0 { self.shading } else { self.face }
    }

    /// The same for two directions; `None` where it and the face do not agree on whether light goes through.
    fn toward(&self, wi: DVec3, wo: DVec3) -> Option<DVec3> {
        let n = self.of(wi);
        (self.face.dot(wo) * n.dot(wo) > 0.0).then_some(n)
    }
}

/// What a surface does to light that arrives from one direction and leaves along another.
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    /// `f_s |cos wo|` per unit solid angle of wo is `f x tint`; of a diffuse surface without its reflectance.
    pub f: f64,
    pub tint: Rgb,
    /// Density per unit solid angle with which wo is drawn.
    pub pdf: f64,
}

impl Lobe {
    pub const NONE: Lobe = Lobe { f: 0.0, tint: Rgb::ONE, pdf: 0.0 };
}

#[derive(Clone, Debug)]
pub enum Surface {
    /// Lambertian reflectance `rho`; reflects on the front only unless `two_sided`.
    Diffuse { reflectance: Rgb, two_sided: bool, slot: Slot },
    /// A smooth interface: mirrored and refracted light only. `interior`: index behind the front side, `exterior`: before it.
    Dielectric { interior: f64, exterior: f64, slot: Slot },
    /// A smooth metal of index `eta - i k`, seen from a vacuum; mirrors on the front only unless `two_sided`. An index of 0 mirrors all.
    Conductor { eta: Rgb, k: Rgb, two_sided: bool, slot: Slot },
    /// A rough interface or metal: light is scattered at microfacets.
    Rough(Rough),
    /// Index-matched: light passes unchanged; separates media.
    Null,
}

/// Light that leaves a smooth surface along one ray.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub w: DVec3,
    /// Radiance against `w` over that against the ray that came.
    pub weight: Rgb,
    /// Whether it went through.
    pub through: bool,
}

impl Surface {
    pub fn is_null(&self) -> bool {
        matches!(self, Surface::Null)
    }

    /// Whether it has no density of directions.
    pub fn is_smooth(&self) -> bool {
        matches!(self, Surface::Dielectric { .. } | Surface::Conductor { .. })
    }

    /// Whether its index is among the parameters.
    pub fn refracts_by(&self, params: &ParamSet) -> bool {
        match self {
            Surface::Dielectric { slot, .. } => params.block_active(*slot, 2),
            Surface::Conductor { slot, .. } => params.block_active(*slot, 6),
            _ => false,
        }
    }

    /// The mirrored and the refracted ray of one that travels along w, [T] 6.1; weights include F, 1 - F and, as radiance asks, η². `n` is a normal on the front side.
    pub fn rays(&self, n: DVec3, w: DVec3) -> [Option<Ray>; 2] {
        let front = n.dot(w) < 0.0;
        let (side, c) = if front { (n, -n.dot(w)) } else { (-n, n.dot(w)) };
        let mirrored = |f: Rgb| (!f.is_zero()).then(|| Ray { w: fresnel::reflect(w, n), weight: f, through: false });
        match self {
            Surface::Dielectric { interior, exterior, .. } => {
                let (n1, n2) = if front { (*exterior, *interior) } else { (*interior, *exterior) };
                let i = Interface::new(c, n1, n2);
                let f = i.reflectance();
                let refracted = i.refract(V3::constant(w), V3::constant(side)).map(|t| Ray {
                    w: t.value().normalize(),
                    weight: Rgb::splat((1.0 - f) * i.eta * i.eta),
                    through: true,
                });
                [mirrored(Rgb::splat(f)), refracted]
            }
            Surface::Conductor { eta, k, two_sided, .. } if front || *two_sided => {
                [mirrored(Rgb::from_fn(|i| fresnel::conductor(c, eta[i], k[i]))), None]
            }
            _ => [None, None],
        }
    }

    /// `f_s(wi, wo) |cos wo| / rho`: the value with the reflectance taken out; per unit solid angle of `wo`.
    /// `n` is the geometric normal (front side).
    pub fn eval_unit(&self, n: DVec3, wi: DVec3, wo: DVec3) -> f64 {
        match self {
            Surface::Diffuse { two_sided, .. } => {
                let (ci, co) = (n.dot(wi), n.dot(wo));
                if ci * co > 0.0 && (*two_sided || ci > 0.0) { co.abs() / PI } else { 0.0 }
            }
            _ => 0.0,
        }
    }

    /// Whether light that arrives from `wi` is reflected at all (with some reflectance).
    pub fn reflects(&self, n: DVec3, wi: DVec3) -> bool {
        match self {
            Surface::Diffuse { two_sided, .. } | Surface::Conductor { two_sided, .. } => *two_sided || n.dot(wi) > 0.0,
            Surface::Dielectric { .. } => true,
            Surface::Rough(r) => r.scatters(n, wi),
            Surface::Null => false,
        }
    }

    /// Value and density for a pair of directions, a share `uniform` of the directions that leave a diffuse surface being uniform. Smooth surfaces have none.
    pub fn eval(&self, n: Normals, wi: DVec3, wo: DVec3, uniform: f64) -> Lobe {
        match self {
            Surface::Rough(r) => r.eval(n, wi, wo),
            _ => {
                let f = self.eval_unit(n.shading, wi, wo);
                Lobe { f, tint: Rgb::ONE, pdf: Surface::pdf(f, uniform) }
            }
        }
    }

    /// Whether light goes through it, turned.
    pub fn is_transparent(&self) -> bool {
        match self {
            Surface::Dielectric { .. } => true,
            Surface::Rough(r) => r.is_transparent(),
            _ => false,
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
