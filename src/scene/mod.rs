//! Scenes: Mitsuba 3 XML to a description with names, places and parameters ([`desc::SceneDesc`]).

pub mod desc;
pub mod node;
mod property;
mod refs;
mod source;
pub mod transform;
pub mod value;
pub mod xml;

pub use desc::{Env, SceneDesc};
pub use node::Node;
pub use transform::Mat4;
