//! Densities over the unit cube, constant in boxes, learned from samples: a histogram whose cells are as fine as the samples allow.
//!
//! An estimator that begins with a few uniform numbers u has the mean `∫ F(u) du`. Drawn with a density g instead and divided by it, it has the same mean, and the
//! least second moment where `g ~ √(E[F² | u])`. Boxes are halved along one number at a time; each takes what its samples say, and a share of all is
//! uniform, so that nothing that samples missed is ever rare.

/// Numbers that are guided.
pub const DIMENSIONS: usize = 5;

/// A point of the unit cube.
pub type Numbers = [f64; DIMENSIONS];

/// Share of the uniform density.
const UNIFORM: f64 = 0.25;
/// Samples of equal size that a box must be worth, `(Σs)²/Σs²`, to be halved: squares are rare, and have heavy tails.
const SAMPLES: f64 = 32.0;
/// Halvings from the cube to a box, at most.
const DEPTH: u32 = 24;

/// What a sample told: where, the square of its estimate `F/g`, and the density g with which it was drawn.
#[derive(Clone, Copy, Debug)]
pub struct Told {
    pub at: Numbers,
    pub square: f64,
    pub density: f64,
}

/// A piecewise-constant density over the unit cube.
#[derive(Clone, Debug)]
pub struct Guide {
    nodes: Vec<Node>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Node {
    /// Probability of the lower half; meaningless for a box.
    lower: f64,
    /// The lower half; the upper one comes next. 0 for a box.
    halves: u32,
    axis: u8,
}

/// A box while it is learned.
#[derive(Clone, Copy)]
struct Cell {
    low: Numbers,
    size: Numbers,
}

impl Cell {
    const CUBE: Cell = Cell { low: [0.0; DIMENSIONS], size: [1.0; DIMENSIONS] };

    fn middle(&self, axis: usize) -> f64 {
        self.low[axis] + 0.5 * self.size[axis]
    }

    fn half(mut self, axis: usize, upper: bool) -> Cell {
        self.size[axis] *= 0.5;
        self.low[axis] += if upper { self.size[axis] } else { 0.0 };
        self
    }

    fn volume(&self) -> f64 {
        self.size.iter().product()
    }
}

impl Guide {
    /// The density that these samples suggest, in the first `axes` numbers.
    pub fn learn(axes: usize, mut told: Vec<Told>) -> Guide {
        let mut guide = Guide { nodes: vec![Node::default()] };
        let mut weights = vec![0.0];
        guide.split(axes, 0, &mut told, Cell::CUBE, 0, &mut weights);
        // Weights of boxes become probabilities; halves come after what they are halves of.
        let total = weights[0];
        let mut mass = vec![0.0; guide.nodes.len()];
        guide.spread(0, 1.0, total, &weights, &mut mass);
        for k in 0..guide.nodes.len() {
            let i = guide.nodes[k].halves as usize;
            if i > 0 {
                guide.nodes[k].lower = mass[i] / (mass[i] + mass[i + 1]);
            }
        }
        guide
    }

    /// Halve the box of a node as long as there are samples enough; `weights` become the integrals of the density without a scale.
    fn split(&mut self, axes: usize, node: usize, told: &mut [Told], cell: Cell, depth: u32, weights: &mut Vec<f64>) {
        if worth(told) < SAMPLES || depth >= DEPTH {
            weights[node] = weight(told.iter(), cell.volume());
            return;
        }
        // Along the number whose halves differ most: least is what is left of √(mean square) over both.
        let halves = |axis: usize| {
            let (m, half) = (cell.middle(axis), 0.5 * cell.volume());
            let side = |upper: bool| weight(told.iter().filter(|t| (t.at[axis] >= m) == upper), half);
            side(false) + side(true)
        };
        let (axis, _) = (0..axes).map(|k| (k, halves(k))).min_by(|a, b| a.1.total_cmp(&b.1)).unwrap_or((0, 0.0));
        let middle = cell.middle(axis);
        told.sort_unstable_by(|a, b| (a.at[axis] >= middle).cmp(&(b.at[axis] >= middle)));
        let cut = told.partition_point(|t| t.at[axis] < middle);
        let first = self.nodes.len();
        self.nodes[node] = Node { axis: axis as u8, halves: first as u32, lower: 0.5 };
        self.nodes.extend([Node::default(); 2]);
        weights.extend([0.0; 2]);
        let (lower, upper) = told.split_at_mut(cut);
        self.split(axes, first, lower, cell.half(axis, false), depth + 1, weights);
        self.split(axes, first + 1, upper, cell.half(axis, true), depth + 1, weights);
        weights[node] = weights[first] + weights[first + 1];
    }

    /// The mass of every node: its share of the weights, and of the volume.
    fn spread(&self, node: usize, volume: f64, total: f64, weights: &[f64], mass: &mut [f64]) {
        let learned = if total > 0.0 && total.is_finite() { weights[node] / total } else { volume };
        mass[node] = (1.0 - UNIFORM) * learned + UNIFORM * volume;
        let i = self.nodes[node].halves as usize;
        if i > 0 {
            self.spread(i, 0.5 * volume, total, weights, mass);
            self.spread(i + 1, 0.5 * volume, total, weights, mass);
        }
    }

    /// A point drawn from uniform numbers, one by one increasing in each of them, and the density there.
    pub fn warp(&self, mut u: Numbers) -> (Numbers, f64) {
        let (mut cell, mut density, mut k) = (Cell::CUBE, 1.0, 0);
        loop {
            let Node { lower, halves, axis } = self.nodes[k];
            if halves == 0 {
                let at = std::array::from_fn(|a| (cell.low[a] + u[a] * cell.size[a]).min(1.0 - f64::EPSILON / 2.0));
                return (at, density);
            }
            let a = axis as usize;
            let upper = u[a] >= lower;
            let share = if upper { 1.0 - lower } else { lower };
            u[a] = ((u[a] - if upper { lower } else { 0.0 }) / share).clamp(0.0, 1.0 - f64::EPSILON / 2.0);
            density *= 2.0 * share;
            cell = cell.half(a, upper);
            k = halves as usize + usize::from(upper);
        }
    }
}

/// How many samples of equal size say as much: the effective sample size of the squares.
fn worth(told: &[Told]) -> f64 {
    let (sum, squares) = told.iter().fold((0.0, 0.0), |(s, q), t| {
        let x = t.square * t.density;
        (s + x, q + x * x)
    });
    if squares > 0.0 && squares.is_finite() { sum * sum / squares } else { 0.0 }
}

/// `∫√(E[F²|u]) du` over a box, without a scale, as if E did not vary inside it.
fn weight<'a>(told: impl Iterator<Item = &'a Told>, volume: f64) -> f64 {
    (told.map(|t| t.square * t.density).sum::<f64>() * volume).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    fn uniform(rng: &mut Rng) -> Numbers {
        std::array::from_fn(|_| rng.uniform())
    }

    /// A ridge across two of the numbers, and noise.
    fn ridge(u: &Numbers, rng: &mut Rng) -> f64 {
        (-200.0 * (u[0] - 0.3 - 0.4 * u[2]).powi(2)).exp() * (0.5 + rng.uniform())
    }

    #[test]
    fn guided_means_stay_and_vary_less() {
        let mut rng = Rng::keyed(5, 0, 0, 0);
        let mut told: Vec<Told> = Vec::new();
        for _ in 0..20_000 {
            let at = uniform(&mut rng);
            told.push(Told { at, square: ridge(&at, &mut rng).powi(2), density: 1.0 });
        }
        let guide = Guide::learn(3, told);
        let n = 200_000;
        let (mut plain, mut guided) = ([0.0; 2], [0.0; 3]);
        for _ in 0..n {
            let u = uniform(&mut rng);
            let f = ridge(&u, &mut rng);
            plain = [plain[0] + f, plain[1] + f * f];
            let (u, g) = guide.warp(u);
            let f = ridge(&u, &mut rng) / g;
            guided = [guided[0] + f, guided[1] + f * f, guided[2] + 1.0 / g];
        }
        let n = n as f64;
        let (a, b) = (plain[0] / n, guided[0] / n);
        let variance = |s: f64, mean: f64| s / n - mean * mean;
        let (va, vb) = (variance(plain[1], a), variance(guided[1], b));
        // Means agree (5 s.e.; false alarm 6e-7); the density integrates to one (its reciprocal has that mean).
        assert!((a - b).abs() < 5.0 * ((va + vb) / n).sqrt(), "{a} {b}");
        assert!((guided[2] / n - 1.0).abs() < 0.02, "{}", guided[2] / n);
        assert!(vb < 0.25 * va, "{vb} {va}");
    }

    #[test]
    fn nothing_told_is_uniform() {
        let mut rng = Rng::keyed(6, 0, 0, 0);
        for told in [vec![], vec![Told { at: [0.5; DIMENSIONS], square: 0.0, density: 1.0 }; 100]] {
            let guide = Guide::learn(DIMENSIONS, told);
            for _ in 0..100 {
                let u = uniform(&mut rng);
                let (v, g) = guide.warp(u);
                assert!((g - 1.0).abs() < 1e-12);
                assert!(u.iter().zip(v).all(|(a, b)| (a - b).abs() < 1e-9), "{u:?} {v:?}");
            }
        }
    }
}
