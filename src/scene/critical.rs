//! Directions near the critical angles of smooth interfaces, and near the outlines of balls of metal.
//!
//! Beside the critical angle what goes through an interface falls like q, the cosine of refraction, and its derivative by the index, or by anything that moves the vertex before or the interface,
//! grows like 1/q ([T] section 9). Directions of a phase function meet q with the density `q dq`, so that the second moment of such a score grows like a logarithm of the number of samples:
//! single paths rule. A share of directions is therefore drawn with a density ~ 1/q, in a balance heuristic with the others: the second moment is finite then. Pictures would only get noisier
//! by that, so derivatives have paths of their own here ([`crate::transport::Sweep::sample`]).
//!
//! From a point x on the denser side the critical angle is a cone: by Snell's law `q² = 1 - s² (1-μ²)`, μ the cosine between the direction and an axis: of a plane its normal,
//! `s = η`; of a sphere the line through its centre at the distance ρ, `s = η ρ/R` (all chords of a sphere through x at one angle with that line meet it at the same angle). With
//! `p(q) = 1 / ((q + w) ln(1 + 1/w))`, `w = √(s²-1)` the scale over which reflectance falls, and an even azimuth,
//!
//! ```text
//! p(ω) = p(q) s² |μ| / (2π q).
//! ```
//!
//! *The outline of a ball of metal*, seen from outside, is such a cone, of `s = ρ/R`, with q the cosine at which rays meet the ball: by it rays turn with what moves like 1/q.

use super::{Instance, Scene};
use crate::math::rng::Rng;
use crate::math::{DVec2, DVec3, warp};
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use std::f64::consts::PI;

/// Share of the first directions of a path that are drawn by cones; each later one has half of that of the one before: weights of hundreds of them would multiply, and
/// light that scatters often leaves less to a single critical angle.
const SHARE: f64 = 0.4;
/// Directions behind which nothing is drawn by cones.
const LAST: u32 = 5;
/// More planes than this are left out: each would get too few directions.
const PLANES: usize = 16;

/// An interface, seen from its denser side.
#[derive(Clone, Copy, Debug)]
enum Side {
    /// The normal points to the thinner side.
    Plane {
        p: DVec3,
        n: DVec3,
    },
    Sphere {
        center: DVec3,
        radius: f64,
        dense_inside: bool,
    },
}

/// A shape's interfaces.
#[derive(Clone, Debug)]
struct Body {
    sides: Vec<Side>,
    /// Index of the denser side over that of the other.
    eta: f64,
    /// Its denser side is behind all of its planes: seen from elsewhere they are out of reach.
    is_within: bool,
}

impl Body {
    fn faces(&self, x: DVec3) -> bool {
        let behind = |s: &Side| matches!(*s, Side::Plane { p, n } if (x - p).dot(n) < 0.0);
        !self.is_within || self.sides.iter().all(behind)
    }
}

/// All that has such cones; empty where there is none.
#[derive(Clone, Debug, Default)]
pub struct Critical {
    bodies: Vec<Body>,
    sides: usize,
}

/// The cone of one interface at one point: axis, s, and whether both ends of the axis meet it.
struct Cone {
    axis: DVec3,
    s: f64,
    both: bool,
}

impl Cone {
    /// Cosine of refraction, squared; negative in total reflection.
    fn q2(&self, w: DVec3) -> f64 {
        1.0 - self.s * self.s * w.cross(self.axis).length_squared()
    }

    fn scale(&self) -> f64 {
        ((self.s - 1.0) * (self.s + 1.0)).sqrt()
    }

    /// Density per solid angle.
    fn density(&self, w: DVec3) -> f64 {
        let (mu, q2) = (w.dot(self.axis), self.q2(w));
        if q2 <= 0.0 || mu <= 0.0 && !self.both {
            return 0.0;
        }
        let (q, scale) = (q2.sqrt(), self.scale());
        let ends = if self.both { 2.0 } else { 1.0 };
        let p = 1.0 / ((q + scale) * scale.recip().ln_1p());
        p * self.s * self.s * mu.abs() / (2.0 * PI * q * ends)
    }

    fn sample(&self, u: f64, v: f64, end: f64) -> DVec3 {
        let scale = self.scale();
        let q = (scale * (u * scale.recip().ln_1p()).exp_m1()).min(1.0);
        let sin = ((1.0 - q) * (1.0 + q)).sqrt() / self.s;
        let mu = ((1.0 - sin) * (1.0 + sin)).sqrt();
        let mu = if self.both && end < 0.5 { -mu } else { mu };
        let (y, x) = (2.0 * PI * v).sin_cos();
        warp::to_world(self.axis, DVec3::new(sin * x, sin * y, mu)).normalize()
    }
}

impl Side {
    /// The cone at x; `None` on the thinner side, or where no direction from x is reflected in total.
    fn cone(&self, eta: f64, x: DVec3) -> Option<Cone> {
        let cone = match *self {
            Side::Plane { p, n } => ((x - p).dot(n) < 0.0).then_some(Cone { axis: n, s: eta, both: false })?,
            Side::Sphere { center, radius, dense_inside } => {
                let away = x - center;
                let rho = away.length();
                if (rho < radius) != dense_inside || rho == 0.0 {
                    return None;
                }
                let axis = if dense_inside { away / rho } else { away / -rho };
                Cone { axis, s: eta * (rho / radius), both: dense_inside }
            }
        };
        (cone.s > 1.0 && cone.scale() > 0.0).then_some(cone)
    }
}

impl Critical {
    fn new(bodies: Vec<Body>) -> Self {
        Critical { sides: bodies.iter().map(|b| b.sides.len()).sum(), bodies }
    }

    pub fn is_empty(&self) -> bool {
        self.sides == 0
    }

    /// Share of cones in the direction that follows `drawn` others, on a path that has any; 0 where there are none.
    fn share(&self, drawn: Option<u32>) -> f64 {
        match drawn {
            Some(k) if k <= LAST && !self.is_empty() => SHARE / f64::from(1u32 << k),
            _ => 0.0,
        }
    }

    /// A direction from x after `drawn` others, or `None`: then it is to be drawn as if there were no cones.
    pub fn sample(&self, x: DVec3, drawn: Option<u32>, rng: &mut Rng) -> Option<DVec3> {
        let share = self.share(drawn);
        if share == 0.0 {
            return None;
        }
        let (u, v, z, end) = (rng.uniform() / share, rng.uniform(), rng.uniform(), rng.uniform());
        let mut k = (u * self.sides as f64) as usize;
        for b in &self.bodies {
            if let Some(side) = b.sides.get(k) {
                return side.cone(b.eta, x).filter(|_| b.faces(x)).map(|c| c.sample(v, z, end));
            }
            k -= b.sides.len();
        }
        None
    }

    /// The density with which a direction from x is drawn, `own` being the one without cones.
    pub fn density(&self, x: DVec3, drawn: Option<u32>, w: DVec3, own: f64) -> f64 {
        let share = self.share(drawn);
        if share == 0.0 {
            return own;
        }
        let each = share / self.sides as f64;
        let bodies = self.bodies.iter().filter(|b| b.faces(x));
        let cones = bodies.flat_map(|b| b.sides.iter().filter_map(|side| side.cone(b.eta, x)));
        own + cones.map(|c| each * (c.density(w) - own)).sum::<f64>()
    }

    /// Of the weight `own / p` that cones, or other directions that are wanted, bring about, what roulette must not see: else it would take away the many near the critical angles that were wanted. Where cones drew
    /// the direction, it sees the density without them over that of even directions instead.
    pub fn hidden(own: f64, p: f64) -> f64 {
        let weight = (own / p).min(1.0);
        weight / (weight + (1.0 - weight) * (4.0 * PI * own).min(1.0))
    }
}

/// The planes of a shape's faces, each once, by front normals; `None` if there are too many.
fn planes(shape: &Shape) -> Option<Vec<(DVec3, DVec3)>> {
    let mut planes: Vec<(DVec3, DVec3)> = Vec::new();
    for face in 0..shape.face_count() {
        let p = shape.position(face, DVec2::new(0.25, 0.25));
        let n = shape.normal(face, p);
        if !planes.iter().any(|(q, m)| (*m - n).length() < 1e-9 && (p - *q).dot(n).abs() < 1e-9 * p.length().max(1.0)) {
            planes.push((p, n));
        }
        if planes.len() > PLANES {
            return None;
        }
    }
    Some(planes)
}

fn body(scene: &Scene, s: &Instance) -> Option<Body> {
    let (interior, exterior) = match (&scene.surfaces[s.surface as usize], &s.shape) {
        (Surface::Dielectric { interior, exterior, .. }, _) => (*interior, *exterior),
        (Surface::Conductor { two_sided, .. }, Shape::Sphere(q)) if *two_sided || !s.is_inside_out() => {
            let side = Side::Sphere { center: q.center, radius: q.radius, dense_inside: false };
            return Some(Body { sides: vec![side], eta: 1.0, is_within: false });
        }
        _ => return None,
    };
    let (dense_behind, eta) = (interior > exterior, (interior / exterior).max(exterior / interior));
    if eta == 1.0 {
        return None;
    }
    match &s.shape {
        Shape::Sphere(q) => {
            let dense_inside = dense_behind != s.is_inside_out();
            let side = Side::Sphere { center: q.center, radius: q.radius, dense_inside };
            Some(Body { sides: vec![side], eta, is_within: false })
        }
        Shape::Cylinder(_) => None,
        flat => {
            let toward = |(p, n): (DVec3, DVec3)| Side::Plane { p, n: if dense_behind { n } else { -n } };
            let sides = planes(flat)?.into_iter().map(toward).collect();
            Some(Body { sides, eta, is_within: dense_behind })
        }
    }
}

impl Scene {
    /// List the interfaces; call when shapes and surfaces are known.
    pub fn prepare_critical(&mut self) {
        self.critical = Critical::new(self.shapes.iter().filter_map(|s| body(self, s)).collect());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Purpose;

    fn critical() -> Critical {
        let sides = [
            (Side::Plane { p: DVec3::ZERO, n: DVec3::Z }, 1.5),
            (Side::Sphere { center: DVec3::new(0.2, 0.0, -1.0), radius: 2.0, dense_inside: true }, 1.01),
            (Side::Sphere { center: DVec3::new(0.0, 3.0, -1.0), radius: 1.0, dense_inside: false }, 1.3),
            (Side::Sphere { center: DVec3::new(-1.0, 0.0, -3.0), radius: 0.7, dense_inside: false }, 1.0),
        ];
        Critical::new(
            sides.map(|(s, eta)| Body { sides: vec![s], eta, is_within: matches!(s, Side::Plane { .. }) }).to_vec(),
        )
    }

    /// Directions are drawn with the density that is said: means of functions equal their integrals. False alarm: 6e-7 each (5 s.e.).
    #[test]
    fn directions_have_their_density() {
        let (c, x, n) = (critical(), DVec3::new(0.1, 0.3, -2.5), 400_000u64);
        let functions: [fn(DVec3) -> f64; 4] = [|_| 1.0, |w| w.x, |w| w.z * w.z, |w| f64::from(w.z > 0.7)];
        let exact = [1.0, 0.0, 1.0 / 3.0, 0.15];
        let mut rng = Rng::keyed(1, Purpose::Motion as u64, 0, 0);
        let mut sums = [[0.0; 2]; 4];
        for _ in 0..n {
            let own = 0.25 / PI;
            let drawn = c.sample(x, Some(0), &mut rng);
            let w = drawn.unwrap_or_else(|| warp::sphere(rng.uniform(), rng.uniform()));
            assert!((w.length() - 1.0).abs() < 1e-12);
            let weight = own / c.density(x, Some(0), w, own);
            assert!(weight > 0.0 && weight < 1.0 / (1.0 - SHARE) + 1e-9, "{weight}");
            for (s, f) in sums.iter_mut().zip(functions) {
                s[0] += weight * f(w);
                s[1] += (weight * f(w)).powi(2);
            }
        }
        for (s, e) in sums.iter().zip(exact) {
            let mean = s[0] / n as f64;
            let error = ((s[1] / n as f64 - mean * mean) / n as f64).sqrt();
            assert!((mean - e).abs() < 5.0 * error, "{mean} +- {error}, {e}");
        }
    }

    /// Without cones the score 1/q has a second moment that grows without bound; with them it is a number.
    #[test]
    fn scores_at_the_critical_angle_have_a_second_moment() {
        let cone = critical().bodies[0].sides[0].cone(1.5, -DVec3::Z).unwrap();
        let moment = |least: f64| {
            // ∫ dω f²/p q⁻² over q > least, f = 1/4π, by q: dω = 2π q dq / (s² μ).
            let (n, mut sum) = (200_000, 0.0);
            for k in 0..n {
                let q = least * (1.0 / least).powf((k as f64 + 0.5) / n as f64);
                let sin = ((1.0 - q * q) / 2.25).sqrt();
                let (w, mu) = (DVec3::new(sin, 0.0, (1.0 - sin * sin).sqrt()), (1.0 - sin * sin).sqrt());
                let own = 0.25 / PI;
                let p = own + SHARE * (cone.density(w) - own);
                sum += own * own / p / (q * q) * (2.0 * PI * q / (2.25 * mu)) * q * (1.0 / least).ln() / n as f64;
            }
            sum
        };
        // What lies below q is proportional to q; without cones each factor of ten adds as much as the one before.
        assert!((moment(1e-6) / moment(1e-3) - 1.0).abs() < 1e-2);
    }
}
