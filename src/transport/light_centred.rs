//! The light-centred connection: the next vertex is drawn around a light that stands in a medium, and connected to both.
//!
//! `∫ f_x T(x,y) σ_s(y) f_y T(y,p) I / (r² d²) dy` ([T] 5.4, 5.5; r = ‖y-p‖, d = ‖y-x‖) has two poles. Directions from x with equi-angular or
//! free-flight distances cancel the one at x; the rays of directions pass the light at distance h with density ~ h dh and score 1/h, so
//! their second moment still grows like a logarithm. Drawing y by a uniform direction and a half-Cauchy distance from the light,
//! `p(y) = 2R / (π (R² + r²)) / (4π r²)` with R = ‖x-p‖, cancels the pole at the light; the balance heuristic of the three bounds all [T] (61), (63).

use super::aim::{Aim, Turn};
use super::record::{Drawn, End, MediumSpan, Recorder};
use super::state::State;
use super::twin::Twin;
use super::vertex::{Toward, Vertex};
use super::walk::Walker;
use super::{beside, connect};
use super::{tracking, transmit};
use crate::math::{DVec3, Rgb, warp};
use crate::phase::one_minus_cos;
use crate::scene::{March, On, Scene};
use std::f64::consts::PI;

/// Density per volume of drawing a point at distance `r` from the light, for a vertex at distance `radius` from it.
fn density(r: f64, radius: f64) -> f64 {
    2.0 * radius / (PI * (radius * radius + r * r)) / (4.0 * PI * r * r)
}

/// The same as a density per length along the span that reached `y` from a vertex with a direction of known density.
pub fn density_per_length(scene: &Scene, light: u32, center: DVec3, y: DVec3, reach: Option<(DVec3, f64)>) -> f64 {
    let q = scene.embedded_selection(light);
    match reach {
        Some((x, p_direction)) if q > 0.0 => {
            let d2 = (y - x).length_squared();
            q * density((y - center).length(), (x - center).length()) * d2 / p_direction
        }
        _ => 0.0,
    }
}

/// A point y seen from a vertex through the medium around it.
pub struct Sight {
    pub direction: DVec3,
    /// Phase function or cosine at the vertex, per solid angle, over the squared distance; times `tint`.
    pub per_length: f64,
    pub tint: Rgb,
    /// The density of drawing the direction there, over the squared distance.
    pub density: f64,
    pub phase: Option<(u32, f64)>,
    pub transmittance: Rgb,
    /// Optical depth of homogeneous media on the way.
    pub tau: Rgb,
    /// The span that y lies in, whole, and where.
    pub span: MediumSpan,
    pub t: f64,
}

impl Sight {
    /// March from the vertex at `s.o` to y. Spans go to the record's side list.
    pub fn new<R: Recorder>(w: &mut Walker<R>, s: &State, vertex: &Vertex, y: DVec3) -> Option<Sight> {
        let scene = w.scene;
        let to_y = y - s.o;
        let d = to_y.length();
        if d <= 0.0 || !d.is_finite() {
            return None;
        }
        let direction = to_y / d;
        let Toward { lobe, phase } = vertex.toward(scene, s, direction);
        if lobe.f <= 0.0 {
            return None;
        }
        let (on, medium) = vertex.start(s, direction);
        let mut ray = March::new(s.o, direction, on, medium);
        let (mut transmittance, mut tau, mut crossings) = (Rgb::ONE, Rgb::ZERO, 0);
        loop {
            crossings += 1;
            if crossings > scene.max_interfaces {
                w.tally.missed_boundary += 1;
                return None;
            }
            let hit = ray.meets(scene, f64::INFINITY);
            let t1 = hit.as_ref().map_or(f64::INFINITY, |h| h.t);
            let left = ray.left(d);
            // What the point lies on does not block it.
            let holds = t1 >= scene.short_of(ray.o, left);
            if !holds && hit.is_none_or(|h| !scene.passes(&h)) {
                return None;
            }
            if let Some(span) = MediumSpan::ahead(&ray, f64::INFINITY, hit.as_ref()) {
                let part = span.until(left.min(t1));
                transmittance *= transmit::one_span(scene, &part);
                let m = &scene.media[span.medium as usize];
                if m.is_homogeneous() {
                    tau += tracking::depth(m, &part);
                }
                if R::ON {
                    w.rec.side_span(part);
                }
                if holds {
                    let (per_length, density) = (lobe.f / (d * d), lobe.pdf / (d * d));
                    let tint = lobe.tint;
                    return Some(Sight {
                        direction,
                        per_length,
                        tint,
                        density,
                        phase,
                        transmittance,
                        tau,
                        span,
                        t: left,
                    });
                }
            }
            if holds || transmittance.is_zero() {
                return None;
            }
            ray.pass(scene, &hit?);
        }
    }
}

/// A point that was drawn around a light, and how.
struct Centred {
    light: u32,
    center: DVec3,
    y: DVec3,
    /// Per volume.
    density: f64,
    u: [f64; 2],
    /// Of this connection in the light's motion.
    share: f64,
}

/// Connect the vertex at `s.o` to a light through a point drawn around that light.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex, twin: Option<&Twin>) {
    let scene = w.scene;
    if !scene.has_embedded_lights() || !w.may_scatter(s.depth + 1) {
        return;
    }
    let Some((light, q)) = scene.select_embedded_light(s.rng.uniform()) else { return };
    let (u, v, z) = (s.rng.uniform(), s.rng.uniform(), s.rng.uniform());
    let Some(center) = scene.lights[light as usize].center() else { return };
    let radius = (center - s.o).length();
    let r = radius * (0.5 * PI * u).tan();
    let y = center + warp::sphere(v, z) * r;
    if r <= 0.0 {
        return;
    }
    let mut c = Centred { light, center, y, density: q * density(r, radius), u: [v, z], share: 1.0 };
    if let Some(twin) = twin.filter(|t| t.light == light) {
        c.share = 0.5;
        let y = center + twin.turn(y - center);
        twin.score(w, |sub| Centred { y, ..c }.connect(sub, s, vertex));
    }
    c.connect(w, s, vertex);
}

impl Centred {
    fn connect<R: Recorder>(&self, w: &mut Walker<R>, s: &State, vertex: &Vertex) {
        let scene = w.scene;
        let Centred { light, center, y, density: own, u: [v, z], share } = *self;
        let first = w.rec.side_len();
        let Some(sight) = Sight::new(w, s, vertex, y) else { return };
        let lead = w.rec.side_len() - first;
        let Sight { span, t, per_length, density: p_direction, .. } = sight;
        let m = &scene.media[span.medium as usize];
        let (_, sigma_s) = m.coefficients(y);
        if sigma_s.is_zero() && !R::ON {
            return;
        }

        // The three techniques for y, per volume.
        let flight = scene.selection(light) * tracking::flight_density(m, &span, t) * p_direction;
        let angles = connect::angles(center, &span);
        let equi = if angles.usable() { scene.local_selection(light) * angles.density(t) * p_direction } else { 0.0 };
        let Some(a) = scene.arrival(light, y, v, z) else { return };
        let m2 = one_minus_cos(sight.direction, a.w);
        let weight = s.beta / s.r.mean()
            * sight.tint
            * sight.transmittance
            * (per_length * m.phase.eval(m2) * a.factor / (flight + equi + own));

        let Some(clear) = transmit::shadow(w, Some(span.medium), y, &On::default(), &a, Some(&s.rng)) else { return };
        let phases = [sight.phase, Some((span.medium, m2))];
        let aim = beside::follows(w, light, s.left, y, Some(s.o)).then(|| {
            let turn = Turn::Phase(span.medium, sight.direction);
            Aim {
                share,
                within: clear.within,
                ..Aim::new(light, y, Some(span.medium), On::default(), &a, turn, s.aside)
            }
        });
        let end = End::of(light, y, &a);
        let via = Drawn { medium: span.medium, p: y, sigma: sigma_s, span, lead };
        if let Some(value) =
            connect::score(w, &a, end, weight * clear.transmittance, s.depth + 1, first, phases, Some(via), aim)
        {
            vertex.scored(w.rec, sight.direction, value);
        }
    }
}
