//! How a connection to a collimated beam changes as its vertex, the beam, or the mirrors and interfaces on its way move ([T] 6.2, 6.3).
//!
//! The light's direction follows from the beam's and from the planes on the way, whatever the vertex does: ω̇ is carried from the beam to the vertex with (39), (41), and each plane's share
//! of the irradiance scores (42). Backward, the line that leaves the vertex x against the light starts with ẋ and turns with -ω̇; it slides over the planes (13), its media
//! score their optical depth (one that the beam begins in, up to its plane: the line is longer by `<d, ȯ - ṗ> + <o-p, ḋ>`), and where it comes from the beam its distance ρ from the axis changes by `<m, ẏ - ȯ - <y-o,d> ḋ>/ρ`, m across the axis.

use super::first::FilmLine;
use super::motion::{Chained, Moving};
use super::piece::{Piece, Stop};
use super::ray::{MovingRay, Specular};
use super::velocity::{Source, Velocity};
use crate::light::{LightKind, beam_profile};
use crate::math::{DMat3, DVec3, Rgb, gradient};
use crate::params::{Covector, Partial, Sink, Slot};
use crate::scene::Scene;
use crate::scene::beams::{Step, Way};
use crate::sensor::Sensor;

/// What asks for the velocity of the vertex: filled with what the connection asks of it.
pub struct Connection<'a> {
    pub way: &'a Way,
    pub x: DVec3,
    pub value: Rgb,
    /// On how the direction toward the light turns at x, by scattering there.
    pub turning: Covector,
    pub pieces: &'a [Piece],
}

impl Step {
    /// As the light meets it at p.
    fn specular(&self, scene: &Scene, p: DVec3) -> Specular {
        let hit = scene.hit_at(p, self.shape, self.face);
        Specular { hit, n: self.n, w: self.before, out: self.behind, through: self.through }
    }
}

/// Directions of the light behind each step, in motion; the first is the beam's.
fn turns(scene: &Scene, moving: &Moving, way: &Way, points: &[DVec3]) -> Vec<Velocity> {
    let slot = scene.lights[way.light as usize].place.direction;
    let mut list = vec![Velocity::of(Source::Vector(slot), DVec3::ZERO)];
    for (s, &p) in way.steps.iter().zip(points.iter().rev()) {
        let start = Velocity::default();
        let ray = MovingRay::new(p, s.before, start, list.last().cloned().unwrap_or_default());
        list.push(FilmLine { scene, moving, ray: &ray }.behind(&s.specular(scene, p)).turn(p, s.behind));
    }
    list
}

/// Back from a point in motion to the beam: calls `each` with every line, its start, direction and length, returns where the last one starts, and how that moves.
fn back(
    scene: &Scene,
    moving: &Moving,
    way: &Way,
    points: &[DVec3],
    turns: &[Velocity],
    (x, start): (DVec3, Velocity),
    mut each: impl FnMut(&FilmLine, (DVec3, DVec3), f64),
) -> (DVec3, Velocity) {
    let turned = |k: usize| turns[k].clone().mapped(-DMat3::IDENTITY);
    let (mut o, mut w, mut start) = (x, -way.w, start);
    for k in 0..=points.len() {
        let left = points.len() - k;
        let ray = MovingRay::new(o, w, start.clone(), turned(left));
        let line = FilmLine { scene, moving, ray: &ray };
        let next = points.get(k);
        each(&line, (o, w), next.map_or(f64::INFINITY, |p| (*p - o).dot(w)));
        let Some(&p) = next else { break };
        let s = &way.steps[left - 1];
        start = line.slide(&s.specular(scene, p), w);
        (o, w) = (p, -s.before);
    }
    (o, start)
}

/// How the distance from the beam's axis of the line that reaches x by the way changes as x moves with `start`.
pub fn distance_forms(
    scene: &Scene,
    sensor: &Sensor,
    moving: &Moving,
    way: &Way,
    x: DVec3,
    start: Velocity,
    mut out: impl FnMut(Partial),
) {
    let mut points = Vec::new();
    let light = &scene.lights[way.light as usize];
    let (LightKind::Beam { position, direction, .. }, Some(entry)) = (&light.kind, way.trace(scene, x, &mut points))
    else {
        return;
    };
    let turns = turns(scene, moving, way, &points);
    let (o, start) = back(scene, moving, way, &points, &turns, (x, start), |_, _, _| {});
    let m = (entry - *position).normalize();
    start.forms(scene, sensor, m, &mut out);
    let along = (o - *position).dot(*direction);
    for (slot, scale) in [(light.place.position, -1.0), (light.place.direction, -along)] {
        out(Partial { slot, v: m * scale, len: 3 });
    }
}

/// How the point where that line meets the way's `k`th plane moves along the vector m, over the matter of the plane's face.
pub fn slide_forms(
    scene: &Scene,
    sensor: &Sensor,
    moving: &Moving,
    (way, k): (&Way, usize),
    (x, start): (DVec3, Velocity),
    m: DVec3,
    mut out: impl FnMut(Partial),
) {
    let mut points = Vec::new();
    if way.trace(scene, x, &mut points).is_none() {
        return;
    }
    let turns = turns(scene, moving, way, &points);
    // The line that begins there is that many lines behind the first.
    let (mut line_of, wanted, mut at) = (0, way.steps.len() - k, None);
    back(scene, moving, way, &points, &turns, (x, start), |line, (o, _), _| {
        if line_of == wanted {
            at = Some((o, line.ray.at(o)));
        }
        line_of += 1;
    });
    let Some((o, velocity)) = at else { return };
    velocity.forms(scene, sensor, m, &mut out);
    let step = &way.steps[k];
    scene.matter(step.shape, step.face).forms(o, -m, out);
}

impl Connection<'_> {
    /// Hands out its partials; what it asks of ẋ is added to `at`.
    pub fn partials<S: Sink>(&self, cx: &mut Chained<S>, at: &mut Covector) {
        let (scene, moving, way) = (cx.scene, cx.moving, self.way);
        let light = &scene.lights[way.light as usize];
        let LightKind::Beam { position, direction, radius, gaussian } = light.kind else { return };
        let mut points = Vec::new();
        let Some(entry) = way.trace(scene, self.x, &mut points) else { return };
        let turns = turns(scene, moving, way, &points);
        let mut apply = |v: &Velocity, form: &Covector, sink: &mut S| v.settle(scene, cx.sensor, form, at, sink);

        // Toward the light is against its direction.
        if let Some(last) = turns.last() {
            apply(last, &self.turning.scaled(-1.0), cx.sink);
        }
        // Shares of the planes, as the light meets them.
        for ((s, &p), turn) in way.steps.iter().zip(points.iter().rev()).zip(&turns) {
            let ray = MovingRay::new(p, s.before, Velocity::default(), turn.clone());
            let line = FilmLine { scene, moving, ray: &ray };
            line.flux_partials(cx.sensor, &s.specular(scene, p), self.value, cx.sink);
        }
        // Back from the vertex.
        let from = (self.x, Velocity::of(Source::Here, self.x));
        // In the order in which the line back passes them.
        let mut left = self.pieces;
        let (o, start) = back(scene, moving, way, &points, &turns, from, |line, (o, w), length| {
            let own = left.iter().take_while(|p| p.w == w && p.lies_on(o, w, length * (1.0 + 1e-9))).count();
            let (pieces, rest) = left.split_at(own);
            left = rest;
            for piece in pieces {
                // Where the beam begins inside a medium the line ends on its plane, and goes on or back with that.
                let begins = length == f64::INFINITY && piece.to == Stop::Free;
                let piece = if begins { Piece { to: Stop::Border(direction), ..*piece } } else { *piece };
                for (velocity, form) in line.ends(&piece).iter().zip(piece.depth_forms(scene)) {
                    apply(velocity, &form.weighed(-self.value), cx.sink);
                }
                if begins {
                    let [_, form] = piece.depth_forms(scene);
                    let longer = form.weighed(-self.value).dot(w);
                    let plane = light.place;
                    for (slot, v) in [(plane.position, -direction), (plane.direction, piece.end() - position)] {
                        (0..3).for_each(|k| cx.sink.add(slot + k as Slot, longer * v[k]));
                    }
                }
            }
        });
        // Where it enters the beam.
        let m = entry - position;
        let rho = m.length();
        let (e, [by_rho, by_radius]) = gradient([rho, radius], |[rho, r]| beam_profile(rho, r, gaussian));
        if e > 0.0 && rho > 0.0 {
            let mut form = Covector::default();
            form.add(m / rho, self.value * (by_rho / e));
            apply(&start, &form, cx.sink);
            let place = light.place;
            let along = (o - position).dot(direction);
            for (slot, scale) in [(place.position, -1.0), (place.direction, -along)] {
                (0..3).for_each(|k| cx.sink.add(slot + k as Slot, form.0[k] * scale));
            }
            cx.sink.add(place.radius, self.value * (by_radius / e));
        }
    }
}
