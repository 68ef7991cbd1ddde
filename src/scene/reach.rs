//! Which pencils reach a point: a box divided into eight parts, again and again, where anything is asked for. Each part knows the pencils that reach the ball around it, so that a question goes down to a short list.
//! What a part knows does not depend on who asks first. Pencils that are asked for now and then are in the order of how often, so that those between two of them cost nothing.

use crate::math::DVec3;
use crate::math::pencil::Pencil;
use crate::shape::Bounds;
use std::sync::OnceLock;

/// Parts that so few pencils reach are not divided, nor smaller ones than so much of the pencils' mean radius.
const FEW: usize = 16;
const FINE: f64 = 0.5;
const DEEP: u32 = 8;
/// Nor those whose parts would know as much, on average.
const SHORTER: f64 = 0.7;
/// The box, over the radius of the scene.
const BOX: f64 = 4.0;

#[derive(Debug, Default)]
struct Part {
    reached_by: Vec<u32>,
    /// None where that brings nothing.
    parts: OnceLock<Option<Box<[Part; 8]>>>,
}

/// Pencils, and where they go.
#[derive(Debug, Default)]
pub struct Reach {
    pencils: Vec<Pencil>,
    /// How often each is asked for.
    asked: Vec<f64>,
    center: DVec3,
    half: f64,
    fine: f64,
    root: Part,
}

impl Reach {
    pub fn new(pencils: Vec<Pencil>, asked: Vec<f64>, scene: &Bounds) -> Self {
        let (center, half) = (scene.center(), BOX * scene.radius());
        let fine = FINE * pencils.iter().map(|p| p.radius).sum::<f64>() / pencils.len().max(1) as f64;
        let mut all: Vec<u32> = (0..pencils.len() as u32).collect();
        all.sort_by(|&a, &b| asked[b as usize].total_cmp(&asked[a as usize]));
        let root = Part { reached_by: all, parts: OnceLock::new() };
        Reach { pencils, asked, center, half, fine, root }
    }

    /// Pencils that reach x, each with the probability with which it is asked for, and their numbers.
    pub fn draw(&self, x: DVec3, mut uniform: impl FnMut() -> f64, mut found: impl FnMut(u32, &Pencil)) {
        let list = &self.near(x).reached_by;
        let mut visit = |k: usize| {
            let (i, p) = (list[k], &self.pencils[list[k] as usize]);
            if p.reaches(x, 0.0) {
                found(i, p);
            }
        };
        let mut first = 0;
        while let Some(&i) = list.get(first) {
            let q = self.asked[i as usize];
            let end = first + list[first..].partition_point(|&k| self.asked[k as usize] >= q);
            if q >= 1.0 {
                (first..end).for_each(&mut visit);
            } else {
                // So many are passed over, geometrically distributed.
                let rate = (-q).ln_1p();
                let mut skip = || ((-uniform()).ln_1p() / rate).min(1e9) as usize;
                let mut k = first + skip();
                while k < end {
                    visit(k);
                    k += 1 + skip();
                }
            }
            first = end;
        }
    }

    /// The smallest part around x that is known.
    fn near(&self, x: DVec3) -> &Part {
        let (mut at, mut center, mut half) = (&self.root, self.center, self.half);
        // Outside nothing is known beforehand.
        let mut left = if (x - center).abs().max_element() > half { 0 } else { DEEP };
        while left > 0 && at.reached_by.len() > FEW && half > self.fine {
            let side = |k: usize, axis: usize| if k >> axis & 1 == 0 { -0.5 * half } else { 0.5 * half };
            let offset = |k: usize| DVec3::new(side(k, 0), side(k, 1), side(k, 2));
            let parts = at.parts.get_or_init(|| {
                let parts: [Part; 8] = std::array::from_fn(|k| {
                    let (c, r) = (center + offset(k), 0.5 * half * 3f64.sqrt());
                    let reaches = |i: &u32| self.pencils[*i as usize].reaches(c, r);
                    Part { reached_by: at.reached_by.iter().copied().filter(reaches).collect(), parts: OnceLock::new() }
                });
                let known = parts.iter().map(|p| p.reached_by.len()).sum::<usize>() as f64;
                (known < SHORTER * 8.0 * at.reached_by.len() as f64).then(|| Box::new(parts))
            });
            let Some(parts) = parts else { break };
            let k = (0..3).map(|axis| usize::from(x[axis] > center[axis]) << axis).sum();
            (at, center, half, left) = (&parts[k], center + offset(k), 0.5 * half, left - 1);
        }
        at
    }
}
