//! Linear RGB triples: three wavelengths in this renderer, each with its own extinction.

use std::ops::{Add, AddAssign, Div, Index, IndexMut, Mul, MulAssign, Neg, Sub};

#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Rgb(pub [f64; 3]);

impl Rgb {
    pub const ZERO: Rgb = Rgb([0.0; 3]);
    pub const ONE: Rgb = Rgb([1.0; 3]);

    pub const fn splat(v: f64) -> Self {
        Rgb([v; 3])
    }
    pub fn from_fn(f: impl FnMut(usize) -> f64) -> Self {
        Rgb(std::array::from_fn(f))
    }
    pub fn map(self, f: impl Fn(f64) -> f64) -> Self {
        Rgb(self.0.map(f))
    }
    pub fn mean(self) -> f64 {
        (self.0[0] + self.0[1] + self.0[2]) * (1.0 / 3.0)
    }
    pub fn max(self) -> f64 {
        self.0[0].max(self.0[1]).max(self.0[2])
    }
    pub fn min(self) -> f64 {
        self.0[0].min(self.0[1]).min(self.0[2])
    }
    pub fn abs(self) -> Self {
        self.map(f64::abs)
    }
    pub fn sum(self) -> f64 {
        self.0[0] + self.0[1] + self.0[2]
    }
    pub fn dot(self, o: Rgb) -> f64 {
        self.0[0] * o.0[0] + self.0[1] * o.0[1] + self.0[2] * o.0[2]
    }
    pub fn is_zero(self) -> bool {
        self.0 == [0.0; 3]
    }
    pub fn is_finite(self) -> bool {
        self.0.iter().all(|x| x.is_finite())
    }
    /// All three channels equal: no chromatic sampling needed.
    pub fn is_gray(self) -> bool {
        self.0[0] == self.0[1] && self.0[1] == self.0[2]
    }
    /// Only channel `c` non-zero.
    pub fn channel(c: usize, v: f64) -> Self {
        let mut r = Rgb::ZERO;
        r.0[c] = v;
        r
    }
    /// Relative luminance, Rec. 709 primaries.
    pub fn luminance(self) -> f64 {
        0.212671 * self.0[0] + 0.715160 * self.0[1] + 0.072169 * self.0[2]
    }
}

impl Index<usize> for Rgb {
    type Output = f64;
    fn index(&self, i: usize) -> &f64 {
        &self.0[i]
    }
}
impl IndexMut<usize> for Rgb {
    fn index_mut(&mut self, i: usize) -> &mut f64 {
        &mut self.0[i]
    }
}
impl Add for Rgb {
    type Output = Rgb;
    fn add(self, o: Rgb) -> Rgb {
        Rgb::from_fn(|i| self.0[i] + o.0[i])
    }
}
impl Sub for Rgb {
    type Output = Rgb;
    fn sub(self, o: Rgb) -> Rgb {
        Rgb::from_fn(|i| self.0[i] - o.0[i])
    }
}
impl Mul for Rgb {
    type Output = Rgb;
    fn mul(self, o: Rgb) -> Rgb {
        Rgb::from_fn(|i| self.0[i] * o.0[i])
    }
}
impl Div for Rgb {
    type Output = Rgb;
    fn div(self, o: Rgb) -> Rgb {
        Rgb::from_fn(|i| self.0[i] / o.0[i])
    }
}
impl Mul<f64> for Rgb {
    type Output = Rgb;
    fn mul(self, s: f64) -> Rgb {
        self.map(|x| x * s)
    }
}
impl Div<f64> for Rgb {
    type Output = Rgb;
    fn div(self, s: f64) -> Rgb {
        self.map(|x| x / s)
    }
}
impl Neg for Rgb {
    type Output = Rgb;
    fn neg(self) -> Rgb {
        self.map(|x| -x)
    }
}
impl AddAssign for Rgb {
    fn add_assign(&mut self, o: Rgb) {
        *self = *self + o;
    }
}
impl MulAssign for Rgb {
    fn mul_assign(&mut self, o: Rgb) {
        *self = *self * o;
    }
}
impl MulAssign<f64> for Rgb {
    fn mul_assign(&mut self, s: f64) {
        *self = *self * s;
    }
}
