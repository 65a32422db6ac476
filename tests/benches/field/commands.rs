//! What a user waits for and stores: a diagnosis of so much data and of ten times as much, a build from nothing, the programs.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use wrenchd_tests::programs::{Programs, programs, workspace};
use wrenchd_tests::{Check, process};

use crate::table::{Line, short};

const LIMIT: Duration = Duration::from_secs(3600);

pub(crate) fn all() -> Check<Vec<Line>> {
    let folder = std::env::temp_dir().join(format!("wrenchd-field-commands-{}", std::process::id()));
    std::fs::create_dir_all(&folder)?;
    let programs = programs()?;
    let mut lines = diagnosis(programs, &folder)?;
    lines.push(build(&folder)?);
    for program in [&programs.wrenchd, &programs.wrenchctl] {
        let stripped = folder.join("stripped");
        process::run(Command::new("strip").arg("-o").arg(&stripped).arg(program), LIMIT)?;
        let name = program.file_name().unwrap_or_default().to_string_lossy();
        let mb = std::fs::metadata(&stripped)?.len() as f64 / 1e6;
        lines.push(Line::alone(&format!("size of {name}, stripped"), format!("{} MB", short(mb))));
    }
    let _ = std::fs::remove_dir_all(&folder);
    Ok(lines)
}

fn seconds(command: &mut Command) -> Check<f64> {
    let begun = Instant::now();
    process::run(command, LIMIT)?;
    Ok(begun.elapsed().as_secs_f64())
}

/// Two minutes of a sweep with a gauge whose gain is off, once and ten times.
fn diagnosis(programs: &Programs, folder: &Path) -> Check<Vec<Line>> {
    let wrenchctl = || Command::new(&programs.wrenchctl);
    let simulate = |name: &str, arguments: &[&str]| -> Check<PathBuf> {
        let run = folder.join(name);
        let mut command = wrenchctl();
        command.arg("simulate").arg("--config").arg(workspace().join("config/arm.toml")).args(arguments);
        process::run(command.arg("--out").arg(&run), LIMIT)?;
        Ok(run)
    };
    let calibration = simulate("calibration", &["--motion", "calibration", "--seed", "1"])?;
    let model = folder.join("model.toml");
    process::run(wrenchctl().arg("calibrate").arg(calibration).arg("--out").arg(&model), LIMIT)?;
    let model_path = model.display().to_string();
    let mut runs = Vec::new();
    for number in 0..10 {
        let seed = (number + 2).to_string();
        let words = [
            "--motion",
            "sweep",
            "--model",
            &model_path,
            "--effect",
            "gain@s3,relative=0.02",
            "--seed",
            &seed,
        ];
        runs.push(simulate(&format!("sweep{number}"), &words)?);
    }
    let mut lines = Vec::new();
    for (what, runs) in [("diagnosis of one sweep", &runs[..1]), ("diagnosis of ten sweeps", &runs[..])] {
        let took_s = seconds(wrenchctl().arg("diagnose").args(runs).arg("--model").arg(&model))?;
        lines.push(Line::alone(what, format!("{} s", short(took_s))));
    }
    Ok(lines)
}

/// Both programs, as released, into an empty build directory.
fn build(folder: &Path) -> Check<Line> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["build", "--release", "--locked", "-p", "wrenchd", "-p", "wrenchctl", "--target-dir"]);
    let took_s = seconds(command.arg(folder.join("target")).current_dir(workspace()))?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    Ok(Line::alone(&format!("build from nothing, {cores} cores"), format!("{} min", short(took_s / 60.0))))
}
