//! The independent decoder and the outside clients: packages from PyPI in a virtual environment of the tests' own.

use crate::process;
use crate::scratch::target_dir;
use crate::{Check, Failure, IoContext, packages};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;

const INSTALL_LIMIT: Duration = Duration::from_secs(900);
const DECODE_LIMIT: Duration = Duration::from_secs(300);
const REQUIREMENTS: &str = include_str!("../python/requirements.txt");
const PYTHON_VARIABLE: &str = "WRENCHD_TEST_PYTHON";

/// A frame as the independent decoder reads it.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// Seconds since the Unix epoch.
    pub stamp_s: f64,
    /// The message's name in the DBC.
    pub message: String,
    /// Physical values by the signal's name, in the DBC's units.
    pub signals: BTreeMap<String, f64>,
}

/// The interpreter of the environment, made once and used again as long as the pinned versions stay the same.
pub fn interpreter() -> Check<&'static Path> {
    static INTERPRETER: OnceLock<Check<PathBuf>> = OnceLock::new();
    let outcome = INTERPRETER
        .get_or_init(|| std::env::var_os(PYTHON_VARIABLE).map_or_else(make, |path| Ok(path.into())));
    outcome.as_deref().map_err(|failure| Failure::new(failure.words()))
}

/// The variable that hands the interpreter to the inside of the machine.
pub fn environment(interpreter: &Path) -> (&'static str, &Path) {
    (PYTHON_VARIABLE, interpreter)
}

/// One of the tests' scripts, to be run by the interpreter of the environment.
pub fn script(name: &str) -> Check<Command> {
    let mut command = Command::new(interpreter()?);
    command.arg(Path::new(env!("CARGO_MANIFEST_DIR")).join("python").join(name));
    Ok(command)
}

/// Decodes a recording. A frame that the DBC does not know is a failure.
pub fn decode(dbc: &Path, log: &Path) -> Check<Vec<Decoded>> {
    let finished = process::run(script("decode.py")?.args([dbc, log]), DECODE_LIMIT)?;
    let bad = |line: &str| Failure::new(format!("the independent decoder wrote {line:?}"));
    finished.stdout().lines().map(|line| parse(line).ok_or_else(|| bad(line))).collect()
}

fn parse(line: &str) -> Option<Decoded> {
    let mut words = line.split(' ');
    let stamp_s = words.next()?.parse().ok()?;
    let message = words.next()?.to_owned();
    let signal = |word: &str| -> Option<(String, f64)> {
        let (name, value) = word.split_once('=')?;
        Some((name.to_owned(), value.parse().ok()?))
    };
    Some(Decoded { stamp_s, message, signals: words.map(signal).collect::<Option<_>>()? })
}

fn make() -> Check<PathBuf> {
    environment_with(
        "python",
        REQUIREMENTS,
        "can, cantools, NetFT, pynetft, zenoh, mcap, mcap_ros2, prometheus_client",
    )
}

/// The interpreter of an environment of this name under the build directory, with these packages, of which these modules can be imported.
pub fn environment_with(name: &str, requirements: &str, modules: &str) -> Check<PathBuf> {
    let dir = target_dir()?.join(name);
    fs::create_dir_all(&dir).at("create", &dir)?;
    let lock_path = dir.join("lock");
    let lock = File::create(&lock_path).at("create", &lock_path)?;
    lock.lock().at("lock", &lock_path)?;

    let environment = dir.join("env");
    let interpreter = environment.join("bin/python3");
    // Written last, so that an environment half made is made again.
    let done = environment.join("requirements.txt");
    let works = |interpreter: &Path| {
        process::run(
            Command::new(interpreter).args(["-c", &format!("import {modules}")]),
            Duration::from_secs(60),
        )
        .is_ok()
    };
    if fs::read_to_string(&done).is_ok_and(|text| text == requirements) && works(&interpreter) {
        return Ok(interpreter);
    }
    let [python] = packages::require(&[&packages::PYTHON])?
        .try_into()
        .map_err(|_| Failure::new("python3 is required once and found once"))?;
    let _ = fs::remove_dir_all(&environment);
    let venv = |python: &Path| {
        process::run(Command::new(python).args(["-m", "venv"]).arg(&environment), INSTALL_LIMIT)
    };
    // Debian splits off what makes environments; only trying tells.
    venv(&python).or_else(|_| {
        let _ = fs::remove_dir_all(&environment);
        packages::install(&["python3-venv"]).and_then(|()| venv(&python))
    })?;
    let mut pip = Command::new(&interpreter);
    let wanted = dir.join("requirements.txt");
    fs::write(&wanted, requirements).at("write", &wanted)?;
    pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r"]).arg(&wanted);
    process::run(&mut pip, INSTALL_LIMIT).map_err(|failure| {
        Failure::new(format!(
            "Python's packages cannot be installed (pip needs a network or a configured index): {}",
            failure.words()
        ))
    })?;
    fs::write(&done, requirements).at("write", &done)?;
    Ok(interpreter)
}
