//! Arm A as the installed daemon's arm: its files in /etc/wrenchd, its recording played onto vcan0, its wrenches taken from vcan1.

use crate::systemd::STEP;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::{self, Program};
use wrenchd_tests::{Check, Failure, IoContext, ensure};

pub(crate) const CONFIG: &str = "/etc/wrenchd/wrenchd.toml";
pub(crate) const MODEL: &str = "/etc/wrenchd/model.toml";
const FOLDER: &str = "/etc/wrenchd";
const CALIBRATE_LIMIT: Duration = Duration::from_secs(180);
const PERIOD_NS: i64 = 8_000_000;
/// Rounds of the recording in a held pose, in which a push rises from 3 N to 5 N and falls again: 2.5 s to and fro.
const PUSHED_ROUNDS: std::ops::Range<usize> = 120..280;
const PUSH_N: std::ops::Range<f64> = 4.5..6.0;
const INVALID: u8 = 1;
const STALE: u8 = 1 << 3;
/// What a daemon says that hears nothing.
pub(crate) const SILENCE: u8 = INVALID | STALE;
const FORCE_ID: &str = "400";
const N_PER_COUNT: f64 = 0.01;

fn captures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("captures")
}

/// Describes the arm to the daemon, as the README says, with a model that the installed tool has calibrated.
pub(crate) fn configure() -> Check {
    let from = captures().join("accuracy");
    fs::create_dir_all(FOLDER).at("create", Path::new(FOLDER))?;
    for name in ["arm_a.urdf", "arm_a.dbc"] {
        fs::copy(from.join(name), Path::new(FOLDER).join(name)).at("copy", &from.join(name))?;
    }
    let given = from.join("arm.toml");
    let text = fs::read_to_string(&given).at("read", &given)?;
    ensure!(text.contains("\"can0\""), "{} holds no \"can0\"", given.display());
    let text = text.replace("\"can0\"", "\"vcan0\"")
        + "\n[model]\npath = \"model.toml\"\n\n[publish]\nmode = \"event\"\n\n[publish.can]\ninterface = \"vcan1\"\n\n[control]\n";
    fs::write(CONFIG, text).at("write", Path::new(CONFIG))?;
    let mut calibrate = Command::new("wrenchctl");
    calibrate.arg("calibrate").arg(captures().join("calibration")).args(["--out", MODEL]);
    process::run(&mut calibrate, CALIBRATE_LIMIT).map(drop)
}

/// Starts to play the arm in its held pose onto vcan0, for a minute.
pub(crate) fn play(guest: &Guest) -> Check<Program> {
    let run = guest.dir().join("played");
    if !run.exists() {
        fs::create_dir(&run).at("create", &run)?;
        let lines = candump::read(&captures().join("accuracy/can.log.gz"))?;
        let pieces = candump::rounds(&lines);
        let pushed = pieces.get(PUSHED_ROUNDS).ok_or_else(|| Failure::new("the recording is too short"))?;
        candump::write(&run.join("can.log"), &candump::repeated(pushed, 7500, PERIOD_NS))?;
        let text =
            format!("format = 1\nconfig = \"{CONFIG}\"\nlog = \"can.log\"\npurpose = \"evaluation\"\n");
        fs::write(run.join("run.toml"), text).at("write", &run)?;
    }
    Program::start(Command::new("wrenchctl").arg("replay").arg(&run).args(["--onto", "vcan0"]))
}

/// Fails unless, while the arm plays, its wrenches come: nearly all of them good, and the whole push among them.
pub(crate) fn ensure_published(guest: &Guest) -> Check {
    // A host that stands still makes inputs stale: once it goes on, wrenches are good again.
    let until = Instant::now() + STEP;
    loop {
        match published(guest) {
            Err(_) if Instant::now() < until => {}
            outcome => return outcome,
        }
    }
}

fn published(guest: &Guest) -> Check {
    let mut playing = play(guest)?;
    let capture = guest.capture("vcan1")?;
    std::thread::sleep(Duration::from_secs(3));
    ensure!(playing.is_running()?, "the player ended: {}", playing.text());
    let forces = forces(&capture.stop_at_once()?.lines)?;
    let good: Vec<&Force> = forces.iter().filter(|force| force.status & SILENCE == 0).collect();
    ensure!(
        good.len() > 150 && 10 * good.len() > 8 * forces.len(),
        "{} of {} wrenches are good",
        good.len(),
        forces.len()
    );
    let largest_n = good.iter().map(|force| force.size_n).fold(0.0, f64::max);
    ensure!(PUSH_N.contains(&largest_n), "a push of 5 N gave at most {largest_n} N");
    Ok(())
}

/// A force frame.
pub(crate) struct Force {
    size_n: f64,
    pub(crate) status: u8,
}

/// The force frames of a capture, as config/wrench.dbc has them.
pub(crate) fn forces(lines: &[Line]) -> Check<Vec<Force>> {
    let force = |line: &Line| -> Check<Force> {
        let [x0, x1, y0, y1, z0, z1, _, status] = line.data[..] else {
            return Err(Failure::new(format!("a force frame of {} bytes", line.data.len())));
        };
        let newtons = |bytes| f64::from(i16::from_le_bytes(bytes)) * N_PER_COUNT;
        let [x, y, z] = [[x0, x1], [y0, y1], [z0, z1]].map(newtons);
        Ok(Force { size_n: (x * x + y * y + z * z).sqrt(), status })
    };
    lines.iter().filter(|line| line.id == FORCE_ID).map(force).collect()
}
