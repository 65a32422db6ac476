//! A constant added to a signal: the zero of an amplifier, 5 % of the range on cheap gauges.
//!
//! Runs of one session share it, each other session may have another; one that only a single unit of the hold-out shows is fitted on
//! that unit's even seconds.

use std::ops::Range;

use super::*;

/// A constant added to a signal: the zero of an amplifier, 5 % of the range on cheap gauges.
pub(super) struct ZeroOffset;

impl Effect for ZeroOffset {
    fn id(&self) -> &'static str {
        "zero_offset"
    }

    fn words(&self) -> &'static str {
        "a zero that is off"
    }

    fn remedy(&self) -> &'static str {
        "tare, or calibrate the zeros again"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        let _ = session;
        None
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        zeros(session, channel)
    }

    fn report(&self, session: &Session, term: &Fitted<'_>) -> Option<Vec<Reported>> {
        let Place::Channel(channel) = term.place else { return None };
        let sigma =
            term.sigmas.iter().map(|sigma| sigma * sigma).sum::<f64>().sqrt() / term.sigmas.len() as f64;
        let unit = session.channels[channel].unit.clone();
        Some(vec![("offset".to_owned(), mean(term.values)?, Some(sigma), unit)])
    }

    fn compensate(&self, _session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Channel(gauge) = term.place else { return Vec::new() };
        mean(term.values).map(|counts| Compensation::Bias { gauge, counts }).into_iter().collect()
    }

    fn experiment(&self) -> &'static str {
        "a recording after a tare"
    }
}

/// A constant of its own for every session.
pub(super) fn zeros(session: &Session, channel: usize) -> Vec<Column> {
    let own = &session.channels[channel];
    let plausible = (0.05 * own.extent()).max(3.0 * own.rms_gap());
    let column = |values| Column::value("offset", &own.unit, plausible, channel, values);
    let sessions = if own.gauge.is_some() { sessions(session) } else { Vec::new() };
    if sessions.len() < 2 {
        return vec![column(vec![1.0; session.rows()])];
    }
    let of = |rows: Vec<Range<usize>>| {
        let mut values = vec![0.0; session.rows()];
        rows.iter().cloned().flatten().for_each(|row| values[row] = 1.0);
        Column { unit_only: only_unit(session, &rows), ..column(values) }
    };
    sessions.into_iter().map(of).collect()
}

/// Over the sessions; none of none.
fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Rows of each session: segments that began together.
fn sessions(session: &Session) -> Vec<Vec<Range<usize>>> {
    let mut out: Vec<(f64, Vec<Range<usize>>)> = Vec::new();
    for (rows, began_s) in session.segments.iter().zip(&session.began_s) {
        match out.iter_mut().find(|(known_s, _)| known_s == began_s) {
            Some((_, own)) => own.push(rows.clone()),
            None => out.push((*began_s, vec![rows.clone()])),
        }
    }
    out.into_iter().map(|(_, rows)| rows).collect()
}

/// The unit of the hold-out that all these rows lie in, if it is one.
fn only_unit(session: &Session, rows: &[Range<usize>]) -> Option<usize> {
    let hold_out = &session.hold_out;
    let mut units =
        rows.iter().cloned().flatten().map(|row| hold_out.unit_of_block[hold_out.block_of_row[row]]);
    let first = units.next()?;
    units.all(|unit| unit == first).then_some(first)
}
