//! The camera line: everything between the camera and the first opaque surface, of which the depth is known exactly.
//!
//! `L = T L_end + integral of T sigma_s L_ins` [T] (1) is split into its two parts: the unscattered part keeps the exact
//! transmittance, the scattered part is a collision forced inside the line (density `sigma_t T / (1 - T_end)`, truncated
//! exponential, [T] section 9). Thin media then lose no sample, and a white furnace is exact. Where the line ends on a
//! reflecting surface one of the two parts is followed, chosen with a probability near its transmittance; both are where that is smooth, one of the first two, and an environment behind it.
//!
//! Through fine grids the depth is one of bounds, G ([`Line::push_bounds`]): `e^-G` of the light passes for certain, and for the rest the first *tentative* collision is forced; the flight
//! goes on from there to a collision, or past all of the line after all. Both have the density of a flight, so nothing is weighed, and a white furnace is still exact.

use super::line::{Forced, Line, Part};
use super::poles::Poles;
use super::record::{Event, MediumSpan, Recorder};
use super::state::{Flight, Stage, State};
use super::walk::Walker;
use super::{beam, connect, glow};
use crate::math::Rgb;
use crate::medium::Volume;
use crate::scene::{Hit, March, On, Scene};

/// Start a camera path, or go on with its line behind an interface: score the extra connections and candidates of the line, and leave the state to walk on from
/// (with the unscattered part pending where both are followed).
pub fn start<R: Recorder>(w: &mut Walker<R>, s: &mut State) {
    let scene = w.scene;
    // Of this line only, not of those behind interfaces.
    let poles = s.poles.take().filter(|_| R::ON);
    let mut ray = March::new(s.o, s.w, s.on, s.medium);
    if w.is_lost(s.depth, s.medium) {
        s.stage = Stage::Done;
        return;
    }
    let scatters = w.may_scatter(s.depth + 1);
    let bounds = scatters && scene.flies_lines() && poles.as_ref().is_none_or(|p| p.drawn.is_none());
    let mut line = Line::default();
    let mut crossings = 0;
    let end = loop {
        crossings += 1;
        let hit = ray.meets(scene, f64::INFINITY);
        if let Some(span) = MediumSpan::ahead(&ray, f64::INFINITY, hit.as_ref()) {
            if matches!(&scene.media[span.medium as usize].density, Volume::Grid(g) if g.channels() == 3) {
                // No inverse for three extinctions at once: walk instead.
                (s.stage, s.direct) = (Stage::Fly, false);
                return;
            }
            if bounds { line.push_bounds(scene, span) } else { line.push(scene, span) }
        }
        let Some(h) = hit else { break None };
        let goes_on = scene.passes(&h) && scene.shapes[h.shape as usize].light.is_none();
        if crossings > scene.max_interfaces {
            // Counted; the walk goes on from here and is bounded by its own cap.
            w.tally.missed_boundary += 1;
            break Some(h);
        }
        if !goes_on {
            break Some(h);
        }
        ray.pass(scene, &h);
    };
    if line.bounded && line.chromatic {
        line = line.crossed(scene);
    }
    (s.o, s.on, s.medium) = (ray.o, ray.on, ray.medium);
    let Line { parts: pieces, total, .. } = &line;
    let total = *total;
    let prefix = s.beta;
    if pieces.is_empty() {
        return unscattered(s, end, prefix);
    }
    let transmitted = total.map(|t| (-t).exp());
    for k in 0..pieces.len() {
        glow::on_line(w, s, &pieces[..=k], prefix, chain);
    }
    if w.rec.wants_ends() {
        for (k, p) in pieces.iter().enumerate() {
            let [start, end] = [k, k + 1].map(|k| prefix * line.exact_before(scene, k).map(|t| (-t).exp()));
            w.rec.push(Event::Ends { span: p.span, start, end, depth: s.depth });
        }
    }
    let share = scatter_probability(w, pieces, &end, transmitted, scatters, s.in_a_row);
    if scatters {
        for k in 0..pieces.len() {
            side_estimates(w, s, &line, k, prefix, share);
        }
    }

    // Follow both parts, or one of them.
    let scattered = scatters && share.scatter > 0.0 && (share.both || s.rng.uniform() < share.scatter);
    if scattered && share.both && !transmitted.is_zero() {
        let mut passing = s.branch();
        unscattered(&mut passing, end, prefix * transmitted);
        record_passing(w, &mut passing, pieces, true);
        s.pending = Some(passing);
    }
    if scattered {
        if line.bounded {
            force_flight(w, s, &line, share.scatter, end, poles.as_deref());
        } else {
            force_collision(w, s, &line, share.scatter, poles.as_deref());
        }
    } else if transmitted.is_zero() {
        s.stage = Stage::Done;
    } else {
        unscattered(s, end, prefix * transmitted * (1.0 / (1.0 - share.scatter)));
        record_passing(w, s, pieces, false);
    }
}

#[derive(Clone, Copy)]
struct Share {
    scatter: f64,
    /// Then `scatter` is 1.
    both: bool,
}

/// Whether both parts are followed, and otherwise how often the scattered one.
fn scatter_probability<R: Recorder>(
    w: &Walker<R>,
    pieces: &[Part],
    end: &Option<Hit>,
    transmitted: Rgb,
    scatters: bool,
    in_a_row: u32,
) -> Share {
    let scene = w.scene;
    let any = pieces.iter().any(|p| !scene.media[p.span.medium as usize].sigma_s.is_zero() && !p.depth.is_zero());
    if !scatters || !any {
        return Share { scatter: 0.0, both: false };
    }
    // What comes straight through one or two smooth faces mostly sees the environment, for little; a choice would be all of its variance.
    let sees = |h: &Hit| in_a_row <= 1 && scene.environment.is_some() && scene.surface_of(h.shape).is_smooth();
    let reflects = end.as_ref().is_some_and(|h| scene.reflects(h) && !sees(h));
    if reflects {
        Share { scatter: 0.05 + 0.9 * (1.0 - transmitted.mean()), both: false }
    } else {
        Share { scatter: 1.0, both: true }
    }
}

/// The equi-angular connection and the candidate of a derivative vertex on part `k`.
fn side_estimates<R: Recorder>(w: &mut Walker<R>, s: &mut State, line: &Line, k: usize, prefix: Rgb, share: Share) {
    let connects = R::CONNECTS && w.scene.draws_on_spans();
    if !connects && w.rec.candidate_rng().is_none() {
        return;
    }
    let (piece, lead, collides) = (&line.parts[k], &line.parts[..k], line.collides());
    let before = line.exact_before(w.scene, k).map(|t| (-t).exp());
    if before.is_zero() {
        return;
    }
    if connects {
        chain(w, s);
        let density = |scene: &Scene, t: f64| piece.forced_density(scene, collides, t).mean() * share.scatter;
        if w.scene.has_local_lights() {
            let first = w.rec.side_len();
            if R::ON {
                lead.iter().for_each(|q| w.rec.side_span(q.span));
            }
            connect::equiangular(w, s, piece.span, prefix * before, s.depth, first, density, None);
        }
        beam::on_span(w, s, &piece.span, prefix * before, Some(lead), density, None);
    }
    if let Some(rng) = w.rec.candidate_rng() {
        if let Some((t, weight)) = piece.transmittance_point(w.scene, [piece.span.t0, piece.span.t1], rng) {
            let p = piece.span.o + piece.span.w * t;
            let weight = prefix * before * weight;
            // Only competing connections ask for it.
            let weighs = w.scene.weighs_flights();
            let density = if weighs { piece.forced_density(w.scene, collides, t).mean() * share.scatter } else { 0.0 };
            let flight = Flight { span: Some(piece.span), density, reach: None, drawn: s.drawn };
            let (medium, depth) = (piece.span.medium, s.depth);
            w.rec.push(Event::Candidate { medium, p, w: piece.span.w, weight, flight, depth });
        } else if piece.span.t1 == f64::INFINITY {
            w.rec.unbounded(piece.span.medium);
        }
    }
}

/// A collision inside the line.
fn force_collision<R: Recorder>(w: &mut Walker<R>, s: &mut State, line: &Line, p: f64, poles: Option<&Poles>) {
    let scene = w.scene;
    let (pieces, total, collides) = (&line.parts, line.total, line.collides());
    let Some(Forced { piece: k, t, hero, .. }) = collision(scene, s, line, poles) else {
        s.stage = Stage::Done;
        return;
    };
    let share = poles.map(|poles| poles.share(scene, line, k, t));
    let piece = &pieces[k];
    let m = &scene.media[piece.span.medium as usize];
    let point = piece.span.o + piece.span.w * t;
    let (gray, before) = (!line.chromatic, s.beta.max());
    // Only competing connections and chromatic weights ask for it.
    let density = if gray && !scene.weighs_flights() { Rgb::ZERO } else { piece.forced_density(scene, collides, t) };
    if gray {
        s.beta *= m.albedo_at(point) * (collides[0] / p);
    } else {
        let depth = piece.depth_to(scene, t);
        let (_, sigma_s) = m.coefficients(point);
        let d = density[hero];
        // The hero is one of the channels that collide at all; `beta / mean(r)` takes it for one of three.
        let lit = (0..3).filter(|&c| total[c] > 0.0).count() as f64 / 3.0;
        s.beta = Rgb::from_fn(|c| s.beta[c] * (-depth[c]).exp() * sigma_s[c] * lit / (d * p));
        s.r = Rgb::from_fn(|c| s.r[c] * density[c] / d);
    }
    s.hero = hero;
    s.start = before * collides.max() / p;
    s.flight = Flight { span: Some(piece.span), density: density.mean() * p, reach: None, drawn: s.drawn };
    collide(w, s, line, k, t, share);
}

/// The first tentative collision inside a line of bounds, and the flight from there on.
fn force_flight<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    line: &Line,
    p: f64,
    end: Option<Hit>,
    poles: Option<&Poles>,
) {
    let scene = w.scene;
    let mut apart = s.rng.apart();
    let tentative = line.force(scene, &mut s.rng);
    s.beta *= line.collides()[0] / p;
    s.start = s.beta.max();
    let Some((k, t)) = line.fly_on(scene, &tentative, &mut apart, s) else {
        let beta = s.beta;
        unscattered(s, end, beta);
        return record_passing(w, s, &line.parts, false);
    };
    let share = poles.map(|poles| poles.share(scene, line.exact(scene), k, t));
    s.flight = Flight { span: Some(line.parts[k].span), density: 0.0, reach: None, drawn: s.drawn };
    collide(w, s, line, k, t, share);
}

/// The line's collision, at `t` of part `k`. `share`: [`Poles::share`].
fn collide<R: Recorder>(w: &mut Walker<R>, s: &mut State, line: &Line, k: usize, t: f64, share: Option<f64>) {
    chain(w, s);
    if let Some(share) = share {
        w.rec.push(Event::Share(share));
    }
    let (piece, before) = (&line.parts[k], &line.parts[..k]);
    if R::ON {
        for q in before {
            w.rec.push(Event::Span { span: q.span, prefix: None });
        }
        w.rec.push(Event::Span { span: piece.span.until(t), prefix: None });
    }
    s.medium = Some(piece.span.medium);
    s.o = piece.span.o + piece.span.w * t;
    s.on = On::default();
    s.stage = Stage::Medium;
}

/// Where it is: drawn by the line itself, or around a pole.
fn collision(scene: &Scene, s: &mut State, line: &Line, poles: Option<&Poles>) -> Option<Forced> {
    let Some(place) = poles.and_then(|p| p.draw(line, &mut s.rng)) else { return Some(line.force(scene, &mut s.rng)) };
    let (piece, t) = place?;
    // The channel that leads only sets the scale of weights here; the largest has no gap where another collides.
    let density = line.density(scene, piece, t);
    let hero = if line.chromatic { (1..3).fold(0, |a, c| if density[c] > density[a] { c } else { a }) } else { 0 };
    (density[hero] > 0.0).then_some(Forced { piece, t, hero, bound: None })
}

/// A new chain begins, with what the camera line has crossed so far.
pub(super) fn chain<R: Recorder>(w: &mut Walker<R>, s: &State) {
    w.rec.push(Event::Chain);
    s.lead.each(|e| w.rec.push(*e));
}

/// The state behind the line with nothing scattered on it.
fn unscattered(s: &mut State, end: Option<Hit>, beta: Rgb) {
    s.beta = beta;
    s.start = beta.max();
    s.stage = match end {
        Some(h) => Stage::Surface(h),
        None => Stage::Escape,
    };
}

/// Remember which spans the unscattered part crossed, so that the sweep can score them.
fn record_passing<R: Recorder>(w: &mut Walker<R>, s: &mut State, pieces: &[Part], pending: bool) {
    if R::ON {
        pieces.iter().for_each(|p| s.lead.push(Event::Span { span: p.span, prefix: None }));
        if !pending {
            chain(w, s);
        }
    }
}
