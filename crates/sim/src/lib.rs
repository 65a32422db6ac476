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
//! ```
//! use wrenchd_sim::{Options, Preset, Simulator, Truth};
//!
//! let config = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/arm.toml");
//! let rig = rig::Rig::load_file(config.as_ref())?;
//! let truth = Truth::draw(&rig, 7, 0.0);
//! let scenario = Preset::Accuracy.scenario(&rig.chain, 7)?;
//! let mut simulator = Simulator::new(&rig, truth, &scenario, Options::default())?;
//! let (bus, _source) = can::channel::channel(1024);
//! for _ in 0..700 {
//!     let Some(stamped) = simulator.next() else { break };
//!     bus.send(stamped);
//! }
//! assert!(simulator.truth_at(2.75).force_n.x == 5.0);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! What is simulated is the nominal arm: rigid, exactly its URDF, with linear gauges and synchronised boards; with
//! [`Truth::with_imperfections`] an arm as it is built, where none of that holds but the boards.

mod bus;
mod climate;
pub mod effects;
mod error;
mod gauge;
pub mod imperfect;
pub mod mechanics;
pub mod motion;
pub mod output;
pub mod push;
mod random;
pub mod scenario;
mod simulator;
pub mod truth;

pub use error::SimError;
pub use imperfect::Imperfections;
pub use mechanics::Mechanics;
pub use motion::{JointState, Trajectory};
pub use scenario::{Preset, Scenario};
pub use simulator::{Options, START_NS, Simulator};
pub use truth::{TrueGauge, Truth};
