//! The package's later life: exchanged while the daemon runs, and taken off.

use crate::arm::{CONFIG, ensure_published};
use crate::first::dpkg_install;
use crate::systemd::{STEP, attempt, main_process, property, run, wait_until_active};
use std::path::Path;
use std::process::Command;
use std::time::Duration;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, ensure};

const NEEDS: &[Need] = &[Need::Package];
const LIMIT: Duration = Duration::from_secs(180);

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario { name: "package::the_tools_are_described", needs: NEEDS, limit: LIMIT, run: described },
    Scenario { name: "package::another_version_takes_over", needs: NEEDS, limit: LIMIT, run: upgrade },
    // The last: nothing of it is left.
    Scenario { name: "package::removed_it_is_gone", needs: NEEDS, limit: LIMIT, run: remove },
];

/// Every command that the tool has is in its manual, with a page of its own, and the shell completes it.
fn described(_: &Guest) -> Check {
    let page = run("zcat /usr/share/man/man1/wrenchctl.1.gz")?.stdout();
    let help = run("wrenchctl --help")?.stdout();
    let commands: Vec<&str> = help
        .lines()
        .skip_while(|line| !line.starts_with("Commands:"))
        .skip(1)
        .map_while(|line| line.strip_prefix("  "))
        // What goes on in a second line is set in further.
        .filter(|line| !line.starts_with([' ']))
        .filter_map(|line| line.split_ascii_whitespace().next())
        .filter(|command| *command != "help")
        .collect();
    ensure!(commands.len() > 10, "wrenchctl --help names {commands:?}");
    for command in commands {
        ensure!(page.contains(&format!("wrenchctl\\-{command}(1)")), "the manual lacks {command}");
        run(&format!("zcat /usr/share/man/man1/wrenchctl-{command}.1.gz"))?;
    }
    let completed = "source /usr/share/bash-completion/completions/wrenchctl
        COMP_WORDS=(wrenchctl cali) COMP_CWORD=1
        _wrenchctl wrenchctl cali wrenchctl
        echo ${COMPREPLY[@]}";
    let mut bash = Command::new("bash");
    let said = process::run(bash.args(["-c", completed]), STEP)?.stdout();
    ensure!(said == "calibrate\n", "bash completes cali as {said:?}");
    Ok(())
}

fn upgrade(guest: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    let old = main_process()?;
    dpkg_install()?;
    wait_until_active()?;
    ensure!(main_process()? != old, "the old program still runs");
    ensure_published(guest)
}

fn remove(_: &Guest) -> Check {
    let listed = run("dpkg --listfiles wrenchd")?.stdout();
    process::run(Command::new("dpkg").args(["--purge", "wrenchd"]), 2 * STEP)?;
    ensure!(property("LoadState")? == "not-found", "systemd still knows the unit");
    ensure!(attempt("pidof wrenchd")?.stdout().is_empty(), "the daemon still runs");
    let left: Vec<&str> = listed.lines().filter(|path| Path::new(path).is_file()).collect();
    ensure!(left.is_empty(), "files are left: {left:?}");
    // What people wrote is theirs.
    ensure!(Path::new(CONFIG).exists(), "{CONFIG} is gone");
    Ok(())
}
