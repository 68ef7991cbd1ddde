//! Sheets: surfaces in space across which the light of a zero-measure light jumps, and what a point of one adds to the picture.
//!
//! A sheet is swept by rays ([`Ray`]) that graze an outline or run along a cone; a point of it is `origin + ρ w`. For a light with a
//! position the measure is `ρ dφ dρ` (φ the angle between neighbouring rays), for a distant one `dl dρ` (l the length
//! across) [T] (36), (62). Moving with normal velocity v_n (n toward the lit side) it adds `-v_n E f_p σ_s` to what its points
//! scatter, E being the irradiance across the ray on its lit side.

use crate::math::DVec3;
use crate::math::equiangular::EquiAngular;
use crate::medium::Volume;
use crate::params::Partial;
use crate::scene::Scene;
use crate::sensor::{Projection, Sensor};
use crate::shape::{Bounds, Geometry};

/// A ray of a sheet.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub light: u32,
    /// The light, or for a distant one a point of the outline.
    pub origin: DVec3,
    /// Unit, away from the light.
    pub w: DVec3,
    /// Where the sheet begins on it.
    pub near: f64,
    /// Unit, across the sheet, toward the lit side.
    pub n: DVec3,
    /// Density of drawing the ray, per angle or (distant) per length across, given the light.
    pub across: f64,
    pub distant: bool,
    /// Camera rays find their crossings with this sheet.
    pub crossed: bool,
    /// The sheet is the edge of the light's own profile: its lit side has the full intensity.
    pub profile: bool,
    /// Points of it in media are this technique's, not receivers alone.
    pub in_media: bool,
}

impl Ray {
    pub fn at(&self, rho: f64) -> DVec3 {
        self.origin + self.w * rho
    }

    /// Measure of the sheet a unit of (across x ρ).
    pub fn spread(&self, rho: f64) -> f64 {
        if self.distant { 1.0 } else { rho }
    }
}

/// What a sheet's rays graze: shapes, of meshes certain faces only. Nothing for a light's own edge.
pub type Grazed<'a> = &'a [(u32, Vec<u32>)];

/// Where on its rays a sheet is sampled: in the box of all media, by the angle that distances subtend at the camera.
#[derive(Clone, Debug)]
pub struct Reach {
    media: Option<Bounds>,
    /// The camera, for a pinhole.
    eye: Option<DVec3>,
    /// A length of the scene.
    size: f64,
}

impl Reach {
    pub fn new(scene: &Scene, sensor: &Sensor) -> Reach {
        let eye = match sensor.projection {
            Projection::Perspective { .. } => Some(sensor.to_world.translation),
            Projection::Orthographic => None,
        };
        let size = scene.bounds.radius();
        Reach { media: media_box(scene), eye, size: if size > 0.0 { size } else { 1.0 } }
    }

    /// The camera, for a pinhole.
    pub fn eye(&self) -> Option<DVec3> {
        self.eye
    }

    /// The part of (t0, t1) of a ray in the media's box.
    pub fn clip(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> Option<(f64, f64)> {
        let (mut lo, mut hi) = (t0, t1);
        if let Some(b) = &self.media {
            for k in 0..3 {
                let inv = w[k].recip();
                if inv.is_finite() {
                    let (a, c) = ((b.min[k] - o[k]) * inv, (b.max[k] - o[k]) * inv);
                    (lo, hi) = (lo.max(a.min(c)), hi.min(a.max(c)));
                } else if o[k] < b.min[k] || o[k] > b.max[k] {
                    return None;
                }
            }
        }
        (lo < hi).then_some((lo, hi))
    }

    /// Distance on a ray from `near` outward and its density.
    pub fn sample(&self, ray: &Ray, u: f64) -> Option<(f64, f64)> {
        let (lo, hi) = self.clip(ray.origin, ray.w, ray.near, f64::INFINITY)?;
        if let Some(eye) = self.eye {
            let d = EquiAngular::new(eye, ray.origin, ray.w, lo, hi);
            if !d.usable() {
                return None;
            }
            let t = d.sample(u);
            return Some((t, d.density(t)));
        }
        // Parallel camera rays: uniform where the box is bounded, of long tail where it is not.
        if hi < f64::INFINITY {
            return Some((lo + u * (hi - lo), 1.0 / (hi - lo)));
        }
        let t = lo + self.size * u / (1.0 - u);
        Some((t, self.size / (self.size + (t - lo)).powi(2)))
    }

    /// The density of [`Reach::sample`] at `rho`; 0 where it never draws.
    pub fn density(&self, ray: &Ray, rho: f64) -> f64 {
        let Some((lo, hi)) = self.clip(ray.origin, ray.w, ray.near, f64::INFINITY) else { return 0.0 };
        if rho < lo || rho > hi {
            return 0.0;
        }
        if let Some(eye) = self.eye {
            let d = EquiAngular::new(eye, ray.origin, ray.w, lo, hi);
            return if d.usable() { d.density(rho) } else { 0.0 };
        }
        if hi < f64::INFINITY { 1.0 / (hi - lo) } else { self.size / (self.size + (rho - lo)).powi(2) }
    }
}

/// The box of everything that scatters; `None` where it has no end.
pub(super) fn media_box(scene: &Scene) -> Option<Bounds> {
    let mut all = Bounds::EMPTY;
    for (i, m) in scene.media.iter().enumerate() {
        let id = Some(i as u32);
        let mut own = Bounds::EMPTY;
        for s in scene.shapes.iter().filter(|s| s.boundary) {
            if s.exterior == id || (s.interior == id && !s.shape.is_closed()) {
                return None;
            }
            if s.interior == id {
                own = own.union(&s.shape.bounds());
            }
        }
        let grid = match &m.density {
            Volume::Grid(g) if g.background() == [0.0; 3] => g.world_bounds().map(|(a, b)| Bounds::new(a, b)),
            _ => None,
        };
        let own = match (own.is_empty(), grid) {
            (true, None) => return None,
            (true, Some(g)) => g,
            (false, None) => own,
            (false, Some(g)) => Bounds::new(own.min.max(g.min), own.max.min(g.max)),
        };
        all = if own.is_empty() { all } else { all.union(&own) };
    }
    Some(all)
}

/// Partials of one sample.
#[derive(Clone, Debug, Default)]
pub struct Partials(Vec<Partial>);

impl Partials {
    pub fn push(&mut self, p: Partial) {
        self.0.push(p);
    }

    pub fn extend(&mut self, forms: impl IntoIterator<Item = Partial>) {
        self.0.extend(forms);
    }

    pub fn as_slice(&self) -> &[Partial] {
        &self.0
    }
}
