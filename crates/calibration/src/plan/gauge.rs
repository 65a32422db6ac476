//! What is known of one gauge, and what a held pose adds.

use model::sensing::CHARACTERISTIC_LENGTH_M;
use nalgebra::{Matrix6, SMatrix, SVector, Vector6};
use rig::model_file::Sensor;

use crate::still::LOST_S;

/// Loads (N, moments over the characteristic length) and the bias's one: what a reading is linear in.
pub(super) type Regressor = SVector<f64, 7>;

/// How long a planned pose is held, s.
pub const HOLD_S: f64 = 1.0;

/// How long the arm counts as still of it: instants near a move do not.
const STILL_S: f64 = HOLD_S - 2.0 * LOST_S;

/// Readings of a gauge a second that are assumed; more help little, as a part of the noise is slow.
const RATE_HZ: f64 = 50.0;

/// Noise of a gauge that nobody measured yet, Nm: usual for cheap strain gauges.
const UNKNOWN_NOISE_NM: f64 = 3e-3;
/// Share of it that is slow, and how slow, s.
const UNKNOWN_SLOW: (f64, f64) = (0.15, 0.2);
/// Widths of an uncalibrated gauge: direction (of its whole sensitivity), offset and pitch of its line (m), zero (Nm).
const UNKNOWN_DIRECTION: f64 = 1.0;
const UNKNOWN_OFFSET_M: f64 = 0.02;
const UNKNOWN_PITCH_M: f64 = 3e-3;
const UNKNOWN_ZERO_NM: f64 = 10.0;

/// One gauge's sensitivity with its covariance, in counts and newtons (moments over the characteristic length).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaugeState {
    /// Sensitivity to the load of its section, counts/N.
    pub(super) compliance: Vector6<f64>,
    /// Covariance of sensitivities and bias.
    pub(super) covariance: SMatrix<f64, 7, 7>,
    /// Variance of one reading, counts^2.
    pub(super) noise_counts2: f64,
    /// Variance of the mean over one held pose, counts^2.
    held_counts2: f64,
}

/// Factor from counts/Nm to counts per newton at the characteristic length.
fn per_newton(component: usize) -> f64 {
    if (3..6).contains(&component) { CHARACTERISTIC_LENGTH_M } else { 1.0 }
}

/// Variance of the mean of noise with a slow part over one held pose, as a share of one reading's variance.
///
/// The slow part is a first-order process: its mean over T has the variance `2/x (1 - (1 - exp(-x))/x)`, `x = T/tau`.
fn held_share(slow_share: f64, slow_time_s: f64) -> f64 {
    let x = STILL_S / slow_time_s.max(1e-6);
    // Its beginning as a series where the difference would lose all digits.
    let slow = if x < 1e-3 { 1.0 - x / 3.0 } else { 2.0 / x * (1.0 + (-x).exp_m1() / x) };
    (1.0 - slow_share) / (RATE_HZ * STILL_S) + slow_share * slow
}

impl GaugeState {
    /// Of a calibrated gauge; none where the model states no covariance.
    pub fn of_model(sensor: &Sensor) -> Option<Self> {
        let noise_counts2 = sensor.noise_floor_counts.powi(2);
        let working = sensor.working();
        let covariance: SMatrix<f64, 7, 7> =
            SMatrix::from_fn(|i, k| sensor.covariance[i][k] * per_newton(i) * per_newton(k));
        (covariance.diagonal().min() > 0.0).then(|| Self {
            compliance: Vector6::from_fn(|k, _| working[k] * per_newton(k)),
            covariance,
            noise_counts2,
            held_counts2: noise_counts2 * held_share(sensor.noise_slow_share, sensor.noise_slow_time_s),
        })
    }

    /// Of a gauge that was never calibrated: one count a newton metre about its nominal axis, all else within usual widths.
    pub fn uncalibrated() -> Self {
        let length = CHARACTERISTIC_LENGTH_M;
        let moment = UNKNOWN_DIRECTION * length;
        let widths =
            [UNKNOWN_OFFSET_M, UNKNOWN_OFFSET_M, UNKNOWN_PITCH_M, moment, moment, moment, UNKNOWN_ZERO_NM];
        let noise_counts2 = UNKNOWN_NOISE_NM.powi(2);
        Self {
            compliance: Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, length),
            covariance: SMatrix::from_diagonal(&SVector::from(widths.map(|w| w * w))),
            noise_counts2,
            held_counts2: noise_counts2 * held_share(UNKNOWN_SLOW.0, UNKNOWN_SLOW.1),
        }
    }

    /// The same with the sensitivity and noise of another state of the same gauge.
    #[must_use]
    pub fn sensing_as(self, other: &Self) -> Self {
        Self { covariance: self.covariance, ..*other }
    }

    /// A square root of the covariance of the sensitivities.
    pub(super) fn compliance_root(&self) -> Matrix6<f64> {
        let eigen = self.covariance.fixed_view::<6, 6>(0, 0).into_owned().symmetric_eigen();
        // Rounding may leave a variance of nothing below zero.
        let roots = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
        eigen.eigenvectors * Matrix6::from_diagonal(&roots)
    }

    /// After one more held pose (Sherman, Morrison).
    pub(super) fn hold(&mut self, x: &Regressor) {
        let p = self.covariance * x;
        self.covariance -= p * p.transpose() / (self.held_counts2 + x.dot(&p));
        // Rounding must not make it lopsided over many poses.
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }

    /// By how much one more held pose shrinks `tr(P M)`.
    pub(super) fn gain(&self, x: &Regressor, weighing: &SMatrix<f64, 7, 7>) -> f64 {
        let p = self.covariance * x;
        p.dot(&(weighing * p)) / (self.held_counts2 + x.dot(&p))
    }

    /// By how much a little of a held pose shrinks `tr(P M)`, for the whole of it.
    #[cfg(test)]
    pub(super) fn sensitivity(&self, x: &Regressor, weighing: &SMatrix<f64, 7, 7>) -> f64 {
        let p = self.covariance * x;
        p.dot(&(weighing * p)) / self.held_counts2
    }

    /// Variance that the calibration brings into a reading under a load, counts^2.
    pub(super) fn variance(&self, x: &Regressor) -> f64 {
        x.dot(&(self.covariance * x))
    }

    /// Directions of load whose sensitivity is known worse than this share of the whole sensitivity.
    pub(super) fn undetermined(&self, share: f64) -> Vec<Vector6<f64>> {
        let compliance: Matrix6<f64> = self.covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let eigen = compliance.symmetric_eigen();
        let limit = (share * self.compliance.norm()).powi(2);
        (0..6)
            .filter(|k| eigen.eigenvalues[*k] > limit)
            .map(|k| eigen.eigenvectors.column(k).into_owned())
            .collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn many_poses_leave_their_least_squares_covariance() {
        let mut gauge = GaugeState::uncalibrated();
        let mut information = gauge.covariance.try_inverse().unwrap();
        for k in 0..40 {
            let angle = f64::from(k);
            let x =
                Regressor::from_fn(|i, _| if i == 6 { 1.0 } else { (angle * (i as f64 + 0.7)).sin() * 5.0 });
            information += x * x.transpose() / gauge.held_counts2;
            let (before, p) = (gauge.covariance.trace(), gauge);
            gauge.hold(&x);
            let shrunk = before - gauge.covariance.trace();
            let foretold = p.gain(&x, &SMatrix::identity());
            assert!((shrunk - foretold).abs() < 1e-9 * before, "{shrunk} {foretold}");
        }
        let expected = information.try_inverse().unwrap();
        assert!((gauge.covariance - expected).amax() < 1e-6 * expected.amax());
        assert!(gauge.undetermined(0.1).is_empty());
    }

    #[test]
    fn the_mean_over_a_hold_has_the_variance_of_its_noise() {
        assert!((held_share(0.0, 0.2) - 1.0 / (RATE_HZ * STILL_S)).abs() < 1e-15, "white noise averages");
        assert!((held_share(1.0, 1e6) - 1.0).abs() < 1e-6, "what does not change in a hold stays");
        // The same as a double sum over many instants of exp(-|t - s| / tau).
        let n = 2000;
        let tau = 0.2;
        let sum: f64 = (0..n)
            .flat_map(|i| {
                (0..n).map(move |k| (-(f64::from(i - k).abs()) / f64::from(n) * STILL_S / tau).exp())
            })
            .sum();
        assert!((sum / f64::from(n * n) - held_share(1.0, tau)).abs() < 1e-3);
    }
}
