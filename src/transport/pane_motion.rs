//! How a connection by a flat smooth face ([`super::pane`]) changes ([T] 6.2).
//!
//! *As its light moves* ([`partials`], the counterpart of [`super::aim`]): the vertex x and the face stay where they are. The point of crossing slides over the face, (46); direction and length of both lines, the light's share (42) and G (47) follow. All are formulas of
//! [`super::pane::reach`], here in dual numbers over the light's position, or over its direction if it is at infinity. What is left are scores on what turns:
//!
//! * scattering at x: `f'/f <-ω̇₁>`, ω₁ the direction of the light behind the face;
//! * a spot's profile: its slope times `<axis, ω̇₀>`, ω₀ the direction before the face;
//! * optical depths of both lines, ∫ <∇σ, ẏ> along them, with borders and ends as [`super::aim`] has them; the line before the face moves at both of its ends.
//!
//! *As the vertex, the face and its indices do* ([`PaneConnection`], a leg of [`super::motion`]): the same formulas, in dual numbers over all of these. Both lines are rays in motion ([`MovingRay`]): from x against the light, starting with ẋ
//! and turning with -ω̇₁, and from the point of crossing, with its velocity and -ω̇₀, to the light, which stays.
//!
//! All of it is linear in slots: forward and reverse mode read the same numbers. Known to be noisy: connections mirrored near total reflection, where F has the slope δ^-1/2 (the second moment grows like a logarithm).

use super::aim::{self, Line, Turn};
use super::first::FilmLine;
use super::motion::Chained;
use super::pane::{Plane, Reach, reach, reach_by};
use super::piece::{Piece, Stop};
use super::ray::MovingRay;
use super::specular;
use super::velocity::{Source, Velocity};
use crate::light::{LightKind, Origin, spot_falloff};
use crate::math::rng::Rng;
use crate::math::{DMat3, DVec3, Dual, Rgb, V3, fresnel, gradient};
use crate::params::{Covector, ParamSet, Sink, Slot};
use crate::scene::panes::Pane;
use crate::scene::{On, Scene};
use crate::surface::Surface;

/// A connection by a face to a light that moves.
#[derive(Clone, Copy, Debug)]
pub struct PaneAim {
    pub light: u32,
    /// Of the scene's panes.
    pub pane: u32,
    pub x: DVec3,
    /// Faces and medium at x, toward the face.
    pub on: On,
    pub medium: Option<u32>,
    pub turn: Turn,
    /// For points of line integrals through grids.
    pub rng: Rng,
}

/// Its three derivatives, by the numbers that it is a function of.
fn columns(v: V3<Dual<3>>) -> [DVec3; 3] {
    std::array::from_fn(|k| DVec3::new(v.x.d[k], v.y.d[k], v.z.d[k]))
}

/// Hand the partials of a connection of this `value` to `sink`: position, direction and angles of its light.
pub fn partials(scene: &Scene, params: &ParamSet, aim: &PaneAim, value: Rgb, sink: &mut impl Sink) {
    let (light, pane) = (&scene.lights[aim.light as usize], &scene.panes[aim.pane as usize]);
    let seeded = |v: DVec3| {
        let [x, y, z] = std::array::from_fn(|k| Dual::variable(v[k], k));
        V3::new(x, y, z)
    };
    let (from, slot) = match light.kind {
        LightKind::Point { position } | LightKind::Spot { position, .. } => {
            (Origin::Position(seeded(position)), light.place.position)
        }
        LightKind::Directional { direction } => (Origin::Infinity(seeded(direction)), light.place.direction),
        _ => return,
    };
    let surface = scene.surface_of(pane.shape);
    let Some(r) = reach(surface, pane, from, V3::constant(aim.x)) else { return };
    let (before, behind, at) = (columns(r.before), columns(r.behind), columns(r.at));
    let profile = aim::profile(light, params, -r.before.value(), value, true, sink);
    let turning = aim.turn.score(scene, -r.behind.value());
    let mut score: [Rgb; 3] = std::array::from_fn(|k| {
        let share = |g: Dual<3>| if g.v == 0.0 { 0.0 } else { g.d[k] / g.v };
        Rgb::from_fn(|c| share(r.gain[c])) + Rgb::splat(profile.dot(before[k])) - turning.dot(behind[k])
    });
    depths(scene, aim, &r, |k, d| score[k] += -d, &at, [&before, &behind]);
    aim::vector(params, slot, |k| value * score[k], sink);
}

/// How the optical depth of both lines changes, by each of the three numbers.
fn depths(
    scene: &Scene,
    aim: &PaneAim,
    r: &Reach<Dual<3>>,
    mut add: impl FnMut(usize, Rgb),
    at: &[DVec3; 3],
    [before, behind]: [&[DVec3; 3]; 2],
) {
    let pane = &scene.panes[aim.pane as usize];
    let mut rng = aim.rng;
    let [first, second] = [r.lengths[1], r.lengths[0]];
    // Back from x to the face.
    let line = Line { o: aim.x, w: -r.behind.value(), length: first.v, medium: aim.medium, on: aim.on, within: false };
    let mut changes = [Rgb::ZERO; 3];
    let passes = |v: DVec3, s: f64, sigma: Rgb| {
        (0..3).for_each(|k| add(k, sigma * -(s * v.dot(behind[k]))));
    };
    let growing = |sigma: Rgb| (0..3).for_each(|k| changes[k] += sigma * first.d[k]);
    let (medium, on) = aim::optical_depth(scene, &line, &mut rng, passes, growing);
    // From there to the light.
    let (w, p) = (line.w, r.at.value());
    let hit = scene.hit_at(p, pane.shape, pane.face);
    let on = specular::left(&on, &hit, w, r.through, scene.tolerance(p));
    let behind = || scene.shapes[pane.shape as usize].medium_behind(w, pane.n, medium);
    let medium = if r.through { behind() } else { medium };
    let line = Line { o: p, w: -r.before.value(), length: second.v, medium, on, within: false };
    let passes = |v: DVec3, s: f64, sigma: Rgb| {
        (0..3).for_each(|k| add(k, sigma * v.dot(at[k] - before[k] * s)));
    };
    let growing = |sigma: Rgb| (0..3).for_each(|k| changes[k] += sigma * second.d[k]);
    aim::optical_depth(scene, &line, &mut rng, passes, growing);
    (0..3).for_each(|k| add(k, changes[k]));
}

/// What a connection by a face depends on besides its light: the vertex, a point of the face, its normal, and two indices.
const NUMBERS: usize = 11;
/// Where the indices are among these.
const INDICES: usize = 9;

/// A connection by a face that moves, or from a vertex that does, to a light that stays.
pub struct PaneConnection<'a> {
    scene: &'a Scene,
    light: u32,
    pane: &'a Pane,
    x: DVec3,
    value: Rgb,
    reach: Reach<Dual<NUMBERS>>,
}

impl<'a> PaneConnection<'a> {
    pub fn new(scene: &'a Scene, light: u32, pane: u32, x: DVec3, value: Rgb) -> Option<Self> {
        let pane = &scene.panes[pane as usize];
        let surface = scene.surface_of(pane.shape);
        let mut plane = Plane::of(surface, pane);
        (plane.p, plane.n) = (V3::variable(pane.p, 3), V3::variable(pane.n, 6));
        plane.indices = std::array::from_fn(|k| Dual::variable(plane.indices[k].v, INDICES + k));
        let from = match scene.lights[light as usize].kind {
            LightKind::Point { position } | LightKind::Spot { position, .. } => {
                Origin::Position(V3::constant(position))
            }
            LightKind::Directional { direction } => Origin::Infinity(V3::constant(direction)),
            _ => return None,
        };
        let reach = reach_by(surface, plane, from, V3::variable(x, 0))?;
        Some(PaneConnection { scene, light, pane, x, value, reach })
    }

    /// The direction in which it leaves the vertex.
    pub fn toward(&self) -> DVec3 {
        -self.reach.behind.value()
    }

    /// How the vertex, the face's point and its normal move.
    fn sources(&self, moves: bool) -> [Velocity; 3] {
        let Pane { shape, face, p, n } = *self.pane;
        let here = Velocity::of(Source::Here, self.x);
        if !moves {
            return [here, Velocity::default(), Velocity::default()];
        }
        let matter = Source::Shape { shape, face };
        [here, Velocity::of(matter, p), Velocity::of_normal(matter, p, n)]
    }

    /// The dielectric's slots that change.
    fn indices(&self, cx: &Chained<impl Sink>) -> [Option<Slot>; 2] {
        let Surface::Dielectric { slot, .. } = *self.scene.surface_of(self.pane.shape) else { return [None; 2] };
        [slot, slot + 1].map(|s| Some(s).filter(|s| cx.moving.is_index(*s)))
    }

    /// Hands out its partials; what it asks of ẋ is added to `at`. `turning`: on how the direction in which it leaves turns.
    pub fn partials<S: Sink>(&self, cx: &mut Chained<S>, turning: &Covector, pieces: &[Piece], at: &mut Covector) {
        let (scene, r, value) = (self.scene, &self.reach, self.value);
        let sources = self.sources(cx.moving.moves(self.pane.shape));
        let indices = self.indices(cx);
        let velocity = |v: &V3<Dual<NUMBERS>>| {
            let column = |k: usize| DVec3::new(v.x.d[k], v.y.d[k], v.z.d[k]);
            let map = |k: usize| DMat3::from_cols(column(k), column(k + 1), column(k + 2));
            let moved = sources.iter().enumerate();
            let moved = moved.fold(Velocity::default(), |sum, (j, s)| sum.plus(1.0, &s.clone().mapped(map(3 * j))));
            let changed = indices.iter().enumerate().filter_map(|(k, s)| Some((s.as_ref()?, k)));
            changed.fold(moved, |sum, (s, k)| sum.plus(1.0, &Velocity::value(*s, column(INDICES + k))))
        };
        let (before, behind, crossing) = (velocity(&r.before), velocity(&r.behind), velocity(&r.at));
        let mut apply = |v: &Velocity, form: &Covector, sink: &mut S| v.settle(scene, cx.sensor, form, at, sink);

        // What the face makes of the light, per channel.
        let share = |k: usize| {
            Rgb::from_fn(|c| if r.gain[c].v == 0.0 { 0.0 } else { value[c] * (r.gain[c].d[k] / r.gain[c].v) })
        };
        for (j, s) in sources.iter().enumerate() {
            apply(s, &Covector(std::array::from_fn(|k| share(3 * j + k))), cx.sink);
        }
        for (k, slot) in indices.iter().enumerate() {
            slot.iter().for_each(|s| cx.sink.add(*s, share(INDICES + k)));
        }
        self.metal(cx.moving.refracts(scene.shapes[self.pane.shape as usize].surface as usize), cx.sink);
        apply(&behind, &turning.scaled(-1.0), cx.sink);
        if let LightKind::Spot { axis, beam, cutoff, .. } = scene.lights[self.light as usize].kind {
            let cosine = r.before.value().dot(axis);
            let (s, [ds]) = gradient([cosine], |[c]| spot_falloff(c, beam.into(), cutoff.into()));
            if s > 0.0 {
                let mut form = Covector::default();
                form.add(axis, value * (ds / s));
                apply(&before, &form, cx.sink);
            }
        }

        // Back from the vertex to the face, and from there to the light.
        let back = |v: Velocity| v.mapped(-DMat3::IDENTITY);
        let lines = [
            MovingRay::new(self.x, self.toward(), sources[0].clone(), back(behind)),
            MovingRay::new(r.at.value(), -r.before.value(), crossing, back(before)),
        ];
        let length = r.lengths[1].v * (1.0 + 1e-9) + scene.tolerance(self.x);
        let reached = |p: &&Piece| (p.end() - self.x).dot(self.toward()) <= length;
        let own = pieces.iter().take_while(|p| p.w.dot(self.toward()) > 1.0 - 1e-9).take_while(reached).count();
        for (k, piece) in pieces.iter().enumerate() {
            let line = FilmLine { scene, moving: cx.moving, ray: &lines[usize::from(k >= own)] };
            let mut ends = line.ends(piece);
            // The light itself.
            if k >= own && piece.to == Stop::Free {
                ends[1] = Velocity::default();
            }
            for (velocity, form) in ends.iter().zip(piece.depth_forms(scene)) {
                apply(velocity, &form.weighed(-value), cx.sink);
            }
        }
    }

    /// The mirrored share of metal, by its complex index.
    fn metal(&self, changes: bool, sink: &mut impl Sink) {
        let Surface::Conductor { eta, k, slot, .. } = *self.scene.surface_of(self.pane.shape) else { return };
        let cosine = self.reach.before.value().dot(self.pane.n).abs();
        for c in (0..3).filter(|_| changes) {
            let (f, by) = gradient([eta[c], k[c]], |[eta, k]| fresnel::conductor(cosine.into(), eta, k));
            if f > 0.0 {
                sink.add(slot + c as Slot, Rgb::channel(c, self.value[c] * by[0] / f));
                sink.add(slot + 3 + c as Slot, Rgb::channel(c, self.value[c] * by[1] / f));
            }
        }
    }
}
