//! Sweeps through the joints' ranges, and held poses, without loads.

use super::calibration::POSE_SHARE;
use super::{EVALUATION_RATE_HZ, Scenario};
use crate::motion::{MotionLimits, SPEED_SHARE, Trajectory};
use crate::random::{self, stream};

/// Share of the speed limit in slow sweeps.
const SLOW_SHARE: f64 = 0.15;
/// Rest at the turning points, s.
const REST_S: f64 = 0.5;
/// Held poses, and how long each is held, s.
const HOLDS: (usize, f64) = (20, 2.0);

/// Each joint by itself to both ends of its range: slowly there, fast back; then all of them together, slow and fast.
pub(super) fn sweep(limits: &MotionLimits) -> Scenario {
    let middle = limits.middle();
    let at = |coordinate: usize, end: f64| {
        let joint = &limits.joints[coordinate];
        middle[coordinate] + end * POSE_SHARE * (joint.upper_rad - joint.lower_rad) / 2.0
    };
    let mut trajectory = Trajectory::from_pose(middle.clone());
    trajectory.hold(2.0 * REST_S);
    let mut both_speeds = |there: Vec<f64>, back: Vec<f64>| {
        for share in [SLOW_SHARE, SPEED_SHARE] {
            for pose in [&there, &back, &middle] {
                trajectory.move_to(pose.clone(), limits, share);
                trajectory.hold(REST_S);
            }
        }
    };
    for coordinate in 0..middle.len() {
        let one = |end: f64| {
            let mut pose = middle.clone();
            pose[coordinate] = at(coordinate, end);
            pose
        };
        both_speeds(one(-1.0), one(1.0));
    }
    let all = |end: f64| (0..middle.len()).map(|coordinate| at(coordinate, end)).collect::<Vec<_>>();
    both_speeds(all(-1.0), all(1.0));
    Scenario { rate_hz: EVALUATION_RATE_HZ, ..Scenario::of_motion(trajectory) }
}

/// Random poses, each held for a while.
pub(super) fn holds(limits: &MotionLimits, seed: u64) -> Scenario {
    let mut rng = stream(seed, random::Purpose::Motion);
    let mut trajectory = Trajectory::from_pose(limits.random_pose(&mut rng, POSE_SHARE));
    let (poses, seconds) = HOLDS;
    for _ in 0..poses {
        trajectory.hold(seconds);
        trajectory.move_to(limits.random_pose(&mut rng, POSE_SHARE), limits, SPEED_SHARE);
    }
    trajectory.hold(seconds);
    Scenario::of_motion(trajectory)
}
