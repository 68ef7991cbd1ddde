//! Fine grids: what a ray costs follows what is there, and estimates that take points in place of cells are unbiased.

use super::*;
use crate::math::rng::Rng;

/// Three soft balls in the unit cube, n voxels along each side; 0 far from them.
fn soft(n: usize) -> Grid {
    let balls = [([0.4, 0.5, 0.5], 0.15), ([0.65, 0.4, 0.6], 0.1), ([0.55, 0.7, 0.35], 0.12)];
    let at = |i: usize| (i as f64 + 0.5) / n as f64;
    let value = |x: f64, y: f64, z: f64| {
        let one = |(c, r): &([f64; 3], f64)| {
            let d = [x - c[0], y - c[1], z - c[2]];
            (-0.5 * d.iter().map(|d| d * d).sum::<f64>() / (r * r)).exp()
        };
        let v: f64 = balls.iter().map(one).sum();
        if v < 0.02 { 0.0 } else { v as f32 }
    };
    let mut values = Vec::with_capacity(n * n * n);
    for i in 0..n * n * n {
        values.push(value(at(i % n), at(i / n % n), at(i / n / n)));
    }
    let place = DAffine3::from_scale(DVec3::ONE);
    Grid::from_dense(1, [n; 3], &values, place, Filter::Trilinear).unwrap()
}

/// Rays through the balls.
fn rays(n: usize) -> impl Iterator<Item = (DVec3, DVec3)> {
    let mut rng = Rng::keyed(3, 5, 8, 0);
    (0..n).map(move |_| {
        let (o, p) = (point(&mut rng, -0.5, 1.5), point(&mut rng, 0.3, 0.7));
        (o, (p - o).normalize())
    })
}

/// Mean and its standard error.
fn estimate(n: usize, mut f: impl FnMut(usize) -> f64) -> (f64, f64) {
    let (mut sum, mut squares) = (0.0, 0.0);
    for i in 0..n {
        let x = f(i);
        (sum, squares) = (sum + x, squares + x * x);
    }
    let (n, mean) = (n as f64, sum / n as f64);
    (mean, ((squares / n - mean * mean).max(0.0) / n).sqrt())
}

/// Of 12 rays each; 4.5 s.e. (false alarm 3e-4 for all).
#[test]
fn residual_tracking_is_unbiased() {
    for (n, scale) in [(64, 4.0), (128, 10.0), (128, 40.0)] {
        let (grid, mut estimated) = (soft(n), 0);
        for (k, (o, w)) in rays(12).enumerate() {
            let exact = (-scale * grid.integrate(o, w, 0.0, 3.0)).exp();
            let (mean, error) = estimate(4000, |i| {
                let mut random = Rng::keyed(1, k as u64, i as u64, 0).apart();
                let t = grid.transmittance(o, w, 0.0, 3.0, scale, &mut random);
                assert!(t[0] >= 0.0 && t[1] == t[0]);
                t[0]
            });
            assert!((mean - exact).abs() <= 4.5 * error + 1e-12 * exact, "{n} {scale}: {mean} +- {error}, {exact}");
            estimated += usize::from(error > 1e-6 * exact);
            // Of all residual depth a third at most.
            assert!(error * 4000f64.sqrt() <= 0.6 * exact, "{n} {scale}: {error} of {exact}");
        }
        assert!(estimated > 3, "nothing is smooth: {estimated}");
    }
}

#[test]
fn rough_fields_and_colours_stay_exact() {
    for channels in [1, 3] {
        let (grid, ..) = sparse(9, channels, 0.0, DAffine3::IDENTITY);
        for (o, w) in rays(50) {
            let got = grid.transmittance(o, w, -40.0, 60.0, 1.0, &mut Rng::keyed(4, 0, 0, 0).apart());
            let expected = grid.integrate3(o, w, -40.0, 60.0).map(|d| (-d).exp());
            assert_eq!(got, expected);
        }
    }
}

/// The same for points at which the depth is differentiated: the integral itself, and of constants the length without any error.
#[test]
fn pieces_add_up_to_the_way() {
    let rate = Rate { by_value: 40.0, floor: 4.0 };
    let sum = |grid: &Grid, o: DVec3, w: DVec3, u: f64| {
        let (mut sum, mut length, mut points) = (0.0, 0.0, 0);
        grid.pieces(o, w, 0.0, 3.0, Some((rate, u)), |piece| match piece {
            Piece::Whole(span) => {
                sum += grid.integrate_span(&span, o, w)[0];
                length += span.t1 - span.t0;
            }
            Piece::Point { t, weight } => {
                sum += weight * grid.lookup(o + w * t);
                length += weight;
                points += 1;
            }
        });
        (sum, length, points)
    };
    for n in [32, 128] {
        let grid = soft(n);
        let mut rng = Rng::keyed(2, 7, 1, 8);
        let mut points = 0;
        for (o, w) in rays(12) {
            let exact = grid.integrate(o, w, 0.0, 3.0);
            let (mean, error) = estimate(2000, |_| {
                let (sum, _, n) = sum(&grid, o, w, rng.uniform());
                points += n;
                sum
            });
            assert!((mean - exact).abs() <= 4.5 * error + 1e-13, "{n}: {mean} +- {error}, {exact}");
            assert!(error * 2000f64.sqrt() <= 0.25 * exact.max(0.1), "{n}: {error} of {exact}");
        }
        assert!(points > 2000, "{n}: {points}");
    }
    let even = Grid::from_dense(1, [100; 3], &[0.5; 1_000_000], DAffine3::IDENTITY, Filter::Trilinear).unwrap();
    for (o, w) in rays(50) {
        let (a, b) = even.clip_ray(o, w, 0.0, 3.0);
        let (_, length, points) = sum(&even, o, w, 0.37);
        assert!((length - (b - a).max(0.0)).abs() < 1e-12 && (points > 0) == (a < b));
    }
}

/// Profiles are the integral to the bit, bounds lie above the field, and either is where it says.
#[test]
fn profiles_hold_the_integral_and_bounds_more() {
    let (grid, scale) = (soft(256), 10.0);
    let (mut rng, mut bounds) = (Rng::keyed(6, 2, 4, 0), 0);
    for (o, w) in rays(40) {
        let exact = grid.profile(o, w, 0.0, 3.0).unwrap();
        assert!(exact.total() == grid.integrate(o, w, 0.0, 3.0) && !exact.is_bound());
        let above = grid.bounds(o, w, 0.0, 3.0, scale).unwrap();
        bounds += usize::from(above.is_bound());
        for _ in 0..20 {
            let u = rng.uniform();
            let t = 3.0 * u;
            assert!((exact.until(&grid, t) - grid.integrate(o, w, 0.0, t)).abs() <= 1e-14);
            assert!(above.until(&grid, t) >= exact.until(&grid, t) - 1e-14);
            let place = exact.invert(&grid, u * exact.total());
            assert_eq!(place.map(|p| p.t), grid.invert(o, w, 0.0, 3.0, u * exact.total()).ok());
            if let Some(place) = above.invert(&grid, u * above.total()) {
                assert!((above.until(&grid, place.t) - u * above.total()).abs() < 1e-12);
                assert!(place.bound.is_none_or(|b| b >= grid.lookup(o + w * place.t)));
            }
        }
        assert!(above.invert(&grid, 1.001 * above.total() + 1e-9).is_none());
    }
    assert!(bounds > 20, "{bounds}");
}

/// Spans, points and tentative collisions of the same field with four times as many voxels along each side, and what camera lines take.
#[test]
fn steps_follow_the_depth_and_not_the_voxels() {
    let scale = 10.0;
    let count = |grid: &Grid| {
        let (mut flight, mut points, mut exact) = (0, 0, 0);
        let [mut profile, mut bounds] = [0.0; 2];
        for (o, w) in rays(300) {
            flight += grid.thin_spans(o, w, 0.0, 3.0, 1.0 / scale).count();
            let rate = Rate { by_value: 4.0 * scale, floor: 4.0 };
            grid.pieces(o, w, 0.0, 3.0, Some((rate, 0.5)), |_| points += 1);
            exact += grid.single_spans(o, w, 0.0, 3.0).count();
            profile += grid.profile(o, w, 0.0, 3.0).unwrap().effort();
            bounds += grid.bounds(o, w, 0.0, 3.0, scale).unwrap().effort();
        }
        [flight as f64, points as f64, exact as f64, profile, bounds]
    };
    let (coarse, fine) = (count(&soft(64)), count(&soft(256)));
    assert!(fine[2] > 3.5 * coarse[2], "{coarse:?} {fine:?}");
    assert!(fine[0] < 1.5 * coarse[0], "{coarse:?} {fine:?}");
    assert!(fine[1] < 1.5 * coarse[1], "{coarse:?} {fine:?}");
    assert!(fine[3] > 3.0 * coarse[3] && fine[4] < coarse[3], "{coarse:?} {fine:?}");
}
