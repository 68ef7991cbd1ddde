//! Lamps and flat smooth faces: by which faces light of each lamp comes to where it scatters, so that vertices may be connected to points of the lamp ([`crate::transport::lamp`]).
//!
//! Paths find lamps behind glass by chance as well, the more rarely the smaller the lamp. Both share what they find by where it is (the balance heuristic over areas of the lamp), so that what is not listed here, or is not asked for, is left to chance.

use super::chains::{Chain, Chains, MOST};
use super::{Instance, Scene};
use crate::light::{Light, LightKind, Origin};
use crate::math::discrete::Discrete;
use crate::math::{DVec3, V3};
use crate::scene::Hit;
use crate::shape::Geometry;
use crate::transport::chain;
use rustc_hash::FxHashMap;
use smallvec::SmallVec;

/// Solid angle, about, below which a lamp is always asked for by way of few faces: larger ones are found by chance.
const SMALL: f64 = 0.3;
/// Chains of all lamps that a vertex asks for at most, on average.
const ASKED: f64 = 16.0;
/// Up to so many are cheap; the more there are, the smaller lamps have to be.
const CHEAP: f64 = 4.0;

/// A face on the way of a ray, and what that does there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Passed {
    shape: u32,
    face: u32,
    /// Light that comes by the ray meets its front.
    front: bool,
    through: bool,
}

type Key = SmallVec<[Passed; MOST]>;

/// A lamp, and by which faces its light goes.
#[derive(Debug)]
pub struct Lamp {
    pub light: u32,
    pub shape: u32,
    /// How often it is chosen.
    probability: f64,
    pub chains: Chains,
    index: FxHashMap<Key, u32>,
    center: DVec3,
    pub area: f64,
    /// Solid angle, about, below which it is always asked for.
    small: f64,
}

/// All of them.
#[derive(Debug, Default)]
pub struct Lamps {
    list: Vec<Lamp>,
    table: Discrete,
}

/// What a ray has passed since it left a vertex where it was scattered.
#[derive(Clone, Debug)]
pub struct Passage {
    /// That vertex.
    x: DVec3,
    /// Its direction there, and how probable that was, per solid angle.
    w: DVec3,
    pdf: f64,
    faces: Key,
}

impl Passage {
    pub fn begin(x: DVec3, w: DVec3, pdf: f64) -> Self {
        Passage { x, w, pdf, faces: Key::new() }
    }

    /// The ray is turned by a face that it has met along w; `None` where no chain is as long.
    #[must_use]
    pub fn passes(mut self: Box<Self>, hit: &Hit, w: DVec3, through: bool) -> Option<Box<Self>> {
        let front = (w.dot(hit.n) < 0.0) != through;
        self.faces.push(Passed { shape: hit.shape, face: hit.face, front, through });
        (self.faces.len() <= MOST).then_some(self)
    }
}

impl Lamp {
    /// How often it is asked for from x, if it was chosen.
    pub fn rate(&self, x: DVec3) -> f64 {
        (self.small * (x - self.center).length_squared() / self.area).min(1.0)
    }

    /// Density of its points, per area, that a connection from x by a chain has.
    pub fn density(&self, x: DVec3, chain: &Chain) -> f64 {
        self.probability * self.rate(x) * chain.asked / self.area
    }

    /// Of the two densities with which connections and chance find a point of it, that of connections. `gain`: what arrives of its light at x, the cosine at the lamp with it; `pdf`: of the direction at x.
    pub fn share(&self, x: DVec3, chain: &Chain, gain: f64, pdf: f64) -> f64 {
        let own = self.density(x, chain);
        own / (own + pdf * gain)
    }

    /// The share of a ray that has met the lamp by chance.
    fn share_of_chance(&self, scene: &Scene, passage: &Passage, hit: &Hit, w: DVec3) -> f64 {
        let key: Key = passage.faces.iter().rev().copied().collect();
        let Some(&id) = self.index.get(&key) else { return 1.0 };
        let (chain, from) = (&self.chains.list[id as usize], Origin::Position(V3::constant(hit.p)));
        let arrives = (passage.x, -passage.w);
        let Some((way, _)) = chain::along(scene, &self.chains, (self.light, &chain.links), from, arrives) else {
            return 1.0;
        };
        1.0 - self.share(passage.x, chain, way.gain.mean() * -hit.n.dot(w), passage.pdf)
    }
}

impl Lamps {
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    pub fn choose(&self, u: f64) -> &Lamp {
        &self.list[self.table.sample(u).0]
    }

    /// What a ray along w that has come by `passage` counts of the lamp that it meets.
    pub fn share_of_chance(&self, scene: &Scene, light: u32, passage: &Passage, hit: &Hit, w: DVec3) -> f64 {
        let lamp = self.list.iter().find(|l| l.light == light);
        lamp.map_or(1.0, |l| l.share_of_chance(scene, passage, hit, w))
    }
}

impl Scene {
    /// List them; call when shapes, surfaces and lights are known.
    pub fn prepare_lamps(&mut self) {
        let power = self.light_power();
        let shape_of = |l: &Light| match l.kind {
            LightKind::Area { shape } => Some(shape),
            _ => None,
        };
        let lit = |(id, l): (usize, &Light)| Some((id as u32, shape_of(l).filter(|_| power[id] > 0.0)?));
        let lamps: Vec<(u32, u32)> = self.lights.iter().enumerate().filter_map(lit).collect();
        let n = lamps.len() as f64;
        let mut list: Vec<Lamp> = Vec::new();
        for (light, shape) in lamps {
            let s = &self.shapes[shape as usize];
            let Some((chains, all)) = self.chains_of_lamp(light, s, ASKED / n) else { continue };
            let key = |c: &Chain| -> Key {
                let faces = c.links.iter().map(|l| (&chains.faces[l.face as usize], l));
                faces
                    .map(|(f, l)| Passed { shape: f.shape, face: f.face, front: l.front, through: l.through })
                    .collect()
            };
            let index = (0..).zip(&chains.list).map(|(k, c)| (key(c), k)).collect();
            let (center, area) = (s.shape.bounds().center(), s.shape.area());
            let small = SMALL * (CHEAP / all).min(1.0);
            list.push(Lamp { light, shape, probability: 0.0, chains, index, center, area, small });
        }
        let table = Discrete::new(list.iter().map(|l| power[l.light as usize]));
        for (k, l) in list.iter_mut().enumerate() {
            l.probability = table.probability(k);
        }
        self.lamps = Lamps { list, table };
    }

    /// Whether a lamp lies wholly inside or outside of every smooth closed shape.
    pub(super) fn is_clear_of_glass(&self, lamp: &Instance) -> bool {
        let bounds = lamp.shape.bounds();
        let corners = bounds.corners();
        self.shapes.iter().enumerate().all(|(id, s)| {
            let closed = self.surfaces[s.surface as usize].is_smooth() && s.shape.is_closed();
            let own = self.bodies.of(id as u32);
            let held = || corners.iter().all(|c| self.bodies.holding(*c) & own != 0);
            !closed || s.shape.bounds().gap(&bounds) > 0.0 || own != 0 && held()
        })
    }
}
