//! Numbers: dual numbers, random streams, warps, colours, black bodies, statistics, nearest points, pencils of rays, roots. Imports glam only.

pub mod ball_tree;
pub mod ball_ways;
pub mod blackbody;
pub mod discrete;
pub mod equiangular;
pub mod erf;
pub mod fermat;
pub mod fold;
pub mod fresnel;
pub mod guide;
pub mod nearest;
pub mod pencil;
pub mod real;
pub mod rgb;
pub mod rng;
pub mod root;
pub mod stats;
pub mod warp;

pub use glam::{DAffine3, DMat2, DMat3, DMat4, DVec2, DVec3};
pub use real::{Dual, Real, V3, gradient};
pub use rgb::Rgb;
