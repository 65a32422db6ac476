//! `wrenchctl simulate`: a run directory from the simulator, the truth in labels.json beside it.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;

use rig::{ModelFile, Rig};
use sim::effects::{Effects, Spec};
use sim::motion::MotionLimits;
use sim::output::{LABELS_FILE, Notes, write_run};
use sim::{Options, Preset, Scenario, Simulator, Trajectory, Truth};

use crate::progress::Progress;
use crate::{Error, Outcome, live, output};

/// What to simulate.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Configuration of the robot
    #[arg(long, value_name = "CONFIG")]
    pub config: PathBuf,
    /// Model whose gauges and encoders are simulated [default: gauges with crosstalk drawn from --gauges]
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// calibration, accuracy, sweep, holds, or a CSV file: t (s) and one column a joint (rad), named in its first line
    #[arg(long, value_name = "MOTION", default_value = "accuracy")]
    pub motion: String,
    /// Point mass on the tip all the time: kg, and where in the tip frame, m; may be repeated [default: what the motion hangs there]
    #[arg(long = "load", value_name = "M,X,Y,Z", value_parser = load, allow_hyphen_values = true)]
    pub loads: Vec<[f64; 4]>,
    /// Effect beyond the nominal arm, with its parameters or size=RMS change in noise floors; may be repeated
    #[arg(long = "effect", value_name = "ID@PLACE[,key=value]...")]
    pub effects: Vec<String>,
    /// Seed of poses, noise and jitter: the same seed gives the same frames
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Seed of the drawn gauges: runs of one arm have the same
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "model")]
    pub gauges: u64,
    /// Rate of gauges and joints, Hz [default: 50 for calibration, else 125]
    #[arg(long, value_name = "HZ")]
    pub rate: Option<f64>,
    /// Name that runs with the same gauge zeros share [default: a session of its own]
    #[arg(long, value_name = "NAME")]
    pub session: Option<String>,
    /// Name of the run with the same motion and load
    #[arg(long, value_name = "RUN")]
    pub repeat_of: Option<String>,
    /// Run directory to make; it must not exist yet
    #[arg(long, value_name = "RUN")]
    pub out: PathBuf,
}

fn load(text: &str) -> Result<[f64; 4], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let load = numbers.and_then(|numbers| <[f64; 4]>::try_from(numbers).ok());
    let load = load.filter(|load| load[0] >= 0.0 && load.iter().all(|number| number.is_finite()));
    load.ok_or_else(|| "give mass and place as M,X,Y,Z in kg and m, such as 0.5,0,0,0.05".into())
}

/// Simulates and writes the run.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let specs = args.effects.iter().map(|text| text.parse()).collect::<Result<Vec<Spec>, _>>()?;
    let rig = Rig::load_file(&args.config)?;
    let mut truth = match &args.model {
        Some(path) => Truth::from_model(&rig, &ModelFile::load(path, &rig)?)?,
        None => Truth::draw(&rig, args.gauges, 0.0),
    };
    let mut scenario = scenario(&rig, &args.motion, args.seed)?;
    for [mass_kg, x, y, z] in &args.loads {
        scenario = scenario.with_load(*mass_kg, [*x, *y, *z])?;
    }
    truth.effects = Effects::new(&rig, &truth, &scenario, &specs, args.seed)?;
    let options = Options { seed: args.seed, rate_hz: args.rate, ..Options::default() };
    let notes = Notes { session: args.session, repeat_of: args.repeat_of };
    // Refused before anything is written, and the figures of the summary.
    let cycles = Simulator::new(&rig, truth.clone(), &scenario, options)?.cycles();
    let progress = Progress::steps(100, "simulating");
    let interrupted = live::interrupted();
    write_run(&args.out, &rig, &truth, &scenario, options, &notes, &mut |share| {
        progress.at((100.0 * share) as u64);
        !interrupted.load(Ordering::Relaxed)
    })?;
    drop(progress);
    let mut out = output::stdout();
    let labels = args.out.with_file_name(LABELS_FILE);
    writeln!(
        out,
        "{}: {:.1} s, {cycles} instants; the truth is in {}",
        args.out.display(),
        scenario.duration_s(),
        labels.display()
    )?;
    out.flush()?;
    Ok(Outcome::Done)
}

fn scenario(rig: &Rig, motion: &str, seed: u64) -> Result<Scenario, Error> {
    let path = Path::new(motion);
    if path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv")) {
        let limits = MotionLimits::of(&rig.chain)?;
        return Ok(Scenario::of_motion(Trajectory::from_csv(path, &limits)?));
    }
    let preset: Preset = motion.parse()?;
    Ok(preset.scenario(&rig.chain, seed)?)
}
