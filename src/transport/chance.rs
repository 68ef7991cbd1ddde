//! Shots by chance: chains that random rays of an eye, or of a light, find, and the ways to a target that Newton's method finds from there ([`super::shot`]).
//!
//! How probable a result was nobody knows, but the number of further trials until it is found once more has the mean 1/P (Booth, "Unbiased Monte Carlo Estimation of the Reciprocal of
//! an Integral", 2007).
//!
//! *Bubbles*, balls and rods of less index than what is around them: a ray that comes in near the critical angle goes round along the wall in short chords and loses the less at each the nearer it is. Ways of any
//! number m of such chords count, as 1/m² together, from a part of the rays that shrinks as 1/m²: drawn as others are, they would be found once in m⁴ draws at best. So a ray that has found its
//! way into a bubble is inclined toward the critical angle half of the time ([`super::bubble`]), and inside it is mirrored as often as light, and seldom ends.

use super::bubble;
use super::ray::Specular;
use super::shot::{self, EXACT, Eye, Place, SAME, Shot, Start, Step, Target, Turn, steps};
use crate::math::rng::Rng;
use crate::math::warp;
use crate::scene::Scene;
use crate::surface::Ray;

/// Trials before a shot counts as lost.
const TRIALS: u32 = 1 << 20;
/// Two rays are the same if they are as near to each other, over a ray's unit, where the target cannot tell one from the other.
const NEAR: f64 = 1e-4;
/// How often a random chain goes on behind an interface, and where all is mirrored: to what stands anywhere on its way, more often where that costs no light; or to what is lit.
pub const TO_EDGES: [f64; 2] = [0.4, 0.7];
pub const TO_LIT: [f64; 2] = [0.75, 0.75];
/// A ray goes either way at least so often.
const EITHER: f64 = 0.15;
/// In a bubble it leaves at least so often, each time that it meets the wall.
const LEAVES: f64 = 0.03;
/// A chain that is mirrored in a bubble ends there as often as this, times how often it leaves.
const ENDS: f64 = 0.25;
/// How often a ray that comes into a bubble is inclined toward the critical angle.
const INCLINED: f64 = 0.5;
/// What would be kept of a chain by which all light goes and that is drawn always.
const FAINT: f64 = 4.0;
/// Shots that are found more rarely are kept the more rarely: what is not found again within [`TRIALS`] is lost.
const RARE: f64 = 3e-5;

/// Whether a ray runs in a bubble before it meets its wall.
fn in_bubble(scene: &Scene, s: &Specular) -> bool {
    bubble::critical(scene, s.hit.shape).is_some() && Step::of(scene, s).inside
}

/// How a random chain goes on at a face.
struct Fork {
    /// Share of the light that is mirrored, of what is not lost in metal.
    light: f64,
    /// Probability to be mirrored, and to go on behind the face where that is so, or else.
    mirrors: f64,
    goes_on: [f64; 2],
}

impl Fork {
    fn at(scene: &Scene, s: &Specular, [mirrored, refracted]: &[Option<Ray>; 2], goes_on: [f64; 2]) -> Fork {
        if refracted.is_none() {
            return Fork { light: 1.0, mirrors: 1.0, goes_on: [goes_on[1]; 2] };
        }
        let light = mirrored.map_or(0.0, |r| r.weight.mean());
        if in_bubble(scene, s) {
            let mirrors = light.clamp(EITHER, 1.0 - LEAVES);
            return Fork { light, mirrors, goes_on: [goes_on[0].max(1.0 - ENDS * (1.0 - mirrors)), goes_on[0]] };
        }
        Fork { light, mirrors: light.clamp(EITHER, 1.0 - EITHER), goes_on: [goes_on[0]; 2] }
    }
}

/// A chain of one face at least behind a ray.
pub struct Chain {
    pub start: Start,
    pub faces: Vec<Specular>,
}

/// A random chain behind a ray, or, where that comes into a bubble, behind another; `None` where it meets none, or ends before it has one.
pub fn random_chain(
    scene: &Scene,
    eye: &Eye,
    start: Start,
    place: &Place,
    goes_on: [f64; 2],
    rng: &mut Rng,
) -> Option<Chain> {
    let chain = behind(scene, start, place, &[], goes_on, rng)?;
    let most = |s: &Specular| bubble::critical(scene, s.hit.shape).filter(|_| s.through && !in_bubble(scene, s));
    let Some((k, most)) = chain.faces.iter().enumerate().find_map(|(k, s)| Some((k, most(s)?))) else {
        return Some(chain);
    };
    if rng.uniform() >= INCLINED {
        return Some(chain);
    }
    // The cosine inside falls by a factor, by one below x with the probability √x.
    let (known, s, falls) = (steps(scene, &chain.faces[..=k]), &chain.faces[k], rng.uniform().powi(2));
    let left = most * most - s.n.cross(s.w).length_squared();
    let sine = (most * most - left * falls * falls).max(0.0).sqrt();
    let start = bubble::inclined(scene, eye, start, place, &known, sine)?;
    behind(scene, start, place, &known, goes_on, rng)
}

/// A chain that begins with these steps, at random from there on.
fn behind(
    scene: &Scene,
    start: Start,
    place: &Place,
    known: &[Step],
    goes_on: [f64; 2],
    rng: &mut Rng,
) -> Option<Chain> {
    let (mut faces, mut on) = (0, 1.0);
    let left = shot::walk(scene, start, place, false, usize::MAX, |hit, w, turns| {
        faces += 1;
        if let Some(step) = known.get(faces - 1) {
            on = goes_on[0];
            return step.taken(scene, hit, w, turns);
        }
        if on < 1.0 && rng.uniform() >= on {
            return None;
        }
        let turn = if turns.len() > 1 { (rng.uniform() * turns.len() as f64) as usize } else { 0 };
        let Turn { n, rays } = turns.get(turn)?;
        let met = Specular { hit: *hit, n: *n, w, out: w, through: false };
        let fork = Fork::at(scene, &met, rays, goes_on);
        let through = fork.mirrors < 1.0 && rng.uniform() >= fork.mirrors;
        on = fork.goes_on[usize::from(through)];
        Some((turn, through))
    })?;
    (left.chain.len() >= known.len().max(1)).then_some(Chain { start, faces: left.chain })
}

/// A random shot to a target by way of at least one interface, from where a random ray of the eye leads, if it is kept. [`Drawn::trials`] gives its weight.
pub struct Drawn {
    pub shot: Shot,
    chain: Vec<Step>,
    /// Probability that it was kept.
    kept: f64,
}

/// Of chains that `is_known` does not hold.
pub fn draw(
    scene: &Scene,
    eye: &Eye,
    place: &Place,
    target: &Target,
    rng: &mut Rng,
    mut random: impl FnMut(&mut Rng) -> Option<Start>,
    is_known: impl Fn(&[Step]) -> bool,
) -> Option<Drawn> {
    let found = random_chain(scene, eye, random(rng)?, place, TO_EDGES, rng)?;
    let chain = steps(scene, &found.faces);
    if is_known(&chain) {
        return None;
    }
    let shot = shot::by(scene, eye, found.start, place, &chain, target)?;
    let kept = kept(scene, eye, target, &shot);
    (kept >= 1.0 || rng.uniform() < kept).then_some(Drawn { shot, chain, kept })
}

/// What is kept of shots by chains by which little light goes. To look for a shot once more costs about as much by any chain; of a chain of the light L that is found with probability p the variance is as `L²/p`:
/// the best share to keep is as `L/√p`. p is guessed: the chain's, by as much less as it spreads rays more than a straight way does.
fn kept(scene: &Scene, eye: &Eye, target: &Target, shot: &Shot) -> f64 {
    let chain = &shot.chain;
    let (mut light, mut drawn) = (1.0, 1.0_f64);
    for (k, s) in chain.iter().enumerate() {
        let fork = Fork::at(scene, s, &scene.surface_of(s.hit.shape).rays(s.n, s.w), TO_EDGES);
        light *= if s.through { 1.0 - fork.light } else { fork.light };
        drawn *= if s.through { 1.0 - fork.mirrors } else { fork.mirrors };
        if k + 1 < chain.len() {
            drawn *= fork.goes_on[usize::from(s.through)];
        }
    }
    let straight = match eye {
        Eye::Point(p) => (shot.e - *p).length_squared(),
        Eye::Parallel(_) => 1.0,
    };
    // Inclined rays are the denser near the critical angle, as one over the square of the cosine inside; around a ball Newton's method comes from nearer the smaller that is.
    let inclined = chain.iter().find(|s| in_bubble(scene, s));
    let inside = inclined.map_or(1.0, |s| {
        let cosine = s.n.dot(s.w).abs();
        if bubble::is_wall(scene, s.hit.shape) { cosine * cosine } else { cosine }
    });
    let spreads = (inside * shot.spread / (straight * target.unit())).max(1.0);
    let found = drawn / spreads;
    (FAINT * light / found.sqrt()).min(1.0) * (found / RARE).min(1.0)
}

impl Drawn {
    /// How many draws it takes to find the same shot once more, over the probability that it was kept: 1/P on average. `None` after far too many.
    pub fn trials(
        &self,
        scene: &Scene,
        eye: &Eye,
        place: &Place,
        target: &Target,
        rng: &mut Rng,
        random: impl FnMut(&mut Rng) -> Option<Start>,
    ) -> Option<f64> {
        let size = (self.shot.e - self.shot.start.o).length();
        let drawn = trials(scene, eye, place, (&self.chain, target, TO_EDGES), (self.shot.start, size), rng, random);
        drawn.map(|k| k / self.kept)
    }
}

/// How many draws it takes to find a ray once more by this chain, `own` and the size of its way.
pub fn trials(
    scene: &Scene,
    eye: &Eye,
    place: &Place,
    (chain, target, goes_on): (&[Step], &Target, [f64; 2]),
    (own, size): (Start, f64),
    rng: &mut Rng,
    mut random: impl FnMut(&mut Rng) -> Option<Start>,
) -> Option<f64> {
    let there = shot::miss(scene, eye, own, place, chain, target)?;
    let (x, y) = warp::frame(own.w);
    let unit = eye.unit(scene, size);
    let limit = 10.0 * EXACT * there.length + 2.0 * there.off.length();
    let is_same = |s: Start| {
        let by = match eye {
            Eye::Point(_) => s.w - own.w,
            // Wherever along them they begin.
            Eye::Parallel(w) => s.o - own.o - *w * (s.o - own.o).dot(*w),
        };
        // Near a caustic rays differ by more than what they miss the target by.
        let moved = there.by[0] * by.dot(x) + there.by[1] * by.dot(y);
        by.length() <= SAME * unit || by.length() <= NEAR * unit && moved.length() <= limit
    };
    (1..=TRIALS).find_map(|k| {
        let found = random_chain(scene, eye, random(rng)?, place, goes_on, rng)?;
        if steps(scene, &found.faces) != chain {
            return None;
        }
        shot::solve(scene, eye, found.start, place, chain, target)
            .is_some_and(|(s, _)| is_same(s))
            .then_some(f64::from(k))
    })
}

#[cfg(test)]
#[path = "chance_tests.rs"]
mod tests;
