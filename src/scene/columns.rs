//! Columns of beams: where their light runs through media, so that the next vertex of a path can be drawn in it.
//!
//! A vertex x sees a column at a distance h like a bright rod, `∫ σ_s E / d²` over its points y. Directions drawn at x by a phase function seldom meet a narrow one, and those that do
//! score `1/p(ω)`. A point drawn in the column itself, its line by the beam's own profile and its place on the line by the angle seen from x ([T] 5.5), cancels `1/d²` along the line; close to x, where the
//! line passes at the distance h of all lines of the column, directions are the better technique, and the balance heuristic tells the two apart ([`crate::transport::beam_centred`]).
//! Per volume
//!
//! ```text
//! p(y) = p_k e(m) / J · h / (Δθ (h² + (s - s_x)²))
//! ```
//!
//! with p_k the probability of the column, e(m) the profile's density at the line's place m on the beam's own plane, J the area across the column over that across the beam (`cos θ_t / cos θ_i` at each refraction).

use super::beams::Way;
use super::{Around, March, On, Scene};
use crate::light::{LightKind, beam_profile};
use crate::math::discrete::Discrete;
use crate::math::equiangular::EquiAngular;
use crate::math::{DVec3, warp};
use std::f64::consts::{PI, TAU};

/// Lines of a beam that are asked where media are: its axis, and so many at half and at all of its radius.
const PROBES: usize = 8;
/// How far behind the last plane they begin, in radii of the scene.
const OFF: f64 = 1e-6;

/// A beam behind the last plane of a way, between the first and the last point that lie in a medium which scatters.
#[derive(Clone, Copy, Debug)]
struct Column {
    /// Distances along the light, from the last plane.
    from: f64,
    to: f64,
}

/// Columns of all ways.
#[derive(Clone, Debug, Default)]
pub struct Columns {
    /// One a way; `None` where no medium is.
    list: Vec<Option<Column>>,
    /// Which way's is drawn from.
    table: Discrete,
}

impl Way {
    /// Where a line through this point of the beam's own plane leaves the last plane.
    fn base(&self, entry: DVec3, direction: DVec3) -> DVec3 {
        let (mut p, mut w) = (entry, direction);
        for s in &self.steps {
            p += w * ((s.p - p).dot(s.n) / w.dot(s.n));
            w = s.behind;
        }
        p
    }

    /// How far behind its last plane y lies, along the light.
    fn distance(&self, scene: &Scene, y: DVec3) -> Option<f64> {
        match self.steps.last() {
            Some(s) => Some((y - s.p).dot(s.n) / self.w.dot(s.n)),
            None => match scene.lights[self.light as usize].kind {
                LightKind::Beam { position, direction, .. } => Some((y - position).dot(direction)),
                _ => None,
            },
        }
    }

    /// Area across the light behind the way, over that across the beam.
    pub fn widening(&self) -> f64 {
        let turned = |s: &super::beams::Step| (s.behind.dot(s.n) / s.before.dot(s.n)).abs();
        self.steps.iter().filter(|s| s.through).map(turned).product()
    }
}

/// Density of a beam's lines, per area across it.
fn lines(rho: f64, radius: f64, gaussian: bool) -> f64 {
    let whole = PI * radius * radius * if gaussian { 0.5 } else { 1.0 };
    beam_profile(rho, radius, gaussian) / whole
}

impl Columns {
    pub fn is_empty(&self) -> bool {
        self.table.total == 0.0
    }

    /// A point of some way's column, as a vertex at x draws it, with the way's index.
    pub fn sample(&self, scene: &Scene, x: DVec3, [k, u, v, z]: [f64; 4]) -> Option<(usize, DVec3)> {
        self.draw(scene, x, [k, v, z], |radius, gaussian| {
            Some(if gaussian { radius * (-0.5 * (-u).ln_1p()).sqrt() } else { radius * u.sqrt() })
        })
    }

    /// The same of its hard edge; `None` where it has none.
    pub fn sample_edge(&self, scene: &Scene, x: DVec3, numbers: [f64; 3]) -> Option<(usize, DVec3)> {
        self.draw(scene, x, numbers, |radius, gaussian| (!gaussian).then_some(radius))
    }

    fn draw(
        &self,
        scene: &Scene,
        x: DVec3,
        [k, v, z]: [f64; 3],
        rho: impl Fn(f64, bool) -> Option<f64>,
    ) -> Option<(usize, DVec3)> {
        let (id, _, _) = self.table.sample(k);
        let (way, column) = (&scene.beams.ways[id], self.list[id].as_ref()?);
        let LightKind::Beam { position, direction, radius, gaussian } = scene.lights[way.light as usize].kind else {
            return None;
        };
        let (sin, cos) = (TAU * v).sin_cos();
        let (a, b) = warp::frame(direction);
        let base = way.base(position + (a * cos + b * sin) * rho(radius, gaussian)?, direction);
        let angles = EquiAngular::new(x, base, way.w, column.from, column.to);
        let y = base + way.w * angles.sample(z);
        (angles.usable() && y.is_finite()).then_some((id, y))
    }

    /// Per volume, that a vertex at x draws `y` in this way's column.
    pub fn density(&self, scene: &Scene, way: usize, x: DVec3, y: DVec3) -> f64 {
        let Some(along) = self.along(scene, way, x, y) else { return 0.0 };
        let way = &scene.beams.ways[way];
        let LightKind::Beam { position, direction, radius, gaussian } = scene.lights[way.light as usize].kind else {
            return 0.0;
        };
        let m = way.origin(y) - position;
        let across = lines((m - direction * m.dot(direction)).length(), radius, gaussian);
        along * across / way.widening()
    }

    /// Of `y` on its hard edge: per angle around the beam and length along the column.
    pub fn edge_density(&self, scene: &Scene, way: usize, x: DVec3, y: DVec3) -> f64 {
        self.along(scene, way, x, y).map_or(0.0, |p| p / TAU)
    }

    /// `p_k h / (Δθ (h² + (s - s_x)²))`.
    fn along(&self, scene: &Scene, way: usize, x: DVec3, y: DVec3) -> Option<f64> {
        let column = self.list.get(way)?.as_ref()?;
        let w = &scene.beams.ways[way];
        let s = w.distance(scene, y).filter(|s| (column.from..=column.to).contains(s))?;
        let angles = EquiAngular::new(x, y - w.w * s, w.w, column.from, column.to);
        angles.usable().then(|| self.table.probability(way) * angles.density(s))
    }

    /// The same per length of a span: `reach` is the vertex that drew its direction, and with what density; 0 where none did (camera lines).
    pub fn density_per_length(&self, scene: &Scene, way: usize, y: DVec3, reach: Option<(DVec3, f64)>) -> f64 {
        match reach {
            Some((x, p_direction)) => self.density(scene, way, x, y) * (y - x).length_squared() / p_direction,
            None => 0.0,
        }
    }
}

impl Scene {
    /// Find the columns; call when beams and media are known.
    pub(super) fn prepare_columns(&mut self) {
        let around = self.around(self.sensors.first());
        let list: Vec<Option<Column>> = self.beams.ways.iter().map(|w| self.column(w, &around)).collect();
        let power = |(way, column): (&Way, &Option<Column>)| {
            let light = &self.lights[way.light as usize];
            let LightKind::Beam { radius, .. } = light.kind else { return 0.0 };
            column.map_or(0.0, |_| way.gain.max() * light.value.max() * radius * radius)
        };
        let table = Discrete::new(self.beams.ways.iter().zip(&list).map(power));
        self.columns = Columns { list, table };
    }

    fn column(&self, way: &Way, around: &Around) -> Option<Column> {
        let LightKind::Beam { position, direction, radius, .. } = self.lights[way.light as usize].kind else {
            return None;
        };
        let (a, b) = warp::frame(direction);
        let mut found: Option<Column> = None;
        for k in 0..=2 * PROBES {
            let share = [0.0, 0.5, 0.999][k.div_ceil(PROBES)];
            let (sin, cos) = (TAU * k as f64 / PROBES as f64).sin_cos();
            let base = way.base(position + (a * cos + b * sin) * (radius * share), direction);
            let start = base + way.w * (OFF * self.bounds.radius());
            let medium = self.medium_past(start, way.w, &[], around);
            let mut ray = March::new(start, way.w, On::default(), medium);
            for _ in 0..=self.max_interfaces {
                let hit = ray.meets(self, f64::INFINITY);
                let end = hit.as_ref().map_or(f64::INFINITY, |h| ray.before + h.t);
                if ray.medium.is_some_and(|m| !self.media[m as usize].sigma_s.is_zero()) {
                    let all = found.get_or_insert(Column { from: ray.before, to: end });
                    (all.from, all.to) = (all.from.min(ray.before), all.to.max(end));
                }
                match hit {
                    Some(h) if self.passes(&h) => ray.pass(self, &h),
                    _ => break,
                }
            }
        }
        found
    }
}
