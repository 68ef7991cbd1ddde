//! Points of a beam's hard edge, drawn from the vertices of a path (term H of [T] section 3, 5.3): the edge's other technique, beside the crossings of its spans ([`super::hard_beam`]).
//!
//! In the coordinates of the beam (ρ, φ on its plane, s along its column) the edge's integral as a vertex x sees it is `∫ dφ ds J R g`, g what a unit of volume there brings. Spans of directions
//! drawn with p(ω) cross it with the density `p(ω) |∂ρ/∂t| J R / d²`, which vanishes where they touch it and is small for narrow beams: by themselves they have no second moment. Points drawn in φ, and in s by the angle
//! seen from x ([`crate::scene::columns`]), have both; the balance heuristic shares the work out ([T] (61)).

use super::hard_beam;
use crate::light::LightKind;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::phase::one_minus_cos;
use crate::scene::Scene;
use crate::scene::beams::Way;
use crate::transport::light_centred::Sight;
use crate::transport::record::{Event, MediumSpan, PathRecord, Recorder};
use crate::transport::state::State;
use crate::transport::vertex::Vertex;
use crate::transport::walk::Walker;

/// What a point of an edge that was drawn from a vertex brings.
pub struct RimPoint {
    /// Index of the vertex's event.
    pub vertex: usize,
    pub way: usize,
    pub p: DVec3,
    /// On which it lies, whole.
    pub span: MediumSpan,
    /// `dr` of the edge brings `flux dr`.
    pub flux: Rgb,
}

/// A path without connections, and a point of an edge a vertex.
pub struct RimRecord {
    pub path: PathRecord,
    pub points: Vec<RimPoint>,
    /// Of the points: the path's own numbers stay as they are.
    rng: Rng,
}

impl RimRecord {
    pub fn new(path: PathRecord, rng: Rng) -> Self {
        RimRecord { path, points: Vec::new(), rng }
    }
}

/// Area of the edge per angle and length: `J R`.
fn measure(scene: &Scene, way: &Way) -> f64 {
    match scene.lights[way.light as usize].kind {
        LightKind::Beam { radius, .. } => radius * way.widening(),
        _ => 0.0,
    }
}

/// What a crossing of a span has of the point p: its direction was drawn as `reach` says, `slope` is `∂ρ/∂t`.
pub fn crossing_share(scene: &Scene, way: usize, p: DVec3, slope: f64, reach: Option<(DVec3, f64)>) -> f64 {
    let Some((x, p_direction)) = reach else { return 1.0 };
    let own = p_direction * slope.abs() * measure(scene, &scene.beams.ways[way]) / (p - x).length_squared();
    let drawn = scene.columns.edge_density(scene, way, x, p);
    if own > 0.0 { own / (own + drawn) } else { 0.0 }
}

impl Recorder for RimRecord {
    const ON: bool = true;
    const CONNECTS: bool = false;

    fn push(&mut self, e: Event) {
        self.path.push(e);
    }

    fn wants_ends(&self) -> bool {
        true
    }

    fn at_vertex(w: &mut Walker<Self>, s: &mut State, vertex: &Vertex) {
        let scene = w.scene;
        if scene.columns.is_empty() || !w.may_scatter(s.depth + 1) {
            return;
        }
        let numbers = [0; 3].map(|_| w.rec.rng.uniform());
        let Some((id, p)) = scene.columns.sample_edge(scene, s.o, numbers) else { return };
        let way = &scene.beams.ways[id];
        let order = s.depth + 1 + way.steps.len() as u32;
        if order < w.set.min_order || order >= w.set.max_depth {
            return;
        }
        let Some(sight) = Sight::new(w, s, vertex, p) else { return };
        let Sight { span, t, per_length, density: p_direction, .. } = sight;
        let medium = &scene.media[span.medium as usize];
        let source = medium.coefficients(p).1 * medium.phase.eval(one_minus_cos(sight.direction, -way.w));
        if source.is_zero() {
            return;
        }
        let Some(arrives) = hard_beam::arrives(scene, way, p, span.medium) else { return };
        let measure = measure(scene, way);
        let crossed = p_direction * hard_beam::slope(scene, way, &span, t).abs() * measure;
        let density = crossed + scene.columns.edge_density(scene, id, s.o, p);
        let weight = s.beta / s.r.mean() * sight.tint * sight.transmittance * (per_length * measure / density);
        // What scatters has just been recorded.
        let (vertex, flux) = (w.rec.path.events.len() - 1, weight * source * arrives);
        if !flux.is_zero() {
            w.rec.points.push(RimPoint { vertex, way: id, p, span, flux });
        }
    }
}
