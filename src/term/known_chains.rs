//! Chains of flat smooth faces that the camera is known to see by: found once, with random rays, so that samples may choose among them.
//!
//! By a chain of planes there is at most one ray to a point ([`super::fermat`]), so that a sample which chooses the chain knows its probability. Chains that are not listed, because they
//! bend at spheres, are long, or see little, are left to chance ([`super::shot::draw`]).

use super::fermat::{Planes, Way};
use super::shot::Eye;
use super::shot::{self, Place, Shot, Start, Step, Target};
use crate::math::DVec3;
use crate::math::discrete::Discrete;
use crate::math::rng::{Purpose, Rng};
use crate::scene::Scene;
use crate::transport::ray::Specular;
use std::cell::Cell;
use std::collections::HashMap;

/// Random rays that look for chains.
const RAYS: u64 = 1 << 13;
/// Chains at most: those that were met most often.
const CHAINS: usize = 64;
/// Samples at least for chains that are known, and for others.
const EITHER: f64 = 0.15;

#[derive(Debug)]
struct Chain {
    steps: Vec<Step>,
    planes: Planes,
    /// Where a ray that met it starts.
    o: DVec3,
}

#[derive(Debug)]
pub struct KnownChains {
    list: Vec<Chain>,
    by_rays: Discrete,
    /// Share of samples that choose among them; the others look for what else there is.
    pub share: f64,
}

/// Whether planes give back the ray that a chain was met by. The iteration starts at that very ray: what is asked is that it be stationary, so that indices and sides are those that light went by.
fn finds(planes: &Planes, eye: &Eye, start: Start, chain: &[Specular]) -> bool {
    let Some(last) = chain.last() else { return false };
    let e = last.hit.p + last.out * (last.hit.p - start.o).length();
    let near = |f: Start| (f.w - start.w).length() + (f.o - start.o).length() / (e - start.o).length() <= shot::SAME;
    matches!(planes.ray(eye, start.o, e), Way::Ray(found) if near(found))
}

impl KnownChains {
    pub fn find(scene: &Scene, eye: &Eye, place: &Place, random: impl Fn(&mut Rng) -> Option<Start>) -> KnownChains {
        let mut found: HashMap<Vec<Step>, (usize, Chain)> = HashMap::new();
        let mut rng = Rng::keyed(0, Purpose::Motion as u64, 4, 0);
        let mut all = 0u32;
        for _ in 0..RAYS {
            let Some(start) = random(&mut rng) else { continue };
            let Some(chain) = shot::random_chain(scene, start, place, &mut rng) else { continue };
            all += 1;
            let Some(planes) = Planes::of(scene, &chain).filter(|p| finds(p, eye, start, &chain)) else { continue };
            let steps: Vec<Step> = chain.iter().map(Step::of).collect();
            let new = || (0, Chain { steps: steps.clone(), planes, o: start.o });
            found.entry(steps.clone()).or_insert_with(new).0 += 1;
        }
        let mut list: Vec<_> = found.into_values().collect();
        list.sort_by(|a, b| b.0.cmp(&a.0).then_with(|| a.1.steps.cmp(&b.1.steps)));
        list.truncate(CHAINS);
        let rays: usize = list.iter().map(|c| c.0).sum();
        // Half by what they cover, half alike: by narrow ones edges may move as fast.
        let alike = rays as f64 / list.len().max(1) as f64;
        let by_rays = Discrete::new(list.iter().map(|c| c.0 as f64 + alike));
        // As often as rays meet them, but never to the exclusion of either.
        let share = (rays as f64 / f64::from(all.max(1))).clamp(EITHER, 1.0 - EITHER);
        let share = if list.is_empty() { 0.0 } else { share };
        KnownChains { list: list.into_iter().map(|c| c.1).collect(), by_rays, share }
    }

    pub fn holds(&self, steps: &[Step]) -> bool {
        self.list.iter().any(|c| c.steps == steps)
    }

    /// The shot to e by a chain that `u` chooses, with the probability of that. `lost` counts chains whose ray to e was not found, wherever it goes.
    pub fn shoot(
        &self,
        scene: &Scene,
        eye: &Eye,
        place: &Place,
        e: DVec3,
        u: f64,
        lost: &Cell<u64>,
    ) -> Option<(Shot, f64)> {
        let (k, probability, _) = self.by_rays.sample(u);
        let chain = &self.list[k];
        let start = match chain.planes.ray(eye, chain.o, e) {
            Way::Ray(start) => start,
            Way::None => return None,
            Way::Lost => {
                lost.set(lost.get() + 1);
                return None;
            }
        };
        shot::by(scene, eye, start, place, &chain.steps, &Target::Point(e)).map(|s| (s, probability))
    }
}
