//! Edges in the picture: term E1 of [T] section 3, [T] (22).
//!
//! Where a pixel's filter W covers an outline seen by the camera, or a crease between two faces, the radiance jumps; as the outline moves over the
//! film, `∫ W <n,u̇> (L⁻ - L⁺) dl` is added. In angles at the camera: the unblocked side grows at the rate `-<n, ė-u>/d_e` ([T] (19); n
//! toward it; u: the velocity of e as a point of its film point's ray), and gains `L_unblocked - L_blocked` for what it grows.
//! Both radiances are followed with the same random numbers.

use super::ends;
use super::outline::Outlines;
use super::sheet::Partials;
use super::{Context, Motion, Room, Sample};
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::scene::Scene;
use crate::sensor::Sensor;
use crate::transport::line::Line;
use crate::transport::state::Stage;
use std::borrow::Cow;

pub const NAME: &str = "pixel_edge";

pub struct PixelEdge {
    outlines: Outlines,
    camera: bool,
}

impl PixelEdge {
    /// Outlines that move over the film; `None` if none can.
    pub fn prepare(scene: &Scene, sensor: &Sensor, motion: &Motion, margin: f64) -> Option<PixelEdge> {
        if !motion.surfaces() {
            return None;
        }
        let keep = |shape| motion.moving.camera || motion.moves(shape);
        let outlines = Outlines::of_camera(scene, motion, sensor, margin, keep)?;
        Some(PixelEdge { outlines, camera: motion.moving.camera })
    }
}

impl Room for PixelEdge {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, _: &mut Context, _: [f64; 2], _: &mut Rng, _: &mut dyn FnMut(&Sample)) {}

    fn guided_numbers(&self) -> usize {
        1
    }

    fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        let scene = cx.scene;
        let Some((ray, grazed, faces)) = self.outlines.sample(lead[0]) else { return };
        let e = ray.at(ray.near);
        let Some(q) = cx.sensor.project(e).filter(|q| cx.on_film(q.film)) else { return };
        let Some(touched) = ends::touched(scene, q.o, q.w, q.distance, grazed) else { return };
        let faces = match touched.is_empty() {
            true => faces,
            false => match ends::with_touched(scene, &faces, &touched, e, q.w, ray.n) {
                Some(faces) => Cow::Owned(faces),
                None => return,
            },
        };
        let Some(own) = ends::front(scene, &faces.own, &faces.lit, e, q.w, -ray.n) else { return };
        let lit = match faces.lit.is_empty() {
            true => scene.opaque_past(q.o, q.w, f64::INFINITY, grazed),
            false => ends::front(scene, &faces.lit, &faces.own, e, q.w, ray.n),
        };
        let toward = ends::edge_on(q.w, ray.n, grazed);
        let (stream, hide) = (Rng::keyed(rng.next_u64(), 0, 0, 0), cx.set.hide_emitters);
        let Some(front) = Line::clear(scene, q.o, q.w, q.distance, cx.sensor.medium) else { return };
        let (transmittance, medium) = (front.transmittance(), front.last);
        if transmittance.is_zero() {
            return;
        }
        let light = ends::radiance(cx, e, toward, Stage::Surface(own), medium, hide, stream);
        let blocked = light.shown(cx.set, 0);
        let light = match faces.lit.is_empty() {
            true => ends::beyond(cx, e, q.w, lit, medium, hide, stream),
            false => ends::radiance(cx, e, q.w, lit.map_or(Stage::Escape, Stage::Surface), medium, hide, stream),
        };
        let jump = transmittance * (light.shown(cx.set, 0) - blocked);

        let mut partials = Partials::default();
        ends::material(scene, grazed, e, -ray.n, &mut partials);
        if self.camera {
            partials.extend(cx.sensor.forms(e, ray.n));
        }
        emit(&Sample {
            film: q.film,
            flux: jump * (q.pixels_per_area * if ray.distant { 1.0 } else { ray.near }),
            partials: partials.as_slice(),
            film_per_sheet: 0.0,
            outward: ray.across,
        });
    }
}
