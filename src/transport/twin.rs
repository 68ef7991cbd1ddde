//! Twins: what a vertex sends toward a light that moves across their axis, in pairs that cancel ([T] 5.5, whose terms they estimate; the pairs themselves are ours).
//!
//! From a vertex x the axis a points to a light at p that stands in a medium. With the next vertex y turned about it by half a turn,
//! `y' = p + ρ(y - p)`, ρ v = 2 <a,v> a - v, both distances x-y and y-p stay; but the score of the inverse square, `2 <n,ṗ>/r` (n = (p-y)/r), changes its sign for the part
//! of ṗ across a. Alone the two are noise about a mean that nearly vanishes; together they cancel but for phase functions, shadows and what is
//! not uniform in the medium.
//!
//! Every technique that draws a point y of a medium at x and connects it to the light becomes symmetric: with density p(y) for y and p(y') for its twin, either scores
//! `f / (p(y) + p(y'))`, whichever was drawn. Points around the light have p(y) = p(y'); directions ω have the vertex's own density, and the flight along ω' draws
//! its distance from the numbers that the flight along ω would draw from next. Weights between techniques are functions of y and stay as they are.
//!
//! Only the motion of the light knows of twins; the walk does not change. Surfaces that a direction meets, panes, and walks around the light have none.

use super::beside::{self, Aims, Followed};
use super::connect;
use super::record::Recorder;
use super::state::{Stage, State};
use super::vertex::{Toward, Vertex};
use super::walk::{ROULETTE, Walker};
use crate::light::Place;
use crate::math::DVec3;
use crate::math::rng::Rng;
use crate::medium::NO_SLOT;
use crate::params::ParamSet;

/// Motion across the axis, over all of it, from which on twins are worth their time.
const ACROSS: f64 = 0.5;

/// `Σ v vᵀ / Σ |v|²` over the velocities v of a light's position by all parameters; its rows.
#[derive(Clone, Copy, Debug, Default)]
pub struct Ways([DVec3; 3]);

impl Ways {
    pub fn new(place: &Place, params: &ParamSet) -> Self {
        if place.position == NO_SLOT {
            return Ways::default();
        }
        let mut rows = [DVec3::ZERO; 3];
        let tangents = [0, 1, 2].map(|k| params.tangents(place.position + k));
        for k in 0..params.len() {
            let v = DVec3::from_array(tangents.map(|t| t[k]));
            (0..3).for_each(|i| rows[i] += v * v[i]);
        }
        let sum = rows[0].x + rows[1].y + rows[2].z;
        if sum > 0.0 { Ways(rows.map(|r| r / sum)) } else { Ways::default() }
    }

    /// The part of the motion across a unit axis: 0 to 1.
    fn across(&self, a: DVec3) -> f64 {
        let [x, y, z] = self.0;
        x.x + y.y + z.z - DVec3::new(x.dot(a), y.dot(a), z.dot(a)).dot(a)
    }
}

/// A light that moves across the axis on which a vertex sees it.
#[derive(Clone, Copy, Debug)]
pub struct Twin {
    pub light: u32,
    bit: u64,
    axis: DVec3,
}

impl Twin {
    /// Of the vertex at `s.o`, where its light counts enough.
    pub fn new<R: Recorder>(w: &Walker<R>, s: &mut State) -> Option<Twin> {
        let wanted = R::ON && w.scene.has_embedded_lights() && w.may_scatter(s.depth + 1);
        if !wanted || s.depth + 1 < w.set.min_order || (s.beta / s.r.mean()).max() < ROULETTE * s.start {
            return None;
        }
        let Followed { light, bit, p, .. } = beside::follow(w, s)?;
        let axis = (p - s.o).normalize();
        let across = w.rec.ways(light).map_or(0.0, |ways| ways.across(axis));
        (across >= ACROSS).then_some(Twin { light, bit, axis })
    }

    /// A vector from the axis, turned about it by half a turn.
    pub fn turn(&self, v: DVec3) -> DVec3 {
        self.axis * (2.0 * self.axis.dot(v)) - v
    }

    /// The same technique at the twin, in a walk of its own: `run` gets its walker, and what moves the light goes to the record.
    pub(super) fn score<R: Recorder>(&self, w: &mut Walker<R>, run: impl FnOnce(&mut Walker<Aims>)) {
        // No vertex of it begins walks around the light, so its depth does not matter.
        Aims::walk(w, self.light, self.bit, 0, run);
    }
}

/// The flight of the twin of a direction `d` that the vertex at `s.o` has drawn with the density `pdf`, `s` being as before it left, up to its first collision. `rng`: what the
/// flight along `d` draws from. Returns the share of that flight's connections.
pub fn fly<R: Recorder>(
    w: &mut Walker<R>,
    s: &State,
    vertex: &Vertex,
    twin: &Twin,
    (d, pdf): (DVec3, f64),
    rng: Rng,
) -> f64 {
    let to = twin.turn(d);
    let Toward { lobe, .. } = vertex.toward(w.scene, s, to);
    if lobe.pdf <= 0.0 {
        return 1.0;
    }
    let sum = pdf + lobe.pdf;
    if lobe.f > 0.0 {
        let (on, medium) = vertex.start(s, to);
        let mut next =
            State { on, r: s.r, hero: s.hero, start: s.start, depth: s.depth, ..State::new(rng, s.o, to, medium) };
        next.beta = s.beta * lobe.tint * (lobe.f / sum);
        (next.pdf_direction, next.left, next.aside) = (lobe.pdf, s.left, s.aside);
        next.drawn = s.drawn.map(|k| k + 1);
        twin.score(w, |sub| to_collision(sub, next));
    }
    pdf / sum
}

/// A flight through interfaces of media to a collision, and the connection from there.
fn to_collision(w: &mut Walker<Aims>, mut s: State) {
    // As many stages as the path itself may take.
    for _ in 0..w.set.cap {
        match s.stage {
            Stage::Fly => w.fly(&mut s),
            Stage::Surface(hit) if w.scene.passes(&hit) => w.surface(&mut s, hit),
            Stage::Medium => {
                let Some(id) = s.medium else { return };
                s.depth += 1;
                return connect::from_medium(w, &mut s, id);
            }
            _ => return,
        }
    }
    w.tally.missed_boundary += 1;
}
