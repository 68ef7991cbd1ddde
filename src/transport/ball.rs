//! Connections to point, spot, directional and collimated lights by a ball of glass or metal, with all its ways ([`crate::math::ball_ways`]): at every vertex, each such light by each ball.
//! Nothing is drawn. Caustics are where the gain has no bound; it is integrable and never clamped.

use super::pane::{self, Found};
use super::record::Recorder;
use super::state::State;
use super::vertex::Vertex;
use super::walk::Walker;
use crate::light::Origin;
use crate::math::ball_ways::BallWay;
use crate::math::fresnel::conductor;
use crate::math::{DVec3, Rgb};
use crate::scene::Scene;
use crate::scene::balls::BallOf;
use crate::scene::beams::{Step, Way};
use crate::surface::Surface;
use smallvec::SmallVec;

/// Score what all lights without extent, and all beams, bring to the vertex at `s.o` by one ball.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene: &Scene = w.scene;
    let interfaces = w.set.max_depth.saturating_sub(s.depth + 1);
    if scene.balls.is_empty() || interfaces == 0 {
        return;
    }
    let mut found: SmallVec<[BallWay; 8]> = SmallVec::new();
    for b in &scene.balls {
        let surface = scene.surface_of(b.shape);
        for (id, light) in scene.lights.iter().enumerate() {
            let Some(from) = light.origin() else { continue };
            let (source, far) = b.source(from);
            b.ball.ways(source, far, s.o - b.center, interfaces, Some(&mut s.rng), |way| found.push(way));
            for way in found.drain(..) {
                if s.depth + (way.points.len() as u32) < w.set.min_order {
                    continue;
                }
                let Some((way, points)) = b.way(surface, id as u32, from, &way, s.o) else { continue };
                let Some(&first) = points.last() else { continue };
                let Some(emission) = light.emission_toward(first) else { continue };
                pane::score(w, s, vertex, &Found { way: &way, points: &points, emission });
            }
        }
    }
}

impl BallOf {
    /// As a beam's way to x, and its points from the last one to the first; `None` where nothing is left of the light.
    pub fn way(
        &self,
        surface: &Surface,
        light: u32,
        from: Origin<f64>,
        way: &BallWay,
        x: DVec3,
    ) -> Option<(Way, SmallVec<[DVec3; 4]>)> {
        let at = |k: usize| self.center + way.points[k];
        let n = way.points.len();
        let (start_inside, mut before) = match from {
            Origin::Position(q) => {
                ((q.value() - self.center).length() < self.ball.radius, (at(0) - q.value()).normalize())
            }
            Origin::Infinity(w) => (false, w.value()),
        };
        let mut gain = Rgb::splat(way.gain);
        let mut steps = Vec::with_capacity(n);
        for k in 0..n {
            let behind = if k + 1 < n { at(k + 1) - at(k) } else { x - at(k) }.normalize();
            let c = way.cosines[k];
            gain *= match surface {
                Surface::Dielectric { .. } => Rgb::splat(self.ball.share(way, k, k == 0 && !start_inside)),
                Surface::Conductor { eta, k, two_sided, .. } if !self.flipped || *two_sided => {
                    Rgb::from_fn(|i| conductor(c, eta[i], k[i]))
                }
                _ => Rgb::ZERO,
            };
            let n = way.points[k] / self.ball.radius * if self.flipped { -1.0 } else { 1.0 };
            steps.push(Step { shape: self.shape, face: 0, p: at(k), n, before, behind, through: way.through[k] });
            before = behind;
        }
        let points = (0..n).rev().map(at).collect();
        (!gain.is_zero() && gain.is_finite()).then_some((Way { light, steps, w: before, gain, source: None }, points))
    }
}
