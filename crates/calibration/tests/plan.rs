//! Planned poses against random ones: half as many reach the same accuracy, as foretold and as simulated arms have it.

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
    Rig::load(Config::load(&file).unwrap()).unwrap()
}

/// A pose and what hangs on the tip there.
type Hold = (Vec<f64>, Option<Weight>);

fn planned(rig: &Rig, count: usize, seed: u64) -> Vec<Hold> {
    let plan = plan::plan(rig, &plan::unknown(rig), &WEIGHTS, Goal::Count(count), seed).unwrap();
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

/// What is wrong with the wrench (N) for the calibration's sake alone: readings without noise, in poses of neither design.
/// The largest force error but for the worst twentieth, which is near singular poses.
fn force_error_n(rig: &Rig, truth: &Truth, holds: &[Hold], seed: u64) -> f64 {
    let recording = recording(rig, truth, holds, seed);
    let found = calibrate(rig, &[recording], Axes::Full, Vec::new(), "2026-01-01").unwrap();
    let mut estimator = WrenchEstimator::new(&rig.chain, &rig.sections, found.model.gauges());
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
    errors[errors.len() * 19 / 20]
}

#[test]
fn planned_poses_do_with_half_as_many_as_random_ones() {
    let rig = arm();
    let mut ratios = Vec::new();
    for seed in 0..8 {
        let truth = Truth::draw(&rig, 40 + seed, 0.003);
        let by_plan = force_error_n(&rig, &truth, &planned(&rig, PLANNED, seed), seed);
        let by_chance = force_error_n(&rig, &truth, &random(&rig, 2 * PLANNED, seed), seed);
        println!(
            "arm {}: {PLANNED} planned {by_plan:.4} N, {} random {by_chance:.4} N",
            40 + seed,
            2 * PLANNED
        );
        ratios.push(by_plan / by_chance);
    }
    ratios.sort_by(f64::total_cmp);
    println!("planned over twice as many random: median {:.2}, {ratios:.2?}", (ratios[3] + ratios[4]) / 2.0);
    assert!((ratios[3] + ratios[4]) / 2.0 <= 1.0, "{ratios:?}");
}
