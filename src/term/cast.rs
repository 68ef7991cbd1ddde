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
use crate::error::{Error, Result};
use crate::light::{Light, Origin};
use crate::math::fermat;
use crate::math::fold::Fold;
use crate::math::rng::Rng;
use crate::math::{DVec3, Rgb};
use crate::params::{Partial, Slot};
use crate::phase::one_minus_cos;
use crate::scene::beams::Step;
use crate::scene::chains::{Face, Link, MOST, has_flat_faces};
use crate::scene::{Instance, On, Scene, effort};
use crate::shape::edges::{border, sides};
use crate::shape::{Geometry, Shape, TriangleMesh};
use crate::transport::record::MediumSpan;
use crate::transport::way_motion::Slide;
use crate::transport::{beam, chain};
use rayon::prelude::*;
use smallvec::SmallVec;

/// Pieces of a border at least, between whose ends rays are interpolated.
const PIECES: usize = 16;
/// Further ones are halved so often toward where the light is nearest: near to glass little of it may be let in.
const HALVED: i32 = 12;
/// By how much of a piece what margins leave is widened at either side.
const WIDER: f64 = 0.2;
/// How far from the border on either side light is asked for, in scene radii: Embree's f32 rays must tell which face is met.
const ASIDE: f64 = 1e-5;
/// Steps that find where rays of a sheet end, or meet a span: halvings at worst.
const STEPS: usize = 60;
/// How far from opposite the directions into two faces of one plane may be.
const FLAT: f64 = 1e-12;
/// Sheets of a scene at most.
const SHEETS: usize = 1 << 18;
/// Steps along a border, over its length, that are none.
const SETTLED: f64 = 1e-13;
/// Distances ahead, in scene radii, that may be none: light passes two faces at the edge that they share.
const NONE: f64 = 1e-9;

/// A sheet behind a border.
struct Sheet {
    light: u32,
    links: SmallVec<[Link; MOST]>,
    /// How often it is looked at.
    asked: f64,
    /// The number of the border's face among the links, or of the link before which one stands that does nothing.
    at: usize,
    between: bool,
    border: Border,
    /// Bodies that its rays are in, a bit each.
    within: u64,
    /// Rays over stretches of the border, at its places in order.
    pieces: Vec<Vec<(f64, Ray)>>,
}

/// An edge of one face or two of a shape.
#[derive(Clone, Debug)]
struct Border {
    ends: [DVec3; 2],
    /// The face whose matter it goes with.
    own: (u32, u32),
    /// Directions into its faces.
    into: SmallVec<[DVec3; 2]>,
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
    /// Those that are asked for more often first.
    sheets: Vec<Sheet>,
    bodies: Bodies,
    /// Of each light the slot of its position or direction, where that moves.
    slots: Vec<Option<Slot>>,
}

/// Whether all of them are known where something moves: what is smooth has straight borders, nothing else casts shadows, and nothing moves but lights, the camera and what is smooth.
pub fn are_known(scene: &Scene, motion: &Motion) -> bool {
    let known = |(id, s): (u32, &Instance)| {
        if scene.is_null(s) {
            return !motion.moves(id);
        }
        scene.surface_of(id).is_smooth()
            && match &s.shape {
                Shape::Cube(_) => true,
                // One of glass bounds a half-space, whose border has to be out of sight.
                Shape::Rectangle(_) => !scene.surface_of(id).is_transparent(),
                Shape::Mesh(m) => has_flat_faces(s) && is_convex(m, scene.tolerance(m.bounds().max)),
                _ => false,
            }
    };
    let chains = &scene.chains;
    !chains.faces.is_empty() && !chains.cut && !chains.touching && (0..).zip(&scene.shapes).all(known)
}

/// What would make borders more than can be told: to be asked where they are known ([`are_known`]).
pub fn check(scene: &Scene) -> Result<()> {
    let smooth: Vec<&Instance> = scene.shapes.iter().filter(|s| !scene.is_null(s)).collect();
    for (i, a) in smooth.iter().enumerate() {
        if let Some(b) = smooth[i + 1..].iter().find(|b| a.shape.bounds().gap(&b.shape.bounds()) == 0.0) {
            let what = format!(
                "`{}` and `{}` mirror or refract and may meet: where light without extent ends there cannot be told yet",
                a.name, b.name
            );
            let remedy = "keep them apart, so that the boxes around them (along the axes) do not meet; one within another cannot be differentiated yet";
            return Err(Error::scene(&b.span, what, remedy));
        }
    }
    let bodies = Bodies::new(scene);
    let delta = (0..scene.lights.len() as u32).filter(|&id| scene.lights[id as usize].is_delta());
    let sheets: usize = delta.map(|id| count(scene, &bodies, id)).sum();
    if sheets > SHEETS {
        let span = &smooth[0].span;
        let what = format!(
            "light without extent ends at the borders of `{}` and others in {sheets} ways, more than {SHEETS}: too many to differentiate",
            smooth[0].name
        );
        return Err(Error::scene(span, what, "use fewer faces, or a smaller max_depth"));
    }
    Ok(())
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
        let bodies = Bodies::new(scene);
        let mut sheets: Vec<Sheet> = lights.flat_map(|(id, _)| of_light(scene, &bodies, id as u32)).collect();
        sheets.sort_by(|a, b| b.asked.total_cmp(&a.asked));
        (!sheets.is_empty()).then_some(Casts { sheets, bodies, slots })
    }

    /// All crossings of a camera path with sheets.
    pub fn along(&self, cx: &mut Context, film: [f64; 2], rng: Rng, emit: &mut dyn FnMut(&Sample)) {
        let mut rec = Bare(spans::record());
        let mut chosen = rng.beside(Rng::next_u64(&mut { rng }));
        spans::walk(cx, film, rng, &mut rec);
        let starts = spans::starts(cx, &rec.0);
        spans::each(cx, &rec.0, &starts, &mut |walked, moves| {
            let within = self.bodies.around(&walked.span);
            // One of 1/asked each.
            let mut next = chosen.uniform();
            for sheet in &self.sheets {
                next += sheet.asked;
                if next >= 1.0 {
                    next -= 1.0;
                    if sheet.within == within {
                        self.cross(cx, sheet, walked, film, moves, emit);
                    }
                }
            }
        });
    }

    fn cross(
        &self,
        cx: &Context,
        sheet: &Sheet,
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
        effort::note(1);
        for (s, t) in sheet.crossings(scene, span.o, span.w, [span.t0, span.t1]) {
            effort::note(4);
            let p = span.o + span.w * t;
            let Some(met) = sheet.met(scene, s) else { continue };
            let (m, steps) = (met.m, (&met.steps[..], met.idle));
            let Some(slide) = met.from.and_then(|from| Slide::new(scene, from, steps, [met.first, p], sheet.at)) else {
                continue;
            };
            let [by_end, by_light] = slide.by_ends(m);
            let slope = by_end.dot(span.w);
            let off = by_end * (ASIDE * scene.bounds.radius() / by_end.length_squared());
            let sides = [p + off, p - off].map(|y| sheet.arrives(scene, y, span.medium));
            let medium = &scene.media[span.medium as usize];
            let f = medium.phase.eval(one_minus_cos(span.w, -met.w)) / (sheet.asked * slope.abs());
            let flux = (walked.weight)(t) * medium.coefficients(p).1 * (sides[0] - sides[1]) * f;
            if flux.is_zero() || !flux.is_finite() {
                continue;
            }
            let mut partials = Partials::default();
            if cx.moving.any() {
                let Some(velocity) = slide.velocity(cx.moving, &moves(&walked.whole, p)) else { continue };
                velocity.forms(scene, cx.sensor, m, |q| partials.push(q));
                let (shape, face) = sheet.border.own;
                scene.matter(shape, face).forms(sheet.point(s), -m, |q| partials.push(q));
            }
            if let Some(slot) = self.slots[sheet.light as usize] {
                partials.push(Partial { slot, v: by_light, len: 3 });
            }
            emit(&Sample { film, flux, partials: partials.as_slice(), film_per_sheet: 1.0, outward: 0.0 });
        }
    }
}

/// The way that goes by a border.
struct Met {
    from: Option<Origin<f64>>,
    /// One of them may be no face.
    steps: SmallVec<[Step; MOST]>,
    idle: Option<usize>,
    /// Where light meets the first of them.
    first: DVec3,
    /// Across the border.
    m: DVec3,
    /// Direction of the light behind all.
    w: DVec3,
}

/// Convex bodies of glass, as planes: points and normals to the outside.
struct Bodies(Vec<(u32, Vec<[DVec3; 2]>)>);

impl Bodies {
    /// The first 64: of others nothing is told.
    fn new(scene: &Scene) -> Bodies {
        let closed =
            (0..).zip(&scene.shapes).filter(|(id, s)| scene.surface_of(*id).is_smooth() && s.shape.is_closed());
        let planes = |id: u32| {
            let faces = || scene.chains.faces.iter().filter(|f| f.shape == id);
            let c = faces().map(|f| f.p).sum::<DVec3>() / faces().count().max(1) as f64;
            faces().map(|f| [f.p, if f.n.dot(f.p - c) < 0.0 { -f.n } else { f.n }]).collect()
        };
        Bodies(closed.take(64).map(|(id, _)| (id, planes(id))).collect())
    }

    /// Those that hold a point.
    fn holding(&self, p: DVec3) -> u64 {
        let holds = |planes: &[[DVec3; 2]]| planes.iter().all(|[o, n]| n.dot(p - *o) < 0.0);
        self.0.iter().enumerate().filter(|(_, b)| holds(&b.1)).fold(0, |set, (k, _)| set | 1 << k)
    }

    /// Those that a span lies in: it ends at what is smooth.
    fn around(&self, span: &MediumSpan) -> u64 {
        let t = if span.t1.is_finite() { 0.5 * (span.t0 + span.t1) } else { f64::MAX.sqrt() };
        self.holding(span.o + span.w * t)
    }

    /// Whether light that comes from within the bodies `holding` may meet a face: of others only from outside.
    fn are_met(&self, f: &Face, from: Origin<f64>, holding: u64) -> bool {
        let Some(k) = self.0.iter().position(|b| b.0 == f.shape).filter(|k| holding >> k & 1 == 0) else { return true };
        let inner = self.0[k].1.iter().map(|x| x[0]).sum::<DVec3>() / self.0[k].1.len() as f64;
        f.is_before(from) == ((inner - f.p).dot(f.n) < 0.0)
    }

    fn bit(&self, shape: u32) -> u64 {
        self.0.iter().position(|b| b.0 == shape).map_or(0, |k| 1 << k)
    }
}

/// Steps, each with where it is taken.
type Taken = SmallVec<[(Step, DVec3); MOST]>;

/// Faces in turn, and how often they are asked for.
type Way = (SmallVec<[Link; MOST]>, f64);

/// All ways of a light, and the bodies that it is in.
fn ways(scene: &Scene, bodies: &Bodies, id: u32) -> (Vec<Way>, u64) {
    let light = &scene.lights[id as usize];
    let Some(from) = light.origin() else { return (Vec::new(), 0) };
    let faces = &scene.chains.faces;
    let begins = light.center().map_or(0, |q| bodies.holding(q));
    // Facets of meshes are in the list by themselves.
    let alone = (0..).zip(faces).filter(|(_, f)| !f.is_facet() && bodies.are_met(f, from, begins));
    let single = alone.flat_map(|(face, f)| {
        let (front, through) = (f.is_before(from), scene.surface_of(f.shape).is_transparent());
        let link = |through| (SmallVec::from_iter([Link { face, front, through }]), 1.0);
        std::iter::once(link(false)).chain(through.then(|| link(true)))
    });
    let listed = scene.chains.list.iter().filter(|c| c.light == id).map(|c| (c.links.clone(), c.asked));
    (std::iter::once((SmallVec::new(), 1.0)).chain(single).chain(listed).collect(), begins)
}

/// All sheets of a light that it may go on from.
fn of_light(scene: &Scene, bodies: &Bodies, id: u32) -> Vec<Sheet> {
    let faces = &scene.chains.faces;
    let (ways, begins) = ways(scene, bodies, id);
    let borders = borders(scene);
    let ends: Vec<Vec<[DVec3; 2]>> = faces.iter().map(|f| ends_of(scene, &borders, f)).collect();
    let of_way = |(links, asked): &Way| {
        let passed = |l: &Link| if l.through { bodies.bit(faces[l.face as usize].shape) } else { 0 };
        let within = links.iter().fold(begins, |set, l| set ^ passed(l));
        let mut sheets = Vec::new();
        let mut add = |at: usize, between: bool, border: Border| {
            let (links, asked) = (links.clone(), *asked);
            let mut sheet = Sheet { light: id, links, asked, at, between, border, within, pieces: Vec::new() };
            sheet.trace(scene);
            sheets.extend(Some(sheet).filter(|s| !s.pieces.is_empty()));
        };
        for (at, link) in links.iter().enumerate() {
            let face = &faces[link.face as usize];
            let before = at.checked_sub(1).map(|k| &faces[links[k].face as usize]);
            let shared = |ends: &[DVec3; 2]| before.is_some_and(|b| edges(b).any(|other| is_same(scene, ends, &other)));
            for &ends in ends[link.face as usize].iter().filter(|ends| !shared(ends)) {
                add(at, false, Border { ends, own: (face.shape, face.face), into: SmallVec::new() });
            }
        }
        for at in 0..=links.len() {
            // Convex bodies do not stand on lines that end on them.
            let around = [at.checked_sub(1), Some(at)].map(|k| Some(faces[links.get(k?)?.face as usize].shape));
            for b in borders.iter().filter(|b| !around.contains(&Some(b.own.0))) {
                add(at, true, b.clone());
            }
        }
        sheets
    };
    ways.par_iter().flat_map_iter(of_way).collect()
}

/// The borders of a face. Of two facets in one plane either takes over what the other leaves.
fn ends_of(scene: &Scene, borders: &[Border], face: &Face) -> Vec<[DVec3; 2]> {
    let counts = |ends: &[DVec3; 2]| borders.iter().any(|b| b.own.0 == face.shape && is_same(scene, &b.ends, ends));
    edges(face).filter(counts).collect()
}

/// How many sheets a light has at most.
fn count(scene: &Scene, bodies: &Bodies, id: u32) -> usize {
    let borders = borders(scene).len();
    ways(scene, bodies, id).0.iter().map(|(links, _)| 4 * links.len() + (links.len() + 1) * borders).sum()
}

fn edges(face: &Face) -> impl Iterator<Item = [DVec3; 2]> + '_ {
    border(face.corners())
}

/// All edges of what is smooth, each once, but those within a plane.
fn borders(scene: &Scene) -> Vec<Border> {
    let mut found: Vec<Border> = Vec::new();
    for f in &scene.chains.faces {
        for (ends, (_, into)) in edges(f).zip(sides(f.corners())) {
            match found.iter_mut().find(|b| b.own.0 == f.shape && is_same(scene, &b.ends, &ends)) {
                Some(known) => known.into.push(into),
                None => found.push(Border { ends, own: (f.shape, f.face), into: SmallVec::from_iter([into]) }),
            }
        }
    }
    // Within a plane there is none.
    found.retain(|b| !matches!(b.into[..], [a, c] if a.dot(c) < FLAT - 1.0));
    found
}

fn is_same(scene: &Scene, [a, b]: &[DVec3; 2], [c, d]: &[DVec3; 2]) -> bool {
    let near = |x: &DVec3, y: &DVec3| (*x - *y).length() <= ends::contact(scene);
    near(a, c) && near(b, d) || near(a, d) && near(b, c)
}

impl Sheet {
    fn point(&self, s: f64) -> DVec3 {
        self.border.ends[0].lerp(self.border.ends[1], s)
    }

    fn along(&self) -> DVec3 {
        (self.border.ends[1] - self.border.ends[0]).normalize()
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

    /// The steps of light that comes along w to the point z of the border and goes on, each with where it is taken.
    fn leaves(&self, scene: &Scene, z: DVec3, w: DVec3) -> Option<(Taken, Ray)> {
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
            let step = Step { shape, face, p: f.p, n: f.n, before: ray.w, behind, through: f.through };
            ray = Ray { o: ray.o + ray.w * t, w: behind };
            steps.push((step, ray.o));
        }
        Some((steps, ray))
    }

    fn ray(&self, scene: &Scene, s: f64) -> Option<Ray> {
        let z = self.point(s);
        Some(self.leaves(scene, z, self.comes(scene, z)?)?.1)
    }

    /// A ray, and how far within their faces all is that it meets but the border: none of them below 0, or no light comes.
    fn known(&self, scene: &Scene, s: f64) -> Option<(Ray, Margins)> {
        let z = self.point(s);
        let comes = self.comes(scene, z)?;
        let (_, before, _) = chain::steps(scene, &self.links[..self.at], (z, comes), false)?;
        let (behind, ray) = self.leaves(scene, z, comes)?;
        let faces = |links: &[Link]| links.iter().map(|l| &scene.chains.faces[l.face as usize]).collect::<Vec<_>>();
        let (first, last) = (faces(&self.links[..self.at]), faces(&self.links[self.at..]));
        let mut margins: Margins = first.iter().rev().zip(&before).flat_map(|(f, p)| f.depths(*p)).collect();
        // Its own plane is met at the border.
        let own = usize::from(!self.between);
        margins.extend(last.iter().zip(&behind).skip(own).flat_map(|(f, (_, p))| f.depths(*p)));
        if let (true, [a, b]) = (self.between, &self.border.into[..]) {
            // Faces on either side of the ray hide both.
            let across = comes.cross(self.along());
            margins.push(across.dot(*a) * across.dot(*b) * scene.bounds.radius());
        }
        Some((ray, margins))
    }

    /// Places of the border between which rays are looked for.
    fn places(&self, scene: &Scene) -> Vec<f64> {
        let mut places: Vec<f64> = (0..=PIECES).map(|k| k as f64 / PIECES as f64).collect();
        if let Some(q) = scene.lights[self.light as usize].center().filter(|_| self.at == 0) {
            let [a, b] = self.border.ends;
            let foot = (q - a).dot(b - a) / (b - a).length_squared();
            let graded = (1..=HALVED).flat_map(|k| [-1.0, 1.0].map(|side| foot + side * 0.5f64.powi(k)));
            places.extend(graded.chain([foot]).filter(|s| *s > 0.0 && *s < 1.0));
        }
        places.sort_by(f64::total_cmp);
        places.dedup();
        places
    }

    /// Find its rays: stretches of the border that light may go on from.
    fn trace(&mut self, scene: &Scene) {
        let known: Vec<(f64, Option<(Ray, Margins)>)> =
            self.places(scene).into_iter().map(|s| (s, self.known(scene, s))).collect();
        // Faces in turn that share the border are met on it.
        let slack = NONE * scene.bounds.radius();
        let mut piece: Vec<(f64, Ray)> = Vec::new();
        for pair in known.windows(2) {
            let [(a, first), (b, second)] = [&pair[0], &pair[1]].map(|(s, k)| (*s, k.as_ref()));
            let part: SmallVec<[(f64, Ray); 2]> = match (first, second) {
                (Some((r, m)), Some((q, n))) if may_be_positive(m, n, slack) => SmallVec::from_iter([(a, *r), (b, *q)]),
                (Some((r, _)), None) => std::iter::once((a, *r)).chain(self.end(scene, a, b)).collect(),
                (None, Some((q, _))) => self.end(scene, b, a).into_iter().chain([(b, *q)]).collect(),
                _ => SmallVec::new(),
            };
            let goes_on = piece.last().zip(part.first()).is_some_and(|(x, y)| x.0 == y.0);
            if !goes_on {
                self.pieces.push(std::mem::take(&mut piece));
            }
            piece.extend(part.into_iter().skip(usize::from(goes_on)));
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

    /// The way by a place of the border.
    fn met(&self, scene: &Scene, s: f64) -> Option<Met> {
        let z = self.point(s);
        let comes = self.comes(scene, z)?;
        let (before, points, _) = chain::steps(scene, &self.links[..self.at], (z, comes), false)?;
        let (behind, ray) = self.leaves(scene, z, comes)?;
        let along = self.along();
        let (mut steps, mut idle) = (SmallVec::from_vec(before), None);
        let m = if self.between {
            let n = (comes - along * comes.dot(along)).try_normalize()?;
            let (shape, face) = self.border.own;
            idle = Some(steps.len());
            steps.push(Step { shape, face, p: z, n, before: comes, behind: comes, through: true });
            n.cross(along)
        } else {
            let face = &scene.chains.faces[self.links[self.at].face as usize];
            face.n.cross(along)
        };
        steps.extend(behind.into_iter().map(|s| s.0));
        let first = points.last().copied().unwrap_or(z);
        Some(Met { from: self.from(scene), steps, idle, first, m, w: ray.w })
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

/// How far within borders: [`Sheet::known`].
type Margins = SmallVec<[f64; 16]>;

/// Whether all may be positive at once between two places, where they change as straight lines do, or nearly so.
fn may_be_positive(a: &Margins, b: &Margins, slack: f64) -> bool {
    let (mut lo, mut hi) = (0.0f64, 1.0f64);
    for (a, b) in a.iter().zip(b).map(|(a, b)| (a + slack, b + slack)) {
        match (a > 0.0, b > 0.0) {
            (true, true) => {}
            (false, false) => return false,
            (false, true) => lo = lo.max(a / (a - b)),
            (true, false) => hi = hi.min(a / (a - b)),
        }
    }
    lo <= hi + WIDER
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
        let settled = best.is_some_and(|(last, _): (f64, Ray)| (s - last).abs() <= SETTLED);
        best = Some((s, ray));
        if v == 0.0 || settled {
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
        let s = if (s - b.0).abs() > 1e-3 * (c.0 - a.0) {
            s
        } else if y > x {
            b.0 + 0.1 * y
        } else {
            b.0 - 0.1 * x
        };
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

#[cfg(test)]
#[path = "cast_tests.rs"]
mod tests;
