//! A plane that refracts or mirrors, met from one side.

use super::fresnel::{Interface, reflect};
use super::{DVec3, V3};
use smallvec::SmallVec;

/// A plane on the way.
#[derive(Clone, Copy, Debug)]
pub struct Fold {
    pub p: DVec3,
    pub n: DVec3,
    pub through: bool,
    /// Indices of refraction before and behind it; those of a mirror do not matter.
    pub index: [f64; 2],
}

/// What lies before a mirror is folded over it, so that light goes straight on: planes that refract are left, each with points of it. The light stands at the first point returned then.
pub fn unfold(q: DVec3, chain: impl Iterator<Item = (Fold, Hull)>) -> (DVec3, SmallVec<[(Fold, Hull); 4]>) {
    let (mut q, mut left) = (q, SmallVec::<[(Fold, Hull); 4]>::new());
    for (f, hull) in chain {
        if f.through {
            left.push((f, hull));
            continue;
        }
        let over = |x: DVec3| x - f.n * (2.0 * (x - f.p).dot(f.n));
        q = over(q);
        for (g, hull) in left.iter_mut() {
            (g.p, g.n) = (over(g.p), reflect(g.n, f.n));
            hull.iter_mut().for_each(|c| *c = over(*c));
        }
    }
    (q, left)
}

/// Points between which a face lies.
pub type Hull = SmallVec<[DVec3; 4]>;

impl Fold {
    /// The direction of light behind the plane that travels along w before it; `None` in total reflection.
    pub fn behind(&self, w: DVec3) -> Option<DVec3> {
        if !self.through {
            return Some(reflect(w, self.n));
        }
        let side = if w.dot(self.n) < 0.0 { self.n } else { -self.n };
        let i = Interface::new(-w.dot(side), self.index[0], self.index[1]);
        Some(i.refract(V3::constant(w), V3::constant(side))?.value().normalize())
    }
}
