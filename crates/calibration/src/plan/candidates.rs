//! Poses to choose from, and what each loads the gauges with under each weight.

use model::dynamics::Dynamics;
use rig::Rig;

use super::gauge::Regressor;
use super::{TipWrench, Weight, body};
use crate::solve::scaled;

/// Poses keep this share of each joint's range.
const RANGE_SHARE: f64 = 0.95;

/// Range of a joint without limits: half a turn either way, rad.
const UNLIMITED_RAD: (f64, f64) = (-std::f64::consts::PI, std::f64::consts::PI);

/// Poses (rad, base to tip) spread evenly over the joints' limits: an additive sequence whose steps are powers of the root of
/// `x^(d+1) = x + 1` (M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018), begun at the seed.
pub fn spread_poses(rig: &Rig, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let ranges: Vec<(f64, f64)> = rig
        .chain
        .joints
        .iter()
        .filter(|joint| joint.coordinate.is_some())
        .map(|joint| {
            let limits = joint.limits.filter(|l| l.lower_rad.is_finite() && l.upper_rad.is_finite());
            limits.map_or(UNLIMITED_RAD, |l| (l.lower_rad, l.upper_rad))
        })
        .collect();
    let degree = ranges.len() as f64 + 1.0;
    let mut root: f64 = 1.5;
    for _ in 0..60 {
        root = (1.0 + root).powf(1.0 / degree);
    }
    // Any seed begins elsewhere in the sequence; 2^20 places keep all the digits of a fraction.
    let begin = (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 44) as f64;
    (0..count)
        .map(|k| {
            let place = |j: usize| ((begin + k as f64 + 1.0) * root.powi(-(j as i32 + 1))).fract();
            let joint = |(j, (low, high)): (usize, &(f64, f64))| {
                let angle = (low + high) / 2.0 + (place(j) - 0.5) * RANGE_SHARE * (high - low);
                // What a person can type.
                (angle * 1e3).round() / 1e3
            };
            ranges.iter().enumerate().map(joint).collect()
        })
        .collect()
}

/// Every pose under nothing and under every weight.
pub(super) struct Candidates {
    poses_rad: Vec<Vec<f64>>,
    /// Of a candidate: one regressor a gauge.
    regressors: Vec<Vec<Regressor>>,
    /// Nothing, and each weight.
    choices: usize,
}

impl Candidates {
    pub(super) fn new(
        rig: &Rig,
        weights: &[Weight],
        dynamics: &mut Dynamics,
        poses: usize,
        seed: u64,
    ) -> Self {
        let poses_rad = spread_poses(rig, poses, seed);
        let mut regressors = Vec::with_capacity(poses * (1 + weights.len()));
        for pose in &poses_rad {
            dynamics.update_static(pose);
            regressors.push(loaded(dynamics, &TipWrench::zero()));
            for weight in weights {
                regressors.push(loaded(dynamics, &dynamics.payload_wrench(&body(weight))));
            }
        }
        Self { poses_rad, regressors, choices: 1 + weights.len() }
    }

    pub(super) fn len(&self) -> usize {
        self.regressors.len()
    }

    /// What a candidate loads each gauge with.
    pub(super) fn regressors(&self, candidate: usize) -> &[Regressor] {
        &self.regressors[candidate]
    }

    pub(super) fn pose_rad(&self, candidate: usize) -> &[f64] {
        &self.poses_rad[candidate / self.choices]
    }

    /// Nothing (0), or the number of the weight from 1.
    pub(super) fn weight(&self, candidate: usize) -> usize {
        candidate % self.choices
    }
}

/// What each gauge is linear in, in the state of the last update with a wrench at the tip.
pub(super) fn loaded(dynamics: &Dynamics, wrench: &TipWrench) -> Vec<Regressor> {
    (0..dynamics.sections())
        .map(|gauge| {
            let load = dynamics.load(gauge) + dynamics.load_of_tip_wrench(gauge, wrench).to_vector();
            let load = scaled(&load);
            Regressor::from_fn(|k, _| if k < 6 { load[k] } else { 1.0 })
        })
        .collect()
}
