//! Rounds: independent runs of one estimator, of different size, and the variance of their mean.
//!
//! With x_r the vector that round r found from n_r samples a pixel, R rounds, N = sum n_r:
//! mean m = sum n_r x_r / N; variance of the mean = sum n_r^2 (x_r - m)^2 / N^2, times R / (R - 1) for rounds of one size.
//! So much it is whatever the variance of a round is as a function of its size (of 1/n samples, of what places cost that do not become more with them); it has the
//! freedom of N^2 / sum n_r^2 rounds of one size. It is what correlated runs need
//! (finite differences with common random numbers): the difference is formed within a round, the variance between rounds.

/// Mean and variance of vector-valued rounds.
#[derive(Clone, Debug, Default)]
pub struct Rounds {
    pub rounds: usize,
    /// Samples a pixel over all rounds.
    pub samples: f64,
    pub mean: Vec<f64>,
    /// sum n_r^2.
    squares: f64,
    /// sum n_r^2 (x_r - m) and sum n_r^2 (x_r - m)^2, m the mean so far.
    first: Vec<f64>,
    second: Vec<f64>,
}

impl Rounds {
    pub fn push(&mut self, x: &[f64], samples: f64) {
        if self.rounds == 0 {
            (self.mean, self.first, self.second) = (vec![0.0; x.len()], vec![0.0; x.len()], vec![0.0; x.len()]);
        }
        self.rounds += 1;
        self.samples += samples;
        let (share, weight) = (samples / self.samples, samples * samples);
        for (i, &x) in x.iter().enumerate() {
            let (m, s, t) = (&mut self.mean[i], &mut self.first[i], &mut self.second[i]);
            let step = (x - *m) * share;
            // About the new mean.
            *t += step * (step * self.squares - 2.0 * *s);
            *s -= step * self.squares;
            *m += step;
            let d = x - *m;
            *s += weight * d;
            *t += weight * d * d;
        }
        self.squares += weight;
    }

    /// Degrees of freedom of a variance.
    pub fn freedom(&self) -> f64 {
        (self.samples * self.samples / self.squares - 1.0).max(1.0)
    }

    /// Mean over places and channels of the mean's standard error.
    pub fn mean_error(&self) -> f64 {
        mean((0..self.mean.len()).map(|i| self.variance(i).sqrt()))
    }

    /// Variance of the mean of entry i; NaN below two rounds.
    pub fn variance(&self, i: usize) -> f64 {
        if self.rounds < 2 {
            return f64::NAN;
        }
        // N^2 - sum n_r^2 for N^2: R / (R - 1) for rounds of one size.
        self.second[i].max(0.0) / (self.samples * self.samples - self.squares)
    }

    pub fn mean_variance(&self) -> f64 {
        mean((0..self.mean.len()).map(|i| self.variance(i)))
    }

    pub fn mean_abs(&self) -> f64 {
        mean(self.mean.iter().map(|x| x.abs()))
    }

    pub fn is_zero(&self) -> bool {
        self.mean.iter().chain(&self.second).all(|&x| x == 0.0)
    }
}

/// The mean of numbers; NaN of none.
pub fn mean(x: impl Iterator<Item = f64>) -> f64 {
    let (n, sum) = x.fold((0.0, 0.0), |(n, s), x| (n + 1.0, s + x));
    sum / n
}

/// How a picture is cut into blocks: squares from the upper left corner, those at the other borders may be smaller.
#[derive(Clone, Copy, Debug)]
pub struct Blocks {
    width: usize,
    height: usize,
    side: usize,
}

impl Blocks {
    pub fn new(width: usize, height: usize, side: usize) -> Self {
        Blocks { width, height, side: side.max(1) }
    }

    /// Blocks in a row.
    pub fn columns(&self) -> usize {
        self.width.div_ceil(self.side)
    }

    pub fn count(&self) -> usize {
        self.columns() * self.height.div_ceil(self.side)
    }

    fn of_pixel(&self, pixel: usize) -> usize {
        pixel / self.width / self.side * self.columns() + pixel % self.width / self.side
    }

    /// Pixels of each block.
    pub fn sizes(&self) -> Vec<f64> {
        let mut sizes = vec![0.0; self.count()];
        (0..self.width * self.height).for_each(|p| sizes[self.of_pixel(p)] += 1.0);
        sizes
    }

    /// Means over blocks of an image of three channels a pixel.
    pub fn means(&self, image: &[f64]) -> Vec<f64> {
        let mut sums = vec![0.0; 3 * self.count()];
        for (p, rgb) in image.chunks_exact(3).enumerate() {
            let b = self.of_pixel(p);
            (0..3).for_each(|c| sums[3 * b + c] += rgb[c]);
        }
        let pixels = self.sizes();
        sums.iter().enumerate().map(|(i, s)| s / pixels[i / 3]).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounds_of_one_size_have_the_textbook_variance() {
        let mut r = Rounds::default();
        for x in [1.0, 2.0, 4.0] {
            r.push(&[x, 0.0], 5.0);
        }
        assert!((r.mean[0] - 7.0 / 3.0).abs() < 1e-15);
        // Sample variance 7/3, over three rounds.
        assert!((r.variance(0) - 7.0 / 9.0).abs() < 1e-14);
        assert_eq!((r.mean[1], r.variance(1)), (0.0, 0.0));
    }

    #[test]
    fn a_round_counts_by_its_samples() {
        let mut r = Rounds::default();
        r.push(&[0.0], 1.0);
        r.push(&[4.0], 3.0);
        assert_eq!(r.mean[0], 3.0);
        // (1 * 9 + 9 * 1) / (16 - 10).
        assert!((r.variance(0) - 3.0).abs() < 1e-14);
        assert_eq!(r.freedom(), 1.0);
    }

    /// Rounds whose variance does not fall with their size: the variance of the mean is told all the same.
    #[test]
    fn variances_need_no_model_of_rounds() {
        let mut rng = crate::math::rng::Rng::keyed(2, 7, 1, 8);
        let (n, sizes) = (2000, [1.0, 1.0, 2.0, 4.0, 8.0]);
        let (mut told, mut truth) = (0.0, 0.0);
        for _ in 0..n {
            let mut r = Rounds::default();
            for size in sizes.iter().flat_map(|s| [*s; 8]) {
                r.push(&[rng.uniform() - 0.5], size);
            }
            told += r.variance(0) / f64::from(n);
            truth += r.mean[0] * r.mean[0] / f64::from(n);
        }
        // Relative standard errors: 3 % of the truth, 1 % of what is told.
        assert!((told / truth - 1.0).abs() < 0.14, "{told} {truth}");
    }

    #[test]
    fn blocks_at_the_border_are_smaller() {
        let b = Blocks::new(3, 2, 2);
        assert_eq!((b.count(), b.columns()), (2, 2));
        let image: Vec<f64> = (0..6).flat_map(|p| [p as f64, 1.0, 0.0]).collect();
        assert_eq!(b.means(&image), [2.0, 1.0, 0.0, 3.5, 1.0, 0.0]);
    }
}
