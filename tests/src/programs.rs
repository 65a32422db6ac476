//! The programs under test, built as a user builds them.

use crate::process::{self, Finished};
use crate::scratch::target_dir;
use crate::{Check, Failure, ensure};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;

const BUILD_LIMIT: Duration = Duration::from_secs(1800);
const WRENCHD_VARIABLE: &str = "WRENCHD_TEST_WRENCHD";
const WRENCHCTL_VARIABLE: &str = "WRENCHD_TEST_WRENCHCTL";
const SOCKET_TESTS_VARIABLE: &str = "WRENCHD_TEST_SOCKET_TESTS";

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

/// Runs cargo in the workspace, into the build directory that the tests themselves were built into.
fn cargo(arguments: &[&str], target: &Path) -> Check<Finished> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments).args(["--locked", "--target-dir"]).arg(target).current_dir(workspace());
    // What cargo tells these tests of their own package: build scripts that look at it would run again, and half of what zenoh needs be built anew.
    let own = |name: &str| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_");
    for (name, _) in std::env::vars_os().filter(|(name, _)| name.to_str().is_some_and(own)) {
        command.env_remove(name);
    }
    process::run(&mut command, BUILD_LIMIT)
}

fn build() -> Check<Programs> {
    let target = target_dir()?;
    cargo(&["build", "--release", "-p", "wrenchd", "-p", "wrenchctl"], &target)?;
    let release = target.join("release");
    let programs = Programs { wrenchd: release.join("wrenchd"), wrenchctl: release.join("wrenchctl") };
    for program in [&programs.wrenchd, &programs.wrenchctl] {
        ensure!(program.is_file(), "cargo built no {}", program.display());
    }
    Ok(programs)
}

/// The bridge to ROS 2, as `cargo test --workspace` has built it for its own test: zenoh, optimised or with other features, would take minutes.
pub(crate) fn build_bridge() -> Check<PathBuf> {
    let target = target_dir()?;
    cargo(&["test", "--no-run", "--workspace", "--test", "peer"], &target)?;
    Ok(target.join("debug/wrenchd-ros2"))
}

/// The tests of the socket source, which need `vcan0` and `vcan1`: an executable of cargo's usual harness, built once a process.
pub fn socket_tests() -> Check<&'static Path> {
    static TESTS: OnceLock<Check<PathBuf>> = OnceLock::new();
    let given = || std::env::var_os(SOCKET_TESTS_VARIABLE).map(PathBuf::from);
    let outcome = TESTS.get_or_init(|| given().map_or_else(build_socket_tests, Ok));
    outcome.as_deref().map_err(|failure| Failure::new(failure.words()))
}

fn build_socket_tests() -> Check<PathBuf> {
    let arguments = ["test", "--no-run", "--message-format=json", "-p", "wrenchd-can", "--test", "vcan"];
    let said = cargo(&arguments, &target_dir()?)?.stdout();
    // One JSON object a line; the only executable among them is the one asked for.
    let mut found =
        said.lines().filter_map(|line| Some(line.split_once("\"executable\":\"")?.1.split_once('"')?.0));
    let path = found.next_back().map(PathBuf::from).filter(|path| path.is_file());
    path.ok_or_else(|| Failure::new(format!("cargo built no tests of the socket source; it said:\n{said}")))
}

/// The variable that hands these tests to the inside of the machine.
pub fn socket_tests_environment(tests: &Path) -> (&'static str, &Path) {
    (SOCKET_TESTS_VARIABLE, tests)
}

impl Programs {
    /// The variables that hand the programs to the inside of the machine.
    pub fn environment(&self) -> [(&'static str, &Path); 2] {
        [(WRENCHD_VARIABLE, &self.wrenchd), (WRENCHCTL_VARIABLE, &self.wrenchctl)]
    }
}
