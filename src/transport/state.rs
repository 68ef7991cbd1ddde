//! The state of a path: all that determines the rest of it, so that it can be walked again from there.

use super::lamp::Passage;
use super::lead::Lead;
use super::poles::Poles;
use super::record::MediumSpan;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::scene::{Hit, March, On, Scene};
use std::sync::Arc;

/// How the walk goes on from a state.
#[derive(Clone, Copy, Debug)]
pub enum Stage {
    /// Fly from `o` along `w`.
    Fly,
    /// The same on a camera line that interfaces have turned: [`super::camera_line`].
    Line,
    /// A collision at `o` after travelling along `w`.
    Medium,
    /// On a surface after travelling along `w`.
    Surface(Hit),
    /// The same without its emission: a derivative vertex.
    Reflect(Hit),
    /// Out of the scene along `w`.
    Escape,
    /// Nothing left in this chain.
    Done,
}

/// All that determines the rest of a path; `Clone`, so that a chunk can be walked again.
#[derive(Clone, Debug)]
pub struct State {
    pub stage: Stage,
    pub o: DVec3,
    pub w: DVec3,
    pub on: On,
    pub medium: Option<u32>,
    pub beta: Rgb,
    pub r: Rgb,
    pub hero: usize,
    /// Weight at the start of the chain, which roulette is relative to.
    pub start: f64,
    /// Scatterings so far.
    pub depth: u32,
    /// Density per solid angle with which `w` was drawn at the last vertex; 0 on a camera line (nothing competes).
    pub pdf_direction: f64,
    /// The last vertex.
    pub vertex: DVec3,
    /// Moving lights (a bit each) whose motion somebody else scores for whatever this path still does: [`beside`].
    pub left: u64,
    /// Optical depth of homogeneous spans since the last vertex, for the MIS weight.
    pub tau: Rgb,
    /// Probability with which the last vertex connected to the environment.
    pub to_environment: f64,
    /// What it has passed since, where lamps are connected to by way of that ([`super::lamp`]).
    pub passage: Option<Box<Passage>>,
    /// Technique weights of the equi-angular connection at the collision at hand.
    pub flight: Flight,
    /// A light, and the share of this flight's connections to it in its motion ([`twin`]).
    pub twin: Option<(u32, f64)>,
    /// First surface vertex of a derivative continuation: its reflectance counts as 1.
    pub unit_reflectance: bool,
    /// Of a mirrored path ([`mirror`]): the stream aside that the walk goes on with after it.
    pub mirrored: Option<Box<Rng>>,
    /// What waits for this chain to end, one behind the other: unscattered parts of camera lines, the ray mirrored at the first interface, a mirrored path.
    pub pending: Option<Box<State>>,
    /// Spans of the camera line up to here, and what turned it, for the records of all chains that begin with them; of a mirrored path, its chain's events up to the first vertex, too.
    pub lead: Lead,
    /// Its number in the tree of all chains of its path, from 1: of k, 2k goes on where 2k + 1 branches off.
    pub chain: u32,
    /// Nothing but smooth interfaces has turned it since the camera.
    pub direct: bool,
    /// Of these the last ones.
    pub in_a_row: u32,
    /// Around which the collision on the camera line is drawn as well ([`super::poles`]).
    pub poles: Option<Arc<Poles>>,
    /// Directions drawn since the camera, on paths that look beside critical angles ([`crate::scene::critical`]).
    pub drawn: Option<u32>,
    /// Whether it has gone another way than the picture's own path for that.
    pub astray: bool,
    pub rng: Rng,
    /// A stream beside the path's own, for what only derivatives ask for.
    pub aside: Rng,
    pub steps: u64,
}

/// How a camera path begins; it can be walked again from here.
#[derive(Clone, Debug)]
pub struct Beginning {
    pub rng: Rng,
    pub o: DVec3,
    pub w: DVec3,
    pub medium: Option<u32>,
    pub poles: Option<Arc<Poles>>,
}

impl Beginning {
    pub fn new(rng: Rng, o: DVec3, w: DVec3, medium: Option<u32>) -> Self {
        Beginning { rng, o, w, medium, poles: None }
    }

    pub fn state(&self) -> State {
        State::begun(self.rng, self.o, self.w, self.medium, self.poles.clone())
    }
}

/// The span a collision was drawn on, and its free-flight density there (or a stand-in): what an
/// equi-angular connection competes with.
#[derive(Clone, Copy, Debug, Default)]
pub struct Flight {
    pub span: Option<MediumSpan>,
    pub density: f64,
    /// The vertex that the span's direction was drawn at, and its density per solid angle; `None` on a camera line, whose
    /// direction nothing else draws.
    pub reach: Option<(DVec3, f64)>,
    /// [`State::drawn`] there.
    pub drawn: Option<u32>,
}

impl State {
    /// How the current direction was drawn, see [`Flight::reach`].
    pub fn reach(&self) -> Option<(DVec3, f64)> {
        (self.pdf_direction > 0.0).then_some((self.vertex, self.pdf_direction))
    }

    /// Whether directions drawn beside critical angles may come about at the next stage, which is not at a smooth interface.
    pub(super) fn looks_beside(&self, scene: &Scene) -> bool {
        match self.stage {
            Stage::Medium => true,
            Stage::Surface(h) | Stage::Reflect(h) => !scene.surface_of(h.shape).is_smooth(),
            _ => false,
        }
    }

    /// This chain without a look beside critical angles, for a walk without a record.
    #[must_use]
    pub fn plain(&self) -> Self {
        let flight = Flight { drawn: None, ..self.flight };
        State {
            drawn: None,
            astray: false,
            flight,
            mirrored: None,
            pending: None,
            passage: self.passage.clone(),
            lead: Lead::default(),
            poles: None,
            ..*self
        }
    }

    /// What is to be followed besides, in a chain of its own.
    pub fn branch(&mut self) -> Box<State> {
        let waiting = self.pending.take();
        let mut branch = Box::new(self.clone());
        (branch.pending, branch.rng) = (waiting, self.rng.branch(self.chain - 1));
        // Beyond the first few numbers nobody asks which it is.
        let k = self.chain.min(1 << 30);
        (branch.chain, self.chain) = (2 * k + 1, 2 * k);
        branch
    }

    /// Go on behind an interface, straight.
    pub fn pass(&mut self, scene: &Scene, hit: &Hit) {
        let mut ray = March::new(self.o, self.w, self.on, self.medium);
        ray.pass(scene, hit);
        (self.o, self.on, self.medium) = (ray.o, ray.on, ray.medium);
    }

    pub fn new(rng: Rng, o: DVec3, w: DVec3, medium: Option<u32>) -> Self {
        State::begun(rng, o, w, medium, None)
    }

    fn begun(rng: Rng, o: DVec3, w: DVec3, medium: Option<u32>, poles: Option<Arc<Poles>>) -> Self {
        State {
            stage: Stage::Fly,
            o,
            w,
            on: On::default(),
            medium,
            beta: Rgb::ONE,
            r: Rgb::ONE,
            hero: 0,
            start: 1.0,
            depth: 0,
            pdf_direction: 0.0,
            vertex: o,
            left: 0,
            tau: Rgb::ZERO,
            to_environment: 0.0,
            passage: None,
            flight: Flight::default(),
            twin: None,
            unit_reflectance: false,
            mirrored: None,
            pending: None,
            lead: Lead::default(),
            chain: 1,
            direct: true,
            in_a_row: 0,
            poles,
            drawn: None,
            astray: false,
            rng,
            aside: rng,
            steps: 0,
        }
    }
}
