//! `Real`: the scalar every formula is generic over. `f64` is the primal, `Dual<N>` carries N partial derivatives.
//!
//! A formula is written once; evaluated with `f64` it gives the value, with `Dual<N>` seeded on its N inputs
//! it gives the value and the gradient, which is the formula's own adjoint (see [`gradient`]).

use std::fmt::Debug;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A real scalar with the functions that the formulas of the renderer need.
pub trait Real:
    Copy
    + Debug
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
    + From<f64>
{
    /// The primal value.
    fn value(self) -> f64;
    fn sqrt(self) -> Self;
    fn exp(self) -> Self;
    fn exp_m1(self) -> Self;
    fn ln(self) -> Self;
    fn sin(self) -> Self;
    fn cos(self) -> Self;
    fn tan(self) -> Self;
    fn atan2(self, x: Self) -> Self;
    /// `self^p` for a constant exponent; the derivative of `0^p` with `p >= 1` is the one-sided one.
    fn powf(self, p: f64) -> Self;
    fn zero() -> Self {
        Self::from(0.0)
    }
    fn one() -> Self {
        Self::from(1.0)
    }
    fn recip(self) -> Self {
        Self::one() / self
    }
    fn sqr(self) -> Self {
        self * self
    }
    fn to_radians(self) -> Self {
        self * (std::f64::consts::PI / 180.0)
    }
}

impl Real for f64 {
    fn value(self) -> f64 {
        self
    }
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    fn exp(self) -> Self {
        f64::exp(self)
    }
    fn exp_m1(self) -> Self {
        f64::exp_m1(self)
    }
    fn ln(self) -> Self {
        f64::ln(self)
    }
    fn sin(self) -> Self {
        f64::sin(self)
    }
    fn cos(self) -> Self {
        f64::cos(self)
    }
    fn tan(self) -> Self {
        f64::tan(self)
    }
    fn atan2(self, x: Self) -> Self {
        f64::atan2(self, x)
    }
    fn powf(self, p: f64) -> Self {
        f64::powf(self, p)
    }
}

/// A value with N partial derivatives.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Dual<const N: usize> {
    pub v: f64,
    pub d: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// A constant: all derivatives zero.
    pub const fn constant(v: f64) -> Self {
        Dual { v, d: [0.0; N] }
    }

    /// The `i`-th independent variable.
    pub const fn variable(v: f64, i: usize) -> Self {
        let mut d = [0.0; N];
        d[i] = 1.0;
        Dual { v, d }
    }

    /// Apply the chain rule: value `v`, derivative of the outer function `dv`.
    fn chain(self, v: f64, dv: f64) -> Self {
        // A zero tangent stays zero even where the outer derivative is infinite (sqrt at 0).
        Dual { v, d: self.d.map(|x| if x == 0.0 { 0.0 } else { x * dv }) }
    }
}

impl<const N: usize> From<f64> for Dual<N> {
    fn from(v: f64) -> Self {
        Dual::constant(v)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Dual { v: self.v + o.v, d: std::array::from_fn(|i| self.d[i] + o.d[i]) }
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Dual { v: self.v - o.v, d: std::array::from_fn(|i| self.d[i] - o.d[i]) }
    }
}

#[allow(clippy::suspicious_arithmetic_impl)]
impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Dual { v: self.v * o.v, d: std::array::from_fn(|i| self.d[i] * o.v + self.v * o.d[i]) }
    }
}

#[allow(clippy::suspicious_arithmetic_impl)]
impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        let v = self.v / o.v;
        Dual { v, d: std::array::from_fn(|i| (self.d[i] - v * o.d[i]) / o.v) }
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        Dual { v: -self.v, d: self.d.map(|x| -x) }
    }
}

impl<const N: usize> Add<f64> for Dual<N> {
    type Output = Self;
    fn add(self, o: f64) -> Self {
        Dual { v: self.v + o, d: self.d }
    }
}

impl<const N: usize> Sub<f64> for Dual<N> {
    type Output = Self;
    fn sub(self, o: f64) -> Self {
        Dual { v: self.v - o, d: self.d }
    }
}

impl<const N: usize> Mul<f64> for Dual<N> {
    type Output = Self;
    fn mul(self, o: f64) -> Self {
        Dual { v: self.v * o, d: self.d.map(|x| x * o) }
    }
}

impl<const N: usize> Div<f64> for Dual<N> {
    type Output = Self;
    fn div(self, o: f64) -> Self {
        Dual { v: self.v / o, d: self.d.map(|x| x / o) }
    }
}

impl<const N: usize> Real for Dual<N> {
    fn value(self) -> f64 {
        self.v
    }
    fn sqrt(self) -> Self {
        let r = self.v.sqrt();
        self.chain(r, 0.5 / r)
    }
    fn exp(self) -> Self {
        let e = self.v.exp();
        self.chain(e, e)
    }
    fn exp_m1(self) -> Self {
        self.chain(self.v.exp_m1(), self.v.exp())
    }
    fn ln(self) -> Self {
        self.chain(self.v.ln(), self.v.recip())
    }
    fn sin(self) -> Self {
        self.chain(self.v.sin(), self.v.cos())
    }
    fn cos(self) -> Self {
        self.chain(self.v.cos(), -self.v.sin())
    }
    fn tan(self) -> Self {
        let t = self.v.tan();
        self.chain(t, 1.0 + t * t)
    }
    fn atan2(self, x: Self) -> Self {
        let r2 = self.v * self.v + x.v * x.v;
        Dual { v: self.v.atan2(x.v), d: std::array::from_fn(|i| (self.d[i] * x.v - self.v * x.d[i]) / r2) }
    }
    fn powf(self, p: f64) -> Self {
        self.chain(self.v.powf(p), p * self.v.powf(p - 1.0))
    }
}

/// Value and gradient of a formula at `x`: the formula's own adjoint.
pub fn gradient<const N: usize>(x: [f64; N], f: impl Fn([Dual<N>; N]) -> Dual<N>) -> (f64, [f64; N]) {
    let y = f(std::array::from_fn(|i| Dual::variable(x[i], i)));
    (y.v, y.d)
}

/// A 3-vector over any `Real`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct V3<R> {
    pub x: R,
    pub y: R,
    pub z: R,
}

impl<R: Real> V3<R> {
    pub fn new(x: R, y: R, z: R) -> Self {
        V3 { x, y, z }
    }
    pub fn constant(v: glam::DVec3) -> Self {
        V3 { x: R::from(v.x), y: R::from(v.y), z: R::from(v.z) }
    }
    pub fn value(self) -> glam::DVec3 {
        glam::DVec3::new(self.x.value(), self.y.value(), self.z.value())
    }
    pub fn dot(self, o: Self) -> R {
        self.x * o.x + self.y * o.y + self.z * o.z
    }
    pub fn cross(self, o: Self) -> Self {
        V3 { x: self.y * o.z - self.z * o.y, y: self.z * o.x - self.x * o.z, z: self.x * o.y - self.y * o.x }
    }
    pub fn length_squared(self) -> R {
        self.dot(self)
    }
    pub fn length(self) -> R {
        self.length_squared().sqrt()
    }
    pub fn normalize(self) -> Self {
        self * self.length().recip()
    }
}

impl<const N: usize> V3<Dual<N>> {
    /// Its components are the variables from `first` on.
    pub fn variable(v: glam::DVec3, first: usize) -> Self {
        V3::new(Dual::variable(v.x, first), Dual::variable(v.y, first + 1), Dual::variable(v.z, first + 2))
    }
}

impl V3<Dual<1>> {
    /// The tangent of every component.
    pub fn tangent(self) -> glam::DVec3 {
        glam::DVec3::new(self.x.d[0], self.y.d[0], self.z.d[0])
    }
}

impl<R: Real> Add for V3<R> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        V3 { x: self.x + o.x, y: self.y + o.y, z: self.z + o.z }
    }
}

impl<R: Real> Sub for V3<R> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        V3 { x: self.x - o.x, y: self.y - o.y, z: self.z - o.z }
    }
}

impl<R: Real> Neg for V3<R> {
    type Output = Self;
    fn neg(self) -> Self {
        V3 { x: -self.x, y: -self.y, z: -self.z }
    }
}

impl<R: Real> Mul<R> for V3<R> {
    type Output = Self;
    fn mul(self, s: R) -> Self {
        V3 { x: self.x * s, y: self.y * s, z: self.z * s }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_function_agrees_with_central_differences() {
        fn check(f: impl Fn(Dual<1>) -> Dual<1>, x: f64) {
            let h = 1e-6;
            let (_, [d]) = gradient([x], |[x]| f(x));
            let fd = (f(Dual::constant(x + h)).v - f(Dual::constant(x - h)).v) / (2.0 * h);
            assert!((d - fd).abs() <= 1e-7 * (1.0 + fd.abs()), "{d} {fd}");
        }
        for x in [0.3, 0.9, 2.1] {
            check(|x| x.sqrt(), x);
            check(|x| x.exp(), x);
            check(|x| x.exp_m1(), x);
            check(|x| x.ln(), x);
            check(|x| x.sin() * x.cos() + x.tan(), x);
            check(|x| x.atan2(x * x + 1.0), x);
            check(|x| x.powf(2.5) / (x + 3.0) - x.recip(), x);
        }
    }

    #[test]
    fn a_zero_tangent_survives_an_infinite_slope() {
        assert_eq!(Dual::<1>::constant(0.0).sqrt().d, [0.0]);
    }
}
