//! `wrenchd`: the daemon's command line.

#[cfg(target_os = "linux")]
fn main() -> std::process::ExitCode {
    program::main()
}

#[cfg(not(target_os = "linux"))]
fn main() -> std::process::ExitCode {
    eprintln!("wrenchd: error: SocketCAN exists on Linux only; `wrenchctl demo` runs here");
    std::process::ExitCode::from(2)
}

#[cfg(target_os = "linux")]
mod program {
    use std::path::PathBuf;
    use std::process::ExitCode;

    use clap::Parser;
    use wrenchd::service::{self, Options, log};

    /// End-effector wrench from joint torque sensors over SocketCAN, in real time
    ///
    /// SIGHUP reads configuration and model again and keeps the old ones if the new are bad; SIGTERM stops cleanly.
    /// Exit status: 0 stopped cleanly, 1 failed while running, 2 unusable input or arguments.
    #[derive(Parser)]
    #[command(version)]
    struct Arguments {
        /// The robot's configuration (TOML)
        #[arg(long, value_name = "FILE")]
        config: PathBuf,
        /// The calibrated model; overrides the configuration's
        #[arg(long, value_name = "FILE")]
        model: Option<PathBuf>,
        /// Record every received frame with its kernel stamp (candump -L; .gz and .zst compress)
        #[arg(long, value_name = "LOG")]
        record: Option<PathBuf>,
    }

    pub(super) fn main() -> ExitCode {
        let Arguments { config, model, record } = Arguments::parse();
        log::start();
        service::run(&Options { config, model, record }).unwrap_or_else(|error| {
            let priority = if log::to_journal() { "<3>" } else { "" };
            eprintln!("{priority}wrenchd: error: {error}");
            ExitCode::from(2)
        })
    }
}
