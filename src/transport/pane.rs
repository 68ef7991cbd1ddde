//! Connections to point, spot and directional lights by one flat smooth face, refracted or mirrored ([T] 6.2, (44) to (49)): at every vertex, each such light by each face. Nothing is drawn.
//!
//! From a light at the height h₀ over a plane to a point at the height h₁ on its other side, their feet r apart, light crosses at the distance s from the light's foot where
//! (44) `g(s) = n₀ s/√(h₀²+s²) - n₁ (r-s)/√(h₁²+(r-s)²)` is 0. Both terms grow with s, and g is negative at 0 and positive at r: there is one solution always, between the
//! feet, and the sines of Snell's law at it are below 1 on both sides. (Fermat: the optical path is a strictly convex function of the point on the plane.) So a bracketed Newton
//! iteration finds all there is; whether the point lies on the face, and nothing else on the way, is for rays to say.
//!
//! A plane bends nothing, so that H of (45) is diagonal along r and across it, and (47) becomes, with nothing that cancels or divides by a distance,
//!
//! ```text
//! G = n₁² c₀ c₁ / [(n₀ c₀² d₁ + n₁ c₁² d₀) (n₀ d₁ + n₁ d₀)].
//! ```

use super::beam;
use super::record::{End, Event, Recorder};
use super::state::State;
use super::vertex::{Toward, Vertex};
use super::walk::Walker;
use super::way_motion::WayAim;
use crate::light::{Emission, Origin};
use crate::math::fresnel::{self, Interface};
use crate::math::{DVec3, Rgb, V3};
use crate::scene::Scene;
use crate::scene::beams::{Step, Way};
use crate::scene::panes::Pane;
use crate::surface::Surface;

/// Where light crosses a plane: the distance from the foot of its source, see above; heights > 0.
pub fn crossing(n0: f64, h0: f64, n1: f64, h1: f64, r: f64) -> f64 {
    let (mut lo, mut hi) = (0.0, r);
    let mut s = r * (h0 / (h0 + h1));
    // Each step that is not Newton's halves the bracket.
    for _ in 0..128 {
        let (a, b) = (h0.hypot(s), h1.hypot(r - s));
        let g = n0 * (s / a) - n1 * ((r - s) / b);
        let slope = n0 * (h0 / a).powi(2) / a + n1 * (h1 / b).powi(2) / b;
        if g > 0.0 {
            hi = s
        } else {
            lo = s
        }
        let next = s - g / slope;
        let next = if next >= lo && next <= hi { next } else { 0.5 * (lo + hi) };
        if (next - s).abs() <= 2.0 * f64::EPSILON * r {
            return next;
        }
        s = next;
    }
    s
}

/// Where on the way from foot to foot light crosses, between 0 and 1, and the distances before and behind; r2: the feet's distance squared. Also below the light, where they coincide.
fn crossed([n0, h0]: [f64; 2], [n1, h1]: [f64; 2], r2: f64) -> (f64, [f64; 2]) {
    let r = r2.sqrt();
    let u = if r > 0.0 { crossing(n0, h0, n1, h1, r) / r } else { n1 * h0 / (n0 * h1 + n1 * h0) };
    (u, [(h0 * h0 + u * u * r2).sqrt(), (h1 * h1 + (1.0 - u).powi(2) * r2).sqrt()])
}

/// G of one flat interface, [T] (47): solid angle at the light per area across the ray at the far point.
fn spread([n0, d0, c0]: [f64; 3], [n1, d1, c1]: [f64; 3]) -> f64 {
    n1 * n1 * c0 * c1 / ((n0 * c0 * c0 * d1 + n1 * c1 * c1 * d0) * (n0 * d1 + n1 * d0))
}

/// How light comes to a point by a face.
pub struct Reach {
    /// On the face's plane.
    pub at: DVec3,
    /// Directions of the light before and behind it.
    pub before: DVec3,
    pub behind: DVec3,
    pub through: bool,
    /// Irradiance across `behind` over intensity, or over irradiance for a light at infinity.
    pub gain: Rgb,
}

/// By the plane of a face, wherever the face ends; `None` where no light goes that way.
pub fn reach(surface: &Surface, pane: &Pane, from: Origin<f64>, x: DVec3) -> Option<Reach> {
    let Pane { p, n, .. } = *pane;
    let h = (x - p).dot(n);
    // The side that the light is on: > 0 in front.
    let height = match from {
        Origin::Position(q) => (q.value() - p).dot(n),
        Origin::Infinity(w) => -w.value().dot(n),
    };
    let (front, through) = (height > 0.0, height * h < 0.0);
    if height == 0.0 || h == 0.0 || through && !surface.is_transparent() {
        return None;
    }
    let [n0, n1] = match *surface {
        Surface::Dielectric { interior, exterior, .. } if front => [exterior, interior],
        Surface::Dielectric { interior, exterior, .. } => [interior, exterior],
        _ => [1.0; 2],
    };
    let share = |c: f64| match surface {
        Surface::Dielectric { .. } => {
            let f = Interface::new(c, n0, n1).reflectance();
            Rgb::splat(if through { 1.0 - f } else { f })
        }
        Surface::Conductor { eta, k, two_sided, .. } if front || *two_sided => {
            Rgb::from_fn(|i| fresnel::conductor(c, eta[i], k[i]))
        }
        _ => Rgb::ZERO,
    };
    let reach = match from {
        Origin::Position(q) => {
            let (q, h0, h1) = (q.value(), height.abs(), h.abs());
            let foot = q - n * height;
            let along = (x - n * h) - foot;
            let r2 = along.length_squared();
            // A mirror is what an interface between equal indices is, folded.
            let (u, [d0, d1]) = if through {
                crossed([n0, h0], [n1, h1], r2)
            } else {
                let u = h0 / (h0 + h1);
                let d = ((h0 + h1).powi(2) + r2).sqrt();
                (u, [d * u, d * (1.0 - u)])
            };
            let at = foot + along * u;
            let (c0, c1) = (h0 / d0, h1 / d1);
            let g = if through { spread([n0, d0, c0], [n1, d1, c1]) } else { (d0 + d1).powi(-2) };
            let (before, behind) = ((at - q).normalize(), (x - at).normalize());
            Reach { at, before, behind, through, gain: share(c0) * g }
        }
        Origin::Infinity(before) => {
            let (before, c0) = (before.value(), height.abs());
            let i = Interface::new(c0, n0, n1);
            let (behind, widening) = if through {
                let side = if front { n } else { -n };
                let behind = i.refract(V3::constant(before), V3::constant(side))?;
                (behind.value().normalize(), c0 / i.cos_refracted()?)
            } else {
                (before - n * (n.dot(before) * 2.0), 1.0)
            };
            let length = h / behind.dot(n);
            Reach { at: x - behind * length, before, behind, through, gain: share(c0) * widening }
        }
    };
    (!reach.gain.is_zero() && reach.gain.is_finite()).then_some(reach)
}

/// Score what all lights without extent bring to the vertex at `s.o` by one face.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene: &Scene = w.scene;
    // The vertex counts already; the face is one more.
    let order = s.depth + 1;
    if scene.panes.is_empty() || !w.may_scatter(order) || order < w.set.min_order {
        return;
    }
    for pane in &scene.panes {
        let surface = scene.surface_of(pane.shape);
        for (id, light) in scene.lights.iter().enumerate().filter(|(_, l)| l.is_delta()) {
            let Some(r) = light.origin().and_then(|f| reach(surface, pane, f, s.o)) else { continue };
            let Reach { at, before, behind, gain, .. } = r;
            // The light's own profile, toward the face.
            let Some(emission) = light.emission_toward(at) else { continue };
            let step =
                Step { shape: pane.shape, face: pane.face, p: pane.p, n: pane.n, before, behind, through: r.through };
            let way = Way { light: id as u32, steps: vec![step], w: behind, gain, source: None };
            score(w, s, vertex, &Found { way: &way, points: &[at], emission });
        }
    }
}

/// A way from a light to a vertex by smooth surfaces, its points from the last one to the first; its gain is all that the way makes of the light.
pub(super) struct Found<'a> {
    pub way: &'a Way,
    pub points: &'a [DVec3],
    pub emission: Emission,
}

/// What a face on the way leaves of the light: what it lets through, or mirrors.
pub(super) fn share(scene: &Scene, s: &Step) -> Rgb {
    let c = s.before.dot(s.n);
    match scene.surface_of(s.shape) {
        Surface::Dielectric { interior, exterior, .. } => {
            let [n0, n1] = if c < 0.0 { [exterior, interior] } else { [interior, exterior] };
            let f = Interface::new(c.abs(), *n0, *n1).reflectance();
            Rgb::splat(if s.through { 1.0 - f } else { f })
        }
        Surface::Conductor { eta, k, two_sided, .. } if !s.through && (c < 0.0 || *two_sided) => {
            Rgb::from_fn(|i| fresnel::conductor(c.abs(), eta[i], k[i]))
        }
        _ => Rgb::ZERO,
    }
}

/// Score it, if nothing stands on it.
pub(super) fn score<R: Recorder>(w: &mut Walker<R>, s: &State, vertex: &Vertex, f: &Found) {
    let (scene, toward) = (w.scene, -f.way.w);
    let Toward { lobe, phase } = vertex.toward(scene, s, toward);
    if lobe.f <= 0.0 {
        return;
    }
    let (on, medium) = vertex.start(s, toward);
    let first = w.rec.side_len();
    let clear = beam::clear(scene, f.way, f.points, (s.o, on, medium), &mut |span| {
        if R::ON {
            w.rec.side_span(span);
        }
    });
    let Some(t) = clear else {
        w.rec.side_truncate(first);
        return;
    };
    let weight = s.beta / s.r.mean() * lobe.tint * t * f.way.gain * lobe.f;
    let value = weight * f.emission.color();
    w.value += value;
    // Where vertices move derivatives find lamps by chance alone.
    if R::ON && f.way.source.is_some() && !w.rec.is_still() {
        w.rec.side_truncate(first);
        return;
    }
    w.rec.score(s.depth + f.way.steps.len() as u32, value);
    if R::ON {
        let (spans, phase) = (w.rec.side_len() - first, [phase, None]);
        let Found { way, points, emission } = *f;
        let (light, len, at) = (way.light, way.steps.len() as u32, points.last().copied().unwrap_or(s.o));
        let aims = w.rec.follows(light).is_some_and(|bit| s.left & bit == 0);
        let begin = w.rec.steps(&way.steps, aims);
        let end = End::Way { light, first: begin, len, at };
        w.rec.push(Event::Connect { weight, emission, end, first_span: first, spans, phase, via: None });
        vertex.scored(w.rec, toward, value);
        if aims {
            let (steps, turn) = ([begin, len], vertex.turn(s));
            let aim = WayAim { light, steps, first: at, x: s.o, on, medium, turn, rng: s.aside };
            w.rec.push(Event::WayAim { aim, value });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// [T] D4.
    #[test]
    fn the_reference_geometry_factor() {
        let (p, x) = (DVec3::new(0.3, 0.2, 1.2), DVec3::new(-0.2, 0.1, -0.8));
        let surface = Surface::Dielectric { interior: 1.33, exterior: 1.0, slot: 0 };
        let pane = Pane { shape: 0, face: 0, p: DVec3::ZERO, n: DVec3::Z };
        let Reach { at, before, behind, gain, .. } =
            reach(&surface, &pane, Origin::Position(V3::constant(p)), x).unwrap();
        assert!((at - DVec3::new(-0.03497444, 0.13300511, 0.0)).length() < 1e-8, "{at:?}");
        let f = Interface::new(-before.z, 1.0, 1.33).reflectance();
        assert!((gain[0] / (1.0 - f) - 0.286593902199).abs() < 1e-12, "{gain:?}");
        // Snell's law, and the same way back.
        assert!((before.z.mul_add(-before.z, 1.0).sqrt() - 1.33 * (1.0 - behind.z * behind.z).sqrt()).abs() < 1e-12);
    }

    /// One root, whatever the heights: Snell's law holds at it to rounding.
    #[test]
    fn crossings_of_all_sizes() {
        for (n0, n1) in [(1.0, 1.33), (1.5, 1.0), (1.0, 1.0 + 1e-9), (1.0, 4.0)] {
            for h0 in [1e-9, 1e-3, 1.0, 1e4] {
                for h1 in [1e-6, 0.3, 1e3] {
                    for r in [0.0, 1e-5, 1.0, 1e6] {
                        let s = crossing(n0, h0, n1, h1, r);
                        let sines = [n0 * s / h0.hypot(s), n1 * (r - s) / h1.hypot(r - s)];
                        // As far as s + ulp(r) says.
                        let blur = 4.0 * f64::EPSILON * r * (n0 / h0.hypot(s) + n1 / h1.hypot(r - s)) + 1e-14;
                        assert!(
                            (0.0..=r).contains(&s) && (sines[0] - sines[1]).abs() <= blur,
                            "{n0} {n1} {h0} {h1} {r}: {s} {sines:?}"
                        );
                    }
                }
            }
        }
        // Equal indices: a straight line.
        assert!((spread([1.2, 0.3, 0.8], [1.2, 0.5, 0.8]) - 1.0 / 0.64).abs() < 1e-14);
    }
}
