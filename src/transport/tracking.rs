//! Distances in one medium: free flight and its weights.
//!
//! Homogeneous: exponential steps of the hero channel. Grids: delta tracking against the majorant of each brick, with
//! the largest channel as majorant and per-channel weights [T] 8.1, 8.4. The weights of gray media are exactly 1 and
//! the albedo: nothing is divided.

use super::record::MediumSpan;
use super::walk::State;
use crate::math::Rgb;
use crate::math::rng::Rng;
use crate::medium::{Medium, Volume};

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
            let h = s.hero;
            for brick in grid.spans(span.o, span.w, span.t0, span.t1) {
                let majorant = brick.max * m.scale;
                if majorant <= 0.0 {
                    continue;
                }
                let mut t = brick.t0;
                loop {
                    t += s.rng.exponential() / majorant;
                    if t >= brick.t1 {
                        break;
                    }
                    let p = span.o + span.w * t;
                    let sigma_t = m.density.at(p) * m.scale;
                    if s.rng.uniform() * majorant < sigma_t[h] {
                        let albedo = m.albedo.at(p);
                        if m.gray {
                            s.beta *= albedo;
                        } else {
                            for c in 0..3 {
                                s.beta[c] *= sigma_t[c] * albedo[c] / sigma_t[h];
                                s.r[c] *= sigma_t[c] / sigma_t[h];
                            }
                        }
                        return Some(t);
                    }
                    if !m.gray {
                        // The null event was drawn, so majorant > sigma_t[h] here.
                        for c in 0..3 {
                            let w = (majorant - sigma_t[c]) / (majorant - sigma_t[h]);
                            s.beta[c] *= w;
                            s.r[c] *= w;
                        }
                    }
                }
            }
            None
        }
    }
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
    let tr = depth(m, &MediumSpan { t1: t, ..*span }).map(|d| (-d).exp());
    beta * tr * (1.0 / (r * tr).mean())
}

/// Optical depth of a span per channel, exact.
pub fn depth(m: &Medium, span: &MediumSpan) -> Rgb {
    match &m.density {
        Volume::Constant(_) => m.sigma_t.map(|s| if s == 0.0 { 0.0 } else { s * (span.t1 - span.t0) }),
        Volume::Grid(_) => m.density_integral(span.o, span.w, span.t0, span.t1) * m.scale,
    }
}

/// A collision forced inside a line of spans.
pub struct Forced {
    pub piece: usize,
    pub t: f64,
    pub hero: usize,
}

/// Invert the truncated exponential of the hero's optical depth over `(medium, span, depth before, depth inside)`
/// ([T] section 9); gray grids only.
pub fn force<'a>(
    pieces: impl Iterator<Item = (&'a Medium, &'a MediumSpan, Rgb, Rgb)>,
    total: Rgb,
    rng: &mut Rng,
) -> Forced {
    // Channels with nothing to collide with are never the hero.
    let hero = if total.is_gray() {
        0
    } else {
        let lit: Vec<usize> = (0..3).filter(|&c| total[c] > 0.0).collect();
        lit[((rng.uniform() * lit.len() as f64) as usize).min(lit.len() - 1)]
    };
    let u = rng.uniform();
    // For a tiny depth the quotient is uniform; ln_1p keeps the digits.
    let target = (-(u * -(-total[hero]).exp_m1()).min(1.0 - f64::EPSILON / 2.0)).ln_1p().abs();
    let mut last = Forced { piece: 0, t: 0.0, hero };
    for (k, (m, span, before, depth)) in pieces.enumerate() {
        if depth[hero] <= 0.0 {
            continue;
        }
        let local = (target - before[hero]).max(0.0);
        let inside = local < depth[hero];
        let t = match &m.density {
            Volume::Constant(_) => (span.t0 + local / m.sigma_t[hero]).min(span.t1),
            Volume::Grid(g) => g.invert(span.o, span.w, span.t0, span.t1, local / m.scale).unwrap_or(span.t1),
        };
        last = Forced { piece: k, t, hero };
        if inside {
            break;
        }
    }
    last
}

/// A point of the span with density proportional (homogeneous) or related (grids) to transmittance, and its weight per channel:
/// `E[weight g(t)] = integral of T g` [T] (53). `None` where the span is an unbounded vacuum.
pub fn transmittance_point(m: &Medium, span: &MediumSpan, depth: Rgb, rng: &mut Rng) -> Option<(f64, Rgb)> {
    let (c, u) = (((rng.uniform() * 3.0) as usize).min(2), rng.uniform());
    let length = span.t1 - span.t0;
    match &m.density {
        Volume::Constant(_) => {
            let sigma = m.sigma_t;
            if length == f64::INFINITY && sigma.min() <= 0.0 {
                return None;
            }
            // t = -log1p(-u (1 - e^{-sigma D})) / sigma, uniform where sigma D is tiny.
            let t = if depth[c] < 1e-8 { u * length } else { -(-(u * -(-depth[c]).exp_m1())).ln_1p() / sigma[c] };
            let density = Rgb::from_fn(|k| {
                let total = if depth[k] < 1e-8 { length } else { -(-depth[k]).exp_m1() / sigma[k] };
                (-sigma[k] * t).exp() / total
            })
            .mean();
            Some((span.t0 + t, sigma.map(|x| (-x * t).exp()) * (1.0 / density)))
        }
        Volume::Grid(g) => {
            // The walked part of an analog flight, a uniform point on it.
            let (lo, hi) = g.clip_ray(span.o, span.w, span.t0, span.t1);
            if hi <= lo {
                return None;
            }
            let end = g.invert(span.o, span.w, lo, hi, rng.exponential() / m.scale).unwrap_or(hi);
            Some((lo + u * (end - lo), Rgb::splat(end - lo)))
        }
    }
}
