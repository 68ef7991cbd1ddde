//! Lamps and smooth surfaces: by which flat faces in turn, or by which ball, light of each lamp comes to where it scatters, so that vertices may be connected to points of the lamp ([`crate::transport::lamp`]).
//!
//! Paths find lamps behind glass by chance as well, the more rarely the smaller the lamp. Both share what they find by where it is (the balance heuristic over areas of the lamp), so that what is not listed here, or is not asked for, is left to chance;
//! and what is found at caustics of balls, where the gain of a connection has no bound, weighs no more than what chance finds.

use super::balls::BallOf;
use super::chains::{Chain, Chains, MOST};
use super::{Instance, Scene};
use crate::light::{Light, LightKind};
use crate::math::DVec3;
use crate::math::discrete::Discrete;
use crate::shape::Geometry;
use rustc_hash::FxHashMap;
use smallvec::SmallVec;

/// Solid angle, about, below which a lamp is always asked for by way of few faces: larger ones are found by chance.
const SMALL: f64 = 0.15;
/// Lamps at most: those that send most.
const LAMPS: usize = 64;
/// Chains of a lamp that a vertex asks for at most, on average.
const OF_A_LAMP: f64 = 8.0;
/// Up to so many are cheap; the more there are, the smaller lamps have to be. All ways by a ball cost as many as these.
const CHEAP: f64 = 4.0;
const BALL: f64 = 64.0;

/// Heights over a plane, in scene radii, that are none.
const IN_PLANE: f64 = 1e-6;

/// A face on the way of a ray, and what that does there.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Passed {
    pub shape: u32,
    pub face: u32,
    /// Light that comes by the ray meets its front.
    pub front: bool,
    pub through: bool,
}

/// In the light's order.
pub type Key = SmallVec<[Passed; MOST]>;

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

/// By what a way leads.
#[derive(Clone, Copy)]
pub enum By<'a> {
    Chain(&'a Chain),
    Ball,
}

/// All of them.
#[derive(Debug, Default)]
pub struct Lamps {
    list: Vec<Lamp>,
    /// One of which is asked for each time.
    pub balls: Vec<BallOf>,
    table: Discrete,
}

impl Lamp {
    /// The chain by these faces.
    pub fn chain(&self, faces: &Key) -> Option<&Chain> {
        self.index.get(faces).map(|&id| &self.chains.list[id as usize])
    }

    /// Whether the point q of it is on the side of a chain's first face that light comes from, and not in its plane, as its own faces are: rounding would tell where light goes.
    pub fn is_before(&self, scene: &Scene, chain: &Chain, q: DVec3) -> bool {
        let Some(first) = chain.links.first() else { return false };
        let face = &self.chains.faces[first.face as usize];
        let height = (q - face.p).dot(face.n) * if first.front { 1.0 } else { -1.0 };
        height > IN_PLANE * scene.bounds.radius()
    }

    /// How often ways are asked for from x, if the lamp was chosen.
    pub fn rate(&self, x: DVec3, by_ball: bool) -> f64 {
        let small = if by_ball { SMALL * CHEAP / BALL } else { self.small };
        (small * (x - self.center).length_squared() / self.area).min(1.0)
    }
}

impl Lamps {
    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    pub fn choose(&self, u: f64) -> &Lamp {
        &self.list[self.table.sample(u).0]
    }

    /// Density of a lamp's points, per area, that connections from x by such a way have.
    pub fn density(&self, lamp: &Lamp, x: DVec3, by: By) -> f64 {
        let asked = match by {
            By::Chain(c) => c.asked,
            By::Ball => 1.0 / self.balls.len() as f64,
        };
        lamp.probability * lamp.rate(x, matches!(by, By::Ball)) * asked / lamp.area
    }

    /// What a connection counts, by the balance heuristic ([T] (61)). `own`: its density of points of the lamp, per area; `pdf`: that of the direction at the vertex, per solid angle; `gain`: [T] (47), what surfaces let by and the cosine at the lamp, which makes that one per area.
    pub fn share(own: f64, gain: f64, pdf: f64) -> f64 {
        own / (own + pdf * gain)
    }

    pub fn of_light(&self, light: u32) -> Option<&Lamp> {
        self.list.iter().find(|l| l.light == light)
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
        let mut lamps: Vec<(u32, u32)> = self.lights.iter().enumerate().filter_map(lit).collect();
        lamps.sort_by(|a, b| power[b.0 as usize].total_cmp(&power[a.0 as usize]));
        lamps.truncate(LAMPS);
        // Mirrors of that shape spread light so far that little of it comes anywhere.
        let balls: Vec<BallOf> = self.smooth_balls().into_iter().filter(|b| !b.ball.is_metal).collect();
        let mut list: Vec<Lamp> = Vec::new();
        for ((light, shape), (chains, all)) in lamps.iter().copied().zip(self.chains_of_lamps(&lamps, OF_A_LAMP)) {
            if chains.list.is_empty() && balls.is_empty() {
                continue;
            }
            let key = |c: &Chain| -> Key {
                let faces = c.links.iter().map(|l| (&chains.faces[l.face as usize], l));
                faces
                    .map(|(f, l)| Passed { shape: f.shape, face: f.face, front: l.front, through: l.through })
                    .collect()
            };
            let index = (0..).zip(&chains.list).map(|(k, c)| (key(c), k)).collect();
            let s = &self.shapes[shape as usize].shape;
            let (center, area) = (s.bounds().center(), s.area());
            let small = SMALL * (CHEAP / all).min(1.0);
            list.push(Lamp { light, shape, probability: 0.0, chains, index, center, area, small });
        }
        let table = Discrete::new(list.iter().map(|l| power[l.light as usize]));
        for (k, l) in list.iter_mut().enumerate() {
            l.probability = table.probability(k);
        }
        self.lamps = Lamps { list, balls, table };
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
