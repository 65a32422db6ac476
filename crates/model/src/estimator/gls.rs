//! Generalised least squares with six unknowns on a few rows: whitening by Cholesky, QR by Householder
//! reflections, singular values by one-sided Jacobi rotations.
//!
//! `y = A x + e`, `cov(e) = V` (full): with `V = L L'`, least squares on `L^-1 A`, `L^-1 y`. The normal
//! equations are never formed. Everything works in buffers sized at construction.

use nalgebra::{Matrix6, Vector6};
use wide::f64x4;

use super::covariance;
use super::redundancy::Redundancy;
use super::singular::singular_values;
use super::triangle::{Row, Triangle};

/// Rows, right-hand side and covariance of one problem, and the scratch to solve it.
#[derive(Clone, Debug)]
pub struct Gls {
    rows: Vec<Row>,
    whitened: Vec<Row>,
    /// The whitened rows on their way to a triangle.
    work: Vec<Row>,
    residuals: Vec<f64>,
    /// Upper triangle of the covariance, row by row, four columns at a time (what is left of the diagonal means nothing).
    covariance: Vec<f64x4>,
    /// What all covariances begin with, laid out alike, and of how many rows.
    common: (Vec<f64x4>, usize),
    /// Transpose of the Cholesky factor, laid out alike.
    factor: Vec<f64x4>,
    /// What the whitened rows were brought to.
    triangle: Triangle,
    column_scale: [f64; 6],
    capacity: usize,
    /// Fours of columns of a row.
    fours: usize,
}

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
    /// For up to `capacity` rows, and at most 256.
    pub fn new(capacity: usize) -> Self {
        let (capacity, fours) = covariance::room(capacity);
        let square = vec![f64x4::ZERO; capacity * fours];
        Self {
            fours,
            rows: Vec::with_capacity(capacity),
            whitened: Vec::with_capacity(capacity),
            work: Vec::with_capacity(capacity),
            residuals: Vec::with_capacity(capacity),
            covariance: square.clone(),
            common: (square.clone(), 0),
            factor: square,
            triangle: Triangle::default(),
            column_scale: [1.0; 6],
            capacity,
        }
    }

    /// Forgets all rows.
    pub fn clear(&mut self) {
        self.rows.clear();
        self.common.1 = 0;
    }

    /// Fours of rows: how many numbers in fours say what an error does to all rows.
    pub(super) fn stride(&self) -> usize {
        self.fours
    }

    /// Forgets all rows, and sets what moves those to come together before anything else, as [`Self::share`] takes it.
    pub(super) fn begin(&mut self, effects: &[f64x4]) {
        self.rows.clear();
        self.common.0.fill(f64x4::ZERO);
        self.common.1 = self.capacity;
        covariance::add_products(&mut self.common.0, self.fours, effects, self.capacity);
    }

    /// Forgets all rows, but not what [`Self::begin`] set.
    pub(super) fn begin_again(&mut self) {
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
        self.rows.push(Row::new(&row.data.0[0], value));
        let place = k * self.fours..(k + 1) * self.fours;
        let row = &mut self.covariance[place.clone()];
        match k < self.common.1 {
            true => row.copy_from_slice(&self.common.0[place]),
            false => row.fill(f64x4::ZERO),
        }
        row[k / 4].as_mut_array()[k % 4] += variance;
    }

    /// Adds to the covariance of the rows what moves several of them together: independent errors of unit variance, of which
    /// `effects` says what they do to the rows, error by error, four rows at a time and as many fours as there is room for rows.
    pub fn share(&mut self, effects: &[f64x4]) {
        covariance::add_products(&mut self.covariance, self.fours, effects, self.rows.len());
    }

    /// Adds to the variance of one row.
    pub fn add_variance(&mut self, row: usize, variance: f64) {
        self.covariance[row * self.fours + row / 4].as_mut_array()[row % 4] += variance;
    }

    /// Residual of each row divided by its own standard deviation as whitened, after a solution.
    pub fn whitened_residuals(&self) -> &[f64] {
        &self.residuals
    }

    /// Solves. `column_scale` is what columns are multiplied by before singular values are taken, so that
    /// they compare (1 for forces, one over a length for moments).
    pub fn solve(&mut self, column_scale: &[f64; 6]) -> Result<Fit, NoFit> {
        self.triangularise(column_scale)?;
        let singular_values = singular_values(&self.triangle.unknowns());
        if !singular_values.iter().all(|s| s.is_finite()) {
            return Err(NoFit::NotFinite);
        }
        if singular_values[5] <= RANK_TOLERANCE * singular_values[0] {
            return Err(NoFit::Singular);
        }
        let scaled = self.triangle.solution();
        self.find_residuals(&scaled);
        let x = self.unscaled(&scaled)?;
        let chi2 = self.triangle.residual2;
        Ok(Fit { x, covariance: self.unknowns_covariance(), singular_values, chi2 })
    }

    /// The estimate alone, without what tells how well it stands; for what is solved again. A problem that is only nearly singular passes.
    pub fn estimate(&mut self, column_scale: &[f64; 6]) -> Result<Vector6<f64>, NoFit> {
        self.triangularise(column_scale)?;
        let (least, most) = self.triangle.diagonal_range();
        // The smallest singular value is no larger than any element of the diagonal, and the largest no smaller.
        if least <= RANK_TOLERANCE * most {
            return Err(NoFit::Singular);
        }
        self.unscaled(&self.triangle.solution())
    }

    /// Covariance of the last estimate, given that of the rows, in the units of the columns.
    pub fn unknowns_covariance(&self) -> Matrix6<f64> {
        let inverse = self.triangle.inverse();
        let mut covariance = Matrix6::zeros();
        for i in 0..6 {
            for k in 0..=i {
                let halves = (inverse[i].0[0] * inverse[k].0[0]) + (inverse[i].0[1] * inverse[k].0[1]);
                let product = halves.reduce_add() * (self.column_scale[i] * self.column_scale[k]);
                covariance[(i, k)] = product;
                covariance[(k, i)] = product;
            }
        }
        covariance
    }

    /// Whitens the rows and brings them to a triangle.
    fn triangularise(&mut self, column_scale: &[f64; 6]) -> Result<(), NoFit> {
        if self.rows.len() < 6 {
            return Err(NoFit::TooFewRows);
        }
        self.column_scale = *column_scale;
        self.whiten()?;
        self.work.clear();
        self.work.extend_from_slice(&self.whitened);
        self.triangle = Triangle::of(&mut self.work);
        Ok(())
    }

    /// The unknowns in the units of the columns.
    fn unscaled(&self, scaled: &[f64; 6]) -> Result<Vector6<f64>, NoFit> {
        let x = Vector6::from_fn(|c, _| scaled[c] * self.column_scale[c]);
        if x.iter().all(|x| x.is_finite()) { Ok(x) } else { Err(NoFit::NotFinite) }
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
            let found = self.triangularise(&self.column_scale.clone());
            self.lessen(less, 1.0);
            if found.is_err() {
                return false;
            }
        }
        for row in &self.rows {
            let factors = row.factors();
            let fitted: f64 = (0..6).map(|c| factors[c] * x[c]).sum();
            out.push(factors, row.target() - fitted);
        }
        out.weigh(
            |i, k| self.factor[k * self.fours + i / 4].as_array()[i % 4],
            &self.whitened,
            &self.triangle.inverse(),
            &self.column_scale,
        )
    }

    fn lessen(&mut self, variances: &[f64], sign: f64) {
        for (k, variance) in variances.iter().enumerate().take(self.rows.len()) {
            self.add_variance(k, sign * variance);
        }
    }

    /// Transposed Cholesky factor of the covariance, and `L^-1 [A scale, y]` by forward substitution as it grows.
    fn whiten(&mut self) -> Result<(), NoFit> {
        let scale = Row::new(&self.column_scale, 1.0);
        self.whitened.clear();
        self.whitened.extend(self.rows.iter().map(|row| row.times(&scale)));
        let numbers = self.rows.len() * self.fours;
        self.factor[..numbers].copy_from_slice(&self.covariance[..numbers]);
        let (factor, whitened) = (&mut self.factor[..numbers], &mut self.whitened[..]);
        let done = covariance::eliminate(factor, self.fours, whitened);
        if done { Ok(()) } else { Err(NoFit::NotFinite) }
    }

    fn find_residuals(&mut self, scaled: &[f64; 6]) {
        let unknowns = Row::new(scaled, 0.0);
        self.residuals.clear();
        self.residuals.extend(self.whitened.iter().map(|row| {
            let [a, b] = [row.0[0] * unknowns.0[0], row.0[1] * unknowns.0[1]];
            row.target() - (a + b).reduce_add()
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use proptest::prelude::*;

    const UNIT: [f64; 6] = [1.0; 6];

    fn fours(effects: &[f64], stride: usize) -> Vec<f64x4> {
        let at = |k: usize| effects.get(k).copied().unwrap_or_default();
        (0..stride).map(|four| f64x4::new(std::array::from_fn(|lane| at(4 * four + lane)))).collect()
    }

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
            gls.share(&fours(&shared[..n], gls.stride()));
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
