//! Streaming least squares: the upper triangle of a QR factorisation, one block of rows at a time, in constant memory.

/// The triangle `R` of `[A, y]` with `N` columns, the last being the right-hand side.
///
/// Rows wait in a block; a full block is folded in by Householder reflections. `R' R` equals the sum of
/// the rows' outer products, but is never formed, so no digits are lost by squaring.
#[derive(Clone, Debug)]
pub struct Triangle<const N: usize> {
    /// Column by column.
    top: [[f64; N]; N],
    /// Waiting rows, column by column.
    block: [[f64; BLOCK]; N],
    waiting: usize,
    rows: u64,
}

/// Rows folded in at once: so many that the triangle's own row costs little, so few that all columns stay in the nearest cache.
const BLOCK: usize = 32;

/// Sums that run beside each other, for a processor that adds several numbers at once.
const LANES: usize = 8;

impl<const N: usize> Default for Triangle<N> {
    fn default() -> Self {
        Self { top: [[0.0; N]; N], block: [[0.0; BLOCK]; N], waiting: 0, rows: 0 }
    }
}

impl<const N: usize> Triangle<N> {
    /// Adds one row.
    #[inline]
    pub fn add(&mut self, row: &[f64; N]) {
        for (column, value) in self.block.iter_mut().zip(row) {
            column[self.waiting] = *value;
        }
        self.waiting += 1;
        self.rows += 1;
        if self.waiting == BLOCK {
            self.fold();
        }
    }

    /// Adds all the rows of another triangle.
    pub fn merge(&mut self, other: &Self) {
        let rows = self.rows + other.rows;
        for row in other.clone().finish() {
            self.add(&row);
        }
        self.rows = rows;
    }

    /// Number of rows added.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// The triangle, row by row.
    pub fn finish(mut self) -> [[f64; N]; N] {
        self.fold();
        let mut out = [[0.0; N]; N];
        for k in 0..N {
            for j in k..N {
                out[k][j] = self.top[j][k];
            }
        }
        out
    }

    /// Householder reflections take the waiting rows into the triangle. Row k of the triangle and the block are
    /// all that column k's reflection touches.
    fn fold(&mut self) {
        // Rows of zeros change nothing, and loops of a fixed length are the quickest.
        for column in &mut self.block {
            column[self.waiting..].fill(0.0);
        }
        for k in 0..N {
            let (left, right) = self.block.split_at_mut(k + 1);
            let pivot = &left[k];
            let below = dot(pivot, pivot);
            if below == 0.0 {
                continue;
            }
            let head = self.top[k][k];
            let norm = -(head * head + below).sqrt().copysign(head);
            let lead = head - norm;
            let scale = 1.0 / (norm * lead);
            self.top[k][k] = norm;
            for (column, top) in right.iter_mut().zip(&mut self.top[k + 1..]) {
                let factor = (lead * top[k] + dot(pivot, column)) * scale;
                top[k] += factor * lead;
                for (value, pivot) in column.iter_mut().zip(pivot) {
                    *value += factor * pivot;
                }
            }
        }
        self.waiting = 0;
    }
}

#[inline]
fn dot(a: &[f64; BLOCK], b: &[f64; BLOCK]) -> f64 {
    let mut sums = [0.0; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for ((sum, a), b) in sums.iter_mut().zip(a).zip(b) {
            *sum += a * b;
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    fn gram<const N: usize>(r: &[[f64; N]; N]) -> DMatrix<f64> {
        let r = DMatrix::from_fn(N, N, |i, k| r[i][k]);
        r.transpose() * r
    }

    proptest! {
        #[test]
        fn the_triangle_has_the_rows_gram_matrix(values in prop::collection::vec(-10.0..10.0f64, 5..600), cut in 0usize..100) {
            let rows: Vec<[f64; 5]> = values.chunks_exact(5).map(|c| c.try_into().unwrap()).collect();
            let a = DMatrix::from_fn(rows.len(), 5, |i, k| rows[i][k]);
            let (mut first, mut second) = (Triangle::<5>::default(), Triangle::<5>::default());
            for (k, row) in rows.iter().enumerate() {
                if k < cut { first.add(row) } else { second.add(row) }
            }
            first.merge(&second);
            prop_assert_eq!(first.rows(), rows.len() as u64);
            let difference = gram(&first.finish()) - a.transpose() * &a;
            prop_assert!(difference.amax() < 1e-9 * (1.0 + (a.transpose() * a).amax()));
        }
    }

    #[test]
    fn nothing_added_is_a_zero_triangle() {
        assert_eq!(Triangle::<3>::default().finish(), [[0.0; 3]; 3]);
    }
}
