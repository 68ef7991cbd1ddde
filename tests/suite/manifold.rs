//! Light without extent by way of smooth surfaces in turn of which some are curved: against small lamps that paths find by themselves, against far lights, and derivatives against differences.

use crate::common::*;
use tyndall::error::WarningKind;
use tyndall::render::driver::Mode;

/// A floor in the light that something has bent, and in its shadow. What the camera sees is the floor.
fn caustic(shapes: &str, light: &str) -> String {
    format!(
        r#"<scene version="3.0.0"><default name="milk" value="0.6"/><default name="white" value="0.8"/><default name="x" value="1"/>
  <integrator type="volpath"><integer name="max_depth" value="6"/></integrator>
  <sensor type="perspective"><float name="fov" value="14"/><transform name="to_world"><lookat origin="-3, 2.5, 0" target="-0.5, -1, 0" up="0, 0, 1"/></transform>
    <film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="4"/><rfilter type="box"/></film></sensor>
  <medium type="homogeneous" id="milk"><rgb name="sigma_t" value="0.8,1,1.2"/><float name="scale" value="$milk"/><float name="albedo" value="$white"/><phase type="hg"><float name="g" value="0.4"/></phase></medium>
  {shapes}
  <shape type="rectangle" id="floor"><transform name="to_world"><scale value="5"/><rotate x="1" angle="-90"/><translate y="-1"/></transform><bsdf type="diffuse"><float name="reflectance" value="0.6"/></bsdf></shape>{light}</scene>"#
    )
}

const GLASS: &str =
    r#"<bsdf type="dielectric"><float name="int_ior" value="1.3"/><float name="ext_ior" value="1"/></bsdf>"#;
const MILK: &str = r#"<ref name="interior" id="milk"/>"#;

/// Two balls in turn; a ball under a slanted pane; a rod; a tube; a rod beside a mirror that sends light into it.
fn shapes() -> [String; 5] {
    let ball = |y: f64, r: f64, inside: &str| {
        format!(
            r#"<shape type="sphere"><point name="center" value="0, {y}, 0"/><float name="radius" value="{r}"/>{GLASS}{inside}</shape>"#
        )
    };
    let pane = format!(
        r#"<shape type="cube"><transform name="to_world"><scale x="1.5" y="0.1" z="1.5"/><rotate z="1" angle="15"/><translate y="1.2"/></transform>{GLASS}</shape>"#
    );
    let rod = format!(
        r#"<shape type="cylinder"><point name="p0" value="0, 0, -9"/><point name="p1" value="0, 0, 9"/><float name="radius" value="0.6"/>{GLASS}{MILK}</shape>"#
    );
    // Light comes in by the end of a short one, which has no lid, and leaves through its side.
    let tube = format!(
        r#"<shape type="cylinder"><point name="p0" value="0.3, 0.8, 0"/><point name="p1" value="-0.5, -0.7, 0"/><float name="radius" value="0.5"/>{GLASS}</shape>"#
    );
    let mirror = r#"<shape type="rectangle"><transform name="to_world"><rotate y="1" angle="-90"/><translate x="1.3"/></transform><bsdf type="conductor"><rgb name="eta" value="0.2,0.9,1.2"/><float name="k" value="2.5"/></bsdf></shape>"#;
    [ball(1.2, 0.4, "") + &ball(0.0, 0.6, MILK), ball(0.0, 0.6, MILK) + &pane, rod.clone(), tube, rod + mirror]
}

#[test]
fn a_point_light_is_a_small_lamp() {
    let [_, ball_and_pane, _, tube, _] = shapes();
    is_a_small_lamp(&[ball_and_pane, tube]);
}

#[test]
#[ignore = "make stress"]
fn a_point_light_is_a_small_lamp_by_way_of_others() {
    let [balls, _, rod, _, rod_and_mirror] = shapes();
    is_a_small_lamp(&[balls, rod, rod_and_mirror]);
}

/// Shadow, caustics and what the milk scatters are those of a small lamp, whose light paths find by chance.
fn is_a_small_lamp(scenes: &[String]) {
    for shapes in scenes {
        let point = forward(&caustic(shapes, POINT), &[], 1 << 14)[0];
        let lamp = by_chance(&caustic(shapes, &lamp(0.08)), 1 << 17);
        for c in 0..3 {
            let se = point.error[c].hypot(lamp.error[c]);
            assert!((point.value[c] - lamp.value[c]).abs() < 4.5 * se, "{shapes} {c}: {point:?} {lamp:?}");
            assert!(se < 0.08 * lamp.value[c], "{shapes} {c}: {point:?} {lamp:?}");
        }
        // Without such ways it is dark where they end.
        let (_, mut scene) = scene(&caustic(shapes, POINT));
        assert!(!scene.warnings.iter().any(|w| w.kind == WarningKind::LightBehindGlass), "{:?}", scene.warnings);
        scene.seeds.clear();
        let without = estimate(&run(&scene, 1 << 12, 3, Mode::Picture), 0);
        assert!(point.value[1] > 1.3 * without.value[1], "{shapes} {point:?} {without:?}");
    }
}

/// An OBJ file of a mesh with a normal a vertex.
fn smooth_mesh(path: &std::path::Path, vertices: &[([f64; 3], [f64; 3])], faces: &[[usize; 3]]) {
    let line = |name: &str, [x, y, z]: [f64; 3]| format!("{name} {x} {y} {z}\n");
    let mut file: String =
        vertices.iter().map(|v| line("v", v.0)).chain(vertices.iter().map(|v| line("vn", v.1))).collect();
    for f in faces {
        let [a, b, c] = f.map(|i| i + 1);
        file += &format!("f {a}//{a} {b}//{b} {c}//{c}\n");
    }
    std::fs::write(path, file).unwrap();
}

/// A ball of milk of 8 n² facets; a sheet of glass whose normals lean by 30 degrees; a ceiling of metal whose normals lean, above a blind.
fn smooth_meshes(dir: &std::path::Path, n: usize) -> [String; 3] {
    let of = |name: &str, rest: &str| {
        format!(r#"<shape type="obj"><string name="filename" value="{}"/>{rest}</shape>"#, dir.join(name).display())
    };
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for octant in 0..8 {
        let sign = [0, 1, 2].map(|k| if octant >> k & 1 == 0 { 1.0 } else { -1.0 });
        let index = |i: usize, j: usize| vertices.len() + i * (i + 1) / 2 + j;
        let outward = sign[0] * sign[1] * sign[2] > 0.0;
        for (i, j) in (0..n).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            let mut own = vec![[index(i, j), index(i + 1, j), index(i + 1, j + 1)]];
            own.extend((j < i).then(|| [index(i, j), index(i + 1, j + 1), index(i, j + 1)]));
            faces.extend(own.into_iter().map(|[a, b, c]| if outward { [a, b, c] } else { [a, c, b] }));
        }
        for (i, j) in (0..=n).flat_map(|i| (0..=i).map(move |j| (i, j))) {
            let p = [(n - i) as f64 * sign[0], (i - j) as f64 * sign[1], j as f64 * sign[2]];
            let size = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            vertices.push((p.map(|x| 0.6 * x / size), p.map(|x| x / size)));
        }
    }
    smooth_mesh(&dir.join("ball.obj"), &vertices, &faces);
    let quad = |y: f64, n: fn(f64, f64) -> [f64; 3]| {
        [[-3.0, -3.0], [-3.0, 3.0], [3.0, 3.0], [3.0, -3.0]].map(|[x, z]| ([x, y, z], n(x, z)))
    };
    let above = quad(0.6, |x, z| [-0.58 + 0.03 * x, 1.0, 0.03 * z]);
    smooth_mesh(&dir.join("glass.obj"), &above, &[[0, 1, 2], [0, 2, 3]]);
    let below = quad(4.0, |x, z| [0.72 + 0.03 * x, -1.0, 0.02 * z]);
    smooth_mesh(&dir.join("metal.obj"), &below, &[[0, 2, 1], [0, 3, 2]]);
    let metal = r#"<bsdf type="conductor"><rgb name="eta" value="0.2,0.9,1.2"/><float name="k" value="2.5"/></bsdf>"#;
    let blind = r#"<shape type="rectangle"><transform name="to_world"><rotate x="1" angle="-90"/><translate x="0.5" y="2"/></transform><bsdf type="diffuse"><float name="reflectance" value="0"/></bsdf></shape>"#;
    [of("ball.obj", &format!("{GLASS}{MILK}")), of("glass.obj", GLASS), of("metal.obj", metal) + blind]
}

/// The camera of [`caustic`] elsewhere: under what would show it the lamp itself.
fn seen(text: &str, origin: &str, target: &str) -> String {
    let moved =
        text.replace(r#"origin="-3, 2.5, 0" target="-0.5, -1, 0""#, &format!(r#"origin="{origin}" target="{target}""#));
    assert_ne!(moved, text);
    moved
}

/// Meshes shaded by vertex normals bend light by these, and paths from the other end see as much of it, however far they lean from the faces.
#[test]
fn vertex_normals_bend_light() {
    bends_light(&[0, 3]);
}

#[test]
#[ignore = "make stress"]
fn vertex_normals_bend_light_below() {
    bends_light(&[1, 2]);
}

fn bends_light(which: &[usize]) {
    let dir = tempfile::tempdir().unwrap();
    let [ball, glass, metal] = smooth_meshes(dir.path(), 4);
    let below = ["-2.2, 0.2, 0", "-0.5, -1, 0"];
    // Where the faces' own normals would send light that paths from there do not: normals lean too far for both.
    let aside = ["3, 0.2, 0", "4.6, -1, 0"];
    let scenes = [
        (&ball, None, 0.15, 0.08, 1.3),
        (&glass, Some(below), 0.2, 0.03, 1.3),
        (&metal, Some(below), 0.2, 0.06, 1.3),
        (&metal, Some(aside), 0.08, 0.06, 1.0),
    ];
    for &k in which {
        let (shapes, camera, radius, limit, gain) = scenes[k];
        let of = |light: &str| {
            let text = caustic(shapes, light);
            camera.map_or(text.clone(), |[origin, target]| seen(&text, origin, target))
        };
        let point = forward(&of(POINT), &[], 1 << 14)[0];
        let lamp = forward(&of(&lamp(radius)), &[], 1 << 16)[0];
        for c in 0..3 {
            let se = point.error[c].hypot(lamp.error[c]);
            println!(
                "{k} {c}: {:.5} +- {:.5}, lamp {:.5} +- {:.5}",
                point.value[c], point.error[c], lamp.value[c], lamp.error[c]
            );
            assert!((point.value[c] - lamp.value[c]).abs() < 4.5 * se, "{k} {c}: {point:?} {lamp:?}");
            assert!(se < limit * lamp.value[c], "{k} {c}: {point:?} {lamp:?}");
        }
        let (_, mut scene) = scene(&of(POINT));
        assert!(!scene.warnings.iter().any(|w| w.kind == WarningKind::LightBehindGlass), "{:?}", scene.warnings);
        scene.seeds.clear();
        let without = estimate(&run(&scene, 1 << 12, 3, Mode::Picture), 0);
        assert!(point.value[1] >= gain * without.value[1], "{k} {point:?} {without:?}");
    }
}

/// A mesh of many faces with a ball's normals is the ball: by point light and sun, and what milk does in it is in the record.
#[test]
fn a_fine_mesh_is_a_ball() {
    let dir = tempfile::tempdir().unwrap();
    let [mesh, ..] = smooth_meshes(dir.path(), 16);
    let ball = format!(r#"<shape type="sphere"><float name="radius" value="0.6"/>{GLASS}{MILK}</shape>"#);
    let sun = r#"<emitter type="directional"><vector name="direction" value="-1, -3, 0"/><float name="irradiance" value="2"/></emitter>"#;
    for light in [POINT, sun] {
        let [a, b] = [&mesh, &ball].map(|shapes| forward(&caustic(shapes, light), &["milk", "white"], 1 << 13));
        for (a, b) in a.iter().zip(&b) {
            let se = a.error[1].hypot(b.error[1]);
            println!("{:.5} +- {:.5}, ball {:.5} +- {:.5}", a.value[1], a.error[1], b.value[1], b.error[1]);
            assert!((a.value[1] - b.value[1]).abs() < 4.5 * se && se < 0.15 * b.value[1].abs(), "{a:?} {b:?}");
        }
    }
}

/// Light from far away is parallel; a wide beam is such light, too.
#[test]
fn far_lights_are_parallel() {
    let far = r#"<emitter type="point"><point name="position" value="1000, 3000, 0"/><float name="intensity" value="2e7"/></emitter>"#;
    let sun = r#"<emitter type="directional"><vector name="direction" value="-1, -3, 0"/><float name="irradiance" value="2"/></emitter>"#;
    let beam = r#"<emitter type="collimated"><transform name="to_world"><lookat origin="10, 30, 0" target="0, 0, 0" up="0, 0, 1"/></transform>
      <float name="radius" value="9"/><string name="profile" value="hard"/><float name="irradiance" value="2"/></emitter>"#;
    // Behind a rod: the focus of balls has no second moment.
    let [_, _, rod, ..] = shapes();
    let of = |light: &str| forward(&caustic(&rod, light), &[], 1 << 14)[0];
    let (a, b, c) = (of(far), of(sun), of(beam));
    for other in [a, c] {
        let se = b.error[1].hypot(other.error[1]);
        assert!((b.value[1] - other.value[1]).abs() < 4.5 * se && se < 0.06 * b.value[1], "{b:?} {other:?}");
    }
}

/// What milk does to such light is in the record.
#[test]
fn derivatives_by_media() {
    let [balls, ..] = shapes();
    against_differences(&caustic(&balls, POINT), &[("milk", 0.05), ("white", 0.02)], &["all"], 1 << 12, 0.03);
}
