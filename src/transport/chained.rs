//! What the events of a record mean for the motion of its chains ([`super::motion`]).

use super::first::{First, Opening};
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
    second: At,
    pub first: First,
}

/// Where the event of a vertex is.
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
    /// `open`: how the chain that the events begin in has begun. Empty where nothing moves.
    pub fn new(scene: &Scene, moving: &Moving, events: &[Event], open: Opening) -> Starts {
        if !moving.any() {
            return Starts(Vec::new());
        }
        let line = moving.film_line(scene);
        let mut opening = open;
        let place = |known: bool| if known { At::Before } else { At::Nowhere };
        let first = open.first.map(|s| line.first(&s)).unwrap_or_default();
        let first = open.second.iter().fold(first, |first, z| line.then(first, z));
        let mut list =
            vec![Start { begin: 0, place: place(open.first.is_some()), second: place(open.second.is_some()), first }];
        for (k, e) in events.iter().enumerate() {
            let before = opening;
            opening.follow(e);
            if matches!(e, Event::Chain) {
                list.push(Start { begin: k, place: At::Nowhere, second: At::Nowhere, first: First::default() });
                continue;
            }
            let Some(last) = list.last_mut() else { continue };
            if let (None, Some(s)) = (before.first, opening.first) {
                (last.first, last.place) = (line.first(&s), At::Event(k));
            }
            if let (None, Some(z)) = (before.second, opening.second) {
                (last.first, last.second) = (line.then(std::mem::take(&mut last.first), &z), At::Event(k));
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
        cx.after = match self.second {
            At::Before => true,
            At::Event(second) => k > second,
            At::Nowhere => false,
        };
        let side = |first: u32, len: u32| &rec.side[first as usize..(first + len) as usize];
        match &rec.events[k] {
            Event::Chain => chain.clear(),
            Event::Span { span, .. } if seen => cx.camera_span(span, &self.first, after),
            Event::Span { span, .. } => chain.span(cx.scene, span),
            Event::Scatter { medium, p, w, .. } => cx.scatter(chain, *medium, *p, *w, is_first),
            Event::Surface { hit, .. } => cx.reflect(chain, hit, is_first),
            Event::Emit { weight, emission, end } if !seen => cx.arrive(chain, *end, *weight * emission.color()),
            Event::Glow { weight, radiance, via, first_span, spans } => {
                let dark = *weight;
                cx.glow(chain, via, dark * via.sigma * *radiance, dark, side(*first_span, *spans), seen);
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
