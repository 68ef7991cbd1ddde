//! The record of a path: what the backward sweep needs, in the order in which it happened.
//!
//! A record holds a few chains (`Event::Chain` starts one): the scattered and the unscattered part of a camera line (through fine grids the first may turn out to pass, too), those of the ray mirrored at the first interface, and for each the mirrored path, if it has one ([`super::mirror`]).
//! Memory is bounded: a path longer than `CHUNK` events keeps checkpoints, and the sweep regenerates one chunk at a time.

use super::aim::Aim;
use super::chained::Backward;
use super::first::{Leg, Opening};
use super::ray::Specular;
use super::state::{Flight, Stage, State};
use super::sweep::{Candidates, SweepFacts};
use super::twin::Ways;
use super::upright::{self, FarLight};
use super::vertex::Vertex;
use super::walk::{Parted, Walker};
use super::way_motion::WayAim;
use crate::light::{Arrival, Emission};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::Slot;
use crate::scene::beams::Step;
use crate::scene::{Hit, March, On, Scene};
use crate::surface::Normals;
use std::sync::Arc;

/// Walks around the light from a vertex of the path.
const CHAINS: f64 = 1.0;

/// Events held at a time, unless a test asks for less.
pub const CHUNK: usize = 4096;

/// A straight piece inside one medium.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MediumSpan {
    pub medium: u32,
    pub o: DVec3,
    pub w: DVec3,
    pub t0: f64,
    pub t1: f64,
    /// What it starts and ends on.
    pub from: Face,
    pub to: Face,
}

/// A face of a shape, or none where a piece ends in the middle of a medium.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Face {
    pub shape: u32,
    pub face: u32,
}

impl Face {
    pub const NONE: Face = Face { shape: u32::MAX, face: 0 };
}

impl MediumSpan {
    /// From a point on the faces `on` to what is hit, or to t1.
    pub fn new(medium: u32, o: DVec3, w: DVec3, t1: f64, on: &On, hit: Option<&Hit>) -> Self {
        let from = on.last().map_or(Face::NONE, |(shape, face)| Face { shape, face });
        let to = hit.filter(|h| h.t <= t1).map_or(Face::NONE, |h| Face { shape: h.shape, face: h.face });
        MediumSpan { medium, o, w, t0: 0.0, t1, from, to }
    }

    /// What lies before a ray, up to what is hit or to the limit; `None` in a vacuum.
    pub fn ahead(ray: &March, limit: f64, hit: Option<&Hit>) -> Option<Self> {
        let t1 = hit.map_or(limit, |h| h.t);
        ray.medium.map(|id| MediumSpan::new(id, ray.o, ray.w, t1, &ray.on, hit))
    }

    /// Its part up to t.
    #[must_use]
    pub fn until(&self, t: f64) -> Self {
        MediumSpan { t1: t, to: if t < self.t1 { Face::NONE } else { self.to }, ..*self }
    }
}

/// Prefix weights at the start of a walked span, for candidates of the derivative vertex [T] (65).
#[derive(Clone, Copy, Debug)]
pub struct Prefix {
    pub beta: Rgb,
    pub r: Rgb,
    pub depth: u32,
    /// Where the span would have ended without a collision.
    pub t_end: f64,
    /// How the span's direction was drawn.
    pub reach: Option<(DVec3, f64)>,
    pub drawn: Option<u32>,
}

/// What a path ends on, as far as motion asks.
#[derive(Clone, Copy, Debug)]
pub enum End {
    /// A point of a shape's face, its geometric normal.
    Shape { shape: u32, face: u32, p: DVec3, n: DVec3 },
    /// A way of a beam ([`crate::scene::beams`]).
    Beam(u32),
    /// A light with a position and no extent; its own motion is [`Event::Aim`]'s.
    Point(u32),
    /// A light without extent, by smooth faces: the record's steps from `first` on, the first one met `at` this point. The light's own motion is [`Event::WayAim`]'s.
    Way { light: u32, first: u32, len: u32, at: DVec3 },
    /// Nothing: this direction, unit, toward the light.
    Infinity(DVec3),
}

impl End {
    /// Of a connection from `o` to `light`.
    pub fn of(light: u32, o: DVec3, a: &Arrival) -> End {
        match a.target {
            Some((shape, face)) => End::Shape { shape, face, p: o + a.w * a.distance, n: a.n },
            None if a.distance < f64::INFINITY => End::Point(light),
            None => End::Infinity(a.w),
        }
    }
}

/// A medium point that the walk did not visit.
#[derive(Clone, Copy, Debug)]
pub struct Drawn {
    pub medium: u32,
    pub p: DVec3,
    /// σ_s, or for emission σ_a.
    pub sigma: Rgb,
    /// The span that it lies on, whole.
    pub span: MediumSpan,
    /// How many of the connection's own spans lead to it.
    pub lead: u32,
}

#[derive(Clone, Copy, Debug)]
pub enum Event {
    /// A new chain begins: what follows does not depend on what came before.
    Chain,
    /// A walked piece; `prefix` where its points are candidates.
    Span { span: MediumSpan, prefix: Option<Prefix> },
    /// A point drawn on the camera line with known weight: a candidate.
    Candidate { medium: u32, p: DVec3, w: DVec3, weight: Rgb, flight: Flight, depth: u32 },
    /// A piece of the camera line, the weights of its start and of its end: candidates where they lie on borders that move.
    Ends { span: MediumSpan, start: Rgb, end: Rgb, depth: u32 },
    /// A collision after travelling along w, on this span where it is known: factor sigma_s of everything after it.
    Scatter { medium: u32, p: DVec3, w: DVec3, span: Option<MediumSpan> },
    /// The phase function of the continuation.
    Turn { medium: u32, one_minus_mu: f64 },
    /// A reflection: factor rho. `prefix.beta/r` before it, for the candidate at small rho.
    Surface { surface: u32, hit: Hit, wi: DVec3, medium: Option<u32>, prefix: Prefix },
    /// Scattering at a rough surface, both directions away from it. A factor of everything after it, or, with a value, of what a connection has just added.
    Facets { surface: u32, normals: Normals, wi: DVec3, wo: DVec3, value: Option<Rgb> },
    /// Light from a direction at which that of the last vertex ends with a jump ([`super::upright`]), as much of the record's list as its share: nothing was added.
    Upright { surface: u32, normals: Normals, wi: DVec3, wo: DVec3, lights: [u32; 2], share: f64 },
    /// A smooth surface turned the ray: factor F, or (1 - F) η².
    Specular(Specular),
    /// Light met by the walk: `weight x emission` was added.
    Emit { weight: Rgb, emission: Emission, end: End },
    /// Emission of the medium at a point of a span, one of the record's drawn ones: `weight x sigma x radiance` was added, `radiance` is L_e; own spans, own phase where a vertex was connected to it.
    Glow { weight: Rgb, radiance: Rgb, via: u32, first_span: u32, spans: u32, phase: Option<(u32, f64)> },
    /// A connection to a light: `weight x emission` was added; own spans, own phase, and for a point that the
    /// walk did not visit, one of the record's drawn ones, its own sigma_s as a further factor.
    Connect {
        weight: Rgb,
        emission: Emission,
        end: End,
        first_span: u32,
        spans: u32,
        phase: [Option<(u32, f64)>; 2],
        via: Option<u32>,
    },
    /// A connection of this value to a light that moves: its motion only.
    Aim { aim: Aim, value: Rgb },
    /// The same by way of flat smooth faces.
    WayAim { aim: WayAim, value: Rgb },
    /// A partial of its own: `value <v, d x / d slot>` for the vector x in three slots.
    Drift { slot: Slot, v: DVec3, value: Rgb },
    /// What everything behind it in its chain counts, besides the weights that the walk gives it ([`super::poles`]).
    Share(f64),
}

impl Event {
    /// Its weights times f.
    fn weigh(&mut self, f: f64) {
        match self {
            Event::Span { prefix: Some(prefix), .. } | Event::Surface { prefix, .. } => prefix.beta *= f,
            Event::Ends { start, end, .. } => {
                *start *= f;
                *end *= f;
            }
            Event::Emit { weight, .. }
            | Event::Glow { weight, .. }
            | Event::Connect { weight, .. }
            | Event::Candidate { weight, .. } => *weight *= f,
            Event::Facets { value: Some(value), .. }
            | Event::Aim { value, .. }
            | Event::WayAim { value, .. }
            | Event::Drift { value, .. } => *value *= f,
            Event::Upright { share, .. } => *share *= f,
            Event::Chain
            | Event::Span { prefix: None, .. }
            | Event::Scatter { .. }
            | Event::Turn { .. }
            | Event::Facets { value: None, .. }
            | Event::Specular(_)
            | Event::Share(_) => {}
        }
    }

    /// Whether light is collected there, or asked for.
    #[inline]
    pub fn adds(&self) -> bool {
        matches!(self, Event::Emit { .. } | Event::Glow { .. } | Event::Connect { .. } | Event::Upright { .. })
    }

    #[inline]
    pub fn moves_a_light(&self) -> bool {
        matches!(self, Event::Aim { .. } | Event::WayAim { .. } | Event::Drift { .. })
    }
}

/// What the walk writes to. `ON = false` compiles every write away.
pub trait Recorder {
    const ON: bool;
    /// Whether vertices are connected to lights. `false` leaves the path alone, with other random numbers.
    const CONNECTS: bool = true;
    fn push(&mut self, _e: Event) {}
    fn side_span(&mut self, _s: MediumSpan) {}
    /// Number of side spans so far, to name a range of them.
    fn side_len(&self) -> u32 {
        0
    }
    /// Forget the side spans from this one on.
    fn side_truncate(&mut self, _len: u32) {}
    /// Keep the steps of a connection's way, and return the number of the first. `aims`: its light moves.
    fn steps(&mut self, _steps: &[Step], _aims: bool) -> u32 {
        0
    }
    /// Keep a drawn point, and return its number.
    fn drawn(&mut self, _d: Drawn) -> u32 {
        0
    }
    /// Called before every stage; true stops the walk there (regeneration of one chunk).
    fn checkpoint(&mut self, _scene: &Scene, _state: &State) -> bool {
        false
    }
    /// Called where the picture's own chain may leave this one, which looks beside critical angles, with what the chains before and this one have come to. True where
    /// the picture's is to be known.
    fn parts(&mut self, _state: &State, _value: [Rgb; 2]) -> bool {
        false
    }
    /// The chain that parted, if one has.
    fn parted(&mut self) -> Option<Box<Parted>> {
        None
    }
    /// A medium span of the camera line without end and without extinction: no candidate can be drawn.
    fn unbounded(&mut self, _medium: u32) {}
    /// The bit in [`State::left`] of a light that moves: its connections are then recorded as [`Event::Aim`] too.
    fn follows(&self, _light: u32) -> Option<u64> {
        None
    }
    /// How that light moves; `None` where its motion is not to be scored in pairs ([`super::twin`]).
    fn ways(&self, _light: u32) -> Option<&Ways> {
        None
    }
    /// Whether paths from a first vertex on this shape are walked in pairs ([`super::mirror`]).
    fn mirrors(&self) -> Option<&SweepFacts> {
        None
    }
    /// What a chain began with that is to go on in another way: its events so far, without what they added to the path.
    fn chain_so_far(&self) -> Option<Vec<Event>> {
        None
    }
    /// `value` was added to the path's, after `order` scatterings.
    fn score(&mut self, _order: u32, _value: Rgb) {}
    /// Nothing more is wanted of this walk.
    fn is_over(&self, _state: &State) -> bool {
        false
    }
    /// Walks drawn around the light a vertex ([`super::beside`]), on average.
    fn chains(&self, _depth: u32) -> f64 {
        CHAINS
    }
    /// The stream for candidates on the camera line; `None` where none are wanted.
    fn candidate_rng(&mut self) -> Option<&mut Rng> {
        None
    }
    /// Called at every vertex that scatters, before a direction is drawn.
    fn at_vertex(_walker: &mut Walker<Self>, _state: &mut State, _vertex: &Vertex)
    where
        Self: Sized,
    {
    }
    /// Whether no vertex moves with a parameter: borders of media may.
    fn is_still(&self) -> bool {
        true
    }
    /// Whether [`Event::Ends`] is asked for: where borders of media move, and hard edges of beams.
    fn wants_ends(&self) -> bool {
        false
    }
}

/// Writes nothing.
pub struct NoRecord;

impl Recorder for NoRecord {
    const ON: bool = false;
}

/// One chunk of events, and the states at the starts of all chunks but the first.
pub struct PathRecord {
    pub events: Vec<Event>,
    pub side: Vec<MediumSpan>,
    pub drawn: Vec<Drawn>,
    /// Of connections by smooth faces.
    pub steps: Vec<Step>,
    /// Of [`Event::Upright`].
    far: Vec<FarLight>,
    /// With the beginning of the chain that goes on there.
    pub chunk_starts: Vec<(State, Opening)>,
    /// Where to look for the derivative vertex.
    pub candidates: Candidates,
    /// Whether to: not while a chunk is regenerated, which then also ends the walk.
    looks: bool,
    /// Events held at a time.
    pub chunk: usize,
    /// Of the sweep that it is for.
    facts: Option<Arc<SweepFacts>>,
    /// Nothing but the motion of lights is asked for: of the path no more is kept.
    lights_only: bool,
    /// What walks have added after at least one scattering.
    pub scattered: Rgb,
    /// Whether the picture's own chains are to be kept where they part, and the one that has.
    pub parts: bool,
    parted: Option<Box<Parted>>,
    /// Legs of all chains of complete chunks ([`Opening`]).
    pub legs: Vec<Leg>,
    /// What these have come to.
    opening: Opening,
    /// Of [`Event::Share`], where the walk is.
    share: Option<f64>,
    /// Kept from path to path.
    pub(super) back: Option<Box<Backward>>,
    unused: Rng,
}

impl PathRecord {
    pub fn new() -> Self {
        PathRecord {
            events: Vec::with_capacity(CHUNK),
            side: Vec::new(),
            drawn: Vec::new(),
            steps: Vec::new(),
            far: Vec::new(),
            chunk_starts: Vec::new(),
            candidates: Candidates::new(Rng::keyed(0, 0, 0, 0)),
            looks: false,
            chunk: CHUNK,
            facts: None,
            lights_only: false,
            scattered: Rgb::ZERO,
            parts: false,
            parted: None,
            legs: Vec::new(),
            opening: Opening::default(),
            share: None,
            back: None,
            unused: Rng::keyed(0, 0, 0, 0),
        }
    }

    /// For a sweep.
    pub(super) fn of(&mut self, facts: &Arc<SweepFacts>) {
        if !self.facts.as_ref().is_some_and(|own| Arc::ptr_eq(own, facts)) {
            (self.facts, self.lights_only) = (Some(facts.clone()), facts.lights_only);
        }
    }

    /// Keep light, and return the range of the list that it is in.
    pub(super) fn far_lights(&mut self, lights: &[FarLight]) -> [u32; 2] {
        let first = self.far.len();
        self.far.extend_from_slice(lights);
        [first, lights.len()].map(|k| k as u32)
    }

    /// Those of a range.
    pub(super) fn far(&self, [first, len]: [u32; 2]) -> &[FarLight] {
        &self.far[first as usize..][..len as usize]
    }

    /// Whether the motion of the arcs of this surface is wanted.
    pub(super) fn asks_upright(&self, surface: u32) -> bool {
        self.facts.as_ref().is_some_and(|f| f.upright[surface as usize])
    }

    /// Ready for a new path, or for a chunk that begins so. `looks`: for a derivative vertex.
    pub fn begin(&mut self, looks: bool, opening: &Opening) {
        self.events.clear();
        self.side.clear();
        self.drawn.clear();
        self.steps.clear();
        self.far.clear();
        self.legs.truncate(opening.legs[1] as usize);
        (self.opening, self.share) = (*opening, opening.share);
        self.looks = looks;
    }
}

impl Default for PathRecord {
    fn default() -> Self {
        Self::new()
    }
}

impl Recorder for PathRecord {
    const ON: bool = true;

    fn score(&mut self, order: u32, value: Rgb) {
        if order > 0 {
            self.scattered += value;
        }
    }

    #[inline]
    fn push(&mut self, e: Event) {
        if self.lights_only && !e.moves_a_light() {
            return;
        }
        match e {
            Event::Chain => self.share = None,
            Event::Share(f) => self.share = Some(f),
            _ => {}
        }
        self.events.push(e);
        if let (Some(f), Some(e)) = (self.share, self.events.last_mut()) {
            e.weigh(f);
        }
    }

    fn side_span(&mut self, s: MediumSpan) {
        if !self.lights_only {
            self.side.push(s);
        }
    }

    fn side_len(&self) -> u32 {
        self.side.len() as u32
    }

    fn side_truncate(&mut self, len: u32) {
        self.side.truncate(len as usize);
    }

    fn steps(&mut self, steps: &[Step], aims: bool) -> u32 {
        let first = self.steps.len() as u32;
        if aims || !self.lights_only {
            self.steps.extend_from_slice(steps);
        }
        first
    }

    fn drawn(&mut self, d: Drawn) -> u32 {
        if !self.lights_only {
            self.drawn.push(d);
        }
        self.drawn.len().saturating_sub(1) as u32
    }

    fn follows(&self, light: u32) -> Option<u64> {
        let light = self.facts.as_ref()?.lights.get(light as usize)?;
        Some(light.0).filter(|&bit| bit != 0)
    }

    fn ways(&self, light: u32) -> Option<&Ways> {
        self.facts.as_ref()?.lights.get(light as usize).map(|m| &m.1)
    }

    fn mirrors(&self) -> Option<&SweepFacts> {
        self.facts.as_deref().filter(|f| f.mirrors)
    }

    fn chain_so_far(&self) -> Option<Vec<Event>> {
        // Not where it began in an earlier chunk.
        let begin = self.events.iter().rposition(|e| matches!(e, Event::Chain))?;
        let kept = |e: &Event| match *e {
            Event::Span { span, .. } => Some(Event::Span { span, prefix: None }),
            Event::Surface { surface, hit, wi, medium, prefix } => {
                let prefix = Prefix { beta: Rgb::ZERO, ..prefix };
                Some(Event::Surface { surface, hit, wi, medium, prefix })
            }
            Event::Scatter { .. } | Event::Share(_) => Some(*e),
            _ => None,
        };
        Some(self.events[begin + 1..].iter().filter_map(kept).collect())
    }

    fn checkpoint(&mut self, scene: &Scene, state: &State) -> bool {
        // A span and the collision that ends it stay together: where that is a leg's first vertex, the span moves with it.
        if self.events.len() < self.chunk || matches!(state.stage, Stage::Medium) {
            return false;
        }
        let (true, Some(facts)) = (self.looks, &self.facts) else { return true };
        // The chunk is complete: draw from its candidates, keep only the state that the next one starts from.
        self.candidates.scan(facts, scene, &self.events);
        for e in &self.events {
            self.legs.extend(self.opening.ended_by(e));
            self.opening.follow(e);
        }
        self.events.clear();
        self.side.clear();
        self.drawn.clear();
        self.steps.clear();
        self.far.clear();
        self.chunk_starts.push((state.clone(), self.opening));
        false
    }

    fn parts(&mut self, state: &State, value: [Rgb; 2]) -> bool {
        if self.parts {
            // The stage at hand, which is taken again, has been counted.
            let mut parted = Box::new((state.plain(), value));
            parted.0.steps -= 1;
            self.parted = Some(parted);
        }
        self.parts
    }

    fn parted(&mut self) -> Option<Box<Parted>> {
        self.parted.take()
    }

    fn at_vertex(w: &mut Walker<Self>, s: &mut State, vertex: &Vertex) {
        upright::ask(w, s, vertex);
    }

    fn unbounded(&mut self, medium: u32) {
        if let (true, Some(facts)) = (self.looks, &self.facts) {
            self.candidates.note_unbounded(facts, medium);
        }
    }

    fn is_still(&self) -> bool {
        self.facts.as_ref().is_none_or(|f| !f.moving.any())
    }

    fn wants_ends(&self) -> bool {
        self.facts.as_ref().is_some_and(|f| f.borders.any())
    }

    fn candidate_rng(&mut self) -> Option<&mut Rng> {
        self.facts.as_ref().filter(|f| f.any_source && !f.lights_only)?;
        // A regenerated chunk must hold as many events as the first time; its candidates are not looked at.
        Some(if self.looks { &mut self.candidates.rng } else { &mut self.unused })
    }
}
