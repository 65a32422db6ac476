//! Sending frames beside the field's senders, in the same boot of the CAN machine as what [`crate::wire`] measures.
//!
//! The daemon's sender takes frames that are there, as python-can does; `wrenchctl replay` reads them from a log as fast as it goes, as canplayer does:
//! both programs from their start to their end.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use can::frame::Frame;
use can::socket::SocketSender;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process;
use wrenchd_tests::programs::programs;
use wrenchd_tests::{Check, IoContext, ensure};

use crate::peers;
use crate::table::{Compared, Line};

const FRAMES: u32 = 50_000;
const RUNS: usize = 5;
const STEP: Duration = Duration::from_secs(120);
const LINK: &str = "vcan0";
/// The names that the values are noted by.
const NAMES: [&str; 4] = ["send-ours", "send-python", "replay", "canplayer"];

/// The table's lines, of the values that were noted.
pub(crate) fn lines(take: impl Fn(&str) -> Check<Vec<f64>>) -> Check<Vec<Line>> {
    let sent = Compared { what: "sending frames, time", peer: "python-can", unit: "us a frame", goal: "" };
    let what = "sending a log as fast as it goes, time";
    let played = Compared { what, peer: "canplayer -t", unit: "us a frame", goal: "" };
    let [ours, python, replay, canplayer] = NAMES;
    Ok(vec![sent.cost(&take(ours)?, &take(python)?), played.cost(&take(replay)?, &take(canplayer)?)])
}

/// Each in turn, us a frame.
pub(crate) fn inside(guest: &Guest, python: &Path, note: &mut impl FnMut(&str, &[f64])) -> Check {
    let log = log(guest)?;
    let mut took: [Vec<f64>; 4] = Default::default();
    for _ in 0..RUNS {
        took[0].push(carried(guest, ours)?);
        took[1].push(carried(guest, || by_python(python))?);
        took[2].push(carried(guest, || replay(&log))?);
        took[3].push(carried(guest, || canplayer(&log))?);
    }
    NAMES.iter().zip(&took).for_each(|(name, took)| note(name, took));
    Ok(())
}

/// Fails unless the link has carried every frame.
fn carried(guest: &Guest, send: impl FnOnce() -> Check<f64>) -> Check<f64> {
    let before = guest.carried(LINK)?;
    let took = send()?;
    let carried = guest.carried(LINK)? - before;
    ensure!(carried == u64::from(FRAMES), "{carried} of {FRAMES} frames were carried");
    Ok(took)
}

fn log(guest: &Guest) -> Check<PathBuf> {
    let path = guest.dir().join("to_send.log");
    let mut text = Vec::new();
    for k in 0..FRAMES {
        writeln!(text, "({}.{:06}) can0 101#0102030405060708", 1_790_000_000 + k / 1000, k % 1000 * 1000)?;
    }
    std::fs::write(&path, text).at("write", &path)?;
    Ok(path)
}

fn per_frame_us(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e6 / f64::from(FRAMES)
}

fn ours() -> Check<f64> {
    let mut sender = SocketSender::open(LINK)?;
    let frames: Vec<Frame> = vec![crate::wire::filler()?; FRAMES as usize];
    let begun = Instant::now();
    let sent = sender.send(&frames);
    let took = per_frame_us(begun);
    ensure!(sent == frames.len(), "{sent} of {FRAMES} frames were taken");
    Ok(took)
}

fn by_python(python: &Path) -> Check<f64> {
    let mut command = Command::new(python);
    command.arg(peers::sources().join("send.py")).arg(LINK).arg(FRAMES.to_string());
    Ok(process::run(&mut command, STEP)?.stdout().trim().parse()?)
}

fn replay(log: &Path) -> Check<f64> {
    let mut command = Command::new(&programs()?.wrenchctl);
    command.arg("replay").arg(log).args(["--onto", LINK, "--speed", "max"]);
    whole(&mut command)
}

fn canplayer(log: &Path) -> Check<f64> {
    let mut command = Command::new("canplayer");
    command.args(["-t", "-I"]).arg(log).arg(format!("{LINK}=can0"));
    whole(&mut command)
}

fn whole(command: &mut Command) -> Check<f64> {
    let begun = Instant::now();
    process::run(command, STEP)?;
    Ok(per_frame_us(begun))
}
