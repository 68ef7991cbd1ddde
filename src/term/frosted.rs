//! Directions from a point toward where the camera sees it by rough glass.
//!
//! A lobe of rough glass is as narrow as `α |n₁-n₂|`: what goes on from a point by any other density finds it seldom, and is loud where it does. The way that a smooth interface
//! would send the light (Snell's law in the tangent plane where the line to the camera meets the glass, [T] (44)) is the lobe's middle, and how far the generalised half vector
//! `n₀ w₀ + n₁ w₁` turns, as the glass is met elsewhere, its width: by δ (n₀/d₀ + n₁/d₁) across, d being the distances of camera and point. Rooms draw some of their
//! directions beside that way, with densities that are functions of the point alone, so that they are weighed like any others.

use super::Context;
use super::sheet::Grazed;
use crate::math::{DVec2, DVec3, warp};
use crate::scene::Scene;
use crate::sensor::Projection;
use crate::shape::{Geometry, Shape};
use crate::surface::Surface;
use crate::surface::rough::{Matter, Rough};
use crate::transport::pane;
use std::f64::consts::{PI, TAU};

/// Share of directions that are drawn so, where there is such a way.
pub const SHARE: f64 = 0.5;
/// Short of the point itself, as a share of the way to it.
const SHORT: f64 = 1e-6;
/// Of widths, angles.
const LEAST: f64 = 1e-6;
/// Widths of the density over that of the lobe.
const WIDER: f64 = 1.5;

/// The direction from a point toward the camera by rough glass, and how wide the glass makes it.
#[derive(Clone, Copy, Debug)]
pub struct Frosted {
    /// Unit, away from the point.
    pub w: DVec3,
    /// An angle: of what is drawn, somewhat wider than the lobe.
    pub width: f64,
    /// The apparent distance of the camera along it.
    pub distance: f64,
}

/// All rough glass.
pub fn list(scene: &Scene) -> Vec<u32> {
    (0..scene.shapes.len() as u32).filter(|&id| glass(scene, id).is_some()).collect()
}

/// The surface of a shape of rough glass, and its indices behind the front side and before it.
fn glass(scene: &Scene, shape: u32) -> Option<(&Rough, [f64; 2])> {
    match scene.surface_of(shape) {
        Surface::Rough(rough) => match rough.matter {
            Matter::Dielectric { interior, exterior } => Some((rough, [interior, exterior])),
            Matter::Conductor { .. } => None,
        },
        _ => None,
    }
}

impl Frosted {
    /// From p, which may be on anything but the glass: by what the line to the camera meets first, or by flat glass that it does not meet. `None` where there is no such way, or where the glass
    /// itself stands on it, as the far side of a lens does; what p is on, `past`, does not count.
    pub fn of(cx: &Context, p: DVec3, past: Grazed) -> Option<Frosted> {
        if cx.frosted.is_empty() {
            return None;
        }
        let scene = cx.scene;
        let q = cx.sensor.project(p)?;
        let straight = scene.opaque_past(q.o, q.w, q.distance * (1.0 - SHORT), &[]);
        if let Some(h) = straight.filter(|h| glass(scene, h.shape).is_some()) {
            // Other things may stand on the way: lobes see past them.
            let left = (q.distance - h.t) * (1.0 - SHORT);
            let closed = scene.shapes[h.shape as usize].shape.is_closed();
            if closed && scene.opaque_past(p, -q.w, left, past).is_some_and(|o| o.shape == h.shape) {
                return None;
            }
            return Frosted::by(cx, p, h.shape, (h.p, h.n));
        }
        cx.frosted.iter().find_map(|&id| {
            let shape = &scene.shapes[id as usize].shape;
            let flat = matches!(shape, Shape::Rectangle(_) | Shape::Disk(_));
            let plane = flat.then(|| shape.position(0, DVec2::splat(0.25)))?;
            Frosted::by(cx, p, id, (plane, shape.normal(0, plane)))
        })
    }

    /// By this glass, its tangent plane known somewhere near the way.
    fn by(cx: &Context, p: DVec3, id: u32, mut plane: (DVec3, DVec3)) -> Option<Frosted> {
        let (scene, sensor) = (cx.scene, cx.sensor);
        let (rough, [interior, exterior]) = glass(scene, id)?;
        let shape = &scene.shapes[id as usize].shape;
        // Where the tangent plane turns, it is taken once more.
        let is_flat = matches!(shape, Shape::Rectangle(_) | Shape::Disk(_) | Shape::Cube(_));
        let mut way = None;
        for _ in 0..if is_flat { 1 } else { 2 } {
            let (at, n) = plane;
            let q = sensor.project(at)?;
            let eye = match sensor.projection {
                Projection::Perspective { .. } => q.o,
                // As good as from infinity.
                Projection::Orthographic => at - q.w * (1e4 * (q.distance + (at - p).length())),
            };
            let [h0, h1] = [eye, p].map(|x| (x - at).dot(n));
            if h0 * h1 >= 0.0 {
                return None;
            }
            let [n0, n1] = if h0 > 0.0 { [exterior, interior] } else { [interior, exterior] };
            let (foot, across) = (eye - n * h0, (p - eye) - n * (h1 - h0));
            let r = across.length();
            let s = if r > 0.0 { pane::crossing(n0, h0.abs(), n1, h1.abs(), r) / r } else { 0.0 };
            let q = sensor.project(foot + across * s)?;
            let hit = scene.opaque_past(q.o, q.w, f64::INFINITY, &[]).filter(|h| h.shape == id)?;
            plane = (hit.p, hit.n);
            let (to, d0) = (hit.p - p, (hit.p - eye).length());
            let d1 = to.length();
            // On the glass itself.
            if d1 <= SHORT * d0 {
                return None;
            }
            let width = rough.alpha * (n1 - n0).abs() / (n0 * d1 / d0 + n1);
            way = Some(Frosted { w: to / d1, width: (WIDER * width).clamp(LEAST, PI), distance: d1 + d0 * n1 / n0 });
        }
        way.filter(|f| f.distance.is_finite())
    }

    /// With c = 1 - cos, `σ = width²/2`: c goes like `(1 + c/σ)^-2`, between 0 and 2.
    fn sigma(&self) -> f64 {
        0.5 * self.width * self.width
    }

    /// Density per solid angle of [`Frosted::sample`].
    pub fn density(&self, w: DVec3) -> f64 {
        let (sigma, c) = (self.sigma(), 0.5 * (w - self.w).length_squared());
        (1.0 + 0.5 * sigma) / (TAU * sigma * (1.0 + c / sigma).powi(2))
    }

    /// A unit direction beside the way.
    pub fn sample(&self, u: f64, v: f64) -> DVec3 {
        // The share within c is (1 - 1/(1 + c/σ)) over its value at 2.
        let part = u / (1.0 + 0.5 * self.sigma());
        let c = (self.sigma() * part / (1.0 - part)).min(2.0);
        let (sin, cos) = ((c * (2.0 - c)).max(0.0).sqrt(), 1.0 - c);
        let (s, q) = (TAU * v).sin_cos();
        warp::to_world(self.w, DVec3::new(sin * q, sin * s, cos)).normalize()
    }

    /// A unit normal of a ball around the point, beside the outline that the camera sees of it.
    pub fn rim(&self, r: f64, u: f64, v: f64) -> DVec3 {
        let (middle, [first, last]) = self.outline(r);
        let z = (middle + self.width * (first + u * (last - first)).tan()).clamp(-1.0, 1.0);
        let (s, q) = (TAU * v).sin_cos();
        let across = (1.0 - z * z).max(0.0).sqrt();
        warp::to_world(self.w, DVec3::new(across * q, across * s, z)).normalize()
    }

    /// Density per solid angle of [`Frosted::rim`].
    pub fn rim_density(&self, r: f64, n: DVec3) -> f64 {
        let (middle, [first, last]) = self.outline(r);
        let x = (n.dot(self.w) - middle) / self.width;
        1.0 / (TAU * self.width * (last - first) * (1.0 + x * x))
    }

    /// Cosine of the outline's normals with the way, and the range of a Cauchy distribution's angles about it that keeps cosines within -1 and 1.
    fn outline(&self, r: f64) -> (f64, [f64; 2]) {
        let middle = (r / self.distance).min(1.0);
        (middle, [((-1.0 - middle) / self.width).atan(), ((1.0 - middle) / self.width).atan()])
    }

    /// A unit direction across n (unit), beside the way as it is seen along n.
    pub fn turned_about(&self, n: DVec3, u: f64) -> DVec3 {
        let (x, y) = warp::frame(n);
        let (s, q) = (self.w.dot(y).atan2(self.w.dot(x)) + self.turn(u)).sin_cos();
        x * q + y * s
    }

    /// Density per angle of [`Frosted::turned_about`].
    pub fn density_about(&self, n: DVec3, w: DVec3) -> f64 {
        let across = self.w - n * self.w.dot(n);
        self.turn_density(w.dot(n.cross(across)).atan2(w.dot(across)))
    }

    /// Density of [`Frosted::turn`] at this angle from the way: a wrapped Cauchy distribution.
    pub fn turn_density(&self, angle: f64) -> f64 {
        // cosh - cos without loss at small angles.
        let (half, s) = ((0.5 * self.width).sinh(), (0.5 * angle).sin());
        self.width.sinh() / (TAU * 2.0 * (half * half + s * s))
    }

    /// An angle about the way in a plane, between -π and π.
    pub fn turn(&self, u: f64) -> f64 {
        2.0 * ((0.5 * self.width).tanh() * (PI * (u - 0.5)).tan()).atan()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Both densities are those of what is drawn: means of a function against its integral (5 s.e.; false alarm 6e-7 each).
    #[test]
    fn densities_are_of_what_is_drawn() {
        let n = 40_000;
        for width in [1e-3, 0.1, 1.5] {
            let f = Frosted { w: DVec3::new(0.3, -0.2, 0.9).normalize(), width, distance: 1.0 };
            let golden = |k: i32| (f64::from(k) * 0.618_033_988_749_894_9).fract();
            // E[1/p over the part within some widths] is the solid angle of that part.
            let cut = (2.0 * width).min(1.0);
            let (mut sum, mut square, mut turns, mut turned) = (0.0, 0.0, 0.0, 0.0);
            for k in 0..n {
                let (u, v) = ((f64::from(k) + 0.5) / f64::from(n), golden(k));
                let w = f.sample(u, v);
                assert!((w.length() - 1.0).abs() < 1e-12);
                let x = if w.angle_between(f.w) < cut { 1.0 / f.density(w) } else { 0.0 };
                sum += x;
                square += x * x;
                let a = f.turn(u);
                let y = if a.abs() < cut { 1.0 / f.turn_density(a) } else { 0.0 };
                turns += y;
                turned += y * y;
            }
            let n = f64::from(n);
            for (sum, square, exact) in
                [(sum, square, TAU * 2.0 * (0.5 * cut).sin().powi(2)), (turns, turned, 2.0 * cut)]
            {
                let (mean, error) = (sum / n, ((square / n - (sum / n).powi(2)) / n).sqrt());
                assert!((mean - exact).abs() < 5.0 * error + 1e-4 * exact, "{width}: {mean} for {exact}, {error}");
            }
        }
    }
}
