//! The wrench that the environment applies to the end-effector, from gauges and joint motion.
//!
//! ```text
//! z_i = C_i . (L_i(q, q', q'') + X_iE(q) W) + b_i + e_i
//! ```
//!
//! `L_i` is the load of the arm itself (weight and inertia of everything outboard, tool included), so `W` is what is
//! left: the environment's wrench about the tip frame's origin E, in E. `W` follows by generalised least squares with
//! the full covariance of `e`: each gauge's noise, each gauge's calibration (in proportion to the load it carries), and
//! joint motion that all gauges share. The parity residual is what six unknowns cannot explain of more than six gauges.

mod gls;
mod zero;

pub use gls::{Fit, Gls, NoFit, singular_values};
pub use zero::Zero;

use crate::chain::{Chain, Section};
use crate::dynamics::Dynamics;
use crate::motion::JointMotion;
use crate::sensing::CHARACTERISTIC_LENGTH_M;
use crate::spatial::{RigidBody, Tip, Wrench};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector6};

/// Covariance of a gauge's compliance vector and bias: counts/N, counts/Nm, counts, in that order.
pub type GaugeCovariance = SMatrix<f64, 7, 7>;

/// Scale of the wrench for which a gauge with an undetermined direction is weighed before anything is known, N.
const EXPECTED_FORCE_N: f64 = 10.0;

/// The same for moments, Nm.
const EXPECTED_MOMENT_NM: f64 = 1.0;

/// One calibrated gauge, as the estimator uses it.
#[derive(Clone, Debug, PartialEq)]
pub struct GaugeModel {
    /// Compliance vector in S, counts/N and counts/Nm; zero in directions that the calibration could not see.
    pub compliance: Vector6<f64>,
    /// Reading without load, counts.
    pub bias_counts: f64,
    /// Covariance of compliance and bias, the assumed width of unseen directions included.
    pub covariance: GaugeCovariance,
    /// The part of the compliance's covariance that is assumed, not measured; `None` where everything was seen.
    pub assumed: Option<Matrix6<f64>>,
    /// Variance of one reading, counts^2.
    pub noise_counts2: f64,
}

/// Wrench of the environment on the end-effector at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Solution {
    /// The wrench about E's origin, in E.
    pub wrench: Wrench<Tip>,
    /// Its covariance; force first, N and Nm.
    pub covariance: Matrix6<f64>,
    /// Singular values of the whitened problem with moments over the characteristic length, 1/N, largest first:
    /// a direction with the value s has the standard deviation 1/s N.
    pub singular_values_per_n: [f64; 6],
    /// Sum of squares of the parity residual, in units of its standard deviation.
    pub parity_chi2: f64,
    /// Degrees of freedom of the parity residual: gauges used minus six.
    pub parity_dof: usize,
}

/// Why there is no wrench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoWrench {
    /// Fewer than six gauges have a reading.
    TooFewGauges,
    /// The gauges do not determine all six components in this pose.
    Singular,
    /// A reading or a number of the model is not finite.
    NotFinite,
}

/// Turns readings and motion into the environment's wrench. Allocates at construction only; bounded work.
#[derive(Clone, Debug)]
pub struct WrenchEstimator {
    dynamics: Dynamics,
    gauges: Vec<GaugeModel>,
    /// Zeros found since the calibration, one a gauge.
    zeros: Vec<Zero>,
    gls: Gls,
    motion: [Vec<f64>; 3],
    /// Gauges that have a reading at this instant.
    present: Vec<Row>,
    /// Effect of one shared error on each row, counts.
    shared: Vec<f64>,
}

/// One gauge's equation at this instant.
#[derive(Clone, Copy, Debug)]
struct Row {
    gauge: usize,
    /// Counts per N and per Nm of a tip wrench in E.
    tip: Vector6<f64>,
    /// Reading less bias and the arm's own load, counts.
    value: f64,
}

impl WrenchEstimator {
    /// For an arm (with its tool) and its calibrated gauges; `sections[i]` is where `gauges[i]` sits.
    pub fn new(chain: &Chain, sections: &[Section], gauges: Vec<GaugeModel>) -> Self {
        let dynamics = Dynamics::new(chain, sections);
        let (n, coordinates) = (gauges.len(), dynamics.coordinates());
        Self {
            dynamics,
            gls: Gls::new(n),
            motion: std::array::from_fn(|_| vec![0.0; coordinates]),
            present: Vec::with_capacity(n),
            shared: Vec::with_capacity(n),
            zeros: vec![Zero::CALIBRATED; n],
            gauges,
        }
    }

    /// The arm in the state of the last estimate.
    pub fn dynamics(&self) -> &Dynamics {
        &self.dynamics
    }

    /// The gauges, as calibrated.
    pub fn gauges(&self) -> &[GaugeModel] {
        &self.gauges
    }

    /// Each gauge's zero.
    pub fn zeros(&self) -> &[Zero] {
        &self.zeros
    }

    /// Replaces the zero of a gauge.
    pub fn set_zero(&mut self, gauge: usize, zero: Zero) {
        self.zeros[gauge] = zero;
    }

    /// Makes a body at the tip (tip frame) part of the arm from the next estimate on; without mass: takes it off.
    pub fn set_payload(&mut self, body: &RigidBody) {
        self.dynamics.set_payload(body);
    }

    /// What a reading (counts) holds beside the calibrated bias and the arm's own load in the state of the last estimate:
    /// without a wrench on the tip, the gauge's error of zero, counts.
    pub fn unexplained_counts(&self, gauge: usize, counts: f64) -> f64 {
        let model = &self.gauges[gauge];
        counts - model.bias_counts - model.compliance.dot(&self.dynamics.load(gauge))
    }

    /// Whitened parity residual of each gauge used by the last estimate: (gauge, residual in sigmas).
    pub fn residuals(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.present.iter().map(|row| row.gauge).zip(self.gls.whitened_residuals().iter().copied())
    }

    /// The wrench at one instant from each joint's motion and each gauge's reading (counts; `None`: absent).
    ///
    /// Two passes: the first weighs the gauges as if little were known of the wrench, the second with the uncertainty
    /// that the wrench found in the first gives to every gauge's calibration.
    pub fn estimate(&mut self, motion: &[JointMotion], counts: &[Option<f64>]) -> Result<Solution, NoWrench> {
        for (k, joint) in motion.iter().enumerate() {
            self.motion[0][k] = joint.position_rad;
            self.motion[1][k] = joint.velocity_rad_s;
            self.motion[2][k] = joint.acceleration_rad_s2;
        }
        let [q, qd, qdd] = &self.motion;
        self.dynamics.update(q, qd, qdd);
        self.dynamics.differentiate();
        self.collect(counts);
        let first = self.solve(motion, None)?;
        let second = self.solve(motion, Some(&first))?;
        Ok(Solution {
            wrench: Wrench::from_vector(&second.x),
            covariance: second.covariance,
            singular_values_per_n: second.singular_values,
            parity_chi2: second.chi2,
            parity_dof: self.present.len() - 6,
        })
    }

    fn collect(&mut self, counts: &[Option<f64>]) {
        self.present.clear();
        for (i, (gauge, counts)) in self.gauges.iter().zip(counts).enumerate() {
            let Some(counts) = counts else { continue };
            self.present.push(Row {
                gauge: i,
                tip: self.dynamics.row_to_tip(i, &gauge.compliance),
                value: self.unexplained_counts(i, *counts) - self.zeros[i].shift_counts,
            });
        }
    }

    fn solve(&mut self, motion: &[JointMotion], found: Option<&Fit>) -> Result<Fit, NoWrench> {
        let wrench = found.map_or_else(Wrench::zero, |fit| Wrench::from_vector(&fit.x));
        self.gls.clear();
        for row in &self.present {
            let gauge = &self.gauges[row.gauge];
            let variance = gauge.noise_counts2
                + self.calibration_variance(row.gauge, &wrench)
                + self.unseen_variance(row.gauge, found);
            self.gls.push(&row.tip, row.value, variance);
        }
        for (coordinate, joint) in motion.iter().enumerate() {
            self.share_motion_error(coordinate, &joint.covariance, &wrench);
        }
        let length = CHARACTERISTIC_LENGTH_M;
        self.gls.solve(&[1.0, 1.0, 1.0, length, length, length]).map_err(|e| match e {
            NoFit::TooFewRows => NoWrench::TooFewGauges,
            NoFit::Singular => NoWrench::Singular,
            NoFit::NotFinite => NoWrench::NotFinite,
        })
    }

    /// Variance that the calibration's uncertainty gives to a gauge under its present load, counts^2.
    fn calibration_variance(&self, gauge: usize, wrench: &Wrench<Tip>) -> f64 {
        let load = self.dynamics.load(gauge) + self.dynamics.load_of_tip_wrench(gauge, wrench).to_vector();
        self.zeros[gauge].variance_counts2(&load, &self.gauges[gauge].covariance)
    }

    /// Variance from directions that the calibration never saw, excited by a wrench that is itself uncertain, counts^2.
    fn unseen_variance(&self, gauge: usize, found: Option<&Fit>) -> f64 {
        let Some(assumed) = &self.gauges[gauge].assumed else { return 0.0 };
        let adjoint = self.dynamics.tip_adjoint(gauge);
        let wrench_covariance = match found {
            Some(fit) => fit.covariance,
            None => Matrix6::from_diagonal(&Vector6::from_fn(|k, _| {
                if k < 3 { EXPECTED_FORCE_N.powi(2) } else { EXPECTED_MOMENT_NM.powi(2) }
            })),
        };
        (adjoint * wrench_covariance * adjoint.transpose()).component_mul(assumed).sum()
    }

    /// Adds one joint's uncertain motion to the covariance of all rows: it moves their loads together.
    fn share_motion_error(&mut self, coordinate: usize, covariance: &Matrix3<f64>, wrench: &Wrench<Tip>) {
        for direction in square_root(covariance) {
            self.shared.clear();
            for row in &self.present {
                let (i, d) = (row.gauge, &self.dynamics);
                let by_position =
                    d.by_position(i, coordinate) + d.tip_wrench_by_position(i, coordinate, wrench);
                let change = by_position * direction[0]
                    + d.by_velocity(i, coordinate) * direction[1]
                    + d.by_acceleration(i, coordinate) * direction[2];
                self.shared.push(self.gauges[i].compliance.dot(&change));
            }
            self.gls.add_shared_error(&self.shared);
        }
    }
}

/// Vectors whose outer products sum to a covariance (its Cholesky columns, last component first, so that
/// the acceleration leads); directions without variance are zero.
fn square_root(covariance: &Matrix3<f64>) -> [[f64; 3]; 3] {
    let mut left = *covariance;
    let mut columns = [[0.0; 3]; 3];
    for (column, pivot) in columns.iter_mut().zip([2, 1, 0]) {
        let variance = left[(pivot, pivot)];
        if variance <= 0.0 || variance.is_nan() {
            continue;
        }
        let root = variance.sqrt();
        for k in 0..3 {
            column[k] = left[(k, pivot)] / root;
        }
        for i in 0..3 {
            for k in 0..3 {
                left[(i, k)] -= column[i] * column[k];
            }
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    const URDF: &str = include_str!("../../tests/data/arm_a.urdf");
    const SECTIONS: [&str; 8] =
        ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6", "section_7", "section_8"];

    fn arm() -> (Chain, Vec<Section>) {
        let gravity = nalgebra::Vector3::new(0.0, 0.0, -9.80665);
        let chain = Chain::from_urdf(URDF, "arm_a.urdf", "base_link", "tool0", gravity).unwrap();
        let sections = SECTIONS.iter().map(|s| Section::new(&chain, s, None).unwrap()).collect();
        (chain, sections)
    }

    /// Gauges with strong crosstalk, a different one each.
    fn gauges() -> Vec<GaugeModel> {
        (0..8)
            .map(|k| {
                let s = f64::from(k);
                GaugeModel {
                    compliance: Vector6::new(2e3 * s, -1e3, 500.0 * s, 4e4 - 9e3 * s, 2e4 * (s - 3.0), 2e5),
                    bias_counts: 1e4 * s,
                    covariance: GaugeCovariance::zeros(),
                    assumed: None,
                    noise_counts2: 500.0f64.powi(2),
                }
            })
            .collect()
    }

    fn pose() -> Vec<JointMotion> {
        [0.3, -0.9, 0.8, 0.4, -0.7, 0.2].map(JointMotion::at_rest).to_vec()
    }

    /// Readings of ideal gauges, from the loads by another way than the estimator's rows.
    fn readings(gauges: &[GaugeModel], motion: &[JointMotion], wrench: &Wrench<Tip>) -> Vec<Option<f64>> {
        let (chain, sections) = arm();
        let mut d = Dynamics::new(&chain, &sections);
        let part = |f: fn(&JointMotion) -> f64| motion.iter().map(f).collect::<Vec<_>>();
        d.update(&part(|m| m.position_rad), &part(|m| m.velocity_rad_s), &part(|m| m.acceleration_rad_s2));
        gauges
            .iter()
            .enumerate()
            .map(|(i, g)| {
                let load = d.load(i) + d.tip_adjoint(i) * wrench.to_vector();
                Some(g.compliance.dot(&load) + g.bias_counts)
            })
            .collect()
    }

    fn wrench() -> Wrench<Tip> {
        Wrench::from_vector(&Vector6::new(3.0, -2.0, 5.0, 0.2, -0.4, 0.1))
    }

    #[test]
    fn finds_the_wrench_of_ideal_gauges_and_with_any_two_missing() {
        let (chain, sections) = arm();
        let mut estimator = WrenchEstimator::new(&chain, &sections, gauges());
        let mut motion = pose();
        motion[2].velocity_rad_s = 1.0;
        motion[4].acceleration_rad_s2 = 9.0;
        let all = readings(&gauges(), &motion, &wrench());
        for (a, b) in [(0, 0), (0, 1), (2, 5), (6, 7)] {
            let mut counts = all.clone();
            counts[a] = None;
            counts[b] = None;
            let found = estimator.estimate(&motion, &counts).unwrap();
            assert!((found.wrench.to_vector() - wrench().to_vector()).amax() < 1e-6, "{found:?}");
            assert!(found.parity_chi2 < 1e-9 && found.parity_dof == if a == b { 1 } else { 0 });
        }
        let mut counts = all;
        counts[..3].fill(None);
        assert_eq!(estimator.estimate(&motion, &counts), Err(NoWrench::TooFewGauges));
    }

    #[test]
    fn a_gauge_with_an_unseen_direction_that_matters_is_hardly_used() {
        let (chain, sections) = arm();
        let truth = gauges();
        let mut seen = gauges();
        // Gauge 1 was calibrated without ever feeling torque about z: its estimate there is zero, far from the truth.
        seen[0].compliance[5] = 0.0;
        let mut assumed = Matrix6::zeros();
        assumed[(5, 5)] = 2e5f64.powi(2);
        seen[0].covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(&assumed);
        seen[0].assumed = Some(assumed);
        let counts = readings(&truth, &pose(), &wrench());
        let mut with = WrenchEstimator::new(&chain, &sections, seen.clone());
        let found = with.estimate(&pose(), &counts).unwrap();
        let mut without_first = counts;
        without_first[0] = None;
        let reference = with.estimate(&pose(), &without_first).unwrap();
        let error = found.wrench.to_vector() - wrench().to_vector();
        for k in 0..6 {
            assert!(error[k].abs() < found.covariance[(k, k)].sqrt(), "{k} {error}");
            assert!(found.covariance[(k, k)] <= reference.covariance[(k, k)] * 1.0001);
        }
    }

    #[test]
    fn uncertain_acceleration_widens_the_wrench() {
        let (chain, sections) = arm();
        let mut estimator = WrenchEstimator::new(&chain, &sections, gauges());
        let counts = readings(&gauges(), &pose(), &wrench());
        let sure = estimator.estimate(&pose(), &counts).unwrap();
        let mut motion = pose();
        motion[1].covariance[(2, 2)] = 4.0;
        let unsure = estimator.estimate(&motion, &counts).unwrap();
        assert!(unsure.covariance.trace() > 2.0 * sure.covariance.trace());
    }

    #[test]
    fn the_square_root_of_a_covariance_multiplies_back() {
        let c = Matrix3::new(2.0, 0.3, 0.1, 0.3, 1.0, -0.2, 0.1, -0.2, 0.5);
        let mut sum = Matrix3::zeros();
        for v in square_root(&c) {
            let v = nalgebra::Vector3::from(v);
            sum += v * v.transpose();
        }
        assert!((sum - c).amax() < 1e-15);
        assert_eq!(square_root(&Matrix3::zeros()), [[0.0; 3]; 3]);
    }
}
