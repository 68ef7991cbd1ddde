//! Which views an iteration of a fit looks at.

use crate::math::rng::Rng;

/// `size` of `n` views for an iteration, keyed by the seed. Views are dealt from shuffled decks of all of them, so that each comes equally often: the mean
/// loss of a subset is an unbiased estimate of that of all. A subset that begins a new deck may hold a view twice.
pub fn views(n: usize, size: usize, seed: u64, iteration: usize) -> Vec<usize> {
    if size >= n {
        return (0..n).collect();
    }
    let from = iteration * size;
    (from..from + size).map(|k| deck(n, seed, (k / n) as u64)[k % n]).collect()
}

fn deck(n: usize, seed: u64, number: u64) -> Vec<usize> {
    let mut rng = Rng::keyed(seed, 0, 0, number);
    let mut v: Vec<usize> = (0..n).collect();
    for i in (1..n).rev() {
        v.swap(i, ((rng.uniform() * (i + 1) as f64) as usize).min(i));
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_view_comes_equally_often_and_not_in_one_order() {
        let mut count = [0; 8];
        (0..16).flat_map(|i| views(8, 3, 5, i)).for_each(|v| count[v] += 1);
        assert_eq!(count, [6; 8]);
        assert_ne!(deck(8, 5, 0), deck(8, 5, 1));
        assert_ne!(deck(8, 5, 0), deck(8, 6, 0));
        assert_eq!(views(3, 5, 1, 9), [0, 1, 2]);
    }
}
