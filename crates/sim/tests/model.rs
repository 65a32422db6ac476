//! A calibrated model as the truth, and the product's own cycle on what comes out.
#![allow(clippy::unwrap_used)]

mod common;

use common::rig;
use model::spatial::Wrench;
use nalgebra::Vector3;
use rig::model_file::{Components, Encoder, Provenance, Sensor};
use rig::run::LoadInterval;
use rig::{Cycle, ModelFile, Rig};
use wrenchd_sim::motion::{MotionLimits, Trajectory};
use wrenchd_sim::push::Push;
use wrenchd_sim::{Options, Scenario, Simulator, Truth};

/// The model that a perfect calibration would find.
fn perfect(rig: &Rig, truth: &Truth) -> ModelFile {
    let sensors = truth.gauges.iter().zip(&rig.config.sensors).map(|(gauge, entry)| {
        let covariance = std::array::from_fn(|i| std::array::from_fn(|k| if i == k { 1.0 } else { 0.0 }));
        Sensor {
            bias_counts: gauge.bias_counts,
            bias_sigma_counts: 1.0,
            noise_slow_share: gauge.noise.slow_share,
            noise_slow_time_s: gauge.noise.slow_time_s,
            crosstalk_percent: Some(gauge.compliance.crosstalk_percent(0.1)),
            covariance,
            compliance_sigma: Components::from_array([Some(1.0); 6]),
            ..Sensor::known(&entry.name, &entry.section, &gauge.compliance, gauge.noise.sigma_counts)
        }
    });
    let encoder = |name: &&str| Encoder {
        name: (*name).to_owned(),
        position_sigma_rad: 30e-6,
        velocity_sigma_rad_s: None,
    };
    ModelFile {
        format: 1,
        provenance: Provenance {
            tool: "test".into(),
            date: "2026-01-01".into(),
            axes: "full".into(),
            samples: 1,
            inputs: Vec::new(),
        },
        joints: rig.chain.coordinate_names().iter().map(encoder).collect(),
        arm: None,
        sensors: sensors.collect(),
        fingerprint: rig.fingerprint().clone(),
    }
}

#[test]
fn a_model_s_gauges_are_the_simulated_ones() {
    let rig = rig("arm.toml");
    let drawn = Truth::draw(&rig, 6, 0.002);
    let mut model = perfect(&rig, &drawn);
    let taken = Truth::from_model(&rig, &model).unwrap();
    assert_eq!(taken.gauges, drawn.gauges);
    assert!(taken.encoders.iter().all(|encoder| encoder.position_sigma_rad == 30e-6));
    model.sensors.pop();
    let message = Truth::from_model(&rig, &model).unwrap_err().to_string();
    assert!(message.contains("7 sensors") && message.contains("model of this arm"), "{message}");
}

/// Rest, moves under a weight, and a push: the cycle finds the true wrench to within what the noise allows.
#[test]
fn the_cycle_finds_the_true_wrench() {
    let rig = rig("arm_fd.toml");
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let mut trajectory = Trajectory::from_pose(vec![0.3, -1.2, 0.9, 0.4, 0.8, -0.5]);
    trajectory.hold(3.0);
    trajectory.move_to(vec![1.0, -0.6, 0.2, -0.8, 1.2, 0.5], &limits, 0.3);
    trajectory.hold(3.0);
    let mut push = Push::none();
    push.trapezoid(1.0, 2.5, 0.2, Wrench::new(Vector3::new(3.0, -2.0, 5.0), Vector3::new(0.1, -0.4, 0.2)));
    let loads = vec![LoadInterval { from_s: 2.804, to_s: 1e3, mass_kg: 0.5, com_m: [0.0, 0.08, 0.03] }];
    let scenario = Scenario { push, loads, ..Scenario::of_motion(trajectory) };
    let truth = Truth::draw(&rig, 12, 0.002);
    let mut simulator = Simulator::new(&rig, truth.clone(), &scenario, Options::default()).unwrap();
    let mut cycle = Cycle::new(&rig, &perfect(&rig, &truth)).unwrap();
    let (mut still, mut largest, mut count) = (nalgebra::Vector6::<f64>::zeros(), 0.0f64, 0);
    let mut mechanics = simulator.mechanics();
    while let Some(stamped) = simulator.next() {
        let mut found = Vec::new();
        cycle.push(&stamped, |estimate| found.push(estimate.clone()));
        for estimate in found {
            let t_s = (estimate.instant_ns - wrenchd_sim::START_NS) as f64 * 1e-9;
            let Ok(solution) = estimate.outcome else { continue };
            mechanics.update(t_s);
            let rests = mechanics.state().velocities_rad_s.iter().all(|v| v.abs() < 1e-9);
            if rests && !(0.0..0.5).contains(&t_s) {
                let error =
                    solution.wrench.to_vector() - simulator.truth_at_ns(estimate.instant_ns).to_vector();
                still += error.component_mul(&error);
                largest = largest.max(simulator.truth_at(t_s).force_n.norm());
                count += 1;
            }
        }
    }
    let rms = (still / f64::from(count)).map(f64::sqrt);
    assert!(count > 500 && largest > 5.0, "{count} {largest}");
    assert!(rms.fixed_rows::<3>(0).amax() < 0.15 && rms.fixed_rows::<3>(3).amax() < 0.05, "{rms}");
}
