//! Four gauges at a time: their rows to the tip, and the variance that their calibration leaves them under a load.

use nalgebra::{Vector3, Vector6};
use wide::f64x4;

use super::{Excitation, GAUGE_NUMBERS, GaugeCovariance, GaugeModel, Zero};
use crate::dynamics::Dynamics;
use crate::lanes::{Rows, Triple};
use crate::spatial::{Tip, Wrench, join};
use crate::terms::MOST_TERMS;

/// Gauges of a group.
pub(super) const FOUR: usize = 4;

/// Numbers of a gauge without terms: six sensitivities and the bias.
const FEW: usize = 7;

/// Up to four gauges in the state of the arm.
#[derive(Clone, Debug)]
pub(super) struct Four {
    /// Sensitivity to force (counts/N) and moment (counts/Nm), in S.
    compliance: [Triple<f64x4>; 2],
    /// Columns of the upper triangles of the first numbers' covariances, what is beside the diagonal doubled.
    form: [[f64x4; FEW]; FEW],
    /// Excitation under which their zeros were found: errors show only in what differs from it.
    found_at: [f64x4; FEW],
    /// E's axes in S, row by row, and E's origin seen from S (m).
    rotation: Rows<f64x4>,
    origin_m: Triple<f64x4>,
    /// Load of the arm itself about S's origin, in S.
    force_n: Triple<f64x4>,
    moment_nm: Triple<f64x4>,
    /// Factors of a tip wrench's force and moment in their readings: counts/N, counts/Nm.
    rows: [Triple<f64x4>; 2],
    /// What the arm's own load makes, counts.
    own_counts: f64x4,
}

impl Four {
    pub(super) fn new(gauges: &[GaugeModel]) -> Self {
        let zero = Triple::all(&Vector3::zeros());
        let lanes = |of: &dyn Fn(&GaugeModel) -> f64| {
            f64x4::new(std::array::from_fn(|lane| gauges.get(lane).map_or(0.0, of)))
        };
        let triple = |from: usize| Triple {
            x: lanes(&|gauge| gauge.compliance[from]),
            y: lanes(&|gauge| gauge.compliance[from + 1]),
            z: lanes(&|gauge| gauge.compliance[from + 2]),
        };
        Self {
            compliance: [triple(0), triple(3)],
            form: std::array::from_fn(|k| {
                std::array::from_fn(|i| lanes(&|gauge| doubled(&gauge.covariance, i, k)))
            }),
            found_at: [f64x4::ZERO; FEW],
            rotation: Rows([zero; 3]),
            origin_m: zero,
            force_n: zero,
            moment_nm: zero,
            rows: [zero; 2],
            own_counts: f64x4::ZERO,
        }
    }

    pub(super) fn set_zero(&mut self, lane: usize, zero: &Zero) {
        for (k, found_at) in self.found_at.iter_mut().enumerate() {
            // A bias that was found again is not uncertain: all of its excitation goes.
            let of = |excitation: Excitation| if k + 1 < FEW { excitation[k] } else { 1.0 };
            found_at.as_mut_array()[lane] = zero.found_at.map_or(0.0, of);
        }
    }

    /// Takes in the state of the arm; the first gauge sits in this section, the others in those that follow.
    pub(super) fn look(&mut self, dynamics: &Dynamics, first: usize) {
        let section = |lane: usize| dynamics.section((first + lane).min(dynamics.sections() - 1));
        self.rotation = Rows::gather(|lane| &section(lane).0.rotation);
        self.origin_m = Triple::gather(|lane| &section(lane).0.translation_m);
        self.force_n = Triple::gather(|lane| section(lane).1);
        self.moment_nm = Triple::gather(|lane| section(lane).2);
        let [force, moment] = &self.compliance;
        let at_tip = *force + moment.cross(&self.origin_m);
        self.rows = [self.rotation.transposed_times(&at_tip), self.rotation.transposed_times(moment)];
        self.own_counts = force.dot(&self.force_n) + moment.dot(&self.moment_nm);
    }

    /// A gauge's row to the tip (counts/N, counts/Nm) and what the arm's own load makes of it, counts.
    #[inline]
    pub(super) fn row(&self, lane: usize) -> (Vector6<f64>, f64) {
        let [force, moment] = self.rows.map(|row| row.at(lane));
        (join(&force, &moment), self.own_counts.as_array()[lane])
    }

    /// Variances that the calibrations' uncertainty gives under the arm's load and a tip wrench, counts^2; without the gauges' terms.
    #[inline]
    pub(super) fn variances(&self, wrench: &Wrench<Tip>) -> f64x4 {
        let force = self.rotation.times(&Triple::all(&wrench.force_n));
        let moment = self.rotation.times(&Triple::all(&wrench.moment_nm)) + self.origin_m.cross(&force);
        let (force, moment) = (self.force_n + force, self.moment_nm + moment);
        let mut excited = [force.x, force.y, force.z, moment.x, moment.y, moment.z, f64x4::ONE];
        (0..FEW).for_each(|k| excited[k] -= self.found_at[k]);
        let mut sum = f64x4::ZERO;
        for k in 0..FEW {
            let mut product = self.form[k][0] * excited[0];
            (1..=k).for_each(|i| product += self.form[k][i] * excited[i]);
            sum += product * excited[k];
        }
        sum
    }
}

/// What a gauge's terms add to its variance, as columns of the upper triangle of its covariance, what is beside the diagonal doubled.
#[derive(Clone, Debug)]
pub(super) struct TermsForm(Vec<[f64; GAUGE_NUMBERS]>);

impl TermsForm {
    pub(super) fn new(gauge: &GaugeModel) -> Self {
        let numbers = FEW + gauge.terms.terms.len().min(MOST_TERMS);
        let column = |k: usize| std::array::from_fn(|i| doubled(&gauge.covariance, i, k));
        Self((FEW..numbers).map(column).collect())
    }

    /// Whether there are no terms.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Under this excitation, counts^2.
    pub(super) fn of(&self, excitation: &Excitation) -> f64 {
        let column = |(k, column): (usize, &[f64; GAUGE_NUMBERS])| {
            let products = column.iter().zip(excitation.iter()).take(k + 1);
            excitation[k] * products.map(|(value, other)| value * other).sum::<f64>()
        };
        (FEW..).zip(&self.0).map(column).sum()
    }
}

/// An element of the upper triangle, doubled beside the diagonal.
fn doubled(covariance: &GaugeCovariance, i: usize, k: usize) -> f64 {
    match i.cmp(&k) {
        std::cmp::Ordering::Less => 2.0 * covariance[(i, k)],
        std::cmp::Ordering::Equal => covariance[(i, k)],
        std::cmp::Ordering::Greater => 0.0,
    }
}
