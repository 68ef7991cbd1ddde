//! Rays in motion: a camera ray, or one that left a vertex in a fixed direction, and what smooth interfaces make of it ([T] 6.1).
//!
//! A point at the distance t moves with `u = ẋ + t ω̇`. At an interface of normal n, whose matter moves with v, the ray starts anew: from `u + ṫ ω`, `ṫ = <n,v-u>/<n,ω>`
//! ((13)), in a direction that turns as (39), (41) tell from ω̇, ṅ and the rates of the indices; the share of light that goes on changes with (42), beside η² where it goes through.
//! All of it is linear in slots.

use super::first::FilmLine;
use super::piece::{Stop, outer};
use super::velocity::{Source, Velocity};
use crate::math::fresnel::{Interface, conductor};
use crate::math::{DMat3, DVec3, Dual, Real, Rgb, V3};
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

/// The partials of a vector by three variables.
fn jacobian<const N: usize>(v: V3<Dual<N>>, first: usize) -> DMat3 {
    let column = |k: usize| DVec3::new(v.x.d[first + k], v.y.d[first + k], v.z.d[first + k]);
    DMat3::from_cols(column(0), column(1), column(2))
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
            _ => Slopes::of(V3::<Dual<6>>::constant(self.out)),
        }
    }

    /// Variables: direction, normal, index behind the front side, index before it.
    fn dielectric(&self, index: [f64; 2], slot: Slot, share: Share) -> Slopes {
        let (d, n) = (V3::<Dual<8>>::variable(self.w, 0), V3::<Dual<8>>::variable(self.n, 3));
        let front = self.n.dot(self.w) < 0.0;
        let side = if front { n } else { -n };
        let (interior, exterior) = (Dual::variable(index[0], 6), Dual::variable(index[1], 7));
        let (n1, n2) = if front { (exterior, interior) } else { (interior, exterior) };
        let c = -side.dot(d);
        let interface = Interface::new(c, n1, n2);
        let f = interface.reflectance();
        let refracted = interface.refract(d, side).zip(interface.cos_refracted()).filter(|_| self.through);
        let (out, share) = match (refracted, share) {
            (Some((out, _)), Share::Radiance) => (out, (Dual::constant(1.0) - f) * interface.eta.sqr()),
            (Some((out, q)), Share::Irradiance) => (out, (Dual::constant(1.0) - f) * c / q),
            (None, _) => (mirrored(d, n), f),
        };
        let mut s = Slopes::of(out);
        let log = |k: usize| if share.v > 0.0 { share.d[k] / share.v } else { 0.0 };
        s.share_d.add(DVec3::new(log(0), log(1), log(2)), Rgb::ONE);
        s.share_n.add(DVec3::new(log(3), log(4), log(5)), Rgb::ONE);
        for k in 0..2 {
            let by = DVec3::new(out.x.d[6 + k], out.y.d[6 + k], out.z.d[6 + k]);
            s.by_index.push((slot + k as Slot, by));
            s.share_index.push((slot + k as Slot, Rgb::splat(log(6 + k))));
        }
        s
    }

    /// Variables of the direction: direction, normal; of the share: cosine, eta, k.
    fn conductor(&self, eta: Rgb, k: Rgb, slot: Slot) -> Slopes {
        let mut s = Slopes::of(mirrored(V3::<Dual<6>>::variable(self.w, 0), V3::variable(self.n, 3)));
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

/// [T] (39), for either side of n.
fn mirrored<R: Real>(d: V3<R>, n: V3<R>) -> V3<R> {
    d - n * (n.dot(d) * 2.0)
}

impl Slopes {
    /// Variables 0 to 2: direction, 3 to 5: normal.
    fn of<const N: usize>(out: V3<Dual<N>>) -> Slopes {
        Slopes {
            by_d: jacobian(out, 0),
            by_n: jacobian(out, 3),
            by_index: SmallVec::new(),
            share_d: Covector::default(),
            share_n: Covector::default(),
            share_index: SmallVec::new(),
        }
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
        let (by_d, by_n, by_index) = (slopes.by_d, slopes.by_n, slopes.by_index.clone());
        let (start, turned) = self.at_interface(b, slopes);
        let mut out = turned.coming.clone().mapped(by_d).plus(1.0, &turned.normal.clone().mapped(by_n));
        for (slot, by) in by_index {
            if self.moving.is_index(slot) {
                out = out.plus(1.0, &Velocity::value(slot, by));
            }
        }
        let out = out.mapped(DMat3::IDENTITY - outer(b.out, b.out));
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
        let mut over = start.clone();
        let mut normal = Velocity::default();
        if self.moving.moves(shape) {
            let matter = Source::at(&b.hit);
            over = over.plus(-1.0, &Velocity::of(matter, p));
            normal = Velocity::of_normal(matter, p, n);
        }
        normal.plus(1.0, &over.mapped(self.scene.shapes[shape as usize].shape.curvature(p, n)))
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
