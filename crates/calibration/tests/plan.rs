//! Planned poses against random ones, as foretold and as simulated arms have it.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};

use model::estimator::WrenchEstimator;
use model::motion::JointMotion;
use nalgebra::Vector6;
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use rig::run::{LoadInterval, Loads, Purpose};
use rig::{Config, Rig};
use sim::motion::{MotionLimits, SPEED_SHARE};
use sim::push::Push;
use sim::{Options, Scenario, Simulator, Trajectory, Truth};
use wrenchd_calibration::plan::{self, Goal, Weight};
use wrenchd_calibration::{Axes, Recording, calibrate};

const WEIGHTS: [Weight; 3] = [
    Weight { mass_kg: 0.5, com_m: [0.0, 0.0, 0.05] },
    Weight { mass_kg: 0.5, com_m: [0.08, 0.0, 0.03] },
    Weight { mass_kg: 0.5, com_m: [0.0, 0.08, 0.03] },
];
const PLANNED: usize = 24;

fn arm() -> Rig {
    let file: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml");
    let mut config = Config::load(&file).unwrap();
    // Mounted on a slope: weights then show every direction of every gauge.
    let slope = std::f64::consts::FRAC_PI_4;
    config.robot.gravity_m_s2 = [9.80665 * slope.sin(), 0.0, -9.80665 * slope.cos()];
    Rig::load(config).unwrap()
}

/// A pose and what hangs on the tip there.
type Hold = (Vec<f64>, Option<Weight>);

fn planned(rig: &Rig, known: &[plan::GaugeState], count: usize, seed: u64) -> Vec<Hold> {
    let plan = plan::plan(rig, known, &WEIGHTS, Goal::Count(count), seed).unwrap();
    assert_eq!(plan.poses.len(), count);
    plan.poses.into_iter().map(|pose| (pose.joints_rad, pose.load)).collect()
}

/// Poses by chance within the same share of the joints' ranges, a quarter bare and a quarter under each weight.
fn random(rig: &Rig, count: usize, seed: u64) -> Vec<Hold> {
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let mut rng = StdRng::seed_from_u64(seed);
    (0..count)
        .map(|k| {
            let pose = limits.joints.iter().map(|joint| {
                let (middle, half) =
                    ((joint.lower_rad + joint.upper_rad) / 2.0, (joint.upper_rad - joint.lower_rad) / 2.0);
                middle + 0.9 * half * rng.random_range(-1.0..=1.0)
            });
            (pose.collect(), (4 * k / count).checked_sub(1).map(|weight| WEIGHTS[weight]))
        })
        .collect()
}

/// The arm holds these poses one after another, with real moves between them and frames on a bus.
fn recording(rig: &Rig, truth: &Truth, holds: &[Hold], seed: u64) -> Recording {
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let mut trajectory = Trajectory::from_pose(holds[0].0.clone());
    let mut loads = Vec::new();
    for (pose, load) in holds {
        trajectory.move_to(pose.clone(), &limits, SPEED_SHARE);
        let from_s = trajectory.duration_s() - 0.01;
        trajectory.hold(plan::HOLD_S);
        if let Some(weight) = load {
            let to_s = trajectory.duration_s() + 0.01;
            loads.push(LoadInterval { from_s, to_s, mass_kg: weight.mass_kg, com_m: weight.com_m });
        }
    }
    let scenario = Scenario {
        purpose: Purpose::Calibration,
        rate_hz: 50.0,
        trajectory,
        loads: loads.clone(),
        push: Push::none(),
        reference: None,
    };
    let options = Options { seed, ..Options::default() };
    let simulator = Simulator::new(rig, truth.clone(), &scenario, options).unwrap();
    let mut recording = Recording::from_frames(rig, "simulated", simulator).unwrap();
    recording.loads = Loads::new(loads);
    recording
}

fn found(rig: &Rig, recordings: &[Recording]) -> rig::ModelFile {
    calibrate(rig, recordings, Axes::Full, Vec::new(), "2026-01-01").unwrap().model
}

/// What is wrong with the wrench (N) for the calibration's sake alone: readings without noise, in poses of neither design.
/// RMS of the force error but for the worst twentieth, which is near singular poses.
fn force_error_n(rig: &Rig, truth: &Truth, recordings: &[Recording], seed: u64) -> f64 {
    let found = found(rig, recordings);
    let mut estimator = WrenchEstimator::new(&rig.chain, &rig.sections, found.gauges());
    let mut arm = model::dynamics::Dynamics::new(&rig.chain, &rig.sections);
    let mut rng = StdRng::seed_from_u64(seed ^ 0xFACE);
    let mut errors: Vec<f64> = random(rig, 200, seed ^ 0xF00D)
        .into_iter()
        .map(|(pose, _)| {
            arm.update_static(&pose);
            let push = Vector6::from_fn(|k, _| rng.random_range(-1.0..1.0) * if k < 3 { 5.0 } else { 0.5 });
            let wrench = model::spatial::Wrench::from_vector(&push);
            let counts: Vec<Option<f64>> = truth
                .gauges
                .iter()
                .enumerate()
                .map(|(k, gauge)| {
                    Some(gauge.counts(&(arm.load(k) + arm.load_of_tip_wrench(k, &wrench).to_vector())))
                })
                .collect();
            let still: Vec<JointMotion> = pose.iter().map(|q| JointMotion::at_rest(*q)).collect();
            estimator
                .estimate(&still, &counts)
                .map_or(f64::INFINITY, |s| (s.wrench.force_n - wrench.force_n).norm())
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let most = &errors[..errors.len() * 19 / 20];
    (most.iter().map(|e| e * e).sum::<f64>() / most.len() as f64).sqrt()
}

/// What is foretold of the calibration's part of the force deviation (N), judged where the plan did not look.
fn foretold_n(rig: &Rig, holds: &[Hold], seed: u64) -> f64 {
    let known = plan::unknown(rig);
    let mut dynamics = model::dynamics::Dynamics::new(&rig.chain, &rig.sections);
    let space = plan::Workspace::new(rig, &known, &mut dynamics, 1000 + seed);
    let each = holds.iter().map(|(pose, weight)| (&pose[..], weight.as_ref()));
    space.accuracy(&plan::after(rig, &known, each)).calibration_force_rms_n
}

fn geometric_mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = values.fold((0.0, 0.0), |(sum, n), v| (sum + v.ln(), n + 1.0));
    f64::exp(sum / n)
}

#[test]
fn planned_poses_do_with_fewer_than_random_ones() {
    let rig = arm();
    const ARMS: u64 = 16;
    let plans: Vec<Vec<Hold>> =
        (0..ARMS).map(|seed| planned(&rig, &plan::unknown(&rig), PLANNED, seed)).collect();
    let foretold = |times: f64| {
        let count = (times * PLANNED as f64).round() as usize;
        let ratio = |(holds, seed): (&Vec<Hold>, u64)| {
            foretold_n(&rig, holds, seed) / foretold_n(&rig, &random(&rig, count, seed), seed)
        };
        let mean = geometric_mean(plans.iter().zip(0..).map(ratio));
        println!("{PLANNED} planned over {count} random: foretold {mean:.3}");
        mean
    };
    let (equal, third_more, _half_as_many) = (foretold(1.0), foretold(4.0 / 3.0), foretold(2.0));
    assert!(equal < 0.8 && third_more < 1.0, "{equal} {third_more}");
    // The same from frames on a bus to a calibration.
    let found = geometric_mean(plans.iter().zip(0..).map(|(holds, seed)| {
        let truth = Truth::draw(&rig, 40 + seed, 0.003);
        let error_n =
            |holds: &[Hold]| force_error_n(&rig, &truth, &[recording(&rig, &truth, holds, seed + 100)], seed);
        error_n(holds) / error_n(&random(&rig, PLANNED, seed))
    }));
    println!("{PLANNED} planned over {PLANNED} random: found {found:.3}");
    assert!(found < 0.9, "{found}");
}

/// What was recorded counts: after many poses of the most useful weight, the next ones are with the others.
#[test]
fn what_is_known_already_is_not_planned_again() {
    let rig = arm();
    let fresh = planned(&rig, &plan::unknown(&rig), 24, 1);
    let with = |holds: &[Hold], weight: Weight| holds.iter().filter(|(_, w)| *w == Some(weight)).count();
    let favourite = WEIGHTS.into_iter().max_by_key(|weight| with(&fresh, *weight)).unwrap();
    let recorded: Vec<Hold> =
        random(&rig, 60, 5).into_iter().map(|(pose, _)| (pose, Some(favourite))).collect();
    let each = recorded.iter().map(|(pose, weight)| (&pose[..], weight.as_ref()));
    let known = plan::after(&rig, &plan::unknown(&rig), each);
    let next = planned(&rig, &known, 24, 1);
    let (before, after) = (with(&fresh, favourite), with(&next, favourite));
    assert!(before >= 6 && 2 * after <= before, "{before} {after}");
}

#[test]
fn a_wanted_accuracy_takes_no_more_poses_than_it_needs_or_is_refused() {
    let rig = arm();
    let known = plan::unknown(&rig);
    let ask = |wanted_n: f64| plan::plan(&rig, &known, &WEIGHTS, Goal::ForceSigma(wanted_n), 1);
    let noise_n = ask(1.0).unwrap().noise_alone.force_sigma_n;
    let found = ask(1.03 * noise_n).unwrap();
    let n = found.poses.len();
    assert_eq!(found.progress.len(), n);
    assert!(
        found.after.force_sigma_n <= 1.03 * noise_n && found.progress[n - 2].force_sigma_n > 1.03 * noise_n
    );
    let words = ask(0.99 * noise_n).unwrap_err().to_string();
    assert!(words.contains("noise alone leaves"), "{words}");
    let words = ask(noise_n * (1.0 + 1e-6)).unwrap_err().to_string();
    assert!(words.contains("poses with these weights leave"), "{words}");
    let limits = MotionLimits::of(&rig.chain).unwrap();
    for pose in &found.poses {
        for (angle, joint) in pose.joints_rad.iter().zip(&limits.joints) {
            assert!((joint.lower_rad..=joint.upper_rad).contains(angle), "{} at {angle} rad", joint.name);
        }
    }
}
