//! The field of velocities that points of media move with: [T] 2.3, (57), (58).
//!
//! Each class of opaque shapes that move alike carries the medium around it along, `V(y) = Σ ψ_k(y) v_k(y)` with
//!
//! `ψ_k = κ(δ_k/R_k) s²/(δ_k² + s²)`, `κ(t) = (1-t²)²` below 1 and 0 beyond, `s = min(δ_s, R_k)`,
//!
//! δ_k the distance to the class, R_k its size, δ_s the distance to everything else that medium points must not cross or leave behind: other
//! opaque shapes, borders of media, lights that stand in them. On the class V is its own velocity, on all else 0, so that no face or border is
//! swept (terms D and N do not arise) and scores of segments stay bounded. Where the class touches something else V
//! has no limit but a bound, and its derivative grows like one over the distance, which is integrable.
//!
//! A mesh whose vertices move is a class of its own, its velocity near it a mix of those of its faces k within twice the distance δ to it, each at its
//! point q_k nearest to y:
//!
//! `v(y) = Σ w_k v_k(q_k) / Σ w_k`, `w_k = (2 - δ_k/δ)²`, δ_k the distance to the face.
//!
//! Toward the inside of a face only that one is left, so that the face is not swept; beside edges and corners weights change by 1/δ, but neighbours differ
//! by no more than δ: v is Lipschitz. Nothing jumps where another face becomes the nearest.
//!
//! A light may be followed likewise: `V = κ(δ/R) ṗ` within the distance R to what stands nearest. A hard-edged spot in a medium needs that: beside its
//! apex its edge and the interior diverge one by one if points stay still.

use super::velocity::{Rate, Source, Velocity};
use crate::error::Result;
use crate::math::nearest::along_triangle;
use crate::math::{DMat3, DVec3};
use crate::params::{ParamSet, Slot};
use crate::scene::geometry::Group;
use crate::scene::nearest::{Kind, Near};
use crate::scene::{Instance, Scene};
use crate::shape::{Bounds, Cube, Geometry, Shape, TriangleMesh};
use smallvec::SmallVec;
use std::fmt;
use std::sync::Arc;

/// What moves alike has one number; what stands still, or is no opaque shape, none. Two fields of velocities are one if four points in
/// general position move alike. A mesh whose vertices move is like no other.
pub fn classes(scene: &Scene, params: &ParamSet) -> Vec<Option<u32>> {
    let probes = scene.bounds.probes();
    let velocities = |s: &Instance| -> Vec<f64> {
        let axes = [DVec3::X, DVec3::Y, DVec3::Z];
        let forms = probes.iter().flat_map(|&p| axes.map(|c| s.mover.forms(p, c)));
        let tangent = |forms: [crate::params::Partial; 4], k: usize| -> f64 {
            forms.iter().flat_map(|f| (0..3).map(move |j| f.v[j] * params.tangents(f.slot + j as Slot)[k])).sum()
        };
        forms.flat_map(|f| (0..params.len()).map(move |k| tangent(f, k))).collect()
    };
    let alike = |a: &[f64], b: &[f64]| {
        let size = a.iter().chain(b).fold(0.0f64, |m, x| m.max(x.abs()));
        a.iter().zip(b).all(|(x, y)| (x - y).abs() <= 1e-9 * size)
    };
    // None is like no other.
    let mut fields: Vec<Option<Vec<f64>>> = Vec::new();
    let class = |s: &Instance| {
        let moves = !scene.is_null(s) && s.moves(params);
        if moves && s.bends(params) {
            fields.push(None);
            return Some(fields.len() as u32 - 1);
        }
        let f = moves.then(|| velocities(s))?;
        let at = fields.iter().position(|g| g.as_ref().is_some_and(|g| alike(&f, g))).unwrap_or_else(|| {
            fields.push(Some(f));
            fields.len() - 1
        });
        Some(at as u32)
    };
    scene.shapes.iter().map(class).collect()
}

/// Share of the scene's radius that a followed light has around it at least: scores grow like one over it.
const ROOM: f64 = 1e-3;

/// `κ(t)` and its slope.
pub fn decay(t: f64) -> (f64, f64) {
    if t >= 1.0 {
        return (0.0, 0.0);
    }
    let s = (1.0 - t) * (1.0 + t);
    (s * s, -4.0 * t * s)
}

/// A light that the medium around it follows.
#[derive(Clone, Copy, Debug)]
struct Follower {
    light: u32,
    p: DVec3,
    /// Up to what stands nearest.
    reach: f64,
}

/// Shapes that move alike.
#[derive(Clone)]
struct Class {
    bounds: Bounds,
    /// R.
    reach: f64,
    /// Whether it is a mesh whose vertices move.
    bends: bool,
    /// The shapes themselves, and what else is opaque or a border within reach of them: in hierarchies of their own, because a nearest point
    /// is not found quickly among many that do not count.
    own: Arc<Group>,
    others: Arc<Group>,
}

impl fmt::Debug for Class {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.debug_struct("Class").field("bounds", &self.bounds).field("reach", &self.reach).finish_non_exhaustive()
    }
}

/// R of a mesh that bends, in edges of its faces. Its velocities change from vertex to vertex, so that V around it is no smoother for a longer reach; and
/// no more than `3π 3²` faces of its size are within 2δ.
const EDGES: f64 = 3.0;

/// Side of a square as large as the median face: fine parts of a mesh count by their faces.
fn edge(mesh: &TriangleMesh) -> f64 {
    let area = |f: u32| {
        let [a, b, c] = mesh.corners(f);
        0.5 * (b - a).cross(c - a).length()
    };
    let mut areas: Vec<f64> = (0..mesh.faces.len() as u32).map(area).filter(|a| *a > 0.0).collect();
    areas.sort_unstable_by(f64::total_cmp);
    areas.get(areas.len() / 2).map_or(0.0, |a| a.sqrt())
}

/// Whether a face has an area, and so a velocity.
fn is_solid(scene: &Scene, shape: u32, face: u32) -> bool {
    corners(scene, shape, face).is_some_and(|[a, b, c]| (b - a).cross(c - a).length_squared() > 0.0)
}

/// Of a mesh's face.
fn corners(scene: &Scene, shape: u32, face: u32) -> Option<[DVec3; 3]> {
    match &scene.shapes[shape as usize].shape {
        Shape::Mesh(m) => Some(m.corners(face)),
        _ => None,
    }
}

/// Gradient of the distance from its point `p` to y.
fn slope_of(y: DVec3, distance: f64, p: DVec3) -> DVec3 {
    if distance > 0.0 { (y - p) / distance } else { DVec3::ZERO }
}

impl Class {
    /// Of the shapes that `own` names.
    fn new(scene: &Scene, own: &dyn Fn(u32) -> bool, bends: bool) -> Result<Class> {
        let shape = |i: u32| &scene.shapes[i as usize];
        let (members, rest): (Vec<u32>, Vec<u32>) = (0..scene.shapes.len() as u32).partition(|&i| own(i));
        let bounds = members.iter().fold(Bounds::EMPTY, |b, &i| b.union(&shape(i).shape.bounds()));
        let meshes = members.iter().filter_map(|&i| match &shape(i).shape {
            Shape::Mesh(m) if bends => Some(EDGES * edge(m)),
            _ => None,
        });
        let reach = meshes.fold(bounds.radius(), f64::min);
        let counts = |&i: &u32| {
            let s = shape(i);
            let gap = s.shape.bounds().gap(&bounds);
            (!scene.is_null(s) || s.boundary) && gap < reach
        };
        let others: Vec<u32> = rest.into_iter().filter(counts).collect();
        let own = Arc::new(Group::build(&scene.shapes, &members)?);
        // Where nothing of the class is within reach V is 0 anyway.
        let others = Arc::new(Group::build_of(&scene.shapes, &others, Some(&|face| face.gap(&bounds) < reach))?);
        Ok(Class { bounds, reach, bends, own, others })
    }

    /// Shares a pull out among the faces of a mesh that bends.
    fn mix(&self, scene: &Scene, y: DVec3, nearest: &Near, whole: &Pull, pulls: &mut Pulls) {
        let d = nearest.distance;
        let mut faces = self.own.faces_within(&scene.shapes, y, 2.0 * d);
        faces.retain(|n| is_solid(scene, n.shape, n.face));
        if faces.is_empty() {
            faces.push(*nearest);
        }
        let toward = slope_of(y, d, nearest.p);
        // w and its gradient.
        let weight = |n: &Near| {
            if d == 0.0 {
                return (1.0, DVec3::ZERO);
            }
            let t = n.distance / d;
            ((2.0 - t).powi(2), (slope_of(y, n.distance, n.p) - toward * t) * (-2.0 * (2.0 - t) / d))
        };
        let weights: Vec<(f64, DVec3)> = faces.iter().map(weight).collect();
        let (sum, slope) = weights.iter().fold((0.0, DVec3::ZERO), |s, w| (s.0 + w.0, s.1 + w.1));
        for (n, (w, dw)) in faces.iter().zip(weights) {
            let share = w / sum;
            pulls.push(Pull {
                source: Source::Shape { shape: n.shape, face: n.face },
                p: n.p,
                weight: whole.weight * share,
                slope: whole.slope * share + (dw - slope * share) * (whole.weight / sum),
                along: Along::Only(corners(scene, n.shape, n.face).map_or([DVec3::ZERO; 2], |c| along_triangle(y, c))),
            });
        }
    }
}

/// Empty in a scene without media: nothing has to follow there.
#[derive(Clone, Debug, Default)]
pub struct Field {
    class_of: Vec<Option<u32>>,
    classes: Vec<Class>,
    followed: Vec<Follower>,
    /// Whether the scene has media at all.
    media: bool,
    /// Lights that stand in media.
    lights: Vec<DVec3>,
    /// Boxes of grids at which their density may end.
    boxes: Vec<Cube>,
}

/// How the matter that pulls a point changes with it.
enum Along {
    /// Matter is asked at the point itself.
    Everywhere,
    /// It is asked at a point near by, whose derivative is `Σ t tᵀ` over these.
    Only([DVec3; 2]),
}

/// A part of the field at a point: of a class, or of a face of one that bends.
struct Pull {
    source: Source,
    /// Where its velocity is asked.
    p: DVec3,
    /// ψ and its gradient.
    weight: f64,
    slope: DVec3,
    along: Along,
}

type Pulls = SmallVec<[Pull; 2]>;

impl Field {
    /// `bending`: shapes whose vertices move; `followed`: lights that move and take the medium around them along.
    pub fn new(scene: &Scene, class_of: Vec<Option<u32>>, bending: &[bool], followed: &[u32]) -> Result<Field> {
        let media = !scene.media.is_empty();
        let count = class_of.iter().flatten().max().map_or(0, |m| m + 1);
        let bends = |id: u32| class_of.iter().zip(bending).any(|(c, b)| *c == Some(id) && *b);
        let class = |id: u32| Class::new(scene, &|i| class_of[i as usize] == Some(id), bends(id));
        let classes = if media { (0..count).map(class).collect::<Result<_>>()? } else { Vec::new() };
        let embedded = |i: &u32| scene.embedded_selection(*i) > 0.0;
        let lights = (0..scene.lights.len() as u32).filter(&embedded);
        let lights = lights.filter_map(|i| scene.lights[i as usize].center()).collect();
        let grids = scene.media.iter().flat_map(|m| m.clipped_grids());
        let boxes = grids.filter_map(|g| Cube::new(g.clip_box()?, false).ok()).collect();
        let mut field = Field { class_of, classes, followed: Vec::new(), media, lights, boxes };
        let follower = |&light: &u32| {
            let p = scene.lights[light as usize].center()?;
            // Every other light that stands in a medium, one at the same place included.
            let others = (0..scene.lights.len() as u32).filter(|i| *i != light && embedded(i));
            let others = others.filter_map(|i| scene.lights[i as usize].center()).collect();
            let free = Field { lights: others, ..field.clone() }.clearance(scene, p, None);
            let size = if scene.bounds.radius() > 0.0 { scene.bounds.radius() } else { 1.0 };
            Some(Follower { light, p, reach: free.min(size) })
        };
        field.followed = followed.iter().filter_map(follower).collect();
        Ok(field)
    }

    /// A light that should be followed but has hardly any room, because it stands on something or beside another light.
    pub fn cornered(&self, scene: &Scene) -> Option<u32> {
        self.followed.iter().find(|f| f.reach < ROOM * scene.bounds.radius()).map(|f| f.light)
    }

    /// Middle and radius of the parts of space whose points may move.
    pub fn regions(&self) -> impl Iterator<Item = (DVec3, f64)> + '_ {
        let shapes = self.classes.iter().map(|c| (c.bounds.center(), c.bounds.radius() + c.reach));
        shapes.chain(self.followed.iter().map(|f| (f.p, f.reach)))
    }

    /// Whether medium points have to follow anything.
    pub fn follows(&self) -> bool {
        self.media
    }

    /// Shapes of one class move alike.
    pub fn class(&self, shape: u32) -> Option<u32> {
        self.class_of[shape as usize]
    }

    /// Of the points that medium points must not cross and that belong to no shape, the nearest within `radius`.
    fn nearest_without_shape(&self, y: DVec3, radius: f64) -> Option<(f64, DVec3)> {
        let points = self.lights.iter().copied().chain(self.boxes.iter().map(|b| b.nearest(y).0));
        let near = points.map(|p| ((y - p).length(), p)).filter(|n| n.0 < radius);
        near.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn pulls(&self, scene: &Scene, y: DVec3) -> Pulls {
        let mut pulls = Pulls::new();
        for class in &self.classes {
            let out = y - y.clamp(class.bounds.min, class.bounds.max);
            if out.length_squared() >= class.reach * class.reach {
                continue;
            }
            let solid = |s, f| !class.bends || is_solid(scene, s, f);
            let Some(near) = class.own.nearest_point(&scene.shapes, y, class.reach, &solid) else { continue };
            let d = near.distance;
            let (k, slope) = decay(d / class.reach);
            let point = self.nearest_without_shape(y, class.reach);
            let limit = point.map_or(class.reach, |n| n.0);
            let shape = class.others.nearest_point(&scene.shapes, y, limit, &|_, _| true);
            let other = shape.map(|n| (n.distance, n.p)).or(point);
            let s = other.map_or(class.reach, |n| n.0);
            let sum = d * d + s * s;
            if sum <= 0.0 || k == 0.0 {
                continue;
            }
            let toward = slope_of(y, d, near.p);
            let away = other.map_or(DVec3::ZERO, |(s, p)| slope_of(y, s, p));
            let share = s * s / sum;
            // share = 1 - d²/sum: by d, and by s.
            let (by_d, by_s) = (-2.0 * d * s * s / (sum * sum), 2.0 * s * d * d / (sum * sum));
            let slope = toward * (slope / class.reach * share + k * by_d) + away * (k * by_s);
            let source = Source::Shape { shape: near.shape, face: near.face };
            let whole = Pull { source, p: y, weight: k * share, slope, along: Along::Everywhere };
            if class.bends {
                class.mix(scene, y, &near, &whole, &mut pulls);
            } else {
                pulls.push(whole);
            }
        }
        for f in &self.followed {
            let off = y - f.p;
            let d = off.length();
            if d < f.reach {
                let (k, slope) = decay(d / f.reach);
                let toward = if d > 0.0 { off / d } else { DVec3::ZERO };
                let (source, along) = (Source::Light(f.light), Along::Only([DVec3::ZERO; 2]));
                pulls.push(Pull { source, p: y, weight: k, slope: toward * (slope / f.reach), along });
            }
        }
        pulls
    }

    /// V at a point of a medium, and its divergence.
    pub fn at(&self, scene: &Scene, y: DVec3) -> (Velocity, Rate) {
        let (mut v, mut rate) = (Velocity::default(), Rate::default());
        for pull in self.pulls(scene, y) {
            let own = Velocity::of(pull.source, pull.p);
            rate.add(&own, pull.slope);
            match (pull.source, pull.along) {
                (Source::Shape { shape, .. }, Along::Everywhere) => rate.add_divergence(shape, pull.weight),
                (source, Along::Only(directions)) => {
                    // Matter is affine: tr(∇v t tᵀ) = <t, v(q+t) - v(q)>.
                    for t in directions.into_iter().filter(|t| *t != DVec3::ZERO) {
                        rate.add(&Velocity::of(source, pull.p + t), t * pull.weight);
                        rate.add(&own, -t * pull.weight);
                    }
                }
                (_, Along::Everywhere) => {}
            }
            v = v.plus(1.0, &own.mapped(DMat3::from_diagonal(DVec3::splat(pull.weight))));
        }
        (v, rate)
    }

    /// The point nearest to `y` of all shapes that move, if it is nearer than `radius`.
    pub fn nearest_moving(&self, scene: &Scene, y: DVec3, radius: f64) -> Option<Near> {
        self.classes.iter().fold(None, |best: Option<Near>, c| {
            let limit = best.map_or(radius, |b| b.distance);
            let near =
                (c.bounds.distance(y) < limit).then(|| c.own.nearest_point(&scene.shapes, y, limit, &|_, _| true));
            near.flatten().or(best)
        })
    }

    /// Radius of a ball around `y` that meets nothing that medium points must not cross, the named face (of a sphere, all of it) excepted.
    pub fn clearance(&self, scene: &Scene, y: DVec3, but: Option<(u32, u32)>) -> f64 {
        let limit = self.nearest_without_shape(y, f64::INFINITY).map_or(f64::INFINITY, |n| n.0);
        let opaque = scene.nearest_point(Kind::Opaque, y, limit, &|s, f| Some((s, f)) != but);
        let limit = opaque.map_or(limit, |n| n.distance);
        let border = scene.nearest_point(Kind::Null, y, limit, &|s, _| scene.shapes[s as usize].boundary);
        border.map_or(limit, |n| n.distance)
    }
}
