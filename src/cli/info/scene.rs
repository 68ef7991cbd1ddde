//! Scenes: parameters and what they act on, objects, warnings.

use super::{Info, number};
use crate::cli::format;
use serde::Serialize;
use std::path::Path;
use tyndall::error::Result;
use tyndall::native::vdb::Select;
use tyndall::render::plan::Plan;
use tyndall::render::report::WarningReport;
use tyndall::scene::compile::LoadOptions;
use tyndall::scene::desc::Param;
use tyndall::scene::parts::{LightKindPart, Movable, Parts, ShapeKind, SurfacePart, VolumePart};
use tyndall::scene::{Scene, SceneDesc, arrays};
use tyndall::shape::Geometry;
use tyndall::surface::microfacet::Distribution;

#[derive(Serialize)]
pub struct SceneInfo {
    file: String,
    hash: String,
    parameters: Vec<ParamInfo>,
    arrays: Vec<ArrayInfo>,
    sensors: Vec<SensorInfo>,
    shapes: Vec<ShapeInfo>,
    surfaces: Vec<Named>,
    media: Vec<Named>,
    lights: Vec<Named>,
    max_depth: Option<u32>,
    rr_depth: u32,
    warnings: Vec<WarningReport>,
}

#[derive(Serialize)]
struct ParamInfo {
    name: String,
    /// Null where the text is no number.
    value: f64,
    text: String,
    min: Option<f64>,
    max: Option<f64>,
    step: Option<f64>,
    /// What changes with it.
    acts_on: Vec<String>,
    /// Why `grad --wrt` refuses it; null where it does not.
    refused: Option<String>,
}

/// What `--wrt` takes beside `$parameters`.
#[derive(Serialize)]
struct ArrayInfo {
    name: String,
    /// Vertices and coordinates, or active voxels and channels.
    shape: Vec<usize>,
    /// Why `grad --wrt` refuses it; null where it does not.
    refused: Option<String>,
}

#[derive(Serialize)]
struct SensorInfo {
    name: String,
    projection: &'static str,
    width: usize,
    height: usize,
    crop: [usize; 4],
    spp: u64,
    medium: Option<String>,
}

#[derive(Serialize)]
struct ShapeInfo {
    name: String,
    kind: &'static str,
    min: [f64; 3],
    max: [f64; 3],
    surface: String,
    interior: Option<String>,
    exterior: Option<String>,
    light: Option<String>,
}

#[derive(Serialize)]
struct Named {
    name: String,
    what: String,
}

impl SceneInfo {
    pub fn read(path: &Path, define: &[(String, String)]) -> Result<Self> {
        let desc = SceneDesc::load(path, define)?;
        let parts = Parts::read(&desc, &desc.values::<f64>())?;
        let mut scene = Scene::compile(&desc, &LoadOptions::default())?;
        let arrays = arrays::names(&parts).into_iter().map(|name| array(name, &desc, &parts, &mut scene));
        let arrays = arrays.collect::<Result<_>>()?;
        let medium = |i: Option<usize>| i.map(|i| parts.media[i].name.clone());
        let named = |name: &str, what: String| Named { name: name.into(), what };
        let sensor = |s: &tyndall::scene::parts::SensorPart<f64>| SensorInfo {
            name: s.name.clone(),
            projection: if s.tan_half.is_some() { "perspective" } else { "orthographic" },
            width: s.film.width,
            height: s.film.height,
            crop: s.film.crop,
            spp: s.spp,
            medium: medium(s.medium),
        };
        let shapes = parts.shapes.iter().zip(&scene.shapes).map(|(s, built)| {
            let b = built.shape.bounds();
            ShapeInfo {
                name: s.name.clone(),
                kind: shape_kind(&s.kind),
                min: b.min.to_array(),
                max: b.max.to_array(),
                surface: if s.default_surface { "default".into() } else { parts.surface_names[s.surface].clone() },
                interior: medium(s.interior),
                exterior: medium(s.exterior),
                light: s.light.map(|l| parts.lights[l].name.clone()),
            }
        });
        let i = parts.integrator;
        Ok(SceneInfo {
            file: path.display().to_string(),
            hash: format!("{:016x}", desc.hash),
            parameters: desc.params.iter().map(|p| param(p, &desc, &parts)).collect(),
            arrays,
            sensors: parts.sensors.iter().map(sensor).collect(),
            shapes: shapes.collect(),
            surfaces: parts.surfaces.iter().zip(&parts.surface_names).map(|(s, n)| named(n, surface(s))).collect(),
            media: parts.media.iter().map(|m| named(&m.name, medium_text(m))).collect(),
            lights: parts.lights.iter().map(|l| named(&l.name, light(l))).collect(),
            max_depth: (i.max_depth != u32::MAX).then_some(i.max_depth),
            rr_depth: i.rr_depth,
            warnings: scene.warnings.iter().map(Into::into).collect(),
        })
    }
}

fn array(name: String, desc: &SceneDesc, parts: &Parts<f64>, scene: &mut Scene) -> Result<ArrayInfo> {
    let shape = scene.array_shape(arrays::target(parts, &name)?);
    let own = std::slice::from_ref(&name);
    let refused = Plan::new(desc, own).and_then(|p| p.refuse()).and_then(|()| scene.open(desc, own)).err();
    Ok(ArrayInfo { shape, refused: refused.map(|e| e.to_string()), name })
}

/// Where a parameter acts: the quantities and places whose derivative is not zero, and its uses as text.
fn param(p: &Param, desc: &SceneDesc, parts: &Parts<f64>) -> ParamInfo {
    let mut acts_on = Vec::new();
    let index = desc.wrt(&p.name);
    if let Ok(dual) = index.as_ref().map_or_else(|_| Err(()), |&i| Parts::read(desc, &desc.dual(i)).map_err(|_| ())) {
        for tyndall::scene::parts::SlotPart { name: owner, quantity, values, .. } in dual.slots() {
            if values.iter().any(|x| x.d[0] != 0.0) {
                acts_on.push(format!("{owner}.{}", quantity.name()));
            }
        }
        for (what, values) in dual.movable() {
            if values.iter().any(|x| x.d[0] != 0.0) {
                acts_on.push(place(what, parts));
            }
        }
    }
    if let Some((span, what)) = &p.other_place {
        acts_on.push(format!("{what} at {span}"));
    }
    let refused = index.and_then(|_| Plan::new(desc, std::slice::from_ref(&p.name))?.refuse()).err();
    ParamInfo {
        name: p.name.clone(),
        value: p.value,
        text: p.text.clone(),
        min: p.hint.min,
        max: p.hint.max,
        step: p.hint.step,
        acts_on,
        refused: refused.map(|e| e.to_string()),
    }
}

fn place(what: Movable, parts: &Parts<f64>) -> String {
    match what {
        Movable::Shape(i) => format!("place of {}", parts.shapes[i].name),
        Movable::LightPosition(i) => format!("position of {}", parts.lights[i].name),
        Movable::LightDirection(i) => format!("direction of {}", parts.lights[i].name),
        Movable::LightProfile(i) => format!("profile of {}", parts.lights[i].name),
        Movable::Environment(i) => format!("turn of {}", parts.lights[i].name),
        Movable::Density(i) | Movable::Glow(i) | Movable::Albedo(i) => {
            format!("place of the volume in {}", parts.media[i].name)
        }
        Movable::Sensor(i) => format!("view of {}", parts.sensors[i].name),
    }
}

fn shape_kind<R>(k: &ShapeKind<R>) -> &'static str {
    match k {
        ShapeKind::Obj(_) => "obj",
        ShapeKind::Ply(_) => "ply",
        ShapeKind::LevelSet { .. } => "openvdb",
        ShapeKind::Sphere { .. } => "sphere",
        ShapeKind::Rectangle => "rectangle",
        ShapeKind::Cube => "cube",
        ShapeKind::Disk => "disk",
        ShapeKind::Cylinder { .. } => "cylinder",
    }
}

fn color(c: &[f64; 3]) -> String {
    if c[0] == c[1] && c[1] == c[2] { number(c[0]) } else { super::numbers(c) }
}

fn surface(s: &SurfacePart<f64>) -> String {
    match s {
        SurfacePart::Null => "null".into(),
        SurfacePart::Dielectric { interior, exterior } => {
            format!("dielectric, ior {} in {}", number(*interior), number(*exterior))
        }
        SurfacePart::Conductor { eta, k, two_sided } => {
            format!("conductor, eta {}, k {}{}", color(eta), color(k), if *two_sided { ", two-sided" } else { "" })
        }
        SurfacePart::Rough { distribution, alpha, smooth } => {
            let kind = if *distribution == Distribution::Ggx { "ggx" } else { "beckmann" };
            format!("rough {}, alpha {} ({kind})", surface(smooth), number(*alpha))
        }
        SurfacePart::Diffuse { reflectance, two_sided } => {
            format!("diffuse, reflectance {}{}", color(reflectance), if *two_sided { ", two-sided" } else { "" })
        }
    }
}

fn volume(v: &VolumePart<f64>) -> String {
    match v {
        VolumePart::Constant(c) => color(c),
        VolumePart::Vol { path, .. } => path.display().to_string(),
        VolumePart::Vdb { file, .. } => {
            let grid = match &file.select {
                Select::Name(name) => format!("`{name}`"),
                Select::Index(i) => format!("number {i}"),
                Select::NameIndex(name, i) => format!("`{name}` number {i}"),
            };
            format!("grid {grid} of {}{}", file.path.display(), if file.fog { ", as fog" } else { "" })
        }
    }
}

fn medium_text(m: &tyndall::scene::parts::MediumPart<f64>) -> String {
    let phase = m.g.map_or("isotropic".into(), |g| format!("hg, g {}", number(g)));
    let (density, albedo) = (volume(&m.density), volume(&m.albedo));
    let emission = m.emission.as_ref().map_or(String::new(), |e| {
        let (v, scale) = (volume(&e.volume), number(e.scale));
        match e.heat {
            None => format!(", emission {v} x {scale}"),
            Some([f, offset]) => {
                format!(", black bodies of ({v} - {}) x {} K, x {scale}", number(offset), number(f))
            }
        }
    });
    format!("sigma_t {density} x {}, albedo {albedo}, {phase}{emission}", number(m.scale))
}

fn light(l: &tyndall::scene::parts::LightPart<f64>) -> String {
    let kind = match &l.kind {
        LightKindPart::Point { .. } => "point, intensity",
        LightKindPart::Spot { .. } => "spot, intensity",
        LightKindPart::Directional { .. } => "directional, irradiance",
        LightKindPart::Beam { gaussian: true, .. } => "collimated, gaussian, irradiance",
        LightKindPart::Beam { gaussian: false, .. } => "collimated, hard, irradiance",
        LightKindPart::Area { .. } => "area, radiance",
        LightKindPart::Constant => "constant, radiance",
        LightKindPart::Envmap { path, .. } => {
            return format!("envmap {}, scale {}", path.display(), number(l.value[0]));
        }
    };
    format!("{kind} {}", color(&l.value))
}

impl Info for SceneInfo {
    fn text(&self) -> String {
        let mut text = self.file.clone();
        let mut section = |title: &str, mut rows: Vec<Vec<String>>| {
            if !rows.is_empty() {
                rows.iter_mut().for_each(|r| r[0].insert_str(0, "  "));
                text += &format!("\n{title}\n{}", format::table(&rows));
            }
        };
        section("parameters", self.parameters.iter().map(param_row).collect());
        section("arrays", self.arrays.iter().map(array_row).collect());
        section("sensors", self.sensors.iter().map(sensor_row).collect());
        section("shapes", self.shapes.iter().map(shape_row).collect());
        let named = |v: &[Named]| v.iter().map(|n| vec![n.name.clone(), n.what.clone()]).collect();
        section("surfaces", named(&self.surfaces));
        section("media", named(&self.media));
        section("lights", named(&self.lights));
        let warning = |w: &WarningReport| vec![w.place.clone(), format!("{} (hint: {})", w.what, w.hint)];
        section("warnings", self.warnings.iter().map(warning).collect());
        let depth = self.max_depth.map_or("unlimited".into(), |d| d.to_string());
        text + &format!("\nmax_depth {depth}, rr_depth {}", self.rr_depth)
    }
}

fn param_row(p: &ParamInfo) -> Vec<String> {
    let value = if p.value.is_nan() { p.text.clone() } else { number(p.value) };
    let mut hints = Vec::new();
    for (name, x) in [("min", p.min), ("max", p.max), ("step", p.step)] {
        hints.extend(x.map(|x| format!("{name} {}", number(x))));
    }
    let acts = if p.acts_on.is_empty() { "nothing".into() } else { p.acts_on.join(", ") };
    let wrt = if p.refused.is_some() { "no derivative yet" } else { "differentiable" };
    vec![p.name.clone(), value, wrt.into(), format!("acts on {acts}"), hints.join(", ")]
}

fn array_row(a: &ArrayInfo) -> Vec<String> {
    let what = if arrays::is_voxels(&a.name) { "active voxels" } else { "vertices" };
    let wrt = if a.refused.is_some() { "no derivative yet" } else { "differentiable (grad --loss, grad --adjoint)" };
    let shape: Vec<String> = a.shape.iter().map(usize::to_string).collect();
    vec![a.name.clone(), format!("{} {what}", shape.join(" x ")), wrt.into()]
}

fn sensor_row(s: &SensorInfo) -> Vec<String> {
    let [x0, y0, x1, y1] = s.crop;
    let crop = if s.crop == [0, 0, s.width, s.height] { String::new() } else { format!("crop {x0},{y0},{x1},{y1}") };
    let medium = s.medium.as_ref().map_or(String::new(), |m| format!("in {m}"));
    let size = format!("{} x {} pixels", s.width, s.height);
    vec![s.name.clone(), s.projection.into(), size, format!("{} spp", s.spp), crop, medium]
}

fn shape_row(s: &ShapeInfo) -> Vec<String> {
    let mut more = vec![format!("surface {}", s.surface)];
    for (what, name) in [("interior", &s.interior), ("exterior", &s.exterior), ("light", &s.light)] {
        more.extend(name.iter().map(|n| format!("{what} {n}")));
    }
    let bounds = format!("({}) .. ({})", super::numbers(&s.min), super::numbers(&s.max));
    vec![s.name.clone(), s.kind.into(), bounds, more.join(", ")]
}
