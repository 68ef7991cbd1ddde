use super::*;
use crate::math::stats::Moments;

fn spec(width: usize, layers: usize, quantum: i32) -> FilmSpec {
    let names = (0..layers).map(|i| if i == 0 { "picture".into() } else { format!("d_p{i}") }).collect();
    FilmSpec { width, height: 1, layers: names, quantum: vec![quantum; layers] }
}

/// A repeatable stream of numbers with heavy tails and both signs.
fn number(i: u64) -> f64 {
    let mut x = i.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    let u = (((x ^ (x >> 31)) >> 11) as f64 + 0.5) / (1u64 << 53) as f64;
    (u - 0.5) / (u * (1.0 - u)).powf(0.8)
}

fn value(batch: u64, i: u64) -> Rgb {
    Rgb::from_fn(|c| number(batch * 1_000_003 + i * 3 + c as u64))
}

fn bits(f: &Film) -> Vec<u64> {
    let mut out = Vec::new();
    for layer in 0..f.spec().layers.len() {
        for p in 0..f.spec().pixels() {
            let v = f.variance_of_mean(layer, p).unwrap_or(Rgb::splat(-1.0));
            out.extend(f.mean(layer, p).0.iter().chain(&v.0).map(|x| x.to_bits()));
        }
    }
    out
}

const BATCHES: [(u64, u64); 5] = [(0, 40), (1, 41), (2, 40), (3, 7), (4, 41)];

fn fill(f: &mut Film, order: impl Fn(u64) -> Vec<u64>, batches: &[(u64, u64)]) {
    for &(b, n) in batches {
        for i in order(n) {
            // Every sample also splats elsewhere, as boundary terms do.
            f.add((i % 7) as usize, 0, value(b, i));
            f.add((number(i).abs() * 10.0) as usize % 7, 1, value(b, i + 500));
        }
        f.end_batch(b, n).unwrap();
    }
}

#[test]
fn order_threads_and_splits_change_no_bit() {
    let mut reference = Film::new(spec(7, 2, -46));
    fill(&mut reference, |n| (0..n).collect(), &BATCHES);
    let expected = bits(&reference);

    // Backwards, batches in another order.
    let mut f = Film::new(spec(7, 2, -46));
    let mut reversed = BATCHES;
    reversed.reverse();
    fill(&mut f, |n| (0..n).rev().collect(), &reversed);
    assert_eq!(bits(&f), expected);

    // Any split into shards, merged in any order.
    for mask in 1..31u32 {
        let (mut a, mut b) = (Film::new(spec(7, 2, -46)), Film::new(spec(7, 2, -46)));
        let (left, right): (Vec<_>, Vec<_>) = BATCHES.iter().partition(|(i, _)| mask >> i & 1 == 1);
        fill(&mut a, |n| (0..n).collect(), &left);
        fill(&mut b, |n| (0..n).map(|i| (i + 5) % n).collect(), &right);
        if mask % 2 == 0 {
            std::mem::swap(&mut a, &mut b);
        }
        a.merge(&b).unwrap();
        assert_eq!(bits(&a), expected, "split {mask:05b}");
        assert_eq!(a.samples(), 169);
    }

    // Many threads at once on few cells; parts of one batch on two films.
    let (mut f, part) = (Film::new(spec(7, 2, -46)), Film::new(spec(7, 2, -46)));
    for &(b, n) in &BATCHES {
        (0..n).into_par_iter().for_each(|i| {
            let target = if i % 2 == 0 && b == 0 { &part } else { &f };
            target.add((i % 7) as usize, 0, value(b, i));
            target.add((number(i).abs() * 10.0) as usize % 7, 1, value(b, i + 500));
        });
        if b == 0 {
            f.merge(&part).unwrap();
        }
        f.end_batch(b, n).unwrap();
    }
    assert_eq!(bits(&f), expected);
}

#[test]
fn parallel_adds_with_carries_are_exact() {
    // Values near the low word's size: nearly every add carries, signs mixed.
    let f = Film::new(spec(1, 1, 0));
    let big = 1.5 * power_of_two(63);
    (0..200_000u64).into_par_iter().for_each(|i| {
        f.add(0, 0, Rgb::splat(if i % 3 == 0 { -big } else { big }));
    });
    let mut f = f;
    f.end_batch(0, 1).unwrap();
    let negative = 200_000u64.div_ceil(3) as i128;
    assert_eq!(f.total(0, 0, 1), (200_000 - 2 * negative) * (big as i128));
}

#[test]
fn ones_do_not_stop_counting() {
    let mut f = Film::new(spec(1, 1, FilmSpec::quantum_for(1.0)));
    let n = 1u64 << 26;
    for b in 0..2 {
        for _ in 0..n / 2 {
            f.add(0, 0, Rgb::ONE);
        }
        f.end_batch(b, n / 2).unwrap();
    }
    assert_eq!(f.mean(0, 0), Rgb::ONE);
    assert_eq!(f.variance_of_mean(0, 0), Some(Rgb::ZERO));
}

#[test]
fn small_values_survive_a_large_one() {
    let mut f = Film::new(spec(1, 1, FilmSpec::quantum_for(1e-3)));
    for i in 0..100_000 {
        f.add(0, 0, Rgb::splat(if i == 77 { 1e6 } else { 1e-3 }));
    }
    f.end_batch(0, 100_000).unwrap();
    let exact = (1e6 + 99_999.0 * 1e-3) / 1e5;
    assert!((f.mean(0, 0)[0] / exact - 1.0).abs() < 1e-13);
}

#[test]
fn bad_values_are_left_out_and_counted() {
    let mut f = Film::new(spec(2, 1, -46));
    assert!(f.add(0, 0, Rgb::ONE));
    assert!(!f.add(0, 0, Rgb([1.0, f64::NAN, 1.0])));
    assert!(!f.add(1, 0, Rgb([f64::NEG_INFINITY, 0.0, 0.0])));
    assert!(!f.add(1, 0, Rgb([0.0, -1e300, 0.0])));
    assert!(f.add(1, 0, Rgb::splat(2.7e11)));
    f.end_batch(0, 1).unwrap();
    assert_eq!((f.rejected(0), f.rejected(1)), (1, 2));
    assert_eq!(f.health.get(Mishap::RejectedNonfinite), 2);
    assert_eq!(f.health.get(Mishap::Overflow), 1);
    assert_eq!(f.mean(0, 0), Rgb::ONE);

    // A sum that leaves the range is seen as well.
    let f = Film::new(spec(1, 1, 0));
    for _ in 0..2000 {
        f.add(0, 0, Rgb::splat(0.99 * VALUE_LIMIT));
    }
    assert!(f.health.get(Mishap::SumOverflow) > 0);
}

#[test]
fn variance_is_the_textbook_one() {
    // Equal batches: variance of batch means over their number.
    let mut f = Film::new(spec(1, 1, -46));
    let mut means = Moments::default();
    for b in 0..32 {
        let sum = (0..16).map(|i| value(b, i)[0]).sum::<f64>();
        (0..16).for_each(|i| assert!(f.add(0, 0, value(b, i))));
        f.end_batch(b, 16).unwrap();
        means.push(sum / 16.0);
    }
    let expected = means.variance() / 32.0;
    let got = f.variance_of_mean(0, 0).unwrap()[0];
    assert!((got / expected - 1.0).abs() < 1e-10, "{got} {expected}");
    assert!((f.mean(0, 0)[0] - means.mean).abs() < 1e-12);

    // Unequal batches, by hand: S = 2, 9 with n = 1, 3: m = 11/4, s^2 = 4 + 27 - 121/4 = 3/4, over N = 4.
    let mut f = Film::new(spec(1, 1, -46));
    f.add(0, 0, Rgb::splat(2.0));
    f.end_batch(0, 1).unwrap();
    assert_eq!(f.variance_of_mean(0, 0), None);
    f.add(0, 0, Rgb::splat(9.0));
    f.end_batch(1, 3).unwrap();
    assert!((f.variance_of_mean(0, 0).unwrap()[0] - 0.1875).abs() < 1e-13);
}

#[test]
fn unequal_batches_are_unbiased() {
    // The mean of the estimate over 4000 films against the true s^2 / N of a random sign; 4.9 sigma: one false alarm in 1e6.
    let (sizes, mut estimate) = ([1, 5, 2, 8], Moments::default());
    for run in 0..4000u64 {
        let mut f = Film::new(spec(1, 1, -46));
        for (b, &n) in sizes.iter().enumerate() {
            for i in 0..n {
                let x = number(run * 1000 + b as u64 * 100 + i);
                // The sign of a symmetric number has variance 1.
                f.add(0, 0, Rgb::splat(x.signum()));
            }
            f.end_batch(b as u64, n).unwrap();
        }
        estimate.push(f.variance_of_mean(0, 0).unwrap()[0]);
    }
    let truth = 1.0 / 16.0;
    assert!((estimate.mean - truth).abs() < 4.9 * estimate.standard_error(), "{} {truth}", estimate.mean);
    // Negative control: weighting all batches alike would be seen.
    assert!((estimate.mean * 1.2 - truth).abs() > 4.9 * estimate.standard_error());
}

#[test]
fn mismatches_are_refused_and_change_nothing() {
    let mut a = Film::new(spec(1, 1, -46));
    a.add(0, 0, Rgb::ONE);
    a.end_batch(3, 1).unwrap();
    assert!(a.end_batch(3, 1).is_err());
    let mut b = Film::new(spec(1, 1, -46));
    b.end_batch(2, 1).unwrap();
    b.end_batch(3, 1).unwrap();
    let before = bits(&a);
    assert_eq!(a.merge(&b).unwrap_err().exit_code(), crate::error::ExitCode::Mismatch);
    assert!(a.merge(&Film::new(spec(1, 1, -45))).is_err());
    assert_eq!(bits(&a), before);
    assert_eq!(a.batches(), [Batch { index: 3, samples: 1 }]);
}

fn cover(ranges: &[(u64, u64)], spp: u64) {
    let mut next = 0;
    for &(first, n) in ranges {
        assert_eq!(first, next);
        assert!(n > 0);
        next += n;
    }
    assert_eq!(next, spp);
}

#[test]
fn batch_ranges_cover_the_samples() {
    for spp in [1, 5, 31, 32, 33, 100, 1000] {
        let r = batch_ranges(spp);
        assert_eq!(r.len() as u64, spp.min(32));
        cover(&r, spp);
    }
    assert!(batch_ranges(0).is_empty());
}

#[test]
fn batches_of_limited_runs_begin_small() {
    for spp in [1, 5, 32, 33, 1000, 400_000] {
        let r = graded_ranges(spp);
        cover(&r, spp);
        assert!(r.len() as u64 >= spp.min(32) && r.len() < 80, "{spp}: {}", r.len());
        assert!(r.iter().all(|&(first, n)| n == 1 || n <= first / 4 && n <= spp / 32), "{spp}");
    }
}

#[test]
fn wide_division_matches_narrow() {
    for (m, n) in [(0u128, 1u64), (1, 2), (3, 2), (1 << 40, 7), (u64::MAX as u128 / 3, u64::MAX)] {
        let exact = (m * m + n as u128 / 2) / n as u128;
        let q = square_over(m, n);
        assert_eq!(q[0] as u128 | (q[1] as u128) << 64, exact, "{m}^2 / {n}");
    }
    // (2^95)^2 / 1 = 2^190.
    assert_eq!(square_over(1 << 95, 1), [0, 0, 1 << 62]);
    assert_eq!(wide_to_f64([0, 0, 1 << 62]), power_of_two(190));
}

#[test]
fn integers_by_both_ways() {
    let edge = 2.0f64.powi(51);
    let near =
        [0.5, 1.5, 2.5, 0.499_999_999_999_999_94, 1e-300, 12345.5, edge - 0.5, edge - 0.25, edge + 0.5, edge * 3.0];
    let all = near.into_iter().chain((0..1000).map(|i| 1.0137f64.powi(i - 300) * 0.731));
    for x in all.flat_map(|x| [x, -x]) {
        assert_eq!(to_integer(x), x.round_ties_even() as i128, "{x}");
    }
}
