//! Readers of shapes, surfaces, lights and media: names, defaults and ranges as Mitsuba 3 has them.

use super::desc::{Node, suggest};
use super::parts::{
    GlowPart, LightKindPart, LightPart, MediumPart, Reader, ShapeKind, ShapePart, SurfacePart, VolumePart, label,
};
use super::volumes::VdbFile;
use crate::error::{Error, Result};
use crate::math::{DVec3, Real, V3};
use crate::native::vdb::Select;
use crate::surface::microfacet::Distribution;
use std::path::PathBuf;

const SHAPES: [&str; 8] = ["obj", "ply", "openvdb", "rectangle", "cube", "disk", "sphere", "cylinder"];
const BSDFS: [&str; 7] =
    ["diffuse", "dielectric", "roughdielectric", "conductor", "roughconductor", "null", "twosided"];
const EMITTERS: [&str; 7] = ["area", "point", "spot", "directional", "collimated", "constant", "envmap"];
const MEDIA: [&str; 2] = ["homogeneous", "heterogeneous"];
const VOLUMES: [&str; 3] = ["constvolume", "gridvolume", "openvdb"];
const PHASES: [&str; 2] = ["isotropic", "hg"];

/// Mitsuba's defaults of a dielectric.
const BK7: f64 = 1.5046;
const AIR: f64 = 1.000_277;

/// Indices of refraction that are taken for meant.
const LEAST_INDEX: f64 = 0.1;
const MOST_INDEX: f64 = 10.0;
/// The same for metals, whose k is large in the infrared.
const MOST_METAL: f64 = 1000.0;

/// Below this microfacets differ from a smooth surface by less than a milliradian's tenth.
const LEAST_ALPHA: f64 = 1e-4;

/// Indices of refraction by name, at 589 nm (usual tables; the names are Mitsuba's).
const INDICES: [(&str, f64); 16] = [
    ("vacuum", 1.0),
    ("helium", 1.000_036),
    ("hydrogen", 1.000_132),
    ("air", AIR),
    ("carbon dioxide", 1.000_45),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.472_9),
    ("benzene", 1.501),
    ("silicone oil", 1.520_45),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("bk7", BK7),
    ("diamond", 2.419),
];

/// A check of a value's range with the error at the property.
fn require(n: &Node, prop: &str, ok: bool, what: String, remedy: &str) -> Result<()> {
    if ok { Ok(()) } else { Err(n.err(prop, what, remedy)) }
}

fn needs_file(n: &Node) -> Result<PathBuf> {
    n.path("filename")?
        .ok_or_else(|| n.err("filename", "no `filename`", "add <string name=\"filename\" value=\"...\"/>"))
}

/// Which grid of an OpenVDB file: by name; by `grid_index`, its place in the file; by both, that one of its name. From 0.
fn select(v: &Node) -> Result<Select> {
    let name = v.string_opt("grid_name")?;
    let Some(index) = v.int_opt("grid_index")? else {
        return Ok(Select::Name(name.unwrap_or_else(|| "density".into())));
    };
    let index = usize::try_from(index)
        .map_err(|_| v.err("grid_index", format!("grid_index is {index}"), "grids are counted from 0"))?;
    Ok(name.map_or(Select::Index(index), |name| Select::NameIndex(name, index)))
}

/// Whether a level set is to be read as fog.
fn fog(v: &Node) -> Result<bool> {
    let way = v.string_opt("level_set")?;
    let ok = way.as_deref().is_none_or(|w| w == "fog");
    require(v, "level_set", ok, format!("level_set is `{}`", way.as_deref().unwrap_or("")), "only `fog` is available")?;
    Ok(way.is_some())
}

impl<R: Real> Reader<'_, R> {
    pub(super) fn shape(&mut self, n: &Node) -> Result<()> {
        let kind = match n.plugin.as_str() {
            "obj" => ShapeKind::Obj(needs_file(n)?),
            "ply" => ShapeKind::Ply(needs_file(n)?),
            "openvdb" => {
                let select = if n.has("grid_name") || n.has("grid_index") { select(n)? } else { Select::Index(0) };
                ShapeKind::LevelSet { path: needs_file(n)?, select, isovalue: n.fixed_float_opt("isovalue")? }
            }
            "rectangle" => ShapeKind::Rectangle,
            "cube" => ShapeKind::Cube,
            "disk" => ShapeKind::Disk,
            "sphere" => {
                ShapeKind::Sphere { center: n.point(self.env, "center", DVec3::ZERO)?, radius: self.radius(n)? }
            }
            "cylinder" => {
                let (p0, p1) = (n.point(self.env, "p0", DVec3::ZERO)?, n.point(self.env, "p1", DVec3::Z)?);
                let apart = (p1.value() - p0.value()).length() > 0.0;
                require(n, "p1", apart, "p0 and p1 are the same point".into(), "give the cylinder a length")?;
                ShapeKind::Cylinder { p0, p1, radius: self.radius(n)? }
            }
            _ => return Err(n.unknown_plugin(&SHAPES)),
        };
        let to_world = n.transform(self.env, "to_world")?;
        let interior = self.medium_child(n, "interior")?;
        let exterior = self.medium_child(n, "exterior")?;
        let bsdf = n.child("bsdf")?;
        let surface = match bsdf {
            Some(b) => self.surface(b)?,
            None => {
                // Mitsuba's default: a diffuse reflectance of one half, of a lamp none.
                let rho = if n.child("emitter")?.is_some() { 0.0 } else { 0.5 };
                self.parts.surfaces.push(SurfacePart::Diffuse { reflectance: [R::from(rho); 3], two_sided: false });
                self.parts.surface_names.push(format!("{}.default_bsdf", label(n)));
                self.parts.surfaces.len() - 1
            }
        };
        let index = self.parts.shapes.len();
        let face_normals = matches!(kind, ShapeKind::Obj(_) | ShapeKind::Ply(_)) && n.bool("face_normals", false)?;
        self.parts.shapes.push(ShapePart {
            name: label(n),
            span: n.span.clone(),
            kind,
            to_world,
            flip_normals: n.bool("flip_normals", false)?,
            face_normals,
            surface,
            default_surface: bsdf.is_none(),
            interior,
            exterior,
            light: None,
        });
        if let Some(e) = n.child("emitter")? {
            if e.plugin != "area" {
                let remedy = "an emitter inside a shape is `area`; put the others at the top level";
                return Err(Error::scene(&e.span, format!("emitter `{}` inside a shape", e.plugin), remedy));
            }
            self.emitter(e, Some(index))?;
            self.parts.shapes[index].light = Some(self.parts.lights.len() - 1);
        }
        Ok(())
    }

    fn radius(&self, n: &Node) -> Result<R> {
        let radius: R = n.float(self.env, "radius", 1.0)?;
        let value = radius.value();
        require(n, "radius", value > 0.0, format!("radius is {value}"), "use a radius > 0")?;
        Ok(radius)
    }

    pub(super) fn bsdf(&mut self, n: &Node, two_sided: bool) -> Result<SurfacePart<R>> {
        match n.plugin.as_str() {
            "diffuse" => {
                if let Some(t) = n.named("reflectance")? {
                    let what = format!("a {} as reflectance is not available yet", t.title());
                    return Err(Error::scene(&t.span, what, "use <rgb name=\"reflectance\" value=\"...\"/>"));
                }
                let reflectance: [R; 3] = n.rgb(self.env, "reflectance", 0.5)?;
                let ok = reflectance.iter().all(|x| (0.0..=1.0).contains(&x.value()));
                let text = format!("reflectance is {:?}", reflectance.map(R::value));
                require(n, "reflectance", ok, text, "a reflectance lies between 0 and 1")?;
                Ok(SurfacePart::Diffuse { reflectance, two_sided })
            }
            "dielectric" | "roughdielectric" if two_sided => Err(Error::scene(
                &n.span,
                format!("a twosided {} makes no sense: both its sides refract", n.plugin),
                "use the dielectric by itself",
            )),
            "dielectric" => self.dielectric(n),
            "conductor" => self.conductor(n, two_sided),
            "roughdielectric" => {
                let smooth = self.dielectric(n)?;
                self.rough(n, smooth)
            }
            "roughconductor" => {
                let smooth = self.conductor(n, two_sided)?;
                self.rough(n, smooth)
            }
            "null" if two_sided => {
                Err(Error::scene(&n.span, "a twosided null makes no sense", "use the null bsdf by itself"))
            }
            "null" => Ok(SurfacePart::Null),
            "twosided" if !two_sided => {
                let inner: Vec<&Node> = n.children("bsdf").collect();
                match inner[..] {
                    [b] => self.bsdf(b, true),
                    _ => Err(Error::scene(
                        &n.span,
                        format!("twosided has {} nested bsdfs", inner.len()),
                        "nest exactly one (two different sides are not available yet)",
                    )),
                }
            }
            "thindielectric" => {
                let remedy = "model the pane as it is: a flat cube of `dielectric` (or `null`, if it hardly matters)";
                Err(Error::scene(&n.span, "the bsdf `thindielectric` is not available", remedy))
            }
            _ => Err(n.unknown_plugin(&BSDFS)),
        }
    }

    /// An index of refraction: a number, or a material's name.
    fn index(&self, n: &Node, name: &str, default: f64) -> Result<R> {
        if n.kind_of(name) == Some("string") {
            let what = n.string(name, "")?;
            return match INDICES.iter().find(|i| i.0 == what) {
                Some(i) => Ok(R::from(i.1)),
                None => {
                    let names = INDICES.map(|i| i.0);
                    Err(n.err(name, format!("`{what}` is no material that is known here"), suggest(&what, names)))
                }
            };
        }
        let ior: R = n.float(self.env, name, default)?;
        let value = ior.value();
        let text = format!("{name} is {value:?}");
        let ok = (LEAST_INDEX..=MOST_INDEX).contains(&value);
        let remedy = format!(
            "no material has an index of refraction outside {LEAST_INDEX} to {MOST_INDEX}: air has 1, water 1.33, diamond 2.4"
        );
        require(n, name, ok, text, &remedy)?;
        Ok(ior)
    }

    fn dielectric(&self, n: &Node) -> Result<SurfacePart<R>> {
        let (interior, exterior) = (self.index(n, "int_ior", BK7)?, self.index(n, "ext_ior", AIR)?);
        Ok(SurfacePart::Dielectric { interior, exterior })
    }

    /// The same with microfacets.
    fn rough(&self, n: &Node, smooth: SurfacePart<R>) -> Result<SurfacePart<R>> {
        let alpha: R = n.float(self.env, "alpha", 0.1)?;
        let value = alpha.value();
        let remedy = format!("use an alpha of {LEAST_ALPHA} or more; below, `{}`", n.plugin.replace("rough", ""));
        require(n, "alpha", value >= LEAST_ALPHA, format!("alpha is {value}"), &remedy)?;
        let name = n.string("distribution", "beckmann")?;
        let distribution = match name.as_str() {
            "beckmann" => Distribution::Beckmann,
            "ggx" => Distribution::Ggx,
            _ => {
                let what = format!("distribution is `{name}`");
                return Err(n.err("distribution", what, suggest(&name, ["beckmann", "ggx"])));
            }
        };
        // Always so here; the picture is the same.
        n.bool("sample_visible", true)?;
        Ok(SurfacePart::Rough { distribution, alpha, smooth: Box::new(smooth) })
    }

    fn conductor(&self, n: &Node, two_sided: bool) -> Result<SurfacePart<R>> {
        let material = n.string("material", "none")?;
        if material != "none" {
            let remedy = "give eta and k as <rgb>, or material none for a mirror";
            return Err(n.err("material", format!("material `{material}`: no table of metals is available"), remedy));
        }
        // An index of 0: a mirror.
        let (eta, k): ([R; 3], [R; 3]) = (n.rgb(self.env, "eta", 0.0)?, n.rgb(self.env, "k", 1.0)?);
        for (name, x) in [("eta", &eta), ("k", &k)] {
            let ok = x.iter().all(|x| (0.0..=MOST_METAL).contains(&x.value()));
            let remedy = format!(
                "the index of a metal lies between 0 and {MOST_METAL}: gold has an eta of 0.1 to 1.5, a k of 2 to 4"
            );
            require(n, name, ok, format!("{name} is {:?}", x.map(R::value)), &remedy)?;
        }
        Ok(SurfacePart::Conductor { eta, k, two_sided })
    }

    /// `shape`: the index of the shape that an area emitter is nested in.
    pub(super) fn emitter(&mut self, n: &Node, shape: Option<usize>) -> Result<()> {
        let env = self.env;
        let (kind, value, name) = match n.plugin.as_str() {
            "area" => {
                let Some(shape) = shape else {
                    return Err(Error::scene(&n.span, "an area emitter outside a shape", "nest it in its <shape>"));
                };
                (LightKindPart::Area { shape }, n.rgb(env, "radiance", 1.0)?, "radiance")
            }
            "point" => {
                let position = match n.has("position") {
                    true => n.point(env, "position", DVec3::ZERO)?,
                    false => n.transform(env, "to_world")?.column(3),
                };
                (LightKindPart::Point { position }, n.rgb(env, "intensity", 1.0)?, "intensity")
            }
            "spot" => {
                let cutoff: R = n.float(env, "cutoff_angle", 20.0)?;
                let beam = match n.float_opt(env, "beam_width")? {
                    Some(b) => b,
                    None => cutoff * 0.75,
                };
                let (c, b) = (cutoff.value(), beam.value());
                require(
                    n,
                    "cutoff_angle",
                    c > 0.0 && c < 180.0,
                    format!("cutoff_angle is {c}"),
                    "use 0 < angle < 180",
                )?;
                let text = format!("beam_width is {b}, cutoff_angle {c}");
                require(
                    n,
                    "beam_width",
                    b >= 0.0 && b <= c,
                    text,
                    "use 0 <= beam_width <= cutoff_angle; equal: a hard edge",
                )?;
                let to_world = n.transform(env, "to_world")?;
                let kind = LightKindPart::Spot { to_world, beam: beam.to_radians(), cutoff: cutoff.to_radians() };
                (kind, n.rgb(env, "intensity", 1.0)?, "intensity")
            }
            "directional" => {
                let d = match n.has("direction") {
                    true => n.vector(env, "direction", DVec3::Z)?,
                    false => n.transform(env, "to_world")?.vector(V3::constant(DVec3::Z)),
                };
                let length = d.value().length();
                require(n, "direction", length > 0.0, "direction is zero".into(), "give a vector of some length")?;
                (LightKindPart::Directional { direction: d.normalize() }, n.rgb(env, "irradiance", 1.0)?, "irradiance")
            }
            "collimated" => {
                let radius: R = n.float(env, "radius", 1.0)?;
                let r = radius.value();
                require(n, "radius", r > 0.0, format!("radius is {r}"), "a beam has some width")?;
                let profile = n.string("profile", "hard")?;
                let known = ["hard", "gaussian"].contains(&profile.as_str());
                require(n, "profile", known, format!("profile is `{profile}`"), "use hard or gaussian")?;
                let to_world = n.transform(env, "to_world")?;
                let length = to_world.vector(V3::constant(DVec3::Z)).value().length();
                require(n, "to_world", length > 0.0, "to_world has no axis".into(), "it must not flatten z")?;
                let kind = LightKindPart::Beam { to_world, radius, gaussian: profile == "gaussian" };
                (kind, n.rgb(env, "irradiance", 1.0)?, "irradiance")
            }
            "constant" => (LightKindPart::Constant, n.rgb(env, "radiance", 1.0)?, "radiance"),
            "envmap" => {
                let to_world = n.transform(env, "to_world")?;
                let scale: R = n.float(env, "scale", 1.0)?;
                (LightKindPart::Envmap { path: needs_file(n)?, to_world }, [scale; 3], "scale")
            }
            _ => return Err(n.unknown_plugin(&EMITTERS)),
        };
        let ok = value.iter().all(|x| x.value() >= 0.0);
        let text = format!("{name} is {:?}", value.map(R::value));
        require(n, name, ok, text, "light is not negative")?;
        let medium = match n.child("medium")? {
            Some(m) => Some(self.medium(m)?),
            None => None,
        };
        self.parts.lights.push(LightPart { name: label(n), span: n.span.clone(), kind, value, medium });
        Ok(())
    }

    pub(super) fn medium_part(&mut self, n: &Node) -> Result<MediumPart<R>> {
        if !MEDIA.contains(&n.plugin.as_str()) {
            return Err(n.unknown_plugin(&MEDIA));
        }
        let density = self.volume(n, "sigma_t", 1.0)?;
        let albedo = self.volume(n, "albedo", 0.75)?;
        let scale: R = n.float(self.env, "scale", 1.0)?;
        let s = scale.value();
        require(n, "scale", s >= 0.0, format!("scale is {s}"), "extinction is not negative")?;
        if let VolumePart::Constant(c) = &density {
            let ok = c.iter().all(|x| x.value() >= 0.0);
            let text = format!("sigma_t is {:?}", c.map(R::value));
            require(n, "sigma_t", ok, text, "extinction is not negative")?;
        }
        if let VolumePart::Constant(c) = &albedo {
            let ok = c.iter().all(|x| (0.0..=1.0).contains(&x.value()));
            let text = format!("albedo is {:?}", c.map(R::value));
            require(n, "albedo", ok, text, "an albedo lies between 0 and 1")?;
        }
        if n.plugin == "homogeneous" && (density.to_world().is_some() || albedo.to_world().is_some()) {
            let remedy = "use <medium type=\"heterogeneous\">";
            return Err(Error::scene(&n.span, "a homogeneous medium with a grid volume", remedy));
        }
        let g = match n.child("phase")? {
            None => None,
            Some(p) => match p.plugin.as_str() {
                "isotropic" => None,
                "hg" => {
                    let g: R = p.float(self.env, "g", 0.8)?;
                    let v = g.value();
                    let text = format!("g is {v}");
                    require(p, "g", v > -1.0 && v < 1.0, text, "the mean cosine lies between -1 and 1, ends excluded")?;
                    Some(g)
                }
                _ => return Err(p.unknown_plugin(&PHASES)),
            },
        };
        let emission = self.glow(n)?;
        Ok(MediumPart { name: label(n), span: n.span.clone(), density, albedo, emission, scale, g })
    }

    /// `emission` (radiance) or `temperature` (black bodies), and their numbers.
    fn glow(&mut self, n: &Node) -> Result<Option<GlowPart<R>>> {
        let name = match (n.has("emission"), n.has("temperature")) {
            (false, false) => return Ok(None),
            (true, false) => "emission",
            (false, true) => "temperature",
            (true, true) => {
                let what = "a medium with both emission and temperature";
                return Err(n.err("temperature", what, "give one of them: temperature is emission by black bodies"));
            }
        };
        let volume = self.volume(n, name, 0.0)?;
        if let VolumePart::Constant(c) = &volume {
            let ok = c.iter().all(|x| x.value() >= 0.0);
            let remedy = if name == "emission" { "light is not negative" } else { "temperatures are not negative" };
            require(n, name, ok, format!("{name} is {:?}", c.map(R::value)), remedy)?;
        }
        let scale: R = n.float(self.env, "emission_scale", 1.0)?;
        let s = scale.value();
        require(n, "emission_scale", s >= 0.0, format!("emission_scale is {s}"), "light is not negative")?;
        if name == "emission" {
            return Ok(Some(GlowPart { volume, scale, heat: None }));
        }
        let one = match n.named(name)? {
            Some(v) => v.plugin != "constvolume" || v.kind_of("value") != Some("rgb"),
            None => n.kind_of(name) != Some("rgb"),
        };
        require(n, name, one, "a temperature of three colours".into(), "give one number, in a <float>")?;
        let factor: R = n.float(self.env, "temperature_scale", 1.0)?;
        let f = factor.value();
        let what = format!("temperature_scale is {f}");
        require(n, "temperature_scale", f >= 0.0, what, "use a scale >= 0: it takes the volume's numbers to kelvin")?;
        let offset = n.float(self.env, "temperature_offset", 0.0)?;
        Ok(Some(GlowPart { volume, scale, heat: Some([factor, offset]) }))
    }

    /// A number, a colour or a nested `<volume>`.
    fn volume(&mut self, n: &Node, name: &str, default: f64) -> Result<VolumePart<R>> {
        let Some(v) = n.named(name)? else {
            return Ok(VolumePart::Constant(n.rgb(self.env, name, default)?));
        };
        if v.tag != "volume" {
            return Err(n.err(name, format!("`{name}` is a <{}>", v.tag), "nest a <volume> here"));
        }
        match v.plugin.as_str() {
            "constvolume" => Ok(VolumePart::Constant(v.rgb(self.env, "value", 1.0)?)),
            "gridvolume" => {
                let filter = v.string("filter_type", "trilinear")?;
                let wrap = v.string("wrap_mode", "clamp")?;
                let smooth = filter == "trilinear";
                require(
                    v,
                    "filter_type",
                    smooth || filter == "nearest",
                    format!("filter_type is `{filter}`"),
                    "use trilinear or nearest",
                )?;
                require(v, "wrap_mode", wrap == "clamp", format!("wrap_mode `{wrap}`"), "only clamp is available")?;
                // `raw` says that values are not colours: they never are here.
                v.bool("raw", true)?;
                v.bool("accel", true)?;
                let path = needs_file(v)?;
                let mut to_world = v.transform(self.env, "to_world")?;
                if v.bool("use_grid_bbox", false)? {
                    let place = crate::medium::grid::vol::Vol::read_bbox(&path).map_err(|e| {
                        v.err("filename", e.to_string(), "give a Mitsuba .vol file (version 3, float32)")
                    })?;
                    let size = V3::constant(place.transform_vector3(DVec3::ONE));
                    let low = V3::constant(place.translation);
                    to_world = to_world * super::transform::translate(low) * super::transform::scale(size);
                }
                Ok(VolumePart::Vol { path, to_world, span: v.span_of("filename"), smooth })
            }
            "openvdb" => {
                let file = VdbFile { path: needs_file(v)?, select: select(v)?, fog: fog(v)? };
                Ok(VolumePart::Vdb { file, to_world: v.transform(self.env, "to_world")?, span: v.span_of("filename") })
            }
            _ => Err(v.unknown_plugin(&VOLUMES)),
        }
    }
}
