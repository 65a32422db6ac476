//! The command line: one variant a command; each command's module has its own arguments.

use clap::{Parser, Subcommand};

use crate::commands::{
    calibrate, check, completions, daemon, demo, diagnose, dump, mcap, monitor, plan, record, replay,
    simulate, stats, validate,
};

/// End-effector wrench from joint torque sensors: calibrate, check, record, replay, simulate
#[derive(Parser, Debug)]
#[command(
    name = "wrenchctl",
    version,
    max_term_width = 120,
    after_help = "Exit status: 0 done; 1 the answer is \"no\"; 2 unusable input or arguments, with the reason on stderr."
)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// Everything that a person types.
#[derive(Subcommand, Debug)]
pub enum Command {
    /// Simulated arm, bus and daemon on this machine, nothing to set up: live wrench beside the truth
    Demo(demo::Args),
    /// Check configuration, URDF, DBC and model against each other; print the planned bus load
    Check(check::Args),
    /// Print frames as candump does, decoded when a configuration is given
    Dump(dump::Args),
    /// Rates, gaps, jitter, errors and bus load of an interface or a log
    Stats(stats::Args),
    /// Put a recording on a CAN interface with its own timing
    Replay(replay::Args),
    /// Record live interfaces into a run directory
    Record(record::Args),
    /// Write raw CAN and the wrench, live or from a recording, into one MCAP file for Foxglove and PlotJuggler
    Mcap(mcap::Args),
    /// The poses and weights to record next, given what is already known
    Plan(plan::Args),
    /// Live terminal view of a running daemon: wrench, gauges, health
    Monitor(monitor::Args),
    /// Show a running daemon's state; exit status 1 without a valid wrench
    Status(daemon::StatusArgs),
    /// Find every gauge's zero again while nothing touches the arm's tip; until untare or the daemon's end
    Tare(daemon::OrderArgs),
    /// Take a tare back
    Untare(daemon::OrderArgs),
    /// Subtract weight and inertia of a mass at the tip from now on; 0 takes it off
    Payload(daemon::PayloadArgs),
    /// Make a running daemon read its configuration and model again
    Reload(daemon::OrderArgs),
    /// Find each gauge's actual sensing frame from recordings; write the model
    Calibrate(calibrate::Args),
    /// Score the wrench of recordings against their truth
    Validate(validate::Args),
    /// Find where simulation and measurement differ, which effect causes it, and how far the gap shrinks
    Diagnose(diagnose::Args),
    /// Make a run directory from the simulator, with the truth beside it
    Simulate(simulate::Args),
    /// Print what makes a shell complete commands and options
    Completions(completions::Args),
}
