//! A tree of balls, for questions that a ball around others answers for them.

use super::DVec3;

/// Balls of a leaf at most.
const LEAF: usize = 4;

#[derive(Clone, Copy, Debug)]
pub struct Ball {
    pub center: DVec3,
    pub radius: f64,
}

impl Ball {
    /// One that holds some, about the middle of their centres' extent.
    pub fn around(some: impl Iterator<Item = Ball> + Clone) -> Ball {
        let (low, high) = extent(some.clone().map(|b| b.center));
        let center = 0.5 * (low + high);
        let radius = some.map(|b| (b.center - center).length() + b.radius).fold(0.0, f64::max);
        Ball { center, radius }
    }
}

/// The least and the largest coordinates of points.
pub fn extent(points: impl Iterator<Item = DVec3>) -> (DVec3, DVec3) {
    points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), p| (low.min(p), high.max(p)))
}

#[derive(Clone, Debug)]
struct Node {
    bound: Ball,
    /// Of a leaf its part of the order; else its children are the next node and the one at `end`.
    first: u32,
    end: u32,
    is_leaf: bool,
}

#[derive(Clone, Debug, Default)]
pub struct BallTree {
    balls: Vec<Ball>,
    order: Vec<u32>,
    nodes: Vec<Node>,
}

impl BallTree {
    pub fn new(balls: Vec<Ball>) -> Self {
        let mut tree = BallTree { order: (0..balls.len() as u32).collect(), balls, nodes: Vec::new() };
        if !tree.balls.is_empty() {
            tree.grow(0, tree.balls.len());
        }
        tree
    }

    fn grow(&mut self, first: usize, end: usize) {
        let at = self.nodes.len();
        let (balls, of) = (&self.balls, &mut self.order[first..end]);
        let each = || of.iter().map(|&i| balls[i as usize]);
        let (lo, hi) = extent(each().map(|b| b.center));
        let is_leaf = of.len() <= LEAF;
        self.nodes.push(Node { bound: Ball::around(each()), first: first as u32, end: end as u32, is_leaf });
        if is_leaf {
            return;
        }
        let (axis, half) = ((hi - lo).max_position(), of.len() / 2);
        let place = |i: u32| balls[i as usize].center[axis];
        of.select_nth_unstable_by(half, |&a, &b| place(a).total_cmp(&place(b)).then(a.cmp(&b)));
        self.grow(first, first + half);
        self.nodes[at].end = self.nodes.len() as u32;
        self.grow(first + half, end);
    }

    /// Numbers of all balls that `meets` accepts, which has to accept every ball that holds one that it accepts.
    pub fn find(&self, meets: impl Fn(&Ball) -> bool, found: &mut impl FnMut(u32)) {
        if !self.nodes.is_empty() {
            self.below(0, &meets, found);
        }
    }

    fn below(&self, at: usize, meets: &impl Fn(&Ball) -> bool, found: &mut impl FnMut(u32)) {
        let node = &self.nodes[at];
        if !meets(&node.bound) {
            return;
        }
        if node.is_leaf {
            let leaf = &self.order[node.first as usize..node.end as usize];
            leaf.iter().filter(|&&i| meets(&self.balls[i as usize])).for_each(|&i| found(i));
        } else {
            self.below(at + 1, meets, found);
            self.below(node.end as usize, meets, found);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    #[test]
    fn the_tree_finds_all() {
        let mut rng = Rng::keyed(6, Purpose::Motion as u64, 0, 0);
        let point = |rng: &mut Rng| DVec3::new(rng.uniform(), rng.uniform(), rng.uniform());
        let balls: Vec<Ball> =
            (0..3000).map(|_| Ball { center: point(&mut rng), radius: 0.05 * rng.uniform() }).collect();
        let tree = BallTree::new(balls.clone());
        for _ in 0..100 {
            let x = point(&mut rng);
            let meets = |b: &Ball| (b.center - x).length() <= b.radius + 0.1;
            let expected: Vec<u32> = (0..3000).filter(|&i| meets(&balls[i as usize])).collect();
            let mut found = Vec::new();
            tree.find(meets, &mut |i| found.push(i));
            found.sort();
            assert_eq!(found, expected);
        }
    }
}
