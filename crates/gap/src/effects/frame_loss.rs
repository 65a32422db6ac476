//! Readings that are not new: where a frame was lost, or a converter missed its turn, the last one stands for the next.
//!
//! They show by themselves: a sensor whose noise is far above its resolution does not say the same twice.

use super::*;

/// Readings that are not new.
pub(super) struct FrameLoss;

/// Fewer than so many in all recordings are no fault of the transfer, and fewer new ones no signal.
const FEWEST: usize = 25;
/// A sensor whose steps are larger than this share of its noise may repeat itself.
const COARSE: f64 = 0.2;

impl Effect for FrameLoss {
    fn id(&self) -> &'static str {
        "frame_loss"
    }

    fn words(&self) -> &'static str {
        "readings that are the last ones again"
    }

    fn remedy(&self) -> &'static str {
        "look for lost frames and a converter that is read too often; leave repeated readings out"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_time_or_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let held = held(session, channel);
        let again = held.iter().flatten().count();
        if again.min(held.len() - again) < FEWEST || is_coarse(session, channel) {
            return Vec::new();
        }
        let own = &session.channels[channel].simulated;
        let late = |(row, since): (usize, &Option<usize>)| since.map_or(0.0, |since| own[since] - own[row]);
        vec![Column::pinned(channel, held.iter().enumerate().map(late).collect())]
    }

    fn report(&self, session: &Session, term: &Fitted<'_>) -> Option<Vec<Reported>> {
        let Place::Channel(channel) = term.place else { return None };
        let held = held(session, channel);
        let share = held.iter().flatten().count() as f64 / session.channels[channel].count().max(1) as f64;
        Some(vec![("share".to_owned(), share, None, "1".to_owned())])
    }

    fn experiment(&self) -> &'static str {
        "the same motion with the bus logged beside the sensor"
    }
}

/// For every row whose reading is the one before again, the row that it was new at.
fn held(session: &Session, channel: usize) -> Vec<Option<usize>> {
    let own = &session.channels[channel];
    let reading = |row: usize| readings::at(session, channel, row);
    let mut held = vec![None; session.rows()];
    for rows in &session.segments {
        for row in rows.clone().skip(1).filter(|row| own.is_read(*row) && own.is_read(row - 1)) {
            if readings::are_same(session, channel, reading(row), reading(row - 1)) {
                held[row] = Some(held[row - 1].unwrap_or(row - 1));
            }
        }
    }
    held
}

/// Whether the sensor's steps are so large that it says the same by chance.
fn is_coarse(session: &Session, channel: usize) -> bool {
    let own = &session.channels[channel];
    let smallest = readings::resolution(session, channel);
    smallest.is_none_or(|step| step > COARSE * own.scale)
}
