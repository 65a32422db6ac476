//! The wrench that the environment applies to the end-effector, from gauges and joint motion.
//!
//! ```text
//! z_i = C_i . (L_i(q, q', q'') + X_iE(q) W) + b_i + e_i
//! ```
//!
//! `L_i` is the load of the arm itself (weight and inertia of everything outboard, tool included), so `W` is what is
//! left: the environment's wrench about the tip frame's origin E, in E. `W` follows by generalised least squares with
//! the full covariance of `e`: each gauge's noise, each gauge's calibration (in proportion to the load it carries), and
//! joint motion that all gauges share, and the directions in which a calibration left arm and gauges uncertain together.
//! Joints that yield are followed by a fixed point of two steps: under the arm's own weight first, then under the wrench as well.
//! The parity residual is what six unknowns cannot explain of more than six gauges.

mod arm;
mod gls;
mod redundancy;
mod zero;

pub use arm::{ArmModel, Deviation};
pub use gls::{Estimate, Fit, Gls, NoFit, singular_values};
pub use redundancy::Redundancy;
pub use zero::Zero;

use crate::chain::{Chain, Section};
use crate::dynamics::Dynamics;
use crate::motion::JointMotion;
use crate::sensing::CHARACTERISTIC_LENGTH_M;
use crate::spatial::{RigidBody, Tip, Wrench};
use crate::terms::{GaugeTerms, MOST_TERMS, Regressors};
use arm::Arm;
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector6};

/// Numbers of one gauge: six sensitivities, bias, terms.
pub const GAUGE_NUMBERS: usize = 7 + MOST_TERMS;

/// What a gauge's numbers are multiplied by to give its reading: load (N, Nm; S), one, the terms' regressors.
pub type Excitation = SVector<f64, GAUGE_NUMBERS>;

/// Covariance of a gauge's compliance vector, bias and terms: counts/N, counts/Nm, counts, counts a unit of each term's
/// regressor, in that order; zero where there is no term.
pub type GaugeCovariance = SMatrix<f64, GAUGE_NUMBERS, GAUGE_NUMBERS>;

/// Scale of the wrench for which a gauge with an undetermined direction is weighed before anything is known, N.
const EXPECTED_FORCE_N: f64 = 10.0;

/// The same for moments, Nm.
const EXPECTED_MOMENT_NM: f64 = 1.0;

/// Columns of the wrench as they compare: forces in N, moments over a length.
const COLUMN_SCALE: [f64; 6] = {
    let length = CHARACTERISTIC_LENGTH_M;
    [1.0, 1.0, 1.0, length, length, length]
};

/// One calibrated gauge, as the estimator uses it.
#[derive(Clone, Debug, PartialEq)]
pub struct GaugeModel {
    /// Compliance vector in S, counts/N and counts/Nm; zero in directions that the calibration could not see.
    pub compliance: Vector6<f64>,
    /// Reading without load, counts.
    pub bias_counts: f64,
    /// Covariance of compliance, bias and terms, the assumed width of unseen directions included; without what the arm's
    /// deviations already say.
    pub covariance: GaugeCovariance,
    /// The part of the compliance's covariance that is assumed, not measured; `None` where everything was seen.
    pub assumed: Option<Matrix6<f64>>,
    /// Variance of one reading, counts^2.
    pub noise_counts2: f64,
    /// What it adds to its readings beside the load's share.
    pub terms: GaugeTerms,
}

/// One gauge's reading at an instant, with the terms that go with it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaugeReading {
    /// The reading, counts.
    pub counts: f64,
    /// Its terms' regressors.
    pub regressors: Regressors,
    /// Variance that an unknown past gives to the terms, counts^2.
    pub unsettled_counts2: f64,
}

impl From<f64> for GaugeReading {
    /// A reading (counts) of a gauge without terms.
    fn from(counts: f64) -> Self {
        Self { counts, regressors: [0.0; MOST_TERMS], unsettled_counts2: 0.0 }
    }
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
    /// The largest error that a fault of one gauge can hide from the spare ones, for each component (N, Nm); infinite where nothing was
    /// checked, or nothing can be.
    pub protection: [f64; 6],
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
    arm: Arm,
    gls: Gls,
    motion: [Vec<f64>; 3],
    /// The encoders' positions, before joints yield, rad.
    encoders_rad: Vec<f64>,
    /// Gauges that have a reading at this instant.
    present: Vec<Row>,
    /// What each row senses of each joint's position, velocity and acceleration, row by row: counts s^k/rad.
    by_motion: Vec<[f64; 3]>,
    /// Each joint's uncertain motion as independent errors (position, velocity, acceleration).
    roots: Vec<[[f64; 3]; 3]>,
    /// How each joint's position turns the wrench against what is inboard of it.
    turned: Vec<Vector6<f64>>,
    /// What errors of unit variance that move rows together do to each, row by row, counts.
    shared: Vec<f64>,
    /// Variance to leave out, one a row, counts^2.
    white: Vec<f64>,
}

/// One gauge's equation at this instant.
#[derive(Clone, Copy, Debug)]
struct Row {
    gauge: usize,
    /// Counts per N and per Nm of a tip wrench in E.
    tip: Vector6<f64>,
    /// Reading less bias, terms and the arm's own load, counts.
    value: f64,
    reading: GaugeReading,
}

impl WrenchEstimator {
    /// For an arm (with its tool) and its calibrated gauges; `sections[i]` is where `gauges[i]` sits.
    pub fn new(chain: &Chain, sections: &[Section], gauges: Vec<GaugeModel>) -> Self {
        Self::with_arm(chain, sections, gauges, ArmModel::default())
    }

    /// The same for a calibrated arm: `chain` is the corrected one.
    pub fn with_arm(chain: &Chain, sections: &[Section], gauges: Vec<GaugeModel>, arm: ArmModel) -> Self {
        let dynamics = Dynamics::new(chain, sections);
        let (n, coordinates) = (gauges.len(), dynamics.coordinates());
        let errors = 3 * coordinates + arm.deviations.len();
        Self {
            dynamics,
            arm: Arm::new(chain, sections, arm),
            gls: Gls::new(n),
            motion: std::array::from_fn(|_| vec![0.0; coordinates]),
            encoders_rad: vec![0.0; coordinates],
            present: Vec::with_capacity(n),
            by_motion: Vec::with_capacity(n * coordinates),
            roots: Vec::with_capacity(coordinates),
            turned: Vec::with_capacity(coordinates),
            shared: Vec::with_capacity(n * errors),
            white: Vec::with_capacity(n),
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
        self.arm.set_payload(body);
    }

    /// What a reading holds beside the calibrated bias, its terms and the arm's own load in the state of the last estimate:
    /// without a wrench on the tip, the gauge's error of zero, counts.
    pub fn unexplained_counts(&self, gauge: usize, reading: &GaugeReading) -> f64 {
        let model = &self.gauges[gauge];
        let own = model.bias_counts + model.terms.counts(&reading.regressors);
        reading.counts - own - model.compliance.dot(&self.dynamics.load(gauge))
    }

    /// Whitened parity residual of each gauge used by the last estimate: (gauge, residual in sigmas).
    pub fn residuals(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.present.iter().map(|row| row.gauge).zip(self.gls.whitened_residuals().iter().copied())
    }

    /// Gauges used by the last estimate, in the order of the rows of its redundancy.
    pub fn present(&self) -> impl ExactSizeIterator<Item = usize> + Clone + '_ {
        self.present.iter().map(|row| row.gauge)
    }

    /// How faults of single gauges would show in the last estimate, which gave `wrench`; false where it gave none.
    pub fn redundancy(&mut self, wrench: &Wrench<Tip>, out: &mut Redundancy) -> bool {
        self.gls.redundancy(&wrench.to_vector(), None, out)
    }

    /// The same for means over so many instants, when so much of each gauge's variance (counts^2) is new at each of them.
    pub fn redundancy_of_means(
        &mut self,
        wrench: &Wrench<Tip>,
        white_counts2: &[f64],
        instants: f64,
        out: &mut Redundancy,
    ) -> bool {
        self.white.clear();
        let gone = 1.0 - instants.max(1.0).recip();
        self.white.extend(self.present.iter().map(|row| white_counts2[row.gauge] * gone));
        self.gls.redundancy(&wrench.to_vector(), Some(&self.white), out)
    }

    /// What a gauge that is left out reads beyond what the others predict of it, and the standard deviation of that, counts; by the
    /// last estimate, which gave `solution`.
    pub fn deviation_counts(&self, gauge: usize, reading: &GaugeReading, solution: &Solution) -> (f64, f64) {
        let model = &self.gauges[gauge];
        let tip = self.dynamics.row_to_tip(gauge, &model.compliance);
        let value = self.unexplained_counts(gauge, reading) - self.zeros[gauge].shift_counts;
        let row = Row { gauge, tip, value, reading: *reading };
        let variance = model.noise_counts2
            + reading.unsettled_counts2
            + self.calibration_variance(&row, &solution.wrench)
            + (tip.transpose() * solution.covariance * tip)[(0, 0)];
        (value - tip.dot(&solution.wrench.to_vector()), variance.max(0.0).sqrt())
    }

    /// The wrench at one instant from each joint's motion and each gauge's reading (`None`: absent).
    ///
    /// Two passes: the first weighs the gauges as if little were known of the wrench, the second with the uncertainty
    /// that the wrench found in the first gives to every gauge's calibration, with joints that yield under it, and with what
    /// arm and gauges are uncertain of together. A stiff arm without such directions costs no pass over its links more.
    pub fn estimate(
        &mut self,
        motion: &[JointMotion],
        readings: &[Option<GaugeReading>],
    ) -> Result<Solution, NoWrench> {
        for (k, joint) in motion.iter().enumerate() {
            self.encoders_rad[k] = joint.position_rad;
            self.motion[0][k] = joint.position_rad;
            self.motion[1][k] = joint.velocity_rad_s;
            self.motion[2][k] = joint.acceleration_rad_s2;
        }
        self.move_arm();
        self.yield_under(&Wrench::zero());
        self.dynamics.differentiate();
        self.collect(readings);
        self.sense_motion(motion);
        self.weigh(None);
        let first = self.gls.estimate(&COLUMN_SCALE)?;
        let wrench = Wrench::from_vector(&first.x);
        if self.yield_under(&wrench) {
            self.collect(readings);
        }
        self.arm.place(&self.motion[0], &wrench);
        self.weigh(Some(&first));
        let second = self.gls.solve(&COLUMN_SCALE)?;
        Ok(Solution {
            wrench: Wrench::from_vector(&second.x),
            covariance: second.covariance,
            singular_values_per_n: second.singular_values,
            parity_chi2: second.chi2,
            parity_dof: self.present.len() - 6,
            protection: [f64::INFINITY; 6],
        })
    }

    fn move_arm(&mut self) {
        let [q, qd, qdd] = &self.motion;
        self.dynamics.update(q, qd, qdd);
    }

    /// Lets the joints yield under the arm's own load and a tip wrench, as the state of the last update has them;
    /// whether any joint yields.
    fn yield_under(&mut self, wrench: &Wrench<Tip>) -> bool {
        if !self.arm.yields() {
            return false;
        }
        for (k, flexibility) in self.arm.flexibility_rad_per_nm.iter().enumerate() {
            self.motion[0][k] = self.encoders_rad[k] + flexibility * self.dynamics.joint_torque_nm(k, wrench);
        }
        self.move_arm();
        true
    }

    fn collect(&mut self, readings: &[Option<GaugeReading>]) {
        self.present.clear();
        for (i, (gauge, reading)) in self.gauges.iter().zip(readings).enumerate() {
            let Some(reading) = *reading else { continue };
            self.present.push(Row {
                gauge: i,
                tip: self.dynamics.row_to_tip(i, &gauge.compliance),
                value: self.unexplained_counts(i, &reading) - self.zeros[i].shift_counts,
                reading,
            });
        }
    }

    fn sense_motion(&mut self, motion: &[JointMotion]) {
        self.roots.clear();
        self.roots.extend(motion.iter().map(|joint| square_root(&joint.covariance)));
        self.by_motion.clear();
        for row in &self.present {
            self.by_motion.extend(self.dynamics.row_by_motion(row.gauge, &row.tip));
        }
    }

    /// Hands the rows to the solver with all that is uncertain of them, under the wrench that a first pass found.
    fn weigh(&mut self, found: Option<&Estimate>) {
        let wrench = found.map_or_else(Wrench::zero, |fit| Wrench::from_vector(&fit.x));
        let coordinates = self.dynamics.coordinates();
        self.turned.clear();
        self.turned.extend((0..coordinates).map(|k| self.dynamics.turned_wrench(k, &wrench)));
        self.gls.clear();
        self.shared.clear();
        let deviations = if found.is_some() { self.arm.deviations() } else { 0 };
        for (at, row) in self.present.iter().enumerate() {
            let gauge = &self.gauges[row.gauge];
            let variance = gauge.noise_counts2
                + row.reading.unsettled_counts2
                + self.calibration_variance(row, &wrench)
                + self.unseen_variance(row.gauge, found);
            self.gls.push(&row.tip, row.value, variance);
            for coordinate in 0..coordinates {
                let errors =
                    self.motion_errors(row, coordinate, &self.by_motion[at * coordinates + coordinate]);
                self.shared.extend_from_slice(&errors);
            }
            if deviations > 0 {
                // Arm and gauges are uncertain together in these directions.
                let excitation = self.excitation(row.gauge, &row.reading, &wrench);
                let excited = self.zeros[row.gauge].excited(excitation);
                let compliance = &gauge.compliance;
                let change = |d| self.arm.change_counts(d, row.gauge, compliance, &excited, &wrench);
                self.shared.extend((0..deviations).map(change));
            }
        }
        self.gls.share(&self.shared, 3 * coordinates + deviations);
    }

    /// What one joint's uncertain motion, as three independent errors, does to a row, counts: it moves all rows' loads together.
    #[inline]
    fn motion_errors(&self, row: &Row, coordinate: usize, by_motion: &[f64; 3]) -> [f64; 3] {
        let [mut position, velocity, acceleration] = *by_motion;
        if self.dynamics.turns_tip(coordinate, row.gauge) {
            position += row.tip.dot(&self.turned[coordinate]);
        }
        self.roots[coordinate].map(|root| position * root[0] + velocity * root[1] + acceleration * root[2])
    }

    /// Variance that the calibration's uncertainty gives to a gauge under its present load, counts^2.
    fn calibration_variance(&self, row: &Row, wrench: &Wrench<Tip>) -> f64 {
        let gauge = &self.gauges[row.gauge];
        let zero = &self.zeros[row.gauge];
        let values = zero.excited(self.excitation(row.gauge, &row.reading, wrench));
        // Beyond its terms all is zero: most gauges have seven numbers, not sixteen.
        let used = 7 + gauge.terms.terms.len().min(MOST_TERMS);
        quadratic(&gauge.covariance, &values.as_slice()[..used]) + zero.variance_counts2
    }

    /// What a gauge's numbers are multiplied by in the state of the last estimate and under a tip wrench.
    #[inline]
    pub fn excitation(&self, gauge: usize, reading: &GaugeReading, wrench: &Wrench<Tip>) -> Excitation {
        let load = self.dynamics.load(gauge) + self.dynamics.load_of_tip_wrench(gauge, wrench).to_vector();
        let mut excitation = Excitation::zeros();
        excitation.fixed_rows_mut::<6>(0).copy_from(&load);
        excitation[6] = 1.0;
        excitation.as_mut_slice()[7..].copy_from_slice(&reading.regressors);
        excitation
    }

    /// Variance from directions that the calibration never saw, excited by a wrench that is itself uncertain, counts^2.
    fn unseen_variance(&self, gauge: usize, found: Option<&Estimate>) -> f64 {
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
}

impl From<NoFit> for NoWrench {
    fn from(why: NoFit) -> Self {
        match why {
            NoFit::TooFewRows => Self::TooFewGauges,
            NoFit::Singular => Self::Singular,
            NoFit::NotFinite => Self::NotFinite,
        }
    }
}

/// `v' M v` for a symmetric matrix, as far as the vector goes.
fn quadratic(matrix: &GaugeCovariance, vector: &[f64]) -> f64 {
    let column = |(k, value): (usize, &f64)| {
        let column = matrix.column(k);
        let above: f64 = column.iter().zip(&vector[..k]).map(|(m, v)| m * v).sum();
        value * (2.0 * above + column[k] * value)
    };
    vector.iter().enumerate().map(column).sum()
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
