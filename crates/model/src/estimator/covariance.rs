//! Covariances of a least-squares problem's rows: upper triangles, row by row, four columns at a time (what is left of the diagonal means
//! nothing). Lengths of rows are known to the compiler, so that innermost loops are straight lines.

use wide::f64x4;

use super::triangle::Row;

/// The longest row, in fours.
pub(super) const MOST_FOURS: usize = 64;

/// For so many rows, as far as there can be room: rows, and the fours that a row takes.
pub(super) fn room(rows: usize) -> (usize, usize) {
    let rows = rows.min(4 * MOST_FOURS);
    let fours = [2, 4, 16].into_iter().find(|fours| 4 * fours >= rows);
    (rows, fours.unwrap_or(MOST_FOURS))
}

/// Turns a covariance, of which a row is so many fours, into its Cholesky factor, transposed, and rows into whitened ones; false where it is not
/// positive, or not a number.
pub(super) fn eliminate(covariance: &mut [f64x4], fours: usize, rows: &mut [Row]) -> bool {
    match fours {
        2 => eliminate_by::<2>(covariance, rows),
        4 => eliminate_by::<4>(covariance, rows),
        16 => eliminate_by::<16>(covariance, rows),
        _ => eliminate_by::<MOST_FOURS>(covariance, rows),
    }
}

/// Adds to a covariance, of which a row is so many fours, the products of what errors do to its first so many rows, error by error.
pub(super) fn add_products(covariance: &mut [f64x4], fours: usize, effects: &[f64x4], rows: usize) {
    match fours {
        2 => add_products_by::<2>(covariance, effects, rows),
        4 => add_products_by::<4>(covariance, effects, rows),
        16 => add_products_by::<16>(covariance, effects, rows),
        _ => add_products_by::<MOST_FOURS>(covariance, effects, rows),
    }
}

fn eliminate_by<const FOURS: usize>(covariance: &mut [f64x4], rows: &mut [Row]) -> bool {
    let covariance = covariance.as_chunks_mut::<FOURS>().0;
    for k in 0..rows.len().min(covariance.len()) {
        let ((done, after), (white, others)) = (covariance.split_at_mut(k + 1), rows.split_at_mut(k + 1));
        let (mine, white) = (&mut done[k], &mut white[k]);
        let left = mine[k / 4].as_array()[k % 4];
        // Also false for what is not a number.
        if !(left > 0.0 && left < f64::INFINITY) {
            return false;
        }
        // The next row waits for a quotient alone, not for a root as well.
        let reciprocal = left.recip();
        for (i, (row, other)) in (k + 1..).zip(after.iter_mut().zip(others)) {
            let share = mine[i / 4].as_array()[i % 4] * reciprocal;
            // Rows that share no error.
            if share == 0.0 {
                continue;
            }
            other.add(-share, white);
            let share = f64x4::splat(share);
            (0..FOURS).for_each(|at| row[at] -= share * mine[at]);
        }
        let scale = f64x4::splat(reciprocal.sqrt());
        *mine = mine.map(|four| four * scale);
        white.0 = white.0.map(|four| four * scale);
    }
    true
}

fn add_products_by<const FOURS: usize>(matrix: &mut [f64x4], effects: &[f64x4], rows: usize) {
    let (matrix, effects) = (matrix.as_chunks_mut::<FOURS>().0, effects.as_chunks::<FOURS>().0);
    for (k, row) in matrix.iter_mut().take(rows).enumerate() {
        let (four, lane) = (k / 4, k % 4);
        let mut sums = *row;
        for effect in effects {
            let own = f64x4::splat(effect[four].as_array()[lane]);
            (0..FOURS).for_each(|at| sums[at] += own * effect[at]);
        }
        *row = sums;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_have_room_whatever_their_number() {
        assert_eq!(
            [0, 6, 8, 9, 16, 17, 65, 256, 300].map(room).map(|(rows, _)| rows),
            [0, 6, 8, 9, 16, 17, 65, 256, 256]
        );
        assert_eq!(
            [6, 8, 9, 16, 17, 64, 65, 256].map(room).map(|(_, fours)| fours),
            [2, 2, 4, 4, 16, 16, 64, 64]
        );
    }
}
