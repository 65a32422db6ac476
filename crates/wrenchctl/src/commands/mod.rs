//! One module a command: its arguments, and `run(args) -> Result<Outcome, Error>`.

pub mod calibrate;
pub mod check;
pub mod validate;

use crate::cli::Command;
use crate::{Error, Outcome};

/// Runs one command.
pub fn run(command: Command) -> Result<Outcome, Error> {
    match command {
        Command::Check(args) => check::run(args),
        Command::Calibrate(args) => calibrate::run(args),
        Command::Validate(args) => validate::run(args),
    }
}
