//! Which case is run by what. A case that is not listed here is `not-yet`.

use super::stress::Bench;
use super::{airlight, closed, grids, policy, slab, units};
use crate::error::Result;

pub type Runner = fn(&mut Bench) -> Result<()>;

pub fn runner(name: &str) -> Option<Runner> {
    Some(match name {
        "vacuum-derivative" => slab::vacuum,
        "black-1e5" => slab::black,
        "white-furnace" => slab::white_furnace,
        "white-furnace-glass" => slab::white_furnace_glass,
        "scale-invariance" => slab::scaled,
        "translation-invariance" => slab::translated,
        "camera-on-boundary" => slab::camera_on_boundary,
        "radiance-range" => slab::radiance_range,
        "light-on-ray" => airlight::light_on_ray,
        "grid-equals-homogeneous" => grids::equals_homogeneous,
        "grid-all-zero" => grids::all_zero,
        "grid-hot-voxel" => grids::hot,
        "grid-invalid-voxels" => grids::invalid_voxels,
        "g-endpoints" => policy::g_endpoints,
        "invalid-input" => policy::invalid_input,
        "nan-policy" => policy::nan_policy,
        "thread-determinism" => policy::thread_determinism,
        "degenerate-geometry" => policy::degenerate,
        "rng-endpoints" => units::rng_endpoints,
        "film-accumulation" => units::film_accumulation,
        "emissive-slab" => closed::emissive_slab,
        "airlight-table" => airlight::all_rows,
        _ if name.starts_with("airlight-") => airlight::case,
        _ if name.starts_with("shadow-edge-") => airlight::shadow_edge,
        _ if name.starts_with("point-irradiance-") => airlight::point_irradiance,
        _ if name.starts_with("emissive-sphere-") => closed::emissive_sphere,
        _ if name.starts_with("dielectric-") => closed::dielectric,
        _ if name.starts_with("T-") => grids::transmittance,
        _ if slab::is_table_case(name) => slab::table_case,
        _ => return None,
    })
}
