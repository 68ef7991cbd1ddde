//! Boundary rooms: the parts of a derivative that come from moving discontinuities, one term a file ([T] section 3).
//!
//! A room hands out [`Sample`]s: where on the film, how much, and how it depends on which slots. It knows neither the mode (forward or
//! reverse), nor the pixels' filter, nor the list of parameters. Two techniques reach the same point of a moving sheet: along a
//! camera ray (its crossings with the sheet, exact), and from the sheet outward. Whoever adds the samples up weighs them by
//! [`Sample::weigh`], the balance heuristic in film space.

pub mod arcs;
pub mod crossings;
pub mod edge_set;
pub mod ends;
pub mod hard_profile;
pub mod light_shadow;
pub mod light_walk;
pub mod outline;
pub mod pixel_edge;
pub mod sheet;
pub mod sheet_samples;
pub mod surface_edge;

use crate::error::{Error, Result};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::{Mover, ParamSet, Partial, Slot};
use crate::scene::{Scene, Settings};
use crate::sensor::Sensor;
use crate::shape::Shape;
use crate::transport::Tally;

/// One sample of a boundary term.
#[derive(Clone, Copy, Debug)]
pub struct Sample<'a> {
    /// Film point in pixels; may lie outside of the film.
    pub film: [f64; 2],
    /// What a unit of the sheet's measure adds to a unit of film (pixel^-2), without filter and density.
    pub flux: Rgb,
    /// `d pixel / d slot = flux v`.
    pub partials: &'a [Partial],
    /// Film area (pixels^2) that a camera ray sees of a unit of the sheet; 0 where no camera ray finds the point.
    pub film_per_sheet: f64,
    /// Density, per unit of the sheet, of drawing this point outward.
    pub outward: f64,
}

impl Sample<'_> {
    /// Weight of the sample in a pixel whose filter is `w` at the film point, when `along` camera rays a pixel and `outward` samples
    /// in all are drawn [T] 5.5.
    pub fn weigh(&self, w: f64, along: f64, outward: f64) -> f64 {
        w / (along * w * self.film_per_sheet + outward * self.outward)
    }
}

/// What moves, as far as rooms ask.
#[derive(Clone, Debug)]
pub struct Motion {
    /// One a light.
    pub lights: Vec<LightMotion>,
    /// What moves alike has one number; what stands still none.
    classes: Vec<Option<u32>>,
    pub camera: bool,
    /// A lamp that light passes through, where it or anything else moves.
    glowing_null: Option<String>,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct LightMotion {
    pub position: bool,
    pub direction: bool,
    pub angles: bool,
}

impl Motion {
    pub fn new(scene: &Scene, sensor: &Sensor, params: &ParamSet) -> Motion {
        let active = |slot: Slot, n| slot != Slot::MAX && params.block_active(slot, n);
        let motion = |l: &crate::light::Light| LightMotion {
            position: active(l.place.position, 3),
            direction: active(l.place.direction, 3),
            angles: active(l.place.angles, 2),
        };
        let moves = |i: usize| {
            let s = &scene.shapes[i];
            !scene.is_null(s) && params.block_active(s.mover.first, Mover::SLOTS)
        };
        // Two fields of velocities are one if four points in general position move alike.
        let probes = scene.bounds.probes();
        let field = |i: usize| -> Vec<f64> {
            let mover = &scene.shapes[i].mover;
            let axes = [DVec3::X, DVec3::Y, DVec3::Z];
            let forms = probes.iter().flat_map(|&p| axes.map(|c| mover.forms(p, c)));
            let tangent = |forms: [Partial; 4], k: usize| -> f64 {
                forms.iter().flat_map(|f| (0..3).map(move |j| f.v[j] * params.tangents(f.slot + j as Slot)[k])).sum()
            };
            forms.flat_map(|f| (0..params.len()).map(move |k| tangent(f, k))).collect()
        };
        let alike = |a: &[f64], b: &[f64]| {
            let size = a.iter().chain(b).fold(0.0f64, |m, x| m.max(x.abs()));
            a.iter().zip(b).all(|(x, y)| (x - y).abs() <= 1e-9 * size)
        };
        let mut fields: Vec<Vec<f64>> = Vec::new();
        let class = |i: usize| {
            let f = moves(i).then(|| field(i))?;
            let at = fields.iter().position(|g| alike(&f, g)).unwrap_or_else(|| {
                fields.push(f);
                fields.len() - 1
            });
            Some(at as u32)
        };
        let classes = (0..scene.shapes.len()).map(class).collect();
        let classes: Vec<Option<u32>> = classes;
        let camera = sensor.moves(params);
        let others = camera || classes.iter().any(Option::is_some);
        let glows = |s: &&crate::scene::Instance| {
            scene.is_null(s) && s.light.is_some() && (others || params.block_active(s.mover.first, Mover::SLOTS))
        };
        let glowing_null = scene.shapes.iter().find(glows).map(|s| s.name.clone());
        Motion { lights: scene.lights.iter().map(motion).collect(), classes, camera, glowing_null }
    }

    /// Shapes of one class move alike.
    pub fn class(&self, shape: u32) -> u32 {
        self.classes[shape as usize].unwrap_or(u32::MAX)
    }

    pub fn moves(&self, shape: u32) -> bool {
        self.classes[shape as usize].is_some()
    }

    /// Whether a vertex on some surface moves: any shadow or silhouette may then pass over it.
    pub fn surfaces(&self) -> bool {
        self.camera || self.classes.iter().any(|c| c.is_some())
    }

    /// An error where more moves at once than the interior keeps apart, and where a light moves in a medium in the picture itself (`crop`: x0, y0, x1,
    /// y1, and the filter's radius around it): beside such a light a pixel's derivative is a principal value without variance.
    pub fn check(&self, scene: &Scene, sensor: &Sensor, crop: [usize; 4], margin: f64) -> Result<()> {
        for (i, (l, m)) in scene.lights.iter().zip(&self.lights).enumerate() {
            let Some(p) = l.center().filter(|_| m.position && scene.embedded_selection(i as u32) > 0.0) else {
                continue;
            };
            let Some(q) = sensor.project(p) else { continue };
            let inside = (0..2).all(|k| {
                let (lo, hi) = (crop[k] as f64 - margin, crop[k + 2] as f64 + margin);
                q.film[k] > lo && q.film[k] < hi
            });
            let hidden = || scene.blocked_past(p, -q.w, q.distance, &[]);
            if inside && !hidden() {
                let [x, y] = q.film;
                return Err(Error::usage(
                    format!(
                        "the light `{}` moves inside a medium and is seen at pixel ({x:.0}, {y:.0}): the derivative beside it cannot be computed yet",
                        l.name
                    ),
                    "take a sensor that does not see it, or leave its pixel out with --crop",
                ));
            }
        }
        if let Some(name) = &self.glowing_null {
            return Err(Error::usage(
                format!("the lamp `{name}` has a null bsdf, and something moves: this cannot be differentiated yet"),
                "give the lamp a diffuse bsdf of reflectance 0, or leave its emitter out",
            ));
        }
        if self.surfaces() {
            if let Some((a, b)) = crossings::find(scene, self) {
                let name = |k: u32| &scene.shapes[k as usize].name;
                return Err(Error::usage(
                    format!(
                        "the shapes `{}` and `{}` pass through each other: how the curve where they meet moves cannot be told yet",
                        name(a),
                        name(b)
                    ),
                    "let them touch, keep them apart, or make one mesh of them",
                ));
            }
        }
        let smooth = scene.shapes.iter().find(|s| {
            let reflects = !scene.surfaces[s.surface as usize].is_null();
            reflects && !s.face_normals && matches!(&s.shape, Shape::Mesh(m) if m.normals.is_some())
        });
        if let Some(s) = smooth.filter(|_| self.surfaces()) {
            return Err(Error::usage(
                format!(
                    "the mesh `{}` is shaded by vertex normals: what moves beside it cannot be differentiated yet",
                    s.name
                ),
                "light then jumps at the horizon of every face; add <boolean name=\"face_normals\" value=\"true\"/> to the shape",
            ));
        }
        let moving = self.lights.iter().filter(|l| l.position || l.direction || l.angles).count();
        if moving > 64 {
            let what = format!("{moving} lights move at once, more than 64");
            return Err(Error::usage(what, "differentiate with respect to fewer parameters at a time"));
        }
        Ok(())
    }
}

/// What a room works with.
pub struct Context<'a> {
    pub scene: &'a Scene,
    pub set: &'a Settings,
    pub sensor: &'a Sensor,
    /// The medium beyond all interfaces.
    pub outer: Option<u32>,
    /// Film points this far outside of the film still count, in pixels: the filter's radius.
    pub margin: f64,
    pub tally: Tally,
}

impl Context<'_> {
    fn film_size(&self) -> [f64; 2] {
        [self.sensor.width as f64 + 2.0 * self.margin, self.sensor.height as f64 + 2.0 * self.margin]
    }

    fn on_film(&self, film: [f64; 2]) -> bool {
        let size = [self.sensor.width as f64, self.sensor.height as f64];
        (0..2).all(|k| film[k] > -self.margin && film[k] < size[k] + self.margin)
    }
}

/// A boundary term.
pub trait Room: Send + Sync {
    /// As in `--terms`, EXR layers and reports.
    fn name(&self) -> &'static str;

    /// All crossings of the camera ray through `film` with the room's sheets.
    fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample));

    /// One sample from the sheet outward.
    fn outward(&self, cx: &mut Context, rng: &mut Rng, emit: &mut dyn FnMut(&Sample));
}

/// Names of all rooms.
pub const ROOMS: [&str; 4] = [light_shadow::NAME, hard_profile::NAME, pixel_edge::NAME, surface_edge::NAME];

/// The rooms that have anything to do for this motion, of those that `wanted` names.
pub fn rooms(
    scene: &Scene,
    sensor: &Sensor,
    margin: f64,
    motion: &Motion,
    wanted: impl Fn(&str) -> bool,
) -> Vec<Box<dyn Room>> {
    let mut v: Vec<Box<dyn Room>> = Vec::new();
    if wanted(light_shadow::NAME) {
        v.extend(light_shadow::LightShadow::prepare(scene, sensor, motion).map(|r| Box::new(r) as Box<dyn Room>));
    }
    if wanted(hard_profile::NAME) {
        v.extend(hard_profile::HardProfile::prepare(scene, sensor, motion).map(|r| Box::new(r) as Box<dyn Room>));
    }
    if wanted(pixel_edge::NAME) {
        v.extend(pixel_edge::PixelEdge::prepare(scene, sensor, motion, margin).map(|r| Box::new(r) as Box<dyn Room>));
    }
    if wanted(surface_edge::NAME) {
        v.extend(surface_edge::SurfaceEdge::prepare(scene, sensor, motion).map(|r| Box::new(r) as Box<dyn Room>));
    }
    v
}
