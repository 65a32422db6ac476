//! Real-time daemon: end-effector wrench from joint torque sensors over SocketCAN
//!
//! From the bus to whoever listens, one module a step:
//!
//! | step | module |
//! | --- | --- |
//! | frames of several interfaces in the order of their stamps | [`merge`] |
//! | a copy of everything received, for `--record` | [`recorder`] |
//! | frames and time to published records: no clock, no socket, also used in-process | [`engine`], [`published`] |
//! | the code kept at hand while a round is coming | `rehearsal` |
//! | one turn: wait, take in, publish | [`station`], [`grid`] |
//! | outputs inside the cycle | [`output`] |
//! | everybody else: a ring that the cycle never waits for, and counters | [`feed`], [`health`] |
//! | the thread with its real-time rights | `realtime`, `runner` |
//! | command line | [`arguments`] |
//! | start, signals, reload, service manager, log | `service` |
//!
//! Two threads matter: the cycle, which does nothing but turn, and the main thread, which supervises. What goes from
//! the main thread to the cycle (a new engine after a reload) goes through a queue of one; what comes back is freed by
//! the main thread. The daemon is no safety-rated device.

#![cfg_attr(test, allow(clippy::unwrap_used))]

#[cfg(test)]
extern crate self as wrenchd;

#[cfg(test)]
#[path = "../tests/common/mod.rs"]
mod common;

pub mod arguments;
pub mod board;
pub mod bus_errors;
pub mod command;
pub mod control;
#[cfg(target_os = "linux")]
pub mod desk;
pub mod engine;
pub mod feed;
pub mod grid;
pub mod health;
pub mod histogram;
pub mod merge;
#[cfg(target_os = "linux")]
pub mod network;
pub mod output;
pub mod published;
#[cfg(target_os = "linux")]
#[allow(unsafe_code)]
pub mod realtime;
pub mod recorder;
mod rehearsal;
#[cfg(target_os = "linux")]
pub mod runner;
mod seqlock;
#[cfg(target_os = "linux")]
pub mod service;
pub mod station;
pub mod view;
