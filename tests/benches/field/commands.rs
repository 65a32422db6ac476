//! What a user waits for and stores: a diagnosis of so much data and of ten times as much, a gigabyte, a build from nothing, the programs.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use wrenchd_tests::programs::{Programs, programs, workspace};
use wrenchd_tests::{Check, process};

use crate::table::{Line, short};

const LIMIT: Duration = Duration::from_secs(3600);
/// How often a program's memory is looked at.
const LOOK: Duration = Duration::from_millis(10);

/// Where runs are simulated, and by which programs; goes with all that is in it.
struct Place {
    programs: &'static Programs,
    folder: PathBuf,
}

impl Place {
    fn new(name: &str) -> Check<Self> {
        let folder = std::env::temp_dir().join(format!("wrenchd-field-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&folder)?;
        Ok(Self { programs: programs()?, folder })
    }

    fn wrenchctl(&self) -> Command {
        Command::new(&self.programs.wrenchctl)
    }

    /// Simulates a run of the example arm; its directory.
    fn simulate(&self, name: &str, arguments: &[&str]) -> Check<PathBuf> {
        let run = self.folder.join(name);
        let mut command = self.wrenchctl();
        command.arg("simulate").arg("--config").arg(workspace().join("config/arm.toml")).args(arguments);
        process::run(command.arg("--out").arg(&run), LIMIT)?;
        Ok(run)
    }

    /// Ten sweeps of two minutes with a gauge whose gain is off.
    fn sweeps(&self, model: &Path, rate_hz: &str) -> Check<Vec<PathBuf>> {
        let model = model.display().to_string();
        let sweep = |number: usize| {
            let (seed, effect) = ((number + 2).to_string(), "gain@s3,relative=0.02");
            let words = ["--motion", "sweep", "--rate", rate_hz, "--model", &model, "--effect", effect];
            self.simulate(&format!("sweep{number}"), &[&words[..], &["--seed", &seed]].concat())
        };
        (0..10).map(sweep).collect()
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

pub(crate) fn all() -> Check<Vec<Line>> {
    let place = Place::new("commands")?;
    let mut lines = diagnosis(&place)?;
    lines.push(build(&place.folder)?);
    for program in [&place.programs.wrenchd, &place.programs.wrenchctl] {
        let stripped = place.folder.join("stripped");
        process::run(Command::new("strip").arg("-o").arg(&stripped).arg(program), LIMIT)?;
        let name = program.file_name().unwrap_or_default().to_string_lossy();
        let mb = std::fs::metadata(&stripped)?.len() as f64 / 1e6;
        lines.push(Line::alone(&format!("size of {name}, stripped"), format!("{} MB", short(mb))));
    }
    Ok(lines)
}

fn diagnosis(place: &Place) -> Check<Vec<Line>> {
    let calibration = place.simulate("calibration", &["--motion", "calibration", "--seed", "1"])?;
    let model = place.folder.join("model.toml");
    process::run(place.wrenchctl().arg("calibrate").arg(calibration).arg("--out").arg(&model), LIMIT)?;
    let runs = place.sweeps(&model, "125")?;
    let mut lines = Vec::new();
    for (what, runs) in [("diagnosis of one sweep", &runs[..1]), ("diagnosis of ten sweeps", &runs[..])] {
        let (took_s, _) = spent(place.wrenchctl().arg("diagnose").args(runs).arg("--model").arg(&model))?;
        lines.push(Line::alone(what, format!("{} s", short(took_s))));
    }
    Ok(lines)
}

/// What commands need for a gigabyte of candump's text: two calibrations of half an hour and ten sweeps, of boards that send at 1000 Hz.
pub(crate) fn scale() -> Check<Vec<Line>> {
    let place = Place::new("scale")?;
    let calibration =
        |seed| place.simulate(seed, &["--motion", "calibration", "--rate", "1000", "--seed", seed]);
    let calibrations = [calibration("1")?, calibration("2")?];
    let text = place.folder.join("text.log");
    let mut unpack = Command::new("gzip");
    unpack.arg("-dc").args(calibrations.iter().map(|run| run.join("can.log.gz")));
    process::Program::start_into(&mut unpack, File::create(&text)?)?.finish(LIMIT)?.expect_code(0)?;
    let model = place.folder.join("model.toml");
    let mut calibrate = place.wrenchctl();
    calibrate.arg("calibrate").args(&calibrations).arg("--out").arg(&model);
    let costs = [
        spent(place.wrenchctl().arg("stats").arg(&text))?,
        spent(&mut calibrate)?,
        spent(
            place.wrenchctl().arg("diagnose").args(place.sweeps(&model, "1000")?).arg("--model").arg(&model),
        )?,
    ];
    let whats = ["`stats` of a gigabyte of candump text", "`calibrate` of as much", "`diagnose` of as much"];
    let line = |(what, (took_s, most_mb)): (&str, (f64, f64))| {
        Line::alone(what, format!("{} s, {} MB of memory", short(took_s), short(most_mb)))
    };
    Ok(whats.into_iter().zip(costs).map(line).collect())
}

/// The time that a command takes, s, and the most memory that it has at once, MB.
fn spent(command: &mut Command) -> Check<(f64, f64)> {
    let begun = Instant::now();
    let mut program = process::Program::start(command)?;
    let status = format!("/proc/{}/status", program.id());
    let mut most_kb: f64 = 0.0;
    while program.is_running()? {
        let now = std::fs::read_to_string(&status).unwrap_or_default();
        let peak = now.lines().find_map(|line| line.strip_prefix("VmHWM:")?.split_whitespace().next());
        most_kb = peak.and_then(|kb| kb.parse().ok()).map_or(most_kb, |kb: f64| kb.max(most_kb));
        std::thread::sleep(LOOK);
    }
    let took_s = begun.elapsed().as_secs_f64();
    program.finish(LIMIT)?.expect_code(0)?;
    Ok((took_s, most_kb * 1024e-6))
}

/// Both programs, as released, into an empty build directory.
fn build(folder: &Path) -> Check<Line> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["build", "--release", "--locked", "-p", "wrenchd", "-p", "wrenchctl", "--target-dir"]);
    let (took_s, _) = spent(command.arg(folder.join("target")).current_dir(workspace()))?;
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    Ok(Line::alone(&format!("build from nothing, {cores} cores"), format!("{} min", short(took_s / 60.0))))
}
