//! Shapes as triangles: what has flat faces exactly, a disk or cylinder as the polygon or prism that holds it.

use super::edges::with_corners;
use super::{Bounds, Disk, Geometry, Shape};
use crate::math::DVec3;
use std::f64::consts::{PI, TAU};

/// Corners of a polygon that stands for a circle: larger by 1/cos(π/100) - 1, a half of a thousandth.
const ROUND: usize = 100;

/// With the boxes around them; none of a sphere.
pub fn triangles(s: &Shape) -> Vec<(Bounds, [DVec3; 3])> {
    let mut all = Vec::new();
    let mut fan = |c: &[DVec3]| all.extend((2..c.len()).map(|k| [c[0], c[k - 1], c[k]]));
    match s {
        Shape::Disk(d) => fan(&around_disk(d)),
        Shape::Cylinder(c) => {
            let (x, y) = c.rim_axes();
            let [a, b] = [0, 1].map(|k| around(c.rim(k).0, x, y));
            (0..ROUND).map(|k| [k, (k + 1) % ROUND]).for_each(|[i, j]| fan(&[a[i], a[j], b[j], b[i]]));
        }
        _ => (0..s.face_count()).for_each(|f| _ = with_corners(s, f, &mut fan)),
    }
    all.into_iter().map(|t| (t.into_iter().collect(), t)).collect()
}

/// A polygon that holds a disk.
pub fn around_disk(d: &Disk) -> [DVec3; ROUND] {
    let p = &d.placement;
    around(p.point(DVec3::ZERO), p.vector(DVec3::X), p.vector(DVec3::Y))
}

/// A polygon around the ellipse of these half axes.
pub fn around(c: DVec3, x: DVec3, y: DVec3) -> [DVec3; ROUND] {
    std::array::from_fn(|k| {
        let (sin, cos) = (TAU * k as f64 / ROUND as f64).sin_cos();
        c + (x * cos + y * sin) / (PI / ROUND as f64).cos()
    })
}
