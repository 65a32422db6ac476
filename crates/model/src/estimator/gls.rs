//! Generalised least squares with six unknowns on a few rows: whitening by Cholesky, QR by Householder
//! reflections, singular values by one-sided Jacobi rotations.
//!
//! `y = A x + e`, `cov(e) = V` (full): with `V = L L'`, least squares on `L^-1 A`, `L^-1 y`. The normal
//! equations are never formed. Everything works in buffers sized at construction.

use nalgebra::{Matrix6, Vector6};

use super::redundancy::Redundancy;

/// Rows, right-hand side and covariance of one problem, and the scratch to solve it.
#[derive(Clone, Debug)]
pub struct Gls {
    rows: Vec<[f64; COLUMNS]>,
    whitened: Vec<[f64; COLUMNS]>,
    /// The whitened rows on their way to a triangle.
    work: Vec<[f64; COLUMNS]>,
    residuals: Vec<f64>,
    /// Lower triangle of the covariance, row by row.
    covariance: Vec<f64>,
    /// Its Cholesky factor, laid out alike.
    factor: Vec<f64>,
    /// Inverse of the triangle that the whitened rows were brought to.
    inverse: Matrix6<f64>,
    column_scale: [f64; 6],
    capacity: usize,
}

/// Six unknowns and the right-hand side.
const COLUMNS: usize = 7;

/// Ratio of smallest to largest singular value below which a direction counts as not seen at all.
const RANK_TOLERANCE: f64 = 1e-10;

/// What a problem says of the unknowns, in the units of its columns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// The estimate.
    pub x: Vector6<f64>,
    /// Its covariance, given the covariance of the rows.
    pub covariance: Matrix6<f64>,
}

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
            work: Vec::with_capacity(capacity),
            residuals: Vec::with_capacity(capacity),
            covariance: vec![0.0; capacity * capacity],
            factor: vec![0.0; capacity * capacity],
            inverse: Matrix6::zeros(),
            column_scale: [1.0; 6],
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
        let row = &mut self.covariance[k * self.capacity..=k * self.capacity + k];
        row.fill(0.0);
        row[k] = variance;
    }

    /// Adds to the covariance of the rows what moves several of them together: `width` independent errors of unit variance, of which
    /// `effects` says what they do to each row, row by row.
    pub fn share(&mut self, effects: &[f64], width: usize) {
        for (k, mine) in effects.chunks_exact(width.max(1)).enumerate() {
            for (j, other) in effects.chunks_exact(width.max(1)).enumerate().take(k + 1) {
                self.covariance[k * self.capacity + j] += wide_dot(mine, other);
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
        let triangle = self.triangle(column_scale)?;
        let singular_values = singular_values(&triangle.unknowns);
        if !singular_values.iter().all(|s| s.is_finite()) {
            return Err(NoFit::NotFinite);
        }
        if singular_values[5] <= RANK_TOLERANCE * singular_values[0] {
            return Err(NoFit::Singular);
        }
        let Estimate { x, covariance } = self.invert(&triangle)?;
        self.find_residuals(&x);
        let chi2 = triangle.residual2;
        Ok(Fit { x, covariance, singular_values, chi2 })
    }

    /// The estimate alone, without what tells how well it stands; for what is solved again. A problem that is only nearly singular passes.
    pub fn estimate(&mut self, column_scale: &[f64; 6]) -> Result<Estimate, NoFit> {
        let triangle = self.triangle(column_scale)?;
        let diagonal = triangle.unknowns.diagonal().abs();
        // The smallest singular value is no larger than any element of the diagonal, and the largest no smaller.
        if diagonal.min() <= RANK_TOLERANCE * diagonal.max() {
            return Err(NoFit::Singular);
        }
        self.invert(&triangle)
    }

    /// Whitened rows, brought to a triangle.
    fn triangle(&mut self, column_scale: &[f64; 6]) -> Result<Triangle, NoFit> {
        if self.rows.len() < 6 {
            return Err(NoFit::TooFewRows);
        }
        self.column_scale = *column_scale;
        self.factor()?;
        self.whiten(column_scale);
        Ok(self.triangularise())
    }

    fn invert(&mut self, triangle: &Triangle) -> Result<Estimate, NoFit> {
        self.inverse = inverse_upper(&triangle.unknowns);
        let scale = Vector6::from(self.column_scale);
        let x = (self.inverse * triangle.target).component_mul(&scale);
        if !x.iter().all(|x| x.is_finite()) {
            return Err(NoFit::NotFinite);
        }
        let covariance = self.inverse * self.inverse.transpose();
        let covariance = covariance.component_mul(&(scale * scale.transpose()));
        Ok(Estimate { x, covariance })
    }

    /// What the rows beyond six say of each other, as the last solution weighed them; or, with `less_variance` given, as if each row's
    /// variance were smaller by so much (the solution and its residuals stay as they are).
    ///
    /// `x` is the last solution. False where there is none, or the covariance left is not positive.
    pub fn redundancy(
        &mut self,
        x: &Vector6<f64>,
        less_variance: Option<&[f64]>,
        out: &mut Redundancy,
    ) -> bool {
        out.clear();
        if self.rows.len() < 6 {
            return false;
        }
        if let Some(less) = less_variance {
            self.lessen(less, -1.0);
            let triangle = self.triangle(&self.column_scale.clone());
            self.lessen(less, 1.0);
            let Ok(triangle) = triangle else { return false };
            self.inverse = inverse_upper(&triangle.unknowns);
        }
        for row in &self.rows {
            let fitted: f64 = (0..6).map(|c| row[c] * x[c]).sum();
            out.push(row, row[6] - fitted);
        }
        out.weigh(&self.factor, self.capacity, &self.whitened, &self.inverse, &self.column_scale)
    }

    fn lessen(&mut self, variances: &[f64], sign: f64) {
        for (k, variance) in variances.iter().enumerate().take(self.rows.len()) {
            self.covariance[k * self.capacity + k] += sign * variance;
        }
    }

    /// Cholesky factor of the covariance.
    fn factor(&mut self) -> Result<(), NoFit> {
        let w = self.capacity;
        for k in 0..self.rows.len() {
            let (above, row) = self.factor.split_at_mut(k * w);
            let covariance = &self.covariance[k * w..=k * w + k];
            for j in 0..k {
                let other = &above[j * w..=j * w + j];
                row[j] = (covariance[j] - dot(&row[..j], &other[..j])) / other[j];
            }
            let left = covariance[k] - dot(&row[..k], &row[..k]);
            // Also false for what is not a number.
            if !(left > 0.0 && left.is_finite()) {
                return Err(NoFit::NotFinite);
            }
            row[k] = left.sqrt();
        }
        Ok(())
    }

    /// `L^-1 [A scale, y]` by forward substitution.
    fn whiten(&mut self, column_scale: &[f64; 6]) {
        self.whitened.clear();
        for (k, row) in self.rows.iter().enumerate() {
            let mut row = *row;
            row.iter_mut().zip(column_scale).for_each(|(value, scale)| *value *= scale);
            let factors = &self.factor[k * self.capacity..=k * self.capacity + k];
            for (factor, above) in factors.iter().zip(&self.whitened) {
                for c in 0..COLUMNS {
                    row[c] -= factor * above[c];
                }
            }
            let scale = factors[k].recip();
            row.iter_mut().for_each(|value| *value *= scale);
            self.whitened.push(row);
        }
    }

    /// QR of the whitened rows.
    fn triangularise(&mut self) -> Triangle {
        self.work.clear();
        self.work.extend_from_slice(&self.whitened);
        let mut unknowns = Matrix6::zeros();
        for k in 0..6 {
            let diagonal = reflect(&mut self.work[k..], k);
            (k + 1..6).for_each(|c| unknowns[(k, c)] = self.work[k][c]);
            unknowns[(k, k)] = diagonal;
        }
        let target = Vector6::from_fn(|k, _| self.work[k][6]);
        Triangle { unknowns, target, residual2: self.work[6..].iter().map(|row| row[6] * row[6]).sum() }
    }

    fn find_residuals(&mut self, x: &Vector6<f64>) {
        let scaled = x.component_div(&Vector6::from(self.column_scale));
        self.residuals.clear();
        for row in &self.whitened {
            self.residuals.push(row[6] - dot(&row[..6], scaled.as_slice()));
        }
    }
}

/// Whitened rows brought to an upper triangle: that of the unknowns, what they are to give, and what is left over, squared.
struct Triangle {
    unknowns: Matrix6<f64>,
    target: Vector6<f64>,
    residual2: f64,
}

/// Householder reflection that turns column `k` of the rows into a multiple of the first unit vector, which it returns; the column
/// itself is left as it was.
fn reflect(rows: &mut [[f64; COLUMNS]], k: usize) -> f64 {
    let length2: f64 = rows.iter().map(|row| row[k] * row[k]).sum();
    let lead = rows[0][k];
    // Away from the lead, so that nothing cancels.
    let diagonal = -length2.sqrt().copysign(lead);
    if diagonal == 0.0 {
        return 0.0;
    }
    let mirrored = |at: usize, row: &[f64; COLUMNS]| if at == 0 { lead - diagonal } else { row[k] };
    let mut along = [0.0; COLUMNS];
    for (at, row) in rows.iter().enumerate() {
        let part = mirrored(at, row);
        (0..COLUMNS).for_each(|c| along[c] += part * row[c]);
    }
    let scale = (length2 - diagonal * lead).recip();
    for (at, row) in rows.iter_mut().enumerate() {
        let part = mirrored(at, row) * scale;
        (k + 1..COLUMNS).for_each(|c| row[c] -= part * along[c]);
    }
    diagonal
}

/// Four sums at a time: an addition need not wait for the last one.
fn wide_dot(a: &[f64], b: &[f64]) -> f64 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    let mut sums = [0.0; 4];
    for (a, b) in a.iter().zip(b) {
        (0..4).for_each(|k| sums[k] += a[k] * b[k]);
    }
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + dot(a_rest, b_rest)
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
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
/// Bounded: at most 12 sweeps, of which a well-scaled matrix needs three or four. Rows are turned, not columns: those of a triangle that
/// a QR left are nearer to each other's right angle (Z. Drmac, K. Veselic, New fast and accurate Jacobi SVD algorithm I, 2008).
pub fn singular_values(matrix: &Matrix6<f64>) -> [f64; 6] {
    let mut rows: [[f64; 6]; 6] = matrix.transpose().into();
    for _ in 0..12 {
        let mut squares = rows.map(|row| dot(&row, &row));
        let mut steepest: f64 = 0.0;
        for i in 0..5 {
            for k in i + 1..6 {
                steepest = steepest.max(orthogonalise(&mut rows, &mut squares, i, k));
            }
        }
        // What is left after a sweep is the square of what it met, and a length is wrong by the square of that.
        if steepest < 1e-8 {
            break;
        }
    }
    let mut values = rows.map(|row| dot(&row, &row).sqrt());
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// Turns rows `i` and `k` against each other until they are orthogonal, and keeps the squares of their lengths; the square of the cosine
/// between them before, 0 where that says nothing.
fn orthogonalise(rows: &mut [[f64; 6]; 6], squares: &mut [f64; 6], i: usize, k: usize) -> f64 {
    let (x, y) = (rows[i], rows[k]);
    let (xy, product) = (dot(&x, &y), squares[i] * squares[k]);
    let is_askew = xy * xy > 1e-18 * product;
    // Also what is not a number.
    if !is_askew {
        return 0.0;
    }
    let apart = squares[k] - squares[i];
    let t = 2.0 * xy.copysign(xy * apart) / (apart.abs() + (apart * apart + 4.0 * xy * xy).sqrt());
    let c = (1.0 + t * t).sqrt().recip();
    let s = c * t;
    for j in 0..6 {
        rows[i][j] = x[j] * c - y[j] * s;
        rows[k][j] = x[j] * s + y[j] * c;
    }
    squares[i] -= t * xy;
    squares[k] += t * xy;
    xy * xy / product
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
            gls.share(&shared[..n], 1);
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
