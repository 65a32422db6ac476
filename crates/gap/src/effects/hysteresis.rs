//! A signal that depends on where it comes from: a play operator less the signal itself.
//!
//! The stop operator `Play_r(z) - z`, of which any rate-independent hysteresis is a sum (M. Brokate, J. Sprekels, Hysteresis and Phase
//! Transitions, 1996, ch. 2); the width is a share of half the signal's span.

use super::*;

/// Hysteresis of a sensor.
pub(super) struct Hysteresis;

impl Effect for Hysteresis {
    fn id(&self) -> &'static str {
        "hysteresis"
    }

    fn words(&self) -> &'static str {
        "hysteresis of the sensor"
    }

    fn remedy(&self) -> &'static str {
        "approach every load from the same side, or replace the sensor"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_time_or_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("width", "1")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let _ = session;
        let widths = geometric(0.02, 0.6, 6);
        [ONE, SEVERAL].iter().flat_map(|plays| widths.iter().map(|width| vec![width[0], *plays])).collect()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let plays = if shape[1] == ONE { &SPREAD[1..2] } else { &SPREAD[..] };
        let column = |(factor, name): &(f64, &str)| {
            Column::value(name, "1", 0.5, channel, play(session, own, shape[0] * factor, MIDDLE))
        };
        let mut columns: Vec<Column> = plays.iter().map(column).collect();
        columns.extend(beginning(session, channel, shape[0]));
        columns
    }

    fn experiment(&self) -> &'static str {
        "the same load approached from both sides, slowly"
    }
}

/// One play, or several of other widths beside it: a loop with round corners.
const ONE: f64 = 1.0;
const SEVERAL: f64 = 3.0;
/// Widths against the middle one, and what their shares are called.
const SPREAD: [(f64, &str); 3] = [(0.3, "relative_narrow"), (1.0, "relative"), (3.0, "relative_wide")];

/// Where in its play a signal begins: in the middle, or at an end.
const MIDDLE: f64 = 0.0;
const END: f64 = 1.0;
/// Share of all rows for which a play must remember its beginning to be worth a column.
const REMEMBERED: f64 = 0.02;

/// What a play that began at its end shows otherwise: where a sensor comes from when a recording begins nobody knows, and until its
/// load has gone to and fro it remembers that. It says nothing of any other unit than the one that it is remembered in most, and of that
/// unit no other says anything: there it is fitted, and elsewhere it is taken for nothing. None where it is soon forgotten.
fn beginning(session: &Session, channel: usize, width: f64) -> Option<Column> {
    let own = &session.channels[channel];
    let (middle, end) = (play(session, own, width, MIDDLE), play(session, own, width, END));
    let mut change: Vec<f64> = end.iter().zip(&middle).map(|(end, middle)| end - middle).collect();
    let remembered = change.iter().filter(|change| **change != 0.0).count();
    if (remembered as f64) <= REMEMBERED * change.len() as f64 {
        return None;
    }
    let hold_out = &session.hold_out;
    let unit_of = |row: usize| hold_out.unit_of_block[hold_out.block_of_row[row]];
    let has_seconds = !hold_out.is_even.is_empty();
    let unit_only = has_seconds.then(|| most_in(&change, hold_out.units.len(), unit_of));
    if let Some(unit) = unit_only {
        change
            .iter_mut()
            .enumerate()
            .filter(|(row, _)| unit_of(*row) != unit)
            .for_each(|(_, change)| *change = 0.0);
    }
    let column = Column::value("", "1", 0.5, channel, change).role(Role::Nuisance);
    Some(Column { unit_only, ..column })
}

/// The unit in which the values are largest.
fn most_in(values: &[f64], units: usize, unit_of: impl Fn(usize) -> usize) -> usize {
    let mut squares = vec![0.0; units];
    values.iter().enumerate().for_each(|(row, value)| squares[unit_of(row)] += value * value);
    (0..units).max_by(|a, b| squares[*a].total_cmp(&squares[*b])).unwrap_or(0)
}

/// A play operator's output less its input (channel's unit), per row, each segment from its beginning.
fn play(session: &Session, own: &crate::session::Channel, width: f64, from: f64) -> Vec<f64> {
    let radius = width * own.extent();
    let mut values = vec![0.0; session.rows()];
    for rows in &session.segments {
        let mut play = own.simulated[rows.start] + from * radius;
        for row in rows.clone() {
            let signal = own.simulated[row];
            play = play.clamp(signal - radius, signal + radius);
            values[row] = play - signal;
        }
    }
    values
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_memory_belongs_to_the_unit_where_it_is_largest() {
        assert_eq!(super::most_in(&[1.0, -5.0, 2.0, 3.0], 2, |row| row % 2), 1);
    }
}
