//! Calibrations of arms as they are built, with every small fault of a cheap one at once, scored on another day's recording.
//!
//! The arms come from the `sim` crate, whose mechanics and forms of faults are not the estimator's. A few arms run always; twenty with
//! `cargo test --release -p wrenchd-calibration --test as_built -- --ignored --nocapture`, where `ARMS=100,40` asks for the 40 arms
//! from seed 100.
#![allow(clippy::unwrap_used)]

mod trial;

use trial::{Trial, try_arms};

/// Against what noise alone predicts: median and worst.
const MEDIAN_RATIO: f64 = 1.5;
const WORST_RATIO: f64 = 2.7;

/// Against the five-parameter method, where that is worse than this, N.
const BAD_FIVE_N: f64 = 0.1;
const SHARE_OF_FIVE: f64 = 0.5;

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

/// Prints the figures; what is beyond the bounds.
fn verdict(trials: &[Trial]) -> Vec<String> {
    let ratio = |trial: &Trial| trial.force_rms_n / trial.noise_alone_n;
    let middle = median(trials.iter().map(ratio).collect());
    let worst = trials.iter().map(ratio).fold(0.0, f64::max);
    let within: f64 = trials.iter().map(|t| t.covered_wrench.0).sum();
    let of: f64 = trials.iter().map(|t| t.covered_wrench.1).sum();
    println!(
        "{} arms: force RMS over what noise alone predicts: median {middle:.2}, worst {worst:.2}; {:.1} % of the wrench's components within their 95 % intervals",
        trials.len(),
        100.0 * within / of
    );
    let mut beyond = Vec::new();
    if middle > MEDIAN_RATIO {
        beyond.push(format!("median {middle:.2} times the noise"));
    }
    for trial in trials {
        if ratio(trial) > WORST_RATIO {
            beyond.push(format!("arm {}: {:.2} times the noise", trial.seed, ratio(trial)));
        }
        if trial.five_rms_n > BAD_FIVE_N && trial.force_rms_n > SHARE_OF_FIVE * trial.five_rms_n {
            beyond.push(format!("arm {}: more than half of the five-parameter method's error", trial.seed));
        }
    }
    let coverage = within / of;
    if !(0.9..=0.98).contains(&coverage) {
        beyond.push(format!("{:.1} % of the wrenches covered", 100.0 * coverage));
    }
    beyond
}

#[test]
#[ignore = "minutes; in release: --ignored --nocapture"]
fn twenty_arms_as_built_are_calibrated_to_near_their_noise() {
    let asked = std::env::var("ARMS").ok();
    let numbers: Vec<u64> =
        asked.iter().flat_map(|text| text.split(',')).filter_map(|n| n.parse().ok()).collect();
    let (first, count) = match numbers[..] {
        [first, count] => (first, count),
        _ => (1, 20),
    };
    let beyond = verdict(&try_arms(first..first + count));
    assert!(beyond.is_empty(), "{beyond:#?}");
}

/// The bounds on single arms of the whole experiment are not asked here: slow creep and drift still spoil some arms.
#[test]
fn two_arms_as_built_are_calibrated_to_far_less_than_the_five_parameter_method_s_error() {
    for trial in try_arms(1..3) {
        assert!(trial.force_rms_n < SHARE_OF_FIVE * trial.five_rms_n, "{trial}");
    }
}
