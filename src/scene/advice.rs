//! Warnings that need the whole scene: cameras and lights in media that they do not name, light that smooth surfaces send on and nothing follows, and what the derivatives by some parameters leave out.

use super::chains::{MOST, has_flat_faces};
use super::lids;
use super::parts::{LightKindPart, Movable, Parts, ShapeKind, ShapePart, SurfacePart};
use super::{On, Scene, SceneDesc, arrays};
use crate::error::{Result, Span, Warning, WarningKind};
use crate::light::{Light, LightKind};
use crate::math::ball_ways::REFLECTIONS;
use crate::math::{DVec3, Dual};
use crate::shape::bounds::Bounds;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use crate::surface::rough::MATCHED;
use std::collections::BTreeMap;

/// Of alphas: from here on facets that stand upright are told of.
const FEW: f64 = 0.01;
/// Rounding of positions, in free paths, from which on it shows (0.2 % of a dense medium's radiance at 0.03).
const COARSE: f64 = 1e-2;

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
    for (i, (m, part)) in scene.media.iter().zip(&parts.media).enumerate() {
        // Where it is, or the whole scene where it has no borders of its own.
        let own = scene.shapes.iter().filter(|s| s.boundary && s.interior == Some(i as u32));
        let own = own.fold(Bounds::EMPTY, |b, s| b.union(&s.shape.bounds()));
        let magnitude = if own.is_empty() { scene.bounds.magnitude() } else { own.magnitude() };
        let sigma_t = m.sigma_t.max();
        if magnitude.is_finite() && sigma_t * magnitude * f64::EPSILON > COARSE {
            let path = 1.0 / sigma_t;
            found.push(warning(
                WarningKind::UnlikelyValue,
                &part.span,
                format!("medium `{}`: free paths are {path:.1e} long, less than positions of size {magnitude:.1e} resolve: its skin lets light through", part.name),
                format!("use an extinction of at most {:.1e} (the picture is no other: nothing gets deeper), or an opaque surface", COARSE / (magnitude * f64::EPSILON)),
            ));
        }
    }
    shut(parts, &mut found);
    found.extend(lids::advise(scene, parts));
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
    for (l, part) in scene.lights.iter().zip(&parts.lights).filter(|(l, _)| l.origin().is_some()) {
        for (what, hint) in left_out(scene, l) {
            let what = format!("what light `{}` sends {what} is not in the picture yet", l.name);
            found.push(warning(WarningKind::LightBehindGlass, &part.span, what, hint));
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

/// Media that only opaque shapes bound, and no camera is in.
fn shut(parts: &Parts<f64>, found: &mut Vec<Warning>) {
    let is_opaque = |s: &&ShapePart<f64>| !parts.surfaces[s.surface].is_transparent();
    let sides = |s: &ShapePart<f64>| [s.interior, s.exterior].into_iter().flatten();
    let mut open = vec![false; parts.media.len()];
    let ways = parts.shapes.iter().filter(|s| !is_opaque(s)).flat_map(sides);
    ways.chain(parts.sensors.iter().filter_map(|s| s.medium)).for_each(|m| open[m] = true);
    for s in parts.shapes.iter().filter(is_opaque) {
        let Some(m) = sides(s).find(|&m| !open[m]) else { continue };
        let default = if s.default_surface { "no <bsdf> (so a diffuse one)" } else { "an opaque <bsdf>" };
        let what = format!(
            "shape `{}` bounds the medium `{}` but has {default}, and nothing else lets light in",
            s.name, parts.media[m].name
        );
        let hint = "add <bsdf type=\"null\"/> for an index-matched boundary; a camera in the medium names it".into();
        found.push(warning(WarningKind::MediumBehindOpaqueBoundary, &s.span, what, hint));
    }
}

/// What derivatives by these parameters are known to leave out.
pub fn of_parameters(desc: &SceneDesc, wrt: &[String]) -> Result<Vec<Warning>> {
    let mut found = Vec::new();
    // By surface, in its order.
    let mut edges: BTreeMap<usize, Vec<String>> = BTreeMap::new();
    for name in wrt {
        let array = arrays::split(name).is_some();
        let values = if array { desc.values() } else { desc.dual(desc.wrt(name)?) };
        let parts = Parts::read(desc, &values)?;
        kinks(&parts, name, &mut found);
        let turns = if array { !arrays::is_voxels(name) } else { turns(&parts) };
        for surface in edges_that_move(&parts, turns) {
            edges.entry(surface).or_default().push(format!("`{name}`"));
        }
    }
    if !edges.is_empty() {
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        found.extend(edges.into_iter().filter_map(|(surface, names)| edge_on(&parts, surface, &names.join(", "))));
    }
    Ok(found)
}

/// Whether anything changes its place or direction.
fn turns(parts: &Parts<Dual<1>>) -> bool {
    let in_place = |what: &Movable| matches!(what, Movable::Density(_) | Movable::Glow(_) | Movable::Albedo(_));
    parts.movable().iter().any(|(what, x)| !in_place(what) && x.iter().any(|x| x.d[0] != 0.0))
}

fn without_extent<R>(parts: &Parts<R>) -> impl Iterator<Item = &str> {
    let has = |k: &LightKindPart<R>| {
        matches!(k, LightKindPart::Area { .. } | LightKindPart::Constant | LightKindPart::Envmap { .. })
    };
    parts.lights.iter().filter(move |l| !has(&l.kind)).map(|l| l.name.as_str())
}

/// Surfaces of GGX glass beside light without extent, where directions turn or an index changes. Light that is refracted ends with a jump where the facet is upright ([`crate::surface::upright`]). For light that
/// arrives from a continuum of directions that is computed; what comes from a single one jumps along a curve on the glass ([`crate::term::facet_edge`]).
fn edges_that_move(parts: &Parts<Dual<1>>, turns: bool) -> Vec<usize> {
    let lit = without_extent(parts).next().is_some();
    let moves = |s: &SurfacePart<Dual<1>>| {
        let upright = s.upright().filter(|(alpha, _)| alpha.v > FEW);
        upright.is_some_and(|(_, indices)| turns || indices.iter().any(|n| n.d[0] != 0.0))
    };
    (0..parts.surfaces.len()).filter(|&k| lit && moves(&parts.surfaces[k])).collect()
}

/// What of such an edge is not known: on faces that may be curved, by way of other glass, from far away.
fn edge_on(parts: &Parts<f64>, surface: usize, names: &str) -> Option<Warning> {
    let is_flat = |s: &ShapePart<f64>| matches!(s.kind, ShapeKind::Rectangle | ShapeKind::Cube) || s.face_normals;
    let own = || parts.shapes.iter().filter(|s| s.surface == surface);
    let round = own().find(|s| !is_flat(s));
    let (why, help) = if round.is_some() {
        (
            "on shapes that may be round",
            "use flat faces: rectangles, cubes, and meshes with <boolean name=\"face_normals\" value=\"true\"/>",
        )
    } else if parts.shapes.iter().any(|s| parts.surfaces[s.surface].is_smooth()) {
        ("by way of smooth glass and mirrors", "leave the smooth glass and mirrors out")
    } else if parts.sensors.iter().any(|s| s.tan_half.is_none()) {
        ("as orthographic cameras see it", "use a perspective camera that is far away")
    } else {
        return None;
    };
    let s = round.or_else(|| own().next())?;
    let (alpha, _) = parts.surfaces[surface].upright()?;
    let lights = without_extent(parts).map(|l| format!("`{l}`")).collect::<Vec<_>>().join(", ");
    let what = format!(
        "shape `{}`: derivatives by {names} {} biased where light without extent ({lights}) shines through it aslant: rough glass of `ggx` facets (alpha {alpha}) cuts light off at some angles, and how that edge moves {why} is known for area lights and skies only",
        s.name,
        if matches!(s.kind, ShapeKind::Obj(_) | ShapeKind::Ply(_)) { "may be" } else { "are" }
    );
    let hint = format!(
        "{help}; or use a small area light, or <string name=\"distribution\" value=\"beckmann\"/>, which has no such edge"
    );
    Some(warning(WarningKind::EdgeOnFacets, &s.span, what, hint))
}

/// Smooth interfaces between equal indices of which one changes with a parameter. Light at grazing is mirrored as soon as they differ, whichever is the larger ([T] 9), in a
/// cone whose size is |n₁ - n₂|: the picture has two slopes there.
fn kinks(parts: &Parts<Dual<1>>, name: &str, found: &mut Vec<Warning>) {
    for s in &parts.shapes {
        let SurfacePart::Dielectric { interior, exterior } = &parts.surfaces[s.surface] else { continue };
        let ratio = *interior / *exterior;
        if (ratio.v - 1.0).abs() < MATCHED && ratio.d[0] != 0.0 {
            let n = exterior.v;
            let what = format!(
                "shape `{}`: the index of refraction is {n} on both sides, where the picture may have a kink: light at grazing is mirrored as soon as they differ, and the derivative by `{name}` leaves that out",
                s.name
            );
            let [above, below] = [n + 0.001, n - 0.001].map(|x| (x * 1e6).round() / 1e6);
            let hint = format!("set an index to {above} or {below}, for the slope on that side");
            found.push(warning(WarningKind::Kink, &s.span, what, hint));
        }
    }
}

/// By which smooth surfaces light without extent, or of a beam, is not followed, and what helps.
fn left_out(scene: &Scene, l: &Light) -> Vec<(String, String)> {
    let mut found = Vec::new();
    let mut add = |what: String, hint: &str| found.push((what, hint.to_string()));
    let smooth = || scene.shapes.iter().filter(|s| scene.surfaces[s.surface as usize].is_smooth());
    let by_facets = smooth().any(|s| matches!(s.shape, Shape::Mesh(_)) && has_flat_faces(s));
    let chains = &scene.chains;
    if l.is_delta() || by_facets {
        if chains.touching {
            add(
                "by faces of glass or mirrors that touch".into(),
                "leave a gap between the shapes (a ten-thousandth of their size is enough), or make them one",
            );
        }
        if chains.cut {
            let hint =
                "use fewer panes, mirrors and facets, or fewer lights without extent; or set a smaller max_depth";
            add("by some of very many sequences of flat faces".into(), hint);
        }
        // Where there are curved shapes chance finds them.
        if chains.long && scene.seeds.is_empty() {
            let hint = format!("set max_depth to {} or less, which leaves it out, too", MOST + 2);
            add(format!("by more than {MOST} flat faces in turn"), &hint);
        }
    }
    for b in &scene.balls {
        let shape = &scene.shapes[b.shape as usize];
        let surface = scene.surface_of(b.shape);
        if matches!(surface, Surface::Conductor { two_sided, .. } if b.flipped || *two_sided) {
            let hint = "let its front be its outside; or use a small area light, which shows it, with noise";
            add(format!("inside of the hollow mirror `{}`", shape.name), hint);
        } else if !b.ball.is_metal && scene.settings.max_depth > REFLECTIONS + 2 {
            let hint = format!("set max_depth to {} or less, which leaves it out, too", REFLECTIONS + 2);
            add(format!("through `{}` with more than {REFLECTIONS} reflections inside", shape.name), &hint);
        }
        if matches!(l.kind, LightKind::Beam { position, direction, .. } if b.begins_beside(position, direction)) {
            let hint = "let the beam begin farther away";
            add(format!("from within or beside the ball `{}`", shape.name), hint);
        }
    }
    found
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
