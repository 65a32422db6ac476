//! systemd, asked and told.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};
use wrenchd_tests::process::{self, Finished, Program};
use wrenchd_tests::{Check, Failure, IoContext, ensure};

pub(crate) const STEP: Duration = Duration::from_secs(30);

/// Runs a command line whose words hold no blanks; it must end well.
pub(crate) fn run(line: &str) -> Check<Finished> {
    process::run(&mut command(line)?, STEP)
}

/// The same, whatever it ends with.
pub(crate) fn attempt(line: &str) -> Check<Finished> {
    Program::start(&mut command(line)?)?.finish(STEP)
}

pub(crate) fn command(line: &str) -> Check<Command> {
    let mut words = line.split_ascii_whitespace();
    let mut command = Command::new(words.next().ok_or_else(|| Failure::new("an empty command"))?);
    command.args(words);
    Ok(command)
}

/// A property of the unit.
pub(crate) fn property(name: &str) -> Check<String> {
    Ok(run(&format!("systemctl show --value --property={name} wrenchd"))?.stdout().trim().to_owned())
}

/// The daemon's process.
pub(crate) fn main_process() -> Check<u32> {
    Ok(property("MainPID")?.parse()?)
}

/// What the unit has said in this boot since a moment, a line each.
pub(crate) fn journal(since: &str) -> Check<String> {
    // What has been said may still be on its way.
    run("journalctl --sync")?;
    Ok(run(&format!("journalctl --quiet --boot --unit=wrenchd --output=cat --after-cursor={since}"))?
        .stdout())
}

/// Now, for [`journal`].
pub(crate) fn now() -> Check<String> {
    run("journalctl --sync")?;
    let said = run("journalctl --quiet --boot --lines=1 --show-cursor --output=cat")?.stdout();
    let cursor = said.lines().find_map(|line| line.strip_prefix("-- cursor: "));
    cursor.map(str::to_owned).ok_or_else(|| Failure::new(format!("no cursor in {said}")))
}

/// Waits until a condition holds.
pub(crate) fn wait(what: &str, mut holds: impl FnMut() -> Check<bool>) -> Check {
    let deadline = Instant::now() + STEP;
    while !holds()? {
        ensure!(Instant::now() < deadline, "{what} within {} s: no", STEP.as_secs());
        std::thread::sleep(Duration::from_millis(100));
    }
    Ok(())
}

/// Waits until the daemon has said that it publishes.
pub(crate) fn wait_until_active() -> Check {
    wait("wrenchd is active", || Ok(property("ActiveState")? == "active"))
}

/// Puts the journal beside a scenario's files.
pub(crate) fn keep_journal(dir: &Path) -> Check {
    let path = dir.join("journal.txt");
    fs::write(&path, run("journalctl --boot --no-pager")?.stdout()).at("write", &path)
}
