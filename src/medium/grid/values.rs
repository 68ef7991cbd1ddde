//! Values of nodes by slot, while bricks are made of them.
//!
//! A large grid is in memory twice then. So a builder keeps its values in segments, and gives each back when the bricks that need it are done.

/// Slots of a segment, as a power of two: 32 MiB a channel, so that its memory goes back to the system at once.
const SEGMENT: u32 = 23;

/// Where bricks take values from, channels interleaved.
pub(super) trait Values {
    fn of(&self, slot: u32, channels: usize) -> &[f32];

    /// All bricks of this plane of the table, and of those before it, are made.
    fn done(&mut self, _plane: usize) {}
}

/// Values that somebody else keeps.
impl Values for &[f32] {
    #[inline]
    fn of(&self, slot: u32, channels: usize) -> &[f32] {
        &self[slot as usize * channels..][..channels]
    }
}

/// Values in segments.
#[derive(Clone, Debug)]
pub(super) struct Segments {
    /// Slots of each but the last, as a power of two.
    shift: u32,
    segments: Vec<Vec<f32>>,
    /// The last plane of the table that needs the segment, where that is known.
    last: Vec<usize>,
}

impl Default for Segments {
    fn default() -> Self {
        Segments::of(SEGMENT)
    }
}

impl Segments {
    /// Of `2^shift` slots.
    pub fn of(shift: u32) -> Self {
        Segments { shift, segments: Vec::new(), last: Vec::new() }
    }

    /// Append values of whole slots.
    pub fn push(&mut self, mut values: &[f32], channels: usize) {
        let full = channels << self.shift;
        while !values.is_empty() {
            if self.segments.last().is_none_or(|s| s.len() == full) {
                self.segments.push(Vec::new());
            }
            if let Some(segment) = self.segments.last_mut() {
                let (now, later) = values.split_at(values.len().min(full - segment.len()));
                segment.extend_from_slice(now);
                values = later;
            }
        }
    }

    /// Numbers, not slots.
    pub fn len(&self) -> usize {
        self.segments.iter().map(Vec::len).sum()
    }

    pub fn slices(&self) -> impl Iterator<Item = &[f32]> {
        self.segments.iter().map(Vec::as_slice)
    }

    pub fn slices_mut(&mut self) -> impl Iterator<Item = &mut [f32]> {
        self.segments.iter_mut().map(Vec::as_mut_slice)
    }

    /// A block of values from `first` on is needed up to this plane of the table.
    pub fn needed(&mut self, first: u32, slots: usize, plane: usize) {
        self.last.resize(self.segments.len(), 0);
        let (from, to) = (first as usize >> self.shift, (first as usize + slots - 1) >> self.shift);
        self.last[from..=to].iter_mut().for_each(|l| *l = plane.max(*l));
    }
}

impl Values for Segments {
    #[inline]
    fn of(&self, slot: u32, channels: usize) -> &[f32] {
        let (slot, mask) = (slot as usize, (1 << self.shift) - 1);
        &self.segments[slot >> self.shift][(slot & mask) * channels..][..channels]
    }

    fn done(&mut self, plane: usize) {
        for (segment, _) in self.segments.iter_mut().zip(&self.last).filter(|(_, last)| **last <= plane) {
            *segment = Vec::new();
        }
    }
}
