//! The first boot: the package is installed and the arm described; the next boot finds both.

use crate::arm;
use crate::systemd::{attempt, property, run};
use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, IoContext, ensure, package, process};

pub(crate) const SCENARIO: Scenario = Scenario {
    name: "first::the_package_installs",
    needs: &[Need::Package],
    limit: Duration::from_secs(400),
    run: install,
};
const DPKG_LIMIT: Duration = Duration::from_secs(120);
const EXAMPLES: &str = "/usr/share/doc/wrenchd/examples";
const NETWORK: &str = "/etc/systemd/network";

/// Installs the daemon's package with dpkg alone: all that it depends on is there.
pub(crate) fn dpkg_install() -> Check {
    dpkg_install_file(package::package()?)
}

/// The same with another package.
pub(crate) fn dpkg_install_file(package: &Path) -> Check {
    let mut command = Command::new("dpkg");
    command.arg("--install").arg(package).env("DEBIAN_FRONTEND", "noninteractive");
    process::run(&mut command, DPKG_LIMIT).map(drop)
}

fn install(_: &Guest) -> Check {
    dpkg_install()?;
    ensure!(run("systemctl is-enabled wrenchd")?.stdout() == "enabled\n", "the unit is not enabled");
    // Nothing is known of the arm: it waits, and that is no failure.
    let state = (property("ActiveState")?, property("ConditionResult")?);
    ensure!(state == ("inactive".into(), "no".into()), "without a configuration the unit is {state:?}");
    ensure!(
        attempt("systemctl is-failed wrenchd")?.code() != Some(0),
        "without a configuration it has failed"
    );
    run("getent group wrenchd")?;
    run("useradd --groups wrenchd member")?;
    run("useradd stranger")?;
    for name in ["vcan0", "vcan1"] {
        for kind in ["netdev", "network"] {
            let example = Path::new(EXAMPLES).join(format!("80-vcan0.{kind}"));
            let text = fs::read_to_string(&example).at("read", &example)?;
            let path = Path::new(NETWORK).join(format!("80-{name}.{kind}"));
            fs::write(&path, text.replace("Name=vcan0", &format!("Name={name}"))).at("write", &path)?;
        }
    }
    arm::configure()?;
    run(&format!("wrenchctl check {}", arm::CONFIG)).map(drop)
}
