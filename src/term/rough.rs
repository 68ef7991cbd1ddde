//! What changes beside rough interfaces and cannot be differentiated yet: refused by name.
//!
//! At given directions a rough interface is a value ([`crate::surface::rough`]), and so are its roughness and indices. Where its vertices, or those beside it, move, its directions turn, on both
//! sides: neither the interior's scores nor the light walk of the rooms know that, since to them a surface reflects by the cosine of one direction.

use super::Motion;
use crate::error::{Error, Result};
use crate::params::{Owner, ParamSet, Quantity};
use crate::scene::{Instance, Scene};
use crate::surface::Surface;

/// An error where anything moves beside a rough surface, or where the index of one changes that is equal on both sides.
pub fn check(scene: &Scene, motion: &Motion, params: &ParamSet) -> Result<()> {
    let shape = |of: &dyn Fn(usize) -> bool| scene.shapes.iter().find(|s| of(s.surface as usize));
    let matched = scene.slots.blocks.iter().find_map(|b| {
        let Owner::Surface(i) = b.owner else { return None };
        let smooth = matches!(scene.surfaces[i], Surface::Dielectric { .. });
        let asked = b.quantity == Quantity::FacetIor && smooth && params.block_active(b.first, b.len);
        asked.then(|| shape(&|s| s == i))?
    });
    if let Some(s) = matched {
        let what = format!(
            "the rough interface `{}` has one index on both sides: nothing turns there, and how that changes with the index cannot be told yet",
            s.name
        );
        return Err(Error::scene(&s.span, what, "begin at another index, or use a smooth dielectric"));
    }
    let rough: Option<&Instance> = shape(&|s| matches!(scene.surfaces[s], Surface::Rough(_)));
    let lights = scene.lights.iter().any(|l| l.place.moves(params));
    if let Some(s) = rough.filter(|_| motion.surfaces() || lights) {
        let what = format!(
            "`{}` is rough, and something moves: how light turns at it then cannot be differentiated yet, only its alpha and index, and values of media and lights",
            s.name
        );
        return Err(Error::scene(&s.span, what, "make it smooth, or differentiate with respect to something else"));
    }
    Ok(())
}
