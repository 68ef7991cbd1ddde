//! Points beside the first vertex of a path.
//!
//! The film holds the first vertex x, so it moves otherwise than matter near by, by as much as it likes: the score of a segment from x to a
//! point z close to it grows like 1/d. Camera rays come close to spheres so often (at distance δ with density δ^1/2) that its second moment has no bound; neither has
//! it where x lies on a face beside a hollow crease, or on a floor beside what stands on it: z is then seen at any distance. So z,
//! if it comes right after x, keeps to its direction from x instead of to its matter where it is near ([T] 2.3 (i)):
//!
//! `ż = ż_B + χ Q Δ`, `Δ = ẋ - v(x) - C(z)`, `Q = 1 - w nᵀ/<n,w>`, `χ = κ(d/ρ)`
//!
//! (ż_B: as it would move otherwise, with its matter, v, and with what x carries it by, C; Δ: what x does on top of v, there, less C; if x lies on the same shape v is the
//! matter of its own face). A direction's measure dω = dA c_z/d² does not change where x moves by Δ and z by QΔ, so that segment and Jacobian
//! together score what they would with v alone (nothing, if that is rigid), `1-χ` of what Δ and C score, and `<∇χ, QΔ>`.
//!
//! ρ is the distance from x to the nearest place over which such points would flow: to the horizon that x sees on a sphere (<n,w> is 0 there), and to the border of a
//! flat face (where another flat face that moves alike passes through it, to that line as well; of shapes that others cut otherwise, nowhere: where they do is no border that anyone knows); on a sphere at most the radius R. A border that lies in the plane of x's own face is none: light goes there at a cosine of 0 (whatever a surface that is not diffuse reflects at grazing must vanish with it, too). On
//! a cylinder's wall χ has a factor besides that is 0 at those rims that do not lie so: `κ(|2h/l - 1|)` where none does, `κ(h'/l)` where one does, h and h'
//! the heights of z over the base and over that rim, l the length.
//!
//! Where x lies on a rough surface, its lobe scores much more than 1/d as the direction turns: one over its width, which is about its roughness α. A point of a sphere, or of a cylinder's wall,
//! then keeps to its direction at any distance, if all of the shape is large in the lobe (`α D < R`, D from x to its centre or axis; x alone decides, so that nothing is swept where that changes): in place of χ
//! `1 - (1-χ) κ(|<n,w>|/c₀)`, which is 0 at the horizon too.

use super::field::decay;
use super::piece::{onto, outer};
use crate::math::nearest::to_segment;
use crate::math::{DMat3, DVec3};
use crate::shape::edges::{is_same_plane, lies_in_plane, to_border_off};
use crate::shape::{Cylinder, Shape};
use rstar::{AABB, PointDistance, RTree, RTreeObject};
use std::collections::HashMap;

/// Where faces end besides their own borders: where others pass through them.
#[derive(Clone, Debug, Default)]
pub struct InnerBorders {
    /// Shapes that others pass through along curves that nobody knows.
    unknown: Vec<bool>,
    /// Of faces (shape, face).
    faces: HashMap<(u32, u32), Lines>,
}

/// Lines across a face.
#[derive(Clone, Debug)]
struct Lines {
    /// Of the face: a point, and the normal.
    plane: [DVec3; 2],
    tree: RTree<Line>,
}

#[derive(Clone, Debug)]
struct Line([DVec3; 2]);

impl RTreeObject for Line {
    type Envelope = AABB<[f64; 3]>;

    fn envelope(&self) -> Self::Envelope {
        AABB::from_corners(self.0[0].to_array(), self.0[1].to_array())
    }
}

impl PointDistance for Line {
    fn distance_2(&self, p: &[f64; 3]) -> f64 {
        to_segment(DVec3::from(*p), self.0[0], self.0[1]).powi(2)
    }
}

impl InnerBorders {
    /// Of a scene of so many shapes; `lines` across faces, with their normals.
    pub fn new(
        shapes: usize,
        unknown: impl Iterator<Item = u32>,
        lines: impl Iterator<Item = ((u32, u32), DVec3, [DVec3; 2])>,
    ) -> InnerBorders {
        let mut all = InnerBorders { unknown: vec![false; shapes], faces: HashMap::new() };
        unknown.for_each(|i| all.unknown[i as usize] = true);
        let mut by_face: HashMap<(u32, u32), (DVec3, Vec<Line>)> = HashMap::new();
        for (face, n, line) in lines {
            by_face.entry(face).or_insert((n, Vec::new())).1.push(Line(line));
        }
        let of_face = |(n, lines): (DVec3, Vec<Line>)| {
            let plane = [lines[0].0[0], n];
            Lines { plane, tree: RTree::bulk_load(lines) }
        };
        all.faces = by_face.into_iter().map(|(face, lines)| (face, of_face(lines))).collect();
        all
    }

    /// From x to the nearest of a face that does not lie in the plane through x with this normal; `None` where they are not known.
    pub fn distance(&self, [shape, face]: [u32; 2], x: DVec3, plane: Option<DVec3>) -> Option<f64> {
        if self.unknown.get(shape as usize).copied().unwrap_or(false) {
            return None;
        }
        // Of nearly all scenes.
        if self.faces.is_empty() {
            return Some(f64::INFINITY);
        }
        let lines = self.faces.get(&(shape, face));
        // All of a face that lies there do.
        let lines = lines.filter(|l| plane.is_none_or(|m| !is_same_plane(l.plane, [x, m])));
        let counts = |line: &&Line| plane.is_none_or(|m| !line.0.iter().all(|y| lies_in_plane(*y, x, m)));
        let nearest = lines.and_then(|l| l.tree.nearest_neighbor_iter([x.x, x.y, x.z]).find(counts));
        Some(nearest.map_or(f64::INFINITY, |line| to_segment(x, line.0[0], line.0[1])))
    }
}

/// c₀: the noise of scores is least (of `scenes/tank`, by where its ball is; 0.5 to 1 differ by 10 %).
const FACING: f64 = 0.75;

/// The first vertex.
#[derive(Clone, Copy, Debug)]
pub struct Origin {
    pub x: DVec3,
    /// The normal there, where it lies on a surface.
    pub plane: Option<DVec3>,
    /// How rough that is, where it is.
    pub alpha: Option<f64>,
    /// To the nearest of [`InnerBorders`].
    pub inner: f64,
}

/// How a point is held to its direction from the first vertex.
#[derive(Clone, Copy, Debug)]
pub struct Attached {
    /// χ.
    pub share: f64,
    /// `χ Q`, on Δ.
    pub map: DMat3,
    /// The form on Δ that χ's own change gives.
    pub form: DVec3,
}

impl Attached {
    /// For a point z of a face, n its normal. `None` out of reach.
    pub fn new(shape: &Shape, face: u32, from: Origin, z: DVec3, n: DVec3) -> Option<Attached> {
        let Origin { x, plane, alpha, inner } = from;
        // The radius, and how far x is from the middle.
        let round = match shape {
            Shape::Sphere(s) => Some((s.radius, (x - s.center).length())),
            Shape::Cylinder(s) => Some((s.radius, s.from_axis(x).length())),
            _ => None,
        };
        let reach = match round {
            Some((r, middle)) => {
                let horizon = middle * middle - r * r;
                // From inside there is none; a point of the shape itself sees none, whatever its rounding.
                if horizon > 1e-9 * r * r { r.min(horizon.sqrt()) } else { r }
            }
            None => to_border_off(shape, face, x, plane),
        }
        .min(inner);
        let d = (z - x).length();
        if d <= 0.0 {
            return None;
        }
        let w = (z - x) / d;
        let (mut share, slope) = decay(d / reach);
        // ∇χ, along the surface.
        let mut gradient = w * (slope / reach);
        if round.zip(alpha).is_some_and(|((r, middle), alpha)| alpha * middle < r) {
            let c = n.dot(w);
            let (kept, slope) = decay(c.abs() / FACING);
            let turned = shape.curvature(z, n) * w - w * (c / d);
            gradient = gradient * kept - turned * ((1.0 - share) * slope * c.signum() / FACING);
            share = 1.0 - (1.0 - share) * kept;
        }
        if share <= 0.0 {
            return None;
        }
        let q = onto(n, w);
        if let Shape::Cylinder(s) = shape {
            let (fade, slope) = rims(s, x, plane, z);
            gradient = gradient * fade + s.axis * (share * slope);
            share *= fade;
        }
        let form = q.transpose() * gradient;
        let map = q * share;
        (map + outer(form, form)).is_finite().then_some(Attached { share, map, form })
    }
}

/// The factor that keeps points of a wall off its rims, and its slope along the axis.
fn rims(s: &Cylinder, x: DVec3, plane: Option<DVec3>, z: DVec3) -> (f64, f64) {
    let (h, l) = (s.height(z), s.length);
    // Whether the floor that x lies on is that of a rim.
    let stands = |height: f64| {
        plane.is_some_and(|n| n.cross(s.axis).length() <= 1e-9 && (s.height(x) - height).abs() <= 1e-9 * l)
    };
    let (t, dt) = match (stands(0.0), stands(l)) {
        (true, false) => (h / l, 1.0 / l),
        (false, true) => (1.0 - h / l, -1.0 / l),
        _ => ((2.0 * h / l - 1.0).abs(), (2.0 * h / l - 1.0).signum() * 2.0 / l),
    };
    let (fade, slope) = decay(t.max(0.0));
    (fade, slope * dt)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;
    use crate::shape::Sphere;
    use glam::DAffine3;

    /// Points of a wall that flow by χQΔ while x stays flow nowhere else: what integrals over it change by is nothing. With
    /// `div QΔ + <QΔ, ∇ ln(c/d²)> = -<Δ, ∂ ln(c/d²)/∂x>` that is `∫ (<∇χ, QΔ> - χ <Δ, ∂ ln(c/d²)/∂x> + <∇g, χQΔ>/g) g c/d² dA = 0`, on either side of the horizon.
    #[test]
    fn nothing_flows_off_a_round_wall() {
        let (r, l) = (0.5, 1.3);
        let ball = Shape::Sphere(Sphere::new(DVec3::new(0.1, -0.2, 0.3), r, DAffine3::IDENTITY, false).unwrap());
        let tube = DAffine3::from_rotation_x(0.4) * DAffine3::from_scale(DVec3::new(r, r, l));
        let tube = Shape::Cylinder(Cylinder::new(tube, false).unwrap());
        let mut rng = Rng::keyed(4, 3, 2, 1);
        for (shape, alpha) in [(&ball, Some(0.1)), (&ball, None), (&tube, Some(0.1)), (&tube, None)] {
            for outside in [true, false] {
                let unit = |rng: &mut Rng| DVec3::from([(); 3].map(|()| 2.0 * rng.uniform() - 1.0)).normalize();
                let far = if outside { 1.2 + rng.uniform() } else { 0.3 };
                let (x, delta, tilt) = match shape {
                    Shape::Cylinder(s) => {
                        let across = s.axis.cross(unit(&mut rng)).normalize();
                        (s.base + s.axis * (0.9 * l) + across * (far * r), unit(&mut rng), unit(&mut rng))
                    }
                    Shape::Sphere(s) => (s.center + unit(&mut rng) * (far * r), unit(&mut rng), unit(&mut rng)),
                    _ => unreachable!(),
                };
                let (n_u, n_v) = (800, 800);
                let (mut sum, mut size) = ([0.0; 2], [0.0; 2]);
                for k in 0..n_u * n_v {
                    let (u, v) = ((k % n_u) as f64 + 0.5, (k / n_u) as f64 + 0.5);
                    let (u, v) = (u / n_u as f64, v / n_v as f64);
                    let (sin, cos) = (std::f64::consts::TAU * u).sin_cos();
                    let (z, n) = match shape {
                        Shape::Cylinder(s) => {
                            let a = s.axis.any_orthonormal_vector();
                            let n = a * cos + s.axis.cross(a) * sin;
                            (s.base + s.axis * (l * v) + n * r, n)
                        }
                        Shape::Sphere(s) => {
                            let h: f64 = 2.0 * v - 1.0;
                            let n = DVec3::new((1.0 - h * h).sqrt() * cos, (1.0 - h * h).sqrt() * sin, h);
                            (s.center + n * r, n)
                        }
                        _ => unreachable!(),
                    };
                    let from = Origin { x, plane: None, alpha, inner: f64::INFINITY };
                    let Some(a) = Attached::new(shape, 0, from, z, n) else { continue };
                    let d = (z - x).length();
                    let (w, c) = ((z - x) / d, n.dot((z - x) / d));
                    let by_x = (w * c - n) / (d * c) + w * (2.0 / d);
                    let rate = a.form.dot(delta) - a.share * delta.dot(by_x) + tilt.dot(a.map * delta);
                    let f = (tilt.dot(z)).exp() * c.abs() / (d * d);
                    let side = usize::from(c > 0.0);
                    sum[side] += f * rate;
                    size[side] += (f * rate).abs();
                }
                (0..2).for_each(|s| assert!(sum[s].abs() <= 1e-4 * size[s], "{alpha:?} {outside} {sum:?} {size:?}"));
            }
        }
    }

    #[test]
    fn the_nearest_line_is_that_of_a_search_of_all() {
        let mut rng = Rng::keyed(1, 2, 3, 4);
        let mut point = |height: f64| DVec3::new(4.0 * rng.uniform(), 4.0 * rng.uniform(), height * rng.uniform());
        let lines: Vec<[DVec3; 2]> = (0..200).map(|k| [k, k + 1].map(|k| point(f64::from(k % 3 != 0)))).collect();
        let across = |n: DVec3| {
            let of_face = lines.iter().map(move |l| ((0, 7), n, *l));
            InnerBorders::new(2, [1].into_iter(), of_face.collect::<Vec<_>>().into_iter())
        };
        let borders = across(DVec3::Y);
        let brute = |x: DVec3, counts: &dyn Fn(&[DVec3; 2]) -> bool| {
            let kept = lines.iter().filter(|l| counts(l));
            kept.map(|[a, b]| to_segment(x, *a, *b)).fold(f64::INFINITY, f64::min)
        };
        let mut rng = Rng::keyed(5, 6, 7, 8);
        let floor = InnerBorders::new(1, [].into_iter(), [((0, 0), DVec3::Z, [DVec3::X, DVec3::Y])].into_iter());
        for _ in 0..500 {
            let x = 4.0 * DVec3::new(rng.uniform(), rng.uniform(), rng.uniform() - 0.5);
            assert_eq!(borders.distance([0, 7], x, None), Some(brute(x, &|_| true)));
            assert_eq!(borders.distance([0, 8], x, None), Some(f64::INFINITY));
            assert_eq!(borders.distance([1, 0], x, None), None);
            // From a floor, lines that lie in it do not count.
            let x = x.with_z(0.0);
            let off_floor = |l: &[DVec3; 2]| l.iter().any(|p| p.z != 0.0);
            assert_eq!(borders.distance([0, 7], x, Some(DVec3::Z)), Some(brute(x, &off_floor)));
            let to_line = to_segment(x, DVec3::X, DVec3::Y);
            let tilted = |by: f64| DVec3::new(by, by, 1.0).normalize();
            assert_eq!(floor.distance([0, 0], x, Some(-DVec3::Z)), Some(f64::INFINITY));
            assert!(floor.distance([0, 0], x + 1e-6 * DVec3::Z, Some(DVec3::Z)).is_some_and(f64::is_finite));
            assert_eq!(floor.distance([0, 0], x, Some(tilted(1e-10))), Some(f64::INFINITY));
            assert_eq!(floor.distance([0, 0], x, Some(tilted(1e-4))), Some(to_line));
        }
    }
}
