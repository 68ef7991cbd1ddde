//! Lights without extent where a smooth interface is, and something moves: lights, that interface, its index, or the camera. What has to be known of the scene for the derivative to be whole without a boundary term.
//!
//! What light without extent brings to a vertex by flat faces is smooth in the places of all ([`crate::transport::way_motion`]). It jumps where something opaque, or a face's own border, comes
//! between, and shadows that are cast by way of a face have no room yet. So nothing may be able to cast one. Let P be all places at which light can scatter, and the lights that move, and Q where
//! connections between them pass the faces' planes, which are parallel. That this is so is told by hulls:
//!
//! * Each face covers Q on its plane. Light by parallel planes keeps to one plane across them, and to one sense along it: for a light with a position Q lies between the feet of P. For one at infinity Q is P along
//!   the lines of its ways (straight, by one face, by chains of them), each extended to all planes. Both are images of convex sets: corners of boxes decide.
//! * Everything opaque is a rectangle with all of P and Q on one side of its plane, and lights at infinity too: no segment of a connection passes it.
//!
//! Media in cubes and spheres, and grids, are boxes in P. One medium may go on without end behind a single face where nothing else is and the camera sees it through the face, or stands in it: P ends where light
//! that has gone so far is less than e^-40 of what it was. No other medium may touch the light: beside it connections by way of the face would need [`crate::transport::beside`].
//! Turning a spot, or opening it, moves no shadow: it asks for nothing of this.

use super::{LightMotion, Motion, cast, ends};
use crate::error::{Error, Result, Span};
use crate::light::{Light, LightKind, Origin};
use crate::math::fold::Fold;
use crate::math::{DVec2, DVec3, Rgb};
use crate::scene::chains::Link;
use crate::scene::panes::Pane;
use crate::scene::{Instance, Scene, beams};
use crate::sensor::Sensor;
use crate::shape::{Bounds, Geometry, Shape};

/// Depths of absorption, and of extinction beyond three a scattering, after which light is at most e^-40.
const ABSORBED: f64 = 40.0;
const EXTINCT: f64 = 60.0;

/// Whether all that lights without extent send by way of smooth surfaces comes by flat faces that are parallel, and nothing moves but lights, the camera and these faces.
pub fn are_known(scene: &Scene, motion: &Motion) -> bool {
    let moves = |k: u32| motion.moves(k) && !scene.surface_of(k).is_smooth();
    let parallel = scene.has_parallel_panes() && !scene.shapes.iter().any(|s| scene.is_round_mirror(s));
    parallel && !(0..scene.shapes.len() as u32).any(moves)
}

/// Whether nothing casts a shadow of them.
pub fn are_clear(scene: &Scene, sensor: &Sensor, margin: f64, motion: &Motion) -> bool {
    are_known(scene, motion) && examine(scene, sensor, margin, motion, false).is_ok()
}

pub fn check(scene: &Scene, sensor: &Sensor, margin: f64, motion: &Motion) -> Result<()> {
    let turns = |m: &LightMotion| m.position || m.direction || m.angles;
    let moves = motion.surfaces() || motion.lights.iter().any(turns);
    let cast = moves && cast::are_known(scene, motion) && !are_clear(scene, sensor, margin, motion);
    if cast {
        cast::check(scene, motion)?;
    }
    examine(scene, sensor, margin, motion, cast)
}

/// `cast`: such shadows are known.
fn examine(scene: &Scene, sensor: &Sensor, margin: f64, motion: &Motion, cast: bool) -> Result<()> {
    let smooth = || scene.shapes.iter().find(|s| scene.surfaces[s.surface as usize].is_smooth());
    let pane = scene.panes.first();
    let face = pane.map(|p| &scene.shapes[p.shape as usize]);
    let Some(face) = face.or_else(|| smooth().filter(|_| cast)) else { return Ok(()) };
    let refuse = |what: String, remedy: &str| Err(Error::scene(&face.span, what, remedy));
    // Vertices that ride on camera rays, and a face that moves or refracts otherwise, carry the light of all lights past the same borders.
    let moves = motion.surfaces();
    let carried = moves && (cast || are_known(scene, motion));
    let lit = |(l, m): (&Light, &LightMotion)| l.is_delta() && (moves || m.position || m.direction);
    let aslant = scene.has_only_panes() && !scene.has_parallel_panes();
    if aslant && !cast && scene.lights.iter().zip(&motion.lights).any(lit) {
        let name = |p: &Pane| &scene.shapes[p.shape as usize].name;
        let other = scene.panes.last().map_or(&face.name, name);
        let what = format!(
            "`{}` and `{other}` mirror or refract and are not parallel, and light without extent falls on them: how that moves cannot be told yet",
            face.name
        );
        return refuse(what, "turn them so that they are parallel, keep one of them, or light the scene otherwise");
    }
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
        let Some(pane) = pane.filter(|_| !cast) else { continue };
        if region.is_none() {
            region = Some(places(scene, sensor, margin, pane)?);
        }
        let Some(places) = &region else { continue };
        clear(scene, id as u32, places)?;
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
    let is_pane = |s: &Instance| scene.surfaces[s.surface as usize].is_smooth();
    let mut endless = None;
    for (id, m) in scene.media.iter().enumerate() {
        let id = Some(id as u32);
        if let Some(g) = m.density_grid() {
            places.extend(g.world_bounds().into_iter().flat_map(|(a, b)| Bounds::new(a, b).corners()));
            continue;
        }
        let inside = |s: &&Instance| s.boundary && s.interior == id && holds(&s.shape);
        let bodies = scene.shapes.iter().filter(inside).map(|s| s.shape.bounds());
        places.extend(bodies.flat_map(|b: Bounds| b.corners()));
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
        let panes = scene.panes.iter().map(|p| &scene.shapes[p.shape as usize]);
        let behind = panes.into_iter().any(|s| s.boundary && (s.interior == id || s.exterior == id));
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
    if sides[0] == sides[1]
        || scene.media.len() > 1
        || scene.panes.len() > 1
        || scene.shapes.iter().any(|s| is_opaque(scene, s))
    {
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
    Ok(starts.into_iter().flat_map(|p| Bounds::new(p - ball, p + ball).corners()).collect())
}

/// Nothing comes between the light and these places, nor will where it moves.
fn clear(scene: &Scene, id: u32, places: &[DVec3]) -> Result<()> {
    let light = &scene.lights[id as usize];
    let Some(origin) = light.origin() else { return Ok(()) };
    let mut hull = places.to_vec();
    let passed: Vec<(&Pane, DVec3)> = match origin {
        Origin::Position(q) => {
            hull.push(q.value());
            let foot = |pane: &Pane, p: DVec3| p - pane.n * (p - pane.p).dot(pane.n);
            scene.panes.iter().flat_map(|pane| hull.iter().map(move |&p| (pane, foot(pane, p)))).collect()
        }
        Origin::Infinity(w) => {
            let ways = ways(scene, id, w.value());
            ways.iter().flat_map(|way| places.iter().flat_map(|&p| along(scene, way, w.value(), p))).collect()
        }
    };
    let contact = ends::contact(scene);
    for pane in &scene.panes {
        let face = &scene.shapes[pane.shape as usize];
        let height = match origin {
            Origin::Position(q) => (q.value() - pane.p).dot(pane.n).abs(),
            Origin::Infinity(_) => f64::INFINITY,
        };
        if height <= contact {
            let what = format!(
                "the light `{}` lies in the plane of `{}`, which mirrors or refracts: how what it sends moves cannot be differentiated there",
                light.name, face.name
            );
            return Err(Error::scene(&face.span, what, "move one of them a little"));
        }
        if !passed.iter().all(|(at, p)| !std::ptr::eq(*at, pane) || covers(&face.shape, *p)) {
            let what = format!(
                "light of `{}` may pass the border of `{}`, which mirrors or refracts: how its shadow moves cannot be differentiated yet",
                light.name, face.name
            );
            let remedy = "make the rectangle so large that it lies between all that light scatters at and the light; put media into cubes, which say where they end";
            return Err(Error::scene(&face.span, what, remedy));
        }
    }
    for s in scene.shapes.iter().filter(|s| is_opaque(scene, s)) {
        let corners = beams::corners(&s.shape, 0);
        let Some(&o) = corners.first() else { continue };
        let n = s.shape.normal(0, o);
        let points = hull.iter().copied().chain(passed.iter().map(|x| x.1));
        let heights: Vec<f64> = points.map(|p| (p - o).dot(n)).collect();
        let toward = light.single_direction().map_or(0.0, |w| w.dot(n));
        let clear = |sign: f64| toward * sign >= 0.0 && heights.iter().all(|h| h * sign >= -contact);
        if !clear(1.0) && !clear(-1.0) {
            let face = scene.panes.first().map_or(&s.name, |p| &scene.shapes[p.shape as usize].name);
            return Err(shadow(&s.span, &s.name, face, &light.name));
        }
    }
    Ok(())
}

/// By which planes light at infinity, travelling along w, may come: none, one, or those of a chain.
fn ways(scene: &Scene, id: u32, w: DVec3) -> Vec<Vec<Fold>> {
    let chains = &scene.chains;
    let fold = |links: &[Link]| links.iter().map(|l| chains.fold(scene, l)).collect::<Vec<_>>();
    let single = (0..)
        .zip(chains.faces.iter())
        .flat_map(|(face, f)| [true, false].map(|through| fold(&[Link { face, front: w.dot(f.n) < 0.0, through }])));
    let several = chains.list.iter().filter(|c| c.light == id).map(|c| fold(&c.links));
    std::iter::once(Vec::new()).chain(single).chain(several).collect()
}

/// Where the lines of a way to p meet the planes of all panes.
fn along<'a>(scene: &'a Scene, way: &[Fold], w: DVec3, p: DVec3) -> Vec<(&'a Pane, DVec3)> {
    let directions = way.iter().scan(Some(w), |w, f| {
        *w = w.and_then(|w| f.behind(w));
        Some(*w)
    });
    let Some(directions) = std::iter::once(Some(w)).chain(directions).collect::<Option<Vec<DVec3>>>() else {
        return Vec::new();
    };
    let mut p = p;
    let mut passed = Vec::new();
    for (k, w) in directions.iter().enumerate().rev() {
        let meets = |at: DVec3, n: DVec3| p - *w * ((p - at).dot(n) / w.dot(n));
        passed.extend(scene.panes.iter().map(|pane| (pane, meets(pane.p, pane.n))));
        if let Some(f) = k.checked_sub(1).map(|i| &way[i]) {
            p = meets(f.p, f.n);
        }
    }
    passed
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

/// Whether a point of its plane lies within a face; not where that is no number.
fn covers(face: &Shape, p: DVec3) -> bool {
    match face {
        Shape::Rectangle(r) => r.placement.local_point(p).truncate().abs().max_element() < 1.0,
        Shape::Disk(d) => d.placement.local_point(p).truncate().length() < 1.0,
        _ => false,
    }
}
