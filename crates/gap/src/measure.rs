//! How large the gap is, how far it shrinks, and what that comes to.

use crate::attribute::{self, Chosen, Subsets};
use crate::bootstrap::{Bootstrap, quantile, weighted};
use crate::diagnosis::{Gap, Raw, Verdict};
use crate::library::Library;
use crate::refit;

/// After at most so many floors, or with this shrink, a gap is explained.
const NEAR_FLOOR: f64 = 1.15;
const EXPLAINED: f64 = 0.9;
const PARTLY: f64 = 0.3;
/// A block stands out with so many times the mean square that is allowed, over so many values.
const FAR: f64 = 5.0;
const FEWEST_VALUES: f64 = 200.0;

/// The gap on scored blocks, in sums of squares over the channels' scales.
pub(crate) struct Measure<'a> {
    before: Vec<f64>,
    after: Vec<f64>,
    reducible_blocks: Vec<f64>,
    values: Vec<f64>,
    /// Mean square that noise leaves.
    floor: f64,
    /// Mean square up to which the gap may be nothing: noise as foretold, and the simulation's own uncertainty.
    allowed: f64,
    is_found: bool,
    /// Per draw of the bootstrap what is left of the scored blocks, parameters fitted anew.
    refitted: Vec<f64>,
    bootstrap: &'a Bootstrap,
}

impl<'a> Measure<'a> {
    /// `floors`: per channel the mean square that noise leaves.
    pub(crate) fn new(
        library: &Library<'_>,
        subsets: &Subsets,
        chosen: &[Chosen],
        floors: &[f64],
        bootstrap: &'a Bootstrap,
    ) -> Self {
        let session = library.session;
        let has_events = chosen.iter().flat_map(|part| &part.terms).any(|id| library.terms[*id].is_event());
        let mut counts = vec![false; session.blocks()];
        for block in chosen.iter().flat_map(|part| &part.fold.score) {
            // What was fitted on even seconds is judged on the odd ones.
            counts[*block] = !(has_events && session.hold_out.is_even(*block));
        }
        let (mut values, mut floor, mut doubts) = (vec![0.0; session.blocks()], 0.0, 0.0);
        for (channel, own_floor) in session.channels.iter().zip(floors) {
            for (row, block) in session.hold_out.block_of_row.iter().enumerate() {
                if counts[*block] && channel.is_read(row) {
                    values[*block] += 1.0;
                    floor += own_floor;
                }
            }
        }
        for doubt in &library.doubts {
            let own = library.pair(*doubt, *doubt);
            let sums = own.iter().flat_map(|(own, _)| (0..counts.len()).map(|block| own.at(block, 0, 0)));
            doubts += sums.zip(&counts).filter(|(_, counts)| **counts).map(|(sum, _)| sum).sum::<f64>();
        }
        let all = values.iter().sum::<f64>().max(1.0);
        let scored = |residuals: &[f64]| -> Vec<f64> {
            residuals.iter().zip(&counts).map(|(r, counts)| if *counts { *r } else { 0.0 }).collect()
        };
        let (before, after) = (scored(subsets.before()), scored(subsets.after()));
        // What is left is no more than noise, whatever was said of the noise.
        let floor = (floor / all).min(after.iter().sum::<f64>() / all);
        let reducible_blocks = before.iter().zip(&values).map(|(b, n)| b - floor * n).collect();
        let told: f64 = session.channels.iter().map(|channel| channel.floor.powi(2)).sum();
        let allowed = floor.max(told / session.channels.len().max(1) as f64) + doubts / all;
        let is_found = !subsets.effects.is_empty() && floor > 0.0;
        let refitted = refit::left(library, chosen, &counts, bootstrap);
        Self { before, after, reducible_blocks, values, floor, allowed, is_found, refitted, bootstrap }
    }

    /// Share of the reducible gap that an effect takes away, from its part of every block, with its interval of 95 %.
    pub(crate) fn share(&self, parts: &[f64]) -> (f64, [f64; 2]) {
        let scored: Vec<f64> =
            parts.iter().zip(&self.values).map(|(part, n)| if *n > 0.0 { *part } else { 0.0 }).collect();
        let share = scored.iter().sum::<f64>() / self.reducible().max(f64::MIN_POSITIVE);
        (share, attribute::interval(self.bootstrap, &scored, &self.reducible_blocks))
    }

    fn reducible(&self) -> f64 {
        self.reducible_blocks.iter().sum()
    }

    fn rms(&self, squares: &[f64]) -> f64 {
        (squares.iter().sum::<f64>() / self.values.iter().sum::<f64>().max(1.0)).sqrt()
    }

    fn removed(&self) -> Vec<f64> {
        self.before.iter().zip(&self.after).map(|(b, a)| b - a).collect()
    }

    /// Interval of 95 % of the shrink: the spread over draws about the estimate. A draw holds fewer different blocks to fit on than
    /// there are, so that its middle is too low, but not its spread.
    fn shrink_interval(&self, shrink: f64) -> [f64; 2] {
        let of_draw = |(weights, left): (&Vec<f64>, &f64)| {
            let reducible = weighted(weights, &self.reducible_blocks);
            (reducible > 0.0).then(|| (weighted(weights, &self.before) - left) / reducible)
        };
        let mut draws: Vec<f64> =
            self.bootstrap.draws().iter().zip(&self.refitted).filter_map(of_draw).collect();
        draws.sort_by(f64::total_cmp);
        [0.025, 0.975].map(|share| shrink + quantile(&draws, share) - quantile(&draws, 0.5))
    }

    /// Nothing beyond noise: the interval of the gap reaches down to the floor, and neither an effect nor a single block stands out
    /// although the sum over all channels does not show it. A gap of exactly nothing is none either.
    fn is_noise(&self) -> bool {
        let lowest = attribute::interval(self.bootstrap, &self.before, &self.values)[0];
        (!self.is_found && lowest <= self.allowed && !self.stands_out())
            || self.before.iter().all(|b| *b == 0.0)
    }

    /// Whether some block holds far more than noise and doubt: drawing blocks, few that hold everything may be missed.
    fn stands_out(&self) -> bool {
        let far = |(before, values): (&f64, &f64)| {
            *values >= FEWEST_VALUES && *before > FAR * self.allowed * values
        };
        self.allowed > 0.0 && self.before.iter().zip(&self.values).any(far)
    }

    fn shrink(&self) -> Option<f64> {
        if self.is_noise() { None } else { self.removed_share() }
    }

    /// Share of the reducible gap that goes away, whether or not there is more than noise; none where there is nothing to reduce.
    pub(crate) fn removed_share(&self) -> Option<f64> {
        (self.reducible() > 0.0).then(|| self.removed().iter().sum::<f64>() / self.reducible())
    }

    /// Whether the interval of the shrink holds shrinks only.
    pub(crate) fn surely_shrinks(&self) -> bool {
        self.shrink().is_none_or(|shrink| self.shrink_interval(shrink)[0] > 0.0)
    }

    /// What it comes to.
    pub(crate) fn verdict(&self) -> Verdict {
        let Some(shrink) = self.shrink() else { return Verdict::NoGap };
        let near = self.floor > 0.0 && self.rms(&self.after) <= NEAR_FLOOR * self.floor.sqrt();
        if shrink >= EXPLAINED || (near && self.is_found) {
            Verdict::Explained
        } else if shrink >= PARTLY {
            Verdict::PartlyExplained
        } else {
            Verdict::Unexplained
        }
    }

    /// The gap as figures.
    pub(crate) fn gap(&self, raw: Raw) -> Gap {
        Gap {
            before: self.rms(&self.before),
            after: self.rms(&self.after),
            floor: self.floor.sqrt(),
            shrink: self.shrink(),
            shrink_ci95: self.shrink().map(|shrink| self.shrink_interval(shrink)),
            raw,
        }
    }

    /// What the reader should know about the floor.
    pub(crate) fn note(&self) -> Option<String> {
        (self.floor == 0.0).then(|| {
            "how much of the gap is noise is not known: give `noise` for each [[channel]], or record a repeat".to_owned()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Blocks of a hundred values with a gap of twice the noise and one cause found, which takes this share of the gap of every block away.
    fn measure<'a>(bootstrap: &'a Bootstrap, taken: &[f64]) -> Measure<'a> {
        let before = vec![400.0; taken.len()];
        let after: Vec<f64> = taken.iter().map(|share| 400.0 * (1.0 - share)).collect();
        let weigh = |weights: &Vec<f64>| weighted(weights, &after);
        Measure {
            refitted: bootstrap.draws().iter().map(weigh).collect(),
            reducible_blocks: vec![300.0; taken.len()],
            values: vec![100.0; taken.len()],
            before,
            after,
            floor: 1.0,
            allowed: 1.0,
            is_found: true,
            bootstrap,
        }
    }

    #[test]
    fn a_shrink_that_few_blocks_show_is_not_certain() {
        let bootstrap = Bootstrap::new(30);
        let everywhere = vec![0.1; 30];
        let mut somewhere = vec![-0.02; 30];
        somewhere[7] = 0.7;
        let [sure, unsure] = [everywhere, somewhere].map(|taken| measure(&bootstrap, &taken));
        assert!(sure.surely_shrinks(), "{:?}", sure.shrink());
        assert!(unsure.shrink().is_some_and(|shrink| shrink > 0.0) && !unsure.surely_shrinks());
    }
}
