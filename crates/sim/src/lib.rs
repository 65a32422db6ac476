//! The arm and its gauges run forwards: motions, loads, noise, CAN frames, run directories.
//!
//! ```text
//! Trajectory -> Mechanics (loads of every section) -> Truth (counts, noise) -> Bus (frames, stamps) -> Simulator
//! ```
//!
//! [`Simulator`] is an iterator of stamped frames, for an in-process bus; [`output::write_run`] makes a run directory of
//! it. Every number is a function of the configuration, the [`truth::Truth`], the [`scenario::Scenario`] and a seed: the
//! same four give the same frames, bit for bit. Nothing here reads a clock.
//!
//! What is simulated is the nominal arm: rigid, exactly its URDF, with linear gauges and synchronised boards.

mod bus;
mod climate;
mod error;
mod gauge;
pub mod mechanics;
pub mod motion;
pub mod output;
pub mod push;
mod random;
pub mod scenario;
mod simulator;
pub mod truth;

pub use error::SimError;
pub use mechanics::Mechanics;
pub use motion::{JointState, Trajectory};
pub use scenario::{Preset, Scenario};
pub use simulator::{Options, START_NS, Simulator};
pub use truth::{TrueGauge, Truth};
