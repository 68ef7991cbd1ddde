//! The ends of a segment that grazes an edge: what light leaves the far one, by number of scatterings, and how either moves.

use super::Context;
use super::sheet::Partials;
use crate::math::rng::Rng;
use crate::math::{DVec2, DVec3, Rgb};
use crate::params::Partial;
use crate::scene::{Hit, Scene, Settings};
use crate::sensor::Sensor;
use crate::shape::{Geometry, Shape};
use crate::transport::record::{Event, MediumSpan, Recorder};
use crate::transport::walk::{Stage, State, Walker};

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

    pub fn is_zero(&self) -> bool {
        self.0.iter().all(|x| x.is_zero())
    }
}

impl Recorder for ByOrder {
    const ON: bool = false;
    fn push(&mut self, _: Event) {}
    fn side_span(&mut self, _: MediumSpan) {}
    fn side_len(&self) -> u32 {
        0
    }
    fn side_truncate(&mut self, _: u32) {}
    fn checkpoint(&mut self, _: &Scene, _: &State) -> bool {
        false
    }
    fn score(&mut self, order: u32, value: Rgb) {
        self.add(order, value);
    }
}

/// An unbiased estimate of the radiance that arrives against `w` from the surface hit, or from beyond the scene. Lamps may be hidden from the
/// camera (`hide`), not from what they light.
pub fn radiance(cx: &mut Context, o: DVec3, w: DVec3, hit: Option<Hit>, hide: bool, rng: Rng) -> ByOrder {
    // How many scatterings count is asked later.
    let set = Settings { hide_emitters: hide, min_order: 0, ..*cx.set };
    let mut s = State::new(rng, o, w, None);
    s.stage = match hit {
        Some(h) => Stage::Surface(h),
        None => Stage::Escape,
    };
    let mut found = ByOrder::default();
    let mut walker = Walker::new(cx.scene, &set, &mut found);
    walker.run(s);
    cx.tally = cx.tally.plus(&walker.tally);
    found
}

/// `<c, v>` of a point that goes with a shape.
pub fn material(scene: &Scene, shape: u32, p: DVec3, c: DVec3) -> [Partial; 4] {
    scene.shapes[shape as usize].mover.forms(p, c)
}

/// `<c, ẋ>` of the hit x of the camera ray along w, whose film point is fixed [T] (60).
pub fn film_fixed(scene: &Scene, sensor: &Sensor, hit: &Hit, w: DVec3, c: DVec3, out: &mut Partials) {
    let along = hit.n * (c.dot(w) / hit.n.dot(w));
    out.extend(material(scene, hit.shape, hit.p, along));
    out.extend(sensor.forms(hit.p, c - along));
}

/// How far from an edge toward the middle of its face radiance is asked for, as a share of the way.
const OFF_THE_EDGE: f64 = 1e-6;

/// Of faces (shape, face) on one side of an outline, the one that a ray along w sees first when it passes the point e a little off the side
/// that n points to.
pub fn front(scene: &Scene, faces: &[(u32, u32)], e: DVec3, w: DVec3, n: DVec3) -> Option<Hit> {
    let depth = |&(shape, face): &(u32, u32)| {
        let m = scene.shapes[shape as usize].shape.normal(face, e);
        -m.dot(n) / m.dot(w)
    };
    let &(shape, face) = faces.iter().min_by(|a, b| depth(a).total_cmp(&depth(b)))?;
    // On the very edge rays would start on its other face, too.
    let instance = &scene.shapes[shape as usize];
    let p = match &instance.shape {
        Shape::Sphere(_) => e,
        Shape::Mesh(m) => {
            let [a, b, c] = m.corners(face);
            e.lerp((a + b + c) / 3.0, OFF_THE_EDGE)
        }
        flat => e.lerp(flat.position(face, DVec2::splat(0.5)), OFF_THE_EDGE),
    };
    Some(scene.hit_at(p, shape, face))
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
