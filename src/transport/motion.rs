//! Interior motion: term M of [T] section 3 where shapes, lamps or the camera move.
//!
//! Every vertex has a velocity that belongs to the point, whatever technique drew it ([T] (61)): surface vertices are material, ẋ = v(x); medium
//! vertices follow the field V around moving shapes ([`super::field`]); the first vertex stays on its film point's ray, and later ones take over what
//! it does on top of that ([`super::first`]). A path's contribution is `Π f G T` over vertices and segments ([T] (23)), so it changes by
//!
//! * `ċ_x/c_x + ċ_z/c_z - 2ḋ/d - τ̇` a segment from x to z ([T] (27b); c = 1 in a medium; τ: [`super::piece`]), c_x by the shading normal (it belongs to f), c_z by the
//!   geometric one;
//! * the slope of the phase function as directions turn, that of a rough surface's value (in place of its cosine; [`crate::surface::rough`]) as they and its normal do;
//! * `<ẋ, ∇σ_s>/σ_s` where σ_s is no constant;
//! * `J̇ = div ẋ` a vertex;
//! * on the camera's segment `τ̇` only: the film is fixed.
//!
//! Silhouettes have rooms of their own.

use super::attach::InnerBorders;
use super::beam_motion::Connection;
use super::field::{Field, classes};
use super::first::{FilmLine, First, Later, Met, Nth};
use super::piece::{Piece, Stop};
use super::ray::{MovingRay, Specular, Turned};
use super::record::{Drawn, End, MediumSpan};
use super::upright::Far;
use super::velocity::{Rate, Source, Velocity, transposed};
use super::way_motion::WayConnection;
use crate::error::Result;
use crate::light::{LightKind, spot_falloff};
use crate::math::{DVec3, Rgb, gradient};
use crate::medium::Medium;
use crate::params::{Covector, ParamSet, Sink, Slot};
use crate::phase::one_minus_cos;
use crate::scene::beams::{Step, Way};
use crate::scene::{Hit, Scene};
use crate::sensor::Sensor;
use crate::surface::Surface;
use crate::surface::rough::Slopes;
use std::sync::Arc;

/// Which shapes move, how medium points follow, and whether the camera moves.
#[derive(Clone, Debug, Default)]
pub struct Moving {
    pub field: Field,
    pub camera: bool,
    /// That of a camera ray.
    film: MovingRay,
    /// Smooth surfaces whose index changes.
    refracting: Vec<bool>,
    /// Indices of refraction, of conductors the imaginary parts too, that change.
    indices: Vec<Slot>,
    any: bool,
    /// Lights that the medium around them follows.
    followed: Vec<u32>,
    /// Meshes whose vertices are parameters.
    bending: Vec<bool>,
    /// Of faces that others pass through: none where nobody looked.
    inner: Arc<InnerBorders>,
    /// Of media: over what distance from the ends of a line their points stop to slide along it; infinite where they all do.
    settling: Vec<f64>,
}

/// Mean distances over which a field changes by itself, within which points that slide through it come to rest.
const SETTLING: f64 = 3.0;

impl Moving {
    pub fn new(scene: &Scene, sensor: &Sensor, params: &ParamSet) -> Result<Moving> {
        let classes = classes(scene, params);
        let camera = sensor.moves(params);
        let bending: Vec<bool> = scene.shapes.iter().map(|s| s.bends(params)).collect();
        let followed: Vec<u32> = (0..scene.lights.len() as u32).filter(|&i| follows(scene, params, i)).collect();
        let refracting: Vec<bool> = scene.surfaces.iter().map(|s| s.refracts_by(params)).collect();
        let slots = |s: &Surface| match s {
            Surface::Dielectric { slot, .. } => *slot..*slot + 2,
            Surface::Conductor { slot, .. } => *slot..*slot + 6,
            _ => 0..0,
        };
        let indices = scene.surfaces.iter().flat_map(slots).filter(|s| params.is_active(*s)).collect();
        let beams = scene.lights.iter().any(|l| matches!(l.kind, LightKind::Beam { .. }) && l.place.moves(params));
        let changes = camera || beams || !followed.is_empty() || refracting.contains(&true);
        let any = changes || classes.iter().any(Option::is_some);
        let settles = |m: &Medium| m.density_grid().map_or(f64::INFINITY, |g| SETTLING / g.roughness());
        let settling = if any { scene.media.iter().map(settles).collect() } else { Vec::new() };
        Ok(Moving {
            any,
            field: Field::new(scene, classes, &bending, &followed)?,
            camera,
            film: if camera { MovingRay::Film } else { MovingRay::Still },
            refracting,
            indices,
            followed,
            bending,
            inner: Arc::default(),
            settling,
        })
    }

    /// With the borders of faces that others pass through.
    #[must_use]
    pub fn with_inner(self, inner: impl Into<Arc<InnerBorders>>) -> Moving {
        Moving { inner: inner.into(), ..self }
    }

    /// With points that slide all along their lines, in grids too: for comparison.
    #[cfg(test)]
    #[must_use]
    pub fn sliding(self) -> Moving {
        Moving { settling: Vec::new(), ..self }
    }

    /// See [`super::first`].
    pub fn settling(&self, medium: u32) -> f64 {
        self.settling.get(medium as usize).copied().unwrap_or(f64::INFINITY)
    }

    pub fn inner(&self) -> &Arc<InnerBorders> {
        &self.inner
    }

    pub fn any(&self) -> bool {
        self.any
    }

    /// Whether anything but rays behind interfaces and beams moves: what the camera sees without them.
    pub fn matter(&self) -> bool {
        self.camera || !self.followed.is_empty() || (0..self.bending.len() as u32).any(|i| self.moves(i))
    }

    /// Whether the medium follows this light: its position is then scored as that of a vertex, not by [`super::aim`].
    pub fn follows(&self, light: u32) -> bool {
        self.followed.contains(&light)
    }

    pub fn moves(&self, shape: u32) -> bool {
        self.field.class(shape).is_some()
    }

    /// Whether a shape moves other than by an affine field.
    pub fn bends(&self, shape: u32) -> bool {
        self.bending[shape as usize]
    }

    /// Whether the index of this surface changes.
    pub fn refracts(&self, surface: usize) -> bool {
        self.refracting[surface]
    }

    /// Whether a slot is an index of refraction of a smooth surface that changes.
    pub fn is_index(&self, slot: Slot) -> bool {
        self.indices.contains(&slot)
    }

    pub fn film_ray(&self) -> &MovingRay {
        &self.film
    }

    pub fn film_line<'a>(&'a self, scene: &'a Scene) -> FilmLine<'a> {
        FilmLine { scene, moving: self, ray: &self.film }
    }

    /// Velocity of a vertex of the leg that begins so.
    pub fn vertex(&self, scene: &Scene, first: &First, nth: Nth, at: &Met) -> Velocity {
        let after = nth == Nth::Later;
        match at {
            _ if nth == Nth::First => first.velocity.clone(),
            Met::Medium(p) => self.in_medium(scene, first, *p, after).0,
            Met::Surface(h) => {
                let (carried, _) = Moving::on_surface(first, h.p, after);
                let own = self.moves(h.shape).then(|| Velocity::of(Source::at(h), h.p));
                let own = own.map_or(carried.clone(), |v| v.plus(1.0, &carried));
                let held = self.film_line(scene).held(first, [h.shape, h.face], h.p, h.n);
                match held.filter(|_| nth == Nth::Second) {
                    Some(a) => own.plus(1.0, &first.ahead_of(&self.field, h).mapped(a.map)),
                    None => own,
                }
            }
        }
    }

    /// Velocity of a later medium vertex, and its divergence. `after`: it comes after the second one, too.
    pub fn in_medium(&self, scene: &Scene, first: &First, p: DVec3, after: bool) -> (Velocity, Rate) {
        let (v, mut rate) = self.field.at(scene, p);
        let v = first.carry(p, after, v, &mut rate);
        (v, rate)
    }

    /// What a later surface point does on top of its matter, and the divergence of that.
    pub fn on_surface(first: &First, p: DVec3, after: bool) -> (Velocity, Rate) {
        let mut rate = Rate::default();
        let v = first.carry(p, after, Velocity::default(), &mut rate);
        (v, rate)
    }
}

/// A spot with a hard edge that moves its position inside a medium: beside its apex edge and interior have a mean together only, unless the points
/// there go with it. Light that scatters once reaches the apex by camera rays alone, and what they see is refused.
fn follows(scene: &Scene, params: &ParamSet, light: u32) -> bool {
    scene.has_hard_edge_inside(light) && params.block_active(scene.lights[light as usize].place.position, 3)
}

/// The far end of a segment.
#[derive(Clone, Debug)]
enum Tip {
    /// A surface point: its shape's matter, what it does on top of it, and what its own segments ask of its velocity, of its normal, and of the direction of arrival.
    Surface {
        shape: u32,
        face: u32,
        p: DVec3,
        n: DVec3,
        carried: Velocity,
        spread: Rate,
        at: Covector,
        normal: Covector,
        /// Of rough surfaces.
        arrival: Option<Box<Covector>>,
    },
    /// A medium point; `arrival`: on how the segment's direction turns there.
    Medium { p: DVec3, velocity: Velocity, arrival: Covector },
    /// A light with a position and no extent; where the medium does not follow it, its own motion is [`super::aim`]'s.
    Point(u32),
    /// A direction, unit.
    Infinity(DVec3),
    /// A way of a beam.
    Beam(u32),
    /// A light by way of smooth faces, see [`End::Way`].
    Way { light: u32, steps: [u32; 2], at: DVec3 },
}

/// A segment that leaves the vertex at hand, and all that was collected along it.
#[derive(Clone, Debug)]
struct Leg {
    tip: Tip,
    value: Rgb,
    /// Of that, what a lamp emits there: nobody else counts its point's Jacobian.
    emitted: Rgb,
    /// Of a connection; the walk's own segment has its in [`Chain`].
    pieces: Vec<Piece>,
    /// What it asks of the directions and the normal where light ends with a jump, of which it is no part (`value` is 0); otherwise the vertex' own slopes say so.
    upright: Option<Box<Slopes>>,
}

impl Leg {
    fn new(tip: Tip, value: Rgb, emitted: Rgb, pieces: Vec<Piece>) -> Leg {
        Leg { tip, value, emitted, pieces, upright: None }
    }
}

/// Going backward over a path: what left the vertex that comes next.
#[derive(Clone, Debug, Default)]
pub struct Chain {
    next: Option<Leg>,
    /// Of the segment that `next` is at the end of.
    pieces: Vec<Piece>,
    connections: Vec<Leg>,
    /// Lists that legs have given back.
    spare: Vec<Vec<Piece>>,
}

/// What a chain is told about its scene, and the path's first vertex.
pub struct Chained<'a, S: Sink> {
    pub scene: &'a Scene,
    pub sensor: &'a Sensor,
    pub moving: &'a Moving,
    /// The record's, of connections by smooth faces.
    pub steps: &'a [Step],
    /// Which the leg at hand begins with.
    pub ray: &'a MovingRay,
    pub first: &'a First,
    /// Whether the event at hand is behind the second vertex.
    pub after: bool,
    pub sink: &'a mut S,
}

fn give_back(spare: &mut Vec<Vec<Piece>>, mut pieces: Vec<Piece>) {
    pieces.clear();
    spare.push(pieces);
}

impl Chain {
    pub fn clear(&mut self) {
        self.next = None;
        self.pieces.clear();
        self.clear_connections();
    }

    /// Whether anything behind the vertex at hand was recorded.
    pub fn goes_on(&self) -> bool {
        self.next.is_some()
    }

    fn clear_connections(&mut self) {
        self.connections.drain(..).for_each(|leg| give_back(&mut self.spare, leg.pieces));
    }

    fn pieces_of(&mut self, scene: &Scene, spans: &[MediumSpan]) -> Vec<Piece> {
        let mut pieces = self.spare.pop().unwrap_or_default();
        pieces.extend(spans.iter().filter_map(|s| Piece::of(scene, s)));
        pieces
    }

    /// A span of the segment at hand: connections that left it further on have passed it too.
    pub fn span(&mut self, scene: &Scene, span: &MediumSpan) {
        let Some(piece) = Piece::of(scene, span) else { return };
        self.pieces.push(piece);
        self.connections.iter_mut().for_each(|leg| leg.pieces.push(piece));
    }
}

/// What a connection's own first vertex may have to carry along.
pub(super) fn later(scene: &Scene, end: End) -> Later {
    match end {
        // What light passes unchanged is nothing that the first vertex keeps off.
        End::Shape { shape, .. } if scene.is_null(&scene.shapes[shape as usize]) => Later::Path,
        End::Shape { shape, face, .. } => Later::Face([shape, face]),
        _ => Later::Nothing,
    }
}

impl<S: Sink> Chained<'_, S> {
    fn tip(&self, end: End, first: &First) -> Tip {
        match end {
            End::Shape { shape, face, p, n } => {
                let (carried, spread) = Moving::on_surface(first, p, self.after);
                let (at, normal) = (Covector::default(), Covector::default());
                Tip::Surface { shape, face, p, n, carried, spread, at, normal, arrival: None }
            }
            End::Point(light) => Tip::Point(light),
            End::Beam(way) => Tip::Beam(way),
            End::Way { light, first, len, at } => Tip::Way { light, steps: [first, len], at },
            End::Infinity(w) => Tip::Infinity(w),
        }
    }

    /// Light met by the walk.
    pub fn arrive(&mut self, chain: &mut Chain, end: End, value: Rgb) {
        match &mut chain.next {
            // The lamp reflects light as well: one segment leads to both.
            Some(leg) => {
                leg.value += value;
                leg.emitted += value;
            }
            none => *none = Some(Leg::new(self.tip(end, self.first), value, value, Vec::new())),
        }
    }

    /// A connection over these spans.
    pub fn connect(&mut self, chain: &mut Chain, end: End, value: Rgb, spans: &[MediumSpan]) {
        let pieces = chain.pieces_of(self.scene, spans);
        chain.connections.push(Leg::new(self.tip(end, self.first), value, value, pieces));
    }

    /// A segment toward where light ends with a jump ([`super::upright`]), and what that asks of the vertex.
    pub fn upright(&mut self, chain: &mut Chain, far: &Far, slopes: Slopes) {
        let tip = match far {
            Far::End(end) => self.tip(*end, self.first),
            Far::Medium(p) => {
                let velocity = self.moving.in_medium(self.scene, self.first, *p, self.after).0;
                Tip::Medium { p: *p, velocity, arrival: Covector::default() }
            }
        };
        let pieces = chain.spare.pop().unwrap_or_default();
        let upright = Some(Box::new(slopes));
        chain.connections.push(Leg { tip, value: Rgb::ZERO, emitted: Rgb::ZERO, pieces, upright });
    }

    /// A connection by way of a medium point that the walk did not visit. `unscattered`: its value without σ_s of that point.
    pub fn connect_through(
        &mut self,
        chain: &mut Chain,
        via: &Drawn,
        end: End,
        [value, unscattered]: [Rgb; 2],
        spans: &[MediumSpan],
        seen: bool,
    ) {
        let (lead, way) = spans.split_at((via.lead as usize).min(spans.len()));
        let pieces = chain.pieces_of(self.scene, way);
        // The camera's own first vertex, of this connection only.
        let later = later(self.scene, end);
        let first = seen.then(|| self.line().medium(via.p, &via.span, later));
        let leg = Leg::new(self.tip(end, first.as_ref().unwrap_or(self.first)), value, value, pieces);
        let mut v = Vertex::new(Place::Medium { medium: via.medium, p: via.p, travel: via.span.w });
        v.leave(self, &leg, &leg.pieces, first.as_ref());
        give_back(&mut chain.spare, leg.pieces);
        v.source(self.scene.media[via.medium as usize].sigma_s_gradient(via.p), unscattered);
        self.medium_point(chain, v, value, first.as_ref(), lead);
    }

    /// Light that a medium emits. `dark`: its value without σ_a L_e.
    pub fn glow(&mut self, chain: &mut Chain, via: &Drawn, value: Rgb, dark: Rgb, spans: &[MediumSpan], seen: bool) {
        let mut v = Vertex::new(Place::Medium { medium: via.medium, p: via.p, travel: via.span.w });
        v.source(self.scene.media[via.medium as usize].glow_gradient(via.p), dark);
        let first = seen.then(|| self.line().medium(via.p, &via.span, Later::Nothing));
        self.medium_point(chain, v, value, first.as_ref(), spans);
    }

    fn line(&self) -> FilmLine<'_> {
        FilmLine { scene: self.scene, moving: self.moving, ray: self.ray }
    }

    /// A smooth surface turned a ray, `straight` from the camera or from a vertex: what was collected behind it depends on both.
    pub fn specular(&mut self, chain: &mut Chain, s: &Specular, turned: &Turned, straight: bool, after: Rgb) {
        turned.partials(self.scene, self.sensor, after, self.sink);
        chain.clear();
        if !straight {
            // The vertex before holds its direction.
            chain.next = Some(Leg::new(Tip::Infinity(s.w), after, after, Vec::new()));
        }
    }

    /// Light from the environment at the end of the leg's ray, along w, with this weight.
    pub fn escape(&mut self, w: DVec3, weight: Rgb) {
        let turn = self.ray.turn(DVec3::ZERO, w);
        let light = self.scene.environment.map(|id| &self.scene.lights[id as usize]);
        let Some(slope) = light.filter(|_| !turn.is_zero()).and_then(|l| l.escape_slope(w)) else { return };
        let mut form = Covector::default();
        for (c, g) in slope.into_iter().enumerate() {
            form.add(g, Rgb::channel(c, weight[c]));
        }
        turn.apply(self.scene, self.sensor, &form, self.sink);
    }

    /// A medium point beside the walk: the camera's own first vertex, or the end of a segment from the vertex at hand.
    fn medium_point(&mut self, chain: &mut Chain, v: Vertex, value: Rgb, first: Option<&First>, lead: &[MediumSpan]) {
        if let Some(first) = first {
            v.be_first(self, first, value);
            lead.iter().for_each(|s| self.camera_span(s, first, value));
        } else {
            let pieces = chain.pieces_of(self.scene, lead);
            let tip = v.ride(self, value);
            chain.connections.push(Leg::new(tip, value, Rgb::ZERO, pieces));
        }
    }

    /// A collision that all legs left. `is_first`: seen by the camera.
    pub fn scatter(&mut self, chain: &mut Chain, medium: u32, p: DVec3, travel: DVec3, is_first: bool) {
        let mut v = Vertex::new(Place::Medium { medium, p, travel });
        let after = v.leave_all(self, chain, is_first);
        let m = &self.scene.media[medium as usize];
        if !m.is_homogeneous() {
            let sigma_s = m.coefficients(p).1;
            v.source(
                m.sigma_s_gradient(p),
                Rgb::from_fn(|c| if sigma_s[c] > 0.0 { after[c] / sigma_s[c] } else { 0.0 }),
            );
        }
        self.turn_to(chain, v, after, is_first);
    }

    /// The surface vertex that all legs left; `wi`: toward where the path came from.
    pub fn reflect(&mut self, chain: &mut Chain, hit: &Hit, wi: DVec3, is_first: bool) {
        let mut v = Vertex::new(Place::Surface { hit, wi });
        let after = v.leave_all(self, chain, is_first);
        self.turn_to(chain, v, after, is_first);
    }

    fn turn_to(&mut self, chain: &mut Chain, v: Vertex, after: Rgb, is_first: bool) {
        if is_first {
            let first = self.first;
            v.be_first(self, first, after);
            chain.clear();
        } else {
            let tip = v.ride(self, after);
            chain.next = Some(Leg::new(tip, after, Rgb::ZERO, Vec::new()));
        }
    }

    /// A span of the camera line on the way to its first vertex.
    pub fn camera_span(&mut self, span: &MediumSpan, first: &First, value: Rgb) {
        let Some(piece) = Piece::of(self.scene, span).filter(|_| !value.is_zero()) else { return };
        let [a, mut b] = self.line().ends(&piece);
        if piece.to == Stop::Free && piece.t1.is_finite() {
            b = first.velocity.clone();
        }
        if a.is_zero() && b.is_zero() {
            return;
        }
        let forms = piece.depth_forms(self.scene);
        for (velocity, form) in [a, b].iter().zip(forms) {
            velocity.apply(self.scene, self.sensor, &form.weighed(-value), self.sink);
        }
    }
}

/// What a vertex is.
#[derive(Clone, Copy, Debug)]
enum Place<'a> {
    Surface { hit: &'a Hit, wi: DVec3 },
    Medium { medium: u32, p: DVec3, travel: DVec3 },
}

/// What asks for the velocity of a vertex.
struct Vertex<'a> {
    place: Place<'a>,
    /// On its velocity.
    at: Covector,
    /// On how its shading normal turns.
    normal: Covector,
    /// On how the direction of travel on arrival does.
    arrival: Covector,
}

impl<'a> Vertex<'a> {
    fn new(place: Place<'a>) -> Self {
        Vertex { place, at: Covector::default(), normal: Covector::default(), arrival: Covector::default() }
    }

    fn p(&self) -> DVec3 {
        match self.place {
            Place::Surface { hit, .. } => hit.p,
            Place::Medium { p, .. } => p,
        }
    }

    /// A factor of gradient g beside `value`.
    fn source(&mut self, g: [DVec3; 3], value: Rgb) {
        for (c, g) in g.into_iter().enumerate() {
            self.at.add(g, Rgb::channel(c, value[c]));
        }
    }

    fn leave_all<S: Sink>(&mut self, cx: &mut Chained<S>, chain: &mut Chain, is_first: bool) -> Rgb {
        let first = is_first.then_some(cx.first);
        let mut after = Rgb::ZERO;
        let connections = chain.connections.iter().map(|leg| (leg, &leg.pieces));
        for (leg, pieces) in connections.chain(chain.next.iter().map(|leg| (leg, &chain.pieces))) {
            after += leg.value;
            self.leave(cx, leg, pieces, first);
        }
        chain.clear();
        after
    }

    /// What the directions and the normal are asked: hands the latter's on, and that of wi, from which the path came.
    fn turned(&mut self, slopes: &Slopes) -> Covector {
        self.normal += slopes.n;
        self.arrival += slopes.wi.scaled(-1.0);
        slopes.wo
    }

    /// What scattering toward w asks of how w turns; what it asks of the vertex is added to it.
    fn scattered(&mut self, scene: &Scene, w: DVec3, value: Rgb) -> Covector {
        let mut turning = Covector::default();
        match self.place {
            Place::Surface { hit, wi } => match scene.surface_of(hit.shape) {
                Surface::Rough(rough) => {
                    let Some(slopes) = rough.slopes(hit.normals(), wi, w) else { return turning };
                    turning += self.turned(&slopes.weighed(value));
                }
                _ => {
                    let c = hit.ns.dot(w);
                    self.normal.add(w, value * (1.0 / c));
                    turning.add(hit.ns, value * (1.0 / c));
                }
            },
            Place::Medium { medium, travel, .. } => {
                let phase = &scene.media[medium as usize].phase;
                let (f, df) = phase.eval_with_slope(one_minus_cos(travel, w));
                turning.add(travel, value * (-df / f));
                self.arrival.add(w, value * (-df / f));
            }
        }
        turning
    }

    /// A connection to a beam.
    fn leave_by<S: Sink>(&mut self, cx: &mut Chained<S>, way: &Way, value: Rgb, pieces: &[Piece]) {
        let turning = self.scattered(cx.scene, -way.w, value);
        let connection = Connection { way, x: self.p(), value, turning, pieces };
        connection.partials(cx, &mut self.at);
    }

    /// A connection to a light by way of smooth faces.
    fn leave_by_faces<S: Sink>(
        &mut self,
        cx: &mut Chained<S>,
        light: u32,
        way: (&[Step], DVec3),
        value: Rgb,
        pieces: &[Piece],
    ) {
        let Some(connection) = WayConnection::new(cx, light, way, self.p(), value) else { return };
        let turning = self.scattered(cx.scene, connection.toward(), value);
        connection.partials(cx, &turning, pieces, &mut self.at);
    }

    /// `pieces`: of the segment; `first`: this vertex as the path's first, if it is that.
    fn leave<S: Sink>(&mut self, cx: &mut Chained<S>, leg: &Leg, pieces: &[Piece], first: Option<&First>) {
        let (x, value, scene) = (self.p(), leg.value, cx.scene);
        match leg.tip {
            Tip::Beam(way) => return self.leave_by(cx, &scene.beams.ways[way as usize], value, pieces),
            Tip::Way { light, steps: [first, len], at } => {
                let steps = &cx.steps[first as usize..][..len as usize];
                return self.leave_by_faces(cx, light, (steps, at), value, pieces);
            }
            _ => {}
        }
        let (p, w, d) = match &leg.tip {
            Tip::Surface { p, .. } | Tip::Medium { p, .. } => (*p, (*p - x).normalize(), (*p - x).length()),
            Tip::Point(light) => {
                let Some(p) = scene.lights[*light as usize].center() else { return };
                (p, (p - x).normalize(), (p - x).length())
            }
            Tip::Infinity(w) => (x, *w, f64::INFINITY),
            Tip::Beam(_) | Tip::Way { .. } => return,
        };
        // From face to face of one plane: rounding alone lets light through.
        let own = match self.place {
            Place::Surface { hit, .. } => hit.ns.dot(w) == 0.0,
            Place::Medium { .. } => false,
        };
        if own || matches!(&leg.tip, Tip::Surface { n, .. } if n.dot(w) == 0.0) {
            return;
        }
        // On ż - ẋ, and apart from each other.
        let mut between = Covector::default();
        let mut near = Covector::default();
        between.add(w, value * (-2.0 / d));
        // How the direction turns is across/d of ż - ẋ.
        let mut turning = match &leg.upright {
            Some(slopes) => self.turned(slopes),
            None => self.scattered(scene, w, value),
        };
        match &leg.tip {
            Tip::Surface { n, arrival, .. } => {
                turning.add(*n, value * (1.0 / n.dot(w)));
                arrival.iter().for_each(|a| turning += **a);
            }
            Tip::Medium { arrival, .. } => turning += *arrival,
            Tip::Point(light) => {
                if let LightKind::Spot { axis, beam, cutoff, .. } = scene.lights[*light as usize].kind {
                    let (s, [ds]) = gradient([-w.dot(axis)], |[c]| spot_falloff(c, beam.into(), cutoff.into()));
                    if s > 0.0 {
                        turning.add(axis, value * (-ds / s));
                    }
                }
            }
            Tip::Infinity(_) | Tip::Beam(_) | Tip::Way { .. } => {}
        }
        // Held to its direction, a point scores less by that share.
        let attached = match (&leg.tip, first) {
            (Tip::Surface { shape, face, p, n, .. }, Some(first)) => {
                cx.moving.film_line(scene).held(first, [*shape, *face], *p, *n)
            }
            _ => None,
        };
        let kept = 1.0 - attached.map_or(0.0, |a| a.share);
        if d < f64::INFINITY {
            between += turning.across(w).scaled(1.0 / d);
            near += between.scaled(-kept);
        }
        let mut passing = Covector::default();
        for piece in pieces {
            let forms = piece.depth_forms(scene);
            for (mut form, stop, q) in [(forms[0], piece.from, piece.start()), (forms[1], piece.to, piece.end())] {
                if let Stop::Border(n) = stop {
                    // The border's point keeps to it.
                    let along = form.dot(w) * (1.0 / n.dot(w));
                    form.add(n, -along);
                }
                if let (Stop::Opaque { shape, face, n }, Tip::Infinity(_)) = (stop, &leg.tip) {
                    // Where the ray meets an interface it keeps to that, wherever it goes.
                    let along = form.dot(w) * (1.0 / n.dot(w));
                    form.add(n, -along);
                    if cx.moving.moves(shape) {
                        let mut own = Covector::default();
                        own.add(n, along);
                        scene.matter(shape, face).point(q, &own.weighed(-value), cx.sink);
                    }
                }
                let f = if d < f64::INFINITY { ((q - x).dot(w) / d).clamp(0.0, 1.0) } else { 0.0 };
                let form = form.weighed(-value);
                near += form.scaled(1.0 - f);
                passing += form.scaled(f);
            }
        }
        self.at += near;
        let mut far = between;
        far += passing;
        match &leg.tip {
            Tip::Medium { velocity, .. } => velocity.apply(scene, cx.sensor, &far, cx.sink),
            Tip::Surface { shape, face, n, carried, spread, at, normal, .. } => {
                let mut turned = Covector::default();
                turned.add(w, value * (1.0 / n.dot(w)));
                // What it is carried by keeps to the direction, its matter does not.
                let mut far_carried = between.scaled(kept);
                far_carried += passing;
                if let Some(a) = &attached {
                    // On Δ: what asks for z's velocity beside the segment itself.
                    let mut asks = passing;
                    asks += *at;
                    asks += bend_form(scene, *shape, p, *n, normal);
                    let mut form = transposed(&a.map, &asks);
                    form.add(a.form, value);
                    self.at += form;
                    let mut back = form.scaled(-1.0);
                    far_carried += back;
                    let matter = first.filter(|_| cx.moving.moves(*shape)).and_then(|f| f.beside([*shape, *face]));
                    if let Some(v) = matter {
                        back += between.scaled(kept - 1.0);
                        v.apply(scene, cx.sensor, &back, cx.sink);
                    }
                }
                move_matter(cx, [*shape, *face], p, *n, &far, &turned);
                slide(cx, *shape, p, *n, &far_carried, &turned.scaled(kept), carried);
                // Of the Jacobian the vertex itself has counted what its own segments brought.
                if cx.moving.moves(*shape) {
                    scene.matter(*shape, *face).area(*n, leg.emitted, cx.sink);
                }
                spread.apply(scene, cx.sensor, leg.emitted + value * (kept - 1.0), cx.sink);
            }
            Tip::Point(light) if cx.moving.follows(*light) => {
                Velocity::of(Source::Light(*light), p).apply(scene, cx.sensor, &far, cx.sink);
            }
            Tip::Point(_) | Tip::Infinity(_) | Tip::Beam(_) | Tip::Way { .. } => {}
        }
    }

    /// A later vertex, as the end of the segment that led to it.
    fn ride<S: Sink>(self, cx: &mut Chained<S>, after: Rgb) -> Tip {
        match self.place {
            Place::Medium { p, .. } => {
                let (velocity, rate) = cx.moving.in_medium(cx.scene, cx.first, p, cx.after);
                velocity.apply(cx.scene, cx.sensor, &self.at, cx.sink);
                rate.apply(cx.scene, cx.sensor, after, cx.sink);
                Tip::Medium { p, velocity, arrival: self.arrival }
            }
            Place::Surface { hit, .. } => {
                let (carried, spread) = Moving::on_surface(cx.first, hit.p, cx.after);
                move_matter(cx, [hit.shape, hit.face], hit.p, hit.ns, &self.at, &self.normal);
                slide(cx, hit.shape, hit.p, hit.ns, &self.at, &self.normal, &carried);
                if cx.moving.moves(hit.shape) {
                    cx.scene.matter(hit.shape, hit.face).area(hit.n, after, cx.sink);
                }
                spread.apply(cx.scene, cx.sensor, after, cx.sink);
                let Vertex { at, normal, arrival, .. } = self;
                let rough = matches!(cx.scene.surface_of(hit.shape), Surface::Rough(_));
                let arrival = rough.then(|| Box::new(arrival));
                let Hit { shape, face, p, n, .. } = *hit;
                Tip::Surface { shape, face, p, n, carried, spread, at, normal, arrival }
            }
        }
    }

    /// The first vertex: its film point's ray takes it along.
    fn be_first<S: Sink>(self, cx: &mut Chained<S>, first: &First, after: Rgb) {
        match self.place {
            Place::Medium { .. } => {
                first.velocity.apply(cx.scene, cx.sensor, &self.at, cx.sink);
                first.stretch.apply(cx.scene, cx.sensor, after, cx.sink);
                first.turn.apply(cx.scene, cx.sensor, &self.arrival, cx.sink);
            }
            Place::Surface { hit, .. } => {
                first.velocity.apply(cx.scene, cx.sensor, &self.at, cx.sink);
                first.turn.apply(cx.scene, cx.sensor, &self.arrival, cx.sink);
                // Sliding over the matter it sees another normal.
                let mut over = first.velocity.clone();
                if cx.moving.moves(hit.shape) {
                    cx.scene.matter(hit.shape, hit.face).normal(hit.ns, &self.normal, cx.sink);
                    over = over.plus(-1.0, &Velocity::of(Source::at(hit), hit.p));
                }
                bend(cx, hit.shape, hit.p, hit.ns, &self.normal, &over);
            }
        }
    }
}

/// `<at, ẋ> + <turn, ṅ>` for a surface point that goes with its matter.
fn move_matter<S: Sink>(
    cx: &mut Chained<S>,
    [shape, face]: [u32; 2],
    p: DVec3,
    n: DVec3,
    at: &Covector,
    turn: &Covector,
) {
    if cx.moving.moves(shape) {
        let matter = cx.scene.matter(shape, face);
        matter.point(p, at, cx.sink);
        matter.normal(n, turn, cx.sink);
    }
}

/// The same for one that moves over its matter.
fn slide<S: Sink>(
    cx: &mut Chained<S>,
    shape: u32,
    p: DVec3,
    n: DVec3,
    at: &Covector,
    turn: &Covector,
    carried: &Velocity,
) {
    if !carried.is_zero() {
        carried.apply(cx.scene, cx.sensor, at, cx.sink);
        bend(cx, shape, p, n, turn, carried);
    }
}

/// `<turn, ṅ>` as a point moves over its surface.
fn bend<S: Sink>(cx: &mut Chained<S>, shape: u32, p: DVec3, n: DVec3, turn: &Covector, over: &Velocity) {
    let form = bend_form(cx.scene, shape, p, n, turn);
    over.apply(cx.scene, cx.sensor, &form, cx.sink);
}

/// The same as a form on its velocity.
fn bend_form(scene: &Scene, shape: u32, p: DVec3, n: DVec3, turn: &Covector) -> Covector {
    transposed(&scene.shapes[shape as usize].shape.curvature(p, n), turn)
}
