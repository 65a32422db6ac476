//! On real SocketCAN, in a machine of its own: see `wrenchd_tests::machine`.

mod bus;
mod clients;
mod daemon;
mod live;
mod published;
mod rig;
mod service;
mod tools;

use std::process::ExitCode;
use wrenchd_tests::suite::{self, Stage};

fn main() -> ExitCode {
    suite::main(
        &Stage::CAN,
        &[bus::SCENARIOS, daemon::SCENARIOS, service::SCENARIOS, clients::SCENARIOS, tools::SCENARIOS],
    )
}
