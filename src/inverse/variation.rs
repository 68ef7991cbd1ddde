//! Total variation of a field on a lattice, smoothed at 0 so that it has a derivative everywhere (Rudin, Osher and Fatemi 1992):
//!
//! `V(x) = 1/n Σ_k (√(Σ_a d_ka² + ε²) - ε)`, `d_ka` the difference from node k to the next one along axis a in shares of the bounds' extent and per voxel (0 where there is
//! none), n the number of nodes and channels. It is the mean length of the field's gradient: the same for every lattice that holds the same smooth field.

/// Differences below this count as smooth.
const EPSILON: f64 = 1e-3;

/// Value and derivative by the numbers of the nodes (channels interleaved). `next`: of `Lattice::neighbours`.
pub fn total_variation(next: &[[u32; 3]], spacing: i32, channels: usize, x: &[f64]) -> (f64, Vec<f64>) {
    let (mut value, mut gradient) = (0.0, vec![0.0; x.len()]);
    let (scale, n) = (1.0 / f64::from(spacing), x.len().max(1) as f64);
    for (k, next) in next.iter().enumerate() {
        for c in 0..channels {
            let own = k * channels + c;
            let at = |m: u32| (m != u32::MAX).then(|| m as usize * channels + c);
            let d = next.map(|m| at(m).map_or(0.0, |m| (x[m] - x[own]) * scale));
            let length = (d.iter().map(|d| d * d).sum::<f64>() + EPSILON * EPSILON).sqrt();
            value += (length - EPSILON) / n;
            for (m, d) in next.iter().zip(d) {
                if let Some(m) = at(*m) {
                    let g = d * scale / length / n;
                    gradient[m] += g;
                    gradient[own] -= g;
                }
            }
        }
    }
    (value, gradient)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::inverse::lattice::Lattice;

    #[test]
    fn its_derivative_is_that_of_differences_and_a_ramp_has_its_slope() {
        let voxels: Vec<[i32; 3]> = (0..125).map(|i| [i / 25, i / 5 % 5, i % 5]).collect();
        let l = Lattice::new(&voxels, 1);
        let next = l.neighbours(&voxels, |_| false);
        let x: Vec<f64> = (0..250).map(|i| (f64::from(i) * 4.1).sin() * 0.1).collect();
        let (_, g) = total_variation(&next, 2, 2, &x);
        for k in [0, 31, 100, 249] {
            let at = |h: f64| {
                let mut y = x.clone();
                y[k] += h;
                total_variation(&next, 2, 2, &y).0
            };
            let d = (at(1e-6) - at(-1e-6)) / 2e-6;
            assert!((g[k] - d).abs() < 1e-8, "{k}: {} {d}", g[k]);
        }
        // Four of five planes have a next one.
        let ramp: Vec<f64> = voxels.iter().map(|p| 0.2 * f64::from(p[1])).collect();
        let (v, _) = total_variation(&next, 1, 1, &ramp);
        assert!((v - 0.2 * 0.8).abs() < 2e-3, "{v}");
        assert_eq!(total_variation(&next, 1, 1, &[0.4; 125]), (0.0, vec![0.0; 125]));
    }
}
