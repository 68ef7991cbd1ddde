//! Cylinders: against closed forms and quadratures that are no part of this project, against prisms of many faces, against finite
//! differences, and identities. |z| <= 4.5 where nothing else is said.

use crate::common::{
    Estimate, against_differences, check, derivatives, estimate, forward_of, job, params, run, scene, scene_with,
};
use std::f64::consts::{PI, TAU};
use std::fmt::Write;
use tyndall::math::rng::Rng;
use tyndall::math::{DVec3, Rgb};
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Terms;
use tyndall::scene::compile::Orders;
use tyndall::scene::geometry::On;
use tyndall::shape::{Geometry, Shape};
use tyndall::term::rims::{rims, stay_together};

const BLACK: &str = r#"<bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0"/></bsdf></bsdf>"#;

fn picture(text: &str, spp: u64) -> Estimate {
    let (_, sc) = scene(text);
    estimate(&run(&sc, spp, 1, Mode::Picture), 0)
}

fn all(text: &str, wrt: &[&str], spp: u64) -> Vec<Estimate> {
    derivatives(text, wrt, &["all"], spp)
}

/// One orthographic pixel of twice this width, placed by `place`.
fn window(half: f64, place: &str, medium: &str) -> String {
    format!(
        r#"<sensor type="orthographic"><transform name="to_world"><scale x="{half}" y="{half}"/>{place}</transform>{medium}
      <film type="hdrfilm"><integer name="width" value="1"/><integer name="height" value="1"/><rfilter type="box"/></film></sensor>"#
    )
}

/// The derivative of a smooth function, to the tenth digit or so.
fn slope(f: impl Fn(f64) -> f64, x: f64) -> f64 {
    let d = |h: f64| (f(x + h) - f(x - h)) / (2.0 * h);
    (4.0 * d(5e-4) - d(1e-3)) / 3.0
}

/// Simpson's rule.
fn integral(f: impl Fn(f64) -> f64, a: f64, b: f64, n: usize) -> f64 {
    let h = (b - a) / (2 * n) as f64;
    let weight = |k: usize| if k == 0 || k == 2 * n { 1.0 } else { (2 + 2 * (k % 2)) as f64 };
    (0..=2 * n).map(|k| weight(k) * f(a + h * k as f64)).sum::<f64>() * h / 3.0
}

/// Every parameter moves the wall and the rims as the scenes beside it say: normal velocities of slots against level sets of the shapes themselves.
#[test]
fn ends_radius_and_transforms_are_one_affine_motion() {
    let text = r#"<scene version="3.0.0"><default name="ax" value="0.2"/><default name="ay" value="-0.4"/><default name="bx" value="0.7"/><default name="bz" value="0.9"/>
  <default name="r" value="0.3"/><default name="turn" value="25"/><default name="size" value="1.3"/><default name="long" value="1.6"/><default name="t" value="0.5"/>
  <integrator type="path"/><sensor type="perspective"/>
  <shape type="cylinder"><point name="p0" value="$ax, $ay, 0.1"/><point name="p1" value="$bx, 0.8, $bz"/><float name="radius" value="$r"/>
    <transform name="to_world"><scale value="$size"/><rotate x="1" y="0.3" z="-0.5" angle="$turn"/><translate y="$t"/></transform></shape>
  <shape type="cylinder"><transform name="to_world"><scale x="$size" y="$size" z="$long"/><rotate y="1" angle="$turn"/></transform></shape></scene>"#;
    let names = ["ax", "ay", "bx", "bz", "r", "turn", "size", "long", "t"];
    let (desc, sc) = scene(text);
    let p = params(&desc, &sc, &names);
    let mut rng = Rng::keyed(41, 0, 0, 0);
    for (k, name) in names.iter().enumerate() {
        let x = desc.params.iter().find(|q| q.name == *name).unwrap().value;
        let h = 1e-5;
        let moved = [1.0, -1.0].map(|s| scene_with(text, &[(name, &format!("{}", x + s * h))]).1);
        let mut largest: f64 = 0.0;
        for i in 0..2 {
            let tube = |s: &tyndall::scene::Scene| match &s.shapes[i].shape {
                Shape::Cylinder(c) => *c,
                _ => unreachable!(),
            };
            let (c, [a, b]) = (tube(&sc), [tube(&moved[0]), tube(&moved[1])]);
            for _ in 0..20 {
                let q = c.sample(rng.uniform(), rng.uniform()).p;
                let velocity = |q: DVec3, n: DVec3| -> f64 {
                    let forms = sc.shapes[i].mover.forms(q, n);
                    forms
                        .iter()
                        .flat_map(|f| (0..3).map(|j| f.v[j] * p.tangents(f.slot + j as u32)[k]).collect::<Vec<_>>())
                        .sum()
                };
                let wall = |c: &tyndall::shape::Cylinder| c.radius - c.from_axis(q).length();
                let fd = (wall(&a) - wall(&b)) / (2.0 * h);
                assert!((velocity(q, c.normal(0, q)) - fd).abs() < 1e-8, "{name}: {fd}");
                for (rim, end) in [(0, 0.0), (1, 1.0)] {
                    let e = q - c.axis * (c.height(q) - end * c.length);
                    let plane = |c: &tyndall::shape::Cylinder| end * c.length - c.height(e);
                    let fd_rim = (plane(&a) - plane(&b)) / (2.0 * h);
                    assert!((velocity(e, c.axis) - fd_rim).abs() < 1e-8, "{name}, rim {rim}: {fd_rim}");
                    largest = largest.max(fd.abs()).max(fd_rim.abs());
                }
            }
        }
        assert!(largest > 1e-3, "{name} moves nothing");
    }
}

/// A black tube before a sky of 1, seen under the angle a to its axis: a rectangle 2 r by l sin a and the ellipse of a rim, less where one sees through it, the lens
/// of both rims' ellipses.
#[test]
fn the_silhouette_of_a_tube() {
    let black = |r: f64, l: f64, a: f64| {
        let s = l * a.tan();
        let lens = if s < 2.0 * r {
            2.0 * r * r * (s / (2.0 * r)).acos() - 0.5 * s * (4.0 * r * r - s * s).sqrt()
        } else {
            0.0
        };
        2.0 * r * l * a.sin() + (PI * r * r - lens) * a.cos()
    };
    for (r, l, degrees, spp) in [(0.25, 1.2, 60.0, 1 << 15), (0.6, 0.5, 25.0f64, 1 << 20)] {
        let text = format!(
            r#"<scene version="3.0.0"><default name="r" value="{r}"/><default name="l" value="{l}"/><default name="a" value="{degrees}"/><default name="x" value="0.1"/>
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>{}
    <shape type="cylinder"><point name="p0" value="0, 0, 0"/><point name="p1" value="0, 0, $l"/><float name="radius" value="$r"/>
      <transform name="to_world"><translate z="-{}"/><rotate x="1" angle="$a"/><translate x="$x"/></transform>{BLACK}</shape>
    <emitter type="constant"/></scene>"#,
            window(1.0, r#"<lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>"#, ""),
            0.5 * l
        );
        let a = degrees.to_radians();
        check("L", &picture(&text, 1 << 14), 1.0 - 0.25 * black(r, l, a), 0.01);
        let d = all(&text, &["r", "l", "a", "x"], spp);
        check("dL/dr", &d[0], -0.25 * slope(|r| black(r, l, a), r), 0.01);
        check("dL/dl", &d[1], -0.25 * slope(|l| black(r, l, a), l), 0.02);
        check("dL/da", &d[2], -0.25 * slope(|a| black(r, l, a), a) * PI / 180.0, 0.03);
        check("dL/dx", &d[3], 0.0, 0.0);
    }
}

/// A black cylinder over a floor under a point light: where the camera looks its shadow is a strip between two planes through the light. As [T] RC.
#[test]
fn the_shadow_of_a_point_light_on_a_floor() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.37"/><default name="y" value="1.3"/><default name="r" value="0.15"/><default name="lx" value="0.2"/>
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>
    <sensor type="orthographic"><transform name="to_world"><scale x="1.25" y="1.25"/><lookat origin="0.25, 1, 0.05" target="0.25, 0, 0.05" up="0, 0, 1"/></transform>
      <film type="hdrfilm"><integer name="width" value="25"/><integer name="height" value="17"/><rfilter type="box"/></film></sensor>
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="10"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>
    <emitter type="point"><point name="position" value="$lx, 2, 0"/><rgb name="intensity" value="10"/></emitter>
    <shape type="cylinder"><point name="p0" value="$x, $y, -0.6"/><point name="p1" value="$x, $y, 0.6"/><float name="radius" value="$r"/>{BLACK}</shape></scene>"#
    );
    let power = |[x, y, r, lx]: [f64; 4]| {
        let row = |s: f64| {
            integral(|z| 20.0 / ((s - lx).powi(2) + 4.0 + z * z).powf(1.5), -0.8, 0.9, 40) * 0.7 / PI / (2.5 * 1.7)
        };
        // Angles from the vertical at the light.
        let (across, down) = (x - lx, 2.0 - y);
        let (middle, half) = (across.atan2(down), (r / across.hypot(down)).asin());
        let end = |side: f64| lx + 2.0 * (middle + side * half).tan();
        integral(row, -1.0, end(-1.0), 200) + integral(row, end(1.0), 1.5, 200)
    };
    let at = [0.37, 1.3, 0.15, 0.2];
    check("L", &picture(&text, 512), power(at), 0.005);
    let names = ["x", "y", "r", "lx"];
    for (k, e) in all(&text, &names, 1024).iter().enumerate() {
        let f = |v: f64| power(std::array::from_fn(|j| if j == k { v } else { at[j] }));
        check(names[k], e, slope(f, at[k]), [0.05, 0.02, 0.01, 0.05][k]);
    }
}

/// As [T] AL2: camera at 0 looking along +z, fog, a point light, single scattering; a long cylinder instead of the ball. On the camera's ray the shadow ends where the
/// line to the light touches the wall.
#[test]
fn the_shadow_of_a_point_light_in_fog() {
    let fog = r#"<ref id="fog"/>"#;
    let names = ["x", "y", "r", "end"];
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.55"/><default name="y" value="0.95"/><default name="r" value="0.25"/><default name="end" value="1.95"/>
    <integrator type="volpath"><integer name="max_depth" value="2"/></integrator>{}
    <medium type="homogeneous" id="fog"><float name="sigma_t" value="0.35"/><float name="albedo" value="0.7142857142857143"/>
      <phase type="hg"><float name="g" value="0.4"/></phase></medium>
    <shape type="rectangle"><transform name="to_world"><scale value="3000"/><rotate y="1" angle="180"/><translate z="6"/></transform>{BLACK}</shape>
    <emitter type="point"><point name="position" value="1.2, 1.8, 2.2"/><rgb name="intensity" value="10"/>{fog}</emitter>
    <shape type="cylinder"><point name="p0" value="-1.6, 1.5, 1"/><point name="p1" value="1.6, -1.5, $end"/><float name="radius" value="$r"/>
      <transform name="to_world"><translate x="$x" y="$y" z="1"/></transform>{BLACK}</shape></scene>"#,
        window(1e-9, "", fog),
    );
    let light = DVec3::new(1.2, 1.8, 2.2);
    let radiance = |[x, y, r, end]: [f64; 4]| {
        let base = DVec3::new(x - 1.6, y + 1.5, 2.0);
        let axis = (DVec3::new(x + 1.6, y - 1.5, 1.0 + end) - base).normalize();
        // Squared distance of the axis to the nearest point of the way to the light, less r².
        let clear = |t: f64| {
            let flat = |v: DVec3| v - axis * axis.dot(v);
            let (o, w) = (flat(DVec3::Z * t - base), flat(light - DVec3::Z * t));
            let s = (-o.dot(w) / w.length_squared()).clamp(0.0, 1.0);
            (o + w * s).length_squared() - r * r
        };
        let source = |t: f64| {
            let to = light - DVec3::Z * t;
            // Light travels against `to`, then against z.
            let (d, cos) = (to.length(), to.z / to.length());
            let q: f64 = 1.16 - 0.8 * cos;
            0.25 * (-0.35 * (t + d)).exp() * 10.0 / (d * d) * 0.84 / (4.0 * PI * q.powf(1.5))
        };
        let mut ends = vec![0.0];
        for k in 0..600 {
            let (mut a, mut b) = (0.01 * k as f64, 0.01 * (k + 1) as f64);
            if clear(a) * clear(b) < 0.0 {
                for _ in 0..60 {
                    let m = 0.5 * (a + b);
                    if clear(a) * clear(m) < 0.0 { b = m } else { a = m }
                }
                ends.push(a);
            }
        }
        ends.push(6.0);
        assert_eq!(ends.len(), 4);
        ends.windows(2)
            .filter(|e| clear(0.5 * (e[0] + e[1])) > 0.0)
            .map(|e| integral(source, e[0], e[1], 400))
            .sum::<f64>()
    };
    let at = [0.55, 0.95, 0.25, 1.95];
    check("L", &picture(&text, 1 << 16), radiance(at), 0.005);
    for (k, e) in all(&text, &names, 1 << 17).iter().enumerate() {
        let f = |v: f64| radiance(std::array::from_fn(|j| if j == k { v } else { at[j] }));
        check(names[k], e, slope(f, at[k]), 0.01);
    }
}

/// A lamp over a point of a floor: the quadrature goes over what of it faces the point.
#[test]
fn a_lamp_over_a_floor() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="ax" value="-0.6"/><default name="ay" value="1.1"/><default name="by" value="1.5"/><default name="r" value="0.3"/><default name="z" value="0.4"/>
    <integrator type="path"><integer name="max_depth" value="2"/></integrator>{}
    <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/></transform><bsdf type="diffuse"><rgb name="reflectance" value="0.7"/></bsdf></shape>
    <shape type="cylinder"><point name="p0" value="$ax, $ay, 0"/><point name="p1" value="0.9, $by, 0.2"/><float name="radius" value="$r"/><transform name="to_world"><translate z="$z"/></transform>
      <emitter type="area"><rgb name="radiance" value="3"/></emitter></shape></scene>"#,
        window(1e-9, r#"<lookat origin="0, 0.4, 0" target="0, 0, 0" up="0, 0, 1"/>"#, "")
    );
    let radiance = |[ax, ay, by, r, z]: [f64; 5]| {
        let (base, top) = (DVec3::new(ax, ay, z), DVec3::new(0.9, by, z + 0.2));
        let k = (top - base).normalize();
        let across = -base + k * k.dot(base);
        let (d, u) = (across.length(), across.normalize());
        let (v, half) = (k.cross(u), (r / d).acos());
        let line = |phi: f64| {
            let n = u * phi.cos() + v * phi.sin();
            let from = |s: f64| base.lerp(top, s) + n * r;
            let f = |s: f64| -from(s).dot(n) * from(s).y / from(s).length_squared().powi(2);
            integral(f, 0.0, 1.0, 60) * (top - base).length()
        };
        integral(line, -half, half, 60) * r * 3.0 * 0.7 / PI
    };
    let at = [-0.6, 1.1, 1.5, 0.3, 0.4];
    check("L", &picture(&text, 1 << 17), radiance(at), 0.005);
    let names = ["ax", "ay", "by", "r", "z"];
    for (k, e) in all(&text, &names, 1 << 18).iter().enumerate() {
        let f = |v: f64| radiance(std::array::from_fn(|j| if j == k { v } else { at[j] }));
        check(names[k], e, slope(f, at[k]), 0.01);
    }
}

/// A floor, an open tube of two sides, a can with lids, a ball and `light`.
fn room(depth: u32, tube: &str, light: &str, medium: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="x" value="0.35"/><default name="r" value="0.3"/><default name="turn" value="35"/><default name="ty" value="0.75"/><default name="can" value="-0.55"/>
  <default name="ax" value="-0.1"/><default name="lx" value="0.3"/><default name="cx" value="0.2"/>
  <integrator type="volpath"><integer name="max_depth" value="{depth}"/></integrator>
  <sensor type="perspective"><float name="fov" value="36"/>
    <transform name="to_world"><lookat origin="$cx, 1.5, 4" target="0, 0.6, 0" up="0, 1, 0"/></transform>{}
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="5"/><rfilter type="tent"/></film></sensor>{medium}
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.5,0.4"/></bsdf></shape>
  {tube}
  <shape type="cylinder"><point name="p0" value="0, 0.1, 0"/><point name="p1" value="0, 0.7, 0"/><float name="radius" value="0.25"/><transform name="to_world"><translate x="$can" z="0.3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.3,0.3"/></bsdf></shape>
  <shape type="disk"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="0.25"/><translate x="$can" y="0.7" z="0.3"/></transform>
    <bsdf type="diffuse"><rgb name="reflectance" value="0.3,0.7,0.3"/></bsdf></shape>
  <shape type="disk"><transform name="to_world"><rotate x="1" angle="90"/><scale value="0.25"/><translate x="$can" y="0.1" z="0.3"/></transform><bsdf type="diffuse"/></shape>
  {light}</scene>"#,
        if medium.is_empty() { "" } else { r#"<ref id="fog"/>"# }
    )
}

const TUBE: &str = r#"<shape type="cylinder"><point name="p0" value="$ax, -0.3, 0"/><point name="p1" value="0.05, 0.35, 0"/><float name="radius" value="$r"/>
    <transform name="to_world"><rotate x="1" z="0.6" angle="$turn"/><translate x="$x" y="$ty" z="0.1"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5,0.6,0.7"/></bsdf></bsdf></shape>"#;
const LAMP: &str = r#"<shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate x="1" angle="90"/><translate x="$lx" y="2.2" z="0.1"/></transform>
    <emitter type="area"><rgb name="radiance" value="9,8,7"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="0.2"/></bsdf></shape>"#;
const POINT: &str = r#"<emitter type="point"><point name="position" value="$lx, 2.2, 0.1"/><rgb name="intensity" value="9,8,7"/></emitter>"#;
const SKY: &str = r#"<emitter type="constant"><rgb name="radiance" value="1,0.8,0.7"/></emitter>"#;
const FOG: &str = r#"<medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.3, 0.5, 0.2"/><float name="albedo" value="0.9"/><phase type="hg"><float name="g" value="0.3"/></phase></medium>"#;

#[test]
fn tubes_and_cans_under_a_lamp() {
    let what = [("x", 0.02), ("r", 0.02), ("turn", 2.0), ("ax", 0.02), ("can", 0.02), ("cx", 0.02)];
    against_differences(&room(3, TUBE, LAMP, ""), &what, &["all"], 1 << 13, 0.03);
}

#[test]
fn tubes_and_cans_under_a_point_light() {
    let what = [("x", 0.02), ("r", 0.02), ("ty", 0.02), ("can", 0.02), ("lx", 0.02)];
    against_differences(&room(3, TUBE, POINT, ""), &what, &["all"], 1 << 13, 0.03);
}

#[test]
fn tubes_and_cans_under_the_sky() {
    against_differences(&room(3, TUBE, SKY, ""), &[("r", 0.02), ("turn", 2.0), ("can", 0.02)], &["all"], 1 << 13, 0.03);
}

#[test]
fn tubes_and_cans_in_fog() {
    let what = [("x", 0.02), ("r", 0.02), ("turn", 2.0), ("can", 0.02)];
    against_differences(&room(3, TUBE, &format!("{POINT}{SKY}"), FOG), &what, &["all"], 1 << 12, 0.04);
}

/// A lamp that is a tube, under which things stand.
#[test]
fn a_tube_as_a_lamp() {
    let lamp = TUBE.replace(
        "<bsdf type=\"twosided\">",
        r#"<emitter type="area"><rgb name="radiance" value="3,2,1"/></emitter><bsdf type="twosided">"#,
    );
    against_differences(&room(3, &lamp, "", ""), &[("x", 0.02), ("r", 0.02), ("ax", 0.02)], &["all"], 1 << 13, 0.03);
}

/// A cylinder and two lids around fog, all null, before a floor and a sun: its border moves as a whole and grows.
#[test]
fn a_can_of_fog() {
    let text = format!(
        r#"<scene version="3.0.0"><default name="x" value="0.1"/><default name="r" value="0.5"/><default name="turn" value="30"/>
  <integrator type="volpath"><integer name="max_depth" value="3"/></integrator>{FOG}
  <sensor type="perspective"><float name="fov" value="36"/><transform name="to_world"><lookat origin="0, 1.2, 4" target="0, 0.6, 0" up="0, 1, 0"/></transform>
    <film type="hdrfilm"><integer name="width" value="6"/><integer name="height" value="5"/><rfilter type="tent"/></film></sensor>
  <shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><scale value="2"/></transform><bsdf type="diffuse"/></shape>{}
  <emitter type="directional"><vector name="direction" value="0.3, -1, -0.4"/><rgb name="irradiance" value="3"/></emitter></scene>"#,
        ["cylinder", "disk", "disk"]
            .iter()
            .zip(["", r#"<translate z="1"/>"#, r#"<rotate x="1" angle="180"/>"#])
            .map(|(plugin, lid)| format!(
                r#"<shape type="{plugin}"><transform name="to_world">{lid}<scale x="$r" y="$r"/><rotate x="1" z="0.4" angle="$turn"/><translate x="$x" y="0.8"/></transform>
    <bsdf type="null"/><ref name="interior" id="fog"/></shape>"#
            ))
            .collect::<String>()
    );
    against_differences(&text, &[("x", 0.02), ("r", 0.02), ("turn", 2.0)], &["all"], 1 << 13, 0.02);
}

fn terms(names: &[&str]) -> Terms {
    Terms::parse(&names.iter().map(|n| n.to_string()).collect::<Vec<_>>()).unwrap()
}

/// A prism of many faces tends to the cylinder, term by term where silhouettes are concerned: measures of lines that touch a smooth wall.
#[test]
fn prisms_tend_to_the_cylinder() {
    let n = 96;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("prism.obj");
    let mut obj = String::new();
    // As wide as the circle on the average.
    let r = (PI / n as f64 / (PI / n as f64).tan()).sqrt().recip();
    for k in 0..n {
        let (s, c) = (TAU * k as f64 / n as f64).sin_cos();
        writeln!(obj, "v {} {} 0\nv {0} {1} 1", r * c, r * s).unwrap();
    }
    for k in 0..n {
        let [a, b, c, d] = [2 * k, 2 * k + 1, (2 * k + 2) % (2 * n), (2 * k + 3) % (2 * n)].map(|i| i + 1);
        writeln!(obj, "f {a} {c} {d}\nf {a} {d} {b}").unwrap();
    }
    std::fs::write(&path, obj).unwrap();
    let shape = |plugin: &str| {
        format!(
            r#"<shape {plugin}<transform name="to_world"><scale x="$r" y="$r" z="0.7"/><rotate x="1" z="0.6" angle="$turn"/><translate x="$x" y="$ty" z="0.1"/></transform>
    <bsdf type="twosided"><bsdf type="diffuse"><rgb name="reflectance" value="0.5,0.6,0.7"/></bsdf></bsdf></shape>"#
        )
    };
    let mesh = shape(&format!(r#"type="obj"><string name="filename" value="{}"/>"#, path.display()));
    let tube = shape(r#"type="cylinder">"#);
    let names = ["x", "r", "turn", "ty"];
    for (light, of) in [(LAMP, "surface_edge"), (POINT, "light_shadow"), (SKY, "surface_edge")] {
        let [a, b] = [&tube, &mesh].map(|s| derivatives(&room(2, s, light, ""), &names, &[of], 1 << 13));
        for (k, name) in names.iter().enumerate() {
            let (d, se) = (a[k].value[0] - b[k].value[0], a[k].error[0].hypot(b[k].error[0]));
            println!("{of} {name}: {:?} {:?} z {:.2}", a[k], b[k], d / se);
            assert!(d.abs() <= 4.5 * se + 0.01 * a[k].value[0].abs(), "{of} {name}: {:?} {:?}", a[k], b[k]);
        }
        let known = (0..4).filter(|&k| a[k].error[0] < 0.05 * a[k].value[0].abs()).count();
        assert!(known >= 2, "{of}: too noisy");
    }
}

/// [T] T9: surfaces emit 1 - ρ and reflect ρ, fog and sky emit 1: the picture is 1 whatever moves. An open tube is white: lamps have one side.
#[test]
fn t9_isothermal_enclosure() {
    let grey = |rho: f64| {
        format!(
            r#"<emitter type="area"><rgb name="radiance" value="{}"/></emitter><bsdf type="diffuse"><rgb name="reflectance" value="{rho}"/></bsdf>"#,
            1.0 - rho
        )
    };
    let fog = r#"<medium type="homogeneous" id="fog"><float name="sigma_t" value="0.5"/><float name="albedo" value="0.5"/><rgb name="emission" value="1"/></medium>
  <shape type="cube"><transform name="to_world"><scale x="1.7" y="1.5" z="1.7"/><translate y="1"/></transform><bsdf type="null"/><ref name="interior" id="fog"/></shape>"#;
    for medium in ["", fog] {
        let text = room(40, &TUBE.replace("0.5,0.6,0.7", "1"), r#"<emitter type="constant"/>"#, medium);
        let text = text.replace(r#"<ref id="fog"/>"#, "");
        let (a, b) = (grey(0.5), grey(0.7));
        let text = text
            .replace(r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.6,0.5,0.4"/></bsdf>"#, &a)
            .replace(r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.7,0.3,0.3"/></bsdf>"#, &b)
            .replace(r#"<bsdf type="diffuse"><rgb name="reflectance" value="0.3,0.7,0.3"/></bsdf>"#, &b)
            .replace(r#"<bsdf type="diffuse"/>"#, &b);
        check("L", &picture(&text, 256), 1.0, 0.01);
        let names = ["x", "r", "turn", "ax", "can", "cx"];
        let spp = if medium.is_empty() { 1 << 12 } else { 1 << 11 };
        let e = all(&text, &names, spp);
        let alone = derivatives(&text, &names, &["surface_edge", "medium_edge"], spp);
        let mut told = 0;
        for (k, name) in names.iter().enumerate() {
            println!("{name}: {:?} edges {:?}", e[k], alone[k]);
            assert!(e[k].z(0, 0.0).abs() <= 4.5, "{name}: {:?}", e[k]);
            told += usize::from(alone[k].value[0].abs() > 5.0 * alone[k].error[0]);
        }
        assert!(told >= 3, "edges alone are no identity: {told}");
    }
}

const MOVES: [&str; 4] = ["x", "r", "can", "cx"];

/// Fog, a lamp and a point light: what needs every room but that of hard spots.
fn busy() -> String {
    room(3, TUBE, &format!("{LAMP}{}", POINT.replace("$lx", "-0.9")), FOG)
}

#[test]
fn forward_dot_v_equals_reverse() {
    let (desc, sc) = scene(&busy());
    let p = params(&desc, &sc, &MOVES);
    for chosen in ["all", "interior", "pixel_edge", "surface_edge", "medium_edge", "light_shadow"] {
        let job = |mode| Job { terms: terms(&[chosen]), ..job(&sc, 32, 3, mode) };
        let f = job(Mode::Forward(&p)).run(&|_| {}).unwrap();
        let pixels = f.film.spec().pixels();
        let mut rng = Rng::keyed(9, 0, 0, 0);
        let v: Vec<Rgb> = (0..pixels).map(|_| Rgb::from_fn(|_| rng.uniform() - 0.3)).collect();
        let r = job(Mode::Reverse(&p, &v)).run(&|_| {}).unwrap();
        let gradient = p.pull_back(&r.gradient.unwrap().0);
        for (k, name) in MOVES.iter().enumerate() {
            let dot: f64 = (0..pixels).map(|i| f.film.mean(k + 1, i).dot(v[i])).sum();
            let scale: f64 = (0..pixels).map(|i| (f.film.mean(k + 1, i) * v[i]).abs().sum()).sum();
            assert!((dot - gradient[k]).abs() <= 1e-10 * scale, "{chosen} {name}: {dot} {} of {scale}", gradient[k]);
            assert!(scale > 0.0, "{chosen} {name}: nothing to compare");
        }
    }
}

/// Negative controls: every room adds to a tube's derivatives what is far from nothing, so that without it they are wrong; above all of them together agree with
/// finite differences. 10 s.e.
#[test]
fn no_room_can_be_left_out() {
    for room in ["pixel_edge", "surface_edge", "medium_edge", "light_shadow"] {
        let e = forward_of(&busy(), Orders::default(), &["x", "r"], &[room], 1 << 12);
        let z = |e: &Estimate| (0..3).map(|c| (e.value[c] / e.error[c]).abs()).fold(0.0, f64::max);
        let most = e[1..].iter().map(z).fold(0.0, f64::max);
        assert!(most > 10.0, "{room}: {most} standard errors");
    }
}

/// More than eight analytic shapes are Embree's: the same hits as from a list, and the same derivatives.
#[test]
fn many_cylinders_go_into_embree_and_stay_the_same() {
    let far = |i: usize| {
        format!(
            r#"<shape type="cylinder"><point name="p0" value="{i}, -90, 0"/><point name="p1" value="{i}, -89, 0.4"/><float name="radius" value="0.3"/><bsdf type="diffuse"/></shape>"#
        )
    };
    // Beside the lamp and below it: on its very face rounding decides which way the light shines.
    let light = POINT.replace("$lx, 2.2", "-0.9, 1.9");
    let few = room(3, TUBE, &format!("{light}{LAMP}"), "");
    let many = room(3, TUBE, &format!("{light}{LAMP}{}", (0..8).map(far).collect::<String>()), "");
    let (_, sc) = scene(&many);
    let mut rng = Rng::keyed(42, 0, 0, 0);
    let mut hits = 0;
    for k in 0..20_000 {
        let [o, to] = [0, 1].map(|_| DVec3::from_array(std::array::from_fn(|_| 2.0 * rng.uniform() - 1.0)));
        let o = (o + DVec3::Y * if k % 2 == 0 { 0.7 } else { -89.5 }) * DVec3::new(4.0, 1.0, 1.0);
        let w = to.normalize();
        let nearest = sc
            .shapes
            .iter()
            .enumerate()
            .filter_map(|(i, s)| Some((s.shape.cross(o, w, 0.0, f64::INFINITY, None)?.0, i as u32)));
        let best = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
        let hit = sc.intersect(o, w, f64::INFINITY, &On::default(), None);
        assert_eq!(hit.map(|h| h.shape), best.map(|b| b.1), "{o} {w}");
        if let (Some(h), Some((t, _))) = (hit, best) {
            assert!((h.t - t).abs() < 1e-12 * (1.0 + t));
            hits += 1;
            // On from the wall itself.
            let again = sc.intersect(h.p, w, f64::INFINITY, &On::at(&h), None);
            let rest = sc.shapes.iter().enumerate().filter_map(|(i, s)| {
                let start = (i as u32 == h.shape).then_some(tyndall::shape::Start { face: h.face });
                Some((s.shape.cross(h.p, w, 1e-9, f64::INFINITY, start)?.0, i as u32))
            });
            assert_eq!(again.map(|h| h.shape), rest.min_by(|a, b| a.0.total_cmp(&b.0)).map(|b| b.1), "{o} {w}");
        }
    }
    assert!(hits > 2500, "{hits}");
    let [a, b] = [few, many].map(|t| all(&t, &MOVES, 2048));
    for (a, b) in a.iter().zip(&b) {
        let z = (a.value[0] - b.value[0]) / a.error[0].hypot(b.error[0]);
        assert!(z.abs() < 4.5, "{a:?} {b:?}");
    }
}

/// Where a ray down at x by way of a rod of glass along y meets the plane z = d, and what of it goes through.
fn through_rod(x: f64, [n, r, c, d]: [f64; 4]) -> (f64, f64) {
    let sin = (x - c) / r;
    let (outside, inside) = (sin.asin(), (sin / n).asin());
    let turn = outside - inside;
    let chord = 2.0 * r * inside.cos();
    let p = [x - chord * turn.sin(), (r * r - (x - c).powi(2)).sqrt() - chord * turn.cos()];
    let (a, b) = (outside.cos(), inside.cos());
    let (s, t) = ((a - n * b) / (a + n * b), (b - n * a) / (b + n * a));
    let passed = 1.0 - 0.5 * (s * s + t * t);
    (p[0] - (p[1] - d) * (2.0 * turn).tan(), passed * passed)
}

/// The edge of a lamp through a rod: by the index, the radius, and the places of rod and edge. What is mirrored twice within, less than 3e-4 of it (by the index 0.4 %), is left out of the formula.
#[test]
fn the_edge_of_a_lamp_through_a_rod() {
    let (half, r) = (0.3, 0.5);
    let text = format!(
        r#"<scene version="3.0.0"><default name="n" value="1.3"/><default name="r" value="{r}"/><default name="c" value="0.02"/><default name="d" value="-3"/><default name="edge" value="0.1"/>
  <integrator type="path"><integer name="max_depth" value="-1"/></integrator>{}
  <shape type="cylinder"><point name="p0" value="$c, -9, 0"/><point name="p1" value="$c, 9, 0"/><float name="radius" value="$r"/>
    <bsdf type="dielectric"><float name="int_ior" value="$n"/><float name="ext_ior" value="1"/></bsdf></shape>
  <shape type="rectangle"><transform name="to_world"><translate x="-1"/><scale x="2"/><translate x="$edge"/><translate z="$d"/></transform>
    <bsdf type="diffuse"><float name="reflectance" value="0"/></bsdf><emitter type="area"><float name="radiance" value="1"/></emitter></shape></scene>"#,
        window(half, r#"<lookat origin="0, 0, 5" target="0, 0, 0" up="0, 1, 0"/>"#, "")
    );
    // Rays cross: what is left of the edge is seen right of this.
    let seen = |[n, r, c, d, edge]: [f64; 5]| {
        let at = |x: f64| through_rod(x, [n, r, c, d]);
        let (mut lo, mut hi) = (-half, half);
        for _ in 0..80 {
            let mid = 0.5 * (lo + hi);
            if at(mid).0 > edge { lo = mid } else { hi = mid }
        }
        integral(|x| at(x).1, lo, half, 200) / (2.0 * half)
    };
    let names = ["n", "r", "c", "d", "edge"];
    let at = [1.3, r, 0.02, -3.0, 0.1];
    assert!(seen(at) > 0.3 && seen(at) < 0.6, "{}", seen(at));
    check("the lamp", &picture(&text, 1 << 12), seen(at), 0.02);
    let found = all(&text, &names, 1 << 19);
    let truth = |k: usize| slope(|x| seen(std::array::from_fn(|i| if i == k { x } else { at[i] })), at[k]);
    for (k, name) in names.iter().enumerate() {
        check(name, &found[k], truth(k), 0.03);
    }
    let without = derivatives(&text, &names, &["interior", "pixel_edge", "surface_edge"], 1 << 12);
    assert!(without[0].z(0, truth(0)).abs() > 5.0, "{:?}", without[0]);
}

/// A rim that a wall and a lid share is one where they stay together, in scenes of any size.
#[test]
fn rims_are_one_that_stay_together() {
    let wall = r#"<shape type="cylinder"><point name="p0" value="0, 0, 0.1"/><point name="p1" value="0, 0, 2.1"/><float name="radius" value="$r"/></shape>"#;
    let lid =
        r#"<shape type="disk"><transform name="to_world"><scale value="$q"/><translate z="2.1"/></transform></shape>"#;
    let count = |shapes: &str, wrt: &[&str], size: f64| {
        let text = format!(
            r#"<scene version="3.0.0"><default name="r" value="1"/><default name="q" value="1"/><integrator type="path"/><sensor type="perspective"/>{shapes}
  <shape type="rectangle"><transform name="to_world"><scale value="{size}"/></transform></shape></scene>"#
        );
        let text = if shapes.contains("$q") { text } else { text.replace(r#"<default name="q" value="1"/>"#, "") };
        let (desc, sc) = scene(&text);
        let p = params(&desc, &sc, wrt);
        rims(&sc, |rim, shape| stay_together(&sc, &p, rim, shape)).len()
    };
    for size in [3.0, 1e6] {
        for shapes in [format!("{wall}{lid}"), format!("{lid}{wall}")] {
            assert_eq!(count(&shapes, &["r"], size), 3, "{size}");
            assert_eq!(count(&shapes, &["q"], size), 3, "{size}");
            assert_eq!(count(&shapes.replace("$q", "$r"), &["r"], size), 2, "{size}");
        }
    }
}
