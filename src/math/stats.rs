//! Batch statistics: means, standard errors, z scores.

/// Count, mean and variance of a set of numbers (Welford).
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    pub n: f64,
    pub mean: f64,
    m2: f64,
}

impl Moments {
    pub fn push(&mut self, x: f64) {
        self.n += 1.0;
        let d = x - self.mean;
        self.mean += d / self.n;
        self.m2 += d * (x - self.mean);
    }

    /// Variance of one number.
    pub fn variance(&self) -> f64 {
        if self.n < 2.0 { f64::NAN } else { self.m2 / (self.n - 1.0) }
    }

    /// Standard error of the mean.
    pub fn standard_error(&self) -> f64 {
        (self.variance() / self.n).sqrt()
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(it: I) -> Self {
        let mut m = Moments::default();
        it.into_iter().for_each(|x| m.push(x));
        m
    }
}

/// The median; NaN for an empty set.
pub fn median(mut x: Vec<f64>) -> f64 {
    if x.is_empty() {
        return f64::NAN;
    }
    x.sort_by(f64::total_cmp);
    let n = x.len();
    if n % 2 == 1 { x[n / 2] } else { 0.5 * (x[n / 2 - 1] + x[n / 2]) }
}
