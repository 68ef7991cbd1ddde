//! Smooth balls by which lights without extent, and beams, are connected to ([`crate::transport::ball`]).

use super::{Instance, Scene};
use crate::light::LightKind;
use crate::math::DVec3;
use crate::math::ball_ways::{Ball, REFLECTIONS};
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

impl Scene {
    /// List them where there is any light to connect to; call when shapes, surfaces and lights are known.
    pub fn prepare_balls(&mut self) {
        let lit = self.lights.iter().any(|l| l.is_delta() || matches!(l.kind, LightKind::Beam { .. }));
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
        self.balls = self.shapes.iter().enumerate().filter(|_| lit).filter_map(ball).collect();
    }

    /// Whether all light of lights without extent, and of beams, that smooth surfaces send on is found: there is one ball, and reflections in it are few enough.
    pub fn shows_all_light_of_a_ball(&self) -> bool {
        let metal = self.balls.first().is_some_and(|b| b.ball.is_metal);
        (metal || self.settings.max_depth <= REFLECTIONS + 2) && self.shows_all_light_of_a_ball_but_reflections()
    }

    /// All but what is mirrored inside more often than it is followed.
    pub fn shows_all_light_of_a_ball_but_reflections(&self) -> bool {
        let smooth: Vec<_> = self.shapes.iter().filter(|s| self.surfaces[s.surface as usize].is_smooth()).collect();
        let [b] = &self.balls[..] else { return false };
        // Beams that begin in the ball, or beside its middle, are not parallel light from outside to all of it.
        let begins_there = |l: &crate::light::Light| match l.kind {
            LightKind::Beam { position, direction, .. } => (b.center - position).dot(direction).abs() < b.ball.radius,
            _ => false,
        };
        let surface = self.surface_of(b.shape);
        // What is inside of a hollow mirror is not connected.
        let known = match surface {
            Surface::Conductor { two_sided, .. } => !b.flipped && !two_sided,
            _ => true,
        };
        smooth.len() == 1 && known && !self.lights.iter().any(begins_there)
    }
}
