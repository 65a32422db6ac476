//! The daemon's command line.

use std::path::PathBuf;

use clap::Parser;

/// End-effector wrench from joint torque sensors over SocketCAN, in real time
///
/// SIGHUP reads configuration and model again and keeps the old ones if the new are bad; SIGTERM stops cleanly.
/// Exit status: 0 stopped cleanly, 1 failed while running, 2 unusable input or arguments.
#[derive(Parser, Debug)]
#[command(name = "wrenchd", version)]
pub struct Arguments {
    /// The robot's configuration (TOML)
    #[arg(long, value_name = "FILE")]
    pub config: PathBuf,
    /// The calibrated model; overrides the configuration's
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Record every received frame with its kernel stamp (candump -L; .gz and .zst compress)
    ///
    /// The log appears when the daemon stops. A file that is there already is kept: for can.log.gz the recording is then can.1.log.gz, can.2.log.gz and so on.
    #[arg(long, value_name = "LOG")]
    pub record: Option<PathBuf>,
}
