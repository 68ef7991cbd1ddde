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
use super::pane_motion::PaneAim;
use super::record::{End, Event, Recorder};
use super::vertex::{Toward, Vertex};
use super::walk::{State, Walker};
use crate::light::{Emission, Origin};
use crate::math::fresnel::{self, Interface};
use crate::math::{DVec3, Real, Rgb, V3};
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
///
/// In duals one Newton step with a constant slope is the implicit derivative [T] (46).
fn crossed<R: Real>([n0, h0]: [R; 2], [n1, h1]: [R; 2], r2: R) -> (R, [R; 2]) {
    let (m0, g0, m1, g1) = (n0.value(), h0.value(), n1.value(), h1.value());
    let r = r2.value().sqrt();
    let found = if r > 0.0 { crossing(m0, g0, m1, g1, r) / r } else { m1 * g0 / (m0 * g1 + m1 * g0) };
    let lengths = |u: R| [(h0 * h0 + u * u * r2).sqrt(), (h1 * h1 + (-u + 1.0).sqr() * r2).sqrt()];
    let u = R::from(found);
    let [d0, d1] = lengths(u);
    let snell = n0 * u / d0 - n1 * (-u + 1.0) / d1;
    let slope = m0 * g0 * g0 / d0.value().powi(3) + m1 * g1 * g1 / d1.value().powi(3);
    let u = u - (snell - snell.value()) / slope;
    (u, lengths(u))
}

/// G of one flat interface, [T] (47): solid angle at the light per area across the ray at the far point.
pub fn spread<R: Real>([n0, d0, c0]: [R; 3], [n1, d1, c1]: [R; 3]) -> R {
    n1 * n1 * c0 * c1 / ((n0 * c0 * c0 * d1 + n1 * c1 * c1 * d0) * (n0 * d1 + n1 * d0))
}

/// How light comes to a point by a face.
pub struct Reach<R> {
    /// On the face's plane.
    pub at: V3<R>,
    /// Directions of the light before and behind it, and distances there, the first infinite for a light at infinity.
    pub before: V3<R>,
    pub behind: V3<R>,
    pub lengths: [R; 2],
    pub through: bool,
    /// Irradiance across `behind` over intensity, or over irradiance for a light at infinity.
    pub gain: [R; 3],
}

/// A plane of glass or metal: a point of it, its normal, and the indices behind its front side and before it (of metal both 1).
pub struct Plane<R> {
    pub p: V3<R>,
    pub n: V3<R>,
    pub indices: [R; 2],
}

impl<R: Real> Plane<R> {
    pub fn of(surface: &Surface, pane: &Pane) -> Plane<R> {
        let indices = match surface {
            Surface::Dielectric { interior, exterior, .. } => [*interior, *exterior],
            _ => [1.0; 2],
        };
        Plane { p: V3::constant(pane.p), n: V3::constant(pane.n), indices: indices.map(R::from) }
    }
}

/// By the plane of a face, wherever the face ends; `None` where no light goes that way.
pub fn reach<R: Real>(surface: &Surface, pane: &Pane, from: Origin<R>, x: V3<R>) -> Option<Reach<R>> {
    reach_by(surface, Plane::of(surface, pane), from, x)
}

/// The same where the plane may move, and its indices change.
pub fn reach_by<R: Real>(surface: &Surface, plane: Plane<R>, from: Origin<R>, x: V3<R>) -> Option<Reach<R>> {
    let Plane { p, n, indices: [interior, exterior] } = plane;
    let h = (x - p).dot(n);
    // The side that the light is on: > 0 in front.
    let height = match from {
        Origin::Position(q) => (q - p).dot(n),
        Origin::Infinity(w) => -w.dot(n),
    };
    let (front, through) = (height.value() > 0.0, height.value() * h.value() < 0.0);
    if height.value() == 0.0 || h.value() == 0.0 || through && !surface.is_transparent() {
        return None;
    }
    let abs = |x: R| if x.value() < 0.0 { -x } else { x };
    let [n0, n1] = if front { [exterior, interior] } else { [interior, exterior] };
    let share = |c: R| match surface {
        Surface::Dielectric { .. } => {
            let f = Interface::new(c, n0, n1).reflectance();
            [if through { -f + 1.0 } else { f }; 3]
        }
        Surface::Conductor { eta, k, two_sided, .. } if front || *two_sided => {
            [0, 1, 2].map(|i| fresnel::conductor(c, R::from(eta[i]), R::from(k[i])))
        }
        _ => [R::zero(); 3],
    };
    let reach = match from {
        Origin::Position(q) => {
            let (h0, h1) = (abs(height), abs(h));
            let foot = q - n * height;
            let along = (x - n * h) - foot;
            let r2 = along.length_squared();
            // A mirror is what an interface between equal indices is, folded.
            let (u, lengths) = if through {
                crossed([n0, h0], [n1, h1], r2)
            } else {
                let u = h0 / (h0 + h1);
                let d = ((h0 + h1).sqr() + r2).sqrt();
                (u, [d * u, d * (-u + 1.0)])
            };
            let at = foot + along * u;
            let [d0, d1] = lengths;
            let (c0, c1) = (h0 / d0, h1 / d1);
            let g = if through { spread([n0, d0, c0], [n1, d1, c1]) } else { (d0 + d1).sqr().recip() };
            let (before, behind) = ((at - q).normalize(), (x - at).normalize());
            Reach { at, before, behind, lengths, through, gain: share(c0).map(|f| f * g) }
        }
        Origin::Infinity(before) => {
            let c0 = abs(height);
            let i = Interface::new(c0, n0, n1);
            let (behind, widening) = if through {
                let side = if front { n } else { -n };
                (i.refract(before, side)?.normalize(), c0 / i.cos_refracted()?)
            } else {
                (before - n * (n.dot(before) * 2.0), R::one())
            };
            let length = h / behind.dot(n);
            let lengths = [R::from(f64::INFINITY), length];
            Reach { at: x - behind * length, before, behind, lengths, through, gain: share(c0).map(|f| f * widening) }
        }
    };
    let gain = Rgb::from_fn(|c| reach.gain[c].value());
    (!gain.is_zero() && gain.is_finite()).then_some(reach)
}

/// Directions along which light that travels along w goes on past a face, on either side: straight, mirrored, refracted.
pub fn directions(surface: &Surface, pane: &Pane, w: DVec3) -> Vec<DVec3> {
    let behind = |side: f64| {
        let x = pane.p + pane.n * side;
        reach(surface, pane, Origin::Infinity(V3::<f64>::constant(w)), V3::constant(x)).map(|r| r.behind.value())
    };
    std::iter::once(w).chain([1.0, -1.0].into_iter().filter_map(behind)).collect()
}

/// Score what all lights without extent bring to the vertex at `s.o` by one face.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene: &Scene = w.scene;
    // The vertex counts already; the face is one more.
    let order = s.depth + 1;
    if scene.panes.is_empty() || !w.may_scatter(order) || order < w.set.min_order {
        return;
    }
    for (k, pane) in scene.panes.iter().enumerate() {
        let surface = scene.surface_of(pane.shape);
        for (id, light) in scene.lights.iter().enumerate().filter(|(_, l)| l.is_delta()) {
            let Some(r) = light.origin().and_then(|f| reach(surface, pane, f, V3::constant(s.o))) else { continue };
            let [at, before, behind] = [r.at, r.before, r.behind].map(V3::value);
            let gain = Rgb::from_fn(|c| r.gain[c]);
            // The light's own profile, toward the face.
            let Some(emission) = light.emission_toward(at) else { continue };
            let step =
                Step { shape: pane.shape, face: pane.face, p: pane.p, n: pane.n, before, behind, through: r.through };
            let way = Way { light: id as u32, steps: vec![step], w: behind, gain };
            let end = End::Pane { light: id as u32, pane: k as u32 };
            let Some(value) = score(w, s, vertex, &Found { way: &way, points: &[at], emission, end }) else { continue };
            if R::ON && w.rec.follows(id as u32).is_some_and(|bit| s.left & bit == 0) {
                let (light, pane, turn) = (id as u32, k as u32, vertex.turn(s));
                let (on, medium) = vertex.start(s, -behind);
                let aim = PaneAim { light, pane, x: s.o, on, medium, turn, rng: s.aside };
                w.rec.push(Event::PaneAim { aim, value });
            }
        }
    }
}

/// A way from a light to a vertex by smooth surfaces, its points from the last one to the first; its gain is all that the way makes of the light.
pub(super) struct Found<'a> {
    pub way: &'a Way,
    pub points: &'a [DVec3],
    pub emission: Emission,
    pub end: End,
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

/// Score it, if nothing stands on it. Returns what it adds.
pub(super) fn score<R: Recorder>(w: &mut Walker<R>, s: &State, vertex: &Vertex, f: &Found) -> Option<Rgb> {
    let (scene, toward) = (w.scene, -f.way.w);
    let Toward { lobe, phase } = vertex.toward(scene, s, toward);
    if lobe.f <= 0.0 {
        return None;
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
        return None;
    };
    let weight = s.beta / s.r.mean() * lobe.tint * t * f.way.gain * lobe.f;
    let value = weight * f.emission.color();
    w.value += value;
    w.rec.score(s.depth + f.way.steps.len() as u32, value);
    if R::ON {
        let (spans, phase) = (w.rec.side_len() - first, [phase, None]);
        let Found { emission, end, .. } = *f;
        w.rec.push(Event::Connect { weight, emission, end, first_span: first, spans, phase, via: None });
        vertex.scored(w.rec, toward, value);
    }
    Some(value)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{Dual, gradient};

    /// [T] D4, with its derivatives by the index, the light and the point.
    #[test]
    fn the_reference_geometry_factor() {
        let (p, x) = (DVec3::new(0.3, 0.2, 1.2), DVec3::new(-0.2, 0.1, -0.8));
        let surface = Surface::Dielectric { interior: 1.33, exterior: 1.0, slot: 0 };
        let pane = Pane { shape: 0, face: 0, p: DVec3::ZERO, n: DVec3::Z };
        let r: Reach<f64> = reach(&surface, &pane, Origin::Position(V3::constant(p)), V3::constant(x)).unwrap();
        let (at, before, behind) = (r.at.value(), r.before.value(), r.behind.value());
        assert!((at - DVec3::new(-0.03497444, 0.13300511, 0.0)).length() < 1e-8, "{at:?}");
        let f = Interface::new(-before.z, 1.0, 1.33).reflectance();
        assert!((r.gain[0] / (1.0 - f) - 0.286593902199).abs() < 1e-12, "{:?}", r.gain);
        // Snell's law, and the same way back.
        assert!((before.z.mul_add(-before.z, 1.0).sqrt() - 1.33 * (1.0 - behind.z * behind.z).sqrt()).abs() < 1e-12);

        let g = |n1: Dual<4>, px: Dual<4>, pz: Dual<4>, xz: Dual<4>| {
            let (n0, h1) = (Dual::constant(1.0), -xz);
            let r2 = (px - x.x).sqr() + (p.y - x.y).powi(2);
            let (_, [d0, d1]) = crossed([n0, pz], [n1, h1], r2);
            spread([n0, d0, pz / d0], [n1, d1, h1 / d1])
        };
        let at = [1.33, p.x, p.z, x.z];
        let (value, slopes) = gradient(at, |[n1, px, pz, xz]| g(n1, px, pz, xz));
        assert!((value - 0.286593902199).abs() < 1e-12);
        for (slope, truth) in slopes.iter().zip([0.1329363489, -0.07792992153, -0.2991988621, 0.2170320133]) {
            assert!((slope - truth).abs() < 1e-9, "{slopes:?}");
        }
    }

    /// Everything that a connection carries, by the light's position or direction, against differences; also right below a light.
    #[test]
    fn reaches_in_motion() {
        let pane = Pane { shape: 0, face: 0, p: DVec3::new(0.1, 0.0, 0.2), n: DVec3::new(0.2, -0.1, 1.0).normalize() };
        let glass = Surface::Dielectric { interior: 1.5, exterior: 1.0, slot: 0 };
        let (eta, k) = (Rgb([0.2, 0.9, 1.2]), Rgb::splat(2.5));
        let metal = Surface::Conductor { eta, k, two_sided: true, slot: 0 };
        let light = DVec3::new(0.4, -0.3, 1.4);
        let below = light - pane.n * ((light - pane.p).dot(pane.n) + 0.7);
        let points = [DVec3::new(-0.5, 0.8, -0.9), DVec3::new(1.0, -0.6, 0.9), below];
        let directions = [DVec3::new(0.3, 0.4, -1.0).normalize(), DVec3::new(-0.1, 0.2, 1.0).normalize()];
        let of = |from: DVec3, far: bool| {
            if far { Origin::Infinity(V3::constant(from)) } else { Origin::Position(V3::constant(from)) }
        };
        let lists = [(vec![light, light - pane.n * 3.0], false), (directions.to_vec(), true)];
        let mut compared = 0;
        for (sources, far) in lists {
            for (source, x) in sources.iter().flat_map(|&s| points.map(|x| (s, x))) {
                for surface in [&glass, &metal] {
                    let seeded: [Dual<3>; 3] = std::array::from_fn(|i| Dual::variable(source[i], i));
                    let v = V3::new(seeded[0], seeded[1], seeded[2]);
                    let dual = if far { Origin::Infinity(v) } else { Origin::Position(v) };
                    let Some(r) = reach(surface, &pane, dual, V3::constant(x)) else { continue };
                    let numbers = |r: &Reach<f64>| {
                        let v = [r.at, r.before, r.behind].map(|v| v.value().to_array()).concat();
                        [v, r.gain.to_vec(), vec![r.lengths[1], if far { 0.0 } else { r.lengths[0] }]].concat()
                    };
                    let slopes = |i: usize| {
                        let v = [r.at, r.before, r.behind].map(|v| [v.x.d[i], v.y.d[i], v.z.d[i]]).concat();
                        let ends = vec![r.lengths[1].d[i], if far { 0.0 } else { r.lengths[0].d[i] }];
                        [v, r.gain.map(|g| g.d[i]).to_vec(), ends].concat()
                    };
                    // Directions stay unit vectors.
                    for t in [DVec3::X, DVec3::Y, DVec3::Z].map(|t| if far { t - source * source.dot(t) } else { t }) {
                        let h = 1e-5;
                        let side = |s: f64| {
                            let moved = source + t * (s * h);
                            let moved = if far { moved.normalize() } else { moved };
                            numbers(&reach(surface, &pane, of(moved, far), V3::constant(x)).unwrap())
                        };
                        let (a, b) = (side(1.0), side(-1.0));
                        for (j, (a, b)) in a.iter().zip(&b).enumerate() {
                            let slope: f64 = (0..3).map(|i| slopes(i)[j] * t[i]).sum();
                            let fd = (a - b) / (2.0 * h);
                            assert!((slope - fd).abs() < 1e-6 * (1.0 + fd.abs()), "{source} {x} {j}: {slope} {fd}");
                            compared += 1;
                        }
                    }
                }
            }
        }
        assert!(compared > 500, "{compared}");
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
