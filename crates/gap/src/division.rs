//! Rows to units that leave together, and to blocks that the bootstrap draws.
//!
//! Residuals of neighbouring instants are alike, so what is drawn is a block of neighbours (H. Künsch, Annals of
//! Statistics 17, 1989), and what is left out is a whole recording, or a tenth of one.

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
}

/// The division by recordings, those named `reserved` kept for the final figures.
pub(crate) fn by_recording(recordings: &[Recording], reserved: &[String]) -> HoldOut {
    let units: Vec<String> = recordings.iter().map(|r| r.name.clone()).collect();
    let kept = (0..units.len()).filter(|unit| reserved.contains(&units[*unit])).collect();
    let words = if reserved.is_empty() {
        format!("each of {} recordings left out in turn", units.len())
    } else {
        format!("recordings {} left out of everything", reserved.join(", "))
    };
    divide(units, recordings.iter().map(|r| r.rows.clone()).enumerate(), kept, words)
}

/// Ten contiguous blocks of time.
pub(crate) fn by_time(rows: usize) -> HoldOut {
    let folds = FOLDS.min(rows);
    let parts = (0..folds).map(|fold| (fold, rows * fold / folds..rows * (fold + 1) / folds));
    let units = (0..folds).map(|fold| format!("tenth {}", fold + 1)).collect();
    let words = "one recording only: ten contiguous blocks of time left out in turn, so nothing shows whether the \
                 finding holds in another recording";
    divide(units, parts, Vec::new(), words.to_owned())
}

/// Ten interleaved folds of points without a time order; every point is a block of its own where they are few.
pub(crate) fn by_point(rows: usize) -> HoldOut {
    let folds = FOLDS.min(rows);
    let per_fold = BLOCKS.div_ceil(folds.max(1)).max(FEWEST_BLOCKS_A_UNIT);
    let unit_of_block = (0..folds * per_fold).map(|block| block / per_fold).collect();
    let block_of_row = (0..rows).map(|row| (row % folds) * per_fold + (row / folds) % per_fold).collect();
    let units = (0..folds).map(|fold| format!("fold {}", fold + 1)).collect();
    let words = "points without time order: ten interleaved folds left out in turn".to_owned();
    HoldOut { units, reserved: Vec::new(), unit_of_block, block_of_row, words }
}

fn divide(
    units: Vec<String>,
    parts: impl Iterator<Item = (usize, Range<usize>)>,
    reserved: Vec<usize>,
    words: String,
) -> HoldOut {
    let wanted = (BLOCKS / units.len().max(1)).max(FEWEST_BLOCKS_A_UNIT);
    let mut division = HoldOut { units, reserved, unit_of_block: Vec::new(), block_of_row: Vec::new(), words };
    for (unit, rows) in parts {
        let blocks = wanted.min(rows.len());
        let first = division.unit_of_block.len();
        division.unit_of_block.extend(std::iter::repeat_n(unit, blocks));
        division.block_of_row.extend((0..rows.len()).map(|row| first + row * blocks / rows.len()));
    }
    division
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_row_is_in_a_block_of_its_unit_and_blocks_are_contiguous_in_time() {
        let recordings = [("a", 0..100), ("b", 100..103), ("c", 103..1000)]
            .map(|(name, rows)| Recording { name: name.to_owned(), rows });
        let division = by_recording(&recordings, &["c".to_owned()]);
        assert_eq!(division.reserved, [2]);
        assert_eq!(division.block_of_row.len(), 1000);
        assert!(division.block_of_row.is_sorted());
        for recording in recordings.iter().enumerate().flat_map(|(unit, r)| r.rows.clone().map(move |row| (unit, row))) {
            assert_eq!(division.unit_of_block[division.block_of_row[recording.1]], recording.0);
        }
        assert_eq!(division.unit_of_block.iter().filter(|unit| **unit == 1).count(), 3);
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
