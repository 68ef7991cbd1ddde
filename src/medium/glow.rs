//! What a medium emits: the radiance `L_e(x)` of [T] (2), [S] (4), by which its absorption σ_a is multiplied.
//!
//! Either a volume of radiance (rgb), or one of temperatures, whose black bodies shine: with pbrt's meaning of scale and offset,
//! `L_e = emission_scale B((value - temperature_offset) temperature_scale)`, B of [`crate::math::blackbody`], in kelvin. Where that
//! is no temperature (negative), nothing shines.

use super::{NO_SLOT, Volume};
use crate::math::{DVec3, Rgb, blackbody};
use crate::params::{Mover, ParamSet, Quantity, Sink, Slot};

/// Slots of an emission; [`NO_SLOT`] where the quantity does not exist, or is a grid whose voxels are not open as an array.
#[derive(Clone, Copy, Debug)]
pub struct GlowSlots {
    /// Three of a constant radiance, one of a constant temperature; of a grid, those of its active voxels.
    pub value: Slot,
    pub scale: Slot,
    pub heat_scale: Slot,
    pub heat_offset: Slot,
    /// Of a grid with a transform: the field moves with it.
    pub mover: Option<Mover>,
}

/// How numbers become kelvin: `(value - offset) scale`.
#[derive(Clone, Copy, Debug)]
pub struct Heat {
    pub scale: f64,
    pub offset: f64,
}

impl Heat {
    pub fn kelvin(&self, value: f64) -> f64 {
        (value - self.offset) * self.scale
    }
}

/// Emission of a medium.
#[derive(Clone, Debug)]
pub struct Glow {
    /// Of radiance, or of numbers that are temperatures.
    pub volume: Volume,
    pub scale: f64,
    /// Of temperatures.
    pub heat: Option<Heat>,
    pub slots: GlowSlots,
}

impl Glow {
    /// What the volume holds.
    pub fn quantity(&self) -> Quantity {
        if self.heat.is_some() { Quantity::Temperature } else { Quantity::Glow }
    }

    /// `L_e` at a world point.
    pub fn at(&self, p: DVec3) -> Rgb {
        let value = self.volume.at(p);
        match &self.heat {
            None => value * self.scale,
            Some(heat) => blackbody::radiance(heat.kelvin(value[0])).0 * self.scale,
        }
    }

    /// An upper bound of `L_e`: of temperatures at their highest.
    pub fn brightest(&self) -> f64 {
        let most = self.volume.max();
        match &self.heat {
            None => most.max() * self.scale,
            Some(heat) => blackbody::radiance(heat.kelvin(most[0])).0.max() * self.scale,
        }
    }

    /// `∇L_e` per channel, radiance/length.
    pub fn gradient(&self, p: DVec3) -> [DVec3; 3] {
        let by_value = self.volume.gradient(p);
        match &self.heat {
            None => by_value.map(|g| g * self.scale),
            Some(heat) => {
                let slope = blackbody::radiance(heat.kelvin(self.volume.at(p)[0])).1 * (self.scale * heat.scale);
                slope.0.map(|s| by_value[0] * s)
            }
        }
    }

    /// `weight x dL_e/dslot` at a world point for every active slot.
    pub fn partials(&self, params: &ParamSet, p: DVec3, weight: Rgb, sink: &mut impl Sink) {
        let s = &self.slots;
        if let Some(mover) = self.moves(params) {
            mover.field(p, &self.gradient(p), weight, sink);
        }
        let mut add = |slot: Slot, d: Rgb| {
            if slot != NO_SLOT && params.is_active(slot) {
                sink.add(slot, weight * d);
            }
        };
        let Some(heat) = &self.heat else {
            add(s.scale, self.volume.at(p));
            self.volume.partials(params, s.value, p, weight * self.scale, &mut |slot, d| sink.add(slot, d));
            return;
        };
        let value = self.volume.at(p)[0];
        let (radiance, slope) = blackbody::radiance(heat.kelvin(value));
        let by_kelvin = slope * self.scale;
        add(s.scale, radiance);
        add(s.heat_scale, by_kelvin * (value - heat.offset));
        add(s.heat_offset, by_kelvin * -heat.scale);
        let by_value = by_kelvin * heat.scale;
        match &self.volume {
            Volume::Constant(_) => add(s.value, by_value),
            Volume::Grid(_) => {
                self.volume.partials(params, s.value, p, weight * by_value, &mut |slot, d| sink.add(slot, d))
            }
        }
    }

    /// The mover, if any parameter moves it.
    fn moves(&self, params: &ParamSet) -> Option<&Mover> {
        self.slots.mover.as_ref().filter(|m| params.block_active(m.first, Mover::SLOTS))
    }

    /// Whether any slot of the emission is active.
    pub fn active(&self, params: &ParamSet) -> bool {
        let s = &self.slots;
        // All voxels of a grid are active, or none.
        let values = if self.heat.is_none() && matches!(self.volume, Volume::Constant(_)) { 3 } else { 1 };
        let blocks = [(s.value, values), (s.scale, 1), (s.heat_scale, 1), (s.heat_offset, 1)];
        blocks.iter().any(|&(first, n)| first != NO_SLOT && params.block_active(first, n))
            || self.moves(params).is_some()
    }
}
