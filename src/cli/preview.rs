//! `--preview`: the picture, and maps of the derivatives beside it, as a PNG.

use super::format;
use std::path::Path;
use tyndall::error::Result;
use tyndall::image::RgbImage;
use tyndall::render::film::Film;
use tyndall::render::png::{self, Exposure, Panel, Sheet};

pub fn write(path: &Path, film: &Film) -> Result<()> {
    let spec = film.spec();
    let image = |layer| RgbImage { width: spec.width, height: spec.height, pixels: film.mean_image(layer) };
    if spec.layers.len() == 1 {
        return png::write_picture(path, &image(0), Exposure::Auto);
    }
    let mut panels = vec![Panel::picture("picture", &image(0), Exposure::Auto)];
    for (layer, name) in spec.layers.iter().enumerate().skip(1) {
        // All derivative panels share one range: the title says how much each has.
        let n = spec.pixels() as f64;
        let mean = (0..spec.pixels()).map(|p| film.mean(layer, p).abs().mean()).sum::<f64>() / n;
        let name = name.strip_prefix("d_").unwrap_or(name);
        panels.push(Panel::derivative(format!("d/d {name}, mean |d| {}", format::number(mean)), &image(layer)));
    }
    Sheet { panels, unit: "radiance / unit of the parameter".into(), ..Sheet::default() }.write(path)
}
