//! Straight lines through media: their spans with optical depths, and points drawn on them.
//!
//! A grid is crossed once: depths up to its bricks are kept ([`Profile`]). Lines of *bounds* do not cross the cells of fine grids at all: their depths are those of tentative collisions, of which the
//! first is forced ([`Line::force`]) and a flight goes on from there ([`Line::fly_on`]).

use super::record::MediumSpan;
use super::state::State;
use super::tracking;
use crate::math::rng::{Apart, Rng};
use crate::math::{DVec3, Rgb};
use crate::medium::Volume;
use crate::medium::grid::{Place, Profile};
use crate::scene::{Hit, March, On, Scene};
use smallvec::SmallVec;
use std::cell::OnceCell;

/// One span of a line, with the optical depth in front of it and in it (of bounds, where the line has them).
pub struct Part {
    pub span: MediumSpan,
    pub before: Rgb,
    pub depth: Rgb,
    /// Of the density, where that is a grid of one channel.
    profile: Option<Profile>,
}

/// A collision forced inside a line.
pub struct Forced {
    pub piece: usize,
    pub t: f64,
    pub hero: usize,
    /// Of a line of bounds, the collision is tentative here: the extinction that stands in for the medium's.
    pub bound: Option<f64>,
}

/// Spans in order.
#[derive(Default)]
pub struct Line {
    pub parts: Vec<Part>,
    /// Optical depth of all of it.
    pub total: Rgb,
    /// Whether bounds stand in for any grid.
    pub bounded: bool,
    /// Whether any of its media has an extinction a channel. The total does not tell: without an end it is infinite in all of them.
    pub chromatic: bool,
    /// The medium at its end.
    pub last: Option<u32>,
    /// The same line without bounds, once it has been asked for.
    exact: OnceCell<Box<Line>>,
}

impl Line {
    pub fn push(&mut self, scene: &Scene, span: MediumSpan) {
        let grid = scene.media[span.medium as usize].density_grid();
        self.add(scene, span, grid.and_then(|g| g.profile(span.o, span.w, span.t0, span.t1)));
    }

    /// The same by bounds where they are worth it, in media that scatter; for lines that are gray.
    pub fn push_bounds(&mut self, scene: &Scene, span: MediumSpan) {
        let m = &scene.media[span.medium as usize];
        let grid = m.density_grid().filter(|_| m.gray && !m.sigma_s.is_zero());
        self.add(scene, span, grid.and_then(|g| g.bounds(span.o, span.w, span.t0, span.t1, m.scale)));
    }

    fn add(&mut self, scene: &Scene, span: MediumSpan, profile: Option<Profile>) {
        let m = &scene.media[span.medium as usize];
        let depth = match &profile {
            Some(p) => Rgb::splat(p.total()) * m.scale,
            None => tracking::depth(m, &span),
        };
        self.bounded |= profile.as_ref().is_some_and(Profile::is_bound);
        self.parts.push(Part { span, before: self.total, depth, profile });
        self.total += depth;
        self.chromatic |= !m.gray;
    }

    /// The same without bounds: every cell is crossed.
    pub fn crossed(&self, scene: &Scene) -> Line {
        let mut line = Line { last: self.last, ..Line::default() };
        self.parts.iter().for_each(|part| line.push(scene, part.span));
        line
    }

    /// Itself, if it has no bounds.
    pub fn exact(&self, scene: &Scene) -> &Line {
        if self.bounded { self.exact.get_or_init(|| Box::new(self.crossed(scene))) } else { self }
    }

    /// The depth in front of part `k`, not of bounds.
    pub fn exact_before(&self, scene: &Scene, k: usize) -> Rgb {
        // Nothing lies in front of the first.
        let line = if k > 0 { self.exact(scene) } else { self };
        line.parts.get(k).map_or(line.total, |part| part.before)
    }

    /// From `o`, in `medium`, to the distance `t_max`, with nothing opaque on the way; `None` after too many interfaces.
    pub fn clear(scene: &Scene, o: DVec3, w: DVec3, t_max: f64, medium: Option<u32>) -> Option<Line> {
        let (mut line, mut ray) = (Line::default(), March::new(o, w, On::default(), medium));
        for _ in 0..scene.max_interfaces {
            let left = ray.left(t_max);
            let hit = ray.boundary(scene, left);
            if let Some(span) = MediumSpan::ahead(&ray, left, hit.as_ref()) {
                line.push(scene, span);
            }
            let Some(h) = hit else {
                line.last = ray.medium;
                return Some(line);
            };
            ray.pass(scene, &h);
        }
        None
    }

    /// From `o` on the faces `on`, in `medium`, to the first surface that is not passed unchanged, with that; `None` after too many interfaces. Without spans unless it is `weighed`.
    pub fn to_surface(
        scene: &Scene,
        o: DVec3,
        w: DVec3,
        on: &On,
        medium: Option<u32>,
        weighed: bool,
    ) -> Option<(Line, Option<Hit>)> {
        let (mut line, mut ray) = (Line::default(), March::new(o, w, *on, medium));
        for _ in 0..scene.max_interfaces {
            let hit = ray.meets(scene, f64::INFINITY);
            if let Some(span) = MediumSpan::ahead(&ray, f64::INFINITY, hit.as_ref()).filter(|_| weighed) {
                line.push(scene, span);
            }
            line.last = ray.medium;
            let Some(h) = hit else { return Some((line, None)) };
            if !scene.passes(&h) {
                return Some((line, Some(Hit { t: (h.p - o).dot(w), ..h })));
            }
            ray.pass(scene, &h);
        }
        None
    }

    /// Of a line of bounds, what passes for certain.
    pub fn transmittance(&self) -> Rgb {
        self.total.map(|t| (-t).exp())
    }

    /// Transmittance up to `t` of the span of part `k` (not of bounds).
    pub fn transmittance_to(&self, scene: &Scene, k: usize, t: f64) -> Rgb {
        debug_assert!(!self.bounded);
        self.parts[k].depth_to(scene, t).map(|t| (-t).exp())
    }

    /// A collision somewhere on the line, with the density [`Line::density`]: the truncated exponential of the hero's optical depth inverted ([T] section 9); gray grids only.
    pub fn force(&self, scene: &Scene, rng: &mut Rng) -> Forced {
        // Channels with nothing to collide with are never the hero.
        let total = self.total;
        let hero = if !self.chromatic || total.is_zero() {
            0
        } else {
            let lit: SmallVec<[usize; 3]> = (0..3).filter(|&c| total[c] > 0.0).collect();
            lit[((rng.uniform() * lit.len() as f64) as usize).min(lit.len() - 1)]
        };
        let target = tracking::truncated(rng.uniform(), total[hero]);
        let mut last = Forced { piece: 0, t: 0.0, hero, bound: None };
        for (piece, part) in self.parts.iter().enumerate().filter(|(_, part)| part.depth[hero] > 0.0) {
            let depth = (target - part.before[hero]).max(0.0);
            let place = part.place(scene, hero, depth);
            last = Forced { piece, t: place.t, hero, bound: place.bound };
            if depth < part.depth[hero] {
                break;
            }
        }
        last
    }

    /// Where a flight ends that has a tentative collision there: it collides (part and abscissa; the albedo is put to `s`), or passes all that is left.
    pub fn fly_on(&self, scene: &Scene, from: &Forced, random: &mut Apart, s: &mut State) -> Option<(usize, f64)> {
        let medium = |part: &Part| &scene.media[part.span.medium as usize];
        let part = &self.parts[from.piece];
        let (m, p) = (medium(part), part.span.o + part.span.w * from.t);
        if from.bound.is_none_or(|bound| random.rng().uniform() * bound < m.density.at(p)[0] * m.scale) {
            s.beta *= m.albedo_at(p);
            return Some((from.piece, from.t));
        }
        let rest = MediumSpan { t0: from.t, ..part.span };
        let spans = self.parts.iter().enumerate().skip(from.piece + 1).map(|(k, part)| (k, medium(part), part.span));
        std::iter::once((from.piece, m, rest))
            .chain(spans)
            .find_map(|(k, m, span)| tracking::fly(m, &span, s).map(|t| (k, t)))
    }

    /// What collides on it of the light that sets out, `1 - T`.
    pub fn collides(&self) -> Rgb {
        self.total.map(|t| -(-t).exp_m1())
    }

    /// Density per length of the forced collision at `t` of part `k`, per channel.
    pub fn density(&self, scene: &Scene, k: usize, t: f64) -> Rgb {
        debug_assert!(!self.bounded);
        self.parts[k].forced_density(scene, self.collides(), t)
    }

    /// The same whichever channel leads.
    pub fn mean_density(&self, scene: &Scene, k: usize, t: f64) -> f64 {
        let d = self.density(scene, k, t);
        let lit = (0..3).filter(|&c| self.total[c] > 0.0).count();
        if lit > 0 { d.sum() / lit as f64 } else { 0.0 }
    }

    /// The part that holds the distance `s` from the line's start, and its abscissa there.
    pub fn locate(&self, start: DVec3, s: f64) -> Option<(usize, f64)> {
        self.parts.iter().enumerate().find_map(|(k, q)| {
            let t = s - (q.span.o - start).dot(q.span.w);
            (t >= q.span.t0 && t <= q.span.t1).then_some((k, t))
        })
    }
}

impl Part {
    /// Optical depth of the line up to `t` of the span, per channel; of bounds, where it has them.
    pub fn depth_to(&self, scene: &Scene, t: f64) -> Rgb {
        self.before + self.depth_within(scene, t)
    }

    /// The same from the span's start.
    pub fn depth_within(&self, scene: &Scene, t: f64) -> Rgb {
        let m = &scene.media[self.span.medium as usize];
        match (&self.profile, m.density_grid()) {
            (Some(p), Some(grid)) => Rgb::splat(p.until(grid, t)) * m.scale,
            _ => tracking::depth(m, &self.span.until(t)),
        }
    }

    /// Where the span has this optical depth in front of it, in a channel: at its end if all of it is less.
    pub fn at_depth(&self, scene: &Scene, channel: usize, depth: f64) -> f64 {
        self.place(scene, channel, depth).t
    }

    fn place(&self, scene: &Scene, channel: usize, depth: f64) -> Place {
        let (span, m) = (&self.span, &scene.media[self.span.medium as usize]);
        let end = Place { t: span.t1, bound: None };
        let exact = |t: f64| Place { t, bound: None };
        match (&self.profile, &m.density) {
            (Some(p), Volume::Grid(grid)) => p
                .invert(grid, depth / m.scale)
                .map_or(end, |place| Place { bound: place.bound.map(|b| b * m.scale), ..place }),
            (None, Volume::Grid(grid)) => {
                grid.invert(span.o, span.w, span.t0, span.t1, depth / m.scale).map_or(end, exact)
            }
            (_, Volume::Constant(_)) => exact((span.t0 + depth / m.sigma_t[channel]).min(span.t1)),
        }
    }

    /// Density per length of a collision forced on a line on which `collides` does ([`Line::collides`]), at `t` of the span, per channel.
    pub fn forced_density(&self, scene: &Scene, collides: Rgb, t: f64) -> Rgb {
        let m = &scene.media[self.span.medium as usize];
        let depth = self.depth_to(scene, t);
        let (sigma_t, _) = m.coefficients(self.span.o + self.span.w * t);
        // 1 - T of nothing is nothing: no collision is forced there.
        Rgb::from_fn(|c| if collides[c] > 0.0 { sigma_t[c] * (-depth[c]).exp() / collides[c] } else { 0.0 })
    }

    /// A point of the span between `lo` and `hi` with density proportional (homogeneous) or related (grids) to transmittance, and its weight per channel:
    /// `E[weight g(t)] = integral of T g`, T from `lo` on [T] (53). `None` where that is nothing, or an unbounded vacuum.
    pub fn transmittance_point(&self, scene: &Scene, [lo, hi]: [f64; 2], rng: &mut Rng) -> Option<(f64, Rgb)> {
        let m = &scene.media[self.span.medium as usize];
        let (c, u, length) = (((rng.uniform() * 3.0) as usize).min(2), rng.uniform(), hi - lo);
        match &m.density {
            Volume::Constant(_) => {
                let (sigma, depth) = (m.sigma_t, tracking::depth(m, &MediumSpan { t0: lo, t1: hi, ..self.span }));
                if length == f64::INFINITY && sigma.min() <= 0.0 {
                    return None;
                }
                // t = -log1p(-u (1 - e^{-sigma D})) / sigma, uniform where sigma D is tiny.
                let t = if depth[c] < 1e-8 { u * length } else { -(-(u * -(-depth[c]).exp_m1())).ln_1p() / sigma[c] };
                let density = Rgb::from_fn(|k| {
                    let total = if depth[k] < 1e-8 { length } else { -(-depth[k]).exp_m1() / sigma[k] };
                    (-sigma[k] * t).exp() / total
                })
                .mean();
                Some((lo + t, sigma.map(|x| (-x * t).exp()) * (1.0 / density)))
            }
            Volume::Grid(grid) => {
                // The walked part of an analog flight, a uniform point on it.
                let (lo, hi) = grid.clip_ray(self.span.o, self.span.w, lo, hi);
                if hi <= lo {
                    return None;
                }
                let end = if self.profile.as_ref().is_some_and(Profile::is_bound) {
                    let way = MediumSpan { t0: lo, t1: hi, ..self.span };
                    tracking::flight(m, grid, &way, 0, rng, |_, _| ()).unwrap_or(hi)
                } else {
                    self.at_depth(scene, 0, self.depth_within(scene, lo)[0] + rng.exponential()).min(hi)
                };
                Some((lo + u * (end - lo), Rgb::splat(end - lo)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::medium::grid::vol::Vol;
    use crate::scene::compile::LoadOptions;
    use crate::scene::desc::SceneDesc;

    /// Two columns of smoke, 1 + 0.9 sin(2 pi z) over a unit of z, in 256 voxels each, and even fog between them.
    fn scene(scale: f64) -> Scene {
        let dir = tempfile::tempdir().unwrap();
        let n = 256;
        let wave = |k: usize| 1.0 + 0.9 * (2.0 * std::f64::consts::PI * (k as f64 + 0.5) / n as f64).sin();
        let values = (0..n).map(|k| wave(k) as f32).collect();
        let path = dir.path().join("wave.vol");
        Vol { res: [1, 1, n], channels: 1, bbox: [[0.0; 3], [1.0; 3]], values }.write(&path).unwrap();
        let cube = |z: f64, id: &str| {
            format!(
                r#"<shape type="cube"><transform name="to_world"><scale x="5" y="5" z="0.5"/><translate z="{}"/></transform>
                <bsdf type="null"/><ref name="interior" id="{id}"/></shape>"#,
                z + 0.5
            )
        };
        let smoke = |z: f64, id: &str| {
            format!(
                r#"<medium type="heterogeneous" id="{id}"><float name="scale" value="{scale}"/><rgb name="albedo" value="0.5"/>
                <volume name="sigma_t" type="gridvolume"><string name="filename" value="{}"/>
                <transform name="to_world"><translate x="-0.5" y="-0.5"/><scale x="10" y="10" z="1"/><translate z="{z}"/></transform></volume></medium>{}"#,
                path.display(),
                cube(z, id)
            )
        };
        let text = format!(
            r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/>{}{}
            <medium type="homogeneous" id="fog"><rgb name="sigma_t" value="0.3"/><rgb name="albedo" value="0.5"/></medium>{}<emitter type="constant"/></scene>"#,
            smoke(0.0, "near"),
            smoke(2.0, "far"),
            cube(1.0, "fog")
        );
        let desc = SceneDesc::parse(&text, std::path::Path::new("line.xml"), &[]).unwrap();
        Scene::compile(&desc, &LoadOptions::default()).unwrap()
    }

    /// The forced tentative collision and the flight behind it collide with the density of a flight: what collides in front of a place, and what passes all, add up to `1 - T` and T.
    /// 4.5 s.e. at 16 places (false alarm 1e-4).
    #[test]
    fn flights_from_bounds_follow_the_transmittance() {
        for scale in [0.4, 3.0] {
            let scene = scene(scale);
            let (o, w) = (DVec3::new(0.1, 0.2, -1.0), DVec3::new(0.1, -0.05, 1.0).normalize());
            let mut line = Line::default();
            let mut ray = March::new(o, w, On::default(), None);
            while let Some(hit) = ray.meets(&scene, f64::INFINITY) {
                if let Some(span) = MediumSpan::ahead(&ray, f64::INFINITY, Some(&hit)) {
                    line.push_bounds(&scene, span);
                }
                ray.pass(&scene, &hit);
            }
            let exact = line.crossed(&scene);
            assert!(line.bounded && !exact.bounded && line.parts.len() == 3);
            assert!(line.total[0] > exact.total[0] * 1.02, "{} {}", line.total[0], exact.total[0]);
            assert_eq!(line.exact_before(&scene, 3), exact.total);
            let n = 40_000;
            let forced = -(-line.total[0]).exp_m1();
            let (mut ends, mut rejected) = (Vec::with_capacity(n), 0);
            for i in 0..n {
                let mut s = State::new(Rng::keyed(3, 1, i as u64, 0), o, w, None);
                let mut apart = s.rng.apart();
                let tentative = line.force(&scene, &mut s.rng);
                let end = line.fly_on(&scene, &tentative, &mut apart, &mut s);
                assert_eq!(s.beta, Rgb::splat(if end.is_some() { 0.5 } else { 1.0 }));
                rejected += usize::from(end.is_none_or(|(k, t)| (k, t) != (tentative.piece, tentative.t)));
                ends.push(end);
            }
            assert!(rejected > n / 50, "bounds are hardly too large: {rejected}");
            for (k, share) in (0..3).flat_map(|k| [0.25, 0.5, 0.75, 1.0].map(|share| (k, share))) {
                let span = &line.parts[k].span;
                let to = span.t0 + share * (span.t1 - span.t0);
                let truth = -(-exact.parts[k].depth_to(&scene, to)[0]).exp_m1();
                let before =
                    ends.iter().flatten().filter(|&&(j, t)| j < k || j == k && t < to).count() as f64 / n as f64;
                let error = forced * (before * (1.0 - before) / n as f64).sqrt();
                assert!(
                    (forced * before - truth).abs() <= 4.5 * error,
                    "{scale}, {k} {share}: {} {truth} {error}",
                    forced * before
                );
            }
        }
    }
}
