//! The daemon as systemd's service.

use crate::arm::{MODEL, SILENCE, ensure_published, forces, play};
use crate::systemd::{attempt, command, journal, main_process, now, property, run, wait, wait_until_active};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, IoContext, ensure};

const NEEDS: &[Need] = &[Need::Package];
const LIMIT: Duration = Duration::from_secs(180);
/// Priority of the cycle under SCHED_FIFO, as /proc numbers that policy.
const PRIORITY: &str = "50";
const FIFO: &str = "1";
/// What systemd is patient for when it stops the daemon.
const STOP_LIMIT: Duration = Duration::from_secs(10);
/// The largest exposure that is accepted, in tenths.
const EXPOSURE_TENTHS: &str = "20";

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario { name: "service::it_starts_at_boot_and_publishes", needs: NEEDS, limit: LIMIT, run: boot },
    Scenario { name: "service::it_has_the_rights_it_needs", needs: NEEDS, limit: LIMIT, run: rights },
    Scenario { name: "service::its_group_alone_gives_orders", needs: NEEDS, limit: LIMIT, run: group },
    Scenario { name: "service::killed_it_comes_back", needs: NEEDS, limit: LIMIT, run: killed },
    Scenario { name: "service::hung_it_comes_back", needs: NEEDS, limit: LIMIT, run: hung },
    Scenario {
        name: "service::an_interface_goes_and_comes_back",
        needs: NEEDS,
        limit: LIMIT,
        run: interface,
    },
    Scenario { name: "service::a_bad_model_changes_nothing", needs: NEEDS, limit: LIMIT, run: bad_model },
    Scenario { name: "service::it_stops_when_told", needs: NEEDS, limit: LIMIT, run: stop },
    Scenario { name: "service::its_unit_is_sound", needs: NEEDS, limit: LIMIT, run: unit },
];

/// Nobody has started it: what runs is what the boot started.
fn boot(guest: &Guest) -> Check {
    wait_until_active()?;
    let failed = run("systemctl list-units --failed --plain --no-legend")?.stdout();
    ensure!(failed.is_empty(), "units failed in this boot:\n{failed}");
    let cause = run("systemctl show --value --property=WantedBy wrenchd")?.stdout();
    ensure!(cause.trim() == "multi-user.target", "the unit is wanted by {cause}");
    ensure_published(guest)
}

/// A user of its own with real-time rights, locked memory and the whole receive buffer: the daemon warns where it lacks something.
fn rights(_: &Guest) -> Check {
    // User-mode Linux never sleeps deep. The kernel's log stands in, a device that the unit does not hand on otherwise, with the owner
    // and mode that the package's udev rule gives to the real one.
    run("mknod --mode=660 /dev/cpu_dma_latency c 1 11")?;
    run("chgrp wrenchd /dev/cpu_dma_latency")?;
    run("systemctl restart wrenchd")?;
    let process = PathBuf::from(format!("/proc/{}", main_process()?));
    let read = |path: PathBuf| fs::read_to_string(&path).at("read", &path);
    let status = read(process.join("status"))?;
    let field =
        |name: &str| status.lines().find_map(|line| line.strip_prefix(name)?.split_ascii_whitespace().next());
    let user: u32 = field("Uid:").unwrap_or_default().parse()?;
    ensure!((61184..=65519).contains(&user), "user {user} is not one that systemd made for it");
    ensure!(field("CapEff:") == Some("0000000000000000"), "it has capabilities: {status}");
    ensure!(field("VmLck:").is_some_and(|kib| kib != "0"), "its memory is not locked: {status}");
    let mut first = 0;
    for task in fs::read_dir(process.join("task")).at("read", &process)? {
        let stat = read(task?.path().join("stat"))?;
        // After the name, which ends with the last parenthesis: state is field 3, priority 40, policy 41.
        let fields: Vec<&str> = stat.rsplit(") ").next().unwrap_or_default().split(' ').collect();
        first += usize::from(fields.get(37..39) == Some(&[PRIORITY, FIFO][..]));
    }
    ensure!(first == 1, "{first} threads have SCHED_FIFO {PRIORITY}");
    let pid = main_process()?;
    let warned =
        run(&format!("journalctl --quiet --boot --output=cat --priority=warning _PID={pid}"))?.stdout();
    // Nothing plays.
    let expected = |line: &str| line.starts_with("no wrench: ");
    let lacks: Vec<&str> = warned.lines().filter(|line| !expected(line)).collect();
    ensure!(lacks.is_empty(), "it lacks something: {lacks:?}");
    Ok(())
}

fn group(guest: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    let _playing = play(guest)?;
    let valid = || Ok(attempt("runuser -u member -- wrenchctl status")?.code() == Some(0));
    wait("a member of the group sees a valid wrench", valid)?;
    run("runuser -u member -- wrenchctl reload")?;
    let refused = attempt("runuser -u stranger -- wrenchctl status")?.expect_code(2)?;
    ensure!(refused.stderr().contains("join the group"), "a stranger is told: {}", refused.text());
    Ok(())
}

/// Waits until another process than this one publishes.
fn wait_for_another(old: u32) -> Check {
    wait("systemd has started it again", || {
        let process = main_process()?;
        Ok(process != 0 && process != old && property("ActiveState")? == "active")
    })
}

fn killed(guest: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    let playing = play(guest)?;
    let (old, restarts) = (main_process()?, property("NRestarts")?.parse::<u32>()?);
    run("systemctl kill --kill-who=main --signal=KILL wrenchd")?;
    wait_for_another(old)?;
    let now = property("NRestarts")?.parse::<u32>()?;
    // More than one where the machine stands still for so long that the watchdog bites, too.
    ensure!(now > restarts, "systemd counts {now} restarts after {restarts}");
    drop(playing);
    ensure_published(guest)
}

/// A daemon that stands still is no better than a dead one.
fn hung(guest: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    let (old, since) = (main_process()?, now()?);
    run("systemctl kill --kill-who=main --signal=STOP wrenchd")?;
    wait_for_another(old)?;
    let said = journal(&since)?;
    ensure!(said.contains("Watchdog timeout"), "it was not the watchdog that ended it:\n{said}");
    ensure_published(guest)
}

fn interface(guest: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    let process = main_process()?;
    for name in ["vcan0", "vcan1"] {
        guest.delete_link(name)?;
        std::thread::sleep(Duration::from_secs(1));
        // It makes what is missing when it starts.
        run("systemctl restart systemd-networkd")?;
        let up = || Ok(attempt(&format!("ip link show up dev {name}"))?.stdout().contains(name));
        wait(&format!("networkd has brought {name} back"), up)?;
        ensure_published(guest)?;
    }
    ensure!(main_process()? == process, "it was restarted");
    Ok(())
}

/// Exchanges a file as an editor does.
fn replace(path: &Path, text: &str) -> Check {
    let new = path.with_extension("new");
    fs::write(&new, text).at("write", &new)?;
    fs::rename(&new, path).at("rename", &new)
}

fn bad_model(guest: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    let process = main_process()?;
    let path = Path::new(MODEL);
    let good = fs::read_to_string(path).at("read", path)?;
    for bad in [&good[..good.len() / 2], "", &good.replace("\"s1\"", "\"another\"")] {
        let since = now()?;
        replace(path, bad)?;
        run("systemctl reload wrenchd")?;
        let refused = || Ok(journal(&since)?.contains("not reloaded"));
        wait("the journal says that the model was refused", refused)?;
        // Who asks by the socket is told, too.
        let told = attempt("wrenchctl reload")?;
        ensure!(told.code() != Some(0) && told.text().contains("model.toml"), "reload says: {}", told.text());
        replace(path, &good)?;
    }
    let since = now()?;
    run("systemctl reload wrenchd")?;
    let taken = || Ok(journal(&since)?.lines().any(|line| line.starts_with("reloaded ")));
    wait("the good model is taken", taken)?;
    ensure_published(guest)?;
    ensure!(main_process()? == process, "it was restarted");
    Ok(())
}

fn stop(guest: &Guest) -> Check {
    run("systemctl start wrenchd")?;
    let playing = play(guest)?;
    let capture = guest.capture("vcan1")?;
    std::thread::sleep(Duration::from_secs(2));
    let asked = Instant::now();
    process::run(&mut command("systemctl stop wrenchd")?, STOP_LIMIT)?;
    let took = asked.elapsed();
    let ended = (property("Result")?, property("ExecMainStatus")?, property("ActiveState")?);
    ensure!(ended == ("success".into(), "0".into(), "inactive".into()), "it ended with {ended:?}");
    ensure!(took < STOP_LIMIT / 2, "it took {took:?} to stop");
    // Silent from here on, though the arm goes on.
    let forces = forces(&capture.stop()?.lines)?;
    let good = forces.iter().filter(|force| force.status & SILENCE == 0).count();
    ensure!(good > 0, "it had published none of {} wrenches before", forces.len());
    let last = forces.last().map(|force| force.status);
    ensure!(last == Some(SILENCE), "its last word is the status {last:?}");
    ensure!(!Path::new("/run/wrenchd").exists(), "it leaves /run/wrenchd behind");
    drop(playing);
    Ok(())
}

fn unit(_: &Guest) -> Check {
    ensure_sound("wrenchd")
}

/// systemd finds no fault with a unit, and little that it could be denied besides.
pub(crate) fn ensure_sound(unit: &str) -> Check {
    let verified = attempt(&format!("systemd-analyze verify /usr/lib/systemd/system/{unit}.service"))?;
    ensure!(verified.code() == Some(0) && verified.text().is_empty(), "verify says: {}", verified.text());
    let exposure =
        format!("systemd-analyze security --no-pager --threshold={EXPOSURE_TENTHS} {unit}.service");
    let said = attempt(&exposure)?;
    let level = said.text().lines().find(|line| line.contains("Overall exposure level")).map(str::to_owned);
    println!("  {}", level.as_deref().unwrap_or("no exposure level"));
    ensure!(level.is_some() && said.code() == Some(0), "the unit is exposed:\n{}", said.text());
    Ok(())
}
