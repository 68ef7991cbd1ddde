//! The first vertex of a path and what it carries along: [T] (60) and the decaying part of (58).
//!
//! The film is fixed. Where a camera ray meets a border or an opaque face, that point slides on the ray, `ẋ = u + ṫ w`, `ṫ = <n, v-u>/<n,w>` ((13); u: the
//! ray's own velocity), and a medium vertex between two such points moves with their affine mix: no face or border is swept on the camera line.
//!
//! What the mix does *along* the ray is a matter of choice, as long as it is theirs at both ends: `∫ T σ L_ins dt` does not change as its points slide on their line. In fog the affine one is best, its stretch is constant.
//! Through a rough field each step along the ray scores `<v, ∇σ>/σ` for nothing, so that there points come to rest within a few of the lengths over which the field changes ([`Moving::settling`]): of the ends' velocities along
//! the ray `κ(s/ℓ)` and `κ((l-s)/ℓ)` are left, s from the start of l, with κ of [`super::field`]. What goes across the ray is no choice.
//!
//! So the first vertex x moves otherwise than the field V around it ([`super::field`]), by `e = ẋ - V(x)`. All later points y of its path move with
//! `V(y) + κ(‖y-x‖/ρ) E(y)`, E being e at x: their differences stay bounded by their distances (57). The part of e along the face
//! that the camera ray ends on keeps to that face (on a sphere it is a turn about its centre, on a cylinder one about its axis) and may reach it; ρ keeps the rest, and either part, off
//! everything that medium points must not cross.
//!
//! A second vertex z that keeps to its direction from x ([`super::attach`]) slides over its surface by `χ Q (ẋ - ż_B)`; all later points take that over
//! around z in the same way, or segments from z to points near by would score like one over their lengths, whose square no flight's density makes integrable.

use super::attach::{Attached, Origin};
use super::field::{Field, decay};
use super::motion::Moving;
use super::piece::{Piece, Stop, onto, outer};
use super::ray::{MovingRay, Specular};
use super::record::{Event, MediumSpan};
use super::velocity::{Rate, Source, Velocity};
use crate::math::{DMat3, DVec3};
use crate::scene::nearest::Kind;
use crate::scene::{Hit, Scene};
use crate::shape::Shape;
use crate::shape::edges::to_border;
use crate::surface::Surface;

/// Radius of the ball over the distance to what it must not meet.
const CLEAR: f64 = 0.9;

/// Where a camera ray's first vertex is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Seen {
    /// In a medium, on this span of the camera line.
    Medium { p: DVec3, span: MediumSpan },
    /// On a surface, along w.
    Surface { hit: Hit, w: DVec3 },
}

impl Seen {
    /// The vertex of an event, as the first one of its leg.
    pub fn of(e: &Event) -> Option<Seen> {
        match *e {
            Event::Scatter { p, span, .. } => span.map(|span| Seen::Medium { p, span }),
            Event::Surface { hit, wi, .. } => Some(Seen::Surface { hit, w: -wi }),
            _ => None,
        }
    }

    pub fn p(&self) -> DVec3 {
        match self {
            Seen::Medium { p, .. } => *p,
            Seen::Surface { hit, .. } => hit.p,
        }
    }
}

/// A vertex of a path.
#[derive(Clone, Copy, Debug)]
pub enum Met {
    Medium(DVec3),
    Surface(Hit),
}

impl Met {
    fn p(&self) -> DVec3 {
        match self {
            Met::Medium(p) => *p,
            Met::Surface(hit) => hit.p,
        }
    }
}

/// What comes after a first vertex and may lie within its reach, so that what it carries along has to be known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Later {
    /// A path.
    Path,
    /// A point of this face, which it reaches only if its ray ends there.
    Face([u32; 2]),
    Nothing,
}

impl Later {
    /// `face`: the one that the ray ends on.
    fn may_follow(self, face: Option<(u32, u32, DVec3)>) -> bool {
        match self {
            Later::Path => true,
            Later::Face(at) => face.is_some_and(|(shape, face, _)| [shape, face] == at),
            Later::Nothing => false,
        }
    }
}

/// Which vertex of its leg one is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Nth {
    First,
    Second,
    #[default]
    Later,
}

/// How the leg of a chain begins that events have come to. Smooth interfaces part a chain into legs: the ray behind one is given by what came before, as a
/// camera ray is by the film, so that the vertex it leads to is a first one again.
#[derive(Clone, Copy, Debug, Default)]
pub struct Opening {
    pub first: Option<Seen>,
    pub second: Option<Met>,
    /// The last one behind the second.
    last: Option<Met>,
    /// The chain's legs before this one, in the record's list.
    pub legs: [u32; 2],
    /// Of [`Event::Share`].
    pub share: Option<f64>,
}

/// A leg that has come to its end.
#[derive(Clone, Copy, Debug)]
pub struct Leg {
    /// How it began.
    pub before: Opening,
    pub end: Specular,
}

impl Opening {
    /// The leg that ends with this event.
    pub fn ended_by(&self, e: &Event) -> Option<Leg> {
        match *e {
            Event::Specular(end) => Some(Leg { before: *self, end }),
            _ => None,
        }
    }

    /// Of a path.
    pub const NEW: Opening = Opening { first: None, second: None, last: None, legs: [0; 2], share: None };

    /// A leg without a vertex yet.
    fn begin(&mut self, legs: [u32; 2], share: Option<f64>) {
        (self.first, self.second, self.last) = (None, None, None);
        (self.legs, self.share) = (legs, share);
    }

    /// After one more event.
    pub fn follow(&mut self, e: &Event) {
        let met = match *e {
            Event::Chain => return self.begin([self.legs[1]; 2], None),
            Event::Specular(_) => return self.begin([self.legs[0], self.legs[1] + 1], self.share),
            Event::Share(f) => return self.share = Some(f),
            Event::Scatter { p, .. } => Met::Medium(p),
            Event::Surface { hit, .. } => Met::Surface(hit),
            _ => return,
        };
        if self.first.is_none() {
            self.first = Seen::of(e);
        } else if self.second.is_none() {
            self.second = Some(met);
        } else {
            self.last = Some(met);
        }
    }
}

/// What a ray meets, in motion: a camera ray, or one behind smooth interfaces.
pub struct FilmLine<'a> {
    pub scene: &'a Scene,
    pub moving: &'a Moving,
    pub ray: &'a MovingRay,
}

/// A first vertex in motion.
#[derive(Clone, Debug, Default)]
pub struct First {
    pub velocity: Velocity,
    /// Of the measure dt along the ray.
    pub stretch: Rate,
    /// How the ray turns, ω̇; left out where nothing asks: on surfaces that scatter by a cosine.
    pub turn: Velocity,
    /// Where it is, and on what surface.
    at: Option<(DVec3, Option<Hit>)>,
    excess: Option<Box<Excess>>,
    /// Of the second vertex, for those after it.
    after: Option<Box<Excess>>,
}

/// What later vertices take over from one of the first two.
#[derive(Clone, Debug)]
struct Excess {
    x: DVec3,
    e: Velocity,
    /// The face that the ray ends on, and the radius for what keeps to it.
    guide: Option<(Guide, f64)>,
    rho: f64,
}

/// A surface that a motion can keep to.
#[derive(Clone, Copy, Debug)]
enum Guide {
    Plane(DVec3),
    /// Centre, and the unit vector and distance from it to the vertex.
    Sphere(DVec3, DVec3, f64),
    /// A point of the axis and its direction, and the unit vector and distance from it to the vertex.
    Cylinder(DVec3, DVec3, DVec3, f64),
}

impl Guide {
    /// From e to the motion at y that keeps to the surface.
    fn along(&self, y: DVec3) -> DMat3 {
        match *self {
            Guide::Plane(n) => DMat3::IDENTITY - outer(n, n),
            Guide::Sphere(c, m, r) => {
                let u = y - c;
                (DMat3::from_diagonal(DVec3::splat(m.dot(u))) - outer(m, u))
                    * (DMat3::IDENTITY - outer(m, m))
                    * (1.0 / r)
            }
            // A turn about the axis, and a shift along it.
            Guide::Cylinder(c, k, m, r) => outer(k, k) + outer(k.cross(y - c), k.cross(m)) * (1.0 / r),
        }
    }

    /// What of e does not keep to it.
    fn across(&self) -> DMat3 {
        match *self {
            Guide::Plane(n) => outer(n, n),
            Guide::Sphere(_, m, _) | Guide::Cylinder(_, _, m, _) => outer(m, m),
        }
    }
}

impl Excess {
    /// From e to the velocity at y on top of V, and the covectors on e that give its divergence.
    fn at(&self, y: DVec3) -> (DMat3, DVec3) {
        let off = y - self.x;
        let d = off.length();
        let toward = if d > 0.0 { off / d } else { DVec3::ZERO };
        let (mut map, mut spread) = (DMat3::ZERO, DVec3::ZERO);
        let mut part = |m: DMat3, radius: f64| {
            if d < radius {
                let (k, slope) = decay(d / radius);
                map += m * k;
                spread += m.transpose() * toward * (slope / radius);
            }
        };
        match &self.guide {
            Some((guide, radius)) => {
                part(guide.along(y), *radius);
                part(guide.across(), self.rho);
            }
            None => part(DMat3::IDENTITY, self.rho),
        }
        (map, spread)
    }

    fn reach(&self) -> f64 {
        self.guide.map_or(self.rho, |g| g.1.max(self.rho))
    }
}

impl FilmLine<'_> {
    fn field(&self) -> &Field {
        &self.moving.field
    }

    /// Velocity of the point `p` of a camera ray along w that ends, or changes its medium, there.
    pub fn end(&self, p: DVec3, w: DVec3, stop: &Stop) -> Velocity {
        let own = self.ray.at(p);
        match stop {
            Stop::Free | Stop::Open => own,
            Stop::Border(n) => own.mapped(onto(*n, w)),
            Stop::Opaque { shape, face, n } => {
                let on = own.mapped(onto(*n, w));
                if self.field().class(*shape).is_none() {
                    return on;
                }
                let slide = outer(w, *n) * (1.0 / n.dot(w));
                on.plus(1.0, &Velocity::of(Source::Shape { shape: *shape, face: *face }, p).mapped(slide))
            }
        }
    }

    /// Velocities of both ends of a piece of a camera line.
    pub fn ends(&self, piece: &Piece) -> [Velocity; 2] {
        let to = if piece.t1.is_finite() { self.end(piece.end(), piece.w, &piece.to) } else { Velocity::default() };
        [self.end(piece.start(), piece.w, &piece.from), to]
    }

    /// How the leg begins.
    pub fn opening(&self, o: &Opening) -> First {
        let first = o.first.map(|s| self.first(&s)).unwrap_or_default();
        o.second.iter().fold(first, |first, z| self.then(first, z))
    }

    /// The ray as it comes to the end of a leg that has begun so: as it is where the leg has no vertex, otherwise from its last one.
    pub fn coming(&self, first: &First, before: &Opening, end: &Specular) -> MovingRay {
        let (at, nth) = match (before.last, before.second, before.first) {
            (Some(z), ..) => (z, Nth::Later),
            (None, Some(z), _) => (z, Nth::Second),
            (None, None, Some(Seen::Surface { hit, .. })) => (Met::Surface(hit), Nth::First),
            (None, None, Some(Seen::Medium { p, .. })) => (Met::Medium(p), Nth::First),
            (None, None, None) => return self.ray.clone(),
        };
        MovingRay::leaving(at.p(), end.w, self.moving.vertex(self.scene, first, nth, &at))
    }

    pub fn first(&self, seen: &Seen) -> First {
        self.first_for(seen, Later::Path)
    }

    /// Of one that this comes behind.
    pub fn first_for(&self, seen: &Seen, later: Later) -> First {
        match seen {
            Seen::Surface { hit, w } => self.surface(hit, *w),
            Seen::Medium { p, span } => self.medium(*p, span, later),
        }
    }

    fn surface(&self, hit: &Hit, w: DVec3) -> First {
        let stop = Stop::Opaque { shape: hit.shape, face: hit.face, n: hit.n };
        let velocity = self.end(hit.p, w, &stop);
        let mut first = First { velocity, at: Some((hit.p, Some(*hit))), ..First::default() };
        if matches!(self.scene.surface_of(hit.shape), Surface::Rough(_)) {
            first.turn = self.ray.turn(hit.p, w);
        }
        if self.field().follows() {
            let mut e = first.velocity.clone();
            if self.field().class(hit.shape).is_some() {
                e = e.plus(-1.0, &Velocity::of(Source::at(hit), hit.p));
            }
            first.excess = self.excess(hit.p, e, Some((hit.shape, hit.face, hit.n)), true);
        }
        first
    }

    pub fn medium(&self, p: DVec3, span: &MediumSpan, later: Later) -> First {
        let Some(piece) = Piece::of(self.scene, span) else { return First::default() };
        let piece = piece.smooth_at(self.scene, (p - piece.o).dot(piece.w));
        let w = piece.w;
        let along = outer(w, w);
        let [a, b] = self.ends(&piece).map(|v| v.mapped(along));
        let (before, length) = ((p - piece.start()).dot(w).max(0.0), piece.t1 - piece.t0);
        let behind = (length - before).max(0.0);
        let settling = self.moving.settling(piece.medium);
        // What is left of an end's velocity along the ray at a distance from it, with its slope.
        let left = |d: f64| {
            let (k, slope) = decay(d / settling);
            (k, slope / settling)
        };
        let ((ka, sa), (kb, sb)) = if settling < length {
            (left(before), left(behind))
        } else if length.is_finite() {
            ((behind / length, -1.0 / length), (before / length, -1.0 / length))
        } else {
            ((1.0, 0.0), (0.0, 0.0))
        };
        let mut first = First { at: Some((p, None)), ..First::default() };
        first.stretch.add(&a, w * sa);
        first.stretch.add(&b, -w * sb);
        // Across the ray it is the ray's own, all ends slide along it only.
        first.velocity = self.ray.at(p).mapped(DMat3::IDENTITY - along).plus(ka, &a).plus(kb, &b);
        first.turn = self.ray.turn(piece.start(), w);
        let face = match piece.to {
            Stop::Opaque { shape, face, n } => Some((shape, face, n)),
            _ => None,
        };
        if later.may_follow(face) {
            let (v, _) = self.field().at(self.scene, p);
            first.excess = self.excess(p, first.velocity.clone().plus(-1.0, &v), face, false);
        }
        first
    }

    /// The same first vertex, for a path whose second is this one.
    #[must_use]
    pub fn then(&self, first: First, second: &Met) -> First {
        let Met::Surface(hit) = second else { return first };
        if !self.field().follows() {
            return first;
        }
        let held = self.held(&first, [hit.shape, hit.face], hit.p, hit.n);
        let slides = held.map(|a| first.ahead_of(self.field(), hit).mapped(a.map));
        let face = Some((hit.shape, hit.face, hit.n));
        First { after: slides.and_then(|e| self.excess(hit.p, e, face, true)), ..first }
    }

    /// How the second vertex, z on a face of normal n, keeps to its direction from the first.
    pub fn held(&self, first: &First, [shape, face]: [u32; 2], z: DVec3, n: DVec3) -> Option<Attached> {
        let (x, own) = first.at?;
        let plane = own.map(|h| h.n);
        let inner = self.moving.inner().distance([shape, face], x, plane)?;
        let alpha = own.and_then(|h| match self.scene.surface_of(h.shape) {
            Surface::Rough(rough) => Some(rough.alpha),
            _ => None,
        });
        let from = Origin { x, plane, alpha, inner };
        Attached::new(&self.scene.shapes[shape as usize].shape, face, from, z, n)
    }

    /// `along`: e keeps to the face as it is.
    fn excess(&self, x: DVec3, e: Velocity, face: Option<(u32, u32, DVec3)>, along: bool) -> Option<Box<Excess>> {
        if e.is_zero() {
            return None;
        }
        let Some((shape, face, n)) = face else {
            let rho = CLEAR * self.field().clearance(self.scene, x, None);
            return Some(Box::new(Excess { x, e, guide: None, rho }));
        };
        let own = &self.scene.shapes[shape as usize].shape;
        // Nor over where the face ends: no room counts what would leave it there.
        let radius = CLEAR * self.field().clearance(self.scene, x, Some((shape, face))).min(to_border(own, face, x));
        let guide = match own {
            Shape::Sphere(s) => {
                let r = (x - s.center).length();
                Guide::Sphere(s.center, (x - s.center) / r, r)
            }
            Shape::Cylinder(s) => {
                let m = s.from_axis(x);
                Guide::Cylinder(s.base, s.axis, m.normalize(), m.length())
            }
            _ => Guide::Plane(n),
        };
        let rho = if along {
            0.0
        } else {
            let own = self.scene.nearest_point(Kind::Opaque, x, radius / CLEAR, &|s, f| (s, f) == (shape, face));
            own.map_or(radius, |near| CLEAR * near.distance)
        };
        Some(Box::new(Excess { x, e, guide: Some((guide, radius)), rho }))
    }
}

impl First {
    /// Adds to V at a later point y, and to its divergence, what the first vertex carries along, and the second one if `y` comes `after` it.
    pub fn carry(&self, y: DVec3, after: bool, mut v: Velocity, rate: &mut Rate) -> Velocity {
        for x in self.excess.iter().chain(self.after.iter().filter(|_| after)) {
            if (y - x.x).length_squared() < x.reach() * x.reach() {
                let (map, spread) = x.at(y);
                rate.add(&x.e, spread);
                v = v.plus(1.0, &x.e.clone().mapped(map));
            }
        }
        v
    }

    /// Δ of [`super::attach`] before a second vertex on a surface.
    pub fn ahead_of(&self, field: &Field, z: &Hit) -> Velocity {
        let carried = self.carry(z.p, false, Velocity::default(), &mut Rate::default());
        let matter = field.class(z.shape).and_then(|_| self.beside([z.shape, z.face]));
        self.velocity.clone().plus(-1.0, &matter.unwrap_or_default()).plus(-1.0, &carried)
    }

    /// What matter it goes beside when the second vertex lies on this face: its own if it lies on the same shape.
    pub fn beside(&self, [shape, face]: [u32; 2]) -> Option<Velocity> {
        let source = |own: &Option<Hit>| match own {
            Some(hit) if hit.shape == shape => Source::at(hit),
            _ => Source::Shape { shape, face },
        };
        self.at.as_ref().map(|(x, own)| Velocity::of(source(own), *x))
    }

    /// The same vertex, of a path that has no second one yet.
    #[must_use]
    pub fn alone(&self) -> First {
        First { after: None, ..self.clone() }
    }

    /// Whether it carries anything.
    pub fn carries(&self) -> bool {
        self.excess.is_some()
    }
}

#[cfg(test)]
#[path = "first_tests.rs"]
mod tests;
