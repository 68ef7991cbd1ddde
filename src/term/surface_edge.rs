//! Silhouettes seen from surfaces: term E3 of [T] section 3, [T] (24), (25): lines that graze an edge and end on a surface toward the camera
//! ([`super::grazing`]).

use super::grazing::Edges;
use super::light_walk::Vertex;
use super::sheet::Reach;
use super::{Context, Room, Sample};
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::scene::Scene;
use crate::sensor::Sensor;
use crate::surface::Surface;
use std::sync::Arc;

pub const NAME: &str = "surface_edge";

pub struct SurfaceEdge {
    edges: Arc<Edges>,
    reach: Reach,
}

impl SurfaceEdge {
    pub fn new(scene: &Scene, sensor: &Sensor, edges: &Arc<Edges>) -> SurfaceEdge {
        SurfaceEdge { edges: edges.clone(), reach: Reach::new(scene, sensor) }
    }
}

/// Whether any surface reflects.
pub fn is_needed(scene: &Scene) -> bool {
    scene.shapes.iter().any(|s| match &scene.surfaces[s.surface as usize] {
        Surface::Diffuse { reflectance, .. } => !reflectance.is_zero(),
        Surface::Rough(_) => true,
        _ => false,
    })
}

impl Room for SurfaceEdge {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, _: &mut Context, _: [f64; 2], _: &mut Rng, _: &mut dyn FnMut(&Sample)) {}

    fn guided_numbers(&self) -> usize {
        4
    }

    fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        let scene = cx.scene;
        if cx.set.max_depth <= 1 {
            return;
        }
        let Some(g) = self.edges.sample(cx, true, lead) else { return };
        let Some(s) = g.near.filter(|s| s.t > 0.0 && scene.reflects(s)) else { return };
        let shape = &scene.shapes[s.shape as usize];
        let transmittance = g.near_way.transmittance();
        if !scene.surfaces[shape.surface as usize].reflects(s.ns, g.w()) || transmittance.is_zero() {
            return;
        }
        let Some(far) = self.edges.far(cx, &g, rng).filter(|f| !f.light.is_zero()) else { return };
        let z = Vertex { p: s.p, w: -g.w(), medium: g.near_way.last, hit: Some(s) };
        g.send(cx, &self.reach, z, s.t, &far, transmittance * g.scale, rng, emit);
    }
}
