//! Rows of a least-squares problem brought to an upper triangle by Householder reflections (G. Golub, C. Van Loan, Matrix
//! Computations, ch. 5), with columns known to the compiler so that it works on several at once.

use nalgebra::Matrix6;
use wide::f64x4;

/// Place of the right-hand side.
const TARGET: usize = 6;

/// One equation: six unknowns, the right-hand side, and nothing, so that four columns at a time come out even.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Row(pub(super) [f64x4; 2]);

impl Row {
    /// Of factors of the unknowns and a right-hand side.
    pub(super) fn new(factors: &[f64; 6], target: f64) -> Self {
        let [a, b, c, d, e, f] = *factors;
        Self([f64x4::new([a, b, c, d]), f64x4::new([e, f, target, 0.0])])
    }

    /// Right-hand side.
    #[inline]
    pub(super) fn target(&self) -> f64 {
        self.at(TARGET)
    }

    /// Factors of the unknowns.
    #[inline]
    pub(super) fn factors(&self) -> [f64; 6] {
        std::array::from_fn(|c| self.at(c))
    }

    #[inline]
    pub(super) fn at(&self, column: usize) -> f64 {
        self.0[column / 4].as_array()[column % 4]
    }

    /// Each column times a factor of its own.
    #[inline]
    pub(super) fn times(&self, factors: &Self) -> Self {
        Self([self.0[0] * factors.0[0], self.0[1] * factors.0[1]])
    }

    /// Adds a multiple of another row.
    #[inline]
    pub(super) fn add(&mut self, factor: f64, other: &Self) {
        self.add_from::<0>(f64x4::splat(factor), other);
    }

    /// The same from a half on.
    #[inline]
    fn add_from<const HALF: usize>(&mut self, factor: f64x4, other: &Self) {
        (HALF..2).for_each(|half| self.0[half] += factor * other.0[half]);
    }
}

/// Rows brought to an upper triangle.
#[derive(Clone, Debug, Default)]
pub(super) struct Triangle {
    /// What is right of the diagonal, and the right-hand side.
    rows: [Row; 6],
    diagonal: [f64; 6],
    /// What no unknowns explain, squared.
    pub(super) residual2: f64,
}

impl Triangle {
    /// Of at least six rows, which are turned.
    pub(super) fn of(rows: &mut [Row]) -> Self {
        let diagonal = [
            reflect::<0, 0>(rows),
            reflect::<1, 0>(&mut rows[1..]),
            reflect::<2, 0>(&mut rows[2..]),
            reflect::<3, 0>(&mut rows[3..]),
            reflect::<4, 1>(&mut rows[4..]),
            reflect::<5, 1>(&mut rows[5..]),
        ];
        let (top, rest) = rows.split_at(6);
        Self {
            rows: std::array::from_fn(|k| top[k]),
            diagonal,
            residual2: rest.iter().map(|row| row.target() * row.target()).sum(),
        }
    }

    /// The triangle as a matrix.
    pub(super) fn unknowns(&self) -> Matrix6<f64> {
        let mut matrix = Matrix6::zeros();
        for i in 0..6 {
            matrix[(i, i)] = self.diagonal[i];
            (i + 1..6).for_each(|k| matrix[(i, k)] = self.rows[i].at(k));
        }
        matrix
    }

    /// The least and the most of the diagonal's absolute values.
    pub(super) fn diagonal_range(&self) -> (f64, f64) {
        let sizes = self.diagonal.map(f64::abs);
        (sizes.iter().copied().fold(f64::INFINITY, f64::min), sizes.iter().copied().fold(0.0, f64::max))
    }

    /// The unknowns, by substitution backwards.
    pub(super) fn solution(&self) -> [f64; 6] {
        let reciprocals = self.diagonal.map(f64::recip);
        let mut x: [f64; 6] = std::array::from_fn(|i| self.rows[i].target());
        for k in (0..6).rev() {
            x[k] *= reciprocals[k];
            (0..k).for_each(|i| x[i] -= self.rows[i].at(k) * x[k]);
        }
        x
    }

    /// Inverse of the triangle, whose diagonal must have no zero; row by row, zero below the diagonal.
    pub(super) fn inverse(&self) -> [Row; 6] {
        let mut inverse = [Row::default(); 6];
        for i in (0..6).rev() {
            let mut row = Row::new(&std::array::from_fn(|k| f64::from(u8::from(k == i))), 0.0);
            for k in i + 1..6 {
                row.add(-self.rows[i].at(k), &inverse[k]);
            }
            let reciprocal = f64x4::splat(self.diagonal[i].recip());
            inverse[i] = Row(row.0.map(|half| half * reciprocal));
        }
        inverse
    }
}

/// Householder reflection that turns column `K` of the rows into a multiple of the first unit vector, which it returns; columns up to
/// `K` are left without meaning, those before `HALF` fours as they were.
fn reflect<const K: usize, const HALF: usize>(rows: &mut [Row]) -> f64 {
    // Products of column K with all columns: with itself the length, squared.
    let (pairs, rest) = rows.as_chunks::<2>();
    let mut sums = [Row::default(); 2];
    for pair in pairs {
        (0..2).for_each(|k| sums[k].add_from::<HALF>(f64x4::splat(pair[k].at(K)), &pair[k]));
    }
    for row in rest {
        sums[0].add_from::<HALF>(f64x4::splat(row.at(K)), row);
    }
    let mut along = sums[0];
    along.add_from::<HALF>(f64x4::ONE, &sums[1]);
    let (lead, length2) = (rows[0].at(K), along.at(K));
    // Away from the lead, so that nothing cancels.
    let diagonal = -length2.sqrt().copysign(lead);
    if diagonal == 0.0 {
        return 0.0;
    }
    // The mirror's normal is column K with `lead - diagonal` in place of the lead.
    along.add_from::<HALF>(f64x4::splat(-diagonal), &rows[0]);
    let scale = (length2 - diagonal * lead).recip();
    let (first, rest) = rows.split_at_mut(1);
    first[0].add_from::<HALF>(f64x4::splat((diagonal - lead) * scale), &along);
    for row in rest {
        row.add_from::<HALF>(f64x4::splat(-row.at(K) * scale), &along);
    }
    diagonal
}
