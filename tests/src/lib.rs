//! Whole-program tests of wrenchd: the programs as a user starts them, on real SocketCAN.
//!
//! - [`machine`]: somewhere with `vcan0` and `vcan1`: a network namespace where the kernel has vcan, user-mode Linux
//!   where it has not. It installs what it needs on Debian, and fails with a message where it cannot; it never skips.
//! - [`suite`]: the scenarios of one test target, run by that target's own executable inside the machine.
//! - [`guest`]: what a scenario works with: links, captures, directories.
//! - [`process`]: child programs with a deadline on everything.
//! - [`package`]: the Debian package.
//! - [`programs`], [`python`]: the programs under test, and the independent decoder.
//! - [`scratch`]: directories of the tests' own.
//! - [`packages`]: what Debian has.
//! - [`browser`]: what a person sees of a report.
//! - [`candump`]: recordings cut, retimed and repacked as text, without the code under test.

pub mod browser;
pub mod candump;
mod failure;
pub mod guest;
pub mod machine;
pub mod package;
pub mod packages;
pub mod process;
pub mod programs;
pub mod python;
pub mod scratch;
pub mod suite;

pub use failure::{Check, Failure, IoContext};
