//! Warnings that need the whole scene: cameras and lights in media that they do not name.

use super::beams::is_flat;
use super::chains::has_flat_faces;
use super::parts::{Parts, SurfacePart};
use super::{On, Scene};
use crate::error::{Span, Warning, WarningKind};
use crate::light::LightKind;
use crate::math::DVec3;
use crate::math::ball_ways::REFLECTIONS;
use crate::math::fold::MOST;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;

/// Look for what works but is probably not meant.
pub fn advise(scene: &mut Scene, parts: &Parts<f64>) {
    let mut found = Vec::new();
    for (s, part) in scene.sensors.iter().zip(&parts.sensors) {
        let (w, h) = (s.width as f64, s.height as f64);
        let (o, d) = s.ray(0.5 * w, 0.5 * h);
        if let Some(name) = unnamed_medium(scene, o, d, part.medium) {
            found.push(warning(
                WarningKind::CameraInUnnamedMedium,
                &part.span,
                format!(
                    "the sensor stands inside medium `{name}` but does not name it: the fog begins behind its boundary"
                ),
                format!("add <ref id=\"{name}\"/> to the sensor"),
            ));
        }
    }
    for (l, part) in scene.lights.iter().zip(&parts.lights) {
        let Some(p) = l.center() else { continue };
        if let Some(name) = unnamed_medium(scene, p, DVec3::Z, part.medium) {
            found.push(warning(
                WarningKind::LightInUnnamedMedium,
                &part.span,
                format!("light `{}` stands inside medium `{name}` but does not name it", l.name),
                format!("nothing changes here (shadow rays know their medium), but other renderers want <ref id=\"{name}\"/>"),
            ));
        }
    }
    for s in &parts.shapes {
        let SurfacePart::Rough { alpha, .. } = &parts.surfaces[s.surface] else { continue };
        if *alpha > 1.0 {
            let bsdf = &parts.surface_names[s.surface];
            found.push(warning(
                WarningKind::UnlikelyValue,
                &s.span,
                format!("shape `{}`: the bsdf `{bsdf}` has an alpha of {alpha}, rougher than anything that is usual", s.name),
                "use an alpha of 1 or less: light that goes from facet to facet is left out, so rougher surfaces are too dark"
                    .into(),
            ));
        }
    }
    if scene.surfaces.iter().any(Surface::is_smooth) {
        for (l, part) in scene.lights.iter().zip(&parts.lights) {
            let beam = matches!(l.kind, LightKind::Beam { .. });
            let all_of_ball = scene.shows_all_light_of_a_ball();
            if !all_of_ball && scene.shows_all_light_of_a_ball_but_reflections() {
                if l.is_delta() || beam {
                    found.push(warning(
                        WarningKind::LightBehindGlass,
                        &part.span,
                        format!("what `{}` sends through the ball is followed for {REFLECTIONS} reflections inside: more are not in the picture", l.name),
                        format!("set max_depth to {} or less, which leaves out whatever is mirrored as often", REFLECTIONS + 2),
                    ));
                }
                continue;
            }
            let known = |s: &super::Instance| has_flat_faces(s) || all_of_ball && matches!(s.shape, Shape::Sphere(_));
            let followed = |s: &&super::Instance| !scene.surfaces[s.surface as usize].is_smooth() || known(s);
            if let Some(s) = scene.shapes.iter().find(|s| beam && !followed(s)) {
                found.push(warning(
                    WarningKind::LightBehindGlass,
                    &part.span,
                    format!("of what beam `{}` sends by way of `{}` not all is in the picture yet", l.name, s.name),
                    "beams are followed at rectangles, disks, cubes and meshes with face normals, and by one ball"
                        .into(),
                ));
            }
            let chains = &scene.chains;
            let by_facets =
                scene.shapes.iter().any(|s| scene.surfaces[s.surface as usize].is_smooth() && !is_flat(&s.shape));
            let left_out = [
                (
                    chains.touching,
                    "by faces of glass or mirrors that touch".to_string(),
                    "leave a small gap between the shapes, or make them one".to_string(),
                ),
                (
                    chains.cut,
                    "by some of very many sequences of flat faces".into(),
                    "use fewer panes, mirrors and facets, or fewer lights without extent; or set a smaller max_depth"
                        .into(),
                ),
                (
                    chains.long,
                    format!("by more than {MOST} flat faces in turn"),
                    format!("set max_depth to {} or less, which leaves it out, too", MOST + 2),
                ),
            ];
            if let Some((_, what, hint)) = left_out
                .into_iter()
                .find(|w| w.0)
                .filter(|_| (l.is_delta() || beam && by_facets) && scene.is_smooth_at_faces_only())
            {
                found.push(warning(
                    WarningKind::LightBehindGlass,
                    &part.span,
                    format!("what light `{}` sends {what} is not in the picture yet", l.name),
                    hint,
                ));
            }
            if l.is_delta() && !scene.is_smooth_at_faces_only() && !all_of_ball {
                found.push(warning(
                    WarningKind::LightBehindGlass,
                    &part.span,
                    format!(
                        "of what light `{}` sends by way of glass or mirrors, only what meets nothing but flat faces (rectangles, disks, cubes, meshes with face normals), or one ball alone, is in the picture yet",
                        l.name
                    ),
                    "such light has to be connected by way of the interfaces; a small area light shows it, with noise"
                        .into(),
                ));
            }
        }
    }
    for &id in &scene.beams.cut {
        let part = &parts.lights[id as usize];
        found.push(warning(
            WarningKind::LightBehindGlass,
            &part.span,
            format!("beam `{}` is mirrored and refracted more often than it is followed", part.name),
            "set max_depth to 14 or less, or use fewer mirrors and panes".into(),
        ));
    }
    if scene.lights.is_empty() && scene.media.iter().all(|m| m.emission.is_none()) {
        found.push(warning(
            WarningKind::NoEffect,
            &Span { file: parts.sensors[0].span.file.clone(), line: 0, column: 0 },
            "nothing in the scene shines: every picture is black".into(),
            "add an <emitter>, or emission to a medium".into(),
        ));
    }
    let coarse = scene.bounds.magnitude() > 1e5 * scene.bounds.radius();
    if !scene.bounds.is_empty() && scene.bounds.radius() > 0.0 && coarse {
        found.push(warning(
            WarningKind::LargeCoordinates,
            &Span { file: parts.sensors[0].span.file.clone(), line: 0, column: 0 },
            format!(
                "the scene stands at coordinates of {:.1e}, {:.1e} of its size",
                scene.bounds.magnitude(),
                scene.bounds.magnitude() / scene.bounds.radius()
            ),
            "move it near the origin: mesh files hold single precision".into(),
        ));
    }
    scene.warnings.extend(found);
}

fn warning(kind: WarningKind, span: &Span, what: String, hint: String) -> Warning {
    Warning { kind, span: span.clone(), what, hint }
}

/// The name of the medium whose boundary a ray from `p` leaves first, if the point claims to be in another one.
fn unnamed_medium(scene: &Scene, p: DVec3, w: DVec3, named: Option<usize>) -> Option<String> {
    let named = named.map(|m| m as u32);
    let closed = |s: &Shape| s.is_closed();
    let hit = scene.intersect(p, w, f64::INFINITY, &On::default(), named)?;
    let shape = &scene.shapes[hit.shape as usize];
    let leaves = shape.boundary && w.dot(hit.n) > 0.0 && closed(&shape.shape);
    // A camera exactly on the boundary is inside or outside as it says.
    let on_boundary = hit.t <= scene.tolerance(p);
    (leaves && !on_boundary && shape.interior != named && shape.interior.is_some())
        .then(|| scene.media[shape.interior? as usize].name.clone().into())
        .flatten()
}
