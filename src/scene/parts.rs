//! The parts of a scene as numbers: every plugin's properties, generic over `Real`.
//!
//! Read once with `f64` it is what `compile` builds from; read with one `$parameter` as the dual variable, the same code gives
//! the tangent of every slot ([`Parts::slots`]) and of everything that can move ([`Parts::movable`]).

use super::desc::{Env, Node, SceneDesc};
use super::transform::Mat4;
use super::volumes::VdbFile;
use crate::error::{Error, Result, Span};
use crate::math::{DMat4, DVec3, Real, V3, warp};
use crate::native::vdb::Select;
use crate::params::{Owner, Quantity};
use crate::surface::microfacet::Distribution;
use std::cmp::Ordering;
use std::collections::HashMap;
use std::path::PathBuf;

pub struct ShapePart<R> {
    pub name: String,
    pub span: Span,
    pub kind: ShapeKind<R>,
    pub to_world: Mat4<R>,
    pub flip_normals: bool,
    pub face_normals: bool,
    pub surface: usize,
    /// No `<bsdf>` was named: the default one.
    pub default_surface: bool,
    pub interior: Option<usize>,
    pub exterior: Option<usize>,
    pub light: Option<usize>,
}

pub enum ShapeKind<R> {
    Obj(PathBuf),
    Ply(PathBuf),
    /// Where an OpenVDB grid has the isovalue; without one, where a level set is 0.
    LevelSet {
        path: PathBuf,
        select: Select,
        isovalue: Option<f64>,
    },
    Sphere {
        center: V3<R>,
        radius: R,
    },
    Rectangle,
    Cube,
    Disk,
    Cylinder {
        p0: V3<R>,
        p1: V3<R>,
        radius: R,
    },
}

impl<R: Real> ShapePart<R> {
    /// The world point that its motion is told about.
    pub fn pivot(&self) -> DVec3 {
        match &self.kind {
            ShapeKind::Sphere { center, .. } => self.to_world.affine().transform_point3(center.value()),
            _ => self.placed().affine().translation,
        }
    }

    /// Where its own unit shape goes: of a cylinder the tube `x^2 + y^2 = 1`, `0 <= z <= 1`.
    ///
    /// As the ends p0, p1 of a cylinder move, the tube turns with them as little as it can and keeps its radius: an affine motion too.
    pub fn placed(&self) -> Mat4<R> {
        let ShapeKind::Cylinder { p0, p1, radius } = &self.kind else { return self.to_world };
        let along = *p1 - *p0;
        let axis = along.normalize();
        let x = V3::constant(warp::frame(axis.value()).0);
        let x = (x - axis * axis.dot(x)).normalize();
        self.to_world * Mat4::from_columns(x * *radius, axis.cross(x) * *radius, along, *p0)
    }

    /// Displacement of the pivot and linear part of the map from where the shape is to where it goes: 0 and 1, with their tangents.
    /// A sphere's turning is left out: it moves nothing.
    fn motion(&self) -> (V3<R>, Vec<R>) {
        let ShapeKind::Sphere { center, radius } = &self.kind else { return affine_motion(&self.placed()) };
        let (x, y, z) = (self.to_world.column(0), self.to_world.column(1), self.to_world.column(2));
        let volume = x.dot(y.cross(z));
        let volume = if volume.value() < 0.0 { -volume } else { volume };
        let growth = volume.powf(1.0 / 3.0) * *radius;
        let growth = growth / growth.value();
        let shift = self.to_world.point(*center) - V3::constant(self.pivot());
        (shift, (0..9).map(|k| if k % 4 == 0 { growth } else { R::zero() }).collect())
    }
}

/// The same for what has no matter of its own: `M(π) M⁻¹`.
fn affine_motion<R: Real>(to_world: &Mat4<R>) -> (V3<R>, Vec<R>) {
    let here = to_world.affine();
    let inverse = DMat4::from(here.inverse());
    let back = Mat4::<R>::from_fn(|i, j| R::from(inverse.col(j)[i]));
    let map = *to_world * back;
    let pivot = V3::constant(here.translation);
    (map.point(pivot) - pivot, (0..9).map(|k| map.m[k / 3][k % 3]).collect())
}

pub enum SurfacePart<R> {
    Diffuse {
        reflectance: [R; 3],
        two_sided: bool,
    },
    Dielectric {
        interior: R,
        exterior: R,
    },
    /// Index `eta - i k`.
    Conductor {
        eta: [R; 3],
        k: [R; 3],
        two_sided: bool,
    },
    /// The dielectric or conductor with microfacets.
    Rough {
        distribution: Distribution,
        alpha: R,
        smooth: Box<SurfacePart<R>>,
    },
    Null,
}

impl SurfacePart<f64> {
    /// How the index behind an interface compares to that before it.
    pub fn denser(&self) -> Option<Ordering> {
        match self {
            SurfacePart::Dielectric { interior, exterior } => interior.partial_cmp(exterior),
            SurfacePart::Rough { smooth, .. } => smooth.denser(),
            _ => None,
        }
    }
}

impl<R> SurfacePart<R> {
    /// Glass or metal that keeps rays together.
    pub fn is_smooth(&self) -> bool {
        matches!(self, SurfacePart::Dielectric { .. } | SurfacePart::Conductor { .. })
    }

    /// Of glass whose refracted light ends with a jump where facets stand upright ([`crate::surface::upright`]): the roughness, and the indices behind its front side and before it.
    pub fn upright(&self) -> Option<(&R, [&R; 2])> {
        let SurfacePart::Rough { distribution: Distribution::Ggx, alpha, smooth } = self else { return None };
        let SurfacePart::Dielectric { interior, exterior } = &**smooth else { return None };
        Some((alpha, [interior, exterior]))
    }

    /// Whether light gets through.
    pub fn is_transparent(&self) -> bool {
        match self {
            SurfacePart::Null | SurfacePart::Dielectric { .. } => true,
            SurfacePart::Rough { smooth, .. } => smooth.is_transparent(),
            _ => false,
        }
    }

    /// Whether light is refracted, smoothly or not.
    pub fn is_glass(&self) -> bool {
        self.is_transparent() && !matches!(self, SurfacePart::Null)
    }
}

pub enum VolumePart<R> {
    Constant([R; 3]),
    Vol { path: PathBuf, to_world: Mat4<R>, span: Span, smooth: bool },
    Vdb { file: VdbFile, to_world: Mat4<R>, span: Span },
}

impl<R: Real> VolumePart<R> {
    pub fn to_world(&self) -> Option<&Mat4<R>> {
        match self {
            VolumePart::Constant(_) => None,
            VolumePart::Vol { to_world, .. } | VolumePart::Vdb { to_world, .. } => Some(to_world),
        }
    }
}

/// Emitted radiance L_e, multiplied by sigma_a.
pub struct GlowPart<R> {
    /// Of radiance, or of temperatures.
    pub volume: VolumePart<R>,
    pub scale: R,
    /// Scale and offset of temperatures.
    pub heat: Option<[R; 2]>,
}

pub struct MediumPart<R> {
    pub name: String,
    pub span: Span,
    pub density: VolumePart<R>,
    pub albedo: VolumePart<R>,
    pub emission: Option<GlowPart<R>>,
    pub scale: R,
    /// `None` = isotropic.
    pub g: Option<R>,
}

pub enum LightKindPart<R> {
    Point {
        position: V3<R>,
    },
    Spot {
        to_world: Mat4<R>,
        beam: R,
        cutoff: R,
    },
    Directional {
        direction: V3<R>,
    },
    /// From the origin along +z of `to_world`.
    Beam {
        to_world: Mat4<R>,
        radius: R,
        gaussian: bool,
    },
    Area {
        shape: usize,
    },
    Constant,
    Envmap {
        path: PathBuf,
        to_world: Mat4<R>,
    },
}

impl<R: Real> LightKindPart<R> {
    /// Where a light of zero measure stands and looks, as slots.
    fn placement(&self) -> Vec<(Quantity, Vec<R>)> {
        let list = |v: V3<R>| vec![v.x, v.y, v.z];
        match self {
            LightKindPart::Point { position } => vec![(Quantity::Position, list(*position))],
            LightKindPart::Spot { to_world, beam, cutoff } => vec![
                (Quantity::Position, list(to_world.column(3))),
                (Quantity::Direction, list(to_world.vector(V3::constant(DVec3::Z)).normalize())),
                (Quantity::Angles, vec![*beam, *cutoff]),
            ],
            LightKindPart::Directional { direction } => vec![(Quantity::Direction, list(*direction))],
            LightKindPart::Beam { to_world, radius, .. } => vec![
                (Quantity::Position, list(to_world.column(3))),
                (Quantity::Direction, list(to_world.vector(V3::constant(DVec3::Z)).normalize())),
                (Quantity::Radius, vec![*radius]),
            ],
            LightKindPart::Area { .. } | LightKindPart::Constant | LightKindPart::Envmap { .. } => Vec::new(),
        }
    }
}

pub struct LightPart<R> {
    pub name: String,
    pub span: Span,
    pub kind: LightKindPart<R>,
    pub value: [R; 3],
    pub medium: Option<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Filter {
    Box { radius: f64 },
    Tent { radius: f64 },
    Gaussian { stddev: f64 },
}

#[derive(Clone, Copy, Debug)]
pub struct FilmPart {
    pub width: usize,
    pub height: usize,
    /// x0, y0, x1, y1 in pixels.
    pub crop: [usize; 4],
    pub filter: Filter,
    pub alpha: bool,
}

pub struct SensorPart<R> {
    pub name: String,
    pub span: Span,
    pub to_world: Mat4<R>,
    /// Tangent of half the horizontal field of view; `None` = orthographic.
    pub tan_half: Option<R>,
    pub offset: [R; 2],
    pub film: FilmPart,
    pub spp: u64,
    pub seed: u64,
    /// Samples are spread evenly instead of drawn one by one.
    pub even: bool,
    pub medium: Option<usize>,
}

#[derive(Clone, Copy, Debug)]
pub struct IntegratorPart {
    pub max_depth: u32,
    pub rr_depth: u32,
    pub hide_emitters: bool,
}

pub struct Parts<R> {
    pub shapes: Vec<ShapePart<R>>,
    pub surfaces: Vec<SurfacePart<R>>,
    pub surface_names: Vec<String>,
    pub media: Vec<MediumPart<R>>,
    pub lights: Vec<LightPart<R>>,
    pub sensors: Vec<SensorPart<R>>,
    pub integrator: IntegratorPart,
}

/// Consecutive slots of one object.
pub struct SlotPart<R> {
    pub owner: Owner,
    pub name: String,
    pub quantity: Quantity,
    pub values: Vec<R>,
}

/// What of a scene can move; the tangents tell whether it does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Movable {
    Shape(usize),
    LightPosition(usize),
    LightDirection(usize),
    LightProfile(usize),
    Environment(usize),
    /// A medium's grid of densities, of emission or temperatures, of albedos.
    Density(usize),
    Glow(usize),
    Albedo(usize),
    Sensor(usize),
}

impl<R: Real> Parts<R> {
    pub fn read(desc: &SceneDesc, env: &Env<R>) -> Result<Self> {
        let mut r = Reader { env, parts: Parts::empty(), surface_of: HashMap::new(), medium_of: HashMap::new() };
        r.scene(&desc.root).map_err(|e| desc.name_parameters(e))?;
        Ok(r.parts)
    }

    fn empty() -> Self {
        Parts {
            shapes: Vec::new(),
            surfaces: Vec::new(),
            surface_names: Vec::new(),
            media: Vec::new(),
            lights: Vec::new(),
            sensors: Vec::new(),
            integrator: IntegratorPart { max_depth: u32::MAX, rr_depth: 5, hide_emitters: false },
        }
    }

    /// Every differentiable scalar in its one fixed order: media, surfaces, lights, their places, shapes, sensors.
    pub fn slots(&self) -> Vec<SlotPart<R>> {
        let mut v = Vec::new();
        let mut add = |owner, name: &str, quantity, values: Vec<R>| {
            v.push(SlotPart { owner, name: name.into(), quantity, values });
        };
        for (i, m) in self.media.iter().enumerate() {
            let owner = Owner::Medium(i);
            if let VolumePart::Constant(c) = &m.density {
                add(owner, &m.name, Quantity::SigmaT, c.to_vec());
            }
            if let VolumePart::Constant(c) = &m.albedo {
                add(owner, &m.name, Quantity::Albedo, c.to_vec());
            }
            add(owner, &m.name, Quantity::MediumScale, vec![m.scale]);
            add(owner, &m.name, Quantity::G, m.g.into_iter().collect());
            if let Some(e) = &m.emission {
                match (&e.volume, e.heat) {
                    (VolumePart::Constant(c), None) => add(owner, &m.name, Quantity::Glow, c.to_vec()),
                    (VolumePart::Constant(c), Some(_)) => add(owner, &m.name, Quantity::Temperature, vec![c[0]]),
                    _ => {}
                }
                add(owner, &m.name, Quantity::GlowScale, vec![e.scale]);
                if let Some([scale, offset]) = e.heat {
                    add(owner, &m.name, Quantity::TemperatureScale, vec![scale]);
                    add(owner, &m.name, Quantity::TemperatureOffset, vec![offset]);
                }
                if let Some(to_world) = e.volume.to_world() {
                    let (shift, deformation) = affine_motion(to_world);
                    add(owner, &m.name, Quantity::GlowShift, vec![shift.x, shift.y, shift.z]);
                    add(owner, &m.name, Quantity::GlowDeformation, deformation);
                }
            }
            if let Some(to_world) = m.albedo.to_world() {
                let (shift, deformation) = affine_motion(to_world);
                add(owner, &m.name, Quantity::AlbedoShift, vec![shift.x, shift.y, shift.z]);
                add(owner, &m.name, Quantity::AlbedoDeformation, deformation);
            }
            if let Some(to_world) = m.density.to_world() {
                let (shift, deformation) = affine_motion(to_world);
                add(owner, &m.name, Quantity::Shift, vec![shift.x, shift.y, shift.z]);
                add(owner, &m.name, Quantity::Deformation, deformation);
            }
        }
        for (i, (s, name)) in self.surfaces.iter().zip(&self.surface_names).enumerate() {
            let (s, indices) = match s {
                SurfacePart::Rough { alpha, smooth, .. } => {
                    add(Owner::Surface(i), name, Quantity::Alpha, vec![*alpha]);
                    (smooth.as_ref(), Quantity::FacetIor)
                }
                s => (s, Quantity::Ior),
            };
            match s {
                SurfacePart::Diffuse { reflectance, .. } => {
                    add(Owner::Surface(i), name, Quantity::Reflectance, reflectance.to_vec());
                }
                SurfacePart::Dielectric { interior, exterior } => {
                    add(Owner::Surface(i), name, indices, vec![*interior, *exterior]);
                }
                SurfacePart::Conductor { eta, k, .. } => {
                    add(Owner::Surface(i), name, indices, eta.iter().chain(k).copied().collect());
                }
                SurfacePart::Null | SurfacePart::Rough { .. } => {}
            }
        }
        for (i, l) in self.lights.iter().enumerate() {
            match l.kind {
                LightKindPart::Envmap { .. } => {
                    add(Owner::Light(i), &l.name, Quantity::EnvironmentScale, vec![l.value[0]]);
                }
                _ => add(Owner::Light(i), &l.name, Quantity::Emission, l.value.to_vec()),
            }
        }
        for (i, l) in self.lights.iter().enumerate() {
            for (quantity, values) in l.kind.placement() {
                add(Owner::Light(i), &l.name, quantity, values);
            }
        }
        let list = |v: V3<R>| vec![v.x, v.y, v.z];
        for (i, s) in self.shapes.iter().enumerate() {
            let (shift, deformation) = s.motion();
            add(Owner::Shape(i), &s.name, Quantity::Shift, list(shift));
            add(Owner::Shape(i), &s.name, Quantity::Deformation, deformation);
        }
        for (i, s) in self.sensors.iter().enumerate() {
            let (shift, deformation) = affine_motion(&s.to_world);
            add(Owner::Sensor(i), &s.name, Quantity::Shift, list(shift));
            add(Owner::Sensor(i), &s.name, Quantity::Deformation, deformation);
            let lens = s.tan_half.map(|t| vec![t, s.offset[0], s.offset[1]]);
            add(Owner::Sensor(i), &s.name, Quantity::Lens, lens.unwrap_or_default());
        }
        v
    }

    /// Everything that can move, as numbers.
    pub fn movable(&self) -> Vec<(Movable, Vec<R>)> {
        let flat = |m: &Mat4<R>| (0..12).map(|i| m.m[i / 4][i % 4]).collect::<Vec<R>>();
        let mut v = Vec::new();
        for (i, s) in self.shapes.iter().enumerate() {
            let mut x = flat(&s.to_world);
            if let ShapeKind::Sphere { center, radius } = &s.kind {
                x.extend([center.x, center.y, center.z, *radius]);
            }
            if let ShapeKind::Cylinder { p0, p1, radius } = &s.kind {
                x.extend([p0.x, p0.y, p0.z, p1.x, p1.y, p1.z, *radius]);
            }
            v.push((Movable::Shape(i), x));
        }
        for (i, l) in self.lights.iter().enumerate() {
            for (quantity, values) in l.kind.placement() {
                let what = match quantity {
                    Quantity::Position => Movable::LightPosition(i),
                    Quantity::Direction => Movable::LightDirection(i),
                    _ => Movable::LightProfile(i),
                };
                v.push((what, values));
            }
            if let LightKindPart::Envmap { to_world, .. } = &l.kind {
                v.push((Movable::Environment(i), flat(to_world)));
            }
        }
        for (i, m) in self.media.iter().enumerate() {
            v.extend(m.density.to_world().map(|t| (Movable::Density(i), flat(t))));
            let glow = m.emission.as_ref().and_then(|e| e.volume.to_world());
            v.extend(glow.map(|t| (Movable::Glow(i), flat(t))));
            v.extend(m.albedo.to_world().map(|t| (Movable::Albedo(i), flat(t))));
        }
        for (i, s) in self.sensors.iter().enumerate() {
            let mut x = flat(&s.to_world);
            x.extend(s.tan_half);
            x.extend(s.offset);
            v.push((Movable::Sensor(i), x));
        }
        v
    }
}

/// Reads plugins into parts; the plugins' own readers are in `parts_*`.
pub(super) struct Reader<'a, R> {
    pub env: &'a Env<R>,
    pub parts: Parts<R>,
    surface_of: HashMap<usize, usize>,
    medium_of: HashMap<usize, usize>,
}

/// The id of an object, else its plugin and line.
pub(super) fn label(n: &Node) -> String {
    n.id.clone().unwrap_or_else(|| format!("{}@{}", if n.plugin.is_empty() { &n.tag } else { &n.plugin }, n.span.line))
}

impl<R: Real> Reader<'_, R> {
    fn scene(&mut self, root: &Node) -> Result<()> {
        match root.child("integrator")? {
            Some(n) => self.parts.integrator = integrator(n)?,
            None => {
                return Err(Error::scene(
                    &root.span,
                    "the scene has no <integrator>",
                    "add <integrator type=\"volpath\"/>, with max_depth if wanted",
                ));
            }
        }
        for n in root.children("medium") {
            self.medium(n)?;
        }
        for n in root.children("shape") {
            self.shape(n)?;
        }
        for n in root.children("emitter") {
            self.emitter(n, None)?;
        }
        let environments: Vec<&LightPart<R>> = self
            .parts
            .lights
            .iter()
            .filter(|l| matches!(l.kind, LightKindPart::Constant | LightKindPart::Envmap { .. }))
            .collect();
        if let [_, second, ..] = environments[..] {
            return Err(Error::scene(&second.span, "the scene has two environment emitters", "keep one of them"));
        }
        for n in root.children("sensor") {
            let s = self.sensor(n)?;
            self.parts.sensors.push(s);
        }
        if self.parts.sensors.is_empty() {
            let remedy = "add <sensor type=\"perspective\"> with a to_world transform";
            return Err(Error::scene(&root.span, "the scene has no <sensor>", remedy));
        }
        Ok(())
    }

    /// The surface of a `<bsdf>`, compiled once.
    pub fn surface(&mut self, n: &Node) -> Result<usize> {
        if let Some(&i) = self.surface_of.get(&n.key()) {
            return Ok(i);
        }
        let part = self.bsdf(n, false)?;
        self.parts.surfaces.push(part);
        self.parts.surface_names.push(label(n));
        self.surface_of.insert(n.key(), self.parts.surfaces.len() - 1);
        Ok(self.parts.surfaces.len() - 1)
    }

    /// The medium of a `<medium>`, compiled once.
    pub fn medium(&mut self, n: &Node) -> Result<usize> {
        if let Some(&i) = self.medium_of.get(&n.key()) {
            return Ok(i);
        }
        let part = self.medium_part(n)?;
        self.parts.media.push(part);
        self.medium_of.insert(n.key(), self.parts.media.len() - 1);
        Ok(self.parts.media.len() - 1)
    }

    pub fn medium_child(&mut self, n: &Node, name: &str) -> Result<Option<usize>> {
        match n.named(name)? {
            Some(m) if m.tag == "medium" => Ok(Some(self.medium(m)?)),
            Some(m) => Err(n.err(name, format!("`{name}` is a <{}>", m.tag), "refer to a <medium> here")),
            None => Ok(None),
        }
    }
}

fn integrator(n: &Node) -> Result<IntegratorPart> {
    const PLUGINS: [&str; 4] = ["path", "volpath", "volpathmis", "direct"];
    if !PLUGINS[..3].contains(&n.plugin.as_str()) {
        return Err(n.unknown_plugin(&PLUGINS[..3]));
    }
    let depth = n.int("max_depth", -1)?;
    let rr = n.int("rr_depth", 5)?;
    if depth < -1 {
        return Err(n.err("max_depth", format!("max_depth is {depth}"), "use -1 for no limit, or a number >= 0"));
    }
    if rr < 1 {
        return Err(n.err("rr_depth", format!("rr_depth is {rr}"), "use a number >= 1"));
    }
    Ok(IntegratorPart {
        max_depth: u32::try_from(depth).unwrap_or(u32::MAX),
        rr_depth: u32::try_from(rr).unwrap_or(u32::MAX),
        hide_emitters: n.bool("hide_emitters", false)?,
    })
}
