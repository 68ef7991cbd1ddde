//! Samples of a sheet by its two techniques: where a camera ray crosses it, and from its source outward.

use super::ends::{self, ByOrder, Point, Watch};
use super::light_walk::{LightWalk, Vertex, seen};
use super::sheet::{Grazed, Partials, Ray, Reach};
use super::{Context, Sample};
use crate::light::LightKind;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::phase::one_minus_cos;
use crate::scene::{Hit, March, On, Scene};
use crate::transport::first::Seen;
use crate::transport::record::{MediumSpan, NoRecord};
use crate::transport::transmit;
use crate::transport::walk::Walker;

/// Irradiance across the ray on the lit side of a sheet at `y`; whether the light gets there is known.
fn irradiance(cx: &mut Context, ray: &Ray, y: DVec3, medium: Option<u32>, on: &On) -> Option<Rgb> {
    let light = &cx.scene.lights[ray.light as usize];
    let a = match ray.profile {
        true => light.within_edge(ray.origin - y),
        false => light.straight(y)?,
    };
    let mut rec = NoRecord;
    let mut w = Walker::new(cx.scene, cx.set, &mut rec);
    let clear = transmit::through(&mut w, medium, y, on, &a, None);
    cx.tally.missed_boundary += w.tally.missed_boundary;
    Some(clear?.transmittance * a.emission.color() * a.factor)
}

/// Whether something stands between where parallel rays begin and a ray's origin on the outline, or that lies before where they begin.
fn is_shaded(scene: &Scene, ray: &Ray, grazed: Grazed) -> bool {
    let LightKind::Beam { position, direction, .. } = scene.lights[ray.light as usize].kind else {
        return scene.blocked_past(ray.origin, -ray.w, f64::INFINITY, grazed);
    };
    let length = (ray.origin - position).dot(direction);
    let contact = ends::contact(scene);
    length < -contact
        || length > contact && scene.blocked_past(ray.origin, -ray.w, scene.short_of(ray.origin, length), grazed)
}

/// Nearest surface on a ray of a sheet; `None` if something stands before the sheet begins.
fn receiver(scene: &Scene, ray: &Ray, grazed: Grazed) -> Option<Option<Hit>> {
    let hit = scene.opaque_past(ray.origin, ray.w, f64::INFINITY, grazed);
    if ray.distant {
        // Behind the outline the way to the light has to be clear too.
        return (!is_shaded(scene, ray, grazed)).then_some(hit);
    }
    match hit {
        // What the outline stands on is no receiver: the outline's own motion is seen there.
        Some(h) if h.t <= ray.near + ends::contact(scene) => None,
        h => Some(h),
    }
}

/// Whether the light reaches the point at `rho`.
pub fn is_lit(scene: &Scene, ray: &Ray, rho: f64, grazed: Grazed) -> bool {
    if !ray.distant {
        return !scene.blocked_past(ray.origin, ray.w, rho, grazed);
    }
    // The ray starts on the outline, which may stand on something.
    let beyond = rho > 0.0 && scene.opaque_past(ray.origin, ray.w, rho, grazed).is_some();
    !(beyond || is_shaded(scene, ray, grazed))
}

/// The medium spans of a camera ray in order, up to the first opaque surface.
fn camera_spans(cx: &mut Context, film: [f64; 2], spans: &mut Vec<MediumSpan>) {
    let scene = cx.scene;
    spans.clear();
    let (o, w) = cx.sensor.ray(film[0], film[1]);
    let mut ray = March::new(o, w, On::default(), cx.sensor.medium);
    for _ in 0..scene.max_interfaces {
        let hit = ray.meets(scene, f64::INFINITY);
        spans.extend(MediumSpan::ahead(&ray, f64::INFINITY, hit.as_ref()));
        let Some(h) = hit.filter(|h| scene.passes(h)) else { return };
        ray.pass(scene, &h);
    }
    cx.tally.missed_boundary += 1;
}

/// Every medium span of a camera ray, handed over with those before it: `find` looks for the sheet's crossings with the last one.
pub fn along(cx: &mut Context, film: [f64; 2], mut find: impl FnMut(&mut Context, &[MediumSpan], &MediumSpan)) {
    if cx.set.max_depth <= 1 {
        return;
    }
    let mut spans = Vec::new();
    camera_spans(cx, film, &mut spans);
    for k in 0..spans.len() {
        find(cx, &spans[..=k], &spans[k]);
    }
}

/// A crossing of the last of `spans` with a sheet, at the abscissa `t` of the span and `rho` of the sheet's ray.
pub struct Found<'a> {
    pub spans: &'a [MediumSpan],
    pub t: f64,
    pub ray: Ray,
    pub rho: f64,
    pub grazed: Grazed<'a>,
}

/// The point at `t` of a span of a camera line, as that line's first vertex.
pub fn crossed(cx: &Context, span: &MediumSpan, t: f64) -> (Point, Watch) {
    let p = span.o + span.w * t;
    (Point::Medium(p), Watch::seen(cx, Seen::Medium { p, span: *span }))
}

/// What the crossing adds to the film point that its camera ray came from [T] (35); `partials` = -v_n.
pub fn crossing(cx: &mut Context, reach: &Reach, c: &Found, partials: &Partials, emit: &mut dyn FnMut(&Sample)) {
    let scene = cx.scene;
    let Some((span, before)) = c.spans.split_last().filter(|_| cx.set.min_order <= 1) else { return };
    let y = span.o + span.w * c.t;
    let m = &scene.media[span.medium as usize];
    let sigma_s = m.coefficients(y).1;
    if sigma_s.is_zero() || !is_lit(scene, &c.ray, c.rho, c.grazed) {
        return;
    }
    let Some(q) = cx.sensor.project(y) else { return };
    let Some(e) = irradiance(cx, &c.ray, y, Some(span.medium), &On::default()) else { return };
    let part = span.until(c.t);
    let transmittance = before.iter().chain([&part]).fold(Rgb::ONE, |t, s| t * transmit::one_span(scene, s));
    let f = m.phase.eval(one_minus_cos(span.w, -c.ray.w));
    emit(&Sample {
        film: q.film,
        flux: transmittance * sigma_s * e * (f * q.pixels_per_area),
        partials: partials.as_slice(),
        film_per_sheet: q.pixels_per_area * c.ray.n.dot(span.w).abs(),
        outward: c.ray.across * reach.density(&c.ray, c.rho) / c.ray.spread(c.rho),
    });
}

/// A point of the sheet's ray in a medium, and the surface at its end: straight to the camera, and one of them by way of further
/// scatterings [T] (36). `motion` gives -v_n for a point of the ray at its distance. `lead`: the number that the distance comes from, and those of [`LightWalk::run`].
pub fn outward(
    cx: &mut Context,
    reach: &Reach,
    ray: &Ray,
    grazed: Grazed,
    motion: &dyn Fn(&Context, f64, &Point, &Watch) -> Partials,
    lead: &[f64],
    rng: &mut Rng,
    emit: &mut dyn FnMut(&Sample),
) {
    let scene = cx.scene;
    let Some(end) = receiver(scene, ray, grazed) else { return };
    let limit = end.as_ref().map_or(f64::INFINITY, |h| h.t);
    let mut starts: [Option<(Vertex, Rgb, f64)>; 2] = [None, None];

    let point = reach.sample(ray, lead[0]).filter(|p| ray.in_media && p.0 < limit);
    if let Some((rho, density)) = point {
        let y = ray.at(rho);
        let toward = if ray.distant { -ray.w } else { ray.origin - y };
        let on = On::default();
        let medium = ends::medium_beside(scene, y, toward.normalize(), ray.n, grazed, &cx.around);
        let e = irradiance(cx, ray, y, medium, &on);
        if let (Some(id), Some(e)) = (medium, e) {
            let z = Vertex { p: y, w: ray.w, medium, hit: None };
            let flux = e * scene.media[id as usize].coefficients(y).1;
            let density = ray.across * density / ray.spread(rho);
            let own = |cx: &Context, point: &Point, watch: &Watch| motion(cx, rho, point, watch);
            straight(cx, &z, flux, (ray.crossed.then_some(ray.n), density), &own, emit);
            starts[0] = Some((z, flux / density, rho));
        }
    }
    if let Some(h) = end.filter(|h| scene.reflects(h)) {
        let on = On::at(&h);
        let medium = ends::medium_beside(scene, ends::before(scene, &h, ray.w), -ray.w, ray.n, grazed, &cx.around);
        if let Some(e) = irradiance(cx, ray, h.p, medium, &on) {
            let z = Vertex { p: h.p, w: ray.w, medium, hit: Some(h) };
            let weight = e * (ray.spread(h.t) / ray.across);
            let own = |cx: &Context, point: &Point, watch: &Watch| motion(cx, h.t, point, watch);
            straight(cx, &z, weight, (None, 1.0), &own, emit);
            starts[1] = Some((z, weight, h.t));
        }
    }

    // One of them goes on.
    let size = starts.map(|s| s.map_or(0.0, |(_, weight, _)| weight.abs().max()));
    let total = size[0] + size[1];
    if !total.is_finite() || total <= 0.0 || cx.set.max_depth <= 2 {
        cx.tally.nonfinite += u64::from(!total.is_finite());
        return;
    }
    let k = usize::from(rng.uniform() * total >= size[0]);
    if let Some((z, weight, rho)) = starts[k] {
        let own = |cx: &Context, point: &Point, watch: &Watch| motion(cx, rho, point, watch);
        further(cx, reach, z, weight * (total / size[k]), &own, &lead[1..], rng, emit);
    }
}

/// How a point that the camera, or a path of it, comes to moves.
pub type OwnMotion<'a> = &'a dyn Fn(&Context, &Point, &Watch) -> Partials;

/// What a point of a sheet, drawn with this density, scatters straight to the camera. The sheet's normal where camera rays find its crossings, too.
pub fn straight(
    cx: &mut Context,
    z: &Vertex,
    flux: Rgb,
    (crossed, density): (Option<DVec3>, f64),
    motion: OwnMotion,
    emit: &mut dyn FnMut(&Sample),
) {
    let within = cx.set.max_depth > 1 && cx.set.min_order <= 1;
    let Some(q) = cx.sensor.project(z.p).filter(|q| within && cx.on_film(q.film)) else { return };
    let Some(f) = seen(cx, z, &q) else { return };
    let point = z.hit.map_or(Point::Medium(z.p), Point::Surface);
    let partials = motion(cx, &point, &Watch::itself(cx, &q, &point));
    let film_per_sheet = crossed.map_or(0.0, |n| q.pixels_per_area * n.dot(q.w).abs());
    let partials = partials.as_slice();
    emit(&Sample { film: q.film, flux: flux * f, partials, film_per_sheet, outward: density });
}

/// What it scatters by way of more vertices; `lead`: the numbers of [`LightWalk::run`].
pub fn further(
    cx: &mut Context,
    reach: &Reach,
    z: Vertex,
    weight: Rgb,
    motion: OwnMotion,
    lead: &[f64],
    rng: &mut Rng,
    emit: &mut dyn FnMut(&Sample),
) {
    let point = z.hit.map_or(Point::Medium(z.p), Point::Surface);
    let later = |cx: &Context, watch: &Watch| motion(cx, &point, watch);
    // Nothing scattered it yet.
    let source = ByOrder(vec![Rgb::ONE]);
    LightWalk { reach, motion: &later, source: &source }.run(cx, z, weight, lead, rng, emit);
}
