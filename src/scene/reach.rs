//! Which pencils reach a point: trees of pencils, each node with one that holds all below it. Pencils that are asked for equally often are a tree, and those between two that are asked for cost nothing.

use super::chains::Chain;
use crate::math::DVec3;
use crate::math::ball_tree::extent;
use crate::math::pencil::Pencil;

/// So many pencils of a leaf are asked for on average, at most.
const LEAF: f64 = 4.0;

#[derive(Debug)]
struct Node {
    bound: Pencil,
    /// Behind the last one of its pencils in the order, and behind all nodes below it.
    last: u32,
    next: u32,
}

/// Pencils, and where they go.
#[derive(Debug, Default)]
pub struct Reach {
    /// With their numbers, in the order of the trees.
    pencils: Vec<(u32, Pencil)>,
    /// Of each tree how often its pencils are asked for, and the first of them.
    trees: Vec<(f64, u32)>,
    /// Of all trees, children behind their parents.
    nodes: Vec<Node>,
}

impl Reach {
    /// What chains send on.
    pub fn of(pencils: Vec<Pencil>, chains: &[Chain]) -> Self {
        Self::new(pencils, &chains.iter().map(|c| c.asked).collect::<Vec<_>>())
    }

    /// `asked`: how often each is asked for.
    pub fn new(pencils: Vec<Pencil>, asked: &[f64]) -> Self {
        let mut all: Vec<(u32, Pencil)> = (0..).zip(pencils).collect();
        let often = |p: &(u32, Pencil)| asked[p.0 as usize];
        all.sort_by(|a, b| often(b).total_cmp(&often(a)));
        let (low, high) = extent(all.iter().map(|p| p.1.center));
        let size = (high - low).max_element();
        let mut reach = Reach::default();
        for equal in all.chunk_by_mut(|a, b| often(a) == often(b)) {
            let q = often(&equal[0]);
            reach.trees.push((q, reach.pencils.len() as u32));
            reach.grow(equal, size, (LEAF / q).max(1.0) as usize);
        }
        reach
    }

    fn grow(&mut self, some: &mut [(u32, Pencil)], size: f64, leaf: usize) {
        let at = self.nodes.len();
        let last = (self.pencils.len() + some.len()) as u32;
        self.nodes.push(Node { bound: Pencil::around(some.iter().map(|p| p.1)), last, next: at as u32 + 1 });
        if some.len() <= leaf {
            self.pencils.extend_from_slice(some);
            return;
        }
        // By place or by direction, whichever varies more.
        let places = extent(some.iter().map(|p| p.1.center));
        let axes = extent(some.iter().map(|p| p.1.cone.axis));
        let (place, axis) = ((places.1 - places.0) / size, axes.1 - axes.0);
        let by_place = place.max_element() > axis.max_element();
        let k = if by_place { place } else { axis }.max_position();
        let key = |p: &(u32, Pencil)| if by_place { p.1.center[k] } else { p.1.cone.axis[k] };
        let half = some.len() / 2;
        some.select_nth_unstable_by(half, |a, b| key(a).total_cmp(&key(b)).then(a.0.cmp(&b.0)));
        let (a, b) = some.split_at_mut(half);
        self.grow(a, size, leaf);
        self.grow(b, size, leaf);
        self.nodes[at].next = self.nodes.len() as u32;
    }

    /// Pencils that reach x, each with the probability with which it is asked for, and their numbers.
    pub fn draw(&self, x: DVec3, mut uniform: impl FnMut() -> f64, mut found: impl FnMut(u32, &Pencil)) {
        let mut at = 0;
        for (t, &(q, first)) in self.trees.iter().enumerate() {
            let end = self.trees.get(t + 1).map_or(self.pencils.len(), |next| next.1 as usize);
            let rate = (-q).ln_1p();
            // So many are passed over, geometrically distributed.
            let mut skip = || if q >= 1.0 { 0 } else { ((-uniform()).ln_1p() / rate).min(1e9) as usize };
            // The next one that is asked for, if it is found to reach.
            let mut k = first as usize + skip();
            while let Some(node) = self.nodes.get(at).filter(|n| n.last as usize <= end) {
                let (last, is_leaf) = (node.last as usize, node.next as usize == at + 1);
                if k < last && !node.bound.reaches(x, 0.0) {
                    k = last + skip();
                }
                at = if k < last { at + 1 } else { node.next as usize };
                while is_leaf && k < last {
                    let (id, pencil) = &self.pencils[k];
                    if pencil.reaches(x, 0.0) {
                        found(*id, pencil);
                    }
                    k += 1 + skip();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pencil::Cone;
    use crate::math::rng::{Purpose, Rng};
    use crate::math::warp;

    /// All that reach a point are found, as often as they are asked for, and no others.
    #[test]
    fn pencils_are_found_as_often_as_they_are_asked_for() {
        let mut rng = Rng::keyed(3, Purpose::Motion as u64, 0, 0);
        let direction = |rng: &mut Rng| warp::sphere(rng.uniform(), rng.uniform());
        let pencils: Vec<Pencil> = (0..300)
            .map(|_| {
                let (center, axis) = (direction(&mut rng) * rng.uniform(), direction(&mut rng));
                Pencil::new(center, 0.1 * rng.uniform(), Cone { axis, angle: 1.5 * rng.uniform().powi(2) })
            })
            .collect();
        let asked: Vec<f64> = (0..300).map(|k| [1.0, 0.25, 0.5, 0.125][k % 4]).collect();
        let reach = Reach::new(pencils.clone(), &asked);
        let (mut some, n) = (0, 4000);
        for _ in 0..8 {
            let x = direction(&mut rng) * 2.0;
            let mut times = vec![0; pencils.len()];
            for _ in 0..n {
                reach.draw(x, || rng.uniform(), |id, _| times[id as usize] += 1);
            }
            for ((p, &q), &times) in pencils.iter().zip(&asked).zip(&times) {
                let expected = if p.reaches(x, 0.0) { q * n as f64 } else { 0.0 };
                some += usize::from(expected > 0.0);
                assert!((times as f64 - expected).abs() <= 5.0 * (expected * (1.0 - q)).sqrt(), "{times} {expected}");
            }
        }
        assert!(some > 100);
        Reach::default().draw(DVec3::ZERO, || 0.5, |_, _| panic!("there is none"));
    }
}
