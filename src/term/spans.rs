//! The medium spans of camera paths, for terms whose light jumps across surfaces in media ([`super::hard_beam`], [`super::cast`]): every span of a path is looked at whole, so that light of any order counts.

use super::Context;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::transport::chained::Starts;
use crate::transport::first::{Later, Met, Nth, Opening};
use crate::transport::record::{Event, MediumSpan, PathRecord, Recorder};
use crate::transport::state::State;
use crate::transport::tracking;
use crate::transport::velocity::Velocity;
use crate::transport::walk::Walker;

/// Points of a span and the weight of a path there.
pub struct Walked<'a> {
    pub span: MediumSpan,
    /// The span whole, up to what ends it.
    pub whole: MediumSpan,
    pub weight: &'a dyn Fn(f64) -> Rgb,
    /// Scatterings before it.
    pub depth: u32,
    /// How its direction was drawn.
    pub reach: Option<(DVec3, f64)>,
}

/// How a point of a span moves, the span whole.
pub type Moves<'a> = &'a dyn Fn(&MediumSpan, DVec3) -> Velocity;

/// A record that holds a path in one piece: long ones would be cut into chunks.
pub fn record() -> PathRecord {
    let mut path = PathRecord::new();
    path.chunk = usize::MAX;
    path.begin(false, &Opening::NEW);
    path
}

/// A path without connections.
pub struct Bare(pub PathRecord);

impl Recorder for Bare {
    const ON: bool = true;
    const CONNECTS: bool = false;

    fn push(&mut self, e: Event) {
        self.0.push(e);
    }

    fn wants_ends(&self) -> bool {
        true
    }
}

/// Walk a path from a film point.
pub fn walk<R: Recorder>(cx: &mut Context, film: [f64; 2], rng: Rng, rec: &mut R) {
    let (o, w) = cx.sensor.ray(film[0], film[1]);
    let mut walker = Walker::new(cx.scene, cx.set, rec);
    walker.trace(&mut State::new(rng, o, w, cx.sensor.medium));
    cx.tally = cx.tally.plus(&walker.tally);
}

/// How its legs begin.
pub fn starts(cx: &Context, rec: &PathRecord) -> Starts {
    let mut starts = Starts::default();
    starts.find_all(cx.scene, cx.moving, rec, &Opening::NEW);
    starts
}

/// All its medium spans, each with how its points move.
pub fn each(cx: &Context, rec: &PathRecord, starts: &Starts, found: &mut dyn FnMut(&Walked, Moves)) {
    for (k, e) in rec.events.iter().enumerate() {
        let leg = starts.next_at(k);
        let velocity = |span: &MediumSpan, p: DVec3| match leg {
            Some((leg, Nth::First)) => leg.line(cx.scene, cx.moving).medium(p, span, Later::Nothing).velocity,
            Some((leg, nth)) => cx.moving.vertex(cx.scene, leg.first(), nth, &Met::Medium(p)),
            None => Velocity::default(),
        };
        match *e {
            Event::Ends { span, start, depth, .. } => {
                let m = &cx.scene.media[span.medium as usize];
                let weight = |t: f64| start * tracking::depth(m, &span.until(t)).map(|d| (-d).exp());
                found(&Walked { span, whole: span, weight: &weight, depth, reach: None }, &velocity);
            }
            Event::Span { span, prefix: Some(prefix) } => {
                let m = &cx.scene.media[span.medium as usize];
                let weight = |t: f64| tracking::walked_weight(m, &span, t, prefix.beta, prefix.r);
                // A flight behind an interface knows what would have ended it.
                let whole = match rec.events.get(k + 1) {
                    Some(Event::Scatter { span: Some(whole), .. }) => *whole,
                    _ => span,
                };
                let walked = Walked { span, whole, weight: &weight, depth: prefix.depth, reach: prefix.reach };
                found(&walked, &velocity);
            }
            _ => {}
        }
    }
}
