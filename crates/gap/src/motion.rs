//! Velocity and acceleration of a recorded position, without lag: a parabola through the neighbours of every instant.
//!
//! A. Savitzky and M. Golay, Analytical Chemistry 36, 1964, for instants that need not be evenly spaced.

use std::ops::Range;

/// Neighbours within this time of an instant count (s); the widest that leaves motion of a few Hz as it is.
const HALF_WINDOW_S: f64 = 0.08;
/// Neighbours to each side that count at least, at most.
const FEWEST: usize = 2;
const MOST: usize = 80;

/// First and second derivative (unit per s, per s^2) of `values` at `time_s`, each segment by itself.
pub(crate) fn differentiate(
    time_s: &[f64],
    values: &[f64],
    segments: &[Range<usize>],
) -> (Vec<f64>, Vec<f64>) {
    let (mut first, mut second) = (vec![0.0; values.len()], vec![0.0; values.len()]);
    for rows in segments {
        for row in rows.clone() {
            let low = neighbour(time_s, rows, row, false);
            let high = neighbour(time_s, rows, row, true);
            if let Some((slope, curve)) = parabola(&time_s[low..=high], &values[low..=high], time_s[row]) {
                (first[row], second[row]) = (slope, curve);
            }
        }
    }
    (first, second)
}

/// The farthest row of the segment that counts for `row`.
fn neighbour(time_s: &[f64], rows: &Range<usize>, row: usize, up: bool) -> usize {
    let mut at = row;
    for count in 0..MOST {
        let next = if up { at + 1 } else { at.wrapping_sub(1) };
        if !rows.contains(&next) || (count >= FEWEST && (time_s[next] - time_s[row]).abs() > HALF_WINDOW_S) {
            break;
        }
        at = next;
    }
    at
}

/// Slope and curvature at `at_s` of the least-squares parabola.
fn parabola(time_s: &[f64], values: &[f64], at_s: f64) -> Option<(f64, f64)> {
    let span_s = (time_s.last()? - time_s.first()?).max(f64::MIN_POSITIVE);
    let origin = values[values.len() / 2];
    let mut normal = nalgebra::Matrix3::zeros();
    let mut right = nalgebra::Vector3::zeros();
    for (t_s, value) in time_s.iter().zip(values) {
        let u = (t_s - at_s) / span_s;
        let row = nalgebra::Vector3::new(1.0, u, u * u);
        normal += row * row.transpose();
        right += row * (value - origin);
    }
    let solution = normal.cholesky()?.solve(&right);
    Some((solution[1] / span_s, 2.0 * solution[2] / (span_s * span_s)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_slow_sine_keeps_its_derivatives() {
        let time_s: Vec<f64> = (0..400).map(|k| f64::from(k) * 0.01 + 0.001 * f64::from(k % 3)).collect();
        let values: Vec<f64> = time_s.iter().map(|t| (3.0 * t).sin()).collect();
        let (first, second) = differentiate(&time_s, &values, &[0..200, 200..400]);
        for row in (20..180).chain(220..380) {
            assert!((first[row] - 3.0 * (3.0 * time_s[row]).cos()).abs() < 0.03, "{row}");
            assert!((second[row] + 9.0 * (3.0 * time_s[row]).sin()).abs() < 0.2, "{row}");
        }
    }
}
