//! Losses of a picture I against a reference T, and their adjoint images dL/dI.
//!
//! Means run over pixels and channels, n terms:
//! l2 = mean (I - T)^2; l1 = mean |I - T|; relative-l2 = sum (I - T)^2 / sum T^2.
//!
//! I is an estimate. Where the loss is quadratic its expectation exceeds the loss of the true picture by the variance of I, which is
//! taken off, so the value is unbiased; so is the gradient, because the pass that makes it draws from another stream ([T] 1.5). l1 has
//! no such correction: its sign is that of a noisy pixel.

use crate::error::{Error, Result};
use crate::image::RgbImage;
use crate::math::Rgb;
use crate::math::erf::erfc;
use crate::render::film::Film;
use serde::{Deserialize, Serialize};

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// Mean of (I - T)^2
    #[default]
    L2,
    /// Mean of |I - T|
    L1,
    /// Sum of (I - T)^2 over sum of T^2
    RelativeL2,
}

/// A loss with its standard error, and the adjoint image dL/dI.
pub struct Evaluated {
    pub value: f64,
    /// From the picture's noise (normal, channels of a pixel fully correlated); that of the reference is not in it.
    pub error: f64,
    pub adjoint: Vec<Rgb>,
    /// Its standard deviations, from the picture's noise as well; no numbers where one batch tells nothing of that.
    pub noise: Vec<Rgb>,
}

impl Loss {
    /// What its value and its gradient are, as estimates.
    pub fn bias(self) -> &'static str {
        match self {
            Loss::L2 => {
                "value and gradient unbiased: the picture's variance is taken off, picture and gradient draw from independent streams"
            }
            Loss::L1 => {
                "biased: sign(I - T) is that of a noisy pixel, so the gradient shrinks and the value grows where the picture's standard error is not far below |I - T|"
            }
            Loss::RelativeL2 => {
                "value and gradient unbiased for the target as it is: the divisor is the target's, not the picture's; noise in the target biases the divisor (upward, by its variance)"
            }
        }
    }

    pub fn evaluate(self, film: &Film, target: &[Rgb]) -> Result<Evaluated> {
        let n = 3.0 * target.len() as f64;
        let squares: f64 = target.iter().map(|t| t.dot(*t)).sum();
        let scale = if self == Loss::RelativeL2 { 1.0 / squares } else { 1.0 / n };
        if !scale.is_finite() {
            return Err(Error::usage("the target is black: a relative loss divides by it", "use --loss l2"));
        }
        let (mut value, mut error) = (0.0, 0.0);
        let (mut adjoint, mut noise) = (Vec::with_capacity(target.len()), Vec::with_capacity(target.len()));
        for (p, t) in target.iter().enumerate() {
            let d = film.mean(0, p) - *t;
            let variance = film.variance_of_mean(0, p).unwrap_or(Rgb::splat(f64::NAN));
            if self == Loss::L1 {
                value += d.abs().sum() * scale;
                error += variance.map(f64::sqrt).sum().powi(2);
                adjoint.push(d.map(|x| if x == 0.0 { 0.0 } else { x.signum() * scale }));
                // A sign that is another one with the probability p has the variance 4 p (1-p).
                noise.push(Rgb::from_fn(|c| match variance[c] {
                    v if v > 0.0 => {
                        let p = 0.5 * erfc(d[c].abs() / (2.0 * v).sqrt());
                        2.0 * (p * (1.0 - p)).sqrt() * scale
                    }
                    // 0, or no number.
                    v => v,
                }));
            } else {
                value += (d.dot(d) - variance.sum()) * scale;
                // Variance of (d + e)^2 for normal e.
                let of_square = Rgb::from_fn(|c| (4.0 * d[c] * d[c] + 2.0 * variance[c]) * variance[c]);
                error += of_square.map(f64::sqrt).sum().powi(2);
                adjoint.push(d * (2.0 * scale));
                noise.push(variance.map(f64::sqrt) * (2.0 * scale));
            }
        }
        Ok(Evaluated { value, error: error.sqrt() * scale, adjoint, noise })
    }
}

/// The part of an image that a crop renders: the image is of the crop's size, or of the full picture's.
pub fn crop_of(image: &RgbImage, name: &str, crop: [usize; 4], full: [usize; 2]) -> Result<Vec<Rgb>> {
    let [x0, y0, x1, y1] = crop;
    let (w, h) = (x1 - x0, y1 - y0);
    let (dx, dy) = match (image.width, image.height) {
        size if size == (w, h) => (0, 0),
        size if size == (full[0], full[1]) => (x0, y0),
        (iw, ih) => {
            let what = format!("{name} has {iw} x {ih} pixels, the picture has {w} x {h}");
            return Err(Error::usage(what, "give an image of the same size"));
        }
    };
    let pixel = |i: usize| {
        let p = image.pixels[(i / w + dy) * image.width + i % w + dx];
        Rgb(p.map(f64::from))
    };
    let out: Vec<Rgb> = (0..w * h).map(pixel).collect();
    match out.iter().position(|p| !p.is_finite()) {
        Some(i) => {
            let what = format!("{name}: pixel ({}, {}) is not finite", i % w + dx, i / w + dy);
            Err(Error::usage(what, "correct the image: one such pixel spoils every gradient"))
        }
        None => Ok(out),
    }
}
