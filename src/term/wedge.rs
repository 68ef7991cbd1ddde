//! The double wedge of an edge: the angles around it of lines that graze it ([T] 2.2).

use crate::math::{DVec3, warp};
use crate::shape::edges::Edge;
use std::f64::consts::PI;

/// The frame across an edge in which [`wedge`] counts angles: x toward the first face.
pub fn frame_of(edge: &Edge, t: DVec3) -> (DVec3, DVec3) {
    edge.sides.first().map_or_else(|| warp::frame(t), |s| across(t, s.corner - edge.a))
}

/// A frame across t, x toward v.
fn across(t: DVec3, v: DVec3) -> (DVec3, DVec3) {
    let x = (v - t * v.dot(t)).normalize();
    (x, t.cross(x))
}

/// Angles around an edge of lines that graze it: the first, and how many, in (0, π); the same again opposite.
pub fn wedge(edge: &Edge) -> (f64, f64) {
    let [first, second] = &edge.sides[..] else { return (0.0, PI) };
    between(edge.a, edge.b, [first.corner, second.corner])
}

/// The same for two faces with these corners.
pub fn between(a: DVec3, b: DVec3, [first, second]: [DVec3; 2]) -> (f64, f64) {
    let t = (b - a).normalize();
    let (x, y) = across(t, first - a);
    let f = second - a;
    let angle = f.dot(y).atan2(f.dot(x));
    // Lines that part the two faces lie between them.
    if angle >= 0.0 { (angle, PI - angle) } else { (0.0, PI + angle) }
}
