//! Poses to choose from, and what each loads the gauges with under each weight.

use model::dynamics::Dynamics;
use model::spatial::RigidBody;
use rig::Rig;

use super::gauge::Regressor;
use super::{TipWrench, Weight, body};
use crate::solve::scaled;

/// Poses keep this share of each joint's range.
const RANGE_SHARE: f64 = 0.95;

/// Range of a joint without limits: half a turn either way, rad.
const UNLIMITED_RAD: (f64, f64) = (-std::f64::consts::PI, std::f64::consts::PI);

/// Two poses are the same one unless a joint is this share of its range apart.
const APART: f64 = 0.05;

/// Lowest and highest angle of each moving joint that a pose may have, rad.
fn ranges(rig: &Rig) -> Vec<(f64, f64)> {
    let joints = rig.chain.joints.iter().filter(|joint| joint.coordinate.is_some());
    joints
        .map(|joint| {
            let limits = joint.limits.filter(|l| l.lower_rad.is_finite() && l.upper_rad.is_finite());
            let (low, high) = limits.map_or(UNLIMITED_RAD, |l| (l.lower_rad, l.upper_rad));
            let (middle, half) = ((low + high) / 2.0, RANGE_SHARE * (high - low) / 2.0);
            (middle - half, middle + half)
        })
        .collect()
}

/// What a person can type.
fn rounded(angle_rad: f64) -> f64 {
    (angle_rad * 1e3).round() / 1e3
}

/// Poses (rad, base to tip) spread evenly over the joints' limits: an additive sequence whose steps are powers of the root of
/// `x^(d+1) = x + 1` (M. Roberts, The unreasonable effectiveness of quasirandom sequences, 2018), begun at the seed.
pub fn spread_poses(rig: &Rig, count: usize, seed: u64) -> Vec<Vec<f64>> {
    let ranges = ranges(rig);
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
            let joint = |(j, (low, high)): (usize, &(f64, f64))| rounded(low + place(j) * (high - low));
            ranges.iter().enumerate().map(joint).collect()
        })
        .collect()
}

/// Every pose under nothing and under every weight; poses that a search finds are added behind those spread evenly.
pub(super) struct Candidates {
    ranges_rad: Vec<(f64, f64)>,
    dynamics: Dynamics,
    bodies: Vec<RigidBody>,
    poses_rad: Vec<Vec<f64>>,
    /// Of a candidate: one regressor a gauge.
    regressors: Vec<Vec<Regressor>>,
    /// How many candidates are of poses spread evenly.
    spread: usize,
}

impl Candidates {
    pub(super) fn new(rig: &Rig, weights: &[Weight], poses: usize, seed: u64) -> Self {
        let mut new = Self {
            ranges_rad: ranges(rig),
            dynamics: Dynamics::new(&rig.chain, &rig.sections),
            bodies: weights.iter().map(body).collect(),
            poses_rad: Vec::with_capacity(poses),
            regressors: Vec::with_capacity(poses * (1 + weights.len())),
            spread: 0,
        };
        for pose in spread_poses(rig, poses, seed) {
            let choices = new.loads(&pose);
            new.add(pose, choices);
        }
        new.spread = new.regressors.len();
        new
    }

    /// Candidates of poses that were spread evenly.
    pub(super) fn spread(&self) -> std::ops::Range<usize> {
        0..self.spread
    }

    /// What a pose (rad) loads the gauges with under nothing and each weight.
    pub(super) fn loads(&mut self, pose_rad: &[f64]) -> Vec<Vec<Regressor>> {
        let dynamics = &mut self.dynamics;
        dynamics.update_static(pose_rad);
        let mut choices = vec![loaded(dynamics, &TipWrench::zero())];
        choices.extend(self.bodies.iter().map(|body| loaded(dynamics, &dynamics.payload_wrench(body))));
        choices
    }

    /// A pose (rad) with its loads is a candidate from now on; the first of its choices.
    pub(super) fn add(&mut self, pose_rad: Vec<f64>, choices: Vec<Vec<Regressor>>) -> usize {
        self.poses_rad.push(pose_rad);
        self.regressors.extend(choices);
        self.regressors.len() - self.choices()
    }

    /// Poses (rad) that differ from this one in one joint by a share of half its range, within the ranges.
    pub(super) fn neighbours(&self, pose_rad: &[f64], share: f64) -> Vec<Vec<f64>> {
        let mut out = Vec::with_capacity(2 * pose_rad.len());
        for (joint, (low, high)) in self.ranges_rad.iter().enumerate() {
            for sign in [1.0, -1.0] {
                let mut pose = pose_rad.to_vec();
                pose[joint] = rounded((pose[joint] + sign * share * (high - low) / 2.0).clamp(*low, *high));
                if pose[joint] != pose_rad[joint] {
                    out.push(pose);
                }
            }
        }
        out
    }

    /// Whether a pose (rad) under a weight is nearly one of those chosen.
    pub(super) fn is_near(
        &self,
        pose_rad: &[f64],
        weight: usize,
        mut chosen: impl Iterator<Item = usize>,
    ) -> bool {
        chosen.any(|other| {
            let joints = pose_rad.iter().zip(self.pose_rad(other)).zip(&self.ranges_rad);
            let near =
                |((a, b), (low, high)): ((&f64, &f64), &(f64, f64))| (a - b).abs() < APART * (high - low);
            self.weight(other) == weight && joints.into_iter().all(near)
        })
    }

    /// What a candidate loads each gauge with.
    pub(super) fn regressors(&self, candidate: usize) -> &[Regressor] {
        &self.regressors[candidate]
    }

    pub(super) fn pose_rad(&self, candidate: usize) -> &[f64] {
        &self.poses_rad[candidate / self.choices()]
    }

    /// Nothing (0), or the number of the weight from 1.
    pub(super) fn weight(&self, candidate: usize) -> usize {
        candidate % self.choices()
    }

    /// Nothing, and each weight.
    fn choices(&self) -> usize {
        1 + self.bodies.len()
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
