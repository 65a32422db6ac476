//! What a joint estimation found, as the stored model and the report have it.

use model::terms::MOST_TERMS;
use nalgebra::{DMatrix, DVector, SMatrix, SymmetricEigen, Vector6};
use rig::Rig;
use rig::model_file::{Arm, ArmDeviation, ArmJoint, MOST_DEVIATIONS, SensorTerm};

use super::parameters::Group;
use super::{COMPLIANCE, Joint, LENGTH_M};
use crate::gauges::Gauge;
use crate::noise::NoiseModel;
use crate::solve::unscaled;

/// Directions of uncertainty that matter less than this share of the largest are left to each gauge by itself.
const NEGLIGIBLE: f64 = 1e-3;

/// A correction with its standard deviation, for the report; null where the recordings do not tell it from others.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Correction {
    /// The value, in the unit that its name ends with.
    pub value: Option<f64>,
    /// Its standard deviation.
    pub sigma: Option<f64>,
}

impl Joint {
    /// What is left of each gauge's readings as a mean over each held pose, counts: `[gauge][window]`.
    pub fn left_counts(&self, windows: usize) -> Vec<Vec<Option<f64>>> {
        let of_gauge = |gauge: usize| {
            let mut sums = vec![(0.0, 0.0); windows];
            let index = &self.system.gauges[gauge].index;
            for (residual, k) in self.system.residuals(gauge, &self.solution).iter().zip(index) {
                let row = &self.rows[*k];
                let n = row.readings[gauge].map_or(0.0, |reading| reading.n as f64);
                let (sum, count) = &mut sums[row.pose];
                *sum += n * residual;
                *count += n;
            }
            sums.into_iter().map(|(sum, n)| (n > 0.0).then(|| sum / n)).collect()
        };
        (0..self.system.gauges.len()).map(of_gauge).collect()
    }

    /// Admitted corrections by name.
    pub fn corrections(&self) -> Vec<(String, Correction)> {
        let free = self.solution.arm_free.iter().enumerate();
        free.map(|(k, index)| {
            let sigma = self.solution.arm_covariance[(k, k)].sqrt();
            let told = |number: f64| self.is_told(k).then_some(number);
            let correction = Correction { value: told(self.solution.arm[*index]), sigma: told(sigma) };
            (self.parameters.list[*index].name.clone(), correction)
        })
        .collect()
    }

    /// What was admitted, one line for a person.
    pub fn summary(&self, names: &[&str]) -> Vec<String> {
        let arm: Vec<&str> = self.admitted.arm.iter().map(|group| group.name()).collect();
        let gauges = names.iter().zip(&self.admitted.gauges).filter(|(_, families)| !families.is_empty());
        let gauges: Vec<String> = gauges
            .map(|(name, families)| {
                let families: Vec<&str> = families.iter().map(|f| f.name()).collect();
                format!("{name}: {}", families.join(", "))
            })
            .collect();
        let mut out = Vec::new();
        if !arm.is_empty() {
            out.push(format!(
                "corrected beside the gauges, since held-out poses were better for it: {}",
                arm.join(", ")
            ));
        }
        if !gauges.is_empty() {
            out.push(format!("compensated since held-out poses were better for it: {}", gauges.join("; ")));
        }
        out
    }

    /// `[arm]` of the model; `None` where only gauges have something beyond their compliance.
    pub fn arm(&self, rig: &Rig) -> Option<Arm> {
        if self.solution.arm_free.is_empty() {
            return None;
        }
        let values = self.parameters.setup(&self.solution.arm).arm;
        let mut squares = (vec![[0.0; model::arm::JOINT_NUMBERS]; rig.chain.joints.len()], [0.0; 3]);
        let root = &self.solution.arm_covariance;
        let factor = square_root(root);
        for column in factor.column_iter() {
            let apart = self.correction_along(&column.into_owned());
            for (sum, joint) in squares.0.iter_mut().zip(&apart.joints) {
                sum.iter_mut().zip(joint.array()).for_each(|(sum, value)| *sum += value * value);
            }
            squares.1.iter_mut().zip(apart.gravity_turn_rad).for_each(|(sum, value)| *sum += value * value);
        }
        let joint = |(k, entry): (usize, &model::chain::Joint)| {
            let sigma = model::arm::JointCorrection::from_array(&squares.0[k].map(f64::sqrt));
            ArmJoint::new(&entry.name, &values.joints[k], &sigma)
        };
        Some(Arm {
            admitted: self.admitted.arm.iter().map(|group| group.name().to_owned()).collect(),
            gravity_turn_rad: values.gravity_turn_rad,
            gravity_turn_sigma_rad: squares.1.map(f64::sqrt),
            joints: rig.chain.joints.iter().enumerate().map(joint).collect(),
            deviations: self.deviations(&factor),
        })
    }

    /// The correction along a change of the arm's free numbers.
    fn correction_along(&self, change: &DVector<f64>) -> model::arm::ArmCorrection {
        let mut values = vec![0.0; self.parameters.list.len()];
        self.solution.arm_free.iter().zip(change.iter()).for_each(|(index, value)| values[*index] = *value);
        self.parameters.setup(&values).arm
    }

    /// The directions of the arm's uncertainty that move the predictions most, gauges following as the data make them.
    fn deviations(&self, factor: &DMatrix<f64>) -> Vec<ArmDeviation> {
        let m = factor.ncols();
        let mut gram = DMatrix::<f64>::zeros(m, m);
        for gauge in 0..self.noise.len() {
            let moved = self.moved(gauge) * factor / self.noise[gauge].sigma_counts();
            gram += moved.tr_mul(&moved);
        }
        let eigen = SymmetricEigen::new(gram);
        let mut order: Vec<usize> = (0..m).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let largest = order.first().map_or(0.0, |k| eigen.eigenvalues[*k]);
        let kept = order.into_iter().filter(|k| eigen.eigenvalues[*k] > NEGLIGIBLE * largest);
        kept.take(MOST_DEVIATIONS)
            .map(|k| {
                let change = factor * eigen.eigenvectors.column(k);
                let arm = self.correction_along(&change);
                ArmDeviation {
                    gravity_turn_rad: arm.gravity_turn_rad,
                    joints: arm.joints.iter().map(model::arm::JointCorrection::array).collect(),
                    gauges: (0..self.noise.len()).map(|gauge| self.followed(gauge, &change)).collect(),
                }
            })
            .collect()
    }

    /// Change of a gauge's predictions with the arm's free numbers, the gauge's own following: one row a row.
    fn moved(&self, gauge: usize) -> DMatrix<f64> {
        let (free, _, response) = &self.solution.conditional[gauge];
        let (rows, n) = (&self.system.gauges[gauge], self.system.columns());
        let at = |k: usize, column: usize| rows.a[k * n + column];
        let own = DMatrix::from_fn(rows.z.len(), free.len(), |k, j| at(k, free[j]));
        // Weights and reference are no part of the arm that is used later: their errors stay in the gauges.
        let stays =
            |index: usize| !matches!(self.parameters.list[index].group, Group::Weights | Group::Reference);
        let arm = DMatrix::from_fn(rows.z.len(), self.solution.arm_free.len(), |k, j| {
            let index = self.solution.arm_free[j];
            if stays(index) { at(k, self.system.own + index) } else { 0.0 }
        });
        arm + own * response
    }

    /// A gauge's stored numbers' change with a change of the arm's free numbers.
    fn followed(&self, gauge: usize, change: &DVector<f64>) -> Vec<f64> {
        let (free, _, response) = &self.solution.conditional[gauge];
        let mut own = vec![0.0; self.system.own];
        free.iter().zip((response * change).iter()).for_each(|(index, value)| own[*index] = *value);
        self.stored(gauge).iter().map(|(index, unit)| own[*index] * unit).collect()
    }

    /// Which own numbers a gauge's stored ones are, and their unit in terms of the own ones': compliance, bias, terms.
    fn stored(&self, gauge: usize) -> Vec<(usize, f64)> {
        let session = self.session(gauge);
        let compliance = (0..COMPLIANCE).map(|k| (k, if k < 3 { 1.0 } else { LENGTH_M.recip() }));
        let bias = std::iter::once((COMPLIANCE + session, 1.0));
        let terms = self.terms_of(gauge).map(|k| (COMPLIANCE + self.sessions + k, 1.0));
        compliance.chain(bias).chain(terms).collect()
    }

    /// The last session that has readings of a gauge.
    fn session(&self, gauge: usize) -> usize {
        let seen = self.rows.iter().filter(|row| row.readings[gauge].is_some()).map(|row| row.session);
        seen.max().unwrap_or(0)
    }

    /// Candidates that were admitted for a gauge.
    fn terms_of(&self, gauge: usize) -> impl Iterator<Item = usize> + '_ {
        let families = &self.admitted.gauges[gauge];
        (0..MOST_TERMS).filter(|k| families.iter().any(|family| family.range().contains(k)))
    }

    /// Brings a gauge's estimate up to date.
    pub fn apply(&self, index: usize, gauge: &mut Gauge) {
        let own = &self.solution.own[index];
        let covariance = self.stored_covariance(index);
        gauge.compliance = unscaled(&Vector6::from_column_slice(&own[..COMPLIANCE]));
        gauge.bias_counts = own[COMPLIANCE + self.session(index)];
        gauge.covariance = SMatrix::from_fn(|i, k| covariance[(i, k)]);
        gauge.seen_covariance = gauge.seen_part(&gauge.covariance);
        gauge.noise = self.noise_with_misfit(index);
        gauge.residual_rms_counts = self.residual_rms(index);
    }

    /// Covariance of a gauge's stored numbers, all of the arm's uncertainty included.
    fn stored_covariance(&self, gauge: usize) -> DMatrix<f64> {
        let doubts = self.doubts[gauge].iter().map(|own| self.squared(gauge, own));
        let known = self.of_stored(gauge, &self.solution.marginal(gauge)) + self.by_lag(gauge);
        doubts.fold(known, |sum, doubt| sum + doubt)
    }

    /// What the lag between thermometer and gauge adds to the covariance of the stored numbers.
    fn by_lag(&self, gauge: usize) -> DMatrix<f64> {
        self.squared(gauge, &self.lags.gauges[gauge].own)
    }

    /// Covariance of the stored numbers where the own ones are off by one standard deviation along a direction.
    fn squared(&self, gauge: usize, own: &[f64]) -> DMatrix<f64> {
        let stored = self.stored(gauge);
        let part =
            DVector::from_iterator(stored.len(), stored.iter().map(|(index, unit)| own[*index] * unit));
        &part * part.transpose()
    }

    /// The covariance that the cycle weighs a gauge with: given the arm, and along the arm's deviations. Directions in which
    /// arm and gauges move together without moving any prediction are no uncertainty of a gauge by itself.
    pub fn working_covariance(&self, gauge: usize, deviations: &[ArmDeviation]) -> DMatrix<f64> {
        let mut covariance = self.of_stored(gauge, &self.solution.conditional[gauge].1) + self.by_lag(gauge);
        for deviation in deviations {
            let part = DVector::from_column_slice(&deviation.gauges[gauge]);
            covariance += &part * part.transpose();
        }
        covariance
    }

    /// A matrix over a gauge's free numbers as one over its stored ones.
    fn of_stored(&self, gauge: usize, matrix: &DMatrix<f64>) -> DMatrix<f64> {
        let free = &self.solution.conditional[gauge].0;
        let stored = self.stored(gauge);
        let place = |own: usize| free.iter().position(|f| *f == own);
        let value = |i: usize, k: usize| match (place(stored[i].0), place(stored[k].0)) {
            (Some(a), Some(b)) => matrix[(a, b)] * stored[i].1 * stored[k].1,
            _ => 0.0,
        };
        let covariance = DMatrix::from_fn(stored.len(), stored.len(), value);
        (&covariance + covariance.transpose()) * 0.5
    }

    /// The gauge's noise with what does not fit as part of what is slow.
    fn noise_with_misfit(&self, gauge: usize) -> NoiseModel {
        let (noise, misfit) = (self.noise[gauge], self.system.gauges[gauge].misfit);
        NoiseModel { slow_counts2: noise.slow_counts2 + misfit, ..noise }
    }

    fn residual_rms(&self, gauge: usize) -> f64 {
        let residuals = self.system.residuals(gauge, &self.solution);
        let rows = &self.system.gauges[gauge];
        let beyond = |(r, (noise, _)): (&f64, &(f64, f64))| r * r - noise;
        let misfit = residuals.iter().zip(&rows.variance).map(beyond).sum::<f64>() / residuals.len() as f64;
        (self.noise[gauge].sigma_counts().powi(2) + misfit.max(0.0)).sqrt()
    }

    /// Middle, scale and terms of a gauge as the model stores them.
    pub fn terms(&self, gauge: usize, working: &DMatrix<f64>) -> (f64, f64, Vec<SensorTerm>) {
        let (effects, values, (centre, scale)) = &self.effects[gauge];
        let covariance = self.stored_covariance(gauge);
        let term = |(position, slot): (usize, usize)| {
            let row = 7 + position;
            SensorTerm {
                effect: effects[slot].into(),
                coefficient_counts: self.solution.own[gauge][COMPLIANCE + self.sessions + slot],
                coefficient_sigma_counts: covariance[(row, row)].max(0.0).sqrt(),
                start_sigma: values.start_sigma[slot],
                covariance: (0..=row).map(|k| working[(row, k)]).collect(),
            }
        };
        let terms: Vec<SensorTerm> = self.terms_of(gauge).enumerate().map(term).collect();
        if terms.is_empty() { (0.0, 0.0, terms) } else { (*centre, *scale, terms) }
    }
}

/// A matrix whose square is a covariance.
fn square_root(covariance: &DMatrix<f64>) -> DMatrix<f64> {
    let scale = covariance.diagonal().map(|v| v.max(f64::MIN_POSITIVE).sqrt());
    let n = covariance.nrows();
    let correlation = DMatrix::from_fn(n, n, |i, k| covariance[(i, k)] / (scale[i] * scale[k]));
    let eigen = SymmetricEigen::new(correlation);
    DMatrix::from_fn(n, n, |i, k| {
        scale[i] * eigen.eigenvectors[(i, k)] * eigen.eigenvalues[k].max(0.0).sqrt()
    })
}
