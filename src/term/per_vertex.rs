//! Terms E2 and E3 of [T] section 3 once more, from the vertices of camera paths: a validation mode for [`super::surface_edge`] and [`super::medium_edge`].
//!
//! Estimates the integral of [T] (24), `∫dl ∫dω sin α ∫∫ ds_S ds_D (-v) P(S) T(S,D) R(D)` with v of (25), in the solid-angle form of published path tracers: an ordinary
//! camera path, and at every vertex S of it a point B of an outline as S sees it (by `1/d²`), and the light that comes along the line from behind B. With `dω ds_S = dV_S / d²`
//! (on a surface `dω = dA_S |cos| / d²`, d = ‖S-B‖) a vertex of the weight W (the path's, σ_s included) brings
//!
//! `W f(S) T(S,B) sin α / d² / p(B) (-v) ∫ds_D T(B,D) R(D)`, f the phase function or `ρ f_s |cos|`, p(B) the density of B along the outline.
//!
//! Why it only validates: a vertex does not know which edges hide a lamp from it, or have light behind them, so most lines bring little; `1/d²`
//! is loud beside edges; and each vertex asks for a path of its own, so that the cost of a path grows like the square of its length. From the edge
//! outward none of this is so. What both forms share are the elements and their table, visibility at an edge, the far end, and how ends move; each has its own measure,
//! directions, near end, and importance.

use super::ends::{Point, Watch};
use super::grazing::Edges;
use super::{Context, Room, Sample};
use super::{medium_edge, surface_edge};
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::phase::one_minus_cos;
use crate::scene::Scene;
use crate::surface::Surface;
use crate::transport::camera_line;
use crate::transport::first::Seen;
use crate::transport::record::{MediumSpan, Recorder};
use crate::transport::walk::{Stage, State, Walker};
use std::sync::Arc;

/// Which vertices look for edges.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum At {
    Surfaces,
    Media,
}

pub struct PerVertex {
    edges: Arc<Edges>,
    at: At,
}

impl PerVertex {
    /// `surface_edge`.
    pub fn surfaces(edges: &Arc<Edges>) -> PerVertex {
        PerVertex { edges: edges.clone(), at: At::Surfaces }
    }

    /// `medium_edge`.
    pub fn media(edges: &Arc<Edges>) -> PerVertex {
        PerVertex { edges: edges.clone(), at: At::Media }
    }

    /// A line from the vertex `k` of the path, and what it brings.
    fn look(
        &self,
        cx: &mut Context,
        path: &Path,
        k: usize,
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
        film: [f64; 2],
    ) {
        let s = &path.vertices[k];
        let Some((g, distance)) = self.edges.sample_from(cx, &s.point, rng) else { return };
        let weight = s.weight * s.scatter(cx.scene, g.w()) * g.scale;
        if weight.is_zero() {
            return;
        }
        let Some(transmittance) = g.near_transmittance(cx.scene, &s.point, distance) else { return };
        let Some(far) = self.edges.far(cx, &g, rng) else { return };
        // S is one more scattering.
        let flux = far.light.shown(cx.set, s.depth + 1) * weight * transmittance;
        if flux.is_zero() {
            return;
        }
        let partials = g.motion(cx, &s.point, distance, &far, &path.watch(cx, k));
        emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
    }
}

impl Room for PerVertex {
    fn name(&self) -> &'static str {
        match self.at {
            At::Surfaces => surface_edge::NAME,
            At::Media => medium_edge::NAME,
        }
    }

    fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        // The path takes the even numbers.
        let mut stream = Rng::keyed(rng.next_u64(), 0, 0, 0);
        let path = Path::new(cx, film, *rng);
        for k in 0..path.vertices.len() {
            let on_surface = matches!(path.vertices[k].point, Point::Surface(_));
            if on_surface == (self.at == At::Surfaces) {
                self.look(cx, &path, k, &mut stream, emit, film);
            }
        }
    }

    fn has_outward(&self) -> bool {
        false
    }

    fn outward(&self, _: &mut Context, _: &Numbers, _: &mut Rng, _: &mut dyn FnMut(&Sample)) {}
}

/// Where a camera path scatters.
struct Vertex {
    point: Point,
    /// Direction of travel on arrival, away from the camera.
    w: DVec3,
    medium: Option<u32>,
    /// The path's medium span that it lies on, where it is known: on camera lines.
    span: Option<MediumSpan>,
    /// Scatterings before it.
    depth: u32,
    /// Throughput up to here over its density, per volume with σ_s, per area without reflectance.
    weight: Rgb,
}

impl Vertex {
    /// Scattering of light from the direction d per solid angle of d, its cosine included. Without σ_s.
    fn scatter(&self, scene: &Scene, d: DVec3) -> Rgb {
        match &self.point {
            Point::Surface(h) => match &scene.surfaces[scene.shapes[h.shape as usize].surface as usize] {
                surface @ Surface::Diffuse { reflectance, .. } => *reflectance * surface.eval_unit(h.ns, -self.w, d),
                _ => Rgb::ZERO,
            },
            _ => {
                let phase = self.medium.map(|id| scene.media[id as usize].phase.eval(one_minus_cos(self.w, d)));
                Rgb::splat(phase.unwrap_or(0.0))
            }
        }
    }

    /// As the first of its path.
    fn seen(&self) -> Option<Seen> {
        match self.point {
            Point::Surface(hit) => Some(Seen::Surface { hit, w: self.w }),
            Point::Medium(p) => self.span.map(|span| Seen::Medium { p, span }),
            Point::Infinity => None,
        }
    }
}

/// The vertices of a camera path, chain by chain: each chain has one of every depth from 0 on.
struct Path {
    vertices: Vec<Vertex>,
    max_depth: u32,
}

impl Path {
    fn new(cx: &mut Context, film: [f64; 2], rng: Rng) -> Path {
        let mut path = Path { vertices: Vec::new(), max_depth: cx.set.max_depth };
        let (o, w) = cx.sensor.ray(film[0], film[1]);
        let mut walker = Walker::new(cx.scene, cx.set, &mut path);
        let start = camera_line::start(&mut walker, State::new(rng, o, w, cx.sensor.medium));
        walker.run(start);
        cx.tally = cx.tally.plus(&walker.tally);
        path
    }

    /// How the path to its vertex k begins.
    fn watch(&self, cx: &Context, k: usize) -> Watch {
        let depth = self.vertices[k].depth as usize;
        let first = &self.vertices[k - depth];
        match depth {
            0 => first.seen().map_or_else(Watch::default, |seen| Watch::seen(cx, seen)),
            1 => Watch::new(cx, first.seen(), None),
            _ => Watch::new(cx, first.seen(), Some(&self.vertices[k - depth + 1].point)),
        }
    }
}

impl Recorder for Path {
    const ON: bool = false;
    const CONNECTS: bool = false;

    /// Called once a stage: the walk scatters at these, if it may.
    fn checkpoint(&mut self, scene: &Scene, s: &State) -> bool {
        let point = match s.stage {
            Stage::Medium => Point::Medium(s.o),
            Stage::Surface(hit) => {
                let shape = &scene.shapes[hit.shape as usize];
                if !scene.surfaces[shape.surface as usize].reflects(hit.ns, -s.w) {
                    return false;
                }
                Point::Surface(hit)
            }
            _ => return false,
        };
        if s.depth + 1 < self.max_depth {
            let weight = s.beta / s.r.mean();
            let (w, medium, span, depth) = (s.w, s.medium, s.flight.span, s.depth);
            self.vertices.push(Vertex { point, w, medium, span, depth, weight });
        }
        false
    }
}
