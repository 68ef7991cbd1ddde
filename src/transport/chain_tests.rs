use super::*;
use crate::math::rng::{Purpose, Rng};
use crate::scene::On;
use crate::scene::chains::Chain;
use crate::scene::compile::LoadOptions;
use crate::scene::desc::SceneDesc;
use crate::transport::beam;
use std::fmt::Write;
use std::path::Path;

/// An octahedron's faces, each divided into four, again and again, with their corners on the unit sphere.
fn gem(path: &Path, times: usize) {
    let axes = [DVec3::X, DVec3::Y, DVec3::Z];
    let corner = |k: usize, bit: usize| if bit >> k & 1 == 0 { axes[k] } else { -axes[k] };
    let octant = |bits: usize| {
        let [a, b, c] = [0, 1, 2].map(|k| corner(k, bits));
        if a.cross(b).dot(c) > 0.0 { [a, b, c] } else { [a, c, b] }
    };
    let mut faces: Vec<[DVec3; 3]> = (0..8).map(octant).collect();
    for _ in 0..times {
        let split = |[a, b, c]: [DVec3; 3]| {
            let [x, y, z] = [(a, b), (b, c), (c, a)].map(|(p, q)| (p + q).normalize());
            [[a, x, z], [x, b, y], [z, y, c], [x, y, z]]
        };
        faces = faces.into_iter().flat_map(split).collect();
    }
    let mut text = String::new();
    for (i, f) in faces.iter().enumerate() {
        f.iter().for_each(|p| writeln!(text, "v {} {} {}", p.x, p.y, p.z).unwrap());
        writeln!(text, "f {} {} {}", 3 * i + 1, 3 * i + 2, 3 * i + 3).unwrap();
    }
    std::fs::write(path, text).unwrap();
}

fn with_gem(mesh: &Path, light: &str) -> Scene {
    let text = format!(
        r#"<scene version="3.0.0"><integrator type="volpath"><integer name="max_depth" value="4"/></integrator><sensor type="perspective"/>
      <shape type="obj"><string name="filename" value="{}"/><boolean name="face_normals" value="true"/><bsdf type="dielectric"/></shape>{light}</scene>"#,
        mesh.display()
    );
    let desc = SceneDesc::parse(&text, Path::new("gem.xml"), &[]).unwrap();
    Scene::compile(&desc, &LoadOptions::default()).unwrap()
}

/// Of all sequences of one and two facets, those that light takes to a point are found, and no others: inside and outside, from near and far.
#[test]
fn pencils_lose_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let mesh = dir.path().join("gem.obj");
    gem(&mesh, 1);
    let lights = [
        r#"<emitter type="point"><point name="position" value="1.5, 0.7, 1.2"/><float name="intensity" value="1"/></emitter>"#,
        r#"<emitter type="point"><point name="position" value="0.2, -0.1, 0.3"/><float name="intensity" value="1"/></emitter>"#,
        r#"<emitter type="directional"><vector name="direction" value="-1, 0.3, 0.2"/><float name="irradiance" value="2"/></emitter>"#,
    ];
    let mut rng = Rng::keyed(7, Purpose::Motion as u64, 0, 0);
    let (mut ways, mut asked) = (0, 0);
    for light in lights {
        let scene = with_gem(&mesh, light);
        let chains = &scene.chains;
        let from = scene.lights[0].origin().unwrap();
        let n = chains.faces.len() as u32;
        let link = |k: u32| Link { face: k / 4, front: k & 1 == 0, through: k & 2 == 0 };
        let mut all: Vec<Chain> =
            (0..4 * n).map(|k| Chain { light: 0, links: [link(k)].into_iter().collect(), asked: 1.0 }).collect();
        let pairs =
            (0..4 * n).flat_map(|a| (0..4 * n).map(move |b| [link(a), link(b)])).filter(|l| l[0].face != l[1].face);
        all.extend(pairs.map(|l| Chain { light: 0, links: l.into_iter().collect(), asked: 1.0 }));
        for _ in 0..12 {
            let x = warp::sphere(rng.uniform(), rng.uniform()) * (2.0 * rng.uniform());
            let mut lost = 0;
            let mut taken = |chain: &Chain| {
                let found = way(&scene, &scene.chains, (chain.light, &chain.links), from, x, &mut lost);
                let clear = |(w, points): (Way, SmallVec<[DVec3; MOST]>)| {
                    beam::clear(&scene, &w, &points, (x, On::default(), None), &mut |_| {})
                };
                found.and_then(clear).is_some()
            };
            let name = |c: &Chain| c.links.iter().map(|l| (l.face, l.front, l.through)).collect::<Vec<_>>();
            let mut expected: Vec<_> = all.iter().filter(|c| taken(c)).map(name).collect();
            let mut found = Vec::new();
            // Whatever is ever asked for.
            chains.draw(
                x,
                || 0.0,
                |id| {
                    asked += 1;
                    let c = &chains.list[id as usize];
                    if c.links.len() <= 2 && taken(c) {
                        found.push(name(c))
                    }
                },
            );
            expected.sort();
            found.sort();
            ways += expected.len();
            assert_eq!(found, expected, "{light} {x}");
        }
    }

    assert!(ways > 36 && asked < 100 * ways, "{ways} {asked}");
}
