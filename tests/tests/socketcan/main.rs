//! On real SocketCAN, in a machine of its own: see `wrenchd_tests::machine`.

mod bus;
mod clients;
mod daemon;
mod errors;
mod hostile;
mod live;
mod published;
mod rig;
mod service;
mod soak;
mod tools;

use std::process::ExitCode;
use wrenchd_tests::suite::{self, Stage};

fn main() -> ExitCode {
    // Its verdict is about the machine's timing, too: it is asked for.
    let soak = if std::env::var_os(suite::SOAK_VARIABLE).is_some() { soak::SCENARIOS } else { &[] };
    suite::main(
        &Stage::CAN,
        &[
            bus::SCENARIOS,
            daemon::SCENARIOS,
            service::SCENARIOS,
            errors::SCENARIOS,
            clients::SCENARIOS,
            hostile::SCENARIOS,
            soak,
            tools::SCENARIOS,
        ],
    )
}
