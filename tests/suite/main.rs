//! One program for all tests but those of the native libraries: what they share is compiled once, and slow ones run beside each other.

mod common;
mod fog;

mod analytic;
mod bad_scenes;
mod borders;
mod check;
mod chunks;
mod cli;
mod converge;
mod cylinder;
mod dielectric;
mod duality;
mod fit;
mod fit_voxels;
mod floors;
mod geometry;
mod light_motion;
mod light_shadow;
mod motion_fields;
mod moving_media;
mod moving_media_differences;
mod moving_surfaces;
mod per_vertex;
mod plan;
mod refraction;
mod rooms;
mod scenes;
mod stress;
mod techniques;
mod temperature;
mod vdb;
mod vertices;
mod vertices_cli;
mod voxels;
mod voxels_cli;
