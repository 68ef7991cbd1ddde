//! Rough interfaces: mirrored and refracted light at microfacets, scattered once (Walter et al. 2007), for a dielectric or a conductor.
//!
//! With n the surface's normal, m that of the microfacet which takes one direction to the other, c = <wi,m>, q = -<wo,m>, G = G1(wi) G1(wo):
//!
//! ```text
//! mirrored   f |cos wo| = F D G / (4 |<wi,n>|),                            m ~ wi + wo
//! refracted  f |cos wo| = (1-F) n₁² c q D G / (|<wi,n>| |h|²),             m ~ h = n₁ wi + n₂ wo
//! ```
//!
//! for radiance that arrives from wo and leaves along wi, n₁ being the index on the side of wi: it holds the factor (n₁/n₂)² of [T] 6.1, so that `f(wi,wo) / n₁² = f(wo,wi) / n₂²`.
//! c and q are cosines of one microfacet: `1 - F = 2ηcq [(ηc+q)^-2 + (c+ηq)^-2]` needs neither a square root nor a subtraction, and goes to 0 with q.
//!
//! All of it is a smooth function of α and of the indices at given directions (it ends at q = 0 and c = 0 with the value 0, at upright facets with a jump: [`super::upright`]): derivatives are scores
//! `∂f/f`, bounded in the second moment because f ~ q² there and `∂f ~ q`. Directions are drawn by visible normals and by F, densities are held ([T] section 4).

use super::microfacet::Distribution;
use super::{Lobe, Normals};
use crate::math::fresnel::{self, Interface};
use crate::math::{DVec3, Dual, Real, Rgb, V3, warp};
use crate::params::{Covector, ParamSet, Slot};

/// A rough surface.
#[derive(Clone, Debug)]
pub struct Rough {
    pub distribution: Distribution,
    /// Roughness, > 0: the root mean square slope of microfacets is α/√2 for Beckmann.
    pub alpha: f64,
    pub matter: Matter,
    /// Slot of α.
    pub alpha_slot: Slot,
    /// First slot of the indices: interior and exterior, or eta and k, per channel.
    pub index_slot: Slot,
}

/// `∂ ln (f |cos wo|)`, per channel: what the value asks of how both directions and the normal turn.
#[derive(Clone, Copy, Debug, Default)]
pub struct Slopes {
    pub wi: Covector,
    pub wo: Covector,
    pub n: Covector,
}

impl Slopes {
    #[must_use]
    pub fn weighed(&self, value: Rgb) -> Slopes {
        Slopes { wi: self.wi.weighed(value), wo: self.wo.weighed(value), n: self.n.weighed(value) }
    }

    /// Of a factor, in channels of these weights. Variables: wi, wo, n.
    fn add(&mut self, x: Dual<9>, weight: Rgb) {
        if x.v > 0.0 {
            let by = |k: usize| DVec3::new(x.d[k], x.d[k + 1], x.d[k + 2]) / x.v;
            self.wi.add(by(0), weight);
            self.wo.add(by(3), weight);
            self.n.add(by(6), weight);
        }
    }
}

/// What it is made of.
#[derive(Clone, Copy, Debug)]
pub enum Matter {
    /// Indices behind the front side and before it.
    Dielectric { interior: f64, exterior: f64 },
    /// Index `eta - i k`, seen from a vacuum; on the front only unless `two_sided`.
    Conductor { eta: Rgb, k: Rgb, two_sided: bool },
}

/// Indices that differ by less, relatively, turn light by less than rounding can tell from a smooth interface.
pub const MATCHED: f64 = 1e-9;

impl Rough {
    /// Whether light goes through it.
    pub fn is_transparent(&self) -> bool {
        matches!(self.matter, Matter::Dielectric { .. })
    }

    /// Whether light that arrives from `wi` is scattered at all.
    pub fn scatters(&self, n: DVec3, wi: DVec3) -> bool {
        match self.matter {
            Matter::Dielectric { .. } => true,
            Matter::Conductor { two_sided, .. } => two_sided || n.dot(wi) > 0.0,
        }
    }

    /// Value and density for the pair of directions, both away from the surface.
    pub fn eval(&self, normals: Normals, wi: DVec3, wo: DVec3) -> Lobe {
        let Some(n) = normals.toward(wi, wo).filter(|&n| self.scatters(n, wi)) else { return Lobe::NONE };
        let [n, i, o] = [n, wi, wo].map(V3::constant);
        match self.matter {
            Matter::Dielectric { interior, exterior } => {
                let g = Facet::dielectric(self.distribution, self.alpha, [interior, exterior], n, i, o);
                g.map_or(Lobe::NONE, |g| Lobe { f: g.value(), tint: Rgb::ONE, pdf: g.share * g.seen * g.jacobian })
            }
            Matter::Conductor { eta, k, .. } => {
                let g = Facet::mirrored(self.distribution, self.alpha, n, i, o);
                let tint = |c: f64| Rgb::from_fn(|ch| fresnel::conductor(c, eta[ch], k[ch]));
                g.map_or(Lobe::NONE, |(g, c)| Lobe { f: g.value(), tint: tint(c), pdf: g.seen * g.jacobian })
            }
        }
    }

    /// A direction on either side for light toward `wi`, by visible normals and, of a dielectric, by F; density [`Rough::eval`]. `x` chooses the side.
    pub fn sample(&self, normals: Normals, wi: DVec3, u: f64, v: f64, x: f64) -> Option<DVec3> {
        let n = normals.of(wi);
        let side = if n.dot(wi) > 0.0 { n } else { -n };
        let (s, t) = warp::frame(side);
        let local = DVec3::new(s.dot(wi), t.dot(wi), side.dot(wi));
        if local.z <= 0.0 || !self.scatters(n, wi) {
            return None;
        }
        let m = warp::to_world(side, self.distribution.sample_visible(self.alpha, local, u, v));
        let c = m.dot(wi);
        if c <= 0.0 {
            return None;
        }
        let through = match self.matter {
            Matter::Conductor { .. } => None,
            Matter::Dielectric { interior, exterior } => {
                let [n1, n2] = if n.dot(wi) > 0.0 { [exterior, interior] } else { [interior, exterior] };
                let i = Interface::new(c, n1, n2);
                if x < i.reflectance() { None } else { i.refract(V3::constant(-wi), V3::constant(m)) }
            }
        };
        let (wo, passes) = match through {
            Some(t) => (t.value().normalize(), true),
            None => (fresnel::reflect(-wi, m), false),
        };
        // A second facet would stand in its way: what scatters once ends there.
        ((wo.dot(side) < 0.0) == passes).then_some(wo)
    }

    /// Whether any of its slots is active.
    pub fn is_active(&self, params: &ParamSet) -> bool {
        params.is_active(self.alpha_slot) || self.indices_active(params)
    }

    /// Behind its front side and before it, of glass.
    pub fn indices(&self) -> Option<[f64; 2]> {
        match self.matter {
            Matter::Dielectric { interior, exterior } => Some([interior, exterior]),
            Matter::Conductor { .. } => None,
        }
    }

    /// Whether its indices are among the parameters.
    pub fn indices_active(&self, params: &ParamSet) -> bool {
        params.block_active(self.index_slot, if self.is_transparent() { 2 } else { 6 })
    }

    /// How the value changes as directions and normal turn, which stay unit; `None` where it is 0.
    pub fn slopes(&self, normals: Normals, wi: DVec3, wo: DVec3) -> Option<Slopes> {
        let n = normals.toward(wi, wo).filter(|&n| self.scatters(n, wi))?;
        let [i, o, n] = [(wi, 0), (wo, 3), (n, 6)].map(|(v, first)| V3::<Dual<9>>::variable(v, first));
        let (alpha, mut s) = (Dual::constant(self.alpha), Slopes::default());
        match self.matter {
            Matter::Dielectric { interior, exterior } => {
                let indices = [interior, exterior].map(Dual::constant);
                s.add(Facet::dielectric(self.distribution, alpha, indices, n, i, o)?.value(), Rgb::ONE);
            }
            Matter::Conductor { eta, k, .. } => {
                let (g, c) = Facet::mirrored(self.distribution, alpha, n, i, o)?;
                s.add(g.value(), Rgb::ONE);
                for ch in 0..3 {
                    let f = fresnel::conductor(c, Dual::constant(eta[ch]), Dual::constant(k[ch]));
                    s.add(f, Rgb::channel(ch, 1.0));
                }
            }
        }
        Some(s)
    }

    /// `∂f / f` by slots, per channel, at given directions.
    pub fn scores(&self, normals: Normals, wi: DVec3, wo: DVec3, mut add: impl FnMut(Slot, Rgb)) {
        let Some(n) = normals.toward(wi, wo).filter(|&n| self.scatters(n, wi)) else { return };
        let [n, i, o] = [n, wi, wo].map(|v| {
            let [x, y, z] = v.to_array().map(Dual::<3>::constant);
            V3::new(x, y, z)
        });
        let alpha = Dual::variable(self.alpha, 0);
        let score = |x: f64, f: f64| if f > 0.0 { x / f } else { 0.0 };
        match self.matter {
            Matter::Dielectric { interior, exterior } => {
                let indices = [Dual::variable(interior, 1), Dual::variable(exterior, 2)];
                let Some(g) = Facet::dielectric(self.distribution, alpha, indices, n, i, o) else { return };
                let f = g.value();
                add(self.alpha_slot, Rgb::splat(score(f.d[0], f.v)));
                add(self.index_slot, Rgb::splat(score(f.d[1], f.v)));
                add(self.index_slot + 1, Rgb::splat(score(f.d[2], f.v)));
            }
            Matter::Conductor { eta, k, .. } => {
                let Some((g, c)) = Facet::mirrored(self.distribution, alpha, n, i, o) else { return };
                let f = g.value();
                add(self.alpha_slot, Rgb::splat(score(f.d[0], f.v)));
                for ch in 0..3 {
                    let f = fresnel::conductor(c, Dual::variable(eta[ch], 1), Dual::variable(k[ch], 2));
                    add(self.index_slot + ch as Slot, Rgb::channel(ch, score(f.d[1], f.v)));
                    add(self.index_slot + 3 + ch as Slot, Rgb::channel(ch, score(f.d[2], f.v)));
                }
            }
        }
    }
}

/// The factors of f |cos wo| at one microfacet.
pub(super) struct Facet<R> {
    /// F or 1 - F; of a conductor 1.
    share: R,
    /// Density of the normal among those that wi sees: `G1(wi) D c / |<wi,n>|`; D is left out until it is known ([`Facet::times`]).
    seen: R,
    /// Solid angle of normals per solid angle of wo.
    jacobian: R,
    /// G1(wo), and n₁²/n₂² of what is refracted.
    rest: R,
}

/// How the microfacet is turned: c and q, |h|², and its own cosine and squared sine with the surface's normal.
pub(super) struct Turned<R> {
    c: R,
    q: R,
    h2: R,
    tilt: R,
    sine2: R,
}

impl<R: Real> Facet<R> {
    pub(super) fn value(&self) -> R {
        self.share * self.seen * self.jacobian * self.rest
    }

    /// With facets so dense there.
    pub(super) fn times(self, density: R) -> Self {
        Facet { seen: self.seen * density, ..self }
    }

    /// What both kinds have in common: m = ± h/|h|, by the sign `turn`. Without D.
    fn new(
        d: Distribution,
        alpha: R,
        n: V3<R>,
        [wi, wo]: [V3<R>; 2],
        h: V3<R>,
        turn: f64,
    ) -> Option<(Self, Turned<R>)> {
        let h2 = h.length_squared();
        let (ci, co, up) = (n.dot(wi), n.dot(wo), n.dot(h));
        let front = if ci.value() > 0.0 { 1.0 } else { -1.0 };
        if h2.value().is_nan() || h2.value() <= 0.0 {
            return None;
        }
        let length = h2.sqrt();
        let c = wi.dot(h) * turn / length;
        let q = -(wo.dot(h) * turn / length);
        if c.value() <= 0.0 {
            return None;
        }
        // Sines from cross products: 1 - cos² has no digits left at small α.
        let sine2 = |v: V3<R>| n.cross(v).length_squared();
        let tilt = up * (front * turn) / length;
        let seen = d.visible(alpha, ci, sine2(wi)) * c / (ci * front);
        let facet = Facet { share: R::one(), seen, jacobian: R::one(), rest: d.visible(alpha, co, sine2(wo)) };
        Some((facet, Turned { c, q, h2, tilt, sine2: sine2(h) / h2 }))
    }

    /// With the cosine c.
    fn mirrored(d: Distribution, alpha: R, n: V3<R>, wi: V3<R>, wo: V3<R>) -> Option<(Self, R)> {
        let front = n.dot(wi).value();
        if front * n.dot(wo).value() <= 0.0 {
            return None;
        }
        let (facet, t) = Self::new(d, alpha, n, [wi, wo], wi + wo, 1.0)?;
        let facet = facet.times(d.density(alpha, t.tilt, t.sine2));
        Some((Facet { jacobian: R::one() / (t.c * 4.0), ..facet }, t.c))
    }

    fn dielectric(
        d: Distribution,
        alpha: R,
        [interior, exterior]: [R; 2],
        n: V3<R>,
        wi: V3<R>,
        wo: V3<R>,
    ) -> Option<Self> {
        let [n1, n2] = if n.dot(wi).value() > 0.0 { [exterior, interior] } else { [interior, exterior] };
        if n.dot(wi).value() * n.dot(wo).value() > 0.0 {
            let (facet, c) = Self::mirrored(d, alpha, n, wi, wo)?;
            return Some(Facet { share: Interface::new(c, n1, n2).reflectance(), ..facet });
        }
        let (facet, t) = Self::refracted(d, alpha, [n1, n2], n, [wi, wo])?;
        Some(facet.times(d.density(alpha, t.tilt, t.sine2)))
    }

    /// Without D: facets of any tilt. They look to the thinner side, or c and q have not both a sign that light takes.
    pub(super) fn refracted(
        d: Distribution,
        alpha: R,
        [n1, n2]: [R; 2],
        n: V3<R>,
        [wi, wo]: [V3<R>; 2],
    ) -> Option<(Self, Turned<R>)> {
        // n₁ wi + n₂ wo where both are nearly alike: nothing is lost but what the directions have lost already.
        let h = (wi + wo) * n1 + wo * (n2 - n1);
        let (facet, t) = Self::new(d, alpha, n, [wi, wo], h, if n1.value() > n2.value() { 1.0 } else { -1.0 })?;
        let (c, q) = (t.c, t.q);
        if q.value() <= 0.0 {
            return None;
        }
        let eta = n1 / n2;
        let share = eta * c * q * 2.0 * ((eta * c + q).sqr().recip() + (c + eta * q).sqr().recip());
        Some((Facet { share, jacobian: n2 * n2 * q / t.h2, rest: facet.rest * eta * eta, ..facet }, t))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;
    use std::f64::consts::PI;

    const N: Normals = Normals { face: DVec3::Z, shading: DVec3::Z };
    const KINDS: [Distribution; 2] = [Distribution::Beckmann, Distribution::Ggx];

    fn glass(distribution: Distribution, alpha: f64, interior: f64, exterior: f64) -> Rough {
        let matter = Matter::Dielectric { interior, exterior };
        Rough { distribution, alpha, matter, alpha_slot: 0, index_slot: 1 }
    }

    fn metal(distribution: Distribution, alpha: f64) -> Rough {
        let matter = Matter::Conductor { eta: Rgb([0.2, 1.1, 1.5]), k: Rgb([3.9, 2.5, 1.9]), two_sided: true };
        Rough { distribution, alpha, matter, alpha_slot: 0, index_slot: 1 }
    }

    fn at(cos: f64, phi: f64) -> DVec3 {
        let s = (1.0 - cos * cos).sqrt();
        DVec3::new(s * phi.cos(), s * phi.sin(), cos)
    }

    /// What is drawn has the density [`Rough::eval`] says, and `f/pdf` the mean `∫ f`: sums over the sphere against samples.
    #[test]
    fn densities_and_values_over_the_sphere() {
        for d in KINDS {
            for r in [glass(d, 0.3, 1.5, 1.0), glass(d, 0.5, 1.1, 1.4), metal(d, 0.4)] {
                for cos in [0.9, -0.9, 0.3, -0.35] {
                    let wi = at(cos, 0.4);
                    let (m, k) = (240, 200);
                    let mut sum = [0.0; 4];
                    for i in 0..m {
                        for j in 0..k {
                            let z = 1.0 - 2.0 * (i as f64 + 0.5) / m as f64;
                            let wo = at(z, 2.0 * PI * (j as f64 + 0.5) / k as f64);
                            let lobe = r.eval(N, wi, wo);
                            let through = f64::from(u8::from(z * cos < 0.0));
                            for (s, x) in sum.iter_mut().zip([lobe.pdf, lobe.pdf * wo.x, lobe.pdf * through, lobe.f]) {
                                *s += x * 4.0 * PI / (m * k) as f64;
                            }
                        }
                    }
                    // A share's standard error is 0.002 at most.
                    let n = 60_000;
                    let mut drawn = [0.0; 4];
                    let mut rng = Rng::keyed(3, 0, 0, 0);
                    for _ in 0..n {
                        let [u, v, x] = [(); 3].map(|()| rng.uniform());
                        let Some(wo) = r.sample(N, wi, u, v, x) else { continue };
                        let lobe = r.eval(N, wi, wo);
                        assert!(lobe.pdf > 0.0 && (wo.length() - 1.0).abs() < 1e-12, "{r:?} {wi} {wo} {lobe:?}");
                        let through = f64::from(u8::from(wo.z * cos < 0.0));
                        for (s, x) in drawn.iter_mut().zip([1.0, wo.x, through, lobe.f / lobe.pdf]) {
                            *s += x / f64::from(n);
                        }
                    }
                    for (a, b) in drawn.iter().zip(sum) {
                        assert!((a - b).abs() < 9e-3, "{r:?} {cos}: {drawn:?} {sum:?}");
                    }
                    assert!(sum[0] < 1.0 + 1e-3, "{sum:?}");
                }
            }
        }
    }

    /// `f(wi,wo) / n₁² = f(wo,wi) / n₂²`, with the cosines taken out.
    #[test]
    fn reciprocity() {
        let mut rng = Rng::keyed(5, 0, 0, 0);
        for d in KINDS {
            for r in [glass(d, 0.2, 1.6, 1.1), metal(d, 0.3)] {
                let mut tried = 0;
                while tried < 200 {
                    let [wi, wo] = [(); 2].map(|()| warp::sphere(rng.uniform(), rng.uniform()));
                    let (a, b) = (r.eval(N, wi, wo), r.eval(N, wo, wi));
                    let index2 = |w: DVec3| match r.matter {
                        Matter::Dielectric { interior, exterior } => {
                            if w.z > 0.0 {
                                exterior * exterior
                            } else {
                                interior * interior
                            }
                        }
                        Matter::Conductor { .. } => 1.0,
                    };
                    let (x, y) = (a.f / wo.z.abs() / index2(wi), b.f / wi.z.abs() / index2(wo));
                    assert!((x - y).abs() <= 1e-11 * x.max(y), "{r:?} {wi} {wo}: {x} {y}");
                    assert!((a.tint - b.tint).abs().max() < 1e-12);
                    tried += u32::from(x > 0.0);
                }
            }
        }
    }

    /// A surface that is nearly smooth loses nothing: F is mirrored, the rest refracted, near the critical angle and near equal indices too.
    #[test]
    fn a_little_roughness_is_a_smooth_surface() {
        let mut rng = Rng::keyed(6, 0, 0, 0);
        for d in KINDS {
            for (alpha, interior) in
                [(1e-3, 1.5), (1e-4, 2.4), (1e-3, 1.0 + 1e-7), (1e-3, 1.0 + 1e-5), (1e-2, 1.0 + 1e-8), (1e-3, 0.7)]
            {
                let r = glass(d, alpha, interior, 1.0);
                for cos in [1.0, 0.5, 0.2, -0.4, -0.75, -1.0] {
                    let wi = at(cos, 1.0);
                    let [n1, n2] = if cos > 0.0 { [1.0, interior] } else { [interior, 1.0] };
                    let (mut mirrored, mut kept) = (0.0, 0.0);
                    let n = 1500;
                    for _ in 0..n {
                        let Some(wo) = r.sample(N, wi, rng.uniform(), rng.uniform(), rng.uniform()) else { continue };
                        let lobe = r.eval(N, wi, wo);
                        let through = wo.z * cos < 0.0;
                        let weight = lobe.f / lobe.pdf * if through { (n2 / n1).powi(2) } else { 1.0 };
                        assert!(weight > 0.0 && weight <= 1.0 + 1e-12, "{r:?} {wi} {wo} {lobe:?}");
                        kept += weight / f64::from(n);
                        mirrored += if through { 0.0 } else { weight / f64::from(n) };
                    }
                    let f = Interface::new(cos.abs(), n1, n2).reflectance();
                    let lost = if alpha < 0.01 { 2e-3 } else { 0.005 };
                    assert!((kept - 1.0).abs() < lost, "{r:?} {cos}: {kept}");
                    // Five standard errors of a share.
                    assert!(
                        (mirrored - f).abs() < lost + 5.0 * (f * (1.0 - f) / f64::from(n)).sqrt(),
                        "{r:?} {cos}: {mirrored} {f}"
                    );
                }
            }
        }
    }

    /// As directions and normal turn about an axis: one by one against differences, all together nothing changes.
    #[test]
    fn slopes_against_differences() {
        let mut rng = Rng::keyed(8, 0, 0, 0);
        for d in KINDS {
            for r in [glass(d, 0.3, 1.5, 1.0), glass(d, 0.02, 1.2, 1.3), glass(d, 0.2, 0.8, 1.0), metal(d, 0.2)] {
                let mut tried = 0;
                while tried < 60 {
                    let [n, wi, axis] = [(); 3].map(|()| warp::sphere(rng.uniform(), rng.uniform()));
                    let normals = |n: DVec3| Normals { face: n, shading: n };
                    let [u, v, x] = [(); 3].map(|()| rng.uniform());
                    let Some(wo) = r.sample(normals(n), wi, u, v, x) else { continue };
                    let value = |wi: DVec3, wo: DVec3, n: DVec3| {
                        let lobe = r.eval(normals(n), wi, wo);
                        lobe.tint * lobe.f
                    };
                    let f = value(wi, wo, n);
                    if f.min() < 1e-3 {
                        continue;
                    }
                    tried += 1;
                    let s = r.slopes(normals(n), wi, wo).unwrap();
                    let h = 1e-6 * r.alpha;
                    let turned = |v: DVec3, by: f64| (v + axis.cross(v) * by).normalize();
                    let own = [(s.wi, wi), (s.wo, wo), (s.n, n)].map(|(form, v)| form.dot(axis.cross(v)));
                    let numeric = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|[a, b, c]| {
                        let at = |h: f64| value(turned(wi, a * h), turned(wo, b * h), turned(n, c * h));
                        (at(h) - at(-h)) * (0.5 / h)
                    });
                    for c in 0..3 {
                        let scale = own.iter().map(|x| x[c].abs()).sum::<f64>() + 1.0;
                        for (a, b) in own.iter().zip(numeric) {
                            assert!(
                                (a[c] - b[c] / f[c]).abs() < 1e-4 * scale / r.alpha,
                                "{r:?} {wi} {wo}: {a:?} {b:?}"
                            );
                        }
                        let together: f64 = own.iter().map(|x| x[c]).sum();
                        assert!(together.abs() < 1e-9 * scale, "{r:?} {wi} {wo}: {together} of {scale}");
                    }
                }
            }
        }
    }

    #[test]
    fn scores_against_differences() {
        let mut rng = Rng::keyed(7, 0, 0, 0);
        for d in KINDS {
            for r in [glass(d, 0.3, 1.5, 1.0), glass(d, 1e-2, 1.2, 1.3), glass(d, 0.2, 1.0001, 1.0), metal(d, 0.2)] {
                for _ in 0..60 {
                    let wi = warp::sphere(rng.uniform(), rng.uniform());
                    let Some(wo) = r.sample(N, wi, rng.uniform(), rng.uniform(), rng.uniform()) else { continue };
                    let mut found = [Rgb::ZERO; 7];
                    r.scores(N, wi, wo, |slot, x| found[slot as usize] += x);
                    let value = |r: &Rough| {
                        let lobe = r.eval(N, wi, wo);
                        lobe.tint * lobe.f
                    };
                    let f = value(&r);
                    // One slot changed by h, and its scale.
                    let changed = |slot: usize, h: f64| {
                        let mut r = r.clone();
                        match (&mut r.matter, slot) {
                            (_, 0) => r.alpha += h * r.alpha,
                            (Matter::Dielectric { interior, exterior }, 1) => *interior += h * (*interior - *exterior),
                            (Matter::Dielectric { interior, exterior }, 2) => *exterior += h * (*interior - *exterior),
                            (Matter::Dielectric { .. }, _) => {}
                            (Matter::Conductor { eta, .. }, s @ 1..=3) => eta[s - 1] += h,
                            (Matter::Conductor { k, .. }, s) => k[s - 4] += h,
                        }
                        value(&r)
                    };
                    for slot in 0..7 {
                        let unit = match (&r.matter, slot) {
                            (_, 0) => r.alpha,
                            (Matter::Dielectric { interior, exterior }, _) => interior - exterior,
                            _ => 1.0,
                        };
                        let h = 1e-6;
                        let numeric = (changed(slot, h) - changed(slot, -h)) * (0.5 / h);
                        for c in 0..3 {
                            let (a, b) = (found[slot][c] * unit, numeric[c] / f[c]);
                            assert!(
                                (a - b).abs() < 2e-5 * (1.0 + b.abs() + b * b),
                                "{r:?} {wi} {wo} slot {slot}: {a} {b}"
                            );
                        }
                    }
                }
            }
        }
    }
}
