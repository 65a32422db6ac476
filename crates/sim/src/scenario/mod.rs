//! What happens in a simulation: the motion, what hangs on the tip, what pushes it, and what measures the push.

mod accuracy;
mod calibration;
mod sweep;

use std::str::FromStr;

use model::chain::Chain;
use rig::run::{LoadInterval, Purpose};

pub use calibration::CalibrationPlan;

use crate::SimError;
pub use crate::climate::Warming;
use crate::motion::{MotionLimits, Trajectory};
use crate::push::Push;

/// Rate of gauges and joints in calibrations, Hz.
pub const CALIBRATION_RATE_HZ: f64 = 50.0;
/// Rate of gauges and joints in other scenarios, Hz.
pub const EVALUATION_RATE_HZ: f64 = 125.0;

/// A reference sensor at the tip: when it is mounted, and its noise.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceSensor {
    /// From when to when (s from the beginning) it is mounted.
    pub mounted_s: Vec<(f64, f64)>,
    /// Noise of the force, N, E's axes.
    pub force_sigma_n: [f64; 3],
    /// Noise of the moment, Nm, E's axes.
    pub moment_sigma_nm: [f64; 3],
}

impl ReferenceSensor {
    /// Whether it is mounted at an instant (s from the beginning).
    #[must_use]
    pub fn is_mounted(&self, t_s: f64) -> bool {
        self.mounted_s.iter().any(|(from_s, to_s)| *from_s <= t_s && t_s < *to_s)
    }
}

/// One session in the simulator.
#[derive(Clone, Debug, PartialEq)]
pub struct Scenario {
    /// What its recording is for.
    pub purpose: Purpose,
    /// Rate of gauges and joints unless the options say otherwise, Hz.
    pub rate_hz: f64,
    /// How the arm moves.
    pub trajectory: Trajectory,
    /// Point masses at the tip (s from the beginning, kg, m in E).
    pub loads: Vec<LoadInterval>,
    /// Wrench on the tip beside the loads.
    pub push: Push,
    /// What measures the push; without it a recording has no reference.csv.
    pub reference: Option<ReferenceSensor>,
    /// What the arm warms up by; none: half a kelvin in a quarter of an hour.
    pub warming: Option<Warming>,
}

/// Scenarios that come with a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Preset {
    /// Held poses bare, then with a weight at three points, then pushed sideways under a reference sensor.
    Calibration,
    /// Four held poses with forces to 5 N and moments to 0.5 Nm, then motion under a steady push; the truth as reference.
    Accuracy,
    /// Every joint slowly through its range and fast back, then all at once.
    Sweep,
    /// Held poses, nothing else.
    Holds,
}

impl Preset {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Calibration, Self::Accuracy, Self::Sweep, Self::Holds];

    /// Its name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Calibration => "calibration",
            Self::Accuracy => "accuracy",
            Self::Sweep => "sweep",
            Self::Holds => "holds",
        }
    }

    /// The scenario for an arm, its random poses from `seed`.
    ///
    /// # Errors
    /// A joint whose limits leave no motion.
    pub fn scenario(self, chain: &Chain, seed: u64) -> Result<Scenario, SimError> {
        let limits = MotionLimits::of(chain)?;
        Ok(match self {
            Self::Calibration => CalibrationPlan::default().scenario(&limits, seed),
            Self::Accuracy => accuracy::accuracy(&limits, seed, &|_| true),
            Self::Sweep => sweep::sweep(&limits),
            Self::Holds => sweep::holds(&limits, seed),
        })
    }
}

impl FromStr for Preset {
    type Err = SimError;

    fn from_str(text: &str) -> Result<Self, SimError> {
        Self::ALL.into_iter().find(|preset| preset.name() == text).ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            SimError::Option(format!(
                "\"{text}\" is no motion; give a CSV file (its name ends in .csv) or one of {names}"
            ))
        })
    }
}

impl Scenario {
    /// A motion without loads, pushes or reference.
    #[must_use]
    pub fn of_motion(trajectory: Trajectory) -> Self {
        Self {
            purpose: Purpose::Evaluation,
            rate_hz: EVALUATION_RATE_HZ,
            trajectory,
            loads: Vec::new(),
            push: Push::none(),
            reference: None,
            warming: None,
        }
    }

    /// [`Preset::Accuracy`] in held poses (rad, base to tip) that `accept` takes, such as those in which gauges see all directions well.
    #[must_use]
    pub fn accuracy_in(limits: &MotionLimits, seed: u64, accept: &dyn Fn(&[f64]) -> bool) -> Self {
        accuracy::accuracy(limits, seed, accept)
    }

    /// The same with a point mass (kg, m in E) at the tip all the time, beside what hangs there anyway.
    ///
    /// # Errors
    /// A mass that is negative, or a number that is not finite.
    pub fn with_load(mut self, mass_kg: f64, com_m: [f64; 3]) -> Result<Self, SimError> {
        if !(mass_kg >= 0.0 && mass_kg.is_finite() && com_m.iter().all(|x| x.is_finite())) {
            return Err(SimError::Option(format!(
                "a load of {mass_kg} kg at {com_m:?} m cannot hang at the tip; give a mass of 0 kg or more and a finite point"
            )));
        }
        let to_s = self.duration_s();
        self.loads.push(LoadInterval { from_s: 0.0, to_s, mass_kg, com_m });
        Ok(self)
    }

    /// How long it lasts, s.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.trajectory.duration_s()
    }
}
