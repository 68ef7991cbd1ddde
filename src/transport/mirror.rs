//! Mirrored paths: what follows the first vertex of a camera path, in pairs whose noise cancels.
//!
//! The first vertex x slides on its film point's ray, by e along its face ([`super::first`]); a point y of the medium behind it does not, where it is further away than the ball that carries e. What
//! they send each other then scores `2 <e, y-x> / |y-x|²`: odd under a half turn of y about the face's normal at x, and large where faces are small and y is near, although light from
//! either side is nearly the same. Behind a diffuse surface a path that turns off about the normal by half a turn is as probable as the path itself and takes
//! the same random numbers, so each counts half, and the odd part is left with what light varies by between the two. Phase functions are not symmetric about that axis: with the
//! densities p of the direction and p' of the turned one, the second path is walked with the probability min(1, p'/p); p times that is symmetric, so the mean is the same.
//!
//! Only derivatives ask for the other path; the picture's own is the first.

use super::record::{Event, Recorder};
use super::state::{Stage, State};
use super::walk::Walker;
use crate::math::DVec3;
use crate::scene::{Hit, Scene};
use crate::shape::edges::to_border;
use crate::surface::Surface;

/// How far away from what slides paths are walked in pairs: in mean free paths, or in the scene's diameters where those are shorter.
const NEAR: f64 = 0.05;

/// Whether what follows this vertex is walked in pairs at all; it depends on nothing behind it.
fn fits<R: Recorder>(w: &Walker<R>, s: &State) -> bool {
    R::ON && s.depth == 1 && w.scene.critical.is_empty() && w.may_scatter(2)
}

/// How far away from what slides pairs are worth their time.
fn near(scene: &Scene, medium: u32, p: DVec3) -> f64 {
    NEAR * (1.0 / scene.media[medium as usize].coefficients(p).0.max()).min(2.0 * scene.bounds.radius())
}

/// The axis of pairs behind a first vertex on a surface.
pub fn at_surface<R: Recorder>(w: &Walker<R>, s: &State, hit: &Hit, surface: &Surface) -> Option<DVec3> {
    let medium = s.medium.filter(|_| fits(w, s) && w.rec.mirrors().is_some_and(|f| f.slides(hit.shape)))?;
    let diffuse = matches!(surface, Surface::Diffuse { .. });
    let border = || to_border(&w.scene.shapes[hit.shape as usize].shape, hit.face, hit.p);
    (diffuse && border() < near(w.scene, medium, hit.p)).then_some(hit.ns)
}

/// The axis of pairs behind a first vertex in a medium: toward the nearest of what slides.
pub fn in_medium<R: Recorder>(w: &Walker<R>, s: &State, medium: u32) -> Option<DVec3> {
    let facts = w.rec.mirrors().filter(|_| fits(w, s))?;
    let found = facts.nearest_sliding(w.scene, s.o, near(w.scene, medium, s.o))?;
    (s.o - found.p).try_normalize()
}

/// The path goes on from this state and, mirrored, from another: put that one behind this one, made to `leave`, and halve both.
pub fn split<R: Recorder>(w: &mut Walker<R>, s: &mut State, own: Option<Event>, leave: impl FnOnce(&mut State)) {
    let Some(lead) = w.rec.chain_so_far() else { return };
    // By powers of two: doubled again, the picture has the same bits.
    w.value *= 0.5;
    s.beta *= 0.5;
    s.start *= 0.5;
    let mut other = s.clone();
    leave(&mut other);
    other.stage = Stage::Fly;
    other.lead = lead.into_iter().chain(own).collect();
    other.mirrored = Some(Box::new(s.aside));
    s.pending = Some(Box::new(other));
}

/// A direction, turned about the axis by half a turn.
pub fn turned(axis: DVec3, w: DVec3) -> DVec3 {
    axis * (2.0 * axis.dot(w)) - w
}
