//! What the events of a record mean for the motion of its chains ([`super::motion`]).

use super::first::{FilmLine, First, Later, Nth, Opening, Seen};
use super::motion::{Chain, Chained, Moving};
use super::ray::{MovingRay, Turned};
use super::record::{End, Event, PathRecord};
use crate::math::Rgb;
use crate::params::Sink;
use crate::scene::{Scene, effort};
use crate::surface::Surface;

/// A leg of a chain: its ray, and its first vertex.
#[derive(Default)]
pub struct Start {
    /// Index of the event that it begins with.
    begin: usize,
    place: At,
    second: At,
    pub ray: MovingRay,
    /// One that does not move where it has none.
    first: First,
    /// That may have left out what it carries, for which nothing behind it asks.
    bare: bool,
    /// How the interface that it begins behind turned the ray before.
    turned: Option<Box<Turned>>,
    /// Where one did, whether that comes straight from the camera or from another interface.
    straight: bool,
}

/// Whether a leg whose first vertex comes before these events has none that is near it: the next interface, if any, ends it, or light from infinity does.
fn is_left_alone(events: &[Event]) -> bool {
    for e in events {
        match e {
            Event::Chain | Event::Specular(_) => return true,
            Event::Turn { .. } | Event::Span { .. } | Event::Facets { .. } | Event::Share(_) => {}
            Event::Emit { end: End::Infinity(_), .. } => {}
            _ => return false,
        }
    }
    // It may go on in the next chunk.
    false
}

/// Where the event of a vertex is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum At {
    /// In an earlier chunk.
    Before,
    Event(usize),
    /// The chain has none.
    #[default]
    Nowhere,
}

/// The legs in some events.
#[derive(Default)]
pub struct Starts {
    /// The first `open` of them; what is behind is left over from other paths, whose memory these use.
    list: Vec<Start>,
    open: usize,
    /// Of each event, whether its chain adds anything at it or behind it.
    counts: Vec<bool>,
}

/// What paths one after the other go backward with.
#[derive(Default)]
pub struct Backward {
    pub starts: Starts,
    pub chain: Chain,
}

impl Starts {
    fn legs(&self) -> &[Start] {
        &self.list[..self.open]
    }

    /// One more leg, without a vertex yet, that begins with event `k`.
    fn begin(&mut self, k: usize) -> &mut Start {
        if self.open == self.list.len() {
            self.list.push(Start::default());
        }
        self.open += 1;
        let leg = &mut self.list[self.open - 1];
        leg.begin_with(k);
        leg
    }

    /// The leg at hand.
    fn last(&mut self) -> Option<&mut Start> {
        self.list[..self.open].last_mut()
    }

    /// Legs of all events. `open`: how the leg that the record's events begin in has begun. Empty where nothing moves.
    pub fn find_all(&mut self, scene: &Scene, moving: &Moving, rec: &PathRecord, open: &Opening) {
        self.counts.clear();
        self.counts.resize(rec.events.len(), true);
        self.list(scene, moving, rec, open, true);
    }

    /// Those that something was collected behind, of events that count. `goes_on`: something was collected behind the last event.
    pub fn find(&mut self, scene: &Scene, moving: &Moving, rec: &PathRecord, open: &Opening, goes_on: bool) {
        let mut counts = goes_on;
        self.counts.clear();
        self.counts.resize(rec.events.len(), false);
        for (e, own) in rec.events.iter().zip(&mut self.counts).rev() {
            counts |= e.adds();
            let begins = matches!(e, Event::Chain);
            // What the chain has collected ends with it.
            *own = counts || begins;
            counts &= !begins;
        }
        self.list(scene, moving, rec, open, false);
    }

    /// `whole`: with all that first vertices carry.
    fn list(&mut self, scene: &Scene, moving: &Moving, rec: &PathRecord, open: &Opening, whole: bool) {
        self.open = 0;
        if !moving.any() {
            return;
        }
        fn line<'a>(scene: &'a Scene, moving: &'a Moving, ray: &'a MovingRay) -> FilmLine<'a> {
            FilmLine { scene, moving, ray }
        }
        let mut ray = moving.film_ray().clone();
        for leg in &rec.legs[open.legs[0] as usize..open.legs[1] as usize] {
            let came = line(scene, moving, &ray).coming(
                &line(scene, moving, &ray).opening(&leg.before),
                &leg.before,
                &leg.end,
            );
            ray = line(scene, moving, &came).behind(&leg.end);
        }
        let mut opening = *open;
        let place = |known: bool| if known { At::Before } else { At::Nowhere };
        let leg = self.begin(0);
        if open.first.is_some() {
            leg.first = line(scene, moving, &ray).opening(open);
        }
        (leg.place, leg.second, leg.ray) = (place(open.first.is_some()), place(open.second.is_some()), ray);
        for (k, e) in rec.events.iter().enumerate() {
            // Of what comes behind nobody asks.
            if !self.counts[k] {
                continue;
            }
            let begun = [opening.first.is_some(), opening.second.is_some()];
            if let (Event::Specular(end), Some(last)) = (e, self.legs().last()) {
                let came = line(scene, moving, &last.ray).coming(last.first(), &opening, end);
                let (ray, turned) = line(scene, moving, &came).turned(end);
                let straight = matches!(last.place, At::Nowhere);
                let leg = self.begin(k);
                (leg.ray, leg.turned, leg.straight) = (ray, Some(turned), straight);
            }
            opening.follow(e);
            if matches!(e, Event::Chain) {
                self.begin(k).ray = moving.film_ray().clone();
            }
            if let (false, Some(s)) = (begun[0], &opening.first) {
                let bare = !whole && matches!(s, Seen::Medium { .. }) && is_left_alone(&rec.events[k + 1..]);
                let later = if bare { Later::Nothing } else { Later::Path };
                let known = self.legs().iter().find(|l| (bare || !l.bare) && l.begins_with(rec, s));
                let known = known.map(|l| l.first().alone());
                let Some(last) = self.last() else { continue };
                let first = known.unwrap_or_else(|| line(scene, moving, &last.ray).first_for(s, later));
                (last.first, last.bare, last.place) = (first, bare, At::Event(k));
                continue;
            }
            if let (false, Some(z)) = (begun[1], &opening.second) {
                let Some(last) = self.last() else { continue };
                last.second = At::Event(k);
                let first = std::mem::take(&mut last.first);
                last.first = line(scene, moving, &last.ray).then(first, z);
            }
        }
    }

    /// The leg that event `k` belongs to, and which of its vertices comes next there.
    pub fn next_at(&self, k: usize) -> Option<(&Start, Nth)> {
        let start = self.legs().iter().rev().find(|s| s.begin <= k)?;
        let passed = |at: At| match at {
            At::Before => true,
            At::Event(e) => e < k,
            At::Nowhere => false,
        };
        Some(match (passed(start.place), passed(start.second)) {
            (false, _) => (start, Nth::First),
            (true, false) => (start, Nth::Second),
            (true, true) => (start, Nth::Later),
        })
    }

    /// The leg of the vertex whose event is `v`, and which of its vertices comes behind that one.
    pub fn next_past(&self, v: usize) -> Option<(&Start, Nth)> {
        let start = self.legs().iter().rev().find(|s| s.begin <= v)?;
        Some(match (start.place, start.second) {
            (_, At::Before) => (start, Nth::Later),
            (_, At::Event(e)) if e <= v => (start, Nth::Later),
            (At::Nowhere, _) => (start, Nth::First),
            (At::Event(e), _) if e > v => (start, Nth::First),
            _ => (start, Nth::Second),
        })
    }

    /// The leg that event `k` belongs to, if the event counts; `k` must not grow from call to call.
    pub fn at(&mut self, k: usize) -> Option<&Start> {
        if !self.counts[k] {
            return None;
        }
        while self.open > 1 && k < self.list[self.open - 1].begin {
            self.open -= 1;
        }
        self.legs().last()
    }
}

impl Start {
    /// Its first vertex; one that does not move where it has none.
    pub fn first(&self) -> &First {
        &self.first
    }

    /// Nothing is left of what it was but memory.
    fn begin_with(&mut self, k: usize) {
        if self.place != At::Nowhere {
            self.first = First::default();
        }
        (self.begin, self.place, self.second, self.bare, self.turned) = (k, At::Nowhere, At::Nowhere, false, None);
    }

    /// Whether it is a leg straight from the camera to this vertex: several chains of a record may begin alike.
    fn begins_with(&self, rec: &PathRecord, seen: &Seen) -> bool {
        match self.place {
            At::Event(k) => self.turned.is_none() && Seen::of(&rec.events[k]).as_ref() == Some(seen),
            At::Before | At::Nowhere => false,
        }
    }

    pub fn line<'a>(&'a self, scene: &'a Scene, moving: &'a Moving) -> FilmLine<'a> {
        FilmLine { scene, moving, ray: &self.ray }
    }

    /// Event `k` of a record, `after` having been collected behind it.
    pub fn event<S: Sink>(&self, cx: &mut Chained<S>, chain: &mut Chain, rec: &PathRecord, k: usize, after: Rgb) {
        // On the camera line, before any vertex.
        let seen = match self.place {
            At::Before => false,
            At::Event(first) => k < first,
            At::Nowhere => true,
        };
        let is_first = self.place == At::Event(k);
        cx.after = match self.second {
            At::Before => true,
            At::Event(second) => k > second,
            At::Nowhere => false,
        };
        let side = |first: u32, len: u32| &rec.side[first as usize..(first + len) as usize];
        effort::note(1);
        match &rec.events[k] {
            Event::Chain => chain.clear(),
            Event::Specular(s) => {
                let Some(turn) = &self.turned else { return };
                cx.specular(chain, s, turn, self.straight, after);
            }
            Event::Emit { weight, end: End::Infinity(w), .. } if seen => cx.escape(*w, *weight),
            Event::Span { span, .. } if seen => cx.camera_span(span, self.first(), after),
            Event::Span { span, .. } => chain.span(cx.scene, span),
            Event::Scatter { medium, p, w, .. } => cx.scatter(chain, *medium, *p, *w, is_first),
            Event::Surface { hit, wi, .. } => cx.reflect(chain, hit, *wi, is_first),
            Event::Upright { surface, normals, wi, wo, lights, share } => {
                let Surface::Rough(rough) = &cx.scene.surfaces[*surface as usize] else { return };
                let slopes = rough.arc_slopes(*normals, *wi, *wo);
                rec.far(*lights).iter().for_each(|l| cx.upright(chain, &l.far, slopes.weighed(l.value * *share)));
            }
            Event::Emit { weight, emission, end } if !seen => cx.arrive(chain, *end, *weight * emission.color()),
            Event::Glow { weight, radiance, via, first_span, spans, .. } => {
                let (dark, via) = (*weight, &rec.drawn[*via as usize]);
                cx.glow(chain, via, dark * via.sigma * *radiance, dark, side(*first_span, *spans), seen);
            }
            Event::Connect { weight, emission, end, first_span, spans, via, .. } => {
                let (dark, spans) = (*weight * emission.color(), side(*first_span, *spans));
                match via.map(|k| &rec.drawn[k as usize]) {
                    Some(via) => cx.connect_through(chain, via, *end, [dark * via.sigma, dark], spans, seen),
                    None => cx.connect(chain, *end, dark, spans),
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
#[path = "chained_tests.rs"]
mod tests;
