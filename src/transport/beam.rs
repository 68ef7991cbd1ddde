//! Connections to collimated beams, straight and by way of flat mirrors and interfaces ([T] (30), 6.2): at every vertex, each way of each beam that reaches it; in media, also at points of every
//! span that are drawn within the beam ([`crate::scene::beams::Tube`]), weighed against the free flight by the balance heuristic.

use super::line::Part;
use super::record::{Drawn, End, Event, MediumSpan, Recorder};
use super::state::{Flight, State};
use super::vertex::{Toward, Vertex};
use super::walk::Walker;
use super::{specular, transmit};
use crate::light::{Emission, LightKind, beam_profile};
use crate::math::{DVec3, Rgb};
use crate::phase::one_minus_cos;
use crate::scene::beams::Way;
use crate::scene::{Hit, March, On, Scene};

/// How near a line has to meet a curved face to where it should, over the radius of the scene.
const NEAR: f64 = 1e-6;

/// The emission that reaches `x` by the way, if its line is clear.
pub fn emission(scene: &Scene, way: &Way, x: DVec3, points: &mut Vec<DVec3>) -> Option<Emission> {
    let light = &scene.lights[way.light as usize];
    let LightKind::Beam { position, radius, gaussian, .. } = light.kind else { return None };
    let entry = way.trace(scene, x, points)?;
    let e = beam_profile((entry - position).length(), radius, gaussian);
    (e > 0.0).then(|| light.emission(way.gain * e))
}

/// Score what all beams bring to the vertex at `s.o`.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene = w.scene;
    let mut points = Vec::new();
    for (id, way) in scene.beams.ways.iter().enumerate() {
        if !may_take(w, way, s.depth) {
            continue;
        }
        let toward = -way.w;
        let Toward { lobe, phase } = vertex.toward(scene, s, toward);
        if lobe.f <= 0.0 {
            continue;
        }
        let (on, medium) = vertex.start(s, toward);
        let Some(emission) = emission(scene, way, s.o, &mut points) else { continue };
        let first = w.rec.side_len();
        let Some(t) = clear(scene, way, &points, (s.o, on, medium), &mut |span| {
            if R::ON {
                w.rec.side_span(span);
            }
        }) else {
            w.rec.side_truncate(first);
            continue;
        };
        let weight = s.beta / s.r.mean() * lobe.tint * t * (lobe.f * flight_share(scene, id, &s.flight, s.o));
        if let Some(value) = score(w, (id, weight, emission), s.depth, first, [phase, None], None) {
            vertex.scored(w.rec, toward, value);
        }
    }
}

/// Whether the way's interfaces still count behind so many scatterings.
pub(super) fn may_take<R: Recorder>(w: &Walker<R>, way: &Way, depth: u32) -> bool {
    way.steps.is_empty() || w.may_scatter(depth + way.steps.len() as u32)
}

/// What the free flight has of a connection by the way ([T] (61)): points are drawn in the beam, too.
fn flight_share(scene: &Scene, id: usize, flight: &Flight, p: DVec3) -> f64 {
    let Some(span) = &flight.span else { return 1.0 };
    let way = &scene.beams.ways[id];
    let tube = way.tube(scene, span.o, span.w, span.t0, span.t1);
    let drawn = tube.map_or(0.0, |tube| tube.density((p - span.o).dot(span.w)))
        + scene.columns.density_per_length(scene, id, p, flight.reach);
    if flight.density > 0.0 { flight.density / (flight.density + drawn) } else { 0.0 }
}

/// The extra connections of a medium span: a point of it within each beam, by each way. Free flights seldom end in narrow ones. `prefix` is the weight at the span's start, `lead` what a
/// camera line has crossed before it, `flight_density` the competing density per length, `reach` how the span's direction was drawn.
pub fn on_span<R: Recorder>(
    w: &mut Walker<R>,
    s: &mut State,
    span: &MediumSpan,
    prefix: Rgb,
    lead: Option<&[Part]>,
    flight_density: impl Fn(&Scene, f64) -> f64,
    reach: Option<(DVec3, f64)>,
) {
    let scene = w.scene;
    let medium = &scene.media[span.medium as usize];
    let mut points = Vec::new();
    for (id, way) in scene.beams.ways.iter().enumerate() {
        if !may_take(w, way, s.depth + 1) {
            continue;
        }
        let Some(tube) = way.tube(scene, span.o, span.w, span.t0, span.t1) else { continue };
        if tube.asked < 1.0 && s.rng.uniform() >= tube.asked {
            continue;
        }
        let t = tube.sample(s.rng.uniform());
        let p = span.o + span.w * t;
        let (_, sigma_s) = medium.coefficients(p);
        let m = one_minus_cos(span.w, -way.w);
        let f = medium.phase.eval(m);
        if f <= 0.0 || sigma_s.is_zero() && !R::ON {
            continue;
        }
        let Some(emission) = emission(scene, way, p, &mut points) else { continue };
        let first = w.rec.side_len();
        let part = span.until(t);
        if R::ON {
            lead.into_iter().flatten().for_each(|q| w.rec.side_span(q.span));
            w.rec.side_span(part);
        }
        let via = Drawn { medium: span.medium, p, sigma: sigma_s, span: *span, lead: w.rec.side_len() - first };
        let start = (p, On::default(), Some(span.medium));
        let Some(clear) = clear(scene, way, &points, start, &mut |span| {
            if R::ON {
                w.rec.side_span(span);
            }
        }) else {
            w.rec.side_truncate(first);
            continue;
        };
        let centred = scene.columns.density_per_length(scene, id, p, reach);
        let density = tube.density(t) + flight_density(scene, t) + centred;
        let weight = prefix * transmit::one_span(scene, &part) * clear * (f / density);
        score(w, (id, weight, emission), s.depth + 1, first, [Some((span.medium, m)), None], Some(via));
    }
}

/// `depth`: scatterings up to the vertex; the way's interfaces are more. Returns what it adds.
pub(super) fn score<R: Recorder>(
    w: &mut Walker<R>,
    (id, weight, emission): (usize, Rgb, Emission),
    depth: u32,
    first: u32,
    phase: [Option<(u32, f64)>; 2],
    via: Option<Drawn>,
) -> Option<Rgb> {
    let order = depth + w.scene.beams.ways[id].steps.len() as u32;
    if order < w.set.min_order {
        w.rec.side_truncate(first);
        return None;
    }
    let value = weight * via.map_or(Rgb::ONE, |d| d.sigma) * emission.color();
    w.value += value;
    w.rec.score(order, value);
    if R::ON {
        let (end, spans) = (End::Beam(id as u32), w.rec.side_len() - first);
        let via = via.map(|d| w.rec.drawn(d));
        w.rec.push(Event::Connect { weight, emission, end, first_span: first, spans, phase, via });
    }
    Some(value)
}

/// Transmittance of the way back from a point, whose faces and medium are given; `None` where something else stands on it.
pub fn clear(
    scene: &Scene,
    way: &Way,
    points: &[DVec3],
    (o, on, medium): (DVec3, On, Option<u32>),
    passed: &mut dyn FnMut(MediumSpan),
) -> Option<Rgb> {
    let light = &scene.lights[way.light as usize];
    let (mut t, mut ray) = (Rgb::ONE, March::new(o, -way.w, on, medium));
    // A line may meet what is curved twice.
    let meets = |h: &Hit, p: DVec3| {
        let curved = scene.shapes[h.shape as usize].shape.is_round();
        !curved || (h.p - p).length() <= NEAR * scene.bounds.radius()
    };
    for k in 0..=points.len() {
        let step = way.steps.len().checked_sub(k + 1).map(|i| &way.steps[i]);
        let length = match (step, &light.kind) {
            (Some(_), _) => f64::INFINITY,
            (None, LightKind::Beam { position, direction, .. }) => (ray.o - *position).dot(*direction),
            (None, _) => way.source.or(light.center()).map_or(f64::INFINITY, |q| (q - ray.o).length()),
        };
        // Up to the next step, or to the light, whatever that stands on.
        let end = loop {
            let left = ray.left(length);
            let limit = if step.is_none() { scene.short_of(ray.o, left) } else { left };
            let hit = ray.meets(scene, limit);
            let passes = hit.is_some_and(|h| scene.passes(&h));
            let wanted = match (step, &hit) {
                (Some(s), Some(h)) => passes || (s.shape, s.face) == (h.shape, h.face) && meets(h, points[k]),
                (step, hit) => passes || step.is_some() == hit.is_some(),
            };
            if !wanted {
                return None;
            }
            if let Some(span) = MediumSpan::ahead(&ray, left, hit.as_ref()) {
                t *= transmit::one_span(scene, &span);
                passed(span);
                if t.is_zero() {
                    return None;
                }
            }
            match hit {
                Some(h) if passes => ray.pass(scene, &h),
                end => break end,
            }
        };
        let (Some(step), Some(h)) = (step, end) else { return Some(t) };
        let on = specular::left(&ray.on, &h, ray.w, step.through, scene.tolerance(h.p));
        let behind = || scene.shapes[h.shape as usize].medium_behind(ray.w, h.n, ray.medium);
        ray = March::new(h.p, -step.before, on, if step.through { behind() } else { ray.medium });
    }
    None
}
