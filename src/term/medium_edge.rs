//! Silhouettes seen from a medium: term E2 of [T] section 3, [T] (24), (25): lines that graze an edge and end at a medium point toward the camera
//! ([`super::grazing`]). Medium points move with their field ([T] (58)), so static edges near something that moves count as well.

use super::ends;
use super::grazing::Edges;
use super::light_walk::Vertex;
use super::sheet::Reach;
use super::{Context, Room, Sample};
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::scene::Scene;
use crate::sensor::Sensor;
use std::sync::Arc;

pub const NAME: &str = "medium_edge";

pub struct MediumEdge {
    edges: Arc<Edges>,
    reach: Reach,
}

impl MediumEdge {
    pub fn new(scene: &Scene, sensor: &Sensor, edges: &Arc<Edges>) -> MediumEdge {
        MediumEdge { edges: edges.clone(), reach: Reach::new(scene, sensor) }
    }
}

/// Whether any medium scatters.
pub fn is_needed(scene: &Scene) -> bool {
    scene.media.iter().any(|m| !m.sigma_s.is_zero())
}

impl Room for MediumEdge {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, _: &mut Context, _: [f64; 2], _: &mut Rng, _: &mut dyn FnMut(&Sample)) {}

    fn guided_numbers(&self) -> usize {
        5
    }

    fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        let scene = cx.scene;
        if cx.set.max_depth <= 1 {
            return;
        }
        let Some(g) = self.edges.sample(cx, false, lead) else { return };
        // One end is drawn by depth, or by the angle that it subtends at the camera.
        let eye: Vec<_> = self.reach.eye().map(|p| (p, 0.5)).into_iter().collect();
        let Some(s) = ends::medium_point(scene, &g.near_way, g.b(), -g.w(), &eye, lead[4], rng) else { return };
        if s.sigma_s.is_zero() {
            return;
        }
        let Some(far) = self.edges.far(cx, &g, rng).filter(|f| !f.light.is_zero()) else { return };
        let z = Vertex { p: s.p, w: -g.w(), medium: Some(s.medium), hit: None };
        let scale = s.transmittance * s.sigma_s * (g.scale / s.density);
        g.send(cx, &self.reach, z, s.distance, &far, scale, rng, emit);
    }
}
