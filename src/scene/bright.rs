//! Which media vertices are connected to: those that glow in few places, whose light gets far before it scatters.
//!
//! Seen from a distance d, what glows takes up about `P = V^(2/3) / (4π d²)` of all directions, V being its volume ([`Blocks::volume`]): so often do drawn directions find
//! it. Nearer than `d*`, where P = 0.1, they need no help. So vertices are connected with the probability `d² / (d² + d*²)`, and media at all where
//!
//! * at least `FAR` of their light that meets anything at all has passed d* by then (measured along rays of a fixed stream from where they glow): not a fire
//!   inside of its own dense smoke;
//! * their power is at least `POWER` of that of all lights.
//!
//! All of this is a function of the scene alone, so that pictures and derivatives draw the same numbers.

use super::{March, On, Scene};
use crate::math::discrete::Discrete;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, Rgb, warp};
use crate::medium::bright::Blocks;
use std::f64::consts::PI;

const FAR: f64 = 0.05;
const POWER: f64 = 0.05;
/// P at d*.
const FOUND: f64 = 0.1;
/// Rays a medium.
const RAYS: u64 = 256;

/// Media that vertices are connected to.
#[derive(Clone, Debug, Default)]
pub struct Bright {
    /// One a medium.
    blocks: Vec<Option<Blocks>>,
    /// Among them by power.
    pick: Discrete,
}

impl Bright {
    /// Medium and point for a vertex at `x`, with the density [`Bright::density`]; `None` where it is not to be connected.
    pub fn sample(&self, x: DVec3, rng: &mut Rng) -> Option<(u32, DVec3)> {
        let (id, _, _) = self.pick.sample(rng.uniform());
        let b = self.blocks[id].as_ref()?;
        if rng.uniform() >= probability(b, x) {
            return None;
        }
        let u = rng.uniform();
        let y = b.sample(u, [rng.uniform(), rng.uniform(), rng.uniform()]);
        Some((id as u32, y))
    }

    /// Density per volume by which a vertex at `x` is connected to `y` in a medium.
    pub fn density(&self, medium: u32, x: DVec3, y: DVec3) -> f64 {
        let blocks = self.blocks.get(medium as usize).and_then(Option::as_ref);
        blocks.map_or(0.0, |b| self.pick.probability(medium as usize) * probability(b, x) * b.density(y))
    }

    /// Whether anything is connected.
    pub fn any(&self) -> bool {
        self.pick.total > 0.0
    }
}

/// d*.
fn near(b: &Blocks) -> f64 {
    b.volume().cbrt() / (4.0 * PI * FOUND).sqrt()
}

/// Probability of connecting a vertex.
fn probability(b: &Blocks, x: DVec3) -> f64 {
    let d2 = (x - b.center()).length_squared();
    d2 / (d2 + near(b).powi(2))
}

impl Scene {
    /// Find what glows in few places; call when lights and bounds are known, and when voxels have changed.
    pub fn prepare_bright(&mut self) {
        let lights = self.light_power().iter().sum::<f64>();
        let mut blocks: Vec<Option<Blocks>> = self.media.iter().map(Blocks::new).collect();
        for (id, b) in blocks.iter_mut().enumerate() {
            let helps = |b: &Blocks| b.power() >= POWER * lights && self.far_share(id as u32, b) >= FAR;
            if b.as_ref().is_some_and(|b| !helps(b)) {
                *b = None;
            }
        }
        let pick = Discrete::new(blocks.iter().map(|b| b.as_ref().map_or(0.0, Blocks::power)));
        self.bright = Bright { blocks, pick };
    }

    /// The share of a medium's light that has passed d* when it meets anything, among all that does.
    fn far_share(&self, id: u32, b: &Blocks) -> f64 {
        let (mut far, mut all) = (0.0, 0.0);
        for k in 0..RAYS {
            let mut rng = Rng::keyed(0, Purpose::Pilot as u64, u64::from(id), k);
            let u = rng.uniform();
            let y = b.sample(u, [rng.uniform(), rng.uniform(), rng.uniform()]);
            let w = warp::sphere(rng.uniform(), rng.uniform());
            let (passes, leaves) = self.passage(y, w, id, near(b));
            // A black wall nearer than d* takes it as the sky does.
            far += (passes - leaves).max(0.0);
            all += 1.0 - leaves;
        }
        if all > 0.0 { far / all } else { 0.0 }
    }

    /// Transmittance from `o` to the distance `d`, and out of the scene; the mean over channels. 0: something opaque stands before it.
    fn passage(&self, o: DVec3, w: DVec3, medium: u32, d: f64) -> (f64, f64) {
        let mut ray = March::new(o, w, On::default(), Some(medium));
        let (mut depth, mut passes) = (Rgb::ZERO, 0.0);
        let kept = |depth: Rgb| depth.map(|x| (-x).exp()).mean();
        for _ in 0..self.max_interfaces {
            let hit = ray.meets(self, f64::INFINITY);
            let length = hit.as_ref().map_or(f64::INFINITY, |h| h.t);
            let add = |t0: f64, t1: f64, depth: &mut Rgb| {
                let Some(m) = ray.medium.map(|id| &self.media[id as usize]) else { return };
                let through = m.density_integral(ray.o, w, t0, t1) * m.scale;
                // Infinity times nothing is nothing.
                *depth += through.map(|x| if x.is_nan() { 0.0 } else { x });
            };
            let before = ray.before;
            let split = (d - before).clamp(0.0, length);
            add(0.0, split, &mut depth);
            if before <= d && before + length > d {
                passes = kept(depth);
            }
            add(split, length, &mut depth);
            let Some(h) = hit else { return (passes, kept(depth)) };
            if !self.passes(&h) {
                return (passes, if self.reflects(&h) { 0.0 } else { kept(depth) });
            }
            ray.pass(self, &h);
        }
        (passes, 0.0)
    }
}
