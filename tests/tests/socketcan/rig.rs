//! Arm A as configured for a scenario: its files, its models, its recording, and what the tool computes from one.

use crate::published::Published;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;
use wrenchd_tests::candump::{self, Line, ROUND_ID};
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::{self, Program};
use wrenchd_tests::programs::programs;
use wrenchd_tests::{Check, Failure, IoContext, ensure};

const CALIBRATE_LIMIT: Duration = Duration::from_secs(120);
const OFFLINE_LIMIT: Duration = Duration::from_secs(120);
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
    /// The same, the frames of a round at 1000 Hz in one go: seven times fewer wake-ups.
    WrenchctlInRounds,
    Canplayer,
}

/// The rounds of a recording: numbers of its lines.
pub(crate) struct Rounds {
    /// Of each round the first line, the first with a gauge, and the last.
    pub(crate) all: Vec<(usize, usize, usize)>,
}

/// The arm as configured for a scenario, and its model.
pub(crate) struct Arm {
    form: Form,
    pub(crate) config: PathBuf,
    pub(crate) model: PathBuf,
}

fn captures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("captures")
}

/// Calibrates from the committed capture.
fn calibrate(model: &Path) -> Check {
    let mut command = Command::new(&programs()?.wrenchctl);
    command.arg("calibrate").arg(captures().join("calibration")).arg("--out").arg(model);
    process::run(&mut command, CALIBRATE_LIMIT).map(drop)
}

/// The model calibrated from the committed capture, once for all scenarios.
fn model() -> Check<&'static Path> {
    static MODEL: OnceLock<Check<PathBuf>> = OnceLock::new();
    let make = || -> Check<PathBuf> {
        let path = std::env::temp_dir().join("model.toml");
        calibrate(&path)?;
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
        let (config, own_model) = (to.join("arm.toml"), to.join("model.toml"));
        fs::write(&config, text).at("write", &config)?;
        fs::copy(model()?, &own_model).at("write", &own_model)?;
        Ok(Self { form, config, model: own_model })
    }

    /// Adds tables to the configuration.
    pub(crate) fn configure(&self, tables: &str) -> Check {
        let text = fs::read_to_string(&self.config).at("read", &self.config)? + tables;
        fs::write(&self.config, text).at("write", &self.config)
    }

    /// The committed recording in this arm's form.
    pub(crate) fn recording(&self) -> Check<Vec<Line>> {
        let lines = candump::read(&captures().join("accuracy/can.log.gz"))?;
        Ok(match self.form {
            Form::Classical => lines,
            Form::Fd => candump::as_fd(&lines),
        })
    }

    /// The rounds of a recording in this arm's form.
    pub(crate) fn rounds(&self, lines: &[Line]) -> Rounds {
        let (ids, gauge): (&[&str], usize) = match self.form {
            Form::Classical => (&candump::ROUND, 3),
            Form::Fd => (&[ROUND_ID], 0),
        };
        let numbers: Vec<usize> =
            (0..lines.len()).filter(|at| ids.contains(&lines[*at].id.as_str())).collect();
        let whole = |numbers: &&[usize]| numbers.iter().zip(ids).all(|(at, id)| lines[*at].id == *id);
        let spans = numbers.chunks(ids.len()).filter(whole);
        Rounds { all: spans.map(|numbers| (numbers[0], numbers[gauge], numbers[ids.len() - 1])).collect() }
    }

    /// A run directory for a log.
    pub(crate) fn run_directory(&self, dir: &Path, log: &Path) -> Check {
        fs::create_dir_all(dir).at("create", dir)?;
        let text = format!(
            "format = 1\nconfig = \"{}\"\nlog = \"{}\"\npurpose = \"evaluation\"\n",
            self.config.display(),
            log.display()
        );
        let path = dir.join("run.toml");
        fs::write(&path, text).at("write", &path)
    }

    /// What `wrenchctl validate` computes with a model from a recording: one wrench a published instant.
    pub(crate) fn offline(&self, guest: &Guest, log: &Path, model: &Path) -> Check<Vec<Published>> {
        let dir = guest.dir().join("offline");
        self.run_directory(&dir, log)?;
        let csv = guest.dir().join("offline.csv");
        let mut command = Command::new(&programs()?.wrenchctl);
        command.arg("validate").arg(&dir).arg("--model").arg(model).arg("--csv").arg(&csv);
        process::run(&mut command, OFFLINE_LIMIT)?;
        let text = fs::read_to_string(&csv).at("read", &csv)?;
        let mut rows = text.lines();
        ensure!(
            rows.next() == Some("t,fx,fy,fz,tx,ty,tz,sfx,sfy,sfz,stx,sty,stz,status"),
            "{} has another header",
            csv.display()
        );
        rows.map(Published::from_row).collect()
    }

    /// The true wrench of each round of [`Arm::recording`], N and Nm, force first.
    pub(crate) fn truth(&self) -> Check<Vec<[f64; 6]>> {
        let path = captures().join("accuracy/reference.csv");
        let text = fs::read_to_string(&path).at("read", &path)?;
        let row = |line: &str| -> Check<[f64; 6]> {
            let fields = line.split(',').map(str::parse).collect::<Result<Vec<f64>, _>>()?;
            let (_, wrench) = fields.split_first().ok_or_else(|| Failure::new("an empty row"))?;
            wrench.try_into().map_err(|_| Failure::new(format!("{}: {line}", path.display())))
        };
        text.lines().skip(1).map(row).collect()
    }

    /// Starts the daemon with this arm and its model; it listens when this returns.
    pub(crate) fn daemon(&self, guest: &Guest, record: Option<&Path>) -> Check<Program> {
        self.start(guest, record, Command::new(&programs()?.wrenchd))
    }

    /// The same without real-time rights, in the kernel's batch class and before all others: it does not interrupt whoever sends, reads what has
    /// come meanwhile, and where the processor is too slow for all it is the sender who waits.
    pub(crate) fn daemon_in_batches(&self, guest: &Guest, record: Option<&Path>) -> Check<Program> {
        let mut command = Command::new("nice");
        command.args(["-n", "-15", "setpriv", "--bounding-set", "-sys_nice", "--inh-caps", "-sys_nice"]);
        command.args(["chrt", "--batch", "0"]).arg(&programs()?.wrenchd);
        self.start(guest, record, command)
    }

    fn start(&self, guest: &Guest, record: Option<&Path>, mut command: Command) -> Check<Program> {
        command.arg("--config").arg(&self.config).arg("--model").arg(&self.model);
        if let Some(log) = record {
            command.arg("--record").arg(log);
        }
        guest.start_listening(&mut command, "vcan0")
    }

    /// Writes a recording and returns the run directory that holds it, for [`Player`] to play.
    pub(crate) fn to_play(&self, guest: &Guest, lines: &[Line]) -> Check<PathBuf> {
        let dir = guest.dir().join("played");
        let log = dir.join("can.log");
        self.run_directory(&dir, &log)?;
        candump::write(&log, lines)?;
        Ok(dir)
    }
}

impl Player {
    /// The command that plays a run directory's `can.log` onto vcan0 with its own timing.
    pub(crate) fn command(self, run: &Path) -> Check<Command> {
        Ok(match self {
            Self::Wrenchctl | Self::WrenchctlInRounds => {
                let mut command = Command::new(&programs()?.wrenchctl);
                command.arg("replay").arg(run).args(["--onto", "vcan0"]);
                if matches!(self, Self::WrenchctlInRounds) {
                    command.args(["--gather", "0.0009"]);
                }
                command
            }
            Self::Canplayer => {
                let mut command = Command::new("canplayer");
                command.arg("-I").arg(run.join("can.log")).arg("vcan0=can0");
                command
            }
        })
    }
}
