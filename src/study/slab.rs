//! Plane-parallel slabs: value and derivatives against adding-doubling (`slab_values.csv`).
//!
//! The slab is a cube of thickness 1 in z and `HALF_WIDTH` each way, null boundary, seen by an orthographic camera at z < 0 looking
//! towards +z. `R_m`: a constant environment of radiance 1, and a black rectangle close behind the far face, so that light comes
//! from the camera's side only. `T_m`: the black rectangle stands behind the camera instead. What slips past the rectangles' or
//! the slab's rims is below 1e-6 of the light. `R_diff`, `T_diff`: the camera looks at a white diffuse receiver of half width
//! 1e-4 that faces the slab: its radiance is `integral of 2 m R_m dm`, exact to the solid angle that it shades, 1e-8.

use super::measure::{Subject, film};
use super::reference::{Known, slab};
use super::stress::{Bench, Check};
use crate::error::Result;

/// Of the slab, in thicknesses.
const HALF_WIDTH: f64 = 1e4;
/// Paths of a case with a mean of 2.6 path segments; less where paths are longer.
const PATHS: usize = 1 << 19;

/// What lights the slab, and who looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum View {
    /// Radiance at cosine m, lit from the camera's side.
    R(f64),
    /// Radiance at cosine m, lit from the other side.
    T(f64),
    Rdiff,
    Tdiff,
    /// Light from everywhere.
    Furnace,
    /// The receiver lit through the slab along the axis by a distant light: the transmittance of a shadow ray.
    Shadow,
}

impl View {
    /// `R_0.5`, `T_diff`, ...
    pub fn parse(quantity: &str) -> Option<View> {
        let name = quantity.split(':').next()?;
        Some(match name {
            "R_diff" => View::Rdiff,
            "T_diff" => View::Tdiff,
            _ => match (name.split_at_checked(2)?, name[2..].parse().ok()?) {
                (("R_", _), m) => View::R(m),
                (("T_", _), m) => View::T(m),
                _ => return None,
            },
        })
    }
}

/// A slab scene.
#[derive(Clone, Copy, Debug)]
pub struct Slab {
    pub tau: f64,
    pub albedo: f64,
    pub g: f64,
    /// Index of refraction inside; at 1 there is no interface.
    pub n: f64,
    /// Length of the thickness.
    pub unit: f64,
    /// Moved by this much along every axis.
    pub shift: f64,
    pub radiance: f64,
    /// Camera: in front of the face by this much of the thickness; and inside the medium?
    pub distance: f64,
    pub inside: bool,
    /// Made of two planes, with media that absorb everything in place of black walls: nothing has an outline then, so that a derivative by the index is the interior's alone.
    pub planes: bool,
    /// Half its thickness is a parameter, `half`.
    pub moves: bool,
}

impl Slab {
    pub const fn new(tau: f64, albedo: f64, g: f64) -> Self {
        Slab {
            tau,
            albedo,
            g,
            n: 1.0,
            unit: 1.0,
            shift: 0.0,
            radiance: 1.0,
            distance: 0.005,
            inside: false,
            planes: false,
            moves: false,
        }
    }

    pub const BENIGN: Slab = Slab::new(1.0, 0.9, 0.0);

    /// From the name of a case of `slab_values.csv`, as `slab_t1e5_a1m1e-8_g0.9_n1`.
    fn parse(case: &str) -> Option<Slab> {
        let mut parts = case.strip_prefix("slab_t")?.split('_');
        let tau = parts.next()?.parse().ok()?;
        let albedo = parts.next()?.strip_prefix('a')?;
        let albedo = match albedo.split_once('m') {
            Some((one, less)) => one.parse::<f64>().ok()? - less.parse::<f64>().ok()?,
            None => albedo.parse().ok()?,
        };
        let g = parts.next()?.strip_prefix('g')?.parse().ok()?;
        let n = parts.next()?.strip_prefix('n')?.parse().ok()?;
        Some(Slab { n, ..Slab::new(tau, albedo, g) })
    }

    pub fn medium(&self) -> String {
        r#"<medium type="homogeneous" id="fog"><float name="sigma_t" value="$sigma_t"/><float name="albedo" value="$albedo"/>
            <phase type="hg"><float name="g" value="$g"/></phase></medium>"#
            .into()
    }

    /// The scene text, with parameters `sigma_t`, `albedo`, `g`, and `radiance` of the environment.
    pub fn text(&self, view: View) -> String {
        self.text_with(view, &self.medium())
    }

    /// The same around another medium of id `fog`.
    pub fn text_with(&self, view: View, medium: &str) -> String {
        let (u, s) = (self.unit, self.shift);
        let at = |z: f64| format!(r#"<translate x="{s}" y="{s}" z="{}"/>"#, s + z * u);
        let rectangle = |half: f64, angle: f64, z: f64, reflectance: f64| {
            format!(
                r#"<shape type="rectangle"><transform name="to_world"><scale value="{:e}"/><rotate y="1" angle="{angle}"/>{}</transform>
                <bsdf type="diffuse"><rgb name="reflectance" value="{reflectance}"/></bsdf></shape>"#,
                half * u,
                at(z)
            )
        };
        let wall = |z: f64| rectangle(1e6, 0.0, z, 0.0);
        let camera = |angle: f64, z: f64| {
            format!(r#"<scale value="{:e}"/><rotate y="1" angle="{angle:.17}"/>{}"#, 1e-9 * u, at(z))
        };
        let towards = |m: f64| camera(m.acos().to_degrees(), -self.distance);
        let receiver = camera(180.0, -0.01).to_string();
        let (camera, extra) = match view {
            View::R(m) => (towards(m), wall(1.01)),
            View::T(m) => (towards(m), wall(-0.01)),
            View::Furnace => (towards(1.0), String::new()),
            View::Rdiff => (receiver, wall(1.01) + &rectangle(1e-4, 0.0, -1.0, 1.0)),
            View::Tdiff => (receiver, wall(-1.01) + &rectangle(1e-4, 0.0, -1.0, 1.0)),
            View::Shadow => (receiver, rectangle(1e-4, 0.0, -1.0, 1.0)),
        };
        let emitter = match view {
            View::Shadow => format!(
                r#"<emitter type="directional"><vector name="direction" value="0, 0, -1"/>
                <rgb name="irradiance" value="{:e}"/></emitter>"#,
                self.radiance * std::f64::consts::PI
            ),
            _ => r#"<emitter type="constant"><rgb name="radiance" value="$radiance"/></emitter>"#.into(),
        };
        let bsdf = match self.n == 1.0 {
            true => r#"<bsdf type="null"/>"#,
            false => {
                r#"<bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf>"#
            }
        };
        let body = match self.planes {
            false => {
                let w = HALF_WIDTH * u;
                // The front stays where it is.
                let place = match self.moves {
                    true => format!(r#"<translate z="1"/><scale x="{w:e}" y="{w:e}" z="$half"/>{}"#, at(0.0)),
                    false => format!(r#"<scale x="{w:e}" y="{w:e}" z="{:e}"/>{}"#, 0.5 * u, at(0.5)),
                };
                format!(
                    r#"<shape type="cube"><transform name="to_world">{place}</transform>{bsdf}<ref name="interior" id="fog"/></shape>{extra}"#
                )
            }
            true => {
                let plane = |angle: f64, z: f64, bsdf: &str, media: &str| {
                    format!(
                        r#"<shape type="rectangle"><transform name="to_world"><scale value="{:e}"/><rotate y="1" angle="{angle}"/>{}</transform>{bsdf}{media}</shape>"#,
                        HALF_WIDTH * u,
                        at(z)
                    )
                };
                let (fog, black) = (r#"<ref name="interior" id="fog"/>"#, r#"<ref name="exterior" id="black"/>"#);
                let dark = matches!(view, View::R(_));
                let behind = if dark { format!("{fog}{black}") } else { fog.to_string() };
                let front = plane(180.0, 0.0, bsdf, fog) + &plane(0.0, 1.0, bsdf, &behind);
                let null = r#"<bsdf type="null"/>"#;
                let wall = plane(0.0, -0.01, null, r#"<ref name="interior" id="black"/>"#);
                let absorbs = format!(
                    r#"<medium type="homogeneous" id="black"><float name="sigma_t" value="{:e}"/><float name="albedo" value="0"/></medium>"#,
                    1e6 / u
                );
                absorbs + &front + if matches!(view, View::T(_)) { &wall } else { "" }
            }
        };
        let n = if self.n == 1.0 { String::new() } else { format!(r#"<default name="n" value="{:?}"/>"#, self.n) };
        let half = if self.moves { format!(r#"<default name="half" value="{:e}"/>"#, 0.5 * u) } else { String::new() };
        let inside = if self.inside { r#"<ref id="fog"/>"# } else { "" };
        format!(
            r#"<scene version="3.0.0">
            <default name="sigma_t" value="{:e}"/><default name="albedo" value="{:e}"/><default name="g" value="{:e}"/>
            <default name="radiance" value="{:e}"/>{n}{half}
            <integrator type="volpath"><integer name="max_depth" value="-1"/></integrator>
            {medium}
            {body}
            {emitter}
            <sensor type="orthographic"><transform name="to_world">{camera}</transform>{inside}{}</sensor></scene>"#,
            self.tau / u,
            self.albedo,
            self.g,
            self.radiance,
            film(),
        )
    }

    pub fn subject(&self, view: View, wrt: &[&str]) -> Result<Subject> {
        Subject::new(&self.text(view), wrt)
    }
}

/// The parameter of a quantity's derivative.
fn parameter(quantity: &str) -> Option<&'static str> {
    match quantity.split_once(':')?.1 {
        "d_tau" => Some("sigma_t"),
        "d_albedo" => Some("albedo"),
        "d_g" => Some("g"),
        "d_n" => Some("n"),
        _ => None,
    }
}

/// Bounds on the relative variance: column 9 of the case list. "As benign" where the list says so.
const RELVAR: [(&str, &[(&str, f64)]); 23] = [
    ("benign", &[("R_1", 2.0), ("T_1", 0.56), ("R_1:d_tau", 11.0)]),
    ("thin-1e-6", &[("R_1:d_tau", 10.0), ("T_1:d_tau", 10.0)]),
    ("thin-1e-3", &[("R_1", 20.0)]),
    ("thick-conservative-100", &[("R_1", 0.035), ("R_1:d_albedo", 50.0)]),
    ("thick-near-conservative", &[("R_1", 0.11)]),
    ("thick-forward-1000", &[("R_1", 0.035)]),
    ("stiff-1e5-near-conservative", &[("R_1", 1e-3)]),
    ("stiff-1e5-conservative", &[("R_1", 1e-3)]),
    ("thick-absorbing-underflow", &[("R_1", 3.0)]),
    ("g-1e-8", &[("R_1", 2.0), ("T_1", 0.56)]),
    ("g-1e-4", &[("R_1", 2.0), ("T_1", 0.56)]),
    ("g-0.99", &[("R_1", 1e3), ("T_1", 0.03)]),
    ("g-minus-0.99", &[("R_1", 2.1)]),
    ("g-0.999", &[("R_1", 2e3), ("T_1", 0.22)]),
    ("g-minus-0.9", &[("R_0.5", 0.7)]),
    ("ior-1.0001", &[("R_1", 2.1)]),
    ("ior-1.5", &[("R_1", 3.6)]),
    ("ior-2.4-conservative", &[("R_1", 0.9)]),
    ("ior-1.33-forward", &[("R_1", 3.4)]),
    ("albedo-zero-derivative", &[("R_1:d_albedo", 20.0)]),
    ("camera-on-boundary", &[("R_1", 2.0), ("T_1", 0.56)]),
    // Bounds twice what was seen: each known to 4 % or better.
    (
        "thick-forward-10",
        &[
            ("R_1:d_tau", 180.0),
            ("R_1:d_albedo", 8.0),
            ("R_1:d_g", 160.0),
            ("T_1:d_tau", 330.0),
            ("T_1:d_albedo", 2.5),
            ("T_1:d_g", 300.0),
        ],
    ),
    // By g a path counts 60 times the derivative: noise.
    ("thick-forward-100", &[("R_1:d_albedo", 7.0), ("T_1:d_albedo", 17.0)]),
];

fn relvar_bound(case: &str, quantity: &str) -> Option<f64> {
    let of_case = RELVAR.iter().find(|(c, _)| *c == case)?.1;
    of_case.iter().find(|(q, _)| *q == quantity).map(|(_, b)| *b)
}

pub fn is_table_case(name: &str) -> bool {
    name != "camera-on-boundary" && RELVAR.iter().any(|(c, _)| *c == name)
}

/// Paths by the length of the case's paths.
fn paths(case: &str) -> usize {
    match case {
        "thick-conservative-100" | "thick-near-conservative" => 1 << 15,
        "thick-forward-1000" => 1 << 13,
        "stiff-1e5-conservative" | "stiff-1e5-near-conservative" => 256,
        "g-0.999" | "g-minus-0.9" | "thick-absorbing-underflow" => 1 << 18,
        "ior-1.33-forward" | "thick-forward-10" => 1 << 17,
        "thick-forward-100" => 1 << 14,
        "ior-2.4-conservative" => 1 << 15,
        _ => PATHS,
    }
}

/// Tolerance beside 4 standard errors: column 8 of the case list.
fn tolerance(case: &str, quantity: &str, known: Known) -> f64 {
    match case {
        c if c.starts_with("stiff") && !quantity.contains(':') => 1e-3,
        "thick-absorbing-underflow" if quantity.starts_with('T') => 1e-30,
        _ => 1e-4 * known.value.abs(),
    }
}

/// The quantities of one view together: one picture for times, one forward run for all numbers.
fn run_view(b: &mut Bench, s: Slab, view: View, quantities: &[(&str, Check)], full: usize) -> Result<()> {
    let mut wrt: Vec<&str> = quantities.iter().filter_map(|(q, _)| parameter(q)).collect();
    wrt.dedup();
    let combination = |q: &str| -> Vec<f64> {
        let k = parameter(q).and_then(|p| wrt.iter().position(|w| *w == p)).map_or(0, |k| k + 1);
        (0..=wrt.len()).map(|l| f64::from(u8::from(l == k))).collect()
    };
    let combinations: Vec<Vec<f64>> = quantities.iter().map(|(q, _)| combination(q)).collect();
    let subject = s.subject(view, &wrt)?;
    let m = b.measure(&subject, &combinations, full)?;
    let bound = b.case.time_bound;
    let value = b.time(&s.subject(view, &[])?, &Slab::BENIGN.subject(view, &[])?, bound)?;
    let derivative = if wrt.is_empty() { None } else { b.time(&subject, &Slab::BENIGN.subject(view, &wrt)?, bound)? };
    for (k, (q, check)) in quantities.iter().enumerate() {
        let time = if parameter(q).is_some() { derivative } else { value };
        b.judge(q, &m, k, Check { time: check.time.or(time), ..*check });
    }
    Ok(())
}

/// A case of the table: the quantities it expects, view by view.
pub fn table_case(b: &mut Bench) -> Result<()> {
    let case = b.case;
    let Some(s) = Slab::parse(&case.reference) else { return Ok(()) };
    let mut left: Vec<&str> = case.expect.iter().map(String::as_str).collect();
    while let Some(view) = left.first().and_then(|q| View::parse(q)) {
        let (now, later): (Vec<&str>, Vec<&str>) = left.iter().partition(|q| View::parse(q) == Some(view));
        left = later;
        let mut checks = Vec::new();
        for q in now {
            if q.ends_with(":d_n") {
                by_index(b, s, q)?;
                continue;
            }
            let Some(known) = slab(&case.reference, q) else { continue };
            if case.name.starts_with("stiff") && q.contains(':') {
                b.not_yet(q, "the list asks for R only: its derivatives rest on paths of 1e10 collisions, which the path cap excludes");
                continue;
            }
            let relvar = relvar_bound(&case.name, q);
            checks.push((q, Check { known, tolerance: tolerance(&case.name, q, known), relvar, time: None }));
        }
        run_view(b, s, view, &checks, paths(&case.name))?;
    }
    Ok(())
}

/// The derivative of a view by the index.
fn by_index(b: &mut Bench, s: Slab, q: &str) -> Result<()> {
    let Some(view) = View::parse(q) else { return Ok(()) };
    let Some(known) = slab(&b.case.reference, q) else { return Ok(()) };
    let full = paths(&b.case.name);
    // What receivers see has outlines.
    let planes = matches!(view, View::R(_) | View::T(_));
    let m = b.measure(&Slab { planes, ..s }.subject(view, &["n"])?, &[vec![0.0, 1.0]], full)?;
    b.judge(q, &m, 0, Check::new(known, tolerance(&b.case.name, q, known)));
    Ok(())
}

/// No extinction at all: exact values, finite derivatives.
pub fn vacuum(b: &mut Bench) -> Result<()> {
    let s = Slab::new(0.0, 0.9, 0.0);
    for (view, name, value, slope) in [(View::R(1.0), "R_1", 0.0, 0.45), (View::T(1.0), "T_1", 1.0, -0.55)] {
        let derivative = format!("{name}:d_tau");
        let d = Check { relvar: Some(10.0), ..Check::new(Known::exact(slope), 1e-4) };
        run_view(b, s, view, &[(name, Check::new(Known::exact(value), 0.0)), (&derivative, d)], PATHS)?;
    }
    Ok(())
}

/// Nothing is scattered, all is absorbed.
pub fn black(b: &mut Bench) -> Result<()> {
    let s = Slab::new(1e5, 0.0, 0.0);
    let zero = Check { relvar: Some(0.0), ..Check::new(Known::exact(0.0), 0.0) };
    // The environment through a thickness of t: first order in the albedo, (1 - ln 2) / 2.
    let slope = Check::new(Known::exact(0.5 * (1.0 - std::f64::consts::LN_2)), 1e-4);
    let r = [("R_1", zero), ("R_1:d_tau", zero), ("R_1:d_albedo", slope), ("R_1:d_g", zero)];
    run_view(b, s, View::R(1.0), &r, PATHS)?;
    run_view(b, s, View::T(1.0), &[("T_1", zero), ("T_1:d_tau", zero), ("T_1:d_g", zero)], PATHS)
}

/// Unit radiance everywhere and nothing absorbed: 1, with no variance at all.
pub fn white_furnace(b: &mut Bench) -> Result<()> {
    for (tau, full) in [(1.0, 1 << 18), (10.0, 1 << 16), (100.0, 1 << 13)] {
        for g in [-0.9, 0.0, 0.9] {
            let s = Slab::new(tau, 1.0, g);
            let one = Check { tolerance: 1e-6, relvar: Some(1e-10), time: None, known: Known::exact(1.0) };
            let flat = Check { tolerance: 1e-4, relvar: None, time: None, known: Known::exact(0.0) };
            let subject = s.subject(View::Furnace, &["sigma_t", "g"])?;
            let unit = |k: usize| (0..3).map(|l| f64::from(u8::from(l == k))).collect();
            let m = b.measure(&subject, &[unit(0), unit(1), unit(2)], full)?;
            // Mean collisions a path, where the table knows them, set the time bound.
            let case = format!("slab_t{tau}_a1_g{g}_n1");
            let collisions =
                slab(&case, "R_1:d_albedo").zip(slab(&case, "T_1:d_albedo")).map(|(r, t)| r.value + t.value);
            let bound = collisions.map(|c| 1.5 * (1.0 + c) / 2.64);
            let benign = Slab::BENIGN.subject(View::Furnace, &[])?;
            let time = b.time(&s.subject(View::Furnace, &[])?, &benign, bound)?;
            b.judge(&format!("t{tau} g{g}"), &m, 0, Check { time, ..one });
            b.judge(&format!("t{tau} g{g}:d_tau"), &m, 1, flat);
            b.judge(&format!("t{tau} g{g}:d_g"), &m, 2, flat);
        }
    }
    Ok(())
}

/// The same in glass: one of two rays is followed at an interface, and weighs as much.
pub fn white_furnace_glass(b: &mut Bench) -> Result<()> {
    for n in [1.0001, 1.33, 1.5, 2.4] {
        let s = Slab { n, ..Slab::new(1.0, 1.0, 0.0) };
        let m = b.measure(&s.subject(View::Furnace, &[])?, &[vec![1.0]], 1 << 17)?;
        let one = Check { tolerance: 1e-5, relvar: Some(1e-2), time: None, known: Known::exact(1.0) };
        b.judge(&format!("n{n}"), &m, 0, one);
        let planes = Slab { planes: true, ..s };
        let m = b.measure(&planes.subject(View::Furnace, &["n"])?, &[vec![0.0, 1.0]], 1 << 17)?;
        b.judge(&format!("n{n}:d_n"), &m, 0, Check::new(Known::exact(0.0), 1e-4));
    }
    Ok(())
}

/// A slab in other units or elsewhere: same numbers, same variance and time to 20 %. `base`: as the table has it.
fn moved(b: &mut Bench, label: &str, case: &str, base: Slab, s: Slab, tolerance: f64) -> Result<()> {
    let numbers = ["R_1", "R_1:d_tau", "T_1"];
    let unscaled =
        b.measure(&base.subject(View::R(1.0), &["sigma_t"])?, &[vec![1.0, 0.0], vec![0.0, 1.0]], PATHS / 2)?;
    for view in [View::R(1.0), View::T(1.0)] {
        let r = matches!(view, View::R(_));
        let subject = s.subject(view, &["sigma_t"])?;
        // d/dsigma_t = thickness x d/dtau: reported per tau.
        let m = b.measure(&subject, &[vec![1.0, 0.0], vec![0.0, 1.0 / s.unit]], PATHS / 2)?;
        let time = b.time(&s.subject(view, &[])?, &base.subject(view, &[])?, Some(1.2))?;
        for (k, q) in numbers.iter().filter(|q| q.starts_with('R') == r).enumerate() {
            let Some(known) = slab(case, q) else { continue };
            let relvar = r.then(|| 1.2 * unscaled.estimates[k].relvar);
            let time = if k == 0 { time } else { None };
            let tolerance = tolerance * known.value.abs();
            b.judge(&format!("{q} {label}"), &m, k, Check { known, tolerance, relvar, time });
        }
    }
    Ok(())
}

/// What is moved: indices and cases of the table.
const MOVED: [(f64, &str); 2] = [(1.0, "slab_t1_a0.9_g0_n1"), (1.5, "slab_t1_a0.9_g0_n1.5")];

pub fn scaled(b: &mut Bench) -> Result<()> {
    for unit in [1e-6, 1e-3, 1e3, 1e6] {
        for (n, case) in MOVED {
            let base = Slab { n, ..Slab::BENIGN };
            moved(b, &format!("n{n} x{unit:e}"), case, base, Slab { unit, ..base }, 1e-4)?;
        }
    }
    Ok(())
}

pub fn translated(b: &mut Bench) -> Result<()> {
    for shift in [1e3, 1e4, 1e5] {
        // At 1e5 one per cent is allowed; f64 positions need no allowance.
        for (n, case) in MOVED {
            let base = Slab { n, ..Slab::BENIGN };
            moved(b, &format!("n{n} +{shift:e}"), case, base, Slab { shift, ..base }, 1e-4)?;
        }
    }
    Ok(())
}

/// The camera exactly on the face, said to be outside or inside, and just inside.
pub fn camera_on_boundary(b: &mut Bench) -> Result<()> {
    let case = "slab_t1_a0.9_g0_n1";
    for (label, distance, inside) in
        [("on, outside", 0.0, false), ("on, inside", 0.0, true), ("1e-7 inside", -1e-7, true)]
    {
        for (view, q) in [(View::R(1.0), "R_1"), (View::T(1.0), "T_1")] {
            let Some(known) = slab(case, q) else { continue };
            let s = Slab { distance, inside, ..Slab::BENIGN };
            let m = b.measure(&s.subject(view, &[])?, &[vec![1.0]], PATHS / 2)?;
            let time = b.time(&s.subject(view, &[])?, &Slab::BENIGN.subject(view, &[])?, Some(1.5))?;
            let relvar = relvar_bound("camera-on-boundary", q);
            b.judge(&format!("{q} {label}"), &m, 0, Check { known, tolerance: 1e-4 * known.value, relvar, time });
        }
    }
    Ok(())
}

/// Radiance far from 1: the same digits, exactly for powers of two.
pub fn radiance_range(b: &mut Bench) -> Result<()> {
    let run = |b: &Bench, radiance: f64| {
        let s = Slab { radiance, ..Slab::BENIGN };
        let wrt = ["sigma_t", "radiance"];
        let unit = |k: usize| (0..3).map(|l| f64::from(u8::from(l == k))).collect();
        b.measure(&s.subject(View::R(1.0), &wrt)?, &[unit(0), unit(1), unit(2)], 1 << 16)
    };
    let one = run(b, 1.0)?;
    for (label, scale, tolerance) in
        [("1e-30", 1e-30, 1e-6), ("1e30", 1e30, 1e-6), ("2^-100", 2f64.powi(-100), 0.0), ("2^100", 2f64.powi(100), 0.0)]
    {
        let m = run(b, scale)?;
        for (k, (q, factor)) in [("R_1", scale), ("R_1:d_tau", scale), ("R_1:d_radiance", 1.0)].iter().enumerate() {
            let truth = one.estimates[k].value * factor;
            b.exact(
                &format!("{q} x{label}"),
                m.estimates[k].value,
                truth,
                tolerance * truth.abs(),
                "against radiance 1, same paths",
            );
        }
    }
    Ok(())
}
