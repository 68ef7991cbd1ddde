//! Which media vertices are connected to, and how often: those that glow in few places.

use super::Scene;
use crate::light::LightKind;
use crate::math::DVec3;
use crate::math::discrete::Discrete;
use crate::medium::bright::Blocks;
use std::f64::consts::PI;

/// Media that glow in few places.
#[derive(Clone, Debug, Default)]
pub struct Bright {
    /// One a medium.
    blocks: Vec<Option<Blocks>>,
    /// Among them by power.
    pick: Discrete,
    /// That a vertex is connected to any of them.
    pub probability: f64,
}

impl Bright {
    /// Medium and point.
    pub fn sample(&self, u: f64, v: f64, rest: [f64; 3]) -> Option<(u32, DVec3)> {
        let (id, _, _) = self.pick.sample(u);
        self.blocks[id].as_ref().map(|b| (id as u32, b.sample(v, rest)))
    }

    /// Density per volume by which a vertex is connected to `p` in a medium.
    pub fn density(&self, medium: u32, p: DVec3) -> f64 {
        let blocks = self.blocks.get(medium as usize).and_then(Option::as_ref);
        blocks.map_or(0.0, |b| self.probability * self.pick.probability(medium as usize) * b.density(p))
    }

    /// Whether anything is connected.
    pub fn any(&self) -> bool {
        self.probability > 0.0
    }
}

impl Scene {
    /// Find where media glow; call when lights and bounds are known, and when voxels have changed.
    pub fn prepare_bright(&mut self) {
        let radius = self.bounds.radius();
        let blocks: Vec<Option<Blocks>> = self.media.iter().map(Blocks::new).collect();
        let power = |b: &Option<Blocks>| b.as_ref().map_or(0.0, Blocks::power);
        let pick = Discrete::new(blocks.iter().map(power));
        let _ = (radius, PI, LightKind::Constant);
        let probability = if pick.total > 0.0 { std::env::var("TYNDALL_Q").map_or(1.0, |x| x.parse().unwrap_or(1.0)) } else { 0.0 };
        for b in blocks.iter().flatten() {
            eprintln!("bright: power {} volume {} radius {radius} lights {:?}", b.power(), b.volume(), self.lights.iter().map(|l| l.rough_power(1.0, radius)).collect::<Vec<_>>());
        }
        self.bright = Bright { blocks, pick, probability };
    }
}
