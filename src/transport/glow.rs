//! Light that media emit, `∫ T σ_a L_e dt` ([T] (2), 7) along every line that a walk takes, by up to three techniques at once.
//!
//! A walk that has left the vertex x gets to a point y by
//!
//! * *colliding* there: density `σ_t(y) T` per length;
//! * *passing* it: a uniform point of the walked part, of length l, weighs l, and `P(walked past y) = T`. What stands for its density is `κ T`, κ
//!   one over the medium's extent ([`Medium::kappa`], as for derivative vertices).
//!
//! The balance heuristic gives both the same weight, `T / (σ_t T + κ T)`, times κ l for the second: thick media get the small variance of collisions, thin ones the
//! boundedness of track lengths, and nothing is divided by σ_t. No rule has to choose, scene by scene.
//!
//! * *Connecting*: a point y drawn where media glow, density q(x, y) per volume, seen from x; [`crate::scene::bright`] says where that can help.
//!
//! Per volume the first two have the density `D(y) = p_ω (σ_t(y) + κ) S / r²` (p_ω: that of the direction at x; r = ‖y-x‖; S: transmittance of homogeneous media
//! between x and y, a stand-in for T). So walks get the share `D / (D + q)` of y's light and connections the rest: functions of x and y alone, whatever
//! tracking did, so that they sum to one at every y. For r -> 0 D grows without bound and the connection's `f T σ_a L_e / r² / (D + q)` (f: phase function or BSDF and cosine)
//! stays below `(f/p_ω) (T/S) σ_a L_e / (σ_t + κ)`: no pole is left, and its second moment is finite where that of walks is. Behind smooth interfaces
//! nothing is connected (p_ω = 0) and walks get all.
//!
//! Points, weights and densities are constants to derivatives ([T] section 4): what is recorded is differentiated as `weight T σ_a L_e` and the scattering at x at fixed points, or
//! at points that move with the matter around them, by one velocity whatever technique drew them ([T] (61)).

use super::connect::survival;
use super::light_centred::Sight;
use super::line::Part;
use super::record::{Drawn, Event, MediumSpan, Recorder};
use super::state::State;
use super::tracking;
use super::vertex::Vertex;
use super::walk::Walker;
use crate::math::{DVec3, Rgb};
use crate::medium::{Medium, Volume};
use crate::scene::Scene;
use smallvec::{SmallVec, smallvec};

/// Stand-in for the density per length of collisions and track lengths together over the transmittance.
fn walked_density(m: &Medium, p: DVec3) -> f64 {
    m.coefficients(p).0.mean() + m.kappa
}

/// The share of walks in the light of `p` in a medium, after the optical depth `tau` of homogeneous spans: `D / (D + q)`.
fn walked_share(scene: &Scene, medium: u32, p: DVec3, s: &State, tau: Rgb) -> f64 {
    let q = scene.bright.density(medium, s.vertex, p);
    if q <= 0.0 || s.pdf_direction <= 0.0 {
        return 1.0;
    }
    let own = s.pdf_direction * walked_density(&scene.media[medium as usize], p) * survival(tau);
    let other = q * (p - s.vertex).length_squared();
    // Both may underflow after a huge depth.
    if own + other > 0.0 { own / (own + other) } else { 1.0 }
}

/// What a walk along `span` has met by `t`, where it collided if `collides`; `beta` and `r` are those of the span's start.
pub(super) fn walked<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    span: &MediumSpan,
    t: f64,
    collides: bool,
    beta: Rgb,
    r: Rgb,
) {
    let m = &w.scene.media[span.medium as usize];
    let (lo, hi) = m.glow_range(span.o, span.w, span.t0, t);
    let past = (hi > lo && hi < f64::INFINITY).then(|| lo + s.rng.uniform() * (hi - lo));
    let points = [past.map(|u| (u, m.kappa * (hi - lo))), collides.then_some((t, 1.0))];
    for (u, factor) in points.into_iter().flatten() {
        let p = span.o + span.w * u;
        let tau = if m.is_homogeneous() { s.tau + m.sigma_t * u } else { s.tau };
        let share = walked_share(w.scene, span.medium, p, s, tau) * factor;
        let weight = tracking::point_weight(m, span, u, beta, r, past.map_or(0.0, |_| m.kappa)) * share;
        emit(w, &[], *span, u, weight, s.depth, None);
    }
}

/// Channels that share an extinction, each set with 1 for its channels.
fn alike(sigma: Rgb) -> SmallVec<[Rgb; 3]> {
    if sigma.is_gray() { smallvec![Rgb::ONE] } else { (0..3).map(|c| Rgb::channel(c, 1.0)).collect() }
}

/// `∫ e^(-σt) dt` from 0 to the length, and the mean of t by that weight.
fn even_glow(sigma: f64, length: f64) -> [f64; 2] {
    let d = sigma * length;
    if d < 1e-4 {
        // 1/2 - d/12 and 1 - d/2 + d²/6, to d³.
        return [length * (1.0 - 0.5 * d + d * d / 6.0), length * (0.5 - d / 12.0)];
    }
    let past = if d < f64::INFINITY { d / d.exp_m1() } else { 0.0 };
    [-(-d).exp_m1() / sigma, (1.0 - past) / sigma]
}

/// Emission of the last of `parts` of a camera line: by a forced collision and by a track length. In a homogeneous medium that glows evenly all of it is known, `L_e σ_a ∫ T dt`, channel by channel:
/// nothing has any variance, and if no vertex moves its derivatives have none, as all scores of a point at t are linear in t, so that the mean t gives their mean. `chain`: begins a chain of the record.
pub(super) fn on_line<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    parts: &[Part],
    prefix: Rgb,
    chain: impl Fn(&mut Walker<R>, &State),
) {
    let Some((part, lead)) = parts.split_last() else { return };
    let span = part.span;
    let m = &w.scene.media[span.medium as usize];
    let (lo, hi) = m.glow_range(span.o, span.w, span.t0, span.t1);
    if hi <= lo {
        return;
    }
    let before = part.depth_within(w.scene, lo);
    let depth = part.depth_within(w.scene, hi) - before;
    let prefix = prefix * (part.before + before).map(|t| (-t).exp());
    let mut points = [None; 2];
    match &m.density {
        Volume::Constant(_) if m.emission.as_ref().is_some_and(|e| matches!(e.volume, Volume::Constant(_))) => {
            for one in alike(m.sigma_t) {
                let (sigma, u) = (m.sigma_t.dot(one) / one.sum(), s.rng.uniform());
                if sigma <= 0.0 && hi == f64::INFINITY {
                    continue;
                }
                let [total, mean] = even_glow(sigma, hi - lo);
                let t = if w.rec.is_still() { mean } else { tracking::truncated(u, sigma * (hi - lo)) / sigma };
                let t = if t.is_finite() { t } else { u * (hi - lo) };
                chain(w, s);
                emit(w, &lead_of::<R>(lead), span, lo + t.min(hi - lo), prefix * one * total, s.depth, None);
            }
        }
        Volume::Constant(_) => points[0] = part.transmittance_point(w.scene, [lo, hi], &mut s.rng),
        Volume::Grid(_) => {
            let kept = -(-depth[0]).exp_m1();
            let density = |t: f64| m.coefficients(span.o + span.w * t).0[0];
            // Over T: σ_t / (1 - T(hi)) of the collision, κ of the track length.
            let weight = |t: f64| if kept > 0.0 { 1.0 / (density(t) / kept + m.kappa) } else { 1.0 / m.kappa };
            if let Some((t, length)) = part.transmittance_point(w.scene, [lo, hi], &mut s.rng) {
                points[0] = Some((t, length * (m.kappa * weight(t))));
            }
            let u = s.rng.uniform();
            if kept > 0.0 {
                let t = part.at_depth(w.scene, 0, before[0] + tracking::truncated(u, depth[0])).clamp(lo, hi);
                points[1] = Some((t, Rgb::splat(weight(t))));
            }
        }
    }
    let lead = lead_of::<R>(lead);
    for (t, weight) in points.into_iter().flatten() {
        chain(w, s);
        emit(w, &lead, span, t, prefix * weight, s.depth, None);
    }
}

fn lead_of<R: Recorder>(parts: &[Part]) -> Vec<MediumSpan> {
    if R::ON { parts.iter().map(|q| q.span).collect() } else { Vec::new() }
}

/// Connect the vertex at `s.o` to a point where a medium glows.
pub(super) fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene = w.scene;
    let bright = &scene.bright;
    if !bright.any() {
        return;
    }
    let Some((medium, y)) = bright.sample(s.o, &mut s.rng) else { return };
    let first = w.rec.side_len();
    // Where another medium begins before it, y is not of the one it was drawn for.
    let Some(sight) = Sight::new(w, s, vertex, y).filter(|sight| sight.span.medium == medium) else {
        w.rec.side_truncate(first);
        return;
    };
    let own = sight.density * walked_density(&scene.media[medium as usize], y) * survival(sight.tau);
    let weight = s.beta / s.r.mean()
        * sight.tint
        * sight.transmittance
        * (sight.per_length / (own + bright.density(medium, s.o, y)));
    let value = emit(w, &[], sight.span, sight.t, weight, s.depth, Some((first, sight.phase)));
    if let Some(value) = value {
        vertex.scored(w.rec, sight.direction, value);
    }
}

/// Score the emission at abscissa `t` of a span with the weight of that point, after `order` scatterings. `lead`: the spans before that one;
/// or `connection`: the first of the spans that have been recorded, this one's part the last of them, and the phase function at the vertex. Returns what it adds.
fn emit<R: Recorder>(
    w: &mut Walker<R>,
    lead: &[MediumSpan],
    span: MediumSpan,
    t: f64,
    weight: Rgb,
    order: u32,
    connection: Option<(u32, Option<(u32, f64)>)>,
) -> Option<Rgb> {
    if order < w.set.min_order || w.set.max_depth == 0 {
        return None;
    }
    let p = span.o + span.w * t;
    let (sigma_a, radiance) = w.scene.media[span.medium as usize].glow(p)?;
    let value = weight * sigma_a * radiance;
    w.value += value;
    w.rec.score(order, value);
    if R::ON {
        let (first_span, phase) = connection.unwrap_or_else(|| {
            let first = w.rec.side_len();
            lead.iter().for_each(|&l| w.rec.side_span(l));
            w.rec.side_span(span.until(t));
            (first, None)
        });
        let spans = w.rec.side_len() - first_span;
        let via = Drawn { medium: span.medium, p, sigma: sigma_a, span, lead: spans };
        let via = w.rec.drawn(via);
        w.rec.push(Event::Glow { weight, radiance, via, first_span, spans, phase });
    }
    Some(value)
}
