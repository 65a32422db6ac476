//! A gauge's zero and scale that wander, each instant's taken from what is near in time.
//!
//! A zero that walks at random looks like drift, creep or warmth in any one recording. It is no explanation itself, since of another
//! recording it knows nothing.

use crate::session::{Channel, Session};

/// Reach (even seconds to each side) of the neighbourhood, and whether the scale wanders too.
const KINDS: [(usize, bool); 4] = [(1, false), (1, true), (2, true), (4, true)];
/// How far a scale plausibly wanders.
const PLAUSIBLE: f64 = 0.2;

/// Sums over one second of a recording for one gauge: ones, signal, signal^2, gap, signal times gap, gap^2; over scales.
type Sums = [f64; 6];

/// One second (or what is left of it) in one block.
struct Second {
    block: usize,
    is_even: bool,
    rows: std::ops::Range<usize>,
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

/// Per row on odd seconds what the best of them leaves of what is to be foretold.
pub(super) fn of_channel(session: &Session, channel: usize, target: &[Option<f64>]) -> Vec<Option<f64>> {
    let seconds = &seconds(session);
    let own = &session.channels[channel];
    let sums: Vec<Sums> = seconds.iter().map(|second| sums(own, second, target)).collect();
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
    for index in odd() {
        let (offset, factor) =
            best.map_or((0.0, 0.0), |(reach, scales)| near(seconds, &sums, index, reach, scales));
        for row in seconds[index].rows.clone() {
            out[row] = target[row].map(|target| target - factor * own.simulated[row] / own.scale - offset);
        }
    }
    out
}

fn sums(own: &Channel, second: &Second, target: &[Option<f64>]) -> Sums {
    let mut sums = [0.0; 6];
    for (row, g) in second.rows.clone().filter_map(|row| Some((row, target[row]?))) {
        let x = own.simulated[row] / own.scale;
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
