//! A run directory: one recording, the loads that hung on the tip, and where there is one the reference wrench.
//!
//! Times are seconds from the log's first frame. Frames: everything that acts on the arm is in E, the tip frame.

mod loads;
mod reference;

use std::path::{Path, PathBuf};

use serde::Deserialize;

pub use loads::{LoadInterval, Loads};
pub use reference::{MOUNTED_WITHIN_S, Reference, ReferenceRow};

use crate::config::Config;
use crate::document::Step::{self, Index, Key};
use crate::document::{self, Problem};
use crate::error::{RigError, read_text};

/// What a log may lack at its end of what run.toml says about it (s): intervals are noted by hand, to whole cycles.
pub const SPAN_TOLERANCE_S: f64 = 1.0;

/// A recording with what is known about it.
#[derive(Debug, Clone)]
pub struct Run {
    /// The directory, as it was given.
    pub dir: PathBuf,
    /// The robot that was recorded.
    pub config: Config,
    /// The candump log, plain, gzip or zstd.
    pub log: PathBuf,
    /// What it was recorded for.
    pub purpose: Purpose,
    /// Runs of one session share the gauges' zeros; absent = a session of its own.
    pub session: Option<String>,
    /// Name of the run with the same motion and load.
    pub repeat_of: Option<String>,
    /// What hung on the tip, and when.
    pub loads: Loads,
    /// Stretches that are not to be used, in the file's order.
    pub excludes: Vec<Exclude>,
    /// Wrench that acted on the tip beside the loads, where it was measured or known.
    pub reference: Option<Reference>,
    reference_file: Option<PathBuf>,
    text: String,
}

/// What a run was recorded for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Purpose {
    /// To find the gauges' compliances.
    Calibration,
    /// To see how good the wrench is.
    Evaluation,
}

/// A stretch of a run, from <= t < to, that is not to be used.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Exclude {
    /// Its beginning (s from the log's first frame).
    #[serde(rename = "from")]
    pub from_s: f64,
    /// Its end (s from the log's first frame).
    #[serde(rename = "to")]
    pub to_s: f64,
    /// Why it is not to be used.
    #[serde(default)]
    pub why: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RunFile {
    #[serde(rename = "format")]
    _format: u32,
    config: PathBuf,
    log: PathBuf,
    purpose: Purpose,
    reference: Option<PathBuf>,
    session: Option<String>,
    repeat_of: Option<String>,
    #[serde(default)]
    load: Vec<LoadInterval>,
    #[serde(default)]
    exclude: Vec<Exclude>,
}

impl Run {
    /// The run in a directory: its run.toml, configuration and reference, checked; the log is only looked for.
    pub fn load(dir: &Path) -> Result<Self, RigError> {
        let file = dir.join("run.toml");
        if !file.exists() {
            return Err(no_run(dir));
        }
        let text = read_text(&file, "a run's description (TOML)")?;
        let parsed: RunFile = document::parse(&file, &text)?;
        check(&parsed).map_err(|problem| document::locate(&file, &text, problem))?;
        let there = |key: &'static str, path: &Path, what: &str| {
            let whole = dir.join(path);
            let problem = || {
                let said = format!("{key} = \"{}\" is not there; give {what}", path.display());
                document::locate(&file, &text, Problem::new(&[Key(key)], said))
            };
            if whole.is_file() { Ok(whole) } else { Err(problem()) }
        };
        let log = there("log", &parsed.log, "the candump log's path")?;
        let config = Config::load(&there("config", &parsed.config, "the path of a configuration (TOML)")?)?;
        let table = |path: PathBuf| there("reference", &path, "the path of the reference's table (CSV)");
        let reference_file = parsed.reference.map(table).transpose()?;
        let reference = reference_file.as_deref().map(Reference::load).transpose()?;
        Ok(Self {
            dir: dir.to_owned(),
            config,
            log,
            purpose: parsed.purpose,
            session: parsed.session,
            repeat_of: parsed.repeat_of,
            loads: Loads::new(parsed.load),
            excludes: parsed.exclude,
            reference,
            reference_file,
            text,
        })
    }

    /// Every file that it was read from, and its log.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        let own = [self.dir.join("run.toml"), self.log.clone()];
        own.into_iter().chain(self.reference_file.clone()).chain(self.config.files()).collect()
    }

    /// Whether an instant (s from the log's first frame) lies in an excluded stretch.
    #[must_use]
    pub fn is_excluded(&self, t_s: f64) -> bool {
        self.excludes.iter().any(|exclude| exclude.from_s <= t_s && t_s < exclude.to_s)
    }

    /// Whether run.toml and the reference keep to a log of this length (s), to within [`SPAN_TOLERANCE_S`].
    pub fn check_span(&self, log_duration_s: f64) -> Result<(), RigError> {
        let end_s = log_duration_s + SPAN_TOLERANCE_S;
        let remedy = format!(
            "the log lasts {log_duration_s:.3} s; correct the interval or give the log that belongs to it"
        );
        let outside = |table: &'static str, index: usize, from_s: f64, to_s: f64| {
            let at = [Key(table), Index(index)];
            let problem = Problem::new(
                &at,
                format!("[[{table}]] from {from_s} to {to_s} s is outside the log: {remedy}"),
            );
            Err(document::locate(&self.dir.join("run.toml"), &self.text, problem))
        };
        for (index, load) in self.loads.intervals().iter().enumerate() {
            if load.from_s < 0.0 || load.from_s >= end_s || load.to_s > end_s {
                return outside("load", index, load.from_s, load.to_s);
            }
        }
        for (index, exclude) in self.excludes.iter().enumerate() {
            if exclude.from_s >= end_s || exclude.to_s <= 0.0 {
                return outside("exclude", index, exclude.from_s, exclude.to_s);
            }
        }
        let Some(reference) = &self.reference else { return Ok(()) };
        reference.check_span(log_duration_s)
    }
}

fn no_run(dir: &Path) -> RigError {
    let problem = if dir.join("comparison.toml").exists() {
        "holds a comparison, not a run; only `wrenchctl diagnose` takes it"
    } else if dir.is_dir() {
        "has no run.toml; give a run directory (run.toml with its log beside it)"
    } else if dir.extension().is_some_and(|extension| extension == "toml") && dir.exists() {
        "is not a run directory; give the folder that it is in"
    } else if dir.exists() {
        "is not a run directory; give the folder that run.toml is in"
    } else {
        "does not exist; give a run directory (run.toml with its log beside it)"
    };
    RigError::of_file(dir, problem)
}

fn check(run: &RunFile) -> Result<(), Problem> {
    for (index, load) in run.load.iter().enumerate() {
        let at = |key| [Key("load"), Index(index), Key(key)];
        interval(&at("to"), "[[load]]", load.from_s, load.to_s)?;
        if !(load.mass_kg.is_finite() && load.mass_kg >= 0.0) {
            let text = format!("[[load]] mass = {} must be a finite number of kg, 0 or more", load.mass_kg);
            return Err(Problem::new(&at("mass"), text));
        }
        if !load.com_m.iter().all(|x| x.is_finite()) {
            return Err(Problem::new(
                &at("com"),
                format!("[[load]] com = {:?} is not finite; give metres", load.com_m),
            ));
        }
    }
    for (index, exclude) in run.exclude.iter().enumerate() {
        let at = [Key("exclude"), Index(index), Key("to")];
        interval(&at, "[[exclude]]", exclude.from_s, exclude.to_s)?;
    }
    let names = [("session", &run.session), ("repeat_of", &run.repeat_of)];
    for (key, name) in names {
        if name.as_ref().is_some_and(|name| name.trim().is_empty()) {
            return Err(Problem::new(&[Key(key)], format!("{key} is empty; fill it in or remove it")));
        }
    }
    Ok(())
}

fn interval(at: &[Step], table: &str, from_s: f64, to_s: f64) -> Result<(), Problem> {
    if from_s.is_finite() && to_s.is_finite() && from_s < to_s {
        return Ok(());
    }
    let text = format!(
        "{table} from = {from_s}, to = {to_s}: `from` must be before `to`, both in s from the first frame"
    );
    Err(Problem::new(at, text))
}
