//! Straight lines through media: their spans with optical depths, and a collision forced on them.

use super::record::MediumSpan;
use super::tracking::{self, Forced};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::scene::{Hit, March, On, Scene};

/// One span of a line, with the optical depth in front of it and in it.
pub struct Part {
    pub span: MediumSpan,
    pub before: Rgb,
    pub depth: Rgb,
}

/// Spans in order.
#[derive(Default)]
pub struct Line {
    pub parts: Vec<Part>,
    /// Optical depth of all of it.
    pub total: Rgb,
    /// Whether any of its media has an extinction a channel. The total does not tell: without an end it is infinite in all of them.
    pub chromatic: bool,
    /// The medium at its end.
    pub last: Option<u32>,
}

impl Line {
    pub fn push(&mut self, scene: &Scene, span: MediumSpan) {
        let depth = tracking::depth(&scene.media[span.medium as usize], &span);
        self.parts.push(Part { span, before: self.total, depth });
        self.total += depth;
        self.chromatic |= !scene.media[span.medium as usize].gray;
    }

    /// From `o`, in `medium`, to the distance `t_max`, with nothing opaque on the way; `None` after too many interfaces.
    pub fn clear(scene: &Scene, o: DVec3, w: DVec3, t_max: f64, medium: Option<u32>) -> Option<Line> {
        let (mut line, mut ray) = (Line::default(), March::new(o, w, On::default(), medium));
        for _ in 0..scene.max_interfaces {
            let left = ray.left(t_max);
            let hit = ray.boundary(scene, left);
            if let Some(span) = MediumSpan::ahead(&ray, left, hit.as_ref()) {
                line.push(scene, span);
            }
            let Some(h) = hit else {
                line.last = ray.medium;
                return Some(line);
            };
            ray.pass(scene, &h);
        }
        None
    }

    /// From `o` on the faces `on`, in `medium`, to the first surface that is not passed unchanged, with that; `None` after too many interfaces. Without spans unless it is `weighed`.
    pub fn to_surface(
        scene: &Scene,
        o: DVec3,
        w: DVec3,
        on: &On,
        medium: Option<u32>,
        weighed: bool,
    ) -> Option<(Line, Option<Hit>)> {
        let (mut line, mut ray) = (Line::default(), March::new(o, w, *on, medium));
        for _ in 0..scene.max_interfaces {
            let hit = ray.meets(scene, f64::INFINITY);
            if let Some(span) = MediumSpan::ahead(&ray, f64::INFINITY, hit.as_ref()).filter(|_| weighed) {
                line.push(scene, span);
            }
            line.last = ray.medium;
            let Some(h) = hit else { return Some((line, None)) };
            if !scene.passes(&h) {
                return Some((line, Some(Hit { t: (h.p - o).dot(w), ..h })));
            }
            ray.pass(scene, &h);
        }
        None
    }

    pub fn transmittance(&self) -> Rgb {
        self.total.map(|t| (-t).exp())
    }

    /// Transmittance up to `t` of the span of part `k`.
    pub fn transmittance_to(&self, scene: &Scene, k: usize, t: f64) -> Rgb {
        let part = &self.parts[k];
        let m = &scene.media[part.span.medium as usize];
        (part.before + tracking::depth(m, &part.span.until(t))).map(|t| (-t).exp())
    }

    /// A collision somewhere on the line, with the density [`Line::density`].
    pub fn force(&self, scene: &Scene, rng: &mut Rng) -> Forced {
        let parts = self.parts.iter().map(|q| (&scene.media[q.span.medium as usize], &q.span, q.before, q.depth));
        tracking::force(parts, self.total, self.chromatic, rng)
    }

    /// Density per length of the forced collision at `t` of part `k`, per channel.
    pub fn density(&self, scene: &Scene, k: usize, t: f64) -> Rgb {
        self.parts[k].forced_density(scene, self.total, t)
    }

    /// The same whichever channel leads.
    pub fn mean_density(&self, scene: &Scene, k: usize, t: f64) -> f64 {
        let d = self.density(scene, k, t);
        let lit = (0..3).filter(|&c| self.total[c] > 0.0).count();
        if lit > 0 { d.sum() / lit as f64 } else { 0.0 }
    }

    /// The part that holds the distance `s` from the line's start, and its abscissa there.
    pub fn locate(&self, start: DVec3, s: f64) -> Option<(usize, f64)> {
        self.parts.iter().enumerate().find_map(|(k, q)| {
            let t = s - (q.span.o - start).dot(q.span.w);
            (t >= q.span.t0 && t <= q.span.t1).then_some((k, t))
        })
    }
}

impl Part {
    /// Density per length of a collision forced on a line of depth `total`, at `t` of the span, per channel.
    pub fn forced_density(&self, scene: &Scene, total: Rgb, t: f64) -> Rgb {
        let m = &scene.media[self.span.medium as usize];
        let depth = self.before + tracking::depth(m, &self.span.until(t));
        let (sigma_t, _) = m.coefficients(self.span.o + self.span.w * t);
        // 1 - T of nothing is nothing: no collision is forced there.
        Rgb::from_fn(|c| if total[c] > 0.0 { sigma_t[c] * (-depth[c]).exp() / -(-total[c]).exp_m1() } else { 0.0 })
    }
}
