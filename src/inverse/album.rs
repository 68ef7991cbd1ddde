//! The pictures of a fit: every sensor of the scene at the values of some iterations, with the target beside it where there is one, animated; and start, middle and end of that on
//! one sheet. Sensors that were not fitted are diagnostic: they show how the scene comes right, the fit has never seen them.

use super::fit::{Recovered, Unknown};
use crate::error::Result;
use crate::image::RgbImage;
use crate::render::animation;
use crate::render::driver::Outcome;
use crate::render::family::{Family, Member, View, stream};
use crate::render::png::{Exposure, Panel, Sheet, exposure_scale};
use crate::scene::parts::Parts;
use std::path::Path;

/// What a sensor should see.
pub type Targets = Vec<Option<RgbImage>>;

pub fn image(o: &Outcome) -> RgbImage {
    let spec = o.film.spec();
    RgbImage { width: spec.width, height: spec.height, pixels: o.film.mean_image(0) }
}

/// A view of every sensor: the fitted one as it is, the others whole.
pub fn views<'a>(member: &Member, fitted: View<'a>) -> Vec<View<'a>> {
    let all = member.scene.films.iter().enumerate();
    all.map(|(i, f)| if i == fitted.sensor { fitted } else { View { sensor: i, crop: f.part.crop, ..fitted } })
        .collect()
}

/// Iterations of the frames: the first, the last, and others between; denser at the start, where more happens.
fn chosen(iterations: usize, frames: usize) -> Vec<usize> {
    let last = iterations.saturating_sub(1) as f64;
    let at = |i: usize| (last * (i as f64 / (frames - 1).max(1) as f64).powf(1.5)).round() as usize;
    let mut v: Vec<usize> = (0..frames).map(at).collect();
    v.dedup();
    v
}

/// Frames side by side, and the target: a row a sensor.
fn side_by_side(frames: &[Sheet]) -> Sheet {
    let sensors = frames.last().map_or(0, |f| f.panels.len() / 2);
    // Panels of a frame are picture and target of one sensor after the other.
    let row =
        |s: usize| frames.iter().map(move |f| &f.panels[2 * s]).chain(frames.last().map(|f| &f.panels[2 * s + 1]));
    Sheet { panels: (0..sensors).flat_map(row).cloned().collect(), columns: frames.len() + 1, ..Sheet::default() }
}

/// A lamp in sight does not darken the rest.
const EXPOSURE: Exposure = Exposure::Quantile(0.97);
/// Samples of a still for one of a frame.
const STILL: u64 = 8;

/// Writes the animated picture to `path`, and its first, middle and last iteration, with more samples, to `still`.
pub fn write(
    path: &Path,
    still: &Path,
    family: &Family,
    unknowns: &[Unknown],
    run: &Recovered,
    fitted: View,
    targets: &Targets,
    frames: usize,
    spp: u64,
) -> Result<()> {
    let mut scales: Vec<Option<f64>> =
        targets.iter().map(|t| t.as_ref().map(|t| exposure_scale(&t.pixels, EXPOSURE))).collect();
    let mut frame = |i: usize, spp: u64| -> Result<Sheet> {
        let step = &run.history[i];
        let values: Vec<(&str, f64)> =
            unknowns.iter().map(|u| u.name.as_str()).zip(step.values.iter().copied()).collect();
        let member = family.at(&values)?;
        let names = Parts::read(&member.desc, &member.desc.values::<f64>())?.sensors;
        let mut sheet = Sheet { columns: 2, ..Sheet::default() };
        for (s, view) in views(&member, fitted).iter().enumerate() {
            let picture = image(&view.picture(&member.scene, spp, stream(run.seed, 9, i as u64))?);
            // One exposure for the whole film.
            let scale = *scales[s].get_or_insert_with(|| exposure_scale(&picture.pixels, EXPOSURE));
            let name: String = names[s].name.chars().take(12).collect();
            let exposure = Exposure::Scale(scale);
            sheet.panels.push(Panel::picture(format!("{name}, iteration{:>4}", step.iteration), &picture, exposure));
            let empty = || RgbImage { pixels: vec![[1.0 / scale as f32; 3]; picture.pixels.len()], ..picture.clone() };
            let (title, target) = match &targets[s] {
                Some(t) => ("target", t.clone()),
                None => ("no target", empty()),
            };
            sheet.panels.push(Panel::picture(title, &target, exposure));
        }
        Ok(sheet)
    };
    let shown = chosen(run.history.len(), frames);
    let sheets = shown.iter().map(|&i| frame(i, spp)).collect::<Result<Vec<_>>>()?;
    let stills = [0, shown.len() / 2, shown.len() - 1].map(|k| shown[k]);
    let stills = stills.iter().map(|&i| frame(i, STILL * spp)).collect::<Result<Vec<_>>>()?;
    side_by_side(&stills).write(still)?;
    animation::write(path, &sheets, 8)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stills_are_a_row_a_sensor() {
        let panel = |title: String| {
            Panel::picture(title, &RgbImage { width: 1, height: 1, pixels: vec![[0.0; 3]] }, Exposure::Auto)
        };
        let frame = |i: usize| {
            let panels = ["a", "ta", "b", "tb"].map(|n| panel(format!("{n}{i}"))).to_vec();
            Sheet { panels, ..Sheet::default() }
        };
        let sheet = side_by_side(&(0..3).map(frame).collect::<Vec<_>>());
        let titles: Vec<&str> = sheet.panels.iter().map(|p| p.title.as_str()).collect();
        assert_eq!((titles.join(" ").as_str(), sheet.columns), ("a0 a1 a2 ta2 b0 b1 b2 tb2", 4));
    }

    #[test]
    fn frames_run_from_the_first_to_the_last_iteration() {
        let c = chosen(100, 10);
        assert_eq!((c.len(), c[0], c[9]), (10, 0, 99));
        assert_eq!(chosen(2, 10), [0, 1]);
        assert_eq!(chosen(1, 1), [0]);
    }
}
