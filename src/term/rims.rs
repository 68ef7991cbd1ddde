//! Rims of disks and cylinders: edges that are circles (a disk's: any ellipse). Rims that coincide are one, whichever shapes they belong to (a can of a cylinder and two
//! disks), as long as they stay together, however their shapes move.

use super::contact;
use crate::math::{DVec3, warp};
use crate::params::ParamSet;
use crate::scene::Scene;
use crate::scene::lids::WELD;
use crate::shape::Shape;
use crate::shape::edges::{Edge, Side};
use std::f64::consts::{PI, TAU};

/// A direction in which few middles of rims are level.
const ACROSS: DVec3 = DVec3::new(1.0, 0.7391, 0.5371);
/// Places where two are asked whether they stay together: what moves a circle in its plane or out of it, linearly, differs at some of them.
const PLACES: u32 = 8;

/// The ellipse `c + x cos + y sin` and what ends in it.
#[derive(Clone, Debug)]
pub struct Rim {
    pub c: DVec3,
    pub x: DVec3,
    pub y: DVec3,
    sides: Vec<RimSide>,
    /// What lines that graze it leave out: of a cylinder this rim, of a disk all of it.
    pub grazed: Vec<(u32, Vec<u32>)>,
}

#[derive(Clone, Copy, Debug)]
struct RimSide {
    shape: u32,
    /// The direction in which its face leaves the rim; toward the middle where there is none.
    inward: Option<DVec3>,
}

impl Rim {
    fn inward(&self, side: &RimSide, e: DVec3) -> DVec3 {
        side.inward.unwrap_or(self.c - e)
    }

    /// About its length.
    pub fn length(&self) -> f64 {
        PI * (self.x.length() + self.y.length())
    }

    /// The rim's straight edge at the fraction u of a turn, one radian long, with its faces.
    pub fn edge(&self, u: f64) -> Edge {
        let (s, q) = (TAU * u).sin_cos();
        let (e, along) = (self.c + self.x * q + self.y * s, self.y * q - self.x * s);
        let sides = self.sides.iter().map(|k| Side { face: 0, corner: e + self.inward(k, e) }).collect();
        Edge { a: e, b: e + along, sides }
    }

    /// A fraction of a turn by the number u, by 1/d² from p where the rim is a circle, and its density per radian. With `d² = z² + R² + l² - 2 R l cos Δ` (z: height of
    /// p over the rim's plane, l its distance from the axis, Δ the angle from p) that is `k / (π (1 + k² - (1 - k²) cos Δ))`, `k² = (z² + (R-l)²) / (z² + (R+l)²)`.
    pub fn turn_seen_from(&self, p: DVec3, u: f64) -> (f64, f64) {
        let (lx, ly) = (self.x.length(), self.y.length());
        let v = p - self.c;
        let (a, b) = (v.dot(self.x) / lx, v.dot(self.y) / ly);
        let (r, l) = ((lx * ly).sqrt(), a.hypot(b));
        let z2 = (v.length_squared() - l * l).max(0.0);
        let k = ((z2 + (r - l) * (r - l)) / (z2 + (r + l) * (r + l))).sqrt();
        let delta = 2.0 * (k * (PI * (u - 0.5)).tan()).atan();
        let density = k / (PI * (1.0 + k * k - (1.0 - k * k) * delta.cos()));
        ((b.atan2(a) + delta) / TAU, density)
    }

    /// Faces (shape, face) at a point of it: those on the side that n points to, and the others.
    pub fn parted(&self, e: DVec3, n: DVec3) -> [Vec<(u32, u32)>; 2] {
        let (lit, own): (Vec<&RimSide>, Vec<&RimSide>) =
            self.sides.iter().partition(|k| n.dot(self.inward(k, e)) > 0.0);
        [lit, own].map(|list| list.into_iter().map(|k| (k.shape, 0)).collect())
    }

    /// Shapes that share it.
    pub fn shapes(&self) -> impl Iterator<Item = u32> + '_ {
        self.sides.iter().map(|k| k.shape)
    }

    /// Whether it is that of a half-space ([`Scene::is_half_space`]): out of sight.
    pub fn bounds_half_space(&self, scene: &Scene) -> bool {
        matches!(self.sides[..], [k] if scene.is_half_space(k.shape))
    }

    pub fn is_shared(&self) -> bool {
        self.sides.len() > 1
    }

    fn is_same(&self, o: &Rim, size: f64) -> bool {
        let near = |a: DVec3, b: DVec3| (a - b).length() <= WELD * size;
        let round = |r: &Rim| {
            let (x, y) = (r.x.length(), r.y.length());
            (x - y).abs() <= WELD * size && r.x.dot(r.y).abs() <= WELD * x * y
        };
        let across = |r: &Rim| r.x.cross(r.y).normalize();
        near(self.c, o.c)
            && round(self)
            && round(o)
            && (self.x.length() - o.x.length()).abs() <= WELD * size
            && across(self).cross(across(o)).length() <= WELD
    }
}

/// Whether a rim and one of another shape in its place move alike, but along themselves.
pub fn stay_together(scene: &Scene, params: &ParamSet, rim: &Rim, shape: u32) -> bool {
    let first = rim.sides[0].shape;
    (0..PLACES).map(|k| rim.edge(f64::from(k) / f64::from(PLACES))).all(|e| {
        let (x, y) = warp::frame((e.b - e.a).normalize());
        [x, y].into_iter().all(|n| !contact::parts(scene, params, [first, 0], [shape, 0], e.a, n))
    })
}

/// Of everything that does more than part media; `alike`: whether one moves as a shape does that has one in its place.
pub fn rims(scene: &Scene, alike: impl Fn(&Rim, u32) -> bool) -> Vec<Rim> {
    let mut list: Vec<Rim> = Vec::new();
    // In order of their middles along a direction in which few are level.
    let mut level: Vec<(f64, usize)> = Vec::new();
    let size = scene.bounds.radius();
    for (i, s) in scene.shapes.iter().enumerate() {
        let id = i as u32;
        if scene.is_null(s) {
            continue;
        }
        let mut add = |c, (x, y), inward, name| {
            let side = RimSide { shape: id, inward };
            let rim = Rim { c, x, y, sides: vec![side], grazed: vec![(id, vec![name])] };
            let at = rim.c.dot(ACROSS);
            let near = WELD * size * ACROSS.length();
            let from = level.partition_point(|l| l.0 < at - near);
            let beside = level[from..].iter().take_while(|l| l.0 <= at + near).map(|l| l.1);
            match beside.filter(|&k| list[k].is_same(&rim, size) && alike(&list[k], id)).min() {
                Some(k) => {
                    list[k].sides.push(side);
                    list[k].grazed.extend(rim.grazed);
                }
                None => {
                    level.insert(level.partition_point(|l| l.0 < at), (at, list.len()));
                    list.push(rim);
                }
            }
        };
        match &s.shape {
            Shape::Disk(d) => {
                let p = &d.placement;
                add(p.point(DVec3::ZERO), (p.vector(DVec3::X), p.vector(DVec3::Y)), None, 0);
            }
            Shape::Cylinder(c) => {
                for k in 0..2 {
                    let (middle, inward) = c.rim(k);
                    add(middle, c.rim_axes(), Some(inward), k);
                }
            }
            _ => {}
        }
    }
    list
}
