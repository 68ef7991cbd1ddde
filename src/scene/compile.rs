//! From parts to a scene that can be rendered: files are loaded, Embree is built, media and lights get their tables.

use super::beams::Beams;
use super::bodies::Bodies;
use super::bright::Bright;
use super::chains::Chains;
use super::columns::Columns;
use super::critical::Critical;
use super::desc::SceneDesc;
use super::geometry::Group;
use super::lamps::Lamps;
use super::parts::{
    GlowPart, LightKindPart, MediumPart, Movable, Parts, ShapeKind, ShapePart, SurfacePart, VolumePart,
};
use super::transform::Mat4;
use super::volume_cache::VolumeCache;
use super::volumes::{Loading, load_vdb, load_vol};
use super::{Film, Instance, Scene, Settings, arrays};
use crate::error::{Error, Result, Warning, WarningKind};
use crate::light::envmap::Envmap;
use crate::light::{Light, LightKind, Place};
use crate::math::discrete::Discrete;
use crate::math::{DMat3, DVec3, Dual, Rgb};
use crate::medium::glow::{Glow, GlowSlots, Heat};
use crate::medium::grid::Allowed;
use crate::medium::{Medium, MediumSlots, NO_SLOT, Volume};
use crate::params::{Mover, Owner, ParamSet, Quantity, SlotTable};
use crate::phase::Phase;
use crate::sensor::{Projection, Sensor};
use crate::shape::{
    Bounds, Cube, Cylinder, Disk, Geometry, Rectangle, Shape, Sphere, TriangleMesh, level_set, obj, ply,
};
use crate::surface::Surface;
use crate::surface::rough::{MATCHED, Matter, Rough};
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// Paths longer than this many steps are cut and counted.
const PATH_CAP: u64 = 50_000_000;

/// See [`Scene::uniform_share`].
const UNIFORM_SHARE: f64 = 0.25;
/// [`Scene::least_through`], where it is not 0.
const LEAST_THROUGH: f64 = 0.2;

/// Derivative vertices take over from collision scores below this many collisions per extent of a medium.
const KAPPA_SHARE: f64 = 0.3;

/// Options of loading that are not in the scene file.
#[derive(Clone, Debug, Default)]
pub struct LoadOptions {
    pub repair_voxels: bool,
    pub orders: Orders,
    /// What scenes of these options keep of their volume files for one another.
    pub volumes: Option<VolumeCache>,
}

/// Which numbers of scatterings a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Orders {
    pub first: u32,
    pub last: u32,
}

impl Default for Orders {
    fn default() -> Self {
        Orders { first: 0, last: u32::MAX }
    }
}

impl Scene {
    /// Read, check and build. Every property of the file has been read when this returns.
    pub fn compile(desc: &SceneDesc, options: &LoadOptions) -> Result<Scene> {
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        desc.finish()?;
        let mut warnings = desc.warnings.clone();
        let slots = slot_table(&parts);
        let mut shapes = Vec::with_capacity(parts.shapes.len());
        for (i, s) in parts.shapes.iter().enumerate() {
            let mover = Mover { first: slot_of(&slots, Owner::Shape(i), Quantity::Shift), pivot: s.pivot() };
            shapes.push(instance(s, &parts, mover, &mut warnings)?);
        }
        let mut media = Vec::with_capacity(parts.media.len());
        for (i, m) in parts.media.iter().enumerate() {
            media.push(medium(m, Owner::Medium(i), &slots, options, &mut warnings)?);
        }
        let mut surfaces = Vec::with_capacity(parts.surfaces.len());
        for (i, s) in parts.surfaces.iter().enumerate() {
            surfaces.push(surface(s, &|q| slot_of(&slots, Owner::Surface(i), q)));
        }
        let mut lights = Vec::with_capacity(parts.lights.len());
        for (i, l) in parts.lights.iter().enumerate() {
            lights.push(light(l, Owner::Light(i), &slots)?);
        }
        let sensors: Vec<Sensor> =
            parts.sensors.iter().enumerate().map(|(i, s)| sensor(s, Owner::Sensor(i), &slots)).collect();
        let films =
            parts.sensors.iter().map(|s| Film { part: s.film, spp: s.spp, seed: s.seed, even: s.even }).collect();

        let mut bounds = shapes.iter().fold(Bounds::EMPTY, |b, s: &Instance| b.union(&s.shape.bounds()));
        for s in &sensors {
            bounds = bounds.with_point(s.to_world.translation);
        }
        for l in &lights {
            bounds = l.center().map_or(bounds, |c| bounds.with_point(c));
        }
        set_kappa(&mut media, &shapes, &bounds);
        let environment =
            lights.iter().position(|l| matches!(l.kind, LightKind::Constant | LightKind::Envmap(_))).map(|i| i as u32);
        let has_glass = has_glass(&shapes, &surfaces);
        let (opaque, null) = groups(&shapes, &surfaces)?;
        let i = parts.integrator;
        let mut scene = Scene {
            max_interfaces: 2 * shapes.len() + 64,
            open_borders: OnceLock::new(),
            has_glass,
            uniform_share: 0.0,
            least_through: 0.0,
            critical: Critical::default(),
            shapes,
            surfaces,
            media,
            lights,
            environment,
            sensors,
            films,
            settings: Settings {
                max_depth: i.max_depth.min(options.orders.last.saturating_add(1)),
                min_order: options.orders.first,
                rr_depth: i.rr_depth,
                hide_emitters: i.hide_emitters,
                cap: PATH_CAP,
            },
            slots,
            bounds,
            warnings,
            opaque,
            null,
            selection: Discrete::default(),
            distant: Vec::new(),
            local: Discrete::default(),
            embedded: Discrete::default(),
            beams: Beams::default(),
            columns: Columns::default(),
            panes: Vec::new(),
            chains: Chains::default(),
            bodies: Bodies::default(),
            lamps: Lamps::default(),
            balls: Vec::new(),
            seeds: Vec::new(),
            sheltered: Vec::new(),
            shines_within: false,
            bright: Bright::default(),
        };
        let named: Vec<Option<usize>> = parts.lights.iter().map(|l| l.medium).collect();
        scene.prepare_shelters();
        scene.prepare_lights(&named);
        scene.prepare_beams();
        scene.prepare_columns();
        scene.prepare_panes();
        scene.prepare_bodies();
        scene.prepare_chains();
        scene.prepare_lamps();
        scene.prepare_balls();
        scene.prepare_seeds();
        scene.prepare_bright();
        if can_move(desc, &scene)? {
            scene.prepare_motion();
        } else if can_refract(desc)? {
            scene.prepare_refraction();
        }
        super::advice::advise(&mut scene, &parts);
        Ok(scene)
    }

    /// Choose directions so that the scores of motion have second moments.
    pub(super) fn prepare_motion(&mut self) {
        self.uniform_share = UNIFORM_SHARE;
        self.prepare_refraction();
    }

    fn prepare_refraction(&mut self) {
        self.least_through = LEAST_THROUGH;
        self.prepare_critical();
    }

    /// The tangents of all scalar slots with respect to the named parameters, and the arrays among them, which must be open ([`Scene::open`]).
    pub fn param_set(&self, desc: &SceneDesc, names: &[String]) -> Result<ParamSet> {
        let (arrays, names): (Vec<&String>, Vec<&String>) = names.iter().partition(|n| arrays::split(n).is_some());
        let arrays = arrays.into_iter().map(|name| self.array(desc, name)).collect::<Result<_>>()?;
        let mut columns = Vec::new();
        for name in &names {
            let parts = Parts::read(desc, &desc.dual(desc.wrt(name)?))?;
            columns.push(parts.slots().into_iter().flat_map(|s| s.values).map(|x| x.d[0]).collect());
        }
        let set = ParamSet::new(names.into_iter().cloned().collect(), &columns, self.slots.scalars);
        Ok(set.with_arrays(arrays, self.slots.count))
    }
}

/// Whether a parameter can move vertices of paths: with a shape, a camera, a light that a medium follows.
fn can_move(desc: &SceneDesc, scene: &Scene) -> Result<bool> {
    for k in 0..desc.params.len() {
        let parts = Parts::read(desc, &desc.dual(k))?;
        let moves = |(what, x): (Movable, Vec<Dual<1>>)| {
            let vertices = match what {
                Movable::Shape(_) | Movable::Sensor(_) => true,
                Movable::LightPosition(i) => scene.has_hard_edge_inside(i as u32),
                _ => false,
            };
            vertices && x.iter().any(|x| x.d[0] != 0.0)
        };
        if parts.movable().into_iter().any(moves) {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether a parameter can change an index of refraction.
fn can_refract(desc: &SceneDesc) -> Result<bool> {
    for k in 0..desc.params.len() {
        let slots = Parts::read(desc, &desc.dual(k))?.slots();
        let mut indices = slots.iter().filter(|s| s.quantity == Quantity::Ior).flat_map(|s| &s.values);
        if indices.any(|x| x.d[0] != 0.0) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn slot_table(parts: &Parts<f64>) -> SlotTable {
    let mut t = SlotTable::default();
    for s in parts.slots() {
        t.push(s.owner, &s.name, s.quantity, &s.values);
    }
    t
}

fn slot_of(t: &SlotTable, owner: Owner, q: Quantity) -> u32 {
    t.blocks.iter().find(|b| b.owner == owner && b.quantity == q && b.len > 0).map_or(NO_SLOT, |b| b.first)
}

fn instance(s: &ShapePart<f64>, parts: &Parts<f64>, mover: Mover, warnings: &mut Vec<Warning>) -> Result<Instance> {
    let to_world = s.to_world.affine();
    let fail = |what: String| Error::scene(&s.span, what, "correct the shape or its to_world");
    let mesh = |path: &Path, m: std::result::Result<TriangleMesh, String>| -> Result<Shape> {
        let mut m = m.and_then(|m| m.transformed(&to_world)).map_err(|e| {
            let what = format!("shape `{}`, {}: {e}", s.name, path.display());
            Error::scene(&s.span, what, "export the mesh again, or name another file")
        })?;
        if s.flip_normals {
            m = m.flip_normals();
        }
        Ok(Shape::Mesh(m))
    };
    let shape = match &s.kind {
        ShapeKind::Obj(path) => mesh(path, obj::load(path))?,
        ShapeKind::Ply(path) => mesh(path, ply::load(path))?,
        ShapeKind::LevelSet { path, select, isovalue } => mesh(path, level_set::load(path, select, *isovalue))?,
        ShapeKind::Sphere { center, radius } => {
            Shape::Sphere(Sphere::new(center.value(), *radius, to_world, s.flip_normals).map_err(fail)?)
        }
        ShapeKind::Rectangle => Shape::Rectangle(Rectangle::new(to_world, s.flip_normals).map_err(fail)?),
        ShapeKind::Cube => Shape::Cube(Cube::new(to_world, s.flip_normals).map_err(fail)?),
        ShapeKind::Disk => Shape::Disk(Disk::new(to_world, s.flip_normals).map_err(fail)?),
        ShapeKind::Cylinder { .. } => {
            let remedy = "scale alike across its axis (along it as you like), or use a mesh";
            let fail = |what: String| Error::scene(&s.span, what, remedy);
            Shape::Cylinder(Cylinder::new(s.placed().affine(), s.flip_normals).map_err(fail)?)
        }
    };
    let boundary = s.interior.is_some() || s.exterior.is_some();
    if let Shape::Mesh(m) = &shape {
        let mut warn = |kind, what: String, hint: &str| {
            let what = format!("shape `{}`: {what}", s.name);
            warnings.push(Warning { kind, span: s.span.clone(), what, hint: hint.into() });
        };
        if boundary {
            if let Some(leak) = m.topology().leaks() {
                let hint = match m.topology().is_inside_out() {
                    true => "turn its faces, or set flip_normals: its interior is the medium behind its normals",
                    false => "close and weld the mesh: rays that pass a hole leave or enter the medium unseen",
                };
                warn(WarningKind::LeakyBoundary, leak, hint);
            }
        }
        if parts.surfaces[s.surface].is_glass() && !m.topology().is_closed() {
            let what = format!("it refracts, but has {} open edges after welding", m.topology().boundary_edges);
            let hint = "close the mesh: rays that pass a hole leave or enter the glass unseen, and its index stays behind. One that is meant to bound a \
                        half-space, as a rectangle does, has to reach past everything that is seen";
            warn(WarningKind::OpenInterface, what, hint);
        }
        let turned = m.topology().faces_against_normals;
        if parts.surfaces[s.surface].is_glass() && !boundary && turned > 0 {
            let what = format!("it refracts, but {turned} of its faces are wound against their vertex normals");
            let hint = "turn these faces in the file: their winding says what is inside, normals only shade";
            warn(WarningKind::OpenInterface, what, hint);
        }
        if let Some(defect) = m.topology().defects() {
            let hint = "such faces and edges are rendered as they are, and faces are shaded flat where normals have no direction";
            warn(WarningKind::DegenerateMesh, defect, hint);
        }
    }
    Ok(Instance {
        name: s.name.clone(),
        span: s.span.clone(),
        shape,
        surface: s.surface as u32,
        boundary,
        interior: s.interior.map(|i| i as u32),
        exterior: s.exterior.map(|i| i as u32),
        light: s.light.map(|i| i as u32),
        mover,
        vertices: None,
        face_normals: s.face_normals,
    })
}

fn medium(
    m: &MediumPart<f64>,
    owner: Owner,
    slots: &SlotTable,
    options: &LoadOptions,
    warnings: &mut Vec<Warning>,
) -> Result<Medium> {
    let density = volume(&m.density, Allowed::NON_NEGATIVE, options, warnings)?;
    let albedo = volume(&m.albedo, Allowed::SHARE, options, warnings)?;
    let emission = m.emission.as_ref().map(|e| glow(m, e, owner, slots, options, warnings)).transpose()?;
    let sigma_t = density.max() * m.scale;
    let constant_albedo = if let Volume::Constant(c) = &albedo { *c } else { Rgb::ONE };
    let gray = match &density {
        Volume::Constant(c) => c.is_gray(),
        Volume::Grid(g) => g.channels() == 1,
    };
    Ok(Medium {
        name: m.name.clone(),
        sigma_s: sigma_t * albedo.max(),
        sigma_t,
        constant_albedo,
        gray,
        density,
        albedo,
        emission,
        scale: m.scale,
        phase: m.g.map_or(Phase::Isotropic, |g| Phase::Hg { g }),
        slots: MediumSlots {
            sigma_t: slot_of(slots, owner, Quantity::SigmaT),
            albedo: slot_of(slots, owner, Quantity::Albedo),
            scale: slot_of(slots, owner, Quantity::MediumScale),
            g: slot_of(slots, owner, Quantity::G),
            mover: m.density.to_world().map(|t| mover(t, slots, owner, Quantity::Shift)),
            albedo_mover: m.albedo.to_world().map(|t| mover(t, slots, owner, Quantity::AlbedoShift)),
        },
        kappa: 1.0,
    })
}

/// Of a volume that is placed like this.
fn mover(to_world: &Mat4<f64>, slots: &SlotTable, owner: Owner, shift: Quantity) -> Mover {
    Mover { first: slot_of(slots, owner, shift), pivot: to_world.affine().translation }
}

/// Temperatures below this, in kelvin, shine with less than 1e-8 W / (m² sr).
const DARK: f64 = 650.0;

fn glow(
    m: &MediumPart<f64>,
    e: &GlowPart<f64>,
    owner: Owner,
    slots: &SlotTable,
    options: &LoadOptions,
    warnings: &mut Vec<Warning>,
) -> Result<Glow> {
    let v = volume(&e.volume, Allowed::NON_NEGATIVE, options, warnings)?;
    let heat = e.heat.map(|[scale, offset]| Heat { scale, offset });
    if let (Some(heat), Volume::Grid(g)) = (&heat, &v) {
        if g.channels() != 1 {
            let what = format!("medium `{}`: its temperature grid has three channels", m.name);
            return Err(Error::scene(&m.span, what, "a temperature is one number: name a grid of floats"));
        }
        let most = heat.kelvin(g.max());
        if most < DARK {
            warnings.push(Warning {
                kind: WarningKind::NoEffect,
                span: m.span.clone(),
                what: format!(
                    "medium `{}`: its temperature reaches {most} K, where nothing can be seen to glow",
                    m.name
                ),
                hint: "set temperature_scale: files often hold 0..1 or 0..3 for some thousand kelvin".into(),
            });
        }
    }
    let quantity = if heat.is_some() { Quantity::Temperature } else { Quantity::Glow };
    let slots = GlowSlots {
        value: slot_of(slots, owner, quantity),
        scale: slot_of(slots, owner, Quantity::GlowScale),
        heat_scale: slot_of(slots, owner, Quantity::TemperatureScale),
        heat_offset: slot_of(slots, owner, Quantity::TemperatureOffset),
        mover: e.volume.to_world().map(|t| mover(t, slots, owner, Quantity::GlowShift)),
    };
    Ok(Glow { volume: v, scale: e.scale, heat, slots })
}

fn volume(v: &VolumePart<f64>, allowed: Allowed, options: &LoadOptions, warnings: &mut Vec<Warning>) -> Result<Volume> {
    let how = |to_world: &Mat4<f64>, span| Loading { to_world: to_world.affine(), allowed, span, options };
    let grid = match v {
        VolumePart::Constant(c) => return Ok(Volume::Constant(Rgb(*c))),
        VolumePart::Vol { path, to_world, span, smooth } => {
            Arc::new(load_vol(path, *smooth, how(to_world, span), warnings)?)
        }
        VolumePart::Vdb { file, to_world, span } => match &options.volumes {
            Some(kept) => kept.vdb(file, how(to_world, span), warnings)?,
            None => Arc::new(load_vdb(file, how(to_world, span), warnings)?),
        },
    };
    Ok(Volume::Grid(grid))
}

fn surface(s: &SurfacePart<f64>, slot: &dyn Fn(Quantity) -> u32) -> Surface {
    match s {
        SurfacePart::Rough { distribution, alpha, smooth } => {
            let index_slot = slot(Quantity::FacetIor);
            let matter = match surface(smooth, &|_| index_slot) {
                // Nothing turns: [`crate::term::rough`] refuses to say how that would change.
                Surface::Dielectric { interior, exterior, slot } if (interior / exterior - 1.0).abs() < MATCHED => {
                    return Surface::Dielectric { interior, exterior, slot };
                }
                Surface::Dielectric { interior, exterior, .. } => Matter::Dielectric { interior, exterior },
                Surface::Conductor { eta, k, two_sided, .. } => Matter::Conductor { eta, k, two_sided },
                other => return other,
            };
            let alpha_slot = slot(Quantity::Alpha);
            Surface::Rough(Rough { distribution: *distribution, alpha: *alpha, matter, alpha_slot, index_slot })
        }
        SurfacePart::Null => Surface::Null,
        SurfacePart::Dielectric { interior, exterior } => {
            Surface::Dielectric { interior: *interior, exterior: *exterior, slot: slot(Quantity::Ior) }
        }
        SurfacePart::Conductor { eta, k, two_sided } => {
            Surface::Conductor { eta: Rgb(*eta), k: Rgb(*k), two_sided: *two_sided, slot: slot(Quantity::Ior) }
        }
        SurfacePart::Diffuse { reflectance, two_sided } => Surface::Diffuse {
            reflectance: Rgb(*reflectance),
            two_sided: *two_sided,
            slot: slot(Quantity::Reflectance),
        },
    }
}

fn light(l: &super::parts::LightPart<f64>, owner: Owner, slots: &SlotTable) -> Result<Light> {
    let mut quantity = Quantity::Emission;
    let kind = match &l.kind {
        LightKindPart::Point { position } => LightKind::Point { position: position.value() },
        LightKindPart::Spot { to_world, beam, cutoff } => {
            let m = to_world.affine();
            let axis = m.transform_vector3(DVec3::Z).normalize();
            LightKind::Spot { position: m.translation, axis, beam: *beam, cutoff: *cutoff }
        }
        LightKindPart::Directional { direction } => LightKind::Directional { direction: direction.value() },
        LightKindPart::Beam { to_world, radius, gaussian } => {
            let m = to_world.affine();
            let direction = m.transform_vector3(DVec3::Z).normalize();
            LightKind::Beam { position: m.translation, direction, radius: *radius, gaussian: *gaussian }
        }
        LightKindPart::Area { shape } => LightKind::Area { shape: *shape as u32 },
        LightKindPart::Constant => LightKind::Constant,
        LightKindPart::Envmap { path, to_world } => {
            quantity = Quantity::EnvironmentScale;
            let image = crate::image::environment::load_environment(path)
                .map_err(|e| Error::scene(&l.span, e.to_string(), "use an equirectangular .exr or .hdr image"))?;
            let m = to_world.affine().matrix3;
            let turn = DMat3::from_cols(m.x_axis.normalize(), m.y_axis.normalize(), m.z_axis.normalize());
            if (turn.transpose() * turn - DMat3::IDENTITY).abs().to_cols_array().iter().any(|x| *x > 1e-9) {
                let what = "the environment map's to_world is not a rotation";
                return Err(Error::scene(&l.span, what, "rotate it only: scale and shear have no meaning at infinity"));
            }
            LightKind::Envmap(Box::new(Envmap::new(image.width, image.height, image.pixels, turn)))
        }
    };
    let place = Place {
        position: slot_of(slots, owner, Quantity::Position),
        direction: slot_of(slots, owner, Quantity::Direction),
        angles: slot_of(slots, owner, Quantity::Angles),
        radius: slot_of(slots, owner, Quantity::Radius),
    };
    Ok(Light { name: l.name.clone(), kind, value: Rgb(l.value), slot: slot_of(slots, owner, quantity), place })
}

fn sensor(s: &super::parts::SensorPart<f64>, owner: Owner, slots: &SlotTable) -> Sensor {
    let to_world = s.to_world.affine();
    Sensor {
        mover: Mover { first: slot_of(slots, owner, Quantity::Shift), pivot: to_world.translation },
        lens: slot_of(slots, owner, Quantity::Lens),
        projection: match s.tan_half {
            Some(tan_half) => Projection::Perspective { tan_half, offset: s.offset },
            None => Projection::Orthographic,
        },
        to_world,
        width: s.film.width,
        height: s.film.height,
        medium: s.medium.map(|m| m as u32),
    }
}

/// One over the extent of each medium: of its boundary shapes, or of the scene where it has none.
fn set_kappa(media: &mut [Medium], shapes: &[Instance], bounds: &Bounds) {
    for (i, m) in media.iter_mut().enumerate() {
        let id = Some(i as u32);
        let own = shapes
            .iter()
            .filter(|s| s.boundary && s.interior == id)
            .fold(Bounds::EMPTY, |b, s| b.union(&s.shape.bounds()));
        // The thinnest extent of a volume; a flat boundary (half-space) has none.
        let size = own.size();
        let extent = if own.is_empty() { 0.0 } else { size.min_element() };
        let extent = if extent > 0.0 { extent } else { 2.0 * bounds.radius() };
        // A scene without any extent: the medium's own length.
        m.kappa = if extent > 0.0 && extent.is_finite() { KAPPA_SHARE / extent } else { m.sigma_t.max().max(1.0) };
    }
}

/// Opaque shapes and null interfaces, each with its own Embree scene.
fn has_glass(shapes: &[Instance], surfaces: &[Surface]) -> bool {
    shapes.iter().any(|s| surfaces[s.surface as usize].is_transparent())
}

fn groups(shapes: &[Instance], surfaces: &[Surface]) -> Result<(Group, Group)> {
    let members = |null: bool| -> Vec<u32> {
        (0..shapes.len() as u32).filter(|&i| surfaces[shapes[i as usize].surface as usize].is_null() == null).collect()
    };
    Ok((Group::build(shapes, &members(false))?, Group::build(shapes, &members(true))?))
}
