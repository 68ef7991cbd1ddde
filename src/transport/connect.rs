//! Connections to lights (next-event estimation), and how they share the work with the other techniques.
//!
//! Techniques that can make the same light path: (direction) a phase- or BSDF-sampled direction that meets the light,
//! against a direction drawn from the light; (distance) a collision of the free flight, against an equi-angular point on
//! the same span. Balance-heuristic weights of geometric densities [T] (61); homogeneous transmittance counts as the
//! survival probability of a sampled direction.

use super::aim::{Aim, Turn};
use super::record::{Drawn, End, Event, MediumSpan, Recorder};
use super::state::{Flight, State};
use super::transmit;
use super::vertex::{Facing, Vertex};
use super::walk::Walker;
use super::{beside, light_centred};
use crate::light::Arrival;
use crate::math::equiangular::EquiAngular;
use crate::math::{DVec3, Rgb};
use crate::phase::one_minus_cos;
use crate::scene::{On, Scene};

/// Mean survival of a sampled direction over an optical depth.
pub(super) fn survival(tau: Rgb) -> f64 {
    if tau.is_zero() { 1.0 } else { tau.map(|t| (-t).exp()).mean() }
}

/// Weight of a direction drawn with density `p_direction` that crossed `tau` and met a light whose own
/// density for it is `p_light` (both per solid angle).
pub fn direction_share(p_direction: f64, tau: Rgb, p_light: f64) -> f64 {
    let d = p_direction * survival(tau);
    // Both may underflow after a huge depth: then the walk should not have arrived, and all weight is its own.
    if d + p_light > 0.0 { d / (d + p_light) } else { 1.0 }
}

/// Equi-angular sampling of a span by a light.
pub(super) fn angles(light: DVec3, span: &MediumSpan) -> EquiAngular {
    EquiAngular::new(light, span.o, span.w, span.t0, span.t1)
}

/// Density of all techniques that draw the vertex `p` at the end of a flight and connect it to light `id`, over that of the flight alone.
pub(super) fn flight_ratio(scene: &Scene, id: u32, flight: &Flight, p: DVec3) -> f64 {
    let (Some(span), Some(pole)) = (flight.span.as_ref().filter(|_| scene.weighs_flights()), scene.pole(id)) else {
        return 1.0;
    };
    let equiangular = angles(pole, span);
    if !equiangular.usable() {
        return 1.0;
    }
    let t = (p - span.o).dot(span.w);
    let own = scene.selection(id) * flight.density;
    let equi = scene.local_selection(id) * equiangular.density(t);
    let centred = light_centred::density_per_length(scene, id, pole, span.o + span.w * t, flight.reach);
    if own > 0.0 { (own + equi + centred) / own } else { f64::INFINITY }
}

/// What a connection to a light counts of its motion: on a drawn direction maybe not all ([`super::twin`]).
fn share(s: &State, light: u32, reach: Option<(DVec3, f64)>) -> f64 {
    s.twin.filter(|t| reach.is_some() && t.0 == light).map_or(1.0, |t| t.1)
}

/// Next-event estimation from a collision in medium `id` at `s.o`.
pub fn from_medium<R: Recorder>(w: &mut Walker<R>, s: &mut State, id: u32) {
    if w.scene.shelters_from_all(id) {
        s.to_environment = 0.0;
        return;
    }
    let phase = &w.scene.media[id as usize].phase;
    let toward = |d: DVec3| phase.eval(one_minus_cos(s.w, d));
    let Some((light, probability, environment)) = w.scene.select_light(s.rng.uniform(), toward) else { return };
    s.to_environment = environment;
    if w.scene.shelters_from(id, light) {
        return;
    }
    let (u, v) = (s.rng.uniform(), s.rng.uniform());
    let Some(a) = w.scene.arrival(light, s.o, u, v) else { return };
    let m = one_minus_cos(s.w, a.w);
    let f = phase.eval(m);
    let ratio = flight_ratio(w.scene, light, &s.flight, s.o);
    let weight = s.beta / s.r.mean() * (f * a.factor / probability);
    let share = share(s, light, s.flight.reach);
    let aim = beside::follows(w, light, s.left, s.o, s.flight.reach.map(|r| r.0))
        .then(|| Aim { share, ..Aim::new(light, s.o, Some(id), On::default(), &a, Turn::Phase(id, s.w), s.aside) });
    let end = End::of(light, s.o, &a);
    let p_direction = w.scene.critical.density(s.o, s.drawn, a.w, f);
    finish(w, s, &a, end, (&On::default(), s.medium), weight, probability, p_direction, ratio, Some((id, m)), aim);
}

/// Next-event estimation from a surface at `s.o`, reflectance already in `s.beta`.
pub fn from_surface<R: Recorder>(w: &mut Walker<R>, s: &mut State, facing: &Facing) {
    let (scene, vertex) = (w.scene, Vertex::Surface(*facing));
    let toward = |d: DVec3| {
        let lobe = facing.lobe(scene, d);
        lobe.f * lobe.tint.mean()
    };
    let Some((light, probability, environment)) = w.scene.select_light(s.rng.uniform(), toward) else { return };
    s.to_environment = environment;
    let (u, v) = (s.rng.uniform(), s.rng.uniform());
    let Some(a) = w.scene.arrival(light, s.o, u, v) else { return };
    let lobe = facing.lobe(scene, a.w);
    if lobe.f <= 0.0 {
        return;
    }
    let weight = s.beta / s.r.mean() * lobe.tint * (lobe.f * a.factor / probability);
    let (on, medium) = vertex.start(s, a.w);
    let aim = beside::follows(w, light, s.left, s.o, None)
        .then(|| Aim::new(light, s.o, medium, on, &a, facing.turn(), s.aside));
    let end = End::of(light, s.o, &a);
    if let Some(value) = finish(w, s, &a, end, (&on, medium), weight, probability, lobe.pdf, 1.0, None, aim) {
        vertex.scored(w.rec, a.w, value);
    }
}

/// The extra connection of a medium span: a point drawn by the angle it subtends at a light with a position,
/// bounded where free flight diverges like 1/r^2 [T] 5.5. `prefix` is the weight at the span's start; `flight_density`
/// the competing density per length; `first` the first recorded span of the connection.
pub fn equiangular<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    span: MediumSpan,
    prefix: Rgb,
    depth: u32,
    first: u32,
    flight_density: impl Fn(&Scene, f64) -> f64,
    reach: Option<(DVec3, f64)>,
) {
    let scene = w.scene;
    let rng = &mut s.rng;
    let Some((light, q)) = scene.select_local_light(rng.uniform()) else { return };
    let (u, v, x) = (rng.uniform(), rng.uniform(), rng.uniform());
    let Some(center) = scene.pole(light) else { return };
    let point = scene.lights[light as usize].center().is_some();
    let equiangular = angles(center, &span);
    if !equiangular.usable() {
        // The light stands on the ray: the picture diverges there, and says so.
        w.tally.light_on_ray += u64::from(point && depth == 0 && equiangular.h() == 0.0);
        return;
    }
    let t = equiangular.sample(u);
    let p = span.o + span.w * t;
    let Some(a) = scene.arrival(light, p, v, x) else { return };
    let medium = &scene.media[span.medium as usize];
    let (_, sigma_s) = medium.coefficients(p);
    if sigma_s.is_zero() && !R::ON {
        return;
    }
    let equi = q * equiangular.density(t);
    let flight_density = flight_density(scene, t);
    let flight = scene.selection(light) * flight_density;
    let centred = light_centred::density_per_length(scene, light, center, p, reach);
    let part = span.until(t);
    if R::ON {
        w.rec.side_span(part);
    }
    let via = Drawn { medium: span.medium, p, sigma: sigma_s, span, lead: w.rec.side_len() - first };
    let m = one_minus_cos(span.w, a.w);
    let f = medium.phase.eval(m);
    let Some(clear) = transmit::shadow(w, Some(span.medium), p, &On::default(), &a, Some(&s.rng)) else { return };
    let transmittance = transmit::one_span(scene, &part);
    // A direction drawn at the end of the flight may meet a lamp as well.
    let by_direction = if a.pdf > 0.0 {
        flight_density * scene.critical.density(p, s.drawn, a.w, f) * survival(clear.depth) / a.pdf
    } else {
        0.0
    };
    let weight =
        prefix * transmittance * clear.transmittance * (f * a.factor / (equi + flight + centred + by_direction));
    let (share, turn) = (share(s, light, reach), Turn::Phase(span.medium, span.w));
    let aim = beside::follows(w, light, s.left, p, reach.map(|r| r.0)).then(|| Aim {
        share,
        within: clear.within,
        ..Aim::new(light, p, Some(span.medium), On::default(), &a, turn, s.aside)
    });
    let end = End::of(light, p, &a);
    score(w, &a, end, weight, depth + 1, first, [Some((span.medium, m)), None], Some(via), aim);
}

/// Weight against direction sampling (and, by `ratio`, against other ways to the vertex), trace the shadow ray, score.
fn finish<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    a: &Arrival,
    end: End,
    (on, medium): (&On, Option<u32>),
    weight: Rgb,
    probability: f64,
    p_direction: f64,
    ratio: f64,
    phase: Option<(u32, f64)>,
    aim: Option<Aim>,
) -> Option<Rgb> {
    let first = w.rec.side_len();
    let clear = transmit::shadow(w, medium, s.o, on, a, Some(&s.rng))?;
    let mut weight = weight * clear.transmittance;
    weight *= if a.pdf > 0.0 {
        // What `direction_share` leaves over.
        let light = probability * a.pdf;
        light / (light * ratio + p_direction * survival(clear.depth))
    } else {
        1.0 / ratio
    };
    let aim = aim.map(|aim| Aim { within: clear.within, ..aim });
    score(w, a, end, weight, s.depth, first, [phase, None], None, aim)
}

/// `order`: scatterings of the path. Returns what it adds.
pub(super) fn score<R: Recorder>(
    w: &mut Walker<R>,
    a: &Arrival,
    end: End,
    weight: Rgb,
    order: u32,
    first_span: u32,
    phase: [Option<(u32, f64)>; 2],
    via: Option<Drawn>,
    aim: Option<Aim>,
) -> Option<Rgb> {
    if order < w.set.min_order {
        return None;
    }
    let sigma_s = via.map_or(Rgb::ONE, |d| d.sigma);
    let value = weight * sigma_s * a.emission.color();
    w.value += value;
    w.rec.score(order, value);
    if R::ON {
        let spans = w.rec.side_len() - first_span;
        let via = via.map(|d| w.rec.drawn(d));
        w.rec.push(Event::Connect { weight, emission: a.emission, end, first_span, spans, phase, via });
        if let Some(aim) = aim {
            w.rec.push(Event::Aim { aim, value });
        }
    }
    Some(value)
}
