//! What the events of a record mean for the motion of its chains ([`super::motion`]).

use super::first::{First, Seen};
use super::motion::{Chain, Chained, Moving};
use super::record::{Event, PathRecord};
use crate::math::Rgb;
use crate::params::Sink;
use crate::scene::Scene;

/// A chain's first vertex.
pub struct Start {
    /// Index of the event that the chain begins with.
    begin: usize,
    place: At,
    pub first: First,
}

/// Where the event of a first vertex is.
#[derive(Clone, Copy, Debug, PartialEq)]
enum At {
    /// In an earlier chunk.
    Before,
    Event(usize),
    /// The chain has none.
    Nowhere,
}

/// First vertices of the chains in some events.
pub struct Starts(Vec<Start>);

impl Starts {
    /// `open`: the first vertex of the chain that the events begin in. Empty where nothing moves.
    pub fn new(scene: &Scene, moving: &Moving, events: &[Event], open: Option<Seen>) -> Starts {
        if !moving.any() {
            return Starts(Vec::new());
        }
        let line = moving.film_line(scene);
        let mut seen = open;
        let start = |begin, seen: Option<&Seen>, place| Start {
            begin,
            place: if seen.is_some() { place } else { At::Nowhere },
            first: seen.map_or_else(First::default, |s| line.first(s)),
        };
        let mut list = vec![start(0, open.as_ref(), At::Before)];
        for (k, e) in events.iter().enumerate() {
            let known = seen.is_some();
            Seen::follow(&mut seen, e);
            if matches!(e, Event::Chain) {
                list.push(start(k, None, At::Nowhere));
            } else if let (Some(s), false, Some(last)) = (&seen, known, list.last_mut()) {
                *last = start(last.begin, Some(s), At::Event(k));
            }
        }
        Starts(list)
    }

    /// The start of the chain that event `k` belongs to; `k` must not grow from call to call.
    pub fn at(&mut self, k: usize) -> Option<&Start> {
        while self.0.len() > 1 && self.0.last().is_some_and(|s| k < s.begin) {
            self.0.pop();
        }
        self.0.last()
    }
}

impl Start {
    /// Event `k` of a record, `after` having been collected behind it.
    pub fn event<S: Sink>(&self, cx: &mut Chained<S>, chain: &mut Chain, rec: &PathRecord, k: usize, after: Rgb) {
        // On the camera line, before any vertex.
        let seen = match self.place {
            At::Before => false,
            At::Event(first) => k < first,
            At::Nowhere => true,
        };
        let is_first = self.place == At::Event(k);
        let side = |first: u32, len: u32| &rec.side[first as usize..(first + len) as usize];
        match &rec.events[k] {
            Event::Chain => chain.clear(),
            Event::Span { span, .. } if seen => cx.camera_span(span, &self.first, after),
            Event::Span { span, .. } => chain.span(cx.scene, span),
            Event::Scatter { medium, p, w, .. } => cx.scatter(chain, *medium, *p, *w, is_first),
            Event::Surface { hit, .. } => cx.reflect(chain, hit, is_first),
            Event::Emit { weight, emission, end } if !seen => cx.arrive(chain, *end, *weight * emission.color()),
            Event::Glow { weight, emission, via, first_span, spans } => {
                let dark = *weight;
                cx.glow(chain, via, dark * via.sigma * emission.color(), dark, side(*first_span, *spans), seen);
            }
            Event::Connect { weight, emission, end, first_span, spans, via, .. } => {
                let (dark, spans) = (*weight * emission.color(), side(*first_span, *spans));
                match via {
                    Some(via) => cx.connect_through(chain, via, *end, [dark * via.sigma, dark], spans, seen),
                    None => cx.connect(chain, *end, dark, spans),
                }
            }
            _ => {}
        }
    }
}
