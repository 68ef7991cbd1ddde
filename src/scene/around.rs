//! Which medium a place is in that no path has come to: an edge, a light, a beam's foot. Interfaces around it tell, or a camera.

use super::geometry::Medium;
use super::{Hit, Instance, March, On, Scene};
use crate::math::{DVec3, warp};
use crate::sensor::Sensor;
use crate::shape::Geometry;

/// What is known of places that no interface tells of: the medium beyond all of them, and the eye of a camera with what it stands in.
#[derive(Clone, Copy, Debug, Default)]
pub struct Around {
    pub outer: Option<u32>,
    eye: Option<(DVec3, Option<u32>)>,
}

/// Ways that are looked along from one point between walls for an interface that tells the medium, and how many points.
const WAYS: usize = 8;
const TURNS: usize = 16;
/// Where a line without an end is asked from for its medium, in scene radii.
const ASIDE: [f64; 4] = [1e-3, 1e-2, 1e-1, 1.0];
/// Multiples of these lie evenly in the unit square, however many: 1/ρ and 1/ρ², ρ³ = ρ + 1.
const EVENLY: [f64; 2] = [0.754_877_666_246_692_7, 0.569_840_290_998_053_2];

impl Scene {
    /// The medium beyond all interfaces, told by one that stands in `medium` at `o`.
    pub fn outer_medium(&self, o: DVec3, medium: Option<u32>) -> Option<u32> {
        let w = DVec3::new(0.36, 0.48, 0.8);
        let mut ray = March::new(o, w, On::default(), medium);
        for _ in 0..self.max_interfaces {
            let Some(h) = self.next_border(ray.o, w, f64::INFINITY, &ray.on) else { break };
            ray.pass(self, &h);
        }
        ray.medium
    }

    /// What this camera tells of places that no interface does; a vacuum without one.
    pub fn around(&self, sensor: Option<&Sensor>) -> Around {
        let eye = sensor.map(|s| (s.to_world.translation, s.medium));
        Around { outer: eye.and_then(|(o, medium)| self.outer_medium(o, medium)), eye }
    }

    /// The medium at `o` on a line along w that passes what is left out ([`Scene::opaque_past`]): told by the first interface either way along it that nothing opaque stands before; the outermost where
    /// the line has no end. What is on the other side of a wall tells nothing: between walls other ways are tried from the middle of the longest one so far. Nor does a line without an end where
    /// borders of media do (a pond that is a rectangle): what stands between it and the camera tells then.
    pub fn medium_past(&self, o: DVec3, w: DVec3, past: &[(u32, Vec<u32>)], around: &Around) -> Option<u32> {
        let (mut o, mut past, mut longest, mut escapes) = (o, past, (0.0, o), None);
        for k in 0..2 + TURNS * WAYS {
            let d = match k {
                0 => w,
                1 => -w,
                _ => warp::sphere((k as f64 * EVENLY[0]).fract(), (k as f64 * EVENLY[1]).fract()),
            };
            match self.told_along(o, d, f64::INFINITY, past) {
                (Some(medium), _) => return medium,
                (None, None) if !self.has_open_borders() => return around.outer,
                (None, None) => escapes = Some(d),
                (None, Some(h)) if h.t > longest.0 => longest = (h.t, o + d * (0.5 * h.t)),
                (None, Some(_)) => {}
            }
            match escapes {
                // The other way along the line may still tell.
                Some(d) if k > 0 => return self.told_by_eye(o, d, around).unwrap_or(around.outer),
                None if k % WAYS == 1 => (o, past, longest.0) = (longest.1, &[], 0.0),
                _ => {}
            }
        }
        // Whatever opaque stands before it.
        self.medium_before(o, w, f64::INFINITY).unwrap_or(around.outer)
    }

    /// The medium on a line along d from `o` that meets nothing, told by what stands between it and the eye; `None` where that is opaque.
    fn told_by_eye(&self, o: DVec3, d: DVec3, around: &Around) -> Option<Option<u32>> {
        let (eye, there) = around.eye?;
        // Near by first: borders that end somewhere are missed from far away.
        ASIDE.iter().find_map(|aside| {
            let p = o + d * (aside * self.bounds.radius());
            let distance = (eye - p).length();
            let toward = (eye - p) / distance;
            let (told, end) = self.told_along(p, toward, distance, &[]);
            told.or(end.is_none().then_some(there))
        })
    }

    /// The medium at `o`, told by the first interface along w that nothing opaque stands before, if there is one up to a limit; and what opaque ends the way.
    fn told_along(
        &self,
        o: DVec3,
        w: DVec3,
        limit: f64,
        past: &[(u32, Vec<u32>)],
    ) -> (Option<Option<u32>>, Option<Hit>) {
        let end = self.opaque_past(o, w, limit, past);
        // The end may be glass, and rounding put it on either side of the limit; not what the point itself lies on.
        let glass = end.filter(|h| self.parts_media(h.shape) && h.t > 2.0 * self.tolerance(o));
        let before = self.medium_before(o, w, end.map_or(limit, |h| h.t));
        (before.or_else(|| glass.map(|h| self.medium_at(&h, w))), end)
    }

    /// Whether a border of media ends somewhere, so that there is a way around it.
    fn has_open_borders(&self) -> bool {
        let is_open = |s: &Instance| s.boundary && !s.shape.is_closed();
        *self.open_borders.get_or_init(|| self.shapes.iter().any(is_open))
    }

    /// Whether a shape of some surface has media on both sides that light gets into.
    fn parts_media(&self, shape: u32) -> bool {
        let s = &self.shapes[shape as usize];
        s.boundary && self.surfaces[s.surface as usize].is_transparent()
    }

    /// The medium before a border of media that is met along w.
    fn medium_at(&self, h: &Hit, w: DVec3) -> Option<u32> {
        let shape = &self.shapes[h.shape as usize];
        if w.dot(h.n) > 0.0 { shape.interior } else { shape.exterior }
    }

    /// The next interface along w, null or glass, whether it parts media or not.
    fn next_border(&self, o: DVec3, w: DVec3, limit: f64, on: &On) -> Option<Hit> {
        let null = self.null.nearest(self, o, w, limit, on, Medium::Any);
        // Glass parts media, too.
        let glass = || {
            let met = self.opaque.nearest(self, o, w, null.map_or(limit, |n| n.0), on, Medium::Any)?;
            self.parts_media(met.1).then_some(met)
        };
        glass().or(null).map(|(t, shape, face)| self.hit(t, o + w * t, shape, face))
    }

    /// The medium at `o`, told by the first interface along w up to a limit; `None` where there is none.
    fn medium_before(&self, o: DVec3, w: DVec3, limit: f64) -> Option<Option<u32>> {
        let (mut o, mut on, mut left) = (o, On::default(), limit);
        for _ in 0..self.max_interfaces {
            let h = self.next_border(o, w, left, &on)?;
            if self.shapes[h.shape as usize].boundary {
                return Some(self.medium_at(&h, w));
            }
            on = on.crossed(&h, w, self.tolerance(h.p));
            (o, left) = (h.p, left - h.t);
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::compile::LoadOptions;
    use crate::scene::desc::SceneDesc;
    use std::path::Path;

    /// What is beyond all borders, told by a camera inside: glass is one too.
    #[test]
    fn beyond_a_block_of_glass_is_not_what_is_in_it() {
        for kind in ["null", "dielectric", "roughdielectric"] {
            let text = format!(
                r#"<scene version="3.0.0"><integrator type="volpath"/><medium type="homogeneous" id="water"/>
  <shape type="cube"><bsdf type="{kind}"/><ref name="interior" id="water"/></shape><emitter type="constant"/>
  <sensor type="perspective"><ref name="medium" id="water"/><film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film></sensor></scene>"#
            );
            let desc = SceneDesc::parse(&text, Path::new("block.xml"), &[]).unwrap();
            let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
            let sensor = scene.sensors.first();
            assert_eq!((scene.around(sensor).outer, sensor.and_then(|s| s.medium)), (None, Some(0)), "{kind}");
        }
    }

    /// Which of two lights, on either side of one large pane that turns any way and has water behind it, stand in the water, and which lines through them: nothing else bounds that.
    #[test]
    fn lights_in_water_that_ends_nowhere_are_known() {
        let kinds = ["null", "dielectric", "roughdielectric"].map(|kind| ["x", "y", "z"].map(|axis| (kind, axis)));
        for (kind, axis) in kinds.into_iter().flatten() {
            for angle in (0..360).step_by(45) {
                let text = format!(
                    r#"<scene version="3.0.0"><integrator type="volpath"/><medium type="homogeneous" id="water"/>
  <shape type="rectangle"><transform name="to_world"><scale value="50"/><translate z="1"/><rotate {axis}="1" angle="{angle}"/></transform>
    <bsdf type="{kind}"/><ref name="interior" id="water"/></shape>
  <emitter type="point"><transform name="to_world"><rotate {axis}="1" angle="{angle}"/></transform></emitter>
  <emitter type="point"><transform name="to_world"><translate z="2"/><rotate {axis}="1" angle="{angle}"/></transform></emitter>
  <sensor type="perspective"><transform name="to_world"><translate z="4"/><rotate {axis}="1" angle="{angle}"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/></film></sensor></scene>"#
                );
                let desc = SceneDesc::parse(&text, Path::new("pane.xml"), &[]).unwrap();
                let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
                let around = scene.around(scene.sensors.first());
                for d in (0..16).map(|k| warp::sphere((f64::from(k) + 0.5) / 16.0, (f64::from(k) * EVENLY[0]).fract()))
                {
                    let [within, before] = [0, 1].map(|i| {
                        let p = scene.lights[i].center().unwrap();
                        scene.medium_past(p, d, &[], &around)
                    });
                    assert_eq!([within, before], [Some(0), None], "{kind} {axis} {angle} {d}");
                }
                let [within, before] = [0, 1].map(|i| scene.embedded.probability(i));
                assert!(within == 1.0 && before == 0.0, "{kind} {axis} {angle}: {within} {before}");
            }
        }
    }
}
