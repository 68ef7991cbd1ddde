//! Connections to lamps by way of flat smooth faces ([`crate::scene::lamps`]): a vertex chooses a lamp and a point of it, and follows the light of that point as that of a point light ([`super::chain`]).
//!
//! The same light is found by directions that meet the lamp by chance. A point of the lamp is found by them with the density `p G cos θ` per area (p: of the direction at the vertex; G [T] (47) with what the faces let by; θ at the lamp),
//! and both share what they find by the balance heuristic.

use super::chain;
use super::pane::{self, Found};
use super::record::Recorder;
use super::vertex::Vertex;
use super::walk::{State, Walker};
use crate::light::Origin;
use crate::math::rng::{Purpose, Rng};
use crate::math::{Rgb, V3};
use crate::scene::lamps::Lamp;
use crate::shape::Geometry;
use smallvec::SmallVec;

/// Score what one lamp brings to the vertex at `s.o` by way of faces.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    if !w.seeks_lamps(s) || !w.may_scatter(s.depth + 1) {
        return;
    }
    let scene = w.scene;
    let mut aside = Rng::keyed(s.rng.next_u64(), Purpose::Manifold as u64, 0, 1);
    let lamp: &Lamp = scene.lamps.choose(aside.uniform());
    if aside.uniform() >= lamp.rate(s.o) {
        return;
    }
    let light = &scene.lights[lamp.light as usize];
    let q = scene.shapes[lamp.shape as usize].shape.sample(aside.uniform(), aside.uniform());
    let from = Origin::Position(V3::constant(q.p));
    let mut drawn: SmallVec<[u32; 64]> = SmallVec::new();
    lamp.chains.draw(s.o, || aside.uniform(), |id| drawn.push(id));
    for id in drawn {
        let chain = &lamp.chains.list[id as usize];
        let order = s.depth + chain.links.len() as u32;
        if !w.may_scatter(order) || order < w.set.min_order || !lamp.chains.may_reach(chain, s.o) {
            continue;
        }
        let unsettled = &mut w.tally.unsettled;
        let found = chain::way(scene, &lamp.chains, (lamp.light, &chain.links), from, s.o, unsettled);
        let Some((mut way, points)) = found else { continue };
        let cos = way.steps.first().map_or(0.0, |step| step.before.dot(q.n));
        if cos <= 0.0 {
            continue;
        }
        let pdf = vertex.toward(scene, s, -way.w).lobe.pdf;
        let share = lamp.share(s.o, chain, way.gain.mean() * cos, pdf);
        way.gain *= cos * share / lamp.density(s.o, chain);
        way.source = Some(q.p);
        pane::score(w, s, vertex, &Found { way: &way, points: &points, emission: light.emission(Rgb::ONE) });
    }
}
