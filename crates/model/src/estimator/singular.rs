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

/// Singular values of a 6x6 matrix, largest first, by one-sided Jacobi rotations (accurate for small ones too).
///
/// Bounded: at most 12 sweeps, of which a well-scaled matrix needs three or four. Rows are turned, not columns: those of a triangle that
/// a QR left are nearer to each other's right angle (Z. Drmac, K. Veselic, New fast and accurate Jacobi SVD algorithm I, 2008).
pub fn singular_values(matrix: &Matrix6<f64>) -> [f64; 6] {
    let pair = |i: usize, k: usize| f64x2::new([matrix[(i, k)], matrix[(i, k + 1)]]);
    let mut rows: [Row; 6] = std::array::from_fn(|i| [pair(i, 0), pair(i, 2), pair(i, 4)]);
    for _ in 0..12 {
        let mut squares = rows.map(|row| dot(&row, &row));
        let mut steepest = f64x4::ZERO;
        for pairs in &ROUNDS {
            steepest = steepest.fast_max(orthogonalise(&mut rows, &mut squares, pairs));
        }
        // What is left after a sweep is the square of what it met, and a length is wrong by the square of that.
        if steepest.as_array().iter().all(|cosine2| *cosine2 < 1e-8) {
            break;
        }
    }
    let mut values = rows.map(|row| dot(&row, &row).sqrt());
    values.sort_by(|a, b| b.total_cmp(a));
    values
}

/// Turns the rows of three pairs against each other until they are orthogonal, and keeps the squares of their lengths; the squares of the
/// cosines between them before, 0 where that says nothing.
#[inline]
fn orthogonalise(rows: &mut [Row; 6], squares: &mut [f64; 6], pairs: &[(usize, usize); 3]) -> f64x4 {
    let [a, b, c] = *pairs;
    let of = |value: &dyn Fn((usize, usize)) -> f64| f64x4::new([value(a), value(b), value(c), 0.0]);
    let xy = of(&|(i, k)| dot(&rows[i], &rows[k]));
    let (first, second) = (of(&|(i, _)| squares[i]), of(&|(_, k)| squares[k]));
    let (xy2, product, apart) = (xy * xy, first * second, second - first);
    // False also for what is not a number.
    let is_askew = xy2.simd_gt(product * 1e-18);
    let across = apart.simd_lt(f64x4::ZERO).select(xy * -2.0, xy * 2.0);
    let tangent = across / (apart.abs() + (apart * apart + xy2 * 4.0).sqrt());
    let tangent = is_askew.select(tangent, f64x4::ZERO);
    let cosine = f64x4::ONE / (tangent * tangent + 1.0).sqrt();
    let (sine, lost) = (cosine * tangent, tangent * xy);
    for (lane, (i, k)) in pairs.iter().enumerate() {
        let (c, s) = (f64x2::splat(cosine.as_array()[lane]), f64x2::splat(sine.as_array()[lane]));
        let (x, y) = (rows[*i], rows[*k]);
        for part in 0..3 {
            rows[*i][part] = x[part] * c - y[part] * s;
            rows[*k][part] = x[part] * s + y[part] * c;
        }
        squares[*i] -= lost.as_array()[lane];
        squares[*k] += lost.as_array()[lane];
    }
    is_askew.select(xy2 / product, f64x4::ZERO)
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
