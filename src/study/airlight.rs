//! Lights with a position: single scattering along a ray beside a point light, and irradiance through an absorber, against
//! the closed forms.
//!
//! Extinction and scattering are independent in the closed forms. Where `sigma_s = albedo sigma_t` is a legal medium, the scene is
//! compiled as it is and `d/dsigma_t` at fixed `sigma_s` is `d_sigma_t - (albedo / sigma_t) d_albedo`, formed path by path. Where
//! `sigma_t = 0 < sigma_s` the compiled medium is set by hand: `sigma_t`, `sigma_s` as wanted, density 1, so that the albedo's
//! slot has the meaning of `sigma_s`, and an albedo of 0, so that the slot of `sigma_t` moves the extinction alone.

use super::measure::{Subject, film};
use super::reference::{ClosedForm, Known, closed_forms};
use super::stress::{Bench, Check};
use crate::error::Result;
use crate::math::Rgb;
use crate::medium::Volume;
use std::f64::consts::PI;

const PATHS: usize = 1 << 18;

/// A camera ray along +z from the origin to a black wall, a point light at (h, 0, tl).
struct Airlight {
    h: f64,
    tl: f64,
    length: f64,
    sigma_t: f64,
    sigma_s: f64,
    g: f64,
    /// Edge of a half-plane at height .1 before the light that hides it from abscissae below .0's shadow.
    edge: Option<(f64, f64)>,
}

impl Airlight {
    fn of(c: &ClosedForm) -> Self {
        Airlight {
            h: c.param("h"),
            tl: c.param("tl"),
            length: c.param("D"),
            sigma_t: c.param("sigma_t"),
            sigma_s: c.param("sigma_s"),
            g: c.param("g"),
            edge: None,
        }
    }

    fn text(&self) -> String {
        let albedo = if self.sigma_t > 0.0 { self.sigma_s / self.sigma_t } else { 0.0 };
        format!(
            r#"<scene version="3.0.0">
            <default name="sigma_t" value="{:e}"/><default name="albedo" value="{albedo:e}"/><default name="g" value="{:e}"/>
            <default name="h" value="{:e}"/><default name="tl" value="{:e}"/>
            <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
            <medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/>
              <phase type="hg"><float name="g" value="$g"/></phase></medium>
            <shape type="rectangle"><transform name="to_world"><scale value="1e4"/><rotate y="1" angle="180"/><translate z="{:e}"/></transform>
              <bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></shape>
            <emitter type="point"><point name="position" value="$h, 0, $tl"/><rgb name="intensity" value="1"/><ref id="fog"/></emitter>
            {}<sensor type="orthographic"><transform name="to_world"><scale value="1e-16"/></transform><ref id="fog"/>{}</sensor></scene>"#,
            self.sigma_t,
            self.g,
            self.h,
            self.tl,
            self.length,
            self.edge.map_or(String::new(), half_plane),
            film()
        )
    }

    /// With derivatives: extinction, scattering, g.
    fn subject(&self, wrt: &[&str]) -> Result<Subject> {
        let mut s = Subject::new(&self.text(), wrt)?;
        if self.sigma_t == 0.0 {
            let m = &mut s.scene.media[0];
            m.sigma_s = Rgb::splat(self.sigma_s);
            m.density = Volume::Constant(Rgb::ONE);
        }
        Ok(s)
    }

    /// Coefficients over the layers (value, sigma_t, albedo, g, h): value, d/dsigma_t at fixed sigma_s, d/dsigma_s, d/dg, d/dh.
    fn combinations(&self) -> [Vec<f64>; 5] {
        let (st, ss) = (self.sigma_t, self.sigma_s);
        let (by_t, by_s) = if st > 0.0 {
            (vec![0.0, 1.0, -ss / (st * st), 0.0, 0.0], 1.0 / st)
        } else {
            (vec![0.0, 1.0, 0.0, 0.0, 0.0], 1.0)
        };
        let unit = |k: usize, x: f64| (0..5).map(|i| if i == k { x } else { 0.0 }).collect::<Vec<_>>();
        [unit(0, 1.0), by_t, unit(2, by_s), unit(3, 1.0), unit(4, 1.0)]
    }
}

/// The ray that times are relative to: light at distance 1, extinction 1.
fn benign() -> Airlight {
    Airlight { h: 1.0, tl: 1.0, length: 2.0, sigma_t: 1.0, sigma_s: 0.9, g: 0.0, edge: None }
}

/// Abscissae below `xe` at the height `ye` are covered.
fn half_plane((xe, ye): (f64, f64)) -> String {
    const HALF: f64 = 1e3;
    format!(
        r#"<default name="xe" value="{xe:e}"/><default name="ye" value="{ye:e}"/>
            <shape type="rectangle"><transform name="to_world"><translate x="1"/><scale value="{HALF}"/><rotate y="1" angle="90"/><translate x="$ye" z="$xe"/></transform>
            <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf></shape>"#
    )
}

/// The closed form of a case's name, as `airlight-h1e-3-s10-g0.5`.
fn closed_form(name: &str) -> Option<&'static ClosedForm> {
    let mut parts = name.strip_prefix("airlight-h")?.split("-s");
    let h: f64 = parts.next()?.parse().ok()?;
    let (s, g) = parts.next()?.split_once("-g")?;
    let (s, g): (f64, f64) = (s.parse().ok()?, g.parse().ok()?);
    closed_forms().iter().find(|c| {
        c.id.starts_with("airlight_point_single") && c.param("h") == h && c.param("sigma_t") == s && c.param("g") == g
    })
}

pub fn case(b: &mut Bench) -> Result<()> {
    match closed_form(&b.case.name) {
        Some(c) => rows(b, c, ""),
        None => Ok(()),
    }
}

fn rows(b: &mut Bench, c: &ClosedForm, label: &str) -> Result<()> {
    let a = Airlight::of(c);
    let wrt = ["sigma_t", "albedo", "g", "h"];
    let s = a.subject(&wrt)?;
    let m = b.measure(&s, &a.combinations(), PATHS)?;
    let value = b.time(&a.subject(&[])?, &benign().subject(&[])?, Some(3.0))?;
    let derivative = b.time(&s, &benign().subject(&wrt)?, Some(3.0))?;
    let truths = [
        ("L", c.known(), value),
        ("L:d_sigma_t", c.derivative("sigma_t"), derivative),
        ("L:d_sigma_s", c.derivative("sigma_s"), derivative),
        ("L:d_g", c.derivative("g"), derivative),
        ("L:d_h", c.derivative("h"), derivative),
    ];
    for (k, (q, known, time)) in truths.into_iter().enumerate() {
        // Stated for the listed cases; a strong forward peak beside the light costs more than the distance's 1/r^2.
        let relvar = (k == 0 && a.g.abs() <= 0.5).then_some(2.0);
        let tolerance = 1e-5 * known.value.abs();
        b.judge(&format!("{q}{label}"), &m, k, Check { known, tolerance, relvar, time });
    }
    Ok(())
}

/// The light stands on the ray: the radiance diverges, and the run must say so.
pub fn light_on_ray(b: &mut Bench) -> Result<()> {
    // Away from the origin, where the film's extent rounds to nothing: every ray goes exactly through the light.
    let text = Airlight { h: 1.0, ..benign() }
        .text()
        .replace("$h, 0, $tl", "$h, 1, $tl")
        .replace(r#"<scale value="1e-16"/>"#, r#"<scale value="1e-30"/><translate x="1" y="1"/>"#);
    let s = Subject::new(&text, &["sigma_t"])?;
    let outcome = b.pool.install(|| s.job(1 << 12, 1, s.mode()).run(&|_| {}))?;
    let film = &outcome.film;
    let finite = (0..film.spec().pixels()).all(|p| (0..2).all(|l| film.mean(l, p).is_finite()));
    let warned = s.scene.warnings.iter().any(|w| w.kind == crate::error::WarningKind::LightOnRay);
    let health: Vec<String> = film.health.entries().filter(|e| e.1 > 0).map(|(n, k)| format!("{k} {n}")).collect();
    let seen = format!(
        "pixel {:?}, {}, film finite: {finite}, load warning: {warned}",
        outcome.light_on_ray,
        health.join(", ")
    );
    let good = finite && outcome.light_on_ray.is_some();
    b.policy("diagnostic", if good { Ok(seen) } else { Err(seen) });
    Ok(())
}

/// Irradiance on a white receiver at distance r of a point light in an absorber. The camera looks at the receiver from 1e-14 above
/// it, so its own path costs nothing; the radiance is E / pi.
pub fn point_irradiance(b: &mut Bench) -> Result<()> {
    let (r, sigma) = match b.case.name.as_str() {
        "point-irradiance-s1-r1e-4" => (1e-4, 1.0),
        _ => (1.0, 100.0),
    };
    let text = format!(
        r#"<scene version="3.0.0"><default name="sigma_t" value="{sigma:e}"/><default name="r" value="{r:e}"/>
        <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>
        <medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="0"/></medium>
        <shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="1"/></bsdf></shape>
        <emitter type="point"><point name="position" value="0, 0, $r"/><rgb name="intensity" value="1"/><ref id="fog"/></emitter>
        <sensor type="orthographic"><transform name="to_world"><scale value="1e-16"/><rotate y="1" angle="180"/><translate z="1e-14"/></transform>
          <ref id="fog"/>{}</sensor></scene>"#,
        film()
    );
    let s = Subject::new(&text, &["sigma_t", "r"])?;
    let m = b.measure(&s, &[vec![PI, 0.0, 0.0], vec![0.0, PI, 0.0], vec![0.0, 0.0, PI]], 1 << 10)?;
    let Some(c) = closed_forms()
        .iter()
        .find(|c| c.id.starts_with("point_light") && c.param("r") == r && c.param("sigma_t") == sigma)
    else {
        return Ok(());
    };
    // Every path is the same number: no variance beside rounding.
    let check = |known: Known| Check { relvar: Some(1e-20), ..Check::new(known, 1e-10) };
    b.judge("E", &m, 0, check(c.known()));
    b.judge("E:d_sigma_t", &m, 1, check(c.derivative("sigma_t")));
    b.judge("E:d_r", &m, 2, check(c.derivative("r")));
    Ok(())
}

/// The light behind the edge of a half-plane: what its own motion and the edge's change, boundary terms included.
pub fn shadow_edge(b: &mut Bench) -> Result<()> {
    let id = format!("airlight_point_shadow_edge_0{}", b.case.name.rsplit('-').next().unwrap_or_default());
    let Some(c) = closed_forms().iter().find(|c| c.id == id) else { return Ok(()) };
    let a = Airlight { edge: Some((c.param("xe"), c.param("ye"))), ..Airlight::of(c) };
    let wrt = ["sigma_t", "albedo", "g", "h", "tl"];
    let s = a.subject(&wrt)?;
    let unit = |n: usize, k: usize| (0..=n).map(|i| f64::from(i == k)).collect::<Vec<_>>();
    let m = b.measure(&s, &[unit(5, 0), unit(5, 4), unit(5, 5)], PATHS)?;
    let time = b.time(&s, &benign().subject(&wrt)?, Some(3.0))?;
    let truths = [("L", c.known()), ("L:d_h", c.derivative("h")), ("L:d_tl", c.derivative("tl"))];
    for (k, (q, known)) in truths.into_iter().enumerate() {
        let tolerance = 1e-4 * known.value.abs();
        b.judge(q, &m, k, Check { known, tolerance, relvar: None, time });
    }
    let m = b.measure(&a.subject(&["xe", "ye"])?, &[unit(2, 1), unit(2, 2)], PATHS)?;
    for (k, (q, known)) in [("L:d_xe", c.derivative("xe")), ("L:d_ye", c.derivative("ye"))].into_iter().enumerate() {
        b.judge(q, &m, k, Check::new(known, 1e-4));
    }
    Ok(())
}

/// All other airlight rows of the closed forms.
pub fn all_rows(b: &mut Bench) -> Result<()> {
    for c in closed_forms().iter().filter(|c| c.id.starts_with("airlight_point_single")) {
        rows(b, c, &format!(" #{}", c.id.rsplit('_').next().unwrap_or_default()))?;
    }
    Ok(())
}
