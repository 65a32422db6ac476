//! Arms of other lengths, masses and gauges, each with the model that its own calibration gave.

use std::path::Path;

use calibration::{Axes, Recording, calibrate};
use rig::{ModelFile, Rig, Run};
use sim::output::{Notes, write_run};
use sim::scenario::CalibrationPlan;
use sim::{Options, Truth};

use crate::Result;
use crate::random::Random;

/// One arm as the benchmark knows it.
pub(crate) struct Arm {
    pub(crate) rig: Rig,
    /// What its gauges are really like.
    pub(crate) truth: Truth,
    /// What its calibration says of them.
    pub(crate) model: ModelFile,
    /// A run to be made others of: with the arm's configuration.
    pub(crate) run: Run,
}

/// Lengths and masses differ from the example arm's by at most this factor.
const STRETCH: (f64, f64) = (0.75, 1.35);

impl Arm {
    /// The arm of a seed: the example arm's joints, with other links and gauges.
    pub(crate) fn new(seed: u64) -> Result<Self> {
        let folder = tempfile::tempdir()?;
        let from = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config"));
        for file in ["arm.toml", "arm.dbc"] {
            std::fs::copy(from.join(file), folder.path().join(file))?;
        }
        let urdf = stretched(&std::fs::read_to_string(from.join("arm.urdf"))?, &mut Random::new(seed));
        std::fs::write(folder.path().join("arm.urdf"), urdf)?;
        let rig = Rig::load_file(&folder.path().join("arm.toml"))?;
        let truth = Truth::draw(&rig, seed, 0.002);
        let limits = sim::motion::MotionLimits::of(&rig.chain)?;
        let scenario = CalibrationPlan::default().scenario(&limits, seed);
        let dir = folder.path().join("calibration");
        let options = Options { seed, ..Options::default() };
        write_run(&dir, &rig, &truth, &scenario, options, &Notes::default(), &mut |_| true)?;
        let run = Run::load(&dir)?;
        let recording = Recording::read(&run, &rig, |_| {})?;
        let model = calibrate(&rig, &[recording], Axes::Full, Vec::new(), "2026-01-01")?.model;
        Ok(Self { rig, truth, model, run })
    }
}

/// A URDF with other lengths (of origins) and masses (with their inertias).
fn stretched(urdf: &str, random: &mut Random) -> String {
    let mut out = String::with_capacity(urdf.len());
    for line in urdf.lines() {
        let (length, mass) = (random.between(STRETCH.0, STRETCH.1), random.between(STRETCH.0, STRETCH.1));
        let mut line = scaled(
            line,
            "xyz=\"",
            if line.contains("<axis") && !line.contains("<origin") { 1.0 } else { length },
        );
        line = scaled(&line, "mass value=\"", mass);
        for name in ["ixx", "ixy", "ixz", "iyy", "iyz", "izz"] {
            line = scaled(&line, &format!("{name}=\""), mass * length * length);
        }
        out.push_str(&line);
        out.push('\n');
    }
    out
}

/// The first attribute of a line that begins so, with all its numbers times a factor.
fn scaled(line: &str, attribute: &str, factor: f64) -> String {
    let Some(from) = line.find(attribute).map(|at| at + attribute.len()) else { return line.to_owned() };
    let Some(to) = line[from..].find('"').map(|length| from + length) else { return line.to_owned() };
    let number =
        |text: &str| text.parse::<f64>().map_or(text.to_owned(), |value| format!("{}", value * factor));
    let numbers: Vec<String> = line[from..to].split_whitespace().map(number).collect();
    format!("{}{}{}", &line[..from], numbers.join(" "), &line[to..])
}
