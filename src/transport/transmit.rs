//! Transmittance along straight lines: shadow rays through null interfaces, one span at a time.
//!
//! Homogeneous: closed form. Grids, brick by brick: the exact integral of the interpolant where the brick's residual is thick
//! (its variance would cost more than its cells), residual ratio tracking against the brick's own minimum and maximum elsewhere
//! [T] 8.1. Depths are added, one exponential is taken at the end (STABILITY rule 3).

use super::record::{MediumSpan, Recorder};
use super::walk::Walker;
use crate::light::Arrival;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::medium::Volume;
use crate::scene::{On, Scene};

/// Residual depth of a brick beyond which it is integrated exactly.
const EXACT_RESIDUAL: f64 = 0.5;

/// An unbiased estimate of the transmittance over one span, per channel.
pub fn one_span(scene: &Scene, span: &MediumSpan, rng: &mut Rng) -> Rgb {
    let m = &scene.media[span.medium as usize];
    match &m.density {
        Volume::Constant(_) => depth_to_transmittance(m.sigma_t, span.t1 - span.t0),
        Volume::Grid(grid) => {
            let mut depth = Rgb::ZERO;
            let mut ratio = Rgb::ONE;
            let mut bricks = grid.spans(span.o, span.w, span.t0, span.t1);
            while let Some(brick) = bricks.next() {
                if brick.max <= 0.0 {
                    continue;
                }
                let length = brick.t1 - brick.t0;
                let residual = (brick.max - brick.min) * m.scale;
                if brick.constant || scene.exact_transmittance || residual * length > EXACT_RESIDUAL {
                    depth += bricks.integrate(&brick) * m.scale;
                    continue;
                }
                depth += Rgb::splat(brick.min * m.scale * length);
                if residual <= 0.0 {
                    continue;
                }
                let mut t = brick.t0;
                loop {
                    t += rng.exponential() / residual;
                    if t >= brick.t1 {
                        break;
                    }
                    let sigma = m.density.at(span.o + span.w * t);
                    ratio *= sigma.map(|x| 1.0 - (x - brick.min) * m.scale / residual);
                }
            }
            depth.map(|d| (-d).exp()) * ratio
        }
    }
}

/// `exp(-sigma t)` with `0 * infinity = 0`.
pub fn depth_to_transmittance(sigma: Rgb, t: f64) -> Rgb {
    sigma.map(|s| if s == 0.0 { 1.0 } else { (-s * t).exp() })
}

/// A way on which nothing opaque stands.
#[derive(Clone, Copy, Debug)]
pub struct Clear {
    pub transmittance: Rgb,
    /// Optical depth of its homogeneous spans.
    pub depth: Rgb,
    /// It meets no interface.
    pub within: bool,
}

/// The shadow ray of `a` from `p`; `None` where something opaque stands in between or nothing is left.
pub fn shadow<R: Recorder>(
    w: &mut Walker<R>,
    rng: &mut Rng,
    medium: Option<u32>,
    p: DVec3,
    on: &On,
    a: &Arrival,
) -> Option<Clear> {
    if w.scene.opaque_blocks(p, a, on) {
        return None;
    }
    through(w, rng, medium, p, on, a)
}

/// The same where nothing opaque is known to stand in between.
pub fn through<R: Recorder>(
    w: &mut Walker<R>,
    rng: &mut Rng,
    medium: Option<u32>,
    p: DVec3,
    on: &On,
    a: &Arrival,
) -> Option<Clear> {
    let scene = w.scene;
    let (mut o, mut on, mut medium, mut left) = (p, *on, medium, a.distance);
    let (mut t, mut tau) = (Rgb::ONE, Rgb::ZERO);
    // Null interfaces only: whatever is opaque was asked above.
    for met in 0..scene.max_interfaces {
        let hit = scene.boundary(o, a.w, left, &on, medium);
        let length = hit.as_ref().map_or(left, |h| h.t);
        if let Some(id) = medium {
            let span = MediumSpan::new(id, o, a.w, length, &on, hit.as_ref());
            t *= one_span(scene, &span, rng);
            let m = &scene.media[id as usize];
            if m.is_homogeneous() {
                tau += m.sigma_t.map(|x| if x == 0.0 { 0.0 } else { x * length });
            }
            if R::ON {
                w.rec.side_span(span);
            }
            if t.is_zero() {
                return None;
            }
        }
        let Some(h) = hit else { return Some(Clear { transmittance: t, depth: tau, within: met == 0 }) };
        let shape = &scene.shapes[h.shape as usize];
        medium = shape.medium_behind(a.w, h.n, medium);
        on = on.crossed(&h, scene.tolerance(h.p));
        o = h.p;
        left -= h.t;
    }
    w.tally.missed_boundary += 1;
    None
}
