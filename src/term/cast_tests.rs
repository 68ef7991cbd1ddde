use super::super::cast_border::{Line, borders};
use super::super::rims::rims;
use super::*;
use crate::math::rng::Rng;
use crate::scene::SceneDesc;
use crate::scene::chains::{Face, Link};
use crate::scene::compile::LoadOptions;

const LAMP: &str = r#"<emitter type="point"><point name="position" value="0.45, -0.4, 2.4"/></emitter>"#;
const SUN: &str = r#"<emitter type="directional"><vector name="direction" value="0.3, 0.25, -1"/></emitter>"#;

const BEAM: &str = r#"<emitter type="collimated"><transform name="to_world"><lookat origin="-0.5, -0.4, 2.4" target="0.1, 0, 0" up="0, 1, 0"/></transform><float name="radius" value="0.5"/><string name="profile" value="hard"/></emitter>"#;

/// A prism in haze.
fn prism(light: &str) -> Scene {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("prism.obj");
    let corners = "v -0.7 -0.6 -0.5\nv 0.7 -0.6 -0.5\nv 0 -0.6 0.7\nv -0.7 0.6 -0.5\nv 0.7 0.6 -0.5\nv 0 0.6 0.7\n";
    let faces = "f 1 2 3\nf 4 6 5\nf 1 4 5\nf 1 5 2\nf 2 5 6\nf 2 6 3\nf 3 6 4\nf 3 4 1\n";
    std::fs::write(&path, format!("{corners}{faces}")).unwrap();
    compiled(&format!(
        r#"<shape type="obj"><string name="filename" value="{}"/><boolean name="face_normals" value="true"/><transform name="to_world"><rotate z="1" angle="20"/></transform><bsdf type="dielectric"/></shape>{light}"#,
        path.display()
    ))
}

/// Blocks and a mirror in haze.
fn blocks(light: &str) -> Scene {
    compiled(&format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="0.9" y="0.7" z="0.6"/><rotate z="1" angle="20"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="cube"><transform name="to_world"><scale x="0.35" y="0.5" z="0.12"/><rotate x="1" angle="15"/><translate x="0.3" y="-0.3" z="1.2"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.3"/></bsdf></shape>
      <shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="70"/><translate x="-1.4" z="1"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>{light}"#
    ))
}

/// A block within another one, with an opaque bar beside it, in haze.
fn nested(light: &str) -> Scene {
    compiled(&format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="0.9" y="0.7" z="0.6"/><rotate z="1" angle="20"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="cube"><transform name="to_world"><scale x="0.4" y="0.3" z="0.25"/><rotate x="1" angle="15"/><translate x="0.1" y="-0.05"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.2"/><float name="ext_ior" value="1.5"/></bsdf></shape>
      <shape type="cube"><transform name="to_world"><scale x="0.05" y="0.2" z="0.05"/><rotate z="1" angle="10"/><translate x="-0.6" y="-0.3"/></transform><bsdf type="diffuse"/></shape>{light}"#
    ))
}

/// Opaque balls above a block and in it, and a mirror, in haze.
fn balls(light: &str) -> Scene {
    compiled(&format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="0.9" y="0.7" z="0.6"/><rotate z="1" angle="20"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="rectangle"><transform name="to_world"><scale value="0.4"/><rotate y="1" angle="70"/><translate x="-1.4" z="1"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
      <shape type="sphere"><point name="center" value="0.3, -0.2, 1.1"/><float name="radius" value="0.25"/></shape>
      <shape type="sphere"><point name="center" value="-0.2, 0.15, -0.1"/><float name="radius" value="0.3"/></shape>{light}"#
    ))
}

/// A tube above a block, and a plate in it, in haze.
fn rims_and_walls(light: &str) -> Scene {
    compiled(&format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="0.9" y="0.7" z="0.6"/><rotate z="1" angle="20"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="cylinder"><point name="p0" value="0.1, -0.3, 0.9"/><point name="p1" value="0.4, 0.2, 1.1"/><float name="radius" value="0.2"/></shape>
      <shape type="disk"><transform name="to_world"><scale x="0.3" y="0.4"/><rotate x="1" angle="20"/><translate x="-0.2" y="0.15"/></transform></shape>{light}"#
    ))
}

/// Two round mirrors, one of them an ellipse, beside a block and a plate, in haze.
fn round_mirrors(light: &str) -> Scene {
    compiled(&format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="0.5" y="0.6" z="0.4"/><rotate z="1" angle="20"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="disk"><transform name="to_world"><scale x="0.6" y="0.45"/><rotate y="1" angle="70"/><translate x="-1.3" z="0.5"/></transform><bsdf type="twosided"><bsdf type="conductor"/></bsdf></shape>
      <shape type="disk"><transform name="to_world"><scale value="0.7"/><rotate y="1" angle="-60"/><translate x="1.2" y="0.2" z="-0.6"/></transform><bsdf type="conductor"/></shape>
      <shape type="disk"><transform name="to_world"><scale value="0.25"/><translate x="-0.6" y="0.3" z="0.9"/></transform></shape>{light}"#
    ))
}

/// A ball of metal with a bar and a ball beside it, and a bar above it that is much longer than it, in haze.
fn mirror_ball(light: &str) -> Scene {
    compiled(&format!(
        r#"<shape type="sphere"><point name="center" value="-0.1, 0.1, -0.2"/><float name="radius" value="0.6"/><bsdf type="conductor"/></shape>
      <shape type="cube"><transform name="to_world"><scale x="0.05" y="0.3" z="0.1"/><rotate z="1" angle="10"/><translate x="0.8" y="-0.2"/></transform><bsdf type="diffuse"/></shape>
      <shape type="cube"><transform name="to_world"><scale x="0.04" y="30" z="0.04"/><rotate z="1" angle="30"/><translate x="-4.1" y="7.2" z="0.9"/></transform><bsdf type="diffuse"/></shape>
      <shape type="sphere"><point name="center" value="0.3, -0.2, 1.1"/><float name="radius" value="0.2"/></shape>{light}"#
    ))
}

fn compiled(body: &str) -> Scene {
    let text = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="5"/></integrator><sensor type="perspective"/>
      <medium type="homogeneous" id="haze"><float name="sigma_t" value="0"/></medium>{body}</scene>"#
    );
    let desc = SceneDesc::parse(&text, std::path::Path::new("blocks.xml"), &[]).unwrap();
    Scene::compile(&desc, &LoadOptions::default()).unwrap()
}

/// Wherever the light of a way jumps along a line, the line crosses a sheet of it; and what sheets say it jumps by is what it does.
#[test]
fn light_jumps_at_sheets_alone() {
    for (light, scene) in [LAMP, SUN]
        .into_iter()
        .flat_map(|l| {
            [blocks, prism, nested, balls, rims_and_walls, mirror_ball, round_mirrors].map(|scene| (l, scene(l)))
        })
        .chain([blocks, nested, balls, rims_and_walls, round_mirrors].map(|scene| (BEAM, scene(BEAM))))
    {
        let bodies = &scene.bodies;
        let (all, begins) = cast_route::of_light(&scene, 0);
        // Facets in one plane count as one face: what one leaves another takes over.
        let faces = &scene.chains.faces;
        let first = |k: u32| {
            let f = &faces[k as usize];
            let one = |g: &Face| g.shape == f.shape && g.n.dot(f.n) > 1.0 - 1e-9 && (g.p - f.p).dot(f.n).abs() < 1e-9;
            (0..).zip(faces.iter()).find(|(_, g)| one(g)).map_or(k, |x| x.0)
        };
        let planes = |route: &Route| match route {
            Route::Faces(links) => Route::Faces(links.iter().map(|l| Link { face: first(l.face), ..*l }).collect()),
            Route::Mirror => Route::Mirror,
        };
        let mut ways: Vec<(Route, Vec<&(Route, f64)>)> = Vec::new();
        for way in &all {
            let key = planes(&way.0);
            match ways.iter_mut().find(|w| w.0 == key) {
                Some(known) => known.1.push(way),
                None => ways.push((key, vec![way])),
            }
        }
        let brings = |own: &[&(Route, f64)], y: DVec3, within: u64| {
            let each = own.iter().map(|(route, asked)| {
                let border =
                    Border { line: Line::Edge([DVec3::ZERO; 2]), faces: SmallVec::new(), into: SmallVec::new() };
                let (route, asked, pieces) = (route.clone(), *asked, Vec::new());
                Sheet { light: 0, route, asked, at: 0, between: false, border, within, pieces }.arrives(
                    &scene,
                    y,
                    (y, On::default(), Some(0)),
                    &mut 0,
                )[1]
            });
            each.sum::<f64>()
        };
        let sheets = of_light(&scene, &borders(&scene, &rims(&scene, |_, _| true)), 0);
        let mut rng = Rng::keyed(7, 0, 0, 0);
        let mut jumps = 0;
        // A beam lights little of the scene, a ball of metal mirrors little.
        for _ in 0..if faces.is_empty() {
            64
        } else if light == BEAM {
            32
        } else {
            16
        } {
            let mut point = || DVec3::from_array([0; 3].map(|_| 2.4 * rng.uniform() - 1.2));
            let (o, to) = (point(), point());
            let w = (to - o).normalize();
            let end = scene.intersect(o, w, (to - o).length(), &On::default(), None).map_or((to - o).length(), |h| h.t);
            let within = bodies.holding(o + w * (0.5 * end));
            let n = 1000;
            let at = |k: usize| end * (k as f64 + 0.5) / n as f64;
            // What is left of light where it ends.
            let beside = |own: &[&(Route, f64)], [mut t0, mut t1]: [f64; 2], first: bool| {
                let at = |t: f64| brings(own, o + w * t, within);
                for _ in 0..24 {
                    let t = 0.5 * (t0 + t1);
                    if (at(t) > 0.0) == first { t0 = t } else { t1 = t }
                }
                at(if first { t0 } else { t1 })
            };
            for (route, own) in &ways {
                let lit: Vec<f64> = (0..n).map(|k| brings(own, o + w * at(k), within)).collect();
                let most = lit.iter().copied().fold(0.0, f64::max);
                if most == 0.0 {
                    continue;
                }
                // Light of a way that leads elsewhere than here would be left out.
                assert_eq!(route.sets(&scene, begins).last(), Some(&within), "{route:?}");
                let crossings: Vec<f64> = sheets
                    .iter()
                    .filter(|s| planes(&s.route) == *route)
                    .flat_map(|s| s.crossings(&scene, o, w, [0.0, end]))
                    .map(|c| c.1)
                    .collect();
                for k in 1..n {
                    let (a, b) = (lit[k - 1], lit[k]);
                    // Near total reflection light changes as fast, but not to nothing; mirrored by a ball, it does so but ends without a jump.
                    let ends = (a == 0.0) != (b == 0.0) && a.max(b) > 0.05 * most;
                    if ends && beside(own, [at(k - 1), at(k)], a > 0.0) > 0.05 * most {
                        jumps += 1;
                        let near = crossings.iter().any(|t| *t > at(k - 1) - 1e-6 && *t < at(k) + 1e-6);
                        assert!(near, "{light} {route:?} {o} {w} {}: {a} {b}, {crossings:?}", at(k));
                    }
                }
            }
        }
        println!("{jumps} jumps");
        assert!(jumps > 20, "{jumps}");
    }
}

/// Where a closed border begins does not matter: lines beside a rim and lines across it, that meet its sheet twice between two of the places where rays are told, too.
#[test]
fn crossings_do_not_depend_on_where_a_rim_begins() {
    let turned = |degrees: f64, light: &str| {
        compiled(&format!(
            r#"<shape type="cube"><transform name="to_world"><scale x="0.9" y="0.7" z="0.6"/></transform><bsdf type="dielectric"><float name="int_ior" value="1.5"/></bsdf></shape>
      <shape type="disk"><transform name="to_world"><rotate z="1" angle="{degrees}"/><scale x="0.3" y="0.3"/></transform></shape>{light}"#
        ))
    };
    // Light straight from above: places on either side of a line see it alike.
    let above = r#"<emitter type="directional"><vector name="direction" value="0, 0, -1"/></emitter>"#;
    let place = 360.0 / AROUND as f64;
    for light in [LAMP, SUN, above] {
        let lines: Vec<(DVec3, DVec3)> = (0..24)
            .flat_map(|k| [0.0, 0.5, 0.3].map(|part| ((k as f64 + part) * place).to_radians()))
            .flat_map(|angle| [0.9999, 0.99, 0.5].map(|share| (angle, share)))
            .map(|(angle, share)| {
                let (sin, cos) = angle.sin_cos();
                let w = DVec3::new(-sin, cos, 0.0);
                (DVec3::new(cos, sin, 0.0) * (0.3 * share) - DVec3::Z * 1e-5 - w * 0.4, w)
            })
            .collect();
        let met = |scene: &Scene| {
            let sheets = of_light(scene, &borders(scene, &rims(scene, |_, _| true)), 0);
            // Others reach a little past where light comes, by places.
            let all_around = |s: &Sheet| matches!(&s.pieces[..], [p] if p[0].0 == 0.0 && p[p.len() - 1].0 == 1.0);
            let of_disk = |s: &&Sheet| matches!(s.border.line, Line::Rim { .. }) && s.route.len() == 1 && all_around(s);
            let count = |o, w| {
                let found = sheets.iter().filter(of_disk).flat_map(|s| s.crossings(scene, o, w, [0.0, 0.8]));
                let mut at: Vec<f64> = found.map(|c| c.1).collect();
                at.sort_by(f64::total_cmp);
                at
            };
            lines.iter().map(|&(o, w)| count(o, w)).collect::<Vec<_>>()
        };
        let first = met(&turned(0.0, light));
        let twice = first.iter().filter(|at| at.len() == 2).count();
        println!("{light}: {twice} of {}", first.len());
        assert!(twice > 60, "{twice}");
        for degrees in [0.25, 0.5, 0.75, 7.3].map(|k| k * place) {
            for (k, (a, b)) in first.iter().zip(met(&turned(degrees, light))).enumerate() {
                let same = a.len() == b.len() && a.iter().zip(&b).all(|(a, b)| (a - b).abs() < 1e-6);
                assert!(same, "{light} {degrees} {:?}: {a:?}, {b:?}", lines[k]);
            }
        }
    }
}

/// What lies in a block is met from within it, the block itself from outside of what lies in it.
#[test]
fn light_meets_what_it_can() {
    let scene = nested(LAMP);
    let bodies = &scene.bodies;
    let named = |k: usize| (k as u32, bodies.of(k as u32));
    let [(outer, in_outer), (inner, in_inner), (bar, none)] = [0, 1, 2].map(named);
    assert!(in_outer != 0 && in_inner != 0 && none == 0);
    let met = |set: Set| [outer, inner, bar].map(|shape| bodies.may_meet(shape, Some(set)));
    assert_eq!(met(0), [true, false, false]);
    assert_eq!(met(in_outer), [true, true, true]);
    assert_eq!(met(in_outer | in_inner), [false, true, false]);
    assert!([outer, inner, bar].iter().all(|&shape| bodies.may_meet(shape, None)));
    // A lamp on the border may be on either side of it.
    let top = DVec3::Z * 0.6;
    assert_eq!(bodies.around_lamp(top, 1e-9), None);
    assert_eq!(bodies.around_lamp(top * 0.9, 1e-9), Some(in_outer));
    assert_eq!(bodies.around_lamp(top * 1.1, 1e-9), Some(0));
    // Two blocks beside each other.
    let scene = blocks(LAMP);
    assert!(!scene.bodies.may_meet(1, Some(scene.bodies.of(0))));
}
