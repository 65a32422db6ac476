//! What controllers and queues say: error frames, bus-off, and no room to send.

use crate::live::{Totals, wait_for_silence};
use crate::published::{self, DEGRADED, INVALID, STALE, ensure_equal, pair};
use crate::rig::{Arm, Form, Player};
use crate::service::held;
use can::frame::Frame;
use can::socket::SocketSender;
use std::process::Command;
use std::time::{Duration, Instant};
use wrenchd_tests::candump;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::{self, Program};
use wrenchd_tests::programs::programs;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, Failure, ensure};

const NEEDS: &[Need] = &[Need::Programs, Need::Python];
const LIMIT: Duration = Duration::from_secs(120);
const STEP: Duration = Duration::from_secs(20);
/// A controller's life (`linux/can/error.h`): it warns, is passive, leaves the bus, and comes back.
const LIFE: [(u32, [u8; 8]); 4] = [
    (0x204, [0, 0x08, 0, 0, 0, 0, 96, 0]),
    (0x204, [0, 0x20, 0, 0, 0, 0, 128, 0]),
    (0x240, [0, 0, 0, 0, 0, 0, 248, 0]),
    (0x100, [0; 8]),
];
const LIVES: usize = 25;

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario { name: "errors::error_frames_change_no_wrench", needs: NEEDS, limit: LIMIT, run: error_frames },
    Scenario {
        name: "errors::a_full_queue_is_counted_and_passes",
        needs: NEEDS,
        limit: LIMIT,
        run: full_queue,
    },
];

/// The daemon's counter of this name, as its status has it.
fn counter(arm: &Arm, name: &str) -> Check<u64> {
    let mut command = Command::new(&programs()?.wrenchctl);
    command.args(["status", "--json", "-", "--config"]).arg(&arm.config);
    // 1: no wrench just now.
    let said = Program::start(&mut command)?.finish(STEP)?.stdout();
    let status: serde_json::Value = serde_json::from_str(&said)?;
    let value = status.pointer(&format!("/totals/{name}")).and_then(serde_json::Value::as_u64);
    value.ok_or_else(|| Failure::new(format!("no {name} in {status}")))
}

fn error_frames(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let run = arm.to_play(guest, &held(&arm, 1000)?)?;
    let recording = guest.dir().join("recorded.log");
    let far = guest.capture("vcan1")?;
    let mut daemon = arm.daemon(guest, Some(&recording))?;
    let playing = Program::start(&mut Player::Wrenchctl.command(&run)?)?;
    let mut sender = SocketSender::open("vcan0")?;
    for (class, data) in std::iter::repeat_n(LIFE, LIVES).flatten() {
        let frame = Frame::error(class, &data).ok_or_else(|| Failure::new("a class of 29 bits"))?;
        ensure!(sender.send(&[frame]) == 1, "the error frame was not sent");
        std::thread::sleep(Duration::from_millis(50));
    }
    // With what else came since the daemon looked last, in one line.
    daemon.wait_for("bus off: the interface needs restart-ms", STEP)?;
    playing.finish(STEP)?.expect_code(0)?;
    wait_for_silence(guest)?;
    let counted = counter(&arm, "bus_errors")?;
    ensure!(counted == (LIVES * LIFE.len()) as u64, "the daemon counts {counted} error frames");
    let said = daemon.text();
    Totals::stop(daemon)?;
    // Each kind when it first comes; the same again not for each frame.
    let lines = said.lines().filter(|line| line.contains("error frames from vcan0")).count();
    ensure!((2..=8).contains(&lines), "{lines} lines about {counted} error frames:\n{said}");
    let records = published::decode(&far.stop()?)?;
    let recorded = candump::read(&recording)?;
    let offline = arm.offline(guest, &recording, &arm.model)?;
    let pairs = pair(&records, &offline, &recorded)?;
    ensure!(pairs.len() > 990, "1000 rounds gave {} wrenches", pairs.len());
    ensure_equal(&pairs)
}

/// A link that lets 60 frames a second through and keeps four waiting.
fn narrow(link: &str) -> Check {
    let words = format!("qdisc add dev {link} root tbf rate 8kbit burst 32 limit 64");
    tc(&words)
}

fn tc(words: &str) -> Check {
    process::run(Command::new("tc").args(words.split(' ')), STEP).map(drop)
}

fn full_queue(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let run = arm.to_play(guest, &held(&arm, 6000)?)?;
    let daemon = arm.daemon(guest, None)?;
    let playing = Program::start(&mut Player::Wrenchctl.command(&run)?)?;
    std::thread::sleep(Duration::from_secs(1));
    narrow("vcan1")?;
    let before = counter(&arm, "unsent")?;
    std::thread::sleep(Duration::from_secs(2));
    let unsent = counter(&arm, "unsent")? - before;
    tc("qdisc del dev vcan1 root")?;
    // 375 frames a second are due, 60 go.
    ensure!(unsent > 200, "the queue was full for 2 s, and {unsent} frames are counted as not sent");
    // A host that stands still makes inputs stale: once it goes on, wrenches are good again.
    let until = Instant::now() + STEP;
    while let Err(failure) = ensure_good(guest) {
        if Instant::now() > until {
            return Err(failure);
        }
    }
    drop(playing);
    let totals = Totals::stop(daemon)?;
    totals.expect("lost_frames", 0)
}

/// A second of whole records, nearly all good.
fn ensure_good(guest: &Guest) -> Check {
    let far = guest.capture("vcan1")?;
    std::thread::sleep(Duration::from_secs(1));
    let records = published::decode_cut(&far.stop_at_once()?)?;
    let good = records.iter().filter(|record| record.status & (INVALID | DEGRADED | STALE) == 0).count();
    ensure!(good >= 60 && 10 * good > 8 * records.len(), "{good} of {} records are good", records.len());
    Ok(())
}
