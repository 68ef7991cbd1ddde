//! Boundary rooms: the parts of a derivative that come from moving discontinuities, one term a file ([T] section 3).
//!
//! A room hands out [`Sample`]s: where on the film, how much, and how it depends on which slots. It knows neither the mode (forward or
//! reverse), nor the pixels' filter, nor the list of parameters. Two techniques reach the same point of a moving sheet: along a
//! camera ray (its crossings with the sheet, exact), and from the sheet outward. Whoever adds the samples up weighs them by
//! [`Sample::weigh`], the balance heuristic in film space.

pub mod hard_profile;
pub mod light_shadow;
pub mod light_walk;
pub mod outline;
pub mod sheet;
pub mod sheet_samples;

use crate::error::{Error, Result};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::{ParamSet, Slot};
use crate::scene::{Scene, Settings};
use crate::sensor::Sensor;
use crate::transport::Tally;

/// A linear form on up to three consecutive slots.
#[derive(Clone, Copy, Debug)]
pub struct Partial {
    pub slot: Slot,
    pub v: DVec3,
    pub len: u32,
}

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
}

#[derive(Clone, Copy, Debug, Default)]
pub struct LightMotion {
    pub position: bool,
    pub direction: bool,
    pub angles: bool,
}

impl Motion {
    pub fn new(scene: &Scene, params: &ParamSet) -> Motion {
        let active = |slot: Slot, n| slot != Slot::MAX && params.block_active(slot, n);
        let motion = |l: &crate::light::Light| LightMotion {
            position: active(l.place.position, 3),
            direction: active(l.place.direction, 3),
            angles: active(l.place.angles, 2),
        };
        Motion { lights: scene.lights.iter().map(motion).collect() }
    }

    /// An error where more moves at once than the interior keeps apart.
    pub fn check(&self) -> Result<()> {
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
pub const ROOMS: [&str; 2] = [light_shadow::NAME, hard_profile::NAME];

/// The rooms that have anything to do for this motion, of those that `wanted` names.
pub fn rooms(scene: &Scene, sensor: &Sensor, motion: &Motion, wanted: impl Fn(&str) -> bool) -> Vec<Box<dyn Room>> {
    let mut v: Vec<Box<dyn Room>> = Vec::new();
    if wanted(light_shadow::NAME) {
        v.extend(light_shadow::LightShadow::prepare(scene, sensor, motion).map(|r| Box::new(r) as Box<dyn Room>));
    }
    if wanted(hard_profile::NAME) {
        v.extend(hard_profile::HardProfile::prepare(scene, sensor, motion).map(|r| Box::new(r) as Box<dyn Room>));
    }
    v
}
