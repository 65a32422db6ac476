//! `wrenchd`: the daemon's command line.

#[cfg(target_os = "linux")]
fn main() -> std::process::ExitCode {
    program::main()
}

#[cfg(not(target_os = "linux"))]
fn main() -> std::process::ExitCode {
    use std::io::Write;
    let said = "SocketCAN exists on Linux only; `wrenchctl demo` runs here";
    let _ = writeln!(std::io::stderr(), "wrenchd: error: {said}");
    std::process::ExitCode::from(2)
}

#[cfg(target_os = "linux")]
mod program {
    use std::io::Write;
    use std::process::ExitCode;

    use clap::Parser;
    use wrenchd::arguments::Arguments;
    use wrenchd::service::{self, Options, log};

    pub(super) fn main() -> ExitCode {
        let Arguments { config, model, record } = Arguments::parse();
        log::start();
        service::run(&Options { config, model, record }).unwrap_or_else(|error| {
            let priority = if log::to_journal() { "<3>" } else { "" };
            // The exit status tells it even where standard error takes nothing.
            let _ = writeln!(std::io::stderr(), "{priority}wrenchd: error: {error}");
            ExitCode::from(2)
        })
    }
}
