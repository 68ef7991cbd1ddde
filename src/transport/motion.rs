//! Interior motion on surfaces: term M of [T] section 3 where shapes, lamps or the camera move.
//!
//! Every surface vertex is a material point x and moves with its shape, ẋ = v(x); only the first one stays on its film point's ray and
//! slides, ẋ = u + ṫ ω (u: the ray's own velocity there, ω its direction, ṫ = <n, v-u>/<n,ω>; [T] (13), (60)). A path's contribution is
//! `Π f G` over vertices and segments ([T] (23)), so it changes by
//!
//! * `ċ_x/c_x + ċ_z/c_z - 2ḋ/d` a segment from x to z ([T] (27b)), c_x by the shading normal (it belongs to f), c_z by the geometric one;
//! * `J̇ = div_S v` a vertex, but for the first one;
//! * nothing for the camera's segment: the film is fixed.
//!
//! The velocity belongs to the point, whatever technique drew it ([T] (61)); silhouettes have rooms of their own.

use super::record::End;
use crate::light::{LightKind, spot_falloff};
use crate::math::{DVec3, Rgb, gradient};
use crate::params::{Covector, Mover, ParamSet, Sink};
use crate::scene::{Hit, Scene};
use crate::sensor::Sensor;
use crate::shape::Shape;

/// Which shapes move, and whether the camera does.
#[derive(Clone, Debug, Default)]
pub struct Moving {
    shapes: Vec<bool>,
    camera: bool,
    any: bool,
}

impl Moving {
    pub fn new(scene: &Scene, sensor: &Sensor, params: &ParamSet) -> Moving {
        let shapes: Vec<bool> = scene
            .shapes
            .iter()
            .map(|s| !scene.is_null(s) && params.block_active(s.mover.first, Mover::SLOTS))
            .collect();
        let camera = sensor.moves(params);
        Moving { any: camera || shapes.iter().any(|&m| m), shapes, camera }
    }

    pub fn any(&self) -> bool {
        self.any
    }
}

/// A segment that leaves the vertex at hand, and all that was collected along it.
#[derive(Clone, Copy, Debug)]
struct Leg {
    end: End,
    value: Rgb,
    /// Of that, what a lamp emits there: nobody else counts its point's Jacobian.
    emitted: Rgb,
}

/// Going backward over a path: what left the vertex that comes next.
#[derive(Clone, Debug, Default)]
pub struct Chain {
    next: Option<Leg>,
    connections: Vec<Leg>,
}

impl Chain {
    pub fn clear(&mut self) {
        self.next = None;
        self.connections.clear();
    }

    /// Light met by the walk.
    pub fn arrive(&mut self, end: End, value: Rgb) {
        match &mut self.next {
            // The lamp reflects light as well: one segment leads to both.
            Some(leg) => {
                leg.value += value;
                leg.emitted += value;
            }
            none => *none = Some(Leg { end, value, emitted: value }),
        }
    }

    pub fn connect(&mut self, end: End, value: Rgb) {
        self.connections.push(Leg { end, value, emitted: value });
    }

    /// The vertex that all legs left; `first` from the camera.
    pub fn vertex(
        &mut self,
        scene: &Scene,
        sensor: &Sensor,
        moving: &Moving,
        hit: &Hit,
        wi: DVec3,
        first: bool,
        sink: &mut impl Sink,
    ) {
        let mut v = Vertex { scene, moving, hit, at: Covector::default(), turn: Covector::default() };
        let mut after = Rgb::ZERO;
        for leg in self.connections.drain(..).chain(self.next.take()) {
            after += leg.value;
            v.leave(&leg, sink);
        }
        if first {
            v.slide(sensor, -wi, sink);
        } else {
            v.ride(after, sink);
        }
        let end = End::Shape { shape: hit.shape, p: hit.p, n: hit.n };
        self.next = Some(Leg { end, value: after, emitted: Rgb::ZERO });
    }
}

/// What asks for the velocity of a vertex and of its shading normal.
struct Vertex<'a> {
    scene: &'a Scene,
    moving: &'a Moving,
    hit: &'a Hit,
    at: Covector,
    turn: Covector,
}

impl Vertex<'_> {
    fn leave(&mut self, leg: &Leg, sink: &mut impl Sink) {
        let (x, value) = (self.hit.p, leg.value);
        match leg.end {
            End::Shape { shape, p, n } => {
                let d = (p - x).length();
                let w = (p - x) / d;
                let cx = self.cosine(w, value);
                let cz = -n.dot(w);
                // On ż - ẋ.
                let g = (self.hit.ns / cx - n / cz - w * 4.0) / d;
                self.at.add(g, -value);
                if self.moving.shapes[shape as usize] {
                    let mover = &self.scene.shapes[shape as usize].mover;
                    let mut c = Covector::default();
                    c.add(g, value);
                    mover.point(p, &c, sink);
                    let mut c = Covector::default();
                    c.add(w, value * (-1.0 / cz));
                    mover.normal(n, &c, sink);
                    mover.area(n, leg.emitted, sink);
                }
            }
            End::Point(light) => {
                let light = &self.scene.lights[light as usize];
                let Some(p) = light.center() else { return };
                let d = (p - x).length();
                let w = (p - x) / d;
                let cx = self.cosine(w, value);
                let mut g = (self.hit.ns / cx - w * 3.0) / d;
                if let LightKind::Spot { axis, beam, cutoff, .. } = light.kind {
                    let (s, [ds]) = gradient([-w.dot(axis)], |[c]| spot_falloff(c, beam.into(), cutoff.into()));
                    if s > 0.0 {
                        g -= (axis - w * w.dot(axis)) * (ds / (s * d));
                    }
                }
                self.at.add(g, -value);
            }
            End::Infinity(w) => {
                self.cosine(w, value);
            }
        }
    }

    /// The cosine at the vertex, `f_s |cos|`: on the normal's turning.
    fn cosine(&mut self, w: DVec3, value: Rgb) -> f64 {
        let cx = self.hit.ns.dot(w);
        self.turn.add(w, value * (1.0 / cx));
        cx
    }

    /// On a velocity along the surface, how the normal there changes.
    fn bend(&self) -> Covector {
        let Hit { p, ns, .. } = *self.hit;
        match &self.scene.shapes[self.hit.shape as usize].shape {
            Shape::Sphere(s) => self.turn.scaled(ns.dot(p - s.center).signum() / s.radius),
            _ => Covector::default(),
        }
    }

    /// A material point.
    fn ride(&self, after: Rgb, sink: &mut impl Sink) {
        if self.moving.shapes[self.hit.shape as usize] {
            let mover = &self.scene.shapes[self.hit.shape as usize].mover;
            mover.point(self.hit.p, &self.at, sink);
            mover.area(self.hit.n, after, sink);
            mover.normal(self.hit.ns, &self.turn, sink);
        }
    }

    /// The first vertex: its film point's ray takes it along.
    fn slide(&self, sensor: &Sensor, w: DVec3, sink: &mut impl Sink) {
        let moves = self.moving.shapes[self.hit.shape as usize];
        if !moves && !self.moving.camera {
            return;
        }
        let Hit { p, n, .. } = *self.hit;
        let instance = &self.scene.shapes[self.hit.shape as usize];
        // Sliding over the matter, by ẋ - v, it sees another normal.
        let bend = self.bend();
        let mut at = self.at;
        (0..3).for_each(|k| at.0[k] += bend.0[k]);
        let along = at.dot(w) * (1.0 / n.dot(w));
        if moves {
            let mut c = bend.scaled(-1.0);
            c.add(n, along);
            instance.mover.point(p, &c, sink);
            instance.mover.normal(self.hit.ns, &self.turn, sink);
        }
        if self.moving.camera {
            at.add(n, -along);
            sensor.point(p, &at, sink);
        }
    }
}
