//! How much each gauge's equation counts: its noise, its calibration under the load it carries, and joint motion that all gauges share.

use nalgebra::{Matrix6, Vector6};
use wide::f64x2;

use super::{
    EXPECTED_FORCE_N, EXPECTED_MOMENT_NM, Excitation, GAUGE_NUMBERS, GaugeCovariance, Row, WrenchEstimator,
};
use crate::motion::JointMotion;
use crate::spatial::{Tip, Wrench};

/// Numbers of a gauge without terms, and nothing: whole vectors.
const FEW: usize = 8;

/// A covariance laid out for its quadratic form: columns of the upper triangle, what is beside the diagonal doubled.
#[derive(Clone, Debug)]
pub(super) struct Form {
    /// Columns of load, bias and first term.
    few: [[f64; FEW]; FEW],
    /// Columns of the other terms, as many as there are.
    more: Vec<[f64; GAUGE_NUMBERS]>,
}

impl Form {
    /// Of the first so many numbers: beyond them all is zero.
    pub(super) fn new(covariance: &GaugeCovariance, numbers: usize) -> Self {
        let entry = |i: usize, k: usize| match i.cmp(&k) {
            std::cmp::Ordering::Less => 2.0 * covariance[(i, k)],
            std::cmp::Ordering::Equal => covariance[(i, k)],
            std::cmp::Ordering::Greater => 0.0,
        };
        Self {
            few: std::array::from_fn(|k| std::array::from_fn(|i| entry(i, k))),
            more: (FEW..numbers).map(|k| std::array::from_fn(|i| entry(i, k))).collect(),
        }
    }

    /// `v' M v`, counts^2.
    fn of(&self, vector: &[f64; GAUGE_NUMBERS]) -> f64 {
        let mut product = [0.0; FEW];
        for k in 0..FEW {
            // Two at a time, down to the diagonal.
            (0..=(k | 1)).for_each(|i| product[i] += self.few[k][i] * vector[k]);
        }
        let sums: [f64; 2] = std::array::from_fn(|i| {
            (product[i] * vector[i] + product[i + 2] * vector[i + 2])
                + (product[i + 4] * vector[i + 4] + product[i + 6] * vector[i + 6])
        });
        let more = self.more.iter().zip(FEW..).map(|(column, k)| {
            vector[k] * column[..=k].iter().zip(vector).map(|(value, other)| value * other).sum::<f64>()
        });
        sums[0] + sums[1] + more.sum::<f64>()
    }
}

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
        self.steady.clear();
        self.turning.clear();
        for row in &self.present {
            let by_motion = self.dynamics.row_by_motion_of_two(row.gauge, &row.tip);
            for (roots, by_motion) in self.roots.iter().zip(by_motion) {
                let (first, others) = roots.felt(by_motion);
                self.turning.push(first);
                self.steady.extend(others);
            }
        }
        self.gls.begin(&self.steady, 2 * self.roots.len());
        for row in &self.present {
            let unseen = self.unseen_variance(row.gauge, expected_covariance);
            self.gls.push(&row.tip, row.value, self.variance(row, &Wrench::zero()) + unseen);
        }
        self.gls.share(&self.turning, self.roots.len());
    }

    /// The same under the wrench that a first pass found: calibrations are uncertain in proportion to load, joints' positions turn the wrench,
    /// and arm and gauges are uncertain together.
    pub(super) fn weigh_again(&mut self, found: &Wrench<Tip>) {
        let covariance = self.needs_covariance.then(|| self.gls.unknowns_covariance());
        self.turned.clear();
        self.turned.extend(self.dynamics.turned_wrenches(found));
        self.turn_errors();
        self.gls.begin_again();
        for row in &self.present {
            let unseen = self.unseen_variance(row.gauge, || covariance.unwrap_or_default());
            self.gls.push(&row.tip, row.value, self.variance(row, found) + unseen);
        }
        self.gls.share(&self.turning, self.roots.len());
        self.share_deviations(found);
    }

    /// Adds to the joints' first errors what turning the wrench does to the rows inboard of them.
    fn turn_errors(&mut self) {
        let pairs = self.roots.len();
        for (row, errors) in self.present.iter().zip(self.turning.chunks_exact_mut(pairs.max(1))) {
            let inboard = self.dynamics.inboard_coordinates(row.gauge);
            let tip: [f64x2; 6] = std::array::from_fn(|c| f64x2::splat(row.tip[c]));
            let joints = errors.iter_mut().zip(&self.turned).zip(&self.roots);
            for (pair, ((error, turned), roots)) in joints.enumerate().skip(inboard / 2) {
                let halves = [0, 3]
                    .map(|c| tip[c] * turned[c] + tip[c + 1] * turned[c + 1] + tip[c + 2] * turned[c + 2]);
                let mut position = halves[0] + halves[1];
                if 2 * pair < inboard {
                    position.as_mut_array()[0] = 0.0;
                }
                *error += position * roots.first[0];
            }
        }
    }

    /// Arm and gauges are uncertain together in the directions of the arm's deviations.
    fn share_deviations(&mut self, wrench: &Wrench<Tip>) {
        let pairs = self.arm.deviations().div_ceil(2);
        if pairs == 0 {
            return;
        }
        self.deviated.clear();
        for row in &self.present {
            let excitation = self.excitation(row.gauge, &row.reading, wrench);
            let excited = self.zeros[row.gauge].excited(excitation);
            let compliance = &self.gauges[row.gauge].compliance;
            let change = |d| match d < self.arm.deviations() {
                true => self.arm.change_counts(d, row.gauge, compliance, &excited, wrench),
                false => 0.0,
            };
            self.deviated.extend((0..pairs).map(|pair| f64x2::new([change(2 * pair), change(2 * pair + 1)])));
        }
        self.gls.share(&self.deviated, pairs);
    }

    /// Variance of a row that is its own: noise, an unknown past, and the calibration's uncertainty under its present load; counts^2.
    pub(super) fn variance(&self, row: &Row, wrench: &Wrench<Tip>) -> f64 {
        let load = self.dynamics.load_under(row.gauge, wrench);
        let zero = &self.zeros[row.gauge];
        let mut excitation = excitation(&load, &row.reading.regressors);
        if zero.found_at.is_some() {
            excitation = zero.excited(excitation.into()).into();
        }
        self.gauges[row.gauge].noise_counts2
            + row.reading.unsettled_counts2
            + zero.variance_counts2
            + self.forms[row.gauge].of(&excitation)
    }

    /// Variance from directions that the calibration never saw, excited by a wrench that is itself uncertain, counts^2.
    fn unseen_variance(&self, gauge: usize, wrench_covariance: impl Fn() -> Matrix6<f64>) -> f64 {
        let Some(assumed) = &self.gauges[gauge].assumed else { return 0.0 };
        let adjoint = self.dynamics.tip_adjoint(gauge);
        (adjoint * wrench_covariance() * adjoint.transpose()).component_mul(assumed).sum()
    }

    /// What a gauge's numbers are multiplied by in the state of the last estimate and under a tip wrench.
    pub fn excitation(
        &self,
        gauge: usize,
        reading: &super::GaugeReading,
        wrench: &Wrench<Tip>,
    ) -> Excitation {
        let load = self.dynamics.load_under(gauge, wrench);
        excitation(&load, &reading.regressors).into()
    }
}

/// Load (N, Nm; S), one, and the terms' regressors.
#[inline]
fn excitation(load: &Vector6<f64>, regressors: &[f64; GAUGE_NUMBERS - 7]) -> [f64; GAUGE_NUMBERS] {
    let mut excitation = [1.0; GAUGE_NUMBERS];
    excitation[..6].copy_from_slice(load.as_slice());
    excitation[7..].copy_from_slice(regressors);
    excitation
}

/// Covariance of a wrench of which nothing is known but its usual size; N^2, N Nm, Nm^2.
fn expected_covariance() -> Matrix6<f64> {
    let sigma = |k: usize| if k < 3 { EXPECTED_FORCE_N } else { EXPECTED_MOMENT_NM };
    Matrix6::from_diagonal(&Vector6::from_fn(|k, _| sigma(k).powi(2)))
}
