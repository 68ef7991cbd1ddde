//! Paths with their derivatives: the interior and moving borders, which one sweep computes and slots tell apart.

use super::film::Film;
use crate::math::Rgb;
use crate::math::rng::Rng;
use crate::params::{Both, Forward, ParamSet, Reverse};
use crate::transport::{Beginning, PathRecord, Sweep, Tally};

pub struct Swept<'a> {
    pub sweep: Sweep<'a>,
    /// Slots of moving borders, where they have layers of their own.
    pub borders: Option<&'a ParamSet>,
    /// Derivative images: 0 in reverse mode.
    pub images: usize,
    /// First of the layers of the interior and of the borders, where terms are split.
    pub layers: Option<[usize; 2]>,
}

/// What paths of one thread write to.
pub struct Derivatives {
    rec: PathRecord,
    all: Vec<Rgb>,
    borders: Vec<Rgb>,
}

impl Derivatives {
    pub fn new(images: usize) -> Self {
        Derivatives { rec: PathRecord::new(), all: vec![Rgb::ZERO; images], borders: vec![Rgb::ZERO; images] }
    }

    pub fn is_finite(&self) -> bool {
        self.all.iter().all(|d| d.is_finite())
    }

    pub fn add(&mut self, other: &Derivatives, weight: f64) {
        self.all.iter_mut().zip(&other.all).for_each(|(a, b)| *a += *b * weight);
        self.borders.iter_mut().zip(&other.borders).for_each(|(a, b)| *a += *b * weight);
    }

    pub fn clear(&mut self) {
        self.all.fill(Rgb::ZERO);
        self.borders.fill(Rgb::ZERO);
    }
}

impl Swept<'_> {
    /// One path: its value, and its derivatives in `d`, or in `reverse` times the adjoint there.
    pub fn path(
        &self,
        begin: &Beginning,
        stream: Rng,
        d: &mut Derivatives,
        reverse: &mut Option<Reverse>,
        tally: &mut Tally,
    ) -> Rgb {
        if let Some(r) = reverse {
            return self.sweep.sample(begin, stream, &mut d.rec, r, tally);
        }
        let mut all = Forward::new(self.sweep.params);
        let value = match self.borders {
            None => self.sweep.sample(begin, stream, &mut d.rec, &mut all, tally),
            Some(b) => {
                let mut own = Forward::new(b);
                let v = self.sweep.sample(begin, stream, &mut d.rec, &mut Both(&mut all, &mut own), tally);
                own.take(&mut d.borders);
                v
            }
        };
        all.take(&mut d.all);
        value
    }

    /// Adds derivatives to a pixel of the film.
    pub fn deposit(&self, d: &Derivatives, weight: f64, pixel: usize, film: &Film) {
        for j in 0..self.images {
            let (all, borders) = (d.all[j] * weight, d.borders[j] * weight);
            film.add(pixel, 1 + j, all);
            if let Some([interior, at_borders]) = self.layers {
                film.add(pixel, interior + j, all - borders);
                if self.borders.is_some() {
                    film.add(pixel, at_borders + j, borders);
                }
            }
        }
    }
}
