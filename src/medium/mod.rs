//! Participating media.

pub mod grid;
