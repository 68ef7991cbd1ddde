//! The hard edge of a collimated beam moves: term H of [T] section 3 for beams, straight and behind flat mirrors and interfaces ([T] 5.3, 6.3).
//!
//! A path's medium span crosses the edge where the line that reaches it by a way of the beam comes from the distance R of the axis. Points of the span move with ẋ, so that
//! the lit part grows there by `-(ρ̇ - Ṙ)/|∂ρ/∂t|`, times what light just within the edge brings. Every span of a camera path is looked at, exactly: light of any order counts.

use super::sheet::Partials;
use super::{Context, Motion, Sample};
use crate::light::LightKind;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::Partial;
use crate::phase::one_minus_cos;
use crate::scene::beams::Way;
use crate::scene::{On, Scene};
use crate::transport::beam_motion::distance_forms;
use crate::transport::chained::Starts;
use crate::transport::first::{Met, Nth, Opening, Seen};
use crate::transport::record::{Event, MediumSpan, PathRecord};
use crate::transport::tracking;
use crate::transport::velocity::Velocity;
use crate::transport::walk::{State, Walker};
use crate::transport::{beam, camera_line};

/// Ways of all beams with a hard edge.
pub struct HardBeams {
    ways: Vec<u32>,
}

/// Points of a span and the weight of a path there.
struct Walked<'a> {
    span: MediumSpan,
    /// The span whole, up to what ends it.
    whole: MediumSpan,
    weight: &'a dyn Fn(f64) -> Rgb,
    depth: u32,
}

impl HardBeams {
    pub fn prepare(scene: &Scene, motion: &Motion) -> Option<HardBeams> {
        let hard = |w: &Way| {
            let l = &scene.lights[w.light as usize];
            matches!(l.kind, LightKind::Beam { gaussian: false, .. }) && motion.surfaces()
        };
        let ways: Vec<u32> =
            (0..scene.beams.ways.len() as u32).filter(|&k| hard(&scene.beams.ways[k as usize])).collect();
        (!ways.is_empty()).then_some(HardBeams { ways })
    }

    /// All crossings of a camera path with edges.
    pub fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        let mut stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        let (o, w) = cx.sensor.ray(film[0], film[1]);
        let mut rec = PathRecord::new();
        // Long paths would be cut into chunks.
        rec.chunk = usize::MAX;
        rec.begin(None, Opening::default());
        let mut walker = Walker::new(cx.scene, cx.set, &mut rec);
        let s = camera_line::start(&mut walker, State::new(*rng, o, w, cx.sensor.medium));
        walker.run(s);
        cx.tally = cx.tally.plus(&walker.tally);
        let starts = Starts::new(cx.scene, cx.moving, &rec, Opening::default());
        for (k, e) in rec.events.iter().enumerate() {
            let Some((leg, nth)) = starts.next_at(k) else { continue };
            let velocity = |span: &MediumSpan, p: DVec3| match nth {
                Nth::First => leg.line(cx.scene, cx.moving).first(&Seen::Medium { p, span: *span }).velocity,
                nth => cx.moving.vertex(cx.scene, &leg.first, nth, &Met::Medium(p)),
            };
            match *e {
                Event::Ends { span, start, depth, .. } => {
                    let m = &cx.scene.media[span.medium as usize];
                    let weight = |t: f64| start * tracking::depth(m, &span.until(t)).map(|d| (-d).exp());
                    let walked = Walked { span, whole: span, weight: &weight, depth };
                    self.cross(cx, &walked, film, &velocity, &mut stream, emit);
                }
                Event::Span { span, prefix: Some(prefix) } => {
                    let m = &cx.scene.media[span.medium as usize];
                    let weight = |t: f64| tracking::walked_weight(m, &span, t, prefix.beta, prefix.r);
                    // A flight behind an interface knows what would have ended it.
                    let whole = match rec.events.get(k + 1) {
                        Some(Event::Scatter { span: Some(whole), .. }) => *whole,
                        _ => span,
                    };
                    let walked = Walked { span, whole, weight: &weight, depth: prefix.depth };
                    self.cross(cx, &walked, film, &velocity, &mut stream, emit);
                }
                _ => {}
            }
        }
    }

    fn cross(
        &self,
        cx: &Context,
        walked: &Walked,
        film: [f64; 2],
        velocity: &dyn Fn(&MediumSpan, DVec3) -> Velocity,
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let (scene, span) = (cx.scene, walked.span);
        for way in self.ways.iter().map(|&k| &scene.beams.ways[k as usize]) {
            let order = walked.depth + 1 + way.steps.len() as u32;
            if order < cx.set.min_order || order >= cx.set.max_depth {
                continue;
            }
            for (t, slope) in edges(scene, way, &span) {
                let (p, mut points) = (span.o + span.w * t, Vec::new());
                let light = &scene.lights[way.light as usize];
                if way.trace(scene, p, &mut points).is_none() {
                    continue;
                }
                let from = (p, On::default(), Some(span.medium));
                let Some(shadow) = beam::clear(scene, way, &points, from, rng, &mut |_| {}) else { continue };
                let m = &scene.media[span.medium as usize];
                let f = m.phase.eval(one_minus_cos(span.w, -way.w));
                let flux =
                    (walked.weight)(t) * m.coefficients(p).1 * shadow * way.gain * light.value * (f / slope.abs());
                if flux.is_zero() {
                    continue;
                }
                let mut partials = Partials::default();
                let start = velocity(&walked.whole, p);
                distance_forms(scene, cx.sensor, cx.moving, way, p, start, |q| {
                    partials.push(Partial { v: -q.v, ..q });
                });
                partials.push(Partial { slot: light.place.radius, v: DVec3::X, len: 1 });
                emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
            }
        }
    }
}

/// Where a span crosses the edge of a way, and how the distance from the axis grows along it there.
fn edges(scene: &Scene, way: &Way, span: &MediumSpan) -> Vec<(f64, f64)> {
    let LightKind::Beam { position, direction, radius, .. } = scene.lights[way.light as usize].kind else {
        return Vec::new();
    };
    // The distance is affine along a line: two points tell it.
    let across = |t: f64| {
        let m = way.origin(span.o + span.w * t) - position;
        m - direction * m.dot(direction)
    };
    let scale = if span.t1.is_finite() { span.t1 - span.t0 } else { scene.bounds.radius().max(radius) };
    let a = across(span.t0);
    let b = (across(span.t0 + scale) - a) / scale;
    let q = [b.length_squared(), 2.0 * a.dot(b), a.length_squared() - radius * radius];
    let roots = super::arcs::quadratic(q).map(|t| (span.t0 + t, (a + b * t).dot(b) / radius));
    roots.filter(|(t, slope)| *t > span.t0 && *t < span.t1 && *slope != 0.0).collect()
}
