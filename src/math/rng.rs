//! Keyed random streams: (seed, purpose, pixel, sample) -> numbers. Threads do not enter.
//!
//! A stream is a xoshiro256++ generator (Blackman, Vigna) whose state is four rounds of splitmix64 over the key. It is
//! `Copy`: a checkpoint of a path is its state. The first numbers of a path may come from a scrambled Sobol' sequence instead ([`Rng::even`]).

/// What a stream is for. Streams of different purpose never share numbers, so switching one feature on
/// never changes another's samples (`render` and `grad` give the same bits for the picture).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u64)]
pub enum Purpose {
    /// The primal path.
    Path = 1,
    /// Choice and continuation of the derivative vertex [T] (65).
    Derivative = 2,
    /// Pilot runs: budgets, film quantum.
    Pilot = 4,
    /// Connections to lights that move.
    Motion = 6,
    /// Searches for ways of light by smooth surfaces.
    Manifold = 7,
    /// Random numbers of random number, [`Rng::apart`].
    Apart = 8,
    /// Of the noise of an adjoint image.
    Sign = 9,
    /// Boundary rooms; each adds its index.
    Room = 64,
}

#[derive(Clone, Copy, Debug)]
pub struct Rng {
    s: [u64; 4],
    even: Even,
}

/// Coordinates `next..end` of one point of a Sobol' sequence with Owen's scrambling. A point by itself is uniform in the unit cube, so estimates are
/// unbiased whatever a sample does with its numbers; the points of one scrambling lie evenly, so that their mean has less variance
/// where the integrand is smooth in few coordinates, and hardly more anywhere.
#[derive(Clone, Copy, Debug)]
struct Even {
    point: u32,
    scrambling: u32,
    next: u32,
    end: u32,
    /// Those from the last multiple of four on.
    four: [f32; 4],
}

/// Coordinates of a stream, a multiple of four; as many belong to the stream beside it ([`Rng::beside`]).
const COORDINATES: u32 = 32;
/// Coordinates of a branch ([`Rng::branch`]), a multiple of four, and branches that have any: tables hold 256 in all.
const BRANCH: u32 = 16;
const BRANCHES: u32 = 12;
/// Points of one scrambling: what the tables hold.
const POINTS: u64 = 1 << 16;

impl Even {
    const NONE: Even = Even { point: 0, scrambling: 0, next: 0, end: 0, four: [0.0; 4] };

    /// The next coordinate in units of 2^-23.
    #[inline]
    fn next(&mut self) -> Option<u64> {
        if self.next >= self.end {
            return None;
        }
        let k = self.next % 4;
        if k == 0 {
            self.four = sobol_burley::sample_4d(self.point, self.next / 4, self.scrambling);
        }
        self.next += 1;
        Some((f64::from(self.four[k as usize]) * 8_388_608.0) as u64)
    }
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
        Rng { s: std::array::from_fn(|_| splitmix(&mut x)), even: Even::NONE }
    }

    /// The stream of one key whose first numbers are even over the samples: each sample's numbers are as random as those of
    /// [`Rng::keyed`], but samples of one seed, purpose and pixel are not independent. Error bars from batches of them are too long, never
    /// systematically too short; independent runs have other seeds.
    pub fn even(seed: u64, purpose: u64, pixel: u64, sample: u64) -> Self {
        let scrambling = Rng::keyed(seed, purpose, pixel, !(sample / POINTS)).next_u64() as u32;
        let even = Even { point: (sample % POINTS) as u32, scrambling, end: COORDINATES, ..Even::NONE };
        Rng { even, ..Rng::keyed(seed, purpose, pixel, sample) }
    }

    /// [`Rng::even`] or [`Rng::keyed`].
    pub fn of(even: bool, seed: u64, purpose: u64, pixel: u64, sample: u64) -> Self {
        if even { Rng::even(seed, purpose, pixel, sample) } else { Rng::keyed(seed, purpose, pixel, sample) }
    }

    /// A stream of other numbers for the same sample, even together with this one's; `key` may be anything random.
    pub fn beside(&self, key: u64) -> Self {
        let even = Even { next: COORDINATES, end: 2 * COORDINATES, ..self.even };
        Rng { even: if self.even.end > 0 { even } else { Even::NONE }, ..Rng::keyed(key, Purpose::Motion as u64, 0, 0) }
    }

    /// The stream of branch `k` of a path, which no other has, its first numbers even by themselves; this one goes on with the same coordinates. The first twelve have even numbers.
    pub fn branch(&mut self, k: u32) -> Self {
        let first = 2 * COORDINATES + BRANCH * k;
        let even = Even { next: first, end: first + BRANCH, ..self.even };
        let is_even = self.even.end > 0 && k < BRANCHES;
        Rng { even: if is_even { even } else { Even::NONE }, ..Rng::keyed(self.next_u64(), Purpose::Path as u64, 0, 0) }
    }

    /// A stream apart, by where this one is; it goes on as if nothing had been asked of it.
    pub fn apart(&self) -> Apart {
        Apart { key: [self.s[0], self.s[1], self.s[3]], own: None }
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
        let fine = self.next_u64();
        let bits = self.even.next().map_or(fine, |coarse| coarse << 41 | fine >> 23);
        (bits >> 11) as f64 * (1.0 / 9_007_199_254_740_992.0)
    }

    /// Unit-rate exponential: finite, and > 0 (a zero-length flight would put 1/r^2 on the vertex itself).
    #[inline]
    pub fn exponential(&mut self) -> f64 {
        exponential_from(self.uniform())
    }
}

/// A stream of random numbers of random number, begun when the first is asked for ([`Rng::apart`]).
#[derive(Clone, Debug)]
pub struct Apart {
    key: [u64; 3],
    own: Option<Rng>,
}

impl Apart {
    #[inline]
    pub fn rng(&mut self) -> &mut Rng {
        let [a, b, c] = self.key;
        self.own.get_or_insert_with(|| Rng::keyed(a, Purpose::Apart as u64, b, c))
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
    fn even_streams_are_uniform_and_stratified() {
        // One point: uniform over scramblings, in every coordinate and their products (mean within 5 s.e.; false alarm 6e-7 each).
        let n = 40_000;
        let (mut sum, mut products) = (0.0, 0.0);
        for seed in 0..n {
            let mut r = Rng::even(seed, 1, 3, 5);
            let mut aside = r.beside(seed);
            let (a, b, c) = (r.uniform() - 0.5, r.uniform() - 0.5, aside.uniform() - 0.5);
            sum += a + b + c;
            products += a * b + b * c + a * c;
        }
        let n = n as f64;
        assert!((sum / n).abs() < 5.0 * (3.0 / 12.0 / n).sqrt(), "{sum}");
        assert!((products / n).abs() < 5.0 * (3.0 / 144.0 / n).sqrt(), "{products}");
        let skip = |r: &mut Rng, n: u32| {
            for _ in 0..n {
                r.uniform();
            }
        };
        // Any 64 neighbours that start at a multiple of 64: one in each 64th, in every coordinate, beyond the tables' end too.
        for first in [0, 192, POINTS - 64, POINTS] {
            for k in [0, 7, COORDINATES - 1, COORDINATES, COORDINATES + 1] {
                let stratum = |i| {
                    let mut r = Rng::even(9, 1, 2, first + i);
                    match k {
                        COORDINATES => r = r.beside(1),
                        k if k > COORDINATES => r = r.branch(BRANCHES - 1),
                        k => skip(&mut r, k),
                    }
                    (r.uniform() * 64.0) as u64
                };
                let mut strata: Vec<u64> = (0..64).map(stratum).collect();
                strata.sort_unstable();
                assert!(strata.iter().copied().eq(0..64), "coordinate {k} from {first}");
            }
        }
        // Past its coordinates a stream is random.
        let late = |i| {
            let mut r = Rng::even(9, 1, 2, i);
            skip(&mut r, COORDINATES);
            r.uniform()
        };
        assert!((0..64).map(late).map(|u| (u * 64.0) as u64).collect::<std::collections::HashSet<_>>().len() < 60);
    }

    #[test]
    fn exponential_endpoints() {
        assert!(exponential_from(0.0) > 0.0);
        let last = 1.0 - f64::EPSILON / 2.0;
        assert!((exponential_from(last) - 36.736_800_569_677_1).abs() < 1e-9);
    }
}
