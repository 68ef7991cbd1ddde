//! Where refracted light of a rough surface ends with a jump ([`crate::surface::upright`]): derivatives ask at each of its vertices what light comes from there, [T] (18).
//!
//! A direction of the arc is drawn, and a walk of its own follows it: all light that it brings is its own, no connection from the vertex competes with a given direction. What the path keeps is that
//! light, and on what it came from the vertex: a point of a medium or a face, or from infinity. How those points move, and the vertex, moves the arc ([`super::motion`]). The picture gets nothing of it.

use super::record::{Drawn, End, Event, PathRecord, Recorder};
use super::state::{Stage, State};
use super::vertex::{Facing, Vertex};
use super::walk::Walker;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, Rgb};
use crate::surface::Surface;

/// Part of the light at the first vertex from which on a walk is certain to be followed: below, it is followed in proportion. At the kth it is k² times that, up to the fifth, and from the 25th on k times, or paths that stay
/// in rough glass for long would begin walks as long as themselves at each of its vertices.
const CERTAIN: f64 = 0.01;

/// The end of a segment from the vertex.
#[derive(Clone, Copy, Debug)]
pub enum Far {
    /// A point of a medium.
    Medium(DVec3),
    /// Of a face, or infinity.
    End(End),
}

/// Light that came to the vertex from there.
#[derive(Clone, Copy, Debug)]
pub struct FarLight {
    pub far: Far,
    pub value: Rgb,
}

/// By what segments from its first point light came to a walk.
#[derive(Default)]
struct FirstSegments {
    lights: Vec<FarLight>,
    drawn: Vec<Drawn>,
    /// What the walk's own first segment ended on; what is behind came by that.
    ended: Option<Far>,
}

impl Recorder for FirstSegments {
    const ON: bool = true;

    fn push(&mut self, e: Event) {
        if self.ended.is_some() {
            return;
        }
        let by_point = |k: u32| Far::Medium(self.drawn[k as usize].p);
        let light = match e {
            Event::Scatter { p, .. } => return self.ended = Some(Far::Medium(p)),
            Event::Surface { hit, .. } => {
                let end = End::Shape { shape: hit.shape, face: hit.face, p: hit.p, n: hit.n };
                return self.ended = Some(Far::End(end));
            }
            // What is behind a smooth face keeps the direction.
            Event::Specular(s) => return self.ended = Some(Far::End(End::Infinity(s.w))),
            Event::Emit { weight, emission, end } => FarLight { far: Far::End(end), value: weight * emission.color() },
            Event::Connect { weight, emission, via: Some(k), .. } => {
                let sigma = self.drawn[k as usize].sigma;
                FarLight { far: by_point(k), value: weight * sigma * emission.color() }
            }
            Event::Glow { weight, radiance, via, .. } => {
                let sigma = self.drawn[via as usize].sigma;
                FarLight { far: by_point(via), value: weight * sigma * radiance }
            }
            _ => return,
        };
        self.lights.push(light);
    }

    fn drawn(&mut self, d: Drawn) -> u32 {
        if self.ended.is_none() {
            self.drawn.push(d);
        }
        self.drawn.len().saturating_sub(1) as u32
    }
}

/// Ask, at a vertex of a recorded path, for the light along a direction of its arc.
pub(super) fn ask(w: &mut Walker<PathRecord>, s: &mut State, vertex: &Vertex) {
    let Vertex::Surface(facing) = vertex else { return };
    let Surface::Rough(rough) = facing.surface else { return };
    if !w.rec.asks_upright(facing.id) {
        return;
    }
    let Some(arc) = rough.arc(facing.normals, facing.wi) else { return };
    let mut rng = Rng::keyed(s.aside.next_u64(), Purpose::Motion as u64, 0, 0);
    let (wo, measure) = arc.draw(rng.uniform());
    let part = rough.jump(facing.normals, facing.wi, wo) * measure;
    let k = f64::from(s.depth);
    let p = (part / (CERTAIN * (k * k).min(25.0).max(k))).min(1.0);
    if part > 0.0 && rng.uniform() < p {
        follow(w, s, facing, wo, part / p, rng);
    }
}

fn follow(w: &mut Walker<PathRecord>, s: &State, facing: &Facing, wo: DVec3, weight: f64, rng: Rng) {
    // Nothing is asked of its stream aside.
    let mut from = State { stage: Stage::Fly, rng, aside: rng, ..s.plain() };
    facing.leave(&mut from, wo);
    from.w = wo;
    from.beta *= weight;
    from.start *= weight;
    from.pdf_direction = 0.0;
    from.twin = None;
    let mut rec = FirstSegments::default();
    let mut walk = Walker::new(w.scene, w.set, &mut rec);
    walk.run(from);
    let (value, tally) = (walk.total(), walk.tally);
    w.tally = w.tally.plus(&tally);
    let before = rec.lights.iter().fold(Rgb::ZERO, |sum, l| sum + l.value);
    if let Some(far) = rec.ended {
        rec.lights.push(FarLight { far, value: value - before });
    }
    rec.lights.retain(|l| !l.value.is_zero());
    if !rec.lights.is_empty() {
        let lights = w.rec.far_lights(&rec.lights);
        let Facing { id, normals, wi, .. } = *facing;
        w.rec.push(Event::Upright { surface: id, normals, wi, wo, lights, share: 1.0 });
    }
}
