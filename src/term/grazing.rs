//! Straight lines that graze edges, drawn from the edge outward ([T] 2.2), and the light that comes along them: what the rooms of [T] (24) share.
//!
//! A line grazes an edge at B and ends at S, toward the camera, and at D. It carries the light that leaves D, of any number of
//! scatterings, to S and on into the picture: `∫dl ∫dω sin α ∫∫ ds_S ds_D (-v) P(S) T(S,D) R(D)` with `v = <n, ẋ_B - (d_D ẋ_S + d_S ẋ_D)/(d_S + d_D)>` (25), n toward
//! the unblocked side; either end is the first surface or (with its ds) a medium point on the way. One pair of walks a sample: its cost is linear in path length. Smooth surfaces: [`super::grazing_line`].
//!
//! Directions come from the edge alone (where the camera sees it by rough glass, half of them toward there: [`super::frosted`]), or toward a point of a lamp; light emitted on a surface D is shared by both ([T] (61)), all
//! other light belongs to the first.

use super::edge_set::{EdgeSet, Ends, SharedEdge};
use super::ends::{self, ByOrder, Point, Watch};
use super::frosted::Frosted;
use super::grazing_line::{Curve, Line, Look, Toward};
use super::light_walk::{LightWalk, Vertex, seen};
use super::sheet::{Grazed, Partials, Reach};
use super::wedge::{between, wedge};
use super::{Context, Motion, Sample};
use crate::light::LightKind;
use crate::math::discrete::Discrete;
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::scene::{Hit, Scene};
use crate::shape::{Geometry, Shape};
use crate::transport::line::Line as Way;
use crate::transport::state::Stage;
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Share of directions toward lamps, where there are any.
const TO_LAMPS: f64 = 0.6;
/// Weight of edges that stand still against such that move.
const STILL: f64 = 0.25;
/// How far apart, as a share of the way to the edge, a surface point and what the edge sees of the same face may be.
const SAME: f64 = 1e-6;
/// The least that distance leaves of it: first vertices carry their motion farther than fields do.
const FAR: f64 = 0.02;

/// What a line may graze.
#[derive(Clone, Debug)]
struct Element {
    curve: Curve,
    /// Its shapes, of meshes with their faces there.
    grazed: Vec<(u32, Vec<u32>)>,
}

/// How much an edge may bring, by what moves: a line that grazes an edge that stands still brings something only if one of its ends moves, and
/// ends move near shapes that do, or where the camera looks past them.
struct Aim {
    /// Middles and radii of what moves; `None` where the camera moves everything it sees.
    around: Option<Vec<(DVec3, f64)>>,
}

impl Aim {
    fn new(scene: &Scene, motion: &Motion) -> Aim {
        let shape = |i: u32| {
            let b = scene.shapes[i as usize].shape.bounds();
            (b.center(), b.radius())
        };
        let moving = (0..scene.shapes.len() as u32).filter(|&i| motion.moves(i));
        let around = || moving.map(shape).chain(motion.moving.field.regions()).collect();
        Aim { around: (!motion.moving.camera).then(around) }
    }

    fn weight(&self, motion: &Motion, shape: u32, p: DVec3) -> f64 {
        match &self.around {
            _ if motion.moves(shape) => 1.0,
            None => STILL,
            Some(around) => {
                let seen = around.iter().map(|(c, r)| r * r / (*c - p).length_squared());
                STILL * seen.fold(FAR, f64::max).min(1.0)
            }
        }
    }
}

/// Everything that lines may graze.
pub struct Edges {
    set: Arc<EdgeSet>,
    curved: Vec<Element>,
    /// Over the edges of the set, then what is curved.
    table: Discrete,
    /// Lamps with an extent, by power.
    lamps: Discrete,
}

impl Edges {
    /// `None` where nothing moves, or nothing has an edge.
    pub fn new(scene: &Scene, motion: &Motion) -> Option<Edges> {
        if !motion.moving.matter() {
            return None;
        }
        let set = motion.edges(scene);
        let aim = Aim::new(scene, motion);
        // Lines past smooth surfaces are `virtual_edge`'s.
        let smooth = |shape: u32| scene.surface_of(shape).is_smooth();
        let parts = |i: usize| f64::from(u8::from(!set.any(i, smooth) && !set.is_cut(i)));
        let flat = |i: usize| {
            let Ends { a, b, pair } = set.ends(scene, i);
            let width = pair.map_or(PI, |corners| between(a, b, corners).1);
            (b - a).length() * width * PI * aim.weight(motion, set.shape(i), (a + b) * 0.5) * parts(i)
        };
        let mut weights: Vec<f64> = (0..set.len()).into_par_iter().map(flat).collect();
        let mut curved = Vec::new();
        for (i, s) in scene.shapes.iter().enumerate() {
            let id = i as u32;
            if !scene.has_outline(s) {
                continue;
            }
            let (curve, grazed, size, middle) = match &s.shape {
                Shape::Sphere(q) => {
                    let curve = Curve::Sphere { c: q.center, r: q.radius };
                    (curve, vec![(id, Vec::new())], 4.0 * PI * TAU * q.radius, q.center)
                }
                Shape::Cylinder(q) => {
                    let middle = s.shape.bounds().center();
                    (Curve::Cylinder(*q), vec![(id, Vec::new())], TAU * PI * q.length, middle)
                }
                _ => continue,
            };
            curved.push(Element { curve, grazed });
            weights.push(size * aim.weight(motion, id, middle));
        }
        for r in &motion.rims {
            let Some(shape) = r.shapes().next().filter(|_| !r.shapes().any(smooth)) else { continue };
            let size = r.length() * TAU * wedge(&r.edge(0.0)).1;
            weights.push(size * aim.weight(motion, shape, r.c));
            curved.push(Element { grazed: r.grazed.clone(), curve: Curve::Rim(r.clone()) });
        }
        // Edges without length have no direction; no line grazes them.
        weights.iter_mut().filter(|w| !w.is_finite()).for_each(|w| *w = 0.0);
        let power = |l: &crate::light::Light| match l.kind {
            LightKind::Area { shape } => l.value.max() * scene.shapes[shape as usize].shape.area(),
            LightKind::Envmap(_) => l.value.max() * scene.bounds.radius().powi(2),
            _ => 0.0,
        };
        let lamps = Discrete::new(scene.lights.iter().map(power));
        let table = Discrete::new(weights);
        (table.total > 0.0).then_some(Edges { set, curved, table, lamps })
    }

    fn element(&self, scene: &Scene, i: usize) -> Element {
        if i < self.set.len() {
            let SharedEdge { edge, faces } = self.set.get(scene, i);
            return Element { curve: Curve::Edge(edge), grazed: faces };
        }
        self.curved[i - self.set.len()].clone()
    }

    /// Probability that a direction is drawn toward the lamp.
    fn lamp_share(&self, light: u32) -> f64 {
        if self.lamps.total > 0.0 { TO_LAMPS * self.lamps.probability(light as usize) } else { 0.0 }
    }

    fn own_share(&self) -> f64 {
        if self.lamps.total > 0.0 { 1.0 - TO_LAMPS } else { 1.0 }
    }

    /// Draw a line from the curve outward by its place t on it, the choice of a lamp, and a direction; the densities do not hold the element's
    /// probability.
    fn draw(&self, scene: &Scene, look: Look, curve: &Curve, t: f64, [way, u, v]: [f64; 3]) -> Option<Line> {
        let lamps = if self.lamps.total > 0.0 { TO_LAMPS } else { 0.0 };
        let toward = if way < lamps {
            Toward::Lamp(self.lamps.sample(way / lamps).0 as u32)
        } else {
            Toward::Own((way - lamps) / (1.0 - lamps))
        };
        let line = curve.draw(scene, look, toward, [t, u, v])?;
        Some(Line { own: self.own_share() * line.own, ..line })
    }
}

/// What ends a line on its way w from the point b of an edge, if anything; `None` where it is blocked at once. What the edge stands on is left behind: it
/// hides nothing from what it touches.
fn near_end(scene: &Scene, b: DVec3, w: DVec3, grazed: Grazed) -> Option<Option<Hit>> {
    let contact = ends::contact(scene);
    let Some(first) = scene.opaque_past(b, w, f64::INFINITY, grazed) else { return Some(None) };
    if first.t > contact {
        return Some(Some(first));
    }
    // Away from it is where the shape itself is.
    let owner = scene.shapes[grazed.first()?.0 as usize].shape.bounds().center() - b;
    let leaves = first.n.dot(owner) * first.n.dot(w) > 0.0;
    let second = || scene.opaque_past(b + w * (2.0 * contact), w, f64::INFINITY, grazed);
    leaves.then(|| second().map(|h| Hit { t: h.t + 2.0 * contact, ..h }))
}

/// A line with what is on it.
pub struct Graze {
    line: Line,
    element: Element,
    /// Its measure over the probability of the element.
    pub scale: f64,
    /// The surfaces at its ends, and the media up to there.
    pub near: Option<Hit>,
    far: Option<Hit>,
    pub near_way: Way,
    far_way: Way,
}

/// The end D of a line, and the light that leaves it toward B, over the density of drawing line and end.
pub struct Far {
    pub light: ByOrder,
    pub at: Point,
    pub distance: f64,
}

impl Graze {
    /// `near`: what ends the line toward S.
    fn new(cx: &mut Context, line: Line, element: Element, probability: f64, near: Option<Hit>) -> Option<Graze> {
        let (scene, b, w) = (cx.scene, line.b, line.w);
        let far = ends::past(scene, b, w, line.n, &element.grazed);
        let any = !scene.media.is_empty();
        let medium = if any { ends::medium_beside(scene, b, w, line.n, &element.grazed, &cx.around) } else { None };
        let way = |w: DVec3, end: &Option<Hit>| {
            if !any {
                return Some(Way::default());
            }
            Way::clear(scene, b, w, end.as_ref().map_or(f64::INFINITY, |h| h.t), medium)
        };
        let (Some(near_way), Some(far_way)) = (way(-w, &near), way(w, &far)) else {
            cx.tally.missed_boundary += 1;
            return None;
        };
        let scale = line.measure / probability;
        Some(Graze { line, element, scale, near, far, near_way, far_way })
    }

    pub fn grazed(&self) -> Grazed<'_> {
        &self.element.grazed
    }

    pub fn b(&self) -> DVec3 {
        self.line.b
    }

    /// Unit, from S to D.
    pub fn w(&self) -> DVec3 {
        self.line.w
    }

    /// Up to S, which lies at this distance in the media before what ends the line, or is that end.
    pub fn near_transmittance(&self, scene: &Scene, s: &Point, distance: f64) -> Option<Rgb> {
        let Point::Medium(_) = s else { return Some(self.near_way.transmittance()) };
        let (k, t) = self.near_way.locate(self.b(), distance)?;
        Some(self.near_way.transmittance_to(scene, k, t))
    }

    /// What the light of `far` brings to the picture by way of S, the vertex z at this distance: straight to the camera, and through further
    /// scatterings. `scale`: everything between the two ends, over the density of drawing S.
    pub fn send(
        &self,
        cx: &mut Context,
        reach: &Reach,
        z: Vertex,
        distance: f64,
        far: &Far,
        scale: Rgb,
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let near = z.hit.map_or(Point::Medium(z.p), Point::Surface);
        let motion = |cx: &Context, watch: &Watch| self.motion(cx, &near, distance, far, watch);
        let flux = far.light.shown(cx.set, 1) * scale;
        if let Some(q) = cx.sensor.project(z.p).filter(|q| !flux.is_zero() && cx.on_film(q.film)) {
            if let Some(f) = seen(cx, &z, &q) {
                let partials = motion(cx, &Watch::itself(cx, &q, &near));
                let partials = partials.as_slice();
                emit(&Sample { film: q.film, flux: flux * f, partials, film_per_sheet: 0.0, outward: 1.0 });
            }
        }
        if cx.set.max_depth > 2 {
            let walk = LightWalk { reach, motion: &motion, source: &far.light };
            walk.run(cx, z, scale, &[], rng, emit);
        }
    }

    /// `-v_⊥` (25), for S at this distance, as the camera's path through S has it.
    pub fn motion(&self, cx: &Context, near: &Point, distance: f64, far: &Far, watch: &Watch) -> Partials {
        let Line { b, n, .. } = self.line;
        ends::between(cx, [near, &far.at], [distance, far.distance], watch, b, n, self.grazed())
    }
}

impl Edges {
    /// Draw a line that nothing blocks at its edge, from the edge outward, by the first four of the numbers. `aims`: its near end is a surface, so that a part of the lines goes toward where the
    /// camera sees the edge by rough glass.
    pub fn sample(&self, cx: &mut Context, aims: bool, &[place, way, u, v, _]: &Numbers) -> Option<Graze> {
        let (k, probability, t) = self.table.sample(place);
        let element = self.element(cx.scene, k);
        let aims = aims && !element.grazed.iter().any(|g| cx.frosted.contains(&g.0));
        let look = |p| if aims { Frosted::of(cx, p, &element.grazed) } else { None };
        let line = self.draw(cx.scene, &look, &element.curve, t, [way, u, v])?;
        let near = near_end(cx.scene, line.b, -line.w, &element.grazed)?;
        Graze::new(cx, line, element, probability, near)
    }

    /// Draw a line from S that nothing blocks up to its edge and beside it, and the distance to the edge. Its scale is `sin α / d²` over the probability of
    /// the element; [`Edges::far`] divides by the density of B.
    pub fn sample_from(&self, cx: &mut Context, s: &Point, rng: &mut Rng) -> Option<(Graze, f64)> {
        let p = match s {
            Point::Surface(h) => h.p,
            Point::Medium(p) => *p,
            Point::Infinity => return None,
        };
        let (k, probability, _) = self.table.sample(rng.uniform());
        let element = self.element(cx.scene, k);
        let line = element.curve.from_vertex(p, rng.uniform())?;
        let distance = (line.b - p).length();
        // As the edge sees S, so that both ways of drawing agree about what hides it.
        let near = near_end(cx.scene, line.b, -line.w, &element.grazed)?;
        let sees = match (s, &near) {
            (Point::Surface(s), Some(h)) => {
                (s.shape, s.face) == (h.shape, h.face) && (h.p - p).length() <= SAME * distance
            }
            (Point::Surface(_), None) => false,
            (_, near) => near.as_ref().is_none_or(|h| distance < h.t),
        };
        if !sees {
            return None;
        }
        Some((Graze::new(cx, line, element, probability, near)?, distance))
    }

    /// Draw the end D of a line: a point of its media, or the surface behind them.
    pub fn far(&self, cx: &mut Context, g: &Graze, rng: &mut Rng) -> Option<Far> {
        let (scene, line) = (cx.scene, &g.line);
        let inside = ends::medium_share(scene, &g.far_way, g.far.is_some());
        let own = line.own;
        let (at, distance) = ends::far_end(scene, g.far, g.far.as_ref().map_or(f64::INFINITY, |h| h.t));
        let transmittance = g.far_way.transmittance();
        let met = |light: ByOrder| Some(Far { light, at, distance });
        if let Some((light, target)) = line.target {
            let hits = match &g.far {
                Some(h) => scene.shapes[h.shape as usize].light == Some(light) && (h.t - target).abs() <= 1e-6 * target,
                None => target == f64::INFINITY,
            };
            let front = g.far.as_ref().is_none_or(|h| h.n.dot(line.w) < 0.0);
            if !hits || !front {
                return None;
            }
            let density = own * (1.0 - inside) + self.lamp_share(light) * line.lamp;
            let l = &scene.lights[light as usize];
            let emission = match &g.far {
                Some(_) => l.emission(Rgb::ONE),
                None => l.escape(line.w, false).map_or_else(|| l.emission(Rgb::ZERO), |e| e.0),
            };
            return met(ByOrder(vec![emission.color() * transmittance * (1.0 / density)]));
        }
        if rng.uniform() < inside {
            let (at, distance, mut light) = ends::medium_end(cx, &g.far_way, line.b, line.w, rng)?;
            light.scale(Rgb::splat(1.0 / (own * inside)));
            return Some(Far { light, at, distance });
        }
        let aimed = || g.element.curve.toward(scene, line, g.far.as_ref());
        let (light, toward) = if line.from_vertex { (0, 0.0) } else { aimed() };
        let own = own * (1.0 - inside);
        let both = own + self.lamp_share(light) * toward;
        let stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        let stage = g.far.map_or(Stage::Escape, Stage::Surface);
        let mut found = ends::radiance(cx, line.b, line.w, stage, g.far_way.last, false, stream);
        for (k, x) in found.0.iter_mut().enumerate() {
            *x *= transmittance * (1.0 / if k == 0 { both } else { own });
        }
        met(found)
    }
}
