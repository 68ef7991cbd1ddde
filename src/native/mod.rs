//! The native libraries behind safe types: Embree says which primitive, OpenVDB says what a file holds.
//!
//! The only `unsafe` of the package. Each block says why it is sound.

#![allow(unsafe_code)]

pub mod embree;
pub mod nearest;
pub mod vdb;
mod vdb_frame;
mod vdb_surface;
