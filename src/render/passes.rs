//! The passes of one batch: the samples of its pixels, paths through limbs, and rooms outward from their sheets. What they write to is order-free.

use super::driver::{Job, Mode};
use super::film::Film;
use super::gradient::Gradient;
use super::health::{Health, Mishap};
use super::limb::{LIMB_KEY, Limbs};
use super::rooms::{self, Rooms};
use super::swept::{Derivatives, Swept};
use crate::math::Rgb;
use crate::math::rng::{Purpose, Rng};
use crate::params::Reverse;
use crate::params::sink::DRAWS;
use crate::transport::poles::Poles;
use crate::transport::{self, Beginning, Tally};
use smallvec::{SmallVec, smallvec};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// Samples of a pixel after which signals and the time are looked at.
const LOOK: u64 = 256;

/// What threads share.
pub struct Work<'a> {
    pub swept: Option<Swept<'a>>,
    pub limbs: Option<Limbs<'a>>,
    pub rooms: Option<Rooms<'a>>,
    pub film: Film,
}

impl Job<'_> {
    /// Where a pixel of the film lies in the crop.
    fn in_crop(&self, [x, y]: [usize; 2]) -> Option<usize> {
        let [x0, y0, x1, y1] = self.crop;
        (x >= x0 && x < x1 && y >= y0 && y < y1).then(|| (y - y0) * self.width() + x - x0)
    }

    /// Add one contribution of a room.
    fn contribute(&self, room: usize, c: &rooms::Contribution, film: &Film, reverse: &mut Option<Reverse>) {
        let mut taken: SmallVec<[(usize, Rgb); 16]> =
            c.pixels.iter().filter_map(|(p, w)| Some((self.in_crop(*p)?, *w))).collect();
        if taken.is_empty() {
            return;
        }
        let finite = c.partials().all(|(_, v)| v.is_finite());
        taken.retain(|(pixel, w)| {
            let taken = finite && w.is_finite();
            if !taken {
                film.reject_sample(*pixel);
            }
            taken
        });
        match (&self.mode, reverse) {
            (Mode::Forward(p), _) => {
                let mut rates: SmallVec<[f64; 8]> = smallvec![0.0; p.len()];
                c.contract(p, &mut rates);
                for (j, r) in rates.iter().enumerate().filter(|(_, r)| **r != 0.0) {
                    for (pixel, w) in &taken {
                        let rate = *w * *r;
                        film.add(*pixel, j + 1, rate);
                        if self.split {
                            film.add(*pixel, 1 + (2 + room) * p.len() + j, rate);
                        }
                    }
                }
            }
            (Mode::Reverse(_, adjoint), Some(r)) => {
                let sum: f64 = taken.iter().map(|(pixel, w)| adjoint[*pixel].dot(*w)).sum();
                let mut noise = [0.0; DRAWS];
                for (pixel, w) in &taken {
                    self.draw(*pixel, |k, n| noise[k] += n.dot(*w));
                }
                let asked = sum != 0.0 || noise.iter().any(|n| *n != 0.0);
                c.partials().filter(|_| asked).for_each(|(slot, v)| r.scatter(slot, sum * v, |k| noise[k] * v));
                if r.take_nonfinite() {
                    film.reject_sample(taken[0].0);
                }
            }
            _ => {}
        }
    }

    /// Draws of the adjoint's noise at a pixel, by their numbers: a standard deviation with a sign that is a coin's.
    fn draw(&self, pixel: usize, mut each: impl FnMut(usize, Rgb)) {
        let Some(noise) = self.noise.get(pixel) else { return };
        let coins = Rng::keyed(self.seed, Purpose::Sign as u64, pixel as u64, 0).next_u64();
        (0..DRAWS).for_each(|k| each(k, *noise * if coins >> k & 1 == 1 { 1.0 } else { -1.0 }));
    }

    /// What follows belongs to these pixels, by these weights.
    fn weigh(&self, r: &mut Reverse, pixels: &[(usize, f64)]) {
        let Mode::Reverse(_, adjoint) = self.mode else { return };
        (r.adjoint, r.noise) = (Rgb::ZERO, [Rgb::ZERO; DRAWS]);
        for &(pixel, w) in pixels {
            r.adjoint += adjoint[pixel] * w;
            self.draw(pixel, |k, n| r.noise[k] += n * w);
        }
    }

    /// The outward pass of one batch, cut into blocks.
    pub(super) fn outward(
        &self,
        rooms: &Rooms,
        samples: std::ops::Range<u64>,
        film: &Film,
        dropped: &AtomicBool,
        gradient: &mut Gradient,
    ) {
        // (room, first sample, end) of every block.
        let mut blocks = Vec::new();
        for room in 0..rooms.list.len() {
            let n = rooms.outward_samples(room);
            let (mut first, end) = (samples.start * n, samples.end * n);
            while first < end {
                let next = (first + rooms::BLOCK).min(end);
                blocks.push((room, first, next));
                first = next;
            }
        }
        gradient.gather(blocks.len(), matches!(self.mode, Mode::Reverse(..)), |k, sink| {
            if self.stop.is_some_and(|s| s.load(Ordering::Relaxed)) {
                dropped.store(true, Ordering::Relaxed);
                return;
            }
            let (room, first, end) = blocks[k];
            let mut tally = Tally::default();
            let start = Instant::now();
            for i in first..end {
                rooms.outward(room, i, &mut tally, &mut |c| self.contribute(room, &c, film, sink));
            }
            rooms.add_time(room, start);
            count(&film.health, &tally);
        });
    }

    /// The samples of one batch in some pixels; false where it was `over` before all of them.
    pub(super) fn tile(
        &self,
        pixels: std::ops::Range<usize>,
        samples: std::ops::Range<u64>,
        work: &Work,
        light_on_ray: &Mutex<Option<[usize; 2]>>,
        reverse: &mut Option<Reverse>,
        over: impl Fn() -> bool,
    ) -> bool {
        let Work { swept, limbs, rooms, film } = work;
        let images = swept.as_ref().map_or(0, |s| s.images);
        let media = !self.scene.media.is_empty();
        let (mut one, mut derivative) = (Derivatives::new(images), Derivatives::new(images));
        let mut tally = Tally::default();
        for pixel in pixels {
            let (x, y) = (self.crop[0] + pixel % self.width(), self.crop[1] + pixel / self.width());
            let key = self.pixel_key(x, y);
            let mut sum = Rgb::ZERO;
            derivative.clear();
            for s in samples.clone() {
                if s % LOOK == 0 && over() {
                    return false;
                }
                let (mut begin, point) = self.beginning(Purpose::Path, x, y, s);
                let on_ray = tally.light_on_ray;
                let poles = limbs.as_ref().map(|l| l.poles(point, None));
                let weight = poles.as_ref().map_or(1.0, Poles::weight);
                // On an outline itself nothing is left for the pixel.
                begin.poles = poles.filter(|p| media && weight > 0.0 && !p.list.is_empty()).map(Arc::new);
                if let Some(r) = reverse {
                    self.weigh(r, &[(pixel, weight)]);
                }
                let value = match swept {
                    Some(swept) => {
                        let d = Rng::keyed(self.seed, Purpose::Derivative as u64, key, s);
                        swept.path(&begin, d, &mut one, reverse, &mut tally)
                    }
                    None => transport::sample(self.scene, &self.scene.settings, &begin, &mut tally),
                };
                if tally.light_on_ray > on_ray {
                    if let Ok(mut first) = light_on_ray.lock() {
                        *first =
                            Some(first.map_or([x, y], |f: [usize; 2]| if (f[1], f[0]) <= (y, x) { f } else { [x, y] }));
                    }
                }
                // A sample that is not a number is left out whole and counted, never set to 0 in silence; of a gradient, those of its partials that are none.
                let partial = reverse.as_mut().is_some_and(Reverse::take_nonfinite);
                if !value.is_finite() || !one.is_finite() || partial {
                    film.reject_sample(pixel);
                    continue;
                }
                sum += value;
                derivative.add(&one, weight);
            }
            film.add(pixel, 0, sum);
            if let Some(swept) = swept {
                swept.deposit(&derivative, 1.0, pixel, film);
            }
            if let Some(rooms) = rooms {
                for (room, s) in (0..rooms.list.len()).flat_map(|r| samples.clone().map(move |s| (r, s))) {
                    if s % LOOK == 0 && over() {
                        return false;
                    }
                    rooms.along(room, [x, y], key, s, &mut tally, &mut |c| {
                        self.contribute(room, &c, film, reverse);
                    });
                }
            }
        }
        count(&film.health, &tally);
        true
    }

    /// Paths of one batch beside outlines.
    pub(super) fn limbs(
        &self,
        limbs: &Limbs,
        swept: &Swept,
        samples: std::ops::Range<u64>,
        film: &Film,
        dropped: &AtomicBool,
        gradient: &mut Gradient,
    ) {
        let sensor = &self.scene.sensors[self.sensor];
        let media = !self.scene.media.is_empty();
        let (first, end) = (samples.start * limbs.count(), samples.end * limbs.count());
        let blocks = (end - first).div_ceil(rooms::BLOCK) as usize;
        gradient.gather(blocks, matches!(self.mode, Mode::Reverse(..)), |k, reverse| {
            if self.stop.is_some_and(|s| s.load(Ordering::Relaxed)) {
                dropped.store(true, Ordering::Relaxed);
                return;
            }
            let first = first + k as u64 * rooms::BLOCK;
            let (mut d, mut tally) = (Derivatives::new(swept.images), Tally::default());
            for i in first..(first + rooms::BLOCK).min(end) {
                let key = LIMB_KEY | self.sensor as u64;
                let mut rng = Rng::of(limbs.even(), self.seed, Purpose::Path as u64, key, i);
                let Some((point, strip)) = limbs.sample(&mut rng) else { continue };
                let poles = limbs.poles(point, strip);
                let pixels = limbs.weights(point, &poles).filter_map(|(p, w)| Some((self.in_crop(p)?, w)));
                let pixels: Vec<(usize, f64)> = pixels.collect();
                let Some(&(nearest, _)) = pixels.first() else { continue };
                if let Some(r) = reverse {
                    self.weigh(r, &pixels);
                }
                let (o, w) = sensor.ray(point[0], point[1]);
                let stream = Rng::keyed(self.seed, Purpose::Derivative as u64, key, i);
                let poles = media.then(|| Arc::new(poles));
                let begin = Beginning { poles, ..Beginning::new(rng, o, w, sensor.medium) };
                swept.path(&begin, stream, &mut d, reverse, &mut tally);
                if d.is_finite() && !reverse.as_mut().is_some_and(Reverse::take_nonfinite) {
                    pixels.iter().for_each(|(p, w)| swept.deposit(&d, *w, *p, film));
                } else {
                    film.reject_sample(nearest);
                }
            }
            count(&film.health, &tally);
        });
    }
}

fn count(health: &Health, t: &Tally) {
    health.add(Mishap::TruncatedEnergy, t.capped);
    health.add(Mishap::MissedBoundaries, t.missed_boundary);
    health.add(Mishap::LightOnRay, t.light_on_ray);
    health.add(Mishap::UnboundedVacuum, t.unbounded_vacuum);
    health.add(Mishap::RejectedNonfinite, t.nonfinite);
    health.add(Mishap::UnsettledRoots, t.unsettled);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::DVec3;
    use crate::params::{Partial, Slot};
    use crate::render::film::FilmSpec;
    use crate::render::plan::Terms;
    use crate::render::rooms::Contribution;
    use crate::scene::compile::LoadOptions;
    use crate::scene::{Scene, SceneDesc};
    use crate::term::{EdgeForm, Sample};

    const LAMP: &str = r#"<scene version="3.0.0"><default name="x" value="1"/><integrator type="volpath"/>
      <sensor type="perspective"><film type="hdrfilm"><integer name="width" value="4"/><integer name="height" value="2"/></film></sensor>
      <emitter type="point"><point name="position" value="$x, 2, 3"/><rgb name="intensity" value="1"/></emitter></scene>"#;

    /// What lies outside of the crop is no sample of it; what is not finite is left out whole and counted; the rest is weight times partial times tangent, in both modes.
    #[test]
    fn contributions_are_cropped_and_finite() {
        let desc = SceneDesc::parse(LAMP, std::path::Path::new("lamp.xml"), &[]).unwrap();
        let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
        let params = scene.param_set(&desc, &["x".into()]).unwrap();
        let slots = scene.slots.values.len() as Slot;
        let slot = (0..slots).find(|&s| params.tangents(s).iter().any(|t| *t != 0.0)).unwrap();
        let crop = [1, 0, 3, 2];
        let spec = FilmSpec { width: 2, height: 2, layers: vec!["".into(), "d_x".into()], quantum: vec![-40; 2] };
        // Value and rejections of each pixel of the crop, and the gradient.
        let run = |mode: Mode, partial: f64, weights: [f64; 2]| {
            let reverse = matches!(mode, Mode::Reverse(..));
            let job = Job {
                scene: &scene,
                sensor: 0,
                crop,
                spp: 1,
                seed: 0,
                mode,
                noise: &[],
                terms: Terms::ALL,
                edges: EdgeForm::Outward,
                split: false,
                max_time: None,
                target_error: None,
                stop: None,
            };
            let partials = [Partial { slot, v: DVec3::new(partial, 0.0, 0.0), len: 1 }];
            let sample =
                Sample { film: [2.0, 1.0], flux: Rgb::ONE, partials: &partials, film_per_sheet: 0.0, outward: 1.0 };
            let pixels =
                [([0, 0], Rgb::splat(9.0)), ([1, 0], Rgb::splat(weights[0])), ([2, 1], Rgb::splat(weights[1]))];
            let mut film = Film::new(spec.clone());
            let mut sink = reverse.then(|| Reverse::new(slots as usize, false, crate::params::ArraySum::default()));
            job.contribute(0, &Contribution { sample: &sample, pixels: &pixels }, &film, &mut sink);
            film.end_batch(0, 1).unwrap();
            let values: Vec<f64> = (0..4).map(|p| film.mean(1, p)[0]).collect();
            let rejected: Vec<u32> = film.rejected.iter().map(|r| r.load(Ordering::Relaxed)).collect();
            (values, rejected, sink.map(|r| r.scalars[slot as usize]))
        };
        let forward = || Mode::Forward(&params);
        assert_eq!(run(forward(), 3.0, [2.0, 5.0]), (vec![6.0, 0.0, 0.0, 15.0], vec![0; 4], None));
        assert_eq!(run(forward(), 3.0, [f64::NAN, 5.0]), (vec![0.0, 0.0, 0.0, 15.0], vec![1, 0, 0, 0], None));
        assert_eq!(run(forward(), f64::INFINITY, [2.0, 5.0]), (vec![0.0; 4], vec![1, 0, 0, 1], None));
        let adjoint = [1.0, 100.0, 100.0, 10.0].map(Rgb::splat);
        let reverse = || Mode::Reverse(&params, &adjoint);
        assert_eq!(run(reverse(), 3.0, [2.0, 5.0]).2, Some(3.0 * 3.0 * (2.0 + 50.0)));
        assert_eq!(run(reverse(), 3.0, [f64::NAN, 5.0]).2, Some(3.0 * 3.0 * 50.0));
        // Too large with its weight alone: counted here, not at the next path.
        assert_eq!(run(reverse(), 1e300, [1e10, 0.0]).1, vec![1, 0, 0, 0]);
    }
}
