//! The motion of zero-measure lights: how a connection from a fixed point y changes when the light at its end moves.
//!
//! A connection carries `T(y,p) f(y) I(w_l) / r^2` ([T] (28), (29)). With the light moving, its direction w turns by `ẇ = (ṗ - w<w,ṗ>)/r`
//! (distant light: `-ḋ`) and its length grows by `ṙ = <w,ṗ>`; the points of the segment move with their share of both. So every
//! factor hands out a covector on ẇ and a number on ṙ, [T] (31) for any medium:
//!
//! * scattering: `f'/f <w_in, ẇ>`, at a surface `<n,ẇ>/<n,w>`, at a rough one its own slope ([`crate::surface::rough`]);
//! * intensity of a spot: its slope times `-<axis, ẇ>`;
//! * inverse square: `-2/r ṙ`;
//! * optical depth: `σ(p) ṙ + ∫ s <∇σ,ẇ> ds - Σ over borders of Δσ s <n,ẇ>/<n,w>` ([T] (10), (13), (16) with the medium's own source left out).
//!
//! All vertices of a path stay where they are. Beside the light that is not integrable (`∂_p r^-2 ~ r^-3`); there
//! [`super::beside`] takes over, and connections of other techniques score no motion.

use super::record::MediumSpan;
use crate::light::{Arrival, Light, LightKind, spot_falloff};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb, gradient};
use crate::medium::{Medium, NO_SLOT, Volume};
use crate::params::{Covector, ParamSet, Sink, Slot};
use crate::phase::one_minus_cos;
use crate::scene::{March, On, Scene};
use crate::surface::{Normals, Surface};

/// What scatters at the start of a connection.
#[derive(Clone, Copy, Debug)]
pub enum Turn {
    /// Medium, direction of travel on arrival.
    Phase(u32, DVec3),
    /// Shading normal.
    Cosine(DVec3),
    /// Rough surface, normals, and where the path came from.
    Facets { surface: u32, normals: Normals, wi: DVec3 },
}

/// A connection to a light that moves.
#[derive(Clone, Copy, Debug)]
pub struct Aim {
    pub light: u32,
    pub y: DVec3,
    /// Medium and faces at y.
    pub medium: Option<u32>,
    pub on: On,
    /// Unit, toward the light; distance to it, infinite for distant lights.
    pub w: DVec3,
    pub distance: f64,
    pub turn: Turn,
    /// Of this connection among those that score the same motion ([`super::twin`]).
    pub share: f64,
    /// The homogeneous model beside the light: its position only, without optical depth.
    pub model: bool,
    /// The connection is known to meet no interface.
    pub within: bool,
    /// For points of line integrals through grids.
    pub rng: Rng,
}

impl Aim {
    pub fn new(light: u32, y: DVec3, medium: Option<u32>, on: On, a: &Arrival, turn: Turn, rng: Rng) -> Self {
        Aim { light, y, medium, on, w: a.w, distance: a.distance, turn, share: 1.0, model: false, within: false, rng }
    }
}

/// Hand the partials of a connection of this `value` to `sink`: position, direction and angles of its light.
pub fn partials(scene: &Scene, params: &ParamSet, aim: &Aim, value: Rgb, sink: &mut impl Sink) {
    let light = &scene.lights[aim.light as usize];
    let place = light.place;
    let (w, value) = (aim.w, value * aim.share);

    // On ẇ, and on ṙ.
    let mut turning = Covector::default();
    let mut growing = Rgb::ZERO;
    turning += aim.turn.score(scene, w).weighed(value);
    if !aim.model {
        let mut rng = aim.rng;
        let line = Line { o: aim.y, w, length: aim.distance, medium: aim.medium, on: aim.on, within: aim.within };
        let passes = |v, s: f64, sigma: Rgb| turning.add(v, -(value * (sigma * s)));
        optical_depth(scene, &line, &mut rng, passes, |sigma| growing += -(value * sigma));
    }
    turning.add(profile(light, params, w, value, !aim.model, sink), -value);
    match light.kind {
        LightKind::Point { .. } | LightKind::Spot { .. } => {
            let r = aim.distance;
            growing += value * (-2.0 / r);
            let along = turning.dot(w);
            vector(params, place.position, |k| (turning.0[k] - along * w[k]) / r + growing * w[k], sink);
        }
        LightKind::Directional { .. } => vector(params, place.direction, |k| -turning.0[k], sink),
        _ => {}
    }
}

impl Turn {
    /// `f'/f` as a covector on ẇ, w being the unit direction toward the light.
    pub(super) fn score(&self, scene: &Scene, w: DVec3) -> Covector {
        let mut score = Covector::default();
        match *self {
            Turn::Phase(medium, travel) => {
                let (f, df) = scene.media[medium as usize].phase.eval_with_slope(one_minus_cos(travel, w));
                // d(1-mu) = -<travel, ẇ>
                score.add(travel * (-df / f), Rgb::ONE);
            }
            Turn::Cosine(n) => score.add(n / n.dot(w), Rgb::ONE),
            Turn::Facets { surface, normals, wi } => {
                let Surface::Rough(rough) = &scene.surfaces[surface as usize] else { return score };
                return rough.slopes(normals, wi, w).map_or(score, |s| s.wo);
            }
        }
        score
    }
}

/// A spot's own profile in the direction -w: its score as a covector on the direction of the light, -ẇ. Partials by its axis and angles go to `sink` where they are `wanted`.
pub(super) fn profile(
    light: &Light,
    params: &ParamSet,
    w: DVec3,
    value: Rgb,
    wanted: bool,
    sink: &mut impl Sink,
) -> DVec3 {
    let LightKind::Spot { axis, beam, cutoff, .. } = light.kind else { return DVec3::ZERO };
    let (s, [ds, db, dc]) = gradient([-w.dot(axis), beam, cutoff], |[c, b, k]| spot_falloff(c, b, k));
    if s <= 0.0 {
        return DVec3::ZERO;
    }
    if wanted {
        let place = light.place;
        vector(params, place.direction, |k| value * (-ds / s * w[k]), sink);
        for (slot, d) in [(place.angles, db), (place.angles + 1, dc)] {
            if params.is_active(slot) {
                sink.add(slot, value * (d / s));
            }
        }
    }
    axis * (ds / s)
}

/// Three partials, if anyone wants them.
pub(crate) fn vector(params: &ParamSet, first: Slot, partial: impl Fn(usize) -> Rgb, sink: &mut impl Sink) {
    if first != NO_SLOT && params.block_active(first, 3) {
        (0..3).for_each(|k| sink.add(first + k as Slot, partial(k)));
    }
}

/// A straight piece of a connection: from o along w, in this medium and on these faces at o.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub o: DVec3,
    pub w: DVec3,
    pub length: f64,
    pub medium: Option<u32>,
    pub on: On,
    /// It is known to meet no interface.
    pub within: bool,
}

/// The derivative of its optical depth: triples `(v, s, weight)` with the meaning `weight <v, ẏ>`, y being the point at the distance s, and the
/// extinction at the end, which multiplies the growth of the length. Returns the ray behind the last border before that.
pub(super) fn optical_depth(
    scene: &Scene,
    line: &Line,
    rng: &mut Rng,
    mut passes: impl FnMut(DVec3, f64, Rgb),
    mut growing: impl FnMut(Rgb),
) -> March {
    let mut ray = March::new(line.o, line.w, line.on, line.medium);
    let mut entered = None;
    for _ in 0..scene.max_interfaces {
        let left = ray.left(line.length);
        let hit = if line.within { None } else { ray.boundary(scene, left) };
        let length = hit.as_ref().map_or(left, |h| h.t);
        if let Some(span) = MediumSpan::ahead(&ray, left, hit.as_ref()) {
            let part = Part { m: &scene.media[span.medium as usize], span, before: ray.before };
            let (t0, t1) = part.clipped();
            if t1 > t0 {
                // Each end: the medium's interface, the line's end, or the grid's own box, whichever ends the density there.
                let (at0, at1) = part.extinction_at_ends(t0, t1);
                if t0 > 0.0 {
                    part.border(t0, at0 * -1.0, part.box_normal(t0), &mut passes);
                } else if let Some(n) = entered {
                    part.border(0.0, at0 * -1.0, n, &mut passes);
                }
                if t1 < length {
                    part.border(t1, at1, part.box_normal(t1), &mut passes);
                } else if let Some(h) = &hit {
                    part.border(length, at1, h.n, &mut passes);
                } else if length < f64::INFINITY {
                    growing(at1);
                }
                part.interior(rng, &mut passes);
            }
        }
        let Some(h) = hit else { break };
        ray.pass(scene, &h);
        entered = Some(h.n);
    }
    ray
}

/// One medium's piece of a connection, `before` from its start.
struct Part<'a> {
    m: &'a Medium,
    span: MediumSpan,
    before: f64,
}

impl Part<'_> {
    fn clipped(&self) -> (f64, f64) {
        let s = &self.span;
        self.m.density_grid().map_or((s.t0, s.t1), |g| g.clip_ray(s.o, s.w, s.t0, s.t1))
    }

    /// Extinction just inside of the piece's ends; 0 at an infinite end.
    fn extinction_at_ends(&self, t0: f64, t1: f64) -> (Rgb, Rgb) {
        match &self.m.density {
            Volume::Constant(_) => (self.m.sigma_t, self.m.sigma_t),
            Volume::Grid(_) => {
                // A rounding of the way inside; the field is continuous there.
                let inset = (t1 - t0).min(f64::MAX) * 1e-9;
                let at = |t: f64| {
                    if t.is_finite() {
                        self.m.density.at(self.span.o + self.span.w * t) * self.m.scale
                    } else {
                        Rgb::ZERO
                    }
                };
                (at(t0 + inset), at(t1 - inset))
            }
        }
    }

    /// A border of normal n that cuts the ray at `t` moves along it by `-<n,ẏ>/<n,w>` [T] (13).
    fn border(&self, t: f64, sigma: Rgb, n: DVec3, passes: &mut impl FnMut(DVec3, f64, Rgb)) {
        let cos = n.dot(self.span.w);
        if !sigma.is_zero() && cos != 0.0 {
            passes(n, self.before + t, sigma * (-1.0 / cos));
        }
    }

    fn box_normal(&self, t: f64) -> DVec3 {
        self.m.density_grid().map_or(DVec3::ZERO, |g| g.border_normal(self.span.o + self.span.w * t))
    }

    /// `∫ <∇σ, ẏ> ds`: one uniform point a brick.
    fn interior(&self, rng: &mut Rng, passes: &mut impl FnMut(DVec3, f64, Rgb)) {
        let (Some(grid), s) = (self.m.density_grid(), &self.span) else { return };
        for brick in grid.spans(s.o, s.w, s.t0, s.t1) {
            if brick.constant || brick.t1 <= brick.t0 {
                continue;
            }
            let length = brick.t1 - brick.t0;
            let t = brick.t0 + rng.uniform() * length;
            let gradients = grid.gradient3(s.o + s.w * t);
            let (s, weight) = (self.before + t, length * self.m.scale);
            if grid.channels() == 1 {
                passes(gradients[0], s, Rgb::splat(weight));
            } else {
                (0..3).for_each(|c| passes(gradients[c], s, Rgb::channel(c, weight)));
            }
        }
    }
}
