//! Which parts of edges a known chain of planes shows to the camera, so that samples look there.
//!
//! By a chain of planes every point e of an edge has one ray ([`crate::math::fermat`]), whose crossings move smoothly along the edge; the chain shows e where all of them lie within their faces. A strip of glass that mirrors an
//! edge shows a hundredth of it: samples that choose the place by length find it once in a hundred times. Crossings are therefore asked for at a few points of each edge, and how far they lie within the borders of
//! their faces is interpolated between: where all of that is positive is a *window*. Windows only guide: they are widened, and a share of all samples is spread over the whole edges.

use crate::math::DVec3;
use crate::math::discrete::Discrete;
use crate::math::fermat::Planes;
use crate::scene::Scene;
use crate::shape::edges::{sides, with_corners};
use crate::transport::shot::{Eye, Step};

/// Pieces of an edge whose ends are asked for.
pub const PIECES: usize = 8;
/// Share of samples that windows do not decide.
const ANYWHERE: f64 = 0.2;
/// By how much of a piece windows are widened at either side.
const WIDER: f64 = 0.2;

/// A place on the edges that was drawn: which one, the share of its length, and its density, per share of the edge.
#[derive(Clone, Copy, Debug)]
pub struct Spot {
    pub edge: usize,
    pub t: f64,
    pub density: f64,
}

impl Spot {
    /// By a table over edges alone.
    pub fn of(table: &Discrete, u: f64) -> Spot {
        let (edge, density, t) = table.sample(u);
        Spot { edge, t, density }
    }
}

/// A part of an edge.
#[derive(Clone, Copy, Debug)]
struct Part {
    edge: usize,
    from: f64,
    to: f64,
}

/// Parts of edges, as a chain shows them.
#[derive(Debug)]
pub struct Shown {
    parts: Vec<Part>,
    table: Discrete,
    /// Whether there is any window.
    pub any: bool,
}

/// A border of a face: a point of it, and the unit direction to the inside.
type Inward = (DVec3, DVec3);

/// How far the crossings lie within the borders of their faces, face by face and border by border.
type Margins = Vec<f64>;

fn margins(planes: &Planes, faces: &[Vec<Inward>], eye: &Eye, o: DVec3, e: DVec3) -> Option<Margins> {
    let crossings = planes.crossings(eye, o, e)?;
    let of = |(p, face): (DVec3, &Vec<Inward>)| face.iter().map(|&(a, n)| n.dot(p - a)).collect::<Vec<_>>();
    Some(crossings.into_iter().zip(faces).flat_map(of).collect())
}

/// Where between two points, whose margins are given, all of them are above `-slack`.
pub(super) fn window(a: &[f64], b: &[f64], slack: f64) -> Option<[f64; 2]> {
    let (mut lo, mut hi) = (0.0f64, 1.0f64);
    for (a, b) in a.iter().zip(b).map(|(a, b)| (a + slack, b + slack)) {
        match (a > 0.0, b > 0.0) {
            (true, true) => {}
            (false, false) => return None,
            (false, true) => lo = lo.max(a / (a - b)),
            (true, false) => hi = hi.min(a / (a - b)),
        }
    }
    // What excludes each other by little as straight lines may not as curves.
    (lo <= hi + WIDER).then_some([lo.min(hi), lo.max(hi)])
}

impl Shown {
    /// `edges`: those that count, and their ends.
    pub fn new(
        scene: &Scene,
        eye: &Eye,
        (planes, steps, o): (&Planes, &[Step], DVec3),
        edges: &[(usize, [DVec3; 2])],
    ) -> Shown {
        let inwards = |step: &Step| -> Vec<Inward> {
            let shape = &scene.shapes[step.shape as usize].shape;
            with_corners(shape, step.face, |corners| sides(corners).collect()).unwrap_or_default()
        };
        let faces: Vec<Vec<Inward>> = steps.iter().map(inwards).collect();
        let (mut parts, mut lengths) = (Vec::new(), Vec::new());
        for &(edge, [a, b]) in edges {
            let at = |j: usize| j as f64 / PIECES as f64;
            let known: Vec<Option<Margins>> =
                (0..=PIECES).map(|j| margins(planes, &faces, eye, o, a.lerp(b, at(j)))).collect();
            for j in 0..PIECES {
                let open = match (&known[j], &known[j + 1]) {
                    (Some(a), Some(b)) => {
                        window(a, b, 0.0).map(|[lo, hi]| [(lo - WIDER).max(0.0), (hi + WIDER).min(1.0)])
                    }
                    (None, None) => None,
                    _ => Some([0.0, 1.0]),
                };
                let cuts = open.map_or([0.0, 0.0, 0.0, 1.0], |[lo, hi]| [0.0, lo, hi, 1.0]);
                for (i, c) in cuts.windows(2).enumerate().filter(|(_, c)| c[1] > c[0]) {
                    let [from, to] = [c[0], c[1]].map(|f| at(j) + f / PIECES as f64);
                    parts.push(Part { edge, from, to });
                    lengths.push((i == 1, (to - from) * (b - a).length()));
                }
            }
        }
        let all: f64 = lengths.iter().map(|l| l.1).sum();
        let seen: f64 = lengths.iter().filter(|l| l.0).map(|l| l.1).sum();
        let share = |&(open, length): &(bool, f64)| {
            let anywhere = length / all;
            if seen > 0.0 {
                ANYWHERE * anywhere + if open { (1.0 - ANYWHERE) * length / seen } else { 0.0 }
            } else {
                anywhere
            }
        };
        let table = Discrete::new(lengths.iter().map(share));
        Shown { parts, table, any: seen > 0.0 }
    }

    pub fn sample(&self, u: f64) -> Spot {
        let (k, probability, u) = self.table.sample(u);
        let Part { edge, from, to } = self.parts[k];
        Spot { edge, t: from + u * (to - from), density: probability / (to - from) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Margins that change as straight lines have their window where all are positive; none where two of them exclude each other.
    #[test]
    fn windows_lie_where_all_margins_are_positive() {
        let at = |v: &[f64]| v.to_vec();
        assert_eq!(window(&at(&[1.0, 2.0]), &at(&[3.0, 1.0]), 0.0), Some([0.0, 1.0]));
        assert_eq!(window(&at(&[-1.0, 2.0]), &at(&[3.0, -2.0]), 0.0), Some([0.25, 0.5]));
        assert_eq!(window(&at(&[-3.0, 1.0]), &at(&[1.0, -3.0]), 0.0), None);
        assert_eq!(window(&at(&[-1.0]), &at(&[-2.0]), 0.0), None);
    }

    /// Whatever is drawn has its density, and all of the edges is drawn.
    #[test]
    fn spots_have_their_density() {
        let parts = vec![
            Part { edge: 0, from: 0.0, to: 0.3 },
            Part { edge: 0, from: 0.3, to: 0.35 },
            Part { edge: 0, from: 0.35, to: 1.0 },
            Part { edge: 4, from: 0.0, to: 1.0 },
        ];
        let shown = Shown { parts, table: Discrete::new([0.1, 2.0, 0.4, 0.5]), any: true };
        let n = 4000;
        let mut sums = [0.0; 2];
        for k in 0..n {
            let s = shown.sample((f64::from(k) + 0.5) / f64::from(n));
            sums[usize::from(s.edge == 4)] += s.t / s.density / f64::from(n);
        }
        sums.iter().for_each(|s| assert!((s - 0.5).abs() < 1e-3, "{sums:?}"));
    }
}
