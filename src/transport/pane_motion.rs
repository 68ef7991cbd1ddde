//! How a connection by a flat smooth face ([`super::pane`]) changes as its light moves ([T] 6.2), the counterpart of [`super::aim`].
//!
//! The vertex x and the face stay where they are. The point of crossing slides over the face, (46); direction and length of both lines, the light's share (42) and G (47) follow. All are formulas of
//! [`super::pane::reach`], here in dual numbers over the light's position, or over its direction if it is at infinity. What is left are scores on what turns:
//!
//! * scattering at x: `f'/f <-ω̇₁>`, ω₁ the direction of the light behind the face;
//! * a spot's profile: its slope times `<axis, ω̇₀>`, ω₀ the direction before the face;
//! * optical depths of both lines, ∫ <∇σ, ẏ> along them, with borders and ends as [`super::aim`] has them; the line before the face moves at both of its ends.
//!
//! All of it is linear in slots: forward and reverse mode read the same numbers.

use super::aim::{self, Line, Turn};
use super::pane::{Reach, reach};
use super::specular;
use crate::light::{LightKind, Origin};
use crate::math::rng::Rng;
use crate::math::{DVec3, Dual, Rgb, V3};
use crate::params::{ParamSet, Sink};
use crate::scene::{On, Scene};

/// A connection by a face to a light that moves.
#[derive(Clone, Copy, Debug)]
pub struct PaneAim {
    pub light: u32,
    /// Of the scene's panes.
    pub pane: u32,
    pub x: DVec3,
    /// Faces and medium at x, toward the face.
    pub on: On,
    pub medium: Option<u32>,
    pub turn: Turn,
    /// For points of line integrals through grids.
    pub rng: Rng,
}

/// Its three derivatives, by the numbers that it is a function of.
fn columns(v: V3<Dual<3>>) -> [DVec3; 3] {
    std::array::from_fn(|k| DVec3::new(v.x.d[k], v.y.d[k], v.z.d[k]))
}

/// Hand the partials of a connection of this `value` to `sink`: position, direction and angles of its light.
pub fn partials(scene: &Scene, params: &ParamSet, aim: &PaneAim, value: Rgb, sink: &mut impl Sink) {
    let (light, pane) = (&scene.lights[aim.light as usize], &scene.panes[aim.pane as usize]);
    let seeded = |v: DVec3| {
        let [x, y, z] = std::array::from_fn(|k| Dual::variable(v[k], k));
        V3::new(x, y, z)
    };
    let (from, slot) = match light.kind {
        LightKind::Point { position } | LightKind::Spot { position, .. } => {
            (Origin::Position(seeded(position)), light.place.position)
        }
        LightKind::Directional { direction } => (Origin::Infinity(seeded(direction)), light.place.direction),
        _ => return,
    };
    let surface = scene.surface_of(pane.shape);
    let Some(r) = reach(surface, pane, from, V3::constant(aim.x)) else { return };
    let (before, behind, at) = (columns(r.before), columns(r.behind), columns(r.at));
    let profile = aim::profile(light, params, -r.before.value(), value, true, sink);
    let turning = aim.turn.score(scene, -r.behind.value());
    let mut score: [Rgb; 3] = std::array::from_fn(|k| {
        let share = |g: Dual<3>| if g.v == 0.0 { 0.0 } else { g.d[k] / g.v };
        Rgb::from_fn(|c| share(r.gain[c])) + Rgb::splat(profile.dot(before[k])) - turning.dot(behind[k])
    });
    depths(scene, aim, &r, |k, d| score[k] += -d, &at, [&before, &behind]);
    aim::vector(params, slot, |k| value * score[k], sink);
}

/// How the optical depth of both lines changes, by each of the three numbers.
fn depths(
    scene: &Scene,
    aim: &PaneAim,
    r: &Reach<Dual<3>>,
    mut add: impl FnMut(usize, Rgb),
    at: &[DVec3; 3],
    [before, behind]: [&[DVec3; 3]; 2],
) {
    let pane = &scene.panes[aim.pane as usize];
    let mut rng = aim.rng;
    let [first, second] = [r.lengths[1], r.lengths[0]];
    // Back from x to the face.
    let line = Line { o: aim.x, w: -r.behind.value(), length: first.v, medium: aim.medium, on: aim.on, within: false };
    let mut changes = [Rgb::ZERO; 3];
    let passes = |v: DVec3, s: f64, sigma: Rgb| {
        (0..3).for_each(|k| add(k, sigma * -(s * v.dot(behind[k]))));
    };
    let growing = |sigma: Rgb| (0..3).for_each(|k| changes[k] += sigma * first.d[k]);
    let (medium, on) = aim::optical_depth(scene, &line, &mut rng, passes, growing);
    // From there to the light.
    let (w, p) = (line.w, r.at.value());
    let hit = scene.hit_at(p, pane.shape, pane.face);
    let on = specular::left(&on, &hit, w, r.through, scene.tolerance(p));
    let behind = || scene.shapes[pane.shape as usize].medium_behind(w, pane.n, medium);
    let medium = if r.through { behind() } else { medium };
    let line = Line { o: p, w: -r.before.value(), length: second.v, medium, on, within: false };
    let passes = |v: DVec3, s: f64, sigma: Rgb| {
        (0..3).for_each(|k| add(k, sigma * v.dot(at[k] - before[k] * s)));
    };
    let growing = |sigma: Rgb| (0..3).for_each(|k| changes[k] += sigma * second.d[k]);
    aim::optical_depth(scene, &line, &mut rng, passes, growing);
    (0..3).for_each(|k| add(k, changes[k]));
}
