//! Values of nodes by slot, while bricks are made of them.
//!
//! A large grid is in memory twice then. So a builder keeps its values in segments, and gives each back when the bricks that need it are done.

/// Slots of a segment: 32 MiB a channel, so that its memory goes back to the system at once.
const SEGMENT: usize = 1 << 23;

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
#[derive(Clone, Debug, Default)]
pub(super) struct Segments {
    segments: Vec<Vec<f32>>,
    /// The last plane of the table that needs the segment, where that is known.
    last: Vec<usize>,
}

impl Segments {
    /// Append values of whole slots.
    pub fn push(&mut self, mut values: &[f32], channels: usize) {
        let full = SEGMENT * channels;
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
        let (from, to) = (first as usize / SEGMENT, (first as usize + slots - 1) / SEGMENT);
        self.last[from..=to].iter_mut().for_each(|l| *l = plane.max(*l));
    }
}

impl Values for Segments {
    #[inline]
    fn of(&self, slot: u32, channels: usize) -> &[f32] {
        let slot = slot as usize;
        &self.segments[slot / SEGMENT][slot % SEGMENT * channels..][..channels]
    }

    fn done(&mut self, plane: usize) {
        for (segment, _) in self.segments.iter_mut().zip(&self.last).filter(|(_, last)| **last <= plane) {
            *segment = Vec::new();
        }
    }
}
