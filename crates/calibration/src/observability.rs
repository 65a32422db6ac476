//! Which directions of load the data never showed to a gauge, in physical words, and what would show them.

use model::dynamics::Dynamics;
use model::spatial::{RigidBody, Tip, Wrench};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use rig::Rig;

use crate::solve::{Information, scaled};

/// A sensitivity known worse than this share of a gauge's whole sensitivity counts as not seen.
const SEEN_TO: f64 = 0.1;

/// What the data say of one gauge by direction (scaled load, N).
#[derive(Clone, Debug)]
pub struct Directions {
    /// Orthonormal directions, one a column.
    pub basis: Matrix6<f64>,
    /// Standard deviation of the sensitivity along each, counts/N; infinite where nothing is known.
    pub sigma_counts_per_n: Vector6<f64>,
    /// Whether each counts as seen.
    pub seen: [bool; 6],
    /// Whether it was motion that showed it, not the held poses.
    pub by_motion: [bool; 6],
    /// Estimate along each, counts/N.
    pub value: Vector6<f64>,
}

impl Directions {
    /// By singular value decomposition of the information; seen against a typical sensitivity, counts/N.
    pub fn new(information: &Information, typical_counts_per_n: f64) -> Self {
        let svd = information.triangle.svd(true, true);
        let (u, v_t) = (svd.u.unwrap_or_else(Matrix6::identity), svd.v_t.unwrap_or_else(Matrix6::identity));
        let coordinates = u.transpose() * information.target;
        let largest = svd.singular_values.max();
        let known = |s: f64| s > 1e-12 * largest && s > 0.0;
        let sigma = svd.singular_values.map(|s| if known(s) { 1.0 / s } else { f64::INFINITY });
        let value = Vector6::from_fn(|k, _| {
            let s = svd.singular_values[k];
            if known(s) { coordinates[k] / s } else { 0.0 }
        });
        let seen = std::array::from_fn(|k| sigma[k] <= SEEN_TO * typical_counts_per_n);
        let by_motion = [false; 6];
        let mut out = Self { basis: v_t.transpose(), sigma_counts_per_n: sigma, seen, by_motion, value };
        out.sort_unseen();
        out
    }

    /// Takes in what motion told of the unseen directions: as many directions of their subspace, with values and standard deviations, counts/N.
    pub fn take_motion(&mut self, told: &[(Vector6<f64>, f64, f64)], typical_counts_per_n: f64) {
        let unseen: Vec<usize> = (0..6).filter(|k| !self.seen[*k]).collect();
        if unseen.len() != told.len() {
            return;
        }
        for (k, (direction, value, sigma)) in unseen.into_iter().zip(told) {
            self.basis.set_column(k, direction);
            self.seen[k] = *sigma <= SEEN_TO * typical_counts_per_n;
            self.by_motion[k] = self.seen[k];
            if self.seen[k] {
                (self.value[k], self.sigma_counts_per_n[k]) = (*value, *sigma);
            }
        }
        self.sort_unseen();
    }

    /// Within the unseen subspace any basis is as good: choose the one nearest to the axes, for words.
    fn sort_unseen(&mut self) {
        let unseen: Vec<usize> = (0..6).filter(|k| !self.seen[*k]).collect();
        let mut taken: Vec<Vector6<f64>> = Vec::new();
        for _ in &unseen {
            let inside = |axis: usize| {
                let mut projected = Vector6::zeros();
                for k in &unseen {
                    let direction = self.basis.column(*k);
                    projected += direction * direction[axis];
                }
                for t in &taken {
                    projected -= t * t.dot(&projected);
                }
                projected
            };
            let best = (0..6).map(inside).max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
            if let Some(best) = best {
                taken.push(best.normalize());
            }
        }
        // Nothing is known there but roughly: the variance along a new direction is that of the worst it mixes.
        let worst = unseen.iter().map(|k| self.sigma_counts_per_n[*k]).fold(0.0, f64::max);
        for (k, direction) in unseen.iter().zip(taken) {
            self.basis.set_column(*k, &direction);
            self.sigma_counts_per_n[*k] = worst;
            self.value[*k] = 0.0;
        }
    }

    /// The unseen directions.
    pub fn unseen(&self) -> impl Iterator<Item = Vector6<f64>> + '_ {
        (0..6).filter(|k| !self.seen[*k]).map(|k| self.basis.column(k).into_owned())
    }

    /// The part of the compliance that was seen, scaled, counts/N.
    pub fn seen_compliance(&self) -> Vector6<f64> {
        (0..6).filter(|k| self.seen[*k]).map(|k| self.basis.column(k) * self.value[k]).sum()
    }
}

/// An unseen direction in words: "sensitivity of s1 to torque about its own z axis".
pub fn words(sensor: &str, direction: &Vector6<f64>) -> String {
    const PARTS: [&str; 6] = [
        "force along its x axis",
        "force along its y axis",
        "force along its own axis (z)",
        "torque about its x axis",
        "torque about its y axis",
        "torque about its own axis (z)",
    ];
    let mut order: Vec<usize> = (0..6).filter(|k| direction[*k].abs() > 0.2).collect();
    order.sort_by(|a, b| direction[*b].abs().total_cmp(&direction[*a].abs()));
    let listed: Vec<&str> = order.iter().map(|k| PARTS[*k]).collect();
    match listed.as_slice() {
        [one] => format!("sensitivity of {sensor} to {one}"),
        many => format!("sensitivity of {sensor} to {} together", many.join(" and ")),
    }
}

/// What would show a direction to a gauge: every kind of experiment is tried on the arm, and those that load it are named.
pub struct Remedies {
    /// Scaled loads (N) of each gauge by experiment, about their mean (a constant load is no excitation).
    trials: Vec<(&'static str, Vec<Vec<Vector6<f64>>>)>,
}

/// An experiment helps if it varies the load along the direction by this much (RMS), N.
const HELPS_N: f64 = 0.3;

impl Remedies {
    /// Tries the experiments on poses spread over the joints' limits.
    pub fn new(rig: &Rig) -> Self {
        let poses = spread_poses(rig);
        let weights = [[0.0, 0.0, 0.05], [0.08, 0.0, 0.03], [0.0, 0.08, 0.03]];
        let weight = |com: [f64; 3], kg: f64| RigidBody::from_com(kg, Vector3::from(com), Matrix3::zeros());
        let mut tilted = rig.chain.clone();
        let turn = nalgebra::Rotation3::from_euler_angles(0.17, 0.12, 0.0);
        tilted.gravity_mps2 = turn * tilted.gravity_mps2;
        let bare = |d: &mut Dynamics, q: &[f64], _: usize| {
            d.update_static(q);
            Wrench::<Tip>::zero()
        };
        let moving = |d: &mut Dynamics, q: &[f64], k: usize| {
            let rate: Vec<f64> =
                (0..q.len()).map(|j| if (j + k).is_multiple_of(2) { 1.0 } else { -1.0 }).collect();
            let push: Vec<f64> =
                (0..q.len()).map(|j| if (j + k).is_multiple_of(3) { 5.0 } else { -4.0 }).collect();
            d.update(q, &rate, &push);
            Wrench::<Tip>::zero()
        };
        let hang = |points: usize, kilograms: [f64; 2]| {
            move |d: &mut Dynamics, q: &[f64], k: usize| {
                d.update_static(q);
                d.payload_wrench(&weight(weights[k % points], kilograms[k / points % 2]))
            }
        };
        let pull = |d: &mut Dynamics, q: &[f64], k: usize| {
            d.update_static(q);
            let mut wrench = Vector6::zeros();
            wrench[k % 6] =
                if k % 6 < 3 { 5.0 } else { 0.5 } * if (k / 6).is_multiple_of(2) { 1.0 } else { -1.0 };
            Wrench::<Tip>::from_vector(&wrench)
        };
        let chain = &rig.chain;
        Self {
            trials: vec![
                ("hold more different poses", loads(rig, chain, &poses, bare)),
                (
                    "hang a weight at three points that are not on a line",
                    loads(rig, chain, &poses, hang(3, [0.5, 0.5])),
                ),
                ("hang weights of different mass", loads(rig, chain, &poses, hang(1, [0.2, 1.0]))),
                (
                    "pull sideways at the tip or push with a reference sensor mounted",
                    loads(rig, chain, &poses, pull),
                ),
                ("tilt the base by some degrees", loads(rig, &tilted, &poses, bare)),
                ("move with known inertia", loads(rig, chain, &poses, moving)),
            ],
        }
    }

    /// The experiments that vary a gauge's load along a direction, as a sentence.
    pub fn remedy(&self, gauge: usize, direction: &Vector6<f64>) -> String {
        let useful: Vec<&str> = self
            .trials
            .iter()
            .filter(|(_, loads)| spread(&loads[gauge], direction) > HELPS_N)
            .map(|(words, _)| *words)
            .collect();
        match useful.as_slice() {
            [] => "no pose, weight or pull at the tip loads this section that way; it does not matter for the wrench".to_owned(),
            some => some.join(", or "),
        }
    }
}

fn spread(loads: &[Vector6<f64>], direction: &Vector6<f64>) -> f64 {
    let n = loads.len() as f64;
    let along: Vec<f64> = loads.iter().map(|l| l.dot(direction)).collect();
    let mean = along.iter().sum::<f64>() / n;
    (along.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()
}

/// Load of each gauge in each pose of an experiment.
fn loads(
    rig: &Rig,
    chain: &model::chain::Chain,
    poses: &[Vec<f64>],
    experiment: impl Fn(&mut Dynamics, &[f64], usize) -> Wrench<Tip>,
) -> Vec<Vec<Vector6<f64>>> {
    let mut dynamics = Dynamics::new(chain, &rig.sections);
    let mut out = vec![Vec::with_capacity(poses.len()); rig.sections.len()];
    for (k, pose) in poses.iter().enumerate() {
        let wrench = experiment(&mut dynamics, pose, k);
        for (gauge, loads) in out.iter_mut().enumerate() {
            let total = dynamics.load(gauge) + dynamics.load_of_tip_wrench(gauge, &wrench).to_vector();
            loads.push(scaled(&total));
        }
    }
    out
}

/// Poses spread evenly over the limits (an additive sequence of irrational steps; the same every time).
fn spread_poses(rig: &Rig) -> Vec<Vec<f64>> {
    let limits: Vec<(f64, f64)> = rig
        .chain
        .joints
        .iter()
        .filter(|j| j.coordinate.is_some())
        .map(|j| {
            let bound = |v: f64, otherwise: f64| if v.is_finite() { v } else { otherwise };
            j.limits.map_or((-3.0, 3.0), |l| (bound(l.lower_rad, -3.0), bound(l.upper_rad, 3.0)))
        })
        .collect();
    (1..=36)
        .map(|k| {
            limits
                .iter()
                .enumerate()
                .map(|(j, (low, high))| {
                    let step = ((j + 2) as f64).sqrt() + 0.1 * j as f64;
                    low + (high - low) * (k as f64 * step).fract()
                })
                .collect()
        })
        .collect()
}
