//! Lines that graze an edge, a sphere, a wall or a rim, with the densities of drawing them: from the curve outward ([T] 2.2; a part of them with its near end toward the camera by
//! rough glass, [`super::frosted`]), toward a lamp, and from a point that looks at its outline.
//!
//! A smooth surface has the grazing lines `dA dθ |κ(θ)|` (B on it, θ the line's turn in the tangent plane, κ(θ) the normal curvature along the line) in place of
//! `dl dω sin α`: what the edges of finer and finer polyhedra tend to. That is `1/R` of a sphere. Of a cylinder it is `cos²θ/R`, θ counted from the circle: an edge of the
//! prism that replaces it has `dl sin²α dα dφ` (α the angle with the edge), where φ takes up the angle ds/R between neighbouring faces, and `sin α = |cos θ|`.
//!
//! From a point S at the distance d of B the outline is a curve for all of them, and `dl dω sin α ds = dl sin α / d² dV` ([T] 2, with `dω ds = dV/d²`); on a
//! surface `dω = dA |cos| / d²`.

use super::frosted::{self, Frosted};
use super::rims::Rim;
use super::wedge::{frame_of, wedge};
use crate::light::LightKind;
use crate::math::equiangular::EquiAngular;
use crate::math::{DVec2, DVec3, warp};
use crate::scene::{Hit, Scene};
use crate::shape::edges::Edge;
use crate::shape::{Cylinder, Geometry};
use std::f64::consts::{PI, TAU};

/// What lines graze.
#[derive(Clone, Debug)]
pub enum Curve {
    Edge(Edge),
    Sphere {
        c: DVec3,
        r: f64,
    },
    /// The wall, from outside.
    Cylinder(Cylinder),
    Rim(Rim),
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug)]
pub enum Toward {
    Lamp(u32),
    /// From the curve alone; the number chooses among its ways.
    Own(f64),
}

/// Where the camera sees a point by rough glass, if lines are to be drawn toward it.
pub type Look<'a> = &'a dyn Fn(DVec3) -> Option<Frosted>;

/// A line that grazes a curve.
pub struct Line {
    pub b: DVec3,
    /// Unit, from S to D.
    pub w: DVec3,
    /// Toward the unblocked side.
    pub n: DVec3,
    /// `sin α`, or `|κ|`; of a line drawn from S `sin α / d²`.
    pub measure: f64,
    /// Density of B along the edge; 0 of a smooth surface.
    pub per_length: f64,
    /// Densities of both techniques, per `dl dω` (or `dA dθ`): from the edge, and toward the lamp that is met. Of a line drawn from S the density per `dl`.
    pub own: f64,
    pub lamp: f64,
    /// Drawn toward this lamp, at this distance.
    pub target: Option<(u32, f64)>,
    /// Drawn from S: no other technique makes it.
    pub from_vertex: bool,
}

impl Line {
    /// Drawn from the curve alone.
    fn own(b: DVec3, w: DVec3, n: DVec3, measure: f64, own: f64) -> Line {
        Line { b, w, n, measure, per_length: 0.0, own, lamp: 0.0, target: None, from_vertex: false }
    }

    /// Past B as S sees it along w (unit) from the distance d, on an outline that runs along t (unit) through B.
    fn from_vertex(b: DVec3, w: DVec3, d: f64, n: DVec3, t: DVec3, per_length: f64) -> Line {
        let measure = w.cross(t).length() / (d * d);
        Line { from_vertex: true, ..Line::own(b, w, n, measure, per_length) }
    }
}

impl Curve {
    /// Draw a line, toward a lamp or from the curve alone. The densities do not hold the probability of either.
    pub fn draw(&self, scene: &Scene, look: Look, toward: Toward, [t, u, v]: [f64; 3]) -> Option<Line> {
        match self {
            Curve::Edge(e) => {
                let length = (e.b - e.a).length();
                let b = e.a + (e.b - e.a) * t;
                past_edge(scene, look, e, (b, length.recip()), toward, [u, v])
            }
            Curve::Rim(rim) => {
                let edge = rim.edge(t);
                let per_length = 1.0 / (TAU * (edge.b - edge.a).length());
                past_edge(scene, look, &edge, (edge.a, per_length), toward, [u, v])
            }
            Curve::Cylinder(q) => match toward {
                Toward::Own(choice) => along_wall(q, look, choice, [t, u, v]),
                Toward::Lamp(light) => past_wall(scene, q, look, light, [t, u, v]),
            },
            Curve::Sphere { c, r } => {
                let middle = look(*c);
                match toward {
                    Toward::Own(choice) => {
                        let seen = middle.filter(|_| choice < frosted::SHARE);
                        let n = seen.as_ref().map_or_else(|| warp::sphere(u, v), |f| f.rim(*r, u, v));
                        let b = *c + n * *r;
                        let at = middle.and_then(|_| look(b));
                        let w = match at.filter(|_| seen.is_some()) {
                            Some(f) => -f.turned_about(n, t),
                            None => turned(n, TAU * t),
                        };
                        Some(Line::own(b, w, n, 1.0 / r, on_sphere(*r, [middle, at], n, w)))
                    }
                    Toward::Lamp(light) => {
                        let LightKind::Area { shape } = scene.lights[light as usize].kind else { return None };
                        let z = scene.shapes[shape as usize].shape.sample(u, v);
                        let o = outline(*c, *r, z.p, t)?;
                        let lamp = sphere_density(*r, o.sin, o.distance, z.n.dot(o.w), z.pdf_area)?;
                        let target = Some((light, o.distance));
                        let b = *c + o.n * *r;
                        let own = on_sphere(*r, [middle, middle.and_then(|_| look(b))], o.n, -o.w);
                        Some(Line { lamp, target, ..Line::own(b, -o.w, o.n, 1.0 / r, own) })
                    }
                }
            }
        }
    }

    /// The line from `p` past a point of the outline that `p` sees, by the number `u`: of an edge, a rim or a wall's two lines of contact by `1/d²`, which keeps points near by
    /// from being loud; of a sphere uniform on its circle. `None` where an edge is no silhouette. Knows nothing of what stands in between.
    pub fn from_vertex(&self, p: DVec3, u: f64) -> Option<Line> {
        let toward = |b: DVec3| {
            let d = (b - p).length();
            ((b - p) / d, d)
        };
        let past = |edge: &Edge, b: DVec3, per_length: f64| {
            let t = (edge.b - edge.a).normalize();
            let (w, d) = toward(b);
            Some(Line::from_vertex(b, w, d, unblocked(edge, t.cross(w))?, t, per_length))
        };
        match self {
            Curve::Edge(e) => {
                let (b, per_length) = seen_on(e.a, e.b, p, u)?;
                past(e, b, per_length)
            }
            Curve::Rim(rim) => {
                let (turn, density) = rim.turn_seen_from(p, u);
                let edge = rim.edge(turn);
                past(&edge, edge.a, density / (edge.b - edge.a).length())
            }
            Curve::Cylinder(q) => {
                let normals = q.contacts_from(p)?;
                let (n, u) = if u < 0.5 { (normals[0], 2.0 * u) } else { (normals[1], 2.0 * u - 1.0) };
                let [from, to] = q.line(n);
                let (b, per_length) = seen_on(from, to, p, u)?;
                let (w, d) = toward(b);
                Some(Line::from_vertex(b, w, d, n, q.axis, 0.5 * per_length))
            }
            Curve::Sphere { c, r } => {
                let o = outline(*c, *r, p, u)?;
                // A circle of the radius d sin β, across the line.
                let per_length = 1.0 / (TAU * o.distance * o.sin);
                Some(Line::from_vertex(*c + o.n * *r, o.w, o.distance, o.n, o.n.cross(o.w), per_length))
            }
        }
    }

    /// Density with which the point of a lamp that a line met would have been drawn.
    pub fn toward(&self, scene: &Scene, line: &Line, hit: Option<&Hit>) -> (u32, f64) {
        let Some(h) = hit else {
            let Some(id) = scene.environment else { return (0, 0.0) };
            let pdf = scene.lights[id as usize].escape(line.w, true).map_or(0.0, |e| e.1);
            return (id, pdf * line.per_length);
        };
        let shape = &scene.shapes[h.shape as usize];
        let Some(light) = shape.light else { return (0, 0.0) };
        let density = match self {
            Curve::Sphere { c, r } => {
                let (d, distance) = ((*c - h.p).length(), (line.b - h.p).length());
                sphere_density(*r, r / d, distance, -h.n.dot(line.w), 1.0 / shape.shape.area()).unwrap_or(0.0)
            }
            Curve::Cylinder(q) => {
                let (distance, cos) = ((line.b - h.p).length(), -h.n.dot(line.w));
                let sin = line.w.cross(q.axis).length();
                wall_to_lamp(q, sin, distance, cos, 1.0 / shape.shape.area()).unwrap_or(0.0)
            }
            _ => scene.area_pdf(light, line.b, line.w, h) * line.per_length,
        };
        (light, density)
    }
}

/// Toward the unblocked side of lines in the plane with this normal through an edge; `None` where it parts its faces.
fn unblocked(edge: &Edge, normal: DVec3) -> Option<DVec3> {
    let sin = normal.length();
    let side = edge.covered_side(normal);
    (side != 0.0 && sin > 0.0).then(|| normal * (-side / sin))
}

/// A point of the segment from a to b by the angle that it subtends at p, and its density per length; `None` where p lies on its line.
pub(super) fn seen_on(a: DVec3, b: DVec3, p: DVec3, u: f64) -> Option<(DVec3, f64)> {
    let length = (b - a).length();
    let t = (b - a) / length;
    let angles = EquiAngular::new(p, a, t, 0.0, length);
    angles.usable().then(|| {
        let s = angles.sample(u);
        (a + t * s, angles.density(s))
    })
}

/// A direction in the plane across n.
fn turned(n: DVec3, angle: f64) -> DVec3 {
    let (x, y) = warp::frame(n);
    let (s, q) = angle.sin_cos();
    x * q + y * s
}

/// Density `dA dθ` of lines that touch a sphere where its normal is n, as they are drawn from the curve alone: evenly, and where the camera sees its middle by rough glass beside its outline, turned
/// toward the camera if that sees the point of touch by rough glass, too.
fn on_sphere(r: f64, [middle, at]: [Option<Frosted>; 2], n: DVec3, w: DVec3) -> f64 {
    let even = 1.0 / (4.0 * PI * r * r * TAU);
    middle.map_or(even, |f| {
        let turn = at.map_or(1.0 / TAU, |f| f.density_about(n, -w));
        even + frosted::SHARE * (f.rim_density(r, n) / (r * r) * turn - even)
    })
}

/// A line through the point b of an edge, drawn with `per_length`.
fn past_edge(
    scene: &Scene,
    look: Look,
    edge: &Edge,
    (b, per_length): (DVec3, f64),
    toward: Toward,
    [u, v]: [f64; 2],
) -> Option<Line> {
    let t = (edge.b - edge.a).normalize();
    let (first, width) = wedge(edge);
    let frosted = look(b);
    let (w, lamp, target) = match (toward, &frosted) {
        (Toward::Lamp(light), _) => {
            let a = scene.arrival(light, b, u, v)?;
            (a.w, a.pdf * per_length, Some((light, a.distance)))
        }
        (Toward::Own(choice), Some(f)) if choice < frosted::SHARE => (-f.sample(u, v), 0.0, None),
        (Toward::Own(_), _) => {
            // Uniform in the angles around the edge that graze it, both ways, and in the cosine with it.
            let z = 2.0 * u - 1.0;
            let (half, v) = if v < 0.5 { (0.0, 2.0 * v) } else { (PI, 2.0 * v - 1.0) };
            let (x, y) = frame_of(edge, t);
            let (s, c) = (first + width * v + half).sin_cos();
            ((x * c + y * s) * (1.0 - z * z).max(0.0).sqrt() + t * z, 0.0, None)
        }
    };
    let normal = t.cross(w);
    let n = unblocked(edge, normal)?;
    let even = 1.0 / (4.0 * width);
    let own = per_length * frosted.map_or(even, |f| even + frosted::SHARE * (f.density(-w) - even));
    Some(Line { per_length, lamp, target, ..Line::own(b, w, n, normal.length(), own) })
}

/// A point of the circle in which a sphere ends as seen from a point.
struct Outline {
    /// Unit, from the point.
    w: DVec3,
    /// Unit, away from the centre.
    n: DVec3,
    distance: f64,
    /// Of β, half the angle that the sphere fills.
    sin: f64,
}

/// At the fraction t of a turn; `None` from within.
fn outline(c: DVec3, r: f64, p: DVec3, t: f64) -> Option<Outline> {
    let axis = c - p;
    let d = axis.length();
    if d <= r {
        return None;
    }
    let (sin, cos) = (r / d, ((d - r) * (d + r)).sqrt() / d);
    let (x, y) = warp::frame(axis / d);
    let (s, q) = (TAU * t).sin_cos();
    let m = x * q + y * s;
    Some(Outline { w: axis / d * cos + m * sin, n: m * cos - axis / d * sin, distance: d * cos, sin })
}

/// Lines toward a lamp's points: `dA dθ/R = dA_z cos_z sin β dψ/d` (β: half the angle that the sphere fills from z, ψ around it).
fn sphere_density(r: f64, sin: f64, distance: f64, cos: f64, per_area: f64) -> Option<f64> {
    (cos > 0.0).then(|| per_area / TAU * distance / (r * cos * sin))
}

/// Where the camera sees the middle of a wall by rough glass, and the two lines of contact with it.
struct WallSeen {
    middle: Frosted,
    contacts: [DVec3; 2],
}

impl WallSeen {
    fn of(q: &Cylinder, look: Look) -> Option<WallSeen> {
        let p = Geometry::bounds(q).center();
        let middle = look(p)?;
        Some(WallSeen { contacts: q.contacts_from(p + middle.w * middle.distance)?, middle })
    }

    /// A normal beside one of the lines.
    fn normal(&self, q: &Cylinder, v: f64) -> DVec3 {
        let (n, v) = if v < 0.5 { (self.contacts[0], 2.0 * v) } else { (self.contacts[1], 2.0 * v - 1.0) };
        let (s, c) = self.middle.turn(v).sin_cos();
        (n * c + q.axis.cross(n) * s).normalize()
    }

    /// Density per area of the points with this normal.
    fn density(&self, q: &Cylinder, n: DVec3) -> f64 {
        let angle = |m: DVec3| q.axis.dot(m.cross(n)).atan2(m.dot(n));
        let [a, b] = self.contacts.map(|m| self.middle.turn_density(angle(m)));
        0.5 * (a + b) / (q.radius * q.length)
    }
}

/// A line that touches a wall: its point by area, uniform in the cosine with the axis, both ways, as edges have it; or where and how the camera sees it by rough glass.
fn along_wall(q: &Cylinder, look: Look, choice: f64, [t, u, v]: [f64; 3]) -> Option<Line> {
    let seen = WallSeen::of(q, look);
    let aims = seen.as_ref().filter(|_| choice < frosted::SHARE);
    let (b, n) = if let Some(s) = aims {
        let n = s.normal(q, v);
        let [from, to] = q.line(n);
        (from + (to - from) * u, n)
    } else {
        let b = q.position(0, DVec2::new(u, v));
        (b, q.from_axis(b).normalize())
    };
    let at = seen.as_ref().and_then(|_| look(b));
    let w = match at.filter(|_| aims.is_some()) {
        Some(f) => -f.turned_about(n, t),
        None => {
            let (z, back) = if t < 0.5 { (4.0 * t - 1.0, 1.0) } else { (4.0 * t - 3.0, -1.0) };
            q.axis.cross(n) * (back * (1.0 - z * z).max(0.0).sqrt()) + q.axis * z
        }
    };
    let sin = w.cross(q.axis).length();
    (sin > 0.0).then(|| Line::own(b, w, n, sin * sin / q.radius, on_wall(q, (seen.as_ref(), at), n, (w, sin))))
}

/// Density `dA dθ` of lines that [`along_wall`] draws.
fn on_wall(q: &Cylinder, (seen, at): (Option<&WallSeen>, Option<Frosted>), n: DVec3, (w, sin): (DVec3, f64)) -> f64 {
    let even = wall_density(q, sin);
    seen.map_or(even, |s| {
        let turn = at.map_or(0.25 * sin, |f| f.density_about(n, -w));
        even + frosted::SHARE * (s.density(q, n) * turn - even)
    })
}

/// One toward a point of a lamp.
fn past_wall(scene: &Scene, q: &Cylinder, look: Look, light: u32, [t, u, v]: [f64; 3]) -> Option<Line> {
    let LightKind::Area { shape } = scene.lights[light as usize].kind else { return None };
    let z = scene.shapes[shape as usize].shape.sample(u, v);
    let normals = q.contacts_from(z.p)?;
    let (n, t) = if t < 0.5 { (normals[0], 2.0 * t) } else { (normals[1], 2.0 * t - 1.0) };
    let [from, to] = q.line(n);
    let b = from + (to - from) * t;
    let distance = (z.p - b).length();
    let w = (z.p - b) / distance;
    let sin = w.cross(q.axis).length();
    let lamp = wall_to_lamp(q, sin, distance, -z.n.dot(w), z.pdf_area)?;
    let target = Some((light, distance));
    let seen = WallSeen::of(q, look);
    let at = seen.as_ref().and_then(|_| look(b));
    let own = on_wall(q, (seen.as_ref(), at), n, (w, sin));
    Some(Line { lamp, target, ..Line::own(b, w, n, sin * sin / q.radius, own) })
}

/// Density `dA dθ` of lines that are uniform in area and in the cosine with the axis.
fn wall_density(q: &Cylinder, sin: f64) -> f64 {
    sin / (4.0 * q.area())
}

/// Of lines toward a lamp's points that touch the wall uniformly along one of its two lines of contact: `dA dθ sin²α/R = dA_z cos_z dl sin α/d²`.
fn wall_to_lamp(q: &Cylinder, sin: f64, distance: f64, cos: f64, per_area: f64) -> Option<f64> {
    (cos > 0.0).then(|| 0.5 * per_area / q.length * sin * distance * distance / (q.radius * cos))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;
    use crate::math::{DAffine3, DMat3};
    use crate::scene::compile::LoadOptions;
    use crate::scene::{Scene, SceneDesc};
    use crate::shape::edges::Side;

    /// Lines drawn from the curve alone, evenly and toward where the camera sees it by rough glass, have the density that they say: integrals of a function of the line agree (4.5 s.e.; false alarm 7e-6 each).
    /// Wrong by the share of either, or by the width, they do not.
    #[test]
    fn lines_toward_the_camera_have_the_density_that_they_say() {
        let text = r#"<scene version="3.0.0"><integrator type="volpath"/><sensor type="perspective"/><emitter type="constant"/></scene>"#;
        let desc = SceneDesc::parse(text, std::path::Path::new("empty.xml"), &[]).unwrap();
        let scene = Scene::compile(&desc, &LoadOptions::default()).unwrap();
        let eye = DVec3::new(0.4, 1.0, 6.0);
        let seen = |p: DVec3| Some(Frosted { w: (eye - p).normalize(), width: 0.2, distance: (eye - p).length() });
        // Not from everywhere.
        let partly = |p: DVec3| seen(p).filter(|_| p.x < 0.6);
        let place = DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::new(0.4, 0.4, 1.1)), DVec3::ONE * 0.2);
        let side = |face, corner| Side { face, corner };
        let sides = vec![side(0, DVec3::new(0.0, 1.0, -1.0)), side(1, DVec3::new(0.0, -0.6, -1.0))];
        let curves = [
            Curve::Sphere { c: DVec3::new(0.5, 0.1, 0.0), r: 0.5 },
            Curve::Cylinder(Cylinder::new(place, false).unwrap()),
            Curve::Edge(Edge { a: DVec3::new(-1.0, 0.0, 0.0), b: DVec3::new(1.0, 0.2, 0.0), sides }),
        ];
        let f = |l: &Line| l.measure * (2.0 + l.b.x + (l.w.dot(DVec3::new(0.3, -0.5, 0.8)) * 3.0).sin());
        for (k, curve) in curves.iter().enumerate() {
            let integral = |look: Look, key: u64| {
                let (n, mut sum, mut square) = (200_000, 0.0, 0.0);
                let mut rng = Rng::keyed(key, 0, k as u64, 0);
                for _ in 0..n {
                    let [choice, t, u, v] = std::array::from_fn(|_| rng.uniform());
                    let x = curve.draw(&scene, look, Toward::Own(choice), [t, u, v]).map_or(0.0, |l| f(&l) / l.own);
                    sum += x;
                    square += x * x;
                }
                let mean = sum / f64::from(n);
                (mean, (square / f64::from(n) - mean * mean) / f64::from(n))
            };
            let (even, own) = integral(&|_| None, 1);
            for (look, key) in [(&seen as Look, 2), (&partly, 3)] {
                let (mean, variance) = integral(look, key);
                let z = (mean - even) / (variance + own).sqrt();
                assert!(z.abs() < 4.5, "{k} {key}: {mean} for {even}, z {z}");
                assert!((variance + own).sqrt() < 0.02 * even, "{k} {key}: too noisy to tell");
            }
        }
    }
}
