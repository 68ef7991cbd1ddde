//! Smooth balls by which lights without extent, and beams, are connected to ([`crate::transport::ball`]).

use super::{Instance, Scene};
use crate::light::LightKind;
use crate::math::DVec3;
use crate::math::ball_ways::Ball;
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
