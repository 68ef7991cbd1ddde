//! Connections to lamps by way of flat smooth faces, or of a ball ([`crate::scene::lamps`]): a vertex chooses a lamp and a point of it, and follows the light of that point as that of a point light ([`super::chain`], [`super::ball`]).
//!
//! The same light is found by directions that meet the lamp by chance. A point of the lamp is found by them with the density `p G cos θ` per area (p: of the direction at the vertex; G [T] (47) with what the surfaces let by; θ at the lamp; where indices at both ends differ that is not all, but enough for weights),
//! and both share what they find by the balance heuristic. Derivatives by what moves take what chance finds alone, and all of it.

use super::chain;
use super::pane::{self, Found};
use super::record::Recorder;
use super::state::State;
use super::vertex::Vertex;
use super::walk::Walker;
use crate::light::Origin;
use crate::math::ball_ways::BallWay;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, Rgb, V3};
use crate::scene::balls::BallOf;
use crate::scene::beams::Way;
use crate::scene::chains::{Chain, MOST};
use crate::scene::lamps::{By, Key, Lamp, Lamps, Passed};
use crate::scene::{Hit, Scene};
use crate::shape::{Geometry, SurfaceSample};
use smallvec::SmallVec;

/// How near to each other the directions of two ways by a ball are that are one.
const SAME: f64 = 1e-4;

/// What a ray has passed since it left a vertex where it was scattered.
#[derive(Clone, Debug)]
pub struct Passage {
    /// That vertex.
    x: DVec3,
    /// Its direction there, and how probable that was, per solid angle.
    w: DVec3,
    pdf: f64,
    /// In the ray's order.
    faces: Key,
}

impl Passage {
    pub fn begin(x: DVec3, w: DVec3, pdf: f64) -> Self {
        Passage { x, w, pdf, faces: Key::new() }
    }

    /// The ray is turned by a face that it has met along w; `None` where no way is as long.
    #[must_use]
    pub fn passes(mut self: Box<Self>, hit: &Hit, w: DVec3, through: bool) -> Option<Box<Self>> {
        let front = (w.dot(hit.n) < 0.0) != through;
        self.faces.push(Passed { shape: hit.shape, face: hit.face, front, through });
        (self.faces.len() <= MOST).then_some(self)
    }

    /// What the ray, along w now, counts of the lamp that it has met.
    pub fn share(&self, scene: &Scene, light: u32, hit: &Hit, w: DVec3) -> f64 {
        let lamps = &scene.lamps;
        let Some(lamp) = lamps.of_light(light) else { return 1.0 };
        let found = match lamps.balls.iter().find(|b| self.faces.iter().all(|f| f.shape == b.shape)) {
            Some(ball) => self.by_ball(scene, ball, light, hit.p).map(|gain| (By::Ball, gain)),
            None => self.by_chain(scene, lamp, hit.p).map(|(chain, gain)| (By::Chain(chain), gain)),
        };
        let Some((by, gain)) = found else { return 1.0 };
        1.0 - Lamps::share(lamps.density(lamp, self.x, by), gain * -hit.n.dot(w), self.pdf)
    }

    /// The chain by which it comes to the point q of a lamp, and the gain.
    fn by_chain<'a>(&self, scene: &Scene, lamp: &'a Lamp, q: DVec3) -> Option<(&'a Chain, f64)> {
        let chain = lamp.chain(&self.faces.iter().rev().copied().collect())?;
        if !lamp.is_before(scene, chain, q) {
            return None;
        }
        let (links, from) = ((lamp.light, &chain.links[..]), Origin::Position(V3::constant(q)));
        let (way, _) = chain::along(scene, &lamp.chains, links, from, (self.x, -self.w))?;
        Some((chain, way.gain.mean()))
    }

    /// The gain of the way by a ball.
    fn by_ball(&self, scene: &Scene, b: &BallOf, light: u32, q: DVec3) -> Option<f64> {
        let (n, mut nearest) = (self.faces.len(), None);
        b.ball.ways(q - b.center, false, self.x - b.center, n as u32, None, |way| {
            let passed = self.faces.iter().rev().map(|f| f.through);
            let Some(last) = way.points.last().filter(|_| passed.eq(way.through.iter().copied())) else { return };
            let off = ((b.center + *last - self.x).normalize() - self.w).length();
            if off < nearest.as_ref().map_or(SAME, |n: &(f64, BallWay)| n.0) {
                nearest = Some((off, way));
            }
        });
        let (_, way) = nearest?;
        let (way, _) = b.way(scene.surface_of(b.shape), light, Origin::Position(V3::constant(q)), &way, self.x)?;
        Some(way.gain.mean())
    }
}

/// Score what one lamp brings to the vertex at `s.o` by way of smooth surfaces.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    if !w.seeks_lamps(s) || !w.may_scatter(s.depth + 1) {
        return;
    }
    let mut aside = Rng::keyed(s.rng.next_u64(), Purpose::Manifold as u64, 0, 1);
    let lamp: &Lamp = w.scene.lamps.choose(aside.uniform());
    let q = w.scene.shapes[lamp.shape as usize].shape.sample(aside.uniform(), aside.uniform());
    if !lamp.chains.list.is_empty() && aside.uniform() < lamp.rate(s.o, false) {
        by_chains(w, s, vertex, (lamp, &q), &mut aside);
    }
    if !w.scene.lamps.balls.is_empty() && aside.uniform() < lamp.rate(s.o, true) {
        by_a_ball(w, s, vertex, (lamp, &q), &mut aside);
    }
}

fn by_chains<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    vertex: &Vertex,
    (lamp, q): (&Lamp, &SurfaceSample),
    aside: &mut Rng,
) {
    let from = Origin::Position(V3::constant(q.p));
    let mut drawn: SmallVec<[u32; 64]> = SmallVec::new();
    lamp.chains.draw(s.o, || aside.uniform(), |id| drawn.push(id));
    for id in drawn {
        let chain = &lamp.chains.list[id as usize];
        let asked = counts(w, s, chain.links.len()) && lamp.chains.may_reach(chain, s.o);
        if asked && lamp.is_before(w.scene, chain, q.p) {
            let unsettled = &mut w.tally.unsettled;
            let found = chain::way(w.scene, &lamp.chains, (lamp.light, &chain.links), from, s.o, unsettled);
            if let Some((way, points)) = found {
                score(w, s, vertex, (lamp, q), By::Chain(chain), way, &points);
            }
        }
    }
}

fn by_a_ball<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    vertex: &Vertex,
    (lamp, q): (&Lamp, &SurfaceSample),
    aside: &mut Rng,
) {
    let balls = &w.scene.lamps.balls;
    let b = &balls[((aside.uniform() * balls.len() as f64) as usize).min(balls.len() - 1)];
    let mut found = SmallVec::<[_; 8]>::new();
    b.ball.ways(q.p - b.center, false, s.o - b.center, MOST as u32, None, |way| found.push(way));
    for way in found {
        if counts(w, s, way.points.len()) {
            let way = b.way(w.scene.surface_of(b.shape), lamp.light, Origin::Position(V3::constant(q.p)), &way, s.o);
            if let Some((way, points)) = way {
                score(w, s, vertex, (lamp, q), By::Ball, way, &points);
            }
        }
    }
}

/// Whether the picture shows light that comes to a vertex by so many surfaces.
fn counts<R: Recorder>(w: &Walker<R>, s: &State, surfaces: usize) -> bool {
    let order = s.depth + surfaces as u32;
    w.may_scatter(order) && order >= w.set.min_order
}

fn score<R: Recorder>(
    w: &mut Walker<R>,
    s: &State,
    vertex: &Vertex,
    (lamp, q): (&Lamp, &SurfaceSample),
    by: By,
    mut way: Way,
    points: &[DVec3],
) {
    let (scene, cos) = (w.scene, way.steps.first().map_or(0.0, |step| step.before.dot(q.n)));
    if cos <= 0.0 {
        return;
    }
    let pdf = vertex.toward(scene, s, -way.w).lobe.pdf;
    let own = scene.lamps.density(lamp, s.o, by);
    way.gain *= cos * Lamps::share(own, way.gain.mean() * cos, pdf) / own;
    way.source = Some(q.p);
    let emission = scene.lights[lamp.light as usize].emission(Rgb::ONE);
    pane::score(w, s, vertex, &Found { way: &way, points, emission });
}
