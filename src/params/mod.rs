//! Parameters: which numbers of a scene can be differentiated (slots), and what a partial derivative means (sinks).
//! The only place that knows forward from reverse.

mod array_sum;
pub mod corners;
pub mod mover;
pub mod sink;
pub mod slot;

pub use array_sum::ArraySum;
pub use corners::Corners;
pub use mover::{Covector, Mover, Partial};
pub use sink::{Both, Forward, Gauge, Null, Reverse, Sink};
pub use slot::{Array, Block, Owner, ParamSet, Quantity, Slot, SlotTable};
