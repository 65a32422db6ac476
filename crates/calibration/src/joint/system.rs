//! The linearised problem: every gauge's own numbers, and the arm's numbers that all gauges share.
//!
//! ```text
//! z + Y x0 = [L(x0), 1 per session, phi] theta_g + Y x + e        Y = C_g . dL_g/dx
//! ```
//!
//! Given the arm's numbers `x`, gauges are independent of each other: each one's `theta_g` is eliminated from its own
//! normal equations (scaled columns, Cholesky), and what is left is one small system for `x` with the priors on its diagonal.

use nalgebra::{DMatrix, DVector};

/// One gauge's rows.
#[derive(Clone, Debug)]
pub struct GaugeRows {
    /// Columns: own numbers, then the arm's.
    pub a: Vec<f64>,
    /// Right-hand side, counts.
    pub z: Vec<f64>,
    /// Variance of noise, counts^2, and how many rows share a misfit.
    pub variance: Vec<(f64, f64)>,
    /// Index of each row among all rows.
    pub index: Vec<usize>,
    /// Weight against outliers, 0 to 1.
    pub trust: Vec<f64>,
    /// Prior information of the own numbers; as last column that times what it says of them.
    pub prior: DMatrix<f64>,
    /// Variance of what does not fit, counts^2.
    pub misfit: f64,
}

/// All gauges' rows.
#[derive(Clone, Debug)]
pub struct System {
    /// One a gauge.
    pub gauges: Vec<GaugeRows>,
    /// Number of own numbers of each gauge.
    pub own: usize,
    /// Prior widths of the arm's numbers.
    pub widths: Vec<f64>,
}

/// Normal equations of one gauge, the right-hand side as last column.
pub type Normal = DMatrix<f64>;

/// Which numbers are free: own ones gauge by gauge, and the arm's.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Selection {
    /// `[gauge][own number]`.
    pub own: Vec<Vec<bool>>,
    /// `[arm's number]`.
    pub arm: Vec<bool>,
}

/// Solution with what is needed for its uncertainty.
#[derive(Clone, Debug)]
pub struct Solution {
    /// The arm's numbers; zero where not free.
    pub arm: Vec<f64>,
    /// Own numbers of each gauge; zero where not free.
    pub own: Vec<Vec<f64>>,
    /// Free numbers of the arm.
    pub arm_free: Vec<usize>,
    /// Their covariance.
    pub arm_covariance: DMatrix<f64>,
    /// Per gauge: its free numbers, their covariance given the arm, and their change with the arm's free numbers.
    pub conditional: Vec<(Vec<usize>, DMatrix<f64>, DMatrix<f64>)>,
}

impl GaugeRows {
    /// Variance of a row, counts^2.
    pub fn total_variance(&self, k: usize) -> f64 {
        let (noise, shared) = self.variance[k];
        noise + shared * self.misfit
    }
}

impl System {
    /// Number of columns of a row.
    pub fn columns(&self) -> usize {
        self.own + self.widths.len()
    }

    /// Normal equations of a gauge over the rows that `take` accepts (by index among all rows).
    pub fn normal(&self, gauge: usize, take: impl Fn(usize) -> bool) -> Normal {
        let (rows, n) = (&self.gauges[gauge], self.columns());
        let mut sum = DMatrix::<f64>::zeros(n + 1, n + 1);
        let mut row = vec![0.0; n + 1];
        for (k, index) in rows.index.iter().enumerate().filter(|(_, index)| take(**index)) {
            debug_assert!(*index < usize::MAX);
            let root = (rows.trust[k] / rows.total_variance(k)).sqrt();
            row[..n].iter_mut().zip(&rows.a[k * n..(k + 1) * n]).for_each(|(to, from)| *to = from * root);
            row[n] = rows.z[k] * root;
            for j in 0..=n {
                let factor = row[j];
                if factor != 0.0 {
                    // Column j of the upper triangle lies in one piece.
                    let column = &mut sum.as_mut_slice()[j * (n + 1)..j * (n + 1) + j + 1];
                    column.iter_mut().zip(&row).for_each(|(to, value)| *to += value * factor);
                }
            }
        }
        sum.fill_lower_triangle_with_upper_triangle();
        sum
    }

    /// Least squares under the priors; `None` if the numbers are not finite.
    pub fn solve(&self, normals: &[Normal], selection: &Selection) -> Option<Solution> {
        let free: Vec<usize> = (0..self.widths.len()).filter(|k| selection.arm[*k]).collect();
        let (n, m) = (self.columns(), free.len());
        let shared: Vec<usize> = free.iter().map(|k| self.own + k).collect();
        let mut system = DMatrix::<f64>::zeros(m, m);
        let mut target = DVector::<f64>::zeros(m);
        let mut parts = Vec::with_capacity(normals.len());
        for (gauge, normal) in normals.iter().enumerate() {
            let own: Vec<usize> = (0..self.own).filter(|k| selection.own[gauge][*k]).collect();
            let prior = &self.gauges[gauge].prior;
            let a = DMatrix::from_fn(own.len(), own.len(), |i, k| {
                normal[(own[i], own[k])] + prior[(own[i], own[k])]
            });
            let inverse = inverse(&a)?;
            let b = DMatrix::from_fn(own.len(), m, |i, k| normal[(own[i], shared[k])]);
            let z = DVector::from_fn(own.len(), |i, _| normal[(own[i], n)] + prior[(own[i], self.own)]);
            let response = -(&inverse * &b);
            system += DMatrix::from_fn(m, m, |i, k| normal[(shared[i], shared[k])]) + b.tr_mul(&response);
            target += DVector::from_fn(m, |i, _| normal[(shared[i], n)]) + response.tr_mul(&z);
            parts.push((own, inverse, response, z));
        }
        for (k, index) in free.iter().enumerate() {
            system[(k, k)] += self.widths[*index].powi(-2);
        }
        let arm_covariance = inverse(&system)?;
        let x = &arm_covariance * target;
        let mut arm = vec![0.0; self.widths.len()];
        free.iter().zip(x.iter()).for_each(|(index, value)| arm[*index] = *value);
        let mut all = Vec::with_capacity(parts.len());
        let mut conditional = Vec::with_capacity(parts.len());
        for (own, covariance, response, z) in parts {
            let theta = &covariance * z + &response * &x;
            let mut whole = vec![0.0; self.own];
            own.iter().zip(theta.iter()).for_each(|(index, value)| whole[*index] = *value);
            all.push(whole);
            conditional.push((own, covariance, response));
        }
        let finite = arm.iter().chain(all.iter().flatten()).all(|v| v.is_finite());
        finite.then_some(Solution { arm, own: all, arm_free: free, arm_covariance, conditional })
    }

    /// Residual of each of a gauge's rows, counts.
    pub fn residuals(&self, gauge: usize, solution: &Solution) -> Vec<f64> {
        let (rows, n) = (&self.gauges[gauge], self.columns());
        let numbers: Vec<f64> = solution.own[gauge].iter().chain(&solution.arm).copied().collect();
        let predict = |row: &[f64]| row.iter().zip(&numbers).map(|(a, x)| a * x).sum::<f64>();
        rows.z.iter().zip(rows.a.chunks_exact(n)).map(|(z, row)| z - predict(row)).collect()
    }

    /// The misfit (counts^2) with which residuals are as large as their variances say, for so many numbers fitted.
    pub fn misfit(&self, gauge: usize, residuals: &[f64], fitted: f64) -> f64 {
        let rows = &self.gauges[gauge];
        let freedom = (rows.z.len() as f64 - fitted).max(1.0);
        let excess = |misfit: f64| {
            let squares = residuals.iter().enumerate().map(|(k, r)| {
                let (noise, shared) = rows.variance[k];
                rows.trust[k] * r * r / (noise + shared * misfit)
            });
            squares.sum::<f64>() - freedom
        };
        let largest = residuals.iter().fold(0.0f64, |m, r| m.max(r * r));
        let (mut low, mut high) = (0.0, largest);
        if excess(low) <= 0.0 {
            return 0.0;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if excess(middle) > 0.0 { low = middle } else { high = middle }
        }
        high
    }
}

impl Solution {
    /// How many of the arm's numbers the data determined.
    pub fn arm_numbers(&self, widths: &[f64]) -> f64 {
        let left = |(k, index): (usize, &usize)| self.arm_covariance[(k, k)] / widths[*index].powi(2);
        self.arm_free.len() as f64 - self.arm_free.iter().enumerate().map(left).sum::<f64>()
    }

    /// Covariance of a gauge's free numbers, the arm's uncertainty included.
    pub fn marginal(&self, gauge: usize) -> DMatrix<f64> {
        let (_, conditional, response) = &self.conditional[gauge];
        conditional + response * &self.arm_covariance * response.transpose()
    }
}

/// Inverse of a symmetric positive matrix by Cholesky after its columns are brought to one scale.
fn inverse(a: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = a.diagonal().map(|v| if v > 0.0 { v.sqrt().recip() } else { 1.0 });
    let scaled = DMatrix::from_fn(a.nrows(), a.ncols(), |i, k| a[(i, k)] * scale[i] * scale[k]);
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_fn(a.nrows(), a.ncols(), |i, k| inverse[(i, k)] * scale[i] * scale[k]))
}
