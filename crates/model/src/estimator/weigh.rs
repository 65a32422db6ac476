//! How much each gauge's equation counts: its noise, its calibration under the load it carries, and joint motion that all gauges share.

use nalgebra::{Matrix6, Vector6};
use wide::{f64x2, f64x4};

use super::four::FOUR;
use super::{EXPECTED_FORCE_N, EXPECTED_MOMENT_NM, Excitation, GaugeReading, Row, WrenchEstimator};
use crate::motion::JointMotion;
use crate::spatial::{Tip, Wrench};

/// Two joints' uncertain motion, each as three independent errors of unit variance: what they do to position, velocity and acceleration.
///
/// Cholesky columns of the covariances, the position leading: only the first error moves it. Zeros are left out.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotionRoots {
    /// The first error: rad, rad/s, rad/s^2.
    first: [f64x2; 3],
    /// The second error: rad/s, rad/s^2.
    second: [f64x2; 2],
    /// The third error: rad/s^2.
    third: f64x2,
}

impl MotionRoots {
    /// Of one or two covariances of position, velocity and acceleration; directions without variance are zero.
    pub(super) fn of(joints: &[JointMotion]) -> Self {
        let entry = |i: usize, k: usize| {
            let of =
                |joint: usize| joints.get(joint).map_or(0.0, |joint: &JointMotion| joint.covariance[(i, k)]);
            f64x2::new([of(0), of(1)])
        };
        let (position, per_position) = root(entry(0, 0));
        let (velocity, acceleration) = (entry(0, 1) * per_position, entry(0, 2) * per_position);
        let (second, per_second) = root(entry(1, 1) - velocity * velocity);
        let along = (entry(1, 2) - velocity * acceleration) * per_second;
        let (third, _) = root(entry(2, 2) - acceleration * acceleration - along * along);
        Self { first: [position, velocity, acceleration], second: [second, along], third }
    }

    /// What the first errors do to a reading that the joints' position, velocity and acceleration change so much, counts; and the others.
    #[inline]
    pub(super) fn felt(&self, [position, velocity, acceleration]: [f64x2; 3]) -> (f64x2, [f64x2; 2]) {
        let ([a, b, c], [d, e]) = (self.first, self.second);
        let others = [velocity * d + acceleration * e, acceleration * self.third];
        (position * a + velocity * b + acceleration * c, others)
    }
}

/// Roots of variances and one over them; zeros where there is none.
#[inline]
fn root(variances: f64x2) -> (f64x2, f64x2) {
    let is_some = variances.simd_gt(f64x2::ZERO);
    let roots = variances.sqrt();
    (is_some.select(roots, f64x2::ZERO), is_some.select(f64x2::ONE / roots, f64x2::ZERO))
}

impl WrenchEstimator {
    /// Hands the rows to the solver with all that is uncertain of them before anything of the wrench is known.
    pub(super) fn weigh_first(&mut self) {
        self.feel_motion();
        self.gls.begin(&self.steady);
        self.push_rows(&Wrench::zero(), expected_covariance);
        self.gls.share(&self.turning);
    }

    /// The same under the wrench that a first pass found: calibrations are uncertain in proportion to load, joints' positions turn the wrench,
    /// and arm and gauges are uncertain together.
    pub(super) fn weigh_again(&mut self, found: &Wrench<Tip>) {
        let covariance = self.needs_covariance.then(|| self.gls.unknowns_covariance());
        self.turn_errors(found);
        self.gls.begin_again();
        self.push_rows(found, || covariance.unwrap_or_default());
        self.gls.share(&self.turning);
        self.share_deviations(found);
    }

    /// What the joints' errors do to each row, error by error.
    fn feel_motion(&mut self) {
        let stride = self.gls.stride();
        for (effects, errors) in [(&mut self.turning, 1), (&mut self.steady, 2)] {
            effects.clear();
            effects.resize(2 * errors * self.roots.len() * stride, f64x4::ZERO);
        }
        for (at, row) in self.present.iter().enumerate() {
            let by_motion = self.dynamics.row_by_motion_of_two(row.gauge, &row.tip);
            for (pair, (roots, by_motion)) in self.roots.iter().zip(by_motion).enumerate() {
                let (first, [second, third]) = roots.felt(by_motion);
                put(&mut self.turning[2 * pair * stride + at / 4..], stride, at % 4, first);
                let steady = &mut self.steady[4 * pair * stride + at / 4..];
                put(steady, stride, at % 4, second);
                put(&mut steady[2 * stride..], stride, at % 4, third);
            }
        }
    }

    /// Adds to the joints' first errors what turning the wrench does to the rows inboard of them.
    fn turn_errors(&mut self, wrench: &Wrench<Tip>) {
        let stride = self.gls.stride();
        self.turned.clear();
        self.turned.extend(self.dynamics.turned_wrenches(wrench));
        for (at, row) in self.present.iter().enumerate() {
            let inboard = self.dynamics.inboard_coordinates(row.gauge);
            let tip: [f64x2; 6] = std::array::from_fn(|c| f64x2::splat(row.tip[c]));
            let joints = self.turned.iter().zip(&self.roots).enumerate().skip(inboard / 2);
            for (pair, (turned, roots)) in joints {
                let halves = [0, 3]
                    .map(|c| tip[c] * turned[c] + tip[c + 1] * turned[c + 1] + tip[c + 2] * turned[c + 2]);
                let errors = ((halves[0] + halves[1]) * roots.first[0]).to_array();
                for joint in (2 * pair..2 * pair + 2).filter(|joint| *joint >= inboard) {
                    self.turning[stride * joint + at / 4].as_mut_array()[at % 4] += errors[joint % 2];
                }
            }
        }
    }

    /// Variance that the joints' uncertain motion gives a row, counts^2.
    pub(super) fn motion_variance(&self, at: usize) -> f64 {
        let errors = self.turning.chunks(self.gls.stride()).chain(self.steady.chunks(self.gls.stride()));
        errors.map(|effects| effects[at / 4].as_array()[at % 4].powi(2)).sum()
    }

    fn push_rows(&mut self, wrench: &Wrench<Tip>, wrench_covariance: impl Fn() -> Matrix6<f64>) {
        self.by_calibration.clear();
        self.by_calibration.extend(self.fours.iter().map(|four| four.variances(wrench)));
        for row in &self.present {
            let unseen = self.unseen_variance(row.gauge, &wrench_covariance);
            let variance = self.variance(row, wrench, self.by_calibration[row.gauge / FOUR]);
            self.gls.push(&row.tip, row.value, variance + unseen);
        }
    }

    /// Arm and gauges are uncertain together in the directions of the arm's deviations.
    fn share_deviations(&mut self, wrench: &Wrench<Tip>) {
        let (deviations, stride) = (self.arm.deviations(), self.gls.stride());
        if deviations == 0 {
            return;
        }
        self.deviated.clear();
        self.deviated.resize(deviations * stride, f64x4::ZERO);
        for (at, row) in self.present.iter().enumerate() {
            let excitation = self.excitation(row.gauge, &row.reading, wrench);
            let excited = self.zeros[row.gauge].excited(excitation);
            let compliance = &self.gauges[row.gauge].compliance;
            for (deviation, effects) in self.deviated.chunks_exact_mut(stride).enumerate() {
                effects[at / 4].as_mut_array()[at % 4] =
                    self.arm.change_counts(deviation, row.gauge, compliance, &excited, wrench);
            }
        }
        self.gls.share(&self.deviated);
    }

    /// Variance of a row that is its own: noise, an unknown past, and the calibration's uncertainty under its present load; counts^2.
    pub(super) fn variance(&self, row: &Row, wrench: &Wrench<Tip>, by_calibration: f64x4) -> f64 {
        let (zero, terms) = (&self.zeros[row.gauge], &self.terms_forms[row.gauge]);
        let mut variance = self.gauges[row.gauge].noise_counts2
            + row.reading.unsettled_counts2
            + zero.variance_counts2
            + by_calibration.as_array()[row.gauge % FOUR];
        if !terms.is_empty() {
            variance += terms.of(&zero.excited(self.excitation(row.gauge, &row.reading, wrench)));
        }
        variance
    }

    /// Variance from directions that the calibration never saw, excited by a wrench that is itself uncertain, counts^2.
    fn unseen_variance(&self, gauge: usize, wrench_covariance: impl Fn() -> Matrix6<f64>) -> f64 {
        let Some(assumed) = &self.gauges[gauge].assumed else { return 0.0 };
        let adjoint = self.dynamics.tip_adjoint(gauge);
        (adjoint * wrench_covariance() * adjoint.transpose()).component_mul(assumed).sum()
    }

    /// What a gauge's numbers are multiplied by in the state of the last estimate and under a tip wrench.
    pub fn excitation(&self, gauge: usize, reading: &GaugeReading, wrench: &Wrench<Tip>) -> Excitation {
        let load = self.dynamics.load(gauge) + self.dynamics.load_of_tip_wrench(gauge, wrench).to_vector();
        let mut excitation = Excitation::zeros();
        excitation.fixed_rows_mut::<6>(0).copy_from(&load);
        excitation[6] = 1.0;
        excitation.as_mut_slice()[7..].copy_from_slice(&reading.regressors);
        excitation
    }
}

/// Puts what two errors do to a row into its lane.
#[inline]
fn put(effects: &mut [f64x4], stride: usize, lane: usize, errors: f64x2) {
    let [first, second] = errors.to_array();
    effects[0].as_mut_array()[lane] = first;
    effects[stride].as_mut_array()[lane] = second;
}

/// Covariance of a wrench of which nothing is known but its usual size; N^2, N Nm, Nm^2.
fn expected_covariance() -> Matrix6<f64> {
    let sigma = |k: usize| if k < 3 { EXPECTED_FORCE_N } else { EXPECTED_MOMENT_NM };
    Matrix6::from_diagonal(&Vector6::from_fn(|k, _| sigma(k).powi(2)))
}
