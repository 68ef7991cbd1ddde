//! Arrays of numbers as parameters, named `object.array`: `bunny.vertices`. A scene has slots for them once [`Scene::open`] was asked for it.

use super::compile::UNIFORM_SHARE;
use super::desc::suggest;
use super::parts::{Parts, ShapeKind, SurfacePart};
use super::{Scene, SceneDesc};
use crate::error::{Error, Result};
use crate::params::{Array, Owner, Quantity, Slot};
use crate::shape::Shape;

/// The array of vertices.
pub const VERTICES: &str = "vertices";

/// Object and array of a name, which then is no `$parameter`'s.
pub fn split(name: &str) -> Option<(&str, &str)> {
    name.rsplit_once('.')
}

/// An error for an array that cannot be a parameter, whatever the scene is.
pub fn known(name: &str) -> Result<()> {
    match split(name) {
        None | Some((_, VERTICES)) => Ok(()),
        Some((object, array)) => Err(Error::usage(
            format!("`--wrt {name}`: derivatives by `{array}` of `{object}` are not available yet"),
            "give a `$parameter` of the scene (`tyndall info SCENE` lists them), or ID.vertices, ID being the id of an obj or ply shape",
        )),
    }
}

/// The mesh whose vertices `name` means. Refused by name: all other arrays, and meshes whose vertices cannot be parameters.
pub fn mesh(parts: &Parts<f64>, name: &str) -> Result<usize> {
    known(name)?;
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
        let others = [
            ("a medium", parts.media.iter().any(|m| m.name == object)),
            ("an emitter", parts.lights.iter().any(|l| l.name == object)),
            ("a bsdf", parts.surface_names.iter().any(|n| n == object)),
            ("a sensor", parts.sensors.iter().any(|s| s.name == object)),
        ];
        let what = match others.iter().find(|o| o.1) {
            Some((kind, _)) => format!("`{object}` is {kind}, which has no vertices"),
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
    /// Make slots for the arrays among these names. From then on directions are drawn as where anything can move.
    pub fn open(&mut self, desc: &SceneDesc, names: &[String]) -> Result<()> {
        for name in names.iter().filter(|n| split(n).is_some()) {
            let index = mesh(&Parts::read(desc, &desc.values::<f64>())?, name)?;
            let s = &mut self.shapes[index];
            let Shape::Mesh(m) = &s.shape else { continue };
            if m.normals.is_some() && !s.face_normals {
                let what = format!(
                    "`--wrt {name}`: the mesh `{}` is shaded by vertex normals, which its vertices do not carry along yet",
                    s.name
                );
                return Err(Error::usage(what, "add <boolean name=\"face_normals\" value=\"true\"/> to the shape"));
            }
            if self.slots.values.len() + 3 * m.vertices.len() >= Slot::MAX as usize {
                let what = format!("`--wrt {name}`: {} vertices are more than can be numbered", m.vertices.len());
                return Err(Error::usage(what, "differentiate by fewer meshes at a time"));
            }
            if s.vertices.is_none() {
                let values: Vec<f64> = m.vertices.iter().flat_map(|p| p.to_array()).collect();
                s.vertices = Some(self.slots.push_array(Owner::Shape(index), &s.name, Quantity::Vertices, &values));
            }
            self.uniform_share = UNIFORM_SHARE;
        }
        Ok(())
    }

    /// The array of this name, of a scene where it is open.
    pub(super) fn array(&self, desc: &SceneDesc, name: &str) -> Result<Array> {
        let index = mesh(&Parts::read(desc, &desc.values::<f64>())?, name)?;
        match (&self.shapes[index].shape, self.shapes[index].vertices) {
            (Shape::Mesh(m), Some(first)) => Ok(Array { name: name.into(), first, shape: vec![m.vertices.len(), 3] }),
            _ => Err(Error::usage(
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
