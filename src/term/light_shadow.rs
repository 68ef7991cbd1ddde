//! Shadows of moving zero-measure lights, in media and on what receives them: terms G and R of [T] section 3, [S] Eq. (2), (3).
//!
//! The shadow sheet of an outline moves with `v_n = -(λ-1) <n, ṗ>` (λ = ρ/ρ_e; distant light: `ρ <n, ḋ>`), every path vertex stays where it is. What the
//! sheet adds is `-v_n` times the light's irradiance times what its points scatter into the picture: [T] (35) where a camera ray
//! crosses it, [T] (36) from the outline outward, through any number of scatterings, receivers included.

use super::outline::Outlines;
use super::sheet::{Partials, Ray, Reach};
use super::sheet_samples::{self, Found};
use super::{Context, Motion, Partial, Room, Sample};
use crate::math::discrete::Discrete;
use crate::math::rng::Rng;
use crate::params::Slot;
use crate::scene::Scene;
use crate::sensor::Sensor;

pub const NAME: &str = "light_shadow";

pub struct LightShadow {
    lights: Vec<Shadow>,
    table: Discrete,
    reach: Reach,
}

/// The shadows of one light.
struct Shadow {
    outlines: Outlines,
    /// Of the position, or of a distant light's direction.
    slot: Slot,
}

impl LightShadow {
    /// Silhouettes of every light that moves; `None` if no shadow does.
    pub fn prepare(scene: &Scene, sensor: &Sensor, motion: &Motion) -> Option<LightShadow> {
        let mut lights = Vec::new();
        for (i, (l, m)) in scene.lights.iter().zip(&motion.lights).enumerate() {
            let slot = match l.center() {
                Some(_) if m.position => l.place.position,
                None if m.direction => l.place.direction,
                _ => continue,
            };
            lights.extend(Outlines::new(scene, i as u32).map(|outlines| Shadow { outlines, slot }));
        }
        let power = |s: &Shadow| scene.lights[s.outlines.light() as usize].value.max().max(f64::MIN_POSITIVE);
        let table = Discrete::new(lights.iter().map(power));
        (!lights.is_empty()).then(|| LightShadow { lights, table, reach: Reach::new(scene, sensor) })
    }
}

/// `-v_n` as a form on the light's slots.
fn motion(ray: &Ray, rho: f64, slot: Slot) -> Partials {
    let v = if ray.distant { ray.n * -rho } else { ray.n * (rho / ray.near - 1.0) };
    let mut p = Partials::default();
    p.push(Partial { slot, v, len: 3 });
    p
}

impl Room for LightShadow {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        if cx.set.max_depth <= 1 {
            return;
        }
        let mut spans = Vec::new();
        sheet_samples::camera_spans(cx, film, &mut spans);
        for k in 1..=spans.len() {
            let (spans, span) = (&spans[..k], &spans[k - 1]);
            for (i, s) in self.lights.iter().enumerate() {
                s.outlines.crossings(span.o, span.w, 0.0, span.t1, |c| {
                    let ray = Ray { across: c.ray.across * self.table.probability(i), ..c.ray };
                    let found = Found { spans, t: c.t, ray, rho: c.rho, grazed: c.grazed };
                    sheet_samples::crossing(cx, &self.reach, &found, &motion(&ray, c.rho, s.slot), rng, emit);
                });
            }
        }
    }

    fn outward(&self, cx: &mut Context, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        let (k, probability, _) = self.table.sample(rng.uniform());
        let shadow = &self.lights[k];
        let Some((ray, grazed)) = shadow.outlines.sample(rng.uniform()) else { return };
        let ray = Ray { across: ray.across * probability, ..ray };
        sheet_samples::outward(cx, &self.reach, &ray, grazed, |ray, rho| motion(ray, rho, shadow.slot), rng, emit);
    }
}
