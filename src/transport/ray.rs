//! Rays in motion: a camera ray, or one that left a vertex in a fixed direction, and what smooth interfaces make of it ([T] 6.1).
//!
//! A point at the distance t moves with `u = ẋ + t ω̇`. At an interface of normal n, whose matter moves with v, the ray starts anew: from `u + ṫ ω`, `ṫ = <n,v-u>/<n,ω>`
//! ((13)), in a direction that turns as (39), (41) tell from ω̇, ṅ and the rates of the indices; the share of light that goes on changes with (42), beside η² where it goes through.
//! All of it is linear in slots.

use super::first::FilmLine;
use super::piece::{Stop, outer};
use super::velocity::{Source, Velocity};
use crate::math::fresnel::{Interface, conductor};
use crate::math::{DMat3, DVec3, Dual, Real, Rgb};
use crate::params::{Covector, Sink, Slot};
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

/// How that depends on the ray's direction, on the normal, and on the indices.
struct Slopes {
    /// Of the direction after it.
    by_d: DMat3,
    by_n: DMat3,
    by_index: SmallVec<[(Slot, DVec3); 2]>,
    /// Of the logarithm of the light's share, on ω̇ and ṅ, and by slot.
    share_d: Covector,
    share_n: Covector,
    share_index: SmallVec<[(Slot, Rgb); 2]>,
}

/// How the light's share at an interface changes: with the direction in which the ray comes, with the normal, and by slot.
pub struct Turned {
    coming: Velocity,
    normal: Velocity,
    share_d: Covector,
    share_n: Covector,
    share_index: SmallVec<[(Slot, Rgb); 2]>,
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
        match self {
            MovingRay::Still => Velocity::default(),
            MovingRay::Film => {
                let at = |p: DVec3| Velocity::of(Source::Camera, p);
                at(p + w).plus(-1.0, &at(p)).mapped(DMat3::IDENTITY - outer(w, w))
            }
            MovingRay::From(r) => r.turn.clone(),
        }
    }
}

impl Specular {
    fn slopes(&self, surface: &Surface, share: Share) -> Slopes {
        match surface {
            Surface::Dielectric { interior, exterior, slot } => self.dielectric([*interior, *exterior], *slot, share),
            Surface::Conductor { eta, k, slot, .. } => self.conductor(*eta, *k, *slot),
            _ => Slopes::of([DMat3::ZERO; 2]),
        }
    }

    /// The direction is `η d + a n`, n on the side that it comes from ([`Interface::bend`]); η, a and the share are functions of the cosine and of both indices, in dual numbers over these.
    fn dielectric(&self, index: [f64; 2], slot: Slot, share: Share) -> Slopes {
        let front = self.n.dot(self.w) < 0.0;
        let (d, sign) = (self.w, if front { 1.0 } else { -1.0 });
        let side = self.n * sign;
        let c = Dual::<3>::variable(-side.dot(d), 0);
        let (interior, exterior) = (Dual::variable(index[0], 1), Dual::variable(index[1], 2));
        let (n1, n2) = if front { (exterior, interior) } else { (interior, exterior) };
        let interface = Interface::new(c, n1, n2);
        let (eta, f) = (interface.eta, interface.reflectance());
        let refracted = interface.bend().zip(interface.cos_refracted()).filter(|_| self.through);
        let (mut s, share) = match refracted {
            Some((a, q)) => {
                let straight = |x: f64| DMat3::from_diagonal(DVec3::splat(x));
                let by_d = straight(eta.v) - outer(side, side) * a.d[0];
                let by_n = (straight(a.v) - outer(side, d) * a.d[0]) * sign;
                let through = Dual::constant(1.0) - f;
                let share = match share {
                    Share::Radiance => through * eta.sqr(),
                    Share::Irradiance => through * c / q,
                };
                let mut s = Slopes::of([by_d, by_n]);
                s.by_index.extend([0, 1].map(|k| (slot + k as Slot, d * eta.d[1 + k] + side * a.d[1 + k])));
                (s, share)
            }
            None => (Slopes::mirrored(d, self.n), f),
        };
        let log = |k: usize| if share.v > 0.0 { share.d[k] / share.v } else { 0.0 };
        s.share_d.add(side * -log(0), Rgb::ONE);
        s.share_n.add(d * (-log(0) * sign), Rgb::ONE);
        s.share_index.extend([0, 1].map(|k| (slot + k as Slot, Rgb::splat(log(1 + k)))));
        s
    }

    /// Variables of the share: cosine, eta, k.
    fn conductor(&self, eta: Rgb, k: Rgb, slot: Slot) -> Slopes {
        let mut s = Slopes::mirrored(self.w, self.n);
        let cos = self.n.dot(self.w);
        for c in 0..3 {
            let f = conductor(Dual::<3>::variable(cos.abs(), 0), Dual::variable(eta[c], 1), Dual::variable(k[c], 2));
            let log = |i: usize| if f.v > 0.0 { f.d[i] / f.v } else { 0.0 };
            // The cosine is ±<n,ω>.
            s.share_d.add(self.n, Rgb::channel(c, log(0) * cos.signum()));
            s.share_n.add(self.w, Rgb::channel(c, log(0) * cos.signum()));
            s.share_index.push((slot + c as Slot, Rgb::channel(c, log(1))));
            s.share_index.push((slot + 3 + c as Slot, Rgb::channel(c, log(2))));
        }
        s
    }
}

impl Slopes {
    fn of([by_d, by_n]: [DMat3; 2]) -> Slopes {
        Slopes {
            by_d,
            by_n,
            by_index: SmallVec::new(),
            share_d: Covector::default(),
            share_n: Covector::default(),
            share_index: SmallVec::new(),
        }
    }

    /// Of `d - 2 <n,d> n`, [T] (39), for either side of n.
    fn mirrored(d: DVec3, n: DVec3) -> Slopes {
        let along = DMat3::from_diagonal(DVec3::splat(n.dot(d)));
        Slopes::of([DMat3::IDENTITY - outer(n, n) * 2.0, (along + outer(n, d)) * -2.0])
    }
}

impl FilmLine<'_> {
    /// What becomes of the ray.
    pub fn behind(&self, b: &Specular) -> MovingRay {
        self.turned(b).0
    }

    /// The same, and how the light's share changes.
    pub fn turned(&self, b: &Specular) -> (MovingRay, Turned) {
        let slopes = b.slopes(self.scene.surface_of(b.hit.shape), Share::Radiance);
        // Directions stay of unit length.
        let across = DMat3::IDENTITY - outer(b.out, b.out);
        let (by_d, by_n) = (slopes.by_d, slopes.by_n);
        let mut out = Velocity::default();
        for &(slot, by) in slopes.by_index.iter().filter(|x| self.moving.is_index(x.0)) {
            out.add_value(slot, across * by);
        }
        let (start, turned) = self.at_interface(b, slopes);
        for (by, v) in [(by_d, &turned.coming), (by_n, &turned.normal)].into_iter().filter(|x| !x.1.is_zero()) {
            out.add(&(across * by), v);
        }
        (MovingRay::new(b.hit.p, b.out, start, out), turned)
    }

    /// How the ray's point there moves, and how the light's share changes.
    fn at_interface(&self, b: &Specular, slopes: Slopes) -> (Velocity, Turned) {
        let start = self.end(b.hit.p, b.w, &stop(b));
        let normal = self.normal(b, &start);
        let Slopes { share_d, share_n, mut share_index, .. } = slopes;
        if !self.moving.refracts(self.scene.shapes[b.hit.shape as usize].surface as usize) {
            share_index.clear();
        }
        (start, Turned { coming: self.ray.turn(b.hit.p, b.w), normal, share_d, share_n, share_index })
    }

    /// How the normal turns, whose point moves with `start`.
    fn normal(&self, b: &Specular, start: &Velocity) -> Velocity {
        let (p, n, shape) = (b.hit.p, b.n, b.hit.shape);
        // Over its matter.
        let slides = self.scene.shapes[shape as usize].shape.curvature(p, n);
        let mut normal = Velocity::default();
        if self.moving.moves(shape) {
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
            self.at_interface(b, slopes).1.partials(self.scene, sensor, value, sink);
        }
    }

    /// The velocity of the point where a line along w meets the surface, and keeps to it.
    pub fn slide(&self, b: &Specular, w: DVec3) -> Velocity {
        self.end(b.hit.p, w, &stop(b))
    }
}

impl Turned {
    /// What it adds where `value` was collected behind it.
    pub fn partials(&self, scene: &Scene, sensor: &Sensor, value: Rgb, sink: &mut impl Sink) {
        if value.is_zero() {
            return;
        }
        self.coming.apply(scene, sensor, &self.share_d.weighed(value), sink);
        self.normal.apply(scene, sensor, &self.share_n.weighed(value), sink);
        self.share_index.iter().for_each(|(slot, by)| sink.add(*slot, *by * value));
    }
}

fn stop(b: &Specular) -> Stop {
    Stop::Opaque { shape: b.hit.shape, face: b.hit.face, n: b.hit.n }
}
