//! How a point moves: linear in the motions of shapes and camera, and kept as such, so that forward and reverse mode read the same numbers.

use super::piece::outer;
use crate::math::{DMat3, DVec3, Rgb, warp};
use crate::params::{Covector, Partial, Sink, Slot};
use crate::scene::{Hit, Scene};
use crate::sensor::Sensor;
use smallvec::SmallVec;

/// What moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// As matter of this face of a shape.
    Shape { shape: u32, face: u32 },
    /// The position of a light that the medium around it follows.
    Light(u32),
    /// As part of its film point's ray.
    Camera,
    /// A vector in three slots.
    Vector(Slot),
    /// Of the vertex at hand, which is not known yet.
    Here,
}

impl Source {
    /// The matter that a ray met.
    pub fn at(hit: &Hit) -> Source {
        Source::Shape { shape: hit.shape, face: hit.face }
    }
}

/// Hands the partials of `<c, v>` out, v the velocity of `p` as part of the source.
fn point(scene: &Scene, sensor: &Sensor, source: Source, p: DVec3, c: &Covector, sink: &mut impl Sink) {
    match source {
        Source::Shape { shape, face } => scene.matter(shape, face).point(p, c, sink),
        Source::Light(k) => {
            let first = scene.lights[k as usize].place.position;
            (0..3).for_each(|i| sink.add(first + i as Slot, c.0[i]));
        }
        Source::Camera => sensor.point(p, c, sink),
        Source::Vector(slot) => (0..3).for_each(|i| sink.add(slot + i as Slot, c.0[i])),
        Source::Here => {}
    }
}

/// `ẋ = Σ M v(p) + Σ ṡ x_s`.
#[derive(Debug, Default)]
pub struct Velocity {
    /// Sources, a point of each, and M.
    points: Vec<(Source, DVec3, DMat3)>,
    /// Slots that are no motions (indices of refraction), each once, and what x does with them.
    values: SmallVec<[(Slot, DVec3); 2]>,
}

impl Clone for Velocity {
    fn clone(&self) -> Self {
        Velocity { points: self.points.clone(), values: SmallVec::from_slice(&self.values) }
    }
}

/// `Mᵀ c`.
pub(super) fn transposed(m: &DMat3, c: &Covector) -> Covector {
    let [x, y, z] = c.0;
    Covector(std::array::from_fn(|k| {
        let col = m.col(k);
        x * col.x + y * col.y + z * col.z
    }))
}

impl Velocity {
    /// Of a point that goes with its source.
    pub fn of(source: Source, p: DVec3) -> Velocity {
        Velocity { points: vec![(source, p, DMat3::IDENTITY)], values: SmallVec::new() }
    }

    /// How the unit normal n of a source turns at p. Matter is affine: `ṅ = -Σ t <n, v(p+t) - v(p)>` over two tangents.
    pub fn of_normal(source: Source, p: DVec3, n: DVec3) -> Velocity {
        let (s, t) = warp::frame(n);
        [s, t].into_iter().fold(Velocity::default(), |sum, t| {
            let turning = Velocity::of(source, p + t).plus(-1.0, &Velocity::of(source, p));
            sum.plus(-1.0, &turning.mapped(outer(t, n)))
        })
    }

    pub fn is_zero(&self) -> bool {
        self.points.is_empty() && self.values.is_empty()
    }

    /// `M ẋ`.
    #[must_use]
    pub fn mapped(mut self, m: DMat3) -> Velocity {
        self.points.iter_mut().for_each(|x| x.2 = m * x.2);
        self.values.iter_mut().for_each(|x| x.1 = m * x.1);
        self
    }

    /// `ẋ + w ẏ`.
    #[must_use]
    pub fn plus(mut self, w: f64, other: &Velocity) -> Velocity {
        if w != 0.0 {
            self.points.extend(other.points.iter().map(|&(s, p, m)| (s, p, m * w)));
            other.values.iter().for_each(|&(slot, v)| self.add_value(slot, v * w));
            self.compact();
        }
        self
    }

    /// Adds `M ẏ`.
    pub fn add(&mut self, m: &DMat3, other: &Velocity) {
        self.points.extend(other.points.iter().map(|&(s, p, own)| (s, p, *m * own)));
        other.values.iter().for_each(|&(slot, v)| self.add_value(slot, *m * v));
        self.compact();
    }

    /// Adds `ṡ v`.
    pub fn add_value(&mut self, slot: Slot, v: DVec3) {
        match self.values.iter_mut().find(|x| x.0 == slot) {
            Some(own) => own.1 += v,
            None => self.values.push((slot, v)),
        }
    }

    /// The same with at most four points a source. All motions are affine: `Σ M v(p) = (Σ M) v(o) + Σ_j (Σ M (p-o)_j) (v(o+e_j) - v(o))`. Otherwise rays that go
    /// by many interfaces would ask the same sources at ever more points.
    fn compact(&mut self) {
        const LONG: usize = 16;
        if self.points.len() <= LONG {
            return;
        }
        let mut list: Vec<(Source, DVec3, [DMat3; 4])> = Vec::new();
        for &(s, p, m) in &self.points {
            let k = list.iter().position(|x| x.0 == s).unwrap_or(list.len());
            if k == list.len() {
                list.push((s, p, [DMat3::ZERO; 4]));
            }
            let (_, o, sums) = &mut list[k];
            let off = (p - *o).to_array();
            (0..3).for_each(|j| sums[1 + j] += m * off[j]);
            sums[0] += m;
        }
        self.points.clear();
        for (s, o, [whole, x, y, z]) in list {
            self.points.push((s, o, whole - x - y - z));
            for (e, m) in [(DVec3::X, x), (DVec3::Y, y), (DVec3::Z, z)] {
                if m != DMat3::ZERO {
                    self.points.push((s, o + e, m));
                }
            }
        }
    }

    /// The partials of `<c, ẋ>`.
    pub fn apply(&self, scene: &Scene, sensor: &Sensor, c: &Covector, sink: &mut impl Sink) {
        for (source, p, m) in &self.points {
            point(scene, sensor, *source, *p, &transposed(m, c), sink);
        }
        for (slot, v) in &self.values {
            sink.add(*slot, c.dot(*v));
        }
    }

    /// The same; what it asks of the vertex at hand is added to `at`.
    pub fn settle(&self, scene: &Scene, sensor: &Sensor, c: &Covector, at: &mut Covector, sink: &mut impl Sink) {
        self.apply(scene, sensor, c, sink);
        for (_, _, m) in self.points.iter().filter(|x| x.0 == Source::Here) {
            *at += transposed(m, c);
        }
    }

    /// The same as a list of forms.
    pub fn forms(&self, scene: &Scene, sensor: &Sensor, c: DVec3, mut out: impl FnMut(Partial)) {
        for (source, p, m) in &self.points {
            let c = m.transpose() * c;
            match source {
                Source::Shape { shape, face } => scene.matter(*shape, *face).forms(*p, c, &mut out),
                Source::Light(k) => out(Partial { slot: scene.lights[*k as usize].place.position, v: c, len: 3 }),
                Source::Camera => sensor.forms(*p, c).into_iter().for_each(&mut out),
                Source::Vector(slot) => out(Partial { slot: *slot, v: c, len: 3 }),
                Source::Here => {}
            }
        }
        for (slot, v) in &self.values {
            out(Partial { slot: *slot, v: DVec3::new(c.dot(*v), 0.0, 0.0), len: 1 });
        }
    }
}

/// A rate, linear in the same motions: `Σ <c, v(p)> + Σ ṡ x_s` and the divergences of shapes' own motions.
#[derive(Clone, Debug, Default)]
pub struct Rate {
    forms: Vec<(Source, DVec3, DVec3)>,
    values: SmallVec<[(Slot, f64); 1]>,
    spread: Vec<(u32, f64)>,
}

impl Rate {
    /// Adds `<c, ẋ>`.
    pub fn add(&mut self, x: &Velocity, c: DVec3) {
        self.forms.extend(x.points.iter().map(|&(s, p, m)| (s, p, m.transpose() * c)));
        self.values.extend(x.values.iter().map(|&(slot, v)| (slot, v.dot(c))));
    }

    /// Adds `w` times the divergence of a shape's affine motion.
    pub fn add_divergence(&mut self, shape: u32, w: f64) {
        self.spread.push((shape, w));
    }

    pub fn is_zero(&self) -> bool {
        self.forms.is_empty() && self.values.is_empty() && self.spread.is_empty()
    }

    pub fn apply(&self, scene: &Scene, sensor: &Sensor, value: Rgb, sink: &mut impl Sink) {
        for &(source, p, c) in &self.forms {
            let mut form = Covector::default();
            form.add(c, value);
            point(scene, sensor, source, p, &form, sink);
        }
        for &(slot, rate) in &self.values {
            sink.add(slot, value * rate);
        }
        for &(shape, w) in &self.spread {
            scene.shapes[shape as usize].mover.volume(value * w, sink);
        }
    }
}
