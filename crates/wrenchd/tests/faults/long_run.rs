//! Hours without a fault: nobody is accused.
//!
//! The arm moves, holds and is pushed; its model is not the truth but one that a calibration of stated covariance could have found: each hour another.

use model::sensing::Compliance;
use rig::config::PublishMode;
use rig::cycle::{Cycle, GaugeState};
use rig::model_file::{ModelFile, Sensor};
use rig::{Rig, Status};
use sim::{Options, Preset, Simulator, Truth};

use crate::common::{model, rig};
use crate::isolation::is_wrong;

/// Standard deviation of a compliance that a calibration leaves, as a share of the gauge's scale (moments; forces by 0.1 m).
const LEFT_BY_CALIBRATION: f64 = 1e-3;
/// The same of a bias, counts.
const BIAS_LEFT_COUNTS: f64 = 150.0;

/// Small, seeded: a sum of uniform numbers is near enough to Gaussian.
struct Dice(u64);

impl Dice {
    fn normal(&mut self) -> f64 {
        let mut uniform = || {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }
}

/// A model as far from the truth as its covariance says.
fn calibrated(rig: &Rig, truth: &Truth, seed: u64) -> ModelFile {
    let mut dice = Dice(seed);
    let mut found = model(rig, truth);
    for sensor in &mut found.sensors {
        let true_compliance = sensor.working();
        let scale = true_compliance.rows(3, 3).norm() * LEFT_BY_CALIBRATION;
        let sigma: [f64; 6] = std::array::from_fn(|k| if k < 3 { 0.1 * scale } else { scale });
        let compliance = true_compliance.zip_map(&sigma.into(), |c, s: f64| c + s * dice.normal());
        let known = Sensor::known(
            &sensor.name,
            &sensor.section,
            &Compliance::from_vector(&compliance),
            sensor.noise_floor_counts,
        );
        sensor.compliance = known.compliance;
        sensor.bias_counts += BIAS_LEFT_COUNTS * dice.normal();
        (0..6).for_each(|k| sensor.covariance[k][k] = sigma[k] * sigma[k]);
        sensor.covariance[6][6] = BIAS_LEFT_COUNTS.powi(2);
    }
    found
}

/// What happened in so many hours.
#[derive(Debug, Default, PartialEq, Eq)]
struct Tally {
    instants: u64,
    valid: u64,
    isolated: u64,
    parity: u64,
    wrong: u64,
}

/// Runs through one preset after the other until that many seconds are over.
fn run(seconds: f64) -> Tally {
    let rig = rig(PublishMode::Event);
    let mut tally = Tally::default();
    let (mut simulated_s, mut seed) = (0.0, 0);
    while simulated_s < seconds {
        seed += 1;
        let truth = Truth::draw(&rig, seed, 0.0);
        let preset = [Preset::Accuracy, Preset::Sweep, Preset::Holds][seed as usize % 3];
        let scenario = preset.scenario(&rig.chain, seed).unwrap().with_load(0.1, [0.02, 0.01, 0.04]).unwrap();
        let simulator = || {
            Simulator::new(&rig, truth.clone(), &scenario, Options { seed, ..Options::default() }).unwrap()
        };
        let mut cycle = Cycle::new(&rig, &calibrated(&rig, &truth, seed)).unwrap();
        let mut world = simulator();
        for frame in simulator() {
            let mut last = None;
            cycle.push(&frame, |estimate| last = Some(estimate.clone()));
            let Some(estimate) = last else { continue };
            let states = cycle.stage().gauge_states();
            tally.instants += 1;
            tally.valid += u64::from(estimate.outcome.is_ok());
            tally.isolated += u64::from(states.contains(&GaugeState::Isolated));
            tally.parity += u64::from(estimate.status.has(Status::PARITY));
            tally.wrong += u64::from(is_wrong(&estimate, &mut world));
        }
        simulated_s += scenario.duration_s();
    }
    println!("{simulated_s:.0} s in {seed} sessions: {tally:?}");
    tally
}

fn assert_clean(tally: &Tally) {
    assert_eq!((tally.isolated, tally.wrong), (0, 0), "{tally:?}");
    // The first rounds of a sudden motion lack the inertia.
    assert!(tally.parity * 1_000_000 <= tally.instants, "{tally:?}");
    assert!(tally.valid * 10 > tally.instants * 8, "{tally:?}");
}

#[test]
fn no_gauge_is_accused_in_minutes_without_a_fault() {
    assert_clean(&run(600.0));
}

/// `cargo test --release -p wrenchd --test faults -- --ignored` takes some minutes.
#[test]
#[ignore = "ten simulated hours take minutes"]
fn no_gauge_is_accused_in_ten_hours_without_a_fault() {
    assert_clean(&run(36_000.0));
}
