//! Radiance of a black body as linear RGB, and how it changes with temperature.
//!
//! `X = ∫ B_λ(T) x̄(λ) dλ` and so on with Planck's law, summed over the CIE 1931 2° colour matching functions at 5 nm (CIE 15), then
//! taken to linear Rec. 709 by the usual matrix. Nothing is normalised: Y is in W / (m² sr) (luminance / 683 lm/W), so that 1500 K gives
//! 11, 2856 K 2.9e4 and 6500 K 4.5e6; whoever uses it scales it to the scene's units.
//!
//! Colours below about 1900 K lie outside of Rec. 709: blue would be negative (at most 9 % of Y), below 960 K green too. Light is not
//! negative, so channels end at 0, by a parabola over `[-SOFT, SOFT]` Y: exact above, continuous slope everywhere, off by at most `SOFT / 4` Y.
//!
//! [`radiance`] reads a table over ln T: ln Y and the channels' shares of Y by cubic Hermite pieces, whose own derivative is the one
//! returned, so that both belong together to rounding. Against the sum: 1e-7 relative from 200 K to 1e7 K (a test). Below it goes on by
//! Wien's law, above by the power of T that the last node has (Rayleigh-Jeans): no temperature has a jump.

use super::Rgb;
use std::sync::LazyLock;

/// `2 h c²` and `h c / k` (SI 2019), W m² / sr and K m.
const FIRST: f64 = 2.0 * 6.626_070_15e-34 * 299_792_458.0 * 299_792_458.0;
const SECOND: f64 = 6.626_070_15e-34 * 299_792_458.0 / 1.380_649e-23;

/// Where channels leave their own course for 0, in shares of Y.
const SOFT: f64 = 0.01;

/// Ends of the table, kelvin, and its pieces.
const COLD: f64 = 200.0;
const HOT: f64 = 1e7;
const PIECES: usize = 512;

/// Linear Rec. 709 from XYZ.
const RGB_FROM_XYZ: [[f64; 3]; 3] =
    [[3.240479, -1.537150, -0.498535], [-0.969256, 1.875991, 0.041556], [0.055648, -0.204043, 1.057311]];

/// ln Y and the shares of Y of red, green and blue, before they are kept from being negative; each with its derivative by ln T.
#[derive(Clone, Copy, Debug)]
struct Node {
    value: [f64; 4],
    slope: [f64; 4],
}

static TABLE: LazyLock<Vec<Node>> =
    LazyLock::new(|| (0..=PIECES).map(|i| summed(COLD * (i as f64 * step()).exp())).collect());

/// Of the table, in ln T.
fn step() -> f64 {
    (HOT / COLD).ln() / PIECES as f64
}

/// The sum over wavelengths.
fn summed(kelvin: f64) -> Node {
    let (mut xyz, mut d) = ([0.0; 3], [0.0; 3]);
    for (i, bars) in CIE_1931.iter().enumerate() {
        let wavelength = (380.0 + 5.0 * i as f64) * 1e-9;
        let z = SECOND / (wavelength * kelvin);
        let planck = FIRST / (wavelength.powi(5) * z.exp_m1()) * 5e-9;
        // d ln B / d ln T.
        let growth = -z / (-z).exp_m1();
        for c in 0..3 {
            xyz[c] += planck * bars[c];
            d[c] += planck * growth * bars[c];
        }
    }
    let rgb = |v: [f64; 3]| RGB_FROM_XYZ.map(|m| m[0] * v[0] + m[1] * v[1] + m[2] * v[2]);
    let (y, growth, rgb, d) = (xyz[1], d[1] / xyz[1], rgb(xyz), rgb(d));
    let share = |c: usize| rgb[c] / y;
    Node {
        value: [y.ln(), share(0), share(1), share(2)],
        slope: [growth, d[0] / y - share(0) * growth, d[1] / y - share(1) * growth, d[2] / y - share(2) * growth],
    }
}

/// A share of Y kept from being negative, and its slope.
fn kept(share: f64) -> (f64, f64) {
    if share >= SOFT {
        (share, 1.0)
    } else if share <= -SOFT {
        (0.0, 0.0)
    } else {
        let s = share + SOFT;
        (s * s / (4.0 * SOFT), s / (2.0 * SOFT))
    }
}

impl Node {
    /// Radiance and its derivative by T.
    fn radiance(&self, kelvin: f64) -> (Rgb, Rgb) {
        let y = self.value[0].exp();
        let (mut value, mut slope) = (Rgb::ZERO, Rgb::ZERO);
        for c in 0..3 {
            let (share, by_share) = kept(self.value[c + 1]);
            value[c] = y * share;
            slope[c] = y * (self.slope[0] * share + by_share * self.slope[c + 1]) / kelvin;
        }
        (value, slope)
    }
}

/// The table between its nodes, by ln T.
fn interpolated(kelvin: f64) -> Node {
    let h = step();
    let x = (kelvin / COLD).ln() / h;
    let i = (x as usize).min(PIECES - 1);
    let (a, b, t) = (&TABLE[i], &TABLE[i + 1], x - i as f64);
    let mut node = *a;
    for k in 0..4 {
        // Cubic Hermite, in powers of t.
        let (rise, s0, s1) = (b.value[k] - a.value[k], h * a.slope[k], h * b.slope[k]);
        let (c2, c3) = (3.0 * rise - 2.0 * s0 - s1, s0 + s1 - 2.0 * rise);
        node.value[k] += t * (s0 + t * (c2 + t * c3));
        node.slope[k] = (s0 + t * (2.0 * c2 + t * 3.0 * c3)) / h;
    }
    node
}

/// Radiance of a black body, linear Rec. 709, W / (m² sr), and its derivative by temperature. Black at 0 K and below.
pub fn radiance(kelvin: f64) -> (Rgb, Rgb) {
    if kelvin <= 0.0 {
        return (Rgb::ZERO, Rgb::ZERO);
    }
    if kelvin < COLD {
        // Wien: ln Y falls like 1/T, the colour stays.
        let growth = TABLE[0].slope[0] * COLD / kelvin;
        let [y, r, g, b] = TABLE[0].value;
        let y = y + TABLE[0].slope[0] - growth;
        return Node { value: [y, r, g, b], slope: [growth, 0.0, 0.0, 0.0] }.radiance(kelvin);
    }
    if kelvin > HOT {
        let Node { value: [y, r, g, b], slope: [growth, ..] } = TABLE[PIECES];
        let y = y + growth * (kelvin / HOT).ln();
        return Node { value: [y, r, g, b], slope: [growth, 0.0, 0.0, 0.0] }.radiance(kelvin);
    }
    interpolated(kelvin).radiance(kelvin)
}

/// x̄, ȳ, z̄ from 380 to 780 nm in steps of 5 nm.
const CIE_1931: [[f64; 3]; 81] = [
    [0.001368, 3.9e-05, 0.00645],
    [0.002236, 6.4e-05, 0.01055],
    [0.004243, 0.00012, 0.02005],
    [0.00765, 0.000217, 0.03621],
    [0.01431, 0.000396, 0.06785],
    [0.02319, 0.00064, 0.1102],
    [0.04351, 0.00121, 0.2074],
    [0.07763, 0.00218, 0.3713],
    [0.13438, 0.004, 0.6456],
    [0.21477, 0.0073, 1.03905],
    [0.2839, 0.0116, 1.3856],
    [0.3285, 0.01684, 1.62296],
    [0.34828, 0.023, 1.74706],
    [0.34806, 0.0298, 1.7826],
    [0.3362, 0.038, 1.77211],
    [0.3187, 0.048, 1.7441],
    [0.2908, 0.06, 1.6692],
    [0.2511, 0.0739, 1.5281],
    [0.19536, 0.09098, 1.28764],
    [0.1421, 0.1126, 1.0419],
    [0.09564, 0.13902, 0.81295],
    [0.05795, 0.1693, 0.6162],
    [0.03201, 0.20802, 0.46518],
    [0.0147, 0.2586, 0.3533],
    [0.0049, 0.323, 0.272],
    [0.0024, 0.4073, 0.2123],
    [0.0093, 0.503, 0.1582],
    [0.0291, 0.6082, 0.1117],
    [0.06327, 0.71, 0.07825],
    [0.1096, 0.7932, 0.05725],
    [0.1655, 0.862, 0.04216],
    [0.22575, 0.91485, 0.02984],
    [0.2904, 0.954, 0.0203],
    [0.3597, 0.9803, 0.0134],
    [0.43345, 0.99495, 0.00875],
    [0.51205, 1.0, 0.00575],
    [0.5945, 0.995, 0.0039],
    [0.6784, 0.9786, 0.00275],
    [0.7621, 0.952, 0.0021],
    [0.8425, 0.9154, 0.0018],
    [0.9163, 0.87, 0.00165],
    [0.9786, 0.8163, 0.0014],
    [1.0263, 0.757, 0.0011],
    [1.0567, 0.6949, 0.001],
    [1.0622, 0.631, 0.0008],
    [1.0456, 0.5668, 0.0006],
    [1.0026, 0.503, 0.00034],
    [0.9384, 0.4412, 0.00024],
    [0.85445, 0.381, 0.00019],
    [0.7514, 0.321, 0.0001],
    [0.6424, 0.265, 5e-05],
    [0.5419, 0.217, 3e-05],
    [0.4479, 0.175, 2e-05],
    [0.3608, 0.1382, 1e-05],
    [0.2835, 0.107, 0.0],
    [0.2187, 0.0816, 0.0],
    [0.1649, 0.061, 0.0],
    [0.1212, 0.04458, 0.0],
    [0.0874, 0.032, 0.0],
    [0.0636, 0.0232, 0.0],
    [0.04677, 0.017, 0.0],
    [0.0329, 0.01192, 0.0],
    [0.0227, 0.00821, 0.0],
    [0.01584, 0.005723, 0.0],
    [0.011359, 0.004102, 0.0],
    [0.008111, 0.002929, 0.0],
    [0.00579, 0.002091, 0.0],
    [0.004109, 0.001484, 0.0],
    [0.002899, 0.001047, 0.0],
    [0.002049, 0.00074, 0.0],
    [0.00144, 0.00052, 0.0],
    [0.001, 0.000361, 0.0],
    [0.00069, 0.000249, 0.0],
    [0.000476, 0.000172, 0.0],
    [0.000332, 0.00012, 0.0],
    [0.000235, 8.5e-05, 0.0],
    [0.000166, 6e-05, 0.0],
    [0.000117, 4.2e-05, 0.0],
    [8.3e-05, 3e-05, 0.0],
    [5.9e-05, 2.1e-05, 0.0],
    [4.2e-05, 1.5e-05, 0.0],
];

#[cfg(test)]
mod tests {
    use super::*;

    fn chromaticity(kelvin: f64) -> (f64, f64) {
        // The table's own shares, before negative channels end.
        let n = interpolated(kelvin);
        let m = glam::DMat3::from_cols_array_2d(&RGB_FROM_XYZ).transpose().inverse();
        let xyz = m * glam::DVec3::new(n.value[1], n.value[2], n.value[3]);
        let sum = xyz.element_sum();
        (xyz.x / sum, xyz.y / sum)
    }

    /// Points of the Planckian locus: CIE illuminant A, and the tables of Wyszecki and Stiles (four digits).
    #[test]
    fn colours_are_those_of_the_planckian_locus() {
        let locus = [
            (1000.0, 0.6528, 0.3445),
            (1500.0, 0.5857, 0.3931),
            (2000.0, 0.5267, 0.4133),
            (2856.0, 0.44757, 0.40745),
            (4000.0, 0.3805, 0.3768),
            (6500.0, 0.3135, 0.3237),
            (10000.0, 0.2807, 0.2884),
            (20000.0, 0.2565, 0.2577),
        ];
        for (kelvin, x, y) in locus {
            let c = chromaticity(kelvin);
            assert!((c.0 - x).abs() < 1e-4 && (c.1 - y).abs() < 1e-4, "{kelvin} K: {c:?}");
        }
    }

    /// Planck's law as summed here: all wavelengths give σ T⁴ / π (Stefan-Boltzmann), cold bodies Wien's law, hot ones Rayleigh-Jeans.
    #[test]
    fn constants_and_limits() {
        let (kelvin, n) = (3000.0, 200_000);
        let total: f64 = (0..n)
            .map(|i| {
                // λ = u / (1 - u) times 1 µm.
                let u = (f64::from(i) + 0.5) / f64::from(n);
                let wavelength = 1e-6 * u / (1.0 - u);
                let z = SECOND / (wavelength * kelvin);
                FIRST / (wavelength.powi(5) * z.exp_m1()) * 1e-6 / ((1.0 - u) * (1.0 - u)) / f64::from(n)
            })
            .sum();
        let stefan = 5.670_374_419e-8 * kelvin.powi(4) / std::f64::consts::PI;
        assert!((total / stefan - 1.0).abs() < 1e-8, "{total} {stefan}");

        // d ln Y / d ln T is h c / (λ k T) at some visible λ in Wien's range, 1 in Rayleigh and Jeans'.
        for kelvin in [250.0, 500.0, 1000.0] {
            let (value, slope) = radiance(kelvin);
            let wavelength = SECOND / (kelvin * (kelvin * slope.luminance() / value.luminance()));
            assert!((560e-9..780e-9).contains(&wavelength), "{kelvin} K: {wavelength}");
        }
        let (value, slope) = radiance(9e6);
        assert!((9e6 * slope.luminance() / value.luminance() - 1.0).abs() < 0.01);
    }

    #[test]
    fn the_table_is_the_sum() {
        let mut worst = 0.0f64;
        for i in 0..4000 {
            let kelvin = 201.0 * (f64::from(i) / 4000.0 * (9.9e6f64 / 201.0).ln()).exp();
            let (ours, truth) = (radiance(kelvin), summed(kelvin).radiance(kelvin));
            let y = truth.0.max();
            worst = worst.max((ours.0 - truth.0).abs().max() / y);
            assert!((ours.1 - truth.1).abs().max() < 1e-4 * truth.1.max(), "{kelvin} K: {ours:?} {truth:?}");
        }
        assert!(worst < 1e-7, "{worst}");
    }

    /// Over the ends of the table and of the gamut too: no jump, and the slope is that of the values.
    #[test]
    fn slopes_are_those_of_the_values() {
        let (mut before, mut kelvin) = (Rgb::ZERO, 30.0);
        while kelvin < 4e7 {
            let h = 1e-4 * kelvin;
            let (high, low, (value, slope)) = (radiance(kelvin + h).0, radiance(kelvin - h).0, radiance(kelvin));
            for c in 0..3 {
                let d = (high[c] - low[c]) / (2.0 * h);
                // Second order: relative, (c/λT)² 1e-8 / 6.
                let scale = slope.max();
                let steep = 40.0 * 1e3 / kelvin;
                assert!(
                    (d - slope[c]).abs() <= scale * (1e-6 + 1e-8 * steep * steep),
                    "{kelvin} K, {c}: {d} {}",
                    slope[c]
                );
                assert!(value[c] >= 0.0 && value[c] >= before[c], "{kelvin} K, {c}: it falls");
            }
            before = value;
            kelvin *= 1.003;
        }
        assert!(radiance(-5.0).0.is_zero() && radiance(0.0).1.is_zero() && radiance(1e-3).0.is_zero());
        assert!(radiance(f64::NAN).0[0].is_nan());
    }
}
