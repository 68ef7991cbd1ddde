//! How a connection by flat smooth faces ([`super::pane`], [`super::chain`]), or by a ball of metal ([`super::ball`]), changes ([T] 6.2). All about its way is [`super::smooth_way`]'s, in dual numbers over whatever moves.
//!
//! *As its light moves* ([`partials`], the counterpart of [`super::aim`]): the vertex x and the faces stay where they are. The points of crossing slide over the faces, (46); directions and lengths of all lines, the light's share (42) and G (47)
//! follow, in dual numbers over the light's position, or over its direction if it is at infinity. What is left are scores on what turns:
//!
//! * scattering at x: `f'/f <-ω̇>`, ω the direction of the light behind the last face;
//! * a spot's profile: its slope times `<axis, ω̇₀>`, ω₀ the direction before the first;
//! * optical depths of all lines, ∫ <∇σ, ẏ> along them, with borders and ends as [`super::aim`] has them; lines before the last face move at both of their ends.
//!
//! *As the vertex, the faces and their indices do* ([`WayConnection`], a leg of [`super::motion`]): the same, in dual numbers over the vertex and over each face in turn. All lines are rays in motion ([`MovingRay`]): from x against the light, starting with ẋ
//! and turning with -ω̇, and so on from the points of crossing, to the light, which stays.
//!
//! All of it is linear in slots: forward and reverse mode read the same numbers. Known to be noisy: connections mirrored near total reflection, where F has the slope δ^-1/2 (the second moment grows like a logarithm).

use super::aim::{self, Line, Turn};
use super::first::FilmLine;
use super::motion::{Chained, Moving};
use super::piece::{Piece, Stop};
use super::ray::MovingRay;
use super::smooth_way::{Face, Faces, Form, Matter, SmoothWay};
use super::specular;
use super::velocity::{Source, Velocity};
use crate::light::{Light, LightKind, Origin, spot_falloff};
use crate::math::rng::Rng;
use crate::math::{DMat3, DVec3, Dual, Rgb, V3, fresnel, gradient};
use crate::params::{Covector, ParamSet, Sink, Slot};
use crate::scene::beams::Step;
use crate::scene::{Hit, On, Scene};
use crate::shape::Shape;
use crate::surface::Surface;
use smallvec::SmallVec;

/// Numbers that a way is differentiated by at once: of its ends the vertex and the light; of a face a point and its normal, of a ball its centre and a point on it, and the indices behind its front side and before it.
const NUMBERS: usize = 8;
const LIGHT: usize = 3;
const NORMAL: usize = 3;
const INDICES: usize = 6;

type D = Dual<NUMBERS>;

/// Of what they are.
#[derive(Clone, Copy, PartialEq)]
enum Group {
    Ends,
    Face(usize),
}

/// What tells where a face is.
enum Vectors {
    /// A point, and the normal.
    Plane([DVec3; 2]),
    /// The centre, and a point on it.
    Ball([DVec3; 2]),
}

/// `is_idle`: a plane that does nothing.
fn vectors(scene: &Scene, s: &Step, is_idle: bool) -> Vectors {
    match &scene.shapes[s.shape as usize].shape {
        Shape::Sphere(q) if !is_idle => Vectors::Ball([q.center, s.p]),
        _ => Vectors::Plane([s.p, s.n]),
    }
}

/// Steps of a way from a light of this origin to x, one of which may be a plane that does nothing.
fn way(
    scene: &Scene,
    (steps, idle): (&[Step], Option<usize>),
    points: [DVec3; 2],
    from: Origin<f64>,
    group: Group,
) -> Option<SmoothWay<D>> {
    let ends = group == Group::Ends;
    let at = |v: DVec3, first: usize| if ends { V3::variable(v, first) } else { V3::constant(v) };
    let face = |(i, s): (usize, &Step)| {
        let own = group == Group::Face(i);
        let at = |v: DVec3, first: usize| if own { V3::variable(v, first) } else { V3::constant(v) };
        let index = |v: f64, k: usize| if own { D::variable(v, INDICES + k) } else { D::constant(v) };
        let form = match vectors(scene, s, idle == Some(i)) {
            Vectors::Plane([p, n]) => Form::Plane { p: at(p, 0), n: at(n, NORMAL) },
            Vectors::Ball([center, rim]) => {
                let within = s.before.dot(rim - center) > 0.0;
                Form::Ball { center: at(center, 0), rim: at(rim, NORMAL), within }
            }
        };
        let matter = match scene.surface_of(s.shape) {
            _ if idle == Some(i) => Matter::Dielectric([D::constant(1.0); 2]),
            Surface::Dielectric { interior, exterior, .. } => {
                let sides = [index(*interior, 0), index(*exterior, 1)];
                Matter::Dielectric(if s.before.dot(s.n) < 0.0 { [sides[1], sides[0]] } else { sides })
            }
            Surface::Conductor { eta, k, .. } => Matter::Conductor { eta: *eta, k: *k },
            _ => return None,
        };
        Some(Face { form, through: s.through, matter })
    };
    let from = match from {
        Origin::Position(q) => Origin::Position(at(q.value(), LIGHT)),
        Origin::Infinity(w) => Origin::Infinity(at(w.value(), LIGHT)),
    };
    let list = steps.iter().enumerate().map(face).collect::<Option<_>>()?;
    let [first, x] = points;
    Faces { from, before: steps.first()?.before, first, list, x: at(x, 0) }.way()
}

/// Three derivatives of a vector.
fn columns(v: V3<D>, first: usize) -> [DVec3; 3] {
    std::array::from_fn(|k| column(&v, first + k))
}

fn column(v: &V3<D>, k: usize) -> DVec3 {
    DVec3::new(v.x.d[k], v.y.d[k], v.z.d[k])
}

/// Derivatives of the logarithm of what the way makes of light, by one number.
fn share(gain: &[D; 3], k: usize) -> Rgb {
    Rgb::from_fn(|c| if gain[c].v == 0.0 { 0.0 } else { gain[c].d[k] / gain[c].v })
}

/// A connection to a light that moves.
#[derive(Clone, Copy, Debug)]
pub struct WayAim {
    pub light: u32,
    /// Its steps, the first of the record's and their number, and where light meets the first of them.
    pub steps: [u32; 2],
    pub first: DVec3,
    pub x: DVec3,
    /// Faces and medium at x, toward the last face.
    pub on: On,
    pub medium: Option<u32>,
    pub turn: Turn,
    /// For points of line integrals through grids.
    pub rng: Rng,
}

/// Hand the partials of a connection of this `value` by these steps to `sink`: position, direction and angles of its light.
pub fn partials(scene: &Scene, params: &ParamSet, (aim, steps): (&WayAim, &[Step]), value: Rgb, sink: &mut impl Sink) {
    let light = &scene.lights[aim.light as usize];
    let slot = match light.kind {
        LightKind::Point { .. } | LightKind::Spot { .. } => light.place.position,
        LightKind::Directional { .. } => light.place.direction,
        _ => return,
    };
    let Some(w) = light.origin().and_then(|from| way(scene, (steps, None), [aim.first, aim.x], from, Group::Ends))
    else {
        return;
    };
    let (Some(before), Some(behind)) = (w.w.first(), w.w.last()) else { return };
    let profile = aim::profile(light, params, -before.value(), value, true, sink);
    let turning = aim.turn.score(scene, -behind.value());
    let (before, behind) = (columns(*before, LIGHT), columns(*behind, LIGHT));
    let mut score: [Rgb; 3] = std::array::from_fn(|k| {
        share(&w.gain, LIGHT + k) + Rgb::splat(profile.dot(before[k])) - turning.dot(behind[k])
    });
    depths(scene, (aim, steps), &w, |k, d| score[k] += -d);
    aim::vector(params, slot, |k| value * score[k], sink);
}

/// How the optical depth of all lines changes, by each of the light's three numbers.
fn depths(scene: &Scene, (aim, steps): (&WayAim, &[Step]), way: &SmoothWay<D>, mut add: impl FnMut(usize, Rgb)) {
    let mut rng = aim.rng;
    let (mut o, mut on, mut medium) = (V3::<D>::constant(aim.x), aim.on, aim.medium);
    // Back from x.
    for k in (0..way.w.len()).rev() {
        let (w, length) = (way.w[k], way.lengths[k]);
        let line = Line { o: o.value(), w: -w.value(), length: length.v, medium, on, within: false };
        let (start, turn) = (columns(o, LIGHT), columns(w, LIGHT));
        let mut changes = [Rgb::ZERO; 3];
        let passes = |v: DVec3, s: f64, sigma: Rgb| {
            (0..3).for_each(|k| add(k, sigma * v.dot(start[k] - turn[k] * s)));
        };
        let growing = |sigma: Rgb| (0..3).for_each(|k| changes[k] += sigma * length.d[LIGHT + k]);
        let ray = aim::optical_depth(scene, &line, &mut rng, passes, growing);
        (0..3).for_each(|k| add(k, changes[k]));
        let Some(step) = k.checked_sub(1).map(|i| &steps[i]) else { break };
        o = way.at[k - 1];
        // As far from the last border as it is: what that was is not here.
        let hit = Hit { t: ray.left(line.length), ..scene.hit_at(o.value(), step.shape, step.face) };
        on = specular::left(&ray.on, &hit, line.w, step.through, scene.tolerance(hit.p));
        let beyond = || scene.shapes[step.shape as usize].medium_behind(line.w, step.n, ray.medium);
        medium = if step.through { beyond() } else { ray.medium };
    }
}

/// What moves, or changes, of a way, and what the way does with it.
struct Part {
    /// Of vectors, each by three numbers.
    vectors: SmallVec<[Velocity; 2]>,
    /// The dielectric's slots that change.
    indices: [Option<Slot>; 2],
    way: SmoothWay<D>,
}

type Parts = SmallVec<[Part; 4]>;

/// All that moves or changes of a way; its ends first.
fn parts(
    scene: &Scene,
    moving: &Moving,
    from: Origin<f64>,
    (steps, idle): (&[Step], Option<usize>),
    [first, x]: [DVec3; 2],
) -> Option<Parts> {
    let here = SmallVec::from_iter([Velocity::of(Source::Here, x)]);
    let ends = way(scene, (steps, idle), [first, x], from, Group::Ends)?;
    let mut parts = SmallVec::from_iter([Part { vectors: here, indices: [None; 2], way: ends }]);
    add_faces(&mut parts, scene, moving, from, (steps, idle), [first, x])?;
    Some(parts)
}

fn add_faces(
    parts: &mut Parts,
    scene: &Scene,
    moving: &Moving,
    from: Origin<f64>,
    (steps, idle): (&[Step], Option<usize>),
    points: [DVec3; 2],
) -> Option<()> {
    for (i, s) in steps.iter().enumerate().filter(|(i, _)| idle != Some(*i)) {
        let matter = Source::Shape { shape: s.shape, face: s.face };
        let own = moving.moves(s.shape).then(|| match vectors(scene, s, false) {
            Vectors::Plane([p, n]) => [Velocity::of(matter, p), Velocity::of_normal(matter, p, n)],
            Vectors::Ball(points) => points.map(|p| Velocity::of(matter, p)),
        });
        let indices = match *scene.surface_of(s.shape) {
            Surface::Dielectric { slot, .. } => [slot, slot + 1].map(|s| Some(s).filter(|s| moving.is_index(*s))),
            _ => [None; 2],
        };
        if own.is_some() || indices.iter().any(Option::is_some) {
            let vectors = own.into_iter().flatten().collect();
            let way = way(scene, (steps, idle), points, from, Group::Face(i))?;
            parts.push(Part { vectors, indices, way });
        }
    }
    Some(())
}

/// How a vector of the way moves.
fn velocity(parts: &[Part], of: impl Fn(&SmoothWay<D>) -> V3<D>) -> Velocity {
    let mut sum = Velocity::default();
    for part in parts {
        let v = of(&part.way);
        for (j, own) in part.vectors.iter().enumerate() {
            let [x, y, z] = columns(v, 3 * j);
            sum.add(&DMat3::from_cols(x, y, z), own);
        }
        let changed = part.indices.iter().enumerate().filter_map(|(k, s)| Some((s.as_ref()?, k)));
        changed.for_each(|(s, k)| sum.add_value(*s, column(&v, INDICES + k)));
    }
    sum
}

/// How the point where a way meets one of its planes moves.
pub struct Slide<'a> {
    scene: &'a Scene,
    from: Origin<f64>,
    steps: (&'a [Step], Option<usize>),
    points: [DVec3; 2],
    plane: usize,
    ends: SmoothWay<D>,
}

impl<'a> Slide<'a> {
    /// On face number `plane` of those that light meets in turn, beginning at the first of `points`, on its way to the second. One of the steps may be no face: it does nothing and stays.
    pub fn new(
        scene: &'a Scene,
        from: Origin<f64>,
        steps: (&'a [Step], Option<usize>),
        points: [DVec3; 2],
        plane: usize,
    ) -> Option<Slide<'a>> {
        let ends = way(scene, steps, points, from, Group::Ends)?;
        Some(Slide { scene, from, steps, points, plane, ends })
    }

    /// Derivatives of `<m, x_k>` by the end of the way, and by the light's position, or its direction at infinity.
    pub fn by_ends(&self, m: DVec3) -> [DVec3; 2] {
        [0, LIGHT].map(|first| DVec3::from_array(columns(self.ends.at[self.plane], first).map(|v| m.dot(v))))
    }

    /// How it moves with the faces, their indices and the end, which moves with `start`.
    pub fn velocity(&self, moving: &Moving, start: &Velocity) -> Option<Velocity> {
        let mut faces = Parts::new();
        add_faces(&mut faces, self.scene, moving, self.from, self.steps, self.points)?;
        let [x, y, z] = columns(self.ends.at[self.plane], 0);
        let mut sum = velocity(&faces, |w| w.at[self.plane]);
        sum.add(&DMat3::from_cols(x, y, z), start);
        Some(sum)
    }
}

/// A connection by faces that move, or from a vertex that does, to a light that stays.
pub struct WayConnection<'a> {
    scene: &'a Scene,
    light: &'a Light,
    steps: &'a [Step],
    x: DVec3,
    value: Rgb,
    parts: Parts,
}

impl<'a> WayConnection<'a> {
    /// `first`: where light meets the first step.
    pub fn new<S: Sink>(
        cx: &Chained<'a, S>,
        light: u32,
        (steps, first): (&'a [Step], DVec3),
        x: DVec3,
        value: Rgb,
    ) -> Option<Self> {
        let scene = cx.scene;
        let light = &scene.lights[light as usize];
        let from = light.origin()?;
        let parts = parts(scene, cx.moving, from, (steps, None), [first, x])?;
        Some(WayConnection { scene, light, steps, x, value, parts })
    }

    fn way(&self) -> &SmoothWay<D> {
        &self.parts[0].way
    }

    /// The direction in which it leaves the vertex.
    pub fn toward(&self) -> DVec3 {
        -self.way().w[self.steps.len()].value()
    }

    fn velocity(&self, of: impl Fn(&SmoothWay<D>) -> V3<D>) -> Velocity {
        velocity(&self.parts, of)
    }

    /// Hands out its partials; what it asks of ẋ is added to `at`. `turning`: on how the direction in which it leaves turns.
    pub fn partials<S: Sink>(&self, cx: &mut Chained<S>, turning: &Covector, pieces: &[Piece], at: &mut Covector) {
        let (scene, way, value) = (self.scene, self.way(), self.value);
        let last = self.steps.len();
        let turns: SmallVec<[Velocity; 4]> = (0..=last).map(|k| self.velocity(|w| w.w[k])).collect();
        let mut apply = |v: &Velocity, form: &Covector, sink: &mut S| v.settle(scene, cx.sensor, form, at, sink);

        // What the faces make of the light, per channel.
        for part in &self.parts {
            let own = |k: usize| value * share(&part.way.gain, k);
            for (j, v) in part.vectors.iter().enumerate() {
                apply(v, &Covector(std::array::from_fn(|k| own(3 * j + k))), cx.sink);
            }
            for (k, slot) in part.indices.iter().enumerate() {
                slot.iter().for_each(|s| cx.sink.add(*s, own(INDICES + k)));
            }
        }
        for s in self.steps.iter().filter(|s| !s.through) {
            let surface = scene.shapes[s.shape as usize].surface as usize;
            if cx.moving.refracts(surface) {
                metal(&scene.surfaces[surface], s, value, cx.sink);
            }
        }
        apply(&turns[last], &turning.scaled(-1.0), cx.sink);
        if let LightKind::Spot { axis, beam, cutoff, .. } = self.light.kind {
            let cosine = way.w[0].value().dot(axis);
            let (s, [ds]) = gradient([cosine], |[c]| spot_falloff(c, beam.into(), cutoff.into()));
            if s > 0.0 {
                let mut form = Covector::default();
                form.add(axis, value * (ds / s));
                apply(&turns[0], &form, cx.sink);
            }
        }

        // Back from the vertex to the last face, and from there to the light.
        let lines: SmallVec<[(MovingRay, [DVec3; 2], f64); 4]> = (0..=last)
            .rev()
            .map(|k| {
                let (o, start) = match way.at.get(k) {
                    Some(p) => (p.value(), self.velocity(|w| w.at[k])),
                    None => (self.x, Velocity::of(Source::Here, self.x)),
                };
                let w = -way.w[k].value();
                let ray = MovingRay::new(o, w, start, turns[k].clone().mapped(-DMat3::IDENTITY));
                (ray, [o, w], way.lengths[k].v * (1.0 + 1e-9) + scene.tolerance(o))
            })
            .collect();
        let mut k = 0;
        for piece in pieces {
            while k < last && !piece.lies_on(lines[k].1[0], lines[k].1[1], lines[k].2) {
                k += 1;
            }
            let line = FilmLine { scene, moving: cx.moving, ray: &lines[k].0 };
            let mut ends = line.ends(piece);
            // The light itself.
            if k == last && piece.to == Stop::Free {
                ends[1] = Velocity::default();
            }
            for (velocity, form) in ends.iter().zip(piece.depth_forms(scene)) {
                apply(velocity, &form.weighed(-value), cx.sink);
            }
        }
    }
}

/// The mirrored share of metal, by its complex index.
fn metal(surface: &Surface, s: &Step, value: Rgb, sink: &mut impl Sink) {
    let Surface::Conductor { eta, k, slot, .. } = *surface else { return };
    let cosine = s.before.dot(s.n).abs();
    for c in 0..3 {
        let (f, by) = gradient([eta[c], k[c]], |[eta, k]| fresnel::conductor(cosine.into(), eta, k));
        if f > 0.0 {
            sink.add(slot + c as Slot, Rgb::channel(c, value[c] * by[0] / f));
            sink.add(slot + 3 + c as Slot, Rgb::channel(c, value[c] * by[1] / f));
        }
    }
}
