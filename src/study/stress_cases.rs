//! Which case is run by what. A case that is not listed here is `not-yet`.

use super::stress::Bench;
use super::slab;
use crate::error::Result;

pub type Runner = fn(&mut Bench) -> Result<()>;

pub fn runner(name: &str) -> Option<Runner> {
    Some(match name {
        "vacuum-derivative" => slab::vacuum,
        "black-1e5" => slab::black,
        "white-furnace" => slab::white_furnace,
        "scale-invariance" => slab::scaled,
        "translation-invariance" => slab::translated,
        "camera-on-boundary" => slab::camera_on_boundary,
        "radiance-range" => slab::radiance_range,
        _ if slab::is_table_case(name) => slab::table_case,
        _ => return None,
    })
}
