//! Planned poses against random ones, as foretold and as simulated arms have it.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};

use model::estimator::{GaugeReading, WrenchEstimator};
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

const POINTS_M: [[f64; 3]; 3] = [[0.0, 0.0, 0.05], [0.08, 0.0, 0.03], [0.0, 0.08, 0.03]];

/// One mass at three points.
fn one_mass() -> Vec<Weight> {
    POINTS_M.map(|com_m| Weight { mass_kg: 0.5, com_m }).into()
}

/// Three masses at each of the points.
fn three_masses() -> Vec<Weight> {
    let at = |mass_kg: f64| POINTS_M.map(|com_m| Weight { mass_kg, com_m });
    [0.25, 0.5, 1.0].into_iter().flat_map(at).collect()
}

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

fn planned(rig: &Rig, known: &[plan::GaugeState], weights: &[Weight], count: usize, seed: u64) -> Vec<Hold> {
    let plan = plan::plan(rig, known, weights, Goal::Count(count), seed).unwrap();
    assert_eq!(plan.poses.len(), count);
    plan.poses.into_iter().map(|pose| (pose.joints_rad, pose.load)).collect()
}

/// Poses by chance within the joints' ranges, as many bare as under each weight.
fn random(rig: &Rig, weights: &[Weight], count: usize, seed: u64) -> Vec<Hold> {
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let mut rng = StdRng::seed_from_u64(seed);
    (0..count)
        .map(|k| {
            let pose = limits.joints.iter().map(|joint| {
                let (middle, half) =
                    ((joint.lower_rad + joint.upper_rad) / 2.0, (joint.upper_rad - joint.lower_rad) / 2.0);
                middle + 0.9 * half * rng.random_range(-1.0..=1.0)
            });
            (pose.collect(), ((1 + weights.len()) * k / count).checked_sub(1).map(|weight| weights[weight]))
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
        warming: None,
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
    let mut errors: Vec<f64> = random(rig, &[], 200, seed ^ 0xF00D)
        .into_iter()
        .map(|(pose, _)| {
            arm.update_static(&pose);
            let push = Vector6::from_fn(|k, _| rng.random_range(-1.0..1.0) * if k < 3 { 5.0 } else { 0.5 });
            let wrench = model::spatial::Wrench::from_vector(&push);
            let counts: Vec<Option<GaugeReading>> = truth
                .gauges
                .iter()
                .enumerate()
                .map(|(k, gauge)| {
                    let load = arm.load(k) + arm.load_of_tip_wrench(k, &wrench).to_vector();
                    Some(GaugeReading::from(gauge.counts(&load)))
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

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Force error after so many planned poses over that after `times` as many random ones, RMS over several recordings: the median
/// over simulated arms, each from frames on a bus to a calibration. The plan knows nothing of the arm's gauges.
fn planned_over_random(rig: &Rig, weights: &[Weight], count: usize, times: f64) -> f64 {
    const ARMS: u64 = 7;
    const RECORDINGS: u64 = 4;
    let many = (times * count as f64).round() as usize;
    let ratio = |arm: u64| {
        let truth = Truth::draw(rig, 40 + arm, 0.003);
        let rms = |holds: &dyn Fn(u64) -> Vec<Hold>| {
            let square = |seed: u64| {
                force_error_n(rig, &truth, &[recording(rig, &truth, &holds(seed), 100 + seed)], arm).powi(2)
            };
            (0..RECORDINGS).map(|k| square(RECORDINGS * arm + k)).sum::<f64>().sqrt()
        };
        let planned = planned(rig, &plan::unknown(rig), weights, count, arm);
        rms(&|_| planned.clone()) / rms(&|seed| random(rig, weights, many, seed))
    };
    let ratios: Vec<f64> = (0..ARMS).map(ratio).collect();
    println!("{count} planned over {many} random, {} weights: {ratios:.2?}", weights.len());
    median(ratios)
}

/// Where there is a choice of masses; by the choice of poses and of the mass.
#[test]
fn planned_poses_do_with_half_as_many_as_random_ones() {
    let rig = arm();
    let ratio = planned_over_random(&rig, &three_masses(), 12, 2.0);
    println!("median {ratio:.3}");
    assert!(ratio <= 1.0, "{ratio}");
}

/// With one mass only, by the choice of poses alone, they are worth half as many again.
#[test]
fn planned_poses_do_with_two_thirds_where_there_is_one_mass() {
    let rig = arm();
    let ratio = planned_over_random(&rig, &one_mass(), 12, 1.5);
    println!("median {ratio:.3}");
    assert!(ratio <= 1.0, "{ratio}");
}

/// The number of poses that a wanted accuracy takes, in simulation: a few random poses, then as many planned ones as are foretold.
#[test]
fn the_foretold_number_of_poses_is_enough_and_not_too_many() {
    let rig = arm();
    let (mut reported, mut found) = (Vec::new(), Vec::new());
    for seed in 0..7 {
        let truth = Truth::draw(&rig, 60 + seed, 0.003);
        let first = recording(&rig, &truth, &random(&rig, &one_mass(), 12, seed), seed + 200);
        let known = plan::known(&self::found(&rig, std::slice::from_ref(&first))).unwrap();
        let ask = |goal: Goal| plan::plan(&rig, &known, &one_mass(), goal, seed).unwrap();
        let little = ask(Goal::Count(1));
        let (before_n, noise_n) = (little.before.force_sigma_n, little.noise_alone.force_sigma_n);
        // A sixth of what the calibration brings in beyond the noise.
        let plan =
            ask(Goal::ForceSigma((noise_n.powi(2) + (before_n.powi(2) - noise_n.powi(2)) / 6.0).sqrt()));
        let holds: Vec<Hold> = plan.poses.iter().map(|pose| (pose.joints_rad.clone(), pose.load)).collect();
        let recordings = [first, recording(&rig, &truth, &holds, seed + 300)];
        let mut dynamics = model::dynamics::Dynamics::new(&rig.chain, &rig.sections);
        let space = plan::Workspace::new(&rig, &known, &mut dynamics, seed);
        let now = space.accuracy(&plan::known(&self::found(&rig, &recordings)).unwrap());
        let foretold_n = plan.after.calibration_force_rms_n;
        let error_n = force_error_n(&rig, &truth, &recordings, seed) / 3f64.sqrt();
        println!(
            "{} poses: foretold {foretold_n:.4} N by the calibration, reported {:.4}, found {error_n:.4}",
            holds.len(),
            now.calibration_force_rms_n
        );
        assert!((3..100).contains(&holds.len()), "{}", holds.len());
        reported.push(now.calibration_force_rms_n / foretold_n);
        found.push(error_n / foretold_n);
    }
    let (reported, found) = (median(reported), median(found));
    println!("over what was foretold: reported {reported:.2}, found {found:.2}");
    assert!((0.85..1.15).contains(&reported), "{reported}");
    assert!((0.6..1.4).contains(&found), "{found}");
}

/// What was recorded counts: after many poses of the most useful weight, the next ones are with the others.
#[test]
fn what_is_known_already_is_not_planned_again() {
    let rig = arm();
    let fresh = planned(&rig, &plan::unknown(&rig), &one_mass(), 24, 1);
    let with = |holds: &[Hold], weight: Weight| holds.iter().filter(|(_, w)| *w == Some(weight)).count();
    let favourite = one_mass().into_iter().max_by_key(|weight| with(&fresh, *weight)).unwrap();
    let recorded: Vec<Hold> =
        random(&rig, &[], 60, 5).into_iter().map(|(pose, _)| (pose, Some(favourite))).collect();
    let each = recorded.iter().map(|(pose, weight)| (&pose[..], weight.as_ref()));
    let known = plan::after(&rig, &plan::unknown(&rig), each);
    let next = planned(&rig, &known, &one_mass(), 24, 1);
    let (before, after) = (with(&fresh, favourite), with(&next, favourite));
    assert!(before >= 6 && 2 * after <= before, "{before} {after}");
}

#[test]
fn a_wanted_accuracy_takes_no_more_poses_than_it_needs_or_is_refused() {
    let rig = arm();
    let known = plan::unknown(&rig);
    let ask = |wanted_n: f64| plan::plan(&rig, &known, &one_mass(), Goal::ForceSigma(wanted_n), 1);
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
