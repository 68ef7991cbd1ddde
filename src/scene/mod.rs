//! Scenes: from a description (XML) to what can be rendered.

pub mod compile;
pub mod desc;
pub mod geometry;
pub mod lights;
pub mod parts;
pub mod transform;
pub mod xml;

pub use geometry::{Hit, On};

use crate::error::Warning;
use crate::light::Light;
use crate::math::DVec3;
use crate::math::discrete::Discrete;
use crate::medium::Medium;
use crate::params::SlotTable;
use crate::sensor::Sensor;
use crate::shape::{Bounds, Shape};
use crate::surface::Surface;
use crate::transport::Settings;
use geometry::Group;

/// A shape with what it does to light.
pub struct Instance {
    pub shape: Shape,
    pub surface: u32,
    /// Whether it separates media; then `interior` and `exterior` are those behind and before its front side.
    pub boundary: bool,
    pub interior: Option<u32>,
    pub exterior: Option<u32>,
    pub light: Option<u32>,
}

impl Instance {
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

/// Everything a walk needs.
pub struct Scene {
    pub shapes: Vec<Instance>,
    pub surfaces: Vec<Surface>,
    pub media: Vec<Medium>,
    pub lights: Vec<Light>,
    /// The environment light.
    pub environment: Option<u32>,
    pub sensors: Vec<Sensor>,
    pub settings: Settings,
    pub slots: SlotTable,
    pub bounds: Bounds,
    pub warnings: Vec<Warning>,
    pub opaque: Group,
    pub null: Group,
    /// More crossings than this in one straight line: something is wrong, counted in `health`.
    pub max_interfaces: usize,
    /// Probability of every light for a connection, and of every light with a position for the equi-angular one.
    pub selection: Discrete,
    pub local: Discrete,
}
