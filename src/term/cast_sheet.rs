//! Sheets across which light by a way ([`super::cast_route`]) begins and ends ([`super::cast`]): rays from the points of a border, which the faces before it send light to, on by those behind.
//!
//! Rays are told at some places of the border: between two of them a line may meet one where the volume that both span changes its sign, or comes near to none. Stretches of a border from which no
//! light goes on, because another face is missed or the border's own faces hide it, are left out.

use super::cast_border::{BESIDE, Border, Place, borders_of, edges, is_same};
use super::cast_route::{self, NONE, Route, Taken};
use super::ends;
use super::shown::window;
use crate::light::{LightKind, Origin};
use crate::math::fermat;
use crate::math::fold::Fold;
use crate::math::root::{dip, positive, root};
use crate::math::{DVec3, Rgb};
use crate::scene::balls::BallOf;
use crate::scene::beams::{FAINT, Step};
use crate::scene::bodies::Set;
use crate::scene::chains::MOST;
use crate::scene::{Hit, On, Scene};
use crate::transport::beam;
use crate::transport::record::MediumSpan;
use crate::transport::way_motion::Slide;
use rayon::prelude::*;
use smallvec::SmallVec;
use std::cell::Cell;
use std::collections::HashMap;
use std::f64::consts::PI;

/// Pieces of an edge at least, between whose ends rays are interpolated.
const PIECES: usize = 16;
/// Those of a rim or ball.
const AROUND: usize = 48;
/// Pieces at least of what lies within a beam.
const STRAIGHT: usize = 16;
/// Pieces of what lies before a ball.
const ACROSS: usize = 32;
/// Share of a ball's radius.
const NEAR: f64 = 3e-4;
/// Further ones are halved so often toward where the light is nearest: near to glass little of it may be let in.
const HALVED: i32 = 12;
/// Halvings that find where rays of a sheet end.
const STEPS: usize = 60;

/// A sheet behind a border.
pub struct Sheet {
    pub light: u32,
    pub route: Route,
    /// How often it is looked at.
    pub asked: f64,
    /// The number of the border's face on the route, or of what light meets next where one stands that does nothing.
    pub at: usize,
    between: bool,
    pub border: Border,
    /// Bodies that its rays are in.
    pub within: Set,
    /// Rays over stretches of the border, at its places in order.
    pieces: Vec<Vec<(f64, Ray)>>,
}

/// What a ray begins on: shapes, and faces of them.
pub type Grazed = SmallVec<[(u32, Vec<u32>); 2]>;

/// Of a sheet: unit direction.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    pub o: DVec3,
    pub w: DVec3,
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

/// The way that goes by a border.
pub struct Met {
    from: Origin<f64>,
    /// One of them may be no face.
    steps: SmallVec<[Step; MOST]>,
    idle: Option<usize>,
    /// Where light meets the first of them.
    pub first: DVec3,
    /// On the border.
    pub place: Place,
    /// Across the border.
    pub m: DVec3,
    /// Direction of the light behind all.
    pub w: DVec3,
}

/// The bodies that a span lies in: it ends at what is smooth.
pub fn around(scene: &Scene, span: &MediumSpan) -> Set {
    let t = if span.t1.is_finite() { 0.5 * (span.t0 + span.t1) } else { f64::MAX.sqrt() };
    scene.bodies.holding(span.o + span.w * t)
}

/// All sheets of a light that it may go on from.
pub fn of_light(scene: &Scene, borders: &[Border], id: u32) -> Vec<Sheet> {
    let faces = &scene.chains.faces;
    let (routes, begins) = cast_route::of_light(scene, id);
    let own: Vec<Vec<Border>> = faces.iter().map(|f| borders_of(scene, borders, f)).collect();
    let of_route = |(route, asked): &(Route, f64)| {
        let within = route.sets(scene, begins);
        let mut sheets = Vec::new();
        let mut add = |at: usize, between: bool, border: Border| {
            let (route, asked) = (route.clone(), *asked);
            let within = within[route.len()];
            let sheet = Sheet { light: id, route, asked, at, between, border, within, pieces: Vec::new() };
            let sheet = sheet.traced(scene);
            sheets.extend(Some(sheet).filter(|s| !s.pieces.is_empty()));
        };
        for (at, link) in route.links().iter().enumerate() {
            let before = at.checked_sub(1).map(|k| &faces[route.links()[k].face as usize]);
            let shared = |ends: &[DVec3; 2]| before.is_some_and(|b| edges(b).any(|other| is_same(scene, ends, &other)));
            for b in own[link.face as usize].iter().filter(|b| !b.ends().is_some_and(shared)) {
                add(at, false, b.clone());
            }
        }
        for at in 0..=route.len() {
            // Convex bodies do not stand on lines that end on them; a round mirror's rim may be another's, too.
            let met = |k: Option<usize>| k.filter(|k| *k < route.len()).map(|k| route.met(scene, k).0);
            let around = [at.checked_sub(1), Some(at)].map(met);
            let stands = |b: &&Border| {
                let is_met = b.faces.iter().any(|f| around.contains(&Some(f.0)));
                !is_met && scene.bodies.may_meet(b.own().0, Some(within[at]))
            };
            for b in borders.iter().filter(stands) {
                add(at, true, b.clone());
            }
        }
        if let LightKind::Beam { position, direction, radius, gaussian: false } = scene.lights[id as usize].kind {
            add(0, true, Border::of_beam(position, direction, radius));
        }
        sheets
    };
    routes.par_iter().flat_map_iter(of_route).collect()
}

/// How many sheets a light has at most.
pub fn count(scene: &Scene, borders: &[Border], id: u32) -> usize {
    let (routes, begins) = cast_route::of_light(scene, id);
    let stand = |set: Set| borders.iter().filter(|b| scene.bodies.may_meet(b.own().0, Some(set))).count();
    let mut known: HashMap<Set, usize> = HashMap::new();
    let mut of_set = |set: Set| *known.entry(set).or_insert_with(|| stand(set));
    routes
        .iter()
        .map(|(r, _)| 4 * r.links().len() + r.sets(scene, begins).into_iter().map(&mut of_set).sum::<usize>())
        .sum()
}

impl Met {
    /// How the point where it meets the border's plane moves, number `plane` on the way, as it leads to y.
    pub fn slide<'a>(&'a self, scene: &'a Scene, plane: usize, y: DVec3) -> Option<Slide<'a>> {
        Slide::new(scene, self.from, (&self.steps, self.idle), [self.first, y], plane)
    }
}

impl Sheet {
    /// A place of the border. Searches that do not settle are counted.
    fn place(&self, scene: &Scene, s: f64, unsettled: &mut u64) -> Option<Place> {
        let lost = Cell::new(0);
        let comes = |z: DVec3| {
            let mut count = 0;
            let w = self.comes(scene, z, &mut count);
            lost.set(lost.get() + count);
            w
        };
        let place = self.border.place(s, comes);
        *unsettled += lost.get();
        place
    }

    /// Length across the light of a share of the border at a place of it.
    pub fn length_across(&self, scene: &Scene, s: f64, at: &Place) -> Option<f64> {
        self.border.length_across(s, at, |s| self.place(scene, s, &mut 0))
    }

    /// Stretches of the border, between neighbouring places of which rays are known.
    pub fn stretches(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.pieces.iter().flat_map(|p| p.windows(2).map(|w| [w[0].0, w[1].0])).filter(|[a, b]| b > a)
    }

    /// What its ray by a place z of the border begins on, at o: the last face that it meets, and those of the border where that is there.
    fn grazed(&self, scene: &Scene, z: DVec3, o: DVec3) -> Grazed {
        let own = (o - z).length() <= ends::contact(scene);
        let mut grazed = if own { self.border.grazed() } else { Grazed::new() };
        if let Some((shape, face)) = self.route.len().checked_sub(1).map(|k| self.route.met(scene, k)) {
            match grazed.iter_mut().find(|g| g.0 == shape) {
                Some(known) => known.1.push(face),
                None => grazed.push((shape, vec![face])),
            }
        }
        grazed
    }

    /// Where the ray by a place of the border ends on something that scatters, its direction, and what it begins on. Not what the border stands on: the border itself is seen there.
    pub fn lands(&self, scene: &Scene, s: f64, unsettled: &mut u64) -> Option<(Hit, DVec3, Grazed)> {
        let Place { z, comes, .. } = self.place(scene, s, unsettled)?;
        let ray = self.behind(scene, z, comes)?.1;
        let grazed = self.grazed(scene, z, ray.o);
        let hit = scene.opaque_past(ray.o, ray.w, f64::INFINITY, &grazed)?;
        let scatters = !scene.surface_of(hit.shape).is_smooth();
        (scatters && (hit.p - z).length() > ends::contact(scene)).then_some((hit, ray.w, grazed))
    }

    /// How far from the border on either side light is asked for: a ball that it meets next magnifies that.
    pub fn aside(&self, scene: &Scene) -> f64 {
        let most = match self.route {
            Route::Mirror if self.at == 0 => NEAR * cast_route::mirror(scene).ball.radius,
            _ => f64::INFINITY,
        };
        self.border.aside(scene).min(most)
    }

    /// Across the sheet where its ray by a place of the border has gone `t` along w: `None` where there is no ray beside it.
    pub fn across(&self, scene: &Scene, s: f64, t: f64, w: DVec3) -> Option<DVec3> {
        let at = |s: f64| self.ray(scene, s).map(|r| r.o + r.w * t);
        let here = at(s)?;
        let beside = [s + BESIDE, s - BESIDE].into_iter().find_map(at)?;
        (beside - here).cross(w).try_normalize()
    }

    fn from(&self, scene: &Scene) -> Option<Origin<f64>> {
        scene.lights[self.light as usize].origin()
    }

    /// The direction of light at the point z of the border. Searches that do not settle are counted.
    fn comes(&self, scene: &Scene, z: DVec3, unsettled: &mut u64) -> Option<DVec3> {
        match self.route.arrival(scene, self.from(scene)?, self.at, z) {
            fermat::Way::Found(w) => Some(w),
            fermat::Way::None => None,
            fermat::Way::Lost => {
                *unsettled += 1;
                None
            }
        }
    }

    /// The steps of light that comes along w to the point z of the border and goes on, each with where it is taken.
    fn behind(&self, scene: &Scene, z: DVec3, w: DVec3) -> Option<(Taken, Ray)> {
        self.route.behind(scene, self.at, (z, w))
    }

    fn ray(&self, scene: &Scene, s: f64) -> Option<Ray> {
        let Place { z, comes, .. } = self.place(scene, s, &mut 0)?;
        Some(self.behind(scene, z, comes)?.1)
    }

    /// A ray, and how far within their faces all is that it meets but the border: none of them below 0, or no light comes.
    fn known(&self, scene: &Scene, s: f64) -> Option<(Ray, Margins)> {
        let Place { z, comes, along } = self.place(scene, s, &mut 0)?;
        let (_, before) = self.route.before(scene, self.at, (z, comes))?;
        let (behind, ray) = self.behind(scene, z, comes)?;
        let [first, last] = self.route.faces(scene, self.at);
        let mut margins: Margins = first.iter().rev().zip(&before).flat_map(|(f, p)| f.depths(*p)).collect();
        // Its own plane is met at the border.
        let own = usize::from(!self.between);
        margins.extend(last.iter().zip(&behind).skip(own).flat_map(|(f, (_, p))| f.depths(*p)));
        if let (true, [a, b]) = (self.between, &self.border.into[..]) {
            // Faces on either side of the ray hide both.
            let across = comes.cross(along);
            // Of a face along the light both edges have the same rays: that which they meet first counts.
            let is_last = |into: &DVec3| across.dot(*into).abs() <= NONE && into.dot(comes) < 0.0;
            let off = if is_last(a) || is_last(b) { -1.0 } else { across.dot(*a) * across.dot(*b) };
            margins.push(off * scene.bounds.radius());
        }
        Some((ray, margins))
    }

    /// Places of the border between which rays are looked for, on each stretch that light may come to.
    fn places(&self, scene: &Scene) -> Vec<Vec<f64>> {
        match scene.lights[self.light as usize].kind {
            LightKind::Beam { position, direction, radius, gaussian } if !self.border.is_of_beam() => {
                let reach = radius * if gaussian { FAINT } else { 1.0 };
                self.places_in_beam(scene, (position, direction), reach)
            }
            _ if self.at == 0 && self.route == Route::Mirror => self.places_before(scene, cast_route::mirror(scene)),
            _ => vec![self.places_of_all(scene)],
        }
    }

    /// Those whose light meets a ball. It is mirrored every way within, and turns the faster the nearer it comes to the ball's outline, like the root of the distance.
    fn places_before(&self, scene: &Scene, ball: &BallOf) -> Vec<Vec<f64>> {
        let r2 = ball.ball.radius.powi(2);
        let within = |s: f64| match self.place(scene, s, &mut 0) {
            Some(Place { z, comes, .. }) => r2 - ball.nearest_squared(z, comes),
            None => -r2,
        };
        let graded = |k: usize| 0.5 - 0.5 * (PI * k as f64 / ACROSS as f64).cos();
        let on = |[a, b]: [f64; 2]| (0..=ACROSS).map(|k| a + (b - a) * graded(k)).collect();
        positive(within, self.border.is_closed()).into_iter().map(on).collect()
    }

    /// Those within a beam of this radius. Its rays by a straight border lie in a plane.
    fn places_in_beam(&self, scene: &Scene, (position, direction): (DVec3, DVec3), radius: f64) -> Vec<Vec<f64>> {
        let mut w = direction;
        let mut planes: SmallVec<[(Fold, DVec3); MOST]> = SmallVec::new();
        for link in &self.route.links()[..self.at] {
            let f = scene.chains.fold(scene, link);
            let Some(behind) = f.behind(w) else { return Vec::new() };
            planes.push((f, behind));
            w = behind;
        }
        let within = |s: f64| {
            let Some(Place { z, .. }) = self.place(scene, s, &mut 0) else { return -radius * radius };
            let back = |p: DVec3, (f, w): &(Fold, DVec3)| p - *w * ((p - f.p).dot(f.n) / w.dot(f.n));
            let m = planes.iter().rev().fold(z, back) - position;
            radius * radius - (m - direction * m.dot(direction)).length_squared()
        };
        let is_closed = self.border.is_closed();
        let on = |[a, b]: [f64; 2]| {
            let count = if is_closed { (AROUND as f64 * (b - a)).ceil() as usize } else { 0 }.max(STRAIGHT);
            (0..=count).map(|k| a + (b - a) * k as f64 / count as f64).collect()
        };
        positive(within, is_closed).into_iter().map(on).collect()
    }

    fn places_of_all(&self, scene: &Scene) -> Vec<f64> {
        let count = if self.border.is_closed() { AROUND } else { PIECES };
        let mut places: Vec<f64> = (0..=count).map(|k| k as f64 / count as f64).collect();
        // Where light seems to come from.
        let near = match self.route {
            _ if self.at == 0 => scene.lights[self.light as usize].center(),
            Route::Mirror => Some(cast_route::mirror(scene).center),
            Route::Faces(_) => None,
        };
        if let Some((q, &[a, b])) = near.zip(self.border.ends()) {
            let foot = (q - a).dot(b - a) / (b - a).length_squared();
            let graded = (1..=HALVED).flat_map(|k| [-1.0, 1.0].map(|side| foot + side * 0.5f64.powi(k)));
            places.extend(graded.chain([foot]).filter(|s| *s > 0.0 && *s < 1.0));
        }
        places.sort_by(f64::total_cmp);
        places.dedup();
        places
    }

    /// With its rays: stretches of the border that light may go on from.
    fn traced(self, scene: &Scene) -> Sheet {
        let border = self.border.clone().lit(|z| self.comes(scene, z, &mut 0));
        let mut sheet = Sheet { border, ..self };
        sheet.pieces = sheet.trace(scene);
        sheet
    }

    fn trace(&self, scene: &Scene) -> Vec<Vec<(f64, Ray)>> {
        self.places(scene).into_iter().flat_map(|places| self.trace_on(scene, &places)).collect()
    }

    fn trace_on(&self, scene: &Scene, places: &[f64]) -> Vec<Vec<(f64, Ray)>> {
        let mut pieces = Vec::new();
        let known: Vec<(f64, Option<(Ray, Margins)>)> = places.iter().map(|&s| (s, self.known(scene, s))).collect();
        // Faces in turn that share the border are met on it.
        let slack = NONE * scene.bounds.radius();
        let mut piece: Vec<(f64, Ray)> = Vec::new();
        for pair in known.windows(2) {
            let [(a, first), (b, second)] = [&pair[0], &pair[1]].map(|(s, k)| (*s, k.as_ref()));
            let part: SmallVec<[(f64, Ray); 2]> = match (first, second) {
                (Some((r, m)), Some((q, n))) if window(m, n, slack).is_some() => {
                    SmallVec::from_iter([(a, *r), (b, *q)])
                }
                (Some((r, _)), None) => std::iter::once((a, *r)).chain(self.end(scene, a, b)).collect(),
                (None, Some((q, _))) => self.end(scene, b, a).into_iter().chain([(b, *q)]).collect(),
                _ => SmallVec::new(),
            };
            let goes_on = piece.last().zip(part.first()).is_some_and(|(x, y)| x.0 == y.0);
            if !goes_on {
                pieces.push(std::mem::take(&mut piece));
            }
            piece.extend(part.into_iter().skip(usize::from(goes_on)));
        }
        pieces.push(piece);
        pieces.retain(|p| p.len() > 1);
        pieces
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
    pub fn crossings(&self, scene: &Scene, o: DVec3, w: DVec3, [t0, t1]: [f64; 2]) -> SmallVec<[(f64, f64); 2]> {
        let mut found = SmallVec::new();
        let mut add = |s: f64, ray: &Ray| {
            let [t, rho] = ray.meets(o, w);
            if t > t0 && t < t1 && rho > 0.0 {
                found.push((s, t));
            }
        };
        let side = |s: f64| self.ray(scene, s).map(|r| (r.side(o, w), r));
        for piece in &self.pieces {
            let known: SmallVec<[(f64, f64); 64]> = piece.iter().map(|(s, r)| (*s, r.side(o, w))).collect();
            let (Some(&[first, second]), Some(&[before, end])) = (known.first_chunk(), known.last_chunk()) else {
                continue;
            };
            for pair in known.windows(2).filter(|p| (p[0].1 < 0.0) != (p[1].1 < 0.0)) {
                if let Some((s, ray)) = root(pair[0], pair[1], &side) {
                    add(s, &ray);
                }
            }
            // Two between, that signs do not tell: where the least of three is in the middle. An end has a neighbour beyond it, on a closed border the one at the other end.
            let mut pairs = |last: (f64, f64), here: (f64, f64), next: (f64, f64)| {
                if !is_least(last.1, here.1, next.1) {
                    return;
                }
                let sign = if here.1 < 0.0 { -1.0 } else { 1.0 };
                let Some(turned) = dip(last, here, next, sign, &side) else { return };
                for pair in [[last, turned], [turned, next]] {
                    let within = |(s, _): &(f64, Ray)| *s >= first.0 && *s <= end.0;
                    if let Some((s, ray)) = root(pair[0], pair[1], &side).filter(within) {
                        add(s, &ray);
                    }
                }
            };
            known.windows(3).for_each(|k| pairs(k[0], k[1], k[2]));
            let beyond = |here: (f64, f64), other: (f64, f64)| {
                let nearer = (other.1 < 0.0) == (here.1 < 0.0) && other.1.abs() >= here.1.abs();
                let s = 2.0 * here.0 - other.0;
                nearer.then(|| side(s).map(|v| (s, v.0)))?
            };
            if let Some(last) = beyond(first, second) {
                pairs(last, first, second);
            }
            if let Some(next) = beyond(end, before) {
                pairs(before, end, next);
            }
        }
        found
    }

    /// The way by a place of the border; `None` where its planes are not met in turn. Searches that do not settle are counted.
    pub fn met(&self, scene: &Scene, s: f64, unsettled: &mut u64) -> Option<Met> {
        let place = self.place(scene, s, unsettled)?;
        let Place { z, comes, along } = place;
        let (before, points) = self.route.before(scene, self.at, (z, comes))?;
        let (behind, ray) = self.behind(scene, z, comes)?;
        let (mut steps, mut idle) = (SmallVec::from_vec(before), None);
        let m = if self.between {
            let n = (comes - along * comes.dot(along)).try_normalize()?;
            // What stands there does not matter.
            let (shape, face) = self.border.matter().unwrap_or_default();
            idle = Some(steps.len());
            steps.push(Step { shape, face, p: z, n, before: comes, behind: comes, through: true });
            n.cross(along)
        } else {
            let face = &scene.chains.faces[self.route.links()[self.at].face as usize];
            face.n.cross(along)
        };
        steps.extend(behind.into_iter().map(|s| s.0));
        let first = points.last().copied().unwrap_or(z);
        Some(Met { from: self.from(scene)?, steps, idle, first, place, m, w: ray.w })
    }

    /// Irradiance across its direction that the light brings to y, whose faces and medium are given, by the faces; none where it does not come. `first`: where light by the border meets the first of them. Searches that do not settle are counted.
    pub fn arrives(
        &self,
        scene: &Scene,
        first: DVec3,
        (y, on, medium): (DVec3, On, Option<u32>),
        unsettled: &mut u64,
    ) -> Rgb {
        let light = &scene.lights[self.light as usize];
        let mut found = || {
            let (way, points) = self.route.way(scene, (self.light, self.from(scene)?), y, unsettled)?;
            // A beam may be narrow: what it sends by the border itself counts on either side, but at its own edge.
            let at_border = light.is_beam() && !self.border.is_of_beam();
            let entry = if at_border { first } else { points.last().copied().unwrap_or(y) };
            let emission = light.emission_toward(entry)?;
            let clear = beam::clear(scene, &way, &points, (y, on, medium), &mut |_| {})?;
            Some(emission.color() * clear * way.gain)
        };
        found().unwrap_or(Rgb::ZERO)
    }
}

/// Whether the middle one of three values of one sign is the least; of two that are alike the second counts.
fn is_least(last: f64, here: f64, next: f64) -> bool {
    let alike = |x: f64| (x < 0.0) == (here < 0.0);
    alike(last) && alike(next) && last.abs() >= here.abs() && next.abs() > here.abs()
}

/// How far within borders: [`Sheet::known`].
type Margins = SmallVec<[f64; 16]>;

#[cfg(test)]
#[path = "cast_tests.rs"]
mod tests;
