//! All ways that light takes from one point to another by a ball: mirrored, refracted in and out, and with reflections inside.
//!
//! A ray through a ball stays in the plane through the ball's centre, and keeps `Q = n b`, index times distance of its line from the centre (Snell's law is that, and so is a reflection). Seen from
//! the centre every part of it sweeps an angle that Q alone tells: with κ = 1/(n r), from a point at the distance r to the line's nearest point `acos(κ Q)`. So does the whole way,
//!
//! ```text
//! ψ(Q) = Σ_j w_j acos(κ_j Q),
//! ```
//!
//! and it ends at x where ψ = ±Θ + 2πk, Θ being the angle between both ends. With `Q = Q_max sin τ`, `k_j = κ_j Q_max <= 1`, the slope
//!
//! ```text
//! dψ/dτ = -Σ_j w_j k_j cos τ / √(cos²τ + (1-k_j²) sin²τ)
//! ```
//!
//! is a sum of terms that only fall in τ, so that it has exact bounds on any interval: where they leave out 0 there is at most one root, and where the value is further from the target than they let it
//! change there is none. Halving goes on until one of the two is so: all ways are found, two that merge (a caustic) only to 1e-9.
//!
//! Flux through a ring of rays gives what arrives ([T] (47) for a ball): a light of intensity 1 at the distance a sends `sin θ dθ dφ`, x at the distance c receives it on `c sin Θ dφ · c dψ cos γ`, with
//! sin θ = κ_a Q and sin γ = κ_c Q.

use super::DVec3;
use super::fresnel::Interface;
use super::rng::Rng;
use smallvec::SmallVec;
use std::f64::consts::{FRAC_PI_2, PI};

/// Reflections inside at most.
pub const REFLECTIONS: u32 = 12;
/// So many of them are always looked for.
const SURE: u32 = 2;
/// Intervals of τ no longer halved: two roots closer than that are one.
const NARROW: f64 = 1e-9;
/// Endpoints closer than this to the sphere, in radii, are on it.
const ON: f64 = 1e-12;
/// An end nearer to the centre than this, in radii, is put there.
const CENTRE: f64 = 1e-9;

/// A ball of glass or metal, its centre the origin.
#[derive(Clone, Copy, Debug)]
pub struct Ball {
    pub radius: f64,
    /// Indices outside and inside.
    pub index: [f64; 2],
    /// Nothing goes through.
    pub is_metal: bool,
}

/// One way.
#[derive(Clone, Debug)]
pub struct BallWay {
    /// Points on the sphere, from the source on.
    pub points: SmallVec<[DVec3; 4]>,
    /// Whether light goes through at each.
    pub through: SmallVec<[bool; 4]>,
    /// Cosine at each, on the side that light arrives from.
    pub cosines: SmallVec<[f64; 4]>,
    /// Irradiance across the ray at its end over intensity, or over irradiance for a source at infinity, without what is lost at the surfaces.
    pub gain: f64,
}

/// A term of ψ.
#[derive(Clone, Copy, Debug)]
struct Term {
    w: f64,
    kappa: f64,
}

/// An end of a way: its distance from the centre and index; infinite for a source at infinity.
#[derive(Clone, Copy, Debug)]
struct Place {
    r: f64,
    n: f64,
    inside: bool,
}

/// ψ in τ.
struct Sweep {
    terms: SmallVec<[Term; 8]>,
    q_max: f64,
    /// κ of it.
    largest: f64,
}

impl Sweep {
    /// Of terms that may come more than once.
    fn new(list: impl IntoIterator<Item = Term>) -> Option<Sweep> {
        let mut terms: SmallVec<[Term; 8]> = SmallVec::new();
        for t in list {
            match terms.iter_mut().find(|o| o.kappa == t.kappa) {
                Some(own) => own.w += t.w,
                None => terms.push(t),
            }
        }
        let largest = terms.iter().map(|t| t.kappa).fold(0.0, f64::max);
        (largest > 0.0).then_some(Sweep { terms, q_max: 1.0 / largest, largest })
    }

    fn k(&self, kappa: f64) -> f64 {
        // Exactly 1 where the product would round.
        if kappa == self.largest { 1.0 } else { (kappa * self.q_max).min(1.0) }
    }

    fn value(&self, tau: f64) -> f64 {
        let (s, c) = tau.sin_cos();
        // acos(k sin τ) without loss near 1.
        let angle = |k: f64| root(k, s, c).atan2(k * s);
        self.terms.iter().map(|t| if t.kappa > 0.0 { t.w * angle(self.k(t.kappa)) } else { t.w * FRAC_PI_2 }).sum()
    }

    /// The largest and least of dψ/dτ between two τ.
    fn slopes(&self, t0: f64, t1: f64) -> [f64; 2] {
        let at = |tau: f64, k: f64| {
            let (s, c) = tau.sin_cos();
            if k < 1.0 { k * c / root(k, s, c) } else { 1.0 }
        };
        let (mut lo, mut hi) = (0.0, 0.0);
        for t in &self.terms {
            let k = self.k(t.kappa);
            let (first, last) = (-t.w * at(t0, k), -t.w * at(t1, k));
            lo += first.min(last);
            hi += first.max(last);
        }
        [lo, hi]
    }

    fn slope(&self, tau: f64) -> f64 {
        self.slopes(tau, tau)[0]
    }

    /// τ and ψ there.
    fn at(&self, tau: f64) -> [f64; 2] {
        [tau, self.value(tau)]
    }

    /// Bounds on ψ between two places.
    fn range([t0, v0]: [f64; 2], [t1, v1]: [f64; 2], [lo, hi]: [f64; 2]) -> [f64; 2] {
        let d = t1 - t0;
        let [fall, rise] = [lo.min(0.0) * d, hi.max(0.0) * d];
        [(v0 + fall).max(v1 - rise), (v0 + rise).min(v1 - fall)]
    }

    /// All τ between two places at which ψ is `target`.
    fn roots(&self, target: f64, a: [f64; 2], b: [f64; 2], found: &mut SmallVec<[f64; 4]>) {
        let [lo, hi] = self.slopes(a[0], b[0]);
        let (fa, fb) = (a[1] - target, b[1] - target);
        if lo >= 0.0 || hi <= 0.0 {
            if fa == 0.0 {
                found.push(a[0]);
            } else if fa * fb < 0.0 {
                found.push(self.root_between(target, [a[0], b[0]], fa));
            }
            return;
        }
        let [least, most] = Self::range(a, b, [lo, hi]);
        if target < least || target > most {
            return;
        }
        if b[0] - a[0] < NARROW {
            if fa * fb < 0.0 {
                found.push(0.5 * (a[0] + b[0]));
            }
            return;
        }
        let middle = self.at(0.5 * (a[0] + b[0]));
        self.roots(target, a, middle, found);
        self.roots(target, middle, b, found);
    }

    /// The only one, by Newton's steps within a bracket.
    fn root_between(&self, target: f64, [mut a, mut b]: [f64; 2], at_a: f64) -> f64 {
        let mut t = 0.5 * (a + b);
        for _ in 0..100 {
            let f = self.value(t) - target;
            if f == 0.0 {
                break;
            }
            if (f > 0.0) == (at_a > 0.0) {
                a = t
            } else {
                b = t
            }
            let next = t - f / self.slope(t);
            let next = if next > a && next < b { next } else { 0.5 * (a + b) };
            if (next - t).abs() <= 2.0 * f64::EPSILON * t.max(f64::MIN_POSITIVE) {
                return next;
            }
            t = next;
        }
        t
    }
}

/// √(1 - k² s²), s² + c² = 1.
fn root(k: f64, s: f64, c: f64) -> f64 {
    (c * c + (1.0 - k) * (1.0 + k) * s * s).sqrt()
}

/// What a way through the ball is made of.
struct Kind {
    /// Of an end inside: whether the line's nearest point to the centre lies between it and the sphere.
    inward: [bool; 2],
    /// Whole chords.
    chords: u32,
    /// Probability of being looked for.
    asked: f64,
}

impl Ball {
    /// All ways from the source to x with up to `interfaces` points on the sphere. `source`: a position, or the direction toward a source at infinity, unit.
    ///
    /// With random numbers ways of more than two reflections are looked for every other time less with each: they take as long as the others, and bring little.
    pub fn ways(
        &self,
        source: DVec3,
        at_infinity: bool,
        x: DVec3,
        interfaces: u32,
        mut rng: Option<&mut Rng>,
        mut each: impl FnMut(BallWay),
    ) {
        // From the centre all directions are alike: an end there is put beside it, across the way to the other.
        let beside = |p: DVec3, other: DVec3| {
            let least = CENTRE * self.radius;
            if p.length() >= least {
                p
            } else {
                other.try_normalize().map_or(p, |w| w.any_orthonormal_vector() * least)
            }
        };
        let (source, x) = (if at_infinity { source } else { beside(source, x) }, beside(x, source));
        let place = |r: f64| {
            let inside = r < self.radius;
            Place { r, n: self.index[usize::from(inside)], inside }
        };
        let a = if at_infinity { place(f64::INFINITY) } else { place(source.length()) };
        let c = place(x.length());
        let on = |p: Place| (p.r - self.radius).abs() <= ON * self.radius;
        if on(a) || on(c) || self.is_metal && (a.inside || c.inside) || interfaces == 0 {
            return;
        }
        // The plane of the way: polar angles from the source.
        let e1 = source.normalize();
        let across = x - e1 * x.dot(e1);
        let e2 = across.try_normalize().unwrap_or_else(|| e1.any_orthonormal_vector());
        let theta = across.length().atan2(x.dot(e1));
        let mut kinds: SmallVec<[Kind; 8]> = SmallVec::new();
        let within = |p: Place| if p.inside { &[false, true][..] } else { &[false][..] };
        let outside = u32::from(!a.inside) + u32::from(!c.inside);
        // A point on the sphere more each time; both inside have none without a reflection.
        let (first, least) = if outside == 0 { (0, 1) } else { (outside - 1, outside) };
        if !self.is_metal {
            for m in 0..=REFLECTIONS.min(interfaces.saturating_sub(least)) {
                if least + m > interfaces {
                    break;
                }
                let asked = rng.as_ref().map_or(1.0, |_| 0.5f64.powi(m.saturating_sub(SURE) as i32));
                if asked < 1.0 && rng.as_deref_mut().is_some_and(|r| r.uniform() >= asked) {
                    continue;
                }
                for (&i, &j) in within(a).iter().flat_map(|i| within(c).iter().map(move |j| (i, j))) {
                    kinds.push(Kind { inward: [i, j], chords: first + m, asked });
                }
            }
        }
        for kind in &kinds {
            self.of_kind([a, c], Some(kind), theta, (e1, e2), &mut each);
        }
        if outside == 2 {
            self.of_kind([a, c], None, theta, (e1, e2), &mut each);
        }
    }

    /// `kind`: `None` mirrors outside.
    fn of_kind(
        &self,
        ends: [Place; 2],
        kind: Option<&Kind>,
        theta: f64,
        (e1, e2): (DVec3, DVec3),
        each: &mut impl FnMut(BallWay),
    ) {
        let [outer, inner] = self.index.map(|n| 1.0 / (n * self.radius));
        let mut terms: SmallVec<[Term; 8]> = SmallVec::new();
        // What an end sweeps up to the sphere.
        let leg = |p: Place, inward: bool| -> [Term; 2] {
            let own = Term { w: 1.0, kappa: if p.r.is_finite() { 1.0 / (p.n * p.r) } else { 0.0 } };
            if p.inside {
                [Term { w: 1.0, kappa: inner }, Term { w: if inward { 1.0 } else { -1.0 }, ..own }]
            } else {
                [own, Term { w: -1.0, kappa: outer }]
            }
        };
        let inward = kind.map_or([false; 2], |k| k.inward);
        let legs = [leg(ends[0], inward[0]), leg(ends[1], inward[1])];
        legs.iter().for_each(|l| terms.extend(*l));
        let chords = kind.map_or(0, |k| k.chords);
        terms.push(Term { w: 2.0 * f64::from(chords), kappa: if kind.is_some() { inner } else { 0.0 } });
        let Some(sweep) = Sweep::new(terms) else { return };
        let of =
            |l: &[Term], tau: f64| Sweep { terms: l.into(), q_max: sweep.q_max, largest: sweep.largest }.value(tau);
        // Rays that go round the other way arrive at -ψ.
        let [first, last] = [sweep.at(0.0), sweep.at(FRAC_PI_2)];
        let [least, most] = Sweep::range(first, last, sweep.slopes(0.0, FRAC_PI_2));
        let mut turns = 0.0;
        while turns - theta <= most {
            for (side, target) in [(1.0, turns + theta), (-1.0, turns - theta)] {
                if target < least || target > most || side < 0.0 && theta == 0.0 {
                    continue;
                }
                let mut roots: SmallVec<[f64; 4]> = SmallVec::new();
                sweep.roots(target, first, last, &mut roots);
                // The ray through the centre goes round on neither side.
                for tau in roots.into_iter().filter(|&t| t > 0.0 || side > 0.0) {
                    let start = of(&legs[0], tau);
                    let chord = 2.0 * of(&[Term { w: 1.0, kappa: inner }], tau);
                    let point = |angle: f64| {
                        let (s, c) = angle.sin_cos();
                        (e1 * c + e2 * (side * s)) * self.radius
                    };
                    let corners = (0..=chords).map(|k| point(start + f64::from(k) * chord));
                    if let Some(mut way) = self.way(&sweep, tau, ends, corners.collect(), kind.is_some(), theta) {
                        way.gain /= kind.map_or(1.0, |k| k.asked);
                        each(way);
                    }
                }
            }
            turns += 2.0 * PI;
        }
    }

    fn way(
        &self,
        sweep: &Sweep,
        tau: f64,
        [a, c]: [Place; 2],
        points: SmallVec<[DVec3; 4]>,
        enters: bool,
        theta: f64,
    ) -> Option<BallWay> {
        let (s, co) = tau.sin_cos();
        let q = sweep.q_max * s;
        let last = points.len() - 1;
        let through = |k: usize| enters && (k == 0 && !a.inside || k == last && !c.inside);
        // On the side it arrives from: outside at the first point of a way that comes from there.
        let cosine = |k: usize| {
            let outside = k == 0 && !a.inside;
            let kappa = 1.0 / (self.index[usize::from(!outside)] * self.radius);
            root(sweep.k(kappa), s, co)
        };
        let slope = sweep.slope(tau).abs();
        let own = |p: Place| if p.r.is_finite() { 1.0 / (p.n * p.r) } else { 0.0 };
        let cos_of = |p: Place| root(sweep.k(own(p)), s, co);
        // sin θ / sin Θ, through the centre by its limit.
        let sine = theta.sin().abs();
        let by_q = if sine > 1e-7 {
            q / sine
        } else if s < 1e-6 {
            sweep.q_max / slope
        } else {
            return None;
        };
        let ring = by_q * sweep.q_max * co / (c.r * c.r * cos_of(c) * slope);
        let gain = if a.r.is_finite() {
            let k = own(a);
            ring * k * k / cos_of(a)
        } else {
            ring / (a.n * a.n)
        };
        let n = points.len();
        (gain.is_finite() && gain > 0.0).then(|| BallWay {
            points,
            through: (0..n).map(through).collect(),
            cosines: (0..n).map(cosine).collect(),
            gain,
        })
    }

    /// What is left of light at the `k`th point of a way through or inside glass.
    pub fn share(&self, way: &BallWay, k: usize, from_outside: bool) -> f64 {
        let [outer, inner] = self.index;
        let (n1, n2) = if from_outside { (outer, inner) } else { (inner, outer) };
        let f = Interface::new(way.cosines[k], n1, n2).reflectance();
        if way.through[k] { 1.0 - f } else { f }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::fresnel::reflect;
    use crate::math::{V3, warp};

    /// A ray that leaves the source: points on the sphere, and the last leg, going through where that is asked for and possible.
    fn trace(ball: &Ball, mut o: DVec3, mut w: DVec3, through: &[bool]) -> Option<(Vec<DVec3>, DVec3, DVec3)> {
        let mut points = Vec::new();
        for &t in through {
            let (b, c) = (o.dot(w), o.length_squared() - ball.radius * ball.radius);
            let d = (b * b - c).max(0.0).sqrt();
            let inside =
                if points.is_empty() { c < 0.0 } else { (o - w * 1e-9).length() > 0.0 && points_inside(&o, w) };
            if b * b < c || !inside && -b - d <= 0.0 {
                return None;
            }
            let p = o + w * if inside { -b + d } else { -b - d };
            let n = p / ball.radius;
            let (side, index) = if inside { (-n, [ball.index[1], ball.index[0]]) } else { (n, ball.index) };
            let i = Interface::new(-w.dot(side), index[0], index[1]);
            w = if t { i.refract(V3::constant(w), V3::constant(side))?.value().normalize() } else { reflect(w, n) };
            points.push(p);
            o = p;
        }
        Some((points, o, w))
    }

    /// Whether a ray that leaves the sphere's point goes inward.
    fn points_inside(p: &DVec3, w: DVec3) -> bool {
        p.dot(w) < 0.0
    }

    /// [T] D4: the point of crossing and G (47) by a sphere, and dG/dn by differences of the solver.
    #[test]
    fn the_geometry_factor_of_a_sphere() {
        let way = |n: f64| {
            let ball = Ball { radius: 1.0, index: [1.0, n], is_metal: false };
            let mut found = Vec::new();
            let [p, x] = [DVec3::new(0.5, 0.8, 2.0), DVec3::new(0.2, -0.1, 0.3)];
            ball.ways(p, false, x, 1, None, |way| found.push(way));
            assert_eq!(found.len(), 1);
            found.remove(0)
        };
        let own = way(1.5);
        assert!((own.points[0] - DVec3::new(0.34199455, 0.17381811, 0.92348633)).length() < 1e-8, "{own:?}");
        assert!((own.gain - 0.501025758131).abs() < 1e-12, "{own:?}");
        let central = |h: f64| (way(1.5 + h).gain - way(1.5 - h).gain) * (0.5 / h);
        let slope = (central(1e-3) * 4.0 - central(2e-3)) / 3.0;
        assert!((slope - 0.4838993851).abs() < 1e-8, "{slope}");
    }

    /// Every ray that is traced is among the ways to any point that it passes, with the points that it met and a gain that its neighbours confirm.
    #[test]
    fn all_rays_are_found() {
        let mut rng = Rng::keyed(5, 0, 0, 0);
        let (mut compared, mut counts) = (0, [0; 5]);
        for round in 0..6000u64 {
            let index = [[1.0, 1.5], [1.33, 1.0], [1.0, 1.0001], [1.0, 2.4]][(round % 4) as usize];
            let ball = Ball { radius: 0.5 + rng.uniform(), index, is_metal: false };
            let mut sphere = || warp::sphere(rng.uniform(), rng.uniform());
            let (far, toward, target) = (round % 3 == 0, sphere(), sphere());
            let a = if round % 3 == 1 { 0.95 * rng.uniform() } else { 1.02 + 3.0 * rng.uniform() } * ball.radius;
            let target = target * (ball.radius * rng.uniform().sqrt());
            // A disk before the ball stands for infinity.
            let (o, w) =
                if far { (target + toward * 50.0, -toward) } else { (toward * a, (target - toward * a).normalize()) };
            let inside = !far && a < ball.radius;
            let m = (round / 12 % 4) as usize;
            let through: Vec<bool> = match (inside, m) {
                (false, 3) => vec![false],
                (false, m) if round % 2 == 0 => [vec![true], vec![false; m]].concat(),
                (false, m) => [vec![true], vec![false; m], vec![true]].concat(),
                (true, m) if round % 2 == 0 => vec![false; m + 1],
                (true, m) => [vec![false; m], vec![true]].concat(),
            };
            let Some((points, p, behind)) = trace(&ball, o, w, &through) else { continue };
            let chord = -2.0 * p.dot(behind);
            let ends_inside = p.dot(behind) < 0.0;
            let t = if ends_inside { chord * (0.02 + 0.96 * rng.uniform()) } else { 0.02 + 4.0 * rng.uniform() };
            let x = p + behind * t;
            // Areas across the last leg, of directions or of the disk.
            let across = |v: DVec3| {
                let h = 1e-6;
                let side = |s: f64| {
                    let (o, w) = if far { (o + v * (s * h), w) } else { (o, (w + v * (s * h)).normalize()) };
                    let (_, p, behind_) = trace(&ball, o, w, &through)?;
                    Some(p + behind_ * ((x - p).dot(behind) / behind_.dot(behind)))
                };
                Some((side(1.0)? - side(-1.0)?) / (2.0 * h))
            };
            let (u, v) = warp::frame(w);
            let (Some(du), Some(dv)) = (across(u), across(v)) else { continue };
            let gain = 1.0 / du.cross(dv).length();
            let (mut found, mut total) = (None, 0);
            ball.ways(if far { toward } else { o }, far, x, 6, None, |way| {
                let same = way.points.len() == points.len() && way.through[..] == through[..];
                let near = |(a, b): (&DVec3, &DVec3)| (*a - *b).length() < 1e-6;
                total += usize::from(same);
                if same && way.points.iter().zip(&points).all(near) {
                    found = Some(way);
                }
            });
            // Beside caustics and grazing rays differences are no measure; the way is there all the same.
            let Some(way) = found else {
                panic!(
                    "{round}: {ball:?} source {o} far {far} x {x} {through:?} {points:?}: {total} others, gain {gain}"
                )
            };
            counts[total.min(4)] += 1;
            if gain < 1e3 && gain > 1e-6 {
                let off = (way.gain / gain - 1.0).abs();
                assert!(off < 1e-4 * (1.0 + gain), "{round}: {} {gain} {through:?}", way.gain);
                compared += 1;
            }
        }
        // Also where there are several.
        assert!(compared > 3000 && counts[2] + counts[3] + counts[4] > 300, "{compared} {counts:?}");
    }

    /// Flux is kept: what a source at infinity sends through the ball without reflections falls on a screen.
    #[test]
    fn gains_keep_flux() {
        let ball = Ball { radius: 1.0, index: [1.0, 1.5], is_metal: false };
        // On a plane behind the ball, within a radius; rays of the disk that come there are traced.
        let (z, radius, n) = (-1.6, 0.8, 4000);
        let mut received = 0.0;
        for i in 0..n {
            let r = radius * (f64::from(i) + 0.5) / f64::from(n);
            let x = DVec3::new(r, 0.0, z);
            ball.ways(DVec3::Z, true, x, 2, None, |way| {
                if way.through.len() == 2 {
                    let w = (x - way.points[1]).normalize();
                    received += way.gain * -w.z * 2.0 * PI * r * radius / f64::from(n);
                }
            });
        }
        let mut sent = 0.0;
        for i in 0..200_000 {
            let b = (f64::from(i) + 0.5) / 200_000.0;
            let Some((_, p, w)) = trace(&ball, DVec3::new(b, 0.0, 5.0), -DVec3::Z, &[true, true]) else { continue };
            let x = p + w * ((z - p.z) / w.z);
            sent += if x.x.hypot(x.y) < radius { 2.0 * PI * b / 200_000.0 } else { 0.0 };
        }
        assert!((received / sent - 1.0).abs() < 0.01, "{received} {sent}");
    }
}
