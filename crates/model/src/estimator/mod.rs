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
mod covariance;
mod four;
mod gls;
mod redundancy;
mod singular;
#[cfg(test)]
mod tests;
mod triangle;
mod weigh;
mod zero;

pub use arm::{ArmModel, Deviation};
pub use gls::{Fit, Gls, NoFit};
pub use redundancy::Redundancy;
pub use singular::singular_values;
pub use zero::Zero;

use crate::chain::{Chain, Section};
use crate::dynamics::Dynamics;
use crate::motion::JointMotion;
use crate::sensing::CHARACTERISTIC_LENGTH_M;
use crate::spatial::{RigidBody, Tip, Wrench};
use crate::terms::{GaugeTerms, MOST_TERMS, Regressors};
use arm::Arm;
use four::{FOUR, Four, TermsForm};
use nalgebra::{Matrix6, SMatrix, SVector, Vector6};
use weigh::MotionRoots;
use wide::{f64x2, f64x4};

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
    /// What the arm was posed for, and whether it still is.
    posed: Vec<JointMotion>,
    is_posed: bool,
    /// Gauges that have a reading at this instant.
    present: Vec<Row>,
    /// The gauges, four at a time, and what their terms add.
    fours: Vec<Four>,
    terms_forms: Vec<TermsForm>,
    /// Variances by the calibration, four gauges at a time, counts^2.
    by_calibration: Vec<f64x4>,
    /// Whether a gauge assumes what it never saw.
    needs_covariance: bool,
    /// The joints' uncertain motion as independent errors, two joints at a time.
    roots: Vec<MotionRoots>,
    /// How the joints' positions turn the wrench against what is inboard of them, two joints at a time.
    turned: Vec<[f64x2; 6]>,
    /// What the joints' errors, of unit variance, do to the rows, error by error, counts: those that move positions, and the others.
    turning: Vec<f64x4>,
    steady: Vec<f64x4>,
    /// The same of what arm and gauges are uncertain of together.
    deviated: Vec<f64x4>,
    /// Variance to leave out, one a row, counts^2.
    white: Vec<f64>,
}

/// One gauge's equation at this instant.
#[derive(Clone, Copy, Debug)]
struct Row {
    gauge: usize,
    /// Counts per N and per Nm of a tip wrench in E.
    tip: Vector6<f64>,
    /// Reading less bias, terms and what the arm's own load makes, counts.
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
        let pairs = coordinates.div_ceil(2);
        let gls = Gls::new(n);
        let stride = gls.stride();
        Self {
            dynamics,
            deviated: Vec::with_capacity(arm.deviations.len() * stride),
            arm: Arm::new(chain, sections, arm),
            gls,
            motion: std::array::from_fn(|_| vec![0.0; coordinates]),
            posed: Vec::with_capacity(coordinates),
            is_posed: false,
            present: Vec::with_capacity(n),
            fours: gauges.chunks(FOUR).map(Four::new).collect(),
            terms_forms: gauges.iter().map(TermsForm::new).collect(),
            by_calibration: Vec::with_capacity(n.div_ceil(FOUR)),
            needs_covariance: gauges.iter().any(|gauge| gauge.assumed.is_some()),
            roots: Vec::with_capacity(pairs),
            turned: Vec::with_capacity(pairs),
            turning: Vec::with_capacity(2 * pairs * stride),
            steady: Vec::with_capacity(4 * pairs * stride),
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
        self.fours[gauge / FOUR].set_zero(gauge % FOUR, &zero);
        self.zeros[gauge] = zero;
    }

    /// Makes a body at the tip (tip frame) part of the arm from the next estimate on; without mass: takes it off.
    pub fn set_payload(&mut self, body: &RigidBody) {
        self.dynamics.set_payload(body);
        self.arm.set_payload(body);
        self.is_posed = false;
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

    /// What each gauge used by the last estimate reads beyond this wrench (counts), with the variance of its own noise and of the joints' motion
    /// (counts^2): what differs from one instant to the next though the load does not. Gauge, reading, variance.
    pub fn beyond<'a>(&'a self, wrench: &Wrench<Tip>) -> impl Iterator<Item = (usize, f64, f64)> + 'a {
        let wrench = wrench.to_vector();
        self.present.iter().enumerate().map(move |(at, row)| {
            let variance = self.gauges[row.gauge].noise_counts2 + self.motion_variance(at);
            (row.gauge, row.value - row.tip.dot(&wrench), variance)
        })
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
        let row = self.row(gauge, reading);
        let by_calibration = self.fours[gauge / FOUR].variances(&solution.wrench);
        let variance = self.variance(&row, &solution.wrench, by_calibration)
            + (row.tip.transpose() * solution.covariance * row.tip)[(0, 0)];
        (row.value - row.tip.dot(&solution.wrench.to_vector()), variance.max(0.0).sqrt())
    }

    /// A gauge's equation in the state of the arm.
    fn row(&self, gauge: usize, reading: &GaugeReading) -> Row {
        let model = &self.gauges[gauge];
        let (tip, own_counts) = self.fours[gauge / FOUR].row(gauge % FOUR);
        let zero =
            model.bias_counts + model.terms.counts(&reading.regressors) + self.zeros[gauge].shift_counts;
        let value = reading.counts - zero - own_counts;
        Row { gauge, tip, value, reading: *reading }
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
        self.prepare(motion);
        self.collect(readings);
        self.weigh_first();
        let wrench = Wrench::from_vector(&self.gls.estimate(&COLUMN_SCALE)?);
        if self.yield_under(&wrench) {
            self.look();
            self.collect(readings);
            // The arm is not as it was posed any more.
            self.is_posed = false;
        }
        self.arm.place(&self.motion[0], &wrench);
        self.weigh_again(&wrench);
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

    /// What an estimate needs of the arm before anything is known of its gauges: done ahead where the motion is known first.
    pub fn prepare(&mut self, motion: &[JointMotion]) {
        if std::mem::replace(&mut self.is_posed, true) && self.posed == motion {
            return;
        }
        self.posed.clear();
        self.posed.extend_from_slice(motion);
        for (k, joint) in motion.iter().enumerate() {
            self.motion[0][k] = joint.position_rad;
            self.motion[1][k] = joint.velocity_rad_s;
            self.motion[2][k] = joint.acceleration_rad_s2;
        }
        self.move_arm();
        self.yield_under(&Wrench::zero());
        self.dynamics.differentiate();
        self.look();
        self.roots.clear();
        self.roots.extend(motion.chunks(2).map(MotionRoots::of));
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
            self.motion[0][k] =
                self.posed[k].position_rad + flexibility * self.dynamics.joint_torque_nm(k, wrench);
        }
        self.move_arm();
        true
    }

    /// Takes in the state of the arm, four gauges at a time.
    fn look(&mut self) {
        for (four, first) in self.fours.iter_mut().zip((0..).step_by(FOUR)) {
            four.look(&self.dynamics, first);
        }
    }

    fn collect(&mut self, readings: &[Option<GaugeReading>]) {
        let mut present = std::mem::take(&mut self.present);
        present.clear();
        let heard = readings.iter().take(self.gauges.len()).enumerate();
        present.extend(heard.filter_map(|(gauge, reading)| Some(self.row(gauge, reading.as_ref()?))));
        self.present = present;
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
