//! What gauges beyond six say of each other: how a fault of any one of them would show, and what it would do to the wrench.
//!
//! With `y = A x + e`, `cov(e) = V` and the solution `x = K y`, what is left is `r = S y` with `S = 1 - A K`, and everything that the spare
//! rows can say is in `w = Q y` with `Q = V^-1 S` (symmetric, of rank `n - 6`). A fault of `b` counts in row i alone adds `Q e_i b` to `w`: a line in
//! the space of `n - 6` dimensions that the spare rows span. So, in the metric in which the noise is a unit sphere,
//!
//! ```text
//! length of the signature of one count    g_i = sqrt(Q_ii)
//! best guess of the fault                 b_i = w_i / Q_ii, of deviation 1 / g_i
//! part of the residual along the line     w_i / g_i
//! part beside it, squared                 r' Q r - w_i^2 / Q_ii: what is left when row i is left out
//! change of the wrench per count          K e_i
//! ```
//!
//! (J. Sturza, Navigation system integrity monitoring using redundant measurements, Navigation 35(4), 1988.) With two spare rows the lines lie
//! in a plane, with one they are all the same, with none nothing shows. A row whose line has no length cannot be checked by the others.

use wide::f64x4;

use super::covariance;
use super::triangle::Row;

/// A row of which less than this share of its variance is left in the residual cannot be checked: rounding alone would show.
const CHECKABLE_SHARE: f64 = 1e-9;

/// Signatures of single faults at one instant. Allocates at construction only.
#[derive(Clone, Debug)]
pub struct Redundancy {
    rows: Vec<[f64; 6]>,
    residual_counts: Vec<f64>,
    /// `w`, 1/counts.
    dual: Vec<f64x4>,
    /// `Q`, row by row, four columns at a time, 1/counts^2.
    q: Vec<f64x4>,
    /// Columns of `K`: N/count, Nm/count.
    gains: Vec<[f64; 6]>,
    chi2: f64,
    /// `L^-1`, laid out as `Q`.
    inverse_factor: Vec<f64x4>,
    /// Fours of columns of a row.
    fours: usize,
}

impl Redundancy {
    /// For up to so many rows.
    pub fn new(capacity: usize) -> Self {
        let (capacity, fours) = covariance::room(capacity);
        let matrix = |rows: usize| vec![f64x4::ZERO; rows * fours];
        Self {
            rows: Vec::with_capacity(capacity),
            residual_counts: Vec::with_capacity(capacity),
            dual: matrix(1),
            q: matrix(capacity),
            gains: Vec::with_capacity(capacity),
            chi2: 0.0,
            inverse_factor: matrix(capacity),
            fours,
        }
    }

    pub(super) fn clear(&mut self) {
        self.rows.clear();
        self.residual_counts.clear();
        self.gains.clear();
        self.chi2 = 0.0;
    }

    pub(super) fn push(&mut self, row: [f64; 6], residual_counts: f64) {
        self.rows.push(row);
        self.residual_counts.push(residual_counts);
    }

    /// Rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Spare rows: dimensions in which faults show.
    #[inline]
    pub fn spare(&self) -> usize {
        self.rows.len().saturating_sub(6)
    }

    /// Length of the residual squared, standard deviations squared.
    #[inline]
    pub fn chi2(&self) -> f64 {
        self.chi2
    }

    /// What is left of a row's value, counts.
    #[inline]
    pub fn residual_counts(&self, row: usize) -> f64 {
        self.residual_counts[row]
    }

    /// Standard deviation of the guess of a fault in a row, counts; `None` where none would show.
    #[inline]
    pub fn fault_sigma_counts(&self, row: usize) -> Option<f64> {
        let q = self.q(row, row);
        (q > 0.0).then(|| q.sqrt().recip())
    }

    /// The guess of a fault in a row if it is the only one, counts; 0 where none would show.
    #[inline]
    pub fn fault_counts(&self, row: usize) -> f64 {
        let q = self.q(row, row);
        if q > 0.0 { at(&self.dual, row) / q } else { 0.0 }
    }

    /// Part of the residual along the line of a row's signature, standard deviations.
    #[inline]
    pub fn along(&self, row: usize) -> f64 {
        self.fault_sigma_counts(row).map_or(0.0, |sigma_counts| at(&self.dual, row) * sigma_counts)
    }

    /// Part of the residual beside that line, squared, standard deviations squared.
    #[inline]
    pub fn beside2(&self, row: usize) -> f64 {
        (self.chi2 - self.along(row).powi(2)).max(0.0)
    }

    /// The same two parts for any residual of these rows (counts): (along the line of `row`, beside it squared).
    pub fn parts(&self, residual_counts: &[f64], row: usize) -> (f64, f64) {
        let mut length2 = 0.0;
        let mut along = 0.0;
        for (i, residual) in residual_counts.iter().enumerate() {
            let dual: f64 = residual_counts.iter().enumerate().map(|(k, other)| self.q(i, k) * other).sum();
            length2 += residual * dual;
            if i == row {
                along = self.fault_sigma_counts(row).map_or(0.0, |sigma_counts| dual * sigma_counts);
            }
        }
        (along, (length2 - along * along).max(0.0))
    }

    /// What one count more in a row adds to what is left of another.
    #[inline]
    pub fn signature(&self, row: usize, of_fault_in: usize) -> f64 {
        let own = if row == of_fault_in { 1.0 } else { 0.0 };
        own - self.rows[row].iter().zip(&self.gains[of_fault_in]).map(|(a, k)| a * k).sum::<f64>()
    }

    /// What one count more in a row adds to the wrench: N, Nm about E's origin, in E.
    #[inline]
    pub fn gain(&self, row: usize) -> &[f64; 6] {
        &self.gains[row]
    }

    fn q(&self, i: usize, k: usize) -> f64 {
        at(&self.q[i * self.fours..], k)
    }

    /// From the Cholesky factor `L` of V (row, column), `L^-1 A D` (D scales the columns) and the inverse of its triangle.
    pub(super) fn weigh(
        &mut self,
        factor: impl Fn(usize, usize) -> f64,
        whitened: &[Row],
        inverse: &[Row; 6],
        column_scale: &[f64; 6],
    ) -> bool {
        match self.fours {
            2 => self.find::<2>(factor, whitened, inverse, column_scale),
            4 => self.find::<4>(factor, whitened, inverse, column_scale),
            16 => self.find::<16>(factor, whitened, inverse, column_scale),
            _ => self.find::<{ covariance::MOST_FOURS }>(factor, whitened, inverse, column_scale),
        }
        self.chi2.is_finite()
    }

    /// The same where a row is so many fours.
    fn find<const FOURS: usize>(
        &mut self,
        factor: impl Fn(usize, usize) -> f64,
        whitened: &[Row],
        inverse: &[Row; 6],
        column_scale: &[f64; 6],
    ) {
        let n = self.rows.len();
        let [inverse_factor, q] =
            [&mut self.inverse_factor, &mut self.q].map(|m| &mut m.as_chunks_mut().0[..n]);
        invert::<FOURS>(inverse_factor, &factor);
        let lead = lead(whitened, inverse, inverse_factor);
        // K e_i = D R^-1 U' L^-1 e_i.
        let column = |k: usize| Row::new(&std::array::from_fn(|c| column_scale[c] * inverse[c].at(k)), 0.0);
        let columns: [Row; 6] = std::array::from_fn(column);
        self.gains.extend((0..n).map(|i| {
            let mut gain = Row::default();
            columns.iter().zip(&lead).for_each(|(column, lead)| gain.add(at(lead, i), column));
            gain.factors()
        }));
        for (i, q) in q.iter_mut().enumerate() {
            *q = q_row(i, inverse_factor, &lead);
            let variance: f64 = (0..=i).map(|m| factor(i, m).powi(2)).sum();
            let own = &mut q[i / 4].as_mut_array()[i % 4];
            if n <= 6 || *own * variance < CHECKABLE_SHARE {
                *own = 0.0;
            }
        }
        let mut dual = [f64x4::ZERO; FOURS];
        self.residual_counts.iter().zip(&*q).for_each(|(residual, q)| add(&mut dual, *residual, q));
        let length2 = |(i, residual): (usize, &f64)| residual * at(&dual, i);
        self.chi2 = self.residual_counts.iter().enumerate().map(length2).sum::<f64>().max(0.0);
        self.dual.copy_from_slice(&dual);
    }
}

/// `L^-1` by forward substitution.
fn invert<const FOURS: usize>(rows: &mut [[f64x4; FOURS]], factor: impl Fn(usize, usize) -> f64) {
    for i in 0..rows.len() {
        let mut own = [f64x4::ZERO; FOURS];
        rows[..i].iter().enumerate().for_each(|(m, row)| add(&mut own, -factor(i, m), row));
        let reciprocal = factor(i, i).recip();
        own.iter_mut().for_each(|four| *four *= f64x4::splat(reciprocal));
        own[i / 4].as_mut_array()[i % 4] = reciprocal;
        rows[i] = own;
    }
}

/// `U' L^-1`.
fn lead<const FOURS: usize>(
    whitened: &[Row],
    inverse: &[Row; 6],
    inverse_factor: &[[f64x4; FOURS]],
) -> [[f64x4; FOURS]; 6] {
    let mut all = [[f64x4::ZERO; FOURS]; 6];
    for (whitened, own) in whitened.iter().zip(inverse_factor) {
        let mut basis = Row::default();
        inverse.iter().enumerate().for_each(|(k, row)| basis.add(whitened.at(k), row));
        all.iter_mut().enumerate().for_each(|(c, lead)| add(lead, basis.at(c), own));
    }
    all
}

/// Row `i` of `Q = L^-T (1 - U U') L^-1`.
fn q_row<const FOURS: usize>(
    i: usize,
    inverse_factor: &[[f64x4; FOURS]],
    lead: &[[f64x4; FOURS]; 6],
) -> [f64x4; FOURS] {
    let mut row = [f64x4::ZERO; FOURS];
    // L^-1 is a lower triangle.
    inverse_factor[i..].iter().for_each(|own| add(&mut row, at(own, i), own));
    lead.iter().for_each(|lead| add(&mut row, -at(lead, i), lead));
    row
}

/// One number of a row of fours.
#[inline]
fn at(row: &[f64x4], column: usize) -> f64 {
    row[column / 4].as_array()[column % 4]
}

/// Adds a multiple of another row.
#[inline]
fn add<const FOURS: usize>(row: &mut [f64x4; FOURS], factor: f64, other: &[f64x4; FOURS]) {
    let factor = f64x4::splat(factor);
    row.iter_mut().zip(other).for_each(|(own, other)| *own += factor * *other);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimator::Gls;
    use nalgebra::{DMatrix, DVector, Vector6};
    use proptest::prelude::*;

    /// A problem of `n` rows with a full covariance, and the same as matrices.
    fn problem(values: &[f64], n: usize) -> (Gls, DMatrix<f64>, DMatrix<f64>, DVector<f64>) {
        let a = DMatrix::from_fn(n, 6, |i, k| values[i * 6 + k] + if i % 6 == k { 2.0 } else { 0.0 });
        let shared = DVector::from_fn(n, |i, _| values[60 + i]);
        let y = DVector::from_fn(n, |i, _| 10.0 * values[70 + i]);
        let mut gls = Gls::new(10);
        let mut v = &shared * shared.transpose();
        for k in 0..n {
            let variance = 0.1 + k as f64;
            gls.push(&Vector6::from_fn(|c, _| a[(k, c)]), y[k], variance);
            v[(k, k)] += variance;
        }
        let at = |k: usize| if k < n { shared[k] } else { 0.0 };
        let four = |four: usize| wide::f64x4::new(std::array::from_fn(|lane| at(4 * four + lane)));
        gls.share(&(0..gls.stride()).map(four).collect::<Vec<_>>());
        (gls, a, v, y)
    }

    proptest! {
        /// Truth by leaving the row out of the textbook's formula altogether.
        #[test]
        fn a_fault_is_what_leaving_its_row_out_says(values in prop::collection::vec(-1.0..1.0f64, 80), n in 7usize..=10, row in 0usize..7) {
            let (mut gls, a, v, y) = problem(&values, n);
            let fit = gls.solve(&[1.0, 1.0, 1.0, 10.0, 10.0, 10.0]).unwrap();
            let mut redundancy = Redundancy::new(10);
            prop_assert!(gls.redundancy(&fit.x, None, &mut redundancy));
            prop_assert!((redundancy.chi2() - fit.chi2).abs() < 1e-6 * (1.0 + fit.chi2));
            // An unknown of its own for the row takes it out.
            let mut wide = a.clone().insert_column(6, 0.0);
            wide[(row, 6)] = 1.0;
            let vi = v.try_inverse().unwrap();
            let normal = wide.transpose() * &vi * &wide;
            prop_assume!(normal.clone().svd(false, false).singular_values.min() > 1e-4);
            let covariance = normal.try_inverse().unwrap();
            let found = &covariance * wide.transpose() * &vi * &y;
            let left = &y - &wide * &found;
            let beside2 = (left.transpose() * &vi * &left)[(0, 0)];
            let close = |a: f64, b: f64| (a - b).abs() < 1e-5 * (1.0 + b.abs());
            prop_assert!(close(redundancy.fault_counts(row), found[6]));
            prop_assert!(close(redundancy.fault_sigma_counts(row).unwrap(), covariance[(6, 6)].sqrt()));
            prop_assert!(close(redundancy.beside2(row), beside2));
            for c in 0..6 {
                // The wrench with the row less the wrench without it.
                prop_assert!(close(redundancy.gain(row)[c] * found[6], fit.x[c] - found[c]));
            }
            let residuals: Vec<f64> = (0..n).map(|k| redundancy.residual_counts(k)).collect();
            for k in 0..n {
                prop_assert!(close(residuals[k] - redundancy.signature(k, row) * found[6], left[k]));
            }
            let (along, beside) = redundancy.parts(&residuals, row);
            prop_assert!(close(along, redundancy.along(row)) && close(beside, redundancy.beside2(row)));
        }

        #[test]
        fn less_variance_is_as_if_it_had_never_been_there(values in prop::collection::vec(-1.0..1.0f64, 80)) {
            let (mut gls, a, v, _) = problem(&values, 8);
            let fit = gls.solve(&[1.0; 6]).unwrap();
            let before = gls.whitened_residuals().to_vec();
            let (mut less, mut same) = (Redundancy::new(10), Redundancy::new(10));
            let variances: Vec<f64> = (0..8).map(|k| 0.09 + 0.5 * k as f64).collect();
            prop_assert!(gls.redundancy(&fit.x, Some(&variances), &mut less));
            prop_assert_eq!(gls.whitened_residuals(), &before[..]);
            let vi = (v - DMatrix::from_diagonal(&DVector::from_vec(variances))).try_inverse().unwrap();
            let gain = (a.transpose() * &vi * &a).try_inverse().unwrap() * a.transpose() * &vi;
            let q = &vi * (DMatrix::identity(8, 8) - &a * gain);
            for k in 0..8 {
                let expected = q[(k, k)].sqrt().recip();
                prop_assert!((less.fault_sigma_counts(k).unwrap() / expected - 1.0).abs() < 1e-4);
            }
            gls.solve(&[1.0; 6]).unwrap();
            prop_assert!(gls.redundancy(&fit.x, None, &mut same));
            prop_assert!((same.chi2() - fit.chi2).abs() < 1e-6 * (1.0 + fit.chi2));
        }
    }

    #[test]
    fn six_rows_check_nothing_and_a_row_that_alone_sees_a_direction_is_not_checked() {
        let unit = |k: usize| Vector6::from_fn(|i, _| f64::from(u8::from(i == k)));
        let mut gls = Gls::new(8);
        (0..6).for_each(|k| gls.push(&unit(k), 1.0, 1.0));
        let mut redundancy = Redundancy::new(8);
        let fit = gls.solve(&[1.0; 6]).unwrap();
        assert!(gls.redundancy(&fit.x, None, &mut redundancy));
        assert!((0..6).all(|k| redundancy.fault_sigma_counts(k).is_none()));
        gls.push(&unit(0), 9.0, 1.0);
        let fit = gls.solve(&[1.0; 6]).unwrap();
        assert!(gls.redundancy(&fit.x, None, &mut redundancy));
        let checked: Vec<bool> = (0..7).map(|k| redundancy.fault_sigma_counts(k).is_some()).collect();
        assert_eq!(checked, [true, false, false, false, false, false, true]);
        assert!((redundancy.chi2() - 32.0).abs() < 1e-9 && redundancy.spare() == 1);
        assert!(
            (redundancy.fault_counts(6) - 8.0).abs() < 1e-9
                && (redundancy.fault_counts(0) + 8.0).abs() < 1e-9
        );
    }
}
