//! Transmittance along straight lines: shadow rays through null interfaces, one span at a time.
//!
//! Homogeneous: closed form. Grids: the exact integral of the interpolant, cell by cell, where it is rough; where it is smooth, which large grids are, shadow rays
//! go on by residual ratio tracking ([`crate::medium::grid::Grid::transmittance`]), with numbers of a stream beside the path's own: it takes a random number of them, which would cost
//! low-discrepancy sequences their evenness.
//! Within a span depths are added, one exponential is taken at the end (STABILITY rule 3).

use super::record::{MediumSpan, Recorder};
use super::tracking;
use super::walk::Walker;
use crate::light::Arrival;
use crate::math::rng::{Apart, Rng};
use crate::math::{DVec3, Rgb};
use crate::medium::Volume;
use crate::scene::{March, On, Scene};

/// The transmittance over one span, per channel.
pub fn one_span(scene: &Scene, span: &MediumSpan) -> Rgb {
    tracking::depth(&scene.media[span.medium as usize], span).map(|d| (-d).exp())
}

/// The same, an unbiased estimate whose cost does not follow the size of voxels. Spans whose transmittances are multiplied share one stream: begun anew for each it would not be independent.
fn estimate(scene: &Scene, span: &MediumSpan, random: &mut Apart) -> Rgb {
    let m = &scene.media[span.medium as usize];
    match &m.density {
        Volume::Grid(g) => Rgb(g.transmittance(span.o, span.w, span.t0, span.t1, m.scale, random)),
        Volume::Constant(_) => one_span(scene, span),
    }
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

/// The shadow ray of `a` from `p`; `None` where something opaque stands in between or nothing is left. `random`: the path's stream, where the transmittance may be an
/// estimate; nothing is taken from it.
pub fn shadow<R: Recorder>(
    w: &mut Walker<R>,
    medium: Option<u32>,
    p: DVec3,
    on: &On,
    a: &Arrival,
    random: Option<&Rng>,
) -> Option<Clear> {
    if w.scene.opaque_blocks(p, a, on) {
        return None;
    }
    through(w, medium, p, on, a, random)
}

/// The same where nothing opaque is known to stand in between.
pub fn through<R: Recorder>(
    w: &mut Walker<R>,
    medium: Option<u32>,
    p: DVec3,
    on: &On,
    a: &Arrival,
    random: Option<&Rng>,
) -> Option<Clear> {
    let scene = w.scene;
    let mut ray = March::new(p, a.w, *on, medium);
    let (mut t, mut tau) = (Rgb::ONE, Rgb::ZERO);
    let mut apart = random.map(Rng::apart);
    // Null interfaces only: whatever is opaque was asked above.
    for met in 0..scene.max_interfaces {
        let left = ray.left(a.distance);
        let hit = ray.boundary(scene, left);
        if let Some(span) = MediumSpan::ahead(&ray, left, hit.as_ref()) {
            t *= match &mut apart {
                Some(apart) => estimate(scene, &span, apart),
                None => one_span(scene, &span),
            };
            let m = &scene.media[span.medium as usize];
            if m.is_homogeneous() {
                tau += m.sigma_t.map(|x| if x == 0.0 { 0.0 } else { x * span.t1 });
            }
            if R::ON {
                w.rec.side_span(span);
            }
            if t.is_zero() {
                return None;
            }
        }
        let Some(h) = hit else { return Some(Clear { transmittance: t, depth: tau, within: met == 0 }) };
        ray.pass(scene, &h);
    }
    w.tally.missed_boundary += 1;
    None
}
