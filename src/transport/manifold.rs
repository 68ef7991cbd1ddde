//! Connections to point, spot, directional and collimated lights by chains of smooth surfaces that nothing lists: of several balls, of balls and panes, of cylinders, of meshes shaded by vertex normals (Zeltner, Georgiev and Jakob,
//! "Specular manifold sampling", 2020).
//!
//! A random ray of the light, sent at one of the smooth shapes, finds a chain by chance; Newton's method goes on from it to the ray that the chain takes to the vertex ([`super::shot`], [`super::chance`]). Any solution is found with a probability P that
//! nobody knows; the number of further trials until it is found again has the mean 1/P. So no solution is left out, and caustics, where the gain ([T] (47), (48)) has no bound, are not clamped; the price is a variance of the order of the value. Chains that
//! other connections list ([`super::chain`], [`super::ball`], [`super::beam`]) are theirs.

use super::beam;
use super::chance::{self, TO_LIT};
use super::pane::{self, Found};
use super::record::Recorder;
use super::shot::{self, Eye, Place, Target};
use super::state::State;
use super::vertex::Vertex;
use super::walk::Walker;
use crate::light::Origin;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, Rgb};
use crate::scene::Scene;
use crate::scene::beams::{Step, Way};
use smallvec::SmallVec;

/// Ways that bring less than this part of what the light would bring straight are asked for the more rarely, the less they bring.
const FAINT: f64 = 0.1;

/// Score what all lights without extent, and all beams, bring to the vertex at `s.o` by one chain that chance finds.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene: &Scene = w.scene;
    if scene.seeds.is_empty() || !w.may_scatter(s.depth + 1) {
        return;
    }
    for (id, light) in scene.lights.iter().enumerate() {
        let Some(origin) = light.origin() else { continue };
        // However many numbers the search takes, the path takes one.
        let mut rng = Rng::keyed(s.rng.next_u64(), Purpose::Manifold as u64, id as u64, 0);
        let eye = match origin {
            Origin::Position(q) => Eye::Point(q.value()),
            Origin::Infinity(v) => Eye::Parallel(v.value()),
        };
        let (place, x) = (Place::within(None), s.o);
        let Some(start) = scene.seed(light, &eye, &mut rng) else { continue };
        let Some(found) = chance::random_chain(scene, &eye, start, &place, TO_LIT, &mut rng) else { continue };
        let (start, chain) = (found.start, found.faces);
        let order = s.depth + chain.len() as u32;
        if !w.may_scatter(order)
            || order < w.set.min_order
            || scene.is_left_to_others(light, chain.iter().map(|c| c.hit.shape))
        {
            continue;
        }
        let chain = shot::steps(scene, &chain);
        let Some((found, crossings, spread)) = shot::to_point(scene, &eye, start, &place, &chain, x) else { continue };
        let step = |(c, x): (&shot::Step, &shot::Crossing)| {
            let (shot::Step { shape, through, .. }, shot::Crossing { face, p, n, before, behind }) = (*c, *x);
            Step { shape, face, p, n, before, behind, through }
        };
        let steps: Vec<Step> = chain.iter().zip(&crossings).map(step).collect();
        let points: SmallVec<[DVec3; 8]> = crossings.iter().rev().map(|c| c.p).collect();
        let (Some(&first), Some(last)) = (points.last(), steps.last()) else { continue };
        let gain = steps.iter().fold(Rgb::splat(1.0 / spread), |g, s| g * pane::share(scene, s));
        let Some(emission) = light.emission_toward(first).filter(|_| !gain.is_zero() && gain.is_finite()) else {
            continue;
        };
        let mut way = Way { light: id as u32, w: last.behind, gain, steps, source: None };
        // Seen before it is looked for again.
        if vertex.toward(scene, s, -way.w).lobe.f <= 0.0 {
            continue;
        }
        let (on, medium) = vertex.start(s, -way.w);
        if beam::clear(scene, &way, &points, (x, on, medium), &mut |_| {}).is_none() {
            continue;
        }
        // Light that goes round in many ways is faint, and each of them would take a search of its own.
        let straight = match eye {
            Eye::Point(q) => 1.0 / (x - q).length_squared(),
            Eye::Parallel(_) => 1.0,
        };
        let asked = way.gain.max() / (FAINT * straight);
        if asked < 1.0 {
            if rng.uniform() >= asked {
                continue;
            }
            way.gain *= 1.0 / asked;
        }
        let size = (x - found.o).length();
        let again = (&chain[..], &Target::Point(x), TO_LIT);
        let random = |rng: &mut Rng| scene.seed(light, &eye, rng);
        let Some(trials) = chance::trials(scene, &eye, &place, again, (found, size), &mut rng, random) else {
            w.tally.unsettled += 1;
            continue;
        };
        way.gain *= trials;
        pane::score(w, s, vertex, &Found { way: &way, points: &points, emission });
    }
}
