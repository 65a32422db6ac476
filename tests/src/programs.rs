//! The programs under test, built as a user builds them.

use crate::process;
use crate::scratch::target_dir;
use crate::{Check, Failure, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;

const BUILD_LIMIT: Duration = Duration::from_secs(1800);
const WRENCHD_VARIABLE: &str = "WRENCHD_TEST_WRENCHD";
const WRENCHCTL_VARIABLE: &str = "WRENCHD_TEST_WRENCHCTL";

/// Where the programs are.
#[derive(Clone, Debug)]
pub struct Programs {
    /// The daemon.
    pub wrenchd: PathBuf,
    /// The tool.
    pub wrenchctl: PathBuf,
}

/// The root of the project's checkout.
pub fn workspace() -> &'static Path {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    tests.parent().unwrap_or(tests)
}

/// The programs, optimised; built once a process, into the build directory that the tests themselves were built into. Inside the machine they
/// are those that were built outside.
pub fn programs() -> Check<&'static Programs> {
    static PROGRAMS: OnceLock<Check<Programs>> = OnceLock::new();
    let outcome = PROGRAMS.get_or_init(|| from_environment().map_or_else(build, Ok));
    outcome.as_ref().map_err(|failure| Failure::new(failure.words()))
}

fn from_environment() -> Option<Programs> {
    let path = |name: &str| std::env::var_os(name).map(PathBuf::from);
    Some(Programs { wrenchd: path(WRENCHD_VARIABLE)?, wrenchctl: path(WRENCHCTL_VARIABLE)? })
}

fn build() -> Check<Programs> {
    let target = target_dir()?;
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command
        .args(["build", "--release", "--locked", "-p", "wrenchd", "-p", "wrenchctl", "--target-dir"])
        .arg(&target)
        .current_dir(workspace());
    process::run(&mut command, BUILD_LIMIT)?;
    let release = target.join("release");
    let programs = Programs { wrenchd: release.join("wrenchd"), wrenchctl: release.join("wrenchctl") };
    for program in [&programs.wrenchd, &programs.wrenchctl] {
        ensure!(program.is_file(), "cargo built no {}", program.display());
    }
    Ok(programs)
}

impl Programs {
    /// The variables that hand the programs to the inside of the machine.
    pub fn environment(&self) -> [(&'static str, &Path); 2] {
        [(WRENCHD_VARIABLE, &self.wrenchd), (WRENCHCTL_VARIABLE, &self.wrenchctl)]
    }
}
