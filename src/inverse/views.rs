//! What a fit found, as its cameras see it: beside their targets, those it never saw among them.

use super::album::{Targets, image};
use crate::error::Result;
use crate::image::RgbImage;
use crate::render::family::{View, stream};
use crate::render::png::{Exposure, Panel, Sheet, exposure_scale};
use crate::scene::Scene;
use serde::Serialize;
use std::path::Path;

/// One sensor at the end of a fit.
#[derive(Clone, Debug, Serialize)]
pub struct Seen {
    pub sensor: String,
    /// Whether the fit saw it.
    pub fitted: bool,
    /// Peak signal-to-noise ratio of the picture against the target, in dB: `10 log10(max T² / mean (I - T)²)` over pixels and channels of linear radiance,
    /// the noise of both included.
    pub psnr: Option<f64>,
    #[serde(skip)]
    picture: RgbImage,
}

/// Peak signal-to-noise ratio, dB.
pub fn psnr(picture: &RgbImage, target: &RgbImage) -> f64 {
    let pairs = picture.pixels.iter().flatten().zip(target.pixels.iter().flatten());
    let n = (3 * target.pixels.len()) as f64;
    let squares: f64 = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    let peak = target.pixels.iter().flatten().fold(0.0, |m: f64, &x| m.max(f64::from(x)));
    10.0 * (peak * peak * n / squares).log10()
}

/// Render every view and compare.
pub fn look(
    scene: &Scene,
    views: &[(View, String, bool)],
    targets: &Targets,
    spp: u64,
    seed: u64,
) -> Result<Vec<Seen>> {
    let one = |(view, name, fitted): &(View, String, bool)| {
        let picture = image(&view.picture(scene, spp, stream(seed, 11, 0))?);
        let psnr = targets[view.sensor].as_ref().map(|t| psnr(&picture, t)).filter(|x| x.is_finite());
        Ok(Seen { sensor: name.clone(), fitted: *fitted, psnr, picture })
    };
    views.iter().map(one).collect()
}

/// Picture and target of every view, side by side.
pub fn write(path: &Path, seen: &[Seen], views: &[(View, String, bool)], targets: &Targets) -> Result<()> {
    let mut sheet = Sheet { columns: 4, ..Sheet::default() };
    for (s, (view, ..)) in seen.iter().zip(views) {
        let target = targets[view.sensor].as_ref();
        let exposure = Exposure::Scale(exposure_scale(&target.unwrap_or(&s.picture).pixels, Exposure::Auto));
        let name: String = s.sensor.chars().take(10).collect();
        let title = if s.fitted { format!("{name} found") } else { format!("{name} unseen") };
        sheet.panels.push(Panel::picture(title, &s.picture, exposure));
        sheet.panels.push(Panel::picture(
            if target.is_some() { "target" } else { "no target" },
            target.unwrap_or(&s.picture),
            exposure,
        ));
    }
    sheet.write(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenth_of_the_peak_is_twenty_decibels() {
        let image = |x: f32| RgbImage { width: 2, height: 1, pixels: vec![[x, 2.0, 2.0]; 2] };
        // One channel of three is off by 0.2 at a peak of 2.
        assert!((psnr(&image(0.2), &image(0.0)) - (20.0 + 10.0 * 3f64.log10())).abs() < 1e-6);
    }
}
