//! The published wrench's covariance over poses of the workspace.

use model::dynamics::Dynamics;
use model::estimator::Gls;
use model::sensing::CHARACTERISTIC_LENGTH_M;
use nalgebra::{Matrix6, SMatrix, Vector6};
use rand::SeedableRng;
use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};
use rig::Rig;
use serde::Serialize;

use super::TipWrench;
use super::candidates::{loaded, spread_poses};
use super::gauge::{GaugeState, Regressor};
use crate::solve::unscaled;

/// Poses that the wrench is judged in; a tenth of them, in which noise alone is worst (near singular ones), does not count.
const POSES: usize = 120;
const KEPT: usize = 108;

/// What the environment applies while the wrench is judged, N and Nm, in changing directions.
const FORCE_N: f64 = 5.0;
const MOMENT_NM: f64 = 0.5;

/// How well the wrench of one instant is known in the worst pose of the workspace: the largest of the three reported deviations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Accuracy {
    /// Of the force's components, N.
    pub force_sigma_n: f64,
    /// Of the moment's components about E's origin, Nm.
    pub torque_sigma_nm: f64,
    /// The calibration's part of the force's deviation, which no averaging takes away, N.
    pub calibration_force_sigma_n: f64,
    /// The calibration's part of the moment's, Nm.
    pub calibration_torque_sigma_nm: f64,
    /// The calibration's part of one force component's deviation, RMS over components and the workspace, N.
    pub calibration_force_rms_n: f64,
}

/// One pose of the workspace.
struct Place {
    /// Load of each gauge with the environment's wrench, for the calibration's part of the error.
    regressors: Vec<Regressor>,
    /// Row of each gauge to a tip wrench, moments over the characteristic length, counts/N.
    rows: Vec<Vector6<f64>>,
}

/// Poses all over the joints' ranges, where the wrench is to be known.
pub struct Workspace {
    places: Vec<Place>,
}

impl Workspace {
    /// For gauges of which so much is known: in each place others that are as likely, so that a plan for gauges that nobody
    /// has calibrated does not rely on their being what they were meant to be.
    pub fn new(rig: &Rig, gauges: &[GaugeState], dynamics: &mut Dynamics, seed: u64) -> Self {
        // Not the candidates' own poses: a plan must not be judged only where it looks.
        let poses = spread_poses(rig, POSES, seed.wrapping_add(0x5EED));
        let roots: Vec<Matrix6<f64>> = gauges.iter().map(GaugeState::compliance_root).collect();
        let mut rng = StdRng::seed_from_u64(seed);
        let mut places: Vec<Place> = poses
            .iter()
            .enumerate()
            .map(|(k, pose)| {
                dynamics.update_static(pose);
                let rows = gauges.iter().zip(&roots).enumerate().map(|(gauge, (state, root))| {
                    let drawn =
                        state.compliance + root * Vector6::from_fn(|_, _| StandardNormal.sample(&mut rng));
                    let row = dynamics.row_to_tip(gauge, &unscaled(&drawn));
                    Vector6::from_fn(|c, _| if c < 3 { row[c] } else { row[c] * CHARACTERISTIC_LENGTH_M })
                });
                let rows = rows.collect();
                Place { rows, regressors: loaded(dynamics, &TipWrench::from_vector(&push(k))) }
            })
            .collect();
        let mut gls = Gls::new(gauges.len());
        let noise = |place: &Place, gls: &mut Gls| {
            covariance(place, gls, |k| gauges[k].noise_counts2).map_or(f64::INFINITY, |c| c.trace())
        };
        places.sort_by_cached_key(|place| ordered(noise(place, &mut gls)));
        places.truncate(KEPT);
        Self { places }
    }

    /// How well the wrench is known with gauges known so well.
    pub fn accuracy(&self, gauges: &[GaugeState]) -> Accuracy {
        self.judge(gauges, |place, k| gauges[k].variance(&place.regressors[k]))
    }

    /// How well the wrench would be known with perfectly calibrated gauges.
    pub fn noise_alone(&self, gauges: &[GaugeState]) -> Accuracy {
        self.judge(gauges, |_, _| 0.0)
    }

    fn judge(&self, gauges: &[GaugeState], calibration: impl Fn(&Place, usize) -> f64) -> Accuracy {
        let mut gls = Gls::new(gauges.len());
        let mut worst = [0.0f64; 4];
        let mut sum = 0.0;
        for place in &self.places {
            let variance = |k: usize| gauges[k].noise_counts2 + calibration(place, k);
            let found = covariance(place, &mut gls, variance);
            let mut part = Vector6::zeros();
            for (k, row) in place.rows.iter().enumerate() {
                let column = found.map_or(Vector6::zeros(), |c| c * row / variance(k));
                part += column.component_mul(&column) * calibration(place, k);
            }
            let whole = found.map_or(Vector6::repeat(f64::INFINITY), |c| c.diagonal());
            let largest = [
                whole.fixed_rows::<3>(0),
                whole.fixed_rows::<3>(3),
                part.fixed_rows::<3>(0),
                part.fixed_rows::<3>(3),
            ];
            for (worst, rows) in worst.iter_mut().zip(largest) {
                *worst = worst.max(rows.max());
            }
            sum += part.fixed_rows::<3>(0).sum() / 3.0;
        }
        let [force, torque, by_force, by_torque] = worst.map(f64::sqrt);
        Accuracy {
            force_sigma_n: force,
            torque_sigma_nm: torque * CHARACTERISTIC_LENGTH_M,
            calibration_force_sigma_n: by_force,
            calibration_torque_sigma_nm: by_torque * CHARACTERISTIC_LENGTH_M,
            calibration_force_rms_n: (sum / self.places.len().max(1) as f64).sqrt(),
        }
    }

    /// What the criterion's derivative weighs each gauge's covariance with.
    pub(super) fn weighing(&self, gauges: &[GaugeState]) -> Vec<SMatrix<f64, 7, 7>> {
        let mut out = vec![SMatrix::zeros(); gauges.len()];
        let mut gls = Gls::new(gauges.len());
        for place in &self.places {
            let variance = |k: usize| gauges[k].noise_counts2 + gauges[k].variance(&place.regressors[k]);
            let Some(found) = covariance(place, &mut gls, variance) else { continue };
            // The derivative of the trace by a reading's variance is the square of its column of the estimator.
            for (k, sum) in out.iter_mut().enumerate() {
                let x = &place.regressors[k];
                *sum += x * x.transpose() * (found * place.rows[k] / variance(k)).norm_squared();
            }
        }
        out
    }
}

/// What the environment applies in the k-th place.
fn push(k: usize) -> Vector6<f64> {
    let sign = if (k / 3).is_multiple_of(2) { 1.0 } else { -1.0 };
    let mut wrench = Vector6::zeros();
    wrench[k % 3] = sign * FORCE_N;
    wrench[3 + (k + 1) % 3] = sign * MOMENT_NM;
    wrench
}

/// Covariance of the wrench, moments over the characteristic length, N^2; none where the gauges do not determine it.
fn covariance(place: &Place, gls: &mut Gls, variance: impl Fn(usize) -> f64) -> Option<Matrix6<f64>> {
    gls.clear();
    for (k, row) in place.rows.iter().enumerate() {
        gls.push(row, 0.0, variance(k));
    }
    gls.solve(&[1.0; 6]).ok().map(|fit| fit.covariance)
}

/// A number that sorts as it is large; what is none comes last.
fn ordered(value: f64) -> u64 {
    // Bits of positive floats rise with them.
    if value >= 0.0 { value.to_bits() } else { u64::MAX }
}
