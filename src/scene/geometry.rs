//! Where rays meet the scene. Opaque surfaces and null interfaces are kept apart: shadow rays ask Embree only for what
//! can block them, and null boundaries of simple form are solved directly, out of Embree.
//!
//! A ray knows the faces that it starts on ([`On`]). A face within rounding of the origin counts if the bookkeeping of media says
//! so: a null interface is entered only from its outside medium and left only from its inside one. So
//! coincident interfaces, cameras on a boundary and fog boxes that touch walls need no offset.

use super::{Instance, Scene, effort};
use crate::error::Result;
use crate::light::Arrival;
use crate::math::DVec3;
use crate::native::embree::{Bvh, Ray, SceneBuilder, UserPrimitives};
use crate::shape::bounds::Bounds;
use crate::shape::edges::with_corners;
use crate::shape::{Geometry, Shape, Start};
use crate::surface::Normals;
use std::sync::Arc;

/// A point where a ray meets a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance along the unit direction.
    pub t: f64,
    pub p: DVec3,
    /// Geometric normal, unit, on the front side.
    pub n: DVec3,
    /// Shading normal, unit.
    pub ns: DVec3,
    pub shape: u32,
    pub face: u32,
}

impl Hit {
    pub fn normals(&self) -> Normals {
        Normals { face: self.n, shading: self.ns }
    }
}

/// Faces that a ray's origin lies on.
#[derive(Clone, Copy, Debug, Default)]
pub struct On {
    faces: [(u32, u32); 4],
    len: u8,
    /// Whatever else lies within rounding of the origin is behind it.
    alone: bool,
}

impl On {
    /// On one face only.
    pub fn at(hit: &Hit) -> Self {
        On { faces: [(hit.shape, hit.face); 4], len: 1, alone: false }
    }

    /// On one face, on the side that is turned away from all that coincides with it.
    pub fn inside(hit: &Hit) -> Self {
        On { alone: true, ..On::at(hit) }
    }

    /// After passing through an interface along w: the faces passed at the same point are remembered together.
    pub fn crossed(&self, hit: &Hit, w: DVec3, tolerance: f64) -> Self {
        if !self.reaches(hit, w, tolerance) || self.len == 4 {
            return On::at(hit);
        }
        let mut on = *self;
        on.faces[on.len as usize] = (hit.shape, hit.face);
        on.len += 1;
        on
    }

    /// Whether a ray along w from these faces meets this one at their own point, but for rounding.
    pub fn reaches(&self, hit: &Hit, w: DVec3, tolerance: f64) -> bool {
        let near = hit.t <= tolerance || hit.t <= tolerance * GRAZING && hit.t * hit.n.dot(w).abs() <= tolerance;
        near && self.len > 0
    }

    /// The face of `shape` that the origin lies on.
    fn face(&self, shape: u32) -> Option<u32> {
        self.faces[..self.len as usize].iter().rev().find(|f| f.0 == shape).map(|f| f.1)
    }

    /// The face that it came to last.
    pub fn last(&self) -> Option<(u32, u32)> {
        self.iter().next()
    }

    fn iter(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.faces[..self.len as usize].iter().rev().copied()
    }
}

/// What an Embree geometry stands for.
enum Entry {
    /// A mesh: the primitive is the face.
    Mesh(u32),
    /// Analytic shapes, or a part of a mesh: a primitive is one face of one shape.
    Faces(Vec<(u32, u32)>),
}

/// Shapes of one kind (opaque or null): meshes in Embree; analytic shapes in a list while they are few, in Embree as user
/// geometry when they are many.
#[derive(Default)]
pub struct Group {
    pub(super) bvh: Option<Bvh>,
    entries: Vec<Entry>,
    /// Shape -> Embree geometry; `u32::MAX` where it is not in Embree.
    geometry_of: Vec<u32>,
    pub(super) simple: Vec<u32>,
    /// Their faces, with boxes around them.
    pub(super) simple_faces: Vec<(u32, u32, Bounds)>,
}

/// More analytic shapes than this go into Embree.
const LISTED: usize = 8;

/// Faces of analytic shapes for Embree.
struct Faces(Vec<(Shape, u32)>);

impl UserPrimitives for Faces {
    fn intersect(&self, prim: u32, ray: &Ray, t_min: f64, t_max: f64) -> Option<(f64, [f64; 2])> {
        let (shape, face) = &self.0[prim as usize];
        let start = ray.exclude.map(|_| Start { face: *face });
        let found = match shape {
            // One face of a cube: the crossing that lies on it.
            Shape::Cube(c) if start.is_none() => {
                c.crossings(ray.o, ray.d)?.into_iter().find(|h| h.face == *face && h.t > t_min && h.t < t_max)?
            }
            Shape::Cube(_) => return None,
            s => s.intersect(ray.o, ray.d, t_min, t_max, start)?,
        };
        Some((found.t, found.uv.into()))
    }

    fn nearest(&self, prim: u32, p: DVec3) -> DVec3 {
        let (shape, face) = &self.0[prim as usize];
        shape.nearest_on_face(*face, p)
    }
}

impl Group {
    /// Shapes (by index) of one kind.
    pub fn build(shapes: &[Instance], members: &[u32]) -> Result<Group> {
        Group::build_of(shapes, members, None)
    }

    /// The same, for nearest points: of meshes only faces in boxes that `keep` wants.
    pub fn build_of(shapes: &[Instance], members: &[u32], keep: Option<&dyn Fn(&Bounds) -> bool>) -> Result<Group> {
        let mut group = Group::default();
        let (mut meshes, mut simple) = (Vec::new(), Vec::new());
        for &i in members {
            let list = if matches!(shapes[i as usize].shape, Shape::Mesh(_)) { &mut meshes } else { &mut simple };
            list.push(i);
        }
        let listed = simple.len() <= LISTED;
        if listed {
            for &i in &simple {
                let shape = &shapes[i as usize].shape;
                let bounds =
                    |f| with_corners(shape, f, |c| c.iter().copied().collect()).unwrap_or_else(|| shape.bounds());
                group.simple_faces.extend((0..shape.face_count()).map(|f| (i, f, bounds(f))));
            }
            group.simple = std::mem::take(&mut simple);
        }
        if meshes.is_empty() && simple.is_empty() {
            return Ok(group);
        }
        let mut builder = SceneBuilder::new()?;
        group.geometry_of = vec![u32::MAX; shapes.len()];
        for i in meshes {
            if let Shape::Mesh(m) = &shapes[i as usize].shape {
                let around = |f: u32| m.corners(f).iter().fold(Bounds::EMPTY, |b, c| b.with_point(*c));
                let kept = |f: &u32| keep.is_none_or(|keep| keep(&around(*f)));
                let mut all = 0..m.faces.len() as u32;
                let (faces, entry) = if keep.is_none() || all.all(|f| kept(&f)) {
                    (m.faces.clone(), Entry::Mesh(i))
                } else {
                    let part: Vec<u32> = (0..m.faces.len() as u32).filter(kept).collect();
                    let faces = part.iter().map(|&f| m.faces[f as usize]).collect();
                    (faces, Entry::Faces(part.into_iter().map(|f| (i, f)).collect()))
                };
                group.geometry_of[i as usize] = builder.add_triangles(m.vertices.clone(), faces)?;
                group.entries.push(entry);
            }
        }
        if !simple.is_empty() {
            let mut faces = Vec::new();
            for i in simple {
                faces.extend((0..shapes[i as usize].shape.face_count()).map(|f| (i, f)));
            }
            let prims: Vec<(Shape, u32)> = faces.iter().map(|&(i, f)| (shapes[i as usize].shape.clone(), f)).collect();
            let bounds = prims.iter().map(|(s, _)| (s.bounds().min, s.bounds().max)).collect();
            let geom = builder.add_user(bounds, Arc::new(Faces(prims)))?;
            faces.iter().for_each(|f| group.geometry_of[f.0 as usize] = geom);
            group.entries.push(Entry::Faces(faces));
        }
        group.bvh = Some(builder.commit()?);
        Ok(group)
    }

    fn is_empty(&self) -> bool {
        self.simple.is_empty() && self.bvh.is_none()
    }

    /// Nearest acceptable hit with `t` in `(-tolerance, t_max)`: `t`, shape, face.
    pub(super) fn nearest(
        &self,
        scene: &Scene,
        o: DVec3,
        w: DVec3,
        t_max: f64,
        on: &On,
        medium: Medium,
    ) -> Option<(f64, u32, u32)> {
        if self.is_empty() {
            return None;
        }
        let tolerance = scene.tolerance(o);
        let behind = if on.alone { -tolerance } else { tolerance };
        let mut best: Option<(f64, u32, u32)> = None;
        for &id in &self.simple {
            let shape = &scene.shapes[id as usize];
            let limit = best.map_or(t_max, |b| b.0);
            let mut start = on.face(id).map(|face| Start { face });
            // A ray that grazes a plane within rounding of its origin may have crossed that further back.
            let flat = matches!(shape.shape, Shape::Rectangle(_) | Shape::Disk(_) | Shape::Cube(_));
            let mut back = if flat && !on.alone { behind * GRAZING } else { behind };
            for _ in 0..3 {
                let Some((t, face)) = shape.shape.cross(o, w, -back, limit, start) else { break };
                let normal = || shape.shape.normal(face, o + w * t);
                let coincides = t <= tolerance || t <= back && t * normal().dot(w).abs() <= tolerance;
                if t < -behind && (t * normal().dot(w)).abs() > tolerance {
                    back = behind;
                    continue;
                }
                let consistent = match medium {
                    Medium::Any => true,
                    Medium::Inside(m) if coincides => {
                        let n = normal();
                        !shape.boundary || if w.dot(n) < 0.0 { shape.exterior == m } else { shape.interior == m }
                    }
                    Medium::Inside(_) => true,
                };
                if consistent {
                    best = Some((t, id, face));
                    break;
                }
                start = Some(Start { face });
            }
        }
        if let Some(bvh) = &self.bvh {
            let limit = best.map_or(t_max, |b| b.0);
            // Begin a few ulps behind the origin: a surface that coincides with the one just passed must not be missed.
            let ray = Ray { o: o - w * behind, d: w, t_max: limit + behind, exclude: self.exclude(on) };
            if let Some(h) = bvh.intersect(&ray) {
                let (shape, face) = self.face_of(h.geom, h.prim);
                best = Some((h.t - behind, shape, face));
            }
        }
        best
    }

    pub(super) fn face_of(&self, geom: u32, prim: u32) -> (u32, u32) {
        match &self.entries[geom as usize] {
            Entry::Mesh(shape) => (*shape, prim),
            Entry::Faces(list) => list[prim as usize],
        }
    }

    /// Embree's names of what a ray grazes; never empty, but for a ray that grazes nothing.
    fn grazed(&self, past: &[(u32, Vec<u32>)]) -> Vec<(u32, u32)> {
        let mut names = Vec::new();
        for (shape, faces) in past {
            let geom = self.geometry_of.get(*shape as usize).copied().unwrap_or(u32::MAX);
            match self.entries.get(geom as usize) {
                Some(Entry::Mesh(_)) => names.extend(faces.iter().map(|&f| (geom, f))),
                Some(Entry::Faces(list)) => {
                    names.extend((0..list.len() as u32).filter(|&k| list[k as usize].0 == *shape).map(|k| (geom, k)));
                }
                None => names.push((u32::MAX, u32::MAX)),
            }
        }
        names
    }

    fn exclude(&self, on: &On) -> Option<(u32, u32)> {
        on.iter().find_map(|(shape, face)| {
            let geom = *self.geometry_of.get(shape as usize)?;
            match self.entries.get(geom as usize)? {
                Entry::Mesh(_) => Some((geom, face)),
                // Listed in the order of shapes and faces.
                Entry::Faces(list) => Some((geom, list.binary_search(&(shape, face)).ok()? as u32)),
            }
        })
    }
}

/// How much further than a perpendicular one a ray that grazes a plane may come from beyond it, and still have started on it within rounding.
const GRAZING: f64 = 1e4;

/// How faces within rounding of the origin are judged.
#[derive(Clone, Copy)]
pub(super) enum Medium {
    Any,
    Inside(Option<u32>),
}

impl Scene {
    /// A few units in the last place of the coordinates at `p`: what counts as the same point.
    pub fn tolerance(&self, p: DVec3) -> f64 {
        64.0 * f64::EPSILON * p.abs().max_element()
    }

    pub(super) fn hit(&self, t: f64, p: DVec3, shape: u32, face: u32) -> Hit {
        let s = &self.shapes[shape as usize].shape;
        let (p, n) = s.snap(face, p);
        let ns = match s {
            Shape::Mesh(m) if !self.shapes[shape as usize].face_normals => m
                .resolve(face, p + n, -n)
                .and_then(|(_, b)| m.shading_normal(face, b))
                .map_or(n, |ns| if ns.dot(n) < 0.0 { -ns } else { ns }),
            _ => n,
        };
        Hit { t: t.max(0.0), p, n, ns, shape, face }
    }

    /// A point p of a face as a hit at distance 0.
    pub fn hit_at(&self, p: DVec3, shape: u32, face: u32) -> Hit {
        self.hit(0.0, p, shape, face)
    }

    /// Nearest surface of any kind. `medium` is the medium the ray travels in.
    pub fn intersect(&self, o: DVec3, w: DVec3, t_max: f64, on: &On, medium: Option<u32>) -> Option<Hit> {
        effort::note(1);
        let null = self.null.nearest(self, o, w, t_max, on, Medium::Inside(medium));
        let limit = null.map_or(t_max, |(t, ..)| t.max(0.0));
        // At equal distance the surface is met inside the medium; either order keeps the bookkeeping consistent.
        let found = self.opaque.nearest(self, o, w, limit, on, Medium::Any).map(|h| self.left_first(o, w, on, h));
        let (t, shape, face) = found.or(null)?;
        Some(self.hit(t, o + w * t, shape, face))
    }

    /// Where faces coincide (a glass on a table), a dielectric that the ray is inside of is left before anything else is met; what it would enter comes last by itself, since
    /// a ray that starts on a face meets what coincides with that. Analytic shapes only: Embree's triangles are not met from their own plane.
    fn left_first(&self, o: DVec3, w: DVec3, on: &On, found: (f64, u32, u32)) -> (f64, u32, u32) {
        let (t, shape, face) = found;
        let glass = |id: u32| {
            let s = &self.shapes[id as usize];
            self.surfaces[s.surface as usize].is_transparent()
        };
        let alone = self.opaque.simple.len() < 2 && self.opaque.simple.contains(&shape);
        if !self.has_glass
            || alone
            || glass(shape) && self.shapes[shape as usize].shape.normal(face, o + w * t).dot(w) > 0.0
        {
            return found;
        }
        let slack = 2.0 * (self.tolerance(o) + self.tolerance(o + w * t));
        let leaves =
            |t: f64, shape: u32, face: u32| self.shapes[shape as usize].shape.normal(face, o + w * t).dot(w) > 0.0;
        for &id in self.opaque.simple.iter().filter(|&&id| id != shape && glass(id)) {
            let start = on.face(id).map(|face| Start { face });
            if let Some((t, face)) = self.shapes[id as usize].shape.cross(o, w, t - slack, t + slack, start) {
                if leaves(t, id, face) {
                    return (t, id, face);
                }
            }
        }
        found
    }

    /// Nearest null interface.
    pub fn boundary(&self, o: DVec3, w: DVec3, t_max: f64, on: &On, medium: Option<u32>) -> Option<Hit> {
        let (t, shape, face) = self.null.nearest(self, o, w, t_max, on, Medium::Inside(medium))?;
        Some(self.hit(t, o + w * t, shape, face))
    }

    /// What a ray meets of cylinders that it passes at a named rim: their walls elsewhere.
    fn walls_past_rims(
        &self,
        o: DVec3,
        w: DVec3,
        range: [f64; 2],
        past: &[(u32, Vec<u32>)],
    ) -> Option<(f64, u32, u32)> {
        let slack = self.tolerance(o);
        let wall = |(id, rims): &(u32, Vec<u32>)| match &self.shapes[*id as usize].shape {
            Shape::Cylinder(c) if !rims.is_empty() => Some((c.cross_past_rims(o, w, range, rims, slack)?, *id, 0)),
            _ => None,
        };
        past.iter().filter_map(wall).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The nearest opaque surface along a ray that grazes an outline: of meshes the named faces, of cylinders the named rims, of any other
    /// shape all of it is left out. The origin may lie on other things: a surface within rounding of it counts.
    pub fn opaque_past(&self, o: DVec3, w: DVec3, t_max: f64, past: &[(u32, Vec<u32>)]) -> Option<Hit> {
        effort::note(1);
        let tolerance = self.tolerance(o);
        let mut best = self.walls_past_rims(o, w, [-tolerance, t_max], past);
        for &id in self.opaque.simple.iter().filter(|&&id| past.iter().all(|p| p.0 != id)) {
            let limit = best.map_or(t_max, |b| b.0);
            if let Some(h) = self.shapes[id as usize].shape.intersect(o, w, -tolerance, limit, None) {
                best = Some((h.t, id, h.face));
            }
        }
        if let Some(bvh) = &self.opaque.bvh {
            let t_max = best.map_or(t_max, |b| b.0) + tolerance;
            let ray = Ray { o: o - w * tolerance, d: w, t_max, exclude: None };
            if let Some(h) = bvh.intersect_past(&ray, &self.opaque.grazed(past)) {
                let (shape, face) = self.opaque.face_of(h.geom, h.prim);
                best = Some((h.t - tolerance, shape, face));
            }
        }
        best.map(|(t, shape, face)| self.hit(t, o + w * t, shape, face))
    }

    /// Whether anything opaque stands on the first `t_max` of a ray that grazes an outline, see [`Scene::opaque_past`]; nothing at
    /// the origin itself counts.
    pub fn blocked_past(&self, o: DVec3, w: DVec3, t_max: f64, past: &[(u32, Vec<u32>)]) -> bool {
        effort::note(1);
        let tolerance = self.tolerance(o);
        let simple = |id: u32| self.shapes[id as usize].shape.intersect(o, w, tolerance, t_max, None).is_some();
        self.walls_past_rims(o, w, [tolerance, t_max], past).is_some()
            || self.opaque.simple.iter().any(|&id| past.iter().all(|p| p.0 != id) && simple(id))
            || self.opaque.bvh.as_ref().is_some_and(|bvh| {
                let ray = Ray { o: o + w * tolerance, d: w, t_max: t_max - tolerance, exclude: None };
                bvh.occluded_past(&ray, &self.opaque.grazed(past))
            })
    }

    /// A way from `p` of this length, short of its end by rounding only: what it ends on is not on it, on whichever side.
    pub fn short_of(&self, p: DVec3, length: f64) -> f64 {
        length * (1.0 - 1e-12) - self.tolerance(p)
    }

    /// Whether anything opaque stands between `p` and the light.
    pub fn opaque_blocks(&self, p: DVec3, a: &Arrival, on: &On) -> bool {
        effort::note(1);
        let tolerance = self.tolerance(p);
        // What the light stands on, its own surface first of all, does not block.
        let t_max = self.short_of(p, a.distance);
        let simple = self.opaque.simple.iter().any(|&id| {
            let start = on.face(id).map(|face| Start { face });
            let shape = &self.shapes[id as usize].shape;
            shape.cross(p, a.w, -tolerance, t_max, start).is_some()
        });
        simple
            || self.opaque.bvh.as_ref().is_some_and(|bvh| {
                let exclude = self.opaque.exclude(on);
                bvh.occluded(&Ray { o: p - a.w * tolerance, d: a.w, t_max: t_max + tolerance, exclude })
            })
    }
}
