//! What moves beside smooth interfaces and cannot be differentiated yet: refused by name.
//!
//! Behind an interface a camera ray turns with the index, with the interface and with the camera, and takes what it meets along (`transport::ray`). Straight edges that it sees there, and those of
//! the interface itself, are [`super::virtual_edge`]'s. What is left are outlines of curved things by way of an interface, and shadows of lights without extent that are cast through it. A smooth
//! silhouette of glass is no jump: at grazing all light is mirrored, straight on.

use super::Motion;
use crate::error::{Error, Result};
use crate::light::LightKind;
use crate::scene::beams::is_flat;
use crate::scene::{Instance, On, Scene};
use crate::shape::{Geometry, Shape};

pub fn check(scene: &Scene, motion: &Motion) -> Result<()> {
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
    // An index that changes moves what is behind it.
    if !motion.surfaces() {
        return Ok(());
    }
    if let Some(s) = scene.shapes.iter().filter(smooth).find(|s| matches!(s.shape, Shape::Cylinder(_))) {
        let what = format!(
            "`{}` mirrors or refracts: what moves beside a cylinder that does cannot be differentiated yet, nor its index",
            s.name
        );
        return Err(Error::usage(what, "interfaces may be spheres, rectangles, disks, cubes and meshes here"));
    }
    if let Some(s) = scene.shapes.iter().filter(smooth).find(|s| s.light.is_some()) {
        let what = format!(
            "`{}` mirrors or refracts, and is a lamp: what moves beside it cannot be differentiated yet",
            s.name
        );
        return Err(Error::usage(what, "give the lamp a diffuse bsdf"));
    }
    if let Some(s) = scene.shapes.iter().find(|s| is_outlined(scene, s) && !has_straight_edges(s)) {
        let what = format!(
            "`{name}` mirrors or refracts: how the outline of `{}` moves, seen by way of it, cannot be told yet",
            s.name
        );
        return Err(Error::usage(
            what,
            "only what has straight edges may stand beside interfaces: rectangles, cubes, meshes",
        ));
    }
    touching(scene)?;
    rims_of_balls(scene, motion)?;
    let outer = scene.sensors.first().and_then(|s| scene.outer_medium(s.to_world.translation, s.medium));
    let endless = outer.filter(|&m| scene.environment.is_some() && scene.media[m as usize].density_grid().is_some());
    if let Some(m) = endless {
        let what = format!(
            "the medium `{}` has no end before the environment, and rays turn in it: this cannot be differentiated yet",
            scene.media[m as usize].name
        );
        return Err(Error::usage(what, "bound the medium by a shape with a null bsdf"));
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

/// Whether its outline may be seen by way of an interface.
fn is_outlined(scene: &Scene, s: &Instance) -> bool {
    let smooth = scene.surfaces[s.surface as usize].is_smooth();
    !scene.is_null(s) && (!smooth || s.light.is_some() || matches!(s.shape, Shape::Sphere(_)) && scene.has_outline(s))
}

/// Whether [`super::virtual_edge`] knows all of its edges.
fn has_straight_edges(s: &Instance) -> bool {
    matches!(s.shape, Shape::Rectangle(_) | Shape::Cube(_) | Shape::Mesh(_))
}

/// Faces that meet have an edge between them.
fn touching(scene: &Scene) -> Result<()> {
    let smooth: Vec<&Instance> =
        scene.shapes.iter().filter(|s| scene.surfaces[s.surface as usize].is_smooth()).collect();
    for (i, a) in smooth.iter().enumerate() {
        let meets = |b: &&&Instance| a.shape.bounds().gap(&b.shape.bounds()) == 0.0;
        if let Some(b) = smooth[i + 1..].iter().find(meets).filter(|b| is_flat(&a.shape) && is_flat(&b.shape)) {
            let what = format!(
                "`{}` and `{}` mirror or refract and may meet: rays part there, which cannot be differentiated yet",
                a.name, b.name
            );
            return Err(Error::usage(what, "keep them apart"));
        }
    }
    Ok(())
}

/// Light that a ball mirrors straight on at its rim has scattered once more than what passes beside it: it jumps where that counts.
fn rims_of_balls(scene: &Scene, motion: &Motion) -> Result<()> {
    let set = &scene.settings;
    let smooth = |s: &Instance| scene.surfaces[s.surface as usize].is_smooth();
    let several = scene.shapes.iter().filter(|s| smooth(s)).count() > 1;
    // Seen by the camera itself, or by way of another interface; other rims are `virtual_edge`'s.
    let ball = |i: &usize| {
        let s = &scene.shapes[*i];
        let moves = several || motion.moving.camera || motion.moves(*i as u32);
        smooth(s) && matches!(s.shape, Shape::Sphere(_)) && moves
    };
    let opaque = scene.shapes.iter().any(|s| !scene.is_null(s) && !smooth(s));
    for s in (0..scene.shapes.len()).filter(ball).map(|i| &scene.shapes[i]) {
        let fog = s.exterior.filter(|_| s.boundary).or_else(|| scene.outer_medium(s.shape.bounds().max * 2.0, None));
        let scatters = fog.is_some_and(|m| scene.media[m as usize].sigma_s.max() > 0.0);
        let jumps = set.hide_emitters
            || set.min_order > 0
            || set.max_depth < 2
            || (scatters || opaque || several) && set.max_depth < u32::MAX;
        if jumps {
            let what = format!(
                "at the rim of `{}` light counts one scattering more than beside it, and some numbers of scatterings are left out: how the rim moves cannot be told yet",
                s.name
            );
            return Err(Error::usage(
                what,
                "leave out --orders and hide_emitters; beside fog and surfaces, set max_depth to -1",
            ));
        }
    }
    Ok(())
}

/// Where beams are and anything moves: nothing may cut them.
fn beams(scene: &Scene, motion: &Motion) -> Result<()> {
    let beam = scene.lights.iter().find(|l| matches!(l.kind, LightKind::Beam { .. }));
    let Some(beam) = beam.filter(|_| motion.surfaces()) else { return Ok(()) };
    let curved = |s: &Instance| scene.surfaces[s.surface as usize].is_smooth() && !is_flat(&s.shape);
    if let Some(s) = scene.shapes.iter().find(|s| is_outlined(scene, s) || curved(s)) {
        let what = format!(
            "`{}` may stand in the beam `{}`: how its shadow there moves cannot be told yet",
            s.name, beam.name
        );
        return Err(Error::usage(what, "take it out, or use a directional light"));
    }
    for (i, l) in scene.lights.iter().enumerate() {
        let LightKind::Beam { position, direction, .. } = l.kind else { continue };
        if scene.beams.parted.contains(&(i as u32)) {
            let what = format!(
                "the beam `{}` falls over the border of a mirror or interface: how that moves cannot be told yet",
                l.name
            );
            return Err(Error::usage(what, "make what it falls on larger; a Gaussian beam has six radii"));
        }
        let outer = scene.sensors.first().and_then(|s| scene.outer_medium(s.to_world.translation, s.medium));
        // Told by an interface before it, or else by one behind it.
        let behind = scene.medium_toward(position, -direction, &On::default(), outer);
        if scene.medium_toward(position, direction, &On::default(), behind).is_some() {
            let what = format!(
                "the beam `{}` begins inside a medium, and something moves: this cannot be differentiated yet",
                l.name
            );
            return Err(Error::usage(what, "let it begin outside"));
        }
    }
    Ok(())
}
