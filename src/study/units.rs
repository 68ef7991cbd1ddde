//! Pieces by themselves: samplers at the ends of their range, sums of many samples.

use super::measure::{Subject, film};
use super::reference::Known;
use super::stress::{Bench, Check};
use crate::error::Result;
use crate::math::rng::exponential_from;
use crate::math::{DAffine3, DVec3, Rgb, warp};
use crate::phase::{Phase, hg};
use crate::render::film::{Film, FilmSpec};
use crate::shape::{Cylinder, Disk, Geometry, Rectangle, Shape, Sphere};

/// The smallest and the largest value of a 53-bit uniform number, and two between.
const ENDS: [f64; 4] = [0.0, 1.0 / 9_007_199_254_740_992.0, 0.5, 1.0 - f64::EPSILON / 2.0];
const GS: [f64; 10] = [-0.9999, -0.99, -0.5, -1e-8, 0.0, 1e-8, 1e-4, 0.5, 0.99, 0.9999];

fn verdict(bad: Vec<String>, checked: usize) -> std::result::Result<String, String> {
    if bad.is_empty() { Ok(format!("{checked} checked")) } else { Err(bad[..bad.len().min(3)].join("; ")) }
}

fn unit(w: DVec3) -> bool {
    (w.length() - 1.0).abs() <= 4.0 * f64::EPSILON
}

pub fn rng_endpoints(b: &mut Bench) -> Result<()> {
    // Distances.
    let bad = ENDS.iter().map(|&u| exponential_from(u)).filter(|t| !(t.is_finite() && *t > 0.0));
    let seen = verdict(bad.map(|t| format!("free flight of {t}")).collect(), ENDS.len());
    b.policy("free flight", seen);

    // Directions.
    let (mut bad, mut n) = (Vec::new(), 0);
    let axes = [DVec3::Z, -DVec3::Z, DVec3::new(0.6, 0.0, -0.8), DVec3::new(1e-9, 0.0, -1.0).normalize()];
    for u in ENDS {
        for v in ENDS {
            for w in [warp::sphere(u, v), warp::cosine_hemisphere(u, v), warp::uniform_hemisphere(u, v)] {
                n += 1;
                if !unit(w) {
                    bad.push(format!("warp({u:e}, {v:e}) = {w}"));
                }
            }
            for axis in axes {
                for phase in GS.map(|g| Phase::Hg { g }).into_iter().chain([Phase::Isotropic]) {
                    let (w, m) = phase.sample(axis, u, v);
                    let f = phase.eval(m);
                    n += 1;
                    if !unit(w) || !(0.0..=2.0).contains(&m) || !f.is_finite() || f <= 0.0 {
                        bad.push(format!("{phase:?} at ({u:e}, {v:e}): {w}, 1-mu {m:e}, density {f:e}"));
                    }
                }
            }
        }
    }
    b.policy("directions", verdict(bad, n));

    // Points on shapes.
    let place = DAffine3::from_scale(DVec3::new(2.0, 3.0, 0.5));
    let mut shapes = vec![];
    shapes.extend(Rectangle::new(place, false).ok().map(Shape::Rectangle));
    shapes.extend(Disk::new(place, false).ok().map(Shape::Disk));
    shapes.extend(Sphere::new(DVec3::ZERO, 2.0, DAffine3::IDENTITY, false).ok().map(Shape::Sphere));
    let long = DAffine3::from_scale(DVec3::new(2.0, 2.0, 0.5));
    shapes.extend(Cylinder::new(long, false).ok().map(Shape::Cylinder));
    let (mut bad, mut n) = (Vec::new(), 0);
    for s in &shapes {
        for u in ENDS {
            for v in ENDS {
                let p = s.sample(u, v);
                n += 1;
                if !(p.p.is_finite() && unit(p.n) && p.pdf_area > 0.0 && p.pdf_area.is_finite()) {
                    bad.push(format!("{p:?} at ({u:e}, {v:e})"));
                }
                // From outside, from just above, from far away.
                if let Shape::Sphere(ball) = s {
                    for from in [DVec3::new(0.0, 0.0, 5.0), DVec3::new(0.0, 0.0, 2.0 + 1e-9), DVec3::new(1e9, 0.0, 0.0)]
                    {
                        let Some(d) = ball.sample_direction(from, u, v) else { continue };
                        n += 1;
                        if !(unit(d.w) && d.pdf_solid_angle > 0.0 && d.distance.is_finite()) {
                            bad.push(format!("{d:?} at ({u:e}, {v:e}) from {from}"));
                        }
                    }
                }
            }
        }
    }
    b.policy("points", verdict(bad, n));

    // The mean cosine is g: strata of the inverse.
    for g in [1e-8, 1e-4, -0.99, 0.999] {
        let n = 1_000_000;
        let mean = (0..n).map(|i| 1.0 - hg::sample(g, (i as f64 + 0.5) / n as f64).0).sum::<f64>() / n as f64;
        b.exact(&format!("mean cosine {g}"), mean, g, 1e-6, "stratified");
    }
    Ok(())
}

/// Many samples in one pixel: no sum saturates, no digit is lost.
pub fn film_accumulation(b: &mut Bench) -> Result<()> {
    let samples: u64 = if b.effort >= 1.0 { 1 << 26 } else { 1 << 22 };
    let batches = 32;
    let run = |value: &dyn Fn(u64) -> f64, typical: f64| -> Result<(f64, u64)> {
        let quantum = vec![FilmSpec::quantum_for(typical)];
        let mut film = Film::new(FilmSpec { width: 1, height: 1, layers: vec!["".into()], quantum });
        for k in 0..batches {
            for i in 0..samples / batches {
                film.add(0, 0, Rgb::splat(value(k * samples / batches + i)));
            }
            film.end_batch(k, samples / batches)?;
        }
        Ok((film.mean(0, 0)[0], u64::from(film.rejected(0))))
    };
    let (ones, rejected) = run(&|_| 1.0, 1.0)?;
    b.exact("ones", ones, 1.0, 1e-6, &format!("{samples} samples, {rejected} rejected"));
    let (spiked, rejected) = run(&|i| if i == 12345 { 1e6 } else { 1e-3 }, 1e-3)?;
    let truth = 1e-3 + (1e6 - 1e-3) / samples as f64;
    b.exact("1e-3 and one 1e6", spiked, truth, 1e-6 * truth, &format!("{samples} samples, {rejected} rejected"));
    bright_beside_dim(b)
}

/// A lamp of radiance 1 on a part of the film that a pilot easily misses, before a sky of 1e-30: no sample may be too large.
fn bright_beside_dim(b: &mut Bench) -> Result<()> {
    let half = 0.02;
    let text = format!(
        r#"<scene version="3.0.0"><integrator type="path"/>
        <shape type="rectangle"><transform name="to_world"><scale value="{half}"/><rotate y="1" angle="180"/><translate z="1"/></transform>
          <emitter type="area"><rgb name="radiance" value="1"/></emitter></shape>
        <emitter type="constant"><rgb name="radiance" value="1e-30"/></emitter>
        <sensor type="orthographic">{}</sensor></scene>"#,
        film()
    );
    let m = b.measure(&Subject::new(&text, &[])?, &[vec![1.0]], 1 << 19)?;
    // The film is 2 by 1.
    b.judge("1 beside 1e-30", &m, 0, Check::new(Known::exact(2.0 * half * half), 1e-4));
    Ok(())
}
