//! The bridge to ROS 2 as a service beside the daemon's.

use crate::arm::CONFIG;
use crate::first::dpkg_install_file;
use crate::service::ensure_sound;
use crate::systemd::{STEP, attempt, run, wait, wait_until_active};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, IoContext, ensure, package, process};

const UNIT: &str = "wrenchd-ros2";
const TABLE: &str = "\n[publish.ros2]\ntopic = \"wrench\"\n";

pub(crate) const SCENARIOS: &[Scenario] = &[Scenario {
    name: "bridge::its_service_hears_the_daemon",
    needs: &[Need::Package],
    limit: Duration::from_secs(240),
    run: bridge,
}];

/// A property of the bridge's unit.
fn property(name: &str) -> Check<String> {
    Ok(run(&format!("systemctl show --value --property={name} {UNIT}"))?.stdout().trim().to_owned())
}

/// Clients of the control socket, as the kernel has them.
fn listeners() -> Check<usize> {
    let said = run("ss -xH state connected src /run/wrenchd/control.sock")?.stdout();
    Ok(said.lines().count())
}

fn bridge(_: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    wait_until_active()?;
    dpkg_install_file(&package::bridge()?)?;
    ensure!(run(&format!("systemctl is-enabled {UNIT}"))?.stdout() == "enabled\n", "the unit is not enabled");
    // Without its table it says so, and tries again.
    let said = || -> Check<String> {
        Ok(run(&format!("journalctl --quiet --boot --unit={UNIT} --output=cat"))?.stdout())
    };
    wait("the journal says what is missing", || Ok(said()?.contains("has no [publish.ros2] table")))?;
    let text = fs::read_to_string(CONFIG).at("read", Path::new(CONFIG))?;
    fs::write(CONFIG, format!("{text}{TABLE}")).at("write", Path::new(CONFIG))?;
    // Records and status, each by a connection of its own.
    wait("the bridge listens to the daemon", || Ok(listeners()? == 2))?;
    let process = property("MainPID")?;
    run("systemctl restart wrenchd")?;
    wait_until_active()?;
    wait("it listens to the next daemon", || Ok(listeners()? == 2))?;
    ensure!(property("MainPID")? == process, "the bridge was restarted with the daemon");
    ensure_sound(UNIT)?;
    fs::write(CONFIG, text).at("write", Path::new(CONFIG))?;
    process::run(Command::new("dpkg").args(["--purge", UNIT]), 2 * STEP)?;
    ensure!(property("LoadState")? == "not-found", "systemd still knows the unit");
    ensure!(attempt("pidof wrenchd-ros2")?.stdout().is_empty(), "the bridge still runs");
    Ok(())
}
