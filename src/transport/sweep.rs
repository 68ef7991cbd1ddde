//! The backward sweep: from a path record to partial derivatives with respect to slots, term P of [T] section 3.
//!
//! Going backward, `after` is what the path collected behind the point at hand (already in film units and weighted by the
//! sampling densities, which are constants: [T] section 4). Each recorded factor `f` of the throughput contributes
//! `(df/dslot) / f x after`, in three kinds:
//!
//! * transmittance of a span: `-d(depth)/dslot x after` [T] (52b); the depth is integrated exactly;
//! * phase function, reflectance, emission: their own scores, emission without dividing by itself;
//! * the source `sigma_s L_ins` [T] 8.2 (b). A collision has density `sigma_t T` and scores `d sigma_s / sigma_s`, which is unbounded in
//!   thin media; a point of density `T` (the derivative vertex [T] (65)) needs no division but a continuation of its own. Both
//!   are used, weighted `sigma_s / (sigma_s + kappa)` and `kappa / (sigma_s + kappa)` at every point, so neither divides by
//!   `sigma_s`: the collision scores `d sigma_s / (sigma_s + kappa)`. Reflectance is treated alike with `KAPPA_RHO`.
//!
//! One derivative vertex a path, drawn from all candidates by a reservoir, continued with a probability near its share.

use super::border::{Borders, Place};
use super::chained::Backward;
use super::first::Opening;
use super::lottery::Lottery;
use super::motion::{Chained, Moving};
use super::record::{Event, MediumSpan, NoRecord, PathRecord, Prefix};
use super::state::{Beginning, Flight, Stage, State};
use super::twin::Ways;
use super::walk::{Tally, Walker};
use super::{aim, way_motion};
use crate::error::Result;
use crate::light::Emission;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::medium::{Medium, NO_SLOT};
use crate::params::{ParamSet, Sink, Slot};
use crate::scene::nearest::{Kind, Near};
use crate::scene::{Hit, On, Scene, Settings};
use crate::sensor::Sensor;
use crate::surface::Surface;
use crate::surface::rough::Rough;
use std::sync::Arc;

/// Reflectance at which a surface's derivative is shared evenly between its score and a derivative vertex.
const KAPPA_RHO: f64 = 0.05;

/// How often the derivative vertex is followed, over what its share of a derivative's standard deviation is: where it is drawn rarely its weight is a tail. Measured
/// (benches/RESULTS.md): 2 to 4 are best, of density and of albedo.
const CONTINUED: f64 = 4.0;

/// What the derivative vertex is.
#[derive(Clone, Copy, Debug)]
enum Vertex {
    Medium {
        medium: u32,
        p: DVec3,
        w: DVec3,
        flight: Flight,
    },
    Surface {
        surface: u32,
        hit: Hit,
        wi: DVec3,
        medium: Option<u32>,
    },
    /// On a border that moves.
    Border(Place),
}

/// A reservoir over the candidates of one path [T] (65).
#[derive(Clone, Debug)]
pub struct Candidates {
    pub rng: Rng,
    total: f64,
    chosen: Option<(Vertex, Rgb, u32, f64)>,
    /// Shares of the source derivative: by derivative vertices, by collision scores (dimensionless).
    by_vertex: f64,
    by_score: f64,
    unbounded: u64,
}

/// Which media and surfaces have active slots: computed once a run.
#[derive(Clone, Debug)]
pub struct SweepFacts {
    media: Vec<MediumFacts>,
    surfaces: Vec<bool>,
    /// Rough ones whose values are parameters.
    rough: Vec<bool>,
    /// Rough ones with upright facets, if directions turn or their index is a parameter.
    pub(super) upright: Vec<bool>,
    /// A bit for each light that moves ([`State::left`]), 0 for the others, and how.
    pub(super) lights: Vec<(u64, Ways)>,
    pub(super) any_source: bool,
    /// Whether something slides beside which paths are walked in pairs.
    pub(super) mirrors: bool,
    /// No parameter changes anything but the place of lights without extent.
    pub(super) lights_only: bool,
    pub(super) moving: Moving,
    pub(super) borders: Borders,
}

#[derive(Clone, Debug)]
struct MediumFacts {
    source: bool,
    extinction: bool,
    /// What it emits: numbers of its own, voxels, motion.
    glow: bool,
    g: bool,
    kappa: f64,
    /// Gray media take the walked length, chromatic ones weigh the channels.
    model: Medium,
}

impl SweepFacts {
    /// Where no shapes pass through each other: for tests.
    pub fn of(scene: &Scene, sensor: &Sensor, params: &ParamSet) -> Result<Self> {
        Ok(SweepFacts::new(scene, params, Moving::new(scene, sensor, params)?))
    }

    /// `moving`: what moves for these parameters.
    pub fn new(scene: &Scene, params: &ParamSet, moving: Moving) -> Self {
        let media: Vec<MediumFacts> = scene
            .media
            .iter()
            .map(|m| MediumFacts {
                source: m.source_active(params),
                extinction: m.extinction_active(params),
                glow: m.emission.as_ref().is_some_and(|e| e.active(params)),
                g: m.g_active(params),
                kappa: m.kappa,
                model: m.clone(),
            })
            .collect();
        let surfaces: Vec<bool> = scene
            .surfaces
            .iter()
            .map(|s| matches!(s, Surface::Diffuse { slot, .. } if params.block_active(*slot, 3)))
            .collect();
        let rough = scene.surfaces.iter().map(|s| matches!(s, Surface::Rough(r) if r.is_active(params))).collect();
        let jumps = |r: &Rough| r.jumps() && (moving.any() || r.indices_active(params));
        let upright = scene.surfaces.iter().map(|s| matches!(s, Surface::Rough(r) if jumps(r))).collect();
        let any_source = media.iter().any(|m| m.source) || surfaces.iter().any(|&s| s);
        let borders = Borders::new(scene, params);
        let mut count: u32 = 0;
        let bit = |(i, l): (usize, &crate::light::Light)| {
            // A hard edge leaves nothing else of the light to the interior.
            if !l.place.moves(params) || moving.follows(i as u32) {
                return (0, Ways::default());
            }
            count += 1;
            (1u64.checked_shl(count - 1).unwrap_or(0), Ways::new(&l.place, params))
        };
        let lights = scene.lights.iter().enumerate().map(bit).collect();
        let any_source = any_source || borders.any();
        let others = params.only(|s| !scene.lights.iter().any(|l| l.place.holds(s)));
        let lights_only = !others.any_active() && !moving.any();
        let mirrors =
            moving.field.follows() && (0..scene.shapes.len() as u32).any(|i| moving.camera || moving.moves(i));
        SweepFacts { mirrors, media, surfaces, rough, upright, lights, any_source, lights_only, moving, borders }
    }

    /// Without mirrored paths ([`super::mirror`]): for comparison.
    #[must_use]
    pub fn unpaired(self) -> Self {
        SweepFacts { mirrors: false, ..self }
    }

    /// Whether first vertices on this shape slide over it.
    pub fn slides(&self, shape: u32) -> bool {
        self.moving.camera || self.moving.moves(shape)
    }

    /// The nearest point of all that slides, if it is nearer than `radius`.
    pub fn nearest_sliding(&self, scene: &Scene, p: DVec3, radius: f64) -> Option<Near> {
        if self.moving.camera {
            scene.nearest_point(Kind::Opaque, p, radius, &|_, _| true)
        } else {
            self.moving.field.nearest_moving(scene, p, radius)
        }
    }
}

impl Candidates {
    pub fn new(rng: Rng) -> Self {
        Candidates { rng, total: 0.0, chosen: None, by_vertex: 0.0, by_score: 0.0, unbounded: 0 }
    }

    /// Of another path. What was chosen stays where it is.
    fn renew(&mut self, rng: Rng) {
        self.rng = rng;
        (self.total, self.by_vertex, self.by_score, self.unbounded) = (0.0, 0.0, 0.0, 0);
        self.chosen = None;
    }

    /// The camera line had an unbounded vacuum without a candidate.
    pub fn note_unbounded(&mut self, facts: &SweepFacts, medium: u32) {
        self.unbounded += u64::from(facts.media[medium as usize].source);
    }

    /// Offer every candidate of a chunk.
    pub fn scan(&mut self, facts: &SweepFacts, scene: &Scene, events: &[Event]) {
        if !facts.any_source {
            return;
        }
        for e in events {
            match *e {
                Event::Candidate { medium, p, w, weight, flight, depth } => {
                    self.medium(facts, medium, [p, w], weight, depth, flight);
                }
                Event::Span { span, prefix: Some(prefix) } => {
                    self.span(facts, &span, &prefix);
                    self.borders(facts, scene, &span, &prefix);
                }
                Event::Ends { span, start, end, depth } => {
                    let places = facts.borders.ends(scene, &span);
                    for (place, weight) in places.into_iter().zip([start, end]) {
                        self.border(scene, place, weight, depth);
                    }
                }
                Event::Scatter { medium, p, .. } => {
                    let m = &facts.media[medium as usize];
                    if m.source {
                        let s = m.model.coefficients(p).1.max();
                        self.by_score += s / (s + m.kappa);
                    }
                }
                Event::Surface { surface, hit, wi, medium, prefix } if facts.surfaces[surface as usize] => {
                    let weight = prefix.beta / prefix.r.mean();
                    self.by_score += 1.0;
                    self.by_vertex += KAPPA_RHO * weight.max();
                    let v = Vertex::Surface { surface, hit, wi, medium };
                    self.offer(v, weight, prefix.depth, weight.max() * KAPPA_RHO);
                }
                _ => {}
            }
        }
    }

    /// A uniform point on the walked part of a span: `E[length g(U)] = integral of T g` [T] (53).
    fn span(&mut self, facts: &SweepFacts, span: &MediumSpan, prefix: &Prefix) {
        if !facts.media[span.medium as usize].source {
            return;
        }
        // Nothing scatters, nor could, where a grid is not.
        let (t0, t1) = match facts.media[span.medium as usize].model.density_grid() {
            Some(grid) if span.t1 == f64::INFINITY => grid.clip_ray(span.o, span.w, span.t0, span.t1),
            _ => (span.t0, span.t1),
        };
        let length = t1 - t0;
        if length.is_nan() || length <= 0.0 {
            return;
        }
        if length == f64::INFINITY {
            self.unbounded += 1;
            return;
        }
        let t = t0 + self.rng.uniform() * length;
        let m = &facts.media[span.medium as usize].model;
        let weight = super::tracking::walked_weight(m, span, t, prefix.beta, prefix.r) * length;
        let whole = MediumSpan { t1: prefix.t_end, ..*span };
        let flight = Flight {
            span: Some(whole),
            density: super::tracking::flight_density(m, &whole, t),
            reach: prefix.reach,
            drawn: prefix.drawn,
        };
        self.medium(facts, span.medium, [span.o + span.w * t, span.w], weight, prefix.depth, flight);
    }

    /// Ends of a walked piece: the walk was at its start, and at its end if nothing stopped it before.
    fn borders(&mut self, facts: &SweepFacts, scene: &Scene, span: &MediumSpan, prefix: &Prefix) {
        if !facts.borders.any() {
            return;
        }
        let [start, end] = facts.borders.ends(scene, span);
        self.border(scene, start, prefix.beta / prefix.r.mean(), prefix.depth);
        if let Some(place) = end {
            let m = &scene.media[span.medium as usize];
            let weight = super::tracking::walked_weight(m, span, span.t1, prefix.beta, prefix.r);
            self.border(scene, Some(place), weight, prefix.depth);
        }
    }

    fn border(&mut self, scene: &Scene, place: Option<Place>, weight: Rgb, depth: u32) {
        let Some(place) = place else { return };
        let selection = weight.max() * place.strength(scene);
        if selection > 0.0 {
            self.by_vertex += selection;
            self.offer(Vertex::Border(place), weight, depth, selection);
        }
    }

    fn medium(&mut self, facts: &SweepFacts, medium: u32, [p, w]: [DVec3; 2], weight: Rgb, depth: u32, flight: Flight) {
        let facts = &facts.media[medium as usize];
        if !facts.source {
            return;
        }
        let k = facts.kappa;
        let (_, sigma_s) = facts.model.coefficients(p);
        let shared = Rgb::from_fn(|c| weight[c] * k / (sigma_s[c] + k));
        self.by_vertex += weight.max() * k;
        self.offer(Vertex::Medium { medium, p, w, flight }, weight, depth, shared.max() * k);
    }

    fn offer(&mut self, v: Vertex, weight: Rgb, depth: u32, selection: f64) {
        if selection.is_nan() || selection <= 0.0 {
            return;
        }
        self.total += selection;
        if self.rng.uniform() * self.total < selection {
            self.chosen = Some((v, weight, depth, selection));
        }
    }
}

/// Everything the derivative of one sample needs besides the scene.
pub struct Sweep<'a> {
    pub scene: &'a Scene,
    pub set: &'a Settings,
    pub params: &'a ParamSet,
    pub facts: Arc<SweepFacts>,
    /// Whose rays the paths start with.
    pub sensor: &'a Sensor,
}

impl Sweep<'_> {
    /// Walk one camera path with a record and hand all its partials to `sink`. Returns the same value, from the same
    /// random numbers, as [`super::sample`]. Where derivatives ask for directions beside critical angles the recorded path is another one.
    pub fn sample(
        &self,
        begin: &Beginning,
        mut derivative: Rng,
        rec: &mut PathRecord,
        sink: &mut impl Sink,
        tally: &mut Tally,
    ) -> Rgb {
        let beside = self.facts.moving.any() && !self.scene.critical.is_empty();
        rec.chunk_starts.clear();
        rec.of(&self.facts);
        let aside = begin.rng.beside(derivative.next_u64());
        let spans = derivative.next_u64();
        rec.scattered = Rgb::ZERO;
        rec.begin(true, &Opening::NEW);
        rec.candidates.renew(derivative);
        let first = || {
            let mut first = begin.state();
            (first.drawn, first.aside) = (beside.then_some(0), aside);
            first
        };
        // The line itself is another one around poles, and weighs points that are drawn on it against directions.
        let parts = begin.poles.is_none() && !self.scene.draws_on_spans();
        rec.parts = beside && parts;
        let mut w = Walker::new(self.scene, self.set, rec);
        w.trace(&mut first());
        let mut value = w.total();
        *tally = tally.plus(&w.tally);
        rec.parts = false;
        if beside && !parts {
            let plain = Beginning { poles: None, ..begin.clone() };
            value = super::sample(self.scene, self.set, &plain, &mut Tally::default());
        }
        let mut lottery = Lottery::new(spans, rec.scattered);
        rec.candidates.scan(&self.facts, self.scene, &rec.events);

        // Backward: the last chunk is at hand, earlier ones are walked again.
        let mut back = rec.back.take().unwrap_or_default();
        back.chain.clear();
        let starts = std::mem::take(&mut rec.chunk_starts);
        let open = |k: usize| k.checked_sub(1).map_or(&Opening::NEW, |k| &starts[k].1);
        let mut after = self.backward(rec, open(starts.len()), Rgb::ZERO, &mut back, &mut lottery, sink);
        for k in (0..starts.len()).rev() {
            rec.begin(false, open(k));
            let mut w = Walker::new(self.scene, self.set, rec);
            if k == 0 {
                w.trace(&mut first());
            } else {
                w.run(starts[k - 1].0.clone());
            }
            after = self.backward(rec, open(k), after, &mut back, &mut lottery, sink);
        }
        (rec.chunk_starts, rec.back) = (starts, Some(back));
        self.derivative_vertex(&rec.candidates, sink, tally);
        value
    }

    fn backward(
        &self,
        rec: &PathRecord,
        open: &Opening,
        mut after: Rgb,
        back: &mut Backward,
        lottery: &mut Lottery,
        sink: &mut impl Sink,
    ) -> Rgb {
        let Backward { starts, chain } = back;
        starts.find(self.scene, &self.facts.moving, rec, open, !after.is_zero() || chain.goes_on());
        for (k, e) in rec.events.iter().enumerate().rev() {
            if let Some(start) = starts.at(k) {
                let moving = &self.facts.moving;
                let (first, ray) = (start.first(), &start.ray);
                let (scene, sensor, steps) = (self.scene, self.sensor, &rec.steps);
                let mut cx = Chained { scene, sensor, moving, steps, ray, first, after: false, sink };
                start.event(&mut cx, chain, rec, k, after);
            }
            after = self.event(rec, e, after, lottery, sink);
        }
        after
    }

    /// What one event adds to the partials of values; returns what was collected from it on.
    fn event(&self, rec: &PathRecord, e: &Event, mut after: Rgb, lottery: &mut Lottery, sink: &mut impl Sink) -> Rgb {
        match e {
            Event::Chain => {
                lottery.begin();
                after = Rgb::ZERO;
            }
            Event::Candidate { .. } | Event::Specular(_) | Event::Share(_) => {}
            Event::Ends { span, start, end, depth } => self.glow_at_ends(span, [*start, *end], *depth, sink),
            Event::Drift { slot, v, value } => aim::vector(self.params, *slot, |k| *value * v[k], sink),
            Event::Aim { aim, value } => aim::partials(self.scene, self.params, aim, *value, sink),
            Event::WayAim { aim, value } => {
                let steps = &rec.steps[aim.steps[0] as usize..][..aim.steps[1] as usize];
                way_motion::partials(self.scene, self.params, (aim, steps), *value, sink);
            }
            Event::Span { span, prefix } => {
                if prefix.is_some_and(|p| p.depth > 0) {
                    lottery.scatter();
                }
                self.transmittance(span, after, lottery, sink);
                if let Some(p) = prefix.filter(|_| self.facts.borders.any()) {
                    let m = &self.scene.media[span.medium as usize];
                    let end = super::tracking::walked_weight(m, span, span.t1, p.beta, p.r);
                    self.glow_at_ends(span, [p.beta / p.r.mean(), end], p.depth, sink);
                }
            }
            Event::Facets { surface, normals, wi, wo, value } => {
                if let (true, Surface::Rough(rough)) =
                    (self.facts.rough[*surface as usize], &self.scene.surfaces[*surface as usize])
                {
                    let value = value.unwrap_or(after);
                    rough.scores(*normals, *wi, *wo, |slot, d| {
                        if self.params.is_active(slot) {
                            sink.add(slot, d * value);
                        }
                    });
                }
            }
            Event::Upright { surface, normals, wi, wo, lights, share } => {
                if let (true, Surface::Rough(rough)) =
                    (self.facts.rough[*surface as usize], &self.scene.surfaces[*surface as usize])
                {
                    let value = rec.far(*lights).iter().fold(Rgb::ZERO, |sum, l| sum + l.value) * *share;
                    for (slot, d) in rough.arc_scores(*normals, *wi, *wo) {
                        if self.params.is_active(slot) {
                            sink.add(slot, value * d);
                        }
                    }
                }
            }
            Event::Turn { medium, one_minus_mu } => self.phase(*medium, *one_minus_mu, after, sink),
            Event::Scatter { medium, p, .. } => {
                lottery.scatter();
                self.source_score(*medium, *p, after, sink);
            }
            Event::Surface { surface, .. } => {
                lottery.scatter();
                self.reflectance_score(*surface, after, sink);
            }
            Event::Emit { weight, emission, .. } => {
                self.emission(*weight, emission, sink);
                after += *weight * emission.color();
            }
            Event::Glow { weight, radiance, via, first_span, spans, phase } => {
                lottery.scatter();
                let (l, via) = (*weight * *radiance, &rec.drawn[*via as usize]);
                let value = l * via.sigma;
                for span in &rec.side[*first_span as usize..(*first_span + *spans) as usize] {
                    self.transmittance(span, value, lottery, sink);
                }
                if let Some((medium, m)) = phase {
                    self.phase(*medium, *m, value, sink);
                }
                // The weight does not know sigma_a and L_e: nothing to divide by.
                let (m, facts) = (&self.scene.media[via.medium as usize], &self.facts.media[via.medium as usize]);
                if let Some(e) = m.emission.as_ref().filter(|_| facts.glow) {
                    e.partials(self.params, via.p, *weight * via.sigma, sink);
                }
                if facts.source {
                    m.sigma_a_partials(self.params, via.p, |slot, d| sink.add(slot, d * l));
                }
                after += value;
            }
            Event::Connect { weight, emission, first_span, spans, phase, via, .. } => {
                lottery.scatter();
                let via = via.map(|k| &rec.drawn[k as usize]);
                let sigma_s = via.map_or(Rgb::ONE, |d| d.sigma);
                self.emission(*weight * sigma_s, emission, sink);
                let value = *weight * sigma_s * emission.color();
                for span in &rec.side[*first_span as usize..(*first_span + *spans) as usize] {
                    self.transmittance(span, value, lottery, sink);
                }
                for (medium, m) in phase.iter().flatten() {
                    self.phase(*medium, *m, value, sink);
                }
                if let Some(via) = via {
                    // Drawn without regard to sigma_s: its derivative needs neither a division nor a share.
                    let m = &self.scene.media[via.medium as usize];
                    let l = *weight * emission.color();
                    m.sigma_s_partials(self.params, via.p, |slot, d| sink.add(slot, d * l));
                }
                after += value;
            }
        }
        after
    }

    /// What a medium emits where its borders move.
    fn glow_at_ends(&self, span: &MediumSpan, weights: [Rgb; 2], order: u32, sink: &mut impl Sink) {
        if order < self.set.min_order || self.set.max_depth == 0 {
            return;
        }
        for (place, weight) in self.facts.borders.ends(self.scene, span).into_iter().zip(weights) {
            let glow = |p: &Place| self.scene.media[p.medium as usize].glow(p.p);
            if let Some((place, (sigma_a, color))) = place.and_then(|p| Some((p, glow(&p)?))) {
                place.score(self.scene, weight * sigma_a * color, sink);
            }
        }
    }

    /// `T' = -Sigma_t T` [T] (11), (52b); where an end moves, -ṫ σ_t T more ([`super::border`]).
    fn transmittance(&self, span: &MediumSpan, after: Rgb, lottery: &mut Lottery, sink: &mut impl Sink) {
        for place in self.facts.borders.ends(self.scene, span).into_iter().flatten() {
            let sigma_t = self.scene.media[span.medium as usize].coefficients(place.p).0;
            place.score(self.scene, -(sigma_t * after), sink);
        }
        if after.is_zero() {
            return;
        }
        let m = &self.scene.media[span.medium as usize];
        let (drawn, points) = match m.density_grid() {
            None => (Some(after), None),
            Some(_) => (lottery.draw(after), lottery.points(self.set.max_depth > 1 && !m.sigma_s.is_zero())),
        };
        let Some(after) = drawn.filter(|_| self.facts.media[span.medium as usize].extinction) else { return };
        m.depth_partials(self.params, (span.o, span.w), (span.t0, span.t1), points, |slot, d| {
            sink.add(slot, -(d * after))
        });
    }

    /// `(df_p/dg) / f_p` [T] (56).
    fn phase(&self, medium: u32, one_minus_mu: f64, after: Rgb, sink: &mut impl Sink) {
        if !self.facts.media[medium as usize].g || after.is_zero() {
            return;
        }
        let m = &self.scene.media[medium as usize];
        let (f, dg) = m.phase.eval_with_dg(one_minus_mu);
        sink.add(m.slots.g, after * (dg / f));
    }

    /// The collision's share of the source derivative.
    fn source_score(&self, medium: u32, p: DVec3, after: Rgb, sink: &mut impl Sink) {
        if !self.facts.media[medium as usize].source || after.is_zero() {
            return;
        }
        let m = &self.scene.media[medium as usize];
        let (_, sigma_s) = m.coefficients(p);
        let score = Rgb::from_fn(|c| after[c] / (sigma_s[c] + m.kappa));
        m.sigma_s_partials(self.params, p, |slot, d| sink.add(slot, d * score));
    }

    fn reflectance_score(&self, surface: u32, after: Rgb, sink: &mut impl Sink) {
        if !self.facts.surfaces[surface as usize] {
            return;
        }
        if let Surface::Diffuse { reflectance, slot, .. } = &self.scene.surfaces[surface as usize] {
            for c in 0..3 {
                sink.add(slot + c as Slot, Rgb::channel(c, after[c] / (reflectance[c] + KAPPA_RHO)));
            }
        }
    }

    /// `d(weight x slot x unit)/d slot`: no division by the emission.
    fn emission(&self, weight: Rgb, e: &Emission, sink: &mut impl Sink) {
        if e.first == NO_SLOT {
            return;
        }
        let d = weight * e.unit;
        if e.per_channel {
            for c in 0..3 {
                if self.params.is_active(e.first + c as Slot) {
                    sink.add(e.first + c as Slot, Rgb::channel(c, d[c]));
                }
            }
        } else if self.params.is_active(e.first) {
            sink.add(e.first, d);
        }
    }

    /// The vertex's share of the source derivative: one forced continuation [T] (65).
    fn derivative_vertex(&self, c: &Candidates, sink: &mut impl Sink, tally: &mut Tally) {
        tally.unbounded_vacuum += c.unbounded;
        let Candidates { mut rng, total, by_vertex, by_score, .. } = *c;
        let Some((vertex, weight, depth, selection)) = c.chosen else { return };
        // Continue in proportion to the share that this estimator carries; never less than one path in a thousand.
        // Scores of collisions and transmittances mostly cancel: their sum's square is as their number.
        let q = (CONTINUED * by_vertex / (by_vertex + by_score.sqrt())).clamp(1e-3, 1.0);
        if rng.uniform() >= q {
            return;
        }
        let weight = weight * (total / (selection * q));
        let mut s = State::new(rng, DVec3::ZERO, DVec3::Z, None);
        s.depth = depth;
        let mut rec = NoRecord;
        let mut w = Walker::new(self.scene, self.set, &mut rec);
        match vertex {
            Vertex::Medium { medium, p, w: direction, flight } => {
                // Directions as the connections know them that it shares the point with.
                let drawn = flight.drawn;
                s = State { stage: Stage::Medium, flight, drawn, o: p, w: direction, medium: Some(medium), ..s };
                w.run(s);
                let value = w.total();
                let m = &self.scene.media[medium as usize];
                let (_, sigma_s) = m.coefficients(p);
                let l = Rgb::from_fn(|c| value[c] * weight[c] * m.kappa / (sigma_s[c] + m.kappa));
                m.sigma_s_partials(self.params, p, |slot, d| sink.add(slot, d * l));
            }
            Vertex::Border(place) => {
                let medium = Some(place.medium);
                s = State { stage: Stage::Medium, o: place.inside(self.scene), w: place.w, medium, ..s };
                w.run(s);
                let sigma_s = self.scene.media[place.medium as usize].coefficients(place.p).1;
                place.score(self.scene, w.total() * weight * sigma_s, sink);
            }
            Vertex::Surface { surface, hit, wi, medium } => {
                s = State { o: hit.p, w: -wi, on: On::at(&hit), medium, unit_reflectance: true, ..s };
                s.stage = Stage::Reflect(hit);
                w.run(s);
                let value = w.total();
                if let Surface::Diffuse { reflectance, slot, .. } = &self.scene.surfaces[surface as usize] {
                    for c in 0..3 {
                        let l = value[c] * weight[c] * KAPPA_RHO / (reflectance[c] + KAPPA_RHO);
                        sink.add(slot + c as Slot, Rgb::channel(c, l));
                    }
                }
            }
        }
        *tally = tally.plus(&w.tally);
    }
}
