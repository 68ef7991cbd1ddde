//! Smooth interfaces on a walk: mirrored and refracted rays ([T] section 6.1).
//!
//! A ray that only such interfaces have turned since the camera is still a camera line, and treated like one ([`super::camera_line`]); at the first interface that it meets both
//! rays are followed (a faint mirrored one seldom), at any later one, and on all other paths, one of them, by its share of the light; but where a derivative may ask how that changes some always go through: near the critical angle
//! `1 - F ~ q` has the score `q⁻²`, which has no second moment under that probability ([`crate::scene::critical`]). Connections to lamps that cross interfaces are [`super::lamp`]'s; all else that lies behind is found by directions, whose
//! weight against connections is then whole.

use super::lamp::Passage;
use super::ray::Specular;
use super::record::{Event, Recorder};
use super::state::{Flight, Stage, State};
use super::walk::Walker;
use crate::math::DVec3;
use crate::scene::{Hit, On, Scene};
use crate::surface::{Ray, Surface};

/// The share of the light below which the ray mirrored at a camera line's first interface is followed in proportion to its root only: of faces between nearly equal indices.
const FAINT: f64 = 1e-4;
/// Interfaces in a row before paths begin to be given up: mirrors that face each other hold light for ever.
const IN_A_ROW: u32 = 64;
/// The least probability of going on through the first interface behind a vertex, on paths that look beside critical angles: there it divides the scores.
const LEAST_THROUGH: f64 = 0.5;
/// The least probability of a camera line's being mirrored at its first two interfaces.
const LEAST_MIRRORED: f64 = 1e-3;
/// Of them then go on at each.
const SURVIVE: f64 = 0.95;

/// Go on from a smooth surface.
pub(super) fn scatter<R: Recorder>(w: &mut Walker<R>, s: &mut State, hit: &Hit) {
    let k = s.depth + 1;
    if !w.may_scatter(k) {
        s.stage = Stage::Done;
        return;
    }
    let shape = &w.scene.shapes[hit.shape as usize];
    let (n, mut rays) = rays(&w.scene.surfaces[shape.surface as usize], hit, s.w);
    let behind = |r: &Ray| if r.through { shape.medium_behind(s.w, hit.n, s.medium) } else { s.medium };
    for ray in &mut rays {
        if ray.as_ref().is_some_and(|r| w.is_lost(k, behind(r))) {
            *ray = None;
        }
    }
    let tolerance = w.scene.tolerance(hit.p);
    let first = s.direct && s.depth == 0;
    // Of both rays only where nothing competes: on camera lines.
    let mut passage = match s.pdf_direction > 0.0 && w.seeks_lamps(s) {
        true => Some(Box::new(Passage::begin(s.vertex, s.w, s.pdf_direction))),
        false => s.passage.take(),
    };
    // The probability of the mirrored ray where one of two is followed.
    let f = match &rays {
        [Some(mirrored), Some(_)] if !first => {
            let f = share(w.scene, s, s.drawn.is_some(), mirrored);
            if R::ON && f != share(w.scene, s, false, mirrored) {
                s.stage = Stage::Reflect(*hit);
                w.part(s);
            }
            f
        }
        _ => 0.0,
    };
    s.depth = k;
    s.in_a_row += 1;
    s.o = hit.p;
    s.vertex = hit.p;
    s.tau = crate::math::Rgb::ZERO;
    s.flight = Flight::default();
    if s.in_a_row > IN_A_ROW {
        if s.rng.uniform() >= SURVIVE {
            s.stage = Stage::Done;
            return;
        }
        s.beta *= 1.0 / SURVIVE;
    }
    // `waits`: its chain begins when its turn comes.
    let mut follow = |s: &mut State, r: &Ray, p: f64, waits: bool| {
        s.on = left(&s.on, hit, s.w, r.through, tolerance);
        if r.through {
            s.medium = shape.medium_behind(s.w, hit.n, s.medium);
        }
        if R::ON {
            let event = Event::Specular(Specular { hit: *hit, n, w: s.w, out: r.w, through: r.through });
            if s.direct {
                s.lead.push(event);
            }
            if !waits {
                w.rec.push(event);
            }
        }
        s.passage = passage.take().and_then(|q| q.passes(hit, s.w, r.through));
        s.beta *= r.weight / p;
        s.start *= r.weight.max() / p;
        s.w = r.w;
        s.pdf_direction = 0.0;
        s.stage = if s.direct { Stage::Line } else { Stage::Fly };
    };
    match &rays {
        [None, None] => s.stage = Stage::Done,
        [Some(r), None] | [None, Some(r)] => follow(s, r, 1.0, false),
        [Some(mirrored), Some(refracted)] if first => {
            let p = (mirrored.weight.mean() / FAINT).sqrt().clamp(LEAST_MIRRORED, 1.0);
            if p == 1.0 || s.rng.uniform() < p {
                let mut other = s.branch();
                follow(&mut other, mirrored, p, true);
                follow(s, refracted, 1.0, false);
                s.pending = Some(other);
            } else {
                follow(s, refracted, 1.0, false);
            }
        }
        [Some(mirrored), Some(refracted)] => {
            if s.rng.uniform() < f {
                follow(s, mirrored, f, false);
            } else {
                follow(s, refracted, 1.0 - f, false);
            }
        }
    }
}

/// How often the mirrored one of two rays is followed, on paths that look beside critical angles or do not.
fn share(scene: &Scene, s: &State, beside: bool, mirrored: &Ray) -> f64 {
    let row = s.in_a_row;
    // Fewer at each further one, or weights of light that goes round in a block would multiply without bound.
    let least = if beside { LEAST_THROUGH / (1u64 << row.min(63)) as f64 } else { scene.least_through };
    // On a camera line the share may be as small as rounding, and still be all that is seen against the dark.
    mirrored.weight.mean().max(if s.direct && row <= 1 { LEAST_MIRRORED } else { 0.0 }).min(1.0 - least)
}

/// What a ray along w starts on behind the surface. Where faces coincide: what it has just left stays behind one that goes through, may be met again by one that is mirrored outside, and
/// is out of reach of one that is mirrored inside, unless that has just passed it.
pub(crate) fn left(on: &On, hit: &Hit, w: DVec3, through: bool, tolerance: f64) -> On {
    match (through, w.dot(hit.n) > 0.0) {
        (true, _) => on.crossed(hit, w, tolerance),
        (false, false) => On::at(hit),
        (false, true) if on.reaches(hit, w, tolerance) => On::at(hit),
        (false, true) => On::inside(hit),
    }
}

/// By the shading normal; by the geometric one where that would send rays to the wrong side. With the normal.
pub(crate) fn rays(surface: &Surface, hit: &Hit, w: DVec3) -> (DVec3, [Option<Ray>; 2]) {
    let rays = surface.rays(hit.ns, w);
    let came = hit.n.dot(w);
    let right = |r: &Ray| (hit.n.dot(r.w) * came > 0.0) == r.through;
    let both = hit.ns.dot(w) * came > 0.0 && rays.iter().flatten().all(right);
    if both { (hit.ns, rays) } else { (hit.n, surface.rays(hit.n, w)) }
}
