//! The ways of a light by what is smooth ([`super::cast`]): flat faces in turn, or a ball of metal that mirrors it. Given a point, light comes to it in one way at most.

use super::cast_sheet::Ray;
use crate::light::{LightKind, Origin};
use crate::math::DVec3;
use crate::math::fermat::Way as Found;
use crate::math::fold::Fold;
use crate::scene::balls::BallOf;
use crate::scene::beams::{Step, Way};
use crate::scene::bodies::Set;
use crate::scene::chains::{Face, Link, MOST};
use crate::scene::{Instance, Scene};
use crate::transport::chain;
use smallvec::SmallVec;

/// Distances ahead, in scene radii, that may be none: light passes two faces at the edge that they share.
pub const NONE: f64 = 1e-9;

/// Steps, each with where it is taken.
pub type Taken = SmallVec<[(Step, DVec3); MOST]>;

/// What light meets in turn.
#[derive(Clone, Debug, PartialEq)]
pub enum Route {
    Faces(SmallVec<[Link; MOST]>),
    /// The only one of the scene ([`lone_mirror`]).
    Mirror,
}

/// A ball of metal that mirrors light from outside, where nothing else mirrors or refracts: light that goes on from it meets nothing of that kind.
pub fn lone_mirror(scene: &Scene) -> Option<&BallOf> {
    let smooth = |s: &&Instance| scene.surfaces[s.surface as usize].is_smooth();
    let stands = || scene.lights.iter().filter_map(|l| l.stands());
    let outside = |b: &BallOf| stands().all(|q| (q - b.center).length() > b.ball.radius);
    let mirrors = |b: &&BallOf| b.ball.is_metal && !b.flipped && outside(b);
    scene.balls.first().filter(mirrors).filter(|_| scene.shapes.iter().filter(smooth).count() == 1)
}

/// That of [`Route::Mirror`].
pub fn mirror(scene: &Scene) -> &BallOf {
    &scene.balls[0]
}

/// All ways of a light, each with how often it is asked for, and the bodies that the light is in.
pub fn of_light(scene: &Scene, id: u32) -> (Vec<(Route, f64)>, Set) {
    let (light, bodies) = (&scene.lights[id as usize], &scene.bodies);
    let Some(from) = light.origin() else { return (Vec::new(), 0) };
    let faces = &scene.chains.faces;
    let begins = light.stands().map_or(0, |q| bodies.holding(q));
    if let LightKind::Beam { .. } = light.kind {
        let link = |s: &Step| {
            let face = (0..).zip(faces.iter()).find(|(_, f)| (f.shape, f.face) == (s.shape, s.face))?.0;
            Some(Link { face, front: s.before.dot(s.n) < 0.0, through: s.through })
        };
        let own = scene.beams.ways.iter().filter(|w| w.light == id);
        let links = |w: &Way| Some(Route::Faces(w.steps.iter().map(link).collect::<Option<_>>()?));
        return (own.filter_map(|w| Some((links(w)?, w.asked()))).collect(), begins);
    }
    // Facets of meshes are in the list by themselves.
    let is_met =
        |f: &Face| bodies.may_meet(f.shape, Some(begins)) && bodies.may_meet_from(f, f.is_before(from), begins);
    let alone = (0..).zip(faces.iter()).filter(|(_, f)| !f.is_facet() && is_met(f));
    let single = alone.flat_map(|(face, f)| {
        let (front, through) = (f.is_before(from), scene.surface_of(f.shape).is_transparent());
        let link = |through| (Route::Faces(SmallVec::from_iter([Link { face, front, through }])), 1.0);
        std::iter::once(link(false)).chain(through.then(|| link(true)))
    });
    let listed = scene.chains.list.iter().filter(|c| c.light == id);
    let listed = listed.map(|c| (Route::Faces(c.links.clone()), c.asked));
    let mirror = lone_mirror(scene).map(|_| (Route::Mirror, 1.0));
    let straight = (Route::Faces(SmallVec::new()), 1.0);
    (std::iter::once(straight).chain(single).chain(listed).chain(mirror).collect(), begins)
}

impl Route {
    pub fn len(&self) -> usize {
        match self {
            Route::Faces(links) => links.len(),
            Route::Mirror => 1,
        }
    }

    /// Flat faces of it.
    pub fn links(&self) -> &[Link] {
        match self {
            Route::Faces(links) => links,
            Route::Mirror => &[],
        }
    }

    /// The flat faces among those that it meets before the number `at`, and among the others.
    pub fn faces<'a>(&self, scene: &'a Scene, at: usize) -> [Vec<&'a Face>; 2] {
        let (before, behind) = self.links().split_at(at.min(self.links().len()));
        [before, behind].map(|links| links.iter().map(|l| &scene.chains.faces[l.face as usize]).collect())
    }

    /// What it meets.
    pub fn shapes<'a>(&'a self, scene: &'a Scene) -> impl Iterator<Item = u32> + 'a {
        (0..self.len()).map(|k| self.met(scene, k).0)
    }

    /// Shape and face of what it meets as number k.
    pub fn met(&self, scene: &Scene, k: usize) -> (u32, u32) {
        match self {
            Route::Faces(links) => {
                let f = &scene.chains.faces[links[k].face as usize];
                (f.shape, f.face)
            }
            Route::Mirror => (mirror(scene).shape, 0),
        }
    }

    /// The bodies that light is in before each face of it, and behind all.
    pub fn sets(&self, scene: &Scene, begins: Set) -> SmallVec<[Set; MOST + 1]> {
        let Route::Faces(links) = self else { return SmallVec::from_slice(&[begins; 2]) };
        let passed = |l: &Link| if l.through { scene.bodies.of(scene.chains.faces[l.face as usize].shape) } else { 0 };
        let behind = links.iter().scan(begins, |set, l| {
            *set ^= passed(l);
            Some(*set)
        });
        std::iter::once(begins).chain(behind).collect()
    }

    /// The direction in which light arrives at z by the first `at` of what it meets.
    pub fn arrival(&self, scene: &Scene, from: Origin<f64>, at: usize, z: DVec3) -> Found<DVec3> {
        match (self, from) {
            (_, Origin::Position(q)) if at == 0 => (z - q.value()).try_normalize().map_or(Found::None, Found::Found),
            (_, Origin::Infinity(w)) if at == 0 => Found::Found(w.value()),
            (Route::Faces(links), _) => chain::arrival(scene, &scene.chains, &links[..at], from, z, false),
            (Route::Mirror, _) => {
                let ball = mirror(scene);
                let met = ball.mirrored(from, z).map(|way| ball.center + way.points[0]);
                met.map_or(Found::None, |p| Found::Found((z - p).normalize()))
            }
        }
    }

    /// The steps of light that arrives at z along w by the first `at` of what it meets, and its points there, the last one first.
    pub fn before(
        &self,
        scene: &Scene,
        at: usize,
        (z, w): (DVec3, DVec3),
    ) -> Option<(Vec<Step>, SmallVec<[DVec3; MOST]>)> {
        match self {
            Route::Faces(links) => {
                let (steps, points, _) = chain::steps(scene, &scene.chains, &links[..at], (z, w), false)?;
                Some((steps, points))
            }
            Route::Mirror if at == 0 => Some(Default::default()),
            Route::Mirror => {
                let (back, p) = mirror(scene).mirror(z, -w)?;
                let step = Step { before: -back.behind, behind: w, ..back };
                Some((vec![step], SmallVec::from_iter([p])))
            }
        }
    }

    /// The steps of light that comes along w to z, before what it meets as number `at`, and goes on, each with where it is taken, and the ray behind all.
    pub fn behind(&self, scene: &Scene, at: usize, (z, w): (DVec3, DVec3)) -> Option<(Taken, Ray)> {
        let mut ray = Ray { o: z, w };
        let mut steps = Taken::new();
        if let Route::Mirror = self {
            if at == 0 {
                let (step, p) = mirror(scene).mirror(z, w)?;
                ray = Ray { o: p, w: step.behind };
                steps.push((step, p));
            }
            return Some((steps, ray));
        }
        for link in &self.links()[at..] {
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

    /// The whole way of a light to y, and its points from the last one to the first; `None` where it misses something. Searches that do not settle are counted.
    pub fn way(
        &self,
        scene: &Scene,
        (light, from): (u32, Origin<f64>),
        y: DVec3,
        unsettled: &mut u64,
    ) -> Option<(Way, SmallVec<[DVec3; MOST]>)> {
        match self {
            Route::Faces(links) => chain::way(scene, &scene.chains, (light, links), from, y, unsettled),
            Route::Mirror => {
                let ball = mirror(scene);
                ball.way(scene.surface_of(ball.shape), light, from, &ball.mirrored(from, y)?, y)
            }
        }
    }
}
