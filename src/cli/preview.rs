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
    let picture = || Panel::picture("picture", &image(0), Exposure::Auto);
    // One sheet a parameter: their units differ, and so do their ranges.
    let mut groups: Vec<(&str, Vec<Panel>)> = Vec::new();
    for (layer, name) in spec.layers.iter().enumerate().skip(1) {
        let parameter = name.split('.').next().unwrap_or(name);
        let panel = Panel::derivative(name.as_str(), &image(layer));
        match groups.iter_mut().find(|g| g.0 == parameter) {
            Some((_, panels)) => panels.push(panel),
            None => groups.push((parameter, vec![panel])),
        }
    }
    let sheet = |panels| Sheet { panels, unit: "radiance / unit".into(), ..Sheet::default() };
    let split = groups.iter().any(|g| g.1.len() > 1);
    if split {
        // A row a parameter: picture, sum, terms.
        let row = |panels: Vec<Panel>| sheet(std::iter::once(picture()).chain(panels).collect());
        return png::write_sheets(path, &groups.into_iter().map(|g| row(g.1)).collect::<Vec<_>>(), 1);
    }
    let sheets = std::iter::once(vec![picture()]).chain(groups.into_iter().map(|g| g.1)).map(sheet);
    png::write_sheets(path, &sheets.collect::<Vec<_>>(), 4)
}
