//! Boundary rooms: the parts of a derivative that come from moving discontinuities, one term a file ([T] section 3).
//!
//! A room hands out [`Sample`]s: where on the film, how much, and how it depends on which slots. It knows neither the mode (forward or
//! reverse), nor the pixels' filter, nor the list of parameters. Two techniques reach the same point of a moving sheet: along a
//! camera ray (its crossings with the sheet, exact), and from the sheet outward. Whoever adds the samples up weighs them by
//! [`Sample::weigh`], the balance heuristic in film space.

pub mod aim;
pub mod arcs;
pub mod beam_rim;
pub mod beam_spot;
pub mod beam_start;
pub mod cast;
mod cast_border;
mod cast_route;
mod cast_sheet;
mod cast_trace;
pub mod contact;
pub mod crossings;
pub mod cuts;
pub mod edge_set;
pub mod ends;
pub mod facet_edge;
pub mod facing;
pub mod follows;
pub mod frosted;
pub mod grazing;
pub mod grazing_line;
pub mod hard_beam;
pub mod hard_profile;
pub mod interfaces;
pub mod known_chains;
pub mod light_shadow;
pub mod light_walk;
pub mod medium_edge;
pub mod outline;
pub mod panes;
pub mod per_vertex;
pub mod pixel_edge;
pub mod planes;
pub mod rims;
pub mod rough;
pub mod seen_path;
pub mod sheet;
pub mod sheet_samples;
mod shown;
pub mod spans;
pub mod surface_edge;
pub mod virtual_edge;
pub mod wedge;

use crate::error::{Error, Result};
use crate::math::Rgb;
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::params::{ParamSet, Partial, Slot};
use crate::scene::{Around, Scene, Settings};
use crate::sensor::Sensor;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use crate::transport::Tally;
use crate::transport::attach::InnerBorders;
use crate::transport::motion::Moving;
use cuts::Cuts;
use edge_set::EdgeSet;
use rims::{Rim, rims, stay_together};
use std::sync::{Arc, OnceLock};

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
    pub moving: Moving,
    /// Of surfaces whether refracted light ends with a jump that may move ([`facet_edge`]), and whether an index of theirs is a parameter.
    pub facets: Vec<Option<bool>>,
    /// A lamp that light passes through, where it or anything else moves.
    glowing_null: Option<String>,
    edges: OnceLock<Arc<EdgeSet>>,
    rims: Vec<Rim>,
    /// Pairs of shapes that pass through each other, or twice the same.
    crossed: Vec<(u32, u32)>,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct LightMotion {
    pub position: bool,
    pub direction: bool,
    pub angles: bool,
}

impl Motion {
    pub fn new(scene: &Scene, sensor: &Sensor, params: &ParamSet) -> Result<Motion> {
        let active = |slot: Slot, n| slot != Slot::MAX && params.block_active(slot, n);
        let motion = |l: &crate::light::Light| LightMotion {
            position: active(l.place.position, 3),
            direction: active(l.place.direction, 3),
            angles: active(l.place.angles, 2),
        };
        let moving = Moving::new(scene, sensor, params)?;
        let others = moving.any();
        let glows = |s: &&crate::scene::Instance| scene.is_null(s) && s.light.is_some() && (others || s.moves(params));
        let glowing_null = scene.shapes.iter().find(glows).map(|s| s.name.clone());
        let lights: Vec<LightMotion> = scene.lights.iter().map(motion).collect();
        let turns = moving.any() || lights.iter().any(|l| l.position || l.direction);
        let facets = |s: &Surface| match s {
            Surface::Rough(r) if r.jumps() => Some(r.indices_active(params)).filter(|&index| turns || index),
            _ => None,
        };
        let facets = scene.surfaces.iter().map(facets).collect();
        let (edges, crossed) = (OnceLock::new(), Vec::new());
        let mut motion = Motion { lights, moving, facets, glowing_null, edges, rims: Vec::new(), crossed };
        if turns {
            motion.rims = rims(scene, |rim, shape| stay_together(scene, params, rim, shape));
        }
        // Where lights alone move, glass and mirrors may end where others pass through them.
        if motion.surfaces() || motion.lights.iter().any(|l| l.position || l.direction) && scene.has_smooth() {
            motion.cross(scene);
        }
        Ok(motion)
    }

    /// Looks for shapes that pass through each other: where they do, faces end, and edges are seen.
    fn cross(&mut self, scene: &Scene) {
        let mut compared = cuts::compared(scene);
        let mut pairs = crossings::all(scene, self, &compared);
        for &(a, b) in pairs.iter().filter(|&&(a, b)| cuts::are_straight(scene, self, [a, b])) {
            (compared[a as usize], compared[b as usize]) = (true, true);
        }
        let cuts = Cuts::find(scene, self, &self.edges(scene), &compared);
        pairs.extend(&cuts.pairs);
        pairs.sort_unstable();
        pairs.dedup();
        let curves = pairs.iter().filter(|&&(a, b)| !cuts::are_straight(scene, self, [a, b]));
        let normal = |(shape, face): (u32, u32), p| scene.shapes[shape as usize].shape.normal(face, p);
        let lines = cuts.borders().map(|(face, line)| (face, normal(face, line[0]), line));
        let inner = InnerBorders::new(scene.shapes.len(), curves.flat_map(|&(a, b)| [a, b]), lines);
        if !cuts.is_empty() {
            let edges = self.edges.take().and_then(Arc::into_inner).unwrap_or_else(|| EdgeSet::new(scene, self));
            self.edges = OnceLock::from(Arc::new(edges.with_cuts(&cuts.replaced, cuts.edges(scene))));
        }
        self.moving = std::mem::take(&mut self.moving).with_inner(inner);
        self.crossed = pairs;
    }

    /// Edges of everything opaque: made when someone asks first.
    pub fn edges(&self, scene: &Scene) -> Arc<EdgeSet> {
        self.edges.get_or_init(|| Arc::new(EdgeSet::new(scene, self))).clone()
    }

    /// Shapes of one class move alike.
    pub fn class(&self, shape: u32) -> u32 {
        self.moving.field.class(shape).unwrap_or(u32::MAX)
    }

    pub fn moves(&self, shape: u32) -> bool {
        self.moving.moves(shape)
    }

    /// Whether a vertex on some surface moves: any shadow or silhouette may then pass over it.
    pub fn surfaces(&self) -> bool {
        self.moving.any()
    }

    /// An error where more moves at once than the interior keeps apart, and where a light moves in a medium in the picture itself (`crop`: x0, y0, x1,
    /// y1, and the filter's radius around it): beside such a light a pixel's derivative is a principal value without variance.
    pub fn check(
        &self,
        scene: &Scene,
        sensor: &Sensor,
        params: &ParamSet,
        crop: [usize; 4],
        margin: f64,
    ) -> Result<()> {
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
                // Not -0.
                let [x, y] = q.film.map(|x| x.round() + 0.0);
                return Err(Error::usage(
                    format!(
                        "the light `{}` moves inside a medium and is seen at pixel ({x:.0}, {y:.0}): the derivative beside it cannot be computed yet",
                        l.name
                    ),
                    "take a sensor that does not see it, or leave its pixel out with --crop",
                ));
            }
        }
        if let Some(i) = self.moving.field.cornered(scene) {
            let name = &scene.lights[i as usize].name;
            return Err(Error::usage(
                format!(
                    "the spot `{name}` has a hard edge and moves inside a medium, on a surface or beside another light: this cannot be differentiated yet"
                ),
                "move it a little off what it touches, or give it a beam_width below its cutoff_angle",
            ));
        }
        panes::check(scene, sensor, margin, self)?;
        interfaces::check(scene, self)?;
        rough::check(scene, params)?;
        if let Some(name) = &self.glowing_null {
            return Err(Error::usage(
                format!("the lamp `{name}` has a null bsdf, and something moves: this cannot be differentiated yet"),
                "give the lamp a diffuse bsdf of reflectance 0, or leave its emitter out",
            ));
        }
        if self.surfaces() {
            // Rays that see them in what is smooth move.
            let turns = (0..scene.shapes.len() as u32).any(|k| {
                let surface = scene.shapes[k as usize].surface as usize;
                scene.surfaces[surface].is_smooth() && (self.moves(k) || self.moving.refracts(surface))
            });
            // One of them moves, or the camera, or these: the curve itself has to be known.
            let concerned = |&&(a, b): &&(u32, u32)| {
                let smooth = |k: u32| scene.surface_of(k).is_smooth();
                let moves = self.moving.camera || turns || self.moves(a) || self.moves(b) || smooth(a) || smooth(b);
                moves && (smooth(a) || smooth(b) || !cuts::are_straight(scene, self, [a, b]))
            };
            if let Some(&(a, b)) = self.crossed.iter().find(concerned) {
                let name = |k: u32| &scene.shapes[k as usize].name;
                let span = &scene.shapes[a as usize].span;
                if a == b {
                    return Err(Error::scene(
                        span,
                        format!(
                            "the mesh `{}` passes through itself: how the curve where it does moves cannot be told yet",
                            name(a)
                        ),
                        "cut the mesh along that curve",
                    ));
                }
                return Err(Error::scene(
                    span,
                    format!(
                        "the shapes `{}` and `{}` pass through each other: how the curve where they meet moves cannot be told yet",
                        name(a),
                        name(b)
                    ),
                    "let them touch, keep them apart, or move flat shapes together",
                ));
            }
        }
        if self.surfaces() {
            follows::check(scene)?;
            if let Some((a, b)) = contact::find(scene, self, params) {
                let name = |k: u32| &scene.shapes[k as usize].name;
                let (span, a, b) = (&scene.shapes[a as usize].span, name(a), name(b));
                return Err(Error::scene(
                    span,
                    format!(
                        "`{a}` stands on `{b}`, and one moves off or into the other: what opens between them has no derivative"
                    ),
                    "move both together, slide one along the other, or leave a gap between them (a ten-thousandth of their size is enough)",
                ));
            }
        }
        let smooth = scene.shapes.iter().find(|s| {
            let reflects = !scene.surfaces[s.surface as usize].is_null();
            reflects && !s.face_normals && matches!(&s.shape, Shape::Mesh(m) if m.normals.is_some())
        });
        if let Some(s) = smooth.filter(|_| self.surfaces()) {
            return Err(Error::scene(
                &s.span,
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
    /// What is known of places that no interface tells of.
    pub around: Around,
    /// Film points this far outside of the film still count, in pixels: the filter's radius.
    pub margin: f64,
    pub moving: &'a Moving,
    /// Rough glass, by which the camera may see ([`frosted`]).
    pub frosted: &'a [u32],
    pub tally: Tally,
}

impl Context<'_> {
    fn film_size(&self) -> [f64; 2] {
        [self.sensor.width as f64 + 2.0 * self.margin, self.sensor.height as f64 + 2.0 * self.margin]
    }

    fn on_film(&self, film: [f64; 2]) -> bool {
        self.sensor.shows(film, self.margin)
    }
}

/// How `surface_edge` and `medium_edge` are estimated. Both forms have the same mean.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EdgeForm {
    /// From the edge outward, [T] (24), 2.2.
    #[default]
    Outward,
    /// From the vertices of camera paths: a validation mode ([`per_vertex`]).
    PerVertex,
}

/// A boundary term.
pub trait Room: Send + Sync {
    /// As in `--terms`, EXR layers and reports.
    fn name(&self) -> &'static str;

    /// All crossings of the camera ray through `film` with the room's sheets.
    fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample));

    /// Whether anything is drawn outward.
    fn has_outward(&self) -> bool {
        true
    }

    /// One sample from the sheet outward. `lead`: the numbers that it begins with.
    fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample));

    /// How many numbers of `lead` are drawn with a learned density ([`crate::math::guide`]). Weights against samples along camera rays do not know it.
    fn guided_numbers(&self) -> usize {
        0
    }
}

/// Names of all rooms.
pub const ROOMS: [&str; 6] = [
    light_shadow::NAME,
    hard_profile::NAME,
    pixel_edge::NAME,
    surface_edge::NAME,
    medium_edge::NAME,
    virtual_edge::NAME,
];

/// The rooms that have anything to do for this motion, of those that `wanted` names.
pub fn rooms(
    scene: &Scene,
    sensor: &Sensor,
    margin: f64,
    motion: &Motion,
    form: EdgeForm,
    wanted: impl Fn(&str) -> bool,
) -> Vec<Box<dyn Room>> {
    let mut v: Vec<Box<dyn Room>> = Vec::new();
    if wanted(light_shadow::NAME) {
        v.extend(
            light_shadow::LightShadow::prepare(scene, sensor, motion, margin).map(|r| Box::new(r) as Box<dyn Room>),
        );
    }
    if wanted(hard_profile::NAME) {
        v.extend(hard_profile::HardProfile::prepare(scene, sensor, motion).map(|r| Box::new(r) as Box<dyn Room>));
    }
    if wanted(pixel_edge::NAME) {
        v.extend(pixel_edge::PixelEdge::prepare(scene, sensor, motion, margin).map(|r| Box::new(r) as Box<dyn Room>));
    }
    if wanted(virtual_edge::NAME) {
        v.extend(
            virtual_edge::VirtualEdge::prepare(scene, sensor, motion, margin).map(|r| Box::new(r) as Box<dyn Room>),
        );
    }
    let from_edges = wanted(surface_edge::NAME) || wanted(medium_edge::NAME);
    let edges = from_edges.then(|| grazing::Edges::new(scene, motion)).flatten().map(Arc::new);
    let Some(edges) = edges else { return v };
    if wanted(surface_edge::NAME) && surface_edge::is_needed(scene) {
        v.push(match form {
            EdgeForm::Outward => Box::new(surface_edge::SurfaceEdge::new(scene, sensor, &edges)),
            EdgeForm::PerVertex => Box::new(per_vertex::PerVertex::surfaces(&edges)),
        });
    }
    if wanted(medium_edge::NAME) && medium_edge::is_needed(scene) {
        v.push(match form {
            EdgeForm::Outward => Box::new(medium_edge::MediumEdge::new(scene, sensor, &edges)),
            EdgeForm::PerVertex => Box::new(per_vertex::PerVertex::media(&edges)),
        });
    }
    v
}
