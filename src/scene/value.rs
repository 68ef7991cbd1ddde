//! Values as they stand in the file: numbers that may be `$parameters`, and the table of parameters.

use super::transform::Op;
use crate::error::Span;

/// A number of the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Num {
    Const(f64),
    /// `$x`, by its index in `SceneDesc::params`.
    Param(usize),
}

/// The value of a property.
#[derive(Clone, Debug)]
pub enum Value {
    Float(Num),
    Int(i64),
    Bool(bool),
    Text(String),
    Color([Num; 3]),
    Triple([Num; 3]),
    Transform(Vec<(Span, Op)>),
}
