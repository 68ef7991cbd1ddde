//! Distances in one medium: free flight and its weights.
//!
//! Homogeneous: exponential steps of the hero channel. Grids: delta tracking against the majorant of each brick, or of several where they are thin, with
//! the largest channel as majorant and per-channel weights [T] 8.1, 8.4; in gray bricks that are constant or of great contrast, where null
//! collisions would pile up, the exact cubic depth is inverted instead. Both have the density `sigma_t T`. The weights of gray media are
//! exactly 1 and the albedo: nothing is divided.

use super::record::MediumSpan;
use super::state::State;
use crate::math::Rgb;
use crate::math::rng::Rng;
use crate::medium::grid::Grid;
use crate::medium::{Medium, Volume};

/// Tentative collisions across a brick from which on its exact depth is inverted: that many steps cost more than its cells.
const EXACT_STEPS: f64 = 16.0;

/// Tentative collisions across several bricks up to which they are one piece: that many cost less than the steps from brick to brick.
const THIN: f64 = 1.0;

/// A distance of density `sigma_h exp(-sigma_h t)`; infinite where nothing is there.
pub fn distance(m: &Medium, s: &mut State) -> f64 {
    choose_hero(m, s);
    let sigma = m.sigma_t[s.hero];
    let e = s.rng.exponential();
    if sigma > 0.0 { e / sigma } else { f64::INFINITY }
}

/// Draw the hero channel for this flight from `r`, the channel densities of the path so far: the same mixture as one hero a
/// path [T] (55). `beta` and `r` share an arbitrary normalisation, only `beta / mean(r)` is ever scored.
fn choose_hero(m: &Medium, s: &mut State) {
    if m.gray {
        return;
    }
    let total = s.r.sum();
    let u = s.rng.uniform() * total;
    s.hero = if u < s.r[0] {
        0
    } else if u < s.r[0] + s.r[1] {
        1
    } else {
        2
    };
}

/// Weights of a collision at distance `t` in a homogeneous medium.
pub fn weight_collision(m: &Medium, t: f64, s: &mut State) {
    if m.gray {
        s.beta *= m.constant_albedo;
        return;
    }
    let h = s.hero;
    for c in 0..3 {
        let relative = if m.sigma_t[c] == m.sigma_t[h] { 1.0 } else { (-(m.sigma_t[c] - m.sigma_t[h]) * t).exp() };
        s.beta[c] *= relative * m.sigma_s[c] / m.sigma_t[h];
        s.r[c] *= relative * m.sigma_t[c] / m.sigma_t[h];
    }
}

/// Weights of passing `t` without a collision in a homogeneous medium.
pub fn weight_passage(m: &Medium, t: f64, s: &mut State) {
    if m.gray {
        return;
    }
    let h = s.hero;
    for c in 0..3 {
        let relative = if m.sigma_t[c] == m.sigma_t[h] { 1.0 } else { (-(m.sigma_t[c] - m.sigma_t[h]) * t).exp() };
        s.beta[c] *= relative;
        s.r[c] *= relative;
    }
}

/// Fly along `span`: `Some(t)` = collision, weights updated; `None` = passed.
pub fn fly(m: &Medium, span: &MediumSpan, s: &mut State) -> Option<f64> {
    match &m.density {
        Volume::Constant(_) => {
            let t = distance(m, s);
            if t < span.t1 {
                weight_collision(m, t, s);
                if let Volume::Grid(albedo) = &m.albedo {
                    // Constant extinction, albedo on a grid: `constant_albedo` is 1 there.
                    s.beta *= albedo.lookup_rgb(span.o + span.w * t);
                }
                Some(t)
            } else {
                weight_passage(m, span.t1, s);
                None
            }
        }
        Volume::Grid(grid) => {
            choose_hero(m, s);
            let State { rng, beta, r, hero: h, .. } = s;
            // The null event was drawn, so majorant > sigma_t[h] there.
            let null = |majorant: f64, sigma_t: Rgb| {
                for c in 0..3 {
                    let w = (majorant - sigma_t[c]) / (majorant - sigma_t[*h]);
                    beta[c] *= w;
                    r[c] *= w;
                }
            };
            let t = flight(m, grid, span, *h, rng, null)?;
            let p = span.o + span.w * t;
            let albedo = m.albedo.at(p);
            if m.gray {
                s.beta *= albedo;
            } else {
                let sigma_t = m.density.at(p) * m.scale;
                for c in 0..3 {
                    s.beta[c] *= sigma_t[c] * albedo[c] / sigma_t[s.hero];
                    s.r[c] *= sigma_t[c] / sigma_t[s.hero];
                }
            }
            Some(t)
        }
    }
}

/// A flight through a grid by channel `h`: where it collides. `null` is told of the null collisions of chromatic media, majorant and extinction.
pub fn flight(
    m: &Medium,
    grid: &Grid,
    span: &MediumSpan,
    h: usize,
    rng: &mut Rng,
    mut null: impl FnMut(f64, Rgb),
) -> Option<f64> {
    let mut bricks = grid.thin_spans(span.o, span.w, span.t0, span.t1, THIN / m.scale);
    // Optical depth of the majorant up to the next tentative collision.
    let mut left = rng.exponential();
    while let Some(brick) = bricks.next() {
        let majorant = brick.max * m.scale;
        if majorant <= 0.0 {
            continue;
        }
        // For gray media only: nothing to weigh.
        let dense = !brick.large && majorant * (brick.t1 - brick.t0) > EXACT_STEPS;
        if m.gray && (brick.constant || dense) {
            match bricks.invert(&brick, left / m.scale) {
                Ok(t) => return Some(t),
                Err(depth) => {
                    left = (left - depth * m.scale).max(0.0);
                    continue;
                }
            }
        }
        let mut t = brick.t0;
        while left < majorant * (brick.t1 - t) {
            t += left / majorant;
            let sigma_t = m.density.at(span.o + span.w * t) * m.scale;
            if rng.uniform() * majorant < sigma_t[h] {
                return Some(t);
            }
            if !m.gray {
                null(majorant, sigma_t);
            }
            left = rng.exponential();
        }
        left -= majorant * (brick.t1 - t);
    }
    None
}

/// Density per length of a collision at `t`, for MIS weights only: exact in homogeneous media (mean over channels);
/// in grids a stand-in, uniform over the grid's part of the span.
pub fn flight_density(m: &Medium, span: &MediumSpan, t: f64) -> f64 {
    match &m.density {
        Volume::Constant(_) => Rgb::from_fn(|c| m.sigma_t[c] * (-m.sigma_t[c] * (t - span.t0)).exp()).mean(),
        Volume::Grid(grid) => {
            let (lo, hi) = grid.clip_ray(span.o, span.w, span.t0, span.t1);
            if hi > lo { 1.0 / (hi - lo) } else { 0.0 }
        }
    }
}

/// Weight per channel of a point at abscissa `t` of a span that was walked past it: `beta T / mean(r T)`. In gray media
/// the transmittances cancel: the walk got there with probability T.
pub fn walked_weight(m: &Medium, span: &MediumSpan, t: f64, beta: Rgb, r: Rgb) -> Rgb {
    if m.gray {
        return beta * (1.0 / r.mean());
    }
    let tr = depth(m, &span.until(t)).map(|d| (-d).exp());
    beta * tr * (1.0 / (r * tr).mean())
}

/// `beta T / mean(r T (sigma_t + kappa))` at abscissa `t` of a span: [`super::glow`].
pub fn point_weight(m: &Medium, span: &MediumSpan, t: f64, beta: Rgb, r: Rgb, kappa: f64) -> Rgb {
    let sigma = m.coefficients(span.o + span.w * t).0 + Rgb::splat(kappa);
    if m.gray {
        return beta * (1.0 / (r.mean() * sigma[0]));
    }
    let tr = depth(m, &span.until(t)).map(|d| (-d).exp());
    beta * tr * (1.0 / (r * tr * sigma).mean())
}

/// The truncated exponential of the optical depth `total` ([T] section 9); a tiny one's quotient is uniform, ln_1p keeps the digits.
pub fn truncated(u: f64, total: f64) -> f64 {
    (-(u * -(-total).exp_m1()).min(1.0 - f64::EPSILON / 2.0)).ln_1p().abs()
}

/// Optical depth of a span per channel, exact.
pub fn depth(m: &Medium, span: &MediumSpan) -> Rgb {
    match &m.density {
        Volume::Constant(_) => m.sigma_t.map(|s| if s == 0.0 { 0.0 } else { s * (span.t1 - span.t0) }),
        Volume::Grid(_) => m.density_integral(span.o, span.w, span.t0, span.t1) * m.scale,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{DAffine3, DVec3};
    use crate::medium::grid::{GridBuilder, GridSource};
    use crate::medium::{MediumSlots, NO_SLOT};
    use crate::phase::Phase;
    use std::sync::Arc;

    /// Noise with one peak 300 times as high: bricks for either kind of flight, and a constant one.
    fn smoke(scale: f64) -> Medium {
        let source = GridSource {
            channels: 1,
            world_from_index: DAffine3::from_scale(DVec3::splat(0.1)),
            background: [0.0; 3],
            bbox: None,
            clip: None,
        };
        let mut b = GridBuilder::new(source);
        let mut rng = Rng::keyed(5, 9, 0, 0);
        for x in 0..4 {
            let mut values: Vec<f32> = (0..512).map(|_| rng.uniform() as f32).collect();
            if x == 1 {
                values[(4 * 8 + 4) * 8 + 4] = 300.0;
            }
            if x == 2 { b.tile([16, 0, 0], 8, [0.4; 3]) } else { b.leaf([8 * x, 0, 0], &values) }
        }
        let none = MediumSlots {
            sigma_t: NO_SLOT,
            albedo: NO_SLOT,
            scale: NO_SLOT,
            g: NO_SLOT,
            mover: None,
            albedo_mover: None,
        };
        let grid = b.build().unwrap();
        Medium {
            name: "smoke".into(),
            density: Volume::Grid(Arc::new(grid)),
            scale,
            albedo: Volume::Constant(Rgb::splat(0.5)),
            emission: None,
            phase: Phase::Isotropic,
            slots: none,
            sigma_t: Rgb::ONE,
            sigma_s: Rgb::ONE,
            constant_albedo: Rgb::splat(0.5),
            kappa: 1.0,
            gray: true,
        }
    }

    /// `P(flight > t) = T(t)` at several t, gray grid media, whichever way a brick is flown (5.5 s.e. at 80 places; false alarm 3e-6).
    #[test]
    fn flights_follow_the_transmittance() {
        let n = 60_000;
        for (scale, y) in [(0.5, 0.43), (0.5, 0.11), (4.0, 0.43), (20.0, 0.2)] {
            let m = smoke(scale);
            let (o, w) = (DVec3::new(-0.3, y, 0.4), DVec3::new(1.0, 0.02, -0.03).normalize());
            let span = MediumSpan::new(0, o, w, 4.0, &crate::scene::On::default(), None);
            let Volume::Grid(grid) = &m.density else { unreachable!() };
            let steps: Vec<f64> =
                grid.spans(o, w, 0.0, 4.0).filter(|b| !b.constant).map(|b| b.max * scale * (b.t1 - b.t0)).collect();
            assert!(y < 0.4 || steps.iter().any(|&s| s > EXACT_STEPS), "{steps:?}");
            assert!(scale > 4.0 || steps.iter().any(|&s| s < EXACT_STEPS), "{steps:?}");
            let flights: Vec<f64> = (0..n)
                .map(|i| {
                    let mut s = State::new(Rng::keyed(11, 1, i, 0), o, w, Some(0));
                    let t = fly(&m, &span, &mut s);
                    assert_eq!(s.beta, Rgb::splat(if t.is_some() { 0.5 } else { 1.0 }));
                    t.unwrap_or(f64::INFINITY)
                })
                .collect();
            for k in 1..=20 {
                let t = 0.2 * f64::from(k);
                let p = (-depth(&m, &span.until(t))[0]).exp();
                let q = flights.iter().filter(|&&f| f > t).count() as f64 / n as f64;
                let error = (p * (1.0 - p) / n as f64).sqrt().max(2.0 / n as f64);
                assert!((p - q).abs() < 5.5 * error, "scale {scale}, y {y}, t {t}: {q} vs {p}");
            }
        }
    }
}
