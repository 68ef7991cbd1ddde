//! Smooth balls by which lights without extent, and beams, are connected to ([`crate::transport::ball`]).

use super::beams::Step;
use super::{Instance, Scene};
use crate::light::{LightKind, Origin};
use crate::math::DVec3;
use crate::math::ball_ways::{Ball, BallWay};
use crate::shape::Shape;
use crate::surface::Surface;

/// A smooth sphere of the scene.
#[derive(Clone, Copy, Debug)]
pub struct BallOf {
    pub shape: u32,
    pub center: DVec3,
    pub ball: Ball,
    /// Its front is its inside.
    pub flipped: bool,
}

impl BallOf {
    /// Whether a beam that begins here is not parallel light from outside to all of it.
    pub fn begins_beside(&self, position: DVec3, direction: DVec3) -> bool {
        (self.center - position).dot(direction).abs() < self.ball.radius
    }

    /// How light of this origin is mirrored on its way to z, from outside to outside.
    pub fn mirrored(&self, from: Origin<f64>, z: DVec3) -> Option<BallWay> {
        let mut found = None;
        let (source, far) = self.source(from);
        self.ball.ways(source, far, z - self.center, 1, None, |way| found = Some(way));
        found
    }

    /// How near a line along w by o comes to the centre ahead of o, squared.
    pub fn nearest_squared(&self, o: DVec3, w: DVec3) -> f64 {
        let from = o - self.center;
        from.length_squared() - from.dot(w).min(0.0).powi(2)
    }

    /// A source as the ball sees it: its position, or the direction toward infinity.
    pub fn source(&self, from: Origin<f64>) -> (DVec3, bool) {
        match from {
            Origin::Position(q) => (q.value() - self.center, false),
            Origin::Infinity(w) => (-w.value(), true),
        }
    }

    /// How light that comes along w by o, outside, is mirrored by its front, and where; `None` where it misses the ball.
    pub fn mirror(&self, o: DVec3, w: DVec3) -> Option<(Step, DVec3)> {
        let from = o - self.center;
        let along = from.dot(w);
        let half = self.ball.radius.powi(2) - (from - w * along).length_squared();
        if half <= 0.0 || along >= 0.0 || from.length() <= self.ball.radius {
            return None;
        }
        let p = o - w * (along + half.sqrt());
        let n = (p - self.center) / self.ball.radius;
        let behind = (w - n * (2.0 * n.dot(w))).normalize();
        Some((Step { shape: self.shape, face: 0, p, n, before: w, behind, through: false }, p))
    }
}

impl Scene {
    /// List them where there is any light to connect to; call when shapes, surfaces and lights are known.
    pub fn prepare_balls(&mut self) {
        if self.lights.iter().any(|l| l.is_delta() || matches!(l.kind, LightKind::Beam { .. })) {
            self.balls = self.smooth_balls();
        }
    }

    /// All smooth spheres.
    pub(super) fn smooth_balls(&self) -> Vec<BallOf> {
        let ball = |(id, s): (usize, &Instance)| {
            let Shape::Sphere(q) = &s.shape else { return None };
            let flipped = s.is_inside_out();
            let (index, is_metal) = match self.surfaces[s.surface as usize] {
                Surface::Dielectric { interior, exterior, .. } if flipped => ([interior, exterior], false),
                Surface::Dielectric { interior, exterior, .. } => ([exterior, interior], false),
                Surface::Conductor { .. } => ([1.0; 2], true),
                _ => return None,
            };
            let ball = Ball { radius: q.radius, index, is_metal };
            Some(BallOf { shape: id as u32, center: q.center, ball, flipped })
        };
        self.shapes.iter().enumerate().filter_map(ball).collect()
    }
}
