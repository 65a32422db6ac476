//! `wrenchctl`: everything that a person types

use std::process::ExitCode;

fn main() -> ExitCode {
    wrenchctl::main()
}
