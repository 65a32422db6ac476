//! The recording to calibrate from: poses bare, poses under a weight at several points, poses pushed sideways.

use model::spatial::Wrench;
use nalgebra::Vector3;
use rand::RngExt;
use rand::rngs::StdRng;
use rig::run::{LoadInterval, Purpose};

use super::{CALIBRATION_RATE_HZ, ReferenceSensor, Scenario};
use crate::gauge::normal;
use crate::motion::{MotionLimits, SPEED_SHARE, Trajectory};
use crate::push::Push;
use crate::random::{self, stream};

/// Share of the joints' ranges that poses are taken from.
pub(super) const POSE_SHARE: f64 = 0.9;
/// How long a pushed pose takes longer, s: a push grows and goes.
const PUSH_RAMP_S: f64 = 0.4;
/// Rest before and after a change of the weight, s.
const CHANGE_S: f64 = 1.0;
/// Largest push and its largest moment, N and Nm.
const PUSH: (f64, f64) = (10.0, 1.0);

/// How much a calibration records.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationPlan {
    /// Poses with nothing on the tip.
    pub bare_poses: usize,
    /// Poses with each weight.
    pub poses_per_weight: usize,
    /// Weights one after another: kg, and where in E, m.
    pub weights: Vec<(f64, [f64; 3])>,
    /// Poses pushed by hand under a reference sensor.
    pub pushed_poses: usize,
    /// How long each pose is held, s.
    pub hold_s: f64,
    /// Rate of gauges and joints, Hz.
    pub rate_hz: f64,
}

impl Default for CalibrationPlan {
    /// 100 poses bare, 100 with 500 g at each of three points, 40 pushed.
    fn default() -> Self {
        let points = [[0.0, 0.0, 0.05], [0.08, 0.0, 0.03], [0.0, 0.08, 0.03]];
        Self {
            bare_poses: 100,
            poses_per_weight: 100,
            weights: points.map(|point| (0.5, point)).to_vec(),
            pushed_poses: 40,
            hold_s: 1.0,
            rate_hz: CALIBRATION_RATE_HZ,
        }
    }
}

impl CalibrationPlan {
    /// The recording for an arm with these limits, its poses and pushes from `seed`.
    #[must_use]
    pub fn scenario(&self, limits: &MotionLimits, seed: u64) -> Scenario {
        let mut rng = stream(seed, random::Purpose::Motion);
        let mut trajectory = Trajectory::from_pose(limits.random_pose(&mut rng, POSE_SHARE));
        self.visit(self.bare_poses, &mut trajectory, limits, &mut rng);
        let mut loads = Vec::with_capacity(self.weights.len());
        for (mass_kg, com_m) in &self.weights {
            let from_s = self.between_cycles(trajectory.duration_s() + CHANGE_S);
            trajectory.hold(2.0 * CHANGE_S);
            self.visit(self.poses_per_weight, &mut trajectory, limits, &mut rng);
            trajectory.hold(CHANGE_S);
            let to_s = self.between_cycles(trajectory.duration_s());
            loads.push(LoadInterval { from_s, to_s, mass_kg: *mass_kg, com_m: *com_m });
        }
        let mounted_s = self.between_cycles(trajectory.duration_s() + CHANGE_S);
        trajectory.hold(2.0 * CHANGE_S);
        let mut push = Push::none();
        for _ in 0..self.pushed_poses {
            trajectory.move_to(limits.random_pose(&mut rng, POSE_SHARE), limits, SPEED_SHARE);
            let from_s = trajectory.duration_s();
            trajectory.hold(self.hold_s + 2.0 * PUSH_RAMP_S);
            push.trapezoid(from_s, trajectory.duration_s(), PUSH_RAMP_S, random_push(&mut rng));
        }
        trajectory.hold(CHANGE_S);
        let reference = ReferenceSensor {
            mounted_s: vec![(mounted_s, f64::INFINITY)],
            force_sigma_n: [0.02, 0.02, 0.03],
            moment_sigma_nm: [0.001; 3],
        };
        Scenario {
            purpose: Purpose::Calibration,
            rate_hz: self.rate_hz,
            trajectory,
            loads,
            push,
            warming: None,
            reference: (self.pushed_poses > 0).then_some(reference),
        }
    }

    fn visit(&self, poses: usize, trajectory: &mut Trajectory, limits: &MotionLimits, rng: &mut StdRng) {
        for _ in 0..poses {
            trajectory.move_to(limits.random_pose(rng, POSE_SHARE), limits, SPEED_SHARE);
            trajectory.hold(self.hold_s);
        }
    }

    /// An instant (s) half way between two samples, so that no sample's load depends on a stamp's jitter.
    fn between_cycles(&self, t_s: f64) -> f64 {
        ((t_s * self.rate_hz).floor() + 0.5) / self.rate_hz
    }
}

/// A push in any direction with a moment beside it (N, Nm, in E).
fn random_push(rng: &mut StdRng) -> Wrench<model::spatial::Tip> {
    let mut vector = |largest: f64| {
        let direction = Vector3::new(normal(rng), normal(rng), normal(rng));
        direction * (largest * rng.random_range(0.3..1.0) / direction.norm().max(1e-9))
    };
    let force = vector(PUSH.0);
    Wrench::new(force, vector(PUSH.1))
}
