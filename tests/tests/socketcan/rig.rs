//! Arm A on vcan0, its daemon, and what is heard on vcan1.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::{Capture, Captured, Guest, send};
use wrenchd_tests::process::{self, Program};
use wrenchd_tests::programs::{programs, workspace};
use wrenchd_tests::python::{self, Decoded};
use wrenchd_tests::{Check, Failure, IoContext, ensure};

const CALIBRATE_LIMIT: Duration = Duration::from_secs(120);
const OFFLINE_LIMIT: Duration = Duration::from_secs(120);
const PLAY_LIMIT: Duration = Duration::from_secs(400);
const STOP_LIMIT: Duration = Duration::from_secs(10);
/// The messages of a round in the classical DBC, which in the CAN FD one are all called `Round`.
const MESSAGES: [&str; 7] =
    ["Joints12", "Joints34", "Joints56", "Strain12", "Strain34", "Strain56", "Strain78"];

/// How the arm's signals travel.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Form {
    /// Seven frames of 8 bytes a round.
    Classical,
    /// One frame of 64 bytes a round.
    Fd,
}

/// What puts the recording onto the bus.
#[derive(Clone, Copy)]
pub(crate) enum Player {
    Wrenchctl,
    Canplayer,
}

/// The arm as configured for a scenario, and its model.
pub(crate) struct Arm {
    form: Form,
    config: PathBuf,
    model: PathBuf,
}

fn captures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("captures")
}

/// The model calibrated from the committed capture, once for all scenarios.
fn model() -> Check<&'static Path> {
    static MODEL: OnceLock<Check<PathBuf>> = OnceLock::new();
    let make = || -> Check<PathBuf> {
        let path = std::env::temp_dir().join("model.toml");
        let mut command = Command::new(&programs()?.wrenchctl);
        command.arg("calibrate").arg(captures().join("calibration")).arg("--out").arg(&path);
        process::run(&mut command, CALIBRATE_LIMIT)?;
        Ok(path)
    };
    MODEL.get_or_init(make).as_deref().map_err(|failure| Failure::new(failure.words()))
}

impl Arm {
    pub(crate) fn new(guest: &Guest, form: Form) -> Check<Self> {
        let from = captures().join("accuracy");
        let to = guest.dir();
        let copy =
            |file: &Path| fs::copy(file, to.join(file.file_name().unwrap_or_default())).at("copy", file);
        copy(&from.join("arm_a.urdf"))?;
        copy(&from.join("arm_a.dbc"))?;
        copy(&captures().join("arm_fd.dbc"))?;
        let given = from.join("arm.toml");
        let mut text = fs::read_to_string(&given).at("read", &given)?;
        let mut replace = |old: &str, new: &str| -> Check {
            ensure!(text.contains(old), "{} holds no {old}", given.display());
            text = text.replace(old, new);
            Ok(())
        };
        replace("\"can0\"", "\"vcan0\"")?;
        if form == Form::Fd {
            replace("arm_a.dbc", "arm_fd.dbc")?;
            for message in MESSAGES {
                replace(&format!("\"{message}."), "\"Round.")?;
            }
        }
        text.push_str("\n[publish]\nmode = \"event\"\n\n[publish.can]\ninterface = \"vcan1\"\n");
        text.push_str(&format!("\n[control]\nsocket = \"{}\"\n", to.join("control.sock").display()));
        let config = to.join("arm.toml");
        fs::write(&config, text).at("write", &config)?;
        Ok(Self { form, config, model: model()?.to_owned() })
    }

    /// The committed recording in this arm's form.
    pub(crate) fn recording(&self) -> Check<Vec<Line>> {
        let lines = candump::read(&captures().join("accuracy/can.log.gz"))?;
        Ok(match self.form {
            Form::Classical => lines,
            Form::Fd => candump::as_fd(&lines),
        })
    }

    /// A run directory for a log.
    fn run_directory(&self, dir: &Path, log: &Path) -> Check {
        fs::create_dir_all(dir).at("create", dir)?;
        let text = format!(
            "format = 1\nconfig = \"{}\"\nlog = \"{}\"\npurpose = \"evaluation\"\n",
            self.config.display(),
            log.display()
        );
        let path = dir.join("run.toml");
        fs::write(&path, text).at("write", &path)
    }

    /// What `wrenchctl validate` computes from a recording: one wrench a published instant.
    pub(crate) fn offline(&self, guest: &Guest, log: &Path) -> Check<Vec<Published>> {
        let dir = guest.dir().join("offline");
        self.run_directory(&dir, log)?;
        let csv = guest.dir().join("offline.csv");
        let mut command = Command::new(&programs()?.wrenchctl);
        command.arg("validate").arg(&dir).arg("--model").arg(&self.model).arg("--csv").arg(&csv);
        let finished = Program::start(&mut command)?.finish(OFFLINE_LIMIT)?;
        // Without a reference the pushes count as errors: "out of tolerance" is an answer too.
        ensure!(matches!(finished.code(), Some(0 | 1)), "wrenchctl validate failed:\n{}", finished.text());
        let text = fs::read_to_string(&csv).at("read", &csv)?;
        let mut rows = text.lines();
        ensure!(
            rows.next() == Some("t,fx,fy,fz,tx,ty,tz,sfx,sfy,sfz,stx,sty,stz,status"),
            "{} has another header",
            csv.display()
        );
        rows.map(Published::from_row).collect()
    }
}

/// What went over the two links while the daemon ran.
pub(crate) struct Live {
    /// Every frame on vcan0, when asked for.
    received: Option<Captured>,
    /// Every frame on vcan1.
    sent: Captured,
    /// How many frames vcan0 carried, by the kernel's count.
    pub(crate) carried: u64,
}

/// Whether the daemon's input is captured too: at 8000 frames a second that costs more of the processor than the daemon.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Input {
    Captured,
    Counted,
}

impl Live {
    /// Starts the daemon, plays the recording, and stops the daemon, which must end well.
    pub(crate) fn run(guest: &Guest, arm: &Arm, player: Player, input: Input, lines: &[Line]) -> Check<Self> {
        let played = guest.dir().join("played");
        let log = played.join("can.log");
        arm.run_directory(&played, &log)?;
        candump::write(&log, lines)?;
        let near = if input == Input::Captured { Some(guest.capture("vcan0")?) } else { None };
        let far = guest.capture("vcan1")?;
        let programs = programs()?;
        let mut command = Command::new(&programs.wrenchd);
        command.arg("--config").arg(&arm.config).arg("--model").arg(&arm.model);
        let daemon = guest.start_listening(&mut command, "vcan0")?;
        let mut play = match player {
            Player::Wrenchctl => Command::new(&programs.wrenchctl),
            Player::Canplayer => Command::new("canplayer"),
        };
        match player {
            Player::Wrenchctl => play.arg("replay").arg(&played).args(["--onto", "vcan0"]),
            Player::Canplayer => play.arg("-I").arg(&log).arg("vcan0=can0"),
        };
        let before = guest.carried("vcan0")?;
        send(&mut play, PLAY_LIMIT)?;
        let carried = guest.carried("vcan0")? - before;
        let (received, sent) = (near.map(Capture::stop).transpose()?, far.stop()?);
        daemon.stop(STOP_LIMIT)?.expect_code(0)?;
        Ok(Self { received, sent, carried })
    }

    /// What the daemon received, where that was captured.
    pub(crate) fn received(&self) -> Check<&Captured> {
        self.received.as_ref().ok_or_else(|| Failure::new("the input was counted, not captured"))
    }

    /// What the daemon published, as the independent decoder reads it with the shipped DBC: every instant's force
    /// and moment frames, in order, none left out.
    pub(crate) fn published(&self) -> Check<Vec<Published>> {
        let frames = python::decode(&workspace().join("config/wrench.dbc"), &self.sent.path)?;
        let of =
            |name: &str| -> Vec<&Decoded> { frames.iter().filter(|frame| frame.message == name).collect() };
        let (forces, torques, qualities) = (of("WrenchForce"), of("WrenchTorque"), of("WrenchQuality"));
        let (a, b, c) = (forces.len(), torques.len(), qualities.len());
        ensure!(a == b && b == c && a + b + c == frames.len(), "{a} forces, {b} moments, {c} qualities");
        let mut published: Vec<Published> = Vec::with_capacity(a);
        let mut expected: Option<u8> = None;
        for (at, (force, torque)) in forces.into_iter().zip(torques).enumerate() {
            let wrench = Published::from_frames(force, torque)?;
            let sequence = value(force, "Sequence")? as u8;
            ensure!(
                expected.is_none_or(|next| next == sequence),
                "wrench {at}: sequence {sequence}, {expected:?} was due"
            );
            expected = Some(sequence.wrapping_add(1));
            published.push(wrench);
        }
        Ok(published)
    }

    /// Rounds a second, by the kernel's stamps of what was published.
    pub(crate) fn rate_hz(&self, rounds: usize) -> f64 {
        let lines = &self.sent.lines;
        let span_us =
            lines.first().zip(lines.last()).map_or(0, |(first, last)| last.stamp_us - first.stamp_us);
        1e6 * rounds as f64 / span_us as f64
    }
}

/// One wrench, live or offline.
pub(crate) struct Published {
    /// N and Nm, force first, in the tip frame; whatever stands there when invalid.
    pub(crate) wrench: [f64; 6],
    pub(crate) status: u8,
}

fn value(frame: &Decoded, signal: &str) -> Check<f64> {
    let found = frame.signals.get(signal).copied();
    found.ok_or_else(|| Failure::new(format!("{} has no {signal}", frame.message)))
}

impl Published {
    fn from_frames(force: &Decoded, torque: &Decoded) -> Check<Self> {
        for signal in ["Sequence", "Status"] {
            let (a, b) = (value(force, signal)?, value(torque, signal)?);
            ensure!(a == b, "force and moment of one instant differ in {signal}: {a} and {b}");
        }
        let mut wrench = [0.0; 6];
        for (place, name) in ["Fx", "Fy", "Fz"].into_iter().enumerate() {
            wrench[place] = value(force, name)?;
        }
        for (place, name) in ["Tx", "Ty", "Tz"].into_iter().enumerate() {
            wrench[3 + place] = value(torque, name)?;
        }
        Ok(Self { wrench, status: value(force, "Status")? as u8 })
    }

    /// A row of `validate --csv`; the numbers of an invalid instant may be missing.
    fn from_row(row: &str) -> Check<Self> {
        let fields: Vec<&str> = row.split(',').collect();
        ensure!(fields.len() == 14, "a row of {} fields: {row}", fields.len());
        let status: u8 = fields[13].parse()?;
        let mut wrench = [f64::NAN; 6];
        for (place, field) in fields[1..7].iter().enumerate() {
            if status & 1 == 0 {
                wrench[place] = field.parse()?;
            }
        }
        Ok(Self { wrench, status })
    }

    pub(crate) fn is_valid(&self) -> bool {
        self.status & 1 == 0
    }

    /// The force's magnitude.
    pub(crate) fn force_n(&self) -> f64 {
        self.wrench[..3].iter().map(|force| force * force).sum::<f64>().sqrt()
    }
}
