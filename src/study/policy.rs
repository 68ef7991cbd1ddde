//! What must be refused, counted or repeatable: bad input, samples that are no numbers, threads.

use super::measure::{Subject, film, pool};
use super::slab::{Slab, View};
use super::stress::Bench;
use crate::error::{Error, ExitCode, Result};
use crate::math::Rgb;
use crate::render::health::{DEFAULT_LIMIT, Mishap};
use crate::scene::compile::LoadOptions;
use crate::scene::{Scene, SceneDesc};
use std::path::Path;

fn load(text: &str) -> Result<Scene> {
    let desc = SceneDesc::parse(text, Path::new("stress/scene.xml"), &[])?;
    Scene::compile(&desc, &LoadOptions::default())
}

/// Loading must fail with a scene error that names the field.
fn refused(b: &mut Bench, label: &str, field: &str, text: &str) {
    let seen = match load(text) {
        Ok(_) => Err("loaded without a word".into()),
        Err(e) => {
            let placed = !matches!(&e, Error::Scene { span, .. } if span.line == 0);
            let said = e.to_string().replace('\n', " ");
            match (e.exit_code() == ExitCode::Scene, said.contains(field), placed) {
                (true, true, true) => Ok(said),
                (false, ..) => Err(format!("exit code {:?}: {said}", e.exit_code())),
                (_, false, _) => Err(format!("`{field}` is not named: {said}")),
                _ => Err(format!("no line: {said}")),
            }
        }
    };
    b.policy(label, seen);
}

fn slab_with(from: &str, to: &str) -> String {
    Slab::BENIGN.text(View::R(1.0)).replace(from, to)
}

pub fn g_endpoints(b: &mut Bench) -> Result<()> {
    for g in ["1", "-1", "1.5", "-7", "NaN", "inf"] {
        refused(b, &format!("g = {g}"), "g", &slab_with(r#"name="g" value="$g""#, &format!(r#"name="g" value="{g}""#)));
    }
    Ok(())
}

pub fn invalid_input(b: &mut Bench) -> Result<()> {
    let (sigma, albedo) = (r#"name="sigma_t" value="$sigma_t""#, r#"name="albedo" value="$albedo""#);
    for (name, from) in [("sigma_t", sigma), ("albedo", albedo)] {
        let values: &[&str] =
            if name == "albedo" { &["-0.1", "1.1", "NaN", "inf"] } else { &["-1", "NaN", "inf", "-inf"] };
        for v in values {
            refused(b, &format!("{name} = {v}"), name, &slab_with(from, &format!(r#"name="{name}" value="{v}""#)));
        }
    }
    for v in ["-1", "NaN", "inf"] {
        let scale = format!(r#"{sigma}/><float name="scale" value="{v}""#);
        refused(b, &format!("scale = {v}"), "scale", &slab_with(sigma, &scale));
        let radiance = format!(r#"name="radiance" value="{v}""#);
        refused(
            b,
            &format!("radiance = {v}"),
            "radiance",
            &slab_with(r#"name="radiance" value="$radiance""#, &radiance),
        );
    }
    for v in ["-0.5", "1.5", "NaN"] {
        let reflectance = format!(r#"name="reflectance" value="{v}""#);
        refused(
            b,
            &format!("reflectance = {v}"),
            "reflectance",
            &slab_with(r#"name="reflectance" value="0""#, &reflectance),
        );
    }
    // Through a parameter: the same checks.
    for v in ["-1", "NaN"] {
        let default = format!(r#"<default name="sigma_t" value="{v}"/>"#);
        refused(
            b,
            &format!("$sigma_t = {v}"),
            "sigma_t",
            &slab_with(r#"<default name="sigma_t" value="1e0"/>"#, &default),
        );
    }
    for (label, field, from, to) in [
        ("transform NaN", "to_world", r#"<scale x="1e4""#, r#"<scale x="NaN""#),
        ("transform inf", "to_world", r#"<scale x="1e4""#, r#"<scale x="inf""#),
        ("transform singular", "to_world", r#"<scale x="1e4""#, r#"<scale x="0""#),
        ("camera NaN", "to_world", r#"<scale value="1e-9""#, r#"<scale value="NaN""#),
        ("camera singular", "to_world", r#"<scale value="1e-9""#, r#"<scale value="0""#),
        ("max_depth", "max_depth", r#"name="max_depth" value="-1""#, r#"name="max_depth" value="-2""#),
    ] {
        refused(b, label, field, &slab_with(from, to));
    }
    for (label, field, shape) in [
        (
            "point position NaN",
            "position",
            r#"<emitter type="point"><point name="position" value="NaN, 0, 0"/></emitter>"#,
        ),
        ("intensity inf", "intensity", r#"<emitter type="point"><rgb name="intensity" value="inf"/></emitter>"#),
        ("sphere radius 0", "radius", r#"<shape type="sphere"><float name="radius" value="0"/></shape>"#),
        ("sphere radius NaN", "radius", r#"<shape type="sphere"><float name="radius" value="NaN"/></shape>"#),
        ("sphere center inf", "center", r#"<shape type="sphere"><point name="center" value="inf, 0, 0"/></shape>"#),
    ] {
        refused(b, label, field, &slab_with("</scene>", &format!("{shape}</scene>")));
    }
    for ior in ["0", "-1", "NaN"] {
        let glass = format!(
            r#"<shape type="sphere"><bsdf type="dielectric"><float name="int_ior" value="{ior}"/></bsdf></shape>"#
        );
        refused(b, &format!("int_ior = {ior}"), "int_ior", &slab_with("</scene>", &format!("{glass}</scene>")));
    }
    Ok(())
}

/// Two point lights over a white receiver, one of which sends something that is no number: half of the samples.
fn two_lights(bad: f64) -> Result<Subject> {
    let light = |x: f64| format!(r#"<emitter type="point"><point name="position" value="{x}, 0, 1"/></emitter>"#);
    let text = format!(
        r#"<scene version="3.0.0"><default name="rho" value="1"/><integrator type="path"><integer name="max_depth" value="2"/></integrator>
        <shape type="rectangle"><bsdf type="diffuse"><rgb name="reflectance" value="$rho"/></bsdf></shape>{}{}
        <sensor type="orthographic"><transform name="to_world"><scale value="1e-9"/><rotate y="1" angle="180"/><translate z="0.5"/></transform>{}</sensor></scene>"#,
        light(-0.5),
        light(0.5),
        film()
    );
    let mut s = Subject::new(&text, &["rho"])?;
    s.scene.lights[1].value = Rgb::splat(bad);
    Ok(s)
}

pub fn nan_policy(b: &mut Bench) -> Result<()> {
    for (label, bad) in [("NaN", f64::NAN), ("inf", f64::INFINITY), ("1e308", 1e308)] {
        let s = two_lights(bad)?;
        let mut job = s.job(64, 1, s.mode());
        job.spp = 64;
        let outcome = b.pool.install(|| job.run(&|_| {}))?;
        let film = &outcome.film;
        let pixels = film.spec().pixels();
        let finite = (0..pixels).all(|p| {
            (0..2).all(|l| film.mean(l, p).is_finite() && film.variance_of_mean(l, p).is_none_or(|v| v.is_finite()))
        });
        let samples = 64 * pixels as u64;
        let h = &film.health;
        let rejected = h.get(Mishap::RejectedNonfinite) + h.get(Mishap::Overflow);
        let per_pixel: u64 = (0..pixels).map(|p| u64::from(film.rejected(p))).sum();
        let decision = h.check(samples, DEFAULT_LIMIT);
        let exit = decision.as_ref().err().map(Error::exit_code);
        let good = finite && rejected > 0 && exit == Some(ExitCode::Check);
        let seen = format!(
            "{rejected} of {samples} samples rejected ({per_pixel} by pixel), film finite: {finite}, exit {}",
            exit.map_or("0".into(), |e| format!("{}", e as u8))
        );
        // Rejected samples must be found at their pixel too.
        b.policy(label, if good && per_pixel > 0 { Ok(seen) } else { Err(seen) });
    }
    Ok(())
}

/// The same bits for every number of threads, in value, derivatives and gradient.
pub fn thread_determinism(b: &mut Bench) -> Result<()> {
    let s = Slab::BENIGN.subject(View::R(0.5), &["sigma_t", "g"])?;
    let furnace = Slab::new(10.0, 0.999, 0.5).subject(View::Furnace, &["sigma_t", "albedo"])?;
    for (label, s) in [("benign", &s), ("t10 a0.999 g0.5", &furnace)] {
        let mut seen: Vec<Vec<u64>> = Vec::new();
        for threads in [1, 2, 8] {
            let pool = pool(threads)?;
            let mut bits = Vec::new();
            let mut job = s.job(512, 7, s.mode());
            job.spp = 40;
            let o = pool.install(|| job.run(&|_| {}))?;
            for p in 0..o.film.spec().pixels() {
                for l in 0..s.layers() {
                    bits.extend(o.film.mean(l, p).0.map(f64::to_bits));
                    bits.extend(o.film.variance_of_mean(l, p).unwrap_or_default().0.map(f64::to_bits));
                }
            }
            if let Some(params) = &s.params {
                let adjoint = vec![Rgb::ONE; 512];
                let mut job = s.job(512, 7, crate::render::driver::Mode::Reverse(params, &adjoint));
                job.spp = 40;
                let (g, e) = pool.install(|| job.run(&|_| {}))?.gradient.unwrap_or_default();
                bits.extend(g.into_iter().chain(e).map(f64::to_bits));
            }
            seen.push(bits);
        }
        let equal = seen.iter().all(|x| *x == seen[0]);
        let text = format!("{} numbers, 1/2/8 threads", seen[0].len());
        b.policy(label, if equal { Ok(text) } else { Err(format!("{text}: bits differ")) });
    }
    Ok(())
}

/// Geometry without extent: refused, or rendered as what it is.
pub fn degenerate(b: &mut Bench) -> Result<()> {
    let z = r#"z="5e-1"/>"#;
    refused(b, "zero-thickness slab", "to_world", &slab_with(z, r#"z="0"/>"#));
    let sphere = r#"<shape type="sphere"><float name="radius" value="0"/></shape></scene>"#;
    refused(b, "zero-radius sphere", "radius", &slab_with("</scene>", sphere));
    // The slab twice in one place: the second has no room of its own.
    let text = Slab::BENIGN.text(View::R(1.0));
    let (start, end) = (text.find("<shape"), text.find("</shape>"));
    if let (Some(i), Some(j)) = (start, end) {
        let twice = text.replacen("<emitter", &format!("{}<emitter", &text[i..j + 8]), 1);
        let s = Subject::new(&twice, &[])?;
        let m = b.measure(&s, &[vec![1.0]], 1 << 16)?;
        let e = m.estimates[0];
        let seen = format!("R_1 {} +- {:.1e} (one slab: 0.26741), {} boundaries missed", e.value, e.stderr, m.missed);
        b.policy("coincident slabs", if e.value.is_finite() { Ok(seen) } else { Err(seen) });
    }
    b.not_yet("sliver triangles", "needs a mesh case");
    Ok(())
}
