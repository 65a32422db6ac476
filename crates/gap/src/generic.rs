//! A model that knows no physics: a gauge's zero and scale that wander, each instant's taken from what is near in time.
//!
//! Fitted on even seconds and judged on the odd ones, as events are. What it foretells better than the effects that were found is
//! not what they say it is (a zero that walks at random looks like drift, creep or warmth in any one recording). It is no
//! explanation itself, since of another recording it knows nothing.

use crate::bootstrap::Bootstrap;
use crate::select::WORTH;
use crate::session::Session;

/// Reach (even seconds to each side) of the neighbourhood, and whether the scale wanders too.
const KINDS: [(usize, bool); 4] = [(1, false), (1, true), (2, true), (4, true)];
/// How far a scale plausibly wanders.
const PLAUSIBLE: f64 = 0.2;
/// Share of what the generic model foretells that may be missing from what was found; with more, that is refuted.
pub(crate) const REFUTES: f64 = 0.15;
/// Share of draws in which that may fail to show.
const DOUBT: f64 = 0.05;

/// Sums over one second of a recording for one gauge: ones, signal, signal^2, gap, signal times gap, gap^2; over scales.
type Sums = [f64; 6];

/// Squared residuals on odd seconds, by channel and block.
pub(crate) struct Generic {
    /// As simulated, and with the generic model.
    before: Vec<Vec<f64>>,
    wandering: Vec<Vec<f64>>,
}

/// One second (or what is left of it) in one block.
struct Second {
    block: usize,
    is_even: bool,
    rows: std::ops::Range<usize>,
}

impl Generic {
    /// Of a session with even and odd seconds; none of others.
    pub(crate) fn new(session: &Session) -> Option<Self> {
        if session.hold_out.is_even.is_empty() {
            return None;
        }
        let seconds = seconds(session);
        let channels: Vec<usize> = (0..session.channels.len()).collect();
        let found = crate::parallel::map(&channels, |channel| of_channel(session, *channel, &seconds));
        let mut generic = Self { before: Vec::new(), wandering: Vec::new() };
        for [before, wandering] in found {
            generic.before.push(before);
            generic.wandering.push(wandering);
        }
        Some(generic)
    }

    /// Share of what the generic model foretells of these channels' gap on left-out odd seconds that was not found, `after` being the
    /// squared residual of what was, by channel and block; 0 where that is not beyond doubt, or so little that the calibration's own errors
    /// may do it.
    pub(crate) fn lead(
        &self,
        session: &Session,
        channels: &[usize],
        after: &[Vec<f64>],
        bootstrap: &Bootstrap,
    ) -> f64 {
        let mut ahead = vec![0.0; session.blocks()];
        let mut foretold = 0.0;
        for &channel in channels {
            for block in (0..session.blocks()).filter(|block| !session.hold_out.is_even(*block)) {
                ahead[block] += after[channel][block] - self.wandering[channel][block];
                foretold += self.before[channel][block] - self.wandering[channel][block];
            }
        }
        let hold_out = &session.hold_out;
        let odd = hold_out.block_of_row.iter().filter(|block| !hold_out.is_even(**block)).count();
        let least = WORTH * (odd * channels.len()) as f64;
        let all: f64 = ahead.iter().sum();
        let is_sure = all > least && foretold > 0.0 && bootstrap.quantile_of_sum(&ahead, DOUBT) > 0.0;
        if is_sure { (all / foretold).clamp(0.0, 1.0) } else { 0.0 }
    }
}

/// Rows of one block one after the other, within a segment.
fn seconds(session: &Session) -> Vec<Second> {
    let mut seconds: Vec<Second> = Vec::new();
    let hold_out = &session.hold_out;
    for segment in &session.segments {
        let first = seconds.len();
        for row in segment.clone() {
            let block = hold_out.block_of_row[row];
            match seconds[first..].last_mut() {
                Some(last) if last.block == block => last.rows.end = row + 1,
                _ => seconds.push(Second { block, is_even: hold_out.is_even(block), rows: row..row + 1 }),
            }
        }
    }
    seconds
}

/// Per block on odd seconds: squared gap, what the best generic model leaves of it.
fn of_channel(session: &Session, channel: usize, seconds: &[Second]) -> [Vec<f64>; 2] {
    let sums: Vec<Sums> = seconds.iter().map(|second| sums(session, channel, second)).collect();
    let blocks = || vec![0.0; session.blocks()];
    let mut before = blocks();
    for (second, sums) in seconds.iter().zip(&sums).filter(|(second, _)| !second.is_even) {
        before[second.block] += sums[5];
    }
    let left = |(reach, scales): (usize, bool)| {
        let mut left = blocks();
        for index in (0..seconds.len()).filter(|index| !seconds[*index].is_even) {
            let (offset, factor) = near(seconds, &sums, index, reach, scales);
            let [n, x, xx, g, xg, gg] = sums[index];
            left[seconds[index].block] += gg - 2.0 * (offset * g + factor * xg)
                + offset * offset * n
                + 2.0 * offset * factor * x
                + factor * factor * xx;
        }
        left
    };
    let total = |values: &Vec<f64>| values.iter().sum::<f64>();
    let best = KINDS.map(left).into_iter().min_by(|a, b| total(a).total_cmp(&total(b))).unwrap_or_default();
    [before, best]
}

fn sums(session: &Session, channel: usize, second: &Second) -> Sums {
    let own = &session.channels[channel];
    let mut sums = [0.0; 6];
    for row in second.rows.clone().filter(|row| own.is_read(*row)) {
        let (x, g) = (own.simulated[row] / own.scale, own.gap[row] / own.scale);
        for (sum, value) in sums.iter_mut().zip([1.0, x, x * x, g, x * g, g * g]) {
            *sum += value;
        }
    }
    sums
}

/// Zero (scales) and factor that the even seconds near an odd one ask for.
fn near(seconds: &[Second], sums: &[Sums], index: usize, reach: usize, scales: bool) -> (f64, f64) {
    let mut all = [0.0; 6];
    let mut add = |found: usize| all.iter_mut().zip(&sums[found]).for_each(|(sum, value)| *sum += value);
    let is_even = |k: &usize| seconds[*k].is_even;
    (0..index).rev().filter(is_even).take(reach).for_each(&mut add);
    (index + 1..seconds.len()).filter(is_even).take(reach).for_each(&mut add);
    let [n, x, xx, g, xg, _] = all;
    if n == 0.0 {
        return (0.0, 0.0);
    }
    // About the mean of the signal, so that a scale that the neighbourhood does not show changes nothing.
    let (mean, level) = (x / n, g / n);
    let factor = if scales { (xg - x * level) / (xx - x * mean + PLAUSIBLE.powi(-2)) } else { 0.0 };
    (level - factor * mean, factor)
}
