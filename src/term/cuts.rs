//! Lines in which flat faces pass through each other: where they move alike, creases of the picture that no file lists.
//!
//! Faces are compared in pairs: both planes meet in a line, clipped by both polygons. Where it runs inside of both, each goes on beyond the other. Where it runs
//! along the border of one, that is an edge of its shape, which passes through the other if its sides lie on either side of it (a wall through a floor right over a seam); if
//! not, it stands there. Lines that lie in one another (three sheets through one axis) are cut into pieces of which each has all faces that meet there.

use super::edge_set::{EdgeSet, SharedEdge};
use super::{Motion, contact, ends};
use crate::math::DVec3;
use crate::math::nearest::to_segment;
use crate::scene::Scene;
use crate::shape::edges::{Edge, FLAT, Side, border, is_flat, with_corners};
use crate::shape::{Geometry, Shape};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Deref;

/// A face: shape and number.
type Face = (u32, u32);

/// Faces that are all compared with what is near them: of the shapes that have the fewest.
const FACES: usize = 200_000;
/// Of [`ends::contact`]: what is nearer than this is in one place.
const CONTACTS: f64 = 2.0;
/// Rounding of a line in two planes, in scene radii, over the sine of their angle.
const ROUNDING: f64 = 1e-14;
/// What faces have in common beside a vertex of both must be longer than this, in scene radii: it may have been welded.
const WELDED: f64 = 1e-6;
/// Balls that look for what is near a face are no larger than this, in scene radii, but for faces that need more than `CELLS` in one direction.
const BALL: f64 = 1.0 / 64.0;
const CELLS: f64 = 64.0;

/// What two faces have in common.
#[derive(Clone, Copy, Debug)]
pub struct Meeting {
    faces: [Face; 2],
    ends: [DVec3; 2],
    /// Whether that is a part of the first face's border, which the second goes on beyond.
    on_border: bool,
    /// Whether the faces reach further through each other than bodies that stand on each other may, by rounding.
    deep: bool,
}

/// How flat faces pass through each other.
#[derive(Clone, Debug, Default)]
pub struct Cuts {
    /// Pairs of shapes, or twice the same, that pass through each other by more than rounding.
    pub pairs: Vec<(u32, u32)>,
    /// In faces that move alike: pieces of lines, with all faces that they are in.
    lines: Vec<Line>,
    /// Edges of the set of which there are pieces among the lines.
    pub replaced: Vec<usize>,
}

/// A straight line with faces that end or go on there.
#[derive(Clone, Debug)]
struct Line {
    ends: [DVec3; 2],
    sides: Vec<(Face, Extent)>,
}

/// How a face lies at a line.
#[derive(Clone, Copy, Debug)]
enum Extent {
    /// On both sides.
    Across,
    /// On the side of this corner.
    Toward(DVec3),
}

/// The shapes all of whose faces are compared with what is near them; of others it depends on what rays along their edges meet ([`super::crossings`]).
pub fn compared(scene: &Scene) -> Vec<bool> {
    let counts = |&i: &usize| !scene.is_null(&scene.shapes[i]) && is_flat(&scene.shapes[i].shape);
    let mut order: Vec<usize> = (0..scene.shapes.len()).filter(counts).collect();
    let faces = |i: usize| scene.shapes[i].shape.face_count() as usize;
    order.sort_by_key(|&i| faces(i));
    let mut all = vec![false; scene.shapes.len()];
    let mut left = FACES;
    for i in order {
        let Some(rest) = left.checked_sub(faces(i)) else { break };
        (all[i], left) = (true, rest);
    }
    all
}

/// Whether the curve in which two shapes meet is made of lines that move as both do.
pub fn are_straight(scene: &Scene, motion: &Motion, [a, b]: [u32; 2]) -> bool {
    let flat = |k: u32| is_flat(&scene.shapes[k as usize].shape) && !motion.moving.bends(k);
    flat(a) && flat(b) && motion.class(a) == motion.class(b)
}

impl Cuts {
    /// Of the shapes that `of` names with all that are opaque.
    pub fn find(scene: &Scene, motion: &Motion, edges: &EdgeSet, of: &[bool]) -> Cuts {
        let faces = |i: usize| (0..scene.shapes[i].shape.face_count()).map(move |f| (i as u32, f));
        let asked: Vec<Face> = (0..of.len()).filter(|&i| of[i]).flat_map(faces).collect();
        let beside = |&face: &Face| faces_beside(scene, face, of).into_iter().filter_map(|f| meeting(scene, f));
        let all: Vec<Meeting> = asked.par_iter().flat_map_iter(beside).collect();
        let (on_borders, met): (Vec<_>, Vec<_>) = all.into_iter().partition(|m| m.on_border);
        let pair = |a: u32, b: u32| (a.min(b), a.max(b));
        let mut pairs: Vec<_> = met.iter().filter(|m| m.deep).map(|m| pair(m.faces[0].0, m.faces[1].0)).collect();
        let straight = |m: &Meeting| are_straight(scene, motion, m.faces.map(|f| f.0));
        let across = |f: Face| (f, Extent::Across);
        let mut lines: Vec<Line> = Vec::new();
        lines.extend(
            met.iter().filter(|m| straight(m)).map(|m| Line { ends: m.ends, sides: m.faces.map(across).to_vec() }),
        );
        let mut replaced = Vec::new();
        for (i, m) in through_edges(scene, edges, &on_borders) {
            if m.deep {
                pairs.extend(edges.get(scene, i).faces.iter().map(|f| pair(f.0, m.faces[1].0)));
            }
            if straight(&m) {
                replaced.push(i);
                lines.push(Line { ends: m.ends, sides: vec![across(m.faces[1])] });
            }
        }
        replaced.dedup();
        lines.extend(replaced.iter().map(|&i| {
            let e = edges.get(scene, i);
            let sides = e.sides().map(|(s, f, corner)| ((s, f), Extent::Toward(corner))).collect();
            Line { ends: [e.edge.a, e.edge.b], sides }
        }));
        pairs.sort_unstable();
        pairs.dedup();
        Cuts { pairs, lines: pieces(scene, lines), replaced }
    }

    /// Whether no lines are known.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }

    /// The edges that the lines are: those in which no face goes on, and the others.
    pub fn edges(&self, scene: &Scene) -> [Vec<SharedEdge>; 2] {
        let (cuts, plain): (Vec<_>, Vec<_>) = self.lines.iter().partition(|l| l.across().next().is_some());
        [plain, cuts].map(|lines| lines.into_iter().map(|l| l.edge(scene)).collect())
    }

    /// Lines across faces.
    pub fn borders(&self) -> impl Iterator<Item = (Face, [DVec3; 2])> + '_ {
        self.lines.iter().flat_map(|l| l.across().map(|face| (face, l.ends)))
    }
}

/// The corners of a flat face that has an area.
#[derive(Clone, Copy)]
struct Polygon {
    corners: [DVec3; 4],
    len: usize,
}

impl Polygon {
    fn new(scene: &Scene, (s, f): Face) -> Option<Polygon> {
        match &scene.shapes[s as usize].shape {
            Shape::Mesh(m) if m.is_degenerate(f) => None,
            shape => with_corners(shape, f, |p| {
                let mut corners = [p[0]; 4];
                corners[..p.len()].copy_from_slice(p);
                Polygon { corners, len: p.len() }
            }),
        }
    }

    fn normal(&self) -> DVec3 {
        (self[1] - self[0]).cross(self[2] - self[0]).normalize()
    }

    fn size(&self) -> f64 {
        let c = self.iter().sum::<DVec3>() / self.len as f64;
        self.iter().map(|p| p.distance(c)).fold(0.0, f64::max)
    }

    /// Balls, of radius `radius` if these are not too many, in which the face lies.
    fn balls(&self, radius: f64) -> impl Iterator<Item = (DVec3, f64)> + use<> {
        let (o, u) = (self[0], (self[1] - self[0]).normalize());
        let v = self.normal().cross(u);
        let range = |axis: DVec3| {
            let along = self.iter().map(|p| axis.dot(*p - o));
            let (lo, hi) = along.fold((0.0, 0.0), |(lo, hi): (f64, f64), x| (lo.min(x), hi.max(x)));
            let cells = ((hi - lo) / radius).ceil().clamp(1.0, CELLS);
            (lo, (hi - lo) / cells, cells as u32)
        };
        let ((u0, du, nu), (v0, dv, nv)) = (range(u), range(v));
        let at = move |lo: f64, step: f64, k: u32| lo + (f64::from(k) + 0.5) * step;
        let cell = move |i: u32, j: u32| (o + u * at(u0, du, i) + v * at(v0, dv, j), 0.5 * du.hypot(dv));
        (0..nu).flat_map(move |i| (0..nv).map(move |j| cell(i, j)))
    }

    /// Least and largest of the heights of the corners over a plane.
    fn heights(&self, o: DVec3, n: DVec3) -> [f64; 2] {
        let heights = self.iter().map(|p| n.dot(*p - o));
        heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[lo, hi], h| [lo.min(h), hi.max(h)])
    }
}

impl Deref for Polygon {
    type Target = [DVec3];

    fn deref(&self) -> &[DVec3] {
        &self.corners[..self.len]
    }
}

/// Pairs of a face with others that may meet it, and do not ask themselves.
fn faces_beside(scene: &Scene, face: Face, of: &[bool]) -> Vec<[Face; 2]> {
    let Some(own) = Polygon::new(scene, face) else { return Vec::new() };
    let size = own.size();
    // Of two that are both asked, the smaller one asks.
    let asks = |other: Face| {
        let smaller = |p: Polygon| (size, face) < (p.size(), other);
        !of[other.0 as usize] || Polygon::new(scene, other).is_some_and(smaller)
    };
    let contact = ends::contact(scene);
    let mut pairs = Vec::new();
    for (c, r) in own.balls(BALL * scene.bounds.radius()) {
        let near = scene.opaque.faces_within(&scene.shapes, c, r + contact);
        let others = near.into_iter().map(|n| (n.shape, n.face)).filter(|&f| f != face && asks(f));
        pairs.extend(others.map(|other| [face.min(other), face.max(other)]));
    }
    pairs.sort_unstable();
    pairs.dedup();
    pairs
}

/// How many vertices two faces of one mesh share.
fn shared_vertices(scene: &Scene, [a, b]: [Face; 2]) -> usize {
    match &scene.shapes[a.0 as usize].shape {
        Shape::Mesh(m) if a.0 == b.0 => {
            let of = |f: Face| m.faces[f.1 as usize].map(|v| m.topology().weld[v as usize]);
            of(a).iter().filter(|v| of(b).contains(v)).count()
        }
        _ => 0,
    }
}

/// What two faces have in common, if one goes on there.
fn meeting(scene: &Scene, faces: [Face; 2]) -> Option<Meeting> {
    let polygons = [Polygon::new(scene, faces[0])?, Polygon::new(scene, faces[1])?];
    let contact = CONTACTS * ends::contact(scene);
    let [p, q] = &polygons;
    let apart = |axis: usize| {
        let range = |p: &Polygon| {
            p.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[l, h], x| [l.min(x[axis]), h.max(x[axis])])
        };
        let ([p0, p1], [q0, q1]) = (range(p), range(q));
        p0 > q1 + contact || q0 > p1 + contact
    };
    if (0..3).any(apart) {
        return None;
    }
    let normals = [p.normal(), q.normal()];
    let heights = [p.heights(q[0], normals[1]), q.heights(p[0], normals[0])];
    if heights.iter().any(|[lo, hi]| *lo > contact || *hi < -contact) {
        return None;
    }
    let d = normals[0].cross(normals[1]);
    let sin = d.length();
    if sin.is_nan() || sin <= FLAT {
        return None;
    }
    let d = d / sin;
    let radius = scene.bounds.radius();
    let least = match shared_vertices(scene, faces) {
        0 => contact + ROUNDING * radius / sin,
        1 => WELDED * radius,
        _ => return None,
    };
    // Faces of one edge have nothing else in common.
    let same = |[a, b]: [DVec3; 2], [c, d]: [DVec3; 2]| a.distance(c) <= least && b.distance(d) <= least;
    if border(p).any(|e| border(q).any(|g| same(e, g) || same(e, [g[1], g[0]]))) {
        return None;
    }
    // The point of both planes next to a corner of the first face.
    let o = p[0] + normals[0].cross(d) * (normals[1].dot(q[0] - p[0]) / normals[1].dot(normals[0].cross(d)));
    let (mut t0, mut t1) = (f64::NEG_INFINITY, f64::INFINITY);
    for (polygon, n) in polygons.iter().zip(normals) {
        let [s0, s1] = clip(polygon, n, o, d, least)?;
        (t0, t1) = (t0.max(s0), t1.min(s1));
    }
    if t1 - t0 <= least {
        return None;
    }
    let ends = [o + d * t0, o + d * t1];
    let middle = 0.5 * (ends[0] + ends[1]);
    let off =
        polygons.each_ref().map(|p| border(p).map(|[a, b]| to_segment(middle, a, b)).fold(f64::INFINITY, f64::min));
    let depth = contact::reach(scene);
    let through = || heights.iter().all(|[lo, hi]| *lo < -depth && *hi > depth);
    match off.map(|off| off <= least) {
        [true, true] => None,
        [false, false] => {
            let deep = off.iter().all(|off| *off > depth) && through();
            Some(Meeting { faces, ends, on_border: false, deep })
        }
        [first, _] => {
            let k = usize::from(first);
            Some(Meeting { faces: [faces[1 - k], faces[k]], ends, on_border: true, deep: off[k] > depth })
        }
    }
}

/// The part of the line o + t d, in the plane of a convex polygon, that is no further outside of it than `slack`.
fn clip(polygon: &[DVec3], n: DVec3, o: DVec3, d: DVec3, slack: f64) -> Option<[f64; 2]> {
    let (mut t0, mut t1) = (f64::NEG_INFINITY, f64::INFINITY);
    for [a, b] in border(polygon) {
        let inward = n.cross(b - a).normalize();
        let (height, slope) = (inward.dot(o - a), inward.dot(d));
        // Along a border it is clipped by the others.
        match slope {
            _ if slope.abs() <= FLAT && height.abs() <= slack => {}
            s if s > 0.0 => t0 = t0.max(-height / s),
            s if s < 0.0 => t1 = t1.min(-height / s),
            _ if height < 0.0 => return None,
            _ => {}
        }
    }
    (t0 < t1).then_some([t0, t1])
}

/// Edges, in order, with what they have in common with faces in which they lie: where their sides are on either side of one, or where two such faces pass through each other.
fn through_edges(scene: &Scene, edges: &EdgeSet, on_borders: &[Meeting]) -> Vec<(usize, Meeting)> {
    if on_borders.is_empty() {
        return Vec::new();
    }
    let slack = 2.0 * CONTACTS * ends::contact(scene);
    let mut by_face: HashMap<Face, Vec<&Meeting>> = HashMap::new();
    on_borders.iter().for_each(|m| by_face.entry(m.faces[0]).or_default().push(m));
    let normal = |m: &Meeting| {
        let (shape, face) = m.faces[1];
        scene.shapes[shape as usize].shape.normal(face, m.ends[0])
    };
    let of_edge = |i: usize| {
        let e = edges.get(scene, i);
        let through = |m: &Meeting, depth: f64| {
            let n = normal(m);
            let heights = || e.sides().map(|s| n.dot(s.2 - m.ends[0]));
            heights().any(|h| h > depth) && heights().any(|h| h < -depth)
        };
        let mut met: Vec<Meeting> = Vec::new();
        for m in e.sides().filter_map(|(s, f, _)| by_face.get(&(s, f))).flatten() {
            let lies_in = |p: &DVec3| to_segment(*p, e.edge.a, e.edge.b) <= slack;
            if m.ends.iter().all(lies_in) && met.iter().all(|other| other.faces[1] != m.faces[1]) {
                met.push(**m);
            }
        }
        let other = |m: &Meeting| met.iter().any(|k| normal(k).cross(normal(m)).length() > FLAT);
        let counts = met.iter().any(|m| through(m, slack) || other(m));
        let depth = contact::reach(scene);
        let kept: Vec<(usize, Meeting)> =
            met.iter().map(|m| (i, Meeting { deep: m.deep && through(m, depth), ..*m })).collect();
        if counts { kept } else { Vec::new() }
    };
    let concerned = |&i: &usize| edges.any_face(i, |face| by_face.contains_key(&face));
    (0..edges.len()).into_par_iter().filter(concerned).flat_map_iter(of_edge).collect()
}

/// Lines without those that lie in others: pieces, each with all faces that are there.
fn pieces(scene: &Scene, lines: Vec<Line>) -> Vec<Line> {
    let slack = 2.0 * CONTACTS * ends::contact(scene);
    let centre = scene.bounds.center();
    let mut by_distance: Vec<(f64, Line)> = lines.into_iter().map(|l| (l.off(centre).length(), l)).collect();
    by_distance.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut groups: Vec<(f64, Vec<Line>)> = Vec::new();
    for (distance, line) in by_distance {
        let mut near = groups.iter_mut().rev().take_while(|g| distance - g.0 <= slack);
        match near.find(|g| g.1.iter().all(|l| l.is_on(&line, slack))) {
            Some(group) => group.1.push(line),
            None => groups.push((distance, vec![line])),
        }
    }
    groups.into_iter().flat_map(|(_, group)| split(group, slack)).collect()
}

/// The pieces of lines that lie in one.
fn split(mut group: Vec<Line>, slack: f64) -> Vec<Line> {
    if group.len() < 2 {
        return group;
    }
    let longest = group.iter().max_by(|a, b| a.length().total_cmp(&b.length())).expect("two at least");
    let (o, d) = (longest.ends[0], longest.direction());
    let range = |l: &Line| {
        let [s, t] = l.ends.map(|p| d.dot(p - o));
        [s.min(t), s.max(t)]
    };
    group.sort_by(|a, b| range(a)[0].total_cmp(&range(b)[0]));
    let mut places: Vec<f64> = group.iter().flat_map(range).collect();
    places.sort_by(f64::total_cmp);
    places.dedup_by(|next, kept| *next - *kept <= slack);
    let (mut next, mut there, mut pieces): (usize, Vec<&Line>, Vec<Line>) = (0, Vec::new(), Vec::new());
    for w in places.windows(2) {
        let middle = 0.5 * (w[0] + w[1]);
        while next < group.len() && range(&group[next])[0] < middle {
            there.push(&group[next]);
            next += 1;
        }
        there.retain(|l| range(l)[1] > middle);
        let mut sides: Vec<(Face, Extent)> = there.iter().flat_map(|l| l.sides.iter().copied()).collect();
        // Of one face twice, that it goes on comes first.
        sides.sort_by_key(|(face, extent)| (*face, matches!(extent, Extent::Toward(_))));
        sides.dedup_by_key(|s| s.0);
        if !sides.is_empty() {
            pieces.push(Line { ends: [o + d * w[0], o + d * w[1]], sides });
        }
    }
    pieces
}

impl Line {
    fn length(&self) -> f64 {
        (self.ends[1] - self.ends[0]).length()
    }

    fn direction(&self) -> DVec3 {
        (self.ends[1] - self.ends[0]).normalize()
    }

    /// From where the line, without its ends, is nearest to p.
    fn off(&self, p: DVec3) -> DVec3 {
        let (to, d) = (p - self.ends[0], self.direction());
        to - d * to.dot(d)
    }

    fn is_on(&self, other: &Line, slack: f64) -> bool {
        let [short, long] = if self.length() < other.length() { [self, other] } else { [other, self] };
        short.ends.iter().all(|p| long.off(*p).length() <= slack)
    }

    fn across(&self) -> impl Iterator<Item = Face> + '_ {
        self.sides.iter().filter(|s| matches!(s.1, Extent::Across)).map(|s| s.0)
    }

    fn edge(&self, scene: &Scene) -> SharedEdge {
        let [a, b] = self.ends;
        let (along, middle) = (b - a, 0.5 * (a + b));
        let mut sides = Vec::new();
        let mut faces: Vec<(u32, Vec<u32>)> = Vec::new();
        // In the order of shapes.
        for ((shape, face), extent) in &self.sides {
            let off = scene.shapes[*shape as usize].shape.normal(*face, middle).cross(along);
            let corners = match extent {
                Extent::Across => vec![middle + off, middle - off],
                Extent::Toward(corner) => vec![*corner],
            };
            if faces.last().is_none_or(|f| f.0 != *shape) {
                faces.push((*shape, Vec::new()));
            }
            let named = &mut faces.last_mut().expect("one is there").1;
            named.extend(corners.iter().map(|_| *face));
            sides.extend(corners.into_iter().map(|corner| Side { face: *face, corner }));
        }
        SharedEdge { edge: Edge { a, b, sides }, faces }
    }
}
