//! One module a command: its arguments, and `run(args) -> Result<Outcome, Error>`.

pub mod calibrate;
pub mod check;
pub mod completions;
pub mod daemon;
pub mod demo;
pub mod diagnose;
pub mod dump;
pub mod mcap;
pub mod monitor;
pub mod plan;
pub mod record;
pub mod replay;
pub mod simulate;
pub mod stats;
pub mod validate;

use std::time::Duration;

use crate::cli::Command;
use crate::{Error, Outcome};

/// Runs one command.
pub fn run(command: Command) -> Result<Outcome, Error> {
    match command {
        Command::Check(args) => check::run(args),
        Command::Mcap(args) => mcap::run(args),
        Command::Monitor(args) => monitor::run(args),
        Command::Status(args) => daemon::status(args),
        Command::Tare(args) => daemon::tare(args),
        Command::Untare(args) => daemon::untare(args),
        Command::Payload(args) => daemon::payload(args),
        Command::Reload(args) => daemon::reload(args),
        Command::Demo(args) => demo::run(args),
        Command::Simulate(args) => simulate::run(args),
        Command::Dump(args) => dump::run(args),
        Command::Stats(args) => stats::run(args),
        Command::Replay(args) => replay::run(args),
        Command::Record(args) => record::run(args),
        Command::Plan(args) => plan::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Diagnose(args) => diagnose::run(args),
        Command::Validate(args) => validate::run(args),
        Command::Completions(args) => completions::run(args),
    }
}

/// A time in seconds, more than nothing.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().ok().filter(|seconds| *seconds > 0.0 && *seconds < 1e9);
    let seconds = seconds.ok_or("give a number of seconds above 0, such as 10 or 0.5")?;
    Ok(Duration::from_secs_f64(seconds))
}

/// A file without a single frame.
fn no_log(name: &str, lines: u64) -> Error {
    Error::usage(format!(
        "{name}: none of its {lines} lines is a candump line, `(seconds.micros) interface ID#DATA`; record with `candump -L` or `wrenchctl record`"
    ))
}
