//! The peers: what they are built of and installed with, and how they are run.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use wrenchd_tests::programs::workspace;
use wrenchd_tests::{Check, Failure, packages, process, python, scratch};

const COMPILE_LIMIT: Duration = Duration::from_secs(900);
const RUN_LIMIT: Duration = Duration::from_secs(900);

/// Time of the processor that this thread has had, s: what only computes is told apart from what else the computer does.
pub(crate) fn processor_s() -> f64 {
    let had = nix::time::clock_gettime(nix::time::ClockId::CLOCK_THREAD_CPUTIME_ID);
    had.map_or(f64::NAN, |had| had.tv_sec() as f64 + had.tv_nsec() as f64 * 1e-9)
}

/// The folder with the peers' sources.
pub(crate) fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("benches/field")
}

/// The interpreter of an environment with the Python packages that peers are, or bring.
pub(crate) fn interpreter() -> Check<PathBuf> {
    let requirements = include_str!("requirements.txt");
    python::environment_with("field", requirements, "can, cantools, mujoco, numpy, pinocchio")
}

/// Where a Python package of the environment lies.
pub(crate) fn package(module: &str) -> Check<PathBuf> {
    let script = format!("import {module}, os; print(os.path.dirname({module}.__file__))");
    let said = process::run(Command::new(interpreter()?).args(["-c", &script]), RUN_LIMIT)?.stdout();
    Ok(said.trim().into())
}

/// Compiles a peer's source with these arguments more, unless that was done since it was last changed; the program.
pub(crate) fn compile(source: &str, arguments: &[String]) -> Check<PathBuf> {
    let cpp = source.ends_with(".cpp");
    let (program, standard) = if cpp { ("c++", "-std=c++17") } else { ("cc", "-std=gnu11") };
    packages::require_program(program, if cpp { "g++" } else { "gcc libc6-dev" })?;
    let folder = scratch::target_dir()?.join("field/peers");
    std::fs::create_dir_all(&folder)?;
    let built = folder.join(source.split('.').next().unwrap_or(source));
    let changed = |path: &Path| path.metadata().and_then(|file| file.modified());
    if changed(&built).is_ok_and(|built| changed(&sources().join(source)).is_ok_and(|source| source < built))
    {
        return Ok(built);
    }
    let mut command = Command::new(program);
    command.args(["-O3", "-march=native", "-DNDEBUG", standard, "-o"]).arg(&built);
    command.arg(sources().join(source)).args(arguments);
    process::run(&mut command, COMPILE_LIMIT)?;
    Ok(built)
}

/// These benchmarks as the compiler builds them for this very processor.
pub(crate) fn native() -> Check<PathBuf> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["bench", "--no-run", "--locked", "-p", "wrenchd-tests", "--bench", "field"]);
    command
        .args(["--message-format", "json", "--target-dir"])
        .arg(scratch::target_dir()?.join("field/native"));
    command.env("RUSTFLAGS", "-Ctarget-cpu=native").current_dir(workspace());
    let said = process::run(&mut command, COMPILE_LIMIT)?.stdout();
    let built = said.lines().filter_map(|line| serde_json::from_str::<serde_json::Value>(line).ok());
    let program = built.filter_map(|built| Some(PathBuf::from(built["executable"].as_str()?))).next_back();
    program.ok_or_else(|| Failure::new(format!("cargo built nothing to run: {said}")))
}

/// Runs a peer, which prints its cost and a result.
pub(crate) fn run(command: &mut Command) -> Check<(f64, f64)> {
    let said = process::run(command, RUN_LIMIT)?.stdout();
    let numbers: Vec<f64> = said.split_ascii_whitespace().map(str::parse).collect::<Result<_, _>>()?;
    match numbers[..] {
        [cost, result] => Ok((cost, result)),
        _ => Err(Failure::new(format!("{command:?} printed {said:?}"))),
    }
}
