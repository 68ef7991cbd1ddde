//! Transport: walks, what they record, and the sweep that turns a record into partial derivatives.

pub mod aim;
pub mod attach;
pub mod ball;
pub mod beam;
pub mod beam_centred;
pub mod beam_motion;
pub mod beside;
pub mod border;
pub mod bubble;
pub mod camera_line;
pub mod chain;
pub mod chained;
pub mod chance;
pub mod connect;
pub mod field;
pub mod first;
pub mod glow;
pub mod lamp;
pub mod lead;
pub mod light_centred;
pub mod line;
mod lottery;
pub mod manifold;
pub mod mirror;
pub mod motion;
pub mod pane;
pub mod piece;
pub mod poles;
pub mod ray;
pub mod record;
pub mod shot;
pub mod smooth_way;
pub mod specular;
pub mod state;
pub mod sweep;
pub mod tracking;
pub mod transmit;
pub mod twin;
pub mod upright;
pub mod velocity;
pub mod vertex;
pub mod walk;
pub mod way_motion;

pub use record::{NoRecord, PathRecord};
pub use state::{Beginning, State};
pub use sweep::{Sweep, SweepFacts};
pub use walk::Tally;

use crate::math::Rgb;
use crate::scene::{Scene, Settings};

/// The value of one camera path.
pub fn sample(scene: &Scene, set: &Settings, begin: &Beginning, tally: &mut Tally) -> Rgb {
    let mut rec = NoRecord;
    let mut w = walk::Walker::new(scene, set, &mut rec);
    w.trace(&mut begin.state());
    *tally = tally.plus(&w.tally);
    w.total()
}
