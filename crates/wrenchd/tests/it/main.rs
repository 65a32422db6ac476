//! The daemon in-process, on simulated and on the system's time, and the program's refusals.
#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../common/mod.rs"]
mod common;
mod engine;
mod orders;
mod refusals;
mod station;
