//! Meshes: size, place, and whether they are closed.

use super::{Info, number, numbers};
use crate::cli::format;
use serde::Serialize;
use std::path::Path;
use tyndall::error::{Error, Result};
use tyndall::shape::{Geometry, Topology, obj, ply};

#[derive(Serialize)]
pub struct MeshInfo {
    file: String,
    vertices: usize,
    faces: usize,
    normals: bool,
    uvs: bool,
    min: [f64; 3],
    max: [f64; 3],
    area: f64,
    closed: bool,
    welded_vertices: usize,
    welded_by_tolerance: bool,
    boundary_edges_stored: usize,
    boundary_edges: usize,
    non_manifold_edges: usize,
    inconsistent_edges: usize,
    degenerate_faces: usize,
    faces_against_normals: usize,
    /// Null for an open mesh.
    signed_volume: Option<f64>,
    /// Why it should not bound a medium; null if all is well.
    leaks: Option<String>,
    defects: Option<String>,
}

impl MeshInfo {
    pub fn read(path: &Path, extension: &str) -> Result<Self> {
        let mesh = if extension == "ply" { ply::load(path) } else { obj::load(path) };
        // Loaders name the file where they have it; the path says it in any case.
        let mesh = mesh.map_err(|e| Error::Runtime(format!("{}: {e}", path.display())))?;
        let (t, b): (&Topology, _) = (mesh.topology(), mesh.bounds());
        Ok(MeshInfo {
            file: path.display().to_string(),
            vertices: mesh.vertices.len(),
            faces: mesh.faces.len(),
            normals: mesh.normals.is_some(),
            uvs: mesh.uvs.is_some(),
            min: b.min.to_array(),
            max: b.max.to_array(),
            area: mesh.area(),
            closed: t.is_closed(),
            welded_vertices: t.welded_vertices,
            welded_by_tolerance: t.welded_by_tolerance,
            boundary_edges_stored: t.boundary_edges_stored,
            boundary_edges: t.boundary_edges,
            non_manifold_edges: t.non_manifold_edges,
            inconsistent_edges: t.inconsistent_edges,
            degenerate_faces: t.degenerate_faces,
            faces_against_normals: t.faces_against_normals,
            signed_volume: t.is_closed().then_some(t.signed_volume),
            leaks: t.leaks(),
            defects: t.defects(),
        })
    }
}

impl Info for MeshInfo {
    fn text(&self) -> String {
        let yes = |b| if b { "yes" } else { "no" };
        let mut rows = vec![
            vec!["vertices".into(), format!("{} ({} after welding)", self.vertices, self.welded_vertices)],
            vec!["faces".into(), self.faces.to_string()],
            vec!["normals, uvs".into(), format!("{}, {}", yes(self.normals), yes(self.uvs))],
            vec!["bounds".into(), format!("({}) .. ({})", numbers(&self.min), numbers(&self.max))],
            vec!["area".into(), number(self.area)],
        ];
        let closed = match self.signed_volume {
            Some(v) => format!("yes, volume {}", number(v)),
            None => format!("no, {}", format::plural(self.boundary_edges, "open edge")),
        };
        rows.push(vec!["closed".into(), closed]);
        let bounds = match &self.leaks {
            None => "yes".into(),
            Some(why) => format!("no: {why}"),
        };
        rows.push(vec!["can bound a medium".into(), bounds]);
        if let Some(d) = &self.defects {
            rows.push(vec!["defects".into(), d.clone()]);
        }
        format!("{}\n{}", self.file, format::table(&rows))
    }
}
