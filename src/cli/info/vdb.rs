//! OpenVDB files: every grid, and whether a medium can use it.

use super::{Info, Range, number, numbers};
use crate::cli::format;
use serde::Serialize;
use std::path::Path;
use tyndall::error::Result;
use tyndall::math::DVec3;
use tyndall::native::vdb::{self, GridInfo, Select, VdbGrid};

#[derive(Serialize)]
pub struct VdbInfo {
    file: String,
    grids: Vec<GridReport>,
}

#[derive(Serialize)]
struct GridReport {
    index: usize,
    name: String,
    value_type: String,
    stored_half: bool,
    class: String,
    creator: String,
    active_voxels: u64,
    leaves: u64,
    memory_bytes: u64,
    background: Vec<f64>,
    /// Active voxels, both corners within; null for an empty grid.
    index_box: Option<[[i32; 3]; 2]>,
    /// Around the centres of those voxels.
    world_box: Option<[[f64; 3]; 2]>,
    transform: String,
    /// Rows of the affine map from index to world.
    world_from_index: [[f64; 4]; 3],
    /// Lengths of the voxel's edges.
    voxel_size: [f64; 3],
    /// Active values; null where the grid cannot be read.
    values: Option<Range>,
    usable_as_density: bool,
    /// How it is used, or why not.
    verdict: String,
}

impl VdbInfo {
    pub fn read(path: &Path) -> Result<Self> {
        let all = vdb::list(path)?;
        let report = |i: &GridInfo| {
            let shadowed = all.iter().take(i.index).any(|j| j.name == i.name);
            GridReport::new(i, vdb::load(path, &Select::Index(i.index)), shadowed)
        };
        Ok(VdbInfo { file: path.display().to_string(), grids: all.iter().map(report).collect() })
    }
}

impl GridReport {
    /// `shadowed`: an earlier grid has the same name.
    fn new(i: &GridInfo, grid: Result<VdbGrid>, shadowed: bool) -> Self {
        let m = i.world_from_index;
        let world_box = i.bbox.map(|(a, b)| {
            let corners = (0..8).map(|k| {
                let c = [0, 1, 2].map(|j| f64::from(if k >> j & 1 == 0 { a[j] } else { b[j] }));
                m.transform_point3(DVec3::from(c))
            });
            let (mut low, mut high) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            for p in corners {
                (low, high) = (low.min(p), high.max(p));
            }
            [low.to_array(), high.to_array()]
        });
        let columns = [m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis];
        let row = |r: usize| [columns[0][r], columns[1][r], columns[2][r], m.translation[r]];
        let (values, verdict) = match &grid {
            Ok(g) => (Some(Range::of(active(g))), judge(g, shadowed)),
            Err(e) => (None, Err(e.to_string())),
        };
        let channels = if i.value_type.starts_with("vec") { 3 } else { 1 };
        GridReport {
            index: i.index,
            name: i.name.clone(),
            value_type: i.value_type.clone(),
            stored_half: i.stored_half,
            class: i.class.clone(),
            creator: i.creator.clone(),
            active_voxels: i.active_voxels,
            leaves: i.leaf_count,
            memory_bytes: i.memory,
            background: i.background[..channels].to_vec(),
            index_box: i.bbox.map(|(a, b)| [a, b]),
            world_box,
            transform: i.transform.clone(),
            world_from_index: [row(0), row(1), row(2)],
            voxel_size: columns.map(DVec3::length),
            values,
            usable_as_density: verdict.is_ok(),
            verdict: verdict.unwrap_or_else(|why| why),
        }
    }

    fn text(&self) -> String {
        let half = if self.stored_half { ", stored as half" } else { "" };
        let mut rows = vec![
            vec!["type".into(), format!("{}{half}, {}", self.value_type, self.class)],
            vec!["creator".into(), if self.creator.is_empty() { "-".into() } else { self.creator.clone() }],
            vec![
                "voxels".into(),
                format!(
                    "{} active in {} ({})",
                    self.active_voxels,
                    if self.leaves == 1 { "1 leaf".into() } else { format!("{} leaves", self.leaves) },
                    format::bytes(self.memory_bytes)
                ),
            ],
            vec!["background".into(), numbers(&self.background)],
        ];
        let values = self.values.map_or("not read".into(), |v| v.text());
        rows.push(vec!["values".into(), values]);
        if let Some([a, b]) = self.index_box {
            rows.push(vec!["index box".into(), format!("{a:?} .. {b:?}")]);
        }
        if let Some([a, b]) = self.world_box {
            rows.push(vec!["world box".into(), format!("({}) .. ({})", numbers(&a), numbers(&b))]);
        }
        let size = self.voxel_size.map(number).join(" x ");
        rows.push(vec!["transform".into(), format!("{}, voxel size {size}", self.transform)]);
        let usable = if self.usable_as_density { "yes" } else { "no" };
        rows.push(vec!["usable as density".into(), format!("{usable}: {}", self.verdict)]);
        rows.iter_mut().for_each(|r| r[0].insert_str(0, "  "));
        format!("grid {} `{}`\n{}", self.index, self.name, format::table(&rows))
    }
}

/// Values of active voxels and tiles; a tile counts once.
fn active(g: &VdbGrid) -> Vec<f32> {
    let mut v = Vec::new();
    for l in &g.leaves {
        for (i, voxel) in l.values.chunks_exact(g.channels).enumerate() {
            if l.is_active(i) {
                v.extend_from_slice(voxel);
            }
        }
    }
    for t in g.tiles.iter().filter(|t| t.active) {
        v.extend_from_slice(&t.value[..g.channels]);
    }
    v
}

/// What `<volume type="openvdb">` does with the grid.
fn judge(g: &VdbGrid, shadowed: bool) -> std::result::Result<String, String> {
    let i = &g.info;
    // An earlier grid of this name is the one that the name alone means.
    let name = if shadowed { format!("grid_index {}", i.index) } else { format!("grid_name \"{}\"", i.name) };
    if i.class == "level set" && g.channels == 1 && i.background[0] > 0.0 && i.background[0].is_finite() {
        return Ok(format!("{name}, level_set \"fog\" (0 on the surface, 1 deeper than {})", number(i.background[0])));
    }
    // Inactive values are interpolated too.
    let values = g.leaves.iter().flat_map(|l| &l.values).chain(g.tiles.iter().flat_map(|t| &t.value[..g.channels]));
    let background = i.background[..g.channels].iter().any(|b| !(b.is_finite() && *b >= 0.0));
    let bad = values.filter(|v| !(v.is_finite() && **v >= 0.0)).count();
    if bad > 0 {
        let what = format::plural(bad, "value");
        return Err(format!("{what} NaN, infinite or negative: --repair-voxels sets those to 0"));
    }
    if background {
        return Err("the background is negative or not finite".into());
    }
    let mut how = format!("{name}, {}", if g.channels == 3 { "rgb" } else { "gray" });
    if g.leaves.is_empty() && g.tiles.is_empty() {
        how += ", empty";
    }
    if i.background[..g.channels].iter().any(|b| *b != 0.0) {
        how += ", and its background fills all space around";
    }
    Ok(how)
}

impl Info for VdbInfo {
    fn text(&self) -> String {
        let grids: Vec<String> = self.grids.iter().map(GridReport::text).collect();
        format!("{}: {}\n{}", self.file, format::plural(grids.len(), "grid"), grids.join("\n"))
    }
}
