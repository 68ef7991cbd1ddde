//! Arrays of numbers as parameters, named `object.array`: `bunny.vertices`, `smoke.sigma_t.grid`. A scene has slots for them once [`Scene::open`] was asked for it.

use super::desc::{nearest, suggest};
use super::parts::{Parts, ShapeKind, SurfacePart};
use super::{Scene, SceneDesc};
use crate::error::{Error, Result};
use crate::medium::NO_SLOT;
use crate::params::{Array, Owner, Quantity};
use crate::shape::Shape;

/// The array of vertices.
pub const VERTICES: &str = "vertices";

/// Arrays of voxels: their names, and what they hold.
pub const VOXELS: [(&str, Quantity); 4] = [
    ("sigma_t.grid", Quantity::SigmaT),
    ("albedo.grid", Quantity::Albedo),
    ("emission.grid", Quantity::Glow),
    ("temperature.grid", Quantity::Temperature),
];

/// What a name means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Target {
    /// Vertices of this shape.
    Vertices(usize),
    /// Voxels of this medium's grid.
    Voxels(usize, Quantity),
}

/// Object and array of a name, which then is no `$parameter`'s.
pub fn split(name: &str) -> Option<(&str, &str)> {
    let grid = name.strip_suffix(".grid").and_then(|rest| rest.rfind('.'));
    let at = grid.or_else(|| name.rfind('.'))?;
    Some((&name[..at], &name[at + 1..]))
}

/// What an array's name says it holds.
fn voxels(array: &str) -> Option<Quantity> {
    VOXELS.iter().find(|v| v.0 == array).map(|v| v.1)
}

/// Whether it is a name of voxels.
pub fn is_voxels(name: &str) -> bool {
    split(name).is_some_and(|(_, array)| voxels(array).is_some())
}

/// Names of all arrays of a scene that can be parameters, as far as its description tells.
pub fn names(parts: &Parts<f64>) -> Vec<String> {
    let vertices = parts.shapes.iter().map(|s| format!("{}.{VERTICES}", s.name));
    let voxels = parts.media.iter().flat_map(|m| VOXELS.iter().map(move |v| format!("{}.{}", m.name, v.0)));
    vertices.chain(voxels).filter(|n| target(parts, n).is_ok()).collect()
}

/// What a misspelt name may mean: the ending that exists and is nearest to its own.
fn nearest_name(name: &str) -> Option<String> {
    let endings = || VOXELS.iter().map(|v| v.0).chain([VERTICES]);
    // The last part of the name, or the last two: endings have one dot or none.
    let own = name.rmatch_indices('.').take(2).map(|(at, _)| (&name[..at], &name[at + 1..]));
    let found = own.filter_map(|(object, own)| {
        let alike = endings().filter(|e| e.matches('.').count() == own.matches('.').count());
        Some(format!("{object}.{}", nearest(own, alike)?))
    });
    found.last()
}

/// An error for an array that cannot be a parameter, whatever the scene is.
pub fn known(name: &str) -> Result<()> {
    match split(name) {
        None => Ok(()),
        Some((_, array)) if array == VERTICES || voxels(array).is_some() => Ok(()),
        Some((object, array)) => {
            let meant = nearest_name(name).map_or(String::new(), |n| format!("did you mean `{n}`? Otherwise "));
            Err(Error::usage(
                format!("`--wrt {name}`: derivatives by `{array}` of `{object}` are not available yet"),
                format!(
                    "{meant}give a `$parameter` of the scene (`tyndall info SCENE` lists them), ID.vertices, ID being the id of an obj or ply shape, or \
                     ID.sigma_t.grid, ID.albedo.grid, ID.emission.grid, ID.temperature.grid, ID being the id of a medium with such a grid"
                ),
            ))
        }
    }
}

/// What the name of an array means in a scene. Refused by name: all that cannot be parameters.
pub fn target(parts: &Parts<f64>, name: &str) -> Result<Target> {
    known(name)?;
    match split(name).and_then(|(object, array)| Some((object, voxels(array)?))) {
        Some((object, quantity)) => {
            super::voxels::medium(parts, name, object, quantity).map(|i| Target::Voxels(i, quantity))
        }
        None => mesh(parts, name).map(Target::Vertices),
    }
}

/// What an object is that is not what was looked for.
pub(super) fn kind_of(parts: &Parts<f64>, object: &str) -> Option<&'static str> {
    let kinds = [
        ("a medium", parts.media.iter().any(|m| m.name == object)),
        ("a shape", parts.shapes.iter().any(|s| s.name == object)),
        ("an emitter", parts.lights.iter().any(|l| l.name == object)),
        ("a bsdf", parts.surface_names.iter().any(|n| n == object)),
        ("a sensor", parts.sensors.iter().any(|s| s.name == object)),
    ];
    kinds.iter().find(|k| k.1).map(|k| k.0)
}

/// The mesh whose vertices `name` means. Refused by name: meshes whose vertices cannot be parameters.
fn mesh(parts: &Parts<f64>, name: &str) -> Result<usize> {
    let (object, _) = split(name).unwrap_or((name, VERTICES));
    let fail = |what: String, remedy: String| Err(Error::usage(format!("`--wrt {name}`: {what}"), remedy));
    let is_mesh = |k: &ShapeKind<f64>| matches!(k, ShapeKind::Obj(_) | ShapeKind::Ply(_));
    let meshes = || parts.shapes.iter().filter(|s| is_mesh(&s.kind)).map(|s| s.name.as_str());
    let ours = || match meshes().count() {
        0 => "the scene has no mesh (a shape of type obj or ply)".into(),
        _ => suggest(object, meshes()),
    };
    let mut found = parts.shapes.iter().enumerate().filter(|(_, s)| s.name == object);
    let Some((index, shape)) = found.next() else {
        let what = match kind_of(parts, object) {
            Some(kind) => format!("`{object}` is {kind}, which has no vertices"),
            None => format!("the scene has no shape `{object}`"),
        };
        return fail(what, ours());
    };
    if found.next().is_some() {
        return fail(format!("several shapes are called `{object}`"), "give each an id of its own".into());
    }
    if !is_mesh(&shape.kind) {
        return fail(format!("`{object}` is no mesh and has no vertices"), ours());
    }
    if matches!(parts.surfaces[shape.surface], SurfacePart::Null) {
        return fail(
            format!("`{object}` has a null bsdf: vertices of what light passes unchanged are not available yet"),
            "give it another bsdf, or differentiate by a `$parameter` of its to_world".into(),
        );
    }
    Ok(index)
}

impl Scene {
    /// Make slots for the arrays among these names.
    pub fn open(&mut self, desc: &SceneDesc, names: &[String]) -> Result<()> {
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        for name in names.iter().filter(|n| split(n).is_some()) {
            match target(&parts, name)? {
                Target::Vertices(shape) => self.open_vertices(name, shape)?,
                Target::Voxels(medium, quantity) => self.open_voxels(name, medium, quantity)?,
            }
        }
        Ok(())
    }

    /// From then on directions are drawn as where anything can move.
    fn open_vertices(&mut self, name: &str, index: usize) -> Result<()> {
        let s = &mut self.shapes[index];
        let Shape::Mesh(m) = &s.shape else { return Ok(()) };
        if m.normals.is_some() && !s.face_normals {
            let what = format!(
                "`--wrt {name}`: the mesh `{}` is shaded by vertex normals, which its vertices do not carry along yet",
                s.name
            );
            return Err(Error::usage(what, "add <boolean name=\"face_normals\" value=\"true\"/> to the shape"));
        }
        if s.vertices.is_none() {
            let len = 3 * m.vertices.len();
            let first = self.slots.push_array(Owner::Shape(index), &s.name, Quantity::Vertices, len);
            s.vertices = Some(first.ok_or_else(|| too_many(name, m.vertices.len()))?);
        }
        self.prepare_motion();
        Ok(())
    }

    /// Rows (vertices, active voxels) and columns (coordinates, channels) of an array, whether it is open or not.
    pub fn array_shape(&self, target: Target) -> Vec<usize> {
        let shape = match target {
            Target::Vertices(index) => match &self.shapes[index].shape {
                Shape::Mesh(m) => Some([m.vertices.len(), 3]),
                _ => None,
            },
            Target::Voxels(index, quantity) => {
                self.media[index].grid_of(quantity).map(|(g, _)| [g.active_count(), g.channels()])
            }
        };
        shape.map_or(Vec::new(), Vec::from)
    }

    /// The array of this name, of a scene where it is open.
    pub(super) fn array(&self, desc: &SceneDesc, name: &str) -> Result<Array> {
        let target = target(&Parts::read(desc, &desc.values::<f64>())?, name)?;
        let first = match target {
            Target::Vertices(index) => self.shapes[index].vertices,
            Target::Voxels(index, quantity) => {
                self.media[index].grid_of(quantity).map(|(_, first)| first).filter(|&f| f != NO_SLOT)
            }
        };
        match first {
            Some(first) => Ok(Array { name: name.into(), first, shape: self.array_shape(target) }),
            None => Err(Error::usage(
                format!("`--wrt {name}`: an array has a gradient, but no derivative images"),
                "give --loss l2 --target REF.exr, or --adjoint A.exr",
            )),
        }
    }

    /// Positions of an array's vertices in its file, where that has another order.
    pub fn file_order(&self, array: &Array) -> Option<&[u32]> {
        let s = self.shapes.iter().find(|s| s.vertices == Some(array.first))?;
        match &s.shape {
            Shape::Mesh(m) => m.file_order.as_deref(),
            _ => None,
        }
    }
}

pub(super) fn too_many(name: &str, rows: usize) -> Error {
    let what = format!("`--wrt {name}`: {rows} rows are more than can be numbered besides the other arrays");
    Error::usage(what, "differentiate by fewer arrays at a time")
}
