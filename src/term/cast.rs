//! Where lights without extent begin and cease to shine by a way of flat smooth faces: at the border of a face that light meets, or of one that comes between (terms G of [T] section 3, by way of interfaces).
//!
//! By given planes light comes to every point y in one way at most ([`crate::math::fermat`]), and all that it brings is smooth in the places of all ([`crate::transport::way_motion`]), but at y whose way
//! goes by the border of a face. These y form a *sheet*: rays from the points z of the border, which light comes to by the planes before it and leaves by those behind. A face that stands between counts as a plane
//! that does nothing. A path's span crosses a sheet where it meets one of its rays. Points of the span move with ẋ; there light grows by
//!
//! ```text
//! (L⁺ - L⁻) <m, ẋ_k - ė> / |∂f/∂t|,    f = <x_k - e, m>,
//! ```
//!
//! x_k being where the way meets the plane of the border, e the border and m the direction across it in that plane; L on either side is asked of the connection itself, so that it does not matter what stands where.
//! Every span of a camera path is looked at ([`super::spans`]): light of any order counts.
//!
//! Where two faces in turn share an edge, light passes both at one point of it: such a border is the first one's alone.

use super::sheet::Partials;
use super::spans::{self, Bare, Moves, Walked};
use super::{Context, Motion, Sample, ends};
use crate::light::{Light, Origin};
use crate::math::fermat;
use crate::math::fold::Fold;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::{Partial, Slot};
use crate::phase::one_minus_cos;
use crate::scene::beams::Step;
use crate::scene::chains::{Link, MOST, has_flat_faces};
use crate::scene::{Instance, On, Scene};
use crate::shape::edges::border;
use crate::shape::{Geometry, Shape, TriangleMesh};
use crate::transport::way_motion::Slide;
use crate::transport::{beam, chain};
use rayon::prelude::*;
use smallvec::SmallVec;

/// Rays that are known of a sheet, over one.
const PIECES: usize = 16;
/// Sheets that a span is compared with at most; of more some are drawn.
const ASKED: usize = 4096;
/// How far from the border on either side light is asked for, in scene radii: on it rounding would tell which face is met.
const ASIDE: f64 = 1e-7;
/// Steps that find where rays of a sheet end, or meet a span: halvings at worst.
const STEPS: usize = 60;
/// Distances ahead, in scene radii, that may be none: light passes two faces at the edge that they share.
const NONE: f64 = 1e-9;

/// A sheet behind a border.
struct Sheet {
    light: u32,
    links: SmallVec<[Link; MOST]>,
    /// The number of the border's face among the links, or of the link before which one stands that does nothing.
    at: usize,
    between: bool,
    /// The border, and the face whose matter it goes with.
    ends: [DVec3; 2],
    own: (u32, u32),
    /// Rays over stretches of the border, at its places in order.
    pieces: Vec<Vec<(f64, Ray)>>,
}

/// Of a sheet: unit direction.
#[derive(Clone, Copy, Debug)]
struct Ray {
    o: DVec3,
    w: DVec3,
}

impl Ray {
    /// The volume that tells on which side of the ray a line passes, and along which both run.
    fn side(&self, o: DVec3, w: DVec3) -> f64 {
        (self.o - o).dot(w.cross(self.w))
    }

    /// Distances on a line and on the ray at which they meet.
    fn meets(&self, o: DVec3, w: DVec3) -> [f64; 2] {
        let (n, off) = (w.cross(self.w), self.o - o);
        [off.cross(self.w), off.cross(w)].map(|v| v.dot(n) / n.length_squared())
    }
}

pub struct Casts {
    sheets: Vec<Sheet>,
    /// Of each light the slot of its position or direction, where that moves.
    slots: Vec<Option<Slot>>,
}

/// Whether all of them are known where something moves: what is smooth has straight borders, nothing else casts shadows, and nothing moves but lights, the camera and what is smooth.
pub fn are_known(scene: &Scene, motion: &Motion) -> bool {
    let known = |(id, s): (u32, &Instance)| {
        if scene.is_null(s) {
            return !motion.moves(id);
        }
        // The border of glass that ends a medium by itself is where that is not known.
        let bounds = s.boundary && s.interior != s.exterior;
        scene.surface_of(id).is_smooth()
            && match &s.shape {
                Shape::Cube(_) => true,
                Shape::Rectangle(_) => !bounds,
                Shape::Mesh(m) => has_flat_faces(s) && is_convex(m, scene.tolerance(m.bounds().max)),
                _ => false,
            }
    };
    let chains = &scene.chains;
    !chains.faces.is_empty() && !chains.cut && !chains.touching && (0..).zip(&scene.shapes).all(known)
}

/// Whether it is closed, and no vertex lies before any of its faces.
fn is_convex(m: &TriangleMesh, slack: f64) -> bool {
    let behind = |f: u32| {
        let ([a, b, c], turned) = (m.corners(f), if m.topology().is_inside_out() { -1.0 } else { 1.0 });
        let n = (b - a).cross(c - a).normalize_or_zero() * turned;
        m.vertices.iter().all(|v| n.dot(*v - a) <= slack)
    };
    let t = m.topology();
    t.is_closed() && t.is_consistently_oriented() && (0..m.faces.len() as u32).all(behind)
}

impl Casts {
    /// `None` where nothing casts such shadows.
    pub fn prepare(scene: &Scene, motion: &Motion) -> Option<Casts> {
        if scene.chains.faces.is_empty() {
            return None;
        }
        let slot = |(l, m): (&Light, &super::LightMotion)| match l.center() {
            Some(_) if m.position => Some(l.place.position),
            None if m.direction => Some(l.place.direction),
            _ => None,
        };
        let slots: Vec<Option<Slot>> = scene.lights.iter().zip(&motion.lights).map(slot).collect();
        let moves = |id: usize| motion.surfaces() || slots[id].is_some();
        let lights = scene.lights.iter().enumerate().filter(|(id, l)| l.is_delta() && moves(*id));
        let mut sheets: Vec<Sheet> = lights.flat_map(|(id, _)| of_light(scene, id as u32)).collect();
        sheets.par_iter_mut().for_each(|s| s.trace(scene));
        sheets.retain(|s| !s.pieces.is_empty());
        (!sheets.is_empty()).then_some(Casts { sheets, slots })
    }

    /// All crossings of a camera path with sheets.
    pub fn along(&self, cx: &mut Context, film: [f64; 2], rng: Rng, emit: &mut dyn FnMut(&Sample)) {
        let mut rec = Bare(spans::record());
        let mut chosen = rng.beside(Rng::next_u64(&mut { rng }));
        spans::walk(cx, film, rng, &mut rec);
        let starts = spans::starts(cx, &rec.0);
        spans::each(cx, &rec.0, &starts, &mut |walked, moves| {
            let every = self.sheets.len().div_ceil(ASKED);
            let first = if every > 1 { (chosen.uniform() * every as f64) as usize } else { 0 };
            for sheet in self.sheets.iter().skip(first).step_by(every) {
                self.cross(cx, sheet, every as f64, walked, film, moves, emit);
            }
        });
    }

    fn cross(
        &self,
        cx: &Context,
        sheet: &Sheet,
        counts: f64,
        walked: &Walked,
        film: [f64; 2],
        moves: Moves,
        emit: &mut dyn FnMut(&Sample),
    ) {
        let (scene, span) = (cx.scene, &walked.span);
        let order = walked.depth + 1 + sheet.links.len() as u32;
        if order < cx.set.min_order || order >= cx.set.max_depth {
            return;
        }
        for (s, t) in sheet.crossings(scene, span.o, span.w, [span.t0, span.t1]) {
            let p = span.o + span.w * t;
            let Some(Met { slide, m, w }) = sheet.met(cx, s, p) else { continue };
            let [by_end, by_light] = slide.by_ends(m);
            let slope = by_end.dot(span.w);
            let off = by_end * (ASIDE * scene.bounds.radius() / by_end.length_squared());
            let sides = [p + off, p - off].map(|y| sheet.arrives(scene, y, span.medium));
            let medium = &scene.media[span.medium as usize];
            let f = counts * medium.phase.eval(one_minus_cos(span.w, -w)) / slope.abs();
            let jump = sides[0] - sides[1];
            let flux = (walked.weight)(t) * medium.coefficients(p).1 * jump * f;
            if flux.is_zero() || !flux.is_finite() {
                continue;
            }
            let mut partials = Partials::default();
            if cx.moving.any() {
                let velocity = slide.velocity(&moves(&walked.whole, p));
                velocity.forms(scene, cx.sensor, m, |q| partials.push(q));
                let (shape, face) = sheet.own;
                scene.matter(shape, face).forms(sheet.point(s), -m, |q| partials.push(q));
            }
            if let Some(slot) = self.slots[sheet.light as usize] {
                partials.push(Partial { slot, v: by_light, len: 3 });
            }
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        }
    }
}

/// A crossing of a sheet.
struct Met {
    slide: Slide,
    /// Across the border.
    m: DVec3,
    /// Direction of the light there.
    w: DVec3,
}

/// All sheets of a light, without their rays.
fn of_light(scene: &Scene, id: u32) -> Vec<Sheet> {
    let light = &scene.lights[id as usize];
    let Some(from) = light.origin() else { return Vec::new() };
    let faces = &scene.chains.faces;
    // Facets of meshes are in the list by themselves.
    let listed = scene.chains.list.iter().filter(|c| c.light == id).map(|c| c.links.clone());
    let single = (0..faces.len() as u32).filter(|&k| !faces[k as usize].is_facet()).flat_map(|face| {
        let front = faces[face as usize].is_before(from);
        let through = scene.surface_of(faces[face as usize].shape).is_transparent();
        let link = |through| SmallVec::from_iter([Link { face, front, through }]);
        std::iter::once(link(false)).chain(through.then(|| link(true)))
    });
    let mut sheets = Vec::new();
    let sides = borders_of_shapes(scene);
    for links in std::iter::once(SmallVec::new()).chain(single).chain(listed) {
        for (at, link) in links.iter().enumerate() {
            let face = &faces[link.face as usize];
            let before = at.checked_sub(1).map(|k| &faces[links[k].face as usize]);
            let shared = |ends: &[DVec3; 2]| {
                before.is_some_and(|b| border(b.corners()).any(|other| is_same(scene, ends, &other)))
            };
            for ends in border(face.corners()).filter(|ends| !shared(ends)) {
                let own = (face.shape, face.face);
                sheets.push(Sheet { light: id, links: links.clone(), at, between: false, ends, own, pieces: Vec::new() });
            }
        }
        for at in 0..=links.len() {
            // Convex bodies do not stand on lines that end on them.
            let around = [at.checked_sub(1), Some(at)].map(|k| Some(faces[links.get(k?)?.face as usize].shape));
            for &(own, ends) in sides.iter().filter(|(own, _)| !around.contains(&Some(own.0))) {
                sheets.push(Sheet { light: id, links: links.clone(), at, between: true, ends, own, pieces: Vec::new() });
            }
        }
    }
    sheets
}

/// All edges of what is smooth, each once, with one of its faces.
fn borders_of_shapes(scene: &Scene) -> Vec<((u32, u32), [DVec3; 2])> {
    let mut found: Vec<((u32, u32), [DVec3; 2])> = Vec::new();
    for f in &scene.chains.faces {
        for ends in border(f.corners()) {
            if !found.iter().any(|(own, e)| own.0 == f.shape && is_same(scene, e, &ends)) {
                found.push(((f.shape, f.face), ends));
            }
        }
    }
    found
}

fn is_same(scene: &Scene, [a, b]: &[DVec3; 2], [c, d]: &[DVec3; 2]) -> bool {
    let near = |x: &DVec3, y: &DVec3| (*x - *y).length() <= ends::contact(scene);
    near(a, c) && near(b, d) || near(a, d) && near(b, c)
}

impl Sheet {
    fn point(&self, s: f64) -> DVec3 {
        self.ends[0].lerp(self.ends[1], s)
    }

    fn along(&self) -> DVec3 {
        (self.ends[1] - self.ends[0]).normalize()
    }

    fn from(&self, scene: &Scene) -> Option<Origin<f64>> {
        scene.lights[self.light as usize].origin()
    }

    /// The direction of light at the point z of the border.
    fn comes(&self, scene: &Scene, z: DVec3) -> Option<DVec3> {
        let from = self.from(scene)?;
        if self.at == 0 {
            return match from {
                Origin::Position(q) => (z - q.value()).try_normalize(),
                Origin::Infinity(w) => Some(w.value()),
            };
        }
        match chain::arrival(scene, &self.links[..self.at], from, z, false) {
            fermat::Way::Found(w) => Some(w),
            fermat::Way::None | fermat::Way::Lost => None,
        }
    }

    /// The steps of light that comes along w to the point z of the border and goes on.
    fn leaves(&self, scene: &Scene, z: DVec3, w: DVec3) -> Option<(SmallVec<[Step; MOST]>, Ray)> {
        let mut ray = Ray { o: z, w };
        let mut steps = SmallVec::new();
        for link in &self.links[self.at..] {
            let (face, f): (_, Fold) = (&scene.chains.faces[link.face as usize], scene.chains.fold(scene, link));
            let c = ray.w.dot(f.n);
            let t = (f.p - ray.o).dot(f.n) / c;
            // Rounding puts the border on either side of its own plane.
            let ahead = t > -NONE * scene.bounds.radius() && t.is_finite();
            if !ahead || (c < 0.0) != link.front {
                return None;
            }
            let behind = f.behind(ray.w)?;
            let (shape, face) = (face.shape, face.face);
            steps.push(Step { shape, face, p: f.p, n: f.n, before: ray.w, behind, through: f.through });
            ray = Ray { o: ray.o + ray.w * t, w: behind };
        }
        Some((steps, ray))
    }

    fn ray(&self, scene: &Scene, s: f64) -> Option<Ray> {
        let z = self.point(s);
        Some(self.leaves(scene, z, self.comes(scene, z)?)?.1)
    }

    /// Find its rays: stretches of the border that light goes on from.
    fn trace(&mut self, scene: &Scene) {
        let known: Vec<(f64, Option<Ray>)> =
            (0..=PIECES).map(|k| k as f64 / PIECES as f64).map(|s| (s, self.ray(scene, s))).collect();
        let mut piece: Vec<(f64, Ray)> = Vec::new();
        for (k, &(s, ray)) in known.iter().enumerate() {
            let last = k.checked_sub(1).map(|k| known[k]);
            match (last, ray) {
                (Some((a, None)), Some(_)) => piece.extend(self.end(scene, s, a)),
                (Some((a, Some(_))), None) => {
                    piece.extend(self.end(scene, a, s));
                    self.pieces.push(std::mem::take(&mut piece));
                }
                _ => {}
            }
            piece.extend(ray.map(|r| (s, r)));
        }
        self.pieces.push(piece);
        self.pieces.retain(|p| p.len() > 1);
    }

    /// The last place with a ray, from one that has one to one that has none.
    fn end(&self, scene: &Scene, has: f64, has_none: f64) -> Option<(f64, Ray)> {
        let (mut a, mut b, mut found) = (has, has_none, None);
        for _ in 0..STEPS {
            let s = 0.5 * (a + b);
            match self.ray(scene, s) {
                Some(r) => (a, found) = (s, Some((s, r))),
                None => b = s,
            }
        }
        found
    }

    /// Where the part of a line meets its rays: places on the border, and distances on the line.
    fn crossings(&self, scene: &Scene, o: DVec3, w: DVec3, [t0, t1]: [f64; 2]) -> SmallVec<[(f64, f64); 2]> {
        let mut found = SmallVec::new();
        let mut add = |s: f64, ray: &Ray| {
            let [t, rho] = ray.meets(o, w);
            if t > t0 && t < t1 && rho > 0.0 {
                found.push((s, t));
            }
        };
        let side = |s: f64| self.ray(scene, s).map(|r| (r.side(o, w), r));
        for piece in &self.pieces {
            let known: SmallVec<[(f64, f64); PIECES]> = piece.iter().map(|(s, r)| (*s, r.side(o, w))).collect();
            for k in 0..known.len() {
                let here = known[k];
                if let Some(next) = known.get(k + 1).filter(|next| (next.1 < 0.0) != (here.1 < 0.0)) {
                    if let Some((s, ray)) = root(here, *next, &side) {
                        add(s, &ray);
                    }
                }
                // Two between, that signs do not tell: where the least of three is in the middle.
                let (Some(last), Some(next)) = (k.checked_sub(1).map(|k| known[k]), known.get(k + 1)) else { continue };
                let alike = [last.1, next.1].iter().all(|x| (*x < 0.0) == (here.1 < 0.0) && x.abs() >= here.1.abs());
                if !alike {
                    continue;
                }
                let sign = if here.1 < 0.0 { -1.0 } else { 1.0 };
                if let Some(turned) = dip(last, here, *next, sign, &side) {
                    for pair in [[last, turned], [turned, *next]] {
                        if let Some((s, ray)) = root(pair[0], pair[1], &side) {
                            add(s, &ray);
                        }
                    }
                }
            }
        }
        found
    }

    /// What the way to y that goes by the border does there as all moves.
    fn met(&self, cx: &Context, s: f64, y: DVec3) -> Option<Met> {
        let (scene, z) = (cx.scene, self.point(s));
        let from = self.from(scene)?;
        let comes = self.comes(scene, z)?;
        let (mut steps, points, _) = chain::steps(scene, &self.links[..self.at], (z, comes), false)?;
        let (behind, ray) = self.leaves(scene, z, comes)?;
        let along = self.along();
        let mut idle = None;
        let m = if self.between {
            let n = (comes - along * comes.dot(along)).try_normalize()?;
            let (shape, face) = self.own;
            idle = Some(steps.len());
            steps.push(Step { shape, face, p: z, n, before: comes, behind: comes, through: true });
            n.cross(along)
        } else {
            let face = &scene.chains.faces[self.links[self.at].face as usize];
            face.n.cross(along)
        };
        let plane = self.at;
        steps.extend(behind);
        let first = points.last().copied().unwrap_or(z);
        let slide = Slide::new(scene, cx.moving, from, (&steps, idle), [first, y], plane)?;
        Some(Met { slide, m, w: ray.w })
    }

    /// What the light brings to y by the faces, across its direction; nothing where it does not come.
    fn arrives(&self, scene: &Scene, y: DVec3, medium: u32) -> Rgb {
        let light = &scene.lights[self.light as usize];
        let found = || {
            let (way, points) = chain::way(scene, (self.light, &self.links), self.from(scene)?, y, &mut 0)?;
            let emission = light.emission_toward(points.last().copied().unwrap_or(y))?;
            let clear = beam::clear(scene, &way, &points, (y, On::default(), Some(medium)), &mut |_| {})?;
            Some(emission.color() * clear * way.gain)
        };
        found().unwrap_or(Rgb::ZERO)
    }
}

/// A value at a place.
type At = (f64, f64);

/// Where a function is 0 between two places at which its signs differ (regula falsi with halved ends, and halvings where that is slow).
fn root(a: At, b: At, f: &impl Fn(f64) -> Option<(f64, Ray)>) -> Option<(f64, Ray)> {
    let (mut a, mut b, mut best) = (a, b, None);
    let mut held = 0;
    for k in 0..STEPS {
        let slow = k % 4 == 3;
        let s = if slow { 0.5 * (a.0 + b.0) } else { (a.0 * b.1 - b.0 * a.1) / (b.1 - a.1) };
        let s = if s > a.0.min(b.0) && s < a.0.max(b.0) { s } else { 0.5 * (a.0 + b.0) };
        let (v, ray) = f(s)?;
        best = Some((s, ray));
        if v == 0.0 || (b.0 - a.0).abs() <= 4.0 * f64::EPSILON {
            break;
        }
        if (v < 0.0) == (a.1 < 0.0) {
            a = (s, v);
            b.1 *= if held == 1 { 0.5 } else { 1.0 };
            held = 1;
        } else {
            b = (s, v);
            a.1 *= if held == 2 { 0.5 } else { 1.0 };
            held = 2;
        }
    }
    best
}

/// A place between a and c at which a function has another sign than at all three, if it comes so near to 0 around b; its sign there is `sign`.
fn dip(a: At, b: At, c: At, sign: f64, f: &impl Fn(f64) -> Option<(f64, Ray)>) -> Option<At> {
    let (mut a, mut b, mut c) = (a, b, c);
    for _ in 0..STEPS / 2 {
        // The parabola's least value says whether it is worth while.
        let (x, y) = (b.0 - a.0, c.0 - b.0);
        let slope = ((b.1 - a.1) / x * y + (c.1 - b.1) / y * x) / (x + y);
        let bend = ((c.1 - b.1) / y - (b.1 - a.1) / x) / (x + y);
        let least = b.1 - 0.25 * slope * slope / bend;
        if sign * bend <= 0.0 || sign * least > 0.5 * b.1.abs() {
            return None;
        }
        let s = b.0 - 0.5 * slope / bend;
        let s = if (s - b.0).abs() > 1e-3 * (c.0 - a.0) { s } else if y > x { b.0 + 0.1 * y } else { b.0 - 0.1 * x };
        if !(s > a.0 && s < c.0) {
            return None;
        }
        let d = (s, f(s)?.0);
        if sign * d.1 < 0.0 {
            return Some(d);
        }
        match (sign * d.1 < sign * b.1, d.0 > b.0) {
            (true, true) => (a, b) = (b, d),
            (true, false) => (b, c) = (d, b),
            (false, true) => c = d,
            (false, false) => a = d,
        }
        if c.0 - a.0 < 1e-12 {
            return None;
        }
    }
    None
}
