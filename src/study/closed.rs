//! Media and interfaces whose light has a closed form (`closed_forms.csv`): a slab and a ball that glow, a clear slab of glass.

use super::measure::{Subject, film};
use super::reference::{ClosedForm, closed_forms};
use super::slab::{Slab, View};
use super::stress::{Bench, Check};
use crate::error::Result;

const PATHS: usize = 1 << 17;

/// The rows of `closed_forms.csv` that a case names: one, or several as `emissive_slab_00,02,04,06`.
fn rows(reference: &str) -> Vec<&'static ClosedForm> {
    let stem = reference.split(',').next().unwrap_or_default().rsplit_once('_').map_or("", |s| s.0);
    let ids = reference.split(',').map(|s| if s.contains('_') { s.to_string() } else { format!("{stem}_{s}") });
    ids.filter_map(|id| closed_forms().iter().find(|c| c.id == id)).collect()
}

/// One layer: the value, or a derivative, in units of the parameter.
fn layer(k: usize, n: usize, scale: f64) -> Vec<f64> {
    (0..=n).map(|l| if l == k { scale } else { 0.0 }).collect()
}

/// A row's value and its derivatives; `wrt`: names there, of the scene's parameters, and what one unit of the first is in the second; `relvar`: bounds on relative variances, the value's first.
fn judge(
    b: &mut Bench,
    c: &ClosedForm,
    label: &str,
    subject: &Subject,
    wrt: &[(&str, f64)],
    scale: f64,
    relvar: &[Option<f64>],
) -> Result<()> {
    let n = wrt.len();
    let mut combinations = vec![layer(0, n, scale)];
    combinations.extend(wrt.iter().enumerate().map(|(k, (_, unit))| layer(k + 1, n, scale * unit)));
    let m = b.measure(subject, &combinations, PATHS)?;
    // What has underflowed beside the value is nothing.
    let check = |k: usize, known: super::reference::Known| Check {
        relvar: relvar.get(k).copied().flatten(),
        tolerance: (1e-6 * known.value.abs()).max(1e-12 * c.value.abs()),
        ..Check::new(known, 0.0)
    };
    b.judge(label, &m, 0, check(0, c.known()));
    for (k, (name, _)) in wrt.iter().enumerate() {
        b.judge(&format!("{label}:d_{name}"), &m, k + 1, check(k + 1, c.derivative(name)));
    }
    Ok(())
}

fn glowing(sigma: f64, emission: f64) -> String {
    format!(
        r#"<default name="sigma" value="{sigma:e}"/><default name="le" value="{emission:e}"/>
        <medium type="homogeneous" id="glow"><float name="sigma_t" value="$sigma"/><float name="albedo" value="0"/><rgb name="emission" value="$le, $le, $le"/></medium>"#
    )
}

/// [T] T2: `L = Lb exp(-σd) + Le (1 - exp(-σd))`, seen along the normal.
pub fn emissive_slab(b: &mut Bench) -> Result<()> {
    for c in rows(&b.case.reference.clone()) {
        let (sigma, d) = (c.param("sigma_a"), c.param("d"));
        let text = format!(
            r#"<scene version="3.0.0">{}<default name="half" value="{:e}"/><default name="lb" value="{:e}"/>
            <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
            <sensor type="orthographic"><transform name="to_world"><scale value="1e-9"/><translate z="-1"/></transform>{}</sensor>
            <shape type="cube"><transform name="to_world"><translate z="1"/><scale x="1e4" y="1e4" z="$half"/></transform><bsdf type="null"/><ref name="interior" id="glow"/></shape>
            <emitter type="constant"><rgb name="radiance" value="$lb"/></emitter></scene>"#,
            glowing(sigma, c.param("Le")),
            0.5 * d,
            c.param("Lb"),
            film()
        );
        let subject = Subject::new(&text, &["sigma", "half", "le", "lb"])?;
        let wrt = [("sigma_a", 1.0), ("d", 0.5), ("Le", 1.0), ("Lb", 1.0)];
        judge(b, c, &format!("sigma_a d {:e}", sigma * d), &subject, &wrt, 1.0, &[Some(0.0); 5])?;
    }
    Ok(())
}

/// All light that a ball sends one way: its picture through parallel rays, summed up.
pub fn emissive_sphere(b: &mut Bench) -> Result<()> {
    for c in rows(&b.case.reference.clone()) {
        // Twice as wide as high, each pixel a sample: a film of 2 x 2 radii.
        let text = format!(
            r#"<scene version="3.0.0">{}<default name="r" value="{:e}"/>
            <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
            <sensor type="orthographic"><transform name="to_world"><scale x="1" y="2"/><translate z="-5"/></transform>{}</sensor>
            <shape type="sphere"><float name="radius" value="$r"/><bsdf type="null"/><ref name="interior" id="glow"/></shape></scene>"#,
            glowing(c.param("sigma_a"), c.param("Le")),
            c.param("R"),
            film()
        );
        let subject = Subject { whole: true, ..Subject::new(&text, &["sigma", "r"])? };
        judge(b, c, "flux", &subject, &[("sigma_a", 1.0), ("R", 1.0)], 4.0, &[Some(0.5), None, Some(5.0)])?;
    }
    Ok(())
}

/// What a clear slab mirrors or lets through, light that goes back and forth in it included.
pub fn dielectric(b: &mut Bench) -> Result<()> {
    for c in rows(&b.case.reference.clone()) {
        let (n, mu) = (c.param("n"), c.param("mu0"));
        let slab = Slab { n, planes: true, ..Slab::new(c.param("tau"), 0.0, 0.0) };
        let (view, name) = if c.id.contains("_R_") { (View::R(mu), "R") } else { (View::T(mu), "T") };
        judge(b, c, name, &slab.subject(view, &["n"])?, &[("n", 1.0)], 1.0, &[])?;
    }
    Ok(())
}
