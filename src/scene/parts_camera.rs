//! Readers of sensors and films.

use super::desc::Node;
use super::parts::{FilmPart, Filter, Reader, SensorPart, label};
use crate::error::{Error, Result};
use crate::math::Real;

const SENSORS: [&str; 2] = ["perspective", "orthographic"];
const FILTERS: [&str; 3] = ["box", "tent", "gaussian"];
const SAMPLERS: [&str; 5] = ["independent", "stratified", "multijitter", "orthogonal", "ldsampler"];

impl<R: Real> Reader<'_, R> {
    pub(super) fn sensor(&mut self, n: &Node) -> Result<SensorPart<R>> {
        if !SENSORS.contains(&n.plugin.as_str()) {
            return Err(n.unknown_plugin(&SENSORS));
        }
        let film = match n.child("film")? {
            Some(f) => film(f)?,
            None => FilmPart {
                width: 768,
                height: 576,
                crop: [0, 0, 768, 576],
                filter: Filter::Gaussian { stddev: 0.5 },
                alpha: false,
            },
        };
        let tan_half = match n.plugin.as_str() {
            "perspective" => Some(self.field_of_view(n, &film)?),
            _ => None,
        };
        let mut offset = [R::zero(); 2];
        if tan_half.is_some() {
            offset[0] = n.float(self.env, "principal_point_offset_x", 0.0)?;
            offset[1] = n.float(self.env, "principal_point_offset_y", 0.0)?;
        }
        // Clipping planes are for rasterisers; Mitsuba clips rays with them, we see everything.
        for name in ["near_clip", "far_clip"] {
            n.float_opt::<f64>(&constants(self.env), name)?;
        }
        let (mut spp, mut seed, mut even) = (16, 0, false);
        if let Some(s) = n.child("sampler")? {
            if !SAMPLERS.contains(&s.plugin.as_str()) {
                return Err(s.unknown_plugin(&SAMPLERS));
            }
            let count = s.int("sample_count", 4)?;
            if count < 1 {
                return Err(s.err("sample_count", format!("sample_count is {count}"), "use at least 1"));
            }
            spp = count as u64;
            even = s.plugin != SAMPLERS[0];
            seed = s.int("seed", 0)?.unsigned_abs();
        }
        let medium = match n.child("medium")? {
            Some(m) => Some(self.medium(m)?),
            None => None,
        };
        let to_world = n.transform(self.env, "to_world")?;
        Ok(SensorPart {
            name: label(n),
            span: n.span.clone(),
            to_world,
            tan_half,
            offset,
            film,
            spp,
            seed,
            even,
            medium,
        })
    }

    /// Tangent of half the horizontal angle, from `fov` and `fov_axis` or `focal_length`.
    fn field_of_view(&self, n: &Node, film: &FilmPart) -> Result<R> {
        let aspect = film.width as f64 / film.height as f64;
        let axis = n.string("fov_axis", "x")?;
        let fov: Option<R> = n.float_opt(self.env, "fov")?;
        let Some(fov) = fov else {
            // 35 mm film: a diagonal of 43.3 mm.
            let text = n.string("focal_length", "50mm")?;
            let mm: f64 = text.trim_end_matches("mm").trim().parse().unwrap_or(f64::NAN);
            if mm.is_nan() || mm <= 0.0 {
                return Err(n.err("focal_length", format!("focal_length is `{text}`"), "write it as \"50mm\""));
            }
            let diagonal = 0.5 * (36f64 * 36.0 + 24.0 * 24.0).sqrt() / mm;
            return Ok(R::from(diagonal * aspect / (1.0 + aspect * aspect).sqrt()));
        };
        let degrees = fov.value();
        if !(degrees > 0.0 && degrees < 180.0) {
            return Err(n.err("fov", format!("fov is {degrees}"), "use 0 < fov < 180 degrees"));
        }
        let t = (fov.to_radians() * 0.5).tan();
        let horizontal = match axis.as_str() {
            "x" => 1.0,
            "y" => aspect,
            "diagonal" => aspect / (1.0 + aspect * aspect).sqrt(),
            "smaller" => aspect.max(1.0),
            "larger" => aspect.min(1.0),
            _ => {
                let remedy = "use x, y, diagonal, smaller or larger";
                return Err(n.err("fov_axis", format!("fov_axis is `{axis}`"), remedy));
            }
        };
        Ok(t * horizontal)
    }
}

/// The same parameters as plain numbers, for properties that are not differentiated.
fn constants<R: Real>(env: &super::desc::Env<R>) -> super::desc::Env<f64> {
    super::desc::Env { values: env.values.iter().map(|v| v.value()).collect() }
}

fn film(n: &Node) -> Result<FilmPart> {
    if n.plugin != "hdrfilm" {
        return Err(n.unknown_plugin(&["hdrfilm"]));
    }
    let (width, height) = (n.int("width", 768)?, n.int("height", 576)?);
    for (name, v) in [("width", width), ("height", height)] {
        if !(1..=65536).contains(&v) {
            return Err(n.err(name, format!("{name} is {v}"), "use 1 to 65536 pixels"));
        }
    }
    let (x0, y0) = (n.int("crop_offset_x", 0)?, n.int("crop_offset_y", 0)?);
    let (w, h) = (n.int("crop_width", width - x0)?, n.int("crop_height", height - y0)?);
    if x0 < 0 || y0 < 0 || w < 1 || h < 1 || x0 + w > width || y0 + h > height {
        let what = format!("the crop {w}x{h} at {x0},{y0} does not fit into {width}x{height}");
        return Err(Error::scene(&n.span, what, "correct crop_offset_x/y and crop_width/height"));
    }
    let format = n.string("pixel_format", "rgb")?;
    if !["rgb", "rgba", "luminance", "luminance_alpha", "xyz", "xyza"].contains(&format.as_str()) {
        return Err(n.err("pixel_format", format!("pixel_format is `{format}`"), "use rgb or rgba"));
    }
    // Settings of Mitsuba's writer that have no meaning here: output is always float32 EXR.
    for name in ["file_format", "component_format"] {
        n.string(name, "")?;
    }
    for name in ["sample_border", "compensate", "banner", "high_quality_edges", "crop"] {
        n.bool(name, false)?;
    }
    let filter = match n.child("rfilter")? {
        None => Filter::Gaussian { stddev: 0.5 },
        Some(f) => {
            let env = super::desc::Env::<f64>::default();
            let positive = |name: &str, default: f64| -> Result<f64> {
                let v: f64 = f.float(&env, name, default)?;
                if v > 0.0 { Ok(v) } else { Err(f.err(name, format!("{name} is {v}"), "use a number > 0")) }
            };
            match f.plugin.as_str() {
                "box" => Filter::Box { radius: positive("radius", 0.5)? },
                "tent" => Filter::Tent { radius: positive("radius", 1.0)? },
                "gaussian" => Filter::Gaussian { stddev: positive("stddev", 0.5)? },
                _ => return Err(f.unknown_plugin(&FILTERS)),
            }
        }
    };
    let crop = [x0 as usize, y0 as usize, (x0 + w) as usize, (y0 + h) as usize];
    Ok(FilmPart { width: width as usize, height: height as usize, crop, filter, alpha: format.ends_with('a') })
}
