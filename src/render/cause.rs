//! What of a scene asks for a term of the derivative that does not exist, so that a refusal names an object, its place and a remedy.

use super::plan::{Motion, Term};
use crate::error::Span;
use crate::scene::parts::{LightKindPart, LightPart, MediumPart, Parts, ShapeKind, ShapePart, SurfacePart, VolumePart};

/// An object that makes a derivative impossible for now.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cause {
    pub span: Span,
    pub name: String,
    pub remedy: &'static str,
}

impl Cause {
    pub fn of_shape(s: &ShapePart<f64>, remedy: &'static str) -> Self {
        Cause { span: s.span.clone(), name: s.name.clone(), remedy }
    }

    pub fn of_light(l: &LightPart<f64>, remedy: &'static str) -> Self {
        Cause { span: l.span.clone(), name: l.name.clone(), remedy }
    }

    pub fn of_medium(m: &MediumPart<f64>, remedy: &'static str) -> Self {
        Cause { span: m.span.clone(), name: m.name.clone(), remedy }
    }
}

pub fn nearest_grid(p: &Parts<f64>) -> Option<&MediumPart<f64>> {
    p.media.iter().find(|m| matches!(m.density, VolumePart::Vol { smooth: false, .. }))
}

/// Point, spot or directional.
fn is_zero_measure(k: &LightKindPart<f64>) -> bool {
    use LightKindPart::{Directional, Point, Spot};
    matches!(k, Point { .. } | Spot { .. } | Directional { .. })
}

pub fn zero_measure(p: &Parts<f64>) -> Option<&LightPart<f64>> {
    p.lights.iter().find(|l| is_zero_measure(&l.kind))
}

/// Whether the borders of its shadows, and of the light that it mirrors or lets through, are known, as `term::cast` has it: straight ones, and those of what is round and opaque, or a single ball of metal. One of glass without an inside has none that is in sight.
pub fn has_known_borders(p: &Parts<f64>, s: &ShapePart<f64>) -> bool {
    match s.kind {
        ShapeKind::Sphere { .. } => !is_smooth(p, s.surface) || is_lone_mirror(p, s),
        ShapeKind::Cylinder { .. } => !is_smooth(p, s.surface),
        ShapeKind::Disk | ShapeKind::Rectangle => !matches!(p.surfaces[s.surface], SurfacePart::Dielectric { .. }),
        _ => true,
    }
}

/// Whether this, of metal, is all that mirrors or refracts. Lights within it are the scene's matter (`cast_route::lone_mirror`).
fn is_lone_mirror(p: &Parts<f64>, s: &ShapePart<f64>) -> bool {
    let smooth = p.shapes.iter().filter(|s| is_smooth(p, s.surface)).count();
    smooth == 1 && !s.flip_normals && matches!(p.surfaces[s.surface], SurfacePart::Conductor { .. })
}

/// What keeps light without extent from being known by way of smooth surfaces: something round, or the light itself.
pub fn unlit(p: &Parts<f64>, of_light: &'static str) -> Option<Cause> {
    let light = zero_measure(p)?;
    let is_pane = |s: &ShapePart<f64>| {
        let flat = matches!(s.kind, ShapeKind::Rectangle | ShapeKind::Disk);
        flat && is_smooth(p, s.surface) && !has_known_borders(p, s)
    };
    let counts = |s: &&ShapePart<f64>| !matches!(p.surfaces[s.surface], SurfacePart::Null) && !has_known_borders(p, s);
    let round = p.shapes.iter().find(counts);
    let panes = p.shapes.iter().any(is_pane);
    // Beside panes nothing else would do.
    let beside = |s: &&ShapePart<f64>| {
        let flat = matches!(s.kind, ShapeKind::Rectangle);
        panes && is_outlined(p, s.surface) && !flat
    };
    if let Some(s) = p.shapes.iter().find(beside) {
        let remedy = "beside rectangles and disks of glass, in light without extent, only rectangles may be opaque: make the glass a cube or a mesh, or give the light an extent";
        return Some(Cause::of_shape(s, remedy));
    }
    match round.filter(|_| !panes) {
        Some(s) => Some(Cause::of_shape(
            s,
            "in light without extent glass and mirrors must have flat faces, or be a ball of metal (normals outward) and nothing else: make it a cube or a mesh; or use an area light, an environment or, where nothing is opaque, a collimated beam",
        )),
        None => Some(Cause::of_light(light, of_light)),
    }
}

pub fn is_smooth(p: &Parts<f64>, s: usize) -> bool {
    p.surfaces[s].is_smooth()
}

/// Something that has an outline where it is seen in glass or mirrors.
pub fn is_outlined(p: &Parts<f64>, s: usize) -> bool {
    !matches!(p.surfaces[s], SurfacePart::Null) && !is_smooth(p, s)
}

/// A tube that mirrors on one side alone, as `term::interfaces` has it.
pub fn dark_behind(p: &Parts<f64>) -> Option<&ShapePart<f64>> {
    let one_sided =
        |s: &ShapePart<f64>| matches!(p.surfaces[s.surface], SurfacePart::Conductor { two_sided: false, .. });
    p.shapes.iter().find(|s| matches!(s.kind, ShapeKind::Cylinder { .. }) && one_sided(s))
}

/// What of the scene asks for a term that does not exist for such a motion.
pub fn cause(p: &Parts<f64>, term: Term, m: &Motion) -> Option<Cause> {
    let moving = |i: Option<usize>, remedy: &'static str| Some(Cause::of_medium(&p.media[i?], remedy));
    let jumps = m.other_volume.or(m.box_border.filter(|_| term == Term::N));
    if jumps.is_some() {
        return moving(jumps, "a .vol ends at its box with a jump: convert it to .vdb");
    }
    if m.environment.is_some() {
        let light = &p.lights[m.environment?];
        return Some(Cause::of_light(light, "turn the camera and the objects instead"));
    }
    match term {
        Term::C => {
            // What a beam ends at is the reason that comes first (`plan::needed`).
            let has_beam = p.lights.iter().any(|l| matches!(l.kind, LightKindPart::Beam { .. }))
                && p.shapes.iter().any(|s| is_outlined(p, s.surface));
            let flat = |s: &ShapePart<f64>| matches!(s.kind, ShapeKind::Rectangle | ShapeKind::Disk | ShapeKind::Cube);
            let curved = p.shapes.iter().find(|s| is_smooth(p, s.surface) && !flat(s));
            let cuts = curved.or_else(|| {
                let solid = |s: &&ShapePart<f64>| !matches!(p.surfaces[s.surface], SurfacePart::Null);
                p.shapes.iter().filter(solid).find(|s| !has_known_borders(p, s))
            });
            match cuts.filter(|_| has_beam && p.shapes.iter().any(|s| is_smooth(p, s.surface))) {
                Some(s) => {
                    let remedy = "in a beam, beside what is opaque, use of glass only cubes, and of metal rectangles and disks too; or use a directional light";
                    Some(Cause::of_shape(s, remedy))
                }
                None => unlit(
                    p,
                    "use an area light that is a rectangle, an environment or, where nothing is opaque, a collimated beam",
                ),
            }
        }
        Term::G | Term::R => {
            unlit(p, "use an area light, an environment or, where nothing is opaque, a collimated beam")
        }
        _ => None,
    }
}
