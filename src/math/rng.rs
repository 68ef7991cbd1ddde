//! Keyed random streams: (seed, purpose, pixel, sample) -> numbers. Threads do not enter.
//!
//! A stream is a xoshiro256++ generator (Blackman, Vigna) whose state is four rounds of splitmix64 over the key. It is
//! `Copy`: a checkpoint of a path is its state.

/// What a stream is for. Streams of different purpose never share numbers, so switching one feature on
/// never changes another's samples (`render` and `grad` give the same bits for the picture).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// The primal path.
    Path = 1,
    /// Choice and continuation of the derivative vertex [T] (65).
    Derivative = 2,
    /// Independent Poisson points for line integrals [T] (52b).
    Poisson = 3,
    /// Pilot runs: budgets, film quantum.
    Pilot = 4,
    /// The adjoint image of a loss.
    Adjoint = 5,
    /// Connections to lights that move.
    Motion = 6,
    /// Boundary rooms; each adds its index.
    Room = 64,
}

#[derive(Clone, Copy, Debug)]
pub struct Rng {
    s: [u64; 4],
}

fn splitmix(x: &mut u64) -> u64 {
    *x = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *x;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

impl Rng {
    /// The stream of one key. Every part of the key goes through its own mixing round.
    pub fn keyed(seed: u64, purpose: u64, pixel: u64, sample: u64) -> Self {
        let mut k = seed;
        let mut h = splitmix(&mut k);
        for part in [purpose, pixel, sample] {
            let mut p = h ^ part.wrapping_mul(0xd6e8_feb8_6659_fd93);
            h = splitmix(&mut p) ^ h.rotate_left(23);
        }
        let mut x = h;
        Rng { s: std::array::from_fn(|_| splitmix(&mut x)) }
    }

    #[inline]
    pub fn next_u64(&mut self) -> u64 {
        let s = &mut self.s;
        let out = s[0].wrapping_add(s[3]).rotate_left(23).wrapping_add(s[0]);
        let t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = s[3].rotate_left(45);
        out
    }

    /// Uniform in [0, 1), 53 bits: strictly below 1.
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Unit-rate exponential: finite, and > 0 (a zero-length flight would put 1/r^2 on the vertex itself).
    #[inline]
    pub fn exponential(&mut self) -> f64 {
        exponential_from(self.uniform())
    }
}

/// `-ln(1-u)` for u in [0,1) of 53 bits, for which 1-u is exact: no digit is lost without the slower `ln_1p`. u = 0 gives half the
/// smallest step that another u can, not zero.
#[inline]
pub fn exponential_from(u: f64) -> f64 {
    let left = 1.0 - u;
    if left < 1.0 { -left.ln() } else { 5.551_115_123_125_783e-17 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_keyed_and_uniform() {
        let mut a = Rng::keyed(1, 2, 3, 4);
        let mut b = Rng::keyed(1, 2, 3, 4);
        assert_eq!(a.next_u64(), b.next_u64());
        for (s, p, x, n) in [(2, 2, 3, 4), (1, 3, 3, 4), (1, 2, 4, 4), (1, 2, 3, 5), (1, 2, 4, 3)] {
            assert_ne!(Rng::keyed(1, 2, 3, 4).next_u64(), Rng::keyed(s, p, x, n).next_u64());
        }
        // First numbers of consecutive streams are uniform (mean within 5 s.e.; false alarm 6e-7).
        let n = 100_000;
        let mean: f64 = (0..n).map(|i| Rng::keyed(7, 1, i, 0).uniform()).sum::<f64>() / n as f64;
        assert!((mean - 0.5).abs() < 5.0 / (12.0 * n as f64).sqrt());
    }

    #[test]
    fn exponential_endpoints() {
        assert!(exponential_from(0.0) > 0.0);
        let last = 1.0 - f64::EPSILON / 2.0;
        assert!((exponential_from(last) - 36.736_800_569_677_1).abs() < 1e-9);
    }
}
