//! Lights without extent where a smooth interface is, and something moves: lights, that interface, its index, or the camera. What has to be known of the scene for the derivative to be whole without a boundary term.
//!
//! What light without extent brings to a vertex by one flat face is smooth in the places of both ([`crate::transport::pane_motion`]). It jumps where something opaque, or the face's own border, comes
//! between, and shadows that are cast by way of a face have no room yet. So nothing may be able to cast one. Let P be all places at which light can scatter, and the lights that move, and Q where
//! connections between them pass the face's plane. That this is so is told by hulls:
//!
//! * The face covers Q. For a light with a position Q lies between the feet of P on the plane; for one at infinity Q is P along its three directions (straight, refracted, mirrored).
//!   Both are images of convex sets: corners of boxes decide.
//! * Everything opaque is a rectangle with all of P and Q on one side of its plane, and lights at infinity too: no segment of a connection passes it.
//!
//! Media in cubes and spheres, and grids, are boxes in P. One medium may go on without end behind the face where nothing else is and the camera sees it through the face, or stands in it: P ends where light
//! that has gone so far is less than e^-40 of what it was. No other medium may touch the light: beside it connections by way of the face would need [`crate::transport::beside`].
//! Turning a spot, or opening it, moves no shadow: it asks for nothing of this.

use super::{Motion, ends};
use crate::error::{Error, Result, Span};
use crate::light::{Light, LightKind, Origin};
use crate::math::{DVec2, DVec3, Rgb, V3};
use crate::scene::panes::Pane;
use crate::scene::{Instance, Scene, beams};
use crate::sensor::Sensor;
use crate::shape::{Bounds, Geometry, Shape};
use crate::transport::pane::directions;

/// Depths of absorption, and of extinction beyond three a scattering, after which light is at most e^-40.
const ABSORBED: f64 = 40.0;
const EXTINCT: f64 = 60.0;

/// Whether all that lights without extent send by way of smooth surfaces comes by one flat face, and nothing moves but lights, the camera and that face.
pub fn are_known(scene: &Scene, motion: &Motion) -> bool {
    let moves = |k: u32| motion.moves(k) && !scene.surface_of(k).is_smooth();
    scene.shows_all_delta_light() && !(0..scene.shapes.len() as u32).any(moves)
}

pub fn check(scene: &Scene, sensor: &Sensor, margin: f64, motion: &Motion) -> Result<()> {
    let Some(pane) = scene.panes.first() else { return Ok(()) };
    let face = &scene.shapes[pane.shape as usize];
    let refuse = |what: String, remedy: &str| Err(Error::scene(&face.span, what, remedy));
    // Vertices that ride on camera rays, and a face that moves or refracts otherwise, carry the light of all lights past the same borders.
    let carried = motion.surfaces() && are_known(scene, motion);
    let mut region = None;
    for (id, (light, m)) in scene.lights.iter().zip(&motion.lights).enumerate().filter(|(_, (l, _))| l.is_delta()) {
        let turns = m.direction || m.angles;
        if (m.position || turns || carried)
            && matches!(light.kind, LightKind::Spot { beam, cutoff, .. } if beam >= cutoff)
        {
            let what = format!(
                "the spot `{}` has a hard edge, and something moves: how the edge falls by way of `{}` cannot be told yet",
                light.name, face.name
            );
            return refuse(what, "give it a beam_width below its cutoff_angle");
        }
        let far = light.center().is_none();
        if !(m.position || far && m.direction || carried) {
            continue;
        }
        if (m.position || carried) && scene.embedded_selection(id as u32) > 0.0 {
            let what = format!(
                "the light `{}` is inside a medium, beside `{}`, which mirrors or refracts, and something moves: this cannot be differentiated yet",
                light.name, face.name
            );
            return refuse(what, "keep it out of the medium: in the air over the water, as it were");
        }
        if region.is_none() {
            region = Some(places(scene, sensor, margin, pane)?);
        }
        let Some(places) = &region else { continue };
        clear(scene, pane, light, places)?;
    }
    Ok(())
}

/// All points at which light may scatter, as corners of convex sets that hold them.
fn places(scene: &Scene, sensor: &Sensor, margin: f64, pane: &Pane) -> Result<Vec<DVec3>> {
    let face = &scene.shapes[pane.shape as usize];
    let mut places = Vec::new();
    for s in scene.shapes.iter().filter(|s| is_opaque(scene, s)) {
        if !matches!(s.shape, Shape::Rectangle(_)) {
            let what = format!(
                "`{}` may cast a shadow by way of `{}`, which mirrors or refracts: how that moves cannot be told yet",
                s.name, face.name
            );
            let remedy = "take it out, or make it of rectangles: only these may be lit there, walls and floors";
            return Err(Error::scene(&s.span, what, remedy));
        }
        places.extend(beams::corners(&s.shape, 0));
    }
    let is_pane = |s: &Instance| std::ptr::eq(s, face);
    let mut endless = None;
    for (id, m) in scene.media.iter().enumerate() {
        let id = Some(id as u32);
        if let Some(g) = m.density_grid() {
            places.extend(g.world_bounds().into_iter().flat_map(|(a, b)| corners(a, b)));
            continue;
        }
        let inside = |s: &&Instance| s.boundary && s.interior == id && holds(&s.shape);
        let bodies = scene.shapes.iter().filter(inside).map(|s| s.shape.bounds());
        places.extend(bodies.flat_map(|b: Bounds| corners(b.min, b.max)));
        let open =
            |s: &Instance| s.boundary && (s.exterior == id || s.interior == id && !holds(&s.shape)) && !is_pane(s);
        let name = |s: &Instance| (s.name.clone(), s.span.clone());
        if let Some((shape, span)) = scene.shapes.iter().find(|s| open(s)).map(name) {
            let what = format!(
                "the medium `{}` has no end outside of `{shape}`: whether its light passes the border of `{}` cannot be told",
                m.name, face.name
            );
            return Err(Error::scene(
                &span,
                what,
                "put the medium into a cube or a sphere, or behind the interface alone",
            ));
        }
        let behind = face.boundary && (face.interior == id || face.exterior == id);
        let eye = sensor.to_world.translation;
        let held = scene.shapes.iter().filter(inside).any(|s| s.shape.bounds().contains(eye));
        let around = sensor.medium == id && !(held && scene.outer_medium(eye, id) != id);
        if behind || around {
            endless = endless.or(id);
        }
    }
    if let Some(id) = endless {
        places.extend(reached(scene, sensor, margin, pane, id)?);
    }
    Ok(places)
}

/// Where light scatters in a medium without end behind the face.
fn reached(scene: &Scene, sensor: &Sensor, margin: f64, pane: &Pane, id: u32) -> Result<Vec<DVec3>> {
    let (m, face) = (&scene.media[id as usize], &scene.shapes[pane.shape as usize]);
    let refuse = |why: &str, remedy: &str| {
        let what = format!(
            "the medium `{}` has no end but `{}`, {why}: whether its light passes the border of that cannot be told",
            m.name, face.name
        );
        Err(Error::scene(&face.span, what, remedy))
    };
    // Behind the face alone: on one side of it.
    let sides = [face.exterior, face.interior].map(|s| face.boundary && s == Some(id));
    if sides[0] == sides[1] || scene.media.len() > 1 || scene.shapes.iter().any(|s| is_opaque(scene, s)) {
        return refuse(
            "and something else is there, too",
            "let the medium be on one side of the interface, by itself; or put it into a cube",
        );
    }
    let absorption = Rgb::from_fn(|c| m.sigma_t[c] - m.sigma_s[c]).min();
    let scatterings = f64::from(scene.settings.max_depth);
    let limit = if scene.settings.max_depth == u32::MAX { f64::INFINITY } else { 3.0 * scatterings + EXTINCT };
    let length = (ABSORBED / absorption.max(0.0)).min(limit / m.sigma_t.min());
    if !length.is_finite() {
        return refuse(
            "absorbs nothing, and light scatters in it without end",
            "set max_depth, or an albedo below 1; or put the medium into a cube",
        );
    }
    // Light that leaves the medium does not come back. So it has gone at most so far from where the camera's rays enter.
    let side = if sides[1] { -1.0 } else { 1.0 };
    let (w, h) = (sensor.width as f64 + margin, sensor.height as f64 + margin);
    let mut starts = Vec::new();
    for [x, y] in [[-margin, -margin], [w, -margin], [w, h], [-margin, h]] {
        let (o, d) = sensor.ray(x, y);
        let height = (o - pane.p).dot(pane.n);
        let t = -height / d.dot(pane.n);
        if height * side > 0.0 {
            starts.push(o);
        } else if t >= 0.0 && t.is_finite() {
            starts.push(o + d * t);
        } else {
            return refuse(
                "and the camera sees more than the interface",
                "let the camera look at the interface alone, or stand in the medium; or put the medium into a cube",
            );
        }
    }
    let ball = DVec3::splat(length);
    Ok(starts.into_iter().flat_map(|p| corners(p - ball, p + ball)).collect())
}

/// Nothing comes between the light and these places, nor will where it moves.
fn clear(scene: &Scene, pane: &Pane, light: &Light, places: &[DVec3]) -> Result<()> {
    let face = &scene.shapes[pane.shape as usize];
    let Some(origin) = light.origin() else { return Ok(()) };
    let mut hull = places.to_vec();
    let foot = |p: DVec3| p - pane.n * (p - pane.p).dot(pane.n);
    let passed: Vec<DVec3> = match origin {
        Origin::Position(q) => {
            hull.push(q.value());
            hull.iter().map(|&p| foot(p)).collect()
        }
        Origin::Infinity(w) => {
            let surface = &scene.surfaces[face.surface as usize];
            let along = |p: DVec3, w: DVec3| p - w * ((p - pane.p).dot(pane.n) / w.dot(pane.n));
            let ways = directions(surface, pane, w.value());
            places.iter().flat_map(|&p| ways.iter().map(move |&w| along(p, w))).collect()
        }
    };
    let on_plane = match origin {
        Origin::Position(q) => (q - V3::constant(pane.p)).dot(V3::constant(pane.n)).abs() <= ends::contact(scene),
        Origin::Infinity(_) => false,
    };
    if on_plane {
        let what = format!(
            "the light `{}` lies in the plane of `{}`, which mirrors or refracts: how what it sends moves cannot be differentiated there",
            light.name, face.name
        );
        return Err(Error::scene(&face.span, what, "move one of them a little"));
    }
    if !passed.iter().all(|&p| covers(&face.shape, p)) {
        let what = format!(
            "light of `{}` may pass the border of `{}`, which mirrors or refracts: how its shadow moves cannot be differentiated yet",
            light.name, face.name
        );
        let remedy = "make the rectangle so large that it lies between all that light scatters at and the light; put media into cubes, which say where they end";
        return Err(Error::scene(&face.span, what, remedy));
    }
    let contact = ends::contact(scene);
    for s in scene.shapes.iter().filter(|s| is_opaque(scene, s)) {
        let corners = beams::corners(&s.shape, 0);
        let Some(&o) = corners.first() else { continue };
        let n = s.shape.normal(0, o);
        let heights: Vec<f64> = hull.iter().chain(&passed).map(|&p| (p - o).dot(n)).collect();
        let toward = light.single_direction().map_or(0.0, |w| w.dot(n));
        let clear = |sign: f64| toward * sign >= 0.0 && heights.iter().all(|h| h * sign >= -contact);
        if !clear(1.0) && !clear(-1.0) {
            return Err(shadow(&s.span, &s.name, &face.name, &light.name));
        }
    }
    Ok(())
}

fn shadow(span: &Span, shape: &str, pane: &str, light: &str) -> Error {
    let what = format!(
        "`{shape}` may cast a shadow of the light `{light}`, and `{pane}` mirrors or refracts: how the shadow moves cannot be told yet"
    );
    Error::scene(
        span,
        what,
        &format!(
            "take it out, or let all that light scatters at, and the interface where it does, lie on one side of `{shape}`"
        ),
    )
}

fn is_opaque(scene: &Scene, s: &Instance) -> bool {
    !scene.is_null(s) && !scene.surfaces[s.surface as usize].is_smooth()
}

/// Whether what is behind its front lies within its bounds.
fn holds(s: &Shape) -> bool {
    let p = s.position(0, DVec2::splat(0.5));
    matches!(s, Shape::Sphere(_) | Shape::Cube(_)) && s.normal(0, p).dot(p - s.bounds().center()) > 0.0
}

fn corners(a: DVec3, b: DVec3) -> [DVec3; 8] {
    std::array::from_fn(|k| {
        let pick = |axis: usize| if k >> axis & 1 == 0 { a[axis] } else { b[axis] };
        DVec3::new(pick(0), pick(1), pick(2))
    })
}

/// Whether a point of its plane lies within a face; not where that is no number.
fn covers(face: &Shape, p: DVec3) -> bool {
    match face {
        Shape::Rectangle(r) => r.placement.local_point(p).truncate().abs().max_element() < 1.0,
        Shape::Disk(d) => d.placement.local_point(p).truncate().length() < 1.0,
        _ => false,
    }
}
