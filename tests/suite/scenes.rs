//! The scenes of `scenes/`: each loads without a warning, renders, and differentiates by every parameter with a `<?diff?>` hint.

use std::path::PathBuf;
use tyndall::math::Rgb;
use tyndall::render::driver::{Job, Mode, Outcome};
use tyndall::render::plan::Plan;
use tyndall::scene::compile::LoadOptions;
use tyndall::scene::desc::{DiffHint, Param};
use tyndall::scene::{Scene, SceneDesc};

fn scenes() -> Vec<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let entries = std::fs::read_dir(folder).expect("scenes/");
    let mut found: Vec<PathBuf> = entries.map(|e| e.expect("an entry").path().join("scene.xml")).collect();
    found.sort();
    assert!(found.len() >= 3, "scenes are missing: {found:?}");
    found
}

/// A few pixels around the middle of the picture, where all of these scenes show their medium.
fn middle<'a>(scene: &'a Scene, mode: Mode<'a>) -> Job<'a> {
    let [x0, y0, x1, y1] = scene.films[0].part.crop;
    let (x, y) = ((x0 + x1) / 2, (y0 + y1) / 2);
    Job { crop: [x - 6, y - 6, x + 6, y + 6], ..crate::common::job(scene, 32, 1, mode) }
}

fn pixels(o: &Outcome, layer: usize) -> Vec<Rgb> {
    (0..o.film.spec().pixels()).map(|i| o.film.mean(layer, i)).collect()
}

#[test]
fn every_scene_renders_and_differentiates() {
    for path in scenes() {
        let name = path.display();
        let desc = SceneDesc::load(&path, &[]).unwrap_or_else(|e| panic!("{e}"));
        let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"));
        if let Some(w) = desc.warnings.iter().chain(&scene.warnings).next() {
            panic!("{name}: {w}");
        }
        // A parameter that the scene declares and does not hint at would never be looked at here.
        let hinted = |p: &&Param| p.hint != DiffHint::default();
        let names: Vec<String> = desc.params.iter().filter(hinted).map(|p| p.name.clone()).collect();
        assert_eq!(names.len(), desc.params.len(), "{name}: a parameter has no <?diff?> hint");
        assert!(names.len() >= 3, "{name}: {names:?}");
        for p in &names {
            let plan = Plan::new(&desc, std::slice::from_ref(p)).unwrap_or_else(|e| panic!("{name}: {e}"));
            plan.refuse().unwrap_or_else(|e| panic!("{name}: {e}"));
        }

        let params = scene.param_set(&desc, &names).unwrap_or_else(|e| panic!("{e}"));
        let o = middle(&scene, Mode::Forward(&params)).run(&|_| {}).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(o.film.health.biasing(), 0, "{name}");
        let picture = pixels(&o, 0);
        assert!(picture.iter().all(|p| p.0.iter().all(|&x| x >= 0.0 && x.is_finite())), "{name}: {picture:?}");
        // Beams and boards before nothing leave some of it dark.
        let around = scene.environment.is_some() || scene.sensors[0].medium.is_some();
        let lit = picture.iter().filter(|p| p.0.iter().all(|&x| x > 0.0)).count();
        let enough = if around { lit == picture.len() } else { 4 * lit > picture.len() };
        assert!(enough, "{name}: {lit} of {} pixels are lit", picture.len());
        for (k, p) in names.iter().enumerate() {
            let d = pixels(&o, k + 1);
            assert!(d.iter().all(|d| d.0.iter().all(|x| x.is_finite())), "{name}: d/d{p}");
            assert!(d.iter().any(|d| d.abs().max() > 0.0), "{name}: d/d{p} is zero everywhere");
        }
        // `render` and `grad` give one picture.
        let plain = middle(&scene, Mode::Picture).run(&|_| {}).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(picture, pixels(&plain, 0), "{name}");
    }
}
