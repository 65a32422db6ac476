//! Which blocks are fitted on and which are scored, outside (final figures) and inside (selection).

use crate::candidates::Training;
use crate::fit::Fold;
use crate::session::HoldOut;

/// Folds at most; more units share folds.
const MOST_FOLDS: usize = 10;

/// Outer folds: blocks scored in the end, with the others to choose and fit on.
pub(crate) fn outer(hold_out: &HoldOut) -> Vec<Fold> {
    let units: Vec<usize> = (0..hold_out.units.len()).collect();
    if hold_out.reserved.is_empty() {
        return leave_out(hold_out, &units);
    }
    let (score, fit) =
        blocks(hold_out).partition(|block| hold_out.reserved.contains(&hold_out.unit_of_block[*block]));
    vec![Fold { fit, score }]
}

/// A training set with its inner folds: by units, or by contiguous stretches where there is but one.
pub(crate) fn training(hold_out: &HoldOut, fit: &[usize], floor: f64) -> Training {
    let mut units: Vec<usize> = fit.iter().map(|block| hold_out.unit_of_block[*block]).collect();
    units.dedup();
    units.sort_unstable();
    units.dedup();
    let folds = if !hold_out.is_even.is_empty() {
        stretches(hold_out, fit, &units)
    } else if units.len() > 1 {
        let inside = |blocks: Vec<usize>| blocks.into_iter().filter(|block| fit.contains(block)).collect();
        leave_out(hold_out, &units)
            .into_iter()
            .map(|fold| Fold { fit: inside(fold.fit), score: inside(fold.score) })
            .collect()
    } else {
        let parts = MOST_FOLDS.min(fit.len());
        let part = |k: usize| fit.len() * k / parts..fit.len() * (k + 1) / parts;
        (0..parts)
            .map(|k| Fold {
                score: fit[part(k)].to_vec(),
                fit: (0..parts)
                    .filter(|other| *other != k)
                    .flat_map(|other| fit[part(other)].to_vec())
                    .collect(),
            })
            .collect()
    };
    Training { blocks: fit.to_vec(), folds, floor }
}

/// Parts of every unit for the folds inside runs: few runs have a load or a motion of their own, and what only one of them shows
/// could otherwise be neither fitted nor judged.
const PARTS: usize = 5;

/// Folds of contiguous stretches, one of every unit.
fn stretches(hold_out: &HoldOut, fit: &[usize], units: &[usize]) -> Vec<Fold> {
    let mut part_of = vec![0; hold_out.unit_of_block.len()];
    for unit in units {
        let own: Vec<usize> =
            fit.iter().copied().filter(|block| hold_out.unit_of_block[*block] == *unit).collect();
        own.iter().enumerate().for_each(|(k, block)| part_of[*block] = k * PARTS / own.len());
    }
    let of = |part: usize, is: bool| fit.iter().copied().filter(|b| (part_of[*b] == part) == is).collect();
    (0..PARTS).map(|part| Fold { fit: of(part, false), score: of(part, true) }).collect()
}

fn blocks(hold_out: &HoldOut) -> impl Iterator<Item = usize> {
    0..hold_out.unit_of_block.len()
}

/// Leaves these units out in turn, several at once where they are many.
fn leave_out(hold_out: &HoldOut, units: &[usize]) -> Vec<Fold> {
    let folds = MOST_FOLDS.min(units.len());
    let fold_of = |unit: usize| units.iter().position(|known| *known == unit).map(|at| at % folds);
    (0..folds)
        .map(|fold| {
            let of = |block: usize| fold_of(hold_out.unit_of_block[block]);
            Fold {
                fit: blocks(hold_out).filter(|block| of(*block).is_some_and(|own| own != fold)).collect(),
                score: blocks(hold_out).filter(|block| of(*block) == Some(fold)).collect(),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hold_out(unit_of_block: Vec<usize>, reserved: Vec<usize>) -> HoldOut {
        let units = (0..3).map(|k| k.to_string()).collect();
        HoldOut {
            units,
            reserved,
            block_of_row: Vec::new(),
            unit_of_block,
            is_even: Vec::new(),
            words: String::new(),
        }
    }

    #[test]
    fn what_is_reserved_is_never_fitted() {
        let division = hold_out(vec![0, 0, 1, 1, 2, 2], vec![1]);
        let folds = outer(&division);
        assert_eq!((folds.len(), folds[0].score.as_slice()), (1, [2, 3].as_slice()));
        let inner = training(&division, &folds[0].fit, 0.0);
        assert_eq!(inner.folds.len(), 2);
        for fold in &inner.folds {
            assert!(fold.fit.iter().chain(&fold.score).all(|block| [0, 1, 4, 5].contains(block)));
            assert!(fold.fit.iter().all(|block| !fold.score.contains(block)));
        }
    }

    #[test]
    fn every_block_is_scored_once_and_never_by_a_fit_on_its_own_unit() {
        let division = hold_out(vec![0, 1, 0, 2, 1], Vec::new());
        let folds = outer(&division);
        let mut scored: Vec<usize> = folds.iter().flat_map(|fold| fold.score.clone()).collect();
        scored.sort_unstable();
        assert_eq!(scored, [0, 1, 2, 3, 4]);
        for fold in &folds {
            let unit = division.unit_of_block[fold.score[0]];
            assert!(fold.fit.iter().all(|block| division.unit_of_block[*block] != unit));
        }
        let alone = training(&division, &[0, 2], 0.0);
        assert_eq!(alone.folds.len(), 2);
        assert_eq!(
            (alone.folds[0].score.as_slice(), alone.folds[0].fit.as_slice()),
            ([0].as_slice(), [2].as_slice())
        );
    }
}
