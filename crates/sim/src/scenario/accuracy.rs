//! The published experiment: forces 0 -> 5 N -> 0 along x, y and z in four held poses; then motion under a steady push.

use model::spatial::{Tip, Wrench};
use nalgebra::Vector3;
use rand::RngExt;
use rand::rngs::StdRng;
use rig::run::Purpose;

use super::calibration::POSE_SHARE;
use super::{EVALUATION_RATE_HZ, ReferenceSensor, Scenario};
use crate::motion::{MotionLimits, SPEED_SHARE, Sine, Sines, Trajectory};
use crate::push::Push;
use crate::random::{self, stream};

/// Held poses.
const POSES: usize = 4;
/// Largest force, N, and moment, Nm.
const FORCE_N: f64 = 5.0;
const MOMENT_NM: f64 = 0.5;
/// Time from nothing to the largest force, and back, s; the moment follows by as much.
const RISE_S: f64 = 1.75;
/// Rest before, between and after, s.
const REST_S: f64 = 1.0;
/// Motion under the steady push, s.
const MOTION_S: f64 = 20.0;

/// Poses that are drawn at most for one that is accepted.
const DRAWS: usize = 1000;

/// The experiment for an arm with these limits, its poses and motion from `seed`; a held pose (rad, base to tip) is drawn again until
/// `accept` takes it.
pub(super) fn accuracy(limits: &MotionLimits, seed: u64, accept: &dyn Fn(&[f64]) -> bool) -> Scenario {
    let mut rng = stream(seed, random::Purpose::Motion);
    let held = |rng: &mut StdRng| {
        let mut pose = limits.random_pose(rng, POSE_SHARE);
        for _ in 1..DRAWS {
            if accept(&pose) {
                break;
            }
            pose = limits.random_pose(rng, POSE_SHARE);
        }
        pose
    };
    let mut trajectory = Trajectory::from_pose(held(&mut rng));
    let mut push = Push::none();
    for pose in 0..POSES {
        if pose > 0 {
            trajectory.move_to(held(&mut rng), limits, SPEED_SHARE);
        }
        trajectory.hold(REST_S);
        for axis in 0..3 {
            let sign = if rng.random_bool(0.5) { 1.0 } else { -1.0 };
            pull(&mut push, trajectory.duration_s(), axis, sign);
            trajectory.hold(3.0 * RISE_S + REST_S / 4.0);
        }
    }
    // The motion begins away from the limits, so that it has room.
    trajectory.move_to(limits.random_pose(&mut rng, POSE_SHARE / 3.0), limits, SPEED_SHARE);
    let from_s = trajectory.duration_s();
    trajectory.hold(REST_S);
    trajectory.swing(random_swing(trajectory.last_pose(), limits, MOTION_S, &mut rng));
    trajectory.hold(REST_S);
    let force = Vector3::new(-0.9, 0.3, 3.2);
    let moment = Vector3::new(-0.16, -0.02, 0.09);
    push.trapezoid(from_s, trajectory.duration_s(), REST_S / 2.0, Wrench::new(force, moment));
    let whole_s = vec![(0.0, f64::INFINITY)];
    Scenario {
        purpose: Purpose::Evaluation,
        rate_hz: EVALUATION_RATE_HZ,
        trajectory,
        loads: Vec::new(),
        push,
        warming: None,
        reference: Some(ReferenceSensor {
            mounted_s: whole_s,
            force_sigma_n: [0.0; 3],
            moment_sigma_nm: [0.0; 3],
        }),
    }
}

/// A force along one axis of E that grows and goes, followed by a moment about another.
fn pull(push: &mut Push, from_s: f64, axis: usize, sign: f64) {
    let unit = |along: usize, about: usize, force: f64, moment: f64| -> Wrench<Tip> {
        let (mut f, mut m) = (Vector3::zeros(), Vector3::zeros());
        f[along] = force;
        m[about] = moment;
        Wrench::new(f, m)
    };
    let about = (axis + 2) % 3;
    push.knot(from_s, Wrench::zero());
    push.knot(from_s + RISE_S, unit(axis, about, FORCE_N, 0.0));
    push.knot(from_s + 2.0 * RISE_S, unit(axis, about, 0.0, sign * MOMENT_NM));
    push.knot(from_s + 3.0 * RISE_S, Wrench::zero());
}

/// All joints at once, each with two frequencies that no other has (rad, Hz).
pub(super) fn random_swing(
    center_rad: &[f64],
    limits: &MotionLimits,
    seconds: f64,
    rng: &mut StdRng,
) -> Sines {
    let mut swing = |joint: usize| {
        let slow_hz = 0.05 + 0.017 * joint as f64;
        let term = |frequency_hz: f64, amplitude_rad: f64, rng: &mut StdRng| Sine {
            amplitude_rad: amplitude_rad * rng.random_range(0.7..1.0),
            frequency_hz,
            phase_rad: rng.random_range(0.0..std::f64::consts::TAU),
        };
        vec![term(slow_hz, 0.8, rng), term(3.3 * slow_hz, 0.25, rng)]
    };
    let terms = (0..center_rad.len()).map(&mut swing).collect();
    Sines::new(center_rad.to_vec(), terms, seconds, 2.0, limits, SPEED_SHARE)
}
