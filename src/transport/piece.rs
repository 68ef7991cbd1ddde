//! Straight pieces in one medium whose ends move: how their optical depth changes.
//!
//! A point at the fraction f of a piece moves with the affine mix `(1-f) ȧ + f ḃ` of its ends, which stay on whatever border they lie on; so
//!
//! `τ̇ = ∫ <(1-f) ȧ + f ḃ, ∇σ_t> ds + <w, ḃ - ȧ>/l ∫ σ_t ds`
//!
//! ([T] (10), (11), the last two terms of (27b)), without a word about borders.

use super::record::{Face, MediumSpan};
use crate::math::{DMat3, DVec3, Rgb};
use crate::medium::Volume;
use crate::medium::grid::Slope;
use crate::params::Covector;
use crate::scene::Scene;
use crate::shape::Geometry;

/// What an end of a piece lies on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stop {
    /// Nothing: a vertex, or the camera.
    Free,
    /// Nothing, and behind it nothing is left of a grid that has no border: the ray goes on.
    Open,
    /// A border that stands still, of this normal: an interface, or the box at which a grid ends.
    Border(DVec3),
    /// A face of an opaque shape.
    Opaque { shape: u32, face: u32, n: DVec3 },
}

/// A span, cut to where its medium is.
#[derive(Clone, Copy, Debug)]
pub struct Piece {
    pub medium: u32,
    pub o: DVec3,
    pub w: DVec3,
    pub t0: f64,
    pub t1: f64,
    pub from: Stop,
    pub to: Stop,
}

/// Slack within which a grid's box ends a span where the span itself ends, as a share of the grid's part of it.
const SAME: f64 = 1e-9;
/// Distance from a line over lengths along it, within which a piece is a part of it.
const BESIDE: f64 = 1e-6;

/// A point of a line of direction w that keeps to a border of normal n instead of going with the line, whatever velocity the line has there.
pub fn onto(n: DVec3, w: DVec3) -> DMat3 {
    DMat3::IDENTITY - outer(w, n) * (1.0 / n.dot(w))
}

/// `a bᵀ`.
pub fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

impl Piece {
    /// `None` where the span holds nothing of its medium.
    pub fn of(scene: &Scene, span: &MediumSpan) -> Option<Piece> {
        let stop = |face: Face, t: f64| {
            let Some(s) = scene.shapes.get(face.shape as usize).filter(|_| t.is_finite()) else { return Stop::Free };
            let n = s.shape.normal(face.face, span.o + span.w * t);
            if scene.is_null(s) { Stop::Border(n) } else { Stop::Opaque { shape: face.shape, face: face.face, n } }
        };
        let MediumSpan { medium, o, w, t0, t1, from, to } = *span;
        let mut piece = Piece { medium, o, w, t0, t1, from: stop(from, t0), to: stop(to, t1) };
        if let Volume::Grid(grid) = &scene.media[medium as usize].density {
            if grid.clip_box().is_some() {
                let (lo, hi) = grid.clip_ray(o, w, t0, t1);
                let slack = SAME * (hi - lo);
                let border = |t: f64| Stop::Border(grid.border_normal(o + w * t).normalize());
                if lo > t0 + slack {
                    (piece.t0, piece.from) = (lo, border(lo));
                }
                if hi < t1 - slack {
                    (piece.t1, piece.to) = (hi, border(hi));
                }
            } else if t1 == f64::INFINITY {
                // Its points move otherwise the further a ray that turns has gone.
                let hi = grid.clip_ray(o, w, t0, t1).1;
                if hi.is_finite() {
                    (piece.t1, piece.to) = (hi, Stop::Open);
                }
            }
        }
        (piece.t1 > piece.t0).then_some(piece)
    }

    /// The part around the abscissa t in which the medium's source has no jump: albedo and emission may end at boxes of their own.
    #[must_use]
    pub fn smooth_at(mut self, scene: &Scene, t: f64) -> Piece {
        for grid in scene.media[self.medium as usize].clipped_grids() {
            let (lo, hi) = grid.clip_ray(self.o, self.w, self.t0, self.t1);
            let slack = SAME * (hi - lo);
            for cut in [lo, hi].into_iter().filter(|_| lo < hi) {
                let border = Stop::Border(grid.border_normal(self.o + self.w * cut).normalize());
                if cut <= t && cut > self.t0 + slack {
                    (self.t0, self.from) = (cut, border);
                } else if cut > t && cut < self.t1 - slack {
                    (self.t1, self.to) = (cut, border);
                }
            }
        }
        self
    }

    /// Whether it is a part of the line of this length from o along w, but for rounding. Lines between parallel mirrors have one direction: only their places tell them apart.
    pub fn lies_on(&self, o: DVec3, w: DVec3, length: f64) -> bool {
        let off = self.start() - o;
        let across = (off - w * off.dot(w)).length();
        let reach = off.dot(w) + (self.t1 - self.t0);
        // Of a line without end by how far the piece goes: one that has no end either is its last.
        let scale = off.length() + if length.is_finite() { length } else { reach };
        self.w.dot(w) > 1.0 - SAME && reach <= length && across <= BESIDE * scale
    }

    pub fn start(&self) -> DVec3 {
        self.o + self.w * self.t0
    }

    pub fn end(&self) -> DVec3 {
        self.o + self.w * self.t1
    }

    /// `τ̇ = <g0, ȧ> + <g1, ḃ>`, per channel; of a piece without end, which lets no light through if anything is on it, all points move alike, with ȧ.
    pub fn depth_forms(&self, scene: &Scene) -> [Covector; 2] {
        let m = &scene.media[self.medium as usize];
        let (mut g0, mut g1) = (Covector::default(), Covector::default());
        let length = self.t1 - self.t0;
        let mut add = |c: Rgb, first: DVec3, last: DVec3| {
            g0.add(first, c);
            g1.add(last, c);
        };
        // What a point at the share f of the way has of the gradient goes to the ends as 1-f to f.
        let grid = |s: &Slope| {
            if !length.is_finite() {
                return [s.gradient * m.scale, DVec3::ZERO];
            }
            let (last, along) = (s.moment / length, self.w * (s.value / length));
            [(s.gradient - last - along) * m.scale, (last + along) * m.scale]
        };
        match &m.density {
            Volume::Grid(g) => {
                let slopes = g.integrate_slope(self.o, self.w, self.t0, self.t1);
                if g.channels() == 1 {
                    let [first, last] = grid(&slopes[0]);
                    add(Rgb::splat(1.0), first, last);
                } else {
                    for (c, s) in slopes.iter().enumerate() {
                        let [first, last] = grid(s);
                        add(Rgb::channel(c, 1.0), first, last);
                    }
                }
            }
            Volume::Constant(_) if length.is_finite() => {
                let mean = m.density_integral(self.o, self.w, self.t0, self.t1) * (m.scale / length);
                add(mean, -self.w, self.w);
            }
            Volume::Constant(_) => {}
        }
        [g0, g1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where a line without end begins, its first piece begins there but for rounding; a line beside it does not.
    #[test]
    fn lines_without_end_keep_their_first_piece() {
        let (o, w) = (DVec3::new(0.3, -0.7, 1.1), DVec3::new(0.6, 0.0, 0.8));
        let off = DVec3::new(0.0, 1e-16, 0.0);
        let piece =
            |start: DVec3, t1: f64| Piece { medium: 0, o: start, w, t0: 0.0, t1, from: Stop::Free, to: Stop::Free };
        for t1 in [2.0, f64::INFINITY] {
            assert!(piece(o + off, t1).lies_on(o, w, f64::INFINITY));
            // One from a mirror at the world's origin.
            assert!(piece(off, t1).lies_on(DVec3::ZERO, w, f64::INFINITY));
            assert_eq!(piece(o, t1).lies_on(o, w, 3.0), t1 < 3.0);
        }
        assert!(!piece(o + DVec3::Y * 1e-3, 2.0).lies_on(o, w, f64::INFINITY));
    }
}
