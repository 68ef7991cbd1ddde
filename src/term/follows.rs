//! Media that points cannot follow moving matter in yet: refused by name.

use crate::error::{Error, Result};
use crate::scene::Scene;

/// An error for media of three extinctions from a grid: their flights cannot be forced.
pub fn check(scene: &Scene) -> Result<()> {
    let chromatic = scene.media.iter().find(|m| m.density_grid().is_some_and(|g| g.channels() == 3));
    chromatic.map_or(Ok(()), |m| {
        let name = &m.name;
        let what =
            format!("the medium `{name}` has a density of three channels, and something moves: this cannot be differentiated yet");
        Err(Error::usage(what, "use a density of one channel"))
    })
}
