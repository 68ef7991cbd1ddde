//! The motion of a light beside it: where the score of a connection, `~ r^-3`, is not integrable.
//!
//! With all vertices of a path fixed, `∂_p r^-2` at a medium vertex y diverges too fast for any density ([T] 5.5). Balls tame it: y lies in the ball of
//! the vertex x before it if it is nearer to the light than half as far as x.
//!
//! * A path that ends x, y, light with y in the ball of x is scored by `ball` alone, drawn around the light with a model subtracted.
//! * What that leaves at x grows like `|x-p|^-2`: its second moment is infinite where free flight drew x. So a path that enters a ball (x in
//!   that of z) and scatters on is scored by `chain` alone, from the first vertex z whose ball it enters: x is drawn around the light,
//!   and the walk from there scores by these same rules, chains of its own included. The walk that entered by chance scores
//!   that light's motion no more ([`State::left`]).
//!
//! All other connections score as they are (`follows`).

use super::aim::{Aim, Turn};
use super::light_centred::Sight;
use super::record::{Event, MediumSpan, Recorder};
use super::state::State;
use super::transmit;
use super::twin::Twin;
use super::vertex::Vertex;
use super::walk::Walker;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, warp};
use crate::phase::one_minus_cos;
use crate::scene::{On, Scene};
use std::f64::consts::PI;

/// Radius of a ball over the distance from its vertex to the light.
const BESIDE: f64 = 0.5;

/// Probability of a walk around the light from each of the first two vertices of such a walk. From its (k+1)th on it is the k²th part: a walk begins
/// 0.3 (1 + π²/6) = 0.8 others on average at most, however many vertices it has, so that their number stays finite.
const CHAINS_OF_CHAINS: f64 = 0.3;

/// Whether `y` lies in the ball of `x`.
fn is_beside(scene: &Scene, light: u32, x: DVec3, y: DVec3) -> bool {
    let Some(p) = scene.lights[light as usize].center() else { return false };
    scene.embedded_selection(light) > 0.0 && (y - p).length_squared() < BESIDE * BESIDE * (x - p).length_squared()
}

/// Whether the motion of `light` is scored by an ordinary connection from the point `y`; `x` is the vertex before it if y lies in a
/// medium and its direction was drawn.
pub(super) fn follows<R: Recorder>(w: &Walker<R>, light: u32, left: u64, y: DVec3, x: Option<DVec3>) -> bool {
    R::ON
        && w.rec.follows(light).is_some_and(|bit| left & bit == 0)
        && !x.is_some_and(|x| is_beside(w.scene, light, x, y))
}

/// Bits of the lights whose ball around `x`'s view of them holds the next vertex `y`.
pub(super) fn entered<R: Recorder>(w: &Walker<R>, x: Option<DVec3>, y: DVec3) -> u64 {
    let (true, true, Some(x)) = (R::ON, w.scene.has_embedded_lights(), x) else { return 0 };
    (0..w.scene.lights.len() as u32)
        .filter_map(|l| w.rec.follows(l).filter(|_| is_beside(w.scene, l, x, y)))
        .fold(0, |bits, bit| bits | bit)
}

/// Score the balls of the vertex at `s.o`.
pub fn score<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex, twin: Option<&Twin>) {
    if R::ON && w.scene.has_embedded_lights() && w.may_scatter(s.depth + 1) {
        if s.depth + 1 >= w.set.min_order {
            ball(w, s, vertex, twin);
        }
        if w.may_scatter(s.depth + 2) {
            let chains = w.rec.chains(s.depth);
            if chains >= 1.0 || s.aside.uniform() < chains {
                chain(w, s, vertex, chains.min(1.0));
            }
        }
    }
}

/// A light whose motion a path still scores.
pub(super) struct Followed {
    pub light: u32,
    pub bit: u64,
    /// Probability of its choice.
    pub q: f64,
    pub p: DVec3,
}

pub(super) fn follow<R: Recorder>(w: &Walker<R>, s: &mut State) -> Option<Followed> {
    let (light, q) = w.scene.select_embedded_light(s.aside.uniform())?;
    let p = w.scene.lights[light as usize].center()?;
    let bit = w.rec.follows(light).filter(|bit| s.left & bit == 0)?;
    Some(Followed { light, bit, q, p })
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
fn ball<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex, twin: Option<&Twin>) {
    let scene = w.scene;
    let Some(Followed { light, q, p, .. }) = follow(w, s) else { return };
    let (u, v, z) = (s.aside.uniform(), s.aside.uniform(), s.aside.uniform());
    let radius = BESIDE * (p - s.o).length();
    let (r, n) = (radius * u * u, warp::sphere(v, z));
    // Two points, half each: a point and its twin, or its mirror image, with which what is odd about the light cancels.
    let other = twin.filter(|t| t.light == light).map_or(-n, |t| t.turn(n));
    if r <= 0.0 || !r.is_finite() || p + n * r == p || p + other * r == p {
        return;
    }
    let density = q / (radius * r).sqrt() / (4.0 * PI * r * r);
    let prefix = s.beta / s.r.mean();
    let side = w.rec.side_len();
    let at_light = Sight::new(w, s, vertex, p);
    for n in [n, other] {
        let y = p + n * r;
        let Some(a) = scene.arrival(light, y, 0.0, 0.0) else { continue };
        let at_y = Sight::new(w, s, vertex, y);
        // F without its phase function at the far end.
        let rest = |sight: &Sight, y: DVec3| {
            let m = &scene.media[sight.span.medium as usize];
            prefix * sight.tint * sight.transmittance * m.coefficients(y).1 * sight.per_length
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
            if let Some(clear) = transmit::shadow(w, Some(sight.span.medium), y, &on, &a, Some(&s.rng)) {
                let value = rest(sight, y) * clear.transmittance * phase(sight) * light_at_y;
                w.rec.push(Event::Aim { aim: Aim { within: clear.within, ..aim(sight) }, value });
            }
        }
        if let Some(sight) = &at_light {
            let h = rest(sight, p) * phase(sight);
            w.rec.push(Event::Aim { aim: Aim { model: true, ..aim(sight) }, value: -(h * light_at_y) });
            let flux = h * a.emission.color() * (2.0 * PI / q);
            w.rec.push(Event::Drift { slot: scene.lights[light as usize].place.position, v: -n, value: flux });
        }
    }
    s.aside.next_u64();
    // Their spans are nobody's: only motion was scored.
    w.rec.side_truncate(side);
}

/// A vertex x in the ball, density `~ r^-2`, and a walk from it: every path to the light that scatters at x and at least once more.
/// `probability`: of being called.
fn chain<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex, probability: f64) {
    let scene = w.scene;
    let Some(Followed { light, bit, q, p }) = follow(w, s) else { return };
    let (u, v, z) = (s.aside.uniform(), s.aside.uniform(), s.aside.uniform());
    let radius = BESIDE * (p - s.o).length();
    let r = radius * u;
    let x = p + warp::sphere(v, z) * r;
    if r <= 0.0 || !r.is_finite() || x == p {
        return;
    }
    let density = probability * q / radius / (4.0 * PI * r * r);
    let side = w.rec.side_len();
    let sight = Sight::new(w, s, vertex, x);
    w.rec.side_truncate(side);
    let Some(sight) = sight else { return };
    let medium = sight.span.medium;
    let sigma_s = scene.media[medium as usize].coefficients(x).1;
    let beta = s.beta / s.r.mean() * sight.tint * sight.transmittance * sigma_s * (sight.per_length / density);
    if beta.is_zero() {
        return;
    }
    // Streams of their own: the walk may draw any number.
    let own = Rng::keyed(s.aside.next_u64(), Purpose::Motion as u64, 1, 0);
    let mut next = State::new(own, x, sight.direction, Some(medium));
    next.aside = Rng::keyed(s.aside.next_u64(), Purpose::Motion as u64, 2, 0);
    (next.beta, next.start, next.depth) = (beta, beta.max(), s.depth + 1);
    Aims::walk(w, light, bit, s.depth, |sub| {
        sub.turn(&mut next, medium);
        sub.run(next);
    });
}

/// Keeps what scores the motion of one light, and nothing else.
pub(super) struct Aims<'a> {
    light: u32,
    bit: u64,
    /// Depth of the vertex that it left.
    from: u32,
    push: &'a mut dyn FnMut(Event),
}

impl Aims<'_> {
    /// A walk beside the path: what it scores of the light's motion goes to the path's record.
    pub fn walk<R: Recorder>(w: &mut Walker<R>, light: u32, bit: u64, from: u32, run: impl FnOnce(&mut Walker<Aims>)) {
        let mut push = |e| w.rec.push(e);
        let mut aims = Aims { light, bit, from, push: &mut push };
        let mut sub = Walker::new(w.scene, w.set, &mut aims);
        run(&mut sub);
        w.tally = w.tally.plus(&sub.tally);
    }
}

impl Recorder for Aims<'_> {
    const ON: bool = true;
    fn push(&mut self, e: Event) {
        if e.moves_a_light() {
            (self.push)(e);
        }
    }
    fn side_span(&mut self, _: MediumSpan) {}
    fn side_len(&self) -> u32 {
        0
    }
    fn side_truncate(&mut self, _: u32) {}
    fn checkpoint(&mut self, _: &Scene, _: &State) -> bool {
        false
    }
    fn follows(&self, light: u32) -> Option<u64> {
        (light == self.light).then_some(self.bit)
    }
    fn is_over(&self, state: &State) -> bool {
        state.left & self.bit != 0
    }
    fn chains(&self, depth: u32) -> f64 {
        let k = depth.saturating_sub(self.from + 1).max(1);
        CHAINS_OF_CHAINS / f64::from(k).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_walk_begins_less_than_one_other() {
        let mut push = |_| {};
        let aims = Aims { light: 0, bit: 1, from: 3, push: &mut push };
        let begun: f64 = (4..100_000).map(|depth| aims.chains(depth)).sum();
        assert!(begun > CHAINS_OF_CHAINS && begun < 0.8, "{begun}");
    }
}
