//! The ends of a segment that grazes an edge: what light leaves the far one, by number of scatterings, and how either moves.

use super::Context;
use super::outline::Faces;
use super::sheet::{Grazed, Partials};
use crate::math::equiangular::EquiAngular;
use crate::math::rng::Rng;
use crate::math::{DVec2, DVec3, Rgb};
use crate::scene::{Around, Hit, March, On, Scene, Settings};
use crate::sensor::Projected;
use crate::shape::edges::{is_flat, to_border};
use crate::shape::{Geometry, Shape};
use crate::transport::first::{First, Met, Nth, Seen};
use crate::transport::line::Line;
use crate::transport::record::{MediumSpan, Recorder};
use crate::transport::state::{Stage, State};
use crate::transport::velocity::Velocity;
use crate::transport::walk::Walker;

/// Light by the number of its scatterings so far.
#[derive(Clone, Debug, Default)]
pub struct ByOrder(pub Vec<Rgb>);

impl ByOrder {
    fn add(&mut self, order: u32, value: Rgb) {
        let k = order as usize;
        if self.0.len() <= k {
            self.0.resize(k + 1, Rgb::ZERO);
        }
        self.0[k] += value;
    }

    /// What the picture shows of it after `more` scatterings.
    pub fn shown(&self, set: &Settings, more: u32) -> Rgb {
        let counts = |k: u32| k >= set.min_order && k < set.max_depth;
        let all = self.0.iter().enumerate().filter(|(k, _)| counts(*k as u32 + more));
        all.fold(Rgb::ZERO, |sum, (_, &x)| sum + x)
    }

    pub fn scale(&mut self, w: Rgb) {
        self.0.iter_mut().for_each(|x| *x *= w);
    }

    pub fn is_zero(&self) -> bool {
        self.0.iter().all(|x| x.is_zero())
    }
}

impl Recorder for ByOrder {
    const ON: bool = false;

    fn score(&mut self, order: u32, value: Rgb) {
        self.add(order, value);
    }
}

/// An unbiased estimate of the radiance that arrives against `w` from where the stage says, in `medium` before it. Lamps may be hidden from the
/// camera (`hide`), not from what they light.
pub fn radiance(
    cx: &mut Context,
    o: DVec3,
    w: DVec3,
    stage: Stage,
    medium: Option<u32>,
    hide: bool,
    rng: Rng,
) -> ByOrder {
    // How many scatterings count is asked later.
    let set = Settings { hide_emitters: hide, min_order: 0, ..*cx.set };
    let s = State { stage, ..State::new(rng, o, w, medium) };
    let mut found = ByOrder::default();
    let mut walker = Walker::new(cx.scene, &set, &mut found);
    walker.run(s);
    cx.tally = cx.tally.plus(&walker.tally);
    found
}

/// A point drawn in the media of a line.
pub struct Drawn {
    pub p: DVec3,
    pub medium: u32,
    /// From the line's start.
    pub distance: f64,
    pub transmittance: Rgb,
    pub sigma_s: Rgb,
    /// Per length.
    pub density: f64,
}

/// Draw a point of the media along w from `b`, by depth or by the angle that it subtends at one of the `poles` (positions with their probabilities;
/// `u` chooses).
pub fn medium_point(
    scene: &Scene,
    way: &Line,
    b: DVec3,
    w: DVec3,
    poles: &[(DVec3, f64)],
    u: f64,
    rng: &mut Rng,
) -> Option<Drawn> {
    let (first, last) = (way.parts.first()?, way.parts.last()?);
    if way.total.max() <= 0.0 {
        return None;
    }
    let along = |part: &crate::transport::line::Part| (part.span.o - b).dot(w);
    let (lo, hi) = (along(first) + first.span.t0, along(last) + last.span.t1);
    let angles = |p: DVec3| Some(EquiAngular::new(p, b, w, lo, hi)).filter(|a| a.usable());
    let share: f64 = poles.iter().filter(|(p, _)| angles(*p).is_some()).map(|p| p.1).sum();
    let mut u = u;
    let mut chosen = None;
    for (p, q) in poles {
        if let Some(a) = angles(*p) {
            if u < *q && chosen.is_none() {
                chosen = Some(a.sample(u / q));
            }
            u -= q;
        }
    }
    let (k, t) = match chosen {
        Some(s) => way.locate(b, s)?,
        None => {
            let f = way.force(scene, rng);
            (f.piece, f.t)
        }
    };
    let part = &way.parts[k];
    let distance = along(part) + t;
    let by_angle: f64 = poles.iter().filter_map(|(p, q)| Some(q * angles(*p)?.density(distance))).sum();
    let density = (1.0 - share) * way.mean_density(scene, k, t) + by_angle;
    let (p, medium) = (part.span.o + part.span.w * t, part.span.medium);
    let sigma_s = scene.media[medium as usize].coefficients(p).1;
    let transmittance = way.transmittance_to(scene, k, t);
    (density > 0.0).then_some(Drawn { p, medium, distance, transmittance, sigma_s, density })
}

/// How often the light that comes along a line is looked for in its media instead of on what ends it.
pub fn medium_share(scene: &Scene, way: &Line, ends: bool) -> f64 {
    let scatters = |part: &crate::transport::line::Part| {
        let m = &scene.media[part.span.medium as usize];
        !part.depth.is_zero() && (!m.sigma_s.is_zero() || m.emission.is_some())
    };
    match (way.parts.iter().any(scatters), ends || scene.environment.is_some()) {
        (false, _) => 0.0,
        (true, false) => 1.0,
        (true, true) => (1.0 - way.transmittance().mean()).clamp(0.1, 0.9),
    }
}

/// A point of the media along w from `b`, its distance, and an estimate of the light that it sends back to `b`.
pub fn medium_end(cx: &mut Context, way: &Line, b: DVec3, w: DVec3, rng: &mut Rng) -> Option<(Point, f64, ByOrder)> {
    let scene = cx.scene;
    // Half by the angles that distances subtend at lights.
    let share = |i: u32| Some((scene.pole(i)?, 0.5 * scene.local_selection(i)));
    let poles: Vec<(DVec3, f64)> = (0..scene.lights.len() as u32).filter_map(share).filter(|p| p.1 > 0.0).collect();
    let d = medium_point(scene, way, b, w, &poles, rng.uniform(), rng)?;
    let weight = d.transmittance * (1.0 / d.density);
    let mut light = ByOrder::default();
    if !d.sigma_s.is_zero() {
        let stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        light = radiance(cx, d.p, w, Stage::Medium, Some(d.medium), false, stream);
        light.scale(d.sigma_s);
    }
    if let Some((sigma_a, color)) = scene.media[d.medium as usize].glow(d.p) {
        light.add(0, sigma_a * color);
    }
    light.scale(weight);
    Some((Point::Medium(d.p), d.distance, light))
}

/// The radiance that arrives against `w` at `o` through `medium`, from what ends the line (past all that it grazes at `o`) and from the media before.
pub fn beyond(
    cx: &mut Context,
    o: DVec3,
    w: DVec3,
    end: Option<Hit>,
    medium: Option<u32>,
    hide: bool,
    rng: Rng,
) -> ByOrder {
    sent(cx, o, w, end, medium, hide, rng).map_or_else(ByOrder::default, |(_, _, light)| light)
}

/// The same, with the point that it leaves and the distance of that.
pub fn sent(
    cx: &mut Context,
    o: DVec3,
    w: DVec3,
    end: Option<Hit>,
    medium: Option<u32>,
    hide: bool,
    mut rng: Rng,
) -> Option<(Point, f64, ByOrder)> {
    let length = end.as_ref().map_or(f64::INFINITY, |h| (h.p - o).dot(w).max(0.0));
    let Some(way) = Line::clear(cx.scene, o, w, length, medium) else {
        cx.tally.missed_boundary += 1;
        return None;
    };
    let inside = medium_share(cx.scene, &way, end.is_some());
    // Without media both sides of an edge have the same random numbers.
    if inside > 0.0 && rng.uniform() < inside {
        let (point, distance, mut light) = medium_end(cx, &way, o, w, &mut rng)?;
        light.scale(Rgb::splat(1.0 / inside));
        return Some((point, distance, light));
    }
    let mut light = radiance(cx, o, w, end.map_or(Stage::Escape, Stage::Surface), way.last, hide, rng);
    light.scale(way.transmittance() * (1.0 / (1.0 - inside)));
    let (point, distance) = far_end(cx.scene, end, length);
    Some((point, distance, light))
}

/// What the surface at the end of a segment, at this distance, is for the segment's motion: one that goes on at a smooth surface holds its direction, as one that leaves the scene does.
pub fn far_end(scene: &Scene, end: Option<Hit>, distance: f64) -> (Point, f64) {
    let smooth = |h: &Hit| scene.surface_of(h.shape).is_smooth();
    end.filter(|h| !smooth(h)).map_or((Point::Infinity, f64::INFINITY), |h| (Point::Surface(h), distance))
}

/// A point whose motion is asked for.
#[derive(Clone, Copy, Debug)]
pub enum Point {
    Surface(Hit),
    Medium(DVec3),
    Infinity,
}

/// How the camera's path to a point begins, and which of its vertices the point is.
#[derive(Clone, Debug, Default)]
pub struct Watch {
    first: First,
    place: Nth,
}

impl Watch {
    /// The point that `q` projects is seen by the camera itself.
    pub fn itself(cx: &Context, q: &Projected, point: &Point) -> Watch {
        Watch { place: Nth::First, ..Watch::by_way(cx, q, point, None) }
    }

    /// The camera's path comes by way of the point that `q` projects. `second`: the vertex after that, if it is not yet the point whose motion is asked for.
    pub fn by_way(cx: &Context, q: &Projected, point: &Point, second: Option<&Point>) -> Watch {
        let seen = match point {
            Point::Surface(hit) => Some(Seen::Surface { hit: *hit, w: q.w }),
            Point::Medium(p) if cx.moving.any() => camera_span(cx, q).map(|span| Seen::Medium { p: *p, span }),
            _ => None,
        };
        Watch::new(cx, seen, second)
    }

    /// The point is this first vertex.
    pub fn seen(cx: &Context, seen: Seen) -> Watch {
        Watch { place: Nth::First, ..Watch::new(cx, Some(seen), None) }
    }

    /// By way of a first vertex that is known, and of a second one if that is not the point itself.
    pub fn new(cx: &Context, seen: Option<Seen>, second: Option<&Point>) -> Watch {
        let first = seen.filter(|_| cx.moving.any()).map(|s| cx.moving.film_line(cx.scene).first(&s));
        let watch = Watch { first: first.unwrap_or_default(), place: Nth::Second };
        match second {
            Some(p) => watch.beyond(cx, p),
            None => watch,
        }
    }

    /// A vertex of a leg that begins so.
    pub fn of(first: First, place: Nth) -> Watch {
        Watch { first, place }
    }

    /// How the point moves.
    pub fn velocity(&self, cx: &Context, point: &Point) -> Velocity {
        let at = match point {
            Point::Surface(h) => Met::Surface(*h),
            Point::Medium(p) => Met::Medium(*p),
            // Seen by the camera itself it moves as the first vertex.
            Point::Infinity if self.place == Nth::First => Met::Medium(DVec3::ZERO),
            Point::Infinity => return Velocity::default(),
        };
        if cx.moving.any() { cx.moving.vertex(cx.scene, &self.first, self.place, &at) } else { Velocity::default() }
    }

    /// The same beginning, for the point that comes after the one at hand.
    pub fn beyond(&self, cx: &Context, point: &Point) -> Watch {
        let first = self.first.clone();
        match (self.place, point) {
            (Nth::First, _) => Watch { first, place: Nth::Second },
            (Nth::Second, Point::Surface(hit)) if cx.moving.any() => {
                let first = cx.moving.film_line(cx.scene).then(first, &Met::Surface(*hit));
                Watch { first, place: Nth::Later }
            }
            _ => Watch { first, place: Nth::Later },
        }
    }
}

/// The medium span of a camera ray that holds what `q` projects.
fn camera_span(cx: &Context, q: &Projected) -> Option<MediumSpan> {
    let scene = cx.scene;
    let mut ray = March::new(q.o, q.w, On::default(), cx.sensor.medium);
    for _ in 0..scene.max_interfaces {
        let hit = ray.meets(scene, f64::INFINITY);
        let t1 = hit.as_ref().map_or(f64::INFINITY, |h| h.t);
        if t1 >= ray.left(q.distance) {
            return MediumSpan::ahead(&ray, f64::INFINITY, hit.as_ref());
        }
        ray.pass(scene, &hit.filter(|h| scene.passes(h))?);
    }
    None
}

/// `<c, ẋ>` of a point.
pub fn motion(cx: &Context, point: &Point, watch: &Watch, c: DVec3, out: &mut Partials) {
    if c != DVec3::ZERO {
        watch.velocity(cx, point).forms(cx.scene, cx.sensor, c, |p| out.push(p));
    }
}

/// `-v_⊥` (25) of a line that grazes at b, between S and D at these distances from there; n toward the unblocked side. D may be at infinity.
pub fn between(
    cx: &Context,
    [s, d]: [&Point; 2],
    [ds, dd]: [f64; 2],
    watch: &Watch,
    b: DVec3,
    n: DVec3,
    grazed: Grazed,
) -> Partials {
    let (share_s, share_d) = if dd == f64::INFINITY { (1.0, 0.0) } else { (dd / (ds + dd), ds / (ds + dd)) };
    let mut p = Partials::default();
    material(cx.scene, grazed, b, -n, &mut p);
    motion(cx, d, &watch.beyond(cx, s), n * share_d, &mut p);
    motion(cx, s, watch, n * share_s, &mut p);
    p
}

/// What ends a line behind the edge that it grazes at b. The edge may stand on it.
pub fn past(scene: &Scene, b: DVec3, w: DVec3, n: DVec3, grazed: Grazed) -> Option<Hit> {
    let hit = scene.opaque_past(b, w, f64::INFINITY, grazed)?;
    Some(if hit.t <= contact(scene) { beside(scene, &hit, n) } else { hit })
}

/// `<c, v>` of a point of an outline, which goes with what is grazed there: all of it alike, so that the first face tells.
pub fn material(scene: &Scene, grazed: Grazed, p: DVec3, c: DVec3, out: &mut Partials) {
    if let Some((shape, faces)) = grazed.first() {
        let face = faces.first().copied().unwrap_or(0);
        scene.matter(*shape, face).forms(p, c, |f| out.push(f));
    }
}

/// How far from an edge toward the middle of its face radiance is asked for, in scene radii, and as a share of the way at most. Embree's f32
/// rays must tell the edge's other faces from this one, or they shadow it where light comes in at a small angle.
const OFF_THE_EDGE: f64 = 1e-4;
const OF_THE_WAY: f64 = 1e-2;

/// Faces (shape, face) in which the point of an outline at this distance on a ray lies, besides those grazed: it stands on them, or is hidden right behind. `None` if the ray ends before.
pub fn touched(scene: &Scene, o: DVec3, w: DVec3, distance: f64, grazed: Grazed) -> Option<Vec<(u32, u32)>> {
    let contact = contact(scene);
    let next = |past: Grazed| scene.opaque_past(o, w, distance + contact, past);
    let Some(mut hit) = next(grazed) else { return Some(Vec::new()) };
    let (mut past, mut found) = (grazed.to_vec(), Vec::new());
    loop {
        if hit.t < distance - contact {
            return None;
        }
        // One that comes again is hit in another place of it.
        let face = (hit.shape, hit.face);
        if found.contains(&face) {
            return Some(found);
        }
        found.push(face);
        match past.iter_mut().find(|p| p.0 == hit.shape) {
            Some(p) => p.1.push(hit.face),
            None => past.push((hit.shape, vec![hit.face])),
        }
        let Some(other) = next(&past) else { return Some(found) };
        hit = other;
    }
}

/// Slope between faces, along a ray, that counts as none.
const LEVEL: f64 = 1e-9;

/// The faces at the point e of an outline that lies in others, on either side: its own with these, or these alone where they are in front. `None` where one of these hides both sides. n:
/// across the ray w, toward the lit side.
pub fn with_touched(
    scene: &Scene,
    faces: &Faces,
    touched: &[(u32, u32)],
    e: DVec3,
    w: DVec3,
    n: DVec3,
) -> Option<Faces> {
    let side = |own: &[(u32, u32)], n: DVec3| {
        let reaches = |&(shape, face): &(u32, u32)| {
            let shape = &scene.shapes[shape as usize].shape;
            to_border(shape, face, e) > contact(scene) || n.dot(shape.position(face, DVec2::splat(0.5)) - e) > 0.0
        };
        let mut there: Vec<(u32, u32)> = touched.iter().copied().filter(reaches).collect();
        let slope = |f: &(u32, u32)| depth(scene, *f, e, w, n);
        there.sort_by(|a, b| slope(a).total_cmp(&slope(b)));
        let nearest = own.iter().map(slope).fold(f64::INFINITY, f64::min) + LEVEL;
        let first = there.first().copied().filter(|f| slope(f) <= nearest);
        let own = if first.is_some() { &[] } else { own };
        ([own, &there].concat(), first)
    };
    let ((lit, before), (own, behind)) = (side(&faces.lit, n), side(&faces.own, -n));
    (before.is_none() || before != behind).then_some(Faces { lit, own })
}

/// How much further away than e a face through e is met by a ray along w, a unit aside along n.
fn depth(scene: &Scene, (shape, face): (u32, u32), e: DVec3, w: DVec3, n: DVec3) -> f64 {
    let m = scene.shapes[shape as usize].shape.normal(face, e);
    -m.dot(n) / m.dot(w)
}

/// Of faces (shape, face) on one side of an outline, the one that a ray along w sees first when it passes the point e a little off the side
/// that n points to. `beyond`: those on the other side; a face in both goes on through the edge.
pub fn front(scene: &Scene, faces: &[(u32, u32)], beyond: &[(u32, u32)], e: DVec3, w: DVec3, n: DVec3) -> Option<Hit> {
    let depth = |f: &(u32, u32)| depth(scene, *f, e, w, n);
    let &(shape, face) = faces.iter().min_by(|a, b| depth(a).total_cmp(&depth(b)))?;
    // On the very edge rays would start on its other face, too.
    let toward = |middle: DVec3| {
        let share = OFF_THE_EDGE * scene.bounds.radius() / (middle - e).length();
        e.lerp(middle, share.min(OF_THE_WAY))
    };
    let instance = &scene.shapes[shape as usize];
    let p = match &instance.shape {
        flat if is_flat(flat) && beyond.contains(&(shape, face)) => {
            let m = flat.normal(face, e);
            let room = to_border(flat, face, e);
            let step = (OFF_THE_EDGE * scene.bounds.radius()).min(OF_THE_WAY * room);
            e + (n - m * n.dot(m)).normalize() * step
        }
        Shape::Sphere(_) => e,
        Shape::Cylinder(c) => {
            c.off_the_rims(e, (OFF_THE_EDGE * scene.bounds.radius()).min(OF_THE_WAY * 0.5 * c.length))
        }
        Shape::Mesh(m) => {
            let [a, b, c] = m.corners(face);
            toward((a + b + c) / 3.0)
        }
        flat => toward(flat.position(face, DVec2::splat(0.5))),
    };
    Some(scene.hit_at(p, shape, face))
}

/// How far off grazing the light of a curved face is asked for at its outline.
const OFF_GRAZING: f64 = 1e-7;

/// The direction along which what an outline's own faces send is asked for, n across the ray w, away from them. A curved face is seen edge on there: rounding must not decide from which side.
pub fn edge_on(w: DVec3, n: DVec3, grazed: Grazed) -> DVec3 {
    // It names nothing.
    let curved = grazed.first().is_some_and(|(_, named)| named.is_empty());
    if curved { (w - n * OFF_GRAZING).normalize() } else { w }
}

/// A point of a ray along w a little before what it meets.
pub fn before(scene: &Scene, hit: &Hit, w: DVec3) -> DVec3 {
    hit.p - w * (OFF_THE_EDGE * scene.bounds.radius()).min(OF_THE_WAY * hit.t)
}

/// The medium on a line along w that grazes at b, n toward the unblocked side. What is grazed may bound a medium itself: from its very edge rounding could lead into it.
pub fn medium_beside(scene: &Scene, b: DVec3, w: DVec3, n: DVec3, grazed: Grazed, around: &Around) -> Option<u32> {
    let bounds = |id: u32| scene.shapes[id as usize].boundary && scene.surface_of(id).is_transparent();
    let off = if grazed.iter().any(|g| bounds(g.0)) { OFF_THE_EDGE * scene.bounds.radius() } else { 0.0 };
    scene.medium_past(b + n * off, w, grazed, around)
}

/// Distances that count as contact: an edge that stands on a surface.
pub fn contact(scene: &Scene) -> f64 {
    1e-9 * scene.bounds.radius()
}

/// What an edge stands on, a little off it to the side that n points to.
pub fn beside(scene: &Scene, hit: &Hit, n: DVec3) -> Hit {
    let along = n - hit.n * n.dot(hit.n);
    let p = hit.p + along * (OFF_THE_EDGE * scene.bounds.radius());
    Hit { t: hit.t, ..scene.hit_at(p, hit.shape, hit.face) }
}
