//! Facets that stand upright: where refracted light ends with a jump.
//!
//! The facet that takes wi to wo has its normal along `± (n₁ wi + n₂ wo)`, and there are facets of the surface's own side only: seen from wi, light is refracted to where
//!
//! ```text
//! B = s (n₂ |<n,wo>| - n₁ |<n,wi>|) > 0,        s = sign(n₂ - n₁).
//! ```
//!
//! At B = 0, a circle of directions, the facet stands upright. Beckmann has no such facets, but GGX has (D = α²/π there), and its value f |cos wo| jumps to 0. So `∫ f |cos wo| L dω` changes with
//! the motion of the circle as well, [T] (18): over its azimuth φ, dl = sin θ dφ, and |∇B| on the sphere is n₂ sin θ,
//!
//! ```text
//! ∮ f |cos wo| L Ḃ / n₂ dφ,
//! ```
//!
//! Ḃ being what B changes by for the paths' own motion of wi, wo and n, and by the indices. Of the circle only an arc around -wi's azimuth has light: q > 0 and c > 0 ask `-<wi,wo> > r`,
//! r the smaller index over the larger; f is 0 at its ends.

use super::Normals;
use super::rough::{Facet, Matter, Rough, Slopes};
use crate::math::{DVec3, Rgb, V3};
use crate::params::Slot;

/// The arc of directions at which light toward one direction ends.
#[derive(Clone, Copy, Debug)]
pub struct Arc {
    /// Its axis, on the side of the light that arrives.
    axis: DVec3,
    /// Across the axis: the azimuth of its middle, and a quarter of a turn from there.
    across: [DVec3; 2],
    /// Cosine and sine of the angle with the axis.
    cos: f64,
    sin: f64,
    /// From the middle to either end.
    half: f64,
    /// n₂.
    index: f64,
}

impl Arc {
    /// A direction, and what `f |cos wo| L Ḃ` there is to be weighed with: dφ over its density and n₂.
    pub fn draw(&self, u: f64) -> (DVec3, f64) {
        let (sin, cos) = ((2.0 * u - 1.0) * self.half).sin_cos();
        let wo = self.axis * self.cos + (self.across[0] * cos + self.across[1] * sin) * self.sin;
        (wo, 2.0 * self.half / self.index)
    }
}

impl Rough {
    /// Whether its value jumps anywhere.
    pub fn jumps(&self) -> bool {
        self.is_transparent() && self.distribution.upright(self.alpha) > 0.0
    }

    /// The normal on the side of `wi`, and the indices there and on the other.
    fn side(&self, normals: Normals, wi: DVec3) -> Option<(DVec3, [f64; 2])> {
        let Matter::Dielectric { interior, exterior } = self.matter else { return None };
        let n = normals.of(wi);
        Some(if n.dot(wi) > 0.0 { (n, [exterior, interior]) } else { (-n, [interior, exterior]) })
    }

    /// Where light toward `wi` ends with a jump.
    pub fn arc(&self, normals: Normals, wi: DVec3) -> Option<Arc> {
        let (side, [n1, n2]) = self.side(normals, wi).filter(|_| self.jumps())?;
        let (ci, si) = (side.dot(wi), side.cross(wi).length());
        let cos = n1 / n2 * ci;
        let sin = ((1.0 - cos) * (1.0 + cos)).sqrt();
        let r = n1.min(n2) / n1.max(n2);
        let least = (r - ci * cos) / (si * sin);
        // No circle, or no light on it: no number in either of the limits.
        if least.is_nan() || least >= 1.0 || ci <= 0.0 {
            return None;
        }
        let across = (side * ci - wi) / si;
        Some(Arc {
            axis: -side,
            across: [across, side.cross(across)],
            cos,
            sin,
            half: least.max(-1.0).acos(),
            index: n2,
        })
    }

    /// `f |cos wo|` that light ends with at a direction of its arc.
    pub fn jump(&self, normals: Normals, wi: DVec3, wo: DVec3) -> f64 {
        let (Some((_, indices)), Some(n)) = (self.side(normals, wi), normals.toward(wi, wo)) else { return 0.0 };
        let [n, i, o] = [n, wi, wo].map(V3::constant);
        let facet = Facet::refracted(self.distribution, self.alpha, indices, n, [i, o]);
        facet.map_or(0.0, |(f, _)| f.times(self.distribution.upright(self.alpha)).value())
    }

    /// What B asks of how both directions and the normal turn.
    pub fn arc_slopes(&self, normals: Normals, wi: DVec3, wo: DVec3) -> Slopes {
        let mut slopes = Slopes::default();
        let Some((side, [n1, n2])) = self.side(normals, wi) else { return slopes };
        // B is `-s <side, n₁ wi + n₂ wo>`.
        let s = (n2 - n1).signum();
        slopes.wi.add(side, Rgb::splat(-s * n1));
        slopes.wo.add(side, Rgb::splat(-s * n2));
        slopes.n.add(wi * n1 + wo * n2, Rgb::splat(-s * side.dot(normals.of(wi))));
        slopes
    }

    /// `∂B` by the slots of the indices.
    pub fn arc_scores(&self, normals: Normals, wi: DVec3, wo: DVec3) -> [(Slot, f64); 2] {
        let Some((side, [n1, n2])) = self.side(normals, wi) else { return [(self.index_slot, 0.0); 2] };
        let s = (n2 - n1).signum();
        let [near, far] = [-s * side.dot(wi), -s * side.dot(wo)];
        let [inside, outside] = if side.dot(normals.of(wi)) > 0.0 { [far, near] } else { [near, far] };
        [(self.index_slot, inside), (self.index_slot + 1, outside)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::microfacet::Distribution;

    fn glass(interior: f64, exterior: f64, alpha: f64) -> Rough {
        let matter = Matter::Dielectric { interior, exterior };
        Rough { distribution: Distribution::Ggx, alpha, matter, alpha_slot: 0, index_slot: 1 }
    }

    fn normals(n: DVec3) -> Normals {
        Normals { face: n, shading: n }
    }

    fn light(w: DVec3) -> f64 {
        (1.3 * w.x - 0.4 * w.y + 0.7 * w.z).exp()
    }

    /// `∫ g dω` over refracted directions, by midpoints in the angle with the axis, from the circle on, and the azimuth.
    fn refracted(r: &Rough, n: DVec3, wi: DVec3, g: impl Fn(DVec3) -> f64) -> f64 {
        let Matter::Dielectric { interior, exterior } = r.matter else { return 0.0 };
        let (side, [n1, n2]) = if n.dot(wi) > 0.0 { (n, [exterior, interior]) } else { (-n, [interior, exterior]) };
        let start = (n1 / n2 * side.dot(wi)).min(1.0);
        let [lo, hi] = if n2 > n1 { [start, 1.0] } else { [0.0, start] };
        let a = (side * side.dot(wi) - wi).normalize();
        let (b, m) = (side.cross(a), 500);
        let mut sum = 0.0;
        for i in 0..m {
            let cos = lo + (hi - lo) * (f64::from(i) + 0.5) / f64::from(m);
            let sin = (1.0 - cos * cos).sqrt();
            for j in 0..m {
                let (s, c) = (std::f64::consts::TAU * (f64::from(j) + 0.5) / f64::from(m)).sin_cos();
                sum += g((a * c + b * s) * sin - side * cos);
            }
        }
        sum * (hi - lo) * std::f64::consts::TAU / f64::from(m * m)
    }

    /// By the indices, and as wi and n turn: scores and the arc against differences, and not without the arc.
    #[test]
    fn what_the_scores_leave_out() {
        for (interior, exterior, cos) in
            [(1.5, 1.0, 0.7), (1.5, 1.0, -0.6), (1.0, 1.4, 0.5), (1.0, 1.4, -0.6), (2.5, 1.2, 0.3)]
        {
            let r = glass(interior, exterior, 0.5);
            let (n, wi) = (DVec3::Z, DVec3::new((1.0_f64 - cos * cos).sqrt(), 0.0, cos));
            let axis = DVec3::new(0.3, 0.8, -0.2);
            let turned = |v: DVec3, by: f64| (v + axis.cross(v) * by).normalize();
            let value =
                |r: &Rough, n: DVec3, wi: DVec3| refracted(r, n, wi, |w| r.eval(normals(n), wi, w).f * light(w));
            let changed = |k: usize, h: f64| match k {
                0 => value(&glass(interior + h, exterior, 0.5), n, wi),
                1 => value(&glass(interior, exterior + h, 0.5), n, wi),
                2 => value(&r, n, turned(wi, h)),
                _ => value(&r, turned(n, h), wi),
            };
            let score = |k: usize, w: DVec3| match k {
                0 | 1 => {
                    let mut found = 0.0;
                    r.scores(normals(n), wi, w, |slot, x| found += if slot == 1 + k as Slot { x[0] } else { 0.0 });
                    found
                }
                _ => r
                    .slopes(normals(n), wi, w)
                    .map_or(0.0, |s| if k == 2 { s.wi.dot(axis.cross(wi))[0] } else { s.n.dot(axis.cross(n))[0] }),
            };
            let on_arc = |k: usize, w: DVec3| match k {
                0 | 1 => r.arc_scores(normals(n), wi, w)[k].1,
                2 => r.arc_slopes(normals(n), wi, w).wi.dot(axis.cross(wi))[0],
                _ => r.arc_slopes(normals(n), wi, w).n.dot(axis.cross(n))[0],
            };
            let arc = r.arc(normals(n), wi).unwrap();
            for k in 0..4 {
                let inside = refracted(&r, n, wi, |w| {
                    let f = r.eval(normals(n), wi, w).f;
                    if f > 0.0 { f * light(w) * score(k, w) } else { 0.0 }
                });
                let m = 2000;
                let border: f64 = (0..m)
                    .map(|j| {
                        let (w, measure) = arc.draw((f64::from(j) + 0.5) / f64::from(m));
                        r.jump(normals(n), wi, w) * light(w) * measure * on_arc(k, w) / f64::from(m)
                    })
                    .sum();
                let h = 1e-4;
                let numeric = (changed(k, h) - changed(k, -h)) * (0.5 / h);
                let off = (inside + border - numeric).abs();
                assert!(
                    off < 2e-3 * (numeric.abs() + 0.1),
                    "{interior} {exterior} {cos} {k}: {inside} + {border}, {numeric}"
                );
                assert!(border.abs() > 5.0 * off, "{interior} {exterior} {cos} {k}: {inside} + {border}, {numeric}");
            }
        }
    }

    /// As directions and normal turn together nothing changes, and the directions are on the circle.
    #[test]
    fn an_arc_turns_with_everything() {
        let (n, axis) = (DVec3::new(0.2, -0.6, 0.5).normalize(), DVec3::new(1.0, 2.0, -0.5));
        for r in [glass(1.5, 1.0, 0.4), glass(1.1, 1.7, 0.4)] {
            for wi in [DVec3::new(0.9, 0.1, 0.4).normalize(), DVec3::new(0.3, 0.8, 0.1).normalize()] {
                let Some(arc) = r.arc(normals(n), wi) else { continue };
                for u in [0.0, 0.2, 0.5, 0.99] {
                    let (wo, _) = arc.draw(u);
                    let s = r.arc_slopes(normals(n), wi, wo);
                    let b = s.wi.dot(wi)[0] + s.wo.dot(wo)[0];
                    assert!((wo.length() - 1.0).abs() < 1e-14 && b.abs() < 1e-14, "{wo} {b}");
                    let all = s.wi.dot(axis.cross(wi)) + s.wo.dot(axis.cross(wo)) + s.n.dot(axis.cross(n));
                    assert!(all[0].abs() < 1e-14, "{all:?}");
                }
            }
        }
        let beckmann = Rough { distribution: Distribution::Beckmann, ..glass(1.5, 1.0, 0.4) };
        assert!(beckmann.arc(normals(DVec3::Z), DVec3::new(0.6, 0.0, 0.8)).is_none());
    }
}
