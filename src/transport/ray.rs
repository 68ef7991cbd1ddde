//! Rays in motion: a camera ray, or one that left a vertex in a fixed direction, and what smooth interfaces make of it ([T] 6.1).
//!
//! A point at the distance t moves with `u = ẋ + t ω̇`. At an interface of normal n, whose matter moves with v, the ray starts anew: from `u + ṫ ω`, `ṫ = <n,v-u>/<n,ω>`
//! ((13)), in a direction that turns as (39), (41) tell from ω̇, ṅ and the rates of the indices; the share of light that goes on changes with (42), beside η² where it goes through.
//! All of it is linear in slots.

use super::first::FilmLine;
use super::piece::{Stop, outer};
use super::velocity::{Rate, Source, Velocity};
use crate::math::fresnel::{Interface, conductor};
use crate::math::{DMat3, DVec3, Dual, Rgb};
use crate::params::{Sink, Slot};
use crate::scene::{Hit, Scene};
use crate::sensor::Sensor;
use crate::surface::Surface;
use smallvec::SmallVec;

/// How the points of a ray move.
#[derive(Clone, Debug, Default)]
pub enum MovingRay {
    #[default]
    Still,
    /// As its film point's.
    Film,
    From(Box<Leaving>),
}

/// A ray from `o`, which moves with `start`, along w, which turns with `turn`.
#[derive(Clone, Debug)]
pub struct Leaving {
    o: DVec3,
    w: DVec3,
    start: Velocity,
    turn: Velocity,
}

/// Where a smooth surface turned a ray.
#[derive(Clone, Copy, Debug)]
pub struct Specular {
    pub hit: Hit,
    /// The normal that it was turned by, on the front side.
    pub n: DVec3,
    /// Before, and after.
    pub w: DVec3,
    pub out: DVec3,
    pub through: bool,
}

/// Of what a share goes on: radiance against the ray, or irradiance across parallel rays of light.
#[derive(Clone, Copy)]
enum Share {
    Radiance,
    Irradiance,
}

/// How that depends on the ray's direction d, on the normal n, and on indices. Directions are `x d + y n` with x, y functions of `<n,d>`, which changes by `<n,ḋ> + <d,ṅ>`.
struct Slopes {
    /// x and y.
    parts: [f64; 2],
    /// y by `<n,d>`; x does not depend on it.
    by_cos: f64,
    /// Of the logarithm of the light's share.
    share_by_cos: Rgb,
    by_index: SmallVec<[Index; 2]>,
}

/// What changes with an index: the direction, and the logarithm of the light's share.
struct Index {
    slot: Slot,
    direction: DVec3,
    share: Rgb,
}

/// How the light's share at an interface changes: with `<n,d>`, and by slot.
pub struct Turned {
    cos: Rate,
    by_cos: Rgb,
    by_index: SmallVec<[(Slot, Rgb); 1]>,
}

impl MovingRay {
    /// One that leaves a moving point in a direction that does not turn.
    pub fn leaving(o: DVec3, w: DVec3, start: Velocity) -> MovingRay {
        MovingRay::new(o, w, start, Velocity::default())
    }

    /// One from `o`, which moves with `start`, along w, which turns with `turn`.
    pub fn new(o: DVec3, w: DVec3, start: Velocity, turn: Velocity) -> MovingRay {
        let still = start.is_zero() && turn.is_zero();
        if still { MovingRay::Still } else { MovingRay::From(Box::new(Leaving { o, w, start, turn })) }
    }

    pub fn is_still(&self) -> bool {
        matches!(self, MovingRay::Still)
    }

    /// Velocity of its point p at a fixed distance.
    pub fn at(&self, p: DVec3) -> Velocity {
        match self {
            MovingRay::Still => Velocity::default(),
            MovingRay::Film => Velocity::of(Source::Camera, p),
            MovingRay::From(r) => r.start.clone().plus((p - r.o).dot(r.w), &r.turn),
        }
    }

    /// How its direction w turns, ω̇; `p`: any of its points.
    pub fn turn(&self, p: DVec3, w: DVec3) -> Velocity {
        self.with_turn(p, w, Velocity::clone)
    }

    fn with_turn<T>(&self, p: DVec3, w: DVec3, f: impl FnOnce(&Velocity) -> T) -> T {
        match self {
            MovingRay::Still => f(&Velocity::default()),
            MovingRay::Film => {
                let at = |p: DVec3| Velocity::of(Source::Camera, p);
                f(&at(p + w).plus(-1.0, &at(p)).mapped(DMat3::IDENTITY - outer(w, w)))
            }
            MovingRay::From(r) => f(&r.turn),
        }
    }
}

impl Specular {
    fn slopes(&self, surface: &Surface, share: Share) -> Slopes {
        match surface {
            Surface::Dielectric { interior, exterior, slot } => self.dielectric([*interior, *exterior], *slot, share),
            Surface::Conductor { eta, k, slot, .. } => self.conductor(*eta, *k, *slot),
            _ => Slopes::mirrored(self.w, self.n),
        }
    }

    /// The direction is `η d + a n`, n on the side that it comes from ([`Interface::bend`]); a and the share are functions of the cosine and of η.
    fn dielectric(&self, [interior, exterior]: [f64; 2], slot: Slot, share: Share) -> Slopes {
        let front = self.n.dot(self.w) < 0.0;
        let sign = if front { 1.0 } else { -1.0 };
        let c = -sign * self.n.dot(self.w);
        let (n1, n2) = if front { (exterior, interior) } else { (interior, exterior) };
        let interface = Interface::new(c, n1, n2);
        let (eta, f) = (interface.eta, interface.sloped_reflectance());
        let refracted = interface.sloped_bend().zip(interface.cos_refracted()).filter(|_| self.through);
        let (mut s, direction, [by_c, by_eta]) = match refracted {
            Some((a, q)) => {
                let s = Slopes::of([eta, a.v * sign], -a.by_c);
                let through = 1.0 - f.v;
                let rest = match share {
                    Share::Radiance => [0.0, 2.0 / eta],
                    Share::Irradiance => [1.0 / c - eta * eta * c / (q * q), eta * (1.0 - c * c) / (q * q)],
                };
                let log = [rest[0] - f.by_c / through, rest[1] - f.by_eta / through];
                (s, self.w + self.n * (a.by_eta * sign), if through > 0.0 { log } else { [0.0; 2] })
            }
            None => {
                let log = [f.by_c, f.by_eta].map(|x| if f.v > 0.0 { x / f.v } else { 0.0 });
                (Slopes::mirrored(self.w, self.n), DVec3::ZERO, log)
            }
        };
        // The cosine is ∓<n,d>.
        s.share_by_cos = Rgb::splat(-by_c * sign);
        // η by the index that the ray comes from, and by the other.
        let by_n = [1.0 / n2, -eta / n2];
        for k in 0..2 {
            let eta = by_n[if front { 1 - k } else { k }];
            let (slot, share) = (slot + k as Slot, Rgb::splat(by_eta * eta));
            s.by_index.push(Index { slot, direction: direction * eta, share });
        }
        s
    }

    /// Variables of the share: cosine, eta, k.
    fn conductor(&self, eta: Rgb, k: Rgb, slot: Slot) -> Slopes {
        let mut s = Slopes::mirrored(self.w, self.n);
        let cos = self.n.dot(self.w);
        for c in 0..3 {
            let f = conductor(Dual::<3>::variable(cos.abs(), 0), Dual::variable(eta[c], 1), Dual::variable(k[c], 2));
            let log = |i: usize| if f.v > 0.0 { f.d[i] / f.v } else { 0.0 };
            // The cosine is ±<n,d>.
            s.share_by_cos += Rgb::channel(c, log(0) * cos.signum());
            for (slot, k) in [(slot, 1), (slot + 3, 2)] {
                let (slot, share) = (slot + c as Slot, Rgb::channel(c, log(k)));
                s.by_index.push(Index { slot, direction: DVec3::ZERO, share });
            }
        }
        s
    }
}

impl Slopes {
    fn of(parts: [f64; 2], by_cos: f64) -> Slopes {
        Slopes { parts, by_cos, share_by_cos: Rgb::ZERO, by_index: SmallVec::new() }
    }

    /// Of `d - 2 <n,d> n`, [T] (39), for either side of n.
    fn mirrored(d: DVec3, n: DVec3) -> Slopes {
        Slopes::of([1.0, -2.0 * n.dot(d)], -2.0)
    }
}

impl FilmLine<'_> {
    /// What becomes of the ray.
    pub fn behind(&self, b: &Specular) -> MovingRay {
        self.turned(b).0
    }

    /// The same, and how the light's share changes.
    pub fn turned(&self, b: &Specular) -> (MovingRay, Box<Turned>) {
        let slopes = b.slopes(self.scene.surface_of(b.hit.shape), Share::Radiance);
        // Directions stay of unit length.
        let across = DMat3::IDENTITY - outer(b.out, b.out);
        let mut out = Velocity::default();
        for x in slopes.by_index.iter().filter(|x| self.moving.is_index(x.slot) && x.direction != DVec3::ZERO) {
            out.add_value(x.slot, across * x.direction);
        }
        let start = self.slide(b, b.w);
        let normal = self.normal(b, &start);
        let along = across * b.n * slopes.by_cos;
        self.ray.with_turn(b.hit.p, b.w, |coming| {
            let parts = [(coming, slopes.parts[0], b.n), (&normal, slopes.parts[1], b.w)];
            for (v, part, by) in parts.into_iter().filter(|x| !x.0.is_zero()) {
                out.add(&(across * part + outer(along, by)), v);
            }
        });
        let turned = self.share(b, &slopes, &normal);
        (MovingRay::new(b.hit.p, b.out, start, out), turned)
    }

    /// How the light's share changes where the normal turns so.
    fn share(&self, b: &Specular, slopes: &Slopes, normal: &Velocity) -> Box<Turned> {
        let mut cos = Rate::default();
        self.ray.with_turn(b.hit.p, b.w, |coming| cos.add(coming, b.n));
        cos.add(normal, b.w);
        let active = slopes.by_index.iter().filter(|x| self.moving.is_index(x.slot));
        Box::new(Turned { cos, by_cos: slopes.share_by_cos, by_index: active.map(|x| (x.slot, x.share)).collect() })
    }

    /// How the normal turns, whose point moves with `start`.
    fn normal(&self, b: &Specular, start: &Velocity) -> Velocity {
        let (p, n, shape) = (b.hit.p, b.n, b.hit.shape);
        // Over its matter.
        let mut normal = Velocity::default();
        let moves = self.moving.moves(shape);
        if !moves && start.is_zero() {
            return normal;
        }
        let slides = self.scene.shapes[shape as usize].shape.curvature(p, n);
        if moves {
            let matter = Source::at(&b.hit);
            normal = Velocity::of_normal(matter, p, n);
            normal.add(&-slides, &Velocity::of(matter, p));
        }
        normal.add(&slides, start);
        normal
    }

    /// What an interface adds for parallel light that the ray is a line of, where `value` was collected behind it.
    pub fn flux_partials(&self, sensor: &Sensor, b: &Specular, value: Rgb, sink: &mut impl Sink) {
        if !value.is_zero() {
            let slopes = b.slopes(self.scene.surface_of(b.hit.shape), Share::Irradiance);
            let normal = self.normal(b, &self.slide(b, b.w));
            self.share(b, &slopes, &normal).partials(self.scene, sensor, value, sink);
        }
    }

    /// The velocity of the point where a line along w meets the surface, and keeps to it.
    pub fn slide(&self, b: &Specular, w: DVec3) -> Velocity {
        if self.ray.is_still() && !self.moving.moves(b.hit.shape) {
            return Velocity::default();
        }
        self.end(b.hit.p, w, &stop(b))
    }
}

impl Turned {
    /// What it adds where `value` was collected behind it.
    pub fn partials(&self, scene: &Scene, sensor: &Sensor, value: Rgb, sink: &mut impl Sink) {
        if value.is_zero() {
            return;
        }
        self.cos.apply(scene, sensor, self.by_cos * value, sink);
        self.by_index.iter().for_each(|(slot, by)| sink.add(*slot, *by * value));
    }
}

fn stop(b: &Specular) -> Stop {
    Stop::Opaque { shape: b.hit.shape, face: b.hit.face, n: b.hit.n }
}
