//! What the model itself is uncertain of: a model calibrated on the same arm is not the arm, and that is no effect.

use model::dynamics::Dynamics;
use model::estimator::{Deviation, GaugeModel};
use model::spatial::Wrench;
use nalgebra::{DMatrix, DVector};
use rig::Rig;

use super::Table;
use super::predict::Prediction;
use crate::session::Doubt;

/// Directions whose standard deviation changes no gauge by more than this share of its noise are left out.
const NEGLIGIBLE: f64 = 0.005;

/// One standard deviation along every direction in which gauges, and arm and gauges together, are uncertain.
pub(super) fn doubts(rig: &Rig, table: &Table, prediction: &Prediction) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    for (index, gauge) in prediction.gauges.iter().enumerate() {
        doubts.extend(of_gauge(index, gauge, prediction));
    }
    for deviation in &prediction.arm.deviations {
        doubts.push(of_arm(rig, deviation, table, prediction));
    }
    doubts
}

/// Numbers of a gauge that were estimated: compliance, bias, terms.
fn numbers(gauge: &GaugeModel) -> usize {
    7 + gauge.terms.terms.len()
}

/// What each of a gauge's numbers is multiplied by at a row: load, one, the terms' values.
fn excitation(index: usize, row: usize, prediction: &Prediction) -> impl Fn(usize) -> f64 + '_ {
    let load = prediction.loads[index][row];
    move |k| match k {
        0..6 => load[k],
        6 => 1.0,
        _ => prediction.regressors[index].get(row).map_or(0.0, |values| values[k - 7]),
    }
}

fn of_gauge(index: usize, gauge: &GaugeModel, prediction: &Prediction) -> Vec<Doubt> {
    let n = numbers(gauge);
    let covariance = DMatrix::from_fn(n, n, |r, c| gauge.covariance[(r, c)]);
    // In units of the standard deviations: the numbers differ by many decades.
    let sigma: Vec<f64> = (0..n).map(|k| covariance[(k, k)].max(0.0).sqrt()).collect();
    let inverse = |k: usize| if sigma[k] > 0.0 { sigma[k].recip() } else { 0.0 };
    let correlation = DMatrix::from_fn(n, n, |r, c| covariance[(r, c)] * inverse(r) * inverse(c));
    let eigen = correlation.symmetric_eigen();
    let rows = prediction.signals[index].len();
    let mut doubts = Vec::new();
    for (value, vector) in eigen.eigenvalues.iter().zip(eigen.eigenvectors.column_iter()) {
        let direction = DVector::from_fn(n, |k, _| vector[k] * value.max(0.0).sqrt() * sigma[k]);
        let change = |row: usize| {
            let excitation = excitation(index, row, prediction);
            (0..n).map(|k| direction[k] * excitation(k)).sum::<f64>()
        };
        let values: Vec<f64> = (0..rows).map(change).collect();
        if crate::session::rms(&values) > NEGLIGIBLE * gauge.noise_counts2.sqrt() {
            doubts.push(Doubt { parts: vec![(index, values)] });
        }
    }
    doubts
}

/// The arm one standard deviation away, at rest in the poses of the motion.
fn of_arm(rig: &Rig, deviation: &Deviation, table: &Table, prediction: &Prediction) -> Doubt {
    let mut here = Dynamics::new(&prediction.chain, &rig.sections);
    let mut there = Dynamics::new(&deviation.chain, &rig.sections);
    let mut parts: Vec<(usize, Vec<f64>)> =
        (0..prediction.gauges.len()).map(|index| (index, Vec::with_capacity(table.time_s.len()))).collect();
    for (rows, body) in &prediction.carried {
        here.set_payload(body);
        there.set_payload(body);
        for row in rows.clone() {
            let mut positions: Vec<f64> = table.motion.iter().map(|columns| columns[0][row]).collect();
            here.update_static(&positions);
            for (k, position) in positions.iter_mut().enumerate() {
                let more = deviation.flexibility_rad_per_nm.get(k).copied().unwrap_or(0.0);
                *position += more * here.joint_torque_nm(k, &Wrench::zero());
            }
            there.update_static(&positions);
            for (index, values) in &mut parts {
                let gauge = &prediction.gauges[*index];
                let by_arm = gauge.compliance.dot(&(there.load(*index) - here.load(*index)));
                let excitation = excitation(*index, row, prediction);
                let own = deviation.gauges.get(*index);
                let own = own.map_or(0.0, |n| (0..numbers(gauge)).map(|k| n[k] * excitation(k)).sum());
                values.push(by_arm + own);
            }
        }
    }
    Doubt { parts }
}
