//! More paths of a derivative through film points near the outlines of what moves.
//!
//! The film holds the first vertex of a path. Where a sphere is met at grazing, `cos θ -> 0`, it slides over it by 1/cos θ; near a silhouette's edge it is close
//! to points that move otherwise, at a distance not below that on the film. Either way scores squared grow so that their integral over the film is
//! unbounded but for a logarithm. So paths of their own start at film points drawn near outlines, with a density `~ 1/cos θ` on a sphere's disc and `~ β^-1/2` at
//! the distance β from an edge, weighed against those of the pixels by the balance heuristic, collisions on their camera lines too ([`crate::transport::poles`]). They score derivatives
//! only: the picture is that of the pixels' paths.

use super::filter;
use crate::math::discrete::Discrete;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec2, DVec3, warp};
use crate::params::ParamSet;
use crate::scene::parts::Filter;
use crate::scene::{Instance, Scene};
use crate::sensor::{Projection, Sensor};
use crate::shape::Shape;
use crate::term::Motion;
use crate::term::outline::Outlines;
use crate::transport::poles::{Pole, Poles};
use smallvec::SmallVec;
use std::f64::consts::PI;

/// Paths for one of each pixel's, per pixel beside an outline.
const RATE: f64 = 0.5;
/// Rays that measure how much is seen: of a sphere, and of an edge.
const PROBES: [u32; 2] = [256, 4];
/// The least cosine that film points are drawn at on a ball: nearer to its outline double precision does not tell their density. And the optical depth that fog counts with at most: what is
/// denser ends within less than that, and is missed as if it were not drawn.
const LEAST: f64 = 1e-6;
const DENSEST: f64 = 1e5;
/// Half width of the strip around an edge, in pixels and in films.
const HALF_WIDTH: (f64, f64) = (1.0, 0.04);
/// Strips on one film point, on average, above which they are made narrower.
const CROWD: f64 = 64.0;
/// Marks the keys of these paths in streams that they share with the pixels'.
pub const LIMB_KEY: u64 = 1 << 62;

/// A sphere.
#[derive(Clone, Copy, Debug)]
struct Ball {
    c: DVec3,
    r: f64,
    /// Of fog in it, across its middle: its light falls off toward the outline as fast as `exp(-depth cos θ)`; 0 where light falls off at once.
    depth: f64,
    /// Probability of being chosen.
    share: f64,
}

/// Both sides of a straight outline, in pixels.
#[derive(Clone, Copy, Debug)]
struct Strip {
    a: DVec2,
    along: DVec2,
    length: f64,
    share: f64,
    /// The edge itself.
    edge: [DVec3; 2],
}

/// What a camera sees of outlines in motion.
pub struct Limbs<'a> {
    sensor: &'a Sensor,
    filter: Filter,
    balls: Vec<Ball>,
    strips: Strips,
    table: Discrete,
    /// Paths over the whole film for one of each pixel's.
    count: u64,
    even: bool,
}

impl<'a> Limbs<'a> {
    /// `None` where there are none.
    pub fn new(scene: &'a Scene, sensor: usize, motion: &Motion, params: &ParamSet) -> Option<Limbs<'a>> {
        let (film, sensor) = (&scene.films[sensor], &scene.sensors[sensor]);
        let (filter, even) = (film.part.filter, film.even);
        let margin = filter::radius(filter);
        let keep = |shape: u32| motion.moving.camera || motion.moves(shape);
        let mut balls = Vec::new();
        for (i, s) in scene.shapes.iter().enumerate() {
            let Shape::Sphere(sphere) = &s.shape else { continue };
            let depth = if scene.is_null(s) { fog_across(scene, s, sphere.radius) } else { Some(0.0) };
            let moves = keep(i as u32) || scene.is_null(s) && s.moves(params);
            if let Some(depth) = depth.filter(|_| moves) {
                let ball = Ball { c: sphere.center, r: sphere.radius, depth, share: 1.0 };
                let share = ball.seen(scene, sensor, i as u32, margin);
                balls.push(Ball { share, ..ball });
            }
        }
        balls.retain(|b| b.share > 0.0);
        let mut strips = match motion.surfaces() {
            true => Strips::new(scene, sensor, motion, margin, keep),
            false => Strips::default(),
        };
        // Shares are areas so far.
        let areas: Vec<f64> = balls.iter().map(|b| b.share).chain(strips.list.iter().map(|s| s.share)).collect();
        let total: f64 = areas.iter().sum();
        balls.iter_mut().for_each(|b| b.share /= total);
        strips.list.iter_mut().for_each(|s| s.share /= total);
        let mut limbs = Limbs { sensor, filter, balls, strips, table: Discrete::new(areas), count: 0, even };
        if total > 0.0 {
            // Strips of one film point count as one.
            limbs.count = (RATE * total * limbs.apart()).ceil() as u64;
        }
        (limbs.count > 0).then_some(limbs)
    }

    /// Area of all that film points may be drawn from, over the sum of its parts' areas.
    fn apart(&self) -> f64 {
        let one_over_parts = |i: u32| {
            let mut rng = Rng::keyed(0, Purpose::Pilot as u64, LIMB_KEY - 1, u64::from(i));
            let (k, _, _) = self.table.sample(rng.uniform());
            let Some(strip) = k.checked_sub(self.balls.len()) else { return 1.0 };
            let film = self.strips.list[strip].uniform(self.strips.half_width, &mut rng);
            1.0 / self.strips.around(film).filter(|(_, s)| s.density(self.strips.half_width, film) > 0.0).count() as f64
        };
        (0..PROBES[0]).map(one_over_parts).map(|x| x.min(1.0)).sum::<f64>() / f64::from(PROBES[0])
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    /// Whether their random numbers lie evenly.
    pub fn even(&self) -> bool {
        self.even
    }

    /// A film point, and the strip that it was drawn by; `None` behind the camera.
    pub fn sample(&self, rng: &mut Rng) -> Option<([f64; 2], Option<u32>)> {
        let (k, _, _) = self.table.sample(rng.uniform());
        match k.checked_sub(self.balls.len()) {
            None => Some((self.balls[k].sample(self.sensor, rng)?, None)),
            Some(k) => Some((self.strips.list[k].sample(self.strips.half_width, rng), Some(k as u32))),
        }
    }

    /// How often a film point is drawn from here for once by its pixel, and the poles of its camera line. `drawn`: the strip that it was drawn by.
    pub fn poles(&self, film: [f64; 2], drawn: Option<u32>) -> Poles {
        let (o, w) = self.sensor.ray(film[0], film[1]);
        let count = self.count as f64;
        let in_balls: f64 = self.balls.iter().map(|b| b.share * b.density(self.sensor, film)).sum();
        let mut poles = Poles { o, w, rest: 1.0 + count * in_balls, list: SmallVec::new(), drawn: None };
        for (k, strip) in self.strips.around(film) {
            let weight = count * strip.share * strip.density(self.strips.half_width, film);
            if weight > 0.0 {
                if drawn == Some(k) {
                    poles.drawn = Some(poles.list.len());
                }
                poles.list.push(Pole { p: beside(strip.edge, o, w), weight });
            }
        }
        poles
    }

    /// Pixels that a film point concerns, with what its path counts there.
    pub fn weights(&self, film: [f64; 2], poles: &Poles) -> impl Iterator<Item = ([usize; 2], f64)> {
        let (filter, size, weight) = (self.filter, [self.sensor.width, self.sensor.height], poles.weight());
        filter::pixels(filter, film, size)
            .map(move |p| {
                let across = |k: usize| filter::density(filter, film[k] - (p[k] as f64 + 0.5));
                (p, across(0) * across(1) * weight)
            })
            .filter(|w| w.1 > 0.0)
    }
}

/// Optical depth across the middle of a border of fog; `None` where it is none, or a grid.
fn fog_across(scene: &Scene, s: &Instance, radius: f64) -> Option<f64> {
    let medium = s.interior.filter(|_| s.boundary && s.interior != s.exterior)?;
    let m = &scene.media[medium as usize];
    m.is_homogeneous().then(|| (2.0 * radius * m.sigma_t.max()).min(DENSEST)).filter(|d| *d > 0.0)
}

/// The point of an edge's line that a ray passes.
fn beside([a, b]: [DVec3; 2], o: DVec3, w: DVec3) -> DVec3 {
    // Across the ray: nearest to it on the line.
    let (off, along) = (a - o, b - a);
    let (u, v) = (off - w * off.dot(w), along - w * along.dot(w));
    let square = v.length_squared();
    if square > 0.0 { a - along * (u.dot(v) / square) } else { a }
}

impl Ball {
    /// cos θ at u in [0, 1), from [`LEAST`] to 1: uniform, in fog every other time with the density `~ exp(-depth cos θ)`.
    fn cosine(&self, u: f64) -> f64 {
        let within = if self.depth == 0.0 {
            1.0 - u
        } else if u < 0.5 {
            1.0 - 2.0 * u
        } else {
            ((2.0 * u - 1.0) * (-self.depth).exp_m1()).ln_1p() / -self.depth
        };
        LEAST + (1.0 - LEAST) * within
    }

    fn cosine_density(&self, cos: f64) -> f64 {
        let (d, within) = (self.depth, (cos - LEAST) / (1.0 - LEAST));
        if within < 0.0 {
            return 0.0;
        }
        let p = if d == 0.0 { 1.0 } else { 0.5 - 0.5 * d * (-d * within).exp() / (-d).exp_m1() };
        p / (1.0 - LEAST)
    }

    /// The angle around the sphere's centre is uniform.
    fn sample(&self, sensor: &Sensor, rng: &mut Rng) -> Option<[f64; 2]> {
        let (cos, v) = (self.cosine(rng.uniform()), rng.uniform());
        let b = self.r * ((1.0 - cos) * (1.0 + cos)).sqrt();
        let (sin_phi, cos_phi) = (2.0 * PI * v).sin_cos();
        let o = sensor.to_world.translation;
        let p = match sensor.projection {
            Projection::Perspective { .. } => {
                let to = self.c - o;
                let (sin, axis) = (b / to.length(), to.normalize());
                if sin >= 1.0 {
                    return None;
                }
                let local = DVec3::new(sin * cos_phi, sin * sin_phi, ((1.0 - sin) * (1.0 + sin)).sqrt());
                o + warp::to_world(axis, local) * to.length()
            }
            Projection::Orthographic => {
                let (_, w) = sensor.ray(0.0, 0.0);
                self.c + warp::to_world(w, DVec3::new(b * cos_phi, b * sin_phi, 0.0))
            }
        };
        Some(sensor.project(p)?.film)
    }

    /// Per pixel².
    fn density(&self, sensor: &Sensor, film: [f64; 2]) -> f64 {
        let (o, w) = sensor.ray(film[0], film[1]);
        let to = self.c - o;
        let along = to.dot(w);
        let b = (to - w * along).length();
        let pinhole = matches!(sensor.projection, Projection::Perspective { .. });
        if along <= 0.0 || b >= self.r || (pinhole && to.length() <= self.r) {
            return 0.0;
        }
        let cos = ((1.0 - b / self.r) * (1.0 + b / self.r)).sqrt();
        let Some(q) = sensor.project(o + w * along) else { return 0.0 };
        // Per area across the ray at the distance `along`.
        let per_area = match sensor.projection {
            Projection::Perspective { .. } => to.length() / along,
            Projection::Orthographic => 1.0,
        } * self.cosine_density(cos)
            / (2.0 * PI * self.r * self.r * cos);
        per_area / q.pixels_per_area
    }

    /// Pixels of the film, and of the margin around it, that show the sphere.
    fn seen(&self, scene: &Scene, sensor: &Sensor, shape: u32, margin: f64) -> f64 {
        let area = |i: u32| {
            let key = LIMB_KEY | u64::from(shape);
            let film = self.sample(sensor, &mut Rng::keyed(0, Purpose::Pilot as u64, key, u64::from(i)))?;
            let (o, w) = sensor.ray(film[0], film[1]);
            if !sensor.shows(film, margin) {
                return None;
            }
            let first = scene.opaque_past(o, w, f64::INFINITY, &[]);
            let seen = if scene.is_null(&scene.shapes[shape as usize]) {
                // Fog that ends before what is behind it.
                first.is_none_or(|h| h.t >= (self.c - o).dot(w))
            } else {
                first.is_some_and(|h| h.shape == shape)
            };
            seen.then(|| 1.0 / self.density(sensor, film))
        };
        (0..PROBES[0]).filter_map(area).filter(|a| a.is_finite()).sum::<f64>() / f64::from(PROBES[0])
    }
}

impl Strip {
    /// Uniform along the edge, `~ β^-1/2` across.
    fn sample(&self, half_width: f64, rng: &mut Rng) -> [f64; 2] {
        let (s, u) = (rng.uniform() * self.length, 2.0 * rng.uniform() - 1.0);
        (self.a + self.along * s + self.along.perp() * (half_width * u * u.abs())).to_array()
    }

    /// Uniform in both.
    fn uniform(&self, half_width: f64, rng: &mut Rng) -> [f64; 2] {
        let (s, u) = (rng.uniform() * self.length, 2.0 * rng.uniform() - 1.0);
        (self.a + self.along * s + self.along.perp() * (half_width * u)).to_array()
    }

    fn density(&self, half_width: f64, film: [f64; 2]) -> f64 {
        let off = DVec2::from_array(film) - self.a;
        let (s, b) = (off.dot(self.along), off.dot(self.along.perp()).abs());
        let inside = s >= 0.0 && s <= self.length && b <= half_width;
        if inside { 0.25 / (self.length * (half_width * b).sqrt()) } else { 0.0 }
    }
}

/// Strips, and which of them reach the cells of a grid over the film.
#[derive(Default)]
struct Strips {
    list: Vec<Strip>,
    half_width: f64,
    /// Corner of the grid; cells have sides of two half widths.
    corner: DVec2,
    columns: usize,
    cells: Vec<Vec<u32>>,
}

impl Strips {
    fn new(scene: &Scene, sensor: &Sensor, motion: &Motion, margin: f64, keep: impl Fn(u32) -> bool + Sync) -> Strips {
        let size = DVec2::new(sensor.width as f64, sensor.height as f64);
        let (low, high) = (DVec2::splat(-margin), size + margin);
        let mut list = Vec::new();
        let outlines = Outlines::sharp_of_camera(scene, motion, sensor, keep);
        for ([a, b], grazed) in outlines.iter().flat_map(Outlines::straight) {
            let seen = |i: u32| {
                let p = a.lerp(b, (f64::from(i) + 0.5) / f64::from(PROBES[1]));
                let q = sensor.project(p).filter(|q| sensor.shows(q.film, margin));
                q.is_some_and(|q| !scene.blocked_past(q.o, q.w, q.distance, grazed))
            };
            let seen = f64::from((0..PROBES[1]).filter(|i| seen(*i)).count() as u32) / f64::from(PROBES[1]);
            let (Some(p), Some(q)) = (sensor.project(a), sensor.project(b)) else { continue };
            let (p, q) = (DVec2::from_array(p.film), DVec2::from_array(q.film));
            if let Some([p, q]) = clip(p, q, low, high).filter(|_| seen > 0.0) {
                let length = (q - p).length();
                if length > 0.0 && length.is_finite() {
                    list.push(Strip { a: p, along: (q - p) / length, length, share: seen, edge: [a, b] });
                }
            }
        }
        let length: f64 = list.iter().map(|s| s.length).sum();
        let widest = HALF_WIDTH.0 + HALF_WIDTH.1 * size.max_element();
        let half_width = widest.min(0.5 * CROWD * size.x * size.y / length.max(1e-300)).max(HALF_WIDTH.0);
        for s in &mut list {
            // Around corners no gap is left between neighbours.
            let more = 0.25 * half_width;
            s.a -= s.along * more;
            s.length += 2.0 * more;
            s.share *= 2.0 * half_width * s.length;
        }
        let mut strips = Strips { list, half_width, corner: low - half_width, columns: 0, cells: Vec::new() };
        strips.fill(high + half_width);
        strips
    }

    fn fill(&mut self, high: DVec2) {
        if self.list.is_empty() {
            return;
        }
        let side = 2.0 * self.half_width;
        let [columns, rows] = ((high - self.corner) / side).ceil().to_array().map(|n| n as usize + 1);
        (self.columns, self.cells) = (columns, vec![Vec::new(); columns * rows]);
        for (k, s) in self.list.iter().enumerate() {
            let b = s.a + s.along * s.length;
            let cell = |p: DVec2| ((p - self.corner) / side).floor().max(DVec2::ZERO).to_array().map(|n| n as usize);
            let [x0, y0] = cell(s.a.min(b) - self.half_width);
            let [x1, y1] = cell(s.a.max(b) + self.half_width);
            for (y, x) in (y0..=y1.min(rows - 1)).flat_map(|y| (x0..=x1.min(columns - 1)).map(move |x| (y, x))) {
                self.cells[y * columns + x].push(k as u32);
            }
        }
    }

    /// Those that may hold a film point.
    fn around(&self, film: [f64; 2]) -> impl Iterator<Item = (u32, &Strip)> {
        let at = ((DVec2::from_array(film) - self.corner) / (2.0 * self.half_width)).floor();
        let inside = !self.list.is_empty() && at.min_element() >= 0.0 && at.x < self.columns as f64;
        let cell = inside.then(|| self.cells.get(at.y as usize * self.columns + at.x as usize)).flatten();
        cell.into_iter().flatten().map(|&k| (k, &self.list[k as usize]))
    }
}

/// The part of a segment inside a box.
fn clip(a: DVec2, b: DVec2, low: DVec2, high: DVec2) -> Option<[DVec2; 2]> {
    let (mut t0, mut t1) = (0.0f64, 1.0f64);
    for k in 0..2 {
        let d = b[k] - a[k];
        if d == 0.0 && (a[k] < low[k] || a[k] > high[k]) {
            return None;
        }
        if d != 0.0 {
            let (u, v) = ((low[k] - a[k]) / d, (high[k] - a[k]) / d);
            (t0, t1) = (t0.max(u.min(v)), t1.min(u.max(v)));
        }
    }
    (t0 < t1).then(|| [a.lerp(b, t0), a.lerp(b, t1)])
}

#[cfg(test)]
#[path = "limb_tests.rs"]
mod tests;
