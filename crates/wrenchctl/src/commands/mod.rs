//! One module a command: its arguments, and `run(args) -> Result<Outcome, Error>`.

pub mod check;

use crate::cli::Command;
use crate::{Error, Outcome};

/// Runs one command.
pub fn run(command: Command) -> Result<Outcome, Error> {
    match command {
        Command::Check(args) => check::run(args),
    }
}
