//! What moves beside smooth interfaces and cannot be differentiated yet: refused by name.
//!
//! Behind an interface a camera ray turns with the index, with the interface and with the camera, and takes what it meets along (`transport::ray`). The edges of what it sees there, and those of
//! the interface itself, are [`super::virtual_edge`]'s. What is left are outlines of balls and cylinders that are bright from one side alone, and shadows of lights without extent that are cast through it ([`panes`] says where there are none). A smooth
//! silhouette of glass is no jump: at grazing all light is mirrored, straight on.

use super::beam_start::BeamStart;
use super::rims::Rim;
use super::{Motion, cast, contact, ends, panes};
use crate::error::{Error, Result};
use crate::light::Light;
use crate::math::nearest::between_triangles;
use crate::scene::beams::is_flat;
use crate::scene::chains::has_flat_faces;
use crate::scene::nearest::Kind;
use crate::scene::panes::PARALLEL;
use crate::scene::{Instance, Scene};
use crate::shape::triangles::triangles;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use rayon::prelude::*;
use std::cell::OnceCell;

/// Faces of a smooth mesh at most: every chain of them has to be found by chance.
pub(super) const FACETS: u32 = 512;
/// Where an edge is looked at for what it touches.
const PLACES: [f64; 5] = [0.02, 0.27, 0.5, 0.73, 0.98];

pub fn check(scene: &Scene, motion: &Motion) -> Result<()> {
    beams(scene, motion)?;
    let smooth = |s: &&Instance| scene.surfaces[s.surface as usize].is_smooth();
    let Some(interface) = scene.shapes.iter().find(smooth) else { return Ok(()) };
    let name = &interface.name;
    // Beams find their way, and others by way of flat faces.
    let lit = panes::are_known(scene, motion) || cast::are_known(scene, motion);
    let others = scene.lights.iter().zip(&motion.lights).filter(|(l, _)| !l.is_beam());
    let mut moves = others.into_iter().filter(|(_, m)| m.position || m.direction || m.angles);
    if let Some((light, _)) = moves.next().filter(|_| !lit) {
        return Err(unlit(scene, motion, interface, light));
    }
    // An index that changes moves what is behind it.
    if !motion.surfaces() {
        return Ok(());
    }
    if let Some(s) = scene.shapes.iter().filter(smooth).find(|s| s.shape.face_count() > FACETS) {
        let what = format!(
            "`{}` mirrors or refracts and has {} faces: to find the edges seen through so many takes too long",
            s.name,
            s.shape.face_count()
        );
        return Err(Error::scene(&s.span, what, format!("use a mesh of at most {FACETS} faces, or a sphere")));
    }
    if let Some(s) = scene.shapes.iter().filter(smooth).find(|s| s.light.is_some()) {
        let what = format!(
            "`{}` mirrors or refracts, and is a lamp: what moves beside it cannot be differentiated yet",
            s.name
        );
        return Err(Error::scene(&s.span, what, "give the lamp a diffuse bsdf"));
    }
    if let Some(s) = scene.shapes.iter().find(|s| is_outlined(scene, s) && !has_known_outline(scene, s)) {
        let what = format!(
            "`{name}` mirrors or refracts: how the outline of `{}` moves, seen by way of it, cannot be told yet",
            s.name
        );
        return Err(Error::scene(&s.span, what, "make it two-sided, or of flat faces"));
    }
    touching(scene, motion)?;
    contacts(scene, motion)?;
    outlines(scene, motion)?;
    let outer = scene.around(scene.sensors.first()).outer;
    let endless = outer.filter(|&m| scene.environment.is_some() && scene.media[m as usize].density_grid().is_some());
    if let Some(m) = endless {
        let what = format!(
            "the medium `{}` has no end before the environment, and rays turn in it: this cannot be differentiated yet",
            scene.media[m as usize].name
        );
        return Err(Error::usage(what, "bound the medium by a shape with a null bsdf"));
    }
    if let Some(l) = scene.lights.iter().find(|l| l.is_delta()).filter(|_| !lit) {
        return Err(unlit(scene, motion, interface, l));
    }
    Ok(())
}

/// Why what a light without extent sends by way of an interface is not known.
fn unlit(scene: &Scene, motion: &Motion, interface: &Instance, light: &Light) -> Error {
    let smooth = |s: &Instance| scene.surfaces[s.surface as usize].is_smooth();
    let (name, light) = (&interface.name, &light.name);
    let is_pane = |s: &Instance| matches!(s.shape, Shape::Rectangle(_) | Shape::Disk(_)) && smooth(s);
    let unknown = || cast::unknown(scene, motion).filter(|s| !scene.is_null(s));
    // Beside panes nothing else would do.
    let round = unknown().next().filter(|_| !unknown().any(is_pane));
    let extent = "or give the light an extent: an area light, an environment, or media that emit";
    let (at, what, remedy) = match round {
        Some(s) if is_metal_ball(scene, s) => (
            s,
            format!(
                "light of `{light}` is mirrored by the ball `{}`, and something moves: how that light moves can be told where nothing else mirrors or refracts, outward normals and lights outside of the ball alone",
                s.name
            ),
            match scene.shapes.iter().find(|o| smooth(o) && o.name != s.name) {
                Some(other) => format!("take `{}` out, or make it rough, {extent}", other.name),
                None => format!("keep flip_normals off and lights outside, {extent}"),
            },
        ),
        Some(s) if smooth(s) => (
            s,
            format!(
                "light of `{light}` falls by way of `{}`, which is round, not convex, or has very many faces, and something moves: how that light moves cannot be told yet",
                s.name
            ),
            format!(
                "make it of flat faces (a cube, or a convex mesh of at most {FACETS} faces with face_normals; or a ball of metal, by itself), {extent}"
            ),
        ),
        Some(s) => (
            s,
            format!(
                "`{}` may cast a shadow of the light `{light}` by way of `{name}`, which mirrors or refracts: how the shadow of what has vertex normals, or very many faces, moves there cannot be told yet",
                s.name
            ),
            format!("take it out, make it of flat faces, {extent}"),
        ),
        None if scene.chains.touching => (
            interface,
            format!(
                "faces that mirror or refract touch, and something moves: light of `{light}` passes from one to the other without a way between, which cannot be differentiated yet"
            ),
            format!("leave a gap between them (a millionth of the scene's size is enough), {extent}"),
        ),
        None => (
            interface,
            format!(
                "`{name}` mirrors or refracts, and something moves: the shadows of the light `{light}` at it cannot be differentiated yet"
            ),
            format!(
                "only flat faces may be there: rectangles and disks that are parallel to one another, or of glass cubes and convex meshes, of metal rectangles and disks too, or nothing but a ball of metal, and of all else anything but meshes with vertex normals or more than 4096 faces; {extent}"
            ),
        ),
    };
    Error::scene(&at.span, what, &remedy)
}

fn is_metal_ball(scene: &Scene, s: &Instance) -> bool {
    let is_metal = matches!(scene.surfaces[s.surface as usize], Surface::Conductor { .. });
    matches!(s.shape, Shape::Sphere(_)) && is_metal
}

/// Whether its outline may be seen by way of an interface.
fn is_outlined(scene: &Scene, s: &Instance) -> bool {
    let smooth = scene.surfaces[s.surface as usize].is_smooth();
    !scene.is_null(s) && (!smooth || s.light.is_some() || s.shape.is_round() && scene.has_outline(s))
}

/// Whether [`super::virtual_edge`] knows all of its outline.
fn has_known_outline(scene: &Scene, s: &Instance) -> bool {
    match s.shape {
        Shape::Rectangle(_) | Shape::Cube(_) | Shape::Mesh(_) => true,
        Shape::Sphere(_) | Shape::Cylinder(_) | Shape::Disk(_) => !scene.surfaces[s.surface as usize].is_smooth(),
    }
}

/// Whether two are single flat faces in planes that are parallel and apart.
fn are_apart(scene: &Scene, a: &Instance, b: &Instance) -> bool {
    let single = |s: &Instance| matches!(s.shape, Shape::Rectangle(_) | Shape::Disk(_));
    let plane = |s: &Instance| {
        let p = s.shape.bounds().center();
        (p, s.shape.normal(0, p))
    };
    let ((p, n), (q, m)) = (plane(a), plane(b));
    single(a) && single(b) && n.cross(m).length() <= PARALLEL && (q - p).dot(n).abs() > ends::contact(scene)
}

/// Smooth faces of two shapes that meet, where rays part. Those of glass without an inside, whose borders count as out of sight, must have boxes around them that are apart.
pub(super) fn touching(scene: &Scene, motion: &Motion) -> Result<()> {
    // A disk that closes a tube has an inside with it.
    let closes = |id: u32| motion.rims.iter().any(|r| !r.bounds_half_space(scene) && r.shapes().any(|s| s == id));
    let is_pane = |&(id, s): &(u32, &Instance)| match s.shape {
        Shape::Disk(_) => !closes(id),
        _ => scene.is_half_space(id),
    };
    let reach = contact::reach(scene);
    let counts = |(_, s): &(u32, &Instance)| {
        let smooth = scene.surfaces[s.surface as usize].is_smooth();
        // Panels of one body may be meshes of their own.
        smooth && s.shape.face_count() <= FACETS && (is_flat(&s.shape) || s.shape.is_closed() && has_flat_faces(s))
    };
    let smooth: Vec<(u32, &Instance)> = (0..).zip(&scene.shapes).filter(counts).collect();
    let met = |i: usize| {
        let (a, own) = (smooth[i], OnceCell::new());
        let meets = |b: &&(u32, &Instance)| {
            let [first, second] = [a.1, b.1];
            if first.shape.bounds().gap(&second.shape.bounds()) > reach || are_apart(scene, first, second) {
                return false;
            }
            if is_pane(&a) || is_pane(b) {
                return is_flat(&first.shape) && is_flat(&second.shape);
            }
            let own: &Vec<_> = own.get_or_init(|| triangles(&first.shape));
            triangles(&second.shape).iter().any(|(around, t)| {
                own.iter().any(|(box_of, o)| around.gap(box_of) <= reach && between_triangles(*o, *t) <= reach)
            })
        };
        smooth[i + 1..].iter().find(meets).map(|b| (a, *b))
    };
    let Some((a, b)) = (0..smooth.len()).into_par_iter().find_map_first(met) else { return Ok(()) };
    // Of panes only the boxes around them are known to meet.
    let pane = is_pane(&a) || is_pane(&b);
    let may = if pane { "may " } else { "" };
    let what = format!(
        "`{}` and `{}` mirror or refract and {may}touch, or pass through each other: rays part there, which cannot be differentiated yet",
        a.1.name, b.1.name
    );
    let remedy = if pane {
        "keep them apart, so that the boxes around them (along the axes) do not meet; or make bodies of them: cubes, closed meshes, cylinders that two disks close (same rims, same bsdf, moving with them)"
    } else if [a, b].iter().any(|s| matches!(s.1.shape, Shape::Disk(_))) {
        "leave a gap between them (a thousandth of the disk's size is enough)"
    } else {
        "leave a gap between them (a millionth of the scene's size is enough)"
    };
    Err(Error::scene(&b.1.span, what, remedy))
}

/// An edge on a smooth face that is not its own is seen from the other side through that face, or hidden behind it, which [`super::virtual_edge`] does not tell; the border of a half-space of glass
/// where something stands in it is in sight.
pub(super) fn contacts(scene: &Scene, motion: &Motion) -> Result<()> {
    let smooth = |id: u32| scene.surface_of(id).is_smooth();
    let edges = motion.edges(scene);
    let touched = |i: usize| {
        let edge = edges.get(scene, i);
        let own: Vec<(u32, u32)> = edge.sides().map(|s| (s.0, s.1)).collect();
        let of_glass = own.iter().any(|f| smooth(f.0));
        let half_space = own.len() == 1 && scene.is_half_space(own[0].0);
        let meets = |s: u32, f: u32| match (of_glass, half_space) {
            (false, _) => smooth(s),
            (true, true) => s != own[0].0,
            (true, false) => smooth(s) && own.iter().all(|o| o.0 != s),
        } && !own.contains(&(s, f));
        PLACES.iter().find_map(|&t| {
            let p = edge.edge.a.lerp(edge.edge.b, t);
            let near = scene.nearest_point(Kind::Opaque, p, ends::contact(scene), &meets)?;
            Some((own[0].0, near.shape))
        })
    };
    let of_rim = |rim: &Rim| {
        let own: Vec<u32> = rim.shapes().collect();
        let half_space = rim.bounds_half_space(scene);
        let meets = |s: u32, _: u32| (smooth(s) || half_space) && !own.contains(&s);
        PLACES.iter().find_map(|&u| {
            let near = scene.nearest_point(Kind::Opaque, rim.edge(u).a, ends::contact(scene), &meets)?;
            Some((own[0], near.shape))
        })
    };
    let of_rims = || motion.rims.iter().find_map(of_rim);
    let Some((a, b)) = (0..edges.len()).into_par_iter().find_map_first(touched).or_else(of_rims) else {
        return Ok(());
    };
    let name = |k: u32| &scene.shapes[k as usize].name;
    let span = &scene.shapes[a as usize].span;
    let what = format!(
        "`{}` touches `{}`, one of which mirrors or refracts: what jumps where they touch cannot be told yet",
        name(a),
        name(b)
    );
    let remedy = if scene.is_half_space(a) || scene.is_half_space(b) {
        "a rectangle or disk of glass bounds a half-space: let it reach beyond all that stands in it, or make a body of it (a cube, a closed mesh)"
    } else {
        "leave a gap between them (a ten-thousandth of their size is enough)"
    };
    Err(Error::scene(span, what, remedy))
}

/// Light that a ball, or a wall (cylinder), mirrors straight on at its outline has scattered once more than what passes beside it: it jumps where that counts.
fn outlines(scene: &Scene, motion: &Motion) -> Result<()> {
    let set = &scene.settings;
    let smooth = |s: &Instance| scene.surfaces[s.surface as usize].is_smooth();
    let several = scene.shapes.iter().filter(|s| smooth(s)).count() > 1;
    // Seen by the camera itself, or by way of another interface; others are `virtual_edge`'s.
    let round = |i: &usize| {
        let s = &scene.shapes[*i];
        let moves = several || motion.moving.camera || motion.moves(*i as u32);
        smooth(s) && s.shape.is_round() && moves
    };
    let opaque = scene.shapes.iter().any(|s| !scene.is_null(s) && !smooth(s));
    let scatters_beside = scene.scatters_beside();
    for i in (0..scene.shapes.len()).filter(round) {
        let (s, scatters) = (&scene.shapes[i], scatters_beside(i as u32));
        let jumps = set.hide_emitters
            || set.min_order > 0
            || set.max_depth < 2
            || (scatters || opaque || several) && set.max_depth < u32::MAX;
        if jumps {
            let what = format!(
                "at the outline of `{}` light counts one scattering more than beside it, and some numbers of scatterings are left out: how the outline moves cannot be told yet",
                s.name
            );
            return Err(Error::scene(
                &s.span,
                what,
                "set max_depth to -1, beside fog and surfaces; leave out --orders and hide_emitters",
            ));
        }
    }
    Ok(())
}

/// Where beams are and anything moves: what cuts them beside glass and mirrors has to be known, and nothing may cut them where they begin.
fn beams(scene: &Scene, motion: &Motion) -> Result<()> {
    let beam = scene.lights.iter().find(|l| l.is_beam());
    let Some(beam) = beam.filter(|_| motion.surfaces()) else { return Ok(()) };
    let curved = |s: &Instance| scene.surfaces[s.surface as usize].is_smooth() && !is_flat(&s.shape);
    let smooth = scene.has_smooth();
    if let Some(s) = scene.shapes.iter().filter(|_| smooth).find(|s| curved(s)) {
        let what = format!(
            "`{}`, which mirrors or refracts and is not flat, may stand in the beam `{}`: how its light moves there cannot be told yet",
            s.name, beam.name
        );
        return Err(Error::scene(
            &s.span,
            what,
            "make it a cube or a rectangle, take it out, or use a directional light",
        ));
    }
    if cast::takes_beams(scene, motion) {
        cast::check(scene, motion)?;
    } else if cast::cut_beams(scene) {
        return Err(cut(scene, motion, beam));
    }
    let around = scene.around(scene.sensors.first());
    for start in (0..).zip(&scene.lights).filter_map(|(id, l)| BeamStart::new(id, l)) {
        if smooth && start.is_in_medium(scene, &around) {
            let what = format!(
                "the beam `{}` begins inside a medium, beside glass or mirrors, and something moves: this cannot be differentiated yet",
                scene.lights[start.light() as usize].name
            );
            return Err(Error::usage(what, "let it begin outside, all of it"));
        }
        start.check(scene)?;
    }
    Ok(())
}

/// Why what cuts a beam is not known.
fn cut(scene: &Scene, motion: &Motion, beam: &Light) -> Error {
    let flat = "use of glass only cubes, of metal rectangles and disks too, and of all else anything but meshes with vertex normals or more than 4096 faces; or use a directional light";
    if let Some(&(light, shape)) = scene.beams.parted.first() {
        let (s, beam) = (&scene.shapes[shape as usize], &scene.lights[light as usize]);
        let what = format!(
            "the beam `{}` falls over the border of `{}`, which mirrors or refracts: how that moves cannot be told yet",
            beam.name, s.name
        );
        return Error::scene(&s.span, what, format!("make that larger, or the beam narrower; or {flat}"));
    }
    match cast::unknown(scene, motion).next() {
        Some(s) => {
            let what = format!(
                "something opaque may stand in the beam `{}`, and `{}` beside it: where the beam's light ends there cannot be told yet",
                beam.name, s.name
            );
            Error::scene(&s.span, what, flat)
        }
        None => Error::usage(
            format!(
                "the beam `{}` ends at too many faces, or at faces that touch: this cannot be differentiated yet",
                beam.name
            ),
            flat,
        ),
    }
}
