//! The daemon on a live bus: a recording goes in on vcan0, wrench frames come out on vcan1, and both are judged by programs that are
//! not the project's own.

use crate::rig::{Arm, Form, Input, Live, Player, Published};
use std::time::Duration;
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::{Guest, ensure_same_frames};
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, Failure, ensure};

const NEEDS: &[Need] = &[Need::Programs, Need::Python];
const LIMIT: Duration = Duration::from_secs(180);

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario {
        name: "daemon::a_replayed_recording_gives_the_offline_wrench",
        needs: NEEDS,
        limit: LIMIT,
        run: replayed,
    },
    Scenario { name: "daemon::canplayer_gives_the_offline_wrench", needs: NEEDS, limit: LIMIT, run: played },
    Scenario { name: "daemon::can_fd_gives_the_offline_wrench", needs: NEEDS, limit: LIMIT, run: fd },
    Scenario {
        name: "daemon::a_minute_at_1000_hz_loses_nothing",
        needs: NEEDS,
        limit: Duration::from_secs(600),
        run: minute,
    },
];

fn replayed(guest: &Guest) -> Check {
    live_equals_offline(guest, Form::Classical, Player::Wrenchctl)
}

fn played(guest: &Guest) -> Check {
    live_equals_offline(guest, Form::Classical, Player::Canplayer)
}

fn fd(guest: &Guest) -> Check {
    live_equals_offline(guest, Form::Fd, Player::Canplayer)
}

fn live_equals_offline(guest: &Guest, form: Form, player: Player) -> Check {
    let arm = Arm::new(guest, form)?;
    let lines = arm.recording()?;
    let live = Live::run(guest, &arm, player, Input::Captured, &lines)?;
    ensure_same_frames(&lines, &live.received()?.lines)?;
    let published = live.published()?;
    ensure!(published.len() > 1000, "10 s at 125 Hz gave {} wrenches only", published.len());
    let valid = published.iter().filter(|wrench| wrench.is_valid()).count();
    ensure!(2 * valid > published.len(), "of {} wrenches {valid} are valid", published.len());
    // The recording holds a push and a motion under load: a wrench that stays at zero would be wrong.
    let largest = published
        .iter()
        .filter(|wrench| wrench.is_valid())
        .map(|wrench| wrench.force_n())
        .fold(0.0, f64::max);
    ensure!(
        (3.0..8.0).contains(&largest),
        "the recording holds pushes of up to 5 N, the largest published is {largest} N"
    );
    compare(&published, &arm.offline(guest, &live.received()?.path)?)
}

/// In event mode every wrench pairs, in order, with the offline one, within one count of the frame's scaling.
fn compare(live: &[Published], offline: &[Published]) -> Check {
    ensure!(live.len() == offline.len(), "{} wrenches live, {} offline", live.len(), offline.len());
    for (at, (live, offline)) in live.iter().zip(offline).enumerate() {
        let (a, b) = (live.status, offline.status);
        ensure!(a == b, "wrench {at}: status {a:#04x} live, {b:#04x} offline");
        if !live.is_valid() {
            continue;
        }
        for (axis, (a, b)) in live.wrench.iter().zip(offline.wrench).enumerate() {
            let count = if axis < 3 { 0.01 } else { 0.001 };
            // Half a count is the rounding itself.
            ensure!((a - b).abs() <= count, "wrench {at}, axis {axis}: {a} live, {b} offline");
        }
    }
    Ok(())
}

fn minute(guest: &Guest) -> Check {
    const ROUNDS: usize = 60_000;
    let arm = Arm::new(guest, Form::Classical)?;
    // A push in a held pose: played faster than it was recorded, a motion would be another one.
    let pieces = candump::rounds(&arm.recording()?);
    let lines: Vec<Line> = candump::repeated(pieces.get(..200).unwrap_or(&pieces), ROUNDS, 1000);
    let live = Live::run(guest, &arm, Player::Wrenchctl, Input::Counted, &lines)?;
    ensure!(
        live.carried == lines.len() as u64,
        "{} frames were to be sent, vcan0 carried {}",
        lines.len(),
        live.carried
    );
    let published = live.published()?;
    ensure!(published.len() == ROUNDS, "{ROUNDS} rounds gave {} wrenches", published.len());
    let degraded = published.iter().position(|wrench| wrench.status & 0b1011 != 0);
    if let Some(at) = degraded.filter(|at| *at > ROUNDS / 100) {
        let status = published[at].status;
        return Err(Failure::new(format!("wrench {at} of a complete recording has status {status:#04x}")));
    }
    println!("  {ROUNDS} rounds meant for 1000 Hz came at {:.0} Hz", live.rate_hz(ROUNDS));
    Ok(())
}
