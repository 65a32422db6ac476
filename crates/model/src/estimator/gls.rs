//! Generalised least squares with six unknowns on a few rows: whitening by Cholesky, QR by Givens rotations, one-sided Jacobi.
//!
//! `y = A x + e`, `cov(e) = V` (full): with `V = L L'`, least squares on `L^-1 A`, `L^-1 y`. The normal
//! equations are never formed. Everything works in buffers sized at construction.

use nalgebra::{Matrix6, Vector6};

/// Rows, right-hand side and covariance of one problem, and the scratch to solve it.
#[derive(Clone, Debug)]
pub struct Gls {
    rows: Vec<[f64; COLUMNS]>,
    whitened: Vec<[f64; COLUMNS]>,
    residuals: Vec<f64>,
    /// Lower triangle of the covariance, row by row; its Cholesky factor after solving.
    covariance: Vec<f64>,
    capacity: usize,
}

/// Six unknowns and the right-hand side.
const COLUMNS: usize = 7;

/// Ratio of smallest to largest singular value below which a direction counts as not seen at all.
const RANK_TOLERANCE: f64 = 1e-10;

/// Solution of one problem, in the units of its columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// The estimate.
    pub x: Vector6<f64>,
    /// Its covariance, given the covariance of the rows.
    pub covariance: Matrix6<f64>,
    /// Singular values of the whitened, column-scaled matrix, largest first.
    pub singular_values: [f64; 6],
    /// Sum of squares of the whitened residual: chi-square with `rows - 6` degrees of freedom.
    pub chi2: f64,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoFit {
    /// Fewer than six rows.
    TooFewRows,
    /// The rows do not determine all six unknowns.
    Singular,
    /// A row, its value or its covariance is not finite, or the covariance is not positive.
    NotFinite,
}

impl Gls {
    /// For up to `capacity` rows.
    pub fn new(capacity: usize) -> Self {
        Self {
            rows: Vec::with_capacity(capacity),
            whitened: Vec::with_capacity(capacity),
            residuals: Vec::with_capacity(capacity),
            covariance: vec![0.0; capacity * capacity],
            capacity,
        }
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.rows.clear();
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// Adds `value = row . x` with an error independent of the others (`variance`); covariance may be added later.
    ///
    /// Beyond the capacity a row is ignored.
    pub fn push(&mut self, row: &Vector6<f64>, value: f64, variance: f64) {
        let k = self.rows.len();
        if k == self.capacity {
            return;
        }
        self.rows.push([row[0], row[1], row[2], row[3], row[4], row[5], value]);
        for j in 0..k {
            self.covariance[k * self.capacity + j] = 0.0;
        }
        self.covariance[k * self.capacity + k] = variance;
    }

    /// Adds `direction direction'` to the covariance of the rows: an error that moves them all together.
    pub fn add_shared_error(&mut self, direction: &[f64]) {
        for k in 0..self.rows.len() {
            for j in 0..=k {
                self.covariance[k * self.capacity + j] += direction[k] * direction[j];
            }
        }
    }

    /// Adds to the variance of one row.
    pub fn add_variance(&mut self, row: usize, variance: f64) {
        self.covariance[row * self.capacity + row] += variance;
    }

    /// Residual of each row divided by its own standard deviation as whitened, after a solution.
    pub fn whitened_residuals(&self) -> &[f64] {
        &self.residuals
    }

    /// Solves. `column_scale` is what columns are multiplied by before singular values are taken, so that
    /// they compare (1 for forces, one over a length for moments).
    pub fn solve(&mut self, column_scale: &[f64; 6]) -> Result<Fit, NoFit> {
        if self.rows.len() < 6 {
            return Err(NoFit::TooFewRows);
        }
        self.factor()?;
        self.whiten(column_scale);
        let triangle = self.triangularise();
        let singular_values = singular_values(&triangle.fixed_view::<6, 6>(0, 0).into_owned());
        if !singular_values.iter().all(|s| s.is_finite()) {
            return Err(NoFit::NotFinite);
        }
        if singular_values[5] <= RANK_TOLERANCE * singular_values[0] {
            return Err(NoFit::Singular);
        }
        let upper = triangle.fixed_view::<6, 6>(0, 0).into_owned();
        let target = triangle.fixed_view::<6, 1>(0, 6).into_owned();
        let inverse = inverse_upper(&upper);
        let scaled = inverse * target;
        if !scaled.iter().all(|x| x.is_finite()) {
            return Err(NoFit::NotFinite);
        }
        let covariance = inverse * inverse.transpose();
        let fit = Fit {
            x: Vector6::from_fn(|k, _| scaled[k] * column_scale[k]),
            covariance: Matrix6::from_fn(|i, k| covariance[(i, k)] * column_scale[i] * column_scale[k]),
            singular_values,
            chi2: triangle[(6, 6)] * triangle[(6, 6)],
        };
        self.find_residuals(&scaled);
        Ok(fit)
    }

    /// In-place Cholesky factor of the covariance.
    fn factor(&mut self) -> Result<(), NoFit> {
        let (n, w) = (self.rows.len(), self.capacity);
        for k in 0..n {
            for j in 0..=k {
                let mut sum = self.covariance[k * w + j];
                for i in 0..j {
                    sum -= self.covariance[k * w + i] * self.covariance[j * w + i];
                }
                if j < k {
                    self.covariance[k * w + j] = sum / self.covariance[j * w + j];
                } else if sum > 0.0 && sum.is_finite() {
                    self.covariance[k * w + k] = sum.sqrt();
                } else {
                    return Err(NoFit::NotFinite);
                }
            }
        }
        Ok(())
    }

    /// `L^-1 [A scale, y]` by forward substitution.
    fn whiten(&mut self, column_scale: &[f64; 6]) {
        self.whitened.clear();
        for k in 0..self.rows.len() {
            let mut row = self.rows[k];
            for c in 0..6 {
                row[c] *= column_scale[c];
            }
            let factors = &self.covariance[k * self.capacity..k * self.capacity + k + 1];
            for j in 0..k {
                for c in 0..COLUMNS {
                    row[c] -= factors[j] * self.whitened[j][c];
                }
            }
            for c in 0..COLUMNS {
                row[c] /= factors[k];
            }
            self.whitened.push(row);
        }
    }

    /// QR of the whitened rows; the last diagonal element is the residual's norm.
    fn triangularise(&mut self) -> nalgebra::SMatrix<f64, COLUMNS, COLUMNS> {
        self.residuals.clear();
        let mut work = Triangle::default();
        for row in &self.whitened {
            work.add(row);
        }
        work.0
    }

    fn find_residuals(&mut self, scaled: &Vector6<f64>) {
        for row in &self.whitened {
            let fitted: f64 = (0..6).map(|c| row[c] * scaled[c]).sum();
            self.residuals.push(row[6] - fitted);
        }
    }
}

/// Upper triangle built row by row with Givens rotations: the same arithmetic for any number of rows.
#[derive(Clone, Copy, Debug, Default)]
struct Triangle(nalgebra::SMatrix<f64, COLUMNS, COLUMNS>);

impl Triangle {
    fn add(&mut self, row: &[f64; COLUMNS]) {
        let mut row = *row;
        for k in 0..COLUMNS {
            let (a, b) = (self.0[(k, k)], row[k]);
            if b == 0.0 {
                continue;
            }
            let norm = (a * a + b * b).sqrt();
            let (c, s) = (a / norm, b / norm);
            self.0[(k, k)] = norm;
            for j in k + 1..COLUMNS {
                let (above, below) = (self.0[(k, j)], row[j]);
                self.0[(k, j)] = c * above + s * below;
                row[j] = c * below - s * above;
            }
        }
    }
}

/// Inverse of an upper triangular matrix whose diagonal has no zero.
fn inverse_upper(upper: &Matrix6<f64>) -> Matrix6<f64> {
    let mut inverse = Matrix6::zeros();
    for k in 0..6 {
        inverse[(k, k)] = 1.0 / upper[(k, k)];
        for i in (0..k).rev() {
            let sum: f64 = (i + 1..=k).map(|j| upper[(i, j)] * inverse[(j, k)]).sum();
            inverse[(i, k)] = -sum / upper[(i, i)];
        }
    }
    inverse
}

/// Singular values of a 6x6 matrix, largest first, by one-sided Jacobi rotations (accurate for small ones too).
///
/// Bounded: at most 12 sweeps, of which a well-scaled matrix needs five or so.
pub fn singular_values(matrix: &Matrix6<f64>) -> [f64; 6] {
    let mut a = *matrix;
    for _ in 0..12 {
        let mut turned = false;
        for i in 0..5 {
            for k in i + 1..6 {
                turned |= orthogonalise(&mut a, i, k);
            }
        }
        if !turned {
            break;
        }
    }
    let mut values = [0.0; 6];
    for (k, v) in values.iter_mut().enumerate() {
        *v = a.column(k).norm();
    }
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// Turns columns `i` and `k` against each other until they are orthogonal; says whether that took a turn.
fn orthogonalise(a: &mut Matrix6<f64>, i: usize, k: usize) -> bool {
    let (x, y) = (a.column(i).into_owned(), a.column(k).into_owned());
    let (xx, yy, xy) = (x.norm_squared(), y.norm_squared(), x.dot(&y));
    if xy.abs() <= 1e-15 * (xx * yy).sqrt() || !xy.is_finite() {
        return false;
    }
    let zeta = (yy - xx) / (2.0 * xy);
    let t = zeta.signum() / (zeta.abs() + (1.0 + zeta * zeta).sqrt());
    let c = 1.0 / (1.0 + t * t).sqrt();
    let s = c * t;
    a.set_column(i, &(x * c - y * s));
    a.set_column(k, &(x * s + y * c));
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    const UNIT: [f64; 6] = [1.0; 6];

    fn matrix(values: &[f64], n: usize) -> DMatrix<f64> {
        DMatrix::from_row_slice(n, 6, &values[..n * 6])
    }

    proptest! {
        #[test]
        fn agrees_with_the_textbook_formula(
            values in prop::collection::vec(-1.0..1.0f64, 60), y in prop::collection::vec(-10.0..10.0f64, 10),
            shared in prop::collection::vec(-1.0..1.0f64, 10), n in 6usize..=10,
        ) {
            let a = matrix(&values, n) + DMatrix::from_fn(n, 6, |i, k| if i % 6 == k { 2.0 } else { 0.0 });
            let mut gls = Gls::new(10);
            let mut v = DMatrix::zeros(n, n);
            for k in 0..n {
                let variance = 0.1 + k as f64;
                gls.push(&Vector6::from_fn(|c, _| a[(k, c)]), y[k], variance);
                v[(k, k)] = variance;
            }
            gls.add_shared_error(&shared[..n]);
            let s = DVector::from_column_slice(&shared[..n]);
            v += &s * s.transpose();
            let fit = gls.solve(&[1.0, 1.0, 1.0, 10.0, 10.0, 10.0]).unwrap();
            let vi = v.clone().try_inverse().unwrap();
            let covariance = (a.transpose() * &vi * &a).try_inverse().unwrap();
            let y = DVector::from_column_slice(&y[..n]);
            let x = &covariance * a.transpose() * &vi * &y;
            let r = &y - &a * &x;
            let chi2 = (r.transpose() * vi * &r)[(0, 0)];
            for i in 0..6 {
                prop_assert!((fit.x[i] - x[i]).abs() < 1e-6 * (1.0 + x[i].abs()));
                for k in 0..6 {
                    prop_assert!((fit.covariance[(i, k)] - covariance[(i, k)]).abs() < 1e-6 * covariance.amax());
                }
            }
            prop_assert!((fit.chi2 - chi2).abs() < 1e-6 * (1.0 + chi2));
            let sum: f64 = gls.whitened_residuals().iter().map(|r| r * r).sum();
            prop_assert!((sum - chi2).abs() < 1e-6 * (1.0 + chi2));
        }

        #[test]
        fn singular_values_are_those_of_the_svd(values in prop::array::uniform32(-1.0..1.0f64)) {
            let m = Matrix6::from_fn(|i, k| values[(i * 6 + k) % 32] * if k > 2 { 1e3 } else { 1.0 } + (i * k) as f64 * 0.1);
            let ours = singular_values(&m);
            let theirs = m.svd(false, false).singular_values;
            for k in 0..6 {
                prop_assert!((ours[k] - theirs[k]).abs() <= 1e-9 * theirs[0]);
            }
        }
    }

    #[test]
    fn says_why_there_is_no_solution() {
        let mut gls = Gls::new(8);
        let unit = |k: usize| Vector6::from_fn(|i, _| f64::from(u8::from(i == k)));
        for k in 0..5 {
            gls.push(&unit(k), 1.0, 1.0);
        }
        assert_eq!(gls.solve(&UNIT), Err(NoFit::TooFewRows));
        gls.push(&(unit(0) + unit(1)), 1.0, 1.0);
        assert_eq!(gls.solve(&UNIT), Err(NoFit::Singular));
        gls.push(&unit(5), f64::NAN, 1.0);
        assert_eq!(gls.solve(&UNIT), Err(NoFit::NotFinite));
        gls.clear();
        for k in 0..6 {
            gls.push(&unit(k), 1.0, if k == 3 { -1.0 } else { 1.0 });
        }
        assert_eq!(gls.solve(&UNIT), Err(NoFit::NotFinite));
    }

    #[test]
    fn rows_beyond_the_capacity_are_ignored() {
        let mut gls = Gls::new(1);
        gls.push(&Vector6::zeros(), 0.0, 1.0);
        gls.push(&Vector6::zeros(), 0.0, 1.0);
        assert_eq!(gls.len(), 1);
    }
}
