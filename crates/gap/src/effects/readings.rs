//! What was read, as far as it may be looked at before anything is fitted.

use crate::session::Session;

/// Readings are the same within this share of what the gap is counted in: they are summed up from simulation and gap.
const SAME: f64 = 1e-6;

/// A channel's readings in rising order (channel's unit); where recordings have seconds, of the even ones, as for all that one unit shows alone.
pub(super) fn sorted(session: &Session, channel: usize) -> Vec<f64> {
    let own = &session.channels[channel];
    let hold_out = &session.hold_out;
    let may_look = |row: &usize| {
        own.is_read(*row) && (hold_out.is_even.is_empty() || hold_out.is_even(hold_out.block_of_row[*row]))
    };
    let mut read: Vec<f64> =
        (0..session.rows()).filter(may_look).map(|row| at(session, channel, row)).collect();
    read.sort_by(f64::total_cmp);
    read
}

/// What a channel read at a row (channel's unit).
pub(super) fn at(session: &Session, channel: usize, row: usize) -> f64 {
    let own = &session.channels[channel];
    own.simulated[row] + own.gap[row]
}

/// Whether two readings of a channel are the same.
pub(super) fn are_same(session: &Session, channel: usize, a: f64, b: f64) -> bool {
    (a - b).abs() < SAME * session.channels[channel].scale
}

/// Smallest difference between two readings that are not the same (channel's unit).
pub(super) fn resolution(session: &Session, channel: usize) -> Option<f64> {
    smallest_step(session, channel, &sorted(session, channel))
}

/// The same of readings that have been sorted.
pub(super) fn smallest_step(session: &Session, channel: usize, read: &[f64]) -> Option<f64> {
    let steps = read.windows(2).filter(|pair| !are_same(session, channel, pair[0], pair[1]));
    steps.map(|pair| pair[1] - pair[0]).min_by(f64::total_cmp)
}
