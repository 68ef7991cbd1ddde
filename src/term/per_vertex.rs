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

use super::grazing::Edges;
use super::seen_path::{Path, Vertex};
use super::{Context, Room, Sample};
use super::{medium_edge, surface_edge};
use crate::math::guide::Numbers;
use crate::math::rng::Rng;
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
        s: &Vertex,
        rng: &mut Rng,
        emit: &mut dyn FnMut(&Sample),
        film: [f64; 2],
    ) {
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
        let partials = g.motion(cx, &s.point, distance, &far, &path.watch(cx, s));
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
        // Behind interfaces it is `virtual_edge` that looks.
        for v in path.vertices.iter().filter(|v| !v.is_behind() && v.on_surface() == (self.at == At::Surfaces)) {
            self.look(cx, &path, v, &mut stream, emit, film);
        }
    }

    fn has_outward(&self) -> bool {
        false
    }

    fn outward(&self, _: &mut Context, _: &Numbers, _: &mut Rng, _: &mut dyn FnMut(&Sample)) {}
}
