//! Voxels of a medium's grids as arrays: `smoke.sigma_t.grid`, and the same for albedo, emission and temperature.
//!
//! The numbers are the grid's raw values (density before `scale`, emission before `emission_scale`, temperatures before they become kelvin) at its active voxels; an active tile is one number, because one value holds
//! for all of its voxels. What is not active has no slot, whatever light finds there; [`Scene::dilate`] makes its neighbours active.

use super::arrays::{self, Target, kind_of, too_many};
use super::desc::suggest;
use super::parts::{MediumPart, Parts, VolumePart};
use super::{Scene, SceneDesc};
use crate::error::{Error, Result};
use crate::math::{DAffine3, DMat3, DVec3};
use crate::medium::grid::{Field, Filter, Grid};
use crate::medium::{NO_SLOT, Volume};
use crate::native::vdb;
use crate::params::{Array, Owner, Quantity};
use std::sync::Arc;

/// The volume of a medium that carries a quantity.
fn volume(m: &MediumPart<f64>, quantity: Quantity) -> Option<&VolumePart<f64>> {
    match quantity {
        Quantity::SigmaT => Some(&m.density),
        Quantity::Albedo => Some(&m.albedo),
        Quantity::Glow => m.emission.as_ref().filter(|e| e.heat.is_none()).map(|e| &e.volume),
        Quantity::Temperature => m.emission.as_ref().filter(|e| e.heat.is_some()).map(|e| &e.volume),
        _ => None,
    }
}

/// The medium `object`, if a grid of its carries the quantity that `name` asks for. Refused by name: everything else.
pub(super) fn medium(parts: &Parts<f64>, name: &str, object: &str, quantity: Quantity) -> Result<usize> {
    let fail = |what: String, remedy: String| Err(Error::usage(format!("`--wrt {name}`: {what}"), remedy));
    let has_grid = |m: &MediumPart<f64>| volume(m, quantity).is_some_and(|v| v.to_world().is_some());
    let ours = || {
        let names: Vec<&str> = parts.media.iter().filter(|m| has_grid(m)).map(|m| m.name.as_str()).collect();
        match names[..] {
            [] => format!("no medium of the scene has a grid of {}", quantity.name()),
            _ => suggest(object, names.iter().copied()),
        }
    };
    let mut found = parts.media.iter().enumerate().filter(|(_, m)| m.name == object);
    let Some((index, m)) = found.next() else {
        return match kind_of(parts, object) {
            Some(kind) => fail(format!("`{object}` is {kind}, which has no voxels"), ours()),
            None => fail(format!("the scene has no medium `{object}`"), ours()),
        };
    };
    if found.next().is_some() {
        return fail(format!("several media are called `{object}`"), "give each an id of its own".into());
    }
    if has_grid(m) {
        return Ok(index);
    }
    let what = quantity.name();
    let other = match quantity {
        Quantity::Glow => Quantity::Temperature,
        Quantity::Temperature => Quantity::Glow,
        q => q,
    };
    let constant = format!("differentiate by a `$parameter` in place of the {what}");
    match volume(m, quantity) {
        Some(_) => fail(format!("the {what} of `{object}` is constant and has no grid"), constant),
        None if volume(m, other).is_some_and(|v| v.to_world().is_some()) => {
            let name = format!("{object}.{}.grid", other.name());
            fail(format!("`{object}` has no {what}, but a grid of {}", other.name()), format!("give `--wrt {name}`"))
        }
        None => fail(format!("`{object}` has no {what}"), ours()),
    }
}

impl Scene {
    /// Make slots for the active voxels.
    pub(super) fn open_voxels(&mut self, name: &str, index: usize, quantity: Quantity) -> Result<()> {
        let m = &mut self.media[index];
        let owner = m.name.clone();
        let Some((Volume::Grid(g), first)) = m.volume_mut(quantity) else { return Ok(()) };
        if *first != NO_SLOT {
            return Ok(());
        }
        let count = g.active_count();
        if count == 0 {
            let what = format!("`--wrt {name}`: the grid has no active voxel");
            return Err(Error::usage(what, "activate the voxels that are to be parameters, at density 0 if need be"));
        }
        let slots = self.slots.push_array(Owner::Medium(index), &owner, quantity, count * g.channels());
        *first = slots.ok_or_else(|| too_many(name, count))?;
        Ok(())
    }

    /// Make the neighbours of active voxels active, in the grids among these arrays: before they are opened.
    pub fn dilate(&mut self, desc: &SceneDesc, names: &[String]) -> Result<()> {
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        for name in names.iter().filter(|n| arrays::is_voxels(n)) {
            let Target::Voxels(index, quantity) = arrays::target(&parts, name)? else { continue };
            let Some((Volume::Grid(g), _)) = self.media[index].volume_mut(quantity) else { continue };
            let wider = g
                .dilated()
                .map_err(|what| Error::usage(format!("`--wrt {name}`: dilated, {what}"), "leave out --dilate"))?;
            *g = Arc::new(wider);
        }
        Ok(())
    }

    /// Numbers of an array of voxels (of [`Array::shape`], row by row) as a grid like the one they belong to: the transform of its file, so that the
    /// volume's `to_world` places both alike, its leaves, its tiles. `None`: another kind of array.
    pub fn in_grid(&self, desc: &SceneDesc, array: &Array, numbers: &[f64]) -> Result<Option<vdb::WriteGrid>> {
        if !arrays::is_voxels(&array.name) {
            return Ok(None);
        }
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        let Target::Voxels(index, quantity) = arrays::target(&parts, &array.name)? else { return Ok(None) };
        let Some((g, _)) = self.media[index].grid_of(quantity) else { return Ok(None) };
        let (world_from_index, _) = source(&parts, index, quantity, g)?;
        let (leaves, tiles) = g.in_leaves(numbers);
        Ok(Some(vdb::WriteGrid {
            name: array.name.clone(),
            channels: g.channels(),
            world_from_index,
            background: 0.0,
            leaves,
            tiles,
            class: "unknown".into(),
            half: false,
        }))
    }

    /// Where an array of voxels is, with its values: what an optimiser sets again and again by [`Scene::set_voxels`]. `None`: another kind of array.
    pub fn voxels(&self, desc: &SceneDesc, name: &str) -> Result<Option<Voxels>> {
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        let Target::Voxels(medium, quantity) = arrays::target(&parts, name)? else { return Ok(None) };
        let Some((g, _)) = self.media[medium].grid_of(quantity) else { return Ok(None) };
        if let Some(VolumePart::Vdb { file, span, .. }) = volume(&parts.media[medium], quantity) {
            // What is written has one grid, of fog.
            if file.fog {
                return Err(Error::scene(
                    span,
                    format!("`{name}` is fog made of a level set: a file of fog could not stand in for it"),
                    "convert the level set to a fog volume first, and read that without level_set",
                ));
            }
        }
        Ok(Some(Voxels { medium, quantity, field: g.field() }))
    }

    /// Index position of every voxel of a field (of an active tile its middle), and whether it is a tile.
    pub fn active_positions(&self, v: &Voxels) -> Vec<([i32; 3], bool)> {
        self.media[v.medium].grid_of(v.quantity).map_or(Vec::new(), |(g, _)| g.active_positions())
    }

    /// Put the values of a field into its medium's grid: bricks and majorants are made anew, all else of the scene stays,
    /// nothing is compiled. Errors: a field of another grid.
    pub fn set_voxels(&mut self, v: &Voxels) -> Result<()> {
        let m = &mut self.media[v.medium];
        let Some((g, _)) = m.grid_of(v.quantity) else { return Ok(()) };
        let new = g.with_field(&v.field).map_err(|what| Error::Runtime(format!("medium `{}`: {what}", m.name)))?;
        m.set_grid(v.quantity, new);
        self.prepare_bright();
        Ok(())
    }

    /// A field as a grid that can stand in for the file it came from: its name, class, transform, topology, and what is not active as it was. Of a .vol:
    /// named `density`, in the unit cube.
    pub fn stand_in(&self, desc: &SceneDesc, v: &Voxels) -> Result<vdb::WriteGrid> {
        let parts = Parts::read(desc, &desc.values::<f64>())?;
        let Some((g, _)) = self.media[v.medium].grid_of(v.quantity) else {
            return Err(Error::Runtime("an array of voxels lost its grid".into()));
        };
        let (world_from_index, info) = source(&parts, v.medium, v.quantity, g)?;
        let (leaves, tiles) = g.stored_leaves(&v.field);
        let (name, class) = info.map_or(("density".into(), "fog volume".into()), |i| (i.name, i.class));
        Ok(vdb::WriteGrid {
            name,
            channels: g.channels(),
            world_from_index,
            background: g.background()[0],
            leaves,
            tiles,
            class,
            half: false,
        })
    }
}

/// An array of voxels with its values.
#[derive(Clone, Debug)]
pub struct Voxels {
    medium: usize,
    quantity: Quantity,
    pub field: Field,
}

/// The transform of the file that a grid came from (before the volume's `to_world`; of a .vol the unit cube), and what a .vdb says of it.
fn source(
    parts: &Parts<f64>,
    medium: usize,
    quantity: Quantity,
    g: &Grid,
) -> Result<(DAffine3, Option<vdb::GridInfo>)> {
    if let Some(VolumePart::Vdb { file, .. }) = volume(&parts.media[medium], quantity) {
        let info = vdb::info(&file.path, &file.select)?;
        return Ok((info.world_from_index, Some(info)));
    }
    let shift = if g.filter() == Filter::Trilinear { 0.5 } else { 0.0 };
    let size = DVec3::from(g.resolution().map(|n| n as f64));
    Ok((DAffine3 { matrix3: DMat3::from_diagonal(size.recip()), translation: shift / size }, None))
}
