//! Roots of functions of one variable: between signs that differ, and pairs of them that signs do not tell.

/// Steps at most: halvings at worst.
const STEPS: usize = 60;
/// Steps, over the stretch that is searched, that are none.
const SETTLED: f64 = 1e-13;

/// A place and a value there.
pub type At = (f64, f64);

/// Where a function is 0 between two places at which its signs differ (regula falsi with halved ends, and halvings where that is slow), with what else it tells there. `None` where it is not defined on the way.
pub fn root<T: Copy>(a: At, b: At, f: &impl Fn(f64) -> Option<(f64, T)>) -> Option<(f64, T)> {
    let (mut a, mut b, mut best) = (a, b, None);
    let (mut held, size) = (0, (b.0 - a.0).abs());
    for k in 0..STEPS {
        let slow = k % 4 == 3;
        let s = if slow { 0.5 * (a.0 + b.0) } else { (a.0 * b.1 - b.0 * a.1) / (b.1 - a.1) };
        let s = if s > a.0.min(b.0) && s < a.0.max(b.0) { s } else { 0.5 * (a.0 + b.0) };
        let (v, told) = f(s)?;
        let settled = best.is_some_and(|(last, _): (f64, T)| (s - last).abs() <= SETTLED * size);
        best = Some((s, told));
        if v == 0.0 || settled {
            break;
        }
        if (v < 0.0) == (a.1 < 0.0) {
            a = (s, v);
            b.1 *= if held == 1 { 0.5 } else { 1.0 };
            held = 1;
        } else {
            b = (s, v);
            a.1 *= if held == 2 { 0.5 } else { 1.0 };
            held = 2;
        }
    }
    best
}

/// A place between a and c at which a function has another sign than at all three, if it comes so near to 0 around b; its sign there is `sign`.
pub fn dip<T>(a: At, b: At, c: At, sign: f64, f: &impl Fn(f64) -> Option<(f64, T)>) -> Option<At> {
    let (mut a, mut b, mut c, size) = (a, b, c, c.0 - a.0);
    for _ in 0..STEPS / 2 {
        // The parabola's least value says whether it is worth while.
        let (x, y) = (b.0 - a.0, c.0 - b.0);
        let slope = ((b.1 - a.1) / x * y + (c.1 - b.1) / y * x) / (x + y);
        let bend = ((c.1 - b.1) / y - (b.1 - a.1) / x) / (x + y);
        let least = b.1 - 0.25 * slope * slope / bend;
        if sign * bend <= 0.0 || sign * least > 0.5 * b.1.abs() {
            return None;
        }
        let s = b.0 - 0.5 * slope / bend;
        let s = if (s - b.0).abs() > 1e-3 * (c.0 - a.0) {
            s
        } else if y > x {
            b.0 + 0.1 * y
        } else {
            b.0 - 0.1 * x
        };
        if !(s > a.0 && s < c.0) {
            return None;
        }
        let d = (s, f(s)?.0);
        if sign * d.1 < 0.0 {
            return Some(d);
        }
        match (sign * d.1 < sign * b.1, d.0 > b.0) {
            (true, true) => (a, b) = (b, d),
            (true, false) => (b, c) = (d, b),
            (false, true) => c = d,
            (false, false) => a = d,
        }
        if c.0 - a.0 <= SETTLED * size {
            return None;
        }
    }
    None
}

/// Parts of 0..=1 within each of which a function has one extreme at most.
const PARTS: usize = 64;
/// Of golden sections.
const GOLDEN: f64 = 0.381966011250105;

/// Stretches of 0..=1 on which a function is positive; `closed`: it is the same at both ends.
pub fn positive(f: impl Fn(f64) -> f64, closed: bool) -> Vec<[f64; 2]> {
    let at = |s: f64| (s, f(s));
    let samples: Vec<At> = (0..=PARTS).map(|k| at(k as f64 / PARTS as f64)).collect();
    let mut points = samples.clone();
    // What lies between samples that are not.
    for (k, &here) in samples.iter().enumerate().filter(|(k, s)| s.1 <= 0.0 && !(closed && *k == PARTS)) {
        let last = match k.checked_sub(1) {
            Some(i) => samples[i],
            None if closed => (samples[PARTS - 1].0 - 1.0, samples[PARTS - 1].1),
            None => here,
        };
        let next = samples.get(k + 1).copied().unwrap_or(here);
        if last.1 <= here.1 && next.1 <= here.1 {
            points.extend(rise(last, here, next, &at).map(|(s, v)| (if s < 0.0 { s + 1.0 } else { s }, v)));
        }
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut found, mut begun) = (Vec::new(), (points[0].1 > 0.0).then_some(points[0].0));
    let zero = |a: At, b: At| root(a, b, &|s| Some((f(s), ()))).map_or(0.5 * (a.0 + b.0), |r| r.0);
    for pair in points.windows(2).filter(|p| (p[0].1 > 0.0) != (p[1].1 > 0.0)) {
        let s = zero(pair[0], pair[1]);
        match begun.take() {
            Some(first) => found.push([first, s]),
            None => begun = Some(s),
        }
    }
    found.extend(begun.map(|first| [first, 1.0]));
    found.retain(|[a, b]| b > a);
    found
}

/// A place between a and c, of which b is above both, at which a function is positive.
fn rise(mut a: At, mut b: At, mut c: At, at: &impl Fn(f64) -> At) -> Option<At> {
    for _ in 0..STEPS {
        let right = c.0 - b.0 > b.0 - a.0;
        let d = at(b.0 + GOLDEN * if right { c.0 - b.0 } else { a.0 - b.0 });
        if d.1 > 0.0 {
            return Some(d);
        }
        match (d.1 > b.1, right) {
            (true, true) => (a, b) = (b, d),
            (true, false) => (b, c) = (d, b),
            (false, true) => c = d,
            (false, false) => a = d,
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Stretches between samples, at the ends, and over the place at which a closed curve begins.
    #[test]
    fn positive_stretches_are_found() {
        use std::f64::consts::TAU;
        let near = |found: Vec<[f64; 2]>, right: &[[f64; 2]]| {
            let same = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9;
            assert!(found.len() == right.len() && found.iter().zip(right).all(same), "{found:?} {right:?}");
        };
        for (middle, half) in
            [(0.3, 0.1), (0.3004, 1e-5), (0.0, 0.2), (0.002, 1e-4), (1.0, 0.01), (1.2, 0.1), (0.5, 2.0)]
        {
            let right = [f64::max(middle - half, 0.0), f64::min(middle + half, 1.0)];
            let right: &[[f64; 2]] = if right[0] < right[1] { &[right] } else { &[] };
            near(positive(|s| half * half - (s - middle).powi(2), false), right);
        }
        for middle in [0.25, 0.2534, 0.9999, 0.001] {
            // Two stretches, on opposite sides.
            let half: f64 = 1e-4;
            let f = |s: f64| (2.0 * TAU * (s - middle)).cos() - (2.0 * TAU * half).cos();
            let mut right: Vec<[f64; 2]> = [0.0, 0.5]
                .map(|turn| (middle + turn).rem_euclid(1.0))
                .map(|m| [m - half, m + half])
                .into_iter()
                .flat_map(|[a, b]| if b > 1.0 { vec![[0.0, b - 1.0], [a, 1.0]] } else { vec![[a, b]] })
                .collect();
            right.sort_by(|a, b| a[0].total_cmp(&b[0]));
            near(positive(f, true), &right);
        }
        near(positive(|_| 1.0, true), &[[0.0, 1.0]]);
    }

    /// Roots between signs that differ, and a pair that no sign tells.
    #[test]
    fn roots_are_found() {
        let f = |s: f64| Some(((s - 0.3) * (s - 0.31), ()));
        let at = |s: f64| (s, f(s).unwrap().0);
        let (a, b, c) = (at(0.2), at(0.3125), at(0.4));
        let turned = dip(a, b, c, 1.0, &f).unwrap();
        assert!(turned.1 < 0.0);
        assert!(
            (root(a, turned, &f).unwrap().0 - 0.3).abs() < 1e-11
                && (root(turned, c, &f).unwrap().0 - 0.31).abs() < 1e-11
        );
        let none = |s: f64| Some(((s - 0.3).powi(2) + 0.01, ()));
        let at = |s: f64| (s, none(s).unwrap().0);
        assert!(dip(at(0.2), at(0.31), at(0.4), 1.0, &none).is_none());
    }
}
