//! The beam-centred connection: the next vertex is drawn in a beam's column ([`crate::scene::columns`]) and connected to the vertex at hand and to the beam.
//!
//! Three techniques then make the same path, a free flight that ends in the beam, a point drawn on a span within it ([`super::beam::on_span`]), and this one; the balance heuristic of their geometric densities shares
//! the work out ([T] (61)).

use super::light_centred::Sight;
use super::record::{Drawn, Recorder};
use super::state::State;
use super::vertex::Vertex;
use super::walk::Walker;
use super::{beam, tracking};
use crate::phase::one_minus_cos;
use crate::scene::On;

/// Connect the vertex at `s.o` to a beam through a point drawn in its column.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene = w.scene;
    if scene.columns.is_empty() || !w.may_scatter(s.depth + 1) {
        return;
    }
    let numbers = [s.rng.uniform(), s.rng.uniform(), s.rng.uniform(), s.rng.uniform()];
    let Some((id, y)) = scene.columns.sample(scene, s.o, numbers) else { return };
    let way = &scene.beams.ways[id];
    if !beam::may_take(w, way, s.depth + 1) {
        return;
    }
    let mut points = Vec::new();
    let Some(emission) = beam::emission(scene, way, y, &mut points) else { return };
    let first = w.rec.side_len();
    let Some(sight) = Sight::new(w, s, vertex, y) else { return w.rec.side_truncate(first) };
    let lead = w.rec.side_len() - first;
    let Sight { span, t, per_length, density: p_direction, .. } = sight;
    let medium = &scene.media[span.medium as usize];
    let (_, sigma_s) = medium.coefficients(y);
    let m = one_minus_cos(sight.direction, -way.w);
    let f = medium.phase.eval(m);
    if f <= 0.0 || sigma_s.is_zero() && !R::ON {
        return w.rec.side_truncate(first);
    }
    let start = (y, On::default(), Some(span.medium));
    let Some(clear) = beam::clear(scene, way, &points, start, &mut |span| {
        if R::ON {
            w.rec.side_span(span);
        }
    }) else {
        return w.rec.side_truncate(first);
    };
    // Per volume.
    let on_span = way.tube(scene, span.o, span.w, span.t0, span.t1).map_or(0.0, |tube| tube.density(t));
    let flight = tracking::flight_density(medium, &span, t);
    let density = (on_span + flight) * p_direction + scene.columns.density(scene, id, s.o, y);
    let weight = s.beta / s.r.mean() * sight.tint * sight.transmittance * clear * (per_length * f / density);
    let via = Drawn { medium: span.medium, p: y, sigma: sigma_s, span, lead };
    let phases = [sight.phase, Some((span.medium, m))];
    if let Some(value) = beam::score(w, (id, weight, emission), s.depth + 1, first, phases, Some(via)) {
        vertex.scored(w.rec, sight.direction, value);
    }
}
