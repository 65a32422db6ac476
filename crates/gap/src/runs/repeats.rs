//! Which rows of a recording and its repeat belong together: the same motion begun a little earlier or later.

use std::ops::Range;

use crate::division::Recording;

/// A repeat begins at most so many rows earlier or later.
const MOST_ROWS: usize = 250;
/// Rows between two that are compared.
const EVERY: usize = 8;

/// Per repeat the rows of the recording and of itself that show the same instant of the motion.
pub(super) fn repeats(
    recordings: &[Recording],
    motion: &[[Vec<f64>; 3]],
) -> Vec<(Range<usize>, Range<usize>)> {
    let pair = |repeat: &Recording| {
        let first = &recordings[repeat.repeats?];
        Some(aligned(&first.rows, &repeat.rows, motion))
    };
    recordings.iter().filter_map(pair).collect()
}

fn aligned(a: &Range<usize>, b: &Range<usize>, motion: &[[Vec<f64>; 3]]) -> (Range<usize>, Range<usize>) {
    let shortest = a.len().min(b.len());
    let most = MOST_ROWS.min(shortest / 4) as isize;
    let overlap = |lag: isize| {
        let (from_a, from_b) = (a.start + (-lag).max(0) as usize, b.start + lag.max(0) as usize);
        let length = (a.end - from_a).min(b.end - from_b);
        (from_a..from_a + length, from_b..from_b + length)
    };
    let apart = |lag: isize| {
        let (rows_a, rows_b) = overlap(lag);
        let mut sum = 0.0;
        for [position_rad, ..] in motion {
            let pairs = position_rad[rows_a.clone()].iter().zip(&position_rad[rows_b.clone()]).step_by(EVERY);
            sum += pairs.map(|(x, y)| (x - y) * (x - y)).sum::<f64>();
        }
        sum / rows_a.len() as f64
    };
    let best = (-most..=most).min_by(|x, y| apart(*x).total_cmp(&apart(*y))).unwrap_or(0);
    overlap(best)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_repeat_begun_later_is_found() {
        let motion_at = |row: usize| (row as f64 * 0.02).sin() + (row as f64 * 0.007).cos();
        let position: Vec<f64> =
            (0..1000).map(motion_at).chain((0..1000).map(|row| motion_at(row + 17))).collect();
        let recording = |rows, repeats| Recording { name: String::new(), rows, repeats };
        let pairs = repeats(
            &[recording(0..1000, None), recording(1000..2000, Some(0))],
            &[[position, Vec::new(), Vec::new()]],
        );
        assert_eq!(pairs, [(17..1000, 1000..1983)]);
    }
}
