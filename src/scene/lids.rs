//! Disks that close a tube (a cylinder): rods of glass, columns of fog. The two are one body only if they meet along the rim and have the same inside; what does not is told.

use super::parts::{Parts, SurfacePart};
use super::{Instance, Scene};
use crate::error::{Warning, WarningKind};
use crate::math::{DVec3, warp};
use crate::shape::{Geometry, Shape};

/// Rims this near to each other, as a share of the scene's radius, and of a right angle, are one.
pub const WELD: f64 = 1e-9;
/// Rims this near, as a share of the radius, are meant to be one.
const NEAR: f64 = 0.02;
/// Indices that differ by less, relatively, are one.
const SAME: f64 = 1e-9;

/// An end of a tube.
struct End {
    shape: usize,
    middle: DVec3,
    /// Out of the tube, along the axis.
    outward: DVec3,
    radius: f64,
}

/// What lies on one side of a face: the index of refraction, where it is glass, and the medium.
#[derive(PartialEq)]
struct Side {
    index: Option<f64>,
    medium: Option<u32>,
}

/// Lids that do not quite close their tube.
pub fn advise(scene: &Scene, parts: &Parts<f64>) -> Vec<Warning> {
    let counts =
        |s: &Instance| parts.surfaces[s.surface as usize].is_transparent() && (!scene.is_null(s) || s.boundary);
    let mut ends = ends(scene, counts);
    ends.sort_by(|a, b| a.middle.x.total_cmp(&b.middle.x));
    let mut found = Vec::new();
    for lid in scene.shapes.iter().filter(|s| counts(s)) {
        let Shape::Disk(d) = &lid.shape else { continue };
        let (c, x, y) = (d.placement.point(DVec3::ZERO), d.placement.vector(DVec3::X), d.placement.vector(DVec3::Y));
        let (radius, n) = (x.length(), x.cross(y).normalize());
        let slack = NEAR * radius;
        let from = ends.partition_point(|e| e.middle.x < c.x - slack);
        let beside = ends[from..].iter().take_while(|e| e.middle.x <= c.x + slack);
        let off = |e: &End| {
            let radii = (radius - e.radius).abs().max((y.length() - e.radius).abs());
            (e.middle - c).length().max(radii).max(radius * n.cross(e.outward).length())
        };
        let Some((end, off)) = beside.map(|e| (e, off(e))).filter(|e| e.1 <= slack).min_by(|a, b| a.1.total_cmp(&b.1))
        else {
            continue;
        };
        let tube = &scene.shapes[end.shape];
        if let Some((what, hint)) = difference(scene, parts, (lid, tube), end, off) {
            found.push(Warning {
                kind: WarningKind::OpenInterface,
                span: lid.span.clone(),
                what: format!("the disk `{}` closes the cylinder `{}`, but {what}", lid.name, tube.name),
                hint,
            });
        }
    }
    found
}

fn ends(scene: &Scene, counts: impl Fn(&Instance) -> bool) -> Vec<End> {
    let mut list = Vec::new();
    for (shape, s) in scene.shapes.iter().enumerate().filter(|(_, s)| counts(s)) {
        let Shape::Cylinder(c) = &s.shape else { continue };
        list.extend([0, 1].map(|k| {
            let (middle, inward) = c.rim(k);
            End { shape, middle, outward: -inward, radius: c.radius }
        }));
    }
    list
}

/// What keeps a lid and a tube from being one body, and what helps.
fn difference(
    scene: &Scene,
    parts: &Parts<f64>,
    (lid, tube): (&Instance, &Instance),
    end: &End,
    off: f64,
) -> Option<(String, String)> {
    let side =
        |s: &Instance, n: DVec3, inside: DVec3| behind(&parts.surfaces[s.surface as usize], s, n.dot(inside) < 0.0);
    let across = warp::frame(end.outward).0;
    let wall = end.middle + across * end.radius;
    let of_tube = side(tube, tube.shape.normal(0, wall), -across);
    let of_lid = side(lid, lid.shape.normal(0, end.middle), -end.outward);
    // One of glass and one that only parts media: open on purpose, or not.
    if of_tube.index.is_some() != of_lid.index.is_some() {
        return None;
    }
    if off > WELD * scene.bounds.radius() {
        let what = format!("{off:.1e} beside its rim: rays that pass between them leave or enter it unseen");
        return Some((what, "give both the same middle, radius and direction, best by the same to_world".into()));
    }
    if of_tube == of_lid {
        return None;
    }
    let indices = of_tube.index.zip(of_lid.index).filter(|(a, b)| (a - b).abs() > SAME * a.abs());
    if let Some((a, b)) = indices {
        let what = format!("inside of it the index of refraction is {a} by the cylinder and {b} by the disk");
        return Some((
            what,
            "give both the same bsdf; what is behind a disk's normal is its inside (flip_normals turns it)".into(),
        ));
    }
    if of_tube.medium == of_lid.medium {
        return None;
    }
    let name = |m: Option<u32>| m.map_or("no medium".into(), |m| format!("medium `{}`", parts.media[m as usize].name));
    let (a, b) = (name(of_tube.medium), name(of_lid.medium));
    let what = format!("inside of it is {a} by the cylinder and {b} by the disk");
    Some((what, "give both the same <ref name=\"interior\">; what is behind a disk's normal is its inside (flip_normals turns it)".into()))
}

/// What is on the side of a face away from its normal, or on the other.
fn behind(surface: &SurfacePart<f64>, s: &Instance, behind: bool) -> Side {
    let medium = if behind { s.interior } else { s.exterior };
    let smooth = match surface {
        SurfacePart::Rough { smooth, .. } => smooth,
        other => other,
    };
    let index = match smooth {
        SurfacePart::Dielectric { interior, exterior } => Some(if behind { *interior } else { *exterior }),
        _ => None,
    };
    Side { index, medium }
}
