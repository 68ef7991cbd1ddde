//! Chains of flat smooth faces that the camera is known to see by: found once, with random rays, so that samples may choose among them.
//!
//! By a chain of planes there is at most one ray to a point ([`crate::math::fermat`]), so that a sample which chooses the chain knows its probability. Chains that are not listed, because they
//! bend at spheres, are long, or see little, are left to chance ([`crate::transport::chance::draw`]).

use super::planes::planes;
use super::shown::{PIECES, Shown, Spot};
use crate::math::DVec3;
use crate::math::discrete::Discrete;
use crate::math::fermat::{Planes, Way};
use crate::math::rng::{Purpose, Rng};
use crate::scene::Scene;
use crate::transport::chance::{self, TO_EDGES};
use crate::transport::ray::Specular;
use crate::transport::shot::{self, Eye, Place, Shot, Start, Step, Target};
use std::cell::Cell;
use std::collections::HashMap;

/// Random rays that look for chains.
const RAYS: u64 = 1 << 15;
/// Chains at most: those that were met most often.
const CHAINS: usize = 128;
/// Samples at least for chains that are known, and for others.
const EITHER: f64 = 0.15;
/// Points of edges at most that all chains together are asked for.
const POINTS: usize = 1 << 16;
/// Of a chain that seems to show no edge, what is left of its share.
const BLIND: f64 = 0.1;

#[derive(Debug)]
struct Chain {
    steps: Vec<Step>,
    planes: Planes,
    /// Where a ray that met it starts.
    o: DVec3,
    /// How often rays met it.
    rays: usize,
    /// What it shows of the edges, where that is known.
    shown: Option<Shown>,
}

#[derive(Debug, Default)]
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
    matches!(planes.ray(eye, start.o, e), Way::Found(found) if near(found))
}

impl KnownChains {
    pub fn find(scene: &Scene, eye: &Eye, place: &Place, random: impl Fn(&mut Rng) -> Option<Start>) -> KnownChains {
        let mut found: HashMap<Vec<Step>, Chain> = HashMap::new();
        let mut rng = Rng::keyed(0, Purpose::Motion as u64, 4, 0);
        let mut all = 0u32;
        for _ in 0..RAYS {
            let Some(start) = random(&mut rng) else { continue };
            let Some(chance) = chance::random_chain(scene, eye, start, place, TO_EDGES, &mut rng) else { continue };
            let (start, chain) = (chance.start, chance.faces);
            all += 1;
            let Some(planes) = planes(scene, &chain).filter(|p| finds(p, eye, start, &chain)) else { continue };
            let steps: Vec<Step> = shot::steps(scene, &chain);
            let new = || Chain { steps: steps.clone(), planes, o: start.o, rays: 0, shown: None };
            found.entry(steps.clone()).or_insert_with(new).rays += 1;
        }
        let mut list: Vec<Chain> = found.into_values().collect();
        list.sort_by(|a, b| b.rays.cmp(&a.rays).then_with(|| a.steps.cmp(&b.steps)));
        list.truncate(CHAINS);
        let rays: usize = list.iter().map(|c| c.rays).sum();
        // As often as rays meet them, but never to the exclusion of either.
        let share = (rays as f64 / f64::from(all.max(1))).clamp(EITHER, 1.0 - EITHER);
        let share = if list.is_empty() { 0.0 } else { share };
        let mut known = KnownChains { list, by_rays: Discrete::default(), share };
        known.weigh();
        known
    }

    /// Half by what chains cover, half alike: by narrow ones edges may move as fast.
    fn weigh(&mut self) {
        let rays: usize = self.list.iter().map(|c| c.rays).sum();
        let alike = rays as f64 / self.list.len().max(1) as f64;
        let weight = |c: &Chain| {
            let sees = if c.shown.as_ref().is_some_and(|s| !s.any) { BLIND } else { 1.0 };
            sees * (c.rays as f64 + alike)
        };
        self.by_rays = Discrete::new(self.list.iter().map(weight));
    }

    /// Find out what chains show of these edges, all that there are: those that were met most often, as far as the points go.
    pub fn look_at(&mut self, scene: &Scene, eye: &Eye, edges: &[(usize, [DVec3; 2])]) {
        let chains = POINTS / (edges.len().max(1) * (PIECES + 1));
        if !edges.is_empty() {
            for c in self.list.iter_mut().take(chains) {
                c.shown = Some(Shown::new(scene, eye, (&c.planes, &c.steps, c.o), edges));
            }
            self.weigh();
        }
    }

    /// A chain that `u` chooses, with the probability of that.
    pub fn choose(&self, u: f64) -> (usize, f64) {
        let (k, probability, _) = self.by_rays.sample(u);
        (k, probability)
    }

    /// A place on the edges for this chain; `None` where nobody has looked what it shows.
    pub fn spot(&self, chain: usize, u: f64) -> Option<Spot> {
        self.list[chain].shown.as_ref().map(|s| s.sample(u))
    }

    pub fn holds(&self, steps: &[Step]) -> bool {
        self.list.iter().any(|c| c.steps == steps)
    }

    /// The shot to e by this chain. `lost` counts chains whose ray to e was not found, wherever it goes.
    pub fn shoot(
        &self,
        scene: &Scene,
        eye: &Eye,
        place: &Place,
        e: DVec3,
        chain: usize,
        lost: &Cell<u64>,
    ) -> Option<Shot> {
        let chain = &self.list[chain];
        let start = match chain.planes.ray(eye, chain.o, e) {
            Way::Found(start) => start,
            Way::None => return None,
            Way::Lost => {
                lost.set(lost.get() + 1);
                return None;
            }
        };
        shot::by(scene, eye, start, place, &chain.steps, &Target::Point(e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::compile::LoadOptions;
    use crate::scene::desc::SceneDesc;
    use std::path::Path;

    /// scenes/mirror_edge: drawn by windows, places on the board's edges are seen by chains that show less than a twentieth of them far more often than drawn by length; how much of the edges is seen, summed over all chains, is the same.
    #[test]
    fn windows_find_what_chains_show() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/mirror_edge/scene.xml");
        let desc = SceneDesc::parse(&std::fs::read_to_string(&path).unwrap(), &path, &[]).unwrap();
        let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
        let sensor = &scene.sensors[0];
        let (o, _) = sensor.ray(0.0, 0.0);
        let (eye, place) = (Eye::Point(o), Place::within(sensor.medium));
        let random = |rng: &mut Rng| {
            let (o, w) = sensor.ray(16.0 * rng.uniform(), 16.0 * rng.uniform());
            Some(Start { o, w })
        };
        let corners = crate::shape::edges::with_corners(&scene.shapes[0].shape, 0, <[DVec3]>::to_vec).unwrap();
        let edges: Vec<(usize, [DVec3; 2])> = crate::shape::edges::border(&corners).enumerate().collect();
        let mut known = KnownChains::find(&scene, &eye, &place, random);
        known.look_at(&scene, &eye, &edges);
        let length = |e: usize| (edges[e].1[1] - edges[e].1[0]).length();
        let all: f64 = (0..edges.len()).map(length).sum();
        let by_length = Discrete::new((0..edges.len()).map(length));
        let n = 600;
        let (mut narrow, mut seen) = ([0; 2], [0.0; 2]);
        for chain in 0..known.list.len() {
            let mut hits = [0; 2];
            for k in 0..n {
                let u = (f64::from(k) + 0.5) / f64::from(n);
                let spots = [Spot::of(&by_length, u), known.spot(chain, u).unwrap()];
                for (i, s) in spots.into_iter().enumerate() {
                    let [a, b] = edges[s.edge].1;
                    let lost = Cell::new(0);
                    if known.shoot(&scene, &eye, &place, a.lerp(b, s.t), chain, &lost).is_some() {
                        hits[i] += 1;
                        seen[i] += length(s.edge) / (s.density * f64::from(n) * all);
                    }
                }
            }
            if hits[0] <= n / 20 {
                (narrow[0], narrow[1]) = (narrow[0] + hits[0], narrow[1] + hits[1]);
            }
        }
        assert!(narrow[0] > 20 && narrow[1] > 3 * narrow[0], "{narrow:?}");
        assert!((seen[1] / seen[0] - 1.0).abs() < 0.03, "{seen:?}");
    }
}
