//! Sums over the slots of arrays, of which a batch of samples touches few or all.
//!
//! An array has a number for each of millions of voxels, and a few thousand paths meet some of them: what they add is kept as a list as long as that takes less room than
//! all slots do, and over all slots from then on.

/// One sum over so many slots, which starts at 0.
#[derive(Clone, Debug, Default)]
pub struct ArraySum {
    slots: usize,
    list: Vec<(u32, f64)>,
    /// All slots, once the list was too long; kept for the next time, all 0.
    all: Vec<f64>,
    is_full: bool,
}

impl ArraySum {
    pub fn new(slots: usize) -> Self {
        ArraySum { slots, ..ArraySum::default() }
    }

    #[inline]
    pub fn add(&mut self, slot: usize, value: f64) {
        if self.is_full {
            self.all[slot] += value;
            return;
        }
        self.list.push((slot as u32, value));
        // An entry takes the room of two slots.
        if 2 * self.list.len() > self.slots {
            self.fill();
        }
    }

    #[cold]
    fn fill(&mut self) {
        self.all.resize(self.slots, 0.0);
        std::mem::take(&mut self.list).into_iter().for_each(|(slot, value)| self.all[slot as usize] += value);
        self.is_full = true;
    }

    /// Hand over what was added, a slot several times while there are few; 0 afterward.
    pub fn take(&mut self, mut f: impl FnMut(usize, f64)) {
        if self.is_full {
            for (slot, x) in self.all.iter_mut().enumerate().filter(|(_, x)| **x != 0.0) {
                f(slot, std::mem::take(x));
            }
            self.is_full = false;
        } else {
            self.list.drain(..).for_each(|(slot, value)| f(slot as usize, value));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_and_all_slots_add_up_alike() {
        for (slots, added) in [(10_000, 200), (10_000, 20_000), (3, 50), (1, 1)] {
            let mut sum = ArraySum::new(slots);
            for round in 0..2 {
                let mut expected = vec![0.0; slots];
                for k in 0..added {
                    let (slot, x) = (k * 7919 % slots, f64::from((k + round) as u32));
                    expected[slot] += x;
                    sum.add(slot, x);
                }
                assert_eq!(sum.is_full, 2 * added > slots);
                let mut found = vec![0.0; slots];
                sum.take(|slot, x| found[slot] += x);
                assert_eq!(found, expected);
                sum.take(|slot, _| panic!("{slot}"));
            }
        }
    }
}
