//! The motion of a light beside it: where the score of a connection, `~ r^-3`, is not integrable.
//!
//! With all vertices of a path fixed, `∂_p r^-2` at a medium vertex y diverges too fast for any density ([T] 5.5). Two balls tame it, both
//! relative to the path: y belongs to the ball of the vertex x before it if it is nearer to the light than half as far as x.
//!
//! * Paths with y in the ball of x are scored by [`ball`] alone, drawn around the light with a model subtracted.
//! * What that leaves at x grows like `|x-p|^-2`, whose second moment is infinite under free flight. So paths z, x, y, light with x
//!   in the ball of z are scored by [`chain`] alone, which draws x around the light. Longer ones grow like `|x-p|^-1` and need nothing.
//!
//! All other connections score as they are ([`follows`]).

use super::aim::{Aim, Turn};
use super::connect;
use super::light_centred::{self, Sight, Vertex};
use super::record::{Event, MediumSpan, Recorder};
use super::transmit;
use super::walk::{Stage, State, Walker};
use crate::math::{DVec3, warp};
use crate::phase::one_minus_cos;
use crate::scene::{On, Scene};
use std::f64::consts::PI;

/// Radius of a ball over the distance from its vertex to the light.
const BESIDE: f64 = 0.5;

/// Whether `y` lies in the ball of `x`.
fn is_beside(scene: &Scene, light: u32, x: DVec3, y: DVec3) -> bool {
    let Some(p) = scene.lights[light as usize].center() else { return false };
    scene.embedded_selection(light) > 0.0 && (y - p).length_squared() < BESIDE * BESIDE * (x - p).length_squared()
}

/// Whether the motion of `light` is scored by an ordinary connection from the medium point `y`, `x` and `z` being the vertices before it (a
/// medium vertex x; none of them on a camera line).
pub(super) fn follows<R: Recorder>(w: &Walker<R>, light: u32, y: DVec3, x: Option<DVec3>, z: Option<DVec3>) -> bool {
    let within = |a: Option<DVec3>, b: Option<DVec3>| a.zip(b).is_some_and(|(a, b)| is_beside(w.scene, light, a, b));
    R::ON && w.rec.follows(light) && !within(x, Some(y)) && !within(z, x)
}

/// Score the balls of the vertex at `s.o`.
pub fn score<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    if R::ON && w.scene.has_embedded_lights() && w.may_scatter(s.depth + 1) {
        ball(w, s, vertex);
        if w.may_scatter(s.depth + 2) {
            chain(w, s, vertex);
        }
    }
}

/// A light whose motion is asked for, its probability and its place.
fn moving_light<R: Recorder>(w: &Walker<R>, s: &mut State) -> Option<(u32, f64, DVec3)> {
    let (light, q) = w.scene.select_embedded_light(s.aside.uniform())?;
    let p = w.scene.lights[light as usize].center()?;
    w.rec.follows(light).then_some((light, q, p))
}

/// The motion of a light that stands in a medium, scored at next vertices y within a ball of radius R around it, R half the distance
/// from the vertex x to the light.
///
/// There `∫ F(y) h(n)/r^2 dy` (n = (y-p)/r; h: phase function at y times the intensity's profile; F: all the rest) has the derivative
///
/// `∫ [F ∂_p(h/r^2) - F(p) ∂_p(h_p/r^2)] dy - F(p) ∮ h_p n dn`,
///
/// h_p being h with the arrival from x at p. `h_p/r^2` is homogeneous in y-p: the integral of its gradient over any shell is 0, so what is
/// subtracted has no mean, but takes away the part `~ r^-3` that is not integrable; the last term is the flux through
/// a vanishing sphere that moves with p (it is what [T] (64) leaves out where h is not even in n). No vertex moves, so no
/// silhouette needs a term for it. Where a shadow or a silhouette at distance b parts y from p, `r^-3` is left beyond b; the density
/// `~ r^-2.5` keeps its second moment at `b^-1/2`, which is integrable over all x.
fn ball<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene = w.scene;
    let Some((light, q, p)) = moving_light(w, s) else { return };
    // The vertex itself stands in the ball of the one before: `chain` has scored this path.
    if s.from.is_some_and(|z| is_beside(scene, light, z, s.o)) {
        return;
    }
    let (u, v, z) = (s.aside.uniform(), s.aside.uniform(), s.aside.uniform());
    let radius = BESIDE * (p - s.o).length();
    let (r, n) = (radius * u * u, warp::sphere(v, z));
    let y = p + n * r;
    if r <= 0.0 || !r.is_finite() || y == p {
        return;
    }
    let density = q / (2.0 * (radius * r).sqrt()) / (4.0 * PI * r * r);
    let prefix = s.beta / s.r.mean();
    let side = w.rec.side_len();
    let mut rng = s.aside;
    let (at_light, at_y) = (Sight::new(w, s, vertex, p, &mut rng), Sight::new(w, s, vertex, y, &mut rng));
    if let Some(a) = scene.arrival(light, y, 0.0, 0.0) {
        // F without its phase function at the far end.
        let rest = |sight: &Sight, y: DVec3| {
            let m = &scene.media[sight.span.medium as usize];
            prefix * sight.transmittance * m.coefficients(y).1 * sight.per_length
        };
        let phase = |sight: &Sight| {
            let m = &scene.media[sight.span.medium as usize];
            m.phase.eval(one_minus_cos(sight.direction, a.w))
        };
        let aim = |sight: &Sight| {
            let medium = sight.span.medium;
            Aim::new(light, y, Some(medium), On::default(), &a, Turn::Phase(medium, sight.direction), s.aside)
        };
        let light_at_y = a.emission.color() * (a.factor / density);
        if let Some(sight) = &at_y {
            let on = On::default();
            if let Some((shadow, _)) = transmit::shadow(w, &mut rng, Some(sight.span.medium), y, &on, &a) {
                let value = rest(sight, y) * shadow * phase(sight) * light_at_y;
                w.rec.push(Event::Aim { aim: aim(sight), value });
            }
        }
        if let Some(sight) = &at_light {
            let h = rest(sight, p) * phase(sight);
            w.rec.push(Event::Aim { aim: Aim { model: true, ..aim(sight) }, value: -(h * light_at_y) });
            let flux = h * a.emission.color() * (4.0 * PI / q);
            w.rec.push(Event::Drift { slot: scene.lights[light as usize].place.position, v: -n, value: flux });
        }
    }
    s.aside = rng;
    // Their spans are nobody's: only motion was scored.
    w.rec.side_truncate(side);
}

/// Vertices x in the ball, density `~ r^-2`, and from each of them every path of one more scattering to the light.
fn chain<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene = w.scene;
    let Some((light, q, p)) = moving_light(w, s) else { return };
    let (u, v, z) = (s.aside.uniform(), s.aside.uniform(), s.aside.uniform());
    let radius = BESIDE * (p - s.o).length();
    let r = radius * u;
    let x = p + warp::sphere(v, z) * r;
    if r <= 0.0 || !r.is_finite() || x == p {
        return;
    }
    let density = q / radius / (4.0 * PI * r * r);
    let side = w.rec.side_len();
    let mut rng = s.aside;
    let sight = Sight::new(w, s, vertex, x, &mut rng);
    w.rec.side_truncate(side);
    s.aside = rng;
    let Some(sight) = sight else { return };
    let medium = sight.span.medium;
    let sigma_s = scene.media[medium as usize].coefficients(x).1;
    let beta = s.beta / s.r.mean() * sight.transmittance * sigma_s * (sight.per_length / density);
    if beta.is_zero() {
        return;
    }
    let mut next = State::new(rng, x, sight.direction, Some(medium));
    (next.beta, next.depth, next.stage) = (beta, s.depth + 1, Stage::Medium);
    let mut aims = Aims { light, events: Vec::new() };
    let mut sub = Walker::new(scene, w.set, &mut aims);
    let x_vertex = Vertex::Medium(medium);
    light_centred::connect(&mut sub, &mut next, &x_vertex);
    ball(&mut sub, &mut next, &x_vertex);
    let (u, v) = (next.rng.uniform(), next.rng.uniform());
    let phase = &scene.media[medium as usize].phase;
    let (direction, m) = phase.sample(next.w, u, v);
    (next.w, next.pdf_direction, next.on) = (direction, phase.eval(m), On::default());
    sub.fly(&mut next);
    if let (Stage::Medium, Some(id)) = (next.stage, next.medium) {
        connect::from_medium(&mut sub, &mut next, id);
    }
    w.tally = w.tally.plus(&sub.tally);
    s.aside = next.rng;
    aims.events.into_iter().for_each(|e| w.rec.push(e));
}

/// Keeps what scores the motion of one light, and nothing else.
struct Aims {
    light: u32,
    events: Vec<Event>,
}

impl Recorder for Aims {
    const ON: bool = true;
    fn push(&mut self, e: Event) {
        if matches!(e, Event::Aim { .. } | Event::Drift { .. }) {
            self.events.push(e);
        }
    }
    fn side_span(&mut self, _: MediumSpan) {}
    fn side_len(&self) -> u32 {
        0
    }
    fn side_truncate(&mut self, _: u32) {}
    fn checkpoint(&mut self, _: &State) -> bool {
        false
    }
    fn follows(&self, light: u32) -> bool {
        light == self.light
    }
}
