//! Numbers to files: the film and its health, EXR, previews, plots and the report.

pub mod exr;
pub mod film;
pub mod film_state;
mod font;
pub mod health;
pub mod image_io;
pub mod output;
pub mod plot;
pub mod png;
pub mod report;
