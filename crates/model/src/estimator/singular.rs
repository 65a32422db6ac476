//! Singular values of a triangle that a QR left, by one-sided Jacobi rotations.

use nalgebra::Matrix6;
use wide::{f64x2, f64x4};

/// A row of six.
type Row = [f64x2; 3];

/// Every row with every other in five rounds: the three pairs of a round have nothing in common, so that they are turned at once (R. Brent,
/// F. Luk, The solution of singular-value and symmetric eigenvalue problems on multiprocessor arrays, 1985).
const ROUNDS: [[(usize, usize); 3]; 5] = [
    [(0, 1), (2, 3), (4, 5)],
    [(0, 2), (1, 4), (3, 5)],
    [(0, 4), (2, 5), (1, 3)],
    [(0, 5), (3, 4), (1, 2)],
    [(0, 3), (1, 5), (2, 4)],
];

/// What is left of a sweep is about the square of what it met: after one with such tangents (squared) rotations are but estimated.
const NEARLY: f64 = 1e-5;

/// Where all tangents, squared, are below this, what rotations do to each other changes no digit.
const NOTHING: f64 = 1e-10;

/// Singular values of a 6x6 matrix, largest first, by one-sided Jacobi rotations (accurate for small ones too).
///
/// Bounded: at most 12 sweeps, of which a well-scaled matrix needs three or four. Rows are turned, not columns: those of a triangle that
/// a QR left are nearer to each other's right angle (Z. Drmac, K. Veselic, New fast and accurate Jacobi SVD algorithm I, 2008).
pub fn singular_values(matrix: &Matrix6<f64>) -> [f64; 6] {
    let pair = |i: usize, k: usize| f64x2::new([matrix[(i, k)], matrix[(i, k + 1)]]);
    let mut rows: [Row; 6] = std::array::from_fn(|i| [pair(i, 0), pair(i, 2), pair(i, 4)]);
    let mut squares = rows.map(|row| dot(&row, &row));
    for _ in 0..12 {
        let steepest = sweep(&mut squares, |squares, pairs| turn(&mut rows, squares, pairs));
        squares = rows.map(|row| dot(&row, &row));
        if steepest > NEARLY {
            continue;
        }
        // The last sweep changes lengths so little that no row need be turned for it.
        let mut last = squares;
        if sweep(&mut last, |_, pairs| Rotations::of(&rows, &squares, pairs)) <= NOTHING {
            squares = last;
            break;
        }
    }
    let mut values = squares.map(f64::sqrt);
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// Every row with every other once, by rotations that keep the squares of their lengths; the largest square of a tangent.
#[inline]
fn sweep(squares: &mut [f64; 6], mut by: impl FnMut(&[f64; 6], &[(usize, usize); 3]) -> Rotations) -> f64 {
    let mut steepest = f64x4::ZERO;
    for pairs in &ROUNDS {
        let Rotations { tangent, lost, .. } = by(squares, pairs);
        steepest = steepest.fast_max(tangent * tangent);
        for (lane, (i, k)) in pairs.iter().enumerate() {
            squares[*i] -= lost.as_array()[lane];
            squares[*k] += lost.as_array()[lane];
        }
    }
    steepest.as_array().iter().copied().fold(0.0, f64::max)
}

/// What makes the rows of three pairs orthogonal, one pair a lane.
struct Rotations {
    tangent: f64x4,
    /// What the first row's length squared loses to the second's.
    lost: f64x4,
}

impl Rotations {
    #[inline]
    fn of(rows: &[Row; 6], squares: &[f64; 6], pairs: &[(usize, usize); 3]) -> Self {
        let [a, b, c] = *pairs;
        let xy = f64x4::new([
            dot(&rows[a.0], &rows[a.1]),
            dot(&rows[b.0], &rows[b.1]),
            dot(&rows[c.0], &rows[c.1]),
            0.0,
        ]);
        let first = f64x4::new([squares[a.0], squares[b.0], squares[c.0], 0.0]);
        let second = f64x4::new([squares[a.1], squares[b.1], squares[c.1], 0.0]);
        let (xy2, apart) = (xy * xy, second - first);
        // False also for what is not a number.
        let is_askew = xy2.simd_gt(first * second * 1e-18);
        let across = apart.simd_lt(f64x4::ZERO).select(xy * -2.0, xy * 2.0);
        let tangent = across / (apart.abs() + (apart * apart + xy2 * 4.0).sqrt());
        let tangent = is_askew.select(tangent, f64x4::ZERO);
        Self { tangent, lost: tangent * xy }
    }
}

/// Turns the rows of three pairs against each other until they are orthogonal.
#[inline]
fn turn(rows: &mut [Row; 6], squares: &[f64; 6], pairs: &[(usize, usize); 3]) -> Rotations {
    let rotations = Rotations::of(rows, squares, pairs);
    let tangent = rotations.tangent;
    let cosine = f64x4::ONE / (tangent * tangent + 1.0).sqrt();
    let sine = cosine * tangent;
    for (lane, (i, k)) in pairs.iter().enumerate() {
        let (c, s) = (f64x2::splat(cosine.as_array()[lane]), f64x2::splat(sine.as_array()[lane]));
        let (x, y) = (rows[*i], rows[*k]);
        for part in 0..3 {
            rows[*i][part] = x[part] * c - y[part] * s;
            rows[*k][part] = x[part] * s + y[part] * c;
        }
    }
    rotations
}

#[inline]
fn dot(a: &Row, b: &Row) -> f64 {
    (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]).reduce_add()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
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
}
