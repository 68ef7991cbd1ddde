//! What moves beside smooth interfaces and cannot be differentiated yet: refused by name.
//!
//! Behind an interface a camera ray turns with the index, with the interface and with the camera, and takes what it meets along (`transport::ray`). Whatever jumps there needs a
//! term of its own: outlines seen by way of an interface, facets of a polygonal one, shadows cast through it ([T] section 3, E1 to E3 and VE of refracted vertices). A smooth silhouette
//! of glass is no jump: at grazing all light is mirrored, straight on.

use super::Motion;
use crate::error::{Error, Result};
use crate::light::LightKind;
use crate::params::ParamSet;
use crate::scene::{Instance, Scene};
use crate::shape::Shape;

/// Whether all of a smooth surface has one face only, without creases. The border of an open one counts as out of sight: light that goes around it is of no medium.
fn is_one_face(s: &Shape) -> bool {
    matches!(s, Shape::Sphere(_) | Shape::Rectangle(_) | Shape::Disk(_))
}

pub fn check(scene: &Scene, motion: &Motion, params: &ParamSet) -> Result<()> {
    beams(scene, motion)?;
    let smooth = |s: &&Instance| scene.surfaces[s.surface as usize].is_smooth();
    let Some(interface) = scene.shapes.iter().find(smooth) else { return Ok(()) };
    let name = &interface.name;
    // Beams find their way.
    let others = scene.lights.iter().zip(&motion.lights).filter(|(l, _)| !matches!(l.kind, LightKind::Beam { .. }));
    if others.into_iter().any(|(_, m)| m.position || m.direction || m.angles) {
        let what = format!(
            "`{name}` mirrors or refracts: how light falls through it from a light that moves cannot be differentiated yet"
        );
        return Err(Error::usage(what, "differentiate with respect to something else, or take the interface out"));
    }
    let index = scene.surfaces.iter().any(|s| s.refracts_by(params));
    if !motion.surfaces() && !index {
        return Ok(());
    }
    if let Some(s) = scene.shapes.iter().filter(smooth).find(|s| !is_one_face(&s.shape)) {
        let what = format!(
            "`{}` mirrors or refracts and has edges, at which rays part: what moves beside it cannot be differentiated yet, nor its index",
            s.name
        );
        return Err(Error::usage(what, "interfaces may be spheres, rectangles and disks here"));
    }
    let outlined = |s: &&Instance| !scene.is_null(s) && !scene.surfaces[s.surface as usize].is_smooth();
    if let Some(s) = scene.shapes.iter().find(outlined) {
        let what = format!(
            "`{name}` mirrors or refracts: how the outlines of `{}` move, seen by way of it, cannot be told yet",
            s.name
        );
        return Err(Error::usage(what, "light such a scene by an environment or by media that emit"));
    }
    if let Some(l) = scene.lights.iter().find(|l| l.is_delta()) {
        let what = format!(
            "`{name}` mirrors or refracts, and something moves: the shadows of the light `{}` at it cannot be differentiated yet",
            l.name
        );
        return Err(Error::usage(what, "light such a scene by an environment or by media that emit"));
    }
    Ok(())
}

/// Where beams are and anything moves: nothing may cut them.
fn beams(scene: &Scene, motion: &Motion) -> Result<()> {
    let beam = scene.lights.iter().find(|l| matches!(l.kind, LightKind::Beam { .. }));
    let Some(beam) = beam.filter(|_| motion.surfaces()) else { return Ok(()) };
    let outlined = |s: &&Instance| !scene.is_null(s) && !scene.surfaces[s.surface as usize].is_smooth();
    if let Some(s) = scene.shapes.iter().find(outlined) {
        let what = format!(
            "`{}` may stand in the beam `{}`: how its shadow there moves cannot be told yet",
            s.name, beam.name
        );
        return Err(Error::usage(what, "take it out, or use a directional light"));
    }
    Ok(())
}
