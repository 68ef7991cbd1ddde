//! Lights. Each gives what reaches a point (`sample`), what a ray that hits it collects (`Escape` and area emission), and
//! the slots its emission depends on. Emission is `slot value x unit`, so no derivative divides by an intensity.

pub mod envmap;

use crate::math::{DVec3, Real, Rgb, V3};
use crate::params::{ParamSet, Partial, Slot};
use envmap::Envmap;
use std::f64::consts::PI;

/// How an emitted colour depends on slots: `value[c] * unit[c]` with three slots, or `scale * unit[c]` with one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emission {
    pub first: Slot,
    /// Three slots (one a channel) or one for all.
    pub per_channel: bool,
    pub unit: Rgb,
    pub value: Rgb,
}

impl Emission {
    pub fn color(&self) -> Rgb {
        self.value * self.unit
    }
}

#[derive(Clone, Debug)]
pub enum LightKind {
    /// Radiant intensity (power per solid angle), uniform.
    Point { position: DVec3 },
    /// Intensity along `axis`, falling to 0 between `cos_beam` and `cos_cutoff` [T] (28).
    Spot { position: DVec3, axis: DVec3, beam: f64, cutoff: f64 },
    /// Irradiance on a plane across `direction` (the direction of travel) [T] (29).
    Directional { direction: DVec3 },
    /// A beam of parallel rays: irradiance on a plane across `direction`, from `position` on. Within `radius`, or falling as [`beam_profile`].
    Beam { position: DVec3, direction: DVec3, radius: f64, gaussian: bool },
    /// Radiance leaving the front of a shape.
    Area { shape: u32 },
    /// The same radiance from everywhere.
    Constant,
    /// Radiance by direction; one slot, its scale.
    Envmap(Box<Envmap>),
}

/// Where light without extent comes from, or a beam.
#[derive(Clone, Copy, Debug)]
pub enum Origin<R> {
    Position(V3<R>),
    /// From infinity, travelling along this unit vector.
    Infinity(V3<R>),
}

#[derive(Clone, Debug)]
pub struct Light {
    pub name: String,
    pub kind: LightKind,
    /// Radiance, intensity or irradiance; for an environment map its scale in every channel.
    pub value: Rgb,
    pub slot: Slot,
    pub place: Place,
}

/// Slots of where a light of zero measure stands and looks; `NO_SLOT` where it has no such thing.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    pub position: Slot,
    pub direction: Slot,
    /// Beam width, then cutoff.
    pub angles: Slot,
    /// Of a beam.
    pub radius: Slot,
}

impl Place {
    /// Its numbers: their first slot and how many there are.
    fn blocks(&self) -> impl Iterator<Item = (Slot, u32)> {
        let all = [(self.position, 3), (self.direction, 3), (self.angles, 2), (self.radius, 1)];
        all.into_iter().filter(|b| b.0 != Slot::MAX)
    }

    /// Whether this slot is one of its numbers.
    pub fn holds(&self, slot: Slot) -> bool {
        self.blocks().any(|(first, n)| (first..first + n).contains(&slot))
    }

    /// Whether any parameter moves the light.
    pub fn moves(&self, params: &ParamSet) -> bool {
        self.blocks().any(|(first, n)| params.block_active(first, n))
    }
}

/// Light that may arrive at a point from direction `w`.
#[derive(Clone, Copy, Debug)]
pub struct Arrival {
    /// Unit, from the point toward the light.
    pub w: DVec3,
    /// Distance, infinite for distant lights.
    pub distance: f64,
    /// What multiplies the emitted colour: 1/r^2, 1, or 1/pdf.
    pub factor: f64,
    pub emission: Emission,
    /// Density per solid angle of drawing `w`; 0 for lights of zero measure (no other technique finds them).
    pub pdf: f64,
    /// The shape that a clear ray ends on, and its face there.
    pub target: Option<(u32, u32)>,
    /// Its normal there.
    pub n: DVec3,
}

/// Smooth spot falloff: 1 inside the beam angle, 0 outside the cutoff, linear in the angle between, as Mitsuba has it.
/// With beam = cutoff the edge is hard.
pub fn spot_falloff<R: Real>(cos: R, beam: R, cutoff: R) -> R {
    let c = cos.value();
    if c >= beam.value().cos() {
        R::one()
    } else if c <= cutoff.value().cos() {
        R::zero()
    } else {
        // acos through atan2 keeps its digits near the axis.
        let sin = (-(cos * cos) + 1.0).sqrt();
        (-sin.atan2(cos) + cutoff) / (cutoff - beam)
    }
}

/// Irradiance of a beam at the distance rho from its axis over that on it.
pub fn beam_profile<R: Real>(rho: R, radius: R, gaussian: bool) -> R {
    if gaussian {
        (-(rho / radius).sqr() * 2.0).exp()
    } else if rho.value() < radius.value() {
        R::one()
    } else {
        R::zero()
    }
}

/// `1/r^2` of a point light [T] (28), generic for derivatives.
pub fn inverse_square<R: Real>(u: V3<R>) -> R {
    u.length_squared().recip()
}

/// By rays along `direction`, which begin at this distance.
fn parallel(direction: DVec3, distance: f64, emission: Emission) -> Arrival {
    Arrival { w: -direction, distance, factor: 1.0, emission, pdf: 0.0, target: None, n: DVec3::ZERO }
}

impl Light {
    pub fn emission(&self, unit: Rgb) -> Emission {
        Emission { first: self.slot, per_channel: !matches!(self.kind, LightKind::Envmap(_)), unit, value: self.value }
    }

    /// Zero-measure: only next-event estimation finds it.
    pub fn is_delta(&self) -> bool {
        matches!(self.kind, LightKind::Point { .. } | LightKind::Spot { .. } | LightKind::Directional { .. })
    }

    /// Collimated.
    pub fn is_beam(&self) -> bool {
        matches!(self.kind, LightKind::Beam { .. })
    }

    pub fn is_at_infinity(&self) -> bool {
        matches!(self.kind, LightKind::Directional { .. } | LightKind::Constant | LightKind::Envmap(_))
    }

    /// The position that a 1/r^2 singularity sits at.
    pub fn center(&self) -> Option<DVec3> {
        match self.kind {
            LightKind::Point { position } | LightKind::Spot { position, .. } => Some(position),
            _ => None,
        }
    }

    /// Light that a ray leaving the scene along `w` (propagation against the light) collects, if this one is an environment, and the
    /// density per solid angle with which `sample` draws that direction; 0 where it never draws (constant), or where nothing is to be weighed by it.
    pub fn escape(&self, w: DVec3, weighs: bool) -> Option<(Emission, f64)> {
        match &self.kind {
            LightKind::Constant => Some((self.emission(Rgb::ONE), 0.0)),
            LightKind::Envmap(e) => {
                let (radiance, pdf) = e.look(w, weighs);
                Some((self.emission(radiance), pdf))
            }
            _ => None,
        }
    }

    /// How that light changes with w, per channel; `None` where it is the same from everywhere.
    pub fn escape_slope(&self, w: DVec3) -> Option<[DVec3; 3]> {
        let LightKind::Envmap(e) = &self.kind else { return None };
        let slope = e.slope(w);
        // Linear in the map's radiance.
        Some(std::array::from_fn(|c| slope[c] * self.emission(Rgb::ONE).color()[c]))
    }

    /// The direction toward a light at infinity without extent.
    pub fn single_direction(&self) -> Option<DVec3> {
        match self.kind {
            LightKind::Directional { direction } => Some(-direction),
            _ => None,
        }
    }

    /// Where its rays come from, if one ray of it at most reaches a point straight.
    pub fn origin(&self) -> Option<Origin<f64>> {
        match self.kind {
            LightKind::Point { position } | LightKind::Spot { position, .. } => {
                Some(Origin::Position(V3::constant(position)))
            }
            LightKind::Directional { direction } | LightKind::Beam { direction, .. } => {
                Some(Origin::Infinity(V3::constant(direction)))
            }
            LightKind::Area { .. } | LightKind::Constant | LightKind::Envmap(_) => None,
        }
    }

    /// Where light without extent, or of a beam, begins, if that is a place.
    pub fn stands(&self) -> Option<DVec3> {
        match self.kind {
            LightKind::Beam { position, .. } => Some(position),
            _ => self.center(),
        }
    }

    /// What such a light sends toward a point: intensity, or irradiance across its rays.
    pub fn emission_toward(&self, p: DVec3) -> Option<Emission> {
        self.straight(p).map(|a| a.emission)
    }

    /// What such a light, or a beam, brings straight to a point.
    pub fn straight(&self, p: DVec3) -> Option<Arrival> {
        let LightKind::Beam { position, direction, radius, gaussian } = self.kind else {
            return self.sample(p, 0.0, 0.0);
        };
        let m = p - position;
        let along = m.dot(direction);
        let e = beam_profile((m - direction * along).length(), radius, gaussian);
        (along >= 0.0 && e > 0.0).then(|| parallel(direction, along, self.emission(Rgb::splat(e))))
    }

    /// The same on the very edge of its profile, at full intensity: there rounding decides what the profile is. `d`: from the point back along its ray to where that leaves the light.
    pub fn within_edge(&self, d: DVec3) -> Arrival {
        match self.kind {
            LightKind::Beam { direction, .. } => parallel(direction, d.length(), self.emission(Rgb::ONE)),
            _ => self.along(d),
        }
    }

    /// What a point p of a beam's edge, in the plane where it begins, asks of the beam as that moves (term H of [T] section 3): `<v, ṗ + Ṙ r>`, r being the unit vector from the axis to it. How the beam turns is the ray's.
    pub fn edge_forms(&self, p: DVec3, v: DVec3, mut add: impl FnMut(Partial)) {
        let LightKind::Beam { position, direction, .. } = self.kind else { return };
        let m = p - position;
        let r = (m - direction * m.dot(direction)).normalize_or_zero();
        add(Partial { slot: self.place.position, v, len: 3 });
        add(Partial { slot: self.place.radius, v: DVec3::X * v.dot(r), len: 1 });
    }

    /// Arrival from a position, `d` from the point to it, at full intensity.
    pub fn along(&self, d: DVec3) -> Arrival {
        let r2 = d.length_squared();
        let (distance, emission) = (r2.sqrt(), self.emission(Rgb::ONE));
        Arrival { w: d / distance, distance, factor: 1.0 / r2, emission, pdf: 0.0, target: None, n: DVec3::ZERO }
    }

    /// Light arriving at `p`; `None` where nothing can arrive or where sampling by direction is no worse (constant).
    pub fn sample(&self, p: DVec3, u: f64, v: f64) -> Option<Arrival> {
        match &self.kind {
            LightKind::Point { position } => Some(self.along(*position - p)),
            LightKind::Spot { position, axis, beam, cutoff } => {
                let a = self.along(*position - p);
                let s = spot_falloff(-a.w.dot(*axis), *beam, *cutoff);
                (s > 0.0).then(|| Arrival { emission: self.emission(Rgb::splat(s)), ..a })
            }
            LightKind::Directional { direction } => Some(parallel(*direction, f64::INFINITY, self.emission(Rgb::ONE))),
            LightKind::Envmap(e) => {
                let (w, pdf, radiance) = e.sample(u, v);
                (pdf > 0.0).then(|| Arrival {
                    w,
                    distance: f64::INFINITY,
                    factor: 1.0 / pdf,
                    emission: self.emission(radiance),
                    pdf,
                    target: None,
                    n: DVec3::ZERO,
                })
            }
            // Area lights need their shape: `scene::connect` samples them.
            // Beams reach a vertex by ways of their own: `transport::beam`.
            LightKind::Area { .. } | LightKind::Constant | LightKind::Beam { .. } => None,
        }
    }

    /// Whether next-event estimation is worth a ray.
    pub fn wants_connection(&self) -> bool {
        !matches!(self.kind, LightKind::Constant | LightKind::Beam { .. })
    }

    /// Irradiance of a light without extent, mean radiance of an environment: what a vertex sees of a light at infinity.
    pub fn distant_strength(&self) -> Option<f64> {
        let v = self.value.luminance().abs().max(self.value.max().abs() * 1e-3);
        match &self.kind {
            LightKind::Directional { .. } => Some(v),
            LightKind::Envmap(e) => Some(v * e.mean_luminance()),
            _ => None,
        }
    }

    /// A rough power for light selection, per unit area of a scene of radius `radius`.
    pub fn rough_power(&self, area: f64, radius: f64) -> f64 {
        let v = self.value.luminance().abs().max(self.value.max().abs() * 1e-3);
        match &self.kind {
            LightKind::Point { .. } => v * 4.0 * PI,
            LightKind::Spot { cutoff, beam, .. } => v * 2.0 * PI * (1.0 - (0.5 * (beam + cutoff)).cos()),
            LightKind::Directional { .. } => v * PI * radius * radius,
            LightKind::Area { .. } => v * PI * area,
            LightKind::Constant | LightKind::Beam { .. } => 0.0,
            LightKind::Envmap(e) => v * e.mean_luminance() * 4.0 * PI * PI * radius * radius,
        }
    }
}
