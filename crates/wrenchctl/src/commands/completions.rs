//! `wrenchctl completions`: what a shell must know to complete commands and options.

use std::io::Write;

use clap::{CommandFactory, ValueEnum};
use clap_complete::Shell;
use wrenchd::arguments::Arguments;

use crate::cli::Cli;
use crate::{Error, Outcome, output};

/// For which shell, of which program.
#[derive(clap::Args, Debug)]
#[command(after_help = "\
For one session: source <(wrenchctl completions bash), the same with zsh, or wrenchctl completions fish | source. \
The Debian package sets it up for all.")]
pub struct Args {
    /// The shell
    #[arg(value_name = "SHELL")]
    pub shell: Shell,
    /// Whose commands and options to complete
    #[arg(value_name = "PROGRAM", default_value = "wrenchctl")]
    pub program: Program,
}

/// A program of this project.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Program {
    /// What a person types.
    Wrenchctl,
    /// The daemon.
    Wrenchd,
}

impl Program {
    /// Its command line.
    #[must_use]
    pub fn command(self) -> clap::Command {
        match self {
            Self::Wrenchctl => Cli::command(),
            Self::Wrenchd => Arguments::command(),
        }
    }
}

/// Prints the shell's script.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let mut command = args.program.command();
    let name = command.get_name().to_owned();
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, name, &mut script);
    let mut out = output::stdout();
    out.write_all(&script)?;
    out.flush()?;
    Ok(Outcome::Done)
}
