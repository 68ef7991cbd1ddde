//! Crossings of straight lines with the sheets of many outlines: a hierarchy over directions from the source. There an edge is an arc, a line
//! is an arc too, and a sheet is crossed where arcs cross.

use super::outline::{Curve, Outlines, Source};
use super::sheet::{Grazed, Ray};
use crate::math::DVec3;
use crate::shape::Bounds;
use std::f64::consts::TAU;

/// Outlines in a leaf of the hierarchy.
const LEAF: usize = 4;

/// A box of the hierarchy.
pub struct Node {
    bounds: Bounds,
    /// Leaf: first and count in `order`; inner: the second child, 0 (the first one follows).
    a: u32,
    count: u32,
}

/// A crossing of a line with a sheet.
pub struct Crossing<'a> {
    /// Abscissae of the line and of the sheet's ray.
    pub t: f64,
    pub ray: Ray,
    pub rho: f64,
    pub grazed: Grazed<'a>,
}

impl Outlines {
    /// Hand every crossing of `o + t w`, t in (t0, t1), with a shadow sheet to `f`. Rims have none: they are only drawn outward.
    pub fn crossings<'a>(&'a self, o: DVec3, w: DVec3, t0: f64, t1: f64, mut f: impl FnMut(Crossing<'a>)) {
        let arc = self.arc(o, w, t0, t1);
        let mut stack = [0u32; 64];
        let mut top = usize::from(!self.nodes.is_empty());
        while top > 0 {
            top -= 1;
            let node = &self.nodes[stack[top] as usize];
            if !arc.meets(&node.bounds) {
                continue;
            }
            if node.count > 0 {
                for &i in &self.order[node.a as usize..(node.a + node.count) as usize] {
                    self.cross(i as usize, o, w, t0, t1, &mut f);
                }
            } else if top + 2 <= stack.len() {
                let first = stack[top] + 1;
                (stack[top], stack[top + 1]) = (first, node.a);
                top += 2;
            }
        }
        for &i in &self.order[self.held..] {
            self.cross(i as usize, o, w, t0, t1, &mut f);
        }
    }

    fn cross<'a>(&'a self, i: usize, o: DVec3, w: DVec3, t0: f64, t1: f64, f: &mut impl FnMut(Crossing<'a>)) {
        let (light, probability) = (self.light(), self.table.probability(i));
        let mut found = |t: f64, ray: Ray, rho: f64| {
            if t > t0 && t < t1 && rho > ray.near {
                let ray = Ray { across: ray.across * probability, ..ray };
                f(Crossing { t, ray, rho, grazed: self.grazed(i) });
            }
        };
        match (self.list[i].curve, self.source) {
            (Curve::Edge { a, b, n }, Source::Point(p)) => {
                // [T] (32)
                let t = n.dot(p - o) / n.dot(w);
                let u = o + w * t - p;
                let (a, b) = (a - p, b - p);
                let m = a.cross(b);
                let m2 = m.length_squared();
                let (alpha, beta) = (m.dot(u.cross(b)) / m2, m.dot(a.cross(u)) / m2);
                let lambda = alpha + beta;
                if t.is_finite() && alpha >= 0.0 && beta >= 0.0 && lambda > 1.0 {
                    let rho = u.length();
                    let angle = m.length().atan2(a.dot(b));
                    let (origin, w, near) = (p, u / rho, rho / lambda);
                    found(
                        t,
                        Ray {
                            light,
                            origin,
                            w,
                            near,
                            n,
                            across: 1.0 / angle,
                            distant: false,
                            crossed: true,
                            profile: false,
                            in_media: true,
                        },
                        rho,
                    );
                }
            }
            (Curve::Edge { a, b, n }, Source::Distant(d)) => {
                let t = n.dot(a - o) / n.dot(w);
                let u = o + w * t - a;
                let m = d.cross(b - a);
                let s = m.dot(d.cross(u)) / m.length_squared();
                if t.is_finite() && (0.0..=1.0).contains(&s) {
                    let origin = a + (b - a) * s;
                    let ray = Ray {
                        light,
                        origin,
                        w: d,
                        near: 0.0,
                        n,
                        across: 1.0 / m.length(),
                        distant: true,
                        crossed: true,
                        profile: false,
                        in_media: true,
                    };
                    found(t, ray, (u - (b - a) * s).dot(d));
                }
            }
            (Curve::Sphere { c, r }, Source::Point(p)) => {
                let axis = c - p;
                let k = axis.length_squared() - r * r;
                let (u0, wa) = (o - p, w.dot(axis));
                let ua = u0.dot(axis);
                let q = [wa * wa - k, 2.0 * (ua * wa - k * u0.dot(w)), ua * ua - k * u0.length_squared()];
                for t in quadratic(q) {
                    let u = u0 + w * t;
                    let along = u.dot(axis);
                    // The other nappe is no shadow.
                    if along > 0.0 {
                        let (rho, e) = (u.length(), p + u * (k / along));
                        let across = axis.length() / (TAU * r);
                        let (origin, w, n) = (p, u / rho, (e - c) / r);
                        found(
                            t,
                            Ray {
                                light,
                                origin,
                                w,
                                near: k.sqrt(),
                                n,
                                across,
                                distant: false,
                                crossed: true,
                                profile: false,
                                in_media: true,
                            },
                            rho,
                        );
                    }
                }
            }
            (Curve::Sphere { c, r }, Source::Distant(d)) => {
                let flat = |v: DVec3| v - d * v.dot(d);
                let (m0, mw) = (flat(o - c), flat(w));
                let q = [mw.length_squared(), 2.0 * m0.dot(mw), m0.length_squared() - r * r];
                for t in quadratic(q) {
                    let n = (m0 + mw * t) / r;
                    let ray = Ray {
                        light,
                        origin: c + n * r,
                        w: d,
                        near: 0.0,
                        n,
                        across: 1.0 / (TAU * r * self.list[i].part[1]),
                        distant: true,
                        crossed: true,
                        profile: false,
                        in_media: true,
                    };
                    found(t, ray, (o + w * t - c).dot(d));
                }
            }
            (Curve::Rim(_), _) => {}
        }
    }

    /// A point as the light sees it: a unit direction, or its place across a distant light's direction.
    fn view(&self, x: DVec3) -> DVec3 {
        match self.source {
            Source::Point(p) => (x - p).normalize(),
            Source::Distant(d) => x - d * x.dot(d),
        }
    }

    /// Bounds of an edge in the light's view; `None` where the hierarchy does not hold it.
    fn bounds(&self, i: usize) -> Option<Bounds> {
        let Curve::Edge { a, b, .. } = self.list[i].curve else { return None };
        let (a, b) = (self.view(a), self.view(b));
        Some(grow(Bounds::EMPTY.with_point(a).with_point(b), self.bulge(a, b)))
    }

    /// How far an arc may leave its chord.
    fn bulge(&self, a: DVec3, b: DVec3) -> f64 {
        match self.source {
            Source::Point(_) => {
                let chord = (a - b).length();
                // 1 - cos of half the angle, and rounding.
                1.0 - (1.0 - 0.25 * chord * chord).max(0.0).sqrt() + 1e-12
            }
            Source::Distant(_) => 1e-12 * a.abs().max(b.abs()).max_element(),
        }
    }

    fn arc(&self, o: DVec3, w: DVec3, t0: f64, t1: f64) -> Arc {
        let a = o + w * t0;
        match self.source {
            Source::Point(p) => {
                let u = self.view(a);
                let v = if t1 == f64::INFINITY { w } else { self.view(o + w * t1) };
                let opposite = u.dot(v) < 0.0;
                // More than a right angle: no useful box.
                let bounds = if opposite {
                    Bounds::new(DVec3::splat(-2.0), DVec3::splat(2.0))
                } else {
                    grow(Bounds::EMPTY.with_point(u).with_point(v), self.bulge(u, v))
                };
                Arc { bounds, n: (a - p).cross(w), offset: 0.0 }
            }
            Source::Distant(d) => {
                let (u, flat) = (self.view(a), w - d * w.dot(d));
                let bounds = if t1 == f64::INFINITY {
                    let far = |x: f64, s: f64| if s == 0.0 { x } else { f64::INFINITY * s };
                    Bounds::EMPTY.with_point(u).with_point(DVec3::new(
                        far(u.x, flat.x),
                        far(u.y, flat.y),
                        far(u.z, flat.z),
                    ))
                } else {
                    Bounds::EMPTY.with_point(u).with_point(self.view(o + w * t1))
                };
                let n = d.cross(flat);
                Arc { bounds: grow(bounds, 1e-12 * u.abs().max_element()), n, offset: n.dot(u) }
            }
        }
    }

    pub(super) fn build(&mut self) {
        let boxes: Vec<Option<Bounds>> = (0..self.list.len()).map(|i| self.bounds(i)).collect();
        let mut inside: Vec<(u32, Bounds)> =
            boxes.iter().enumerate().filter_map(|(i, b)| b.map(|b| (i as u32, b))).collect();
        self.order = Vec::with_capacity(self.list.len());
        if !inside.is_empty() {
            build(&mut self.nodes, &mut self.order, &mut inside);
        }
        self.held = self.order.len();
        self.order.extend((0..self.list.len() as u32).filter(|&i| boxes[i as usize].is_none()));
    }
}

/// Split at the median of the longest axis.
fn build(nodes: &mut Vec<Node>, order: &mut Vec<u32>, items: &mut [(u32, Bounds)]) {
    let bounds = items.iter().fold(Bounds::EMPTY, |b, i| b.union(&i.1));
    let me = nodes.len();
    nodes.push(Node { bounds, a: order.len() as u32, count: items.len() as u32 });
    if items.len() <= LEAF {
        order.extend(items.iter().map(|i| i.0));
        return;
    }
    let size = items.iter().fold(Bounds::EMPTY, |b, i| b.with_point(i.1.center())).size();
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let middle = items.len() / 2;
    items.select_nth_unstable_by(middle, |x, y| x.1.center()[axis].total_cmp(&y.1.center()[axis]));
    let (left, right) = items.split_at_mut(middle);
    build(nodes, order, left);
    let second = nodes.len() as u32;
    build(nodes, order, right);
    (nodes[me].a, nodes[me].count) = (second, 0);
}

fn grow(b: Bounds, by: f64) -> Bounds {
    Bounds::new(b.min - by, b.max + by)
}

/// A line in the light's view: its box, and the plane that it lies in.
struct Arc {
    bounds: Bounds,
    n: DVec3,
    offset: f64,
}

impl Arc {
    fn meets(&self, b: &Bounds) -> bool {
        if self.bounds.min.cmpgt(b.max).any() || self.bounds.max.cmplt(b.min).any() {
            return false;
        }
        let (center, half) = (b.center(), b.size() * 0.5);
        let reach = self.n.abs().dot(half);
        (self.n.dot(center) - self.offset).abs() <= reach * (1.0 + 1e-12) + 1e-14 * self.n.length()
    }
}

/// Real roots of `q0 t^2 + q1 t + q2`, without cancellation [T] 5.2.
pub(super) fn quadratic([a, b, c]: [f64; 3]) -> impl Iterator<Item = f64> {
    let disc = b * b - 4.0 * a * c;
    let q = -0.5 * (b + disc.max(0.0).sqrt().copysign(b));
    let roots = if disc > 0.0 { [q / a, c / q] } else { [f64::NAN; 2] };
    roots.into_iter().filter(|t| t.is_finite())
}
