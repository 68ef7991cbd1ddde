//! Rough interfaces whose two indices are equal: compiled as smooth ones ([`crate::surface::rough::MATCHED`]), so that their index is refused by name.

use crate::error::{Error, Result};
use crate::params::{Owner, ParamSet, Quantity};
use crate::scene::Scene;
use crate::surface::Surface;

/// An error where the index of such an interface changes.
pub fn check(scene: &Scene, params: &ParamSet) -> Result<()> {
    let matched = scene.slots.blocks.iter().find_map(|b| {
        let Owner::Surface(i) = b.owner else { return None };
        let smooth = matches!(scene.surfaces[i], Surface::Dielectric { .. });
        let asked = b.quantity == Quantity::FacetIor && smooth && params.block_active(b.first, b.len);
        asked.then(|| scene.shapes.iter().find(|s| s.surface as usize == i))?
    });
    let Some(s) = matched else { return Ok(()) };
    let what = format!(
        "the rough interface `{}` has one index on both sides: nothing turns there, and how that changes with the index cannot be told yet",
        s.name
    );
    Err(Error::scene(&s.span, what, "begin at another index, or use a smooth dielectric"))
}
