//! Who speaks to the daemon over sockets: Net F/T clients that others wrote, and the tool with its orders.

use crate::live::Totals;
use crate::published;
use crate::rig::{Arm, Form, Player};
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};
use wrenchd_tests::candump;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::{self, Finished, Program};
use wrenchd_tests::programs::programs;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, Failure, ensure, python};

const LIMIT: Duration = Duration::from_secs(180);
const STEP: Duration = Duration::from_secs(60);
const PERIOD_NS: i64 = 8_000_000;
const HTTP_PORT: &str = "8049";
/// Half a step of the wrench frames and the rounding of their own, N and Nm.
const TOLERANCE: [f64; 6] = [0.0051, 0.0051, 0.0051, 0.00051, 0.00051, 0.00051];
/// The force of the rounds that are played, N, within half a newton.
const FORCE_N: f64 = 2.9;

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario {
        name: "clients::net_ft_clients_read_the_wrench",
        needs: &[Need::Programs, Need::Python],
        limit: LIMIT,
        run: net_ft,
    },
    Scenario { name: "clients::the_tool_gives_orders", needs: &[Need::Programs], limit: LIMIT, run: orders },
];

/// A run directory with a minute of the arm in a held pose under nearly the same force.
fn held(guest: &Guest, arm: &Arm) -> Check<PathBuf> {
    let pieces = candump::rounds(&arm.recording()?);
    let held = pieces.get(90..130).ok_or_else(|| Failure::new("a short recording"))?;
    arm.to_play(guest, &candump::repeated(held, 7500, PERIOD_NS))
}

fn net_ft(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    arm.configure(&format!(
        "\n[publish.rdt]\nbind = \"127.0.0.1:49152\"\nhttp = \"127.0.0.1:{HTTP_PORT}\"\n"
    ))?;
    let played = held(guest, &arm)?;
    let far = guest.capture("vcan1")?;
    let daemon = arm.daemon(guest, None)?;
    let playing = Program::start(&mut Player::Wrenchctl.command(&played)?)?;
    std::thread::sleep(Duration::from_secs(1));
    let said = process::run(python::script("rdt_clients.py")?.arg(HTTP_PORT), STEP)?.stdout();
    drop(playing);
    Totals::stop(daemon)?;
    let on_can = published::decode(&far.stop()?)?;
    let mut counts = [0; 4];
    for line in said.lines() {
        let (how, wrench) = record(line)?;
        let number = ["polled", "streamed", "client", "biased"].iter().position(|name| *name == how);
        counts[number.ok_or_else(|| Failure::new(format!("the clients said {line}")))?] += 1;
        let same = |a: &[f64; 6]| (0..6).all(|axis| (a[axis] - wrench[axis]).abs() <= TOLERANCE[axis]);
        ensure!(
            on_can.iter().any(|record| record.is_valid() && same(&record.wrench)),
            "no record on CAN says what a client got: {line}"
        );
    }
    ensure!(
        counts == [20, 100, 200, 1],
        "records polled, streamed, by the second client, biased: {counts:?}"
    );
    Ok(())
}

/// How a record was got, and its wrench.
fn record(line: &str) -> Check<(String, [f64; 6])> {
    let mut words = line.split(' ');
    let how = words.next().unwrap_or_default().to_owned();
    let numbers = words.skip(1).map(str::parse).collect::<Result<Vec<f64>, _>>()?;
    let wrench = numbers.try_into().map_err(|_| Failure::new(format!("not a record: {line}")))?;
    Ok((how, wrench))
}

/// Asks `wrenchctl` to do something with the arm's daemon; it must end with this status. What it said.
fn order(arm: &Arm, words: &[&str], code: i32) -> Check<String> {
    Ok(asked(arm, words)?.expect_code(code)?.text())
}

fn asked(arm: &Arm, words: &[&str]) -> Check<Finished> {
    let mut command = Command::new(&programs()?.wrenchctl);
    command.args(words).arg("--config").arg(&arm.config);
    Program::start(&mut command)?.finish(STEP)
}

/// Waits until the daemon's status shows a force like this, N. Where the machine keeps frames back an instant may be invalid.
fn wait_for_force(arm: &Arm, wanted_n: std::ops::Range<f64>) -> Check {
    let deadline = Instant::now() + STEP;
    loop {
        let said = asked(arm, &["status", "--json", "-"])?;
        let status: serde_json::Value = serde_json::from_str(&said.stdout())?;
        let wrench = status.pointer("/live/wrench").and_then(serde_json::Value::as_array).cloned();
        let force: Vec<f64> =
            wrench.unwrap_or_default().iter().take(3).filter_map(serde_json::Value::as_f64).collect();
        let force_n = force.iter().map(|value| value * value).sum::<f64>().sqrt();
        if force.len() == 3 && wanted_n.contains(&force_n) {
            return Ok(());
        }
        ensure!(Instant::now() < deadline, "the force stays at {force_n} N, {wanted_n:?} is due: {status}");
    }
}

fn orders(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let played = held(guest, &arm)?;
    let said = order(&arm, &["status"], 2)?;
    ensure!(said.contains("control.sock"), "without a daemon it says: {said}");
    let daemon = arm.daemon(guest, None)?;
    let playing = Program::start(&mut Player::Wrenchctl.command(&played)?)?;
    let felt = FORCE_N - 0.6..FORCE_N + 0.6;
    wait_until_valid(&arm)?;
    wait_for_force(&arm, felt.clone())?;
    order(&arm, &["tare"], 0)?;
    wait_for_force(&arm, 0.0..0.6)?;
    order(&arm, &["untare"], 0)?;
    wait_for_force(&arm, felt.clone())?;
    // A kilogram that is not there is missed.
    order(&arm, &["payload", "1.0", "0", "0", "0.05"], 0)?;
    wait_for_force(&arm, 6.0..13.5)?;
    order(&arm, &["reload"], 0)?;
    wait_for_force(&arm, 6.0..13.5)?;
    order(&arm, &["payload", "0"], 0)?;
    wait_for_force(&arm, felt)?;
    drop(playing);
    Totals::stop(daemon)?.expect("lost_frames", 0)
}

fn wait_until_valid(arm: &Arm) -> Check {
    let deadline = Instant::now() + STEP;
    loop {
        let mut command = Command::new(&programs()?.wrenchctl);
        command.arg("status").arg("--config").arg(&arm.config);
        if Program::start(&mut command)?.finish(STEP)?.code() == Some(0) {
            return Ok(());
        }
        ensure!(Instant::now() < deadline, "the daemon has no valid wrench");
    }
}
