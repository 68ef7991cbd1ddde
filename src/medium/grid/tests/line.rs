//! Spans, integrals, inversion.

use super::*;
use crate::math::rng::Rng;
use proptest::prelude::*;

#[test]
fn spans_partition_awkward_rays() {
    let (grid, ..) = sparse(9, 1, 0.0, DAffine3::IDENTITY);
    let (low, high) = grid.world_bounds().unwrap();
    assert_eq!((low, high), (DVec3::new(-24.0, -24.0, -32.0), DVec3::new(56.0, 16.0, 16.0)));
    let cases = [
        (DVec3::new(-100.0, 0.5, 0.5), DVec3::X),
        (DVec3::new(-100.0, 8.0, 8.0), DVec3::X),
        (DVec3::new(100.0, 8.0, -8.0), -DVec3::X),
        (DVec3::new(8.0, 8.0, 8.0), DVec3::ONE),
        (DVec3::new(8.0, 8.0, 8.0), -DVec3::ONE),
        (DVec3::new(-24.0, -24.0, -32.0), DVec3::new(1.0, 1.0, 0.0)),
        (DVec3::new(0.0, 0.0, 0.0), DVec3::new(1e-300, 1.0, -1e-320)),
        (DVec3::new(3.0, 4.0, 5.0), DVec3::ZERO),
        (DVec3::new(0.0, 16.0, 0.0), DVec3::X),
        (DVec3::new(0.0, -24.0, 0.0), DVec3::X),
    ];
    for (o, w) in cases {
        check_partition(&grid, o, w, -50.0, 220.0);
        check_partition(&grid, o, w, 0.0, 3.5);
        check_partition(&grid, o, w, 1.0, 1.0);
        let sum = grid.integrate(o, w, -50.0, 220.0);
        assert!(sum.is_finite());
    }
    // The upper faces are outside, the lower ones inside.
    assert_eq!(grid.spans(DVec3::new(0.0, 16.0, 0.0), DVec3::X, 0.0, 9.0).count(), 0);
    assert_ne!(grid.spans(DVec3::new(0.0, -24.0, 0.0), DVec3::X, 0.0, 9.0).count(), 0);
    // Not a number in, not a number out.
    assert!(grid.integrate(DVec3::NAN, DVec3::X, 0.0, 1.0).is_nan());
    assert!(grid.integrate(DVec3::ZERO, DVec3::X, f64::NAN, 1.0).is_nan());
    assert!(grid.lookup(DVec3::new(0.0, f64::NAN, 0.0)).is_nan());
}

/// Spans follow each other, cover the box, and bound the field.
fn check_partition(grid: &Grid, o: DVec3, w: DVec3, t0: f64, t1: f64) {
    let large = |limit: f32| {
        let whole = move |level, [min, max]: [f32; 2]| (max - min) * (level as f32) <= limit;
        SpanIter::new(grid, traverse::Ray::new(grid, o, w), t0, t1, false, whole).collect::<Vec<Span>>()
    };
    let exact = [grid.spans(o, w, t0, t1).collect(), grid.single_spans(o, w, t0, t1).collect()];
    let nodes = [large(1e9), large(1.0), large(0.3), grid.thin_spans(o, w, t0, t1, 20.0).collect()];
    for spans in exact.into_iter().chain(nodes) {
        for pair in spans.windows(2) {
            assert_eq!(pair[0].t1, pair[1].t0);
        }
        for s in &spans {
            assert!(s.t0 < s.t1 && t0 <= s.t0 && s.t1 <= t1);
            for k in 1..10 {
                let t = s.t0 + (s.t1 - s.t0) * f64::from(k) / 10.0;
                let v = grid.lookup(o + t * w);
                let slack = 1e-11 * grid.max();
                assert!(s.min - slack <= v && v <= s.max + slack, "{v} {s:?}");
            }
        }
        // Whatever lies clearly inside is covered, whatever lies clearly outside is not.
        let (low, high) = grid.world_bounds().unwrap();
        for k in 0..=200 {
            let t = t0 + (t1 - t0) * f64::from(k) / 200.0;
            let p = o + t * w;
            let inside = (p - low).min_element().min((high - p).min_element());
            let covered = spans.iter().filter(|s| s.t0 <= t && t < s.t1).count();
            if inside > 1e-9 && t < t1 {
                assert_eq!(covered, 1, "{t}");
            } else if inside < -1e-9 {
                assert_eq!(covered, 0, "{t}");
            }
        }
    }
}

/// Integral by Gauss quadrature on pieces far shorter than a cell, cut at every cell face.
fn quadrature(direct: &Direct, o: DVec3, w: DVec3, t0: f64, t1: f64) -> [f64; 3] {
    let mut cuts = vec![t0, t1];
    for a in 0..3 {
        for k in -80..120 {
            let t = (f64::from(k) - o[a]) / w[a];
            if t0 < t && t < t1 {
                cuts.push(t);
            }
        }
    }
    cuts.sort_by(f64::total_cmp);
    let mut sum = [0.0; 3];
    let rule = [(-0.6f64.sqrt(), 5.0 / 9.0), (0.0, 8.0 / 9.0), (0.6f64.sqrt(), 5.0 / 9.0)];
    for pair in cuts.windows(2) {
        let half = 0.5 * (pair[1] - pair[0]);
        for (x, weight) in rule {
            let v = direct.at(o + w * (0.5 * (pair[0] + pair[1]) + x * half));
            for c in 0..3 {
                sum[c] += half * weight * v[c];
            }
        }
    }
    sum
}

#[test]
fn integrals_agree_with_quadrature() {
    for (seed, channels, background) in [(11, 1, 0.0), (12, 1, 0.4), (13, 3, 0.3)] {
        let (grid, direct, _) = sparse(seed, channels, background, transform());
        let mut rng = Rng::keyed(seed, 8, 0, 0);
        for _ in 0..300 {
            let (o, w) = (point(&mut rng, -60.0, 60.0), direction(&mut rng));
            let target = point(&mut rng, -20.0, 40.0);
            let (t0, t1) = (random(&mut rng, -1.0, 0.2), random(&mut rng, 0.2, 2.0));
            let (o, w) = if rng.uniform() < 0.5 { (o, target - o) } else { (target, w * 30.0) };
            let expected = quadrature(&direct, o, w, t0, t1);
            let (wo, ww) = (transform().transform_point3(o), transform().transform_vector3(w));
            let got = grid.integrate3(wo, ww, t0, t1);
            for c in 0..channels {
                assert!((got[c] - expected[c]).abs() <= 1e-11 * (t1 - t0), "{got:?} {expected:?}");
            }
            assert!((grid.integrate(wo, ww, t0, t1) - got[0]).abs() <= 1e-13 * got[0].abs());
            let spans: f64 = grid.spans(wo, ww, t0, t1).map(|s| grid.integrate_span(&s, wo, ww)[0]).sum();
            assert!((spans - got[0]).abs() <= 1e-13 * got[0].abs());
            // And back, through the iterator's own ray.
            let mut spans = grid.spans(wo, ww, t0, t1);
            while let Some(s) = spans.next() {
                let whole = grid.integrate_span(&s, wo, ww)[0];
                if whole > 0.0 {
                    let t = spans.invert(&s, 0.3 * whole).unwrap();
                    let part = grid.integrate(wo, ww, s.t0, t);
                    assert!((part - 0.3 * whole).abs() <= 1e-11 * (t1 - t0), "{part} {whole:?}");
                    let beyond = spans.invert(&s, 1.01 * whole).unwrap_err();
                    assert!((beyond - whole).abs() <= 1e-13 * whole.abs());
                }
            }
            // Along an axis, on a face, there and back.
            let back = grid.integrate3(wo + ww, -ww, 1.0 - t1, 1.0 - t0);
            assert!((back[0] - got[0]).abs() <= 1e-11);
        }
    }
}

/// The slope of integrals is that of differences, as the ray is shifted and as it turns.
#[test]
fn slopes_agree_with_differences() {
    for (seed, channels) in [(21, 1), (22, 3)] {
        let (grid, ..) = sparse(seed, channels, 0.0, transform());
        let mut rng = Rng::keyed(seed, 8, 0, 0);
        for _ in 0..200 {
            let (o, w) = (point(&mut rng, -30.0, 30.0), direction(&mut rng) * 30.0);
            let (o, w) = (transform().transform_point3(o), transform().transform_vector3(w));
            let (t0, t1) = (random(&mut rng, -1.0, 0.2), random(&mut rng, 0.2, 2.0));
            let (shift, turn) = (direction(&mut rng), direction(&mut rng));
            let slopes = grid.integrate_slope(o, w, t0, t1);
            let whole = grid.integrate3(o, w, t0, t1);
            let h = 1e-5;
            let [a, b] = [h, -h].map(|h| grid.integrate3(o + shift * h, w + turn * h, t0, t1));
            for c in 0..3 {
                let s = slopes[c];
                assert!((s.value - whole[c]).abs() <= 1e-13 * whole[c].abs());
                let slope = s.gradient.dot(shift) + (s.moment + s.gradient * t0).dot(turn);
                let size = s.gradient.length() + s.moment.length();
                // Where a cell is entered the gradient jumps: an error like h.
                assert!((slope - (a[c] - b[c]) / (2.0 * h)).abs() <= 1e-4 * (1.0 + size), "{slope} {a:?} {b:?}");
            }
        }
    }
}

#[test]
fn node_integrals_sum_to_the_integral() {
    for channels in [1, 3] {
        let (grid, ..) = sparse(15, channels, 0.0, transform());
        let values = grid.values();
        let mut rng = Rng::keyed(15, 8, 0, 0);
        for _ in 0..200 {
            let (o, w) = (point(&mut rng, -30.0, 30.0), direction(&mut rng));
            let (o, w) = (transform().transform_point3(o), transform().transform_vector3(w));
            let mut sum = 0.0;
            grid.integrate_nodes(o, w, -70.0, 60.0, &mut |id, weight| {
                sum += weight * f64::from(values[id.0 as usize * channels]);
            });
            let whole = grid.integrate(o, w, -70.0, 60.0);
            assert!((sum - whole).abs() <= 1e-12 * whole.abs().max(1.0), "{sum} {whole}");
        }
    }
}

#[test]
fn inversion_undoes_integration() {
    for (channels, background) in [(1, 0.0), (1, 0.4), (3, 0.0)] {
        let (grid, ..) = sparse(17, channels, background, transform());
        let mut rng = Rng::keyed(17, 8, 0, 0);
        for _ in 0..500 {
            let (o, w) = (point(&mut rng, -30.0, 30.0), direction(&mut rng));
            let (o, w) = (transform().transform_point3(o), transform().transform_vector3(w));
            let (t0, t1) = (random(&mut rng, -50.0, 0.0), random(&mut rng, 0.0, 50.0));
            let whole = grid.integrate(o, w, t0, t1);
            let target = whole * rng.uniform();
            let t = grid.invert(o, w, t0, t1, target).unwrap();
            let again = grid.integrate(o, w, t0, t);
            assert!((again - target).abs() <= 1e-13 * whole, "{again} {target}");
            assert_eq!(grid.invert(o, w, t0, t1, whole * 1.001 + 1.0), Err(whole));
            if whole > 0.0 {
                let end = grid.invert(o, w, t0, t1, whole).unwrap();
                assert!(end <= t1 && (grid.integrate(o, w, t0, end) - whole).abs() <= 1e-13 * whole);
            }
            if channels == 3 {
                let all = grid.integrate3(o, w, t0, t1);
                let t = grid.invert_channel(2, o, w, t0, t1, 0.5 * all[2]).unwrap();
                assert!((grid.integrate3(o, w, t0, t)[2] - 0.5 * all[2]).abs() <= 1e-13 * all[2]);
            }
        }
    }
}

#[test]
fn a_linear_ramp_has_the_known_integral_and_inverse() {
    // sigma(x) = a + b x between voxel centres: the integral is a t + b t^2 / 2.
    let (a, b, n) = (0.5, 0.25, 20);
    let values: Vec<f32> = (0..n * 2 * 2).map(|i| (a + b * (i % n) as f64) as f32).collect();
    let placed = DAffine3::from_scale(DVec3::new(n as f64, 1.0, 1.0));
    let grid = Grid::from_dense(1, [n, 2, 2], &values, placed, Filter::Trilinear).unwrap();
    let o = DVec3::new(0.5, 0.4, 0.6);
    for t in [1e-6, 0.3, 1.0, 7.7, 19.0] {
        let expected = a * t + 0.5 * b * t * t;
        assert!((grid.integrate(o, DVec3::X, 0.0, t) - expected).abs() < 1e-13 * expected);
        let back = grid.invert(o, DVec3::X, 0.0, 19.0, expected).unwrap();
        assert!((back - t).abs() <= 1e-13 * t, "{back} {t}");
    }
    assert!((grid.gradient(o + 3.3 * DVec3::X) - b * DVec3::X).length() < 1e-13);
}

#[test]
fn contrast_of_1e12_stays_in_its_cells() {
    let grid = one_voxel(1e6, 1e-6);
    let centre = DVec3::splat(12.5);
    let faint = f64::from(1e-6f32);
    let mut rng = Rng::keyed(21, 0, 0, 0);
    let mut near = 0;
    for k in 0..4000 {
        // Through the neighbourhood of the voxel, but beside its eight cells; along axes and faces as well.
        let mut w = direction(&mut rng).normalize();
        let mut offset = w.cross(direction(&mut rng)).normalize() * random(&mut rng, 1.75, 3.0);
        if k % 4 == 0 {
            w = DVec3::AXES[k / 4 % 3];
            offset = DVec3::AXES[(k / 4 + 1) % 3] * [1.0, -1.0, 1.01, 2.0][k / 16 % 4];
        }
        let o = centre + offset - 5.0 * w;
        let sum = grid.integrate(o, w, 0.0, 10.0);
        assert!((sum - 10.0 * faint).abs() <= 1e-12 * 10.0 * faint, "{o} {w} {sum}");
        let t = grid.invert(o, w, 0.0, 10.0, 4.0 * faint).unwrap();
        assert!((t - 4.0).abs() < 1e-11);
        near += usize::from(grid.spans(o, w, 0.0, 10.0).any(|s| s.max > 1e5));
    }
    assert!(near > 1000, "the rays pass the bricks of the voxel");
    let through = grid.integrate(centre - 5.0 * DVec3::X, DVec3::X, 0.0, 10.0);
    assert!((through - (1e6 + 9.0 * faint)).abs() < 1e-6);
}

proptest! {
    #[test]
    fn spans_partition(seed in 0u64..8, o in prop::array::uniform3(-70.0..70.0f64),
                       w in prop::array::uniform3(prop_oneof![Just(0.0), -1.0..1.0f64, Just(1e-12)]),
                       snap in any::<bool>(), t0 in -80.0..80.0f64, length in 0.0..160.0f64) {
        let (grid, ..) = sparse(seed, 1, 0.0, DAffine3::IDENTITY);
        let o = DVec3::from(o);
        let o = if snap { (o / 4.0).round() * 4.0 } else { o };
        check_partition(&grid, o, DVec3::from(w), t0, t0 + length);
    }

    #[test]
    fn inversion_round_trip(seed in 0u64..8, o in prop::array::uniform3(-30.0..60.0f64),
                            w in prop::array::uniform3(prop_oneof![Just(0.0), -1.0..1.0f64]),
                            t0 in -60.0..0.0f64, t1 in 0.0..60.0f64, u in 0.0..1.0f64) {
        let (grid, ..) = sparse(seed, 1, 0.0, DAffine3::IDENTITY);
        let (o, w) = (DVec3::from(o), DVec3::from(w));
        let whole = grid.integrate(o, w, t0, t1);
        let t = grid.invert(o, w, t0, t1, u * whole);
        prop_assert!(t.is_ok());
        // What a ray only grazes it has less of than one rounding of t may bring.
        let place = if w == DVec3::ZERO { 0.0 } else { o.length() / w.length() };
        let (t, ulps) = (t.unwrap(), 4.0 * f64::EPSILON * (t1.max(-t0) + place));
        let [before, behind] = [t - ulps, t + ulps].map(|t| grid.integrate(o, w, t0, t));
        prop_assert!(before - 1e-13 * whole <= u * whole && u * whole <= behind + 1e-13 * whole);
    }
}
