//! Convex bodies of flat smooth faces, which light may be in: those that hold a point, and what light may meet from within some of them.
//!
//! Of every shape it is known which bodies it lies in as a whole, and from which it lies apart, or which lie in it. Light meets it only from within all of the first and none of the others: it
//! comes to a body that lies in another one by way of that. A shape that goes through the border of a body is neither, and may be met from anywhere.

use super::chains::{self, Face};
use super::{Instance, Scene};
use crate::math::DVec3;
use crate::shape::edges::{is_flat, with_corners};
use crate::shape::{Geometry, Shape, TriangleMesh};
use std::cell::OnceCell;

/// Bodies at most: of others nothing is told.
const MOST: usize = 64;
/// Faces at most of a shape that is told by its corners: others by the box around them.
const FACES: u32 = 4096;

/// Faces of a body at least.
const LEAST: usize = 4;

/// A set of bodies, a bit each.
pub type Set = u64;

/// All of them.
#[derive(Debug, Default)]
pub struct Bodies {
    list: Vec<Body>,
    /// Of every shape the bodies that light has to be in to meet it, and those that it must not be in.
    places: Vec<[Set; 2]>,
}

#[derive(Debug)]
struct Body {
    shape: u32,
    /// Of its faces: a point, and the normal to the outside.
    planes: Vec<[DVec3; 2]>,
}

impl Body {
    fn holds(&self, p: DVec3, slack: f64) -> bool {
        self.planes.iter().all(|[o, n]| n.dot(p - *o) < -slack)
    }

    /// Where the hull of some points is, if that can be told: inside, or beyond one of the faces.
    fn place(&self, hull: &[DVec3], slack: f64) -> Option<Place> {
        let is_beyond = |[o, n]: &[DVec3; 2]| hull.iter().all(|p| n.dot(*p - *o) > slack);
        match hull {
            [] => None,
            _ if hull.iter().all(|p| self.holds(*p, slack)) => Some(Place::Inside),
            _ => self.planes.iter().any(is_beyond).then_some(Place::Apart),
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Place {
    Inside,
    Apart,
}

/// Corners of its faces; none where they are round or too many.
fn corners(s: &Shape) -> Vec<DVec3> {
    let mut all = Vec::new();
    if is_flat(s) && s.face_count() <= FACES {
        (0..s.face_count()).for_each(|f| _ = with_corners(s, f, |c| all.extend_from_slice(c)));
    }
    all
}

impl Bodies {
    /// Of `smooth` shapes. What is nearer than `slack` to a plane is on neither side of it.
    fn new(shapes: &[Instance], smooth: impl Fn(&Instance) -> bool, slack: f64) -> Bodies {
        let is_body = |s: &Instance| match &s.shape {
            Shape::Cube(_) => true,
            Shape::Mesh(m) => {
                s.shape.face_count() <= FACES && m.topology().pieces(&m.faces) == 1 && is_convex(m, slack)
            }
            _ => false,
        };
        let body = |shape: u32, s: &Shape| {
            let own: Vec<Face> = (0..s.face_count()).filter_map(|f| chains::face(shape, s, f)).collect();
            let c = own.iter().map(|f| f.p).sum::<DVec3>() / own.len().max(1) as f64;
            let planes = own.iter().map(|f| [f.p, if f.n.dot(f.p - c) < 0.0 { -f.n } else { f.n }]);
            Body { shape, planes: planes.collect() }
        };
        let chosen = (0..).zip(shapes).filter(|(_, s)| smooth(s) && is_body(s)).take(MOST);
        let mut list: Vec<Body> = chosen.map(|(id, s)| body(id, &s.shape)).collect();
        list.retain(|b| b.planes.len() >= LEAST);
        let mut places = vec![[0; 2]; shapes.len()];
        if list.is_empty() {
            return Bodies::default();
        }
        for (id, s) in shapes.iter().enumerate() {
            // The box around it tells most.
            let (around, exact) = (s.shape.bounds().corners(), OnceCell::new());
            for (k, b) in list.iter().enumerate().filter(|(_, b)| b.shape != id as u32) {
                let place = b.place(&around, slack).or_else(|| b.place(exact.get_or_init(|| corners(&s.shape)), slack));
                if let Some(place) = place {
                    places[id][usize::from(place == Place::Apart)] |= 1 << k;
                    places[b.shape as usize][1] |= bit(&list, id as u32);
                }
            }
        }
        Bodies { list, places }
    }

    /// Those that hold a point.
    pub fn holding(&self, p: DVec3) -> Set {
        self.list.iter().enumerate().filter(|(_, b)| b.holds(p, 0.0)).fold(0, |set, (k, _)| set | 1 << k)
    }

    /// That of a shape alone; none where it is no body.
    pub fn of(&self, shape: u32) -> Set {
        bit(&self.list, shape)
    }

    /// Those that light of a lamp begins in; `None` if that is not told, as the lamp is no further than `slack` from a border.
    pub fn around_lamp(&self, p: DVec3, slack: f64) -> Option<Set> {
        let is_on = |b: &Body| b.holds(p, -slack) && !b.holds(p, slack);
        (!self.list.iter().any(is_on)).then(|| self.holding(p))
    }

    /// Whether light that is in these bodies, and no others, may meet a shape next. Anything, where that is not told.
    pub fn may_meet(&self, shape: u32, within: Option<Set>) -> bool {
        let Some(within) = within else { return true };
        let [needed, barred] = self.places.get(shape as usize).copied().unwrap_or_default();
        needed & !within == 0 && barred & within == 0
    }

    /// Whether a face is met from that side: of a body that light is not in only from outside.
    pub fn may_meet_from(&self, f: &Face, front: bool, within: Set) -> bool {
        let other = self.list.iter().enumerate().find(|(k, b)| b.shape == f.shape && within >> k & 1 == 0);
        let Some((_, b)) = other else { return true };
        let inner = b.planes.iter().map(|x| x[0]).sum::<DVec3>() / b.planes.len() as f64;
        front == ((inner - f.p).dot(f.n) < 0.0)
    }
}

impl Scene {
    /// List them; call when shapes and surfaces are known.
    pub fn prepare_bodies(&mut self) {
        let smooth = |s: &Instance| self.surfaces[s.surface as usize].is_smooth() && chains::has_flat_faces(s);
        self.bodies = Bodies::new(&self.shapes, smooth, chains::SLACK * self.bounds.radius());
    }
}

fn bit(list: &[Body], shape: u32) -> Set {
    list.iter().position(|b| b.shape == shape).map_or(0, |k| 1 << k)
}

/// Whether it is closed, and no vertex lies before any of its faces.
pub fn is_convex(m: &TriangleMesh, slack: f64) -> bool {
    let behind = |f: u32| {
        let ([a, b, c], turned) = (m.corners(f), if m.topology().is_inside_out() { -1.0 } else { 1.0 });
        let n = (b - a).cross(c - a).normalize_or_zero() * turned;
        m.vertices.iter().all(|v| n.dot(*v - a) <= slack)
    };
    let t = m.topology();
    t.is_closed() && t.is_consistently_oriented() && (0..m.faces.len() as u32).all(behind)
}
