//! Scenes: from a description (XML) to what can be rendered.

pub mod advice;
mod around;
pub mod arrays;
pub mod balls;
pub mod beams;
pub mod bodies;
pub mod bright;
pub mod chain_search;
pub mod chains;
pub mod columns;
pub mod compile;
pub mod critical;
pub mod desc;
pub mod effort;
pub mod frame;
pub mod geometry;
pub mod lamps;
pub mod lids;
pub mod lights;
pub mod march;
pub mod matter;
pub mod nearest;
pub mod node;
pub mod panes;
pub mod parts;
mod parts_camera;
mod parts_objects;
mod property;
pub mod reach;
mod refs;
pub mod seeds;
mod source;
pub mod transform;
pub mod value;
pub mod volume_cache;
pub mod volumes;
pub mod voxels;
pub mod xml;

pub use around::Around;
pub use desc::{Env, SceneDesc};
pub use geometry::{Hit, On};
pub use march::March;
pub use node::Node;
pub use transform::Mat4;

use crate::error::{Span, Warning};
use crate::light::Light;
use crate::math::DVec3;
use crate::math::discrete::Discrete;
use crate::medium::Medium;
use crate::params::{Mover, Slot, SlotTable};
use crate::sensor::Sensor;
use crate::shape::{Bounds, Geometry, Shape};
use crate::surface::Surface;
use geometry::Group;
use std::sync::OnceLock;

/// A shape with what it does to light.
pub struct Instance {
    pub name: String,
    /// Where the scene's file describes it.
    pub span: Span,
    pub shape: Shape,
    pub surface: u32,
    /// Whether it separates media; then `interior` and `exterior` are those behind and before its front side.
    pub boundary: bool,
    pub interior: Option<u32>,
    pub exterior: Option<u32>,
    pub light: Option<u32>,
    pub mover: Mover,
    /// Slots of a mesh's vertices, where they are parameters ([`Scene::open`]).
    pub vertices: Option<Slot>,
    /// Shade with the face's own normal even where the mesh has others.
    pub face_normals: bool,
}

impl Instance {
    /// Whether the front of a sphere is its inside.
    fn is_inside_out(&self) -> bool {
        matches!(&self.shape, Shape::Sphere(q) if self.shape.normal(0, q.center + DVec3::X * q.radius).x < 0.0)
    }

    /// The medium on the far side of a crossing along `w`.
    pub fn medium_behind(&self, w: DVec3, n: DVec3, current: Option<u32>) -> Option<u32> {
        if !self.boundary {
            current
        } else if w.dot(n) < 0.0 {
            self.interior
        } else {
            self.exterior
        }
    }
}

impl Scene {
    /// That of a shape.
    pub fn surface_of(&self, shape: u32) -> &Surface {
        &self.surfaces[self.shapes[shape as usize].surface as usize]
    }

    /// Whether light passes the shape unchanged.
    pub fn is_null(&self, s: &Instance) -> bool {
        self.surfaces[s.surface as usize].is_null()
    }

    /// The same of what a ray meets.
    pub fn passes(&self, hit: &Hit) -> bool {
        self.is_null(&self.shapes[hit.shape as usize])
    }

    /// Whether light jumps where rays graze the shape: not at balls and cylinders of glass, and mirrors, that do not shine, which reflect all of it straight on. Tubes that mirror on one side alone are dark on the other, which is seen: they count as having one.
    pub fn has_outline(&self, s: &Instance) -> bool {
        let reflects = match &self.surfaces[s.surface as usize] {
            Surface::Null => return false,
            Surface::Dielectric { .. } => true,
            Surface::Conductor { two_sided, .. } => {
                *two_sided || matches!(s.shape, Shape::Sphere(_)) && !s.is_inside_out()
            }
            Surface::Diffuse { .. } | Surface::Rough(_) => false,
        };
        !(reflects && s.light.is_none() && s.shape.is_round())
    }

    /// Whether some medium scatters besides what the shape holds, as light sees that passes its outline.
    pub fn scatters_beside(&self) -> impl Fn(u32) -> bool + use<> {
        let fog = |m: Option<u32>| m.is_some_and(|m| !self.media[m as usize].sigma_s.is_zero());
        let borders = || (0..).zip(&self.shapes).filter(|(_, s)| s.boundary);
        let around = borders().any(|(_, s)| fog(s.exterior)) || self.sensors.iter().any(|s| fog(s.medium));
        let hold: Vec<u32> = borders().filter(|(_, s)| fog(s.interior)).map(|(id, _)| id).collect();
        move |shape| around || hold.iter().any(|&id| id != shape)
    }

    /// Whether it is a disk of smooth metal: its rim is seen, as that of a disk of glass, which bounds a half-space, is not.
    pub fn is_round_mirror(&self, s: &Instance) -> bool {
        let metal = matches!(self.surfaces[s.surface as usize], Surface::Conductor { .. });
        metal && matches!(s.shape, Shape::Disk(_))
    }

    /// Whether it is a rectangle or disk of glass: by itself it bounds a half-space, and its border is out of sight.
    pub fn is_half_space(&self, id: u32) -> bool {
        let flat = matches!(self.shapes[id as usize].shape, Shape::Rectangle(_) | Shape::Disk(_));
        flat && matches!(self.surface_of(id), Surface::Dielectric { .. })
    }

    /// Whether anything mirrors or refracts and keeps rays together.
    pub fn has_smooth(&self) -> bool {
        self.shapes.iter().any(|s| self.surfaces[s.surface as usize].is_smooth())
    }

    /// Whether the shape does nothing but part media.
    pub fn is_border(&self, s: &Instance) -> bool {
        s.boundary && self.is_null(s)
    }

    /// Slots whose motion is a border's, all of it term N.
    pub fn moves_a_border(&self, slot: Slot) -> bool {
        let holds = |s: &Instance| (s.mover.first..s.mover.first + Mover::SLOTS).contains(&slot);
        // Vertices of borders are never open.
        (slot as usize) < self.slots.scalars && self.shapes.iter().any(|s| self.is_border(s) && holds(s))
    }
}

/// What ends a path, and what is shown, by the integrator's settings.
#[derive(Clone, Copy, Debug)]
pub struct Settings {
    /// Number of edges from the camera, as Mitsuba counts; `u32::MAX` = unlimited.
    pub max_depth: u32,
    /// Scatterings before roulette begins.
    pub rr_depth: u32,
    pub hide_emitters: bool,
    /// Light that scattered less often is left out of the picture and of every term; paths are the same.
    pub min_order: u32,
    /// A path is cut here and counted, never silently.
    pub cap: u64,
}

/// What a sensor's film and sampler ask for.
#[derive(Clone, Copy, Debug)]
pub struct Film {
    pub part: parts::FilmPart,
    pub spp: u64,
    pub seed: u64,
    /// Samples are spread evenly ([`crate::math::rng::Rng::even`]): every sampler but `independent`.
    pub even: bool,
}

/// Everything a walk needs.
pub struct Scene {
    pub shapes: Vec<Instance>,
    pub surfaces: Vec<Surface>,
    pub media: Vec<Medium>,
    pub lights: Vec<Light>,
    /// The environment light.
    pub environment: Option<u32>,
    pub sensors: Vec<Sensor>,
    /// One a sensor.
    pub films: Vec<Film>,
    pub settings: Settings,
    pub slots: SlotTable,
    pub bounds: Bounds,
    pub warnings: Vec<Warning>,
    pub opaque: Group,
    pub null: Group,
    /// More crossings than this in one straight line: something is wrong, counted in `health`.
    pub max_interfaces: usize,
    /// Whether borders of media end somewhere, once anybody has asked.
    open_borders: OnceLock<bool>,
    /// Whether anything refracts.
    pub has_glass: bool,
    /// Share of uniform directions among those that leave a surface by the cosine: where anything can move, scores like 1/cos must have a
    /// second moment ([T] 2.3). It depends on the scene's parameters alone, so that every picture of it has the same bits.
    pub uniform_share: f64,
    /// The least probability of going on through an interface that does not reflect all: where a parameter can change how much goes either way.
    pub least_through: f64,
    /// Interfaces near whose critical angles scores need more directions; empty where `least_through` is 0.
    pub critical: critical::Critical,
    /// Probability of every light for a connection, and of every light with a position for the equi-angular one.
    pub selection: Discrete,
    /// All lights for connections if they are few, more than one, and at infinity; otherwise none.
    pub distant: Vec<u32>,
    pub local: Discrete,
    /// Ways of collimated beams.
    pub beams: beams::Beams,
    /// Where their light runs through media.
    pub columns: columns::Columns,
    /// Smooth balls by which lights without extent are connected to.
    pub balls: Vec<balls::BallOf>,
    /// Smooth shapes that random rays of lights are sent at.
    pub seeds: Vec<u32>,
    /// Media that no light from infinity falls into straight: by medium.
    pub sheltered: Vec<bool>,
    /// Whether a ray may meet light before it leaves the scene: on a surface, or in a medium.
    pub shines_within: bool,
    /// Flat glass and mirrors beside lights without extent.
    pub panes: Vec<panes::Pane>,
    /// The same, several in turn.
    pub chains: chains::Chains,
    /// Those that light may be in.
    pub bodies: bodies::Bodies,
    /// Lamps beside such faces.
    pub lamps: lamps::Lamps,
    /// Of every light that stands in a medium, for the light-centred one.
    pub embedded: Discrete,
    /// Where media glow, for connections to it.
    pub bright: bright::Bright,
}
