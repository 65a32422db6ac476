//! Faults that are put in on purpose, through the daemon's own cycle: simulator, frames, fault injector, cycle.
#![allow(clippy::unwrap_used)]

#[path = "../common/mod.rs"]
mod common;
mod gauge;
mod grid;
mod isolation;
mod long_run;
mod soak;
mod start;
