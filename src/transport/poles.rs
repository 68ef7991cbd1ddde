//! Poles of a camera line: points beside it around which the collision forced on it is drawn as well, where derivatives ask for it.
//!
//! The film holds a path's first vertex x. In a medium beside an edge of something that moves, what x and a point z of the faces there send each other scores like `1/‖z-x‖`, as film
//! points do beside outlines ([`super::motion`]): in the plane across the edge `∫ r dr / r²` has no bound but for a logarithm. So paths of their own start at film points beside outlines, and
//! their collisions are drawn half from the forced density `p_f`, half equi-angularly around the point of the outline that the camera line passes.
//!
//! A film point with the weights q_k (paths a pixel and pixel² that pole k draws through it) and Q = Σ q_k is so drawn 1 + Q times as often as by its pixel, and a collision there at t
//! `1 + Q_0 + Σ q_k (p_f + p_k) / (2 p_f)` times (Q_0: of what has no pole). What a path collects by way of that collision counts one over that, whoever drew it, everything else `1 / (1 + Q)`:
//! the balance heuristic, but for the filters of pixels, which enter as their sum, 1.

use super::line::Line;
use crate::math::DVec3;
use crate::math::equiangular::EquiAngular;
use crate::math::rng::Rng;
use crate::scene::Scene;

/// A point that a camera line passes.
#[derive(Clone, Copy, Debug)]
pub struct Pole {
    pub p: DVec3,
    /// q_k.
    pub weight: f64,
}

/// Those of one film point.
#[derive(Clone, Debug)]
pub struct Poles {
    /// Of the camera line, w unit.
    pub o: DVec3,
    pub w: DVec3,
    /// `1 + Q_0`.
    pub rest: f64,
    pub list: Vec<Pole>,
    /// The one that this path is drawn by; none of a pixel's own.
    pub drawn: Option<usize>,
}

impl Poles {
    /// The abscissae from the first to the last of the line's media.
    fn range(&self, line: &Line) -> Option<[f64; 2]> {
        let (first, last) = (&line.parts.first()?.span, &line.parts.last()?.span);
        let from = |o: DVec3| (o - self.o).dot(self.w);
        Some([from(first.o) + first.t0, from(last.o) + last.t1])
    }

    fn around(&self, p: DVec3, [a, b]: [f64; 2]) -> Option<EquiAngular> {
        Some(EquiAngular::new(p, self.o, self.w, a, b)).filter(EquiAngular::usable)
    }

    /// Where the collision is to be forced: part of the line and abscissa there, `Some(None)` in a gap between its media; `None` where the line itself is to draw it.
    pub fn draw(&self, line: &Line, rng: &mut Rng) -> Option<Option<(usize, f64)>> {
        let pole = self.list.get(self.drawn?)?;
        let around = self.around(pole.p, self.range(line)?)?;
        (rng.uniform() < 0.5).then(|| line.locate(self.o, around.sample(rng.uniform())))
    }

    /// What is collected by way of a collision at `t` of part `k` counts, over what the rest of the path counts.
    pub fn share(&self, scene: &Scene, line: &Line, k: usize, t: f64) -> f64 {
        let forced = line.mean_density(scene, k, t);
        let span = &line.parts[k].span;
        let s = (span.o - self.o).dot(self.w) + t;
        let range = self.range(line);
        // Poles on the line itself draw as the line does.
        let density = |p: &Pole| range.and_then(|r| self.around(p.p, r)).map_or(forced, |a| a.density(s));
        let (mut film, mut here) = (self.rest, self.rest);
        for p in &self.list {
            film += p.weight;
            here += p.weight * 0.5 * (1.0 + density(p) / forced);
        }
        if forced > 0.0 { film / here } else { 0.0 }
    }
}
