//! `wrenchd-ros2`: passes a running wrenchd's wrench on to ROS 2, from a process of its own.
//!
//! ```text
//! wrenchd's control socket -> records -> geometry_msgs/msg/WrenchStamped       every record with a wrench
//!                          -> status  -> diagnostic_msgs/msg/DiagnosticArray   each second, and at once when the wrench goes or returns
//! ```
//!
//! It speaks what rmw_zenoh speaks (ROS 2 Jazzy and later, with its router), so nothing of ROS need be installed here. Without a valid wrench the
//! topic is silent: nobody takes an old number for a new one.

mod daemon;
mod graph;
#[cfg(test)]
mod manual;
mod passing;

use std::io::Write;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

/// Publishes a running wrenchd's wrench as ROS 2 WrenchStamped, without a ROS installation
///
/// Needs `[publish.ros2]` and `[control]` in the daemon's configuration, and a zenoh router, as every rmw_zenoh node does
/// (`ros2 run rmw_zenoh_cpp rmw_zenohd`, on any machine). Exit status: 2 unusable input or arguments.
#[derive(Parser)]
#[command(name = "wrenchd-ros2", version)]
struct Arguments {
    /// The daemon's configuration (TOML)
    #[arg(long, value_name = "FILE")]
    config: PathBuf,
    /// For ROS 2 Humble, whose keys have no type hashes
    #[arg(long)]
    humble: bool,
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    match passing::run(&arguments.config, arguments.humble) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            // The exit status tells it even where standard error takes nothing.
            let _ = writeln!(std::io::stderr(), "wrenchd-ros2: error: {error}");
            ExitCode::from(2)
        }
    }
}
