//! Disks that close a tube (a cylinder): rods of glass, columns of fog. The two are one body only if they meet along the rim and have the same inside; what does not is told.

use super::parts::{Parts, SurfacePart};
use super::{Instance, Scene};
use crate::error::{Warning, WarningKind};
use crate::math::{DVec3, warp};
use crate::shape::{Geometry, Shape};

/// Rims this near to each other, as a share of the scene's radius, and of a right angle, are one.
pub const WELD: f64 = 1e-9;
/// Rims this near, as a share of the radius, are meant to be one.
const NEAR: f64 = 0.2;
/// Indices that differ by less, relatively, are one.
const SAME: f64 = 1e-9;

/// An end of a tube.
struct End {
    middle: DVec3,
    /// Out of the tube, along the axis.
    outward: DVec3,
    radius: f64,
}

/// What lies on one side of a face: the index of refraction, where it is glass, and the medium.
struct Side {
    index: Option<f64>,
    medium: Option<u32>,
}

/// A disk that may close one.
struct Lid {
    shape: usize,
    middle: DVec3,
    normal: DVec3,
    /// Of both axes.
    radii: [f64; 2],
}

impl Lid {
    fn of(shape: usize, s: &Instance) -> Option<Lid> {
        let Shape::Disk(d) = &s.shape else { return None };
        let (middle, x, y) =
            (d.placement.point(DVec3::ZERO), d.placement.vector(DVec3::X), d.placement.vector(DVec3::Y));
        Some(Lid { shape, middle, normal: x.cross(y).normalize(), radii: [x.length(), y.length()] })
    }

    /// How far it is from the end of a tube, at most, anywhere along the rim.
    fn off(&self, end: &End) -> f64 {
        let radii = self.radii.map(|r| (r - end.radius).abs());
        let tilt = end.radius * self.normal.cross(end.outward).length();
        (self.middle - end.middle).length().max(radii[0]).max(radii[1]).max(tilt)
    }
}

/// Tubes whose lids do not quite close them, and those with a lid at one end alone.
pub fn advise(scene: &Scene, parts: &Parts<f64>) -> Vec<Warning> {
    let transparent = |s: &Instance| parts.surfaces[s.surface as usize].is_transparent();
    let mut lids: Vec<Lid> = (0..).zip(&scene.shapes).filter_map(|(i, s)| Lid::of(i, s)).collect();
    lids.sort_by(|a, b| a.middle.x.total_cmp(&b.middle.x));
    let weld = WELD * scene.bounds.radius();
    let mut found = Vec::new();
    let mut warn = |s: &Instance, what: String, hint: String| {
        let (kind, span) = (WarningKind::OpenInterface, s.span.clone());
        found.push(Warning { kind, span, what, hint });
    };
    for tube in &scene.shapes {
        let Shape::Cylinder(c) = &tube.shape else { continue };
        if !transparent(tube) || scene.is_null(tube) && !tube.boundary {
            continue;
        }
        let nearest = [0, 1].map(|k| {
            let (middle, inward) = c.rim(k);
            let end = End { middle, outward: -inward, radius: c.radius };
            let slack = NEAR * c.radius;
            let from = lids.partition_point(|l| l.middle.x < middle.x - slack);
            let beside = lids[from..].iter().take_while(|l| l.middle.x <= middle.x + slack);
            let near = beside.map(|l| (l, l.off(&end))).filter(|l| l.1 <= slack);
            // Of rods that stand on each other each has its own.
            let fits = |(l, _): &(&Lid, f64)| {
                let lid = &scene.shapes[l.shape];
                transparent(lid) && difference(scene, parts, (lid, tube), &end, 0.0).is_none()
            };
            let first = |a: &(&Lid, f64), b: &(&Lid, f64)| match a.1.max(b.1) <= weld {
                true => fits(b).cmp(&fits(a)),
                false => a.1.total_cmp(&b.1),
            };
            near.min_by(first).map(|(l, off)| (l, off, end))
        });
        for (l, off, end) in nearest.iter().flatten() {
            let lid = &scene.shapes[l.shape];
            if !transparent(lid) {
                continue;
            }
            if let Some((what, hint)) = difference(scene, parts, (lid, tube), end, *off) {
                warn(lid, format!("the disk `{}` closes the cylinder `{}`, but {what}", lid.name, tube.name), hint);
            }
        }
        if let [Some((l, off, _)), None] | [None, Some((l, off, _))] = &nearest {
            let lid = &scene.shapes[l.shape];
            if *off <= weld && transparent(lid) {
                let what = format!(
                    "the disk `{}` closes one end of the cylinder `{}`, the other is open: rays that pass there leave or enter it unseen",
                    lid.name, tube.name
                );
                warn(tube, what, "close both with disks of the same bsdf and media, or none".into());
            }
        }
    }
    found
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
