//! What the chains of a record begin with: events of the camera line so far. Chains that part share what came before, so that neither parting nor going on copies it.

use super::record::Event;
use std::sync::Arc;

/// A list that grows at its end.
#[derive(Clone, Debug, Default)]
pub struct Lead(Option<Arc<Link>>);

#[derive(Debug)]
struct Link {
    event: Event,
    before: Lead,
}

impl Lead {
    pub fn push(&mut self, event: Event) {
        let before = std::mem::take(self);
        self.0 = Some(Arc::new(Link { event, before }));
    }

    /// From the first event on.
    pub fn each(&self, f: impl FnMut(&Event)) {
        let events: smallvec::SmallVec<[&Event; 16]> =
            std::iter::successors(self.0.as_deref(), |l| l.before.0.as_deref()).map(|l| &l.event).collect();
        events.into_iter().rev().for_each(f);
    }
}

impl FromIterator<Event> for Lead {
    fn from_iter<I: IntoIterator<Item = Event>>(events: I) -> Self {
        events.into_iter().fold(Lead::default(), |mut lead, e| {
            lead.push(e);
            lead
        })
    }
}

/// Not link within link: lines may be long.
impl Drop for Lead {
    fn drop(&mut self) {
        let mut next = self.0.take();
        while let Some(link) = next.as_mut().and_then(Arc::get_mut) {
            next = link.before.0.take();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(lead: &Lead) -> Vec<f64> {
        let mut list = Vec::new();
        lead.each(|e| {
            if let Event::Share(f) = e {
                list.push(*f);
            }
        });
        list
    }

    #[test]
    fn leads_part_and_go_on_in_order() {
        let mut a: Lead = [0.0, 1.0].map(Event::Share).into_iter().collect();
        let mut b = a.clone();
        a.push(Event::Share(2.0));
        b.push(Event::Share(3.0));
        assert_eq!((told(&a), told(&b)), (vec![0.0, 1.0, 2.0], vec![0.0, 1.0, 3.0]));
        drop(a);
        assert_eq!(told(&b), [0.0, 1.0, 3.0]);
    }

    #[test]
    fn long_leads_end_without_a_deep_stack() {
        let lead: Lead = (0..1_000_000).map(|k| Event::Share(f64::from(k))).collect();
        assert_eq!(told(&lead).len(), 1_000_000);
    }
}
