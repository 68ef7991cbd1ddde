//! Connections to collimated beams, straight and by way of flat mirrors and interfaces ([T] (30), 6.2): at every vertex, each way of each beam that reaches it. Nothing is drawn.

use super::record::{End, Event, MediumSpan, Recorder};
use super::vertex::{Toward, Vertex};
use super::walk::{State, Walker};
use super::{specular, transmit};
use crate::light::{Emission, LightKind, beam_profile};
use crate::math::{DVec3, Rgb};
use crate::scene::beams::Way;
use crate::scene::{March, On, Scene};

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
        let order = s.depth + way.steps.len() as u32;
        // The vertex counts already; every interface on the way is one more.
        if order > s.depth && !w.may_scatter(order) {
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
        let weight = s.beta / s.r.mean() * lobe.tint * t * lobe.f;
        if order < w.set.min_order {
            w.rec.side_truncate(first);
            continue;
        }
        let value = weight * emission.color();
        w.value += value;
        w.rec.score(order, value);
        if R::ON {
            let (end, spans) = (End::Beam(id as u32), w.rec.side_len() - first);
            w.rec.push(Event::Connect {
                weight,
                emission,
                end,
                first_span: first,
                spans,
                phase: [phase, None],
                via: None,
            });
            vertex.scored(w.rec, toward, value);
        }
    }
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
    for k in 0..=points.len() {
        let step = way.steps.len().checked_sub(k + 1).map(|i| &way.steps[i]);
        let length = match (step, &light.kind) {
            (Some(_), _) => f64::INFINITY,
            (None, LightKind::Beam { position, direction, .. }) => (ray.o - *position).dot(*direction),
            (None, _) => light.center().map_or(f64::INFINITY, |q| (q - ray.o).length()),
        };
        // Up to the next step, or to the light, whatever that stands on.
        let end = loop {
            let left = ray.left(length);
            let limit = if step.is_none() { scene.short_of(ray.o, left) } else { left };
            let hit = ray.meets(scene, limit);
            let passes = hit.is_some_and(|h| scene.passes(&h));
            let wanted = match (step, &hit) {
                (Some(s), Some(h)) => passes || (s.shape, s.face) == (h.shape, h.face),
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
