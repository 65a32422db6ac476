//! Command-line tool of wrenchd: calibrate, validate, simulate, replay, dump, demo
//!
//! One module a command under [`commands`], each with its arguments and `run(args) -> Result<Outcome, Error>`. Data goes to
//! standard output, everything else to standard error; files are written whole or not at all. Exit status: 0 done, 1 the
//! answer is "no", 2 unusable input or arguments.

pub mod cli;
pub mod commands;
pub mod control;
pub mod decoded;
pub mod error;
pub mod input;
pub mod live;
pub mod output;
pub mod pages;
pub mod progress;
pub mod run_dir;

use std::process::ExitCode;

use clap::Parser;

pub use error::{Error, Outcome};

/// Runs the program with this process's arguments.
pub fn main() -> ExitCode {
    match commands::run(cli::Cli::parse().command) {
        Ok(Outcome::Done) => ExitCode::SUCCESS,
        Ok(Outcome::No) => ExitCode::from(1),
        // Whoever read our output has seen enough.
        Err(error) if error.is_closed_output() => ExitCode::SUCCESS,
        Err(error) => {
            output::note(format_args!("{error}"));
            ExitCode::from(2)
        }
    }
}
