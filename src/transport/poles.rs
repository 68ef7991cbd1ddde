//! Poles of a camera line: points beside it around which the collision forced on it is drawn as well, where derivatives ask for it.
//!
//! The film holds a path's first vertex x. In a medium beside an edge of something that moves, what x and a point z of the faces there send each other scores like `1/‖z-x‖` ([T] (27b)), as film
//! points do beside outlines ([`super::motion`]): in the plane across the edge `∫ r dr / r²` has no bound but for a logarithm. So paths of their own start at film points beside outlines, and
//! their collisions are drawn half from the forced density `p_f` (per length), half equi-angularly ([T] 5.5, `p_k`, per length) around the point of the outline that the camera line passes.
//!
//! A film point with the weights q_k (paths a pixel and pixel² that pole k draws through it) and Q = Σ q_k is so drawn 1 + Q times as often as by its pixel, and a collision there at t
//! `1 + Q_0 + Σ q_k (p_f + p_k) / (2 p_f)` times (Q_0: of what has no pole). What a path collects by way of that collision counts one over that, whoever drew it, everything else `1 / (1 + Q)`:
//! the balance heuristic ([T] (61)), but for the filters of pixels, which enter as their sum, 1.

use super::line::Line;
use crate::math::DVec3;
use crate::math::equiangular::EquiAngular;
use crate::math::rng::Rng;
use crate::scene::Scene;
use smallvec::SmallVec;

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
    pub list: SmallVec<[Pole; 4]>,
    /// The one that this path is drawn by; none of a pixel's own.
    pub drawn: Option<usize>,
}

impl Poles {
    /// What the film point's paths count that go by way of no collision on their camera line: `1 / (1 + Q)`.
    pub fn weight(&self) -> f64 {
        1.0 / (self.rest + self.list.iter().map(|p| p.weight).sum::<f64>())
    }

    /// The abscissae from the first to the last of the line's media.
    fn range(&self, line: &Line) -> Option<[f64; 2]> {
        let (first, last) = (&line.parts.first()?.span, &line.parts.last()?.span);
        let from = |o: DVec3| (o - self.o).dot(self.w);
        Some([from(first.o) + first.t0, from(last.o) + last.t1])
    }

    fn around(&self, p: DVec3, [a, b]: [f64; 2]) -> Option<EquiAngular> {
        Some(EquiAngular::new(p, self.o, self.w, a, b)).filter(|a| a.usable() && a.h().is_finite())
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
        // Nothing collides where nothing is forced.
        if forced > 0.0 { film / here } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::On;
    use crate::scene::compile::LoadOptions;
    use crate::scene::desc::SceneDesc;
    use std::path::Path;

    /// Two boxes of chromatic fog with a gap between them.
    fn scene() -> Scene {
        let fog = |x: f64, id: &str, sigma: &str| {
            format!(
                r#"<medium type="homogeneous" id="{id}"><rgb name="sigma_t" value="{sigma}"/></medium>
                <shape type="cube"><transform name="to_world"><translate x="{x}"/></transform><bsdf type="null"/><ref name="interior" id="{id}"/></shape>"#
            )
        };
        let text = format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>{}{}<emitter type="constant"/></scene>"#,
            fog(0.0, "a", "0.3, 0.5, 0.9"),
            fog(3.0, "b", "0.8, 0.2, 0.4")
        );
        let desc = SceneDesc::parse(&text, Path::new("poles.xml"), &[]).unwrap();
        Scene::compile(&desc, &LoadOptions::default()).unwrap()
    }

    /// A function that peaks beside the first pole as scores do: pixels and poles together give its integral, with a fifth of the variance that pixels alone have.
    #[test]
    fn what_a_line_holds_is_shared_out() {
        let scene = scene();
        let (o, w) = (DVec3::new(-4.0, 0.1, 0.2), DVec3::X);
        let (line, _) = Line::to_surface(&scene, o, w, &On::default(), None, true).unwrap();
        assert_eq!(line.parts.len(), 2);
        let peak = DVec3::new(0.4, 0.11, 0.2);
        let list =
            smallvec::smallvec![Pole { p: peak, weight: 1.5 }, Pole { p: DVec3::new(3.2, 0.5, 0.2), weight: 0.2 }];
        let poles = Poles { o, w, rest: 1.3, list, drawn: None };
        let f = |p: DVec3| 1.0 / (p - peak).length();
        // ∫ dx / sqrt(x² + h²), box by box.
        let primitive = |x: f64| ((x - 0.4) / 0.01).asinh();
        let truth = primitive(1.0) - primitive(-1.0) + primitive(4.0) - primitive(2.0);
        let mut rng = Rng::keyed(3, 1, 4, 1);
        let mut one = |poles: &Poles, shared: bool| {
            let place = poles.draw(&line, &mut rng).unwrap_or_else(|| {
                let c = line.force(&scene, &mut rng);
                Some((c.piece, c.t))
            });
            let Some((k, t)) = place else { return 0.0 };
            let share = if shared { poles.share(&scene, &line, k, t) * poles.weight() } else { 1.0 };
            let span = &line.parts[k].span;
            f(span.o + span.w * t) / line.mean_density(&scene, k, t) * share
        };
        let n = 200_000;
        // Mean and variance of a sample.
        let mut run = |poles: &Poles, shared: bool| {
            let (mut sum, mut square) = (0.0, 0.0);
            for _ in 0..n {
                let x: f64 = one(poles, shared);
                (sum, square) = (sum + x, square + x * x);
            }
            let mean = sum / f64::from(n);
            [mean, square / f64::from(n) - mean * mean]
        };
        let alone = run(&poles, false);
        let own = run(&poles, true);
        let by = [0, 1].map(|k| run(&Poles { drawn: Some(k), ..poles.clone() }, true));
        // As many paths as the weights say; those of what has no pole are drawn by the line itself.
        let weights = [1.3, 1.5, 0.2];
        let parts = [own, by[0], by[1]];
        let total: f64 = parts.iter().zip(weights).map(|(p, q)| p[0] * q).sum();
        let variance: f64 = parts.iter().zip(weights).map(|(p, q)| p[1] * q).sum();
        let error = (variance / f64::from(n)).sqrt();
        // False alarms: 1 in 10^5.
        assert!((total - truth).abs() < 4.4 * error, "{total} {truth} {error}");
        assert!((alone[0] - truth).abs() < 4.4 * (alone[1] / f64::from(n)).sqrt(), "{alone:?}");
        assert!(variance < 0.2 * alone[1], "{variance} {alone:?}");
    }
}
