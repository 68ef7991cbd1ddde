//! Triangle meshes in world space.

use super::{Bounds, Geometry, ShapeHit, Start, SurfaceSample, Topology, barycentric, plane_t};
use crate::math::discrete::Discrete;
use crate::math::nearest::on_triangle;
use crate::math::{DAffine3, DVec2, DVec3, V3};
use std::sync::{Arc, OnceLock};

/// Relative size of `|e1 x e2|` against `|e1||e2|` below which a face counts as without area [T] section 9.
const DEGENERATE: f64 = 1e-14;

#[derive(Clone, Debug)]
pub struct TriangleMesh {
    pub vertices: Arc<[DVec3]>,
    pub faces: Arc<[[u32; 3]]>,
    /// One a vertex: shading only. The geometric normal comes from the winding.
    pub normals: Option<Arc<[DVec3]>>,
    pub uvs: Option<Arc<[DVec2]>>,
    /// Of each vertex its number among the positions of its file, where these stand in another order.
    pub file_order: Option<Arc<[u32]>>,
    /// How coarse the coordinates of the source are, in world units: one f32 ulp of its largest coordinate for a
    /// file, one f64 ulp otherwise. Welding rests on it.
    pub rounding: f64,
    areas: OnceLock<Discrete>,
    topology: OnceLock<Topology>,
}

impl TriangleMesh {
    /// Checks everything that later code relies on: no empty mesh, finite numbers, indices in range.
    pub fn new(
        vertices: Vec<DVec3>,
        faces: Vec<[u32; 3]>,
        normals: Option<Vec<DVec3>>,
        uvs: Option<Vec<DVec2>>,
    ) -> Result<Self, String> {
        if vertices.is_empty() || faces.is_empty() {
            return Err(format!("the mesh is empty: {} vertices, {} faces", vertices.len(), faces.len()));
        }
        if let Some(i) = vertices.iter().position(|p| !p.is_finite()) {
            return Err(format!("vertex {i}: the position {} is not finite", vertices[i]));
        }
        if let Some(i) = faces.iter().position(|f| f.iter().any(|&k| k as usize >= vertices.len())) {
            return Err(format!("face {i}: an index of {:?} exceeds the {} vertices", faces[i], vertices.len()));
        }
        if let Some(n) = &normals {
            check_attribute("normal", vertices.len(), n, |n| n.is_finite())?;
        }
        if let Some(uv) = &uvs {
            check_attribute("uv", vertices.len(), uv, |uv| uv.is_finite())?;
        }
        let magnitude = vertices.iter().copied().collect::<Bounds>().magnitude();
        Ok(TriangleMesh {
            vertices: vertices.into(),
            faces: faces.into(),
            normals: normals.map(Into::into),
            uvs: uvs.map(Into::into),
            file_order: None,
            rounding: f64::EPSILON * magnitude,
            areas: OnceLock::new(),
            topology: OnceLock::new(),
        })
    }

    /// Says that the coordinates came from a file of single precision, in the present units.
    pub(super) fn rounded_to_f32(mut self) -> Self {
        self.rounding *= f64::from(f32::EPSILON) / f64::EPSILON;
        self
    }

    /// Placed by `to_world`. A map that mirrors reverses the winding: what was outside stays outside.
    pub fn transformed(&self, to_world: &DAffine3) -> Result<Self, String> {
        let det = to_world.matrix3.determinant();
        if !(to_world.is_finite() && det != 0.0 && det.is_finite()) {
            return Err("to_world cannot be inverted".into());
        }
        let vertices: Arc<[DVec3]> = self.vertices.iter().map(|&p| to_world.transform_point3(p)).collect();
        if let Some(i) = vertices.iter().position(|p| !p.is_finite()) {
            return Err(format!("vertex {i} is not finite after to_world"));
        }
        let cofactor = to_world.matrix3.inverse().transpose();
        let normals = self.normals.as_ref().map(|n| n.iter().map(|&n| (cofactor * n).normalize_or_zero()).collect());
        let faces = if det < 0.0 { reverse(&self.faces) } else { self.faces.clone() };
        let m = to_world.matrix3;
        let scale = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
        let magnitude = vertices.iter().copied().collect::<Bounds>().magnitude();
        let rounding = (self.rounding * scale).max(f64::EPSILON * magnitude);
        Ok(TriangleMesh { normals, ..self.replaced(vertices, faces, rounding) })
    }

    /// The same faces over moved vertices (same number of them, finite).
    pub fn with_vertices(&self, vertices: Vec<DVec3>) -> Result<Self, String> {
        if vertices.len() != self.vertices.len() {
            return Err(format!("{} vertices for a mesh of {}", vertices.len(), self.vertices.len()));
        }
        if let Some(i) = vertices.iter().position(|p| !p.is_finite()) {
            return Err(format!("vertex {i}: the position {} is not finite", vertices[i]));
        }
        Ok(self.replaced(vertices.into(), self.faces.clone(), self.rounding))
    }

    /// Inside out: winding and shading normals.
    #[must_use]
    pub fn flip_normals(&self) -> Self {
        let normals = self.normals.as_ref().map(|n| n.iter().map(|&n| -n).collect());
        TriangleMesh { normals, ..self.replaced(self.vertices.clone(), reverse(&self.faces), self.rounding) }
    }

    /// Does the winding of a face oppose its vertex normals? Exporters write such files: their normals, not their
    /// winding, say which side is outside. False without normals.
    pub fn is_against_normals(&self, face: u32) -> bool {
        let Some(n) = &self.normals else { return false };
        let sum: DVec3 = self.faces[face as usize].iter().map(|&i| n[i as usize]).sum();
        self.area_vector(face).dot(sum) < 0.0
    }

    /// Faces whose winding opposes their vertex normals reversed; the normals stay.
    #[must_use]
    pub fn wound_by_normals(&self) -> Self {
        let wind = |(f, &[a, b, c]): (usize, &[u32; 3])| {
            if self.is_against_normals(f as u32) { [a, c, b] } else { [a, b, c] }
        };
        self.replaced(self.vertices.clone(), self.faces.iter().enumerate().map(wind).collect(), self.rounding)
    }

    /// v -> 1 - v.
    #[must_use]
    pub fn flip_tex_coords(&self) -> Self {
        let uvs = self.uvs.as_ref().map(|uv| uv.iter().map(|uv| DVec2::new(uv.x, 1.0 - uv.y)).collect());
        TriangleMesh { uvs, ..self.clone() }
    }

    fn replaced(&self, vertices: Arc<[DVec3]>, faces: Arc<[[u32; 3]]>, rounding: f64) -> Self {
        let (normals, uvs, file_order) = (self.normals.clone(), self.uvs.clone(), self.file_order.clone());
        TriangleMesh {
            vertices,
            faces,
            normals,
            uvs,
            file_order,
            rounding,
            areas: OnceLock::new(),
            topology: OnceLock::new(),
        }
    }

    pub fn corners(&self, face: u32) -> [DVec3; 3] {
        self.faces[face as usize].map(|i| self.vertices[i as usize])
    }

    /// `(v1-v0) x (v2-v0)`: twice the area along the geometric normal (right-hand rule).
    pub fn area_vector(&self, face: u32) -> DVec3 {
        let [a, b, c] = self.corners(face);
        (b - a).cross(c - a)
    }

    pub fn face_area(&self, face: u32) -> f64 {
        0.5 * self.area_vector(face).length()
    }

    /// A face without area to rounding: it has no normal, and no ray is said to hit it.
    pub fn is_degenerate(&self, face: u32) -> bool {
        let [a, b, c] = self.corners(face);
        // The two shortest sides decide: a needle seen from its tip looks well shaped otherwise.
        let (ab, bc, ca) = ((b - a).length_squared(), (c - b).length_squared(), (a - c).length_squared());
        let product = ab * bc * ca / ab.max(bc).max(ca);
        let n = (b - a).cross(c - a).length_squared();
        n == 0.0 || n <= DEGENERATE * DEGENERATE * product
    }

    /// The hit on a face that Embree named, solved again in f64: `t` and the weights of the second and third vertex.
    /// The weights may leave [0,1] by rounding at an edge. `None` if the face is degenerate or parallel to the ray.
    pub fn resolve(&self, face: u32, o: DVec3, w: DVec3) -> Option<(f64, DVec2)> {
        if self.is_degenerate(face) {
            return None;
        }
        let [v0, v1, v2] = self.corners(face).map(V3::<f64>::constant);
        let (o, w) = (V3::constant(o), V3::constant(w));
        let t = plane_t(v0, v1, v2, o, w);
        let (b1, b2) = barycentric(v0, v1, v2, (o - v0) + w * t);
        t.is_finite().then_some((t, DVec2::new(b1, b2)))
    }

    /// Interpolated vertex normal, unit; `None` without normals or where they cancel.
    pub fn shading_normal(&self, face: u32, b: DVec2) -> Option<DVec3> {
        let n = self.normals.as_ref()?;
        let [n0, n1, n2] = self.faces[face as usize].map(|i| n[i as usize]);
        (n0 * (1.0 - b.x - b.y) + n1 * b.x + n2 * b.y).try_normalize()
    }

    /// Interpolated texture coordinates; without any, the weights themselves.
    pub fn texture_uv(&self, face: u32, b: DVec2) -> DVec2 {
        let Some(uv) = &self.uvs else { return b };
        let [a0, a1, a2] = self.faces[face as usize].map(|i| uv[i as usize]);
        a0 * (1.0 - b.x - b.y) + a1 * b.x + a2 * b.y
    }

    /// Faces by area: the table behind `sample`, made at first use.
    pub fn area_table(&self) -> &Discrete {
        self.areas.get_or_init(|| Discrete::new((0..self.faces.len()).map(|f| self.face_area(f as u32))))
    }

    /// Edges, holes and orientation, found at first use.
    pub fn topology(&self) -> &Topology {
        self.topology.get_or_init(|| Topology::new(self))
    }
}

fn reverse(faces: &[[u32; 3]]) -> Arc<[[u32; 3]]> {
    faces.iter().map(|&[a, b, c]| [a, c, b]).collect()
}

fn check_attribute<T>(name: &str, n: usize, values: &[T], finite: impl Fn(&T) -> bool) -> Result<(), String> {
    if values.len() != n {
        return Err(format!("{} {name}s for {n} vertices", values.len()));
    }
    match values.iter().position(|v| !finite(v)) {
        Some(i) => Err(format!("vertex {i}: the {name} is not finite")),
        None => Ok(()),
    }
}

/// Weights of the second and third vertex, uniform on a triangle.
fn triangle(u: f64, v: f64) -> DVec2 {
    let s = u.sqrt();
    DVec2::new(s * (1.0 - v), s * v)
}

impl Geometry for TriangleMesh {
    fn bounds(&self) -> Bounds {
        self.faces.iter().flatten().map(|&i| self.vertices[i as usize]).collect()
    }

    fn area(&self) -> f64 {
        self.area_table().total
    }

    fn is_closed(&self) -> bool {
        self.topology().is_closed()
    }

    fn intersect(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<ShapeHit> {
        let mut best: Option<ShapeHit> = None;
        for face in 0..self.faces.len() as u32 {
            if start.is_some_and(|s| s.face == face) {
                continue;
            }
            let Some((t, uv)) = self.resolve(face, o, w) else { continue };
            let inside = uv.min_element() >= 0.0 && uv.x + uv.y <= 1.0;
            if inside && t > t_min && t <= best.map_or(t_max, |b| b.t) {
                best = Some(ShapeHit { t, uv, face });
            }
        }
        best
    }

    fn cross(&self, o: DVec3, w: DVec3, t_min: f64, t_max: f64, start: Option<Start>) -> Option<(f64, u32)> {
        self.intersect(o, w, t_min, t_max, start).map(|h| (h.t, h.face))
    }

    fn normal(&self, face: u32, _p: DVec3) -> DVec3 {
        self.area_vector(face).normalize()
    }

    fn position(&self, face: u32, uv: DVec2) -> DVec3 {
        let [a, b, c] = self.corners(face);
        a + (b - a) * uv.x + (c - a) * uv.y
    }

    fn uv(&self, face: u32, p: DVec3) -> DVec2 {
        let [v0, v1, v2] = self.corners(face).map(V3::<f64>::constant);
        let (b1, b2) = barycentric(v0, v1, v2, V3::constant(p) - v0);
        DVec2::new(b1, b2)
    }

    fn face_count(&self) -> u32 {
        self.faces.len() as u32
    }

    fn nearest_on_face(&self, face: u32, p: DVec3) -> DVec3 {
        on_triangle(p, self.corners(face))
    }

    fn sample(&self, u: f64, v: f64) -> SurfaceSample {
        let (face, _, u) = self.area_table().sample(u);
        let (face, uv) = (face as u32, triangle(u, v));
        let p = self.position(face, uv);
        SurfaceSample { p, n: self.normal(face, p), uv, face, pdf_area: self.area().recip() }
    }
}
