//! The Debian packages on a Debian that systemd has really booted: see `wrenchd_tests::machine`.

mod arm;
mod bridge;
mod first;
mod package;
mod service;
mod systemd;

use std::process::ExitCode;
use wrenchd_tests::machine::Machine;
use wrenchd_tests::suite::{self, Stage};

fn main() -> ExitCode {
    let stage = Stage {
        prepare: Machine::prepare_debian,
        // The first scenario finds what the boot left.
        before_each: || Ok(()),
        evidence: systemd::keep_journal,
        first: Some(&first::SCENARIO),
    };
    suite::main(&stage, &[service::SCENARIOS, bridge::SCENARIOS, package::SCENARIOS])
}
