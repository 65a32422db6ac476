//! A simulation as a run directory, whole or not at all, with the truth beside it.

mod config;
mod labels;

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use can::candump::{LogWriter, StampDigits};
use rig::Rig;
use rig::run::Purpose;

use crate::SimError;
use crate::gauge::normal;
use crate::random::{self, stream};
use crate::scenario::Scenario;
use crate::simulator::{Options, Simulator};
use crate::truth::Truth;

pub use labels::LABELS_FILE;

const LOG_FILE: &str = "can.log.gz";
const REFERENCE_FILE: &str = "reference.csv";
const RUN_FILE: &str = "run.toml";
/// Names that belong to the run itself.
const OWN_FILES: [&str; 3] = [RUN_FILE, LOG_FILE, REFERENCE_FILE];
/// Frames between two calls of the progress callback.
const FRAMES_PER_REPORT: u32 = 4096;

/// What a run's description says beside what is in the scenario.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Notes {
    /// Runs of one session share the gauges' zeros.
    pub session: Option<String>,
    /// Name of the run with the same motion and load.
    pub repeat_of: Option<String>,
}

/// Simulates a scenario and writes it as the run directory `dir`, `labels.json` with the truth beside it.
///
/// Times in the run count from the first cycle's instant, which the log's first frame follows within a millisecond.
/// `progress` is told the share that is done, 0 .. 1, now and then. An interrupted or failed run leaves no `dir`.
///
/// # Errors
/// What [`Simulator::new`] refuses; a `dir` that exists and is not empty; anything that cannot be read or written.
pub fn write_run(
    dir: &Path,
    rig: &Rig,
    truth: &Truth,
    scenario: &Scenario,
    options: Options,
    notes: &Notes,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<(), SimError> {
    let simulator = Simulator::new(rig, truth.clone(), scenario, options)?;
    let name = run_name(dir)?;
    let parent = dir.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if dir.exists() && !is_empty_folder(dir) {
        return Err(SimError::Exists { dir: dir.to_owned() });
    }
    fs::create_dir_all(parent).map_err(|source| SimError::write(parent, source))?;
    let labels = labels::merged(&parent.join(LABELS_FILE), &name, rig, truth, options.seed)?;
    let unfinished = Unfinished::begin(parent, &name)?;
    let here = |file: &str| unfinished.path.join(file);

    let config = config::copy_beside(rig, &unfinished.path)?;
    let reference = reference_csv(&simulator, scenario, options.seed);
    if let Some(text) = &reference {
        can::atomic::write(&here(REFERENCE_FILE), text.as_bytes())?;
    }
    write_log(&here(LOG_FILE), &rig.config.bus.interfaces, simulator, progress)?;
    let description = description(&config, scenario, reference.is_some(), notes);
    can::atomic::write(&here(RUN_FILE), description.as_bytes())?;
    unfinished.finish(dir)?;
    if let Err(error) = can::atomic::write(&parent.join(LABELS_FILE), labels.as_bytes()) {
        // Without its truth a simulated run is of no use to those who ask for one.
        let _gone = fs::remove_dir_all(dir);
        return Err(error.into());
    }
    Ok(())
}

fn run_name(dir: &Path) -> Result<String, SimError> {
    let name = dir.file_name().and_then(|name| name.to_str());
    name.map(str::to_owned).ok_or_else(|| {
        SimError::Option(format!("\"{}\" is no name for a run directory; give one in UTF-8", dir.display()))
    })
}

fn is_empty_folder(dir: &Path) -> bool {
    fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_none())
}

/// A directory under another name until it is whole; dropped before that, nothing is left of it.
struct Unfinished {
    path: PathBuf,
}

impl Unfinished {
    fn begin(parent: &Path, name: &str) -> Result<Self, SimError> {
        let target = parent.join(name);
        let path = can::atomic::folder_beside(&target).map_err(|source| SimError::write(&target, source))?;
        Ok(Self { path })
    }

    fn finish(self, dir: &Path) -> Result<(), SimError> {
        fs::rename(&self.path, dir).map_err(|source| SimError::write(dir, source))?;
        // Some file systems cannot sync a folder; the files in it are already safe.
        if let Ok(folder) = fs::File::open(dir.parent().unwrap_or(Path::new("."))) {
            let _synced = folder.sync_all();
        }
        Ok(())
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        // After `finish` there is nothing under this name.
        let _gone = fs::remove_dir_all(&self.path);
    }
}

fn write_log(
    file: &Path,
    interfaces: &[String],
    mut simulator: Simulator,
    progress: &mut dyn FnMut(f64) -> bool,
) -> Result<(), SimError> {
    let mut log = LogWriter::create(file, interfaces, StampDigits::Micros)?;
    let mut until_report = 0;
    while let Some(stamped) = simulator.next() {
        log.frame(&stamped)?;
        if until_report == 0 {
            until_report = FRAMES_PER_REPORT;
            if !progress(simulator.progress()) {
                return Err(SimError::Interrupted);
            }
        }
        until_report -= 1;
    }
    log.finish()?;
    progress(1.0);
    Ok(())
}

/// What the reference sensor says (text of a reference.csv: s, N, Nm, in E) at every instant at which it is mounted; none
/// where it never is.
#[must_use]
pub fn reference_csv(simulator: &Simulator, scenario: &Scenario, seed: u64) -> Option<String> {
    let sensor = scenario.reference.as_ref()?;
    let mut rng = stream(seed, random::Purpose::Reference);
    let mut text = Vec::new();
    for cycle in 0..simulator.cycles() {
        let t_s = simulator.instant_s(cycle);
        if !sensor.is_mounted(t_s) {
            continue;
        }
        // Calibrations have a real sensor; what an evaluation is judged by is the truth.
        let faults = simulator.truth().imperfections.as_ref().map(|faults| &faults.reference);
        let push = match faults.filter(|_| scenario.purpose == Purpose::Calibration) {
            Some(sensor) => sensor.says(&scenario.push.at(t_s)),
            None => scenario.push.at(t_s),
        };
        let mut reading = [0.0; 6];
        for axis in 0..3 {
            reading[axis] = push.force_n[axis] + sensor.force_sigma_n[axis] * normal(&mut rng);
            reading[3 + axis] = push.moment_nm[axis] + sensor.moment_sigma_nm[axis] * normal(&mut rng);
        }
        let [fx, fy, fz, tx, ty, tz] = reading;
        // Writing into memory cannot fail.
        let _written = writeln!(text, "{t_s:.6},{fx:.6},{fy:.6},{fz:.6},{tx:.6},{ty:.6},{tz:.6}");
    }
    let rows = String::from_utf8(text).ok().filter(|rows| !rows.is_empty())?;
    Some(format!("t,fx,fy,fz,tx,ty,tz\n{rows}"))
}

/// The text of run.toml.
fn description(config: &str, scenario: &Scenario, reference: bool, notes: &Notes) -> String {
    let quoted = |text: &str| toml::Value::String(text.to_owned()).to_string();
    let purpose = match scenario.purpose {
        Purpose::Calibration => "calibration",
        Purpose::Evaluation => "evaluation",
    };
    let mut lines = vec![
        "# Simulated by `wrenchctl simulate`; the truth is in labels.json beside this directory.".to_owned(),
        "format = 1".to_owned(),
        format!("config = {}", quoted(config)),
        format!("log = {}", quoted(LOG_FILE)),
        format!("purpose = {}", quoted(purpose)),
    ];
    if reference {
        lines.push(format!("reference = {}", quoted(REFERENCE_FILE)));
    }
    for (key, value) in [("session", &notes.session), ("repeat_of", &notes.repeat_of)] {
        lines.extend(value.iter().map(|value| format!("{key} = {}", quoted(value))));
    }
    for load in &scenario.loads {
        let [x, y, z] = load.com_m;
        lines.push(format!(
            "\n[[load]]\nfrom = {:?}\nto = {:?}\nmass = {:?}\ncom = [{x:?}, {y:?}, {z:?}]",
            load.from_s, load.to_s, load.mass_kg
        ));
    }
    lines.push(String::new());
    lines.join("\n")
}
