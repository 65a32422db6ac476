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
    use std::process::ExitCode;

    use clap::Parser;
    use wrenchd::arguments::Arguments;
    use wrenchd::service::{self, Options, log};

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
