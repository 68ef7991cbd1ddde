//! Shadows of moving zero-measure lights, in media and on what receives them: terms G and R of [T] section 3, [S] Eq. (2), (3).
//!
//! The shadow sheet of an outline point e moves with `v_n = <n, λė - (λ-1)ṗ>` (λ = ρ/ρ_e; distant light: `<n, ė + ρḋ>`) against vertices in media, which
//! stay where they are, and with `<n, -ẏ>` more against a receiver's point y, which moves with its shape, or slides on its film point's ray. What the
//! sheet adds is `-v_n` times the light's irradiance times what its points scatter into the picture: [T] (35) where a camera ray
//! crosses it, [T] (36) from the outline outward, through any number of scatterings, receivers included.
//!
//! Two more kinds of edges of such light are parts of this room: those of glass and mirrors ([`super::cast`]), and those that rough glass makes by itself ([`super::facet_edge`]).

use super::cast::{self, Casts};
use super::ends::{self, Point, Watch};
use super::facet_edge::FacetEdges;
use super::outline::Outlines;
use super::sheet::{Grazed, Partials, Ray, Reach};
use super::sheet_samples::{self, Found};
use super::{Context, Motion, Room, Sample, panes};
use crate::light::Light;
use crate::math::discrete::Discrete;
use crate::math::guide::{DIMENSIONS, Numbers};
use crate::math::rng::Rng;
use crate::params::{Partial, Slot};
use crate::scene::Scene;
use crate::sensor::Sensor;

pub const NAME: &str = "light_shadow";

/// How many numbers are learned for traces.
const TRACES: usize = 2;

pub struct LightShadow {
    lights: Vec<Shadow>,
    table: Discrete,
    reach: Reach,
    /// Beside glass and mirrors: by their borders, and no other ([`super::interfaces`]).
    casts: Option<Casts>,
    /// Where rough glass cuts the light of lights without extent off.
    facets: Option<FacetEdges>,
}

/// The shadows of one light.
struct Shadow {
    outlines: Outlines,
    /// Of the position, or of a distant light's direction, where the light itself moves.
    slot: Option<Slot>,
    /// Outlines or receivers move.
    surfaces: bool,
}

impl LightShadow {
    /// Silhouettes from every light whose shadows may move over something; `None` if there are none.
    pub fn prepare(scene: &Scene, sensor: &Sensor, motion: &Motion, margin: f64) -> Option<LightShadow> {
        let smooth = scene.has_smooth();
        let beams = cast::takes_beams(scene, motion);
        let has_delta = scene.lights.iter().any(Light::is_delta);
        let delta = smooth && has_delta && !panes::are_clear(scene, sensor, margin, motion);
        let counts = |l: &Light| l.is_delta() && delta || l.is_beam() && beams;
        let casts = (delta || beams).then(|| Casts::prepare(scene, sensor, motion, margin, counts));
        let mut lights = Vec::new();
        for (i, (l, m)) in scene.lights.iter().zip(&motion.lights).enumerate() {
            if l.origin().is_none() || smooth {
                continue;
            }
            let slot = match l.center() {
                Some(_) if m.position => Some(l.place.position),
                None if m.direction => Some(l.place.direction),
                _ => None,
            };
            // A beam that moves takes along no outline and no point that light falls on.
            let surfaces = motion.moving.matter();
            if slot.is_some() || surfaces {
                let outlines = Outlines::of_light(scene, motion, i as u32);
                lights.extend(outlines.map(|outlines| Shadow { outlines, slot, surfaces }));
            }
        }
        let power = |s: &Shadow| scene.lights[s.outlines.light() as usize].value.max().max(f64::MIN_POSITIVE);
        let table = Discrete::new(lights.iter().map(power));
        let casts = casts.flatten();
        let facets = FacetEdges::prepare(scene, motion);
        let any = !lights.is_empty() || casts.is_some() || facets.is_some();
        any.then(|| LightShadow { lights, table, reach: Reach::new(scene, sensor), casts, facets })
    }
}

impl LightShadow {
    /// Which of the numbers that are learned is that of the edges of facets.
    fn number_of_facets(&self) -> Option<usize> {
        self.facets.as_ref()?;
        match &self.casts {
            Some(casts) if casts.has_traces() => Some(TRACES),
            _ => self.lights.is_empty().then_some(0),
        }
    }
}

impl Shadow {
    /// `-v_n`, less what the vertex itself does.
    fn motion(&self, cx: &Context, ray: &Ray, rho: f64, grazed: Grazed, point: &Point, watch: &Watch) -> Partials {
        let mut p = Partials::default();
        if let Some(slot) = self.slot {
            let v = if ray.distant { ray.n * -rho } else { ray.n * (rho / ray.near - 1.0) };
            p.push(Partial { slot, v, len: 3 });
        }
        if self.surfaces {
            let lambda = if ray.distant { 1.0 } else { rho / ray.near };
            ends::material(cx.scene, grazed, ray.at(ray.near), ray.n * -lambda, &mut p);
            ends::motion(cx, point, watch, ray.n, &mut p);
        }
        p
    }
}

impl Room for LightShadow {
    fn name(&self) -> &'static str {
        NAME
    }

    fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        if let Some(facets) = &self.facets {
            facets.along(cx, film, rng, emit);
        }
        if let Some(casts) = &self.casts {
            return casts.along(cx, film, *rng, emit);
        }
        sheet_samples::along(cx, film, |cx, spans, span| {
            for (i, s) in self.lights.iter().enumerate() {
                s.outlines.crossings(span.o, span.w, 0.0, span.t1, |c| {
                    let ray = Ray { across: c.ray.across * self.table.probability(i), ..c.ray };
                    let found = Found { spans, t: c.t, ray, rho: c.rho, grazed: c.grazed };
                    let (point, watch) = sheet_samples::crossed(cx, span, c.t);
                    let partials = s.motion(cx, &ray, c.rho, c.grazed, &point, &watch);
                    sheet_samples::crossing(cx, &self.reach, &found, &partials, emit);
                });
            }
        });
    }

    fn has_outward(&self) -> bool {
        !self.lights.is_empty() || self.facets.is_some() || self.casts.as_ref().is_some_and(Casts::has_traces)
    }

    fn guided_numbers(&self) -> usize {
        let own = match &self.casts {
            // Place on the borders, and the chain by which that is seen.
            Some(casts) if casts.has_traces() => TRACES,
            _ if self.lights.is_empty() => 0,
            _ => DIMENSIONS,
        };
        own + usize::from(self.number_of_facets().is_some())
    }

    fn outward(&self, cx: &mut Context, lead: &Numbers, rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        if let Some(facets) = &self.facets {
            // Shadows have all that are learned.
            let u = self.number_of_facets().map_or_else(|| rng.uniform(), |k| lead[k]);
            facets.outward(cx, u, emit);
        }
        if let Some(casts) = &self.casts {
            return casts.outward(cx, lead, rng, emit);
        }
        if self.lights.is_empty() {
            return;
        }
        let (k, probability, u) = self.table.sample(lead[0]);
        let shadow = &self.lights[k];
        let Some((ray, grazed, _)) = shadow.outlines.sample(u) else { return };
        let ray = Ray { across: ray.across * probability, ..ray };
        let motion =
            |cx: &Context, rho: f64, point: &Point, watch: &Watch| shadow.motion(cx, &ray, rho, grazed, point, watch);
        sheet_samples::outward(cx, &self.reach, &ray, grazed, &motion, &lead[1..], rng, emit);
    }
}
