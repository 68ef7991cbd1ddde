//! Shots: rays from an eye, or from a light, by way of smooth interfaces to a given point, such as one of an edge, or past a ball ([T] 6.2, 6.4).
//!
//! A chain of interfaces takes every ray of an eye to one line. Which of the eye's rays it takes to the point e is found by Newton's method on the ray itself, with dual numbers
//! through the chain's planes, spheres and cylinders as if they had no borders (of a mesh shaded by vertex normals, through the faces that the ray meets); then the ray is walked through the scene, and counts only if it meets just those faces. Its Jacobian
//! is the area across the ray at e over the solid angle at the eye (over the area, for parallel rays): what [T] (47) and (48) have without the light's share.
//!
//! A ball's outline, as a chain shows it, is a curve that no formula gives. A great circle drawn at random crosses it in points that Newton's method finds, and the mean number
//! of these is the curve's length on the unit sphere over π (Crofton, "On the theory of local probability", 1868).
//!
//! Nothing lists chains or their solutions: both are drawn ([`super::chance`]).

use super::bubble::Round;
use super::line::Line;
use super::ray::Specular;
use super::specular;
pub use crate::math::fermat::{Eye, Start};
use crate::math::fresnel::Interface;
use crate::math::{DVec2, DVec3, Dual, Real, Rgb, V3, warp};
use crate::scene::chains::has_flat_faces;
use crate::scene::{Hit, Instance, On, Scene, effort};
use crate::shape::{Cylinder, Geometry, Shape, Sphere, TriangleMesh, barycentric};
use crate::surface::{Ray, Surface};
use smallvec::SmallVec;
use std::f64::consts::PI;

/// Two coordinates of an eye's rays.
pub(super) type D2 = Dual<2>;

/// How often a step of Newton's method is halved before the search is given up. Most searches that need it oftener find nothing, and those are what time goes to: with 20 times a mesh of
/// 320 faces took 17 times as long as with 3, for the same variance.
const HALVINGS: i32 = 3;
/// How near to e, over the length of the way, a ray counts as a hit.
pub(super) const EXACT: f64 = 1e-11;
/// How near to each other two solutions are the same.
pub const SAME: f64 = 1e-6;
/// How far before e, as a share of the last piece, a face may be met that e itself lies on.
const AT_THE_EDGE: f64 = 1e-6;
/// The face of a step by a mesh that vertex normals make one smooth surface: whichever the ray meets.
const ANY: u32 = u32::MAX;

/// A face of a chain, and whether rays go through it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Step {
    pub shape: u32,
    /// `u32::MAX` of a mesh shaded by vertex normals: any.
    pub face: u32,
    pub through: bool,
    /// Of what is curved: it is met from inside. Flat mirrors are met from either side by the same step.
    pub inside: bool,
    /// Of a mesh shaded by vertex normals: the face's own normal turns the ray, where theirs lean too far.
    pub by_face: bool,
}

impl Step {
    pub fn of(scene: &Scene, s: &Specular) -> Step {
        let instance = &scene.shapes[s.hit.shape as usize];
        let face = if instance.shape.is_round() || has_flat_faces(instance) { s.hit.face } else { ANY };
        let by_face = face == ANY && s.n == s.hit.n && !is_alike(&s.hit);
        let inside = outward(instance, &s.hit).is_some_and(|n| s.w.dot(n) > 0.0);
        Step { shape: s.hit.shape, face, through: s.through, inside, by_face }
    }

    /// By which of the turns a ray that has met a face takes this step, and whether through; `None` where it takes another.
    pub(super) fn taken(&self, scene: &Scene, hit: &Hit, w: DVec3, turns: &[Turn]) -> Option<(usize, bool)> {
        let is_it =
            |t: &Turn| Step::of(scene, &Specular { hit: *hit, n: t.n, w, out: w, through: self.through }) == *self;
        turns.iter().position(is_it).map(|k| (k, self.through))
    }
}

/// Where out of a curved shape is; of a mesh where its front is.
fn outward(instance: &Instance, hit: &Hit) -> Option<DVec3> {
    match &instance.shape {
        Shape::Sphere(q) => Some(hit.p - q.center),
        Shape::Cylinder(q) => Some(q.from_axis(hit.p)),
        Shape::Mesh(_) if !has_flat_faces(instance) => Some(hit.n),
        _ => None,
    }
}

/// A chain whose faces are all known.
type Faces = SmallVec<[Step; 8]>;

/// The faces that the eye's ray meets along a chain; as they are given where none of them is any of a mesh's, borders or not.
pub(super) fn faces(scene: &Scene, start: Start, place: &Place, chain: &[Step]) -> Option<Faces> {
    if chain.iter().all(|s| s.face != ANY) {
        return Some(chain.into());
    }
    let mut k = 0;
    let left = walk(scene, start, place, false, chain.len(), |hit, w, turns| {
        k += 1;
        chain[k - 1].taken(scene, hit, w, turns)
    })?;
    let known = |(s, met): (&Step, &Specular)| Step { face: met.hit.face, ..*s };
    (left.chain.len() == chain.len()).then(|| chain.iter().zip(&left.chain).map(known).collect())
}

/// What a shot has to meet.
#[derive(Clone, Copy, Debug)]
pub enum Target {
    Point(DVec3),
    /// The point where a ray grazes a ball, on the great circle of this unit normal.
    Ball {
        ball: u32,
        c: DVec3,
        r: f64,
        normal: DVec3,
    },
    /// The point where a ray grazes the wall of a cylinder, as high as the point c of its axis.
    Wall {
        wall: u32,
        c: DVec3,
        axis: DVec3,
        r: f64,
    },
}

impl Target {
    /// Of a ball, by a great circle that two numbers draw.
    pub fn ball(ball: u32, s: &Sphere, u: f64, v: f64) -> Target {
        Target::Ball { ball, c: s.center, r: s.radius, normal: warp::sphere(u, v) }
    }

    /// Of a cylinder, by the share t of its height.
    pub fn wall(wall: u32, q: &Cylinder, t: f64) -> Target {
        Target::Wall { wall, c: q.base + q.axis * (q.length * t), axis: q.axis, r: q.radius }
    }

    /// The point itself, the ball's centre, or the point of the axis.
    fn middle(&self) -> DVec3 {
        match self {
            Target::Point(e) => *e,
            Target::Ball { c, .. } | Target::Wall { c, .. } => *c,
        }
    }

    /// What a straight way's spread would be where rays keep their distances.
    pub fn unit(&self) -> f64 {
        match self {
            Target::Ball { r, .. } => 1.0 / (PI * *r),
            Target::Point(_) | Target::Wall { .. } => 1.0,
        }
    }

    /// The shape that its ray grazes.
    fn grazed(&self) -> Option<u32> {
        match self {
            Target::Point(_) => None,
            Target::Ball { ball: shape, .. } | Target::Wall { wall: shape, .. } => Some(*shape),
        }
    }
}

/// A ray that arrives.
pub struct Shot {
    pub start: Start,
    pub chain: Vec<Specular>,
    /// Where it meets its target.
    pub e: DVec3,
    /// Direction and length of the last piece, which ends at e, and the medium before it.
    pub w: DVec3,
    pub distance: f64,
    pub medium: Option<u32>,
    /// Radiance that the eye gets of a unit at e.
    pub weight: Rgb,
    /// Area across the ray at e over the eye's solid angle or area. Of a ball how fast rays come off its outline, times how fast their point runs along that, both per unit of the eye's,
    /// over π R: random great circles find `1/(π R)` points per length.
    pub spread: f64,
}

/// The ray as it leaves a chain.
pub(super) struct Left {
    at: Start,
    on: On,
    medium: Option<u32>,
    pub(super) chain: Vec<Specular>,
    weight: Rgb,
}

/// What the eye's rays begin in.
#[derive(Clone, Copy)]
pub struct Place {
    pub on: On,
    pub medium: Option<u32>,
    /// On a surface: the direction across it from which on rays go through, and the medium there.
    pub beyond: Option<(DVec3, Option<u32>)>,
}

impl Place {
    /// On no surface.
    pub fn within(medium: Option<u32>) -> Place {
        Place { on: On::default(), medium, beyond: None }
    }

    fn medium(&self, w: DVec3) -> Option<u32> {
        self.beyond.filter(|(across, _)| across.dot(w) > 0.0).map_or(self.medium, |(_, medium)| medium)
    }
}

/// What a smooth surface makes of a ray by a normal, which is on its front: what is mirrored, and what goes through.
pub(super) struct Turn {
    pub(super) n: DVec3,
    pub(super) rays: [Option<Ray>; 2],
}

/// Normals as near to each other are one.
const ALIKE: f64 = 1e-9;

fn is_alike(hit: &Hit) -> bool {
    (hit.ns - hit.n).length() <= ALIKE
}

/// What a ray from a light may become. Where vertex normals lean so far that they would send a ray to the wrong side of a face, that is turned by the face's own normal ([`specular::rays`]),
/// and that goes by the rays of paths from the other end: what these turn back along w counts, by either normal, which may be two rays or none.
fn turns(scene: &Scene, hit: &Hit, w: DVec3) -> SmallVec<[Turn; 2]> {
    let instance = &scene.shapes[hit.shape as usize];
    let surface = &scene.surfaces[instance.surface as usize];
    if has_flat_faces(instance) || is_alike(hit) {
        let (n, rays) = (hit.ns, surface.rays(hit.ns, w));
        return SmallVec::from_iter([Turn { n, rays }]);
    }
    let returns = |n: DVec3, r: &Ray| specular::rays(surface, hit, -r.w).0 == n;
    let by = |n: DVec3| Turn { n, rays: surface.rays(n, w).map(|r| r.filter(|r| returns(n, r))) };
    [hit.ns, hit.n].map(by).into_iter().filter(|t| t.rays.iter().any(Option::is_some)).collect()
}

/// Walk a ray through the scene, past `most` smooth surfaces; `choose` says at each by which of its turns it goes on, and whether through (`None`: the chain ends before it). Its weight leaves out media unless it is `weighed`.
pub(super) fn walk(
    scene: &Scene,
    start: Start,
    place: &Place,
    weighed: bool,
    most: usize,
    mut choose: impl FnMut(&Hit, DVec3, &[Turn]) -> Option<(usize, bool)>,
) -> Option<Left> {
    let medium = place.medium(start.w);
    let mut ray = Left { at: start, on: place.on, medium, chain: Vec::new(), weight: Rgb::ONE };
    while ray.chain.len() < most {
        let w = ray.at.w;
        let (line, hit) = Line::to_surface(scene, ray.at.o, w, &ray.on, ray.medium, weighed)?;
        let Some(hit) = hit else { return Some(ray) };
        let shape = &scene.shapes[hit.shape as usize];
        if !scene.surfaces[shape.surface as usize].is_smooth() {
            return Some(ray);
        }
        let turns = turns(scene, &hit, w);
        let Some((turn, through)) = choose(&hit, w, &turns) else { return Some(ray) };
        let Turn { n, rays: [mirrored, refracted] } = turns[turn];
        let taken = if through { refracted? } else { mirrored? };
        ray.chain.push(Specular { hit, n, w, out: taken.w, through });
        ray.on = specular::left(&ray.on, &hit, w, through, scene.tolerance(hit.p));
        ray.medium = if through { shape.medium_behind(w, hit.n, line.last) } else { line.last };
        ray.weight *= line.transmittance() * taken.weight;
        ray.at = Start { o: hit.p, w: taken.w };
    }
    Some(ray)
}

/// A ray behind a face, and the normal there that has bent it.
pub(super) struct Carried {
    pub(super) ray: (V3<D2>, V3<D2>),
    n: V3<D2>,
}

/// The interpolated normal of a mesh at a point of a face's plane, on the side of `front`.
fn shading_normal(m: &TriangleMesh, face: u32, p: V3<D2>, front: DVec3) -> Option<V3<D2>> {
    let normals = m.normals.as_ref()?;
    let [v0, v1, v2] = m.corners(face).map(V3::constant);
    let (b1, b2) = barycentric(v0, v1, v2, p - v0);
    let [n0, n1, n2] = m.faces[face as usize].map(|i| V3::constant(normals[i as usize]));
    let n = n0 * (-b1 - b2 + 1.0) + n1 * b1 + n2 * b2;
    let n = (n.length_squared().v > 0.0).then(|| n.normalize())?;
    Some(if n.value().dot(front) < 0.0 { -n } else { n })
}

/// Where a ray meets one more face of a chain, whose plane, sphere or cylinder has no borders, and the normal there, which is on its front.
pub(super) fn meet(scene: &Scene, (o, d): (V3<D2>, V3<D2>), step: &Step) -> Option<(V3<D2>, V3<D2>)> {
    let instance = &scene.shapes[step.shape as usize];
    Some(match &instance.shape {
        Shape::Sphere(s) => {
            let off = o - V3::constant(s.center);
            let (b, r2) = (off.dot(d), s.radius * s.radius);
            let q = b * b - (off.dot(off) - r2);
            if q.v <= 0.0 {
                return None;
            }
            let t = if step.inside { -b + q.sqrt() } else { -b - q.sqrt() };
            let p = o + d * t;
            if t.v <= 0.0 {
                return None;
            }
            let front = s.normal(0, p.value()).dot(p.value() - s.center).signum();
            (p, (p - V3::constant(s.center)) * Dual::constant(front / s.radius))
        }
        Shape::Cylinder(s) => {
            let axis = V3::constant(s.axis);
            let across = |v: V3<D2>| v - axis * v.dot(axis);
            let (off, w) = (across(o - V3::constant(s.base)), across(d));
            let (a, b, c) = (w.dot(w), off.dot(w), off.dot(off) - s.radius * s.radius);
            let q = b * b - a * c;
            if q.v <= 0.0 || a.v <= 0.0 {
                return None;
            }
            let t = if step.inside { -b + q.sqrt() } else { -b - q.sqrt() } / a;
            if t.v <= 0.0 {
                return None;
            }
            let p = o + d * t;
            let front = s.normal(0, p.value()).dot(s.from_axis(p.value())).signum();
            (p, across(p - V3::constant(s.base)) * Dual::constant(front / s.radius))
        }
        flat => {
            let at = match flat {
                Shape::Mesh(m) => m.corners(step.face)[0],
                s => s.position(step.face, DVec2::splat(0.5)),
            };
            let n = V3::constant(flat.normal(step.face, at));
            let t = n.dot(V3::constant(at) - o) / n.dot(d);
            if t.v <= 0.0 || !t.v.is_finite() {
                return None;
            }
            let p = o + d * t;
            let n = match flat {
                Shape::Mesh(m) if !step.by_face && !has_flat_faces(instance) => {
                    shading_normal(m, step.face, p, n.value()).unwrap_or(n)
                }
                _ => n,
            };
            (p, n)
        }
    })
}

/// The ray behind such a face.
pub(super) fn carry(scene: &Scene, (o, d): (V3<D2>, V3<D2>), step: &Step) -> Option<Carried> {
    let (p, n) = meet(scene, (o, d), step)?;
    let c = n.dot(d);
    let out = match scene.surface_of(step.shape) {
        Surface::Dielectric { interior, exterior, .. } if step.through => {
            let front = c.v < 0.0;
            let (n1, n2) = if front { (*exterior, *interior) } else { (*interior, *exterior) };
            let (c, side) = if front { (-c, n) } else { (c, -n) };
            Interface::new(c, Dual::constant(n1), Dual::constant(n2)).refract(d, side)?
        }
        _ => d - n * (c * 2.0),
    };
    Some(Carried { n, ray: (p, out.normalize()) })
}

impl Eye {
    /// The ray a little off `s`, along the two coordinates; the frame of the coordinates is told by w alone.
    pub(super) fn ray(&self, s: Start) -> (V3<D2>, V3<D2>) {
        let (x, y) = warp::frame(s.w);
        let off = V3::constant(x) * Dual::variable(0.0, 0) + V3::constant(y) * Dual::variable(0.0, 1);
        match self {
            Eye::Point(_) => (V3::constant(s.o), (V3::constant(s.w) + off).normalize()),
            Eye::Parallel(_) => (V3::constant(s.o) + off, V3::constant(s.w)),
        }
    }

    /// What differences of its rays are measured by, for ways of this length.
    pub(super) fn unit(&self, scene: &Scene, length: f64) -> f64 {
        match self {
            // From very far all that there is lies within a small angle.
            Eye::Point(_) => (scene.bounds.radius() / length).min(1.0),
            Eye::Parallel(_) => length,
        }
    }

    pub(super) fn step(&self, s: Start, by: DVec2) -> Start {
        let (x, y) = warp::frame(s.w);
        let off = x * by.x + y * by.y;
        match self {
            Eye::Point(_) => Start { o: s.o, w: (s.w + off).normalize() },
            Eye::Parallel(_) => Start { o: s.o + off, w: s.w },
        }
    }
}

/// Where a chain takes a ray: how far from its target, and the Jacobian of that.
pub(super) struct Miss {
    pub(super) off: DVec2,
    pub(super) by: [DVec2; 2],
    pub(super) length: f64,
    /// The point of the ray next to the target's middle.
    foot: V3<D2>,
}

pub(super) fn miss(
    scene: &Scene,
    eye: &Eye,
    start: Start,
    place: &Place,
    chain: &[Step],
    target: &Target,
) -> Option<Miss> {
    effort::note(1);
    let (mut ray, mut length) = (eye.ray(start), 0.0);
    for step in &faces(scene, start, place, chain)? {
        let o = ray.0.value();
        ray = carry(scene, ray, step)?.ray;
        // Of a way from very far what lies in the scene.
        length += (ray.0.value() - o).length().min(2.0 * scene.bounds.radius());
    }
    let (o, d) = ray;
    let off = V3::constant(target.middle()) - o;
    // Nearest to the point, or to the axis.
    let along = match target {
        Target::Wall { axis, .. } => {
            let flat = |v: V3<D2>| v - V3::constant(*axis) * v.dot(V3::constant(*axis));
            let d = flat(d);
            flat(off).dot(d) / d.dot(d)
        }
        _ => off.dot(d),
    };
    let across = d * along - off;
    let (x, y) = match target {
        Target::Point(_) => {
            let (x, y) = warp::frame(d.value());
            (across.dot(V3::constant(x)), across.dot(V3::constant(y)))
        }
        Target::Ball { r, normal, .. } => {
            let far = across.dot(across);
            if far.v <= 0.0 {
                return None;
            }
            (far.sqrt() - Dual::constant(*r), across.dot(V3::constant(*normal)))
        }
        Target::Wall { axis, r, .. } => {
            let height = across.dot(V3::constant(*axis));
            let far = across - V3::constant(*axis) * height;
            let far = far.dot(far);
            if far.v.is_nan() || far.v <= 0.0 {
                return None;
            }
            (far.sqrt() - Dual::constant(*r), height)
        }
    };
    let by = [DVec2::new(x.d[0], y.d[0]), DVec2::new(x.d[1], y.d[1])];
    let off = DVec2::new(x.v, y.v);
    Some(Miss { off, by, length: length + along.v.abs(), foot: o + d * along })
}

impl Miss {
    /// The point of the target that the ray meets.
    fn met(&self, target: &Target) -> DVec3 {
        match target {
            Target::Point(e) => *e,
            Target::Ball { c, r, .. } => *c + (self.foot.value() - *c).normalize() * *r,
            Target::Wall { c, axis, r, .. } => {
                let off = self.foot.value() - *c;
                *c + (off - *axis * off.dot(*axis)).normalize() * *r
            }
        }
    }

    /// [`Shot::spread`].
    fn spread(&self, target: &Target) -> f64 {
        let [a, b] = self.by;
        match target {
            // Of a wall: how steeply distances from the axis change across the outline, and heights along it.
            Target::Point(_) | Target::Wall { .. } => a.perp_dot(b).abs(),
            Target::Ball { r, .. } => {
                // Across the outline rays come nearer by `steep`; along it the point moves on the ball.
                let steep = DVec2::new(a.x, b.x);
                let along = steep.perp().normalize_or_zero();
                let [x, y, z] = [self.foot.x, self.foot.y, self.foot.z].map(|f| f.d[0] * along.x + f.d[1] * along.y);
                steep.length() * DVec3::new(x, y, z).length() / (PI * *r)
            }
        }
    }
}

/// The eye's ray that a chain takes to a target, by Newton's method from `start`, and what it still misses it by.
pub(super) fn solve(
    scene: &Scene,
    eye: &Eye,
    start: Start,
    place: &Place,
    chain: &[Step],
    target: &Target,
) -> Option<(Start, Miss)> {
    let mut at = start;
    let mut m = miss(scene, eye, at, place, chain, target)?;
    let size = (target.middle() - start.o).length();
    let round = Round::of(scene, eye, place, chain);
    for _ in 0..50 {
        if m.off.length() <= EXACT * m.length {
            return Some((at, m));
        }
        let [a, b] = m.by;
        let det = a.perp_dot(b);
        let by = DVec2::new(b.perp_dot(m.off), m.off.perp_dot(a)) / det;
        let most = match eye {
            Eye::Point(_) => 0.5,
            Eye::Parallel(_) => 0.5 * m.length,
        };
        let by = by * (most / by.length()).min(1.0);
        if !by.is_finite() {
            return None;
        }
        // A step that loses the chain, or leads away from it, is halved.
        let course = round.as_ref().and_then(|round| round.course(at));
        let better = (0..HALVINGS).find_map(|k| {
            let by = by * 0.5f64.powi(k);
            let next = match &round {
                None => eye.step(at, by),
                Some(round) => round.step(at, course.as_ref()?, by)?,
            };
            let n = miss(scene, eye, next, place, chain, target)?;
            (n.off.length() < m.off.length()).then_some((next, n))
        });
        // Nothing nearer: as near as rounding lets it come, which a whole step would not change; or lost, as beside a caustic, where no ray comes and the least miss may be small.
        let Some(next) = better else {
            let settled = m.off.length() <= 1e3 * EXACT * m.length && by.length() <= SAME * eye.unit(scene, size);
            return settled.then_some((at, m));
        };
        (at, m) = next;
    }
    None
}

/// The eye's ray to a target through this chain, if the scene lets it through. `past`: the ball or wall that it grazes, which by rounding it may meet a little before.
fn fire(
    scene: &Scene,
    eye: &Eye,
    start: Start,
    place: &Place,
    chain: &[Step],
    target: &Target,
    past: Option<u32>,
) -> Option<Shot> {
    let mut k = 0;
    let left = walk(scene, start, place, true, chain.len(), |hit, w, turns| {
        k += 1;
        chain[k - 1].taken(scene, hit, w, turns)
    })?;
    if left.chain.len() != chain.len() {
        return None;
    }
    let w = left.at.w;
    let m = miss(scene, eye, start, place, chain, target)?;
    let e = m.met(target);
    let distance = (e - left.at.o).dot(w);
    let (_, hit) = Line::to_surface(scene, left.at.o, w, &left.on, left.medium, false)?;
    // Where e lies on the chain's last face it is that face's border, not something behind it.
    let on_the_last = left.chain.last().is_some_and(|_| distance <= SAME * (e - start.o).length());
    let stopped = hit.is_some_and(|h| h.t < distance * (1.0 - AT_THE_EDGE) && past != Some(h.shape));
    if distance <= 0.0 || on_the_last || stopped {
        return None;
    }
    let way = Line::clear(scene, left.at.o, w, distance, left.medium)?;
    let spread = m.spread(target);
    let weight = left.weight * way.transmittance();
    (spread > 0.0 && spread.is_finite() && !weight.is_zero()).then_some(Shot {
        start,
        chain: left.chain,
        e,
        w,
        distance,
        medium: way.last,
        weight,
        spread,
    })
}

/// The straight shot to e, which may be where it grazes the ball or wall `past`.
pub fn straight(scene: &Scene, p: DVec3, place: &Place, e: DVec3, past: Option<u32>) -> Option<Shot> {
    let start = Start { o: p, w: (e - p).normalize() };
    fire(scene, &Eye::Point(p), start, place, &[], &Target::Point(e), past)
}

/// The shot to a target by these faces, from a ray near it.
pub fn by(scene: &Scene, eye: &Eye, near: Start, place: &Place, chain: &[Step], target: &Target) -> Option<Shot> {
    let (found, _) = solve(scene, eye, near, place, chain, target)?;
    fire(scene, eye, found, place, chain, target, target.grazed())
}

/// A face on the way of a light's ray.
#[derive(Clone, Copy, Debug)]
pub struct Crossing {
    pub face: u32,
    pub p: DVec3,
    /// The normal that bends the ray, on the front.
    pub n: DVec3,
    /// Directions of the light before and behind.
    pub before: DVec3,
    pub behind: DVec3,
}

impl Crossing {
    /// What a normal n that is not the face's own, n_g, makes of light besides: rays keep their radiance, but not their étendue (`dA dω |ω·n_g|` before and behind, where refraction and mirrors keep
    /// `dω |ω·n|` up to the indices), so that paths from the other end see `(|o·n_g| |i·n|) / (|i·n_g| |o·n|)` times the light (Veach, "Robust Monte Carlo methods", 1997, 5.3; i, o: before, behind).
    fn widening(&self, face: DVec3) -> f64 {
        let [i, o] = [self.before, self.behind];
        (o.dot(face) * i.dot(self.n) / (i.dot(face) * o.dot(self.n))).abs()
    }
}

/// The light's ray to e by a chain, from one near it: where it begins, what it meets, and the area across it at e over the solid angle (the area) that paths from e see it by.
/// Whether anything stands on the way is for others to say.
pub fn to_point(
    scene: &Scene,
    eye: &Eye,
    near: Start,
    place: &Place,
    chain: &[Step],
    e: DVec3,
) -> Option<(Start, Vec<Crossing>, f64)> {
    let target = Target::Point(e);
    let (found, missed) = solve(scene, eye, near, place, chain, &target)?;
    let (mut ray, mut crossings) = (eye.ray(found), Vec::with_capacity(chain.len()));
    let mut spread = missed.spread(&target);
    for step in &faces(scene, found, place, chain)? {
        let before = ray.1.value();
        let carried = carry(scene, ray, step)?;
        ray = carried.ray;
        let (p, behind) = (ray.0.value(), ray.1.value());
        let own = scene.shapes[step.shape as usize].shape.normal(step.face, p);
        let n = carried.n.value();
        let n = if n.dot(own) < 0.0 { -n } else { n };
        let crossing = Crossing { face: step.face, p, n, before, behind };
        spread /= crossing.widening(own);
        crossings.push(crossing);
    }
    let ahead = (e - ray.0.value()).dot(ray.1.value()) > 0.0;
    (ahead && spread > 0.0 && spread.is_finite()).then_some((found, crossings, spread))
}

pub fn steps(scene: &Scene, chain: &[Specular]) -> Vec<Step> {
    chain.iter().map(|s| Step::of(scene, s)).collect()
}
