//! Camera paths vertex by vertex, for terms that look at edges from each of them.

use super::Context;
use super::ends::{Point, Watch};
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::phase::one_minus_cos;
use crate::scene::{On, Scene};
use crate::surface::Surface;
use crate::transport::first::{FilmLine, First, Leg, Met, Nth, Opening, Seen};
use crate::transport::record::{Event, MediumSpan, Recorder};
use crate::transport::shot::Place;
use crate::transport::state::{Stage, State};
use crate::transport::velocity::Velocity;
use crate::transport::walk::Walker;

/// Where a camera path scatters.
pub struct Vertex {
    pub point: Point,
    /// Direction of travel on arrival, away from the camera.
    pub w: DVec3,
    pub medium: Option<u32>,
    /// The path's medium span that it lies on, where it is known: on camera lines, and behind interfaces.
    span: Option<MediumSpan>,
    /// Scatterings before it.
    pub depth: u32,
    /// Throughput up to here over its density, per volume with σ_s, per area without reflectance.
    pub weight: Rgb,
    /// How the path's last leg has begun, without this vertex.
    opening: Opening,
}

impl Vertex {
    pub fn p(&self) -> DVec3 {
        match self.point {
            Point::Surface(h) => h.p,
            Point::Medium(p) => p,
            Point::Infinity => DVec3::ZERO,
        }
    }

    pub fn on_surface(&self) -> bool {
        matches!(self.point, Point::Surface(_))
    }

    /// Whether the path has come by way of a smooth interface.
    pub fn is_behind(&self) -> bool {
        self.opening.legs[0] < self.opening.legs[1]
    }

    /// What rays that leave it begin in.
    pub fn place(&self, scene: &Scene) -> Place {
        match &self.point {
            Point::Surface(h) => {
                let behind = scene.shapes[h.shape as usize].medium_behind(self.w, h.n, self.medium);
                Place { on: On::at(h), medium: self.medium, beyond: Some((h.n * h.n.dot(self.w), behind)) }
            }
            _ => Place::within(self.medium),
        }
    }

    /// Scattering of light from the direction d per solid angle of d, its cosine included. Without σ_s.
    pub fn scatter(&self, scene: &Scene, d: DVec3) -> Rgb {
        match &self.point {
            Point::Surface(h) => match scene.surface_of(h.shape) {
                surface @ Surface::Diffuse { reflectance, .. } => *reflectance * surface.eval_unit(h.ns, -self.w, d),
                Surface::Rough(rough) => {
                    let lobe = rough.eval(h.normals(), -self.w, d);
                    lobe.tint * lobe.f
                }
                _ => Rgb::ZERO,
            },
            _ => {
                let phase = self.medium.map(|id| scene.media[id as usize].phase.eval(one_minus_cos(self.w, d)));
                Rgb::splat(phase.unwrap_or(0.0))
            }
        }
    }

    /// As the first of its leg.
    fn seen(&self) -> Option<Seen> {
        match self.point {
            Point::Surface(hit) => Some(Seen::Surface { hit, w: self.w }),
            Point::Medium(p) => self.span.map(|span| Seen::Medium { p, span }),
            Point::Infinity => None,
        }
    }

    fn met(&self) -> Met {
        match self.point {
            Point::Surface(hit) => Met::Surface(hit),
            _ => Met::Medium(self.p()),
        }
    }
}

/// The vertices of a camera path, chain by chain: each chain has one of every depth from 0 on, but for what smooth surfaces turn.
pub struct Path {
    pub vertices: Vec<Vertex>,
    legs: Vec<Leg>,
    opening: Opening,
    max_depth: u32,
}

impl Path {
    pub fn new(cx: &mut Context, film: [f64; 2], rng: Rng) -> Path {
        let (vertices, legs, opening) = (Vec::new(), Vec::new(), Opening::default());
        let mut path = Path { vertices, legs, opening, max_depth: cx.set.max_depth };
        let (o, w) = cx.sensor.ray(film[0], film[1]);
        let mut walker = Walker::new(cx.scene, cx.set, &mut path);
        walker.trace(&mut State::new(rng, o, w, cx.sensor.medium));
        cx.tally = cx.tally.plus(&walker.tally);
        path
    }

    /// How the leg of a vertex begins, with it if it is the first, and which of the leg's vertices it is.
    fn begun(&self, cx: &Context, v: &Vertex) -> (First, Nth) {
        let (scene, moving) = (cx.scene, cx.moving);
        let mut ray = moving.film_ray().clone();
        for leg in &self.legs[v.opening.legs[0] as usize..v.opening.legs[1] as usize] {
            let line = FilmLine { scene, moving, ray: &ray };
            let came = line.coming(&line.opening(&leg.before), &leg.before, &leg.end);
            ray = FilmLine { scene, moving, ray: &came }.behind(&leg.end);
        }
        let line = FilmLine { scene, moving, ray: &ray };
        match (v.opening.first, v.opening.second) {
            (None, _) => (v.seen().map(|s| line.first(&s)).unwrap_or_default(), Nth::First),
            (Some(_), None) => (line.opening(&v.opening), Nth::Second),
            _ => (line.opening(&v.opening), Nth::Later),
        }
    }

    /// How the path to a vertex begins.
    pub fn watch(&self, cx: &Context, v: &Vertex) -> Watch {
        if !cx.moving.any() {
            return Watch::default();
        }
        let (first, place) = self.begun(cx, v);
        Watch::of(first, place)
    }

    pub fn velocity(&self, cx: &Context, v: &Vertex) -> Velocity {
        let (first, place) = self.begun(cx, v);
        cx.moving.vertex(cx.scene, &first, place, &v.met())
    }
}

impl Recorder for Path {
    const ON: bool = true;
    const CONNECTS: bool = false;

    fn push(&mut self, e: Event) {
        self.legs.extend(self.opening.ended_by(&e));
        self.opening.follow(&e);
    }

    /// Called once a stage: the walk scatters at these, if it may.
    fn checkpoint(&mut self, scene: &Scene, s: &State) -> bool {
        let point = match s.stage {
            Stage::Medium => Point::Medium(s.o),
            Stage::Surface(hit) => {
                let surface = scene.surface_of(hit.shape);
                if surface.is_smooth() || !surface.reflects(hit.ns, -s.w) {
                    return false;
                }
                Point::Surface(hit)
            }
            _ => return false,
        };
        if s.depth + 1 < self.max_depth {
            let weight = s.beta / s.r.mean();
            let (w, medium, span, depth, opening) = (s.w, s.medium, s.flight.span, s.depth, self.opening);
            self.vertices.push(Vertex { point, w, medium, span, depth, weight, opening });
        }
        false
    }
}
