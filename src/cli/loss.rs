//! `--loss` and what is reported of it; the losses themselves are in `inverse::loss`.

use clap::ValueEnum;
use serde::Serialize;
use tyndall::error::Result;
use tyndall::inverse::loss;
use tyndall::math::Rgb;
use tyndall::render::film::Film;

pub use tyndall::inverse::loss::crop_of as fit;

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Loss {
    /// Mean of (I - T)^2: value and gradient unbiased
    L2,
    /// Mean of |I - T|: biased where the noise of a pixel is not far below |I - T|, because its sign is taken
    L1,
    /// Sum of (I - T)^2 over sum of T^2: unbiased for the target as it is; noise in the target biases the divisor
    RelativeL2,
}

impl From<Loss> for loss::Loss {
    fn from(l: Loss) -> Self {
        match l {
            Loss::L2 => loss::Loss::L2,
            Loss::L1 => loss::Loss::L1,
            Loss::RelativeL2 => loss::Loss::RelativeL2,
        }
    }
}

impl Loss {
    pub fn bias(self) -> &'static str {
        loss::Loss::from(self).bias()
    }

    /// The loss of a film's picture, and its adjoint image with its noise.
    pub fn evaluate(self, film: &Film, target: &[Rgb]) -> Result<loss::Evaluated> {
        loss::Loss::from(self).evaluate(film, target)
    }
}

#[derive(Serialize)]
pub struct LossReport {
    pub kind: Loss,
    /// What value and gradient are, as estimates.
    pub bias: &'static str,
    /// Of several cameras the mean. Null where a quadratic loss has one batch only: its bias is not known.
    pub value: f64,
    pub target: String,
    /// Samples a pixel of the picture that the loss was taken from, and its seed.
    pub spp: u64,
    pub seed: u64,
    /// Seed of the gradient pass.
    pub gradient_seed: u64,
}

/// One camera of several.
#[derive(Serialize)]
pub struct Camera {
    pub sensor: String,
    pub crop: [usize; 4],
    /// Its target, or adjoint image.
    pub image: String,
    /// Its loss, by itself.
    pub loss: Option<f64>,
}
