//! What scatters at a vertex, as connections from there see it: how much goes toward a direction, how likely the walk itself takes it, and on which side of a rough interface it begins.

use super::aim::Turn;
use super::record::{Event, Recorder};
use super::state::State;
use crate::math::{DVec3, Rgb};
use crate::phase::one_minus_cos;
use crate::scene::critical::Critical;
use crate::scene::{Hit, On, Scene};
use crate::surface::{Lobe, Normals, Surface};

#[derive(Clone, Copy)]
pub enum Vertex<'a> {
    /// A collision in this medium.
    Medium(u32),
    Surface(Facing<'a>),
}

/// A surface that is met.
#[derive(Clone, Copy)]
pub struct Facing<'a> {
    pub surface: &'a Surface,
    pub id: u32,
    pub p: DVec3,
    /// Directions drawn before it.
    drawn: Option<u32>,
    pub normals: Normals,
    /// Toward where the walk came from.
    pub wi: DVec3,
    /// On the far side: faces that a ray begins on, and the medium there.
    beyond: (On, Option<u32>),
}

impl<'a> Facing<'a> {
    /// With the near side, for a walk that is still where it came from.
    pub fn new(scene: &'a Scene, s: &State, hit: &Hit) -> (Self, On) {
        let shape = &scene.shapes[hit.shape as usize];
        let surface = &scene.surfaces[shape.surface as usize];
        let beyond = (s.on.crossed(hit, s.w, scene.tolerance(hit.p)), shape.medium_behind(s.w, hit.n, s.medium));
        // As for a smooth one: what coincides with a face that is left by a mirrored ray from inside is out of its reach.
        let inside = surface.is_transparent() && s.w.dot(hit.n) > 0.0;
        let near = if inside { On::inside(hit) } else { On::at(hit) };
        (
            Facing { surface, id: shape.surface, p: hit.p, drawn: s.drawn, normals: hit.normals(), wi: -s.w, beyond },
            near,
        )
    }

    /// Whether light along `w` leaves on the far side.
    fn is_beyond(&self, w: DVec3) -> bool {
        self.surface.is_transparent() && self.normals.face.dot(w) * self.normals.face.dot(self.wi) < 0.0
    }

    /// Value and density toward `w`.
    pub fn lobe(&self, scene: &Scene, w: DVec3) -> Lobe {
        let lobe = self.surface.eval(self.normals, self.wi, w, scene.uniform_share);
        Lobe { pdf: scene.critical.density(self.p, self.drawn, w, lobe.pdf), ..lobe }
    }

    /// [`Critical::hidden`] of a direction that was drawn with the density `pdf`.
    pub fn hidden(&self, scene: &Scene, w: DVec3, pdf: f64) -> f64 {
        if self.drawn.is_none() {
            return 1.0;
        }
        let own = self.surface.eval(self.normals, self.wi, w, scene.uniform_share).pdf;
        if own == pdf { 1.0 } else { Critical::hidden(own, pdf) }
    }

    /// Go on along `w` from here.
    pub fn leave(&self, s: &mut State, w: DVec3) {
        (s.on, s.medium) = self.start(s, w);
    }

    fn start(&self, s: &State, w: DVec3) -> (On, Option<u32>) {
        if self.is_beyond(w) { self.beyond } else { (s.on, s.medium) }
    }

    /// How what it sends toward a light changes as the light's direction turns.
    pub(super) fn turn(&self) -> Turn {
        match self.surface {
            Surface::Rough(_) => Turn::Facets { surface: self.id, normals: self.normals, wi: self.wi },
            _ => Turn::Cosine(self.normals.shading),
        }
    }

    /// What the record keeps of a pair of directions where their value is a parameter's: `value` was added by a connection; without it, it is a factor of all that follows.
    pub fn event(&self, wo: DVec3, value: Option<Rgb>) -> Option<Event> {
        let rough = matches!(self.surface, Surface::Rough(_));
        rough.then_some(Event::Facets { surface: self.id, normals: self.normals, wi: self.wi, wo, value })
    }
}

/// Toward one direction.
pub struct Toward {
    pub lobe: Lobe,
    /// The medium, and 1 - cosine, of a collision.
    pub phase: Option<(u32, f64)>,
}

impl Vertex<'_> {
    /// Value and density for light from `w` (away from the vertex); of a surface its reflectance left out where it has one.
    pub fn toward(&self, scene: &Scene, s: &State, w: DVec3) -> Toward {
        match self {
            Vertex::Medium(id) => {
                let m = one_minus_cos(s.w, w);
                let f = scene.media[*id as usize].phase.eval(m);
                let pdf = scene.critical.density(s.o, s.drawn, w, f);
                Toward { lobe: Lobe { f, tint: Rgb::ONE, pdf }, phase: Some((*id, m)) }
            }
            Vertex::Surface(f) => Toward { lobe: f.lobe(scene, w), phase: None },
        }
    }

    /// Faces that a ray along `w` begins on, and its medium.
    pub fn start(&self, s: &State, w: DVec3) -> (On, Option<u32>) {
        match self {
            Vertex::Medium(_) => (s.on, s.medium),
            Vertex::Surface(f) => f.start(s, w),
        }
    }

    /// How what it sends toward a light changes as the light's direction turns.
    pub(super) fn turn(&self, s: &State) -> Turn {
        match self {
            Vertex::Medium(id) => Turn::Phase(*id, s.w),
            Vertex::Surface(f) => f.turn(),
        }
    }

    /// Record that a connection along `w` has added this value.
    pub(super) fn scored<R: Recorder>(&self, rec: &mut R, w: DVec3, value: Rgb) {
        if let (true, Vertex::Surface(f)) = (R::ON, self) {
            f.event(w, Some(value)).into_iter().for_each(|e| rec.push(e));
        }
    }
}
