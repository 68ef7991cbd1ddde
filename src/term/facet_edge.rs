//! Rough glass that light without extent shines through: what it sends on ends with a jump where its facets stand upright, at B = 0 ([`crate::surface::upright`]). For a light of one direction at each point, and
//! a viewer, that is a curve on the glass (term R of [T] section 3: the light's border on a receiver), and what moves it adds
//!
//! ```text
//! ∮ E f |cos wo| Ḃ dl / |∇B|,
//! ```
//!
//! ([T] (35) for a curve on a surface, of (18)'s jump.) E: irradiance across the light's direction; Ḃ: what B changes by where the point of the glass moves as its viewer sees it, and with the viewer, the light, the normal and the indices; ∇B: over the glass. B > 0 has the light.
//!
//! On a plane n₂ h_l/d_l = n₁ h_v/d_v, h being heights over it and d distances, is a circle: `(n₂ h_l)² (ρ_v² + h_v²) = (n₁ h_v)² (ρ_l² + h_l²)`, ρ being distances in the plane from the feet; for a light at
//! infinity one about the viewer's foot. Viewers are the camera and vertices of camera paths, each asks for a point of a circle within a face. Flat faces only, seen and lit straight.

use super::ends::{Point, Watch};
use super::seen_path::{self, Path};
use super::sheet::Partials;
use super::{Context, Motion, Sample};
use crate::light::{Light, Origin};
use crate::math::discrete::Discrete;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::{Partial, Slot};
use crate::scene::beams::Way;
use crate::scene::chains::has_flat_faces;
use crate::scene::{Hit, On, Scene};
use crate::sensor::{Projection, Sensor};
use crate::shape::Geometry;
use crate::shape::edges::with_corners;
use crate::surface::Surface;
use crate::surface::rough::Rough;
use crate::transport::beam;
use crate::transport::shot::{self, Place, Shot};
use crate::transport::velocity::{Source, Velocity};
use smallvec::SmallVec;
use std::f64::consts::PI;

/// Share of faces drawn by their area alone, however far from lights.
const ANYWHERE: f64 = 0.2;

pub struct FacetEdges {
    faces: Vec<Face>,
    lights: Vec<Lamp>,
    /// Of pairs, lights in turn for each face.
    table: Discrete,
}

struct Face {
    shape: u32,
    face: u32,
    n: DVec3,
    middle: DVec3,
    /// Heights over it that are none, by rounding.
    level: f64,
    /// A convex polygon, in order.
    corners: SmallVec<[DVec3; 4]>,
    /// An index of it is a parameter: where nothing moves that saves looking.
    index: bool,
}

struct Lamp {
    light: u32,
    /// Of its position or direction, where that moves.
    slot: Option<Slot>,
}

/// A point of the curve, and the length of curve that it stands for, over its probability.
struct Spot<'a> {
    lamp: &'a Lamp,
    hit: Hit,
    length: f64,
    /// An index there is a parameter.
    index: bool,
}

/// A circle in a plane, from its point p next to the middle of a face on; a straight line where it does not bend.
struct Circle {
    p: DVec3,
    /// Unit: along it at p, and toward its centre.
    axes: [DVec3; 2],
    /// One over its radius.
    bend: f64,
}

impl Circle {
    /// Where `n2 |n·wo| = n1 |n·wi|`, wi toward the viewer, wo toward the light on the other side; indices by which side of the normal's. `level`: heights of the viewer that are none.
    fn new(face: &Face, viewer: DVec3, from: Origin<f64>, [behind, front]: [f64; 2], level: f64) -> Option<Circle> {
        let (n, m) = (face.n, face.middle);
        let h = n.dot(viewer - m);
        // A plane does not see itself.
        if h.abs() <= face.level.max(level) {
            return None;
        }
        let (n1, n2) = if h > 0.0 { (front, behind) } else { (behind, front) };
        let off = (m - viewer) + n * h;
        // Of the middle, both times a - b: its place from the centre, and its distance from there squared less that of the radius.
        let (from_centre, power, radius, scale) = match from {
            Origin::Position(q) => {
                let q = q.value();
                let g = n.dot(q - m);
                if h * g >= 0.0 || g.abs() <= face.level {
                    return None;
                }
                let (a, b) = ((n2 * g).powi(2), (n1 * h).powi(2));
                let far = (m - q) + n * g;
                let power = a * (off.length_squared() + h * h) - b * (far.length_squared() + g * g);
                let rest = (n1 * n2).powi(2) * (off - far).length_squared() + (a - b) * (n1 * n1 - n2 * n2);
                (off * (a - b) + (off - far) * b, power, rest.sqrt() * (h * g).abs(), a - b)
            }
            Origin::Infinity(w) => {
                let c = n.dot(w.value());
                // Toward the light on the other side: it travels to where the viewer is.
                if c * h <= 0.0 {
                    return None;
                }
                let squared = (n1 * h / (n2 * c)).powi(2) - h * h;
                (off, off.length_squared() - squared, squared.sqrt(), 1.0)
            }
        };
        if !(radius > 0.0 && radius.is_finite()) {
            return None;
        }
        let inward = from_centre.try_normalize().unwrap_or_else(|| n.any_orthonormal_vector()) * -scale.signum();
        let away = power * scale.signum() / (from_centre.length() + radius);
        Some(Circle { p: m + inward * away, axes: [n.cross(inward), inward], bend: scale.abs() / radius })
    }

    /// The point at this distance along it from p.
    fn at(&self, s: f64) -> DVec3 {
        let half = 0.5 * self.bend * s;
        // Of what a straight line would do.
        let share = if half == 0.0 { 1.0 } else { half.sin() / half };
        self.p + (self.axes[0] * half.cos() + self.axes[1] * half.sin()) * (s * share)
    }

    /// A point of it within a convex polygon, evenly, and the length that is there.
    fn within(&self, face: &Face, u: f64) -> Option<(DVec3, f64)> {
        let c = &face.corners;
        let ends = c.iter().zip(c.iter().cycle().skip(1));
        // Unit, toward the inside of each side; how far p is there.
        let sides: SmallVec<[(DVec3, f64); 4]> = ends
            .map(|(&a, &b)| {
                let m = face.n.cross(b - a).normalize_or_zero();
                let m = if m.dot(face.middle - a) < 0.0 { -m } else { m };
                (m, m.dot(self.p - a))
            })
            .collect();
        let mut cuts: SmallVec<[f64; 12]> = SmallVec::new();
        if self.bend > 0.0 {
            cuts.extend([-PI, PI].map(|a| a / self.bend));
        }
        for (m, e) in &sides {
            // By x = 2 tan(bend s/2)/bend, the distance itself of a straight line.
            let [along, across] = self.axes.map(|v| m.dot(v));
            let bend = self.bend;
            let roots = quadratic([*e, along, 0.25 * bend * (e * bend + 2.0 * across)]);
            cuts.extend(roots.map(|x| if bend > 0.0 { 2.0 * (0.5 * bend * x).atan() / bend } else { x }));
        }
        cuts.retain(|s| s.is_finite());
        cuts.sort_by(f64::total_cmp);
        let is_inside = |s: f64| {
            let off = self.at(s) - self.p;
            sides.iter().all(|(m, e)| e + m.dot(off) > 0.0)
        };
        let arcs: SmallVec<[[f64; 2]; 8]> =
            cuts.windows(2).map(|a| [a[0], a[1]]).filter(|[a, b]| b > a && is_inside(0.5 * (a + b))).collect();
        let total: f64 = arcs.iter().map(|[a, b]| b - a).sum();
        let mut left = u * total;
        for [a, b] in arcs {
            if left < b - a {
                return Some((self.at(a + left), total));
            }
            left -= b - a;
        }
        None
    }
}

/// Where `c + b x + a x²` is 0, twice the same or no number where it is not twice.
fn quadratic([c, b, a]: [f64; 3]) -> [f64; 2] {
    let q = -0.5 * (b + b.signum() * (b * b - 4.0 * a * c).sqrt());
    [q / a, c / q]
}

impl FacetEdges {
    /// `None` where no such edge moves.
    pub fn prepare(scene: &Scene, motion: &Motion) -> Option<FacetEdges> {
        let lamp = |(k, l): (usize, &Light)| {
            let m = &motion.lights[k];
            let slot = match l.origin()? {
                Origin::Position(_) => Some(l.place.position).filter(|_| m.position),
                Origin::Infinity(_) => Some(l.place.direction).filter(|_| m.direction),
            };
            Some(Lamp { light: k as u32, slot })
        };
        let lights: Vec<Lamp> = scene.lights.iter().enumerate().filter_map(lamp).collect();
        let mut faces = Vec::new();
        for (shape, s) in (0..).zip(&scene.shapes).filter(|(_, s)| has_flat_faces(s)) {
            let Some(index) = motion.facets[s.surface as usize] else { continue };
            for face in 0..s.shape.face_count() {
                let flat = with_corners(&s.shape, face, SmallVec::from_slice);
                faces.extend(flat.map(|corners: SmallVec<[DVec3; 4]>| Face {
                    shape,
                    face,
                    level: corners.iter().map(|c| scene.tolerance(*c)).fold(0.0, f64::max),
                    n: s.shape.normal(face, corners[0]),
                    middle: corners.iter().sum::<DVec3>() / corners.len() as f64,
                    corners,
                    index,
                }));
            }
        }
        if faces.is_empty() || lights.is_empty() {
            return None;
        }
        let area = |f: &Face| {
            let c = &f.corners;
            (1..c.len() - 1).map(|k| (c[k] - c[0]).cross(c[k + 1] - c[0]).length() * 0.5).sum::<f64>()
        };
        let lit = |f: &Face, l: &Lamp| {
            let light = &scene.lights[l.light as usize];
            let factor = match light.origin() {
                Some(Origin::Position(q)) => {
                    (q.value() - f.middle).length_squared().max(f64::MIN_POSITIVE.sqrt()).recip()
                }
                _ => 1.0,
            };
            light.emission_toward(f.middle).map_or(0.0, |e| e.color().max() * factor)
        };
        let areas: Vec<f64> = faces.iter().map(area).collect();
        let light: Vec<f64> =
            faces.iter().zip(&areas).flat_map(|(f, a)| lights.iter().map(move |l| lit(f, l) * a)).collect();
        let [all, bright] = [areas.iter().sum::<f64>() * lights.len() as f64, light.iter().sum::<f64>()];
        let weight = |(k, x): (usize, &f64)| {
            let even = areas[k / lights.len()] / all;
            if bright > 0.0 { ANYWHERE * even + (1.0 - ANYWHERE) * x / bright } else { even }
        };
        let table = Discrete::new(light.iter().enumerate().map(weight));
        Some(FacetEdges { faces, lights, table })
    }

    /// A point of what a viewer sees the light end at.
    fn spot(&self, scene: &Scene, viewer: DVec3, u: f64) -> Option<Spot<'_>> {
        let (k, probability, u) = self.table.sample(u);
        let (face, lamp) = (&self.faces[k / self.lights.len()], &self.lights[k % self.lights.len()]);
        let indices = rough(scene, face.shape)?.indices()?;
        let from = scene.lights[lamp.light as usize].origin()?;
        let circle = Circle::new(face, viewer, from, indices, scene.tolerance(viewer))?;
        let (p, length) = circle.within(face, u)?;
        let hit = scene.hit_at(p, face.shape, face.face);
        Some(Spot { lamp, hit, length: length / probability, index: face.index })
    }

    /// What the spot sends toward a viewer, over the length of curve that it stands for, and how that depends on slots. `shot`: from the viewer; velocities: of the viewer, and of the spot as that sees it.
    fn sent(&self, cx: &mut Context, spot: &Spot, shot: &Shot, velocities: [Velocity; 2]) -> Option<(Rgb, Partials)> {
        let (scene, hit) = (cx.scene, &spot.hit);
        let rough = rough(scene, hit.shape)?;
        let light = &scene.lights[spot.lamp.light as usize];
        // Toward the light, the distance to it, and its irradiance over its intensity.
        let (wo, distance, factor) = match light.origin()? {
            Origin::Position(q) => {
                let to = q.value() - hit.p;
                let d = to.length();
                (to / d, d, (d * d).recip())
            }
            Origin::Infinity(w) => (-w.value(), f64::INFINITY, 1.0),
        };
        let (wi, emission) = (-shot.w, light.emission_toward(hit.p)?);
        let value = rough.jump(hit.normals(), wi, wo);
        if value <= 0.0 {
            return None;
        }
        let slopes = rough.arc_slopes(hit.normals(), wi, wo);
        let [by_wi, by_wo, by_n] = [&slopes.wi, &slopes.wo, &slopes.n].map(|c| DVec3::from_array(c.0.map(|x| x[0])));
        let across = |w: DVec3, v: DVec3| v - w * w.dot(v);
        let [by_wi, by_wo] = [across(wi, by_wi), across(wo, by_wo)];
        // By the viewer's place, and by the light's.
        let (near, far) = (by_wi / shot.distance, by_wo / distance);
        let steep = across(hit.n, near + far).length();
        let mut partials = Partials::default();
        for (velocity, by) in velocities.iter().zip([near, -(near + far)]) {
            velocity.forms(scene, cx.sensor, by, |q| partials.push(q));
        }
        if cx.moving.moves(hit.shape) {
            Velocity::of_normal(Source::at(hit), hit.p, hit.n).forms(scene, cx.sensor, by_n, |q| partials.push(q));
        }
        let by_light = if distance < f64::INFINITY { far } else { -by_wo };
        partials.extend(spot.lamp.slot.map(|slot| Partial { slot, v: by_light, len: 3 }));
        let index = |(slot, x): (Slot, f64)| Partial { slot, v: DVec3::X * x, len: 1 };
        if spot.index {
            partials.extend(rough.arc_scores(hit.normals(), wi, wo).map(index));
        }
        if partials.as_slice().is_empty() {
            return None;
        }
        let medium = scene.shapes[hit.shape as usize].medium_behind(shot.w, hit.n, shot.medium);
        let way = Way { light: spot.lamp.light, steps: Vec::new(), w: -wo, gain: Rgb::ONE, source: None };
        let clear = beam::clear(scene, &way, &[], (hit.p, On::at(hit), medium), &mut |_| {})?;
        let flux = clear * emission.color() * (factor * value * hit.n.dot(wi).abs() * spot.length / steep);
        cx.tally.nonfinite += u64::from(!flux.is_finite());
        (flux.is_finite() && !flux.is_zero()).then_some((flux, partials))
    }

    /// As vertices of a camera path see it.
    pub fn along(&self, cx: &mut Context, film: [f64; 2], rng: &mut Rng, emit: &mut dyn FnMut(&Sample)) {
        // The path takes the even numbers.
        let mut stream = Rng::keyed(rng.next_u64(), 1, 0, 0);
        let path = Path::new(cx, film, *rng);
        for v in &path.vertices {
            if let Some((flux, partials)) = self.look(cx, &path, v, &mut stream) {
                emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
            }
        }
    }

    fn look(&self, cx: &mut Context, path: &Path, v: &seen_path::Vertex, rng: &mut Rng) -> Option<(Rgb, Partials)> {
        let scene = cx.scene;
        if !is_shown(cx, v.depth + 2) {
            return None;
        }
        let spot = self.spot(scene, v.p(), rng.uniform())?;
        let scatter = v.scatter(scene, (spot.hit.p - v.p()).normalize());
        if scatter.is_zero() {
            return None;
        }
        let shot = shot::straight(scene, v.p(), &v.place(scene), spot.hit.p, None)?;
        let point = Point::Surface(spot.hit);
        let watch = path.watch(cx, v);
        let velocities = [watch.velocity(cx, &v.point), watch.beyond(cx, &v.point).velocity(cx, &point)];
        let (flux, partials) = self.sent(cx, &spot, &shot, velocities)?;
        Some((flux * v.weight * scatter * shot.weight * (1.0 / shot.spread), partials))
    }

    /// As the camera sees it. `u`: the number that the place on the curves comes from.
    pub fn outward(&self, cx: &mut Context, u: f64, emit: &mut dyn FnMut(&Sample)) {
        let (scene, sensor) = (cx.scene, cx.sensor);
        let Some(eye) = eye(sensor).filter(|_| is_shown(cx, 1)) else { return };
        let Some(spot) = self.spot(scene, eye, u) else { return };
        let Some(q) = sensor.project(spot.hit.p).filter(|q| cx.on_film(q.film)) else { return };
        let Some(shot) = shot::straight(scene, q.o, &Place::within(sensor.medium), spot.hit.p, None) else { return };
        let point = Point::Surface(spot.hit);
        let velocity = Watch::itself(cx, &q, &point).velocity(cx, &point);
        let velocities = [cx.moving.film_ray().at(q.o), velocity];
        let Some((flux, partials)) = self.sent(cx, &spot, &shot, velocities) else { return };
        let flux = flux * shot.weight * q.pixels_per_area;
        emit(&Sample { film: q.film, flux, partials: partials.as_slice(), film_per_sheet: 0.0, outward: 1.0 });
    }
}

/// Where the camera looks from, if that is one place.
fn eye(sensor: &Sensor) -> Option<DVec3> {
    matches!(sensor.projection, Projection::Perspective { .. }).then_some(sensor.to_world.translation)
}

fn rough(scene: &Scene, shape: u32) -> Option<&Rough> {
    match scene.surface_of(shape) {
        Surface::Rough(rough) => Some(rough),
        _ => None,
    }
}

/// Whether the picture shows light that has scattered so often.
fn is_shown(cx: &Context, order: u32) -> bool {
    order >= cx.set.min_order && order < cx.set.max_depth
}
