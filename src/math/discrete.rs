//! Discrete and piecewise-constant distributions by inversion of a cumulative table.

/// A distribution over `0..n` with probabilities proportional to given weights.
#[derive(Clone, Debug, Default)]
pub struct Discrete {
    /// `cdf[i]` = sum of weights before `i`, normalised; length n + 1.
    cdf: Vec<f64>,
    /// Where to begin the search: the first entry of `cdf` above k/n, for k in 0..n.
    guide: Vec<u32>,
    pub total: f64,
}

impl Discrete {
    /// `weights` finite and >= 0. With total 0 every draw is uniform.
    pub fn new(weights: impl IntoIterator<Item = f64>) -> Self {
        let mut cdf = vec![0.0];
        let mut sum = 0.0;
        for w in weights {
            sum += w;
            cdf.push(sum);
        }
        let n = cdf.len() - 1;
        for (i, c) in cdf.iter_mut().enumerate() {
            *c = if sum > 0.0 { *c / sum } else { i as f64 / n.max(1) as f64 };
        }
        let guide = (0..n).map(|k| cdf.partition_point(|&c| c <= k as f64 / n as f64) as u32).collect();
        Discrete { cdf, guide, total: sum }
    }

    pub fn len(&self) -> usize {
        self.cdf.len() - 1
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub fn probability(&self, i: usize) -> f64 {
        self.cdf[i + 1] - self.cdf[i]
    }

    /// Index, its probability, and `u` rescaled to [0,1) inside it. An entry of weight 0 is never drawn.
    pub fn sample(&self, u: f64) -> (usize, f64, f64) {
        let n = self.len();
        let mut i = self.guide[((u * n as f64) as usize).min(n - 1)] as usize;
        // The guide is never ahead but by rounding.
        while i > 0 && self.cdf[i - 1] > u {
            i -= 1;
        }
        while i <= n && self.cdf[i] <= u {
            i += 1;
        }
        let i = i.clamp(1, n) - 1;
        let p = self.probability(i);
        let v = if p > 0.0 { ((u - self.cdf[i]) / p).clamp(0.0, 1.0 - f64::EPSILON / 2.0) } else { 0.0 };
        (i, p, v)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn draws_follow_weights_and_zero_is_never_drawn() {
        let d = Discrete::new([0.0, 1.0, 0.0, 3.0, 0.0]);
        assert_eq!(d.sample(0.0).0, 1);
        assert_eq!(d.sample(0.25).0, 3);
        assert_eq!(d.sample(1.0 - f64::EPSILON / 2.0).0, 3);
        assert_eq!(d.probability(3), 0.75);
        let (_, _, v) = d.sample(0.125);
        assert_eq!(v, 0.5);
    }

    #[test]
    fn the_guide_finds_what_bisection_finds() {
        let mut rng = crate::math::rng::Rng::keyed(3, 1, 4, 1);
        for n in [1, 2, 3, 7, 64, 1000] {
            let d = Discrete::new((0..n).map(|i| if i % 3 == 1 { 0.0 } else { rng.uniform().powi(8) + 1e-12 }));
            let ends = d.cdf.clone().into_iter().flat_map(|c| [c, c * (1.0 + f64::EPSILON), c * (1.0 - f64::EPSILON)]);
            let grid = (0..n).map(|k| k as f64 / n as f64);
            let all: Vec<f64> = ends.chain(grid).chain((0..1000).map(|_| rng.uniform())).collect();
            for u in all.into_iter().filter(|u| (0.0..1.0).contains(u)) {
                assert_eq!(d.sample(u).0, d.cdf.partition_point(|&c| c <= u).clamp(1, n) - 1, "{n} {u}");
            }
        }
    }
}
