//! One Kalman filter of the bank: position, velocity, acceleration and jerk driven by white snap, in scaled time.
//!
//! Time is counted in units of 10 ms inside, so that the four states of a robot joint are of similar size and the
//! covariance stays well conditioned.

use super::{JointMotion, Sampled};
use nalgebra::{Matrix3, Matrix4, Vector4};

/// Inner unit of time, s.
pub(super) const UNIT_S: f64 = 0.01;

/// What a joint at rest creeps, rad per inner time unit (1e-5 rad/s).
pub(super) const CREEP: f64 = 1e-5 * UNIT_S;

/// What it shivers, rad per inner time unit squared (1e-3 rad/s^2); the same per inner time unit cubed is its jerk.
pub(super) const SHIVER: f64 = 1e-3 * UNIT_S * UNIT_S;

/// Velocity that a joint which comes to rest can lose within `step` inner time units, rad per inner time unit.
pub(super) fn stopping(step: f64) -> f64 {
    const STOPPING_RAD_S2: f64 = 50.0;
    STOPPING_RAD_S2 * UNIT_S.powi(2) * step
}

/// Mean and covariance of position, velocity, acceleration, jerk: rad per inner time unit to the power 0..3.
#[derive(Clone, Copy, Debug)]
pub(super) struct State {
    pub(super) mean: Vector4<f64>,
    pub(super) covariance: Matrix4<f64>,
}

impl State {
    /// Knows one position and nothing of the motion but what a robot joint can do.
    pub(super) fn from_position(position_rad: f64, variance_rad2: f64) -> Self {
        let (velocity, acceleration, jerk) = (1.0 * UNIT_S, 10.0 * UNIT_S.powi(2), 100.0 * UNIT_S.powi(3));
        let variances = Vector4::new(variance_rad2, velocity.powi(2), acceleration.powi(2), jerk.powi(2));
        Self {
            mean: Vector4::new(position_rad, 0.0, 0.0, 0.0),
            covariance: Matrix4::from_diagonal(&variances),
        }
    }

    /// The state `step` later, driven by snap of spectral density `snap` (inner units).
    pub(super) fn predicted(&self, transition: &Matrix4<f64>, process: &Matrix4<f64>) -> Self {
        Self {
            mean: transition * self.mean,
            covariance: transition * self.covariance * transition.transpose() + process,
        }
    }

    /// The same where the instant it refers to is unsure by this variance (inner units): the state as it was at whatever instant that
    /// really was, to second order.
    pub(super) fn smeared(mut self, variance: f64) -> Self {
        let first = Vector4::new(self.mean[1], self.mean[2], self.mean[3], 0.0);
        let second = Vector4::new(self.mean[2], self.mean[3], 0.0, 0.0);
        self.mean += second * (0.5 * variance);
        self.covariance +=
            first * first.transpose() * variance + second * second.transpose() * (0.5 * variance * variance);
        self
    }

    /// Takes in a position whose own sampling instant is uncertain by `sigma_s`: at speed, and where the joint reverses, it counts
    /// for less.
    pub(super) fn measure_position(&mut self, value: f64, variance: f64, sigma_s: f64) -> f64 {
        let time2 = (sigma_s / UNIT_S).powi(2);
        let smear = self.mean[1].powi(2) * time2 + 0.5 * (self.mean[2] * time2).powi(2);
        self.measure(0, value, variance + smear)
    }

    /// Takes in a measurement of one state; returns the log-likelihood of what was measured.
    pub(super) fn measure(&mut self, index: usize, value: f64, variance: f64) -> f64 {
        let column = self.covariance.column(index).into_owned();
        let innovation_variance = column[index] + variance;
        let innovation = value - self.mean[index];
        let gain = column / innovation_variance;
        self.mean += gain * innovation;
        self.covariance -= gain * column.transpose();
        // Rounding must not make the covariance lopsided: the smoother inverts it.
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        -0.5 * (innovation * innovation / innovation_variance + innovation_variance.ln())
    }

    /// This filtered state corrected by what came after: `next` is the smoothed state there, `predicted` what it was expected to be.
    pub(super) fn in_the_light_of(&self, next: &Self, predicted: &Self, gain: &Matrix4<f64>) -> Self {
        let covariance = self.covariance + gain * (next.covariance - predicted.covariance) * gain.transpose();
        Self {
            mean: self.mean + gain * (next.mean - predicted.mean),
            covariance: (covariance + covariance.transpose()) * 0.5,
        }
    }

    /// In SI units, without the jerk.
    pub(super) fn motion(&self) -> JointMotion {
        let scale = [1.0, 1.0 / UNIT_S, 1.0 / (UNIT_S * UNIT_S)];
        JointMotion {
            position_rad: self.mean[0],
            velocity_rad_s: self.mean[1] * scale[1],
            acceleration_rad_s2: self.mean[2] * scale[2],
            covariance: Matrix3::from_fn(|i, k| self.covariance[(i, k)] * scale[i] * scale[k]),
        }
    }
}

/// Weighted mean of Gaussian states and the covariance of their mixture.
pub(super) fn mixture<const M: usize>(states: &[State; M], weights: &[f64; M]) -> State {
    let mut mean = Vector4::zeros();
    for (state, w) in states.iter().zip(weights) {
        mean += state.mean * *w;
    }
    let mut covariance = Matrix4::zeros();
    for (state, w) in states.iter().zip(weights) {
        let apart = state.mean - mean;
        covariance += (state.covariance + apart * apart.transpose()) * *w;
    }
    State { mean, covariance }
}

/// Time from one sampling to another in inner units.
pub(super) fn inner_step(from: &Sampled, to: &Sampled) -> f64 {
    (to.at_ns - from.at_ns) as f64 * 1e-9 / UNIT_S
}

/// Variance of that time, inner units.
pub(super) fn inner_variance(from: &Sampled, to: &Sampled) -> f64 {
    (to.walked_s2 - from.walked_s2).abs() / (UNIT_S * UNIT_S)
}

/// Transition over `step` inner time units.
pub(super) fn transition(step: f64) -> Matrix4<f64> {
    let (s2, s3) = (step * step / 2.0, step * step * step / 6.0);
    Matrix4::new(1.0, step, s2, s3, 0.0, 1.0, step, s2, 0.0, 0.0, 1.0, step, 0.0, 0.0, 0.0, 1.0)
}

/// Covariance that white snap of unit spectral density adds over `step` inner time units.
pub(super) fn unit_process(step: f64) -> Matrix4<f64> {
    const FACTORIAL: [f64; 4] = [1.0, 1.0, 2.0, 6.0];
    let mut powers = [1.0; 8];
    for n in 1..8 {
        powers[n] = powers[n - 1] * step;
    }
    Matrix4::from_fn(|i, k| {
        let (a, b) = (3 - i, 3 - k);
        powers[a + b + 1] / ((a + b + 1) as f64 * FACTORIAL[a] * FACTORIAL[b])
    })
}

/// Spectral density of snap in inner units, from rad^2/s^7.
pub(super) fn inner_density(density: f64) -> f64 {
    density * UNIT_S.powi(7)
}
