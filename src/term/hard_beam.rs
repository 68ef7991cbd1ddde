//! Where the light of collimated beams ends moves: the hard edge of a beam, term H of [T] section 3, straight and behind flat mirrors and interfaces ([T] 5.3, 6.3), and, behind them, the
//! edges of a block's faces, at which one way ends and others go on (where something else may cut the beam all borders but its own are [`super::cast`]'s).
//!
//! A path's medium span crosses the edge where the line that reaches it by a way of the beam comes from the distance R of the axis. Points of the span move with ẋ, so that
//! the lit part grows there by `-(ρ̇ - Ṙ)/|∂ρ/∂t|`, times what light just within the edge brings; at a face's edge by `<m, ẋ_j - ė>/|∂g/∂t|`, g being how far within the face the
//! line meets its plane, at x_j, and m its slope there. Every span of a camera path is looked at, exactly: light of any order counts.

use super::beam_rim::{self, RimRecord};
use super::sheet::Partials;
use super::spans::{self, Walked};
use super::{Context, Motion, Sample, cast};
use crate::light::LightKind;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::Partial;
use crate::phase::one_minus_cos;
use crate::scene::beams::{Way, corners};
use crate::scene::{On, Scene};
use crate::shape::Geometry;
use crate::transport::beam;
use crate::transport::beam_motion::{distance_forms, slide_forms};
use crate::transport::first::Met;
use crate::transport::record::MediumSpan;
use crate::transport::velocity::Velocity;

/// Ways of all beams that end somewhere.
pub struct HardBeams {
    ways: Vec<End>,
}

/// A way, and where its light ends.
struct End {
    way: u32,
    round: bool,
    borders: Vec<Border>,
}

/// An edge of the face of a step: a line through `a` along `t` of this length, and the direction across it into the face.
struct Border {
    step: usize,
    a: DVec3,
    t: DVec3,
    length: f64,
    m: DVec3,
}

/// Where a span crosses it.
struct Crossing<'a> {
    t: f64,
    /// How what is positive within the light changes along the span.
    slope: f64,
    /// A face's edge, or the beam's own.
    border: Option<&'a Border>,
}

/// How far within the light its value is asked for, in scene radii: on the edge itself rounding would tell which face is met.
const WITHIN: f64 = 1e-7;

impl HardBeams {
    pub fn prepare(scene: &Scene, motion: &Motion) -> Option<HardBeams> {
        if !motion.surfaces() {
            return None;
        }
        let cast = cast::takes_beams(scene, motion);
        let end = |k: u32| {
            let way = &scene.beams.ways[k as usize];
            let kind = &scene.lights[way.light as usize].kind;
            let borders = if cast { Vec::new() } else { borders(scene, way) };
            End { way: k, round: matches!(kind, LightKind::Beam { gaussian: false, .. }), borders }
        };
        let all = (0..scene.beams.ways.len() as u32).map(end);
        let ways: Vec<End> = all.filter(|e| e.round || !e.borders.is_empty()).collect();
        (!ways.is_empty()).then_some(HardBeams { ways })
    }

    /// All crossings of a camera path with edges.
    pub fn along(&self, cx: &mut Context, film: [f64; 2], rng: Rng, emit: &mut dyn FnMut(&Sample)) {
        let rim = rng.beside(Rng::next_u64(&mut { rng }));
        let mut rec = RimRecord::new(spans::record(), rim);
        spans::walk(cx, film, rng, &mut rec);
        let RimRecord { path: rec, points, .. } = rec;
        let starts = spans::starts(cx, &rec);
        spans::each(cx, &rec, &starts, &mut |walked, velocity| self.cross(cx, walked, film, velocity, emit));
        for point in &points {
            let Some((leg, nth)) = starts.next_past(point.vertex) else { continue };
            let start = cx.moving.vertex(cx.scene, leg.first(), nth, &Met::Medium(point.p));
            let partials = own_edge(cx, &cx.scene.beams.ways[point.way], point.p, start);
            let flux = point.flux;
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        }
    }

    fn cross(
        &self,
        cx: &Context,
        walked: &Walked,
        film: [f64; 2],
        velocity: &dyn Fn(&MediumSpan, DVec3) -> Velocity,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let (scene, span) = (cx.scene, walked.span);
        for end in &self.ways {
            let way = &scene.beams.ways[end.way as usize];
            let order = walked.depth + 1 + way.steps.len() as u32;
            if order < cx.set.min_order || order >= cx.set.max_depth {
                continue;
            }
            for c in end.crossings(scene, way, &span) {
                let p = span.o + span.w * c.t;
                let lit = c.border.map_or(p, |b| b.within(way, p, WITHIN * scene.bounds.radius()));
                let share = match c.border {
                    Some(_) => 1.0,
                    None => beam_rim::crossing_share(scene, end.way as usize, p, c.slope, walked.reach),
                };
                let arrives = match c.border {
                    Some(_) => {
                        let mut points = Vec::new();
                        let emission = beam::emission(scene, way, lit, &mut points);
                        let from = (lit, On::default(), Some(span.medium));
                        let shadow = emission.and_then(|_| beam::clear(scene, way, &points, from, &mut |_| {}));
                        emission.zip(shadow).map(|(e, shadow)| e.color() * shadow)
                    }
                    None => arrives(scene, way, p, span.medium),
                };
                let Some(arrives) = arrives else { continue };
                let m = &scene.media[span.medium as usize];
                let f = m.phase.eval(one_minus_cos(span.w, -way.w)) * share;
                let flux = (walked.weight)(c.t) * m.coefficients(p).1 * arrives * (f / c.slope.abs());
                if flux.is_zero() {
                    continue;
                }
                let start = velocity(&walked.whole, p);
                let partials = match c.border {
                    Some(b) => {
                        let mut partials = Partials::default();
                        let (way, from) = ((way, b.step), (p, start));
                        slide_forms(scene, cx.sensor, cx.moving, way, from, b.m, |q| partials.push(q));
                        partials
                    }
                    None => own_edge(cx, way, p, start),
                };
                emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
            }
        }
    }
}

/// `Ṙ - ρ̇` of a point on the beam's own edge that moves with `start`.
fn own_edge(cx: &Context, way: &Way, p: DVec3, start: Velocity) -> Partials {
    let mut partials = Partials::default();
    distance_forms(cx.scene, cx.sensor, cx.moving, way, p, start, |q| partials.push(Partial { v: -q.v, ..q }));
    let radius = cx.scene.lights[way.light as usize].place.radius;
    partials.push(Partial { slot: radius, v: DVec3::X, len: 1 });
    partials
}

/// Irradiance just within the beam's own edge at p, what stands in the beam and its media taken off.
pub(super) fn arrives(scene: &Scene, way: &Way, p: DVec3, medium: u32) -> Option<Rgb> {
    let mut points = Vec::new();
    way.trace(scene, p, &mut points)?;
    let shadow = beam::clear(scene, way, &points, (p, On::default(), Some(medium)), &mut |_| {})?;
    Some(way.gain * scene.lights[way.light as usize].value * shadow)
}

/// Edges of faces through which a way leaves a block, or at which it is mirrored inside of it.
fn borders(scene: &Scene, way: &Way) -> Vec<Border> {
    let mut list = Vec::new();
    for (k, s) in way.steps.iter().enumerate() {
        let shape = &scene.shapes[s.shape as usize].shape;
        let corners = corners(shape, s.face);
        // Where a beam enters, or meets an open face, no edge may stand in it ([`super::interfaces`]).
        if !shape.is_closed() || s.n.dot(s.before) < 0.0 {
            continue;
        }
        let middle = corners.iter().sum::<DVec3>() / corners.len().max(1) as f64;
        for (i, &a) in corners.iter().enumerate() {
            let b = corners[(i + 1) % corners.len()];
            let (length, t) = ((b - a).length(), (b - a).normalize());
            let m = s.n.cross(t);
            let m = if m.dot(middle - a) < 0.0 { -m } else { m };
            list.push(Border { step: k, a, t, length, m });
        }
    }
    list
}

impl Border {
    /// The point nearest to p, on the edge's sheet, whose line meets the plane this far within the face.
    fn within(&self, way: &Way, p: DVec3, by: f64) -> DVec3 {
        let at = |p: DVec3| way.on_plane(self.step, p).dot(self.m);
        // Affine in p.
        let slope = DVec3::new(at(p + DVec3::X), at(p + DVec3::Y), at(p + DVec3::Z)) - at(p);
        p + slope * (by / slope.length_squared())
    }
}

impl End {
    fn crossings(&self, scene: &Scene, way: &Way, span: &MediumSpan) -> Vec<Crossing<'_>> {
        let mut list = Vec::new();
        if self.round {
            list.extend(edges(scene, way, span).into_iter().map(|(t, slope)| Crossing {
                t,
                slope: -slope,
                border: None,
            }));
        }
        // How far within the face the line meets its plane is affine along the span.
        let scale = if span.t1.is_finite() { span.t1 - span.t0 } else { scene.bounds.radius() };
        for b in &self.borders {
            let at = |t: f64| way.on_plane(b.step, span.o + span.w * t) - b.a;
            let (x, y) = (at(span.t0), at(span.t0 + scale));
            let slope = (y - x).dot(b.m) / scale;
            let t = span.t0 - x.dot(b.m) / slope;
            if slope == 0.0 || !(t > span.t0 && t < span.t1) {
                continue;
            }
            let along = at(t).dot(b.t);
            if along > 0.0 && along < b.length {
                list.push(Crossing { t, slope, border: Some(b) });
            }
        }
        list
    }
}

/// What a span's points are across the beam: at its start, and per length. Affine: two points tell it.
fn across(scene: &Scene, way: &Way, span: &MediumSpan) -> Option<(DVec3, DVec3, f64)> {
    let LightKind::Beam { position, direction, radius, .. } = scene.lights[way.light as usize].kind else {
        return None;
    };
    let across = |t: f64| {
        let m = way.origin(span.o + span.w * t) - position;
        m - direction * m.dot(direction)
    };
    let scale = if span.t1.is_finite() { span.t1 - span.t0 } else { scene.bounds.radius().max(radius) };
    let a = across(span.t0);
    Some((a, (across(span.t0 + scale) - a) / scale, radius))
}

/// How the distance from the axis grows along a span, at a point on the edge.
pub(super) fn slope(scene: &Scene, way: &Way, span: &MediumSpan, t: f64) -> f64 {
    across(scene, way, span).map_or(0.0, |(a, b, radius)| (a + b * (t - span.t0)).dot(b) / radius)
}

/// Where a span crosses the edge of a way, and how the distance from the axis grows along it there.
fn edges(scene: &Scene, way: &Way, span: &MediumSpan) -> Vec<(f64, f64)> {
    let Some((a, b, radius)) = across(scene, way, span) else { return Vec::new() };
    let q = [b.length_squared(), 2.0 * a.dot(b), a.length_squared() - radius * radius];
    let roots = super::arcs::quadratic(q).map(|t| (span.t0 + t, (a + b * t).dot(b) / radius));
    roots.filter(|(t, slope)| *t > span.t0 && *t < span.t1 && *slope != 0.0).collect()
}
