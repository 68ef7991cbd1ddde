//! Where rays meet the scene. Opaque surfaces and null interfaces are kept apart: shadow rays ask Embree only for what
//! can block them, and null boundaries of simple form are solved directly, out of Embree.
//!
//! A ray knows the faces that it starts on ([`On`]). A face within rounding of the origin counts if the bookkeeping of media says
//! so: a null interface is entered only from its outside medium and left only from its inside one. So
//! coincident interfaces, cameras on a boundary and fog boxes that touch walls need no offset.

use super::Scene;
use crate::light::Arrival;
use crate::math::DVec3;
use crate::native::embree::{Bvh, Ray};
use crate::shape::{Geometry, Shape, Start};

/// A point where a ray meets a surface.
#[derive(Clone, Copy, Debug)]
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

/// Faces that a ray's origin lies on.
#[derive(Clone, Copy, Debug, Default)]
pub struct On {
    faces: [(u32, u32); 4],
    len: u8,
}

impl On {
    /// On one face only.
    pub fn at(hit: &Hit) -> Self {
        On { faces: [(hit.shape, hit.face); 4], len: 1 }
    }

    /// After passing through an interface: the faces passed at the same point are remembered together.
    pub fn crossed(&self, hit: &Hit, tolerance: f64) -> Self {
        if hit.t > tolerance || self.len == 4 {
            return On::at(hit);
        }
        let mut on = *self;
        on.faces[on.len as usize] = (hit.shape, hit.face);
        on.len += 1;
        on
    }

    /// The face of `shape` that the origin lies on.
    fn face(&self, shape: u32) -> Option<u32> {
        self.faces[..self.len as usize].iter().rev().find(|f| f.0 == shape).map(|f| f.1)
    }

    fn last(&self) -> Option<(u32, u32)> {
        (self.len > 0).then(|| self.faces[self.len as usize - 1])
    }
}

/// Shapes of one kind (opaque or null): meshes in Embree, simple shapes in a list.
#[derive(Default)]
pub struct Group {
    pub bvh: Option<Bvh>,
    /// Embree geometry -> shape.
    pub geometry: Vec<u32>,
    pub simple: Vec<u32>,
}

impl Group {
    /// Nearest acceptable hit with `t` in `(-tolerance, t_max)`.
    fn nearest(&self, scene: &Scene, o: DVec3, w: DVec3, t_max: f64, on: &On, medium: Medium) -> Option<Hit> {
        let tolerance = scene.tolerance(o);
        let mut best: Option<(f64, u32, u32)> = None;
        for &id in &self.simple {
            let shape = &scene.shapes[id as usize];
            let limit = best.map_or(t_max, |b| b.0);
            let mut start = on.face(id).map(|face| Start { face });
            for _ in 0..2 {
                let Some(h) = shape.shape.intersect(o, w, -tolerance, limit, start) else { break };
                let consistent = match medium {
                    Medium::Any => true,
                    Medium::Inside(m) if h.t <= tolerance => {
                        let n = shape.shape.normal(h.face, o + w * h.t);
                        !shape.boundary || if w.dot(n) < 0.0 { shape.exterior == m } else { shape.interior == m }
                    }
                    Medium::Inside(_) => true,
                };
                if consistent {
                    best = Some((h.t, id, h.face));
                    break;
                }
                start = Some(Start { face: h.face });
            }
        }
        if let Some(bvh) = &self.bvh {
            let limit = best.map_or(t_max, |b| b.0);
            let ray = Ray { o, d: w, t_max: limit, exclude: self.exclude(on) };
            if let Some(h) = bvh.intersect(&ray) {
                best = Some((h.t, self.geometry[h.geom as usize], h.prim));
            }
        }
        best.map(|(t, shape, face)| scene.hit(t, o + w * t, shape, face))
    }

    fn exclude(&self, on: &On) -> Option<(u32, u32)> {
        let (shape, face) = on.last()?;
        let geom = self.geometry.iter().position(|&g| g == shape)?;
        Some((geom as u32, face))
    }
}

/// How faces within rounding of the origin are judged.
#[derive(Clone, Copy)]
enum Medium {
    Any,
    Inside(Option<u32>),
}

impl Scene {
    /// A few units in the last place of the coordinates at `p`: what counts as the same point.
    pub fn tolerance(&self, p: DVec3) -> f64 {
        64.0 * f64::EPSILON * p.abs().max_element()
    }

    fn hit(&self, t: f64, p: DVec3, shape: u32, face: u32) -> Hit {
        let s = &self.shapes[shape as usize].shape;
        // Put the point on the surface where that is exact.
        let p = match s {
            Shape::Sphere(sphere) => sphere.snap(p),
            _ => p,
        };
        let n = s.normal(face, p);
        let ns = match s {
            Shape::Mesh(m) if !self.shapes[shape as usize].face_normals => m
                .resolve(face, p + n, -n)
                .and_then(|(_, b)| m.shading_normal(face, b))
                .map_or(n, |ns| if ns.dot(n) < 0.0 { -ns } else { ns }),
            _ => n,
        };
        Hit { t: t.max(0.0), p, n, ns, shape, face }
    }

    /// Nearest surface of any kind. `medium` is the medium the ray travels in.
    pub fn intersect(&self, o: DVec3, w: DVec3, t_max: f64, on: &On, medium: Option<u32>) -> Option<Hit> {
        let null = self.null.nearest(self, o, w, t_max, on, Medium::Inside(medium));
        let limit = null.as_ref().map_or(t_max, |h| h.t);
        // At equal distance the null interface comes first: the surface behind it is met in the medium it stands in.
        self.opaque.nearest(self, o, w, limit, on, Medium::Any).or(null)
    }

    /// Nearest null interface.
    pub fn boundary(&self, o: DVec3, w: DVec3, t_max: f64, on: &On, medium: Option<u32>) -> Option<Hit> {
        self.null.nearest(self, o, w, t_max, on, Medium::Inside(medium))
    }

    /// Whether anything opaque stands between `p` and the light.
    pub fn opaque_blocks(&self, p: DVec3, a: &Arrival, on: &On) -> bool {
        let tolerance = self.tolerance(p);
        // The light's own surface does not block: stop short of it by rounding only.
        let t_max = match a.target {
            Some(_) => a.distance * (1.0 - 1e-12) - tolerance,
            None => a.distance,
        };
        let simple = self.opaque.simple.iter().any(|&id| {
            let start = on.face(id).map(|face| Start { face });
            let shape = &self.shapes[id as usize].shape;
            shape.intersect(p, a.w, -tolerance, t_max, start).is_some()
        });
        simple
            || self.opaque.bvh.as_ref().is_some_and(|bvh| {
                bvh.occluded(&Ray { o: p, d: a.w, t_max, exclude: self.opaque.exclude(on) })
            })
    }
}
