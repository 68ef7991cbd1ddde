//! Means of an optimiser's parameters over halves of its stop rule's window: what tells whether a field of many parameters stands still, and what is reported.
//!
//! A single voxel of thousands never stays within a tolerance: stochastic gradients keep it in motion. So a field is judged as a whole: it has settled when the root mean
//! square over its parameters of the difference between two means, over one half of the window and the next, is at most the tolerance (a share of the bounds'
//! extent, as for single parameters). Memory: two numbers a parameter.

use std::ops::Range;

#[derive(Clone, Debug, PartialEq)]
pub struct Halves {
    /// Iterations of a half.
    pub size: usize,
    /// How many the sums hold: of the half before, of the half at hand.
    pub counts: [usize; 2],
    pub sums: [Vec<f64>; 2],
}

impl Halves {
    pub fn new(window: usize, parameters: usize) -> Self {
        Halves { size: (window / 2).max(1), counts: [0; 2], sums: [vec![0.0; parameters], vec![0.0; parameters]] }
    }

    /// Add one iteration. `true`: a half is complete, and the one before it too.
    pub fn push(&mut self, u: &[f64]) -> bool {
        if self.counts[1] == self.size {
            self.sums.swap(0, 1);
            self.sums[1].fill(0.0);
            self.counts = [self.size, 0];
        }
        self.sums[1].iter_mut().zip(u).for_each(|(s, x)| *s += x);
        self.counts[1] += 1;
        self.counts == [self.size; 2]
    }

    /// Root mean square of what some parameters moved by, from half to half; 0 of none.
    pub fn moved(&self, range: Range<usize>) -> f64 {
        let n = range.len().max(1) as f64;
        let mean = |half: usize, k: usize| self.sums[half][k] / self.counts[half] as f64;
        (range.map(|k| (mean(1, k) - mean(0, k)).powi(2)).sum::<f64>() / n).sqrt()
    }

    /// Means over all iterations held: half a window to a whole one.
    pub fn mean(&self) -> Vec<f64> {
        let n = (self.counts[0] + self.counts[1]).max(1) as f64;
        self.sums[0].iter().zip(&self.sums[1]).map(|(a, b)| (a + b) / n).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motion_is_told_from_noise() {
        let mut h = Halves::new(20, 3);
        let full: Vec<usize> = (0..40)
            .filter(|&i| {
                let t = i as f64;
                h.push(&[0.01 * t, 0.5 + if i % 2 == 0 { 0.1 } else { -0.1 }, 0.25])
            })
            .collect();
        assert_eq!(full, [19, 29, 39]);
        assert!((h.moved(0..1) - 0.1).abs() < 1e-12 && h.moved(1..3) < 1e-12);
        assert!((h.moved(0..3) - 0.1 / 3f64.sqrt()).abs() < 1e-12);
        assert!((h.mean()[0] - 0.295).abs() < 1e-12 && (h.mean()[1] - 0.5).abs() < 1e-12);
    }
}
