//! Pencils: rays that leave a ball along the directions of a cone. They bound where light goes that a small face sends on, without a formula for it.
//!
//! The ray from y along w meets the ball of radius ρ about x for some y of the ball of radius r about c exactly if x - c is within `asin((r + ρ)/|x - c|)` of w, or |x - c| <= r + ρ.

use super::DVec3;
use super::ball_tree::Ball;
use std::f64::consts::{FRAC_PI_2, PI};

/// Of angles and of lengths, for rounding.
const SLACK: f64 = 1e-9;

/// Directions within an angle of an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    pub axis: DVec3,
    /// In [0, π].
    pub angle: f64,
}

impl Cone {
    pub const ALL: Cone = Cone { axis: DVec3::Z, angle: PI };

    /// Whether any of its directions is within an angle of `w`, but for rounding.
    pub fn turns_to(&self, w: DVec3, within: f64) -> bool {
        between(self.axis, w) <= self.angle + within + SLACK
    }

    /// Whether all are farther than an angle from `w`.
    pub fn turns_from(&self, w: DVec3, within: f64) -> bool {
        between(self.axis, w) - self.angle > within + SLACK
    }

    /// A cone that holds these directions, and is convex; else all.
    pub fn around(directions: impl Iterator<Item = DVec3> + Clone) -> Cone {
        let Some(axis) = directions.clone().sum::<DVec3>().try_normalize() else { return Cone::ALL };
        let angle = directions.map(|w| between(axis, w)).fold(0.0, f64::max);
        if angle < FRAC_PI_2 - SLACK { Cone { axis, angle } } else { Cone::ALL }
    }

    /// What a mirror of this normal makes of it.
    pub fn mirrored(&self, n: DVec3) -> Cone {
        Cone { axis: self.axis - n * (2.0 * n.dot(self.axis)), ..*self }
    }

    /// What a plane makes of those of its directions that it lets through; `across`: its unit normal, along the light; `ratio`: the index before it over that behind it. `None` where it lets none through.
    ///
    /// The angles of incidence are an interval, and so are those of refraction; azimuths about the normal are kept, within asin(sin angle/sin θ) of the axis' own. The cone holds the corners of that box.
    pub fn refracted(&self, across: DVec3, ratio: f64) -> Option<Cone> {
        let theta = between(self.axis, across);
        let critical = if ratio > 1.0 { (1.0 / ratio).asin() } else { FRAC_PI_2 };
        let (lo, hi) = ((theta - self.angle).max(0.0), (theta + self.angle).min(critical));
        if lo > critical + SLACK {
            return None;
        }
        let bent = |t: f64| (ratio * t.sin()).clamp(-1.0, 1.0).asin();
        let (near, far) = (bent(lo.min(critical)), bent(hi));
        let all = Cone { axis: across, angle: far };
        let azimuth = if self.angle < theta { (self.angle.sin() / theta.sin()).clamp(0.0, 1.0).asin() } else { PI };
        if azimuth >= FRAC_PI_2 || theta + self.angle > PI {
            return Some(all);
        }
        let Some(side) = (self.axis - across * across.dot(self.axis)).try_normalize() else { return Some(all) };
        let middle = if theta < critical { bent(theta) } else { 0.5 * (near + far) };
        let axis = across * middle.cos() + side * middle.sin();
        let third = side.cross(across);
        let corner = |t: f64| across * t.cos() + (side * azimuth.cos() + third * azimuth.sin()) * t.sin();
        let angle = between(axis, corner(near)).max(between(axis, corner(far)));
        // Toward the normal directions come nearer to each other, and to where the axis goes if it goes through, by the ratio at least.
        let angle = angle.min(if ratio <= 1.0 && theta < critical { self.angle * ratio } else { PI });
        Some(if angle < far { Cone { axis, angle } } else { all })
    }
}

/// The angle between two unit vectors.
fn between(a: DVec3, b: DVec3) -> f64 {
    // As exact for small angles as for others.
    2.0 * (a - b).length().atan2((a + b).length())
}

/// Rays from a ball, along a cone.
#[derive(Clone, Copy, Debug)]
pub struct Pencil {
    pub center: DVec3,
    pub radius: f64,
    pub cone: Cone,
    /// Of the cone's angle.
    sin_cos: (f64, f64),
}

impl Pencil {
    pub fn new(center: DVec3, radius: f64, cone: Cone) -> Self {
        Pencil { center, radius, cone, sin_cos: cone.angle.sin_cos() }
    }

    /// One that holds all rays of some.
    pub fn around(some: impl Iterator<Item = Pencil> + Clone) -> Self {
        let ball = Ball::around(some.clone().map(|p| Ball { center: p.center, radius: p.radius }));
        let cone = match some.clone().map(|p| p.cone.axis).sum::<DVec3>().try_normalize() {
            Some(axis) => {
                let angle = some.map(|p| between(axis, p.cone.axis) + p.cone.angle).fold(0.0, f64::max);
                Cone { axis, angle: (angle + SLACK).min(PI) }
            }
            None => Cone::ALL,
        };
        Pencil::new(ball.center, ball.radius, cone)
    }

    /// Whether any of its rays may meet a ball.
    pub fn reaches(&self, center: DVec3, radius: f64) -> bool {
        let (v, r) = (center - self.center, (self.radius + radius) * (1.0 + SLACK));
        let (d2, (sin, cos)) = (v.length_squared(), self.sin_cos);
        // The cosine of both angles together, times the distance, where they are less than π.
        let past_pi = || cos < 0.0 && sin * sin * d2 <= r * r;
        d2 <= r * r || v.dot(self.cone.axis) >= cos * (d2 - r * r).sqrt() - sin * r - SLACK * d2.sqrt() || past_pi()
    }

    /// What is left of its directions where it meets a ball.
    pub fn toward(&self, center: DVec3, radius: f64) -> Cone {
        let (v, r) = (center - self.center, self.radius + radius);
        let d = v.length();
        let angle = if d > r { (r / d).asin() } else { PI };
        if angle < self.cone.angle { Cone { axis: v / d, angle } } else { self.cone }
    }

    /// About how much of a ball of this radius around it it goes through.
    pub fn share(&self, size: f64) -> f64 {
        let spread = if self.cone.angle < FRAC_PI_2 { self.cone.angle.sin() } else { 1.0 };
        (self.radius / size + spread).powi(2).min(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::V3;
    use crate::math::fresnel::Interface;
    use crate::math::rng::{Purpose, Rng};
    use crate::math::warp::{self, frame};

    fn draws(seed: u64) -> Rng {
        Rng::keyed(seed, Purpose::Motion as u64, 0, 0)
    }

    fn within(c: &Cone, rng: &mut Rng) -> DVec3 {
        let (a, b) = frame(c.axis);
        let cos = 1.0 - rng.uniform() * (1.0 - c.angle.cos());
        let (phi, sin) = (2.0 * PI * rng.uniform(), (1.0 - cos * cos).sqrt());
        c.axis * cos + (a * phi.cos() + b * phi.sin()) * sin
    }

    /// No refracted or mirrored direction is lost, at any incidence, index and width; narrow cones stay narrow.
    #[test]
    fn cones_hold_what_interfaces_make_of_them() {
        let mut rng = draws(5);
        let (mut passed, mut tight) = (0, 0.0);
        for k in 0..20_000 {
            let unit = |rng: &mut Rng| warp::sphere(rng.uniform(), rng.uniform());
            let (n, axis) = (unit(&mut rng), unit(&mut rng));
            let angle = 10f64.powf(-4.0 * rng.uniform());
            // Axes near the plane, and indices near each other, more often.
            let axis = if k % 2 == 0 {
                axis
            } else {
                (axis - n * n.dot(axis) - n * (2.0 * rng.uniform() - 1.0).abs() * angle).normalize()
            };
            let c = Cone { axis, angle };
            let ratio = (1.4 * (rng.uniform() - 0.5)).exp().powf(if k % 3 == 0 { 0.1 } else { 1.0 });
            let (through, mirror) = (c.refracted(n, ratio), c.mirrored(n));
            let mut widest = 0f64;
            for _ in 0..16 {
                let w = within(&c, &mut rng);
                let m = w - n * (2.0 * n.dot(w));
                assert!(mirror.turns_to(m, 1e-7));
                if w.dot(n) <= 0.0 {
                    continue;
                }
                let i = Interface::new(w.dot(n), ratio, 1.0);
                let Some(t) = i.refract(V3::constant(w), V3::constant(-n)) else { continue };
                let t = t.value().normalize();
                let Some(cone) = through else { panic!("{c:?} {n} {ratio} lets nothing through") };
                assert!(cone.turns_to(t, 1e-7), "{c:?} {n} {ratio}: {t} not in {cone:?}");
                widest = widest.max(between(cone.axis, t));
                passed += 1;
            }
            if let Some(cone) = through.filter(|_| widest > 0.0) {
                tight += (cone.angle / widest).ln() / 20_000.0;
            }
        }
        assert!(passed > 50_000 && tight < 0.6, "{passed} {tight}");
    }

    /// A ball that any of its rays meets is reached; not many are that none of some hundred rays meets.
    #[test]
    fn pencils_reach_what_their_rays_meet() {
        let mut rng = draws(6);
        let (mut met, mut reached) = (0, 0);
        for _ in 0..4000 {
            let unit = |rng: &mut Rng| warp::sphere(rng.uniform(), rng.uniform());
            let p = Pencil::new(
                DVec3::ONE,
                0.3 * rng.uniform(),
                Cone { axis: unit(&mut rng), angle: PI * rng.uniform().powi(3) },
            );
            let (x, r) = (DVec3::ONE + unit(&mut rng) * 2.0 * rng.uniform(), 0.2 * rng.uniform());
            let meets = (0..300).any(|_| {
                let y = p.center + unit(&mut rng) * p.radius * rng.uniform().cbrt();
                let w = within(&p.cone, &mut rng);
                let t = (x - y).dot(w).max(0.0);
                (y + w * t - x).length() <= r
            });
            assert!(!meets || p.reaches(x, r), "{p:?} {x} {r}");
            (met, reached) = (met + u32::from(meets), reached + u32::from(p.reaches(x, r)));
        }
        assert!(met > 400 && reached < 2 * met, "{met} {reached}");
    }
}
