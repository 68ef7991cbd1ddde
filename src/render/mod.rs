//! Numbers to files: the film and its health, EXR, previews, plots and the report.

pub mod animation;
mod cause;
pub mod driver;
pub mod family;
pub mod film;
pub mod film_state;
pub mod filter;
mod font;
pub mod gradient;
pub mod health;
mod limb;
pub mod montage;
mod passes;
mod pilot;
pub mod plan;
pub mod plot;
pub mod png;
pub mod report;
pub mod rooms;
mod swept;
