//! `--preview`: the picture, and maps of the derivatives beside it, as a PNG.

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
        panels.push(Panel::derivative(name.as_str(), &image(layer)));
    }
    Sheet { panels, unit: "radiance / unit".into(), ..Sheet::default() }.write(path)
}
