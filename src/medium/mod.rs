//! Participating media: extinction, albedo, phase function, emission, and how they depend on slots.

pub mod bright;
pub mod glow;
pub mod grid;

use crate::math::{DVec3, Rgb};
use crate::params::{Mover, ParamSet, Quantity, Sink, Slot};
use crate::phase::Phase;
use glow::Glow;
use grid::{Grid, Piece, Rate};
use std::sync::Arc;

/// A volume of numbers: constant, or a grid times nothing (scaling is the medium's).
#[derive(Clone, Debug)]
pub enum Volume {
    Constant(Rgb),
    Grid(Arc<Grid>),
}

impl Volume {
    pub fn at(&self, p: DVec3) -> Rgb {
        match self {
            Volume::Constant(c) => *c,
            Volume::Grid(g) => g.lookup_rgb(p),
        }
    }

    /// Largest value, per channel.
    pub fn max(&self) -> Rgb {
        match self {
            Volume::Constant(c) => *c,
            Volume::Grid(g) => Rgb(g.max3()),
        }
    }

    /// Its grid, if that ends at a box.
    fn clipped(&self) -> Option<&Grid> {
        match self {
            Volume::Grid(g) if g.clip_box().is_some() => Some(g),
            _ => None,
        }
    }

    /// Partials of what has the partials `weight` by the volume's value at a point: by its channels, or by the voxels around.
    fn partials(&self, params: &ParamSet, first: Slot, p: DVec3, weight: Rgb, f: &mut impl FnMut(Slot, Rgb)) {
        if first == NO_SLOT {
            return;
        }
        match self {
            Volume::Constant(_) => {
                for c in 0..3 {
                    if params.is_active(first + c as Slot) {
                        f(first + c as Slot, Rgb::channel(c, weight[c]));
                    }
                }
            }
            Volume::Grid(g) if params.is_active(first) => {
                g.active_nodes(p, |k, w| voxel(g, first, k, weight * w, f));
            }
            Volume::Grid(_) => {}
        }
    }

    /// Whether any slot from this one on is active that belongs to it.
    fn active(&self, params: &ParamSet, first: Slot) -> bool {
        let len = if matches!(self, Volume::Grid(_)) { 1 } else { 3 };
        first != NO_SLOT && params.block_active(first, len)
    }

    /// Per channel, 1/length.
    pub fn gradient(&self, p: DVec3) -> [DVec3; 3] {
        match self {
            Volume::Constant(_) => [DVec3::ZERO; 3],
            Volume::Grid(g) => g.gradient3(p),
        }
    }
}

/// First slots of a medium's quantities; `u32::MAX` where one does not exist, or is a grid whose voxels are not open as an array.
#[derive(Clone, Copy, Debug)]
pub struct MediumSlots {
    pub sigma_t: Slot,
    pub albedo: Slot,
    pub scale: Slot,
    pub g: Slot,
    /// Of a density grid with a transform: the field moves with it.
    pub mover: Option<Mover>,
    /// Of an albedo grid likewise.
    pub albedo_mover: Option<Mover>,
}

pub const NO_SLOT: Slot = Slot::MAX;

/// Partials by the k-th active voxel of an open grid, of what has the partials `weight` by its channels.
#[inline]
fn voxel(g: &Grid, first: Slot, k: u32, weight: Rgb, f: &mut impl FnMut(Slot, Rgb)) {
    if g.channels() == 1 {
        f(first + k, weight);
    } else {
        (0..3).for_each(|c| f(first + 3 * k + c as Slot, Rgb::channel(c, weight[c])));
    }
}

/// `sigma_t(x) = scale * density(x)`, `sigma_s(x) = albedo(x) * sigma_t(x)`.
#[derive(Clone, Debug)]
pub struct Medium {
    pub name: String,
    pub density: Volume,
    pub scale: f64,
    pub albedo: Volume,
    /// Emitted radiance L_e, multiplied by sigma_a [S] (4).
    pub emission: Option<Glow>,
    pub phase: Phase,
    pub slots: MediumSlots,
    /// Extinction and scattering of a homogeneous medium; of a grid medium, the largest ones.
    pub sigma_t: Rgb,
    pub sigma_s: Rgb,
    /// The albedo where it is constant, 1 where it is a grid.
    pub constant_albedo: Rgb,
    /// 1/length: the extinction at which a source derivative is shared evenly between collision scores and
    /// derivative vertices (`transport::sweep`); one over the medium's extent.
    pub kappa: f64,
    /// Same extinction in all channels.
    pub gray: bool,
}

/// Points a mean free path at which the depth of fine grids is differentiated: as many times less than the variance of a collision's score is what they add, at most.
const DENSER: f64 = 4.0;

/// Points at which a depth is differentiated: one offset for all, uniform in [0, 1), and how many times as many as on light that has scattered.
#[derive(Clone, Copy, Debug)]
pub struct Points {
    pub u: f64,
    pub denser: f64,
}

/// A sink that is a function.
struct Each<'a, F>(&'a mut F);

impl<F: FnMut(Slot, Rgb)> Sink for Each<'_, F> {
    fn add(&mut self, slot: Slot, partial: Rgb) {
        (self.0)(slot, partial);
    }
}

impl Medium {
    pub fn is_homogeneous(&self) -> bool {
        matches!((&self.density, &self.albedo), (Volume::Constant(_), Volume::Constant(_)))
    }

    /// The grid that extinction follows, if it does.
    pub fn density_grid(&self) -> Option<&Grid> {
        match &self.density {
            Volume::Grid(g) => Some(g),
            Volume::Constant(_) => None,
        }
    }

    /// Grids at whose boxes the medium may end: of density, albedo and emission.
    pub fn clipped_grids(&self) -> impl Iterator<Item = &Grid> {
        let volumes = [Some(&self.density), Some(&self.albedo), self.emission.as_ref().map(|e| &e.volume)];
        volumes.into_iter().flatten().filter_map(Volume::clipped)
    }

    /// Single-scattering albedo at a world point.
    pub fn albedo_at(&self, p: DVec3) -> Rgb {
        self.albedo.at(p)
    }

    /// `(sigma_t, sigma_s)` at a world point, 1/length.
    pub fn coefficients(&self, p: DVec3) -> (Rgb, Rgb) {
        if self.is_homogeneous() {
            return (self.sigma_t, self.sigma_s);
        }
        let t = self.density.at(p) * self.scale;
        (t, t * self.albedo.at(p))
    }

    /// Emission per unit length at a world point without its extinction: `(sigma_a, L_e)` [T] (2).
    pub fn glow(&self, p: DVec3) -> Option<(Rgb, Rgb)> {
        let e = self.emission.as_ref()?;
        let (sigma_t, sigma_s) = self.coefficients(p);
        Some((sigma_t - sigma_s, e.at(p)))
    }

    /// The part of [t0, t1] in which it may glow; empty if the first is not below the second.
    pub fn glow_range(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> (f64, f64) {
        let Some(e) = &self.emission else { return (t0, t0) };
        let grids = [&e.volume, &self.density].into_iter().filter_map(|v| match v {
            Volume::Grid(g) => Some(g),
            Volume::Constant(_) => None,
        });
        grids.fold((t0, t1), |(a, b), g| g.clip_ray(o, w, a, b))
    }

    /// `∇σ_s` at a world point, per channel, 1/length².
    pub fn sigma_s_gradient(&self, p: DVec3) -> [DVec3; 3] {
        self.share_gradient(p, self.albedo.at(p), 1.0)
    }

    /// `∇(σ_a L_e)` likewise.
    pub fn glow_gradient(&self, p: DVec3) -> [DVec3; 3] {
        let (Some((sigma_a, color)), Some(e)) = (self.glow(p), &self.emission) else { return [DVec3::ZERO; 3] };
        let (by_a, by_e) = (self.share_gradient(p, Rgb::ONE - self.albedo.at(p), -1.0), e.gradient(p));
        std::array::from_fn(|c| by_a[c] * color[c] + by_e[c] * sigma_a[c])
    }

    /// Gradient of `share x sigma_t`, where the share changes with the albedo at the rate `slope`.
    fn share_gradient(&self, p: DVec3, share: Rgb, slope: f64) -> [DVec3; 3] {
        let (density, by_density, by_albedo) = (self.density.at(p), self.density.gradient(p), self.albedo.gradient(p));
        std::array::from_fn(|c| (by_density[c] * share[c] + by_albedo[c] * (slope * density[c])) * self.scale)
    }

    /// `d sigma_s / d slot` at a world point for every active slot, per channel; `sigma_s = albedo sigma_t`.
    pub fn sigma_s_partials(&self, params: &ParamSet, p: DVec3, f: impl FnMut(Slot, Rgb)) {
        self.share_partials(params, p, self.albedo.at(p), 1.0, f);
    }

    /// `d sigma_a / d slot` likewise; `sigma_a = (1 - albedo) sigma_t`.
    pub fn sigma_a_partials(&self, params: &ParamSet, p: DVec3, f: impl FnMut(Slot, Rgb)) {
        self.share_partials(params, p, Rgb::ONE - self.albedo.at(p), -1.0, f);
    }

    /// How sigma_t at a fixed point changes as its grid moves past, times `weight`.
    fn motion_partials(&self, mover: &Mover, p: DVec3, weight: Rgb, sink: &mut impl Sink) {
        let Some(grid) = self.density_grid() else { return };
        mover.field(p, &grid.gradient3(p), weight * self.scale, sink);
    }

    /// The mover of the density, if any parameter moves it.
    fn moves(&self, params: &ParamSet) -> Option<&Mover> {
        self.slots.mover.as_ref().filter(|m| params.block_active(m.first, Mover::SLOTS))
    }

    /// That of the albedo likewise.
    fn albedo_moves(&self, params: &ParamSet) -> Option<&Mover> {
        self.slots.albedo_mover.as_ref().filter(|m| params.block_active(m.first, Mover::SLOTS))
    }

    /// Partials of `share x sigma_t`, where the share changes with the albedo at the rate `slope`.
    fn share_partials(&self, params: &ParamSet, p: DVec3, share: Rgb, slope: f64, mut f: impl FnMut(Slot, Rgb)) {
        let s = &self.slots;
        let density = self.density.at(p);
        if let Some(mover) = self.moves(params) {
            self.motion_partials(mover, p, share, &mut Each(&mut f));
        }
        if let Some(mover) = self.albedo_moves(params) {
            mover.field(p, &self.albedo.gradient(p), density * (slope * self.scale), &mut Each(&mut f));
        }
        if s.scale != NO_SLOT && params.is_active(s.scale) {
            f(s.scale, density * share);
        }
        self.density.partials(params, s.sigma_t, p, share * self.scale, &mut f);
        self.albedo.partials(params, s.albedo, p, density * (slope * self.scale), &mut f);
    }

    /// `d (integral of sigma_t over a span) / d slot`, per channel [T] (11) with fixed points; with `points` an unbiased estimate for grids that are fine
    /// ([`Grid::pieces`]), the same for all slots, without them exact.
    pub fn depth_partials(
        &self,
        params: &ParamSet,
        (o, w): (DVec3, DVec3),
        (t0, t1): (f64, f64),
        points: Option<Points>,
        mut f: impl FnMut(Slot, Rgb),
    ) {
        let s = &self.slots;
        let by_scale = s.scale != NO_SLOT && params.is_active(s.scale);
        let grid = match &self.density {
            Volume::Grid(g) => g,
            Volume::Constant(c) => {
                let length = t1 - t0;
                if by_scale {
                    f(s.scale, *c * length);
                }
                return self.density.partials(params, s.sigma_t, o, Rgb::splat(self.scale * length), &mut f);
            }
        };
        let voxels = s.sigma_t != NO_SLOT && params.is_active(s.sigma_t);
        let mover = self.moves(params);
        let by_voxel = |k: u32, weight: f64, f: &mut _| voxel(grid, s.sigma_t, k, Rgb::splat(self.scale * weight), f);
        let mut density = Rgb::ZERO;
        let drawn = points.map(|Points { u, denser }| {
            let by = DENSER * denser;
            (Rate { by_value: by * self.scale, floor: by * self.kappa }, u)
        });
        grid.pieces(o, w, t0, t1, drawn, |piece| match piece {
            Piece::Whole(span) => {
                if let Some(mover) = mover {
                    let each = &mut Each(&mut f);
                    grid.quadrature(&span, o, w, &mut |weight, p| {
                        self.motion_partials(mover, p, Rgb::splat(weight), each);
                    });
                }
                if by_scale {
                    density += Rgb(grid.integrate_span(&span, o, w));
                }
                if voxels {
                    grid.integrate_active(&span, o, w, &mut |k, weight| by_voxel(k, weight, &mut f));
                }
            }
            Piece::Point { t, weight } => {
                let p = o + w * t;
                if let Some(mover) = mover {
                    self.motion_partials(mover, p, Rgb::splat(weight), &mut Each(&mut f));
                }
                if by_scale {
                    density += grid.lookup_rgb(p) * weight;
                }
                if voxels {
                    grid.active_nodes(p, |k, share| by_voxel(k, weight * share, &mut f));
                }
            }
        });
        if by_scale {
            f(s.scale, density);
        }
    }

    /// Integral of the density (before `scale`) along a span; exact, also for grids.
    pub fn density_integral(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> Rgb {
        match &self.density {
            Volume::Constant(c) => *c * (t1 - t0),
            Volume::Grid(g) if g.channels() == 1 => Rgb::splat(g.integrate(o, w, t0, t1)),
            Volume::Grid(g) => Rgb(g.integrate3(o, w, t0, t1)),
        }
    }

    /// Whether any slot that scattering depends on is active.
    pub fn source_active(&self, params: &ParamSet) -> bool {
        self.extinction_active(params)
            || self.albedo.active(params, self.slots.albedo)
            || self.albedo_moves(params).is_some()
    }

    /// Whether any slot that extinction depends on is active.
    pub fn extinction_active(&self, params: &ParamSet) -> bool {
        let scale = self.slots.scale;
        self.density.active(params, self.slots.sigma_t)
            || scale != NO_SLOT && params.is_active(scale)
            || self.moves(params).is_some()
    }

    /// The volume that carries a quantity, with its first slot.
    pub fn volume_mut(&mut self, quantity: Quantity) -> Option<(&mut Volume, &mut Slot)> {
        let s = &mut self.slots;
        match quantity {
            Quantity::SigmaT => Some((&mut self.density, &mut s.sigma_t)),
            Quantity::Albedo => Some((&mut self.albedo, &mut s.albedo)),
            Quantity::Glow | Quantity::Temperature => {
                let e = self.emission.as_mut().filter(|e| e.quantity() == quantity)?;
                Some((&mut e.volume, &mut e.slots.value))
            }
            _ => None,
        }
    }

    /// Put another grid of the same place and topology where the one is that carries a quantity; bounds of the coefficients follow.
    pub fn set_grid(&mut self, quantity: Quantity, grid: Grid) {
        if let Some((volume, _)) = self.volume_mut(quantity) {
            *volume = Volume::Grid(Arc::new(grid));
        }
        self.sigma_t = self.density.max() * self.scale;
        self.sigma_s = self.sigma_t * self.albedo.max();
    }

    /// The grid that carries a quantity, with the first slot of its voxels.
    pub fn grid_of(&self, quantity: Quantity) -> Option<(&Arc<Grid>, Slot)> {
        let (volume, first) = match quantity {
            Quantity::SigmaT => (&self.density, self.slots.sigma_t),
            Quantity::Albedo => (&self.albedo, self.slots.albedo),
            Quantity::Glow | Quantity::Temperature => {
                let e = self.emission.as_ref().filter(|e| e.quantity() == quantity)?;
                (&e.volume, e.slots.value)
            }
            _ => return None,
        };
        match volume {
            Volume::Grid(g) => Some((g, first)),
            Volume::Constant(_) => None,
        }
    }

    pub fn g_active(&self, params: &ParamSet) -> bool {
        self.slots.g != NO_SLOT && params.is_active(self.slots.g)
    }
}
