//! One arm as it is built: recorded, calibrated, recorded on another day, scored.

use std::fmt;
use std::path::{Path, PathBuf};

use calibration::validate::validate;
use calibration::{Axes, Recording, calibrate};
use model::dynamics::Dynamics;
use rig::run::{Loads, Reference, Run};
use rig::{Config, ModelFile, Rig};
use sim::motion::MotionLimits;
use sim::output::{Notes, write_run};
use sim::{JointState, Options, Preset, Scenario, Simulator, Truth};
use wrenchd_calibration as calibration;

/// Largest pitch of the drawn gauges, m.
const PITCH_M: f64 = 0.003;

/// Poses are held in which noise alone would make a force error of less than this, N: one tests a sensor where it sees.
const SEEN_WELL_N: f64 = 0.03;

/// The other day's poses and noise come from other seeds.
const OTHER_DAY: u64 = 5_000;

/// What came out for one arm.
#[derive(Clone, Debug)]
pub(crate) struct Trial {
    pub(crate) seed: u64,
    /// RMS of the force on still instants, N: ours, of the five-parameter method, and what gauges known exactly would have.
    pub(crate) force_rms_n: f64,
    pub(crate) five_rms_n: f64,
    pub(crate) noise_alone_n: f64,
    pub(crate) nees: [f64; 6],
    /// Components of still wrenches within 1.96 sigma, and all.
    pub(crate) covered_wrench: (f64, f64),
    pub(crate) admitted: String,
}

impl fmt::Display for Trial {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ratio = self.force_rms_n / self.noise_alone_n;
        let coverage = 100.0 * self.covered_wrench.0 / self.covered_wrench.1;
        let (seed, ours, noise, five) = (self.seed, self.force_rms_n, self.noise_alone_n, self.five_rms_n);
        write!(
            f,
            "arm {seed}: {ours:.4} N, noise alone {noise:.4} ({ratio:.2}), five-parameter {five:.3}, nees"
        )?;
        self.nees.iter().try_for_each(|nees| write!(f, " {nees:.2}"))?;
        write!(f, ", covered {coverage:.0} %; {}", self.admitted)
    }
}

pub(crate) fn arm() -> Rig {
    let file: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml");
    Rig::load(Config::load(&file).unwrap()).unwrap()
}

/// Calibrates and scores the arms of these seeds, one after the other: each uses all cores.
pub(crate) fn try_arms(seeds: std::ops::Range<u64>) -> Vec<Trial> {
    let rig = arm();
    seeds.map(|seed| try_arm(&rig, seed)).inspect(|trial| println!("{trial}")).collect()
}

fn try_arm(rig: &Rig, seed: u64) -> Trial {
    let truth = Truth::draw(rig, seed, PITCH_M).with_imperfections(rig, seed).unwrap();
    let (model, admitted) = calibrated(rig, &truth, seed);
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let seen_well = |pose: &[f64]| noise_alone_n2(&rig_at(rig, pose), &truth) < SEEN_WELL_N.powi(2);
    let scenario = Scenario::accuracy_in(&limits, seed + OTHER_DAY, &seen_well);
    let folder = tempfile::tempdir().unwrap();
    let options = Options { seed: seed + OTHER_DAY, ..Options::default() };
    let dir = folder.path().join("accuracy");
    write_run(&dir, rig, &truth, &scenario, options, &Notes::default(), &mut |_| true).unwrap();
    let run = Run::load(&dir).unwrap();
    let recording = Recording::read(&run, rig, |_| ()).unwrap();
    let (mut within, mut of) = (0.0, 0.0);
    let mut noise_n2 = 0.0;
    let found = validate(&[(&run, recording)], rig, &model, false, |row| {
        if let Ok(solution) = &row.estimate.outcome
            && row.still
        {
            let error = solution.wrench.to_vector() - row.truth.to_vector();
            for k in 0..6 {
                within += f64::from(u8::from(error[k].abs() < 1.96 * solution.covariance[(k, k)].sqrt()));
                of += 1.0;
            }
            noise_n2 += noise_alone_n2(&rig_at(rig, &positions(&scenario, row.t_s)), &truth);
        }
        Ok(())
    })
    .unwrap();
    Trial {
        seed,
        force_rms_n: found.still.force_rms_all_n.unwrap(),
        five_rms_n: found.five_parameter.still.force_rms_all_n.unwrap(),
        noise_alone_n: (noise_n2 / (of / 6.0)).sqrt(),
        nees: found.still.nees.unwrap(),
        covered_wrench: (within, of),
        admitted,
    }
}

/// The model from a calibration recording, and what was admitted.
pub(crate) fn calibrated(rig: &Rig, truth: &Truth, seed: u64) -> (ModelFile, String) {
    let recording = recorded(rig, truth, seed);
    let found = calibrate(rig, &[recording], Axes::Full, Vec::new(), "2026-01-01").unwrap();
    let short = |text: &String| text.split("better for it: ").nth(1).map(str::to_owned);
    let admitted: Vec<String> = found.warnings.iter().filter_map(short).collect();
    (found.model, admitted.join("; "))
}

fn recorded(rig: &Rig, truth: &Truth, seed: u64) -> Recording {
    let scenario = Preset::Calibration.scenario(&rig.chain, seed).unwrap();
    let options = Options { seed, ..Options::default() };
    let simulator = Simulator::new(rig, truth.clone(), &scenario, options).unwrap();
    let csv = sim::output::reference_csv(&simulator, &scenario, seed).unwrap();
    let mut recording = Recording::from_frames(rig, "simulated", simulator).unwrap();
    recording.loads = Loads::new(scenario.loads.clone());
    recording.reference = Some(Reference::parse(Path::new("reference.csv"), &csv).unwrap());
    recording
}

/// Where the encoders are at an instant (s), rad.
fn positions(scenario: &Scenario, t_s: f64) -> Vec<f64> {
    let mut state = JointState::at_rest(scenario.trajectory.coordinates());
    scenario.trajectory.at(t_s, &mut state);
    state.positions_rad
}

/// The arm as its URDF has it in a pose (rad).
fn rig_at(rig: &Rig, pose: &[f64]) -> Dynamics {
    let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
    dynamics.update_static(pose);
    dynamics
}

/// Mean variance of the force's components, N^2, for one who knows everything but the noise.
fn noise_alone_n2(dynamics: &Dynamics, truth: &Truth) -> f64 {
    let mut information = nalgebra::Matrix6::<f64>::zeros();
    for (k, gauge) in truth.gauges.iter().enumerate() {
        let row = dynamics.row_to_tip(k, &gauge.compliance.vector()) / gauge.noise.sigma_counts;
        information += row * row.transpose();
    }
    information.try_inverse().map_or(f64::INFINITY, |c| (0..3).map(|k| c[(k, k)]).sum::<f64>() / 3.0)
}
