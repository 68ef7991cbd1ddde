//! Light by given smooth faces, flat ones and balls, to a point, as all of it moves ([T] 6.2).
//!
//! A ray leaves the light by two coordinates u: of its direction, or of its place across parallel light. With it go its derivatives by them ([T] (41) and (46)): on to a face of normal n, which it meets at the
//! cosine c, `∂t = <n, ∂o + t ∂ω>/c`, where a ball's normal turns by `∂n = ∂o'/r`; mirrored there `∂ω' = ∂ω + 2 ∂c n + 2 c ∂n`; refracted `ω' = η ω + a n`, `∂ω' = η ∂ω + a_c ∂c n + a ∂n`, `a_c = -η a/q`,
//! with `∂c = -<n, ∂ω> - <∂n, ω>`. The area across the ray at the end that `du` spreads over gives G (47) for any number of faces. In dual numbers the ray misses the moving end x by what one Newton step with a constant slope puts right (46): the ray of that step, in dual numbers, is the way in motion, and everything about it is read off.

use crate::light::Origin;
use crate::math::fresnel::{self, Interface};
use crate::math::{DVec3, Real, Rgb, V3, warp};
use smallvec::SmallVec;

/// What a face does to light.
#[derive(Clone, Copy, Debug)]
pub enum Matter<R> {
    /// Indices before and beyond it, as light meets it.
    Dielectric([R; 2]),
    Conductor {
        eta: Rgb,
        k: Rgb,
    },
}

/// The surface of a face.
#[derive(Clone, Copy, Debug)]
pub enum Form<R> {
    /// A point of it, and its unit normal, on either side.
    Plane { p: V3<R>, n: V3<R> },
    /// Its centre, and a point on it; whether light meets it from within.
    Ball { center: V3<R>, rim: V3<R>, within: bool },
}

/// A face on the way.
#[derive(Clone, Copy, Debug)]
pub struct Face<R> {
    pub form: Form<R>,
    pub through: bool,
    pub matter: Matter<R>,
}

/// Where a line meets a face.
struct Met<R> {
    t: R,
    /// Against the line, and the cosine there.
    n: V3<R>,
    c: R,
    /// By what n turns per length along the face; none of a plane.
    bend: Option<R>,
}

impl<R: Real> Form<R> {
    /// `None` where a line misses a ball.
    fn met(&self, o: V3<R>, w: V3<R>) -> Option<Met<R>> {
        match *self {
            Form::Plane { p, n } => {
                let c = n.dot(w);
                let (n, c) = if c.value() > 0.0 { (-n, c) } else { (n, -c) };
                Some(Met { t: n.dot(o - p) / c, n, c, bend: None })
            }
            Form::Ball { center, rim, within } => {
                let (from, radius) = (o - center, (rim - center).length());
                let along = from.dot(w);
                let across = from - w * along;
                let half = radius * radius - across.dot(across);
                if half.value() <= 0.0 {
                    return None;
                }
                let half = half.sqrt();
                let t = if within { half - along } else { -half - along };
                let outward = (from + w * t) * radius.recip();
                let (n, bend) = if within { (-outward, -radius.recip()) } else { (outward, radius.recip()) };
                Some(Met { t, n, c: half * radius.recip(), bend: Some(bend) })
            }
        }
    }
}

/// Faces that light meets in turn on its way to x.
#[derive(Clone, Debug)]
pub struct Faces<R> {
    pub from: Origin<R>,
    /// The direction in which it starts, and the point at which it meets the first face.
    pub before: DVec3,
    pub first: DVec3,
    pub list: SmallVec<[Face<R>; 4]>,
    pub x: V3<R>,
}

/// The way.
#[derive(Clone, Debug)]
pub struct SmoothWay<R> {
    /// Points on the faces, from the light on.
    pub at: SmallVec<[V3<R>; 4]>,
    /// Directions before, between and behind them, and distances there; the first infinite for a light at infinity.
    pub w: SmallVec<[V3<R>; 5]>,
    pub lengths: SmallVec<[R; 5]>,
    /// Irradiance across the last direction over intensity, or over irradiance for a light at infinity.
    pub gain: [R; 3],
    /// By what the ray misses x across its direction, and how that changes with its two coordinates.
    misses: [R; 2],
    slope: [[f64; 2]; 2],
}

impl<R: Real> Faces<R> {
    /// The way in motion, near the one that `before` and `first` tell; `None` where there is none: in total reflection, or where it grazes a face.
    pub fn way(&self) -> Option<SmoothWay<R>> {
        let still = self.ray([R::zero(); 2])?;
        let ([x, y], [[a, b], [c, d]]) = (still.misses, still.slope);
        let det = a * d - b * c;
        self.ray([(x * d - y * b) / det, (y * a - x * c) / det])
    }

    fn ray(&self, by: [R; 2]) -> Option<SmoothWay<R>> {
        let (a, b) = warp::frame(self.before);
        let frame: [V3<R>; 2] = [V3::constant(a), V3::constant(b)];
        let off = frame[0] * by[0] + frame[1] * by[1];
        let none = V3::constant(DVec3::ZERO);
        // The ray, and its derivatives by both coordinates.
        let (mut o, mut w, mut slopes);
        match self.from {
            Origin::Position(q) => {
                let long = V3::constant(self.before) + off;
                (o, w) = (q, long.normalize());
                slopes = frame.map(|a| (none, (a - w * w.dot(a)) * long.length().recip()));
            }
            Origin::Infinity(direction) => {
                (o, w) = (V3::constant(self.first - self.before) + off, direction);
                slopes = frame.map(|a| (a, none));
            }
        }
        let mut way = SmoothWay {
            at: SmallVec::new(),
            w: SmallVec::from_slice(&[w]),
            lengths: SmallVec::new(),
            gain: [R::one(); 3],
            misses: [R::zero(); 2],
            slope: [[0.0; 2]; 2],
        };
        for face in &self.list {
            let Met { t, n, c, bend } = face.form.met(o, w)?;
            o = o + w * t;
            // Along the face, and how the normal turns with that.
            let along = slopes.map(|(start, turn)| {
                let moved = start + turn * t;
                moved + w * (n.dot(moved) / c)
            });
            let turned = bend.map(|by| along.map(|v| v * by));
            let mut cosines = slopes.map(|(_, turn)| -n.dot(turn));
            if let Some(turned) = turned {
                cosines = [0, 1].map(|i| cosines[i] - turned[i].dot(w));
            }
            slopes = [0, 1].map(|i| (along[i], slopes[i].1));
            let share = match face.matter {
                Matter::Dielectric([n0, n1]) => {
                    let interface = Interface::new(c, n0, n1);
                    let f = interface.reflectance();
                    if face.through {
                        let (a, q, eta) = (interface.bend()?, interface.cos_refracted()?, interface.eta);
                        w = (w * eta + n * a).normalize();
                        let by_cosine = -(eta * a) / q;
                        for (i, (_, turn)) in slopes.iter_mut().enumerate() {
                            *turn = *turn * eta + n * (by_cosine * cosines[i]);
                            turned.iter().for_each(|by| *turn = *turn + by[i] * a);
                        }
                    }
                    [if face.through { -f + 1.0 } else { f }; 3]
                }
                Matter::Conductor { eta, k } => {
                    [0, 1, 2].map(|i| fresnel::conductor(c, R::from(eta[i]), R::from(k[i])))
                }
            };
            if !face.through {
                w = w + n * (c * 2.0);
                for (i, (_, turn)) in slopes.iter_mut().enumerate() {
                    *turn = *turn + n * (cosines[i] * 2.0);
                    turned.iter().for_each(|by| *turn = *turn + by[i] * (c * 2.0));
                }
            }
            way.gain = std::array::from_fn(|i| way.gain[i] * share[i]);
            way.at.push(o);
            way.w.push(w);
            way.lengths.push(t);
        }
        if matches!(self.from, Origin::Infinity(_)) {
            way.lengths[0] = R::from(f64::INFINITY);
        }
        let rest = self.x - o;
        let t = rest.dot(w);
        way.lengths.push(t);
        let (a, b) = warp::frame(w.value());
        let across = |v: V3<R>| {
            let v = v - w * w.dot(v);
            [v.dot(V3::constant(a)), v.dot(V3::constant(b))]
        };
        way.misses = across(rest);
        let [u, v] = slopes.map(|(start, turn)| across(start + turn * t));
        way.slope = [[u[0].value(), v[0].value()], [u[1].value(), v[1].value()]];
        let area = u[0] * v[1] - u[1] * v[0];
        let area = if area.value() < 0.0 { -area } else { area };
        way.gain = way.gain.map(|g| g / area);
        (area.value() > 0.0).then_some(way)
    }
}

#[cfg(test)]
#[path = "smooth_way_tests.rs"]
mod tests;
