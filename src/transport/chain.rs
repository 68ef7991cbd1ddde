//! Connections to point, spot and directional lights by several flat smooth faces in turn ([`crate::scene::chains`]): at every vertex, each such light by each chain. A chain has one solution
//! ([`crate::math::fermat`]), or none that lies within its faces.
//!
//! The gain is a ray's from the light, carried through the planes in dual numbers: solid angle there over the area across it at the vertex ([T] (47) for any number of planes), times what each face lets by.

use super::pane::{self, Found};
use super::record::Recorder;
use super::state::State;
use super::vertex::Vertex;
use super::walk::Walker;
use crate::light::Origin;
use crate::math::fermat::{self, Eye, Onward, Planes};
use crate::math::fold::{self, Fold};
use crate::math::fresnel::Interface;
use crate::math::rng::{Purpose, Rng};
use crate::math::{DVec3, Dual, Rgb, V3, warp};
use crate::scene::beams::{Step, Way};
use crate::scene::chains::{Chains, Link, MOST};
use crate::scene::{Scene, effort};
use smallvec::SmallVec;

/// How far from a light a line may end, over its length.
const MISS: f64 = 1e-6;

/// Two coordinates of a light's rays.
type D2 = Dual<2>;

/// Score what all lights without extent bring to the vertex at `s.o` by two faces and more, or by facets of meshes, beams by the latter.
pub fn connect<R: Recorder>(w: &mut Walker<R>, s: &mut State, vertex: &Vertex) {
    let scene: &Scene = w.scene;
    let chains = &scene.chains;
    if chains.list.is_empty() {
        return;
    }
    let mut drawn: SmallVec<[u32; 64]> = SmallVec::new();
    // How many numbers that takes changes with places: the path's own stay in step.
    let mut aside = Rng::keyed(s.rng.next_u64(), Purpose::Manifold as u64, 0, 0);
    chains.draw(s.o, || aside.uniform(), |id| drawn.push(id));
    for id in drawn {
        let chain = &chains.list[id as usize];
        let order = s.depth + chain.links.len() as u32;
        if !w.may_scatter(order) || order < w.set.min_order {
            continue;
        }
        if !chains.may_reach(chain, s.o) {
            continue;
        }
        let light = &scene.lights[chain.light as usize];
        let Some(from) = light.origin() else { continue };
        let found = way(scene, chains, (chain.light, &chain.links), from, s.o, &mut w.tally.unsettled);
        let Some((mut way, points)) = found else { continue };
        way.gain *= 1.0 / chain.asked;
        let Some(&first) = points.last() else { continue };
        let Some(emission) = light.emission_toward(first) else { continue };
        pane::score(w, s, vertex, &Found { way: &way, points: &points, emission });
    }
}

/// The direction in which light by the planes of some links arrives at x. `hulls`: only if it meets each within its face.
pub fn arrival(
    scene: &Scene,
    chains: &Chains,
    links: &[Link],
    from: Origin<f64>,
    x: DVec3,
    hulls: bool,
) -> fermat::Way<DVec3> {
    let folds = links.iter().map(|l| chains.fold(scene, l));
    match from {
        Origin::Position(q) => {
            effort::note(2);
            let hull = |l: &Link| chains.faces[l.face as usize].corners().into();
            let (image, unfolded) = fold::unfold(q.value(), folds.zip(links.iter().map(hull)));
            let list: SmallVec<[&[DVec3]; MOST]> = unfolded.iter().map(|u| &u.1[..]).collect();
            let planes = Planes::new(unfolded.iter().map(|u| u.0), Onward::Both);
            planes.arrival(&Eye::Point(image), image, x, if hulls { &list } else { &[] })
        }
        Origin::Infinity(v) => {
            folds.into_iter().try_fold(v.value(), |w, f| f.behind(w)).map_or(fermat::Way::None, fermat::Way::Found)
        }
    }
}

/// The steps of light that arrives at x along w by the planes of some links, in its order; its points on them, the last one first; and the direction in which it starts. `None` where it misses a plane, or a face that it has to meet `within`.
pub fn steps(
    scene: &Scene,
    chains: &Chains,
    links: &[Link],
    (x, w): (DVec3, DVec3),
    within: bool,
) -> Option<(Vec<Step>, SmallVec<[DVec3; MOST]>, DVec3)> {
    let (mut p, mut w) = (x, w);
    let mut points: SmallVec<[DVec3; MOST]> = SmallVec::new();
    let mut steps = Vec::with_capacity(links.len());
    for link in links.iter().rev() {
        let (face, f) = (&chains.faces[link.face as usize], chains.fold(scene, link));
        let t = (p - f.p).dot(f.n) / w.dot(f.n);
        p -= w * t;
        if t.is_nan() || t <= 0.0 || within && !face.holds(p) {
            return None;
        }
        let back = Fold { index: [f.index[1], f.index[0]], ..f };
        let before = -back.behind(-w)?;
        if (before.dot(f.n) < 0.0) != link.front {
            return None;
        }
        steps.push(Step { shape: face.shape, face: face.face, p: f.p, n: f.n, before, behind: w, through: f.through });
        points.push(p);
        w = before;
    }
    steps.reverse();
    Some((steps, points, w))
}

/// The way of a light to x by some faces, and its points from the last one to the first; `None` where it misses a face. Searches that do not settle are counted.
pub fn way(
    scene: &Scene,
    chains: &Chains,
    (light, links): (u32, &[Link]),
    from: Origin<f64>,
    x: DVec3,
    unsettled: &mut u64,
) -> Option<(Way, SmallVec<[DVec3; MOST]>)> {
    let arrives = match arrival(scene, chains, links, from, x, true) {
        fermat::Way::Found(w) => w,
        fermat::Way::None => return None,
        fermat::Way::Lost => {
            *unsettled += 1;
            return None;
        }
    };
    let found = along(scene, chains, (light, links), from, (x, arrives))?;
    // Where the solution is one, the line ends at the light.
    if let (Origin::Position(q), Some(first)) = (from, found.0.steps.first()) {
        let p = found.1.last().copied().unwrap_or(x);
        let off = p - q.value();
        if (off - first.before * off.dot(first.before)).length() > MISS * ((x - p).length() + off.length()) {
            *unsettled += 1;
            return None;
        }
        if off.dot(first.before) <= 0.0 {
            return None;
        }
    }
    Some(found)
}

/// The same where it is known from where light arrives.
pub fn along(
    scene: &Scene,
    chains: &Chains,
    (light, links): (u32, &[Link]),
    from: Origin<f64>,
    (x, arrives): (DVec3, DVec3),
) -> Option<(Way, SmallVec<[DVec3; MOST]>)> {
    let (steps, points, before) = steps(scene, chains, links, (x, arrives), true)?;
    let folds: SmallVec<[Fold; MOST]> = links.iter().map(|l| chains.fold(scene, l)).collect();
    let gain = spread(&folds, from, before, x)?;
    let shares = steps.iter().fold(Rgb::ONE, |g, s| g * pane::share(scene, s));
    let gain = shares * gain;
    let way = Way { light, steps, w: arrives, gain, source: None };
    (!gain.is_zero() && gain.is_finite()).then_some((way, points))
}

/// Solid angle at the light (or area across its rays) over the area across the ray at x. `before`: the ray's direction at the light.
fn spread(folds: &[Fold], from: Origin<f64>, before: DVec3, x: DVec3) -> Option<f64> {
    let q = match from {
        Origin::Position(q) => q.value(),
        Origin::Infinity(_) => {
            // Planes widen parallel light by their cosines alone.
            let (mut w, mut area) = (before, 1.0);
            for f in folds {
                let next = f.behind(w)?;
                area *= (next.dot(f.n) / w.dot(f.n)).abs();
                w = next;
            }
            return Some(1.0 / area);
        }
    };
    let (a, b) = warp::frame(before);
    let off = V3::constant(a) * D2::variable(0.0, 0) + V3::constant(b) * D2::variable(0.0, 1);
    let (mut o, mut d): (V3<D2>, V3<D2>) = (V3::constant(q), (V3::constant(before) + off).normalize());
    for f in folds {
        let n = V3::constant(f.n);
        let c = n.dot(d);
        o = o + d * (n.dot(V3::constant(f.p) - o) / c);
        d = if f.through {
            let (c, side) = if c.v < 0.0 { (-c, n) } else { (c, -n) };
            Interface::new(c, D2::from(f.index[0]), D2::from(f.index[1])).refract(d, side)?.normalize()
        } else {
            d - n * (c * 2.0)
        };
    }
    let rest = V3::constant(x) - o;
    let across = d * rest.dot(d) - rest;
    let (u, v) = warp::frame(d.value());
    let (s, t) = (across.dot(V3::constant(u)), across.dot(V3::constant(v)));
    let area = (s.d[0] * t.d[1] - s.d[1] * t.d[0]).abs();
    (area > 0.0).then(|| 1.0 / area)
}

#[cfg(test)]
#[path = "chain_tests.rs"]
mod tests;
