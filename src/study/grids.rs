//! Media on grids: transmittance of known densities, and grids that are constant, empty, spiked or broken.
//!
//! Densities depend on z alone: one row of nodes, written to a temporary `.vol`, in the cube of [`slab`](super::slab). `T` is the
//! camera line, `T_shadow` the same by a shadow ray (both deterministic), `T_diff` the mean over cosine-weighted directions, walked by delta
//! tracking: `2 E_3(tau)`. Most derivatives are with respect to the medium's scale: a combination of the
//! table's derivatives.

use super::measure::Subject;
use super::reference::{ClosedForm, Known, closed_forms, slab};
use super::slab::{Slab, View};
use super::stress::{Bench, Check};
use crate::error::{Error, Result, WarningKind};
use crate::math::DAffine3;
use crate::medium::grid::vol::Vol;
use crate::native::vdb;
use crate::scene::compile::LoadOptions;
use crate::scene::{Scene, SceneDesc};
use crate::transport::{self, Beginning, Tally};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

const PATHS: usize = 1 << 18;

/// A folder that goes away with its owner.
struct Scratch(PathBuf);

impl Scratch {
    fn new() -> Result<Self> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("tyndall-stress-{}-{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let dir = std::env::temp_dir().join(name);
        std::fs::create_dir_all(&dir)
            .map_err(|source| Error::Io { what: format!("making {}", dir.display()), source })?;
        Ok(Scratch(dir))
    }

    /// Write nodes; returns the file.
    fn vol(&self, res: [usize; 3], values: Vec<f32>) -> Result<PathBuf> {
        let path = self.0.join("density.vol");
        Vol { res, channels: 1, bbox: [[0.0; 3], [1.0; 3]], values }.write(&path)?;
        Ok(path)
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        // Left behind at worst: a few kilobytes in the temporary folder.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A medium around a `.vol`, its unit cube from `low` to `high`.
fn medium(path: &Path, low: [f64; 3], high: [f64; 3]) -> String {
    let size = [0, 1, 2].map(|i| high[i] - low[i]);
    format!(
        r#"<medium type="heterogeneous" id="fog"><float name="albedo" value="$albedo"/><float name="scale" value="$sigma_t"/>
        <volume name="sigma_t" type="gridvolume"><string name="filename" value="{}"/><transform name="to_world">
          <scale x="{:e}" y="{:e}" z="{:e}"/><translate x="{:e}" y="{:e}" z="{:e}"/></transform></volume>
        <phase type="hg"><float name="g" value="$g"/></phase></medium>"#,
        path.display(),
        size[0],
        size[1],
        size[2],
        low[0],
        low[1],
        low[2]
    )
}

/// Nodes of a density along z: at `0`, `h`, ..., and constant across.
struct Profile {
    /// Thickness of the slab around it.
    unit: f64,
    h: f64,
    nodes: Vec<f64>,
}

impl Profile {
    fn of(c: &ClosedForm) -> Self {
        let sample = |unit: f64, length: f64, n: usize, f: &dyn Fn(f64) -> f64| {
            let h = length / n as f64;
            Profile { unit, h, nodes: (0..=n).map(|i| f(i as f64 * h)).collect() }
        };
        let (s0, height, w) = (c.param("s0"), c.param("H"), c.param("w"));
        if c.id.starts_with("T_linear") {
            let (a, b, l) = (c.param("a"), c.param("b"), c.param("L"));
            sample(l, l, 1, &|x| a + b * x)
        } else if c.id.starts_with("T_exponential") {
            // Nothing is left after 40 scale heights.
            let l = c.param("L");
            sample(l, l.min(40.0 * height), (64.0 * l.min(40.0 * height) / height) as usize, &|x| {
                s0 * (-x / height).exp()
            })
        } else {
            sample(18.0 * w, 18.0 * w, 1152, &|x| s0 * (-0.5 * ((x - 9.0 * w) / w).powi(2)).exp())
        }
    }

    fn depth(&self) -> f64 {
        self.nodes.windows(2).map(|n| 0.5 * (n[0] + n[1]) * self.h).sum()
    }

    fn medium(&self, scratch: &Scratch) -> Result<String> {
        let path = scratch.vol([1, 1, self.nodes.len()], self.nodes.iter().map(|&x| x as f32).collect())?;
        // Nodes sit at the centres of the cells.
        let (wide, end) = (1e5 * self.unit, (self.nodes.len() as f64 - 0.5) * self.h);
        Ok(medium(&path, [-wide, -wide, -0.5 * self.h], [wide, wide, end]))
    }
}

/// `2 E_3(tau) = integral over m in (0,1) of 2 m exp(-tau / m)`, by the midpoint rule in `m`.
fn diffuse_transmittance(tau: f64) -> f64 {
    let n = 100_000;
    (0..n).map(|i| (i as f64 + 0.5) / n as f64).map(|m| 2.0 * m * (-tau / m).exp()).sum::<f64>() / n as f64
}

/// The closed form of a case's name, as `T-linear-density-04`.
fn closed_form(name: &str) -> Option<&'static ClosedForm> {
    let id = name.replace('-', "_");
    closed_forms().iter().find(|c| c.id == id)
}

pub fn transmittance(b: &mut Bench) -> Result<()> {
    let Some(c) = closed_form(&b.case.name) else { return Ok(()) };
    let scratch = Scratch::new()?;
    let p = Profile::of(c);
    let text = p.medium(&scratch)?;
    // The medium's scale is the slab's sigma_t: 1.
    let s = Slab { unit: p.unit, ..Slab::new(p.unit, 0.0, 0.0) };
    let linear = c.id.starts_with("T_linear");
    let tolerance = if linear { 1e-6 } else { 1e-3 };

    // One path by itself: the film cannot hold what is below 1e-120.
    let alone = Subject::new(&s.text_with(View::T(1.0), &text), &[])?;
    let (o, w) = alone.scene.sensors[0].ray(0.5, 0.5);
    let begin = Beginning::new(crate::math::rng::Rng::keyed(1, 1, 0, 0), o, w, None);
    let value = transport::sample(&alone.scene, &alone.scene.settings, &begin, &mut Tally::default())[0];
    b.exact("T path", value, c.value, tolerance * c.value, "one path, without a film");

    let by_scale = match c.id.split('_').nth(1) {
        Some("linear") => c.param("a") * c.derivative("a").value + c.param("b") * c.derivative("b").value,
        _ => c.param("s0") * c.derivative("s0").value,
    };
    let small = c.value < 1e-100;
    for (view, name) in [(View::T(1.0), "T"), (View::Shadow, "T_shadow")] {
        let subject = Subject::new(&s.text_with(view, &text), &["sigma_t"])?;
        let m = b.measure(&subject, &[vec![1.0, 0.0], vec![0.0, 1.0]], 1 << 10)?;
        let check = |x: f64| Check {
            relvar: (p.depth() <= 20.0).then_some(1.0),
            // Below the film's range: 0 stands for it.
            tolerance: if small { 1e-100 } else { tolerance * x.abs() },
            ..Check::new(Known::exact(x), 0.0)
        };
        b.judge(name, &m, 0, check(c.value));
        b.judge(&format!("{name}:d_scale"), &m, 1, check(by_scale));
    }
    if p.depth() < 5.0 {
        let subject = Subject::new(&s.text_with(View::Tdiff, &text), &["sigma_t"])?;
        let m = b.measure(&subject, &[vec![1.0, 0.0], vec![0.0, 1.0]], PATHS)?;
        let (tau, h) = (p.depth(), 1e-4);
        let slope =
            tau * (diffuse_transmittance(tau * (1.0 + h)) - diffuse_transmittance(tau * (1.0 - h))) / (2.0 * h * tau);
        b.judge("T_diff", &m, 0, Check::new(Known::exact(diffuse_transmittance(tau)), 1e-4));
        b.judge("T_diff:d_scale", &m, 1, Check::new(Known::exact(slope), 1e-4));
    }
    by_length(b, c, Slab { moves: true, ..s }, &text, tolerance)
}

/// The border behind moves through the grid, `dT/dL = -σ(L) T`; where the closed form knows a length.
fn by_length(b: &mut Bench, c: &ClosedForm, s: Slab, medium: &str, tolerance: f64) -> Result<()> {
    let known = c.derivative("L");
    if known.value.is_nan() {
        return Ok(());
    }
    let subject = Subject::new(&s.text_with(View::T(1.0), medium), &["half"])?;
    let m = b.measure(&subject, &[vec![0.0, 0.5]], 1 << 10)?;
    // What underflows beside the value is nothing.
    let tolerance = (tolerance * known.value.abs()).max(1e-12 * c.value);
    b.judge("T:d_L", &m, 0, Check { tolerance, ..Check::new(known, 0.0) });
    Ok(())
}

/// A grid of ones as the benign slab.
fn ones(scratch: &Scratch, value: f32) -> Result<String> {
    let path = scratch.vol([32; 3], vec![value; 32 * 32 * 32])?;
    Ok(medium(&path, [-1e4, -1e4, 0.0], [1e4, 1e4, 1.0]))
}

pub fn equals_homogeneous(b: &mut Bench) -> Result<()> {
    let scratch = Scratch::new()?;
    let text = ones(&scratch, 1.0)?;
    let wrt = ["sigma_t", "albedo", "g"];
    let unit = |k: usize| -> Vec<f64> { (0..4).map(|l| f64::from(u8::from(l == k))).collect() };
    let combinations: Vec<Vec<f64>> = (0..4).map(unit).collect();
    for (view, name) in [(View::R(1.0), "R_1"), (View::T(1.0), "T_1"), (View::Rdiff, "R_diff"), (View::Tdiff, "T_diff")]
    {
        let grid = Subject::new(&Slab::BENIGN.text_with(view, &text), &wrt)?;
        let m = b.measure(&grid, &combinations, PATHS)?;
        let same = b.measure(&Slab::BENIGN.subject(view, &wrt)?, &combinations, PATHS)?;
        let picture = Subject::new(&Slab::BENIGN.text_with(view, &text), &[])?;
        let value = b.time(&picture, &Slab::BENIGN.subject(view, &[])?, Some(4.0))?;
        let derivative = b.time(&grid, &Slab::BENIGN.subject(view, &wrt)?, Some(4.0))?;
        for (k, d) in ["", ":d_tau", ":d_albedo", ":d_g"].iter().enumerate() {
            let q = format!("{name}{d}");
            let Some(known) = slab("slab_t1_a0.9_g0_n1", &q) else { continue };
            let relvar = Some(1.2 * same.estimates[k].relvar);
            b.judge(
                &q,
                &m,
                k,
                Check { relvar, time: if k == 0 { value } else { derivative }, ..Check::new(known, 1e-4) },
            );
        }
    }
    Ok(())
}

pub fn all_zero(b: &mut Bench) -> Result<()> {
    let scratch = Scratch::new()?;
    let zeros = ones(&scratch, 0.0)?;
    let empty = scratch.0.join("empty.vdb");
    let grid = vdb::WriteGrid {
        name: "density".into(),
        channels: 1,
        world_from_index: DAffine3::IDENTITY,
        background: 0.0,
        leaves: Vec::new(),
        tiles: Vec::new(),
        class: "fog volume".into(),
        half: false,
    };
    vdb::write(&empty, &[grid]).map_err(|e| Error::Runtime(e.to_string()))?;
    let no_voxels = format!(
        r#"<medium type="heterogeneous" id="fog"><float name="albedo" value="$albedo"/><float name="scale" value="$sigma_t"/>
        <volume name="sigma_t" type="openvdb"><string name="filename" value="{}"/></volume>
        <phase type="hg"><float name="g" value="$g"/></phase></medium>"#,
        empty.display()
    );
    let vacuum = Slab::new(0.0, 0.9, 0.0);
    for (label, text) in [("zeros", &zeros), ("no active voxels", &no_voxels)] {
        for (view, name, value) in
            [(View::R(1.0), "R_1", 0.0), (View::T(1.0), "T_1", 1.0), (View::Tdiff, "T_diff", 1.0)]
        {
            let s = Subject::new(&Slab::BENIGN.text_with(view, text), &["sigma_t"])?;
            let m = b.measure(&s, &[vec![1.0, 0.0], vec![0.0, 1.0]], 1 << 12)?;
            let time = b.time(
                &Subject::new(&Slab::BENIGN.text_with(view, text), &[])?,
                &vacuum.subject(view, &[])?,
                Some(1.5),
            )?;
            // The receiver itself shades 1e-8 of the light.
            let tolerance = if view == View::Tdiff { 1e-6 } else { 0.0 };
            let check = |x: f64| Check { tolerance, relvar: Some(1e-10), ..Check::new(Known::exact(x), 0.0) };
            b.judge(&format!("{name} {label}"), &m, 0, Check { time, ..check(value) });
            b.judge(&format!("{name}:d_scale {label}"), &m, 1, check(0.0));
        }
    }
    // What absorbs only, of the thickness 1 and the scale 1: all voxels together take 1 of T = 1, those around the ray their parts.
    let s = Subject::new(&Slab::new(1.0, 0.0, 0.0).text_with(View::T(1.0), &zeros), &[])?;
    let (gradient, params) = s.voxels("fog.sigma_t.grid")?;
    let own = &gradient[params.arrays[0].range()];
    let met = own.iter().filter(|&&x| x < 0.0).count();
    b.exact("T_1:d_voxels", own.iter().sum(), -1.0, 1e-9, &format!("{met} of {} voxels on the ray", own.len()));
    Ok(())
}

/// Background 1e-6, one node of 1e6, in a cube of edge `unit`; the ray passes `offset` nodes beside it.
fn hot_voxel(scratch: &Scratch, unit: f64, offset: f64, hot: f32) -> Result<String> {
    let n = 64;
    let mut values = vec![1e-6; n * n * n];
    values[(32 * n + 32) * n + 32] = hot;
    let path = scratch.vol([n; 3], values)?;
    let low = -(32.5 + offset) / n as f64 * unit;
    Ok(medium(&path, [low, low, 0.0], [low + unit, low + unit, unit]))
}

pub fn hot(b: &mut Bench) -> Result<()> {
    let scratch = Scratch::new()?;
    // Through the middle of the hot node's tent, and halfway down its side.
    let through =
        |weight: f64, unit: f64| (-(1e6 * weight * unit / 64.0)).exp() * (-1e-6 * unit * (1.0 - weight / 64.0)).exp();
    for (label, unit, offset, truth, tolerance) in [
        ("beside", 1.0, 4.0, (-1e-6f64).exp(), 1e-12),
        ("through 1e-4", 1e-4, 0.0, through(1.0, 1e-4), 1e-6),
        ("side of it 1e-4", 1e-4, 0.5, through(0.25, 1e-4), 1e-6),
        ("through 1", 1.0, 0.0, 0.0, 0.0),
    ] {
        let text = hot_voxel(&scratch, unit, offset, 1e6)?;
        let s = Slab { unit, ..Slab::new(unit, 0.0, 0.0) };
        for (view, name) in [(View::T(1.0), "T"), (View::Shadow, "T_shadow")] {
            let subject = Subject::new(&s.text_with(view, &text), &["sigma_t"])?;
            let m = b.measure(&subject, &[vec![1.0, 0.0], vec![0.0, 1.0]], 1 << 14)?;
            // Nodes are single precision: 3e-8 of a derivative.
            let of = |x: f64, tolerance: f64| Check { relvar: Some(5.0), ..Check::new(Known::exact(x), tolerance) };
            b.judge(&format!("{name} {label}"), &m, 0, of(truth, tolerance));
            let slope = if truth > 0.0 { truth * truth.ln() } else { 0.0 };
            b.judge(&format!("{name}:d_scale {label}"), &m, 1, of(slope, 1e-6));
        }
    }
    // Scattering around it: nothing is absorbed, so the radiance is 1.
    let build = |view: View, albedo: f64, unit: f64, hot: f32| {
        let s = Slab { unit, ..Slab::new(unit, albedo, 0.0) };
        Subject::new(&s.text_with(view, &hot_voxel(&scratch, unit, 0.0, hot)?), &[])
    };
    for (label, unit) in [("1", 1.0), ("1e-4", 1e-4)] {
        let m = b.measure(&build(View::Furnace, 1.0, unit, 1e6)?, &[vec![1.0]], 1 << 14)?;
        b.judge(&format!("furnace {label}"), &m, 0, Check { tolerance: 1e-6, ..Check::new(Known::exact(1.0), 0.0) });
    }
    // What walks beside it cost: all directions from a receiver, absorption only. A sphere of a node's width at 1.5 hides 1e-4 of them.
    let walk = build(View::Tdiff, 0.0, 1.0, 1e6)?;
    let m = b.measure(&walk, &[vec![1.0]], 1 << 16)?;
    let time = b.time(&walk, &build(View::Tdiff, 0.0, 1.0, 1e-6)?, Some(20.0))?;
    b.judge("T_diff 1", &m, 0, Check { tolerance: 1e-3, relvar: Some(5.0), time, known: Known::exact(1.0) });
    Ok(())
}

/// Broken voxels are refused by name and place; on request they are repaired and counted.
pub fn invalid_voxels(b: &mut Bench) -> Result<()> {
    let scratch = Scratch::new()?;
    for (label, bad) in [("NaN", f32::NAN), ("+Inf", f32::INFINITY), ("-1", -1.0)] {
        let mut values = vec![1.0; 8 * 8 * 8];
        values[(3 * 8 + 2) * 8 + 1] = bad;
        let path = scratch.vol([8; 3], values)?;
        let text = Slab::BENIGN.text_with(View::R(1.0), &medium(&path, [-1e4, -1e4, 0.0], [1e4, 1e4, 1.0]));
        let desc = SceneDesc::parse(&text, Path::new("stress/scene.xml"), &[])?;
        let seen = match Scene::compile(&desc, &LoadOptions::default()) {
            Ok(_) => Err("loaded without a word".into()),
            Err(e) => {
                let e = e.to_string().replace('\n', " ");
                let named =
                    e.contains("density.vol") && ["1, 2, 3", "[1, 2, 3]", "1 2 3"].iter().any(|i| e.contains(i));
                if named { Ok(e) } else { Err(format!("names no file and index: {e}")) }
            }
        };
        b.policy(label, seen);
        let desc = SceneDesc::parse(&text, Path::new("stress/scene.xml"), &[])?;
        let seen = match Scene::compile(&desc, &LoadOptions { repair_voxels: true, ..Default::default() }) {
            Ok(s) => s
                .warnings
                .iter()
                .find(|w| w.kind == WarningKind::RepairedVoxels)
                .map(|w| w.what.clone())
                .ok_or_else(|| "repaired without a warning".to_string()),
            Err(e) => Err(e.to_string()),
        };
        b.policy(&format!("{label}, repaired"), seen);
    }
    Ok(())
}
