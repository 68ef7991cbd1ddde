//! Edges and smooth interfaces: term VE of [T] section 3, with the parts of E2 and E3 that rays turned by interfaces bring about ([T] 6.1, 6.4).
//!
//! A ray that a smooth interface will turn holds its direction at the eye or vertex that it leaves (its film point, at the camera), and all that follows slides on it. Whatever the light jumps at
//! behind the interface moves over those directions: an edge at B, whose rays move there with u, gives `∫ f W sin α / |J| <n, u - ẋ_B> (L⁺ - L⁻) dl` (n toward L⁺, α between edge
//! and ray, W the share of light that the chain lets through, J the area across the ray at B over the solid angle at the eye: [`crate::transport::shot`]). Rims, and the outlines of balls and walls (cylinders), are such edges, too.
//! Three kinds of lines remain for this room:
//!
//! * from the camera by way of interfaces (outward, onto the film),
//! * from any vertex of a camera path by way of interfaces,
//! * straight from vertices that are seen by way of interfaces; and from all vertices past edges, rims, balls and walls that are smooth themselves.
//!
//! Straight lines have sides of their own: one that ends on a smooth face holds its direction, one that ends at a vertex D has (25), whose share vanishes for D on the edge's own
//! face. Along the outline of a ball or wall of glass both sides see the same light, as all is mirrored straight on, but where it ends is told in two ways, and they move
//! differently.

use super::aim::{Aimed, From, Interfaces};
use super::edge_set::EdgeSet;
use super::ends::{self, Point};
use super::facing::{Facing, Outline};
use super::grazing_line::{Curve, seen_on};
use super::known_chains::KnownChains;
use super::rims::Rim;
use super::seen_path::{Path, Vertex};
use super::sheet::Partials;
use super::shown::Spot;
use super::{Context, Motion, Room, Sample};
use crate::math::discrete::Discrete;
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::scene::{Hit, Instance, Scene};
use crate::sensor::Sensor;
use crate::shape::{Cylinder, Shape, Sphere};
use crate::transport::first::FilmLine;
use crate::transport::ray::MovingRay;
use crate::transport::shot::{self, Eye, Shot, Target};
use crate::transport::state::Stage;
use std::borrow::Cow;
use std::f64::consts::TAU;
use std::sync::Arc;

pub const NAME: &str = "virtual_edge";

pub struct VirtualEdge {
    edges: Arc<EdgeSet>,
    /// Chains that the camera sees by.
    known: KnownChains,
    /// What is round, listed behind the edges.
    round: Vec<Round>,
    /// Over edges by length, and what is round and parts light, for shots by way of interfaces.
    by_length: Discrete,
    /// Of these, what the camera's shots can see a motion past.
    from_camera: Discrete,
    /// Over edges and what is round: all, and those that are smooth, for straight lines.
    all: Discrete,
    smooth: Discrete,
    interfaces: Interfaces,
}

fn is_smooth(scene: &Scene, shape: u32) -> bool {
    scene.surface_of(shape).is_smooth()
}

/// Balls, walls (cylinders) and rims.
enum Round {
    Ball(u32, Sphere),
    Wall(u32, Cylinder),
    Rim(Rim),
}

impl Round {
    fn any(&self, of: impl Fn(u32) -> bool) -> bool {
        match self {
            Round::Ball(shape, _) | Round::Wall(shape, _) => of(*shape),
            Round::Rim(rim) => rim.shapes().any(of),
        }
    }

    fn length(&self) -> f64 {
        match self {
            Round::Ball(_, s) => TAU * s.radius,
            Round::Wall(_, q) => 2.0 * q.length,
            Round::Rim(rim) => rim.length(),
        }
    }
}

/// Whether anything straight before the outline of a smooth ball or wall scatters light.
fn sees_outlines(scene: &Scene) -> bool {
    let smooth = |s: &Instance| scene.surfaces[s.surface as usize].is_smooth();
    let scatters_beside = scene.scatters_beside();
    let opaque = scene.shapes.iter().any(|s| !scene.is_null(s) && !smooth(s));
    let mut round = (0..).zip(&scene.shapes).filter(|(_, s)| s.shape.is_round() && smooth(s));
    round.any(|(id, _)| opaque || scatters_beside(id))
}

/// What either side of an edge sends along a ray, and how the ray tells its place: held at the eye, or by the vertex where it ends.
struct Jump {
    held: Rgb,
    /// Light, the point that it leaves, and its distance from the edge.
    ends: Option<(Rgb, Point, f64)>,
}

impl VirtualEdge {
    /// `None` where no ray turns, or nothing moves.
    pub fn prepare(scene: &Scene, sensor: &Sensor, motion: &Motion, margin: f64) -> Option<VirtualEdge> {
        let interfaces = Interfaces::new(scene);
        if interfaces.list.is_empty() || !motion.surfaces() {
            return None;
        }
        let edges = motion.edges(scene);
        let length = |i: usize| {
            let ends = edges.ends(scene, i);
            // The border of an open interface is out of sight: beyond it light would be of no medium.
            let half_space = edges.any(i, |id| scene.is_half_space(id));
            let border = ends.pair.is_none() && half_space && edges.get(scene, i).edge.sides.len() < 2;
            let length = (ends.b - ends.a).length();
            if border || !length.is_finite() { 0.0 } else { length }
        };
        let lengths: Vec<f64> = (0..edges.len()).map(length).collect();
        let smooth = |i: u32| is_smooth(scene, i);
        let seen = sees_outlines(scene);
        let camera = From::camera(sensor, margin);
        // Within a ball that lets no light out no way grazes it.
        let holds_all = |s: &Instance| match (&s.shape, &camera.eye) {
            (Shape::Sphere(b), Eye::Point(o)) => {
                (*o - b.center).length() < b.radius && !scene.surfaces[s.surface as usize].is_transparent()
            }
            _ => false,
        };
        let of_shape = |(i, s): (u32, &Instance)| {
            let opaque = !smooth(i) && !scene.is_null(s);
            match s.shape {
                Shape::Sphere(q) if if smooth(i) { seen } else { opaque && !holds_all(s) } => Some(Round::Ball(i, q)),
                Shape::Cylinder(q) if if smooth(i) { seen } else { opaque } => Some(Round::Wall(i, q)),
                _ => None,
            }
        };
        // That of a half-space is out of sight, like its border.
        let of_rims = motion.rims.iter().filter(|r| !r.bounds_half_space(scene)).cloned().map(Round::Rim);
        let round: Vec<Round> = (0..).zip(&scene.shapes).filter_map(of_shape).chain(of_rims).collect();
        let with_round = |edge: &dyn Fn(usize) -> bool, other: &dyn Fn(&Round) -> bool| {
            let edges = lengths.iter().enumerate().map(|(i, &l)| if edge(i) { l } else { 0.0 });
            Discrete::new(edges.chain(round.iter().map(|r| if other(r) { r.length() } else { 0.0 })))
        };
        let moving = &motion.moving;
        let turns = |&i: &u32| moving.moves(i) || moving.refracts(scene.shapes[i as usize].surface as usize);
        // Rays of a camera that stands still, by interfaces that do.
        let still = moving.film_ray().is_still() && !interfaces.list.iter().any(turns);
        let slides = |i: usize| !still || edges.any(i, |s| moving.moves(s));
        // Light is the same on both sides of a smooth outline.
        let parts = |r: &Round| !matches!(r, Round::Ball(i, _) | Round::Wall(i, _) if smooth(*i));
        let from_camera = with_round(&slides, &|r| parts(r) && (!still || r.any(|i| moving.moves(i))));
        let mut known = KnownChains::default();
        if from_camera.total > 0.0 {
            known = camera.known_chains(scene);
            // Chains show edges; past what is round others lead.
            if !round.iter().any(parts) {
                let seen = (0..edges.len()).filter(|&i| lengths[i] > 0.0 && slides(i));
                let ends = seen.map(|i| (i, edges.ends(scene, i))).map(|(i, e)| (i, [e.a, e.b]));
                known.look_at(scene, &camera.eye, &ends.collect::<Vec<_>>());
            }
        }
        let room = VirtualEdge {
            from_camera,
            by_length: with_round(&|_| true, &parts),
            all: with_round(&|_| true, &|_| true),
            smooth: with_round(&|i| edges.any(i, smooth), &|r| r.any(smooth)),
            known,
            edges,
            round,
            interfaces,
        };
        (room.all.total > 0.0).then_some(room)
    }

    /// Straight past an edge, or what is round, that the vertex sees.
    fn look_straight(
        &self,
        cx: &mut Context,
        path: &Path,
        v: &Vertex,
        film: [f64; 2],
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let scene = cx.scene;
        let table = if v.is_behind() { &self.all } else { &self.smooth };
        if table.total <= 0.0 {
            return;
        }
        let ((k, probability, _), u) = (table.sample(rng.uniform()), rng.uniform());
        let toward = |b: DVec3| (b - v.p()).normalize();
        let (b, per_length, faces, faced) = match k.checked_sub(self.edges.len()).map(|k| &self.round[k]) {
            None => {
                let e = self.edges.get(scene, k);
                let Some((b, per_length)) = seen_on(e.edge.a, e.edge.b, v.p(), u) else { return };
                let faced = Facing::of_edge(scene, &e, toward(b));
                (b, per_length, e.faces, faced)
            }
            Some(Round::Rim(rim)) => {
                let (turn, density) = rim.turn_seen_from(v.p(), u);
                let edge = rim.edge(turn);
                let faced = Facing::of_rim(scene, rim, &edge, toward(edge.a));
                (edge.a, density / (edge.b - edge.a).length(), rim.grazed.clone(), faced)
            }
            Some(Round::Ball(shape, s)) => {
                let curve = Curve::Sphere { c: s.center, r: s.radius };
                return self.look_at_round(cx, path, v, (*shape, curve), (probability, u), film, rng, emit);
            }
            Some(Round::Wall(shape, q)) => {
                let curve = Curve::Cylinder(*q);
                return self.look_at_round(cx, path, v, (*shape, curve), (probability, u), film, rng, emit);
            }
        };
        let Some((facing, sin)) = faced else { return };
        let w = toward(b);
        let scatter = v.scatter(scene, w);
        if scatter.is_zero() {
            return;
        }
        let Some(shot) = shot::straight(scene, v.p(), &v.place(scene), b, None) else { return };
        let weight = v.weight * scatter * shot.weight * (sin / (shot.spread * per_length * probability));
        let Some(jump) = self.jump(cx, &shot, &facing, &faces, v.depth + 1, true, rng) else { return };
        self.hand_out(cx, path, v, &shot, facing.n, &faces, weight, &jump, film, emit);
    }

    /// Past the outline of a ball or wall. What a ball of glass, or a mirror, mirrors there comes from the same place, after one more scattering.
    fn look_at_round(
        &self,
        cx: &mut Context,
        path: &Path,
        v: &Vertex,
        (shape, curve): (u32, Curve),
        (probability, u): (f64, f64),
        film: [f64; 2],
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let scene = cx.scene;
        let Some(line) = curve.from_vertex(v.p(), u) else { return };
        let scatter = v.scatter(scene, line.w);
        if scatter.is_zero() {
            return;
        }
        let Some(shot) = shot::straight(scene, v.p(), &v.place(scene), line.b, Some(shape)) else { return };
        let grazed = [(shape, Vec::new())];
        let weight = v.weight * scatter * shot.weight * (line.measure / (line.own * probability));
        if !is_smooth(scene, shape) {
            let facing = Facing::of_round(shape, line.n);
            let Some(jump) = self.jump(cx, &shot, &facing, &grazed, v.depth + 1, true, rng) else { return };
            return self.hand_out(cx, path, v, &shot, line.n, &grazed, weight, &jump, film, emit);
        }
        let end = ends::past(scene, line.b, line.w, line.n, &grazed);
        let stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        let Some((at, distance, light)) = ends::sent(cx, line.b, line.w, end, shot.medium, false, stream) else {
            return;
        };
        let (beside, mirrored) = (light.shown(cx.set, v.depth + 1), light.shown(cx.set, v.depth + 2));
        let jump = match at {
            Point::Infinity => Jump { held: beside - mirrored, ends: None },
            _ => Jump { held: -mirrored, ends: Some((beside, at, distance)) },
        };
        self.hand_out(cx, path, v, &shot, line.n, &grazed, weight, &jump, film, emit);
    }

    /// What is seen straight from a vertex.
    fn hand_out(
        &self,
        cx: &Context,
        path: &Path,
        v: &Vertex,
        shot: &Shot,
        n: DVec3,
        grazed: &[(u32, Vec<u32>)],
        weight: Rgb,
        jump: &Jump,
        film: [f64; 2],
        emit: &mut dyn FnMut(&Sample),
    ) {
        if !jump.held.is_zero() {
            let ray = MovingRay::leaving(v.p(), shot.w, path.velocity(cx, v));
            let partials = held(cx, &ray, shot.e, n, grazed);
            let flux = jump.held * weight;
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        }
        if let Some((light, at, distance)) = &jump.ends {
            let flux = *light * weight;
            if flux.is_zero() {
                return;
            }
            let watch = path.watch(cx, v);
            let partials = ends::between(cx, [&v.point, at], [shot.distance, *distance], &watch, shot.e, n, grazed);
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        }
    }

    /// By way of interfaces.
    fn look_through(
        &self,
        cx: &mut Context,
        path: &Path,
        v: &Vertex,
        film: [f64; 2],
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let scene = cx.scene;
        let start = |cx: &Context, w: DVec3| MovingRay::leaving(v.p(), w, path.velocity(cx, v));
        let from = From::vertex(scene, v, &self.interfaces);
        let begins = |_: &Context, s: &Shot| Some((v.scatter(scene, s.start.w) * v.weight, film));
        if self.by_length.total <= 0.0 {
            return;
        }
        let (spot, far) = (Spot::of(&self.by_length, rng.uniform()), v.depth + 1);
        let aim = |_: &mut Context, rng: &mut Rng, target: &Target| {
            from.draw(scene, target, rng, |_| false).map(|d| Aimed::Drawn(d, 1.0))
        };
        let found = self.through(cx, &from, start, spot, far, rng, aim, begins);
        if let Some((flux, film, partials)) = found {
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        }
    }

    /// A shot by way of interfaces; `start`: how its ray along a direction moves, `aim` finds one to its target, `begins`: how much it counts and where on the film.
    fn through(
        &self,
        cx: &mut Context,
        from: &From,
        start: impl Fn(&Context, DVec3) -> MovingRay,
        spot: Spot,
        more: u32,
        rng: &mut Rng,
        aim: impl Fn(&mut Context, &mut Rng, &Target) -> Option<Aimed>,
        begins: impl Fn(&Context, &Shot) -> Option<(Rgb, [f64; 2])>,
    ) -> Option<(Rgb, [f64; 2], Partials)> {
        let scene = cx.scene;
        let outline = match spot.edge.checked_sub(self.edges.len()) {
            None => Outline::Edge(self.edges.get(scene, spot.edge)),
            Some(k) => match &self.round[k] {
                Round::Ball(shape, s) => Outline::Ball(*shape, s),
                Round::Wall(shape, q) => Outline::Wall(*shape, q),
                Round::Rim(rim) => Outline::Rim(rim, rim.edge(spot.t)),
            },
        };
        let target = outline.target(spot.t, rng);
        let aimed = aim(cx, rng, &target)?;
        let shot = aimed.shot();
        let mut ray = start(cx, shot.start.w);
        for met in &shot.chain {
            ray = FilmLine { scene, moving: cx.moving, ray: &ray }.behind(met);
        }
        let grazed = &*outline.grazed();
        if ray.is_still() && !grazed.iter().any(|f| cx.moving.moves(f.0)) {
            return None;
        }
        let (facing, length) = outline.facing(scene, shot)?;
        let (begins, film) = begins(cx, shot)?;
        if begins.is_zero() {
            return None;
        }
        let more = more + shot.chain.len() as u32;
        let jump = self.jump(cx, shot, &facing, grazed, more, false, rng)?.held;
        if jump.is_zero() {
            return None;
        }
        let Some(trials) = aimed.trials(scene, from, &target, rng) else {
            cx.tally.missed_boundary += 1;
            return None;
        };
        let flux = jump * begins * shot.weight * (length * trials / (shot.spread * spot.density));
        Some((flux, film, held(cx, &ray, shot.e, facing.n, grazed)))
    }

    /// `straight`: sides that end on a surface are told by that.
    fn jump(
        &self,
        cx: &mut Context,
        shot: &Shot,
        facing: &Facing,
        grazed: &[(u32, Vec<u32>)],
        more: u32,
        straight: bool,
        rng: &mut Rng,
    ) -> Option<Jump> {
        let (scene, b, w, n) = (cx.scene, shot.e, shot.w, facing.n);
        let stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        // The shot is clear; where it begins an interface may be.
        let half = 0.5 * shot.distance;
        let touched = ends::touched(scene, b - w * half, w, half, grazed)?;
        let faces = match touched.is_empty() {
            true => Cow::Borrowed(&facing.faces),
            false => Cow::Owned(ends::with_touched(scene, &facing.faces, &touched, b, w, n)?),
        };
        let own = ends::front(scene, &faces.own, &faces.lit, b, w, -n)?;
        let mut jump = Jump { held: Rgb::ZERO, ends: None };
        let face = |cx: &mut Context, w: DVec3, h: Hit| match straight && !is_smooth(scene, h.shape) {
            true => Rgb::ZERO,
            false => ends::radiance(cx, b, w, Stage::Surface(h), shot.medium, false, stream).shown(cx.set, more),
        };
        jump.held = -face(cx, ends::edge_on(w, n, grazed), own);
        if !faces.lit.is_empty() {
            let lit = ends::front(scene, &faces.lit, &faces.own, b, w, n)?;
            jump.held += face(cx, w, lit);
            return Some(jump);
        }
        let end = ends::past(scene, b, w, n, grazed);
        let (at, distance, sent) = ends::sent(cx, b, w, end, shot.medium, false, stream)?;
        let sent = sent.shown(cx.set, more);
        match at {
            Point::Surface(_) | Point::Medium(_) if straight => jump.ends = Some((sent, at, distance)),
            _ => jump.held += sent,
        }
        Some(jump)
    }
}

/// `<n, u - ẋ_B>`, for a ray that moves so.
fn held(cx: &Context, ray: &MovingRay, b: DVec3, n: DVec3, grazed: &[(u32, Vec<u32>)]) -> Partials {
    let mut p = Partials::default();
    ends::material(cx.scene, grazed, b, -n, &mut p);
    ray.at(b).forms(cx.scene, cx.sensor, n, |f| p.push(f));
    p
}

impl Room for VirtualEdge {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        // The path takes the even numbers.
        let mut stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        let path = Path::new(cx, film, *rng);
        for v in &path.vertices {
            self.look_straight(cx, &path, v, film, &mut stream, emit);
            self.look_through(cx, &path, v, film, &mut stream, emit);
        }
    }

    /// Place on the edges, and the known chain.
    fn guided_numbers(&self) -> usize {
        2
    }

    fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        let (scene, sensor) = (cx.scene, cx.sensor);
        let from = From::camera(sensor, cx.margin);
        let begins = |cx: &Context, s: &Shot| {
            let q = sensor.project(s.start.o + s.start.w)?;
            // Of a unit of solid angle, or of area across parallel rays.
            cx.on_film(q.film).then(|| (Rgb::splat(q.pixels_per_area), q.film))
        };
        let start = |cx: &Context, _: DVec3| cx.moving.film_ray().clone();
        let share = self.known.share;
        if self.from_camera.total <= 0.0 {
            return;
        }
        let chain = (lead[1] < share).then(|| self.known.choose(lead[1] / share));
        let guided = chain.and_then(|(k, _)| self.known.spot(k, lead[0]));
        let spot = guided.unwrap_or_else(|| Spot::of(&self.from_camera, lead[0]));
        debug_assert!(
            guided.is_none() || self.round.iter().all(|r| matches!(r, Round::Ball(i, _) if is_smooth(scene, *i)))
        );
        let aim = |cx: &mut Context, rng: &mut Rng, target: &Target| match target {
            // Known chains have one ray to a point, but several past a ball or wall: those come from the one table that all share.
            Target::Ball { .. } | Target::Wall { .. } => {
                from.draw(scene, target, rng, |_| false).map(|d| Aimed::Drawn(d, 1.0))
            }
            Target::Point(e) => from.to_point(cx, &self.known, (*e, chain), rng),
        };
        let found = self.through(cx, &from, start, spot, 0, rng, aim, begins);
        if let Some((flux, film, partials)) = found {
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 0.0, outward: 1.0 });
        }
    }
}
