//! The walk: one path from a camera or a derivative vertex, and everything it collects. Knows no derivatives; it writes a
//! record when asked to, and its samples are the same either way.
//!
//! Estimates `L(x, w)` of [T] (1)-(5): free flight by exponential steps (homogeneous) or delta tracking over brick majorants
//! (grids) [T] 8.1; next-event estimation at every vertex; an extra equi-angular connection a medium span for
//! lights with a position. Chromatic media by [T] (55): `beta = f/p` and `r_c = p_c/p` for the three channels, with `p` the
//! density of the channel actually drawn; what is scored is `beta / mean(r)`.
//! Techniques for one light path (direction or light sampling, free flight or equi-angular) are weighted by functions of
//! the geometry alone, so the weights sum to one whatever the tracking inside them did.

use super::mirror;
use super::record::{End, Event, MediumSpan, NoRecord, Prefix, Recorder};
use super::state::{Flight, Stage, State};
use super::tracking;
use super::twin::{self, Twin};
use super::vertex::{Facing, Vertex};
use super::{
    ball, beam, beam_centred, beside, camera_line, chain, connect, glow, lamp, light_centred, manifold, pane, specular,
};
use crate::math::{DVec3, Rgb};
use crate::medium::Medium;
use crate::phase::one_minus_cos;
use crate::scene::critical::Critical;
use crate::scene::{Hit, On, Scene, Settings};
use crate::surface::{Lobe, Surface};

/// Relative weight below which roulette begins: analog absorption from the first collision on would cost variance, none at all time.
pub(super) const ROULETTE: f64 = 0.2;

/// What a walk met besides light.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tally {
    pub capped: u64,
    pub truncated: f64,
    pub light_on_ray: u64,
    pub missed_boundary: u64,
    /// Derivatives asked of a vacuum without end: no candidate could be drawn there.
    pub unbounded_vacuum: u64,
    /// Weights that are not numbers: what they would have given is left out.
    pub nonfinite: u64,
    /// Searches for ways of light that did not settle.
    pub unsettled: u64,
}

impl Tally {
    #[must_use]
    pub fn plus(&self, o: &Tally) -> Tally {
        Tally {
            capped: self.capped + o.capped,
            truncated: self.truncated + o.truncated,
            light_on_ray: self.light_on_ray + o.light_on_ray,
            missed_boundary: self.missed_boundary + o.missed_boundary,
            unbounded_vacuum: self.unbounded_vacuum + o.unbounded_vacuum,
            nonfinite: self.nonfinite + o.nonfinite,
            unsettled: self.unsettled + o.unsettled,
        }
    }
}

/// A chain that parted, as it was, with what those before it and itself had come to.
pub type Parted = (State, [Rgb; 2]);

/// The total of one and of all that wait behind it.
fn go_on(scene: &Scene, set: &Settings, mut parted: Box<Parted>) -> Rgb {
    let (state, [done, value]) = &mut *parted;
    let mut rec = NoRecord;
    let mut w = Walker { value: *value, done: *done, ..Walker::new(scene, set, &mut rec) };
    w.go_on(state);
    w.total()
}

pub struct Walker<'a, R: Recorder> {
    pub scene: &'a Scene,
    pub set: &'a Settings,
    pub rec: &'a mut R,
    /// What the chain at hand has come to.
    pub value: Rgb,
    /// What the chains before it have.
    done: Rgb,
    /// The value before a mirrored path.
    kept: Rgb,
    pub tally: Tally,
}

impl<'a, R: Recorder> Walker<'a, R> {
    pub fn new(scene: &'a Scene, set: &'a Settings, rec: &'a mut R) -> Self {
        Walker { scene, set, rec, value: Rgb::ZERO, done: Rgb::ZERO, kept: Rgb::ZERO, tally: Tally::default() }
    }

    /// A camera path from its beginning.
    pub fn trace(&mut self, s: &mut State) {
        camera_line::start(self, s);
        self.go_on(s);
    }

    /// Walk to the end, or to the end of one chunk when the recorder says so.
    pub fn run(&mut self, mut s: State) {
        self.go_on(&mut s);
    }

    fn go_on(&mut self, s: &mut State) {
        loop {
            if self.rec.checkpoint(self.scene, s) || self.rec.is_over(s) {
                return;
            }
            s.steps += 1;
            if s.steps > self.set.cap {
                self.tally.capped += 1;
                self.tally.truncated += (s.beta / s.r.mean()).max();
                s.stage = Stage::Done;
            }
            if R::ON && s.drawn.is_some() && s.looks_beside(self.scene) {
                self.part(s);
            }
            match s.stage {
                Stage::Fly => self.fly(s),
                Stage::Line => camera_line::start(self, s),
                Stage::Medium => self.scatter(s),
                Stage::Surface(hit) => self.surface(s, hit),
                Stage::Reflect(hit) => self.reflect(s, hit),
                Stage::Escape => {
                    self.escape(s);
                    s.stage = Stage::Done;
                }
                Stage::Done => {
                    let mut aside = s.aside;
                    if let Some(kept) = s.mirrored.take() {
                        (aside, self.value) = (*kept, self.kept);
                    }
                    let Some(next) = s.pending.take() else { return self.close(s.astray) };
                    let astray = s.astray;
                    *s = *next;
                    if let Some(kept) = &mut s.mirrored {
                        (**kept, self.kept) = (aside, self.value * 2.0);
                    } else {
                        self.close(astray);
                        s.aside = aside;
                    }
                    camera_line::chain(self, s);
                }
            }
        }
    }

    /// What all chains have come to; where the record keeps those of the picture that part, the picture's value.
    pub fn total(&self) -> Rgb {
        self.done + self.value
    }

    /// The picture's own chain parts from the record's at this stage, which it takes again.
    pub(super) fn part(&mut self, s: &mut State) {
        if !s.astray {
            s.astray = self.rec.parts(s, [self.done, self.value]);
        }
    }

    /// The chain is over.
    fn close(&mut self, astray: bool) {
        self.done = match self.rec.parted() {
            Some(parted) => go_on(self.scene, self.set, parted),
            // Of what went astray before it branched off the picture knows nothing.
            None if astray => self.done,
            None => self.total(),
        };
        self.value = Rgb::ZERO;
    }

    /// From `o` along `w` to a collision, a surface, or out of the scene.
    pub(super) fn fly(&mut self, s: &mut State) {
        let scene = self.scene;
        // What is flown is not in the lead of a camera line.
        s.direct = false;
        if self.is_lost(s.depth, s.medium) {
            s.stage = Stage::Done;
            return;
        }
        let Some(id) = s.medium else {
            let hit = scene.intersect(s.o, s.w, f64::INFINITY, &s.on, s.medium);
            return self.arrive(s, hit);
        };
        let medium = &scene.media[id as usize];
        if medium.is_homogeneous() && medium.emission.is_none() && !self.may_scatter(s.depth + 1) {
            return self.pass_by(s, id);
        }
        let connects = R::CONNECTS && scene.draws_on_spans() && self.may_scatter(s.depth + 1);
        if !medium.is_homogeneous() || connects || s.in_a_row > 0 {
            // The whole span is needed: for the grid's traversal, for the equi-angular connection, or for how points behind an interface move.
            let hit = scene.intersect(s.o, s.w, f64::INFINITY, &s.on, s.medium);
            let t1 = hit.as_ref().map_or(f64::INFINITY, |h| h.t);
            let span = MediumSpan::new(id, s.o, s.w, t1, &s.on, hit.as_ref());
            if connects {
                let prefix = s.beta / s.r.mean();
                let (first, depth, reach) = (self.rec.side_len(), s.depth, s.reach());
                let density = |_: &Scene, t: f64| tracking::flight_density(medium, &span, t);
                if scene.has_local_lights() {
                    connect::equiangular(self, s, span, prefix, depth, first, density, reach);
                }
                beam::on_span(self, s, &span, prefix, None, density, reach);
            }
            let (beta, r) = (s.beta, s.r);
            match tracking::fly(medium, &span, s) {
                Some(t) => {
                    let weighs = scene.weighs_flights();
                    let density = if weighs { tracking::flight_density(medium, &span, t) } else { 0.0 };
                    s.flight = Flight { span: Some(span), density, reach: s.reach(), drawn: s.drawn };
                    self.walked(s, span, t, true, beta, r);
                    self.collide(s, t);
                }
                None => {
                    self.walked(s, span, t1, false, beta, r);
                    self.arrive(s, hit);
                }
            }
        } else {
            // Homogeneous: draw the distance first and look no further than that.
            let (beta, r) = (s.beta, s.r);
            let t = tracking::distance(medium, s);
            let hit = scene.intersect(s.o, s.w, t, &s.on, s.medium);
            let t1 = hit.as_ref().map_or(t, |h| h.t);
            let span = MediumSpan::new(id, s.o, s.w, t1, &s.on, hit.as_ref());
            if hit.is_none() && t < f64::INFINITY {
                tracking::weight_collision(medium, t, s);
                s.flight = Flight::default();
                self.walked(s, span, t, true, beta, r);
                self.collide(s, t);
            } else {
                tracking::weight_passage(medium, t1, s);
                self.walked(s, span, t1, false, beta, r);
                self.arrive(s, hit);
            }
        }
    }

    /// No collision would be seen any more: all that passes, in one weight. No point of the span is a candidate for a derivative vertex either.
    fn pass_by(&mut self, s: &mut State, id: u32) {
        let hit = self.scene.intersect(s.o, s.w, f64::INFINITY, &s.on, s.medium);
        let t1 = hit.as_ref().map_or(f64::INFINITY, |h| h.t);
        let span = MediumSpan::new(id, s.o, s.w, t1, &s.on, hit.as_ref());
        let depth = tracking::depth(&self.scene.media[id as usize], &span);
        s.beta *= depth.map(|t| (-t).exp());
        s.tau += depth;
        if R::ON {
            self.rec.push(Event::Span { span, prefix: None });
        }
        if s.beta.is_zero() {
            s.stage = Stage::Done;
        } else {
            self.arrive(s, hit);
        }
    }

    fn walked(&mut self, s: &mut State, span: MediumSpan, t: f64, collides: bool, beta: Rgb, r: Rgb) {
        let medium = &self.scene.media[span.medium as usize];
        if medium.emission.is_some() && t > 0.0 {
            glow::walked(self, s, &span, t, collides, beta, r);
        }
        if medium.is_homogeneous() && t < f64::INFINITY {
            s.tau += medium.sigma_t * t;
        }
        if R::ON {
            let t_end = span.t1;
            let span = span.until(t);
            let prefix = Prefix { beta, r, depth: s.depth, t_end, reach: s.reach(), drawn: s.drawn };
            self.rec.push(Event::Span { span, prefix: Some(prefix) });
        }
    }

    fn collide(&mut self, s: &mut State, t: f64) {
        s.o += s.w * t;
        s.on = On::default();
        s.stage = Stage::Medium;
    }

    /// At the end of a flight: a surface, or the environment.
    fn arrive(&mut self, s: &mut State, hit: Option<Hit>) {
        s.stage = hit.map_or(Stage::Escape, Stage::Surface);
    }

    fn escape(&mut self, s: &mut State) {
        let Some(id) = self.scene.environment else { return };
        if s.depth == 0 && self.set.hide_emitters {
            return;
        }
        let light = &self.scene.lights[id as usize];
        let weighs = s.pdf_direction > 0.0 && s.to_environment > 0.0;
        let Some((emission, pdf)) = light.escape(s.w, weighs) else { return };
        let p = s.to_environment * pdf;
        self.emit(s, emission, (1.0, p), End::Infinity(s.w));
    }

    /// Score this share of emission met by the walk, weighted against a connection of density `p_light` (per solid angle).
    fn emit(&mut self, s: &State, emission: crate::light::Emission, (share, p_light): (f64, f64), end: End) {
        if s.depth < self.set.min_order {
            return;
        }
        let mut weight = s.beta / s.r.mean();
        if s.pdf_direction > 0.0 && p_light > 0.0 {
            weight *= connect::direction_share(s.pdf_direction, s.tau, p_light);
        }
        self.value += weight * share * emission.color();
        // Where vertices move, derivatives take all of it.
        let weight = if self.rec.is_still() { weight * share } else { weight };
        self.rec.score(s.depth, weight * emission.color());
        if R::ON {
            self.rec.push(Event::Emit { weight, emission, end });
        }
    }

    /// Whether it is connected to lamps by way of faces and balls: not where derivatives look beside critical angles, on paths of their own.
    pub fn seeks_lamps(&self, s: &State) -> bool {
        R::CONNECTS && s.drawn.is_none() && !self.scene.lamps.is_empty()
    }

    /// Whether the `k`-th scattering is within `max_depth`.
    pub fn may_scatter(&self, k: u32) -> bool {
        k < self.set.max_depth
    }

    /// Whether a ray that has been turned this often, in this medium, is known to bring nothing: it would have to be turned once more.
    pub fn is_lost(&self, depth: u32, medium: Option<u32>) -> bool {
        !self.may_scatter(depth + 1) && self.scene.is_dark(medium)
    }

    /// A collision at `s.o`.
    fn scatter(&mut self, s: &mut State) {
        let id = s.medium.unwrap_or_default();
        let k = s.depth + 1;
        if !self.may_scatter(k) {
            s.stage = Stage::Done;
            return;
        }
        s.depth = k;
        s.direct = false;
        s.in_a_row = 0;
        s.vertex = s.o;
        s.passage = None;
        s.tau = Rgb::ZERO;
        if R::ON {
            self.rec.push(Event::Scatter { medium: id, p: s.o, w: s.w, span: s.flight.span });
        }
        if R::CONNECTS {
            connect::from_medium(self, s, id);
            beam::connect(self, s, &Vertex::Medium(id));
            pane::connect(self, s, &Vertex::Medium(id));
            chain::connect(self, s, &Vertex::Medium(id));
            ball::connect(self, s, &Vertex::Medium(id));
            manifold::connect(self, s, &Vertex::Medium(id));
            lamp::connect(self, s, &Vertex::Medium(id));
            glow::connect(self, s, &Vertex::Medium(id));
        }
        s.left |= beside::entered(self, s.flight.reach.map(|r| r.0), s.o);
        self.turn(s, id);
    }

    /// Everything at a collision but its own connection to a light.
    pub(super) fn turn(&mut self, s: &mut State, id: u32) {
        let medium: &Medium = &self.scene.media[id as usize];
        let vertex = Vertex::Medium(id);
        let twin = Twin::new(self, s);
        if R::CONNECTS {
            light_centred::connect(self, s, &vertex, twin.as_ref());
            beam_centred::connect(self, s, &vertex);
        }
        R::at_vertex(self, s, &vertex);
        beside::score(self, s, &vertex, twin.as_ref());
        let (u, v) = (s.rng.uniform(), s.rng.uniform());
        let critical = &self.scene.critical;
        let (w, m) = match critical.sample(s.o, s.drawn, &mut s.rng) {
            Some(w) => (w, one_minus_cos(s.w, w)),
            None => medium.phase.sample(s.w, u, v),
        };
        let f = medium.phase.eval(m);
        if let Some(axis) = mirror::in_medium(self, s, id).filter(|_| twin.is_none()) {
            let to = mirror::turned(axis, w);
            let one_minus_mu = one_minus_cos(s.w, to);
            let other = medium.phase.eval(one_minus_mu);
            if s.aside.uniform() * f < other {
                let turn = Event::Turn { medium: id, one_minus_mu };
                mirror::split(self, s, Some(turn), |s| (s.w, s.on, s.pdf_direction) = (to, On::default(), other));
            }
        }
        if R::ON {
            self.rec.push(Event::Turn { medium: id, one_minus_mu: m });
        }
        s.pdf_direction = critical.density(s.o, s.drawn, w, f);
        s.twin = twin.map(|t| (t.light, twin::fly(self, s, &vertex, &t, (w, s.pdf_direction), s.rng)));
        // Weights that cones bring about: roulette must not take away the directions that were wanted.
        if s.pdf_direction != f {
            s.beta *= f / s.pdf_direction;
            s.start *= Critical::hidden(f, s.pdf_direction);
        }
        s.drawn = s.drawn.map(|k| k + 1);
        s.w = w;
        s.on = On::default();
        s.stage = Stage::Fly;
        self.roulette(s);
    }

    /// A surface at `hit`: its emission, then passage or reflection.
    pub(super) fn surface(&mut self, s: &mut State, hit: Hit) {
        let scene = self.scene;
        let shape = &scene.shapes[hit.shape as usize];
        if let Some(light) = shape.light {
            let front = hit.n.dot(s.w) < 0.0;
            if front && !(s.depth == 0 && self.set.hide_emitters) {
                let l = &scene.lights[light as usize];
                let ratio = connect::flight_ratio(scene, light, &s.flight, s.vertex);
                let p = scene.selection(light) * scene.area_pdf(light, s.vertex, s.w, &hit) * ratio;
                let end = End::Shape { shape: hit.shape, face: hit.face, p: hit.p, n: hit.n };
                let passed = s.passage.as_ref();
                let share = passed.map_or(1.0, |q| q.share(scene, light, &hit, s.w));
                self.emit(s, l.emission(Rgb::ONE), (share, p), end);
            }
        }
        if scene.passes(&hit) {
            s.pass(scene, &hit);
            s.stage = Stage::Fly;
        } else {
            self.reflect(s, hit);
        }
    }

    /// Reflection at `hit`, with a connection to a light.
    fn reflect(&mut self, s: &mut State, hit: Hit) {
        let scene = self.scene;
        let shape = &self.scene.shapes[hit.shape as usize];
        let surface = &self.scene.surfaces[shape.surface as usize];
        if surface.is_smooth() {
            specular::scatter(self, s, &hit);
            return;
        }
        let k = s.depth + 1;
        let wi = -s.w;
        if !self.may_scatter(k) || !surface.reflects(hit.ns, wi) {
            s.stage = Stage::Done;
            return;
        }
        let (facing, near) = Facing::new(self.scene, s, &hit);
        s.depth = k;
        s.direct = false;
        s.in_a_row = 0;
        s.o = hit.p;
        s.vertex = hit.p;
        s.passage = None;
        s.tau = Rgb::ZERO;
        s.on = near;
        s.flight = Flight::default();
        if R::ON {
            let prefix = Prefix { beta: s.beta, r: s.r, depth: k - 1, t_end: 0.0, reach: None, drawn: None };
            self.rec.push(Event::Surface { surface: shape.surface, hit, wi, medium: s.medium, prefix });
        }
        match surface {
            Surface::Diffuse { reflectance, .. } if !s.unit_reflectance => s.beta *= *reflectance,
            _ => s.unit_reflectance = false,
        }
        if s.beta.is_zero() {
            s.stage = Stage::Done;
            return;
        }
        let vertex = Vertex::Surface(facing);
        let twin = Twin::new(self, s);
        if R::CONNECTS {
            connect::from_surface(self, s, &facing);
            beam::connect(self, s, &vertex);
            pane::connect(self, s, &vertex);
            chain::connect(self, s, &vertex);
            ball::connect(self, s, &vertex);
            manifold::connect(self, s, &vertex);
            lamp::connect(self, s, &vertex);
            light_centred::connect(self, s, &vertex, twin.as_ref());
            beam_centred::connect(self, s, &vertex);
            glow::connect(self, s, &vertex);
        }
        R::at_vertex(self, s, &vertex);
        beside::score(self, s, &vertex, twin.as_ref());
        let (u, v) = (s.rng.uniform(), s.rng.uniform());
        let uniform = self.scene.uniform_share;
        let critical = &self.scene.critical;
        let w = match (critical.sample(s.o, s.drawn, &mut s.rng), surface) {
            (Some(w), _) => Some(w),
            (None, Surface::Rough(r)) => r.sample(facing.normals, wi, u, v, s.rng.uniform()),
            (None, _) => Some(surface.sample(hit.ns, wi, uniform, u, v)),
        };
        let lobe = w.map_or(Lobe::NONE, |w| facing.lobe(self.scene, w));
        s.pdf_direction = lobe.pdf;
        let w = w.filter(|_| lobe.pdf > 0.0);
        // A direction that brings nothing itself may have a twin that does.
        let twin = w.zip(twin).map(|(w, t)| (t.light, twin::fly(self, s, &vertex, &t, (w, lobe.pdf), s.rng)));
        let Some(w) = w.filter(|_| lobe.f > 0.0) else {
            s.stage = Stage::Done;
            return;
        };
        s.twin = twin;
        s.drawn = s.drawn.map(|k| k + 1);
        let weighed = uniform > 0.0 || self.scene.least_through > 0.0 || matches!(surface, Surface::Rough(_));
        let leave = |s: &mut State, w: DVec3, lobe: Lobe| {
            if weighed {
                s.beta *= lobe.tint * (lobe.f / lobe.pdf);
                s.start *= facing.hidden(scene, w, lobe.pdf);
            }
            s.pdf_direction = lobe.pdf;
            facing.leave(s, w);
            s.w = w;
        };
        if let Some(axis) = mirror::at_surface(self, s, &hit, surface).filter(|_| twin.is_none()) {
            let to = mirror::turned(axis, w);
            let other = facing.lobe(scene, to);
            if other.f > 0.0 && s.aside.uniform() * lobe.pdf < other.pdf {
                mirror::split(self, s, None, |s| leave(s, to, other));
            }
        }
        if R::ON {
            facing.event(w, None).into_iter().for_each(|e| self.rec.push(e));
        }
        leave(s, w, lobe);
        s.stage = Stage::Fly;
        self.roulette(s);
    }

    /// Survival `min(1, weight / THRESHOLD)` of the weight relative to the chain's start: no path above the threshold is ever
    /// killed, no survivor weighs more than it did (STABILITY rule 6).
    fn roulette(&mut self, s: &mut State) {
        if s.beta.is_zero() {
            s.stage = Stage::Done;
            return;
        }
        if s.depth < self.set.rr_depth {
            return;
        }
        let q = (s.beta / s.r.mean()).max() / (ROULETTE * s.start);
        if q < 1.0 {
            if s.rng.uniform() >= q {
                s.stage = Stage::Done;
            } else {
                s.beta *= 1.0 / q;
            }
        }
    }
}
