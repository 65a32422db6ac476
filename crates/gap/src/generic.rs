//! A model that knows no physics: a gauge's zero and scale that wander, each instant's taken from what is near in time.
//!
//! Fitted on even seconds and judged on the odd ones, as events are. What it foretells better than the effects that were found is
//! not what they say it is (a zero that walks at random looks like drift, creep or warmth in any one recording). It is no
//! explanation itself, since of another recording it knows nothing.

use crate::bootstrap::Bootstrap;
use crate::location::Residuals;
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
/// Share of it that must differ between two of the same motion: a form that is not quite the catalogue's comes again with the motion.
const WANDERS: f64 = 0.35;

/// Sums over one second of a recording for one gauge: ones, signal, signal^2, gap, signal times gap, gap^2; over scales.
type Sums = [f64; 6];

/// What a zero and a scale that wander leave of every channel on odd seconds, per row over its scale; none elsewhere.
pub(crate) struct Generic {
    wandering: Residuals,
}

/// What a wandering zero foretells better than what was found, in squares on odd seconds.
#[derive(Default)]
struct Ahead {
    /// What it foretells of the gap.
    foretold: f64,
    /// What it leaves less than what was found.
    all: f64,
    /// The same on motions that were made twice, and what of it did not come twice.
    repeated: f64,
    differs: f64,
}

impl Ahead {
    /// Share of what is foretold that was not found; nothing where it comes again with the motion, for what wanders does not.
    fn share(&self) -> f64 {
        let comes_again = self.repeated > 0.0 && self.differs < WANDERS * self.repeated;
        if comes_again || self.foretold <= 0.0 { 0.0 } else { (self.all / self.foretold).clamp(0.0, 1.0) }
    }
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
        let wandering = crate::parallel::map(&channels, |channel| of_channel(session, *channel, &seconds));
        Some(Self { wandering })
    }

    /// Share of what the generic model foretells of these channels' gap on left-out odd seconds that was not found, `after` being what was
    /// left per row; 0 where that is not beyond doubt, comes again with the motion, or is so little that the calibration's own errors may
    /// do it.
    pub(crate) fn lead(
        &self,
        session: &Session,
        channels: &[usize],
        after: &Residuals,
        bootstrap: &Bootstrap,
    ) -> f64 {
        let mut by_block = vec![0.0; session.blocks()];
        let mut ahead = Ahead::default();
        for &channel in channels {
            self.add(session, channel, &after[channel], &mut ahead, &mut by_block);
        }
        let hold_out = &session.hold_out;
        let odd = hold_out.block_of_row.iter().filter(|block| !hold_out.is_even(**block)).count();
        let least = WORTH * (odd * channels.len()) as f64;
        let is_sure = ahead.all > least && bootstrap.quantile_of_sum(&by_block, DOUBT) > 0.0;
        if is_sure { ahead.share() } else { 0.0 }
    }

    fn add(
        &self,
        session: &Session,
        channel: usize,
        after: &[Option<f64>],
        ahead: &mut Ahead,
        by_block: &mut [f64],
    ) {
        let own = &session.channels[channel];
        let left = |row: usize| Some([after[row]?, self.wandering[channel][row]?]);
        for row in 0..session.rows() {
            let Some([after, wandering]) = left(row) else { continue };
            let more = after * after - wandering * wandering;
            by_block[session.hold_out.block_of_row[row]] += more;
            ahead.all += more;
            ahead.foretold += (own.gap[row] / own.scale).powi(2) - wandering * wandering;
        }
        for (first, second) in session.repeats.iter().flat_map(|(a, b)| a.clone().zip(b.clone())) {
            let (Some(first), Some(second)) = (left(first), left(second)) else { continue };
            let [sum, difference] = [1.0, -1.0].map(|sign| {
                let [after, wandering] = [0, 1].map(|k| first[k] + sign * second[k]);
                0.5 * (after * after - wandering * wandering)
            });
            ahead.repeated += sum + difference;
            // Half of what differs by itself is in the sum, half in the difference.
            ahead.differs += 2.0 * difference;
        }
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

/// Per row on odd seconds what the best generic model leaves.
fn of_channel(session: &Session, channel: usize, seconds: &[Second]) -> Vec<Option<f64>> {
    let sums: Vec<Sums> = seconds.iter().map(|second| sums(session, channel, second)).collect();
    let odd = || (0..seconds.len()).filter(|index| !seconds[*index].is_even);
    let left = |(reach, scales): (usize, bool)| {
        let of_second = |index: usize| {
            let (offset, factor) = near(seconds, &sums, index, reach, scales);
            let [n, x, xx, g, xg, gg] = sums[index];
            gg - 2.0 * (offset * g + factor * xg)
                + offset * offset * n
                + 2.0 * offset * factor * x
                + factor * factor * xx
        };
        odd().map(of_second).sum::<f64>()
    };
    let best = KINDS.into_iter().min_by(|a, b| left(*a).total_cmp(&left(*b)));
    let mut out = vec![None; session.rows()];
    let own = &session.channels[channel];
    for index in odd() {
        let (offset, factor) = best.map_or((0.0, 0.0), |(reach, scales)| near(seconds, &sums, index, reach, scales));
        for row in seconds[index].rows.clone().filter(|row| own.is_read(*row)) {
            out[row] = Some((own.gap[row] - factor * own.simulated[row]) / own.scale - offset);
        }
    }
    out
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
