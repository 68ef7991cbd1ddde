use std::path::Path;
use tyndall::render::driver::{Job, Mode};
use tyndall::render::plan::Terms;
use tyndall::scene::{Scene, SceneDesc, compile::LoadOptions};
use tyndall::term::EdgeForm;
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let desc = SceneDesc::load(Path::new(&a[1]), &[]).unwrap();
    let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
    for w in &scene.warnings {
        eprintln!("{w}");
    }
    let spp: u64 = a[2].parse().unwrap();
    let names: Vec<String> = a[3..].iter().map(|s| s.to_string()).collect();
    let p = scene.param_set(&desc, &names).unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    for modes in 0..if names.is_empty() { 1 } else { 2 } {
        let mode = if modes == 0 { Mode::Picture } else { Mode::Forward(&p) };
        let job = Job {
            scene: &scene,
            sensor: 0,
            crop: scene.films[0].part.crop,
            spp,
            seed: 1,
            mode,
            noise: &[],
            terms: Terms::ALL,
            edges: EdgeForm::Outward,
            split: false,
            max_time: None,
            target_error: None,
            stop: None,
        };
        let o = pool.install(|| job.run(&|_| {})).unwrap();
        let n = o.film.spec().pixels();
        for l in 0..o.film.spec().layers.len() {
            let (mut m, mut v) = (0.0, 0.0);
            for i in 0..n {
                m += o.film.mean(l, i).mean();
                v += o.film.variance_of_mean(l, i).map_or(0.0, |v| v.mean());
            }
            let var = v / n as f64 * spp as f64;
            println!("layer {l}: mean {:.6} var/sample {:.6} ", m / n as f64, var);
            if l == 0 {
                println!(
                    "  time {:.3} s, {:.3} M samples/s, efficiency 1/(var*t_sample) {:.4e}",
                    o.seconds,
                    (n as u64 * spp) as f64 / o.seconds / 1e6,
                    1.0 / (var * o.seconds / (n as u64 * spp) as f64)
                );
            }
        }
    }
}
