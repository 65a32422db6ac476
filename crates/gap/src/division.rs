//! Rows to units that leave together, and to blocks that the bootstrap draws.
//!
//! Residuals of neighbouring instants are alike, so what is drawn is a block of neighbours (H. Künsch, Annals of
//! Statistics 17, 1989), and what is left out is a whole recording, or a tenth of one.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::session::HoldOut;

/// Blocks to aim at in all; enough for the tails of a bootstrap, few enough to be longer than what correlates.
const BLOCKS: usize = 60;
const FEWEST_BLOCKS_A_UNIT: usize = 4;
const FOLDS: usize = 10;

/// Rows of one recording, in time order.
pub(crate) struct Recording {
    pub(crate) name: String,
    pub(crate) rows: Range<usize>,
    /// The earlier recording with the same motion and load, by index.
    pub(crate) repeats: Option<usize>,
}

/// The division by recordings, those named `reserved` kept for the final figures. A recording and its repeats are one unit, and
/// what they have at the same time is one block: it would be no news to the other.
pub(crate) fn by_recording(recordings: &[Recording], reserved: &[String]) -> HoldOut {
    let mut units: Vec<String> = Vec::new();
    let mut unit_of: Vec<usize> = Vec::new();
    for recording in recordings {
        unit_of.push(recording.repeats.map_or(units.len(), |first| unit_of[first]));
        match recording.repeats {
            Some(first) => {
                let unit: &mut String = &mut units[unit_of[first]];
                unit.push_str(" with ");
                unit.push_str(&recording.name);
            }
            None => units.push(recording.name.clone()),
        }
    }
    let is_reserved =
        |(recording, unit): (&Recording, &usize)| reserved.contains(&recording.name).then_some(*unit);
    let mut kept: Vec<usize> = recordings.iter().zip(&unit_of).filter_map(is_reserved).collect();
    kept.dedup();
    let words = if reserved.is_empty() {
        format!("left out in turn: {}", units.join(", "))
    } else {
        format!("left out of everything: {}", reserved.join(", "))
    };
    let parts: Vec<(usize, Range<usize>)> =
        unit_of.into_iter().zip(recordings.iter().map(|r| r.rows.clone())).collect();
    divide(units, &parts, kept, words)
}

/// Ten contiguous blocks of time.
pub(crate) fn by_time(rows: usize) -> HoldOut {
    let folds = FOLDS.min(rows);
    let parts: Vec<_> =
        (0..folds).map(|fold| (fold, rows * fold / folds..rows * (fold + 1) / folds)).collect();
    let units = (0..folds).map(|fold| format!("tenth {}", fold + 1)).collect();
    let words = "one recording only: ten contiguous blocks of time left out in turn, so nothing shows whether the \
                 finding holds in another recording";
    divide(units, &parts, Vec::new(), words.to_owned())
}

/// Ten interleaved folds of points without a time order; every point is a block of its own where they are few.
pub(crate) fn by_point(rows: usize) -> HoldOut {
    let folds = FOLDS.min(rows);
    let per_fold = BLOCKS.div_ceil(folds.max(1)).max(FEWEST_BLOCKS_A_UNIT);
    let unit_of_block = (0..folds * per_fold).map(|block| block / per_fold).collect();
    let block_of_row = (0..rows).map(|row| (row % folds) * per_fold + (row / folds) % per_fold).collect();
    let units = (0..folds).map(|fold| format!("fold {}", fold + 1)).collect();
    let words = "points without time order: ten interleaved folds left out in turn".to_owned();
    HoldOut { units, reserved: Vec::new(), unit_of_block, block_of_row, is_even: Vec::new(), words }
}

/// The division of runs by second: what two repeats do at the same time is one block, a block is the even or the odd seconds
/// of a stretch.
pub(crate) fn by_second(recordings: &[Recording], time_s: &[f64]) -> HoldOut {
    if recordings.len() == 1 {
        let all = 0..time_s.len();
        return seconds_of(by_time(time_s.len()), std::slice::from_ref(&all), time_s);
    }
    let rows: Vec<Range<usize>> = recordings.iter().map(|recording| recording.rows.clone()).collect();
    seconds_of(by_recording(recordings, &[]), &rows, time_s)
}

/// Cuts units into blocks of even and odd seconds.
fn seconds_of(coarse: HoldOut, recordings: &[Range<usize>], time_s: &[f64]) -> HoldOut {
    let total_s: f64 = recordings.iter().map(|rows| time_s[rows.end - 1] - time_s[rows.start]).sum();
    let stretch_s = 2.0 * (total_s / BLOCKS as f64 / 2.0).round().max(1.0);
    let mut blocks: BTreeMap<(usize, u64, bool), usize> = BTreeMap::new();
    let mut keys = Vec::with_capacity(time_s.len());
    for rows in recordings {
        for row in rows.clone() {
            let unit = coarse.unit_of_block[coarse.block_of_row[row]];
            let since_s = time_s[row] - time_s[rows.start];
            let is_even = (since_s as u64).is_multiple_of(2);
            // The tenths of a single recording need no common clock, recordings that repeat each other do.
            keys.push((unit, (since_s / stretch_s) as u64, is_even));
        }
    }
    keys.iter().for_each(|key| {
        blocks.insert(*key, 0);
    });
    blocks.values_mut().enumerate().for_each(|(index, block)| *block = index);
    HoldOut {
        unit_of_block: blocks.keys().map(|key| key.0).collect(),
        is_even: blocks.keys().map(|key| key.2).collect(),
        block_of_row: keys.iter().map(|key| blocks[key]).collect(),
        ..coarse
    }
}

fn divide(
    units: Vec<String>,
    parts: &[(usize, Range<usize>)],
    reserved: Vec<usize>,
    words: String,
) -> HoldOut {
    let wanted = (BLOCKS / units.len().max(1)).max(FEWEST_BLOCKS_A_UNIT);
    let mut division = HoldOut {
        units,
        reserved,
        unit_of_block: Vec::new(),
        block_of_row: Vec::new(),
        is_even: Vec::new(),
        words,
    };
    for (unit, rows) in parts {
        let first = division.unit_of_block.iter().position(|known| known == unit);
        let first = first.unwrap_or_else(|| {
            let first = division.unit_of_block.len();
            division.unit_of_block.extend(std::iter::repeat_n(*unit, wanted.min(rows.len())));
            first
        });
        let blocks = division.unit_of_block.iter().filter(|known| *known == unit).count();
        division.block_of_row.extend((0..rows.len()).map(|row| first + row * blocks / rows.len()));
    }
    division
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_in_a_block_of_its_unit_and_blocks_are_contiguous_in_time() {
        let recordings = [("a", 0..100), ("b", 100..103), ("c", 103..1000)].map(|(name, rows)| Recording {
            name: name.to_owned(),
            rows,
            repeats: None,
        });
        let division = by_recording(&recordings, &["c".to_owned()]);
        assert_eq!(division.reserved, [2]);
        assert_eq!(division.block_of_row.len(), 1000);
        assert!(division.block_of_row.is_sorted());
        for recording in
            recordings.iter().enumerate().flat_map(|(unit, r)| r.rows.clone().map(move |row| (unit, row)))
        {
            assert_eq!(division.unit_of_block[division.block_of_row[recording.1]], recording.0);
        }
        assert_eq!(division.unit_of_block.iter().filter(|unit| **unit == 1).count(), 3);
    }

    #[test]
    fn repeats_share_their_unit_and_blocks() {
        let recording = |name: &str, rows, repeats| Recording { name: name.to_owned(), rows, repeats };
        let recordings =
            [recording("a", 0..100, None), recording("b", 100..200, None), recording("c", 200..300, Some(0))];
        let division = by_recording(&recordings, &[]);
        assert_eq!(division.units, ["a with c", "b"]);
        assert_eq!(division.block_of_row[10], division.block_of_row[210]);
        assert!(!division.block_of_row[100..200].contains(&division.block_of_row[10]));
    }

    #[test]
    fn points_are_dealt_out_in_turn() {
        let division = by_point(60);
        assert_eq!(division.unit_of_block[division.block_of_row[23]], 3);
        let mut blocks = division.block_of_row.clone();
        blocks.sort_unstable();
        blocks.dedup();
        assert_eq!(blocks.len(), 60);
    }
}
