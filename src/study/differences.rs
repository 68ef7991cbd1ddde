//! Finite differences of the renderer's own pictures with common random numbers: every point of a stencil is rendered
//! with the same seed, so that what does not change cancels.
//!
//! D(h) = sum_j w_j f(v + o_j h) / h is central, D = f' + O(h^2), or one-sided of second order where the scene refuses one
//! side (an albedo of 1). Richardson: R(h) = (4 D(h/2) - D(h)) / 3 = f' + O(h^4) (one-sided: O(h^3)). The result is R(h/2);
//! what it leaves is estimated by (R(h) - R(h/2)) / 3, from the same samples: what is left if it falls as h^2, more than
//! that if it falls faster.

use super::rounds::{Rounds, mean};
use crate::error::{Error, Result};
use crate::params::Quantity;
use crate::render::family::{Family, Member, View, numbers};
use crate::render::health::Health;
use crate::scene::parts::{Parts, SurfacePart};
use serde::Serialize;
use std::cmp::Ordering;

/// Where the points of a difference lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Side {
    Central,
    Forward,
    Backward,
}

impl Side {
    /// Offsets and weights, in steps.
    fn stencil(self) -> &'static [(f64, f64)] {
        match self {
            Side::Central => &[(1.0, 0.5), (-1.0, -0.5)],
            Side::Forward => &[(0.0, -1.5), (1.0, 2.0), (2.0, -0.5)],
            Side::Backward => &[(0.0, 1.5), (-1.0, -2.0), (-2.0, 0.5)],
        }
    }

    /// D(h) as weights of f at v + offset.
    fn plain(self, h: f64) -> Vec<(f64, f64)> {
        self.stencil().iter().map(|&(o, w)| (o * h, w / h)).collect()
    }

    /// R(h).
    fn extrapolated(self, h: f64) -> Vec<(f64, f64)> {
        let fine = self.plain(0.5 * h).into_iter().map(|(o, w)| (o, w * 4.0 / 3.0));
        fine.chain(self.plain(h).into_iter().map(|(o, w)| (o, -w / 3.0))).collect()
    }
}

/// A parameter of a scene, at a value.
#[derive(Clone, Copy)]
pub struct At<'a> {
    pub family: &'a Family,
    pub name: &'a str,
    pub value: f64,
}

impl At<'_> {
    pub fn member(&self, offset: f64) -> Result<Member> {
        self.family.at(&[(self.name, self.value + offset)])
    }

    /// Whether the scene takes the value; other errors than its refusal are errors.
    fn takes(&self, offset: f64) -> Result<bool> {
        match self.member(offset) {
            Ok(_) => Ok(true),
            Err(Error::Scene { .. } | Error::Usage { .. }) => Ok(false),
            Err(e) => Err(e),
        }
    }

    /// Whether a stencil with this step lies in the values that the scene takes.
    pub fn fits(&self, side: Side, h: f64) -> Result<bool> {
        for &(o, _) in side.stencil() {
            if o != 0.0 && !self.takes(o * h)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// Whether every interface keeps its denser side over a stencil with this step: at equal indices the picture has a kink, and near them derivatives have hardly a variance.
    pub fn keeps_sides(&self, side: Side, h: f64) -> Result<bool> {
        let denser = |offset: f64| -> Result<Vec<Option<Ordering>>> {
            let desc = self.family.describe(&[(self.name, self.value + offset)])?;
            let parts = Parts::read(&desc, &desc.values::<f64>())?;
            Ok(parts.surfaces.iter().map(SurfacePart::denser).collect())
        };
        let own = denser(0.0)?;
        for &(o, _) in side.stencil().iter().filter(|x| x.0 != 0.0) {
            let is_turned = |(a, b): (&Option<Ordering>, Option<Ordering>)| *a != Some(Ordering::Equal) && *a != b;
            if own.iter().zip(denser(o * h)?).any(is_turned) {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The largest step worth trying: eight times the scene's own hint; else what moves things by a fifth of the scene's
    /// radius, or turns or stretches them by a fifth; else 0.4 of the value or a tenth of the extent of its bounds.
    pub fn largest_step(&self) -> Result<f64> {
        let desc = self.family.describe(&[])?;
        let index = desc.wrt(self.name)?;
        let hint = desc.params[index].hint;
        if let Some(step) = hint.step {
            return Ok(8.0 * step);
        }
        // How fast things move with the parameter: lengths a unit of it, and ratios (turns, stretches).
        let parts = Parts::read(&desc, &desc.dual(index))?;
        let (mut length, mut ratio) = (0.0f64, 0.0f64);
        for s in parts.slots().iter().filter(|s| !s.quantity.is_value()) {
            let fastest = s.values.iter().fold(0.0f64, |m, x| m.max(x.d[0].abs()));
            use Quantity::{AlbedoShift, GlowShift, Position, Shift};
            let speed = match s.quantity {
                Position | Shift | GlowShift | AlbedoShift => &mut length,
                _ => &mut ratio,
            };
            *speed = speed.max(fastest);
        }
        if length > 0.0 || ratio > 0.0 {
            let size = self.member(0.0)?.scene.bounds.radius();
            return Ok((0.2 * size / length).min(0.2 / ratio));
        }
        let extent = hint.min.zip(hint.max).map_or(0.0, |(a, b)| 0.1 * (b - a));
        let step = extent.max(0.4 * self.value.abs());
        Ok(if step > 0.0 { step } else { 1.0 })
    }
}

/// Linear functionals of pictures at different values of one parameter.
pub struct Difference {
    pub step: f64,
    pub side: Side,
    points: Vec<(Member, Vec<f64>)>,
}

impl Difference {
    /// D(h).
    pub fn plain(at: &At, side: Side, h: f64) -> Result<Self> {
        Self::new(at, side, h, &[side.plain(h)])
    }

    /// R(h/2), and (R(h) - R(h/2)) / 3.
    pub fn extrapolated(at: &At, side: Side, h: f64) -> Result<Self> {
        let scaled = |h: f64, by: f64| side.extrapolated(h).into_iter().map(move |(o, w)| (o, w * by));
        let rest: Vec<_> = scaled(h, 1.0 / 3.0).chain(scaled(0.5 * h, -1.0 / 3.0)).collect();
        Self::new(at, side, h, &[side.extrapolated(0.5 * h), rest])
    }

    fn new(at: &At, side: Side, step: f64, functionals: &[Vec<(f64, f64)>]) -> Result<Self> {
        // Points that several functionals share are rendered once.
        let mut offsets: Vec<f64> = functionals.iter().flatten().map(|p| p.0).collect();
        offsets.sort_by(f64::total_cmp);
        offsets.dedup();
        let mut points = Vec::new();
        for o in offsets {
            let weight = |f: &Vec<(f64, f64)>| f.iter().filter(|p| p.0 == o).map(|p| p.1).sum();
            points.push((at.member(o)?, functionals.iter().map(weight).collect()));
        }
        Ok(Difference { step, side, points })
    }

    /// Pictures that one round renders.
    pub fn pictures(&self) -> usize {
        self.points.len()
    }

    /// Functionals of these pictures: the difference, and what its step leaves where it is extrapolated.
    pub fn functionals(&self) -> usize {
        self.points[0].1.len()
    }

    /// The functionals from one seed, as images of three channels a pixel.
    pub fn round(&self, view: &View, spp: u64, seed: u64, health: &Health) -> Result<Vec<Vec<f64>>> {
        let mut out = vec![vec![0.0; 3 * view.pixels()]; self.functionals()];
        let mut first: Option<Vec<f64>> = None;
        for (member, weights) in &self.points {
            let o = view.picture(&member.scene, spp, seed)?;
            health.merge(&o.film.health);
            let f = numbers(&o, 0);
            let first = first.get_or_insert_with(|| f.clone());
            // Weights add up to 0: differences to one picture do the same, and what does not change cancels exactly.
            for (image, &w) in out.iter_mut().zip(weights).filter(|(_, w)| **w != 0.0) {
                image.iter_mut().zip(f.iter().zip(first.iter())).for_each(|(a, (f, first))| *a += w * (f - first));
            }
        }
        Ok(out)
    }
}

/// Root mean square over places of a bias, from noisy estimates of it.
#[derive(Clone, Copy, Debug)]
pub struct Bias {
    /// What the squares of the estimates exceed their variances by.
    seen: f64,
    /// One standard deviation of that (channels count as one): what the noise may hide.
    hidden: f64,
}

impl Bias {
    pub fn new(estimates: &Rounds) -> Self {
        let (square, variance) = (mean(estimates.mean.iter().map(|x| x * x)), estimates.mean_variance());
        Bias { seen: (square - variance).max(0.0), hidden: (6.0 / estimates.mean.len() as f64).sqrt() * variance }
    }

    /// The bias of every place: the bound of all, and at places where the estimate stands out the whole of what half the step
    /// changed. Beside an edge that moves with the parameter the bias falls like h only, and there alone.
    pub fn places(estimates: &Rounds) -> Vec<f64> {
        let all = Bias::new(estimates).bound();
        let own = |i: usize| {
            let m = estimates.mean[i].abs();
            if m > 2.0 * estimates.variance(i).sqrt() { 3.0 * m } else { 0.0 }
        };
        (0..estimates.mean.len()).map(|i| all.max(own(i))).collect()
    }

    /// With what may be hidden.
    pub fn bound(&self) -> f64 {
        (self.seen + self.hidden).sqrt()
    }

    /// What is certain; 0 while noise explains it.
    pub fn visible(&self) -> f64 {
        (self.seen - 2.0 * self.hidden).max(0.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::super::sweep::start;
    use super::*;

    fn apply(weights: &[(f64, f64)], f: impl Fn(f64) -> f64) -> f64 {
        weights.iter().map(|&(o, w)| w * f(1.0 + o)).sum()
    }

    /// Steps do not reach over equal indices, unless they begin there.
    #[test]
    fn steps_keep_the_denser_side() {
        let with = |value: f64, f: &dyn Fn(&At) -> bool| {
            let text = format!(
                r#"<scene version="3.0.0"><default name="ior" value="{value}"/><default name="other" value="1.5"/><integrator type="volpath"/><emitter type="constant"/>
  <shape type="sphere"><bsdf type="roughdielectric"><float name="int_ior" value="$ior"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="sphere"><point name="center" value="4, 0, 0"/><bsdf type="dielectric"><float name="int_ior" value="1"/><float name="ext_ior" value="$other"/></bsdf></shape>
  <sensor type="perspective"><transform name="to_world"><translate z="-4"/></transform></sensor></scene>"#
            );
            let family = Family::text(&text, std::path::Path::new("sides.xml"));
            f(&At { family: &family, name: "ior", value })
        };
        let at = |value: f64, side: Side, h: f64| with(value, &|at| at.keeps_sides(side, h).unwrap());
        assert!(at(1.45, Side::Central, 0.4) && at(1.45, Side::Forward, 0.5) && !at(1.45, Side::Central, 0.5));
        assert!(!at(0.8, Side::Forward, 0.3) && at(0.8, Side::Backward, 0.2));
        assert!(at(1.0, Side::Central, 0.3));
        assert!(with(1.45, &|at| start(at, 0.58).unwrap() == (Side::Central, 0.29)));
    }

    #[test]
    fn stencils_have_their_order() {
        for (side, order) in [(Side::Central, 4), (Side::Forward, 3), (Side::Backward, 3)] {
            for power in 0..=order {
                let f = |x: f64| (x - 1.0).powi(power) * 2.0;
                let truth = if power == 1 { 2.0 } else { 0.0 };
                let d = apply(&side.extrapolated(0.25), f);
                assert!((d - truth).abs() < 1e-13, "{side:?} {power}: {d}");
            }
            let f = |x: f64| x.powi(order + 2);
            assert!((apply(&side.extrapolated(0.25), f) - (order + 2) as f64).abs() > 1e-4);
        }
    }

    #[test]
    fn noise_is_not_bias() {
        let mut rng = crate::math::rng::Rng::keyed(1, 0, 0, 0);
        let mut found = |shift: f64| {
            let mut r = Rounds::default();
            for _ in 0..16 {
                r.push(&(0..3000).map(|_| shift + rng.uniform() - 0.5).collect::<Vec<_>>(), 1.0);
            }
            Bias::new(&r)
        };
        // The standard error of a place is 0.072.
        let none = found(0.0);
        assert!(none.bound() < 0.02 && none.visible() == 0.0);
        let some = found(0.3);
        assert!((some.bound() - 0.3).abs() < 0.005 && (some.visible() - 0.3).abs() < 0.005);
    }
}
